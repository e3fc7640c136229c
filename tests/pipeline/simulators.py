"""Runs the scripts of docs/simulators.md as they stand, with MuJoCo and PyBullet, and compares the tactile images with those
of gelsim's own capture of the same scene.

    python simulators.py GELSIM         needs mujoco (with OSMesa), pybullet, numpy and pillow
"""

import ctypes.util
import json
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import time

import numpy
from PIL import Image

from sets import REPOSITORY, environment
from snippet import snippets

PAGE = REPOSITORY / "docs/simulators.md"
WIDTH, HEIGHT, PITCH = 320, 240, 1 / 16
# With parallel rays, images may differ by so many levels.
LEVELS = 2


def mesh(path):
    """The scene's ball and rod, with their lowest points at z = 0 and 0.5 mm, finer than a pixel shows."""
    lines, base = [], 1
    rings, sides = 180, 720
    turns = numpy.linspace(0, 2 * numpy.pi, sides, endpoint=False)

    def surface(profile):
        """A profile of (radius, z) turned about an axis; closed where the radius is 0."""
        nonlocal base
        for radius, z, x in profile:
            lines.extend(f"v {x + radius * c:.7f} {radius * s:.7f} {z:.7f}" for c, s in zip(numpy.cos(turns), numpy.sin(turns)))
        for ring in range(len(profile) - 1):
            for k in range(sides):
                a, b = base + ring * sides + k, base + ring * sides + (k + 1) % sides
                lines.append(f"f {a} {b} {b + sides} {a + sides}")
        base += len(profile) * sides

    angles = numpy.linspace(0.0005, numpy.pi / 2, rings)
    surface([(4 * numpy.sin(a), 4 - 4 * numpy.cos(a), 0) for a in angles])
    surface([(1e-5, 0.5, 6), (1.4, 0.5, 6), (1.4, 10.5, 6)])
    path.write_text("\n".join(lines) + "\n")


def own(folder, pressed_mm):
    """gelsim's own image of the scene."""
    out = folder / f"own-{pressed_mm}"
    if not out.exists():
        generate(folder, out, pressed_mm)
    shard = next((out / "data").iterdir())
    depth = numpy.load(next(shard.glob("*.depth.npy")))
    return picture(next(shard.glob("*.tactile.png"))), depth


def generate(folder, out, pressed_mm):
    job = f"""
        dataset = {{ name = "own", samples = 1, seed = 1 }}
        sensor = {{ preset = "gelsight-2014", resolution_px = [{WIDTH}, {HEIGHT}] }}
        pose.anchor = "origin"
        indentation.depth_mm = {pressed_mm}
        output = {{ layers = ["depth", "contact"], depth_format = "npy", container = "folder" }}
        object = [{{ path = "scene.obj" }}]
    """
    (folder / "own.toml").write_text(re.sub(r"(?m)^\s+", "", job))
    subprocess.run(["gelsim", "generate", "own.toml", "--quiet", "--out", str(out)], cwd=folder, check=True)


def pressed_inside(folder, lean):
    """gelsim's own image and label of the script's ball in a GelTip, so far from the tip over the gel."""
    lines = []
    rings, sides = 360, 720
    turns = numpy.linspace(0, 2 * numpy.pi, sides, endpoint=False)
    for a in numpy.linspace(0.0005, numpy.pi - 0.0005, rings):
        lines.extend(f"v {4 * numpy.sin(a) * c:.7f} {4 * numpy.sin(a) * s:.7f} {-4 * numpy.cos(a):.7f}" for c, s in zip(numpy.cos(turns), numpy.sin(turns)))
    for ring in range(rings - 1):
        for k in range(sides):
            a, b = 1 + ring * sides + k, 1 + ring * sides + (k + 1) % sides
            lines.append(f"f {a} {b} {b + sides} {a + sides}")
    (folder / "ball.obj").write_text("\n".join(lines) + "\n")
    job = f"""
        dataset = {{ name = "own", samples = 1, seed = 1 }}
        sensor = {{ preset = "geltip" }}
        pose.from_tip_mm = {11.485 * lean}
        indentation.depth_mm = 0.8
        camera.read_noise_levels = 0.0
        output = {{ layers = ["depth"], container = "folder" }}
        object = [{{ path = "ball.obj" }}]
    """
    (folder / "inside.toml").write_text(re.sub(r"(?m)^\s+", "", job))
    out = folder / f"own-inside-{lean}"
    subprocess.run(["gelsim", "generate", "inside.toml", "--quiet", "--out", str(out)], cwd=folder, check=True)
    shard = next((out / "data").iterdir())
    return picture(next(shard.glob("*.tactile.png"))), json.loads(next(shard.glob("*.json")).read_text())


