"""Touch in MuJoCo: a site is the pad, bodies of the model touch it.

Contact comes from the geoms' own triangles, not from a depth camera. A body is all its geoms, and those of bodies that are fixed to it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Optional

from gelsim._native import UsageError
from gelsim.adapters import Touch, Transform, shapes
from gelsim.adapters.coupling import Coupling
from gelsim.checks import items, kind
from gelsim.needed import need
from gelsim.simulator import Impression, Simulator

if TYPE_CHECKING:
    from gelsim.adapters.shapes import Shape

__all__ = ["Pad", "shape_of"]

ENDLESS_MM = 1e4
"""Half the side of a plane without one."""
SLAB_MM = 5.0
"""Half the thickness that a plane gets."""


class Pad:
    """A tactile pad on a site of a model.

    The site's axes are the sensor's: x to the right in the image, y down, z out of the pad; its origin is the middle of the image on the
    untouched pad. `sense` gives the next tactile frame. `push` has the pad's forces act on the bodies, in place of MuJoCo's own contacts,
    which are switched off between the two (`contype`, `conaffinity`, or `<exclude>`).
    """

    def __init__(
        self,
        simulator: Simulator,
        model: Any,
        site: str,
        bodies: Sequence[str],
        *,
        groups: Optional[Sequence[int]] = None,
        friction: Optional[float] = 0.6,
        deepest_mm: Optional[float] = None,
        damping: float = 0.3,
        index: int = 0,
        seed: int = 0,
    ) -> None:
        """Takes an `MjModel`, and names of its site and of the bodies that may touch it.

        `groups` are the groups of the geoms that count, such as [2] in models that have what is seen there, and what collides elsewhere;
        without them all do. `damping` is the damping ratio of bodies held by `push`; the rest is `Touch`'s.
        """
        mujoco = need("mujoco")
        if not isinstance(model, mujoco.MjModel):
            raise TypeError(f"model is {kind(model)}; give a mujoco.MjModel")
        names = items("bodies", bodies, "a list of names, such as ['knob']")
        self._site = number(model, mujoco.mjtObj.mjOBJ_SITE, "site", site)
        self._bodies = {name: number(model, mujoco.mjtObj.mjOBJ_BODY, "body", name) for name in names}
        self._model = model
        objects = {name: shape_of(model, body, groups) for name, body in self._bodies.items()}
        touch = Touch(simulator, objects, friction=friction, deepest_mm=deepest_mm, index=index, seed=seed)
        masses = [model.body_subtreemass[body] for body in self._bodies.values() if model.body_subtreemass[body] > 0.0]
        lightest = float(min(masses, default=1.0))
        spread = [model.body_inertia[body].min() / model.body_mass[body] for body in self._bodies.values() if model.body_mass[body] > 0.0]
        gyration = float(min(spread, default=1e-4)) ** 0.5
        self.coupling = Coupling(touch, mass_kg=lightest, gyration_m=gyration, damping=damping)
        """Its forces between frames."""

    @property
    def touch(self) -> Touch:
        """What touches it."""
        return self.coupling.touch

    def reset(self) -> None:
        """Begins anew: nothing has touched the pad yet. An earlier time than before, as after `mj_resetData`, does so, too."""
        self.coupling.reset()

    def sense(self, data: Any) -> Impression:
        """A tactile frame, where an `MjData` has pad and bodies now: after `mj_forward` or `mj_step1`."""
        return self.coupling.sense(*self._where(data), data.time)

    def push(self, data: Any) -> None:
        """Adds the pad's forces to `data.xfrc_applied`: on the body that touches, and against it on the pad's own.

        Between `mj_step1` and `mj_step2`, after setting what was there to 0."""
        wrench = self.coupling.wrench(*self._where(data), data.time)
        if self.touch.touched is not None:
            own = int(self._model.site_bodyid[self._site])
            for body, acting in ((own, wrench), (self._bodies[self.touch.touched], -wrench)):
                force, torque, _ = acting.about(data.xipos[body])
                data.xfrc_applied[body, :3] += force
                data.xfrc_applied[body, 3:] += torque

    def _where(self, data: Any) -> tuple[Transform, dict[str, Transform]]:
        if not hasattr(data, "site_xmat"):
            raise TypeError(f"data is {kind(data)}; give a mujoco.MjData")
        if not data.site_xmat[self._site].any():
            raise UsageError("data has no places yet; call mujoco.mj_forward(model, data) first")
        pad = Transform.of_matrix(data.site_xmat[self._site], data.site_xpos[self._site])
        return pad, {name: Transform.of_matrix(data.xmat[body], data.xpos[body]) for name, body in self._bodies.items()}


def number(model: Any, its: Any, what: str, name: str) -> int:
    """Where a name of its kind is in the model."""
    mujoco = need("mujoco")
    if not isinstance(name, str):
        raise TypeError(f"the name of a {what} is {kind(name)}; give a text")
    found: int = mujoco.mj_name2id(model, its, name)
    if found < 0:
        count = {"site": model.nsite, "body": model.nbody}[what]
        there = ", ".join(repr(mujoco.mj_id2name(model, its, each)) for each in range(min(count, 20)))
        raise UsageError(f"the model has no {what} {name!r}; it has {there or 'none'}")
    return found


def shape_of(model: Any, body: int, groups: Optional[Sequence[int]] = None) -> Shape:
    """The triangles of a body and of what is fixed to it, mm in the body's frame."""
    mujoco = need("mujoco")
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    fixed = {body}
    for child in range(body + 1, model.nbody if body else 0):
        if model.body_parentid[child] in fixed and model.body_jntnum[child] == 0:
            fixed.add(child)
    geoms = [geom for geom in range(model.ngeom) if model.geom_bodyid[geom] in fixed]
    wanted = None if groups is None else items("groups", groups, "a list of whole numbers, such as [2]")
    geoms = [geom for geom in geoms if wanted is None or model.geom_group[geom] in wanted]
    if not geoms:
        raise UsageError(f"the body {mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, body)!r} has no geom, or none in these groups")
    frame = Transform.of_matrix(data.xmat[body], data.xpos[body]).inverse()
    placed = ((geom, frame @ Transform.of_matrix(data.geom_xmat[geom], data.geom_xpos[geom])) for geom in geoms)
    return shapes.joined([geom_shape(model, geom).at(place) for geom, place in placed])


