"""An export, shard by shard: what is killed goes on with the same command, and nothing half-written has the final name."""

from __future__ import annotations

import fcntl
import json
import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from gelsim._native import UsageError
from gelsim.dataset import Dataset, Raw
from gelsim.sample import Sample


class Place(NamedTuple):
    """How much comes before a shard."""

    episodes: int
    frames: int


class Writer(Protocol):
    """Writes one format."""

    def part(self, number: int, samples: Iterator[Raw], at: Place) -> dict[str, Any]:
        """Writes shard `number`; may have been killed in it before. Gives what `finish` needs to know, as JSON."""

    def finish(self, parts: list[dict[str, Any]]) -> Path:
        """Puts the parts together; the file or folder that is to get the final name."""


def run(
    dataset: Dataset[Sample],
    out: Path,
    identity: dict[str, Any],
    start: Callable[[Path], Writer],
    source: Callable[[Path], Any],
    tell: Callable[[int], None],
) -> bool:
    """Writes `out`, or goes on with it; False if it was there already.

    `start` makes the writer for a folder; `source` reads the identity of a finished copy; `tell` hears of each
    sample.
    """
    partial = out.with_name(out.name + ".partial")
    if out.exists() or out.is_symlink():
        if source(out) != identity:
            raise UsageError(f"{out} is there and is no such copy of {dataset.path}: name another --out, or move it away")
        shutil.rmtree(partial, ignore_errors=True)
        return False
    with held(partial, out, identity):
        (partial / "parts").mkdir(exist_ok=True)
        writer = start(partial)
        parts: list[dict[str, Any]] = []
        at, first = Place(0, 0), 0
        for number, shard in enumerate(dataset.shards):
            done = partial / f"parts/{number:06}.json"
            if not done.exists():
                frames = 0

                def samples(first: int = first, last: int = first + shard.samples) -> Iterator[Raw]:
                    nonlocal frames
                    for index in range(first, last):
                        raw = dataset.raw(index)
                        frames += len(raw)
                        tell(index)
                        yield raw

                known = writer.part(number, samples(), at)
                write(done, {**known, "episodes": shard.samples, "frames": frames})
            parts.append(json.loads(done.read_bytes()))
            at, first = Place(at.episodes + shard.samples, at.frames + parts[-1]["frames"]), first + shard.samples
        os.rename(writer.finish(parts), out)
        shutil.rmtree(partial)
    return True


@contextmanager
def held(partial: Path, out: Path, identity: dict[str, Any]) -> Iterator[None]:
    """The folder of an export under way, which no other process writes."""
    state = partial / "export.json"
    partial.parent.mkdir(parents=True, exist_ok=True)
    if not partial.exists():
        fresh = partial.with_name(f".{partial.name}.{os.getpid()}")
        shutil.rmtree(fresh, ignore_errors=True)
        fresh.mkdir()
        write(fresh / "export.json", identity)
        try:
            os.rename(fresh, partial)
        except OSError:  # another process was faster: below it holds the lock
            shutil.rmtree(fresh)
    try:
        with open(state) as file:
            if json.load(file) != identity:
                raise UsageError(f"{partial} is what another export to {out} left: delete it, or name another --out")
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise UsageError(f"{partial}: another process is writing it; wait for that, or name another --out") from None
            yield
    except (FileNotFoundError, NotADirectoryError, json.JSONDecodeError, UnicodeDecodeError):
        raise UsageError(f"{partial} is in the way and is nothing that an export left: move it away") from None


def write(path: Path, value: Any) -> None:
    """JSON, whole or not at all."""
    fresh = path.with_name(f"{path.name}.tmp")
    fresh.write_text(json.dumps(value, indent=1, ensure_ascii=False) + "\n")
    os.replace(fresh, path)
