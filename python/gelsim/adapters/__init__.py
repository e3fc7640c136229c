"""Touch in the loop of a physics engine: what pads and objects of all engines have in common.

`Touch` is one pad. It takes where the pad and the objects are in the engine's world, in metres, and presses whichever object reaches
into the pad. `gelsim.adapters.mujoco` makes one from a model; `gelsim.adapters.shapes` has the triangles of an engine's shapes.

The pad's frame is the sensor's: x to the right in the image, y down, z out of the pad towards the object; its origin is the middle of
the image on the untouched pad.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Optional

from gelsim._native import UsageError
from gelsim.checks import Checks, kind
from gelsim.mesh import HasMesh, Mesh, mesh_of_arrays
from gelsim.needed import need
from gelsim.scene import Placement
from gelsim.simulator import Impression, Simulator

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray

__all__ = ["Touch", "Transform", "Wrench"]

BEHIND_MM = 10.0
"""What is farther below the surface than the pad's thickness and this is behind the sensor, as the far wall of a cup is."""
BESIDE = 2.0
"""The pad feels what is beside its view, up to fewer thicknesses than these."""
AWAY_M = 1.0
"""Where what is away is put, out of the pad."""
ROUNDING_MM = 1e-6
"""So much less deep than the pad is thick is pressed what is as deep: what is rounded on the way does not take it through."""
RIGID = 1e-3
"""How far the axes of a rotation may be from unit length and right angles: engines have float32."""
LAST_ROW = 1e-6
"""How far the last row of a matrix (4, 4) may be from 0, 0, 0, 1."""


class Transform(NamedTuple):
    """Where a body is in the world, or in another body: its point q is at `rotation @ q + position_m`."""

    position_m: NDArray[np.float64]
    """(3,), metres."""
    rotation: NDArray[np.float64]
    """(3, 3)."""

    @classmethod
    def of(
        cls, position_m: ArrayLike, *, xyzw: Optional[ArrayLike] = None, wxyz: Optional[ArrayLike] = None
    ) -> Transform:
        """Takes a position (3,), metres, and the turn as a quaternion with w last or w first; without one nothing turns."""
        numpy = need("numpy")
        position = numbers("position_m", position_m, 3)
        if xyzw is None and wxyz is None:
            return cls(position, numpy.eye(3))
        if xyzw is not None and wxyz is not None:
            raise UsageError("xyzw and wxyz are one turn in two orders; give the one that the engine has")
        given = numbers("wxyz", wxyz, 4) if xyzw is None else numpy.roll(numbers("xyzw", xyzw, 4), 1)
        length = numpy.linalg.norm(given)
        if length == 0.0:
            raise UsageError("the quaternion has no length; (0, 0, 0, 1) with w last turns nothing")
        with numpy.errstate(invalid="ignore"):  # `Touch` names what is not finite
            w, x, y, z = given / length
        rows = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
        return cls(position, numpy.array(rows))

    @classmethod
    def of_matrix(cls, matrix: ArrayLike, position_m: Optional[ArrayLike] = None) -> Transform:
        """Takes a matrix (4, 4) with the position in its last column; or a rotation (3, 3), also as 9 numbers, and a position."""
        numpy = need("numpy")
        found = numbers("matrix", matrix)
        if found.shape == (4, 4):
            if position_m is not None:
                raise UsageError("a matrix (4, 4) has a position; leave position_m out, or give the matrix's part [:3, :3]")
            if (abs(found[3] - [0.0, 0.0, 0.0, 1.0]) > LAST_ROW).any():
                said = f"the last row of the matrix is {found[3].tolist()}, not [0, 0, 0, 1]"
                raise UsageError(f"{said}; give matrix.T if that is where the position stands")
            return cls(found[:3, 3], checked_rotation(found[:3, :3]))
        if found.size != 9:
            raise UsageError(f"matrix has the shape {found.shape}; give (4, 4), or a rotation (3, 3) with a position")
        position = numpy.zeros(3) if position_m is None else numbers("position_m", position_m, 3)
        return cls(position, checked_rotation(found.reshape(3, 3)))

    def __matmul__(self, other: Transform) -> Transform:
        """Where a body is that is at `other` in the frame of this one."""
        return Transform(self.rotation @ other.position_m + self.position_m, self.rotation @ other.rotation)

    def inverse(self) -> Transform:
        """The world in the frame of this body."""
        return Transform(-(self.position_m @ self.rotation), self.rotation.T)

    @property
    def xyzw(self) -> NDArray[np.float64]:
        """The turn as a quaternion, w last."""
        numpy = need("numpy")
        m = self.rotation
        # The four squares; the largest part is the divisor.
        squares = [1.0 + m[0, 0] - m[1, 1] - m[2, 2], 1.0 - m[0, 0] + m[1, 1] - m[2, 2], 1.0 - m[0, 0] - m[1, 1] + m[2, 2],
                   1.0 + m[0, 0] + m[1, 1] + m[2, 2]]  # fmt: skip
        a, b, c = m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]
        d, e, f = m[0, 1] + m[1, 0], m[0, 2] + m[2, 0], m[1, 2] + m[2, 1]
        largest = max(range(4), key=squares.__getitem__)
        parts = [(squares[0], d, e, a), (d, squares[1], f, b), (e, f, squares[2], c), (a, b, c, squares[3])][largest]
        found: NDArray[np.float64] = numpy.array(parts) / (2.0 * math.sqrt(squares[largest]))
        return found


