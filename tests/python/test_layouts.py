"""Copies in the layouts of others, opened as their loaders open them: what these look for, what they assert, what they skip."""

import io
import json
import pickle
import re
import shutil
import signal
import subprocess
import sys
import time

import pytest

gelsim = pytest.importorskip("gelsim", reason="the module is not installed: pip install .")
webdataset = pytest.importorskip("webdataset", reason="pip install webdataset")

import numpy as np
from gelsim.export import command
from PIL import Image
from processes import fill_disk, run

pytestmark = pytest.mark.wheel

# Eight sensors, and a slide of each of two objects in two shards.
JOB = """
dataset = {{ name = "eight", samples = 4, seed = 4, samples_per_shard = 2, object_order = "in_turn", splits = {{ train = 0.5, val = 0.5 }} }}
sensors = {sensors}
sensor.resolution_px = [40, 30]
object = [{{ path = "{objects}/sphere.obj", class = "sphere" }}, {{ path = "{objects}/cone.obj", class = "sharp" }}]
output.layers = ["reference"]
{motion}
"""
SLIDE = """
[sequence]
frame_rate_hz = 12.5
friction = { coefficient = 0.3 }
[[sequence.phase]]
name = "load"
duration_s = 0.4
force_n = 1.0
[[sequence.phase]]
name = "slide"
duration_s = 0.4
x_mm = 1.5
"""
EIGHT = '{ from = ["digit", "gelsight-mini", "gelsight-2017", "gelsight-2014"], count = 2 }'
FRAMES = 10


@pytest.fixture(scope="module")
def generated(project, tmp_path_factory):
    """Makes a set of sensors, by one command."""
    folder, made = tmp_path_factory.mktemp("layouts"), {}

    def make(sensors=EIGHT, motion=SLIDE, **options):
        key = (sensors, motion, *options)
        if key not in made:
            job, out = folder / f"{len(made)}.toml", folder / str(len(made))
            job.write_text(JOB.format(sensors=sensors, motion=motion, objects=project / "objects"))
            gelsim.generate(job, out, **options)
            made[key] = out
        return made[key]

    return make


@pytest.fixture
def export(generated, tmp_path):
    """Exports the set of eight sensors, compares the copy, and gives its folder."""

    def run(layout, source=None):
        out = tmp_path / layout
        words = [str(source or generated()), "--to", layout, "--out", str(out), "--quiet"]
        assert command.main(words) == 0
        assert command.main([*words, "--check"]) == 0
        return out

    return run


def test_t3_reads_eight_sensors(export, generated):
    """Shards by their numbers from 0 without a gap, as many samples as count.txt says, JPEG and JSON under one key without dots."""
    out, loaded = export("fota"), gelsim.load(generated())
    assert sorted(path.name for path in out.iterdir() if path.is_dir()) == sorted(loaded.sensors)
    for name, dataset in loaded.sensors.items():
        for split in ["train", "val"]:
            folder = out / name / split
            shards = sorted(folder.glob("data-*.tar"))
            assert [path.name for path in shards] == [f"data-{number:06d}.tar" for number in range(len(shards))]
            urls = f"{folder}/data-{{000000..{len(shards) - 1:06d}}}.tar"
            read = list(webdataset.WebDataset(urls, shardshuffle=False).decode("rgb8").to_tuple("__key__", "jpg", "json"))
            assert len(read) == int((folder / "count.txt").read_text()) == 2 * FRAMES
            frames = [(sample, frame) for sample in gelsim.load(generated() / name, split) for frame in range(FRAMES)]
            for (key, image, label), (sample, frame) in zip(read, frames, strict=True):
                ours, said = sample["frames"][frame], sample["label"]["frames"][frame]
                assert key.split("/")[-1] == f"{sample['key']}-f{frame:04}"
                assert image.dtype == np.uint8 and np.abs(image.astype(int) - ours["tactile"]).mean() < 3.0
                assert [label[name] for name in ["x_mm", "y_mm", "z_mm"]] == said["pose"]["translation_mm"]
                assert [label[f"quat_{name}"] for name in "xyzw"] == said["pose"]["quaternion_xyzw"]
                assert label["obj_idx"] == dataset.classes.index(label["object_name"])
                assert label["has_contact"] is said["contact"]["in_contact"]


