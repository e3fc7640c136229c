use std::path::Path;

use super::*;
use crate::photometric::{Photometric, PhotometricRecipe, SensorProfile};
use gelsim_files::diagnostic::Diagnostics;
use gelsim_job::config::{self, Overrides};
use gelsim_lab::metrics::noise::NoiseLevel;

fn renderer(settings: Paired, more: &str) -> CounterpartRenderer {
    let text = format!(
        "[dataset]\nname = \"pairs\"\nsamples = 1\nseed = 11\n[sensor]\nresolution_px = [160, 120]\n\
         [indentation]\ndepth_mm = 1.0\n[[object]]\npath = \"objects/sphere.obj\"\n[[object]]\n\
         path = \"objects/letter.obj\"\n{more}"
    );
    let mut problems = Diagnostics::default();
    let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../.."));
    let written = config::read_job_text("job", text, folder, &Overrides::default(), &mut problems);
    let plan = Plan::resolve(written, problems).unwrap_or_else(|report| panic!("{report}"));
    let background = to_rgb_image(plan.simulator.untouched());
    CounterpartRenderer::new(plan, settings, background)
}

fn metadata(object: &str, renderer: &CounterpartRenderer) -> PressMetadata {
    let object = renderer.plan.sampling.objects.iter().position(|found| found.class == object).expect("it is bundled");
    let angles = Angles { yaw_deg: 25.0, tilt_deg: 0.0, tilt_azimuth_deg: 0.0 };
    PressMetadata { object, orientation: Orientation::Angles(angles), position_mm: [1.0, -0.5], depth_mm: 0.7 }
}

/// A "real" image of the press at `metadata`, as other LEDs and a noisy camera would have shown it.
fn photographed(renderer: &CounterpartRenderer, metadata: &PressMetadata, recipe: &str) -> RgbImage {
    let sample = renderer.render_press(metadata, 4);
    let settings: Photometric = toml::from_str(recipe).expect("a table");
    let profile = SensorProfile {
        sensor: renderer.plan.job().sensor.clone(),
        view: *renderer.plan.simulator.view(),
        background: None,
        noise: Some(NoiseLevel { read_levels: 2.0, shot_levels: 0.0 }),
    };
    to_rgb_image(
        &PhotometricRecipe::new(settings, &profile, Vec::new()).apply(&to_rgb_image(&sample.impression.image), 3, 1).0,
    )
}

#[test]
fn a_shift_under_other_leds_and_noise_is_found_within_a_fifth_of_a_pixel_and_the_counterpart_is_rendered_there() {
    let renderer = renderer(Paired::default(), "");
    let recipe = "led_gain = [0.8, 1.25]\nexposure_ev = -0.1\nnoise_level = 2.0";
    for object in ["sphere", "letter"] {
        for shift_px in [[3.4, -2.2], [0.0, 0.0], [-11.7, 9.3]] {
            let label = metadata(object, &renderer);
            let mm_per_px = renderer.plan.simulator.view().mm_per_px;
            let mut place = label;
            (0..2).for_each(|k| place.position_mm[k] += shift_px[k] * mm_per_px[k]);
            let real = photographed(&renderer, &place, recipe);
            let counterpart = renderer.render_counterpart(&label, &real, 9);
            assert_eq!(counterpart.alignment, Alignment::Aligned);
            for k in 0..2 {
                let error = counterpart.offset_px[k] - shift_px[k];
                assert!(error.abs() < 0.2, "{object} {shift_px:?}: {:?}", counterpart.offset_px);
                let moved_mm = counterpart.metadata.position_mm[k] - label.position_mm[k];
                assert!((moved_mm - counterpart.offset_px[k] * mm_per_px[k]).abs() < 1e-12);
            }
            assert!(counterpart.correlation > 0.8, "{object} {shift_px:?}: {}", counterpart.correlation);
            // Rendered there, not moved there: byte for byte what the simulator gives for that place.
            assert_eq!(
                counterpart.sample.impression.image.rgb,
                renderer.render_press(&counterpart.metadata, 9).impression.image.rgb
            );
        }
    }
}

#[test]
fn without_contact_or_likeness_or_within_reach_a_counterpart_stays_where_its_label_says() {
    let renderer = renderer(Paired { max_offset_px: 6, ..Paired::default() }, "");
    let label = metadata("sphere", &renderer);
    let real = photographed(&renderer, &label, "noise_level = 1.5");
    let flat = renderer.rendered_background.clone();

    let above = PressMetadata { depth_mm: 0.0, ..label };
    let counterpart = renderer.render_counterpart(&above, &real, 0);
    assert_eq!(
        (counterpart.alignment, counterpart.offset_px, counterpart.correlation),
        (Alignment::NoContact, [0.0; 2], 0.0)
    );
    assert!(!counterpart.sample.label.contact.in_contact);

    let counterpart = renderer.render_counterpart(&label, &flat, 0);
    assert_eq!((counterpart.alignment, counterpart.offset_px), (Alignment::Unlike, [0.0; 2]));
    assert_eq!(counterpart.sample.impression.image.rgb, renderer.render_press(&label, 0).impression.image.rgb);

    let mut far = label;
    far.position_mm[0] += 12.0 * renderer.plan.simulator.view().mm_per_px[0];
    let real = photographed(&renderer, &far, "");
    let counterpart = renderer.render_counterpart(&label, &real, 0);
    assert_eq!((counterpart.alignment, counterpart.offset_px), (Alignment::TooFar, [0.0; 2]));
    assert!(counterpart.correlation < 0.9, "{}", counterpart.correlation);
}

#[test]
fn no_search_leaves_the_counterpart_and_tells_how_alike_it_is() {
    let renderer = renderer(Paired { max_offset_px: 0, ..Paired::default() }, "");
    let label = metadata("letter", &renderer);
    let real = photographed(&renderer, &label, "");
    let counterpart = renderer.render_counterpart(&label, &real, 0);
    assert_eq!((counterpart.alignment, counterpart.offset_px), (Alignment::NotSought, [0.0; 2]));
    assert!(counterpart.correlation > 0.999, "{}", counterpart.correlation);
}

#[test]
fn counterparts_have_the_layers_of_any_sample() {
    let renderer = renderer(Paired::default(), "[output]\nlayers = [\"depth\", \"surface\", \"contact\"]\n");
    let label = metadata("sphere", &renderer);
    let counterpart = renderer.render_counterpart(&label, &photographed(&renderer, &label, ""), 0);
    let members = gelsim_dataset::encode::encode_members(&renderer.plan, &counterpart.sample);
    let suffixes: Vec<&str> = members.iter().map(|member| member.suffix.as_str()).collect();
    assert_eq!(suffixes, ["tactile.png", "depth.exr", "surface.exr", "contact.png", "json"]);
    assert!((counterpart.sample.label.indentation_depth_mm - 0.7).abs() < 1e-12);
    assert_eq!(counterpart.sample.label.header.object.class, "sphere");
}
