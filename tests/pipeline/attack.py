"""The Python module under attack: whatever it is given, it gives a right result or an exception that helps.

    python attack.py [FAMILY ...]   from the project's root, where the wheel and numpy are installed

Each family runs in a process of its own, and goes on in another where an attack ends it; what forks, is interrupted or
ends while others render has a process for itself. A signal, an abort, a panic and a wait without end are failures.
"""

import collections
import copy
import ctypes
import faulthandler
import itertools
import json
import mmap
import multiprocessing.shared_memory
import operator
import os
import pickle
import random
import re
import resource
import signal
import subprocess
import sys
import tempfile
import threading
import time
import traceback
import warnings
from pathlib import Path

import gelsim
import numpy as np
from gelsim import _native

# Longest that an attack may take on a busy machine, s.
PATIENCE_S = 120
# Memory that attacks which are to be refused may take, MB.
SPARE_MB = 200
# Address space of a family's process: what asks for more is refused it, and the machine stays.
MOST_BYTES = 16 << 30
# Longest message, bytes: nobody reads more.
LONGEST_MESSAGE = 4000

# What a function may raise; more kinds for what is no function of ours.
SENSIBLE = (ValueError, TypeError, IndexError, OSError, MemoryError, RecursionError, gelsim.RunError)
# What only a mistake of gelsim's own says.
NONSENSE = re.compile(r"panic|which is a bug|unwrap|\.rs\b|index out of bounds|capacity overflow|assertion")

JOB = """
dataset = { name = "attacked", samples = 6, seed = 4 }
sensor.resolution_px = [32, 24]
object = [{ path = "OBJECTS/sphere.obj" }, { path = "OBJECTS/gear.obj" }]
indentation.depth_mm = [0.3, 1.0]
"""
ROWS, COLUMNS = 24, 32
LAYERS = ["depth", "surface", "contact", "normal", "pressure"]
CORNERS_MM = [(-3, -3, 2), (3, -3, 2), (3, 3, 2), (-3, 3, 2), (0, 0, 0)]
FACES = [(4, 0, 1), (4, 1, 2), (4, 2, 3), (4, 3, 0)]


class Mischief(Exception):
    """What evil objects raise: it is passed on as it is."""


class Attack:
    """A call and what may come of it: a result that `check` accepts, or an exception of `kinds` with one of `words`."""

    def __init__(self, name, call, check=None, kinds=(), words=()):
        self.name, self.call, self.check, self.kinds, self.words = name, call, check, kinds, words

    def outcome(self):
        """`result` or `exception`; an AssertionError says what is wrong."""
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                result = self.call()
        except self.kinds as error:
            message = str(error)
            if isinstance(error, Mischief):
                return "exception"
            assert not NONSENSE.search(message), message
            assert len(message) < LONGEST_MESSAGE, f"{len(message)} bytes: {message[:200]}"
            assert not self.words or any(word in message for word in self.words), f"none of {self.words}: {message!r}"
            return "exception"
        except BaseException as error:
            raise AssertionError(f"{type(error).__module__}.{type(error).__qualname__}: {str(error)[:500]}") from error
        assert self.check is not None, f"accepted: {repr(result)[:200]}"
        self.check(result)
        return "result"


def refused(name, call, kinds, *words):
    """Nothing but an exception will do."""
    return Attack(name, call, None, kinds, words)


def works(name, call, check=lambda result: None):
    """Nothing but the right result will do."""
    return Attack(name, call, check)


def either(name, call, *words, kinds=(), check=lambda result: None):
    """A result, or an exception that says what of."""
    return Attack(name, call, check, (*SENSIBLE, Mischief, *kinds), words)


def ball(rows=ROWS, columns=COLUMNS, depth_mm=0.5):
    """A depth map of a ball, and of nothing beside it."""
    y, x = np.mgrid[-5 : 5 : rows * 1j, -7 : 7 : columns * 1j]
    with np.errstate(invalid="ignore"):
        depth = np.sqrt(16.0 - x**2 - y**2) - 4 + depth_mm
    return np.nan_to_num(depth, nan=-np.inf).astype(np.float32)


def same(one, other):
    """Two samples, or two batches, are the same in every bit."""
    assert list(one) == list(other), (list(one), list(other))
    for name, value in one.items():
        equal = np.array_equal(value, other[name]) if isinstance(value, np.ndarray) else value == other[name]
        assert equal, name


def equal(one, other):
    """Two values are the same."""
    assert one == other, (one, other)


def finite(sample):
    """Nothing of a sample is NaN or without bounds."""
    for name, value in sample.items():
        assert not isinstance(value, np.ndarray) or np.isfinite(value).all(), name
    json.dumps(sample["label"], allow_nan=False)


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
    """What no argument is meant to be, or what only some are."""
    inside = []
    inside.append(inside)
    yield from {
        "None": None,
        "True": True,
        "0": 0,
        "-1": -1,
        "2**31": 2**31,
        "2**63": 2**63,
        "2**64": 2**64,
        "-2**63-1": -(2**63) - 1,
        "10**1000": 10**1000,
        "1.5": 1.5,
        "nan": float("nan"),
        "1j": 1j,
        "empty text": "",
        "text": "x",
        "long text": "x" * 10**6,
        "NUL": "a\0b",
        "half a surrogate": "\ud800",
        "bytes": b"x",
        "bytes that are no text": b"\xff\xfe",
        "bytearray": bytearray(b"x"),
        "memoryview": memoryview(b"x"),
        "list": [],
        "list of None": [None],
        "list of numbers": [10**30],
        "list of texts": ["x"],
        "list of surrogates": ["\udfff"],
        "list of long text": ["x" * 10**6],
        "list within itself": inside,
        "tuple": ("a", 1),
        "dict": {"a": 1},
        "set": {1, "x"},
        "slice": slice(0, 2),
        "range": range(10**15),
        "Ellipsis": ...,
        "a class": int,
        "a function": len,
        "a module": os,
        "an exception": ValueError("x"),
        "object": object(),
        "evil": Evil(),
        "evil in a list": [Evil()],
        "without a name": Nameless("Nameless", (), {})(),
        "claims text": Claims(str),
        "claims a number": Claims(int),
        "claims a list": Claims(list),
        "claims an array": Claims(np.ndarray),
        "index of text": converting("__index__", "1"),
        "index too large": converting("__index__", 2**70),
        "index raises": converting("__index__", Mischief("index")),
        "path of a number": converting("__fspath__", 1),
        "path raises": converting("__fspath__", Mischief("path")),
        "float only": converting("__float__", 1.0),
        "endless": Liar(3, -1, "x"),
        "longer than it says": Liar(1, 5, 0),
        "says 2**62": Liar(2**62, 2, "x"),
        "says 2**40": Liar(2**40, 2, 0),
        "says less than nothing": Liar(-5, 2, 0),
        "length is text": Liar("x", 2, 0),
        "iterator": iter([1, 2]),
        "endless iterator": itertools.count(),
        "0-d array": np.array(1),
        "array of texts": np.array(["x", "y"]),
        "array of numbers": np.arange(3),
        "array of objects": np.array([None, Evil], object),
        "numpy's nan": np.float32("nan"),
        "numpy's time": np.datetime64("now"),
    }.items()


def generate(job, out=None, **more):
    """Writes to a folder of its own, unless another one is said."""
    return gelsim.generate(job, tempfile.mkdtemp(dir=root) if out is None else out, **more)


