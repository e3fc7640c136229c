from collections.abc import Iterator, Mapping, Sequence
from os import PathLike
from typing import Any, Literal, Optional, SupportsIndex, Union, final

import numpy as np
from numpy.typing import NDArray

from gelsim.sample import Sample
from gelsim.scene import Led

__version__: str

class UsageError(ValueError):
    """Something that the user wrote is wrong: all mistakes at once, as the command says them with exit status 2."""

class RunError(RuntimeError):
    """Something failed while running, as the command says it with exit status 1."""

def main(argv: Sequence[str]) -> int:
    """Runs the command line `argv`, the program's name first. Prints as the command does; gives its exit status.

    Once per process, and from its main thread: it takes over SIGINT and SIGTERM.
    """

@final
class Job:
    """A job as a map-style dataset: sample `i` is what `gelsim generate` writes, rendered when it is asked for.

    ```python
    job = gelsim.Job.load("job.toml", samples=1000, set={"sensor.preset": "digit"})
    sample = job[42]
    image, depth_mm, label = sample["tactile"], sample["depth"], sample["label"]
    ```

    It can be pickled: another process reads the objects again, and refuses them if they changed.
    """

    @staticmethod
    def load(
        path: Union[str, PathLike[str]],
        *,
        samples: Optional[int] = None,
        seed: Optional[int] = None,
        fidelity: Optional[str] = None,
        all_effects: bool = False,
        set: Union[Sequence[str], Mapping[str, object]] = ...,
        threads: Optional[int] = None,
    ) -> Job:
        """Reads and resolves a job. The arguments are the flags of `gelsim generate`.

        `set` changes keys of the job: a dict as in `{"indentation.depth_mm": [0.3, 0.9], "sensor.preset": "digit"}`, or a list of
        texts as the command takes them, `["indentation.depth_mm=[0.3, 0.9]"]`. `threads` is for `samples`: all cores if it is left out, one in a process that multiprocessing started.
        Raises UsageError with every mistake in the job.
        """

    def sample(self, index: SupportsIndex) -> Sample:
        """Sample `index`, rendered on this thread, without the GIL. Negative ones count from the end."""

    def samples(self, indices: Sequence[SupportsIndex]) -> list[Sample]:
        """Several samples in this order, rendered on the job's threads."""

    def indices(self, split: str) -> list[int]:
        """The samples of the split `train`, `val` or `test`, ascending."""

    def __len__(self) -> int: ...
    def __getitem__(self, index: SupportsIndex, /) -> Sample: ...
    def __getitems__(self, indices: Sequence[SupportsIndex]) -> list[Sample]: ...
    def __iter__(self) -> Iterator[Sample]: ...
    def __reduce__(self) -> tuple[object, ...]: ...
    @property
    def name(self) -> str:
        """Name of the dataset."""

    @property
    def seed(self) -> int:
        """Seed of all randomness."""

    @property
    def fidelity(self) -> str:
        """Fidelity level."""

    @property
    def fingerprint(self) -> str:
        """SHA-256 over all that decides the bytes of a sample, as in `dataset.json`."""

    @property
    def classes(self) -> list[str]:
        """Class names; a label's `class_index` counts here."""

    @property
    def layers(self) -> list[str]:
        """The layers of every sample."""

