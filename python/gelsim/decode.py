"""Files of a sample as arrays. Needs numpy and pillow; OpenEXR where a layer is EXR."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

from gelsim.needed import need

if TYPE_CHECKING:
    from numpy.typing import NDArray

CHANNELS = {"normal": 3, "lamps": 6, "flow": 2, "traction": 3, "points": 3, "tactile": 3, "reference": 3, "untouched": 3}
"""Of layers that have several."""


def decode(name: str, suffix: str, data: bytes, label: dict[str, Any]) -> Any:
    """Layer `name` as docs/how-to/python.md lists it. Raises ValueError for what no layer is."""
    size = label["sensor"]["height_px"], label["sensor"]["width_px"]
    shape = (*size, CHANNELS[name]) if name in CHANNELS else size
    ending = suffix.rsplit(".", 1)[-1]
    if ending == "json":
        return positions(data)
    steps = partial(png16, name, label["png16"])
    decoders: dict[str, Callable[[bytes], Any]] = {"png": png, "npy": npy, "exr": exr, "png16": steps}
    if ending not in decoders:
        raise ValueError(f"layers that end in .{ending} are of another version of gelsim: install that")
    found = decoders[ending](data)
    if found.shape != shape or found.dtype != ("uint8" if ending == "png" else "float32"):
        raise ValueError(f"is {found.dtype} of shape {found.shape}; its label says {shape}")
    return found


def positions(data: bytes) -> dict[str, NDArray[Any]]:
    """Markers or pins."""
    numpy = need("numpy")
    found = {}
    for name, points in json.loads(data).items():
        axes = 3 if name.endswith("_mm") else 2
        found[name] = numpy.asarray(points, "float64").reshape(-1, axes)
    return found


def png(data: bytes) -> NDArray[Any]:
    """8-bit grey or RGB."""
    numpy, image = need("numpy"), need("PIL.Image")
    found: NDArray[Any] = numpy.array(image.open(io.BytesIO(data), formats=["PNG"]))
    return found


def png16(name: str, steps: dict[str, float], data: bytes) -> NDArray[Any]:
    """Depth or surface in mm, from 16-bit steps."""
    numpy = need("numpy")
    zero = steps["surface_zero"] if name == "surface" else 0
    found = (png(data).astype("float64") - zero) * steps[f"{name}_mm_per_step"]
    return found.astype(numpy.float32)


def npy(data: bytes) -> NDArray[Any]:
    """Float32."""
    found: NDArray[Any] = need("numpy").load(io.BytesIO(data), allow_pickle=False)
    return found


def exr(data: bytes) -> NDArray[Any]:
    """Halves or floats as float32; several channels in the order of their names."""
    numpy = need("numpy")
    try:
        channels = need("OpenEXR").File(io.BytesIO(data), separate_channels=True).channels()
    except (RuntimeError, TypeError) as error:
        raise ValueError(f"is no EXR: {error}") from None
    planes = [channels[name].pixels.astype(numpy.float32) for name in sorted(channels)]
    found: NDArray[Any] = planes[0] if len(planes) == 1 else numpy.stack(planes, axis=-1)
    return found
