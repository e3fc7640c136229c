"""What the tests share: the command, a Python with torch, datasets that several of them read.

    pytest tests/python [--gelsim PATH] [--torch-python PATH] [--wheels FOLDER] [--full]

`-m build` compiles crates and wheels, `-m wheel` needs the module (`pip install .`); both are skipped with a message where something
that they need is absent. Tests marked `full` take minutes, or a server, and run with `--full` alone.
"""

import importlib.util
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile

import pytest

# What helpers assert is explained as what tests assert.
pytest.register_assert_rewrite("browser", "samples", "module_names", "every_kind", "processes", "sets")

from processes import run

PROJECT = pathlib.Path(__file__).resolve().parents[2]


def pytest_addoption(parser):
    group = parser.getgroup("gelsim")
    group.addoption("--gelsim", default=PROJECT / "target/release/gelsim", help="the command under test (target/release/gelsim)")
    stores = PROJECT / "target/stores/release/gelsim"
    group.addoption("--gelsim-with-stores", default=stores, help="the command built with --features stores (target/stores/..)")
    group.addoption("--old-gelsim", help="another build, for test_same_bytes.py")
    group.addoption("--torch-python", help="an interpreter with torch, where this one has none")
    group.addoption("--wheels", help="a folder that has this project's wheel, or gets it")
    group.addoption("--full", action="store_true", help="also what takes minutes, or a server")


def pytest_configure(config):
    for line in (
        "full: takes minutes, or a server: runs with --full",
        "wheel: needs the Python module: pip install .",
        "build: compiles crates or wheels",
    ):
        config.addinivalue_line("markers", line)
    # What tests run finds this command before the wheel's.
    program = pathlib.Path(config.getoption("--gelsim")).resolve()
    os.environ["PATH"] = f"{program.parent}:{os.environ['PATH']}"
    # What reads datasets looks at these as it is imported: nothing is fetched, and nothing is left.
    cache = tempfile.TemporaryDirectory()
    config.add_cleanup(cache.cleanup)
    os.environ |= {"HF_HOME": cache.name, "HF_HUB_OFFLINE": "1", "HF_DATASETS_DISABLE_PROGRESS_BARS": "1", "WIDS_CACHE": cache.name}


def pytest_collection_modifyitems(config, items):
    skipped = []
    if not config.getoption("--full"):
        skipped.append(("full", "runs with --full"))
    if not importlib.util.find_spec("gelsim"):
        skipped.append(("wheel", "the module is not installed: pip install ."))
    for mark, reason in skipped:
        for item in items:
            if item.get_closest_marker(mark):
                item.add_marker(pytest.mark.skip(reason=reason))


class Command:
    """The program `gelsim`, run as a child."""

    def __init__(self, path):
        self.path = path

    def __call__(self, *arguments, status=0, **options):
        """Runs it, checks how it ends, and gives what it printed: `stdout` and `stderr`."""
        return run(self.path, *arguments, status=status, **options)

    def generate(self, job, out, *arguments, **options):
        """Generates a dataset into `out`, and gives that folder."""
        self("generate", job, "--quiet", "--out", out, *arguments, **options)
        return out


@pytest.fixture(scope="session")
def project():
    """The repository's root."""
    return PROJECT


@pytest.fixture(scope="session")
def gelsim_path(pytestconfig):
    """The program under test."""
    path = pathlib.Path(pytestconfig.getoption("--gelsim")).resolve()
    assert path.is_file(), f"{path} is not there: cargo build --release, or --gelsim PATH"
    return path


@pytest.fixture(scope="session")
def run_gelsim(gelsim_path):
    """Runs the program under test; see `Command`."""
    return Command(gelsim_path)


@pytest.fixture(scope="session")
def torch_python(pytestconfig):
    """An interpreter that has torch and this project's module; skips the test where there is none."""
    if named := pytestconfig.getoption("--torch-python"):
        return named
    if importlib.util.find_spec("torch"):
        return sys.executable
    pytest.skip("no torch here: --torch-python PATH names an interpreter that has it")


@pytest.fixture(scope="session")
def wheel(pytestconfig, tmp_path_factory):
    """This project's wheel: the one in `--wheels`, or made as `pip install .` makes it, which compiles."""
    folder = pathlib.Path(pytestconfig.getoption("--wheels") or tmp_path_factory.mktemp("wheels")).resolve()
    if not list(folder.glob("gelsim-*.whl")):
        if not shutil.which("cargo"):
            pytest.skip("no cargo here: --wheels FOLDER names a folder that has the wheel")
        line = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", folder, PROJECT]
        done = subprocess.run(line, capture_output=True, text=True)
        assert done.returncode == 0, f"{line}\n{done.stdout}{done.stderr}"
    return next(folder.glob("gelsim-*.whl"))


@pytest.fixture(scope="session")
def quickstart(run_gelsim, tmp_path_factory):
    """The quickstart's dataset in few pixels."""
    out = tmp_path_factory.mktemp("quickstart") / "out/quickstart"
    return run_gelsim.generate(PROJECT / "configs/quickstart.toml", out, "--set", "sensor.resolution_px=[160, 120]")


@pytest.fixture(scope="session")
def every_kind(run_gelsim, tmp_path_factory):
    """Datasets of every kind; see `every_kind.Datasets`."""
    from every_kind import Datasets

    return Datasets(run_gelsim, PROJECT, tmp_path_factory.mktemp("every-kind"))
