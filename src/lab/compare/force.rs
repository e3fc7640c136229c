//! Distances between the forces of a simulated gelpad and measured ones.

use std::path::Path;

use serde::Serialize;

use crate::calibrate::force::friction::force_ratio;
use crate::calibrate::force::judge::judge_depths;
use crate::calibrate::force::motion::{Motion, Motions};
use crate::calibrate::force::table;
use crate::text_table::TextTable;
use gelsim_dataset::encode::to_json_line;
use gelsim_files::diagnostic::{Diagnostic, Diagnostics, Report, Severity, user_error};
use gelsim_files::number_format::{format_number, format_percent};
use gelsim_files::sensor::Sensor;

/// A comparison of forces.
#[derive(Clone, Debug, Serialize)]
pub struct ForceComparison {
    /// Name of the sensor.
    pub sensor: String,
    /// What was added to measured depths, mm.
    pub zero_mm: f64,
    /// Normal forces of all presses.
    pub normal: ForceDifference,
    /// Tangential forces of all presses; null without measured ones, and for a sensor without a coefficient of
    /// friction.
    pub shear: Option<ForceDifference>,
    /// Rows that are left out because the indenter is lifted there.
    pub rows_left_out: usize,
    /// What speaks against the figures.
    #[serde(skip)]
    pub doubts: Report,
    /// Presses in the order of the table.
    pub presses: Vec<PressComparison>,
}

/// How far simulated forces are from measured ones.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ForceDifference {
    /// Number of rows.
    pub rows: usize,
    /// Largest measured force, N.
    pub measured_n: f64,
    /// Simulated force in the same row, N.
    pub simulated_n: f64,
    /// Mean of simulated less measured forces, N.
    pub bias_n: f64,
    /// Root of the mean square of the differences, N.
    pub rms_n: f64,
    /// The bias over the root of the mean square of the measured forces; null if these are 0.
    pub bias_share: Option<f64>,
    /// `rms_n` over the root of the mean square of the measured forces; null if these are 0.
    pub rms_share: Option<f64>,
}

/// A press.
#[derive(Clone, Debug, Serialize)]
pub struct PressComparison {
    /// Name in the table.
    pub name: String,
    /// Normal forces.
    pub normal: ForceDifference,
    /// Tangential forces.
    pub shear: Option<ForceDifference>,
    /// True if tangential forces were measured.
    #[serde(skip)]
    pub has_measured_shear: bool,
    /// Its rows.
    #[serde(skip)]
    pub rows: Vec<RowComparison>,
}

/// A row of the table.
#[derive(Clone, Copy, Debug)]
pub struct RowComparison {
    /// Line in the table.
    pub line: u64,
    /// Time, s, if it is known.
    pub time_s: Option<f64>,
    /// Depth, mm.
    pub depth_mm: f64,
    /// Measured and simulated normal force, N.
    pub normal_n: [f64; 2],
    /// Measured and simulated tangential force, N.
    pub shear_n: Option<[f64; 2]>,
}

impl ForceDifference {
    /// Compares pairs of measured and simulated forces. `None` without pairs.
    fn new(pairs: impl Iterator<Item = [f64; 2]>) -> Option<Self> {
        let (mut rows, mut largest) = (0, [f64::NEG_INFINITY, 0.0]);
        let (mut sum, mut square, mut measured_square) = (0.0, 0.0, 0.0);
        for [measured, simulated] in pairs {
            rows += 1;
            sum += simulated - measured;
            square += (simulated - measured) * (simulated - measured);
            measured_square += measured * measured;
            if measured > largest[0] {
                largest = [measured, simulated];
            }
        }
        let count = rows as f64;
        let whole = (measured_square / count).sqrt();
        let (bias_n, rms_n) = (sum / count, (square / count).sqrt());
        let share = |n: f64| (whole > 0.0).then(|| n / whole);
        (rows > 0).then(|| Self {
            rows,
            measured_n: largest[0],
            simulated_n: largest[1],
            bias_n,
            rms_n,
            bias_share: share(bias_n),
            rms_share: share(rms_n),
        })
    }
}

/// Compares the presses of a table with a flat sensor's gelpad. `zero_mm` is added to measured depths.
pub fn compare_forces(path: &Path, sensor: &Sensor, zero_mm: f64) -> Result<ForceComparison, Report> {
    let motions = Motions::new(&table::read(path)?, sensor.gelpad_material());
    let presses: Vec<PressComparison> =
        motions.motions.iter().map(|motion| compare_press(motion, sensor, zero_mm)).collect();
    let rows = || presses.iter().flat_map(|press| &press.rows);
    let thickness_mm = sensor.gelpad_thickness_mm;
    if let Some(through) = motions.motions.iter().find(|motion| motion.deepest_mm(zero_mm) >= thickness_mm) {
        let (name, depth) = (&through.name, format_number(through.deepest_mm(zero_mm)));
        let message = format!("press `{name}` is {depth} mm deep in a pad of {} mm", format_number(thickness_mm));
        let help = "correct depth_mm in the table, --zero-mm, or gelpad_thickness_mm in the sensor file";
        return Err(user_error(message, help));
    }
    if rows().all(|row| row.normal_n[1] == 0.0) {
        let help = "depth_mm grows into the pad, and is above 0 there; --zero-mm says where the pad begins";
        return Err(user_error("no row touches the pad", help));
    }
    let help = "leave deeper rows out, or correct gelpad_thickness_mm in the sensor file";
    let mut doubts = Diagnostics::default();
    doubts.extend(judge_depths(&motions, zero_mm).into_iter().map(|doubt| {
        let doubt = Diagnostic { severity: Severity::Warning, ..doubt };
        doubt.help(help)
    }));
    let none = ForceDifference {
        rows: 0,
        measured_n: 0.0,
        simulated_n: 0.0,
        bias_n: 0.0,
        rms_n: 0.0,
        bias_share: None,
        rms_share: None,
    };
    Ok(ForceComparison {
        sensor: sensor.name.clone(),
        zero_mm,
        normal: ForceDifference::new(rows().map(|row| row.normal_n)).unwrap_or(none),
        shear: ForceDifference::new(rows().filter_map(|row| row.shear_n)),
        rows_left_out: motions.left_out(),
        doubts: Report::new(&doubts, &[]),
        presses,
    })
}

