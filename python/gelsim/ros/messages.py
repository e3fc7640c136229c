"""What messages of ROS say, as arrays in millimetres. They are read by their fields: any object that has these will do."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple, Optional

from gelsim.needed import need
from gelsim.scene import Placement

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

MOST_PX = 8192
"""Of a side of a frame."""

DEPTHS = {"32FC1": ("f4", 1000.0), "16UC1": ("u2", 1.0), "mono16": ("u2", 1.0)}
"""By encoding: what a pixel is, and how many mm its unit has (REP 118)."""


class Refused(ValueError):
    """A message that cannot be right. The text says why, and what would be right."""


class Pinhole(NamedTuple):
    """A camera without distortion. The centre of the first pixel is at (0, 0)."""

    size_px: tuple[int, int]
    """Width and height of its images."""
    focal_px: tuple[float, float]
    """Across and down."""
    middle_px: tuple[float, float]
    """Where its axis is."""

    @classmethod
    def of_angle(cls, fov_y_deg: float, size_px: tuple[int, int]) -> Pinhole:
        """With square pixels and the axis in the middle, from the angle between the upper edge and the lower one."""
        width, height = size_px
        focal = height / 2 / math.tan(math.radians(fov_y_deg) / 2)
        return cls(size_px, (focal, focal), ((width - 1) / 2, (height - 1) / 2))

    @property
    def fov_y_deg(self) -> float:
        """The angle that `of_angle` takes. Refused if pixels are not square or the axis is not in the middle."""
        (across, down), (width, height) = self.focal_px, self.size_px
        if abs(across / down - 1) > 1e-3 or self.middle_px != ((width - 1) / 2, (height - 1) / 2):
            raise Refused("CameraInfo: inside a curved gel, pixels must be square and the principal point in the middle")
        return math.degrees(2 * math.atan(height / 2 / down))


def depth_mm(message: Any) -> NDArray[np.float32]:
    """The distances of a depth image, mm, (H, W); inf where nothing is: where the message has inf or nan, or 0 in `16UC1`.

    Refused are other encodings, sizes that do not fit each other, minus infinity (Gazebo's for what is before the near plane) and
    distances of 0 and below.
    """
    numpy = need("numpy")
    width, height, step = int(message.width), int(message.height), int(message.step)
    if message.encoding not in DEPTHS:
        raise Refused(f"depth has the encoding {str(message.encoding)[:20]!r}; publish 32FC1 (metres) or 16UC1 (mm)")
    pixel, mm = DEPTHS[message.encoding]
    kind = numpy.dtype((">" if message.is_bigendian else "<") + pixel)
    if not (0 < width <= MOST_PX and 0 < height <= MOST_PX):
        raise Refused(f"depth has {width}x{height} px; a side has 1 to {MOST_PX}")
    if step < width * kind.itemsize:
        raise Refused(f"depth has a step of {step} bytes, and a row of {width} px in {message.encoding} {width * kind.itemsize}")
    data = numpy.frombuffer(message.data, numpy.uint8)
    if data.size != step * height:
        raise Refused(f"depth has {data.size} bytes of data, and {height} rows of {step} bytes are {step * height}")
    rows = data.reshape(height, step)[:, : width * kind.itemsize]
    found: NDArray[np.float32] = numpy.ascontiguousarray(rows).view(kind).astype(numpy.float32)
    found *= numpy.float32(mm)
    nothing = found == 0 if pixel == "u2" else numpy.isnan(found)
    found[nothing] = numpy.inf
    nearest = found.min()
    if nearest <= 0:
        raise Refused(
            "depth is minus infinity somewhere: something is before the camera's near plane; make that nearer"
            if nearest == -numpy.inf
            else "depth is 0 or less somewhere; publish distances along the camera's axis, and inf where nothing is"
        )
    return found


def pinhole(message: Any) -> Pinhole:
    """The camera of a CameraInfo. A principal point within a pixel of the middle is in the middle: simulators disagree about half a
    pixel, and their cameras are symmetric.
    """
    matrix = [float(number) for number in getattr(message, "K", getattr(message, "k", ()))]
    if len(matrix) != 9 or not all(map(math.isfinite, matrix)) or matrix[0] <= 0 or matrix[4] <= 0:
        raise Refused("CameraInfo has no focal lengths in K: the camera is not calibrated; or give fov_y_deg")
    if any(getattr(message, "D", getattr(message, "d", ()))):
        raise Refused("CameraInfo has distortion; take the rectified depth image, with a CameraInfo without")
    size = int(message.width), int(message.height)
    middle = [near if abs(near - at) <= 1 else at for near, at in zip([(side - 1) / 2 for side in size], matrix[2:6:3])]
    return Pinhole(size, (matrix[0], matrix[4]), (middle[0], middle[1]))


def placement(message: Any, frame_id: str) -> Placement:
    """Where a PoseStamped says the object is, if it speaks of the frame `frame_id`, or of any if that is empty."""
    said = message.header.frame_id.lstrip("/")
    if frame_id and said and said != frame_id.lstrip("/"):
        raise Refused(f"the pose is in the frame {said[:60]!r}, not in {frame_id!r}: transform it, as with tf2")
    at, turn = message.pose.position, message.pose.orientation
    return Placement((1e3 * at.x, 1e3 * at.y, 1e3 * at.z), (turn.x, turn.y, turn.z, turn.w))


def stamp_s(message: Any) -> float:
    """The header's time."""
    stamp = message.header.stamp
    seconds, rest = (stamp.secs, stamp.nsecs) if hasattr(stamp, "secs") else (stamp.sec, stamp.nanosec)
    return float(seconds) + 1e-9 * float(rest)


def is_same_size(camera: Pinhole, frame: NDArray[np.float32]) -> Optional[str]:
    """What does not fit, if the camera's images are not of the frame's size."""
    height, width = frame.shape
    (columns, rows) = camera.size_px
    return None if (columns, rows) == (width, height) else f"CameraInfo is of {columns}x{rows} px, and depth has {width}x{height}"
