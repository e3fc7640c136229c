"""LeRobotDataset v3.0 with images in Parquet. A shard becomes files of frames of about 100 MB, and one file of episodes."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import ExitStack
from io import BytesIO
from itertools import groupby
from pathlib import Path
from typing import Any, Optional

from gelsim import vectors
from gelsim.dataset import Dataset, Pad, Raw
from gelsim.decode import CHANNELS, png
from gelsim.export import content, statistics
from gelsim.export.content import Arrays
from gelsim.export.parts import Place, write
from gelsim.needed import need
from gelsim.sample import Sample

LIBRARIES = ["numpy", "PIL.Image", "pyarrow.parquet"]
HAS_FLOATS = True
"""Layers of floats are read for it."""
VERSION = "v3.0"
FILES_IN_CHUNK = 1000
FILE_MB = 100
"""From this size on the next episode begins the next file."""
ROWS_IN_GROUP = 100
BYTES_IN_GROUP = 1 << 25
"""Readers have a group of rows in memory."""
PIXELS = ["tactile", "reference", "untouched", "contact", "instance", "slip"]
"""Layers of 8 bits."""
LENGTHS = ["depth", "surface", "gap"]
"""Layers with one length in mm for each pixel: LeRobot's depth maps."""
DOTS = ["markers", "pins"]
"""Layers of positions; what is in no list is a map of floats."""


def source(out: Path) -> Any:
    """The identity of a finished copy; None if `out` is none."""
    try:
        return json.loads((out / "meta/gelsim.json").read_bytes())
    except (OSError, ValueError):
        return None


CARD = """---
pretty_name: "{name}"
tags:
- LeRobot
- tactile
- synthetic
configs:
- config_name: default
  data_files: data/*/*.parquet{by_split}
---

# {name}

Tactile images with labels by gelsim, as a LeRobotDataset v3.0. A press is an episode of one frame, a sequence one of all its frames.
The dataset's fingerprint is `{fingerprint}`.

```python
import os

from datasets import load_dataset

frames = load_dataset(os.getcwd(), split="train")
frame = frames[0]
image, pose = frame["{image}"], frame["{state}"]
```

in this folder reads the frames of all episodes, whatever their split is.{splits}

| split | episodes |
|---|---|
{episodes}

Each frame has {features}. Units are in `meta/info.json`, labels in `meta/episodes`.
"""
BY_SPLIT = """ Those of one split:

```python
import os

from datasets import load_dataset

frames = load_dataset(os.getcwd(), "splits", split="{first}")
```"""


def place(number: int) -> tuple[int, int]:
    """Chunk and file of shard `number`."""
    return divmod(number, FILES_IN_CHUNK)


def file(kind: str, number: int) -> str:
    """Path of shard `number` among `data` or `meta/episodes`."""
    chunk, index = place(number)
    return f"{kind}/chunk-{chunk:03}/file-{index:03}.parquet"


def feature(kind: str, finger: Optional[str], layer: Optional[str] = None) -> str:
    """The name of a feature: `observation.state`, of a finger `observation.state.left`; LeRobot allows no slash."""
    return ".".join(["observation", kind, *filter(None, [finger, layer])])


Named = dict[str, tuple[Pad, str]]
"""Sensor and layer of each feature."""


def images(raw: Raw, layers: list[str] = PIXELS) -> Named:
    """The features that are images, of 8 bits or of `LENGTHS`."""
    return {feature("images", pad.finger, layer): (pad, layer) for pad in raw.pads for layer in pad.files if layer in layers}


def maps(raw: Raw) -> Named:
    """The features that are maps of floats."""
    others = [*PIXELS, *LENGTHS, *DOTS]
    return {feature("layers", pad.finger, layer): (pad, layer) for pad in raw.pads for layer in pad.files if layer not in others}


def dots(raw: Raw, number: int) -> Arrays:
    """The features that are positions, in a frame, with as many rows as the frame has markers or pins."""
    return {
        feature(layer, pad.finger, name): positions
        for pad in raw.pads
        for layer in pad.files
        if layer in DOTS
        for name, positions in raw.layer(pad, layer, number).items()
    }


