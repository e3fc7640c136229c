"""Which figures of the pages come from what: for figures.py, page by page.

Where a page gives figures for a table or a sentence, an entry names the command beside them, the place, and how the new values
come out of what the command prints or writes. Numbers of a page are never repeated here.
"""

import json
import re
import statistics
import tarfile

from figures import Figures, Sentence, Stale, Table, number, scan


def one(output, template):
    """The numbers in the only place of the output that the template fits."""
    found = scan(output.text, template)
    if len(found) != 1:
        raise Stale(f"printed {len(found)} times instead of once: {template}")
    return found[0]


def column(output, template, index=0):
    found = [numbers[index] for numbers in scan(output.text, template)]
    if not found:
        raise Stale(f"not printed: {template}")
    return found


def worst(output, template, index=0):
    return max(map(abs, column(output, template, index)))


def from_one(values):
    """How far ratios are from 1, at most, in percent."""
    return 100 * max(abs(value - 1) for value in values)


def percent(values):
    return [100 * value for value in values]


def line(output, name):
    """The numbers behind a name in the only line that begins with it; `-` is none."""
    found = [text for text in output.text.splitlines() if text.startswith(f"{name} ")]
    if len(found) != 1:
        raise Stale(f"printed {len(found)} times instead of once: {name}")
    return [number(word) for word in found[0][len(name) :].split() if word.strip("-*")]


# --- What accuracy costs -------------------------------------------------------------------------------------------------------

ACCURACY = "python tests/bench/accuracy.py target/release/gelsim"
ACCURACY_TABLES = {
    title: Table(f"{title} (", "l t e e e e")
    for title in (
        "Fidelity, 640x480",
        "Fidelity, 320x240",
        "Shadows, at `standard`",
        "Friction of the pad, at `standard`",
        "A fingertip, 320x240",
        "TacTip, 128x128",
        "Fidelity of a slip at 25 frames a second",
        "Frames a second of a slip, at `standard`",
    )
}


def accuracy(title, row):
    """The cells of a row of what accuracy.py prints: time, image, worst image, force, model error."""
    return lambda output: [cell[0] if cell else None for cell in ACCURACY_TABLES[title].values(output.text)[row]]


def accuracy_of(page, sentence, title, row, *cells, **more):
    new = lambda output: [accuracy(title, row)(output)[cell] for cell in cells]
    return Figures(page, ACCURACY, Sentence(sentence), new, needs=("numpy", "PIL"), **more)


ACCURACY_FIGURES = [
    Figures("accuracy", ACCURACY, table, lambda output, table=table: table.values(output.text), needs=("numpy", "PIL"))
    for table in ACCURACY_TABLES.values()
] + [
    accuracy_of("accuracy", '`"high"` | {} levels and {<} % of the force', "Fidelity, 640x480", "high", 1, 3),
    accuracy_of("accuracy", "it changes the force by {} % of the largest", "Friction of the pad, at `standard`", "none", 3),
    accuracy_of("accuracy", "whether the pad sticks is {} %,", "Friction of the pad, at `standard`", "none", 3),
]

# --- The levels on the quickstart ----------------------------------------------------------------------------------------------

TRADEOFF = "gelsim tradeoff configs/quickstart.toml"


def tradeoff(output):
    return json.loads((output.folder / "out/quickstart-tradeoff/tradeoff.json").read_text())


def rungs(output):
    return {rung["rung"]: rung for rung in tradeoff(output)["rungs"]}


def of_rungs(*keys):
    """A row for each fidelity level; a key may be several, of one cell."""
    cell = lambda rung, key: rung[key] if isinstance(key, str) else [rung[each] for each in key]
    return lambda output: {name: [cell(rung, key) for key in keys] for name, rung in rungs(output).items()}


def other_choices(output):
    keys = ("height_rms_um", "ring_normal_mean_deg", "image_mae", "cpu_ms_median")
    found = tradeoff(output)
    return {choice["rung"]: [choice[key] for key in keys] for choice in [*found["tolerances"], *found["models"]]}


def choice_name(cell):
    """`elastic`, half, 10 um: half grid, 10 um."""
    grid = cell.removeprefix("elastic, ")
    return grid.replace(",", " grid,", 1) if grid != cell else cell


def by_object(output):
    rows = {}
    for one_object in tradeoff(output)["objects"]:
        own = {rung["rung"]: rung for rung in one_object["rungs"]}
        theory = [own["reference"]["model_rms_um"], own["reference"]["model_error_um"]]
        rows[one_object["object"]] = [theory, own["draft"]["height_rms_um"], own["standard"]["height_rms_um"]]
    rows["all, both errors together"] = [rungs(output)[name]["total_rms_um"] for name in ("reference", "draft", "standard")]
    return rows


def levels(*wanted):
    """One figure for each pair of a level and a key."""
    return lambda output: [rungs(output)[name][key] for name, key in wanted]


def left_out(output):
    return {effect["effect"]: effect for effect in tradeoff(output)["left_out"]}


def without_effects(output):
    effects = left_out(output)
    wanted = [
        ("deformation", "image_mae"),
        ("deformation", "cpu_ms"),
        ("shading", "image_mae"),
        ("shading", "cpu_ms"),
        ("shadows", "cpu_ms"),
        ("shadows", "image_mae"),
        ("darkening", "image_mae"),
        ("supersampling", "image_mae"),
        ("supersampling", "cpu_ms"),
    ]
    return [effects[effect][key] for effect, key in wanted]


def grids(output):
    finer = {grid["per_px"]: grid for grid in tradeoff(output)["grids"]}
    return [finer[size][key] for size in (1.0, 0.5) for key in ("height_rms_um", "ring_rms_um", "height_max_um")]


RMS, LARGEST, CPU, IMAGE = "height_rms_um", "height_max_um", "cpu_ms_median", "image_mae"
LEVEL_CELLS = (
    "height_rms_um height_max_um contact_normal_mean_deg ring_normal_mean_deg ring_normal_p95_deg image_mae image_psnr_db"
    " image_ssim area_error_percent force_error_percent"
).split() + [("contact_iou_mean", "contact_iou_worst"), "cpu_ms_median", "cpu_ms_p95"]

TRADEOFF_FIGURES = [
    Figures(
        "README",
        TRADEOFF,
        Table("| level | height error,", "l e e t", name=lambda cell: cell.split()[0]),
        of_rungs(RMS, IMAGE, CPU),
    ),
    Figures(
        "README",
        TRADEOFF,
        Sentence("is itself off by {} um (root mean square over the view"),
        levels(("reference", "model_rms_um")),
    ),
    Figures(
        "gelpad",
        TRADEOFF,
        Table("| level | height RMS um | height max um |", "l e e e e e e e e e e e t t"),
        of_rungs(*LEVEL_CELLS),
    ),
    Figures("gelpad", TRADEOFF, Table("| choice | height RMS um |", "l e e e t", name=choice_name), other_choices),
    Figures("gelpad", TRADEOFF, Table("| object | linear theory, um RMS (largest) |", "l e e e"), by_object),
    Figures(
        "gelpad",
        TRADEOFF,
        Sentence(
            "`standard` (the default) is within {} um RMS of the most exact level and takes {ms} ms of CPU time a sample, `draft`"
            " within {} um in {ms} ms, `high` within {} um in {ms} ms; `paper` is {} um off in {ms} ms"
        ),
        levels(*[(name, key) for name in ("standard", "draft", "high", "paper") for key in (RMS, CPU)]),
    ),
    Figures("gelpad", TRADEOFF, Sentence("theory itself is off by {} um RMS there"), levels(("reference", "model_rms_um"))),
    Figures(
        "gelpad",
        TRADEOFF,
        Sentence("single pixels at walls (`draft` {} um, `standard` {}, `high` {})"),
        levels(("draft", LARGEST), ("standard", LARGEST), ("high", LARGEST)),
    ),
    Figures("gelpad", TRADEOFF, Sentence("So `paper`, {} um off, is worse"), levels(("paper", RMS))),
    Figures(
        "gelpad",
        TRADEOFF,
        Sentence(
            "Leaving out deformation costs {} grey levels (mean) and saves {ms} ms of the reference's time; leaving out the light of"
            " the LEDs costs {} and saves {ms} ms, of which shadows are {ms} and cost {} levels; leaving out the darkening costs {},"
            " light at pixel centres alone {} (and {ms} ms)"
        ),
        without_effects,
    ),
    Figures(
        "gelpad-accuracy",
        TRADEOFF,
        Sentence(
            "the reference is off by {} um over the view, {} um in the ring, and up to {} um at single pixels of a wall; a grid half as"
            " fine by {}, {} and {} um"
        ),
        grids,
    ),
    Figures(
        "effects-models",
        TRADEOFF,
        Sentence("show the effect: {} and {} grey levels in the mean at `standard` and `draft`"),
        levels(("standard", IMAGE), ("draft", IMAGE)),
    ),
    Figures(
        "effects",
        TRADEOFF,
        Sentence("(`gelsim tradeoff configs/quickstart.toml`: {ms} ms for four)"),
        lambda output: [left_out(output)["shadows"]["cpu_ms"]],
    ),
]

# --- Masks of coarse grids -----------------------------------------------------------------------------------------------------

MASK = "cargo test --release --test library physics::mask -- --nocapture"


