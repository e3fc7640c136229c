"""FTP-1's Zarr, as Open-X-Tactile has it: for each sensor a folder with a `.zarr` of each shard."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

from gelsim.dataset import Dataset, Raw
from gelsim.export import trees
from gelsim.export.zarr_v2 import Written, make_group
from gelsim.needed import need
from gelsim.sample import Sample

LIBRARIES = ["numpy", "PIL.Image", "pyarrow"]
HAS_FLOATS = False
"""Layers of floats are not read for it."""

SIDE = "right"
"""The hand that has the sensors; its loader leaves out a hand without joints."""
GRIPPER_SLOT = 28
"""Index of a gripper's opening among the joints of a hand."""
AREAS = [0, 1]
"""The pad of the thumb, and that of the index finger."""
ENCODED = {"gelsight-mini": "GelSightMini", "digit": "DIGIT"}
"""Sensors that its tactile encoder was trained on, by the names of presets."""
CAMERA_PX = 16
"""Side of the black picture in place of a camera's, without which its loader refuses an episode."""


class Writer(trees.Tree):
    """Writes the parts."""

    def write(self, home: trees.Home, samples: Iterator[Raw]) -> dict[str, Any]:
        """Writes a shard."""
        numpy = need("numpy")
        root = self.tree / (home.folder or trees.name_of_folder(self.dataset.name, "dataset")) / f"{home.split}-{home.number:06}.zarr"
        # One that was begun before the export was killed.
        shutil.rmtree(root, ignore_errors=True)
        for group in [root, root / "data", root / "meta"]:
            make_group(group)
        shapes: dict[str, tuple[int, ...]] = {}
        sensors: list[list[str]] = []
        ends: list[int] = []
        times: list[float] = []
        opening: list[float] = []
        tasks: list[str] = []
        for raw in samples:
            for number in range(len(raw)):
                for at, pad in enumerate(raw.pads):
                    name = f"{SIDE}_tactile_data_pad{at}"
                    image = raw.layer(pad, "tactile", number)[None]
                    shapes[name] = image.shape
                    array(root, name).put(len(times), image[None])
                frame = raw.label["frames"][number] if "sequence" in raw.label else raw.label
                sensors.append([ENCODED.get(pad.label["sensor"]["name"], pad.label["sensor"]["name"]) for pad in raw.pads])
                times.append(float(frame.get("t_s", 0.0)))
                opening.append(1e-3 * float(frame.get("gripper", raw.label.get("gripper", {})).get("width_mm", 0.0)))
                tasks.append(f"touch the {raw.label['object']['class']}")
            ends.append(len(times))
        count = len(times)
        for name, shape in shapes.items():
            array(root, name).make((count, *shape), numpy.dtype("uint8"), {"unit": "8-bit RGB"})
        columns = {
            "timestamps": numpy.array(times),
            "sub_task_instruction": numpy.array(tasks),
            f"{SIDE}_hand_joints": numpy.array(opening)[:, None],
            f"{SIDE}_hand_joints_idx": numpy.full((count, 1), GRIPPER_SLOT),
        }
        for at in range(len(shapes)):
            columns[f"{SIDE}_tactile_area_pad{at}"] = numpy.full((count, 1), AREAS[at])
            columns[f"{SIDE}_tactile_sensor_pad{at}"] = numpy.array([each[at] for each in sensors])
            columns[f"{SIDE}_tactile_type_pad{at}"] = numpy.full(count, "image")
        for name, rows in columns.items():
            Written(root / "data" / name, count).make(rows.shape, rows.dtype, {}).put(0, rows)
        # Without chunks, an array is black.
        array(root, "camera_main_rgb").make((count, CAMERA_PX, CAMERA_PX, 3), numpy.dtype("uint8"), {"unit": "no camera"})
        Written(root / "meta/episode_ends", len(ends)).make((len(ends),), numpy.dtype("int64"), {}).put(0, numpy.array(ends))
        return {}


source = partial(trees.source, name=Writer.SOURCE)


def prepare(dataset: Dataset[Sample]) -> None:
    """Raises for a name that no folder can have."""
    trees.name_of_folder(dataset.name, "dataset")


def array(root: Path, name: str) -> Written:
    """An array of images, one in a chunk."""
    (root / "data" / name).mkdir(parents=True, exist_ok=True)
    return Written(root / "data" / name, 1)
