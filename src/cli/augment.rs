//! `gelsim augment`

use std::path::PathBuf;

use clap::Args;
use gelsim_lab::numbers::{HumanBytes, HumanCount};

use super::guesses::whole;
use super::log::Log;
use super::long_run::long_run;
use super::store::{folder_only, local_output};
use super::terminal::say;
use super::{Failure, checked_threads};
use gelsim_augment::report::PerSource;
use gelsim_augment::trace::Source;
use gelsim_augment::{AugmentError, Recipe, Summary, Target, augment, report};
use gelsim_dataset::refused::Refused;
use gelsim_files::spelling::visible;

/// Enlarge a real dataset: its images as other LEDs, gelpads and cameras would have shown them, simulated counterparts
/// of its samples, new synthetic samples where it has gaps. The layout stays, and every sample says where it comes from.
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
    /// What to do
    #[arg(value_name = "AUGMENT.toml")]
    file: PathBuf,
    /// Folder of the output [default: the file's output.path, else out/NAME after the file]
    #[arg(short, long, value_name = "DIR", value_parser = local_output())]
    out: Option<PathBuf>,
    /// Seed of all randomness
    #[arg(long, value_name = "S", value_parser = whole::<u64>)]
    seed: Option<u64>,
    /// Any key of the file: dotted.path=TOML-VALUE; paths in it are relative to the current folder
    #[arg(long = "set", value_name = "PATH=VALUE")]
    set: Vec<String>,
    /// Threads [default: all cores]
    #[arg(short = 'j', long, value_name = "T", value_parser = whole::<usize>)]
    threads: Option<usize>,
    /// Replace an output that is in the folder
    #[arg(long)]
    overwrite: bool,
    /// Print nothing but errors
    #[arg(short, long)]
    quiet: bool,
}

impl Augment {
    pub(super) fn run(self) -> Result<(), Failure> {
        let log = Log::text(self.quiet);
        let threads = checked_threads(self.threads)?;
        let mut set: Vec<(String, String)> =
            self.set.iter().map(|text| (String::from("--set"), text.clone())).collect();
        set.extend(self.seed.map(|seed| (String::from("--seed"), format!("seed = {seed}"))));
        let recipe = Recipe::load(&self.file, &set)?;
        log.notes(&recipe.notes);
        let root = self.out.unwrap_or_else(|| recipe.root.clone());
        folder_only(&root, "augment")?;
        let target = Target { root: root.clone(), threads, overwrite: self.overwrite };

        let (result, signal) = long_run(log, |watch| augment(&recipe, &target, watch))?;
        match result {
            Ok(summary) => {
                if !self.quiet {
                    say(&text(&recipe, &summary, &root.display().to_string()));
                }
                Ok(())
            }
            Err(AugmentError::Refused(Refused::Io(path, error))) => {
                Err(Failure::denied(&format!("{}: {error}", path.display()), &error, "nothing was written"))
            }
            Err(AugmentError::Refused(refused)) => Err(refused.into()),
            Err(AugmentError::Io(path, error)) => {
                Err(Failure::denied(&format!("{}: {error}", path.display()), &error, "nothing was written"))
            }
            Err(AugmentError::OldStays(path, error)) => {
                let left = format!("the new output is in {}; the next run removes the old one", root.display());
                Err(Failure::denied(&format!("the old output stays in {}: {error}", path.display()), &error, &left))
            }
            Err(AugmentError::Image(message)) => Err(Failure::running_with(
                message,
                "nothing was written; put a sound image there, or take it out of the set",
            )),
            Err(AugmentError::Sample(message)) => Err(Failure::running_with(message, "nothing was written")),
            Err(AugmentError::Unhealthy(message)) => Err(Failure::running_with(
                message,
                "nothing was written; under [output] in the job, on_unhealthy = \"keep\" takes such samples, \"reject\" draws \
                 them again",
            )),
            Err(AugmentError::Changed(path)) => Err(Failure::running_with(
                format!("{} has changed since it was looked at", path.display()),
                "nothing was written; run it again when nothing writes to the input",
            )),
            Err(AugmentError::Interrupted) => Err(Failure::stopped("stopped; nothing was written", signal)),
        }
    }
}

/// Splits of which the samples are counted on the terminal.
const MOST_SPLITS: usize = 12;

/// `140 real, 280 photometric`
fn by_source(samples: &PerSource) -> String {
    let sources = Source::ALL.iter().filter(|source| samples[**source as usize] > 0);
    let sources: Vec<String> =
        sources.map(|source| format!("{} {}", HumanCount(samples[*source as usize]), source.name())).collect();
    sources.join(", ")
}

fn text(recipe: &Recipe, summary: &Summary, root: &str) -> String {
    let mut text = format!(
        "{} samples: {}; {}, {:.1} s -> {root}",
        HumanCount(summary.all()),
        by_source(&summary.samples),
        HumanBytes(summary.bytes),
        summary.seconds
    );
    if recipe.division.is_divided() {
        for (name, samples) in summary.splits.iter().take(MOST_SPLITS) {
            let name = if name.is_empty() { "without a split" } else { name };
            text += &format!("\n  {}: {}", visible(name), by_source(samples));
        }
        if summary.splits.len() > MOST_SPLITS {
            text += &format!("\n  and {} more splits, which augment.json has", summary.splits.len() - MOST_SPLITS);
        }
    }
    if let Some(([x, y], correlation)) = summary.pairs() {
        text +=
            &format!("\nsimulated counterparts: median offset {x:.2}, {y:.2} px, median correlation {correlation:.3}");
    }
    if let Some(mix) = &recipe.mix {
        let cells = mix.coverage.counting.iter().filter(|counting| **counting).count();
        let [before, after] = report::reached(&mix.coverage).map(|fraction| 100.0 * fraction);
        text += &format!("\ncoverage: {before:.1} % of {cells} cells before, {after:.1} % now");
    }
    text
}
