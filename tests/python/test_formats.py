"""Datasets loaded in Python: what comes is what the job renders, and nothing ends in a traceback."""

import multiprocessing
import pickle
import random
import re
import shlex
import shutil
import subprocess
import sys
import types

import pytest

gelsim = pytest.importorskip("gelsim", reason="the module is not installed: pip install .")
for name in ["OpenEXR", "PIL"]:
    pytest.importorskip(name, reason="pip install '.[load]' pytest")

import numpy as np
from every_kind import FLOATS, KINDS, NPY, PNG16, adopt, digest, digest_at, refusal
from processes import run
from snippet import snippets

pytestmark = pytest.mark.wheel

# Layers that are half floats in EXR files.
HALVES = {"depth", "surface", "normal", "gap", "flow", "lamps"}


@pytest.fixture(params=KINDS)
def kind(request):
    return request.param


def assert_loaded(where, ours, theirs, settings):
    """A loaded frame is a rendered one; half floats are the nearest ones, and of png16 within half a step."""
    assert [name for name in ours if name != "key"] == list(theirs), where
    for name, value in theirs.items():
        its = ours[name]
        if name == "label":
            assert {**its, "png16": None} == {**value, "png16": None}, where
        elif name in ("left", "right"):
            assert_loaded((*where, name), its, value, settings)
        elif isinstance(value, dict):
            assert its.keys() == value.keys(), (where, name)
            for key in value:
                assert np.array_equal(its[key], value[key]) and its[key].dtype == value[key].dtype, (where, name, key)
        else:
            assert its.dtype == value.dtype and its.shape == value.shape and its.flags.writeable, (where, name)
            if PNG16 in settings and name in ("depth", "surface"):
                step = ours["label"]["png16"][f"{name}_mm_per_step"]
                assert 0 < step < 1e-3 and np.abs(its.astype("f8") - value).max() <= 0.501 * step, (where, name)
                continue
            halves = NPY not in settings and FLOATS not in settings and name in HALVES
            expected = value.astype("float16").astype("float32") if halves else value
            assert its.tobytes() == expected.tobytes(), (where, name)


def order(job):
    """Numbers of a job's samples in the order of the dataset's shards."""
    return [index for split in ["train", "val", "test"] for index in job.indices(split)]


def test_a_loaded_sample_is_what_the_job_renders(every_kind, kind):
    job, settings = every_kind.job(kind), KINDS[kind][1]
    for index, ours in zip(order(job), every_kind.samples(kind), strict=True):
        theirs = job[index]
        assert ours["key"] == f"{index:09}" == ours["label"]["key"]
        if "frames" in theirs:
            assert len(ours["frames"]) == len(theirs["frames"]) and ours["label"] == theirs["label"]
            for number, (one, other) in enumerate(zip(ours["frames"], theirs["frames"])):
                assert_loaded((kind, index, number), one, other, settings)
        else:
            assert_loaded((kind, index), ours, theirs, settings)


def test_a_dataset_knows_what_its_job_knows(every_kind, kind):
    dataset, job = every_kind.load(kind), every_kind.job(kind)
    assert len(dataset) == len(job) == len(order(job))
    assert (dataset.layers, dataset.classes, dataset.fingerprint) == (job.layers, job.classes, job.fingerprint)
    assert list(dataset.splits) == [split for split in ["train", "val", "test"] if job.indices(split)]


def test_a_split_holds_the_jobs_samples_of_it(every_kind, kind):
    job, splits = every_kind.job(kind), every_kind.load(kind).splits
    for split, count in splits.items():
        part = gelsim.load(str(every_kind.path(kind)), split=split)
        assert [part[k]["label"]["index"] for k in range(len(part))] == job.indices(split)
        assert len(part) == count


def test_the_last_sample_is_also_number_minus_one(every_kind, kind):
    dataset, last = every_kind.load(kind), order(every_kind.job(kind))[-1]
    assert dataset[-1]["key"] == dataset[np.int64(len(dataset) - 1)]["key"] == f"{last:09}"


def test_a_number_out_of_range_is_an_index_error(every_kind, kind):
    dataset = every_kind.load(kind)
    for wrong in [len(dataset), -len(dataset) - 1]:
        assert f"0 to {len(dataset) - 1}" in refusal(IndexError, lambda: dataset[wrong])


