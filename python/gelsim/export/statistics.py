"""Statistics of features as LeRobot keeps them: of each episode, and of all."""

from __future__ import annotations

import math
from typing import Any

from gelsim.needed import need

Figures = dict[str, dict[str, Any]]
"""Figures of each feature, nested lists as in JSON."""

QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
LEVELS = 256


class Tally:
    """Of an episode's frames: images as histograms, maps of floats as `Column`s, numbers as they are."""

    def __init__(self) -> None:
        self.images: dict[str, Any] = {}
        self.maps: dict[str, tuple[tuple[int, ...], list[Column]]] = {}
        """Of each map the shape of its figures, and its components."""
        self.frames = 0
        self.numbers: dict[str, list[Any]] = {}

    def add(self, frame: dict[str, Any]) -> None:
        """Adds a frame; images are pairs of bytes and pixels (H, W, 3), or lengths (H, W)."""
        numpy = need("numpy")
        self.frames += 1
        for name, value in frame.items():
            if isinstance(value, tuple) and value[1].ndim == 2:
                self.add_map(name, value[1][..., None], (1, 1, 1))
            elif not isinstance(value, tuple) and value.ndim > 1:
                self.add_map(name, value, value.shape[-1:])
            elif isinstance(value, tuple):
                planes = value[1].reshape(-1, 3).T
                counted = numpy.stack([numpy.bincount(plane, minlength=LEVELS) for plane in planes])
                self.images[name] = self.images.get(name, 0) + counted
            else:
                self.numbers.setdefault(name, []).append(numpy.atleast_1d(value).astype("float64"))

    def add_map(self, name: str, values: Any, shape: tuple[int, ...]) -> None:
        """Adds a map: float32 with the components as its last axis."""
        _, columns = self.maps.setdefault(name, (shape, [Column() for _ in range(values.shape[-1])]))
        for number, column in enumerate(columns):
            column.add(values[..., number])

    def figures(self) -> Figures:
        """Of images in 0 to 1, shaped (3, 1, 1), of lengths (1, 1, 1), of other maps one of each component."""
        numpy = need("numpy")
        found = {name: of_histograms(counted, self.frames) for name, counted in self.images.items()}
        for name, (shape, columns) in self.maps.items():
            each = [column.figures() for column in columns]
            shaped = {figure: numpy.reshape([its[figure] for its in each], shape).tolist() for figure in each[0]}
            found[name] = {**shaped, "count": [self.frames]}
        found |= {name: of_numbers(numpy.stack(rows)) for name, rows in self.numbers.items()}
        return found


class Column:
    """One component of a map in all frames, without what is not finite. Quantiles have the first 16 of 32 bits: they are up to
    1/128 nearer to 0."""

    def __init__(self) -> None:
        self.number, self.mean, self.squares = 0, 0.0, 0.0
        """`squares` is the sum of the squared distances from the mean."""
        self.least, self.most = math.inf, -math.inf
        self.levels = need("numpy").zeros(1 << 16, "int64")

    def add(self, values: Any) -> None:
        """Adds float32 numbers."""
        numpy = need("numpy")
        values = numpy.ascontiguousarray(values[numpy.isfinite(values)])
        if len(values) == 0:
            return
        exact = values.astype("float64")
        middle, total = float(exact.mean()), self.number + len(values)
        self.squares += float(((exact - middle) ** 2).sum()) + (middle - self.mean) ** 2 * self.number * len(values) / total
        self.mean += (middle - self.mean) * len(values) / total
        self.number = total
        self.least, self.most = min(self.least, float(values.min())), max(self.most, float(values.max()))
        bits = values.view("uint32")
        # In the order of the numbers: negative ones have the larger bits the smaller they are.
        ordered = numpy.where(bits >> 31, ~bits, bits | 1 << 31)
        self.levels += numpy.bincount(ordered >> 16, minlength=1 << 16)

    def figures(self) -> dict[str, float]:
        """All but the count; NaN where no number is known."""
        numpy = need("numpy")
        if self.number == 0:
            return dict.fromkeys(["min", "max", "mean", "std", *QUANTILES], math.nan)
        below = numpy.cumsum(self.levels) / self.number
        found = numpy.array([(below < share).sum() for share in QUANTILES.values()], "uint32")
        bits = numpy.where(found >> 15, found ^ 1 << 15, found ^ 0xFFFF) << 16
        quantiles = numpy.clip(bits.astype("uint32").view("float32").astype("float64"), self.least, self.most) + 0.0
        known = {"min": self.least, "max": self.most, "mean": self.mean, "std": math.sqrt(self.squares / self.number)}
        return {**known, **dict(zip(QUANTILES, map(float, quantiles)))}


