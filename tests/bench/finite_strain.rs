//! Error and time of rubber at finite strain: `cargo bench -p gelsim-bench --bench finite_strain [-- WORDS]`.
//!
//! Every body of revolution in `tests/physics/data/finite_strain.json` (finite elements) whose name contains the words is
//! pressed into linear theory, linear theory with `strain_correction`, and finite strain, on 240x240 px of 0.06 mm. The
//! table has the error of the surface in the ring of 2 mm outside the contact (root mean square over the radius, um),
//! that of the force (%), the time of the press (ms, with its linear part) and the steps.

use std::time::Instant;

use gelsim_core::base::grid::{Grid, Rect, Resolution};
use gelsim_core::base::view::{SURFACE_BORDER, View};
use gelsim_core::depth::Depth;
use gelsim_core::gelpad::elastic::Elastic;
use gelsim_core::gelpad::elastic::shear::Friction;
use gelsim_core::gelpad::finite_strain::FiniteStrain;
use gelsim_core::gelpad::material::Material;
use gelsim_core::gelpad::{Contact, Model, Pad};
use serde_json::Value;

const VIEW: View = View { resolution_px: [240; 2], mm_per_px: [0.06; 2] };
const RING_MM: f64 = 2.0;

fn main() {
    // Cargo passes a flag of its own.
    let words: Vec<String> = std::env::args().skip(1).filter(|word| !word.starts_with("--")).collect();
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../physics/data/finite_strain.json");
    let table = std::fs::read_to_string(path).unwrap_or_else(|error| panic!("{path}: {error}"));
    let rows: Vec<Value> = serde_json::from_str(&table).unwrap_or_else(|error| panic!("{path}: {error}"));
    println!("{:44} | linear: um, % | + strain_correction: um, %, ms, steps | finite strain", "");
    for row in rows.iter().filter(|row| row["geometry"] == "axisymmetric") {
        let name = name_of(row);
        if words.iter().all(|word| name.contains(word.as_str())) {
            print!("{name:44}");
            print_row(row);
        }
    }
}

fn number(row: &Value, key: &str) -> f64 {
    row[key].as_f64().unwrap_or(f64::NAN)
}

fn name_of(row: &Value) -> String {
    let sizes = match row["object"].as_str() {
        Some("cone") => format!("slope {}", number(row, "slope")),
        Some("punch") => format!("R {} fillet {}", number(row, "radius_mm"), number(row, "fillet_mm")),
        _ => format!("R {}", number(row, "radius_mm")),
    };
    let [object, contact] = ["object", "contact"].map(|key| row[key].as_str().unwrap_or_default());
    format!("{object} {sizes} {contact} nu {} d/h {}", number(row, "poisson_ratio"), number(row, "s"))
}

fn print_row(row: &Value) {
    let material =
        Material { thickness_mm: 3.0, youngs_modulus_kpa: 100.0, poisson_ratio: number(row, "poisson_ratio") };
    let friction = (row["contact"] == "sticking").then_some(Friction::Stick);
    let linear = Elastic { resolution: Resolution::Full, tolerance_um: 0.1, friction, ..Elastic::default() };
    let models = [
        Model::Elastic(linear),
        Model::Elastic(Elastic { strain_correction: true, ..linear }),
        Model::FiniteStrain(FiniteStrain { friction, ..FiniteStrain::default() }),
    ];
    for model in models {
        let pad = Pad::new(&model, &material, &VIEW);
        let depth = capture(row, &pad);
        let began = Instant::now();
        let contact = pad.press(&depth);
        let ms = 1e3 * began.elapsed().as_secs_f64();
        let force = 1e3 * contact.force_n.unwrap_or(f64::NAN) / material.youngs_modulus_kpa;
        let force_error = 100.0 * (force / number(row, "force_mm2") - 1.0);
        print!(" | {:6.2} {force_error:6.2}", ring_rms_um(row, &contact));
        if model.strain_settings().is_some() {
            let numerics = &contact.numerics;
            print!(" {ms:5.0} {:3}", numerics.strain_iterations);
        }
    }
    println!();
}

/// Returns how far the object reaches below the undeformed pad at a distance from its axis, mm.
fn penetration(row: &Value, r: f64) -> f64 {
    let of = |key: &str| number(row, key);
    let depth = of("depth_mm");
    let inside = match row["object"].as_str() {
        Some("ball") => {
            let radius = of("radius_mm");
            (r < radius).then(|| depth - radius + (radius * radius - r * r).sqrt())
        }
        Some("punch") => {
            let (radius, fillet) = (of("radius_mm"), of("fillet_mm"));
            let along = (r - (radius - fillet)).max(0.0);
            (r <= radius).then(|| depth - fillet + (fillet * fillet - along * along).max(0.0).sqrt())
        }
        _ => {
            let (slope, tip) = (of("slope"), of("tip_mm"));
            let tangent = tip * slope / slope.hypot(1.0);
            let on_tip = tip - (tip * tip - r.min(tangent).powi(2)).sqrt();
            Some(depth - on_tip - slope * (r - tangent).max(0.0))
        }
    };
    inside.unwrap_or(f64::NEG_INFINITY)
}

fn radius_mm(x: usize, y: usize, size: [usize; 2]) -> f64 {
    let along = |at: usize, k: usize| (at as f64 + 0.5 - size[k] as f64 / 2.0) * VIEW.mm_per_px[k];
    along(x, 0).hypot(along(y, 1))
}

fn capture(row: &Value, pad: &Pad) -> Depth {
    let window = pad.capture_window(number(row, "depth_mm"));
    let size = VIEW.resolution_px.map(|px| px + 2 * window.margin_px);
    let mut penetrates = Grid::new(size[0], size[1]);
    for y in 0..size[1] {
        for (x, mm) in penetrates.row_mut(y).iter_mut().enumerate() {
            *mm = penetration(row, radius_mm(x, y, size)).max(-window.above_mm) as f32;
        }
    }
    let margin_px = window.margin_px;
    let mut depth =
        Depth { penetration: penetrates, margin_px, touching: Rect::default(), deepest_mm: 0.0, over_thickness_px: 0 };
    depth.measure();
    depth
}

fn ring_rms_um(row: &Value, contact: &Contact) -> f64 {
    let (edge, start, step) = (number(row, "contact_mm"), number(row, "ring_start_mm"), number(row, "ring_step_mm"));
    let heights: Vec<f64> = row["ring_w_mm"].as_array().into_iter().flatten().filter_map(Value::as_f64).collect();
    let (mut sum, mut weight) = (0.0, 0.0);
    let [width, height] = VIEW.resolution_px;
    for y in 0..height {
        for x in 0..width {
            let r = radius_mm(x, y, VIEW.resolution_px);
            if r < edge.max(start) || r > edge + RING_MM {
                continue;
            }
            let place = (r - start) / step;
            let below = (place as usize).min(heights.len() - 2);
            let there = heights[below] + (place - below as f64) * (heights[below + 1] - heights[below]);
            let error = f64::from(contact.surface.at(x + SURFACE_BORDER, y + SURFACE_BORDER)) - there;
            // Every radius counts alike, not every pixel.
            sum += error * error / r;
            weight += 1.0 / r;
        }
    }
    1e3 * (sum / weight).sqrt()
}
