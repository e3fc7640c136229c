"""`gelsim.Job`, `gelsim.generate` and `gelsim.load` against the command: the same arrays, labels and words."""

import filecmp
import json
import pickle
import signal
import subprocess
import sys
import threading
import time
from types import SimpleNamespace

import pytest

gelsim = pytest.importorskip("gelsim", reason="the module is not installed: pip install .")

import numpy as np
import samples
from module_checks import LAYERS, LEVELS, assert_refused, refusal, refusals, same, warned

pytestmark = pytest.mark.wheel

EVERY_LAYER = f"output.layers={json.dumps(LAYERS)}"
HASTY = 'gelpad={ elastic = { resolution = "full", max_iterations = 4, tolerance_um = 0.5 } }'

# As mixed as samples get: contact and none, relief, markers that move, a lens, noise.
MIXED = """
sensor.resolution_px = [96, 72]
object = [{ path = "OBJECTS/sphere.obj" }, { path = "OBJECTS/gear.obj" }]
texture.amplitude_mm = { choice = [0.0, 0.05] }
markers.pitch_mm = 1.5
shear.x_mm = [-0.3, 0.3]
camera = { distortion_k1 = { choice = [0.0, -0.1] }, exposure = [0.9, 1.1], read_noise_levels = 1.0 }
pose.yaw_deg = [0.0, 360.0]
indentation = { depth_mm = [0.3, 1.0], no_contact = 0.3 }
output.depth_format = "npy"
[dataset]
name = "module"
samples = 13
seed = 5
samples_per_shard = 4
splits = { train = 0.7, val = 0.15, test = 0.15 }
"""


@pytest.fixture(scope="module")
def mixed(project, tmp_path_factory):
    """The job's file."""
    path = tmp_path_factory.mktemp("job") / "mixed.toml"
    path.write_text(MIXED.replace("OBJECTS", str(project / "objects")))
    return path


@pytest.fixture
def write(run_gelsim, mixed, tmp_path):
    """Writes the job's dataset with flags of `gelsim generate`; gives its samples by index, and its manifest."""
    return lambda *flags: read(run_gelsim.generate(mixed, tmp_path / "written", *flags))


def read(out):
    manifest = json.loads((out / "dataset.json").read_text())
    return {int(key): sample for key, sample in samples.read(out, manifest)}, manifest


@pytest.fixture(scope="module")
def with_every_layer(run_gelsim, mixed, tmp_path_factory):
    """The job with every layer, what the command writes of it, and the dataset's manifest."""
    out = tmp_path_factory.mktemp("every_layer") / "out"
    return gelsim.Job.load(mixed, set=[EVERY_LAYER]), *read(run_gelsim.generate(mixed, out, "--set", EVERY_LAYER))


def same_as_written(ours, theirs, layers):
    """The label and every bit of the arrays, which are as torch.from_numpy wants them."""
    assert list(ours) == ["tactile", *layers, "label"], list(ours)
    assert ours["label"] == theirs["json"]
    for name in ["tactile", *layers]:
        written = samples.layer(theirs, name)
        if name == "markers":
            assert {key: value.tolist() for key, value in ours[name].items()} == written
            assert all(value.shape[1:] == (2,) for value in ours[name].values())
            continue
        if name == "contact":
            written = written[..., 0]  # grey, read as RGB
        assert ours[name].dtype == written.dtype and np.array_equal(ours[name], written), name
        assert ours[name].flags.c_contiguous and ours[name].flags.writeable, name


def test_samples_are_those_that_the_command_writes(with_every_layer):
    job, written, _ = with_every_layer
    assert len(job) == len(written) == 13
    for index in range(len(job)):
        same_as_written(job.sample(index), written[index], LAYERS)


def test_a_job_says_what_the_manifest_says(with_every_layer):
    job, _, manifest = with_every_layer
    assert (job.name, job.layers, job.fingerprint) == ("module", LAYERS, manifest["fingerprint"])
    assert job.classes == ["gear", "sphere"]


