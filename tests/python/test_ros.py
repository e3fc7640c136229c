"""The ROS node without a graph: what messages say, what is felt, what is dropped and refused; and its half of ROS 2 with a stand-in
of rclpy (`ros_stand_in.py`). `test_ros_graph.py` runs it in a real graph of ROS 1.
"""

import array
import ast
import importlib.util
import re
import subprocess
import sys
import threading
import types
from dataclasses import fields

import pytest

gelsim = pytest.importorskip("gelsim", reason="the module is not installed: pip install .")

import numpy as np
import ros_stand_in
from gelsim.ros import command, messages
from gelsim.ros.node import Node
from gelsim.ros.parameters import Parameters
from gelsim.ros.touch import MARKER_FIELDS, Touch, between
from module_checks import refusal
from processes import wait
from ros_stand_in import MESSAGES

pytestmark = pytest.mark.wheel

Image, CameraInfo = MESSAGES["sensor_msgs.msg"]["Image"], MESSAGES["sensor_msgs.msg"]["CameraInfo"]
PoseStamped = MESSAGES["geometry_msgs.msg"]["PoseStamped"]


def image(depth, encoding="32FC1", **others):
    """A depth image of what is in the array already."""
    height, width = depth.shape
    data = array.array("B", depth.tobytes())
    return Image(**{"height": height, "width": width, "encoding": encoding, "step": len(data) // height, "data": data, **others})


def pose(x_mm, z_mm, sec=0, frame_id="pad", w=1.0):
    """A pose of what does not turn."""
    said = PoseStamped()
    said.header.frame_id, said.header.stamp.sec = frame_id, sec
    said.pose.position.x, said.pose.position.z, said.pose.orientation.w = 1e-3 * x_mm, 1e-3 * z_mm, w
    return said


def grid(sensor, size):
    """x and y of the centres of an image's pixels, mm."""
    sides = [((np.arange(count) + 0.5) / count - 0.5) * mm for count, mm in zip(size, sensor.field_of_view_mm)]
    return np.meshgrid(*sides)


def ball_mm(rays, middle, radius):
    """Distance along the axis at which rays (x, y, 1) meet a ball, or inf."""
    square, along = (rays**2).sum(-1), rays @ middle
    root = along**2 - square * (middle @ middle - radius**2)
    return np.where(root < 0, np.inf, (along - np.sqrt(np.maximum(root, 0))) / square).astype(np.float32)


class TestDepthImages:
    VALUES = np.array([[0.01, 0.02, np.inf], [np.nan, 0.5, 1e-4]], np.float32)
    EXPECTED = np.array([[10, 20, np.inf], [np.inf, 500, 0.1]], np.float32)

    @pytest.mark.parametrize("order", ["<", ">"])
    def test_in_metres_are_read_in_either_order_of_bytes(self, order):
        said = image(self.VALUES.astype(order + "f4"), is_bigendian=int(order == ">"))
        assert np.allclose(messages.depth_mm(said), self.EXPECTED, rtol=1e-6)

    def test_may_have_rows_that_are_longer_than_their_pixels(self):
        rows = np.zeros((2, 20), np.uint8)
        rows[:, :12] = self.VALUES.view(np.uint8)
        said = Image(height=2, width=3, encoding="32FC1", step=20, data=array.array("B", rows.tobytes()))
        assert np.allclose(messages.depth_mm(said), self.EXPECTED, rtol=1e-6)

    def test_in_millimetres_have_0_where_nothing_is(self):
        said = image(np.array([[10, 0, 65535]], np.uint16), "16UC1")
        assert messages.depth_mm(said).tolist() == [[10.0, np.inf, 65535.0]]

    @pytest.mark.parametrize(
        "changes, words",
        [
            ({"encoding": "rgb8"}, "publish 32FC1"),
            ({"encoding": "8UC1"}, "publish 32FC1"),
            ({"step": 4}, "a row of 3 px in 32FC1 12"),
            ({"step": 16}, "2 rows of 16 bytes are 32"),
            ({"height": 3}, "3 rows of 12 bytes are 36"),
            ({"height": 0}, "3x0 px"),
            ({"width": 10_000}, "a side has 1 to 8192"),
            ({"data": array.array("B")}, "0 bytes of data"),
            ({"data": array.array("B", np.full(6, -np.inf, np.float32).tobytes())}, "near plane"),
            ({"data": array.array("B", np.full(6, -0.1, np.float32).tobytes())}, "0 or less"),
            ({"data": array.array("B", bytes(24))}, "0 or less"),
        ],
        ids=lambda given: next(iter(given)) if isinstance(given, dict) else "",
    )
    def test_that_cannot_be_right_are_refused(self, changes, words):
        said = image(self.VALUES)
        for name, value in changes.items():
            setattr(said, name, value)
        assert words in refusal(messages.Refused, lambda: messages.depth_mm(said))


class TestCameras:
    @staticmethod
    def info(size=(320, 240), focal=300.0, middle=(159.5, 119.5), d=()):
        return CameraInfo(width=size[0], height=size[1], d=list(d), k=ros_stand_in.Nine([focal, 0.0, middle[0], 0.0, focal, middle[1], 0.0, 0.0, 1.0]))

    @pytest.mark.parametrize("middle", [(159.5, 119.5), (160.0, 120.0), (160.5, 120.5)], ids=["OpenCV's", "gz-sim's", "Gazebo's"])
    def test_of_simulators_look_along_the_middle(self, middle):
        found = messages.pinhole(self.info(middle=middle))
        assert found.middle_px == (159.5, 119.5)
        assert messages.Pinhole.of_angle(found.fov_y_deg, (320, 240)).focal_px == pytest.approx((300.0, 300.0))

    def test_may_look_elsewhere_but_not_inside_a_curved_gel(self):
        found = messages.pinhole(self.info(middle=(100.0, 119.5)))
        assert found.middle_px == (100.0, 119.5)
        assert "principal point" in refusal(messages.Refused, lambda: found.fov_y_deg)

    @pytest.mark.parametrize("changes, words", [({"focal": 0.0}, "not calibrated"), ({"focal": np.nan}, "not calibrated"), ({"d": [0.1]}, "rectified")])
    def test_that_say_nothing_of_use_are_refused(self, changes, words):
        assert words in refusal(messages.Refused, lambda: messages.pinhole(self.info(**changes)))

    def test_of_ros_1_have_capital_letters(self):
        said = types.SimpleNamespace(width=320, height=240, D=[], K=self.info().k)
        assert messages.pinhole(said) == messages.pinhole(self.info())


class TestFrames:
    SIZE = (160, 120)

    def test_of_a_pinhole_give_the_image_of_parallel_rays(self):
        flat = Touch(Parameters(plane_mm=25.0))
        seen = Touch(Parameters(plane_mm=25.0, projection="perspective", resolution="160x120"))
        x, y = grid(gelsim.Sensor.preset("gelsight-mini"), self.SIZE)
        camera = messages.Pinhole((640, 480), (700.0, 690.0), (300.0, 260.0))
        column, row = np.meshgrid(*map(np.arange, camera.size_px))
        rays = [(at - middle) / focal for at, middle, focal in zip((column, row), camera.middle_px, camera.focal_px)]
        rays = np.dstack([*rays, np.ones_like(rays[0])])
        exact, frame = np.full(x.shape, np.inf, np.float32), np.full(column.shape, np.inf, np.float32)
        for (at, down, away), radius in [((3.0, -1.5, 28.2), 4.0), ((-4.0, 2.0, 27.5), 3.0)]:
            rest = radius**2 - (x - at) ** 2 - (y - down) ** 2
            exact = np.minimum(exact, np.where(rest > 0, away - np.sqrt(np.maximum(rest, 0)), np.inf)).astype(np.float32)
            frame = np.minimum(frame, ball_mm(rays, np.array([at, down, away]), radius))
        one, other = flat.feel_frame(exact, None), seen.feel_frame(frame, camera)
        assert np.abs(one.image.astype(int) - other.image).max() <= 3 and one.image.std() > 5
        assert other.force_n == pytest.approx(one.force_n, rel=2e-3) and one.force_n[2] < -0.5
        assert np.isnan(one.torque_nm).all() and one.slip is None and one.markers is None

    def test_beyond_the_camera_nothing_is_seen(self):
        touch = Touch(Parameters(plane_mm=25.0, projection="perspective", resolution="64x48", fidelity="draft"))
        wall = np.full((48, 64), 24.5, np.float32)
        narrow, wide = (touch.feel_frame(wall, messages.Pinhole.of_angle(angle, (64, 48))).force_n[2] for angle in (5.0, 60.0))
        assert narrow < 0 and np.isnan(wide), "what reaches the border may go on there"

    def test_of_another_size_than_the_camera_are_refused(self):
        touch = Touch(Parameters(plane_mm=25.0, projection="perspective", fidelity="draft"))
        frame, camera = np.full((48, 64), 30.0, np.float32), messages.Pinhole.of_angle(40.0, (640, 480))
        assert "640x480" in refusal(messages.Refused, lambda: touch.feel_frame(frame, camera))

    def test_inside_a_curved_gel_are_those_of_the_sensor(self):
        touch, sensor = Touch(Parameters(sensor="geltip", projection="perspective", fidelity="draft")), gelsim.Sensor.preset("geltip")
        frame = np.full((120, 160), np.inf, np.float32)
        frame[45:75, 65:95] = 45.0
        felt = touch.feel_frame(frame, messages.Pinhole.of_angle(60.0, (160, 120)))
        sample = sensor.render(frame, fidelity="draft", fov_y_deg=60.0)
        assert np.array_equal(felt.image, sample["tactile"])
        assert felt.force_n == sample["label"]["contact"]["force_vector_n"] and felt.force_n[2] < 0
        assert felt.torque_nm == pytest.approx([1e-3 * each for each in sample["label"]["contact"]["torque_nmm"]])

    @pytest.mark.parametrize("given", [{"sensor": "gelsight-mini", "set": "markers.pitch_mm=1.5"}, {"sensor": "tactip"}], ids=["dots", "pins"])
    def test_give_markers_where_they_are(self, given):
        is_flat = given["sensor"] != "tactip"
        touch = Touch(Parameters(**given, fidelity="draft", plane_mm=10.0 if is_flat else 0.0))
        assert touch.is_flat == is_flat and touch.has_markers
        sensor = gelsim.Sensor.preset(given["sensor"])
        width, height = size = sensor.resolution_px
        cloud = touch.feel_frame(np.full((height, width), np.inf, np.float32), None).markers
        assert cloud.dtype == np.float32 and cloud.shape[1] == len(MARKER_FIELDS) and len(cloud) > 50
        assert np.isfinite(cloud).all() and np.allclose(cloud[:, 3:5], cloud[:, 5:7], atol=1e-3)
        if is_flat:
            across = [mm / px for mm, px in zip(sensor.field_of_view_mm, size)]
            inside = (cloud[:, 3:5] > 1).all(1) & (cloud[:, 3:5] < np.array(size) - 1).all(1)
            at_mm = (cloud[inside, 3:5] - np.array(size) / 2) * across
            assert np.allclose(1e3 * cloud[inside, :2], at_mm, atol=1e-3) and np.allclose(cloud[:, 2], 0)


def test_an_image_is_mixed_between_pixels_and_not_with_what_is_infinite():
    plane = np.add.outer(10 * np.arange(3.0), np.arange(4.0)).astype(np.float32)
    assert between(plane, np.array([[0.5, 0.25], [9.0, -3.0], [2.0, 1.0]])).tolist() == [3.0, 3.0, 12.0]
    plane[0, 1] = np.inf
    assert between(plane, np.array([[0.4, 0.0], [0.6, 0.0], [2.5, 0.5]])).tolist() == [0.0, np.inf, 7.5]
    points = np.dstack([plane, -plane])
    assert between(points, np.array([[2.5, 0.5]])).tolist() == [[7.5, -7.5]]


class TestPoses:
    def test_give_what_steps_of_a_simulator_give(self, project):
        ball = str(project / "objects/sphere.obj")
        touch = Touch(Parameters(mesh=ball, fidelity="draft", resolution="80x60", friction=0.4, seed=3))
        simulator, mesh = gelsim.Simulator("gelsight-mini", "draft", resolution_px=(80, 60)), gelsim.Mesh.load(ball)
        slips = []
        for _ in range(2):
            simulator.reset(friction=0.4, seed=3)
            touch.begin()
            for k in range(6):
                place = gelsim.Placement((0.3 * k, 0.0, -0.6))
                felt, press = touch.feel_pose(place, 100.0 + k), simulator.step(mesh, place)
                assert np.array_equal(felt.image, press.image)
                assert felt.force_n == list(press.wrench[:3]) and felt.torque_nm == pytest.approx(1e-3 * press.wrench[3:])
                slips.append(felt.slip)
        assert slips[0] == slips[6] == "none" and slips[5] == slips[11] == "gross"

    def test_begin_anew_when_time_runs_back(self, project):
        touch = Touch(Parameters(mesh=str(project / "objects/sphere.obj"), fidelity="draft", resolution="80x60"))
        at = lambda x, s: touch.feel_pose(gelsim.Placement((x, 0.0, -0.6)), s)
        first = at(0.0, 5.0)
        assert at(1.5, 6.0).slip == "gross"
        again = at(0.0, 1.0)
        assert again.slip == "none" and again.force_n == first.force_n

    def test_may_be_single(self, project):
        ball = str(project / "objects/sphere.obj")
        touch = Touch(Parameters(mesh=ball, single=True, fidelity="finite-strain", resolution="40x30", mm_per_unit=0.5))
        felt = touch.feel_pose(gelsim.Placement((0.0, 0.0, -0.3)), 0.0)
        press = gelsim.Simulator("gelsight-mini", "finite-strain", resolution_px=(40, 30)).press(
            gelsim.Mesh.load(ball, mm_per_unit=0.5), gelsim.Placement((0.0, 0.0, -0.3))
        )
        assert np.array_equal(felt.image, press.image) and felt.slip is None and not touch.follows

    def test_of_another_frame_are_refused(self):
        assert messages.placement(pose(1.0, -0.5), "").translation_mm == (1.0, 0.0, -0.5)
        assert messages.placement(pose(1.0, -0.5, frame_id="/pad"), "pad").translation_mm == (1.0, 0.0, -0.5)
        assert "transform it" in refusal(messages.Refused, lambda: messages.placement(pose(1.0, -0.5), "world"))


class Recorded:
    """What a node says and publishes."""

    def __init__(self):
        self.said, self.published, self.statuses, self.changed = [], [], [], threading.Condition()

    def note(self, where, what):
        with self.changed:
            where.append(what)
            self.changed.notify_all()

    def publish(self, header, frame_id, felt):
        self.note(self.published, (header.stamp.sec, frame_id, felt))

    def publish_status(self, status):
        self.note(self.statuses, status)

    def say(self, level, text):
        self.note(self.said, (level, text))

    def wait(self, condition):
        with self.changed:
            assert self.changed.wait_for(condition, 60), (self.said, self.published)


class Slow:
    """Feels what it is given when the test lets it, or fails."""

    takes_poses = True

    def __init__(self, **given):
        self.parameters, self.began, self.go, self.stopped = Parameters(**given), 0, threading.Semaphore(0), threading.Semaphore(0)

    def begin(self):
        self.began += 1

    def feel_pose(self, place, stamp_s):
        self.stopped.release()
        assert self.go.acquire(timeout=60)
        return place.translation_mm


@pytest.fixture
def running():
    """A slow node, and what it says."""
    touch, graph = Slow(report_s=3600.0), Recorded()
    node = Node(touch, graph)
    node.start()
    yield touch, graph, node
    touch.go.release()
    node.stop()


class TestNode:
    def test_answers_the_latest_and_counts_what_it_drops(self, running):
        touch, graph, node = running
        node.take(pose(0.0, 0.0, sec=0))
        assert touch.stopped.acquire(timeout=60)
        for sec in range(1, 6):
            node.take(pose(1.0, 0.0, sec=sec))
        touch.go.release(2)
        graph.wait(lambda: len(graph.published) == 2)
        assert [(sec, frame) for sec, frame, _ in graph.published] == [(0, "pad"), (5, "pad")]
        status = node._tally.report()
        assert status.values["came since the start"] == "6" and status.values["dropped"] == "4" and not status.is_well

    def test_drops_what_waits_when_it_begins_anew(self, running):
        touch, graph, node = running
        node.take(pose(0.0, 0.0, sec=0))
        assert touch.stopped.acquire(timeout=60)
        node.take(pose(1.0, 0.0, sec=1))
        resetting = threading.Thread(target=node.reset)
        resetting.start()
        wait(lambda: node._latest is None, "reset")
        assert touch.began == 0, "in the middle of a pose"
        touch.go.release(2)
        resetting.join(60)
        assert touch.began == 1
        node.take(pose(2.0, 0.0, sec=2))
        graph.wait(lambda: len(graph.published) == 2)
        assert [sec for sec, _, _ in graph.published] == [0, 2]

    def test_says_a_cause_once_and_goes_on(self, running):
        touch, graph, node = running
        touch.go.release(100)
        wrong = [pose(np.nan, 0.0), pose(0.0, np.inf), pose(0.0, 0.0, w=0.0), types.SimpleNamespace(header=None), None]
        for number, each in enumerate(wrong * 3):
            node.take(each)
            wait(lambda: node._tally._counts["refused"] == number + 1, "refusal")
        node.take(pose(0.0, 0.0, sec=9))
        graph.wait(lambda: graph.published)
        assert [level for level, _ in graph.said] == ["error"] * 5, graph.said
        assert all(word in str(graph.said) for word in ["translation_mm", "quaternion_xyzw", "AttributeError"])

    def test_reports_how_it_goes_and_silence_once(self):
        touch, graph = Slow(report_s=0.1), Recorded()
        touch.go.release(100)
        node = Node(touch, graph)
        node.start()
        node.take(pose(0.0, 0.0))
        graph.wait(lambda: len(graph.statuses) >= 5)
        node.stop()
        assert [text for _, text in graph.said[1:]] == ["nothing comes"] and "dropped 0" in graph.said[0][1]
        assert graph.statuses[0].is_well and not graph.statuses[-1].is_well


class TestParameters:
    @pytest.mark.parametrize(
        "given, words",
        [
            ({"projection": "fisheye", "plane_mm": -1.0, "friction": 11.0}, ["projection", "plane_mm", "friction"]),
            ({"resolution": "320"}, ["WIDTHxHEIGHT"]),
            ({"fov_y_deg": 40.0}, ["projection = perspective"]),
            ({"plane_mm": "10"}, ["plane_mm"]),
            ({"plane_mm": float("nan")}, ["plane_mm"]),
            ({"seed": True}, ["seed"]),
            ({"single": 1}, ["single"]),
            ({"sensor": None}, ["sensor"]),
        ],
        ids=str,
    )
    def test_that_cannot_be_right_are_refused(self, given, words):
        said = refusal(gelsim.UsageError, lambda: Parameters(**given))
        assert all(word in said for word in words), said

    def test_take_numbers_as_launch_files_write_them(self):
        assert Parameters(plane_mm=10, frame_id=7) == Parameters(plane_mm=10.0, frame_id="7")

    @pytest.mark.parametrize(
        "given, words",
        [
            ({}, "plane_mm is missing"),
            ({"sensor": "tactip", "plane_mm": 10.0}, "leave plane_mm out"),
            ({"plane_mm": 10.0, "resolution": "320x240"}, "leave resolution out"),
            ({"plane_mm": 10.0, "fidelity": "best"}, "best"),
            ({"sensor": "mini", "plane_mm": 10.0}, "mini"),
            ({"sensor": "none.toml", "plane_mm": 10.0}, "none.toml"),
            ({"set": "camera.exposure=-1", "plane_mm": 10.0}, "exposure"),
            ({"mesh": "none.stl"}, "none.stl"),
            ({"mesh": "BALL", "fidelity": "paper"}, "paper"),
        ],
        ids=str,
    )
    def test_that_do_not_fit_the_sensor_are_refused_at_the_start(self, project, given, words):
        given = {name: str(project / "objects/sphere.obj") if value == "BALL" else value for name, value in given.items()}
        assert words in refusal(gelsim.UsageError, lambda: Touch(Parameters(**given)))

    def test_are_all_in_the_docs(self, project):
        rows = re.findall(r"(?m)^\| `([a-z_]+)` \|", (project / "docs/how-to/ros.md").read_text())
        assert rows[: len(fields(Parameters))] == [each.name for each in fields(Parameters)]

    @pytest.mark.parametrize("name", ["gelsim_ros/two_fingers.launch", "two_fingers.launch.py"])
    def test_of_launch_files_are_there(self, project, name):
        text = (project / "docs/examples/ros" / name).read_text()
        told = re.findall(r'<param name="(\w+)"' if name.endswith("launch") else r'"--([\w-]+)"', text)
        known = {each.name for each in fields(Parameters)} | {"ros-args"}
        assert told and {each.replace("-", "_") if each != "ros-args" else each for each in told} <= known


def test_without_ros_the_command_says_what_to_install(tmp_path):
    if importlib.util.find_spec("rospy") or importlib.util.find_spec("rclpy"):
        pytest.skip("ROS is here")
    done = subprocess.run([sys.executable, "-m", "gelsim.ros", "--plane-mm", "10"], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 2 and "apt install python3-rospy" in done.stderr and "Traceback" not in done.stderr
    assert subprocess.run([sys.executable, "-m", "gelsim.ros", "--help"], capture_output=True).returncode == 0


def as_defined(store, name, said):
    """A message of the stand-in as the type that ROS itself defines, with nothing in fields that the stand-in lacks."""
    defined = dict(store.fielddefs[name][1])
    assert said is None or set(vars(said)) <= set(defined), name
    values = {}
    for field, (kind, detail) in defined.items():
        given = getattr(said, field, None)
        if kind.name == "NAME":
            values[field] = as_defined(store, detail, given)
        elif kind.name == "SEQUENCE" and detail[0][0].name == "NAME":
            values[field] = [as_defined(store, detail[0][1], each) for each in given]
        elif kind.name in ("SEQUENCE", "ARRAY"):
            values[field] = np.array(given or np.zeros(detail[1]), {"octet": "uint8"}.get(detail[0][1][0], detail[0][1][0]))
        else:
            nothing = {"string": "", "bool": False}.get(detail[0], 0)
            values[field] = nothing if given is None else given[0] if isinstance(given, bytes) else given
    return store.types[name](**values)


class TestRos2:
    """With the stand-in."""

    def test_frames_are_answered_and_what_is_wrong_is_survived(self, monkeypatch):
        graph = ros_stand_in.graph(monkeypatch)
        graph.parameters = {"plane_mm": 10, "frame_id": "left_pad", "set": "markers.pitch_mm=1.5", "report_s": 0.2}

        def play(node):
            assert list(node.subscriptions) == ["depth"]
            node.subscriptions["depth"](image(np.zeros((1, 1), np.uint8), "rgb8"))
            frame = np.full((48, 64), np.inf, np.float32)
            frame[20:30, 20:40] = 0.0095
            said = image(frame)
            said.header.stamp.sec, said.header.frame_id = 12, "camera"
            wait(lambda: any(said[0] == "error" for said in graph.said), "refusal")
            node.subscriptions["depth"](said)
            graph.wait(4)

        graph.play = play
        assert command.main(["--fidelity", "draft", "--ros-args", "-r", "depth:=/cam"]) == 0
        found = dict(graph.published)
        assert list(found)[:3] == ["~/image", "~/wrench", "~/markers"] and "/diagnostics" in found
        assert all(found[name].header.stamp.sec == 12 for name in ("~/image", "~/wrench", "~/markers"))
        seen, wrench, cloud = found["~/image"], found["~/wrench"], found["~/markers"]
        assert (seen.height, seen.width, seen.step, len(seen.data), seen.encoding) == (48, 64, 192, 48 * 192, "rgb8")
        assert wrench.header.frame_id == "left_pad" and wrench.wrench.force.z < 0
        assert [(field.name, field.offset) for field in cloud.fields] == [(name, 4 * k) for k, name in enumerate(MARKER_FIELDS)]
        assert len(cloud.data) == cloud.row_step == cloud.width * cloud.point_step and cloud.width > 50
        assert [level for level, _ in graph.said].count("error") == 1
        (status,) = found["/diagnostics"].status
        assert status.name == "/gelsim" and "refused" in status.message
        self.survive_the_wire(found)

    @staticmethod
    def survive_the_wire(found):
        """The messages are as ROS 2 defines them, and are the same after its encoding (CDR)."""
        typesys = pytest.importorskip("rosbags.typesys", reason="no definitions of ROS 2: pip install rosbags")
        store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
        names = {
            "~/image": "sensor_msgs/msg/Image",
            "~/wrench": "geometry_msgs/msg/WrenchStamped",
            "~/markers": "sensor_msgs/msg/PointCloud2",
            "~/slip": "std_msgs/msg/String",
            "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
        }
        for topic, said in found.items():
            whole = as_defined(store, names[topic], said)
            data = bytes(store.serialize_cdr(whole, names[topic]))
            come = store.deserialize_cdr(data, names[topic])
            assert bytes(store.serialize_cdr(come, names[topic])) == data and repr(come) == repr(whole)

    def test_what_comes_is_read_as_ros_2_defines_it(self):
        typesys = pytest.importorskip("rosbags.typesys", reason="no definitions of ROS 2: pip install rosbags")
        store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)

        def come(name, said):
            return store.deserialize_cdr(bytes(store.serialize_cdr(as_defined(store, name, said), name)), name)

        said = image(TestDepthImages.VALUES)
        said.header.stamp.sec, said.header.stamp.nanosec = 12, 500_000_000
        seen = come("sensor_msgs/msg/Image", said)
        assert messages.stamp_s(seen) == 12.5 and np.allclose(messages.depth_mm(seen), TestDepthImages.EXPECTED, rtol=1e-6)
        assert messages.pinhole(come("sensor_msgs/msg/CameraInfo", TestCameras.info())) == messages.pinhole(TestCameras.info())
        placed = messages.placement(come("geometry_msgs/msg/PoseStamped", pose(1.5, -0.5)), "pad")
        assert placed == gelsim.Placement((1.5, 0.0, -0.5))

    def test_poses_slip_and_begin_anew(self, monkeypatch, project):
        graph = ros_stand_in.graph(monkeypatch)
        slips = []

        def play(node):
            for k, x_mm in enumerate([0.0, 1.5, 1.5]):
                if k == 2:
                    answer = node.services["~/reset"]()
                    assert answer.success and answer.message
                node.subscriptions["pose"](pose(x_mm, -0.6, sec=k))
                graph.wait(3 * (k + 1))
                slips.append(graph.published[-1][1].data)

        graph.play = play
        ball = str(project / "objects/sphere.obj")
        assert command.main(["--mesh", ball, "--fidelity", "draft", "--resolution", "80x60", "--report-s", "3600"]) == 0
        assert slips == ["none", "gross", "none"] and {name for name, _ in graph.published} == {"~/image", "~/wrench", "~/slip"}
        self.survive_the_wire(dict(graph.published))

    def test_a_camera_says_how_it_sees(self, monkeypatch):
        graph = ros_stand_in.graph(monkeypatch)

        def play(node):
            node.subscriptions["camera_info"](TestCameras.info(size=(64, 48), focal=60.0, middle=(32.0, 24.0)))
            node.subscriptions["depth"](image(np.full((48, 64), np.inf, np.float32)))
            graph.wait(2)

        graph.play = play
        assert command.main(["--projection", "perspective", "--plane-mm", "25", "--resolution", "80x60", "--fidelity", "draft"]) == 0
        assert (graph.published[0][1].width, graph.published[0][1].height) == (80, 60)

    def test_mistakes_end_it_with_status_2(self, monkeypatch, capsys):
        ros_stand_in.graph(monkeypatch)
        assert command.main([]) == 2 and "plane_mm is missing" in capsys.readouterr().err

    def test_the_launch_file_starts_it_for_two_fingers(self, monkeypatch, project):
        started = []
        launch = types.ModuleType("launch")
        launch.LaunchDescription = list
        actions = types.ModuleType("launch.actions")
        actions.ExecuteProcess = lambda *, cmd, output: started.append(cmd)
        monkeypatch.setitem(sys.modules, "launch", launch)
        monkeypatch.setitem(sys.modules, "launch.actions", actions)
        space = {}
        exec((project / "docs/examples/ros/two_fingers.launch.py").read_text(), space)
        assert len(space["generate_launch_description"]()) == 2
        for line in started:
            assert line[:3] == ["python3", "-m", "gelsim.ros"] and "--ros-args" in line
            known = command.parser().parse_args(line[3 : line.index("--ros-args")])
            assert Touch(Parameters(**vars(known))).is_flat
        assert len({tuple(line) for line in started}) == 2


def test_no_module_of_the_node_imports_ros_by_itself(project):
    for path in (project / "python/gelsim/ros").glob("*.py"):
        imports = [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, (ast.Import, ast.ImportFrom))]
        names = {name for node in imports for name in ([node.module] if isinstance(node, ast.ImportFrom) else [each.name for each in node.names])}
        assert not any(re.match(r"(rospy|rclpy|rosgraph|\w+_(msgs|srvs|interfaces))\b", name or "") for name in names), path
