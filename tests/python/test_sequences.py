"""Datasets of sequences as their users load them: by WebDataset, Hugging Face and the snippets of their cards."""

import io
import subprocess
import sys
import tarfile

import pytest

gelsim = pytest.importorskip("gelsim", reason="the module is not installed: pip install .")
datasets = pytest.importorskip("datasets", reason="no datasets: pip install datasets")

import numpy
import samples
import webdataset
from PIL import Image
from snippet import snippets

pytestmark = pytest.mark.wheel

SETTINGS = ["sensor.resolution_px=[80, 60]", 'output.depth_format="npy"']


@pytest.fixture(scope="module")
def tars(run_gelsim, project, tmp_path_factory):
    out = tmp_path_factory.mktemp("sequences") / "tars"
    flags = (word for setting in SETTINGS for word in ["--set", setting])
    return run_gelsim.generate(project / "configs/sequences.toml", out, "--samples", 3, *flags)


@pytest.fixture(scope="module")
def folders(run_gelsim, project, tmp_path_factory):
    out = tmp_path_factory.mktemp("sequences") / "folders"
    flags = (word for setting in [*SETTINGS, 'output.container="folder"'] for word in ["--set", setting])
    return run_gelsim.generate(project / "configs/sequences.toml", out, "--samples", 3, *flags)


@pytest.fixture(scope="module")
def read(tars):
    """The samples of the tars, by key."""
    found = {}
    for shard in sorted((tars / "data").glob("*.tar")):
        for sample in webdataset.WebDataset(str(shard), shardshuffle=False).decode("rgb8"):
            found[sample["__key__"]] = sample
    return found


def test_tars_have_each_frame_of_each_sequence(read):
    assert len(read) == 3
    for sample in read.values():
        label = sample["json"]
        count = label["sequence"]["frames"]
        assert len(label["frames"]) == count == sum(phase["frames"] for phase in label["sequence"]["phases"])
        members = ["tactile.png", "contact.png", "slip.png", "flow.npy", "markers.json"]
        names = {f"f{k:04d}.{member}" for k in range(count) for member in members}
        assert names | {"json", "__key__", "__url__"} <= set(sample) and f"f{count:04d}.tactile.png" not in sample


def test_labels_fit_the_schema(read, project):
    labels = samples.validator(project / "docs/schema/sequence.json")
    for sample in read.values():
        labels.validate(sample["json"])


@pytest.mark.parametrize("container", ["tars", "folders"])
def test_the_snippets_of_the_card_run(request, container):
    out = request.getfixturevalue(container)
    found = snippets(out / "README.md")
    assert found, "the card has no snippet"
    for code in found:
        done = subprocess.run([sys.executable, "-c", code], cwd=out, capture_output=True, text=True)
        assert done.returncode == 0, f"{code}\n{done.stderr}"


def test_hugging_face_loads_each_frame_of_folders_as_it_is_in_tars(read, folders):
    rows = [row for split in datasets.load_dataset(str(folders)).values() for row in split]
    assert len(rows) == sum(sample["json"]["sequence"]["frames"] for sample in read.values())
    for row in rows:
        sample, number = read[row["key"]], row["frame"]["index"]
        assert numpy.array_equal(numpy.asarray(row["image"]), sample[f"f{number:04d}.tactile.png"])
        assert row["frame"]["wrench"] == sample["json"]["frames"][number]["wrench"]
        assert row["sequence"]["first_slip_s"] == sample["json"]["sequence"]["first_slip_s"]
        flow = numpy.load(folders / row["flow_path"])
        assert flow.shape == (60, 80, 2) and flow.dtype == numpy.float32


@pytest.fixture(scope="module")
def job(project):
    return gelsim.Job.load(project / "configs/sequences.toml", samples=3, set=SETTINGS)


def test_the_module_renders_the_bytes_of_the_files(job, tars, read):
    members = {}
    for shard in (tars / "data").glob("*.tar"):
        with tarfile.open(shard) as tar:
            members |= {member.name: tar.extractfile(member).read() for member in tar}
    for index, ours in enumerate(job):
        key = f"{index:09}"
        assert list(ours) == ["frames", "label"] and ours["label"] == read[key]["json"]
        for number, frame in enumerate(ours["frames"]):
            assert list(frame) == ["tactile", "contact", "markers", "slip", "flow"], list(frame)
            at = f"{key}.f{number:04d}"
            for name in ["tactile", "contact", "slip"]:
                picture = numpy.asarray(Image.open(io.BytesIO(members[f"{at}.{name}.png"])))
                assert numpy.array_equal(frame[name], picture), (at, name)
            assert numpy.array_equal(frame["flow"], numpy.load(io.BytesIO(members[f"{at}.flow.npy"]))), at


def test_the_pad_sticks_or_slips_where_it_touches(job):
    for sample in job:
        for frame in sample["frames"]:
            assert set(numpy.unique(frame["slip"])) <= {0, 128, 255}
            assert numpy.array_equal(frame["slip"] > 0, frame["contact"] > 0)
