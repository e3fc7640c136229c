//! Checks whether a frame can be right. Wrong units and a wrong distance of the pad are common mistakes, and both can
//! be seen in the heights.

use glam::DVec3;

use super::camera::{DepthCamera, DepthUnit};
use super::heights::FrameHeights;
use gelsim_files::diagnostic::Diagnostic;

/// The range of a frame's heights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameReach {
    /// Height of the lowest point over the undeformed pad, or over a gel with a shape, mm; infinite if nothing is seen.
    pub lowest_mm: f64,
    /// Height of the highest point that is seen, mm.
    pub highest_mm: f64,
    /// Number of pixels in which something lies deeper than the pad is thick.
    pub through_px: u64,
    /// Number of pixels that the camera could not see.
    pub unseen_px: u64,
    /// Normal of the undeformed pad at the lowest point.
    pub normal: DVec3,
    thickness_mm: f64,
    against: ReferenceSurface,
}

/// The surface with which the camera's distances are compared.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ReferenceSurface {
    /// The surface of a flat pad, all of which is equally far from the camera.
    Plane,
    /// A gel with a shape. The distances from the lens are on the ray on which the object is nearest in proportion to
    /// the gel.
    Gel {
        /// Distance of the point that is seen, mm.
        seen_mm: f64,
        /// Distance of the gel, mm.
        gel_mm: f64,
    },
}

impl FrameReach {
    /// Makes the range of a frame that shows nothing over a gel with a shape.
    pub fn without_object(thickness_mm: f64, unseen_px: u64) -> Self {
        let against = ReferenceSurface::Gel { seen_mm: f64::INFINITY, gel_mm: f64::INFINITY };
        let (lowest_mm, highest_mm) = (f64::INFINITY, f64::NEG_INFINITY);
        Self { lowest_mm, highest_mm, through_px: 0, unseen_px, normal: DVec3::Z, thickness_mm, against }
    }

    /// Adds a point at this height over a gel.
    pub fn add_point(&mut self, above_mm: f64, against: ReferenceSurface) {
        if let (
            ReferenceSurface::Gel { seen_mm, gel_mm },
            ReferenceSurface::Gel { seen_mm: before_mm, gel_mm: of_gel_mm },
        ) = (against, self.against)
            && (before_mm == f64::INFINITY || seen_mm * of_gel_mm < before_mm * gel_mm)
        {
            self.against = against;
        }
        self.lowest_mm = self.lowest_mm.min(above_mm);
        self.highest_mm = self.highest_mm.max(above_mm);
        self.through_px += u64::from(above_mm < -self.thickness_mm);
    }

    /// Computes the range of heights over a pad `thickness_mm` thick.
    pub fn from_surface(heights: &FrameHeights, thickness_mm: f64) -> Self {
        let thickness = thickness_mm as f32;
        let (mut lowest, mut highest, mut through_px) = (f32::INFINITY, f32::NEG_INFINITY, 0);
        for mm in &heights.above_mm.data {
            lowest = lowest.min(*mm);
            highest = if mm.is_finite() { highest.max(*mm) } else { highest };
            through_px += u64::from(*mm < -thickness);
        }
        Self {
            lowest_mm: lowest.into(),
            highest_mm: highest.into(),
            through_px,
            unseen_px: heights.unseen_px,
            normal: DVec3::Z,
            thickness_mm,
            against: ReferenceSurface::Plane,
        }
    }

    /// Returns true if something reaches into the pad.
    pub fn touches_pad(&self) -> bool {
        self.lowest_mm < 0.0
    }

    /// Returns true if something is pressed in deep enough to be visible.
    pub fn is_pressed(&self) -> bool {
        self.lowest_mm < -INVISIBLE_MM
    }

