"""A program that uses every public name of the Python module, as a user would write it; `test_module.py` runs it."""

from __future__ import annotations

import copy
import pickle
from pathlib import Path
from typing import Optional

import gelsim
import numpy as np
from numpy.typing import NDArray

CORNERS_MM = [(-3, -3, 2), (3, -3, 2), (3, 3, 2), (-3, 3, 2), (0, 0, 0)]
FACES = [(4, 0, 1), (4, 1, 2), (4, 2, 3), (4, 3, 0)]


class Pyramid:
    """A mesh of another library."""

    vertices = np.array(CORNERS_MM, np.float64)
    faces = np.array(FACES)


def deepest_mm(sample: gelsim.Sample) -> float:
    """What a sample is turned into."""
    return float(sample["depth"].max())


def sensors() -> gelsim.Sensor:
    """Sensors, and one with an LED more."""
    sensor: gelsim.Sensor = gelsim.Sensor.preset("digit", set={"camera.exposure": 1.1, "optics": "led"}, threads=1)
    more = gelsim.Led(
        azimuth_deg=45.0,
        color=(1.0, 0.6, 0.0),
        intensity=3.0,
        elevation_deg=20.0,
        angular_size_deg=(30.0, 10.0),
        distance_mm=25.0,
        position_mm=None,
        size_mm=(6.0, 1.0),
        lobe=1.0,
        name="amber",
        pattern=gelsim.LightPattern(red=(1.0, 0.2, -0.1), green=(0.9,), blue=(1.0, 0.0, 0.1, 0.0, 0.0, -0.2)),
    )
    lit = sensor.with_leds([*sensor.leds, more])
    # Defaults are left out of what is sent: the sensor's are the same.
    assert sensor.with_leds([gelsim.Led(45.0)]).leds[0] == gelsim.Led(45.0)
    assert [led.name for led in lit.leds] == ["red", "green", "blue", "amber"] and lit.leds[3] == more
    width, height = lit.resolution_px
    across, down = lit.field_of_view_mm
    assert (lit.name, width, height) == ("digit", 240, 320) and across < down and lit.gelpad_thickness_mm == 4.0 and lit.is_flat
    depth_mm = np.full((80, 60), -np.inf, np.float32)
    depth_mm[30:50, 20:40] = 0.4
    image: NDArray[np.uint8] = lit.render(depth_mm, fidelity="draft", layers=["surface"], index=1, seed=2)["tactile"]
    assert image.shape == (80, 60, 3)
    gel = gelsim.Sensor.preset("geltip")
    frame = np.full((60, 80), np.inf)
    frame[20:40, 30:50] = 45.0
    assert gel.render(frame, along="axis", fov_y_deg=60.0)["tactile"].shape == (240, 320, 3)
    return lit


