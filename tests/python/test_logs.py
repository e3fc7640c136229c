"""Bags that others write are rendered as the same frames in npy files; the log that gelsim writes is read by others."""

import json
import math
import re

import pytest

numpy = pytest.importorskip("numpy", reason="no numpy: pip install numpy")
Image = pytest.importorskip("PIL.Image", reason="no pillow: pip install pillow")
rosbag1 = pytest.importorskip("rosbags.rosbag1", reason="no rosbags: pip install rosbags")

from processes import run
from rosbags import rosbag2
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

WIDTH, HEIGHT = 64, 48
STAMPS = [1_700_000_000_000_000_000 + 40_000_000 * k for k in range(5)]
TOPIC = "/gel/depth/image"
# What both kinds of frames need.
PAD = "--plane-mm 10 --sensor gelsight-2014 --set markers.pitch_mm=1.5".split()


def ball(deep_mm, x_mm=0.0):
    """Distances in metres to a ball of 4 mm; what is far is infinite or NaN, as cameras have it."""
    x, y = (numpy.arange(WIDTH) + 0.5) * 20 / WIDTH - 10 - x_mm, (numpy.arange(HEIGHT) + 0.5) * 15 / HEIGHT - 7.5
    gap = 16 - x[None, :] ** 2 - y[:, None] ** 2
    frame = numpy.where(gap > 0, 10 - deep_mm + 4 - numpy.sqrt(numpy.maximum(gap, 0)), numpy.inf)
    return (frame / 1000).astype("float32")


FRAMES = [ball(0.2 + 0.1 * k, 0.1 * k) for k in range(len(STAMPS))]


