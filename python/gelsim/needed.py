"""Libraries that a part of the package needs and the command `gelsim` does not."""

from importlib import import_module
from typing import Any


def need(name: str, extra: str) -> Any:
    """The module `name`, or an ImportError that says which extra brings it."""
    try:
        return import_module(name)
    except ImportError as error:
        library = {"PIL": "pillow"}.get(name.split(".")[0], name.split(".")[0])
        raise ImportError(f"this needs {library} ({error}): pip install 'gelsim[{extra}]'") from error
