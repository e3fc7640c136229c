"""SITR's sets: a folder for each sensor with calibration images, samples, depth maps and normals, as PNG of 224 x 224."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import Any, Optional

from gelsim._native import UsageError
from gelsim.dataset import Dataset, Raw, SensorSet
from gelsim.export import content, trees
from gelsim.needed import need
from gelsim.sample import Sample

LIBRARIES = ["numpy", "PIL.Image"]
HAS_FLOATS = True
"""Layers of floats are read for it."""

SIDE_PX = 224
FULL_SCALE_MM = 3.0
"""Displacement of the pad that is white in a depth map."""
PRESSES = 9
"""Of each of the two calibration objects."""


class Writer(trees.Tree):
    """Writes the parts."""

    # Its loader takes everything beside the sensors' folders for a sensor.
    SOURCE = "sensor_0000/gelsim.json"
    calibration: Path
    """Folder of the calibration presses."""

    def __init__(self, dataset: Dataset[Sample], folder: Path, out: Path, identity: dict[str, Any]) -> None:
        super().__init__(dataset, folder, out, identity)
        self.sensors = list(sensors_of(dataset))
        ends, self.firsts = dict.fromkeys(self.sensors, 0), []
        for shard, home in zip(dataset.shards, self.homes):
            self.firsts.append(ends[home.folder])
            ends[home.folder] += shard.samples

    def write(self, home: trees.Home, samples: Iterator[Raw]) -> dict[str, Any]:
        """Writes the samples of a shard."""
        sensor = self.sensors.index(home.folder)
        first = self.firsts[self.homes.index(home)]
        for number, raw in enumerate(samples, first):
            (pad,) = raw.pads
            surface = raw.layer(pad, "surface", 0)
            depth = need("numpy").clip(surface / FULL_SCALE_MM, 0.0, 1.0)
            self.put(sensor, "samples", number, raw.data(pad.files["tactile"], 0))
            self.put(sensor, "dmaps", number, png((depth * 255).astype("uint8")))
            self.put(sensor, "norms", number, png(normals(depth)))
        return {}

    def put(self, sensor: int, what: str, number: int, data: bytes) -> None:
        """Writes an image."""
        trees.put(self.tree / f"sensor_{sensor:04}/{what}/{number:04}.png", data)

    def close(self, parts: list[dict[str, Any]]) -> None:
        """Writes the calibration."""
        for sensor, dataset in enumerate(sensors_of(calibrating(self.calibration)).values()):
            for number, data in enumerate(calibration_images(dataset)):
                self.put(sensor, "calibration", number, data)


source = partial(trees.source, name=Writer.SOURCE)


def find_calibration(dataset: Dataset[Sample], named: Optional[Path]) -> Path:
    """The folder of the calibration presses: the one that is named, or that of the set. Raises if there is none."""
    own = dataset.set.get("calibration") if isinstance(dataset, SensorSet) else None
    if named is None and own is None:
        help = "generate with calibration = \"calibration-presses.toml\" under [sensors], as configs/pretrain-sitr.toml does"
        raise UsageError(f"sitr has calibration images of each sensor: {help}, or name the set of their presses with --calibration")
    return named or dataset.path / str(own)


def prepare(dataset: Dataset[Sample], calibration: Path) -> dict[str, Any]:
    """Raises if something is wanting. Gives what the copy says of its calibration."""
    presses = calibrating(calibration)
    if isinstance(presses, SensorSet) and not isinstance(dataset, SensorSet):
        name = dataset.path.name if dataset.path.name in presses.sensors else next(iter(presses.sensors))
        help = f"name one sensor's folder in it: {calibration / name}"
        raise UsageError(f"{calibration} is a set of sensors, and {dataset.path} of one: {help}")
    if isinstance(dataset, SensorSet) != isinstance(presses, SensorSet) or (
        isinstance(dataset, SensorSet) and isinstance(presses, SensorSet) and dataset.set["sensors"] != presses.set["sensors"]
    ):
        raise UsageError(f"{calibration} has other sensors than {dataset.path}: generate both with the same [sensors] and seed")
    for of_presses, of_samples in zip(sensors_of(presses).values(), sensors_of(dataset).values()):
        for each in [of_samples, of_presses]:
            raw = each.raw(0)
            if "sequence" in raw.label or len(raw.pads) > 1:
                raise UsageError(f"{each.path} has sequences or grips, and sitr single presses: take a job without them")
            its = raw.label["sensor"]
            if (its["width_px"], its["height_px"]) != (SIDE_PX, SIDE_PX):
                raise UsageError(f"{each.path}: sitr has images of 224 x 224 px: write resolution_px = [224, 224] under [sensor]")
        if "surface" not in of_samples.layers:
            raise UsageError(f'{of_samples.path} has no surface: generate with layers = ["surface"] under [output]')
        if raw.label["sensor"]["leds"] != of_samples.raw(0).label["sensor"]["leds"]:
            raise UsageError(f"{of_presses.path} has other light than {of_samples.path}: give both jobs one [sensor] and seed")
        calibration_images(of_presses)
    return content.identity(presses, "sitr")


def calibrating(folder: Path) -> Dataset[Sample]:
    """The presses of the calibration."""
    from gelsim.dataset import load

    return load(folder)


def sensors_of(dataset: Dataset[Sample]) -> dict[str, Dataset[Sample]]:
    """The dataset of each sensor by its folder; of one sensor the folder has no name."""
    return dataset.sensors if isinstance(dataset, SensorSet) else {"": dataset}


def calibration_images(dataset: Dataset[Sample]) -> list[bytes]:
    """The untouched pad, then nine presses of the first object, then nine of the second one, in the order of the job."""
    raws = sorted((dataset.raw(index) for index in range(len(dataset))), key=lambda raw: int(raw.label["index"]))
    names = list(dict.fromkeys(raw.label["object"]["id"] for raw in raws))
    of_each = [[raw for raw in raws if raw.label["object"]["id"] == name] for name in names]
    if len(names) != 2 or any(len(its) < PRESSES for its in of_each):
        said = ", ".join(f"{name}: {len(its)}" for name, its in zip(names, of_each))
        raise UsageError(f"{dataset.path}: a calibration for sitr has nine presses of each of two objects, not {said}")
    presses = [raw for its in of_each for raw in its[:PRESSES]]
    return [trees.untouched(raws[0], raws[0].pads[0]), *(raw.data(raw.pads[0].files["tactile"], 0) for raw in presses)]


def normals(depth: Any) -> Any:
    """Normals of a map of 0 to 1 as 8-bit RGB, by Sobel filters of 5 x 5 that are not scaled; edges are mirrored."""
    numpy = need("numpy")
    slope, smooth = numpy.array([-1.0, -2.0, 0.0, 2.0, 1.0]), numpy.array([1.0, 4.0, 6.0, 4.0, 1.0])
    wide = numpy.pad(depth.astype("float64"), 2, mode="reflect")

    def along(image: Any, kernel: Any, axis: int) -> Any:
        count = image.shape[axis] - 4
        return sum(weight * image.take(range(at, at + count), axis) for at, weight in enumerate(kernel))

    x = -along(along(wide, slope, 1), smooth, 0)
    y = -along(along(wide, slope, 0), smooth, 1)
    found = numpy.stack([x, y, numpy.ones_like(x)], axis=-1)
    found /= numpy.sqrt((found**2).sum(axis=-1, keepdims=True))
    return ((found + 1) / 2 * 255).astype("uint8")


def png(image: Any) -> bytes:
    """An image as PNG."""
    out = BytesIO()
    need("PIL.Image").fromarray(image).save(out, "PNG")
    return out.getvalue()
