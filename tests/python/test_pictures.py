"""The program's PNG files in three decoders: Pillow's, OpenCV's (libpng), and zlib with the filters undone here."""

import io
import random
import struct
import zlib

import pytest

for name, package in [("numpy", "numpy"), ("PIL", "pillow"), ("cv2", "opencv-python-headless")]:
    pytest.importorskip(name, reason=f"no {package}: pip install {package}")

import cv2
import numpy
from PIL import Image

# Random noise for each size, beside none.
SIZES = [(1, 1), (2, 9), (7, 1), (16, 12), (33, 65), (255, 3), (320, 240), (640, 480)]
CHANCE = random.Random(5)
CASES = [(size, noise) for size in SIZES for noise in (0.0, CHANCE.uniform(0.5, 8.0))]

JOB = """
dataset = {{ name = "pictures", samples = 3, seed = {seed} }}
sensor = {{ preset = "gelsight-2014", resolution_px = [{width}, {height}] }}
object = [{{ path = "{objects}/*.obj" }}]
pose.yaw_deg = [0.0, 360.0]
indentation.depth_mm = [0.2, 0.9]
camera.read_noise_levels = {noise}
output = {{ layers = ["depth", "contact", "reference"], depth_format = "png16", container = "folder" }}
"""


@pytest.fixture(scope="module", params=CASES, ids=lambda case: "{}x{} px, noise {:.1f}".format(*case[0], case[1]))
def pictures(request, run_gelsim, project, tmp_path_factory):
    """All PNG files of a job by their names."""
    (width, height), noise = request.param
    folder = tmp_path_factory.mktemp("pictures")
    seed, objects = SIZES.index((width, height)), project / "objects"
    (folder / "job.toml").write_text(JOB.format(seed=seed, width=width, height=height, objects=objects, noise=noise))
    out = run_gelsim.generate("job.toml", folder / "out", cwd=folder)
    found = {path.name: path.read_bytes() for path in sorted(out.glob("data/*/*.png"))}
    assert len(found) >= 3
    return found


def chunks(data):
    """Kind, content and checksum of each part of a PNG."""
    at = 8
    while at < len(data):
        (length,) = struct.unpack(">I", data[at : at + 4])
        content, checksum = data[at + 8 : at + 8 + length], data[at + 8 + length : at + 12 + length]
        yield data[at + 4 : at + 8], content, struct.unpack(">I", checksum)[0]
        at += 12 + length


def decode(data):
    """What is in a PNG that is not interlaced, each row the difference to the one above: rows, columns and channels."""
    stream = b""
    for kind, content, _ in chunks(data):
        if kind == b"IHDR":
            width, height, depth, color = struct.unpack(">IIBB", content[:10])
        if kind == b"IDAT":
            stream += content
    rows = numpy.frombuffer(zlib.decompress(stream), numpy.uint8).reshape(height, -1)
    assert (rows[:, 0] == 2).all(), "not all rows have the filter Up"
    pixels = numpy.cumsum(rows[:, 1:], axis=0, dtype=numpy.uint8)
    pixels = pixels.view(">u2") if depth == 16 else pixels
    return pixels.reshape(height, width, {0: 1, 2: 3}[color])


def test_checksums_of_all_parts_are_right(pictures):
    for name, data in pictures.items():
        for kind, content, checksum in chunks(data):
            assert zlib.crc32(kind + content) == checksum, (name, kind)


def assert_decoded(name, data, picture):
    assert numpy.array_equal(picture.reshape(*picture.shape[:2], -1), decode(data)), name


def test_pillow_reads_what_zlib_does(pictures):
    for name, data in pictures.items():
        assert_decoded(name, data, numpy.asarray(Image.open(io.BytesIO(data))))


def test_opencv_reads_what_zlib_does(pictures):
    for name, data in pictures.items():
        found = cv2.imdecode(numpy.frombuffer(data, numpy.uint8), cv2.IMREAD_UNCHANGED)
        assert_decoded(name, data, found[..., ::-1] if found.ndim == 3 else found)
