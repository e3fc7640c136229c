//! The force of the object on the pad, by area, at the pixels of a view.
//!
//! Friction is solved on a grid of its own, which turns with the object and is coarser than the camera's. Each of its
//! pixels is spread by a hat function over the pixels of the view around it. Force and first moment stay exactly the
//! same. All components have the same weights, so a traction within a limit stays within it.

use super::elastic::in_plane::TractionField;
use super::planar::PlanarFrame;
use crate::base::grid::Grid;
use crate::base::view::View;

/// Most points along a side into which half a hat is divided.
const MOST_PARTS: f64 = 8.0;

/// Tractions and pressure on the grid on which they were solved for.
#[derive(Clone, Debug)]
pub struct TractionMap {
    /// Tractions along the frame's x and y, and pressure into the pad, over Young's modulus.
    components: [Grid<f32>; 3],
    /// Centre of the first pixel in the frame, mm.
    origin_mm: [f64; 2],
    mm_per_px: [f64; 2],
    frame: PlanarFrame,
    youngs_modulus_kpa: f64,
}

impl TractionMap {
    /// Makes a map from tractions and the pressure on the same pixels, both along the axes of a frame.
    pub(crate) fn new(
        tractions: TractionField,
        pressure: Grid<f32>,
        frame: PlanarFrame,
        youngs_modulus_kpa: f64,
    ) -> Self {
        let TractionField { x, y, origin_mm, mm_per_px } = tractions;
        Self { components: [x, y, pressure], origin_mm, mm_per_px, frame, youngs_modulus_kpa }
    }

