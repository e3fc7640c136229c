//! Coverage: the space of presses divided into cells of class, depth, place and tilt, and the number of samples in
//! each.

use gelsim_files::sensor::quantity::Quantity;

/// A range cut into equal parts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bins {
    /// Lower end.
    pub from: f64,
    /// Upper end.
    pub to: f64,
    /// Parts, at least 1.
    pub count: usize,
}

impl Bins {
    /// Covers the range of a distribution's values and of `values`.
    pub fn from_values(distribution: &Quantity, values: impl Iterator<Item = f64>, count: usize) -> Self {
        let (min, max) = distribution.support();
        let ends = [min, max].into_iter().filter(|end| end.is_finite()).chain(values);
        let (from, to) = ends.fold((f64::INFINITY, f64::NEG_INFINITY), |(from, to), v| (from.min(v), to.max(v)));
        if from < to {
            Self { from, to, count }
        } else {
            // A single value, or none: one part holds everything.
            Self { from, to: from, count: 1 }
        }
    }

    /// Returns the part that a value is in; values outside belong to the nearest part.
    pub fn index(&self, value: f64) -> usize {
        let at = (value - self.from) / (self.to - self.from) * self.count as f64;
        (at.max(0.0) as usize).min(self.count - 1)
    }

    /// Ends of a part.
    pub fn part_bounds(&self, part: usize) -> [f64; 2] {
        [part, part + 1].map(|k| self.from + (self.to - self.from) * k as f64 / self.count as f64)
    }
}

/// Features of a press that decide its cell.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PressFeatures<'a> {
    /// Class, or object if there are no classes.
    pub class: Option<&'a str>,
    /// Depth, mm.
    pub depth_mm: Option<f64>,
    /// Position, mm from the middle of the image.
    pub place_mm: [Option<f64>; 2],
    /// Tilt, degrees.
    pub tilt_deg: Option<f64>,
}

/// Cells by which presses are told apart. Features without bins do not count.
#[derive(Clone, Debug, PartialEq)]
pub struct CoverageCells {
    /// Classes, sorted.
    pub classes: Vec<String>,
    /// Bins of the depth, mm.
    pub depth: Option<Bins>,
    /// Bins of x and y, mm.
    pub place: Option<[Bins; 2]>,
    /// Bins of the tilt's size, degrees.
    pub tilt: Option<Bins>,
}

impl CoverageCells {
    /// Number of cells.
    pub fn count(&self) -> usize {
        let [x, y] = self.place.map_or([1, 1], |place| place.map(|bins| bins.count));
        let of = |bins: Option<Bins>| bins.map_or(1, |bins| bins.count);
        self.classes.len().max(1) * of(self.depth) * x * y * of(self.tilt)
    }

    /// Returns the cell of a press; none if a feature that counts is not known.
    pub fn index(&self, press: &PressFeatures<'_>) -> Option<usize> {
        let mut cell = if self.classes.is_empty() {
            0
        } else {
            let wanted = press.class?;
            self.classes.binary_search_by(|class| class.as_str().cmp(wanted)).ok()?
        };
        let mut add = |bins: &Option<Bins>, value: Option<f64>| {
            if let Some(bins) = bins {
                cell = cell * bins.count + bins.index(value?);
            }
            Some(())
        };
        add(&self.depth, press.depth_mm)?;
        let [x, y] = self.place.map_or([None; 2], |place| place.map(Some));
        add(&x, press.place_mm[0])?;
        add(&y, press.place_mm[1])?;
        add(&self.tilt, press.tilt_deg.map(f64::abs))?;
        Some(cell)
    }

    /// Describes a cell in words.
    pub fn describe_cell(&self, mut cell: usize) -> String {
        let mut parts = Vec::new();
        let [x, y] = self.place.map_or([None; 2], |place| place.map(Some));
        for (what, bins, unit) in
            [("tilt", self.tilt, "degrees"), ("y", y, "mm"), ("x", x, "mm"), ("depth", self.depth, "mm")]
        {
            if let Some(bins) = bins {
                let [from, to] = bins.part_bounds(cell % bins.count).map(gelsim_files::number_format::format_number);
                parts.push(format!("{what} {from} to {to} {unit}"));
                cell /= bins.count;
            }
        }
        parts.extend(self.classes.get(cell).cloned());
        parts.reverse();
        parts.join(", ")
    }
}

/// Fraction of the cells that count which have a sample; 1 if none counts.
pub fn covered_fraction(counts: &[u64], counting: &[bool]) -> f64 {
    let all = counting.iter().filter(|counts| **counts).count();
    let reached = counts.iter().zip(counting).filter(|(count, counting)| **counting && **count > 0).count();
    if all == 0 { 1.0 } else { reached as f64 / all as f64 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_numbered_without_gaps_and_named_by_what_is_in_them() {
        let bins = |from, to, count| Bins { from, to, count };
        let cells = CoverageCells {
            classes: vec![String::from("ball"), String::from("nut")],
            depth: Some(bins(0.0, 1.0, 2)),
            place: Some([bins(-3.0, 3.0, 3), bins(-1.0, 1.0, 2)]),
            tilt: None,
        };
        let mut seen = vec![0; cells.count()];
        for class in ["ball", "nut"] {
            for depth in [0.1, 0.9] {
                for (x, y) in [(-2.0, -0.5), (0.0, -0.5), (9.0, -0.5), (-9.0, 0.5), (0.0, 0.5), (2.0, 7.0)] {
                    let press = PressFeatures {
                        class: Some(class),
                        depth_mm: Some(depth),
                        place_mm: [Some(x), Some(y)],
                        tilt_deg: None,
                    };
                    seen[cells.index(&press).expect("all is known")] += 1;
                }
            }
        }
        assert_eq!(seen, [1; 24]);
        assert_eq!(cells.index(&PressFeatures { class: Some("ball"), ..PressFeatures::default() }), None);
        assert_eq!(
            cells.index(&PressFeatures { class: Some("cube"), depth_mm: Some(0.0), ..PressFeatures::default() }),
            None
        );
        assert_eq!(cells.describe_cell(0), "ball, depth 0 to 0.5 mm, x -3 to -1 mm, y -1 to 0 mm");
        assert_eq!(cells.describe_cell(23), "nut, depth 0.5 to 1 mm, x 1 to 3 mm, y 0 to 1 mm");
    }

    #[test]
    fn coverage_is_the_fraction_of_the_cells_that_count() {
        assert_eq!(covered_fraction(&[0, 2, 0, 7], &[true, true, false, false]), 0.5);
        assert_eq!(covered_fraction(&[3], &[false]), 1.0);
    }

    #[test]
    fn a_value_outside_the_range_is_in_the_part_next_to_it() {
        let bins = Bins::from_values(&Quantity::uniform(0.2, 1.0), [0.1, 0.5].into_iter(), 3);
        assert_eq!((bins.from, bins.to), (0.1, 1.0));
        assert_eq!([-5.0, 0.1, 0.39, 0.41, 1.0, 9.0].map(|value| bins.index(value)), [0, 0, 0, 1, 2, 2]);
        assert_eq!(Bins::from_values(&Quantity::Constant(0.5), std::iter::empty(), 4).index(0.7), 0);
    }
}
