"""Touch as an observation of a Gymnasium environment."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from gelsim._native import UsageError
from gelsim.checks import items
from gelsim.needed import need
from gelsim.simulator import Impression, Simulator

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["observation", "observation_space"]

SLIP = ("none", "incipient", "gross")
"""What 0, 1 and 2 of `slip` are."""
PARTS = ("image", "wrench", "slip", "markers", "depth", "contact")
"""What an observation may have."""
DEFAULT = ("image", "wrench", "slip")


def observation_space(simulator: Simulator, parts: Sequence[str] = DEFAULT) -> Any:
    """The space of what a pad of this simulator says, a `gymnasium.spaces.Dict` of these parts:

    - `image`: uint8 (H, W, 3), the tactile image
    - `wrench`: float32 (6,), force (N) and torque (N mm) of the object on the pad, in the pad's frame
    - `slip`: 0 none, 1 incipient, 2 gross
    - `markers`: float32 (N, 2), how far each dot that is in view on the untouched pad has moved to the right and down, px
    - `depth`: float32 (H, W), how far the object reaches below the untouched pad, mm
    - `contact`: uint8 (H, W), 255 where the pad touches the object

    UsageError for another part, or markers of a sensor that has none.
    """
    spaces, numpy = need("gymnasium").spaces, need("numpy")
    width, height = simulator.resolution_px
    thickness = simulator.gelpad_thickness_mm

    def box(low: float, high: float, shape: tuple[int, ...], kind: str) -> Any:
        return spaces.Box(low, high, shape, getattr(numpy, kind))

    made: dict[str, Any] = {}
    for part in items("parts", parts, "a list of " + ", ".join(PARTS)):
        if part == "image":
            made[part] = box(0, 255, (height, width, 3), "uint8")
        elif part == "wrench":
            made[part] = box(-numpy.inf, numpy.inf, (6,), "float32")
        elif part == "slip":
            made[part] = spaces.Discrete(len(SLIP))
        elif part == "markers":
            printed = simulator.press(numpy.zeros((height, width), numpy.float32)).markers
            if printed is None:
                raise UsageError('this sensor has no markers; gelsim.Simulator(..., set={"markers.pitch_mm": 1.5}) prints some')
            made[part] = box(-numpy.inf, numpy.inf, printed["rest_px"].shape, "float32")
        elif part == "depth":
            made[part] = box(0.0, thickness, (height, width), "float32")
        elif part == "contact":
            made[part] = box(0, 255, (height, width), "uint8")
        else:
            raise UsageError(f"parts has {part!r}; allowed: {', '.join(map(repr, PARTS))}")
    return spaces.Dict(made)


def observation(press: Impression, space: Any) -> dict[str, Any]:
    """What a frame of `Simulator.step` says, as an item of `observation_space`."""
    return {name: part_of(press, name) for name in space.spaces}


def part_of(press: Impression, name: str) -> Any:
    """One part."""
    numpy = need("numpy")
    if name == "wrench":
        return press.wrench.astype(numpy.float32)
    if name == "slip":
        return numpy.int64(SLIP.index(press.slip_state or "none"))
    if name == "markers":
        dots: Any = press.markers
        rest, size = dots["rest_px"], press.image.shape[1::-1]
        # Those that have moved into view are not in the space.
        printed = ((rest >= 0.0) & (rest <= size)).all(axis=1)
        moved: NDArray[Any] = (dots["moved_px"] - rest)[printed].astype(numpy.float32)
        return moved
    return getattr(press, name)
