"""Touch in Newton: the shapes and places of bodies, for `gelsim.adapters.Touch`.

A body is its number in the model; -1 is the world. Lengths of the world are metres.
"""

from __future__ import annotations

from typing import Any, Optional

from gelsim.adapters import Transform, shapes
from gelsim.adapters.parts import Part, body_of
from gelsim.needed import need

__all__ = ["place_of", "shape_of"]


def place_of(state: Any, body: int) -> Transform:
    """Where a body is in the world in a `State`."""
    return Transform.of([0.0, 0.0, 0.0]) if body < 0 else of_row(state.body_q.numpy()[body])


def shape_of(model: Any, body: int) -> shapes.Shape:
    """The shapes of a body of a `Model` that collide, mm in its frame: spheres, ellipsoids, boxes, cylinders, capsules and meshes.

    UsageError for other shapes, such as cones and planes.
    """
    newton = need("newton")
    kinds, sizes, places, flags = (
        each.numpy() for each in (model.shape_type, model.shape_scale, model.shape_transform, model.shape_flags)
    )
    parts = []
    for number in model.body_shapes[body]:
        if flags[number] & newton.ShapeFlags.COLLIDE_SHAPES:
            kind = newton.GeoType(int(kinds[number])).name
            made = triangles(kind, sizes[number], model.shape_source[number])
            parts.append(Part(kind, made, of_row(places[number])))
    return body_of(f"body {body}", parts)


def triangles(kind: str, size: Any, mesh: Any) -> Optional[shapes.Shape]:
    """Triangles of a shape in its own frame."""
    a, b, c = (1e3 * float(length) for length in size)
    if kind == "SPHERE":
        return shapes.sphere(a)
    if kind == "ELLIPSOID":
        return shapes.ellipsoid([a, b, c])
    if kind == "BOX":
        return shapes.box([a, b, c])
    # The third is the radius of a barrel's side.
    if kind == "CYLINDER" and c == 0.0:
        return shapes.cylinder(a, b)
    if kind == "CAPSULE":
        return shapes.capsule(a, b)
    return shapes.of_arrays(mesh.vertices, mesh.indices, size) if kind in ("MESH", "CONVEX_MESH") else None


def of_row(row: Any) -> Transform:
    """One of Newton's transforms: a position, and a quaternion with w last."""
    return Transform.of(row[:3], xyzw=row[3:])
