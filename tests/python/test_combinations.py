"""Every combination that a user can write works, or is refused with its place: what is refused is the first table of
docs/reference/combinations.md.

    pytest tests/python/test_combinations.py --full
    UPDATE=1 pytest tests/python/test_combinations.py       makes that table anew

A job has a value on each axis below, and one command is run on it. Jobs that no refusal holds for are chosen so that every
pair of values of two axes that can be together is in one (a greedy covering array); each is generated, verified, and given
to its command. Jobs that are refused are drawn at random for each refusal: the command ends with 2, names line and column
of the job, or of the sensor that it names, and what the refusal says, and writes nothing. So a refusal that is no longer
needed fails as one that is missing does.
"""

import itertools
import json
import os
import random
import re
import struct
import subprocess
import sys
import tarfile
import tempfile
import zlib
from pathlib import Path

import pytest
from processes import run

PROJECT = Path(__file__).resolve().parents[2]
OBJECTS = PROJECT / "objects"
PAGE = PROJECT / "docs/reference/combinations.md"
# Jobs drawn for each refusal.
REFUSED = 6


def mesh(name, **more):
    return {"object": [{"path": str(OBJECTS / f"{name}.obj"), **more}]}


def sequence(**deep):
    phases = [{"name": "press", "duration_s": 0.2, **deep}, {"name": "slide", "duration_s": 0.2, "x_mm": 0.4}]
    return {"sequence.frame_rate_hz": 10.0, "sequence.phase": phases}


PRESETS = ["gelsight-2014", "gelsight-2017", "gelsight-mini", "digit", "gelsight-series2", "tactip", "geltip", "allsight"]
SHAPED = {"tactip", "geltip", "allsight", "a mesh"}

COMMANDS = [
    "parts", "extended", "reproduce", "report", "preview", "preview of the job", "effects", "film", "tradeoff", "plan",
    "augment", "augment in pairs", "augment with a job", "load", "lerobot", "zarr", "hdf5", "fota", "ftp1", "sitr", "tacbench", "touchd",
]  # fmt: skip

# What every sensor of a set feels as well.
PRESSES = """
dataset = { name = "presses", samples = 18, object_order = "in_turn" }
object = [{ path = "OBJECTS/sphere.obj", length_mm = 4.0 }, { path = "OBJECTS/cube.obj" }]
pose = { grid = { columns = 3, rows = 3, step_mm = [3.0, 3.0] }, roll_deg = 45.0, pitch_deg = 45.0, anchor = "contact" }
indentation.depth_mm = 1.0
output.layers = ["reference"]
"""
# A bar and two small ones.
ROWS = [
    {"name": "bar", "position_mm": [0.0, -12.0, -5.0], "size_mm": [10.0, 1.0], "lobe": 1.0, "color": [1.0, 0.1, 0.0], "intensity": 0.4},
    {"name": "left", "position_mm": [-13.0, 2.0, -4.0], "color": [0.0, 1.0, 0.2], "intensity": 0.3, "pattern": {"green": [1.0, 0.1, -0.1]}},
    {"name": "right", "azimuth_deg": 20.0, "elevation_deg": 30.0, "distance_mm": 14.0, "color": [0.0, 0.2, 1.0], "intensity": 0.3},
]

