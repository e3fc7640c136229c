"""gelsim against real presses of which forces or motions are known: of a TacTip, an AllSight and a GelSight Wedge.

    GELSIM_REAL_DATA=FOLDER python -m pytest -s tests/python/test_real_forces.py

FOLDER has the sets below, each with pictures and a table annotations.csv; without its set a test is skipped. What is compared
is printed, in lines that begin with `forces:`; a ratio is gelsim's over the real one. Constants that no table tells (zeros,
friction, moduli) are chosen on one part of a set, and the rest is judged.

- `tactip_shear`: two robots press a TacTip onto a flat surface, move it along and turn it, as the table says. Pins are found in
  the pictures, and their motions compared with those of the preset `tactip`. GELSIM_TACTIP_SET changes the preset, in JSON, by
  keys of a job: GELSIM_TACTIP_SET='{"sensor.gelpad_thickness_mm": 9}'.
- `allsight_force`: a ball is pressed into an AllSight. Where is it seen, how do force and depth, force and area go together?
- `wedge_grip_force`: a golf ball is gripped with a GelSight Wedge. How do force and area go together?

Needs the module, numpy and Pillow, and takes some minutes.
"""

import csv
import json
import os
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

for name, package in [("numpy", "numpy"), ("PIL", "pillow")]:
    pytest.importorskip(name, reason=f"no {package}: pip install {package}")
gelsim = pytest.importorskip("gelsim", reason="the module is not installed: pip install .")

import numpy
from PIL import Image

# It measures presses of the AllSight's preset, too.
sys.path.append(str(Path(__file__).parents[1] / "presets"))
import allsight

# Pins are found and followed there.
sys.path.append(str(Path(__file__).parents[1] / "transfer"))
from pins import VIEWS, as_complex, find_dots, read_white, track_pins

pytestmark = pytest.mark.wheel


def find_set(name):
    """Gives a set's folder and the rows of its table; skips the test where there are none."""
    given = os.environ.get("GELSIM_REAL_DATA")
    if not given:
        pytest.skip(f"no real data: GELSIM_REAL_DATA names a folder that has {name}")
    folder = Path(given) / name
    if not (folder / "annotations.csv").is_file():
        pytest.skip(f"GELSIM_REAL_DATA has no {name}")
    with open(folder / "annotations.csv", newline="") as table:
        return folder, list(csv.DictReader(table))


def say(name, figures):
    """Prints a line of figures."""
    cells = [f"{key} {value:.3g}" if isinstance(value, float) else f"{key} {value}" for key, value in figures.items()]
    print(f"forces: {name}: {', '.join(cells)}", flush=True)


def solve(columns, values):
    """Solves for least squares."""
    return numpy.linalg.lstsq(columns, values, rcond=None)[0]


def relate_ranks(first, second):
    """Correlation of two quantities' ranks."""
    return numpy.corrcoef(numpy.argsort(numpy.argsort(first)), numpy.argsort(numpy.argsort(second)))[0, 1]


# TacTip. Points and motions are complex, x + i y, in pixels of the preset's picture from its middle.


class Robot(NamedTuple):
    """How a robot with its TacTip moves."""

    x_axis_deg: float  # where the robot's x is in the picture
    tilt_sense: int  # whether it turns as the sensor's axes do
    twist_sense: int
    friction: float


# Senses, friction and first contact, as the robots count depth, are chosen on every other row of the table, from the first one.
ROBOTS = {
    "franka": Robot(130.0, 1, -1, 1.0),
    "cr": Robot(-161.0, -1, 1, 0.2),
}
FIRST_CONTACT_MM = 0.7
POSE_COLUMNS = ["depth_mm", "tilt_rx_deg", "tilt_ry_deg", "shear_x_mm", "shear_y_mm", "shear_rz_deg"]
DOME_RADIUS_MM, PAD_MM = 20.0, 11.0
# Pins are numbered ring by ring, from the middle.
RINGS = numpy.repeat(numpy.arange(11), [1, *range(6, 61, 6)])
BANDS = {"0-3": (0, 3), "4-6": (4, 6), "7-10": (7, 10), "0-6": (0, 6), "all": (0, 10)}
PRESS_STEPS, SLIDE_STEPS = 3, 4