def numbers(name: str, given: Any, count: Optional[int] = None) -> NDArray[np.float64]:
    """An array of numbers, or of so many, (count,)."""
    numpy = need("numpy")
    wanted = "numbers" if count is None else f"{count} numbers"
    try:
        found: NDArray[np.float64] = numpy.array(given, numpy.float64)
    except (TypeError, ValueError) as error:
        raise TypeError(f"{name} is {kind(given)}; give {wanted}") from error
    if given is None:
        raise TypeError(f"{name} is None; give {wanted}")
    if count is not None and found.size != count:
        raise UsageError(f"{name} has the shape {found.shape}; give {wanted}")
    return found if count is None else found.reshape(count)


def checked_rotation(rotation: NDArray[np.float64], name: str = "the matrix") -> NDArray[np.float64]:
    """The same; UsageError for what is none. What is not finite goes through: `Touch` says whose it is."""
    numpy = need("numpy")
    if numpy.isfinite(rotation).all():
        off, mirrors = abs(rotation @ rotation.T - numpy.eye(3)).max(), numpy.linalg.det(rotation) < 0.0
        if mirrors or off > RIGID:
            does = "mirrors" if mirrors else "scales or shears"
            raise UsageError(f"{name} {does}, and is no rotation; leave the scale out, and give it to shapes.of_arrays(..., scale)")
    return rotation


def check_place(name: str, place: Any) -> None:
    """Refuses what is no place of a body."""
    sides = [getattr(each, "shape", None) for each in place] if isinstance(place, Transform) else []
    if sides != [(3,), (3, 3)]:
        raise TypeError(f"the place of {name} is {kind(place)}; give what Transform.of(position_m, xyzw=...) or of_matrix makes")
    numpy = need("numpy")
    if not (numpy.isfinite(place.position_m).all() and numpy.isfinite(place.rotation).all()):
        at = ", ".join(f"{each:.3g}" for each in place.position_m)
        said = f"the place of {name} is not finite (position {at} m), as in an engine that diverged"
        raise UsageError(f"{said}; take shorter steps, and reset() when the engine begins anew")
    checked_rotation(place.rotation, f"the place of {name}")


class Wrench(NamedTuple):
    """A force and a torque about a point, in the world."""

    force_n: NDArray[np.float64]
    """(3,), N."""
    torque_nm: NDArray[np.float64]
    """(3,), N m, about `point_m`."""
    point_m: NDArray[np.float64]
    """(3,), metres."""

    def about(self, point_m: ArrayLike) -> Wrench:
        """The same, with the torque about another point, such as a body's centre of mass."""
        numpy = need("numpy")
        point = numpy.asarray(point_m, numpy.float64)
        (x, y, z), (fx, fy, fz) = (self.point_m - point).tolist(), self.force_n.tolist()
        lever = [y * fz - z * fy, z * fx - x * fz, x * fy - y * fx]  # numpy.cross takes a hundred microseconds
        return Wrench(self.force_n, self.torque_nm + lever, point)

    def __neg__(self) -> Wrench:
        """What acts on the other body."""
        return Wrench(-self.force_n, -self.torque_nm, self.point_m)


