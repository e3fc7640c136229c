"""A dataset on disk as a map-style dataset."""

from __future__ import annotations

import json
import os
from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import accumulate
from operator import index as as_index
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, Optional, SupportsIndex, TypeVar, Union, cast, overload

from gelsim import shards, vectors
from gelsim._native import UsageError
from gelsim.checks import items, kind, path_text
from gelsim.lazy import lazy
from gelsim.needed import need_all
from gelsim.shards import Entry, Files, Index, damaged

if TYPE_CHECKING:
    from gelsim.sample import Sample

MANIFEST_VERSION = 1
SET_FILE = "sensors.json"
SET_VERSION = 1


T = TypeVar("T")
S = TypeVar("S", covariant=True)


@overload
def load(
    path: Union[str, PathLike[str]],
    split: Optional[str] = None,
    *,
    transform: None = None,
    layers: Optional[Sequence[str]] = None,
) -> Dataset[Sample]: ...
@overload
def load(
    path: Union[str, PathLike[str]],
    split: Optional[str] = None,
    *,
    transform: Callable[[Sample], T],
    layers: Optional[Sequence[str]] = None,
) -> Dataset[T]: ...
def load(
    path: Union[str, PathLike[str]],
    split: Optional[str] = None,
    *,
    transform: Optional[Callable[[Sample], Any]] = None,
    layers: Optional[Sequence[str]] = None,
) -> Dataset[Any]:
    """The dataset that `gelsim generate` wrote to the folder `path`, or its samples of one split.

    ```python
    train = gelsim.load("out/presses", "train", layers=["tactile", "depth"])
    image, depth_mm = train[0]["tactile"], train[0]["depth"]
    ```

    `layers` names the layers to read, `tactile` among them; the others are not decoded. Without it samples have all. A sample is
    what `transform` makes of it, if that is given: a function at the top of a module, where other processes find it.

    The folder of a set, which a job with `[sensors]` makes, gives a `SensorSet`: `.pairs()` has each press as all sensors see it.

    Raises UsageError for a folder that is none or is not complete, with a way out, and for a layer that is not there; shards are
    looked at when a sample is asked for.
    """
    of = SensorSet if os.path.isfile(folder_of(path) / SET_FILE) else Dataset
    return of(path, split, transform=transform, layers=layers)


