"""Datasets on disk, written from Python."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Optional, Union

from gelsim import _native
from gelsim._native import Job


@dataclass(frozen=True)
class Generated:
    """What a call of `generate` did."""

    path: Path
    """The dataset's folder, as `gelsim.load` takes it."""
    samples: int
    """Samples that were rendered and written."""
    shards: int
    """Shards that were written."""
    shards_there_already: int
    """Shards that an earlier call had written, and that were left as they are."""
    shards_made_again: list[str]
    """Shards that were there, but not as they had been written."""
    in_contact: int
    """Samples written in which the object touches the pad."""
    rejected: int
    """Draws that were not healthy and were drawn again."""
    unhealthy: int
    """Samples written that are not healthy."""
    unconverged: int
    """Samples written whose contact was not solved to the tolerance."""
    unplaced_objects: int
    """Objects that found no place among the others of their samples."""
    light_outside_range: float
    """Share of the contacts, 0 to 1, on which the optics were not calibrated."""
    bytes: int
    """Size of the shards that were written."""
    seconds: float
    """Time it took."""
    complete: bool
    """True if the dataset is complete; false while other processes write shards of it."""


def generate(
    job: Union[str, PathLike[str], Job],
    out: Union[str, PathLike[str]],
    *,
    samples: Optional[int] = None,
    seed: Optional[int] = None,
    fidelity: Optional[str] = None,
    all_effects: bool = False,
    set: Union[Sequence[str], Mapping[str, object]] = (),
    threads: Optional[int] = None,
    overwrite: bool = False,
) -> Generated:
    """Writes the dataset of `job`, a job file or a `Job` that was loaded, to the folder `out`: what `gelsim generate` writes.

    ```python
    done = gelsim.generate("job.toml", "out/presses", samples=200, set={"sensor.preset": "digit"})
    dataset = gelsim.load(done.path)
    ```

    What is there already is left: the same call goes on where one was stopped. `samples`, `seed`, `fidelity`, `all_effects` and
    `set` are those of `Job.load`, and only for a job file. `threads`: all cores if it is left out, one in a process that
    multiprocessing started. `overwrite` replaces a dataset that is in the folder. Ctrl-C ends the call with KeyboardInterrupt,
    after the samples under way; finished shards stay. It may be called any number of times, and from any thread.

    Raises UsageError with every mistake in the job, and where `out` holds something else; RunError for what fails on the way.
    """
    done = _native.generate(job, out, samples, seed, fidelity, all_effects, set, threads, overwrite)
    return Generated(**done)
