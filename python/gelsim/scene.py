"""What a press is made of beside the object: where it is, its texture, how it is pushed; and the sensor's LEDs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import MISSING, asdict, dataclass, fields
from typing import Any, Literal, Optional

from gelsim.checks import Checks, honest, items, kind

FACES = ("-z", "+z", "-x", "+x", "-y", "+y")
ANCHORS = ("bounds", "origin", "contact")
PATTERNS = ("noise", "brushed", "knurled", "woven", "dimples")

FAR_MM = 1e4
"""Nothing is pressed from further away."""
TURNS_DEG = 3600.0


@dataclass(frozen=True)
class Pose:
    """Where a mesh is, as a job's `[pose]` says it: turned, placed by a point of its own, and pressed in by a depth.

    The frame is the sensor's: x to the right in the image, y down, z out of the pad towards the object; its origin is the middle
    of the image on the untouched pad. `gelsim.Pose(0.5)` presses the mesh's side -z in by half a millimetre, in the middle.
    """

    depth_mm: float
    """How deep the mesh's lowest point reaches below the untouched pad; negative: how far it is above it."""
    x_mm: float = 0.0
    """Where its anchor is, to the right."""
    y_mm: float = 0.0
    """Where its anchor is, down."""
    yaw_deg: float = 0.0
    """Turn about z, from x towards y: clockwise in the image."""
    tilt_deg: float = 0.0
    """Then a turn about an axis in the pad's plane."""
    tilt_azimuth_deg: float = 0.0
    """Direction of that axis, from x towards y."""
    face: Literal["-z", "+z", "-x", "+x", "-y", "+y"] = "-z"
    """The mesh's side that faces the pad, in its own axes; it is turned there before anything else."""
    anchor: Literal["bounds", "origin", "contact"] = "bounds"
    """The point that x_mm and y_mm place: the middle of the bounding box, the mesh's origin, or the lowest point."""

    def __post_init__(self) -> None:
        checks = Checks("Pose: ")
        keep(
            self,
            depth_mm=checks.number("depth_mm", self.depth_mm, -FAR_MM, FAR_MM, "mm"),
            x_mm=checks.number("x_mm", self.x_mm, -FAR_MM, FAR_MM, "mm"),
            y_mm=checks.number("y_mm", self.y_mm, -FAR_MM, FAR_MM, "mm"),
            yaw_deg=checks.number("yaw_deg", self.yaw_deg, -TURNS_DEG, TURNS_DEG, "degrees"),
            tilt_deg=checks.number("tilt_deg", self.tilt_deg, -90.0, 90.0, "degrees"),
            tilt_azimuth_deg=checks.number("tilt_azimuth_deg", self.tilt_azimuth_deg, -TURNS_DEG, TURNS_DEG, "degrees"),
            face=checks.choice("face", self.face, FACES),
            anchor=checks.choice("anchor", self.anchor, ANCHORS),
        )
        checks.done()


@dataclass(frozen=True)
class Placement:
    """Where an object is, as a physics engine says it: a point q of the mesh (mm) is at R q + t in the sensor's frame.

    That frame has x to the right in the image, y down, z out of the pad; its origin is the middle of the image on the untouched
    pad. What reaches below z = 0 is in a flat pad; on a gel that has a shape the object may be anywhere around it. Labels have `pose`
    in the same numbers.
    """

    translation_mm: tuple[float, float, float]
    """t, mm."""
    quaternion_xyzw: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)
    """R, of any length but 0. MuJoCo and others write w first: put it last."""

    def __post_init__(self) -> None:
        checks = Checks("Placement: ")
        keep(
            self,
            translation_mm=checks.numbers("translation_mm", self.translation_mm, 3, -1e7, 1e7, "mm"),
            quaternion_xyzw=checks.numbers("quaternion_xyzw", self.quaternion_xyzw, 4, -1e9, 1e9),
        )
        if not checks.wrong and sum(part * part for part in self.quaternion_xyzw) < 1e-12:
            checks.wrong.append("Placement: quaternion_xyzw has no length; (0, 0, 0, 1) turns nothing")
        checks.done()


@dataclass(frozen=True)
class Texture:
    """A fine relief that is cut into the object."""

    pattern: Literal["noise", "brushed", "knurled", "woven", "dimples"]
    """Cast metal, brushed metal, a knurled grip, a plain weave, or spherical dents."""
    amplitude_mm: float = 0.03
    """How far valleys lie below peaks."""
    scale_mm: float = 0.5
    """Size of the largest bumps, or distance between lines, grooves, yarns or dents."""
    angle_deg: float = 0.0
    """Turn on the object about z, from x towards y."""
    offset: tuple[float, float] = (0.0, 0.0)
    """The point of the pattern that lies on the object's origin, 0 to 1 along each side."""

    def __post_init__(self) -> None:
        checks = Checks("Texture: ")
        keep(
            self,
            pattern=checks.choice("pattern", self.pattern, PATTERNS),
            amplitude_mm=checks.number("amplitude_mm", self.amplitude_mm, 0.0, 10.0, "mm"),
            scale_mm=checks.number("scale_mm", self.scale_mm, 1e-3, 1e3, "mm"),
            angle_deg=checks.number("angle_deg", self.angle_deg, -TURNS_DEG, TURNS_DEG, "degrees"),
            offset=checks.numbers("offset", self.offset, 2, 0.0, 1.0),
        )
        checks.done()


