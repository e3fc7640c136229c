"""A copy against its dataset, bit by bit."""

from __future__ import annotations

from collections.abc import Callable
from itertools import zip_longest
from pathlib import Path
from typing import Any, Optional

from gelsim._native import RunError
from gelsim.dataset import Dataset
from gelsim.export.content import Arrays
from gelsim.sample import Sample


def compare(dataset: Dataset[Sample], form: Any, out: Path, tell: Callable[[int], None]) -> Optional[str]:
    """What differs in the first sample that does, or None.

    `form.expectation(dataset)` gives the frames that a copy should hold of a sample, `form.episodes(out)` label and frames that
    it holds.
    """
    episodes, expected = form.episodes(out), form.expectation(dataset)
    frames = 0
    for index in range(len(dataset)):
        raw = dataset.raw(index)
        tell(index)
        where = f"sample {raw.files.key}"
        try:
            label, found = next(episodes)
            if label != raw.label_json:
                return f"{where}: its label differs"
            pairs = zip_longest(expected(raw, index, frames), found)
            for number, (ours, theirs) in enumerate(pairs):
                frame = f", frame {number}" if "sequence" in raw.label else ""
                if ours is None or theirs is None:
                    return f"{where}{frame}: it has {'more' if ours is None else 'fewer'} frames than the dataset"
                if (name := differing(ours, theirs)) is not None:
                    return f"{where}{frame}: {name} differs"
        except StopIteration:
            return f"{where}: it is missing"
        except RunError:
            raise
        except Exception as error:  # whatever a library says of a damaged file
            return f"{where}: it cannot be read: {error}"
        frames += len(raw)
    return None if next(episodes, None) is None else "it has more samples than the dataset"


def differing(ours: Arrays, theirs: Arrays) -> Optional[str]:
    """The first array that is not the same in type, shape and bits."""
    for name in [*ours, *theirs]:
        if name not in ours or name not in theirs:
            return name
        one, other = ours[name], theirs[name]
        if one.dtype != other.dtype or one.shape != other.shape or one.tobytes() != other.tobytes():
            return name
    return None
