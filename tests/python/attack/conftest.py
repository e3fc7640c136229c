"""What attacks on the Python module share: what is attacked, and the limits within which it is.

    pytest tests/python/attack --full       [-n 1, of pytest-xdist: goes on after an attack that ends the process]

Whatever it is given, the module gives a right result or an exception that helps. A signal, an abort, a panic and a wait
without end are failures. What forks, is interrupted or ends while others render is a program of its own.
"""

import faulthandler
import os
import re
import resource
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

# Longest that an attack may take on a busy machine, s.
PATIENCE_S = 120
# Address space: what asks for more is refused it, and the machine stays.
MOST_BYTES = 16 << 30

JOB = """
dataset = { name = "attacked", samples = 6, seed = 4 }
sensor.resolution_px = [32, 24]
object = [{ path = "sphere.obj" }, { path = "gear.obj" }]
indentation.depth_mm = [0.3, 1.0]
"""


class Skipped(pytest.Module):
    """A file of which nothing is collected: thousands of tests that are skipped one by one take a minute."""

    def collect(self):
        pytest.skip("runs with --full")


def pytest_pycollect_makemodule(module_path, parent):
    if not parent.config.getoption("--full"):
        return Skipped.from_parent(parent, path=module_path)


@pytest.fixture(scope="module")
def folder(project, tmp_path_factory):
    """The files of what is attacked."""
    folder = tmp_path_factory.mktemp("attacked")
    (folder / "job.toml").write_text(JOB)
    (folder / "sensor.toml").write_text('preset = "gelsight-mini"\n')
    for name in ["sphere.obj", "gear.obj", "flat_face.obj"]:
        (folder / name).write_bytes((project / "objects" / name).read_bytes())
    return folder


@pytest.fixture(scope="module")
def the(folder):
    """What is attacked: `the.job`, `the.sensor`, `the.simulator`, `the.mesh`, and files."""
    import gelsim
    from mischief import COLUMNS, CORNERS_MM, FACES, ROWS

    job, sensor = gelsim.Job.load(folder / "job.toml"), gelsim.Sensor.preset("gelsight-mini")
    simulator = gelsim.Simulator(sensor, "draft", resolution_px=(COLUMNS, ROWS))
    mesh = gelsim.Mesh(CORNERS_MM, FACES)
    files = {"folder": folder, "job_path": folder / "job.toml", "sensor_path": folder / "sensor.toml"}
    return SimpleNamespace(job=job, sensor=sensor, simulator=simulator, mesh=mesh, **files)


@pytest.fixture(scope="module", autouse=True)
def limits(folder):
    """Bounds of this process, and a folder for what is written to a path that is none."""
    space, here = resource.getrlimit(resource.RLIMIT_AS), Path.cwd()
    # A shell starts what runs in the background with SIGINT ignored, and Python leaves it so.
    handler = signal.signal(signal.SIGINT, signal.default_int_handler)
    resource.setrlimit(resource.RLIMIT_AS, (MOST_BYTES, space[1]))
    os.chdir(folder)
    yield
    os.chdir(here)
    resource.setrlimit(resource.RLIMIT_AS, space)
    signal.signal(signal.SIGINT, handler)


@pytest.fixture(scope="session")
def terminal(pytestconfig):
    """Standard error, which tests do not capture."""
    with pytestconfig.pluginmanager.getplugin("capturemanager").global_and_fixture_disabled():
        return os.fdopen(os.dup(2), "w")


@pytest.fixture(autouse=True)
def patience(terminal):
    """Ends what hangs, from a thread that needs no lock of Python's."""
    faulthandler.dump_traceback_later(PATIENCE_S + 30, exit=True, file=terminal)
    yield
    faulthandler.cancel_dump_traceback_later()


# What programs begin with.
PRELUDE = """
import atexit, gc, itertools, multiprocessing, os, pickle, signal, sys, threading, time
import gelsim, numpy as np
sys.path.insert(0, HERE)
from mischief import CORNERS_MM, FACES, ball
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


@pytest.fixture
def run_program(folder):
    """Runs a program, which ends with this status and says nothing but `says`."""

    def run(code, says="", status=0, prelude=PRELUDE):
        source = f"HERE, JOB = {str(Path(__file__).parent)!r}, {str(folder / 'job.toml')!r}\n{prelude}\n{code}"
        line = [sys.executable, "-c", source]
        done = subprocess.run(line, capture_output=True, text=True, timeout=PATIENCE_S, cwd=folder, errors="replace")
        said = done.stdout + done.stderr
        assert done.returncode == status, f"status {done.returncode}: {said[-2000:]}"
        assert says in said, said[-2000:]
        assert not re.search(r"fatal|panicked|Fatal", said), said[-2000:]
        assert says or status or not said, said[-2000:]

    return run
