"""Compares what two builds of gelsim write: python same_bytes.py OLD_GELSIM NEW_GELSIM [--samples N]

Datasets of every bundled job at every fidelity level, in every format, with all effects; rendered depth frames; an
augmented set. Of the statistics, times are left out. Prints what differs; exit status 1 if anything does.
"""

import argparse
import json
import struct
import subprocess
import sys
import tempfile
from pathlib import Path

CONFIGS = Path(__file__).resolve().parents[2] / "configs"
JOBS = ["quickstart", "elementary", "effects", "randomized"]
LEVELS = ["paper", "draft", "standard", "high", "reference"]
EVERY_LAYER = 'output.layers=["depth","surface","contact","normal","pressure","reference"]'


def run(gelsim, *arguments):
    done = subprocess.run([gelsim, *map(str, arguments)], capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"{gelsim} {' '.join(map(str, arguments))}: {done.stderr}")


def frames(folder):
    """A ball, a slope, a wall and nothing, as npy files of heights over the camera's plane."""
    width, height = 96, 72
    shapes = {
        "ball": lambda x, y: 9.2 + 4.0 - max(16.0 - x * x - y * y, 0.0) ** 0.5 if x * x + y * y < 16.0 else 20.0,
        "slope": lambda x, y: 9.6 + 0.05 * x + 0.02 * y,
        "wall": lambda x, y: 9.3 if x > 1.0 else 15.0,
        "nothing": lambda x, y: 15.0,
    }
    for name, shape in shapes.items():
        points = [((i + 0.5 - width / 2) * 0.2, (j + 0.5 - height / 2) * 0.2) for j in range(height) for i in range(width)]
        header = f"{{'descr': '<f4', 'fortran_order': False, 'shape': ({height}, {width}), }}"
        header += " " * (-(len(header) + 11) % 64) + "\n"
        data = struct.pack(f"<{width * height}f", *(shape(x, y) for x, y in points))
        start = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header))
        (folder / f"{name}.npy").write_bytes(start + header.encode() + data)
    return sorted(folder.glob("*.npy"))


def without_times(value):
    if isinstance(value, dict):
        return {key: without_times(item) for key, item in value.items() if "second" not in key}
    return [without_times(item) for item in value] if isinstance(value, list) else value


def content(path):
    data = path.read_bytes()
    return without_times(json.loads(data)) if path.parent.name == "stats" else data


def differences(old, new):
    files = {path.relative_to(root) for root in (old, new) for path in root.rglob("*") if path.is_file()}
    for file in sorted(files):
        if file.name == "report.html":
            continue
        sides = [root / file for root in (old, new)]
        missing = [str(side) for side in sides if not side.exists()]
        if missing:
            yield f"{missing[0]} is not there"
        elif content(sides[0]) != content(sides[1]):
            yield f"{file} differs"


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("old")
    parser.add_argument("new")
    parser.add_argument("--samples", type=int, default=8)
    arguments = parser.parse_args()
    cases = {}
    for job in JOBS:
        path = CONFIGS / f"{job}.toml"
        base = ["generate", path, "--quiet", "--samples"]
        cases[f"{job} as it is"] = [*base, 3 * arguments.samples]
        for level in LEVELS:
            layers = EVERY_LAYER.replace('"pressure",', "") if level == "paper" else EVERY_LAYER
            cases[f"{job} at {level}"] = [*base, arguments.samples, "--fidelity", level, "--set", layers]
        cases[f"{job}, all effects"] = [*base, arguments.samples, "--all-effects"]
    base = ["generate", CONFIGS / "quickstart.toml", "--quiet", "--samples", arguments.samples]
    for form in ["npy", "png16"]:
        cases[f"layers as {form}"] = [*base, "--set", EVERY_LAYER, "--set", f'output.depth_format="{form}"']
    cases["a folder"] = [*base, "--set", 'output.container="folder"']
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        (folder / "frames").mkdir()
        depth = ["--depth", *frames(folder / "frames"), "--depth-unit", "mm", "--plane-mm", "10"]
        for sensor in ["gelsight-2014", "gelsight-2017", "gelsight-mini", "digit"]:
            for level in ["paper", "standard", "high"]:
                layers = "depth,surface,contact,normal" + ("" if level == "paper" else ",pressure")
                cases[f"frames of {sensor} at {level}"] = [
                    "render", "--sensor", sensor, *depth, "--layers", layers, "--fidelity", level,
                    "--set", "camera.read_noise_levels=2.0", "--set", "camera.distortion_k1=0.05",
                ]  # fmt: skip
        different = 0
        for number, (name, command) in enumerate(cases.items()):
            outs = [folder / f"{number}-{side}" / "out" for side in ("old", "new")]
            for gelsim, out in zip((arguments.old, arguments.new), outs):
                out.parent.mkdir()
                run(gelsim, *command, "--out", out)
            found = list(differences(*outs))
            different += bool(found)
            print(f"{name}: {'the same' if not found else '; '.join(found[:5])}", flush=True)
        print(f"{len(cases)} cases, {different} differ")
        sys.exit(different > 0)


if __name__ == "__main__":
    main()
