"""Trains a small network to read from a tactile image where and how deep an object is pressed.

    python docs/first-hour/train.py DATASET [EPOCHS]

Needs PyTorch and gelsim[load]. Prints the error on every fifth sample, which the network never sees, after each epoch.
"""

import sys
import time

import gelsim
import numpy as np
import torch
from torch import nn
from torch.utils.data import DataLoader, Subset

SIZE = 60, 80
"""Rows and columns that images are reduced to."""


def goals(labels):
    """Middle of the contact, x and y, and largest depth of the object in the pad, mm."""
    contacts = [label["contact"] for label in labels]
    return torch.tensor([[*contact["centroid_mm"], contact["max_depth_mm"]] for contact in contacts])


def main(folder, epochs=8):
    torch.manual_seed(0)
    dataset = gelsim.load(folder)
    touching = [index for index in range(len(dataset)) if dataset[index]["label"]["contact"]["in_contact"]]
    train, val = [i for i in touching if i % 5], [i for i in touching if i % 5 == 0]

    first = goals([dataset[index]["label"] for index in train])
    mean, spread = first.mean(0), first.std(0)
    channels = [3, 16, 32, 64]
    layers = []
    for before, after in zip(channels, channels[1:]):
        layers += [nn.Conv2d(before, after, 5, stride=2, padding=2), nn.ReLU()]
    network = nn.Sequential(nn.AdaptiveAvgPool2d(SIZE), *layers, nn.Flatten(), nn.Linear(64 * 8 * 10, 64), nn.ReLU(), nn.Linear(64, 3))
    optimizer = torch.optim.Adam(network.parameters(), 1e-3)

    def batches(indices, shuffle):
        workers = {"num_workers": 2, "persistent_workers": True}
        return DataLoader(Subset(dataset, indices), 20, shuffle=shuffle, collate_fn=gelsim.collate, **workers)

    def predict(batch):
        return network(batch["tactile"].permute(0, 3, 1, 2).float() / 64 - 2)

    learned, held_out = batches(train, shuffle=True), batches(val, shuffle=False)
    unseen = goals([dataset[index]["label"] for index in val])
    error = np.abs(unseen - mean).mean(0)
    print(f"{len(train)} samples to learn from, {len(val)} held out; always the mean: x, y {error[:2].mean():.2f} mm, depth {error[2]:.3f} mm off")
    begun = time.monotonic()
    for epoch in range(epochs):
        for batch in learned:
            loss = ((predict(batch) - (goals(batch["label"]) - mean) / spread) ** 2).mean()
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
        with torch.no_grad():
            errors = [torch.abs(predict(batch) * spread + mean - goals(batch["label"])) for batch in held_out]
        error = torch.cat(errors).mean(0)
        print(f"epoch {epoch + 1}: x, y {error[:2].mean():.2f} mm, depth {error[2]:.3f} mm off, {time.monotonic() - begun:.0f} s", flush=True)


if __name__ == "__main__":
    main(sys.argv[1], *map(int, sys.argv[2:3]))
