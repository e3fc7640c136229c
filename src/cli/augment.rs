//! `gelsim augment`: enlarges a real dataset as an AUGMENT.toml file describes.

use std::path::PathBuf;

use clap::Args;
use gelsim_lab::numbers::{HumanBytes, HumanCount};

use super::guesses::parse_whole_number;
use super::log::Log;
use super::long_run::run_interruptible;
use super::store::{local_path_parser, require_local_folder};
use super::terminal::print_to_stderr;
use super::{Failure, check_thread_count};
use gelsim_augment::report::PerSource;
use gelsim_augment::trace::Source;
use gelsim_augment::{AugmentError, OutputTarget, Recipe, Summary, augment, report};
use gelsim_dataset::dataset_error::DatasetError;
use gelsim_files::spelling::escape_hidden_chars;

/// Enlarge a real dataset: its images as other LEDs, gelpads and cameras would have shown them, simulated counterparts
/// of its samples, new synthetic samples where it has gaps. The layout stays, and every sample says where it comes
/// from.
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  gelsim generate configs/quickstart.toml
  gelsim augment configs/augment.toml
  gelsim augment configs/augment.toml --seed 8 --out larger
  gelsim augment configs/augment.toml --set mixing.synthetic_per_real=2.0

The input is a folder of images with a CSV or JSON Lines table, with a folder for each class, with COCO annotations, \
WebDataset tars, or a Hugging Face imagefolder. It is not changed. Samples are added to the split for training alone, unless \
the file says otherwise. The output appears under its name when it is complete; nothing is left of a run that is stopped.")]
pub struct Augment {
    /// The file that describes the augmentation
    #[arg(value_name = "AUGMENT.toml")]
    file: PathBuf,
    /// Folder of the output [default: the file's output.path, else out/NAME after the file]
    #[arg(short, long, value_name = "DIR", value_parser = local_path_parser())]
    out: Option<PathBuf>,
    /// Seed of all randomness
    #[arg(long, value_name = "S", value_parser = parse_whole_number::<u64>)]
    seed: Option<u64>,
    /// Any key of the file: dotted.path=TOML-VALUE; paths in it are relative to the current folder
    #[arg(long = "set", value_name = "PATH=VALUE")]
    set: Vec<String>,
    /// Threads [default: all cores]
    #[arg(short = 'j', long, value_name = "T", value_parser = parse_whole_number::<usize>)]
    threads: Option<usize>,
    /// Replace an output that exists in the folder
    #[arg(long)]
    overwrite: bool,
    /// Print nothing but errors
    #[arg(short, long)]
    quiet: bool,
}

impl Augment {
    pub(super) fn run(self) -> Result<(), Failure> {
        let log = Log::plain_text(self.quiet);
        let threads = check_thread_count(self.threads)?;
        let mut set: Vec<(String, String)> =
            self.set.iter().map(|text| (String::from("--set"), text.clone())).collect();
        set.extend(self.seed.map(|seed| (String::from("--seed"), format!("seed = {seed}"))));
        let recipe = Recipe::load(&self.file, &set)?;
        log.print_notes(&recipe.notes);
        let root = self.out.unwrap_or_else(|| recipe.root.clone());
        require_local_folder(&root, "augment")?;
        let target = OutputTarget { root: root.clone(), threads, overwrite: self.overwrite };

        let (result, signal) = run_interruptible(log, |watch| augment(&recipe, &target, watch))?;
        match result {
            Ok(summary) => {
                if !self.quiet {
                    print_to_stderr(&format_summary(&recipe, &summary, &root.display().to_string()));
                }
                Ok(())
            }
            Err(AugmentError::Refused(DatasetError::Io(path, error))) => {
                Err(Failure::access_denied(&format!("{}: {error}", path.display()), &error, "nothing was written"))
            }
            Err(AugmentError::Refused(refused)) => Err(refused.into()),
            Err(AugmentError::Io(path, error)) => {
                Err(Failure::access_denied(&format!("{}: {error}", path.display()), &error, "nothing was written"))
            }
            Err(AugmentError::OldNotRemoved(path, error)) => {
                let left = format!("the new output is in {}; the next run removes the old one", root.display());
                Err(Failure::access_denied(
                    &format!("the old output stays in {}: {error}", path.display()),
                    &error,
                    &left,
                ))
            }
            Err(AugmentError::Image(message)) => Err(Failure::runtime_with_help(
                message,
                "nothing was written; put a valid image there, or remove it from the set",
            )),
            Err(AugmentError::Sample(message)) => Err(Failure::runtime_with_help(message, "nothing was written")),
            Err(AugmentError::Unhealthy(message)) => Err(Failure::runtime_with_help(
                message,
                "nothing was written; under [output] in the job, on_unhealthy = \"keep\" takes such samples, \"reject\" draws \
                 them again",
            )),
            Err(AugmentError::Changed(path)) => Err(Failure::runtime_with_help(
                format!("{} has changed since it was looked at", path.display()),
                "nothing was written; run it again when nothing writes to the input",
            )),
            Err(AugmentError::Interrupted) => Err(Failure::stopped_by_signal("stopped; nothing was written", signal)),
        }
    }
}

/// Splits whose samples are listed on the terminal; further ones are only counted.
const MAX_SPLITS: usize = 12;

/// Formats the number of samples of each source: `140 real, 280 photometric`. Sources without samples are left out.
fn format_sources(samples: &PerSource) -> String {
    let sources = Source::ALL.iter().filter(|source| samples[**source as usize] > 0);
    let sources: Vec<String> =
        sources.map(|source| format!("{} {}", HumanCount(samples[*source as usize]), source.name())).collect();
    sources.join(", ")
}

/// Formats what a finished run made: samples by source and split, offsets of counterparts, coverage.
fn format_summary(recipe: &Recipe, summary: &Summary, root: &str) -> String {
    let mut text = format!(
        "{} samples: {}; {}, {:.1} s -> {root}",
        HumanCount(summary.sample_count()),
        format_sources(&summary.samples),
        HumanBytes(summary.bytes),
        summary.seconds
    );
    if recipe.division.is_divided() {
        for (name, samples) in summary.splits.iter().take(MAX_SPLITS) {
            let name = if name.is_empty() { "without a split" } else { name };
            text += &format!("\n  {}: {}", escape_hidden_chars(name), format_sources(samples));
        }
        if summary.splits.len() > MAX_SPLITS {
            text += &format!("\n  and {} more splits, which augment.json has", summary.splits.len() - MAX_SPLITS);
        }
    }
    if let Some(([x, y], correlation)) = summary.pair_medians() {
        text +=
            &format!("\nsimulated counterparts: median offset {x:.2}, {y:.2} px, median correlation {correlation:.3}");
    }
    if let Some(mix) = &recipe.mix {
        let cells = mix.coverage.is_counted.iter().filter(|counting| **counting).count();
        let [before, after] = report::coverage_before_after(&mix.coverage).map(|fraction| 100.0 * fraction);
        text += &format!("\ncoverage: {before:.1} % of {cells} cells before, {after:.1} % now");
    }
    text
}