def geom_shape(model: Any, geom: int) -> Shape:
    """The triangles of a geom, mm in its own frame: that of a mesh is where MuJoCo centred and turned it, as its corners are."""
    mujoco = need("mujoco")
    numpy = need("numpy")
    kinds = mujoco.mjtGeom
    kind, data, (a, b, c) = model.geom_type[geom], model.geom_dataid[geom], 1e3 * model.geom_size[geom]
    if kind == kinds.mjGEOM_SPHERE:
        return shapes.sphere(a)
    if kind == kinds.mjGEOM_CAPSULE:
        return shapes.capsule(a, b)
    if kind == kinds.mjGEOM_ELLIPSOID:
        return shapes.ellipsoid([a, b, c])
    if kind == kinds.mjGEOM_CYLINDER:
        return shapes.cylinder(a, b)
    if kind == kinds.mjGEOM_BOX:
        return shapes.box([a, b, c])
    if kind == kinds.mjGEOM_PLANE:
        return shapes.box([a or ENDLESS_MM, b or ENDLESS_MM, SLAB_MM]).at(Transform.of([0.0, 0.0, -1e-3 * SLAB_MM]))
    if kind == kinds.mjGEOM_MESH:
        corners = slice(model.mesh_vertadr[data], model.mesh_vertadr[data] + model.mesh_vertnum[data])
        faces = slice(model.mesh_faceadr[data], model.mesh_faceadr[data] + model.mesh_facenum[data])
        return shapes.of_arrays(model.mesh_vert[corners], model.mesh_face[faces])
    if kind == kinds.mjGEOM_HFIELD:
        rows, columns = int(model.hfield_nrow[data]), int(model.hfield_ncol[data])
        half_x, half_y, top, bottom = model.hfield_size[data]
        heights = model.hfield_data[model.hfield_adr[data] :][: rows * columns].reshape(rows, columns)
        x, y = numpy.meshgrid(numpy.linspace(-half_x, half_x, columns), numpy.linspace(-half_y, half_y, rows))
        corners = numpy.stack([x, y, top * heights], axis=-1).reshape(-1, 3)
        at = numpy.arange(rows * columns).reshape(rows, columns)
        a, b, c, d = (each.ravel() for each in (at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]))
        # The walls around it.
        rim = numpy.concatenate([at[0, :-1], at[:-1, -1], at[-1, :0:-1], at[:0:-1, 0]])
        foot = len(corners) + numpy.arange(len(rim))
        corners = numpy.concatenate([corners, corners[rim] * [1, 1, 0] - [0, 0, bottom]])
        after, under = numpy.roll(rim, -1), numpy.roll(foot, -1)
        triples = [(a, b, c), (a, c, d), (rim, foot, under), (rim, under, after)]
        return shapes.of_arrays(corners, numpy.concatenate([numpy.stack(each, axis=1) for each in triples]))
    raise UsageError(f"geom {geom} is of a kind that has no triangles here: {kinds(kind).name}")
