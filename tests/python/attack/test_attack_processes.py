"""Programs that fork, end while others render, are interrupted, call themselves or have a broken Python around them."""

import pytest

gelsim = pytest.importorskip("gelsim", reason="the module is not installed: pip install .")

pytestmark = [pytest.mark.full, pytest.mark.wheel]

BEGUN = """
sensor, job = gelsim.Sensor.preset("gelsight-mini"), gelsim.Job.load(JOB)
maps = np.stack([ball()] * 40)
truth, sample = sensor.render(maps)["tactile"].tobytes(), job.samples(range(6))[3]["tactile"].tobytes()
"""
# Maps of other proportions than the sensor's are warned of.
QUIET = "import warnings\nwarnings.simplefilter('ignore')\n"
# A pyramid, pressed and moved.
PRESSES = """
simulator = gelsim.Simulator("gelsight-mini", "draft", resolution_px=(32, 24))
mesh = gelsim.Mesh(CORNERS_MM, FACES)
def slide(simulator, count=4):
    simulator.reset(friction=0.4)
    return [simulator.step(mesh, gelsim.Pose(0.4, x_mm=0.2 * k)).image.tobytes() for k in range(count)]
pressed, slid = simulator.press(mesh, gelsim.Pose(0.4)).image.tobytes(), slide(simulator)
def again():
    try:
        slide(simulator)
    except gelsim.RunError:
        pass
"""
AFTER = """
def after(seconds):
    threading.Thread(target=lambda: (time.sleep(seconds), os.kill(os.getpid(), signal.SIGINT)), daemon=True).start()
"""

CHILD = BEGUN + """
def work(number):
    assert sensor.render(maps)["tactile"].tobytes() == truth
    assert job.samples(range(6))[3]["tactile"].tobytes() == sample and job[3]["tactile"].tobytes() == sample
    assert pickle.loads(pickle.dumps(sensor)).render(maps)["tactile"].tobytes() == truth
"""
STEPPING_CHILD = PRESSES + """
def work(number):
    assert simulator.press(mesh, gelsim.Pose(0.4)).image.tobytes() == pressed
    try:
        assert slide(simulator) == slid
    except gelsim.RunError as error:
        assert "another thread" in str(error)
    assert slide(simulator.copy()) == slid
    assert slide(pickle.loads(pickle.dumps(simulator))) == slid
"""
WHILE = "; children(20, work); os._exit(0)"
FORKS = {
    "after a batch": CHILD + "children(5, work)",
    "of a fork": CHILD + "children(2, lambda number: children(2, work))",
    "while maps are rendered": CHILD + "forever(lambda: sensor.render(maps))" + WHILE,
    "while samples are rendered": CHILD + "forever(lambda: job.samples(range(6)))" + WHILE,
    "while simulators are made": CHILD + QUIET
    + "sizes = itertools.count(8)\nforever(lambda: sensor.render(ball(8 + next(sizes) % 40, 20)))" + WHILE,
    "while jobs are loaded": CHILD + "forever(lambda: gelsim.Job.load(JOB))" + WHILE,
    # What a job's first sample prepares for all others is half done in the child.
    "while a job's first sample is rendered": """
wide = ['object=[{ path = "flat_face.obj" }]', "sensor.field_of_view_mm=[3.0, 2.25]", "indentation.depth_mm=0.4"]
for number in range(25):
    job = gelsim.Job.load(JOB, set=wide, threads=1)
    thread = threading.Thread(target=lambda: job[0], daemon=True)
    thread.start()
    time.sleep(0.002 * number)
    children(1, lambda number: job[1] and 0)
    thread.join()
""",
    "after steps": STEPPING_CHILD + "children(4, work)",
    "while frames are stepped": STEPPING_CHILD + "forever(again)" + WHILE,
    "that generates": """
gelsim.generate(JOB, "before", threads=2)
children(3, lambda number: (gelsim.generate(JOB, f"forked-{number}"), 0)[1])
import json
before, after = (json.load(open(f"{name}/dataset.json")) for name in ("before", "forked-0"))
assert before["fingerprint"] == after["fingerprint"]
""",
    "that is killed": BEGUN + """
child = os.fork()
if child == 0:
    forever(lambda: sensor.render(maps))
    time.sleep(60)
time.sleep(0.5)
os.kill(child, signal.SIGKILL)
os.waitpid(child, 0)
assert sensor.render(maps)["tactile"].tobytes() == truth
""",
}  # fmt: skip


