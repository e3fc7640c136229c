"""generate, augment, render and report killed at their system calls, and these failing, by strace. A run then ends
with a documented status, in words, and leaves nothing under a final name but what an undisturbed run makes; the same
command ends the work, with the same bytes and nothing beside them.

    EVERY=1 pytest tests/python/test_inject.py --full -rP       every N-th occurrence of a call, 1: all; without it 3
    ONLY=report/0/openat/3/EIO pytest ..                        one of those, shown; or all whose names begin so

strace counts calls by thread, from where it is attached. A run is stopped at its `main`, or at the start of one of its
threads, and only that thread is traced: so every call of every thread has a number that is the same in every run, and
what the system's loader does before `main` is left alone.
"""

import array
import collections
import concurrent.futures
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time

import pytest
from sets import content

pytestmark = pytest.mark.full

EVERY, ONLY = int(os.environ.get("EVERY", 3)), os.environ.get("ONLY", "")
# As few threads as there can be.
ENVIRONMENT = {**os.environ, "RAYON_NUM_THREADS": "1"}
PATIENCE_S = 60
# Of a call that is made seldom, so many occurrences are tried for each error at least.
FEW = 6

KILL, OUT_OF_MEMORY = "KILL", "ENOMEM"
READS, STATS, MAPS = "EIO EINTR", "EIO EACCES ENOMEM", OUT_OF_MEMORY
# What each call is told has happened. All of it is something that a system does.
ERRORS = {
    "openat": "EIO ENOSPC EACCES EMFILE EINTR", "close": READS, "read": READS, "pread64": READS, "getdents64": "EIO",
    "write": "ENOSPC EIO EINTR", "writev": "ENOSPC EIO EINTR", "pwrite64": "ENOSPC EIO EINTR", "lseek": "EIO",
    "fstat": STATS, "newfstatat": STATS, "statx": STATS, "access": "EACCES EIO", "faccessat2": "EACCES EIO",
    "readlink": "EACCES EIO", "readlinkat": "EACCES EIO", "getcwd": "ENOENT", "chdir": "EACCES",
    "rename": "EIO EACCES ENOSPC", "renameat": "EIO EACCES ENOSPC", "renameat2": "EIO EACCES ENOSPC EINVAL",
    "link": "EIO EPERM ENOSPC", "linkat": "EIO EPERM ENOSPC", "unlink": "EIO EACCES", "unlinkat": "EIO EACCES",
    "mkdir": "EIO EACCES ENOSPC", "mkdirat": "EIO EACCES ENOSPC", "rmdir": "EIO EACCES",
    "fsync": "EIO ENOSPC", "fdatasync": "EIO ENOSPC", "syncfs": "EIO ENOSPC", "sync": "",
    "ftruncate": "EIO ENOSPC", "fallocate": "EIO ENOSPC", "copy_file_range": "EIO ENOSPC", "sendfile": "EIO ENOSPC",
    "fchmod": "EPERM", "flock": "EIO EINTR ENOLCK", "fcntl": "EIO EMFILE",
    "mmap": MAPS, "mremap": MAPS, "mprotect": MAPS, "brk": MAPS, "clone": "EAGAIN", "clone3": "EAGAIN ENOMEM",
    "pipe2": "EMFILE", "socketpair": "EMFILE", "eventfd2": "EMFILE", "getrandom": "EINTR",
}  # fmt: skip
# What Rust's own library does not take: a folder that is not closed, which no system does, and no memory for the stack
# on which a thread learns that its own is at its end.
RUST = "unexpected error during closedir|failed to (allocate an|set up) alternative stack"

