"""Files that others write, damaged as disks, downloads and hostile people damage them, and given to the commands that
read them: logs of robots, depth frames, streams, sensor files with their pictures and tables, robots with their meshes,
folders of calibration, tables of forces, datasets. A command reads what is left or refuses it in words: it neither
panics nor hangs, takes little memory, ends with a documented status, and leaves nothing half-written.

    CASES=1000 pytest tests/python/test_damage.py --full -rP      so many damaged inputs for each source; without it 60
    SEED=3 CASES=1000 pytest ..                                   others
    pytest tests/python/test_damage.py --full -k png              a source
"""

import collections
import contextlib
import io
import os
import random
import re
import resource
import shutil
import socket
import struct
import subprocess
import tempfile
from pathlib import Path

import pytest

numpy = pytest.importorskip("numpy", reason="no numpy: pip install numpy")
Image = pytest.importorskip("PIL.Image", reason="no pillow: pip install pillow")

pytestmark = pytest.mark.full

PROJECT = Path(__file__).resolve().parents[2]
CASES, SEED = int(os.environ.get("CASES", 60)), int(os.environ.get("SEED", 1))
# A command may take so long on a busy machine, and so much address space.
PATIENCE_S, MOST_BYTES = 120, 6 << 30
# Largest message.
LONGEST = 20_000
NONSENSE = re.compile(r"panicked|which is a bug|it is a bug|Traceback|unwrap\(\)|\.rs:\d+")

NUMBERS = [b"0", b"-1", b"1e308", b"-1e-320", b"nan", b"inf", b"4294967295", b"18446744073709551616", b"1e999999", b"", b"1000000"]
BINARY = [0, 1, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 2**64 - 1, 2**63, 0x10000]


def damaged(data, others, chance):
    """A file after some accidents: of those of tests/fuzz/damage.rs one to seven."""
    data = bytearray(data)
    for _ in range(chance.choice([1, 1, 1, 2, 3, 7])):
        at, kind = chance.randrange(len(data) + 1), chance.choice("flip flip flip cut lose repeat splice number number binary binary".split())
        if kind == "flip" and at < len(data):
            data[at] ^= 1 << chance.randrange(8)
        elif kind == "cut":
            del data[at:]
        elif kind == "lose":
            del data[at : at + chance.randrange(1, 40)]
        elif kind == "repeat":
            data[at:at] = data[at : at + chance.randrange(1, 40)] * chance.randrange(1, 30)
        elif kind == "splice":
            other = chance.choice(others)
            start = chance.randrange(len(other) + 1)
            part = other[start : start + chance.randrange(1, 200)]
            data[at : at + len(part)] = part
        elif kind == "number" and (found := re.compile(rb"[0-9.-]+").search(data, at)):
            data[found.start() : found.end()] = chance.choice(NUMBERS)
        elif kind == "binary":
            size = chance.choice([1, 2, 4, 8])
            data[at : at + size] = (chance.choice(BINARY) % 2 ** (8 * size)).to_bytes(size, chance.choice(["little", "big"]))
    return bytes(data)


def ball(deep_mm=0.5, size=(32, 24)):
    """Distances in mm from a camera to a ball of 4 mm above the pad, which is at 10 mm."""
    x, y = (numpy.arange(count) + 0.5 - count / 2 for count in size)
    gap = 16 - (x[None, :] * 20 / size[0]) ** 2 - (y[:, None] * 15 / size[1]) ** 2
    return numpy.where(gap > 0, 14 - deep_mm - numpy.sqrt(numpy.maximum(gap, 0)), 60).astype("float32")


def picture(name, size=(32, 24), mode="RGB"):
    """A smooth picture in a format, as bytes."""
    x, y = numpy.meshgrid(numpy.arange(size[0]), numpy.arange(size[1]))
    values = numpy.stack([100 + 2 * x + y, 120 + x, 90 + 3 * y], axis=-1).clip(0, 255).astype("uint8")
    out = io.BytesIO()
    Image.fromarray(values).convert(mode).save(out, **FORMATS[name])
    return out.getvalue()