def masks(output):
    found = {}
    for name in ("standard", "draft"):
        for width, _, median, least in scan(output.text, f"[{{}}, {{}}] {name}: median {{}}, worst of more than 1000 px {{}},"):
            found[name, int(width)] = median, least
    order = [(name, width) for name in ("standard", "draft") for width in (320, 640)]
    return [found[key][0] for key in order] + [found[key][1] for key in order]


MASK_FIGURES = [
    Figures(
        "gelpad",
        MASK,
        Sentence(
            "has the median {} at `standard` on 320x240 px and {} on 640x480 (`draft`: {} and {}); of contacts over 1000 px the worst is"
            " {} and {} (`draft`: {} and {}, a knurl"
        ),
        masks,
        "physics::mask::the_contact_mask_of_a_coarse_grid_is_the_references",
        tolerance=0.002,
    ),
    Figures(
        "gelpad",
        MASK,
        Sentence("at the levels' own within {} um (`draft`) and {} um (`standard`;"),
        lambda output: one(output, "draft and standard: [{}, {}] um"),
        "physics::mask::a_scene_in_a_mirror_is_the_mirrored_scene",
    ),
]

# --- The elastic layer against other solutions ---------------------------------------------------------------------------------

PHYSICS = "cargo test --release --test library physics -- --nocapture"
ELEMENTS = "cargo test --release --test library physics::finite_elements -- --nocapture"
DOMES = "cargo test --release --test library physics::curved_elements -- --nocapture"
BEYOND = "cargo test --release --test library physics::beyond -- --nocapture"


def oracle(sentence, test, new):
    return Figures("gelpad-accuracy", PHYSICS, Sentence(sentence), new, f"physics::{test}")


def limits(output):
    """Largest errors of linear theory by shape, for each depth."""
    found = {}
    for shape in ("ball", "cone", "cylinder", "punch"):
        for *size, _, um in scan(output.text, f'"{shape}" [{{}}, {{}}, {{}}], s {{}}: {{}} um, stated'):
            found.setdefault((shape, *size), []).append(um)
    flat, domed = found["ball", 3.3, 0.0, 0.0][:4], found["ball", 3.3, 0.0, 0.0][4:]
    padded = lambda values: values + [None] * (4 - len(values))
    return {
        "ball, radius 3.3 mm": flat,
        "the same, sticking": None,
        "cone, slope 0.6": found["cone", 0.0, 0.0, 0.6],
        "cylinder lying, radius 3.3 mm": found["cylinder", 3.3, 0.0, 0.0],
        "punch, radius 2 mm, edge rounded by 0.5 mm": found["punch", 2.0, 0.5, 0.0],
        "punch, radius 3 mm, edge rounded by 0.2 mm": padded(found["punch", 3.0, 0.2, 0.0]),
        "the same, sticking (2)": None,
        "ball of 3.3 mm on a pad domed by 10 mm over a flat shell": padded(domed[:2]),
    }


def factor(output, template):
    """The larger of both ratios, stated over true and true over stated."""
    ratios = [ratio for numbers in scan(output.text, template) for ratio in numbers]
    return [max(max(ratio, 1 / ratio) for ratio in ratios)]


def domes(output):
    rows = {}
    template = "ball of {} on a dome of {} mm, {} mm deep: force {} %, ring off by {} um, {} RMS, stated {}"
    for ball, dome, _, force, ring, _, stated in scan(output.text, template):
        cells = rows.setdefault(f"{ball:g} mm, {dome:g} mm", [[], [], []])
        for cell, value in zip(cells, (force, ring, stated)):
            cell.append(value)
    return rows


def cut_and_found(output):
    """Force and surface in view, without and with what lies beyond the window."""
    found = {}
    for place in ("in the middle", "its edge in view", "a bar of 60 x 9 mm across the view"):
        template = f"beyond, nu {{}}, {place}: {{}} N in view, cut [{{}}, {{}}, {{}}], found [{{}}, {{}}, {{}}]"
        for nu, _, cut, _, cut_um, force, _, um in scan(output.text, template):
            found[place, nu] = [100 * cut, 100 * force, cut_um, um]
    bars = [found["a bar of 60 x 9 mm across the view", nu] for nu in (0.48, 0.4999)]
    template = "beyond, nu {}, h 3: {} presses, worst if cut [{}, {}, {}], found [{}, {}, {}]"
    objects = {nu: [-100 * cut, 100 * force, cut_um, um] for nu, _, cut, _, cut_um, force, _, um in scan(output.text, template)}
    return {
        "plate of 200 mm, nu = 0.48": found["in the middle", 0.48],
        "the same, its edge in view": found["its edge in view", 0.48],
        "plate of 200 mm, nu = 0.4999": found["in the middle", 0.4999],
        "the same, its edge in view (2)": found["its edge in view", 0.4999],
        "bar of 60 x 9 mm, nu = 0.48 / 0.4999": [list(pair) for pair in zip(*bars)],
        "27 bundled objects across the border, worst, nu = 0.48": objects[0.48],
        "the same, nu = 0.4999": objects[0.4999],
    }


def whole_forces(output):
    """How far the whole force is off, percent: on pads of 3 mm, and of 1 mm."""
    plates = scan(output.text, "N in view, cut [{}, {}, {}], found [{}, {}, {}]")
    objects = scan(output.text, "h {}: {} presses, worst if cut [{}, {}, {}], found [{}, {}, {}]")
    thick = [numbers[4] for numbers in plates] + [numbers[6] for numbers in objects if numbers[0] == 3.0]
    return percent([max(map(abs, thick)), max(abs(numbers[6]) for numbers in objects if numbers[0] == 1.0)])


ORACLE_FIGURES = [
    oracle(
        "(`tests/physics/data`) | {} relative |",
        "greens::greens_functions_agree_with_a_table_of_17_digits",
        lambda output: [max(one(output, "relative errors of G, H, C, T: [{}, {}, {}, {}]"))],
    ),
    oracle(
        "against `realfft` in f64 | {} of the signal's norm |",
        "convolution::transforms_agree_with_plain_ones_in_f64_at_every_length",
        lambda output: one(output, "over the root of its length: {}"),
    ),
    oracle(
        "against numerical integration | {} of the middle value |",
        "kernel::the_kernel_is_the_displacement_around_a_pressed_pixel",
        lambda output: one(output, "worst error in space {} of the middle"),
    ),
    oracle(
        "nine pads and pixels, five pressures | {} of the largest displacement |",
        "response::near_and_far_field_are_the_whole_response",
        lambda output: one(output, "differ from the whole by up to {} of the largest displacement"),
    ),
    oracle(
        "| dense f64 solution on 16x16, 30 cases | pressure {} of the peak, surface {} um |",
        "contact::presses_agree_with_a_dense_solution_in_f64",
        lambda output: one(output, "dense: pressure off by {} of its peak, surface by {} um"),
    ),
    oracle(
        "| Hertz, radius 32 px | force {}, peak {}, radius {} px |",
        "solutions::a_sphere_on_a_thick_pad_is_hertzs",
        lambda output: [abs(value) for value in one(output, "hertz, Full: force {}, peak {}, radius {} px")],
    ),
    oracle(
        "| cone | force {}, radius {} px |",
        "solutions::a_cone_on_a_thick_pad_is_sneddons",
        lambda output: one(output, "cone: force {}, radius {} px"),
    ),
    oracle(
        "| flat punch, radius 8, 16, 32, 64 px | force {}, {}, {}, {} %:",
        "solutions::a_flat_punch_on_a_thick_pad_is_boussinesqs",
        lambda output: percent(column(output, "punch, radius {} px ({} mm): force {}", 2)),
    ),
    oracle(
        "| thin incompressible layer, a / h = 11, 21, 42 | force {}, {}, {} of",
        "solutions::a_sphere_on_a_thin_incompressible_pad_squeezes_it_like_a_film",
        lambda output: column(output, "film, a/h {}: force ratio {},", 1),
    ),
    oracle(
        "| thin compressible layer, same | {}, {}, {} |",
        "solutions::a_sphere_on_a_thin_compressible_pad_presses_columns",
        lambda output: column(output, "columns, a/h {}: force {},", 1),
    ),
    oracle(
        "| residual in the label, recomputed in f64 | within {<} um |",
        "contact::the_residual_in_the_label_is_the_largest_violation_there_is",
        lambda output: one(output, "residual: at most {} um above the label's"),
    ),
    oracle(
        "| mirrored, turned, shifted objects | {<} um |",
        "symmetry::an_object",
        lambda output: [worst(output, "{*}, {*}: {} um")],
    ),
    Figures(
        "gelpad-accuracy",
        ELEMENTS,
        Table("| object | s = d / h of 0.1 |", "l e e e e"),
        limits,
        "physics::finite_elements::the_label_knows_the_error_of_linear_theory_within_a_factor_of_two",
    ),
    Figures(
        "gelpad-accuracy",
        ELEMENTS,
        Sentence("It is within a factor of {<} of all 60 frictionless presses"),
        lambda output: factor(output, "stated over true from {} to {}, 60 presses"),
        "physics::finite_elements::the_label_knows_the_error_of_linear_theory_within_a_factor_of_two",
    ),
    Figures(
        "gelpad-accuracy",
        DOMES,
        Table("| ball, dome | force off at d =", "l e - e e"),
        domes,
        "physics::curved_elements::balls_on_domes_press_as_finite_elements_say",
    ),
    Figures(
        "gelpad-accuracy",
        BEYOND,
        Table("| object | force in view without what lies beyond |", "l e e e e"),
        cut_and_found,
        "physics::beyond::",
    ),
    Figures(
        "gelpad-accuracy",
        BEYOND,
        Sentence("(`total_force_n`) is within {<} % in these cases, within {<} % on a pad of 1 mm"),
        whole_forces,
        "physics::beyond::",
    ),
]