class Ros:
    """Messages of a version of ROS."""

    def __init__(self, version):
        self.version = version
        self.store = get_typestore(Stores.ROS1_NOETIC if version == 1 else Stores.ROS2_HUMBLE)
        self.type = self.store.types.__getitem__
        if "tf2_msgs/msg/TFMessage" not in self.store.types:
            name = "tf2_msgs/msg/TFMessage"
            self.store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", name))

    def header(self, stamp, frame="camera"):
        time = self.type("builtin_interfaces/msg/Time")(sec=stamp // 10**9, nanosec=stamp % 10**9)
        more = {"seq": 7} if self.version == 1 else {}
        return self.type("std_msgs/msg/Header")(stamp=time, frame_id=frame, **more)

    def image(self, stamp, frame, encoding="32FC1", pad=0, big=False):
        """An image whose rows have `pad` bytes more than they need."""
        raw = frame.astype(frame.dtype.newbyteorder(">" if big else "<"))
        rows = raw.view("uint8").reshape(HEIGHT, -1)
        rows = numpy.pad(rows, ((0, 0), (0, pad)), constant_values=255)
        return self.type("sensor_msgs/msg/Image")(
            header=self.header(stamp), height=HEIGHT, width=WIDTH, encoding=encoding, is_bigendian=int(big), step=rows.shape[1], data=rows.ravel()
        )

    def compressed(self, stamp, png, format, head):
        data = numpy.frombuffer(head + png, "uint8")
        return self.type("sensor_msgs/msg/CompressedImage")(header=self.header(stamp), format=format, data=data)

    def camera_info(self, stamp, fx, fy, cx, cy, size=(WIDTH, HEIGHT), bent=0.0):
        kind = self.type("sensor_msgs/msg/CameraInfo")
        names = {name: name for name in ("D", "K", "R", "P")} if self.version == 1 else {name: name.lower() for name in "DKRP"}
        k, p = numpy.zeros(9), numpy.zeros(12)
        k[[0, 2, 4, 5, 8]] = fx, cx, fy, cy, 1
        p[[0, 2, 5, 6, 10]] = fx, cx, fy, cy, 1
        roi = self.type("sensor_msgs/msg/RegionOfInterest")(0, 0, 0, 0, False)
        arrays = {names["D"]: numpy.full(5, bent), names["K"]: k, names["R"]: numpy.eye(3).ravel(), names["P"]: p}
        return kind(
            header=self.header(stamp), height=size[1], width=size[0], distortion_model="plumb_bob", binning_x=0, binning_y=0, roi=roi, **arrays
        )

    def transform(self, stamp, parent, child, translation, quaternion):
        vector, turn = self.type("geometry_msgs/msg/Vector3"), self.type("geometry_msgs/msg/Quaternion")
        inner = self.type("geometry_msgs/msg/Transform")(vector(*translation), turn(*quaternion))
        return self.type("geometry_msgs/msg/TransformStamped")(self.header(stamp, parent), child, inner)

    def transforms(self, *all):
        return self.type("tf2_msgs/msg/TFMessage")(list(all))

    def pose(self, stamp, translation, quaternion=(0, 0, 0, 1)):
        point, turn = self.type("geometry_msgs/msg/Point"), self.type("geometry_msgs/msg/Quaternion")
        inner = self.type("geometry_msgs/msg/Pose")(point(*translation), turn(*map(float, quaternion)))
        return self.type("geometry_msgs/msg/PoseStamped")(self.header(stamp, "gel"), inner)


def write_bag(path, ros, messages, kind="mcap", compression=None):
    """Writes (topic, time, message) to a bag: its path."""
    if ros.version == 1:
        writer = rosbag1.Writer(path)
        if compression:
            writer.set_compression(getattr(rosbag1.Writer.CompressionFormat, compression))
    else:
        plugin = rosbag2.StoragePlugin.MCAP if kind == "mcap" else rosbag2.StoragePlugin.SQLITE3
        writer = rosbag2.Writer(path, version=9, storage_plugin=plugin)
        if compression:
            writer.set_compression(getattr(rosbag2.CompressionMode, compression), rosbag2.CompressionFormat.ZSTD)
    with writer:
        known = {}
        for topic, stamp, message in messages:
            if topic not in known:
                known[topic] = writer.add_connection(topic, message.__msgtype__, typestore=ros.store)
            data = (ros.store.serialize_ros1 if ros.version == 1 else ros.store.serialize_cdr)(message, message.__msgtype__)
            writer.write(known[topic], stamp, data)
    return path


def images(ros, **how):
    return [(TOPIC, stamp + 5, ros.image(stamp, frame, **how)) for stamp, frame in zip(STAMPS, FRAMES)]


def stems(topic=TOPIC):
    return [f"{topic.strip('/').replace('/', '_')}_{stamp}" for stamp in STAMPS]


@pytest.fixture(scope="module")
def expected(tmp_path_factory):
    """The images, depths and labels of the frames in npy files."""
    folder = tmp_path_factory.mktemp("npy")
    (folder / "frames").mkdir()
    for stem, frame in zip(stems(), FRAMES):
        numpy.save(folder / f"frames/{stem}.npy", frame)
    run("gelsim", "render", "--depth", "frames", "--depth-unit", "m", *PAD, "--out", "out", cwd=folder)
    return folder / "out"


def assert_same(found, expected, names=None):
    """The same files to the byte."""
    names = names or sorted(path.name for path in expected.iterdir())
    assert names and sorted(path.name for path in found.iterdir()) == names
    for name in names:
        assert (found / name).read_bytes() == (expected / name).read_bytes(), name


BAGS = [
    (1, "bag", None),
    (1, "bag", "BZ2"),
    (1, "bag", "LZ4"),
    (2, "mcap", None),
    (2, "mcap", "STORAGE"),
    (2, "sqlite3", None),
    (2, "sqlite3", "MESSAGE"),
]


@pytest.mark.parametrize("version, kind, compression", BAGS)
def test_a_bag_is_rendered_as_its_frames_in_files(tmp_path, expected, version, kind, compression):
    ros = Ros(version)
    bag = write_bag(tmp_path / ("run.bag" if version == 1 else "run"), ros, images(ros), kind, compression)
    run("gelsim", "render", "--depth", bag, *PAD, "--out", tmp_path / "out")
    assert_same(tmp_path / "out", expected)


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize("how", [{"pad": 12}, {"big": True}, {"pad": 4, "big": True}])
def test_rows_with_more_bytes_and_the_other_order_are_read(tmp_path, expected, version, how):
    ros = Ros(version)
    bag = write_bag(tmp_path / ("run.bag" if version == 1 else "run"), ros, images(ros, **how))
    run("gelsim", "render", "--depth", bag, "--topic", TOPIC, *PAD, "--out", tmp_path / "out")
    assert_same(tmp_path / "out", expected)


def test_nan_is_nothing_and_minus_infinity_is_refused(tmp_path, expected):
    ros = Ros(2)
    nothing = [numpy.where(numpy.isinf(frame), numpy.float32(numpy.nan), frame) for frame in FRAMES]
    messages = [(TOPIC, stamp, ros.image(stamp, frame)) for stamp, frame in zip(STAMPS, nothing)]
    run("gelsim", "render", "--depth", write_bag(tmp_path / "nan", ros, messages), *PAD, "--out", tmp_path / "out")
    assert_same(tmp_path / "out", expected)
    near = FRAMES[2].copy()
    near[3, 4] = -numpy.inf
    messages[2] = (TOPIC, STAMPS[2], ros.image(STAMPS[2], near))
    bag = write_bag(tmp_path / "near", ros, messages)
    said = run("gelsim", "render", "--depth", bag, *PAD, "--out", tmp_path / "none", status=2).stderr
    assert "minus infinity in row 3, column 4" in said and str(STAMPS[2]) in said
    assert not (tmp_path / "none").exists()


def flat(frame):
    """The frame in whole millimetres: what nothing was measured of is 0."""
    return numpy.where(numpy.isfinite(frame), numpy.round(frame * 1000), 0).astype("uint16")


@pytest.mark.parametrize("encoding", ["16UC1", "mono16"])
def test_whole_millimetres_need_no_unit_and_0_is_nothing(tmp_path, encoding):
    ros = Ros(2)
    # Ten units stand for a millimetre of the same scene, so that it has steps.
    frames = [flat(10 * frame) for frame in FRAMES]
    messages = [(TOPIC, stamp, ros.image(stamp, frame, encoding=encoding)) for stamp, frame in zip(STAMPS, frames)]
    bag = write_bag(tmp_path / "run", ros, messages)
    (tmp_path / "frames").mkdir()
    for stem, frame in zip(stems(), frames):
        numpy.save(tmp_path / f"frames/{stem}.npy", frame.astype("float64"))
    coarse = ["--plane-mm", "95", "--sensor", "gelsight-2014", "--no-contact-ok"]
    run("gelsim", "render", "--depth", bag, *coarse, "--out", tmp_path / "out")
    files = ["--depth", tmp_path / "frames", "--depth-unit", "mm", "--background-value", "0"]
    run("gelsim", "render", *files, *coarse, "--out", tmp_path / "same")
    assert_same(tmp_path / "out", tmp_path / "same")
    # A camera that counts otherwise: the option wins.
    said = run("gelsim", "render", "--depth", bag, "--depth-unit", "um", *coarse, "--out", tmp_path / "um", status=2).stderr
    assert "behind the pad" in said


def png(values):
    import io

    file = io.BytesIO()
    Image.fromarray(values).save(file, "PNG")
    return file.getvalue()


def test_compressed_depth_is_unpacked_in_both_encodings(tmp_path):
    ros = Ros(1)
    topic = TOPIC + "/compressedDepth"
    a, b = numpy.float32(10.0), numpy.float32(-100.0)
    steps = [numpy.where(numpy.isfinite(frame), numpy.round(a / frame + b), 0).astype("uint16") for frame in FRAMES]
    head = numpy.array([0], "<i4").tobytes() + numpy.array([a, b], "<f4").tobytes()
    messages = [(topic, stamp, ros.compressed(stamp, png(step), "32FC1; compressedDepth", head)) for stamp, step in zip(STAMPS, steps)]
    bag = write_bag(tmp_path / "float.bag", ros, messages)
    (tmp_path / "frames").mkdir()
    for stem, step in zip(stems(topic), steps):
        with numpy.errstate(divide="ignore"):
            metres = numpy.where(step > 0, a / (step.astype("float32") - b), numpy.float32(numpy.inf))
        assert metres.dtype == numpy.float32
        numpy.save(tmp_path / f"frames/{stem}.npy", metres)
    run("gelsim", "render", "--depth", bag, *PAD, "--out", tmp_path / "out")
    run("gelsim", "render", "--depth", tmp_path / "frames", "--depth-unit", "m", *PAD, "--out", tmp_path / "same")
    assert_same(tmp_path / "out", tmp_path / "same")
    whole = [(topic, stamp, ros.compressed(stamp, png(flat(frame)), "16UC1; compressedDepth png", bytes(12))) for stamp, frame in zip(STAMPS, FRAMES)]
    run("gelsim", "render", "--depth", write_bag(tmp_path / "whole.bag", ros, whole), *PAD, "--no-contact-ok", "--out", tmp_path / "mm")
    assert len(list((tmp_path / "mm").glob("*.tactile.png"))) == len(STAMPS)
    packed = [(topic, stamp, ros.compressed(stamp, b"\0" * 64, "16UC1; compressedDepth rvl", bytes(12))) for stamp in STAMPS]
    bag = write_bag(tmp_path / "rvl.bag", ros, packed)
    assert "RVL" in run("gelsim", "render", "--depth", bag, *PAD, "--out", tmp_path / "none", status=2).stderr


def seen(f_px, middle):
    """What a perspective camera 25 mm below the pad sees of a ball of 4 mm, 0.5 mm deep: metres along the axis."""
    x, y = (numpy.arange(160) + 0.5 - middle[0]) / f_px, (numpy.arange(120) + 0.5 - middle[1]) / f_px
    ray = numpy.stack([*numpy.meshgrid(x, y), numpy.ones((120, 160))], axis=-1)
    centre = numpy.array([0, 0, 25 - 0.5 + 4.0])
    a, half, c = (ray * ray).sum(-1), ray @ centre, centre @ centre - 16
    inside = half * half - a * c
    return (numpy.where(inside > 0, (half - numpy.sqrt(numpy.maximum(inside, 0))) / a, numpy.inf) / 1000).astype("float32")


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize("off", [(0.0, 0.0), (7.25, -3.5)])
def test_camera_info_says_how_the_rays_run(tmp_path, version, off):
    ros = Ros(version)
    f_px = 180.0
    frame = seen(f_px, (80 + off[0], 60 + off[1]))
    raw = frame.view("uint8").reshape(120, -1)
    image = ros.type("sensor_msgs/msg/Image")(
        header=ros.header(STAMPS[0]), height=120, width=160, encoding="32FC1", is_bigendian=0, step=raw.shape[1], data=raw.ravel()
    )
    info = ros.camera_info(STAMPS[0], f_px, f_px, 79.5 + off[0], 59.5 + off[1], size=(160, 120))
    messages = [("/gel/depth/camera_info", STAMPS[0], info), (TOPIC, STAMPS[0], image)]
    bag = write_bag(tmp_path / ("run.bag" if version == 1 else "run"), ros, messages)
    pad = ["--plane-mm", "25", "--sensor", "gelsight-2014"]
    run("gelsim", "render", "--depth", bag, *pad, "--out", tmp_path / "out")
    (tmp_path / "frames").mkdir()
    numpy.save(tmp_path / f"frames/{stems()[0]}.npy", frame)
    fov = repr(2 * math.degrees(math.atan(60 / f_px)))
    how = ["--depth-unit", "m", "--projection", "perspective", "--fov-y-deg", fov, f"--pixel-offset={off[0]},{off[1]}"]
    run("gelsim", "render", "--depth", tmp_path / "frames", *how, *pad, "--out", tmp_path / "same")
    name = f"{stems()[0]}.tactile.png"
    assert (tmp_path / "out" / name).read_bytes() == (tmp_path / "same" / name).read_bytes()
    # The press is where the axis meets the pad, wherever that is in the frame.
    label = json.loads((tmp_path / "out" / f"{stems()[0]}.json").read_text())
    assert label["contact"]["in_contact"] and max(map(abs, label["contact"]["centroid_mm"])) < 0.1


def test_the_commands_of_the_page_run_as_they_stand(project, tmp_path):
    ros = Ros(2)
    lines = re.findall(r"(?m)^    (gelsim render .*)$", (project / "docs/how-to/logs.md").read_text())
    assert len(lines) == 3
    for number, line in enumerate(lines):
        if "--pose-topic" in line:
            _, messages = slide(ros, tree=False)
        else:
            frame = seen(180.0, (80, 60))
            raw = frame.view("uint8").reshape(120, -1)
            image = ros.type("sensor_msgs/msg/Image")(
                header=ros.header(STAMPS[0]), height=120, width=160, encoding="32FC1", is_bigendian=0, step=raw.shape[1], data=raw.ravel()
            )
            info = ros.camera_info(STAMPS[0], 180.0, 180.0, 79.5, 59.5, size=(160, 120))
            messages = [("/gel/depth/camera_info", STAMPS[0], info), (TOPIC, STAMPS[0], image)]
        bag = write_bag(tmp_path / f"bag{number}", ros, messages)
        (tmp_path / "run.mcap").write_bytes(next(bag.glob("*.mcap")).read_bytes())
        run(*line.split(), cwd=tmp_path)
        assert (tmp_path / line.split()[-1]).exists()


def test_a_camera_that_cannot_be_used_is_refused_in_words(tmp_path):
    ros = Ros(2)
    info = "/gel/depth/camera_info"
    for name, camera, said in [
        ("stretched", ros.camera_info(STAMPS[0], 100.0, 110.0, 32.0, 24.0), "not square"),
        ("other", ros.camera_info(STAMPS[0], 100.0, 100.0, 320.0, 240.0, size=(640, 480)), "640x480"),
        ("empty", ros.camera_info(STAMPS[0], 0.0, 0.0, 0.0, 0.0), "not calibrated"),
    ]:
        bag = write_bag(tmp_path / name, ros, [(info, STAMPS[0], camera), *images(ros)])
        assert said in run("gelsim", "render", "--depth", bag, *PAD, "--out", tmp_path / "none", status=2).stderr


def test_missing_topics_are_told_with_those_that_are_there(tmp_path):
    ros = Ros(2)
    pose = [("/object", STAMPS[0], ros.pose(STAMPS[0], (0, 0, 0)))]
    bag = write_bag(tmp_path / "run", ros, images(ros) + pose)
    said = run("gelsim", "render", "--depth", bag, "--topic", "/gel/dept/image", *PAD, "--out", tmp_path / "none", status=2).stderr
    said = " ".join(said.split())
    assert f"is {TOPIC} meant?" in said and "sensor_msgs/Image, 32FC1, 5" in said and "/object (geometry_msgs/PoseStamped, 1)" in said
    two = write_bag(tmp_path / "two", ros, images(ros) + [("/other", STAMPS[0], ros.image(STAMPS[0], FRAMES[0]))])
    said = run("gelsim", "render", "--depth", two, *PAD, "--out", tmp_path / "none", status=2).stderr
    assert "2 topics of depth images" in said and TOPIC in said and "/other" in said


def slide(ros, tree):
    """Poses of a ball that is pressed in and slides, as PoseStamped or as a tree of transforms."""
    frames, messages = [], []
    for k, stamp in enumerate(STAMPS):
        x = 0.1 * k
        frames.append(ball(0.5, x))
        messages.append((TOPIC, stamp + 5, ros.image(stamp, frames[-1])))
        if not tree:
            messages.append(("/object", stamp, ros.pose(stamp, (x / 1000, 0.0, -0.0005))))
    if tree:
        # The sensor is upside down on a finger that moves; the object's poses are known between the frames.
        upside_down = (1.0, 0.0, 0.0, 0.0)
        messages.append(("/tf_static", STAMPS[0] - 10, ros.transforms(ros.transform(0, "finger", "gel", (0.01, 0.02, 0.03), upside_down))))
        for at in range(-1, 2 * len(STAMPS)):
            stamp = STAMPS[0] + 20_000_000 * at
            move, x = (0.003 * at, -0.001 * at, 0.002 * at), 0.05 * at / 1000
            # In the gel's frame the object is at (x, 0, -0.0005).
            local = numpy.array([x + 0.01, 0.02, 0.0005 + 0.03])
            object = numpy.array(move) + local
            both = [ros.transform(stamp, "world", "finger", move, (0.0, 0.0, 0.0, 1.0)), ros.transform(stamp, "world", "ball", tuple(object), upside_down)]
            messages.append(("/tf", stamp, ros.transforms(*both)))
    return frames, sorted(messages, key=lambda message: message[1])


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize("tree", [False, True])
def test_poses_of_the_log_carry_friction_as_a_table_does(tmp_path, version, tree):
    ros = Ros(version)
    frames, messages = slide(ros, tree)
    bag = write_bag(tmp_path / ("run.bag" if version == 1 else "run"), ros, messages)
    (tmp_path / "frames").mkdir()
    lines = ["file,quaternion_x,quaternion_y,quaternion_z,quaternion_w,x_mm,y_mm,z_mm"]
    for k, (stem, frame) in enumerate(zip(stems(), frames)):
        numpy.save(tmp_path / f"frames/{stem}.npy", frame)
        lines.append(f"{stem},0,0,0,1,{0.1 * k},0,-0.5")
    (tmp_path / "poses.csv").write_text("\n".join(lines) + "\n")
    where = ["--pose-topic", "/tf", "--sensor-frame", "gel", "--object-frame", "ball"] if tree else ["--pose-topic", "/object"]
    moved = ["--sequence", "0.5", *PAD]
    run("gelsim", "render", "--depth", bag, *where, *moved, "--out", tmp_path / "out")
    table = ["--depth-unit", "m", "--poses", tmp_path / "poses.csv", "--frame-rate-hz", "25"]
    run("gelsim", "render", "--depth", tmp_path / "frames", *table, *moved, "--out", tmp_path / "same")
    for stem in stems():
        found, same = (json.loads((tmp_path / folder / f"{stem}.json").read_text()) for folder in ("out", "same"))
        assert found["sequence"]["frame_rate_hz"] == pytest.approx(25)
        found, same = found["frame"], same["frame"]
        assert found["pose"]["translation_mm"] == pytest.approx(same["pose"]["translation_mm"], abs=1e-6)
        assert found["wrench"]["force_n"] == pytest.approx(same["wrench"]["force_n"], rel=1e-3, abs=1e-6)
    assert abs(found["wrench"]["force_n"][0]) > 0.01


def test_poses_that_begin_too_late_or_lead_nowhere_are_refused(tmp_path):
    ros = Ros(2)
    late = [("/object", STAMPS[1], ros.pose(STAMPS[1], (0, 0, 0)))]
    bag = write_bag(tmp_path / "late", ros, images(ros) + late)
    render = ["gelsim", "render", "--depth", bag, *PAD, "--out", tmp_path / "none"]
    assert "no pose is as early" in run(*render, "--pose-topic", "/object", status=2).stderr
    apart = [("/tf", STAMPS[0], ros.transforms(ros.transform(STAMPS[0], "a", "b", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))))]
    bag = write_bag(tmp_path / "apart", ros, images(ros) + apart)
    render = ["gelsim", "render", "--depth", bag, *PAD, "--out", tmp_path / "none", "--pose-topic", "/tf"]
    assert "--sensor-frame" in run(*render, status=2).stderr
    said = run(*render, "--sensor-frame", "a", "--object-frame", "c", status=2).stderr
    assert "lead" in said and "`c`" in said


