"""Pictures by the package `taxim` for tests/taxim/package.rs: of a ball, a random smooth surface and a steep one.

    pip install taxim==1.4.1 jax
    python taxim_pictures.py OUT [--double]
    GELSIM_TAXIM=OUT cargo test --release --test library taxim

Shown is the package's shading alone: its approximation of the pad is replaced by the surface itself, and it casts no
shadows. `--double` lets it compute in double precision. jax takes about 400 MB.
"""

import sys
from pathlib import Path

import jax

jax.config.update("jax_enable_x64", "--double" in sys.argv)

import numpy
from taxim.calibration import CALIB_GELSIGHT, CALIB_GELSIGHT_MINI
from taxim.taxim_jax import TaximJax

out = Path(sys.argv[1])


def surfaces(height, width, pitch):
    """Displacement into the pad, mm, single precision, with a ring of pixels around the view."""
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


for name, folder in [("gelsight", CALIB_GELSIGHT), ("gelsight_mini", CALIB_GELSIGHT_MINI)]:
    (out / name).mkdir(parents=True, exist_ok=True)
    for file in ["polycalib.npz", "dataPack.npz", "params.json"]:
        link = out / name / file
        link.unlink(missing_ok=True)
        link.symlink_to(folder / file)
    taxim = TaximJax(folder)
    # The surface as it is, instead of the package's blurs of the object's.
    taxim._TaximJax__compute_gel_pad_deformation = lambda surface: (surface, surface < 0)
    for shape, surface in surfaces(taxim.height, taxim.width, taxim.sensor_params.pixmm):
        surface = surface.astype(numpy.float32)
        inner = -surface[1:-1, 1:-1]
        picture = taxim.render(inner.astype(float) if "--double" in sys.argv else inner, with_shadow=False)
        picture = 255 * numpy.asarray(picture, float)
        numpy.savez_compressed(out / name / f"{shape}.npz", height=surface, picture=picture.astype(numpy.float32))
        print(name, shape, surface.shape, picture.min(), picture.max())