JOB = """\
dataset = { name = "tiny", samples = 4, samples_per_shard = 2, seed = SEED, splits = { train = 0.5, test = 0.5 } }
sensor.resolution_px = [32, 24]
object = [{ path = "stones/*.obj" }]
pose = { x_mm = [-2.0, 2.0], y_mm = [-1.0, 1.0], anchor = "origin" }
indentation.depth_mm = [0.3, 0.6]
output = { layers = ["depth"], container = "CONTAINER" }
"""
SENSORS = """
[sensors]
count = 2
"""
SEQUENCE = """
[sequence]
frame_rate_hz = 25.0
friction.coefficient = 0.5
[[sequence.phase]]
name = "press"
duration_s = 0.08
depth_mm = [0.3, 0.6]
"""
RECIPE = """\
seed = SEED
[input]
path = "real"
background = "rendered"
[[photometric]]
copies = 1
exposure_ev = [-0.3, 0.3]
[paired]
[[object]]
path = "stones/*.obj"
[mixing]
job = "new.toml"
synthetic_per_real = 0.5
"""
STONE = """\
v R 0 0
v -R 0 0
v 0 R 0
v 0 -R 0
v 0 0 R
v 0 0 -R
f 1 3 5
f 3 2 5
f 2 4 5
f 4 1 5
f 3 1 6
f 2 3 6
f 4 2 6
f 1 4 6
"""
REPORT = "out/report.html"
GENERATE = "generate job.toml --out out --threads 1 --quiet"
AUGMENT = "augment augment.toml --out out --overwrite --threads 1 --quiet"
RENDER_LOG = "render --depth frames --depth-unit mm --plane-mm 10 --sensor gelsight-2014 --threads 1 --quiet --out out/tactile.mcap"
RENDER = "render --depth frames --depth-unit mm --plane-mm 10 --sensor gelsight-2014 --out out --threads 1 --quiet"

# A command, what it finds, and whether files of before and of after may stand side by side.
Case = collections.namedtuple("Case", "name command prepare mixed")
# One run: a case, the thread in the order of their start, the call, which of its occurrences, and what becomes of it.
Injection = collections.namedtuple("Injection", "case thread call number what")


def name(injection):
    return "/".join(str(part) for part in (injection.case.name.replace(" ", "-"), *injection[1:]))


def job(folder, container="tar", seed=7):
    (folder / "stones").mkdir(exist_ok=True)
    for radius in "23":
        (folder / f"stones/stone-{radius}.obj").write_text(STONE.replace("R", radius))
    (folder / "job.toml").write_text(JOB.replace("SEED", str(seed)).replace("CONTAINER", container))


def sequences(folder):
    job(folder)
    text = (folder / "job.toml").read_text()
    (folder / "job.toml").write_text(text.replace("indentation.depth_mm = [0.3, 0.6]\n", "") + SEQUENCE)


def set_of_sensors(folder):
    job(folder)
    text = (folder / "job.toml").read_text()
    (folder / "job.toml").write_text(text.replace("samples = 4, samples_per_shard = 2", "samples = 2, samples_per_shard = 1") + SENSORS)


def another(folder, container):
    """The dataset of another seed."""
    job(folder, container, seed=8)
    run(GENERATE, folder)
    job(folder, container)


def damaged(folder, container):
    """A dataset of which one shard is broken and another one has lost its stats."""
    job(folder, container)
    run(GENERATE, folder)
    for shard in (folder / "out/data").glob("train-000000*"):
        (shard / "metadata.jsonl" if shard.is_dir() else shard).write_text("half")
    (folder / "out/stats/test-000000.json").unlink()


def real(folder, container="tar", enlarged_before=False):
    job(folder, container, seed=3)
    run("generate job.toml --out real --quiet", folder)
    (folder / "job.toml").unlink()
    (folder / "new.toml").write_text(JOB.replace("SEED", "5").replace("CONTAINER", "tar"))
    if enlarged_before:
        (folder / "augment.toml").write_text(RECIPE.replace("SEED", "8"))
        run(AUGMENT, folder)
    (folder / "augment.toml").write_text(RECIPE.replace("SEED", "7"))


def frames(folder, rendered_before=""):
    """Balls of 4 mm, half a millimetre and less in the pad, as npy arrays of singles."""
    (folder / "frames").mkdir()
    for stem, deep in [("a", 0.5), ("b", 0.3)]:
        values = array.array("f")
        for y in range(24):
            for x in range(32):
                square = 16 - ((x - 15.5) * 20 / 32) ** 2 - ((y - 11.5) * 15 / 24) ** 2
                values.append(14 - deep - square**0.5 if square > 0 else 90.0)
        if sys.byteorder == "big":
            values.byteswap()
        header = b"{'descr': '<f4', 'fortran_order': False, 'shape': (24, 32), }\n"
        start = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little")
        (folder / f"frames/{stem}.npy").write_bytes(start + header + values.tobytes())
    if rendered_before:
        run(f"{rendered_before} --fidelity paper --layers contact", folder)


def dataset(folder):
    job(folder)
    run(GENERATE, folder)


