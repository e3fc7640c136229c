//! Checks units: whether view, balls and discs have plausible sizes, and which other unit would make them plausible.

use std::ops::Range;

use super::super::{Geometry, Session};
use crate::metrics::statistics::median;
use gelsim_files::diagnostic::Diagnostic;

/// Plausible longer sides of views, mm.
const VIEWS_MM: Range<f64> = 3.0..200.0;
/// Plausible radii of balls, mm.
const BALLS_MM: Range<f64> = 0.2..50.0;
/// Plausible radii of discs over those of their balls, median over presses. Real sensors: 0.45 to 0.95.
const DISCS: Range<f64> = 0.08..1.1;
/// The ranges of view, ball and disc that another unit must give: narrower, because some unit makes almost anything
/// plausible.
const LIKELY: [Range<f64>; 3] = [5.0..60.0, 1.0..25.0, 0.2..1.0];
/// Discs so much wider than their balls come from a diameter in place of a radius, not from a unit.
const DOUBLED: Range<f64> = 1.1..3.0;
/// A ratio of widths to the named sensor's view outside this range means another sensor.
const OTHER_VIEW: Range<f64> = 0.6..1.7;

/// A unit, and the conversion of a number that was written in it.
type UnitReading = (&'static str, fn(f64) -> f64);

/// Units in which a pixel size may have been written.
const PIXELS: [UnitReading; 7] = [
    ("metres per pixel", |x| 1e3 * x),
    ("centimetres per pixel", |x| 10.0 * x),
    ("micrometres per pixel", |x| 1e-3 * x),
    ("pixels per mm", |x| 1.0 / x),
    ("pixels per metre", |x| 1e3 / x),
    ("pixels per inch", |x| 25.4 / x),
    ("inches per pixel", |x| 25.4 * x),
];
/// Units in which the radius of a ball may have been written.
const BALLS: [UnitReading; 4] =
    [("metres", |x| 1e3 * x), ("centimetres", |x| 10.0 * x), ("micrometres", |x| 1e-3 * x), ("inches", |x| 25.4 * x)];

/// Sizes of a session that are checked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SessionSizes {
    /// Pixels along the longer side of the view.
    pub longer_px: f64,
    /// Width of a pixel, mm.
    pub mm_per_px: f64,
    /// Radius of the ball, mm; median over presses.
    pub ball_mm: f64,
    /// Radius of the disc over that of the ball, per mm of pixel size; median over presses. Multiplied by the pixel
    /// size it is the ratio.
    pub disc_over_ball_per_mm: f64,
}

impl SessionSizes {
    /// Returns the sizes of a session.
    pub fn from_session(session: &Session) -> Self {
        let presses = &session.observations;
        let middle = |value: &dyn Fn(usize) -> f64| {
            median(&(0..presses.len()).map(value).collect::<Vec<_>>()).unwrap_or(f64::NAN)
        };
        Self {
            longer_px: session.camera.resolution_px.into_iter().max().unwrap_or(1) as f64,
            mm_per_px: session.camera.mm_per_px[0],
            ball_mm: middle(&|k| presses[k].ball_radius_mm),
            disc_over_ball_per_mm: middle(&|k| presses[k].circle.radius_px / presses[k].ball_radius_mm),
        }
    }

    /// Returns the longer side of the view, mm.
    fn view_mm(&self) -> f64 {
        self.longer_px * self.mm_per_px
    }

    /// Returns the radius of the disc over that of the ball.
    pub fn disc_over_ball(&self) -> f64 {
        self.disc_over_ball_per_mm * self.mm_per_px
    }

    /// Returns the sizes as they would be had pixel size and ball been written in other units.
    fn with_units(&self, pixel: fn(f64) -> f64, ball: fn(f64) -> f64) -> Self {
        let ball_mm = ball(self.ball_mm);
        // The disc was measured in pixels, so that another unit of the ball changes the ratio.
        let disc_over_ball_per_mm = self.disc_over_ball_per_mm * self.ball_mm / ball_mm;
        Self { mm_per_px: pixel(self.mm_per_px), ball_mm, disc_over_ball_per_mm, ..*self }
    }

    /// Returns the sizes with discs as wide as their contacts would usually make them, if it is known how much of a disc
    /// the contact is.
    fn with_contact(self, contact_over_disc: Option<f64>) -> Self {
        let share = contact_over_disc.map_or(1.0, |share| share / Geometry::USUAL_CONTACT);
        Self { disc_over_ball_per_mm: share * self.disc_over_ball_per_mm, ..self }
    }

    fn are_usual(&self) -> bool {
        self.are_within([VIEWS_MM, BALLS_MM, DISCS])
    }

    fn are_likely(&self) -> bool {
        self.are_within(LIKELY)
    }

    fn are_within(&self, [views, balls, discs]: [Range<f64>; 3]) -> bool {
        views.contains(&self.view_mm()) && balls.contains(&self.ball_mm) && discs.contains(&self.disc_over_ball())
    }

    /// Returns true if everything is plausible, except that discs are up to three times as wide as their balls.
    fn are_doubled(&self) -> bool {
        let [views, balls, _] = LIKELY;
        self.are_within([views, balls, DOUBLED])
    }
}

