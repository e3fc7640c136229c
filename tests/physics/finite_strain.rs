//! The pad at finite strain against neo-Hookean finite elements: how far surfaces, forces and motion are off, and how much
//! farther linear theory is. `data/finite_strain.json` was written by `tests/oracle/finite_strain_elements.py`,
//! `data/finite_strain_3d.json` by another code, `tests/oracle/finite_strain_3d.py`; both say how far they are converged.

use gelsim_core::base::grid::{Grid, Resolution};
use gelsim_core::base::view::SURFACE_BORDER;
use gelsim_core::depth::indenter::Indenter;
use gelsim_core::effects::{Effect, EffectPolicy};
use gelsim_core::fidelity::{Fidelity, Models};
use gelsim_core::gelpad::elastic::Elastic;
use gelsim_core::gelpad::elastic::in_plane::DisplacementField;
use gelsim_core::gelpad::elastic::shear::Friction;
use gelsim_core::gelpad::finite_strain::FiniteStrain;
use gelsim_core::gelpad::{Contact, Model, Theory};
use gelsim_core::optics::LightSource;
use gelsim_core::sensor::Sensor;
use gelsim_core::simulator::Simulator;
use serde_json::Value;

use super::finite_elements::penetration;
use super::rig::{NOTHING, Rig, Setup, ball};

/// Surfaces are compared so far around the contact, mm.
const RING_MM: f64 = 2.0;

/// The pads that are compared, in the order of [`Bench::rigs`].
const LINEAR: usize = 0;
/// The elastic model with `strain_correction`.
const CORRECTION: usize = 1;
/// The model `finite_strain`.
const FINITE_STRAIN: usize = 2;

/// What an effect says that ran.
const LARGE: &str = "large strains change the surface";

fn models(friction: Option<Friction>) -> [Model; 3] {
    let elastic = Elastic { resolution: Resolution::Full, tolerance_um: 0.1, friction, ..Elastic::default() };
    [
        Model::Elastic(elastic),
        Model::Elastic(Elastic { strain_correction: true, ..elastic }),
        Model::FiniteStrain(FiniteStrain { friction, ..FiniteStrain::default() }),
    ]
}

/// A row of a table.
#[derive(Clone, Copy)]
struct Row<'a>(&'a Value);

impl Row<'_> {
    fn number(self, key: &str) -> f64 {
        self.0[key].as_f64().unwrap_or_else(|| panic!("{key} of {}", self.name()))
    }

    fn list(self, key: &str) -> Vec<f64> {
        let values = self.0[key].as_array().unwrap_or_else(|| panic!("{key} of {}", self.name()));
        values.iter().map(|value| value.as_f64().expect("a number")).collect()
    }

    fn name(self) -> String {
        let of = |key: &str| match &self.0[key] {
            Value::Null => String::new(),
            value => format!(" {key} {value}"),
        };
        ["object", "radius_mm", "fillet_mm", "poisson_ratio", "s"].map(of).concat()
    }
}

/// Presses of one kind of body of revolution, without friction or sticking.
fn table(object: &str, friction: Option<Friction>) -> Vec<Value> {
    let rows: Vec<Value> = serde_json::from_str(include_str!("data/finite_strain.json")).expect("a table of presses");
    let contact = if friction.is_some() { "sticking" } else { "frictionless" };
    let wanted =
        |row: &Value| row["geometry"] == "axisymmetric" && row["object"] == object && row["contact"] == contact;
    rows.into_iter().filter(wanted).collect()
}

/// Beside a ball there is more than a thickness on every side.
fn setup(poisson_ratio: f64) -> Setup {
    Setup { resolution_px: [240; 2], mm_per_px: [0.06; 2], poisson_ratio, ..Setup::default() }
}

/// The pads of one material.
struct Bench {
    rigs: [Rig; 3],
}

impl Bench {
    fn new(setup: Setup, friction: Option<Friction>) -> Self {
        Self { rigs: models(friction).each_ref().map(|model| setup.rig_of(model)) }
    }

    /// Presses an object into every pad, and returns how far each is off and by which theory it was solved.
    fn press(&self, row: Row, object: impl Fn(f64, f64) -> f64, off: impl Fn(&Rig, &Contact) -> Off) -> [Pressed; 3] {
        self.rigs.each_ref().map(|rig| {
            let depth = rig.depth_in_window(row.number("depth_mm"), &object);
            let (contact, effects) = rig.press_noted(&depth, EffectPolicy::WhereNeeded);
            let why = effects.notes[Effect::FiniteStrain].reason.clone();
            Pressed { off: off(rig, &contact), why: why.into_owned(), contact }
        })
    }
}

