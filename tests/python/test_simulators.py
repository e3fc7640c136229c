"""The scripts of docs/how-to/simulators.md as they stand, with MuJoCo and PyBullet: tactile images of their frames
against gelsim's own images of the same scenes. Failures, and `-rP`, show by how many levels they differ."""

import ctypes.util
import json
import re
import sys

import pytest

numpy = pytest.importorskip("numpy", reason="no numpy: pip install numpy")
Image = pytest.importorskip("PIL.Image", reason="no pillow: pip install pillow")

from processes import run
from snippet import snippets

WIDTH, HEIGHT = 320, 240
# With parallel rays, images may differ by so many levels.
LEVELS = 2


@pytest.fixture(scope="module")
def page(project):
    return project / "docs/how-to/simulators.md"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The folder that all scripts and commands run in."""
    return tmp_path_factory.mktemp("simulators")


@pytest.fixture(scope="module")
def render_frames(page, folder):
    """Runs the page's script that has `part` in it, and its command with `--out out`, also with `more`: that folder."""
    lines = re.findall(r"(?m)^    (gelsim render .*)$", page.read_text())
    commands = {re.search(r"--out (\S+)", line)[1]: line for line in lines}

    def render(part, out, *more):
        package = "pybullet" if "pybullet" in part else "mujoco"
        pytest.importorskip(package, reason=f"no {package}: pip install {package}")
        if package == "mujoco" and not ctypes.util.find_library("OSMesa"):
            pytest.skip("no libOSMesa, with which MuJoCo draws without a graphics card: apt install libosmesa6")
        found = [code for code in snippets(page) if part in code]
        assert len(found) == 1, f"{page} has no script of {part!r}, or several"
        assert out in commands, f"{page} has no command with --out {out}"
        run(sys.executable, "-c", found[0], cwd=folder)
        for words in [[], more] if more else [[]]:
            run(*commands[out].split(), *words, cwd=folder)
        return folder / out

    return render


def picture(path):
    return numpy.asarray(Image.open(path)).astype(int)


class Mesh:
    """Surfaces of revolution, finer than a pixel shows, as an OBJ file."""

    def __init__(self):
        self.lines, self.base = [], 1

    def turn(self, profile):
        """A profile of (radius, z, x) turned about an axis at x; closed where the radius is 0."""
        sides = 720
        turns = numpy.linspace(0, 2 * numpy.pi, sides, endpoint=False)
        for radius, z, x in profile:
            circle = zip(x + radius * numpy.cos(turns), radius * numpy.sin(turns))
            self.lines += [f"v {a:.7f} {b:.7f} {z:.7f}" for a, b in circle]
        for ring in range(len(profile) - 1):
            for k in range(sides):
                a, b = self.base + ring * sides + k, self.base + ring * sides + (k + 1) % sides
                self.lines.append(f"f {a} {b} {b + sides} {a + sides}")
        self.base += len(profile) * sides
        return self

    def save(self, path):
        path.write_text("\n".join(self.lines) + "\n")


def ball(first, last, rings, middle):
    """Of 4 mm, from one angle to another."""
    return [(4 * numpy.sin(a), middle - 4 * numpy.cos(a), 0) for a in numpy.linspace(first, last, rings)]


@pytest.fixture(scope="module")
def generate(run_gelsim, tmp_path_factory):
    """gelsim's own image of a mesh: the folder of its files."""

    def generate(mesh, job):
        folder = tmp_path_factory.mktemp("own")
        mesh.save(folder / "scene.obj")
        job = 'dataset = { name = "own", samples = 1, seed = 1 }\nobject = [{ path = "scene.obj" }]\n' + job
        (folder / "own.toml").write_text(job)
        return next((run_gelsim.generate("own.toml", folder / "out", cwd=folder) / "data").iterdir())

    return generate