def rows_of_dots(dataset: Dataset[Sample]) -> dict[str, tuple[int, int]]:
    """The fewest and the most rows of each of `dots`, of all frames."""
    found: dict[str, tuple[int, int]] = {}
    if not set(DOTS).intersection(dataset.layers):
        return found
    for raw in (dataset.raw(index) for index in range(len(dataset))):
        for number in range(len(raw)):
            for name, positions in dots(raw, number).items():
                fewest, most = found.get(name, (len(positions), 0))
                found[name] = min(fewest, len(positions)), max(most, len(positions))
    return found


def has_torque(dataset: Dataset[Sample], at: int) -> bool:
    """True if any label knows the torque on sensor `at`, as not of presses on flat pads."""
    parts = (part for raw in content.telling(dataset) for part in raw.pads[at].parts)
    return any("wrench" in part or part["contact"].get("force_vector_n") for part in parts)


class Features:
    """What each frame has: what the first sample has, as many rows of positions as any frame, and torques if any has them."""

    def __init__(self, dataset: Dataset[Sample]) -> None:
        first = dataset.raw(0)
        self.sensors = "+".join(content.sensors(dataset))
        self.fps = content.frame_rate_hz(first)
        vector = {"dtype": "float32", "fps": self.rate()}
        counter = {"dtype": "int64", "shape": [1], "names": None}
        values: dict[str, Any] = {}
        self.units: dict[str, str] = {}
        for at, pad in enumerate(first.pads):
            state, wrench = feature("state", pad.finger), feature("wrench", pad.finger)
            values[state] = {**vector, "shape": [7], "names": vectors.POSE}
            known = vectors.WRENCH if has_torque(dataset, at) else vectors.WRENCH[:3]
            values[wrench] = {**vector, "shape": [len(known)], "names": known}
            self.units[state] = "mm and quaternion: the object's pose in the sensor's frame"
            self.units[wrench] = content.UNITS["wrench"]
        pictures: dict[str, Any] = {}
        image: dict[str, Any] = {"dtype": "image"}
        depth = {**image, "info": {"is_depth_map": True, "depth_unit": "mm"}}
        for named, kind in [(images(first), image), (images(first, LENGTHS), depth), (maps(first), vector)]:
            for name, (pad, layer) in named.items():
                channels = 3 if layer in PIXELS else CHANNELS.get(layer, 1)
                size = [pad.label["sensor"]["height_px"], pad.label["sensor"]["width_px"], channels]
                pictures[name] = {**kind, "shape": size, "names": ["height", "width", "channels"]}
                self.units[name] = content.UNITS[layer]
        for name, (fewest, most) in rows_of_dots(dataset).items():
            layer, own = name.split(".")[1], name.split(".")[-1]
            # A table has no arrays without rows.
            values[name] = {**vector, "shape": [max(most, 1), 3 if own.endswith("_mm") else 2], "names": [layer, "axes"]}
            missing = "" if fewest == most > 0 else f"; NaN in rows after a frame's last of the {layer}"
            self.units[name] = content.UNITS[f"{layer}/{own}"] + missing
        self.described: dict[str, Any] = {
            **pictures,
            **values,
            "timestamp": {"dtype": "float32", "shape": [1], "names": None},
            **{name: counter for name in ["frame_index", "episode_index", "index", "task_index"]},
        }

    def rate(self) -> float:
        """Frames a second, an int where it is one."""
        return int(self.fps) if self.fps.is_integer() else self.fps

    def schema(self) -> Any:
        """Of the files of frames; with what Hugging Face's `datasets` reads there."""
        arrow = need("pyarrow")
        image = arrow.struct([("bytes", arrow.binary()), ("path", arrow.string())])
        fields: list[Any] = []
        theirs: dict[str, Any] = {}
        for name, its in self.described.items():
            value: dict[str, Any] = {"dtype": its["dtype"], "_type": "Value"}
            if its["dtype"] == "image":
                fields.append((name, image))
                theirs[name] = {"_type": "Image"}
            elif its["shape"] == [1]:
                fields.append((name, getattr(arrow, its["dtype"])()))
                theirs[name] = value
            elif len(its["shape"]) > 1:
                nested = arrow.float32()
                for _ in its["shape"]:
                    nested = arrow.list_(nested)
                theirs[name] = {"shape": its["shape"], "dtype": its["dtype"], "_type": f"Array{len(its['shape'])}D"}
                # LeRobot's tools read arrays with pandas, which needs the type that `datasets` gives them.
                known = {"name": f"datasets.features.features.{theirs[name]['_type']}ExtensionType"}
                known["metadata"] = json.dumps([its["shape"], its["dtype"]])
                fields.append(arrow.field(name, nested, metadata={f"ARROW:extension:{key}": each for key, each in known.items()}))
            else:
                fields.append((name, arrow.list_(arrow.float32(), its["shape"][0])))
                theirs[name] = {"feature": value, "length": its["shape"][0], "_type": "Sequence"}
        return arrow.schema(fields).with_metadata({"huggingface": json.dumps({"info": {"features": theirs}})})


