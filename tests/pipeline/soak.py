"""Makes many samples and many sequences in one run each, and watches how much memory that takes.

    python3 tests/pipeline/soak.py GELSIM [--samples 100000] [--sequences 1000] [--threads 2]

Prints the resident memory of the program after each tenth of the run. It may not grow once the run has come to itself: from the
second tenth to the last by at most a tenth and 4 MB.
"""

import argparse
import pathlib
import re
import subprocess
import tempfile
import time

OBJECTS = pathlib.Path(__file__).resolve().parents[2] / "objects"
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


def soak(gelsim, what, samples, per_shard, more, threads):
    """Runs a job to its end."""
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        text = JOB.format(samples=samples, per_shard=per_shard, objects=OBJECTS, more=more)
        (folder / "job.toml").write_text(text)
        command = [gelsim, "generate", "job.toml", "--out", "out", "--quiet", "--threads", str(threads)]
        start = time.monotonic()
        run = subprocess.Popen(command, cwd=folder)
        shards, tenths = -(-samples // per_shard), [[] for _ in range(10)]
        while run.poll() is None:
            done = sum(1 for _ in (folder / "out/stats").glob("*.json"))
            held = resident_mb(run.pid)
            if held and done:
                tenths[min(9, 10 * done // shards)].append(held)
            time.sleep(0.1)
        assert run.returncode == 0, f"{what}: exit status {run.returncode}"
        subprocess.run([gelsim, "verify", "out"], cwd=folder, check=True, stdout=subprocess.DEVNULL)
    most = [max(some) for some in tenths if some]
    assert len(most) > 5, f"{what}: too short to say anything"
    print(f"{samples} {what} in {time.monotonic() - start:.0f} s; MB after each tenth: {' '.join(f'{mb:.0f}' for mb in most)}")
    assert most[-1] <= 1.1 * most[1] + 4, f"{what}: the memory grows"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("gelsim")
    parser.add_argument("--samples", type=int, default=100_000)
    parser.add_argument("--sequences", type=int, default=1000)
    parser.add_argument("--threads", type=int, default=2)
    arguments = parser.parse_args()
    gelsim = str(pathlib.Path(arguments.gelsim).resolve())
    soak(gelsim, "samples", arguments.samples, -(-arguments.samples // 200), PRESS, arguments.threads)
    soak(gelsim, "sequences", arguments.sequences, -(-arguments.sequences // 100), SEQUENCE, arguments.threads)


if __name__ == "__main__":
    main()