def of_histograms(counted: Any, frames: int) -> dict[str, Any]:
    """Of pixels, from how many have each level: (3, 256)."""
    numpy = need("numpy")
    levels = numpy.arange(LEVELS) / (LEVELS - 1)
    total = counted.sum(axis=1)
    mean = counted @ levels / total
    below = numpy.cumsum(counted, axis=1) / total[:, None]
    found = {
        "min": [levels[numpy.flatnonzero(channel)[0]] for channel in counted],
        "max": [levels[numpy.flatnonzero(channel)[-1]] for channel in counted],
        "mean": mean,
        "std": numpy.sqrt(numpy.maximum(counted @ levels**2 / total - mean**2, 0)),
        **{name: levels[(below < share).sum(axis=1)] for name, share in QUANTILES.items()},
    }
    return {**{name: [[[float(value)]] for value in values] for name, values in found.items()}, "count": [frames]}


def of_numbers(rows: Any) -> dict[str, Any]:
    """Of vectors (T, K); of a component that no row knows, NaN."""
    numpy = need("numpy")
    if len(rows) == 1:
        same = {name: rows[0].tolist() for name in ["min", "max", "mean", *QUANTILES]}
        return {**same, "std": [0.0] * rows.shape[1], "count": [1]}
    columns = [column[numpy.isfinite(column)] for column in rows.T]
    columns = [column if len(column) else numpy.array([numpy.nan]) for column in columns]
    quantiles = numpy.array([numpy.quantile(column, list(QUANTILES.values())) for column in columns]).T
    found = {
        "min": [column.min() for column in columns],
        "max": [column.max() for column in columns],
        "mean": [column.mean() for column in columns],
        "std": [column.std() for column in columns],
        **dict(zip(QUANTILES, quantiles)),
    }
    return {**{name: [float(value) for value in values] for name, values in found.items()}, "count": [len(rows)]}


def merged(each: list[Figures]) -> Figures:
    """Of several as one. Quantiles are means of theirs, weighted by frames, as LeRobot merges them."""
    numpy = need("numpy")
    whole: Figures = {}
    for feature in each[0]:
        arrays = {name: numpy.array([its[feature][name] for its in each]) for name in each[0][feature]}
        count = arrays.pop("count")
        weights = count.reshape(-1, *[1] * (arrays["mean"].ndim - 1)) * numpy.isfinite(arrays["mean"])
        total = weights.sum(axis=0)

        def mean(values: Any, weights: Any = weights, total: Any = total) -> Any:
            summed = numpy.where(weights > 0, values * weights, 0.0).sum(axis=0)
            return numpy.divide(summed, total, out=numpy.full(summed.shape, numpy.nan), where=total > 0)

        middle = mean(arrays["mean"])
        found = {
            "min": numpy.fmin.reduce(arrays["min"]),
            "max": numpy.fmax.reduce(arrays["max"]),
            "mean": middle,
            "std": numpy.sqrt(mean(arrays["std"] ** 2 + (arrays["mean"] - middle) ** 2)),
            **{name: mean(arrays[name]) for name in QUANTILES},
        }
        whole[feature] = {**{name: value.tolist() for name, value in found.items()}, "count": [int(count.sum())]}
    return whole


def flat(figures: Figures) -> dict[str, Any]:
    """As columns of a table of episodes."""
    return {f"stats/{feature}/{name}": value for feature, its in figures.items() for name, value in its.items()}
