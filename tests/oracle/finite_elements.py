"""Finite-element solutions of an elastic layer pressed by a rigid object, beside the linear, frictionless answer.

    python finite_elements.py TABLE            solve every press and write the table (half an hour)
    python finite_elements.py TABLE --quick    a few presses (a few minutes)
    python finite_elements.py TABLE --domes    balls on domes of constant thickness (a few minutes)

tests/physics/data/finite_elements.json is such a table, finite_elements_domes.json one of domes: there is no linear answer in it, and
distances are arcs from the tip over the gel, displacements along its normal.

Needs numpy and scipy. Lengths in mm, stresses in units of Young's modulus.

The layer is nearly incompressible neo-Hookean rubber, bonded below, with large strains and the object's true surface.
Displacement and pressure are interpolated separately (Taylor-Hood: biquadratic and bilinear), so the layer does not lock.
The linear answer is the one gelsim computes: small strains, vertical displacement w >= g and pressure >= 0 on the
undeformed surface, no traction along it.
"""

import argparse
import json
import time
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import splu

THICKNESS = 3.0
POISSON = 0.48
STRAINS = (0.1, 0.2, 0.3, 0.4)
RING = 2.0

# Penalties: pressure per mm of penetration, and traction per mm of slip.
NORMAL_PENALTY = 4000.0
STICKING_PENALTY = 1000.0


# --- Rigid objects: sections of a body of revolution, or of a long prism, with their lowest point at (0, 0) ---


@dataclass
class Ball:
    """A sphere, or a cylinder lying on its side."""

    radius: float

    def height(self, r):
        """Height of the surface seen from below, above its lowest point; infinite beside the object."""
        inside = np.abs(r) < self.radius
        return np.where(inside, self.radius - np.sqrt(np.maximum(self.radius**2 - r**2, 0)), np.inf)

    def distance(self, r, z):
        """Signed distance to the surface (negative inside), outward normal, and curvature of its level line."""
        z = z - self.radius
        away = np.maximum(np.hypot(r, z), 1e-9)
        return away - self.radius, np.stack([r / away, z / away], -1), 1 / away

    def contact_radius(self, depth):
        return min(1.05 * np.sqrt(self.radius * depth) + 0.1, self.radius)

    def fields(self):
        return {"radius_mm": self.radius}


@dataclass
class Cone:
    """A cone with a rounded tip."""

    slope: float
    tip: float = 0.3

    def height(self, r):
        angle = np.arctan(self.slope)
        tangent = self.tip * np.sin(angle)
        ball = self.tip - np.sqrt(np.maximum(self.tip**2 - np.minimum(r, tangent) ** 2, 0))
        return ball + self.slope * np.maximum(r - tangent, 0)

    def distance(self, r, z):
        angle = np.arctan(self.slope)
        z = z - self.tip
        away = np.maximum(np.hypot(r, z), 1e-9)
        flank = r * np.cos(angle) + z * np.sin(angle) > 0
        distance = np.where(flank, r * np.sin(angle) - z * np.cos(angle), away) - self.tip
        normal = np.stack(
            [np.where(flank, np.sin(angle), r / away), np.where(flank, -np.cos(angle), z / away)], -1
        )
        return distance, normal, np.where(flank, 0, 1 / away)

    def contact_radius(self, depth):
        return 0.85 * depth / self.slope + 0.2

    def fields(self):
        return {"slope": self.slope, "tip_mm": self.tip}


@dataclass
class Punch:
    """A flat punch with a vertical wall and a rounded edge; a block in plane strain."""

    radius: float
    fillet: float

    def height(self, r):
        along = np.maximum(r - (self.radius - self.fillet), 0)
        rise = self.fillet - np.sqrt(np.maximum(self.fillet**2 - along**2, 0))
        return np.where(r <= self.radius + 1e-9, rise, np.inf)

    def distance(self, r, z):
        out, down = r - (self.radius - self.fillet), self.fillet - z
        corner_r, corner_z = np.maximum(out, 0), np.maximum(down, 0)
        away = np.hypot(corner_r, corner_z)
        distance = away + np.minimum(np.maximum(out, down), 0) - self.fillet
        wall = (out > down).astype(float)
        safe = np.where(away > 0, away, 1)
        normal = np.stack(
            [np.where(away > 0, corner_r / safe, wall), np.where(away > 0, -corner_z / safe, wall - 1)], -1
        )
        return distance, normal, np.where((out > 0) & (down > 0), 1 / safe, 0)

    def contact_radius(self, depth):
        return self.radius

    def fields(self):
        return {"radius_mm": self.radius, "fillet_mm": self.fillet}


