"""The extras of the wheel beside the numpy that is there: it stays, and datasets are loaded and copied. What is missing or does
not fit is named in a sentence whose command mends it.

    python extras.py WHEELS         from the project's root; the folder in which install.py has put the wheel

Packages come from PyPI: where that is out of reach nothing is tried.
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
import venv
from concurrent.futures import ThreadPoolExecutor
from importlib import metadata
from pathlib import Path

# The last numpy 1, and the oldest that has wheels for this Python and is not too old for gelsim.
LAST, OLDEST = "1.26.4", {9: "1.22.0", 10: "1.22.0", 11: "1.23.2", 12: "1.26.0"}.get(sys.version_info[1])
EXPORTS = ["lerobot", "zarr", "hdf5"]
USE = """
import sys, gelsim
dataset = gelsim.load(sys.argv[1])
sample = dataset[0]
assert sample["depth"].dtype == "float32" and sample["tactile"].dtype == "uint8" and len(list(dataset)) == len(dataset)
"""
READ = """
import sys, zarr
root = zarr.open_group(sys.argv[1], mode="r")
assert zarr.__version__.startswith("2.") and list(root["meta/episode_ends"]) == [1, 2, 3, 4, 5]
assert root["data/pad0_depth"][4].shape == (36, 48) and root["data/pad0_tactile"][:].any()
"""
WITHOUT = """
import sys, gelsim
try:
    gelsim.load(sys.argv[1])
except ImportError as error:
    sys.stderr.write(str(error))
