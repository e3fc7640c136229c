"""Loads a dataset as its users do: WebDataset, Hugging Face datasets, OpenEXR; checks labels against the schema.

    python load.py DATASET_DIR LABEL_SCHEMA.json
"""

import glob
import io
import json
import sys

import jsonschema
import numpy
import OpenEXR
import webdataset
from datasets import load_dataset

root, schema_path = sys.argv[1:]
manifest = json.load(open(f"{root}/dataset.json"))
schema = json.load(open(schema_path))
exr = webdataset.handle_extension(
    "exr",
    lambda b: OpenEXR.File(io.BytesIO(b), separate_channels=True).channels()["Z"].pixels,
)

count = 0
for split, samples in manifest["splits"].items():
    shards = sorted(glob.glob(f"{root}/data/{split}-*.tar"))
    seen = 0
    for sample in webdataset.WebDataset(shards, shardshuffle=False).decode("rgb8", exr):
        image, depth, label = sample["tactile.png"], sample["depth.exr"], sample["json"]
        jsonschema.validate(label, schema)
        assert image.shape == (label["sensor"]["height_px"], label["sensor"]["width_px"], 3), image.shape
        assert depth.shape == image.shape[:2], depth.shape
        assert label["split"] == split and label["key"] == sample["__key__"]
        # Half floats keep 11 bits: at most 1 um of rounding below 4 mm.
        deepest = float(numpy.max(depth.astype("float64")))
        # A lens's layers are interpolated.
        if label["contact"]["in_contact"] and label["camera"]["distortion"] == [0.0, 0.0]:
            assert abs(deepest - label["contact"]["max_depth_mm"]) <= 1.1e-3, (deepest, label["contact"])
        if "markers.json" in sample:
            markers = sample["markers.json"]
            assert len(markers["rest_px"]) == len(markers["moved_px"]) == label["markers"]["count"]
        seen += 1
    assert seen == samples, (split, seen, samples)
    count += seen
assert count == manifest["samples"]

dataset = load_dataset(root)
for split, samples in manifest["splits"].items():
    rows = dataset[split]
    assert len(rows) == samples
    row = rows[0]
    assert row["tactile.png"].size == (row["json"]["sensor"]["width_px"], row["json"]["sensor"]["height_px"])
    assert isinstance(row["depth.exr"], bytes)
    assert str(rows.features["json"]["contact"]["force_n"].dtype) == "float64"
    if "markers.json" in row:
        assert len(row["markers.json"]["moved_px"]) == row["json"]["markers"]["count"]
print(f"{count} samples read by webdataset and by datasets, all labels valid")
