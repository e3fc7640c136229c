"""Trains a small network to read from a tactile image where and how deep an object is pressed, or which class it has.

    python docs/first-hour/train.py DATASET [EPOCHS] [class]

Needs PyTorch and gelsim[load]. Prints the error on every fifth sample, which the network never sees, after each epoch.
"""

import sys
import time

import gelsim
import torch
from torch import nn
from torch.utils.data import DataLoader, Subset

SIZE = 80
"""What the longer side of images is reduced to, px."""


class Place:
    """Middle of the contact, x and y, and largest depth of the object in the pad, mm."""

    def __init__(self, labels):
        self.outputs = 3
        known = self.goals(labels)
        self.mean, self.spread = known.mean(0), known.std(0)

    def goals(self, labels):
        contacts = [label["contact"] for label in labels]
        return torch.tensor([[*contact["centroid_mm"], contact["max_depth_mm"]] for contact in contacts])

    def loss(self, output, labels):
        return ((output - (self.goals(labels) - self.mean) / self.spread) ** 2).mean()

    def said(self, output, labels):
        off = torch.abs(output * self.spread + self.mean - self.goals(labels)).mean(0)
        return f"x, y {off[:2].mean():.2f} mm, depth {off[2]:.3f} mm off"


class Kind:
    """The object's class."""

    def __init__(self, labels):
        self.outputs = 1 + int(self.goals(labels).max())

    def goals(self, labels):
        return torch.tensor([label["object"]["class_index"] for label in labels])

    def loss(self, output, labels):
        return nn.functional.cross_entropy(output, self.goals(labels))

    def said(self, output, labels):
        return f"{(output.argmax(1) == self.goals(labels)).float().mean():.3f} right"


def main(folder, epochs=8, learned="place"):
    torch.manual_seed(0)
    dataset = gelsim.load(folder)
    touching = [index for index in range(len(dataset)) if dataset[index]["label"]["contact"]["in_contact"]]
    train, val = [i for i in touching if i % 5], [i for i in touching if i % 5 == 0]

    labels = {index: dataset[index]["label"] for index in touching}
    wanted = {"place": Place, "class": Kind}[learned]([labels[index] for index in touching])
    rows, columns = (-(-SIZE * side // max(dataset[0]["tactile"].shape)) for side in dataset[0]["tactile"].shape[:2])
    channels = [3, 16, 32, 64]
    layers = []
    for before, after in zip(channels, channels[1:]):
        layers += [nn.Conv2d(before, after, 5, stride=2, padding=2), nn.ReLU()]
    inner = 64 * -(-rows // 8) * -(-columns // 8)
    head = [nn.Flatten(), nn.Linear(inner, 64), nn.ReLU(), nn.Linear(64, wanted.outputs)]
    network = nn.Sequential(nn.AdaptiveAvgPool2d((rows, columns)), *layers, *head)
    optimizer = torch.optim.Adam(network.parameters(), 1e-3)

    def batches(indices, shuffle):
        workers = {"num_workers": 2, "persistent_workers": True}
        return DataLoader(Subset(dataset, indices), 20, shuffle=shuffle, collate_fn=gelsim.collate_torch, **workers)

    def predict(batch):
        return network(batch["tactile"].permute(0, 3, 1, 2).float() / 64 - 2)

    known, held_out = batches(train, shuffle=True), batches(val, shuffle=False)
    unseen = [labels[index] for index in val]
    nothing = torch.zeros(len(val), wanted.outputs)
    print(f"{len(train)} samples to learn from, {len(val)} held out; without looking: {wanted.said(nothing, unseen)}")
    begun = time.monotonic()
    for epoch in range(epochs):
        for batch in known:
            loss = wanted.loss(predict(batch), batch["label"])
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
        with torch.no_grad():
            output = torch.cat([predict(batch) for batch in held_out])
        print(f"epoch {epoch + 1}: {wanted.said(output, unseen)}, {time.monotonic() - begun:.0f} s", flush=True)


if __name__ == "__main__":
    main(sys.argv[1], *map(int, sys.argv[2:3]), *sys.argv[3:4])
