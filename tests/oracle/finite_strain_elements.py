"""Tables of presses at finite strain, finely sampled: what a solver of large strains is held against.

    python finite_strain_elements.py TABLE               solve every press and write the table (half an hour)
    python finite_strain_elements.py TABLE --refine 1    with larger elements (three minutes)

tests/physics/data/finite_strain.json is such a table. The layer and the objects are those of finite_elements.py, which must lie
beside this file, with elements half as wide. One row per press: force over Young's modulus (per mm of length in plane strain), the
linear, frictionless answer's force and the rms of what it is wrong by over 2 mm outside the contact, and the surface:

    ring_w_mm    the deformed surface, into the pad, over the deformed radius: ring_start_mm is .05 mm from the contact's edge, and
                 ring_step_mm such that linear interpolation is good to .3 um, cubic to .1 um (a sticking punch at .5: .45, .35)
    w_mm         the same from the axis on, coarser: for objects without walls, cubic interpolation is good to .15 um but within .1 mm
                 of the contact's edge
    u_mm         radial motion over the radius at rest, from the axis on; cubic interpolation is good to 1.5 um (cone 2.5, punches 8),
                 worst where a kink passes between samples

How far it is converged: a table of elements twice as wide (--refine 1) differs from this one by (ring, rms and at most, um; force):

    balls, frictionless                .14     1.0    .09 % (a ball of 2 mm at .1; others .05 %)
    cylinder                           .10      .9    .02 %
    cone                               .05      .4    .08 % (at .1; then .02 %)
    punches and block, frictionless    .15      .7    .05 % (a punch of 2 mm at .3: .14 %)
    balls, sticking                    .23     1.5    .09 %
    punches, sticking, to .3           .55     3.0    .15 %
    punches, sticking, at .5          1.4      5.8    .33 %

The most is within .1 mm of the contact's edge. So this table errs by less; elements narrower by another fifth change a punch of 2 mm
at .3 by .013 um rms and .013 %. Without friction, steps half as long change nothing. Penalties ten times as stiff change surfaces by
.01 um and forces by .006 %. Edges of contacts are good to .005 mm (.01 mm where it sticks); on a wall they are .0013 mm inside it.

What sticks depends on how it got there. A point is anchored where it first touched, which the script finds inside each load step
(see Finely.hold): if points were anchored where steps end, forces would fall short by .4 % with steps of .05 mm, .2 % at .025 and .1 %
at .0125, and motion at the contact's edge by 7, 4 and 2 um. As it is, with steps of .0125 mm, half the step changes forces by up to
.07 % (18.754 to about 18.77 mm2 for the ball of 3.3 mm at .5), surfaces by .13 um rms for balls and .2 um for punches, and motion by
up to 2 um. Traction is largest at the contact's edge, and stiffer tangential penalties on the way there hold the surface harder: four
times as stiff adds up to .06 % of force for a ball. With elements twice as wide, it adds up to .1 % for a ball, .08 % for a punch to .3
and .18 % at .5: there, forces are hardly better than .3 %.
"""

import argparse
import time

import numpy as np

import finite_elements as elements
from finite_elements import POISSON, THICKNESS, Ball, Cone, Layer, LinearLayer, Press, Punch, write_table

# The ring outside the contact, from the contact's edge, and its possible steps: the longest that interpolates well is taken.
RING_START, RING_END = 0.05, 2.2
RING_STEPS = (0.025, 0.0125)
INTERPOLATION_UM = 0.3
SURFACE_SAMPLES, REST_SAMPLES = 121, 61

# Penalties of the answers, and those of marching to them (normal, sticking): softer, so that Newton's method converges in longer
# steps. The longest steps, mm, without and with friction.
PENALTY = 40000.0
MARCHING = (4000.0, 4000.0)
LONGEST = (0.08, 0.0125)
REFINE = 2.0

# A point of the surface nearer to the object than this touches, mm; distances from which the contact's edge is extrapolated.
TOUCHING = 1e-4
PARTING = (1e-3, 4e-2)