def find_x_axis(robot):
    return numpy.exp(1j * numpy.radians(robot.x_axis_deg))


def find_shear(robot, poses):
    """How far a tip moved along the surface, mm, in the picture's axes: of a pose or several."""
    return (poses[..., 3] + 1j * poses[..., 4]) * find_x_axis(robot)


def turn_about(vector):
    """Gives the matrix that turns about a vector by its length."""
    angle = max(numpy.linalg.norm(vector), 1e-12)
    x, y, z = vector / angle
    cross = numpy.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return numpy.eye(3) + numpy.sin(angle) * cross + (1 - numpy.cos(angle)) * cross @ cross


def place_at(origin, turn):
    """Gives the placement of an object that is turned by less than half a turn."""
    w = numpy.sqrt(1 + numpy.trace(turn)) / 2
    x, y, z = turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]
    return gelsim.Placement(tuple(origin), (x / (4 * w), y / (4 * w), z / (4 * w), w))


def make_disc(middle, radius_mm, corners=40):
    """Makes a disc whose flat face is at z = 0."""
    around = 2 * numpy.pi * numpy.arange(corners) / corners
    rim = numpy.array(middle) + radius_mm * numpy.stack([numpy.cos(around), numpy.sin(around)], axis=1)
    vertices = [[x, y, z] for z in (0, 8) for x, y in (*rim, middle)]
    faces, top = [], corners + 1
    for i in range(corners):
        j = (i + 1) % corners
        faces += [(corners, j, i), (top + corners, top + i, top + j), (i, j, top + j), (i, top + j, top + i)]
    return gelsim.Mesh(vertices, faces)


def move_simulated(simulator, robot, pose, rest, pad_mm):
    """Presses a flat surface onto the dome as a row says, and slides it to its end: how far each pin moved."""
    depth_mm, *tilts_deg, _, _, twist_deg = pose
    tilt = robot.tilt_sense * numpy.pi / 180 * complex(*tilts_deg) * find_x_axis(robot)
    shear = find_shear(robot, pose)
    turn = turn_about(numpy.array([tilt.real, tilt.imag, 0.0]))
    normal = turn[:, 2]
    end = numpy.array([0, 0, FIRST_CONTACT_MM]) - depth_mm * normal
    start = end - turn @ [shear.real, shear.imag, 0]
    pressed_mm = DOME_RADIUS_MM * (1 - normal[2]) - end @ normal
    if pressed_mm <= 0:
        return 0 * rest
    # No part of an object can be deeper than the pad: the surface is a disc about the contact, as wide as that allows.
    dome = numpy.array([0, 0, -DOME_RADIUS_MM])
    foot = (turn.T @ (dome - (start + end) / 2))[:2]
    lean = numpy.hypot(*normal[:2])
    deepest = max(-(origin[2] + turn[2, :2] @ foot) for origin in (start, end))
    disc = make_disc(foot, min(17.0, (0.97 * pad_mm - 0.02 - deepest) / max(lean, 1e-6)))
    twist = robot.twist_sense * numpy.radians(twist_deg)
    simulator.reset(friction=robot.friction)
    for k in range(PRESS_STEPS):
        above = (1 - (k + 1) / PRESS_STEPS) * pressed_mm
        simulator.step(disc, place_at(start + above * normal, turn @ turn_about(numpy.array([0, 0, -twist]))))
    for k in range(SLIDE_STEPS):
        done = (k + 1) / SLIDE_STEPS
        turned = turn @ turn_about(numpy.array([0, 0, -twist * (1 - done)]))
        press = simulator.step(disc, place_at(start + done * (end - start), turned))
    return as_complex(press.pins["moved_px"]) - rest


