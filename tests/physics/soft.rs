//! Objects that are not rigid: Hertz with two moduli, the rigid limit, and who gives way by how much.

use gelsim::core::base::grid::Resolution;
use gelsim::core::depth::Depth;
use gelsim::core::gelpad::Contact;
use gelsim::core::gelpad::elastic::friction::Drag;
use gelsim::core::gelpad::elastic::shear::Friction;
use gelsim::core::gelpad::elastic::{Elastic, Pad};
use gelsim::{ObjectMaterial, Soft};

use super::reference_solutions as reference;
use super::rig::{OBJECTS, RESOLUTIONS, Rig, Setup, ball};

const YOUNG: f64 = 100.0;
const RADIUS: f64 = 10.0;
const DEEP: f64 = 0.4;

/// A square view of 128 px of 1 / 16 mm on a pad 20 m thick, a half-space.
fn thick(resolution: Resolution) -> Rig {
    let setup = Setup {
        resolution_px: [128; 2],
        mm_per_px: [1.0 / 16.0; 2],
        thickness_mm: 20_000.0,
        poisson_ratio: 0.3,
        youngs_modulus_kpa: YOUNG,
        ..Setup::default()
    };
    setup.solved(resolution, 0.05).rig()
}

fn made_of(youngs_modulus_kpa: f64, poisson_ratio: f64) -> ObjectMaterial {
    ObjectMaterial { soft: Some(Soft { youngs_modulus_kpa, poisson_ratio }), ..ObjectMaterial::default() }
}

/// The press of an object that is not rigid, and the shape that it takes.
fn press(rig: &Rig, material: &ObjectMaterial, overlap: impl Fn(f64, f64) -> f64) -> (Depth, Contact) {
    let pad = rig.pad.under(material);
    let yielded = pad.yielded(&rig.depth(overlap), None, pad.window(0.0)).expect("an object that gives way");
    assert!(yielded.solved);
    let contact = pad.press(&yielded.depth);
    assert!(contact.numerics.converged, "{:?}", contact.numerics);
    (yielded.depth, contact)
}

fn radius(contact: &Contact, rig: &Rig) -> f64 {
    let touching = contact.mask.data.iter().filter(|value| **value == 255).count();
    (touching as f64 * rig.setup.mm_per_px[0] * rig.setup.mm_per_px[1] / std::f64::consts::PI).sqrt()
}

fn paraboloid(x: f64, y: f64) -> f64 {
    DEEP - (x * x + y * y) / (2.0 * RADIUS)
}

#[test]
fn a_soft_ball_on_a_thick_pad_is_hertzs_with_two_moduli() {
    for resolution in RESOLUTIONS {
        let rig = thick(resolution);
        let pad = (1.0 - 0.3 * 0.3) / YOUNG;
        for (young, poisson) in [(1000.0, 0.48), (100.0, 0.3), (100.0, 0.0), (20.0, 0.48)] {
            let object = (1.0 - poisson * poisson) / young;
            let expected = reference::hertz(1.0 / (pad + object), RADIUS, DEEP);
            let (depth, contact) = press(&rig, &made_of(young, poisson), paraboloid);
            let force = 1e3 * contact.force_n.expect("the pad knows forces") / expected.force - 1.0;
            let radius = radius(&contact, &rig) / expected.radius - 1.0;
            // Of the approach each takes its share, in the middle of the contact as far away from it.
            let share = f64::from(depth.deepest_mm) / DEEP;
            println!("{resolution:?}, {young} kPa: force {force:.1e}, radius {radius:.1e}, share {share:.4}");
            // Of 32 px; on every fourth of them the mask's edge is the interpolation's.
            let bound = if resolution == Resolution::Quarter { 0.05 } else { 0.01 };
            assert!(force.abs() < 0.01 && radius.abs() < bound, "{resolution:?}, {young} kPa: {force}, {radius}");
        }
    }
}