@final
class Sensor:
    """A sensor: a preset, or a file. It renders tactile images of depth maps; `Simulator` presses meshes into it.

    ```python
    sensor = gelsim.Sensor.preset("digit", set={"camera.exposure": 1.2})
    sensor = sensor.with_leds([*sensor.leds, gelsim.Led(azimuth_deg=45.0, intensity=3.0)])
    depth_mm = np.zeros((320, 240), np.float32)
    depth_mm[120:200, 80:160] = 0.5
    image = sensor.render(depth_mm)["tactile"]
    ```

    It can be pickled: another process reads its file again.
    """

    @staticmethod
    def preset(name: str, *, set: Union[Sequence[str], Mapping[str, object]] = ..., threads: Optional[int] = None) -> Sensor:
        """One of `gelsim list sensors`, changed by `set`: keys of a job, as in `{"camera.exposure": 1.2}`, or a list of texts as the
        command takes them.

        `threads` is for batches: all cores if it is left out, one in a process that multiprocessing started.
        Raises UsageError with every mistake.
        """

    @staticmethod
    def load(path: Union[str, PathLike[str]], *, set: Union[Sequence[str], Mapping[str, object]] = ..., threads: Optional[int] = None) -> Sensor:
        """A sensor file, such as `gelsim calibrate` writes. `set` and `threads` are those of `preset`."""

    def render(
        self,
        depth_mm: Union[NDArray[np.float32], NDArray[np.float64]],
        *,
        fidelity: Optional[str] = None,
        layers: Sequence[str] = ...,
        index: int = 0,
        seed: int = 0,
        along: Optional[Literal["axis", "ray"]] = None,
        fov_y_deg: Optional[float] = None,
    ) -> dict[str, Any]:
        """Presses what a depth map (H, W) or (H, W, 1) shows into the pad: a `Sample` with `tactile`, `layers` and `label`.

        `depth_mm` is how far the object reaches below the undeformed pad, mm, as the layer `depth`: 0 where it does not.
        Negative values are heights above the pad, which matter where the pad bulges up to them; -inf is nothing there.
        Several maps (N, H, W) or (N, H, W, 1) give a `Batch`, rendered on the sensor's threads. The map's resolution wins; the field of
        view is the sensor's. `index` and `seed` address what is random in the camera: map k is sample `index` + k.
        Raises UsageError for values that cannot be right, TypeError for other types; warns of depth that seems to be in
        metres or micrometres, that goes through the pad, and of maps whose pixels are out of proportion.

        On a sensor whose gel has a shape `depth_mm` is a depth frame of a camera where the sensor's lens is: distance from it,
        mm, above 0, inf where nothing is, along the optical axis or, with `along="ray"`, along each pixel's ray. The camera
        has the sensor's own lens, or with `fov_y_deg` a pinhole's of that angle between its upper and lower edge.
        """

    def __reduce__(self) -> tuple[object, ...]: ...
    @property
    def name(self) -> str:
        """Name in labels."""

    @property
    def resolution_px(self) -> tuple[int, int]:
        """Width and height of the sensor's own image."""

    @property
    def field_of_view_mm(self) -> tuple[float, float]:
        """Width and height of the pad's window that the image shows."""

    @property
    def gelpad_thickness_mm(self) -> float:
        """Thickness of the gelpad."""

    @property
    def is_flat(self) -> bool:
        """True for a flat pad, which is given heights; a gel that has a shape is given distances from its lens."""

    @property
    def leds(self) -> list[Led]:
        """LEDs; `with_leds` makes a sensor with others."""

    def with_leds(self, leds: Sequence[Led]) -> Sensor:
        """Returns this sensor with other LEDs in place of its own: `sensor.with_leds([*sensor.leds, gelsim.Led(45.0)])`.

        Raises UsageError with every mistake; warns if the sensor has calibrated optics, which LEDs are no part of.
        """

@final
class ReadyMesh:
    """A mesh that was cleaned and prepared for pressing; held by `gelsim.Mesh`."""

    @property
    def triangles(self) -> int: ...
    @property
    def bounds_mm(self) -> list[list[float]]: ...

def mesh_of_file(path: Union[str, PathLike[str]], mm_per_unit: Optional[float]) -> tuple[ReadyMesh, list[str]]:
    """Reads the mesh of a file. Returns it, and warnings about it."""

def mesh_of_arrays(vertices_mm: NDArray[np.float64], faces: NDArray[np.uint32]) -> tuple[ReadyMesh, list[str]]:
    """Makes a mesh of vertices (N, 3), mm, and triangles (M, 3). Returns it, and warnings about it."""

@final
class Engine:
    """A sensor prepared at a fidelity level; held by `gelsim.Simulator`."""

    def __new__(
        cls,
        sensor: Sensor,
        fidelity: str,
        resolution_px: Optional[tuple[int, int]],
        set: Union[Sequence[str], Mapping[str, object]],
        flow: bool,
    ) -> Engine: ...
    def copy(self) -> Engine: ...
    @property
    def resolution_px(self) -> tuple[int, int]: ...
    @property
    def fidelity(self) -> str: ...
    @property
    def field_of_view_mm(self) -> tuple[float, float]: ...
    @property
    def gelpad_thickness_mm(self) -> float: ...
    @property
    def is_flat(self) -> bool: ...
    def press(
        self,
        name: str,
        object: Any,
        pose: Any,
        texture: Any,
        shear: Any,
        friction: Optional[float],
        youngs_modulus_kpa: Optional[float],
        poisson_ratio: float,
        index: int,
        seed: int,
    ) -> Pressing: ...
    def reset(self, friction: Optional[float], index: int, seed: int) -> None: ...

@final
class Pressing:
    """Result of a press; held by `gelsim.Impression`."""

    def image(self) -> Any:
        """Returns the tactile image, the same array every time."""

    def layer(self, name: str) -> Any: ...
    def label(self) -> Any: ...
    @property
    def frame(self) -> Optional[int]: ...

def step_all(
    engines: list[Engine], steps: list[tuple[str, Any, Any, Any]], duration_s: Any, threads: Optional[int]
) -> list[Pressing]:
    """Renders the next frame of the sequence of each engine; of several at once on the threads of a pool. Nothing is
    rendered if one of the frames cannot be."""

def generate(
    job: Any,
    out: Any,
    samples: Any,
    seed: Any,
    fidelity: Any,
    all_effects: Any,
    set: Any,
    threads: Any,
    overwrite: Any,
) -> dict[str, Any]:
    """Writes a dataset, and returns what was made as a dictionary. This is `gelsim.generate`."""