class Dataset(Generic[S]):
    """A map-style dataset over a folder: train, val and test one after another, each in the order of `Job.indices`.

    `load` makes one. Samples are those of `Job` with `key` besides, or what `transform` makes of them. It can be pickled, and
    forked at any time.
    """

    def __init__(
        self,
        path: Union[str, PathLike[str]],
        split: Optional[str] = None,
        *,
        transform: Optional[Callable[[Sample], S]] = None,
        layers: Optional[Sequence[str]] = None,
    ) -> None:
        """See `load`."""
        need_all(["numpy", "PIL.Image"])
        if transform is not None and not callable(transform):
            raise TypeError(f"transform is {kind(transform)}; give a function that takes a sample")
        self.path = folder_of(path)
        manifest = read_manifest(self.path)
        self.manifest: dict[str, Any] = manifest
        """`dataset.json`."""
        self.name: str = manifest["name"]
        self.fingerprint: str = manifest["fingerprint"]
        """SHA-256 over all that decides the bytes of a sample, as `Job.fingerprint`."""
        self.classes: list[str] = [each["name"] for each in manifest["classes"]]
        """Class names; a label's `class_index` counts here."""
        self.layers: list[str] = [each.split(".", 1)[0] for each in manifest["layers"]]
        """The layers of the dataset, beside `tactile`."""
        self.transform = transform
        self.wanted = None if layers is None else wanted_layers(self.path, layers, ["tactile", *self.layers])
        """The layers that are read; None for all."""
        order = [shard["split"] for shard in manifest["shards"]]
        self.splits: dict[str, int] = {each: manifest["splits"][each] for each in [*order, *manifest["splits"]]}
        """Samples of each split of the folder."""
        if not (split is None or isinstance(split, str)):
            raise UsageError(f"split is {kind(split)}; give one of {', '.join(map(repr, self.splits))}, or leave it out for all")
        if split is not None and split not in self.splits:
            raise UsageError(f"{self.path}: no split {split!r}; it has {', '.join(map(repr, self.splits))}")
        self.split = split
        found = [entry(self.path, each) for each in manifest["shards"]]
        self.shards: list[Entry] = [each for each in found if split in (None, each.split)]
        self._ends = list(accumulate(each.samples for each in self.shards))
        self._indexes: dict[int, Index] = {}

    def __len__(self) -> int:
        return self._ends[-1] if self._ends else 0

    def __getitem__(self, index: SupportsIndex, /) -> S:
        """Sample `index`, decoded. Negative ones count from the end. RunError names a file that is damaged."""
        sample = self.raw(index).sample(self.wanted)
        return self.transform(sample) if self.transform is not None else cast("S", sample)

    def __iter__(self) -> Iterator[S]:
        return (self[index] for index in range(len(self)))

    def __repr__(self) -> str:
        of = "" if self.split is None else f", split {self.split}"
        return f'<gelsim.{type(self).__name__} "{self.name}": {len(self)} samples{of}>'

    def pairs(self) -> Pairs[S]:
        """Each press as all sensors of a set see it; UsageError for a dataset of one sensor."""
        raise UsageError(f"{self.path} is of one sensor; pairs are in the folder of a set, which has {SET_FILE}")

    def raw(self, index: SupportsIndex) -> Raw:
        """The files of sample `index`, not decoded."""
        try:
            number = as_index(index)
        except TypeError as error:
            several = "for several write [dataset[number] for number in range(3)]"
            raise TypeError(f"index is {kind(index)}; give a whole number; {several}") from error
        if not -len(self) <= number < len(self):
            raise IndexError(f"sample {number}: there are 0 to {len(self) - 1}")
        number %= len(self)
        shard = bisect_right(self._ends, number)
        if shard not in self._indexes:
            self._indexes[shard] = shards.index(self.shards[shard])
        of = self.shards[shard]
        files = self._indexes[shard].files(number - self._ends[shard] + of.samples)
        text = files.read("json")
        try:
            label = json.loads(text)
            if (its := str(label["key"])) != files.key:
                raise ValueError(f"it is the label of sample {its}")
            sound(label)
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise damaged(of.path, f"{files.key}.json is not its label: {error!r}") from None
        return Raw(of.path, files, text, label, self.manifest["layers"])


class SensorSet(Dataset[S]):
    """The datasets of several sensors as one: all samples of the first sensor, then those of the next.

    `load` makes one of the folder of a set.
    """

    def __init__(
        self,
        path: Union[str, PathLike[str]],
        split: Optional[str] = None,
        *,
        transform: Optional[Callable[[Sample], S]] = None,
        layers: Optional[Sequence[str]] = None,
    ) -> None:
        """See `load`."""
        root = folder_of(path)
        self.set: dict[str, Any] = read_set(root)
        """`sensors.json`."""
        folders = [each["folder"] for each in self.set["sensors"]]
        self.sensors: dict[str, Dataset[S]] = {
            each: Dataset(root / each, split, transform=transform, layers=layers) for each in folders
        }
        """The dataset of each sensor, by its folder."""
        super().__init__(root / folders[0], split, transform=transform, layers=layers)
        self.path = root
        self.name = root.name
        self.splits = {each: sum(one.splits[each] for one in self.sensors.values()) for each in self.splits}
        self.shards = [shard for one in self.sensors.values() for shard in one.shards]
        self._ends = list(accumulate(each.samples for each in self.shards))

    @property
    def calibration(self) -> Optional[SensorSet[Sample]]:
        """The calibration presses of the sensors; None if there are none."""
        folder = self.set.get("calibration")
        return None if folder is None else SensorSet(self.path / folder)

    def pairs(self) -> Pairs[S]:
        """Each press as all sensors see it: a sequence of lists, with a sample of each sensor in the order of `sensors`.

        Raises UsageError for a set with `paired = false`.
        """
        if not self.set["paired"]:
            raise UsageError(f"{self.path}: its sensors feel different presses (paired = false)")
        lengths = {len(one) for one in self.sensors.values()}
        if len(lengths) > 1:
            raise UsageError(f"{self.path}: its sensors have {sorted(lengths)} samples: run `gelsim generate` of its job again")
        return Pairs(list(self.sensors.values()))


