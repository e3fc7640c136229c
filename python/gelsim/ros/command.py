"""The command `python -m gelsim.ros`."""

from __future__ import annotations

import argparse
import os
import sys
import warnings
from dataclasses import fields
from importlib.util import find_spec
from typing import Any, Union

from gelsim._native import UsageError
from gelsim.ros.parameters import Parameters
from gelsim.ros.ros1 import Ros1
from gelsim.ros.ros2 import Ros2
from gelsim.ros.touch import Touch

MISSING = """error: this Python has no {}
 |
 = help: source /opt/ros/NAME/setup.bash first; on Debian, apt install python3-rospy python3-sensor-msgs python3-std-srvs \
python3-diagnostic-msgs, and run this with /usr/bin/python3"""


def main(arguments: list[str]) -> int:
    """Runs the node until ROS ends it; the exit status. 2 for a mistake in what it is told."""
    halves: dict[str, Any] = {"1": Ros1, "2": Ros2}
    there = [version for version, module in (("1", "rospy"), ("2", "rclpy")) if find_spec(module)]
    version = os.environ.get("ROS_VERSION", "")
    missing = [name for name in ("sensor_msgs", "geometry_msgs", "std_msgs", "std_srvs") if not find_spec(name)]
    if not there or missing:
        parser().parse_args([each for each in arguments if each in ("-h", "--help")])
        print(MISSING.format(" or ".join(missing) if there else "rospy (ROS 1) or rclpy (ROS 2)"), file=sys.stderr)
        return 2
    try:
        ros: Union[Ros1, Ros2] = halves[version if version in there else there[0]](arguments, "gelsim")
        told = ros.parameters(Parameters(**vars(parser().parse_args(ros.rest))))
        warnings.showwarning = lambda message, *_, **__: ros.say("warn", str(message))
        touch = Touch(told)
    except (UsageError, ImportError) as error:
        print(error, file=sys.stderr)
        return 2
    ros.run(touch)
    return 0


def parser() -> argparse.ArgumentParser:
    """What the command takes."""
    made = argparse.ArgumentParser(
        prog="python -m gelsim.ros",
        description="A tactile sensor as a ROS node: depth images or poses in, tactile images, wrenches and slip out.",
        epilog="Also what ROS takes: depth:=/camera/depth in ROS 1, --ros-args -r depth:=/camera/depth in ROS 2. Parameters of "
        "ROS have the same names with _ in place of -, and win over flags. docs/how-to/ros.md says more.",
        allow_abbrev=False,
    )
    for each in fields(Parameters):
        flag, words, default = f"--{each.name.replace('_', '-')}", each.metadata["words"].replace("%", "%%"), each.default
        if isinstance(default, bool):
            made.add_argument(flag, action="store_true", help=words)
        else:
            shown = f" ({default})" if default not in ("", 0.0) else ""
            made.add_argument(flag, type=type(default), default=default, help=words + shown, metavar=type(default).__name__.upper())
    return made
