"""Processes that a test started: found, caught in the middle of their work, killed as by a power cut."""

import contextlib
import ctypes
import os
import pathlib
import signal
import time

PATIENCE_S = 300


def adopt():
    """What a child of ours leaves behind becomes our child instead of init's, so that it can be found."""
    ctypes.CDLL(None).prctl(36, 1)  # PR_SET_CHILD_SUBREAPER


def kill(processes):
    """Kills processes at once."""
    for process in processes:
        with contextlib.suppress(ProcessLookupError):
            os.kill(process, signal.SIGKILL)


def kill_descendants():
    """Leaves no process behind."""
    while below := descendants(os.getpid()):
        kill(below)
        with contextlib.suppress(ChildProcessError):
            while os.waitpid(-1, os.WNOHANG)[0]:
                pass


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
    """Names of the shards that are whole."""
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
