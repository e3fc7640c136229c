"""The node in a graph of ROS 1, by rospy."""

from __future__ import annotations

import sys
import threading
from dataclasses import fields, replace
from importlib import import_module
from typing import Any
from xmlrpc.client import ServerProxy

from gelsim.ros.node import Node
from gelsim.ros.parameters import Parameters
from gelsim.ros.tally import Status
from gelsim.ros.topics import diagnostics_type, felt_messages, inputs, outputs, status_message
from gelsim.ros.touch import Felt, Touch

WATCH_S = 2.0
"""How often the master is asked whether it knows the node."""

RECEIVE_BYTES = 1 << 20
"""Read at once from a publisher."""


class Ros1:
    """Topics, parameters and the log of a rospy node."""

    def __init__(self, arguments: list[str], name: str) -> None:
        """Takes what rospy understands out of `arguments`, and leaves the others in `rest`."""
        self._rospy, self._name = import_module("rospy"), name
        self.rest: list[str] = self._rospy.myargv([sys.argv[0], *arguments])[1:]

    def parameters(self, flags: Parameters) -> Parameters:
        """Registers the node at the master, for which it waits. Returns the flags, with what the parameter server says in their place."""
        self._rospy.init_node(self._name)
        told = {each.name: self._rospy.get_param(f"~{each.name}", getattr(flags, each.name)) for each in fields(flags)}
        return replace(flags, **told)

    def run(self, touch: Touch) -> None:
        """Works until ROS ends the node."""
        rospy, node = self._rospy, Node(touch, self)

        def advertise(topic: str, kind: Any) -> Any:
            return rospy.Publisher(topic, kind, queue_size=1)

        self._topics = {name: advertise(f"~{name}", kind) for name, kind in outputs(touch).items()}
        status = diagnostics_type()
        self._status = advertise("/diagnostics", status) if status else None
        services = import_module("std_srvs.srv")

        def reset(_: Any) -> Any:
            node.reset()
            return services.TriggerResponse(success=True, message="a new sequence begins")

        self._service = rospy.Service("~reset", services.Trigger, reset)
        node.start()
        for topic, (kind, take) in inputs(touch, node).items():
            # The node itself keeps the latest message and counts the others: rospy is to hand over all of them.
            rospy.Subscriber(topic, kind, take, queue_size=None, buff_size=RECEIVE_BYTES, tcp_nodelay=True)
        self.say("info", "ready")
        ended = threading.Event()
        rospy.on_shutdown(ended.set)
        answers = True
        while not (ended.wait(WATCH_S) or rospy.is_shutdown()):
            answers = self._watch(answers)
        node.stop()

    def _watch(self, answered: bool) -> bool:
        """Registers the node's topics again if the master does not know it: another one runs in its place, of which rospy knows
        nothing. Connections stay. False if no master answers."""
        name, uri = self._rospy.get_name(), self._rospy.get_node_uri()
        master, itself = import_module("rosgraph").Master(name), ServerProxy(uri)
        try:
            published, _, _ = master.getSystemState()
            if self._rospy.is_shutdown():
                return True
            if not any(topic == self._topics["image"].resolved_name and name in nodes for topic, nodes in published):
                for topic, kind in listed(itself.getPublications(name)):
                    master.registerPublisher(topic, kind, uri)
                for topic, kind in listed(itself.getSubscriptions(name)):
                    itself.publisherUpdate("/master", topic, master.registerSubscriber(topic, kind, uri))
                master.registerService(self._service.resolved_name, self._service.uri, uri)
                self.say("warn", "there is a new master; the node is registered again")
        except Exception as error:  # of sockets, of HTTP, of XML, of the master itself
            if answered and not self._rospy.is_shutdown():
                self.say("warn", f"the master does not answer ({error}); topics that are connected go on")
            return False
        return True

    def publish(self, header: Any, frame_id: str, felt: Felt) -> None:
        """Publishes what is felt, with the stamp of `header`."""
        for topic, message in felt_messages(header.stamp, frame_id, felt, bytes):
            self._topics[topic].publish(message)

    def publish_status(self, status: Status) -> None:
        """Publishes diagnostics, if their package is installed."""
        if self._status is not None:
            self._status.publish(status_message(self._rospy.Time.now(), self._rospy.get_name(), status, (0, 1)))

    def say(self, level: str, text: str) -> None:
        """Logs `info`, `warn` or `error`."""
        {"info": self._rospy.loginfo, "warn": self._rospy.logwarn, "error": self._rospy.logerr}[level]("%s", text)


def listed(answer: Any) -> list[list[str]]:
    """What the node's own server answers: pairs of a topic and its type."""
    _, _, pairs = answer
    return [[str(part) for part in pair] for pair in pairs]
