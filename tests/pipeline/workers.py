"""Jobs and sensors of the Python module in worker processes and beside other threads, or how quick they are.

    python workers.py GELSIM [PYTHON_WITH_TORCH]    from the project's root, where the wheel and numpy are installed, for the
                                                    second interpreter, too
    python workers.py GELSIM --speed                the speed alone, of a wheel as `pip install .` makes it
"""

import json
import multiprocessing
import os
import pickle
import random
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import gelsim
import numpy as np
from snippet import snippets

JOB = """
dataset = { name = "workers", samples = 24, seed = 4 }
sensor.resolution_px = [64, 48]
object = [{ path = "OBJECTS/sphere.obj" }, { path = "OBJECTS/gear.obj" }]
pose = { x_mm = [-2.0, 2.0], yaw_deg = [0.0, 360.0] }
indentation.depth_mm = [0.3, 1.0]
"""


def digest(sample):
    """What is compared of a sample: its bytes."""
    return sample["tactile"].tobytes(), sample["depth"].tobytes(), json.dumps(sample["label"])


def load(dataset, batches, results):
    """What a worker of a loader does: it takes indices and gives samples, until there are no more."""
    while (batch := batches.get()) is not None:
        results.put((batch, [digest(dataset[index]) for index in batch], os.getpid()))


def threads():
    """The threads of this process."""
    return len(os.listdir("/proc/self/task"))


def in_worker(sensor, maps, results):
    """A batch in a process that multiprocessing started has one thread for itself: the loader has its workers."""
    before = threads()
    images = sensor.render(maps)["tactile"]
    results.put((images.tobytes(), threads() - before))


def workers(job, path):
    """Two workers of each start method give every sample once, the same as here, in any order."""
    truth = [digest(sample) for sample in job.samples(range(len(job)))]
    sensor, maps = gelsim.Sensor.preset("digit"), np.zeros((3, 80, 60), np.float32)
    maps[:, 30:40, 20:40] = 0.4
    images = sensor.render(maps)["tactile"].tobytes()
    # Threads that a forked process has not.
    assert threads() > 1 or os.cpu_count() == 1
    for method in ["fork", "spawn", "forkserver"]:
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
        for process in running:
            batches.put(None)
        for process in running:
            process.join(60)
            assert process.exitcode == 0, (method, process.exitcode)
        assert [got[index] for index in range(len(job))] == truth, method
        assert os.getpid() not in pids

        process = context.Process(target=in_worker, args=(sensor, maps, results))
        process.start()
        theirs, more = results.get(timeout=300)
        process.join(60)
        assert theirs == images and more <= 1, (method, more)
        with context.Pool(2) as pool:
            assert pool.map(len, [job, job]) == [24, 24]
    # A file that changed since is refused with the reason, not read.
    pickled = pickle.dumps(gelsim.Job.load(path))
    mesh = path.parent / "sphere.obj"
    mesh.write_text(mesh.read_text() + "# changed\n")
    try:
        pickle.loads(pickled)
        raise AssertionError("a job of other objects")
    except gelsim.UsageError as error:
        assert "sphere.obj has changed" in str(error), error


def forks_while_rendering(job):
    """Processes that are forked while threads render come to an end, too."""
    stop = threading.Event()

    def render():
        while not stop.is_set():
            job.samples(range(8))

    thread = threading.Thread(target=render)
    thread.start()
    try:
        for _ in range(20):
            child = os.fork()
            if child == 0:
                os._exit(0 if len(job.samples([1, 2, 3])) == 3 else 1)
            deadline = time.monotonic() + 120
            while (ended := os.waitpid(child, os.WNOHANG)) == (0, 0):
                assert time.monotonic() < deadline, "a forked process hangs"
                time.sleep(0.01)
            assert ended[1] == 0, ended
    finally:
        stop.set()
        thread.join()