def arguments():
    """Every wrong value as every argument of every function."""
    threads = {"threads": ("threads",)}
    assigned = {"set": ("set",), **threads}
    # Each function with what is right, and each argument with the words by which a message may name it.
    entries = [
        (
            "Job.load",
            gelsim.Job.load,
            {"path": job_path},
            {
                "path": ("path", "is not UTF-8", "cannot be read", "cannot read"),
                "samples": ("samples",),
                "seed": ("seed",),
                "fidelity": ("fidelity", "level"),
                "all_effects": ("all_effects",),
                **assigned,
            },
        ),
        ("job.sample", job.sample, {}, {"index": ("index", "sample")}),
        ("job.samples", job.samples, {}, {"indices": ("indices", "index", "sample")}),
        ("job.__getitem__", lambda it: job[it], {}, {"it": ("index", "sample")}),
        ("job.__getitems__", lambda it: job.__getitems__(it), {}, {"it": ("indices", "index", "sample")}),
        ("job.indices", job.indices, {}, {"split": ("split",)}),
        ("Sensor.preset", gelsim.Sensor.preset, {"name": "gelsight-mini"}, {"name": ("name", "preset"), **assigned}),
        (
            "Sensor.load",
            gelsim.Sensor.load,
            {"path": sensor_path},
            {"path": ("path", "is not UTF-8", "cannot be read", "cannot read"), **assigned},
        ),
        (
            "sensor.render",
            sensor.render,
            {"depth_mm": ball()},
            {
                "depth_mm": ("depth_mm",),
                "fidelity": ("fidelity", "level"),
                "layers": ("layers", "layer"),
                "index": ("index",),
                "seed": ("seed",),
            },
        ),
        (
            "_job_of_text",
            _native._job_of_text,
            {"text": job.__reduce__()[1][0], "threads": None},
            {"text": ("text", "TOML", "missing key"), **threads},
        ),
        (
            "_sensor_of_source",
            _native._sensor_of_source,
            {"source": "gelsight-mini", "set": [], "threads": None},
            {"source": ("source", "sensor", "preset", "read"), **assigned},
        ),
        ("sensor.with_leds", sensor.with_leds, {"leds": sensor.leds}, {"leds": ("leds", "LED")}),
        (
            "Simulator",
            gelsim.Simulator,
            {"sensor": "gelsight-mini", "fidelity": "draft", "resolution_px": (COLUMNS, ROWS)},
            {
                "sensor": ("sensor", "name", "path", "is not UTF-8", "cannot be read", "cannot read"),
                "fidelity": ("fidelity",),
                "resolution_px": ("resolution_px",),
                "set": ("set",),
                "flow": ("flow",),
            },
        ),
        (
            "simulator.press",
            simulator.press,
            {"indenter": mesh, "pose": gelsim.Pose(0.3)},
            {
                "indenter": ("indenter", "path", "depth_mm", "vertices", "faces", "cannot be read", "mesh", "heights"),
                "pose": ("pose",),
                "texture": ("texture",),
                "shear": ("shear", "flow"),
                "friction": ("friction",),
                "youngs_modulus_kpa": ("youngs_modulus_kpa",),
                "poisson_ratio": ("poisson_ratio",),
                "index": ("index",),
                "seed": ("seed",),
            },
        ),
        (
            "simulator.step",
            simulator.step,
            {"indenter": mesh, "pose": gelsim.Pose(0.3)},
            {
                "indenter": ("indenter", "path", "depth_mm", "vertices", "faces", "cannot be read", "mesh", "heights"),
                "pose": ("pose",),
                "texture": ("texture",),
            },
        ),
        (
            "simulator.reset",
            simulator.reset,
            {},
            {"friction": ("friction",), "index": ("index",), "seed": ("seed",)},
        ),
        (
            "impression.sample",
            simulator.press(mesh, gelsim.Pose(0.3)).sample,
            {},
            {"layers": ("layers", "layer")},
        ),
        (
            "Mesh",
            gelsim.Mesh,
            {"vertices_mm": CORNERS_MM, "faces": FACES},
            {"vertices_mm": ("vertices_mm",), "faces": ("faces",), "name": ("name",)},
        ),
        (
            "Mesh.load",
            gelsim.Mesh.load,
            {"path": Path(root) / "flat_face.obj"},
            {"path": ("path", "cannot be read", "mesh"), "mm_per_unit": ("mm_per_unit",)},
        ),
        ("Mesh.of", gelsim.Mesh.of, {}, {"given": ("mesh",)}),
        (
            "generate",
            generate,
            {"job": job_path, "samples": 1},
            {
                "job": ("job", "path", "is not UTF-8", "cannot be read", "cannot read"),
                "out": ("out", "x: ", "dataset"),
                "samples": ("samples",),
                "seed": ("seed",),
                "fidelity": ("fidelity",),
                "all_effects": ("all_effects",),
                "overwrite": ("overwrite",),
                **assigned,
            },
        ),
    ]
    for kind in [gelsim.Pose, gelsim.Placement, gelsim.Texture, gelsim.Shear, gelsim.Led]:
        name = kind.__name__
        right = {"Pose": {"depth_mm": 0.3}, "Texture": {"pattern": "noise"}, "Led": {"azimuth_deg": 0.0}}.get(name, {})
        right = {"translation_mm": (0, 0, 0)} if name == "Placement" else right
        entries.append((name, kind, right, {field: (field,) for field in kind.__dataclass_fields__}))
    for label, function, right, names in entries:
        for name, words in names.items():
            for what, value in wrong_values():
                given = {**right, name: value}
                yield either(
                    f"{label}({name}={what})",
                    lambda function=function, given=given: function(**given),
                    *words,
                    # What Python says of an object that counts less than nothing.
                    "should return >= 0",
                )
        yield refused(f"{label}(unknown=1)", lambda f=function, r=right: f(**r, unknown=1), TypeError, "unknown")
        yield refused(f"{label}(*range(20))", lambda function=function: function(*range(20)), TypeError)
    yield refused("render()", lambda: sensor.render(), TypeError, "depth_mm")
    yield refused("Job.load()", lambda: gelsim.Job.load(), TypeError, "path")
    text = "a" + ".a" * 100_000
    for what, assignment in {
        "deep list": "a=" + "[" * 100_000,
        "deep table": "a=" + "{a=" * 100_000,
        "deep key": text + "=1",
        "a hundred thousand quotes": '"' * 100_000,
        "lines": "a=1\n" * 20,
        "NaN": "camera.exposure=nan",
        "inf": "gelpad_thickness_mm=inf",
        "a large number": "camera.exposure=1e999",
        "a huge view": "sensor.resolution_px=[1000000, 1000000]",
        "another view": "sensor.resolution_px=[7, 5]",
    }.items():
        yield either(f"set {what}", lambda a=assignment: gelsim.Sensor.preset("gelsight-mini", set=[a]).render(ball()))
        yield either(f"set {what} of a job", lambda a=assignment: gelsim.Job.load(job_path, set=[a])[0])
        lines = assignment if "=" in assignment else "a = 1"
        yield either(f"job of {what}", lambda lines=lines: _native._job_of_text(lines, None))
    for what, value in wrong_values():
        for given in [{"camera.exposure": value}, {"sensor.led": [{"color": value}]}]:
            yield either(f"set of a value {what}", lambda g=given: gelsim.Job.load(job_path, set=g), "set", "camera", "sensor.led", ">= 0")
    many = ["surface"] * 100_000
    yield either("many layers", lambda: sensor.render(ball(), layers=many), "layers")
    yield either("many assignments", lambda: gelsim.Sensor.preset("gelsight-mini", set=["camera.exposure=1.0"] * 3000), "set")


def files():
    """Everything but a job's or a sensor's file at its path."""
    folder = Path(tempfile.mkdtemp(dir=root))
    os.mkfifo(folder / "pipe")
    (folder / "circle").symlink_to(folder / "circle")
    (folder / "empty").write_bytes(b"")
    (folder / "random").write_bytes(random.Random(1).randbytes(100_000))
    (folder / "zeros").write_bytes(bytes(1 << 20))
    with open(folder / "sparse", "wb") as file:
        file.truncate(1 << 40)
    paths = [
        folder / name for name in ["pipe", "circle", "empty", "random", "zeros", "sparse", "absent", "", "a" * 300]
    ]
    paths += ["/dev/zero", "/dev/full", "/proc/self/mem", "", ".", "/" * 5000, os.fsdecode(b"\xff"), "digit\0"]
    for path in paths:
        for load in [gelsim.Job.load, gelsim.Sensor.load]:
            shown = str(path).encode(errors="replace")[-20:]
            # A sensor of which nothing is said is the default one.
            expected = either if load == gelsim.Sensor.load and shown.endswith(b"empty") else refused
            yield expected(f"{load.__qualname__} of {shown}", lambda p=path, load=load: load(p), kinds=SENSIBLE)


