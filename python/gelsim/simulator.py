"""Presses of meshes and height maps, one by one or frame after frame."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from os import PathLike
from typing import TYPE_CHECKING, Any, NamedTuple, Optional, Union, cast

from gelsim import vectors
from gelsim._native import Engine, Pressing, Sensor, UsageError, step_all
from gelsim.checks import Checks, honest, items, kind
from gelsim.lazy import lazy
from gelsim.mesh import HasMesh, Mesh
from gelsim.needed import need
from gelsim.scene import Placement, Pose, Shear, Texture

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray

    from gelsim.sample import Markers, Pins, Sample

Indenter = Union[
    Mesh, str, "PathLike[str]", "tuple[ArrayLike, ArrayLike]", HasMesh, "NDArray[np.float32]", "NDArray[np.float64]"
]
"""What is pressed; `Simulator.press` says what each is."""

LAYERS = (
    "depth", "surface", "contact", "normal", "pressure", "gap", "markers", "pins", "reference", "lamps", "slip", "flow", "traction",
    "points", "instance", "untouched",
)  # fmt: skip
"""The layers of an impression beside its image."""


class Effect(NamedTuple):
    """What became of an effect of a press."""

    ran: bool
    """True if it was computed."""
    reason: str
    """Why, or why not."""


class Impression:
    """What a press gives: the tactile image, and what is known beneath it.

    Every array has the image's height H and width W, and shows what the camera sees at each pixel. A layer is computed when it is
    first read, and is None where the sensor or the fidelity level has none. It can be pickled, with all layers.
    """

    def __init__(self, pressing: Pressing) -> None:
        self._pressing: Optional[Pressing] = pressing
        self.frame: Optional[int] = pressing.frame
        """Number of the frame in its sequence, from 0; None of a single press."""

    @lazy
    def image(self) -> NDArray[np.uint8]:
        """(H, W, 3): the tactile image, red, green, blue. Datasets call it `tactile`."""
        found: NDArray[np.uint8] = self._source.image()
        return found

    @lazy
    def depth(self) -> NDArray[np.float32]:
        """(H, W): how far the object reaches below the untouched pad, mm; 0 where it does not."""
        found: NDArray[np.float32] = self._source.layer("depth")
        return found

    @lazy
    def surface(self) -> NDArray[np.float32]:
        """(H, W): displacement of the pad's surface, mm, positive into the pad, towards the camera."""
        found: NDArray[np.float32] = self._source.layer("surface")
        return found

    @lazy
    def contact(self) -> NDArray[np.uint8]:
        """(H, W): 255 where the pad touches the object, 0 elsewhere."""
        found: NDArray[np.uint8] = self._source.layer("contact")
        return found

    @lazy
    def normal(self) -> NDArray[np.float32]:
        """(H, W, 3): unit normals x, y, z of the pad's surface, towards the camera: (0, 0, -1) where it is flat."""
        found: NDArray[np.float32] = self._source.layer("normal")
        return found

    @lazy
    def gap(self) -> NDArray[np.float32]:
        """(H, W): clearance between the pad's surface and the object, mm; -1 where no object is within reach."""
        found: NDArray[np.float32] = self._source.layer("gap")
        return found

    @lazy
    def points(self) -> NDArray[np.float32]:
        """(H, W, 3): the point of the pad's surface that each pixel shows, mm in the sensor's frame."""
        found: NDArray[np.float32] = self._source.layer("points")
        return found

    @lazy
    def instance(self) -> NDArray[np.uint8]:
        """(H, W): the number of the object that the pad touches, 1 as there is one alone; 0 elsewhere."""
        found: NDArray[np.uint8] = self._source.layer("instance")
        return found

    @lazy
    def reference(self) -> NDArray[np.uint8]:
        """(H, W, 3): the image without contact."""
        found: NDArray[np.uint8] = self._source.layer("reference")
        return found

    @lazy
    def untouched(self) -> Optional[NDArray[np.uint8]]:
        """(H, W, 3): the image without contact with noise of its own; None on sensors whose pins differ from sample to sample."""
        found: Optional[NDArray[np.uint8]] = self._source.layer("untouched")
        return found

    @lazy
    def pressure(self) -> Optional[NDArray[np.float32]]:
        """(H, W): pressure between pad and object, kPa; None at `paper`, which knows none."""
        found: Optional[NDArray[np.float32]] = self._source.layer("pressure")
        return found

    @lazy
    def flow(self) -> Optional[NDArray[np.float32]]:
        """(H, W, 2): motion of the pad's surface to the right and down, mm; of sensors with markers, or with `flow=True`."""
        found: Optional[NDArray[np.float32]] = self._source.layer("flow")
        return found

    @lazy
    def traction(self) -> Optional[NDArray[np.float32]]:
        """(H, W, 3): force of the object on the pad by area, kPa: to the right, down, into the pad; None at `paper`. Friction of a
        single press is in it on sensors with markers, or with `flow=True`."""
        found: Optional[NDArray[np.float32]] = self._source.layer("traction")
        return found

    @lazy
    def markers(self) -> Optional[Markers]:
        """Where the printed dots in view were printed (`rest_px`) and are now (`moved_px`); of sensors that have some."""
        found: Optional[Markers] = self._source.layer("markers")
        return found

    @lazy
    def pins(self) -> Optional[Pins]:
        """The same of the tips of pins, with `rest_mm` and `moved_mm`; of sensors that have some, such as `tactip`."""
        found: Optional[Pins] = self._source.layer("pins")
        return found

    @lazy
    def lamps(self) -> Optional[NDArray[np.float32]]:
        """(H, W, 6): the grey image under each lamp, 0 to 1; of sensors that have lamps, such as `gelsight-series2`."""
        found: Optional[NDArray[np.float32]] = self._source.layer("lamps")
        return found

    @lazy
    def slip(self) -> Optional[NDArray[np.uint8]]:
        """(H, W): 128 where the pad sticks to the object, 255 where it slips, 0 elsewhere; of frames of a sequence."""
        found: Optional[NDArray[np.uint8]] = self._source.layer("slip")
        return found

    @lazy
    def label(self) -> dict[str, Any]:
        """What the label of a dataset says of such a press (`gelsim schema label`); of a frame with `wrench` and `slip`."""
        found: dict[str, Any] = self._source.label()
        return found

    @property
    def in_contact(self) -> bool:
        """True if the pad touches the object in view."""
        return bool(self.label["contact"]["in_contact"])

    @property
    def force_n(self) -> Optional[float]:
        """Normal force of the whole object on the pad, N; None where it is not known, as at `paper`."""
        found: Optional[float] = self.label["contact"]["total_force_n"]
        return found

    @property
    def wrench(self) -> NDArray[np.float64]:
        """(6,): force x, y, z (N) and torque x, y, z (N mm) of the object on the pad, in the sensor's frame; nan is not known."""
        found: NDArray[np.float64] = need("numpy").array(vectors.wrench(self.label), "float64")
        return found

    @property
    def pose(self) -> NDArray[np.float64]:
        """(7,): where the object was: translation x, y, z (mm) and quaternion x, y, z, w."""
        found: NDArray[np.float64] = need("numpy").array(vectors.pose(self.label), "float64")
        return found

    @property
    def slip_state(self) -> Optional[str]:
        """`none`, `incipient` or `gross`, of a frame of a sequence."""
        found = self.label.get("slip")
        return None if found is None else str(found["state"])

    @property
    def effects(self) -> dict[str, Effect]:
        """Of each effect whether it ran, and why."""
        return {name: Effect(each["ran"], each["reason"]) for name, each in self.label["effects"].items()}

    @property
    def healthy(self) -> bool:
        """False if a check found something wrong: `label["health"]["reason"]` says what."""
        return bool(self.label["health"]["healthy"])

    def sample(self, layers: Optional[Sequence[str]] = None) -> Sample:
        """The same as a dict as `Job` and `load` give it, for `collate`: `tactile`, `label` and these layers, or all there are.

        `tactile` always comes, named or not. UsageError for a layer that there is none of.
        """
        wanted = [name for name in LAYERS if getattr(self, name) is not None] if layers is None else checked_layers(layers)
        its: dict[str, Any] = {"tactile": self.image}
        for name in wanted:
            its[name] = getattr(self, name)
            if its[name] is None:
                there = ", ".join(name for name in LAYERS if getattr(self, name) is not None)
                raise UsageError(f"layers: this press has no {name!r}; it has {there}")
        its["label"] = self.label
        return cast("Sample", its)

    @property
    def _source(self) -> Pressing:
        if self._pressing is None:
            raise AttributeError("this impression was pickled without its layers")
        return self._pressing

    def __repr__(self) -> str:
        height, width = self.image.shape[:2]
        force = "" if self.force_n is None else f", {self.force_n:.3g} N"
        frame = "" if self.frame is None else f"frame {self.frame}, "
        return f"<gelsim.Impression: {frame}{width}x{height} px, {'contact' if self.in_contact else 'no contact'}{force}>"

    def __getstate__(self) -> dict[str, Any]:
        for name in ("image", *LAYERS, "label"):
            getattr(self, name)
        return {**self.__dict__, "_pressing": None}


