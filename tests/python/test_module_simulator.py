"""`gelsim.Simulator` against jobs: the same presses and sequences; and what it is given that is none."""

import contextlib
import copy
import json
import os
import pickle
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from types import MappingProxyType, SimpleNamespace

import pytest

gelsim = pytest.importorskip("gelsim", reason="the module is not installed: pip install .")

import numpy as np
from module_checks import LEVELS, assert_refused, refusal, refusals, same, warned

pytestmark = pytest.mark.wheel

# A press in which all is said, and a sequence of such presses.
ONE_PRESS = """
dataset = {{ name = "press", samples = 2, seed = 7 }}
sensor = {{ preset = "{preset}", resolution_px = [{width}, {height}] }}
object = [{{ path = "OBJECTS/gear.obj" }}]
pose = {{ x_mm = 0.7, y_mm = -0.4, yaw_deg = 33.0, {tilt} face = "-z", anchor = "contact" }}
camera = {{ read_noise_levels = 1.0, exposure = [0.9, 1.1], {lens} }}
texture = {{ patterns = ["{pattern}"], amplitude_mm = 0.04, scale_mm = 0.7, angle_deg = 20.0 }}
"""
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
CAMERA = {"camera.read_noise_levels": 1.0, "camera.exposure": [0.9, 1.1], "camera.distortion_k1": -0.05}
LENS = "distortion_k1 = -0.05"
POSE = gelsim.Pose(0.6, 0.7, -0.4, 33.0, 4.0, 20.0, anchor="contact")


@pytest.fixture(scope="module")
def objects(project):
    return project / "objects"


@pytest.fixture(scope="module")
def gear(objects):
    return gelsim.Mesh.load(objects / "gear.obj")


@pytest.fixture(scope="module")
def cylinder(objects):
    return gelsim.Mesh.load(objects / "cylinder.obj")


@pytest.fixture(scope="module")
def draft():
    """A simulator of few pixels and few effects."""
    return gelsim.Simulator("digit", "draft", resolution_px=(60, 80))


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
        assert mine["label"][key] == label[key], key


@pytest.fixture(
    scope="module",
    params=[(level, "digit") for level in LEVELS] + [("draft", it) for it in ["gelsight-series2", "tactip", "geltip"]],
    ids="-".join,
)
def case(request, objects, tmp_path_factory):
    """A job of one press and its simulator: at every level, and on each kind of sensor."""
    level, preset = request.param
    size = {"tactip": [64, 64], "gelsight-series2": [72, 60], "geltip": [80, 60]}.get(preset, [60, 80])
    # The lowest level knows no forces, and pins show no pad at rest.
    knows = [] if level == "paper" else ["pressure", "flow"]
    more = {"digit": ["markers"], "gelsight-series2": ["lamps"], "tactip": ["pins"], "geltip": []}[preset]
    layers = ["depth", "surface", "contact", "normal", "gap", "points", "reference", *knows, *more]
    layers += ["untouched"] if preset != "tactip" else []
    curved = preset in ["tactip", "geltip"]
    text = ONE_PRESS.format(
        preset=preset, width=size[0], height=size[1], pattern="knurled", lens="" if curved else LENS,
        tilt="tilt_deg = 4.0, tilt_azimuth_deg = 20.0,",
    )  # fmt: skip
    text = text.replace("OBJECTS", str(objects)) + "indentation.depth_mm = 0.6\n"
    settings = {key: value for key, value in CAMERA.items() if not curved or key != "camera.distortion_k1"}
    if preset == "digit":
        text += "markers.pitch_mm = 1.5\n"
        settings["markers.pitch_mm"] = 1.5
    more = {"shear": None, "friction": None}
    if knows:
        text += "shear = { x_mm = 0.2, twist_deg = 3.0, friction = { coulomb = { coefficient = 0.5 } } }\n"
        more = {"shear": gelsim.Shear(0.2, 0.0, 3.0), "friction": 0.5}
    path = tmp_path_factory.mktemp("press") / "press.toml"
    path.write_text(text + f"output.layers = {json.dumps(layers)}\n")

    def simulator(**drawn):
        return gelsim.Simulator(preset, level, resolution_px=size, set={**settings, **drawn}, flow=bool(knows))

    return SimpleNamespace(
        level=level, preset=preset, knows=knows, path=path, more=more,
        job=gelsim.Job.load(path, fidelity=level), make=simulator, simulator=simulator(),
    )  # fmt: skip


def test_a_press_is_the_jobs(case, gear):
    """Where a job's pattern lies is drawn, and not told by its label: both have the same only without one."""
    smooth, _ = warned(lambda: gelsim.Job.load(case.path, fidelity=case.level, set={"texture.amplitude_mm": 0.0}))
    for index in range(2):
        ours = case.simulator.press(gear, POSE, **case.more, index=index, seed=7)
        same_press(ours, smooth[index], case.job.layers)
        assert ours.label["texture"]["amplitude_mm"] == 0.0