@dataclass(frozen=True)
class Shear:
    """How the object moves in the pad's plane after it was pressed in. Markers and the layer `flow` show it."""

    x_mm: float = 0.0
    """To the right in the image."""
    y_mm: float = 0.0
    """Down in the image."""
    twist_deg: float = 0.0
    """About the point that the pose places, from x towards y."""

    def __post_init__(self) -> None:
        checks = Checks("Shear: ")
        keep(
            self,
            x_mm=checks.number("x_mm", self.x_mm, -10.0, 10.0, "mm"),
            y_mm=checks.number("y_mm", self.y_mm, -10.0, 10.0, "mm"),
            twist_deg=checks.number("twist_deg", self.twist_deg, -45.0, 45.0, "degrees"),
        )
        checks.done()


@dataclass(frozen=True)
class LightPattern:
    """How the light of an LED varies over a flat pad: factors on its red, green and blue.

    Each is a polynomial of the place: coefficients of 1, x, y, x^2, x y and y^2, with x and y from -1 to 1 over the image. One, three
    or six of them are given.
    """

    red: tuple[float, ...] = (1.0,)
    green: tuple[float, ...] = (1.0,)
    blue: tuple[float, ...] = (1.0,)

    def __post_init__(self) -> None:
        checks = Checks("LightPattern: ")
        for name in ("red", "green", "blue"):
            terms = items(f"LightPattern: {name}", getattr(self, name), "1, 3 or 6 numbers")
            if len(terms) not in (1, 3, 6):
                raise TypeError(f"LightPattern: {name} has {len(terms)} items; give 1, 3 or 6 numbers")
            keep(self, **{name: checks.numbers(name, terms, len(terms), -100.0, 100.0)})
        checks.done()


@dataclass(frozen=True)
class Led:
    """An LED of a sensor, as `[[sensor.led]]` of a sensor file says it.

    ```python
    sensor = gelsim.Sensor.preset("digit")
    amber = gelsim.Led(azimuth_deg=45.0, color=(1.0, 0.6, 0.0), intensity=3.0)
    sensor = sensor.with_leds([*sensor.leds, amber])
    ```
    """

    azimuth_deg: float
    """Direction towards the LED in the image's plane, from +x (right) towards +y (down)."""
    color: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Red, green and blue share of the light, 0 to 1."""
    intensity: float = 1.0
    """Brightness that a surface facing the LED gains, before the model of the light weighs it: compare `sensor.leds`."""
    elevation_deg: float = 8.530_765_609_948_133
    """Angle of the LED over the pad's plane, 0 to 90."""
    angular_size_deg: tuple[float, float] = (40.0, 10.0)
    """Angles under which the pad sees it: width along the pad, height over it. They say how soft shadows are."""
    distance_mm: float = 20.0
    """Distance from the middle of the image; for the optics model `led`."""
    position_mm: Optional[tuple[float, float, float]] = None
    """Where it is, in the sensor's frame, in place of azimuth, elevation and distance. On a flat pad z is below 0."""
    size_mm: Optional[tuple[float, float]] = None
    """Width along the pad and height, for the optics model `led`; from `angular_size_deg` if left out."""
    lobe: float = 0.0
    """Exponent of the cosine about the direction to the middle of the image; for the optics model `led`."""
    name: str = "led"
    """What messages call it."""
    pattern: Optional[LightPattern] = None
    """How its light varies over a flat pad; alike everywhere if left out."""

    def __post_init__(self) -> None:
        checks = Checks("Led: ")
        position, size = self.position_mm, self.size_mm
        keep(
            self,
            azimuth_deg=checks.number("azimuth_deg", self.azimuth_deg, -TURNS_DEG, TURNS_DEG, "degrees"),
            color=checks.numbers("color", self.color, 3, 0.0, 1.0),
            intensity=checks.number("intensity", self.intensity, 0.0, 100.0),
            elevation_deg=checks.number("elevation_deg", self.elevation_deg, 0.0, 90.0, "degrees"),
            angular_size_deg=checks.numbers("angular_size_deg", self.angular_size_deg, 2, 0.0, 90.0, "degrees"),
            distance_mm=checks.number("distance_mm", self.distance_mm, 1e-2, 1e6, "mm"),
            position_mm=None if position is None else checks.numbers("position_mm", position, 3, -1e6, 1e6, "mm"),
            size_mm=None if size is None else checks.numbers("size_mm", size, 2, 0.0, 1e3, "mm"),
            lobe=checks.number("lobe", self.lobe, 0.0, 100.0),
        )
        honest("Led: name", self.name)
        if not isinstance(self.name, str):
            raise TypeError(f"Led: name is {kind(self.name)}; give a text")
        honest("Led: pattern", self.pattern)
        if not (self.pattern is None or isinstance(self.pattern, LightPattern)):
            raise TypeError(f"Led: pattern is {kind(self.pattern)}; give gelsim.LightPattern(red=(1.0, 0.2, -0.1))")
        checks.done()

    @classmethod
    def _of_json(cls, table: dict[str, Any]) -> Led:
        values: dict[str, Any] = {name: tuple(value) if isinstance(value, list) else value for name, value in table.items()}
        if values.get("pattern") is not None:
            values["pattern"] = LightPattern(**values["pattern"])
        return cls(**values)


DEFAULTS_OF_LED: dict[str, Any] = {field.name: field.default for field in fields(Led) if field.default is not MISSING}


def led_tables(leds: Sequence[Led]) -> list[dict[str, Any]]:
    """LEDs as tables of a sensor file."""
    tables = []
    for led in items("leds", leds, "a list of gelsim.Led"):
        if not isinstance(led, Led):
            raise TypeError(f"an item of leds is {kind(led)}; give gelsim.Led(azimuth_deg=45.0)")
        # What is left at its default is no wish, of which a note might say that it has no effect.
        tables.append({name: value for name, value in asdict(led).items() if value != DEFAULTS_OF_LED.get(name)})
    return tables


def keep(owner: object, **values: object) -> None:
    """Puts checked values into a frozen dataclass."""
    for name, value in values.items():
        object.__setattr__(owner, name, value)
