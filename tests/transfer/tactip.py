"""Reads a TacTip's pose off real pictures with a regression that saw simulated ones only.

    python tests/transfer/tactip.py GELSIM --real FOLDER [--samples 2500]

FOLDER holds surface_3d_tap.npz and edge_2d_tap.npz, and if there are surface_3d_shear.npz and edge_2d_shear.npz: `images`,
packed bits of binarised pictures, their `shape`, and `pose`: x, y, z (mm), roll, pitch, yaw (degrees). `gelsim` makes the
simulated pictures from configs/tactip-surface.toml and configs/tactip-edge.toml; their labels are taken from the pose's
quaternion and translation. The regression is ridge on pictures blurred by 1.5 px and taken at 32x32, each set without its
mean picture. Beside it the same regression trained on three quarters of the real pictures and tested on the rest, and what
guessing the mean gives. Needs numpy, scipy and Pillow. docs/evidence/transfer.md.
"""

import argparse
import io
import json
import subprocess
import tarfile
import tempfile
from pathlib import Path

import numpy
from PIL import Image
from scipy import ndimage

CONFIGS = Path(__file__).resolve().parents[2] / "configs"
BLUR_PX = 1.5
RIDGES = (0.3, 3.0, 30.0)
# Pixels outside this circle show the mount, not the skin.
KEPT_PX = 50.0
# What the same regression reaches with 3,000 real pictures of each set, tested on others of that unit.
REAL = {"surface": [0.08, 1.0, 0.9], "edge": [0.71, 10.0]}
NAMES = {"surface": ["depth mm", "roll deg", "pitch deg"], "edge": ["distance mm", "yaw deg"]}
# The robot moved the sensor along the surface before the picture.
SHEARED = ["--set", "shear.x_mm=[-5.0,5.0]", "--set", "shear.y_mm=[-5.0,5.0]", "--set", "shear.twist_deg=[-5.0,5.0]"]
# What is wanted.
AT_MOST = {"surface_tap": 3.0, "edge_tap": 2.0, "surface_shear": 4.0, "edge_shear": 4.0}


def features(images):
    """Blurred, taken at every fourth pixel, without the mean of the set."""
    y, x = numpy.mgrid[0:128, 0:128]
    inside = numpy.hypot(x - 63.5, y - 63.5) < KEPT_PX
    blurred = ndimage.gaussian_filter(numpy.where(inside, images, 0).astype(numpy.float32), (0, BLUR_PX, BLUR_PX))
    flat = blurred[:, ::4, ::4].reshape(len(images), -1).astype(float)
    return flat - flat.mean(0)


def ridge(inputs, targets, strength):
    mean = targets.mean(0)
    values, vectors = numpy.linalg.eigh(inputs.T @ inputs)
    weights = vectors @ ((vectors.T @ (inputs.T @ (targets - mean))) / (numpy.maximum(values, 0) + strength)[:, None])
    return lambda inputs: inputs @ weights + mean


def targets(kind, values):
    """What is regressed: an angle as cosine and sine."""
    if kind == "surface":
        return values
    yaw = numpy.radians(values[:, 1])
    return numpy.column_stack([values[:, 0], numpy.cos(yaw), numpy.sin(yaw)])


def errors(kind, found, known):
    """Mean absolute errors."""
    if kind == "surface":
        return numpy.abs(found - known).mean(0)
    yaw = numpy.degrees(numpy.arctan2(found[:, 2], found[:, 1])) - known[:, 1]
    return numpy.array([numpy.abs(found[:, 0] - known[:, 0]).mean(), numpy.abs((yaw + 180) % 360 - 180).mean()])


def real(path, kind):
    """Pictures, and depth, roll, pitch or distance from the edge, yaw."""
    data = numpy.load(path)
    images = numpy.unpackbits(data["images"])[: numpy.prod(data["shape"])].reshape(data["shape"])
    pose = data["pose"]
    return images, pose[:, [2, 3, 4]] if kind == "surface" else pose[:, [1, 5]]


def rotation(quaternion):
    x, y, z, w = quaternion
    return numpy.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])


