//! Exact states of one element, limits, and the table of the slow reference in Python
//! (`tests/oracle/finite_elements.py`).

use serde_json::Value;

use super::element::{ElasticConstants, UNKNOWNS};
use super::layer::BondedLayer;
use super::mesh::{Extent, Mesh};
use super::press::PressSolver;
use super::profile::Profile;
use super::{dome_sag, element, interpolate_depth};

const H: f64 = 3.0;

/// A block of rubber stretched alike everywhere is in balance, with the stress of the closed form on its faces.
#[test]
fn a_homogeneous_compression_is_exact() {
    let rubber = ElasticConstants::new(0.48);
    let mesh = Mesh::regular_block([2.0, 1.5], 2, 2);
    for [across, along] in [[1.0, 1.0], [1.2, 0.7], [0.9, 1.3]] {
        // Stresses of ln-volume rubber: shear F + (p - shear) / F, with p from the volume.
        let pressure = rubber.lame * libm::log(across * across * along);
        let stress = |stretch: f64| rubber.shear * stretch + (pressure - rubber.shear) / stretch;
        let mut forces = vec![[0.0; 2]; mesh.nodes.len()];
        for column in 0..mesh.columns {
            for row in 0..mesh.rows {
                let nodes = mesh.element_nodes(column, row);
                let mut state = [pressure; UNKNOWNS];
                for (k, node) in nodes.into_iter().enumerate() {
                    let [r, z] = mesh.nodes[node];
                    state[2 * k] = (across - 1.0) * r;
                    state[2 * k + 1] = (along - 1.0) * z;
                }
                let element = element::Element::new(&nodes.map(|node| mesh.nodes[node]));
                let response = element.compute_response(rubber, &state).expect("not inside out");
                assert!(response.forces[element::DISPLACEMENTS..].iter().all(|force| force.abs() < 1e-13));
                for (node, force) in nodes.into_iter().zip(response.forces.chunks_exact(2)) {
                    forces[node] = [forces[node][0] + force[0], forces[node][1] + force[1]];
                }
            }
        }
        let (mut top, mut side) = (0.0, 0.0);
        for (node, force) in mesh.nodes.iter().zip(&forces) {
            let (at_side, at_end) = (node[0] == 2.0, node[1] == 1.5 || node[1] == 0.0);
            assert!(at_side || force[0].abs() < 1e-12, "{node:?}: {force:?}");
            assert!(at_end || force[1].abs() < 1e-12, "{node:?}: {force:?}");
            top += if node[1] == 1.5 { force[1] } else { 0.0 };
            side += if at_side { force[0] } else { 0.0 };
        }
        // Over an angle of 1 the top has half the radius squared, the side radius times height.
        assert!((top - stress(along) * 2.0).abs() < 1e-12, "{top}");
        assert!((side - stress(across) * 3.0).abs() < 1e-12, "{side}");
    }
}

#[test]
fn derivatives_are_those_of_the_forces() {
    let rubber = ElasticConstants::new(0.45);
    let mesh = Mesh::regular_block([1.0, 1.0], 1, 1);
    let element = element::Element::new(&mesh.element_nodes(0, 0).map(|node| mesh.nodes[node]));
    let state: [f64; UNKNOWNS] = std::array::from_fn(|k| 0.05 * (k as f64 * 1.3).sin());
    let at = element.compute_response(rubber, &state).expect("not inside out");
    for column in 0..UNKNOWNS {
        let moved = |by: f64| {
            let mut state = state;
            state[column] += by;
            element.compute_response(rubber, &state).expect("not inside out").forces
        };
        let (ahead, behind) = (moved(1e-6), moved(-1e-6));
        for row in 0..UNKNOWNS {
            let expected = (ahead[row] - behind[row]) / 2e-6;
            assert!((at.matrix[row][column] - expected).abs() < 1e-7, "{row} {column}: {expected}");
        }
    }
}

fn ball(radius: f64) -> Vec<f64> {
    let z = |r: f64| if r < radius { radius - (radius * radius - r * r).sqrt() } else { f64::INFINITY };
    (0..2000).map(|k| z(f64::from(k) * super::body::SAMPLE_SPACING_MM)).collect()
}

fn layer(profile: &Profile, depth: f64, contact: f64, dome: Option<f64>, refine: f64) -> BondedLayer {
    let extent = Extent { thickness: H, depth, contact, ring: 2.0, refine };
    let drop = |r: f64| dome.map_or(0.0, |dome| dome_sag(dome, r));
    BondedLayer::new(Mesh::new(profile, extent, drop), ElasticConstants::new(0.48))
}

