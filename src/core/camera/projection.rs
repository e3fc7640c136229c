//! A camera inside a curved gel: which point of the gel a pixel shows, and which pixel shows a point.

use std::f64::consts::FRAC_PI_2;

use glam::{DMat3, DVec2, DVec3};
use serde::{Deserialize, Serialize};

use crate::base::chart::Chart;
use crate::base::gel::{GelShape, Site};
use crate::base::view::View;

/// How the camera's lens takes directions to the image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum LensModel {
    /// From straight below, without perspective: the image shows the field of view.
    #[default]
    Orthographic,
    /// Straight lines stay straight.
    Pinhole(Pinhole),
    /// Kannala and Brandt (2006): what is at an angle a to the optical axis is seen at a distance of f (a + k1 a^3 + k2
    /// a^5 + k3 a^7 + k4 a^9) from the image's middle.
    Fisheye(Fisheye),
}

/// A camera without distortion: straight lines stay straight.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Pinhole {
    /// Angle across the width of the image, degrees, 1 to 170.
    pub fov_deg: f64,
    /// Where the camera is, mm: z = 0 at the gel's tip, below 0 inside.
    pub position_mm: [f64; 3],
    /// A point that it sees in the middle of its image, mm.
    pub look_at_mm: [f64; 3],
}

/// A fisheye camera by the model of Kannala and Brandt (2006).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Fisheye {
    /// Angle across the width of the image, degrees, 1 to 300.
    pub fov_deg: f64,
    /// Where the camera is, mm: z = 0 at the gel's tip, below 0 inside.
    pub position_mm: [f64; 3],
    /// A point that it sees in the middle of its image, mm.
    pub look_at_mm: [f64; 3],
    /// Coefficients k1 to k4.
    #[serde(default)]
    pub k: [f64; 4],
}

impl Fisheye {
    /// Returns the distance from the image's middle, over f, of what is seen at an angle to the optical axis, rad.
    fn distance_of_angle(&self, angle: f64) -> f64 {
        let square = angle * angle;
        let [k1, k2, k3, k4] = self.k;
        angle * (1.0 + square * (k1 + square * (k2 + square * (k3 + square * k4))))
    }

    /// Returns half the angle across the image, rad.
    fn half_angle(&self) -> f64 {
        0.5 * self.fov_deg.to_radians()
    }

    /// Returns true if no two angles have the same distance, up to 1.5 times half the angle across the image: the
    /// corners included.
    pub fn is_one_to_one(&self) -> bool {
        const STEPS: usize = 1000;
        let distances = (0..=STEPS).map(|k| self.distance_of_angle(k as f64 / STEPS as f64 * self.half_angle() * 1.5));
        distances.collect::<Vec<_>>().windows(2).all(|pair| pair[1] > pair[0])
    }

    /// Returns the angle of a distance, rad, by bisection: it is found only once for each pixel of a sensor.
    fn angle_of_distance(&self, distance: f64) -> f64 {
        let (mut low, mut high) = (0.0, 1.5 * self.half_angle());
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if self.distance_of_angle(middle) < distance { low = middle } else { high = middle }
        }
        0.5 * (low + high)
    }
}

/// A camera at its position, prepared for an image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Projection {
    lens: LensModel,
    resolution_px: [usize; 2],
    /// Under an orthographic lens mm per pixel; under the others f, pixels per unit of distance.
    scale: [f64; 2],
    position_mm: DVec3,
    /// The image's right and down, and the direction in which the camera looks, as columns.
    axes: DMat3,
}

