"""rclpy and the messages of ROS 2 as far as `gelsim.ros` uses them, as strict as they are: a field takes its own type only.

`graph(monkeypatch)` puts them in place of what is not installed. Whether the real ones are as here is written is not tested.
"""

import array
import sys
import threading
import types
from importlib.machinery import ModuleSpec


def message(**kinds):
    """A class of messages whose fields have these types, or make these messages."""

    class Message:
        def __init__(self, **values):
            for name, kind in kinds.items():
                object.__setattr__(self, name, array.array("B") if kind is array.array else kind())
            for name, value in values.items():
                setattr(self, name, value)

        def __setattr__(self, name, value):
            kind = kinds[name]
            assert isinstance(value, kind) and (kind is bool or not isinstance(value, bool)), f"{name} is {type(value)}"
            if isinstance(value, array.array):
                assert value.typecode == "B"
            object.__setattr__(self, name, value)

    return Message


class Nine(list):
    def __init__(self, values=(0.0,) * 9):
        super().__init__(values)
        assert len(self) == 9


Time = message(sec=int, nanosec=int)
Header = message(stamp=Time, frame_id=str)
Point, Vector3 = (message(x=float, y=float, z=float) for _ in range(2))
Quaternion = message(x=float, y=float, z=float, w=float)
Pose, Wrench = message(position=Point, orientation=Quaternion), message(force=Vector3, torque=Vector3)
KeyValue = message(key=str, value=str)
Level = type("Level", (bytes,), {"__new__": lambda cls, value=b"\0": bytes.__new__(cls, value)})


class Status(message(level=bytes, name=str, message=str, values=list)):
    pass


MESSAGES = {
    "sensor_msgs.msg": {
        "Image": message(header=Header, height=int, width=int, encoding=str, is_bigendian=int, step=int, data=array.array),
        "CameraInfo": message(header=Header, height=int, width=int, d=list, k=Nine),
        "PointField": message(name=str, offset=int, datatype=int, count=int),
        "PointCloud2": message(
            header=Header, height=int, width=int, fields=list, is_bigendian=bool, point_step=int, row_step=int, data=array.array, is_dense=bool
        ),
    },
    "geometry_msgs.msg": {"PoseStamped": message(header=Header, pose=Pose), "WrenchStamped": message(header=Header, wrench=Wrench)},
    "std_msgs.msg": {"String": message(data=str)},
    "diagnostic_msgs.msg": {"DiagnosticStatus": Status, "KeyValue": KeyValue, "DiagnosticArray": message(header=Header, status=list)},
    "std_srvs.srv": {"Trigger": types.SimpleNamespace(Response=message(success=bool, message=str))},
    "rcl_interfaces.msg": {"ParameterDescriptor": message(dynamic_typing=bool)},
}


class Graph:
    """What a node did, and what it is to be given: `play(node)` is what happens while it spins."""

    def __init__(self):
        self.parameters, self.play, self.said = {}, lambda node: None, []
        self.published, self.changed = [], threading.Condition()

    def wait(self, count):
        """Waits for so many messages, pairs of a topic and what was published."""
        with self.changed:
            assert self.changed.wait_for(lambda: len(self.published) >= count, 60), (self.published, self.said)
        return self.published

    def make(self, name):
        graph = self

        class Publisher:
            def __init__(self, topic):
                self.topic = topic

            def publish(self, said):
                with graph.changed:
                    graph.published.append((self.topic, said))
                    graph.changed.notify_all()

        class Logger:
            def __getattr__(self, level):
                return lambda text: graph.said.append((level, text))

        class Node:
            subscriptions, services = {}, {}

            def declare_parameter(self, name, value, descriptor):
                assert descriptor.dynamic_typing
                return types.SimpleNamespace(value=graph.parameters.get(name, value))

            def create_publisher(self, kind, topic, qos_profile):
                assert isinstance(qos_profile, int)
                return Publisher(topic)

            def create_subscription(self, kind, topic, callback, qos_profile):
                self.subscriptions[topic] = callback

            def create_service(self, kind, name, callback):
                self.services[name] = lambda: callback(None, kind.Response())

            def get_logger(self):
                return Logger()

            def get_clock(self):
                now = types.SimpleNamespace(to_msg=lambda: Time(sec=7))
                return types.SimpleNamespace(now=lambda: now)

            def get_fully_qualified_name(self):
                return f"/{name}"

            def destroy_node(self):
                pass

        return Node()


def graph(monkeypatch):
    """Puts the stand-in into `sys.modules`, and gives what the test looks at."""
    made = Graph()
    ended = type("ExternalShutdownException", (Exception,), {})

    def spin(node):
        made.play(node)
        raise ended

    def init(*, args):
        assert isinstance(args, list)

    modules = {
        "rclpy": {"init": init, "create_node": made.make, "spin": spin, "try_shutdown": lambda: None},
        "rclpy.qos": {
            "QoSProfile": lambda *, depth, reliability: (depth, reliability),
            "ReliabilityPolicy": types.SimpleNamespace(BEST_EFFORT="best effort"),
        },
        "rclpy.utilities": {"remove_ros_args": lambda args: args[: args.index("--ros-args")] if "--ros-args" in args else args},
        "rclpy.executors": {"ExternalShutdownException": ended},
        **{name.split(".")[0]: {} for name in MESSAGES},
        **MESSAGES,
    }
    for name, content in modules.items():
        module = types.ModuleType(name)
        module.__spec__ = ModuleSpec(name, None)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.setenv("ROS_VERSION", "2")
    return made
