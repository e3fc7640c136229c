//! Whole samples against a second pipeline: plain loops in f64, from the mesh to the grey levels.

use std::path::Path;

use gelsim_core::optics::phong::Phong;
use gelsim_core::pose::Placement;
use gelsim_job::plan::Plan;
use gelsim_job::sample::render;
use gelsim_job::scene::Scene;

use super::oracle::Scenery;
use super::support::Shape;
use crate::oracle::shading::brightness;
use crate::plan::plan;

struct Plane {
    width: usize,
    height: usize,
    data: Vec<f64>,
}

impl Plane {
    fn new(width: usize, height: usize, value: impl Fn(usize, usize) -> f64) -> Self {
        let data = (0..width * height).map(|at| value(at % width, at / width)).collect();
        Self { width, height, data }
    }

    /// 0 beyond the border.
    fn at(&self, x: isize, y: isize) -> f64 {
        let inside = x >= 0 && y >= 0 && (x as usize) < self.width && (y as usize) < self.height;
        if inside { self.data[y as usize * self.width + x as usize] } else { 0.0 }
    }

    /// A mean over `kernel` x `kernel` pixels.
    fn mean(&self, kernel: usize) -> Self {
        let half = (kernel / 2) as isize;
        let along = |from: &Self, dx: isize, dy: isize| {
            Self::new(self.width, self.height, |x, y| {
                let sum: f64 = (-half..=half).map(|k| from.at(x as isize + k * dx, y as isize + k * dy)).sum();
                sum / kernel as f64
            })
        };
        along(&along(self, 1, 0), 0, 1)
    }
}

/// The tactile image as red, green, blue before rounding, 255 = full scale.
fn image(plan: &Plan, shape: &Shape, placement: &Placement) -> Vec<[f64; 3]> {
    let [width, height] = plan.simulator.view().resolution_px;
    // More than the blur reaches, 35 px, so that the twin has a border of its own.
    let margin = 50;
    let truth = Scenery::new(shape, placement, plan.simulator.view(), margin);
    let depth = Plane::new(width + 2 * margin, height + 2 * margin, |x, y| {
        (-truth.height(x, y)).clamp(0.0, plan.thickness_mm())
    });
    let blurred = (0..5).fold(Plane { data: depth.data.clone(), ..depth }, |surface, _| surface.mean(15));
    let surface = Plane::new(depth.width, depth.height, |x, y| {
        let at = y * depth.width + x;
        blurred.data[at].max(depth.data[at])
    });
    let constants = Phong::default();
    let mut light = Vec::new();
    for y in 0..height {
        for x in 0..width {
            let here = |dx: isize, dy: isize| surface.at((x + margin) as isize + dx, (y + margin) as isize + dy);
            let [pitch_x, pitch_y] = plan.simulator.view().mm_per_px;
            let slope = [(here(1, 0) - here(-1, 0)) / (2.0 * pitch_x), (here(0, 1) - here(0, -1)) / (2.0 * pitch_y)];
            let rest =
                std::array::from_fn(|k| f64::from(plan.simulator.background().rgb[(y * width + x) * 3 + k]) / 255.0);
            let light_here = brightness(slope, here(0, 0), &plan.job().sensor, &constants, rest);
            light.push(light_here.map(|value| (value * 255.0).clamp(0.0, 255.0)));
        }
    }
    light
}

#[test]
fn f32_stages_give_the_grey_levels_of_the_plain_f64_pipeline() {
    for (object, depth_mm) in [("sphere", 1.1), ("gear", 0.7), ("crossed_ridges", 0.45)] {
        let plan = plan(&format!(
            "fidelity = \"paper\"\n[dataset]\nname = \"a\"\nsamples = 10\n[[object]]\npath = \"objects/{object}.obj\"\n[sensor]\n\
             resolution_px = [96, 72]\nfield_of_view_mm = [18.0, 14.0]\n[pose]\nyaw_deg = [0.0, 360.0]\n\
             tilt_deg = [2.0, 6.0]\nx_mm = [-3.0, 3.0]\ny_mm = [-3.0, 3.0]\n[indentation]\ndepth_mm = {depth_mm:?}\n"
        ));
        let shape = Shape::bundled(&Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("objects/{object}.obj")));
        for index in [0, 7] {
            let sample = render(&plan, index);
            let expected = image(&plan, &shape, &Scene::draw(&plan, index, 0).pose.placement());
            let (mut rounded_otherwise, mut changed, mut worst) = (0, 0, 0.0_f64);
            for (at, expected) in expected.iter().enumerate() {
                let rgb = at * 3..at * 3 + 3;
                let rest = &plan.simulator.background().rgb[rgb.clone()];
                for ((found, rest), expected) in sample.impression.image.rgb[rgb].iter().zip(rest).zip(expected) {
                    let off = (f64::from(*found) - expected).abs();
                    worst = worst.max(off);
                    rounded_otherwise += usize::from(off > 0.5);
                    changed += usize::from(found != rest);
                }
            }
            // The right level but for brightnesses that lie within 0.01 of the middle between two.
            assert!(changed > 2000, "{object} {index}: the press changes only {changed} values");
            assert!(rounded_otherwise <= 20, "{object} {index}: {rounded_otherwise} of 20736 values");
            assert!(worst < 0.51, "{object} {index}: {worst} grey levels");
        }
    }
}
