"""Reads samples, from tars by WebDataset and from folders as files, into arrays in millimetres, and checks them."""

import io
import json
from pathlib import Path

import pytest

for name in ["numpy", "jsonschema", "OpenEXR", "webdataset", "PIL"]:
    pytest.importorskip(name, reason=f"no {name}: pip install numpy jsonschema OpenEXR webdataset pillow")

import jsonschema
import numpy
import OpenEXR
import webdataset
from PIL import Image


def exr(data):
    """Rows and columns; of several channels a third axis, in the order of their names."""
    channels = OpenEXR.File(io.BytesIO(data), separate_channels=True).channels()
    planes = [channels[name].pixels.astype("float32") for name in sorted(channels)]
    return planes[0] if len(planes) == 1 else numpy.stack(planes, axis=-1)


def png16(data):
    image = Image.open(io.BytesIO(data))
    assert image.mode.startswith("I;16"), image.mode
    return numpy.array(image)


DECODERS = {
    "exr": exr,
    "png16": png16,
    "png": lambda data: numpy.array(Image.open(io.BytesIO(data)).convert("RGB")),  # as "rgb8" of webdataset
    "npy": lambda data: numpy.load(io.BytesIO(data)),
    "json": json.loads,
}


def files(shard):
    """A shard's samples, when it is a folder: key and members by suffix."""
    rows = [json.loads(line) for line in open(shard / "metadata.jsonl")]
    for row in rows:
        key = row["file_name"].split(".")[0]
        paths = {path.name.split(".", 1)[1]: path for path in shard.glob(f"{key}.*")}
        yield key, {suffix: DECODERS[suffix.split(".")[-1]](path.read_bytes()) for suffix, path in paths.items()}


def members(shard):
    """A shard's samples, when it is a tar."""
    decoders = [webdataset.handle_extension(ending, DECODERS[ending]) for ending in ["exr", "png16"]]
    for sample in webdataset.WebDataset(str(shard), shardshuffle=False).decode("rgb8", *decoders):
        yield sample["__key__"], {name: value for name, value in sample.items() if not name.startswith("__")}


def read(out, manifest):
    """Key and members of every sample of the dataset in `out`, in order. Depth and surface are in mm."""
    for shard in manifest["shards"]:
        path = Path(out) / shard["file"]
        count = 0
        for key, sample in files(path) if path.is_dir() else members(path):
            label = sample["json"]
            assert label["key"] == key and label["split"] == shard["split"]
            if "depth.png16" in sample:
                steps = label["png16"]
                sample["depth.png16"] = sample["depth.png16"] * steps["depth_mm_per_step"]
                zero = steps["surface_zero"]
                sample["surface.png16"] = (sample["surface.png16"] - float(zero)) * steps["surface_mm_per_step"]
            count += 1
            yield key, sample
        assert count == shard["samples"], shard


def layer(sample, name):
    """The layer, however it is written; None if the sample has none of that name."""
    return next((value for suffix, value in sample.items() if suffix.split(".")[0] == name), None)


def validator(path):
    """Of labels, by a schema's file."""
    schema = json.loads(path.read_text())
    kind = jsonschema.validators.validator_for(schema)
    kind.check_schema(schema)
    return kind(schema)


def check(key, sample, labels):
    """Shapes, types and units agree with the label, and that with the schema, whose validator `labels` is."""
    label = sample["json"]
    labels.validate(label)
    image = sample["tactile.png"]
    size = (label["sensor"]["height_px"], label["sensor"]["width_px"])
    assert image.shape == (*size, 3) and image.dtype == numpy.uint8, (key, image.shape, image.dtype)
    depth = layer(sample, "depth")
    assert depth.shape == size and depth.dtype.kind == "f", (key, depth.shape, depth.dtype)
    deepest = float(depth.max())
    # Half floats keep 11 bits: at most 1 um of rounding below 4 mm. A lens's layers are interpolated.
    if label["contact"]["in_contact"] and label["camera"]["distortion"] == [0.0, 0.0]:
        assert abs(deepest - label["contact"]["max_depth_mm"]) <= 1.1e-3, (key, deepest, label["contact"])
    if "markers.json" in sample:
        markers = sample["markers.json"]
        assert len(markers["rest_px"]) == len(markers["moved_px"]) == label["markers"]["count"]


def same_layers(form, exact, other):
    """The layers of `other`, written as `form`, are those of `exact` but for rounding."""
    for name in ["depth", "surface", "normal", "pressure"]:
        truth, found = layer(exact, name), layer(other, name)
        written = next(suffix.rsplit(".")[-1] for suffix in other if suffix.split(".")[0] == name)
        assert written == ("exr" if form == "png16" and name in ["normal", "pressure"] else form), (name, written)
        error = float(numpy.abs(found.astype("float64") - truth).max())
        if written == "png16":
            bound = 0.501 * other["json"]["png16"][f"{name}_mm_per_step"]
        else:
            # Half floats below 4 mm and of unit vectors; pressures are never halved.
            bound = 1.1e-3 if written == "exr" and name != "pressure" else 0.0
        assert error <= bound, (form, name, error, bound)
    for name in ["tactile", "contact", "reference"]:
        assert numpy.array_equal(layer(exact, name), layer(other, name)), (form, name)