# Of each axis the values by name, and the keys of the job that they set. The first is the usual one.
AXES = {
    "sensor": {preset: {"sensor.preset": preset} if preset != PRESETS[0] else {} for preset in PRESETS}
    | {
        "a mesh": {"sensor.file": str(PROJECT / "configs/fingertip/sensor.toml")},
        "calibrated": {"sensor.file": "calibrated.toml"},
        "curved pad": {"sensor.rest_shape": {"dome": {"radius_mm": 60.0}}},
        "coated pad": {"sensor.grain": {"height_um": 1.0, "size_mm": 0.3}},
        "units": {"sensor.unit.variation": 1.0},
        "drawn": {"sensor.gelpad_thickness_mm": [3.0, 4.0]},
        "several": {"sensor.preset": ["digit", "gelsight-mini"]},
    },
    "sensors": {
        "one": {},
        "two": {"sensors.from": ["digit", "mini.toml"]},
        "units": {"sensors.count": 2},
        "unpaired": {"sensors": {"count": 2, "paired": False}},
        "calibrated": {"sensors": {"count": 2, "calibration": "presses.toml"}},
    },
    "light": {
        "the sensor's": {},
        "window": {"sensor.window.distance_mm": 60.0},
        "coat": {"sensor.coat.albedo": 0.4},
        "rows": {"sensor.led": ROWS},
    },
    "fidelity": {level: {"fidelity": level} for level in ["standard", "paper", "draft", "high", "reference", "finite-strain"]}
    | {"a bound": {"fidelity": {"max_error_um": 25.0}}},
    "gelpad": {
        "the level's": {},
        "none": {"gelpad": "none"},
        "gaussian": {"gelpad.gaussian.smoothing_px": 5},
        "stick": {"gelpad.elastic.friction": "stick"},
        "strain": {"gelpad.elastic.strain_correction": True},
        "finite strain": {"gelpad.finite_strain": {"box_mm": 0.6, "friction": "stick"}},
    },
    "relaxation": {
        "none": {},
        "of the job": {"gelpad.relaxation": [{"share": 0.3, "time_s": 0.2}]},
        "of the sensor": {"sensor.gelpad_relaxation": [{"share": 0.3, "time_s": 0.2}]},
    },
    "optics": {"the sensor's": {}, **{model: {"optics": model} for model in ["phong", "led", "lamps", "calibrated"]}},
    "object": {
        "a mesh": mesh("sphere"),
        "soft": mesh("sphere", youngs_modulus_kpa=300.0),
        "own friction": mesh("sphere", friction=0.5),
        "own texture": mesh("sphere", texture={"amplitude_mm": 0.05}),
        "scaled": mesh("cube", scale=[0.8, 1.2]),
        "in mm": mesh("brick", length_mm=[6.0, 8.0]),
        "richest side": mesh("brick") | {"pose.face": "auto"},
        "height map": {"object": [{"path": "relief.png", "mm_per_px": 0.3, "height_mm": 0.5}]},
        "assigned": {"object": [mesh(name, split=split)["object"][0] for name, split in [("sphere", "train"), ("cone", "val")]]},
    },
    "objects": {
        "one": {},
        "several": {"scene.objects_per_sample": [1, 3], "pose.x_mm": [-6.0, 6.0], "pose.y_mm": [-5.0, 5.0]},
    },
    "dataset": {
        "one split": {},
        "two splits": {"dataset.splits": {"train": 0.7, "val": 0.3}, "dataset.sensor_seed": 9},
        "by object": {"dataset.splits": {"train": 0.7, "val": 0.3}, "dataset.split_by": "object"},
        "in turn": {"dataset.object_order": "in_turn", "output.on_unhealthy": "reject"},
    },
    "fingers": {
        "one": {},
        "two": {"gripper.squeeze_mm": 1.0},
        "two sensors": {"gripper.squeeze_mm": 1.0, "gripper.right": {"preset": "gelsight-mini", "resolution_px": [28, 20]}},
        "by force": {"gripper.force_n": 0.5},
    },
    "place": {
        "the middle": {},
        "on the gel": {"pose.from_tip_mm": [0.0, 4.0], "pose.around_deg": [0.0, 360.0]},
        "rolled": {"pose.roll_deg": 5.0, "pose.pitch_deg": [-5.0, 5.0]},
        "any point": {"pose.at": "surface"},
        "grid": {"pose.grid": {"columns": 2, "rows": 2, "step_mm": [2.0, 1.5]}},
    },
    "depth": {
        "a depth": {"indentation.depth_mm": 0.6},
        "on the axis": {"indentation.depth_mm": 0.6, "indentation.at": "axis"},
        "above": {"indentation.depth_mm": 0.6, "indentation.no_contact": 1.0},
        "by force": {"indentation.force_n": 0.5},
    },
    "motion": {
        "none": {},
        "shear": {"shear.x_mm": 0.3},
        "shear that slips": {"shear": {"x_mm": 0.3, "twist_deg": 5.0, "friction": {"coulomb": {"coefficient": 0.4}}}},
        "sequence": sequence(depth_mm=0.5),
        "forces": sequence(force_n=0.3),
    },
    "extras": {
        "none": {},
        "texture": {"texture.amplitude_mm": 0.05},
        "print": {"markers.pitch_mm": 1.5},
        "a grid that ends": {"markers": {"rows": 5, "columns": 6, "pitch_mm": 2.0, "pitch_y_mm": 1.8, "missing": [[0, 0], [4, 5]]}},
        "measured print": {"markers.file": "dots.csv"},
        "camera": {"camera.vignette": 0.2, "camera.defocus_mm": 0.1, "camera.exposure": 1.1, "camera.read_noise_levels": 1.0},
        "lens": {"camera.distortion_k1": -0.1},
        "threshold": {"camera.threshold": 0.5},
    },
    "layers": {
        "depth": {"output.layers": ["depth"]},
        "surface": {"output.layers": ["surface", "normal", "contact", "reference", "gap", "instance"]},
        **{name: {"output.layers": [name]} for name in ["pressure", "points", "flow", "traction", "slip", "markers", "pins", "lamps", "untouched"]},
    },
    "files": {
        "tar": {},
        "npy": {"output.depth_format": "npy"},
        "folder": {"output.container": "folder", "output.depth_format": "png16"},
        "floats": {"output.container": "folder", "output.exr.pixel": "float"},
    },
    "effects": {"where needed": {}, "all": {"effects": "all"}},
    "command": dict.fromkeys(COMMANDS, {}),
}

# As the page calls them.
OPTICS_LAMPS, NO_LAMPS = '`optics = "lamps"`', "a sensor without measured lamps"
BLURS = "a gelpad that is not elastic"
STRAIN = "a gelpad at finite strain"
STICKS = "`gelpad.finite_strain.friction`"
SEVERAL = "several objects in a press"
BOUND = "a bound as `fidelity`"


PRINTS = {"print", "a grid that ends", "measured print"}
SHEARS = {"shear", "shear that slips"}