# --- The layer ---


def quadratic(x):
    """The three quadratic shape functions on [-1, 1] and their derivatives."""
    return (
        np.stack([x * (x - 1) / 2, 1 - x**2, x * (x + 1) / 2], -1),
        np.stack([x - 0.5, -2 * x, x + 0.5], -1),
    )


def sag(dome, r):
    """How far a domed pad lies below its apex at r; it is flat from 0.62 of its radius outwards."""
    return dome - np.sqrt(dome**2 - np.minimum(r, 0.62 * dome) ** 2) if dome else np.zeros_like(r)


class Layer:
    """Finite elements of the layer: matrices and forces at a given displacement u and pressure p.

    `dome` is the radius of a layer that is domed over a flat shell, `ball` that of one as thick everywhere on a ball.
    """

    def __init__(self, r_edges, z_edges, geometry, dome=None, ball=None, poisson=POISSON):
        self.axisymmetric = geometry == "axisymmetric"
        self.shear, self.lame = 1 / (2 * (1 + poisson)), poisson / ((1 + poisson) * (1 - 2 * poisson))
        nr, nz = len(r_edges) - 1, len(z_edges) - 1
        self.columns, self.rows = 2 * nr + 1, 2 * nz + 1

        def with_middles(edges):
            return np.insert(edges, np.arange(1, len(edges)), (edges[1:] + edges[:-1]) / 2)

        r, z = np.meshgrid(with_middles(r_edges), with_middles(z_edges), indexing="ij")
        z = z * (1 - sag(dome, r) / THICKNESS)
        if ball:
            core = ball - THICKNESS
            r, z = (core + z) * np.sin(r / ball), (core + z) * np.cos(r / ball) - core
        self.nodes = np.stack([r.ravel(), z.ravel()], -1)
        node = np.arange(r.size).reshape(r.shape)
        corner = np.arange((nr + 1) * (nz + 1)).reshape(nr + 1, nz + 1)
        i, j = (index.ravel() for index in np.meshgrid(np.arange(nr), np.arange(nz), indexing="ij"))
        self.element_nodes = np.stack([node[2 * i + a, 2 * j + b] for a in range(3) for b in range(3)], -1)
        corners = np.stack([corner[i + a, j + b] for a in range(2) for b in range(2)], -1)
        self.displacements, self.unknowns = 2 * r.size, 2 * r.size + corner.size
        self.u_index = np.stack([2 * self.element_nodes, 2 * self.element_nodes + 1], -1).reshape(len(i), 18)
        self.p_index = self.displacements + corners

        # Gradients at 3 x 3 Gauss points: du_r/dr, du_r/dz, du_z/dr, du_z/dz, u_r/r.
        gauss, weight = np.polynomial.legendre.leggauss(3)
        x, y = (value.ravel() for value in np.meshgrid(gauss, gauss, indexing="ij"))
        (nx, dx), (ny, dy) = quadratic(x), quadratic(y)
        shape = (nx[:, :, None] * ny[:, None, :]).reshape(9, 9)
        slopes = np.stack([(dx[:, :, None] * ny[:, None, :]).reshape(9, 9), (nx[:, :, None] * dy[:, None, :]).reshape(9, 9)])
        position = self.nodes[self.element_nodes]
        jacobian = np.einsum("dqn,enc->eqcd", slopes, position)
        gradient = np.einsum("dqn,eqdc->eqnc", slopes, np.linalg.inv(jacobian))
        radius = np.einsum("qn,en->eq", shape, position[..., 0])
        self.weight = np.linalg.det(jacobian) * np.outer(weight, weight).ravel() * (radius if self.axisymmetric else 1)
        self.gradient = np.zeros((len(i), 9, 5, 18))
        self.gradient[:, :, 0, 0::2] = self.gradient[:, :, 2, 1::2] = gradient[..., 0]
        self.gradient[:, :, 1, 0::2] = self.gradient[:, :, 3, 1::2] = gradient[..., 1]
        if self.axisymmetric:
            self.gradient[:, :, 4, 0::2] = shape / radius[..., None]
        linear = np.stack([(1 - gauss) / 2, (1 + gauss) / 2], -1)
        self.pressure_shape = np.einsum("ia,jb->ijab", linear, linear).reshape(9, 4)

        # The surface: its nodes, and four Gauss points on each of its edges.
        self.surface = node[:, -1]
        self.top_elements = np.arange(nr) * nz + nz - 1
        self.top_local = np.stack([2 * np.array([2, 5, 8]), 2 * np.array([2, 5, 8]) + 1], -1).ravel()
        gauss, weight = np.polynomial.legendre.leggauss(4)
        self.edge_shape, edge_slope = quadratic(gauss)
        edges = self.element_nodes[self.top_elements][:, [2, 5, 8]]
        self.edge_nodes, self.edge_position = edges, np.einsum("qn,enc->eqc", self.edge_shape, self.nodes[edges])
        length = np.linalg.norm(np.einsum("qn,enc->eqc", edge_slope, self.nodes[edges]), axis=-1)
        self.edge_weight = length * weight * (self.edge_position[..., 0] if self.axisymmetric else 1)

        fixed = np.zeros(self.unknowns, bool)
        fixed[2 * node[:, 0]] = fixed[2 * node[:, 0] + 1] = True
        fixed[2 * node[0, :]] = fixed[2 * node[-1, :]] = True
        if ball:
            fixed[2 * node[-1, :] + 1] = True
        self.free = np.flatnonzero(~fixed)
        self.plan_assembly(fixed)

    def plan_assembly(self, fixed):
        """Where each entry of each element's matrix goes in the sparse matrix of the free unknowns."""
        number = np.full(self.unknowns, -1)
        number[self.free] = np.arange(len(self.free))
        index = number[np.concatenate([self.u_index, self.p_index], 1)]
        rows = np.repeat(index[:, :, None], 22, 2).ravel()
        columns = np.repeat(index[:, None, :], 22, 1).ravel()
        self.kept = (rows >= 0) & (columns >= 0)
        n = len(self.free)
        places, self.place = np.unique(columns[self.kept] * n + rows[self.kept], return_inverse=True)
        self.matrix_rows = (places % n).astype(np.int32)
        self.matrix_starts = np.searchsorted(places // n, np.arange(n + 1)).astype(np.int32)

    def factor(self, elements):
        """The factored matrix of the free unknowns, from the elements' matrices."""
        n = len(self.free)
        data = np.bincount(self.place, elements.ravel()[self.kept], len(self.matrix_rows))
        matrix = csc_matrix((data, self.matrix_rows, self.matrix_starts), (n, n))
        return splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.01, options={"SymmetricMode": True})

    def response(self, state):
        """Forces and element matrices of the material at a state (displacements, then pressures); None if inverted."""
        u, p = state[self.u_index], state[self.p_index]
        f = np.einsum("eqkn,en->eqk", self.gradient, u) + np.array([1, 0, 0, 1, 1.0])
        area = f[..., 0] * f[..., 3] - f[..., 1] * f[..., 2]
        volume = area * f[..., 4]
        if not np.isfinite(volume).all() or volume.min() < 0.02:
            return None
        pressure = np.einsum("qm,em->eq", self.pressure_shape, p)
        # The inverse transpose of the deformation gradient, in the order of its components.
        inverse = np.stack([f[..., 3] / area, -f[..., 2] / area, -f[..., 1] / area, f[..., 0] / area, 1 / f[..., 4]], -1)
        excess = pressure - self.shear
        stress = self.shear * f + excess[..., None] * inverse
        weight = self.weight
        forces = np.zeros(self.unknowns)
        by_u = np.einsum("eqkn,eqk->en", self.gradient, stress * weight[..., None])
        by_p = np.einsum("qm,eq->em", self.pressure_shape, (np.log(volume) - pressure / self.lame) * weight)
        forces += np.bincount(self.u_index.ravel(), by_u.ravel(), self.unknowns)
        forces += np.bincount(self.p_index.ravel(), by_p.ravel(), self.unknowns)
        tangent = np.zeros(f.shape + (5,))
        tangent[..., range(5), range(5)] = self.shear
        for a, (i, k) in enumerate(((0, 0), (0, 1), (1, 0), (1, 1))):
            for b, (m, l) in enumerate(((0, 0), (0, 1), (1, 0), (1, 1))):
                tangent[..., a, b] -= excess * inverse[..., 2 * m + k] * inverse[..., 2 * i + l]
        tangent[..., 4, 4] -= excess * inverse[..., 4] ** 2
        count = len(u)
        stiff = (tangent * weight[..., None, None]) @ self.gradient
        elements = np.zeros((count, 22, 22))
        flat = self.gradient.reshape(count, 45, 18)
        elements[:, :18, :18] = flat.transpose(0, 2, 1) @ stiff.reshape(count, 45, 18)
        dilation = np.einsum("eqk,eqkn->eqn", inverse * weight[..., None], self.gradient)
        elements[:, 18:, :18] = np.einsum("qm,eqn->emn", self.pressure_shape, dilation)
        elements[:, :18, 18:] = elements[:, 18:, :18].transpose(0, 2, 1)
        elements[:, 18:, 18:] = -np.einsum("qm,qn,eq->emn", self.pressure_shape, self.pressure_shape, weight) / self.lame
        return forces, elements

    def surface_points(self, state):
        """Positions of the surface's Gauss points."""
        u = np.stack([state[2 * self.edge_nodes], state[2 * self.edge_nodes + 1]], -1)
        return self.edge_position + np.einsum("qn,enc->eqc", self.edge_shape, u)

    def surface_line(self, state, per_element=8):
        """Radius and depth below the apex's rest height of closely spaced points of the deformed surface."""
        shape, _ = quadratic(np.linspace(-1, 1, per_element, endpoint=False))
        moved = self.nodes[self.edge_nodes] + np.stack([state[2 * self.edge_nodes], state[2 * self.edge_nodes + 1]], -1)
        points = np.einsum("qn,enc->eqc", shape, moved).reshape(-1, 2)
        points = np.concatenate([points, moved[-1, -1:]])
        return points[:, 0], THICKNESS - points[:, 1]


