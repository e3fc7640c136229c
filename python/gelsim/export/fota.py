"""T3's FoTa: for each dataset `train` and `val` with tars of JPEG images and JSON labels, and a count of them."""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

from gelsim import vectors
from gelsim.dataset import Dataset, Raw
from gelsim.export import trees
from gelsim.sample import Sample

LIBRARIES = ["numpy", "PIL.Image"]
HAS_FLOATS = False
"""Layers of floats are not read for it."""


class Writer(trees.Tree):
    """Writes the parts."""

    def write(self, home: trees.Home, samples: Iterator[Raw]) -> dict[str, Any]:
        """Writes a shard as one tar; its images are numbered without a gap within a split."""
        count = 0

        def members() -> Iterator[tuple[str, bytes]]:
            nonlocal count
            for raw in samples:
                for name, number, pad in trees.frames(raw):
                    yield f"{name}.jpg", trees.jpeg(raw.layer(pad, "tactile", number))
                    yield f"{name}.json", json.dumps(label(raw, pad.parts[number]), ensure_ascii=False).encode()
                    count += 1

        trees.write_tar(self.tree / home.folder / home.split / f"data-{home.number:06}.tar", members())
        return {"count": count}

    def close(self, parts: list[dict[str, Any]]) -> None:
        """Writes the counts."""
        for folder, split in {(part["folder"], part["split"]) for part in parts}:
            count = sum(part["count"] for part in parts if (part["folder"], part["split"]) == (folder, split))
            trees.put(self.tree / folder / split / "count.txt", f"{count}\n".encode())


source = partial(trees.source, name=Writer.SOURCE)


def prepare(dataset: Dataset[Sample]) -> None:
    """Any dataset has what it takes."""


def label(raw: Raw, part: dict[str, Any]) -> dict[str, Any]:
    """What T3 reads of a label, for its tasks of pose and class."""
    x, y, z, *quaternion = vectors.pose(part)
    its = raw.label["object"]
    return {
        "x_mm": x,
        "y_mm": y,
        "z_mm": z,
        **dict(zip(["quat_x", "quat_y", "quat_z", "quat_w"], quaternion)),
        "obj_idx": its["class_index"],
        "object_name": its["class"],
        "has_contact": bool(part["contact"]["in_contact"]),
    }


