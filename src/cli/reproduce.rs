//! `gelsim reproduce`: renders a sample again and compares the bytes.

use std::fmt::Write;
use std::path::PathBuf;

use clap::Args;

use super::preview::unreadable_help;
use super::{Failure, Log, print_result};
use gelsim_dataset::archive::{Member, SampleFiles};
use gelsim_dataset::encode::{FrameStorage, make_sample};
use gelsim_dataset::recorded::RecordedDataset;
use gelsim_files::diagnostic::{Diagnostic, user_error};
use gelsim_files::spelling::quote_for_shell;
use gelsim_job::config::Overrides;
use gelsim_job::plan::Plan;

/// Render one sample of a dataset again, from the seed in its label, and say whether the bytes are the same. Exit
/// status 1 if they are not.
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  gelsim reproduce out/quickstart 42")]
pub struct Reproduce {
    /// The dataset's folder
    #[arg(value_name = "DIR")]
    dir: PathBuf,
    /// The sample: its key, with or without leading zeros
    #[arg(value_name = "KEY", value_parser = super::guesses::parse_whole_number::<u64>)]
    key: u64,
}

impl Reproduce {
    pub(super) fn run(self) -> Result<(), Failure> {
        let dataset = RecordedDataset::open(&self.dir)?;
        let samples = dataset.layout.sample_count();
        if self.key >= samples {
            let help = format!("samples are numbered 0 to {}", samples - 1);
            return Err(user_error(format!("there is no sample {}", self.key), help).into());
        }
        let unreadable = |reason| Failure::runtime_with_help(reason, unreadable_help(&self.dir));
        let written = dataset.read_sample(self.key).map_err(unreadable)?;
        let plan = Plan::load(&self.dir.join("job.toml"), &Overrides::default())?;
        Log::plain_text(false).print_notes(&plan.notes);
        if let Some(cost) = warn_of_cost(plan.simulator.view().resolution_px) {
            Log::plain_text(false).print_note(&cost);
        }
        let rendered = make_sample(&plan, self.key, FrameStorage::InMemory)
            .map_err(|error| Failure::runtime(format!("it cannot be made again: {error}")))?;
        let (text, same) = compare_files(&written, &rendered.members);
        print_result(&text)?;
        if same {
            return Ok(());
        }
        // The differences were printed above.
        let folder = quote_for_shell(&self.dir);
        let help = format!(
            "gelsim verify {folder} says whether it is as it was written; if so, another machine or version wrote it"
        );
        Log::plain_text(false)
            .print_notes(&Diagnostic::note("the sample is not what its job makes here").help(help).into());
        Err(Failure::already_reported(1))
    }
}

/// Memory that a sample takes, bytes per pixel, and CPU time, s per pixel. Measured by `time -v gelsim generate
/// --fidelity high --samples 1 --threads 1` of one ball at 2048x1536 px.
const COST_PER_PX: (f64, f64) = (160.0, 3e-7);

/// Returns a note on the cost of a sample so large that somebody who only looks at a dataset may not want it; else
/// `None`.
fn warn_of_cost([width, height]: [usize; 2]) -> Option<String> {
    let px = width as f64 * height as f64;
    let (bytes, seconds) = COST_PER_PX;
    (px > 4e6).then(|| {
        let (gigabytes, seconds) = (bytes * px / 1e9, seconds * px);
        format!("a sample of {width}x{height} px takes about {gigabytes:.1} GB of memory and {seconds:.0} s or more")
    })
}

/// Compares the files of a sample. Returns a line per file, and whether all are the same.
fn compare_files(written: &SampleFiles, made: &[Member]) -> (String, bool) {
    let mut text = String::new();
    let mut same = written.members.len() == made.len();
    for file in made {
        let new = file.bytes.read().expect("nothing of it is spooled");
        let bytes = new.len();
        let _ = match written.find_member(&file.suffix) {
            Some(old) if old == &*new => {
                writeln!(text, "{}.{}: the same {bytes} bytes", written.key, file.suffix)
            }
            other => {
                same = false;
                let how = match other {
                    None => String::from("is not in the shard"),
                    Some(old) => {
                        let at = old.iter().zip(&*new).take_while(|(old, new)| old == new).count();
                        format!("differs from byte {at} on ({} bytes there, {bytes} here)", old.len())
                    }
                };
                writeln!(text, "{}.{}: {how}", written.key, file.suffix)
            }
        };
    }
    for (suffix, _) in &written.members {
        if made.iter().all(|file| file.suffix != *suffix) {
            let _ = writeln!(text, "{}.{suffix}: is not made by this job", written.key);
        }
    }
    text += if same { "the same sample\n" } else { "not the same sample\n" };
    (text, same)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_large_is_announced() {
        assert_eq!(warn_of_cost([640, 480]), None);
        let said = warn_of_cost([8192, 8192]).expect("large");
        assert_eq!(said, "a sample of 8192x8192 px takes about 10.7 GB of memory and 20 s or more");
    }
}