struct Pressed {
    off: Off,
    why: String,
    contact: Contact,
}

/// How far a press is off.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Off {
    /// Of the surface around the contact, root mean square, um.
    ring_um: f64,
    /// Of the force, %.
    force_percent: f64,
}

/// The mean of squares, each with its weight.
#[derive(Clone, Copy, Debug, Default)]
struct MeanSquare {
    sum: f64,
    weight: f64,
}

impl MeanSquare {
    fn add(&mut self, value: f64, weight: f64) {
        self.sum += weight * value * value;
        self.weight += weight;
    }

    fn root(self) -> f64 {
        (self.sum / self.weight).sqrt()
    }
}

/// Linear interpolation of values from `start` on, `step` apart.
fn interpolate(values: &[f64], start: f64, step: f64, at: f64) -> f64 {
    let place = (at - start) / step;
    let left = (place.max(0.0) as usize).min(values.len() - 2);
    values[left] + (place - left as f64) * (values[left + 1] - values[left])
}

/// Where a pixel is, mm from the view's middle.
fn place_mm(setup: &Setup, k: usize, at: usize) -> f64 {
    (at as f64 + 0.5 - setup.resolution_px[k] as f64 / 2.0) * setup.mm_per_px[k]
}

fn force_percent(rig: &Rig, contact: &Contact, row: Row) -> f64 {
    let force_mm2 = 1e3 * contact.force_n.expect("a force") / rig.setup.youngs_modulus_kpa;
    100.0 * (force_mm2 / row.number("force_mm2") - 1.0).abs()
}

/// How far a press of a body of revolution is off.
fn off_of_revolution(rig: &Rig, contact: &Contact, row: Row) -> Off {
    let (edge, start, step) = (row.number("contact_mm"), row.number("ring_start_mm"), row.number("ring_step_mm"));
    let (ring, surface) = (row.list("ring_w_mm"), contact.surface.inner(SURFACE_BORDER));
    let mut off_um = MeanSquare::default();
    for y in 0..surface.height {
        for x in 0..surface.width {
            let r = place_mm(&rig.setup, 0, x).hypot(place_mm(&rig.setup, 1, y));
            if (start..edge + RING_MM).contains(&r) {
                // Alike at every radius, as the table's own figures are.
                off_um.add(1e3 * (f64::from(surface.at(x, y)) - interpolate(&ring, start, step, r)), 1.0 / r);
            }
        }
    }
    Off { ring_um: off_um.root(), force_percent: force_percent(rig, contact, row) }
}

/// What is accepted of the presses of one object at one strain: the errors of the correction of the elastic model, those
/// of the model of its own, and how many times farther the linear layer's surface is off, for each of both.
struct Bound {
    strain: f64,
    correction: Off,
    finite_strain: Off,
    better: [f64; 2],
}

const fn bound(strain: f64, correction: [f64; 2], finite_strain: [f64; 2], better: [f64; 2]) -> Bound {
    const fn off([ring_um, force_percent]: [f64; 2]) -> Off {
        Off { ring_um, force_percent }
    }
    Bound { strain, correction: off(correction), finite_strain: off(finite_strain), better }
}

impl Bound {
    fn of(bounds: &[Self], row: Row) -> usize {
        let strain = row.number("s");
        bounds.iter().position(|bound| bound.strain == strain).unwrap_or_else(|| panic!("no bound for{}", row.name()))
    }

    /// What is wrong with a press.
    fn check(&self, row: Row, pressed: &[Pressed; 3], wrong: &mut Vec<String>) {
        let linear = &pressed[LINEAR];
        for (pads, most, better) in
            [(CORRECTION, self.correction, self.better[0]), (FINITE_STRAIN, self.finite_strain, self.better[1])]
        {
            let Pressed { off, why, contact } = &pressed[pads];
            let times = linear.off.ring_um / off.ring_um;
            let solved =
                contact.numerics.converged && (contact.numerics.theory == Theory::FiniteStrain) == (why == LARGE);
            if off.ring_um > most.ring_um || off.force_percent > most.force_percent || times < better || !solved {
                wrong.push(format!(
                    "{}, {}: {off:.2?}, {times:.1} times better, {why}",
                    row.name(),
                    ["correction", "finite strain"][pads - 1]
                ));
            }
        }
    }
}

