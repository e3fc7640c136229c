//! `gelsim calibrate --force`: fits Young's modulus, relaxation and friction of a gelpad to presses with measured
//! forces.

use std::collections::BTreeSet;
use std::path::Path;

use super::summary::format_lines;
use super::{
    Calibrate, build_report, check_representable, file_name, format_header, format_sensor, path_failure, write_file,
};
use crate::{Failure, print_result};
use gelsim_files::diagnostic::{Diagnostic, Severity, user_error};
use gelsim_files::input::RelativePaths;
use gelsim_files::sensor::{PRESETS, Sensor};
use gelsim_job::config::sensor_paths_mut;
use gelsim_lab::calibrate::force::fit::ElasticFit;
use gelsim_lab::calibrate::force::friction::FrictionFit;
use gelsim_lab::calibrate::force::motion::Motions;
use gelsim_lab::calibrate::force::{fit, friction, judge, page, report, table};
use gelsim_lab::calibrate::judge::Findings;

/// Why a gel that has a shape has no fitted modulus, and what to do instead.
pub(super) const FLAT_ONLY: [&str; 2] = [
    "forces are fitted on flat pads, and the sensor's gel has a shape",
    "on a ball-shaped gel press straight on: fit a flat sensor of the same gelpad_thickness_mm, with \
     `ball_radius_mm` = 1 / (1 / ball + 1 / gel) in the table, and copy the gelpad_* keys into the sensor file",
];

impl Calibrate {
    /// Fits the gelpad to the presses of a table, and writes the sensor file, its summary and page.
    pub(super) fn fit_forces(&self, path: &Path, sensor: Sensor) -> Result<(), Failure> {
        let sensor = Sensor { gelpad_thickness_mm: self.thickness_mm.unwrap_or(sensor.gelpad_thickness_mm), ..sensor };
        let mut motions = Motions::new(&table::read(path)?, sensor.gelpad_material());
        let mut said = self.report_findings(judge::judge_presses(&motions, self.fit_zero))?;
        let mut fitted = fit::fit(&motions, self.fit_zero);
        let outliers: BTreeSet<String> = judge::find_outliers(&fitted).into_iter().map(|(name, _)| name).collect();
        if self.drop_bad && !outliers.is_empty() {
            said.extend(self.report_findings(judge::judge_fit(&motions, &fitted))?);
            motions.motions.retain(|motion| !outliers.contains(&motion.name));
            let mut left_out = Findings::default();
            left_out.extend(outliers.iter().map(|name| {
                Diagnostic::warning(format!("press `{name}` left out"))
                    .about(format!("`{name}`"), "presses are left out, for the reasons above")
            }));
            said.extend(self.report_findings(left_out)?);
            fitted = fit::fit(&motions, self.fit_zero);
        }
        let slides = friction::fit(&motions, fitted.solution.zero_mm);
        let of_friction = judge::judge_friction(&slides);
        let writes_friction = !of_friction.are_hopeless() || self.keep_anyway;
        let mut findings = judge::judge_fit(&motions, &fitted);
        // A coefficient that cannot be right is left out; the modulus beside it may still be right.
        findings.extend(of_friction.0.into_iter().map(|found| match found.severity {
            Severity::Error if !self.keep_anyway => Diagnostic {
                severity: Severity::Warning,
                message: format!("{}: it is not written", found.message),
                ..found
            },
            _ => found,
        }));
        if !sensor.gelpad_relaxation.is_empty() && fitted.solution.relaxation.is_empty() {
            let message = "the sensor's gelpad_relaxation is left out: the modulus was fitted without one";
            findings.extend([Diagnostic::warning(message).help("measure presses that are held, with `time_s`")]);
        }
        said.extend(self.report_findings(findings)?);
        let coefficient = match &slides {
            FrictionFit::Found(found) if writes_friction => Some(found.coefficient),
            _ => sensor.gelpad_friction_coefficient,
        };
        let sensor = Sensor {
            gelpad_youngs_modulus_kpa: round_digits(fitted.solution.youngs_modulus_kpa),
            gelpad_relaxation: fitted.solution.relaxation.clone(),
            gelpad_friction_coefficient: coefficient.map(round_digits),
            ..sensor
        };
        self.write_forces(sensor, &motions, &fitted, &slides, &said)
    }

    fn write_forces(
        &self,
        sensor: Sensor,
        motions: &Motions,
        fitted: &ElasticFit,
        slides: &FrictionFit,
        said: &[Diagnostic],
    ) -> Result<(), Failure> {
        let from_preset = self.sensor.as_ref().is_none_or(|name| PRESETS.iter().any(|(preset, _)| preset == name));
        let name = if from_preset { self.sensor_name() } else { sensor.name.clone() };
        let mut sensor = Sensor { name, preset: None, file: None, ..sensor };
        for mode in &mut sensor.gelpad_relaxation {
            (mode.share, mode.time_s) = (round_digits(mode.share), round_digits(mode.time_s));
        }
        check_representable(&sensor, None)?;
        self.move_paths(&mut sensor)?;
        let summary = report::summarise(motions, fitted, slides);
        let warnings = build_report(said.to_vec()).messages_with_help();
        let text = format_sensor(&sensor, !sensor.lamp.is_empty())?;
        let [json_path, page_path] = ["force.json", "force.html"].map(|end| self.out.with_extension(end));
        self.create_parent_folder()?;
        write_file(&json_path, &report::to_json(motions, fitted, slides, &warnings))?;
        let html = page::to_html(&sensor.name, motions, fitted, &summary, &warnings);
        write_file(&page_path, html.as_bytes())?;
        write_file(&self.out, format!("{}\n{text}", format_header(&summary)).as_bytes())?;
        print_result(&format_lines(&summary))?;
        self.report_written(&format!("{}, {}, {}", self.out.display(), file_name(&json_path), file_name(&page_path)));
        Ok(())
    }

    /// Makes the paths that the sensor names relative to the folder of the sensor file that is written.
    fn move_paths(&self, sensor: &mut Sensor) -> Result<(), Failure> {
        let folder = self.out.parent().unwrap_or(Path::new(""));
        let mut relative = RelativePaths::seen_from(folder).map_err(|error| path_failure(folder, &error))?;
        for path in sensor_paths_mut(sensor).filter(|path| Path::new(path.as_str()).is_relative()) {
            let from = Path::new(path.as_str());
            let moved = relative.make_relative(from).map_err(|error| path_failure(from, &error))?;
            let Some(moved) = moved.to_str() else {
                let message = format!("{} is no UTF-8, which a sensor file must be", moved.display());
                return Err(user_error(message, "choose another place with --out").into());
            };
            *path = moved.replace('\\', "/");
        }
        Ok(())
    }
}

/// Rounds to six digits, which is more than any measurement has.
fn round_digits(value: f64) -> f64 {
    format!("{value:.5e}").parse().unwrap_or(value)
}