def compare_motions(real, simulated, pins, poses, robot, band):
    """Compares pins' motions, a row for each picture, over a band of rings: their means, and how far they go outwards.

    The shift's ratio is that of pixels per mm of shear, with what comes of the tilt fitted beside.
    """
    first, last = BANDS[band]
    chosen = (first <= RINGS) & (last >= RINGS)
    off_middle = chosen & (abs(pins) > 1)
    outwards = pins[off_middle] / abs(pins[off_middle])
    tilt = poses[:, 1] + 1j * poses[:, 2]
    columns = numpy.stack([find_shear(robot, poses), tilt, tilt.conj(), numpy.ones(len(poses))], axis=1)
    shifts, slopes, spreads = [], [], []
    for motion in (real, simulated):
        shifts.append(numpy.nanmean(motion[:, chosen], axis=1))
        slopes.append(solve(columns, shifts[-1])[0])
        spreads.append(numpy.nanmean((motion[:, off_middle] * outwards.conj()).real, axis=1))
    theirs, ours = shifts
    return {
        "shift ratio": (slopes[1] / slopes[0]).real,
        "correlation": (ours * theirs.conj()).real.sum() / (numpy.linalg.norm(ours) * numpy.linalg.norm(theirs)),
        "spread ratio": spreads[1].sum() / spreads[0].sum(),
    }


def measure_rotation(motions, pins, poses):
    """How many degrees the pins of rings 0 to 6 turn for a degree of twist; what comes of tilt with shear is fitted beside."""
    turned = []
    for motion in motions:
        kept = (RINGS <= 6) & ~numpy.isnan(motion)
        linear = solve(numpy.stack([numpy.ones(kept.sum()), pins[kept], pins[kept].conj()], axis=1), motion[kept])
        turned.append(numpy.degrees(linear[1].imag))
    _, tilt_x, tilt_y, shear_x, shear_y, twist = poses.T
    columns = [twist, tilt_x * shear_y - tilt_y * shear_x, tilt_x * shear_x + tilt_y * shear_y, numpy.ones(len(poses))]
    return solve(numpy.stack(columns, axis=1), numpy.array(turned))[0]


@pytest.mark.parametrize("name", ROBOTS)
def test_pins_move_as_a_real_tactips(name):
    folder, rows = find_set("tactip_shear")
    robot, rows = ROBOTS[name], [row for row in rows if row["robot"] == name][1::2]
    changes = json.loads(os.environ.get("GELSIM_TACTIP_SET", "{}"))
    # Real pins at rest are where the preset's are without chance: what moves those is not to be changed.
    preset = {"sensor.pins.size_jitter": 0, "sensor.pins.place_jitter_mm": 0, **changes}
    pad_mm = changes.get("sensor.gelpad_thickness_mm", PAD_MM)
    simulator = gelsim.Simulator("tactip", set=preset)
    pins = as_complex(simulator.press(make_disc((0, 0), 17.0), gelsim.Placement((0, 0, 1.0))).pins["rest_px"])
    real, simulated, poses = [], [], []
    for row in rows:
        pose = numpy.array([float(row[key]) for key in POSE_COLUMNS])
        dots = VIEWS[name].place(find_dots(read_white(folder / row["file"])))
        motion = track_pins(pins, dots, find_shear(robot, pose))
        # Where many pins are lost, others may be taken for their neighbours.
        if numpy.isnan(motion).mean() <= 0.05:
            real.append(motion)
            simulated.append(move_simulated(simulator, robot, pose, pins, pad_mm))
            poses.append(pose)
    real, simulated, poses = numpy.array(real), numpy.array(simulated), numpy.array(poses)
    # Means are of the same pins.
    simulated[numpy.isnan(real)] = numpy.nan
    label = f"tactip, {name}"
    say(label, {"pictures": len(real), "of": len(rows), "preset changed by": json.dumps(changes)})
    figures = {}
    for band in BANDS:
        figures[band] = compare_motions(real, simulated, pins, poses, robot, band)
        say(f"{label}, rings {band}", figures[band])
    theirs, ours = (measure_rotation(motions, pins, poses) for motions in (real, simulated))
    say(f"{label}, rotation", {"deg per deg of twist, real": theirs, "gelsim": ours, "ratio": ours / theirs})
    assert len(real) >= 0.7 * len(rows)
    assert 0.8 <= figures["0-6"]["shift ratio"] <= 1.25
    assert 0.8 <= figures["all"]["spread ratio"] <= 1.25
    assert figures["all"]["correlation"] > 0.85


