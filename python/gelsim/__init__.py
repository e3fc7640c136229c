"""Synthetic tactile images: of meshes and height maps that you press, and datasets of them.

Press a mesh, change the sensor's light, and let an object slide:

```python
import gelsim

sensor = gelsim.Sensor.preset("digit")                          # `gelsim list sensors` names all presets
amber = gelsim.Led(azimuth_deg=45.0, color=(1.0, 0.6, 0.0), intensity=3.0)
simulator = gelsim.Simulator(sensor.with_leds([*sensor.leds, amber]))

corners_mm = [(-3, -3, 2), (3, -3, 2), (3, 3, 2), (-3, 3, 2), (0, 0, 0)]
pyramid = gelsim.Mesh(corners_mm, [(4, 0, 1), (4, 1, 2), (4, 2, 3), (4, 3, 0)])    # gelsim.Mesh.load("my.stl") reads a file
press = simulator.press(pyramid, gelsim.Pose(0.8, x_mm=1.0))    # 0.8 mm deep, 1 mm to the right of the middle
press.image, press.depth, press.contact, press.force_n          # arrays (H, W, ...), and newtons

simulator.reset(friction=0.5)                                   # a sequence: friction remembers
for frame in range(10):
    press = simulator.step(pyramid, gelsim.Pose(0.8, x_mm=0.1 * frame))
    print(press.slip_state, press.wrench)
```

What there is:

- `Simulator` presses: `press` once, `step` frame by frame; `Impression` is what comes out. `Array` steps many sensors at once.
  `Mesh`, `Pose` and `Placement` say what is pressed and where, `Texture` and `Shear` what else happens.
- `Sensor` is a preset or a sensor file, `Led` one of its lights; `Sensor.render` takes batches of depth maps.
- `Job` renders the samples of a job file when they are asked for, for training without files.
- `generate` writes a dataset, as the command does, and `load` reads it, or a `SensorSet`, whose `pairs` are presses as all sensors see them; `collate` and `collate_torch` make batches.
- `UsageError`, a ValueError, tells all mistakes of a call at once; `RunError` is what fails while running.

Lengths are millimetres, angles degrees, forces newtons. x is to the right in the image, y down, z out of the pad towards the object.
The command is `gelsim`, or `python -m gelsim`. docs/how-to/python.md has more examples.
"""

from gelsim._native import Job, RunError, Sensor, UsageError, __version__
from gelsim.batch import collate, collate_torch
from gelsim.dataset import Dataset, Pairs, SensorSet, load
from gelsim.generating import Generated, generate
from gelsim.mesh import Mesh
from gelsim.sample import Sample
from gelsim.scene import Led, LightPattern, Placement, Pose, Shear, Texture
from gelsim.simulator import Array, Effect, Impression, Simulator

__all__ = [
    "Array",
    "Dataset",
    "Effect",
    "Generated",
    "Impression",
    "Job",
    "Led",
    "LightPattern",
    "Mesh",
    "Pairs",
    "Placement",
    "Pose",
    "RunError",
    "Sample",
    "Sensor",
    "SensorSet",
    "Shear",
    "Simulator",
    "Texture",
    "UsageError",
    "__version__",
    "collate",
    "collate_torch",
    "generate",
    "load",
]
