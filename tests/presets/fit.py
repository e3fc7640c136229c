"""Fits the light of sensor presets to images of real sensors, and prints what a sensor file takes.

    python tests/presets/fit.py GELSIM PRESET --pads PAD.png .. --presses PRESSES.csv --background BACKGROUND.png

PAD.png are images of untouched pads, one for each unit: from them come the mean colour, the pattern and how much units differ.
PRESSES.csv is a table as `gelsim calibrate` takes it, with the background of the unit that was pressed: from them come the LEDs'
directions, stray light and how the light of each varies over the pad, what these leave unexplained, the camera's noise, and on which
side each channel brightens. Errors are those of presses that were not fitted: the table is parted in five, and each part is shown by
what was fitted to the others. What is printed at the end was fitted to all of them. Needs numpy and Pillow.
"""

import argparse
import csv
import re
import subprocess
import tempfile
import tomllib
from pathlib import Path

import numpy
from PIL import Image

DEGREES = [(i, j) for i in range(5) for j in range(5 - i)]
CHANNELS = "red", "green", "blue"
# Pixels up to this far from the middle of a disc, over its radius, are fitted, every STEP-th along rows and columns.
REACH, STEP = 1.5, 2
GREY = 100
RIDGE, HOLDING_BACK = 1e-4, 1e-2
PARTS = 5
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


class Pixels:
    """What is known of pixels around the contacts of presses."""

    def __init__(self, presses, surfaces, background, step):
        normals = [numpy.load(surfaces / f"{number:09d}.normal.npy") for number in range(len(presses))]
        heights = [numpy.load(surfaces / f"{number:09d}.surface.npy") for number in range(len(presses))]
        height, width, _ = background.shape
        grid = numpy.zeros((height, width), dtype=bool)
        grid[::step, ::step] = True
        self.masks = [(press.away <= REACH) & grid for press in presses]
        join = lambda planes: numpy.concatenate([plane[mask] for plane, mask in zip(planes, self.masks)])
        y, x = numpy.mgrid[:height, :width]
        self.normals, self.heights = join(normals), join(heights)
        self.x = join([2 * (x + 0.5) / width - 1] * len(presses))
        self.y = join([2 * (y + 0.5) / height - 1] * len(presses))
        self.background, self.images = join([background] * len(presses)) / 255, join([p.image for p in presses]) / 255

    def shown(self, images):
        return numpy.concatenate([image[mask] for image, mask in zip(images, self.masks)]) / 255

    def places(self):
        """What an LED's pattern is a sum of."""
        return pattern_terms(self.x, self.y)

    def residual_terms(self):
        """What a sensor's [light_residual] is a sum of."""
        x, y, w = self.normals[:, 0], self.normals[:, 1], self.heights
        even = [y, x, y**2, x * y, x**2, y**3, x * y**2, x**2 * y, x**3, w, w * y, w * x]
        return numpy.stack(even + [self.x * term for term in even] + [self.y * term for term in even], axis=-1)


def pattern_terms(x, y):
    return numpy.stack([numpy.ones_like(x), x, y, x**2, x * y, y**2], axis=-1)


# What a pattern is a sum of, all over the view.
EVERYWHERE = pattern_terms(*(plane.ravel() for plane in numpy.meshgrid(*[numpy.linspace(-1, 1, 9)] * 2)))


def least_squares(features, values, ridge, more=None):
    """Coefficients by least squares; `ridge` keeps those small that the presses hardly determine. `more` holds rows that are wished
    to be 0."""
    sizes = numpy.sqrt((features**2).mean(axis=0)) + 1e-9
    scaled = features / sizes
    products = scaled.T @ scaled / len(scaled) + numpy.diag(numpy.broadcast_to(ridge, len(sizes)))
    if more is not None:
        products += (more / sizes).T @ (more / sizes)
    return numpy.linalg.solve(products, scaled.T @ values / len(scaled)) / sizes


def fit_positive(lights, rest, values):
    """Coefficients of each LED's pattern in a channel. No pattern is below 0: Newton's steps on a penalty for that."""
    count = EVERYWHERE.shape[1]
    features = numpy.concatenate([*lights, rest], axis=1)
    of_leds = count * len(lights)
    ridge = numpy.where(numpy.arange(features.shape[1]) < of_leds, RIDGE, HOLDING_BACK)
    wished = None
    for _ in range(30):
        parts = least_squares(features, values, ridge, wished)[:of_leds].reshape(-1, count)
        below = [EVERYWHERE[EVERYWHERE @ part < 0] for part in parts]
        wished = numpy.zeros((sum(map(len, below)), features.shape[1]))
        ends = numpy.cumsum([len(places) for places in below])
        for k, (places, end) in enumerate(zip(below, ends)):
            wished[end - len(places) : end, k * count : (k + 1) * count] = places / 30
    return parts


