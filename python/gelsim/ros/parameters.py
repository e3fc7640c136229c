"""What the node can be told, by flags or as parameters of ROS."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from typing import Any, Optional

from gelsim._native import UsageError
from gelsim.checks import Checks, kind


def parameter(default: Any, words: str) -> Any:
    """A field with its words for `--help`."""
    return field(default=default, metadata={"words": words})


@dataclass(frozen=True)
class Parameters:
    """Parameters of a node. Each has the same name as flag and in ROS, where the flag has `-` in place of `_`."""

    sensor: str = parameter("gelsight-mini", "preset, or path of a sensor file")
    fidelity: str = parameter("standard", "paper, draft, standard, high, reference or finite-strain")
    set: str = parameter("", "changes of the sensor, as in 'camera.exposure=1.2; markers.pitch_mm=1.5'")
    resolution: str = parameter("", "WIDTHxHEIGHT of the image, px; for poses and perspective frames of flat pads")
    frame_id: str = parameter("", "name of the sensor's frame; that of the input if left out")
    plane_mm: float = parameter(0.0, "distance from the depth camera to the untouched pad, mm; for flat pads")
    projection: str = parameter("orthographic", "rays of the depth camera: orthographic, or perspective as CameraInfo says")
    fov_y_deg: float = parameter(0.0, "angle of a perspective camera between upper and lower edge, in place of CameraInfo")
    mesh: str = parameter("", "mesh file of the object whose poses come; without it depth images come")
    mm_per_unit: float = parameter(0.0, "mm per unit of the mesh, such as 1000 for metres; 0: as the file says, or mm")
    friction: float = parameter(0.6, "coefficient between pad and object; for poses")
    single: bool = parameter(False, "press each pose by itself, without memory of friction")
    seed: int = parameter(0, "what is random in the camera")
    report_s: float = parameter(5.0, "seconds between two reports of rates")

    def __post_init__(self) -> None:
        checks = Checks()
        for each in fields(self):
            fit = fitting(each.name, getattr(self, each.name), type(each.default))
            object.__setattr__(self, each.name, fit)
        checks.choice("projection", self.projection, ("orthographic", "perspective"))
        checks.number("plane_mm", self.plane_mm, 0.0, 1e6, "mm")
        checks.number("fov_y_deg", self.fov_y_deg, 0.0, 170.0, "degrees")
        checks.number("mm_per_unit", self.mm_per_unit, 0.0, 1e6)
        checks.number("friction", self.friction, 0.0, 10.0)
        checks.number("seed", self.seed, 0, 2**63 - 1)
        checks.number("report_s", self.report_s, 0.1, 3600.0, "s")
        if self.fov_y_deg > 0.0 and self.projection != "perspective":
            checks.wrong.append("fov_y_deg belongs to projection = perspective")
        if self.resolution and self.resolution_px is None:
            checks.wrong.append(f"resolution is {self.resolution!r}; give WIDTHxHEIGHT, as in 320x240")
        checks.done()

    @property
    def resolution_px(self) -> Optional[tuple[int, int]]:
        """Width and height, if they are given."""
        sides = self.resolution.lower().split("x")
        return (int(sides[0]), int(sides[1])) if len(sides) == 2 and all(side.isdecimal() for side in sides) else None

    @property
    def assignments(self) -> list[str]:
        """The parts of `set`."""
        return [part.strip() for part in self.set.split(";") if part.strip()]


def fitting(name: str, value: Any, wanted: type) -> Any:
    """The value as `wanted`. Launch files write whole numbers for others, and numbers for texts."""
    if wanted is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if wanted is str and isinstance(value, (int, float)) and not isinstance(value, bool):
        return str(value)
    if not isinstance(value, wanted) or (wanted is int and isinstance(value, bool)):
        raise UsageError(f"{name} is {kind(value)}; give {wanted.__name__}")
    if isinstance(value, float) and not math.isfinite(value):
        raise UsageError(f"{name} is {value}; give a number")
    return value
