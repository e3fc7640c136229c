"""Trains small networks on simulated images and tests them on real presses that neither they nor the calibration saw.

    python tests/transfer/run.py GELSIM --real FOLDER [--set NAME ..] [--preset PRESET]
    python tests/transfer/run.py GELSIM --self-test

FOLDER, or FOLDER/NAME for each NAME, holds presses.csv and background.png (docs/evidence/transfer.md). Every third press is only
tested on; `gelsim calibrate` and the networks trained on real images see the others. Needs numpy and Pillow.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # one process for each row of the table instead
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import concurrent.futures
import csv
import json
import tempfile
import time
from pathlib import Path

import numpy
from PIL import Image

import data
import network

PRESETS = {"gsmini_gssdk": "gelsight-mini", "digit_fots": "digit", "gelsight_taxim": "gelsight-2017"}
# What differs between a real image and the same one simulated: gain, noise, and relief that no mesh has.
RANDOMIZED = """
[camera]
exposure = [0.98, 1.02]
red_gain = [0.98, 1.02]
blue_gain = [0.98, 1.02]
shot_noise_levels = [0.5, 2.0]
read_noise_levels = [0.5, 2.0]
[texture]
amplitude_mm = [0.0, 0.03]
scale_mm = [0.2, 1.0]
"""
HEADER = f"{'trained on':44} {'normal deg':>12} {'height um':>12} {'contact IoU':>14} {'depth um':>12} {'s':>5}"


def one(task):
    """Trains and tests one network; its errors, and the CPU seconds that the images took."""
    before = sum(os.times()[2:4])
    random = numpy.random.default_rng(task["seed"])
    parts = [task["real"]] if task["real"] else []
    if task["sensor"]:
        parts.append(data.simulated(seed=task["seed"], **task["sensor"]))
    images = sum(os.times()[2:4]) - before
    samples = [network.sample(part, task["pixels"] // len(parts) // len(part.change), random) for part in parts]
    inputs, labels = (numpy.concatenate(each) for each in zip(*samples))
    weights = network.train(inputs, labels, task["units"], task["steps"], random)
    tested, known = task["tested"], task["known"]
    depth = network.depth_errors(weights, [k[0] for k in known], [k[1] for k in known], tested.mm_per_px)
    depth = numpy.abs(depth).mean() if known else numpy.nan
    return [*network.errors(weights, tested), depth, images]


def line(name, results):
    """A row of the table: means over seeds, and half of what the seeds differ by."""
    results = numpy.array(results)
    means, spread = results.mean(axis=0), numpy.ptp(results, axis=0) / 2
    cells = []
    for at, (width, digits) in enumerate(((12, 2), (12, 0), (14, 3), (12, 0))):
        text = f"{means[at]:.{digits}f}"
        if len(results) > 1:
            text += f" +-{spread[at]:.{digits}f}"
        cells.append(("-" if numpy.isnan(means[at]) else text).rjust(width))
    return f"{name:44} {' '.join(cells)} {means[4]:5.0f}"


def transfer(given, folder, preset, work, pool):
    """The table of one sensor, printed; returns the means of each row."""
    started = time.monotonic()
    real = data.Real(folder)
    sensor = work / "sensor.toml"
    thickness, over_disc = real.calibrate(given.gelsim, sensor, given.calibration_steps, given.contact_over_disc)
    labels = real.labelled(given.gelsim, real.fitted + real.tested, thickness, over_disc, work)
    fitted, tested = labels[: len(real.fitted)], labels[len(real.fitted) :]
    known = [(real.change(path), depth) for path, depth in real.known]
    print(f"\n{folder.name}: {len(real.fitted)} presses fitted, {len(real.tested)} others tested, "
          f"{len(known)} of other shapes; pad {thickness:g} mm, contact {over_disc:g} of the disc; "
          f"calibrated in {time.monotonic() - started:.0f} s")

    view = [size * real.mm_per_px for size in real.size]
    # Heights within those of the fitted presses: beyond them calibrated optics have no data.
    depth, radius = float(fitted.surface.max()), max(row["ball_radius_mm"] for row in real.fitted)

    def images(sensor, extra="", sizes=(0.8, 1, 1.3, 1.8), balls=given.balls, **others):
        return dict(gelsim=given.gelsim, sensor=sensor, view_mm=view, depth_mm=depth, samples=given.samples,
                    radii=[size * radius for size in sizes], extra=extra, balls=balls, **others)

    calibrated = f'file = "{sensor}"'
    rows = []
    if preset:
        named = f'file = "{Path(preset).resolve()}"' if preset.endswith(".toml") else f'preset = "{preset}"'
        own = f'{named}\nresolution_px = {list(real.size)}\nfield_of_view_mm = {view}\n'
        photo = own + f'background = "{real.background_file}"\n'
        rows += [
            (f"preset {preset}", None, images(own)),
            ("preset, randomized", None, images(own, RANDOMIZED)),
            ("preset, real background, randomized", None, images(photo, RANDOMIZED)),
        ]
    else:
        print("no preset is named after this sensor: preset rows are skipped (--preset)")
    rows += [
        ("calibrated", None, images(calibrated)),
        ("calibrated, randomized", None, images(calibrated, RANDOMIZED)),
        ("calibrated, randomized, the ball only", None, images(calibrated, RANDOMIZED, sizes=[1], balls=1)),
        ("real presses only", fitted, None),
        ("real and calibrated, randomized", fitted, images(calibrated, RANDOMIZED)),
    ]
    if not given.quick:
        rows += [(f"calibrated, randomized, fidelity {level}", None, images(calibrated, RANDOMIZED, fidelity=level))
                 for level in ("paper", "draft", "high")]
    if given.self_test:
        rows = [row for row in rows if row[0] == "calibrated, randomized"]
    print(HEADER)
    deepest = numpy.mean([1000 * depth for _, depth in known]) if known else numpy.nan
    flat = [*network.errors(None, tested, flat=True), deepest, 0]
    print(line("nothing (flat)", [flat]))
    common = dict(tested=tested, known=known, units=given.units, steps=given.steps, pixels=given.pixels)
    running = [[pool.submit(one, dict(seed=seed, real=of, sensor=images_of, **common)) for seed in range(given.seeds)]
               for _, of, images_of in rows]
    means = {"nothing (flat)": flat}
    for (name, _, _), row in zip(rows, running):
        results = [job.result() for job in row]
        means[name] = numpy.mean(results, axis=0).tolist()
        print(line(name, results), flush=True)
    print(f"{time.monotonic() - started:.0f} s; the last column: CPU seconds of {given.samples} images and labels")
    return means


def pretend(gelsim, folder, preset, presses=15, radius=4.0):
    """A folder as of a real sensor, made of a preset: balls, their circles, and gains and noise."""
    folder.mkdir()
    size = 160, 120
    job = folder / "job.toml"
    job.write_text(f"""