class Simulator:
    """A sensor made ready at a fidelity level: it presses meshes and height maps, and follows an object that slides.

    ```python
    import gelsim

    simulator = gelsim.Simulator("digit")                           # the costly part, once
    corners_mm = [(-3, -3, 2), (3, -3, 2), (3, 3, 2), (-3, 3, 2), (0, 0, 0)]
    pyramid = gelsim.Mesh(corners_mm, [(4, 0, 1), (4, 1, 2), (4, 2, 3), (4, 3, 0)])    # or gelsim.Mesh.load("my.stl")
    press = simulator.press(pyramid, gelsim.Pose(0.8, x_mm=1.0))    # 0.8 mm deep, 1 mm right of the middle
    press.image                                                     # uint8 (H, W, 3)
    press.depth, press.normal, press.pressure, press.force_n        # what is known beneath it
    ```

    The sensor's light is changed by its LEDs, anything else of it by `set`:

    ```python
    sensor = gelsim.Sensor.preset("digit", set={"camera.exposure": 1.2})
    amber = gelsim.Led(azimuth_deg=45.0, color=(1.0, 0.6, 0.0), intensity=3.0)
    simulator = gelsim.Simulator(sensor.with_leds([*sensor.leds, amber]), "high")
    ```

    In a sequence friction remembers what the object did from frame to frame:

    ```python
    simulator.reset(friction=0.5)
    for frame in range(20):
        press = simulator.step(pyramid, gelsim.Pose(min(0.2 * frame, 0.8), x_mm=max(0.0, 0.1 * (frame - 5))))
        print(press.frame, press.slip_state, press.wrench)
    ```

    Lengths are millimetres, angles degrees, forces newtons; x is to the right in the image, y down, z out of the pad towards the
    object. `press` changes nothing, so that threads share a simulator; the same press has the same bytes on any of them, and the
    work is done without the GIL. A sequence belongs to its simulator: `copy` makes another one, with the costly part shared. A
    simulator can be pickled, without its sequence.
    """

    def __init__(
        self,
        sensor: Union[Sensor, str, PathLike[str]],
        fidelity: str = "standard",
        *,
        resolution_px: Optional[tuple[int, int]] = None,
        set: Union[Sequence[str], Mapping[str, object]] = (),
        flow: bool = False,
    ) -> None:
        """Makes a sensor ready, which takes from milliseconds to a second.

        `sensor` is a `Sensor`, the name of a preset (`gelsim list sensors`) or the path of a sensor file, which ends in .toml.
        `fidelity` is `paper`, `draft`, `standard`, `high`, `reference` or `finite-strain`: how exact the numerics are, and how
        long they take; `finite-strain` takes single presses into flat pads. `resolution_px`, width and height, is the image's
        in place of the sensor's own. `set` changes the sensor by keys of a job, as in `{"camera.exposure": 1.2}`. `flow` has
        presses say how the surface moves in its plane (the layer `flow`, and what a shear does) on a sensor without markers,
        too.

        Raises UsageError with every mistake.
        """
        made, size_px = sensor_of(sensor), size(resolution_px)
        if not isinstance(flow, bool):
            raise TypeError(f"flow is {kind(flow)}; give True or False")
        self._engine = Engine(made, fidelity, size_px, set, flow)
        # A copy: who changes `set` later does not change what is pickled.
        self._given = (made, fidelity, size_px, plain(set), flow)
        # What the last `reset` said, if there was one.
        self._begun: Optional[dict[str, Any]] = None

    def press(
        self,
        indenter: Indenter,
        pose: Union[Pose, Placement, None] = None,
        *,
        texture: Optional[Texture] = None,
        shear: Optional[Shear] = None,
        friction: Optional[float] = None,
        youngs_modulus_kpa: Optional[float] = None,
        poisson_ratio: float = 0.48,
        index: int = 0,
        seed: int = 0,
    ) -> Impression:
        """Presses a mesh at a pose, or a height map, into the pad.

        `indenter` is one of

        - a `Mesh`, the path of a mesh file, arrays `(vertices_mm, faces)`, or what has `vertices` and `faces`, as trimesh's; what is
          no `Mesh` is made ready anew in each call;
        - an array (H, W), float32 or float64, of the simulator's resolution: how far the object reaches below the untouched pad, mm,
          0 or -inf where nothing is, negative where it is above (as `Sensor.render` takes it). On a sensor whose gel has a shape it is
          a depth frame of a camera where the lens is: distances along the lens's axis, mm, inf where nothing is.

        `pose` says where a mesh is: `Pose(depth_mm, x_mm, y_mm, yaw_deg, ...)`, or `Placement` with a translation and a quaternion.
        Heights and depth frames need none.

        `texture` is cut into the object; `shear` moves it in the pad's plane after it was pressed in. `friction` is the coefficient
        between pad and object, 0 to 10; without it nothing slips. `youngs_modulus_kpa` and `poisson_ratio` are the object's own:
        without the first it is rigid. `index` and `seed` choose what is random in the camera, and what `set` leaves to chance:
        press k of a dataset of that seed has the same.

        Raises UsageError for what cannot be right, with all mistakes, TypeError for other types.
        """
        ready, name = ready_of(indenter)
        checks = Checks()
        friction = checks.optional("friction", friction, 0.0, 10.0)
        modulus = checks.optional("youngs_modulus_kpa", youngs_modulus_kpa, 0.1, 1e9, "kPa")
        ratio = checks.number("poisson_ratio", poisson_ratio, 0.0, 0.5)
        checks.done()
        check_pose(pose)
        check_type("texture", texture, Texture)
        check_type("shear", shear, Shear)
        return Impression(
            self._engine.press(name, ready, pose, texture, shear, friction, modulus, ratio, index, seed)
        )

    def reset(self, *, friction: Optional[float] = 0.6, index: int = 0, seed: int = 0) -> None:
        """Begins another sequence: the next `step` is its first frame, of a pad that nothing touches yet.

        `friction` is Coulomb's coefficient between pad and object, 0 to 10; None: nothing slips. `index` and `seed` choose what is
        random in the camera, as in `press`; noise differs from frame to frame. The first call also makes ready what sequences need,
        which otherwise happens in their first frame.
        """
        checks = Checks()
        friction = checks.optional("friction", friction, 0.0, 10.0)
        checks.done()
        self._engine.reset(friction, index, seed)
        self._begun = {"friction": friction, "index": index, "seed": seed}

    def step(
        self,
        indenter: Indenter,
        pose: Union[Pose, Placement],
        *,
        texture: Optional[Texture] = None,
        duration_s: float = 0.04,
    ) -> Impression:
        """Presses the next frame of the sequence: the object has moved from where it was in the frame before to `pose`.

        The pad remembers: what sticks is dragged along, what slips stays behind, and an object that rolls does not drag. `slip`,
        `slip_state` and `wrench` of what comes back say so. The first frame after `reset` (or of a new simulator) is pressed
        straight in. Let an object come, slide and go in frames that are near each other: a mesh may turn and roll by some degrees
        in each, heights by 10 degrees about z. `indenter` is as in `press`, the same object in every frame; heights need a
        `Placement`, which says where the object is that they show. `texture` stays on the object. `duration_s`, the time since the
        frame before, matters to pads that relax.

        The sequence is the simulator's: one thread steps at a time (RunError), `copy` makes another one. After a UsageError the
        sequence is as it was. Not at `paper`, which knows no friction.
        """
        return step_each([self], [(indenter, pose, texture)], duration_s, None)[0]

    def copy(self) -> Simulator:
        """Another simulator of the same sensor at the same level: the costly part is shared. Its sequence is its own, and
        begins as the last `reset` said."""
        other = Simulator.__new__(Simulator)
        other._given, other._engine, other._begun = self._given, self._engine.copy(), None
        if self._begun is not None:
            other.reset(**self._begun)
        return other

    @property
    def sensor(self) -> Sensor:
        """The sensor, before `resolution_px` and `set`."""
        return self._given[0]

    @property
    def fidelity(self) -> str:
        """Fidelity level."""
        return self._engine.fidelity

    @property
    def resolution_px(self) -> tuple[int, int]:
        """Width and height of its images; a height map has as many columns and rows."""
        return self._engine.resolution_px

    @property
    def field_of_view_mm(self) -> tuple[float, float]:
        """Width and height of the pad's window that its images show, mm."""
        return self._engine.field_of_view_mm

    @property
    def gelpad_thickness_mm(self) -> float:
        """Thickness of its gelpad, mm: nothing is pressed deeper into a flat pad."""
        return self._engine.gelpad_thickness_mm

    @property
    def is_flat(self) -> bool:
        """True for a flat pad; False for a gel that has a shape."""
        return self._engine.is_flat

    def __repr__(self) -> str:
        width, height = self.resolution_px
        return f'<gelsim.Simulator "{self.sensor.name}": {width}x{height} px, fidelity {self.fidelity}>'

    def __copy__(self) -> Simulator:
        return self.copy()

    def __deepcopy__(self, memo: dict[int, Any]) -> Simulator:
        return self.copy()

    def __reduce__(self) -> tuple[Any, ...]:
        return rebuilt, (*self._given, self._begun)