def fit_patterns(pixels, lights, scales):
    """The light of each LED in each channel, a polynomial of the place that is nowhere below 0. `lights` is that of LEDs of strength
    1. The residual is fitted with them, and held back, so that the LEDs explain what they can."""
    count = lights.shape[1]
    found = numpy.zeros((count, 3, EVERYWHERE.shape[1]))
    varied = [lights[:, led : led + 1] * pixels.places() for led in range(count)]
    rest = pixels.residual_terms()
    for channel in range(3):
        scale = scales[:, channel : channel + 1]
        values = (pixels.images - pixels.background)[:, channel]
        shining, dark = list(range(count)), True
        while dark:
            parts = fit_positive([varied[led] * scale for led in shining], rest * scale, values)
            # An LED that a channel hardly sees is dark there.
            means = [(EVERYWHERE @ part).mean() for part in parts]
            dark = [led for led, mean in zip(shining, means) if mean < 0.03 * max(max(means), 1e-9)]
            if not dark:
                found[shining, channel] = parts
            shining = [led for led in shining if led not in dark]
    return found


def led_tables(leds, patterns):
    """LEDs as a sensor file has them."""
    text = ""
    for name, (azimuth, elevation), channels in zip(CHANNELS, leds, patterns):
        means = (channels @ EVERYWHERE.T).mean(axis=1)
        intensity = means.max()
        text += f'[[led]]\nname = "{name}"\nazimuth_deg = {azimuth}\nelevation_deg = {elevation}\n'
        text += "angular_size_deg = [40.0, 10.0]\ndistance_mm = 20.0\n"
        text += f"color = {(means / intensity).round(3).tolist()}\nintensity = {intensity:.3f}\n"
        for channel, terms, mean in zip(CHANNELS, channels, means):
            if mean > 0:
                text += f"pattern.{channel} = {((terms / mean).round(3) + 0.0).tolist()}\n"
        text += "\n"
    return text


def residual(pixels, shown, scales):
    """What the LEDs leave unexplained around the contacts, by least squares."""
    steepest = numpy.hypot(pixels.normals[:, 0], pixels.normals[:, 1]).max()
    lowest, highest = min(pixels.heights.min(), 0), max(pixels.heights.max(), 0)
    lines = [f"steepest = {steepest:.3f}", f"heights_mm = [{lowest:.3f}, {highest:.3f}]"]
    left, every = pixels.images - shown, pixels.residual_terms()
    for channel, name in enumerate(CHANNELS):
        found = least_squares(every * scales[:, channel : channel + 1], left[:, channel], RIDGE)
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
        raise SystemExit(" ".join(map(str, command)) + "\n" + result.stderr)
    return result.stdout


def show(gelsim, presses, table, sensor, shown, contact):
    """Images of presses as a sensor file has them."""
    write(table, presses)
    run(gelsim, "calibrate", "--evaluate", table, "--sensor", sensor, "--out", shown, "--keep-anyway", *contact)
    return [read(shown / press.file.name) for press in presses]


def errors(press, image, background):
    """Mean absolute error over the disc dilated by 1.3, and the slopes of each channel over the disc, in the image and in truth."""
    mask, disc = press.away <= 1.3, press.away <= 1
    terms = numpy.stack([numpy.ones(disc.sum()), press.x[disc], press.y[disc]], axis=1)
    slopes = [numpy.linalg.lstsq(terms, (own - background)[disc], rcond=None)[0][1:].T for own in (image, press.image)]
    return numpy.abs(image - press.image)[mask].mean(), *slopes


def summary(found):
    """Errors of presses in a line."""
    levels = numpy.mean([error for error, _, _ in found])
    shown, real = (numpy.array([each[k] for each in found]) for k in (1, 2))
    off = numpy.linalg.norm(shown - real, axis=2).mean() / numpy.linalg.norm(real, axis=2).mean()
    direction = lambda slopes: numpy.arctan2(slopes[..., 1], slopes[..., 0])
    turned = numpy.abs(numpy.degrees(numpy.angle(numpy.exp(1j * (direction(shown) - direction(real))))))
    turned = " ".join(f"{channel:.1f}" for channel in turned.mean(axis=0))
    return f"{levels:.2f} grey levels, colour slopes off by {100 * off:.0f} %, their directions by {turned} degrees"


def without(pattern, text):
    """A text without the lines that begin like this."""
    return re.sub("^" + pattern, "", text, flags=re.MULTILINE)


