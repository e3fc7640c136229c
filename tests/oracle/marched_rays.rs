//! Cast shadows by rays marched in f64.

use gelsim_core::base::grid::Grid;
use gelsim_core::base::view::SURFACE_BORDER;

/// A distant LED and the pixels under it.
#[derive(Clone, Copy, Debug)]
pub struct Led {
    /// Degrees.
    pub azimuth: f64,
    /// Of its middle, degrees.
    pub elevation: f64,
    /// Both ways, degrees.
    pub size: f64,
    /// mm from pixel to pixel.
    pub pitch: [f64; 2],
}

impl Led {
    /// Tangents of the elevations of its lower and its upper edge.
    pub fn slopes(self) -> [f64; 2] {
        [-0.5, 0.5].map(|side| (self.elevation + side * self.size).to_radians().tan())
    }
}

/// The surface between pixel centres, or nothing beyond the outermost ones.
fn height_at(surface: &Grid<f32>, x: f64, y: f64) -> Option<f64> {
    let (right, bottom) = (surface.width as f64 - 1.0, surface.height as f64 - 1.0);
    if !(0.0..=right).contains(&x) || !(0.0..=bottom).contains(&y) {
        return None;
    }
    let (x0, y0) = (x.min(right - 1.0).floor(), y.min(bottom - 1.0).floor());
    let at = |dx: usize, dy: usize| f64::from(surface.at(x0 as usize + dx, y0 as usize + dy));
    let (fx, fy) = (x - x0, y - y0);
    let above = at(0, 0) * (1.0 - fx) + at(1, 0) * fx;
    let below = at(0, 1) * (1.0 - fx) + at(1, 1) * fx;
    Some(above * (1.0 - fy) + below * fy)
}

/// Half the width of an LED, in which rays are marched side by side, and how much each of them counts: as much as a disc
/// is high there.
fn disc() -> impl Iterator<Item = (f64, f64)> {
    (-4..=4).map(|k| f64::from(k) / 4.5).map(|aside| (aside, (1.0 - aside * aside).sqrt()))
}

/// What each pixel of the view sees of the LED, 0 to 1: the share of it over the horizon. Rays find the horizon by small
/// steps.
pub fn marched_shares(led: Led, surface: &Grid<f32>) -> Grid<f64> {
    let mm = 0.5 * led.pitch[0].min(led.pitch[1]);
    let [lowest, highest] = led.slopes();
    let mut found = Grid::<f64>::new(surface.width - 2 * SURFACE_BORDER, surface.height - 2 * SURFACE_BORDER);
    let whole: f64 = disc().map(|(_, weight)| weight).sum();
    for (aside, weight) in disc() {
        let (sin, cos) = (led.azimuth + 0.5 * aside * led.size).to_radians().sin_cos();
        for y in 0..found.height {
            for x in 0..found.width {
                let (x0, y0) = ((x + SURFACE_BORDER) as f64, (y + SURFACE_BORDER) as f64);
                let here = f64::from(surface.at(x + SURFACE_BORDER, y + SURFACE_BORDER));
                let ray = (1..).map(|k| f64::from(k) * mm);
                let rises = ray.map_while(|d| {
                    let there = height_at(surface, x0 + d * cos / led.pitch[0], y0 + d * sin / led.pitch[1])?;
                    Some((there - here) / d)
                });
                let horizon = rises.fold(f64::NEG_INFINITY, f64::max);
                let share = ((highest - horizon) / (highest - lowest)).clamp(0.0, 1.0);
                found.row_mut(y)[x] += share * weight / whole;
            }
        }
    }
    found
}
