"""Sets of sensors as their users load them: pairs are one press, a set is its datasets, and what is wrong is told."""

import json
import pickle

import pytest

gelsim = pytest.importorskip("gelsim", reason="the module is not installed: pip install .")

import numpy as np

pytestmark = pytest.mark.wheel

JOB = """
dataset = {{ name = "set", samples = 8, seed = 4, samples_per_shard = 3, splits = {{ train = 0.75, val = 0.25 }} }}
sensors = {sensors}
sensor.resolution_px = [48, 36]
object = [{{ path = "{sphere}" }}]
pose = {{ x_mm = [-2.0, 2.0] }}
indentation.depth_mm = [0.3, 0.8]
"""
THREE = '{ from = ["gelsight-mini", "geltip", "digit"] }'


@pytest.fixture
def made(project, tmp_path):
    """Makes a set of these sensors in the folder `set`."""

    def make(sensors=THREE, **options):
        (tmp_path / "job.toml").write_text(JOB.format(sensors=sensors, sphere=project / "objects/sphere.obj"))
        done = gelsim.generate(tmp_path / "job.toml", tmp_path / "set", **options)
        assert done.complete
        return tmp_path / "set"

    return make


def test_a_pair_is_one_press_and_a_set_is_its_datasets(made):
    loaded = gelsim.load(made())
    assert list(loaded.sensors) == ["gelsight-mini", "geltip", "digit"]
    assert len(loaded) == 24 and loaded.splits == {"train": 18, "val": 6}
    assert [sample["label"]["sensor"]["name"] for sample in loaded][::8] == ["gelsight-mini", "geltip", "digit"]
    alone = [sample for each in loaded.sensors.values() for sample in each]
    assert all(np.array_equal(one["tactile"], other["tactile"]) for one, other in zip(loaded, alone))
    pairs = loaded.pairs()
    assert len(pairs) == 8
    for pair in pickle.loads(pickle.dumps(pairs)):
        first, *others = [sample["label"] for sample in pair]
        for other in others:
            for part in ["key", "object", "pose", "indentation_depth_mm", "split"]:
                assert first[part] == other[part]
    assert pairs[-1][0]["key"] == pairs[7][0]["key"]
    with pytest.raises(IndexError):
        pairs[8]


def test_splits_layers_and_transforms_are_those_of_each_dataset(made):
    root = made()
    val = gelsim.load(root, "val", layers=["tactile"])
    assert len(val.pairs()) == 2 and "depth" not in val[0]
    shapes = gelsim.load(root, transform=lambda sample: sample["tactile"].shape).pairs()
    assert shapes[0] == [(36, 48, 3)] * 3
    with pytest.raises(gelsim.UsageError, match="no split 'test'"):
        gelsim.load(root, "test")


def test_no_pairs_where_there_are_none(made):
    root = made("{ count = 2, paired = false }")
    with pytest.raises(gelsim.UsageError, match="paired = false"):
        gelsim.load(root).pairs()
    with pytest.raises(gelsim.UsageError, match="is of one sensor"):
        gelsim.load(root / "gelsight-2014-0000").pairs()


@pytest.mark.parametrize(
    "text", ["", "[]", "{}", '{"set_version": 1, "paired": true, "sensors": []}', '{"set_version": 1, "paired": true, "sensors": [{"folder": "../x"}]}']
)
def test_what_is_no_list_of_sensors_is_told(made, text):
    root = made()
    (root / "sensors.json").write_text(text)
    with pytest.raises(gelsim.UsageError, match="sensors.json is no list of sensors"):
        gelsim.load(root)


def test_a_newer_set_and_one_that_grows_are_told(made):
    root = made()
    made(samples=9)
    assert len(gelsim.load(root).pairs()) == 9
    manifest = json.loads((root / "sensors.json").read_text())
    (root / "digit/dataset.json").unlink()
    with pytest.raises(gelsim.UsageError, match="digit is not complete"):
        gelsim.load(root)
    (root / "sensors.json").write_text(json.dumps({**manifest, "set_version": 2}))
    with pytest.raises(gelsim.UsageError, match="of a newer gelsim"):
        gelsim.load(root)


def test_a_job_of_several_sensors_is_that_of_the_first_with_a_word(made, project, tmp_path):
    made()
    with pytest.warns(UserWarning, match="the job has 3 sensors; this shows gelsight-mini"):
        job = gelsim.Job.load(tmp_path / "job.toml")
    assert job[0]["label"]["sensor"]["name"] == "gelsight-mini"
    again = pickle.loads(pickle.dumps(job))
    assert np.array_equal(again[1]["tactile"], job[1]["tactile"])
    gelsim.generate(again, tmp_path / "again")
    assert sorted(path.name for path in (tmp_path / "again").iterdir() if path.is_dir()) == ["digit", "gelsight-mini", "geltip"]