def read_with_rosbags(path):
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        found = {}
        for connection, time, raw in reader.messages():
            found.setdefault(connection.topic, []).append((time, reader.deserialize(raw, connection.msgtype)))
        return found


LAYERS = ["--layers", "depth,contact,normal,pressure"]


@pytest.fixture(scope="module")
def tactile(tmp_path_factory):
    """A log that was rendered to a log, and the same to a folder."""
    folder = tmp_path_factory.mktemp("tactile")
    ros = Ros(2)
    bag = write_bag(folder / "run", ros, images(ros))
    run("gelsim", "render", "--depth", bag, *PAD, *LAYERS, "--out", folder / "tactile.mcap")
    run("gelsim", "render", "--depth", bag, *PAD, *LAYERS, "--set", "output.depth_format='npy'", "--out", folder / "out")
    return folder


def stamp_of(message):
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def check_messages(found, folder):
    """What is in the log is what is in the folder, in SI units, at the times of the frames."""
    assert set(found) == {f"/tactile/{name}" for name in ("image", "wrench", "markers", "label", "depth", "contact", "normal", "pressure")}
    for topic, messages in found.items():
        assert [time for time, _ in messages] == [stamp + 5 for stamp in STAMPS], topic
        if topic != "/tactile/label":
            assert [stamp_of(message) for _, message in messages] == STAMPS, topic
            assert {message.header.frame_id for _, message in messages} == {"tactile"}
    for k, stem in enumerate(stems()):
        at = {topic.split("/")[-1]: messages[k][1] for topic, messages in found.items()}
        image = numpy.asarray(Image.open(folder / f"{stem}.tactile.png"))
        data = numpy.frombuffer(bytes(at["image"].data), "uint8").reshape(image.shape)
        assert at["image"].encoding == "rgb8" and at["image"].step == 3 * WIDTH and (data == image).all()
        contact = numpy.frombuffer(bytes(at["contact"].data), "uint8").reshape(HEIGHT, WIDTH)
        assert at["contact"].encoding == "mono8" and (contact == numpy.asarray(Image.open(folder / f"{stem}.contact.png"))).all()
        for name, channels, factor in [("depth", 1, 1e-3), ("normal", 3, 1), ("pressure", 1, 1e3)]:
            layer = numpy.load(folder / f"{stem}.{name}.npy")
            values = numpy.frombuffer(bytes(at[name].data), "<f4").reshape(HEIGHT, WIDTH, channels).squeeze()
            assert at[name].encoding == f"32FC{channels}" and not at[name].is_bigendian
            numpy.testing.assert_allclose(values, layer.squeeze() * factor, rtol=1e-6)
        label = json.loads(at["label"].data)
        assert label == json.loads((folder / f"{stem}.json").read_text()) | {"png16": label["png16"]}
        force, torque = at["wrench"].wrench.force, at["wrench"].wrench.torque
        contact = label["contact"]
        assert force.z == pytest.approx(-contact["force_n"]) and force.x == force.y == 0
        # A ball's force is at the middle of its contact: N m, of mm and N.
        x, y = contact["centroid_mm"]
        near = 1e-4 * abs(force.z)
        assert torque.x == pytest.approx(1e-3 * y * force.z, abs=near) and torque.y == pytest.approx(-1e-3 * x * force.z, abs=near)
        assert torque.z == 0
        cloud = at["markers"]
        assert [field.name for field in cloud.fields] == ["x", "y", "z", "rest_u", "rest_v", "moved_u", "moved_v"]
        points = numpy.frombuffer(bytes(cloud.data), "<f4").reshape(-1, 7)
        assert len(points) == cloud.width == label["markers"]["count"] and cloud.point_step == 28 and cloud.height == 1
        motion = numpy.linalg.norm(points[:, 5:] - points[:, 3:5], axis=1)
        assert motion.max() == pytest.approx(label["markers"]["max_motion_px"], abs=1e-3)
        # 20 mm by 15 mm are seen, and the pad gives way by as much as the ball is deep.
        assert (numpy.abs(points[:, :2]).max(axis=0) <= [0.0105, 0.008]).all()
        assert -1e-3 <= points[:, 2].min() < -0.2e-4 * (2 + k) and points[:, 2].max() < 1e-4
        where = points[:, 5:] * [20 / WIDTH, 15 / HEIGHT] - [10, 7.5]
        numpy.testing.assert_allclose(1e3 * points[:, :2], where, atol=0.2)


