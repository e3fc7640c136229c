//! A camera inside a curved gel: which point of the gel a pixel shows, and which pixel shows a point.

use std::sync::OnceLock;

use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};

use crate::core::base::gel::{Chart, GelShape};
use crate::core::base::grid::{Grid, Rect, bounding_box};
use crate::core::base::view::View;

/// How the camera's lens takes directions to the image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "datasets", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum LensModel {
    /// From straight below, without perspective: the image shows the field of view.
    #[default]
    Orthographic,
    /// Straight lines stay straight.
    Pinhole(Pinhole),
    /// Kannala and Brandt (2006): the distance from the image's middle is f (a + k1 a^3 + k2 a^5 + k3 a^7 + k4 a^9), a being
    /// the angle to the axis.
    Fisheye(Fisheye),
}

/// See [`LensModel::Pinhole`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "datasets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Pinhole {
    /// Angle across the width of the image, degrees, 1 to 170.
    pub fov_deg: f64,
    /// Where the camera is, mm: z = 0 at the gel's tip, below 0 inside.
    pub position_mm: [f64; 3],
    /// A point in the middle of its image, mm.
    pub look_at_mm: [f64; 3],
}

/// See [`LensModel::Fisheye`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "datasets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Fisheye {
    /// Angle across the width of the image, degrees, 1 to 300.
    pub fov_deg: f64,
    /// Where the camera is, mm: z = 0 at the gel's tip, below 0 inside.
    pub position_mm: [f64; 3],
    /// A point in the middle of its image, mm.
    pub look_at_mm: [f64; 3],
    /// k1 to k4.
    #[serde(default)]
    pub k: [f64; 4],
}

impl Fisheye {
    /// Distance from the image's middle over f, of an angle to the axis, rad.
    fn distance(&self, angle: f64) -> f64 {
        let square = angle * angle;
        let [k1, k2, k3, k4] = self.k;
        angle * (1.0 + square * (k1 + square * (k2 + square * (k3 + square * k4))))
    }

    /// Half the angle across the image, rad.
    fn half_angle(&self) -> f64 {
        0.5 * self.fov_deg.to_radians()
    }

    /// True if no two angles within half a turn's field have one distance.
    pub fn is_one_to_one(&self) -> bool {
        const STEPS: usize = 1000;
        let distances = (0..=STEPS).map(|k| self.distance(k as f64 / STEPS as f64 * self.half_angle() * 1.5));
        distances.collect::<Vec<_>>().windows(2).all(|pair| pair[1] > pair[0])
    }

    /// The angle of a distance, by bisection: it is found once for each pixel of a sensor.
    fn angle(&self, distance: f64) -> f64 {
        let (mut low, mut high) = (0.0, 1.5 * self.half_angle());
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if self.distance(middle) < distance { low = middle } else { high = middle }
        }
        0.5 * (low + high)
    }
}

/// A camera at its place, made ready for an image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Projection {
    lens: LensModel,
    resolution_px: [usize; 2],
    /// mm per pixel of an orthographic lens; pixels per unit of distance of the others, f.
    scale: [f64; 2],
    from_mm: DVec3,
    /// The image's right and down and the way the camera looks.
    axes: DMat3,
}

impl Projection {
    /// Of an image of these pixels; an orthographic one shows `field_of_view_mm`.
    pub fn new(lens: &LensModel, resolution_px: [usize; 2], field_of_view_mm: [f64; 2]) -> Self {
        let half_width = resolution_px[0] as f64 / 2.0;
        let (scale, from_mm, towards) = match lens {
            LensModel::Orthographic => {
                let scale = std::array::from_fn(|k| field_of_view_mm[k] / resolution_px[k] as f64);
                (scale, DVec3::ZERO, DVec3::Z)
            }
            LensModel::Pinhole(Pinhole { fov_deg, position_mm, look_at_mm }) => {
                let focal_px = half_width / libm::tan(0.5 * fov_deg.to_radians());
                let from_mm = DVec3::from_array(*position_mm);
                ([focal_px; 2], from_mm, DVec3::from_array(*look_at_mm) - from_mm)
            }
            LensModel::Fisheye(fisheye) => {
                let focal_px = half_width / fisheye.distance(fisheye.half_angle());
                let from_mm = DVec3::from_array(fisheye.position_mm);
                ([focal_px; 2], from_mm, DVec3::from_array(fisheye.look_at_mm) - from_mm)
            }
        };
        // The image's right is the sensor's x as far as it can be; a camera that looks along x has its own.
        let ahead = towards.normalize();
        let right = DVec3::X - ahead * ahead.x;
        let right = if right.length() > 1e-6 { right.normalize() } else { ahead.any_orthonormal_vector() };
        let axes = DMat3::from_cols(right, ahead.cross(right), ahead);
        Self { lens: *lens, resolution_px, scale, from_mm, axes }
    }

