"""Arrays of Zarr v2 as files: what of the format a copy needs, by itself. The library zarr decides which numpy is installed, and
takes a new one only; readers of copies may have any version of it.

https://zarr-specs.readthedocs.io/en/latest/v2/v2.0.html
"""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import Any, Optional

from gelsim.needed import need

COMPRESSOR = {"id": "zstd", "level": 1}


def codec() -> Any:
    """What packs chunks."""
    return need("pyarrow").Codec(COMPRESSOR["id"], compression_level=COMPRESSOR["level"])


def make_group(folder: Path, attributes: Optional[dict[str, Any]] = None) -> None:
    """Makes a group, or describes it anew."""
    folder.mkdir(parents=True, exist_ok=True)
    describe(folder / ".zgroup", {"zarr_format": 2})
    if attributes is not None:
        describe(folder / ".zattrs", attributes)


def describe(path: Path, value: Any) -> None:
    """Writes a file of the format's own."""
    path.write_text(json.dumps(value, indent=4, ensure_ascii=False) + "\n", encoding="utf-8")


def chunk_name(number: int, axes: int) -> str:
    """The file of a chunk that has all of each axis but the first."""
    return ".".join([str(number), *["0"] * (axes - 1)])


class Written:
    """An array of which chunks are written, each of some rows of the first axis and all of the others."""

    def __init__(self, folder: Path, rows_in_chunk: int) -> None:
        self.folder, self.rows_in_chunk = folder, rows_in_chunk
        self.codec = codec()

    def make(self, shape: tuple[int, ...], dtype: Any, attributes: dict[str, Any]) -> Written:
        """Makes it, without chunks."""
        self.folder.mkdir(parents=True, exist_ok=True)
        about = {
            "zarr_format": 2,
            "shape": shape,
            "chunks": [self.rows_in_chunk, *shape[1:]],
            "dtype": dtype.str,
            "compressor": COMPRESSOR,
            "fill_value": "" if dtype.kind == "U" else 0,
            "order": "C",
            "filters": None,
        }
        describe(self.folder / ".zarray", about)
        describe(self.folder / ".zattrs", attributes)
        return self

    def put(self, number: int, rows: Any) -> None:
        """Writes chunk `number`; fewer rows than a chunk has are followed by zeros."""
        data: bytes = rows.tobytes()
        data += bytes((self.rows_in_chunk - len(rows)) * (len(data) // len(rows)))
        (self.folder / chunk_name(number, rows.ndim)).write_bytes(self.codec.compress(data, asbytes=True))


class Store:
    """A copy that is read: a folder, or a zip."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.zip = None if path.is_dir() else zipfile.ZipFile(path)

    def read(self, name: str) -> bytes:
        """A file; FileNotFoundError or KeyError if there is none."""
        return (self.path / name).read_bytes() if self.zip is None else self.zip.read(name)

    def attributes(self, name: str = "") -> dict[str, Any]:
        """Those of a group or an array, of the root without a name."""
        found: dict[str, Any] = json.loads(self.read(f"{name}/.zattrs".lstrip("/")))
        return found

    def arrays(self, group: str) -> dict[str, Read]:
        """The arrays of a group by name."""
        if self.zip is None:
            files = [path.relative_to(self.path).as_posix() for path in (self.path / group).glob("*/.zarray")]
        else:
            files = [name for name in self.zip.namelist() if name.startswith(f"{group}/") and name.endswith("/.zarray")]
        return {name: Read(self, f"{group}/{name}") for name in sorted(file.split("/")[1] for file in files)}


class Read:
    """An array that is read, chunk by chunk; the last one is kept."""

    def __init__(self, store: Store, name: str) -> None:
        self.store, self.name = store, name
        about = json.loads(store.read(f"{name}/.zarray"))
        self.dtype = need("numpy").dtype(about["dtype"])
        self.shape, self.chunk = tuple(about["shape"]), tuple(about["chunks"])
        self.codec = codec()
        self.last: tuple[int, Any] = -1, None

    def rows(self, begin: int, end: int) -> Any:
        """Rows `begin` to `end`."""
        numpy, step = need("numpy"), self.chunk[0]
        if begin == end:
            return numpy.zeros((0, *self.shape[1:]), self.dtype)
        several = range(begin // step, (end - 1) // step + 1)
        first = several[0] * step
        return numpy.concatenate([self.chunk_at(number) for number in several])[begin - first : end - first]

    def row(self, number: int) -> Any:
        """Row `number`."""
        return self.chunk_at(number // self.chunk[0])[number % self.chunk[0]]

    def chunk_at(self, number: int) -> Any:
        """Chunk `number`; one that is not there is zeros, as the library leaves such out."""
        if self.last[0] != number:
            numpy = need("numpy")
            size = int(numpy.prod(self.chunk, dtype="int64")) * self.dtype.itemsize
            try:
                packed = self.store.read(f"{self.name}/{chunk_name(number, len(self.shape))}")
                data = self.codec.decompress(packed, decompressed_size=size, asbytes=True)
            except (FileNotFoundError, KeyError):
                data = bytes(size)
            self.last = number, numpy.frombuffer(data, self.dtype).reshape(self.chunk)
        return self.last[1]