@pytest.mark.parametrize("which", FORKS)
def test_a_fork_works(run_program, which):
    run_program(FORKS[which])


@pytest.mark.parametrize("method", ["fork", "spawn", "forkserver"])
def test_a_pool_of_processes_works_and_passes_exceptions_on(run_program, method):
    run_program(BEGUN + f"""
with multiprocessing.get_context({method!r}).Pool(2) as pool:
    assert all(batch["tactile"].tobytes() == truth for batch in pool.map(sensor.render, [maps] * 4))
    assert pool.map(job.sample, [3, 3])[0]["tactile"].tobytes() == sample
    for call, given, kind, words in [
        (job.sample, 6, IndexError, "0 to 5"),
        (sensor.render, maps * np.nan, gelsim.UsageError, "depth_mm"),
    ]:
        try:
            pool.map(call, [given])
            raise AssertionError
        except kind as error:
            assert words in str(error)
""")


# What a program does as it ends.
CALLS = {
    "maps": "sensor.render(maps[0])",
    "batches": "sensor.render(maps)",
    "samples": "job[3]",
    "several samples": "job.samples(range(6))",
    "an iterator": "list(job)",
    "loading": "gelsim.Job.load(JOB)",
    "mistakes": "sensor.render(maps[0], layers=[]) if os.getpid() < 0 else job.indices('train')",
}
TRY = """
        try:
            {}
        except (ImportError, TypeError, RuntimeError, AttributeError):
            pass
"""
KEPT = "self, sensor=sensor, job=job, maps=maps, gelsim=gelsim, JOB=JOB, os=os"
ENDINGS = {
    "beside daemon threads": "forever(lambda: {})",
    "once more beside daemon threads": "forever(lambda: {})",
    "a third time beside daemon threads": "forever(lambda: {})",
    "by os._exit": "forever(lambda: {})\nos._exit(0)",
    "by SIGTERM": "forever(lambda: {})\nos.kill(os.getpid(), signal.SIGTERM)\ntime.sleep(60)",
    "by sys.exit in a thread": "def run():\n    {}\n    sys.exit(3)\nthreading.Thread(target=run).start()",
    "with a call at exit": "atexit.register(lambda: {})",
    "with a call at exit beside daemon threads": "forever(lambda: {0})\natexit.register(lambda: {0})",
    "with a call in __del__": f"""
class Last:
    def __del__({KEPT}):{TRY}
sys.keep = keep = Last()
loop = Last()
loop.loop = loop
""",
    "with a call in a generator's end": f"""
def walk({KEPT.removeprefix("self, ")}):
    try:
        for sample in job:
            yield sample
    finally:{TRY}
one = walk()
next(one)
two = walk()
next(two)
two.close()
""",
}


@pytest.mark.parametrize("call", CALLS)
@pytest.mark.parametrize("how", ENDINGS)
def test_a_program_ends(run_program, how, call):
    run_program(f"{BEGUN}\n{ENDINGS[how].format(CALLS[call])}", status=-15 if how == "by SIGTERM" else 0)


@pytest.mark.parametrize("repeat", range(12))
def test_a_program_ends_beside_threads_that_hardly_render(run_program, repeat):
    """Much is made for Python."""
    tiny = "tiny = ball(2, 2)\nsys.setswitchinterval(1e-6)\nforever(lambda: sensor.render(tiny, fidelity='paper'))"
    run_program(BEGUN + QUIET + tiny)


MORE_ENDINGS = {
    "steps": PRESSES + "forever(again)",
    "presses": PRESSES + "forever(lambda: simulator.press(mesh, gelsim.Pose(0.4)))",
    "generate": "numbers = itertools.count()\n"
    "forever(lambda: gelsim.generate(JOB, f'exit-{os.getpid()}-{next(numbers)}', threads=1))",
}


