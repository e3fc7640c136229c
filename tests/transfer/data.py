"""Real presses with the labels of gelsim's own pad, and simulated presses of any sensor, as arrays of the same kind."""

import csv
import dataclasses
import json
import subprocess
import tempfile
from pathlib import Path

import numpy
from PIL import Image

COLUMNS = "file", "centre_x_px", "centre_y_px", "radius_px", "ball_radius_mm", "mm_per_px"
OBJECTS = Path(__file__).parents[2] / "objects"
FEWEST = 14
WIDTH = 160  # the network sees images averaged over blocks to about this size


class Missing(SystemExit):
    """Something that the user has to give is not there."""


@dataclasses.dataclass
class Presses:
    """Presses, reduced: change of colour against the untouched pad, and labels."""

    change: numpy.ndarray  # n, rows, columns, 3: grey levels
    normal: numpy.ndarray  # n, rows, columns, 2: x and y of the unit normal
    contact: numpy.ndarray  # n, rows, columns: fraction of the block in contact
    surface: numpy.ndarray  # n, rows, columns: mm into the pad
    mm_per_px: float

    def __getitem__(self, some):
        return Presses(self.change[some], self.normal[some], self.contact[some], self.surface[some], self.mm_per_px)


def run(*command):
    """What a command prints; it must succeed."""
    result = subprocess.run([str(part) for part in command], capture_output=True, text=True)
    if result.returncode != 0:
        raise SystemExit(f"{' '.join(str(part) for part in command)}\n{result.stderr}")
    return result.stdout


def picture(path):
    if not Path(path).is_file():
        raise Missing(f"no image {path}")
    return numpy.asarray(Image.open(path).convert("RGB"), dtype="float32")


def reduced(array):
    """Means over blocks of pixels; what does not fill a block is left out."""
    block = max(1, round(max(array.shape[:2]) / WIDTH))
    rows, columns = array.shape[0] // block, array.shape[1] // block
    blocks = array[: rows * block, : columns * block].reshape(rows, block, columns, block, -1)
    return blocks.mean(axis=(1, 3), dtype="float32").squeeze()


def layers(folder, name):
    """Normal, contact and surface of a sample in a folder, and not yet reduced."""
    normal = numpy.load(folder / f"{name}.normal.npy")[..., :2]
    contact = numpy.asarray(Image.open(folder / f"{name}.contact.png"), dtype="float32") / 255
    return normal, contact, numpy.load(folder / f"{name}.surface.npy")


class Real:
    """A folder with presses.csv (or annotations.csv) as `gelsim calibrate` takes it, and background.png."""

    def __init__(self, folder):
        self.folder = Path(folder)
        tables = [self.folder / name for name in ("presses.csv", "annotations.csv")]
        table = next((table for table in tables if table.is_file()), None)
        if table is None:
            raise Missing(f"{folder} has no presses.csv (docs/evidence/transfer.md says what is in it)")
        with open(table, newline="") as file:
            reader = csv.DictReader(file)
            rows, lacks = list(reader), [name for name in COLUMNS if name not in (reader.fieldnames or [])]
        if lacks:
            raise Missing(f"{table} has no column {', '.join(lacks)}")
        if len(rows) < FEWEST:
            raise Missing(f"{table} has {len(rows)} presses; {FEWEST} are needed, a third of them to test on")
        self.background_file = (self.folder / "background.png").resolve()
        self.background = picture(self.background_file)
        for row in rows:
            row["file"] = (self.folder / row["file"]).resolve()
            for name in COLUMNS[1:]:
                try:
                    row[name] = float(row[name])
                except ValueError:
                    raise Missing(f"{table}: {row['file'].name} has no {name}") from None
            if picture(row["file"]).shape != self.background.shape:
                raise Missing(f"{row['file']} and {self.background_file} differ in size")
        # By image: every third one is never fitted.
        self.tested = rows[2::3]
        self.fitted = [row for at, row in enumerate(rows) if at % 3 != 2]
        self.mm_per_px = rows[0]["mm_per_px"]
        self.size = self.background.shape[1], self.background.shape[0]
        self.known = self.shapes(rows)

    def shapes(self, rows):
        """Images and depths of other shapes pressed to a known depth, where indenters.csv lists some."""
        table = self.folder / "indenters.csv"
        if not table.is_file():
            return []
        balls = {str(row["ball_radius_mm"]) for row in rows}
        with open(table, newline="") as file:
            return [(self.folder / row["file"], float(row["press_depth_mm"])) for row in csv.DictReader(file)
                    if str(row.get("ball_radius_mm")) not in balls]

    def change(self, path):
        return reduced(picture(path) - self.background)

    def calibrate(self, gelsim, out, steps, over_disc=None):
        """A sensor file from the fitted presses; returns the pad's thickness and contact over disc."""
        given = ("--contact-over-disc", over_disc) if over_disc else ()
        table = out.parent / "fitted.csv"
        with open(table, "w", newline="") as file:
            writer = csv.DictWriter(file, COLUMNS, extrasaction="ignore")
            writer.writeheader()
            writer.writerows(self.fitted)
        run(gelsim, "calibrate", table, "--background", self.background_file, "--steps", steps, *given, "--out", out)
        over_disc = json.loads(out.with_suffix(".calibration.json").read_text())["contact_over_disc"]
        thickness = next(line for line in out.read_text().splitlines() if line.startswith("gelpad_thickness_mm"))
        return float(thickness.split("=")[1]), over_disc

    def labelled(self, gelsim, rows, thickness, over_disc, folder):
        """Presses with the surface of gelsim's elastic pad under each ball, as deep as makes the contact so wide."""
        mm = self.mm_per_px
        # The pad beyond the view is pressed, too.
        margin = max(self.size) // 4
        columns, lines = self.size[0] + 2 * margin, self.size[1] + 2 * margin

        def render(name, balls):
            """Layers of a pad under balls: x and y in pixels of the image, radius and depth in mm."""
            frames, out = folder / f"{name}_frames", folder / name
            frames.mkdir()
            y, x = numpy.mgrid[:lines, :columns] - float(margin)
            for at, (cx, cy, radius, depth) in enumerate(balls):
                cap = numpy.sqrt((radius**2 - ((x - cx) ** 2 + (y - cy) ** 2) * mm**2).clip(0))
                distance = numpy.where(cap > 0, 10 - depth + radius - cap, 100)
                numpy.save(frames / f"{at:04}.npy", distance.astype("float32"))
            settings = (f"sensor.field_of_view_mm=[{columns * mm}, {lines * mm}]", 'output.depth_format="npy"',
                        f"sensor.gelpad_thickness_mm={thickness}")
            run(gelsim, "render", "--depth", frames, "--depth-unit", "mm", "--plane-mm", 10, "--max-depth-mm", 50,
                "--sensor", "gelsight-2014", "--fidelity", "high", "--layers", "surface,normal,contact",
                *(part for setting in settings for part in ("--set", setting)), "--out", out, "--quiet")
            for at in range(len(balls)):
                yield [layer[margin:-margin, margin:-margin] for layer in layers(out, f"{at:04}")]

        depth_of = {}
        for at, radius in enumerate(sorted({row["ball_radius_mm"] for row in rows})):
            widest = over_disc * mm * max(row["radius_px"] for row in rows if row["ball_radius_mm"] == radius)
            depths = numpy.linspace(0.05, min(1.2 * widest**2 / radius, 0.9 * thickness), 24)
            centre = self.size[0] / 2, self.size[1] / 2
            pressed = render(f"depths{at}", [(*centre, radius, depth) for depth in depths])
            areas = [contact.sum() for _, contact, _ in pressed]
            depth_of[radius] = depths, numpy.sqrt(numpy.array(areas) / numpy.pi)
        balls = []
        for row in rows:
            depths, radii = depth_of[row["ball_radius_mm"]]
            depth = numpy.interp(over_disc * row["radius_px"], radii, depths)
            balls.append((row["centre_x_px"], row["centre_y_px"], row["ball_radius_mm"], depth))
        found = [[reduced(layer) for layer in one] for one in render("presses", balls)]
        change = numpy.stack([self.change(row["file"]) for row in rows])
        block = self.size[0] / change.shape[2]
        return Presses(change, *(numpy.stack(layer) for layer in zip(*found)), mm * round(block))


