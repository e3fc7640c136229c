"""What is at the other end of the node's topics, by rospy; `test_ros_graph.py` starts it with Debian's Python.

    python ros_peer.py TOPIC NODE KIND [VALUE...]

publishes messages of a KIND on TOPIC, listens to NODE's topics, and prints what came as JSON. KIND is `frames HZ COUNT WIDTH HEIGHT`,
`malformed`, `camera`, `slide` or `listen COUNT`.
"""

import hashlib
import json
import math
import struct
import sys
import threading
import time

import numpy as np
import rospy
from geometry_msgs.msg import PoseStamped, WrenchStamped
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from std_msgs.msg import String
from std_srvs.srv import Trigger

QUIET_S = 1.5
PATIENCE_S = 60


class Peer:
    def __init__(self, topic, node, kind):
        self.images, self.wrenches, self.slips, self.markers, self.late_s = [], [], [], [], []
        self.last = time.monotonic()
        self.lock = threading.Lock()
        given = {"queue_size": None, "buff_size": 1 << 22, "tcp_nodelay": True}
        rospy.Subscriber(f"{node}/image", Image, self.image, **given)
        rospy.Subscriber(f"{node}/wrench", WrenchStamped, self.wrench, **given)
        rospy.Subscriber(f"{node}/slip", String, self.slip, **given)
        rospy.Subscriber(f"{node}/markers", PointCloud2, self.cloud, **given)
        self.publisher = rospy.Publisher(topic, kind, queue_size=1000) if topic else None
        self.until(lambda: self.publisher is None or self.publisher.get_num_connections() > 0, "subscriber")

    def image(self, said):
        with self.lock:
            now = rospy.Time.now()
            self.late_s.append((now - said.header.stamp).to_sec())
            assert (said.encoding, said.step, len(said.data)) == ("rgb8", 3 * said.width, 3 * said.width * said.height)
            self.images.append((said.header.stamp.to_nsec(), said.header.frame_id, said.width, said.height, hashlib.md5(said.data).hexdigest()))
            self.last = time.monotonic()

    def wrench(self, said):
        force, torque = said.wrench.force, said.wrench.torque
        numbers = [force.x, force.y, force.z, torque.x, torque.y, torque.z]
        self.wrenches.append([None if math.isnan(each) else each for each in numbers])

    def slip(self, said):
        self.slips.append(said.data)

    def cloud(self, said):
        x, y, z = struct.unpack_from("<fff", said.data)
        self.markers.append([said.width, [field.name for field in said.fields], x, y, z])

    def until(self, condition, what):
        end = time.monotonic() + PATIENCE_S
        while not condition() and not rospy.is_shutdown():
            if time.monotonic() > end:
                sys.exit(f"no {what}; images: {len(self.images)}")
            time.sleep(0.005)

    def quiet(self):
        """Waits until nothing comes any more."""
        self.last = time.monotonic()
        self.until(lambda: time.monotonic() - self.last > QUIET_S, "end")

    def send(self, said, frame_id="camera"):
        said.header.stamp, said.header.frame_id = rospy.Time.now(), frame_id
        self.publisher.publish(said)
        return said.header.stamp.to_nsec()

    def report(self, **more):
        late_ms = sorted(1e3 * each for each in self.late_s)
        share = lambda part: late_ms[int(part * (len(late_ms) - 1))] if late_ms else None
        told = {"images": self.images, "wrenches": self.wrenches, "slips": self.slips, "markers": self.markers}
        print(json.dumps({**told, "median_ms": share(0.5), "most_ms": share(0.99), **more}))


def ball(width, height, k):
    """A depth frame, m, of a ball of 4 mm that rolls about, 10 mm from the camera to the pad of a GelSight Mini."""
    x = ((np.arange(width) + 0.5) / width - 0.5) * 18.6 - 2 * math.sin(k / 10)
    y = ((np.arange(height)[:, None] + 0.5) / height - 0.5) * 14.3
    rest = 16 - x * x - y * y
    return (1e-3 * np.where(rest > 0, 13.2 - np.sqrt(np.maximum(rest, 0)), np.inf)).astype("<f4")