@pytest.mark.parametrize("repeat", range(3))
@pytest.mark.parametrize("call", MORE_ENDINGS)
def test_a_program_ends_beside_threads_that_simulate(run_program, call, repeat):
    run_program(MORE_ENDINGS[call])


def test_a_main_thread_ends_first(run_program):
    run_program(BEGUN + "threading.Thread(target=lambda: [job[k] for k in range(6)]).start()")


def test_a_mistake_that_is_not_caught_is_told(run_program):
    run_program(BEGUN + "sensor.render(maps[0] * np.nan)", "UsageError: error: depth_mm", 1)


def test_an_executor_ends(run_program):
    run_program(BEGUN + """
from concurrent.futures import ThreadPoolExecutor
executor = ThreadPoolExecutor(4)
futures = [executor.submit(sensor.render, maps) for _ in range(20)]
""")


INTERRUPTED = {
    "a map": "sensor.render(maps[0])",
    "a batch": "sensor.render(np.broadcast_to(maps[0], (3000, *maps[0].shape)))",
    "a check of many maps": "sensor.render(np.broadcast_to(maps[0], (30000, *maps[0].shape)))",
    "samples": "job.samples([*range(6)] * 500)",
    "an iterator": "list(job)",
    "loading": "gelsim.Job.load(JOB)",
    "a large map": "sensor.render(ball(480, 640), fidelity='reference')",
    "generate": 'gelsim.generate(JOB, f"stopped-{seconds}", samples=200000, threads=2); raise AssertionError',
}


@pytest.mark.parametrize("call", INTERRUPTED)
def test_control_c_is_heard(run_program, call):
    run_program(BEGUN + AFTER + f"""
for seconds in [0.05, 0.2, 0.5]:
    after(seconds)
    start = time.monotonic()
    try:
        while True:
            {INTERRUPTED[call]}
    except KeyboardInterrupt:
        assert time.monotonic() - start < 20, time.monotonic() - start
assert sensor.render(maps)["tactile"].tobytes() == truth and job.samples(range(6))[3]["tactile"].tobytes() == sample
assert gelsim.generate(JOB, "complete", threads=2, overwrite=True).complete
""")