# --- Presses of one's own by finite elements -----------------------------------------------------------------------------------

FINITE = "gelsim tradeoff configs/quickstart.toml --finite-elements"
ROUND = ["sphere", "cone", "cylinder", "cylinder_shell", "torus", "washer"]
NOT_ROUND = ["coin", "hexagon_nut", "cube"]
NINE = "--set 'object=[{}]' --set 'indentation.depth_mm=[0.3, 0.9]'".format(
    ", ".join(f'{{ path = "objects/{name}.obj" }}' for name in ROUND + NOT_ROUND)
)


def sliding(output):
    rows = {}
    for name in ROUND:
        depth, _, most, rms, stated, deg, _, _, _, ratio, reached, seconds = line(output, name)
        rows[name] = [depth if reached == depth else [depth, reached], most, rms, stated, deg, ratio, seconds]
    apart = [one(output, f"{name} not round: {{}} mm from a body of revolution")[0] for name in NOT_ROUND]
    return rows | {", ".join(NOT_ROUND): [apart] + [None] * 6}


def sticking(output):
    rows = {name: line(output, name) for name in ROUND}
    return {name: [row[2], row[9]] for name, row in rows.items()}


FINITE_FIGURES = [
    Figures("gelpad-accuracy", FINITE, Table("| object | depth mm | ring max um |", "l e e e e e e - - t"), sliding, more=NINE),
    Figures(
        "gelpad-accuracy",
        FINITE,
        Table("| object | depth mm | ring max um |", "l - - - - - - e e -"),
        sticking,
        more=f"--sticking {NINE}",
    ),
    Figures(
        "gelpad-accuracy",
        FINITE,
        Sentence("The law is short of the cylinder's wall by a factor of {}."),
        lambda output: [line(output, "cylinder")[2] / line(output, "cylinder")[4]],
        more=NINE,
    ),
]

# --- Friction while pressing ---------------------------------------------------------------------------------------------------

FRICTION = "cargo test --release --test library physics::friction -- --nocapture"


def held(output):
    """Without friction and sticking: ring, motion in the contact, force, by shape and depth on the full grid."""
    template = 'Full "{shape}" [{{}}, {{}}, {{}}] s {{}}: ring {{}} -> {{}} um, in the contact {{}} -> {{}}, around it {{}}, force {{}} -> {{}}'
    found = {}
    for shape in ("ball", "cone", "punch"):
        for radius, edge, slope, s, *ring_and_motion, _, slides, sticks in scan(output.text, template.format(shape=shape)):
            ring, motion = ring_and_motion[:2], ring_and_motion[2:]
            found[shape, radius, edge, slope, s] = [ring, motion, [slides, sticks]]
    ball = lambda radius, s: found["ball", radius, 0.0, 0.0, s]
    return {
        "ball, radius 3.3 mm, 0.2": ball(3.3, 0.2),
        "the same, 0.3": ball(3.3, 0.3),
        "the same, 0.5": ball(3.3, 0.5),
        "ball, radius 1.5 mm, 0.3": ball(1.5, 0.3),
        "ball, radius 6 mm, 0.3": ball(6.0, 0.3),
        "ball, radius 12 mm, 0.3": ball(12.0, 0.3),
        "cone, slope 0.6, 0.3": found["cone", 0.0, 0.0, 0.6, 0.3],
        "punch, radius 3 mm, edge rounded by 0.2 mm, 0.3": found["punch", 3.0, 0.2, 0.0, 0.3],
    }


def markers(output):
    """Of markers without friction: how far those around a contact are off, and those under balls."""
    around = scan(output.text, "] s {}: markers off by {} um inside, {} around")
    balls = scan(output.text, 'frictionless "ball" [{}, {}, {}] s {}: markers off by {} um inside')
    inside = [[um for *_, depth, um in balls if depth == s] for s in (0.1, 0.3, 0.4)]
    return [
        max(um for s, _, um in around if s <= 0.3),
        max(um for s, _, um in around if s == 0.4),
        *[extreme(values) for values in inside for extreme in (min, max)],
    ]


FRICTION_FIGURES = [
    Figures(
        "friction",
        FRICTION,
        Table("| object, s = d / h |", "l e e e"),
        held,
        "physics::friction::a_pad_that_sticks_is_where_finite_elements_have_it",
    ),
    Figures(
        "friction",
        FRICTION,
        Sentence("within a factor of 2.5 of all but one ({}, a punch whose"),
        lambda output: one(output, "beyond 2.5: [({}, {*})]"),
        "physics::friction::the_label_knows_the_error_of_a_pad_that_sticks",
    ),
    Figures(
        "friction",
        FRICTION,
        Sentence(
            "are within {<} um RMS of finite elements up to s = 0.3 ({<} um at 0.4), but those under the object are not: {} to {} um at"
            " s = 0.1, {} to {} um at 0.3, {} to {} um at 0.4 under balls of 1.5 to 6 mm"
        ),
        markers,
        "physics::friction::markers_around_a_contact_without_friction_move_as_finite_elements_do",
    ),
]

# --- Gels that are not flat ----------------------------------------------------------------------------------------------------

CURVED = "cargo test --release --test library physics::curved -- --nocapture"
CURVED_LIGHT = "cargo test --release --test library physics::curved_light -- --nocapture"
MESH = "cargo test --release --test library physics::gel_mesh -- --nocapture"
CURVED_CASES = "cargo test --release --test library stability::curved -- --nocapture"
HEAT = "cargo test --release --lib heat -- --nocapture"


def curved(sentence, test, new, command=CURVED, **more):
    return Figures("curved-accuracy", command, Sentence(sentence), new, test, **more)


def kilometre(output):
    depth, surface = one(output, "depth {} surface {}")
    forces = one(output, "forces [{}, {}]")
    return [1e3 * max(depth, surface), from_one([forces[0] / forces[1]])]


def of_mesh(output):
    points, degrees = one(output, "points {} um, normals {} degrees apart at most")
    return [points, degrees, worst(output, "depth {} um, force"), from_one(column(output, "um, force {},"))]


def slips(output):
    """Over the angles at which the ball slips, its pull over the law's, whose coefficient is 0.3."""
    shares = [share / 0.3 for angle, share in scan(output.text, "{} rad: {} of the pressure") if angle > 0]
    return [min(shares), max(shares)]


def over_meshes(output):
    template = "a slide over a mesh, {*} at {} mm by [{}, {}]: force within {} %, sticking share {}, motion {} um"
    found = scan(output.text, template)
    tip = [numbers[3] for numbers in scan(output.text, template.replace("{*}", "dome")) if numbers[0] == 0.0]
    other = [numbers[3] for numbers in found if numbers[3] not in tip]
    return [max(tip), max(other), max(numbers[4] for numbers in found), max(numbers[5] for numbers in found)]


def at_the_rim(output):
    """Average of the gels' pictures under LEDs at the rim: the capsule's, the dome's; and the largest single value."""
    rim = lambda name: output.text.split(f"{name}: points", 1)[1].split("LEDs at the rim", 1)[1].split("apart at most")[0]
    pictures = {name: scan(rim(name), ", {} levels, {} but for a thousandth, {} on average") for name in ("capsule", "dome")}
    averages = [max(average for _, _, average in pictures[name]) for name in ("capsule", "dome")]
    return [*averages, max(most for found in pictures.values() for most, _, _ in found)]


def inside_gels(output):
    """The largest single value of the gels' pictures under LEDs inside."""
    found = []
    for name in ("capsule", "dome"):
        text = output.text.split(f"{name}: points", 1)[1].split("LEDs at the rim", 1)[0]
        found += scan(text, ", {} levels, {} but for a thousandth")
    return [max(most for most, _ in found)]


def saw_teeth(output):
    pairs = scan(output.text, "{} levels RMS over {} values that the press changes, {} averaged")
    plain, gains = [before for before, _, _ in pairs], [100 * (1 - after / before) for before, _, after in pairs]
    return [min(plain), max(plain), min(gains), max(gains)]


def shadows_inside(output):
    found = [
        one(
            output,
            f"shadows of a {shape} at [{place}] by rays, {{}} values around it: {{}} levels on average, {{}} RMS, {{}} at most",
        )
        for shape, place in (("sphere", "26.0, 0.0"), ("cube", "24.0, 50.0"))
    ]
    return [numbers[1] for numbers in found] + [numbers[2] for numbers in found] + [max(numbers[3] for numbers in found)]