#[test]
fn a_ball_much_smaller_than_the_pad_is_resolved() {
    // A fine box is the truth here; a thickness of 4 mm has ten nodes otherwise, and the ball's contact two.
    let setup = Setup { resolution_px: [200, 150], mm_per_px: [0.05; 2], thickness_mm: 4.0, ..Setup::default() };
    for (radius, deep) in [(0.5, 0.2), (0.5, 0.4), (1.0, 0.5)] {
        let pressed = |box_mm: Option<f64>| {
            let rig = setup.rig_of(&Model::FiniteStrain(FiniteStrain { box_mm, ..FiniteStrain::default() }));
            let depth = rig.depth_in_window(deep, |x, y| ball(radius, deep, x, y));
            let (contact, _) = rig.press_noted(&depth, EffectPolicy::WhereNeeded);
            assert_eq!(contact.numerics.theory, Theory::FiniteStrain, "{radius} {deep} {box_mm:?}");
            contact
        };
        let [usual, fine] = [None, Some(0.1)].map(pressed);
        let linear = setup.rig_of(&models(None)[LINEAR]).press(|x, y| ball(radius, deep, x, y));
        let [usual_n, fine_n, linear_n] = [&usual, &fine, &linear].map(|contact| contact.force_n.expect("a force"));
        let largest_um = |contact: &Contact| {
            let [a, b] = [contact, &fine].map(|contact| contact.surface.inner(SURFACE_BORDER));
            1e3 * a.data.iter().zip(&b.data).map(|(a, b)| f64::from((a - b).abs())).fold(0.0, f64::max)
        };
        let [off_um, linear_um] = [&usual, &linear].map(largest_um);
        let [off, linear_off] = [usual_n, linear_n].map(|n| (n / fine_n - 1.0).abs());
        println!(
            "finite strain: a ball of {radius} mm, {deep} mm deep: {off_um:.2} um and {:.2} % from a fine box, linear theory \
             {linear_um:.2} um and {:.2} %",
            100.0 * off,
            100.0 * linear_off
        );
        assert!(off < 0.012 && off < 0.3 * linear_off && off_um < 0.4 * linear_um, "{radius} {deep}");
        assert!(usual.numerics.model_error_um.is_ok_and(|label_um| off_um < 3.0 * label_um), "{:?}", usual.numerics);
    }
}

