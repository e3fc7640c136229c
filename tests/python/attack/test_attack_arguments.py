"""Wrong arguments, files, pickles and objects."""

import copy
import operator
import os
import pickle
import random
import sys
import weakref

import pytest

gelsim = pytest.importorskip("gelsim", reason="the module is not installed: pip install .")

from mischief import CORNERS_MM, FACES, REFUSED, SENSIBLE, WRONG, Claims, Evil, Mischief
from mischief import attempt, ball, refused, wrong_values
from module_checks import same

pytestmark = [pytest.mark.full, pytest.mark.wheel, pytest.mark.filterwarnings("ignore")]

# The words by which a message may name an argument of a function.
PATH, LEVEL = "path|is not UTF-8|cannot be read|cannot read", "fidelity|level"
INDENTER = "indenter|path|depth_mm|vertices|faces|cannot be read|mesh|heights"
ASSIGNED = {"set": "set", "threads": "threads"}
FLAGS = {"samples": "samples", "seed": "seed", "all_effects": "all_effects", **ASSIGNED}
SURFACE = {"texture": "texture", "shear": "shear|flow", "friction": "friction"}
MATERIAL = {"youngs_modulus_kpa": "youngs_modulus_kpa", "poisson_ratio": "poisson_ratio"}
DRAWN = {"index": "index", "seed": "seed"}
OVERWRITE = {"overwrite": "overwrite"}
PARTS = {"sensor": f"sensor|name|{PATH}", "fidelity": "fidelity", "set": "set"}
NAMES = {
    "Job.load": {"path": PATH, "fidelity": LEVEL, **FLAGS},
    "job.sample": {"index": "index|sample"},
    "job.samples": {"indices": "indices|index|sample"},
    "job.__getitem__": {"index": "index|sample"},
    "job.__getitems__": {"indices": "indices|index|sample"},
    "job.indices": {"split": "split"},
    "Sensor.preset": {"name": "name|preset", **ASSIGNED},
    "Sensor.load": {"path": PATH, **ASSIGNED},
    "sensor.render": {"depth_mm": "depth_mm", "fidelity": LEVEL, "layers": "layers|layer", **DRAWN},
    "sensor.with_leds": {"leds": "leds|LED"},
    "_job_of_text": {"text": "text|TOML|missing key", "threads": "threads"},
    "_sensor_of_source": {"source": "source|sensor|preset|read", **ASSIGNED},
    "Simulator": {**PARTS, "resolution_px": "resolution_px", "flow": "flow"},
    "simulator.press": {"indenter": INDENTER, "pose": "pose", **SURFACE, **MATERIAL, **DRAWN},
    "simulator.step": {"indenter": INDENTER, "pose": "pose", "texture": "texture", "duration_s": "duration_s"},
    "simulator.reset": {"friction": "friction", **DRAWN},
    "impression.sample": {"layers": "layers|layer"},
    "Mesh": {"vertices_mm": "vertices_mm", "faces": "faces", "name": "name"},
    "Mesh.load": {"path": "path|cannot be read|mesh", "mm_per_unit": "mm_per_unit"},
    "Mesh.of": {"given": "mesh"},
    "generate": {"job": f"job|{PATH}", "out": "out|x: |dataset", "fidelity": "fidelity", **FLAGS, **OVERWRITE},
}
for kind in [gelsim.Pose, gelsim.Placement, gelsim.Texture, gelsim.Shear, gelsim.Led, gelsim.LightPattern]:
    NAMES[kind.__name__] = {field: field for field in kind.__dataclass_fields__}
ARGUMENTS = [pytest.param(label, name, id=f"{label}-{name}") for label, names in NAMES.items() for name in names]


