"""Fits the light of sensor presets to images of real sensors, and prints what a sensor file takes.

    python tests/presets/fit.py GELSIM PRESET --pads PAD.png .. --presses PRESSES.csv --background BACKGROUND.png

PAD.png are images of untouched pads, one for each unit: from them come the mean colour, the pattern and how much units differ.
PRESSES.csv is a table as `gelsim calibrate` takes it, with the background of the unit that was pressed: from them come LEDs and
stray light, what these leave unexplained, the camera's noise, and on which side each channel brightens. Every second press is fitted; the error is that of
the others, over that background. Needs numpy and Pillow.
"""

import argparse
import csv
import json
import re
import subprocess
import tempfile
from pathlib import Path

import numpy
from PIL import Image

DEGREES = [(i, j) for i in range(5) for j in range(5 - i)]
CHANNELS = "red", "green", "blue"
COLUMNS = "file", "centre_x_px", "centre_y_px", "radius_px", "ball_radius_mm", "mm_per_px"


def read(path):
    return numpy.asarray(Image.open(path).convert("RGB"), dtype=float)


def pattern(path):
    """The mean colour of a pad, the pattern's coefficients for each channel, and what they leave, in grey levels."""
    pad = read(path)
    height, width, _ = pad.shape
    y, x = numpy.mgrid[:height, :width]
    x, y = 2 * (x + 0.5) / width - 1, 2 * (y + 0.5) / height - 1
    terms = numpy.stack([(x**i * y**j).ravel() for i, j in DEGREES], axis=1)
    means = pad.mean(axis=(0, 1))
    values = pad.reshape(-1, 3) / means
    coefficients, *_ = numpy.linalg.lstsq(terms, values, rcond=None)
    left = numpy.sqrt((((terms @ coefficients - values) * means) ** 2).mean(axis=0))
    return means, coefficients.T, left


class Press:
    """An image and the disc that is seen in it."""

    def __init__(self, row, folder):
        self.file = (folder / row["file"]).resolve()
        self.row = {**row, "file": self.file}
        self.image = read(self.file)
        height, width, _ = self.image.shape
        y, x = numpy.mgrid[:height, :width] + 0.5
        self.radius = float(row["radius_px"])
        self.x, self.y = (x - float(row["centre_x_px"])) / self.radius, (y - float(row["centre_y_px"])) / self.radius
        self.away = numpy.hypot(self.x, self.y)


def brightening(presses, background):
    """Direction in which each channel brightens over the discs, degrees, and its change at the rim, grey levels."""
    slopes = []
    for press in presses:
        disc = press.away <= 1
        terms = numpy.stack([numpy.ones(disc.sum()), press.x[disc], press.y[disc]], axis=1)
        slopes.append(numpy.linalg.lstsq(terms, (press.image - background)[disc], rcond=None)[0][1:])
    x, y = numpy.mean(slopes, axis=0)
    return numpy.degrees(numpy.arctan2(y, x)), numpy.hypot(x, y)


def rough(image):
    """What an image has beyond its mean over 9 x 9 pixels."""
    sums = numpy.pad(image, ((5, 4), (5, 4), (0, 0)), mode="reflect").cumsum(axis=0).cumsum(axis=1)
    return image - (sums[9:, 9:] - sums[:-9, 9:] - sums[9:, :-9] + sums[:-9, :-9]) / 81


def noise(presses):
    """Of each channel, as medians over presses: standard deviation of the noise and correlation of neighbours along rows, from
    one press to the next, far from both; and the standard deviation that the discs have beyond it."""
    images = [rough(press.image) for press in presses]
    still = numpy.median(images, axis=0)
    deviations, correlations, within = [], [], []
    for k in range(len(presses) - 1):
        difference = (images[k] - images[k + 1]) / numpy.sqrt(2)
        far = (presses[k].away > 2) & (presses[k + 1].away > 2)
        deviations.append(difference[far].std(axis=0))
        pairs = far[:, 1:] & far[:, :-1]
        products = (difference[:, 1:] * difference[:, :-1])[pairs]
        correlations.append(products.mean(axis=0) / deviations[-1] ** 2)
    for press, image in zip(presses, images):
        within.append((image - still)[press.away < 0.75].std(axis=0))
    deviation, correlation, within = (numpy.median(values, axis=0) for values in (deviations, correlations, within))
    return deviation, correlation, numpy.sqrt(numpy.maximum(within**2 - deviation**2, 0))


def terms(normals, heights_mm):
    """What a sensor's [light_residual] is a sum of."""
    x, y, w = normals[..., 0], normals[..., 1], heights_mm
    return numpy.stack([y, x, y**2, x * y, x**2, y**3, x * y**2, x**2 * y, x**3, w, w * y, w * x], axis=-1)


def residual(presses, surfaces, shown, background, stray):
    """What the LEDs leave unexplained within the discs dilated by 1.5, by least squares."""
    normals = [numpy.load(surfaces / f"{number:09d}.normal.npy") for number in range(len(presses))]
    heights = [numpy.load(surfaces / f"{number:09d}.surface.npy") for number in range(len(presses))]
    near = [press.away <= 1.5 for press in presses]
    steepest = max(numpy.hypot(normal[mask][:, 0], normal[mask][:, 1]).max() for normal, mask in zip(normals, near))
    lowest, highest = min(mm.min() for mm in heights), max(mm.max() for mm in heights)
    left = [(press.image - read(shown / press.file.name))[mask] / 255 for press, mask in zip(presses, near)]
    every = numpy.concatenate([terms(normal[mask], mm[mask]) for normal, mm, mask in zip(normals, heights, near)])
    lit = numpy.concatenate([numpy.maximum(background[mask] / 255 - stray, 0) for mask in near])
    left = numpy.concatenate(left)
    lines = [f"steepest = {steepest:.3f}", f"heights_mm = [{lowest:.3f}, {highest:.3f}]"]
    for channel, name in enumerate(CHANNELS):
        scaled = every * lit[:, channel : channel + 1]
        sizes = numpy.sqrt((scaled**2).mean(axis=0))
        # A little of what keeps terms small that the presses hardly determine.
        products = (scaled / sizes).T @ (scaled / sizes) / len(scaled) + 1e-3 * numpy.eye(len(sizes))
        found = numpy.linalg.solve(products, (scaled / sizes).T @ left[:, channel] / len(scaled)) / sizes
        lines.append(f"{name} = {(found.round(3) + 0.0).tolist()}")
    return "[light_residual]\n" + "\n".join(lines) + "\n"