class Writer:
    """Writes the parts."""

    def __init__(self, dataset: Dataset[Sample], folder: Path, out: Path, identity: dict[str, Any]) -> None:
        self.dataset, self.folder, self.identity = dataset, folder, identity
        self.out = folder / "out"
        self.features = Features(dataset)
        self.arrow, self.parquet = need("pyarrow"), need("pyarrow.parquet")

    def part(self, number: int, samples: Iterator[Raw], at: Place) -> dict[str, Any]:
        """Writes shard `number`: its frames, then its episodes."""
        about: list[dict[str, Any]] = []
        each: list[dict[str, Any]] = []
        first = at.frames
        before = json.loads((self.folder / f"parts/{number - 1:06}.json").read_bytes())["files"] if number else 0
        with Files(self.out, before, self.features.schema()) as files:
            for episode, raw in enumerate(samples, at.episodes):
                tally = statistics.Tally()
                files.begin_episode()
                for frame in self.frames(raw, episode, first):
                    tally.add(frame)
                    files.add(self.row(frame))
                each.append(tally.figures())
                about.append({**self.about(raw, episode, first, number, files.number), **statistics.flat(each[-1])})
                first += len(raw)
        episodes = self.out / file("meta/episodes", number)
        episodes.parent.mkdir(parents=True, exist_ok=True)
        fresh = episodes.with_suffix(".tmp")
        self.parquet.write_table(self.arrow.Table.from_pylist(about), fresh)
        os.replace(fresh, episodes)
        return {"statistics": statistics.merged(each), "files": files.number + 1}

    def frames(self, raw: Raw, episode: int, first: int) -> Iterator[Arrays]:
        """The frames of an episode: images as PNG, which becomes RGB where it is grey, or TIFF; the rest as numbers."""
        for number, row in enumerate(numbers(raw, episode, first, self.features)):
            pictures = {
                name: rgb(raw.data(pad.files[layer], number), raw.layer(pad, layer, number))
                for name, (pad, layer) in images(raw).items()
            }
            depths = {name: tiff(raw.layer(pad, layer, number)) for name, (pad, layer) in images(raw, LENGTHS).items()}
            yield {**pictures, **depths, **row}

    def row(self, frame: Arrays) -> dict[str, Any]:
        """A row of the table, with the names that LeRobot gives the files of images."""
        path = f"frame-{int(frame['frame_index']):06}"

        def stored(value: Any) -> Any:
            if not isinstance(value, tuple):
                return value
            data, pixels = value
            return {"bytes": data, "path": path + (".png" if pixels.ndim == 3 else TIFF)}

        return {name: stored(value) for name, value in frame.items()}

    def about(self, raw: Raw, episode: int, first: int, number: int, frames: int) -> dict[str, Any]:
        """A row of `meta/episodes`, without statistics; its frames are in file `frames`."""
        chunk, index = place(number)
        frames_chunk, frames_index = place(frames)
        return {
            "episode_index": episode,
            "tasks": [raw.label["object"]["class"]],
            "length": len(raw),
            "data/chunk_index": frames_chunk,
            "data/file_index": frames_index,
            "dataset_from_index": first,
            "dataset_to_index": first + len(raw),
            "meta/episodes/chunk_index": chunk,
            "meta/episodes/file_index": index,
            "gelsim/key": raw.files.key,
            "gelsim/split": raw.label["split"],
            "gelsim/class": raw.label["object"]["class"],
            "gelsim/object": raw.label["object"]["id"],
            "gelsim/label": raw.label_json.decode(),
        }

    def finish(self, parts: list[dict[str, Any]]) -> Path:
        """Writes what is known of the whole."""
        meta = self.out / "meta"
        ends, splits = 0, {}
        for split, samples in self.dataset.splits.items():
            splits[split] = f"{ends}:{ends + samples}"
            ends += samples
        write(
            meta / "info.json",
            {
                "codebase_version": VERSION,
                "robot_type": self.features.sensors,
                "total_episodes": len(self.dataset),
                "total_frames": sum(part["frames"] for part in parts),
                "total_tasks": len(self.dataset.classes),
                "chunks_size": FILES_IN_CHUNK,
                "data_files_size_in_mb": FILE_MB,
                "video_files_size_in_mb": 200,
                "fps": self.features.rate(),
                "splits": splits,
                "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
                "video_path": None,
                "features": self.features.described,
                "gelsim": {
                    "frame": content.FRAME,
                    "units": self.features.units,
                },
            },
        )
        write(meta / "stats.json", statistics.merged([part["statistics"] for part in parts]))
        self.parquet.write_table(tasks(self.dataset.classes), meta / "tasks.parquet")
        write(meta / "gelsim.json", self.identity)
        (self.out / "README.md").write_text(self.card(splits, [part["files"] for part in parts]), encoding="utf-8")
        return self.out

    def card(self, splits: dict[str, str], files: list[int]) -> str:
        """The dataset card: without what it says of `data_files` Hugging Face's `datasets` takes `meta` for frames, too.

        `files` says before which file each shard ends.
        """
        spans = {split: [int(end) for end in span.split(":")] for split, span in splits.items()}
        episodes = "\n".join(f"| {split} | {begin} to {end - 1} |" for split, (begin, end) in spans.items())
        described = self.features.described
        return CARD.format(
            name=self.dataset.name,
            by_split="".join(self.by_split(files)),
            fingerprint=self.dataset.fingerprint,
            episodes=episodes,
            features=", ".join(f"`{name}`" for name in described),
            image=next(name for name, its in described.items() if its["dtype"] == "image"),
            state=next(name for name in described if name.startswith(feature("state", None))),
            splits=BY_SPLIT.format(first=next(iter(splits))) if has_splits(files) else "",
        )

    def by_split(self, files: list[int]) -> Iterator[str]:
        """The card's list of the files of each split, which no pattern tells from each other."""
        if not has_splits(files):
            return
        yield "\n- config_name: splits\n  data_files:"
        before = None
        for shard, first, end in zip(self.dataset.shards, [0, *files], files):
            if shard.split != before:
                yield f"\n  - split: {shard.split}\n    path:"
                before = shard.split
            for number in range(first, end):
                yield f"\n    - {file('data', number)}"