@pytest.fixture(scope="module")
def functions(the):
    """Each function, and arguments that are right."""
    native, press = gelsim._native, {"indenter": the.mesh, "pose": gelsim.Pose(0.3)}
    generated = {"job": the.job_path, "out": the.folder / "generated", "samples": 1, "overwrite": True}
    simulator = {"sensor": "gelsight-mini", "fidelity": "draft", "resolution_px": (32, 24)}
    return {
        "Job.load": (gelsim.Job.load, {"path": the.job_path}),
        "job.sample": (the.job.sample, {}),
        "job.samples": (the.job.samples, {}),
        "job.__getitem__": (lambda index: the.job[index], {}),
        "job.__getitems__": (lambda indices: the.job.__getitems__(indices), {}),
        "job.indices": (the.job.indices, {}),
        "Sensor.preset": (gelsim.Sensor.preset, {"name": "gelsight-mini"}),
        "Sensor.load": (gelsim.Sensor.load, {"path": the.sensor_path}),
        "sensor.render": (the.sensor.render, {"depth_mm": ball()}),
        "sensor.with_leds": (the.sensor.with_leds, {"leds": the.sensor.leds}),
        "_job_of_text": (native._job_of_text, {"text": the.job.__reduce__()[1][0], "threads": None}),
        "_sensor_of_source": (native._sensor_of_source, {"source": "gelsight-mini", "set": [], "threads": None}),
        "Simulator": (gelsim.Simulator, simulator),
        "simulator.press": (the.simulator.press, press),
        "simulator.step": (the.simulator.step, press),
        "simulator.reset": (the.simulator.reset, {}),
        "impression.sample": (the.simulator.press(**press).sample, {}),
        "Mesh": (gelsim.Mesh, {"vertices_mm": CORNERS_MM, "faces": FACES}),
        "Mesh.load": (gelsim.Mesh.load, {"path": the.folder / "flat_face.obj"}),
        "Mesh.of": (gelsim.Mesh.of, {}),
        "generate": (gelsim.generate, generated),
        "Pose": (gelsim.Pose, {"depth_mm": 0.3}),
        "Placement": (gelsim.Placement, {"translation_mm": (0, 0, 0)}),
        "Texture": (gelsim.Texture, {"pattern": "noise"}),
        "Shear": (gelsim.Shear, {}),
        "Led": (gelsim.Led, {"azimuth_deg": 0.0}),
        "LightPattern": (gelsim.LightPattern, {}),
    }


@pytest.mark.parametrize("what", WRONG)
@pytest.mark.parametrize("label, name", ARGUMENTS)
def test_a_wrong_argument_is_named_or_taken(functions, label, name, what):
    function, right = functions[label]
    given = {**right, name: wrong_values()[what]}
    # And what Python says of an object that counts less than nothing.
    attempt(lambda: function(**given), *NAMES[label][name].split("|"), "should return >= 0")


@pytest.mark.parametrize("label", NAMES)
def test_arguments_that_there_are_none_of_are_refused(functions, label):
    function, right = functions[label]
    refused(lambda: function(**right, unknown=1), TypeError, "unknown")
    refused(lambda: function(*range(20)), TypeError)


def test_a_missing_argument_is_named(the):
    refused(lambda: the.sensor.render(), TypeError, "depth_mm")
    refused(lambda: gelsim.Job.load(), TypeError, "path")


ASSIGNMENTS = {
    "deep list": "a=" + "[" * 100_000,
    "deep table": "a=" + "{a=" * 100_000,
    "deep key": "a" + ".a" * 100_000 + "=1",
    "a hundred thousand quotes": '"' * 100_000,
    "lines": "a=1\n" * 20,
    "NaN": "camera.exposure=nan",
    "inf": "gelpad_thickness_mm=inf",
    "a large number": "camera.exposure=1e999",
    "a huge view": "sensor.resolution_px=[1000000, 1000000]",
    "another view": "sensor.resolution_px=[7, 5]",
}
WAYS = {
    "sensor": lambda the, text: gelsim.Sensor.preset("gelsight-mini", set=[text]).render(ball()),
    "job": lambda the, text: gelsim.Job.load(the.job_path, set=[text])[0],
    "text of a job": lambda the, text: gelsim._native._job_of_text(text if "=" in text else "a = 1", None),
}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("what", ASSIGNMENTS)
def test_an_assignment_works_or_is_refused(the, way, what):
    attempt(lambda: WAYS[way](the, ASSIGNMENTS[what]))


@pytest.mark.parametrize("what", WRONG)
@pytest.mark.parametrize("key", ["camera.exposure", "sensor.led"])
def test_a_wrong_value_of_a_key_is_named_or_taken(the, key, what):
    value = wrong_values()[what]
    given = {key: [{"color": value}] if key == "sensor.led" else value}
    attempt(lambda: gelsim.Job.load(the.job_path, set=given), "set", "camera", "sensor.led", ">= 0")


def test_many_layers_and_assignments_work_or_are_refused(the):
    attempt(lambda: the.sensor.render(ball(), layers=["surface"] * 100_000), "layers")
    attempt(lambda: gelsim.Sensor.preset("gelsight-mini", set=["camera.exposure=1.0"] * 3000), "set")


PATHS = [
    "pipe", "circle", "empty", "random", "zeros", "sparse", "absent", "", "a" * 300, "/dev/zero", "/dev/full",
    "/proc/self/mem", ".", "/" * 5000, os.fsdecode(b"\xff"), "digit\0",
]  # fmt: skip


