"""What the arguments of this package are checked for: all mistakes of a call are told at once."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Optional

from gelsim._native import UsageError

LONGEST_SHOWN = 60
"""Characters of a value in a message."""


def kind(value: object) -> str:
    """What a value is, for messages."""
    return "None" if value is None else f"of type {type(value).__name__}"


def shown(value: object) -> str:
    """A number or text, as short as a message wants it."""
    text = repr(value)
    return text if len(text) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]}..."


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
        wanted = f"{self.what}{name} is {kind(values)}; give {count} numbers"
        if isinstance(values, (str, bytes, bytearray)) or not hasattr(values, "__len__"):
            raise TypeError(wanted)
        if len(values) != count:
            raise TypeError(f"{self.what}{name} has {len(values)} items; give {count} numbers")
        try:
            each = [values[place] for place in range(count)]
        except (KeyError, IndexError) as error:
            raise TypeError(wanted) from error
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
