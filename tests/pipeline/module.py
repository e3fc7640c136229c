"""The Python module against the command: the same arrays, labels and words.

    python module.py GELSIM         from the project's root, where the wheel, numpy and mypy are installed
"""

import ast
import copy
import filecmp
import inspect
import json
import os
import pickle
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
import warnings
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from pathlib import Path

import gelsim
import numpy as np
import samples

RUNGS = ["paper", "draft", "standard", "high", "reference"]
LAYERS = ["depth", "surface", "contact", "normal", "pressure", "markers", "reference"]
EVERY_LAYER = f"output.layers={json.dumps(LAYERS)}"
HASTY = 'gelpad={ elastic = { resolution = "full", max_iterations = 4, tolerance_um = 0.5 } }'

# As mixed as samples get: contact and none, relief, markers that move, a lens, noise.
MIXED = """
[dataset]
name = "module"
samples = 13
seed = 5
samples_per_shard = 4
splits = { train = 0.7, val = 0.15, test = 0.15 }
[sensor]
resolution_px = [96, 72]
[[object]]
path = "OBJECTS/sphere.obj"
[[object]]
path = "OBJECTS/gear.obj"
[texture]
amplitude_mm = { choice = [0.0, 0.05] }
[markers]
pitch_mm = 1.5
[shear]
x_mm = [-0.3, 0.3]
[camera]
distortion_k1 = { choice = [0.0, -0.1] }
exposure = [0.9, 1.1]
read_noise_levels = 1.0
[pose]
yaw_deg = [0.0, 360.0]
[indentation]
depth_mm = [0.3, 1.0]
no_contact = 0.3
[output]
depth_format = "npy"
"""

# A flat punch: where it does not reach, nothing is above the pad either.
PUNCH = """
dataset = { name = "punch", samples = 2, seed = 3 }
sensor = { preset = "digit", resolution_px = [120, 160] }
object = [{ path = "OBJECTS/cylinder.obj" }]
pose.x_mm = [-1.0, 1.0]
indentation.depth_mm = [0.2, 0.8]
camera = { read_noise_levels = 1.0, exposure = [0.9, 1.1], distortion_k1 = -0.05 }
output = { depth_format = "npy", layers = ["depth"] }
"""


def run(*arguments, status=0):
    """What the command says on standard error."""
    done = subprocess.run([native, *map(str, arguments)], capture_output=True, text=True)
    assert done.returncode == status, (arguments, done)
    return done.stderr.removesuffix("\n")


def generated(*arguments):
    """The samples that `gelsim generate` writes, by index, and their manifest."""
    out = Path(tempfile.mkdtemp(dir=root)) / "out"
    run("generate", *arguments, "--out", out, "--quiet")
    manifest = json.load(open(out / "dataset.json"))
    return {int(key): sample for key, sample in samples.read(out, manifest)}, manifest


def same_sample(ours, theirs, layers):
    """The label and every bit of the arrays, which are as torch.from_numpy wants them."""
    assert list(ours) == ["tactile", *layers, "label"], list(ours)
    assert ours["label"] == theirs["json"]
    for name in ["tactile", *layers]:
        written = samples.layer(theirs, name)
        if name == "markers":
            assert {key: value.tolist() for key, value in ours[name].items()} == written
            assert all(value.shape[1:] == (2,) for value in ours[name].values())
            continue
        if name == "contact":
            written = written[..., 0]  # grey, read as RGB
        assert ours[name].dtype == written.dtype and np.array_equal(ours[name], written), name
        assert ours[name].flags.c_contiguous and ours[name].flags.writeable, name


def same(one, other):
    """Two samples of the module."""
    assert list(one) == list(other)
    for name, value in one.items():
        assert type(value) is type(other[name]), name
        assert np.array_equal(value, other[name]) if isinstance(value, np.ndarray) else value == other[name], name


def raises(kind, call):
    """What the exception says, which is of this kind exactly."""
    try:
        call()
    except Exception as error:
        assert type(error) is kind, (type(error), error)
        return str(error)
    raise AssertionError(f"no {kind.__name__}")


def warned(call):
    """What a call gives, and what it warns of."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        given = call()
    return given, [str(warning.message) for warning in caught]


def jobs(mixed):
    """A job's samples are those that the command writes: with every layer, at every rung, with every flag."""
    written, manifest = generated(mixed, "--set", EVERY_LAYER)
    job = gelsim.Job.load(mixed, set=[EVERY_LAYER])
    assert len(job) == len(written) == 13 and job.layers == LAYERS and job.name == "module"
    assert (job.fingerprint, job.classes) == (manifest["fingerprint"], ["gear", "sphere"])
    for index in range(len(job)):
        same_sample(job.sample(index), written[index], LAYERS)
    labels = [sample["json"] for sample in written.values()]
    assert {label["contact"]["in_contact"] for label in labels} == {True, False}
    assert {label["camera"]["distortion"][0] for label in labels} == {0.0, -0.1}
    for split in ["train", "val", "test"]:
        assert job.indices(split) == [label["index"] for label in labels if label["split"] == split] != []

    for rung in RUNGS:
        flags = {"samples": 2, "seed": 8, "fidelity": rung, "all_effects": True}
        written, _ = generated(mixed, "--samples", 2, "--seed", 8, "--fidelity", rung, "--all-effects")
        job = gelsim.Job.load(str(mixed), **flags)
        assert (len(job), job.seed, job.fidelity, job.layers) == (2, 8, rung, ["depth"])
        for index in range(2):
            same_sample(job[index], written[index], ["depth"])

    # Files hold half floats; these are what was rounded.
    written, _ = generated(mixed, "--samples", 2, "--set", 'output.depth_format="exr"')
    depth = gelsim.Job.load(mixed, samples=2)[1]["depth"]
    assert np.array_equal(depth.astype(np.float16).astype(np.float32), written[1]["depth.exr"])
    assert not np.array_equal(depth, written[1]["depth.exr"])

    # A rung that a bound chooses; the command says which.
    bound = "fidelity={ max_error_um = 40.0 }"
    job, said = warned(lambda: gelsim.Job.load(mixed, samples=2, set=[bound]))
    assert any(f"fidelity {job.fidelity} chosen" in text for text in said)
    written, _ = generated(mixed, "--samples", 2, "--set", bound)
    same_sample(job[1], written[1], ["depth"])
    same_sample(pickle.loads(pickle.dumps(job))[1], written[1], ["depth"])

    # Samples that are drawn again until their contact is solved, and a job that wants none other.
    flags = [HASTY, 'output.on_unhealthy="reject"', "camera.distortion_k1=0.0"]
    written, _ = generated(mixed, *(word for text in flags for word in ["--set", text]))
    job = gelsim.Job.load(mixed, set=flags)
    again = [index for index, sample in written.items() if sample["json"]["attempt"] > 0]
    assert again
    same_sample(job[again[0]], written[again[0]], ["depth"])
    flags[1] = 'output.on_unhealthy="fail"'
    said = raises(gelsim.RunError, lambda: gelsim.Job.load(mixed, set=flags).sample(again[0]))
    assert said.startswith(f"sample {again[0]:09} (seed 5, drawn 1 time) is not healthy: the contact"), said
    # What it advises, as it stands there.
    advised = said.split("set=['", 1)[1].split("']", 1)[0]
    assert not gelsim.Job.load(mixed, set=[*flags[:1], advised, flags[2]])[again[0]]["label"]["health"]["healthy"]


def sequences(mixed):
    """A job is a map-style dataset: as long as it says, IndexError past the end, and several at a time."""
    job = gelsim.Job.load(mixed)
    each = [job.sample(index) for index in range(len(job))]
    for one, other in zip(job, each, strict=True):
        same(one, other)
    same(job[-1], each[-1])
    same(job[np.int64(3)], each[3])
    order = [5, 0, 12, 5]
    for several in [job.samples(order), job.__getitems__(order), gelsim.Job.load(mixed, threads=1).samples(order)]:
        for index, sample in zip(order, several, strict=True):
            same(sample, each[index])
    assert job.samples([]) == []
    # Pickled as text that says the same in any folder, whatever the path was.
    os.chdir(mixed.parent)
    pickled = pickle.dumps(gelsim.Job.load(mixed.name))
    os.chdir(project)
    again = pickle.loads(pickled)
    assert again.fingerprint == job.fingerprint
    same(again[4], each[4])
    for wrong in [13, -14, 2**40]:
        assert "0 to 12" in raises(IndexError, lambda: job[wrong])
    assert "13" in raises(IndexError, lambda: job.samples([0, 13]))
    raises(TypeError, lambda: job["0"])
    raises(TypeError, lambda: job[0.0])
    assert repr(job) == '<gelsim.Job "module": 13 samples, fidelity standard>'