def test_a_press_with_a_pattern_that_is_drawn_is_the_jobs(case, gear):
    pattern = {"patterns": ["knurled"], "amplitude_mm": 0.04, "scale_mm": 0.7, "angle_deg": 20.0}
    simulator = case.make(**{f"texture.{key}": value for key, value in pattern.items()})
    for index in range(2):
        assert case.job[index]["label"]["texture"]["amplitude_mm"] == 0.04
        same_press(simulator.press(gear, POSE, **case.more, index=index, seed=7), case.job[index], case.job.layers)


@pytest.fixture(scope="module")
def textured(case, gear):
    return case.simulator.press(gear, POSE, texture=gelsim.Texture("knurled", 0.04, 0.7, 20.0), seed=7)


def test_a_texture_is_seen_but_by_pins(case, gear, textured):
    plain = case.simulator.press(gear, POSE, seed=7)
    # The texture takes a tenth of the force, by which pins move by less than a pixel: a few of their pixels change.
    changed = (textured.image != plain.image).any(axis=2).mean()
    assert (changed < 2e-3) == (case.preset == "tactip"), changed


def test_a_texture_is_in_the_label(textured):
    assert textured.label["texture"] == {"pattern": "knurled", "amplitude_mm": 0.04, "scale_mm": 0.7, "angle_deg": 20.0}


def test_what_a_level_does_not_know_is_none(case, textured):
    assert [name for name in ["pressure", "flow"] if getattr(textured, name) is not None] == case.knows
    assert (textured.force_n is None) == (case.level == "paper")


def corners_and_triangles(path):
    """Of an OBJ file of convex faces."""
    rows = [line.split() for line in path.read_text().splitlines()]
    vertices = [[float(word) for word in row[1:4]] for row in rows if row[:1] == ["v"]]
    faces = [[int(word.split("/")[0]) - 1 for word in row[1:]] for row in rows if row[:1] == ["f"]]
    triangles = [[face[0], *face[k : k + 2]] for face in faces for k in range(1, len(face) - 1)]
    return np.array(vertices), np.array(triangles)


MESHES = {
    "path": lambda path, vertices, faces: path,
    "text": lambda path, vertices, faces: str(path),
    "arrays": lambda path, vertices, faces: (vertices, faces),
    "lists": lambda path, vertices, faces: (vertices.tolist(), faces.tolist()),
    "another library's": lambda path, vertices, faces: SimpleNamespace(vertices=vertices.tolist(), faces=faces),
    "reversed": lambda path, vertices, faces: (
        vertices[::-1],
        len(vertices) - 1 - faces.astype(np.int8 if len(vertices) < 128 else np.int64),
    ),
    "pickled file": lambda path, vertices, faces: pickle.loads(pickle.dumps(gelsim.Mesh.load(path))),
    "pickled arrays": lambda path, vertices, faces: pickle.loads(pickle.dumps(gelsim.Mesh(vertices, faces))),
}


@pytest.fixture(scope="module")
def truth(draft, gear):
    """The gear's press."""
    return draft.press(gear, POSE)


@pytest.mark.parametrize("given", MESHES)
def test_a_mesh_is_the_same_from_wherever_it_comes(draft, truth, objects, given):
    path = objects / "gear.obj"
    ours = draft.press(MESHES[given](path, *corners_and_triangles(path)), POSE)
    assert np.array_equal(ours.image, truth.image) and np.array_equal(ours.depth, truth.depth)


def test_a_mesh_file_may_have_another_unit(gear, objects):
    scaled = gelsim.Mesh.load(objects / "gear.obj", mm_per_unit=0.5)
    assert np.allclose(np.diff(scaled.bounds_mm, axis=0) * 2, np.diff(gear.bounds_mm, axis=0))


def test_a_mesh_is_its_own_copy(gear):
    assert copy.copy(gear) is gear and copy.deepcopy(gear) is gear


def test_a_pickled_mesh_is_refused_if_its_file_has_changed(objects, tmp_path):
    path = tmp_path / "it.obj"
    path.write_bytes((objects / "gear.obj").read_bytes())
    pickled = pickle.dumps(pickle.loads(pickle.dumps(gelsim.Mesh.load(path))))
    path.write_bytes((objects / "sphere.obj").read_bytes())
    assert_refused(lambda: pickle.loads(pickled), gelsim.UsageError, [f"{path} has changed since it was read", "gelsim.Mesh.load"])
    path.write_bytes((objects / "gear.obj").read_bytes())
    assert pickle.loads(pickled).triangles == gelsim.Mesh.load(path).triangles


def test_a_placement_is_the_pose_of_the_label(draft, truth, gear):
    turned = gelsim.Placement(truth.pose[:3], truth.pose[3:])
    assert np.abs(draft.press(gear, turned).image.astype(int) - truth.image).max() <= 1


@pytest.fixture(scope="module")
def high():
    return gelsim.Simulator(gelsim.Sensor.preset("digit", set=CAMERA), "high", resolution_px=(60, 80))