FORMATS = {
    "png": {"format": "PNG"},
    "jpeg": {"format": "JPEG", "quality": 90},
    "progressive": {"format": "JPEG", "progressive": True},
    "bmp": {"format": "BMP"},
    "tiff": {"format": "TIFF"},
    "lzw": {"format": "TIFF", "compression": "tiff_lzw"},
    "deflate": {"format": "TIFF", "compression": "tiff_adobe_deflate"},
    "webp": {"format": "WEBP", "quality": 80},
    "lossless": {"format": "WEBP", "lossless": True},
}
RENDER = "render --depth-unit mm --plane-mm 10 --sensor gelsight-2014 --out out --quiet --threads 1"


def log(version, kind, compression):
    def prepare(folder):
        logs = pytest.importorskip("test_logs", reason="no rosbags: pip install rosbags")
        ros = logs.Ros(version)
        messages = []
        for number in range(2):
            stamp, frame = logs.STAMPS[number], ball(0.3 + 0.1 * number) / 1000
            raw = frame.view("uint8").reshape(frame.shape[0], -1)
            image = ros.type("sensor_msgs/msg/Image")
            picture = image(header=ros.header(stamp), height=24, width=32, encoding="32FC1", is_bigendian=0, step=raw.shape[1], data=raw.ravel())
            messages += [("/depth/image", stamp, picture), ("/object", stamp, ros.pose(stamp, (0.0001 * number, 0.0, -0.0003)))]
        logs.write_bag(folder / ("log.bag" if version == 1 else "log"), ros, messages, kind, compression)
        source = "log.bag" if version == 1 else "log"
        return f"{RENDER.replace('--depth-unit mm', '')} --depth {source} --sequence 0.5 --pose-topic /object"

    return prepare


def frames(folder):
    (folder / "frames").mkdir()
    numpy.save(folder / "frames/a.npy", ball())
    numpy.savez(folder / "frames/b.npz", depth=ball(0.4))
    numpy.savez_compressed(folder / "frames/c.npz", ball(0.3))
    Image.fromarray((ball() * 100).astype("uint16")).save(folder / "frames/d.png")
    return f"{RENDER} --depth frames --background-value 60"


def poses(folder):
    frames(folder)
    for name in "cd":
        next((folder / "frames").glob(f"{name}.*")).unlink()
    (folder / "poses.csv").write_text("file,x_mm,y_mm,z_mm,quaternion_x,quaternion_y,quaternion_z,quaternion_w\na,0,0,-0.5,0,0,0,1\nb,0.1,0,-0.4,0,0,0,1\n")
    return f"{RENDER} --depth frames --background-value 60 --poses poses.csv --sequence 0.5 --frame-rate-hz 25"


def stream(*options):
    def prepare(folder):
        files = [io.BytesIO() for _ in range(3)]
        for number, file in enumerate(files):
            numpy.save(file, ball(0.3 + 0.1 * number))
        (folder / "stdin").write_bytes(b"".join(file.getvalue() for file in files))
        return f"{RENDER.replace('--out out', '').replace('--threads 1', '')} --stream --background-value 60 {' '.join(options)}"

    return prepare


MESH = "v -3 -3 2\nv 3 -3 2\nv 3 3 2\nv -3 3 2\nv 0 0 0\nf 5 1 2\nf 5 2 3\nf 5 3 4\nf 5 4 1\n"
JOB = """\
dataset = { name = "damaged", samples = 1 }
sensor = { file = "sensor.toml", resolution_px = [32, 24] }
object = [{ path = "stone.obj" }]
indentation.depth_mm = 0.5
"""
SENSOR = """\
preset = "gelsight-2014"
background = "rest.image"
gelpad_relaxation = [{ share = 0.2, time_s = 0.5 }]
window.distance_mm = 60.0
coat.albedo = 0.4
[[led]]
name = "bar"
position_mm = [0.0, -12.0, -5.0]
size_mm = [10.0, 1.0]
lobe = 1.0
color = [1.0, 0.1, 0.0]
intensity = 0.4
pattern = { red = [1.0, 0.1, -0.1] }
[markers]
file = "dots.csv"
"""


def sensor(format, folder):
    (folder / "job.toml").write_text(JOB)
    (folder / "stone.obj").write_text(MESH)
    (folder / "rest.image").write_bytes(picture(format))
    (folder / "sensor.toml").write_text(SENSOR)
    (folder / "dots.csv").write_text("x_mm,y_mm,diameter_mm\n" + "".join(f"{x},{x / 2},0.5\n" for x in range(-6, 7)))
    return "generate job.toml --out out --quiet --threads 1"