    /// Returns an error if the frame cannot be right: all that it shows lies behind the pad.
    pub fn find_error(&self, camera: &DepthCamera) -> Option<Diagnostic> {
        (self.lowest_mm.is_finite() && self.highest_mm < -self.thickness_mm).then(|| {
            let message = match self.against {
                ReferenceSurface::Plane => format!(
                    "all that is seen lies behind the pad, which is {} mm thick: {} to {} mm from the camera, and the \
                     pad's surface is at {} mm",
                    self.thickness_mm,
                    round_to_micrometre(self.lowest_mm + camera.plane_mm),
                    round_to_micrometre(self.highest_mm + camera.plane_mm),
                    round_to_micrometre(camera.plane_mm)
                ),
                ReferenceSurface::Gel { seen_mm, gel_mm } => format!(
                    "all that is seen lies behind the gel, which is {} mm thick: it comes as near as {} mm to the camera, \
                     where the gel is at {} mm",
                    self.thickness_mm,
                    round_to_micrometre(seen_mm),
                    round_to_micrometre(gel_mm)
                ),
            };
            Diagnostic::new(message).help(self.suggest_fix(camera))
        })
    }

    /// Makes the error for a set of frames none of which presses the pad. This frame comes nearest to it.
    pub fn explain_out_of_reach(&self, camera: &DepthCamera) -> Diagnostic {
        let what = if self.against == ReferenceSurface::Plane { "pad" } else { "gel" };
        let message = match self.lowest_mm.is_finite() {
            false => String::from("nothing is seen in any frame"),
            true if self.touches_pad() => {
                format!("the deepest press of all frames is {:.1e} mm, which no camera shows", -self.lowest_mm)
            }
            true => {
                format!(
                    "nothing reaches the {what}: the nearest point is {} mm beyond it",
                    round_to_micrometre(self.lowest_mm)
                )
            }
        };
        Diagnostic::new(message)
            .help(format!("{}; frames without contact are rendered with --no-contact-ok", self.suggest_fix(camera)))
    }

    /// Returns a warning if the frame presses nothing, but would with other units.
    pub fn find_suspicion(&self, camera: &DepthCamera) -> Option<Diagnostic> {
        let other = if self.is_pressed() { None } else { self.suggest_units(camera) };
        other.map(|help| {
            let message = if self.touches_pad() {
                format!("the deepest press is {:.1e} mm, which no camera shows", -self.lowest_mm)
            } else {
                format!(
                    "nothing reaches the pad: the nearest point is {} mm beyond it",
                    round_to_micrometre(self.lowest_mm)
                )
            };
            Diagnostic::warning(message).help(help)
        })
    }

    /// Suggests the likely fix: the unit in which the lowest point would be in the pad, or else the pad's distance.
    fn suggest_fix(&self, camera: &DepthCamera) -> String {
        if !self.lowest_mm.is_finite() {
            return String::from("are --max-depth-mm and --background-value right?");
        }
        match (self.suggest_units(camera), self.against) {
            (Some(help), _) => help,
            (None, ReferenceSurface::Gel { .. }) => String::from(
                "does the frame's camera stand and look as [sensor.lens] says, and are its distances those that --depth-along says?",
            ),
            (None, ReferenceSurface::Plane) => format!(
                "is --plane-mm {} right? it is the distance of the undeformed pad from the camera, in mm",
                round_to_micrometre(camera.plane_mm)
            ),
        }
    }

