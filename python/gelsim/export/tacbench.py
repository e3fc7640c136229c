"""TacBench's force and slip, as Sparsh reads them: a batch for each shard and class, with pickles of images, forces and slip."""

from __future__ import annotations

import pickle
from collections.abc import Iterator
from functools import partial
from typing import Any

from gelsim import vectors
from gelsim.dataset import Dataset, Pad, Raw, SensorSet
from gelsim.export import trees
from gelsim.needed import need
from gelsim.sample import Sample

LIBRARIES = ["numpy", "PIL.Image"]
HAS_FLOATS = False
"""Layers of floats are not read for it."""


class Writer(trees.Tree):
    """Writes the parts."""

    def write(self, home: trees.Home, samples: Iterator[Raw]) -> dict[str, Any]:
        """Writes a shard as a batch of each class in it."""
        batches: dict[tuple[str, str], Batch] = {}
        for raw in samples:
            for pad in raw.pads:
                sensor = trees.family(pad.label["sensor"]["name"], "tacbench")
                name = (sensor, raw.label["object"]["class"])
                if name not in batches:
                    batches[name] = Batch(trees.untouched(raw, pad))
                batches[name].add(raw, pad)
        number = self.homes.index(home) + 1
        for (sensor, of_class), batch in batches.items():
            folder = self.tree / "T1_force" / sensor / of_class / f"batch_{number}"
            trees.put(folder / f"dataset_{sensor}_00.pkl", pickle.dumps(batch.images, 4))
            trees.put(folder / "dataset_slip_forces.pkl", pickle.dumps(batch.slip_forces(), 4))
        return {}


source = partial(trees.source, name=Writer.SOURCE)


def prepare(dataset: Dataset[Sample]) -> None:
    """Raises if something is wanting."""
    trees.check_forces(dataset, "tacbench")
    for each in dataset.sensors.values() if isinstance(dataset, SensorSet) else [dataset]:
        for of_class in each.classes:
            trees.name_of_folder(of_class, "class")


class Batch:
    """Images one after another, the untouched one first, and the trajectories in them."""

    def __init__(self, untouched: bytes) -> None:
        self.images = [untouched]
        self.in_contact = [0]
        self.trajectories: list[dict[str, Any]] = []

    def add(self, raw: Raw, pad: Pad) -> None:
        """Adds a sequence."""
        numpy, first = need("numpy"), len(self.images)
        self.images += [raw.data(pad.files["tactile"], number) for number in range(len(raw))]
        self.in_contact += [int(part["contact"]["in_contact"]) for part in pad.parts]
        self.trajectories.append(
            {
                "indexes": numpy.arange(first, len(self.images)),
                "forces": numpy.array([vectors.wrench(part)[:3] for part in pad.parts]),
                "slip_label": numpy.array([int(part["slip"]["state"] == "gross") for part in pad.parts]),
            }
        )

    def slip_forces(self) -> dict[str, Any]:
        """What stands in `dataset_slip_forces.pkl`."""
        return {"in_contact": need("numpy").array(self.in_contact), "trajectories": self.trajectories}
