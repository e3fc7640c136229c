"""Processes that a test started: found, caught in the middle of their work, killed as by a power cut."""

import contextlib
import ctypes
import os
import pathlib
import signal
import subprocess
import time

import pytest

PATIENCE_S = 300

# Fills a disk of `SIZE` with what a command writes, makes room, and runs the command again; in namespaces of its own.
FILLED = """
mount -t tmpfs -o size="$SIZE" none "$DISK" || exit 98
"$@"; first=$?
mount -o remount,size=1g "$DISK" || exit 98
[ ! -e "$COPY" ] || [ $first = 0 ] || [ -n "$STAYS" ] || exit 96
"$@" >&2 || exit 97
cp -r "$COPY" "$AGAIN"
exit $first
"""


@contextlib.contextmanager
def adopted():
    """What a child of ours leaves behind becomes our child, not init's, so that it can be found; none of it stays."""
    subreaper = 36  # PR_SET_CHILD_SUBREAPER
    before = set(descendants(os.getpid()))
    ctypes.CDLL(None).prctl(subreaper, 1)
    handler = signal.signal(signal.SIGTERM, lambda *_: pytest.exit("SIGTERM", returncode=143))
    try:
        yield
    finally:
        while below := set(descendants(os.getpid())) - before:
            kill(below)
            for process in below:
                with contextlib.suppress(ChildProcessError):
                    os.waitpid(process, 0)
        signal.signal(signal.SIGTERM, handler)
        ctypes.CDLL(None).prctl(subreaper, 0)


def run(*line, status=0, **options):
    """Runs a program, checks how it ends, and gives what it printed: `stdout` and `stderr`."""
    done = subprocess.run(list(map(str, line)), **{"capture_output": True, "text": True, **options})
    assert done.returncode == status, f"{line} ended with {done.returncode}\n{done.stdout}{done.stderr}"
    return done


def kill(processes):
    """Kills processes at once."""
    for process in processes:
        with contextlib.suppress(ProcessLookupError):
            os.kill(process, signal.SIGKILL)


def parent(process):
    """The parent's number; 0 for what is gone or only waits to be reaped."""
    with contextlib.suppress(OSError):
        state, number = pathlib.Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[:2]
        return 0 if state == "Z" else int(number)
    return 0


def descendants(root):
    """Numbers of all processes below `root`."""
    parents = {int(path.name): parent(path.name) for path in pathlib.Path("/proc").glob("[0-9]*")}
    found = [root]
    for process in found:
        found += [child for child, its in parents.items() if its == process]
    return found[1:]


def finished(folder):
    """Names of the shards that are complete."""
    return {path.stem for path in folder.glob("out/stats/*.json")}


def caught(folder, eligible=lambda process: True):
    """Stops (as by Ctrl-Z) a process in the middle of a shard, some others being finished: its number."""
    def writers():
        for lock in folder.glob("out/data/.*.lock"):
            with contextlib.suppress(OSError, IndexError):
                yield int(lock.read_text().split()[1])

    def look():
        for process in filter(eligible, writers()) if finished(folder) else []:
            os.kill(process, signal.SIGSTOP)
            if process in writers():
                return process
            os.kill(process, signal.SIGCONT)
        return None

    return wait(look, "a task in the middle")


def wait(condition, what):
    """Waits until `condition` gives something, and gives it back."""
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        if found := condition():
            return found
        time.sleep(0.02)
    raise TimeoutError(f"no {what} within {PATIENCE_S} s")


def fill_disk(line, copy, size_kb, again, stays=False):
    """Runs a command that writes `copy`, on a disk of so many kB that is mounted at its folder, and once more with room
    on it; `again` is what is there then. Of the first run nothing may have the final name, unless it `stays`. Gives how
    that ended: its status, and what both said."""
    variables = {"SIZE": f"{size_kb}k", "DISK": copy.parent, "COPY": copy, "AGAIN": again, "STAYS": "1" if stays else ""}
    environment = {**os.environ, **{name: str(value) for name, value in variables.items()}}
    line = ["unshare", "-rm", "sh", "-c", FILLED, "sh", *map(str, line)]
    done = subprocess.run(line, env=environment, capture_output=True, text=True)
    if done.returncode in (98, 1) and "mount" in done.stderr + done.stdout or "unshare" in done.stderr:
        pytest.skip("no disk can be mounted: needs unshare -rm")
    assert done.returncode in (0, 1) and "Traceback" not in done.stderr, (size_kb, done)
    assert done.returncode == 0 or "No space left on device" in done.stderr, (size_kb, done.stderr)
    return done