def presses(sensor: gelsim.Sensor) -> None:
    """Presses of everything that can be pressed."""
    simulator = gelsim.Simulator(
        sensor, "draft", resolution_px=(60, 80), set={"camera.read_noise_levels": 1.0, "markers.pitch_mm": 2.0}, flow=True
    )
    assert simulator.fidelity == "draft" and simulator.resolution_px == (60, 80) and simulator.sensor is sensor
    assert simulator.field_of_view_mm == sensor.field_of_view_mm and simulator.is_flat and simulator.gelpad_thickness_mm == 4.0
    mesh = gelsim.Mesh(CORNERS_MM, FACES, name="pyramid")
    (left, top, low), (right, bottom, high) = mesh.bounds_mm
    assert (mesh.name, mesh.triangles, right - left, bottom - top, high - low) == ("pyramid", 4, 6.0, 6.0, 2.0)
    pose = gelsim.Pose(
        0.5, x_mm=0.5, y_mm=-0.5, yaw_deg=30.0, tilt_deg=5.0, tilt_azimuth_deg=90.0, face="-z", anchor="contact"
    )
    press: gelsim.Impression = simulator.press(
        mesh,
        pose,
        texture=gelsim.Texture("dimples", amplitude_mm=0.02, scale_mm=0.8, angle_deg=10.0, offset=(0.5, 0.0)),
        shear=gelsim.Shear(x_mm=0.1, y_mm=0.05, twist_deg=1.0),
        friction=0.7,
        youngs_modulus_kpa=500.0,
        poisson_ratio=0.45,
        index=3,
        seed=4,
    )
    image: NDArray[np.uint8] = press.image
    floats: list[NDArray[np.float32]] = [press.depth, press.surface, press.gap, press.normal, press.points]
    masks: list[NDArray[np.uint8]] = [press.contact, press.reference, press.instance]
    assert {each.shape[:2] for each in floats} | {each.shape[:2] for each in masks} == {image.shape[:2]} == {(80, 60)}
    assert press.traction is not None and press.traction.shape == (80, 60, 3)
    assert press.pressure is not None and press.flow is not None and press.markers is not None and press.untouched is not None
    dots: NDArray[np.float64] = press.markers["moved_px"]
    assert press.pins is None and press.lamps is None and press.slip is None and dots.shape[1] == 2
    force_n: Optional[float] = press.force_n
    assert press.in_contact and press.healthy and force_n is not None and force_n > 0.0
    assert press.frame is None and press.slip_state is None
    assert press.wrench.shape == (6,) and press.pose.shape == (7,) and press.label["indentation_depth_mm"] == 0.5
    texture: gelsim.Effect = press.effects["texture"]
    assert texture.ran and texture.reason
    assert list(press.sample(["depth", "flow"])) == ["tactile", "depth", "flow", "label"]

    sphere = Path("objects/sphere.obj")
    place = gelsim.Placement((0.0, 0.0, -0.3), quaternion_xyzw=(0.0, 0.0, 0.0, 1.0))
    for indenter in (gelsim.Mesh.load(sphere, mm_per_unit=1.0), sphere, (CORNERS_MM, FACES), Pyramid(), gelsim.Mesh.of(Pyramid())):
        assert simulator.press(indenter, gelsim.Pose(0.3)).in_contact
    assert simulator.press(mesh, place).in_contact
    heights: NDArray[np.float64] = np.where(press.depth > 0.0, press.depth.astype(np.float64), -np.inf)
    assert simulator.press(heights).in_contact

    simulator.reset(friction=0.4, index=1, seed=5)
    other = simulator.copy()
    other.reset(friction=0.4, index=1, seed=5)
    states: list[Optional[str]] = []
    for number in range(4):
        pose = gelsim.Pose(0.5, x_mm=0.3 * number)
        step = simulator.step(mesh, pose, texture=gelsim.Texture("noise"), duration_s=0.1)
        again = other.step(mesh, pose, texture=gelsim.Texture("noise"), duration_s=0.1)
        assert step.frame == number and np.array_equal(step.image, again.image) and step.slip is not None
        states.append(step.slip_state)
    assert states[0] == "none" and states[-1] == "gross", states
    array = gelsim.Array([simulator, sensor], "draft", threads=1)
    array.reset(friction=0.4, index=1, seed=5)
    both: list[gelsim.Impression] = array.step([mesh, sphere], [pose, place], texture=None, duration_s=0.1)
    assert len(array) == len(both) == 2 and array[0].fidelity == "draft" and array[0] is not simulator
    batch = gelsim.collate([press.sample(["depth"]), press.sample(["depth"])])
    assert batch["depth"].shape == (2, 80, 60) and batch["pose"].shape == (2, 7)

    elsewhere: gelsim.Simulator = pickle.loads(pickle.dumps(simulator))
    for same in (elsewhere, copy.copy(simulator), gelsim.Simulator(sensor, "draft", resolution_px=(60, 80))):
        assert same.press(pickle.loads(pickle.dumps(mesh)), pose).in_contact
    kept: gelsim.Impression = pickle.loads(pickle.dumps(press))
    assert np.array_equal(kept.image, press.image) and np.array_equal(kept.points, press.points)


