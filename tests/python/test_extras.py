"""The extras of the wheel beside the numpy that is there: it stays, and datasets are loaded and copied. What is missing
or does not fit is named in a sentence whose command fixes it. Packages come from PyPI.
"""

import os
import re
import shutil
import subprocess
import sys
import venv
from importlib import metadata

import pytest

pytestmark = pytest.mark.build

MINOR = sys.version_info[1]
# The last numpy 1, and the oldest that has wheels for this Python and is not too old for gelsim; and such a pillow.
LAST = "1.26.4"
OLDEST = {9: "1.22.0", 10: "1.22.0", 11: "1.23.2", 12: "1.26.0"}.get(MINOR)
OLDEST_PILLOW = {9: "9.0.0", 10: "9.0.0", 11: "9.3.0", 12: "10.1.0"}.get(MINOR)


def with_numpy_1(test):
    """Minutes of pip: with --full."""
    return pytest.mark.full(pytest.mark.skipif(MINOR >= 13, reason="no numpy 1 for this Python")(test))


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
    """A fresh environment with a numpy; `constraint` is what nothing may change."""

    def __init__(self, folder, wheel, numpy="", constraint=()):
        self.folder, self.wheel = folder / "venv", wheel
        venv.create(self.folder, with_pip=True)
        self.python, self.constraint = self.folder / "bin/python", folder / "constraint.txt"
        self.constraint.write_text("".join(f"{line}\n" for line in constraint))
        if numpy:
            self.pip("install", f"numpy{numpy}")
        self.numpy = self.versions().get("numpy")

    def run(self, *words, status=0):
        environment = {**os.environ, "PATH": f"{self.folder / 'bin'}:{os.environ['PATH']}"}
        done = subprocess.run([str(word) for word in words], capture_output=True, text=True, env=environment)
        assert done.returncode == status, f"{words}\n{done.stdout}{done.stderr}"
        assert "Traceback" not in done.stderr, done.stderr
        return done.stderr

    def pip(self, *words):
        self.run(self.python, "-m", "pip", "--quiet", "--disable-pip-version-check", *words)

    def install(self, *extras):
        """Installs the wheel with extras, as `pip install '.[load]'` does, and looks that numpy is as before."""
        for extra in extras:
            self.pip("install", "--constraint", self.constraint, f"{self.wheel}[{extra}]")
            assert self.versions()["numpy"] == self.numpy, (extra, self.versions())
            self.pip("check")

    def versions(self):
        """What is installed, by name."""
        found = metadata.distributions(path=[str(next(self.folder.glob("lib/python*/site-packages")))])
        return {each.metadata["Name"].lower(): each.version for each in found}

    def export(self, dataset, to, out, *more, status=0):
        command = self.folder / "bin/gelsim-export"
        return self.run(command, dataset, "--to", to, "--out", out, "-q", *more, status=status)

    def assert_usable(self, dataset):
        """Loads the dataset and copies it to all formats."""
        self.run(self.python, "-c", USE, dataset)
        for to in EXPORTS:
            self.export(dataset, to, self.folder / f"copy.{to}")
            self.export(dataset, to, self.folder / f"copy.{to}", "--check")

    def assert_fixed(self, dataset, to, *parts):
        """The export says all the parts in one sentence; its command fixes it, and leaves numpy alone."""
        out = self.folder / "fixed"
        said = self.export(dataset, to, out, status=2)
        assert said.count("\n") == 1 and all(part in said for part in parts), said
        command = re.search(r": (\S+(?: -m pip)? install .*)$", said)[1]
        assert command.startswith("pip install "), command
        self.run("sh", "-c", f"{command} --quiet --disable-pip-version-check")
        self.export(dataset, to, out)
        shutil.rmtree(out) if out.is_dir() else out.unlink()
        assert self.numpy in (None, self.versions()["numpy"]), (command, self.versions())


@pytest.fixture(scope="module")
def make(wheel, tmp_path_factory):
    """Makes environments; skips where PyPI is out of reach."""
    line = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "OpenEXR>=3.5"]
    if subprocess.run(line, capture_output=True, cwd=tmp_path_factory.mktemp("reach")).returncode != 0:
        pytest.skip("PyPI is out of reach")
    return lambda name, *more: Place(tmp_path_factory.mktemp(name), wheel, *more)


@pytest.fixture(scope="module")
def dataset(run_gelsim, project, tmp_path_factory):
    small = ["--samples", "5", "--set", "sensor.resolution_px=[48, 36]", "--set", "dataset.samples_per_shard=2"]
    out = tmp_path_factory.mktemp("extras") / "a dataset"
    return run_gelsim.generate(project / "configs/quickstart.toml", out, *small)


@pytest.fixture(scope="module")
def pinned(make):
    """numpy 1, which something else pins."""
    place = make("pinned", f"=={LAST}", [f"numpy=={LAST}"])
    place.install("numpy", "load")
    return place


@pytest.fixture(scope="module")
def pinned_with_exports(pinned):
    pinned.install("export")
    return pinned