def test_the_samples_are_mixed(with_every_layer):
    labels = [sample["json"] for sample in with_every_layer[1].values()]
    assert {label["contact"]["in_contact"] for label in labels} == {True, False}
    assert {label["camera"]["distortion"][0] for label in labels} == {0.0, -0.1}


@pytest.mark.parametrize("split", ["train", "val", "test"])
def test_indices_of_a_split_are_those_of_the_labels(with_every_layer, split):
    job, written, _ = with_every_layer
    labels = [sample["json"] for sample in written.values()]
    assert job.indices(split) == [label["index"] for label in labels if label["split"] == split] != []


@pytest.mark.parametrize("level", LEVELS)
def test_every_flag_is_the_commands(mixed, write, level):
    written, _ = write("--samples", 2, "--seed", 8, "--fidelity", level, "--all-effects")
    job = gelsim.Job.load(str(mixed), samples=2, seed=8, fidelity=level, all_effects=True)
    assert (len(job), job.seed, job.fidelity, job.layers) == (2, 8, level, ["depth"])
    for index in range(2):
        same_as_written(job[index], written[index], ["depth"])


def test_files_of_half_floats_hold_the_rounded_arrays(mixed, write):
    written, _ = write("--samples", 2, "--set", 'output.depth_format="exr"')
    depth = gelsim.Job.load(mixed, samples=2)[1]["depth"]
    assert np.array_equal(depth.astype(np.float16).astype(np.float32), written[1]["depth.exr"])
    assert not np.array_equal(depth, written[1]["depth.exr"])


def test_a_level_that_a_bound_chooses_is_told_and_is_the_commands(mixed, write):
    bound = "fidelity={ max_error_um = 40.0 }"
    job, said = warned(lambda: gelsim.Job.load(mixed, samples=2, set=[bound]))
    assert any(f"fidelity {job.fidelity} chosen" in text for text in said), said
    written, _ = write("--samples", 2, "--set", bound)
    same_as_written(job[1], written[1], ["depth"])
    same_as_written(pickle.loads(pickle.dumps(job))[1], written[1], ["depth"])


def test_samples_whose_contact_is_not_solved_are_drawn_again(mixed, write):
    flags = [HASTY, 'output.on_unhealthy="reject"', "camera.distortion_k1=0.0"]
    written, _ = write(*(word for text in flags for word in ["--set", text]))
    job = gelsim.Job.load(mixed, set=flags)
    again = [index for index, sample in written.items() if sample["json"]["attempt"] > 0]
    assert again
    same_as_written(job[again[0]], written[again[0]], ["depth"])

    # A job that wants none other; what it advises works as it stands there.
    flags[1] = 'output.on_unhealthy="fail"'
    said = refusal(gelsim.RunError, lambda: gelsim.Job.load(mixed, set=flags).sample(again[0]))
    assert said.startswith(f"sample {again[0]:09} (seed 5, drawn 1 time) is not healthy: the contact"), said
    advised = said.split("set=['", 1)[1].split("']", 1)[0]
    assert not gelsim.Job.load(mixed, set=[flags[0], advised, flags[2]])[again[0]]["label"]["health"]["healthy"]


def test_a_dataset_without_a_healthy_sample_is_no_success(project, tmp_path):
    path = tmp_path / "heavy.toml"
    path.write_text(
        f"""
        dataset = {{ name = "heavy", samples = 2 }}
        sensor.resolution_px = [48, 36]
        object = [{{ path = "{project / "objects/sphere.obj"}" }}]
        indentation.force_n = 400.0
        output.on_unhealthy = "keep"
        """
    )
    said = refusal(gelsim.RunError, lambda: warned(lambda: gelsim.generate(path, tmp_path / "out")))
    assert said.startswith("none of the 2 samples is healthy") and "health.reason" in said, said
    # What was written stays.
    assert all(not sample["label"]["health"]["healthy"] for sample in gelsim.load(tmp_path / "out"))


@pytest.fixture(scope="module")
def job(mixed):
    return gelsim.Job.load(mixed)


