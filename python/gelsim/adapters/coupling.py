"""Forces of a pad at a physics engine's own rate, from touch at a lower one.

A light object on a stiff pad moves a lot between two tactile frames: held until the next one, a force would throw it about. So the force
follows the object's motion between frames, by the contact's stiffness, which is measured by moving the object a little on a copy of the
pad. Coulomb's law bounds what it comes to, and a damping goes with it.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Optional

from gelsim.adapters import Touch, Transform, Wrench, check_place
from gelsim.checks import Checks
from gelsim.needed import need
from gelsim.simulator import Impression

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

__all__ = ["Coupling"]

MOVED_M = 1e-5
"""How far the object is moved to measure a stiffness."""
TURNED_RAD = 2e-3
"""How far it is turned."""
CHANGED = 0.3
"""The stiffness is measured anew when the normal force has changed by this part."""
FARTHEST_M = 5e-5
FARTHEST = 0.2
"""A contact that became so much deeper or shallower is pressed anew, or by this part of its depth."""
LONGEST_S = 1.0
"""No longer is the time between two frames."""
NEWTONMETRES = [1.0, 1.0, 1.0, 1e-3, 1e-3, 1e-3]
"""Torques of N mm in N m."""
SAFE = 0.9
"""Longest step of an engine, as a part of a radian of the quickest mode; held by two pads an object swings more quickly."""
LEAST_N = 0.02
"""Contacts with less force than this have the stiffness of none."""


class Coupling:
    """A pad whose forces can be asked for at any time between its tactile frames.

    `sense` is a tactile frame, `wrench` what acts on the pad now: ask in every step of the engine, before it integrates.
    """

    def __init__(self, touch: Touch, *, mass_kg: float, gyration_m: float = 0.01, damping: float = 0.3) -> None:
        """Takes a pad, and mass and radius of gyration of what moves on it, which the damping fits: `damping` is its ratio, where 1 does
        not swing."""
        checks = Checks()
        self._mass = checks.number("mass_kg", mass_kg, 1e-6, 1e6, "kg")
        self._gyration = checks.number("gyration_m", gyration_m, 1e-6, 1e3, "m")
        self._ratio = checks.number("damping", damping, 0.0, 10.0)
        checks.done()
        self.touch = touch
        self._probe = touch.simulator.copy()
        self.reset()

    def reset(self) -> None:
        """Begins anew: nothing has touched the pad yet."""
        numpy = need("numpy")
        self.touch.reset()
        self.stiffness: NDArray[np.float64] = numpy.zeros((6, 6))
        """(6, 6): how force (N) and torque (N m) on the pad grow with motion (m) and turn (rad) of the object, in the pad's frame."""
        self._damping: NDArray[np.float64] = numpy.zeros((6, 6))
        self.longest_step_s = math.inf
        """The engine's step may be as long, or the object is thrown about."""
        self._has_warned = False
        self._measured_n = 0.0
        self._felt: NDArray[np.float64] = numpy.zeros(6)
        self._place: Optional[Transform] = None
        self._moved: Optional[NDArray[np.float64]] = None
        self._sensed_s = self._asked_s = -math.inf

    def sense(self, pad: Transform, objects: Mapping[Any, Transform], time_s: float) -> Impression:
        """A tactile frame: `Touch.step` at this time of the engine's. A time before the last frame's begins anew."""
        if time_s < self._sensed_s:
            self.reset()
        since_s = time_s - self._sensed_s
        press = self.touch.step(pad, objects, duration_s=min(max(since_s, 1e-6), LONGEST_S))
        self._sensed_s = time_s
        self._felt = press.wrench * NEWTONMETRES
        place = None if self.touch.touched is None else pad.inverse() @ objects[self.touch.touched]
        if self._moved is None or self._place is None or place is None:
            self._moved = None
        else:
            # Motion counts from this frame on.
            self._moved = self._moved - motion(self._place, place)
        self._place = place
        normal_n = -self._felt[2]
        if abs(normal_n - self._measured_n) > CHANGED * max(normal_n, LEAST_N):
            self._measure(normal_n)
        return press

    def wrench(self, pad: Transform, objects: Mapping[Any, Transform], time_s: float) -> Wrench:
        """Force and torque of the object on the pad at this time, in the world, about the pad's origin.

        Where contact begins, or has become deeper or shallower by more than a straight line can tell, it takes a tactile frame.
        A time before the last frame's begins anew. UsageError for places that are not finite."""
        numpy = need("numpy")
        if time_s < self._sensed_s:
            self.reset()
        if self._place is None:
            is_new = max(self.touch.depths(pad, objects).values(), default=0.0) > 0.0
        else:
            is_new = self.touch.touched not in objects
        if is_new:
            self.sense(pad, objects, time_s)
        if self._place is None:
            return Wrench(numpy.zeros(3), numpy.zeros(3), pad.position_m)
        check_place("the pad", pad)
        check_place(repr(self.touch.touched), objects[self.touch.touched])
        moved = motion(self._place, pad.inverse() @ objects[self.touch.touched])
        if abs(moved[2]) > max(FARTHEST_M, 1e-3 * FARTHEST * self.touch.depth_mm):
            self.sense(pad, objects, time_s)
            moved = numpy.zeros(6)
        speed, since_s = numpy.zeros(6), time_s - self._asked_s
        if self._moved is not None and since_s > 0.0:
            speed = (moved - self._moved) / since_s
            if since_s > self.longest_step_s and not self._has_warned:
                said = f"steps of {1e3 * since_s:.2g} ms are too long for {self._mass:.2g} kg on this pad"
                warnings.warn(f"{said}; take {1e3 * self.longest_step_s:.2g} ms", stacklevel=3)
                self._has_warned = True
        self._moved, self._asked_s = moved, time_s
        force = self._felt + self.stiffness @ moved + self._damping @ speed
        normal_n = -force[2]
        if normal_n <= 0.0:
            force[:] = 0.0
        elif self.touch.friction is not None:
            force[:2] *= min(1.0, self.touch.friction * normal_n / max(float(numpy.hypot(*force[:2])), 1e-12))
        return Wrench(pad.rotation @ force[:3], pad.rotation @ force[3:], pad.position_m)

    def _measure(self, normal_n: float) -> None:
        """Measures the stiffness where the object is, of a contact that sticks."""
        numpy = need("numpy")
        self._measured_n = normal_n
        self.stiffness, self._damping = numpy.zeros((6, 6)), numpy.zeros((6, 6))
        if normal_n < LEAST_N:
            return
        self._probe.reset(friction=None)
        rest = self.touch.pressed(self._probe)
        steps = numpy.diag([MOVED_M, MOVED_M, -MOVED_M, TURNED_RAD, TURNED_RAD, TURNED_RAD])
        for column, step in enumerate(steps):
            if self.touch.is_through(turned(step)):
                step = -step
            grown = self.touch.pressed(self._probe, turned(step)) - rest
            self.stiffness[:, column] = grown * NEWTONMETRES / step[column]
        # Modes of the object on this pad: none gains energy, and each is damped by the same ratio.
        root = numpy.linalg.cholesky(self._inertia())
        inverse = numpy.linalg.inv(root)
        values, modes = numpy.linalg.eigh(inverse @ (0.5 * (self.stiffness + self.stiffness.T)) @ inverse.T)
        swing = numpy.sqrt(numpy.maximum(values, 0.0))
        modes = root @ modes
        self.stiffness = (modes * swing**2) @ modes.T
        self._damping = (modes * (2.0 * self._ratio * swing)) @ modes.T
        self.longest_step_s = SAFE / float(swing.max(initial=1e-9))

    def _inertia(self) -> NDArray[np.float64]:
        """(6, 6): of the object about the pad's origin."""
        numpy = need("numpy")
        x, y, z = self.touch.middle_m
        cross = numpy.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        turning = self._gyration**2 * numpy.eye(3) + cross.T @ cross
        found: NDArray[np.float64] = self._mass * numpy.block([[numpy.eye(3), cross.T], [cross, turning]])
        return found


def motion(start: Transform, end: Transform) -> NDArray[np.float64]:
    """How an object moved: shift of its point at the origin (m), and small turn (rad)."""
    numpy = need("numpy")
    moved = end @ start.inverse()
    x, y, z, w = moved.xyzw
    found: NDArray[np.float64] = numpy.concatenate([moved.position_m, 2.0 * math.copysign(1.0, w) * numpy.array([x, y, z])])
    return found


def turned(step: NDArray[np.float64]) -> Transform:
    """A small motion as a transform."""
    return Transform.of(step[:3], xyzw=[*(0.5 * step[3:]), 1.0])
