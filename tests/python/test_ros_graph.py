"""The ROS node in a real graph of ROS 1, with Debian's rospy, roscore, roslaunch and tools.

    apt install python3-rospy python3-roslaunch python3-rostopic python3-rosservice python3-sensor-msgs python3-std-srvs \\
        python3-diagnostic-msgs python3-numpy
    pytest tests/python/test_ros_graph.py --full -rP

prints rates, drops and latencies of a sensor of 320x240 px at 60 Hz, with the node on one core.
"""

import json
import os
import pathlib
import re
import shutil
import signal
import socket
import subprocess
import time

import pytest

gelsim = pytest.importorskip("gelsim", reason="the module is not installed: pip install .")

from processes import descendants, kill, wait

pytestmark = [pytest.mark.full, pytest.mark.wheel]

HERE = pathlib.Path(__file__).parent
PYTHON = "/usr/bin/python3"
NEEDED = "import numpy, rospy, rosgraph, roslaunch, rostopic, rosservice, sensor_msgs.msg, std_srvs.srv, diagnostic_msgs.msg"


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    """Variables of a graph of its own, on loopback, in which Debian's Python has the module under test."""
    if not shutil.which(PYTHON) or subprocess.run([PYTHON, "-c", NEEDED], capture_output=True).returncode:
        pytest.skip("no rospy: apt install python3-rospy python3-roslaunch python3-rostopic, and the others of this file's head")
    folder = tmp_path_factory.mktemp("ros")
    (folder / "modules").mkdir()
    (folder / "modules/gelsim").symlink_to(pathlib.Path(gelsim.__file__).parent)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    names = {"ROS_MASTER_URI": f"http://127.0.0.1:{port}", "ROS_IP": "127.0.0.1", "ROS_HOME": str(folder / "home")}
    path = f"/usr/bin:{os.environ['PATH']}"
    packages = {"ROS_PACKAGE_PATH": str(HERE.parents[1] / "docs/examples/ros"), "ROS_PYTHON_VERSION": "3"}
    return {**os.environ, **names, **packages, "PYTHONPATH": str(folder / "modules"), "PATH": path, "PYTHONUNBUFFERED": "1"}


class Started:
    """A program that runs, and what it prints."""

    def __init__(self, line, environment, log):
        self.log = log
        with log.open("w") as out:
            self.process = subprocess.Popen([*map(str, line)], env=environment, stdout=out, stderr=subprocess.STDOUT, start_new_session=True)

    @property
    def text(self):
        return self.log.read_text()

    def says(self, words):
        wait(lambda: words in self.text or self.process.poll() is not None, words)
        assert words in self.text, self.text
        return self

    def end(self):
        """Ends it as Ctrl-C does, with what it started. Returns its exit status."""
        below = descendants(self.process.pid)
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
            try:
                self.process.wait(30)
            except subprocess.TimeoutExpired:
                self.process.kill()
        kill(below)
        return self.process.wait()


@pytest.fixture
def start(environment, tmp_path):
    """Starts programs; they end with the test."""
    started = []

    def begin(*line):
        started.append(Started(line, environment, tmp_path / f"{len(started)}.log"))
        return started[-1]

    yield begin
    for each in reversed(started):
        each.end()


@pytest.fixture
def core(start, environment):
    """A roscore."""
    port = environment["ROS_MASTER_URI"].rpartition(":")[2]
    return start("roscore", "-p", port).says("started core service")


@pytest.fixture
def run(environment):
    """Runs a program to its end, and gives what it printed."""

    def finish(*line, timeout=120):
        done = subprocess.run([*map(str, line)], env=environment, capture_output=True, text=True, timeout=timeout)
        assert done.returncode == 0, f"{line}\n{done.stdout}\n{done.stderr}"
        return done.stdout

    return finish


@pytest.fixture
def peer(run):
    """Runs `ros_peer.py`, and gives what it prints."""
    return lambda *line, **given: json.loads(run(PYTHON, HERE / "ros_peer.py", *line, **given).splitlines()[-1])


def node(start, *line, before=(), name="gelsim"):
    """A node that is ready."""
    return start(*before, PYTHON, "-m", "gelsim.ros", *line, f"__name:={name}").says("ready")


def answered(told):
    """Stamps of the frames that were answered; they are among those sent, in their order."""
    stamps = [image[0] for image in told["images"]]
    assert stamps == sorted(set(stamps)) and set(stamps) <= set(told["sent"])
    return stamps


