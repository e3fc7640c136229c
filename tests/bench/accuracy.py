"""What accuracy costs in time: `python tests/bench/accuracy.py GELSIM [PART...]` prints the tables of docs/evidence/accuracy.md.

Each part renders the same samples with several settings, on one thread, and compares them with the last one, the most exact:
images pixel by pixel, forces of the labels. Times are the CPU time that the shards' statistics have, without encoding, the least
of three turns. Needs numpy and Pillow; three minutes for all parts on an idle machine.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

ROOT = Path(__file__).resolve().parents[2]
LEVELS = [(level, [f'fidelity="{level}"']) for level in ("draft", "standard", "high", "reference")]
LAYERS = "output.layers=[]"
TURNS = 3

# Of each part: its title, job, number of samples, settings of all, and each choice with its own, the most exact last.
PARTS = {
    "shadows": (
        "Shadows, at `standard`",
        "quickstart",
        24,
        ['fidelity="standard"'],
        [("none", ['optics.phong.shadows="none"'])]
        + [(grid, [f'optics.phong.shadows={{soft={{resolution="{grid}"}}}}']) for grid in ("quarter", "half", "full")],
    ),
    "friction": (
        "Friction of the pad, at `standard`",
        "quickstart",
        24,
        # A model of one's own has the full grid, if none is named.
        ['fidelity="standard"', 'gelpad.elastic.resolution="half"'],
        [
            ("none", []),
            ("Coulomb, 0.5", ["gelpad.elastic.friction={coulomb={coefficient=0.5}}"]),
            ("stick", ['gelpad.elastic.friction="stick"']),
        ],
    ),
    "curved": ("A fingertip, 320x240", "fingertip", 16, [], LEVELS),
    "sequences": ("Fidelity of a slip at 25 frames a second", "slip", 4, [], LEVELS),
    "rate": (
        "Frames a second of a slip, at `standard`",
        "slip",
        4,
        # Noise and speckle are drawn anew for each frame.
        ['fidelity="standard"', "camera.shot_noise_levels=0", "camera.read_noise_levels=0", "camera.speckle_levels=0"],
        [(str(rate), [f"sequence.frame_rate_hz={rate}.0"]) for rate in (10, 25, 50, 100, 200)],
    ),
}


def render(program, job, samples, settings, out):
    command = [program, "generate", str(ROOT / "configs" / f"{job}.toml"), "--quiet", "--threads", "1"]
    command += ["--samples", str(samples), "--out", str(out)]
    for setting in [*settings, LAYERS, 'output.container="folder"']:
        command += ["--set", setting]
    subprocess.run(command, check=True)
    stats = [json.loads(path.read_text()) for path in sorted(out.glob("stats/*.json"))]
    cpu_s = sum(seconds for one in stats for stage, seconds in one["seconds"].items() if stage != "encode")
    images, forces, model = {}, {}, []
    for path in sorted(out.glob("data/*/*.json")):
        label = json.loads(path.read_text())
        # A sequence's frames are told apart by their time, in ms: those of all rates meet.
        for frame in label.get("frames", [label]):
            sequence = "frames" in label
            name = f"{label['key']}.f{frame['index']:04}" if sequence else label["key"]
            at = (label["key"], round(1000 * frame["t_s"]) if sequence else 0)
            images[at] = path.parent / f"{name}.tactile.png"
            force = frame["wrench"]["force_n"] if sequence else frame["contact"]["force_n"]
            forces[at] = force if sequence or force is None else [force]
            if frame["numerics"].get("model_error_um") is not None:
                model.append(frame["numerics"]["model_error_um"])
    return 1e3 * cpu_s / samples, images, forces, model


def difference(images, exact):
    both = images.keys() & exact.keys()
    pixels = lambda path: np.asarray(Image.open(path).convert("RGB"), np.float32)
    return [float(np.abs(pixels(images[at]) - pixels(exact[at])).mean()) for at in sorted(both)]


def off_percent(forces, exact):
    """Root mean square difference as a share of the largest force."""
    both = [at for at in sorted(forces.keys() & exact.keys()) if forces[at] is not None and exact[at] is not None]
    if not both:
        return None
    own, true = (np.array([of[at] for at in both]) for of in (forces, exact))
    largest = np.linalg.norm(true, axis=1).max()
    return 100 * float(np.sqrt(((own - true) ** 2).sum(axis=1).mean())) / max(largest, 1e-9)


def table(program, name):
    title, job, samples, shared, choices = PARTS[name]
    print(f"\n{title} (`configs/{job}.toml`, {samples} samples)\n")
    print("| choice | CPU ms | image | force % | model um |")
    print("|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        place = lambda turn, k: Path(folder) / f"{turn}-{k}"
        turns = [
            [render(program, job, samples, shared + own, place(turn, k)) for k, (_, own) in enumerate(choices)]
            for turn in range(TURNS)
        ]
        runs = turns[0]
        exact = runs[-1]
        for k, ((label, _), (_, images, forces, model)) in enumerate(zip(choices, runs)):
            cpu_ms = min(turn[k][0] for turn in turns)
            levels, force = np.mean(difference(images, exact[1])), off_percent(forces, exact[2])
            force = "" if force is None else f"{force:.2f}"
            model = f"{np.median(model):.0f}" if model else ""
            print(f"| {label} | {cpu_ms:.1f} | {levels:.3f} | {force} | {model} |", flush=True)


if __name__ == "__main__":
    program, *names = sys.argv[1:] or sys.exit(__doc__)
    unknown = [name for name in names if name not in PARTS]
    if unknown:
        sys.exit(f"no part {unknown[0]}: {', '.join(PARTS)}")
    for name in names or PARTS:
        table(program, name)
