//! `gelsim tradeoff`

use std::io::IsTerminal;
use std::path::{Path, PathBuf};

use clap::Args;

use super::{Failure, Log, print, say};
use crate::files::diagnostic::user_error;
use crate::files::write::write_whole;
use crate::job::config::Overrides;
use crate::job::plan::Plan;
use crate::lab::tradeoff::{plot, report, tradeoff};

/// Samples, if the user names no number.
const SAMPLES: u64 = 32;

/// Render the same samples of a job at every fidelity level: error against the reference level, and time. Prints a
/// table and writes tradeoff.csv, tradeoff.json, tradeoff.svg and tradeoff.png.
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  gelsim tradeoff configs/quickstart.toml --samples 16 --out /tmp/tradeoff")]
pub struct Tradeoff {
    /// The job
    #[arg(value_name = "JOB.toml")]
    job: PathBuf,
    /// How many of the job's samples are rendered: shallow and deep ones of each object while N allows, and the deepest
    /// of all [default: 32, or one of each object if that is more]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    samples: Option<u64>,
    /// Folder for the results [default: out/NAME-tradeoff]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Seed of all randomness
    #[arg(long, value_name = "S")]
    seed: Option<u64>,
    /// Any key of the job: dotted.path=TOML-VALUE; paths in it are relative to the current folder
    #[arg(long = "set", value_name = "PATH=VALUE")]
    set: Vec<String>,
    /// Print nothing but the table and errors
    #[arg(long)]
    quiet: bool,
}

impl Tradeoff {
    pub(super) fn run(self) -> Result<(), Failure> {
        let mut set: Vec<(String, String)> =
            self.set.iter().map(|text| (String::from("--set"), text.clone())).collect();
        set.extend(self.seed.map(|seed| (String::from("--seed"), format!("dataset.seed = {seed}"))));
        let plan = Plan::load(&self.job, &Overrides { set, fidelity: None })?;
        Log::text(self.quiet).notes(&plan.notes);
        let folder = self.out.unwrap_or_else(|| Path::new("out").join(format!("{}-tradeoff", plan.name())));
        if folder.exists() && !folder.is_dir() {
            let message = format!("{} is not a folder", folder.display());
            return Err(user_error(message, "choose a folder with --out").into());
        }
        let failed =
            |path: &Path, error: &dyn std::fmt::Display| Failure::running(format!("{}: {error}", path.display()));
        // Before the work, lest it be in vain.
        std::fs::create_dir_all(&folder).map_err(|error| failed(&folder, &error))?;
        let heard = !self.quiet && std::io::stderr().is_terminal();
        let samples = self.samples.unwrap_or(SAMPLES.max(plan.sampling.objects.len() as u64));
        let result = tradeoff(&plan, samples, |what| {
            if heard {
                say(&format!("rendering: {what}"));
            }
        });
        let page = plot::draw(&result);
        let json = serde_json::to_string_pretty(&result).map_err(|error| failed(&folder, &error))? + "\n";
        let files = [
            ("tradeoff.csv", report::csv(&result).into_bytes()),
            ("tradeoff.json", json.into_bytes()),
            ("tradeoff.svg", page.svg().into_bytes()),
            ("tradeoff.png", page.png()),
        ];
        for (name, bytes) in files {
            let path = folder.join(name);
            write_whole(&path, &bytes).map_err(|error| failed(&path, &error))?;
        }
        print(&report::table(&result))?;
        if !self.quiet {
            say(&format!("-> {}", folder.display()));
        }
        Ok(())
    }
}
