//! Is an object round about an axis normal to the pad? If so, its section.

use glam::{DMat3, DQuat, DVec3};

use super::profile::Profile;
use crate::metrics::statistics::median;
use gelsim_core::base::angle::sin_cos_deg;
use gelsim_core::base::grid::Grid;
use gelsim_core::base::view::View;
use gelsim_core::depth::{Window, capture};
use gelsim_core::mesh::clusters::Clusters;
use gelsim_core::pose::{Anchor, Pose};

/// Between two samples of a section, mm.
pub const PITCH_MM: f64 = 0.005;
/// Sections through the axis at equal angles; each counts on both sides.
const SECTIONS: u32 = 36;
/// Most that a round object may differ from its mean section, mm and as a share of the depth.
const ROUND: [f64; 2] = [0.01, 0.03];
/// The widest part of an object that is looked at, thicknesses of the pad.
const WIDEST: f64 = 12.0;

/// An object seen from the pad, as a body of revolution.
pub struct Body {
    /// Heights of its mean section over its lowest point at every [`PITCH_MM`] from the axis; [`Body::top_mm`] without an object.
    heights: Vec<f64>,
    /// What stands for no object.
    top_mm: f64,
    /// How far it is from round: the largest distance of the object below the undeformed pad from its mean section, mm.
    pub asymmetry_mm: f64,
    /// How far an object may be.
    pub allowed_mm: f64,
}

impl Body {
    /// Of an object at an orientation, without its tilt, pressed `depth_mm` into a pad.
    pub fn measure(object: &Clusters, pose: &Pose, depth_mm: f64, thickness_mm: f64) -> Self {
        let top_mm = depth_mm + thickness_mm;
        let pose = centred(object, upright(pose), depth_mm, thickness_mm);
        let reach_mm = reach(object, &pose).min(WIDEST * thickness_mm) + 0.1;
        let count = (reach_mm / PITCH_MM).ceil() as usize;
        let view = View { resolution_px: [2 * count + 1, 1], mm_per_px: [PITCH_MM; 2] };
        let mut sections = Vec::new();
        for turn in 0..SECTIONS {
            let (sin, cos) = sin_cos_deg(180.0 / f64::from(SECTIONS) * f64::from(turn));
            let turned = DMat3::from_cols(DVec3::new(cos, sin, 0.0), DVec3::new(-sin, cos, 0.0), DVec3::Z);
            let pose = Pose {
                rotation: turned * pose.rotation,
                translation_mm: turned * pose.translation_mm,
                angles: pose.angles,
            };
            let heights = heights(object, &pose, &view, depth_mm, thickness_mm).data;
            sections.push(heights[count..].to_vec());
            sections.push(heights[..=count].iter().rev().copied().collect());
        }
        let middle =
            |k: usize| median(&sections.iter().map(|section| section[k]).collect::<Vec<f64>>()).unwrap_or(top_mm);
        let heights: Vec<f64> = (0..=count).map(middle).collect();
        let asymmetry_mm = asymmetry(&heights, &sections, depth_mm, top_mm);
        Self { heights, top_mm, asymmetry_mm, allowed_mm: ROUND[0] + ROUND[1] * depth_mm }
    }

    /// True for a body of revolution.
    pub fn is_round(&self) -> bool {
        self.asymmetry_mm <= self.allowed_mm
    }

    /// Its section, with edges rounded.
    pub fn profile(&self, rounding_mm: f64) -> Profile {
        Profile::new(&self.heights, PITCH_MM, rounding_mm, self.top_mm)
    }

    /// True if the object goes on beyond what was looked at, so low that it would touch.
    pub fn goes_on(&self, thickness_mm: f64) -> bool {
        let seen = self.heights.len() as f64 * PITCH_MM;
        seen > WIDEST * thickness_mm && self.heights.last().is_some_and(|z| *z < self.top_mm - thickness_mm)
    }
}

/// A pose without its tilt.
fn upright(pose: &Pose) -> Pose {
    let (sin, cos) = sin_cos_deg(pose.angles.tilt_azimuth_deg);
    let (half_sin, half_cos) = sin_cos_deg(-0.5 * pose.angles.tilt_deg);
    let back = DQuat::from_xyzw(cos * half_sin, sin * half_sin, 0.0, half_cos);
    Pose { rotation: DMat3::from_quat(back) * pose.rotation, ..*pose }
}

/// The axis of what is below the undeformed pad at the origin: the middle of its area, looked at twice, the second time
/// from nearer.
fn centred(object: &Clusters, upright: Pose, depth_mm: f64, thickness_mm: f64) -> Pose {
    const PIXELS: usize = 401;
    let mut pose = upright.moved([0.0, 0.0], Anchor::Contact, -depth_mm, object);
    let mut half_mm = reach(object, &pose).min(WIDEST * thickness_mm);
    for _ in 0..3 {
        let view = View { resolution_px: [PIXELS; 2], mm_per_px: [2.0 * half_mm / PIXELS as f64; 2] };
        let heights = heights(object, &pose, &view, depth_mm, thickness_mm);
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

/// How far the object reaches from the origin along x or y, mm, or a little farther.
fn reach(object: &Clusters, pose: &Pose) -> f64 {
    let back = pose.rotation.transpose();
    let centre = pose.rotation * DVec3::from_array(object.centre_mm()) + pose.translation_mm;
    let along = |axis: DVec3| object.extreme((back * axis).to_array()) + centre.dot(axis);
    let farthest = [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y].map(along).into_iter().fold(0.0, f64::max);
    farthest * std::f64::consts::SQRT_2
}

/// Heights over the object's lowest point in a view.
fn heights(object: &Clusters, pose: &Pose, view: &View, depth_mm: f64, thickness_mm: f64) -> Grid<f64> {
    let window = Window { margin_px: 0, above_mm: thickness_mm };
    let penetration = capture(object, &pose.placement(), view, window, 2.0 * depth_mm + thickness_mm).penetration;
    Grid {
        width: penetration.width,
        height: penetration.height,
        data: penetration.data.iter().map(|mm| depth_mm - f64::from(*mm)).collect(),
    }
}

/// The largest distance of sections below the undeformed pad from the mean one.
fn asymmetry(heights: &[f64], sections: &[Vec<f64>], depth_mm: f64, top_mm: f64) -> f64 {
    // Every so many samples are looked at.
    const STRIDE: usize = 4;
    let mean = Profile::new(heights, PITCH_MM, 0.0, top_mm);
    let mut worst = 0.0_f64;
    for k in (0..heights.len()).step_by(STRIDE) {
        let mut seen: Vec<f64> = sections.iter().map(|section| section[k].min(depth_mm)).collect();
        seen.sort_by(f64::total_cmp);
        // Above the pad it does not matter whether there is an object.
        for height in [seen[0], seen[seen.len() - 1]] {
            if height.min(heights[k]) < depth_mm {
                worst = worst.max(mean.beside([k as f64 * PITCH_MM, height]).distance.abs());
            }
        }
    }
    worst
}