def test_rosbags_reads_what_was_written(tactile):
    check_messages(read_with_rosbags(tactile / "tactile.mcap"), tactile / "out")


def test_the_mcap_library_reads_what_was_written(tactile):
    decoder = pytest.importorskip("mcap_ros2.decoder", reason="no mcap-ros2-support: pip install mcap-ros2-support")
    from mcap.reader import NonSeekingReader, SeekingReader

    for kind in (SeekingReader, NonSeekingReader):
        with open(tactile / "tactile.mcap", "rb") as file:
            reader = kind(file, validate_crcs=True, decoder_factories=[decoder.DecoderFactory()])
            found = {}
            for _, channel, message, decoded in reader.iter_decoded_messages():
                assert message.publish_time == message.log_time
                found.setdefault(channel.topic, []).append((message.log_time, decoded))
        check_messages(found, tactile / "out")
    with open(tactile / "tactile.mcap", "rb") as file:
        summary = SeekingReader(file).get_summary()
    assert summary.statistics.message_count == 8 * len(STAMPS)
    assert {schema.encoding for schema in summary.schemas.values()} == {"ros2msg"}
    assert {channel.message_encoding for channel in summary.channels.values()} == {"cdr"}


def test_frames_of_files_become_a_log_too_and_our_log_is_read_again(tmp_path, expected):
    frames = tmp_path / "frames"
    frames.mkdir()
    for k, frame in enumerate(FRAMES):
        numpy.save(frames / f"{k}.npy", frame)
    files = ["--depth", frames, "--depth-unit", "m", "--frame-rate-hz", "50"]
    run("gelsim", "render", *files, *PAD, "--out", tmp_path / "logs/tactile.mcap")
    found = read_with_rosbags(tmp_path / "logs/tactile.mcap")
    assert [time for time, _ in found["/tactile/image"]] == [20_000_000 * (k + 1) for k in range(len(FRAMES))]
    # Its depth is how far the ball is in the pad: metres, 0 where nothing is.
    again = ["--depth", tmp_path / "logs/tactile.mcap", "--topic", "/tactile/depth", "--plane-mm", "1", "--no-contact-ok"]
    run("gelsim", "render", *again, "--sensor", "gelsight-2014", "--background-value", "0", "--out", tmp_path / "out")
    assert len(list((tmp_path / "out").glob("tactile_depth_*.tactile.png"))) == len(FRAMES)
    said = run("gelsim", "render", *again, "--sensor", "gelsight-2014", "--out", tmp_path / "logs/tactile.mcap", status=2).stderr
    assert "would be written over" in said
    assert [path.name for path in (tmp_path / "logs").iterdir()] == ["tactile.mcap"]