/// Presses every row of an object and compares with the bounds for their strains.
fn check_rows(object: &str, friction: Option<Friction>, bounds: &[Bound]) {
    let mut wrong = Vec::new();
    let mut seen = vec![false; bounds.len()];
    let rows = table(object, friction);
    for poisson_ratio in [0.48, 0.4999] {
        let bench = Bench::new(setup(poisson_ratio), friction);
        let own: Vec<Row> = rows.iter().map(Row).filter(|row| row.number("poisson_ratio") == poisson_ratio).collect();
        // All presses, or one of each strain, of another size from one strain to the next: sizes follow each other with all
        // of their strains.
        let (strains, sizes) = (bounds.len(), own.len().div_ceil(bounds.len()));
        let tried = |at: &usize| crate::thorough() || *at / strains == (*at % strains) % sizes;
        for row in (0..own.len()).filter(tried).map(|at| own[at]) {
            let pressed = bench.press(
                row,
                |x, y| penetration(row.0, x.hypot(y)),
                |rig, contact| off_of_revolution(rig, contact, row),
            );
            let bound = Bound::of(bounds, row);
            seen[bound] = true;
            bounds[bound].check(row, &pressed, &mut wrong);
        }
    }
    assert!(seen.iter().all(|seen| *seen), "{object}: strains without a press: {seen:?}");
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn balls_are_as_close_to_finite_elements_as_is_stated() {
    const BOUNDS: [Bound; 5] = [
        bound(0.1, [1.1, 1.5], [0.1, 0.4], [0.77, 7.4]),
        bound(0.2, [0.59, 0.55], [0.36, 0.51], [7.8, 13.0]),
        bound(0.3, [1.3, 1.2], [0.68, 0.66], [8.4, 15.0]),
        bound(0.4, [2.3, 1.7], [1.3, 0.93], [6.8, 15.0]),
        bound(0.5, [4.0, 2.5], [2.2, 2.1], [5.5, 12.0]),
    ];
    check_rows("ball", None, &BOUNDS);
}

#[test]
fn punches_are_as_close_to_finite_elements_as_is_stated() {
    const BOUNDS: [Bound; 3] = [
        bound(0.1, [1.6, 0.89], [1.7, 1.1], [1.8, 2.1]),
        bound(0.2, [7.7, 1.7], [5.6, 1.6], [2.7, 4.1]),
        bound(0.3, [33.0, 5.3], [11.0, 2.5], [2.0, 5.1]),
    ];
    check_rows("punch", None, &BOUNDS);
}

#[test]
fn cones_are_as_close_to_finite_elements_as_is_stated() {
    const BOUNDS: [Bound; 4] = [
        bound(0.1, [0.43, 1.4], [0.31, 0.84], [2.8, 3.8]),
        bound(0.2, [0.65, 2.6], [0.27, 0.9], [4.5, 11.0]),
        bound(0.3, [0.53, 1.5], [0.29, 0.86], [8.8, 17.0]),
        bound(0.4, [0.77, 1.7], [0.45, 0.99], [8.5, 15.0]),
    ];
    check_rows("cone", None, &BOUNDS);
}

#[test]
fn objects_to_which_the_pad_sticks_are_as_close_to_finite_elements_as_is_stated() {
    const BALLS: [Bound; 3] = [
        bound(0.1, [1.5, 1.7], [0.13, 0.4], [0.77, 8.2]),
        bound(0.3, [2.5, 0.4], [0.57, 0.65], [2.0, 11.0]),
        bound(0.5, [5.0, 2.5], [3.9, 2.6], [2.4, 4.2]),
    ];
    const PUNCHES: [Bound; 3] = [
        bound(0.1, [1.2, 1.0], [0.72, 0.4], [1.4, 2.2]),
        bound(0.3, [15.5, 1.7], [10.0, 1.0], [0.64, 1.0]),
        // The wide punch is solved with rounded edges only, or not at all.
        bound(0.5, [75.0, 8.5], [75.0, 8.5], [0.5, 0.9]),
    ];
    check_rows("ball", Some(Friction::Stick), &BALLS);
    check_rows("punch", Some(Friction::Stick), &PUNCHES);
}

/// A value of a grid at a place in pixels, between four of them.
fn bilinear(grid: &Grid<f32>, place: [f64; 2]) -> f64 {
    let [x, y] = place.map(|place| place as usize);
    let [s, t] = [place[0] - x as f64, place[1] - y as f64];
    let line = |y: usize| (1.0 - s) * f64::from(grid.at(x, y)) + s * f64::from(grid.at(x + 1, y));
    (1.0 - t) * line(y) + t * line(y + 1)
}

/// How far an object of the table in three dimensions is below the undeformed pad, mm: the lower side of what the table's
/// script gives as a signed distance.
fn solid_penetration(row: Row, x: f64, y: f64) -> f64 {
    let (depth_mm, fillet) = (row.number("depth_mm"), row.number("fillet_mm"));
    let (x, y) = (x.abs(), y.abs());
    let rounded = |beyond: f64| fillet - (fillet * fillet - beyond * beyond).sqrt();
    let height = match row.0["object"].as_str() {
        Some("cylinder") => {
            let (radius, half) = (row.number("radius_mm"), 0.5 * row.number("length_mm"));
            let beyond = (x - (half - fillet)).max(0.0);
            let radius_here = radius - rounded(beyond);
            if beyond <= fillet && y < radius_here {
                radius - (radius_here * radius_here - y * y).sqrt()
            } else {
                f64::NAN
            }
        }
        Some("block") => {
            let half = ["size_x_mm", "size_y_mm"].map(|key| 0.5 * row.number(key) - fillet);
            let beyond = (x - half[0]).max(0.0).hypot((y - half[1]).max(0.0));
            if beyond <= fillet { rounded(beyond) } else { f64::NAN }
        }
        other => panic!("no object {other:?}"),
    };
    if height.is_nan() { NOTHING } else { depth_mm - height }
}

#[test]
fn a_cylinder_s_end_and_a_block_are_as_close_to_another_code_as_is_stated() {
    const BOUNDS: [(&str, Bound); 2] = [
        ("cylinder", bound(0.2, [2.7, 0.4], [3.6, 1.5], [3.8, 2.8])),
        ("block", bound(0.2, [6.5, 1.9], [4.8, 2.2], [2.9, 4.0])),
    ];
    let rows: Vec<Value> =
        serde_json::from_str(include_str!("data/finite_strain_3d.json")).expect("a table of presses");
    let bench = Bench::new(setup(0.48), None);
    let mut wrong = Vec::new();
    for (object, bound) in &BOUNDS {
        let row = Row(rows.iter().find(|row| row["object"] == *object).expect("a row"));
        let [x_mm, y_mm, w_mm, touches] = ["x_mm", "y_mm", "w_mm", "touches"].map(|key| row.list(key));
        let points = || 0..w_mm.len();
        let from_contact = |at: usize| {
            let away = |on: usize| (x_mm[on] - x_mm[at]).hypot(y_mm[on] - y_mm[at]);
            points().filter(|on| touches[*on] == 1.0).map(away).fold(f64::INFINITY, f64::min)
        };
        // Closer to the contact the surface is steep, and the table less converged.
        let around: Vec<usize> = points().filter(|at| (0.1..RING_MM).contains(&from_contact(*at))).collect();
        assert!(around.len() > 300, "{} points", around.len());
        let off = |rig: &Rig, contact: &Contact| {
            let mut off_um = MeanSquare::default();
            for at in &around {
                let place = [x_mm[*at], y_mm[*at]];
                let place = std::array::from_fn(|k| {
                    let view_px = rig.setup.resolution_px[k] as f64;
                    place[k] / rig.setup.mm_per_px[k] + 0.5 * view_px - 0.5 + SURFACE_BORDER as f64
                });
                off_um.add(1e3 * (bilinear(&contact.surface, place) - w_mm[*at]), 1.0);
            }
            Off { ring_um: off_um.root(), force_percent: force_percent(rig, contact, row) }
        };
        let pressed = bench.press(row, |x, y| solid_penetration(row, x, y), off);
        bound.check(row, &pressed, &mut wrong);
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// How far the surface's points move to the side: in the contact, and around it, root mean squares, um.
fn off_of_motion(field: &DisplacementField, row: Row) -> [f64; 2] {
    let (edge, step) = (row.number("contact_mm"), row.number("rest_step_mm"));
    let motion = row.list("u_mm");
    let mut off_um = [MeanSquare::default(); 2];
    const APART_MM: f64 = 0.05;
    for k in 1..((edge + RING_MM) / APART_MM) as usize {
        let r = APART_MM * k as f64;
        for direction in 0..8 {
            let (sin, cos) = (0.3 + f64::from(direction) * std::f64::consts::FRAC_PI_4).sin_cos();
            let [u, v] = field.at([r * cos, r * sin]).map(f64::from);
            off_um[usize::from(r > edge)].add(1e3 * (u * cos + v * sin - interpolate(&motion, 0.0, step, r)), 1.0);
        }
    }
    off_um.map(MeanSquare::root)
}

#[test]
fn points_of_the_surface_move_to_the_side_as_in_finite_elements() {
    // In the contact and around it, at most, um, for the correction and the model of its own.
    const BOUNDS: [(&str, f64, [[f64; 2]; 2]); 5] = [
        ("ball", 0.2, [[6.9, 2.4], [3.4, 1.1]]),
        ("ball", 0.3, [[8.6, 3.1], [3.7, 1.4]]),
        ("ball", 0.4, [[15.0, 3.9], [6.5, 1.6]]),
        ("punch", 0.2, [[35.0, 13.2], [16.0, 8.1]]),
        ("cone", 0.3, [[50.0, 5.7], [36.0, 2.5]]),
    ];
    let setup = setup(0.48);
    let simulators = models(None).map(|gelpad| {
        let field_of_view_mm = std::array::from_fn(|k| setup.resolution_px[k] as f64 * setup.mm_per_px[k]);
        let sensor = Sensor::new("bare", setup.resolution_px, field_of_view_mm, setup.material());
        let optics = Fidelity::Paper.models(LightSource::Leds).optics;
        Simulator::with_models(sensor, Models { gelpad, optics }, EffectPolicy::WhereNeeded).with_flow()
    });
    let mut wrong = Vec::new();
    for (object, strain, bounds) in BOUNDS {
        let rows = table(object, None);
        let at_strain = |row: &Row| row.number("s") == strain && row.number("poisson_ratio") == 0.48;
        for row in rows.iter().map(Row).filter(at_strain) {
            let [width, height] = setup.resolution_px;
            let pixels = (0..width * height).map(|at| {
                let [x, y] = [place_mm(&setup, 0, at % width), place_mm(&setup, 1, at / width)];
                penetration(row.0, x.hypot(y)) as f32
            });
            let map = Indenter::height_map([width, height], pixels.collect()).expect("numbers");
            let off_um = simulators.each_ref().map(|simulator| {
                let contact = simulator.press(&map).contact;
                off_of_motion(&contact.tangential.expect("a press with flow").field, row)
            });
            for (pads, most) in [(CORRECTION, bounds[0]), (FINITE_STRAIN, bounds[1])] {
                let [within, around] = off_um[pads];
                let close = within < most[0] && around < most[1];
                // Around a punch the correction's coarse grid knows no better than linear theory.
                let better = within < off_um[LINEAR][0] && (around < off_um[LINEAR][1] || pads == CORRECTION);
                if !close || !better {
                    wrong.push(format!("{}: {:.2?} um, linear {:.2?}", row.name(), off_um[pads], off_um[LINEAR]));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