def arrays():
    """Every dtype, layout and kind of array, of one map and of two."""
    single = ball()
    for one, what in [(single, "map"), (np.stack([single, ball(depth_mm=0.2)]), "batch")]:
        truth = sensor.render(one, layers=LAYERS)

        def right(result, truth=truth):
            same(result, truth)

        def render(given):
            return lambda: sensor.render(given, layers=LAYERS)

        last = one.shape[-1]
        wide = np.full((*one.shape[:-1], 3 * last), np.nan, np.float32)
        wide[..., 1::3] = one
        records = np.zeros(one.shape, [("a", np.int32), ("depth", np.float32)])
        records["depth"] = one
        complexes = np.zeros(one.shape, np.complex64)
        complexes.real = one
        readonly = one.copy()
        readonly.flags.writeable = False
        path = Path(root) / f"{what}.npy"
        np.save(path, one)
        shared = mmap.mmap(-1, one.nbytes)
        shared[:] = one.tobytes()
        in_c = (ctypes.c_float * one.size).from_buffer_copy(one.tobytes())
        block = multiprocessing.shared_memory.SharedMemory(create=True, size=one.nbytes)
        in_block = np.ndarray(one.shape, np.float32, block.buf)
        in_block[:] = one
        flipped = (slice(None, None, -1),) * one.ndim
        backwards = one[flipped].copy()[flipped]
        good = {
            "float64": one.astype(np.float64),
            "Fortran order": np.asfortranarray(one),
            "transposed": one.T.copy().T,
            "every third": wide[..., 1::3],
            "negative strides": backwards,
            "read-only": readonly,
            "over bytes": np.frombuffer(one.tobytes(), np.float32).reshape(one.shape),
            "over a bytearray": np.frombuffer(bytearray(one.tobytes()), np.float32).reshape(one.shape),
            "over an anonymous map": np.frombuffer(shared, np.float32).reshape(one.shape),
            "over ctypes": np.ctypeslib.as_array(in_c).reshape(one.shape),
            "shared memory": in_block,
            "field of records": records["depth"],
            "real part": complexes.real,
            "recarray's field": records.view(np.recarray).depth,
            "subclass": one.view(type("Sub", (np.ndarray,), {})),
            "writes 0 as -0": np.where(one == 0, np.float32(-0.0), one),
            "native byte order": one.astype("=f4"),
        }
        good |= {f"memmap {mode}": np.load(path, mmap_mode=mode) for mode in ["r", "r+", "c"]}
        if what == "map":
            good["matrix"] = one.view(np.matrix)
        for name, given in good.items():
            yield works(f"{what}: {name}", render(given), right)
        in_block = None
        good.clear()

        for dtype in "? b B h H i I l L q Q e g F D G O S8 U8 V4 M8[s] m8[s] >f4 >f8 >i2".split():
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                given = np.zeros(one.shape, dtype)
            yield refused(f"{what}: dtype {dtype}", render(given), TypeError, "depth_mm is")
        yield refused(f"{what}: structured", render(records), TypeError, "depth_mm is")
        yield refused(f"{what}: masked", render(np.ma.masked_less(one, 0.1)), TypeError, "filled")
        packed = np.zeros(one.shape, [("a", np.int8), ("depth", np.float32)])["depth"]
        yield refused(f"{what}: not aligned", render(packed), ValueError, "not aligned")

        class Lying(np.ndarray):
            flags = type("Flags", (), {"aligned": True})()
            shape = (1 << 40, 1 << 40)
            dtype = np.dtype("f4")
            ndim = 1

        yield refused(f"{what}: lies about its place", render(packed.view(Lying)), ValueError, "not aligned")
        yield works(f"{what}: lies about its shape", render(one.view(Lying)), right)

        class Raising(np.ndarray):
            def __getattribute__(self, name):
                raise Mischief(name)

        yield either(f"{what}: raises", render(one.view(Raising)), check=right)

        likes = {
            "list": one.tolist(),
            "memoryview": memoryview(one),
            "bytes": one.tobytes(),
            "__array__": converting("__array__", one),
            "__array__ raises": converting("__array__", Mischief("array")),
            "__dlpack__": converting("__dlpack__", one.__dlpack__()),
            "scalar": one.ravel()[0],
            "array of objects": np.full(one.shape, None),
            "flat iterator": one.flat,
            "array's class": np.ndarray,
        }
        likes["__array_interface__"] = type("A", (), {"__array_interface__": one.__array_interface__})()
        wild = {**one.__array_interface__, "data": (8, False)}
        likes["__array_interface__ of nowhere"] = type("A", (), {"__array_interface__": wild})()
        for name, given in likes.items():
            yield refused(f"{what}: {name}", render(given), TypeError, "depth_mm is")

    for shape in [
        (),
        (0,),
        (24,),
        (0, 0),
        (0, 5),
        (5, 0),
        (0, 5, 5),
        (2, 0, 5),
        (2, 5, 0),
        (1,) * 4,
        (1,) * 32,
        (9, 9, 9, 9),
    ]:
        for dtype in [np.float32, np.float64]:
            given = np.zeros(shape, dtype)
            words = "depth_mm has", "depth_mm is empty"
            what = f"shape {shape} of {dtype.__name__}"
            yield refused(what, lambda given=given: sensor.render(given, layers=LAYERS), ValueError, *words)
    for shape in [
        (1, 1),
        (1, 2),
        (2, 1),
        (1, 300),
        (300, 1),
        (1, 1, 1),
        (3, 1, 7),
        (3, 7, 1),
        (70, 2, 2),
        (2, 8192),
        (8192, 2),
    ]:
        given = np.full(shape, 0.3, np.float32)
        # A pixel that is far longer than wide is refused.
        yield either(
            f"shape {shape}",
            lambda given=given: sensor.render(given, layers=LAYERS),
            "field_of_view",
            "px",
            check=whole(shape),
        )


def whole(shape):
    """Checks that arrays have a shape and are finite."""

    def check(sample):
        # An axis for a camera's one channel is no picture's.
        picture = shape[:2] if len(shape) == 3 and shape[1] > 1 and shape[2] == 1 else shape
        assert sample["tactile"].shape == (*picture, 3), sample["tactile"].shape
        for name in LAYERS:
            assert np.isfinite(sample[name]).all(), name

    return check


def values():
    """Numbers that are none, or larger and smaller than any length; each at every rung."""
    rungs = ["paper", "draft", "standard", "high", "reference"]
    for dtype in [np.float32, np.float64]:
        for rung in rungs:
            layers = [name for name in LAYERS if name != "pressure" or rung not in ["paper"]]

            def render(value, place=(10, 12), dtype=dtype, rung=rung, layers=layers):
                depth = ball().astype(dtype)
                depth[place] = value
                return sensor.render(depth, fidelity=rung, layers=layers)

            what = f"{dtype.__name__}, {rung}"
            # A frame of a camera that sees nothing is infinite everywhere.
            for value, word, of_all in [
                (np.nan, "not a number", "not a number"),
                (-np.nan, "not a number", "not a number"),
                (np.inf, "infinite", "goes through the pad"),
            ]:
                yield refused(f"{what}: {value}", lambda r=render, v=value: r(v), gelsim.UsageError, word)
                yield refused(f"{what}: all {value}", lambda r=render, v=value: r(v, ...), ValueError, of_all)
            thickness = sensor.gelpad_thickness_mm

            def as_deep(result, render=render, thickness=thickness, dtype=dtype):
                finite(result)
                deep = render(thickness + 1)
                for name in ["tactile", "surface", "contact"]:
                    assert np.array_equal(result[name], deep[name]), name
                assert result["label"]["health"]["over_thickness_px"] == 1, result["label"]["health"]

            large = [thickness + 2, 1e6, 1e20, 3.4e38, *([1e39, 1e300, 1.7e308] if dtype is np.float64 else [])]
            for value in large:
                yield works(f"{what}: {value}", lambda r=render, v=value: r(v), as_deep)

            def as_nothing(result, render=render):
                for name in ["tactile", "surface", "contact"]:
                    assert np.array_equal(result[name], render(-np.inf)[name]), name

            for value in [-np.inf, -1e20, -3.4e38, *([-1e39, -1.7e308] if dtype is np.float64 else [])]:
                yield works(f"{what}: {value}", lambda r=render, v=value: r(v), as_nothing)
            for value in [-0.0, 1e-45, -1e-45, 1e-38, 5e-324, 1e-12]:
                yield works(f"{what}: {value}", lambda r=render, v=value: r(v), finite)
        nothing = np.full((ROWS, COLUMNS), -np.inf, dtype)
        yield works(f"{dtype.__name__}: nothing", lambda n=nothing: sensor.render(n))
        through = np.full((ROWS, COLUMNS), 1e30, dtype)
        yield refused(f"{dtype.__name__}: all through", lambda n=through: sensor.render(n), ValueError, "goes through")
        noise = np.random.default_rng(1)
        for number in range(20):
            bits = noise.integers(0, 256, ROWS * COLUMNS * np.dtype(dtype).itemsize, np.uint8).view(dtype)
            bits[number] = np.nan
            given = bits.reshape(ROWS, COLUMNS)
            clean = np.where(np.isfinite(given), given, -np.inf).astype(dtype)
            yield refused(
                f"{dtype.__name__}: random bits {number}", lambda g=given: sensor.render(g), ValueError, "depth_mm"
            )
            yield works(
                f"{dtype.__name__}: random numbers {number}",
                lambda g=clean: sensor.render(g, layers=LAYERS[1:]),
                finite,
            )
    noisy = gelsim.Sensor.preset("gelsight-mini", set=["camera.read_noise_levels=1.0"])
    maps = np.stack([ball()] * 3)
    for index in [0, 2**32, 2**53, 2**63, 2**64 - 1]:
        yield either(
            f"index {index} of a batch", lambda i=index: noisy.render(maps, index=i), "index", check=finite_batch
        )
    yield works("largest seed", lambda: sensor.render(ball(), seed=2**53 - 1), finite)
    yield refused("seed too large", lambda: sensor.render(ball(), seed=2**53), ValueError, "seed")


def finite_batch(batch):
    for label in batch["label"]:
        json.dumps(label, allow_nan=False)