# AllSight: a ball on the half ball that the fingertip ends in.

TIP_RADIUS_MM, BALL_RADIUS_MM, GEL_MM, GEL_KPA = 15.5, 3.0, 4.0, 250.0
# Change of the picture, in levels of three channels together, that counts as touched, up to so far from the press.
TOUCHED_LEVELS, TOUCHED_PX = 8, 45
JOB = """
dataset = {{ name = "press", samples = 1 }}
sensor.preset = "allsight"
object = [{{ path = "{}", scale = {} }}]
output.layers = ["reference"]
"""


class Tip:
    """gelsim's AllSight, into which a ball is pressed by a force."""

    def __init__(self, job):
        self.job = job
        self.depths_mm = GEL_MM * numpy.array([0.0, *allsight.DEPTHS])
        presses = [self.press(11, 0.0, depth) for depth in self.depths_mm[1:]]
        self.forces_n = numpy.array([0.0] + [press["label"]["contact"]["force_n"] for press in presses])

    def press(self, ring, azimuth_deg, depth_mm):
        from_tip_mm = TIP_RADIUS_MM * numpy.radians(allsight.FROM_AXIS_DEG[ring])
        pose = {"pose.from_tip_mm": from_tip_mm, "pose.around_deg": azimuth_deg % 360, "indentation.depth_mm": depth_mm}
        return gelsim.Job.load(self.job, set={key: float(value) for key, value in pose.items()})[0]

    def press_by(self, ring, azimuth_deg, force_n):
        press = self.press(ring, azimuth_deg, numpy.interp(force_n, self.forces_n, self.depths_mm))
        return press["tactile"].astype(float), press["reference"].astype(float)


def measure_contact(picture, untouched):
    """Finds where a press is seen, as x + i y from the picture's middle, and how many pixels around it changed."""
    place, *_ = allsight.measure_press(picture, untouched)
    height, width = picture.shape[:2]
    row, column = round(place.imag + (height - 1) / 2), round(place.real + (width - 1) / 2)
    around = slice(row - TOUCHED_PX, row + TOUCHED_PX), slice(column - TOUCHED_PX, column + TOUCHED_PX)
    change = numpy.abs(allsight.blur(picture[around] - untouched[around])).sum(axis=2)
    return place, float((change > TOUCHED_LEVELS).sum())


@pytest.fixture(scope="module")
def tip(presses, project, tmp_path_factory):
    job = tmp_path_factory.mktemp("tip") / "press.toml"
    job.write_text(JOB.format((project / "objects/sphere.obj").as_posix(), BALL_RADIUS_MM / allsight.BALL_MM))
    return Tip(job)


@pytest.fixture(scope="module")
def presses():
    """Rows of pictures that show a press, with numbers: ring, azimuth and force."""
    folder, rows = find_set("allsight_force")
    rows = [row for row in rows if row["file"] != row["ref_file"]]
    rings = numpy.array([int(row["ring"]) for row in rows])
    azimuths_deg = numpy.array([360 * float(row["theta_turns"]) + 90 for row in rows])
    return folder, rows, rings, azimuths_deg, numpy.array([-float(row["fz_N"]) for row in rows])


