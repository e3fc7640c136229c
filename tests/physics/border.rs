//! Objects that the view's border cuts off: what the pad needs to know of them beyond it.

use super::rig::{NOTHING, Named, Rig, Setup, ball};
use gelsim_core::base::grid::Resolution;

/// Objects that cross the border, and what is the worst for it: edges and points just outside, plates that go on.
const CROSSING: [Named; 7] = [
    ("cylinder across", |x, y| 0.6 - (y - 0.3 * x).powi(2) / 5.0),
    ("large ball", |x, y| ball(40.0, 1.0, x + 3.0, y)),
    ("tilted plate", |x, y| 0.3 + 0.03 * x + 0.02 * y),
    ("plate", |_, _| 0.3),
    ("ball half out", |x, y| ball(3.0, 0.8, x - 6.0, y)),
    ("block from outside", |x, y| if x > 4.0 && y.abs() < 2.0 { 0.4 } else { NOTHING }),
    ("ridge just outside", |x, _| if x > 6.2 && x < 7.0 { 0.5 } else { NOTHING }),
];

/// Largest error in view, um, and of the force, relative, if the object is captured to `margins` thicknesses around the
/// view, against all of it.
fn errors(rig: &Rig, object: fn(f64, f64) -> f64, view_mm: [f64; 2], margins: &[f64]) -> Vec<[f64; 2]> {
    let Setup { mm_per_px: [pitch, _], resolution_px, thickness_mm, .. } = rig.setup;
    let inside =
        |x: f64, y: f64, beyond: f64| x.abs() <= view_mm[0] / 2.0 + beyond && y.abs() <= view_mm[1] / 2.0 + beyond;
    let press = |margin: f64| {
        let contact = rig.press(|x, y| if inside(x, y, margin * thickness_mm) { object(x, y) } else { NOTHING });
        assert!(contact.numerics.converged, "{:?}", contact.numerics);
        contact
    };
    let place = |k: usize, at: usize| (at as f64 + 0.5 - resolution_px[k] as f64 / 2.0) * pitch;
    let all = press(f64::INFINITY);
    let compare = |margin: &f64| {
        let cut = press(*margin);
        let (mut worst, mut forces) = (0.0_f64, [0.0; 2]);
        for y in 0..resolution_px[1] {
            for x in 0..resolution_px[0] {
                if inside(place(0, x), place(1, y), 0.0) {
                    let away = cut.surface.at(x + 1, y + 1) - all.surface.at(x + 1, y + 1);
                    worst = worst.max(1e3 * f64::from(away).abs());
                    for (force, contact) in forces.iter_mut().zip([&cut, &all]) {
                        *force += contact.pressure.as_ref().map_or(0.0, |p| f64::from(p.at(x, y)));
                    }
                }
            }
        }

        [worst, if forces[1] > 0.0 { forces[0] / forces[1] - 1.0 } else { 0.0 }]
    };
    margins.iter().map(compare).collect()
}

#[test]
fn what_lies_beyond_the_captured_margin_hardly_moves_the_surface_in_view() {
    // A view of 12 x 9 mm on a pad of 3 mm, out of one with 4 thicknesses more on every side.
    let view_mm = [12.0, 9.0];
    let setup =
        |poisson_ratio| Setup { resolution_px: [180, 165], mm_per_px: [0.2; 2], poisson_ratio, ..Setup::default() };
    for nu in [0.3, 0.48, 0.4999] {
        let rig = setup(nu).solved(Resolution::Full, 0.2).rig();
        // What a pad captures of its own accord.
        let own = rig.margin_px() as f64 * 0.2 / 3.0;
        let margins = [0.0, 0.5, 1.0, own, 2.0, 3.0];
        for (name, object) in CROSSING {
            let found = errors(&rig, object, view_mm, &margins);
            let text: Vec<String> = margins
                .iter()
                .zip(&found)
                .map(|(margin, [um, force])| format!("{margin:.2} h: {um:.2} um, force {force:+.1e}"))
                .collect();
            println!("border, nu {nu}, {name}: {}", text.join("; "));
            // What a false edge does 1.5 thicknesses away, next to an edge that is true: of 300 to 1000 um of depth.
            assert!(found[3][0] < 30.0, "nu {nu}, {name}: {found:?}");
            assert!(found[5][0] < found[0][0].max(1.0), "nu {nu}, {name}: more margin must do better: {found:?}");
        }
    }
}