def test_keeps_up_with_60_hz_on_one_core(core, start, peer, run):
    tool = ["taskset", "-c", "0"] if shutil.which("taskset") else []
    made = node(start, "--plane-mm", "10", "--frame-id", "pad", "--report-s", "1", before=tool)
    hz = start("rostopic", "hz", "/gelsim/image")
    told = peer("depth", "/gelsim", "frames", 60, 1200, 320, 240)
    stamps = answered(told)
    assert len(stamps) > 600 and stamps[-1] == told["sent"][-1], made.text
    assert {tuple(image[1:4]) for image in told["images"]} == {("pad", 320, 240)}
    forces = [wrench[2] for wrench in told["wrenches"]]
    # The peer ends with the last image, whose wrench comes behind it.
    assert len(stamps) - len(forces) in (0, 1) and -10 < min(forces) < max(forces) < -0.1
    assert all(wrench[3:] == [None] * 3 for wrench in told["wrenches"]), "a frame does not know torques"
    assert "average rate" in hz.text
    rate = len(told["sent"]) / told["seconds"]
    print(f"{rate:.1f} frames/s sent, {len(told['sent'])} in all; {len(told['sent']) - len(stamps)} dropped")
    print(f"from stamp to image at a subscriber: {told['median_ms']:.1f} ms (median), {told['most_ms']:.1f} ms (99 %)")
    print(made.text)
    assert made.end() == 0


def test_drops_what_it_cannot_keep_up_with_and_keeps_the_latest(core, start, peer, run):
    made = node(start, "--plane-mm", "10", "--fidelity", "high", "--report-s", "1")
    told = peer("depth", "/gelsim", "frames", 500, 1500, 640, 480)
    stamps = answered(told)
    assert 10 < len(stamps) < 1400 and stamps[-1] == told["sent"][-1]
    status = run("rostopic", "echo", "-n", "1", "/diagnostics")
    count = lambda name: int(re.search(rf'"{name} since the start"\s*value: "(\d+)"', status)[1])
    assert count("done") == len(stamps) and count("came") == count("done") + count("dropped") == 1500 and count("refused") == 0
    print(made.text)


def test_survives_what_is_malformed_and_says_each_once(core, start, peer):
    made = node(start, "--plane-mm", "10", "--report-s", "1")
    told = peer("depth", "/gelsim", "malformed")
    assert told["before"] == 0 and len(told["images"]) == 2
    assert told["wrenches"][0][2] == 0.0 > told["wrenches"][1][2]
    said = [line for line in made.text.splitlines() if "only counted" in line]
    assert 5 <= len(said) <= 9 and len(said) == len({re.sub(r"[\d.]+", "", line) for line in said}), made.text
    assert made.end() == 0 and "Traceback" not in made.text


def test_sees_as_camera_info_says(core, start, peer):
    made = node(start, "--plane-mm", "25", "--projection", "perspective", "--resolution", "160x120")
    told = peer("depth", "/gelsim", "camera")
    assert [image[2:4] for image in told["images"]] == [[160, 120]] and told["wrenches"][0][2] < 0
    said = [line for line in made.text.splitlines() if "only counted" in line]
    assert len(said) == 2 and "no CameraInfo" in said[0] and "CameraInfo is of 320x240 px" in said[1], made.text


def test_follows_an_object_that_slides_and_begins_anew(core, start, peer, project):
    ball = project / "objects/sphere.obj"
    line = ["--mesh", ball, "--resolution", "160x120", "--set", "markers.pitch_mm=1.5", "--frame-id", "pad", "--friction", "0.4"]
    made = node(start, *line)
    told = peer("pose", "/gelsim", "slide")
    assert len(told["slips"]) == 12 and told["slips"][:6] == told["slips"][6:]
    assert told["slips"][0] == "none" and told["slips"][5] == "gross"
    # The object is pushed to the right, and the pad with it.
    assert told["wrenches"][5][0] > 0.1 and None not in told["wrenches"][5] and told["wrenches"][:6] == told["wrenches"][6:]
    assert [image[4] for image in told["images"][:6]] == [image[4] for image in told["images"][6:]]
    assert len(told["markers"]) == 12 and told["markers"][0][1][:3] == ["x", "y", "z"]
    assert made.text.count("only counted") == 2, made.text


def test_survives_another_master(core, start, peer, environment, run):
    made = node(start, "--plane-mm", "10", "--report-s", "1")
    old = start(PYTHON, HERE / "ros_peer.py", "depth", "/gelsim", "frames", "20", "1000000", "64", "48")
    made.says("latency")
    core.end()
    made.says("does not answer")
    came = lambda: int(made.text.count("latency"))
    before = came()
    wait(lambda: came() >= before + 2, "frames without a master")
    start("roscore", "-p", environment["ROS_MASTER_URI"].rpartition(":")[2]).says("started core service")
    made.says("registered again")
    told = peer("", "/gelsim", "listen", 20)
    assert len(told["images"]) >= 20, "of the old publisher, to a new subscriber"
    old.end()
    told = peer("depth", "/gelsim", "frames", 20, 20, 64, 48)
    assert answered(told)[-1] == told["sent"][-1], "of a new publisher"
    assert "success: True" in run("rosservice", "call", "/gelsim/reset")
    assert made.end() == 0 and made.text.count("does not answer") == 1


