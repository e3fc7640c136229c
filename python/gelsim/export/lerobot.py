"""LeRobotDataset v3.0 with images in Parquet. A shard becomes one file of frames and one of episodes."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from io import BytesIO
from itertools import groupby
from pathlib import Path
from typing import Any, Optional

from gelsim import vectors
from gelsim.dataset import Dataset, Pad, Raw
from gelsim.decode import png
from gelsim.export import content, statistics
from gelsim.export.content import Arrays
from gelsim.export.parts import Place, write
from gelsim.needed import need
from gelsim.sample import Sample

LIBRARIES = ["numpy", "PIL.Image", "pyarrow.parquet"]
HAS_FLOATS = False
"""Layers of floats are not read for it."""
VERSION = "v3.0"
FILES_IN_CHUNK = 1000
ROWS_IN_GROUP = 100
PIXELS = ["tactile", "reference", "untouched", "contact", "instance", "slip"]
"""Layers of 8 bits; the others are in the label or left out."""


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


def images(raw: Raw) -> dict[str, tuple[Pad, str]]:
    """The features that are images: sensor and layer of each."""
    return {feature("images", pad.finger, layer): (pad, layer) for pad in raw.pads for layer in pad.files if layer in PIXELS}


class Features:
    """What each frame has; it follows from the first sample."""

    def __init__(self, dataset: Dataset[Sample]) -> None:
        first = dataset.raw(0)
        self.sensors = "+".join(pad.label["sensor"]["name"] for pad in first.pads)
        self.fps = content.frame_rate_hz(first)
        vector = {"dtype": "float32", "fps": self.rate()}
        counter = {"dtype": "int64", "shape": [1], "names": None}
        values: dict[str, Any] = {}
        self.units: dict[str, str] = {}
        for pad in first.pads:
            state, wrench = feature("state", pad.finger), feature("wrench", pad.finger)
            values[state] = {**vector, "shape": [7], "names": vectors.POSE}
            # No torque is known of presses on flat pads.
            part = pad.parts[0]
            known = vectors.WRENCH if "wrench" in part or part["contact"].get("force_vector_n") else vectors.WRENCH[:3]
            values[wrench] = {**vector, "shape": [len(known)], "names": known}
            self.units[state] = "mm and quaternion: the object's pose in the sensor's frame"
            self.units[wrench] = content.UNITS["wrench"]
        pictures: dict[str, Any] = {}
        for name, (pad, layer) in images(first).items():
            size = [pad.label["sensor"]["height_px"], pad.label["sensor"]["width_px"], 3]
            pictures[name] = {"dtype": "image", "shape": size, "names": ["height", "width", "channels"]}
            self.units[name] = content.UNITS[layer]
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
        fields: list[tuple[str, Any]] = []
        theirs: dict[str, Any] = {}
        for name, its in self.described.items():
            value: dict[str, Any] = {"dtype": its["dtype"], "_type": "Value"}
            if its["dtype"] == "image":
                fields.append((name, image))
                theirs[name] = {"_type": "Image"}
            elif its["shape"] == [1]:
                fields.append((name, getattr(arrow, its["dtype"])()))
                theirs[name] = value
            else:
                fields.append((name, arrow.list_(arrow.float32(), its["shape"][0])))
                theirs[name] = {"feature": value, "length": its["shape"][0], "_type": "Sequence"}
        return arrow.schema(fields).with_metadata({"huggingface": json.dumps({"info": {"features": theirs}})})


class Writer:
    """Writes the parts."""

    def __init__(self, dataset: Dataset[Sample], folder: Path, out: Path, identity: dict[str, Any]) -> None:
        self.dataset, self.identity = dataset, identity
        self.out = folder / "out"
        self.features = Features(dataset)
        self.arrow, self.parquet = need("pyarrow"), need("pyarrow.parquet")

    def part(self, number: int, samples: Iterator[Raw], at: Place) -> dict[str, Any]:
        """Writes shard `number`: its frames, then its episodes."""
        data, episodes = self.out / file("data", number), self.out / file("meta/episodes", number)
        for path in [data, episodes]:
            path.parent.mkdir(parents=True, exist_ok=True)
        fresh = data.with_suffix(".tmp")
        rows: list[dict[str, Any]] = []
        about: list[dict[str, Any]] = []
        each: list[dict[str, Any]] = []
        first = at.frames
        schema = self.features.schema()
        with self.parquet.ParquetWriter(fresh, schema) as writer:
            for episode, raw in enumerate(samples, at.episodes):
                tally = statistics.Tally()
                for frame in self.frames(raw, episode, first):
                    tally.add(frame)
                    rows.append(self.row(frame))
                    if len(rows) == ROWS_IN_GROUP:
                        writer.write_table(self.arrow.Table.from_pylist(rows, schema))
                        rows.clear()
                each.append(tally.figures())
                about.append({**self.about(raw, episode, first, number), **statistics.flat(each[-1])})
                first += len(raw)
            if rows:
                writer.write_table(self.arrow.Table.from_pylist(rows, schema))
        os.replace(fresh, data)
        fresh = episodes.with_suffix(".tmp")
        self.parquet.write_table(self.arrow.Table.from_pylist(about), fresh)
        os.replace(fresh, episodes)
        return {"statistics": statistics.merged(each)}

    def frames(self, raw: Raw, episode: int, first: int) -> Iterator[Arrays]:
        """The frames of an episode: images as PNG, which becomes RGB where it is grey; the rest as numbers."""
        for number, row in enumerate(numbers(raw, episode, first, self.features)):
            pictures = {
                name: rgb(raw.data(pad.files[layer], number), raw.layer(pad, layer, number))
                for name, (pad, layer) in images(raw).items()
            }
            yield {**pictures, **row}

    def row(self, frame: Arrays) -> dict[str, Any]:
        """A row of the table."""
        return {
            name: {"bytes": value[0], "path": f"frame-{int(frame['frame_index']):06}.png"} if isinstance(value, tuple) else value
            for name, value in frame.items()
        }

    def about(self, raw: Raw, episode: int, first: int, number: int) -> dict[str, Any]:
        """A row of `meta/episodes`, without statistics."""
        chunk, index = place(number)
        return {
            "episode_index": episode,
            "tasks": [raw.label["object"]["class"]],
            "length": len(raw),
            "data/chunk_index": chunk,
            "data/file_index": index,
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
                "data_files_size_in_mb": 100,
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
        (self.out / "README.md").write_text(self.card(splits), encoding="utf-8")
        return self.out

    def card(self, splits: dict[str, str]) -> str:
        """The dataset card: without what it says of `data_files` Hugging Face's `datasets` takes `meta` for frames, too."""
        spans = {split: [int(end) for end in span.split(":")] for split, span in splits.items()}
        episodes = "\n".join(f"| {split} | {begin} to {end - 1} |" for split, (begin, end) in spans.items())
        described = self.features.described
        return CARD.format(
            name=self.dataset.name,
            by_split="".join(self.by_split()),
            fingerprint=self.dataset.fingerprint,
            episodes=episodes,
            features=", ".join(f"`{name}`" for name in described),
            image=next(name for name, its in described.items() if its["dtype"] == "image"),
            state=next(name for name in described if name.startswith(feature("state", None))),
            splits=BY_SPLIT.format(first=next(iter(splits))) if self.has_splits() else "",
        )

    def has_splits(self) -> bool:
        """True if the card can list the files of each split."""
        return len(self.dataset.shards) <= FILES_IN_CHUNK

    def by_split(self) -> Iterator[str]:
        """The card's list of the files of each split, which no pattern tells from each other."""
        if not self.has_splits():
            return
        yield "\n- config_name: splits\n  data_files:"
        before = None
        for number, shard in enumerate(self.dataset.shards):
            if shard.split != before:
                yield f"\n  - split: {shard.split}\n    path:"
                before = shard.split
            yield f"\n    - {file('data', number)}"


def numbers(raw: Raw, episode: int, first: int, features: Features) -> Iterator[Arrays]:
    """All but the images, of each frame."""
    numpy = need("numpy")
    known: Arrays = {}
    for pad in raw.pads:
        for name, rows in [("state", content.poses(pad)), ("wrench", content.wrenches(pad))]:
            name = feature(name, pad.finger)
            known[name] = rows.astype("float32")[:, : features.described[name]["shape"][0]]
    for number in range(len(raw)):
        yield {
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
            yield {**pictures, **row}

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
    rows = (
        row
        for path in sorted(out.glob("data/*/*.parquet"))
        for batch in parquet.ParquetFile(path).iter_batches(batch_size=ROWS_IN_GROUP)
        for row in batch.to_pylist()
    )
    for label, (_, its) in zip(labels, groupby(rows, lambda row: row["episode_index"])):
        yield label, map(read, its)


def read(row: dict[str, Any]) -> Arrays:
    """A row's arrays."""
    numpy = need("numpy")
    found: Arrays = {}
    for name, value in row.items():
        if isinstance(value, dict):
            found[name] = png(value["bytes"])
        elif isinstance(value, int):
            found[name] = numpy.int64(value)
        else:
            found[name] = numpy.asarray(value, "float32")
    return found