# --- Large strains ---


class Press:
    """A rigid object pressed step by step into the layer."""

    def __init__(self, layer, shape, sticking, penalty=NORMAL_PENALTY, sticking_penalty=STICKING_PENALTY):
        self.layer, self.shape, self.sticking = layer, shape, sticking
        self.penalty, self.sticking_penalty = penalty, sticking_penalty
        self.state = np.zeros(layer.unknowns)
        self.depth, self.last = 0.0, None
        self.anchored = np.zeros(layer.edge_weight.shape, bool)
        self.anchor = np.zeros(layer.edge_position.shape)
        self.along = np.zeros(layer.edge_position.shape + (2,))
        self.solves = 0

    def touch(self, state, depth):
        """Points of the surface relative to the object, their penetration, normals and curvatures."""
        points = self.layer.surface_points(state) - np.array([0, THICKNESS - depth])
        distance, normal, curvature = self.shape.distance(points[..., 0], points[..., 1])
        return points, np.maximum(-distance, 0), normal, curvature

    def contact(self, state, depth):
        """Forces on the surface's nodes and the contact's part of the top elements' matrices."""
        layer = self.layer
        points, pen, normal, curvature = self.touch(state, depth)
        outer = normal[..., :, None] * normal[..., None, :]
        traction = self.penalty * pen[..., None] * normal
        matrix = self.penalty * ((pen > 0)[..., None, None] * outer - (pen * curvature)[..., None, None] * (np.eye(2) - outer))
        if self.sticking:
            hold = self.sticking_penalty * self.anchored[..., None, None] * self.along
            traction = traction - np.einsum("eqcd,eqd->eqc", hold, points - self.anchor)
            matrix = matrix + hold
        forces = np.einsum("qn,eqc->enc", layer.edge_shape, traction * layer.edge_weight[..., None])
        blocks = np.einsum("qn,qm,eqcd->encmd", layer.edge_shape, layer.edge_shape, matrix * layer.edge_weight[..., None, None])
        return forces, blocks.reshape(-1, 6, 6)

    def residual(self, state, depth):
        response = self.layer.response(state)
        if response is None:
            return None
        forces, elements = response
        push, blocks = self.contact(state, depth)
        nodes = self.layer.edge_nodes
        for c in range(2):
            forces -= np.bincount(2 * nodes.ravel() + c, push[..., c].ravel(), len(forces))
        top, local = self.layer.top_elements, self.layer.top_local
        elements[top[:, None, None], local[:, None], local] += blocks
        return forces, elements

    def newton(self, state, depth):
        free, state = self.layer.free, state.copy()
        for iteration in range(18):
            terms = self.residual(state, depth)
            if terms is None:
                return None
            self.solves += 1
            try:
                change = self.layer.factor(terms[1]).solve(-terms[0][free])
            except RuntimeError:
                return None
            moved = np.zeros(len(state))
            moved[free] = change
            largest = np.abs(moved[: self.layer.displacements]).max()
            if not np.isfinite(largest) or largest > 2:
                return None
            state += moved
            if largest < 2e-6:
                return state, iteration
        return None

    def to(self, target, longest):
        """Presses to the target depth in steps of at most `longest`; False where Newton's method stops converging."""
        step = min(0.02 if self.last is None else self.step, longest)
        while self.depth < target - 1e-12:
            depth = min(self.depth + step, target)
            start = self.state
            if self.last is not None:
                start = start + (self.state - self.last[0]) * ((depth - self.depth) / (self.depth - self.last[1]))
            found = self.newton(start, depth) or (self.newton(self.state, depth) if self.last is not None else None)
            if found is None:
                step /= 2
                if step < 4e-4:
                    return False
                continue
            self.last = (self.state, self.depth)
            self.state, self.depth = found[0], depth
            if found[1] < 7:
                step = min(1.5 * step, longest)
            self.step = step
            self.hold()
        return True

    def hold(self):
        """Points that touch stay where they are on the object; points that left are free again."""
        points, pen, normal, _ = self.touch(self.state, self.depth)
        new = (pen > 0) & ~self.anchored
        self.anchor[new] = points[new]
        self.along[new] = np.eye(2) - normal[new][:, :, None] * normal[new][:, None, :]
        self.anchored = pen > 0

    def answer(self):
        """Force, edge of the contact, and the deformed surface."""
        points, pen, _, _ = self.touch(self.state, self.depth)
        forces, _ = self.contact(self.state, self.depth)
        r, w = self.layer.surface_line(self.state)
        return -forces[..., 1].sum(), float(points[..., 0][pen > 0].max(initial=0)), r, w


