"""A sensor at work: a depth frame or a pose in, what is felt out."""

from __future__ import annotations

import math
import os
from typing import TYPE_CHECKING, Any, NamedTuple, Optional

from gelsim import vectors
from gelsim._native import Sensor, UsageError
from gelsim.mesh import Mesh
from gelsim.needed import need
from gelsim.ros.messages import Pinhole, Refused, is_same_size
from gelsim.ros.parameters import Parameters
from gelsim.scene import Placement
from gelsim.simulator import Simulator

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

MARKER_FIELDS = ("x", "y", "z", "u", "v", "rest_u", "rest_v")
"""Columns of `Felt.markers`."""

LONGEST_STEP_S = 1e6
"""No two frames of a sequence are farther apart."""

LOOKS = 5
"""How often a pixel of the pad looks where it is seen. Each look brings it nearer by the surface's slope times that of the ray."""


class Felt(NamedTuple):
    """What the sensor feels. Wrench and markers are in its frame: x to the right in the image, y down, z towards the object."""

    image: NDArray[np.uint8]
    """(H, W, 3): red, green, blue."""
    force_n: list[float]
    """Force of the object on the pad, N; nan is not known."""
    torque_nm: list[float]
    """Torque about the origin of the frame, N m; nan is not known."""
    slip: Optional[str]
    """`none`, `incipient` or `gross`; None unless the object is followed from pose to pose."""
    markers: Optional[NDArray[np.float32]]
    """(N, 7): `MARKER_FIELDS` of each printed dot or pin: where it is, m, where it is seen, px, and where if nothing touched the pad."""


class Touch:
    """A sensor that feels depth frames, or an object that moves."""

    def __init__(self, its: Parameters) -> None:
        """Makes the sensor ready, with a first image, so that the next ones take no longer than they will. UsageError with mistakes."""
        self.parameters, self._numpy = its, need("numpy")
        self._sensor = changed(its)
        self.is_flat = self._sensor.is_flat
        self.takes_poses = bool(its.mesh)
        self._frames = 0
        self._stamp_s: Optional[float] = None
        self._feel_nothing([])
        self._dots = next((name for name in ("pins", "markers") if self._has(name)), None)
        if self.takes_poses:
            self._mesh = Mesh.load(its.mesh, mm_per_unit=its.mm_per_unit or None)
            self._simulator = Simulator(self._sensor, its.fidelity, resolution_px=its.resolution_px)
            self.feel_pose(Placement((0.0, 0.0, 1e6)), 0.0)
            self._frames = 0
            self.begin()
        elif self.is_flat and its.plane_mm == 0.0:
            raise UsageError("plane_mm is missing: give the distance from the depth camera to the untouched pad; or a mesh, for poses")
        elif not self.is_flat and its.plane_mm > 0.0:
            raise UsageError(f"leave plane_mm out: the gel of {self._sensor.name} is curved, and its depth camera is at the lens")
        elif its.resolution_px is not None and not (self.is_flat and its.projection == "perspective"):
            raise UsageError("leave resolution out: the image has the frame's size, or on a curved gel the sensor's own")

    @property
    def has_markers(self) -> bool:
        """True if the sensor has printed dots or pins."""
        return self._dots is not None

    @property
    def follows(self) -> bool:
        """True if it follows an object from pose to pose, and so knows of slip."""
        return self.takes_poses and not self.parameters.single

    def begin(self) -> None:
        """Begins another sequence: of a pad that nothing has touched."""
        self._stamp_s = None
        if self.follows:
            self._simulator.reset(friction=self.parameters.friction, seed=self.parameters.seed)

    def feel_frame(self, distance_mm: NDArray[np.float32], camera: Optional[Pinhole]) -> Felt:
        """What a depth frame (H, W) shows, of a camera with parallel rays or of a pinhole.

        On a flat pad, z of the force is the normal force of what is in view, nan if the contact is cut off by the frame; friction is
        not known to a frame, and nothing of it is in x and y. Torques are not known.
        """
        its, numpy = self.parameters, self._numpy
        rays: dict[str, Any] = {}
        if camera is not None:
            if wrong := is_same_size(camera, distance_mm):
                raise Refused(wrong)
            if not self.is_flat:
                rays = {"fov_y_deg": camera.fov_y_deg}
            else:
                distance_mm = self._seen_from_below(distance_mm, camera)
        below = numpy.float32(its.plane_mm) - distance_mm if self.is_flat else distance_mm
        layers = [] if self._dots is None else [self._dots, "points"]
        sample = self._sensor.render(below, fidelity=its.fidelity, layers=layers, index=self._frames, seed=its.seed, **rays)
        self._frames += 1
        wrench, contact = vectors.wrench(sample["label"]), sample["label"]["contact"]
        if math.isnan(wrench[2]) and contact["force_n"] is not None:
            wrench[2] = 0.0 - contact["force_n"]
        return self._felt(sample["tactile"], wrench, None, sample)

    def feel_pose(self, pose: Placement, stamp_s: float) -> Felt:
        """What the object presses at a pose, the next of its sequence. Time that runs back begins another one."""
        if self.parameters.single:
            press = self._simulator.press(self._mesh, pose, index=self._frames, seed=self.parameters.seed)
        else:
            if self._stamp_s is not None and stamp_s < self._stamp_s:
                self.begin()
            since_s = 0.04 if self._stamp_s is None else min(stamp_s - self._stamp_s, LONGEST_STEP_S)
            press = self._simulator.step(self._mesh, pose, duration_s=since_s)
            self._stamp_s = stamp_s
        self._frames += 1
        layers = {} if self._dots is None else {self._dots: getattr(press, self._dots), "points": press.points}
        return self._felt(press.image, list(press.wrench), press.slip_state, layers)

    def _felt(self, image: NDArray[np.uint8], wrench: list[float], slip: Optional[str], layers: dict[str, Any]) -> Felt:
        numpy = self._numpy
        markers = None
        if self._dots is not None:
            dots = layers[self._dots]
            at_mm = dots["moved_mm"] if "moved_mm" in dots else between(layers["points"], dots["moved_px"] - 0.5)
            markers = numpy.hstack([1e-3 * at_mm, dots["moved_px"], dots["rest_px"]]).astype(numpy.float32)
        return Felt(image, wrench[:3], [1e-3 * each for each in wrench[3:]], slip, markers)

    def _seen_from_below(self, distance_mm: NDArray[np.float32], camera: Pinhole) -> NDArray[np.float32]:
        """The distances that a camera with parallel rays would see in the same place: each pixel of the pad looks at where the pinhole
        sees it, at the distance that it found there before. What is out of the image is nothing.
        """
        numpy, plane = self._numpy, self.parameters.plane_mm
        width, height = self.parameters.resolution_px or self._sensor.resolution_px
        across, down = self._sensor.field_of_view_mm
        x = ((numpy.arange(width, dtype=numpy.float32) + 0.5) / width - 0.5) * across
        y = ((numpy.arange(height, dtype=numpy.float32)[:, None] + 0.5) / height - 0.5) * down
        thickness = self._sensor.gelpad_thickness_mm
        at = numpy.full((height, width), plane, numpy.float32)
        at_px = numpy.empty((height, width, 2), numpy.float32)
        for _ in range(LOOKS):
            # Beyond this the pad ends, or nothing touches it; and there is no distance to what is not there.
            numpy.clip(at, max(plane - thickness, 1e-3), plane + thickness, out=at)
            at_px[..., 0] = camera.middle_px[0] + camera.focal_px[0] * x / at
            at_px[..., 1] = camera.middle_px[1] + camera.focal_px[1] * y / at
            at = between(distance_mm, at_px)
        inside = numpy.abs(2 * at_px - numpy.array(camera.size_px, numpy.float32) + 1) <= numpy.array(camera.size_px)
        at[~inside.all(axis=-1)] = numpy.inf
        found: NDArray[np.float32] = at
        return found

    def _has(self, layer: str) -> bool:
        try:
            self._feel_nothing([layer])
        except UsageError:
            return False
        return True

    def _feel_nothing(self, layers: list[str]) -> None:
        width, height = self._sensor.resolution_px
        frame = self._numpy.full((height, width), -self._numpy.inf if self.is_flat else self._numpy.inf, self._numpy.float32)
        rays: dict[str, Any] = {} if self.is_flat else {"along": "ray"}
        self._sensor.render(frame, fidelity=self.parameters.fidelity, layers=layers, **rays)