impl Projection {
    /// Prepares a camera for an image of these pixels; an orthographic one shows `field_of_view_mm`.
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
                let focal_px = half_width / fisheye.distance_of_angle(fisheye.half_angle());
                let from_mm = DVec3::from_array(fisheye.position_mm);
                ([focal_px; 2], from_mm, DVec3::from_array(fisheye.look_at_mm) - from_mm)
            }
        };
        // The image's right is the sensor's x, made perpendicular to the optical axis; a camera that looks along x has
        // any other.
        let ahead = towards.normalize();
        let right = DVec3::X - ahead * ahead.x;
        let right = if right.length() > 1e-6 { right.normalize() } else { ahead.any_orthonormal_vector() };
        let axes = DMat3::from_cols(right, ahead.cross(right), ahead);
        Self { lens: *lens, resolution_px, scale, position_mm: from_mm, axes }
    }

    /// Returns the ray that a point of the image shows: a point on it, mm, and its direction, whose length is not
    /// always 1.
    pub fn ray_at(&self, px: [f64; 2]) -> (DVec3, DVec3) {
        let [x, y] = [0, 1].map(|k| px[k] - self.resolution_px[k] as f64 / 2.0);
        match &self.lens {
            LensModel::Orthographic => (DVec3::new(x * self.scale[0], y * self.scale[1], 0.0), DVec3::Z),
            LensModel::Pinhole(_) => (self.position_mm, self.axes * DVec3::new(x, y, self.scale[0])),
            LensModel::Fisheye(fisheye) => {
                let distance = libm::hypot(x, y);
                let (sin, cos) = libm::sincos(fisheye.angle_of_distance(distance / self.scale[0]));
                let per = if distance > 0.0 { sin / distance } else { 0.0 };
                (self.position_mm, self.axes * DVec3::new(per * x, per * y, cos))
            }
        }
    }

    /// Returns the direction in which the camera looks: its optical axis.
    pub fn optical_axis(&self) -> DVec3 {
        if self.lens == LensModel::Orthographic { DVec3::Z } else { self.axes.z_axis }
    }

    /// Returns the point of the gel that a point of the image shows; `None` where it shows none.
    pub fn site(&self, shape: &GelShape, px: [f64; 2]) -> Option<Site> {
        self.find_exit(shape, self.ray_at(px))
    }

    /// Returns where a ray of the image ([`Projection::ray_at`]) leaves the gel; `None` if it misses it.
    pub fn find_exit(&self, shape: &GelShape, (from, direction): (DVec3, DVec3)) -> Option<Site> {
        // An orthographic ray begins below a mesh, so that its first exit is found.
        let from = match (shape.surface(), &self.lens) {
            (Some(surface), LensModel::Orthographic) => from.with_z(surface.bounds_mm()[0].z - 1.0),
            _ => from,
        };
        shape.find_exit(from, direction)
    }

    /// Returns the unit vector from a point of the gel towards the camera; straight down, to a camera far below, under
    /// an orthographic lens.
    pub fn towards_camera(&self, point_mm: DVec3) -> DVec3 {
        match &self.lens {
            LensModel::Orthographic => DVec3::NEG_Z,
            LensModel::Pinhole(_) | LensModel::Fisheye(_) => (self.position_mm - point_mm).normalize_or(DVec3::NEG_Z),
        }
    }

    /// Returns where the image shows a point, px; the first pixel's centre is at (0.5, 0.5). `None` if it is behind the
    /// camera or far outside a fisheye's image.
    pub fn point_px(&self, point_mm: DVec3) -> Option<[f64; 2]> {
        let DVec3 { x, y, z } = self.axes.transpose() * (point_mm - self.position_mm);
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
                let per = if across > 0.0 { self.scale[0] * fisheye.distance_of_angle(angle) / across } else { 0.0 };
                at(per * x, per * y)
            }
        })
    }

    /// Returns the image as a view whose pixels are as large as at the gel's tip; `None` if the camera does not see the
    /// tip.
    pub(crate) fn view_at_tip(&self) -> Option<View> {
        const STEP_MM: f64 = 1e-3;
        let px = |x: f64, y: f64| self.point_px(DVec3::new(x, y, 0.0)).map(DVec2::from_array);
        let steps = [(STEP_MM, 0.0), (0.0, STEP_MM)];
        let [Some(along), Some(down)] = steps.map(|(x, y)| Some((px(x, y)? - px(-x, -y)?).length())) else {
            return None;
        };
        let scale = libm::sqrt(along * down) / (2.0 * STEP_MM);
        (scale.is_finite() && scale > 0.0)
            .then_some(View { resolution_px: self.resolution_px, mm_per_px: [1.0 / scale; 2] })
    }

    /// Returns the view in which charts are computed, with as many nodes as the image has pixels; `None` if the image
    /// shows no gel.
    ///
    /// Around a dome's tip it holds all that the image shows. On a capsule it reaches a quarter of the way around on
    /// both sides, and as far along the capsule or, if that is more, half of its length. A mesh that is seen well past
    /// its quarter has such a view, too; its quarter ends where its normal is across the tip's.
    pub fn chart_view(&self, shape: &GelShape) -> Option<View> {
        const STEPS: usize = 32;
        let chart = Chart::at_tip(shape);
        let mut farthest = [0.0_f64; 2];
        let mut shown = false;
        for y in 0..=STEPS {
            for x in 0..=STEPS {
                let along = |k: usize, at: usize| (at * self.resolution_px[k]) as f64 / STEPS as f64;
                if let Some(site) = self.site(shape, [along(0, x), along(1, y)]) {
                    shown = true;
                    let at = chart.locate_site(site);
                    (0..2).for_each(|k| farthest[k] = farthest[k].max(at[k].abs()));
                }
            }
        }
        if let Some(wall_mm) = shape.wall_mm() {
            let quarter_mm = FRAC_PI_2 * shape.radius_mm();
            farthest = [quarter_mm.max(0.5 * (quarter_mm + wall_mm)), quarter_mm];
        }
        if let Some([quarter_mm, end_mm]) = chart.geodesics().and_then(|geodesics| geodesics.quarter_and_end_mm())
            && farthest[0].max(farthest[1]) > 1.1 * quarter_mm
        {
            farthest = [quarter_mm.max(0.5 * end_mm), quarter_mm];
        }
        let mm_per_px = std::array::from_fn(|k| 2.0 * farthest[k] / self.resolution_px[k] as f64);
        (shown && farthest.iter().all(|mm| *mm > 0.0)).then_some(View { resolution_px: self.resolution_px, mm_per_px })
    }
}