def sensors(punch):
    """A sensor makes of a job's depth maps what the job made, at every rung, and of an analytic ball nearly that."""
    camera = ["camera.read_noise_levels=1.0", "camera.exposure=[0.9, 1.1]"]
    sensor = gelsim.Sensor.preset("digit", set=camera)
    assert (sensor.name, sensor.resolution_px, sensor.gelpad_thickness_mm) == ("digit", (240, 320), 4.0)
    layers = ["depth", "surface", "contact", "normal"]
    for rung in RUNGS:
        flags = ["camera.distortion_k1=0.0", f"output.layers={json.dumps(layers)}"]
        job = gelsim.Job.load(punch, fidelity=rung, set=flags)
        for index in range(len(job)):
            theirs = job[index]
            ours = sensor.render(theirs["depth"], fidelity=rung, layers=layers, index=index, seed=3)
            # A depth map has nothing between its pixels, over which a job averages light at walls.
            walls = theirs["label"]["effects"]["supersampling"]["ran"]
            differ = (ours["tactile"] != theirs["tactile"]).mean()
            assert differ < 0.25 if walls else differ == 0, (rung, index, differ)
            for name in layers:
                assert np.array_equal(ours[name], theirs[name]), (rung, index, name)
            # Nor does it know what lies beyond it.
            for name in ["total_force_n", "in_view_fraction", "force_unknown"]:
                assert ours["label"]["contact"][name] is None or name == "force_unknown"
                ours["label"]["contact"][name] = theirs["label"]["contact"][name]
            for key in ["contact", "sensor", "camera", "fidelity"]:
                assert ours["label"][key] == theirs["label"][key], (rung, key)

    # A ball of which all is known: also what is above the pad, which bulges up to it.
    ball = gelsim.Job.load(punch, samples=1, set=[f'object=[{{ path = "{objects}/sphere.obj" }}]', *BARE])
    label = ball[0]["label"]
    pitch_mm = 16.0 / 120
    x, y = np.meshgrid((np.arange(120) + 0.5 - 60) * pitch_mm, (np.arange(160) + 0.5 - 80) * pitch_mm)
    x0, y0, _ = label["pose"]["translation_mm"]
    across2 = (x - x0) ** 2 + (y - y0) ** 2
    with np.errstate(invalid="ignore"):
        above = BALL_MM - np.sqrt(BALL_MM**2 - across2) - label["indentation_depth_mm"]
    depth = np.where(across2 < BALL_MM**2, -above, -np.inf)
    bare = gelsim.Sensor.preset("digit", set=SILENT)
    ours, theirs = bare.render(depth, layers=["surface"]), ball[0]
    worst = np.abs(ours["tactile"].astype(int) - theirs["tactile"]).max()
    print(f"an analytic ball: {worst} grey levels, {1e3 * np.abs(ours['surface'] - theirs['surface']).max():.2f} um")
    assert worst <= 2
    same(bare.render(depth.astype(np.float32)), bare.render(np.asfortranarray(depth.astype(np.float32))))
    flat = bare.render(np.zeros((160, 120), np.float32))
    assert not flat["label"]["contact"]["in_contact"] and list(flat) == ["tactile", "label"]

    deep = np.zeros((160, 120), np.float32)
    deep[80, 60] = 25.0
    pressed, said = warned(lambda: bare.render(deep))
    assert pressed["label"]["health"]["over_thickness_px"] == 1
    assert len(said) == 1 and "goes through the pad and is cut off at its thickness, 4 mm" in said[0], said

    # A batch is its maps one by one, whatever the threads.
    maps = np.stack([depth - lift for lift in [0.0, 0.1, 5.0, 0.05, 0.15]])
    every = [layer for layer in LAYERS if layer != "markers"]
    batch = sensor.render(maps, layers=every, index=7)
    one = gelsim.Sensor.preset("digit", set=camera, threads=1).render(maps, layers=every, index=7)
    for number in range(len(maps)):
        single = sensor.render(maps[number], layers=every, index=7 + number)
        for several in [batch, one]:
            same({name: value[number] for name, value in several.items()}, single)
    dotted = gelsim.Sensor.preset("digit", set=["markers.pitch_mm=2.0"]).render(maps, layers=["markers"])
    assert [len(dots["moved_px"]) for dots in dotted["markers"]] == [x["markers"]["count"] for x in dotted["label"]]

    path = Path(root) / "mine.toml"
    path.write_text('preset = "digit"\ngelpad_thickness_mm = 1.5\n')
    assert gelsim.Sensor.load(path).gelpad_thickness_mm == 1.5


def odd_maps():
    """Maps that are taken for what is meant, warned of or refused; what is advised is done, and nothing more is said."""
    ball = ball_mm(160, 120)
    digit = gelsim.Sensor.preset("digit")
    alone, said = warned(lambda: digit.render(ball))
    assert not said
    # A picture with an axis for its one channel, as `gelsim render` takes it.
    same(digit.render(ball[..., None]), alone)
    batch, single = digit.render(np.stack([ball, ball])[..., None]), digit.render(np.stack([ball, ball]))
    assert batch["tactile"].shape == (2, 160, 120, 3) and np.array_equal(batch["tactile"], single["tactile"])
    assert "4 axes" in raises(gelsim.UsageError, lambda: digit.render(ball[None, None]))

    # A landscape map on a sensor that stands upright: said once, and of what is the map's.
    _, said = warned(lambda: digit.render(ball.T))
    assert len(said) == 1 and "out of proportion" in said[0] and "turn the frames by 90 degrees, as numpy.rot90 does" in said[0], said
    assert warned(lambda: digit.render(np.rot90(ball.T)))[1] == []
    assert warned(lambda: digit.render(ball.T))[1] == []

    for factor, word, fix in [(1e-3, "metres", lambda mm: mm * 1000), (1e3, "micrometres", lambda mm: mm / 1000)]:
        _, said = warned(lambda: digit.render(ball * factor))
        assert len(said) == 1 and word in said[0], said
        advised = said[0].rsplit("give ", 1)[1]
        fixed, said = warned(lambda: digit.render(eval(advised, {"depth_mm": ball * factor})))
        assert not said and np.array_equal(fixed["tactile"], alone["tactile"])

    # A camera's distances: with or without a background, which no remedy for depths is given for.
    distance_mm = np.where(np.isfinite(ball), 10.0 - ball, np.inf)
    hollow = np.where(np.isfinite(ball), distance_mm, np.nan)
    for frame in [distance_mm, np.where(np.isfinite(ball), distance_mm, 13.0), hollow, np.full_like(ball, np.inf)]:
        said = raises(gelsim.UsageError, lambda: digit.render(frame))
        assert "goes through the pad" in said and said.count("error: ") == 1 and "write -inf" not in said, said
        assert ("with inf in place of nan" in said) == np.isnan(frame).any(), said
        whole = np.where(np.isnan(frame), np.inf, frame)
        advised = said.split("camera: ", 1)[1].split(",")[0]
        pressed, said = warned(lambda: digit.render(eval(advised, {"plane_mm": 10.0, "distance_mm": whole})))
        assert not said
        if np.isinf(whole).any() and np.isfinite(whole).any():
            assert np.array_equal(pressed["tactile"], alone["tactile"])
    said = raises(gelsim.UsageError, lambda: digit.render(np.where(np.isfinite(ball), ball, np.inf)))
    assert "is infinite at" in said and "write -inf" in said and "plane_mm - distance_mm" in said, said

    # Masks: nothing is -inf for depths, and inf for distances.
    geltip = gelsim.Sensor.preset("geltip")
    away = np.full((120, 160), np.inf)
    away[40:80, 60:100] = 45.0
    for sensor, depth in [(digit, ball), (geltip, away)]:
        masked = np.ma.masked_array(depth, ~np.isfinite(depth))
        said = raises(TypeError, lambda: sensor.render(masked))
        filled = eval(said.rsplit(": ", 1)[1], {"depth_mm": masked, "np": np})
        assert np.array_equal(sensor.render(filled)["tactile"], sensor.render(depth)["tactile"])

    # What frames from inside a gel cannot be: the cause, and not another one's remedy.
    parallel = gelsim.Sensor.preset("geltip", set=['sensor.lens="orthographic"'])
    said = raises(gelsim.UsageError, lambda: parallel.render(away, fov_y_deg=60.0))
    assert "parallel rays" in said and "leave fov_y_deg out" in said, said
    large = raises(gelsim.UsageError, lambda: geltip.render(np.full((2100, 2100), 45.0)))
    assert "2100x2100 px" in large and "smaller frames" in large and "along" not in large, large


