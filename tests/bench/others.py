"""CPU time a tactile image, gelsim's beside that of what people use instead: `python tests/bench/others.py GELSIM`.

In one run, in turns, one thread each: gelsim at each fidelity level (the whole of `generate`, program start and files
included); the method of Gomes, Wilson and Luo (2019) written for this in numpy and OpenCV; and the package `taxim` of PyPI on
JAX's CPU, if it is installed (`pip install taxim jax`). All get presses of the bundled `dots` at 640x480, and all encode their
images as PNG; the others read depth maps that gelsim wrote, which is not counted, and write nothing else.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

# Before numpy and JAX are loaded.
for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[name] = "1"
os.environ["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
os.environ["JAX_PLATFORMS"] = "cpu"

import resource  # noqa: E402

import cv2  # noqa: E402
import numpy as np  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
SAMPLES = 40
TURNS = 5
MM_PER_PX = 20.0 / 640

JOB = """
[dataset]
name = "others"
samples = {samples}
seed = 1
samples_per_shard = 50
[output]
container = "folder"
depth_format = "npy"
layers = ["depth"]
[sensor]
resolution_px = [640, 480]
[[object]]
path = "{objects}/dots.obj"
[pose]
yaw_deg = [0.0, 360.0]
tilt_deg = [0.0, 3.0]
x_mm = [-2.0, 2.0]
y_mm = [-2.0, 2.0]
[indentation]
depth_mm = [0.4, 1.0]
"""


def cpu_s(who):
    used = resource.getrusage(who)
    return used.ru_utime + used.ru_stime


class Gelsim:
    def __init__(self, program, folder, level):
        self.command = [program, "generate", str(folder / "job.toml"), "--quiet", "--overwrite", "--threads", "1"]
        self.command += ["--fidelity", level, "--out", str(folder / level)]

    def cpu_s(self, _depths):
        before = cpu_s(resource.RUSAGE_CHILDREN)
        subprocess.run(self.command, check=True)
        return cpu_s(resource.RUSAGE_CHILDREN) - before


class InProcess:
    def __init__(self, render):
        self.render = render

    def cpu_s(self, depths):
        before = cpu_s(resource.RUSAGE_SELF)
        for depth in depths:
            image = self.render(depth)
            done, _ = cv2.imencode(".png", image)
            assert done and image.shape == (480, 640, 3)
        return cpu_s(resource.RUSAGE_SELF) - before


def paper():
    """Five mean blurs that keep the contact, normals, Phong under four LEDs, over a grey picture."""
    angles = np.radians([0.0, 90.0, 180.0, 270.0])
    colors = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]], np.float32)
    low = np.radians(8.5)
    leds = [(np.cos(a) * np.cos(low), np.sin(a) * np.cos(low), np.sin(low)) for a in angles]

    def render(depth):
        surface = -depth
        contact = depth > 0
        blurred = surface.copy()
        for _ in range(5):
            blurred = cv2.blur(blurred, (15, 15))
            blurred[contact] = surface[contact]
        slope_y, slope_x = np.gradient(blurred, np.float32(MM_PER_PX))
        length = np.sqrt(slope_x**2 + slope_y**2 + 1)
        nx, ny, nz = -slope_x / length, -slope_y / length, 1 / length
        image = np.full((*depth.shape, 3), 0.4, np.float32)
        for (lx, ly, lz), color in zip(leds, colors):
            diffuse = nx * lx + ny * ly + nz * lz
            mirrored = 2 * diffuse * nz - lz
            light = 0.6 * np.maximum(diffuse, 0) + 0.5 * np.maximum(mirrored, 0) ** 5
            image += light[..., None] * color * 0.5
        return (255 * np.clip(image, 0, 1)).astype(np.uint8)

    return InProcess(render)


def taxim(with_shadow):
    from taxim import Taxim

    simulator = Taxim(backend="jax", device="cpu")

    def render(depth):
        heights = simulator.convert_height_map(-np.asarray(depth, np.float32))
        image = simulator.render(heights, with_shadow=with_shadow, press_depth=float(depth.max()))
        image = np.asarray(simulator.img_to_numpy(image))
        return np.ascontiguousarray(image if image.dtype == np.uint8 else np.clip(image, 0, 255).astype(np.uint8))

    return InProcess(render)


def main(program):
    program = str(Path(program).resolve())
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        (folder / "job.toml").write_text(JOB.format(samples=SAMPLES, objects=ROOT / "objects"))
        ways = {f"gelsim {level}": Gelsim(program, folder, level) for level in ("paper", "draft", "standard", "high")}
        ways["paper's method in numpy and OpenCV"] = paper()
        try:
            ways["taxim, JAX on CPU"] = taxim(False)
            ways["taxim, JAX on CPU, with shadows"] = taxim(True)
        except ImportError as why:
            print(f"without taxim: {why}")
        cv2.setNumThreads(1)
        ways["gelsim standard"].cpu_s(None)
        depths = [np.load(file) for file in sorted((folder / "standard").rglob("*depth.npy"))]
        assert len(depths) == SAMPLES, len(depths)
        # The first call compiles.
        for way in ways.values():
            way.cpu_s(depths[:1])
        times = {name: [] for name in ways}
        for _ in range(TURNS):
            for name, way in ways.items():
                times[name].append(1e3 * way.cpu_s(depths) / SAMPLES)
        standard = np.median(times["gelsim standard"])
        print(f"{'':<36} {'CPU ms an image':>16} {'of standard':>12}")
        for name, each in times.items():
            median = np.median(each)
            print(f"{name:<36} {median:>16.1f} {median / standard:>12.2f}")
        print(json.dumps({name: [round(value, 2) for value in each] for name, each in times.items()}))


if __name__ == "__main__":
    start = time.monotonic()
    main(sys.argv[1])
    print(f"{time.monotonic() - start:.0f} s")
