//! Presses with what an elastic layer of Young's modulus 1 would answer to them, and what relaxation takes from that.
//!
//! While the contact does not shrink, the force of a viscoelastic layer is (Lee and Radok 1960)
//!
//! F(t) = E [f(t) - sum over modes of share * integral over s of (1 - exp(-(t - s) / time)) df(s)],
//!
//! where f is the force at Young's modulus 1 on an elastic layer that is pressed equally deep. Between two rows the
//! depth changes at a constant speed. The first row of a press counts as pressed at once.

use std::sync::Arc;

use rayon::prelude::*;

use super::contact_curve::{ContactCurve, ForceIndenter};
use super::table::ForceTable;
use gelsim_core::gelpad::elastic::relaxation::RelaxationMode;
use gelsim_core::gelpad::material::Material;

/// Depth over the deepest so far below which the contact counts as shrinking. Radii of contacts are noisy, and the
/// depth goes with their square.
const SHRINKS_BELOW: f64 = 0.85;
/// Depth over the deepest from which on rows belong to the hold.
const HOLD_FROM: f64 = 0.9;
/// Change of depth, over the deepest, in one step of the integral.
const STEP_SHARE: f64 = 0.03;
/// Most steps of the integral between two rows.
const MAX_STEPS: f64 = 32.0;
/// Depth over the deepest in the table to which contacts are solved, as room for an unknown zero.
const ROOM: f64 = 1.3;

/// A moment of a press.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moment {
    /// The row's line in the table.
    pub line: u64,
    /// Time, s; 0 if it is not known.
    pub time_s: f64,
    /// Depth, mm: the measured one, or that which the radius of the contact tells.
    pub depth_mm: f64,
    /// True if the depth was measured, so that its zero may be off.
    pub is_measured: bool,
    /// Radius of the contact, mm, if it was measured.
    pub contact_radius_mm: Option<f64>,
    /// Measured normal force, N.
    pub force_n: f64,
    /// Tangential displacement and force, mm and N.
    pub shear: (Option<f64>, Option<f64>),
}

impl Moment {
    /// Depth where the measured ones are too small by `zero_mm`, mm.
    pub fn depth_at_zero(&self, zero_mm: f64) -> f64 {
        if self.is_measured { (self.depth_mm + zero_mm).max(0.0) } else { self.depth_mm }
    }
}

/// A press, ready to be fitted or simulated.
#[derive(Clone, Debug)]
pub struct Motion {
    /// Name in the table.
    pub name: String,
    /// How force grows with depth.
    pub curve: Arc<ContactCurve>,
    /// Rows up to the deepest and the hold after it; at least one.
    pub moments: Vec<Moment>,
    /// All rows, for friction, which needs no history of the depth.
    pub all_moments: Vec<Moment>,
    /// True if the times are known.
    pub has_times: bool,
    /// Rows whose contact is larger than any in this pad.
    pub too_wide: usize,
}

/// A table with the contacts that it needs.
#[derive(Clone, Debug)]
pub struct Motions {
    /// Presses in the order of the table.
    pub motions: Vec<Motion>,
    /// The layer, with Young's modulus 1.
    pub material: Material,
    /// True if the table has times.
    pub has_times: bool,
    /// True if the table has tangential forces.
    pub has_shear: bool,
}

impl Motions {
    /// Solves for the contacts of a table's indenters in a pad. Its Young's modulus does not matter.
    pub fn new(table: &ForceTable, material: Material) -> Self {
        let mut indenters: Vec<(ForceIndenter, f64)> = Vec::new();
        for press in &table.presses {
            let deepest = press.rows.iter().map(|row| {
                let of_radius = row.contact_radius_mm.map_or(0.0, |mm| mm * mm / press.indenter.radius_mm());
                row.depth_mm.unwrap_or(of_radius)
            });
            let deepest_mm = ROOM * deepest.fold(0.0, f64::max);
            match indenters.iter_mut().find(|(indenter, _)| *indenter == press.indenter) {
                Some((_, deepest)) => *deepest = deepest.max(deepest_mm),
                None => indenters.push((press.indenter, deepest_mm)),
            }
        }
        let curves: Vec<Arc<ContactCurve>> = indenters
            .par_iter()
            .map(|(indenter, deepest_mm)| Arc::new(ContactCurve::new(*indenter, &material, *deepest_mm)))
            .collect();
        let motions = table.presses.iter().map(|press| {
            let curve =
                curves.iter().find(|curve| curve.indenter() == press.indenter).expect("every indenter is solved");
            let mut too_wide = 0;
            let all_moments: Vec<Moment> = press
                .rows
                .iter()
                .map(|row| {
                    let of_radius = |mm: f64| {
                        curve.depth_for_radius_mm(mm).unwrap_or_else(|| {
                            too_wide += 1;
                            curve.deepest_mm()
                        })
                    };
                    let depth_mm = row.depth_mm.or_else(|| row.contact_radius_mm.map(of_radius));
                    Moment {
                        line: row.line,
                        time_s: row.time_s.unwrap_or(0.0),
                        depth_mm: depth_mm.unwrap_or(0.0),
                        is_measured: row.depth_mm.is_some(),
                        contact_radius_mm: row.contact_radius_mm,
                        force_n: row.force_n,
                        shear: (row.shear_mm, row.shear_force_n),
                    }
                })
                .collect();
            let moments = all_moments[..count_until_shrinking(&all_moments)].to_vec();
            let has_times = press.rows.iter().all(|row| row.time_s.is_some());
            Motion { name: press.name.clone(), curve: Arc::clone(curve), moments, all_moments, has_times, too_wide }
        });
        Self { motions: motions.collect(), material, has_times: table.has_times, has_shear: table.has_shear }
    }

