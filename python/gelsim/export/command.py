"""The command `gelsim-export`."""

from __future__ import annotations

import argparse
import errno
import os
import re
import sys
import time
from difflib import get_close_matches
from importlib import import_module
from pathlib import Path
from traceback import extract_tb
from typing import Any, Optional

from gelsim import __version__
from gelsim._native import RunError, UsageError
from gelsim.dataset import SET_FILE, Dataset, SensorSet, read_manifest, read_set
from gelsim.export import check, parts, trees
from gelsim.export.content import identity
from gelsim.needed import LIBRARIES, installed, need_all
from gelsim.sample import Sample

FORMATS = ["lerobot", "zarr", "hdf5", "fota", "tacbench", "touchd", "ftp1", "sitr"]
ONE_OF = "one of lerobot, zarr, hdf5, fota, tacbench, touchd, ftp1 or sitr (docs/how-to/export.md)"

MEANT = {
    "lerobot": ["parquet", "arrow", "huggingface", "hugging_face", "hf", "datasets", "lerobot_v3", "lerobotdataset"],
    "zarr": ["zarr2", "zarr_v2", "zip", "replay_buffer", "diffusion_policy", "umi"],
    "hdf5": ["h5", "hdf", "h5py", "robomimic", "mat", "matlab"],
    "ftp1": ["ftp", "ftp_1", "oxt", "open_x_tactile"],
    "fota": ["t3", "foundation_tactile"],
    "tacbench": ["sparsh", "tac_bench", "digitv1"],
    "touchd": ["anytouch", "any_touch", "anytouch2", "touchd_force", "touc_hd"],
}
"""Other words for formats, in lower case with `_` between words."""

ELSEWHERE = [
    (["rlds", "tfrecord", "tfds", "oxe", "open_x"], "there is no such copy; lerobot has the same episodes"),
    (["webdataset", "wds", "tar", "imagefolder", "folder", "png"], "`gelsim generate` writes it, see [output] container"),
    (["npz", "npy", "numpy", "pickle", "pkl", "pt", "torch"], "in Python gelsim.load and gelsim.collate give arrays, gelsim.collate_torch tensors"),
]
"""Formats that no copy has, and what to do instead."""

WAYS_OUT = {
    **dict.fromkeys([errno.ENOSPC, errno.EDQUOT], "make room there; the same command goes on"),
    **dict.fromkeys([errno.EACCES, errno.EPERM, errno.EROFS], "make it writable, or choose another --out"),
    **dict.fromkeys([errno.EEXIST, errno.ENOTDIR], "it is a file, where a folder is to be: choose another --out"),
}
"""What to do about errors of the system."""


def format_named(name: str) -> str:
    """One of FORMATS, or what is meant by another word."""
    guess = re.sub("[- .]", "_", name.strip().lower()).strip("_")
    if name in FORMATS:
        return name
    where = next((f"{where}; " for words, where in ELSEWHERE if guess in words), "")
    near = get_close_matches(guess, FORMATS, 1, 0.7)
    meant = next((f"did you mean {meant}? " for meant, words in MEANT.items() if guess in words or meant in near), where)
    raise argparse.ArgumentTypeError(f"no format is called {name!r}: {meant}{ONE_OF}")


def folder(text: str) -> Path:
    """A path as a shell has it: with the home folder for `~`. An address is none."""
    address = re.fullmatch("([a-z][a-z0-9+.-]+):/+(.*)", text, re.DOTALL | re.IGNORECASE)
    if address is not None and address[1].lower() == "file":
        raise argparse.ArgumentTypeError(f"{text} is an address: write the path alone, /{address[2]}")
    if address is not None:
        raise argparse.ArgumentTypeError(f"{text} is an address: name a folder, and copy that, as with `aws s3 sync`")
    path = os.path.expanduser(text)
    if path.startswith("~"):
        raise argparse.ArgumentTypeError(f"{text} names nobody's home folder: write ./{text} if it is called so")
    return Path(path)


def arguments() -> argparse.ArgumentParser:
    """What the command takes."""
    parser = argparse.ArgumentParser(
        prog="gelsim-export",
        description="Copies a dataset that `gelsim generate` wrote to another format. A copy that was stopped goes on with "
        "the same command.",
        epilog="Exit status: 0 done, 1 failed while running (or --check found a difference), 2 wrong arguments.",
    )
    parser.add_argument("dataset", metavar="DIR", type=folder, help="folder of the dataset; or of a set of sensors for fota, tacbench, touchd, ftp1 and sitr")
    parser.add_argument(
        "--to", required=True, type=format_named, metavar="FORMAT", help="lerobot, zarr, hdf5, fota, tacbench, touchd, ftp1 or sitr (docs/how-to/export.md)"
    )
    parser.add_argument(
        "-o", "--out", required=True, type=folder, help="the copy: a folder; of hdf5 a file; of zarr a file if it ends in .zip"
    )
    parser.add_argument(
        "--calibration", type=folder, metavar="DIR", help="for sitr: folder of the calibration presses of the same sensors, if the set has none of its own"
    )
    parser.add_argument("--check", action="store_true", help="compare the copy OUT with DIR, bit by bit, and write nothing")
    parser.add_argument("-q", "--quiet", action="store_true", help="no progress and no summary")
    parser.add_argument("--version", action="version", version=f"gelsim-export {__version__}")
    return parser


