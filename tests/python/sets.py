"""Small datasets for the tests of many machines, and how two of them differ."""

import json
import pathlib
import shutil

PROJECT = pathlib.Path(__file__).resolve().parents[2]

JOB = """\
[dataset]
name = "cluster"
samples = {samples}
samples_per_shard = 5
splits = {{ train = 0.8, val = 0.1, test = 0.1 }}

[sensor]
resolution_px = [{width}, {height}]

[[object]]
path = "sphere.obj"

[pose]
x_mm = [-4.0, 4.0]
y_mm = [-3.0, 3.0]

[indentation]
depth_mm = [0.2, 1.2]
"""


def prepare(folder, samples=800, width=320, height=240):
    """A folder as a user has it: a job and its mesh; at this depth, so that relative paths in it are always equal."""
    folder.mkdir()
    shutil.copy(PROJECT / "objects/sphere.obj", folder)
    (folder / "job.toml").write_text(JOB.format(samples=samples, width=width, height=height))
    return folder


def generate_alone(run_gelsim, folder, **size):
    """The dataset of that job by one process, at `folder`/out."""
    run_gelsim.generate("job.toml", "out", cwd=prepare(folder, **size))
    return folder / "out"


def content(path):
    """A file's bytes; of stats, which hold times, what is left without them."""
    if path.parent.name != "stats":
        return path.read_bytes()
    stats = json.loads(path.read_text())
    # Over the times, too.
    del stats["seconds"], stats["seal_sha256"]
    for effect in stats["effects"].values():
        del effect["seconds"]
    return stats


def contents(root):
    """Every file by its path, and its content."""
    return {str(path.relative_to(root)): content(path) for path in sorted(root.rglob("*")) if path.is_file()}


def assert_same(root, reference):
    """Fails with the names of the files that are not in both datasets with the same content."""
    here, there = contents(root), contents(reference)
    differing = sorted(name for name in here.keys() | there.keys() if here.get(name) != there.get(name))
    assert not differing, f"{root} differs from the single run in {differing}"
    assert "dataset.json" in there and len(there) > 60, f"{reference} is not complete"
