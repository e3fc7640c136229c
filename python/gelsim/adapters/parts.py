"""A body of any physics engine as one shape, made of the collision shapes that are fixed to it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple, Optional

from gelsim._native import UsageError
from gelsim.adapters import Transform
from gelsim.adapters.shapes import Shape, joined


class Part(NamedTuple):
    """A collision shape of a body."""

    kind: str
    """What the engine calls it."""
    shape: Optional[Shape]
    """Its triangles in its own frame; None: there are none."""
    place: Transform
    """Where that frame is in the body's."""


def body_of(name: object, parts: Iterable[Part]) -> Shape:
    """All parts of the body `name` as one shape in the body's frame, mm; UsageError for a body without parts, or with one that has no
    triangles."""
    found: list[Shape] = []
    for kind, shape, place in parts:
        if shape is None:
            raise UsageError(
                f"{name} has a collision shape of the kind {kind}, which has no triangles here; in its place give Touch what has"
                " vertices (mm, in the body's frame) and faces"
            )
        found.append(shape.at(place))
    if not found:
        raise UsageError(f"{name} has no collision shape; give Touch what has vertices (mm, in the body's frame) and faces")
    return joined(found)
