//! `gelsim calibrate --evaluate`: simulates presses with a fitted sensor, and compares them with their images.

use std::fs;
use std::path::Path;

use super::summary::{add_scores, new_score_table};
use super::{Calibrate, FLAT_ONLY, denied_failure, write_file};
use crate::terminal::stdout_columns;
use crate::{Failure, print_result};
use gelsim_files::diagnostic::{Diagnostic, user_error};
use gelsim_files::png::encode_rgb;
use gelsim_job::plan::standalone;
use gelsim_lab::calibrate::evaluate::{EvaluatedPress, Evaluation, EvaluationOptions, evaluate_presses, picture_name};
use gelsim_lab::calibrate::judge::fit;
use gelsim_lab::compare::score::{Score, Scores};

impl Calibrate {
    /// Simulates the presses of a table, writes their pictures, and prints how far they are from the images.
    pub(super) fn evaluate_table(&self, table: &Path, sensor: &str) -> Result<(), Failure> {
        let sensor = standalone::load_flat_sensor(sensor, FLAT_ONLY)?.sensor;
        if self.out.exists() && !self.out.is_dir() {
            return Err(
                user_error(format!("{} is not a folder", self.out.display()), "choose a folder with --out").into()
            );
        }
        let options = EvaluationOptions {
            contact_over_disc: self.contact_over_disc,
            fidelity: self.fidelity,
            finds_circles: self.detect,
        };
        let read = self.read_presses(table)?;
        let pictures = read.presses.iter().map(|press| self.out.join(picture_name(&press.file)));
        self.refuse_to_overwrite(&read, pictures, "choose another folder with --out")?;
        let Evaluation { presses, findings } = evaluate_presses(read, &sensor, options)?;
        self.report_findings(findings)?;
        fs::create_dir_all(&self.out).map_err(|error| denied_failure(&self.out, &error))?;
        let mut table = new_score_table();
        for EvaluatedPress { file, simulated, scores, .. } in &presses {
            let path = self.out.join(picture_name(file));
            let [width, height] = sensor.resolution_px;
            write_file(&path, &encode_rgb(width, height, simulated))?;
            let contact = scores.as_ref().and_then(|scores| scores.contact.as_ref());
            add_scores(&mut table, file, contact, scores.as_ref().map(|scores| &scores.full_image));
        }
        let compared = presses.iter().filter(|press| press.scores.is_some()).count();
        let means = |of: &dyn Fn(&EvaluatedPress) -> Option<Scores>| {
            let scores: Vec<Scores> = presses.iter().filter_map(of).collect();
            let contact = Score::mean(scores.iter().filter_map(|scores| scores.contact.as_ref()));
            (contact, Score::mean(scores.iter().map(|scores| &scores.full_image)))
        };
        let ((contact, full_image), (bare, bare_image)) =
            (means(&|press| press.scores), means(&|press| press.background_scores));
        add_scores(&mut table, &format!("mean of {compared}"), contact.as_ref(), full_image.as_ref());
        add_scores(&mut table, "background alone", bare.as_ref(), bare_image.as_ref());
        print_result(&table.render(stdout_columns()))?;
        if let (Some(contact), Some(bare)) = (contact, bare)
            && contact.mae >= fit::MAX_REMAINING_SHARE * bare.mae
        {
            let left = 100.0 * contact.mae / bare.mae;
            let message = if left < 100.0 {
                format!("the sensor leaves {left:.0} % of what presses change around the contact unexplained")
            } else {
                String::from("the sensor is further from the presses around the contact than the background alone")
            };
            let help = "fit a sensor file to presses of this very sensor; check circles and balls in the table";
            self.log().print_notes(&Diagnostic::warning(message).help(help).into());
        }
        self.report_written(&self.out.display().to_string());
        Ok(())
    }
}