@pytest.mark.parametrize("wrong", ["0", 0.5, slice(1)], ids=repr)
def test_what_is_no_number_is_a_type_error(every_kind, kind, wrong):
    refusal(TypeError, lambda: every_kind.load(kind)[wrong])


def test_an_unknown_split_is_refused_by_name(every_kind, kind):
    assert "tarin" in refusal(gelsim.UsageError, lambda: every_kind.load(kind, split="tarin"))


@pytest.fixture(params=[(kind, state) for kind in ["halves", "frames"] for state in ["used", "fresh"]], ids=" ".join)
def dataset_and_digests(request, every_kind):
    """A dataset that was read before, or was not, and what its samples are."""
    kind, state = request.param
    dataset = every_kind.load(kind)
    if state == "used":
        list(dataset)
    return dataset, [digest(sample) for sample in every_kind.load(kind)]


def test_a_pickled_dataset_has_the_same_samples(dataset_and_digests):
    dataset, expected = dataset_and_digests
    assert [digest(sample) for sample in pickle.loads(pickle.dumps(dataset))] == expected


@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_worker_processes_see_the_same_samples(dataset_and_digests, method):
    dataset, expected = dataset_and_digests
    with multiprocessing.get_context(method).Pool(2, adopt, [dataset]) as pool:
        assert pool.map(digest_at, range(len(dataset)), chunksize=1) == expected


@pytest.fixture
def five(every_kind):
    """Five samples and the batch of them."""
    samples = every_kind.samples("npy")[:5]
    return samples, gelsim.collate(samples)


def test_a_batch_is_arrays_of_numpy_and_lists(five):
    assert {type(value) for value in five[1].values()} <= {np.ndarray, list}


@pytest.mark.parametrize("name", ["tactile", "depth", "contact", "normal", "flow"])
def test_layers_of_a_batch_are_stacked(five, name):
    samples, batch = five
    assert batch[name].dtype == samples[0][name].dtype
    assert np.array_equal(batch[name], [its[name] for its in samples])


def test_markers_labels_and_keys_of_a_batch_are_those_of_the_samples(five):
    samples, batch = five
    assert batch["markers"][3] is samples[3]["markers"]
    assert batch["label"] == [its["label"] for its in samples] and batch["key"] == [its["key"] for its in samples]


def test_pose_and_wrench_of_a_batch_are_those_of_the_labels(five):
    samples, batch = five
    for pose, wrench, its in zip(batch["pose"], batch["wrench"], samples, strict=True):
        label = its["label"]
        known = label["pose"]["translation_mm"] + label["pose"]["quaternion_xyzw"]
        assert np.array_equal(pose, np.array(known, "float32"))
        force = [*label["shear"]["force_n"], -label["contact"]["total_force_n"]]
        assert np.array_equal(wrench[:3], np.array(force, "float32")) and np.isnan(wrench[3:]).all()


def test_a_force_that_nobody_knows_is_nan(every_kind):
    assert np.isnan(gelsim.collate([every_kind.samples("forceless")[0]])["wrench"][:, 2:]).all()


def test_the_wrench_on_a_curved_gel_is_that_of_its_contact(every_kind):
    sample = every_kind.samples("tactip")[0]
    label, wrench = sample["label"]["contact"], gelsim.collate([sample])["wrench"][0]
    assert np.array_equal(wrench, np.array(label["force_vector_n"] + label["torque_nmm"], "float32"))


def test_sequences_are_padded_to_the_longest(every_kind):
    samples = every_kind.samples("sequences")
    batch, counts = gelsim.collate(samples), [len(its["frames"]) for its in samples]
    assert len(set(counts)) > 1, "all sequences have the same length"
    assert batch["mask"].sum(axis=1).tolist() == counts and "frames" not in batch
    assert batch["pose"].shape == (len(samples), max(counts), 7)
    for row, its in enumerate(samples):
        for number, frame in enumerate(its["frames"]):
            assert np.array_equal(batch["tactile"][row][number], frame["tactile"]) and batch["mask"][row][number]
            known = its["label"]["frames"][number]["wrench"]
            wrench = np.array(known["force_n"] + known["torque_nmm"], "float32")
            assert np.array_equal(batch["wrench"][row][number], wrench)
        assert not batch["tactile"][row][counts[row] :].any()
        assert batch["markers"][row][0] is its["frames"][0]["markers"]