@pytest.mark.parametrize(
    "change",
    [
        pytest.param(lambda heights: heights, id="float64"),
        pytest.param(lambda heights: heights.astype(np.float32), id="float32"),
        pytest.param(lambda heights: heights[..., None], id="one channel"),
        pytest.param(np.asfortranarray, id="Fortran order"),
    ],
)
def test_heights_give_what_a_sensor_makes_of_them(high, change):
    heights = np.full((80, 60), -np.inf)
    heights[20:40, 10:50] = np.linspace(0.2, 0.6, 40)
    layers = ["depth", "surface", "contact", "normal", "pressure", "gap"]
    theirs = high.sensor.render(heights, fidelity="high", layers=layers, index=4, seed=5)
    same(high.press(change(heights), index=4, seed=5).sample(layers), theirs)


def test_threads_share_a_simulator_and_noise_follows_the_index(high, gear):
    alone = [high.press(gear, POSE, index=index).image for index in range(4)]
    with ThreadPoolExecutor(4) as threads:
        together = list(threads.map(lambda index: high.press(gear, POSE, index=index).image, [*range(4)] * 3))
    assert all(np.array_equal(image, alone[number % 4]) for number, image in enumerate(together))
    assert not np.array_equal(alone[0], alone[1])


@pytest.mark.parametrize("name", ["image", "points", "label"])
def test_threads_that_read_a_layer_at_once_get_the_same_object(draft, gear, name):
    for _ in range(4):
        press, start = draft.press(gear, POSE), threading.Barrier(8)
        with ThreadPoolExecutor(8) as threads:
            first, *others = threads.map(lambda _, press=press, start=start: (start.wait(), getattr(press, name))[1], range(8))
        assert all(other is first for other in others)


