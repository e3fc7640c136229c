//! Logarithmic axes: their range, the pixels of values, and their ticks.

/// A logarithmic axis over pixels. It stores powers of ten instead of values, which could overflow.
#[derive(Clone, Copy, Debug)]
pub struct Axis {
    low: f64,
    high: f64,
    start_px: f64,
    end_px: f64,
}

/// A value with a line across the plot.
#[derive(Clone, Debug, PartialEq)]
pub struct Tick {
    /// Position, pixels.
    pub px: f64,
    /// Label; none at lines that only guide the eye.
    pub label: Option<String>,
    /// Whether it is a power of ten.
    pub decade: bool,
}

/// Returns true if `value` can be shown on a logarithmic axis.
pub fn has_place(value: f64) -> bool {
    value > 0.0 && value.is_finite()
}

impl Axis {
    /// Creates an axis from pixel `start_px` to `end_px` that shows all `values` above 0 (1 to 10 if there is none). It
    /// is at least `least` decades long, and leaves the shares `room` of its length free at its ends.
    pub fn from_values(
        values: impl Iterator<Item = f64>,
        least: f64,
        room: [f64; 2],
        [start_px, end_px]: [f64; 2],
    ) -> Self {
        let powers = values.filter(|value| has_place(*value)).map(libm::log10);
        let (mut low, mut high) = powers.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)));
        if low > high {
            (low, high) = (0.0, 1.0);
        }
        let missing = (least - (high - low)).max(0.0);
        (low, high) = (low - missing / 2.0, high + missing / 2.0);
        let length = (high - low) / (1.0 - room[0] - room[1]);
        Self { low: low - room[0] * length, high: high + room[1] * length, start_px, end_px }
    }

    /// Pixel of `value`, which must be above 0 and finite.
    pub fn value_px(&self, value: f64) -> f64 {
        self.power_px(libm::log10(value))
    }

    fn power_px(&self, power: f64) -> f64 {
        self.start_px + (power - self.low) / (self.high - self.low) * (self.end_px - self.start_px)
    }

    /// Returns the ticks from the lowest on, with at most a dozen labels, powers of ten first.
    pub fn ticks(&self) -> Vec<Tick> {
        let decades = self.high - self.low;
        let step = (decades / 10.0).ceil().max(1.0) as i32;
        // On a short axis powers of ten alone would be too few labels, so 2 and 5 have labels, too.
        let (lines, named): (&[u8], &[u8]) = match decades {
            d if d <= 4.0 => (&[2, 3, 4, 5, 6, 7, 8, 9], &[2, 5]),
            d if d <= 10.0 => (&[2, 3, 4, 5, 6, 7, 8, 9], &[]),
            _ => (&[], &[]),
        };
        let mut ticks = Vec::new();
        for decade in self.low.floor() as i32..=self.high.floor() as i32 {
            let mut tick = |digit: u8, named: bool| {
                let power = f64::from(decade) + libm::log10(f64::from(digit));
                if (self.low..=self.high).contains(&power) {
                    let label = named.then(|| format_power_of_ten(digit, decade));
                    ticks.push(Tick { px: self.power_px(power), label, decade: digit == 1 });
                }
            };
            if decade.rem_euclid(step) == 0 {
                tick(1, true);
            }
            lines.iter().for_each(|digit| tick(*digit, named.contains(digit)));
        }
        ticks
    }
}

/// Formats `digit` times ten to the power of `decade`.
fn format_power_of_ten(digit: u8, decade: i32) -> String {
    match decade {
        0..=5 => format!("{digit}{}", "0".repeat(decade as usize)),
        -4..0 => format!("0.{}{digit}", "0".repeat((-decade - 1) as usize)),
        _ => format!("{digit}e{decade}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_ticks_are_powers_of_ten_and_on_short_axes_two_and_five() {
        let names = |low: f64, high: f64| -> Vec<String> {
            let axis = Axis::from_values([low, high].into_iter(), 0.0, [0.0, 0.0], [0.0, 100.0]);
            axis.ticks().into_iter().filter_map(|tick| tick.label).collect()
        };
        assert_eq!(names(0.015, 3.0), ["0.02", "0.05", "0.1", "0.2", "0.5", "1", "2"]);
        assert_eq!(names(0.00002, 3.0), ["0.0001", "0.001", "0.01", "0.1", "1"]);
        assert_eq!(names(1e-300, 1e300).len(), 11);
    }

    #[test]
    fn an_axis_shows_what_has_a_place_and_leaves_room() {
        let values = [10.0, 1000.0, 0.0, -1.0, f64::NAN, f64::INFINITY];
        let axis = Axis::from_values(values.into_iter(), 1.0, [0.1, 0.3], [0.0, 100.0]);
        assert!((axis.value_px(10.0) - 10.0).abs() < 1e-9 && (axis.value_px(1000.0) - 70.0).abs() < 1e-9);
        let single = Axis::from_values([5.0].into_iter(), 1.0, [0.0, 0.0], [80.0, 0.0]);
        assert!((single.value_px(5.0) - 40.0).abs() < 1e-9);
    }
}