def cases():
    """Every series of presses: name, shape, geometry, whether it sticks, Poisson's ratio, depths over the thickness."""
    deep = (0.1, 0.2, 0.3, 0.4, 0.5)
    for poisson in (POISSON, 0.4999):
        for radius in (3.3, 2.0, 6.0):
            yield "ball", Ball(radius), "axisymmetric", False, poisson, deep
    for size in ((2.0, 0.4), (3.0, 0.2), (1.5, 0.2), (3.0, 0.6)):
        yield "punch", Punch(*size), "axisymmetric", False, POISSON, deep[:3]
    yield "punch", Punch(2.0, 0.4), "axisymmetric", False, 0.4999, deep[:3]
    yield "cone", Cone(0.6), "axisymmetric", False, POISSON, deep[:4]
    yield "cylinder", Ball(3.3), "plane strain", False, POISSON, deep
    yield "block", Punch(2.0, 0.2), "plane strain", False, POISSON, deep[:3]
    for name, shape in (("ball", Ball(3.3)), ("punch", Punch(2.0, 0.4)), ("ball", Ball(2.0)), ("punch", Punch(3.0, 0.6))):
        yield name, shape, "axisymmetric", True, POISSON, deep[::2]


class Finely(Press):
    """A press whose answers are those of stiffer penalties than the ones it marches with."""

    def __init__(self, *given):
        super().__init__(*given)
        self.past = [(0.0, *self.gaps())]

    def gaps(self):
        """Points of the surface relative to the object, and how far they are from it."""
        points, _, _, _ = self.touch(self.state, self.depth)
        return points, np.maximum(self.shape.distance(points[..., 0], points[..., 1])[0], 0)

    def hold(self):
        """Points that touch since the last step are anchored where they first touched, not where this step left them.

        Ahead of a contact's edge the gap grows as a distance to the power 3/2, so that a point's gap to the power 2/3 falls evenly
        while the edge advances: the last two gaps tell the depth at which it closed. In the first step, gaps close as they are wide.
        """
        had = self.anchored
        super().hold()
        points, gap = self.gaps()
        new = self.anchored & ~had
        if self.sticking and new.any():
            depth1, points1, gap1 = self.past[-1]
            if len(self.past) == 2:
                depth0, _, gap0 = self.past[0]
                fall = (gap0[new] ** (2 / 3) - gap1[new] ** (2 / 3)) / (depth1 - depth0)
                part = gap1[new] ** (2 / 3) / np.maximum(fall, 1e-12) / (self.depth - depth1)
            else:
                part = gap1[new] / max(gap1[new].max(), 1e-12)
            part = np.clip(part, 0, 1)[:, None]
            anchor = points1[new] + part * (points[new] - points1[new])
            distance, normal, _ = self.shape.distance(anchor[:, 0], anchor[:, 1])
            self.anchor[new] = anchor - distance[:, None] * normal
            self.along[new] = np.eye(2) - normal[:, :, None] * normal[:, None, :]
        self.past = [*self.past[-1:], (self.depth, points, gap)]

    def stiffen(self):
        """Raises the penalties to those of an answer, in steps of their logarithms; False where that does not converge."""
        soft = np.array([self.penalty, self.sticking_penalty])
        fraction, step = 0.0, 0.5
        while fraction < 1:
            trial = min(fraction + step, 1.0)
            self.penalty, self.sticking_penalty = soft * (PENALTY / soft) ** trial
            found = self.newton(self.state, self.depth)
            if found:
                self.state, fraction = found[0], trial
            else:
                step /= 2
            if step < 0.01:
                return False
        return True

    def fine_answer(self):
        """Force over Young's modulus, and closely spaced points of the surface; None where there is no answer.

        Of the points: radius at rest, radius, how far below the surface's rest, distance to the object.
        """
        marching = self.penalty, self.sticking_penalty, self.state
        try:
            if not self.stiffen():
                return None
            force = self.answer()[0] * (2 * np.pi if self.layer.axisymmetric else 2)
            rest, _ = self.layer.surface_line(np.zeros_like(self.state), 32)
            r, w = self.layer.surface_line(self.state, 32)
            return force, rest, r, w, self.shape.distance(r, self.depth - w)[0]
        finally:
            self.penalty, self.sticking_penalty, self.state = marching


def contact_edge(r, distance):
    """Radius of the contact's edge: beyond it, the distance to the object to the power 2/3 is nearly proportional to r - edge."""
    touching = r[distance < TOUCHING].max()
    parting = (distance > PARTING[0]) & (distance < PARTING[1]) & (np.abs(r - touching) < 0.5)
    return float(np.polyfit(distance[parting] ** (2 / 3), r[parting], 2)[-1])


