"""The force part of ToucHD, as AnyTouch 2 reads it: a folder for each sample with one for each sensor, and a list of forces."""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import partial
from typing import Any

from gelsim import vectors
from gelsim.dataset import Dataset, Pad, Raw, SensorSet
from gelsim.export import trees
from gelsim.sample import Sample

LIBRARIES = ["numpy", "PIL.Image"]
HAS_FLOATS = False
"""Layers of floats are not read for it."""


class Writer(trees.Tree):
    """Writes the parts."""

    def write(self, home: trees.Home, samples: Iterator[Raw]) -> dict[str, Any]:
        """Writes the images of a shard; the first one of each folder is untouched."""
        forces: list[Any] = []
        for raw in samples:
            name = f"obj{raw.label['object']['class_index'] + 1}_speed1_{raw.files.key}"
            for pad in raw.pads:
                sensor = name_of(pad, home.folder)
                folder = self.tree / name / sensor
                trees.put(folder / "image_1.png", trees.untouched(raw, pad))
                rows = []
                for number, part in enumerate(pad.parts):
                    trees.put(folder / f"image_{number + 2}.png", raw.data(pad.files["tactile"], number))
                    rows.append([number + 2, *vectors.wrench(part)[:3]])
                forces.append([name, sensor, rows])
        return {"forces": forces}

    def close(self, parts: list[dict[str, Any]]) -> None:
        """Writes the forces."""
        found: dict[str, dict[str, Any]] = {}
        for name, sensor, rows in (each for part in parts for each in part["forces"]):
            found.setdefault(name, {})[sensor] = rows
        text = json.dumps(found, sort_keys=True, ensure_ascii=False)
        trees.put(self.tree / "all_data_direction.json", text.encode())


source = partial(trees.source, name=Writer.SOURCE)


def prepare(dataset: Dataset[Sample]) -> None:
    """Raises if something is wanting."""
    trees.check_forces(dataset, "touchd")
    for pad in [] if isinstance(dataset, SensorSet) else dataset.raw(0).pads:
        name_of(pad)


def name_of(pad: Pad, folder: str = "") -> str:
    """The name of a sensor's folder; `folder` is that of a sensor in a set."""
    name = folder or pad.label["sensor"]["name"]
    return trees.name_of_folder(f"{name}-{pad.finger}" if pad.finger else name, "sensor")
