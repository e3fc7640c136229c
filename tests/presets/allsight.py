"""Compares the sensor preset `allsight` with pictures of a real AllSight into which a ball was pressed.

    python tests/presets/allsight.py GELSIM FOLDER

FOLDER holds annotations.csv, background.jpg (the untouched gel) and the pictures. Columns of the table that are read: `file` and
`ref_file`, the picture and the one before contact, relative to FOLDER; `press`, a name that pictures of one press share; `ring`,
where the ball was pressed (11 the tip, 10, 9, 8 by 22.5 degrees more from the finger's axis); `theta_turns`, where around the axis
(azimuth in the picture 90 degrees more); `fz_N`, force on the sensor, minus the press's.

The preset was fitted to every other press, in the order of their names; the ones between are rendered and compared, or with --all
all of them. Each is pressed in so deep that the simulated force is the measured one. Printed are, real and preset: colour of the
untouched gel, the side on which each channel is strongest, how far from the picture's middle presses are seen, how far apart their
places are, and how much a press changes the picture. Needs numpy and Pillow.
"""

import argparse
import csv
import json
import subprocess
import tempfile
import tomllib
from pathlib import Path

import numpy
from PIL import Image

SENSOR = Path(__file__).parents[2] / "configs" / "sensors" / "allsight.toml"
BALL = Path(__file__).parents[2] / "objects" / "sphere.obj"
BALL_MM, PRESSED_BALL_MM = 4.0, 3.0
FROM_AXIS_DEG = {11: 0.0, 10: 22.5, 9: 45.0, 8: 67.5}
CHANNELS = "red", "green", "blue"
# Changes of the picture are blurred by BLUR_PX; presses are within SEARCH_PX of its middle, each within REACH_PX of its peak. The
# middle of the picture, MIDDLE_PX, says little about sides.
BLUR_PX, SEARCH_PX, REACH_PX, MIDDLE_PX = 2.5, 110, 24, 60
# Shares of the gel's thickness that balls are pressed in to find how force grows with depth.
DEPTHS = 0.03, 0.08, 0.15, 0.25, 0.35, 0.45, 0.55, 0.65, 0.75, 0.85, 0.95


def read_image(path):
    return numpy.asarray(Image.open(path).convert("RGB"), dtype=float)


def measure_polar(height, width):
    """Returns each pixel's distance from the picture's middle, in pixels, and its azimuth, in radians."""
    y, x = numpy.mgrid[:height, :width]
    x, y = x - (width - 1) / 2, y - (height - 1) / 2
    return numpy.hypot(x, y), numpy.arctan2(y, x)


def blur(planes):
    """Blurs a picture as a Gaussian does."""
    reach = int(4 * BLUR_PX + 0.5)
    weights = numpy.exp(-0.5 * (numpy.arange(-reach, reach + 1) / BLUR_PX) ** 2)
    weights /= weights.sum()
    for axis in 0, 1:
        planes = numpy.apply_along_axis(numpy.convolve, axis, planes, weights, mode="same")
    return planes


def measure_untouched(picture):
    """Returns the mean colour of what is seen of the gel, its saturation, and the azimuth at which each channel is strongest."""
    distance, azimuth = measure_polar(*picture.shape[:2])
    seen = picture.sum(axis=2) > 20
    gel = picture[seen]
    saturation = ((gel.max(axis=1) - gel.min(axis=1)) / gel.max(axis=1)).mean()
    sides = seen & (distance > MIDDLE_PX)
    towards = (picture[sides] * numpy.exp(1j * azimuth[sides])[:, None]).sum(axis=0)
    return gel.mean(axis=0), saturation, numpy.degrees(numpy.angle(towards))


def measure_press(picture, untouched):
    """Returns where a press changed the picture, as x + i y from the middle, and the peak and mean of the change there."""
    change = numpy.abs(blur(picture - untouched)).sum(axis=2)
    height, width = change.shape
    distance, _ = measure_polar(height, width)
    change[distance > SEARCH_PX] = 0
    peak = change.max()
    row, column = numpy.unravel_index(change.argmax(), change.shape)
    y, x = numpy.mgrid[:height, :width]
    spot = (change > peak / 2) & (numpy.hypot(x - column, y - row) < REACH_PX)
    weights = change[spot]
    place = (weights * (x + 1j * y)[spot]).sum() / weights.sum() - ((width - 1) / 2 + (height - 1) / 2 * 1j)
    return place, peak, weights.mean()