# --- The linear, frictionless answer ---


class LinearLayer:
    """Small-strain displacement of the surface by forces on its nodes, and contact with it."""

    def __init__(self, r_edges, z_edges, geometry, reach, poisson=POISSON):
        self.layer = layer = Layer(r_edges, z_edges, geometry, poisson=poisson)
        lu = layer.factor(layer.response(np.zeros(layer.unknowns))[1])
        down = np.searchsorted(layer.free, 2 * layer.surface + 1)
        self.r = layer.nodes[layer.surface, 0]
        self.candidates = np.flatnonzero(self.r < reach)
        pull = np.zeros((len(layer.free), len(self.candidates)))
        pull[down[self.candidates], np.arange(len(self.candidates))] = 1
        self.compliance = lu.solve(pull)[down]

    def contact(self, gap):
        """Solves w >= g, force >= 0, force (w - g) = 0 at the nodes, exactly. Returns w, forces and the contact's nodes."""
        n = len(self.candidates)
        c, g = self.compliance[self.candidates], gap[self.candidates]
        active = g > 0
        seen = set()
        for _ in range(200):
            force = np.zeros(n)
            force[active] = np.linalg.solve(c[np.ix_(active, active)], g[active])
            w = c @ force
            wanted = (active & (force > 0)) | (~active & (w < g - 1e-10))
            if (wanted == active).all():
                return self.compliance @ force, force, active
            if wanted.tobytes() in seen:  # a cycle: change the worst node only
                wrong = np.where(active, -force / force.max(), (g - w) / g.max())
                wanted = active.copy()
                worst = np.argmax(np.where(np.isfinite(wrong), wrong, -np.inf))
                wanted[worst] = not wanted[worst]
            seen.add(wanted.tobytes())
            active = wanted
        raise RuntimeError("linear contact did not settle")