FORKS = """
import os, signal, threading, time
import gelsim, numpy

simulator = gelsim.Simulator("digit", "draft", resolution_px=(480, 640))
press, other = (simulator.press(numpy.zeros((640, 480))) for _ in range(2))

def read():
    while True:
        other.__dict__.pop("normal", None)
        other.normal

threading.Thread(target=read, daemon=True).start()
for _ in range(8):
    time.sleep(0.05)
    child = os.fork()
    if child == 0:
        press.normal
        os._exit(0)
    deadline = time.monotonic() + 60
    while os.waitpid(child, os.WNOHANG) == (0, 0):
        if time.monotonic() > deadline:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            print("a child hangs", flush=True)
            os._exit(1)
        time.sleep(0.01)
os._exit(0)
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="nothing forks here")
def test_a_process_that_is_forked_while_a_thread_reads_a_layer_reads_it_too():
    done = subprocess.run([sys.executable, "-W", "ignore", "-c", FORKS], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_simulator_says_what_set_made_of_its_pad():
    changes = {"sensor.gelpad_thickness_mm": 2.0, "sensor.field_of_view_mm": [6.0, 8.0]}
    changed = gelsim.Simulator("digit", "draft", resolution_px=(60, 80), set=changes)
    assert changed.gelpad_thickness_mm == 2.0 and changed.field_of_view_mm == (6.0, 8.0) and changed.is_flat
    assert not gelsim.Simulator("geltip", "draft", resolution_px=(32, 24)).is_flat


def test_a_simulator_is_pickled_as_it_was_made(gear):
    changes = {"camera": MappingProxyType({"exposure": np.float32(1.25)})}
    made = gelsim.Simulator("digit", "draft", resolution_px=(60, 80), set=MappingProxyType(changes))
    changes["camera"] = {"exposure": 3.0}
    image = made.press(gear, POSE).image
    for same in (pickle.loads(pickle.dumps(made)), copy.deepcopy(made)):
        assert np.array_equal(same.press(gear, POSE).image, image)


def test_a_sample_has_the_image_and_the_number_of_the_object(draft, gear):
    press = draft.press(gear, POSE)
    assert list(press.sample(["tactile", "instance"])) == ["tactile", "instance", "label"]
    assert np.array_equal(press.instance, press.contact // 255) and press.instance.any()


def test_a_soft_object_presses_less(high, gear):
    assert high.press(gear, POSE, youngs_modulus_kpa=20.0).force_n < 0.9 * high.press(gear, POSE).force_n


def test_a_sequence_by_hand_is_the_jobs(gear, objects, tmp_path):
    """What sticks, slips and rolls, image for image."""
    path = tmp_path / "sequence.toml"
    text = ONE_PRESS.format(preset="digit", width=90, height=120, tilt="", pattern="noise", lens=LENS) + SEQUENCE
    path.write_text(text.replace("OBJECTS", str(objects)))
    job, _ = warned(lambda: gelsim.Job.load(path, set={"texture.amplitude_mm": 0.0}))
    simulator = gelsim.Simulator("digit", resolution_px=(90, 120), set={**CAMERA, "markers.pitch_mm": 1.5})
    states = set()
    for index in range(2):
        theirs = job[index]
        simulator.reset(friction=0.4, index=index, seed=7)
        for number, (frame, label) in enumerate(zip(theirs["frames"], theirs["label"]["frames"], strict=True)):
            pose = label["pose"]
            ours = simulator.step(gear, gelsim.Placement(pose["translation_mm"], pose["quaternion_xyzw"]))
            where = (index, number, label["phase"])
            assert ours.frame == number, where
            # The rotation goes through the label's quaternion, which rounds: what lies between two levels may fall on
            # either. Within a frame the job rolls about another point.
            rolls = label["phase"] in ["roll", "lift", "touch"]
            off = np.abs(ours.image.astype(int) - frame["tactile"])
            assert off.max() <= 1 and (rolls or np.mean(off > 0) < 1e-3), where
            off = np.abs(ours.flow - frame["flow"]).max()
            assert off < (2e-2 if rolls else 4e-5), where
            assert np.mean(ours.slip != frame["slip"]) < (1e-3 if rolls else 1e-4), where
            for name in ["contact", "depth", "surface"]:
                off = np.abs(ours.sample()[name].astype(float) - frame[name]).mean()
                assert off < 0.02 * max(frame[name].max(), 1e-9), (where, name)
            force = label["wrench"]["force_n"]
            assert np.allclose(ours.wrench[:3], force, atol=(2e-3 if rolls else 1e-5) * max(1.0, -force[2])), where
            assert ours.slip_state == label["slip"]["state"], where
            states.add(ours.slip_state)
    assert states == {"none", "incipient", "gross"}


@pytest.fixture(scope="module")
def slider():
    return gelsim.Simulator("digit", "draft", resolution_px=(60, 80), flow=True)


def slide(simulator, friction, cylinder, indenter=None):
    """Presses and slides the cylinder, or what `indenter` makes of a press of it."""
    simulator.reset(friction=friction)
    found = []
    for number in range(8):
        pose = gelsim.Pose(0.4, x_mm=0.15 * max(0, number - 1))
        press = simulator.press(cylinder, pose)
        placement = gelsim.Placement(press.pose[:3], press.pose[3:])
        found.append(simulator.step(*((cylinder, pose) if indenter is None else (indenter(press), placement))))
    return found


@pytest.fixture(scope="module")
def slides(slider, cylinder):
    """By friction."""
    return {friction: slide(slider, friction, cylinder) for friction in [0.2, 0.8, None]}


def test_more_friction_pulls_more(slides):
    pull = {friction: press[-1].wrench[0] for friction, press in slides.items()}
    normal = -slides[0.2][-1].wrench[2]
    assert abs(pull[0.2] - 0.2 * normal) < 0.01 * normal
    assert pull[0.2] < pull[0.8] <= 0.8001 * normal and pull[0.8] < pull[None], pull
    assert [slides[friction][-1].slip_state for friction in [0.2, None]] == ["gross", "none"]


def test_heights_of_an_object_slide_as_its_mesh(slider, cylinder, slides):
    def heights_of(press):
        return np.where(press.depth > 0, press.depth, -np.inf).astype(np.float32)

    heights = slide(slider, 0.2, cylinder, heights_of)
    pull, _, normal = slides[0.2][-1].wrench[:3]
    assert abs(heights[-1].wrench[0] - pull) < 0.1 * -normal and heights[-1].slip_state == "gross"


def test_copies_step_each_their_sequence_in_threads(slider, cylinder, slides):
    with ThreadPoolExecutor(3) as threads:
        each = list(threads.map(lambda friction: slide(slider.copy(), friction, cylinder), slides))
    for friction, found in zip(slides, each, strict=True):
        for ours, theirs in zip(found, slides[friction], strict=True):
            same(ours.sample(), theirs.sample())


def test_a_sequence_that_begins_during_a_frame_is_not_lost_with_it(project):
    simulator = gelsim.Simulator("gelsight-mini", "high")
    ball = gelsim.Mesh.load(project / "objects/sphere.obj")

    def step():
        with contextlib.suppress(gelsim.RunError):
            simulator.step(ball, gelsim.Pose(0.5))

    for _ in range(50):
        simulator.reset()
        thread = threading.Thread(target=step)
        thread.start()
        time.sleep(0.02)
        try:
            simulator.step(ball, gelsim.Pose(0.5))
        except gelsim.RunError as error:
            assert "simulator.reset() begins another one" in str(error)
            simulator.reset()
            thread.join()
            assert simulator.step(ball, gelsim.Pose(0.5)).frame == 0
            return
        thread.join()
    pytest.fail("no two frames met")


def test_sensors_step_together_as_alone(slider, cylinder, slides):
    array = gelsim.Array([slider, "gelsight-mini", slider, slider], "draft", threads=2)
    assert len(array) == 4 and array[2] is not slider and array[1].fidelity == "draft" and "digit" in repr(array)
    frictions = list(slides)
    array.reset(seed=3)
    for number, friction in zip((0, 2, 3), frictions, strict=True):
        array[number].reset(friction=friction)
    for number in range(8):
        pose = gelsim.Pose(0.4, x_mm=0.15 * max(0, number - 1))
        poses = [pose, gelsim.Pose(0.2), pose, pose]
        # What cannot be pressed on one sensor changes none of them.
        said = refusal(gelsim.UsageError, lambda poses=poses: array.step(cylinder, [gelsim.Pose(9.0), *poses[1:3], gelsim.Pose(8.0)]))
        assert "sensor 0: " in said and "9.000 mm" in said and "sensor 3: " in said and "8.000 mm" in said, said
        said = refusal(gelsim.UsageError, lambda: array.step(cylinder, gelsim.Pose(9.0)))
        assert said.startswith("sensors 0, 1, 2, 3: ") and said.count("deep") == 2, said
        found = array.step([cylinder, BALL, cylinder, cylinder], poses)
        assert [press.frame for press in found] == [number] * 4
        for press, friction in zip((found[0], found[2], found[3]), frictions, strict=True):
            same(press.sample(), slides[friction][number].sample())


def test_sensors_of_an_array_have_noise_of_their_own(cylinder):
    noisy = gelsim.Simulator("digit", "draft", resolution_px=(60, 80), set={"camera.read_noise_levels": 2.0})
    array = gelsim.Array([noisy, noisy])
    for index, seed in [(0, 0), (5, 7)]:
        array.reset(index=index, seed=seed)
        left, right = array.step(cylinder, gelsim.Pose(0.4))
        assert not np.array_equal(left.image, right.image) and np.array_equal(left.depth, right.depth)
        alone = noisy.copy()
        alone.reset(index=index + 1, seed=seed)
        assert np.array_equal(right.image, alone.step(cylinder, gelsim.Pose(0.4)).image)


@pytest.mark.parametrize("change", [lambda array: array, copy.copy, copy.deepcopy, lambda array: pickle.loads(pickle.dumps(array))])
def test_equal_sensors_of_an_array_share_the_costly_part(cylinder, change):
    mini = gelsim.Simulator("gelsight-mini", "draft", set={"camera.exposure": 1.1})
    sensors = [gelsim.Sensor.preset("digit"), "digit", gelsim.Sensor.preset("digit", set={"camera.exposure": 1.1}), mini, mini.copy()]
    before = gelsim.Array(sensors, "draft", threads=1)
    before.step(cylinder, gelsim.Pose(0.3))
    array = change(before)
    kinds = [[array[k]._given is array[l]._given for l in range(5)].index(True) for k in range(5)]
    assert kinds == [0, 0, 2, 3, 3] and [simulator.fidelity for simulator in array] == ["draft"] * 5
    # A copy has sequences of its own.
    assert [press.frame for press in array.step(cylinder, gelsim.Pose(0.3))] == [int(array is before)] * 5
    assert before.step(cylinder, gelsim.Pose(0.3))[0].frame == 1 + int(array is before)


@pytest.fixture(scope="module")
def geltip():
    return gelsim.Simulator("geltip", "draft", resolution_px=(160, 120), flow=True)


GELTIP_RADIUS_MM, BALL_RADIUS_MM, DEPTH_MM = 11.485, 3.9982, 0.4


def beside(angle, down_mm=0.0, depth_mm=DEPTH_MM):
    """A ball, 8 mm wide with its origin at the bottom, at the side of a GelTip: at an angle about its axis, with its middle 16 mm
    below the tip's."""
    away_mm = GELTIP_RADIUS_MM + BALL_RADIUS_MM - depth_mm
    return gelsim.Placement((away_mm * np.cos(angle), away_mm * np.sin(angle), -20.0 - down_mm))


