"""Memory and time of a job with more meshes than fit into memory.

    python tests/bench/many_meshes.py GELSIM [--meshes N] [--samples N] [--keep FOLDER]

Makes N meshes of 5,120 triangles (256 kB each, in a temporary folder or the one to keep) and prints, for the first `plan`, the
second one and a run on two threads: seconds, CPU seconds, peak memory. Then CPU time of a sample, beside that of a job of 100 of the
meshes, all of which are held in memory; each is the difference of two runs on one thread. You need NumPy.
"""

import argparse
import os
import subprocess
import tempfile
import time
from pathlib import Path

import numpy

JOB = """
dataset = {{ name = "many", samples = 100 }}
sensor.preset = "gelsight-mini"
object = [{{ path = "{meshes}", unit = "mm" }}]
pose = {{ face = "any", yaw_deg = [0.0, 360.0] }}
indentation.depth_mm = [0.3, 1.2]
"""


def sphere():
    """Vertices and triangles of a unit sphere, by longitude and latitude."""
    rows, columns = 32, 81
    around, down = numpy.meshgrid(numpy.arange(columns - 1), numpy.arange(rows + 1))
    turn, fall = 2 * numpy.pi * around / (columns - 1), numpy.pi * down / rows
    vertices = numpy.stack([numpy.cos(turn) * numpy.sin(fall), numpy.sin(turn) * numpy.sin(fall), numpy.cos(fall)], -1)
    at = numpy.arange((rows + 1) * (columns - 1)).reshape(rows + 1, columns - 1)
    here, beside = at, numpy.roll(at, -1, 1)
    one = numpy.stack([here[:-1], here[1:], beside[1:]], -1)
    two = numpy.stack([here[:-1], beside[1:], beside[:-1]], -1)
    return vertices.reshape(-1, 3), numpy.concatenate([one.reshape(-1, 3), two.reshape(-1, 3)])


def write_meshes(folder, count):
    """Dented balls, 4 to 9 mm in radius, a thousand in each folder."""
    vertices, triangles = sphere()
    file = numpy.zeros(len(triangles), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("bytes", "<u2")])
    head = bytes(80) + len(triangles).to_bytes(4, "little")
    for number in range(count):
        random = numpy.random.default_rng(number)
        radius = 1 + 0.15 * numpy.sin(vertices @ random.normal(0, 3, 3)) + 0.1 * numpy.sin(vertices @ random.normal(0, 7, 3))
        size = random.uniform(4, 9) * random.uniform(0.6, 1, 3)
        file["corners"] = (vertices * radius[:, None] * size)[triangles]
        path = folder / f"{number // 1000:03}/{number:06}.stl"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(head + file.tobytes())


def run(*command):
    """Seconds, CPU seconds and peak memory in bytes of the command."""
    start = time.monotonic()
    child = subprocess.Popen([str(word) for word in command], stdout=subprocess.DEVNULL)
    _, status, used = os.wait4(child.pid, 0)
    child.returncode = os.waitstatus_to_exitcode(status)
    assert child.returncode == 0, command
    return time.monotonic() - start, used.ru_utime + used.ru_stime, 1024 * used.ru_maxrss


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("gelsim")
    parser.add_argument("--meshes", type=int, default=100_000)
    parser.add_argument("--samples", type=int, default=2000)
    parser.add_argument("--keep", type=Path)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        os.environ["GELSIM_CACHE_DIR"] = str(folder / "cache")
        meshes = given.keep or folder / "meshes"
        if not meshes.exists():
            write_meshes(meshes, given.meshes)
            time.sleep(3)
        many, few = folder / "many.toml", folder / "few.toml"
        many.write_text(JOB.format(meshes=f"{meshes}/*/*.stl"))
        few.write_text(JOB.format(meshes=f"{meshes}/000/*0000??.stl"))
        generate = ("generate", many, "--quiet", "--threads", 2, "--out", folder / "out", "--samples", given.samples)
        for what, words in [("first plan", ("plan", many, "--quiet")), ("second plan", ("plan", many, "--quiet")), ("generate", generate)]:
            wall, cpu, memory = run(given.gelsim, *words)
            print(f"{what}: {wall:.1f} s, {cpu:.1f} CPU s, {memory / 1e9:.2f} GB", flush=True)
        each = {}
        for job in [few, many]:
            words = (given.gelsim, "generate", job, "--quiet", "--threads", 1, "--overwrite", "--out", folder / "out", "--samples")
            little, all_of_it = (run(*words, samples)[1] for samples in (100, given.samples + 100))
            each[job] = 1e3 * (all_of_it - little) / given.samples
        ratio = each[many] / each[few]
        print(f"a sample: {each[many]:.2f} CPU ms, {each[few]:.2f} where all meshes are held: {ratio:.2f} times")


if __name__ == "__main__":
    main()