class Pairs(Generic[S]):
    """The presses of a set. `SensorSet.pairs` makes it; it can be pickled, and forked at any time."""

    def __init__(self, sensors: list[Dataset[S]]) -> None:
        self.sensors = sensors
        """The dataset of each sensor."""

    def __len__(self) -> int:
        return len(self.sensors[0])

    def __getitem__(self, index: SupportsIndex, /) -> list[S]:
        """Press `index` as each sensor sees it. Negative ones count from the end."""
        return [sensor[index] for sensor in self.sensors]

    def __iter__(self) -> Iterator[list[S]]:
        return (self[index] for index in range(len(self)))

    def __repr__(self) -> str:
        return f"<gelsim.Pairs: {len(self)} presses, {len(self.sensors)} sensors>"


class Pad(NamedTuple):
    """One of a sample's sensors: the only one, or a finger of a gripper."""

    finger: Optional[str]
    """Its name among `vectors.FINGERS`; None of the only one."""
    label: dict[str, Any]
    """What the label says of the sensor."""
    parts: list[dict[str, Any]]
    """What the label says of each frame."""
    files: dict[str, str]
    """Suffix of each layer's file, without the frame's number."""


@dataclass(frozen=True)
class Raw:
    """A sample's files."""

    shard: Path
    files: Files
    label_json: bytes
    label: dict[str, Any]
    suffixes: list[str]

    def sample(self, wanted: Optional[Sequence[str]] = None) -> Sample:
        """All of it, decoded, or the layers that are wanted of it."""
        its: dict[str, Any]
        if "sequence" in self.label:
            its = {"frames": [self.frame(number, wanted) for number in range(len(self))]}
        else:
            its = self.frame(0, wanted)
        return cast("Sample", {**its, "label": self.label, "key": self.files.key})

    def __len__(self) -> int:
        """Its frames; 1 of a press or a grip."""
        return int(self.label["sequence"]["frames"]) if "sequence" in self.label else 1

    @lazy
    def pads(self) -> list[Pad]:
        """Its sensors: one, or the fingers of a gripper, left and right."""
        frames = self.label["frames"] if "sequence" in self.label else [self.label]
        files = {suffix.split(".", 1)[0]: suffix for suffix in ["tactile.png", *self.suffixes]}
        if not vectors.has_fingers(self.label):
            return [Pad(None, self.label, frames, files)]
        return [
            Pad(
                finger,
                self.label[finger],
                [frame[finger] for frame in frames],
                {name: f"{finger}.{suffix}" for name, suffix in files.items()},
            )
            for finger in vectors.FINGERS
        ]

    def frame(self, number: int, wanted: Optional[Sequence[str]] = None) -> dict[str, Any]:
        """The arrays of one frame, by layer, of a gripper by finger and layer; without a sequence `number` is 0."""
        found: dict[str, Any] = {}
        for pad in self.pads:
            layers = self.layers(pad, number, wanted)
            found.update(layers if pad.finger is None else {pad.finger: layers})
        return found

    def layers(self, pad: Pad, number: int, wanted: Optional[Sequence[str]] = None) -> dict[str, Any]:
        """The arrays of one sensor in a frame, by layer."""
        return {name: self.layer(pad, name, number) for name in pad.files if wanted is None or name in wanted}

    def data(self, suffix: str, number: int) -> bytes:
        """A file of a frame as it is; `suffix` without the frame's number."""
        return self.files.read(f"f{number:04}.{suffix}" if "sequence" in self.label else suffix)

    def layer(self, pad: Pad, name: str, number: int) -> Any:
        """Layer `name` of one sensor in a frame as array."""
        from gelsim.decode import decode

        suffix = pad.files[name]
        data = self.data(suffix, number)
        try:
            return decode(name, suffix, data, pad.label)
        except ImportError:
            raise
        except Exception as error:  # decoders raise what they please for damaged files
            where = f"frame {number} of " if "sequence" in self.label else ""
            raise damaged(self.shard, f"{where}{self.files.key}: {suffix}: {error}") from None


def folder_of(path: Union[str, PathLike[str]]) -> Path:
    """A folder, which is the same one when the process goes to another."""
    return Path(path_text(path, "a folder")).absolute()