def about_z(angle, wrench):
    """A wrench turned about z."""
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    return np.concatenate([turn @ wrench[:3], turn @ wrench[3:]])


def test_an_object_may_be_at_the_side_of_a_fingertip(geltip):
    ball = gelsim.Mesh.load(BALL)
    first = geltip.press(ball, beside(0.0))
    assert first.in_contact and abs(first.label["indentation_depth_mm"] - DEPTH_MM) < 0.002 and first.wrench[0] < -0.1
    # Facets of the ball and of the grid differ from angle to angle.
    for angle in (0.5 * np.pi, 2.0, -2.5):
        press = geltip.press(ball, beside(angle))
        assert np.allclose(press.wrench, about_z(angle, first.wrench), atol=0.02 * np.abs(first.wrench).max()), angle
    gap = geltip.press(ball, beside(0.3, depth_mm=-0.1))
    assert not gap.in_contact and gap.label["indentation_depth_mm"] == 0.0
    said = refusal(gelsim.UsageError, lambda: geltip.press(ball, beside(1.0, depth_mm=2.6)))
    assert "2.5" in said and "2.6" in said, said


@pytest.mark.parametrize("angle", [0.0, 0.5 * np.pi, 2.0])
def test_an_object_slides_at_the_side_of_a_fingertip(geltip, angle):
    ball = gelsim.Mesh.load(BALL)
    for down_mm, around in ((0.1, 0.0), (0.0, 0.1 / GELTIP_RADIUS_MM)):
        geltip.reset(friction=0.4)
        for number in range(9):
            press = geltip.step(ball, beside(angle + around * number, down_mm * number))
        into, right, out = about_z(-angle - 8 * around, press.wrench)[:3] * [-1.0, 1.0, -1.0]
        pulls = {"down": out, "around": right}
        along = pulls.pop("down" if down_mm else "around")
        assert press.slip_state == "gross" and abs(along / into - 0.4) < 0.03, press.wrench
        assert abs(pulls.popitem()[1]) < 0.03 * into, press.wrench