CURVED_FIGURES = [
    curved(
        "ball on domes of 10, 12 and 30 mm, thick gel | force within {<} % |",
        "physics::curved::a_ball_on_a_thick_dome_presses_as_hertz_says",
        lambda output: [from_one(column(output, "{} of Hertz"))],
    ),
    curved(
        "3 mm of gel, up to 1.2 mm deep | force within {<} % |",
        "physics::curved_elements::balls_on_domes_press_as_finite_elements_say",
        lambda output: [worst(output, "mm deep: force {} %")],
    ),
    curved(
        "ball on cylinders of 10, 12 and 30 mm, thick gel | force within {<} % |",
        "physics::curved::a_ball_on_a_thick_cylinder_presses_as_hertz_says",
        lambda output: [from_one(column(output, "{} of Hertz"))],
    ),
    curved(
        "at 5 to 60 degrees from the tip of a dome | force within {<} % |",
        "physics::curved::the_same_press_anywhere_on_a_dome_gives_the_same_force",
        lambda output: [from_one(column(output, "{} of the force at the tip"))],
    ),
    curved(
        "on a finger's cap, and on its cylinder, anywhere | force within {<} % |",
        "physics::curved::the_same_press_around_a_finger_and_along_it_gives_the_same_force",
        lambda output: [from_one(column(output, "mm from the tip, {} degrees: {}", 1))],
    ),
    curved(
        "and a nanometre beside it in another direction | force within {<} %, {<} levels but for a thousandth of the values |",
        "stability::curved::a_press_beside_the_pole_is_that_on_the_pole",
        lambda output: [
            from_one(column(output, "on average, force {}")),
            worst(output, "degrees: {} levels but for a thousandth"),
        ],
        CURVED_CASES,
    ),
    curved(
        "a ball moved by 10 um | force within {<} %, {<} levels on average, {<} at most |",
        "physics::curved::there_is_no_seam_on_a_finger",
        lambda output: [
            from_one(column(output, "on average, force {}")),
            worst(output, "by more than 4, {} on average"),
            worst(output, "mm: Some({}) levels"),
        ],
    ),
    curved(
        "over 0.5 rad from the LED | within {<} degrees |",
        "core::optics::heat::round::tests::on_a_dome_light_comes_along_great_circles",
        lambda output: one(output, "farthest from a great circle: {} degrees"),
        HEAT,
    ),
    curved(
        "| depth and surface within {<} um, force within {<} %, image within one level |",
        "physics::curved::a_dome_of_a_kilometre_is_a_flat_pad",
        kilometre,
    ),
    curved(
        "node by node, dome and finger | within {<} um |",
        "physics::curved_texture::texture_on_a_dome_of_a_kilometre_is_that_of_a_flat_pad",
        lambda output: one(output, "depth within {} um of the flat pad's"),
    ),
    curved(
        "| a press, push and turn over a dome of 1 km against the flat pad | force within {<} %, motion within {<} um,",
        "physics::curved_sequences::a_slide_over_a_dome_of_a_kilometre_is_that_over_a_flat_pad",
        lambda output: [worst(output, "force off by {} %"), worst(output, "flow by {} um")],
    ),
    curved(
        "| the same slide in other places of a finger, and of a dome | force within {<} and {<} % |",
        "physics::curved_sequences::the_same_slide_anywhere_on_a_gel_gives_the_same_forces",
        lambda output: [
            worst(output, f"{gel}: a slide at [{{}}, {{}}]: forces within {{}} %", 2) for gel in ("geltip", "tactip")
        ],
    ),
    curved(
        "by 0.6 rad, at 0.4 mm a pixel | pulled by {} to {} mu N |",
        "physics::curved_sequences::a_ball_that_slips_on_a_dome_is_pulled_by_friction_and_follows_the_charts",
        slips,
        tolerance=0.001,
    ),
    curved(
        "19,000 triangles | points within {<} um, normals {<} degrees; four presses: depth {<} um, force {<} % |",
        "physics::gel_mesh::a_mesh_of_a_dome_is_a_dome",
        of_mesh,
        MESH,
    ),
    curved(
        "23,000 triangles | points within {<} um, normals {<} degrees (where ball and cylinder meet); four presses: depth {<} um, force"
        " {<} % |",
        "physics::gel_mesh::a_mesh_of_a_capsule_is_a_capsule",
        of_mesh,
        MESH,
    ),
    curved("(dome: four), single ones up to {<} |", "physics::gel_mesh::a_mesh_of_a_", inside_gels, MESH),
    curved(
        "LEDs at the rim | {} levels on average (dome {}), single values up to {<} |",
        "physics::gel_mesh::a_mesh_of_a_",
        at_the_rim,
        MESH,
    ),
    curved(
        "8 frames | force within {<} % around the dome's tip, else {<} %; share that sticks {<}, motion {<} um but for a thousandth |",
        "physics::gel_mesh::a_slide_over_a_mesh_is_that_over_the_same_gel_by_formula",
        over_meshes,
        MESH,
    ),
    curved(
        "| a flat mesh against the flat pad | surface within {<} um, the same force |",
        "physics::gel_mesh::a_flat_mesh_is_a_flat_pad",
        lambda output: [worst(output, "surface {} um, force")],
        MESH,
    ),
    curved(
        "normals of a mesh through bundled objects | within {<} um |",
        "physics::gel_mesh::capture_on_a_mesh_is_what_rays_meet",
        lambda output: one(output, "met something, {} um apart at most"),
        MESH,
    ),
    curved(
        "| 331 pins at rest on a mesh of the TacTip's dome | within {<} um |",
        "physics::gel_mesh::pins_of_a_mesh_rest_where_those_of_the_dome_do",
        lambda output: one(output, "pins at rest {} um apart at most"),
        MESH,
    ),
    curved(
        "800 pictures of a TacTip | worst ring {} px of 128 | | motion of the rings between 2 and 4 mm | {} px RMS of",
        "physics::curved::the_pins_of_a_tactip_are_where_they_are_in_pictures",
        lambda output: one(output, "worst ring {} px, motion {} px RMS"),
    ),
    curved(
        "around a finger of 23 mm has {} N on the chart",
        "stability::curved::what_wraps_a_finger_beyond_its_chart_says_that_its_force_is_not_known",
        lambda output: one(output, "ring: {} N on the chart"),
        CURVED_CASES,
    ),
    Figures(
        "curved",
        CURVED_LIGHT,
        Sentence("lose {} and {} levels on average around the press, {} and {} RMS, single values up to {};"),
        shadows_inside,
        "physics::curved_light::shadows_of_leds_inside_a_gel_are_left_out_and_are_small_by_rays",
    ),
    Figures(
        "curved",
        CURVED_LIGHT,
        Sentence("({} to {} levels RMS where a press changes them) that takes {} to {} %"),
        saw_teeth,
        "physics::curved_light::light_on_a_finger_is_nearer_to_that_of_finer_pictures_where_it_is_averaged",
    ),
]

# --- Models of the effects -----------------------------------------------------------------------------------------------------

WALLS = "cargo test --release --test library physics::walls -- --nocapture"
NEAR = "cargo test --release --test library physics::near_light -- --nocapture"
DOME = "cargo test --release --test library effects::dome -- --nocapture"
BOUNCE = "cargo test --release --test library physics::interreflection -- --nocapture"
IN_PLANE = "cargo test --release --test library physics::inplane -- --nocapture"
TEETH = "physics::walls::a_turned_wall_has_no_saw_teeth_at_any_level"
NEAR_BALL = "physics::near_light::light_of_a_near_led_on_a_ball_is_that_of_traced_rays_within_a_third_of_a_level"
NEAR_SHADOWS = "physics::near_light::shadows_of_near_leds_are_parallel_and_off_by_what_the_page_says"


def walls(output):
    def at(level, size):
        found = scan(
            output.text,
            f"{level}, [{size}]: [{{}}, {{}}, {{}}] grey levels along a wall; [{{}}, {{}}, {{}}] without samples between centres",
        )
        return [found[0][:3], found[0][3:]] if found else [None, None]

    coarse, fine = "320, 240", "640, 480"
    return {
        "draft": at("draft", coarse) + at("draft", fine),
        "standard": at("standard", coarse) + at("standard", fine),
        "high, reference": at("high", coarse) + at("reference", fine),
    }


def near(output):
    """Of each distance and elevation: near LED, LED at infinity, heights left out, each mean, largest, largest off the edge."""
    found = scan(output.text, "{} mm, {} degrees: {} / {} / {}; {} / {} / {}; {} / {} / {}")
    rows = {}
    for distance in (8.0, 12.0, 20.0):
        own = [numbers[2:] for numbers in found if numbers[0] == distance]
        regardless = [min(n[6] for n in own), max(n[6] for n in own), max(n[7] for n in own)]
        rows[f"at {distance:g} mm"] = [numbers[0] for numbers in own] + [regardless]
        rows["at infinity"] = [numbers[3] for numbers in own] + [None]
    return rows


def near_largest(output):
    found = scan(output.text, "degrees: {} / {} / {}; {} / {} / {}; {}")
    return [max(n[1] for n in found), max(n[4] for n in found), max(max(n[2], n[5]) for n in found)]


def near_shadows(output):
    template = "{shape}, {{}} mm, {{}} degrees: {{}} / {{}} / {{}}; {{}} /"
    ball = scan(output.text, template.format(shape="Ball { radius: 4.0, deep: 0.8 }"))
    block = scan(output.text, template.format(shape="Block { half: 2.0, deep: 0.8 }"))
    low = [mean for distance in (8.0, 12.0, 20.0) for d, angle, mean, *_ in ball if d == distance and angle < 60.0]
    infinite = [far for d, angle, _, _, _, far in ball if d == 8.0 and angle < 60.0]
    blocks = [mean for d, _, mean, *_ in block if d == 8.0]
    far = [numbers[5] for numbers in block]
    return [*low, *infinite, *blocks, min(far), max(far)]