def ball_mm(rows, columns):
    """Depth below the pad of a ball, -inf where it is not."""
    row, column = np.mgrid[:rows, :columns]
    across2 = ((row - rows / 2) ** 2 + (column - columns / 2) ** 2) * (16.0 / 120) ** 2
    with np.errstate(invalid="ignore"):
        return np.where(across2 < BALL_MM**2, 0.8 - BALL_MM + np.sqrt(BALL_MM**2 - across2), -np.inf)


def guesses(mixed):
    """What people write who have not read the docs is answered with what they mean."""
    for call, names in [
        (lambda: gelsim.Sensor("digit"), ['gelsim.Sensor.preset("digit")', 'gelsim.Sensor.load("my.toml")']),
        (lambda: gelsim.Sensor("Mini", threads=2), ['gelsim.Sensor.preset("gelsight-mini")']),
        (lambda: gelsim.Sensor(preset="DIGIT"), ['gelsim.Sensor.preset("digit")']),
        (lambda: gelsim.Sensor(Path("a/b.toml")), ['gelsim.Sensor.load("a/b.toml")']),
        (lambda: gelsim.Sensor(), ['gelsim.Sensor.preset("digit")']),
        (lambda: gelsim.Sensor({}, 5), ['gelsim.Sensor.preset("digit")']),
        (lambda: gelsim.Job("mine.toml"), ['gelsim.Job.load("mine.toml")']),
        (lambda: gelsim.Job(path=Path("mine.toml")), ['gelsim.Job.load("mine.toml")']),
        (lambda: gelsim.Job(), ['gelsim.Job.load("job.toml")']),
    ]:
        said = raises(TypeError, call)
        assert all(name in said for name in names), said
    for name, meant in [("DIGIT", "digit"), ("gelsight", "gelsight-mini"), ("mini", "gelsight-mini"), ("GelSight Mini", "gelsight-mini"),
                        ("wedge", "gelsight-2017"), ("digti", "digit")]:
        assert f"did you mean `{meant}`?" in raises(gelsim.UsageError, lambda: gelsim.Sensor.preset(name)), name
    assert 'gelsim.Sensor.load("my.toml")' in raises(gelsim.UsageError, lambda: gelsim.Sensor.preset("my.toml"))
    assert 'gelsim.Sensor.preset("digit")' in raises(gelsim.UsageError, lambda: gelsim.Sensor.load("digit"))
    assert "did you mean `draft`?" in raises(gelsim.UsageError, lambda: gelsim.Job.load(mixed, fidelity="fast"))
    digit = gelsim.Sensor.preset("digit")
    for layer, part in [("heightmap", "did you mean `surface`?"), ("rgb", "the tactile image is always written")]:
        assert part in raises(gelsim.UsageError, lambda: digit.render(ball_mm(160, 120), layers=[layer]))

    # Numbers that nothing takes: what is advised is taken.
    for name in ["threads", "samples", "seed"]:
        for wrong in [-1, 2**70, 2**200]:
            said = raises(gelsim.UsageError, lambda: gelsim.Job.load(mixed, **{name: wrong}))
            low, high = (int(word.strip(",")) for word in said.split("give ", 1)[1].split()[:3:2])
            assert said.count("error: ") == 1 and low in (0, 1) and high > 1000, said
            gelsim.Job.load(mixed, **{name: low})
            if name != "threads":
                gelsim.Job.load(mixed, **{name: high}, set=["dataset.samples_per_shard=1000000"])
    said = {raises(gelsim.UsageError, lambda: gelsim.Job.load(mixed, threads=wrong)).split("help: ")[1] for wrong in [-1, 0, 5000]}
    assert said == {"give 1 to 1024, or leave it out for all cores"}, said
    said = raises(gelsim.UsageError, lambda: digit.render(ball_mm(160, 120), index=-1))
    assert "give 0 to 18446744073709551615" in said
    digit.render(ball_mm(160, 120), index=18446744073709551615)


def frames():
    """The same depth maps as files give the same pictures, layers and labels."""
    flags = ["camera.read_noise_levels=1.0", 'output.depth_format="npy"']
    folder = Path(root) / "frames"
    folder.mkdir()
    rows, columns = np.mgrid[:160, :120]
    ball = 0.6 - 0.004 * ((rows - 70) ** 2 + (columns - 50) ** 2) * np.float32(0.1)
    maps = np.stack([ball, ball - 0.4]).astype(np.float32)
    for number, depth in enumerate(maps):
        np.save(folder / f"{number}.npy", -depth)
    known = ["--sensor", "digit", "--depth-unit", "mm", "--plane-mm", 0, "--layers", "surface,contact,normal"]
    assigned = (word for text in flags for word in ["--set", text])
    run("render", *known, *assigned, "--depth", folder, "--out", folder / "out", "--quiet")
    ours = gelsim.Sensor.preset("digit", set=flags).render(maps, layers=["surface", "contact", "normal"])
    for number in range(len(maps)):
        for name in ["tactile.png", "surface.npy", "contact.png", "normal.npy"]:
            written = samples.DECODERS[name.split(".")[1]]((folder / f"out/{number}.{name}").read_bytes())
            written = written[..., 0] if name == "contact.png" else written
            assert np.array_equal(ours[name.split(".")[0]][number], written), (number, name)
        label = json.loads((folder / f"out/{number}.json").read_text())
        # An array has no path, class or hash of its own.
        named = {key: label["object"][key] for key in ["id", "class", "path", "mesh_sha256"]}
        known = {**ours["label"][number], "object": label["object"]}
        known["objects"] = [{**one, **named} for one in known["objects"]]
        assert known == label, (known, label)


BALL_MM = 4.0
SILENT = ["camera.read_noise_levels=0.0", "camera.speckle_levels=0.0"]
BARE = ["camera={}", *SILENT, 'output.layers=["surface"]', "sensor.resolution_px=[120, 160]"]


def inside():
    """Depth frames of a camera inside a gel that has a shape: what `gelsim render` makes of the same files."""
    flags = ["camera.read_noise_levels=0.0"]
    geltip = gelsim.Sensor.preset("geltip", set=flags)
    # A ball of 4 mm, 0.8 mm deep in the tip, from 45.5 mm away: rays of the lens, and of a finer pinhole in its place.
    def seen(rows, columns, focal, along):
        x, y = np.meshgrid((np.arange(columns) + 0.5 - columns / 2) / focal, (np.arange(rows) + 0.5 - rows / 2) / focal)
        to, away = 48.7, 1 + x**2 + y**2
        with np.errstate(invalid="ignore"):
            z = (to - np.sqrt(to**2 - away * (to**2 - 16))) / away
        return np.where(np.isnan(z), np.inf, z * np.sqrt(away) if along == "ray" else z)

    folder = Path(root) / "inside"
    folder.mkdir()
    known = ["--sensor", "geltip", "--depth-unit", "mm", "--layers", "surface,contact,normal", "--set", flags[0], "--quiet"]
    cases = [
        (seen(120, 160, 80, "axis"), {}, []),
        (seen(120, 160, 80, "ray"), {"along": "ray"}, ["--depth-along", "ray"]),
        (seen(480, 640, 320, "axis"), {"fov_y_deg": 73.7398}, ["--projection", "perspective", "--fov-y-deg", 73.7398]),
    ]
    for number, (frame, options, arguments) in enumerate(cases):
        np.save(folder / f"{number}.npy", frame)
        run("render", *known, *arguments, "--depth", folder / f"{number}.npy", "--out", folder / "out")
        ours = geltip.render(frame, layers=["surface", "contact", "normal"], **options)
        theirs = json.load(open(folder / f"out/{number}.json"))
        assert theirs["contact"]["in_contact"] and theirs["health"]["unseen_px"] == 0
        written = samples.DECODERS["png"]((folder / f"out/{number}.tactile.png").read_bytes())
        assert np.array_equal(ours["tactile"], written), number
        for key in ["contact", "sensor", "health", "indentation_depth_mm", "numerics"]:
            assert ours["label"][key] == theirs[key], (number, key)
    frame = cases[0][0]
    batch = geltip.render(np.stack([frame, np.full_like(frame, np.inf)]))
    assert np.array_equal(batch["tactile"][0], geltip.render(frame)["tactile"])
    assert [label["contact"]["in_contact"] for label in batch["label"]] == [True, False]
    for value, part in [(np.nan, "NaN in row 3, column 4"), (0, "0 in row 3, column 4"), (-1, "behind the camera in row 3")]:
        broken = frame.copy()
        broken[3, 4] = value
        assert part in raises(gelsim.UsageError, lambda: geltip.render(broken))
    assert "map 1: " in raises(gelsim.UsageError, lambda: geltip.render(np.stack([frame, broken])))
    assert "behind the gel" in raises(gelsim.UsageError, lambda: geltip.render(frame / 1000))
    assert "out of range" in raises(gelsim.UsageError, lambda: geltip.render(frame, fov_y_deg=0))
    assert "did you mean `ray`?" in raises(gelsim.UsageError, lambda: geltip.render(frame, along="rays"))
    raises(TypeError, lambda: geltip.render(frame, fov_y_deg="wide"))
    flat = gelsim.Sensor.preset("digit")
    assert "this sensor is flat" in raises(gelsim.UsageError, lambda: flat.render(frame, along="axis"))


