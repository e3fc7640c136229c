"""A ROS node that feels what a simulator shows or moves: depth images or poses in, tactile images, wrenches and slip out.

    python -m gelsim.ros --sensor gelsight-mini --plane-mm 10

runs it with rospy (ROS 1) or rclpy (ROS 2), whichever is there; docs/how-to/ros.md says more. Neither is needed to import what is
here:

- `messages` reads messages of either ROS, which are the same but for the case of letters;
- `touch` is a sensor at work: a frame or a pose in, what is felt out;
- `node` drops what cannot be kept up with, and survives what is wrong; `tally` counts it;
- `topics` has what the halves for either ROS share, `ros1` and `ros2` are these; `parameters` and `command` are what a user gives.
"""