@pytest.fixture(scope="module")
def own(generate):
    """gelsim's own image and depth of the page's ball and rod, whose lowest points are at z = 0 and 0.5 mm."""
    made = {}

    def press(pressed_mm):
        if pressed_mm not in made:
            rod = [(1e-5, 0.5, 6), (1.4, 0.5, 6), (1.4, 10.5, 6)]
            scene = Mesh().turn(ball(0.0005, numpy.pi / 2, 180, 4)).turn(rod)
            shard = generate(scene, f"""
sensor = {{ preset = "gelsight-2014", resolution_px = [{WIDTH}, {HEIGHT}] }}
pose.anchor = "origin"
indentation.depth_mm = {pressed_mm}
output = {{ layers = ["depth", "contact"], depth_format = "npy", container = "folder" }}
""")
            made[pressed_mm] = picture(next(shard.glob("*.tactile.png"))), numpy.load(next(shard.glob("*.depth.npy")))
        return made[pressed_mm]

    return press


def outlines(depth):
    """Pixels within three of where the object begins or ends to reach into the pad, or jumps: there gelsim's own image
    of a mesh averages light over pixels, of which a frame knows the centres alone."""
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


def assert_like_own(found, own, levels=LEVELS, most=0):
    """Outside the outlines no pixel is off by more than `levels`, and no more than `most` pixels by more than 2."""
    expected, depth = own
    away = numpy.abs(found - expected).max(axis=2)
    clear = away[~outlines(depth)]
    over = int((clear > LEVELS).sum())
    print(f"{clear.max()} levels outside the outlines, {away.max()} at them, {over} px outside over {LEVELS}")
    assert clear.max() <= levels and over <= most
    assert numpy.ptp(expected) > 40, "there is nothing to see"


@pytest.mark.parametrize("pressed_mm", [0.5, 1.0])
def test_gelsims_own_press_is_as_deep_as_asked(own, pressed_mm):
    assert own(pressed_mm)[1].max() > 0.9 * pressed_mm


@pytest.fixture(scope="module")
def pressed(render_frames):
    """MuJoCo's orthographic camera: two depths."""
    return render_frames("frames/{number}.npy\", renderer", "tactile")


@pytest.mark.parametrize("number, pressed_mm", [(0, 0.5), (1, 1.0)])
def test_mujocos_ball_and_rod_look_as_gelsims_own(pressed, own, number, pressed_mm):
    assert_like_own(picture(pressed / f"{number}.tactile.png"), own(pressed_mm))


def test_pybullets_ball_and_rod_look_as_gelsims_own(render_frames, own):
    out = render_frames("import numpy, pybullet", "from-rays")
    assert_like_own(picture(out / "press.tactile.png"), own(1.0))


@pytest.fixture(scope="module")
def perspective(render_frames):
    return render_frames('"seen/press.npy"', "from-perspective", "--set", "sensor.resolution_px=[320,240]")


def test_mujocos_perspective_looks_as_gelsims_own(perspective, own):
    # The rod's rim is known to the distance between two rays, a third of a pixel, and the pad around it follows.
    assert_like_own(picture(perspective / "press.tactile.png"), own(1.0), levels=24, most=200)


def test_the_rods_rim_hides_a_ring_around_itself(perspective):
    unseen = json.loads((perspective / "press.json").read_text())["health"]["unseen_px"]
    print(f"{unseen} px unseen")
    assert 0 < unseen < 400


QUIET = ["--set", "camera.read_noise_levels=0.0"]


@pytest.fixture(scope="module")
def inside(render_frames):
    """A ball that comes out of a GelTip, seen by MuJoCo from inside."""
    return render_frames('f"inside/{number}.npy"', "from-inside", *QUIET)