def test_a_placement_at_the_tip_slides_as_a_pose(geltip):
    ball = gelsim.Mesh.load(BALL)
    slides = []
    for place in (lambda x: gelsim.Pose(DEPTH_MM, x_mm=x), lambda x: gelsim.Placement((x, 0.0, -DEPTH_MM))):
        geltip.reset(friction=0.4)
        slides.append([geltip.step(ball, place(0.05 * number)).wrench for number in range(9)])
    assert np.allclose(slides[0], slides[1], atol=0.03 * np.abs(slides[0]).max())


def seen_from_the_lens(place_mm, radius_mm):
    """Distances of a ball along the axis of a GelTip's lens, 45.5 mm below the tip, which sees 90 degrees of width; inf beside it."""
    x, y = [(np.arange(count) + 0.5 - count / 2) / 80 for count in (160, 120)]
    rays = np.stack([*np.meshgrid(x, y), np.ones((120, 160))], -1)
    from_mm = np.array([0.0, 0.0, -45.5]) - place_mm
    a, b, c = (rays**2).sum(-1), rays @ from_mm, from_mm @ from_mm - radius_mm**2
    return np.where(b**2 > a * c, (-b - np.sqrt(np.maximum(b**2 - a * c, 0.0))) / a, np.inf)


def test_depth_frames_of_a_camera_in_a_fingertip_slide_as_the_mesh(geltip):
    ball = gelsim.Mesh.load(BALL)
    frame = seen_from_the_lens(np.array([0.0, 0.0, 3.6]), 4.0)
    assert geltip.press(frame).in_contact
    pulls = []
    for with_frames in (False, True):
        geltip.reset(friction=0.3)
        for number in range(9):
            x = 0.08 * number
            place = gelsim.Placement((x, 0.0, -0.4))
            seen = seen_from_the_lens(np.array([x, 0.0, 3.6]), 4.0)
            press = geltip.step(seen if with_frames else ball, place)
        assert press.slip_state == "gross"
        pulls.append(press.wrench[:3])
    assert np.allclose(pulls[0], pulls[1], atol=0.1 * np.abs(pulls[0]).max()), pulls


def test_a_pad_that_relaxes_holds_with_less_force_the_longer_it_is_held(cylinder):
    relaxation = {"gelpad.relaxation": [{"share": 0.3, "time_s": 0.5}]}
    simulator = gelsim.Simulator("digit", "draft", resolution_px=(60, 80), set=relaxation)
    forces = []
    for duration_s in (0.0, 0.0, 0.5, 100.0):
        press = simulator.step(cylinder, gelsim.Pose(0.5), duration_s=duration_s)
        forces.append(-press.wrench[2])
    assert np.allclose(np.divide(forces, forces[0]), [1, 1, 1 - 0.3 * (1 - np.exp(-1)), 0.7], atol=2e-3), forces
    for bad in (-1.0, float("nan"), float("inf")):
        refusal(gelsim.UsageError, lambda bad=bad: simulator.step(cylinder, gelsim.Pose(0.5), duration_s=bad))


def test_a_step_that_cannot_be_leaves_the_sequence_as_it_is(slider, cylinder, slides):
    slider.reset(friction=0.2)
    for number in range(8):
        press = slider.step(cylinder, gelsim.Pose(0.4, x_mm=0.15 * max(0, number - 1)))
        refusal(gelsim.UsageError, lambda: slider.step(cylinder, gelsim.Pose(9.0)))
        turned = gelsim.Placement((0, 0, 0), (0, 0, 1, 1))
        refusal(gelsim.UsageError, lambda: slider.step(np.zeros((80, 60), np.float32), turned))
        refusal(gelsim.UsageError, lambda: slider.step(cylinder, gelsim.Pose(0.4, x_mm=1e100)))
        refusal(TypeError, lambda: slider.step(cylinder, None, texture="noise"))
        same(press.sample(), slides[0.2][number].sample())
    assert slider.step(cylinder, gelsim.Pose(-0.5)).slip_state == "none"


SHALLOW = gelsim.Pose(0.3)
CORNERS_MM, FACES = [(-3, -3, 2), (3, -3, 2), (0, 3, 2), (0, 0, 0)], [(3, 0, 1), (3, 1, 2), (3, 2, 0)]
PYRAMID = (CORNERS_MM, FACES)


def test_corners_that_are_no_numbers_go_with_their_triangles_and_a_warning(draft):
    holes = np.array([*CORNERS_MM, (np.nan, 0, 0)], float)
    mesh, said = warned(lambda: gelsim.Mesh(holes, [*FACES, (4, 0, 1)], name="holes"))
    assert mesh.triangles == 3 and len(said) == 1 and "holes" in said[0] and "not finite" in said[0], said
    assert np.array_equal(draft.press(mesh, SHALLOW).image, draft.press(PYRAMID, SHALLOW).image)