    /// The line that a point of the image shows: a point of it, and its direction.
    pub fn line(&self, px: [f64; 2]) -> (DVec3, DVec3) {
        let [x, y] = [0, 1].map(|k| px[k] - self.resolution_px[k] as f64 / 2.0);
        match &self.lens {
            LensModel::Orthographic => (DVec3::new(x * self.scale[0], y * self.scale[1], 0.0), DVec3::Z),
            LensModel::Pinhole(_) => (self.from_mm, self.axes * DVec3::new(x, y, self.scale[0])),
            LensModel::Fisheye(fisheye) => {
                let distance = libm::hypot(x, y);
                let (sin, cos) = libm::sincos(fisheye.angle(distance / self.scale[0]));
                let per = if distance > 0.0 { sin / distance } else { 0.0 };
                (self.from_mm, self.axes * DVec3::new(per * x, per * y, cos))
            }
        }
    }

    /// The normal of the gel where a point of the image shows it; `None` where it shows none.
    pub fn normal(&self, shape: &GelShape, px: [f64; 2]) -> Option<DVec3> {
        let (from, direction) = self.line(px);
        shape.left_by(from, direction)
    }

    /// Where the image shows a point, px; the first pixel's centre is at (0.5, 0.5). `None` of what is behind the camera.
    pub fn point_px(&self, point_mm: DVec3) -> Option<[f64; 2]> {
        let DVec3 { x, y, z } = self.axes.transpose() * (point_mm - self.from_mm);
        let [right, down] = self.resolution_px.map(|px| px as f64 / 2.0);
        let at = |x: f64, y: f64| [x + right, y + down];
        Some(match &self.lens {
            LensModel::Orthographic => at(point_mm.x / self.scale[0], point_mm.y / self.scale[1]),
            LensModel::Pinhole(_) if z <= 0.0 => return None,
            LensModel::Pinhole(_) => at(self.scale[0] * x / z, self.scale[1] * y / z),
            LensModel::Fisheye(fisheye) => {
                let across = libm::hypot(x, y);
                let angle = libm::atan2(across, z);
                if angle > 1.5 * fisheye.half_angle() {
                    return None;
                }
                let per = if across > 0.0 { self.scale[0] * fisheye.distance(angle) / across } else { 0.0 };
                at(per * x, per * y)
            }
        })
    }

    /// The view in which a chart around the gel's tip holds all that the image shows: as many nodes as the image has pixels.
    /// `None` if the image shows no gel.
    pub fn chart_view(&self, shape: &GelShape) -> Option<View> {
        const STEPS: usize = 32;
        let chart = Chart::at_tip(shape);
        let mut farthest = [0.0_f64; 2];
        let mut shown = false;
        for y in 0..=STEPS {
            for x in 0..=STEPS {
                let along = |k: usize, at: usize| (at * self.resolution_px[k]) as f64 / STEPS as f64;
                if let Some(normal) = self.normal(shape, [along(0, x), along(1, y)]) {
                    shown = true;
                    let at = chart.at(normal);
                    (0..2).for_each(|k| farthest[k] = farthest[k].max(at[k].abs()));
                }
            }
        }
        let mm_per_px = std::array::from_fn(|k| 2.0 * farthest[k] / self.resolution_px[k] as f64);
        (shown && farthest.iter().all(|mm| *mm > 0.0)).then_some(View { resolution_px: self.resolution_px, mm_per_px })
    }
}

/// Step of the table of [`angles`].
const STEP: f64 = 1.0 / 4096.0;

/// An angle over its sine, for 1 less its cosine in steps from 0 to 1.5.
fn angles() -> &'static [f64] {
    static TABLE: OnceLock<Vec<f64>> = OnceLock::new();
    TABLE.get_or_init(|| {
        let of = |step: usize| {
            let versine = step as f64 * STEP;
            let sin = libm::sqrt(versine * (2.0 - versine));
            if step == 0 { 1.0 } else { libm::atan2(sin, 1.0 - versine) / sin }
        };
        (0..=6144).map(of).collect()
    })
}

/// Where the pixels of an image lie on a chart.
#[derive(Clone, Debug)]
pub struct GelMap {
    view: View,
    chart: Chart,
    /// Column and row on the chart, in pixels of `view`; no numbers where the image shows no gel.
    at: Vec<[f32; 2]>,
}

