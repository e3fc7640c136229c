//! Samples against the reference pipeline in f64: mesh, depth, contact, normals, light, camera, grey levels.
//!
//! Of a level that solves on squares of two or four pixels the pressure is compared; its surface is interpolated.

use gelsim_core::base::grid::Grid;
use gelsim_core::base::view::SURFACE_BORDER;
use gelsim_core::effects::EffectPolicy;
use gelsim_core::fidelity::Fidelity;
use gelsim_core::gelpad::elastic::layer::ElasticLayer;
use gelsim_core::simulator::Stages;
use gelsim_job::plan::Plan;
use gelsim_job::sample::{Sample, render};

use super::press::{Extras, GENERIC, Numbers, Setting, errors_of_light};
use gelsim_oracle::pipeline_f64::{blurred, lags, largest, penetration, pressed, pressure_on_squares};

/// 12 x 9 mm in pixels of 0.25 mm, on a pad that is 2.1 mm thick.
const SETTING: Setting<'_> = Setting {
    object: "sphere",
    level: Fidelity::Reference,
    extras: Extras::None,
    resolution_px: [48, 36],
    anchor: "bounds",
    more: "sensor.field_of_view_mm = [12.0, 9.0]\noptics.phong.shadows = 'none'\n",
};
const NUMBERS: Numbers = Numbers { depth_mm: 0.6, thickness_mm: 2.1, x_mm: 0.337, y_mm: -0.219, ..GENERIC };
const OBJECTS: [&str; 4] = ["sphere", "cone", "dots", "cube"];

/// Largest error of the pressure that a sample's level solved for, as a share of the highest.
fn pressure_error(sample: &Sample, plan: &Plan, expected: &Grid<f64>, factor: usize) -> f64 {
    let load = sample.impression.contact.load.as_ref().expect("a contact");
    let pitch = load.mm_per_px;
    let view = plan.simulator.view();
    // The window and the load have one middle.
    let corner = [0, 1].map(|k| {
        let size = [expected.width, expected.height][k] as f64;
        (load.origin_mm[k] / pitch[k] + 0.5 * (size - 1.0)).round() as usize
    });
    assert_eq!(pitch[0], view.mm_per_px[0] * factor as f64);
    let highest = largest(expected.data.iter().copied());
    let mut worst = 0.0_f64;
    for (at, expected_p) in expected.data.iter().enumerate() {
        let [x, y] = [at % expected.width, at / expected.width];
        let inside = x >= corner[0] && y >= corner[1];
        let inside = inside && x - corner[0] < load.pressure.width && y - corner[1] < load.pressure.height;
        let found = if inside { f64::from(load.pressure.at(x - corner[0], y - corner[1])) } else { 0.0 };
        worst = worst.max((found - expected_p).abs() / highest);
    }
    worst
}

/// Pixels from one solved pixel to the next.
fn factor(level: Fidelity) -> usize {
    match level {
        Fidelity::Draft => 4,
        Fidelity::Standard => 2,
        Fidelity::Paper | Fidelity::High | Fidelity::Reference | Fidelity::FiniteStrain => 1,
    }
}

#[test]
fn every_linear_level_gives_the_surface_and_the_image_of_the_f64_pipeline() {
    let plan_of = |object, level| Setting { object, level, ..SETTING }.plan(&NUMBERS).with_policy(EffectPolicy::All);
    let plan = plan_of(OBJECTS[0], Fidelity::Reference);
    let margin = |plan: &Plan| plan.simulator.pad().capture_window(NUMBERS.depth_mm).margin_px;
    // Of the elastic pad; the response on each of its grids.
    let window = plan.simulator.view().resolution_px.map(|px| px + 2 * margin(&plan));
    let layer = ElasticLayer::new(&plan.simulator.sensor().gelpad);
    let lags = [1, 2, 4].map(|factor| {
        let pitch = plan.simulator.view().mm_per_px[0] * factor as f64;
        lags(layer, pitch, window.map(|size| size.div_ceil(factor)))
    });
    for object in OBJECTS {
        // The blur reaches further than any margin here.
        let plan = plan_of(object, Fidelity::Paper);
        let widest = margin(&plan);
        let penetration = penetration(&plan, object, 0, widest);
        // The pipeline is linear.
        for level in Fidelity::ALL.into_iter().filter(|level| *level != Fidelity::FiniteStrain) {
            let plan = plan_of(object, level);
            let sample = render(&plan, 0);
            let (margin, factor) = (margin(&plan), factor(level));
            let known = penetration.inner(widest - margin);
            if factor > 1 {
                let [pitch, _] = plan.simulator.view().mm_per_px;
                let expected = pressure_on_squares(&known, factor, &lags[factor.ilog2() as usize], pitch);
                let off = pressure_error(&sample, &plan, &expected, factor);
                println!("{object}, {level:?}: pressure {off:.5} of the highest");
                assert!(off < 0.01, "{object}, {level:?}: {off}");
                continue;
            }
            let window = match level {
                Fidelity::Paper => blurred(&known),
                _ => pressed(&known, &lags[0], plan.simulator.view().mm_per_px[0]),
            };
            let surface_um = surface_error_um(&sample, &window, margin);
            let (most_um, most_deg, most_levels) = match level {
                Fidelity::Paper => (0.05, 0.005, 0.02),
                Fidelity::High => (1.0, 0.1, 0.4),
                _ => (0.05, 0.005, 0.02),
            };
            assert!(surface_um < most_um, "{object}, {level:?}: {surface_um} um");
            let expected = window.inner(margin - SURFACE_BORDER);
            let [turned, off, misrounded] = errors_of_light(&plan, &sample, &expected);
            println!(
                "{object}, {level:?}: surface {surface_um:.4} um, normals {turned:.4} degrees, light {off:.4} levels, \
                 image {misrounded:.4} beyond half a level"
            );
            assert!(turned < most_deg && off < most_levels, "{object}, {level:?}: {turned} degrees, {off} levels");
            assert!(misrounded < most_levels, "{object}, {level:?}: {misrounded} levels");
        }
    }
}

/// Largest error of a sample's surface, um.
fn surface_error_um(sample: &Sample, window: &Grid<f64>, margin: usize) -> f64 {
    let (surface, corner) = (&sample.impression.contact.surface, margin - SURFACE_BORDER);
    let mut worst = 0.0_f64;
    for (at, w) in surface.data.iter().enumerate() {
        let [u, v] = [at % surface.width + corner, at / surface.width + corner];
        worst = worst.max(1e3 * (f64::from(*w) - window.at(u, v)).abs());
    }
    worst
}