class Fit:
    """A sensor file whose light is fitted to presses."""

    def __init__(self, given, folder, presses, background, contact):
        self.table, self.sensor = folder / "fitted.csv", folder / "sensor.toml"
        write(self.table, presses)
        thickness = ("--thickness-mm", given.thickness_mm) if given.thickness_mm else ()
        common = "--background", given.background, "--sensor", given.preset, "--surfaces", folder / "surfaces"
        calibrate = given.gelsim, "calibrate", "--leds", self.table, *common, *contact, *thickness, "--out", self.sensor
        self.said = run(*calibrate, "--keep-anyway")
        written = self.sensor.read_text()
        leds = tomllib.loads(written)["led"]
        leds = [(led["azimuth_deg"], led["elevation_deg"]) for led in leds]
        self.stray = None if given.additive else numpy.array(tomllib.loads(written)["stray_light"]).round(3)
        rest = without(r"stray_light = .*\n", without(r"\[\[led\]\]\n(?:\w.*\n)+", written))
        self.stray_line = "" if given.additive else f"stray_light = {self.stray.tolist()}\n"
        pixels = Pixels(presses, folder / "surfaces", background, STEP)
        scales = numpy.ones_like(pixels.background) if given.additive else numpy.maximum(pixels.background - self.stray, 0)
        # An LED in each channel, over a pad that is grey: what the program shows holds the light of each, shadows among it.
        grey = folder / "grey.png"
        Image.fromarray(numpy.full(background.shape, GREY, dtype="uint8")).save(grey)
        plain = "".join(
            f"[[led]]\nazimuth_deg = {azimuth}\nelevation_deg = {elevation}\ncolor = {color}\n\n"
            for (azimuth, elevation), color in zip(leds, numpy.eye(3).tolist())
        )
        basis = folder / "basis.toml"
        basis.write_text(f'background = "{grey}"\n' + without(r"background(_sha256)? = .*\n", rest) + "\n" + plain)
        lit = show(given.gelsim, presses, folder / "shown.csv", basis, folder / "basis", contact)
        patterns = fit_patterns(pixels, pixels.shown(lit) - GREY / 255, scales)
        self.leds = led_tables(leds, patterns)
        self.sensor.write_text(self.stray_line + rest + "\n" + self.leds)
        shown = show(given.gelsim, presses, folder / "shown.csv", self.sensor, folder / "shown", contact)
        self.residual = residual(pixels, pixels.shown(shown), scales)
        self.sensor.write_text(self.sensor.read_text() + self.residual)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("gelsim")
    parser.add_argument("preset")
    parser.add_argument("--pads", nargs="+", required=True)
    parser.add_argument("--presses", required=True)
    parser.add_argument("--background", required=True)
    parser.add_argument("--contact-over-disc", help="radius of the contact over that of the visible disc; 0.95 if left out")
    parser.add_argument("--thickness-mm", help="of the gelpad; the preset's if left out")
    parser.add_argument("--additive", action="store_true", help="the LEDs' light does not follow the background")
    given = parser.parse_args()

    pads = [pattern(path) for path in given.pads]
    means = numpy.array([pad[0] for pad in pads])
    coefficients = numpy.array([pad[1] for pad in pads])
    background = read(given.background)
    with open(given.presses, newline="") as file:
        presses = [Press(row, Path(given.presses).parent) for row in csv.DictReader(file)]
    contact = ("--contact-over-disc", given.contact_over_disc) if given.contact_over_disc else ()
    height, width, _ = background.shape
    by_fit, by_preset = [], []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        preset = folder / "preset.toml"
        preset.write_text(
            f'preset = "{given.preset}"\nbackground = "{Path(given.background).resolve()}"\nresolution_px = [{width}, {height}]\n'
        )
        for part in range(PARTS):
            own = folder / str(part)
            own.mkdir()
            tested = presses[part::PARTS]
            fit = Fit(given, own, [press for k, press in enumerate(presses) if k % PARTS != part], background, contact)
            for sensor, found in ((fit.sensor, by_fit), (preset, by_preset)):
                images = show(given.gelsim, tested, own / "tested.csv", sensor, own / sensor.stem, contact)
                found.extend(errors(press, image, background) for press, image in zip(tested, images))
        own = folder / "all"
        own.mkdir()
        fit = Fit(given, own, presses, background, contact)
    print(fit.said, end="")
    nothing = numpy.mean([numpy.abs(press.image - background)[press.away <= 1.3].mean() for press in presses])
    print(f"{len(presses)} presses, each shown by what was fitted to others: {summary(by_fit)}")
    print(f"the preset as it is: {summary(by_preset)}; nothing pressed {nothing:.1f} grey levels")
    for name, direction, change in zip(CHANNELS, *brightening(presses, background)):
        print(f"{name} brightens towards {direction:.0f} degrees, by {change:.0f} grey levels at the rim")
    for name, deviation, correlation, speckle in zip(CHANNELS, *noise(presses)):
        print(f"{name} noise {deviation:.1f} grey levels, neighbours {correlation:.2f}; in contact {speckle:.1f} more")
    print(f"mean colour of {len(pads)} pads: {means.mean(axis=0).round(1)}, of each: {means.round(1).tolist()}")
    print(f"the pattern leaves {[pad[2].round(1).tolist() for pad in pads]} grey levels")
    if len(pads) > 1:
        print(f"largest spread of a coefficient between units: {coefficients.std(axis=0, ddof=1).max(axis=1).round(2)}")

    print(f"\n{fit.stray_line}", end="")
    print(f"\n[rendered_background]\ncolor = {(means.mean(axis=0) / 255).round(3).tolist()}")
    print("\n[rendered_background.pattern]")
    for name, line in zip(CHANNELS, coefficients.mean(axis=0)):
        print(f"{name} = {(line.round(3) + 0.0).tolist()}")
    print(f"\n{fit.leds}{fit.residual}", end="")


main()