def has_splits(files: list[int]) -> bool:
    """True if the card can list the files of each split."""
    return files[-1] <= FILES_IN_CHUNK


class Files:
    """The files of a shard's frames. None has its final name before it is whole."""

    def __init__(self, out: Path, before: int, schema: Any) -> None:
        self.out, self.number, self.schema = out, before - 1, schema
        self.arrow, self.parquet = need("pyarrow"), need("pyarrow.parquet")
        self.rows: list[dict[str, Any]] = []
        self.bytes = 0
        """Of the rows that wait for their group."""
        self.opened = ExitStack()
        self.sink: Any = None
        self.writer: Any = None

    def __enter__(self) -> Files:
        return self

    def __exit__(self, *failed: Any) -> None:
        if failed[0] is None:
            self.end()
        self.opened.__exit__(*failed)

    def begin_episode(self) -> None:
        """Goes on in the file, or in a new one."""
        if self.sink is not None and self.sink.tell() + self.bytes < FILE_MB << 20:
            return
        self.end()
        self.number += 1
        fresh = self.path().with_suffix(".tmp")
        fresh.parent.mkdir(parents=True, exist_ok=True)
        self.sink = self.opened.enter_context(self.arrow.OSFile(str(fresh), "wb"))
        self.writer = self.opened.enter_context(self.parquet.ParquetWriter(self.sink, self.schema))

    def path(self) -> Path:
        """That of the file under way."""
        return self.out / file("data", self.number)

    def add(self, row: dict[str, Any]) -> None:
        """Adds a frame."""
        self.rows.append(row)
        self.bytes += sum(len(value["bytes"]) if isinstance(value, dict) else value.nbytes for value in row.values())
        if len(self.rows) == ROWS_IN_GROUP or self.bytes >= BYTES_IN_GROUP:
            self.write_group()

    def write_group(self) -> None:
        """Writes the rows that wait."""
        if self.rows:
            columns = [column([row[field.name] for row in self.rows], field.type) for field in self.schema]
            self.writer.write_table(self.arrow.Table.from_arrays(columns, schema=self.schema))
        self.rows, self.bytes = [], 0

    def end(self) -> None:
        """Ends the file under way."""
        if self.sink is not None:
            self.write_group()
            self.opened.close()
            os.replace(self.path().with_suffix(".tmp"), self.path())
            self.sink = None


