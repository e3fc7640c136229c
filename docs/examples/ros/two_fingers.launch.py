"""Two sensors, each with a depth camera: `ros2 launch two_fingers.launch.py`. Change sensors, plane and topics to yours."""

from launch import LaunchDescription
from launch.actions import ExecuteProcess


def finger(side, sensor):
    """A node `/SIDE/touch`."""
    flags = ["--sensor", sensor, "--plane-mm", "10", "--frame-id", f"{side}_pad"]
    names = ["-r", f"__ns:=/{side}", "-r", "__node:=touch", "-r", f"depth:=/{side}/camera/depth"]
    return ExecuteProcess(cmd=["python3", "-m", "gelsim.ros", *flags, "--ros-args", *names], output="screen")


def generate_launch_description():
    """What `ros2 launch` starts."""
    return LaunchDescription([finger("left", "gelsight-mini"), finger("right", "digit")])
