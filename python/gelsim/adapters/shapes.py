"""Triangles of the shapes that physics engines know, in millimetres about their own frames.

Round shapes are within `within_mm` of the true surface, up to a radius of 100 mm at the default: corners lie outside it, the middles of
triangles inside.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from gelsim.checks import Checks
from gelsim.needed import need

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray

    from gelsim.adapters import Transform

__all__ = ["Shape", "box", "capsule", "cylinder", "ellipsoid", "joined", "of_arrays", "sphere"]

WITHIN_MM = 0.001
"""How far a flat triangle may lie from the round surface that it stands for."""
SIDES = (24, 720)
"""Fewest and most sides of a circle."""
LENGTHS_MM = (1e-6, 1e6)
"""Shortest and longest side or radius."""


class Shape(NamedTuple):
    """Corners (N, 3), mm, and triangles (M, 3) that count in them: what `gelsim.Mesh` and `Touch` take."""

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]

    def at(self, transform: Transform) -> Shape:
        """The same elsewhere in its body: `transform` is in metres, as engines have it."""
        vertices = self.vertices @ transform.rotation.T + 1e3 * transform.position_m
        return Shape(vertices, self.faces)


def joined(shapes: Sequence[Shape]) -> Shape:
    """Several shapes as one, such as all that is fixed to a body."""
    numpy = need("numpy")
    starts = numpy.cumsum([0, *(len(shape.vertices) for shape in shapes)])
    faces = [shape.faces + start for shape, start in zip(shapes, starts)]
    return Shape(
        numpy.concatenate([numpy.empty((0, 3)), *(shape.vertices for shape in shapes)]),
        numpy.concatenate([numpy.empty((0, 3), numpy.int64), *faces]),
    )


def of_arrays(vertices_m: ArrayLike, faces: ArrayLike, scale: ArrayLike = 1.0) -> Shape:
    """A mesh of an engine: corners (N, 3) in metres, triangles (M, 3), and by how much it is scaled along x, y and z.

    A scale that mirrors turns the triangles over, so that their outside stays outside.
    """
    numpy = need("numpy")
    factors = numpy.broadcast_to(numpy.asarray(scale, numpy.float64), (3,))
    corners = numpy.asarray(vertices_m, numpy.float64).reshape(-1, 3) * factors * 1e3
    triangles = numpy.asarray(faces, numpy.int64).reshape(-1, 3)
    return Shape(corners, triangles[:, ::-1] if numpy.prod(factors) < 0.0 else triangles)


def box(half_mm: Sequence[float]) -> Shape:
    """A box of these half lengths along x, y and z."""
    numpy = need("numpy")
    half = halves(half_mm)
    corners = numpy.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return Shape(corners, numpy.array([each for a, b, c, d in sides for each in ((a, b, c), (a, c, d))]))


def ellipsoid(half_mm: Sequence[float], *, within_mm: float = WITHIN_MM) -> Shape:
    """An ellipsoid of these half axes along x, y and z."""
    half, (within,) = halves(half_mm), lengths(within_mm=within_mm)
    around = sides_of(max(half), within)
    unit = turned(domes(around, 1.0, 0.0), around)
    return Shape(unit.vertices * [each + within for each in half], unit.faces)


def sphere(radius_mm: float, *, within_mm: float = WITHIN_MM) -> Shape:
    """A ball."""
    radius, within = lengths(radius_mm=radius_mm, within_mm=within_mm)
    return ellipsoid([radius] * 3, within_mm=within)


def capsule(radius_mm: float, half_length_mm: float, *, within_mm: float = WITHIN_MM) -> Shape:
    """A cylinder about z from -`half_length_mm` to +`half_length_mm`, with half a ball on each end."""
    radius, half, within = lengths(radius_mm=radius_mm, half_length_mm=half_length_mm, within_mm=within_mm)
    around = sides_of(radius, within)
    return turned(domes(around, radius + within, half), around)


def cylinder(radius_mm: float, half_length_mm: float, *, within_mm: float = WITHIN_MM) -> Shape:
    """A cylinder about z from -`half_length_mm` to +`half_length_mm`."""
    radius, half, within = lengths(radius_mm=radius_mm, half_length_mm=half_length_mm, within_mm=within_mm)
    rim = radius + within
    return turned([(0.0, -half), (rim, -half), (rim, half), (0.0, half)], sides_of(radius, within))


def lengths(**given: float) -> tuple[float, ...]:
    """Lengths above 0, mm."""
    checks = Checks()
    found = tuple(checks.number(name, each, *LENGTHS_MM, "mm") for name, each in given.items())
    checks.done()
    return found


def halves(half_mm: Sequence[float]) -> tuple[float, ...]:
    """Half lengths along x, y and z, mm."""
    checks = Checks()
    found = checks.numbers("half_mm", half_mm, 3, *LENGTHS_MM, "mm")
    checks.done()
    return found


def sides_of(radius_mm: float, within_mm: float) -> int:
    """Sides of a circle, a multiple of 4: with as many around a ball and half as many from pole to pole, the middle of a quad lies
    2 `within_mm` deeper than its corners."""
    fewest, most = SIDES
    return 4 * math.ceil(min(max(math.pi * math.sqrt(radius_mm / (2.0 * within_mm)), fewest), most) / 4.0)


def domes(around: int, radius: float, half: float) -> list[tuple[float, float]]:
    """Two half circles that are 2 `half` apart, as (distance from the axis, z) from the lower pole to the upper one."""
    turns = [2.0 * math.pi * step / around for step in range(around // 4 + 1)]
    lower = [(radius * math.sin(turn), -half - radius * math.cos(turn)) for turn in turns]
    upper = [(reach, -z) for reach, z in reversed(lower)]
    return lower + (upper if half > 0.0 else upper[1:])


def turned(profile: Sequence[tuple[float, float]], around: int) -> Shape:
    """A profile (distance from the axis, z), with both ends on the axis, turned about z, outside out."""
    numpy = need("numpy")
    turns = numpy.linspace(0.0, 2.0 * math.pi, around, endpoint=False)
    (_, bottom), *rings, (_, top) = profile
    circle = numpy.stack([numpy.cos(turns), numpy.sin(turns)], axis=1)
    corners = [numpy.column_stack([reach * circle, numpy.full(around, z)]) for reach, z in rings]
    vertices = numpy.concatenate([*corners, [[0.0, 0.0, bottom], [0.0, 0.0, top]]])
    here = numpy.arange(around)
    beside = (here + 1) % around
    last = around * (len(rings) - 1)
    faces = [numpy.stack([numpy.full(around, len(vertices) - 2), beside, here], axis=1)]
    for start in range(0, last, around):
        faces.append(numpy.stack([start + here, start + beside, start + around + beside], axis=1))
        faces.append(numpy.stack([start + here, start + around + beside, start + around + here], axis=1))
    faces.append(numpy.stack([last + here, last + beside, numpy.full(around, len(vertices) - 1)], axis=1))
    return Shape(vertices, numpy.concatenate(faces))
