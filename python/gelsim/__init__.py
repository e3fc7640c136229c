"""Synthetic datasets for optical tactile sensors.

The command is `gelsim`, or `python -m gelsim`. `Job` is a job as a map-style dataset whose samples are rendered when they
are asked for; `Sensor` renders tactile images of depth maps. docs/python.md has examples.
"""

from gelsim._native import Job, RunError, Sensor, UsageError, __version__

__all__ = ["Job", "RunError", "Sensor", "UsageError", "__version__"]
