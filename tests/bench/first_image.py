"""Times `gelsim render --stream` from the start of the program to its first image of 320x240 px, the shortest of five.

    python tests/bench/first_image.py GELSIM
"""

import struct
import subprocess
import sys
import time

WIDTH, HEIGHT = 320, 240


def make_frame():
    """A ball of 4 mm, pressed in by 0.5 mm, as depths in metres in an npy file."""
    header = f"{{'descr': '<f4', 'fortran_order': False, 'shape': ({HEIGHT}, {WIDTH}), }}"
    header += " " * (-(len(header) + 11) % 64) + "\n"
    depths = []
    for row in range(HEIGHT):
        for column in range(WIDTH):
            square = 16 - ((column + 0.5 - WIDTH / 2) / 16) ** 2 - ((row + 0.5 - HEIGHT / 2) / 16) ** 2
            depths.append((13.5 - square**0.5 if square > 0 else 60) / 1e3)
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header.encode() + struct.pack(f"<{len(depths)}f", *depths)


def time_once(gelsim, frame):
    line = [gelsim, *"render --stream --depth-unit m --plane-mm 10 --sensor gelsight-2014 --quiet".split()]
    start = time.perf_counter()
    done = subprocess.run(line, input=frame, capture_output=True, check=True)
    assert len(done.stdout) == 128 + 3 * WIDTH * HEIGHT
    return 1e3 * (time.perf_counter() - start)


if __name__ == "__main__":
    frame = make_frame()
    print(f"the first image {min(time_once(sys.argv[1], frame) for _ in range(5)):.0f} ms after the start")