def domed(output):
    """Contact radius and force, and peak pressure, over those of the smaller ball; then radius and force of the smallest dome."""
    found = scan(output.text, "{} {} {}: {}, {}, {} (")
    wide = [numbers for numbers in found if numbers[1] >= 30.0]
    small = [numbers for numbers in found if numbers[:2] == [8.0, 12.0]]
    return [
        from_one([ratio for numbers in wide for ratio in numbers[3:5]]),
        from_one([numbers[5] for numbers in found]),
        from_one([ratio for numbers in small for ratio in numbers[3:5]]),
    ]


def bounces(output):
    shapes = ("sphere", "cube", "gear", "coin")
    found = {shape: one(output, f"{shape} {{}} / {{}} / {{}}; {{}} /") for shape in shapes}
    return {shape: numbers for shape, numbers in found.items()}


def bounce_shares(output):
    shares = [100 * mean / direct for mean, _, _, direct in bounces(output).values()]
    return [min(shares), max(shares)]


def paths(output):
    """Of ball and block: any number of bounces, pairs of pixels, all but the first bounce, in percent of the direct light."""
    found = [
        one(output, f"{shape}: {{}} %; {{}} %; {{}} %")
        for shape in ("Ball { radius: 4.0, deep: 0.8 }", "Block { half: 2.0, deep: 0.8 }")
    ]
    return [value for pairs, single, every in found for value in (every, pairs, every - single)]


EFFECT_FIGURES = [
    Figures("effects-models", WALLS, Table("| level | 320x240 | without samples", "l e e e e"), walls, TEETH),
    Figures(
        "effects-models",
        WALLS,
        Sentence("The preset's noise is {}, {} and {};"),
        lambda output: one(output, "the preset's noise: [{}, {}, {}]"),
        TEETH,
    ),
    Figures("effects-models", NEAR, Table("| LED | 15 degrees |", "l e e e e e"), near, NEAR_BALL),
    Figures(
        "effects-models",
        NEAR,
        Sentence("single ones are off by up to {} levels ({} at infinity); all others are within {<}."),
        near_largest,
        NEAR_BALL,
    ),
    Figures(
        "effects-models",
        NEAR,
        Sentence(
            "the mean difference from traced rays is {}, {} and {} levels at 8 mm and 15, 30 and 45 degrees, {}, {} and {} at 12 mm, {},"
            " {} and {} at 20 mm, {}, {} and {} at infinity; on an upright block of 4 mm, whose shadow spreads with the distance, {}, {},"
            " {} and {} at 8 mm and 15 to 60 degrees ({} to {} at infinity)"
        ),
        near_shadows,
        NEAR_SHADOWS,
    ),
    Figures(
        "effects-models",
        DOME,
        Sentence(
            "radius and force are within {<} % for dome radii of 30 mm and more, peak pressure within {<} % (`cargo test --release"
            " --test library effects::dome -- --nocapture`; {<} % for R 8 on D 12)"
        ),
        domed,
        "effects::dome::a_ball_on_a_dome_presses_like_a_smaller_ball_on_a_flat_pad",
    ),
    Figures(
        "effects-models",
        BOUNCE,
        Table("| object, 0.8 mm | mean |", "l e e e e"),
        bounces,
        "physics::interreflection::a_bounce_of_light_is_little_beside_what_the_press_changes",
    ),
    Figures(
        "effects-models",
        BOUNCE,
        Sentence("It is smooth, {} to {} % of the direct change,"),
        bounce_shares,
        "physics::interreflection::a_bounce_of_light_is_little_beside_what_the_press_changes",
    ),
    Figures(
        "effects-models",
        BOUNCE,
        Sentence(
            "give {} % of the direct light around a ball (pairs of pixels: {} %; all but the first bounce: {} %) and {} % around a block"
            " with upright walls ({} %; {} %)"
        ),
        paths,
        "physics::interreflection::one_bounce_between_all_pairs_is_what_random_paths_bring",
    ),
    Figures(
        "effects-models",
        IN_PLANE,
        Sentence("torus with six thicknesses of room; {} um RMS from a fine-grid f64 reference"),
        lambda output: [worst(output, "{} um RMS, {} largest")],
        "physics::inplane::displacement_under_pressure_agrees_with_a_fine_grid",
    ),
    Figures(
        "effects-models",
        IN_PLANE,
        Sentence("moves markers by up to {} um, at 0.35 mm by {} um"),
        lambda output: [one(output, f"ball R 4, h 3, nu 0.4999, d {depth}: {{}} um at most")[0] for depth in ("1", "0.35")],
        "physics::inplane::a_ball_drives_the_pad_outward_evenly_all_around",
    ),
    Figures(
        "effects-models",
        IN_PLANE,
        Sentence("Against Mindlin's disc the force is {} to {} % high"),
        lambda output: [100 * (extreme(column(output, "disc, pitch {}: force {},", 1)) - 1) for extreme in (min, max)],
        "physics::inplane::a_disc_that_sticks_is_as_stiff_as_mindlin_and_reissner_say",
    ),
    Figures(
        "effects-models",
        IN_PLANE,
        Sentence("against Cattaneo and Mindlin's ball within {<} %"),
        lambda output: [100 * max(abs(own - true) for _, own, true in scan(output.text, "shear: ball, {}: force {}, {};"))],
        "physics::inplane::a_ball_under_shear_slips_in_the_ring_of_cattaneo_and_mindlin",
    ),
]

# --- Sequences and grips -------------------------------------------------------------------------------------------------------

HISTORY = "cargo test --release --test library physics::history -- --nocapture"
SEQUENCES = "cargo test --release --test library physics::sequences -- --nocapture"
SLIP = "gelsim tradeoff configs/slip.toml --samples 6"
GRIPPER = "cargo test --release --test library physics::gripper"
GRIPS = "gelsim generate configs/gripper.toml --samples 200"
LIFTS = "gelsim generate configs/gripper-lift.toml --samples 40"


def sequences(sentence, command, test, new, **more):
    return Figures("sequences", command, Sentence(sentence), new, f"physics::{test}", **more)


def slip_levels(output):
    rows = {}
    for name in ("draft", "standard", "high", "reference"):
        force, _, onset, gross, _, flow, largest, cpu = line(output, name)
        rows[name] = [force, onset, gross, [flow, largest], cpu]
    return rows


def labels(output, name):
    """The labels of a dataset that the command wrote."""
    for shard in sorted((output.folder / "out" / name / "data").glob("*.tar")):
        with tarfile.open(shard) as tar:
            for member in tar:
                if member.name.endswith(".json"):
                    yield json.load(tar.extractfile(member))


def unbalanced(output):
    return [
        100
        * max(abs(grip["residual_n"]) / grip["force_n"] for grip in (label["gripper"] for label in labels(output, "gripper")))
    ]


def presses(output):
    counts = [label["gripper"]["presses"] for label in labels(output, "gripper")]
    return [statistics.median(counts), max(counts)]


def lifts(output):
    """How far the forces of a frame differ, percent; and the contacts that are solved for a sequence."""
    apart, counts = [], []
    for label in labels(output, "gripper-lift"):
        counts.append(sum(frame["gripper"]["presses"] for frame in label["frames"]))
        for frame in label["frames"]:
            forces = [abs(frame[finger]["wrench"]["force_n"][2]) for finger in ("left", "right")]
            apart.append(abs(forces[0] - forces[1]) / max(max(forces), 1e-9))
    return [100 * max(apart), statistics.median(counts)]


