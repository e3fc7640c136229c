//! Random jobs: whatever they ask for, every number is finite, within its range, and the same a second time.

use gelsim_core::base::grid::{Grid, bounding_box};
use gelsim_core::depth::rest_surface;
use gelsim_core::effects::{EffectLog, EffectPolicy};
use gelsim_core::optics::Model;
use gelsim_core::optics::led::Led;
use gelsim_core::simulator::Stages;
use gelsim_dataset::encode::encode_members;
use gelsim_job::label::Label;
use gelsim_job::plan::Plan;
use gelsim_job::sample::Sample;
use gelsim_job::sample::render;
use proptest::test_runner::{Config, RngSeed, TestCaseError, TestRunner};

use crate::plan::plan;
use crate::random_jobs::{Draw, job};

/// The largest share of an LED's light that a pixel can get, over that in the middle of the image: a near LED's falls
/// with the square of the distance. The surface stays between `heights_mm`.
fn strongest(plan: &Plan, led: &Led, heights_mm: [f64; 2]) -> f64 {
    if matches!(plan.simulator.models().optics, Model::Phong(_)) {
        return 1.0;
    }
    let (azimuth, elevation) = (led.azimuth_deg.to_radians(), led.elevation_deg.to_radians());
    let along = [azimuth.cos() * elevation.cos(), azimuth.sin() * elevation.cos()];
    let beside: f64 = (0..2)
        .map(|k| {
            let half = plan.job().sensor.field_of_view_mm[k] / 2.0;
            let at = along[k] * led.distance_mm;
            (at - at.clamp(-half, half)).powi(2)
        })
        .sum();
    let above = elevation.sin() * led.distance_mm;
    let above = above - above.clamp(heights_mm[0], heights_mm[1]);
    led.distance_mm.powi(2) / (beside + above.powi(2)).max(1e-6)
}

/// Between what heights a sample's surface stays, mm towards the camera: displacements, over the pad at rest.
fn heights_mm(plan: &Plan) -> [f64; 2] {
    let sensor = plan.simulator.sensor();
    let relief = rest_surface::rest_relief(plan.simulator.drop_mm(), sensor.coating.as_ref(), plan.simulator.view());
    let heights = relief.iter().flat_map(|relief| &relief.data).map(|mm| f64::from(*mm));
    let [low, high] = heights.fold([0.0, 0.0], |[low, high]: [f64; 2], mm| [low.min(mm), high.max(mm)]);
    [low - plan.thickness_mm(), high + plan.thickness_mm()]
}

/// The range that light before the camera stays in, whatever the surface: k_d and k_s bound Phong's terms, a flat pad's
/// are taken off, and a bulge brightens by the darkening that it lacks.
fn light_range(plan: &Plan, sample: &Sample) -> [f64; 2] {
    let Some(phong) = plan.simulator.models().optics.phong() else {
        // Lamps: shares of white, relative to a photograph or to their own composite, which was rounded.
        let beyond = if plan.simulator.sensor().has_photograph() { 1.0 } else { 0.5 / 255.0 };
        return [-beyond, 1.0 + beyond];
    };
    let heights = heights_mm(plan);
    // What LEDs leave unexplained of a real pad, at the steepest and deepest that it was fitted to.
    let residual = plan.job().sensor.light_residual.as_deref().map_or([0.0; 3], |residual| {
        let deepest = residual.heights_mm.map(f64::abs).into_iter().fold(0.0, f64::max);
        residual.change_by_angle(residual.steepest).map(|change| change + residual.change_per_mm() * deepest)
    });
    let most = (0..3)
        .map(|k| {
            let one = |led: &Led| {
                let terms = led.pattern.as_deref().map_or(&[1.0][..], |pattern| pattern.channels()[k]);
                let factor: f64 = terms.iter().map(|term| term.abs()).sum();
                factor * led.color[k] * led.intensity * strongest(plan, led, heights)
            };
            plan.job().sensor.led.iter().map(one).sum::<f64>() * (phong.diffuse + phong.specular) + residual[k]
        })
        .fold(0.0, f64::max);
    let brightened = 1.0
        + phong.darkening.unwrap_or(plan.job().sensor.darkening)
            * f64::from(sample.impression.contact.bulge_mm.max(0.0))
            / plan.thickness_mm();
    [-most * brightened, (1.0 + most) * brightened]
}

