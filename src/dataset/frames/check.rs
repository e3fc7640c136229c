//! Whether what a frame shows can be right: units and the place of the pad are easily mistaken, and either shows.

use glam::DVec3;

use super::camera::{DepthCamera, Unit};
use super::heights::Heights;
use gelsim_files::diagnostic::Diagnostic;

/// What is known of a frame's heights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reach {
    /// Height of the lowest point over the undeformed pad, or over a gel that has a shape, mm; infinite if nothing is seen.
    pub lowest_mm: f64,
    /// That of the highest point that is seen.
    pub highest_mm: f64,
    /// Pixels in which something is deeper than the pad is thick.
    pub through_px: u64,
    /// Pixels that the camera could not see.
    pub unseen_px: u64,
    /// The undeformed pad's normal, there on a gel that has a shape.
    pub normal: DVec3,
    thickness_mm: f64,
    against: Against,
}

/// What the camera's distances are held against.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Against {
    /// The flat pad's surface, all of which is as far from the camera.
    Plane,
    /// A gel that has a shape: on the ray on which the object is nearest for how far the gel is, how far both are from the lens, mm.
    Gel {
        /// To the point.
        seen_mm: f64,
        /// To the gel.
        gel_mm: f64,
    },
}

impl Reach {
    /// Of a frame that shows nothing over a gel that has a shape.
    pub fn nothing(thickness_mm: f64, unseen_px: u64) -> Self {
        let against = Against::Gel { seen_mm: f64::INFINITY, gel_mm: f64::INFINITY };
        let (lowest_mm, highest_mm) = (f64::INFINITY, f64::NEG_INFINITY);
        Self { lowest_mm, highest_mm, through_px: 0, unseen_px, normal: DVec3::Z, thickness_mm, against }
    }

    /// Takes a point into account, so far above a gel.
    pub fn add(&mut self, above_mm: f64, against: Against) {
        if let (Against::Gel { seen_mm, gel_mm }, Against::Gel { seen_mm: before_mm, gel_mm: of_gel_mm }) =
            (against, self.against)
            && (before_mm == f64::INFINITY || seen_mm * of_gel_mm < before_mm * gel_mm)
        {
            self.against = against;
        }
        self.lowest_mm = self.lowest_mm.min(above_mm);
        self.highest_mm = self.highest_mm.max(above_mm);
        self.through_px += u64::from(above_mm < -self.thickness_mm);
    }