def shaped(row):
    return row["sensor"] in SHAPED


def moves(row):
    return row["motion"] in {"sequence", "forces"}


def held(row):
    return row["fingers"] != "one"


def sticks(row):
    return row["gelpad"] in {"stick", "finite strain"}


def elastic(row):
    return row["gelpad"] in {"stick", "strain", "finite strain"} or (row["gelpad"] == "the level's" and row["fidelity"] != "paper")


def strains(row):
    return row["gelpad"] in {"strain", "finite strain"} or (row["gelpad"] == "the level's" and row["fidelity"] == "finite-strain")


def has_leds(row):
    return row["sensor"] != "gelsight-series2" or row["light"] == "rows"


# What is refused: when, what the message says, and as the page tells it, what does not go with what.
REFUSALS = [
    (lambda row: row["optics"] == "lamps" and (row["sensor"] != "gelsight-series2" or row["fingers"] == "two sensors"), "has no lamps", OPTICS_LAMPS, NO_LAMPS),
    (lambda row: row["layers"] == "lamps" and (row["sensor"] != "gelsight-series2" or row["fingers"] == "two sensors"), "no lamps that were measured", "layer `lamps`", NO_LAMPS),
    (lambda row: row["optics"] in {"phong", "led"} and not has_leds(row), "has lamps and no LED", '`optics = "phong"`, `"led"`', "a sensor that has lamps and no LED"),
    (lambda row: row["optics"] == "calibrated" and (row["sensor"] != "calibrated" or row["fingers"] == "two sensors"), "this sensor has no calibration table", '`optics = "calibrated"`', "a sensor that was not calibrated"),
    (lambda row: row["layers"] == "markers" and (row["extras"] not in PRINTS or row["fingers"] == "two sensors"), "no printed markers", "layer `markers`", "a sensor without `[markers]`"),
    (lambda row: row["layers"] == "pins" and row["sensor"] != "tactip", "no pins", "layer `pins`", "a sensor without `[pins]`"),
    (lambda row: row["layers"] == "untouched" and row["sensor"] == "tactip", "the pins of this sensor differ from sample to sample", "layer `untouched`", "pins with jitter, as of `tactip`"),
    (lambda row: row["layers"] == "slip" and not moves(row), "a single press has no slip", "layer `slip`", "single presses"),
    (lambda row: row["layers"] == "pressure" and not elastic(row), "knows no pressure", "layer `pressure`", BLURS),
    (lambda row: row["layers"] == "flow" and not elastic(row), "knows no motion of the pad in its plane", "layers `flow`, `traction`", BLURS),
    (lambda row: row["layers"] == "traction" and not elastic(row), "knows no tractions", "layers `flow`, `traction`", BLURS),
    (lambda row: row["layers"] == "traction" and row["gelpad"] == "finite strain", "the tractions of a pad that sticks at finite strain", "layer `traction`", STICKS),
    (lambda row: row["object"] == "soft" and not elastic(row), "nothing gives way", "an object's `youngs_modulus_kpa`", BLURS),
    (lambda row: row["object"] == "soft" and moves(row), "the objects of a sequence are rigid", "an object's `youngs_modulus_kpa`", "`[sequence]`"),
    (lambda row: row["object"] == "own friction" and row["motion"] == "none" and not sticks(row), "uses the friction of an object", "an object's `friction`", "a job without any friction"),
    (lambda row: row["object"] == "own friction" and row["gelpad"] == "finite strain", "the pad sticks to every object", "an object's `friction`", STICKS),
    (lambda row: row["object"] == "assigned" and row["dataset"] != "by object", "whatever their object", "an object's `split`", '`[dataset] split_by = "sample"`'),
    (lambda row: row["dataset"] == "by object" and row["object"] != "assigned", "different object(s)", '`[dataset] split_by = "object"`', "fewer objects than splits"),
    (lambda row: moves(row) and not elastic(row), "knows no tractions, which a sequence carries on", "`[sequence]`", BLURS),
    (lambda row: moves(row) and not held(row) and strains(row), "not for the frames of a sequence", "`[sequence]`", STRAIN),
    (lambda row: moves(row) and row["gelpad"] == "stick", "a sequence has a friction of its own", "`[sequence]`", "`gelpad.elastic.friction`"),
    (lambda row: moves(row) and row["depth"] in {"on the axis", "by force"}, "the phases of a sequence say how deep", "`[sequence]`", "`[indentation]`"),
    (lambda row: moves(row) and row["depth"] == "above", "the phases of a sequence say whether", "`[sequence]`", "`[indentation]`"),
    (lambda row: moves(row) and row["fidelity"] == "a bound", "the level of a sequence is not chosen", "`[sequence]`", BOUND),
    (lambda row: row["fidelity"] == "a bound" and row["gelpad"] != "the level's", "leaves nothing to choose", "`gelpad`", BOUND),
    (lambda row: row["motion"] == "shear that slips" and sticks(row), "by another while it is moved", "`[shear] friction`", "another friction of the gelpad"),
    (lambda row: row["objects"] == "several" and moves(row), "a sequence moves one object", SEVERAL, "`[sequence]`"),
    (lambda row: row["objects"] == "several" and row["depth"] == "on the axis", "where only one of several objects can be", SEVERAL, '`[indentation] at = "axis"`'),
    (lambda row: row["objects"] == "several" and row["object"] == "soft", "the objects of one press are one rigid body", SEVERAL, "an object's `youngs_modulus_kpa`"),
    (lambda row: row["objects"] == "several" and row["object"] == "own friction", "one body with one friction", SEVERAL, "an object's `friction`"),
    (lambda row: row["objects"] == "several" and row["object"] == "own texture", "one texture lies over all objects", SEVERAL, "an object's `texture`"),
    (lambda row: row["objects"] == "several" and row["place"] == "grid", "a grid of places for one of several objects", SEVERAL, "`[pose] grid`"),
    (lambda row: row["place"] == "any point" and row["object"] == "richest side", "`at` takes any point of the surface", '`[pose] at = "surface"`', "`face`, `anchor`"),
    (lambda row: row["depth"] == "by force" and not elastic(row) and not moves(row) and not held(row), "knows no force", "`[indentation] force_n`", BLURS),
    (lambda row: held(row) and not elastic(row), "knows no force, by which two fingers hold an object", "`[gripper]`", BLURS),
    (lambda row: held(row) and strains(row), "not for a gripper's two fingers", "`[gripper]`", STRAIN),
    (lambda row: held(row) and shaped(row), "a gripper's fingers are flat sensors", "`[gripper]`", "`[shape]`"),
    (lambda row: held(row) and row["files"] in {"folder", "floats"}, "a row of metadata.jsonl has one tactile image", "`[gripper]`", '`[output] container = "folder"`'),
    (lambda row: held(row) and row["depth"] in {"on the axis", "by force"}, "says how deep each finger is pressed", "`[gripper]`", '`[indentation] depth_mm`, `force_n`, `at = "axis"`'),
    (lambda row: held(row) and not moves(row) and row["fidelity"] == "a bound", "the level of a gripper is not chosen", "`[gripper]`", BOUND),
    (lambda row: held(row) and row["objects"] == "several", "a gripper holds one object", SEVERAL, "`[gripper]`"),
    (lambda row: row["fingers"] == "two sensors" and row["optics"] == "the sensor's" and row["sensor"] in {"gelsight-series2", "calibrated"}, "the light of `", "`[gripper.right]`", "a sensor with another model of the light"),
    (lambda row: row["sensors"] != "one" and held(row), "both [sensors] and [gripper]", "`[sensors]`", "`[gripper]`"),
    (lambda row: row["sensors"] != "one" and row["sensor"] == "several", "a list of presets in a job with [sensors]", "`[sensors]`", "a list as `sensor.preset`"),
    (lambda row: row["sensors"] not in {"one", "unpaired"} and row["dataset"] == "in turn", "are no pairs", "`[sensors]` that is `paired`", '`on_unhealthy = "reject"`'),
    (lambda row: row["sensors"] == "two" and any(key in AXES["sensor"][row["sensor"]] for key in ["sensor.preset", "sensor.file"]), "name the sensor", "`[sensors] from`", "`sensor.preset`, `sensor.file`"),
    (lambda row: row["place"] == "on the gel" and not shaped(row), "this one is flat", "`from_tip_mm`, `around_deg`", "a sensor without `[shape]`"),
    (lambda row: shaped(row) and not elastic(row), "a pad that is not elastic on a gel that has a shape", "`[shape]`", BLURS),
    (lambda row: shaped(row) and strains(row) and not moves(row) and not held(row), "not for a gel that has a shape", "`[shape]`", STRAIN),
    (lambda row: shaped(row) and row["extras"] in PRINTS, "print on a gel that has a shape", "`[shape]`", "`[markers]`"),
    (lambda row: shaped(row) and row["extras"] == "lens", "on a gel that has a shape is not simulated", "`[shape]`", "`[camera] distortion_k1`, `distortion_k2`"),
    (lambda row: shaped(row) and row["light"] in {"window", "coat"}, "does not go with a gel that has a shape", "`[shape]`", "`[sensor.window]`, `[sensor.coat]`"),
    (lambda row: shaped(row) and row["light"] == "rows", "the LED is outside of the gel", "`[shape]`", "LEDs with `size_mm`, `lobe` or `pattern`, or outside of the gel"),
    (lambda row: shaped(row) and row["motion"] in SHEARS and row["sensor"] != "tactip" and row["layers"] not in {"flow", "traction"}, "shear that neither pins nor the layers `flow` and `traction` show", "`[shape]`", "`[shear]` that neither pins nor the layers `flow` and `traction` show"),
    (lambda row: shaped(row) and row["motion"] in SHEARS and row["place"] == "on the gel", "shear", "`from_tip_mm`, `around_deg`", "`[shear]`"),
]  # fmt: skip