fn compare_press(motion: &Motion, sensor: &Sensor, zero_mm: f64) -> PressComparison {
    let forces = motion.forces_n(sensor.gelpad_youngs_modulus_kpa, &sensor.gelpad_relaxation, zero_mm);
    let row = |(moment, simulated): (&crate::calibrate::force::motion::Moment, f64)| {
        let depth_mm = moment.depth_at_zero(zero_mm);
        let shear_n = sensor.gelpad_friction_coefficient.and_then(|coefficient| {
            let (shear_mm, tangential_n) = (moment.shear.0?.abs(), moment.shear.1?.abs());
            let stiffness = motion.curve.shear_stiffness_mm(depth_mm) / motion.curve.force(depth_mm);
            let pull = if stiffness.is_finite() { stiffness * shear_mm } else { 0.0 };
            Some([tangential_n, simulated * force_ratio(coefficient, pull)])
        });
        RowComparison {
            line: moment.line,
            time_s: motion.has_times.then_some(moment.time_s),
            depth_mm,
            normal_n: [moment.force_n, simulated],
            shear_n,
        }
    };
    let rows: Vec<RowComparison> = motion.moments.iter().zip(forces).map(row).collect();
    let normal = ForceDifference::new(rows.iter().map(|row| row.normal_n)).expect("a press has a row");
    let shear = ForceDifference::new(rows.iter().filter_map(|row| row.shear_n));
    let has_measured_shear = motion.moments.iter().any(|moment| moment.shear.1.is_some());
    PressComparison { name: motion.name.clone(), normal, shear, has_measured_shear, rows }
}

impl ForceComparison {
    /// Writes one line per row of the table, under a line of names. A cell is empty if nothing is known.
    pub fn to_csv(&self) -> Vec<u8> {
        let mut writer = csv::Writer::from_writer(Vec::new());
        let written = "writing to memory, and every record has as many cells";
        let names = ["press", "line", "time_s", "depth_mm", "force_n", "simulated_force_n"];
        writer.write_record(names.iter().chain(&["shear_force_n", "simulated_shear_force_n"])).expect(written);
        let cell = |value: Option<f64>| value.map_or(String::new(), |value| format!("{value:?}"));
        for press in &self.presses {
            for row in &press.rows {
                let [measured, simulated] = row.normal_n;
                let [shear, simulated_shear] = row.shear_n.map_or([None; 2], |pair| pair.map(Some));
                let figures = [row.time_s, Some(row.depth_mm), Some(measured), Some(simulated), shear, simulated_shear];
                let names = [press.name.clone(), row.line.to_string()];
                writer.write_record(names.into_iter().chain(figures.map(cell))).expect(written);
            }
        }
        writer.into_inner().expect(written)
    }

    /// Writes the figures of all presses as one line of JSON.
    pub fn to_json(&self) -> Vec<u8> {
        [to_json_line(self).as_slice(), b"\n"].concat()
    }

    /// Formats the figures, with `per_press` a line for each press, within `columns` of a terminal.
    pub fn to_text_table(&self, per_press: bool, columns: Option<usize>) -> String {
        let mut table = TextTable::new(&[
            ["", "rows", "largest", "simulated", "bias", "RMS", "bias", "RMS"],
            ["", "", "N", "N", "N", "N", "", ""],
        ]);
        let mut add = |name: &str, found: &ForceDifference| {
            let share = |share: Option<f64>| share.map_or(String::from("-"), format_percent);
            let numbers = [found.measured_n, found.simulated_n, found.bias_n, found.rms_n].map(format_number);
            let [measured, simulated, bias, rms] = numbers;
            table.add_row([
                name.to_owned(),
                found.rows.to_string(),
                measured,
                simulated,
                bias,
                rms,
                share(found.bias_share),
                share(found.rms_share),
            ]);
        };
        if per_press {
            self.presses.iter().for_each(|press| add(&press.name, &press.normal));
        }
        add("normal force", &self.normal);
        if per_press && self.shear.is_some() {
            for press in &self.presses {
                press.shear.iter().for_each(|found| add(&format!("{}, tangential", press.name), found));
            }
        }
        self.shear.iter().for_each(|found| add("tangential force", found));
        table.render(columns)
    }
}