def pose(label, kind):
    """The robots' quantities from the label's pose: p = R q + t takes the mesh to the sensor."""
    turn, place = rotation(label["pose"]["quaternion_xyzw"]), numpy.array(label["pose"]["translation_mm"])
    if kind == "surface":
        # The contact face is the mesh's plane z = 0.
        normal = turn[:, 2]
        depth = -place @ normal / normal[2]
        return [depth, numpy.degrees(numpy.arctan2(normal[1], normal[2])), -numpy.degrees(numpy.arctan2(normal[0], normal[2]))]
    # The edge is the mesh's x axis; the slab lies towards its y.
    into = turn[:, 1]
    return [-place @ into, numpy.degrees(numpy.arctan2(into[0], into[1]))]


def simulated(gelsim, kind, samples, folder, options):
    out = Path(folder) / kind
    command = [gelsim, "generate", CONFIGS / f"tactip-{kind}.toml", "--out", out, "--quiet", "--overwrite"]
    subprocess.run([*command, "--samples", str(samples), *options], check=True)
    images, values = [], []
    for shard in sorted((out / "data").glob("*.tar")):
        with tarfile.open(shard) as tar:
            for member in tar:
                if member.name.endswith(".tactile.png"):
                    image = Image.open(io.BytesIO(tar.extractfile(member).read())).convert("L")
                    images.append(numpy.asarray(image) > 127)
                elif member.name.endswith("0.json") or member.name[-6:-5].isdigit():
                    values.append(pose(json.load(tar.extractfile(member)), kind))
    return numpy.array(images), numpy.array(values)


def line(name, kind, found, beside):
    """Prints errors, and the largest ratio to those of others."""
    ratio = max(found / beside)
    cells = "  ".join(f"{what} {value:6.2f}" for what, value in zip(NAMES[kind], found))
    print(f"  {name:34} {cells}   {ratio:5.2f}", flush=True)
    return ratio


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("gelsim")
    parser.add_argument("--real", type=Path, required=True)
    parser.add_argument("--samples", type=int, default=2500)
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="passed on to gelsim generate")
    given = parser.parse_args()
    options = [word for value in given.set for word in ("--set", value)]
    with tempfile.TemporaryDirectory() as folder:
        for kind in ("surface", "edge"):
            for motion in ("tap", "shear"):
                path = given.real / f"{kind}_{'3d' if kind == 'surface' else '2d'}_{motion}.npz"
                if not path.exists():
                    print(f"{path} is not there: skipped")
                    continue
                moved = SHEARED if motion == "shear" else []
                images, values = simulated(given.gelsim, kind, given.samples, folder, moved + options)
                inputs, wanted = features(images), targets(kind, values)
                models = {strength: ridge(inputs, wanted, strength) for strength in RIDGES}
                pictures, known = real(path, kind)
                shown, aims = features(pictures), targets(kind, known)
                fold = numpy.arange(len(pictures)) % 4
                own = []
                for k in range(4):
                    model = ridge(shown[fold != k], aims[fold != k], 0.3)
                    own.append(errors(kind, model(shown[fold == k]), known[fold == k]))
                own = numpy.mean(own, 0)
                # Of moved presses nobody trained on 3,000.
                beside = numpy.array(REAL[kind]) if motion == "tap" else own
                said = "3,000" if motion == "tap" else f"{len(pictures) * 3 // 4}"
                print(f"{kind}, {motion}: {len(pictures)} real pictures; last, times the error when trained on {said} real ones")
                # Half of the pictures choose the strength and the robot's zero, the others are tested on; then the other way.
                halves = numpy.arange(len(pictures)) % 2
                totals = []
                for tested in (0, 1):
                    chosen = None
                    for strength, model in models.items():
                        found = model(shown)
                        if kind == "surface":
                            zero = (aims - found)[halves != tested][:, 0].mean()
                            found = found + [zero, 0, 0]
                        off = errors(kind, found[halves != tested], known[halves != tested])
                        worst = max(off / REAL[kind])
                        if chosen is None or worst < chosen[0]:
                            chosen = worst, errors(kind, found[halves == tested], known[halves == tested])
                    totals.append(chosen[1])
                ratio = line(f"trained on {len(images)} simulated", kind, numpy.mean(totals, 0), beside)
                line(f"trained on {len(pictures) * 3 // 4} real of this set", kind, own, beside)
                mean = numpy.repeat(aims.mean(0)[None], len(aims), 0)
                line("guessing the mean", kind, errors(kind, mean, known), beside)
                wanted_ratio = AT_MOST[f"{kind}_{motion}"]
                print(f"  {'as wanted' if ratio <= wanted_ratio else 'MISSED'}: at most {wanted_ratio} times")


if __name__ == "__main__":
    main()