CASES = [
    Case("generate tars", GENERATE, lambda folder: job(folder, "tar"), False),
    Case("generate folders", GENERATE, lambda folder: job(folder, "folder"), False),
    Case("generate damaged", GENERATE, lambda folder: damaged(folder, "folder"), True),
    Case("generate over", f"{GENERATE} --overwrite", lambda folder: another(folder, "tar"), False),
    Case("generate sequences", GENERATE, sequences, False),
    Case("generate sensors", GENERATE, set_of_sensors, False),
    Case("augment", AUGMENT, real, False),
    Case("augment over", AUGMENT, lambda folder: real(folder, "folder", True), False),
    Case("render", RENDER, frames, True),
    Case("render over", RENDER, lambda folder: frames(folder, RENDER), True),
    Case("render log", RENDER_LOG, frames, False),
    Case("render log over", RENDER_LOG, lambda folder: frames(folder, RENDER_LOG), False),
    Case("report", "report out", dataset, False),
]


def run(command, folder):
    """An undisturbed run, which succeeds: what it says."""
    words = ["gelsim", *command.split()]
    done = subprocess.run(words, cwd=folder, env=ENVIRONMENT, stdin=subprocess.DEVNULL, capture_output=True, text=True)
    assert done.returncode == 0, f"{command}: {done.returncode}: {done.stderr}"
    return done.stderr


def found(folder):
    """What is in a folder by its path: the content of files, None of folders; and hidden paths, apart."""
    everything, hidden = {}, set()
    for path in sorted(folder.rglob("*")):
        relative = path.relative_to(folder)
        if any(part.startswith(".") for part in relative.parts):
            hidden.add(str(relative))
        else:
            everything[str(relative)] = None if path.is_dir() else content(path)
    return everything, hidden


def tracer(process):
    status = pathlib.Path(f"/proc/{process}/status").read_text()
    return int(re.search(r"TracerPid:\s*(\d+)", status)[1])


def until(condition):
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end, "strace neither comes nor goes"
        time.sleep(0.0005)


def stopped(command, folder, said, thread):
    """Starts a command and stops it: at its `main` for thread 0, otherwise where its thread of that number starts. The
    process, and the thread's number for the system; None if it ended first."""
    # What Rust's runtime does first, and what a thread does first, the main thread included.
    at = "?poll,?ppoll" if thread == 0 else "set_robust_list"
    strace = ["strace", "-D", "-f", "-qq", "-o", os.devnull, "-e", f"trace={at}"]
    strace += ["-e", f"inject={at}:signal=STOP:when=1"]
    with open(said, "wb") as said:
        run = subprocess.Popen([*strace, "gelsim", *command.split()], cwd=folder, env=ENVIRONMENT,
                               stdin=subprocess.DEVNULL, stdout=said, stderr=said)  # fmt: skip
    threads = set()
    while True:
        _, status = os.waitpid(run.pid, os.WUNTRACED)
        if not os.WIFSTOPPED(status):
            run.returncode = os.waitstatus_to_exitcode(status)
            return run, None
        threads |= {int(task) for task in os.listdir(f"/proc/{run.pid}/task")}
        if len(threads) > thread:
            break
        os.kill(run.pid, signal.SIGCONT)
    # Asked to end, strace might let go of a thread that has not stopped yet; the kernel does not.
    os.kill(tracer(run.pid), signal.SIGKILL)
    until(lambda: tracer(run.pid) == 0)
    return run, sorted(threads)[thread]


def traced(command, folder, said, log, thread, options):
    """Runs a command under strace with these options from where `stopped` stops it. Its exit status, negative for a
    signal; None if it did not get there, or "hangs"."""
    process, task = stopped(command, folder, said, thread)
    if task is None:
        return None
    strace = subprocess.Popen(["strace", "-qq", "-o", log, "-p", str(task), *options], stderr=subprocess.PIPE)
    until(lambda: tracer(task) or strace.poll() is not None)
    if strace.poll() is not None:
        process.kill()
        raise AssertionError(strace.stderr.read().decode())
    hangs = threading.Event()
    watchdog = threading.Timer(PATIENCE_S, lambda: (hangs.set(), process.kill()))
    watchdog.start()
    os.kill(process.pid, signal.SIGCONT)
    status = process.wait()
    watchdog.cancel()
    strace.communicate()
    return "hangs" if hangs.is_set() else status


