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


def press(depth_mm=0.6):
    return {"indentation.depth_mm": depth_mm}


def sequence(**deep):
    phases = [{"name": "press", "duration_s": 0.2, **deep}, {"name": "slide", "duration_s": 0.2, "x_mm": 0.4}]
    return {"sequence.frame_rate_hz": 10.0, "sequence.phase": phases}


PRESETS = ["gelsight-2014", "gelsight-2017", "gelsight-mini", "digit", "gelsight-series2", "tactip", "geltip", "allsight"]
SHAPED = {"tactip", "geltip", "allsight", "a mesh"}

COMMANDS = [
    "parts", "extended", "reproduce", "report", "preview", "preview of the job", "effects", "film", "tradeoff", "plan",
    "augment", "load", "lerobot", "zarr", "hdf5",
]  # fmt: skip

# Of each axis the values by name, and the keys of the job that they set. The first is the usual one.
AXES = {
    "sensor": {preset: {"sensor.preset": preset} for preset in PRESETS}
    | {
        "a mesh": {"sensor.file": str(PROJECT / "configs/fingertip/sensor.toml")},
        "calibrated": {"sensor.file": "calibrated.toml"},
        "curved pad": {"sensor.rest_shape": {"dome": {"radius_mm": 60.0}}},
        "coated pad": {"sensor.grain": {"height_um": 1.0, "size_mm": 0.3}},
        "units": {"sensor.unit.variation": 1.0},
        "drawn": {"sensor.gelpad_thickness_mm": [3.0, 4.0]},
        "several": {"sensor.preset": ["digit", "gelsight-mini"]},
    },
    "fidelity": {level: {"fidelity": level} for level in ["standard", "paper", "draft", "high", "reference", "finite-strain"]}
    | {"a bound": {"fidelity": {"max_error_um": 500.0}}},
    "gelpad": {
        "the level's": {},
        "none": {"gelpad": "none"},
        "gaussian": {"gelpad": "gaussian"},
        "stick": {"gelpad.elastic.friction": "stick"},
        "strain": {"gelpad.elastic.strain_correction": True},
    },
    "optics": {"the sensor's": {}, **{model: {"optics": model} for model in ["phong", "led", "lamps", "calibrated"]}},
    "object": {
        "a mesh": mesh("sphere"),
        "soft": mesh("sphere", youngs_modulus_kpa=300.0),
        "own friction": mesh("sphere", friction=0.5),
        "own texture": mesh("sphere", texture={"amplitude_mm": 0.05}),
        "scaled": mesh("cube", scale=[0.8, 1.2]),
        "richest side": mesh("brick") | {"pose.face": "auto"},
        "height map": {"object": [{"path": "relief.png", "mm_per_px": 0.3, "height_mm": 0.5}]},
    },
    "objects": {
        "one": {},
        "several": {"scene.objects_per_sample": [1, 3], "pose.x_mm": [-6.0, 6.0], "pose.y_mm": [-5.0, 5.0]},
    },
    "fingers": {
        "one": {},
        "two": {"gripper.squeeze_mm": 1.0},
        "two sensors": {"gripper.squeeze_mm": 1.0, "gripper.right": {"preset": "gelsight-mini", "resolution_px": [28, 20]}},
    },
    "place": {
        "the middle": {},
        "on the gel": {"pose.from_tip_mm": [0.0, 4.0], "pose.around_deg": [0.0, 360.0]},
        "on the axis": {"indentation.at": "axis"},
        "rolled": {"pose.roll_deg": 5.0, "pose.pitch_deg": [-5.0, 5.0]},
        "above": {"indentation.no_contact": 1.0},
        "by force": {"indentation.force_n": 0.5},
    },
    "motion": {
        "none": press(),
        "shear": press() | {"shear.x_mm": 0.3},
        "sequence": sequence(depth_mm=0.5),
        "forces": sequence(force_n=0.3),
    },
    "extras": {
        "none": {},
        "texture": {"texture.amplitude_mm": 0.05},
        "print": {"markers.pitch_mm": 1.5},
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
SEVERAL = "several objects in a press"
BOUND = "a bound as `fidelity`"


def shaped(row):
    return row["sensor"] in SHAPED


def moves(row):
    return row["motion"] in {"sequence", "forces"}


def held(row):
    return row["fingers"] != "one"


def elastic(row):
    return row["gelpad"] in {"stick", "strain"} or (row["gelpad"] == "the level's" and row["fidelity"] != "paper")


def strains(row):
    return row["gelpad"] == "strain" or (row["gelpad"] == "the level's" and row["fidelity"] == "finite-strain")


# What is refused: when, what the message says, and as the page tells it, what does not go with what.
REFUSALS = [
    (lambda row: row["optics"] == "lamps" and (row["sensor"] != "gelsight-series2" or row["fingers"] == "two sensors"), "has no lamps", OPTICS_LAMPS, NO_LAMPS),
    (lambda row: row["layers"] == "lamps" and row["sensor"] != "gelsight-series2", "no lamps that were measured", "layer `lamps`", NO_LAMPS),
    (lambda row: row["optics"] in {"phong", "led"} and row["sensor"] == "gelsight-series2", "has lamps and no LED", '`optics = "phong"`, `"led"`', "a sensor that has lamps and no LED"),
    (lambda row: row["optics"] == "calibrated" and (row["sensor"] != "calibrated" or row["fingers"] == "two sensors"), "this sensor has no calibration table", '`optics = "calibrated"`', "a sensor that was not calibrated"),
    (lambda row: row["layers"] == "markers" and (row["extras"] != "print" or row["fingers"] == "two sensors"), "no printed markers", "layer `markers`", "a sensor without `[markers]`"),
    (lambda row: row["layers"] == "pins" and row["sensor"] != "tactip", "no pins", "layer `pins`", "a sensor without `[pins]`"),
    (lambda row: row["layers"] == "untouched" and row["sensor"] == "tactip", "the pins of this sensor differ from sample to sample", "layer `untouched`", "pins with jitter, as of `tactip`"),
    (lambda row: row["layers"] == "slip" and not moves(row), "a single press has no slip", "layer `slip`", "single presses"),
    (lambda row: row["layers"] == "pressure" and not elastic(row), "knows no pressure", "layer `pressure`", BLURS),
    (lambda row: row["layers"] == "flow" and not elastic(row), "knows no motion of the pad in its plane", "layers `flow`, `traction`", BLURS),
    (lambda row: row["layers"] == "traction" and not elastic(row), "knows no tractions", "layers `flow`, `traction`", BLURS),
    (lambda row: row["object"] == "soft" and not elastic(row), "nothing gives way", "an object's `youngs_modulus_kpa`", BLURS),
    (lambda row: row["object"] == "soft" and moves(row), "the objects of a sequence are rigid", "an object's `youngs_modulus_kpa`", "`[sequence]`"),
    (lambda row: row["object"] == "own friction" and row["motion"] == "none" and row["gelpad"] != "stick", "uses the friction of an object", "an object's `friction`", "a job without any friction"),
    (lambda row: moves(row) and not elastic(row), "knows no tractions, which a sequence carries on", "`[sequence]`", BLURS),
    (lambda row: moves(row) and not held(row) and strains(row), "not for the frames of a sequence", "`[sequence]`", STRAIN),
    (lambda row: moves(row) and row["gelpad"] == "stick", "a sequence has a friction of its own", "`[sequence]`", "`gelpad.elastic.friction`"),
    (lambda row: moves(row) and row["place"] in {"on the axis", "by force"}, "the phases of a sequence say how deep", "`[sequence]`", "`[indentation]`"),
    (lambda row: moves(row) and row["place"] == "above", "the phases of a sequence say whether", "`[sequence]`", "`[indentation]`"),
    (lambda row: moves(row) and row["fidelity"] == "a bound", "the level of a sequence is not chosen", "`[sequence]`", BOUND),
    (lambda row: row["fidelity"] == "a bound" and row["gelpad"] != "the level's", "leaves nothing to choose", "`gelpad`", BOUND),
    (lambda row: row["objects"] == "several" and moves(row), "a sequence moves one object", SEVERAL, "`[sequence]`"),
    (lambda row: row["objects"] == "several" and row["place"] == "on the axis", "where only one of several objects can be", SEVERAL, '`[indentation] at = "axis"`'),
    (lambda row: row["objects"] == "several" and row["object"] == "soft", "the objects of one press are one rigid body", SEVERAL, "an object's `youngs_modulus_kpa`"),
    (lambda row: row["objects"] == "several" and row["object"] == "own friction", "one body with one friction", SEVERAL, "an object's `friction`"),
    (lambda row: row["objects"] == "several" and row["object"] == "own texture", "one texture lies over all objects", SEVERAL, "an object's `texture`"),
    (lambda row: row["place"] == "by force" and not elastic(row) and not moves(row) and not held(row), "knows no force", "`[indentation] force_n`", BLURS),
    (lambda row: held(row) and not elastic(row), "knows no force, by which two fingers hold an object", "`[gripper]`", BLURS),
    (lambda row: held(row) and strains(row), "not for a gripper's two fingers", "`[gripper]`", STRAIN),
    (lambda row: held(row) and shaped(row), "a gripper's fingers are flat sensors", "`[gripper]`", "`[shape]`"),
    (lambda row: held(row) and row["files"] in {"folder", "floats"}, "a row of metadata.jsonl has one tactile image", "`[gripper]`", '`[output] container = "folder"`'),
    (lambda row: held(row) and row["place"] in {"on the axis", "by force"}, "says how deep each finger is pressed", "`[gripper]`", '`[indentation] depth_mm`, `force_n`, `at = "axis"`'),
    (lambda row: held(row) and not moves(row) and row["fidelity"] == "a bound", "the level of a gripper is not chosen", "`[gripper]`", BOUND),
    (lambda row: held(row) and row["objects"] == "several", "a gripper holds one object", SEVERAL, "`[gripper]`"),
    (lambda row: row["fingers"] == "two sensors" and row["optics"] == "the sensor's" and row["sensor"] in {"gelsight-series2", "calibrated"}, "the light of `", "`[gripper.right]`", "a sensor with another model of the light"),
    (lambda row: row["place"] == "on the gel" and not shaped(row), "this one is flat", "`from_tip_mm`, `around_deg`", "a sensor without `[shape]`"),
    (lambda row: shaped(row) and not elastic(row), "a pad that is not elastic on a gel that has a shape", "`[shape]`", BLURS),
    (lambda row: shaped(row) and strains(row) and not moves(row) and not held(row), "not for a gel that has a shape", "`[shape]`", STRAIN),
    (lambda row: shaped(row) and row["extras"] == "print", "print on a gel that has a shape", "`[shape]`", "`[markers]`"),
    (lambda row: shaped(row) and row["extras"] == "lens", "on a gel that has a shape is not simulated", "`[shape]`", "`[camera] distortion_k1`, `distortion_k2`"),
    (lambda row: shaped(row) and row["motion"] == "shear" and row["sensor"] != "tactip" and row["layers"] not in {"flow", "traction"}, "shear that neither pins nor the layers `flow` and `traction` show", "`[shape]`", "`[shear]` that neither pins nor the layers `flow` and `traction` show"),
    (lambda row: shaped(row) and row["motion"] == "shear" and row["place"] == "on the gel", "shear", "`from_tip_mm`, `around_deg`", "`[shear]`"),
]  # fmt: skip


def refusals(row):
    return [says for holds, says, _, _ in REFUSALS if holds(row)]


def toml(value):
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {toml(each)}" for key, each in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml, value)) + "]"
    return json.dumps(value)


def job(row):
    keys = {"dataset.name": "combined", "dataset.samples": 3, "dataset.samples_per_shard": 2, "dataset.seed": 3}
    keys |= {"pose.yaw_deg": [0.0, 360.0]}
    # The calibrated sensor has the size of its photograph.
    keys |= {} if row["sensor"] == "calibrated" else {"sensor.resolution_px": [32, 24]}
    for axis, value in row.items():
        keys |= AXES[axis][value]
    if row["place"] == "by force":
        keys.pop("indentation.depth_mm", None)
    if held(row):
        # Fingers are closed, not pressed in.
        keys.pop("indentation.depth_mm", None)
        if moves(row):
            keys.pop("gripper.squeeze_mm")
            keys["sequence.phase"] = [
                {"squeeze_mm" if key == "depth_mm" else key: value for key, value in phase.items()}
                for phase in keys["sequence.phase"]
            ]
            if row["fingers"] == "two":
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
    (folder / "augment.toml").write_text('[input]\npath = "out"\nbackground = "rendered"\n[sensor]\npreset = "gelsight-2014"\n[[photometric]]\ncopies = 1\nexposure_ev = 0.2\n')


def covering(chance):
    """Rows without a refusal that hold every pair of values which any such row holds."""
    names, rows = list(AXES), []
    pairs = {
        frozenset([(a, x), (b, y)])
        for a, b in itertools.combinations(names, 2)
        for x in AXES[a]
        for y in AXES[b]
    }
    while pairs:
        best, gain = None, 0
        target = sorted(chance.choice(sorted(map(sorted, pairs))))
        for _ in range(60):
            row = dict(target)
            for name in chance.sample(names, len(names)):
                if name in row:
                    continue
                # The value that adds most pairs, among those that leave the row unrefused as far as it is known.
                values = chance.sample(list(AXES[name]), len(AXES[name]))
                key = lambda value: sum(frozenset([(name, value), item]) in pairs for item in row.items())
                row[name] = max(values, key=lambda value: key(value) + 0.5 * chance.random())
            row = repaired(row, dict(target), chance)
            new = row and sum(frozenset(pair) in pairs for pair in itertools.combinations(row.items(), 2))
            if row and new > gain:
                best, gain = row, new
        if best is None:
            pairs.discard(frozenset(target))
            continue
        rows.append({name: best[name] for name in names})
        pairs -= {frozenset(pair) for pair in itertools.combinations(best.items(), 2)}
    return rows


def repaired(row, fixed, chance):
    """The row with values that are free changed until nothing refuses it; none if that does not come about."""
    for _ in range(40):
        if not unfit(row):
            return row
        free = [name for name in row if name not in fixed]
        name = chance.choice(free)
        row = row | {name: chance.choice(list(AXES[name]))}
    return None


def unfit(row):
    """Refused, or of a command that has nothing to do there."""
    command = row["command"]
    return bool(
        refusals(row)
        or (command == "film" and not moves(row))
        or (command == "effects" and (moves(row) or held(row) or row["place"] == "above"))
        or (command == "parts" and row["fidelity"] == "a bound")
        or (command == "augment" and (row["sensor"] != "gelsight-2014" or moves(row) or held(row) or row["effects"] == "all"))
        # Rendering it anew and again takes a minute.
        or (command == "tradeoff" and (row["sensor"] == "a mesh" or held(row)))
    )


def run_gelsim_in(folder, *arguments, status=0):
    return run("gelsim", *arguments, status=status, cwd=folder, timeout=300)


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


def last_key(out):
    names = [path.name for path in (out / "data").rglob("*.json*")]
    names += [name for tar in (out / "data").glob("*.tar") for name in tarfile.open(tar).getnames()]
    return max(name[:9] for name in names if name[:9].isdigit())


def run_command(folder, command):
    """Runs a row's command on its dataset."""
    out = folder / "out"
    match command:
        case "parts":
            for part in ["0/2", "1/2"]:
                generate(folder, "parts", "--partition", part)
            assert_same(out, folder / "parts")
        case "extended":
            for samples in [2, 3]:
                generate(folder, "longer", "--samples", samples)
            assert_same(out, folder / "longer")
        case "reproduce":
            run_gelsim_in(folder, "reproduce", "out", last_key(out))
        case "report":
            run_gelsim_in(folder, "report", "out", "--out", "report.html")
        case "preview":
            run_gelsim_in(folder, "preview", "out", "--out", "sheet.png")
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
        case "augment":
            run_gelsim_in(folder, "augment", "augment.toml", "--quiet", "--out", "larger")
        case "load":
            import gelsim

            loaded, rendered = gelsim.load(out), gelsim.Job.load(folder / "job.toml")
            assert len(loaded) == len(rendered) and list(loaded[0])[:-1] == list(rendered[0])
            gelsim.collate([loaded[i] for i in range(len(loaded))])
        case _:
            for more in [[], ["--check"]]:
                run(sys.executable, "-m", "gelsim.export.command", out, "--to", command, "--out", folder / "copy", *more)


def assert_works(folder, row):
    generate(folder, "out")
    run_gelsim_in(folder, "verify", "out")
    run_command(folder, row["command"])


def assert_refused(folder, row):
    done = run_gelsim_in(folder, "generate", "job.toml", "--quiet", "--out", "out", status=2)
    said = re.sub(r"\s+", " ", done.stderr)
    assert any(says in said for says in refusals(row)), f"it says none of {refusals(row)}: {done.stderr}"
    assert re.search(r"(job\.toml|sensor\.toml|preset \S+):\d+:\d+", done.stderr), f"it names no place: {done.stderr}"
    assert not (folder / "out").exists(), "it left something behind"


def random_row(chance, holds):
    """A row that a refusal holds for, and no other one if that can be."""
    best = None
    for _ in range(4000):
        row = {name: chance.choice(list(values)) for name, values in AXES.items()}
        if holds(row) and (best is None or len(refusals(row)) < len(refusals(best))):
            best = row
            if len(refusals(row)) == 1 and chance.random() < 0.2:
                break
    return best


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
    return covering(random.Random(7))


@pytest.mark.full
@pytest.mark.wheel
@pytest.mark.parametrize("command", COMMANDS)
def test_every_pair_of_values_that_go_together_works(gelsim_path, working_rows, command):
    if command in ("load", "lerobot", "zarr", "hdf5"):
        for module in ["OpenEXR", "pyarrow", "h5py"]:
            pytest.importorskip(module, reason="pip install '.[export]'")
    assert_each(assert_works, [row for row in working_rows if row["command"] == command])


@pytest.mark.full
@pytest.mark.parametrize("number", range(len(REFUSALS)), ids=lambda number: REFUSALS[number][1])
def test_what_does_not_go_together_is_refused(gelsim_path, number):
    chance, holds = random.Random(number), REFUSALS[number][0]
    assert_each(assert_refused, [random_row(chance, holds) for _ in range(REFUSED)])


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