AUGMENTS = {"augment": "augment.toml", "augment in pairs": "pairs.toml", "augment with a job": "mixed.toml"}
ENCODERS = ["fota", "ftp1", "sitr", "tacbench", "touchd"]
FORCES = {"tacbench", "touchd"}
# Sensors that loaders of forces do not know.
OTHERS = {"tactip", "geltip", "allsight", "a mesh", "calibrated"}

# What a command refuses of jobs that are generated, and what it says.
COMMAND_REFUSALS = [
    ({"parts"}, lambda row: row["fidelity"] == "a bound", "cannot each choose their own fidelity"),
    ({"effects"}, moves, "sequence"),
    ({"effects"}, held, "gripper"),
    ({"film"}, lambda row: not moves(row), "sequence"),
    ({"tradeoff"}, held, "gripper"),
    ({"augment with a job"}, held, "gripper"),
    ({"augment with a job"}, moves, "sequence"),
    ({"augment with a job"}, lambda row: row["sensors"] != "one", "[sensors]"),
    ({"augment with a job"}, lambda row: row["objects"] == "several", "several"),
    ({"sitr"}, lambda row: moves(row) or held(row), "sitr single presses"),
    ({"sitr"}, lambda row: row["sensors"] != "calibrated", "--calibration"),
    ({"sitr"}, lambda row: row["sensor"] == "calibrated", "224 x 224"),
    ({"sitr"}, lambda row: row["layers"] != "surface", 'layers = ["surface"]'),
    (FORCES, lambda row: not moves(row), "single presses, and"),
    (FORCES, lambda row: row["layers"] not in {"surface", "untouched"}, 'layers = ["reference"]'),
    (FORCES, lambda row: row["sensor"] in OTHERS, "is read for names with"),
]  # fmt: skip