def mistakes(mixed):
    """Every mistake at once, in the command's words; of arrays in words of their own."""
    broken = Path(root) / "broken.toml"
    text = mixed.read_text().replace("samples = 13", "sampels = 13").replace("gear.obj", "gaer.obj")
    broken.write_text(text.replace("[0.3, 1.0]", "[0.3, 99.0]"))
    said = run("generate", broken, "--out", f"{root}/none", status=2)
    assert raises(gelsim.UsageError, lambda: gelsim.Job.load(broken)) == said
    assert all(part in said for part in ["sampels", "gaer.obj", "99", "broken.toml:"]), said
    assert issubclass(gelsim.UsageError, ValueError) and issubclass(gelsim.RunError, RuntimeError)
    for flags in [["indentation.depth_mm=-1"], ["a.b.c"], ['sensor.preset="digti"'], ['output.layers=["presure"]']]:
        said = run("plan", mixed, *(word for text in flags for word in ["--set", text]), status=2)
        assert raises(gelsim.UsageError, lambda: gelsim.Job.load(mixed, set=flags)) == said
    absent = Path(root) / "absent.toml"
    assert raises(gelsim.UsageError, lambda: gelsim.Job.load(absent)) == run("plan", absent, status=2)
    assert "did you mean `standard`?" in raises(gelsim.UsageError, lambda: gelsim.Job.load(mixed, fidelity="standart"))
    assert "threads=0" in raises(gelsim.UsageError, lambda: gelsim.Job.load(mixed, threads=0))
    assert "train" in raises(gelsim.UsageError, lambda: gelsim.Job.load(mixed).indices("tarin"))

    assert "did you mean `digit`?" in raises(gelsim.UsageError, lambda: gelsim.Sensor.preset("digti"))
    assert "absent.toml" in raises(gelsim.UsageError, lambda: gelsim.Sensor.load(absent))
    sensor = gelsim.Sensor.preset("digit")
    good = np.zeros((2, 160, 120), np.float32)
    good[:, 80, 60] = 0.5

    def refused(change, kind=gelsim.UsageError, **more):
        bad = good.copy()
        return raises(kind, lambda: sensor.render(change(bad), **more))

    def put(*values):
        def change(bad):
            for place, value in values:
                bad[place] = value
            return bad
        return change

    said = refused(put(((1, 3, 4), np.nan), ((1, 3, 5), np.nan), ((0, 9, 0), np.inf)))
    assert "2 values that are not a number, the first in map 1, row 3, column 4" in said, said
    assert "infinite at 1 places, the first in map 0, row 9, column 0" in said and "-inf" in said, said
    assert "all of map 1 of depth_mm goes through the pad, which is 4 mm thick" in refused(put((1, 25.0)))
    assert "4 axes" in refused(lambda bad: bad[None])
    assert "empty" in refused(lambda bad: bad[:0])
    assert "9000 columns" in refused(lambda bad: np.zeros((1, 9000), np.float32))
    assert "float32" in refused(lambda bad: bad.astype(np.uint16), TypeError)
    assert "float32" in refused(lambda bad: bad.astype(">f4"), TypeError)
    odd = np.zeros(good.nbytes + 1, np.uint8)[1:].view(np.float32).reshape(good.shape)
    assert "not aligned" in refused(lambda bad: odd)
    assert "np.asarray" in refused(lambda bad: bad.tolist(), TypeError)
    assert "did you mean `depth`?" in refused(lambda bad: bad, layers=["detph"])
    assert "pressure" in refused(lambda bad: bad, layers=["pressure"], fidelity="paper")
    assert "markers" in refused(lambda bad: bad, layers=["markers"])


def assignments(mixed):
    """A dict of dotted keys is the same as the texts of the command, and what is wrong in it is said in the same words."""
    texts = [
        "indentation.depth_mm=[0.3, 0.5]", 'sensor.preset="digit"', "camera.exposure=1.25", "dataset.seed=9", "markers.pitch_mm=2.0",
        'output.layers=["depth", "gap"]', 'gelpad={ elastic = { resolution = "half", max_iterations = 50 } }', "sensor.darkening=0.5",
    ]  # fmt: skip
    values = {
        "indentation.depth_mm": (0.3, 0.5), "sensor.preset": "digit", "camera.exposure": np.float32(1.25), "dataset.seed": np.int64(9),
        "markers.pitch_mm": 2.0, "output.layers": ["depth", "gap"],
        "gelpad": {"elastic": {"resolution": "half", "max_iterations": 50}}, "sensor.darkening": np.array(0.5),
    }  # fmt: skip
    (ours, said), (theirs, they) = (warned(lambda: gelsim.Job.load(mixed, set=given)) for given in (values, texts))
    assert ours.fingerprint == theirs.fingerprint != gelsim.Job.load(mixed).fingerprint and said == they
    led = {"azimuth_deg": 10, "color": [1.0, 0.5, 0.0], "name": 'a "quoted" \\ name\n'}
    sensor = gelsim.Sensor.preset("digit", set={"sensor.led": [led], "camera.exposure": 1.2})
    assert sensor.leds == [gelsim.Led(10.0, (1.0, 0.5, 0.0), name=led["name"])]
    assert gelsim.Sensor.load(project / "configs/sensors/digit.toml", set={"sensor.led": [led]}).leds == sensor.leds
    assert pickle.loads(pickle.dumps(sensor)).leds == sensor.leds
    for value, text in [(-1, "-1"), (float("nan"), "nan"), (True, "true"), ("deep", '"deep"'), ({"a": 1}, '{ "a" = 1 }')]:
        said = raises(gelsim.UsageError, lambda: gelsim.Job.load(mixed, set={"indentation.depth_mm": value}))
        assert said == raises(gelsim.UsageError, lambda: gelsim.Job.load(mixed, set=[f"indentation.depth_mm = {text}"])), said
    for key in ["indentation.deep_mm", "a=1", "a\nb", ""]:
        raises(gelsim.UsageError, lambda: gelsim.Job.load(mixed, set={key: 1}))
    inside = []
    inside.append(inside)
    for value, words in [(None, "leave the key out"), (2**70, "out of range"), (inside, "without end"), ("\ud800", "UTF-8")]:
        said = raises(gelsim.UsageError, lambda: gelsim.Job.load(mixed, set={"camera.exposure": value}))
        assert words in said and "exposure" in said, said
    assert "give a bool" in raises(TypeError, lambda: gelsim.Job.load(mixed, set={"camera.exposure": object()}))