def test_no_samples_make_no_batch():
    assert "samples is empty" in refusal(gelsim.UsageError, lambda: gelsim.collate([]))


def test_samples_with_different_layers_make_no_batch(every_kind):
    mixed = [every_kind.samples("npy")[0], every_kind.samples("tactip")[0]]
    assert "depth" in refusal(gelsim.UsageError, lambda: gelsim.collate(mixed))


@pytest.mark.parametrize("kind, name", [("sequences", "flow"), ("lifts", "slip")])
@pytest.mark.parametrize("turn", [1, -1])
def test_frames_with_different_layers_make_no_batch(every_kind, kind, name, turn):
    """Of two samples, or of one."""
    whole, other = every_kind.samples(kind)[:2]

    def less(frame):
        return {key: less(value) if key in ("left", "right") else value for key, value in frame.items() if key != name}

    all_frames = {**other, "frames": [less(frame) for frame in other["frames"]]}
    one_frame = {**other, "frames": [less(other["frames"][0]), *other["frames"][1:]]}
    for lacking in (all_frames, one_frame):
        said = refusal(gelsim.UsageError, lambda lacking=lacking: gelsim.collate([whole, lacking][::turn]))
        assert said.startswith("frames have different layers: ") and f"'{name}'" in said, said


def test_frames_that_the_label_does_not_tell_make_no_batch(every_kind):
    sample = every_kind.samples("sequences")[0]
    cut = {**sample, "frames": sample["frames"][:2]}
    assert "has 2 frames, and its label" in refusal(gelsim.UsageError, lambda: gelsim.collate([cut]))


@pytest.mark.parametrize(
    "change, kind, words",
    [
        pytest.param(lambda sample: sample, TypeError, "samples is of type dict; give a list", id="a sample"),
        pytest.param(lambda sample: iter([sample]), TypeError, "list_iterator; give a list", id="an iterator"),
        pytest.param(lambda sample: [(sample, 1)], TypeError, "an item of samples is of type tuple", id="tuples"),
        pytest.param(lambda sample: [{"tactile": sample["tactile"]}], gelsim.UsageError, "keep `label`", id="no label"),
        pytest.param(lambda sample: [{**sample, "label": 3}], gelsim.UsageError, "keep `label`", id="a number as label"),
    ],
)
def test_what_are_no_samples_make_no_batch(every_kind, change, kind, words):
    given = change(every_kind.samples("npy")[0])
    assert words in refusal(kind, lambda: gelsim.collate(given))


def test_frames_of_different_sizes_are_tensors_as_well(every_kind, monkeypatch):
    torch = types.ModuleType("torch")
    torch.__version__, torch.from_numpy = "9", lambda array: ("tensor", array.shape)
    monkeypatch.setitem(sys.modules, "torch", torch)
    first, second = every_kind.samples("sequences")[:2]
    half = [{**frame, "tactile": frame["tactile"][::2]} for frame in second["frames"]]
    batch = gelsim.collate_torch([first, {**second, "frames": half}])
    assert [row[0] for row in batch["tactile"]] == [("tensor", (30, 40, 3)), ("tensor", (15, 40, 3))]


