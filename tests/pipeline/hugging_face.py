"""Loads a dataset by Hugging Face's `datasets`, through its card and without it."""

import os

import yaml
from datasets import Features, load_dataset


def pinned(out):
    """The column types that the card gives."""
    front = yaml.safe_load(open(out / "README.md").read().split("---\n")[1])
    # Of folders they stand beside the files of the only configuration.
    place = front.get("dataset_info") or front["configs"][0]
    return Features._from_yaml_list(place["features"])


def check(out, manifest, labels):
    """All rows are there, in their splits, and their labels are those of the files; types are the card's."""
    expected = pinned(out)
    folder = (out / manifest["shards"][0]["file"]).is_dir()
    dataset = load_dataset(str(out))
    assert set(dataset) == set(manifest["splits"])
    for split, count in manifest["splits"].items():
        rows = dataset[split]
        assert rows.features == expected, (rows.features, expected)
        assert len(rows) == count
        for row in rows:
            key = row["key"] if folder else row["__key__"]
            found = {name: row[name] for name in labels[key]} if folder else row["json"]
            assert found == labels[key], key
            assert labels[key]["split"] == split
            image = row["image"] if folder else row["tactile.png"]
            assert image.size == (found["sensor"]["width_px"], found["sensor"]["height_px"]) and image.mode == "RGB"
            for name, value in row.items():
                assert not name.endswith("_path") or os.path.isfile(out / value), value
    if folder:
        # Without the card: splits are known by the folders' names and get names of its own, types are guessed.
        rows = load_dataset("imagefolder", data_dir=str(out / "data"))
        names = {"val": "validation"}
        assert {names.get(split, split): count for split, count in manifest["splits"].items()} == rows.num_rows
        for row in rows["train"]:
            assert row["image"].mode == "RGB" and row["contact"] == labels[row["key"]]["contact"], row["key"]
    else:
        files = {split: str(out / f"data/{split}-*.tar") for split in manifest["splits"]}
        for types in [None, expected]:
            rows = load_dataset("webdataset", data_files=files, features=types)
            assert rows.num_rows == manifest["splits"]
            for row in rows["train"]:
                assert row["json"] == labels[row["__key__"]], (types, row["__key__"])
