"""Arrays of every kind, shape and value, and larger than memory."""

import ctypes
import mmap
import multiprocessing.shared_memory
import re
import time
import warnings

import pytest

gelsim = pytest.importorskip("gelsim", reason="the module is not installed: pip install .")

import numpy as np
from mischief import COLUMNS, LAYERS, REFUSED, ROWS, Mischief
from mischief import attempt, ball, converting, look_at_layers, look_at_numbers, refused
from module_checks import LEVELS, same, warned

pytestmark = [pytest.mark.full, pytest.mark.wheel, pytest.mark.filterwarnings("ignore")]

# Memory that attacks which are to be refused may take, MB.
SPARE_MB = 200


@pytest.fixture(scope="module", params=["map", "batch"])
def one(request):
    """One map, or two."""
    return ball() if request.param == "map" else np.stack([ball(), ball(depth_mm=0.2)])


@pytest.fixture(scope="module")
def truth(the, one):
    return the.sensor.render(one, layers=LAYERS)


def filled(empty, one, place=...):
    """Something that has the map at a place."""
    empty[place] = one
    return empty


def every_third(one):
    wide = np.full((*one.shape[:-1], 3 * one.shape[-1]), np.nan, np.float32)
    return filled(wide, one, (..., slice(1, None, 3)))[..., 1::3]


def backwards(one):
    flipped = (slice(None, None, -1),) * one.ndim
    return one[flipped].copy()[flipped]


def read_only(one):
    given = one.copy()
    given.flags.writeable = False
    return given


def over(buffer, one):
    return np.frombuffer(buffer, np.float32).reshape(one.shape)


def records(one):
    return filled(np.zeros(one.shape, [("a", np.int32), ("depth", np.float32)]), one, "depth")