    /// Suggests the flags with which the values would be a press, if their unit or that of the pad's distance is wrong.
    /// Returns `None` if there are none.
    fn suggest_units(&self, camera: &DepthCamera) -> Option<String> {
        let look = |unit: DepthUnit| {
            let (name, words) = unit.symbol_and_plural();
            format!("the values look like {words}: --depth-unit {name}")
        };
        if let ReferenceSurface::Gel { seen_mm, gel_mm } = self.against {
            // Units differ by a factor of a thousand; a press is a few hundredths of the way to the gel.
            let would_touch = |unit: &DepthUnit| {
                *unit != camera.unit
                    && (0.3..1.01).contains(&(seen_mm * unit.mm_per_unit() / camera.unit.mm_per_unit() / gel_mm))
            };
            return DepthUnit::ALL.into_iter().find(would_touch).map(look);
        }
        let [nearest, farthest] =
            [self.lowest_mm, self.highest_mm].map(|mm| (mm + camera.plane_mm) / camera.unit.mm_per_unit());
        // True if the values are a press with these units, of a depth that is not itself a mistake of units.
        let presses = |unit: DepthUnit, plane_mm: f64| {
            let [lowest_mm, highest_mm] = [nearest, farthest].map(|value| value * unit.mm_per_unit() - plane_mm);
            // Units differ by a factor of a thousand; a press is a small part of the way to the pad.
            (-self.thickness_mm..=-INVISIBLE_MM).contains(&lowest_mm)
                && lowest_mm > -0.7 * plane_mm
                && highest_mm > -self.thickness_mm
        };
        // No camera is nearer than 1 mm or farther than 1 m: then the distance was given in metres or micrometres.
        let planes: Vec<f64> = match camera.plane_mm {
            mm if mm <= 0.0 => Vec::new(),
            mm if mm < 1.0 => vec![mm, 1e3 * mm],
            mm if mm > 1e3 => vec![mm, 1e-3 * mm],
            mm => vec![mm],
        };
        let mut found = Vec::new();
        for unit in DepthUnit::ALL {
            for (k, plane_mm) in planes.iter().enumerate() {
                let changes = u32::from(unit != camera.unit) + u32::from(k > 0);
                if changes > 0 && presses(unit, *plane_mm) {
                    found.push((changes, unit, k, *plane_mm));
                }
            }
        }
        let (_, unit, k, plane_mm) = found.into_iter().min_by_key(|(changes, ..)| *changes)?;
        let plane = format!("--plane-mm {}", round_to_micrometre(plane_mm));
        Some(match (unit != camera.unit, k > 0) {
            (true, false) => look(unit),
            (true, true) => format!("{}, and the pad's distance is in mm: {plane}", look(unit)),
            (false, _) => format!("the pad's distance is in mm, whatever the unit of the values: {plane}"),
        })
    }
}

/// Depth below which a press is invisible, mm. The deepest press of a set is never below it, but presses of some
/// millimetres read a thousand times too small are.
const INVISIBLE_MM: f64 = 3e-3;