def test_a_launch_file_starts_two_sensors(core, start, peer, project):
    start("roslaunch", "gelsim_ros", "two_fingers.launch").says("started with pid")
    one = peer("/left/camera/depth", "/left/touch", "frames", 30, 30, 320, 240)
    other = peer("/right/camera/depth", "/right/touch", "frames", 30, 30, 320, 240)
    assert answered(one) and answered(other)
    assert {image[1] for image in one["images"]} == {"left_pad"} and {image[1] for image in other["images"]} == {"right_pad"}
    assert not {image[4] for image in one["images"]} & {image[4] for image in other["images"]}


def test_memory_does_not_grow(core, start):
    """From the second third of 12,000 frames to the last: the least, as buffers come and go."""
    made = node(start, "--plane-mm", "10", "--report-s", "1", "--set", "markers.pitch_mm=1.5")
    sender = start(PYTHON, HERE / "ros_peer.py", "depth", "/gelsim", "frames", 150, 12_000, 320, 240)
    held = []
    while sender.process.poll() is None:
        status = pathlib.Path(f"/proc/{made.process.pid}/status").read_text()
        held.append(int(re.search(r"VmRSS:\s*(\d+) kB", status)[1]) / 1024)
        time.sleep(1)
    told = json.loads(sender.text.splitlines()[-1])
    assert answered(told)[-1] == told["sent"][-1]
    first, second, last = (min(held[k * len(held) // 3 : (k + 1) * len(held) // 3]) for k in range(3))
    print(f"MB in each third of {len(told['images'])} frames: {first:.0f} {second:.0f} {last:.0f}")
    assert last <= 1.05 * second + 2


def test_mistakes_end_it_with_status_2(core, start):
    made = start(PYTHON, "-m", "gelsim.ros", "--sensor", "mini")
    assert made.process.wait(60) == 2 and "mini" in made.text and "Traceback" not in made.text


# Run by Debian's Python: an image as a depth camera of Gazebo writes it, by way of bytes, read as `ros_gz_bridge` hands it over.
GAZEBO = """
import sys, types
import numpy as np
from ignition.msgs import camera_info_pb2, image_pb2
from gelsim.ros import messages

depth = np.array([[0.01, np.inf, 0.0125], [0.5, 0.02, 0.03]], np.float32)
depth[1, 1] = float(sys.argv[1])
made = image_pb2.Image(width=3, height=2, step=12, pixel_format_type=image_pb2.PixelFormatType.Value("R_FLOAT32"), data=depth.tobytes())
made.header.stamp.sec, made.header.stamp.nsec = 3, 250_000_000
come = image_pb2.Image.FromString(made.SerializeToString())
encoding = {"R_FLOAT32": "32FC1"}[image_pb2.PixelFormatType.Name(come.pixel_format_type)]
fields = {name: getattr(come, name) for name in ("width", "height", "step", "data")}
said = types.SimpleNamespace(encoding=encoding, is_bigendian=False, **fields)
print(messages.depth_mm(said).tolist())

info = camera_info_pb2.CameraInfo(width=320, height=240)
info.intrinsics.k.extend([277.1, 0, 160, 0, 277.1, 120, 0, 0, 1])
info.distortion.k.extend([0] * 5)
come = camera_info_pb2.CameraInfo.FromString(info.SerializeToString())
said = types.SimpleNamespace(width=come.width, height=come.height, k=list(come.intrinsics.k), d=list(come.distortion.k))
print(messages.pinhole(said))
"""


@pytest.fixture(scope="module")
def gazebo(environment, tmp_path_factory):
    """Variables with which Debian's Python has the messages of Gazebo."""
    folder = tmp_path_factory.mktemp("gazebo")
    sources = next(pathlib.Path("/usr/include/ignition").glob("msgs*"), None)
    if sources is None or not shutil.which("protoc") or subprocess.run([PYTHON, "-c", "import google.protobuf"]).returncode:
        pytest.skip("no messages of Gazebo: apt install libignition-msgs-dev protobuf-compiler python3-protobuf")
    wanted = [sources / "ignition/msgs" / f"{name}.proto" for name in ("image", "camera_info", "header", "time")]
    subprocess.run(["protoc", "-I", sources, "--python_out", folder, *wanted], check=True)
    return {**environment, "PYTHONPATH": f"{folder}:{environment['PYTHONPATH']}"}


def test_depth_images_of_gazebos_messages_are_read(gazebo):
    read = lambda value: subprocess.run([PYTHON, "-c", GAZEBO, value], env=gazebo, capture_output=True, text=True)
    done = read("inf")
    assert done.returncode == 0, done.stderr
    assert "[[10.0, inf, 12.5], [500.0, inf, 30.0" in done.stdout and "(159.5, 119.5)" in done.stdout
    assert "near plane" in read("-inf").stderr