def datasets(folder: Path) -> None:
    """A job, a dataset of it, and batches of both."""
    path = folder / "job.toml"
    path.write_text(
        f"""dataset = {{ name = "surface", samples = 4, seed = 1, splits = {{ train = 0.5, test = 0.5 }} }}
        object = [{{ path = {str(Path("objects/sphere.obj").resolve())!r} }}]
        indentation.depth_mm = 0.4"""
    )
    job: gelsim.Job = gelsim.Job.load(
        path, samples=4, seed=2, fidelity="draft", all_effects=False, set={"sensor.resolution_px": [32, 24]}, threads=1
    )
    assert len(job) == 4 and job.layers == ["depth"] and (job.name, job.seed, job.fidelity) == ("surface", 2, "draft")
    assert len(job.fingerprint) == 64 and job.classes == ["sphere"] and len(job.indices("train")) == 2
    samples: list[gelsim.Sample] = [job[0], job.sample(1), *job.samples([2, 3])]
    assert len(list(job)) == 4
    done: gelsim.Generated = gelsim.generate(job, folder / "out", threads=1, overwrite=False)
    assert done.path == folder / "out" and (done.samples, done.shards, done.complete) == (4, 2, True)
    assert (done.shards_there_already, done.shards_made_again, done.rejected, done.unhealthy) == (0, [], 0, 0)
    assert (done.unconverged, done.unplaced_objects, done.light_outside_range) == (0, 0, 0.0)
    assert done.in_contact == 4 and done.bytes > 0 and done.seconds > 0.0
    flags = {"samples": 4, "seed": 2, "fidelity": "draft"}
    again = gelsim.generate(path, folder / "out", set=["sensor.resolution_px=[32, 24]"], all_effects=False, samples=4, seed=2,
                            fidelity=str(flags["fidelity"]))
    assert (again.samples, again.shards_there_already) == (0, 2)

    dataset: gelsim.Dataset[gelsim.Sample] = gelsim.load(done.path, "train", layers=["depth"])
    assert len(dataset) == 2 and list(dataset[0]) == ["depth", "label", "key"] and dataset.split == "train"
    assert (dataset.name, dataset.layers, dataset.wanted, dataset.classes) == ("surface", ["depth"], ["depth"], ["sphere"])
    assert dataset.splits == {"train": 2, "test": 2} and dataset.fingerprint == job.fingerprint
    deepest: gelsim.Dataset[float] = gelsim.load(done.path, transform=deepest_mm)
    depths: list[float] = list(deepest)
    assert len(depths) == 4 and min(depths) > 0.3
    gelsim.generate(path, folder / "set", set={"sensors": {"from": ["digit", "tactip"]}, "output.layers": ["depth"]}, threads=1)
    both: gelsim.Dataset[gelsim.Sample] = gelsim.load(folder / "set", "test")
    assert isinstance(both, gelsim.SensorSet) and list(both.sensors) == ["digit", "tactip"] and both.set["paired"]
    assert both.calibration is None
    pairs: gelsim.Pairs[gelsim.Sample] = both.pairs()
    assert len(both) == 4 and len(pairs) == 2 and [each.name for each in pairs.sensors] == ["surface-digit", "surface-tactip"]
    assert [each["label"]["sensor"]["name"] for each in pairs[0]] == ["digit", "tactip"]
    arrays = gelsim.collate(samples)
    assert isinstance(arrays["tactile"], np.ndarray) and arrays["tactile"].shape == (4, 24, 32, 3)
    try:
        tensors = gelsim.collate_torch(samples)
    except ImportError as error:
        assert "pip install torch" in str(error)
    else:
        assert tensors["depth"].shape == (4, 24, 32) and not isinstance(tensors["depth"], np.ndarray)


def mistakes() -> None:
    """What is wrong is told at once, as ValueError."""
    try:
        gelsim.Pose(float("nan"), tilt_deg=100.0, face="top")  # type: ignore[arg-type]
    except gelsim.UsageError as error:
        assert all(word in str(error) for word in ["depth_mm", "tilt_deg", "face"]) and isinstance(error, ValueError)
    else:
        raise AssertionError("accepted")
    assert issubclass(gelsim.RunError, RuntimeError) and gelsim.__version__
