"""The node in a graph of ROS 2, by rclpy."""

from __future__ import annotations

import sys
from array import array
from dataclasses import fields, replace
from importlib import import_module
from typing import Any

from gelsim.ros.node import Node
from gelsim.ros.parameters import Parameters
from gelsim.ros.tally import Status
from gelsim.ros.topics import diagnostics_type, felt_messages, inputs, outputs, status_message
from gelsim.ros.touch import Felt, Touch


class Ros2:
    """Topics, parameters and the log of an rclpy node."""

    def __init__(self, arguments: list[str], name: str) -> None:
        """Takes what rclpy understands out of `arguments`, and leaves the others in `rest`."""
        self._rclpy, self._name = import_module("rclpy"), name
        self._arguments = [sys.argv[0], *arguments]
        self.rest: list[str] = import_module("rclpy.utilities").remove_ros_args(args=self._arguments)[1:]

    def parameters(self, flags: Parameters) -> Parameters:
        """Makes the node. Returns the flags, with what ROS says in their place."""
        self._rclpy.init(args=self._arguments)
        self._node = self._rclpy.create_node(self._name)
        # ROS would refuse 10 for 10.0.
        loose = import_module("rcl_interfaces.msg").ParameterDescriptor(dynamic_typing=True)
        declare = self._node.declare_parameter
        told = {each.name: declare(each.name, getattr(flags, each.name), loose).value for each in fields(flags)}
        return replace(flags, **told)

    def run(self, touch: Touch) -> None:
        """Works until ROS ends the node."""
        its, node = self._node, Node(touch, self)
        quality = import_module("rclpy.qos")
        # Best effort listens to publishers of either kind. The node itself keeps the latest message and counts the others.
        listens = quality.QoSProfile(depth=10, reliability=quality.ReliabilityPolicy.BEST_EFFORT)
        self._topics = {name: its.create_publisher(kind, f"~/{name}", 1) for name, kind in outputs(touch).items()}
        status = diagnostics_type()
        self._status = its.create_publisher(status, "/diagnostics", 1) if status else None

        def reset(_: Any, response: Any) -> Any:
            node.reset()
            response.success, response.message = True, "a new sequence begins"
            return response

        its.create_service(import_module("std_srvs.srv").Trigger, "~/reset", reset)
        node.start()
        for topic, (kind, take) in inputs(touch, node).items():
            its.create_subscription(kind, topic, take, listens)
        self.say("info", "ready")
        try:
            self._rclpy.spin(its)
        except (KeyboardInterrupt, import_module("rclpy.executors").ExternalShutdownException):
            pass
        finally:
            node.stop()
            its.destroy_node()
            self._rclpy.try_shutdown()

    def publish(self, header: Any, frame_id: str, felt: Felt) -> None:
        """Publishes what is felt, with the stamp of `header`."""
        for topic, message in felt_messages(header.stamp, frame_id, felt, lambda data: array("B", data)):
            self._topics[topic].publish(message)

    def publish_status(self, status: Status) -> None:
        """Publishes diagnostics, if their package is installed."""
        if self._status is not None:
            now = self._node.get_clock().now().to_msg()
            levels = b"\0", b"\1"
            self._status.publish(status_message(now, self._node.get_fully_qualified_name(), status, levels))

    def say(self, level: str, text: str) -> None:
        """Logs `info`, `warn` or `error`."""
        log = self._node.get_logger()
        # rclpy ties each level to the line that logs it.
        if level == "info":
            log.info(text)
        elif level == "warn":
            log.warning(text)
        else:
            log.error(text)