    /// Returns the tractions at the pixel centres of a view, kPa: along x and y of the view's frame, and into the pad,
    /// these multiplied by a factor.
    pub(crate) fn sample_view(&self, view: &View, into: f64) -> [Grid<f32>; 3] {
        let [width, height] = view.resolution_px;
        let finest_mm = view.mm_per_px[0].min(view.mm_per_px[1]);
        let axes = self.frame.axes();
        // The points of a hat: offsets along the view's axes, px, and shares of the force.
        let along_axis = |k: usize| {
            let parts = libm::ceil(2.0 * self.mm_per_px[k] / finest_mm).clamp(1.0, MOST_PARTS);
            let at = move |j: usize| (j as f64 + 0.5) / parts - 1.0;
            let spacing_mm = self.mm_per_px[k];
            let hats: f64 = (0..2 * parts as usize).map(|j| 1.0 - at(j).abs()).sum();
            (0..2 * parts as usize).map(move |j| (at(j) * spacing_mm, (1.0 - at(j).abs()) / hats))
        };
        let points: Vec<([f64; 2], f64)> = along_axis(1)
            .flat_map(|(y, down)| along_axis(0).map(move |(x, share)| ([x, y], share * down)))
            .map(|(offset, share)| {
                let [x, y] = axes.direction_to_sensor(offset);
                ([x / view.mm_per_px[0], y / view.mm_per_px[1]], share)
            })
            .collect();
        let kpa =
            self.youngs_modulus_kpa * self.mm_per_px[0] * self.mm_per_px[1] / (view.mm_per_px[0] * view.mm_per_px[1]);
        let mut planes = [(); 3].map(|()| vec![0.0_f64; width * height]);
        let [x_part, y_part, z_part] = &self.components;
        for row in 0..z_part.height {
            for column in 0..z_part.width {
                let values = [x_part, y_part, z_part].map(|part| f64::from(part.at(column, row)));
                if values == [0.0; 3] {
                    continue;
                }
                let place = [column, row].map(|at| at as f64);
                let place = axes.to_sensor([0, 1].map(|k| self.origin_mm[k] + place[k] * self.mm_per_px[k]));
                let centre_px = view.point_px(place);
                let [x, y] = axes.direction_to_sensor([values[0], values[1]]);
                let force = [kpa * x, kpa * y, into * kpa * values[2]];
                for ([dx, dy], share) in &points {
                    let [x, y] = [centre_px[0] + dx - 0.5, centre_px[1] + dy - 0.5];
                    let (left, top) = (libm::floor(x), libm::floor(y));
                    let (right_share, lower_share) = (x - left, y - top);
                    for (down, weight_y) in [(0.0, 1.0 - lower_share), (1.0, lower_share)] {
                        for (aside, weight_x) in [(0.0, 1.0 - right_share), (1.0, right_share)] {
                            let at = [left + aside, top + down];
                            let [size_x, size_y] = [width as f64, height as f64];
                            if (0.0..size_x).contains(&at[0]) && (0.0..size_y).contains(&at[1]) {
                                let at = at[1] as usize * width + at[0] as usize;
                                let weight = share * weight_x * weight_y;
                                planes.iter_mut().zip(force).for_each(|(plane, part)| plane[at] += weight * part);
                            }
                        }
                    }
                }
            }
        }
        planes.map(|plane| Grid { width, height, data: plane.into_iter().map(|kpa| kpa as f32).collect() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn force_and_moment_stay_as_they_are_and_limits_hold() {
        let (width, height) = (9, 7);
        let value = |k: usize, scale: f64| (scale * libm::sin(k as f64 * 1.7 + scale)) as f32;
        let pressure: Vec<f32> = (0..width * height).map(|k| value(k, 0.3).abs()).collect();
        let limited = |k: usize, part: f64| (0.5 * f64::from(pressure[k]) * part) as f32;
        let turn = |k: usize| libm::sincos(k as f64 * 0.9);
        let grid = |data: Vec<f32>| Grid { width, height, data };
        let tractions = TractionField {
            x: grid((0..width * height).map(|k| limited(k, turn(k).1)).collect()),
            y: grid((0..width * height).map(|k| limited(k, turn(k).0)).collect()),
            origin_mm: [-0.7, -0.5],
            mm_per_px: [0.11, 0.13],
        };
        let frame = PlanarFrame { origin_mm: [0.2, -0.1], angle_rad: 0.7 };
        let map = TractionMap::new(tractions.clone(), grid(pressure.clone()), frame, 100.0);
        for pixel in [0.125, 0.05, 0.013] {
            let view = View { resolution_px: [(4.0 / pixel) as usize, (3.0 / pixel) as usize], mm_per_px: [pixel; 2] };
            let planes = map.sample_view(&view, 1.0);
            let mut found = [0.0; 9];
            for y in 0..planes[0].height {
                for x in 0..planes[0].width {
                    let place = view.point_mm([x as f64 + 0.5, y as f64 + 0.5]);
                    let t = planes.each_ref().map(|plane| f64::from(plane.at(x, y)));
                    assert!(libm::hypot(t[0], t[1]) <= 0.5 * t[2] * (1.0 + 1e-6), "{t:?}");
                    for k in 0..3 {
                        found[k] += t[k] * pixel * pixel;
                        found[3 + k] += t[k] * place[0] * pixel * pixel;
                        found[6 + k] += t[k] * place[1] * pixel * pixel;
                    }
                }
            }
            let mut exact = [0.0; 9];
            for (k, p) in pressure.iter().enumerate() {
                let mm = [(k % width) as f64 * 0.11 - 0.7, (k / width) as f64 * 0.13 - 0.5];
                let place = frame.axes().to_sensor(mm);
                let [x, y] =
                    frame.axes().direction_to_sensor([f64::from(tractions.x.data[k]), f64::from(tractions.y.data[k])]);
                for (k, t) in [x, y, f64::from(*p)].into_iter().enumerate() {
                    let force = 100.0 * t * 0.11 * 0.13;
                    exact[k] += force;
                    exact[3 + k] += force * place[0];
                    exact[6 + k] += force * place[1];
                }
            }
            let largest = exact.iter().fold(0.0_f64, |most, sum| most.max(sum.abs()));
            for (found, exact) in found.iter().zip(exact) {
                assert!((found - exact).abs() < 1e-6 * largest, "{pixel}: {found} {exact}");
            }
        }
    }
}