    /// Greatest measured depth, mm; 0 if none was measured.
    pub fn deepest_measured_mm(&self) -> f64 {
        let moments = self.motions.iter().flat_map(|motion| &motion.moments);
        moments.filter(|moment| moment.is_measured).map(|moment| moment.depth_mm).fold(0.0, f64::max)
    }

    /// Number of rows that are left out because the contact shrinks there.
    pub fn left_out(&self) -> usize {
        self.motions.iter().map(|motion| motion.all_moments.len() - motion.moments.len()).sum()
    }
}

/// Returns how many rows there are up to the deepest and the hold after it.
fn count_until_shrinking(moments: &[Moment]) -> usize {
    let deepest = moments.iter().map(|moment| moment.depth_mm).fold(0.0, f64::max);
    let mut so_far = 0.0_f64;
    let shrinks = moments.iter().position(|moment| {
        so_far = so_far.max(moment.depth_mm);
        so_far > 0.1 * deepest && moment.depth_mm < SHRINKS_BELOW * so_far
    });
    let kept = &moments[..shrinks.unwrap_or(moments.len())];
    let deepest = kept.iter().map(|moment| moment.depth_mm).fold(0.0, f64::max);
    kept.iter().rposition(|moment| moment.depth_mm >= HOLD_FROM * deepest).map_or(kept.len(), |last| last + 1).max(1)
}

impl Motion {
    /// Greatest depth, mm.
    pub fn deepest_mm(&self, zero_mm: f64) -> f64 {
        self.moments.iter().map(|moment| moment.depth_at_zero(zero_mm)).fold(0.0, f64::max)
    }

    /// Largest measured force, N.
    pub fn largest_force_n(&self) -> f64 {
        self.moments.iter().map(|moment| moment.force_n).fold(0.0, f64::max)
    }

    /// Times for which the press is held near its deepest, s; 0 without such a hold of at least three rows.
    pub fn hold_s(&self) -> f64 {
        let deepest = self.deepest_mm(0.0);
        let Some(first) = self.moments.iter().position(|moment| moment.depth_mm >= HOLD_FROM * deepest) else {
            return 0.0;
        };
        match &self.moments[first..] {
            [first, _, .., last] if self.has_times => last.time_s - first.time_s,
            _ => 0.0,
        }
    }

    /// Duration, s.
    pub fn duration_s(&self) -> f64 {
        match (self.moments.first(), self.moments.last()) {
            (Some(first), Some(last)) if self.has_times => last.time_s - first.time_s,
            _ => 0.0,
        }
    }

    /// Returns how the force at Young's modulus 1 grows, where measured depths are too small by `zero_mm`.
    pub fn history(&self, zero_mm: f64) -> History {
        let mut history =
            History { elastic: Vec::with_capacity(self.moments.len()), steps: Vec::new(), ends: Vec::new() };
        let largest = self.deepest_mm(zero_mm).max(f64::MIN_POSITIVE);
        let mut before: Option<(f64, f64, f64)> = None;
        for moment in &self.moments {
            let depth_mm = moment.depth_at_zero(zero_mm);
            let force = self.curve.force(depth_mm);
            match before {
                None => history.steps.push((0.0, force)),
                Some((last_mm, last_s, mut last_force)) => {
                    let change = (depth_mm - last_mm).abs() / largest;
                    let count = (change / STEP_SHARE).ceil().clamp(1.0, MAX_STEPS);
                    for k in 1..=count as u32 {
                        let share = f64::from(k) / count;
                        let reached = if f64::from(k) == count {
                            force
                        } else {
                            self.curve.force(last_mm + share * (depth_mm - last_mm))
                        };
                        history.steps.push(((moment.time_s - last_s) / count, reached - last_force));
                        last_force = reached;
                    }
                }
            }
            before = Some((depth_mm, moment.time_s, force));
            history.elastic.push(force);
            history.ends.push(history.steps.len());
        }
        history
    }

