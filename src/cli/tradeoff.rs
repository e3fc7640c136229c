//! `gelsim tradeoff`: compares all fidelity levels on a job's samples.

use std::io::{self, IsTerminal};
use std::path::{Path, PathBuf};

use clap::Args;

use super::guesses::parse_whole_number;
use super::store::local_path_parser;
use super::terminal::stdout_columns;
use super::{Failure, Log, output_file, print_result, print_to_stderr};
use gelsim_files::diagnostic::user_error;
use gelsim_job::config::Overrides;
use gelsim_job::plan::Plan;
use gelsim_lab::tradeoff::{measure_tradeoff, plot, report, sequences};

/// Samples, if the user names no number: one of each object, within these bounds.
const SAMPLES: [u64; 2] = [32, 256];

/// Sequences, if the user names no number.
const SEQUENCES: u64 = 6;

/// Render the same samples of a job at every fidelity level: error against the reference level, and time. Prints a
/// table and writes tradeoff.csv, tradeoff.json, tradeoff.svg and tradeoff.png. For a job of sequences: force, onset of
/// slip and motion of the pad, against the reference at four times the frame rate; no PNG.
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  gelsim tradeoff configs/quickstart.toml --samples 16 --out /tmp/tradeoff")]
pub struct Tradeoff {
    /// The job
    #[arg(value_name = "JOB.toml")]
    job: PathBuf,
    /// How many of the job's samples are rendered: shallow and deep ones of each object while N allows, and the deepest
    /// of all [default: one of each object, but from 32 to 256; of a job of sequences 6]
    #[arg(short = 'n', long, value_name = "N", value_parser = parse_samples)]
    samples: Option<u64>,
    /// Folder for the results [default: out/NAME-tradeoff]
    #[arg(short, long, value_name = "DIR", value_parser = local_path_parser())]
    out: Option<PathBuf>,
    /// Seed of all randomness
    #[arg(long, value_name = "S", value_parser = parse_whole_number::<u64>)]
    seed: Option<u64>,
    /// Any key of the job: dotted.path=TOML-VALUE; paths in it are relative to the current folder
    #[arg(long = "set", value_name = "PATH=VALUE")]
    set: Vec<String>,
    /// Print only the table and errors
    #[arg(short, long)]
    quiet: bool,
}

impl Tradeoff {
    pub(super) fn run(self) -> Result<(), Failure> {
        let mut set: Vec<(String, String)> =
            self.set.iter().map(|text| (String::from("--set"), text.clone())).collect();
        set.extend(self.seed.map(|seed| (String::from("--seed"), format!("dataset.seed = {seed}"))));
        let plan = Plan::load(&self.job, &Overrides { set, fidelity: None })?;
        plan.require_one_sensor("tradeoff")?;
        Log::plain_text(self.quiet).print_notes(&plan.notes.clone().merged_with(plan.note_one_of_sensors()));
        let folder = self.out.unwrap_or_else(|| Path::new("out").join(format!("{}-tradeoff", plan.name())));
        if folder.exists() && !folder.is_dir() {
            let message = format!("{} is not a folder", folder.display());
            return Err(user_error(message, "choose a folder with --out").into());
        }
        let failed = |path: &Path, error: &dyn std::fmt::Display| Failure::from_path(path, error);
        // Before the work, which would be lost if the folder could not be written.
        create_folder(&folder)?;
        let heard = !self.quiet && std::io::stderr().is_terminal();
        let said = |what: &str| {
            if heard {
                print_to_stderr(&format!("rendering: {what}"));
            }
        };
        if plan.job().sequence.is_some() {
            let result = sequences::measure_sequence_tradeoff(&plan, self.samples.unwrap_or(SEQUENCES), said);
            let json = serde_json::to_string_pretty(&result).map_err(|error| failed(&folder, &error))? + "\n";
            for (name, text) in [
                ("tradeoff.csv", result.to_csv()),
                ("tradeoff.json", json),
                ("tradeoff.svg", result.to_svg().into_string()),
            ] {
                output_file::write_whole_file(&folder.join(name), text.as_bytes())?;
            }
            print_result(&result.to_text_table(stdout_columns()))?;
            if !self.quiet {
                print_to_stderr(&format!("-> {}", folder.display()));
            }
            return Ok(());
        }
        let samples = self.samples.unwrap_or((plan.sampling.objects.len() as u64).clamp(SAMPLES[0], SAMPLES[1]));
        let result = measure_tradeoff(&plan, samples, said);
        Failure::check_meshes(&plan)?;
        let page = plot::draw_tradeoff(&result);
        let json = serde_json::to_string_pretty(&result).map_err(|error| failed(&folder, &error))? + "\n";
        let files = [
            ("tradeoff.csv", report::to_csv(&result).into_bytes()),
            ("tradeoff.json", json.into_bytes()),
            ("tradeoff.svg", page.to_svg().into_string().into_bytes()),
            ("tradeoff.png", page.to_png()),
        ];
        for (name, bytes) in files {
            output_file::write_whole_file(&folder.join(name), &bytes)?;
        }
        print_result(&report::to_text_table(&result, stdout_columns()))?;
        if !self.quiet {
            print_to_stderr(&format!("-> {}", folder.display()));
        }
        Ok(())
    }
}

/// Creates the folder for the results.
fn create_folder(folder: &Path) -> Result<(), Failure> {
    let denied = |error: io::Error| {
        let left = match error.kind() {
            io::ErrorKind::NotADirectory | io::ErrorKind::AlreadyExists => "choose another folder with --out",
            _ => "nothing was rendered",
        };
        Failure::access_denied(&format!("{}: {error}", folder.display()), &error, left)
    };
    std::fs::create_dir_all(folder).map_err(denied)
}

fn parse_samples(text: &str) -> Result<u64, String> {
    parse_whole_number(text)
        .and_then(|samples| if samples > 0 { Ok(samples) } else { Err(String::from("write 1 or more")) })
}
