"""The node without ROS: it works on the latest message, and survives what is wrong with it."""

from __future__ import annotations

import threading
import time
from typing import Any, Optional, Protocol

from gelsim.ros import messages
from gelsim.ros.tally import Status, Tally
from gelsim.ros.touch import Felt, Touch


class Graph(Protocol):
    """What the node wants of ROS."""

    def publish(self, header: Any, frame_id: str, felt: Felt) -> None:
        """Publishes what is felt, with the stamp of `header`."""

    def publish_status(self, status: Status) -> None:
        """Publishes how it goes, if there is where to."""

    def say(self, level: str, text: str) -> None:
        """Logs `info`, `warn` or `error`; from any thread."""


class Node:
    """A sensor in a graph. Messages may come from any thread; one thread of its own works on them."""

    def __init__(self, touch: Touch, graph: Graph) -> None:
        """`start` begins the work."""
        self._touch, self._graph, self._its = touch, graph, touch.parameters
        self._tally = Tally()
        self._changed = threading.Condition()
        self._working = threading.Lock()
        self._latest: Optional[tuple[Any, float]] = None
        self._camera: Optional[messages.Pinhole] = None
        self._ends = False
        self._thread = threading.Thread(target=self._work, name="gelsim", daemon=True)

    def start(self) -> None:
        """Begins to work on what comes."""
        self._thread.start()

    def stop(self) -> None:
        """Ends the work, after the message at hand."""
        with self._changed:
            self._ends = True
            self._changed.notify()
        self._thread.join()

    def take(self, message: Any) -> None:
        """Takes a depth image or a pose, in place of one that waits."""
        self._tally.add("came")
        self._put((message, time.monotonic()))

    def take_camera(self, message: Any) -> None:
        """Takes a CameraInfo."""
        try:
            self._camera = messages.pinhole(message)
        except Exception as error:
            self._camera = None
            self._refuse(error)

    def reset(self) -> None:
        """Begins another sequence. A message that waits belongs to the one before, and is dropped."""
        self._put(None)
        with self._working:
            self._touch.begin()
        self._graph.say("info", "a new sequence begins")

    def _put(self, given: Optional[tuple[Any, float]]) -> None:
        with self._changed:
            self._tally.add("dropped", int(self._latest is not None))
            self._latest = given
            self._changed.notify()

    def _work(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._latest or self._ends, max(0.0, self._tally.due(self._its.report_s)))
                given, self._latest = self._latest, None
            if self._ends:
                return
            if given is not None:
                self._answer(*given)
            if self._tally.due(self._its.report_s) <= 0.0:
                status = self._tally.report()
                if status.is_news:
                    self._graph.say("info" if status.is_well else "warn", status.summary)
                self._graph.publish_status(status)

    def _answer(self, message: Any, came: float) -> None:
        try:
            with self._working:
                felt = self._feel(message)
            self._graph.publish(message.header, self._its.frame_id or message.header.frame_id, felt)
        except Exception as error:
            self._refuse(error)
        else:
            self._tally.done(time.monotonic() - came)

    def _feel(self, message: Any) -> Felt:
        its = self._its
        if self._touch.takes_poses:
            return self._touch.feel_pose(messages.placement(message, its.frame_id), messages.stamp_s(message))
        frame = messages.depth_mm(message)
        if its.projection == "orthographic":
            return self._touch.feel_frame(frame, None)
        if its.fov_y_deg > 0.0:
            return self._touch.feel_frame(frame, messages.Pinhole.of_angle(its.fov_y_deg, (frame.shape[1], frame.shape[0])))
        if self._camera is None:
            raise messages.Refused("no CameraInfo has come that says how the camera sees; or give fov_y_deg")
        return self._touch.feel_frame(frame, self._camera)

    def _refuse(self, error: Exception) -> None:
        if text := self._tally.refused(error):
            self._graph.say("error", f"refused, and only counted from now on: {text}")
