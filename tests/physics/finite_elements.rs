//! The error of the linear layer that labels state, against neo-Hookean finite elements (`data/finite_elements.json`, written by
//! `tests/oracle/finite_elements.py`).

use gelsim_core::base::grid::Resolution;
use gelsim_core::gelpad::Contact;
use gelsim_core::gelpad::elastic::Elastic;
use gelsim_core::gelpad::elastic::model_error::{curvature_error_mm, ring_rms_mm};
use gelsim_core::gelpad::elastic::shear::Friction;
use serde_json::Value;

use super::rig::{NOTHING, Rig, Setup};

/// Errors that are too small to matter, um.
const SMALL_UM: f64 = 1.0;

/// Beside a block in plane strain and on every side of a body of revolution a thickness, at a usual camera's pixels.
pub fn rig(resolution: Resolution, friction: Option<Friction>) -> Rig {
    let setup = Setup { resolution_px: [240, 240], mm_per_px: [0.06; 2], ..Setup::default() };
    let setup = setup.solved(resolution, 1.0);
    Setup { elastic: Elastic { friction, ..setup.elastic }, ..setup }.rig()
}

/// How far the object of a row is below the undeformed pad at a distance from its axis, mm.
pub fn penetration(row: &Value, r: f64) -> f64 {
    let of = |key: &str| row[key].as_f64().unwrap_or_else(|| panic!("{key} of {row}"));
    let beside = |inside: bool, height: f64| if inside { of("depth_mm") - height } else { NOTHING };
    match row["object"].as_str() {
        Some("ball" | "cylinder") => {
            let radius = of("radius_mm");
            beside(r < radius, radius - (radius * radius - r * r).max(0.0).sqrt())
        }
        Some("punch" | "block") => {
            let (radius, fillet) = (of("radius_mm"), of("fillet_mm"));
            let along = (r - (radius - fillet)).max(0.0);
            beside(r <= radius, fillet - (fillet * fillet - along * along).max(0.0).sqrt())
        }
        Some("cone") => {
            let (slope, tip) = (of("slope"), of("tip_mm"));
            let tangent = tip * slope / slope.hypot(1.0);
            let on_tip = tip - (tip * tip - r.min(tangent).powi(2)).sqrt();
            of("depth_mm") - on_tip - slope * (r - tangent).max(0.0)
        }
        other => panic!("no object {other:?}"),
    }
}

/// Frictionless presses.
fn rows() -> Vec<Value> {
    let table: Vec<Value> =
        serde_json::from_str(include_str!("data/finite_elements.json")).expect("a table of presses");
    table.into_iter().filter(|row| row["contact"] == "frictionless").collect()
}

/// How far the pad lies below its highest point at a distance from it, mm.
fn drop_mm(row: &Value, r: f64) -> f64 {
    row["dome_mm"].as_f64().map_or(0.0, |dome| dome - (dome * dome - r * r).max(0.0).sqrt())
}

pub fn press(rig: &Rig, row: &Value) -> Contact {
    let is_prism = row["geometry"] == "plane strain";
    let penetration = |r: f64| penetration(row, r) - drop_mm(row, r);
    rig.press(|x, y| penetration(if is_prism { x.abs() } else { x.hypot(y) }))
}

/// What the label states, um.
fn stated_um(rig: &Rig, row: &Value) -> f64 {
    let contact = press(rig, row);
    let mut rest = contact.surface.clone();
    for y in 0..rest.height {
        for x in 0..rest.width {
            let place = |at: usize| (at as f64 + 0.5 - rest.width as f64 / 2.0) * rig.setup.mm_per_px[0];
            rest.row_mut(y)[x] = drop_mm(row, place(x).hypot(place(y))) as f32;
        }
    }
    let depth_mm = row["depth_mm"].as_f64().expect("a depth");
    let curved_mm = curvature_error_mm(depth_mm, &contact.mask, &rest, rig.setup.mm_per_px);
    contact.numerics.model_error_um.expect("the elastic pad knows it") + 1e3 * curved_mm
}

#[test]
fn the_label_knows_the_error_of_linear_theory_within_a_factor_of_two() {
    let rows = rows();
    assert!(rows.len() >= 60, "{} presses", rows.len());
    for resolution in [Resolution::Full, Resolution::Half] {
        let rig = rig(resolution, None);
        let mut worst = [1.0_f64; 2];
        for row in &rows {
            let true_um = row["error_max_um"].as_f64().expect("an error");
            let stated_um = stated_um(&rig, row);
            let ratio = stated_um / true_um;
            if resolution == Resolution::Full {
                let sizes = ["radius_mm", "fillet_mm", "slope"].map(|key| row[key].as_f64().unwrap_or_default());
                println!("{} {sizes:?}, s {}: {true_um} um, stated {stated_um:.1}", row["object"], row["s"]);
            }
            let negligible = true_um < SMALL_UM && stated_um < 2.0 * SMALL_UM;
            assert!(negligible || (0.5..=2.0).contains(&ratio), "{row}: stated {stated_um}");
            worst = [worst[0].min(ratio), worst[1].max(ratio)];
        }
        println!("{resolution:?}: stated over true from {:.2} to {:.2}, {} presses", worst[0], worst[1], rows.len());
    }
}

/// What `gelsim tradeoff` makes of the largest error, which is the theory's.
#[test]
fn the_root_mean_square_beside_the_contact_follows_from_the_largest_error() {
    let mut worst = [1.0_f64; 2];
    for row in rows() {
        let of = |key: &str| row[key].as_f64().expect("a number");
        let ratio = ring_rms_mm(1e-3 * of("error_max_um"), of("depth_mm")) / (1e-3 * of("error_rms_um"));
        worst = [worst[0].min(ratio), worst[1].max(ratio)];
        assert!(of("error_max_um") < SMALL_UM || (0.5..=2.0).contains(&ratio), "{row}: {ratio}");
    }
    println!("stated over true: {worst:.2?}");
}

/// The table is of the same presses: gelsim's surface is as far from it as the linear theory of the same elements is.
#[test]
fn surfaces_are_as_far_from_finite_elements_as_the_table_says() {
    let rig = rig(Resolution::Full, None);
    for row in rows().iter().filter(|row| row["geometry"] == "axisymmetric" && row["dome_mm"].is_null()) {
        let contact = press(&rig, row);
        let of = |key: &str| row[key].as_f64().expect("a number");
        let (edge, ring) = (of("contact_mm").max(of("linear_contact_mm")), 2.0);
        let list = |key: &str| row[key].as_array().expect("a list").iter().map(|mm| mm.as_f64().expect("a number"));
        let size = contact.surface.width;
        let mut worst_um = 0.0_f64;
        // Half a pixel off the axis is less than a hundredth of the distance. Beside a wall the grid itself matters.
        for (r, finite_mm) in list("r_mm").zip(list("w_mm")).filter(|(r, _)| *r > edge + 0.1 && *r < edge + ring) {
            let at = size as f64 / 2.0 - 0.5 + r / rig.setup.mm_per_px[0];
            let (left, share) = (at.floor() as usize, at.fract());
            let value = |x: usize| f64::from(contact.surface.at(x, size / 2));
            let own_mm = (1.0 - share) * value(left) + share * value(left + 1);
            worst_um = worst_um.max(1e3 * (own_mm - finite_mm).abs());
        }
        println!("{} s {}: off by {worst_um:.1} um, in the table {}", row["object"], row["s"], row["error_max_um"]);
        assert!(worst_um < 1.1 * of("error_max_um") + 2.0, "{row}: off by {worst_um} um");
    }
}