def refusals(row):
    return [says for holds, says, _, _ in REFUSALS if holds(row)]


def command_refusals(row):
    return [says for command, holds, says in COMMAND_REFUSALS if row["command"] in command and holds(row)]


def toml(value):
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {toml(each)}" for key, each in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml, value)) + "]"
    return json.dumps(value)


def job(row):
    keys = {"dataset.name": "combined", "dataset.samples": 3, "dataset.samples_per_shard": 2, "dataset.seed": 3}
    keys |= {"pose.yaw_deg": [0.0, 360.0]}
    # The calibrated sensor has the size of its photograph, and an encoder wants one of its own.
    if row["sensor"] != "calibrated":
        keys["sensor.resolution_px"] = [224, 224] if row["command"] == "sitr" else [32, 24]
    for axis, value in row.items():
        keys |= AXES[axis][value]
    if moves(row) or held(row):
        # They are not pressed in to a depth.
        keys.pop("indentation.depth_mm", None)
    if held(row) and moves(row):
        keys.pop("gripper.squeeze_mm", None)
        keys.pop("gripper.force_n", None)
        keys["sequence.phase"] = [
            {"squeeze_mm" if key == "depth_mm" else key: value for key, value in phase.items()}
            for phase in keys["sequence.phase"]
        ]
        if row["fingers"] != "two sensors":
            keys.setdefault("gripper", {})
    return "".join(f"{key} = {toml(value)}\n" for key, value in keys.items())


def picture(path, width, height, value, channels=1):
    """A PNG of bytes."""
    rows = b"".join(b"\0" + bytes(value(x, y, k) for x in range(width) for k in range(channels)) for y in range(height))
    chunk = lambda kind, data: struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    header = struct.pack(">IIBBBBB", width, height, 8, {1: 0, 3: 2}[channels], 0, 0, 0)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))


def prepare(folder):
    """What the jobs name."""
    picture(folder / "relief.png", 24, 24, lambda x, y, _: x * 9 % 256)
    picture(folder / "untouched.png", 32, 24, lambda x, y, k: 100 + 2 * x + y + 5 * k, channels=3)
    inputs, terms, hidden = 11, 15, 1
    outputs = [[0.0] * (hidden + inputs + 1) for _ in range(3 * terms)]
    for channel, (down, right) in enumerate([(0.0, 0.5), (0.5, 0.0), (-0.25, -0.25)]):
        outputs[terms * channel + 1][-1], outputs[terms * channel + 2][-1] = down, right
    response = {"height_mm": 0.5, "place_mm": 9.5, "heights_mm": [-0.25, 1.0], "steepest": 0.75}
    response |= {"hidden": [[0.5] * (inputs + 1)], "outputs": outputs}
    table = {"calibration_version": 1, "generator": "0.1.0", "contact_over_disc": 0.9, "colors": {"response": response}}
    (folder / "table.json").write_text(json.dumps(table))
    (folder / "calibrated.toml").write_text(
        'name = "mine"\nresolution_px = [32, 24]\nfield_of_view_mm = [19.2, 14.4]\ngelpad_thickness_mm = 3.0\n'
        'background = "untouched.png"\ncalibration = "table.json"\n'
    )
    (folder / "mini.toml").write_text('preset = "gelsight-mini"\n')
    (folder / "dots.csv").write_text("x_mm,y_mm,diameter_mm\n" + "".join(f"{x},{0.9 * x},0.5\n" for x in range(-6, 7)))
    (folder / "presses.toml").write_text(PRESSES.replace("OBJECTS", str(OBJECTS)))
    recipe = '[input]\npath = "out"\nbackground = "rendered"\n[sensor]\npreset = "gelsight-2014"\n'
    for name, more in [
        ("augment", "[[photometric]]\ncopies = 1\nexposure_ev = 0.2\n"),
        ("pairs", f'[paired]\n[[object]]\npath = "{OBJECTS}/sphere.obj"\n[[object]]\npath = "{OBJECTS}/cone.obj"\n'),
        ("mixed", '[mixing]\njob = "job.toml"\nsynthetic_per_real = 0.5\n'),
    ]:
        (folder / f"{name}.toml").write_text(recipe + more)


