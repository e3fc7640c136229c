use std::path::Path;

use super::*;
use crate::augment::photometric::noise::Level;
use crate::augment::photometric::{Photometric, Recipe, Taken};
use crate::config::diagnostic::Problems;
use crate::config::{self, Overrides};

fn pairing(settings: Paired, more: &str) -> Pairing {
    let text = format!(
        "[dataset]\nname = \"pairs\"\nsamples = 1\nseed = 11\n[sensor]\nresolution_px = [160, 120]\n\
         [indentation]\ndepth_mm = 1.0\n[[object]]\npath = \"objects/sphere.obj\"\n[[object]]\n\
         path = \"objects/letter.obj\"\n{more}"
    );
    let mut problems = Problems::default();
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let written = config::read_text("job", text, folder, &Overrides::default(), &mut problems);
    let plan = Plan::resolve(written, problems).unwrap_or_else(|report| panic!("{report}"));
    let background = picture(&plan.ready.body.untouched);
    Pairing::new(plan, settings, background)
}

fn known(object: &str, pairing: &Pairing) -> Known {
    let object = pairing.plan.objects.iter().position(|found| found.class == object).expect("it is bundled");
    let angles = Angles { yaw_deg: 25.0, tilt_deg: 0.0, tilt_azimuth_deg: 0.0 };
    Known { object, turn: Turn::Angles(angles), position_mm: [1.0, -0.5], depth_mm: 0.7 }
}

/// A "real" image of the press at `known`, as another lamp and a noisy camera would have shown it.
fn photographed(pairing: &Pairing, known: &Known, recipe: &str) -> RgbImage {
    let sample = pairing.render(known, 4);
    let laws: Photometric = toml::from_str(recipe).expect("a table");
    let taken = Taken {
        sensor: pairing.plan.job.sensor.clone(),
        view: pairing.plan.camera,
        background: None,
        noise: Some(Level { read_levels: 2.0, shot_levels: 0.0 }),
    };
    picture(&Recipe::new(laws, &taken, Vec::new()).apply(&picture(&sample.image), 3, 1).0)
}

#[test]
fn a_shift_under_other_lamps_and_noise_is_found_within_a_fifth_of_a_pixel_and_the_twin_is_rendered_there() {
    let pairing = pairing(Paired::default(), "");
    let recipe = "led_gain = [0.8, 1.25]\nexposure_ev = -0.1\nnoise_level = 2.0";
    for object in ["sphere", "letter"] {
        for shift_px in [[3.4, -2.2], [0.0, 0.0], [-11.7, 9.3]] {
            let label = known(object, &pairing);
            let pitch = pairing.plan.camera.mm_per_px;
            let mut place = label;
            (0..2).for_each(|k| place.position_mm[k] += shift_px[k] * pitch[k]);
            let real = photographed(&pairing, &place, recipe);
            let twin = pairing.twin(&label, &real, 9);
            assert_eq!(twin.alignment, Alignment::Aligned);
            for k in 0..2 {
                let error = twin.offset_px[k] - shift_px[k];
                assert!(error.abs() < 0.2, "{object} {shift_px:?}: {:?}", twin.offset_px);
                let moved_mm = twin.known.position_mm[k] - label.position_mm[k];
                assert!((moved_mm - twin.offset_px[k] * pitch[k]).abs() < 1e-12);
            }
            assert!(twin.correlation > 0.8, "{object} {shift_px:?}: {}", twin.correlation);
            // Rendered there, not moved there: byte for byte what the simulator gives for that place.
            assert_eq!(twin.sample.image.rgb, pairing.render(&twin.known, 9).image.rgb);
        }
    }
}

#[test]
fn without_contact_or_likeness_or_within_reach_a_twin_stays_where_its_label_says() {
    let pairing = pairing(Paired { max_offset_px: 6, ..Paired::default() }, "");
    let label = known("sphere", &pairing);
    let real = photographed(&pairing, &label, "noise_level = 1.5");
    let flat = pairing.untouched.clone();

    let above = Known { depth_mm: 0.0, ..label };
    let twin = pairing.twin(&above, &real, 0);
    assert_eq!((twin.alignment, twin.offset_px, twin.correlation), (Alignment::NoContact, [0.0; 2], 0.0));
    assert!(!twin.sample.label.contact.in_contact);

    let twin = pairing.twin(&label, &flat, 0);
    assert_eq!((twin.alignment, twin.offset_px), (Alignment::Unlike, [0.0; 2]));
    assert_eq!(twin.sample.image.rgb, pairing.render(&label, 0).image.rgb);

    let mut far = label;
    far.position_mm[0] += 12.0 * pairing.plan.camera.mm_per_px[0];
    let real = photographed(&pairing, &far, "");
    let twin = pairing.twin(&label, &real, 0);
    assert_eq!((twin.alignment, twin.offset_px), (Alignment::TooFar, [0.0; 2]));
    assert!(twin.correlation < 0.9, "{}", twin.correlation);
}

#[test]
fn no_search_leaves_the_twin_and_tells_how_alike_it_is() {
    let pairing = pairing(Paired { max_offset_px: 0, ..Paired::default() }, "");
    let label = known("letter", &pairing);
    let real = photographed(&pairing, &label, "");
    let twin = pairing.twin(&label, &real, 0);
    assert_eq!((twin.alignment, twin.offset_px), (Alignment::NotSought, [0.0; 2]));
    assert!(twin.correlation > 0.999, "{}", twin.correlation);
}

#[test]
fn twins_have_the_layers_of_any_sample() {
    let pairing = pairing(Paired::default(), "[output]\nlayers = [\"depth\", \"surface\", \"contact\"]\n");
    let label = known("sphere", &pairing);
    let twin = pairing.twin(&label, &photographed(&pairing, &label, ""), 0);
    let members = crate::dataset::encode::members(&pairing.plan, &twin.sample);
    let suffixes: Vec<&str> = members.iter().map(|member| member.suffix.as_str()).collect();
    assert_eq!(suffixes, ["tactile.png", "depth.exr", "surface.exr", "contact.png", "json"]);
    assert!((twin.sample.label.indentation_depth_mm - 0.7).abs() < 1e-12);
    assert_eq!(twin.sample.label.object.class, "sphere");
}