SEQUENCE_FIGURES = [
    sequences(
        "(press, push around a corner, twist, lift) | force and moment within {<} of mu N |",
        HISTORY,
        "history::pressing_pushing_around_a_corner_turning_and_lifting_agree_with_plain_matrices",
        lambda output: [worst(output, "off plain matrices by {} of mu N")],
    ),
    sequences(
        "| force within {<} % of mu N (36 pixels across), stick radius within {<} of the contact's, heat of a loop {} % off |",
        HISTORY,
        "history::a_ball_that_is_pushed_out_back_and_out_again_follows_mindlin_and_deresiewicz",
        lambda output: [
            value * scale
            for value, scale in zip(
                [
                    *one(output, "36 px: force off by {} of mu N, stick radius by {} of the contact's"),
                    from_one(one(output, "36 px: {*} heat of a loop {}")),
                ],
                (100, 1, 1),
            )
        ],
    ),
    sequences(
        "| Mindlin, from the job to the label, pad of 12 mm | force within {<} % of mu N, stick radius within {<} |",
        SEQUENCES,
        "sequences::a_ball_pushed_over_a_thick_pad_follows_mindlin",
        lambda output: [
            100 * one(output, "Mindlin: force off by {} of mu N")[0],
            one(output, "stick radius by {} of the contact's")[0],
        ],
    ),
    sequences(
        "| Lubkin's torsion of a ball | gross slip {} of 3 pi mu N a / 16; stuck {} (",
        HISTORY,
        "history::a_ball_that_is_turned_follows_lubkin",
        lambda output: one(output, "torsion {} of 16 G a^3 / 3, {} of 3 pi mu N a / 16")[::-1],
        tolerance=0.0005,
    ),
    sequences(
        "| Kalker's rolling ball, one pixel a step | creep {} along, {} across |",
        HISTORY,
        "history::a_rolling_ball_creeps_as_kalker_says",
        lambda output: [one(output, f"creep along {axis}: {{}} of Kalker's")[0] for axis in "xy"],
        tolerance=0.0005,
    ),
    sequences(
        "| gross slip of a ball and a cube at `draft` to `high`, after a slide of 1.5 mm | {} mu N |",
        SEQUENCES,
        "sequences::what_slips_as_a_whole_is_pulled_by_friction_times_force",
        lambda output: [max(column(output, "{} of mu N in gross slip"), key=lambda ratio: abs(ratio - 1))],
        tolerance=0.0005,
    ),
    sequences(
        "| a ball that rolls by 20 degrees | goes on by {} mm of {}, pulled by {} mu N |",
        SEQUENCES,
        "sequences::a_ball_that_rolls_goes_on_without_being_pulled",
        lambda output: one(output, "rolled {} mm of {}; pulled by {} mu N"),
        tolerance=0.0005,
    ),
    sequences(
        "ball and cube pressed, pushed with a twist, half lifted | motion within {<} um, force within {<} % of mu N |",
        SEQUENCES,
        "sequences::twenty_five_frames_a_second_do_as_well_as_four_hundred",
        lambda output: [worst(output, "frames a second: {} um"), 100 * worst(output, "frames a second: {} um, {} of mu N", 1)],
    ),
    sequences(
        "| 400 steps of 0.75 um against 10 of 30 um | force within {<} |",
        HISTORY,
        "history::loads_that_grow_keep_tractions_and_slow_motion_loses_none",
        lambda output: [worst(output, "against 10 of 30 um: force off by {}")],
    ),
    sequences(
        "| 1,000 steps to and fro | force drifts by {<} at most,",
        HISTORY,
        "history::a_thousand_steps_to_and_fro_drift_nowhere_and_make_heat",
        lambda output: [worst(output, "force drifts by {},")],
    ),
    Figures("sequences", SLIP, Table("| level | force RMS % of the largest | onset off, ms |", "l e e e e t"), slip_levels),
    Figures(
        "gripper",
        GRIPPER,
        Sentence("| each finger's share of the squeeze within {<} % of it, the force within {<} % |"),
        lambda output: [100 * worst(output, "share off by {}, force"), 100 * worst(output, "share off by {}, force by {}", 1)],
        "physics::gripper::a_ball_between_two_thick_pads_is_two_contacts_of_hertz_in_series",
    ),
    Figures("gripper", GRIPS, Sentence("they differ by at most {<} % of the force."), unbalanced),
    Figures(
        "gripper", GRIPS, Sentence("| contacts solved for a grip of `configs/gripper.toml` | median {}, at most {};"), presses
    ),
    Figures(
        "gripper",
        LIFTS,
        Sentence("| the forces of `wrench` differ by at most {<} %; {} contacts are solved for the balance of a sequence;"),
        lifts,
    ),
]

# --- Depth frames from inside, soft and several objects, crates ----------------------------------------------------------------

INSIDE = "cargo test --release --test library physics::inside -- --nocapture"
SOFT = "cargo test --release --test library physics::soft"
SEVERAL = "cargo test --release --test library physics::several -- --nocapture"
CRATES = "cargo tree -p gelsim -e normal --prefix none --no-default-features --features FEATURE"


def frames_inside(output):
    rows = {}
    for name, gel in (
        ("tactip, fisheye, 128x128", "tactip"),
        ("geltip, pinhole, 320x240", "geltip"),
        ("allsight, fisheye, 320x240", "allsight"),
        ("fingertip (mesh), pinhole, 320x240", "fingertip"),
    ):
        found = scan(output.text, f"{gel} [{{}}, {{}}]: force {{}}, {{}} of {{}} over 2, {{}} at most")
        (_, _, tip, few, values, most), (_, _, beside, more, _, largest) = found
        # The count of an image's values is given once for both fingers.
        counted = [few, more, values] if gel in ("tactip", "geltip") else [few, more]
        rows[name] = [[tip, beside], counted, [most, largest] if most != largest else largest]
    return rows


def soft(output):
    force = lambda grid: 100 * worst(output, f"{grid}, {{}} kPa: force {{}},", 1)
    shares = [share for stiffness, share in scan(output.text, "Full, {} kPa: force {*} share {}") if stiffness == 100.0]
    return [force("Full"), force("Quarter"), 100 * max(map(abs, shares))]


def crates(output):
    names = {text.removesuffix(" (*)") for text in output.text.splitlines() if text.strip()}
    return [sum(not name.startswith("gelsim v") for name in names)]


OTHER_FIGURES = [
    Figures(
        "simulators",
        INSIDE,
        Table("| sensor, frame | place | force |", "l - e e e"),
        frames_inside,
        "physics::inside::a_frame_of_the_sensors_own_lens_gives_the_press_of_the_object_that_it_shows",
        tolerance=0.0005,
    ),
    Figures(
        "objects",
        SOFT,
        Sentence(
            "to ten times it the force is within {<} % and the contact's radius within 0.6 % on the camera's own grid, {<} % and 2 px on"
            " every fourth pixel; of a ball as stiff as the pad each takes half of the approach within {<} %"
        ),
        soft,
        "physics::soft::a_soft_ball_on_a_thick_pad_is_hertzs_with_two_moduli",
    ),
    Figures(
        "objects",
        SEVERAL,
        Sentence("differs from that on one alone by {} % where they are 6 mm apart, by {} % at 10 mm and {} % at 16 mm"),
        lambda output: percent(column(output, "mm apart: {} of the force")),
        "physics::several::two_balls_far_apart_press_like_each_of_them_alone",
    ),
] + [
    Figures("architecture", CRATES, Sentence(f"| {row} | {{}} |"), crates, tolerance=0.0, fill={"FEATURE": feature})
    for feature, row in (
        ("''", "none | the simulator, presets and PNG"),
        ("files", "`files` | sensor files, meshes and pictures"),
        ("cli", "`cli` (default) | the command"),
        ("stores", "`stores` | the command, and datasets in object stores ([stores.md](stores.md))"),
    )
]

# --- Stability -----------------------------------------------------------------------------------------------------------------

STABILITY = "cargo test --release --test library stability -- --nocapture"
CONTACT = "cargo test --release --test library stability::contact -- --nocapture"
GEOMETRY = "cargo test --release --test library stability::geometry -- --nocapture"
LIGHT = "cargo test --release --test library stability::light -- --nocapture"
TEXTURE = "cargo test --release --test library stability::texture -- --nocapture"
CORNERS = "GELSIM_THOROUGH=1 cargo test --release --test library stability::corners -- --nocapture"
CONTINUITY = (
    "cargo test --release --test library -- --nocapture stability::continuity stability::sweeps stability::symmetry stability::twin"
    " stability::stages"
)
DITTO = Sentence("have the same figures: {} iterations, residual {}, bulge {}, {} of its bound, depth {}, normal {}.")


def printed(output):
    """What each case printed, by its name."""
    rows = [text.strip("|").split(" | ") for text in output.text.splitlines() if text.startswith("| ")]
    return {row[0].strip(): row[2].strip(" |") for row in rows}


def cases(output):
    rows = {}
    for name, said in printed(output).items():
        solved = scan(said, "; {} iterations to {} of the tolerance; bulge {} of the depth, {} of its bound")
        bent = scan(said, "; to {} of the pad, normals to {} degrees")
        # Of objects that touch nothing the page gives no figures.
        rows[name] = [*solved[0], *bent[0]] if solved and bent else None
    return rows


def counted(output):
    """How many cases are valid and how many refused, and their samples."""
    said = printed(output).values()
    refused = sum(text.startswith("refused") for text in said)
    samples = sum(numbers[1] for text in said for numbers in scan(text, "{} of {} touch"))
    return {"cases": len(said), "valid": len(said) - refused, "refused": refused, "samples": samples}


def counts(*keys):
    return lambda output: [counted(output)[key] for key in keys]


def hard(page, command, heading, test, **more):
    return Figures(page, command, Table(heading, "l - - e e e e e e", **more), cases, test, tolerance=0.01)


def class_of_cases(row, test):
    """A row of the page that sums up: `N cases, N samples | N valid (..), N refused`."""
    place = Sentence(f"{row} | {{}} cases, {{}} samples | {{}} valid{{*}}, {{}} refused |")
    return Figures("stability", STABILITY, place, counts("cases", "samples", "valid", "refused"), test, tolerance=0.0)


def bulges(output):
    """Over the depth of the press: under the plate with one hole, and the most of all objects without holes."""
    found = {name: row[2] for name, row in cases(output).items() if row}
    return [found["a plate with one hole"], max(bulge for name, bulge in found.items() if "hole" not in name)]


def corners(output):
    jobs, refused = one(output, "random corners: {} jobs, {} refused")
    return [jobs, jobs - refused, refused]


def change(key, begins):
    """The largest of a key in the changes that the tests print, of lines that begin as the regular expression says."""

    def largest(output):
        lines = [text for text in output.text.splitlines() if re.match(begins, text)]
        found = [value for text in lines for (value,) in scan(text, f"{key}: {{}}")]
        if not found:
            raise Stale(f"no line begins with {begins}")
        return max(found)

    return largest


def continuity(sentence, test, *new):
    """An entry of the page whose figures each come from a function of their own."""
    place, values = Sentence(sentence), lambda output: [each(output) for each in new]
    return Figures("stability-continuity", CONTINUITY, place, values, f"stability::{test}")


