"""What came, what was done, dropped and refused, and how long it took."""

from __future__ import annotations

import re
import threading
import time
import traceback
from collections import Counter
from typing import NamedTuple, Optional

from gelsim._native import RunError, UsageError
from gelsim.ros.messages import Refused

MOST_CAUSES = 100
"""Of refusals that are told apart."""


class Status(NamedTuple):
    """How the node has done since the last report."""

    is_well: bool
    """False if messages were dropped or refused, or if nothing came."""
    summary: str
    """One line."""
    values: dict[str, str]
    """The same by name, and since the start."""
    is_news: bool
    """False if nothing came, and that was said before."""


class Tally:
    """Counts, from any thread."""

    def __init__(self) -> None:
        """Nothing has come yet."""
        self._lock = threading.Lock()
        self._counts = Counter[str]()
        self._before = Counter[str]()
        self._causes = Counter[str]()
        self._latencies_s: list[float] = []
        self._since = time.monotonic()
        self._was_silent = False

    def add(self, name: str, many: int = 1) -> None:
        """Counts messages that `came` or were `dropped`."""
        with self._lock:
            self._counts[name] += many

    def done(self, seconds: float) -> None:
        """Counts a message that was answered so long after it came."""
        with self._lock:
            self._counts["done"] += 1
            self._latencies_s.append(seconds)

    def refused(self, error: Exception) -> Optional[str]:
        """Counts what is wrong with a message. Returns its text if it is the first of its cause."""
        text = str(error) or type(error).__name__
        if not isinstance(error, (Refused, UsageError, RunError)):
            text = "".join(traceback.format_exception_only(type(error), error)).strip()
        # The same mistake has other numbers in other messages.
        cause = re.sub(r"[-+]?\d[\d.e+-]*", "#", text)
        with self._lock:
            cause = cause if cause in self._causes or len(self._causes) < MOST_CAUSES else "others"
            self._causes[cause] += 1
            self._counts["refused"] += 1
            return text if self._causes[cause] == 1 else None

    def due(self, period_s: float) -> float:
        """Seconds until the next report."""
        return self._since + period_s - time.monotonic()

    def report(self) -> Status:
        """What happened since the last report."""
        with self._lock:
            now, since, self._since = time.monotonic(), self._since, time.monotonic()
            counts, before, self._before = self._counts.copy(), self._before, self._counts.copy()
            latencies, self._latencies_s = sorted(self._latencies_s), []
        new = {name: counts[name] - before[name] for name in ("came", "done", "dropped", "refused")}
        median, most = (f"{1e3 * latencies[int(part * (len(latencies) - 1))]:.1f}" if latencies else "" for part in (0.5, 0.99))
        values = {
            "rate in, Hz": f"{new['came'] / (now - since):.1f}",
            "rate out, Hz": f"{new['done'] / (now - since):.1f}",
            "dropped": str(new["dropped"]),
            "refused": str(new["refused"]),
            "latency median, ms": median,
            "latency 99 %, ms": most,
            **{f"{name} since the start": str(counts[name]) for name in new},
        }
        is_silent = not new["came"] and not new["refused"]
        summary = "nothing comes"
        if not is_silent:
            summary = f"{values['rate out, Hz']} of {values['rate in, Hz']} Hz, dropped {new['dropped']}, refused {new['refused']}"
            summary += f", latency {median} ms (median), {most} ms (99 %)" if latencies else ""
        is_news, self._was_silent = not (is_silent and self._was_silent), is_silent
        return Status(bool(new["done"]) and not new["dropped"] and not new["refused"], summary, values, is_news)