@pytest.fixture(scope="module", params=[(0, 0.0), (1, 0.7)], ids=lambda param: f"{param[1]} rad from the tip")
def pressed_inside(request, inside, generate):
    """MuJoCo's and gelsim's own image and label of that ball, so far from the tip over the gel."""
    number, lean = request.param
    shard = generate(Mesh().turn(ball(0.0005, numpy.pi - 0.0005, 360, 0)), f"""
sensor = {{ preset = "geltip" }}
pose.from_tip_mm = {11.485 * lean}
indentation.depth_mm = 0.8
camera.read_noise_levels = 0.0
output = {{ layers = ["depth"], container = "folder" }}
""")
    files = [(inside / f"{number}.tactile.png", inside / f"{number}.json")]
    files += zip(shard.glob("*.tactile.png"), shard.glob("*.json"))
    return [(picture(image), json.loads(label.read_text())) for image, label in files]


def test_a_ball_seen_from_inside_a_gel_looks_as_gelsims_own(pressed_inside):
    (found, _), (expected, _) = pressed_inside
    away = numpy.abs(found - expected).max(axis=2)
    print(f"{away.max()} levels, {(away > LEVELS).sum()} px over {LEVELS}")
    assert (away > LEVELS).sum() <= 50 and away.max() <= 12


def test_a_ball_seen_from_inside_a_gel_is_pressed_as_hard_as_gelsims_own(pressed_inside):
    force, own = (label["contact"]["force_n"] for _, label in pressed_inside)
    print(f"force {force / own:.4f}")
    assert abs(force / own - 1) < 0.01


def test_all_of_a_ball_is_seen_from_inside_a_gel(pressed_inside):
    (_, label), _ = pressed_inside
    assert label["health"]["unseen_px"] == 0


def test_a_ball_shows_in_the_image_from_inside_a_gel(pressed_inside, folder):
    """Against the image of a frame that shows nothing."""
    numpy.save(folder / "nothing.npy", numpy.full((240, 320), numpy.inf))
    command = "gelsim render --depth nothing.npy --depth-unit mm --no-contact-ok --sensor geltip --out rest --quiet"
    run(*command.split(), *QUIET, cwd=folder)
    _, (expected, _) = pressed_inside
    assert numpy.ptp(expected - picture(folder / "rest/nothing.tactile.png")) > 10


@pytest.fixture(scope="module")
def slide(render_frames):
    """A ball that is pressed, then pushed along x until all of it slips: each frame's label, and its force in N."""
    out = render_frames('"slide.csv"', "slid")
    rows = [json.loads((out / f"{k:02}.json").read_text())["frame"] for k in range(24)]
    return rows, numpy.array([row["wrench"]["force_n"] for row in rows])


def test_the_press_before_a_slide_grows_and_has_no_shear(slide):
    _, forces = slide
    assert numpy.abs(forces[:8, :2]).max() < 1e-3 * -forces[7, 2] and (numpy.diff(-forces[:8, 2]) > 0).all()


def test_a_slide_ends_in_gross_slip_at_the_forces_of_friction(slide):
    rows, forces = slide
    print(f"{forces[-1, 0]:.4f} N of {-0.3 * forces[-1, 2]:.4f}")
    assert rows[-1]["slip"]["state"] == "gross" and abs(forces[-1, 0] / (-0.3 * forces[-1, 2]) - 1) < 0.02


def test_a_streams_images_are_those_of_the_files(project, pressed, folder):
    page = project / "docs/how-to/streams.md"
    found = [code for code in snippets(page) if "def tactile" in code]
    assert len(found) == 1, f"{page} has no script with images, or several"
    run(sys.executable, "-c", found[0] + "\nnumpy.save('images.npy', images)\nassert touch.wait() == 0\n", cwd=folder)
    images = numpy.load(folder / "images.npy")
    assert len(images) == 2
    for number, image in enumerate(images):
        assert (image == picture(pressed / f"{number}.tactile.png")).all(), number


def test_a_stream_without_a_resolution_has_the_frames(pressed, folder):
    command = "gelsim render --stream --depth-unit m --plane-mm 10 --sensor gelsight-2014 --quiet"
    frame = (folder / "frames/0.npy").read_bytes()
    done = run(*command.split(), input=frame, text=False)
    assert len(done.stdout) == 128 + 3 * WIDTH * HEIGHT
