"""Does a paired set teach? Encoders pre-trained on simulated sensors, frozen, and read on a real sensor that none of them is.

    python tests/transfer/pretrain.py GELSIM --real FOLDER [--set NAME ..] [--shots 4 8] [--seeds 3]
    python tests/transfer/pretrain.py GELSIM --self-test

An encoder sees a whole image, the change of colour against the untouched pad in 16 x 16 blocks, through two hidden layers. It is
pre-trained to find a press under another sensor among other presses (contrast, InfoNCE), or also to tell the pad's surface
(and shape). With one sensor, or sensors that are not paired, the other view is the same image: all views get colours mixed at
random. All encoders have the same number of simulated images. Then a linear probe, and nothing else, reads the place of a ball off
the last hidden layer: ridge regression on a few real presses, its strength by leaving one of them out; tested on the
others. FOLDER/NAME is as for run.py.
"""

import run  # first: it keeps NumPy to one thread

import argparse
import tempfile
import time
from pathlib import Path

import numpy

import data
import network

# Not the presets digit and gelsight-mini, which were fitted to sensors that are tested here.
SENSORS = "gelsight-2014", "gelsight-2017", "gelsight-series2"
# The objectives and how colours are mixed were chosen on the first set, and nothing on the others.
CHOSEN_ON, REPORTED = "gelsight_fots", ("gsmini_gssdk", "gsmini_gelslam_balls", "digit_fots", "gelsight_thu")
BLOCKS, PLACES, TEMPERATURE = 16, 32, 0.2
STRENGTHS = 10.0 ** numpy.arange(-5, 3)
VIEW_MM = 18.6, 13.95
# One pad, so that all sensors show the same surface.
SET = """
[sensor.unit]
variation = 1.0
gelpad_thickness = 0.0
gelpad_youngs_modulus = 0.0
[sensors]
from = {names}
count = {count}
paired = {paired}
"""
OBJECTIVES = {"contrast": 0, "contrast and shape": 1}


def blocks_of(image):
    """Means over 16 x 16 blocks, whatever the image's size."""
    for axis in (0, 1):
        bounds = numpy.arange(BLOCKS + 1) * image.shape[axis] // BLOCKS
        sums = numpy.add.reduceat(image, bounds[:-1], axis)
        image = sums / numpy.diff(bounds).reshape([-1 if at == axis else 1 for at in range(image.ndim)])
    return image


def simulated(given, sensors, count, paired, seed):
    """Changes of colour in grey levels and surfaces in mm, of the same presses under each sensor: sensors, presses, 16, 16, .."""
    of_set = SET.format(names=list(sensors), count=count, paired=str(paired).lower()).replace("'", '"')
    pad = f"gelpad_thickness_mm = 3.0\nresolution_px = [80, 60]\nfield_of_view_mm = {list(VIEW_MM)}"
    samples = given.samples // (len(sensors) * count)
    sets = data.simulated(given.gelsim, pad, VIEW_MM, 1.2, (2.0, 3.0, 4.5, 6.0), samples, seed, run.RANDOMIZED + of_set)
    return [numpy.array([[blocks_of(image) for image in layer] for layer in layers], "float32")
            for layers in ([presses.change for presses in sets], [presses.surface for presses in sets])]


def flat(images):
    return images.reshape(len(images), -1) / (network.LEVELS if images.ndim == 4 else 1)


def contrast_slopes(out):
    """Slopes of InfoNCE, both ways: each of the first half's rows is to be like its fellow in the second half."""
    size = numpy.linalg.norm(out, axis=1, keepdims=True) + 1e-6
    unit = out / size
    one, other = numpy.split(unit, 2)
    likeness = numpy.exp((one @ other.T - 1) / TEMPERATURE)
    slopes = likeness / likeness.sum(axis=1, keepdims=True) + likeness / likeness.sum(axis=0)
    slopes = (slopes - 2 * numpy.eye(len(one), dtype="float32")) / (2 * len(one) * TEMPERATURE)
    slopes = numpy.concatenate([slopes @ other, slopes.T @ one])
    return (slopes - unit * (slopes * unit).sum(axis=1, keepdims=True)) / size


def sizes(units):
    return 3 * BLOCKS**2, 2 * units, units, BLOCKS**2 + PLACES