def column(values: list[Any], kind: Any) -> Any:
    """Images, numbers or arrays of one shape as a column."""
    arrow, numpy = need("pyarrow"), need("numpy")
    shape = numpy.shape(values[0])
    if len(shape) < 2:
        return arrow.array(values, kind)
    found = arrow.array(numpy.stack(values).reshape(-1))
    for size in reversed(shape):
        found = arrow.ListArray.from_arrays(numpy.arange(0, len(found) + 1, size, "int32"), found)
    return found


def numbers(raw: Raw, episode: int, first: int, features: Features) -> Iterator[Arrays]:
    """All but the images, of each frame; positions with NaN in rows that it does not have."""
    numpy = need("numpy")
    known: Arrays = {}
    for pad in raw.pads:
        for name, rows in [("state", content.poses(pad)), ("wrench", content.wrenches(pad))]:
            name = feature(name, pad.finger)
            known[name] = rows.astype("float32")[:, : features.described[name]["shape"][0]]
    for number in range(len(raw)):
        arrays = {name: raw.layer(pad, layer, number) for name, (pad, layer) in maps(raw).items()}
        for name, positions in dots(raw, number).items():
            arrays[name] = numpy.full(features.described[name]["shape"], numpy.nan, "float32")
            arrays[name][: len(positions)] = positions
        yield {
            **{name: array.reshape(features.described[name]["shape"]) for name, array in arrays.items()},
            **{name: rows[number] for name, rows in known.items()},
            "timestamp": numpy.float32(number / features.fps),
            "frame_index": numpy.int64(number),
            "episode_index": numpy.int64(episode),
            "index": numpy.int64(first + number),
            "task_index": numpy.int64(raw.label["object"]["class_index"]),
        }


def rgb(data: bytes, pixels: Any) -> tuple[bytes, Any]:
    """PNG and pixels of an image with three channels; one that has them keeps its bytes."""
    if pixels.ndim == 3:
        return data, pixels
    file = BytesIO()
    need("PIL.Image").fromarray(coloured(pixels)).save(file, "PNG", compress_level=1)
    return file.getvalue(), coloured(pixels)


def coloured(pixels: Any) -> Any:
    """Grey as RGB: LeRobot's statistics and networks have three channels."""
    return pixels if pixels.ndim == 3 else need("numpy").repeat(pixels[..., None], 3, axis=2)