def test_sparsh_reads_forces_and_slip(export, generated):
    """Images of a batch from its pickles in the order of their names, trajectories by their numbers, one frame without contact."""
    out, seen, slips = export("tacbench"), 0, set()
    for sensor in ["digit", "gelsight"]:
        for of_class in ["sphere", "sharp"]:
            batches = sorted((out / "T1_force" / sensor / of_class).glob("batch_*"))
            assert batches and all(re.fullmatch("batch_[0-9]+", path.name) for path in batches)
            for batch in batches:
                images = [each for path in sorted(batch.glob(f"dataset_{sensor}_*.pkl")) for each in pickle.loads(path.read_bytes())]
                found = pickle.loads((batch / "dataset_slip_forces.pkl").read_bytes())
                assert len(found["in_contact"]) == len(images) and 0 in found["in_contact"]
                background = np.asarray(Image.open(io.BytesIO(images[int(np.argmin(found["in_contact"]))])))
                assert background.ndim == 3 and background.shape[2] == 3
                for trajectory in found["trajectories"]:
                    assert {type(trajectory[name]) for name in ["indexes", "forces", "slip_label"]} == {np.ndarray}
                    indexes, forces = trajectory["indexes"], trajectory["forces"]
                    assert forces.shape == (len(indexes), 3) and len(trajectory["slip_label"]) == len(indexes) > 5
                    assert np.isfinite(forces).all() and forces[-1, 2] < -0.5
                    slips |= {*trajectory["slip_label"].tolist()}
                    for index in indexes[5:]:
                        assert np.asarray(Image.open(io.BytesIO(images[index]))).shape == (30, 40, 3)
                        seen += 1
    assert slips == {0, 1} and seen == 8 * 4 * (FRAMES - 5)
    pushed = {sample["label"]["sensor"]["name"] for sample in gelsim.load(generated())}
    assert len(pushed) == 4


def test_anytouch_reads_forces_of_sensors_that_feel_the_same(export, generated):
    """Names of sensors with digit or gelsight in them, images by their numbers, the first one untouched, z turned around."""
    out = export("touchd")
    forces, names = json.loads((out / "all_data_direction.json").read_text()), list(gelsim.load(generated()).sensors)
    assert len(forces) == 4
    for name, of_sensors in forces.items():
        assert re.match("obj[0-9]+_speed", name) and sorted(of_sensors) == sorted(names)
        for sensor, rows in of_sensors.items():
            assert "digit" in sensor or "gelsight" in sensor
            untouched = np.asarray(Image.open(out / name / sensor / "image_1.png").convert("RGB"), int)
            assert len(rows) == FRAMES
            for number, fx, fy, fz in rows:
                image = np.asarray(Image.open(out / name / sensor / f"image_{number}.png").convert("RGB"), int)
                assert image.shape == untouched.shape and np.isfinite([fx, fy]).all() and -fz >= 0.0
            assert -rows[-1][3] > 0.5 and np.abs(image - untouched).max() > 5