def test_a_mesh_that_looks_like_one_in_metres_is_warned_of_until_it_has_a_unit(draft, tmp_path):
    path = tmp_path / "pyramid.obj"
    corners = [f"v {x / 1e3} {y / 1e3} {z / 1e3}" for x, y, z in CORNERS_MM]
    path.write_text("\n".join([*corners, *(f"f {a + 1} {b + 1} {c + 1}" for a, b, c in FACES)]))
    _, said = warned(lambda: draft.press(path, SHALLOW))
    assert len(said) == 1 and "0.006 mm long; it looks like one in metres, 6 mm long" in said[0], said
    assert "gelsim.Mesh.load(path, mm_per_unit=1000)" in said[0] and "mm_per_unit=1)" in said[0]
    for unit, touches in [(1000, True), (1, False)]:
        press, said = warned(lambda unit=unit: draft.press(gelsim.Mesh.load(path, mm_per_unit=unit), SHALLOW))
        assert said == [] and bool(press.contact.any()) is touches
    _, said = warned(lambda: draft.press((np.array(CORNERS_MM) / 1e3, FACES), SHALLOW))
    assert len(said) == 1 and "gelsim.Mesh(1000 * vertices, faces)" in said[0], said


@pytest.mark.parametrize("way", ["press", "step"])
@pytest.mark.parametrize(
    "change, kind, words",
    [
        pytest.param(lambda bad: bad[:79], gelsim.UsageError, "resolution_px=(60, 79)", id="another size"),
        pytest.param(lambda bad: np.stack([bad, bad]), gelsim.UsageError, "Sensor.render takes several", id="batch"),
        pytest.param(lambda bad: bad + np.nan, gelsim.UsageError, "not a number", id="nan"),
        pytest.param(lambda bad: np.where(np.arange(60) > 30, np.inf, bad), gelsim.UsageError, "infinite", id="inf"),
        pytest.param(lambda bad: bad.astype(np.int32), TypeError, "depth_mm is int32", id="whole numbers"),
        pytest.param(lambda bad: bad.tolist(), TypeError, "an array of heights", id="list"),
        pytest.param(lambda bad: np.zeros((0, 0)), gelsim.UsageError, "empty", id="empty"),
        pytest.param(lambda bad: None, TypeError, "indenter is None", id="None"),
        pytest.param(lambda bad: (bad,), TypeError, "tuple of 1", id="tuple"),
    ],
)
def test_what_are_no_heights_is_refused(draft, way, change, kind, words):
    given = change(np.zeros((80, 60), np.float32))
    pose = [] if way == "press" else [gelsim.Placement((0, 0, 0))]
    assert_refused(lambda: getattr(draft, way)(given, *pose), kind, words)


def test_masked_arrays_are_no_meshes():
    corners, faces = np.array(CORNERS_MM, float), np.array(FACES)
    for given in [(np.ma.masked_array(corners), faces), (corners, np.ma.masked_array(faces))]:
        assert "masked array; leave out what is masked" in refusal(TypeError, lambda given=given: gelsim.Mesh(*given))


def test_what_is_far_from_the_pad_touches_nothing(draft):
    assert not draft.press(PYRAMID, gelsim.Pose(0.3, x_mm=1e4)).in_contact


def test_what_no_pixel_sees_is_no_mistake(draft):
    assert draft.press((np.array(CORNERS_MM) * 1e-6, FACES), SHALLOW).healthy


def mesh(vertices, faces=FACES):
    return lambda draft: draft.press((vertices, faces), SHALLOW)


def file(path):
    return lambda draft: draft.press(path, SHALLOW)


def press(indenter, *pose, **more):
    return lambda draft: draft.press(indenter, *pose, **more)


def simulator(*arguments, **more):
    return lambda draft: gelsim.Simulator(*arguments, **more)


def layer(name):
    return lambda draft: draft.press(PYRAMID, SHALLOW).sample([name])


def paper():
    return gelsim.Simulator("digit", "paper")


def fingertip():
    return gelsim.Simulator("geltip", "draft", resolution_px=(32, 24))


def strained():
    return gelsim.Simulator("digit", "finite-strain", set={"gelpad.finite_strain.friction": "stick"})


BALL = "objects/sphere.obj"
FLAT = np.zeros((80, 60), np.float32)
WRONG = {"friction": -1.0, "youngs_modulus_kpa": 0.0, "poisson_ratio": 1.0}
SOFT = {"youngs_modulus_kpa": 9.0}