@pytest.fixture(scope="module")
def each(job):
    """The job's samples, one by one."""
    return [job.sample(index) for index in range(len(job))]


def test_a_job_is_a_sequence_of_its_samples(job, each):
    for one, other in zip(job, each, strict=True):
        same(one, other)
    same(job[-1], each[-1])
    same(job[np.int64(3)], each[3])
    assert repr(job) == '<gelsim.Job "module": 13 samples, fidelity standard>'


def test_several_samples_are_each_the_same_in_any_order(mixed, job, each):
    order = [5, 0, 12, 5]
    for several in [job.samples(order), job.__getitems__(order), gelsim.Job.load(mixed, threads=1).samples(order)]:
        for index, sample in zip(order, several, strict=True):
            same(sample, each[index])
    assert job.samples([]) == []


def test_a_pickled_job_says_the_same_in_any_folder(mixed, job, each, monkeypatch, project):
    monkeypatch.chdir(mixed.parent)
    pickled = pickle.dumps(gelsim.Job.load(mixed.name))
    monkeypatch.chdir(project)
    again = pickle.loads(pickled)
    assert again.fingerprint == job.fingerprint
    same(again[4], each[4])


def test_all_mistakes_of_a_job_are_told_at_once_in_the_commands_words(mixed, run_gelsim, tmp_path):
    broken = tmp_path / "broken.toml"
    text = mixed.read_text().replace("samples = 13", "sampels = 13").replace("gear.obj", "gaer.obj")
    broken.write_text(text.replace("[0.3, 1.0]", "[0.3, 99.0]"))
    said = run_gelsim("generate", broken, "--out", tmp_path / "none", status=2).stderr.removesuffix("\n")
    assert refusal(gelsim.UsageError, lambda: gelsim.Job.load(broken)) == said
    assert all(part in said for part in ["sampels", "gaer.obj", "99", "broken.toml:"]), said


@pytest.mark.parametrize(
    "flag", ["indentation.depth_mm=-1", "a.b.c", 'sensor.preset="digti"', 'output.layers=["presure"]']
)
def test_a_wrong_assignment_is_told_in_the_commands_words(mixed, run_gelsim, flag):
    said = run_gelsim("plan", mixed, "--set", flag, status=2).stderr.removesuffix("\n")
    assert refusal(gelsim.UsageError, lambda: gelsim.Job.load(mixed, set=[flag])) == said


def test_an_absent_job_is_told_in_the_commands_words(run_gelsim, tmp_path):
    absent = tmp_path / "absent.toml"
    said = run_gelsim("plan", absent, status=2).stderr.removesuffix("\n")
    assert refusal(gelsim.UsageError, lambda: gelsim.Job.load(absent)) == said


@pytest.mark.parametrize("name", ["threads", "samples", "seed"])
@pytest.mark.parametrize("wrong", [-1, 2**70, 2**200], ids=["-1", "2**70", "2**200"])
def test_a_number_out_of_range_is_answered_with_numbers_that_are_taken(mixed, name, wrong):
    said = refusal(gelsim.UsageError, lambda: gelsim.Job.load(mixed, **{name: wrong}))
    low, high = (int(word.strip(",")) for word in said.split("give ", 1)[1].split()[:3:2])
    assert said.count("error: ") == 1 and low in (0, 1) and high > 1000, said
    gelsim.Job.load(mixed, **{name: low})
    if name != "threads":
        gelsim.Job.load(mixed, **{name: high}, set=["dataset.samples_per_shard=1000000"])


@pytest.mark.parametrize("wrong", [-1, 0, 5000])
def test_a_wrong_number_of_threads_is_answered_with_the_same_advice(mixed, wrong):
    said = refusal(gelsim.UsageError, lambda: gelsim.Job.load(mixed, threads=wrong))
    assert said.split("help: ")[1] == "give 1 to 1024, or leave it out for all cores"