@pytest.fixture(scope="module")
def odd_files(tmp_path_factory):
    """Everything but a job's or a sensor's file."""
    folder = tmp_path_factory.mktemp("odd")
    os.mkfifo(folder / "pipe")
    (folder / "circle").symlink_to(folder / "circle")
    (folder / "empty").write_bytes(b"")
    (folder / "random").write_bytes(random.Random(1).randbytes(100_000))
    (folder / "zeros").write_bytes(bytes(1 << 20))
    with open(folder / "sparse", "wb") as file:
        file.truncate(1 << 40)
    return folder


@pytest.mark.parametrize("kind", [gelsim.Job, gelsim.Sensor])
@pytest.mark.parametrize("path", [*PATHS, "the folder"], ids=lambda path: ascii(path)[-20:])
def test_what_is_no_file_of_ours_is_refused(odd_files, monkeypatch, kind, path):
    monkeypatch.chdir(odd_files)
    path = odd_files if path == "the folder" else path
    if path == "empty" and kind is gelsim.Sensor:
        # A sensor of which nothing is said is the default one.
        attempt(lambda: kind.load(path))
    else:
        refused(lambda: kind.load(path), SENSIBLE)


# How a job and a sensor are used, and what they give then.
USES = {"job": lambda job: job[3], "sensor": lambda sensor: sensor.render(ball())}
PROTOCOLS = range(pickle.HIGHEST_PROTOCOL + 1)
COPIES = {
    **{f"protocol {n}": lambda thing, n=n: pickle.loads(pickle.dumps(thing, n)) for n in PROTOCOLS},
    "in Python": lambda thing: pickle._loads(pickle._dumps(thing)),
    "copy": copy.copy,
    "deepcopy": lambda thing: copy.deepcopy([thing, {1: thing}])[0],
}
DAMAGED = (
    ValueError, TypeError, OSError, MemoryError, LookupError, EOFError, AttributeError, ImportError,
    pickle.UnpicklingError, gelsim.RunError, OverflowError,
)  # fmt: skip


@pytest.fixture(params=USES)
def thing(request, the):
    return getattr(the, request.param)


def use(thing):
    return USES[type(thing).__name__.lower()](thing)


@pytest.mark.parametrize("way", COPIES)
def test_a_copy_is_the_same(thing, way):
    same(use(COPIES[way](thing)), use(thing))


