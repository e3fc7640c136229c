"""What the arguments of this package are checked for: all mistakes of a call are told at once."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from typing import Any, Optional

from gelsim._native import UsageError

MOST_ITEMS = 10_000
"""No list that is no array has more."""

LONGEST_PATH = 4096
"""Characters of a path."""

LONGEST_SHOWN = 60
"""Characters of a value in a message."""


def kind(value: object) -> str:
    """What a value is, for messages."""
    return "None" if value is None else f"of type {type(value).__name__}"


def honest(name: str, value: object) -> None:
    """Refuses what says that it is of a class that it is not of: Python's own functions would not take it for that."""
    if not issubclass(type(value), value.__class__):
        raise TypeError(f"{name} is {kind(value)}, which says that it is {value.__class__.__name__}")


def items(name: str, given: Any, wanted: str) -> list[Any]:
    """The items of a list, or of what is as good as one: no more than its length, as a class may say anything of either."""
    honest(name, given)
    wrong = f"{name} is {kind(given)}; give {wanted}"
    if isinstance(given, (str, bytes, bytearray)):
        raise TypeError(wrong)
    try:
        length = len(given)
        if length > MOST_ITEMS:
            raise UsageError(f"{name} has {length} items; give {wanted}")
        return [item for item, _ in zip(given, range(length))]
    except TypeError as error:
        raise TypeError(wrong) from error


def shown(value: object) -> str:
    """A number or text, as short as a message wants it."""
    text = repr(value)
    return text if len(text) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]}..."


def path_text(given: Any, of: str) -> str:
    """A path as text; `of` says of what."""
    honest("path", given)
    text = os.fspath(given) if isinstance(given, (str, os.PathLike)) else given
    if not isinstance(text, str):
        raise TypeError(f"path is {kind(text)}; give a path: a text or a pathlib.Path")
    if len(text) > LONGEST_PATH or "\0" in text:
        raise UsageError(f"path is no path: give that of {of}")
    return text


class Checks:
    """Checks numbers one after another; `done` raises what was wrong of all of them."""

    def __init__(self, what: str = "") -> None:
        self.what = what
        self.wrong: list[str] = []

    def number(self, name: str, value: Any, low: float, high: float, unit: str = "") -> float:
        """A number from `low` to `high`. TypeError if it is no number."""
        wanted = f"{self.what}{name} is {kind(value)}; give a number"
        if isinstance(value, (str, bytes, bytearray)):
            raise TypeError(wanted)
        try:
            found = float(value)
        except (TypeError, ValueError) as error:
            raise TypeError(wanted) from error
        except OverflowError:
            found = math.inf
        if not low <= found <= high:
            self.wrong.append(f"{self.what}{name} is {shown(found)}; allowed: {low:g} to {high:g}{unit and f' {unit}'}")
        return found

    def numbers(self, name: str, values: Any, count: int, low: float, high: float, unit: str = "") -> tuple[float, ...]:
        """So many of them."""
        wanted = f"{count} numbers"
        each = items(f"{self.what}{name}", values, wanted)
        if len(each) != count:
            raise TypeError(f"{self.what}{name} has {len(each)} items; give {wanted}")
        return tuple(self.number(f"{name}[{place}]", value, low, high, unit) for place, value in enumerate(each))

    def optional(self, name: str, value: Any, low: float, high: float, unit: str = "") -> Optional[float]:
        """A number, or None."""
        return None if value is None else self.number(name, value, low, high, unit)

    def choice(self, name: str, value: Any, allowed: Sequence[str]) -> str:
        """One of these texts."""
        if not isinstance(value, str):
            raise TypeError(f"{self.what}{name} is {kind(value)}; give a text")
        if value not in allowed:
            self.wrong.append(f"{self.what}{name} is {shown(value)}; allowed: {', '.join(map(repr, allowed))}")
        return value

    def done(self) -> None:
        """Raises UsageError for what was out of range."""
        if self.wrong:
            raise UsageError("\n".join(self.wrong))
