"""Three-dimensional finite elements of an elastic layer under rigid objects that are no bodies of revolution.

    python finite_strain_3d.py TABLE     solve every case and write the table (eleven minutes on one core)
    python finite_strain_3d.py --check   a ball, beside the axisymmetric elements of finite_elements.py (four minutes)

tests/physics/data/finite_strain_3d.json is such a table. Needs ngsolve 6.2.2608, mkl 2026.2, numpy 2 and scipy 1.17, and 4 GB of memory.
Lengths in mm, stresses in units of Young's modulus. x, y: deformed places of points of the surface in one quadrant; w: their depth below
the surface at rest; touches: 1 where a point is on the object. coarser_max_um, coarser_rms_um: how far the next coarser mesh's surface
lies from this one's within 2 mm outside the contact, at equal x and y.

Large strains, nearly incompressible neo-Hookean rubber, W = mu/2 (I1 - 3) - mu ln J + lambda/2 (ln J)^2, bonded below. A quarter of
the layer, with planes of symmetry at x = 0 and y = 0; its sides, four thicknesses beyond the object, slide on rollers. Bricks, displacement
triquadratic, pressure linear and discontinuous, so the layer does not lock. Contact is frictionless, by a penalty at the integration
points of the deformed surface on the object's signed distance. The energy is written down; NGSolve derives forces and stiffness from it.

Convergence, elements of 0.15 against 0.1 mm at the contact's edge, surfaces at equal x and y: cylinder 6.7 um within 0.1 mm of the
contact, where the surface is steep, 1.3 to 0.2 mm, 0.3 from there to 2 mm; block 15.5, 1.0 and 0.5 um. Forces differ by 0.02 and
0.04 %. The cylinder with 0.1 against 0.07 mm (growing faster away from the edge): 5.6, 0.3 and 0.1 um, forces by 0.001 %. A ball,
0.17 mm, against axisymmetric elements: force 0.03 % less, 2.8 um within 0.15 mm of the contact, 0.4 beyond.
"""

import json
import sys
import time
from collections import namedtuple
from pathlib import Path

import ngsolve as ng
import numpy as np
from ngsolve import Det, Grad, Id, IfPos, InnerProduct, ds, dx, log, sqrt
from ngsolve.meshes import MakeStructured3DMesh
from scipy.interpolate import CloughTocher2DInterpolator
from scipy.spatial import cKDTree

THICKNESS, DEPTH, POISSON = 3.0, 0.6, 0.48
SHEAR = 1 / (2 * (1 + POISSON))
LAME = POISSON / ((1 + POISSON) * (1 - 2 * POISSON))
# Pressure per mm of penetration: on the first mesh, which serves as a start only, and on the others.
FIRST_PENALTY, PENALTY = 100.0, 1000.0
# Of Newton's method: the pressure that the stiffness counts at most on a curved object, and the last step's length; the longest.
ROUGH, EXACT, LONGEST = (0.5, 1e-3), (2.0, 1e-5), 0.1
# Surfaces are compared this far outside the contact; points are kept this far, and at most so many.
RING, KEPT, POINTS = 2.0, 2.5, 1500
# How fast elements grow away from the contact's edge, along the surface and downwards.
GROWTH, GROWTH_DOWN = 0.3, 0.35


def meet(a, b, fillet=0.0):
    """Distance to where two distances along perpendicular axes are both negative, inflated by a fillet."""
    return IfPos(a, IfPos(b, sqrt(a * a + b * b + 1e-24), a), IfPos(b, b, IfPos(a - b, a, b))) - fillet


# Rigid objects: their signed distances at x, y >= 0 (the lowest point is the origin), the parts of x and y where the surface's elements
# are finest, and their sizes there, mesh after mesh.
Shape = namedtuple("Shape", "name sizes distance band_x band_y fine")
BALL = Shape(
    "ball", {"radius_mm": 3.3},
    lambda x, y, z: sqrt(x * x + y * y + (z - 3.3) ** 2) - 3.3, (0.0, 1.8), (0.0, 1.8), (0.36, 0.24, 0.17),
)  # fmt: skip
# A cylinder lying along x, the edges of its ends rounded, and a block with all edges rounded.
CYLINDER = Shape(
    "cylinder", {"radius_mm": 2.0, "length_mm": 4.0, "fillet_mm": 0.3},
    lambda x, y, z: meet(sqrt(y * y + (z - 2.0) ** 2) - 1.7, x - 1.7, 0.3), (1.6, 2.05), (1.0, 1.5), (0.25, 0.15, 0.1),
)  # fmt: skip
BLOCK = Shape(
    "block", {"size_x_mm": 4.0, "size_y_mm": 2.0, "fillet_mm": 0.4},
    lambda x, y, z: meet(meet(x - 1.6, y - 0.6), 0.4 - z, 0.4), (1.6, 2.05), (0.6, 1.05), (0.25, 0.15, 0.1),
)  # fmt: skip


