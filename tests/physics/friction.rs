//! Friction while pressing: against finite elements (`data/sticking_elements.json`, written by
//! `tests/oracle/sticking_elements.py`), against dense matrices, and in its limits.

use std::time::Instant;

use gelsim::core::base::grid::Resolution;
use gelsim::core::gelpad::Contact;
use gelsim::core::gelpad::elastic::Elastic;
use gelsim::core::gelpad::elastic::inplane::{Field, InPlane};
use gelsim::core::gelpad::elastic::shear::{Friction, Motion, shear_from};
use serde_json::Value;

use super::rig::{NOTHING, Rig, Setup};

const STICK: Option<Friction> = Some(Friction::Stick);

fn coulomb(coefficient: f64) -> Option<Friction> {
    Some(Friction::Coulomb { coefficient })
}

fn with(setup: Setup, friction: Option<Friction>) -> Rig {
    Setup { elastic: Elastic { friction, ..setup.elastic }, ..setup }.rig()
}

/// How a press moved the surface in its own plane.
fn motion(rig: &Rig, contact: &Contact) -> Field {
    let setup = &rig.setup;
    let view = std::array::from_fn(|k| setup.resolution_px[k] as f64 * setup.mm_per_px[k]);
    let in_plane = InPlane::new(setup.layer(), view, setup.mm_per_px);
    let load = contact.load.as_ref().expect("a contact");
    let mut field = in_plane.under_pressure(load);
    if let Some(friction) = setup.elastic.friction {
        let (traction, outcome) = shear_from(setup.layer(), load, Motion::default(), friction, Some(&field));
        assert!(outcome.converged, "{outcome:?}");
        field.add(&in_plane.under_traction(&traction));
    }
    field
}

fn number(row: &Value, key: &str) -> f64 {
    row[key].as_f64().unwrap_or_else(|| panic!("{key} of {row}"))
}

fn list(row: &Value, key: &str) -> Vec<f64> {
    row[key].as_array().expect("a list").iter().map(|value| value.as_f64().expect("a number")).collect()
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0), |(sum, count), value| (sum + value * value, count + 1));
    1e3 * (sum / f64::from(count.max(1))).sqrt()
}

fn ball(radius: f64, deep: f64) -> impl Fn(f64, f64) -> f64 {
    move |x, y| {
        let r = x.hypot(y);
        if r < radius { deep - radius + (radius * radius - r * r).sqrt() } else { NOTHING }
    }
}

#[test]
fn a_ball_that_sticks_is_where_finite_elements_have_it() {
    let table: Vec<Value> =
        serde_json::from_str(include_str!("data/sticking_elements.json")).expect("a table of presses");
    let setup = Setup { resolution_px: [320, 320], mm_per_px: [0.05; 2], ..Setup::default() };
    for resolution in [Resolution::Full, Resolution::Half, Resolution::Quarter] {
        for row in table.iter().filter(|row| row["object"] == "ball" && number(row, "radius_mm") == 3.3) {
            let deep = number(row, "depth_mm");
            for friction in [None, STICK] {
                let rig = with(setup.solved(resolution, 1.0), friction);
                let began = Instant::now();
                let contact = rig.press(ball(3.3, deep));
                let first = began.elapsed();
                let field = motion(&rig, &contact);
                let edge = number(row, "contact_mm").max(number(row, "linear_contact_mm"));
                let size = contact.surface.width;
                let surface = |r: f64| {
                    let at = size as f64 / 2.0 - 0.5 + r / 0.05;
                    let (left, share) = (at.floor() as usize, at.fract());
                    let value = |x: usize| f64::from(contact.surface.at(x, size / 2));
                    (1.0 - share) * value(left) + share * value(left + 1)
                };
                let (r, w, u) = (list(row, "r_mm"), list(row, "w_mm"), list(row, "u_mm"));
                let ring = r.iter().zip(&w).filter(|(r, _)| **r > edge && **r < edge + 2.0).map(|(r, w)| surface(*r) - w);
                let moved = |inside: bool| {
                    let off = |(r, u): (&f64, &f64)| f64::from(field.at([*r, 0.0])[0]) - u;
                    let edge = if inside { number(row, "contact_mm") } else { edge };
                    let chosen = move |r: f64| if inside { r < edge } else { r > edge && r < edge + 2.0 };
                    rms(r.iter().zip(&u).filter(|(r, _)| chosen(**r)).map(off))
                };
                let force = contact.force_n.expect("a force") * 1e3 / setup.youngs_modulus_kpa;
                println!(
                    "{resolution:?} {friction:?} against {} s {}: ring {:.1} um, motion {:.1} inside {:.1} outside, force {:.4}, {first:?}, it {} conv {}",
                    row["contact"], row["s"], rms(ring), moved(true), moved(false), force / number(row, "force_mm2"), contact.numerics.iterations, contact.numerics.converged
                );
            }
        }
    }
}
