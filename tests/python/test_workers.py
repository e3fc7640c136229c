"""Jobs and sensors of the Python module in worker processes, beside other threads, and in the loader of PyTorch."""

import json
import multiprocessing
import os
import pickle
import random
import signal
import subprocess
import threading
import time
from pathlib import Path

import pytest

gelsim = pytest.importorskip("gelsim", reason="the module is not installed: pip install .")

import numpy as np

pytestmark = pytest.mark.wheel

JOB = """
dataset = { name = "workers", samples = 24, seed = 4 }
sensor.resolution_px = [64, 48]
object = [{ path = "sphere.obj" }, { path = "gear.obj" }]
pose = { x_mm = [-2.0, 2.0], yaw_deg = [0.0, 360.0] }
indentation.depth_mm = [0.3, 1.0]
"""

by_every_method = pytest.mark.parametrize("method", ["fork", "spawn", "forkserver"])


@pytest.fixture
def path(project, tmp_path):
    """The job's file, and its objects beside it."""
    for name in ["sphere.obj", "gear.obj"]:
        (tmp_path / name).write_bytes((project / "objects" / name).read_bytes())
    (tmp_path / "job.toml").write_text(JOB)
    return tmp_path / "job.toml"


@pytest.fixture
def job(path):
    return gelsim.Job.load(path)


def digest(sample):
    """What is compared of a sample: its bytes."""
    return sample["tactile"].tobytes(), sample["depth"].tobytes(), json.dumps(sample["label"])


def load(dataset, batches, results):
    """What a worker of a loader does: it takes indices and gives samples, until there are no more."""
    while (batch := batches.get()) is not None:
        results.put((batch, [digest(dataset[index]) for index in batch], os.getpid()))


def count_threads():
    """The threads of this process."""
    return len(os.listdir("/proc/self/task"))


def render(sensor, maps, results):
    """A batch in a worker, and the threads that it took there."""
    before = count_threads()
    images = sensor.render(maps)["tactile"]
    results.put((images.tobytes(), count_threads() - before))


@by_every_method
def test_workers_give_each_sample_once_and_the_same_as_here(job, method):
    truth = [digest(sample) for sample in job.samples(range(len(job)))]
    # Threads that a forked process has not.
    assert count_threads() > 1 or os.cpu_count() == 1
    context = multiprocessing.get_context(method)
    batches, results = context.Queue(), context.Queue()
    running = [context.Process(target=load, args=(job, batches, results)) for _ in range(2)]
    order = random.Random(1).sample(range(len(job)), len(job))
    for process in running:
        process.start()
    for start in range(0, len(order), 4):
        batches.put(order[start : start + 4])
    got, pids = {}, set()
    for _ in range(0, len(order), 4):
        batch, samples, pid = results.get(timeout=300)
        got |= dict(zip(batch, samples))
        pids.add(pid)
    for _ in running:
        batches.put(None)
    for process in running:
        process.join(60)
        assert process.exitcode == 0
    assert [got[index] for index in range(len(job))] == truth
    assert os.getpid() not in pids


@by_every_method
def test_a_batch_in_a_worker_has_one_thread_for_itself(method):
    """The loader has its workers."""
    sensor, maps = gelsim.Sensor.preset("digit"), np.zeros((3, 80, 60), np.float32)
    maps[:, 30:40, 20:40] = 0.4
    images = sensor.render(maps)["tactile"].tobytes()
    context = multiprocessing.get_context(method)
    results = context.Queue()
    process = context.Process(target=render, args=(sensor, maps, results))
    process.start()
    theirs, more = results.get(timeout=300)
    process.join(60)
    assert theirs == images
    assert more <= 1


@by_every_method
def test_a_pool_takes_jobs(job, method):
    with multiprocessing.get_context(method).Pool(2) as pool:
        assert pool.map(len, [job, job]) == [24, 24]


def test_a_job_whose_mesh_has_changed_is_refused_and_not_read(path):
    pickled = pickle.dumps(gelsim.Job.load(path))
    mesh = path.parent / "sphere.obj"
    mesh.write_text(mesh.read_text() + "# changed\n")
    with pytest.raises(gelsim.UsageError, match="sphere.obj has changed"):
        pickle.loads(pickled)


@pytest.mark.parametrize("sensor", ["gelsight-mini", "geltip"])
def test_processes_that_are_forked_while_threads_render_end(path, sensor):
    """Each of a job that nobody has rendered: what is computed on first use is the most likely to be half done."""
    for round in range(20):
        job = gelsim.Job.load(path, set={"sensor.preset": sensor})
        thread = threading.Thread(target=job.samples, args=[range(8)])
        thread.start()
        time.sleep(0.002 * round)
        child = os.fork()
        if child == 0:
            status = 1
            try:
                status = 0 if len(job.samples([1, 2, 3])) == 3 else 1
            finally:
                os._exit(status)
        deadline = time.monotonic() + 60
        while (ended := os.waitpid(child, os.WNOHANG)) == (0, 0):
            if time.monotonic() > deadline:
                os.kill(child, signal.SIGKILL)
                os.waitpid(child, 0)
                pytest.fail("a forked process hangs")
            time.sleep(0.01)
        thread.join()
        assert ended[1] == 0


@pytest.mark.parametrize("what", ["batch", "sample"])
def test_python_goes_on_while_samples_are_rendered(path, what):
    job = gelsim.Job.load(path, fidelity="reference", set=["sensor.resolution_px=[640, 480]"], threads=1)
    ticks, rendering, done = [], False, threading.Event()

    def tick():
        while not done.wait(0.001):
            ticks.append(rendering)

    thread = threading.Thread(target=tick)
    thread.start()
    rendering = True
    job.samples(range(2)) if what == "batch" else job[3]
    rendering = False
    done.set()
    thread.join()
    # Without the GIL there would be no more than one at each end.
    assert sum(ticks) > 5


def test_a_signal_ends_a_batch(path):
    def stop(number, frame):
        raise InterruptedError

    before = signal.signal(signal.SIGALRM, stop)
    # Again, because what is raised while Python collects garbage is lost.
    signal.setitimer(signal.ITIMER_REAL, 0.2, 0.5)
    try:
        with pytest.raises(InterruptedError):
            gelsim.Job.load(path, threads=1).samples([*range(24)] * 2000)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


@pytest.mark.parametrize("method", ["fork", "spawn", "alone"])
def test_the_loader_of_torch_gives_each_sample_once(path, torch_python, method):
    program = Path(__file__).with_name("torch_loader.py")
    done = subprocess.run([torch_python, program, path, method], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
