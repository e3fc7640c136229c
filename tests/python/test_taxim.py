"""Shading against the package `taxim`: its pictures of a ball, a random smooth surface and a steep one, for
tests/taxim/package.rs.

    pip install taxim==1.4.1 jax                        (400 MB)
    pytest tests/python/test_taxim.py --full -rP        shows how far pixels are off

Shown is the package's shading alone: its approximation of the pad is replaced by the surface itself, and it casts no
shadows.
"""

import os
import shutil

import pytest
from processes import run

pytestmark = [pytest.mark.full, pytest.mark.build]


def surfaces(numpy, height, width, pitch):
    """Displacement into the pad, mm, with a ring of pixels around the view."""
    y, x = numpy.mgrid[-1 : height + 1, -1 : width + 1].astype(float)
    x, y = (x - (width - 1) / 2) * pitch, (y - (height - 1) / 2) * pitch
    # Its middle on a pixel, so that slopes along its axes are exactly 0.
    r2 = (x - 10.5 * pitch) ** 2 + (y + 6.5 * pitch) ** 2
    yield "sphere", numpy.maximum(numpy.sqrt(numpy.maximum(16 - r2, 0)) - 2.5, 0)

    def waves(seed, count, shortest, longest):
        random = numpy.random.default_rng(seed)
        total = numpy.zeros_like(x)
        for _ in range(count):
            length = random.uniform(shortest, longest)
            turn, phase = random.uniform(0, 2 * numpy.pi, 2)
            along = x * numpy.cos(turn) + y * numpy.sin(turn)
            total += length * numpy.sin(2 * numpy.pi * along / length + phase)
        return total

    yield "smooth", 1.5 + 0.02 * waves(1, 12, 2, 8)
    yield "steep", 3.0 + 0.15 * waves(2, 12, 0.6, 3)


@pytest.fixture(scope="module")
def pictures(tmp_path_factory):
    """A folder with each calibration of the package, and its pictures."""
    for module in ["jax", "taxim"]:
        pytest.importorskip(module, reason="no taxim: pip install taxim==1.4.1 jax (400 MB)")
    import numpy
    from taxim.calibration import CALIB_GELSIGHT, CALIB_GELSIGHT_MINI
    from taxim.taxim_jax import TaximJax

    out = tmp_path_factory.mktemp("taxim")
    for name, folder in [("gelsight", CALIB_GELSIGHT), ("gelsight_mini", CALIB_GELSIGHT_MINI)]:
        (out / name).mkdir()
        for file in ["polycalib.npz", "dataPack.npz", "params.json"]:
            (out / name / file).symlink_to(folder / file)
        taxim = TaximJax(folder)
        # The surface as it is, instead of the package's blurs of the object's.
        taxim._TaximJax__compute_gel_pad_deformation = lambda surface: (surface, surface < 0)
        for shape, surface in surfaces(numpy, taxim.height, taxim.width, taxim.sensor_params.pixmm):
            surface = surface.astype(numpy.float32)
            picture = 255 * numpy.asarray(taxim.render(-surface[1:-1, 1:-1], with_shadow=False), float)
            numpy.savez_compressed(out / name / f"{shape}.npz", height=surface, picture=picture.astype(numpy.float32))
    return out


def test_pictures_agree_with_the_packages(project, pictures):
    if not shutil.which("cargo"):
        pytest.skip("no cargo: https://rustup.rs")
    line = "cargo test --release --locked --test library taxim -- --nocapture"
    said = run(*line.split(), cwd=project, env={**os.environ, "GELSIM_TAXIM": str(pictures)}).stdout
    print(said)
    assert "left out" not in said