@pytest.mark.parametrize("part", range(42))
def test_a_pickle_that_is_cut_is_refused(thing, part):
    text = pickle.dumps(thing)
    refused(lambda: pickle.loads(text[: min(part * max(1, len(text) // 40), len(text) - 1)]), DAMAGED)


@pytest.mark.parametrize("number", range(120))
def test_a_pickle_with_flipped_bits_is_refused_or_another_object(thing, number):
    text, chance = bytearray(pickle.dumps(thing)), random.Random(number)
    for _ in range(1 + number % 3):
        # Most of a job's pickle is its text; what stands before it is as often hit.
        place = chance.randrange(len(text)) if number % 2 else chance.choice([*range(60), *range(-20, 0)])
        text[place] ^= 1 << chance.randrange(8)
    # Where a list's end is lost, each line after it is a mistake.
    attempt(lambda: pickle.loads(bytes(text)), kinds=DAMAGED, longest=20_000)


STATES = [("job", 0), ("job", 1), ("sensor", 0), ("sensor", 1), ("sensor", 2)]


@pytest.mark.parametrize("what", WRONG)
@pytest.mark.parametrize("thing, number", STATES, indirect=["thing"])
def test_a_pickle_of_wrong_values_is_refused_or_another_object(thing, number, what):
    function, given = thing.__reduce__()
    assert len(given) == sum(name == type(thing).__name__.lower() for name, _ in STATES)
    attempt(lambda: function(*given[:number], wrong_values()[what], *given[number + 1 :]))


def test_a_pickle_cannot_be_made_another_way(thing):
    text, name = pickle.dumps(thing), type(thing).__name__
    refused(lambda: thing.__reduce__()[0](), TypeError, "required")
    refused(lambda: thing.__setstate__({}), AttributeError)
    attempt(lambda: thing.__reduce_ex__("x"))
    attempt(lambda: thing.__reduce_ex__(10**30), kinds=(OverflowError,))
    newobj = pickle.PROTO + b"\x02c" + f"gelsim\n{name}\n".encode() + b")\x81."
    refused(lambda: pickle.loads(newobj), TypeError)
    refused(lambda: pickle.loads(text[:-1] + b"}(X\x01\x00\x00\x00aK\x01ub."), (AttributeError, TypeError))


MAKES = {
    "called": lambda kind: kind(),
    "called with more": lambda kind: kind(1, a=2),
    "__new__": lambda kind: kind.__new__(kind),
    "object.__new__": lambda kind: object.__new__(kind),
    "subclass": lambda kind: type("Sub", (kind,), {}),
    "subclass with dict": lambda kind: type("Sub", (kind, dict), {}),
}


@pytest.mark.parametrize("way", MAKES)
def test_an_object_is_not_half_made(thing, way):
    refused(lambda: MAKES[way](type(thing)), TypeError)


CHANGES = {
    "class": lambda thing: setattr(thing, "__class__", dict),
    "class of another": lambda thing: setattr(Claims(int), "__class__", type(thing)),
    "new attribute": lambda thing: setattr(thing, "new", 1),
    "name": lambda thing: setattr(thing, "name", 1),
    "vars": vars,
    "weak reference": weakref.ref,
    **{f"del {it}": lambda thing, it=it: delattr(thing, it) for it in ["name", "__class__", "__reduce__", "absent"]},
}


@pytest.mark.parametrize("way", CHANGES)
def test_an_object_is_not_changed(thing, way):
    kinds = TypeError if way in ["class", "vars", "weak reference"] else (TypeError, AttributeError)
    refused(lambda: CHANGES[way](thing), kinds)


def test_an_object_is_initialised_again_or_not(thing):
    attempt(lambda: thing.__init__(1, 2))


MEMBERS = [
    pytest.param(kind, member, id=f"{kind.__name__}.{name}")
    for kind in [gelsim.Job, gelsim.Sensor]
    for name, member in sorted(vars(kind).items())
    if hasattr(member, "__get__") and not isinstance(member, (staticmethod, str))
]
METHODS = [member for member in MEMBERS if callable(member.values[1])]
PROPERTIES = [member for member in MEMBERS if not callable(member.values[1])]


@pytest.fixture
def others(the):
    """What has no methods of the module's classes."""
    return {
        "None": lambda kind: None,
        "1": lambda kind: 1,
        "evil": lambda kind: Evil(),
        "claims": Claims,
        "class": lambda kind: kind,
        "another": lambda kind: the.sensor if kind is gelsim.Job else the.job,
    }


@pytest.mark.parametrize("other", ["None", "1", "evil", "claims", "class", "another"])
@pytest.mark.parametrize("kind, method", METHODS)
def test_a_method_of_something_else_is_refused(others, kind, method, other):
    # Of the class itself some work.
    taken = attempt(lambda: method(others[other](kind))) is not REFUSED
    assert not taken or other == "class"


@pytest.mark.parametrize("other", ["1", "evil", "claims", "another"])
@pytest.mark.parametrize("kind, attribute", PROPERTIES)
def test_a_property_of_something_else_is_refused(others, kind, attribute, other):
    refused(lambda: attribute.__get__(others[other](kind)), (TypeError, Mischief))


OPERATIONS = {
    **{name: getattr(operator, name) for name in ["lt", "add", "contains", "setitem", "iadd", "eq", "index"]},
    "call": lambda thing, _: thing(),
    "hash": hash,
    "bool": bool,
}


@pytest.mark.parametrize("name", OPERATIONS)
def test_an_operation_works_or_is_refused(thing, name):
    count = {"setitem": 2, "hash": 0, "index": 0, "bool": 0}.get(name, 1)
    attempt(lambda: OPERATIONS[name](thing, *([0] * count)))


def test_an_object_shows_itself(thing):
    assert repr(thing) and dir(thing) and sys.getsizeof(thing) and str(thing) and format(thing)


@pytest.mark.parametrize("kind", [gelsim.UsageError, gelsim.RunError])
def test_exceptions_are_like_others(kind):
    assert repr(kind()) and str(kind(1, 2)) and str(pickle.loads(pickle.dumps(kind("x")))) == "x"
    assert type("Sub", (kind,), {})("x")


def test_an_iterator_outlives_its_job(the):
    walk = iter(the.job)
    next(walk)
    del walk
    walk = iter(gelsim.Job.load(the.job_path))
    next(walk)
    assert len(list(walk)) == 5 and list(walk) == []


def test_a_job_is_iterated_twice_at_once_and_not_backwards(the):
    assert sum(1 for _ in zip(the.job, the.job)) == 6
    refused(lambda: list(reversed(the.job)), TypeError, "gelsim.Job")