def write(table, presses):
    with open(table, "w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, extrasaction="ignore")
        writer.writeheader()
        writer.writerows(press.row for press in presses)


def run(*command):
    result = subprocess.run([str(part) for part in command], capture_output=True, text=True)
    if result.returncode != 0:
        raise SystemExit(result.stderr)
    return result.stdout


def error(gelsim, presses, sensor, shown, contact):
    """MAE over the discs dilated by 1.3."""
    said = run(gelsim, "calibrate", "--evaluate", presses, "--sensor", sensor, "--out", shown, *contact)
    return float(re.search(r"^mean of \d+\s+([\d.]+)", said, re.MULTILINE)[1])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("gelsim")
    parser.add_argument("preset")
    parser.add_argument("--pads", nargs="+", required=True)
    parser.add_argument("--presses", required=True)
    parser.add_argument("--background", required=True)
    parser.add_argument("--contact-over-disc", help="radius of the contact over that of the visible disc; 0.95 if left out")
    parser.add_argument("--thickness-mm", help="of the gelpad; the preset's if left out")
    given = parser.parse_args()

    pads = [pattern(path) for path in given.pads]
    means = numpy.array([pad[0] for pad in pads])
    coefficients = numpy.array([pad[1] for pad in pads])
    background = read(given.background)
    with open(given.presses, newline="") as file:
        presses = [Press(row, Path(given.presses).parent) for row in csv.DictReader(file)]
    fitted, tested = presses[::2], presses[1::2]
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        write(folder / "fitted.csv", fitted)
        write(folder / "tested.csv", tested)
        sensor, preset = folder / "sensor.toml", folder / "preset.toml"
        common = "--background", given.background, "--sensor", given.preset
        surfaces = folder / "surfaces"
        contact = ("--contact-over-disc", given.contact_over_disc) if given.contact_over_disc else ()
        thickness = ("--thickness-mm", given.thickness_mm) if given.thickness_mm else ()
        fit = run(given.gelsim, "calibrate", "--leds", folder / "fitted.csv", *common, *contact, *thickness, "--surfaces", surfaces, "--out", sensor)
        print(fit, end="")
        leds_alone = error(given.gelsim, folder / "tested.csv", sensor, folder / "leds", contact)
        error(given.gelsim, folder / "fitted.csv", sensor, folder / "left", contact)
        stray = numpy.array(json.loads(re.search(r"^stray_light = (.*)", sensor.read_text(), re.MULTILINE)[1]))
        rest = residual(fitted, surfaces, folder / "left", background, stray)
        sensor.write_text(sensor.read_text() + "\n" + rest)
        height, width, _ = background.shape
        preset.write_text(
            f'preset = "{given.preset}"\nbackground = "{Path(given.background).resolve()}"\nresolution_px = [{width}, {height}]\n'
        )
        by_fit = error(given.gelsim, folder / "tested.csv", sensor, folder / "fitted", contact)
        by_preset = error(given.gelsim, folder / "tested.csv", preset, folder / "preset", contact)
        text = sensor.read_text()
    nothing = numpy.mean([numpy.abs(press.image - background)[press.away <= 1.3].mean() for press in tested])
    print(f"MAE in the contact of {len(tested)} presses that were not fitted, grey levels: {by_fit:.1f}", end="")
    print(f"; LEDs alone {leds_alone:.1f}; the preset as it is {by_preset:.1f}; nothing pressed {nothing:.1f}")
    for name, direction, change in zip(CHANNELS, *brightening(presses, background)):
        print(f"{name} brightens towards {direction:.0f} degrees, by {change:.0f} grey levels at the rim")
    for name, deviation, correlation, speckle in zip(CHANNELS, *noise(presses)):
        print(f"{name} noise {deviation:.1f} grey levels, neighbours {correlation:.2f}; in contact {speckle:.1f} more")
    print(f"mean colour of {len(pads)} pads: {means.mean(axis=0).round(1)}, of each: {means.round(1).tolist()}")
    print(f"the pattern leaves {[pad[2].round(1).tolist() for pad in pads]} grey levels")
    if len(pads) > 1:
        print(f"largest spread of a coefficient between units: {coefficients.std(axis=0, ddof=1).max(axis=1).round(2)}")

    print(re.search(r"^stray_light = .*", text, re.MULTILINE)[0])
    print(f"\n[rendered_background]\ncolor = {(means.mean(axis=0) / 255).round(3).tolist()}")
    print("\n[rendered_background.pattern]")
    for name, line in zip(CHANNELS, coefficients.mean(axis=0)):
        print(f"{name} = {(line.round(3) + 0.0).tolist()}")
    for led in re.findall(r"^\[\[led\]\]\n(?:\w.*\n)+", text, re.MULTILINE):
        print("\n" + led.strip())
    print("\n" + rest, end="")


main()
