"""What labels say as plain vectors: pose and wrench."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Optional

POSE = ["x_mm", "y_mm", "z_mm", "qx", "qy", "qz", "qw"]
"""Components of `pose`."""
WRENCH = ["fx_n", "fy_n", "fz_n", "tx_nmm", "ty_nmm", "tz_nmm"]
"""Components of `wrench`."""

NAN = float("nan")


FINGERS = ["left", "right"]
"""Of a gripper: names of what a label says of each, and of its samples' parts."""


def parts(label: dict[str, Any]) -> list[dict[str, Any]]:
    """What a label says of each frame, of a gripper of each finger in it; of a press the label itself."""
    whole = list(label["frames"]) if "sequence" in label else [label]
    return [part[finger] for part in whole for finger in FINGERS] if has_fingers(label) else whole


def has_fingers(label: dict[str, Any]) -> bool:
    """True of a sample of two fingers."""
    return "left" in label


def pose(part: dict[str, Any]) -> list[float]:
    """Translation (mm) and quaternion x, y, z, w of the object in the sensor's frame; NaN where the label knows none."""
    known = part.get("pose")
    return [NAN] * 7 if not known else numbers([*known["translation_mm"], *known["quaternion_xyzw"]], 7)


def wrench(part: dict[str, Any]) -> list[float]:
    """Force (N) and torque (N mm) of the object on the pad, in the sensor's frame; NaN for what the label does not know.

    Of a press on a flat pad the force is that along the pad from `shear` and the normal one from `contact.total_force_n`,
    and the torque is not known.
    """
    if "wrench" in part:
        return numbers([*part["wrench"]["force_n"], *part["wrench"]["torque_nmm"]], 6)
    contact = part["contact"]
    if contact.get("force_vector_n"):
        return numbers([*contact["force_vector_n"], *contact["torque_nmm"]], 6)
    total, along = contact["total_force_n"], part["shear"]["force_n"]
    return numbers([*(along or [None, None]), None if total is None else 0.0 - total, None, None, None], 6)


def numbers(values: Sequence[Optional[float]], count: int) -> list[float]:
    """The same with NaN in place of null; ValueError if there are not `count`."""
    if len(values) != count:
        raise ValueError(f"{len(values)} numbers instead of {count}")
    return [NAN if value is None else float(value) for value in values]