def lights():
    """An LED more is one more in the image, and the same as in a job; sensors without LEDs say that they have none."""
    sensor = gelsim.Sensor.preset("digit")
    amber = gelsim.Led(azimuth_deg=45.0, color=(1.0, 0.6, 0.0), intensity=3.0)
    lit = sensor.with_leds([*sensor.leds, amber])
    assert (len(sensor.leds), len(lit.leds), lit.leds[:3]) == (3, 4, sensor.leds)
    depth = np.zeros((80, 60), np.float32)
    depth[30:50, 20:40] = 0.5
    before, after = (each.render(depth)["tactile"].astype(int) for each in (sensor, lit))
    assert (after - before)[..., 0].max() > 20
    same(sensor.with_leds(sensor.leds).render(depth), sensor.render(depth))
    by_hand = gelsim.Sensor.preset("digit", set={"sensor.led": gelsim.scene.led_tables(lit.leds)})
    same(by_hand.render(depth), lit.render(depth))
    # The defaults are the sensor file's.
    assert gelsim.Sensor.preset("digit", set=["sensor.led=[{}]"]).leds == [gelsim.Led(0.0)]
    _, said = warned(lambda: gelsim.Sensor.preset("gelsight-series2").with_leds([amber]))
    assert any("LEDs are no part" in each for each in said), said
    assert "no LED" in raises(gelsim.UsageError, lambda: sensor.with_leds([]))
    assert "65 LEDs" in raises(gelsim.UsageError, lambda: sensor.with_leds([amber] * 65))
    assert "gelsim.Led" in raises(TypeError, lambda: sensor.with_leds([{"azimuth_deg": 1}]))
    said = raises(gelsim.UsageError, lambda: gelsim.Led(0.0, color=(2.0, -1.0, 0.5), elevation_deg=100.0))
    assert all(word in said for word in ["color[0]", "color[1]", "elevation_deg"]) and "color[2]" not in said, said


# A press in which all is said, and a sequence of such presses.
ONE_PRESS = """
dataset = {{ name = "press", samples = 2, seed = 7 }}
sensor = {{ preset = "{preset}", resolution_px = [{width}, {height}] }}
object = [{{ path = "OBJECTS/gear.obj" }}]
pose = {{ x_mm = 0.7, y_mm = -0.4, yaw_deg = 33.0, {tilt} face = "-z", anchor = "contact" }}
camera = {{ read_noise_levels = 1.0, exposure = [0.9, 1.1], distortion_k1 = -0.05 }}
texture = {{ patterns = ["{pattern}"], amplitude_mm = 0.04, scale_mm = 0.7, angle_deg = 20.0 }}
"""
CAMERA = {"camera.read_noise_levels": 1.0, "camera.exposure": [0.9, 1.1], "camera.distortion_k1": -0.05}


def job_of(name, text):
    """A job file of this text."""
    path = Path(root) / name
    path.write_text(text.replace("OBJECTS", str(objects)))
    return path


def same_press(ours, theirs, layers):
    """All of a press of a job, but for where its mesh came from."""
    mine = ours.sample(layers)
    for name in ["tactile", *layers]:
        if isinstance(theirs[name], dict):
            for part, value in theirs[name].items():
                assert np.array_equal(mine[name][part], value), (name, part)
        else:
            assert np.array_equal(mine[name], theirs[name]) and mine[name].dtype == theirs[name].dtype, name
    label = copy.deepcopy(theirs["label"])
    for each in (label, mine["label"]):
        for place in [each["object"], *each["objects"]]:
            for key in ["class", "mesh_sha256", "path", "material"]:
                place.pop(key, None)
    for key in [key for key in label if key != "texture"]:
        assert mine["label"][key] == label[key], (key, mine["label"][key], label[key])


def simulators():
    """What a simulator presses is what a job presses, at every level, on flat pads, with markers and on gels that have a shape."""
    gear = gelsim.Mesh.load(objects / "gear.obj")
    pose = gelsim.Pose(0.6, 0.7, -0.4, 33.0, 4.0, 20.0, anchor="contact")
    tilt = "tilt_deg = 4.0, tilt_azimuth_deg = 20.0,"
    basic = ["depth", "surface", "contact", "normal", "gap", "points", "reference", "untouched"]
    cases = [(level, "digit", ["markers"]) for level in RUNGS]
    cases += [("draft", "gelsight-series2", ["lamps"]), ("draft", "tactip", ["pins"]), ("draft", "geltip", [])]
    for level, preset, more in cases:
        knows = [] if level == "paper" else ["pressure", "flow"]
        layers = [name for name in [*basic, *knows, *more] if (preset, name) != ("tactip", "untouched")]
        curved = preset in ["tactip", "geltip"]
        size = {"tactip": [64, 64], "gelsight-series2": [72, 60], "geltip": [80, 60]}.get(preset, [60, 80])
        pattern = "knurled"
        text = ONE_PRESS.format(preset=preset, width=size[0], height=size[1], tilt=tilt, pattern=pattern)
        text += "indentation.depth_mm = 0.6\n"
        set_ = dict(CAMERA)
        if curved:
            text = text.replace(", distortion_k1 = -0.05", "")
            del set_["camera.distortion_k1"]
        if "markers" in more:
            text += "markers.pitch_mm = 1.5\n"
            set_["markers.pitch_mm"] = 1.5
        shear = None
        if knows:
            text += "shear = { x_mm = 0.2, twist_deg = 3.0, friction = { coulomb = { coefficient = 0.5 } } }\n"
            shear = gelsim.Shear(0.2, 0.0, 3.0)
        text += f"output.layers = {json.dumps(layers)}\n"
        job = gelsim.Job.load(job_of("press.toml", text), fidelity=level)
        simulator = gelsim.Simulator(preset, level, resolution_px=size, set=set_, flow=bool(knows))
        for index in range(2):
            theirs = job[index]
            # Where the pattern lies is drawn: the job's is not told by its label, so that both have the same only without one.
            smooth = {"texture.amplitude_mm": 0.0}
            plain, _ = warned(lambda: gelsim.Job.load(job_of("press.toml", text), fidelity=level, set=smooth)[index])
            ours = simulator.press(gear, pose, shear=shear, friction=0.5 if shear else None, index=index, seed=7)
            same_press(ours, plain, job.layers)
            assert ours.label["texture"]["amplitude_mm"] == 0.0 and theirs["label"]["texture"]["amplitude_mm"] == 0.04
            drawn = gelsim.Simulator(
                preset, level, resolution_px=size, flow=bool(knows),
                set={**set_, "texture.patterns": [pattern], "texture.amplitude_mm": 0.04, "texture.scale_mm": 0.7, "texture.angle_deg": 20.0},
            )  # fmt: skip
            same_press(drawn.press(gear, pose, shear=shear, friction=0.5 if shear else None, index=index, seed=7), theirs, job.layers)
        textured = simulator.press(gear, pose, texture=gelsim.Texture(pattern, 0.04, 0.7, 20.0), seed=7)
        # Pins show no texture.
        assert np.array_equal(textured.image, simulator.press(gear, pose, seed=7).image) == (preset == "tactip")
        assert textured.label["texture"] == {"pattern": pattern, "amplitude_mm": 0.04, "scale_mm": 0.7, "angle_deg": 20.0}
        assert [name for name in ["pressure", "flow"] if getattr(textured, name) is not None] == knows
        assert (textured.force_n is None) == (level == "paper")

    # A mesh is the same from wherever it comes.
    simulator = gelsim.Simulator("digit", "draft", resolution_px=(60, 80))
    truth = simulator.press(gear, pose)
    vertices, faces = obj(objects / "gear.obj")

    class Other:
        pass

    other = Other()
    other.vertices, other.faces = vertices.tolist(), faces
    for given in [objects / "gear.obj", str(objects / "gear.obj"), (vertices, faces), (vertices.tolist(), faces.tolist()), other,
                  (vertices[::-1], len(vertices) - 1 - faces.astype(np.int8 if len(vertices) < 128 else np.int64)),
                  pickle.loads(pickle.dumps(gear)), pickle.loads(pickle.dumps(gelsim.Mesh(vertices, faces)))]:  # fmt: skip
        ours = simulator.press(given, pose)
        assert np.array_equal(ours.image, truth.image) and np.array_equal(ours.depth, truth.depth), type(given)
    scaled = gelsim.Mesh.load(objects / "gear.obj", mm_per_unit=0.5)
    assert np.allclose(np.diff(scaled.bounds_mm, axis=0) * 2, np.diff(gear.bounds_mm, axis=0))
    turned = gelsim.Placement(truth.pose[:3], truth.pose[3:])
    assert np.abs(simulator.press(gear, turned).image.astype(int) - truth.image).max() <= 1

    # Heights are those of Sensor.render, whose maps may have any size.
    sensor = gelsim.Sensor.preset("digit", set=CAMERA)
    simulator = gelsim.Simulator(sensor, "high", resolution_px=(60, 80))
    heights = np.full((80, 60), -np.inf)
    heights[20:40, 10:50] = np.linspace(0.2, 0.6, 40)
    layers = ["depth", "surface", "contact", "normal", "pressure", "gap"]
    for given in [heights, heights.astype(np.float32), heights[..., None], np.asfortranarray(heights)]:
        theirs = sensor.render(heights, fidelity="high", layers=layers, index=4, seed=5)
        same(simulator.press(given, index=4, seed=5).sample(layers), theirs)

    # Threads share one; an object may be soft; what is random follows index and seed.
    alone = [simulator.press(gear, pose, index=index).image for index in range(4)]
    with ThreadPoolExecutor(4) as threads:
        together = list(threads.map(lambda index: simulator.press(gear, pose, index=index).image, [*range(4)] * 3))
    assert all(np.array_equal(image, alone[number % 4]) for number, image in enumerate(together))
    assert not np.array_equal(alone[0], alone[1])
    assert simulator.press(gear, pose, youngs_modulus_kpa=20.0).force_n < 0.9 * simulator.press(gear, pose).force_n