# --- Meshes ---


def graded(start, end, first, growth, largest):
    """Edges from start to end, elements growing from `first`."""
    sizes = []
    while sum(sizes) < abs(end - start):
        sizes.append(min(first * growth ** len(sizes), largest))
    steps = np.concatenate([[0], np.cumsum(sizes)])
    return start + (end - start) * steps / steps[-1]


def mesh(shape, deepest, refine=1.0, linear=False):
    """Edges of the elements along r and z, finest around the contact's edge."""
    outer = shape.contact_radius(deepest) + 6 * THICKNESS
    if isinstance(shape, Punch):
        fine = (min(shape.fillet / 5, 0.06) if not linear else 0.004) / refine
        width = 0.45 if not linear else 0.05
        inner = max(shape.radius - width, 0.1)
        beyond = shape.radius + (0.5 if not linear else 0.05)
        middle = np.linspace(inner, beyond, int(np.ceil((beyond - inner) / fine)) + 1)
        if linear:  # a node on the wall itself
            half = int(np.ceil(width / fine))
            middle = np.concatenate([np.linspace(inner, shape.radius, half + 1), np.linspace(shape.radius, beyond, half + 1)[1:]])
        growth = 1 + 0.25 / refine
        r = np.concatenate(
            [
                graded(inner, 0, fine, growth, 0.3 / refine)[::-1],
                middle[1:],
                graded(beyond, beyond + RING, fine, growth, 0.2 / refine)[1:],
                graded(beyond + RING, outer, 0.25 / refine, growth, 2.0)[1:],
            ]
        )
        top = (max(1.5 * fine, 0.05) if not linear else 0.02) / refine
    else:
        size = min(0.09, shape.contact_radius(0.3) / 10) / refine
        uniform = shape.contact_radius(deepest) + 0.4
        uniform = np.linspace(0, uniform, int(np.ceil(uniform / size)) + 1)
        growth = 1 + 0.2 / refine
        end = uniform[-1]
        r = np.concatenate(
            [uniform, graded(end, end + RING, size, growth, 0.2 / refine)[1:], graded(end + RING, outer, 0.25 / refine, growth, 2.0)[1:]]
        )
        top = size
    z = THICKNESS - graded(0, THICKNESS, top, 1 + 0.3 / refine, 0.6)[::-1]
    return r, z