LAYOUTS = {
    "float64": lambda one: one.astype(np.float64),
    "Fortran order": np.asfortranarray,
    "transposed": lambda one: one.T.copy().T,
    "every third": every_third,
    "negative strides": backwards,
    "read-only": read_only,
    "over bytes": lambda one: over(one.tobytes(), one),
    "over a bytearray": lambda one: over(bytearray(one.tobytes()), one),
    "over an anonymous map": lambda one: over(filled(mmap.mmap(-1, one.nbytes), one.tobytes(), slice(None)), one),
    "over ctypes": lambda one: over((ctypes.c_float * one.size).from_buffer_copy(one.tobytes()), one),
    "field of records": lambda one: records(one)["depth"],
    "real part": lambda one: one.astype(np.complex64).real,
    "recarray's field": lambda one: records(one).view(np.recarray).depth,
    "subclass": lambda one: one.view(type("Sub", (np.ndarray,), {})),
    "writes 0 as -0": lambda one: np.where(one == 0, np.float32(-0.0), one),
    "native byte order": lambda one: one.astype("=f4"),
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_layout_does_not_matter(the, one, truth, layout):
    same(the.sensor.render(LAYOUTS[layout](one), layers=LAYERS), truth)


@pytest.mark.parametrize("mode", ["r", "r+", "c"])
def test_a_file_may_be_mapped(the, one, truth, tmp_path, mode):
    np.save(tmp_path / "map.npy", one)
    same(the.sensor.render(np.load(tmp_path / "map.npy", mmap_mode=mode), layers=LAYERS), truth)


def test_memory_may_be_shared(the, one, truth):
    block = multiprocessing.shared_memory.SharedMemory(create=True, size=one.nbytes)
    try:
        same(the.sensor.render(filled(np.ndarray(one.shape, np.float32, block.buf), one), layers=LAYERS), truth)
    finally:
        block.unlink()


def test_a_matrix_is_a_map(the):
    same(the.sensor.render(ball().view(np.matrix), layers=LAYERS), the.sensor.render(ball(), layers=LAYERS))


@pytest.mark.parametrize("dtype", "? b B h H i I l L q Q e g F D G O S8 U8 V4 M8[s] m8[s] >f4 >f8 >i2".split())
def test_another_type_is_named(the, one, dtype):
    refused(lambda: the.sensor.render(np.zeros(one.shape, dtype), layers=LAYERS), TypeError, "depth_mm is")


class Lying(np.ndarray):
    """Says that it lies right, and elsewhere."""

    flags = type("Flags", (), {"aligned": True})()
    shape = (1 << 40, 1 << 40)
    dtype = np.dtype("f4")
    ndim = 1


class Raising(np.ndarray):
    def __getattribute__(self, name):
        raise Mischief(name)


def packed(one):
    return np.zeros(one.shape, [("a", np.int8), ("depth", np.float32)])["depth"]


def interface(one, **more):
    return type("A", (), {"__array_interface__": {**one.__array_interface__, **more}})()


NO_MAPS = {
    "structured": records,
    "masked": lambda one: np.ma.masked_less(one, 0.1),
    "not aligned": packed,
    "lies about its place": lambda one: packed(one).view(Lying),
    "list": lambda one: one.tolist(),
    "memoryview": memoryview,
    "bytes": lambda one: one.tobytes(),
    "__array__": lambda one: converting("__array__", one),
    "__array__ raises": lambda one: converting("__array__", Mischief("array")),
    "__dlpack__": lambda one: converting("__dlpack__", one.__dlpack__()),
    "scalar": lambda one: one.ravel()[0],
    "array of objects": lambda one: np.full(one.shape, None),
    "flat iterator": lambda one: one.flat,
    "array's class": lambda one: np.ndarray,
    "__array_interface__": interface,
    "__array_interface__ of nowhere": lambda one: interface(one, data=(8, False)),
}
WHY = {"masked": "filled", "not aligned": "not aligned", "lies about its place": "not aligned"}


@pytest.mark.parametrize("what", NO_MAPS)
def test_what_is_no_map_is_refused(the, one, what):
    given, why = NO_MAPS[what](one), WHY.get(what, "depth_mm is")
    refused(lambda: the.sensor.render(given, layers=LAYERS), ValueError if why == "not aligned" else TypeError, why)


def test_an_array_that_lies_about_its_shape_is_the_array(the, one, truth):
    same(the.sensor.render(one.view(Lying), layers=LAYERS), truth)


def test_an_array_that_raises_is_the_array_or_refused(the, one, truth):
    given = attempt(lambda: the.sensor.render(one.view(Raising), layers=LAYERS))
    if given is not REFUSED:
        same(given, truth)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize(
    "shape",
    [(), (0,), (24,), (0, 0), (0, 5), (5, 0), (0, 5, 5), (2, 0, 5), (2, 5, 0), (1,) * 4, (1,) * 32, (9, 9, 9, 9)],
    ids=str,
)
def test_a_shape_that_is_no_maps_is_named(the, shape, dtype):
    given = np.zeros(shape, dtype)
    refused(lambda: the.sensor.render(given, layers=LAYERS), ValueError, "depth_mm has", "depth_mm is empty")


@pytest.mark.parametrize(
    "shape",
    [(1, 1), (1, 2), (2, 1), (1, 300), (300, 1), (1, 1, 1), (3, 1, 7), (3, 7, 1), (70, 2, 2), (2, 8192), (8192, 2)],
    ids=str,
)
def test_an_odd_shape_works_or_has_pixels_too_long(the, shape):
    given = attempt(lambda: the.sensor.render(np.full(shape, 0.3, np.float32), layers=LAYERS), "field_of_view", "px")
    if given is not REFUSED:
        look_at_layers(given, shape)


@pytest.fixture(params=LEVELS)
def render(the, request):
    """Renders a map in which one pixel has a value, or all."""
    layers = [name for name in LAYERS if name != "pressure" or request.param != "paper"]

    def render(dtype, value, place=(10, 12)):
        depth = ball().astype(dtype)
        depth[place] = value
        return the.sensor.render(depth, fidelity=request.param, layers=layers)

    return render


def numbers(values, larger=()):
    """Values of both types, and those that only float64 can hold."""
    cases = [(np.float32, value) for value in values] + [(np.float64, value) for value in [*values, *larger]]
    return pytest.mark.parametrize("dtype, value", cases)


@numbers([np.nan, -np.nan, np.inf])
def test_a_value_that_is_no_depth_is_named(render, dtype, value):
    # A frame of a camera that sees nothing is infinite everywhere.
    word, of_all = ("infinite", "goes through the pad") if value == np.inf else ("not a number", "not a number")
    refused(lambda: render(dtype, value), gelsim.UsageError, word)
    refused(lambda: render(dtype, value, ...), ValueError, of_all)


@numbers([6.0, 1e6, 1e20, 3.4e38], [1e39, 1e300, 1.7e308])
def test_deeper_than_the_pad_is_as_deep_as_the_pad(the, render, dtype, value):
    assert the.sensor.gelpad_thickness_mm < 5.0
    given, deep = render(dtype, value), render(dtype, the.sensor.gelpad_thickness_mm + 1)
    look_at_numbers(given)
    for name in ["tactile", "surface", "contact"]:
        assert np.array_equal(given[name], deep[name]), name
    assert given["label"]["health"]["over_thickness_px"] == 1


@numbers([-np.inf, -1e20, -3.4e38], [-1e39, -1.7e308])
def test_far_above_the_pad_is_nothing(render, dtype, value):
    given, nothing = render(dtype, value), render(dtype, -np.inf)
    for name in ["tactile", "surface", "contact"]:
        assert np.array_equal(given[name], nothing[name]), name


@numbers([-0.0, 1e-45, -1e-45, 1e-38, 5e-324, 1e-12])
def test_a_tiny_value_is_a_depth(render, dtype, value):
    look_at_numbers(render(dtype, value))


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_a_map_of_nothing_works_and_one_all_through_the_pad_is_refused(the, dtype):
    the.sensor.render(np.full((ROWS, COLUMNS), -np.inf, dtype))
    refused(lambda: the.sensor.render(np.full((ROWS, COLUMNS), 1e30, dtype)), ValueError, "goes through")


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("number", range(20))
def test_random_bits_are_refused_and_random_numbers_work(the, number, dtype):
    size = ROWS * COLUMNS * np.dtype(dtype).itemsize
    given = np.random.default_rng(number).integers(0, 256, size, np.uint8).view(dtype).reshape(ROWS, COLUMNS)
    given[0, number] = np.nan
    refused(lambda: the.sensor.render(given), ValueError, "depth_mm")
    clean = np.where(np.isfinite(given), given, -np.inf).astype(dtype)
    look_at_numbers(the.sensor.render(clean, layers=LAYERS[1:]))


@pytest.mark.parametrize("index", [0, 2**32, 2**53, 2**63, 2**64 - 1])
def test_an_index_of_a_batch_works_or_is_named(index):
    noisy = gelsim.Sensor.preset("gelsight-mini", set=["camera.read_noise_levels=1.0"])
    batch = attempt(lambda: noisy.render(np.stack([ball()] * 3), index=index), "index")
    for label in batch["label"] if batch is not REFUSED else []:
        look_at_numbers({"label": label})


def test_a_seed_has_53_bits(the):
    look_at_numbers(the.sensor.render(ball(), seed=2**53 - 1))
    refused(lambda: the.sensor.render(ball(), seed=2**53), ValueError, "seed")


def peak_mb():
    """The most memory that this process had since `frugally` began."""
    return int(re.search(r"VmHWM:\s+(\d+)", open("/proc/self/status").read())[1]) >> 10


def frugally(call, kinds, *words):
    """A call is refused at once, and without taking memory."""
    open("/proc/self/clear_refs", "w").write("5")
    before, start = peak_mb(), time.monotonic()
    refused(call, kinds, *words)
    assert peak_mb() - before < SPARE_MB
    assert time.monotonic() - start < 20


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize(
    "shape",
    [
        (10**6, 10**6), (10**9, 2), (2, 10**9), (1, 8193), (8193, 1), (2**30, 2**29), (2**32 + 8, 8),
        (10**6, 10**6, 1), (10**6, 1, 10**6), (10**9, 8, 8), (10**12, 4, 4), (10**15, 1, 1), (2**33, 2, 2),
        (2**30, 8192, 128),
    ],
    ids=str,
)  # fmt: skip
def test_an_array_larger_than_memory_is_refused(the, shape, dtype):
    the.sensor.render(np.stack([ball()] * 4))
    given = np.broadcast_to(dtype(0.5), shape)
    frugally(lambda: the.sensor.render(given, layers=LAYERS), (ValueError, MemoryError), "depth_mm")


@pytest.mark.parametrize("name", ["samples", "__getitems__"])
@pytest.mark.parametrize(
    "indices",
    [range(10**9), range(10**15), range(-(10**12), 0), [10**9] * 1000],
    ids=["10**9", "10**15", "negative", "list"],
)
def test_indices_longer_than_memory_are_refused(the, name, indices):
    frugally(lambda: getattr(the.job, name)(indices), (ValueError, TypeError, IndexError, MemoryError), "sample")


@pytest.mark.parametrize("samples", [10**9 + 1, 2**63, 2**64 - 1])
def test_more_samples_than_there_may_be_are_refused(the, samples):
    frugally(lambda: gelsim.Job.load(the.job_path, samples=samples), ValueError, "samples")


@pytest.mark.parametrize("threads", [0, 1025, 2**32, 2**63])
def test_more_threads_than_there_may_be_are_refused(the, threads):
    frugally(lambda: gelsim.Job.load(the.job_path, threads=threads), ValueError, "threads")


def test_many_threads_work(the):
    assert len(gelsim.Job.load(the.job_path, threads=300).samples(range(6))) == 6


IN_MM = ball()
IN_M = np.where(np.isinf(IN_MM), IN_MM, IN_MM * 1e-3)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
class TestMetres:
    """Depth in metres is warned of, and nothing else is."""

    @pytest.mark.parametrize(
        "given",
        [
            pytest.param(IN_M, id="a map"),
            pytest.param(np.stack([IN_M, IN_M / 2]), id="a batch"),
            pytest.param(np.where(IN_M > 0, 1.9e-3, 0), id="1.9 mm"),
        ],
    )
    def test_are_warned_of(self, the, dtype, given):
        _, said = warned(lambda: the.sensor.render(given.astype(dtype)))
        assert len(said) == 1 and "depth_mm" in said[0] and "metres" in said[0], said

    @pytest.mark.parametrize(
        "given",
        [
            pytest.param(IN_MM, id="millimetres"),
            pytest.param(np.stack([IN_M, IN_MM]), id="one map of two"),
            pytest.param(np.full_like(IN_MM, -np.inf), id="nothing"),
            pytest.param(np.zeros_like(IN_MM), id="zeros"),
            pytest.param(-np.abs(np.nan_to_num(IN_M, neginf=1.0)), id="only above"),
            pytest.param(IN_MM * 0.02, id="10 um"),
        ],
    )
    def test_are_not_seen_in(self, the, dtype, given):
        assert warned(lambda: the.sensor.render(given.astype(dtype)))[1] == []


def test_a_warning_is_told_once_for_a_place(the):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("default")
        for factor in [1.0, 0.9, 0.8]:
            the.sensor.render(IN_M * factor)
    assert len(caught) == 1 and "metres" in str(caught[0].message)


def test_a_warning_may_be_an_error(the):
    with warnings.catch_warnings(), pytest.raises(UserWarning, match="metres"):
        warnings.simplefilter("error")
        the.sensor.render(IN_M)


def test_a_job_in_metres_is_warned_of(the):
    _, said = warned(lambda: gelsim.Job.load(the.job_path, set=["indentation.depth_mm=5e-4"]))
    assert any("micrometre" in text for text in said), said
