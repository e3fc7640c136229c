"""Loads a dataset with several workers of PyTorch's DataLoader, or by its `wids` index.

    python batches.py DATASET_DIR {workers,wids}
"""

import glob
import json
import sys
from collections import Counter

from torch.utils.data import DataLoader, get_worker_info

out, what = sys.argv[1:]
manifest = json.load(open(f"{out}/dataset.json"))


def once(keys, count):
    """Each of `count` samples was seen exactly once."""
    keys = list(keys)
    assert len(keys) == len(set(keys)) == count, (len(keys), len(set(keys)), count)


def with_worker(sample):
    return sample["__key__"], sample["__url__"], get_worker_info().id


def in_workers(split):
    """Keys of the samples of a split, by two workers."""
    if not manifest["shards"][0]["file"].endswith(".tar"):
        from datasets import load_dataset

        batches = DataLoader(load_dataset(out, split=split), batch_size=4, shuffle=True, num_workers=2, collate_fn=list)
        return (row["key"] for batch in batches for row in batch)
    import webdataset

    shards = sorted(glob.glob(f"{out}/data/{split}-*.tar"))
    samples = webdataset.WebDataset(shards, shardshuffle=False, empty_check=False).decode("rgb8").map(with_worker)
    seen = list(DataLoader(samples, batch_size=None, num_workers=2))
    readers = {(url, worker) for _, url, worker in seen}
    assert len(readers) == len(shards), "each shard is read by one worker"
    assert len({worker for _, worker in readers}) == min(2, len(shards)), "every worker has shards"
    return (key for key, _, _ in seen)


if what == "workers":
    for split, count in manifest["splits"].items():
        once(in_workers(split), count)
else:
    import wids

    samples = wids.ShardListDataset(f"{out}/wids.json")
    assert len(samples) == manifest["samples"]
    batches = DataLoader(samples, batch_size=4, shuffle=True, num_workers=2, collate_fn=list)
    once((sample[".json"]["key"] for batch in batches for sample in batch), manifest["samples"])
    last = samples[len(samples) - 1]
    assert last["__key__"] == last[".json"]["key"]
    splits = Counter(samples[number][".json"]["split"] for number in range(len(samples)))
    assert splits == manifest["splits"], splits
