"""Touch in Drake: the shapes and places of bodies and frames of a MultibodyPlant, for `gelsim.adapters.Touch`.

`context` is the diagram's, as `simulator.get_context()` gives it. Lengths of the world are metres.
"""

from __future__ import annotations

from typing import Any, Optional

from gelsim.adapters import Transform, shapes
from gelsim.adapters.parts import Part, body_of
from gelsim.needed import need

__all__ = ["place_of", "shape_of"]


def place_of(body: Any, context: Any) -> Transform:
    """Where a RigidBody, or a Frame that is fixed to one, is in the world."""
    frame = body.body_frame() if hasattr(body, "body_frame") else body
    return Transform.of_matrix(frame.CalcPoseInWorld(plant_context(body, context)).GetAsMatrix4())


def shape_of(body: Any, context: Any) -> shapes.Shape:
    """The shapes of a RigidBody that have the proximity role, mm in its frame: Sphere, Box, Cylinder, Capsule, Ellipsoid, Convex, and
    Mesh of an OBJ file.

    Convex is its hull, Mesh the file's triangles. UsageError for other shapes, such as HalfSpace.
    """
    plant = body.GetParentPlant()
    inspector = plant.EvalSceneGraphInspector(plant_context(body, context))
    parts = []
    for each in plant.GetCollisionGeometriesForBody(body):
        given, its = inspector.GetShape(each), Transform.of_matrix(inspector.GetPoseInFrame(each).GetAsMatrix4())
        parts.append(Part(type(given).__name__, triangles(given), its))
    return body_of(f"body {body.name()!r}", parts)


def triangles(given: Any) -> Optional[shapes.Shape]:
    """Triangles of one of Drake's shapes."""
    kind = type(given).__name__
    if kind == "Sphere":
        return shapes.sphere(1e3 * given.radius())
    if kind == "Box":
        return shapes.box(500.0 * given.size())
    if kind == "Cylinder":
        return shapes.cylinder(1e3 * given.radius(), 500.0 * given.length())
    if kind == "Capsule":
        return shapes.capsule(1e3 * given.radius(), 500.0 * given.length())
    if kind == "Ellipsoid":
        return shapes.ellipsoid([1e3 * given.a(), 1e3 * given.b(), 1e3 * given.c()])
    if kind == "Convex":
        return of_hull(given.GetConvexHull())
    if kind == "Mesh" and given.extension() == ".obj" and given.source().is_path():
        mesh = need("pydrake.geometry").ReadObjToTriangleSurfaceMesh(given.source().path())
        faces = [[each.vertex(corner) for corner in range(3)] for each in mesh.triangles()]
        return shapes.of_arrays(mesh.vertices(), faces, given.scale3())
    return None


def of_hull(hull: Any) -> shapes.Shape:
    """A mesh of polygons, which are convex: each is a fan of triangles."""
    faces, data = [], list(hull.face_data())
    while data:
        first, *rest = data[1 : 1 + data[0]]
        faces += [(first, a, b) for a, b in zip(rest, rest[1:])]
        data = data[1 + data[0] :]
    return shapes.of_arrays([hull.vertex(number) for number in range(hull.num_vertices())], faces)


def plant_context(body: Any, context: Any) -> Any:
    """The part of the diagram's context that the body's plant has."""
    need("pydrake")
    return body.GetParentPlant().GetMyContextFromRoot(context)