def read_manifest(path: Path) -> dict[str, Any]:
    """`dataset.json` of the folder `path`, in the order of splits."""
    file = path / "dataset.json"
    try:
        manifest = json.loads(file.read_bytes())
        version = manifest["manifest_version"]
        if not isinstance(version, int) or version > MANIFEST_VERSION:
            raise UsageError(f"{file} is of a newer gelsim (manifest_version {version}): install that, or a newer one")
        for key in ["name", "fingerprint", "classes", "layers", "splits", "shards"]:
            manifest[key]
        [entry(path, each) for each in manifest["shards"]]
        return cast("dict[str, Any]", manifest)
    except FileNotFoundError:
        if (path / "job.toml").is_file() and (path / "stats").is_dir():
            finish = f"`{shards.generate(path)}` finishes it"
            raise UsageError(f"{path} is not complete, it has no dataset.json: {finish}") from None
        what = "is no dataset of gelsim: it has no dataset.json" if path.is_dir() else "is no folder"
        raise UsageError(f"{path} {what}; `gelsim generate JOB --out FOLDER` writes one") from None
    except NotADirectoryError:
        around = [each for each in path.parents if (each / file.name).is_file() or (each / SET_FILE).is_file()]
        whole = f", {around[0]}" if around else " that `gelsim generate` wrote"
        raise UsageError(f"{path} is a file; give the folder{whole}") from None
    except OSError as error:
        help = "; make it readable, as with `chmod a+r`" if isinstance(error, PermissionError) else ""
        raise UsageError(f"{file}: {error.strerror}{help}") from None
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        if isinstance(error, UsageError):
            raise
        verify = f"`gelsim verify {shards.word(path)}` says what is wrong"
        raise UsageError(f"{file} is no manifest of a dataset ({error!r}): {verify}") from None


def read_set(path: Path) -> dict[str, Any]:
    """`sensors.json` of the folder `path`."""
    file = path / SET_FILE
    try:
        found = json.loads(file.read_bytes())
        version = found["set_version"]
        if not isinstance(version, int) or version > SET_VERSION:
            raise UsageError(f"{file} is of a newer gelsim (set_version {version}): install that, or a newer one")
        folders = [each["folder"] for each in found["sensors"]]
        inside = [*folders, found.get("calibration", "calibration")]
        if not folders or not isinstance(found["paired"], bool) or any(Path(each).name != each or each == ".." for each in inside):
            raise ValueError("it names no folders beside it")
        return cast("dict[str, Any]", found)
    except OSError as error:
        raise UsageError(f"{file}: {error.strerror}") from None
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        if isinstance(error, UsageError):
            raise
        raise UsageError(f"{file} is no list of sensors ({error!r}): run `gelsim generate` of its job again") from None


def wanted_layers(path: Path, layers: Sequence[str], there: list[str]) -> list[str]:
    """The layers to read, which have to be there."""
    names = items("layers", layers, "a list of texts, such as ['tactile', 'depth']")
    absent = [str(name)[:60] for name in names if name not in there]
    if absent:
        s = "" if len(absent) == 1 else "s"
        raise UsageError(f"{path}: no layer{s} {', '.join(map(repr, absent[:10]))}; it has {', '.join(map(repr, there))}")
    return names


def sound(label: dict[str, Any]) -> None:
    """Raises if a label lacks what this package reads of it."""
    for part in vectors.parts(label):
        vectors.pose(part)
        vectors.wrench(part)
    if "sequence" in label and not 0 < int(label["sequence"]["frames"]) == len(label["frames"]):
        raise ValueError("it has not as many frames as it says")
    float(label["sequence"]["frame_rate_hz"] if "sequence" in label else 1)
    whole = [label[finger] for finger in vectors.FINGERS] if vectors.has_fingers(label) else [label]
    sensors = [part["sensor"] for part in whole]
    sizes = [sensor.get(key) for sensor in sensors for key in ["height_px", "width_px"]]
    for number in [label["index"], label["object"]["class_index"], *sizes]:
        if not isinstance(number, int):
            raise TypeError(f"{number!r} is no whole number")
    for text in [label["split"], label["object"]["class"], label["object"]["id"], *(sensor["name"] for sensor in sensors)]:
        if not isinstance(text, str):
            raise TypeError(f"{text!r} is no text")


def entry(path: Path, shard: dict[str, Any]) -> Entry:
    """A shard of the manifest."""
    return Entry(path / shard["file"], str(shard["split"]), int(shard["samples"]), int(shard["bytes"]))