@with_numpy_1
def test_what_loads_stands_beside_a_numpy_1_that_is_pinned(pinned, dataset):
    pinned.run(pinned.python, "-c", USE, dataset)


@with_numpy_1
def test_all_extras_stand_beside_a_numpy_1_that_is_pinned(pinned_with_exports, dataset):
    pinned_with_exports.assert_usable(dataset)


@with_numpy_1
def test_a_reader_of_an_old_zarr_reads_the_copy(pinned_with_exports, dataset, tmp_path):
    place = pinned_with_exports
    place.export(dataset, "zarr", tmp_path / "copy.zarr")
    place.pip("install", "--constraint", place.constraint, "zarr<3")
    place.run(place.python, "-c", READ, tmp_path / "copy.zarr")


@with_numpy_1
@pytest.mark.parametrize(
    "name, to",
    [("pyarrow", "lerobot"), ("pyarrow", "zarr"), ("h5py", "hdf5"), ("OpenEXR", "hdf5"), ("pillow", "lerobot")],
)
def test_a_package_that_is_taken_away_comes_back(pinned_with_exports, dataset, name, to):
    pinned_with_exports.pip("uninstall", "--yes", name)
    pinned_with_exports.assert_fixed(dataset, to, f"needs {name}, which is not installed: pip install '")


@with_numpy_1
@pytest.mark.skipif(MINOR < 11, reason="no such pyarrow for this Python")
def test_a_package_that_takes_numpy_2_only_is_named(pinned_with_exports, dataset):
    """It says so as it is imported."""
    pinned_with_exports.pip("install", "--no-deps", "pyarrow>=26")
    pinned_with_exports.assert_fixed(dataset, "zarr", "cannot be imported beside numpy 1.26.4", "'pyarrow>=16,<26'")


@with_numpy_1
def test_a_numpy_1_that_nothing_pins_stays(make, dataset):
    """pip may change it, and has no reason to."""
    place = make("alone", f"=={LAST}")
    place.install("export")
    place.assert_usable(dataset)


@pytest.fixture(scope="module")
def newest(make):
    place = make("newest", ">=2")
    place.install("load", "export")
    return place


def test_all_extras_stand_beside_numpy_2(newest, dataset):
    newest.assert_usable(dataset)


@with_numpy_1
def test_a_package_that_was_built_for_numpy_1_is_named(newest, dataset):
    newest.pip("install", "--no-deps", "h5py==3.10.0")
    newest.assert_fixed(dataset, "hdf5", "h5py 3.10.0 cannot be imported beside numpy 2")


def test_a_package_that_is_too_old_is_named(newest, dataset):
    newest.pip("install", "--no-deps", "OpenEXR==3.4.0")
    newest.assert_fixed(dataset, "zarr", "needs OpenEXR 3.5 or newer, and 3.4.0 is installed")


def bounds(project):
    """The requirements of the extras, without markers."""
    text = (project / "pyproject.toml").read_text().split("[project.optional-dependencies]")[1].split("\n[")[0]
    found = re.findall(r'"([A-Za-z0-9-]+[<>=][^";]*)', text)
    assert len(found) > 6, found
    return list(dict.fromkeys(found))


@with_numpy_1
def test_the_lowest_versions_that_the_extras_allow_work(make, dataset, project):
    lowest = [line.replace(">=", "==") for line in bounds(project) if ">=" in line]
    lowest = [line for line in lowest if not line.startswith(("numpy", "pillow"))]
    place = make("oldest", f"=={OLDEST}", [f"numpy=={OLDEST}", f"pillow=={OLDEST_PILLOW}", *lowest])
    place.install("export")
    place.assert_usable(dataset)


def test_without_extras_all_that_is_missing_comes_with_one_command(make, dataset):
    place = make("bare")
    place.pip("install", place.wheel)
    said = place.run(place.python, "-c", WITHOUT, dataset)
    assert said == "this needs numpy and pillow, which are not installed: pip install 'numpy>=1.22' 'pillow>=9'", said
    needed = "needs numpy, pillow, h5py and OpenEXR, which are not installed: pip install 'numpy>=1.22' 'pillow>=9'"
    place.assert_fixed(dataset, "hdf5", needed)
    assert set(place.versions()) - {"setuptools"} == {"gelsim", "numpy", "pillow", "h5py", "openexr", "pip"}
    place.run(place.python, "-c", USE, dataset)


def test_the_module_knows_the_bounds_of_the_extras(project, monkeypatch):
    monkeypatch.syspath_prepend(project / "python")
    known = {}
    exec(compile((project / "python/gelsim/needed.py").read_text(), "needed.py", "exec"), known)
    of_module = set()
    for library in known["LIBRARIES"].values():
        of_module.add(f"{library.name}>={library.lowest}")
        if library.below_with_numpy_1:
            of_module.add(f"{library.name}<{library.below_with_numpy_1}")
    assert of_module == set(bounds(project))
