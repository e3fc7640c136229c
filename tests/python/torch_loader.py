"""A job of the Python module in PyTorch's DataLoader.

    python torch_loader.py JOB.toml {fork,spawn,alone}          where the wheel and torch are installed
"""

import sys

import gelsim
import numpy as np
import torch
from torch.utils.data import DataLoader, Subset


def main(path, method):
    job = gelsim.Job.load(path)
    truth = [sample["tactile"] for sample in job.samples(range(len(job)))]
    how = {"num_workers": 0} if method == "alone" else {"num_workers": 2, "multiprocessing_context": method}
    seen = {}
    for batch in DataLoader(job, batch_size=5, shuffle=True, collate_fn=gelsim.collate_torch, **how):
        indices = [label["index"] for label in batch["label"]]
        assert batch["tactile"].dtype == torch.uint8 and batch["depth"].dtype == torch.float32
        assert batch["tactile"].shape == (len(indices), *truth[0].shape)
        assert all(label["object"]["class"] for label in batch["label"])
        seen |= {index: image.numpy() for index, image in zip(indices, batch["tactile"])}
    assert sorted(seen) == list(range(len(job))), sorted(seen)
    assert all(np.array_equal(seen[index], image) for index, image in enumerate(truth))
    part = DataLoader(Subset(job, job.indices("train")), batch_size=None, num_workers=how["num_workers"])
    assert sum(1 for _ in part) == len(job.indices("train"))


# Workers that are spawned import this file.
if __name__ == "__main__":
    main(*sys.argv[1:])