def graded(fine, band, end, growth):
    """Edges of elements from 0 to end, finest in a band."""
    t = np.linspace(0, end, 20001)
    size = fine + growth * np.maximum(np.maximum(band[0] - t, t - band[1]), 0)
    count = np.concatenate([[0], np.cumsum((1 / size[1:] + 1 / size[:-1]) / 2 * np.diff(t))])
    return np.interp(np.linspace(0, count[-1], int(np.ceil(count[-1])) + 1), count, t)


class Layer:
    """The layer under one object, meshed with elements of one size at the contact's edge."""

    def __init__(self, shape, fine):
        self.shape, self.fine, self.depth = shape, fine, ng.Parameter(0)
        self.penalty, self.bound = ng.Parameter(FIRST_PENALTY), ng.Parameter(ROUGH[0])
        self.edges = [graded(fine, band, band[1] + 4 * THICKNESS, GROWTH) for band in (shape.band_x, shape.band_y)]
        self.edges.append(THICKNESS - graded(fine, (0, 0), THICKNESS, GROWTH_DOWN)[::-1])
        nx, ny, nz = [len(edges) - 1 for edges in self.edges]
        ex, ey, ez = self.edges
        mapping = lambda x, y, z: (ex[round(x * nx)], ey[round(y * ny)], ez[round(z * nz)])  # noqa: E731
        self.mesh = MakeStructured3DMesh(nx=nx, ny=ny, nz=nz, mapping=mapping)
        sides = {"dirichletx": "bottom|back|front", "dirichlety": "bottom|left|right", "dirichletz": "bottom"}
        displacement, constant = ng.VectorH1(self.mesh, order=2, **sides), ng.L2(self.mesh, order=0)
        self.space = displacement * constant**4
        self.state = ng.GridFunction(self.space)
        self.displacement = self.state.components[0]
        # The pressure: four amounts an element, its mean and its slopes.
        u, p = self.space.TrialFunction()
        pressure = p[0]
        for axis, (place, edges) in enumerate(zip((ng.x, ng.y, ng.z), self.edges)):
            middle, size = ng.GridFunction(constant), ng.GridFunction(constant)
            middle.Set(place)
            size.vec.FV().NumPy()[:] = np.diff(edges)[np.searchsorted(edges, middle.vec.FV().NumPy()) - 1]
            pressure = pressure + p[axis + 1] * (place - middle) / size
        f = Id(3) + Grad(u)
        stored = SHEAR / 2 * (InnerProduct(f, f) - 3) - SHEAR * log(Det(f)) + pressure * log(Det(f)) - pressure**2 / (2 * LAME)
        self.top = ds("top", bonus_intorder=2)
        gap = self.gap(u)
        self.energy = ng.BilinearForm(self.space)
        self.energy += ng.Variation(stored.Compile() * dx)
        self.energy += ng.Variation(self.penalty / 2 * IfPos(-gap, gap**2, 0) * self.top)
        # The same with the force on a curved object bounded in the stiffness: far from the answer it would make that indefinite.
        excess = -self.gap(self.displacement) - self.bound / self.penalty
        self.stiffness = ng.BilinearForm(self.space, condense=True, symmetric=True)
        self.stiffness += ng.Variation(stored.Compile() * dx)
        self.stiffness += ng.Variation(self.penalty / 2 * IfPos(-gap, (gap + IfPos(excess, excess, 0)) ** 2, 0) * self.top)

    def gap(self, u):
        """Distance of the deformed surface from the object."""
        return self.shape.distance(ng.x + u[0], ng.y + u[1], ng.z + u[2] - THICKNESS + self.depth)

    def newton(self, bound, tolerance):
        """Newton's method from the present state."""
        self.bound.Set(bound)
        state, matrix = self.state.vec, self.stiffness
        rest, change = state.CreateVector(), state.CreateVector()
        for _ in range(25):
            self.energy.Apply(state, rest)
            matrix.AssembleLinearization(state)
            inverse = matrix.mat.Inverse(self.space.FreeDofs(True), inverse="pardiso")
            rest.data += matrix.harmonic_extension_trans * rest
            change.data = inverse * rest
            del inverse  # before the next is made
            change.data += matrix.harmonic_extension * change
            change.data += matrix.inner_solve * rest
            # Of the unknowns, those at vertices are displacements; the others are factors of polynomials.
            moves = change.FV().NumPy()[: self.displacement.space.ndof].reshape(3, -1)[:, : self.mesh.nv]
            largest = np.abs(moves).max()
            state.data -= min(1, LONGEST / largest) * change
            if largest < tolerance:
                return
        raise RuntimeError("Newton's method does not converge")

    def press(self, steps=6):
        """Presses from rest, step by step."""
        state, before, start = self.state.vec, None, None
        for step in range(1, steps + 1):
            before, start = start, state.CreateVector()
            start.data = state
            if before is not None:
                state.data += start - before
            self.depth.Set(DEPTH * step / steps)
            self.newton(*ROUGH)

    def start_from(self, coarse):
        """Solves from the answer on another mesh."""
        self.depth.Set(DEPTH)
        self.displacement.Set(coarse.displacement)
        mean = LAME * log(Det(Id(3) + Grad(coarse.displacement)))
        self.state.components[1].Set(ng.CF((mean, 0, 0, 0)))
        for penalty, stage in ((2 * FIRST_PENALTY, ROUGH), (PENALTY, ROUGH), (PENALTY, EXACT)):
            if penalty >= coarse.penalty.Get():
                self.penalty.Set(penalty)
                self.newton(*stage)

    def force(self):
        """Force of the whole object."""
        gap = self.gap(self.displacement)
        return 4 * ng.Integrate(self.penalty * IfPos(-gap, gap, 0) * gap.Diff(self.depth) * self.top, self.mesh)

    def surface(self, per_element, reach=9.0):
        """Deformed positions x, y and depths w of points of the surface, and their distances from the object."""
        lines = []
        for edges in self.edges[:2]:
            edges = edges[: np.searchsorted(edges, reach) + 1]
            inner = (edges[:-1, None] + np.diff(edges)[:, None] * np.arange(per_element) / per_element).ravel()
            lines.append(np.append(inner, edges[-1]))
        x, y = (line.ravel() for line in np.meshgrid(*lines, indexing="ij"))
        points = self.mesh(x, y, np.full(x.shape, THICKNESS - 1e-9))
        u, gap = self.displacement(points), self.gap(self.displacement)(points).ravel()
        return x + u[:, 0], y + u[:, 1], -u[:, 2], gap