def covering(chance):
    """Rows that go, which hold every pair of values that any such row holds; and the pairs that none holds."""
    pairs = {
        frozenset([(a, x), (b, y)])
        for a, b in itertools.combinations(AXES, 2)
        for x in AXES[a]
        for y in AXES[b]
    }
    rows, apart = [], []
    while pairs:
        target = chance.choice(sorted(map(sorted, pairs)))
        row = next(filter(None, (repaired(dict(target), chance) for _ in range(4))), None)
        if row is None:
            pairs.discard(frozenset(target))
            apart.append(target)
            continue
        # Each value is changed to the one that adds most pairs, among those with which the row still goes.
        for name in chance.sample(list(AXES), len(AXES)):
            if name not in dict(target):
                gain = lambda value: sum(frozenset([(name, value), item]) in pairs for item in row.items() if item[0] != name)
                best = sorted(AXES[name], key=lambda value: (-gain(value), chance.random()))
                row[name] = next(value for value in best if value == row[name] or not unfit(row | {name: value}))
        rows.append(row)
        pairs -= {frozenset(pair) for pair in itertools.combinations(row.items(), 2)}
    return rows, apart


def repaired(fixed, chance):
    """A row that goes, with these values; none if that does not come about."""
    row = improved({name: next(iter(values)) for name, values in AXES.items()} | fixed, fixed, unfit, chance)
    return None if unfit(row) else row


def improved(row, fixed, cost, chance):
    """The row after changes, one value at a time, that each cost less, or as much."""
    for _ in range(12):
        if not (before := cost(row)):
            break
        costs = {(name, value): cost(row | {name: value}) for name in AXES if name not in fixed for value in AXES[name]}
        least = min(costs.values())
        if least > before:
            break
        row = row | dict([chance.choice([change for change in costs if costs[change] == least])])
    return row


def unwritable(row):
    """The job is no TOML: `gelpad` is a text there, and a table here."""
    return row["gelpad"] == "none" and row["relaxation"] == "of the job"


def unfit(row):
    """In how many ways it is refused, or its command has nothing to do there."""
    command = row["command"]
    return len(refusals(row)) + len(command_refusals(row)) + sum((
        unwritable(row),
        command == "effects" and row["depth"] == "above",
        command in AUGMENTS and (row["sensor"] != "gelsight-2014" or row["sensors"] != "one" or moves(row) or held(row) or row["effects"] == "all"),
        # What is enlarged has one object for each sample, known by its name.
        command == "augment in pairs" and (row["objects"] == "several" or row["object"] not in {"a mesh", "assigned"}),
        # What takes seconds is drawn a hundred times there.
        row["dataset"] == "in turn" and strains(row) and (row["fidelity"] != "standard" or row["depth"] == "by force"),
        # On a quarter of 32x24 pixels of a round gel, a contact of one node more or less jumps over the force.
        row["sensor"] == "geltip" and row["fidelity"] == "draft" and row["depth"] == "by force",
        # Rendering it anew and again takes a minute.
        command == "tradeoff" and (row["sensor"] == "a mesh" or row["sensors"] != "one"),
    ))


def run_gelsim_in(folder, *arguments, status=0):
    return run("gelsim", *arguments, status=status, cwd=folder, timeout=1200)


def generate(folder, out, *more):
    run_gelsim_in(folder, "generate", "job.toml", "--quiet", "--out", out, *more)


def assert_same(ours, theirs):
    """Two datasets are the same but for their statistics, which hold times."""
    a, b = (
        {path.relative_to(out): path.read_bytes() for path in out.rglob("*") if path.is_file() and path.parent.name != "stats"}
        for out in (ours, theirs)
    )
    differing = sorted(str(name) for name in a | b if a.get(name) != b.get(name))
    assert not differing, f"{ours.name} and {theirs.name} differ"


def datasets(out):
    """The folders of a set's sensors, or `out` itself."""
    names = out / "sensors.json"
    return [out / each["folder"] for each in json.loads(names.read_text())["sensors"]] if names.exists() else [out]


def labels(out):
    """Those of a dataset, by their keys."""
    label = re.compile("[0-9]+[.]json")
    found = {path.stem: path.read_bytes() for path in (out / "data").glob("*/*.json") if label.fullmatch(path.name)}
    for path in (out / "data").glob("*.tar"):
        with tarfile.open(path) as tar:
            found |= {name[:-5]: tar.extractfile(name).read() for name in tar.getnames() if label.fullmatch(name)}
    return {key: json.loads(text, parse_constant=lambda word: pytest.fail(f"{word} in a label")) for key, text in found.items()}