def robot(folder):
    package = folder / "packages/hand"
    (package / "meshes").mkdir(parents=True)
    (package / "package.xml").write_text('<?xml version="1.0"?>\n<package format="2"><name>hand_description</name></package>\n')
    (package / "meshes/tip.obj").write_text(MESH)
    vertices = [[-3, -3, 2], [3, -3, 2], [0, 3, 2], [0, 0, 0]]
    triangles = [[3, 0, 1], [3, 1, 2], [3, 2, 0]]
    data = b"\0" * 80 + struct.pack("<I", 3) + b"".join(struct.pack("<12fH", 0, 0, 0, *sum((vertices[k] for k in each), []), 0) for each in triangles)
    (package / "meshes/palm.stl").write_bytes(data)
    (folder / "hand.urdf").write_text(
        '<robot name="hand"><link name="palm"><visual><origin xyz="0 0 0.01" rpy="0 0 1.5"/><geometry>'
        '<mesh filename="package://hand_description/meshes/palm.stl" scale="0.001 0.001 0.001"/></geometry></visual></link>'
        '<link name="tip"><visual><geometry><mesh filename="package://hand_description/meshes/tip.obj" scale="0.001 0.001 0.001"/>'
        '</geometry></visual></link><joint name="j" type="revolute"><parent link="palm"/><child link="tip"/>'
        '<origin xyz="0 0 0.02" rpy="0 0 0"/><axis xyz="1 0 0"/><limit lower="0" upper="1" effort="1" velocity="1"/></joint></robot>'
    )
    return "inspect hand.urdf --packages packages"


def presses(folder, save):
    """Discs of a ball of 1.6 mm at seven places, each with what `save` writes of it."""
    rest = numpy.asarray(Image.open(io.BytesIO(picture("png", (48, 36)))), int)
    y, x = numpy.mgrid[:36, :48]
    for number in range(7):
        centre = numpy.array([10 + 4 * number, 18 + 3 * (-1) ** number])
        away = numpy.stack([x - centre[0], y - centre[1]])
        slope = numpy.where((away**2).sum(axis=0) < 49, away, 0)
        change = numpy.stack([6 * slope[0], 6 * slope[1], -4 * (slope[0] + slope[1])], axis=-1)
        save(number, centre, Image.fromarray((rest + change).clip(0, 255).astype("uint8")))
    return Image.fromarray(rest.astype("uint8"))


def gs_sdk(folder):
    data = folder / "data"
    catalog = ["experiment_reldir,diameter(mm)"]

    def save(number, centre, image):
        at = data / f"8.000mm/{number}"
        at.mkdir(parents=True)
        image.save(at / "gelsight.png")
        numpy.savez(at / "label.npz", center=centre.astype(float), radius=7.0)
        catalog.append(f"8.000mm/{number},8.0")

    presses(folder, save).save(data / "background.png")
    (data / "catalog.csv").write_text("\n".join(catalog) + "\n")
    (data / "gsmini.yaml").write_text('device_name: "GelSight Mini"\nppmm: 0.2 # mm per pixel\nimgh: 36\nimgw: 48\n')
    return "calibrate data --leds --thickness-mm 4 --keep-anyway --out out/mine.toml"


def py3dcal(folder):
    data, rows = folder / "data", ["img_name,x_mm,y_mm,penetration_depth_mm,x_px,y_px"]
    for name in ["probe_images", "annotations", "blank_images"]:
        (data / name).mkdir(parents=True)

    def save(number, centre, image):
        name = f"{number}_X{number}.0Y0.0Z3.0.png"
        image.save(data / "probe_images" / name)
        rows.append(f"{name},{number}.0,0.0,3.0,{centre[0]},{centre[1]}")

    presses(folder, save).save(data / "blank_images/blank.png")
    (data / "annotations/annotations.csv").write_text("\n".join(rows) + "\n")
    (data / "annotations/metadata.json").write_text('{\n    "px_per_mm": 5.0,\n    "probe_radius_mm": 1.6\n}')
    return "calibrate data --leds --thickness-mm 4 --keep-anyway --out out/mine.toml"


def forces(folder):
    (folder / "sensor.toml").write_text('preset = "gelsight-2014"\n')
    rows = ["press,ball_radius_mm,depth_mm,force_n,time_s"]
    for press in range(10):
        depth = 0.3 + 0.07 * press
        rows += [f"{press},4.0,{depth},{0.9 * depth**1.5 * (1 - 0.1 * k)},{0.5 * k}" for k in range(3)]
    (folder / "forces.csv").write_text("\n".join(rows) + "\n")
    return "calibrate --force forces.csv --sensor sensor.toml --keep-anyway --out out/mine.toml"


