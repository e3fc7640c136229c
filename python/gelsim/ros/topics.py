"""The topics of a node, and what is felt as messages: their packages have the same names in both ROS."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from importlib import import_module
from typing import Any, Optional

from gelsim.ros.node import Node
from gelsim.ros.tally import Status
from gelsim.ros.touch import MARKER_FIELDS, Felt, Touch

FLOAT32 = 7
"""`PointField`'s number of it."""


def inputs(touch: Touch, node: Node) -> dict[str, tuple[Any, Callable[[Any], None]]]:
    """Topics that the node listens to: the type of messages, and what takes them."""
    sensor, geometry = import_module("sensor_msgs.msg"), import_module("geometry_msgs.msg")
    if touch.takes_poses:
        return {"pose": (geometry.PoseStamped, node.take)}
    camera = {"camera_info": (sensor.CameraInfo, node.take_camera)} if touch.parameters.projection == "perspective" else {}
    return {**camera, "depth": (sensor.Image, node.take)}


def outputs(touch: Touch) -> dict[str, Any]:
    """Topics below the node's name, with the type of messages."""
    sensor, geometry, std = (import_module(f"{name}_msgs.msg") for name in ("sensor", "geometry", "std"))
    always = {"image": sensor.Image, "wrench": geometry.WrenchStamped}
    slip = {"slip": std.String} if touch.follows else {}
    return {**always, **slip, **({"markers": sensor.PointCloud2} if touch.has_markers else {})}


def felt_messages(stamp: Any, frame_id: str, felt: Felt, packed: Callable[[bytes], Any]) -> Iterator[tuple[str, Any]]:
    """Names of topics, each with its message. `packed` makes of bytes what a field `uint8[]` takes."""
    sensor, geometry, std = (import_module(f"{name}_msgs.msg") for name in ("sensor", "geometry", "std"))
    header = {"stamp": stamp, "frame_id": frame_id}
    image = under(header, sensor.Image())
    image.height, image.width = felt.image.shape[:2]
    image.encoding, image.step, image.data = "rgb8", 3 * image.width, packed(felt.image.tobytes())
    yield "image", image
    wrench = under(header, geometry.WrenchStamped())
    for vector, its in ((wrench.wrench.force, felt.force_n), (wrench.wrench.torque, felt.torque_nm)):
        vector.x, vector.y, vector.z = map(float, its)
    yield "wrench", wrench
    if felt.slip is not None:
        yield "slip", std.String(data=felt.slip)
    if felt.markers is not None:
        cloud = under(header, sensor.PointCloud2())
        each = 4 * len(MARKER_FIELDS)
        cloud.fields = [
            sensor.PointField(name=name, offset=4 * place, datatype=FLOAT32, count=1) for place, name in enumerate(MARKER_FIELDS)
        ]
        cloud.height, cloud.width, cloud.point_step, cloud.row_step = 1, len(felt.markers), each, each * len(felt.markers)
        cloud.is_bigendian, cloud.is_dense = sys.byteorder == "big", True
        cloud.data = packed(felt.markers.tobytes())
        yield "markers", cloud


def status_message(stamp: Any, name: str, status: Status, levels: tuple[Any, Any]) -> Any:
    """A DiagnosticArray. `levels` are OK and WARN, which are not of the same type in both."""
    diagnostics = import_module("diagnostic_msgs.msg")
    one = diagnostics.DiagnosticStatus(name=name, message=status.summary, level=levels[0 if status.is_well else 1])
    one.values = [diagnostics.KeyValue(key=key, value=value) for key, value in status.values.items()]
    whole = diagnostics.DiagnosticArray(status=[one])
    whole.header.stamp = stamp
    return whole


def under(header: dict[str, Any], message: Any) -> Any:
    """The message, with its header filled."""
    message.header.stamp, message.header.frame_id = header["stamp"], header["frame_id"]
    return message


def diagnostics_type() -> Optional[Any]:
    """DiagnosticArray, where its package is installed."""
    try:
        return import_module("diagnostic_msgs.msg").DiagnosticArray
    except ImportError:
        return None