/// Checks the sizes of a session; empty if nothing is wrong. `contact_over_disc` is how much of a disc the contact is, if
/// that is given. `named` is the name of a known sensor and its view, mm.
pub fn judge_scale(
    session: &Session,
    contact_over_disc: Option<f64>,
    named: Option<(&str, [f64; 2])>,
) -> Vec<Diagnostic> {
    let sizes = SessionSizes::from_session(session).with_contact(contact_over_disc);
    let mut found = judge_sizes(&sizes);
    if let Some((name, view_mm)) = named.filter(|_| found.is_empty()) {
        let own = view_mm[0].max(view_mm[1]);
        if !OTHER_VIEW.contains(&(sizes.view_mm() / own)) {
            let message = format!(
                "the view is {} mm long, and that of {name} {} mm",
                format_value(sizes.view_mm()),
                format_value(own)
            );
            let help = "check `mm_per_px` in the table, and --sensor: stiffness, and all else that is not fitted, come from there";
            found.push(Diagnostic::warning(message).help(help));
        }
    }
    found
}

/// Checks the view of a calibration that another tool wrote. `column` names the place of its pixel size. `None` if it
/// is plausible.
pub fn judge_view(column: &str, longer_px: f64, mm_per_px: f64) -> Option<Diagnostic> {
    let view_mm = longer_px * mm_per_px;
    if VIEWS_MM.contains(&view_mm) {
        return None;
    }
    let [views, ..] = LIKELY;
    let readings = PIXELS.into_iter().map(|(unit, pixel)| (unit, pixel(mm_per_px)));
    let likely: Vec<(&str, f64)> = readings.filter(|(_, mm)| views.contains(&(longer_px * mm))).collect();
    let so = format!("the view is {} mm long", format_value(view_mm));
    let found = match likely.as_slice() {
        [] => Diagnostic::new(format!("{so}, a size that no sensor has"))
            .help(format!("check {column}: it is in mm per pixel")),
        likely => {
            let units: Vec<&str> = likely.iter().map(|(unit, _)| *unit).collect();
            let values: Vec<String> = likely.iter().map(|(_, value)| format_digits(*value, 6)).collect();
            Diagnostic::new(format!("{column} looks like {}: {so}", units.join(" or ")))
                .help(format!("write it in mm per pixel: {}", values.join(" or ")))
        }
    };
    Some(found)
}

/// Checks sizes, and names the units that would make them plausible. Empty if the sizes are plausible.
pub fn judge_sizes(sizes: &SessionSizes) -> Vec<Diagnostic> {
    if sizes.are_usual() {
        return Vec::new();
    }
    const SAME: fn(f64) -> f64 = |x| x;
    // A disc as wide as a diameter would be plausible with some other unit, too: the likelier mistake is `radius_px`,
    // so no unit is tried.
    let units = if sizes.are_doubled() { 0 } else { usize::MAX };
    let pixels = PIXELS.into_iter().take(units).filter(|(_, pixel)| sizes.with_units(*pixel, SAME).are_likely());
    let pixels: Vec<(&str, f64)> = pixels.map(|(unit, pixel)| (unit, pixel(sizes.mm_per_px))).collect();
    let balls = BALLS.into_iter().take(units).filter(|(_, ball)| sizes.with_units(SAME, *ball).are_likely());
    let balls: Vec<(&str, f64)> = balls.map(|(unit, ball)| (unit, ball(sizes.ball_mm))).collect();
    let (view, ball, disc) =
        (format_value(sizes.view_mm()), format_value(sizes.ball_mm), format_value(sizes.disc_over_ball()));
    let so = format!("the view is {view} mm long, a ball's radius {ball} mm, and the radius of a disc {disc} of that");
    let unit = |column: &str, written: f64, readings: &[(&str, f64)]| {
        let units: Vec<&str> = readings.iter().map(|(unit, _)| *unit).collect();
        let values: Vec<String> = readings.iter().map(|(_, value)| format_digits(*value, 6)).collect();
        let message = format!("`{column}` looks like {}: {so}", units.join(" or "));
        let help = format!("write `{column}` in mm: {} in place of {}", values.join(" or "), format_digits(written, 6));
        Diagnostic::new(message).help(help)
    };
    match (pixels.as_slice(), balls.as_slice()) {
        ([], []) => {}
        (pixels, []) => return vec![unit("mm_per_px", sizes.mm_per_px, pixels)],
        ([], balls) => return vec![unit("ball_radius_mm", sizes.ball_mm, balls)],
        // Either unit would explain the sizes: the column whose own size is out of range is the wrong one.
        (pixels, balls) => {
            return if VIEWS_MM.contains(&sizes.view_mm()) {
                vec![unit("ball_radius_mm", sizes.ball_mm, balls)]
            } else {
                vec![unit("mm_per_px", sizes.mm_per_px, pixels)]
            };
        }
    }
    // No single unit explains the sizes: try one for each column.
    for (pixel_unit, pixel) in PIXELS.into_iter().take(units) {
        for (ball_unit, ball) in BALLS {
            if sizes.with_units(pixel, ball).are_likely() {
                return vec![
                    unit("mm_per_px", sizes.mm_per_px, &[(pixel_unit, pixel(sizes.mm_per_px))]),
                    unit("ball_radius_mm", sizes.ball_mm, &[(ball_unit, ball(sizes.ball_mm))]),
                ];
            }
        }
    }
    let help = match sizes.disc_over_ball() {
        over if over >= DISCS.end => {
            "no press makes a disc that is wider than its ball: `radius_px` is the disc's radius, not its diameter, \
             `ball_radius_mm` the ball's, and `mm_per_px` the width of a pixel on the pad"
        }
        over if over < DISCS.start => {
            "so small a disc has no slopes to learn from: press deeper, or check `radius_px`, `ball_radius_mm` and `mm_per_px`"
        }
        _ => "check `mm_per_px`, the width of a pixel on the pad, and `ball_radius_mm`",
    };
    vec![Diagnostic::new(format!("the sizes in the table cannot be right: {so}")).help(help)]
}

