//! Finds out whether an object is round about an axis normal to the pad, and measures its section.

use glam::{DMat3, DQuat, DVec3};

use super::profile::Profile;
use crate::metrics::statistics::median;
use gelsim_core::base::angle::sin_cos_deg;
use gelsim_core::base::grid::Grid;
use gelsim_core::base::view::View;
use gelsim_core::depth::{CaptureWindow, capture_mesh};
use gelsim_core::mesh::clusters::Clusters;
use gelsim_core::pose::{Anchor, Pose};

/// Distance of two samples of a section, mm.
pub const SAMPLE_SPACING_MM: f64 = 0.005;
/// Number of sections through the axis at equal angles; each counts on both sides of it.
const SECTION_COUNT: u32 = 36;
/// Most that a round object may differ from its mean section: a constant, mm, and a share of the depth.
const ROUND_TOLERANCE: [f64; 2] = [0.01, 0.03];
/// Largest radius of an object that is examined, thicknesses of the pad.
const WIDEST_THICKNESSES: f64 = 12.0;

/// An object as the pad sees it, taken for a body of revolution.
pub struct Body {
    /// Heights of the mean section over the lowest point, at every [`SAMPLE_SPACING_MM`] from the axis; `top_mm` where
    /// there is no object.
    heights: Vec<f64>,
    /// Height that means "no object", mm.
    top_mm: f64,
    /// Largest distance of the object below the undeformed pad from its mean section, mm.
    pub asymmetry_mm: f64,
    /// Largest distance that still counts as round, mm.
    pub allowed_mm: f64,
}

impl Body {
    /// Measures an object at an orientation, without its tilt, pressed `depth_mm` into a pad.
    pub fn measure(object: &Clusters, pose: &Pose, depth_mm: f64, thickness_mm: f64) -> Self {
        let top_mm = depth_mm + thickness_mm;
        let pose = centre_on_axis(object, without_tilt(pose), depth_mm, thickness_mm);
        let reach_mm = horizontal_reach(object, &pose).min(WIDEST_THICKNESSES * thickness_mm) + 0.1;
        let count = (reach_mm / SAMPLE_SPACING_MM).ceil() as usize;
        let view = View { resolution_px: [2 * count + 1, 1], mm_per_px: [SAMPLE_SPACING_MM; 2] };
        let mut sections = Vec::new();
        for turn in 0..SECTION_COUNT {
            let (sin, cos) = sin_cos_deg(180.0 / f64::from(SECTION_COUNT) * f64::from(turn));
            let turned = DMat3::from_cols(DVec3::new(cos, sin, 0.0), DVec3::new(-sin, cos, 0.0), DVec3::Z);
            let pose = Pose {
                rotation: turned * pose.rotation,
                translation_mm: turned * pose.translation_mm,
                angles: pose.angles,
            };
            let heights = heights_in_view(object, &pose, &view, depth_mm, thickness_mm).data;
            sections.push(heights[count..].to_vec());
            sections.push(heights[..=count].iter().rev().copied().collect());
        }
        let middle =
            |k: usize| median(&sections.iter().map(|section| section[k]).collect::<Vec<f64>>()).unwrap_or(top_mm);
        let heights: Vec<f64> = (0..=count).map(middle).collect();
        let asymmetry_mm = largest_asymmetry(&heights, &sections, depth_mm, top_mm);
        Self { heights, top_mm, asymmetry_mm, allowed_mm: ROUND_TOLERANCE[0] + ROUND_TOLERANCE[1] * depth_mm }
    }

    /// Returns true for a body of revolution.
    pub fn is_round(&self) -> bool {
        self.asymmetry_mm <= self.allowed_mm
    }

    /// Returns the section with its edges rounded to a radius, mm.
    pub fn rounded_profile(&self, rounding_mm: f64) -> Profile {
        Profile::new(&self.heights, SAMPLE_SPACING_MM, rounding_mm, self.top_mm)
    }

    /// Returns true if the object extends beyond the part that was examined, so low that it would touch.
    pub fn extends_beyond_view(&self, thickness_mm: f64) -> bool {
        let seen = self.heights.len() as f64 * SAMPLE_SPACING_MM;
        seen > WIDEST_THICKNESSES * thickness_mm && self.heights.last().is_some_and(|z| *z < self.top_mm - thickness_mm)
    }
}

