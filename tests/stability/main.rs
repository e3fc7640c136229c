//! Hard cases: whatever the input, a sample is finite, bounded, steady and explained, or it is refused with a reason.
//!
//! Named cases stand in tables by group (`contact`, `geometry`, `light`, `texture`); `corners` puts ends of ranges together
//! at random. `case` makes a job of one as a user would write it, plain and with every effect on; `shapes` makes meshes;
//! `sound` holds what must be true of a sample.
//!
//! `press` makes jobs whose numbers a test moves one at a time: `continuity` moves them by a millionth, `sweeps` through the
//! places where the code changes its way of working. `symmetry` turns and mirrors whole samples; `twin` makes them a second
//! time, in f64, and `stages` each stage from the one before; `properties` draws random jobs.
//!
//! What was found stands in docs/stability.md, whose figures `cargo test --release --test stability -- --nocapture` prints.

mod case;
mod contact;
mod continuity;
mod corners;
#[path = "../oracle/dense_contact.rs"]
mod dense_contact;
mod geometry;
#[path = "../effects/jobs.rs"]
mod jobs;
mod light;
#[path = "../physics/plan.rs"]
mod plan;
mod press;
#[path = "../oracle/pressed_pixel.rs"]
mod pressed_pixel;
mod properties;
#[path = "../oracle/shading.rs"]
mod shading;
mod shapes;
mod sound;
mod stages;
mod sweeps;
mod symmetry;
mod texture;
mod twin;

use case::{Case, Dress};

/// Every case of every group.
fn all() -> Vec<Case> {
    [contact::cases(), contact::grids(), geometry::cases(), light::cases(), texture::cases()]
        .into_iter()
        .flatten()
        .collect()
}

#[test]
fn every_case_stands_in_the_docs_once() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/stability.md");
    let docs = std::fs::read_to_string(path).expect("the repository has docs/stability.md");
    for case in all() {
        let row = format!("| {} |", case.name);
        assert_eq!(
            docs.matches(&row).count(),
            1,
            "docs/stability.md has no row, or more than one, for `{}`",
            case.name
        );
    }
}

#[test]
fn every_effect_is_on_in_the_dressed_samples() {
    for dress in [Dress::Still, Dress::Noisy] {
        let plan = Case::new("dressed", "").depth(1.0).plan(dress).expect("a plain job");
        let label = gelsim::render::render(&plan, 0).label;
        let off: Vec<_> = label.effects.iter().filter(|(_, note)| !note.ran).map(|(effect, _)| effect.name()).collect();
        let expected: &[&str] = if dress == Dress::Still { &["noise"] } else { &[] };
        assert_eq!(off, expected, "{dress:?}");
    }
}