class Reference:
    """A case undisturbed: what stands there before and after it, and the calls of its threads."""

    def __init__(self, case, root):
        self.case, self.template = case, root / case.name.replace(" ", "-") / "before"
        self.template.mkdir(parents=True)
        case.prepare(self.template)
        after = self.template.with_name("after")
        shutil.copytree(self.template, after)
        run(case.command, after)
        self.before, self.after = found(self.template), found(after)
        assert not self.before[1] and not self.after[1], "an undisturbed run leaves something behind"
        self.kept = {path for path in self.before[0] if path.split("/")[0] != "out" or case.name == "report"}
        # Traced, it does the same.
        again, said, log = (self.template.with_name(name) for name in ("again", "said", "log"))
        shutil.copytree(self.template, again)
        status = traced(case.command, again, said, log, 0, ["-f"])
        assert status == 0 and found(again) == self.after, f"{case.name}: {status}: {said.read_text()}"
        calls = re.findall(r"^(\d+) +(\w+)\(", log.read_text(), re.MULTILINE)
        # The system numbers threads in the order in which they are made.
        threads = sorted({int(thread) for thread, _ in calls})
        self.calls = collections.Counter((threads.index(int(thread)), call) for thread, call in calls)

    def injections(self, every):
        """Every so manieth occurrence of each call, another one for each thing that becomes of it."""
        occurrences = collections.defaultdict(list)
        for (thread, call), count in self.calls.items():
            occurrences[call] += [(thread, number + 1) for number in range(count)]
        for call in sorted(occurrences.keys() & ERRORS.keys()):
            step = min(every, max(1, len(occurrences[call]) // FEW))
            for k, what in enumerate([*ERRORS[call].split(), KILL]):
                for thread, number in occurrences[call][k % step :: step]:
                    yield Injection(self.case, thread, call, number, what)

    def left_alone(self):
        return {call for _, call in self.calls} - ERRORS.keys()


def inject(reference, injection):
    """What came of it: "failed", "survived", "killed", "aborted" or "not reached"; what is wrong with that, if anything
    is; and what it looked like."""
    # What one thread does and what it leaves to another may differ between runs.
    for _ in range(3):
        came = inject_once(reference, injection)
        if came[0] != "not reached":
            break
    return came


def inject_once(reference, injection):
    case, thread, call, number, what = injection
    with tempfile.TemporaryDirectory(dir=reference.template.parent) as scratch:
        folder, said, log = (pathlib.Path(scratch) / name for name in ("case", "said", "log"))
        shutil.copytree(reference.template, folder)
        # A failed brk says where the heap ends.
        fault = "signal=KILL" if what == KILL else "retval=0" if call == "brk" else f"error={what}"
        options = ["-e", f"trace={call}", "-e", f"inject={call}:{fault}:when={number}"]
        status = traced(case.command, folder, said, log, thread, options)
        trace, words = log.read_text() if log.exists() else "", said.read_text(errors="replace")
        reached = status == -signal.SIGKILL if what == KILL else "INJECTED" in trace
        wrong = []
        try:
            end = judged(reference, injection, status, words, folder, wrong) if reached or status else "not reached"
            went_on(reference, folder, wrong)
        except (AssertionError, ValueError, KeyError) as error:
            end = "failed"
            wrong.append(str(error))
        last = [line for line in trace.splitlines() if "INJECTED" in line or what == KILL and "(" in line][-1:]
        return end, wrong, f"{(last or [''])[0][:200]}\n    {words.strip()[:600]}"


def judged(reference, injection, status, words, folder, wrong):
    """How a disturbed run ended. What is not as it should be is added to `wrong`."""
    files, _ = found(folder)
    before, after = reference.before[0], reference.after[0]
    if reference.case.name == "report" and re.search("^warning: .", words, re.MULTILINE):
        # The page is made of what can be read, and says what cannot.
        after = {**after, REPORT: files.get(REPORT)}
    if gone := sorted(path for path in reference.kept if path not in files):
        wrong.append(f"gone: {gone}")
    strange = [path for path, what in files.items() if all(what != side.get(path, 0) for side in (before, after))]
    if strange:
        wrong.append(f"neither as before nor as after: {strange}")
    elif not reference.case.mixed and not any(files.items() <= side.items() for side in (before, after)):
        wrong.append("some files are as before, others as after")
    if re.search(RUST, words):
        return "aborted"
    if "panicked" in words or status == 101:
        wrong.append("a panic")
    if status == "hangs":
        wrong.append("it hangs")
    elif status == 0:
        if files != after:
            missing = sorted(path for path in after if path not in files)
            wrong.append(f"status 0, and the output is not complete: {missing} are missing")
        return "survived"
    elif status == -signal.SIGKILL and injection.what == KILL:
        return "killed"
    elif status == -signal.SIGABRT and injection.what == OUT_OF_MEMORY and ERRORS[injection.call] == MAPS:
        return "aborted"
    elif status not in (1, 2):
        wrong.append(f"status {status}")
    elif not re.search("^error: .", words, re.MULTILINE):
        wrong.append(f"status {status} without words")
    return "failed"


def went_on(reference, folder, wrong):
    """The same command, undisturbed, ends the work."""
    try:
        run(reference.case.command, folder)
        if reference.case.command.startswith("generate"):
            # Also the seals of files that hold times.
            run("verify out --checksums", folder)
    except AssertionError as error:
        wrong.append(f"the same command fails: {error}")
    files, hidden = found(folder)
    if hidden:
        wrong.append(f"left behind: {sorted(re.sub(r'[.][0-9]+[.]partial', '.PID.partial', path) for path in hidden)}")
    if differing := sorted(path for path in files.keys() | reference.after[0].keys()
                           if files.get(path, 0) != reference.after[0].get(path, 0)):  # fmt: skip
        wrong.append(f"the same command ends with other content: {differing}")


def table(ends):
    """A line for each call and what became of it."""
    kinds = ["failed", "survived", "killed", "aborted", "not reached", "wrong"]
    lines = [["call", "what", "injected", "failed in words", *kinds[1:]]]
    for key, counts in ends.items():
        injected = sum(counts[kind] for kind in kinds[:4])
        lines.append([*key, str(injected), *(str(counts[kind] or "") for kind in kinds)])
    widths = [max(len(line[k]) for line in lines) for k in range(len(lines[0]))]
    for line in lines:
        cells = [cell.ljust(width) if k < 2 else cell.rjust(width) for k, (cell, width) in enumerate(zip(line, widths))]
        print("  ".join(cells).rstrip())


@pytest.fixture(scope="module")
def root():
    """A folder where strace may trace, in memory if that is possible: thousands of runs wait for the disk otherwise."""
    if not shutil.which("strace"):
        pytest.skip("no strace: apt install strace")
    memory = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
    with tempfile.TemporaryDirectory(dir=memory) as root:
        probe = pathlib.Path(root) / "probe"
        probe.mkdir()
        try:
            works = traced("list sensors", probe, probe / "said", probe / "log", 0, []) == 0
        except (AssertionError, FileNotFoundError, ProcessLookupError):
            works = False
        if not works:
            pytest.skip("this system does not let strace attach to a process")
        yield pathlib.Path(root)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_a_call_that_fails_or_kills_ends_in_words_and_the_command_resumes(gelsim_path, root, case):
    if not name(Injection(case, *"0000")).startswith(ONLY.split("/")[0]):
        pytest.skip(f"ONLY={ONLY}")
    reference, start = Reference(case, root), time.monotonic()
    injections = [each for each in reference.injections(1 if ONLY else EVERY) if name(each).startswith(ONLY)]
    ends, causes = {}, {}
    with concurrent.futures.ThreadPoolExecutor(min(2, os.cpu_count())) as pool:
        for injection, (end, wrong, looks) in zip(injections, pool.map(lambda one: inject(reference, one), injections)):
            counts = ends.setdefault((injection.call, injection.what), collections.Counter())
            counts[end] += 1
            if wrong:
                counts["wrong"] += 1
                causes.setdefault("; ".join(wrong), []).append(f"ONLY={name(injection)}\n    {looks}")
            if ONLY:
                print(f"{name(injection)}: {end}; {'; '.join(wrong) or 'nothing wrong'}\n    {looks}")
    table(ends)
    total = sum(ends.values(), collections.Counter())
    print(f"\nneither killed nor failed, as no file depends on them: {', '.join(sorted(reference.left_alone()))}")
    print(", ".join(f"{count} {end}" for end, count in sorted(total.items())))
    print(f"{len(injections)} injections into {sum(reference.calls.values())} calls ({time.monotonic() - start:.0f} s)")
    said = [f"{len(where)} times: {wrong}\n" + "\n".join(where[:3]) for wrong, where in causes.items()]
    assert not said, "\n\n".join(said)
