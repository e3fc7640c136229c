//! Samples against the reference pipeline in f64, from the mesh to the grey levels.

use gelsim_core::base::view::SURFACE_BORDER;
use gelsim_job::sample::render;

use crate::plan::plan;
use gelsim_oracle::pipeline_f64::{blurred, light_of, penetration};

/// More than the blur reaches, 35 px, so that the reference has a border of its own.
const MARGIN: usize = 50;

#[test]
fn f32_stages_give_the_grey_levels_of_the_plain_f64_pipeline() {
    let samples: &[u64] = if crate::thorough() { &[0, 7] } else { &[7] };
    for (object, depth_mm) in [("sphere", 1.1), ("gear", 0.7), ("crossed_ridges", 0.45)] {
        let plan = plan(&format!(
            "fidelity = 'paper'\ndataset = {{ name = 'a', samples = 10 }}\nobject = [{{ path = 'objects/{object}.obj' }}]\n\
             sensor = {{ resolution_px = [96, 72], field_of_view_mm = [18.0, 14.0] }}\n[pose]\nyaw_deg = [0.0, 360.0]\n\
             tilt_deg = [2.0, 6.0]\nx_mm = [-3.0, 3.0]\ny_mm = [-3.0, 3.0]\n[indentation]\ndepth_mm = {depth_mm:?}\n"
        ));
        for &index in samples {
            let found = &render(&plan, index).impression.image.rgb;
            let surface = blurred(&penetration(&plan, object, index, MARGIN)).inner(MARGIN - SURFACE_BORDER);
            let expected = light_of(&surface, &plan);
            assert_eq!(found.len(), expected.len());
            let off = found.iter().zip(&expected).map(|(a, b)| (f64::from(*a) - b.clamp(0.0, 255.0)).abs());
            let (rounded_otherwise, worst) = (off.clone().filter(|off| *off > 0.5).count(), off.fold(0.0, f64::max));
            let changed =
                found.iter().zip(&plan.simulator.background().rgb).filter(|(found, rest)| found != rest).count();
            // The right level but for brightnesses that lie within 0.01 of the middle between two.
            assert!(changed > 2000, "{object} {index}: the press changes only {changed} values");
            assert!(rounded_otherwise <= 20, "{object} {index}: {rounded_otherwise} of 20736 values");
            assert!(worst < 0.51, "{object} {index}: {worst} grey levels");
        }
    }
}