@refusals({
    "empty lists": (mesh([], []), gelsim.UsageError, "vertices_mm has the shape"),
    "no corner": (mesh(np.zeros((0, 3)), np.zeros((0, 3), int)), gelsim.UsageError, "no vertex"),
    "no triangle": (mesh(CORNERS_MM, np.zeros((0, 3), int)), gelsim.UsageError, "no triangle"),
    "corners of nan": (mesh(np.full((4, 3), np.nan)), gelsim.UsageError, "finite"),
    "a point": (mesh(np.zeros((4, 3))), gelsim.UsageError, "without area"),
    "a huge mesh": (mesh(np.array(CORNERS_MM) * 1e9), gelsim.UsageError, "across"),
    "a corner past the end": (mesh(CORNERS_MM, [(0, 1, 4)]), gelsim.UsageError, "corners 0 to 4"),
    "a negative corner": (mesh(CORNERS_MM, [(0, 1, -1)]), gelsim.UsageError, "corners -1"),
    "corners that are no whole numbers": (mesh(CORNERS_MM, [(0.0, 1.0, 2.0)]), TypeError, "whole numbers"),
    "two corners": (mesh(CORNERS_MM, [(0, 1)]), gelsim.UsageError, "faces has the shape (1, 2)"),
    "four coordinates": (mesh(np.zeros((4, 4))), gelsim.UsageError, "(4, 4)"),
    "letters": (mesh([["a", "b", "c"]]), TypeError, "vertices_mm"),
    "text": (mesh("abc"), TypeError, "vertices_mm"),
    "ragged corners": (mesh([[1, 2, 3], [4, 5]]), TypeError, "vertices_mm"),
    "complex corners": (mesh(np.zeros((4, 3), complex)), TypeError, "vertices_mm"),
    "no arrays": (mesh(None, None), TypeError, "vertices_mm"),
    "an absent file": (file("absent.stl"), gelsim.UsageError, "absent.stl"),
    "a folder": (file("objects"), gelsim.UsageError, "mesh"),
    "a file without ending": (file("objects/gear"), gelsim.UsageError, "gear"),
    "a path with NUL": (file("a\0b"), gelsim.UsageError, "path"),
    "a long path": (file("x" * 9999), gelsim.UsageError, "path"),
    "heights with a pose": (press(FLAT, SHALLOW), gelsim.UsageError, "Placement"),
    "a mesh without a pose": (press(PYRAMID), gelsim.UsageError, "gelsim.Pose(0.5)"),
    "deeper than the pad": (press(PYRAMID, gelsim.Pose(4.5)), gelsim.UsageError, "4 mm"),
    "placed deeper than the pad": (press(PYRAMID, gelsim.Placement((0, 0, -5.0))), gelsim.UsageError, "4 mm"),
    "shear without flow": (press(PYRAMID, SHALLOW, shear=gelsim.Shear(0.1)), gelsim.UsageError, "flow=True"),
    "all mistakes at once": (press(PYRAMID, SHALLOW, **WRONG), gelsim.UsageError, ["friction is -1.0", *WRONG]),
    "frames of another size on a curved gel": (lambda _: gelsim.Simulator("geltip").press(FLAT + 45), gelsim.UsageError, "80 rows"),
    "no distances on a curved gel": (lambda _: fingertip().press(np.zeros((24, 32))), gelsim.UsageError, "distance from the lens"),
    "distances in metres": (lambda _: fingertip().press(np.full((24, 32), 0.045)), gelsim.UsageError, "distance from the lens"),
    "distances with a pose": (lambda _: fingertip().press(np.full((24, 32), 45.0), SHALLOW), gelsim.UsageError, "Placement"),
    "a soft object at the lowest level": (lambda _: paper().press(BALL, SHALLOW, **SOFT), gelsim.UsageError, "rigid"),
    "a sequence at the lowest level": (lambda _: paper().step(BALL, SHALLOW), gelsim.UsageError, "paper"),
    "a sequence at finite strain": (lambda _: strained().step(BALL, SHALLOW), gelsim.UsageError, "the frames of a sequence"),
    "a friction at finite strain": (lambda _: strained().press(BALL, SHALLOW, friction=0.5), gelsim.UsageError, "sticks"),
    "finite strain on a curved gel": (simulator("geltip", "finite-strain"), gelsim.UsageError, 'fidelity = "high"'),
    "no sensors": (lambda _: gelsim.Array([]), gelsim.UsageError, "there is none"),
    "one sensor for a list": (lambda _: gelsim.Array("digit"), TypeError, "a list of simulators"),
    "no threads": (lambda draft: gelsim.Array([draft], threads=0), gelsim.UsageError, "threads=0"),
    "poses for other sensors": (lambda draft: gelsim.Array([draft]).step(BALL, [SHALLOW] * 2), gelsim.UsageError, "for 1 sensor"),
    "objects for other sensors": (lambda draft: gelsim.Array([draft]).step([], SHALLOW), gelsim.UsageError, "there are 0"),
    "an array's step without a pose": (lambda draft: gelsim.Array([draft]).step(BALL, None), gelsim.UsageError, "needs a pose"),
    "a mistyped preset": (simulator("digti"), gelsim.UsageError, "did you mean `digit`?"),
    "an absent sensor": (simulator("absent.toml"), gelsim.UsageError, "absent.toml"),
    "no level": (simulator("digit", "fine"), gelsim.UsageError, "fidelity level"),
    "no pixels": (simulator("digit", resolution_px=(0, 80)), gelsim.UsageError, "resolution_px[0]"),
    "a mistyped key": (simulator("digit", set={"camera.expsoure": 1.0}), gelsim.UsageError, "camera.expsoure"),
    "a mistyped layer": (layer("detph"), gelsim.UsageError, "depth"),
    "a layer of other sensors": (layer("markers"), gelsim.UsageError, "no 'markers'"),
})  # fmt: skip
def test_is_refused_with_a_way_out(draft, monkeypatch, project, call, kind, words):
    monkeypatch.chdir(project)
    assert_refused(lambda: call(draft), kind, words)
