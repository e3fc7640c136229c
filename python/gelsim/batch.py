"""Batches of samples, for PyTorch's DataLoader or plain loops."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Any

from gelsim import vectors
from gelsim._native import UsageError
from gelsim.checks import kind
from gelsim.needed import need

if TYPE_CHECKING:
    from gelsim.sample import Sample


def collate(samples: Sequence[Sample]) -> dict[str, Any]:
    """Makes one batch of samples of `Job`, `load` or `Impression.sample`, with arrays of numpy whatever is installed.

    Images and layers get the samples as first axis and keep their types. `pose` is float32 (N, 7), `wrench` float32 (N, 6)
    (`gelsim.vectors`; NaN is what a label does not know). `label`, `key`, `markers` and `pins` are lists.
    Of grips, `left` and `right` are such batches, of each finger by itself.
    Sequences are padded with zeros to the longest: arrays are (N, T, ...), bool `mask` (N, T) is true for a frame that is
    there. Layers of different sizes stay lists. `collate_torch` gives tensors.

    UsageError for samples or frames of different layers, and for samples without their label.
    """
    return batch_of(samples, lambda array: array)


def collate_torch(samples: Sequence[Sample]) -> dict[str, Any]:
    """The same as `collate` with tensors of PyTorch in place of arrays: `DataLoader(..., collate_fn=gelsim.collate_torch)`.

    Raises ImportError where there is no torch, or one that cannot use the numpy that is installed.
    """
    return batch_of(samples, from_numpy())


def batch_of(samples: Sequence[Sample], tensor: Callable[[Any], Any]) -> dict[str, Any]:
    """A batch whose arrays go through `tensor`."""
    each = checked(samples)
    numpy = need("numpy")
    names = list(each[0])
    rows = [vectors.parts(sample["label"]) for sample in each]
    batch: dict[str, Any]
    if vectors.has_fingers(each[0]["label"]):
        batch = {finger: batch_of([of_finger(grip, finger) for grip in each], tensor) for finger in vectors.FINGERS}
        for finger in vectors.FINGERS:
            del batch[finger]["label"]
    elif "frames" in names:
        batch = sequences([sample["frames"] for sample in each], tensor)
        batch["pose"] = tensor(padded([numpy.array([vectors.pose(part) for part in row], "float32") for row in rows]))
        batch["wrench"] = tensor(padded([numpy.array([vectors.wrench(part) for part in row], "float32") for row in rows]))
    else:
        layers = [name for name in names if name not in ("label", "key")]
        batch = {name: stacked([sample[name] for sample in each], tensor) for name in layers}
        batch["pose"] = tensor(numpy.array([vectors.pose(row[0]) for row in rows], "float32"))
        batch["wrench"] = tensor(numpy.array([vectors.wrench(row[0]) for row in rows], "float32"))
    for name in ("label", "key"):
        if name in names:
            batch[name] = [sample[name] for sample in each]
    return batch


def checked(samples: Any) -> list[dict[str, Any]]:
    """Samples that fit each other; refuses what are none."""
    if isinstance(samples, (Mapping, str, bytes)) or not hasattr(samples, "__len__"):
        raise TypeError(f"samples is {kind(samples)}; give a list of samples, as [dataset[0], dataset[1]]")
    if len(samples) == 0:
        raise UsageError("samples is empty: a batch needs at least one")
    each: list[dict[str, Any]] = []
    for sample in samples:
        if not isinstance(sample, Mapping):
            raise TypeError(f"an item of samples is {kind(sample)}; give dicts, as Job, load and Impression.sample make them")
        each.append(dict(sample))
    check_layers("samples", each)
    for sample in each:
        if not isinstance(sample.get("label"), Mapping):
            raise UsageError("samples have no label, of which pose and wrench are made; keep `label` as it is")
        told = len(sample["label"].get("frames", []))
        if "frames" in sample and not 0 < len(sample["frames"]) == told:
            said = f"a sample has {len(sample['frames'])} frames, and its label {told}"
            raise UsageError(f"{said}; keep at least one, and leave the same out of both")
    check_layers("frames", [frame for sample in each for frame in sample.get("frames", [])])
    return each


def check_layers(what: str, parts: list[dict[str, Any]]) -> None:
    """Refuses samples, or their frames, of which some have layers that others lack."""
    for part in parts:
        if set(part) != set(parts[0]):
            raise UsageError(
                f"{what} have different layers: one has {sorted(parts[0])}, one {sorted(part)}; give those of one dataset, "
                "or keep the layers that all have"
            )


def of_finger(grip: dict[str, Any], finger: str) -> Any:
    """What one finger has of a sample, as a press or a sequence of one sensor would."""
    label = grip["label"]
    if "frames" not in grip:
        return {**grip[finger], "label": label[finger]}
    frames = [frame[finger] for frame in grip["frames"]]
    return {"frames": frames, "label": {"sequence": label["sequence"], "frames": [frame[finger] for frame in label["frames"]]}}


def from_numpy() -> Callable[[Any], Any]:
    """`torch.from_numpy`."""
    try:
        torch = import_module("torch")
    except ImportError as error:
        raise ImportError(
            f"collate_torch gives tensors of PyTorch, which cannot be imported ({error}): pip install torch; gelsim.collate gives arrays"
        ) from error
    made: Callable[[Any], Any] = torch.from_numpy
    numpy = need("numpy")
    try:
        made(numpy.zeros(1))
    except RuntimeError as error:  # one that was built for another numpy can be imported, and then does not find it
        raise ImportError(
            f"torch {torch.__version__} cannot use numpy {numpy.__version__} ({error}): pip install 'numpy<2', or a newer torch"
        ) from error
    return made


def stacked(values: list[Any], tensor: Callable[[Any], Any]) -> Any:
    """One array of several of a shape; markers, pins and other shapes as a list."""
    numpy = need("numpy")
    arrays = all(isinstance(value, numpy.ndarray) for value in values)
    if arrays and len({value.shape for value in values}) == 1:
        return tensor(numpy.stack(values))
    return [tensor(value) for value in values] if arrays else values


def sequences(each: list[list[dict[str, Any]]], tensor: Callable[[Any], Any]) -> dict[str, Any]:
    """Layers of sequences, padded, and `mask`."""
    numpy = need("numpy")
    batch: dict[str, Any] = {}
    for name in each[0][0]:
        frames = [[frame[name] for frame in one] for one in each]
        arrays = all(isinstance(value, numpy.ndarray) for one in frames for value in one)
        if arrays and len({value.shape for one in frames for value in one}) == 1:
            batch[name] = tensor(padded([numpy.stack(one) for one in frames]))
        else:
            batch[name] = [[tensor(value) for value in one] for one in frames] if arrays else frames
    longest = max(map(len, each))
    batch["mask"] = tensor(numpy.array([[number < len(one) for number in range(longest)] for one in each]))
    return batch


def padded(arrays: list[Any]) -> Any:
    """Arrays of different lengths as one, with zeros after their ends."""
    numpy = need("numpy")
    whole = numpy.zeros((len(arrays), max(map(len, arrays)), *arrays[0].shape[1:]), arrays[0].dtype)
    for row, array in zip(whole, arrays):
        row[: len(array)] = array
    return whole
