"""Two builds of gelsim write the same bytes: after a change that is to change nothing.

    pytest tests/python/test_same_bytes.py --full --gelsim NEW --old-gelsim OLD

Datasets of bundled jobs at every fidelity level, in every format, with all effects; and rendered depth frames. Of the
statistics, times are left out.
"""

import pathlib
import struct

import pytest
from processes import run
from sets import PROJECT, content

pytestmark = pytest.mark.full

SAMPLES = 8
JOBS = ["quickstart", "elementary", "effects", "randomized"]
LEVELS = ["paper", "draft", "standard", "high", "reference"]
EVERY_LAYER = 'output.layers=["depth","surface","contact","normal","pressure","reference"]'


def generate(job, samples, *more):
    return ["generate", PROJECT / f"configs/{job}.toml", "--quiet", "--samples", samples, *more]


DATASETS = {f"{job} as it is": generate(job, 3 * SAMPLES) for job in JOBS}
for job in JOBS:
    DATASETS[f"{job} with all effects"] = generate(job, SAMPLES, "--all-effects")
    # A blur has no friction, which this one's gelpad has.
    for level in LEVELS[1:] if job == "effects" else LEVELS:
        layers = EVERY_LAYER.replace('"pressure",', "") if level == "paper" else EVERY_LAYER
        DATASETS[f"{job} at {level}"] = generate(job, SAMPLES, "--fidelity", level, "--set", layers)
for form in ["npy", "png16"]:
    more = ["--set", EVERY_LAYER, "--set", f'output.depth_format="{form}"']
    DATASETS[f"layers as {form}"] = generate("quickstart", SAMPLES, *more)
DATASETS["a folder"] = generate("quickstart", SAMPLES, "--set", 'output.container="folder"')


@pytest.fixture(scope="module")
def programs(pytestconfig, gelsim_path):
    """The old one and the new one."""
    old = pytestconfig.getoption("--old-gelsim")
    if not old:
        pytest.skip("no build to compare with: --old-gelsim PATH")
    return {"old": pathlib.Path(old).resolve(), "new": gelsim_path}


@pytest.fixture(scope="module")
def frames(tmp_path_factory):
    """A ball, a slope, a wall and nothing, as npy files of heights over the camera's plane."""
    folder, width, height = tmp_path_factory.mktemp("frames"), 96, 72
    shapes = {
        "ball": lambda x, y: 9.2 + 4.0 - max(16.0 - x * x - y * y, 0.0) ** 0.5 if x * x + y * y < 16.0 else 20.0,
        "slope": lambda x, y: 9.6 + 0.05 * x + 0.02 * y,
        "wall": lambda x, y: 9.3 if x > 1.0 else 15.0,
        "nothing": lambda x, y: 15.0,
    }
    for name, shape in shapes.items():
        across, down = ([(k + 0.5 - size / 2) * 0.2 for k in range(size)] for size in (width, height))
        header = f"{{'descr': '<f4', 'fortran_order': False, 'shape': ({height}, {width}), }}"
        header += " " * (-(len(header) + 11) % 64) + "\n"
        data = struct.pack(f"<{width * height}f", *(shape(x, y) for y in down for x in across))
        start = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header))
        (folder / f"{name}.npy").write_bytes(start + header.encode() + data)
    return sorted(folder.glob("*.npy"))


def assert_same_bytes(programs, folder, command):
    sides = []
    for side, program in programs.items():
        # At the same depth, so that relative paths in files are the same.
        out = folder / side / "out"
        out.parent.mkdir()
        run(program, *command, "--out", out)
        paths = [path for path in out.rglob("*") if path.is_file() and path.name != "report.html"]
        sides.append({str(path.relative_to(out)): content(path) for path in paths})
    old, new = sides
    assert old
    assert not [f"{name} {'differs' if name in old and name in new else 'is on one side'}"
                for name in sorted(old | new) if old.get(name) != new.get(name)]  # fmt: skip


@pytest.mark.parametrize("case", DATASETS)
def test_datasets_have_the_same_bytes(programs, tmp_path, case):
    assert_same_bytes(programs, tmp_path, DATASETS[case])


@pytest.mark.parametrize("level", ["paper", "standard", "high"])
@pytest.mark.parametrize("sensor", ["gelsight-2014", "gelsight-2017", "gelsight-mini", "digit"])
def test_rendered_frames_have_the_same_bytes(programs, frames, tmp_path, sensor, level):
    layers = "depth,surface,contact,normal" + ("" if level == "paper" else ",pressure")
    command = [
        "render", "--sensor", sensor, "--depth", *frames, "--depth-unit", "mm", "--plane-mm", "10", "--layers", layers,
        "--fidelity", level, "--set", "camera.read_noise_levels=2.0", "--set", "camera.distortion_k1=0.05",
    ]  # fmt: skip
    assert_same_bytes(programs, tmp_path, command)