class Array:
    """Several sensors that step together, on all cores: the fingers of a hand, or the environments of a training run.

    ```python
    import gelsim

    fingers = gelsim.Array(["digit", "digit"])
    ball = gelsim.Mesh.load("ball.stl")
    fingers.reset(friction=0.5)
    left, right = fingers.step(ball, [gelsim.Pose(0.3), gelsim.Pose(0.6, x_mm=1.0)])
    batch = gelsim.collate([press.sample(["depth"]) for press in (left, right)])    # arrays (2, H, W, ...)
    ```

    Each sensor has a sequence of its own; those that are equal share the costly part. `array[k]` is the simulator of sensor k. An array
    can be copied and pickled, without its sequences.
    """

    def __init__(
        self,
        sensors: Sequence[Union[Simulator, Sensor, str, PathLike[str]]],
        fidelity: str = "standard",
        *,
        threads: Optional[int] = None,
    ) -> None:
        """Makes the sensors ready.

        `sensors` are simulators, of which copies are made, or what `Simulator` takes, for simulators of this `fidelity`. `threads`
        is the number of threads that render, by default one for each core.

        Raises UsageError with every mistake.
        """
        named: dict[str, Sensor] = {}
        ready: list[tuple[tuple[Any, ...], Simulator]] = []
        self._simulators: list[Simulator] = []
        for given in items("sensors", sensors, "a list of simulators, sensors or names of presets"):
            if isinstance(given, str) and given not in named:
                named[given] = sensor_of(given)
            if isinstance(given, Simulator):
                its = given._given
            else:
                its = (named[given] if isinstance(given, str) else sensor_of(given), fidelity, None, [], False)
            # What is rebuilt from the same in another process is equal.
            source = (its[0].__reduce__(), *its[1:])
            known = next((made for same, made in ready if same == source), None)
            if known is None:
                known = given if isinstance(given, Simulator) else Simulator(its[0], fidelity)
                ready.append((source, known))
            self._simulators.append(known.copy())
        if not self._simulators:
            raise UsageError("sensors: there is none; give gelsim.Array(['digit', 'digit'])")
        self._threads = threads
        step_each([], [], 0.0, threads)  # refuses what is no number of threads
        self.reset()

    def reset(self, *, friction: Optional[float] = 0.6, index: int = 0, seed: int = 0) -> None:
        """Begins another sequence on every sensor, as `Simulator.reset` does; sensor k gets `index` + k."""
        for number, simulator in enumerate(self._simulators):
            simulator.reset(friction=friction, index=index + number, seed=seed)

    def step(
        self,
        indenters: Union[Indenter, list[Any]],
        poses: Union[Pose, Placement, Sequence[Union[Pose, Placement]]],
        *,
        texture: Optional[Texture] = None,
        duration_s: float = 0.04,
    ) -> list[Impression]:
        """Presses the next frame of the sequence of each sensor, as `Simulator.step` does, and returns their impressions in order.

        A list of `indenters` or `poses` has one for each sensor; anything else is for all of them. Raises UsageError with the
        mistakes of all sensors, whose sequences are then as they were.
        """
        pressed = per_sensor("indenters", indenters, isinstance(indenters, list), len(self))
        is_one = poses is None or isinstance(poses, (Pose, Placement))
        placed = per_sensor("poses", poses, not is_one, len(self))
        given = list(zip(pressed, placed, [texture] * len(self)))
        return step_each(self._simulators, given, duration_s, self._threads)

    def __len__(self) -> int:
        return len(self._simulators)

    def __getitem__(self, number: int) -> Simulator:
        return self._simulators[number]

    def __iter__(self) -> Iterator[Simulator]:
        return iter(self._simulators)

    def __reduce__(self) -> tuple[Any, ...]:
        # One of each kind, as often as there are such sensors: pickled or copied, it is still one.
        kinds = {id(simulator._given): simulator for simulator in reversed(self._simulators)}
        begun = [simulator._begun for simulator in self._simulators]
        return array_of, ([kinds[id(simulator._given)] for simulator in self._simulators], self._threads, begun)

    def __repr__(self) -> str:
        return f"<gelsim.Array of {len(self)}: {', '.join(sorted({simulator.sensor.name for simulator in self._simulators}))}>"