# --- Presses ---


def compare(answer, solver, shape, dome, depth, samples=25):
    """The linear answer against the finite-element one: a row of the table."""
    force, edge, r, w = answer
    gap = depth - shape.height(solver.r) - sag(dome, solver.r)
    w_linear, forces, active = solver.contact(gap)
    linear_edge = float(solver.r[solver.candidates][active].max())
    start = max(edge, linear_edge)
    # Radii past which the deformed surface does not return, so that it is a function of the radius.
    order = np.maximum.accumulate(r) <= r
    r, w = r[order], w[order]
    ring = np.linspace(start, start + RING, 401)[1:]
    error = np.interp(ring, r, w) - (np.interp(ring, solver.r, w_linear) + sag(dome, ring))
    radii = np.linspace(0, start + 3, samples)
    surface = np.interp(radii, r, w) - sag(dome, radii)
    worst = int(np.argmax(np.abs(error)))
    return {
        "s": round(depth / THICKNESS, 4),
        "depth_mm": round(depth, 4),
        "contact_mm": round(edge, 4),
        "linear_contact_mm": round(linear_edge, 4),
        "error_max_um": round(1e3 * float(np.abs(error).max()), 2),
        "error_rms_um": round(1e3 * float(np.sqrt(np.mean(error**2))), 2),
        "error_at_mm": round(float(ring[worst] - start), 3),
        "force_over_linear": round(float(force / forces.sum()), 4),
        "r_mm": [round(float(x), 3) for x in radii],
        "w_mm": [round(float(x), 4) for x in surface],
    }


def presses():
    """Every series of presses: name, shape, geometry, whether it sticks, the dome's radius."""
    shapes = [("ball", Ball(radius), "axisymmetric") for radius in (3.3, 1.5, 6.0, 12.0)]
    shapes += [("punch", Punch(*size), "axisymmetric") for size in ((3.0, 0.2), (1.0, 0.2), (2.0, 0.5), (4.0, 1.0), (2.0, 0.1))]
    shapes += [("cone", Cone(slope), "axisymmetric") for slope in (0.3, 0.6, 1.0)]
    shapes += [("cylinder", Ball(radius), "plane strain") for radius in (3.3, 8.0)]
    shapes += [("block", Punch(*size), "plane strain") for size in ((2.0, 0.2), (4.0, 0.5))]
    series = [(*shape, False, None) for shape in shapes]
    series += [("ball", Ball(3.3), "axisymmetric", False, dome) for dome in (10.0, 20.0)]
    series += [(*shape, True, None) for shape in shapes]
    return series


QUICK = [0, 4, 12, 18]