def other_threads(path):
    """Python goes on while a sample or a batch is rendered, and signals end a batch."""
    job = gelsim.Job.load(path, fidelity="reference", set=["sensor.resolution_px=[640, 480]"], threads=1)
    for render in [lambda: job.samples(range(2)), lambda: job[3]]:
        ticks, done = [], threading.Event()

        def tick():
            while not done.wait(0.001):
                ticks.append(rendering)

        rendering = False
        thread = threading.Thread(target=tick)
        thread.start()
        rendering = True
        render()
        rendering = False
        done.set()
        thread.join()
        # Without the GIL there would be no more than one at each end.
        assert sum(ticks) > 5, sum(ticks)

    def stop(number, frame):
        raise InterruptedError

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, 0.2)
    try:
        gelsim.Job.load(path, threads=1).samples([*range(24)] * 2000)
        raise AssertionError("a signal was not noticed")
    except InterruptedError:
        signal.signal(signal.SIGALRM, before)


def throughput(path, native):
    """Speed of the command and of the module on as many threads; the command also encodes and writes files."""
    samples, size = 96, ["sensor.resolution_px=[320, 240]"]
    for count in [1, 2]:
        job = gelsim.Job.load(path, samples=samples, set=size, threads=count)
        found = []
        for repeat in range(3):
            with tempfile.TemporaryDirectory() as out:
                flags = ["--samples", samples, "--set", *size, "--threads", count, "--log-format", "json", "--out", out]
                line = [native, "generate", path, *map(str, flags)]
                done = subprocess.run(line, check=True, capture_output=True, text=True)
                rate = json.loads(done.stderr.splitlines()[-1])["samples_per_s"]
                stats = [json.loads(path.read_text())["seconds"] for path in Path(out).glob("stats/*.json")]
                cpu = sum(sum(stages.values()) - stages["encode"] for stages in stats)
            start, busy = time.perf_counter(), time.process_time()
            if count == 1:
                for index in range(samples):
                    job[index]
            else:
                job.samples(range(samples))
            busy, wall = time.process_time() - busy, time.perf_counter() - start
            found.append((rate, samples / wall, -1e3 * cpu / samples, -1e3 * busy / samples))
        command, module, command_ms, module_ms = map(max, zip(*found))
        print(
            f"320x240, {count} thread{'s'[: count > 1]}: command {command:.0f} samples/s, module {module:.0f}; CPU time a sample: "
            f"command without encoding {-command_ms:.2f} ms, module {-module_ms:.2f} ms",
            flush=True,
        )


def maps(count=40):
    """Speed of a sensor on one thread: a ball that reaches 0.6 mm into the pad."""
    y, x = np.mgrid[-5.7:5.7:240j, -7.6:7.6:320j]
    with np.errstate(invalid="ignore"):
        depth = np.nan_to_num(np.sqrt(16 - x**2 - y**2) - 3.4, nan=-np.inf).astype(np.float32)
    sensor, found = gelsim.Sensor.preset("digit", threads=1), []
    for rung in ["paper", "draft", "standard", "high"]:
        sensor.render(depth, fidelity=rung)
        start = time.thread_time()
        for _ in range(count):
            sensor.render(depth, fidelity=rung)
        found.append(f"{rung} {1e3 * (time.thread_time() - start) / count:.1f} ms")
    print(f"a map of 320x240: {', '.join(found)} of CPU time", flush=True)


if __name__ == "__main__":
    native, here = Path(sys.argv[1]).resolve(), Path(__file__).resolve().parent
    with tempfile.TemporaryDirectory() as root:
        path = Path(root) / "job.toml"
        path.write_text(JOB.replace("OBJECTS/", ""))
        for name in ["sphere.obj", "gear.obj"]:
            (Path(root) / name).write_bytes(Path("objects", name).read_bytes())
        job = gelsim.Job.load(path)
        if sys.argv[2:] == ["--speed"]:
            throughput(path, native)
            maps()
            sys.exit()
        other_threads(path)
        forks_while_rendering(job)
        for torch in sys.argv[2:]:
            subprocess.run([torch, here / "torch_loader.py", path], check=True)
        page = "docs/python.md"
        for number, code in enumerate(snippets(page)):
            for python in sys.argv[2:] if "import torch" in code else [sys.executable]:
                subprocess.run([python, here / "snippet.py", page, str(number)], check=True)
        workers(job, path)
    print("samples are the same in workers that were forked and spawned" + (", and by DataLoader" if sys.argv[2:] else ""))
