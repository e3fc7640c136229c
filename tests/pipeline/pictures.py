"""The program's PNG files in three decoders: Pillow's, OpenCV's (libpng), and zlib with the filters undone here.

    python3 tests/pipeline/pictures.py GELSIM

Random jobs of odd sizes, with noise and without; every picture must be the same in all three. Prints how long each of the two
libraries takes to read one of 640x480.
"""

import io
import pathlib
import random
import struct
import subprocess
import sys
import tempfile
import time
import zlib

import cv2
import numpy
from PIL import Image

SIZES = [(1, 1), (2, 9), (7, 1), (16, 12), (33, 65), (255, 3), (320, 240), (640, 480)]


def undone(data):
    """What is in a PNG without interlacing: rows, columns and channels."""
    at, stream = 8, b""
    while at < len(data):
        (length,), kind = struct.unpack(">I", data[at : at + 4]), data[at + 4 : at + 8]
        content = data[at + 8 : at + 8 + length]
        assert zlib.crc32(kind + content) == struct.unpack(">I", data[at + 8 + length : at + 12 + length])[0]
        if kind == b"IHDR":
            width, height, depth, color = struct.unpack(">IIBB", content[:10])
        if kind == b"IDAT":
            stream += content
        at += 12 + length
    channels = {0: 1, 2: 3}[color]
    rows = numpy.frombuffer(zlib.decompress(stream), numpy.uint8).reshape(height, -1)
    # Of every row: the difference to the one above.
    assert (rows[:, 0] == 2).all()
    pixels = numpy.cumsum(rows[:, 1:], axis=0, dtype=numpy.uint8)
    pixels = pixels.view(">u2") if depth == 16 else pixels
    return pixels.reshape(height, width, channels)


def read(data):
    """The same by Pillow and by OpenCV."""
    pillow = numpy.asarray(Image.open(io.BytesIO(data)))
    opencv = cv2.imdecode(numpy.frombuffer(data, numpy.uint8), cv2.IMREAD_UNCHANGED)
    opencv = opencv[..., ::-1] if opencv.ndim == 3 else opencv
    return [picture.reshape(*picture.shape[:2], -1) for picture in (pillow, opencv)]


def main():
    gelsim = pathlib.Path(sys.argv[1]).resolve()
    objects = pathlib.Path(__file__).resolve().parents[2] / "objects"
    folder = pathlib.Path(tempfile.mkdtemp())
    chance = random.Random(5)
    seen, largest = 0, None
    for number, (width, height) in enumerate(SIZES):
        for noise in (0.0, chance.uniform(0.5, 8.0)):
            (folder / "job.toml").write_text(f"""
[dataset]
name = "pictures"
samples = 3
seed = {number}
[sensor]
preset = "gelsight-2014"
resolution_px = [{width}, {height}]
[[object]]
path = "{objects}/*.obj"
[pose]
yaw_deg = [0.0, 360.0]
[indentation]
depth_mm = [0.2, 0.9]
[camera]
read_noise_levels = {noise}
[output]
layers = ["depth", "contact", "reference"]
depth_format = "png16"
container = "folder"
""")
            subprocess.run([gelsim, "generate", folder / "job.toml", "--quiet", "--overwrite", "--out", folder / "out"], check=True)
            for path in sorted((folder / "out").glob("data/*/*.png")):
                data = path.read_bytes()
                pixels, (pillow, opencv) = undone(data), read(data)
                assert (pixels == pillow).all() and (pixels == opencv).all(), path
                seen += 1
                if (width, path.name.endswith("tactile.png")) == (640, True):
                    largest = data
    print(f"{seen} pictures are the same in Pillow, OpenCV and zlib")
    for name, decode in [
        ("Pillow", lambda: numpy.asarray(Image.open(io.BytesIO(largest)))),
        ("OpenCV", lambda: cv2.imdecode(numpy.frombuffer(largest, numpy.uint8), cv2.IMREAD_UNCHANGED)),
    ]:
        times = []
        for _ in range(30):
            start = time.perf_counter()
            decode()
            times.append(1e3 * (time.perf_counter() - start))
        print(f"{name}: {min(times):.1f} ms for 640x480, {len(largest) / 1e3:.0f} kB")


main()