def test_a_dict_of_dotted_keys_is_the_same_as_the_commands_texts(mixed, job):
    values = {
        "indentation.depth_mm": (0.3, 0.5),
        "sensor.preset": "digit",
        "camera.exposure": np.float32(1.25),
        "dataset.seed": np.int64(9),
        "markers.pitch_mm": 2.0,
        "output.layers": ["depth", "gap"],
        "gelpad": {"elastic": {"resolution": "half", "max_iterations": 50}},
        "sensor.darkening": np.array(0.5),
    }
    texts = [
        "indentation.depth_mm=[0.3, 0.5]",
        'sensor.preset="digit"',
        "camera.exposure=1.25",
        "dataset.seed=9",
        "markers.pitch_mm=2.0",
        'output.layers=["depth", "gap"]',
        'gelpad={ elastic = { resolution = "half", max_iterations = 50 } }',
        "sensor.darkening=0.5",
    ]
    (ours, said), (theirs, they) = (warned(lambda: gelsim.Job.load(mixed, set=given)) for given in (values, texts))
    assert ours.fingerprint == theirs.fingerprint != job.fingerprint and said == they


@pytest.mark.parametrize(
    "value, text",
    [(-1, "-1"), (float("nan"), "nan"), (True, "true"), ("deep", '"deep"'), ({"a": 1}, '{ "a" = 1 }')],
    ids=str,
)
def test_a_wrong_value_is_told_as_its_text_is(mixed, value, text):
    said = refusal(gelsim.UsageError, lambda: gelsim.Job.load(mixed, set={"indentation.depth_mm": value}))
    assert said == refusal(gelsim.UsageError, lambda: gelsim.Job.load(mixed, set=[f"indentation.depth_mm = {text}"]))


@pytest.fixture(scope="module")
def generated(mixed, tmp_path_factory):
    """The job's dataset with every layer, as `gelsim.generate` writes it, and what that says it did."""
    out = tmp_path_factory.mktemp("generated") / "path"
    done = gelsim.generate(mixed, out, set={"output.layers": LAYERS}, seed=6, threads=2)
    return done.path, done


def test_generate_says_what_it_did(generated):
    path, done = generated
    assert path.name == "path" and (done.samples, done.complete, done.shards_there_already) == (13, True, 0)


@pytest.mark.parametrize("way", ["path", "job", "thread"])
def test_generate_writes_the_commands_files(mixed, run_gelsim, generated, tmp_path, way):
    written = run_gelsim.generate(mixed, tmp_path / "written", "--set", EVERY_LAYER, "--seed", 6)
    ours = generated[0] if way == "path" else tmp_path / way
    if way == "job":
        gelsim.generate(gelsim.Job.load(mixed, set=[EVERY_LAYER], seed=6), str(ours))
    if way == "thread":
        thread = threading.Thread(target=lambda: gelsim.generate(str(mixed), ours, set=[EVERY_LAYER], seed=6))
        thread.start()
        thread.join()
    names = [path.relative_to(written) for path in written.rglob("*") if path.is_file() and path.parent.name != "stats"]
    assert len(names) > 5
    _, *rest = filecmp.cmpfiles(written, ours, names, shallow=False)
    assert rest == [[], []]


def test_generate_goes_on_with_what_is_there(mixed, tmp_path):
    def generate(**more):
        return gelsim.generate(mixed, tmp_path / "out", **more)

    done = generate(seed=6)
    again = generate(seed=6)
    assert (again.samples, again.shards, again.shards_there_already) == (0, 0, done.shards)
    tar = next((tmp_path / "out/data").glob("train-*.tar"))
    tar.write_bytes(tar.read_bytes()[:-512])
    again = generate(seed=6)
    assert (again.shards, again.shards_made_again) == (1, [tar.stem])
    said = refusal(gelsim.UsageError, generate)
    assert "another job" in said or "overwrite" in said, said
    assert generate(samples=2, overwrite=True).samples == 2