class Progress:
    """One line on a terminal."""

    def __init__(self, dataset: Dataset[Sample], quiet: bool) -> None:
        self.dataset = dataset
        self.shown = sys.stderr.isatty() and not quiet and os.environ.get("TERM", "dumb") != "dumb"
        self.begun = self.told = time.monotonic()
        self.samples = 0

    def tell(self, sample: int) -> None:
        """Sample `sample` is next."""
        self.samples += 1
        if self.shown and (now := time.monotonic()) > self.told + 0.2:
            self.told = now
            speed = self.samples / (now - self.begun)
            # One column less than there are: a full line would go on in the next.
            text = f"{sample + 1}/{len(self.dataset)} samples, {speed:.0f} samples/s"[: columns() - 1]
            print(f"\r\x1b[K{text}", end="", file=sys.stderr, flush=True)

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


def columns() -> int:
    """Those of the terminal; some say that they have none."""
    try:
        return os.get_terminal_size(sys.stderr.fileno()).columns or 80
    except OSError:
        return 80


def run(options: argparse.Namespace) -> int:
    """Runs the command; its exit status."""
    form: Any = import_module(f"gelsim.export.{options.to}")
    out: Path = options.out
    if out.name in {"", ".."} and not options.check:
        name = "file, such as ./copy.h5" if options.to == "hdf5" else "folder, such as ./copy"
        raise UsageError(f"--out {out} is there already: name a new {name}")
    if options.dataset.is_file():
        raise UsageError(f"{options.dataset} is a file: name the folder of a dataset; `gelsim generate JOB --out FOLDER` writes one")
    is_tree, is_set = hasattr(form.Writer, "SOURCE"), (options.dataset / SET_FILE).is_file()
    if is_set and not is_tree:
        raise UsageError(f"{options.dataset} is a set of sensors: name the folder of one of them")
    folder = read_set(options.dataset)["sensors"][0]["folder"] if is_set else ""
    suffixes = read_manifest(options.dataset / folder)["layers"]
    has_exr = form.HAS_FLOATS and any(suffix.endswith(".exr") for suffix in suffixes)
    # All at once, before anything that needs one of them.
    need_all([*form.LIBRARIES, *(["OpenEXR"] if has_exr else [])])
    dataset: Dataset[Sample] = (SensorSet if is_set else Dataset)(options.dataset)
    if len(dataset) == 0:
        raise UsageError(f"{options.dataset} has no samples: `gelsim generate JOB --out FOLDER` writes some")
    if options.calibration is not None and options.to != "sitr":
        raise UsageError(f"--calibration is for sitr, and {options.to} has no calibration images: leave it out")
    more: dict[str, Any] = {}
    if options.to == "sitr":
        options.calibration = form.find_calibration(dataset, options.calibration)
        more = {"calibration": form.prepare(dataset, options.calibration)}
    elif is_tree:
        form.prepare(dataset)
    progress = Progress(dataset, options.quiet)
    whence = {**identity(dataset, options.to), **more}

    def start(folder: Path) -> Any:
        writer = form.Writer(dataset, folder, out, whence)
        if options.to == "sitr":
            writer.calibration = options.calibration
        return writer

    try:
        if options.check:
            if form.source(out) != whence:
                help = "name the copy with --out" if out.exists() else "without --check the same command writes one"
                raise UsageError(f"{out} is no {options.to} copy of {dataset.path}: {help}")
            difference: Optional[str]
            if is_tree:
                difference = trees.compare(dataset, start, out, progress.tell)
            else:
                difference = check.compare(dataset, form, out, progress.tell)
            progress.clear()
            if difference is not None:
                raise RunError(f"{out}: {difference}; delete it and export again")
            if not options.quiet:
                print(f"{out} holds {dataset.path} bit for bit: {progress.summary()}", file=sys.stderr)
            return 0
        new = parts.run(dataset, out, whence, start, form.source, progress.tell)
    finally:
        progress.clear()
    if not options.quiet:
        print(f"{out}: {progress.summary() if new else 'is there already, and complete'}", file=sys.stderr)
    return 0


def said(error: OSError) -> str:
    """The system's words without its numbers, and a way out."""
    if error.strerror is None:
        return str(error)
    help = WAYS_OUT.get(error.errno or 0)
    return f"{error.filename or 'the copy'}: {error.strerror}" + (f"; {help}" if help else "")


def bug(error: Exception) -> str:
    """What nobody foresaw: where it happened, and beside which libraries."""
    at = extract_tb(error.__traceback__)[-1]
    versions = [f"{its.name} {found}" for its in LIBRARIES.values() if (found := installed(its)) is not None]
    return (
        f"{type(error).__name__}: {error}; it is a bug of gelsim {__version__} or of a library: please report it with this: "
        f"{at.filename}:{at.lineno}, {', '.join(versions)}"
    )


def main(argv: Optional[list[str]] = None) -> int:
    """Runs the command of `argv`, of `sys.argv` without it; its exit status."""
    options = arguments().parse_args(argv)
    try:
        return run(options)
    except (UsageError, ImportError) as error:
        message, status = str(error), 2
    except KeyboardInterrupt:
        print("stopped: the same command goes on", file=sys.stderr)
        return 130
    except RunError as error:
        message, status = str(error), 1
    except OSError as error:
        message, status = said(error), 1
    except Exception as error:  # no traceback for who only copies a dataset
        message, status = bug(error), 1
    print(f"error: {message}", file=sys.stderr)
    return status


if __name__ == "__main__":
    sys.exit(main())