@pytest.mark.filterwarnings("ignore:.*over half of the pad")
def test_an_allsights_contact_is_seen_where_the_real_one_is(presses, tip):
    folder, rows, rings, azimuths_deg, forces_n = presses
    real, simulated = [], []
    for row, ring, azimuth_deg, force_n in zip(rows, rings, azimuths_deg, forces_n):
        real.append(measure_contact(*(allsight.read_image(folder / row[key]) for key in ("file", "ref_file"))))
        simulated.append(measure_contact(*tip.press_by(ring, azimuth_deg, force_n)))
    (theirs, their_areas), (ours, our_areas) = (numpy.array(each).T for each in (real, simulated))
    told = numpy.exp(1j * numpy.radians(azimuths_deg))
    figures = {}
    for ring in sorted(set(rings)):
        seen, found, wanted = (places[rings == ring] for places in (theirs, ours, told))
        between, real_off, off = (numpy.median(abs(numpy.angle(a / b, deg=True))) for a, b in
                                  ((found, seen), (seen, wanted), (found, wanted)))  # fmt: skip
        radii_px = [abs(places).mean() for places in (seen, found)]
        figures[ring] = between, radii_px[1] / radii_px[0]
        say(f"allsight, ring {ring}", {
            "pictures": len(seen), "azimuths apart, median deg": between, "real from table's": real_off, "gelsim's": off,
            "radius px, real": radii_px[0], "gelsim": radii_px[1], "ratio": figures[ring][1],
        })  # fmt: skip
    kept = (forces_n > 0.5) & (their_areas.real > 0) & (our_areas.real > 0)
    said = {"pictures": int(kept.sum()), "ratio, median": numpy.median((our_areas / their_areas).real[kept])}
    for whose, areas in ("real", their_areas.real), ("gelsim", our_areas.real):
        said[f"power of force, {whose}"] = numpy.polyfit(numpy.log(forces_n[kept]), numpy.log(areas[kept]), 1)[0]
        said[f"correlation of ranks, {whose}"] = relate_ranks(areas[kept], forces_n[kept])
    say("allsight, area against force", said)
    for ring in (8, 9):
        azimuth_off, ratio = figures[ring]
        assert azimuth_off <= 6 and 0.85 <= ratio <= 1.15, ring


@pytest.mark.filterwarnings("ignore:.*over half of the pad")
def test_an_allsights_force_grows_with_depth_as_the_real_ones(presses, tip):
    _, rows, rings, _, forces_n = presses
    # How far the arm went along the axis of the press: contact begins elsewhere on each ring.
    from_axis = numpy.radians([allsight.FROM_AXIS_DEG[ring] for ring in rings])
    x_mm, z_mm = numpy.array([[float(row["ee_x_mm"]), float(row["ee_z_mm"])] for row in rows]).T
    travels_mm = -(x_mm * numpy.sin(from_axis) + z_mm * numpy.cos(from_axis))
    names = sorted({row["press"] for row in rows})
    fitted = numpy.array([row["press"] in names[::2] for row in rows])

    def guess_forces(stiffness):
        curve_n = stiffness * tip.forces_n
        zeros_mm = travels_mm - numpy.interp(forces_n, curve_n, tip.depths_mm)
        zero_mm = [zeros_mm[fitted & (rings == ring)].mean() for ring in rings]
        return numpy.interp(travels_mm - zero_mm, tip.depths_mm, curve_n)

    def measure_root(off):
        return numpy.sqrt((off**2).mean())

    best = min(numpy.geomspace(0.1, 5, 120), key=lambda stiffness: measure_root((guess_forces(stiffness) - forces_n)[fitted]))
    guessed_n = guess_forces(best)
    for ring in sorted(set(rings)):
        judged = ~fitted & (rings == ring)
        ratio = guessed_n[judged].sum() / forces_n[judged].sum()
        say(f"allsight, force against depth, ring {ring}", {"pictures": int(judged.sum()), "ratio": ratio})
    error = abs(guessed_n / forces_n - 1)[~fitted].mean()
    fitted_n, judged_n = (measure_root((guessed_n - forces_n)[part]) for part in (fitted, ~fitted))
    say("allsight, force against depth", {
        "modulus kPa": GEL_KPA * best, "rms N where fitted": fitted_n, "where judged": judged_n, "mean relative error": error,
    })  # fmt: skip
    assert error <= 0.20