def per_sensor(name: str, given: Any, is_list: bool, count: int) -> list[Any]:
    """One of `given` for each sensor."""
    if not is_list:
        return [given] * count
    found = items(name, given, "one for all sensors, or a list")
    if len(found) != count:
        raise UsageError(f"{name}: there are {len(found)}, for {count} sensor(s); give one for each, or one alone for all")
    return list(found)


def step_each(
    simulators: list[Simulator], given: list[tuple[Any, Any, Any]], duration_s: float, threads: Optional[int]
) -> list[Impression]:
    """Steps simulators together: `given` has the indenter, pose and texture of each."""
    steps: list[tuple[str, Any, Any, Any]] = []
    same: Any = None
    for indenter, pose, texture in given:
        # What all sensors press is made ready once.
        if same is None or same[0] is not indenter:
            same = (indenter, *ready_of(indenter))
        check_pose(pose)
        check_type("texture", texture, Texture)
        steps.append((same[2], same[1], pose, texture))
    engines = [simulator._engine for simulator in simulators]
    return [Impression(pressing) for pressing in step_all(engines, steps, duration_s, threads)]


def array_of(
    simulators: list[Simulator], threads: Optional[int], begun: Sequence[Optional[dict[str, Any]]] = ()
) -> Array:
    """An array in another process, or a copy."""
    made = Array(simulators, threads=threads)
    for simulator, settings in zip(made._simulators, begun):
        if settings is not None:
            simulator.reset(**settings)
    return made


