"""Checks the figures of `gelsim compare` against scikit-image, scipy and numpy, on images made here.

    python compare.py GELSIM
"""

import csv
import json
import os
import subprocess
import sys
import tempfile

import numpy
from PIL import Image
from scipy.stats import wasserstein_distance
from skimage.metrics import peak_signal_noise_ratio, structural_similarity

random = numpy.random.default_rng(3)
DILATE = 1.3


def made(width, height, x, y, radius):
    """A real image with a dent, and a simulated one that is softer, bluer and has less grain."""
    column, row = numpy.meshgrid(numpy.arange(width), numpy.arange(height))
    distance = numpy.hypot(column - x, row - y)
    inside = distance[..., None] < radius
    ramp = numpy.stack([90 + 0.2 * column, 120 - 0.1 * row, 100 + 0.1 * column], axis=-1)
    light = numpy.stack([column - x, row - y, x - column], axis=-1) * 1.4
    real = ramp + inside * light + random.normal(0, 3, ramp.shape)
    soft = 1 / (1 + numpy.exp((distance[..., None] - radius) / 2))
    sim = ramp + soft * light + [0, 0, 4] + random.normal(0, 1, ramp.shape)
    return [numpy.clip(numpy.rint(image), 0, 255).astype("uint8") for image in (real, sim)]


def scores(real, sim, mask):
    ssim, full = structural_similarity(
        real, sim, channel_axis=2, gaussian_weights=True, sigma=1.5, use_sample_covariance=False, data_range=255, full=True
    )
    error = numpy.abs(real.astype(float) - sim)
    whole = [error.mean(), peak_signal_noise_ratio(real, sim, data_range=255), ssim]
    a, b = real[mask], sim[mask]
    return whole + [error[mask].mean(), peak_signal_noise_ratio(a, b, data_range=255), full[mask].mean()]


def octaves(images):
    """Mean power density of grey images under a Hann window in octaves of frequency, the finest one first."""
    powers = []
    for image in images:
        grey = image.astype(float).mean(axis=2)
        hann = [0.5 - 0.5 * numpy.cos(2 * numpy.pi * (numpy.arange(n) + 0.5) / n) for n in grey.shape]
        window = numpy.outer(*hann)
        size = [4 * n for n in grey.shape]
        spectrum = numpy.fft.fft2(window * (grey - (window * grey).sum() / window.sum()), size)
        frequency = numpy.hypot(numpy.fft.fftfreq(size[0])[:, None], numpy.fft.fftfreq(size[1])[None])
        bands = [(frequency > 0.25 / 2**k) & (frequency <= 0.5 / 2**k) for k in range(6)]
        powers.append([(numpy.abs(spectrum[band]) ** 2).mean() / (window**2).sum() for band in bands])
    return numpy.mean(powers, axis=0) + 1 / 36


def slopes(images):
    greys = [image.astype(float).mean(axis=2) for image in images]
    across = [(grey[1:-1, 2:] - grey[1:-1, :-2]) / 2 for grey in greys]
    down = [(grey[2:, 1:-1] - grey[:-2, 1:-1]) / 2 for grey in greys]
    return numpy.concatenate([numpy.hypot(a, d).ravel() for a, d in zip(across, down)])


def near(found, expected, within, what):
    assert abs(found - expected) <= within, f"{what}: {found} instead of {expected}"


with tempfile.TemporaryDirectory() as root:
    expected, sets = {}, {}
    for sensor, width, height in [("small", 160, 130), ("large", 321, 240)]:
        os.makedirs(f"{root}/real/{sensor}/images")
        os.makedirs(f"{root}/sim/{sensor}")
        sets[sensor] = ([], [])
        with open(f"{root}/real/{sensor}/annotations.csv", "w") as table:
            print("file,centre_x_px,centre_y_px,radius_px,note", file=table)
            for k in range(4):
                # The last circle reaches over the border.
                x, y, radius = [(50.5, 60.0, 20.0), (80.25, 70.5, 31.5), (70.0, 64.0, 12.0), (8.0, 5.0, 22.0)][k]
                real, sim = made(width, height, x, y, radius)
                Image.fromarray(real).save(f"{root}/real/{sensor}/images/{k}.png")
                Image.fromarray(sim).save(f"{root}/sim/{sensor}/{k}.png")
                print(f'images/{k}.png,{x},{y},{radius},"a, b"', file=table)
                column, row = numpy.meshgrid(numpy.arange(width), numpy.arange(height))
                mask = numpy.hypot(column - x, row - y) <= DILATE * radius
                expected[sensor, f"images/{k}.png"] = scores(real, sim, mask)
                sets[sensor][0].append(real)
                sets[sensor][1].append(sim)
    command = [sys.argv[1], "compare", f"{root}/real", f"{root}/sim", "--out", f"{root}/out", "--dilate", str(DILATE)]
    subprocess.run(command, check=True, stdout=subprocess.PIPE)

    names = ["mae", "psnr_db", "ssim", "contact_mae", "contact_psnr_db", "contact_ssim"]
    worst = 0.0
    with open(f"{root}/out/compare.csv", newline="") as table:
        rows = list(csv.DictReader(table))
    assert len(rows) == len(expected)
    for row in rows:
        for name, value in zip(names, expected[row["sensor"], row["file"]]):
            near(float(row[name]), value, 1e-4, f"{row['sensor']} {row['file']} {name}")
            worst = max(worst, abs(float(row[name]) - value))

    result = json.load(open(f"{root}/out/compare.json"))
    means = numpy.mean(list(expected.values()), axis=0)
    total = result["total"]
    found = [total[part][name] for part in ("whole", "contact") for name in names[:3]]
    for name, value, mean in zip(names, found, means):
        near(value, mean, 1e-4, f"total {name}")
    for sensor in result["sensors"]:
        real, sim = sets[sensor["sensor"]]
        distances = sensor["distances"]
        for k, channel in enumerate(distances["channels"]):
            a, b = [numpy.concatenate([image[..., k].ravel() for image in images]) for images in (real, sim)]
            near(channel["emd"], wasserstein_distance(a, b), 1e-6, "levels")
            near(channel["mean_shift"], b.mean() - a.mean(), 1e-6, "shift")
            near(channel["deviation_ratio"], b.std() / a.std(), 1e-6, "deviation")
        a, b = slopes(real), slopes(sim)
        near(distances["slopes"]["mean_ratio"], b.mean() / a.mean(), 1e-6, "slopes")
        # Slopes are counted in bins of an eighth of a level.
        near(distances["slopes"]["emd"], wasserstein_distance(a, b), 0.13, "slopes' distance")
        edges = [numpy.sort(s)[-round(0.05 * len(s)) :].mean() for s in (a, b)]
        near(distances["slopes"]["edge_ratio"], edges[1] / edges[0], 0.01, "edges")
        logs = numpy.log10(octaves(sim) / octaves(real))
        for octave, log in zip(distances["octaves"], logs):
            # Over another grid of frequencies: the coarsest octave holds few of them.
            near(octave["log10_ratio"], log, 0.03, f"octave {octave['cycles_per_px']}")
        assert "blue" in sensor["verdict"] and "too bright" in sensor["verdict"], sensor["verdict"]
    assert Image.open(f"{root}/out/compare.png").width > 3 * 321
print(f"figures of {len(rows)} pairs as scikit-image has them, within {worst:.1e}; sets as scipy and numpy have them")