def pretrain(change, surface, shape, units, steps, random, batch=128):
    """An encoder. The views of a press are of two sensors where there are several."""
    sensors, presses = change.shape[:2]
    spread = surface.std()

    def draw():
        some = numpy.tile(random.permutation(presses)[:batch], 2)
        one = random.integers(sensors, size=len(some) // 2)
        of = numpy.concatenate([one, (one + random.integers(1, max(sensors, 2), size=len(one))) % sensors])
        views, wanted = change[of, some], surface[of, some] / spread
        for axis in (1, 2):  # as many places again, and light from other sides
            if random.random() < 0.5:
                views, wanted = numpy.flip(views, axis), numpy.flip(wanted, axis)
        mixes = numpy.eye(3) + random.normal(size=(len(some), 3, 3))
        views = numpy.einsum("nijc,ncd->nijd", views, mixes.astype("float32"))

        def slopes_of(out):
            told = (out[:, : BLOCKS**2] - flat(wanted)) / len(out) / BLOCKS
            return numpy.hstack([shape * told, contrast_slopes(out[:, BLOCKS**2 :])])

        return flat(views), slopes_of

    return network.fit(sizes(units), draw, steps, random, rate=2e-3)


def probe(seen, wanted, strength):
    """Reads places off values: ridge regression."""
    mean, middle = seen.mean(axis=0), wanted.mean(axis=0)
    alike = (seen - mean) @ (seen - mean).T
    held = strength * (numpy.trace(alike) / len(alike) + 1e-9) * numpy.eye(len(alike))
    weights = numpy.linalg.solve(alike + held, wanted - middle)
    return lambda others: (others - mean) @ (seen - mean).T @ weights + middle


def distance(found, wanted):
    return numpy.hypot(*(found - wanted).T).mean()


class RealPlaces:
    """A real set: images in blocks, and the places of the ball in mm."""

    def __init__(self, folder):
        real = data.Real(folder)
        rows = real.fitted + real.tested
        self.images = flat(numpy.array([blocks_of(data.picture(row["file"]) - real.background) for row in rows], "float32"))
        self.places = numpy.array([[row["centre_x_px"], row["centre_y_px"]] for row in rows]) * real.mm_per_px

    def read(self, values, shots, splits):
        """Mean distance in mm between the places that are read off values and the real ones."""
        off = []
        for split in range(splits):
            order = numpy.random.default_rng(split).permutation(len(values))
            fitted, tested = order[:shots], order[shots:]
            left_out = [sum(distance(probe(values[rest], self.places[rest], strength)(values[[at]]), self.places[[at]])
                            for at in fitted for rest in [fitted[fitted != at]]) for strength in STRENGTHS]
            read = probe(values[fitted], self.places[fitted], STRENGTHS[numpy.argmin(left_out)])
            off.append(distance(read(values[tested]), self.places[tested]))
        return numpy.mean(off)


def encoders(given, seed):
    """What makes values of images, by name."""
    encode = lambda weights: lambda images: network.forward(weights, images)[-2].astype(float)
    yield "nothing (the mean place)", lambda images: numpy.zeros((len(images), 1))
    yield "pixels, no encoder", lambda images: images.astype(float)
    yield "random weights", encode(network.fit(sizes(given.units), None, 0, numpy.random.default_rng(seed)))
    for images, names, count, paired in (
        ("one sensor", SENSORS[seed % 3 :][:1], 1, True),
        ("many sensors, not paired", SENSORS, given.sensor_units, False),
        ("many sensors, paired", SENSORS, given.sensor_units, True),
    ):
        sets = simulated(given, names, count, paired, seed)
        if not paired:
            sets = [each.reshape(1, -1, *each.shape[2:]) for each in sets]
        for name, shape in OBJECTIVES.items():
            yield f"{images}: {name}", encode(pretrain(*sets, shape, given.units, given.steps, numpy.random.default_rng(seed)))


def compare(given, sets):
    """Prints a table for each number of shots: means over seeds, and half of what they differ by; returns the last one's means."""
    rows = {}
    for seed in range(given.seeds):
        for name, encode in encoders(given, seed):
            values = {of: encode(real.images) for of, real in sets.items()}
            off = [[real.read(values[of], shots, given.splits) for of, real in sets.items()] for shots in given.shots]
            rows.setdefault(name, []).append(off)
    for at, shots in enumerate(given.shots):
        print(f"{f'place off by, mm; {shots} real presses':46}" + "".join(f"{name:>22}" for name in sets))
        for name, results in rows.items():
            off = numpy.array(results)[:, at]
            cells = [f"{mean:.2f} +-{spread:.2f}" for mean, spread in zip(off.mean(axis=0), numpy.ptp(off, axis=0) / 2)]
            print(f"{name:46}" + "".join(f"{cell:>22}" for cell in cells), flush=True)
    return {name: numpy.mean(results, axis=0)[-1] for name, results in rows.items()}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("gelsim", type=lambda name: Path(name).resolve())
    parser.add_argument("--real", type=Path, help="folder with a folder for each --set")
    parser.add_argument("--set", nargs="+", default=(CHOSEN_ON, *REPORTED))
    parser.add_argument("--shots", type=int, nargs="+", default=[4, 8], help="real presses that the probe is fitted to")
    parser.add_argument("--splits", type=int, default=20, help="draws of these presses")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--samples", type=int, default=2400, help="simulated images for each encoder")
    parser.add_argument("--sensor-units", type=int, default=2, help="units of each of the simulated sensors")
    parser.add_argument("--units", type=int, default=64, help="units of the last hidden layer; the first has twice as many")
    parser.add_argument("--steps", type=int, default=1500)
    parser.add_argument("--self-test", action="store_true", help="a preset as if it were real")
    given = parser.parse_args()
    if not given.gelsim.is_file():
        raise data.Missing(f"no program {given.gelsim}")
    started = time.monotonic()
    if given.self_test:
        given.seeds, given.samples, given.steps, given.splits, given.shots = 1, 300, 300, 4, [20]
        with tempfile.TemporaryDirectory() as work:
            folder = run.pretend(given.gelsim, Path(work) / "as-real", "gelsight-mini", presses=40)
            means = compare(given, {"gelsight-mini": RealPlaces(folder)})
        if not means["many sensors, paired: contrast"][0] < 0.7 * means["nothing (the mean place)"][0]:
            raise SystemExit("a probe reads places no better than a guess")
    else:
        if given.real is None or not given.real.is_dir():
            raise data.Missing(f"no folder {given.real}: --real FOLDER, or --self-test")
        there = [name for name in given.set if (given.real / name).is_dir()]
        for name in given.set:
            if name not in there:
                print(f"skipped: {given.real / name} is not there")
        if not there:
            raise data.Missing(f"none of these folders is there; docs/evidence/transfer.md says what {given.real} holds")
        compare(given, {name: RealPlaces(given.real / name) for name in there})
    print(f"{time.monotonic() - started:.0f} s; {given.splits} draws of the presses fitted, {given.seeds} seeds")


if __name__ == "__main__":
    main()