def plain(given: Any) -> Any:
    """A copy of what `set` holds, once that was taken: what can be compared and pickled, and nobody else changes."""
    if given is None or isinstance(given, (bool, int, float, str)):
        return given
    if isinstance(given, Mapping):
        return {key: plain(value) for key, value in given.items()}
    if isinstance(given, PathLike):
        return os.fspath(given)
    return plain(given.tolist()) if hasattr(given, "tolist") else [plain(each) for each in given]


def rebuilt(
    sensor: Sensor,
    fidelity: str,
    resolution_px: Optional[tuple[int, int]],
    set: Any,
    flow: bool,
    begun: Optional[dict[str, Any]] = None,
) -> Simulator:
    """A simulator in another process."""
    made = Simulator(sensor, fidelity, resolution_px=resolution_px, set=set, flow=flow)
    if begun is not None:
        made.reset(**begun)
    return made


def sensor_of(given: Union[Sensor, str, PathLike[str]]) -> Sensor:
    """A sensor by what a user calls it."""
    honest("sensor", given)
    if isinstance(given, Sensor):
        return given
    if isinstance(given, str):
        is_path = given.lower().endswith(".toml") or os.sep in given
        return Sensor.load(given) if is_path else Sensor.preset(given)
    if isinstance(given, PathLike):
        return Sensor.load(given)
    raise TypeError(f"sensor is {kind(given)}; give a gelsim.Sensor, a preset's name or the path of a sensor file")