def test_ftp1_reads_images_of_a_hand(export, generated):
    """Zarr v2; every array as long as the last episode's end; texts that equal texts; joints, without which a hand is left out."""
    zarr = pytest.importorskip("zarr", reason="pip install zarr")
    out, loaded = export("ftp1"), gelsim.load(generated())
    assert sorted(path.name for path in out.iterdir() if path.is_dir()) == sorted(loaded.sensors)
    for name, dataset in loaded.sensors.items():
        paths = sorted((out / name).glob("*.zarr"))
        assert [path.name for path in paths] == ["train-000000.zarr", "val-000000.zarr"]
        for split, path in zip(["train", "val"], paths):
            root = zarr.open_group(path, mode="r", zarr_format=2)
            ends = root["meta/episode_ends"][:]
            assert ends.dtype == np.int64 and ends.tolist() == [FRAMES, 2 * FRAMES]
            data = {name: array[:] for name, array in root["data"].arrays()}
            assert {len(array) for array in data.values()} == {int(ends[-1])}
            assert data["camera_main_rgb"].shape[3] == 3 and data["right_hand_joints"].shape == data["right_hand_joints_idx"].shape
            assert np.issubdtype(data["right_hand_joints_idx"].dtype, np.integer)
            assert set(data["right_tactile_type_pad0"]) == {"image"} and set(data["right_tactile_area_pad0"].ravel()) == {0}
            sensor = dataset[0]["label"]["sensor"]["name"]
            assert set(data["right_tactile_sensor_pad0"]) == {{"digit": "DIGIT", "gelsight-mini": "GelSightMini"}.get(sensor, sensor)}
            images = data["right_tactile_data_pad0"]
            assert images.shape == (2 * FRAMES, 1, 30, 40, 3) and images.dtype == np.uint8
            frames = [frame["tactile"] for sample in gelsim.load(generated() / name, split) for frame in sample["frames"]]
            assert np.array_equal(images[:, 0], frames)


SITR = """
dataset = {{ name = "sitr", samples = {samples}, seed = 3, samples_per_shard = 4, object_order = "in_turn"{splits} }}
sensors = {{ from = ["gelsight-mini", "gelsight-2017"], count = 2 }}
sensor = {{ resolution_px = [224, 224], field_of_view_mm = [14.0, 14.0], unit = {{ gelpad_thickness = 0.0 }} }}
object = [{{ path = "{objects}/{first}.obj"{length} }}, {{ path = "{objects}/cube.obj" }}]
pose = {pose}
indentation.depth_mm = [0.8, 1.2]
output.layers = ["surface", "reference"]
"""
PRESSES = {"samples": 18, "splits": "", "first": "sphere", "length": ", length_mm = 4.0"}
GRID = "{ grid = { columns = 3, rows = 3, step_mm = [4.0, 4.0] }, roll_deg = 45.0, pitch_deg = 45.0, anchor = 'contact' }"


@pytest.fixture(scope="module")
def sitr(project, tmp_path_factory):
    """The folders of a set, and of the calibration presses of its sensors."""
    folder = tmp_path_factory.mktemp("sitr")
    samples = {"samples": 6, "splits": ", splits = { train = 0.5, val = 0.5 }", "first": "gear", "length": ""}
    for name, more in [("set", {**samples, "pose": "{ x_mm = [-2.0, 2.0] }"}), ("presses", {**PRESSES, "pose": GRID})]:
        (folder / f"{name}.toml").write_text(SITR.format(objects=project / "objects", **more))
        gelsim.generate(folder / f"{name}.toml", folder / name)
    return folder / "set", folder / "presses"


