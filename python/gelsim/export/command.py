"""The command `gelsim-export`."""

from __future__ import annotations

import argparse
import sys
import time
from importlib import import_module
from pathlib import Path
from typing import Any, Optional

from gelsim import __version__
from gelsim._native import RunError, UsageError
from gelsim.dataset import Dataset
from gelsim.export import check, parts
from gelsim.export.content import identity

FORMATS = ["lerobot", "zarr", "hdf5"]


def arguments() -> argparse.ArgumentParser:
    """What the command takes."""
    parser = argparse.ArgumentParser(
        prog="gelsim-export",
        description="Copies a dataset that `gelsim generate` wrote to another format. A copy that was stopped goes on with "
        "the same command.",
        epilog="Exit status: 0 done, 1 failed while running (or --check found a difference), 2 wrong arguments.",
    )
    parser.add_argument("dataset", metavar="DIR", type=Path, help="folder of the dataset")
    parser.add_argument("--to", required=True, choices=FORMATS, help="format of the copy (docs/formats.md)")
    parser.add_argument(
        "--out", required=True, type=Path, help="the copy: a folder; of hdf5 a file; of zarr a file if it ends in .zip"
    )
    parser.add_argument("--check", action="store_true", help="compare the copy OUT with DIR, bit by bit, and write nothing")
    parser.add_argument("--quiet", action="store_true", help="no progress and no summary")
    parser.add_argument("--version", action="version", version=f"gelsim-export {__version__}")
    return parser


class Progress:
    """One line on a terminal."""

    def __init__(self, dataset: Dataset, shown: bool) -> None:
        self.dataset, self.shown = dataset, shown
        self.begun = self.told = time.monotonic()
        self.samples = 0

    def tell(self, sample: int) -> None:
        """Sample `sample` is next."""
        self.samples += 1
        if self.shown and (now := time.monotonic()) > self.told + 0.2:
            self.told = now
            speed = self.samples / (now - self.begun)
            print(f"\r{sample + 1}/{len(self.dataset)} samples, {speed:.0f} samples/s ", end="", file=sys.stderr, flush=True)

    def clear(self) -> None:
        """Takes the line away."""
        if self.shown and self.told > self.begun:
            print("\r\x1b[K", end="", file=sys.stderr, flush=True)

    def summary(self) -> str:
        """Samples, time and speed."""
        seconds = time.monotonic() - self.begun
        megabytes = sum(shard.bytes for shard in self.dataset.shards) * self.samples / max(len(self.dataset), 1) / 1e6
        speed = f"{self.samples / seconds:.0f} samples/s, {megabytes / seconds:.1f} MB/s of the dataset"
        return f"{self.samples} samples in {seconds:.1f} s ({speed})"


def run(options: argparse.Namespace) -> int:
    """Runs the command; its exit status."""
    form: Any = import_module(f"gelsim.export.{options.to}")
    form.libraries()
    dataset = Dataset(options.dataset)
    if len(dataset) == 0:
        raise UsageError(f"{options.dataset} has no samples")
    out = Path(options.out)
    progress = Progress(dataset, sys.stderr.isatty() and not options.quiet)
    whence = identity(dataset, options.to)
    try:
        if options.check:
            if form.source(out) != whence:
                raise UsageError(f"{out} is no {options.to} copy of {dataset.path}")
            difference: Optional[str] = check.compare(dataset, form, out, progress.tell)
            progress.clear()
            if difference is not None:
                raise RunError(f"{out}: {difference}")
            if not options.quiet:
                print(f"{out} holds {dataset.path} bit for bit: {progress.summary()}", file=sys.stderr)
            return 0
        new = parts.run(
            dataset, out, whence, lambda folder: form.Writer(dataset, folder, out, whence), form.source, progress.tell
        )
    finally:
        progress.clear()
    if not options.quiet:
        print(f"{out}: {progress.summary() if new else 'is there already, and complete'}", file=sys.stderr)
    return 0


def main(argv: Optional[list[str]] = None) -> int:
    """Runs the command of `argv`, of `sys.argv` without it; its exit status."""
    options = arguments().parse_args(argv)
    try:
        return run(options)
    except (UsageError, ImportError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("stopped: the same command goes on", file=sys.stderr)
        return 130
    except (RunError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1


if __name__ == "__main__":
    sys.exit(main())
