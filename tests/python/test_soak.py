"""Many samples and sequences in one run each, long streams and loops: the memory that takes does not grow.

    pytest tests/python/test_soak.py --full -rP

shows the resident memory of the program after each tenth of the run.
"""

import io
import itertools
import pathlib
import re
import struct
import subprocess
import threading
import time

import pytest

pytestmark = pytest.mark.full

JOB = """\
[dataset]
name = "soak"
samples = {samples}
samples_per_shard = {per_shard}

[sensor]
resolution_px = [64, 48]

[[object]]
path = "{objects}/*.obj"

[pose]
yaw_deg = [0.0, 360.0]
x_mm = [-3.0, 3.0]
y_mm = [-2.0, 2.0]
{more}
[output]
layers = ["depth", "contact"]
"""
PRESS = """
[indentation]
depth_mm = [0.2, 1.2]
no_contact = 0.1
"""
SEQUENCE = """
[sequence]
frame_rate_hz = 25.0
friction = { coefficient = [0.3, 1.0] }

[[sequence.phase]]
name = "press"
duration_s = 0.2
depth_mm = [0.3, 0.9]

[[sequence.phase]]
name = "slide"
duration_s = 0.4
x_mm = [-1.0, 1.0]
"""


def resident_mb(process):
    """What the kernel says that the process holds, MB; none once it has ended."""
    try:
        status = pathlib.Path(f"/proc/{process}/status").read_text()
    except FileNotFoundError:
        return None
    found = re.search(r"VmRSS:\s*(\d+) kB", status)
    return found and int(found[1]) / 1024