def summed(sentence, test, new, command=STABILITY, **more):
    """An entry of the page that sums up."""
    return Figures("stability", command, Sentence(sentence), new, f"stability::{test}", **more)


def excess(output, rung):
    """How much further the surface moves than the object, whose steps are an eighth of the range."""
    found = scan(output.text, f"depth {{}} .. {{}} mm, {{*}}, {rung}: Change {{ {{*}}surface_um: {{}}")
    return max(surface - 1e3 * (end - begin) / 8 for begin, end, surface in found)


def twin(output, rung, index):
    """Of surface, normals and light: how far a level is from the pipeline in f64."""
    return worst(output, f"{rung}: surface {{}} um, normals {{}} degrees, light {{}} levels", index)


def mirrored(output):
    pairs = scan(output.text, "{} pairs differ by up to {} um and {} levels")
    return [sum(numbers[0] for numbers in pairs), *[max(numbers[index] for numbers in pairs) for index in (1, 2)]]


def off(rung):
    return lambda output: from_one(column(output, f"{rung}, {{}} mm: {{}} of the reference's stiffness", 1))


MILLIONTH = "continuity::a_millionth_more_of_anything_does_not_show"
SHADOWED = "continuity::a_millionth_more_of_anything_moves_no_shadow_but_in_single_pixels"
EDGE = "continuity::an_edge_that_crosses_pixel_centres_moves_by_a_row_of_pixels"
STEPS = "sweeps::a_step_in_depth_moves_shadows_by_few_levels"
RESPONSE = "sweeps::where_the_pads_response_is_computed_otherwise_the_surface_hardly_jumps"
MIRRORED = "symmetry::a_sample_mirrored_transposed_or_turned_is_the_sample_of_the_scene_that_is"
TWIN = "twin::every_rung_gives_the_surface_and_the_image_of_the_f64_pipeline"
STAGES = "stages::normals_light_and_levels_follow_from_the_surface_at_every_rung"
MARCHED = "stages::shadows_are_those_of_marched_rays_where_penumbras_do_not_overlap"


def shadow_steps(key, rung):
    return change(key, f"shadows in depth, .*, {rung}: ")


STABILITY_FIGURES = [
    hard("stability-contact", CONTACT, "Test: `contact::every_contact`.", "stability::contact::sound"),
    hard("stability-contact", CONTACT, "Test: `contact::every_grid`.", "stability::contact::on_grids"),
    hard("stability-geometry", GEOMETRY, "Test: `geometry::every_mesh`.", "stability::geometry::sound"),
    hard("stability-light", LIGHT, "Test: `light::every_light`.", "stability::light::sound", ditto=DITTO),
    hard("stability-light", TEXTURE, "Test: `texture::every_texture`.", "stability::texture::sound"),
    Figures(
        "stability-contact",
        CONTACT,
        Sentence("Of {} contacts {} are valid"),
        counts("cases", "valid"),
        "stability::contact::sound",
        tolerance=0.0,
    ),
    Figures(
        "stability-contact",
        CONTACT,
        Sentence("of {} grids {} valid and {} refused"),
        counts("cases", "valid", "refused"),
        "stability::contact::on_grids",
        tolerance=0.0,
    ),
    Figures(
        "stability-geometry",
        GEOMETRY,
        Sentence("Of {} meshes {} are valid and {} refused"),
        counts("cases", "valid", "refused"),
        "stability::geometry::sound",
        tolerance=0.0,
    ),
    Figures(
        "stability-light",
        LIGHT,
        Sentence("Of {} cases of light {} are valid ({} samples of one not solved, as their labels say) and {} refused"),
        lambda output: [
            *counts("cases", "valid")(output),
            worst(output, "touch, {} unsolved and said to be"),
            *counts("refused")(output),
        ],
        "stability::light::sound",
        tolerance=0.0,
    ),
    Figures(
        "stability-light",
        TEXTURE,
        Sentence("of {} of texture and print {} valid and {} refused"),
        counts("cases", "valid", "refused"),
        "stability::texture::sound",
        tolerance=0.0,
    ),
    class_of_cases("pads of 0.05 mm to 1 m, pixels of 1 um to 10 mm", "stability::contact::sound"),
    class_of_cases("| image sizes from 0 px to 8193 px", "stability::contact::on_grids"),
    class_of_cases("far away, five million triangles", "stability::geometry::sound"),
    class_of_cases("odd backgrounds and calibrations", "stability::light::sound"),
    class_of_cases("deeper than the pad, four million", "stability::texture::sound"),
    Figures(
        "stability-reference",
        STABILITY,
        Sentence("rises by {} depths in the hole. Without holes the most was {} depths"),
        bulges,
        "stability::",
    ),
    Figures(
        "stability-reference",
        CORNERS,
        Sentence("| {} jobs at random ends of {*} | {} valid, {} refused |"),
        corners,
        "stability::corners::random_corners_of_all_ranges_give_sound_samples_or_are_refused",
        tolerance=0.0,
    ),
    summed(
        "| several limits at once, at random | {} jobs | {} valid, {} refused |",
        "corners::random_corners_of_all_ranges_give_sound_samples_or_are_refused",
        corners,
        command=CORNERS,
        tolerance=0.0,
    ),
    summed(
        "| surface within {<} um, image within 1 level, but for edges",
        MILLIONTH,
        lambda output: [change("surface_um", "a millionth, ")(output)],
    ),
    summed(
        "the largest jumps are at `draft` and `standard`: {} and {} um |",
        STEPS,
        lambda output: [shadow_steps("surface_um", rung)(output) for rung in ("Draft", "Standard")],
    ),
    summed("| {} pairs | surface within {<} um, image within {<} level |", MIRRORED, mirrored, tolerance=0.0),
    summed("| `reference`: {} um, every value of the image equal |", TWIN, lambda output: [twin(output, "Reference", 0)]),
    continuity(
        "A change of a millionth moves the surface by at most {<} um and", MILLIONTH, change("surface_um", "a millionth, ")
    ),
    continuity(
        "| surface at most {<} um (rounding on the coin's steep flanks), light {<} levels, image {<} level in at most {<} % of the values",
        MILLIONTH,
        change("surface_um", "a millionth, "),
        change("light_levels", "a millionth, "),
        change("image_levels", "a millionth, "),
        lambda output: 100 * change("image_share", "a millionth, ")(output),
    ),
    continuity(
        "| draft and standard {} levels; high {} levels in {} % of the values (coin, LED turned), else",
        SHADOWED,
        change("light_levels", "a millionth, shadows, (Draft|Standard)"),
        change("light_levels", "a millionth, shadows, High"),
        lambda output: 100 * change("light_share", "a millionth, shadows, High")(output),
    ),
    continuity(
        "the light there changes by up to {} levels, and by more than a tenth of a level in {} to {} % of the values",
        EDGE,
        change("light_levels", "an edge on pixel centres"),
        lambda output: 100 * min(column(output, "light_share: {}")),
        lambda output: 100 * change("light_share", "an edge on pixel centres")(output),
    ),
    continuity(
        "| {} um a step ({} um once at draft), light {} levels, image {} level;",
        "sweeps::first_contact_comes_gradually",
        lambda output: sorted(column(output, "surface_um: {}"))[-2],
        change("surface_um", "first contact, torus, Draft"),
        change("light_levels", "first contact"),
        change("image_levels", "first contact"),
    ),
    continuity(
        "high: by up to {<} um more; draft and standard: also by up to {} um and {} um where",
        "sweeps::a_step_in_depth_moves_the_surface_by_little_more",
        lambda output: excess(output, "High"),
        *[change("surface_um", f"depth .*, {rung}: ") for rung in ("Draft", "Standard")],
    ),
    continuity(
        "| high: up to {} levels, more than a tenth of a level in {} % of the values; draft and standard: {} and {} levels, where walls of"
        " low relief stop giving way in a pixel of their grid and the surface jumps by {} and {} um |",
        STEPS,
        shadow_steps("light_levels", "High"),
        lambda output: 100 * shadow_steps("light_share", "High")(output),
        shadow_steps("light_levels", "Draft"),
        shadow_steps("light_levels", "Standard"),
        shadow_steps("surface_um", "Draft"),
        shadow_steps("surface_um", "Standard"),
    ),
    continuity(
        "the surface jumps by up to {} um at `draft` and {} um at `standard`.",
        STEPS,
        shadow_steps("surface_um", "Draft"),
        shadow_steps("surface_um", "Standard"),
    ),
    continuity(
        "another solution | {} um in steps of 2 um |",
        "sweeps::crossing_the_size_from_which_a_coarser_grid_is_tried_first_does_not_show",
        change("surface_um", "box of 64 x 64 px"),
    ),
    continuity(
        "the step and the tolerance; draft and standard: up to {} um and {} um |",
        "sweeps::looking_higher_because_of_a_bulge_does_not_show",
        *[change("surface_um", f"bulges, .*, {rung}: ") for rung in ("Draft", "Standard")],
    ),
    continuity(
        "all fidelity levels: {} um (an object that goes on beyond the window, of which a millimetre more is seen), else {} um; {} um;",
        RESPONSE,
        change("surface_um", "four pixels more of margin, wave"),
        change("surface_um", "four pixels more of margin, (cube|torus)"),
        change("surface_um", "finer pixels than a 32nd"),
    ),
    continuity(
        "draft within {} %, standard {} %, high and reference {<} % of the reference's stiffness at 20 um",
        "sweeps::a_press_shallower_than_the_tolerance_has_a_force_in_proportion_to_its_depth",
        off("Draft"),
        off("Standard"),
        lambda output: max(off("High")(output), off("Reference")(output)),
    ),
    continuity(
        "| a branch at exactly 0 | light {} levels; the image by {<} level in {<} % of the values |",
        "sweeps::an_effect_of_hardly_any_strength_hardly_shows",
        lambda output: worst(output, "light_levels: {}"),
        lambda output: worst(output, "image_levels: {}"),
        lambda output: 100 * worst(output, "image_share: {}"),
    ),
    continuity(
        "smaller dots are drawn shows | up to {}, {} and {} levels at the dots' rims",
        "sweeps::a_dot_looks_much_the_same_on_either_side_of_the_size_from_which_it_is_drawn_more_finely",
        *[change("image_levels", f"dots of {size} mm") for size in ("2", "1", "0.5")],
    ),
    continuity(
        "In {} pairs, at all fidelity levels, the surface agrees within {<} um and the image within {<} level",
        MIRRORED,
        *[lambda output, index=index: mirrored(output)[index] for index in range(3)],
    ),
    continuity(
        "reference: surface {} um, normals {} degrees, light {} levels, every value of the image equal; high: {} um, {} degrees, {} levels,"
        " {*} paper: {} um, {} degrees, {} levels; draft and standard: pressure on the pixels they solve within {<} % of the highest",
        TWIN,
        *[
            lambda output, rung=rung, index=index: twin(output, rung, index)
            for rung in ("Reference", "High", "Paper")
            for index in range(3)
        ],
        lambda output: 100 * worst(output, "pressure {} of the highest"),
    ),
    continuity(
        "At `reference` it is within {<} um of a second implementation in f64",
        TWIN,
        lambda output: twin(output, "Reference", 0),
    ),
    continuity(
        "| rounding in f32 | {<} degrees, {<} levels, {<} levels |",
        STAGES,
        *[
            lambda output, index=index: worst(output, "normals {} degrees, light {}, image {} levels", index)
            for index in range(3)
        ],
    ),
    continuity(
        "| ball {} levels on the mean, over two in {} % of the values; cone {} and {} %; twelve dots, whose penumbras overlap, {} and {} % |",
        MARCHED,
        *[
            lambda output, shape=shape, index=index: (1, 100)[index]
            * one(output, f"shadows, {shape}: {{}} levels on the mean, over two in {{}}")[index]
            for shape in ("sphere", "cone", "dots")
            for index in (0, 1)
        ],
    ),
]

