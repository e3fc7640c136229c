"""Times `gelsim inspect FOLDER` on a folder of 1,000 meshes that it writes.

    python tests/bench/inspect_set.py GELSIM [COUNT]

The meshes are dented balls of 2,000 to 50,000 triangles, in binary STL and OBJ by turns; one in fifty is cut off.
"""

import math
import pathlib
import struct
import subprocess
import sys
import tempfile
import time


def ball(rows, dents):
    """Rings of points from pole to pole, 20 mm across, and their triangles."""
    around = 2 * rows
    points = []
    for row in range(rows + 1):
        polar = math.pi * row / rows
        for k in range(around):
            turn = 2 * math.pi * k / around
            radius = 10 + 0.5 * math.sin(dents * polar) * math.cos(dents * turn)
            across = radius * math.sin(polar)
            points.append((across * math.cos(turn), across * math.sin(turn), radius * math.cos(polar)))
    triangles = []
    for row in range(rows):
        for k in range(around):
            a, b = row * around + k, row * around + (k + 1) % around
            triangles += [(a, a + around, b), (b, a + around, b + around)]
    return points, triangles


def write(folder, number):
    points, triangles = ball((22, 40, 70, 112)[number % 4], 2 + number % 7)
    if number % 2:
        text = "".join("v %.5f %.5f %.5f\n" % point for point in points)
        text += "".join("f %d %d %d\n" % (a + 1, b + 1, c + 1) for a, b, c in triangles)
        data, name = text.encode(), f"{number:04}.obj"
    else:
        facets = (struct.pack("<12fH", 0, 0, 0, *points[a], *points[b], *points[c], 0) for a, b, c in triangles)
        data, name = bytes(80) + struct.pack("<I", len(triangles)) + b"".join(facets), f"{number:04}.stl"
    (folder / name).write_bytes(data[: len(data) // 2] if number % 50 == 0 else data)
    return len(triangles)


def main():
    gelsim, count = sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 1000
    with tempfile.TemporaryDirectory() as name:
        triangles = sum(write(pathlib.Path(name), number) for number in range(count))
        start = time.perf_counter()
        ended = subprocess.run([gelsim, "inspect", name], capture_output=True, text=True)
        seconds = time.perf_counter() - start
    print(ended.stdout.splitlines()[-2], ended.stdout.splitlines()[-1], ended.stderr.strip(), sep="\n")
    print(f"{count} meshes of {triangles} triangles: {seconds:.1f} s")


if __name__ == "__main__":
    main()