def depth(frame, **changes):
    height, width = frame.shape
    return Image(**{"height": height, "width": width, "encoding": "32FC1", "step": frame.strides[0], "data": frame.tobytes(), **changes})


def frames(topic, node, hz, count, width, height):
    peer = Peer(topic, node, Image)
    cycle = [ball(int(width), int(height), k).tobytes() for k in range(63)]
    blank = ball(int(width), int(height), 0)
    begun, sent = time.monotonic(), []
    for k in range(int(count)):
        sent.append(peer.send(depth(blank, data=cycle[k % 63])))
        time.sleep(max(0.0, begun + (k + 1) / float(hz) - time.monotonic()))
    seconds = time.monotonic() - begun
    peer.quiet()
    peer.report(sent=sent, seconds=seconds)


def malformed(topic, node):
    peer = Peer(topic, node, Image)
    good = ball(64, 48, 0)
    bad = [
        depth(good, encoding="rgb8"),
        depth(good, step=16),
        depth(good, height=480),
        depth(good, width=0, height=0, data=b""),
        depth(good, width=4_000_000_000, height=4_000_000_000, step=1),
        depth(np.full_like(good, -np.inf)),
        depth(np.zeros_like(good)),
        depth(good, encoding="32FC1" * 1000),
        Image(),
    ]
    for each in bad * 3:
        peer.send(each)
        time.sleep(0.1)
    peer.quiet()
    before = len(peer.images)
    peer.send(depth(np.full_like(good, np.nan)))
    peer.until(lambda: len(peer.images) == 1, "image")
    peer.send(depth(good))
    peer.until(lambda: len(peer.images) == 2 and len(peer.wrenches) == 2, "image")
    peer.report(sent=len(bad) * 3, before=before)


def camera(topic, node):
    """A frame before a CameraInfo, one after, and one after a CameraInfo of another size."""
    peer = Peer(topic, node, Image)
    publisher = rospy.Publisher("camera_info", CameraInfo, queue_size=1)
    peer.until(lambda: publisher.get_num_connections() > 0, "listener of camera_info")
    wall = np.full((480, 640), 0.0245, "<f4")
    wall[:, :260] = wall[:, 380:] = np.inf
    wall[:180] = wall[300:] = np.inf
    for size in [None, (640, 480), (320, 240)]:
        if size is not None:
            width, height = size
            publisher.publish(CameraInfo(width=width, height=height, K=[700.0, 0, width / 2, 0, 700.0, height / 2, 0, 0, 1], D=[0.0] * 5))
            time.sleep(0.5)
        peer.send(depth(wall))
        time.sleep(0.5)
    peer.quiet()
    peer.report()


def slide(topic, node):
    peer = Peer(topic, node, PoseStamped)
    reset = rospy.ServiceProxy(f"{node}/reset", Trigger)
    reset.wait_for_service(PATIENCE_S)

    def step(x_mm, w=1.0):
        said = PoseStamped()
        said.pose.position.x, said.pose.position.z, said.pose.orientation.w = 1e-3 * x_mm, -0.6e-3, w
        peer.send(said, "pad")

    for _ in range(2):
        for k in range(6):
            count = len(peer.slips)
            step(0.3 * k)
            peer.until(lambda: len(peer.slips) == count + 1, "slip")
        assert reset().success
    count = len(peer.slips)
    for w in (0.0, math.nan):
        step(0.0, w)
        time.sleep(0.5)
    assert len(peer.slips) == count
    peer.quiet()
    peer.report()


def listen(topic, node, count):
    peer = Peer(None, node, Image)
    peer.until(lambda: len(peer.images) >= int(count), "images")
    peer.report()


if __name__ == "__main__":
    topic, node, kind, *values = rospy.myargv(sys.argv)[1:]
    rospy.init_node("peer", anonymous=True, disable_signals=False)
    {"frames": frames, "malformed": malformed, "camera": camera, "slide": slide, "listen": listen}[kind](topic, node, *values)
