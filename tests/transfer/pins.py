"""Pins of a TacTip, found in binarised pictures and followed. Points and motions are complex, x + i y, in pixels of the preset's
picture (128 x 128) from its middle."""

from typing import NamedTuple

import numpy
from PIL import Image

PICTURE_MIDDLE = 63.5 + 63.5j


class View(NamedTuple):
    """How a unit's picture lies over the preset's, as pins do that hardly moved."""

    scale: float  # pixels for one of the preset's
    turn_deg: float
    middle_px: complex

    def place(self, dots):
        """Dots of the unit's picture in that of the preset; those beyond the pins are left out."""
        dots = (dots - self.middle_px) / (self.scale * numpy.exp(1j * numpy.radians(self.turn_deg)))
        return dots[abs(dots) < 60]


# Of the two robots of the set `tactip_shear`, and of pictures of 128 x 128 that were enlarged.
VIEWS = {"franka": View(4.0753, -0.67, 224.501 + 220.878j), "cr": View(3.8367, -0.08, 210.537 + 211.927j)}
ENLARGED = View(4.0, 0.0, 255.5 + 255.5j)


def as_complex(points_px):
    x, y = numpy.array(points_px, float).T
    return x + 1j * y - PICTURE_MIDDLE


def choose_around(plane, choose):
    """Gives each pixel the largest or least value of itself and the eight around it."""
    for axis in (0, 1):
        plane = choose(choose(plane, numpy.roll(plane, 1, axis)), numpy.roll(plane, -1, axis))
    return plane


def read_white(path):
    return numpy.asarray(Image.open(path).convert("L")) > 127


def enlarge(white):
    """A picture of 128 x 128 in four times the size, so that its pins are as large as `find_dots` takes them."""
    y, x = numpy.mgrid[:128, :128]
    # Beyond is the mount.
    white = white & (numpy.hypot(x - 63.5, y - 63.5) < 50)
    levels = Image.fromarray((255 * white).astype("uint8")).resize((512, 512), Image.BICUBIC)
    return numpy.asarray(levels) > 127


def find_dots(white):
    """Finds the middles of white spots, of a pin's size, in a binarised picture."""
    # Black around it, as values come in from the other side.
    white = numpy.pad(white, 1)
    white = choose_around(choose_around(white, numpy.minimum), numpy.maximum)
    # Each spot gets the largest of its pixels' numbers; pins that touch by corners alone are two.
    labels = numpy.where(white, numpy.arange(1, white.size + 1).reshape(white.shape), 0)
    while True:
        beside = [numpy.roll(labels, step, axis) for step in (1, -1) for axis in (0, 1)]
        grown = numpy.where(white, numpy.maximum.reduce([labels, *beside]), 0)
        if numpy.array_equal(grown, labels):
            break
        labels = grown
    row, column = numpy.nonzero(white)
    _, spot, area = numpy.unique(labels[white], return_inverse=True, return_counts=True)
    middles = (numpy.bincount(spot, column) + 1j * numpy.bincount(spot, row)) / area
    return middles[(area > 30) & (area < 260)] - (1 + 1j)


def match(places, dots, within_px):
    """Pairs places with dots: the nearest dot of each, its distance, and whether the two are each other's nearest."""
    squared = (places.real[:, None] - dots.real) ** 2 + (places.imag[:, None] - dots.imag) ** 2
    nearest = squared.argmin(axis=1)
    distance = numpy.sqrt(squared[numpy.arange(len(places)), nearest])
    return nearest, distance, (distance < within_px) & (squared.argmin(axis=0)[nearest] == numpy.arange(len(places)))


def powers(pins, degree):
    """Powers of the pins' places, a column each."""
    x, y = pins.real / 50, pins.imag / 50
    return numpy.stack([x**i * y**j for i in range(degree + 1) for j in range(degree + 1 - i)], axis=1)


def improve_motion(pins, motion, dots, stages):
    """Fits polynomials in the pins' places to what they match, again and again; None where too little matches."""
    for degree, within_px, times in stages:
        terms = powers(pins, degree)
        for _ in range(times):
            nearest, distance, matched = match(pins + motion, dots, within_px)
            if matched.sum() < 120:
                return None
            weighted = terms[matched].T / (1 + (distance[matched] / (0.4 * within_px)) ** 2)
            square = weighted @ terms[matched] + 1e-4 * numpy.eye(terms.shape[1])
            motion = terms @ numpy.linalg.solve(square, weighted @ (dots[nearest] - pins)[matched])
    return motion


def track_pins(pins, dots, shear=None):
    """Finds how far each pin moved, NaN where it is lost: from many first guesses that one which matches most pins.

    More guesses are made where the shear is known.
    """
    guesses = [complex(x, y) for x in (-6, -3, 0, 3, 6) for y in (-6, -3, 0, 3, 6) if numpy.hypot(x, y) < 7]
    if shear is not None:
        # Or the dome's middle moved more than its rim.
        bulge = numpy.exp(-((abs(pins) / 40) ** 2))
        guesses += [shear * (even + more * bulge) for even in (0, 0.5, 1, 1.5) for more in (0, 1, 2)]
    coarse = []
    for guess in guesses:
        motion = improve_motion(pins, guess + 0 * pins, dots, [(0, 4, 3), (1, 3.5, 4), (2, 3, 4)])
        if motion is not None:
            coarse.append((numpy.minimum(match(pins + motion, dots, 1)[1], 2.5).mean(), motion))
    different = []
    for _, motion in sorted(coarse, key=lambda each: each[0]):
        if len(different) < 6 and all(abs(motion - other).max() >= 0.7 for other in different):
            different.append(motion)
    best = numpy.full(len(pins), numpy.nan + 0j)
    for motion in different:
        motion = improve_motion(pins, motion, dots, [(2, 2.6, 3), (3, 2.6, 5), (5, 2.4, 6), (7, 2.2, 5)])
        if motion is not None:
            nearest, _, matched = match(pins + motion, dots, 1.6)
            if matched.sum() > (~numpy.isnan(best)).sum():
                best = numpy.where(matched, dots[nearest] - pins, numpy.nan)
    return best