def pictures(folder):
    for name in ["ball", "cone"]:
        (folder / "real" / name).mkdir(parents=True)
        for number, format in enumerate(["png", "jpeg", "bmp", "tiff", "webp"]):
            (folder / f"real/{name}/{number}.{format}").write_bytes(picture(format))
    (folder / "augment.toml").write_text('[input]\npath = "real"\n[sensor]\npreset = "gelsight-2014"\n[[photometric]]\ncopies = 1\nexposure_ev = 0.2\n')
    return "augment augment.toml --out out --quiet --threads 1"


def dataset(folder, more="", name="out"):
    (folder / "stone.obj").write_text(MESH)
    job = JOB.replace("samples = 1", "samples = 4, samples_per_shard = 2").replace('file = "sensor.toml", ', "")
    job = job.replace("indentation.depth_mm = 0.5\n", "") if "[sequence]" in more else job
    (folder / "job.toml").write_text(f"{job}output.layers = ['depth', 'contact', 'reference', 'surface']\n{more}")
    done = subprocess.run(["gelsim", "generate", "job.toml", "--out", name, "--quiet"], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def exported(layout, more=""):
    def prepare(folder):
        dataset(folder, more, "data")
        return f"export data --to {layout} --out out --quiet"

    return prepare


SEQUENCE = """[sequence]
frame_rate_hz = 25.0
phase = [{ name = "press", duration_s = 0.08, depth_mm = 0.4 }, { name = "slide", duration_s = 0.04, x_mm = 0.3 }]
"""

SOURCES = {
    "bag of ROS 1": log(1, "bag", None),
    "bag of ROS 1, bz2": log(1, "bag", "BZ2"),
    "bag of ROS 1, lz4": log(1, "bag", "LZ4"),
    "mcap": log(2, "mcap", None),
    "mcap, zstd": log(2, "mcap", "STORAGE"),
    "sqlite": log(2, "sqlite3", None),
    "sqlite, zstd": log(2, "sqlite3", "MESSAGE"),
    "frames": frames,
    "poses": poses,
    "stream": stream(),
    "stream of parts": stream("--labels --layers surface,contact --on-broken-frame skip"),
    **{f"sensor, {name}": lambda folder, name=name: sensor(name, folder) for name in FORMATS},
    "robot": robot,
    "gs_sdk": gs_sdk,
    "py3DCal": py3dcal,
    "forces": forces,
    "pictures": pictures,
    "fota": exported("fota", "sensors.count = 2\n"),
    "ftp1": exported("ftp1"),
    "tacbench": exported("tacbench", SEQUENCE),
    "touchd": exported("touchd", SEQUENCE),
}


def run_in(folder, line):
    """Runs a command in little memory: its status, or "hangs", and what it said."""
    if line.startswith("export"):
        # It takes a second to import what an export needs.
        from gelsim.export import command

        words = line.replace(" data ", f" {folder}/data ").replace("--out out", f"--out {folder}/out").split()
        with contextlib.redirect_stderr(io.StringIO()) as said:
            return command.main(words[1:]), said.getvalue()
    limit = lambda: resource.setrlimit(resource.RLIMIT_AS, (MOST_BYTES, MOST_BYTES))
    program = ["gelsim", *line.split()]
    given = folder / "stdin"
    with contextlib.ExitStack() as stack:
        stdin = stack.enter_context(open(given, "rb")) if given.exists() else subprocess.DEVNULL
        out = stack.enter_context(open(folder / "stdout", "wb"))
        environment = {**os.environ, "RAYON_NUM_THREADS": "2", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        try:
            done = subprocess.run(
                program, cwd=folder, stdin=stdin, stdout=out, stderr=subprocess.PIPE, preexec_fn=limit, timeout=PATIENCE_S, env=environment
            )
        except subprocess.TimeoutExpired as late:
            return "hangs", (late.stderr or b"").decode(errors="replace")
    return done.returncode, done.stderr.decode(errors="replace")


def wrong_with(folder, line, status, said):
    """What is not as it should be, if anything is."""
    if status not in (0, 1, 2):
        return f"status {status}"
    if found := NONSENSE.search(said):
        return f"it says {found[0]!r}"
    if status and not re.search("^error: .", said, re.MULTILINE):
        return f"status {status} without words"
    if len(said) > LONGEST:
        return f"{len(said)} bytes of words"
    out = folder / "out"
    if status == 2 and out.exists():
        return "it is refused, and something is written"
    if status == 0 and " --out out" in line and not out.exists():
        return "status 0, and nothing is written"
    # Those of zarr are files like others.
    if hidden := [path.name for path in folder.rglob(".*") if not path.name.startswith(".z")]:
        return f"left behind: {hidden}"
    return None


@pytest.mark.parametrize("name", SOURCES)
def test_a_damaged_input_is_read_or_refused_in_words(gelsim_path, name):
    chance, ends = random.Random(f"{name} {SEED}"), collections.Counter()
    memory = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
    wrong = []
    with tempfile.TemporaryDirectory(dir=memory) as root:
        good, folder = Path(root) / "good", Path(root) / "damaged"
        good.mkdir()
        line = SOURCES[name](good)
        shutil.copytree(good, folder)
        status, said = run_in(folder, line)
        assert status == 0, said
        # What the formats were made of, too.
        inputs = sorted(path for path in good.rglob("*") if path.is_file() and path.name not in ("job.toml", "augment.toml", "stone.obj"))
        contents = [path.read_bytes() for path in inputs]
        for _ in range(CASES):
            shutil.rmtree(folder)
            shutil.copytree(good, folder)
            number = chance.randrange(len(inputs))
            data = damaged(contents[number], contents, chance)
            (folder / inputs[number].relative_to(good)).write_bytes(data)
            status, said = run_in(folder, line)
            ends[status] += 1
            if what := wrong_with(folder, line, status, said):
                kept = Path(tempfile.mkdtemp(prefix="damaged-"))
                shutil.copytree(folder, kept / "case")
                wrong.append(f"{what}: {inputs[number].relative_to(good)}, kept in {kept}/case: gelsim {line}\n    {said.strip()[:600]}")
                if len(wrong) == 5:
                    break
    print(f"{name}: {sum(ends.values())} damaged inputs: {ends[0]} read, {ends[1]} failed, {ends[2]} refused")
    assert not wrong, "\n".join(wrong)


def test_damaged_requests_and_jobs_do_not_end_the_watched_page(gelsim_path, tmp_path):
    """Every request gets an answer or none, a proper one still the page, whatever stands in the job meanwhile."""
    chance = random.Random(SEED)
    sensor("png", tmp_path)
    job = (tmp_path / "job.toml").read_bytes()
    line = [gelsim_path, "preview", "job.toml", "--watch"]
    with subprocess.Popen(line, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            address = process.stdout.readline().strip()
            port, token = re.fullmatch(r"http://127\.0\.0\.1:(\d+)/(\w+)/", address).groups()
            host = f"HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n"
            paths = ["", "script.js", "sheet?after=0", "label/0", "picture/0/0/0?width=64", "before/0/0/0"]
            requests = [f"GET /{token}/{path} {host}Accept: */*\r\n\r\n".encode() for path in paths]
            counts = collections.Counter()
            for number in range(CASES):
                if number % 10 == 0:
                    (tmp_path / "job.toml").write_bytes(damaged(job, [job, SENSOR.encode()], chance))
                answer = asked(int(port), damaged(chance.choice(requests), requests, chance))
                counts[answer.split(b"\r\n")[0].decode()] += 1
                assert answer == b"" or re.match(rb"HTTP/1\.1 (200|400|403|404|405) ", answer), answer[:200]
                if number % 10 == 9:
                    assert asked(int(port), requests[0]).startswith(b"HTTP/1.1 200 OK"), "the page is gone"
            (tmp_path / "job.toml").write_bytes(job)
            assert asked(int(port), requests[1]).startswith(b"HTTP/1.1 200 OK") and process.poll() is None
        finally:
            process.terminate()
            said = process.stderr.read()
    print(f"{sum(counts.values())} damaged requests: {dict(counts)}")
    assert process.returncode == 143 and not NONSENSE.search(said), said


def asked(port, request):
    """What the server answers; nothing if it closes the connection."""
    with socket.create_connection(("127.0.0.1", port), timeout=30) as connection, contextlib.suppress(ConnectionError):
        connection.sendall(request)
        # Half a request is one that was left.
        connection.shutdown(socket.SHUT_WR)
        return b"".join(iter(lambda: connection.recv(1 << 16), b""))
    return b""