/// Returns a pose without its tilt.
fn without_tilt(pose: &Pose) -> Pose {
    let (sin, cos) = sin_cos_deg(pose.angles.tilt_azimuth_deg);
    let (half_sin, half_cos) = sin_cos_deg(-0.5 * pose.angles.tilt_deg);
    let back = DQuat::from_xyzw(cos * half_sin, sin * half_sin, 0.0, half_cos);
    Pose { rotation: DMat3::from_quat(back) * pose.rotation, ..*pose }
}

/// Moves the middle of the object's area below the undeformed pad to the origin. Looks three times, each time from
/// nearer, for a finer position.
fn centre_on_axis(object: &Clusters, upright: Pose, depth_mm: f64, thickness_mm: f64) -> Pose {
    const PIXELS: usize = 401;
    let mut pose = upright.moved([0.0, 0.0], Anchor::Contact, -depth_mm, object);
    let mut half_mm = horizontal_reach(object, &pose).min(WIDEST_THICKNESSES * thickness_mm);
    for _ in 0..3 {
        let view = View { resolution_px: [PIXELS; 2], mm_per_px: [2.0 * half_mm / PIXELS as f64; 2] };
        let heights = heights_in_view(object, &pose, &view, depth_mm, thickness_mm);
        let (mut area, mut sum, mut farthest) = (0.0, [0.0; 2], 0.0_f64);
        let mut inside = Vec::new();
        for y in 0..PIXELS {
            for (x, _) in heights.row(y).iter().enumerate().filter(|(_, height)| **height < depth_mm) {
                let at = view.point_mm([x as f64 + 0.5, y as f64 + 0.5]);
                area += 1.0;
                sum = [sum[0] + at[0], sum[1] + at[1]];
                inside.push(at);
            }
        }
        if area == 0.0 {
            break;
        }
        let middle = sum.map(|sum| sum / area);
        for at in inside {
            farthest = farthest.max(libm::hypot(at[0] - middle[0], at[1] - middle[1]));
        }
        pose.translation_mm -= DVec3::new(middle[0], middle[1], 0.0);
        half_mm = (1.1 * farthest + 2.0 * view.mm_per_px[0]).min(half_mm);
    }
    pose
}

/// Upper bound of how far the object reaches from the origin horizontally, mm.
fn horizontal_reach(object: &Clusters, pose: &Pose) -> f64 {
    let back = pose.rotation.transpose();
    let centre = pose.rotation * DVec3::from_array(object.centre_mm()) + pose.translation_mm;
    let along = |axis: DVec3| object.extreme((back * axis).to_array()) + centre.dot(axis);
    let farthest = [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y].map(along).into_iter().fold(0.0, f64::max);
    farthest * std::f64::consts::SQRT_2
}

/// Heights over the object's lowest point in a view, mm.
fn heights_in_view(object: &Clusters, pose: &Pose, view: &View, depth_mm: f64, thickness_mm: f64) -> Grid<f64> {
    let window = CaptureWindow { margin_px: 0, above_mm: thickness_mm };
    let penetration = capture_mesh(object, &pose.placement(), view, window, 2.0 * depth_mm + thickness_mm).penetration;
    Grid {
        width: penetration.width,
        height: penetration.height,
        data: penetration.data.iter().map(|mm| depth_mm - f64::from(*mm)).collect(),
    }
}

/// Largest distance of the sections below the undeformed pad from the mean one, mm.
fn largest_asymmetry(heights: &[f64], sections: &[Vec<f64>], depth_mm: f64, top_mm: f64) -> f64 {
    // Every fourth sample is enough: sections are sampled far more finely than the tolerance.
    const STRIDE: usize = 4;
    let mean = Profile::new(heights, SAMPLE_SPACING_MM, 0.0, top_mm);
    let mut worst = 0.0_f64;
    for k in (0..heights.len()).step_by(STRIDE) {
        let mut seen: Vec<f64> = sections.iter().map(|section| section[k].min(depth_mm)).collect();
        seen.sort_by(f64::total_cmp);
        // Above the pad it does not matter whether there is an object.
        for height in [seen[0], seen[seen.len() - 1]] {
            if height.min(heights[k]) < depth_mm {
                worst = worst.max(mean.measure_distance([k as f64 * SAMPLE_SPACING_MM, height]).distance.abs());
            }
        }
    }
    worst
}