def solve(name, shape, geometry, sticking, dome, strains=STRAINS, refine=1.0, longest=None):
    """Rows of the table for one object pressed to increasing depths; fewer where the solution stops."""
    depths = [s * THICKNESS for s in strains]
    if dome:
        depths = depths[:2]
    edges = mesh(shape, depths[-1], refine)
    reach = min(1.5 * shape.contact_radius(depths[-1]) + 0.5, getattr(shape, "radius", np.inf) + 1e-9)
    linear = LinearLayer(*mesh(shape, depths[-1], refine * (1 if isinstance(shape, Punch) else 2), True), geometry, reach)
    press = Press(Layer(*edges, geometry, dome), shape, sticking)
    began = time.time()
    for depth in depths:
        if not press.to(depth, longest or (0.05 if sticking else 0.08)):
            print(f"    stopped at {press.depth:.3f} mm", flush=True)
            return
        row = {"object": name, **shape.fields(), "geometry": geometry, "contact": "sticking" if sticking else "frictionless"}
        row |= {"dome_mm": dome} | compare(press.answer(), linear, shape, dome, depth)
        print(
            f"    s {row['s']:.1f}  error {row['error_max_um']:7.2f} um at {row['error_at_mm']:.2f} mm, rms {row['error_rms_um']:6.2f}"
            f"  force {row['force_over_linear']:.4f}  edges {row['contact_mm']:.3f} {row['linear_contact_mm']:.3f}"
            f"  {press.solves} solves {time.time() - began:.0f} s",
            flush=True,
        )
        yield row


def solve_on_dome(ball_mm, dome_mm, strains=STRAINS, refine=1.0):
    """Rows of the table for a ball on the tip of a dome: half a ball of gel of this radius, as thick everywhere."""
    shape, depths = Ball(ball_mm), [s * THICKNESS for s in strains]
    r_edges, z_edges = mesh(shape, depths[-1], refine)
    rim = dome_mm * np.pi / 2
    if r_edges[-1] > rim:
        r_edges = np.append(r_edges[r_edges < rim - 0.3], rim)
    press = Press(Layer(r_edges, z_edges, "axisymmetric", ball=dome_mm), shape, False)
    for depth in depths:
        if not press.to(depth, 0.08):
            print(f"    stopped at {press.depth:.3f} mm", flush=True)
            return
        force, edge, r, below = press.answer()
        up = dome_mm - below
        arcs, w = dome_mm * np.arctan2(r, up), dome_mm - np.hypot(r, up)
        edge_mm = dome_mm * np.arcsin(edge / dome_mm)
        radii = np.linspace(0, edge_mm + 3, 61)
        row = {"radius_mm": ball_mm, "dome_mm": dome_mm, "depth_mm": round(depth, 4), "contact_mm": round(edge_mm, 4)}
        row |= {"force_over_modulus_mm2": round(2 * np.pi * float(force), 5)}
        row |= {"r_mm": [round(float(x), 3) for x in radii]}
        row |= {"w_mm": [round(float(x), 4) for x in np.interp(radii, arcs, w)]}
        print(f"    s {depth / THICKNESS:.1f}  contact {edge_mm:.3f} mm  force {row['force_over_modulus_mm2']:.4f}", flush=True)
        yield row


def write_table(path, rows):
    """One line per press."""
    with open(path, "w") as table:
        table.write("[\n" + ",\n".join(json.dumps(row) for row in rows) + "\n]\n")


def main():
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("table", help="the table (JSON) to write")
    options.add_argument("--quick", action="store_true", help="a few presses")
    options.add_argument("--domes", action="store_true", help="balls on domes of constant thickness")
    options.add_argument("--refine", type=float, default=1.0, help="elements smaller by this factor, on domes")
    given = options.parse_args()
    if given.domes:
        rows = []
        for ball_mm, dome_mm in [(3.3, 10.0), (3.3, 20.0), (3.3, 30.0), (6.0, 10.0)]:
            print(f"ball of {ball_mm} mm on a dome of {dome_mm} mm", flush=True)
            rows += solve_on_dome(ball_mm, dome_mm, refine=given.refine)
            write_table(given.table, rows)
        return
    series = presses()
    rows = []
    for number in QUICK if given.quick else range(len(series)):
        name, shape, geometry, sticking, dome = series[number]
        on = f" on a dome of {dome} mm" if dome else ""
        print(f"{name} {shape.fields()}, {geometry}, {'sticking' if sticking else 'frictionless'}{on}", flush=True)
        for row in solve(*series[number]):
            rows.append(row)
            write_table(given.table, rows)


if __name__ == "__main__":
    main()