# --- Times beside other simulators ---------------------------------------------------------------------------------------------

OTHERS = "python tests/bench/others.py GELSIM"


def others(output):
    """The image's CPU time of each program that could be tried."""
    times = json.loads(next(text for text in output.text.splitlines() if text.startswith("{")))
    own = {name: statistics.median(each) for name, each in times.items()}
    names = {
        "gelsim paper": "gelsim paper",
        "gelsim draft": "gelsim draft",
        "gelsim standard": "gelsim standard",
        "gelsim high": "gelsim high",
        "the method of 2019 written in numpy and OpenCV, whole arrays at a time": "paper's method in numpy and OpenCV",
        "taxim 1.4.1 (Taxim in JAX), without shadows": "taxim, JAX on CPU",
        "the same with shadows": "taxim, JAX on CPU, with shadows",
    }
    return {row: [own[name]] if name in own else None for row, name in names.items()}


OTHERS_FIGURES = [Figures("performance", OTHERS, Table("| program | CPU ms an image |", "l t"), others, needs=("numpy", "cv2"))]

MEASURED = [
    *ACCURACY_FIGURES,
    *TRADEOFF_FIGURES,
    *MASK_FIGURES,
    *ORACLE_FIGURES,
    *FINITE_FIGURES,
    *FRICTION_FIGURES,
    *CURVED_FIGURES,
    *EFFECT_FIGURES,
    *SEQUENCE_FIGURES,
    *OTHER_FIGURES,
    *STABILITY_FIGURES,
    *OTHERS_FIGURES,
]

REAL = "images of real sensors, which are not part of this project"
TIMES = "times alone, minutes"
NO_FIGURE = "passes or fails, and prints no figure of a page"

# Commands that run a test, a bench or a script of tests/, and why their figures are not measured here.
NOT_RERUN = {
    "cargo test --release --test program cli::clearance": "fails where a gap is larger",
    "GELSIM_REAL_DATA=FOLDER cargo test --release --test library reality::judge -- --nocapture": f"{REAL} (GELSIM_REAL_DATA)",
    "GELSIM_REAL_DATA=FOLDER cargo test --release --test library reality::sensors -- --nocapture": f"{REAL} (GELSIM_REAL_DATA)",
    "GELSIM_REAL_DATA=FOLDER cargo test --release --test library reality::shapes -- --nocapture": f"{REAL} (GELSIM_REAL_DATA)",
    "GELSIM_TAXIM=OUT cargo test --release --test library taxim::package -- --nocapture": "pictures by the package taxim, 400 MB (GELSIM_TAXIM)",
    "GELSIM_THOROUGH=1 cargo test --release --test library a_bound_holds -- --nocapture": "fails where a bound is broken",
    "GELSIM_UPDATE_GOLDEN=1 cargo test --release --test library golden::found": "stores a golden image anew",
    "UPDATE=1 cargo test --release --test program cli::schema": "stores the schemas anew",
    "cargo bench --bench effects": TIMES,
    "cargo bench -p gelsim-bench --bench elastic": TIMES,
    "cargo bench -p gelsim-bench --bench elastic -- convolution": TIMES,
    "cargo bench -p gelsim-bench --bench stages": TIMES,
    "cargo bench -p gelsim-bench --bench stages -- exr": TIMES,
    "cargo bench -p gelsim-bench --bench stages -- light": TIMES,
    "cargo bench -p gelsim-bench --bench stages -- png": TIMES,
    "cargo bench -p gelsim-bench --bench stages -- streamed_frame": TIMES,
    "cargo bench -p gelsim-bench --bench stages -- vectors": TIMES,
    "cargo bench --bench throughput": TIMES,
    "cargo bench --bench throughput -- --beside OTHER": f"{TIMES}, against another build",
    "cargo test": NO_FIGURE,
    "cargo test --release": NO_FIGURE,
    "cargo test --release --lib paired": NO_FIGURE,
    "cargo test --release --test": "the beginning of the commands of a table",
    "cargo test --release --test library effects": NO_FIGURE,
    "cargo test --release --test library physics::border -- --nocapture": "the page gives none of its figures",
    "cargo test --release --test library physics::lamps": NO_FIGURE,
    "cargo test --release --test library physics::presets": "fails where a preset is beyond the page's bounds",
    "cargo test --release --test library physics::several": NO_FIGURE,
    "cargo test --release --test program cli::gripper": NO_FIGURE,
    "cargo test --release --test program cli::sequences": NO_FIGURE,
    "cargo test --release --test program cli::verify": NO_FIGURE,
    "cargo test --release --test program faults -- --nocapture": "counts of kills and full disks, of which some need rights of their own",
    "cargo test --release --test program faults::stores": NO_FIGURE,
    "cargo test --release --test program fuzz": NO_FIGURE,
    "cargo test --release --test program fuzz::limits": NO_FIGURE,
    "python tests/bench/figures.py target/release/gelsim": "this is it",
    "python tests/bench/inspect_set.py GELSIM": TIMES,
    "python tests/pipeline/attack.py": "the wheel; .ci/run",
    "python tests/pipeline/combinations.py GELSIM": "minutes; .ci/run",
    "python tests/pipeline/extras.py FOLDER": "the wheel; .ci/run",
    "python tests/pipeline/formats.py target/release/gelsim": "the wheel; .ci/run",
    "python tests/pipeline/formats.py target/release/gelsim --speed out/quickstart": f"{TIMES}; the wheel",
    "python tests/pipeline/notebook.py": "the wheel; .ci/run",
    "python tests/pipeline/soak.py target/release/gelsim": "prints memory, and fails if it grows; .ci/run --full",
    "python tests/pipeline/simulators.py GELSIM": "the packages of simulators; .ci/run",
    "python tests/pipeline/stores.py GELSIM GELSIM_WITH_STORES --away": "an S3 server; .ci/run",
    "python tests/pipeline/taxim_pictures.py OUT": "pictures by the package taxim, 400 MB; .ci/run",
    "python tests/pipeline/workers.py target/release/gelsim --speed": f"{TIMES}; the wheel",
    "python tests/presets/fit.py --help": REAL,
    "python tests/transfer/run.py GELSIM --real FOLDER": REAL,
    "python tests/transfer/run.py GELSIM --real FOLDER --set gsmini_gssdk digit_fots gelsight_thu": REAL,
    "python tests/transfer/run.py GELSIM --self-test": "fails where an error is beyond the page's; .ci/run",
    "python tests/transfer/tactip.py GELSIM --real FOLDER": REAL,
    "python3 tests/pipeline/inject.py GELSIM --every 1": "hours; .ci/run runs a part",
    "python3 tests/pipeline/library.py": "counts crates, as is done here; .ci/run",
    "python3 tests/pipeline/surface.py": "lists what is public; .ci/run",
}
