"""Many threads on one job, sensor and simulator, on arrays that change and on little stack; presses that cannot be."""

import itertools
import pickle
import random
import threading
import time

import pytest

gelsim = pytest.importorskip("gelsim", reason="the module is not installed: pip install .")

import numpy as np
from mischief import COLUMNS, LAYERS, REFUSED, ROWS, attempt, ball, look_at_layers, look_at_message, look_at_numbers
from module_checks import same

pytestmark = [pytest.mark.full, pytest.mark.wheel, pytest.mark.filterwarnings("ignore")]

MAPS = [ball(depth_mm=0.1 + 0.05 * number) for number in range(16)]


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


def all_same(got, want):
    for one, other in zip(got, want, strict=True):
        same(one, other)


@pytest.fixture(scope="module")
def truth(the):
    """What the sensor makes of each map."""
    return [the.sensor.render(depth, layers=LAYERS, index=7) for depth in MAPS]


@pytest.fixture(scope="module")
def samples(the):
    return the.job.samples(range(6))


def test_a_sensor_renders_a_map_in_each(the, truth):
    got = in_threads(16, lambda k: [the.sensor.render(MAPS[k], layers=LAYERS, index=7) for _ in range(10)])
    for k, several in enumerate(got):
        all_same(several, [truth[k]] * 10)


def test_all_read_one_array(the, truth):
    all_same(in_threads(16, lambda k: the.sensor.render(MAPS[3], layers=LAYERS, index=7)), [truth[3]] * 16)


def test_batches_are_rendered_at_once(the):
    for k, batch in enumerate(in_threads(8, lambda k: the.sensor.render(np.stack(MAPS[k : k + 3])))):
        same({name: value[0] for name, value in batch.items()}, the.sensor.render(MAPS[k]))


def test_more_resolutions_may_be_in_use_than_are_kept(the):
    def work(k):
        return [the.sensor.render(ball(10 + k, 9 + j), fidelity="draft") for j in range(3)]

    for k, several in enumerate(in_threads(12, work)):
        all_same(several, work(k))


def test_a_job_renders_a_sample_in_each(the, samples):
    all_same(in_threads(12, lambda k: the.job[k % 6]), samples * 2)


def test_a_job_renders_several_samples_in_each(the, samples):
    for k, two in enumerate(in_threads(6, lambda k: the.job.samples([k, 5 - k]))):
        all_same(two, [samples[k], samples[5 - k]])


def test_jobs_of_other_numbers_of_threads_run_at_once(the, samples):
    for several in in_threads(6, lambda k: gelsim.Job.load(the.job_path, threads=1 + k).samples(range(6))):
        all_same(several, samples)


def test_sensors_are_unpickled_at_once(the):
    in_threads(8, lambda k: pickle.loads(pickle.dumps(the.sensor)).render(MAPS[k]))


def test_an_iterator_gives_each_sample_to_one(the, samples):
    shared = iter(the.job)
    got = itertools.chain(*in_threads(6, lambda k: list(shared)))
    all_same(sorted(got, key=lambda sample: sample["label"]["index"]), samples)


def now_and_then(given, value):
    given.fill(0.3)
    time.sleep(0.004)
    given[:, 3:9] = value
    time.sleep(0.001)


NOISE = np.random.default_rng(1)
CHANGES = {
    "noise": lambda given: given.__setitem__(..., NOISE.random(given.shape, np.float32)),
    "NaN now and then": lambda given: now_and_then(given, np.nan),
    "inf now and then": lambda given: now_and_then(given, np.inf),
    "its shape": lambda given: [setattr(given, "shape", shape) for shape in [(given.size,), (128, ROWS, COLUMNS)]],
    "sorted": lambda given: given.ravel()[::-1].sort(),
}


@pytest.mark.parametrize("how", CHANGES)
def test_an_array_that_changes_is_rendered_or_refused(the, how):
    given, stop = np.stack(MAPS * 8), threading.Event()
    thread = threading.Thread(target=lambda: [CHANGES[how](given) for _ in iter(stop.is_set, True)])
    thread.start()
    try:
        for number in range(30):
            result = attempt(lambda: the.sensor.render(given if number % 2 else given[0], layers=LAYERS), "depth_mm")
            if result is not REFUSED:
                look_at_layers(result, result["tactile"].shape[:-1])
    finally:
        stop.set()
        thread.join()


SEQUENCE = """
friction = { coefficient = 0.5 }
frame_rate_hz = 10.0
phase = [{ name = "press", duration_s = 0.2, depth_mm = 0.5 }, { name = "slide", duration_s = 0.2, x_mm = 0.4 }]
"""


