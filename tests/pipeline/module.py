"""The Python module against the command: the same arrays, labels and words.

    python module.py GELSIM         from the project's root, where the wheel, numpy and mypy are installed
"""

import json
import os
import pickle
import subprocess
import sys
import tempfile
import warnings
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
    types()
    print(f"gelsim {gelsim.__version__} in Python {sys.version.split()[0]}: the arrays and words of {os.fspath(native)}")
