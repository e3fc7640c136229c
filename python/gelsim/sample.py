"""What a sample holds, for type checkers: samples are plain dicts."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypedDict

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


class Markers(TypedDict):
    """Dots in view, px; the first pixel's centre is at (0.5, 0.5)."""

    rest_px: NDArray[np.float64]
    """(N, 2): where each was printed."""
    moved_px: NDArray[np.float64]
    """(N, 2): where the pad carried it."""


class Pins(Markers):
    """Tips of pins in view."""

    rest_mm: NDArray[np.float64]
    """(N, 3): where each is on the untouched gel, in the sensor's frame."""
    moved_mm: NDArray[np.float64]
    """(N, 3): where the skin carried it."""


class Sample(TypedDict, total=False):
    """`tactile`, `label` and the layers that were asked for; axes, signs and units are in docs/reference/conventions.md."""

    tactile: NDArray[np.uint8]
    """(H, W, 3): red, green, blue."""
    depth: NDArray[np.float32]
    """(H, W): how far the object reaches below the undeformed pad, mm."""
    surface: NDArray[np.float32]
    """(H, W): displacement of the pad's surface, mm, positive towards the camera."""
    contact: NDArray[np.uint8]
    """(H, W): 255 where the pad touches."""
    normal: NDArray[np.float32]
    """(H, W, 3): unit normals X, Y, Z of the pad's surface, towards the camera."""
    pressure: NDArray[np.float32]
    """(H, W): pressure between pad and object, kPa."""
    gap: NDArray[np.float32]
    """(H, W): clearance between the pad's surface and the object, mm; -1 where no object is within reach."""
    markers: Markers
    pins: Pins
    reference: NDArray[np.uint8]
    """(H, W, 3): the image without contact."""
    lamps: NDArray[np.float32]
    """(H, W, 6): the grey image under each lamp, 0 to 1; of sensors whose lamps were measured one by one."""
    instance: NDArray[np.uint8]
    """(H, W): the number of the object that the pad touches, counted from 1 in the label's `objects`; 0 elsewhere."""
    slip: NDArray[np.uint8]
    """(H, W): 128 where the pad sticks to the object, 255 where it slips, 0 elsewhere; of sequences."""
    flow: NDArray[np.float32]
    """(H, W, 2): motion of the pad's surface to the right and down since it was untouched, mm."""
    traction: NDArray[np.float32]
    """(H, W, 3): force of the object on the pad by area, kPa: to the right, down, into the pad."""
    points: NDArray[np.float32]
    """(H, W, 3): the point of the pad's surface that each pixel shows, mm in the sensor's frame."""
    untouched: NDArray[np.uint8]
    """(H, W, 3): the image without contact by the sample's own camera at another moment, with noise of its own."""
    frames: list[Sample]
    """Of a sequence: its frames, each with `tactile` and the layers; the sequence itself has `frames` and `label` only."""
    left: Sample
    """Of a grip, or of a frame of a sequence of one: what the left finger feels, `tactile` and the layers; the grip itself has
    `left`, `right` and `label` only."""
    right: Sample
    """Of a grip: what the right finger feels."""
    label: dict[str, Any]
    """The label's JSON; `gelsim schema label` prints its schema."""
    key: str
    """Name of its files, of samples that are loaded: nine digits of its index."""


class Batch(TypedDict, total=False):
    """Several samples of `Sensor.render`: arrays have them as their first axis, labels, markers and pins are lists."""

    tactile: NDArray[np.uint8]
    depth: NDArray[np.float32]
    surface: NDArray[np.float32]
    contact: NDArray[np.uint8]
    normal: NDArray[np.float32]
    pressure: NDArray[np.float32]
    gap: NDArray[np.float32]
    markers: list[Markers]
    pins: list[Pins]
    reference: NDArray[np.uint8]
    lamps: NDArray[np.float32]
    instance: NDArray[np.uint8]
    flow: NDArray[np.float32]
    traction: NDArray[np.float32]
    points: NDArray[np.float32]
    untouched: NDArray[np.uint8]
    label: list[dict[str, Any]]