@pytest.mark.parametrize(
    "what, size",
    [*itertools.product(["map", "sample", "job"], [1 << 20, 256 << 10, 128 << 10]), ("frames", 128 << 10), ("grip", 256 << 10)],
)
def test_little_stack_is_enough(the, what, size):
    text = the.job_path.read_text().replace("indentation.depth_mm = [0.3, 1.0]", "")
    others = {"frames": f"[sequence]{SEQUENCE}", "grip": "gripper.force_n = 1.0"}
    if what in others:
        path = the.folder / f"{what}.toml"
        path.write_text(f"{text}\n{others[what]}")
        other = gelsim.Job.load(path)
    work = {
        "map": lambda: the.sensor.render(MAPS[0]),
        "sample": lambda: the.job[0],
        "job": lambda: gelsim.Job.load(the.job_path),
        "frames": lambda: other[0],
        "grip": lambda: other[0],
    }
    before = threading.stack_size(size)
    try:
        in_threads(2, lambda number: work[what]())
    finally:
        threading.stack_size(before)


def press(the):
    return the.simulator.press(the.mesh, gelsim.Pose(0.4))


def step(the, simulator):
    """A sequence."""
    simulator.reset(friction=0.4)
    return [simulator.step(the.mesh, gelsim.Pose(0.4, x_mm=0.2 * k)).sample() for k in range(4)]


def test_a_simulator_presses_in_each(the):
    truth = press(the).sample()
    for several in in_threads(12, lambda k: [press(the).sample() for _ in range(5)]):
        all_same(several, [truth] * 5)


def test_all_read_one_layer(the):
    one = press(the)
    assert len(set(in_threads(12, lambda k: one.points.tobytes()))) == 1


def test_each_steps_a_sequence_of_its_own(the):
    each = step(the, the.simulator)
    for several in in_threads(8, lambda k: step(the, the.simulator.copy())):
        all_same(several, each)


def test_one_sequence_for_all_works_or_is_refused_and_the_next_one_is_right(the):
    each = step(the, the.simulator)
    attempt(lambda: in_threads(8, lambda k: step(the, the.simulator)), "another thread")
    all_same(step(the, the.simulator), each)


@pytest.mark.parametrize("number", range(300))
def test_a_random_mesh_is_pressed_or_refused(the, number):
    chance = np.random.default_rng(number)
    lengths = [0.0, 1.0, -1.0, 1e-30, 1e30, 1e6, np.nan, np.inf, chance.normal()]
    corners = chance.choice(lengths, (chance.integers(1, 9), 3))
    faces = chance.integers(0, len(corners), (chance.integers(1, 12), 3))
    face = str(chance.choice(["-z", "+x", "-y"]))
    pose = gelsim.Pose(float(chance.uniform(-1, 3)), tilt_deg=float(chance.uniform(-90, 90)), face=face)

    try:
        odd = gelsim.Mesh(corners, faces)
        for act in [the.simulator.press, the.simulator.step]:
            look_at_numbers(act(odd, pose).sample())
    except gelsim.UsageError as error:
        look_at_message(error, ())
        the.simulator.reset()


@pytest.mark.parametrize("way", ["press", "step"])
@pytest.mark.parametrize(
    "pose",
    [
        *(gelsim.Pose(0.4, **{name: value}) for name in ["x_mm", "y_mm"] for value in [1e4, -1e4, 3999.9, 1e-9]),
        *(gelsim.Placement(at) for x in [1e7, -1e7, 1e-300] for at in [(x, 0.0, -0.3), (0.0, x, -0.3)]),
    ],
    ids=str,
)
def test_far_away_nothing_is_odd(the, way, pose):
    look_at_numbers(getattr(the.simulator, way)(the.mesh, pose).sample())


@pytest.fixture(params=["mesh", "impression", "simulator"])
def pickled(request, the):
    return pickle.dumps({"mesh": the.mesh, "impression": press(the), "simulator": the.simulator}[request.param])


def use(the, data):
    """The image of what was pickled."""
    it = pickle.loads(data)
    if isinstance(it, gelsim.Mesh):
        it = the.simulator.press(it, gelsim.Pose(0.4))
    elif isinstance(it, gelsim.Simulator):
        it = it.press(the.mesh, gelsim.Pose(0.4))
    return it.image.tobytes() if isinstance(it, gelsim.Impression) else None


def test_what_is_pickled_is_the_same(the, pickled):
    assert use(the, pickled) == press(the).image.tobytes()


@pytest.mark.parametrize("number", range(80))
def test_a_pickle_with_flipped_bits_is_refused_or_another_object(the, pickled, number):
    data, chance = bytearray(pickled), random.Random(number)
    data[chance.randrange(len(data)) if number % 2 else chance.randrange(60)] ^= 1 << chance.randrange(8)
    attempt(lambda: use(the, bytes(data)), kinds=(Exception,))