def compare_inside(folder, command):
    """A ball that comes out of a GelTip, seen by MuJoCo from inside: the press of a ball there."""
    subprocess.run([*command.split(), "--set", "camera.read_noise_levels=0.0"], cwd=folder, check=True)
    for number, lean in enumerate([0.0, 0.7]):
        expected, own = pressed_inside(folder, lean)
        found = picture(folder / f"from-inside/{number}.tactile.png")
        away = numpy.abs(found - expected).max(axis=2)
        label = json.loads((folder / f"from-inside/{number}.json").read_text())
        force = label["contact"]["force_n"] / own["contact"]["force_n"]
        print(f"mujoco inside a GelTip, {lean} rad from the tip: {away.max()} levels, {(away > LEVELS).sum()} px over {LEVELS}, force {force:.4f}")
        assert (away > LEVELS).sum() <= 50 and away.max() <= 12 and abs(force - 1) < 0.01, f"inside, {lean} rad"
        assert label["health"]["unseen_px"] == 0 and numpy.ptp(expected - picture_of_rest(folder)) > 10


def picture_of_rest(folder):
    """The GelTip's untouched image, of a frame that shows nothing."""
    out = folder / "rest"
    if not out.exists():
        numpy.save(folder / "nothing.npy", numpy.full((240, 320), numpy.inf))
        command = "gelsim render --depth nothing.npy --depth-unit mm --no-contact-ok --sensor geltip --set camera.read_noise_levels=0.0 --out rest --quiet"
        subprocess.run(command.split(), cwd=folder, check=True)
    return picture(out / "nothing.tactile.png")


def picture(path):
    return numpy.asarray(Image.open(path)).astype(int)


def outlines(depth):
    """Pixels within three of where the object begins or ends to reach into the pad, or jumps: there gelsim's own image of a mesh
    averages light over pixels, of which a frame knows the centres alone."""
    inside = depth > 0
    edge = numpy.zeros_like(inside)
    for axis in (0, 1):
        jump = (numpy.abs(numpy.diff(depth, axis=axis)) > 0.2) | (numpy.diff(inside, axis=axis))
        pad = [(0, 0), (0, 0)]
        for side in ((0, 1), (1, 0)):
            pad[axis] = side
            edge |= numpy.pad(jump, pad)
    for _ in range(3):
        grown = edge.copy()
        for axis in (0, 1):
            for by in (-1, 1):
                grown |= numpy.roll(edge, by, axis)
        edge = grown
    return edge


def compare(name, found, folder, pressed_mm, levels=LEVELS, most=0):
    """Fails beyond `levels` outside the outlines, and where more than `most` pixels there are over 2 levels off."""
    expected, depth = own(folder, pressed_mm)
    away = numpy.abs(found - expected).max(axis=2)
    clear = away[~outlines(depth)]
    outside, inside, over = clear.max(), away.max(), (clear > LEVELS).sum()
    print(f"{name}: {outside} levels outside the outlines, {inside} at them, {over} px outside over {LEVELS}")
    assert outside <= levels and over <= most, f"{name}: {outside} levels, {over} px over {LEVELS}"
    # There is something to see.
    assert depth.max() > 0.9 * pressed_mm and numpy.ptp(expected) > 40