# GelSight Wedge, on a golf ball.

# Corners of the gel in the raw picture, and in one of PX_PER_MM.
RAW_CORNERS = [(46, 87), (439, 121), (446, 368), (52, 425)]
FLAT_PX, PX_PER_MM, GOLF_BALL_RADIUS_MM = (400, 300), 11, 21.335
AROUND = numpy.exp(1j * numpy.radians(numpy.arange(0, 360, 10)))
RADII_PX = numpy.arange(20, 150, 2.0)
FITTED_GRIP, JUDGED_GRIP = "2023-12-16_golf_ball_t=0", "2023-12-16_golf_ball_t=2"
THICKNESSES_MM = 1.5, 2.5, 3.5, 5.0, 8.0
HOLD_N = 20.0


def flatten(path):
    """Takes the gel out of a raw picture, as seen from its front."""
    width, height = FLAT_PX
    rows, values = [], []
    for (u, v), (x, y) in zip(RAW_CORNERS, [(0, 0), (width, 0), (width, height), (0, height)]):
        rows += [[x, y, 1, 0, 0, 0, -u * x, -u * y], [0, 0, 0, x, y, 1, -v * x, -v * y]]
        values += [u, v]
    projection = numpy.linalg.solve(numpy.array(rows, float), numpy.array(values, float))
    raw = Image.open(path).convert("RGB")
    return numpy.asarray(raw.transform(FLAT_PX, Image.Transform.PERSPECTIVE, projection, Image.Resampling.BILINEAR), float)


def measure_change(picture, background, blur_px=4):
    """Where a picture changed, in levels of three channels."""
    reach = 4 * blur_px
    weights = numpy.exp(-0.5 * (numpy.arange(-reach, reach + 1) / blur_px) ** 2)
    change = numpy.pad(picture - background, ((reach, reach), (reach, reach), (0, 0)), mode="symmetric")
    for axis in (0, 1):
        change = numpy.apply_along_axis(numpy.convolve, axis, change, weights / weights.sum(), mode="valid")
    return numpy.abs(change).sum(axis=2)


def sample(change, places):
    """Takes the nearest pixels; NaN outside the picture."""
    height, width = change.shape
    column, row = numpy.rint(places.real).astype(int), numpy.rint(places.imag).astype(int)
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    return numpy.where(inside, change[row.clip(0, height - 1), column.clip(0, width - 1)], numpy.nan)


def find_rim(change, middle, margin_px=8):
    """Finds the circle across which the change falls most, over most directions: how clear it is, and its radius."""
    inner, outer = (sample(change, middle + numpy.outer(RADII_PX + shift, AROUND)) for shift in (-margin_px, margin_px))
    falls = numpy.clip(inner - outer, -20, 20)
    falls = numpy.where(numpy.isnan(falls).all(axis=1)[:, None], -20, falls)
    # A long rim is found less easily by chance.
    clear = numpy.nanmedian(falls, axis=1) * RADII_PX / 60
    return clear.max(), RADII_PX[clear.argmax()]


def find_middle(change):
    """Finds the middle of the clearest circle, first coarsely."""

    def clearest(columns, rows):
        return max((complex(x, y) for x in columns for y in rows), key=lambda middle: find_rim(change, middle)[0])

    coarse = clearest(range(120, 290, 8), range(90, 230, 8))
    x, y = int(coarse.real), int(coarse.imag)
    return clearest(range(x - 8, x + 9, 2), range(y - 8, y + 9, 2))


