//! The contact of coarse grids: the mask, a label, against the reference's; a scene against its mirror image.

use gelsim_cli::list::OBJECTS;
use gelsim_core::base::grid::Grid;
use gelsim_core::depth::{self, Depth};
use gelsim_core::fidelity::Fidelity;
use gelsim_core::gelpad::Pad;
use gelsim_job::plan::Plan;
use gelsim_job::scene::Scene;
use gelsim_lab::metrics::image::mask_iou;

use crate::plan::plan;

/// A press of one object, and the pads of the levels `fidelities` that it is pressed into.
struct Presses {
    plan: Plan,
    pads: Vec<Pad>,
}

impl Presses {
    fn new(object: &str, resolution_px: [usize; 2], pose: &str, depth_mm: f64, fidelities: &[Fidelity]) -> Self {
        let plan = plan(&format!(
            "[dataset]\nname = \"a\"\nsamples = 1\n[[object]]\npath = \"objects/{object}.obj\"\n[sensor]\n\
             resolution_px = {resolution_px:?}\n[pose]\n{pose}\n[indentation]\ndepth_mm = {depth_mm}\n"
        ));
        let pad = |level: &Fidelity| {
            let sensor = plan.simulator.sensor();
            let models = level.models(sensor.light_source());
            Pad::new(&models.gelpad, &sensor.gelpad, plan.simulator.view())
        };
        let pads = fidelities.iter().map(pad).collect();
        Self { plan, pads }
    }

    /// The object, captured as high as any bulge gets.
    fn depth(&self, pad: &Pad) -> Depth {
        let scene = Scene::draw(&self.plan, 0, 0);
        let thickness_mm = self.plan.thickness_mm();
        let window = depth::CaptureWindow { above_mm: thickness_mm, ..pad.capture_window(scene.indentation_depth_mm) };
        depth::capture_indenter(&scene.indenter(&self.plan), self.plan.simulator.view(), window, thickness_mm)
    }
}

/// Pixels of the reference's mask, and what another has in common with it.
fn pixels_and_iou(own: &Grid<u8>, exact: &Grid<u8>) -> (usize, f64) {
    let pixels = exact.data.iter().filter(|value| **value == 255).count();
    (pixels, mask_iou(own, exact).unwrap_or(1.0))
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

#[test]
fn the_contact_mask_of_a_coarse_grid_is_the_references() {
    let levels = [Fidelity::Draft, Fidelity::Standard, Fidelity::Reference];
    let resolutions: &[[usize; 2]] = if crate::thorough() { &[[320, 240], [640, 480]] } else { &[[320, 240]] };
    for &resolution_px in resolutions {
        let mut found = [vec![], vec![]];
        for (number, object) in OBJECTS.into_iter().enumerate() {
            for (step, depth_mm) in [0.3, 0.8, 1.2].into_iter().enumerate() {
                let turn = (37 * number + 101 * step) % 360;
                let pose = format!(
                    "yaw_deg = {turn}.0\ntilt_deg = {}\ntilt_azimuth_deg = {}.0\nx_mm = 0.313\ny_mm = -0.227\n",
                    [0.0, 2.5, 5.0][(number + step) % 3],
                    (turn * 7) % 360,
                );
                let presses = Presses::new(object, resolution_px, &pose, depth_mm, &levels);
                let masks: Vec<Grid<u8>> = presses.pads.iter().map(|pad| pad.press(&presses.depth(pad)).mask).collect();
                let shares = [0, 1].map(|level| pixels_and_iou(&masks[level], &masks[2]));
                println!("{resolution_px:?} {object} {depth_mm}: {shares:?}");
                for (found, (pixels, share)) in found.iter_mut().zip(shares) {
                    found.push((pixels, share));
                }
            }
        }
        // Median, and the worst of more than 1000 px: ridges and steps a few pixels wide.
        let least = match resolution_px[0] {
            320 => [(0.97, 0.77), (0.985, 0.84)],
            _ => [(0.985, 0.81), (0.99, 0.91)],
        };
        for ((level, found), least) in ["draft", "standard"].into_iter().zip(found).zip(least) {
            let mut shares: Vec<f64> = found.iter().map(|(_, share)| *share).collect();
            let large = found.iter().filter(|(pixels, _)| *pixels > 1000).map(|(_, share)| *share);
            let worst = large.clone().fold(1.0, f64::min);
            let middle = median(&mut shares);
            println!(
                "{resolution_px:?} {level}: median {middle:.4}, worst of more than 1000 px {worst:.4}, below 0.97: {}, below 0.95: {} of {}",
                large.filter(|share| *share < 0.97).count(),
                shares.iter().filter(|share| **share < 0.95).count(),
                shares.len(),
            );
            assert!(middle > least.0 && worst > least.1, "{level}: {middle}, {worst}");
        }
    }
}

/// Rows of a grid from right to left.
fn mirrored(grid: &Grid<f32>) -> Grid<f32> {
    let data = grid.data.chunks(grid.width).flat_map(|row| row.iter().rev().copied()).collect();
    Grid { data, ..*grid }
}

#[test]
fn a_scene_in_a_mirror_is_the_mirrored_scene() {
    let levels = [Fidelity::Draft, Fidelity::Standard];
    let mut worst = [0.0_f32; 2];
    for resolution_px in [[320, 240], [322, 240], [321, 240]] {
        for object in ["cube", "gear", "letter", "coin", "sphere"] {
            let pose = "yaw_deg = 9.0\ntilt_deg = 1.0\nx_mm = 0.313\ny_mm = -0.227\n";
            let presses = Presses::new(object, resolution_px, pose, 0.6, &levels);
            for (pad, worst) in presses.pads.iter().zip(&mut worst) {
                let depth = presses.depth(pad);
                let mut other = depth.clone();
                other.penetration = mirrored(&depth.penetration);
                other.measure();
                let (own, other) = (pad.press(&depth).surface, mirrored(&pad.press(&other).surface));
                let apart = own.data.iter().zip(&other.data).map(|(a, b)| 1e3 * (a - b).abs()).fold(0.0, f32::max);
                println!("{object}, {resolution_px:?}: {apart:.3} um");
                *worst = worst.max(apart);
            }
        }
    }
    println!("draft and standard: {worst:.3?} um");
    // At low steps of the coin single pixels of the solver stop giving way in the one and not in the other, by rounding.
    assert!(worst[0] < 5.0 && worst[1] < 15.0, "{worst:?}");
}
