//! The levels of the accuracy ladder on the bundled objects.

use gelsim_cli::list::OBJECTS;
use gelsim_core::fidelity::Fidelity;
use gelsim_job::config::fidelity::FidelityChoice;
use gelsim_job::sample::Sample;
use gelsim_job::sample::render;
use gelsim_lab::metrics::image::mae;
use gelsim_lab::metrics::surface::height_error_um;
use gelsim_lab::tradeoff::choose::choose_level;

use crate::plan::plan;
use crate::thorough;

/// The levels of linear theory, from cheap to exact.
fn linear_levels() -> impl Iterator<Item = Fidelity> {
    Fidelity::ALL.into_iter().filter(|level| *level != Fidelity::FiniteStrain)
}

/// One press of a bundled object at every level of linear theory, from cheap to exact.
fn at_every_level(object: &str) -> Vec<Sample> {
    let plan = plan(&format!(
        "[dataset]\nname = \"a\"\nsamples = 1\n[[object]]\npath = \"objects/{object}.obj\"\n[sensor]\n\
         resolution_px = [320, 240]\n[pose]\nyaw_deg = 17.0\ntilt_deg = 1.5\ntilt_azimuth_deg = 40.0\nx_mm = 0.3\n\
         y_mm = -0.2\n[indentation]\ndepth_mm = 0.8\n"
    ));
    linear_levels().map(|level| render(&plan.with_fidelity(level), 0)).collect()
}

#[test]
fn every_linear_level_is_nearer_to_the_reference_than_the_one_before_on_every_bundled_object() {
    for object in OBJECTS.into_iter().filter(|name| !name.ends_with("slab")) {
        let samples = at_every_level(object);
        let (exact, others) = samples.split_last().expect("there are levels");
        let heights: Vec<f64> = others
            .iter()
            .map(|sample| height_error_um(&sample.impression.contact.surface, &exact.impression.contact.surface).0)
            .collect();
        let images: Vec<f64> =
            others.iter().map(|sample| mae(&sample.impression.image.rgb, &exact.impression.image.rgb)).collect();
        for (name, errors) in [("height", &heights), ("image", &images)] {
            assert!(errors.windows(2).all(|pair| pair[1] < pair[0]), "{object}: {name} errors {errors:?}");
        }
        // 1 um of tolerance at the level before the reference.
        assert!(heights[3] < 1.0, "{object}: {heights:?}");
    }
}

#[test]
fn every_level_but_the_blur_says_how_well_it_solved_the_contact() {
    for object in ["sphere", "gear", "knurl"] {
        for (level, sample) in linear_levels().zip(at_every_level(object)) {
            let label = &sample.label;
            assert_eq!(label.models.fidelity, level.name());
            assert!(label.numerics.converged && label.health.finite, "{object} {level:?}");
            let tolerance_um = match level {
                Fidelity::Paper => {
                    assert_eq!((label.numerics.residual_um, label.contact.force_n), (None, None));
                    continue;
                }
                Fidelity::Draft => 3.0,
                Fidelity::Standard | Fidelity::High => 1.0,
                Fidelity::Reference => 0.05,
                Fidelity::FiniteStrain => unreachable!("not linear"),
            };
            // Outside the box in which the contact is solved twice the tolerance is accepted.
            let residual_um = label.numerics.residual_um.expect("the elastic pad knows it");
            assert!(residual_um <= 2.0 * tolerance_um, "{object} {level:?}: {residual_um}");
            assert!(
                label.numerics.iterations > 0 && label.contact.force_n > Some(0.0),
                "{object} {level:?}: {:?}, {:?}",
                label.numerics,
                label.contact
            );
            // A ball's edge is gentle, a gear's a long wall; what follows from either is 0.8 mm deep.
            let expected_um = if object == "sphere" { 2.0..30.0 } else { 30.0..500.0 };
            let model_error_um = label.numerics.model_error_um.expect("the elastic pad knows it");
            assert!(expected_um.contains(&model_error_um), "{object} {level:?}: {model_error_um}");
        }
    }
}

/// The main job on a quarter of its pixels: at most 1 % of its samples, rendered for the choice or not, are further from
/// the reference than the bound.
#[test]
fn a_bound_holds_for_samples_that_were_not_rendered_to_choose() {
    let job = include_str!("../../configs/quickstart.toml").replace("../objects/", "objects/")
        + "\n[sensor]\nresolution_px = [320, 240]\n";
    let plan = plan(&job);
    let bounds: &[f64] = if thorough() { &[0.3, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0, 20.0, 120.0] } else { &[10.0] };
    let count = if thorough() { 200 } else { 100 };
    for bound in bounds {
        let chosen =
            choose_level(&plan, FidelityChoice::MaxErrorUm(*bound)).unwrap_or_else(|report| panic!("{report}"));
        let (own, exact) = (plan.with_fidelity(chosen.level), plan.with_fidelity(Fidelity::Reference));
        let surface = |plan, index| render(plan, index).impression.contact.surface;
        let errors: Vec<f64> =
            (0..count).map(|index| height_error_um(&surface(&own, index), &surface(&exact, index)).0).collect();
        let beyond = errors.iter().filter(|um| *um > bound).count();
        println!("{bound} um: {chosen}; {beyond} of {count} beyond");
        assert!(100 * beyond <= count as usize, "{bound} um: {chosen}; {beyond} beyond: {errors:?}");
        assert!(chosen.share_beyond <= 0.01 && chosen.probes < 40, "{chosen:?}");
    }
}