def test_sitr_reads_pairs_and_calibrations(sitr, tmp_path):
    """Nothing but folders of sensors, 19 calibration images, RGB of 224, a grey depth map and normals for each sample."""
    source, presses = sitr
    words = [str(source), "--to", "sitr", "--calibration", str(presses), "--out", str(tmp_path / "copy"), "--quiet"]
    assert command.main(words) == 0 and command.main([*words, "--check"]) == 0
    root, loaded = tmp_path / "copy", gelsim.load(source)
    assert sorted(path.name for path in root.iterdir()) == [f"sensor_{number:04}" for number in range(4)]

    def opened(path, mode):
        image = Image.open(path)
        assert image.size == (224, 224) and image.mode == mode, path
        return np.asarray(image)

    for number, (name, dataset) in enumerate(loaded.sensors.items()):
        folder = root / f"sensor_{number:04}"
        assert len(list((folder / "samples").iterdir())) == len(dataset) == 6
        background, *touched = [opened(folder / f"calibration/{k:04}.png", "RGB").astype(int) for k in range(19)]
        assert len(list((folder / "calibration").iterdir())) == 19
        changed = [np.abs(image - background).max(axis=2) > 24 for image in touched]
        for k, where in enumerate(changed):
            column, row = k % 3, k // 3 % 3
            y, x = (np.median(each) for each in np.nonzero(where))
            assert abs(x - 112 - 64 * (column - 1)) < 32 and abs(y - 112 - 64 * (row - 1)) < 32, (name, k)
        order = {sample["key"]: k for k, sample in enumerate(dataset)}
        for sample in dataset:
            k = order[sample["key"]]
            assert np.array_equal(opened(folder / f"samples/{k:04}.png", "RGB"), sample["tactile"])
            depth = opened(folder / f"dmaps/{k:04}.png", "L")
            assert np.abs(depth - np.clip(sample["surface"] / 3.0, 0.0, 1.0) * 255).max() <= 1.0 and depth.max() > 50
            # Units of one pad feel the same.
            twin = root / f"sensor_{number ^ 1:04}"
            assert np.array_equal(depth, opened(twin / f"dmaps/{k:04}.png", "L"))
            assert np.array_equal(opened(folder / f"norms/{k:04}.png", "RGB"), opened(twin / f"norms/{k:04}.png", "RGB"))


def test_a_set_with_calibration_presses_of_its_own_needs_no_other(sitr, project, tmp_path):
    """They are those of a job with the same sensors, and `calibration` of the loaded set."""
    source, presses = sitr
    only = {"sensors", "sensor"}
    job = SITR.format(objects=project / "objects", **PRESSES, pose=GRID)
    (tmp_path / "own.toml").write_text("\n".join(line for line in job.splitlines() if line.split(" ")[0] not in only))
    samples = {"samples": 6, "splits": ", splits = { train = 0.5, val = 0.5 }", "first": "gear", "length": ""}
    job = SITR.format(objects=project / "objects", **samples, pose="{ x_mm = [-2.0, 2.0] }")
    (tmp_path / "set.toml").write_text(job.replace("count = 2", 'count = 2, calibration = "own.toml"'))
    gelsim.generate(tmp_path / "set.toml", tmp_path / "set")
    loaded = gelsim.load(tmp_path / "set")
    assert gelsim.load(source).calibration is None and len(loaded) == 4 * 6
    for name, dataset in loaded.calibration.sensors.items():
        known = gelsim.load(presses / name)
        assert [sample["tactile"].tobytes() for sample in dataset] == [sample["tactile"].tobytes() for sample in known]
    copies = [tmp_path / "one", tmp_path / "two"]
    assert command.main([str(tmp_path / "set"), "--to", "sitr", "--out", str(copies[0]), "--quiet"]) == 0
    assert command.main([str(source), "--to", "sitr", "--calibration", str(presses), "--out", str(copies[1]), "--quiet"]) == 0
    one, two = ({path.relative_to(copy): path.read_bytes() for path in copy.rglob("*.png")} for copy in copies)
    assert one == two and len(one) == 4 * (19 + 3 * 6)


def test_sitrs_normals_are_sobels(sitr):
    cv2 = pytest.importorskip("cv2", reason="pip install opencv-python-headless")
    from gelsim.export.sitr import normals

    depth = np.clip(gelsim.load(sitr[0])[1]["surface"] / 3.0, 0.0, 1.0)
    x, y = (-cv2.Sobel(depth.astype(np.float64), cv2.CV_64F, *order, ksize=5) for order in [(1, 0), (0, 1)])
    known = np.stack([x, y, np.ones_like(x)], axis=-1)
    known /= np.linalg.norm(known, axis=-1, keepdims=True)
    found = normals(depth)
    assert np.abs(found - (known + 1) / 2 * 255).max() <= 1.0
    assert (found[0, 0] == [127, 127, 255]).all() and np.unique(found).size > 100


