"""Datasets of every kind: tars and folders; EXR of halves and floats, npy, 16-bit PNG; presses, sequences, grips."""

import functools
import hashlib
import json
import pickle

import gelsim
import pytest

LAYERS = ["depth", "surface", "contact", "normal", "pressure", "gap", "markers", "reference", "flow", "traction", "untouched"]

# As mixed as samples get: contact and none, relief, markers that move, a lens.
PRESSES = """
dataset = {name = "presses", samples = 11, seed = 5, samples_per_shard = 3, splits = {train = 0.6, val = 0.2, test = 0.2}}
sensor.resolution_px = [48, 36]
object = [{ path = "OBJECTS/sphere.obj", class = "ball" }, { path = "OBJECTS/gear.obj" }]
texture.amplitude_mm = { choice = [0.0, 0.05] }
markers.pitch_mm = 1.5
shear = { x_mm = [-0.3, 0.3] }
camera.distortion_k1 = { choice = [0.0, -0.1] }
pose = { yaw_deg = [0.0, 360.0], tilt_deg = [0.0, 5.0] }
indentation = { depth_mm = [0.3, 1.0], no_contact = 0.3 }
"""
EVERY_LAYER = f"output.layers={json.dumps(LAYERS)}"
NPY, FOLDER, PNG16 = 'output.depth_format="npy"', 'output.container="folder"', 'output.depth_format="png16"'
FLOATS = 'output.exr.pixel="float"'
LAMPS = 'sensor={ preset = "gelsight-series2", resolution_px = [48, 36] }'
SMALL = "sensor.resolution_px=[40, 30]"
TWO = "dataset.samples_per_shard=2"
# Forces that nobody knows are null in the labels.
FORCELESS = ['output.layers=["depth", "contact"]', "shear={}"]
# Two different fingers: other sizes, other markers.
FINGERS = [
    "sensor.resolution_px=[48, 36]",
    "markers.pitch_mm=1.5",
    'gripper.right={ preset = "gelsight-mini", resolution_px = [40, 30], markers = { pitch_mm = 2.0 } }',
]

# By name: the job, its settings and the number of samples.
KINDS = {
    "halves": ("presses", [EVERY_LAYER], None),
    "floats": ("presses", [EVERY_LAYER, FLOATS, FOLDER], None),
    "npy": ("presses", [EVERY_LAYER, NPY], None),
    "steps": ("presses", [EVERY_LAYER, PNG16, FOLDER], None),
    "forceless": ("presses", [*FORCELESS, 'fidelity="paper"'], 4),
    "lamps": ("presses", [LAMPS, 'output.layers=["lamps"]', "markers={}"], 2),
    "tactip": ("tactip-edge", ["dataset.samples_per_shard=1"], 3),
    "sequences": ("sequences", [SMALL, TWO], 3),
    "frames": ("sequences", [SMALL, TWO, NPY, FOLDER], 3),
    "grips": ("gripper", [*FINGERS, 'output.layers=["depth", "contact", "markers"]', TWO], 5),
    "lifts": ("gripper-lift", [*FINGERS, 'output.layers=["slip", "markers"]', TWO, "sequence.frame_rate_hz=8.0"], 3),
}


class Datasets:
    """The dataset of each kind, generated when it is first asked for."""

    def __init__(self, run_gelsim, project, folder):
        self.run_gelsim, self.project, self.folder = run_gelsim, project, folder
        (folder / "presses.toml").write_text(PRESSES.replace("OBJECTS", str(project / "objects")))
        self.path = functools.cache(self.path)
        self.job = functools.cache(self.job)
        self.samples = functools.cache(self.samples)

    def job_file(self, name):
        job = KINDS[name][0]
        return self.folder / "presses.toml" if job == "presses" else self.project / f"configs/{job}.toml"

    def path(self, name):
        """The folder of the dataset."""
        _, settings, samples = KINDS[name]
        more = ["--samples", samples] if samples else []
        assigned = [word for setting in settings for word in ["--set", setting]]
        return self.run_gelsim.generate(self.job_file(name), self.folder / name, *more, *assigned)

    def job(self, name):
        """What renders it."""
        _, settings, samples = KINDS[name]
        return gelsim.Job.load(self.job_file(name), set=settings, samples=samples)

    def load(self, name, **more):
        return gelsim.load(self.path(name), **more)

    def samples(self, name):
        """All that it holds, in its order."""
        return list(self.load(name))


def refusal(kind, call):
    """What the exception says, which is of this kind exactly."""
    with pytest.raises(kind) as raised:
        call()
    assert raised.type is kind, raised.value
    return str(raised.value)


def digest(sample):
    """Of all that is in a sample; pickled arrays of equal values are equal."""
    return hashlib.sha256(pickle.dumps(sample)).hexdigest()


def adopt(dataset):
    """Gives a worker the dataset that `digest_at` reads."""
    global adopted
    adopted = dataset


def digest_at(index):
    return digest(adopted[index])
