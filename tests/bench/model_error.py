"""How well labels know the error of linear theory: `python tests/bench/model_error.py GELSIM [SEED...]`.

Renders samples of configs/quickstart.toml at 320x240 px at the levels `high` and `finite-strain`. The largest difference of their
surfaces within 2 mm outside both contacts is the error of linear theory; `numerics.model_error_um` of `high` should be within a
factor of two of it. Prints, by object, the share of samples in which it is, and quantiles of the label's error over the true one.
Errors under 1 um do not count, nor do samples in which finite strain was not solved for, or only with rounded edges, or in which the
label knows no error. Needs numpy; three minutes for a seed on two cores. The law was fitted to finite elements, and how it counts walls to seed 1.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
SAMPLES = 200
RING_MM = 2.0
SMALL_UM = 1.0
# A tenth of the pad's thickness. With more, finite strain misses the error beside walls.
MAX_ROUNDING_MM = 0.3
SETTINGS = [
    "sensor.resolution_px=[320, 240]",
    'output.layers=["surface", "gap"]',
    'output.depth_format="npy"',
    'output.container="folder"',
]


def render(program, seed, level, out):
    """The samples' folders by key."""
    command = [program, "generate", str(ROOT / "configs/quickstart.toml"), "--quiet", "--samples", str(SAMPLES)]
    command += ["--seed", str(seed), "--fidelity", level, "--out", str(out)]
    for setting in SETTINGS:
        command += ["--set", setting]
    subprocess.run(command, check=True)
    return {path.stem: path.parent for path in sorted(out.glob("data/*/*.json"))}


def grown(mask, mm_per_px):
    """The pixels within the ring's width of the mask."""
    height, width = mask.shape
    near = np.zeros_like(mask)
    rows = int(RING_MM / mm_per_px[1])
    for down in range(-rows, rows + 1):
        across = int(np.sqrt(RING_MM**2 - (down * mm_per_px[1]) ** 2) / mm_per_px[0])
        sums = np.zeros((height, width + 2 * across + 1), np.int32)
        sums[:, across + 1 : across + 1 + width] = mask.cumsum(axis=1)
        sums[:, across + 1 + width :] = sums[:, across + width, None]
        row = sums[:, 2 * across + 1 :] > sums[:, :width]
        source = row[max(0, -down) : height - max(0, down)]
        near[max(0, down) : max(0, down) + len(source)] |= source
    return near


def layer(folder, key, name):
    return np.squeeze(np.load(folder / f"{key}.{name}.npy"))


def compare(program, seed, folder):
    """Of each sample that counts: object, true and stated error, um."""
    linear, exact = (render(program, seed, level, Path(folder) / level) for level in ("high", "finite-strain"))
    found, left_out = [], 0
    for key, place in linear.items():
        own, true = (json.loads((at[key] / f"{key}.json").read_text()) for at in (linear, exact))
        if not own["contact"]["in_contact"]:
            continue
        stated = own["numerics"]["model_error_um"]
        numerics = true["numerics"]
        if numerics["theory"] != "finite_strain" or numerics["opened_mm"] > MAX_ROUNDING_MM or stated is None:
            left_out += 1
            continue
        surfaces = [layer(at[key], key, "surface") for at in (linear, exact)]
        # There is no gap where the pad touches.
        touching = (layer(place, key, "gap") == 0) | (layer(exact[key], key, "gap") == 0)
        mm_per_px = own["sensor"]["mm_per_px"]
        ring = grown(touching, mm_per_px) & ~touching
        largest = 1e3 * float(np.abs(surfaces[0] - surfaces[1])[ring].max(initial=0.0))
        found.append((own["object"]["id"], largest, stated, key))
    return found, left_out


def line(name, pairs):
    counted = np.array([(true, stated) for true, stated in pairs if max(true, 0.5 * stated) >= SMALL_UM])
    if not len(counted):
        return f"{name:12} no error of {SMALL_UM} um"
    ratio = counted[:, 1] / counted[:, 0]
    within = 100 * np.mean((ratio >= 0.5) & (ratio <= 2.0))
    quantiles = " ".join(f"{value:6.2f}" for value in np.quantile(ratio, [0, 0.05, 0.25, 0.5, 0.75, 0.95, 1]))
    return f"{name:12} {len(counted):4} {within:6.1f} % {quantiles} {np.median(counted[:, 0]):7.1f} um"


def main():
    program, *seeds = sys.argv[1:]
    for seed in seeds or ["2"]:
        with tempfile.TemporaryDirectory() as folder:
            found, left_out = compare(program, seed, folder)
        print(f"seed {seed}: stated over true error; {left_out} samples left out")
        print("object       count within 2    min    5 %   25 %   50 %   75 %   95 %    max  median of the true error")
        for name in sorted({name for name, *_ in found}):
            print(line(name, [(true, stated) for of, true, stated, _ in found if of == name]))
        print(line("all", [(true, stated) for _, true, stated, _ in found]), flush=True)


if __name__ == "__main__":
    main()
