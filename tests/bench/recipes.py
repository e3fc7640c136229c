"""CPU-hours and bytes of a million images of each job for tactile encoders.

    python tests/bench/recipes.py GELSIM [JOB ..]

Generates each job twice, with more samples the second time, and prints the difference for a million images: of sequences, frames; of
sets, those of all sensors. Bytes are those of all layers that the job writes. Start and calibration presses are in both runs.
"""

import resource
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path

CONFIGS = Path(__file__).resolve().parents[2] / "configs"
SAMPLES = {"pretrain-sitr": (20, 140), "pretrain-mixed": (100, 500), "force-slip": (10, 40), "twist": (10, 40)}


def made(gelsim, job, samples, out):
    """CPU seconds of a run, bytes of its shards, and images in them."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([gelsim, "generate", CONFIGS / f"{job}.toml", "--quiet", "--samples", str(samples), "--out", out], check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    shards = [path for path in out.rglob("*.tar") if "calibration" not in path.parts]
    images = sum(name.endswith("tactile.png") for path in shards for name in tarfile.open(path).getnames())
    cpu_s = after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
    return cpu_s, sum(path.stat().st_size for path in shards), images


def main():
    gelsim, *jobs = sys.argv[1:]
    for job in jobs or SAMPLES:
        with tempfile.TemporaryDirectory() as folder:
            few, many = (made(gelsim, job, count, Path(folder, str(count))) for count in SAMPLES[job])
        cpu_s, size, images = (more - less for more, less in zip(many, few))
        print(f"{job}: {1e6 * cpu_s / images / 3600:.1f} CPU-hours, {1e-3 * size / images:.0f} GB ({images} images)", flush=True)


if __name__ == "__main__":
    main()