def test_control_c_ends_generate_between_samples_and_the_process_goes_on(mixed, tmp_path):
    # A shell starts what runs in the background with SIGINT ignored, and Python leaves it so.
    code = (
        "import signal, sys, gelsim\nsignal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "try:\n    gelsim.generate(sys.argv[1], sys.argv[2], samples=3000, threads=1)\n"
        "except KeyboardInterrupt:\n    print('interrupted', flush=True)\n"
        "print(gelsim.generate(sys.argv[1], sys.argv[2] + '-2', samples=2).samples)"
    )
    out = tmp_path / "stopped"
    stopped = subprocess.Popen([sys.executable, "-c", code, mixed, out], stdout=subprocess.PIPE, text=True)
    while not list(out.glob("stats/*.json")):
        assert stopped.poll() is None
        time.sleep(0.01)
    stopped.send_signal(signal.SIGINT)
    assert stopped.communicate(timeout=120)[0] == "interrupted\n2\n" and stopped.returncode == 0
    assert not (out / "dataset.json").exists() and not list(out.glob("data/.*.partial"))


def in_contact(sample):
    """What `load` may turn a sample into."""
    return bool(sample["contact"].any())


@pytest.fixture
def turned(generated):
    return gelsim.load(generated[0], "train", transform=in_contact, layers=["contact"])


def test_load_reads_the_layers_that_are_wanted(generated):
    some = gelsim.load(generated[0], layers=["tactile", "markers"])
    assert [list(sample) for sample in some] == [["tactile", "markers", "label", "key"]] * 13
    for ours, theirs in zip(some, gelsim.load(generated[0]), strict=True):
        assert np.array_equal(ours["tactile"], theirs["tactile"]) and ours["label"] == theirs["label"]
    assert list(gelsim.load(generated[0], layers=[])[0]) == ["label", "key"]


def test_load_gives_what_a_function_makes_of_samples(generated, turned):
    assert list(turned) == [bool(sample["contact"].any()) for sample in gelsim.load(generated[0], "train")]
    assert set(turned) == {True, False}


def test_datasets_are_pickled(generated, turned):
    for dataset in (gelsim.load(generated[0], layers=["tactile", "markers"]), turned):
        again = pickle.loads(pickle.dumps(dataset))
        assert (again.wanted, again.transform, len(again)) == (dataset.wanted, dataset.transform, len(dataset))
    assert list(again) == list(turned)


def test_a_dataset_is_where_it_was_when_the_process_goes_elsewhere(generated, tmp_path, monkeypatch):
    monkeypatch.chdir(generated[0].parent)
    dataset = gelsim.load(generated[0].name)
    monkeypatch.chdir(tmp_path)
    assert dataset[0]["key"] == pickle.loads(pickle.dumps(dataset))[0]["key"]


def test_what_is_not_wanted_is_not_decoded(mixed, tmp_path):
    """It may be damaged."""
    broken = tmp_path / "broken"
    gelsim.generate(mixed, broken, samples=1, set={"output.container": "folder", "output.layers": ["depth", "contact"]})
    next(broken.rglob("*.contact.png")).write_bytes(b"none")
    assert gelsim.load(broken, layers=["depth"])[0]["depth"].shape == (72, 96)
    assert "contact" in refusal(gelsim.RunError, lambda: gelsim.load(broken)[0])


INSIDE_ITSELF = []
INSIDE_ITSELF.append(INSIDE_ITSELF)


def load(**flags):
    return lambda it: gelsim.Job.load(it.mixed, **flags)


def exposure(value):
    return lambda it: gelsim.Job.load(it.mixed, set={"camera.exposure": value})


def generate(out="x", **flags):
    return lambda it: gelsim.generate(it.mixed, out, **flags)