def huge():
    """Arrays larger than memory, and lists longer than it: refused at once, and without taking any."""

    def frugal(call):
        def run():
            before, start = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.monotonic()
            try:
                return call()
            finally:
                taken = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) >> 10
                assert taken < SPARE_MB, f"{taken} MB"
                assert time.monotonic() - start < 20, f"{time.monotonic() - start} s"

        return run

    sensor.render(np.stack([ball()] * 4))
    for dtype in [np.float32, np.float64]:
        for shape in [
            (10**6, 10**6),
            (10**9, 2),
            (2, 10**9),
            (1, 8193),
            (8193, 1),
            (2**30, 2**29),
            (2**32 + 8, 8),
            (10**6, 10**6, 1),
            (10**6, 1, 10**6),
            (10**9, 8, 8),
            (10**12, 4, 4),
            (10**15, 1, 1),
            (2**33, 2, 2),
            (2**30, 8192, 8192 // 64),
        ]:
            given = np.broadcast_to(dtype(0.5), shape)
            call = frugal(lambda given=given: sensor.render(given, layers=LAYERS))
            yield refused(f"{dtype.__name__} {shape}", call, (ValueError, MemoryError), "depth_mm")
    kinds = (ValueError, TypeError, IndexError, MemoryError)
    for given in [range(10**9), range(10**15), range(-(10**12), 0), [10**9] * 1000]:
        for name in ["samples", "__getitems__"]:
            call = frugal(lambda name=name, given=given: getattr(job, name)(given))
            yield refused(f"{name} of {str(given)[:30]}", call, kinds, "sample")
    for samples in [10**9 + 1, 2**63, 2**64 - 1]:
        call = frugal(lambda samples=samples: gelsim.Job.load(job_path, samples=samples))
        yield refused(f"{samples} samples", call, ValueError, "samples")
    for threads in [0, 1025, 2**32, 2**63]:
        call = frugal(lambda threads=threads: gelsim.Job.load(job_path, threads=threads))
        yield refused(f"{threads} threads", call, ValueError, "threads")
    yield works("many threads", lambda: gelsim.Job.load(job_path, threads=300).samples(range(6)))


def in_threads(count, work):
    """Runs `work(number)` in so many threads at once; what they give, or the first exception."""
    found, start = [None] * count, threading.Barrier(count)

    def run(number):
        start.wait()
        try:
            found[number] = work(number)
        except BaseException as error:
            found[number] = error

    running = [threading.Thread(target=run, args=(number,)) for number in range(count)]
    for thread in running:
        thread.start()
    for thread in running:
        thread.join()
    for result in found:
        if isinstance(result, BaseException):
            raise result
    return found


def threads():
    """Many threads on one job and one sensor, on arrays that change, and on little stack."""
    maps = [ball(depth_mm=0.1 + 0.05 * number) for number in range(16)]
    truth = [sensor.render(depth, layers=LAYERS, index=7) for depth in maps]
    samples = job.samples(range(6))

    def each(got, want):
        for one, other in zip(got, want, strict=True):
            same(one, other)

    yield works(
        "one sensor, a map each",
        lambda: in_threads(16, lambda k: [sensor.render(maps[k], layers=LAYERS, index=7) for _ in range(10)]),
        lambda got: [each(several, [truth[k]] * 10) for k, several in enumerate(got)],
    )
    yield works(
        "one array",
        lambda: in_threads(16, lambda k: sensor.render(maps[3], layers=LAYERS, index=7)),
        lambda got: each(got, [truth[3]] * 16),
    )
    yield works(
        "batches",
        lambda: in_threads(8, lambda k: sensor.render(np.stack(maps[k : k + 3]))),
        lambda got: [each([{n: v[0] for n, v in b.items()}], [sensor.render(maps[k])]) for k, b in enumerate(got)],
    )
    yield works(
        "more resolutions and rungs than are kept",
        lambda: in_threads(12, lambda k: [sensor.render(ball(10 + k, 9 + j), fidelity="draft") for j in range(3)]),
        lambda got: [
            each(several, [sensor.render(ball(10 + k, 9 + j), fidelity="draft") for j in range(3)])
            for k, several in enumerate(got)
        ],
    )
    yield works("one job", lambda: in_threads(12, lambda k: job[k % 6]), lambda got: each(got, samples * 2))
    yield works(
        "several at a time",
        lambda: in_threads(6, lambda k: job.samples([k, 5 - k])),
        lambda got: [each(two, [samples[k], samples[5 - k]]) for k, two in enumerate(got)],
    )
    yield works(
        "other numbers of threads at once",
        lambda: in_threads(6, lambda k: gelsim.Job.load(job_path, threads=1 + k).samples(range(6))),
        lambda got: [each(several, samples) for several in got],
    )
    yield works("loads", lambda: in_threads(8, lambda k: pickle.loads(pickle.dumps(sensor)).render(maps[k])))
    shared = iter(job)
    yield works(
        "one iterator",
        lambda: list(itertools.chain(*in_threads(6, lambda k: list(shared)))),
        lambda got: each(sorted(got, key=lambda sample: sample["label"]["index"]), samples),
    )

    def now_and_then(given, value):
        given.fill(0.3)
        time.sleep(0.004)
        given[:, 3:9] = value
        time.sleep(0.001)

    def while_it_changes(change, count):
        given = np.stack(maps * 8)
        stop = threading.Event()
        thread = threading.Thread(target=lambda: [change(given) for _ in iter(stop.is_set, True)])
        thread.start()
        results = []
        try:
            for number in range(count):
                try:
                    results.append(sensor.render(given if number % 2 else given[0], layers=LAYERS))
                except SENSIBLE as error:
                    assert not NONSENSE.search(str(error)) and "depth_mm" in str(error), error
        finally:
            stop.set()
            thread.join()
        return results

    def sound(results):
        for result in results:
            whole(result["tactile"].shape[:-1])(result)

    noise = np.random.default_rng(1)
    for name, change in {
        "noise": lambda given: given.__setitem__(..., noise.random(given.shape, np.float32)),
        "NaN now and then": lambda given: now_and_then(given, np.nan),
        "inf now and then": lambda given: now_and_then(given, np.inf),
        "its shape": lambda given: [setattr(given, "shape", s) for s in [(given.size,), (16 * 8, ROWS, COLUMNS)]],
        "sorted": lambda given: given.ravel()[::-1].sort(),
    }.items():
        yield works(f"array that changes: {name}", lambda change=change: while_it_changes(change, 30), sound)

    def in_little_stack(size, work):
        before = threading.stack_size(size)
        try:
            return in_threads(2, work)
        finally:
            threading.stack_size(before)

    for size in [1 << 20, 256 << 10, 128 << 10]:
        yield works(
            f"a map on {size} bytes of stack", lambda s=size: in_little_stack(s, lambda k: sensor.render(maps[k]))
        )
        yield works(f"a sample on {size} bytes of stack", lambda s=size: in_little_stack(s, lambda k: job[k]))
        yield works(
            f"a job on {size} bytes of stack", lambda s=size: in_little_stack(s, lambda k: gelsim.Job.load(job_path))
        )


# What scripts begin with.
PRELUDE = """
import atexit, gc, itertools, multiprocessing, os, pickle, signal, sys, threading, time
import gelsim, numpy as np
sys.path.insert(0, HERE)
from attack import ball
def children(count, work):
    for number in range(count):
        child = os.fork()
        if child == 0:
            code = 1
            try:
                code = work(number) or 0
            finally:
                os._exit(code)
        deadline = time.monotonic() + 60
        while (ended := os.waitpid(child, os.WNOHANG)) == (0, 0):
            if time.monotonic() > deadline:
                os.kill(child, signal.SIGKILL)
                sys.exit("a child hangs")
            time.sleep(0.002)
        if ended[1]:
            sys.exit(f"a child ended with {ended[1]}")
def forever(work):
    def run():
        while True:
            work()
    threads = [threading.Thread(target=run, daemon=True) for _ in range(3)]
    for thread in threads:
        thread.start()
    time.sleep(0.3)
"""


def script(name, code, says="", status=0, patience_s=PATIENCE_S):
    """A program of its own, which ends with this status and says nothing but `says`."""

    def run():
        source = f"HERE, JOB = {str(Path(__file__).parent)!r}, {str(job_path)!r}\n{PRELUDE}\n{code}"
        done = subprocess.run(
            [sys.executable, "-c", source],
            capture_output=True,
            text=True,
            timeout=patience_s,
            cwd=root,
            errors="replace",
        )
        said = done.stdout + done.stderr
        assert done.returncode == status, f"status {done.returncode}: {said[-2000:]}"
        assert says in said, f"{says!r} is not in {said[-2000:]!r}"
        assert not re.search(r"fatal|panicked|Fatal", said), said[-2000:]
        assert says or status or not said, said[-2000:]

    return works(name, run)


BEGUN = """
sensor, job = gelsim.Sensor.preset("gelsight-mini"), gelsim.Job.load(JOB)
maps = np.stack([ball()] * 40)
truth, sample = sensor.render(maps)["tactile"].tobytes(), job.samples(range(6))[3]["tactile"].tobytes()
"""
# Maps of other proportions than the sensor's are warned of.
QUIET = "import warnings\nwarnings.simplefilter('ignore')\n"


def forks():
    """Processes that are forked and spawned, also at the worst of times."""
    child = """
def work(number):
    assert sensor.render(maps)["tactile"].tobytes() == truth
    assert job.samples(range(6))[3]["tactile"].tobytes() == sample and job[3]["tactile"].tobytes() == sample
    assert pickle.loads(pickle.dumps(sensor)).render(maps)["tactile"].tobytes() == truth
"""
    yield script("after a batch", BEGUN + child + "children(5, work)")
    yield script("a fork's fork", BEGUN + child + "children(2, lambda number: children(2, work))")
    yield script(
        "while maps are rendered",
        BEGUN + child + "forever(lambda: sensor.render(maps)); children(20, work); os._exit(0)",
    )
    yield script(
        "while samples are rendered",
        BEGUN + child + "forever(lambda: job.samples(range(6))); children(20, work); os._exit(0)",
    )
    yield script(
        "while simulators are made",
        BEGUN + child + QUIET + "sizes = itertools.count(8)\n"
        "forever(lambda: sensor.render(ball(8 + next(sizes) % 40, 20))); children(20, work); os._exit(0)",
    )
    yield script(
        "while jobs are loaded",
        BEGUN + child + "forever(lambda: gelsim.Job.load(JOB)); children(20, work); os._exit(0)",
    )
    # What a job's first sample prepares for all others is half done in the child.
    yield script(
        "while a job's first sample is rendered",
        """
wide = ['object=[{ path = "flat_face.obj" }]', "sensor.field_of_view_mm=[3.0, 2.25]", "indentation.depth_mm=0.4"]
for number in range(25):
    job = gelsim.Job.load(JOB, set=wide, threads=1)
    thread = threading.Thread(target=lambda: job[0], daemon=True)
    thread.start()
    time.sleep(0.002 * number)
    children(1, lambda number: job[1] and 0)
    thread.join()
""",
    )
    yield script(
        "multiprocessing",
        BEGUN
        + """
for method in ["fork", "spawn", "forkserver"]:
    with multiprocessing.get_context(method).Pool(2) as pool:
        assert all(batch["tactile"].tobytes() == truth for batch in pool.map(sensor.render, [maps] * 4))
        assert pool.map(job.sample, [3, 3])[0]["tactile"].tobytes() == sample
        try:
            pool.map(job.sample, [6])
            raise AssertionError
        except IndexError as error:
            assert "0 to 5" in str(error)
        try:
            pool.map(sensor.render, [maps * np.nan])
            raise AssertionError
        except gelsim.UsageError as error:
            assert "depth_mm" in str(error)
""",
    )
    yield script(
        "a worker is killed",
        BEGUN
        + """
child = os.fork()
if child == 0:
    forever(lambda: sensor.render(maps))
    time.sleep(60)
time.sleep(0.5)
os.kill(child, signal.SIGKILL)
os.waitpid(child, 0)
assert sensor.render(maps)["tactile"].tobytes() == truth
""",
    )


def pickles():
    """Pickles of every protocol, and damaged ones."""
    for what, thing in [("job", job), ("sensor", sensor)]:
        render = (lambda it: it[3]) if what == "job" else (lambda it: it.render(ball()))
        truth = render(thing)

        def right(it, render=render, truth=truth):
            same(render(it), truth)

        for protocol in range(pickle.HIGHEST_PROTOCOL + 1):
            yield works(
                f"{what}: protocol {protocol}", lambda p=protocol, t=thing: pickle.loads(pickle.dumps(t, p)), right
            )
        yield works(f"{what}: in Python", lambda t=thing: pickle._loads(pickle._dumps(t)), right)
        yield works(f"{what}: copy", lambda t=thing: copy.copy(t), right)
        yield works(f"{what}: deepcopy", lambda t=thing: copy.deepcopy([t, {1: t}])[0], right)
        text = pickle.dumps(thing)
        damaged = (
            ValueError,
            TypeError,
            OSError,
            MemoryError,
            LookupError,
            EOFError,
            AttributeError,
            ImportError,
            pickle.UnpicklingError,
            gelsim.RunError,
            OverflowError,
        )

        def load(data):
            return lambda: pickle.loads(data)

        for end in sorted({*range(0, len(text), max(1, len(text) // 40)), len(text) - 1}):
            yield refused(f"{what}: cut to {end} bytes", load(text[:end]), damaged)
        chance = random.Random(2)
        for number in range(120):
            data = bytearray(text)
            for _ in range(1 + number % 3):
                # Most of a job's pickle is its text; what stands before it is as often hit.
                place = chance.randrange(len(text)) if number % 2 else chance.choice([*range(60), *range(-20, 0)])
                data[place] ^= 1 << chance.randrange(8)
            # What comes of it is some other object, or none.
            yield Attack(f"{what}: flipped bits {number}", load(bytes(data)), lambda it: None, damaged)
        function, given = thing.__reduce__()
        for number in range(len(given)):
            for name, value in wrong_values():
                state = (*given[:number], value, *given[number + 1 :])
                yield either(f"{what}: {name} as argument {number}", lambda f=function, s=state: f(*s))
        yield refused(f"{what}: no arguments", lambda f=function: f(), TypeError, "required")
        yield refused(f"{what}: __setstate__", lambda t=thing: t.__setstate__({}), AttributeError)
        yield either(f"{what}: __reduce_ex__ of text", lambda t=thing: t.__reduce_ex__("x"))
        yield either(f"{what}: __reduce_ex__ of much", lambda t=thing: t.__reduce_ex__(10**30), kinds=(OverflowError,))
        kind = type(thing)
        newobj = pickle.PROTO + b"\x02c" + f"gelsim\n{kind.__name__}\n".encode() + b")\x81."
        yield refused(f"{what}: made by NEWOBJ", load(newobj), TypeError)
        built = text[:-1] + b"}(X\x01\x00\x00\x00aK\x01ub."
        yield refused(f"{what}: built with a state", load(built), (AttributeError, TypeError))


def objects():
    """Objects half made, changed, subclassed, and methods without theirs."""
    for kind, thing in [(gelsim.Job, job), (gelsim.Sensor, sensor)]:
        name = kind.__name__
        yield refused(f"{name}()", lambda k=kind: k(), TypeError)
        yield refused(f"{name}(1, a=2)", lambda k=kind: k(1, a=2), TypeError)
        yield refused(f"{name}.__new__", lambda k=kind: k.__new__(k), TypeError)
        yield refused(f"object.__new__ of {name}", lambda k=kind: object.__new__(k), TypeError)
        yield either(f"{name}.__init__", lambda t=thing: t.__init__(1, 2))
        yield refused(f"subclass of {name}", lambda k=kind: type("Sub", (k,), {}), TypeError)
        yield refused(f"subclass of {name} and dict", lambda k=kind: type("Sub", (k, dict), {}), TypeError)
        yield refused(f"class of {name}", lambda t=thing: setattr(t, "__class__", dict), TypeError)
        yield refused(
            f"becomes {name}", lambda k=kind: setattr(Claims(int), "__class__", k), (TypeError, AttributeError)
        )
        kinds = (AttributeError, TypeError)
        yield refused(f"{name}.new = 1", lambda t=thing: setattr(t, "new", 1), kinds)
        for attribute in ["name", "__class__", "__reduce__", "absent"]:
            yield refused(f"del {name}.{attribute}", lambda t=thing, a=attribute: delattr(t, a), kinds)
        yield refused(f"{name}.name = 1", lambda t=thing: setattr(t, "name", 1), kinds)
        yield refused(f"vars of {name}", lambda t=thing: vars(t), TypeError)
        for attribute, member in vars(kind).items():
            for other in [None, 1, Evil(), Claims(kind), kind, sensor if thing is job else job]:
                what = f"{name}.{attribute} of {type(other).__name__}"
                if hasattr(member, "__get__") and not isinstance(member, (staticmethod, str)):
                    if callable(member):
                        yield Attack(
                            what,
                            lambda m=member, o=other: m(o),
                            None if other is not kind else print,
                            (*SENSIBLE, Mischief),
                        )
                    elif not isinstance(other, type) and other is not None:
                        yield refused(what, lambda m=member, o=other: m.__get__(o), (TypeError, Mischief))
        for operation in ["lt", "add", "contains", "setitem", "call", "iadd", "eq", "hash", "index", "bool"]:
            function = {"call": lambda t, *_: t(), "hash": hash, "bool": bool}.get(operation) or getattr(
                operator, operation
            )

            def operate(function=function, thing=thing, operation=operation):
                count = {"setitem": 2, "hash": 0, "index": 0, "bool": 0}.get(operation, 1)
                return function(thing, *([0] * count))

            yield either(f"{operation} of {name}", operate)
        yield works(
            f"repr, dir, sizeof of {name}", lambda t=thing: (repr(t), dir(t), sys.getsizeof(t), str(t), format(t))
        )
        yield refused(f"weak reference to {name}", lambda t=thing: __import__("weakref").ref(t), TypeError)
    for kind in [gelsim.UsageError, gelsim.RunError]:
        yield works(f"{kind.__name__}()", lambda k=kind: (repr(k()), str(k(1, 2)), pickle.loads(pickle.dumps(k("x")))))
        yield works(f"subclass of {kind.__name__}", lambda k=kind: type("Sub", (k,), {})("x"))

    # An iterator that is dropped, copied or run dry.
    def dropped():
        walk = iter(job)
        next(walk)
        del walk
        walk = iter(gelsim.Job.load(job_path))
        return [next(walk), list(walk), list(walk)]

    yield works("iterator outlives its job", dropped, lambda got: equal(len(got[1]), 5) or equal(got[2], []))
    yield refused("reversed", lambda: list(reversed(job)), TypeError, "gelsim.Job")
    yield works("sum of an iterator", lambda: sum(1 for _ in zip(job, job)), lambda count: equal(count, 6))
    yield script(
        "members taken from the class",
        BEGUN
        + """
for kind in [gelsim.Job, gelsim.Sensor]:
    for name in list(vars(kind)):
        try:
            delattr(kind, name)
        except (TypeError, AttributeError):
            pass
calls = [lambda: job[0], lambda: list(job), lambda: sensor.render(maps), lambda: pickle.dumps(job)]
for call in calls:
    try:
        call()
    except (TypeError, AttributeError, pickle.PicklingError):
        pass
""",
    )
    yield script(
        "a result is all that is left",
        BEGUN
        + """
image = sensor.render(maps, layers=["surface"])["surface"]
copy = image.copy()
del sensor, job, gelsim
gc.collect()
view = image[3:, ::2]
del image
gc.collect()
assert (view == copy[3:, ::2]).all()
view[:] = 5
""",
    )


def endings():
    """The interpreter ends while others render, and objects outlive it."""
    works = {
        "maps": "sensor.render(maps[0])",
        "batches": "sensor.render(maps)",
        "samples": "job[3]",
        "several samples": "job.samples(range(6))",
        "an iterator": "list(job)",
        "loading": "gelsim.Job.load(JOB)",
        "mistakes": "sensor.render(maps[0], layers=[]) if os.getpid() < 0 else job.indices('train')",
    }
    for name, call in works.items():
        for repeat in range(3):
            yield script(f"daemon threads at exit: {name}, {repeat}", f"{BEGUN}\nforever(lambda: {call})")
        yield script(f"os._exit: {name}", f"{BEGUN}\nforever(lambda: {call})\nos._exit(0)")
        yield script(
            f"SIGTERM: {name}",
            f"{BEGUN}\nforever(lambda: {call})\nos.kill(os.getpid(), signal.SIGTERM)\ntime.sleep(60)",
            status=-15,
        )
        yield script(
            f"sys.exit in a thread: {name}",
            f"{BEGUN}\ndef run():\n    {call}\n    sys.exit(3)\nthreading.Thread(target=run).start()",
        )
        yield script(f"at exit: {name}", f"{BEGUN}\natexit.register(lambda: {call})")
        yield script(
            f"at exit beside daemon threads: {name}",
            f"{BEGUN}\nforever(lambda: {call})\natexit.register(lambda: {call})",
        )
        yield script(
            f"in __del__: {name}",
            f"""{BEGUN}
class Last:
    def __del__(self, sensor=sensor, job=job, maps=maps, gelsim=gelsim, JOB=JOB, os=os):
        try:
            {call}
        except (ImportError, TypeError, RuntimeError, AttributeError):
            pass
sys.keep = keep = Last()
loop = Last()
loop.loop = loop
""",
        )
        yield script(
            f"in a generator's end: {name}",
            f"""{BEGUN}
def walk(sensor=sensor, job=job, maps=maps, gelsim=gelsim, JOB=JOB, os=os):
    try:
        for sample in job:
            yield sample
    finally:
        try:
            {call}
        except (ImportError, TypeError, RuntimeError, AttributeError):
            pass
one = walk()
next(one)
two = walk()
next(two)
two.close()
""",
        )
    # Hardly any rendering, and much that is made for Python.
    tiny = "tiny = ball(2, 2)\nsys.setswitchinterval(1e-6)\nforever(lambda: sensor.render(tiny, fidelity='paper'))"
    for repeat in range(12):
        yield script(f"daemon threads at exit: tiny maps, {repeat}", BEGUN + QUIET + tiny)
    yield script(
        "a main thread that ends first", BEGUN + "threading.Thread(target=lambda: [job[k] for k in range(6)]).start()"
    )
    yield script("an uncaught mistake", BEGUN + "sensor.render(maps[0] * np.nan)", "UsageError: error: depth_mm", 1)
    yield script(
        "an executor",
        BEGUN
        + """
from concurrent.futures import ThreadPoolExecutor
executor = ThreadPoolExecutor(4)
futures = [executor.submit(sensor.render, maps) for _ in range(20)]
""",
    )


def signals():
    """A person who presses control and C."""
    interrupted = """
def after(seconds):
    threading.Thread(target=lambda: (time.sleep(seconds), os.kill(os.getpid(), signal.SIGINT)), daemon=True).start()
for seconds in [0.05, 0.2, 0.5]:
    after(seconds)
    start = time.monotonic()
    try:
        while True:
            WORK
    except KeyboardInterrupt:
        assert time.monotonic() - start < 20, time.monotonic() - start
assert sensor.render(maps)["tactile"].tobytes() == truth and job.samples(range(6))[3]["tactile"].tobytes() == sample
"""
    for name, call in {
        "a map": "sensor.render(maps[0])",
        "a batch": "sensor.render(np.broadcast_to(maps[0], (3000, *maps[0].shape)))",
        "a check of many maps": "sensor.render(np.broadcast_to(maps[0], (30000, *maps[0].shape)))",
        "samples": "job.samples([*range(6)] * 500)",
        "an iterator": "list(job)",
        "loading": "gelsim.Job.load(JOB)",
        "a large map": "sensor.render(ball(480, 640), fidelity='reference')",
    }.items():
        yield script(f"SIGINT: {name}", BEGUN + interrupted.replace("WORK", call))
    yield script(
        "an alarm every millisecond",
        BEGUN
        + """
count = 0
def tick(number, frame):
    global count
    count += 1
    if count < 100:
        sensor.render(maps[:2], fidelity="paper")
signal.signal(signal.SIGALRM, tick)
signal.setitimer(signal.ITIMER_REAL, 0.001, 0.001)
try:
    for _ in range(30):
        assert sensor.render(maps)["tactile"].tobytes() == truth
except RecursionError:
    pass
signal.setitimer(signal.ITIMER_REAL, 0)
assert count > 3
""",
    )


def recursion():
    """What Python runs in the midst of a call, which calls again."""
    yield script(
        "__index__",
        BEGUN
        + """
class Again:
    def __index__(self):
        return len(job.samples([self]))
for call in [lambda: job[Again()], lambda: job.samples([Again()]), lambda: sensor.render(maps[0], index=Again())]:
    try:
        call()
        raise AssertionError
    except RecursionError:
        pass
""",
    )
    yield script(
        "__fspath__",
        BEGUN
        + """
class Again:
    def __fspath__(self):
        return gelsim.Job.load(self)
try:
    gelsim.Job.load(Again())
    raise AssertionError
except RecursionError:
    pass
""",
    )
    yield script(
        "warnings",
        BEGUN
        + """
import warnings
def show(*given, **more):
    gelsim.Job.load(JOB, set=["indentation.depth_mm=1e-4"])
warnings.simplefilter("always")
warnings.showwarning = show
try:
    gelsim.Job.load(JOB, set=["indentation.depth_mm=1e-4"])
except RecursionError:
    pass
warnings.simplefilter("error")
try:
    gelsim.Job.load(JOB, set=["indentation.depth_mm=1e-4"])
    raise AssertionError
except UserWarning as warning:
    assert "micrometre" in str(warning)
""",
    )
    yield script(
        "a sequence that renders",
        BEGUN
        + """
class Walk(list):
    def __iter__(self):
        job.samples(range(6))
        return iter([1, 2])
assert len(job.samples(Walk([0]))) in [1, 2]
class Word(str):
    def __str__(self):
        return 1
    __len__ = __eq__ = __hash__ = lambda *_: 1 / 0
assert "surface" in sensor.render(maps[0], layers=[Word("surface")])
""",
    )
    yield script(
        "at the end of the stack",
        BEGUN
        + """
def down(left):
    return sensor.render(maps[0]) and job.samples([1]) if left == 0 else down(left - 1)
for left in range(900, 1000):
    try:
        down(left)
    except RecursionError:
        break
else:
    raise AssertionError
""",
    )
    yield script(
        "collected in the midst",
        BEGUN + "gc.set_threshold(1)\nassert sensor.render(maps)['tactile'].tobytes() == truth\nlist(job)",
    )
    yield script(
        "traced",
        BEGUN
        + """
sys.settrace(lambda *given: None)
sys.setprofile(lambda *given: job[0] if sys.getrecursionlimit() < 0 else None)
assert sensor.render(maps)["tactile"].tobytes() == truth
""",
    )


def surroundings():
    """A module, numpy and Python that are not as they should be, and machines that are full."""
    yield script(
        "loaded again",
        """
import importlib
for _ in range(3):
    for name in [name for name in sys.modules if name.startswith("gelsim")]:
        del sys.modules[name]
    try:
        again = importlib.import_module("gelsim")
    except ImportError as error:
        break
    assert again.Sensor.preset("gelsight-mini").render(ball())
    again.Job.load(JOB)[0]
""",
    )
    yield script(
        "another interpreter",
        """
try:
    import _interpreters as interpreters
except ImportError:
    try:
        import _xxsubinterpreters as interpreters
    except ImportError:
        sys.exit()
inner = interpreters.create()
try:
    interpreters.run_string(inner, "try:\\n    import gelsim\\nexcept ImportError:\\n    pass")
finally:
    interpreters.destroy(inner)
assert gelsim.Sensor.preset("gelsight-mini").render(ball())
""",
    )
    for what, code in {
        "empty": "",
        "only by name": "__version__ = '2.0.0'\nndarray = list",
        "without its capsule": "__version__ = '2.0.0'\nfloat32 = ndarray = int\nclass lib: pass",
        "raises": "raise RuntimeError('x')",
    }.items():
        folder = Path(tempfile.mkdtemp(dir=root))
        (folder / "numpy.py").write_text(code)
        source = f"""
import sys
sys.path.insert(0, {str(folder)!r})
import gelsim
for call in [lambda: gelsim.Sensor.preset("gelsight-mini"), lambda: gelsim.Job.load({str(job_path)!r}),
             lambda: gelsim._native._sensor_of_source("gelsight-mini", [], None)]:
    try:
        call()
        raise AssertionError
    except ImportError as error:
        assert "numpy" in str(error), error
"""

        def run(source=source):
            done = subprocess.run([sys.executable, "-c", source], capture_output=True, text=True, timeout=PATIENCE_S)
            assert done.returncode == 0, done.stderr[-2000:]

        yield works(f"numpy that is none: {what}", run)
    for name, code in {
        "json": "sys.modules['json'] = None",
        "warnings": "sys.modules['warnings'] = None",
        "multiprocessing": "sys.modules['multiprocessing'] = None",
        "gelsim._native": "sys.modules['gelsim._native'] = None",
        "builtins": "sys.modules['builtins'] = None",
        "numpy": "sys.modules['numpy'] = None",
        "json.loads": "import json; json.loads = lambda text: 1 / 0",
        "parent_process": "multiprocessing.parent_process = lambda: 1 / 0",
    }.items():
        yield script(
            f"broken: {name}",
            f"""{BEGUN}
import warnings
warnings.simplefilter("ignore")
{code}
shallow = ["indentation.depth_mm=1e-4"]
calls = [lambda: sensor.render(maps), lambda: job[0], lambda: job.samples([1]), lambda: list(job),
         lambda: pickle.dumps(job), lambda: gelsim.Job.load(JOB, set=shallow), lambda: gelsim.Sensor.preset("gelsight-mini")]
for call in calls:
    try:
        call()
    except (ImportError, ZeroDivisionError, AttributeError, TypeError, pickle.PicklingError):
        pass
os._exit(0)
""",
        )
    for limit, most in {"NOFILE": 8, "FSIZE": 0, "STACK": 1 << 20, "NPROC": 0}.items():
        yield script(
            f"no more {limit}",
            BEGUN
            + f"""
import resource
most = {most}
resource.setrlimit(resource.RLIMIT_{limit}, (most, most))
for call in [lambda: sensor.render(maps), lambda: job.samples(range(6)), lambda: gelsim.Job.load(JOB, threads=7)]:
    try:
        call()
    except (gelsim.RunError, gelsim.UsageError, OSError):
        pass
""",
        )
    lines = [
        "[]",
        "['gelsim']",
        "['gelsim', '--help']",
        "['gelsim', 'x' * 10**6]",
        r"['gelsim', 'a\0b']",
        r"['gelsim', '\udcff']",
        "['gelsim', 'plan', '/dev/zero']",
        "['gelsim', 'generate']",
        r"['gelsim', 'plan', '\ud800']",
    ]
    for line in lines:
        call = f"""
from gelsim._native import main
try:
    status = main({line})
    assert status in range(3), status
except (ValueError, TypeError):
    pass
print("went on")
"""
        yield script(f"main({line})", call, "went on")
        yield script(
            f"main({line}) without stdout",
            "os.close(1)\n" + call.replace('print("went on")', "os.write(2, b'went on')"),
            "went on",
        )
    for what, given in {
        "None": "None",
        "text": "'gelsim'",
        "numbers": "[1]",
        "endless": "itertools.count()",
        "bytes": "[b'gelsim', b'--version']",
    }.items():
        yield script(
            f"main of {what}",
            f"""
try:
    gelsim._native.main({given})
except TypeError as error:
    assert "argv" in str(error), error
print("went on")
""",
            "went on",
        )


# A pyramid, pressed and moved.
PRESSES = """
from attack import CORNERS_MM, FACES
simulator = gelsim.Simulator("gelsight-mini", "draft", resolution_px=(32, 24))
mesh = gelsim.Mesh(CORNERS_MM, FACES)
def slide(simulator, count=4):
    simulator.reset(friction=0.4)
    return [simulator.step(mesh, gelsim.Pose(0.4, x_mm=0.2 * k)).image.tobytes() for k in range(count)]
pressed, slid = simulator.press(mesh, gelsim.Pose(0.4)).image.tobytes(), slide(simulator)
"""


def simulations():
    """Presses and sequences: in threads, forked, interrupted, at the end, damaged, and of meshes that are none."""
    truth = simulator.press(mesh, gelsim.Pose(0.4)).sample()

    def stepped(simulator, count=4):
        simulator.reset(friction=0.4)
        return [simulator.step(mesh, gelsim.Pose(0.4, x_mm=0.2 * k)).sample() for k in range(count)]

    each = stepped(simulator)

    def all_same(got, want):
        for one, other in zip(got, want, strict=True):
            same(one, other)

    yield works(
        "presses of one simulator",
        lambda: in_threads(12, lambda k: [simulator.press(mesh, gelsim.Pose(0.4)).sample() for _ in range(5)]),
        lambda got: [all_same(several, [truth] * 5) for several in got],
    )
    yield works(
        "a layer that all read",
        lambda: (lambda press: in_threads(12, lambda k: press.points.tobytes()))(simulator.press(mesh, gelsim.Pose(0.4))),
        lambda got: equal(len(set(got)), 1),
    )
    yield works(
        "a sequence each",
        lambda: in_threads(8, lambda k: stepped(simulator.copy())),
        lambda got: [all_same(several, each) for several in got],
    )
    yield either("one sequence for all", lambda: in_threads(8, lambda k: stepped(simulator)), "another thread")
    yield works("the sequence after that", lambda: stepped(simulator), lambda got: all_same(got, each))

    def fuzzed():
        chance = np.random.default_rng(3)
        for _ in range(300):
            corners = chance.choice([0.0, 1.0, -1.0, 1e-30, 1e30, 1e6, np.nan, np.inf, chance.normal()], (chance.integers(1, 9), 3))
            faces = chance.integers(0, len(corners), (chance.integers(1, 12), 3))
            tilt = float(chance.uniform(-90, 90))
            pose = gelsim.Pose(float(chance.uniform(-1, 3)), tilt_deg=tilt, face=str(chance.choice(["-z", "+x", "-y"])))
            try:
                odd = gelsim.Mesh(corners, faces)
                for press in [simulator.press(odd, pose), simulator.step(odd, pose)]:
                    finite(press.sample())
            except gelsim.UsageError as error:
                assert not NONSENSE.search(str(error)), error
                simulator.reset()

    yield works("random meshes", fuzzed)

    def far():
        for value in [1e4, -1e4, 3999.9, 1e-9]:
            for name in ["x_mm", "y_mm"]:
                finite(simulator.press(mesh, gelsim.Pose(0.4, **{name: value})).sample())
                finite(simulator.step(mesh, gelsim.Pose(0.4, **{name: value})).sample())
        for value in [1e7, -1e7, 1e-300]:
            for place in range(2):
                at = [0.0, 0.0, -0.3]
                at[place] = value
                finite(simulator.press(mesh, gelsim.Placement(at)).sample())
                finite(simulator.step(mesh, gelsim.Placement(at)).sample())

    yield works("far away", far)
    for what, thing in [("mesh", mesh), ("impression", simulator.press(mesh, gelsim.Pose(0.4))), ("simulator", simulator)]:
        text = pickle.dumps(thing)
        kinds = (Exception,)

        def use(data):
            it = pickle.loads(data)
            if isinstance(it, gelsim.Mesh):
                it = simulator.press(it, gelsim.Pose(0.4))
            elif isinstance(it, gelsim.Simulator):
                it = it.press(mesh, gelsim.Pose(0.4))
            return it.image.tobytes() if isinstance(it, gelsim.Impression) else None

        yield works(f"{what}: pickled", lambda t=text, use=use: use(t), lambda got: equal(got, truth["tactile"].tobytes()))
        chance = random.Random(4)
        for number in range(80):
            data = bytearray(text)
            data[chance.randrange(len(text)) if number % 2 else chance.randrange(60)] ^= 1 << chance.randrange(8)
            yield Attack(f"{what}: flipped bits {number}", lambda d=bytes(data), use=use: use(d), lambda it: None, kinds)
    child = """
def work(number):
    assert simulator.press(mesh, gelsim.Pose(0.4)).image.tobytes() == pressed
    try:
        assert slide(simulator) == slid
    except gelsim.RunError as error:
        assert "another thread" in str(error)
    assert slide(simulator.copy()) == slid
    assert slide(pickle.loads(pickle.dumps(simulator))) == slid
"""
    quiet = """
def again():
    try:
        slide(simulator)
    except gelsim.RunError:
        pass
"""
    yield script("after steps", PRESSES + child + "children(4, work)")
    yield script("while frames are stepped", PRESSES + quiet + child + "forever(again); children(20, work); os._exit(0)")
    for repeat in range(3):
        yield script(f"daemon threads at exit: steps, {repeat}", PRESSES + quiet + "forever(again)")
        yield script(f"daemon threads at exit: presses, {repeat}", PRESSES + "forever(lambda: simulator.press(mesh, gelsim.Pose(0.4)))")
        yield script(
            f"daemon threads at exit: generate, {repeat}",
            "numbers = itertools.count()\nforever(lambda: gelsim.generate(JOB, f'exit-{os.getpid()}-{next(numbers)}', threads=1))",
        )
    yield script(
        "SIGINT: generate",
        """
def after(seconds):
    threading.Thread(target=lambda: (time.sleep(seconds), os.kill(os.getpid(), signal.SIGINT)), daemon=True).start()
for seconds in [0.05, 0.2, 0.5]:
    after(seconds)
    start = time.monotonic()
    try:
        gelsim.generate(JOB, f"stopped-{seconds}", samples=200000, threads=2)
        raise AssertionError
    except KeyboardInterrupt:
        assert time.monotonic() - start < 20, time.monotonic() - start
assert gelsim.generate(JOB, "whole", threads=2).complete
""",
    )
    yield script(
        "generate in a forked process",
        """
gelsim.generate(JOB, "before", threads=2)
children(3, lambda number: (gelsim.generate(JOB, f"forked-{number}"), 0)[1])
assert gelsim.load("forked-0").fingerprint == gelsim.load("before").fingerprint
""",
    )


def metres():
    """Depth in metres is noted, once for a place, and nothing else is."""

    def noted(call):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("default")
            call()
        return [str(warning.message) for warning in caught]

    def says(notes):
        assert len(notes) == 1 and "depth_mm" in notes[0] and "metres" in notes[0], notes

    def silent(notes):
        assert notes == [], notes

    in_mm = ball()
    in_m = np.where(np.isinf(in_mm), in_mm, in_mm * 1e-3)
    for dtype in [np.float32, np.float64]:
        for what, given in {
            "a map": in_m,
            "a batch": np.stack([in_m, in_m / 2]),
            "1.9 mm": np.where(in_m > 0, 1.9e-3, 0),
        }.items():
            given = given.astype(dtype)
            yield works(f"{what} in metres, {dtype.__name__}", lambda g=given: noted(lambda: sensor.render(g)), says)
        for what, given in {
            "millimetres": in_mm,
            "one map of two": np.stack([in_m, in_mm]),
            "nothing": np.full_like(in_mm, -np.inf),
            "zeros": np.zeros_like(in_mm),
            "only above": -np.abs(np.nan_to_num(in_m, neginf=1.0)),
            "10 um": in_mm * 0.02,
        }.items():
            given = given.astype(dtype)
            yield works(f"{what}, {dtype.__name__}", lambda g=given: noted(lambda: sensor.render(g)), silent)

    def three_times():
        for factor in [1.0, 0.9, 0.8]:
            sensor.render(in_m * factor)

    yield works("three times at one place", lambda: noted(three_times), says)

    def as_error():
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            sensor.render(in_m)

    yield refused("warnings are errors", as_error, UserWarning, "metres")
    yield works(
        "a job in metres",
        lambda: noted(lambda: gelsim.Job.load(job_path, set=["indentation.depth_mm=5e-4"])),
        lambda notes: equal(any("micrometre" in note for note in notes), True),
    )


FAMILIES = {
    family.__name__: family
    for family in [
        arguments, files, arrays, values, huge, threads, forks, pickles, objects, endings, signals, recursion,
        surroundings, simulations, metres,
    ]
}  # fmt: skip


def child(family, first, log):
    """Runs the attacks of a family from one on; says in `log` what became of each."""
    resource.setrlimit(resource.RLIMIT_AS, (MOST_BYTES, MOST_BYTES))
    with open(log, "a") as log:
        for number, attack in enumerate(FAMILIES[family]()):
            if number < first:
                continue
            print(json.dumps([number, attack.name, "begun"]), file=log, flush=True)
            # What hangs is ended from a thread that needs no lock of Python's.
            faulthandler.dump_traceback_later(PATIENCE_S + 30, exit=True)
            try:
                said = attack.outcome()
            except AssertionError as error:
                said = str(error) or traceback.format_exc()
            except BaseException:
                said = traceback.format_exc()
            print(json.dumps([number, attack.name, said]), file=log, flush=True)
            if said not in ["result", "exception"]:
                print(f"{family}: {attack.name}: {said[:600]}", file=sys.stderr, flush=True)
        faulthandler.cancel_dump_traceback_later()
        print(json.dumps([-1, "", "done"]), file=log, flush=True)


def run(family):
    """What became of each attack of a family."""
    outcomes, first = {}, 0
    log = Path(root) / f"{family}.log"
    while True:
        log.write_text("")
        command = [sys.executable, __file__, "--child", family, str(first), str(log), root]
        done = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, errors="replace")
        lines = [json.loads(line) for line in log.read_text().splitlines()]
        outcomes |= {name: said for number, name, said in lines if number >= 0}
        if lines and lines[-1][0] == -1:
            return outcomes
        assert lines, f"{family} does not begin: {done.stderr[-3000:]}"
        number, name, said = lines[-1]
        assert said == "begun", f"{family} ended after {name}: {done.returncode} {done.stderr[-3000:]}"
        outcomes[name] = f"CRASH {done.returncode}: {done.stderr[-1500:]}"
        first = number + 1


def prepare(folder):
    """The job and the sensor that are attacked."""
    global root, job_path, sensor_path, job, sensor, simulator, mesh
    root, job_path, sensor_path = folder, Path(folder) / "job.toml", Path(folder) / "sensor.toml"
    if not job_path.exists():
        job_path.write_text(JOB.replace("OBJECTS/", ""))
        sensor_path.write_text('preset = "gelsight-mini"\n')
        for name in ["sphere.obj", "gear.obj", "flat_face.obj"]:
            (Path(folder) / name).write_bytes(Path("objects", name).read_bytes())
    job, sensor = gelsim.Job.load(job_path), gelsim.Sensor.preset("gelsight-mini")
    simulator = gelsim.Simulator(sensor, "draft", resolution_px=(COLUMNS, ROWS))
    mesh = gelsim.Mesh(CORNERS_MM, FACES)


def main():
    # A shell starts what runs in the background with SIGINT ignored, and Python leaves it so.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    if sys.argv[1:2] == ["--child"]:
        prepare(sys.argv[5])
        # What is written to a path that is none shall not lie in the project.
        os.chdir(root)
        child(sys.argv[2], int(sys.argv[3]), sys.argv[4])
        return
    with tempfile.TemporaryDirectory() as folder:
        prepare(folder)
        counts = collections.Counter()
        for family in sys.argv[1:] or FAMILIES:
            start, outcomes = time.monotonic(), run(family)
            found = collections.Counter()
            for name, said in outcomes.items():
                kind = said if said in ["result", "exception"] else "crash" if said.startswith("CRASH") else "wrong"
                found[kind] += 1
                if kind in ["crash", "wrong"]:
                    print(f"{family}: {name}: {said}")
            counts += found
            print(f"{family}: {dict(found)} in {time.monotonic() - start:.0f} s", flush=True)
    wrong = f", {counts['wrong']} wrong" if counts["wrong"] else ""
    sound = f"{counts['result']} results, {counts['exception']} exceptions"
    print(f"{counts.total()} attacks: {sound}, {counts['crash']} crashes{wrong}")
    sys.exit(1 if counts["crash"] or counts["wrong"] else 0)


if __name__ == "__main__":
    main()