def changed(its: Parameters) -> Sensor:
    """The sensor, with `set`. Frames are rendered one by one, on the thread that asks."""
    is_file = its.sensor.lower().endswith(".toml") or os.sep in its.sensor
    return (Sensor.load if is_file else Sensor.preset)(its.sensor, set=its.assignments, threads=1)


def between(image: NDArray[np.float32], at_px: NDArray[Any]) -> NDArray[np.float32]:
    """Values of an image (H, W) or (H, W, C) at places (..., 2), columns and rows, where the centre of the first pixel is (0, 0):
    bilinear, and the nearest pixel's where one of the four is infinite. Beyond the border, the border's."""
    numpy = need("numpy")
    height, width = image.shape[:2]
    column, row = (numpy.clip(at_px[..., axis], 0, side - 1) for axis, side in enumerate((width, height)))
    left, top = (numpy.minimum(at.astype(numpy.intp), max(side - 2, 0)) for at, side in ((column, width), (row, height)))
    right, bottom = numpy.minimum(left + 1, width - 1), numpy.minimum(top + 1, height - 1)
    more = (slice(None),) * (at_px.ndim - 1) + (None,) * (image.ndim - 2)
    over, under = ((at - first).astype(numpy.float32)[more] for at, first in ((column, left), (row, top)))
    flat = image.reshape(height * width, *image.shape[2:])
    corner = [[flat[line * width + side] for side in (left, right)] for line in (top, bottom)]
    with numpy.errstate(invalid="ignore"):
        upper, lower = (first + over * (second - first) for first, second in corner)
        found = upper + under * (lower - upper)
    nearest = flat[numpy.rint(row).astype(numpy.intp) * width + numpy.rint(column).astype(numpy.intp)]
    mixed: NDArray[np.float32] = numpy.where(numpy.isfinite(found), found, nearest)
    return mixed