class Touch:
    """A pad among objects that a physics engine moves.

    ```python
    import gelsim
    from gelsim.adapters import Touch, Transform, shapes

    touch = Touch(gelsim.Simulator("gelsight-mini", "draft"), {"ball": shapes.sphere(4.0)}, friction=0.5)
    pad = Transform.of([0.0, 0.0, 0.1])                                # the pad looks up
    for step in range(5):
        ball = Transform.of([1e-4 * step, 0.0, 0.1 + 0.0035])          # half a millimetre deep, moving along x
        press = touch.step(pad, {"ball": ball}, duration_s=1 / 60)
        print(touch.touched, press.slip_state, touch.wrench.force_n)   # of the object on the pad, N, in the world
    ```

    It follows one object at a time, with friction that remembers: the one that touches, as long as it does, then the one that reaches
    deepest. With another object the memory begins anew. A second one that touches meanwhile is not felt, which is warned of.

    For flat pads alone: how deep objects reach is measured in the image's rectangle. For curved gels there is `Simulator.step`.
    """

    def __init__(
        self,
        simulator: Simulator,
        objects: Mapping[Any, HasMesh],
        *,
        friction: Optional[float] = 0.6,
        deepest_mm: Optional[float] = None,
        index: int = 0,
        seed: int = 0,
    ) -> None:
        """Takes a simulator, which stays as it is: the pad has a copy, with a sequence of its own.

        `objects` are shapes in mm by names of yours: what has `vertices` and `faces`, as `shapes.sphere(4.0)` and trimesh's meshes have.
        All that is fixed to a body is one object. `friction`, `index` and `seed` are those of `Simulator.reset`.

        A step in which an object reaches deeper than the pad is thick raises UsageError. With `deepest_mm`, an object that reaches deeper
        than this is pressed as if it were moved out of the pad to this depth; a warning says so, and `depth_mm` how deep it was.
        """
        if not isinstance(simulator, Simulator):
            raise TypeError(f'simulator is {kind(simulator)}; give gelsim.Simulator("gelsight-mini")')
        if not simulator.is_flat:
            way = "call simulator.step(mesh, gelsim.Placement(...))"
            raise UsageError(f"the gel of {simulator.sensor.name} is curved, and depths are measured over flat pads alone; {way}")
        self._thickness = simulator.gelpad_thickness_mm
        checks = Checks()
        self._deepest = checks.optional("deepest_mm", deepest_mm, 0.0, self._thickness, "mm")
        checks.done()
        if not isinstance(objects, Mapping):
            raise TypeError(f"objects is {kind(objects)}; give a dict of names and shapes")
        if not objects:
            raise UsageError("objects is empty; give the shapes that may touch")
        self.simulator = simulator.copy()
        """The pad's own simulator. Who steps it confuses the pad."""
        self.friction = friction
        """Coefficient between pad and objects, from the next `reset` or object on; None: nothing slips."""
        self.touched: Optional[Any] = None
        """Name of the object in the pad after the last step; None: nothing touches."""
        self.depth_mm = -math.inf
        """How deep the touching object reached in the last step, also if that was too deep; negative: it is at least so far away."""
        self._random = {"index": index, "seed": seed}
        self._half = [0.5 * side for side in simulator.field_of_view_mm]
        self._bodies = {name: Body(shape, str(name)) for name, shape in objects.items()}
        self.reset()

    def reset(self) -> None:
        """Begins anew: nothing has touched the pad yet."""
        self.simulator.reset(friction=self.friction, **self._random)
        self._followed: Any = next(iter(self._bodies))
        self._has_touched = False
        self._wrench: Optional[Wrench] = None
        self._warned: set[str] = set()
        self.touched, self.depth_mm = None, -math.inf

    def step(self, pad: Transform, objects: Mapping[Any, Transform], *, duration_s: float = 1 / 60) -> Impression:
        """Presses the next frame: where the pad and the objects are now, in the world. `duration_s` is the time since the frame before.

        Objects that are left out are away. The impression's wrench is in the pad's frame; `wrench` has it in the world.
        """
        depths = self.depths(pad, objects)
        touching = [name for name, depth in depths.items() if depth > 0.0]
        name = self._choose_followed(touching, depths)
        self.depth_mm = depths[name] if touching else max(depths.values(), default=-math.inf)
        place = pad.inverse() @ objects[name] if name in objects else away()
        if self._deepest is None and self.depth_mm > self._thickness:
            said = f"{name!r} is {self.depth_mm:.3g} mm deep in a pad of {self._thickness:g} mm"
            raise UsageError(f"{said}; press it less deep, or give deepest_mm, the depth it is held at with a warning")
        # Only now, so that a step that is refused leaves the memory as it is.
        self._follow(name, touching)
        if self._deepest is not None and self.depth_mm > self._deepest:
            self._warn("deep", f"{name!r} is {self.depth_mm:.3g} mm deep, and pressed by deepest_mm = {self._deepest:g} mm")
        limit = self._thickness if self._deepest is None else self._deepest
        over = self.depth_mm - min(limit, self._thickness - ROUNDING_MM)
        if over > 0.0:
            place = Transform(place.position_m + need("numpy").array([0.0, 0.0, 1e-3 * over]), place.rotation)
        self._place = place
        press = self._press(self.simulator, place, duration_s)
        self.touched = name if press.in_contact else None
        force, torque = press.wrench.reshape(2, 3)
        self._wrench = Wrench(pad.rotation @ force, 1e-3 * (pad.rotation @ torque), pad.position_m)
        return press

    def depths(self, pad: Transform, objects: Mapping[Any, Transform]) -> dict[Any, float]:
        """How deep each object would reach there, mm; negative: it is at least so far away. UsageError for places that are not finite."""
        self._check(pad, objects)
        world, floor = pad.inverse(), -(self._thickness + BEHIND_MM)
        return {name: -self._bodies[name].lowest(world @ place, self._half, floor) for name, place in objects.items()}

    @property
    def wrench(self) -> Wrench:
        """Force and torque of the object on the pad in the last step, about the pad's origin. `-touch.wrench` acts on the object."""
        if self._wrench is None:
            raise UsageError("no wrench is known before the first step")
        return self._wrench

    @property
    def middle_m(self) -> NDArray[np.float64]:
        """(3,): middle of the touching object in the last step, in the pad's frame, metres."""
        found: NDArray[np.float64] = self._place.rotation @ (1e-3 * self._bodies[self._followed].middle) + self._place.position_m
        return found

    def pressed(self, simulator: Simulator, moved: Optional[Transform] = None) -> NDArray[np.float64]:
        """Wrench in the pad's frame, N and N mm, of a frame of another simulator with the object where it was in the last step, or moved
        from there: what would be felt, while the pad's own memory stays."""
        return self._press(simulator, self._place if moved is None else moved @ self._place, 1.0 / 60.0).wrench

    def is_through(self, moved: Transform) -> bool:
        """True if the object, moved from where it was in the last step, would reach through the pad: nothing presses it there."""
        depth = -self._bodies[self._followed].lowest(moved @ self._place, self._half, -(self._thickness + BEHIND_MM))
        return depth > self._thickness - ROUNDING_MM

    def _check(self, pad: Transform, objects: Mapping[Any, Transform]) -> None:
        """Refuses what are no places of known objects."""
        if not isinstance(objects, Mapping):
            raise TypeError(f"objects is {kind(objects)}; give a dict of names and places")
        check_place("the pad", pad)
        for name, place in objects.items():
            if name not in self._bodies:
                raise UsageError(f"objects has {name!r}; known: {', '.join(map(repr, self._bodies))}")
            check_place(repr(name), place)

    def _press(self, simulator: Simulator, place: Transform, duration_s: float) -> Impression:
        """A frame with the followed object there, in the pad's frame."""
        beside = [half + BESIDE * self._thickness for half in self._half]
        mesh, place = self._bodies[self._followed].near(place, beside, -self._thickness)
        x, y, z = (1e3 * place.position_m).tolist()
        qx, qy, qz, qw = place.xyzw.tolist()
        return simulator.step(mesh, Placement((x, y, z), (qx, qy, qz, qw)), duration_s=duration_s)

    def _choose_followed(self, touching: list[Any], depths: dict[Any, float]) -> Any:
        """The object that a step follows: the same one as long as it touches."""
        if touching and self._followed not in touching:
            return max(touching, key=depths.__getitem__)
        return self._followed

    def _follow(self, name: Any, touching: list[Any]) -> None:
        """Follows an object; with another one the memory begins anew."""
        if name != self._followed and self._has_touched:
            self.simulator.reset(friction=self.friction, **self._random)
        self._followed = name
        self._has_touched |= bool(touching)
        for other in touching:
            if other != name:
                self._warn(f"beside {other}", f"{other!r} touches, too, and is not felt: the pad follows {name!r}")

    def __setstate__(self, state: dict[str, Any]) -> None:
        # Of a copy, or in another process: the pad's memory stays behind.
        self.__dict__.update(state)
        self.reset()

    def _warn(self, cause: str, said: str) -> None:
        """Once until `reset`."""
        if cause not in self._warned:
            warnings.warn(said, stacklevel=3)
            self._warned.add(cause)


