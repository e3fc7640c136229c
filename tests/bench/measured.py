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
ACCURACY_TITLES = (
    "Shadows, at `standard`",
    "Friction of the pad, at `standard`",
    "A fingertip, 320x240",
    "Fidelity of a slip at 25 frames a second",
    "Frames a second of a slip, at `standard`",
)


def printed_table(output, title):
    """The rows of a table that the command prints; the page leaves out the last column, the model's error."""
    return Table(f"{title} (", "l t e e e").values(output.text)


def pad_friction(output):
    """The force without friction, off that of a pad that sticks, in percent of the largest; model errors of both, um."""
    rows = printed_table(output, "Friction of the pad, at `standard`")
    return [*rows["none"][2], *rows["none"][3], *rows["stick"][3]]


ACCURACY_FIGURES = [
    Figures(
        "evidence/accuracy",
        ACCURACY,
        Table(f"{title} (", "l t e e"),
        lambda output, title=title: {row: cells[:3] for row, cells in printed_table(output, title).items()},
        needs=("numpy", "PIL"),
    )
    for title in ACCURACY_TITLES
] + [
    Figures(
        "evidence/accuracy",
        ACCURACY,
        Sentence(
            "Friction changes the force by {} % of the largest and the image by a fifth of a level, and takes 6 ms more, on top of 12."
            " The model error (median of `model_error_um`) falls from {} to {} um"
        ),
        pad_friction,
        needs=("numpy", "PIL"),
    ),
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


def other_models(output):
    """How far the surface of gelpads that no level has is off."""
    return {model["rung"]: model["height_rms_um"] for model in tradeoff(output)["models"]}


def by_object(output):
    rows = {}
    for one_object in tradeoff(output)["objects"]:
        own = {rung["rung"]: rung for rung in one_object["rungs"]}
        rows[one_object["object"]] = total_errors(own)
    rows["all"] = total_errors(rungs(output))
    return rows


def total_errors(own):
    theory = [own["reference"]["total_rms_um"], own["reference"]["total"]["height_max_um"]]
    return [theory, *(own[name]["total_rms_um"] for name in ("draft", "standard", "standard + strain"))]


def levels(*wanted):
    """One figure for each pair of a level and a key."""
    return lambda output: [rungs(output)[name][key] for name, key in wanted]


def left_out(output):
    return {effect["effect"]: effect for effect in tradeoff(output)["left_out"]}


def finer_grid(output):
    """How far the reference is from a grid twice as fine."""
    (own,) = (grid for grid in tradeoff(output)["grids"] if grid["per_px"] == 1.0)
    return [own[key] for key in ("height_rms_um", "height_max_um")]


TOTAL = "total_rms_um"
RMS, LARGEST, CPU, IMAGE = "height_rms_um", "height_max_um", "cpu_ms_median", "image_mae"
LEVEL_CELLS = (
    *(TOTAL, RMS, LARGEST, "ring_normal_mean_deg", IMAGE, "force_error_percent"),
    *(("contact_iou_mean", "contact_iou_worst"), CPU, "cpu_ms_p95"),
)

TRADEOFF_FIGURES = [
    Figures(
        "README",
        TRADEOFF,
        Sentence(
            "within {} um (RMS) of those of linear theory's most exact level, and a sample of 640x480 px takes {ms} ms of CPU time on"
            " an AMD EPYC. Linear theory is itself off by {} um from rubber at large strains there, which the level"
            " `finite-strain` solves in {ms} ms"
        ),
        levels(("standard", RMS), ("standard", CPU), ("reference", TOTAL), ("finite-strain", CPU)),
    ),
    Figures(
        "reference/fidelity",
        TRADEOFF,
        Table("| level | total RMS um | height RMS um |", "l e e e e e e e t t"),
        of_rungs(*LEVEL_CELLS),
    ),
    Figures(
        "reference/fidelity",
        TRADEOFF,
        Sentence("the surface of `none` is off by {} um RMS, that of `gaussian` by {} um"),
        lambda output: [other_models(output)[name] for name in ("none", "gaussian")],
    ),
    Figures("explanation/gelpad", TRADEOFF, Table("| object | `reference`, um RMS (largest) |", "l e e e e"), by_object),
    Figures(
        "evidence/gelpad",
        TRADEOFF,
        Sentence(
            "it is off by {} um RMS over the view, and up to {} um at single pixels of a wall"
        ),
        finer_grid,
    ),
]

# --- Masks of coarse grids -----------------------------------------------------------------------------------------------------

MASK = "GELSIM_THOROUGH=1 cargo test --release --test library physics::mask -- --nocapture"


def masks(output):
    """Of 640x480: the median at `standard` and at `draft`."""
    return [one(output, f"[640, 480] {name}: median {{}}, worst of more than 1000 px")[0] for name in ("standard", "draft")]


MASK_FIGURES = [
    Figures(
        "explanation/gelpad",
        MASK,
        Sentence("with the mask of `reference` is {} at `standard` and {} at `draft`"),
        masks,
        "physics::mask::the_contact_mask_of_a_coarse_grid_is_the_references",
        tolerance=0.002,
    ),
]

# --- The elastic layer against other solutions ---------------------------------------------------------------------------------

PHYSICS = "cargo test --release --test library physics -- --nocapture"
ELEMENTS = "cargo test --release --test library physics::finite_elements -- --nocapture"
DOMES = "cargo test --release --test library physics::curved_elements -- --nocapture"
BEYOND = "cargo test --release --test library physics::beyond -- --nocapture"


def oracle(sentence, test, new):
    return Figures("evidence/gelpad", PHYSICS, Sentence(sentence), new, f"physics::{test}")


def limits(output):
    """Largest errors of linear theory by shape, for each depth."""
    found = {}
    for shape in ("ball", "cone", "punch"):
        for *size, _, um in scan(output.text, f'"{shape}" [{{}}, {{}}, {{}}], s {{}}: {{}} um, stated'):
            found.setdefault((shape, *size), []).append(um)
    # The same ball comes again, on a pad that is domed.
    flat = found["ball", 3.3, 0.0, 0.0][:4]
    return {
        "ball, radius 3.3 mm": flat,
        "the same ball, sticking": None,
        "cone, slope 0.6": found["cone", 0.0, 0.0, 0.6],
        "punch, radius 3 mm, edge rounded by 0.2 mm": [*found["punch", 3.0, 0.2, 0.0], None],
        "the same punch, sticking": None,
    }


def factor(output, template):
    """The larger of both ratios, stated over true and true over stated."""
    ratios = [ratio for numbers in scan(output.text, template) for ratio in numbers]
    return [max(max(ratio, 1 / ratio) for ratio in ratios)]


def domes(output):
    """Largest error of the force, percent, and of the ring, um; the factor within which the label states the ring's."""
    template = "ball of {} on a dome of {} mm, {} mm deep: force {} %, ring off by {} um, {} RMS, stated {}"
    forces, rings, stated = zip(*[(found[3], found[4], found[6]) for found in scan(output.text, template)])
    ratios = [own / true for own, true in zip(stated, rings)]
    return [max(map(abs, forces)), max(rings), max(max(ratio, 1 / ratio) for ratio in ratios)]


def cut_and_found(output):
    """Force and surface in view, without and with what lies beyond the window."""
    found = {}
    template = "beyond, nu {}, its edge in view: {} N in view, cut [{}, {}, {}], found [{}, {}, {}]"
    for nu, _, cut, _, cut_um, force, _, um in scan(output.text, template):
        found[nu] = [100 * cut, 100 * force, cut_um, um]
    template = "beyond, nu {}, h 3: {} presses, worst if cut [{}, {}, {}], found [{}, {}, {}]"
    objects = {nu: [-100 * cut, 100 * force, cut_um, um] for nu, _, cut, _, cut_um, force, _, um in scan(output.text, template)}
    return {
        "plate of 200 mm, nu = 0.48, edge in view": found[0.48],
        "the same, nu = 0.4999": found[0.4999],
        "27 bundled objects across the border, worst": objects[0.4999],
    }


def total_forces(output):
    """How far the total force is off, percent: on pads of 3 mm, and of 1 mm."""
    plates = scan(output.text, "N in view, cut [{}, {}, {}], found [{}, {}, {}]")
    objects = scan(output.text, "h {}: {} presses, worst if cut [{}, {}, {}], found [{}, {}, {}]")
    thick = [numbers[4] for numbers in plates] + [numbers[6] for numbers in objects if numbers[0] == 3.0]
    return percent([max(map(abs, thick)), max(abs(numbers[6]) for numbers in objects if numbers[0] == 1.0)])


ORACLE_FIGURES = [
    oracle(
        "| dense f64 solution on 16x16, 30 cases | pressure within {<} of the peak, surface within {<} um |",
        "contact::presses_agree_with_a_dense_solution_in_f64",
        lambda output: one(output, "dense: pressure off by {} of its peak, surface by {} um"),
    ),
    oracle(
        "| Hertz's ball, radius 32 px | force {}, peak {}, radius {} px |",
        "solutions::a_sphere_on_a_thick_pad_is_hertzs",
        lambda output: [abs(value) for value in one(output, "hertz, Full: force {}, peak {}, radius {} px")],
    ),
    oracle(
        "| flat punch, radius 8 and 64 px | force {} and {} %:",
        "solutions::a_flat_punch_on_a_thick_pad_is_boussinesqs",
        lambda output: percent(column(output, "punch, radius {} px ({} mm): force {}", 2)[::3]),
    ),
    oracle(
        "| the label's residual, recomputed in f64 | within {<} um |",
        "contact::the_residual_in_the_label_is_the_largest_violation_there_is",
        lambda output: one(output, "residual: at most {} um above the label's"),
    ),
    Figures(
        "evidence/gelpad",
        ELEMENTS,
        Table("| object | d / h = 0.1 |", "l e e e e"),
        limits,
        "physics::finite_elements::the_label_knows_the_error_of_linear_theory_within_a_factor_of_two",
    ),
    Figures(
        "evidence/gelpad",
        ELEMENTS,
        Sentence("The estimate is within a factor of {<} of all 60 frictionless presses that it was fitted to"),
        lambda output: factor(output, "stated over true from {} to {}, 60 presses"),
        "physics::finite_elements::the_label_knows_the_error_of_linear_theory_within_a_factor_of_two",
    ),
    Figures(
        "evidence/gelpad",
        DOMES,
        Sentence(
            "the force is within {<} %, instead of 28 %. Beside the contact, the surface is that of a flat layer: off by at most {<} um,"
            " which `model_error_um` estimates within a factor of {<}."
        ),
        domes,
        "physics::curved_elements::balls_on_domes_press_as_finite_elements_say",
    ),
    Figures(
        "evidence/gelpad",
        BEYOND,
        Table("| object | force if cut off |", "l e e e e"),
        cut_and_found,
        "physics::beyond::",
    ),
    Figures(
        "evidence/gelpad",
        BEYOND,
        Sentence("(`total_force_n`) is within {<} % in these cases, within {<} % on a pad of 1 mm"),
        total_forces,
        "physics::beyond::",
    ),
]

# --- Friction while pressing ---------------------------------------------------------------------------------------------------

FRICTION = "cargo test --release --test library physics::friction -- --nocapture"


def held(output):
    """Without friction and sticking: ring, motion in the contact, force, by shape and depth on the full grid."""
    template = 'Full "{shape}" [{{}}, {{}}, {{}}] s {{}}: ring {{}} -> {{}} um, in the contact {{}} -> {{}}, around it {{}}, force {{}} -> {{}}'
    found = {}
    for shape in ("ball", "punch"):
        for radius, edge, slope, s, *ring_and_motion, _, slides, sticks in scan(output.text, template.format(shape=shape)):
            ring, motion = ring_and_motion[:2], ring_and_motion[2:]
            found[shape, radius, edge, slope, s] = [ring, motion, [slides, sticks]]
    ball = lambda radius, s: found["ball", radius, 0.0, 0.0, s]
    return {
        "ball, radius 3.3 mm, 0.2": ball(3.3, 0.2),
        "the same, 0.5": ball(3.3, 0.5),
        "ball, radius 12 mm, 0.3": ball(12.0, 0.3),
        "punch, radius 3 mm, edge rounded by 0.2 mm, 0.3": found["punch", 3.0, 0.2, 0.0, 0.3],
    }


def markers(output):
    """Of markers without friction: how far those around a contact are off, and those under balls."""
    around = scan(output.text, "] s {}: markers off by {} um inside, {} around")
    balls = scan(output.text, 'frictionless "ball" [{}, {}, {}] s {}: markers off by {} um inside')
    inside = [um for *_, s, um in balls if s == 0.3]
    return [max(um for s, _, um in around if s <= 0.3), min(inside), max(inside)]


FRICTION_FIGURES = [
    Figures(
        "explanation/friction",
        FRICTION,
        Table("| object, s = d / h |", "l e e e"),
        held,
        "physics::friction::a_pad_that_sticks_is_where_finite_elements_have_it",
    ),
    Figures(
        "explanation/friction",
        FRICTION,
        Sentence("within a factor of {<} of all 63 presses"),
        lambda output: [max(one(output, "sticking: stated over true error from {*} to {}; of 63 beyond 2.5: []"))],
        "physics::friction::the_label_knows_the_error_of_a_pad_that_sticks",
    ),
    Figures(
        "explanation/friction",
        FRICTION,
        Sentence(
            "are within {<} um RMS of finite elements up to s = 0.3. Those under balls of 1.5 to 6 mm move too little outward: by {} to {}"
            " um at s = 0.3"
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
    return Figures("evidence/curved", command, Sentence(sentence), new, test, **more)


def kilometre(output):
    depth, surface = one(output, "depth {} surface {}")
    forces = one(output, "forces [{}, {}]")
    return [1e3 * max(depth, surface), from_one([forces[0] / forces[1]])]


def of_mesh(output):
    points, _ = one(output, "points {} um, normals {} degrees apart at most")
    return [points, worst(output, "depth {} um, force"), from_one(column(output, "um, force {},"))]


def slips(output):
    """Over the angles at which the ball slips, its pull over the law's, whose coefficient is 0.3."""
    shares = [share / 0.3 for angle, share in scan(output.text, "{} rad: {} of the pressure") if angle > 0]
    return [min(shares), max(shares)]


def over_meshes(output):
    template = "a slide over a mesh, {*} at {} mm by [{}, {}]: force within {} %, sticking share {}, motion {} um"
    found = scan(output.text, template)
    tip = [numbers[3] for numbers in scan(output.text, template.replace("{*}", "dome")) if numbers[0] == 0.0]
    return [max(tip), max(numbers[3] for numbers in found if numbers[3] not in tip)]


def at_the_rim(output):
    """Average of the gels' pictures under LEDs at the rim: the capsule's, the dome's."""
    rim = lambda name: output.text.split(f"{name}: points", 1)[1].split("LEDs at the rim", 1)[1].split("apart at most")[0]
    pictures = {name: scan(rim(name), ", {} levels, {} but for a thousandth, {} on average") for name in ("capsule", "dome")}
    return [max(average for _, _, average in pictures[name]) for name in ("capsule", "dome")]


def shadows_inside(output):
    found = [
        one(
            output,
            f"shadows of a {shape} at [{place}] by rays, {{}} values around it: {{}} levels on average, {{}} RMS, {{}} at most",
        )
        for shape, place in (("sphere", "26.0, 0.0"), ("cube", "24.0, 50.0"))
    ]
    return [numbers[1] for numbers in found]


CURVED_FIGURES = [
    curved(
        "ball on domes and cylinders of 10, 12 and 30 mm, thick gel | force within {<} and {<} % |",
        "physics::curved::a_ball_on_a_thick_",
        lambda output: [from_one(column(output, f"on a {gel} of {{}} mm: {{}} of Hertz", 1)) for gel in ("dome", "cylinder")],
    ),
    curved(
        "3 mm of gel, up to 1.2 mm deep | force within {<} % |",
        "physics::curved_elements::balls_on_domes_press_as_finite_elements_say",
        lambda output: [worst(output, "mm deep: force {} %")],
    ),
    curved(
        "and anywhere on a finger's cap or cylinder | force within {<} and {<} % |",
        "physics::curved::the_same_press_a",
        lambda output: [
            from_one(column(output, "{} of the force at the tip")),
            from_one(column(output, "mm from the tip, {} degrees: {}", 1)),
        ],
    ),
    curved(
        "and a nanometre beside it | force within {<} %, {<} levels except for a thousandth of the values |",
        "stability::curved::a_press_beside_the_pole_is_that_on_the_pole",
        lambda output: [
            from_one(column(output, "on average, force {}")),
            worst(output, "degrees: {} levels but for a thousandth"),
        ],
        CURVED_CASES,
    ),
    curved(
        "a ball moved by 10 um across the rim, and where the chart changes | force within {<} %, {<} levels on average, {<} at most |",
        "physics::curved::there_is_no_seam_on_a_finger",
        lambda output: [
            from_one(column(output, "on average, force {}")),
            worst(output, "by more than 4, {} on average"),
            worst(output, "mm: Some({}) levels"),
        ],
    ),
    curved(
        "over 0.5 rad from the LED | direction within {<} degrees |",
        "optics::heat::round::tests::on_a_dome_light_comes_along_great_circles",
        lambda output: one(output, "farthest from a great circle: {} degrees"),
        HEAT,
    ),
    curved(
        "| depth and surface within {<} um, force within {<} %, image within one level |",
        "physics::curved::a_dome_of_a_kilometre_is_a_flat_pad",
        kilometre,
    ),
    curved(
        "| the flat pad: press, push and turn over a dome of 1 km | force within {<} %, motion within {<} um,",
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
        "around a dome by 0.6 rad | pulled by {} to {} mu N |",
        "physics::curved_sequences::a_ball_that_slips_on_a_dome_is_pulled_by_friction_and_follows_the_charts",
        slips,
        tolerance=0.001,
    ),
    curved(
        "19,000 triangles | within {<} um | depth within {<} um, force within {<} % |",
        "physics::gel_mesh::a_mesh_of_a_dome_is_a_dome",
        of_mesh,
        MESH,
    ),
    curved(
        "23,000 triangles | within {<} um, where ball and cylinder meet | depth within {<} um, force within {<} % |",
        "physics::gel_mesh::a_mesh_of_a_capsule_is_a_capsule",
        of_mesh,
        MESH,
    ),
    curved(
        "images with LEDs at the rim differ by {} levels on average (dome {}).",
        "physics::gel_mesh::a_mesh_of_a_",
        at_the_rim,
        MESH,
    ),
    curved(
        "Slides of 8 frames have a force within {<} % around the dome's tip and within {<} % elsewhere.",
        "physics::gel_mesh::a_slide_over_a_mesh_is_that_over_the_same_gel_by_formula",
        over_meshes,
        MESH,
    ),
    curved(
        "the worst ring is off by {} px of 128. Their motion between 2 and 4 mm is off by {} px RMS of",
        "physics::curved::the_pins_of_a_tactip_are_where_they_are_in_pictures",
        lambda output: one(output, "worst ring {} px, motion {} px RMS"),
    ),
    Figures(
        "how-to/curved",
        CURVED_LIGHT,
        Sentence("lose {} and {} levels on average around the press"),
        shadows_inside,
        "physics::curved_light::shadows_of_leds_inside_a_gel_are_left_out_and_are_small_by_rays",
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
NEAR_SHADOWS = "physics::near_light::shadows_of_near_leds_are_off_by_what_the_page_says"


def walls(output):
    """Of `standard`: with samples between centres, and without."""
    return one(
        output,
        "standard, [320, 240]: [{}, {}, {}] grey levels along a wall; [{}, {}, {}] without samples between centres",
    )


def near(output):
    """Means with a near LED, the least and the most of all distances and elevations."""
    means = column(output, "{} mm, {} degrees: {} / {} / {};", 2)
    return [min(means), max(means)]


def near_largest(output):
    found = scan(output.text, "degrees: {} / {} / {}; {} / {} / {}; {}")
    return [max(n[1] for n in found), max(max(n[2], n[5]) for n in found)]


def near_shadows(output):
    template = "{shape}, {{}} mm, {{}} degrees: {{}} / {{}} / {{}}; {{}} /"
    ball = scan(output.text, template.format(shape="Ball { radius: 4.0, deep: 0.8 }"))
    block = scan(output.text, template.format(shape="Block { half: 2.0, deep: 0.8 }"))
    low = [mean for _, angle, mean, *_ in ball if angle < 60.0]
    return [max(low), *[mean for d, angle, mean, *_ in block if d == 8.0 and angle == 60.0]]


def domed(output):
    """Contact radius and force over those of the smaller ball."""
    found = scan(output.text, "{} {} {}: {}, {}, {} (")
    return [from_one([ratio for numbers in found if numbers[1] >= 30.0 for ratio in numbers[3:5]])]


def bounce_shares(output):
    found = [one(output, f"{shape} {{}} / {{}} / {{}}; {{}} /") for shape in ("sphere", "cube", "gear", "coin")]
    shares = [100 * mean / direct for mean, _, _, direct in found]
    return [min(shares), max(shares)]


EFFECT_FIGURES = [
    Figures(
        "explanation/effect-models",
        WALLS,
        Sentence("deviate by {}, {} and {} grey levels (standard deviation, worst line), instead of {}, {} and {} without it."),
        walls,
        TEETH,
    ),
    Figures(
        "explanation/effect-models",
        NEAR,
        Sentence("the mean difference is {} to {} grey levels."),
        near,
        NEAR_BALL,
    ),
    Figures(
        "explanation/effect-models",
        NEAR,
        Sentence("Single pixels at the edge are off by up to {} levels, all others are within {<}."),
        near_largest,
        NEAR_BALL,
    ),
    Figures(
        "explanation/effect-models",
        NEAR,
        Sentence(
            "the mean difference from traced rays around the ball is at most {<} levels at up to 45 degrees. Around an upright block of 4 mm"
            " it grows to {} levels at 8 mm and 60 degrees"
        ),
        near_shadows,
        NEAR_SHADOWS,
    ),
    Figures(
        "explanation/effect-models",
        DOME,
        Sentence("contact radius and force are within {<} % of Hertz for dome radii of 30 mm and more"),
        domed,
        "effects::dome::a_ball_on_a_dome_presses_like_a_smaller_ball_on_a_flat_pad",
    ),
    Figures(
        "explanation/effect-models",
        BOUNCE,
        Sentence("would be smooth, {} to {} % of the direct change"),
        bounce_shares,
        "physics::interreflection::a_bounce_of_light_is_little_beside_what_the_press_changes",
    ),
    Figures(
        "explanation/effect-models",
        IN_PLANE,
        Sentence("on a coarse grid within {} um RMS of a fine one."),
        lambda output: [worst(output, "{} um RMS, {} largest")],
        "physics::inplane::displacement_under_pressure_agrees_with_a_fine_grid",
    ),
    Figures(
        "explanation/effect-models",
        IN_PLANE,
        Sentence("The force is {} to {} % high against Mindlin's disc"),
        lambda output: [100 * (extreme(column(output, "disc, pitch {}: force {},", 1)) - 1) for extreme in (min, max)],
        "physics::inplane::a_disc_that_sticks_is_as_stiff_as_mindlin_and_reissner_say",
    ),
    Figures(
        "explanation/effect-models",
        IN_PLANE,
        Sentence("within {<} % of Cattaneo and Mindlin's ball"),
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
    return Figures("evidence/forces", command, Sentence(sentence), new, f"physics::{test}", **more)


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


def lifts(output):
    """How far the forces of a frame differ, percent."""
    apart = []
    for label in labels(output, "gripper-lift"):
        for frame in label["frames"]:
            forces = [abs(frame[finger]["wrench"]["force_n"][2]) for finger in ("left", "right")]
            apart.append(abs(forces[0] - forces[1]) / max(max(forces), 1e-9))
    return [100 * max(apart)]


SEQUENCE_FIGURES = [
    sequences(
        "pushed out, back and out again | Mindlin and Deresiewicz | force within {<} % of mu N |",
        HISTORY,
        "history::a_ball_that_is_pushed_out_back_and_out_again_follows_mindlin_and_deresiewicz",
        lambda output: [100 * one(output, "36 px: force off by {} of mu N, stick radius by {} of the contact's")[0]],
    ),
    sequences(
        "from the job to the label, pad of 12 mm | Mindlin | force within {<} % of mu N, stick radius within {<} |",
        SEQUENCES,
        "sequences::a_ball_pushed_over_a_thick_pad_follows_mindlin",
        lambda output: [
            100 * one(output, "Mindlin: force off by {} of mu N")[0],
            one(output, "stick radius by {} of the contact's")[0],
        ],
    ),
    sequences(
        "| a rolling ball | Kalker | creep {} along, {} across |",
        HISTORY,
        "history::a_rolling_ball_creeps_as_kalker_says",
        lambda output: [one(output, f"creep along {axis}: {{}} of Kalker's")[0] for axis in "xy"],
        tolerance=0.0005,
    ),
    sequences(
        "| ball and punch turned by 1,080 degrees, mu 0.3 to 2, pads of 0.8 to 10 mm | mu times the integral of p r | torque {} to {} of it",
        HISTORY,
        "history::whatever_is_turned_far_enough_is_held_by_friction_times_its_mean_radius",
        lambda output: [of(column(output, "{} of the torque,")) for of in (min, max)],
        tolerance=0.0002,
    ),
    sequences(
        "lifted in the end | the work of the object | heat within {<} %,",
        HISTORY,
        "history::work_becomes_heat_on_any_path",
        lambda output: [one(output, "heat and work of all paths: at most {} % apart")[0]],
    ),
    sequences(
        "| a lift at 25 frames a second | 100 frames a second | heat within {<} % |",
        SEQUENCES,
        "sequences::what_a_lift_turns_into_heat_is_the_same_at_every_frame_rate",
        lambda output: [
            max(100 * abs(few / many - 1) for few, many in scan(output.text, "heat of a lift {} N mm, {} at 100 frames"))
        ],
    ),
    sequences(
        "| 1,000 steps to and fro | the first steps | force drifts by {<} at most,",
        HISTORY,
        "history::a_thousand_steps_to_and_fro_drift_nowhere_and_make_heat",
        lambda output: [worst(output, "force drifts by {},")],
    ),
    Figures("how-to/sequences", SLIP, Table("| level | force RMS % of the largest | onset off, ms |", "l e e e e t"), slip_levels),
    Figures(
        "how-to/gripper",
        GRIPPER,
        Sentence("the share of the squeeze is within {<} % and the force within {<} %"),
        lambda output: [100 * worst(output, "share off by {}, force"), 100 * worst(output, "share off by {}, force by {}", 1)],
        "physics::gripper::a_ball_between_two_thick_pads_is_two_contacts_of_hertz_in_series",
    ),
    Figures("how-to/gripper", GRIPS, Sentence("differ by at most {<} % in 200 grips"), unbalanced),
    Figures("how-to/gripper", LIFTS, Sentence("by at most {<} % in 40 sequences"), lifts),
]

# --- Depth frames from inside, soft and several objects, crates ----------------------------------------------------------------

INSIDE = "cargo test --release --test library physics::inside -- --nocapture"
SOFT = "cargo test --release --test library physics::soft"
CRATES = "cargo tree -p gelsim -e normal --prefix none --no-default-features --features FEATURE"


def frames_inside(output):
    """How much lower forces are than those of presses, percent, at least and at most."""
    found = [
        numbers[2]
        for gel in ("tactip", "geltip", "allsight", "fingertip")
        for numbers in scan(output.text, f"{gel} [{{}}, {{}}]: force {{}}, {{}} of {{}} over 2, {{}} at most")
    ]
    return [100 * (1 - max(found)), 100 * (1 - min(found))]


def soft(output):
    return [100 * worst(output, f"{grid}, {{}} kPa: force {{}},", 1) for grid in ("Full", "Quarter")]


def crates(output):
    names = {text.removesuffix(" (*)") for text in output.text.splitlines() if text.strip()}
    return [sum(not name.startswith("gelsim v") for name in names)]


OTHER_FIGURES = [
    Figures(
        "how-to/simulators",
        INSIDE,
        Sentence("forces that are {} to {} % low"),
        frames_inside,
        "physics::inside::a_frame_of_the_sensors_own_lens_gives_the_press_of_the_object_that_it_shows",
    ),
    Figures(
        "reference/objects",
        SOFT,
        Sentence("the force is within {<} % of Hertz's on the full grid and {<} % on every fourth pixel"),
        soft,
        "physics::soft::a_soft_ball_on_a_thick_pad_is_hertzs_with_two_moduli",
    ),
] + [
    Figures("explanation/architecture", CRATES, Sentence(words), crates, tolerance=0.0, fill={"FEATURE": feature})
    for feature, words in (
        ("''", "the simulator, presets and PNG, on {} other crates"),
        ("files", "sensor files, meshes and pictures ({} crates)"),
        ("cli", "the default, the command ({})"),
        ("stores", "`stores` object stores ({})"),
    )
]

# --- Stability -----------------------------------------------------------------------------------------------------------------

STABILITY = "cargo test --release --test library stability -- --nocapture"
CORNERS = "GELSIM_THOROUGH=1 cargo test --release --test library stability::corners -- --nocapture"


def printed(output):
    """What each case printed, by its name."""
    rows = [text.strip("|").split(" | ") for text in output.text.splitlines() if text.startswith("| ")]
    return {row[0].strip(): row[2].strip(" |") for row in rows}


def counted(output):
    """How many cases are valid and how many refused."""
    said = printed(output).values()
    refused = sum(text.startswith("refused") for text in said)
    return {"cases": len(said), "valid": len(said) - refused, "refused": refused}


def counts(*keys):
    return lambda output: [counted(output)[key] for key in keys]


def class_of_cases(row, test):
    """A row of the page that sums up: `N cases | N valid (..), N refused`."""
    sentence = f"{row} | {{}} cases | {{}} valid{{*}}, {{}} refused |"
    return summed(sentence, test, counts("cases", "valid", "refused"), tolerance=0.0)


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


def each(*new):
    """Figures that each come from a function of their own."""
    return lambda output: [of(output) for of in new]


def summed(sentence, test, new, command=STABILITY, **more):
    """An entry of the page that sums up."""
    return Figures("evidence/stability", command, Sentence(sentence), new, f"stability::{test}", **more)


def pipeline_figure(output, level, index):
    """Of surface, normals and light: how far a level is from the pipeline in f64."""
    return worst(output, f"{level}: surface {{}} um, normals {{}} degrees, light {{}} levels", index)


def mirrored(output):
    """Pairs and their largest differences, of linear levels and at finite strain, which comes last."""
    *linear, rubber = scan(output.text, "{} pairs differ by up to {} um and {} levels")
    return [sum(numbers[0] for numbers in linear), *[max(numbers[index] for numbers in linear) for index in (1, 2)], *rubber]


def off(rung):
    return lambda output: from_one(column(output, f"{rung}, {{}} mm: {{}} of the reference's stiffness", 1))


MILLIONTH = "continuity::a_millionth_more_of_anything_does_not_show"
EDGE = "continuity::an_edge_that_crosses_pixel_centres_moves_by_a_row_of_pixels"
STEPS = "sweeps::a_step_in_depth_moves_shadows_by_few_levels"
MIRRORED = "symmetry::a_sample_mirrored_transposed_or_turned_is_the_sample_of_the_scene_that_is"
REFERENCE_PIPELINE = "pipeline::every_linear_level_gives_the_surface_and_the_image_of_the_f64_pipeline"
MARCHED = "stages::shadows_are_those_of_marched_rays_where_penumbras_do_not_overlap"


def shadow_steps(key, rung):
    return change(key, f"shadows in depth, .*, {rung}: ")


STABILITY_FIGURES = [
    class_of_cases("| contact, pads, pixels", "contact::sound"),
    class_of_cases("| image sizes", "contact::on_grids"),
    class_of_cases("| meshes", "geometry::sound"),
    class_of_cases("| light", "light::sound"),
    class_of_cases("| texture and printed dots", "texture::sound"),
    summed(
        "valid ({} samples of one not solved, as their labels say)",
        "light::sound",
        lambda output: [worst(output, "touch, {} unsolved and said to be")],
        tolerance=0.0,
    ),
    summed(
        "| random extremes of 44 keys at once | {} jobs | {} valid, {} refused |",
        "corners::random_corners_of_all_ranges_give_sound_samples_or_are_refused",
        corners,
        command=CORNERS,
        tolerance=0.0,
    ),
    summed(
        "| surface within {<} um, image within {<} level, except where an edge",
        MILLIONTH,
        each(change("surface_um", "a millionth, "), change("image_levels", "a millionth, ")),
    ),
    summed(
        "| {} pairs | surface within {<} um, image within {<} level; {} more at `finite-strain` within {<} um and {<} levels |",
        MIRRORED,
        mirrored,
        tolerance=0.0,
    ),
    summed(
        "| contact begins, steps of 0.025 um | light {} levels, image {<} level |",
        "sweeps::first_contact_comes_gradually",
        each(change("light_levels", "first contact"), change("image_levels", "first contact")),
    ),
    summed(
        "| light up to {} levels at `high`; {} and {} levels at `draft` and `standard`, where walls meet a pixel of their grid and the"
        " surface jumps by {} and {} um |",
        STEPS,
        each(
            *[shadow_steps("light_levels", rung) for rung in ("High", "Draft", "Standard")],
            *[shadow_steps("surface_um", rung) for rung in ("Draft", "Standard")],
        ),
    ),
    summed(
        "| surface {} and {} um at `draft` and `standard`, else the tolerance |",
        "sweeps::looking_higher_because_of_a_bulge_does_not_show",
        each(*[change("surface_um", f"bulges, .*, {rung}: ") for rung in ("Draft", "Standard")]),
    ),
    summed(
        "| stiffness within {} % (`draft`), {} % (`standard`) and {<} % (`high`, `reference`) of that",
        "sweeps::a_press_shallower_than_the_tolerance_has_a_force_in_proportion_to_its_depth",
        each(off("Draft"), off("Standard"), lambda output: max(off("High")(output), off("Reference")(output))),
    ),
    summed(
        "| an edge that crosses pixel centres | light up to {} levels in one row",
        EDGE,
        each(change("light_levels", "an edge on pixel centres")),
    ),
    summed(
        "At `reference`, the surface is within {} um, the light within {} levels, and every value of the image is equal. At `high`,"
        " they are within {} um and {} levels. At `draft` and `standard`, the pressure on the pixels that they solve is within {<} % of",
        REFERENCE_PIPELINE,
        lambda output: [
            *[pipeline_figure(output, level, index) for level in ("Reference", "High") for index in (0, 2)],
            100 * worst(output, "pressure {} of the highest"),
        ],
    ),
    summed(
        "ball {} levels on the mean, twelve dots, whose penumbras overlap, {}.",
        MARCHED,
        lambda output: [
            one(output, f"shadows, {shape}: {{}} levels on the mean, over two in {{}}")[0] for shape in ("sphere", "dots")
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
        "gelsim standard": "gelsim standard",
        "the method of 2019 in NumPy and OpenCV": "paper's method in numpy and OpenCV",
        "taxim 1.4.1 (Taxim in JAX), without shadows": "taxim, JAX on CPU",
        "the same with shadows": "taxim, JAX on CPU, with shadows",
    }
    return {row: [own[name]] if name in own else None for row, name in names.items()}


OTHERS_FIGURES = [Figures("evidence/performance", OTHERS, Table("| program | CPU ms an image |", "l t"), others, needs=("numpy", "cv2"))]

SET_FIGURES = [
    Figures(
        "how-to/sensor-sets",
        "python tests/bench/sensor_sets.py target/release/gelsim",
        Sentence("100 such units of `gelsight-mini` take {} of the CPU time of 100 jobs"),
        lambda output: one(output, "the set takes {} of it"),
        # Of CPU times, which differ by so much from run to run: 0.30 to 0.35.
        tolerance=0.1,
    )
]

MEASURED = [
    *ACCURACY_FIGURES,
    *TRADEOFF_FIGURES,
    *MASK_FIGURES,
    *ORACLE_FIGURES,
    *FRICTION_FIGURES,
    *CURVED_FIGURES,
    *EFFECT_FIGURES,
    *SEQUENCE_FIGURES,
    *OTHER_FIGURES,
    *STABILITY_FIGURES,
    *OTHERS_FIGURES,
    *SET_FIGURES,
]