@pytest.mark.parametrize(
    "samples, shards, more", [(100_000, 200, PRESS), (1000, 100, SEQUENCE)], ids=["100,000 presses", "1,000 sequences"]
)
def test_memory_does_not_grow_during_a_run(run_gelsim, gelsim_path, project, tmp_path, samples, shards, more):
    """Once the run has come to itself: from the second tenth to the last by at most a tenth and 4 MB."""
    job = JOB.format(samples=samples, per_shard=samples // shards, objects=project / "objects", more=more)
    (tmp_path / "job.toml").write_text(job)
    start, tenths = time.monotonic(), [[] for _ in range(10)]
    line = [gelsim_path, "generate", "job.toml", "--out", "out", "--quiet", "--threads", "2"]
    run = subprocess.Popen(line, cwd=tmp_path)
    while run.poll() is None:
        done = sum(1 for _ in (tmp_path / "out/stats").glob("*.json"))
        held = resident_mb(run.pid)
        if held and done:
            tenths[min(9, 10 * done // shards)].append(held)
        time.sleep(0.1)
    assert run.returncode == 0
    run_gelsim("verify", "out", cwd=tmp_path)
    most = [max(some) for some in tenths if some]
    print(f"{time.monotonic() - start:.0f} s; MB after each tenth: {' '.join(f'{mb:.0f}' for mb in most)}")
    assert len(most) > 5, "too short to say anything"
    assert most[-1] <= 1.1 * most[1] + 4


STREAM = "render --stream --quiet --depth-unit mm --plane-mm 10 --sensor gelsight-2014 --fidelity draft"
PARTS = "--labels --layers surface,normal,contact --on-broken-frame skip"
# Rows and columns.
SIZE = (48, 64)


def stream_messages(numpy, in_sequence):
    """What a stream is fed with, again and again: a ball that comes and goes; every tenth frame has holes, and before every fiftieth of
    a sequence another object begins."""
    y, x = ((numpy.arange(count) + 0.5 - count / 2) * 20 / SIZE[1] for count in SIZE)
    over = 4 - numpy.sqrt(numpy.maximum(16 - x**2 - y[:, None] ** 2, 0))

    def npy(array):
        file = io.BytesIO()
        numpy.save(file, array)
        return file.getvalue()

    for k in range(100):
        frame = 10 - 0.7 * numpy.sin(k / 16) ** 2 + over
        message = npy(numpy.full(SIZE, numpy.nan) if k % 10 == 9 else frame)
        if in_sequence:
            reset = npy(numpy.zeros(0)) if k % 50 == 0 else b""
            message = reset + npy(numpy.array([0, 0, 0, 1, 0.01 * k, 0, 3.5])) + message
        yield message


def read_answer(pipe):
    """Reads an answer, and gives its status."""
    header = pipe.read(32)
    _, status, _, _, _, size = struct.unpack("<4sIQIIQ", header)
    assert len(pipe.read(size)) == size
    return status


@pytest.mark.parametrize(
    "flags, frames, pause_s",
    [("", 20_000, 0), ("--sequence 0.3", 6000, 0), ("", 1200, 1 / 60), ("", 2000, "now and then")],
    ids=["as fast as it goes", "a sequence", "60 Hz", "a slow reader"],
)
def test_memory_does_not_grow_during_a_stream(gelsim_path, flags, frames, pause_s):
    """In the second half it is what it was in the first, but for 1 MB."""
    numpy = pytest.importorskip("numpy", reason="no numpy: pip install numpy")
    messages = list(stream_messages(numpy, bool(flags)))
    line = [gelsim_path, *STREAM.split(), *PARTS.split(), *flags.split()]
    run = subprocess.Popen(line, stdin=subprocess.PIPE, stdout=subprocess.PIPE)

    def feed():
        for message in itertools.islice(itertools.cycle(messages), frames):
            run.stdin.write(message)
            run.stdin.flush()
            if isinstance(pause_s, float):
                time.sleep(pause_s)
        run.stdin.close()

    feeder = threading.Thread(target=feed)
    feeder.start()
    start, tenths, statuses = time.monotonic(), [[] for _ in range(10)], [0, 0]
    for k in range(frames):
        statuses[read_answer(run.stdout)] += 1
        if k % 50 == 0:
            tenths[10 * k // frames].append(resident_mb(run.pid))
            if pause_s == "now and then":
                time.sleep(0.2)
    assert run.stdout.read() == b""
    feeder.join()
    assert run.wait() == 0 and statuses == [frames * 9 // 10, frames // 10]
    most = [max(some) for some in tenths]
    print(f"{time.monotonic() - start:.0f} s; MB in each tenth: {' '.join(f'{mb:.0f}' for mb in most)}")
    assert max(most[5:]) <= max(most[:5]) + 1


@pytest.mark.parametrize("flags", ["", PARTS], ids=["images", "parts"])
def test_readers_that_die_end_their_streams(gelsim_path, flags):
    """Wherever in an answer they do."""
    numpy = pytest.importorskip("numpy", reason="no numpy: pip install numpy")
    message = next(stream_messages(numpy, False))
    for read in [0, 1, 31, 32, 5000, 9000, 70_000, 300_000]:
        run = subprocess.Popen([gelsim_path, *STREAM.split(), *flags.split()], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        reader = subprocess.Popen(["head", "-c", str(read)], stdin=run.stdout, stdout=subprocess.DEVNULL)
        run.stdout.close()
        try:
            while True:
                run.stdin.write(message)
                run.stdin.flush()
        except BrokenPipeError:
            pass
        assert reader.wait() == 0
        assert (run.stderr.read(), run.wait()) == (b"", 0)


@pytest.mark.wheel
def test_memory_does_not_grow_while_simulators_step(project):
    """Two fingers over the frames of ten minutes at 60 Hz: objects come, slide and go, and other sequences begin."""
    import gelsim
    import numpy as np

    marked = gelsim.Simulator("gelsight-mini", "draft", resolution_px=(64, 48), set={"markers.pitch_mm": 2.0})
    fingers = gelsim.Array([marked, marked], threads=2)
    ball = gelsim.Mesh.load(project / "objects/sphere.obj")
    frames, most = 600 * 60, []
    start = time.monotonic()
    for tenth in range(10):
        for frame in range(frames // 10):
            phase = frame % 200
            if phase == 0:
                fingers.reset(index=frame)
            depth_mm = min(0.02 * phase, 0.4, 0.02 * (190 - phase))
            press = fingers.step(ball, [gelsim.Pose(depth_mm, x_mm=x * phase) for x in (0.01, -0.005)], duration_s=1 / 60)
            assert all(np.isfinite(each.wrench).all() and each.image.any() for each in press)
        most.append(resident_mb("self"))
    print(f"{time.monotonic() - start:.0f} s; MB after each tenth: {' '.join(f'{mb:.0f}' for mb in most)}")
    assert most[-1] <= 1.05 * most[1] + 4