def obj(path):
    """Corners and triangles of an OBJ file of triangles."""
    rows = [line.split() for line in path.read_text().splitlines()]
    vertices = [[float(word) for word in row[1:4]] for row in rows if row[:1] == ["v"]]
    faces = [[int(word.split("/")[0]) - 1 for word in row[1:]] for row in rows if row[:1] == ["f"]]
    triangles = [[face[0], *face[k : k + 2]] for face in faces for k in range(1, len(face) - 1)]
    return np.array(vertices), np.array(triangles)


SEQUENCE = """
indentation.no_contact = 0.0
markers.pitch_mm = 1.5
[sequence]
frame_rate_hz = 10.0
friction = { coefficient = 0.4 }
phase = [
    { name = "press", duration_s = 0.3, depth_mm = 0.6 },
    { name = "slide", duration_s = 0.5, x_mm = 1.0, y_mm = -0.3, twist_deg = 10.0 },
    { name = "roll", duration_s = 0.3, tilt_deg = 6.0, tilt_azimuth_deg = 90.0 },
    { name = "lift", duration_s = 0.4, depth_mm = -0.2 },
    { name = "touch", duration_s = 0.2, depth_mm = 0.3 },
]
[output]
layers = ["depth", "surface", "contact", "flow", "slip", "markers"]
"""


def steps():
    """A sequence by hand is the one that a job makes of the same poses: what sticks, slips and rolls, image for image."""
    text = ONE_PRESS.format(preset="digit", width=90, height=120, tilt="", pattern="noise") + SEQUENCE
    job, _ = warned(lambda: gelsim.Job.load(job_of("sequence.toml", text), set={"texture.amplitude_mm": 0.0}))
    gear = gelsim.Mesh.load(objects / "gear.obj")
    simulator = gelsim.Simulator("digit", resolution_px=(90, 120), set={**CAMERA, "markers.pitch_mm": 1.5})
    states = set()
    for index in range(2):
        theirs = job[index]
        simulator.reset(friction=0.4, index=index, seed=7)
        for number, (frame, label) in enumerate(zip(theirs["frames"], theirs["label"]["frames"], strict=True)):
            pose = label["pose"]
            ours = simulator.step(gear, gelsim.Placement(pose["translation_mm"], pose["quaternion_xyzw"]))
            assert ours.frame == number
            # The rotation goes through the label's quaternion; within a frame the job rolls about another point.
            rolls = label["phase"] in ["roll", "lift", "touch"]
            off = np.abs(ours.image.astype(int) - frame["tactile"]).max()
            assert off <= (1 if rolls else 0), (number, label["phase"], off)
            off = np.abs(ours.flow - frame["flow"]).max()
            assert off < (2e-2 if rolls else 1e-5), (number, label["phase"], off)
            assert np.mean(ours.slip != frame["slip"]) < (1e-3 if rolls else 1e-4), (number, label["phase"])
            for name in ["contact", "depth", "surface"]:
                assert np.abs(ours.sample()[name].astype(float) - frame[name]).mean() < 0.02 * max(frame[name].max(), 1e-9), name
            force = label["wrench"]["force_n"]
            assert np.allclose(ours.wrench[:3], force, atol=(2e-3 if rolls else 1e-5) * max(1.0, -force[2])), (ours.wrench, label["wrench"])
            assert ours.slip_state == label["slip"]["state"], (number, ours.slip_state, label["slip"])
            states.add(ours.slip_state)
    assert states == {"none", "incipient", "gross"}

    # Another friction, heights of the same object, and copies in threads.
    cylinder = gelsim.Mesh.load(objects / "cylinder.obj")
    simulator = gelsim.Simulator("digit", "draft", resolution_px=(60, 80), flow=True)

    def slide(simulator, friction, indenter=None):
        simulator.reset(friction=friction)
        found = []
        for number in range(8):
            pose = gelsim.Pose(0.4, x_mm=0.15 * max(0, number - 1))
            press = simulator.press(cylinder, pose)
            placement = gelsim.Placement(press.pose[:3], press.pose[3:])
            found.append(simulator.step(*((cylinder, pose) if indenter is None else (indenter(press), placement))))
        return found

    truth = {friction: slide(simulator, friction) for friction in [0.2, 0.8, None]}
    pull = {friction: press[-1].wrench[0] for friction, press in truth.items()}
    normal = -truth[0.2][-1].wrench[2]
    assert abs(pull[0.2] - 0.2 * normal) < 0.01 * normal and pull[0.2] < pull[0.8] <= 0.8001 * normal and pull[0.8] < pull[None], pull
    assert [truth[friction][-1].slip_state for friction in [0.2, None]] == ["gross", "none"]
    heights = slide(simulator, 0.2, lambda press: np.where(press.depth > 0, press.depth, -np.inf).astype(np.float32))
    assert abs(heights[-1].wrench[0] - pull[0.2]) < 0.1 * normal and heights[-1].slip_state == "gross"
    with ThreadPoolExecutor(3) as threads:
        each = list(threads.map(lambda friction: slide(simulator.copy(), friction), truth))
    for friction, found in zip(truth, each, strict=True):
        for ours, theirs in zip(found, truth[friction], strict=True):
            same(ours.sample(), theirs.sample())

    # What cannot be right leaves the sequence as it is.
    simulator.reset(friction=0.2)
    for number in range(8):
        press = simulator.step(cylinder, gelsim.Pose(0.4, x_mm=0.15 * max(0, number - 1)))
        raises(gelsim.UsageError, lambda: simulator.step(cylinder, gelsim.Pose(9.0)))
        raises(gelsim.UsageError, lambda: simulator.step(np.zeros((80, 60), np.float32), gelsim.Placement((0, 0, 0), (0, 0, 1, 1))))
        raises(TypeError, lambda: simulator.step(cylinder, None, texture="noise"))
        same(press.sample(), truth[0.2][number].sample())
    assert simulator.step(cylinder, gelsim.Pose(-0.5)).slip_state == "none"
    assert "paper" in raises(gelsim.UsageError, lambda: gelsim.Simulator("digit", "paper").step(cylinder, gelsim.Pose(0.1)))