def away() -> Transform:
    """Where nothing is near the pad."""
    return Transform.of([0.0, 0.0, AWAY_M])


class Body:
    """An object: its triangles, to look at, and its mesh, to press."""

    def __init__(self, shape: HasMesh, name: str) -> None:
        numpy = need("numpy")
        if not (hasattr(shape, "vertices") and hasattr(shape, "faces")):
            raise TypeError(f"object {name!r} is {kind(shape)}; give what has vertices (mm) and faces, as adapters.shapes makes")
        self.name = name
        self.mesh = Mesh(shape.vertices, shape.faces, name=name)
        self.corners = numpy.asarray(shape.vertices, numpy.float64)
        self.faces = numpy.asarray(shape.faces, numpy.int64)
        self.middle = 0.5 * (self.corners.min(axis=0) + self.corners.max(axis=0))
        self.radius = float(numpy.linalg.norm(self.corners - self.middle, axis=1).max())

    def placed(self, place: Transform) -> Any:
        """The corners in the pad's frame, mm."""
        return self.corners @ place.rotation.T + 1e3 * place.position_m

    def lowest(self, place: Transform, half: Sequence[float], floor: float) -> float:
        """Least z of what is within the rectangle of half sides `half`, mm; inf: nothing. What is entirely below `floor` does not count.
        Of what does not reach below 0 it is a bound."""
        numpy = need("numpy")
        x, y, z = place.rotation @ self.middle + 1e3 * place.position_m
        if abs(x) - half[0] > self.radius or abs(y) - half[1] > self.radius or z + self.radius < floor:
            return math.inf
        if z - self.radius > 0.0:
            return float(z) - self.radius
        lowest = self.corners[(self.corners @ place.rotation[2]).argmin()]
        x, y, z = place.rotation @ lowest + 1e3 * place.position_m
        if z > 0.0 or (abs(x) <= half[0] and abs(y) <= half[1] and z > floor):
            return float(z)
        triangles = cut_to(half, self.placed(place)[self.faces])
        above = triangles[triangles[:, :, 2].max(axis=1) > floor]
        return float(numpy.min(above[:, :, 2], initial=math.inf))

    def near(self, place: Transform, half: Sequence[float], floor: float) -> tuple[Mesh, Transform]:
        """The mesh and its place; of one that reaches below `floor` only what is above it and within the rectangle. Where that is nothing
        the mesh is away."""
        numpy = need("numpy")
        if (place.rotation @ self.middle + 1e3 * place.position_m)[2] - self.radius >= floor:
            return self.mesh, place
        if (self.corners @ place.rotation[2]).min() + 1e3 * place.position_m[2] >= floor:
            return self.mesh, place
        triangles = cut(cut_to(half, self.placed(place)[self.faces]), 2, -1.0, -floor)
        if not len(triangles):
            return self.mesh, away()
        back = (triangles.reshape(-1, 3) - 1e3 * place.position_m) @ place.rotation
        return mesh_of_arrays(back, numpy.arange(len(back), dtype=numpy.uint32).reshape(-1, 3), self.name), place


