"""Synthetic datasets for optical tactile sensors.

The command is `gelsim`, or `python -m gelsim`. `Job` is a job as a map-style dataset whose samples are rendered when they
are asked for; `load` gives a dataset on disk the same way; `collate` makes batches of both; `Sensor` renders tactile images of
depth maps. docs/python.md has examples.
"""

from gelsim._native import Job, RunError, Sensor, UsageError, __version__
from gelsim.batch import collate
from gelsim.dataset import Dataset, load

__all__ = ["Dataset", "Job", "RunError", "Sensor", "UsageError", "__version__", "collate", "load"]