def outside(answer, x, y):
    """Distance of places from the contact's nearest point."""
    touching = answer[3] < 0
    return cKDTree(np.stack([answer[0][touching], answer[1][touching]], -1)).query(np.stack([x, y], -1))[0]


def row(layer, coarse):
    """A case of the table."""
    dense, rough = layer.surface(8), coarse.surface(5)
    touching, away = dense[3] < 0, outside(dense, *rough[:2])
    ring = (rough[3] > 0) & (away < RING)
    error = 1e3 * np.abs(rough[2] - CloughTocher2DInterpolator(np.stack(dense[:2], -1), dense[2])(*rough[:2]))
    print("    coarser mesh differs", *(f"{np.nanmax(error[ring & (away >= a)]):.2f} um past {a} mm" for a in (0, 0.1, 0.2, 0.5)))
    x, y, w, gap = layer.surface(3)
    kept = np.flatnonzero(outside(dense, x, y) < KEPT)
    kept = kept[np.linspace(0, len(kept) - 1, min(len(kept), POINTS)).astype(int)]
    fields = {"object": layer.shape.name, **layer.shape.sizes}
    fields |= {"depth_mm": DEPTH, "poisson_ratio": POISSON, "thickness_mm": THICKNESS, "force_mm2": round(layer.force(), 5)}
    fields |= {f"contact_{axis}_mm": round(float(dense[i][touching].max()), 4) for i, axis in enumerate("xy")}
    fields |= {"element_mm": layer.fine, "coarser_max_um": round(float(np.nanmax(error[ring])), 2)}
    fields |= {"coarser_rms_um": round(float(np.sqrt(np.nanmean(error[ring] ** 2))), 2)}
    fields |= {f"{key}_mm": [round(float(value), 5) for value in a[kept]] for key, a in (("x", x), ("y", y), ("w", w))}
    return fields | {"touches": [int(value) for value in gap[kept] < 0]}


def solve(shape):
    """Answers on finer and finer meshes, and their rows of the table; the first serves as a start only."""
    coarse, began = None, time.time()
    for fine in shape.fine:
        layer = Layer(shape, fine)
        if coarse is None:
            layer.press()
        else:
            layer.start_from(coarse)
            found = row(layer, coarse)
            print("   ", {key: value for key, value in found.items() if not isinstance(value, list)}, f"{time.time() - began:.0f} s")
            yield layer, found
        coarse = layer


def check():
    """The ball beside the axisymmetric elements."""
    import finite_elements as axisymmetric

    section = axisymmetric.Ball(3.3)
    press = axisymmetric.Press(axisymmetric.Layer(*axisymmetric.mesh(section, DEPTH, 2.0), "axisymmetric"), section, False)
    press.to(DEPTH, 0.08)
    force, edge, r, w = press.answer()
    for layer, _ in solve(BALL):
        x, y, deep, _ = layer.surface(5)
        away, error = np.hypot(x, y) - edge, 1e3 * np.abs(deep - np.interp(np.hypot(x, y), r, w))
        print(f"    force {layer.force():.4f}, axisymmetric {2 * np.pi * force:.4f}; surfaces differ, from the contact's edge,")
        for a, b in ((-edge, -0.1), (-0.1, 0.2), (0.2, RING)):
            print(f"    {a:.1f} to {b:.1f} mm: by at most {error[(away >= a) & (away < b)].max():.2f} um", flush=True)


def write(table):
    rows = {}
    for shape in (CYLINDER, BLOCK):
        for _, rows[shape.name] in solve(shape):
            Path(table).write_text("[\n" + ",\n".join(json.dumps(case) for case in rows.values()) + "\n]\n")


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    check() if sys.argv[1] == "--check" else write(sys.argv[1])
