"""What each part of the light is worth to a network, in degrees: `python tests/transfer/light.py FOLDER`.

FOLDER holds pixels of presses as `physics::transport` writes them:

    GELSIM_PATHS=100 GELSIM_LIGHT_PIXELS=FOLDER cargo test --release --test library physics::transport

For each kind of sensor and each model of the light, networks that judge a pixel by its change of colour and its place
learn from images of the model and read normals from traced light. Two objects at a time are kept aside for the test.
"""

import sys
from pathlib import Path

import network
import numpy

SOURCES = ["traced light itself", "all", "without bounce", "without mirror", "without shadows", "phong"]
FOLDS = 4


def read_normals(learnt, pixels, source):
    """Mean angle off the true normals, degrees: over pixels of the objects of `pixels`, in traced light."""
    inputs = lambda rows, at: numpy.hstack([rows[:, at : at + 3] / network.LEVELS, rows[:, 1:3]]).astype("float32")
    labels = numpy.stack([learnt[:, 3], learnt[:, 4], learnt[:, 5] > 0.05, learnt[:, 5]], axis=1).astype("float32")
    random = numpy.random.default_rng(7)
    weights = network.train(inputs(learnt, 6 + 3 * source), labels, 48, 1500, random, batch=1024)
    return network.angle_deg(network.as_normal(network.forward(weights, inputs(pixels, 6))[-1]), pixels[:, 3:5])


def main():
    files = sorted(Path(sys.argv[1]).glob("*.txt"))
    print(f"{'degrees, learnt from':<24}" + "".join(f"{file.stem:>8}" for file in files))
    kinds = [numpy.loadtxt(file) for file in files]
    for source, name in enumerate(SOURCES):
        line = f"{name:<24}"
        for pixels in kinds:
            off = []
            for fold in range(FOLDS):
                aside = pixels[:, 0] % FOLDS == fold
                off.append(read_normals(pixels[~aside], pixels[aside], source))
            line += f"{numpy.concatenate(off).mean():8.2f}"
        print(line, flush=True)


if __name__ == "__main__":
    main()