def measure_grip(folder, rows):
    """Forces of a grip's frames and areas of contact, mm2: 0 where none is seen."""
    changes = [measure_change(flatten(folder / row["file"]), flatten(folder / row["background"])) for row in rows]
    middle = find_middle(numpy.mean(changes[-3:], axis=0))
    shifts = [complex(x, y) for x in (-12, -6, 0, 6, 12) for y in (-12, -6, 0, 6, 12)]
    areas_mm2 = []
    for change in changes:
        clear, radius_px = max(find_rim(change, middle + shift) for shift in shifts)
        areas_mm2.append(numpy.pi * (radius_px / PX_PER_MM) ** 2 if clear > 1.5 else 0.0)
    return numpy.array([float(row["force_N"]) for row in rows]), numpy.array(areas_mm2)


def press_golf_ball(thickness_mm):
    """Forces at 1 kPa, and areas of contact, mm2, of a golf ball on a flat gel."""
    width, height, pitch_mm = 364, 273, 0.1
    gel = {"gelpad_thickness_mm": thickness_mm, "gelpad_youngs_modulus_kpa": 100.0}
    gel["field_of_view_mm"] = [width * pitch_mm, height * pitch_mm]
    settings = {f"sensor.{key}": value for key, value in gel.items()}
    simulator = gelsim.Simulator("gelsight-mini", fidelity="draft", resolution_px=(width, height), set=settings)
    y, x = numpy.mgrid[:height, :width]
    squared = ((x - (width - 1) / 2) ** 2 + (y - (height - 1) / 2) ** 2) * pitch_mm**2
    below = numpy.sqrt(numpy.maximum(GOLF_BALL_RADIUS_MM**2 - squared, 0)) - GOLF_BALL_RADIUS_MM
    below[squared >= GOLF_BALL_RADIUS_MM**2] = -10
    forces, areas = [0.0], [0.0]
    for depth_mm in (0.03, 0.1, 0.2, 0.35, *numpy.arange(0.5, 0.9 * thickness_mm, 0.3)):
        press = simulator.press((below + depth_mm).astype(numpy.float32))
        contact = press.label["contact"]
        forces.append(contact["force_n"] / gel["gelpad_youngs_modulus_kpa"])
        areas.append(contact["area_mm2"])
    return numpy.array(forces), numpy.array(areas)


def compare_areas(grip, curve, modulus_kpa):
    """Ratios of area, gelsim over real, of frames that show a contact, and their forces."""
    forces_n, areas_mm2 = grip
    kept = (forces_n > 0.8) & (areas_mm2 > 15)
    return numpy.interp(forces_n[kept], curve[0] * modulus_kpa, curve[1]) / areas_mm2[kept], forces_n[kept]


def test_a_golf_balls_contact_grows_with_force_as_the_real_one():
    folder, rows = find_set("wedge_grip_force")
    trials = sorted({row["trial"] for row in rows if "golf_ball" in row["trial"]})
    grips = {trial: measure_grip(folder, [row for row in rows if row["trial"] == trial]) for trial in trials}
    curves = {thickness: press_golf_ball(thickness) for thickness in THICKNESSES_MM}

    def miss(constants):
        ratios, _ = compare_areas(grips[FITTED_GRIP], curves[constants[0]], constants[1])
        return (numpy.log(ratios) ** 2).mean()

    thickness, modulus_kpa = min(((h, e) for h in curves for e in numpy.geomspace(20, 1500, 80)), key=miss)
    say("wedge, golf ball", {"fitted on": FITTED_GRIP, "thickness mm": thickness, "modulus kPa": modulus_kpa})
    figures = {}
    for trial, grip in grips.items():
        ratios, forces_n = compare_areas(grip, curves[thickness], modulus_kpa)
        hold = numpy.exp(numpy.log(ratios[forces_n > HOLD_N]).mean())
        figures[trial] = {"mean error": abs(ratios - 1).mean(), "ratio while held": hold}
        say(f"wedge, golf ball, {trial}", {"frames": len(ratios), **figures[trial]})
    assert figures[JUDGED_GRIP]["mean error"] <= 0.25
    assert 0.85 <= figures[JUDGED_GRIP]["ratio while held"] <= 1.2