class Renderer:
    """Renders presses of the ball under the preset, over pictures of the real ones' size."""

    def __init__(self, gelsim, sensor, resolution_px, folder):
        self.gelsim, self.sensor, self.resolution_px, self.folder = gelsim, Path(sensor).resolve(), resolution_px, Path(folder)
        values = tomllib.loads(self.sensor.read_text())
        self.radius_mm, self.thickness_mm = values["shape"]["capsule"]["radius_mm"], values["gelpad_thickness_mm"]
        self.depths_mm = [0.0] + [share * self.thickness_mm for share in DEPTHS]
        self.forces_n = [0.0] + [self.press(11, 0.0, depth)[2] for depth in self.depths_mm[1:]]

    def find_depth(self, force_n):
        """Returns how deep the ball is for a force, at most the deepest of DEPTHS."""
        return float(numpy.interp(force_n, self.forces_n, self.depths_mm))

    def press(self, ring, azimuth_deg, depth_mm):
        """Returns the picture of a press, the untouched one and the force."""
        job = f"""
            [dataset]
            name = "press"
            samples = 1
            [sensor]
            file = {json.dumps(str(self.sensor))}
            resolution_px = {self.resolution_px}
            [[object]]
            path = {json.dumps(str(BALL.resolve()))}
            scale = {PRESSED_BALL_MM / BALL_MM}
            [pose]
            from_tip_mm = {self.radius_mm * numpy.radians(FROM_AXIS_DEG[ring])}
            around_deg = {azimuth_deg % 360}
            [indentation]
            depth_mm = {depth_mm}
            [output]
            layers = ["reference"]
            container = "folder"
        """
        with tempfile.TemporaryDirectory(dir=self.folder) as folder:
            path, out = Path(folder) / "job.toml", Path(folder) / "out"
            path.write_text(job)
            done = subprocess.run([self.gelsim, "generate", path, "--out", out], capture_output=True, text=True)
            if done.returncode:
                raise SystemExit(done.stderr)
            sample = next(out.glob("data/*/000000000.json"))
            images = [read_image(sample.with_name(f"000000000.{layer}.png")) for layer in ("tactile", "reference")]
            return *images, json.loads(sample.read_text())["contact"]["force_n"]


def choose_pictures(folder, everything):
    """Returns the rows of the table that show a press: of every second press, or of all."""
    with open(folder / "annotations.csv", newline="") as table:
        rows = [row for row in csv.DictReader(table)]
    kept = sorted({row["press"] for row in rows})[1::2]
    return [row for row in rows if row["file"] != row["ref_file"] and (everything or row["press"] in kept)]


def print_untouched(real, preset):
    for name, picture in ("real", real), ("preset", preset):
        color, saturation, sides = measure_untouched(picture)
        print(f"untouched, {name:6}: mean colour {color.round()}, saturation {saturation:.2f}, strongest at", end=" ")
        print(", ".join(f"{channel} {side:.0f}" for channel, side in zip(CHANNELS, sides)), "degrees")


def print_presses(rows, real, preset):
    """Prints how measured presses agree: rows of place, peak and mean."""
    (places, peaks, means), (found, found_peaks, found_means) = numpy.array(real).T, numpy.array(preset).T
    rings = numpy.array([int(row["ring"]) for row in rows])
    for ring in 8, 9, 10:
        of_ring = rings == ring
        if of_ring.any():
            distances = [abs(at[of_ring]).mean() for at in (places, found)]
            print(f"ring {ring}: {distances[0]:.1f} px from the middle, preset {distances[1]:.1f}")
    aside = rings != 11
    # How far the real presses are from the middle on the preset's sides of it.
    scale = (places * found.conj())[aside].real.sum() / (abs(found[aside]) ** 2).sum()
    print(f"scale, real over preset: {scale:.3f}")
    apart = abs(places - found)
    print(f"places apart: median {numpy.median(apart):.1f} px; off the tip {numpy.median(apart[aside]):.1f} px")
    for name, here, there in ("peak", peaks, found_peaks), ("mean", means, found_means):
        here, there = here.real, there.real
        print(f"{name} change: real {here.mean():.1f} levels, preset {there.mean():.1f}, preset over real", end=" ")
        print(f"{there.mean() / here.mean():.2f}; of single presses {(there / here).min():.2f} to {(there / here).max():.2f}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("gelsim")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--sensor", default=SENSOR, help="another sensor file than the preset's")
    parser.add_argument("--all", action="store_true", help="all presses, not only those that were not fitted")
    given = parser.parse_args()

    background = read_image(given.folder / "background.jpg")
    rows = choose_pictures(given.folder, given.all)
    real, preset, too_deep = [], [], 0
    with tempfile.TemporaryDirectory() as folder:
        renderer = Renderer(given.gelsim, given.sensor, [background.shape[1], background.shape[0]], folder)
        for row in rows:
            force_n = -float(row["fz_N"])
            too_deep += force_n > renderer.forces_n[-1]
            azimuth_deg = 360 * float(row["theta_turns"]) + 90
            picture, untouched, _ = renderer.press(int(row["ring"]), azimuth_deg, renderer.find_depth(force_n))
            real.append(measure_press(read_image(given.folder / row["file"]), read_image(given.folder / row["ref_file"])))
            preset.append(measure_press(picture, untouched))
    print(f"{len(rows)} pictures; {too_deep} pressed less hard than the real ones, as far as the gel can be simulated")
    print_untouched(background, untouched)
    print_presses(rows, real, preset)


if __name__ == "__main__":
    main()
