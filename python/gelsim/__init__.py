"""Synthetic datasets for optical tactile sensors. The command is `gelsim`, or `python -m gelsim`."""

from gelsim._native import __version__

__all__ = ["__version__"]
