"""gelsim in a fresh environment, as `pip install .` installs it, against the command that cargo built."""

import filecmp
import os
import shutil
import signal
import subprocess
import time
import venv
from collections import defaultdict
from types import SimpleNamespace

import pytest

pytestmark = pytest.mark.build


def run(*command, **more):
    return subprocess.run([os.fsencode(part) for part in command], capture_output=True, timeout=300, **more)


def succeed(*command, **more):
    """What a command prints, which succeeds."""
    done = run(*command, **more)
    assert done.returncode == 0, f"{command}\n{done.stdout.decode()}{done.stderr.decode()}"
    return done.stdout.decode()


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    """The environment's interpreter and command."""
    folder = tmp_path_factory.mktemp("installed")
    venv.create(folder / "venv", with_pip=True)
    python = folder / "venv/bin/python"
    succeed(python, "-m", "pip", "--quiet", "--disable-pip-version-check", "install", wheel)
    return SimpleNamespace(python=python, gelsim=folder / "venv/bin/gelsim")


@pytest.fixture(scope="module")
def job(project):
    return project / "configs/quickstart.toml"


@pytest.fixture(scope="module")
def datasets(installed, gelsim_path, job, tmp_path_factory):
    """What cargo's command and the wheel's write."""
    folder = tmp_path_factory.mktemp("datasets")
    for name, command in [("cargo", gelsim_path), ("wheel", installed.gelsim)]:
        succeed(command, "generate", job, "--samples", "20", "--out", folder / name)
    return folder


def features(project, *more):
    """The features that each crate is compiled with, once as part of build scripts and macros and once of programs."""
    line = ["cargo", "tree", "--locked", "--prefix", "none", "--no-dedupe", "--format", "{p}\t{f}", *more]
    found = defaultdict(set)
    for crate in filter(None, succeed(*line, cwd=project).splitlines()):
        name, given = crate.split("\t")
        found[name].add(given)
    return found


@pytest.mark.skipif(not shutil.which("cargo"), reason="no cargo: https://rustup.rs")
@pytest.mark.parametrize("package", ["gelsim", "gelsim-python"])
def test_an_installation_takes_what_cargo_run_and_cargo_test_have_compiled(project, package):
    """A crate with other features would be compiled again, and all that use it."""
    ours, theirs = features(project), features(project, "--package", package, "--edges", "normal,build")
    different = {name: (ours[name], given) for name, given in theirs.items() if ours.get(name, given) != given}
    assert not different, "src/cli/Cargo.toml lists the features that must be the same"
    assert len(theirs.keys() & ours.keys()) > 100


def test_all_say_the_same_version(installed, gelsim_path, tmp_path):
    version = succeed(gelsim_path, "--version")
    assert succeed(installed.gelsim, "--version") == version == succeed(installed.python, "-m", "gelsim", "--version")
    code = "import gelsim; print('gelsim', gelsim.__version__)"
    assert succeed(installed.python, "-c", code, cwd=tmp_path) == version


def test_the_module_asks_for_numpy_which_the_command_needs_not(installed, job, tmp_path):
    done = run(installed.python, "-c", f"import gelsim; gelsim.Job.load({str(job)!r})", cwd=tmp_path)
    assert done.returncode == 1
    assert b"ImportError: gelsim" in done.stderr and b"pip install numpy" in done.stderr, done.stderr


def test_both_commands_write_the_same_bytes(datasets):
    one, other = datasets / "cargo", datasets / "wheel"
    names = [path.relative_to(one) for path in one.rglob("*") if path.is_file() and path.parent.name != "stats"]
    assert any(name.suffix == ".tar" for name in names)
    _, different, missing = filecmp.cmpfiles(one, other, names, shallow=False)
    assert (different, missing) == ([], [])


def damage(dataset):
    tar = next((dataset / "data").iterdir())
    tar.write_bytes(tar.read_bytes()[:-1024])


@pytest.mark.parametrize(
    "arguments, status",
    [
        pytest.param(["generate", "--help"], 0, id="help"),
        pytest.param([], 2, id="nothing to do"),
        pytest.param(["generate", "{job}", "--sampels", "20"], 2, id="a mistyped flag"),
        pytest.param(["generate", "absent.toml"], 2, id="no such job"),
        pytest.param(["plan", b"job\xff.toml"], 2, id="a name that is not text"),
        pytest.param(["plan", "{job}", "--set", "indentation.depth_mm=-1"], 2, id="a wrong job"),
        pytest.param(["verify", "."], 2, id="no dataset"),
        pytest.param(["verify", "{dataset}"], 0, id="a valid dataset"),
        pytest.param(["verify", "{damaged}"], 1, id="a damaged dataset"),
    ],
)
def test_both_commands_say_the_same(installed, gelsim_path, job, datasets, tmp_path, arguments, status):
    damaged = tmp_path / "damaged"
    if "{damaged}" in arguments:
        succeed("cp", "-r", datasets / "wheel", damaged)
        damage(damaged)
    places = {"job": job, "dataset": datasets / "wheel", "damaged": damaged}
    words = [word if isinstance(word, bytes) else word.format(**places) for word in arguments]
    theirs, ours = (run(command, *words, cwd=tmp_path) for command in (gelsim_path, installed.gelsim))
    assert theirs.returncode == ours.returncode == status
    assert (theirs.stdout, theirs.stderr) == (ours.stdout, ours.stderr)


def test_a_reader_may_have_enough(installed):
    assert succeed("bash", "-c", f'set -o pipefail; "{installed.gelsim}" schema job 2>&1 | head -n 1') == "{\n"


@pytest.fixture
def begin(installed, job):
    """Begins to write a dataset of 600 shards."""

    def begin(out, **environment):
        small = ["--set", "sensor.resolution_px=[64, 48]", "--set", "dataset.samples_per_shard=5", "--samples", "3000"]
        line = [installed.gelsim, "generate", job, *small, "--out", out, "--threads", "1"]
        pipes = {"stdin": subprocess.PIPE, "stderr": subprocess.PIPE}
        return subprocess.Popen(line, text=True, env={**os.environ, **environment}, **pipes)

    return begin


def assert_interrupted(process):
    """It ends, without its standard input, as by SIGINT and says so as the command does, not as Python."""
    status, said = process.wait(timeout=300), process.stderr.read()
    assert status == 130, said
    assert "Traceback" not in said and "KeyboardInterrupt" not in said, said


def test_control_c_ends_a_run_which_cleans_up(begin, tmp_path):
    process = begin(tmp_path / "stopped")
    while len(list(tmp_path.glob("stopped/stats/*.json"))) <= 2:
        assert process.poll() is None, process.stderr.read()
        time.sleep(0.002)
    process.send_signal(signal.SIGINT)
    assert_interrupted(process)
    assert 2 < len(list(tmp_path.glob("stopped/stats/*.json"))) < 600
    assert not (tmp_path / "stopped/dataset.json").exists()
    assert not list(tmp_path.glob("stopped/data/.*.partial"))


def test_a_second_control_c_does_not_wait_for_the_work_under_way(begin, tmp_path):
    """It is held here: what was begun is left."""
    process = begin(tmp_path / "ended", GELSIM_FAIL_POINT="shard begun")
    assert any("waiting for a line" in line for line in process.stderr), "it ended before it was held"
    # Two that come at once count as one.
    while process.poll() is None:
        process.send_signal(signal.SIGINT)
        time.sleep(0.05)
    assert_interrupted(process)
    assert list(tmp_path.glob("ended/data/.*.partial")), "the first signal alone has ended it"
