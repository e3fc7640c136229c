"""Touch in Genesis: the shapes and places of entities and links, for `gelsim.adapters.Touch`.

A body is a link, or an entity that has one link alone, of a scene that was built. Places are those of the link's own frame, as the file
or the morph has it; the solver's may be elsewhere. Lengths of the world are metres.
"""

from __future__ import annotations

from typing import Any, Optional

from gelsim._native import UsageError
from gelsim.adapters import Transform, shapes
from gelsim.adapters.parts import Part, body_of
from gelsim.needed import need

__all__ = ["place_of", "shape_of"]


def place_of(body: Any, *, env: int = 0) -> Transform:
    """Where a link, or an entity of one link, is in the world. `env` counts the environments of a scene that has several."""
    link = link_of(body)
    return of_pose(link.get_pos(), link.get_quat(), env)


def shape_of(body: Any) -> shapes.Shape:
    """The collision geoms of a link, or of an entity of one link, mm in its frame: spheres, ellipsoids, boxes, cylinders, capsules, and
    meshes as Genesis made them ready to collide.

    UsageError for planes and terrains.
    """
    link, parts = link_of(body), []
    world = place_of(link).inverse()
    for geom in link.geoms:
        its = of_pose(geom.get_pos(relative=False), geom.get_quat(relative=False), 0)
        parts.append(Part(geom.type.name, triangles(geom), world @ its))
    return body_of(f"link {link.name!r}", parts)


def triangles(geom: Any) -> Optional[shapes.Shape]:
    """Triangles of a geom in its own frame."""
    kind, (a, b, c) = geom.type.name, (1e3 * length for length in geom.data[:3])
    if kind == "SPHERE":
        return shapes.sphere(a)
    if kind == "ELLIPSOID":
        return shapes.ellipsoid([a, b, c])
    if kind == "BOX":
        return shapes.box([0.5 * a, 0.5 * b, 0.5 * c])
    if kind == "CYLINDER":
        return shapes.cylinder(a, 0.5 * b)
    if kind == "CAPSULE":
        return shapes.capsule(a, 0.5 * b)
    return shapes.of_arrays(geom.init_verts, geom.init_faces) if kind == "MESH" else None


def of_pose(position: Any, quaternion: Any, env: int) -> Transform:
    """Genesis's tensors, with a row for each environment if there are several; w is first."""
    found = [tensor.detach().cpu().numpy() for tensor in (position, quaternion)]
    position_m, wxyz = (each[env] if each.ndim == 2 else each for each in found)
    return Transform.of(position_m, wxyz=wxyz)


def link_of(body: Any) -> Any:
    """A link, of an entity its only one."""
    need("genesis")
    links = getattr(body, "links", [body])
    if len(links) != 1:
        names = ", ".join(repr(link.name) for link in links)
        raise UsageError(f"the entity has the links {names}; give one: entity.get_link(NAME)")
    return links[0]
