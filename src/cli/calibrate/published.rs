//! `gelsim calibrate --taxim` and `--gelsight`: takes over calibrations that others published.

use std::path::Path;

use super::summary::format_lines;
use super::{Calibrate, check_representable, format_header, format_sensor, write_file};
use crate::{Failure, print_result};
use gelsim_core::optics::calibrated::{CalibrationColors, CalibrationTable};
use gelsim_files::diagnostic::Diagnostic;
use gelsim_files::sensor::Sensor;
use gelsim_lab::calibrate::gelsight::{self, FitResidual};
use gelsim_lab::calibrate::judge::{Findings, scale};
use gelsim_lab::calibrate::taxim::{TaximImport, import_taxim_folder};

impl Calibrate {
    /// Writes the sensor file of a calibration of Taxim's.
    pub(super) fn import_taxim(&self, folder: &Path, sensor: Sensor) -> Result<(), Failure> {
        let TaximImport { name, resolution_px, field_of_view_mm, background, colors } = import_taxim_folder(folder)?;
        let thickness_mm = self.thickness_mm.unwrap_or(sensor.gelpad_thickness_mm);
        let sensor = Sensor { resolution_px, field_of_view_mm, gelpad_thickness_mm: thickness_mm, ..sensor };
        let about = [(String::from("colours"), format!("Taxim's of {name}"))];
        let (sensor, table) =
            (self.with_own_name(sensor), CalibrationTable::new(CalibrationColors::Taxim(colors), 1.0));
        let longer_px = f64::from(resolution_px[0].max(resolution_px[1]));
        let mm_per_px = field_of_view_mm[0] / f64::from(resolution_px[0]);
        let mut findings = Findings::default();
        findings.extend(scale::judge_view("`pixmm` in params.json", longer_px, mm_per_px));
        self.report_findings(findings)?;
        check_representable(&sensor, Some(&table))?;
        self.write_sensor(sensor, &background, Some(&table), &about, None)?;
        self.report_written(&self.out.display().to_string());
        Ok(())
    }

    /// Writes the sensor file of a calibration that GelSight publishes.
    pub(super) fn import_lamps(&self, device: &Path, sensor: Sensor) -> Result<(), Failure> {
        let gelsight::GelsightImport { name, resolution_px, field_of_view_mm, lamps, flat_field } =
            gelsight::import_gelsight_yaml(device)?;
        let mut about = vec![(String::from("lamps"), format!("GelSight's of {name}"))];
        match flat_field {
            Err(reason) => {
                let message = format!("{reason}: the flat field is taken as even, and images lack the vignetting");
                let help = "put the PNG that is published beside the YAML file there, and calibrate again";
                self.log().print_notes(&Diagnostic::warning(message).help(help).into());
            }
            Ok(fitted) => about.extend(lamps.iter().zip(fitted).map(|(lamp, FitResidual { rms, most })| {
                let left = format!("{rms:.2} grey levels RMS left by the polynomial, {most:.1} at most");
                (format!("flat field of lamp {}", lamp.name), left)
            })),
        }
        about.push((
            String::from("gelpad"),
            String::from("not in the calibration: thickness (--thickness-mm) and stiffness (--sensor) are nominal"),
        ));
        let sensor = Sensor {
            name: self.sensor_name(),
            preset: None,
            file: None,
            resolution_px,
            field_of_view_mm,
            gelpad_thickness_mm: self.thickness_mm.unwrap_or(sensor.gelpad_thickness_mm),
            background: None,
            background_sha256: None,
            calibration: None,
            calibration_sha256: None,
            darkening: 0.0,
            stray_light: None,
            light_residual: None,
            led: Vec::new(),
            lamp: Vec::new(),
            unit: None,
            ..sensor
        };
        let mut findings = Findings::default();
        let longer_px = f64::from(resolution_px[0].max(resolution_px[1]));
        let mm_per_px = field_of_view_mm[0] / f64::from(resolution_px[0]);
        findings.extend(scale::judge_view("`mmperpixel`", longer_px, mm_per_px));
        findings.extend(gelsight::check_darkness(&lamps));
        self.report_findings(findings)?;
        check_representable(&Sensor { lamp: lamps.clone(), ..sensor.clone() }, None)?;
        let text = format_sensor(&sensor, true)?;
        let text = format!("{}\n{text}{}", format_header(&about), gelsight::format_lamp_tables(&lamps));
        self.create_parent_folder()?;
        write_file(&self.out, text.as_bytes())?;
        print_result(&format_lines(&about))?;
        self.report_written(&self.out.display().to_string());
        Ok(())
    }
}