TIFF = ".tiff"


def tiff(values: Any) -> tuple[bytes, Any]:
    """Lengths (H, W) as LeRobot writes depth maps: TIFF of floats without compression; and as they are."""
    file = BytesIO()
    need("PIL.Image").fromarray(values).save(file, "TIFF", compression="raw")
    return file.getvalue(), values


def tasks(classes: list[str]) -> Any:
    """The classes, as pandas writes a table with an index of names."""
    arrow = need("pyarrow")
    index = "__index_level_0__"

    def column(name: Any, field: str, kind: str, numpy: str) -> dict[str, Any]:
        return {"name": name, "field_name": field, "pandas_type": kind, "numpy_type": numpy, "metadata": None}

    pandas = {
        "index_columns": [index],
        "column_indexes": [{**column(None, "", "unicode", "object"), "metadata": {"encoding": "UTF-8"}, "field_name": None}],
        "columns": [column("task_index", "task_index", "int64", "int64"), column(None, index, "unicode", "object")],
        "pandas_version": "2.0.0",
    }
    table = arrow.table({"task_index": arrow.array(range(len(classes)), arrow.int64()), index: classes})
    return table.replace_schema_metadata({"pandas": json.dumps(pandas)})


def expectation(dataset: Dataset[Sample]) -> Any:
    """What a copy holds of each frame of a sample."""
    features = Features(dataset)

    def frames(raw: Raw, episode: int, first: int) -> Iterator[Arrays]:
        for number, row in enumerate(numbers(raw, episode, first, features)):
            pictures = {name: coloured(raw.layer(pad, layer, number)) for name, (pad, layer) in images(raw).items()}
            depths = {name: raw.layer(pad, layer, number) for name, (pad, layer) in images(raw, LENGTHS).items()}
            yield {**pictures, **depths, **row}

    return frames


def episodes(out: Path) -> Iterator[tuple[bytes, Iterator[Arrays]]]:
    """Label and frames of each episode."""
    parquet = need("pyarrow.parquet")
    labels = (
        label.as_py().encode()
        for path in sorted(out.glob("meta/episodes/*/*.parquet"))
        for batch in parquet.ParquetFile(path).iter_batches(columns=["gelsim/label"])
        for label in batch.column(0)
    )
    rows = (row for path in sorted(out.glob("data/*/*.parquet")) for row in rows_of(parquet.ParquetFile(path)))
    for label, (_, its) in zip(labels, groupby(rows, lambda row: row["episode_index"])):
        yield label, map(read, its)


def rows_of(parquet: Any) -> Iterator[dict[str, Any]]:
    """The rows of a file; images not decoded."""
    for group in range(parquet.num_row_groups):
        table = parquet.read_row_group(group)
        columns = [values(column.combine_chunks()) for column in table.columns]
        yield from (dict(zip(table.column_names, row)) for row in zip(*columns))


def values(column: Any) -> Any:
    """Images, numbers or arrays of a column; ValueError if arrays are not of one shape."""
    types, compute = need("pyarrow").types, need("pyarrow.compute")
    if types.is_struct(column.type):
        return column.to_pylist()
    # Arrays are of an extension type where `datasets` is imported.
    column = getattr(column, "storage", column)
    shape = [len(column)]
    while types.is_list(column.type) or types.is_fixed_size_list(column.type):
        (size,) = compute.list_value_length(column).unique().to_pylist()
        shape.append(size)
        column = column.flatten()
    return column.to_numpy(zero_copy_only=False).reshape(shape)


def read(row: dict[str, Any]) -> Arrays:
    """A row's arrays."""
    return {name: image(value) if isinstance(value, dict) else value for name, value in row.items()}


def image(stored: dict[str, Any]) -> Any:
    """Pixels of 8 bits, or lengths."""
    if not stored["path"].endswith(TIFF):
        return png(stored["bytes"])
    return need("numpy").array(need("PIL.Image").open(BytesIO(stored["bytes"]), formats=["TIFF"]))
