"""Runs a Python snippet of a Markdown file as a person would in a notebook, and looks at the variables it leaves.

    python snippet.py FILE.md NUMBER        in the folder that the file speaks of
"""

import re
import sys


def snippets(path):
    return re.findall(r"^```python\n(.*?)^```", open(path).read(), re.MULTILINE | re.DOTALL)


def look(names):
    """Images, depth in mm and labels are what they should be."""
    if "images" in names:
        images, deepest = names["images"], names["deepest_mm"]
        assert images.ndim == 4 and images.shape[1] == 3 and str(images.dtype) == "torch.uint8", images.shape
        assert len(deepest) == len(images) and 0 <= float(deepest.max()) < 4
    elif "batch" in names:
        batch = names["batch"]
        assert batch["tactile"].shape == (*batch["depth"].shape, 3) and batch["depth"].max() > 0.0
    elif "press" in names:
        press = names["press"]
        width, height = names["simulator"].resolution_px
        assert press.image.shape == (height, width, 3) and press.image.dtype == numpy.uint8 and press.in_contact
        assert press.force_n > 0.0 and press.image.min() < press.image.max()
    elif "sample" in names:
        sample = names["sample"]
        label = names.get("label", sample)
        image = numpy.asarray(names["image"] if "image" in names else sample["image"])
        size = (label["sensor"]["height_px"], label["sensor"]["width_px"])
        assert image.shape == (*size, 3) and image.dtype == numpy.uint8, (image.shape, image.dtype)
        assert image.min() < image.max()
        if "depth_mm" in names:
            depth = names["depth_mm"]
            assert depth.shape == size and depth.dtype.kind == "f", (depth.shape, depth.dtype)
            if label["camera"]["distortion"] == [0.0, 0.0]:
                assert abs(float(depth.max()) - label["contact"]["max_depth_mm"]) <= 1.1e-3
    else:
        assert all(len(rows) > 0 for rows in names["dataset"].values())


if __name__ == "__main__":
    import numpy

    names = {"__name__": "__main__"}
    path, number = sys.argv[1:]
    exec(compile(snippets(path)[int(number)], f"{path}, snippet {number}", "exec"), names)
    look(names)
