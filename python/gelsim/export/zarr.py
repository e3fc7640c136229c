"""Zarr v2: arrays over all frames, as replay buffers have them. Images are written where they stay; what is small waits in
the parts of an export and is written at its end."""

from __future__ import annotations

import json
import shutil
import zipfile
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from typing import Any

from gelsim import vectors
from gelsim.dataset import Dataset, Raw
from gelsim.export import content
from gelsim.export.content import Arrays
from gelsim.export.parts import Place, write
from gelsim.needed import need
from gelsim.vectors import WRENCH

PAD = "pad0"
"""The first pad, and of a dataset of gelsim the only one."""
POSE = ["x_mm", "y_mm", "z_mm", "rx_rad", "ry_rad", "rz_rad"]
POSE_UNIT = "mm (x, y, z) and rotation vector in radians: p = R q + t takes a point of the mesh to the sensor's frame"
META = {
    "episode_ends": "frames before the end of each episode",
    "label_ends": "bytes of label_json before the end of each episode's",
    "label_json": "the labels' JSON, one after another, UTF-8",
    "class_index": "of each episode; the root's attribute classes has the names",
    "index": "the sample's number in its job, of each episode",
}
BYTES_IN_CHUNK = 1 << 18
"""Of arrays of small rows."""


def libraries() -> None:
    """Raises ImportError with a way out if one is missing."""
    for library in ["zarr", "numcodecs"]:
        need(library, "export")


def source(out: Path) -> Any:
    """The identity of a finished copy; None if `out` is none."""
    try:
        if out.is_dir():
            return json.loads((out / ".zattrs").read_bytes())["gelsim"]
        with zipfile.ZipFile(out) as file:
            return json.loads(file.read(".zattrs"))["gelsim"]
    except (OSError, KeyError, TypeError, ValueError, zipfile.BadZipFile):
        return None