    /// Of heights over a pad `thickness_mm` thick.
    pub fn from_surface(heights: &Heights, thickness_mm: f64) -> Self {
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
            against: Against::Plane,
        }
    }

    /// True if something reaches into the pad.
    pub fn touches(&self) -> bool {
        self.lowest_mm < 0.0
    }

    /// True if something is pressed in so deep that it may be seen.
    pub fn is_pressed(&self) -> bool {
        self.lowest_mm < -INVISIBLE_MM
    }

    /// What cannot be right of one frame: all that it shows is behind the pad.
    pub fn mistake(&self, camera: &DepthCamera) -> Option<Diagnostic> {
        (self.lowest_mm.is_finite() && self.highest_mm < -self.thickness_mm).then(|| {
            let message = match self.against {
                Against::Plane => format!(
                    "all that is seen lies behind the pad, which is {} mm thick: {} to {} mm from the camera, and the \
                     pad's surface is at {} mm",
                    self.thickness_mm,
                    rounded(self.lowest_mm + camera.plane_mm),
                    rounded(self.highest_mm + camera.plane_mm),
                    rounded(camera.plane_mm)
                ),
                Against::Gel { seen_mm, gel_mm } => format!(
                    "all that is seen lies behind the gel, which is {} mm thick: it comes as near as {} mm to the camera, \
                     where the gel is at {} mm",
                    self.thickness_mm,
                    rounded(seen_mm),
                    rounded(gel_mm)
                ),
            };
            Diagnostic::new(message).help(self.fix(camera))
        })
    }

    /// What cannot be right of a set of frames of which this one comes nearest to the pad, and does not press it.
    pub fn out_of_reach(&self, camera: &DepthCamera) -> Diagnostic {
        let what = if self.against == Against::Plane { "pad" } else { "gel" };
        let message = match self.lowest_mm.is_finite() {
            false => String::from("nothing is seen in any frame"),
            true if self.touches() => {
                format!("the deepest press of all frames is {:.1e} mm, which no camera shows", -self.lowest_mm)
            }
            true => {
                format!("nothing reaches the {what}: the nearest point is {} mm beyond it", rounded(self.lowest_mm))
            }
        };
        Diagnostic::new(message)
            .help(format!("{}; frames without contact are rendered with --no-contact-ok", self.fix(camera)))
    }

    /// What is probably wrong with a frame that presses nothing, where other units would make it a press.
    pub fn suspicion(&self, camera: &DepthCamera) -> Option<Diagnostic> {
        let other = if self.is_pressed() { None } else { self.other_units(camera) };
        other.map(|help| {
            let message = if self.touches() {
                format!("the deepest press is {:.1e} mm, which no camera shows", -self.lowest_mm)
            } else {
                format!("nothing reaches the pad: the nearest point is {} mm beyond it", rounded(self.lowest_mm))
            };
            Diagnostic::warning(message).help(help)
        })
    }

    /// The likely way out: the unit in which the lowest point would be in the pad, or else the pad's place.
    fn fix(&self, camera: &DepthCamera) -> String {
        if !self.lowest_mm.is_finite() {
            return String::from("are --max-depth-mm and --background-value right?");
        }
        match (self.other_units(camera), self.against) {
            (Some(help), _) => help,
            (None, Against::Gel { .. }) => String::from(
                "does the frame's camera stand and look as [sensor.lens] says, and are its distances those that --depth-along says?",
            ),
            (None, Against::Plane) => format!(
                "is --plane-mm {} right? it is the distance of the undeformed pad from the camera, in mm",
                rounded(camera.plane_mm)
            ),
        }
    }

    /// The flags with which the values make a press, where one of them or the plane was given in another unit.
    fn other_units(&self, camera: &DepthCamera) -> Option<String> {
        let look = |unit: Unit| {
            let (name, words) = unit.names();
            format!("the values look like {words}: --depth-unit {name}")
        };
        if let Against::Gel { seen_mm, gel_mm } = self.against {
            // Units are a thousand apart; a press is a few hundredths of the way to the gel.
            let would_touch = |unit: &Unit| {
                *unit != camera.unit && (0.3..1.01).contains(&(seen_mm * unit.mm() / camera.unit.mm() / gel_mm))
            };
            return Unit::ALL.into_iter().find(would_touch).map(look);
        }
        let [nearest, farthest] = [self.lowest_mm, self.highest_mm].map(|mm| (mm + camera.plane_mm) / camera.unit.mm());
        // A press under these, of a depth that is no unit's mistake again.
        let presses = |unit: Unit, plane_mm: f64| {
            let [lowest_mm, highest_mm] = [nearest, farthest].map(|value| value * unit.mm() - plane_mm);
            // Units are a thousand apart; a press is a small part of the way to the pad.
            (-self.thickness_mm..=-INVISIBLE_MM).contains(&lowest_mm)
                && lowest_mm > -0.7 * plane_mm
                && highest_mm > -self.thickness_mm
        };
        // No camera is as near or as far as that: the distance was given in metres, or in micrometres.
        let planes: Vec<f64> = match camera.plane_mm {
            mm if mm <= 0.0 => Vec::new(),
            mm if mm < 1.0 => vec![mm, 1e3 * mm],
            mm if mm > 1e3 => vec![mm, 1e-3 * mm],
            mm => vec![mm],
        };
        let mut found = Vec::new();
        for unit in Unit::ALL {
            for (k, plane_mm) in planes.iter().enumerate() {
                let changes = u32::from(unit != camera.unit) + u32::from(k > 0);
                if changes > 0 && presses(unit, *plane_mm) {
                    found.push((changes, unit, k, *plane_mm));
                }
            }
        }
        let (_, unit, k, plane_mm) = found.into_iter().min_by_key(|(changes, ..)| *changes)?;
        let plane = format!("--plane-mm {}", rounded(plane_mm));
        Some(match (unit != camera.unit, k > 0) {
            (true, false) => look(unit),
            (true, true) => format!("{}, and the pad's distance is in mm: {plane}", look(unit)),
            (false, _) => format!("the pad's distance is in mm, whatever the unit of the values: {plane}"),
        })
    }
}

/// No set's deepest press is less than this, mm: presses of some millimetres, a thousand times too small, are.
const INVISIBLE_MM: f64 = 3e-3;