def test_what_sitr_cannot_be_made_of_is_told(sitr, generated, tmp_path, capsys):
    source, presses = sitr
    small = generated('{ from = ["digit"] }', "indentation.depth_mm = 0.5")
    cases = [
        ([source], "or name the set of their presses with --calibration"),
        ([source, "--calibration", small], "has other sensors than"),
        ([small, "--calibration", small], "write resolution_px = [224, 224]"),
        ([source, "--calibration", source], "nine presses of each of two objects, not gear: 4, cube: 2"),
        ([source / "gelsight-mini-0000", "--calibration", presses / "gelsight-2017-0000"], "has other light than"),
    ]
    for words, said in cases:
        assert command.main([*map(str, words), "--to", "sitr", "--out", str(tmp_path / "copy")]) == 2
        assert said in capsys.readouterr().err
        assert not list(tmp_path.glob("copy*"))
    assert command.main([str(source), "--to", "fota", "--calibration", str(presses), "--out", str(tmp_path / "copy")]) == 2
    assert "--calibration is for sitr" in capsys.readouterr().err


@pytest.mark.parametrize("layout", ["fota", "tacbench", "touchd", "ftp1"])
def test_a_copy_that_was_changed_is_told(export, generated, layout, capsys):
    out = export(layout)
    path = next(path for path in sorted(out.rglob("*")) if path.is_file() and path.name != "gelsim.json")
    path.write_bytes(path.read_bytes()[:-1])
    words = [str(generated()), "--to", layout, "--out", str(out)]
    assert command.main([*words, "--check"]) == 1
    assert f"{path.relative_to(out)} differs; delete it" in capsys.readouterr().err
    path.unlink()
    assert command.main([*words, "--check"]) == 1
    assert f"{path.relative_to(out)} is missing" in capsys.readouterr().err
    assert command.main(words) == 0
    assert "is there already" in capsys.readouterr().err


def test_one_sensor_and_two_fingers_are_copied(export, generated, project, tmp_path):
    one = generated() / "digit-0000"
    assert (export("fota", one) / "train/count.txt").read_text() == f"{2 * FRAMES}\n"
    job = tmp_path / "grips.toml"
    job.write_text(JOB.format(sensors='{ from = ["digit"] }', motion="", objects=project / "objects"))
    text = job.read_text().replace('sensors = { from = ["digit"] }', "").replace('sensor.resolution_px = [40, 30]', 'sensor = { preset = "digit", resolution_px = [30, 40] }')
    job.write_text(text + "gripper.force_n = 1.0\n")
    gelsim.generate(job, tmp_path / "grips")
    shutil.rmtree(tmp_path / "fota")
    out = export("fota", tmp_path / "grips")
    read = list(webdataset.WebDataset(f"{out}/train/data-000000.tar", shardshuffle=False).to_tuple("__key__"))
    assert [key.split("/")[-1][9:] for (key,) in read] == ["-left", "-right"] * 2
    zarr = pytest.importorskip("zarr", reason="pip install zarr")
    (path,) = sorted(export("ftp1", tmp_path / "grips").glob("*/train-*.zarr"))
    data = zarr.open_group(path, mode="r", zarr_format=2)["data"]
    assert data["right_tactile_area_pad1"][:].tolist() == [[1], [1]] and (data["right_hand_joints"][:] > 0.001).all()


def test_what_a_layout_cannot_hold_is_told_before_anything_is_made(generated, tmp_path, capsys):
    press = "indentation.depth_mm = 0.5"
    cases = [
        (generated('{ from = ["digit"] }', press), "tacbench", "single presses, and tacbench has frames with forces"),
        (generated('{ from = ["tactip", "digit"] }', SLIDE), "touchd", "touchd is read for names with `digit` or `gelsight`, not for tactip"),
        (generated('{ from = ["digit"] }', SLIDE, set={"output.layers": []}), "tacbench", 'layers = ["reference"]'),
        (generated(), "zarr", "is a set of sensors: name the folder of one of them"),
    ]
    for source, layout, said in cases:
        assert command.main([str(source), "--to", layout, "--out", str(tmp_path / "copy")]) == 2
        assert said in capsys.readouterr().err
        assert not list(tmp_path.glob("copy*"))