"""


class Place:
    """A fresh environment with a numpy and the wheel; `constraint` is what nothing may change."""

    def __init__(self, name, numpy, constraint=()):
        self.folder = root / name
        venv.create(self.folder, with_pip=True)
        self.python, self.constraint = self.folder / "bin/python", root / f"{name}.txt"
        self.constraint.write_text("".join(f"{line}\n" for line in constraint))
        if numpy:
            self.pip("install", f"numpy{numpy}")
        self.numpy = self.versions().get("numpy")

    def run(self, *words, status=0, **more):
        environment = {**os.environ, "PATH": f"{self.folder / 'bin'}:{os.environ['PATH']}"}
        done = subprocess.run([str(word) for word in words], capture_output=True, text=True, env=environment, **more)
        assert done.returncode == status, (words, done.stdout, done.stderr)
        assert "Traceback" not in done.stderr, done.stderr
        return done.stderr

    def pip(self, *words):
        self.run(self.python, "-m", "pip", "--quiet", "--disable-pip-version-check", *words)

    def extra(self, *names):
        """Installs the wheel with extras, as `pip install '.[load]'` does, and looks that numpy is as before."""
        for name in names:
            self.pip("install", "--constraint", self.constraint, f"{wheel}[{name}]")
            assert self.versions()["numpy"] == self.numpy, (self.folder, name, self.numpy, self.versions())
            self.pip("check")

    def versions(self):
        """What is installed, by name."""
        found = metadata.distributions(path=[str(next(self.folder.glob("lib/python*/site-packages")))])
        return {each.metadata["Name"].lower(): each.version for each in found}

    def use(self):
        """Loads the dataset and copies it to all formats."""
        self.run(self.python, "-c", USE, dataset)
        for to in EXPORTS:
            out = self.folder / f"copy.{to}"
            self.export(to, out)
            self.export(to, out, "--check")

    def export(self, to, out, *more, status=0):
        return self.run(self.folder / "bin/gelsim-export", dataset, "--to", to, "--out", out, "-q", *more, status=status)

    def mended(self, to, *parts):
        """The export says all the parts in one sentence; its command mends it, and leaves numpy alone."""
        out = self.folder / "mended"
        said = self.export(to, out, status=2)
        assert said.count("\n") == 1 and all(part in said for part in parts), said
        command = re.search(r": (\S+(?: -m pip)? install .*)$", said)[1]
        assert command.startswith("pip install "), command
        self.run("sh", "-c", f"{command} --quiet --disable-pip-version-check")
        self.export(to, out)
        shutil.rmtree(out) if out.is_dir() else out.unlink()
        assert self.numpy in (None, self.versions()["numpy"]), (command, self.numpy, self.versions())


def pinned():
    """numpy 1, which something else pins."""
    place = Place("pinned", f"=={LAST}", [f"numpy=={LAST}"])
    place.extra("numpy", "load")
    place.run(place.python, "-c", USE, dataset)
    place.extra("export")
    place.use()
    # A reader of the Zarr that zarr 2 is, of an old numpy.
    place.pip("install", "--constraint", place.constraint, "zarr<3")
    place.run(place.python, "-c", READ, place.folder / "copy.zarr")
    # What is taken away comes back.
    for name, to in [("pyarrow", "lerobot"), ("pyarrow", "zarr"), ("h5py", "hdf5"), ("openexr", "hdf5"), ("pillow", "lerobot")]:
        place.pip("uninstall", "--yes", name)
        place.mended(to, f"needs {'OpenEXR' if name == 'openexr' else name}, which is not installed: pip install '")
    # One that takes numpy 2 only, and says so as it is imported.
    if sys.version_info >= (3, 11):
        place.pip("install", "--no-deps", "pyarrow>=26")
        place.mended("zarr", "cannot be imported beside numpy 1.26.4", "'pyarrow>=16,<26'")


def alone():
    """numpy 1 that nothing pins: pip may change it, and has no reason to."""
    place = Place("alone", f"=={LAST}")
    place.extra("export")
    place.use()


def newest():
    """numpy 2; libraries that were built for numpy 1, or are too old."""
    place = Place("newest", ">=2")
    place.extra("load", "export")
    place.use()
    if sys.version_info < (3, 13):
        place.pip("install", "--no-deps", "h5py==3.10.0")
        place.mended("hdf5", "h5py 3.10.0 cannot be imported beside numpy 2")
    place.pip("install", "--no-deps", "OpenEXR==3.4.0")
    place.mended("zarr", "needs OpenEXR 3.5 or newer, and 3.4.0 is installed")


def oldest():
    """The lowest versions that the extras allow."""
    lowest = [line for line in bounds() if ">=" in line and not line.startswith("numpy")]
    # Of pillow the first one that has wheels for this Python.
    of_pillow = {9: "9.0.0", 10: "9.0.0", 11: "9.3.0", 12: "10.1.0"}[sys.version_info[1]]
    fixed = [line.replace(">=", "==") for line in lowest if not line.startswith("pillow")] + [f"pillow=={of_pillow}"]
    place = Place("oldest", f"=={OLDEST}", [f"numpy=={OLDEST}", *fixed])
    place.extra("export")
    place.use()


def bare():
    """Without extras: all that is wanting comes with one command."""
    place = Place("bare", None)
    place.pip("install", wheel)
    said = place.run(place.python, "-c", WITHOUT, dataset)
    assert said == "this needs numpy and pillow, which are not installed: pip install 'numpy>=1.22' 'pillow>=9'", said
    place.mended("hdf5", "needs numpy, pillow, h5py and OpenEXR, which are not installed: pip install 'numpy>=1.22' 'pillow>=9'")
    assert set(place.versions()) - {"setuptools"} == {"gelsim", "numpy", "pillow", "h5py", "openexr", "pip"}, place.versions()
    place.run(place.python, "-c", USE, dataset)


def bounds():
    """The requirements of the extras, without markers."""
    text = Path("pyproject.toml").read_text().split("[project.optional-dependencies]")[1].split("\n[")[0]
    found = re.findall(r'"([A-Za-z0-9]+[<>=][^";]*)', text)
    assert len(found) > 6, found
    return list(dict.fromkeys(found))


def same_bounds():
    """The module knows the bounds of the extras."""
    sys.path.insert(0, str(Path("python").resolve()))
    text = Path("python/gelsim/needed.py").read_text()
    known = {}
    exec(compile(text, "needed.py", "exec"), known)
    of_module = set()
    for library in known["LIBRARIES"].values():
        of_module.add(f"{library.name}>={library.lowest}")
        if library.below_with_numpy_1:
            of_module.add(f"{library.name}<{library.below_with_numpy_1}")
    assert of_module == set(bounds()), (of_module, bounds())


if __name__ == "__main__":
    wheel = next(Path(sys.argv[1]).resolve().glob("gelsim-*.whl"))
    same_bounds()
    with tempfile.TemporaryDirectory() as root:
        root = Path(root)
        reach = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--dest", root, "OpenEXR>=3.5"]
        if subprocess.run(reach, capture_output=True).returncode != 0:
            print("skipped: the extras, PyPI is out of reach")
            sys.exit()
        dataset = root / "a dataset"
        maker = Place("maker", None)
        maker.pip("install", wheel)
        small = ["--samples", "5", "--set", "sensor.resolution_px=[48, 36]", "--set", "dataset.samples_per_shard=2", "--quiet"]
        maker.run(maker.folder / "bin/gelsim", "generate", "configs/quickstart.toml", *small, "--out", dataset)
        tries = [newest, bare] + ([pinned, alone, oldest] if sys.version_info < (3, 13) else [])
        with ThreadPoolExecutor(2) as pool:
            for one in [pool.submit(each) for each in sorted(tries, key=lambda each: each is not pinned)]:
                one.result()
    print(f"extras: {len(tries)} environments of Python {sys.version.split()[0]}; numpy stayed, and every command mended what it was for")
