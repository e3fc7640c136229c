//! A millionth in, how much out? No number of a press may make the image flicker.
//!
//! Lengths are moved by 1e-6 mm, angles by 1e-6 rad, Young's modulus and Poisson ratio by 1e-6 of themselves. Noise and
//! jitter are left out: the sample's number decides them. A pixel shows the object at its centre, so where an edge
//! crosses a pixel centre, depth jumps whatever one does: such pixels are counted.

use gelsim_core::fidelity::Fidelity;

use super::press::{Change, Extras, GENERIC, Numbers, Setting};

/// A millionth of a radian, degrees.
const MICRORADIAN_DEG: f64 = 1e-6 * 57.295_779_513_082_32;

/// A number, the jobs that have it, and how it is moved.
type Nudge = (&'static str, Extras, fn(&mut Numbers));

const NUDGES: [Nudge; 17] = [
    ("depth", Extras::None, |n| n.depth_mm += 1e-6),
    ("x", Extras::None, |n| n.x_mm += 1e-6),
    ("y", Extras::None, |n| n.y_mm += 1e-6),
    ("yaw", Extras::None, |n| n.yaw_deg += MICRORADIAN_DEG),
    ("tilt", Extras::None, |n| n.tilt_deg += MICRORADIAN_DEG),
    ("tilt azimuth", Extras::None, |n| n.tilt_azimuth_deg += MICRORADIAN_DEG),
    ("Young's modulus", Extras::None, |n| n.youngs_modulus_kpa *= 1.0 + 1e-6),
    ("Poisson ratio", Extras::None, |n| n.poisson_ratio *= 1.0 + 1e-6),
    ("thickness", Extras::None, |n| n.thickness_mm += 1e-6),
    ("LED azimuth", Extras::None, |n| n.led_azimuth_deg += MICRORADIAN_DEG),
    ("LED elevation", Extras::None, |n| n.led_elevation_deg += MICRORADIAN_DEG),
    ("texture amplitude", Extras::All, |n| n.texture_amplitude_mm += 1e-6),
    ("texture scale", Extras::All, |n| n.texture_scale_mm += 1e-6),
    ("texture angle", Extras::All, |n| n.texture_angle_deg += MICRORADIAN_DEG),
    ("marker pitch", Extras::All, |n| n.marker_pitch_mm += 1e-6),
    ("shift", Extras::All, |n| n.shift_mm += 1e-6),
    ("twist", Extras::All, |n| n.twist_deg += MICRORADIAN_DEG),
];

/// Nowhere special either.
const ELSEWHERE: Numbers =
    Numbers { depth_mm: 0.3377, x_mm: -1.773, y_mm: 0.9171, yaw_deg: 71.33, led_azimuth_deg: 33.1, ..GENERIC };

const NO_SHADOWS: &str = "optics.phong.shadows = 'none'\n";

/// The most that any nudge of a press changes.
fn largest_change(setting: &Setting<'_>, numbers: &Numbers) -> Change {
    let base = setting.press(numbers);
    // Rubber at finite strain takes a hundred times as long.
    let few = setting.level == Fidelity::FiniteStrain && !crate::thorough();
    let nudged = NUDGES.iter().filter(|(_, needs, _)| *needs == Extras::None || setting.extras == Extras::All);
    let nudged = nudged.step_by(if few { 6 } else { 1 });
    nudged.fold(Change::default(), |most, (_, _, nudge)| {
        let mut moved = *numbers;
        nudge(&mut moved);
        most.or(base.change(&setting.press(&moved)))
    })
}

#[test]
fn a_millionth_more_of_anything_does_not_show() {
    let objects: [&[&str]; 2] = match crate::thorough() {
        true => [&["sphere", "cone", "torus", "cube", "coin"], &["sphere", "cube", "coin"]],
        false => [&["sphere", "cube"], &["coin"]],
    };
    for level in Fidelity::ALL {
        let mut all = Change::default();
        let few = level == Fidelity::FiniteStrain && !crate::thorough();
        for (extras, objects) in [Extras::None, Extras::All].into_iter().zip(objects) {
            for object in objects.iter().take(if few { usize::from(extras == Extras::All) } else { objects.len() }) {
                let setting = Setting { object, level, extras, more: NO_SHADOWS, ..Setting::default() };
                let change = largest_change(&setting, &GENERIC).or(match extras {
                    Extras::None if !few && (crate::thorough() || *object == "cube") => {
                        largest_change(&setting, &ELSEWHERE)
                    }
                    _ => Change::default(),
                });
                assert_eq!(change.flipped_px, 0, "{object}, {level:?}, {extras:?}: no edge is near a pixel centre");
                // At finite strain, nodes under a wall may take or leave the contact within the tolerance.
                let is_wall = level == Fidelity::FiniteStrain && extras == Extras::None && *object == "coin";
                let (most_um, most_light, most_levels) = if is_wall { (15.0, 1.7, 2) } else { (0.3, 0.1, 1) };
                assert!(change.surface_um < most_um, "{object}, {level:?}, {extras:?}: {change:?}");
                assert!(change.light_levels < most_light, "{object}, {level:?}, {extras:?}: {change:?}");
                assert!(change.image_levels <= most_levels, "{object}, {level:?}, {extras:?}: {change:?}");
                // Rubber is solved within a micrometre: values on the brink of a level take the other one.
                let most = if level == Fidelity::FiniteStrain { 5e-3 } else { 1e-3 };
                assert!(change.image_share < most, "{object}, {level:?}, {extras:?}: {change:?}");
                all = all.or(change);
            }
        }
        println!("a millionth, {level:?}: {all:?}");
    }
}

#[test]
fn a_millionth_more_of_anything_moves_no_shadow_but_in_single_pixels() {
    // Where two obstacles are as high over a ray, the nearer one takes over, and how soft its shadow is jumps.
    for level in [Fidelity::Draft, Fidelity::Standard, Fidelity::High] {
        let mut all = Change::default();
        for object in ["sphere", "cone", "torus", "cube", "coin"] {
            let setting = Setting { object, level, ..Setting::default() };
            let change = largest_change(&setting, &GENERIC).or(largest_change(&setting, &ELSEWHERE));
            assert!(change.light_levels < 8.0 && change.light_share < 1e-3, "{object}, {level:?}: {change:?}");
            assert!(change.image_share < 2e-3, "{object}, {level:?}: {change:?}");
            all = all.or(change);
        }
        println!("a millionth, shadows, {level:?}: {all:?}");
    }
}

#[test]
fn an_edge_that_crosses_pixel_centres_moves_by_a_row_of_pixels() {
    // The sides of a cube of 5 mm lie on pixel centres: 20 of them on each.
    for level in Fidelity::ALL {
        let setting = Setting { level, object: "cube", more: NO_SHADOWS, ..Setting::default() };
        let numbers = |x_mm: f64| Numbers { x_mm, y_mm: 0.0, yaw_deg: 0.0, tilt_deg: 0.0, ..GENERIC };
        for x_mm in [0.125 - 1e-6, 0.125] {
            let change = setting.press(&numbers(x_mm)).change(&setting.press(&numbers(x_mm + 1e-6)));
            println!("an edge on pixel centres, {level:?}, from {x_mm}: {change:?}");
            assert_eq!(change.flipped_px, 20, "{level:?}, {x_mm}");
            // On the grid of draft the row may be one of its own, four pixels wide.
            assert!(change.light_share < 0.7, "{level:?}, {x_mm}: {change:?}");
        }
    }
}