def parts_named(label, name):
    """Every value of this name in a label, and of its frames and fingers."""
    found = []
    for key, value in label.items() if isinstance(label, dict) else enumerate(label):
        found += [value] if key == name else parts_named(value, name) if isinstance(value, (dict, list)) else []
    return found


def assert_labels_say_what_ran(out, row):
    """Model, level and effects are those of the job; numbers have bounds."""
    found = labels(out)
    assert found
    ran = set()
    for label in found.values():
        assert all(abs(number) < 1e9 for number in numbers({**label, "seed": 0})), "a number without bounds"
        if row["fidelity"] != "a bound":
            assert label["fidelity"] == row["fidelity"]
        of_level = {"paper": "mean_blur", "finite-strain": "finite_strain"}.get(label["fidelity"], "elastic")
        models = {"none": "none", "gaussian": "gaussian", "finite strain": "finite_strain", "the level's": of_level}
        assert label["gelpad_model"] == models.get(row["gelpad"], "elastic")
        default = {"gelsight-series2": "lamps", "calibrated": "calibrated"}.get(row["sensor"], "phong")
        assert label["optics_model"] == (default if row["optics"] == "the sensor's" else row["optics"])
        for health in parts_named(label, "health"):
            assert health["finite"] and health["healthy"] == (health["reason"] == "")
        for effects in parts_named(label, "effects"):
            assert all(effect["reason"] for effect in effects.values())
            ran |= {name for name, effect in effects.items() if effect["ran"]}
        if row["depth"] == "by force":
            assert label["wanted_force_n"] == 0.5
    relaxes = row["relaxation"] != "none" and moves(row) and not held(row)
    assert relaxes or "relaxation" not in ran
    assert not relaxes or "relaxation" in ran or row["place"] == "any point", "the pad does not relax"
    assert strains(row) or row["fidelity"] == "a bound" or "finite_strain" not in ran
    assert row["optics"] == "led" or not {"mirror", "bounce"} & ran
    assert row["light"] != "coat" or row["optics"] != "led" or row["depth"] == "above" or "bounce" in ran, "no bounce"
    prints = row["extras"] in PRINTS or row["sensor"] == "tactip" or row["fingers"] == "two sensors"
    assert prints or "markers" not in ran


def numbers(label):
    """Every number in a label."""
    for value in label.values() if isinstance(label, dict) else label:
        if isinstance(value, (dict, list)):
            yield from numbers(value)
        elif isinstance(value, (int, float)):
            yield value


def assert_finite(samples):
    """No layer has a value that is not finite, or has no bounds."""
    import numpy as np

    for sample in samples:
        for part in [*sample.get("frames", []), *(sample[finger] for finger in ("left", "right") if finger in sample), sample]:
            for name, value in part.items():
                if isinstance(value, np.ndarray) and value.dtype.kind == "f":
                    assert np.isfinite(value).all() and np.abs(value).max(initial=0.0) < 1e6, name


def last_key(out):
    return max(labels(out))


def run_command(folder, row):
    """Runs a row's command on its dataset."""
    out, command = folder / "out", row["command"]
    one = datasets(out)[0]
    match command:
        case "parts":
            for part in ["0/2", "1/2"]:
                generate(folder, "parts", "--partition", part, "--threads", "1")
            # Of a set, what describes it is written when all of it is there.
            if len(datasets(out)) > 1 or one != out:
                run_gelsim_in(folder, "finalize", "parts")
            assert_same(out, folder / "parts")
        case "extended":
            for samples in [2, 3]:
                generate(folder, "longer", "--samples", samples, "--threads", 3)
            assert_same(out, folder / "longer")
        case "reproduce":
            run_gelsim_in(folder, "reproduce", one, last_key(one))
        case "report":
            run_gelsim_in(folder, "report", "out", "--out", "report.html")
        case "preview":
            run_gelsim_in(folder, "preview", one, "--out", "sheet.png")
        case "preview of the job":
            run_gelsim_in(folder, "preview", "job.toml", "--out", "sheet.png")
        case "effects":
            run_gelsim_in(folder, "preview", "job.toml", "--effects", "--out", "sheet.png")
        case "film":
            run_gelsim_in(folder, "preview", "job.toml", "--key", "1", "--apng", "--out", "film.png")
        case "tradeoff":
            run_gelsim_in(folder, "tradeoff", "job.toml", "--samples", "1", "--quiet", "--out", "levels")
        case "plan":
            run_gelsim_in(folder, "plan", "job.toml")
        case "augment" | "augment in pairs" | "augment with a job":
            run_gelsim_in(folder, "augment", AUGMENTS[command], "--quiet", "--out", "larger")
        case "load":
            import gelsim

            loaded, rendered = gelsim.load(one), gelsim.Job.load((one if one != out else folder) / "job.toml")
            assert len(loaded) == len(rendered) and list(loaded[0])[:-1] == list(rendered[0])
            gelsim.collate([loaded[i] for i in range(len(loaded))])
            assert_finite(loaded)
        case _:
            source = out if command in ENCODERS else one
            for more in [[], ["--check"]]:
                run(sys.executable, "-m", "gelsim.export.command", source, "--to", command, "--out", folder / "copy", *more)