fn check(plan: &Plan, sample: &Sample) -> Result<(), &'static str> {
    let all_finite = |values: &[f32]| values.iter().all(|value| value.is_finite());
    let holds = |so: bool, otherwise: &'static str| if so { Ok(()) } else { Err(otherwise) };
    let (contact, label) = (&sample.impression.contact, &sample.label);
    let thickness = plan.thickness_mm() as f32;

    holds(
        sample.impression.depth.below_pad().data.iter().all(|mm| (0.0..=thickness).contains(mm)),
        "a depth out of the pad",
    )?;
    holds(contact.surface.data.iter().all(|w| w.abs() <= thickness), "a surface out of the pad")?;
    holds(contact.pressure.iter().all(|p| all_finite(&p.data) && p.data.iter().all(|p| *p >= 0.0)), "a pressure")?;
    let light = plan.simulator.shader().shade(
        contact,
        plan.simulator.background(),
        &mut EffectLog::new(EffectPolicy::WhereNeeded),
    );
    let light = light.into_light();
    let [low, high] = light_range(plan, sample);
    let slack = 1e-4 * (high - low);
    let within = |value: &f32| (low - slack..=high + slack).contains(&f64::from(*value));
    holds(light.planes.iter().flatten().all(within), "light out of its range")?;
    holds(
        label.health.finite && contact.finite && sample.impression.image.finite,
        "the label finds something not finite",
    )?;

    let touching = contact.mask.data.iter().filter(|value| **value == 255).count();
    let [dx, dy] = plan.simulator.view().mm_per_px;
    let area = touching as f64 * dx * dy;
    holds(contact.mask.data.iter().all(|value| [0, 255].contains(value)), "a mask that is neither")?;
    holds(label.contact.in_contact == (touching > 0), "in contact or not")?;
    holds((label.contact.area_mm2 - area).abs() <= 1e-9 * area.max(1.0), "the area")?;
    let fraction = touching as f64 / contact.mask.data.len() as f64;
    holds((label.contact.fraction - fraction).abs() < 1e-12, "the share of the view")?;
    let mask: Grid<u8> =
        sample.impression.lens.map_or_else(|| contact.mask.clone(), |lens| lens.warp_mask(&contact.mask));
    let seen = bounding_box(&mask, |value| value > 0);
    let box_px = [seen.x0, seen.y0, seen.x1, seen.y1].map(|at| at as u32);
    holds(label.contact.bbox_px == box_px, "the box")?;
    holds(label.contact.force_n.is_none_or(|force| force >= 0.0 && force.is_finite()), "the force")?;
    let pressed = contact
        .pressure
        .as_ref()
        .is_none_or(|p| p.data.iter().zip(&contact.mask.data).all(|(p, touches)| *p == 0.0 || *touches == 255));
    holds(pressed, "pressure without contact")?;
    let numerics = &label.numerics;
    holds(numerics.residual_um.is_none_or(|um| um >= 0.0 && um.is_finite()), "the residual")?;
    let pixels = (sample.impression.image.width * sample.impression.image.height) as u64;
    holds(
        sample.impression.image.clipped_px <= pixels && sample.impression.image.saturated_px <= pixels,
        "a count of pixels",
    )?;

    let text = serde_json::to_string(label).map_err(|_| "a label that is no JSON")?;
    let read: Label = serde_json::from_str(&text).map_err(|_| "a label that cannot be read back")?;
    holds(serde_json::to_string(&read).is_ok_and(|again| again == text), "a label that JSON changes")
}

#[test]
fn random_samples_are_finite_in_range_consistent_and_the_same_a_second_time() {
    let cases = if crate::thorough() { 300 } else { 120 };
    let config = Config { cases, rng_seed: RngSeed::Fixed(4), failure_persistence: None, ..Config::default() };
    let result = TestRunner::new(config).run(&job(Draw::Effects), |job| {
        let plan = plan(&job);
        for index in 0..plan.layout.sample_count() {
            let sample = render(&plan, index);
            if let Err(wrong) = check(&plan, &sample) {
                return Err(TestCaseError::fail(format!("sample {index}: {wrong} in\n{job}")));
            }
            let bytes = |sample: &Sample| -> Vec<Vec<u8>> {
                encode_members(&plan, sample)
                    .into_iter()
                    .map(|member| member.bytes.into_vec().expect("in memory"))
                    .collect()
            };
            if bytes(&sample) != bytes(&render(&plan, index)) {
                return Err(TestCaseError::fail(format!("sample {index}: other bytes in\n{job}")));
            }
        }
        Ok(())
    });
    result.unwrap_or_else(|error| panic!("{error}"));
}