/// Small strains: Hertz's force on a ball, times the series of Dimitriadis et al. (2002) for a layer bonded to its
/// shell.
#[test]
fn a_tiny_press_of_a_ball_is_that_of_linear_theory() {
    let (radius, depth) = (2.0, 0.02);
    let profile = Profile::new(&ball(radius), super::body::SAMPLE_SPACING_MM, 0.1, 2.0);
    let a = libm::sqrt(radius * depth);
    let mut press_force = [0.0; 2];
    for (force, refine) in press_force.iter_mut().zip([1.0, 3.0]) {
        let layer = layer(&profile, depth, a, None, refine);
        let mut press = PressSolver::new(&layer, &profile, H, false);
        assert!(press.press_to(depth));
        *force = press.axial_force();
    }
    let hertz = 4.0 / 3.0 / (1.0 - 0.48 * 0.48) * libm::sqrt(radius) * libm::pow(depth, 1.5);
    let (chi, alpha) = (a / H, 1.7169 * std::f64::consts::FRAC_2_PI);
    let expected = hertz * (1.0 + alpha * chi + alpha * alpha * chi * chi);
    let errors = press_force.map(|force| force / expected - 1.0);
    println!("force off by {errors:.4?}, in Hertz's {:.4}", press_force[1] / hertz);
    assert!(errors[1].abs() < 0.02, "{errors:?}");
}

/// Rows of the table for a press.
fn rows(wanted: impl Fn(&Value) -> bool) -> Vec<Value> {
    let table = include_str!("../../../tests/physics/data/finite_elements.json");
    let rows: Vec<Value> = serde_json::from_str(table).expect("a table of presses");
    rows.into_iter().filter(|row| row["geometry"] == "axisymmetric" && wanted(row)).collect()
}

/// Surfaces of another program's finite elements, on other meshes, in and around the contact.
fn agrees(rows: &[Value], heights: &[f64], sticking: bool, dome: Option<f64>) {
    assert!(!rows.is_empty());
    let number = |row: &Value, key: &str| row[key].as_f64().expect("a number");
    let profile = Profile::new(heights, super::body::SAMPLE_SPACING_MM, 0.1, 2.5);
    let last = &rows[rows.len() - 1];
    let layer = layer(&profile, number(last, "depth_mm"), number(last, "linear_contact_mm"), dome, 1.0);
    let mut press = PressSolver::new(&layer, &profile, H, sticking);
    for row in rows {
        assert!(press.press_to(number(row, "depth_mm")), "stopped at {}", press.depth());
        let line = press.surface_line();
        let list = |key: &str| row[key].as_array().expect("a list").iter().map(|mm| mm.as_f64().expect("a number"));
        let mut off_um = 0.0_f64;
        for (r, w) in list("r_mm").zip(list("w_mm")) {
            let own = interpolate_depth(&line, r) - dome.map_or(0.0, |dome| dome_sag(dome, r));
            off_um = off_um.max(1e3 * (own - w).abs());
        }
        let error_um = number(row, "error_max_um");
        println!("s {}: off by {off_um:.2} um, linear theory by {error_um}", row["s"]);
        assert!(off_um < 0.5 + 0.01 * error_um, "s {}: {off_um} um", row["s"]);
    }
}

#[test]
fn surfaces_under_a_ball_are_those_of_the_table() {
    let of = |contact: &'static str, dome: Option<f64>| {
        rows(|row| row["radius_mm"] == 3.3 && row["contact"] == contact && row["dome_mm"].as_f64() == dome)
    };
    agrees(&of("frictionless", None), &ball(3.3), false, None);
    agrees(&of("sticking", None), &ball(3.3), true, None);
    agrees(&of("frictionless", Some(10.0)), &ball(3.3), false, Some(10.0));
}

#[test]
fn the_surface_beside_a_rounded_punch_is_that_of_the_table() {
    let rows = rows(|row| row["radius_mm"] == 2.0 && row["fillet_mm"] == 0.5 && row["contact"] == "frictionless");
    let z = |r: f64| {
        let along = (r - 1.5).max(0.0);
        if r <= 2.0 + 1e-9 { 0.5 - (0.25 - along * along).max(0.0).sqrt() } else { f64::INFINITY }
    };
    let heights: Vec<f64> = (0..600).map(|k| z(f64::from(k) * super::body::SAMPLE_SPACING_MM)).collect();
    agrees(&rows[..2], &heights, false, None);
}