def assert_works(folder, row):
    generate(folder, "out")
    run_gelsim_in(folder, "verify", "out")
    for out in datasets(folder / "out"):
        assert_labels_say_what_ran(out, row)
    run_command(folder, row)


def assert_command_refuses(folder, row):
    """A dataset or a job is there, and its command ends with 2 before it makes anything."""
    says = command_refusals(row)
    generate(folder, "out")
    before = sorted(folder.rglob("*"))
    with pytest.raises(AssertionError) as ended:
        run_command(folder, row)
    said = re.sub(r"\s+", " ", str(ended.value))
    assert "ended with 2" in said and "error: " in said, said
    assert any(each in said for each in says), f"it says none of {says}: {said}"
    assert sorted(folder.rglob("*")) == before, "it left something behind"


def assert_refused(folder, row):
    done = run_gelsim_in(folder, "generate", "job.toml", "--quiet", "--out", "out", status=2)
    said = re.sub(r"\s+", " ", done.stderr)
    assert any(says in said for says in refusals(row)), f"it says none of {refusals(row)}: {done.stderr}"
    assert re.search(r"(job\.toml|sensor\.toml|preset \S+):\d+:\d+", done.stderr), f"it names no place: {done.stderr}"
    assert not (folder / "out").exists(), "it left something behind"


def random_row(chance, holds, fixed=()):
    """A row that a refusal holds for, with the values `fixed`, of which as little else is refused as can be."""
    cost = lambda row: 100 * (not holds(row)) + len(refusals(row)) + unwritable(row)
    anything = lambda: {name: chance.choice(list(values)) for name, values in AXES.items()} | dict(fixed)
    # What few rows have needs more tries than six.
    row, tries = None, 0
    while tries < 6 or (not holds(row) or unwritable(row)) and tries < 200:
        tries += 1
        row = min(filter(None, [row, improved(anything(), dict(fixed), cost, chance)]), key=cost)
    assert holds(row) and not unwritable(row), row
    return row


def assert_each(check, rows):
    """All rows that fail are shown, each with its job."""
    assert rows
    wrong = []
    for row in rows:
        with tempfile.TemporaryDirectory() as folder:
            prepare(Path(folder))
            (Path(folder) / "job.toml").write_text(job(row))
            try:
                check(Path(folder), row)
            except (AssertionError, subprocess.TimeoutExpired) as failed:
                wrong.append(f"{failed}\n{row}\n{job(row)}")
    assert not wrong, "\n\n".join([f"{len(wrong)} of {len(rows)} jobs", *wrong])


@pytest.fixture(scope="module")
def working_rows():
    return covering(random.Random(7))[0]


@pytest.mark.full
@pytest.mark.wheel
@pytest.mark.parametrize("command", COMMANDS)
def test_every_pair_of_values_that_go_together_works(gelsim_path, working_rows, command):
    if command in ("load", "lerobot", "zarr", "hdf5", *ENCODERS):
        for module in ["OpenEXR", "pyarrow", "h5py"]:
            pytest.importorskip(module, reason="pip install '.[export]'")
    assert_each(assert_works, [row for row in working_rows if row["command"] == command])


@pytest.mark.full
@pytest.mark.parametrize("number", range(len(REFUSALS)), ids=lambda number: REFUSALS[number][1])
def test_what_does_not_go_together_is_refused(gelsim_path, number):
    chance, holds = random.Random(number), REFUSALS[number][0]
    assert_each(assert_refused, [random_row(chance, holds) for _ in range(REFUSED)])


@pytest.mark.full
@pytest.mark.wheel
@pytest.mark.parametrize("number", range(len(COMMAND_REFUSALS)), ids=lambda number: f"{sorted(COMMAND_REFUSALS[number][0])[0]}: {COMMAND_REFUSALS[number][2]}")
def test_what_a_command_does_not_take_is_refused(gelsim_path, number):
    commands, holds, _ = COMMAND_REFUSALS[number]
    chance = random.Random(number)
    rows = [random_row(chance, holds, {"command": chance.choice(sorted(commands))}) for _ in range(REFUSED // 2)]
    assert_each(assert_command_refuses, rows)


def test_the_page_lists_what_is_refused_and_nothing_else():
    # What belongs together stands together, in the order of REFUSALS.
    pairs = dict.fromkeys((what, beside) for _, _, what, beside in REFUSALS)
    order = [what for what, _ in pairs]
    told = [f"| {what} | {beside} |" for what, beside in sorted(pairs, key=lambda pair: order.index(pair[0]))]
    # The lines of the first table.
    before, table, after = re.split(r"(?<=\n\|---\|---\|\n)((?:\|.*\n)+)", PAGE.read_text(), maxsplit=1)
    if os.environ.get("UPDATE"):
        table = "\n".join(told) + "\n"
        PAGE.write_text(before + table + after)
    listed = table.splitlines()
    missing, strange = set(told) - set(listed), set(listed) - set(told)
    assert not missing and not strange, f"{PAGE.name}, UPDATE=1 makes it anew: lacks {missing}, has {strange}"