/// Rounds a length to a micrometre.
fn round_to_micrometre(mm: f64) -> f64 {
    (mm * 1e3).round() / 1e3
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frames::camera::{DepthProjection, DistanceAlong};
    use gelsim_core::base::grid::Grid;

    fn camera(unit: DepthUnit, plane_mm: f64) -> DepthCamera {
        DepthCamera {
            unit,
            plane_mm,
            max_depth_mm: None,
            background: None,
            flip: [false; 2],
            offset_px: [0.0; 2],
            projection: DepthProjection::Orthographic,
            along: DistanceAlong::Axis,
        }
    }

    fn reach(above_mm: &[f32]) -> FrameReach {
        let above_mm = Grid { width: above_mm.len(), height: 1, data: above_mm.to_vec() };
        FrameReach::from_surface(&FrameHeights { above_mm, unseen_px: 0 }, 3.0)
    }

    #[test]
    fn a_press_is_no_mistake_even_where_it_goes_through() {
        let pressed = reach(&[-0.5, 4.0, f32::INFINITY]);
        assert!(pressed.touches_pad() && pressed.find_error(&camera(DepthUnit::Millimetre, 10.0)).is_none());
        let through = reach(&[-3.5, -0.1]);
        assert_eq!((through.through_px, through.find_error(&camera(DepthUnit::Millimetre, 10.0))), (1, None));
        assert!(!reach(&[0.0, f32::INFINITY]).touches_pad());
    }

    #[test]
    fn metres_taken_for_millimetres_are_all_behind_the_pad_and_the_unit_is_named() {
        // 9.5 mm and 50 mm in metres.
        let wrong = camera(DepthUnit::Millimetre, 10.0);
        let problem = reach(&[0.0095 - 10.0, 0.05 - 10.0]).find_error(&wrong).expect("a mistake");
        assert!(problem.message.contains("behind the pad"), "{}", problem.message);
        assert_eq!(problem.help.as_deref(), Some("the values look like metres: --depth-unit m"));
        // Millimetres read as metres are far away.
        let problem = reach(&[9500.0 - 10.0]).explain_out_of_reach(&camera(DepthUnit::Metre, 10.0));
        assert!(problem.message.ends_with("the nearest point is 9490 mm beyond it"), "{}", problem.message);
        assert!(problem.help.is_some_and(|help| help.starts_with("the values look like millimetres: --depth-unit mm")));
    }

    #[test]
    fn a_plane_in_metres_is_told_from_values_in_another_unit() {
        let help = |above_mm: &[f32], unit, plane_mm| {
            reach(above_mm).explain_out_of_reach(&camera(unit, plane_mm)).help.unwrap_or_default()
        };
        // 9 mm in metres, and the plane at 10 mm given as 0.01.
        assert!(help(&[9.0 - 0.01, 30.0], DepthUnit::Metre, 0.01).contains("--plane-mm 10"));
        assert!(!help(&[9.0 - 0.01, 30.0], DepthUnit::Metre, 0.01).contains("--depth-unit"));
        // The same frame in mm, read as mm.
        assert!(help(&[9.0 - 0.01, 30.0], DepthUnit::Millimetre, 0.01).contains("--plane-mm 10"));
        // Following the wrong advice would give a press of a micrometre, which is none.
        let both = reach(&[-0.001, 0.02]);
        assert!(both.touches_pad() && !both.is_pressed());
        let help = both.explain_out_of_reach(&camera(DepthUnit::Millimetre, 0.01)).help.unwrap_or_default();
        assert!(help.contains("--depth-unit m,") && help.contains("--plane-mm 10"), "{help}");
    }

    #[test]
    fn frames_that_press_or_are_just_above_the_pad_are_not_suspected() {
        for above_mm in [-0.5, 0.5, 5.0, 40.0] {
            assert_eq!(reach(&[above_mm, 60.0]).find_suspicion(&camera(DepthUnit::Metre, 10.0)), None, "{above_mm}");
        }
        let wrong = reach(&[9500.0 - 10.0, 9e4]).find_suspicion(&camera(DepthUnit::Metre, 10.0)).expect("millimetres");
        assert!(wrong.help.is_some_and(|help| help.contains("--depth-unit mm")));
    }

    #[test]
    fn where_no_unit_helps_the_plane_is_asked_for() {
        let wrong = camera(DepthUnit::Millimetre, 10.0);
        let problem = reach(&[12.3, 20.0]).explain_out_of_reach(&wrong);
        assert!(problem.message.contains("12.3 mm beyond"), "{}", problem.message);
        assert!(problem.help.is_some_and(|help| help.contains("is --plane-mm 10 right?")));
        // In millimetres it would touch, but 9 mm is not a mistake of units.
        let problem = reach(&[8.0, 49.0]).explain_out_of_reach(&camera(DepthUnit::Metre, 1.0));
        assert!(problem.help.is_some_and(|help| help.contains("is --plane-mm 1 right?")));
        let problem = reach(&[-8.0, -7.0]).find_error(&wrong).expect("a mistake");
        assert!(problem.help.is_some_and(|help| help.contains("is --plane-mm 10 right?")));
        let problem = reach(&[f32::INFINITY]).explain_out_of_reach(&wrong);
        assert!(problem.help.is_some_and(|help| help.contains("--max-depth-mm")));
    }
}
