"""CPU time of a set of sensors with one pad, beside that of a job for each.

    python tests/bench/sensor_sets.py GELSIM [--sensors N] [--samples N]

Prints the CPU seconds of the set, those of ten of its datasets generated one by one (as many as there are in the set, from these),
and the ratio.
"""

import argparse
import resource
import subprocess
import tempfile
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[2]
JOB = """
dataset = {{ name = "set", samples = {samples}, seed = 4 }}
sensors.count = {sensors}
sensor = {{ preset = "gelsight-mini", unit = {{ gelpad_thickness = 0.0, gelpad_youngs_modulus = 0.0 }} }}
object = [{{ path = "{objects}/sphere.obj" }}, {{ path = "{objects}/gear.obj" }}]
pose = {{ x_mm = [-2.0, 2.0], yaw_deg = [0.0, 360.0] }}
indentation.depth_mm = [0.3, 1.0]
"""


def cpu_s(*command):
    """CPU seconds that the command takes."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("gelsim")
    parser.add_argument("--sensors", type=int, default=100)
    parser.add_argument("--samples", type=int, default=100)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        job, together = Path(folder, "job.toml"), Path(folder, "set")
        job.write_text(JOB.format(samples=given.samples, sensors=given.sensors, objects=PROJECT / "objects"))
        of_set = cpu_s(given.gelsim, "generate", job, "--quiet", "--out", together)
        few = sorted(together.glob("*/job.toml"))[:10]
        of_few = sum(cpu_s(given.gelsim, "generate", each, "--quiet", "--out", Path(folder, str(k))) for k, each in enumerate(few))
    alone = of_few * given.sensors / len(few)
    print(f"set of {given.sensors} sensors, {given.samples} samples each: {of_set:.1f} CPU s")
    print(f"a job for each: {alone:.1f} CPU s; the set takes {of_set / alone:.2f} of it")


if __name__ == "__main__":
    main()