def size(resolution_px: Optional[tuple[int, int]]) -> Optional[tuple[int, int]]:
    """Width and height, if they are given."""
    if resolution_px is None:
        return None
    checks = Checks()
    width, height = checks.numbers("resolution_px", resolution_px, 2, 1, 8192, "px")
    checks.done()
    if not (width.is_integer() and height.is_integer()):
        raise TypeError("resolution_px has parts of pixels; give whole numbers: width and height")
    return int(width), int(height)


def ready_of(given: Indenter) -> tuple[Any, str]:
    """What the engine presses, and its name."""
    honest("indenter", given)
    numpy = need("numpy")
    if isinstance(given, numpy.ndarray):
        return given, "depth_mm"
    if isinstance(given, Mesh):
        mesh = given
    elif isinstance(given, (str, PathLike)):
        mesh = Mesh.load(given)
    elif isinstance(given, tuple):
        if len(given) != 2:
            raise TypeError(f"indenter is a tuple of {len(given)}; give (vertices_mm, faces)")
        mesh = Mesh(given[0], given[1])
    elif hasattr(given, "vertices") and hasattr(given, "faces"):
        mesh = Mesh.of(given)
    else:
        wanted = "a gelsim.Mesh, a path, (vertices_mm, faces), what has vertices and faces, or an array of heights"
        raise TypeError(f"indenter is {kind(given)}; give {wanted}")
    return mesh._ready, mesh.name


def check_pose(pose: Union[Pose, Placement, None]) -> None:
    """Refuses what is no pose."""
    honest("pose", pose)
    if pose is not None and not isinstance(pose, (Pose, Placement)):
        raise TypeError(f"pose is {kind(pose)}; give gelsim.Pose(depth_mm) or gelsim.Placement(translation_mm, quaternion_xyzw)")


def check_type(name: str, given: object, wanted: type) -> None:
    """Refuses what is of another type."""
    honest(name, given)
    if given is not None and not isinstance(given, wanted):
        raise TypeError(f"{name} is {kind(given)}; give gelsim.{wanted.__name__}")


def checked_layers(layers: Sequence[str]) -> list[str]:
    """Names of layers beside the image."""
    names = items("layers", layers, "a list of texts")
    for name in names:
        if type(name) is not str:
            raise TypeError(f"an item of layers is {kind(name)}; give a text")
        if name not in ("tactile", *LAYERS):
            raise UsageError(f"layers: no layer is called {name[:60]!r}; there are {', '.join(LAYERS)}")
    return [name for name in names if name != "tactile"]