@refusals({
    "an index past the end": (lambda it: it.job[13], IndexError, "0 to 12"),
    "an index before the start": (lambda it: it.job[-14], IndexError, "0 to 12"),
    "a huge index": (lambda it: it.job[2**40], IndexError, "0 to 12"),
    "one index of several": (lambda it: it.job.samples([0, 13]), IndexError, "13"),
    "an index of text": (lambda it: it.job["0"], TypeError, ""),
    "an index with a fraction": (lambda it: it.job[0.0], TypeError, ""),
    "a mistyped split": (lambda it: it.job.indices("tarin"), gelsim.UsageError, "train"),
    "a mistyped level": (load(fidelity="standart"), gelsim.UsageError, "did you mean `standard`?"),
    "another word for a level": (load(fidelity="fast"), gelsim.UsageError, "did you mean `draft`?"),
    "no threads": (load(threads=0), gelsim.UsageError, "threads=0"),
    "an unknown key": (load(set={"indentation.deep_mm": 1}), gelsim.UsageError, ""),
    "a key with a value": (load(set={"a=1": 1}), gelsim.UsageError, ""),
    "a key of two lines": (load(set={"a\nb": 1}), gelsim.UsageError, ""),
    "an empty key": (load(set={"": 1}), gelsim.UsageError, ""),
    "a value of None": (exposure(None), gelsim.UsageError, ["exposure", "leave the key out"]),
    "a value of 2**70": (exposure(2**70), gelsim.UsageError, ["exposure", "out of range"]),
    "a value within itself": (exposure(INSIDE_ITSELF), gelsim.UsageError, ["exposure", "without end"]),
    "a value of half a surrogate": (exposure("\ud800"), gelsim.UsageError, ["exposure", "UTF-8"]),
    "an object as value": (exposure(object()), TypeError, "give a bool"),
    "an object store": (generate("s3://bucket/x"), gelsim.UsageError, "object store"),
    "an empty folder": (generate(""), gelsim.UsageError, "empty"),
    "no samples": (generate(samples=0), gelsim.UsageError, "samples"),
    "an unknown key to generate": (generate(set={"pose.yaw": 1}), gelsim.UsageError, "yaw"),
    "no threads to generate": (generate(threads=0), gelsim.UsageError, "threads=0"),
    "a flag of a loaded job": (lambda it: gelsim.generate(it.job, "x", seed=1), gelsim.UsageError, "Job.load"),
    "an absent job": (lambda it: gelsim.generate("absent.toml", "x"), gelsim.UsageError, "absent.toml"),
    "no job": (lambda it: gelsim.generate(7, "x"), TypeError, "job"),
    "a folder in a file": (lambda it: gelsim.generate(it.mixed, it.mixed / "x"), gelsim.UsageError, "mixed.toml is not a folder"),
    "layers that are not there": (
        lambda it: gelsim.load(it.dataset, layers=["depht", "tactile", "gap"]),
        gelsim.UsageError,
        ["'depht', 'gap'", "'markers'", "'tactile'"],
    ),
    "splits": (lambda it: gelsim.load(it.dataset, ["train"]), gelsim.UsageError, ["split is of type list", "'train'"]),
    "a slice": (lambda it: gelsim.load(it.dataset)[0:2], TypeError, ["of type slice", "for several write [dataset["]),
    "a path that is too long": (lambda it: gelsim.load("a" * 300), gelsim.UsageError, "File name too long"),
    "a path with NUL": (lambda it: gelsim.load("a\0b"), gelsim.UsageError, "give that of a folder"),
    "a file of a dataset": (
        lambda it: gelsim.load(next((it.dataset / "data").glob("*.tar"))),
        gelsim.UsageError,
        [".tar is a file; give the folder, ", "generated"],
    ),
    "a file elsewhere": (lambda it: gelsim.load(it.mixed), gelsim.UsageError, "mixed.toml is a file; give the folder that"),
    "a path of bytes": (lambda it: gelsim.load(b"a"), TypeError, "give a path"),
    "layers that are no list": (lambda it: gelsim.load(it.dataset, layers="depth"), TypeError, ""),
    "what is no function": (lambda it: gelsim.load(it.dataset, transform="depth"), TypeError, ""),
})  # fmt: skip
def test_is_refused_with_a_way_out(mixed, job, generated, tmp_path, monkeypatch, call, kind, words):
    monkeypatch.chdir(tmp_path)
    assert_refused(lambda: call(SimpleNamespace(mixed=mixed, job=job, dataset=generated[0])), kind, words)
    assert not (tmp_path / "x").exists()
