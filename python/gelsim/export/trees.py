"""Copies that are folders in the layout of one project: written file by file, compared by writing them once more."""

from __future__ import annotations

import json
import shutil
import tarfile
from collections.abc import Callable, Iterable, Iterator
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple, Optional

from gelsim._native import UsageError
from gelsim.dataset import Dataset, Pad, Raw, SensorSet
from gelsim.export import content
from gelsim.export.parts import Place
from gelsim.needed import need
from gelsim.sample import Sample


class Home(NamedTuple):
    """Where a shard belongs."""

    folder: str
    """Of its sensor in a set; empty for a dataset of one sensor."""
    split: str
    number: int
    """Among the shards of its sensor and split."""


def homes(dataset: Dataset[Sample]) -> list[Home]:
    """Where each of the dataset's shards belongs."""
    found: list[Home] = []
    for shard in dataset.shards:
        folder = shard.path.relative_to(dataset.path).parts[0] if isinstance(dataset, SensorSet) else ""
        before = sum(home.folder == folder and home.split == shard.split for home in found)
        found.append(Home(name_of_folder(folder, "sensor") if folder else "", name_of_folder(shard.split, "split"), before))
    return found


def name_of_folder(name: str, of: str) -> str:
    """What a folder of the copy is called after. Raises if no folder inside of it can be called so."""
    if name in {"", ".", ".."} or any(character in name for character in "/\\\0") or len(name.encode(errors="replace")) > 255:
        raise UsageError(f"no folder can be called after the {of} {name[:60]!r}: generate with another name")
    return name


class Tree:
    """Writes the parts into the folder `tree`."""

    SOURCE = "gelsim.json"
    """File of the copy that says where it comes from."""

    def __init__(self, dataset: Dataset[Sample], folder: Path, out: Path, identity: dict[str, Any]) -> None:
        self.dataset, self.identity = dataset, identity
        self.tree = folder / "tree"
        self.homes = homes(dataset)

    def part(self, number: int, samples: Iterator[Raw], at: Place) -> dict[str, Any]:
        """Writes shard `number`."""
        home = self.homes[number]
        return {**home._asdict(), **self.write(home, samples)}

    def write(self, home: Home, samples: Iterator[Raw]) -> dict[str, Any]:
        """Writes the samples of a shard. Gives what `close` needs to know."""
        raise NotImplementedError

    def close(self, parts: list[dict[str, Any]]) -> None:
        """Writes what stands beside the samples."""

    def finish(self, parts: list[dict[str, Any]]) -> Path:
        """Writes the rest; the folder that is to get the final name."""
        self.tree.mkdir(exist_ok=True)
        self.close(parts)
        put(self.tree / self.SOURCE, (json.dumps(self.identity, indent=1) + "\n").encode())
        return self.tree


def source(out: Path, name: str) -> Any:
    """The identity of a finished copy; None if `out` is none."""
    try:
        return json.loads((out / name).read_bytes())
    except (OSError, ValueError):
        return None


def put(path: Path, data: bytes) -> None:
    """Writes a file and the folders that it is in."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)


def write_tar(path: Path, members: Iterable[tuple[str, bytes]]) -> None:
    """Writes a tar that depends on names and contents alone."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with tarfile.open(path, "w", format=tarfile.USTAR_FORMAT) as tar:
        for name, data in members:
            info = tarfile.TarInfo(name)
            info.size, info.mode = len(data), 0o644
            tar.addfile(info, BytesIO(data))


def frames(raw: Raw) -> Iterator[tuple[str, int, Pad]]:
    """Each image of a sample: its name, the number of its frame, and its sensor."""
    for number in range(len(raw)):
        for pad in raw.pads:
            frame = f"-f{number:04}" if "sequence" in raw.label else ""
            yield f"{raw.files.key}{frame}" + (f"-{pad.finger}" if pad.finger else ""), number, pad


def check_forces(dataset: Dataset[Sample], layout: str) -> None:
    """Raises for a dataset that lacks what a layout of forces has of each sensor. The first sample tells."""
    for each in dataset.sensors.values() if isinstance(dataset, SensorSet) else [dataset]:
        raw = each.raw(0)
        if "sequence" not in raw.label:
            help = "generate a job with [sequence] (docs/how-to/sequences.md)"
            raise UsageError(f"{each.path} has single presses, and {layout} has frames with forces: {help}")
        for pad in raw.pads:
            family(pad.label["sensor"]["name"], layout)
            untouched(raw, pad)
        for name in content.presets_drawn(each):
            family(name, layout)


def untouched(raw: Raw, pad: Pad) -> bytes:
    """The PNG of a sensor without contact."""
    for name in ["untouched", "reference"]:
        if name in pad.files:
            return raw.data(pad.files[name], 0)
    raise UsageError('the image without contact is missing: generate with layers = ["reference"] under [output]')


def family(sensor: str, layout: str) -> str:
    """The word for a sensor that loaders look for in names."""
    for word in ["digit", "gelsight"]:
        if word in sensor.lower():
            return word
    raise UsageError(f"{layout} is read for names with `digit` or `gelsight`, not for {sensor}: leave that sensor out")


def jpeg(image: Any) -> bytes:
    """An image (H, W, 3) as JPEG that loses little: quality 95, full colours."""
    out = BytesIO()
    need("PIL.Image").fromarray(image).save(out, "JPEG", quality=95, subsampling=0)
    return out.getvalue()


def compare(
    dataset: Dataset[Sample],
    start: Callable[[Path], Any],
    out: Path,
    tell: Callable[[int], None],
) -> Optional[str]:
    """What differs between a copy and one that is written anew, or None."""
    with TemporaryDirectory(prefix=f".{out.name}.", dir=out.parent) as folder:
        writer = start(Path(folder))
        parts: list[dict[str, Any]] = []
        first = 0
        for number, shard in enumerate(dataset.shards):

            def samples(first: int = first, last: int = first + shard.samples) -> Iterator[Raw]:
                for index in range(first, last):
                    tell(index)
                    yield dataset.raw(index)

            parts.append(writer.part(number, samples(), Place(first, first)))
            first += shard.samples
        fresh = writer.finish(parts)
        names = {path.relative_to(root).as_posix() for root in (fresh, out) for path in root.rglob("*") if path.is_file()}
        for name in sorted(names):
            ours, theirs = fresh / name, out / name
            if not ours.is_file() or not theirs.is_file():
                return f"{name} is {'missing' if ours.is_file() else 'no part of it'}"
            if ours.read_bytes() != theirs.read_bytes():
                return f"{name} differs"
        shutil.rmtree(fresh)
    return None