def ball(radius, path):
    """The bundled sphere in another size."""
    lines = (OBJECTS / "sphere.obj").read_text().splitlines()
    for at, line in enumerate(lines):
        if line.startswith("v "):
            lines[at] = "v " + " ".join(str(float(value) * radius / 4) for value in line.split()[1:])
    path.write_text("\n".join(lines))


def simulated(gelsim, sensor, view_mm, depth_mm, radii, samples, seed, extra="", fidelity="standard", balls=0.5):
    """Random presses under a sensor (lines of its table), a fraction `balls` of balls, the others of objects.

    A list where `extra` has `[sensors]`: the presses of each.
    """
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        for at, radius in enumerate(radii):
            ball(radius, folder / f"ball{at}.obj")
        weight = (1 - balls) / len(list(OBJECTS.glob("*.obj")))
        others = f'[[object]]\npath = "{OBJECTS}/*.obj"\nweight = {weight}' if weight else ""
        job = f"""
[dataset]
name = "transfer"
samples = {samples}
samples_per_shard = {samples}
seed = {seed}
[[object]]
path = "ball*.obj"
weight = {balls / len(radii)}
{others}
[pose]
face = "any"
yaw_deg = [0.0, 360.0]
tilt_deg = [0.0, 10.0]
x_mm = [{-0.45 * view_mm[0]}, {0.45 * view_mm[0]}]
y_mm = [{-0.45 * view_mm[1]}, {0.45 * view_mm[1]}]
anchor = "contact"
[indentation]
depth_mm = [{0.1 * depth_mm}, {depth_mm}]
no_contact = 0.05
[output]
layers = ["surface", "normal", "contact", "reference"]
container = "folder"
depth_format = "npy"
[sensor]
{sensor}
{extra}
"""
        (folder / "job.toml").write_text(job)
        options = "--fidelity", fidelity, "--threads", 1, "--quiet"
        run(gelsim, "generate", folder / "job.toml", "--out", folder / "out", *options)
        sets = [rendered(shard, view_mm) for shard in sorted((folder / "out").glob("**/train-000000"))]
        return sets if "[sensors]" in extra else sets[0]


def rendered(shard, view_mm):
    """The presses in a folder of samples."""
    found = []
    for image in sorted(shard.glob("*.tactile.png")):
        name = image.name.split(".")[0]
        change = picture(image) - picture(shard / f"{name}.reference.png")
        found.append([reduced(change)] + [reduced(layer) for layer in layers(shard, name)])
    stacked = [numpy.stack(layer) for layer in zip(*found)]
    return Presses(*stacked, view_mm[0] / stacked[0].shape[2])
