"""Presses that stick, and how surfaces move in their own plane: finite elements beside linear, sticking theory.

    python sticking_elements.py TABLE            solve every press and write the table (five minutes)
    python sticking_elements.py TABLE --quick    one ball, sticking and frictionless (half a minute)

tests/physics/data/sticking_elements.json is such a table. Layer, objects and meshes are those of finite_elements.py, which must lie
beside this file. Linear theory that sticks: small strains, w >= g and pressure >= 0, no motion along the surface where it touches.
"""

import argparse
import time

import numpy as np

import finite_elements as elements
from finite_elements import RING, THICKNESS, Ball, Cone, Layer, Press, Punch


class StickingLayer:
    """Small-strain displacements of the surface by forces on its nodes, down and outward; contact that sticks."""

    def __init__(self, r_edges, z_edges, geometry, reach):
        layer = Layer(r_edges, z_edges, geometry)
        lu = layer.factor(layer.response(np.zeros(layer.unknowns))[1])
        free = np.full(layer.unknowns, -1)
        free[layer.free] = np.arange(len(layer.free))
        self.r = layer.nodes[layer.surface, 0]
        out, up = free[2 * layer.surface], free[2 * layer.surface + 1]
        self.count = int((self.r < reach).sum())
        # Forces down, then outward; the axis does not move outward.
        self.outward = np.flatnonzero((out >= 0) & (self.r < reach))
        pull = np.zeros((len(layer.free), self.count + len(self.outward)))
        pull[up[: self.count], np.arange(self.count)] = -1
        pull[out[self.outward], self.count + np.arange(len(self.outward))] = 1
        moved = lu.solve(pull)
        self.down = -moved[up]
        self.along = np.where((out >= 0)[:, None], moved[out], 0)

    def contact(self, gap, sticks):
        """Displacements down and outward, forces down, and the contact's nodes."""
        n, g = self.count, gap[: self.count]
        active = g > 0
        for _ in range(200):
            down = np.flatnonzero(active)
            out = np.flatnonzero(active[self.outward]) if sticks else down[:0]
            columns = np.concatenate([down, n + out])
            matrix = np.concatenate([self.down[down][:, columns], self.along[self.outward[out]][:, columns]])
            force = np.zeros(n + len(self.outward))
            force[columns] = np.linalg.solve(matrix, np.concatenate([g[down], np.zeros(len(out))]))
            w = self.down @ force
            wanted = (active & (force[:n] > 0)) | (~active & (w[:n] < g - 1e-10))
            if (wanted == active).all():
                break
            active = wanted
        return w, self.along @ force, force[:n], active


def compare(press, solver, shape, depth, samples=25):
    """Finite elements beside linear theory, both with the same friction: a row of the table."""
    force, edge, r, w = press.answer()
    layer = press.layer
    gap = depth - shape.height(solver.r)
    w_linear, u_linear, forces, active = solver.contact(gap, press.sticking)
    linear_edge = float(solver.r[: solver.count][active].max())
    start = max(edge, linear_edge)
    order = np.maximum.accumulate(r) <= r
    r, w = r[order], w[order]
    ring = np.linspace(start, start + RING, 401)[1:]
    error = 1e3 * (np.interp(ring, r, w) - np.interp(ring, solver.r, w_linear))
    rest = layer.nodes[layer.surface, 0]
    moved = press.state[2 * layer.surface]
    radii = np.linspace(0, start + 3, samples)
    inside = np.linspace(0, linear_edge, 201)[:-1]
    motion_error = 1e3 * (np.interp(inside, rest, moved) - np.interp(inside, solver.r, u_linear))
    outside_error = 1e3 * (np.interp(ring, rest, moved) - np.interp(ring, solver.r, u_linear))

    def rms(values):
        return round(float(np.sqrt(np.mean(values**2))), 2)

    return {
        "s": round(depth / THICKNESS, 4),
        "depth_mm": round(depth, 4),
        "contact_mm": round(edge, 4),
        "linear_contact_mm": round(linear_edge, 4),
        "error_max_um": round(float(np.abs(error).max()), 2),
        "error_rms_um": rms(error),
        "motion_inside_rms_um": rms(motion_error),
        "motion_outside_rms_um": rms(outside_error),
        "force_mm2": round(float(force * (2 * np.pi if layer.axisymmetric else 2)), 5),
        "force_over_linear": round(float(force / forces.sum()), 4),
        "r_mm": [round(float(x), 3) for x in radii],
        "w_mm": [round(float(x), 4) for x in np.interp(radii, r, w)],
        "u_mm": [round(float(x), 5) for x in np.interp(radii, rest, moved)],
    }


def presses():
    """Every series: name, shape, geometry, whether it sticks, depths over the thickness."""
    ball = ("ball", Ball(3.3), "axisymmetric")
    shapes = [("ball", Ball(radius), "axisymmetric") for radius in (6.0, 1.5, 12.0)]
    shapes += [("cone", Cone(slope), "axisymmetric") for slope in (0.6, 0.3, 1.0)]
    shapes += [("punch", Punch(*size), "axisymmetric") for size in ((2.0, 0.5), (3.0, 0.2), (4.0, 1.0), (1.0, 0.2), (2.0, 0.1))]
    shapes += [("cylinder", Ball(radius), "plane strain") for radius in (3.3, 8.0)]
    shapes += [("block", Punch(*size), "plane strain") for size in ((2.0, 0.2), (4.0, 0.5))]
    series = [(*ball, True, (0.1, 0.2, 0.3, 0.4, 0.5)), (*ball, False, (0.1, 0.2, 0.3, 0.4, 0.5))]
    series += [(*shape, True, elements.STRAINS) for shape in shapes]
    series += [(*shape, False, elements.STRAINS) for shape in shapes[:2] + shapes[3:4] + shapes[6:7]]
    return series


def solve(name, shape, geometry, sticking, strains):
    """Rows of the table for one object pressed to increasing depths; fewer where the solution stops."""
    depths = [s * THICKNESS for s in strains]
    reach = min(1.5 * shape.contact_radius(depths[-1]) + 0.5, getattr(shape, "radius", np.inf) + 1e-9)
    linear = StickingLayer(*elements.mesh(shape, depths[-1], 1 if isinstance(shape, Punch) else 2, True), geometry, reach)
    press = Press(Layer(*elements.mesh(shape, depths[-1]), geometry), shape, sticking)
    began = time.time()
    for depth in depths:
        if not press.to(depth, 0.05 if sticking else 0.08):
            print(f"    stopped at {press.depth:.3f} mm", flush=True)
            return
        row = {"object": name, **shape.fields(), "geometry": geometry, "contact": "sticking" if sticking else "frictionless"}
        row |= compare(press, linear, shape, depth)
        shown = ("error_max_um", "error_rms_um", "motion_inside_rms_um", "motion_outside_rms_um", "force_over_linear")
        print(f"    s {row['s']:.1f} ", ", ".join(f"{key} {row[key]}" for key in shown), f"{time.time() - began:.0f} s", flush=True)
        yield row


def main():
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("table", help="the table (JSON) to write")
    options.add_argument("--quick", action="store_true", help="one ball")
    given = options.parse_args()
    rows = []
    for name, shape, geometry, sticking, strains in presses()[: 2 if given.quick else None]:
        print(f"{name} {shape.fields()}, {geometry}, {'sticking' if sticking else 'frictionless'}", flush=True)
        for row in solve(name, shape, geometry, sticking, strains):
            rows.append(row)
            elements.write_table(given.table, rows)


if __name__ == "__main__":
    main()