PROGRAMS = {
    "a_signal_handler_may_render_in_the_midst": BEGUN + """
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
    "an_index_may_call_again": BEGUN + """
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
    "a_path_may_call_again": BEGUN + """
class Again:
    def __fspath__(self):
        return gelsim.Job.load(self)
try:
    gelsim.Job.load(Again())
    raise AssertionError
except RecursionError:
    pass
""",
    "a_number_may_call_again": BEGUN + """
class Again:
    def __index__(self):
        return call()
    __float__ = __index__
for call in [
    lambda: gelsim.Job.load(JOB, samples=Again()),
    lambda: gelsim.Sensor.preset("digit", threads=Again()),
    lambda: sensor.render(maps[0], index=Again()),
]:
    try:
        call()
        raise AssertionError
    except (RecursionError, ImportError):
        pass
""",
    "a_warning_may_call_again_or_be_an_error": BEGUN + """
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
    "a_sequence_may_render": BEGUN + """
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
    "the_stack_may_end": BEGUN + """
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
    "garbage_may_be_collected_in_the_midst": BEGUN
    + "gc.set_threshold(1)\nassert sensor.render(maps)['tactile'].tobytes() == truth\nlist(job)",
    "a_program_may_be_traced": BEGUN + """
sys.settrace(lambda *given: None)
sys.setprofile(lambda *given: job[0] if sys.getrecursionlimit() < 0 else None)
assert sensor.render(maps)["tactile"].tobytes() == truth
""",
    "members_may_be_taken_from_a_class": BEGUN + """
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
    "a_result_may_be_all_that_is_left": BEGUN + """
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
    "the_module_may_be_loaded_again": """
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
    "another_interpreter_may_load_the_module": """
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
}


@pytest.mark.parametrize("what", PROGRAMS)
def test_anything_may_happen(run_program, what):
    run_program(PROGRAMS[what])


@pytest.mark.parametrize(
    "code",
    [
        pytest.param("", id="empty"),
        pytest.param("__version__ = '2.0.0'\nndarray = list", id="only by name"),
        pytest.param("__version__ = '2.0.0'\nfloat32 = ndarray = int\nclass lib: pass", id="without its capsule"),
        pytest.param("raise RuntimeError('x')", id="raises"),
    ],
)
def test_a_numpy_that_is_none_is_named(run_program, tmp_path, code):
    (tmp_path / "numpy.py").write_text(code)
    run_program(f"""
import sys
sys.path.insert(0, {str(tmp_path)!r})
import gelsim
for call in [lambda: gelsim.Sensor.preset("gelsight-mini"), lambda: gelsim.Job.load(JOB),
             lambda: gelsim._native._sensor_of_source("gelsight-mini", [], None)]:
    try:
        call()
        raise AssertionError
    except ImportError as error:
        assert "numpy" in str(error), error
""", prelude="")


LIBRARIES = ["json", "warnings", "multiprocessing", "gelsim._native", "builtins", "numpy"]
BROKEN = {
    **{name: f"sys.modules[{name!r}] = None" for name in LIBRARIES},
    "json.loads": "import json; json.loads = lambda text: 1 / 0",
    "parent_process": "multiprocessing.parent_process = lambda: 1 / 0",
}


@pytest.mark.parametrize("what", BROKEN)
def test_a_library_may_be_broken(run_program, what):
    run_program(f"""{BEGUN}{QUIET}
{BROKEN[what]}
shallow = ["indentation.depth_mm=1e-4"]
calls = [lambda: sensor.render(maps), lambda: job[0], lambda: job.samples([1]), lambda: list(job),
         lambda: pickle.dumps(job), lambda: gelsim.Job.load(JOB, set=shallow),
         lambda: gelsim.Sensor.preset("gelsight-mini")]
for call in calls:
    try:
        call()
    except (ImportError, ZeroDivisionError, AttributeError, TypeError, pickle.PicklingError):
        pass
os._exit(0)
""")


@pytest.mark.parametrize("limit, most", {"NOFILE": 8, "FSIZE": 0, "STACK": 1 << 20, "NPROC": 0}.items())
def test_a_machine_may_have_no_more(run_program, limit, most):
    run_program(BEGUN + f"""
import resource
resource.setrlimit(resource.RLIMIT_{limit}, ({most}, {most}))
for call in [lambda: sensor.render(maps), lambda: job.samples(range(6)), lambda: gelsim.Job.load(JOB, threads=7)]:
    try:
        call()
    except (gelsim.RunError, gelsim.UsageError, OSError):
        pass
""")


LINES = [
    "[]", "['gelsim']", "['gelsim', '--help']", "['gelsim', 'x' * 10**6]", r"['gelsim', 'a\0b']",
    r"['gelsim', '\udcff']", "['gelsim', 'plan', '/dev/zero']", "['gelsim', 'generate']",
    r"['gelsim', 'plan', '\ud800']",
]  # fmt: skip


@pytest.mark.parametrize("stdout", ["open", "closed"])
@pytest.mark.parametrize("line", LINES)
def test_the_command_ends_with_a_status(run_program, line, stdout):
    run_program(f"""
{'os.close(1)' if stdout == 'closed' else ''}
try:
    status = gelsim._native.main({line})
    assert status in range(3), status
except (ValueError, TypeError):
    pass
os.write(2, b"went on")
""", "went on")


@pytest.mark.parametrize("given", ["None", "'gelsim'", "[1]", "itertools.count()", "[b'gelsim', b'--version']"])
def test_what_is_no_command_line_is_named(run_program, given):
    run_program(f"""
try:
    gelsim._native.main({given})
except TypeError as error:
    assert "argv" in str(error), error
os.write(2, b"went on")
""", "went on")