fn format_value(value: f64) -> String {
    format_digits(value, 3)
}

/// Formats a number with `count` significant digits.
fn format_digits(value: f64, count: i32) -> String {
    if !value.is_finite() || value == 0.0 {
        return format!("{value}");
    }
    let places = count - 1 - value.abs().log10().floor() as i32;
    let factor = 10_f64.powi(places.abs());
    let rounded = if places >= 0 { (value * factor).round() / factor } else { (value / factor).round() * factor };
    format!("{rounded}")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 160 px, and a ball of 4 mm with discs of 15 px.
    fn sizes(mm_per_px: f64, ball_mm: f64) -> SessionSizes {
        SessionSizes { longer_px: 160.0, mm_per_px, ball_mm, disc_over_ball_per_mm: 15.0 / ball_mm }
    }

    fn said(mm_per_px: f64, ball_mm: f64) -> Vec<(String, String)> {
        judge_sizes(&sizes(mm_per_px, ball_mm))
            .into_iter()
            .map(|found| (found.full_message(), found.help.unwrap_or_default()))
            .collect()
    }

    #[test]
    fn units_that_were_mixed_up_are_named_with_the_number_to_write() {
        assert!(said(0.11625, 4.0).is_empty() && said(0.0295, 2.0).is_empty());
        for (mm_per_px, ball_mm, unit, number) in [
            (0.00011625, 4.0, "`mm_per_px` looks like metres per pixel: ", "0.11625 in place of 0.00011625"),
            (0.011625, 4.0, "`mm_per_px` looks like centimetres per pixel: ", "0.11625 in place of 0.011625"),
            (8.6, 4.0, "`mm_per_px` looks like pixels per mm: ", "0.116279 in place of 8.6"),
            (8602.0, 4.0, "`mm_per_px` looks like pixels per metre: ", "0.116252 in place of 8602"),
            (0.11625, 0.004, "`ball_radius_mm` looks like metres: ", "in mm: 4 in place of 0.004"),
            (0.11625, 0.4, "`ball_radius_mm` looks like centimetres: ", "in mm: 4 in place of 0.4"),
            (0.11625, 4000.0, "`ball_radius_mm` looks like micrometres: ", "in mm: 4 in place of 4000"),
            (0.11625, 0.1575, "`ball_radius_mm` looks like inches: ", "4.0005 in place of 0.1575"),
        ] {
            let said = said(mm_per_px, ball_mm);
            let [(message, help)] = said.as_slice() else { panic!("{mm_per_px} {ball_mm}: {said:?}") };
            assert!(message.starts_with(unit) && help.contains(number), "{mm_per_px} {ball_mm}: {message}: {help}");
        }
        // In micrometres and in pixels per inch both would do.
        let said_of = |mm_per_px: f64| said(mm_per_px, 4.0)[0].clone();
        let (message, help) = said_of(116.25);
        assert!(
            message.contains("micrometres per pixel or pixels per inch") && help.contains("0.11625 or 0.218495"),
            "{help}"
        );
        // All in metres.
        let both = said(0.00011625, 0.004);
        assert!(
            both.len() == 2 && both[0].0.contains("metres per pixel") && both[1].0.contains("metres: "),
            "{both:?}"
        );
    }

    #[test]
    fn sizes_that_no_unit_explains_are_refused_with_what_to_look_at() {
        let wide = said(0.35, 4.0);
        assert!(wide.len() == 1 && wide[0].1.contains("not its diameter"), "{wide:?}");
        let flat = said(0.11625, 30.0);
        assert!(flat.len() == 1 && flat[0].1.contains("press deeper"), "{flat:?}");
        assert_eq!(said(f64::MIN_POSITIVE, 1e300).len(), 1);
        // A disc may be wider than its ball where the contact is known to be half of it.
        assert!(judge_sizes(&sizes(0.35, 4.0).with_contact(Some(0.5))).is_empty());
        assert_eq!(judge_sizes(&sizes(0.35, 4.0).with_contact(Some(Geometry::USUAL_CONTACT))).len(), 1);
    }
}