def nonsense():
    """What no press is made of is said, with all mistakes and a way out, and no panic."""
    simulator = gelsim.Simulator("digit", "draft", resolution_px=(60, 80))
    pose = gelsim.Pose(0.3)
    good = ([(-3, -3, 2), (3, -3, 2), (0, 3, 2), (0, 0, 0)], [(3, 0, 1), (3, 1, 2), (3, 2, 0)])
    for vertices, faces, kind, words in [
        ([], [], gelsim.UsageError, "vertices_mm has the shape"),
        (np.zeros((0, 3)), np.zeros((0, 3), int), gelsim.UsageError, "no vertex"),
        (good[0], np.zeros((0, 3), int), gelsim.UsageError, "no triangle"),
        (np.full((4, 3), np.nan), good[1], gelsim.UsageError, "finite"),
        (np.zeros((4, 3)), good[1], gelsim.UsageError, "without area"),
        (np.array(good[0]) * 1e9, good[1], gelsim.UsageError, "across"),
        (good[0], [(0, 1, 4)], gelsim.UsageError, "corners 0 to 4"),
        (good[0], [(0, 1, -1)], gelsim.UsageError, "corners -1"),
        (good[0], [(0.0, 1.0, 2.0)], TypeError, "whole numbers"),
        (good[0], [(0, 1)], gelsim.UsageError, "faces has the shape (1, 2)"),
        (np.zeros((4, 4)), good[1], gelsim.UsageError, "(4, 4)"),
        ([["a", "b", "c"]], good[1], TypeError, "vertices_mm"),
        ("abc", good[1], TypeError, "vertices_mm"),
        ([[1, 2, 3], [4, 5]], good[1], TypeError, "vertices_mm"),
        (np.zeros((4, 3), complex), good[1], TypeError, "vertices_mm"),
        (None, None, TypeError, "vertices_mm"),
    ]:
        said = raises(kind, lambda: simulator.press((vertices, faces), pose))
        assert words in said, said
    # Corners that are none go with their triangles, and a warning.
    holes = np.array([*good[0], (np.nan, 0, 0)], float)
    mesh, said = warned(lambda: gelsim.Mesh(holes, [*good[1], (4, 0, 1)], name="holes"))
    assert mesh.triangles == 3 and len(said) == 1 and "holes" in said[0] and "not finite" in said[0], said
    assert np.array_equal(simulator.press(mesh, pose).image, simulator.press(good, pose).image)
    for path, words in [("absent.stl", "absent.stl"), (objects, "mesh"), (objects / "gear", "gear"), ("a\0b", "path"), ("x" * 9999, "path")]:
        assert words in raises(gelsim.UsageError, lambda: simulator.press(path, pose))
    depth = np.zeros((80, 60), np.float32)
    for change, kind, words in [
        (lambda bad: bad[:79], gelsim.UsageError, "resolution_px=(60, 79)"),
        (lambda bad: np.stack([bad, bad]), gelsim.UsageError, "Sensor.render takes several"),
        (lambda bad: bad + np.nan, gelsim.UsageError, "not a number"),
        (lambda bad: np.where(np.arange(60) > 30, np.inf, bad), gelsim.UsageError, "infinite"),
        (lambda bad: bad.astype(np.int32), TypeError, "depth_mm is int32"),
        (lambda bad: bad.tolist(), TypeError, "an array of heights"),
        (lambda bad: np.zeros((0, 0)), gelsim.UsageError, "empty"),
        (lambda bad: None, TypeError, "indenter is None"),
        (lambda bad: (bad,), TypeError, "tuple of 1"),
    ]:
        for call in [simulator.press, lambda it: simulator.step(it, gelsim.Placement((0, 0, 0)))]:
            said = raises(kind, lambda: call(change(depth)))
            assert words in said, said
    assert "Placement" in raises(gelsim.UsageError, lambda: simulator.press(depth, pose))
    assert "gelsim.Pose(0.5)" in raises(gelsim.UsageError, lambda: simulator.press(good))
    assert "4 mm" in raises(gelsim.UsageError, lambda: simulator.press(good, gelsim.Pose(4.5)))
    assert "4 mm" in raises(gelsim.UsageError, lambda: simulator.press(good, gelsim.Placement((0, 0, -5.0))))
    assert "gel has a shape" in raises(gelsim.UsageError, lambda: gelsim.Simulator("geltip").press(depth))
    assert "flow=True" in raises(gelsim.UsageError, lambda: simulator.press(good, pose, shear=gelsim.Shear(0.1)))
    said = raises(gelsim.UsageError, lambda: simulator.press(good, pose, friction=-1.0, youngs_modulus_kpa=0.0, poisson_ratio=1.0))
    assert all(word in said for word in ["friction is -1.0", "youngs_modulus_kpa", "poisson_ratio"]), said
    assert "rigid" in raises(
        gelsim.UsageError, lambda: gelsim.Simulator("digit", "paper").press("objects/sphere.obj", pose, youngs_modulus_kpa=9.0)
    )
    for arguments, words in [(("digti",), "did you mean `digit`?"), (("absent.toml",), "absent.toml"), (("digit", "fine"), "fidelity level")]:
        assert words in raises(gelsim.UsageError, lambda: gelsim.Simulator(*arguments))
    assert "resolution_px[0]" in raises(gelsim.UsageError, lambda: gelsim.Simulator("digit", resolution_px=(0, 80)))
    assert "camera.expsoure" in raises(gelsim.UsageError, lambda: gelsim.Simulator("digit", set={"camera.expsoure": 1.0}))
    assert "depth" in raises(gelsim.UsageError, lambda: simulator.press(good, pose).sample(["detph"]))
    assert "no 'markers'" in raises(gelsim.UsageError, lambda: simulator.press(good, pose).sample(["markers"]))
    # Far from the pad, and so small that no pixel sees it.
    assert not simulator.press(good, gelsim.Pose(0.3, x_mm=1e4)).in_contact
    assert simulator.press((np.array(good[0]) * 1e-6, good[1]), pose).healthy


def generating(mixed):
    """`gelsim.generate` writes what the command writes, again and again in a process, and from any thread."""
    written = Path(tempfile.mkdtemp(dir=root)) / "out"
    run("generate", mixed, "--out", written, "--quiet", "--set", EVERY_LAYER, "--seed", "6")
    folder = Path(tempfile.mkdtemp(dir=root))
    done = gelsim.generate(mixed, folder / "path", set={"output.layers": LAYERS}, seed=6, threads=2)
    assert (done.path, done.samples, done.complete, done.shards_there_already) == (folder / "path", 13, True, 0)
    gelsim.generate(gelsim.Job.load(mixed, set=[EVERY_LAYER], seed=6), str(folder / "job"))
    thread = threading.Thread(target=lambda: gelsim.generate(str(mixed), folder / "thread", set=[EVERY_LAYER], seed=6))
    thread.start()
    thread.join()
    names = [path.relative_to(written) for path in written.rglob("*") if path.is_file() and path.parent.name != "stats"]
    assert len(names) > 5
    for name in ["path", "job", "thread"]:
        equal, *rest = filecmp.cmpfiles(written, folder / name, names, shallow=False)
        assert rest == [[], []], (name, rest)
    again = gelsim.generate(mixed, folder / "path", set={"output.layers": LAYERS}, seed=6)
    assert (again.samples, again.shards, again.shards_there_already) == (0, 0, done.shards)
    tar = next((folder / "path/data").glob("train-*.tar"))
    tar.write_bytes(tar.read_bytes()[:-512])
    again = gelsim.generate(mixed, folder / "path", set={"output.layers": LAYERS}, seed=6)
    assert (again.shards, again.shards_made_again) == (1, [tar.stem])
    assert "another job" in (said := raises(gelsim.UsageError, lambda: gelsim.generate(mixed, folder / "path"))) or "overwrite" in said, said
    assert gelsim.generate(mixed, folder / "path", samples=2, overwrite=True).samples == 2
    for job, out, more, kind, words in [
        (mixed, "s3://bucket/x", {}, gelsim.UsageError, "object store"),
        (mixed, "", {}, gelsim.UsageError, "empty"),
        (mixed, folder / "x", {"samples": 0}, gelsim.UsageError, "samples"),
        (mixed, folder / "x", {"set": {"pose.yaw": 1}}, gelsim.UsageError, "yaw"),
        (mixed, folder / "x", {"threads": 0}, gelsim.UsageError, "threads=0"),
        (gelsim.Job.load(mixed), folder / "x", {"seed": 1}, gelsim.UsageError, "Job.load"),
        (folder / "absent.toml", folder / "x", {}, gelsim.UsageError, "absent.toml"),
        (7, folder / "x", {}, TypeError, "job"),
        (mixed, mixed / "x", {}, gelsim.RunError, "mixed.toml"),
    ]:
        said = raises(kind, lambda: gelsim.generate(job, out, **more))
        assert words in said, said
    assert not (folder / "x").exists()

    # Ctrl-C ends it between samples, and the same call goes on.
    code = (
        "import sys, gelsim\ntry:\n    gelsim.generate(sys.argv[1], sys.argv[2], samples=3000, threads=1)\n"
        "except KeyboardInterrupt:\n    print('interrupted', flush=True)\n"
        "print(gelsim.generate(sys.argv[1], sys.argv[2] + '-2', samples=2).samples)"
    )
    stopped = subprocess.Popen([sys.executable, "-c", code, mixed, folder / "stopped"], stdout=subprocess.PIPE, text=True)
    while not list(folder.glob("stopped/stats/*.json")):
        assert stopped.poll() is None
        time.sleep(0.01)
    stopped.send_signal(signal.SIGINT)
    assert stopped.communicate(timeout=120)[0] == "interrupted\n2\n" and stopped.returncode == 0
    assert not (folder / "stopped/dataset.json").exists() and not list(folder.glob("stopped/data/.*.partial"))

    # A dataset is read by layers and through a function, as a whole or split by split.
    whole = gelsim.load(folder / "job")
    some = gelsim.load(folder / "job", layers=["tactile", "markers"])
    turned = gelsim.load(folder / "job", "train", transform=in_contact, layers=["contact"])
    assert [list(sample) for sample in some] == [["tactile", "markers", "label", "key"]] * 13
    for ours, theirs in zip(some, whole, strict=True):
        assert np.array_equal(ours["tactile"], theirs["tactile"]) and ours["label"] == theirs["label"]
    assert list(turned) == [bool(sample["contact"].any()) for sample in gelsim.load(folder / "job", "train")]
    assert set(turned) == {True, False}
    for dataset in (some, turned):
        again = pickle.loads(pickle.dumps(dataset))
        assert (again.wanted, again.transform, len(again)) == (dataset.wanted, dataset.transform, len(dataset))
    assert list(pickle.loads(pickle.dumps(turned))) == list(turned)
    assert list(gelsim.load(folder / "job", layers=[])[0]) == ["label", "key"]
    # What is not wanted is not decoded: it may be damaged.
    broken = folder / "broken"
    gelsim.generate(mixed, broken, samples=1, set={"output.container": "folder", "output.layers": ["depth", "contact"]})
    next(broken.rglob("*.contact.png")).write_bytes(b"none")
    assert gelsim.load(broken, layers=["depth"])[0]["depth"].shape == (72, 96)
    assert "contact" in raises(gelsim.RunError, lambda: gelsim.load(broken)[0])
    said = raises(gelsim.UsageError, lambda: gelsim.load(folder / "job", layers=["depht", "tactile", "gap"]))
    assert "'depht', 'gap'" in said and "'markers'" in said and "'tactile'" in said, said
    raises(TypeError, lambda: gelsim.load(folder / "job", layers="depth"))
    raises(TypeError, lambda: gelsim.load(folder / "job", transform="depth"))