/// A length to a micrometre, without zeros at its end.
fn rounded(mm: f64) -> f64 {
    (mm * 1e3).round() / 1e3
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frames::camera::{Along, Projection};
    use gelsim_core::base::grid::Grid;

    fn camera(unit: Unit, plane_mm: f64) -> DepthCamera {
        DepthCamera {
            unit,
            plane_mm,
            max_depth_mm: None,
            background: None,
            flip: [false; 2],
            offset_px: [0.0; 2],
            projection: Projection::Orthographic,
            along: Along::Axis,
        }
    }

    fn reach(above_mm: &[f32]) -> Reach {
        let above_mm = Grid { width: above_mm.len(), height: 1, data: above_mm.to_vec() };
        Reach::from_surface(&Heights { above_mm, unseen_px: 0 }, 3.0)
    }

    #[test]
    fn a_press_is_no_mistake_even_where_it_goes_through() {
        let pressed = reach(&[-0.5, 4.0, f32::INFINITY]);
        assert!(pressed.touches() && pressed.mistake(&camera(Unit::Millimetre, 10.0)).is_none());
        let through = reach(&[-3.5, -0.1]);
        assert_eq!((through.through_px, through.mistake(&camera(Unit::Millimetre, 10.0))), (1, None));
        assert!(!reach(&[0.0, f32::INFINITY]).touches());
    }

    #[test]
    fn metres_taken_for_millimetres_are_all_behind_the_pad_and_the_unit_is_named() {
        // 9.5 mm and 50 mm in metres.
        let wrong = camera(Unit::Millimetre, 10.0);
        let problem = reach(&[0.0095 - 10.0, 0.05 - 10.0]).mistake(&wrong).expect("a mistake");
        assert!(problem.message.contains("behind the pad"), "{}", problem.message);
        assert_eq!(problem.help.as_deref(), Some("the values look like metres: --depth-unit m"));
        // Millimetres taken for metres are far away.
        let problem = reach(&[9500.0 - 10.0]).out_of_reach(&camera(Unit::Metre, 10.0));
        assert!(problem.message.ends_with("the nearest point is 9490 mm beyond it"), "{}", problem.message);
        assert!(problem.help.is_some_and(|help| help.starts_with("the values look like millimetres: --depth-unit mm")));
    }

    #[test]
    fn a_plane_in_metres_is_told_from_values_in_another_unit() {
        let help = |above_mm: &[f32], unit, plane_mm| {
            reach(above_mm).out_of_reach(&camera(unit, plane_mm)).help.unwrap_or_default()
        };
        // 9 mm in metres, and the plane at 10 mm given as 0.01.
        assert!(help(&[9.0 - 0.01, 30.0], Unit::Metre, 0.01).contains("--plane-mm 10"));
        assert!(!help(&[9.0 - 0.01, 30.0], Unit::Metre, 0.01).contains("--depth-unit"));
        // The same in mm, and said to be so.
        assert!(help(&[9.0 - 0.01, 30.0], Unit::Millimetre, 0.01).contains("--plane-mm 10"));
        // Followed by the wrong advice: a press of a micrometre is none.
        let both = reach(&[-0.001, 0.02]);
        assert!(both.touches() && !both.is_pressed());
        let help = both.out_of_reach(&camera(Unit::Millimetre, 0.01)).help.unwrap_or_default();
        assert!(help.contains("--depth-unit m,") && help.contains("--plane-mm 10"), "{help}");
    }

    #[test]
    fn frames_that_press_or_are_just_above_the_pad_are_not_suspected() {
        for above_mm in [-0.5, 0.5, 5.0, 40.0] {
            assert_eq!(reach(&[above_mm, 60.0]).suspicion(&camera(Unit::Metre, 10.0)), None, "{above_mm}");
        }
        let wrong = reach(&[9500.0 - 10.0, 9e4]).suspicion(&camera(Unit::Metre, 10.0)).expect("millimetres");
        assert!(wrong.help.is_some_and(|help| help.contains("--depth-unit mm")));
    }

    #[test]
    fn where_no_unit_helps_the_plane_is_asked_for() {
        let wrong = camera(Unit::Millimetre, 10.0);
        let problem = reach(&[12.3, 20.0]).out_of_reach(&wrong);
        assert!(problem.message.contains("12.3 mm beyond"), "{}", problem.message);
        assert!(problem.help.is_some_and(|help| help.contains("is --plane-mm 10 right?")));
        // In millimetres it would touch, but 9 mm are no mistake of a unit.
        let problem = reach(&[8.0, 49.0]).out_of_reach(&camera(Unit::Metre, 1.0));
        assert!(problem.help.is_some_and(|help| help.contains("is --plane-mm 1 right?")));
        let problem = reach(&[-8.0, -7.0]).mistake(&wrong).expect("a mistake");
        assert!(problem.help.is_some_and(|help| help.contains("is --plane-mm 10 right?")));
        let problem = reach(&[f32::INFINITY]).out_of_reach(&wrong);
        assert!(problem.help.is_some_and(|help| help.contains("--max-depth-mm")));
    }
}