class Writer:
    """Writes the parts."""

    def __init__(self, dataset: Dataset, folder: Path, out: Path, identity: dict[str, Any]) -> None:
        self.dataset, self.folder, self.identity = dataset, folder, identity
        self.zipped = out.suffix == ".zip"
        self.numpy, self.zarr = need("numpy", "export"), need("zarr", "export")
        created = folder / "parts/arrays.json"
        if not created.exists():
            shutil.rmtree(folder / "out", ignore_errors=True)
            self.create()
            write(created, {})
        self.root = self.zarr.open_group(folder / "out", mode="r+", zarr_format=2)

    def create(self) -> None:
        """Makes the arrays of images: of as many frames as the labels name."""
        first = self.dataset.raw(0)
        lengths = len(self.dataset)
        if "sequence" in first.label:
            lengths = sum(len(self.dataset.raw(index)) for index in range(len(self.dataset)))
        root = self.zarr.open_group(self.folder / "out", mode="w", zarr_format=2)
        for name, array in content.layers(first, 0).items():
            if "/" not in name:
                path = f"data/{PAD}_{name}"
                create(root, path, (lengths, *array.shape), array.dtype, (1, *array.shape), content.UNITS[name])

    def part(self, number: int, samples: Iterator[Raw], at: Place) -> dict[str, Any]:
        """Writes the images of shard `number`, and keeps the rest of it."""
        kept: dict[str, list[Any]] = {}
        images = {name: self.root[f"data/{PAD}_{name}"] for name in self.names()}
        frames = count(at.frames)
        for raw in samples:
            small = {"data/" + name: rows for name, rows in vectors_of(raw).items()}
            small["meta/label_json"] = self.numpy.frombuffer(raw.label_json, "uint8")
            small["meta/label_ends"] = self.numpy.array([len(raw.label_json)])
            small["meta/episode_ends"] = self.numpy.array([len(raw)])
            small["meta/class_index"] = self.numpy.array([raw.label["object"]["class_index"]])
            small["meta/index"] = self.numpy.array([raw.label["index"]])
            for name, rows in small.items():
                kept.setdefault(name, []).append(rows)
            for number_in, frame in zip(range(len(raw)), frames):
                for name, array in content.layers(raw, number_in).items():
                    if name in images:
                        images[name][frame] = array
                    else:
                        kept.setdefault(ragged(name), []).append(array)
                        ends = kept.setdefault(ragged(name.split("/")[0] + "/ends"), [])
                        if len(ends) <= frame - at.frames:
                            ends.append(self.numpy.array([len(array)]))
        small = {name: self.numpy.concatenate(rows) for name, rows in kept.items()}
        path = self.folder / f"parts/{number:06}.npz"
        with open(path, "wb") as file:
            self.numpy.savez(file, **small)
        return {"file": path.name, "rows": {name: len(rows) for name, rows in small.items()}}

    def names(self) -> list[str]:
        """The layers that are arrays."""
        return [name for name in ["tactile", *self.dataset.layers] if name not in ("markers", "pins")]

    def finish(self, parts: list[dict[str, Any]]) -> Path:
        """Writes what is small, and the zip."""
        for name in parts[0]["rows"]:
            self.join(name, parts)
        self.root[f"data/{PAD}_pose"].attrs["components"] = POSE
        self.root[f"data/{PAD}_wrench"].attrs["components"] = WRENCH
        first = self.dataset.raw(0)
        about = {
            "gelsim": self.identity,
            "frame": content.FRAME,
            "frame_rate_hz": content.frame_rate_hz(first),
            "classes": self.dataset.classes,
            "splits": self.dataset.splits,
            "pads": {PAD: first.label["sensor"]["name"]},
        }
        for name, value in about.items():
            self.root.attrs[name] = value
        return packed(self.folder) if self.zipped else self.folder / "out"

    def join(self, name: str, parts: list[dict[str, Any]]) -> None:
        """Makes one array of those of the parts; ends of parts become ends of the whole."""
        array, begun, before = None, 0, 0
        for part in parts:
            with self.numpy.load(self.folder / "parts" / part["file"]) as file:
                rows = file[name]
            if name.endswith("_ends"):
                rows = self.numpy.cumsum(rows) + before
                before = rows[-1]
            if array is None:
                shape = sum(each["rows"][name] for each in parts), *rows.shape[1:]
                chunk = max(1, min(shape[0], BYTES_IN_CHUNK // rows[:1].nbytes if len(rows) else 1))
                array = create(self.root, name, shape, rows.dtype, (chunk, *rows.shape[1:]), unit(name))
            array[begun : begun + len(rows)] = rows
            begun += len(rows)


def create(root: Any, name: str, shape: Any, dtype: Any, chunks: Any, meaning: str) -> Any:
    """Makes an array; every chunk is written, also one of zeros: its sign bits count."""
    codec = need("numcodecs", "export").Zstd(level=1)
    array = root.create_array(
        name,
        shape=shape,
        dtype=dtype,
        chunks=chunks,
        compressors=codec,
        fill_value=0,
        overwrite=True,
        config={"write_empty_chunks": True},
    )
    array.attrs["unit"] = meaning
    return array


def ragged(name: str) -> str:
    """The array of markers or pins of all frames, one after another."""
    return f"ragged/{PAD}_{name.replace('/', '_')}"


def unit(name: str) -> str:
    """What the numbers of a small array mean."""
    group, own = name.split("/")
    own = own.removeprefix(f"{PAD}_")
    if group == "meta":
        return META[own]
    known = {"pose": POSE_UNIT, "wrench": content.UNITS["wrench"], "timestamp": "s since the sequence began; 0 of presses"}
    return known.get(own) or content.UNITS.get(own.replace("_", "/", 1), "rows before the end of each frame")


def packed(folder: Path) -> Path:
    """All files of the copy in a stored zip, in their order and without times."""
    path = folder / "out.zip"
    root = folder / "out"
    files = sorted(file for file in root.rglob("*") if file.is_file())
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
        for file in files:
            archive.writestr(zipfile.ZipInfo(file.relative_to(root).as_posix()), file.read_bytes())
    return path


def vectors_of(raw: Raw) -> Arrays:
    """Pose, wrench and time of each frame."""
    numpy = need("numpy", "export")
    poses = content.poses(raw)
    times = [part.get("t_s", 0.0) for part in vectors.parts(raw.label)]
    return {
        f"{PAD}_pose": numpy.concatenate([poses[:, :3], rotation_vectors(poses[:, 3:])], axis=1),
        f"{PAD}_wrench": content.wrenches(raw),
        "timestamp": numpy.array(times, "float64"),
    }


def rotation_vectors(quaternions: Any) -> Any:
    """Axis times angle (radians, 0 to pi) of unit quaternions x, y, z, w (N, 4)."""
    numpy = need("numpy", "export")
    quaternions = numpy.where(quaternions[:, 3:] < 0, -quaternions, quaternions)
    axis, w = quaternions[:, :3], quaternions[:, 3]
    length = numpy.sqrt((axis**2).sum(axis=1))
    turned = length > 0
    factor = numpy.where(turned, 2 * numpy.arctan2(length, w) / numpy.where(turned, length, 1.0), 2.0)
    return axis * factor[:, None]


def expectation(dataset: Dataset) -> Any:
    """What a copy holds of each frame of a sample."""

    def frames(raw: Raw, episode: int, first: int) -> Iterator[Arrays]:
        numpy = need("numpy", "export")
        small = vectors_of(raw)
        about = {"class_index": raw.label["object"]["class_index"], "index": raw.label["index"]}
        for number in range(len(raw)):
            yield {
                **content.layers(raw, number),
                **{name: rows[number] for name, rows in small.items()},
                **{name: numpy.int64(value) for name, value in about.items()},
            }

    return frames


def episodes(out: Path) -> Iterator[tuple[bytes, Iterator[Arrays]]]:
    """Label and frames of each episode."""
    zarr = need("zarr", "export")
    store = out if out.is_dir() else zarr.storage.ZipStore(out, mode="r")
    root = zarr.open_group(store, mode="r", zarr_format=2)
    meta = {name: root[f"meta/{name}"][:] for name in META if name != "label_json"}
    begun, label = 0, 0
    for episode, (end, label_end) in enumerate(zip(meta["episode_ends"], meta["label_ends"])):
        about = {name: meta[name][episode] for name in ["class_index", "index"]}
        yield root["meta/label_json"][label:label_end].tobytes(), frames(root, range(begun, end), about)
        begun, label = int(end), int(label_end)


def frames(root: Any, numbers: range, about: Arrays) -> Iterator[Arrays]:
    """Some of the frames."""
    data = dict(root["data"].arrays())
    dots = dict(root["ragged"].arrays()) if "ragged" in root else {}
    for number in numbers:
        found: Arrays = {name.removeprefix(f"{PAD}_"): array[number] for name, array in data.items()}
        found = {f"{PAD}_{name}" if name in ("pose", "wrench") else name: value for name, value in found.items()}
        for name, array in dots.items():
            layer, _, part = name.removeprefix(f"{PAD}_").partition("_")
            if part != "ends":
                ends = dots[f"{PAD}_{layer}_ends"]
                found[f"{layer}/{part}"] = array[int(ends[number - 1]) if number else 0 : int(ends[number])]
        yield {**found, **about}
