"""Figures of `gelsim compare` against scikit-image, scipy and numpy, on images made here."""

import csv
import json

import pytest

for name, package in [("numpy", "numpy"), ("PIL", "pillow"), ("scipy", "scipy"), ("skimage", "scikit-image")]:
    pytest.importorskip(name, reason=f"no {package}: pip install {package}")

import numpy
from PIL import Image
from scipy.stats import wasserstein_distance
from skimage.metrics import peak_signal_noise_ratio, structural_similarity

DILATE = 1.3
SENSORS = {"small": (160, 130), "large": (321, 240)}
# x, y and radius of dents; the last circle reaches over the border.
DENTS = [(50.5, 60.0, 20.0), (80.25, 70.5, 31.5), (70.0, 64.0, 12.0), (8.0, 5.0, 22.0)]
FIGURES = ["mae", "psnr_db", "ssim", "contact_mae", "contact_psnr_db", "contact_ssim"]


def make(random, width, height, x, y, radius):
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


def scores(real, sim, x, y, radius):
    """Figures of a pair: of all of it and of the dilated circle."""
    column, row = numpy.meshgrid(numpy.arange(real.shape[1]), numpy.arange(real.shape[0]))
    mask = numpy.hypot(column - x, row - y) <= DILATE * radius
    ssim, each = structural_similarity(
        real, sim, channel_axis=2, gaussian_weights=True, sigma=1.5, use_sample_covariance=False, data_range=255,
        full=True,
    )  # fmt: skip
    error = numpy.abs(real.astype(float) - sim)
    whole = [error.mean(), peak_signal_noise_ratio(real, sim, data_range=255), ssim]
    a, b = real[mask], sim[mask]
    return whole + [error[mask].mean(), peak_signal_noise_ratio(a, b, data_range=255), each[mask].mean()]


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


@pytest.fixture(scope="module")
def images():
    """Real and simulated images of each sensor."""
    random = numpy.random.default_rng(3)
    return {sensor: list(zip(*(make(random, *size, *dent) for dent in DENTS))) for sensor, size in SENSORS.items()}


@pytest.fixture(scope="module")
def out(images, run_gelsim, tmp_path_factory):
    """What `gelsim compare` writes."""
    root = tmp_path_factory.mktemp("compare")
    for sensor, (reals, sims) in images.items():
        (root / "real" / sensor / "images").mkdir(parents=True)
        (root / "sim" / sensor).mkdir(parents=True)
        rows = ["file,centre_x_px,centre_y_px,radius_px,note"]
        for k, (real, sim, (x, y, radius)) in enumerate(zip(reals, sims, DENTS)):
            Image.fromarray(real).save(root / "real" / sensor / f"images/{k}.png")
            Image.fromarray(sim).save(root / "sim" / sensor / f"{k}.png")
            rows.append(f'images/{k}.png,{x},{y},{radius},"a, b"')
        (root / "real" / sensor / "annotations.csv").write_text("\n".join(rows) + "\n")
    run_gelsim("compare", root / "real", root / "sim", "--out", root / "out", "--dilate", DILATE)
    return root / "out"


@pytest.fixture(scope="module")
def expected(images):
    """Figures of each pair, as scikit-image has them."""
    return {
        (sensor, f"images/{k}.png"): scores(real, sim, *DENTS[k])
        for sensor, pairs in images.items()
        for k, (real, sim) in enumerate(zip(*pairs))
    }


def near(expected, within):
    return pytest.approx(expected, rel=0, abs=within)


@pytest.fixture(scope="module")
def rows(out):
    with open(out / "compare.csv", newline="") as table:
        return list(csv.DictReader(table))


def test_every_pair_has_a_row(rows, expected):
    assert len(rows) == len(expected)


@pytest.mark.parametrize("name", FIGURES)
def test_figures_of_each_pair_are_scikit_images(rows, expected, name):
    for row in rows:
        known = expected[row["sensor"], row["file"]][FIGURES.index(name)]
        assert float(row[name]) == near(known, 1e-4), (row["sensor"], row["file"])


@pytest.fixture(scope="module")
def result(out):
    return json.loads((out / "compare.json").read_text())


def test_the_totals_are_means_over_all_pairs(result, expected):
    found = [result["total"][part][name] for part in ("whole", "contact") for name in FIGURES[:3]]
    assert found == near(numpy.mean(list(expected.values()), axis=0).tolist(), 1e-4)


@pytest.fixture(scope="module", params=[0, 1], ids=["first sensor", "second sensor"])
def sensor(request, result, images):
    """What is said of a sensor, and its real and simulated images."""
    assert len(result["sensors"]) == len(images)
    found = result["sensors"][request.param]
    return found, *images[found["sensor"]]


def test_levels_are_compared_as_scipy_and_numpy_do(sensor):
    found, *sets = sensor
    assert len(found["distances"]["channels"]) == 3
    for k, channel in enumerate(found["distances"]["channels"]):
        real, sim = [numpy.concatenate([image[..., k].ravel() for image in images]) for images in sets]
        assert channel["emd"] == near(wasserstein_distance(real, sim), 1e-6)
        assert channel["mean_shift"] == near(sim.mean() - real.mean(), 1e-6)
        assert channel["deviation_ratio"] == near(sim.std() / real.std(), 1e-6)


def test_slopes_are_compared_as_scipy_and_numpy_do(sensor):
    found, real, sim = sensor
    a, b = slopes(real), slopes(sim)
    distances = found["distances"]["slopes"]
    assert distances["mean_ratio"] == near(b.mean() / a.mean(), 1e-6)
    # Slopes are counted in bins of an eighth of a level.
    assert distances["emd"] == near(wasserstein_distance(a, b), 0.13)
    edges = [numpy.sort(s)[-round(0.05 * len(s)) :].mean() for s in (a, b)]
    assert distances["edge_ratio"] == near(edges[1] / edges[0], 0.01)


def test_octaves_are_compared_as_numpy_does(sensor):
    found, real, sim = sensor
    logs = numpy.log10(octaves(sim) / octaves(real))
    assert found["distances"]["octaves"]
    for octave, log in zip(found["distances"]["octaves"], logs):
        # Over another grid of frequencies: the coarsest octave holds few of them.
        assert octave["log10_ratio"] == near(log, 0.03), octave["cycles_per_px"]


def test_the_verdict_names_the_blue_that_is_too_bright(sensor):
    verdict = sensor[0]["verdict"]
    assert "blue" in verdict and "too bright" in verdict


def test_the_picture_shows_all_three_columns(out):
    assert Image.open(out / "compare.png").width > 3 * SENSORS["large"][0]
