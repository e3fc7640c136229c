//! Hard cases: whatever the input, a sample is finite, bounded, steady and explained, or it is refused with a reason.
//!
//! Named cases stand in tables by group (`contact`, `geometry`, `light`, `texture`); `corners` puts ends of ranges together
//! at random. `case` makes a job of one as a user would write it, plain and with every effect on; `sound` holds what
//! must be true of a sample.
//!
//! `press` makes jobs whose numbers a test moves one at a time: `continuity` moves them by a millionth, `sweeps` through the
//! places where the code changes its way of working. `symmetry` turns and mirrors samples; `pipeline` compares them with
//! the reference pipeline in f64, and `stages` each stage with what follows from the one before; `properties` draws
//! random jobs. `curved` holds the hard cases of gels that are not flat, `finite_strain` those of
//! pads at finite strain.
//!
//! What was found stands in docs/evidence/stability.md and docs/evidence/stability-cases.md. The figures are printed by
//! `cargo test --release --test library stability -- --nocapture`.

mod case;
mod contact;
mod continuity;
mod corners;
mod curved;
mod finite_strain;
mod geometry;
mod light;
mod pipeline;
mod press;
mod properties;
mod sound;
mod stages;
mod sweeps;
mod symmetry;
mod texture;

use case::{Case, Dress};

/// Every case of every group.
fn all() -> impl Iterator<Item = &'static Case> {
    [&contact::CASES, &contact::GRIDS, &geometry::CASES, &light::CASES, &texture::CASES]
        .into_iter()
        .flat_map(|cases| cases.iter())
}

#[test]
fn every_case_stands_in_the_docs_once() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/evidence/stability-cases.md");
    let page = std::fs::read_to_string(path).unwrap_or_else(|error| panic!("{path}: {error}"));
    for case in all() {
        let row = format!("| {} |", case.name);
        assert_eq!(page.matches(&row).count(), 1, "{path} has no row, or more than one, for `{}`", case.name);
    }
}

#[test]
fn every_effect_is_on_in_the_dressed_samples() {
    for dress in [Dress::Still, Dress::Noisy] {
        let plan = Case::new("dressed", "").depth(1.0).plan(dress).expect("a plain job");
        let label = gelsim_job::sample::render(&plan, 0).label;
        let off: Vec<_> = label.effects.iter().filter(|(_, note)| !note.ran).map(|(effect, _)| effect.name()).collect();
        // Friction while pressing and finite strain are choices of the gelpad's model, which a case leaves to the level. Pads relax
        // in sequences.
        // So are near LEDs a choice of the light's.
        let of_model = ["friction", "relaxation", "finite_strain", "mirror", "bounce"];
        let of_camera: &[&str] = if dress == Dress::Still { &["speckle", "noise"] } else { &[] };
        assert_eq!(off, [&of_model[..], of_camera].concat(), "{dress:?}");
    }
}