def test_a_sequence_goes_into_a_log(tmp_path):
    ros = Ros(2)
    _, messages = slide(ros, tree=False)
    bag = write_bag(tmp_path / "run", ros, messages)
    moved = ["--sequence", "0.5", "--pose-topic", "/object", "--layers", "slip"]
    run("gelsim", "render", "--depth", bag, *moved, *PAD, "--out", tmp_path / "tactile.mcap")
    found = read_with_rosbags(tmp_path / "tactile.mcap")
    for (_, wrench), (time, label), stamp in zip(found["/tactile/wrench"], found["/tactile/label"], STAMPS):
        label = json.loads(label.data)["frame"]
        assert time == stamp + 5
        force, torque = wrench.wrench.force, wrench.wrench.torque
        assert [force.x, force.y, force.z] == label["wrench"]["force_n"]
        assert [torque.x, torque.y, torque.z] == pytest.approx([1e-3 * part for part in label["wrench"]["torque_nmm"]])
    assert len(found["/tactile/slip"]) == len(STAMPS)


@pytest.mark.parametrize("version, kind", [(1, "bag"), (2, "mcap"), (2, "sqlite3")])
def test_what_is_left_of_a_cut_log_is_rendered_with_a_warning(tmp_path, expected, version, kind):
    ros = Ros(version)
    bag = write_bag(tmp_path / ("run.bag" if version == 1 else "run"), ros, images(ros), kind)
    file = bag if version == 1 else next(path for path in bag.iterdir() if path.suffix in (".mcap", ".db3"))
    whole = file.read_bytes()
    cut = tmp_path / f"cut{file.suffix}"
    cut.write_bytes(whole[: len(whole) * 3 // 5])
    said = run("gelsim", "render", "--depth", cut, *PAD, "--out", tmp_path / "out").stderr
    assert "are lost" in said and str(len(whole) * 3 // 5) in said
    images_left = sorted(path.name for path in (tmp_path / "out").glob("*.tactile.png"))
    assert 0 < len(images_left) < len(STAMPS)
    for name in images_left:
        assert (tmp_path / "out" / name).read_bytes() == (expected / name).read_bytes()
    assert "are lost" in run("gelsim", "render", "--strict", "--depth", cut, *PAD, "--out", tmp_path / "none", status=1).stderr
    cut.write_bytes(whole[:200])
    assert "lost" in run("gelsim", "render", "--depth", cut, *PAD, "--out", tmp_path / "none", status=1).stderr
    assert not (tmp_path / "none").exists()