    /// Returns the normal forces at the moments of a pad with a Young's modulus, kPa, and a relaxation, N.
    pub fn forces_n(&self, youngs_modulus_kpa: f64, relaxation: &[RelaxationMode], zero_mm: f64) -> Vec<f64> {
        let history = self.history(zero_mm);
        let mut forces = history.elastic.clone();
        if self.has_times {
            for mode in relaxation {
                for (force, relaxed) in forces.iter_mut().zip(history.relaxed(mode.time_s)) {
                    *force -= mode.share * relaxed;
                }
            }
        }
        forces.iter().map(|force| 1e-3 * youngs_modulus_kpa * force).collect()
    }
}

/// How the force at Young's modulus 1 grows in a press.
#[derive(Clone, Debug)]
pub struct History {
    /// Force on an elastic layer at the moments, mm^2.
    pub elastic: Vec<f64>,
    /// Durations, s, and changes of the elastic force, mm^2.
    steps: Vec<(f64, f64)>,
    /// Number of steps until each moment.
    ends: Vec<usize>,
}

impl History {
    /// Returns what a mode of share 1 takes from the force until each moment, mm^2.
    pub fn relaxed(&self, time_s: f64) -> Vec<f64> {
        // What is left of past changes, each faded by the time since.
        let (mut left, mut done) = (0.0, 0);
        let relaxed = self.elastic.iter().zip(&self.ends).map(|(elastic, end)| {
            for (duration, change) in &self.steps[done..*end] {
                let x = duration / time_s;
                let fade = libm::exp(-x);
                // The mean of the fading over a step at constant speed.
                let mean = if x < 1e-6 { 1.0 - 0.5 * x } else { -libm::expm1(-x) / x };
                left = left * fade + change * mean;
            }
            done = *end;
            elastic - left
        });
        relaxed.collect()
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::calibrate::force::table;

    const PAD: Material = Material { thickness_mm: 3.0, youngs_modulus_kpa: 1.0, poisson_ratio: 0.48 };

    fn motions(rows: &str) -> Motions {
        let text = format!("press,ball_radius_mm,depth_mm,force_n,time_s\n{rows}");
        Motions::new(&table::parse(Path::new("t.csv"), text.as_bytes()).expect("a table"), PAD)
    }

    #[test]
    fn rows_after_the_hold_are_left_out() {
        let found = motions("a,4,0,0,0\na,4,0.3,1,1\na,4,0.29,0.9,2\na,4,0.1,0.2,3\na,4,0.4,2,4\nb,4,0.2,0.5,0\n");
        assert_eq!(found.motions[0].moments.len(), 3);
        assert_eq!((found.left_out(), found.motions[1].moments.len()), (2, 1));
        assert_eq!((found.motions[0].hold_s(), found.motions[1].hold_s()), (0.0, 0.0));
    }

    #[test]
    fn a_step_that_is_held_relaxes_as_its_modes_say() {
        let rows: String = (0..50).map(|k| format!("a,4,0.3,1,{}\n", 0.1 * f64::from(k))).collect();
        let found = motions(&rows);
        let modes = [RelaxationMode { share: 0.3, time_s: 0.5 }, RelaxationMode { share: 0.2, time_s: 3.0 }];
        let forces = found.motions[0].forces_n(100.0, &modes, 0.0);
        for (k, force) in forces.iter().enumerate() {
            let t = 0.1 * k as f64;
            let expected = 1.0 - 0.3 * (1.0 - (-t / 0.5_f64).exp()) - 0.2 * (1.0 - (-t / 3.0_f64).exp());
            assert!((force / forces[0] - expected).abs() < 1e-9, "{t}: {force}");
        }
        assert!(found.motions[0].hold_s() > 4.8);
    }

    #[test]
    fn ramps_between_few_rows_are_integrated_well() {
        let few = motions("a,4,0,0,0\na,4,0.3,1,2\n");
        let rows: String =
            (0..=400).map(|k| format!("a,4,{},1,{}\n", 0.3 * f64::from(k) / 400.0, f64::from(k) / 200.0)).collect();
        let many = motions(&rows);
        let modes = [RelaxationMode { share: 0.5, time_s: 0.4 }];
        let ends = [few, many].map(|m| *m.motions[0].forces_n(100.0, &modes, 0.0).last().expect("a row"));
        assert!((ends[0] / ends[1] - 1.0).abs() < 1e-3, "{ends:?}");
    }
}