def cut_to(half: Sequence[float], triangles: Any) -> Any:
    """What of triangles (N, 3, 3) is within a rectangle of x and y, as triangles."""
    for axis in (0, 1):
        for sign in (-1.0, 1.0):
            triangles = cut(triangles, axis, sign, half[axis])
    return triangles


def cut(triangles: Any, axis: int, sign: float, limit: float) -> Any:
    """What of triangles (N, 3, 3) has `sign` times this coordinate up to `limit`, as triangles."""
    numpy = need("numpy")
    room = limit - sign * triangles[:, :, axis]
    inside = room >= 0.0
    count = inside.sum(axis=1)
    kept = [triangles[count == 3]]
    for several, lone in ((1, inside), (2, ~inside)):
        some = count == several
        # The corner that is alone on its side comes first, the two edges from it are cut.
        order = (lone[some].argmax(axis=1)[:, None] + numpy.arange(3)) % 3
        first, *others = numpy.moveaxis(numpy.take_along_axis(triangles[some], order[:, :, None], axis=1), 1, 0)
        here, *there = numpy.moveaxis(numpy.take_along_axis(room[some], order, axis=1), 1, 0)
        at = [first + (here / (here - end))[:, None] * (other - first) for end, other in zip(there, others)]
        if several == 1:
            kept.append(numpy.stack([first, *at], axis=1))
        else:
            kept += [numpy.stack([at[0], *others], axis=1), numpy.stack([at[0], others[1], at[1]], axis=1)]
    return numpy.concatenate(kept)