def in_contact(sample):
    """Of what `load` gives."""
    return bool(sample["contact"].any())


def documented():
    """Every public name says what it is, compiled ones in the words of the stubs; what they show runs as it stands."""
    stubs = ast.parse(Path(gelsim._native.__file__).with_name("_native.pyi").read_text())
    said = 0
    for node in stubs.body:
        members = [node, *getattr(node, "body", [])] if isinstance(node, ast.ClassDef) else [node]
        for member in members:
            if not isinstance(member, (ast.ClassDef, ast.FunctionDef)) or ast.get_docstring(member) is None:
                continue
            owner = getattr(gelsim._native, node.name)
            found = owner if member is node else getattr(owner, member.name)
            if not issubclass(owner if isinstance(owner, type) else object, Exception):
                assert inspect.getdoc(found) == ast.get_docstring(member), (node.name, member.name, inspect.getdoc(found))
                said += 1
    assert said > 25
    snippets = {}
    for name in gelsim.__all__:
        thing = getattr(gelsim, name)
        if isinstance(thing, str):
            continue
        text = inspect.getdoc(thing)
        assert text and len(text) > 20, name
        snippets[name] = text
        for part, value in vars(thing).items() if isinstance(thing, type) else []:
            value = getattr(value, "__func__", value)
            if not part.startswith("_") and (inspect.isroutine(value) or isinstance(value, (property, cached_property))):
                assert inspect.getdoc(value), (name, part)
    folder = Path(tempfile.mkdtemp(dir=root))
    (folder / "job.toml").write_text(
        f'dataset = {{ name = "shown", samples = 50 }}\nobject = [{{ path = "{objects}/sphere.obj" }}]\n'
        "indentation.depth_mm = 0.5\nsensor.resolution_px = [24, 32]\n"
    )
    (folder / "ball.stl").write_text("solid\n" + "".join(
        "facet normal 0 0 0\nouter loop\n" + "".join(f"vertex {x} {y} {z}\n" for x, y, z in triangle) + "endloop\nendfacet\n"
        for triangle in [((0, 0, 0), (1, 0, 1), (0, 1, 1)), ((0, 0, 0), (0, 1, 1), (-1, -1, 1))]) + "endsolid\n")  # fmt: skip
    shown = [("gelsim", gelsim.__doc__), *sorted(snippets.items(), key=lambda item: item[0] == "load")]
    run_ = 0
    for name, text in shown:
        code = "".join(re.findall(r"```python\n(.*?)```", text, re.DOTALL))
        if not code:
            continue
        if name == "Mesh":
            code = "\n".join(line for line in code.splitlines() if "trimesh" not in line)
            code = "vertices_mm, faces = [(0, 0, 0), (1, 0, 1), (0, 1, 1)], [(0, 1, 2)]\n" + code
        start = "import gelsim\nimport numpy as np\n" + ('sensor = gelsim.Sensor.preset("digit")\n' if name == "Led" else "")
        done = subprocess.run([sys.executable, "-W", "error", "-c", start + code], cwd=folder, capture_output=True, text=True)
        assert done.returncode == 0, (name, code, done.stderr)
        run_ += 1
    assert run_ == 8, run_


def surface():
    """A program that uses every public name runs, and its types are right."""
    program = project / "tests/pipeline/module_names.py"
    tree = ast.walk(ast.parse(program.read_text()))
    used = {node.attr if isinstance(node, ast.Attribute) else node.arg for node in tree if isinstance(node, (ast.Attribute, ast.keyword))}
    public = set(gelsim.__all__)
    for name in gelsim.__all__:
        thing = getattr(gelsim, name)
        if isinstance(thing, type) and not issubclass(thing, (Exception, dict)):
            public |= {part for part in dir(thing) if not part.startswith("_")}
        if callable(thing) and name not in ("UsageError", "RunError", "Effect", "Sample", "Generated"):
            calls = [thing, *(getattr(thing, part) for part in dir(thing) if isinstance(thing, type) and not part.startswith("_"))]
            for call in calls:
                if callable(call) and call not in (gelsim.Job, gelsim.Sensor):
                    public |= {p.name for p in inspect.signature(call).parameters.values() if p.kind == p.KEYWORD_ONLY}
    inherited = {"count", "raw", "manifest", "shards", "path", "transform", "mro"} | set(dir(tuple))
    assert public - used - inherited == set(), sorted(public - used - inherited)
    folder = tempfile.mkdtemp(dir=root)
    for command in [[program, folder], ["-m", "mypy", "--strict", program]]:
        done = subprocess.run([sys.executable, *command], capture_output=True, text=True)
        assert done.returncode == 0, done.stdout + done.stderr


def types():
    """The stubs are the module's, and the package is as typed as it says."""
    for arguments in [["mypy.stubtest", "gelsim", "--ignore-missing-stub"], ["mypy", "--strict", "--package", "gelsim"]]:
        done = subprocess.run([sys.executable, "-m", *arguments], capture_output=True, text=True)
        assert done.returncode == 0, done.stdout + done.stderr


if __name__ == "__main__":
    native, project, objects = Path(sys.argv[1]).resolve(), Path.cwd(), Path("objects").resolve()
    with tempfile.TemporaryDirectory() as root:
        mixed, punch = Path(root) / "mixed.toml", Path(root) / "punch.toml"
        for path, text in [(mixed, MIXED), (punch, PUNCH)]:
            path.write_text(text.replace("OBJECTS", str(objects)))
        jobs(mixed)
        sequences(mixed)
        sensors(punch)
        odd_maps()
        guesses(mixed)
        mistakes(mixed)
        frames()
        inside()
        assignments(mixed)
        lights()
        simulators()
        steps()
        nonsense()
        generating(mixed)
        documented()
        surface()
    types()
    print(f"gelsim {gelsim.__version__} in Python {sys.version.split()[0]}: the arrays and words of {os.fspath(native)}")
