"""Many samples, sequences and frames of a loop in one run each: the memory that takes does not grow.

    pytest tests/python/test_soak.py --full -rP

shows the resident memory of the program after each tenth of the run.
"""

import pathlib
import re
import subprocess
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