def first_image_ms(folder):
    """From the start of the program to the first image of a stream of 320x240 px, the shortest of five."""
    frame = (folder / "frames/0.npy").read_bytes()
    command = "gelsim render --stream --depth-unit m --plane-mm 10 --sensor gelsight-2014 --quiet"

    def once():
        start = time.perf_counter()
        done = subprocess.run(command.split(), input=frame, capture_output=True, check=True)
        assert len(done.stdout) == 128 + 3 * WIDTH * HEIGHT
        return 1e3 * (time.perf_counter() - start)

    return min(once() for _ in range(5))


def main():
    if not ctypes.util.find_library("OSMesa"):
        return print("skipped: no libOSMesa, with which MuJoCo draws without a graphics card")
    os.environ.update(environment(pathlib.Path(sys.argv[1]).resolve()))
    mujoco, pybullet, perspective, inside, slide, stream = snippets(PAGE)
    commands = {
        re.search(r"--out (\S+)", command)[1]: command
        for command in re.findall(r"(?m)^    (gelsim render .*)$", PAGE.read_text())
    }
    with tempfile.TemporaryDirectory() as temporary:
        folder = pathlib.Path(temporary)
        mesh(folder / "scene.obj")
        for script in (mujoco, pybullet, perspective, inside, slide):
            subprocess.run([sys.executable, "-c", script], cwd=folder, check=True)
        for command in commands.values():
            subprocess.run(command.split(), cwd=folder, check=True)
        for number, pressed_mm in enumerate([0.5, 1.0]):
            compare(f"mujoco, {pressed_mm} mm", picture(folder / f"tactile/{number}.tactile.png"), folder, pressed_mm)
        compare("pybullet", picture(folder / "from-rays/press.tactile.png"), folder, 1.0)
        command = commands["from-perspective"] + " --set sensor.resolution_px=[320,240]"
        subprocess.run(command.split(), cwd=folder, check=True)
        # The rod's rim is known to the distance between two rays, a third of a pixel, and the pad around it follows.
        found = picture(folder / "from-perspective/press.tactile.png")
        compare("mujoco in perspective", found, folder, 1.0, levels=24, most=200)
        label = json.loads((folder / "from-perspective/press.json").read_text())
        # The rod's rim hides a ring around itself, where the pad begins.
        print(f"mujoco in perspective: {label['health']['unseen_px']} px unseen")
        assert 0 < label["health"]["unseen_px"] < 400

        compare_inside(folder, commands["from-inside"])

        rows = [json.loads((folder / f"slid/{k:02}.json").read_text())["frame"] for k in range(24)]
        forces = numpy.array([row["wrench"]["force_n"] for row in rows])
        # Pressed, then pushed along x until all of it slips.
        assert numpy.abs(forces[:8, :2]).max() < 1e-3 * -forces[7, 2] and (numpy.diff(-forces[:8, 2]) > 0).all()
        assert rows[-1]["slip"]["state"] == "gross" and abs(forces[-1, 0] / (-0.3 * forces[-1, 2]) - 1) < 0.02, rows[-1]["slip"]
        print(f"mujoco, a slide: {forces[-1, 0]:.4f} N of {-0.3 * forces[-1, 2]:.4f} in gross slip")

        script = stream + "\nnumpy.save('images.npy', images)\nassert touch.wait() == 0\n"
        subprocess.run([sys.executable, "-c", script], cwd=folder, check=True)
        images = numpy.load(folder / "images.npy")
        for number, image in enumerate(images):
            assert (image == picture(folder / f"tactile/{number}.tactile.png")).all(), number
        print(f"stream: {len(images)} images as those of the files; the first {first_image_ms(folder):.0f} ms after the start")


if __name__ == "__main__":
    main()