def test_without_torch_the_way_to_it_is_named(every_kind, monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    said = refusal(ImportError, lambda: gelsim.collate_torch([every_kind.samples("npy")[0]]))
    assert "pip install torch" in said and "gelsim.collate gives arrays" in said


def test_a_torch_of_another_numpy_is_named(every_kind, monkeypatch):
    """It can be imported, and finds no numpy."""

    def from_numpy(array):
        raise RuntimeError("Numpy is not available")

    torch = types.ModuleType("torch")
    torch.__version__, torch.from_numpy = "1.13.1", from_numpy
    monkeypatch.setitem(sys.modules, "torch", torch)
    said = refusal(ImportError, lambda: gelsim.collate_torch([every_kind.samples("npy")[0]]))
    assert f"torch 1.13.1 cannot use numpy {np.__version__}" in said and "pip install 'numpy<2'" in said


TENSORS = """
import sys, gelsim, torch
from torch.utils.data import DataLoader
for batch in DataLoader(SOURCE, batch_size=3, num_workers=2, collate_fn=gelsim.collate_torch):
    n = len(batch["label"])
    assert batch["tactile"].dtype == torch.uint8 and batch["depth"].dtype == torch.float32, batch.keys()
    assert batch["pose"].shape == (n, 7) and batch["wrench"].shape == (n, 6) and batch["pose"].dtype == torch.float32
    lists = {"label", "key", "markers"}
    assert all(isinstance(value, torch.Tensor) for name, value in batch.items() if name not in lists)
"""
PADDED = """
import sys, gelsim, torch
from torch.utils.data import DataLoader
for batch in DataLoader(gelsim.load(sys.argv[1]), batch_size=2, num_workers=2, collate_fn=gelsim.collate_torch):
    assert batch["mask"].dtype == torch.bool
    assert batch["tactile"].shape[:2] == batch["mask"].shape == batch["pose"].shape[:2]
"""


NO_TENSORS = """
import gelsim
try:
    gelsim.collate_torch([])
except gelsim.UsageError as error:
    assert "samples is empty" in str(error), error
else:
    raise AssertionError("a batch of no samples")
"""


def test_a_data_loader_makes_tensors_of_a_dataset(every_kind, torch_python):
    run(torch_python, "-c", TENSORS.replace("SOURCE", "gelsim.load(sys.argv[1])"), every_kind.path("npy"))


def test_a_data_loader_makes_tensors_of_a_job(every_kind, torch_python):
    code = TENSORS.replace("SOURCE", "gelsim.Job.load(sys.argv[1], samples=6)")
    run(torch_python, "-c", code, every_kind.job_file("npy"))


def test_a_data_loader_pads_sequences(every_kind, torch_python):
    run(torch_python, "-c", PADDED, every_kind.path("sequences"))


def test_no_samples_make_no_tensors(torch_python):
    run(torch_python, "-c", NO_TENSORS)


def cut(path, count):
    path.write_bytes(path.read_bytes()[:-count])


def member(folder, ending):
    """The first of a shard's files with that ending."""
    return next(folder.glob(f"*.{ending}"))


TAR, FOLDER = "data/train-000001.tar", "data/train-000001"
# What becomes of a shard, a tar or a folder.
DAMAGE = {
    "a missing tar": (TAR, lambda tar: tar.unlink()),
    "a tar cut off": (TAR, lambda tar: cut(tar, 2048)),
    "an empty tar": (TAR, lambda tar: tar.write_bytes(b"")),
    "a tar of zeros": (TAR, lambda tar: tar.write_bytes(bytes(tar.stat().st_size))),
    "another shard": (TAR, lambda tar: tar.write_bytes(tar.with_name("train-000000.tar").read_bytes())),
    "a missing folder": (FOLDER, shutil.rmtree),
    "a missing depth": (FOLDER, lambda folder: member(folder, "depth.exr").unlink()),
    "an empty depth": (FOLDER, lambda folder: member(folder, "depth.exr").write_bytes(b"")),
    "a depth cut off": (FOLDER, lambda folder: cut(member(folder, "depth.exr"), 9)),
    "no image": (FOLDER, lambda folder: member(folder, "tactile.png").write_bytes(b"no image")),
    "an empty label": (FOLDER, lambda folder: member(folder, "json").write_text("{}")),
    "a missing label": (FOLDER, lambda folder: member(folder, "json").unlink()),
}


@pytest.fixture
def damaged(every_kind, tmp_path):
    """Says what comes of loading a dataset once something in a copy of it is changed."""

    def load(kind, change, error=gelsim.RunError):
        copy = shutil.copytree(every_kind.path(kind), tmp_path / "damaged 'one'")
        change(copy)
        said = refusal(error, lambda: list(gelsim.load(copy)))
        assert "gelsim verify" in said if error is gelsim.RunError else "gelsim " in said
        # Commands that a shell takes: quotes and a blank are in the path.
        for command in re.findall("`(gelsim [^`]*)`", said):
            words = shlex.split(command)
            assert str(copy) in words or str(copy / "job.toml") in words or "FOLDER" in words
        return said

    return load


@pytest.mark.parametrize("damage", DAMAGE)
def test_a_damaged_shard_is_named(damaged, damage):
    shard, change = DAMAGE[damage]
    assert shard in damaged("halves" if shard == TAR else "floats", lambda out: change(out / shard))


def test_a_dataset_without_its_manifest_is_to_be_generated(damaged):
    assert "generate" in damaged("halves", lambda out: (out / "dataset.json").unlink(), gelsim.UsageError)


@pytest.mark.parametrize("text", ["", "{", "[]", '{"manifest_version": 1}', '{"manifest_version": 99}', "null", "\xff"])
def test_a_damaged_manifest_is_named(damaged, text):
    change = lambda out: (out / "dataset.json").write_text(text, "latin-1")
    assert "dataset.json" in damaged("halves", change, gelsim.UsageError)


def test_a_folder_that_is_no_dataset_is_refused(project):
    assert "no dataset" in refusal(gelsim.UsageError, lambda: gelsim.load(project / "configs"))


def test_a_folder_that_is_not_there_is_refused(tmp_path):
    assert "no folder" in refusal(gelsim.UsageError, lambda: gelsim.load(tmp_path / "absent"))


def test_bytes_that_change_anywhere_end_in_words_or_in_nothing(every_kind, tmp_path):
    copy, chance, found = shutil.copytree(every_kind.path("halves"), tmp_path / "copy"), random.Random(3), 0
    valid = (copy / TAR).read_bytes()
    for _ in range(150):
        broken = bytearray(valid)
        for _ in range(chance.choice([1, 3, 40])):
            broken[chance.randrange(len(broken))] = chance.randrange(256)
        (copy / TAR).write_bytes(broken)
        try:
            list(gelsim.load(copy))
        except gelsim.RunError as error:
            assert TAR in str(error)
            found += 1
    assert found > 20, "too few of 150 changes are found"


PAGES = ["load.md", "export.md"]
# Snippets of these pages by what is in them, and the library that each needs beside the module.
SNIPPETS = {
    'gelsim.load("out/quickstart", split="train")\nsample': "gelsim",
    "import DataLoader": "torch",
    "import LeRobotDataset": "lerobot",
    "load_dataset(": "datasets",
    "zarr.open_group(": "zarr",
    "h5py.File(": "h5py",
}


@pytest.fixture(scope="module")
def page_folder(run_gelsim, project, tmp_path_factory):
    """A folder where the pages' commands have run on the quickstart's dataset in few pixels."""
    for module in ["pyarrow", "h5py"]:
        pytest.importorskip(module, reason="pip install '.[export]'")
    folder = tmp_path_factory.mktemp("page")
    small = ["--samples", 16, "--set", "sensor.resolution_px=[40, 30]"]
    run_gelsim.generate(project / "configs/quickstart.toml", folder / "out/quickstart", *small)
    text = "".join((project / "docs/how-to" / page).read_text() for page in PAGES)
    lines = re.findall("^    gelsim-export (.*)", text, re.M)
    assert lines, f"no command gelsim-export in {PAGES}"
    # Copies that the snippets read, and the pages do not make.
    copies = {"zarr": "quickstart.zarr.zip", "hdf5": "quickstart.h5"}
    lines += [f"out/quickstart --to {to} --out {name}" for to, name in copies.items()]
    for line in lines:
        run(sys.executable, "-m", "gelsim.export.command", *line.split(), "--quiet", cwd=folder)
    return folder


def page_snippets(project):
    return [code for page in PAGES for code in snippets(project / "docs/how-to" / page)]


@pytest.mark.parametrize("part", SNIPPETS, ids=SNIPPETS.values())
def test_the_pages_snippets_run(page_folder, project, request, part):
    codes = [code for code in page_snippets(project) if part in code]
    assert codes, f"no snippet of {PAGES} has {part!r}"
    python, needed = sys.executable, SNIPPETS[part]
    if needed in ("torch", "lerobot"):
        python = request.getfixturevalue("torch_python")
    if subprocess.run([python, "-c", f"import {needed}"], capture_output=True).returncode:
        pytest.skip(f"{python} has no {needed}: pip install {needed}")
    for code in codes:
        run(python, "-c", code, cwd=page_folder)


def test_every_snippet_of_the_pages_is_run(project):
    unknown = [code for code in page_snippets(project) if not any(part in code for part in SNIPPETS)]
    assert not unknown, "SNIPPETS lacks what is in these"


def test_the_snippets_of_a_lerobot_copys_card_run(page_folder):
    pytest.importorskip("datasets", reason="pip install datasets")
    copy = page_folder / "quickstart.lerobot"
    codes = snippets(copy / "README.md")
    assert codes, "the card has no snippet"
    for code in codes:
        run(sys.executable, "-c", code, cwd=copy)
