"""What the Python module is attacked with, and what may come of it. Programs of attacks import this, too."""

import collections.abc
import itertools
import json
import os
import re

import gelsim
import numpy as np

# Longest message, bytes: nobody reads more.
LONGEST_MESSAGE = 4000
# What a function may raise.
SENSIBLE = (ValueError, TypeError, IndexError, OSError, MemoryError, RecursionError, gelsim.RunError)
# What only a mistake of gelsim's own says.
NONSENSE = re.compile(r"panic|which is a bug|unwrap|\.rs\b|index out of bounds|capacity overflow|assertion")

ROWS, COLUMNS = 24, 32
LAYERS = ["depth", "surface", "contact", "normal", "pressure"]
CORNERS_MM = [(-3, -3, 2), (3, -3, 2), (3, 3, 2), (-3, 3, 2), (0, 0, 0)]
FACES = [(4, 0, 1), (4, 1, 2), (4, 2, 3), (4, 3, 0)]
REFUSED = object()


class Mischief(Exception):
    """What evil objects raise: it is passed on as it is."""


def look_at_message(error, words, longest=LONGEST_MESSAGE):
    """An exception helps: it is short, says nothing of gelsim's inside, and one of `words`."""
    said = str(error)
    assert not NONSENSE.search(said), said
    assert len(said) < longest, f"{len(said)} bytes: {said[:200]}"
    assert not words or any(word in said for word in words), f"none of {words}: {said!r}"


def attempt(call, *words, kinds=(), longest=LONGEST_MESSAGE):
    """What a call gives, or REFUSED where it raises an exception that helps; nothing else will do."""
    try:
        return call()
    except Mischief:
        return REFUSED
    except (*SENSIBLE, *kinds) as error:
        look_at_message(error, words, longest)
        return REFUSED


def refused(call, kinds, *words):
    """A call raises an exception of these kinds that helps; nothing else will do."""
    try:
        given = call()
    except kinds as error:
        look_at_message(error, () if isinstance(error, Mischief) else words)
    else:
        raise AssertionError(f"accepted: {given!r:.200}")


def ball(rows=ROWS, columns=COLUMNS, depth_mm=0.5):
    """A depth map of a ball, and of nothing beside it."""
    y, x = np.mgrid[-5 : 5 : rows * 1j, -7 : 7 : columns * 1j]
    with np.errstate(invalid="ignore"):
        depth = np.sqrt(16.0 - x**2 - y**2) - 4 + depth_mm
    return np.nan_to_num(depth, nan=-np.inf).astype(np.float32)


def look_at_numbers(sample):
    """Nothing of a sample is NaN or without bounds."""
    for name, value in sample.items():
        assert not isinstance(value, np.ndarray) or np.isfinite(value).all(), name
    json.dumps(sample["label"], allow_nan=False)


def look_at_layers(sample, shape):
    """Layers of a map, or of several, of this shape are finite."""
    # An axis for a camera's one channel is no picture's.
    picture = shape[:2] if len(shape) == 3 and shape[1] > 1 and shape[2] == 1 else shape
    assert sample["tactile"].shape == (*picture, 3)
    for name in LAYERS:
        assert np.isfinite(sample[name]).all(), name


class Evil:
    """Raises wherever Python asks something of it."""

    def __getattr__(self, name):
        raise Mischief(name)

    def __repr__(self):
        raise Mischief("repr")

    __str__ = __index__ = __int__ = __float__ = __len__ = __iter__ = __fspath__ = __bool__ = __hash__ = __repr__
    __eq__ = __getitem__ = lambda self, other: self.__repr__()


class Liar(collections.abc.Sequence):
    """A sequence that tells a wrong length; a negative one of items never ends."""

    def __init__(self, length, items, item):
        self.length, self.items, self.item = length, items, item

    def __len__(self):
        return self.length

    def __getitem__(self, place):
        if place == self.items:
            raise IndexError
        return self.item


class Claims:
    """Says that it is of another class."""

    def __init__(self, kind):
        self.kind = kind

    @property
    def __class__(self):
        return self.kind


def converting(method, value):
    """An object whose conversion gives `value`, or raises it."""

    def give(self):
        if isinstance(value, Exception):
            raise value
        return value

    return type("Converting", (), {method: give})()


class Nameless(type):
    """A class whose name cannot be known."""

    @property
    def __name__(cls):
        raise Mischief("name")


def wrong_values():
    """What no argument is meant to be, or what only some are, by name."""
    inside = []
    inside.append(inside)
    return {
        "None": None, "True": True, "0": 0, "-1": -1, "2**31": 2**31, "2**63": 2**63, "2**64": 2**64,
        "-2**63-1": -(2**63) - 1, "10**1000": 10**1000, "1.5": 1.5, "nan": float("nan"), "1j": 1j, "empty text": "",
        "text": "x", "long text": "x" * 10**6, "NUL": "a\0b", "half a surrogate": "\ud800", "bytes": b"x",
        "bytes that are no text": b"\xff\xfe", "bytearray": bytearray(b"x"), "memoryview": memoryview(b"x"), "list": [],
        "list of None": [None], "list of numbers": [10**30], "list of texts": ["x"], "list of surrogates": ["\udfff"],
        "list of long text": ["x" * 10**6], "list within itself": inside, "tuple": ("a", 1), "dict": {"a": 1},
        "set": {1, "x"}, "slice": slice(0, 2), "range": range(10**15), "Ellipsis": ..., "a class": int,
        "a function": len, "a module": os, "an exception": ValueError("x"), "object": object(), "evil": Evil(),
        "evil in a list": [Evil()], "without a name": Nameless("Nameless", (), {})(), "claims text": Claims(str),
        "claims a number": Claims(int), "claims a list": Claims(list), "claims an array": Claims(np.ndarray),
        "index of text": converting("__index__", "1"), "index too large": converting("__index__", 2**70),
        "index raises": converting("__index__", Mischief("index")), "path of a number": converting("__fspath__", 1),
        "path raises": converting("__fspath__", Mischief("path")), "float only": converting("__float__", 1.0),
        "endless": Liar(3, -1, "x"), "longer than it says": Liar(1, 5, 0), "says 2**62": Liar(2**62, 2, "x"),
        "says 2**40": Liar(2**40, 2, 0), "says less than nothing": Liar(-5, 2, 0), "length is text": Liar("x", 2, 0),
        "iterator": iter([1, 2]), "endless iterator": itertools.count(), "0-d array": np.array(1),
        "array of texts": np.array(["x", "y"]), "array of numbers": np.arange(3),
        "array of objects": np.array([None, Evil], object), "numpy's nan": np.float32("nan"),
        "numpy's time": np.datetime64("now"),
    }  # fmt: skip


WRONG = list(wrong_values())
