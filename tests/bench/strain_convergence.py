"""How far finite strain has converged on the bundled objects: `python tests/bench/strain_convergence.py GELSIM`.

Presses every object of `objects/` 0.1, 0.2 and 0.3 of the pad deep, at the level `finite-strain` at 320x240 px, with the usual box and
with nodes two thirds as far apart (`gelpad.finite_strain.box_mm`). Prints the root mean square of what lies between both
surfaces within 2 mm outside the contacts, um, beside what linear theory is off by; `-` where a press was not solved or its edges were
rounded differently. Needs numpy; ten minutes on one core.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from model_error import grown

ROOT = Path(__file__).resolve().parents[2]
THICKNESS_MM = 3.0
DEPTHS = (0.1, 0.2, 0.3)
FINER_MM = THICKNESS_MM / 15
JOB = """
[dataset]
name = "convergence"
samples = 1
[[object]]
path = "{path}"
[indentation]
depth_mm = {depth}
[sensor]
resolution_px = [320, 240]
gelpad_thickness_mm = 3.0
[output]
layers = ["surface", "gap"]
depth_format = "npy"
container = "folder"
"""


def press(program, folder, path, depth, name, *settings):
    """Label and layers of a press."""
    job, out = folder / "job.toml", folder / name
    job.write_text(JOB.format(path=path, depth=depth))
    command = [program, "generate", str(job), "--quiet", "--overwrite", "--out", str(out)]
    subprocess.run([*command, *(part for setting in settings for part in ("--set", setting))], check=True)
    label = next(out.glob("data/*/*.json"))
    key = label.with_suffix("")
    layers = (np.squeeze(np.load(f"{key}.{layer}.npy")) for layer in ("surface", "gap"))
    return json.loads(label.read_text()), *layers


def main():
    program = sys.argv[1]
    within = 0
    print("object              " + "".join(f"{depth:>20}" for depth in DEPTHS) + "   (grid against a finer one; linear), um")
    paths = sorted((ROOT / "objects").glob("*.obj"))
    for path in paths:
        cells, good = [], True
        for depth in DEPTHS:
            with tempfile.TemporaryDirectory() as name:
                folder = Path(name)
                arguments = (program, folder, path, depth * THICKNESS_MM)
                linear = press(*arguments, "linear", 'fidelity="high"')
                usual, finer = (
                    press(*arguments, name, 'fidelity="finite-strain"', *more)
                    for name, more in (("usual", ()), ("finer", (f"gelpad.finite_strain.box_mm={FINER_MM}",)))
                )
            numerics = [label["numerics"] for label, *_ in (usual, finer)]
            alike = numerics[0]["opened_mm"] == numerics[1]["opened_mm"]
            if not alike or any(of["theory"] != "finite_strain" for of in numerics):
                cells.append("-")
                good = False
                continue
            touching = (usual[2] == 0) | (finer[2] == 0) | (linear[2] == 0)
            ring = grown(touching, usual[0]["sensor"]["mm_per_px"]) & ~touching
            apart, off = (1e3 * np.sqrt(np.mean((a - finer[1])[ring] ** 2)) for a in (usual[1], linear[1]))
            cells.append(f"{apart:.2f}; {off:.1f}")
            good &= apart <= 2.0
        within += good
        print(f"{path.stem:20}" + "".join(f"{cell:>20}" for cell in cells), flush=True)
    print(f"{within} of {len(paths)} objects within 2 um at every depth")


main()
