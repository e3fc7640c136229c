"""Fits the light of sensor presets to images of real sensors, and prints what a sensor file takes.

    python tests/presets/fit.py GELSIM PRESET --pads PAD.png .. --presses PRESSES.csv --background BACKGROUND.png

PAD.png are images of untouched pads, one for each unit: from them come the mean colour, the pattern and how much units differ.
PRESSES.csv is a table as `gelsim calibrate` takes it, with the background of the unit that was pressed: from them come LEDs and
stray light. Every second press is fitted; the error is that of the others, over that background. Needs numpy and Pillow.
"""

import argparse
import csv
import re
import subprocess
import tempfile
from pathlib import Path

import numpy
from PIL import Image

DEGREES = [(i, j) for i in range(5) for j in range(5 - i)]
CHANNELS = "red", "green", "blue"
COLUMNS = "file", "centre_x_px", "centre_y_px", "radius_px", "ball_radius_mm", "mm_per_px"


def pattern(path):
    """The mean colour of a pad, the pattern's coefficients for each channel, and what they leave, in grey levels."""
    pad = numpy.asarray(Image.open(path).convert("RGB"), dtype=float)
    height, width, _ = pad.shape
    y, x = numpy.mgrid[:height, :width]
    x, y = 2 * (x + 0.5) / width - 1, 2 * (y + 0.5) / height - 1
    terms = numpy.stack([(x**i * y**j).ravel() for i, j in DEGREES], axis=1)
    means = pad.mean(axis=(0, 1))
    values = pad.reshape(-1, 3) / means
    coefficients, *_ = numpy.linalg.lstsq(terms, values, rcond=None)
    left = numpy.sqrt((((terms @ coefficients - values) * means) ** 2).mean(axis=0))
    return means, coefficients.T, left


def halves(table, folder):
    """The rows to fit and the rows to test on, as two tables."""
    with open(table, newline="") as file:
        rows = list(csv.DictReader(file))
    names = []
    for part, name in enumerate(("fit.csv", "test.csv")):
        names.append(folder / name)
        with open(names[-1], "w", newline="") as file:
            writer = csv.DictWriter(file, COLUMNS, extrasaction="ignore")
            writer.writeheader()
            for row in rows[part::2]:
                writer.writerow({**row, "file": (Path(table).parent / row["file"]).resolve()})
    return names


def run(*command):
    result = subprocess.run([str(part) for part in command], capture_output=True, text=True)
    if result.returncode != 0:
        raise SystemExit(result.stderr)
    return result.stdout


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("gelsim")
    parser.add_argument("preset")
    parser.add_argument("--pads", nargs="+", required=True)
    parser.add_argument("--presses", required=True)
    parser.add_argument("--background", required=True)
    given = parser.parse_args()

    pads = [pattern(path) for path in given.pads]
    means = numpy.array([pad[0] for pad in pads])
    coefficients = numpy.array([pad[1] for pad in pads])
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        fitted, tested = halves(given.presses, folder)
        sensor = folder / "sensor.toml"
        common = "--background", given.background, "--sensor", given.preset
        print(run(given.gelsim, "calibrate", "--leds", fitted, *common, "--out", sensor), end="")
        errors = {}
        for name, of in (("fitted LEDs", sensor), ("preset as it is", folder / "old.toml")):
            if name == "preset as it is":
                text = f'preset = "{given.preset}"\nbackground = "{Path(given.background).resolve()}"\n'
                size = Image.open(given.background).size
                of.write_text(text + f"resolution_px = [{size[0]}, {size[1]}]\n")
            shown = run(given.gelsim, "calibrate", "--evaluate", tested, "--sensor", of, "--out", folder / "shown")
            errors[name] = re.search(r"^mean of \d+\s+([\d.]+)", shown, re.MULTILINE)[1]
        text = sensor.read_text()
    print("MAE in the contact of presses that were not fitted, grey levels: " + str(errors))
    spread = coefficients.std(axis=0, ddof=1) if len(pads) > 1 else None
    print(f"mean colour of {len(pads)} pads: {means.mean(axis=0).round(1)}, of each: {means.round(1).tolist()}")
    print(f"the pattern leaves {[pad[2].round(1).tolist() for pad in pads]} grey levels")
    if spread is not None:
        print(f"largest spread of a coefficient between units: {spread.max(axis=1).round(2)}")

    print(re.search(r"^stray_light = .*", text, re.MULTILINE)[0])
    print(f"\n[rendered_background]\ncolor = {(means.mean(axis=0) / 255).round(3).tolist()}")
    print("\n[rendered_background.pattern]")
    for name, line in zip(CHANNELS, coefficients.mean(axis=0)):
        print(f"{name} = {(line.round(3) + 0.0).tolist()}")
    for led in re.findall(r"^\[\[led\]\]\n(?:\w.*\n)+", text, re.MULTILINE):
        print("\n" + led.strip())


main()
