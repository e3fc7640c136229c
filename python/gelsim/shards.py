"""Files of samples on disk, in shards that are tars or folders. Nothing stays open: datasets can be pickled and forked."""

from __future__ import annotations

import os
import tarfile
from array import array
from pathlib import Path
from shlex import quote
from typing import NamedTuple, Protocol

from gelsim._native import RunError


class Entry(NamedTuple):
    """A shard as `dataset.json` lists it."""

    path: Path
    split: str
    samples: int
    bytes: int


class Files(Protocol):
    """The files of a sample."""

    @property
    def key(self) -> str:
        """The sample's name."""

    def read(self, suffix: str) -> bytes:
        """The file `KEY.suffix`; RunError if there is none."""


class Index(Protocol):
    """Where a shard's samples are."""

    def __len__(self) -> int: ...
    def files(self, position: int) -> Files:
        """Those of the sample at `position` of the shard."""


def damaged(path: Path, reason: str) -> RunError:
    """What to raise where a dataset is not as it was written; `path` is a shard or a file in one."""
    root = next((parent.parent for parent in path.parents if parent.name == "data"), path.parent)
    return RunError(
        f"{path}: {reason}\n`gelsim verify {word(root)}` names all that is wrong; `{generate(root)}` makes such shards again"
    )


def generate(root: Path) -> str:
    """The command that makes what is wanting of the dataset at `root`."""
    return f"gelsim generate {word(root / 'job.toml')} --out {word(root)}"


def word(path: Path) -> str:
    """A path as a shell takes it, and no option."""
    return quote(f"./{path}" if str(path).startswith("-") else str(path))


def index(entry: Entry) -> Index:
    """Finds a shard's samples: eight bytes for each are kept."""
    if not entry.path.exists():
        raise damaged(entry.path, "this shard is missing")
    found: Index = Folder(entry.path) if entry.path.is_dir() else Tar(entry)
    if len(found) != entry.samples:
        raise damaged(entry.path, f"holds {len(found)} samples; dataset.json says {entry.samples}")
    return found


class Tar:
    """A shard that is a tar. Its members stand sample by sample."""

    def __init__(self, entry: Entry) -> None:
        self.path = entry.path
        size = entry.path.stat().st_size
        if size != entry.bytes:
            raise damaged(entry.path, f"has {size} bytes; dataset.json says {entry.bytes}")
        starts, key, end = array("q"), None, 0
        try:
            with tarfile.open(entry.path) as tar:
                while (member := tar.next()) is not None:
                    vars(tar)["members"] = []  # it would keep each
                    if (its := member.name.split(".", 1)[0]) != key:
                        starts.append(member.offset)
                        key = its
                    end = member.offset_data + -(-member.size // 512) * 512
        except (OSError, tarfile.TarError) as error:
            raise damaged(entry.path, f"is no whole tar: {error}") from None
        starts.append(end)
        self.starts = starts

    def __len__(self) -> int:
        return len(self.starts) - 1

    def files(self, position: int) -> TarFiles:
        """Reads the headers of one sample."""
        try:
            with open(self.path, "rb") as file:
                file.seek(self.starts[position])
                members: dict[str, tuple[int, int]] = {}
                key = ""
                with tarfile.open(fileobj=file, mode="r:") as tar:
                    while tar.offset < self.starts[position + 1] and (member := tar.next()) is not None:
                        key, _, suffix = member.name.partition(".")
                        members[suffix] = member.offset_data, member.size
        except (OSError, tarfile.TarError) as error:
            raise damaged(self.path, f"cannot be read: {error}") from None
        return TarFiles(key, self.path, members)


class TarFiles(NamedTuple):
    """Offset and size of a sample's files in its tar."""

    key: str
    path: Path
    members: dict[str, tuple[int, int]]

    def read(self, suffix: str) -> bytes:
        """The file `KEY.suffix`; RunError if there is none."""
        if suffix not in self.members:
            raise damaged(self.path, f"{self.key}.{suffix} is missing in it")
        offset, size = self.members[suffix]
        try:
            with open(self.path, "rb", buffering=0) as file:
                data = os.pread(file.fileno(), size, offset)
        except OSError as error:
            raise damaged(self.path, f"cannot be read: {error}") from None
        if len(data) != size:
            raise damaged(self.path, f"ends within {self.key}.{suffix}")
        return data


class Folder:
    """A shard that is a folder: files named after sample and layer."""

    def __init__(self, path: Path) -> None:
        self.path = path
        names = (name.name.split(".") for name in os.scandir(path))
        keys = (parts[0] for parts in names if len(parts) == 2 and parts[1] == "json")
        self.keys = array("q", sorted(int(key) for key in keys if len(key) == 9 and key.isdecimal()))

    def __len__(self) -> int:
        return len(self.keys)

    def files(self, position: int) -> FolderFiles:
        """Those of the sample at `position` of the shard."""
        return FolderFiles(f"{self.keys[position]:09}", self.path)


class FolderFiles(NamedTuple):
    """A sample's files in its folder."""

    key: str
    path: Path

    def read(self, suffix: str) -> bytes:
        """The file `KEY.suffix`; RunError if there is none."""
        path = self.path / f"{self.key}.{suffix}"
        try:
            return path.read_bytes()
        except OSError as error:
            raise damaged(path, f"cannot be read: {error.strerror}") from None