[dataset]
name = "pretend"
samples = {presses}
samples_per_shard = {presses}
[[object]]
path = "{data.OBJECTS}/sphere.obj"
[pose]
x_mm = [-6.0, 6.0]
y_mm = [-4.0, 4.0]
[indentation]
depth_mm = [0.4, 0.8]
[sensor]
preset = "{preset}"
resolution_px = {list(size)}
field_of_view_mm = [18.6, 13.95]
[camera]
exposure = [0.98, 1.02]
read_noise_levels = 1.5
[output]
layers = ["contact", "reference"]
container = "folder"
""")
    data.run(gelsim, "generate", job, "--out", folder / "out", "--quiet")
    shard = folder / "out/data/train-000000"
    with open(folder / "presses.csv", "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(data.COLUMNS)
        for path in sorted(shard.glob("*.tactile.png")):
            label = json.loads(path.with_name(path.name.replace("tactile.png", "json")).read_text())
            contact = numpy.asarray(Image.open(path.with_name(path.name.replace("tactile", "contact")))) > 0
            mm = 18.6 / size[0]
            centre = [at / mm + length / 2 - 0.5 for at, length in zip(label["pose"]["translation_mm"], size)]
            writer.writerow([path, *centre, (contact.sum() / numpy.pi) ** 0.5, radius, mm])
    next(shard.glob("*.reference.png")).rename(folder / "background.png")
    return folder


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("gelsim", type=lambda name: Path(name).resolve())
    parser.add_argument("--real", type=Path, help="folder with presses.csv, or with a folder for each --set")
    parser.add_argument("--set", nargs="+", help="folders in it; else those of docs/evidence/transfer.md that are there")
    parser.add_argument("--preset", help="the preset of the sensor, or a sensor file, where its name is not one of docs/evidence/transfer.md")
    parser.add_argument("--contact-over-disc", type=float, help="where it is known better than `gelsim calibrate` finds it")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--samples", type=int, default=300, help="simulated images for each network")
    parser.add_argument("--balls", type=float, default=0.75, help="fraction of balls among simulated presses; the others are objects")
    parser.add_argument("--pixels", type=int, default=600_000, help="pixels of all images for each network")
    parser.add_argument("--units", type=int, default=64, help="units of each of the two hidden layers")
    parser.add_argument("--steps", type=int, default=2500, help="steps of training")
    parser.add_argument("--calibration-steps", type=int, default=1500)
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="networks trained at a time")
    parser.add_argument("--quick", action="store_true", help="leave the other fidelity levels out")
    parser.add_argument("--json", type=Path, help="also write the means of all rows")
    parser.add_argument("--self-test", action="store_true", help="two presets as if they were real, in half a minute")
    given = parser.parse_args()
    if not given.gelsim.is_file():
        raise data.Missing(f"no program {given.gelsim}")

    found = {}
    with tempfile.TemporaryDirectory() as work, concurrent.futures.ProcessPoolExecutor(given.jobs) as pool:
        work = Path(work)
        if given.self_test:
            given.seeds, given.samples, given.pixels, given.steps, given.calibration_steps = 1, 60, 120_000, 500, 100
            given.quick = True  # one row
            for preset in ("gelsight-mini", "digit"):
                (work / preset).mkdir()
                folder = pretend(given.gelsim, work / f"as-real-{preset}", preset)
                means = transfer(given, folder, None, work / preset, pool)
                flat = means["nothing (flat)"][0]
                error, _, overlap = means["calibrated, randomized"][:3]
                if error > 0.4 * flat or overlap < 0.7:
                    raise SystemExit(f"{preset}: {error:.2f} of {flat:.2f} degrees, IoU {overlap:.2f}")
            return
        if given.real is None or not given.real.is_dir():
            raise data.Missing(f"no folder {given.real}: --real FOLDER, or --self-test")
        if given.set is None and any((given.real / name).is_file() for name in ("presses.csv", "annotations.csv")):
            folders = [given.real]
        else:
            folders = [given.real / name for name in given.set or (*PRESETS, "gelsight_thu")]
        for folder in folders:
            if not folder.is_dir():
                print(f"skipped: {folder} is not there")
                continue
            (work / folder.name).mkdir()
            preset = given.preset or PRESETS.get(folder.name)
            found[folder.name] = transfer(given, folder, preset, work / folder.name, pool)
        if not found:
            raise data.Missing(f"none of these folders is there; docs/evidence/transfer.md says what {given.real} holds")
    if given.json:
        given.json.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