impl GelMap {
    /// Of the gel's points that an image's pixels show, as normals; `None` where one shows no gel.
    pub fn new(normals: &[Option<DVec3>], chart: &Chart, view: &View) -> Self {
        let per_mm: [f64; 2] = std::array::from_fn(|k| 1.0 / view.mm_per_px[k]);
        let middle = view.resolution_px.map(|px| px as f64 / 2.0);
        let back = chart.axes().transpose();
        let table = angles();
        let at = normals.iter().map(|normal| {
            let Some(normal) = normal else { return [f32::NAN; 2] };
            let DVec3 { x, y, z } = back * *normal;
            // What a look into a table does not know, beyond it.
            let place = (1.0 - z) / STEP;
            let at = match table.get(place as usize..place as usize + 2) {
                Some([here, next]) => {
                    let per = chart.radius_mm() * (here + (place - libm::floor(place)) * (next - here));
                    [per * x, per * y]
                }
                _ => chart.at(*normal),
            };
            std::array::from_fn(|k| (at[k] * per_mm[k] + middle[k]) as f32)
        });
        Self { view: *view, chart: *chart, at: at.collect() }
    }

    /// A layer of the chart as the image shows it, bilinear: 0 where there is no gel, and beyond the chart.
    pub fn plane(&self, from: &Grid<f32>) -> Grid<f32> {
        self.layer(|at| bilinear(from, at).unwrap_or(0.0))
    }

    /// A mask of the chart as the image shows it: the nearest node's value, 0 where there is no gel.
    pub fn mask(&self, from: &Grid<u8>) -> Grid<u8> {
        self.layer(|[x, y]| match x >= 0.0 && y >= 0.0 {
            true if (x as usize) < from.width && (y as usize) < from.height => from.at(x as usize, y as usize),
            _ => 0,
        })
    }

    /// The smallest rectangle around the image's pixels that show a marked node.
    pub fn box_of(&self, mask: &Grid<u8>) -> Rect {
        bounding_box(&self.mask(mask), |value| value > 0)
    }

    /// Where a point of the chart is from the sensor's axis, mm.
    pub fn place_mm(&self, at: [f64; 2]) -> [f64; 2] {
        let DVec3 { x, y, .. } = self.chart.point_mm(at);
        [x, y]
    }

    /// Directions along the chart's x and y and into the gel as the image shows them, in the sensor's frame.
    pub fn directions(&self, planes: [Grid<f32>; 3]) -> Vec<[f32; 3]> {
        let planes = planes.map(|plane| self.plane(&plane).data);
        let direction = |(k, at): (usize, &[f32; 2])| {
            let [x, y, z] = planes.each_ref().map(|plane| f64::from(plane[k]));
            let rest = self.chart.rest(self.view.point_mm(at.map(f64::from)));
            let [along, down] = rest.tangents;
            let direction = (x * along + y * down + z * rest.normal).try_normalize();
            let away = if at[0].is_finite() { -rest.normal } else { DVec3::NEG_Z };
            direction.unwrap_or(away).as_vec3().to_array()
        };
        self.at.iter().enumerate().map(direction).collect()
    }

    fn layer<T: Copy + Default>(&self, value: impl Fn([f32; 2]) -> T) -> Grid<T> {
        let [width, height] = self.view.resolution_px;
        let data = self.at.iter().map(|at| if at[0].is_finite() { value(*at) } else { T::default() }).collect();
        Grid { width, height, data }
    }
}

/// The value between the nodes around a place; the first node's centre is at (0.5, 0.5). `None` beyond the outermost
/// nodes.
pub fn bilinear(from: &Grid<f32>, [x, y]: [f32; 2]) -> Option<f32> {
    let (x, y) = (x - 0.5, y - 0.5);
    let (last_x, last_y) = ((from.width - 1) as f32, (from.height - 1) as f32);
    // Half a pixel beyond the outermost nodes is still theirs.
    if !(x >= -0.5 && y >= -0.5 && x <= last_x + 0.5 && y <= last_y + 0.5) {
        return None;
    }
    let (x, y) = (x.clamp(0.0, last_x), y.clamp(0.0, last_y));
    let (column, row) = (x as usize, y as usize);
    let (next, below) = ((column + 1).min(from.width - 1), (row + 1).min(from.height - 1));
    let (right, down) = (x - column as f32, y - row as f32);
    let line = |y: usize| from.at(column, y) + right * (from.at(next, y) - from.at(column, y));
    let (upper, lower) = (line(row), line(below));
    Some(upper + down * (lower - upper))
}