def content(folder):
    """Every file by its path."""
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def line_of(layout, source, sitr, out):
    """The command that makes a copy."""
    return [sys.executable, "-m", "gelsim.export.command", sitr[0] if layout == "sitr" else source, "--to", layout, "--out", out] + (
        ["--calibration", sitr[1]] if layout == "sitr" else []
    )


LAYOUTS = ["fota", "tacbench", "touchd", "ftp1", "sitr"]


@pytest.mark.full
@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_copy_that_was_killed_goes_on_to_the_same_files(generated, sitr, layout, tmp_path):
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    run(*line_of(layout, generated(), sitr, whole))
    partial = tmp_path / "killed.partial"
    # At the first file, then after every part.
    counts = [0, 1, 2, 5]
    for parts in counts:
        process = subprocess.Popen([*map(str, line_of(layout, generated(), sitr, killed))], stderr=subprocess.DEVNULL)
        begun = lambda: any((partial / "tree").rglob("*")) and len(list(partial.glob("parts/0*.json"))) >= parts
        while process.poll() is None and not begun():
            time.sleep(0.0005)
        process.kill()
        assert process.wait() == -signal.SIGKILL, "it was done before it could be killed"
        assert not killed.exists() and partial.is_dir()
    run(*line_of(layout, generated(), sitr, killed))
    assert content(killed) == content(whole) and not partial.exists()


@pytest.mark.full
@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_copy_on_a_full_disk_says_so_and_goes_on_once_there_is_room(generated, sitr, layout, tmp_path):
    whole, filled = tmp_path / "whole", 0
    run(*line_of(layout, generated(), sitr, whole))
    # Files take whole pages.
    size = sum(len(data) // 4096 * 4096 + 4096 for data in content(whole).values())
    for share in [0.05, 0.4, 0.8, 0.98]:
        disk, again = tmp_path / f"disk-{share}", tmp_path / f"again-{share}"
        disk.mkdir()
        copy = disk / "copy"
        filled += fill_disk(line_of(layout, generated(), sitr, copy), copy, int(size * share / 1024) + 4, again).returncode
        assert content(again) == content(whole), share
    assert filled > 2, "the disk is rarely full"


def test_names_that_no_folder_can_have_are_told_before_anything_is_made(generated, project, tmp_path, capsys):
    """A class is a folder of tacbench, a sensor one of touchd."""
    job = tmp_path / "job.toml"
    text = JOB.format(sensors='{ from = ["digit"] }', motion=SLIDE, objects=project / "objects").replace('sensors = { from = ["digit"] }\n', "")
    for layout, change, said in [
        ("tacbench", ('class = "sharp"', 'class = "../../sharp"'), "the class '../../sharp'"),
        ("touchd", ("sensor.resolution_px", 'sensor.name = "digit/1"\nsensor.resolution_px'), "the sensor 'digit/1'"),
        ("tacbench", ("sensor.resolution_px", 'sensor.preset = ["digit", "tactip"]\nsensor.resolution_px'), "not for tactip"),
        ("touchd", ("sensor.resolution_px", 'sensor.preset = ["digit", "tactip"]\nsensor.resolution_px'), "not for tactip"),
    ]:
        job.write_text(text.replace(*change))
        gelsim.generate(job, tmp_path / "out")
        assert command.main([str(tmp_path / "out"), "--to", layout, "--out", str(tmp_path / "copy")]) == 2
        assert said in capsys.readouterr().err
        assert not list(tmp_path.glob("copy*"))
        shutil.rmtree(tmp_path / "out")
