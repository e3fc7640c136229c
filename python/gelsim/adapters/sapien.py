"""Touch in SAPIEN 3: the shapes and places of entities and links, for `gelsim.adapters.Touch`.

A body is an Entity or one of its components, as the links of an articulation are. Lengths of the world are metres.
"""

from __future__ import annotations

from typing import Any, Optional

from gelsim.adapters import Transform, shapes
from gelsim.adapters.parts import Part, body_of
from gelsim.needed import need

__all__ = ["place_of", "shape_of"]

FROM_Z_TO_X = [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]
"""SAPIEN's cylinders and capsules lie along x."""


def place_of(body: Any) -> Transform:
    """Where an entity or a link is in the world."""
    need("sapien")
    return of_pose(getattr(body, "entity", body).pose)


def shape_of(body: Any) -> shapes.Shape:
    """The collision shapes of an entity or a link, mm in its frame: spheres, boxes, cylinders, capsules and meshes.

    UsageError for other shapes, such as planes.
    """
    need("sapien")
    entity = getattr(body, "entity", body)
    found = [each for component in entity.components for each in getattr(component, "collision_shapes", [])]
    return body_of(f"entity {entity.name!r}", [part(each) for each in found])


def part(given: Any) -> Part:
    """One of SAPIEN's shapes."""
    kind, its = type(given).__name__.replace("PhysxCollisionShape", ""), of_pose(given.local_pose)
    made: Optional[shapes.Shape] = None
    if kind == "Sphere":
        made = shapes.sphere(1e3 * given.radius)
    elif kind == "Box":
        made = shapes.box([1e3 * half for half in given.half_size])
    elif kind in ("Cylinder", "Capsule"):
        of_kind = shapes.cylinder if kind == "Cylinder" else shapes.capsule
        made, its = of_kind(1e3 * given.radius, 1e3 * given.half_length), its @ Transform.of_matrix(FROM_Z_TO_X)
    elif kind in ("ConvexMesh", "TriangleMesh"):
        made = shapes.of_arrays(given.vertices, given.triangles, given.scale)
    return Part(kind, made, its)


def of_pose(pose: Any) -> Transform:
    """One of SAPIEN's poses, which have w first."""
    return Transform.of(pose.p, wxyz=pose.q)
