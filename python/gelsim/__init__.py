"""Synthetic datasets for optical tactile sensors.

The command is `gelsim`, or `python -m gelsim`. `Job` is a job as a map-style dataset whose samples are rendered when they
are asked for; docs/python.md has examples.
"""

from gelsim._native import Job, RunError, UsageError, __version__
from gelsim.sample import Markers, Sample

__all__ = ["Job", "Markers", "RunError", "Sample", "UsageError", "__version__"]
