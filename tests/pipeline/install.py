"""Installs gelsim in a fresh venv as `pip install .` does and compares the command with cargo's.

    python install.py GELSIM [WHEELS]       from the project's root; the command that cargo built, and a folder that keeps
                                            the wheel

CARGO_TARGET_DIR, if it is set, keeps what is compiled for the next time.
"""

import filecmp
import os
import signal
import subprocess
import sys
import tempfile
import time
import venv
from pathlib import Path

native = Path(sys.argv[1]).resolve()
project = Path.cwd()
quickstart = project / "configs/quickstart.toml"


def run(*command, **more):
    return subprocess.run([str(part) for part in command], capture_output=True, text=True, timeout=1800, **more)


def succeed(*command, **more):
    result = run(*command, **more)
    assert result.returncode == 0, f"{command}: {result.returncode}\n{result.stdout}\n{result.stderr}"
    return result.stdout


def same(what, *arguments, status, **more):
    """Both commands end with `status` and print the same."""
    theirs, ours = run(native, *arguments, **more), run(wheel, *arguments, **more)
    assert theirs.returncode == ours.returncode == status, (what, theirs, ours)
    assert (theirs.stdout, theirs.stderr) == (ours.stdout, ours.stderr), (what, theirs, ours)
    return ours


def same_files(one, other):
    names = [path.relative_to(one) for path in one.rglob("*") if path.is_file() and path.parent.name != "stats"]
    assert any(name.suffix == ".tar" for name in names)
    equal, different, missing = filecmp.cmpfiles(one, other, names, shallow=False)
    assert len(equal) == len(names), (different, missing)


def begin(folder, job, **environment):
    command = [wheel, "generate", *job, "--out", folder, "--threads", "1"]
    pipes = {"stdin": subprocess.PIPE, "stderr": subprocess.PIPE}
    return subprocess.Popen(command, text=True, env={**os.environ, **environment}, **pipes)


def assert_interrupted(process):
    """It ends, without its standard input, as by SIGINT and says so as the command does, not as Python."""
    status, said = process.wait(timeout=300), process.stderr.read()
    assert status == 130, (status, said)
    assert "Traceback" not in said and "KeyboardInterrupt" not in said, said


with tempfile.TemporaryDirectory() as root:
    root = Path(root)
    venv.create(root / "venv", with_pip=True)
    python, wheel = root / "venv/bin/python", root / "venv/bin/gelsim"
    wheels = Path(sys.argv[2]) if len(sys.argv) > 2 else root / "wheels"
    pip = python, "-m", "pip", "--quiet", "--disable-pip-version-check"
    # What `pip install .` does, in two steps.
    succeed(*pip, "wheel", "--no-deps", "--wheel-dir", wheels, ".")
    succeed(*pip, "install", *wheels.glob("gelsim-*.whl"))

    version = succeed(native, "--version")
    assert succeed(wheel, "--version") == version == succeed(python, "-m", "gelsim", "--version")
    assert succeed(python, "-c", "import gelsim; print('gelsim', gelsim.__version__)", cwd=root) == version

    # The command needs no numpy, and the module says that it does.
    loaded = run(python, "-c", f"import gelsim; gelsim.Job.load({str(quickstart)!r})", cwd=root)
    assert loaded.returncode == 1 and "ImportError: gelsim" in loaded.stderr and "pip install numpy" in loaded.stderr, loaded

    for command in (native, wheel):
        succeed(command, "generate", quickstart, "--samples", "20", "--out", root / command.parent.name)
    same_files(root / native.parent.name, root / wheel.parent.name)
    same("a whole dataset", "verify", root / wheel.parent.name, status=0)

    same("help", "generate", "--help", status=0)
    same("nothing to do", status=2)
    same("a mistyped flag", "generate", quickstart, "--sampels", "20", status=2)
    same("no such job", "generate", root / "absent.toml", status=2)
    same("a name that is not text", "plan", os.fsencode(root / "job") + b"\xff.toml", status=2)
    same("a wrong job", "plan", quickstart, "--set", "indentation.depth_mm=-1", status=2)
    same("no dataset", "verify", root, status=2)
    tar = next((root / wheel.parent.name / "data").iterdir())
    tar.write_bytes(tar.read_bytes()[:-1024])
    same("a damaged dataset", "verify", root / wheel.parent.name, status=1)
    # A reader that has had enough.
    assert succeed("bash", "-c", f'set -o pipefail; "{wheel}" schema job 2>&1 | head -n 1') == "{\n"

    small = ["--set", "sensor.resolution_px=[64, 48]", "--set", "dataset.samples_per_shard=5", "--samples", "3000"]
    stopped = root / "stopped"
    process = begin(stopped, [quickstart, *small])
    while len(list(stopped.glob("stats/*.json"))) <= 2:
        assert process.poll() is None, process.stderr.read()
        time.sleep(0.002)
    process.send_signal(signal.SIGINT)
    assert_interrupted(process)
    finished = len(list(stopped.glob("stats/*.json")))
    assert 2 < finished < 600 and not (stopped / "dataset.json").exists()
    assert not list(stopped.glob("data/.*.partial")), "a run that is stopped cleans up"

    # A second signal does not wait for the work under way, which is held here: what was begun is left there.
    ended = root / "ended"
    process = begin(ended, [quickstart, *small], GELSIM_FAIL_POINT="shard begun")
    assert any("waiting for a line" in line for line in process.stderr), "it ended before it was held"
    # Two that come at once count as one.
    while process.poll() is None:
        process.send_signal(signal.SIGINT)
        time.sleep(0.05)
    assert_interrupted(process)
    assert list(ended.glob("data/.*.partial")), "the first signal alone has ended it"
print(f"pip install .: {version.strip()}, the same bytes, messages and exit statuses")
