"""What every format holds of a sample, and in which units."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from gelsim import vectors
from gelsim.dataset import Dataset, Pad, Raw, SensorSet
from gelsim.needed import need
from gelsim.sample import Sample

if TYPE_CHECKING:
    from numpy.typing import NDArray

Arrays = dict[str, Any]
"""Arrays of one frame by name."""

UNITS = {
    "tactile": "8-bit RGB",
    "reference": "8-bit RGB: the image without contact",
    "depth": "mm below the undeformed pad, 0 where the object does not reach",
    "surface": "mm, displacement of the pad's surface, positive towards the camera",
    "contact": "255 where the pad touches",
    "normal": "unit normals X, Y, Z of the pad's surface, towards the camera",
    "pressure": "kPa, normal to the pad",
    "gap": "mm between pad and object; 0 in contact, -1 where no object is within reach",
    "lamps": "grey image under each lamp A to F, 0 to 1",
    "instance": "number of the object that the pad touches, from 1 in the label's objects; 0 elsewhere",
    "slip": "128 where the pad sticks to the object, 255 where it slips",
    "flow": "mm, motion of the pad's surface to the right and down",
    "traction": "kPa, force of the object on the pad by area: X to the right, Y down, Z into the pad",
    "points": "mm in the sensor's frame, X, Y, Z of the pad's surface",
    "untouched": "8-bit RGB: the image without contact at another moment, with noise of its own",
    "markers/rest_px": "px; the first pixel's centre is at (0.5, 0.5)",
    "markers/moved_px": "px; the first pixel's centre is at (0.5, 0.5)",
    "pins/rest_px": "px; the first pixel's centre is at (0.5, 0.5)",
    "pins/moved_px": "px; the first pixel's centre is at (0.5, 0.5)",
    "pins/rest_mm": "mm in the sensor's frame",
    "pins/moved_mm": "mm in the sensor's frame",
    "wrench": "N (x, y, z) and N mm (x, y, z) of the object on the pad, in the sensor's frame; NaN where it is not known",
}
"""Of each array; poses differ from format to format."""

POSE = "p = R (scale q) + t takes a point q of the mesh to the sensor's frame; scale is the label's object.scale"
"""What a pose does."""

FRAME = (
    "Right-handed, the camera's: x to the right, y down, z out of the pad towards the object; "
    "its origin is the middle of the image on the undeformed pad."
)
"""The frame of poses and wrenches."""


def identity(dataset: Dataset[Sample], to: str) -> dict[str, Any]:
    """What a copy says about where it comes from: equal for equal sources."""
    of_each = dataset.sensors.values() if isinstance(dataset, SensorSet) else [dataset]
    manifest = b"".join((each.path / "dataset.json").read_bytes() for each in of_each)
    return {
        # LeRobot's has float layers, markers and pins since 2.
        "exporter": 2 if to == "lerobot" else 1,
        "to": to,
        "name": dataset.name,
        "fingerprint": dataset.fingerprint,
        "dataset_json_sha256": hashlib.sha256(manifest).hexdigest(),
    }


def presets_drawn(dataset: Dataset[Sample]) -> list[str]:
    """The presets of which each sample has one, by the job; none of a dataset of one sensor."""
    try:
        job = (dataset.path / "job.toml").read_text("utf-8")
    except (OSError, ValueError):
        return []
    listed = re.search(r"^preset = \[(.*?)\]", job, re.MULTILINE | re.DOTALL)
    return re.findall('"([^"]*)"', listed[1]) if listed else []


def telling(dataset: Dataset[Sample]) -> Iterator[Raw]:
    """The samples that show which sensors there are: all where each has one of several presets, else the first."""
    return (dataset.raw(index) for index in range(len(dataset) if presets_drawn(dataset) else 1))


def sensors(dataset: Dataset[Sample]) -> list[str]:
    """The name of each pad's sensor, `digit|gelsight-mini` where samples have one or the other."""
    each = zip(*([pad.label["sensor"]["name"] for pad in raw.pads] for raw in telling(dataset)))
    return ["|".join(sorted(set(names))) for names in each]


def layers(raw: Raw, pad: Pad, number: int) -> Arrays:
    """The arrays of one sensor in frame `number`, markers and pins as `markers/rest_px` and so on."""
    flat: Arrays = {}
    for name, value in raw.layers(pad, number).items():
        flat |= {f"{name}/{key}": each for key, each in value.items()} if isinstance(value, dict) else {name: value}
    return flat


def poses(pad: Pad) -> NDArray[Any]:
    """Float64 (T, 7), `gelsim.vectors.POSE`."""
    found: NDArray[Any] = need("numpy").array([vectors.pose(part) for part in pad.parts])
    return found


def wrenches(pad: Pad) -> NDArray[Any]:
    """Float64 (T, 6), `gelsim.vectors.WRENCH`."""
    found: NDArray[Any] = need("numpy").array([vectors.wrench(part) for part in pad.parts])
    return found


def frame_rate_hz(raw: Raw) -> float:
    """Frames a second; 1 of presses, whose episodes have one frame."""
    return float(raw.label["sequence"]["frame_rate_hz"]) if "sequence" in raw.label else 1.0
