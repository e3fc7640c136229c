"""Touch in PyBullet: the shapes and places of links, for `gelsim.adapters.Touch`.

A link is the number of a body, for its base, or a pair of the body's and the link's. Lengths of the world are metres. Places are those
of the link's own frame, as the URDF has it: PyBullet's functions speak of the frame at its centre of mass.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from typing import Any, Optional, Union

from gelsim.adapters import Transform, shapes
from gelsim.adapters.parts import Part, body_of
from gelsim.needed import need

__all__ = ["place_of", "shape_of"]

Link = Union[int, tuple[int, int]]
"""The number of a body, or a pair: those of a body and a link."""

FLAT_M = 1e-7
"""What is thinner is flat."""


def place_of(link: Link, *, client: int = 0) -> Transform:
    """Where a link is in the world. `client` is the `physicsClientId`."""
    bullet, (body, number) = need("pybullet"), pair(link)
    if number < 0:
        found = bullet.getBasePositionAndOrientation(body, physicsClientId=client)
    else:
        found = bullet.getLinkState(body, number, computeForwardKinematics=True, physicsClientId=client)
    return Transform.of(found[0], xyzw=found[1]) @ centre_of_mass(link, client).inverse()


def shape_of(link: Link, *, client: int = 0) -> shapes.Shape:
    """The collision shapes of a link, mm in its own frame: spheres, boxes, cylinders, capsules, and of meshes the convex hulls that
    PyBullet makes of them.

    Of concave meshes, and of OBJ files with several parts, PyBullet does not tell the triangles: they are the file's. UsageError where it
    tells no OBJ file either, and for other shapes, such as planes.
    """
    return body_of(f"link {link}", parts(*pair(link), client))


def parts(body: int, number: int, client: int) -> Iterator[Part]:
    """The collision shapes of a link."""
    bullet, centre = need("pybullet"), centre_of_mass((body, number), client)
    names = {getattr(bullet, name): name for name in dir(bullet) if name.startswith("GEOM_")}
    data = bullet.getCollisionShapeData(body, number, physicsClientId=client)
    hulls, are_all = hulls_of(body, number, len(data), client) if any(each[2] == bullet.GEOM_MESH for each in data) else ([], True)
    for index, (_, _, kind, size, file, position, turn) in enumerate(data):
        a, b, c = (1e3 * length for length in size)
        made, its = None, Transform.of(position, xyzw=turn)
        if kind == bullet.GEOM_SPHERE:
            made = shapes.sphere(a)
        elif kind == bullet.GEOM_BOX:
            made = shapes.box([0.5 * a, 0.5 * b, 0.5 * c])
        elif kind == bullet.GEOM_CYLINDER:
            made = shapes.cylinder(b, 0.5 * a)
        elif kind == bullet.GEOM_CAPSULE:
            made = shapes.capsule(b, 0.5 * a)
        elif kind == bullet.GEOM_MESH and hulls[index] and (are_all or not is_obj(file)):
            # Its corners are in the frame at the centre of mass.
            made, its = hull(hulls[index]), Transform.of([0.0, 0.0, 0.0])
        elif kind == bullet.GEOM_MESH and is_obj(file):
            mesh = need("trimesh").load(file.decode(), force="mesh", process=False, skip_materials=True)
            made = shapes.of_arrays(mesh.vertices, mesh.faces, size)
        yield Part(names.get(kind, str(kind)), made, centre @ its)


def hulls_of(body: int, number: int, count: int, client: int) -> tuple[list[Any], bool]:
    """The corners of the hull of each of a link's `count` shapes, none where it has no hull, and whether these are all that there are: of
    a mesh with several parts PyBullet gives one part."""
    corners = functools.partial(need("pybullet").getMeshData, body, number, physicsClientId=client)
    found = [corners(collisionShapeIndex=index)[1] for index in range(count)]
    return found, sum(map(len, found)) == corners()[0]


def is_obj(file: bytes) -> bool:
    """True of the name of an OBJ file; PyBullet has some other text for meshes whose file it does not tell."""
    return file.lower().endswith(b".obj")


def hull(corners: Any) -> Optional[shapes.Shape]:
    """The convex hull of points (N, 3), m; its triangles show outwards. None of what is flat."""
    numpy = need("numpy")
    points = numpy.asarray(corners, numpy.float64)
    if numpy.linalg.matrix_rank(points - points[0], tol=FLAT_M) < 3:
        return None
    found = need("scipy.spatial").ConvexHull(points)
    a, b, c = numpy.moveaxis(points[found.simplices], 1, 0)
    inwards = numpy.einsum("ij,ij->i", numpy.cross(b - a, c - a), found.equations[:, :3]) < 0.0
    return shapes.of_arrays(points, numpy.where(inwards[:, None], found.simplices[:, ::-1], found.simplices))


def centre_of_mass(link: Link, client: int) -> Transform:
    """The frame at a link's centre of mass, in the link's own."""
    found = need("pybullet").getDynamicsInfo(*pair(link), physicsClientId=client)
    return Transform.of(found[3], xyzw=found[4])


def pair(link: Link) -> tuple[int, int]:
    """A body's number and a link's; -1 is the base."""
    return link if isinstance(link, tuple) else (link, -1)
