"""Times `gelsim.load` and `gelsim-export` on a dataset.

    python tests/bench/loading.py DATASET        where the wheel is installed with the extra `export`

Prints how many samples a second are loaded, in order and at random, and what each export says of itself, with its memory.
"""

import os
import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import gelsim

# What copies are called, and their formats.
COPIES = {"copy.lerobot": "lerobot", "copy.zarr": "zarr", "copy.zarr.zip": "zarr", "copy.hdf5": "hdf5"}


def time_loading(folder):
    dataset = gelsim.load(folder)
    order = list(range(len(dataset)))
    for how in ["in order", "at random"]:
        start = time.monotonic()
        for index in order:
            dataset[index]
        print(f"load {how}: {len(dataset) / (time.monotonic() - start):.0f} samples/s on one core", flush=True)
        random.Random(1).shuffle(order)


def time_exports(folder):
    for name, form in COPIES.items():
        with tempfile.TemporaryDirectory() as temporary:
            line = [sys.executable, "-m", "gelsim.export.command", folder, "--to", form, "--out", str(Path(temporary) / name)]
            for more in [[], ["--check"]]:
                process = subprocess.Popen([*line, *more], stderr=subprocess.PIPE, text=True)
                said = process.stderr.read().rsplit(": ", 1)[-1].strip()
                _, status, used = os.wait4(process.pid, 0)
                assert status == 0, said
                print(f"{name} {' '.join(more) or 'export'}: {said}, {used.ru_maxrss / 1e3:.0f} MB of memory", flush=True)


if __name__ == "__main__":
    time_loading(sys.argv[1])
    time_exports(sys.argv[1])