def sample(edge, rest, r, w):
    """The surface as fields of a row; r, w: where it is a function of the radius, rest: all of its points' radii at rest, and now."""

    def rounded(values):
        return [round(float(x), 5) + 0.0 for x in values]

    start = round(edge + RING_START, 4)
    width = RING_END - RING_START
    fine_r = np.linspace(start, start + width, 3441)
    fine = np.interp(fine_r, r, w)
    for ring_step in RING_STEPS:
        ring_r = start + ring_step * np.arange(round(width / ring_step) + 1)
        ring = np.interp(ring_r, r, w)
        if np.abs(np.interp(fine_r, ring_r, ring) - fine).max() < 1e-3 * INTERPOLATION_UM:
            break
    radii = np.linspace(0, edge + RING_END, SURFACE_SAMPLES)
    rest_radii = np.linspace(0, edge + RING_END, REST_SAMPLES)
    return {
        "ring_start_mm": start,
        "ring_step_mm": ring_step,
        "ring_w_mm": rounded(ring),
        "r_step_mm": round(float(radii[1]), 8),
        "w_mm": rounded(np.interp(radii, r, w)),
        "rest_step_mm": round(float(rest_radii[1]), 8),
        "u_mm": rounded(np.interp(rest_radii, rest[0], rest[1] - rest[0])),
    }


def linear_layer(shape, geometry, poisson, deepest):
    reach = min(1.5 * shape.contact_radius(deepest) + 0.5, getattr(shape, "radius", np.inf) + 1e-9)
    edges = elements.mesh(shape, deepest, 1 if isinstance(shape, Punch) else 2, True)
    return LinearLayer(*edges, geometry, reach, poisson)


def row_of(case, s, answer, linear):
    """A row of the table."""
    name, shape, geometry, sticking, poisson, _ = case
    depth = s * THICKNESS
    force, rest, r, w, distance = answer
    # Radii past which the deformed surface does not return, so that it is a function of the radius.
    outward = np.maximum.accumulate(r) <= r
    profile = r[outward], w[outward]
    edge = contact_edge(profile[0], distance[outward])
    row = {"object": name, **shape.fields(), "geometry": geometry, "contact": "sticking" if sticking else "frictionless"}
    row |= {"poisson_ratio": poisson, "s": s, "depth_mm": round(depth, 4), "contact_mm": round(edge, 4)}
    row |= {"force_mm2": round(float(force), 6), "linear_force_mm2": None, "linear_ring_rms_um": None}
    if linear:
        _, forces, _ = linear.contact(depth - shape.height(linear.r))
        whole = 2 * np.pi if geometry == "axisymmetric" else 2
        row["linear_force_mm2"] = round(float(forces.sum() * whole), 6)
        row["linear_ring_rms_um"] = elements.compare((force, edge, *profile), linear, shape, None, depth)["error_rms_um"]
    return row | sample(edge, (rest, r), *profile)


def solve(case, refine=REFINE, longest=None):
    """Rows of the table for one object pressed to increasing depths; fewer where the solution stops."""
    _, shape, geometry, sticking, poisson, strains = case
    deepest = strains[-1] * THICKNESS
    press = Finely(Layer(*elements.mesh(shape, deepest, refine), geometry, poisson=poisson), shape, sticking, *MARCHING)
    linear = None if sticking else linear_layer(shape, geometry, poisson, deepest)
    began = time.time()
    for s in strains:
        answer = press.fine_answer() if press.to(s * THICKNESS, longest or LONGEST[sticking]) else None
        if answer is None:
            print(f"    stopped at {press.depth:.4f} mm", flush=True)
            return
        row = row_of(case, s, answer, linear)
        shown = ", ".join(f"{key} {row[key]}" for key in ("contact_mm", "force_mm2", "linear_force_mm2", "linear_ring_rms_um"))
        print(f"    s {s:.1f}  {shown}  {press.solves} solves {time.time() - began:.0f} s", flush=True)
        yield row


def main():
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("table", help="the table (JSON) to write")
    options.add_argument("--refine", type=float, default=REFINE, help="elements smaller by this factor")
    given = options.parse_args()
    rows = []
    for case in cases():
        name, shape, geometry, sticking, poisson, _ = case
        print(f"{name} {shape.fields()}, {geometry}, {'sticking' if sticking else 'frictionless'}, nu {poisson}", flush=True)
        for row in solve(case, given.refine):
            rows.append(row)
            write_table(given.table, rows)


if __name__ == "__main__":
    main()
