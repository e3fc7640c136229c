//! `gelsim generate`: makes a dataset, in a folder or in a store.

use std::path::PathBuf;

use clap::Args;
use gelsim_lab::numbers::{HumanBytes, HumanCount};
use gelsim_lab::outcome::{HOPELESS_RUN_HELP, explain_hopeless_run, note_outcome};
use serde_json::{Value, json};

use super::log::{Format, Log};
use super::long_run::run_interruptible;
use super::store::{parse_address, staging_folder};
use super::terminal::print_to_stderr;
use super::{Extent, Failure, JobOverrides, settle_fidelity};
use gelsim_dataset::folder::recorded_fidelity;
use gelsim_dataset::generate::{GenerateError, GenerateRequest, RunMonitor, RunSummary, generate, generate_in_store};
use gelsim_dataset::verify::{DatasetFinding, Remedy};
use gelsim_files::diagnostic::user_error;
use gelsim_files::store::{StoreAddress, open_store};
use gelsim_job::label::sample_key;
use gelsim_job::plan::Plan;
use gelsim_job::probe::preview_job;

/// Generate the dataset that a job describes. Run the same command again to continue a run that was stopped.
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  gelsim generate configs/quickstart.toml --samples 50 --out /tmp/quick
  gelsim generate job.toml --partition 0/8 --threads 4 --log-format json
  gelsim generate job.toml --out s3://bucket/presses
  gelsim generate job.toml --set 'indentation.depth_mm=[0.3, 0.9]'
  gelsim generate job.toml --set 'sensor.preset=\"digit\"'")]
pub struct Generate {
    /// The job
    #[arg(value_name = "JOB.toml")]
    job: PathBuf,
    #[command(flatten)]
    overrides: JobOverrides,
    #[command(flatten)]
    extent: Extent,
    /// Replace a dataset that exists in the folder
    #[arg(long)]
    overwrite: bool,
    /// Folder for shards before they go to a store [default: the folder for temporary files]
    #[arg(long, value_name = "DIR")]
    staging: Option<PathBuf>,
    /// Print nothing but errors
    #[arg(short, long)]
    quiet: bool,
    /// Form of the messages on standard error; json: one object a line
    #[arg(long, value_name = "FORMAT", value_enum, default_value_t)]
    log_format: Format,
}

impl Generate {
    pub(super) fn run(self) -> Result<(), Failure> {
        let log = Log { format: self.log_format, quiet: self.quiet };
        self.generate(log).map_err(|failure| log.report_failure(failure))
    }

    fn generate(self, log: Log) -> Result<(), Failure> {
        let threads = self.extent.thread_count()?;
        let plan = Plan::load(&self.job, &self.overrides.to_overrides())?;
        let foreseen = preview_job(&plan);
        self.overrides.report_notes(&foreseen.notes, log)?;
        let shards = self.extent.shard_range(plan.layout.shard_count())?;
        let root = self.extent.dataset_root(&plan);
        let store = parse_address(&root)?;
        if store.is_some() && plan.job().sensors.is_some() {
            let message = "the datasets of several sensors cannot be made in a store";
            let help = "generate them into a folder, and copy that, for example with `aws s3 sync`";
            return Err(user_error(message, help).into());
        }
        let begun = plan.dataset_folders(&root).swap_remove(0);
        let recorded = if self.overwrite { None } else { recorded_fidelity(&begun) };
        if store.is_some() && plan.open_fidelity_choice().is_some() {
            let message = "a dataset in a store cannot leave its fidelity to be chosen";
            return Err(user_error(message, "name a level with --fidelity (gelsim tradeoff shows them)").into());
        }
        if store.is_none() && self.staging.is_some() {
            return Err(user_error(
                "--staging is for datasets in stores",
                "leave it out: shards are made in their folder",
            )
            .into());
        }
        if shards.is_some() && recorded.is_none() && plan.open_fidelity_choice().is_some() {
            let message = "parts of a dataset cannot each choose their own fidelity";
            let help = "name a level with --fidelity (gelsim tradeoff shows them), or begin the dataset without \
                        --shards and --partition";
            return Err(user_error(message, help).into());
        }
        let plan = settle_fidelity(plan, recorded, log)?;
        let request = GenerateRequest { root: root.clone(), shards, threads, overwrite: self.overwrite };
        let in_store = |address: &StoreAddress, watch: &RunMonitor| {
            let store = open_store(address, &watch.stop).map_err(|error| GenerateError::Io(root.clone(), error))?;
            generate_in_store(
                &*store,
                &plan,
                &GenerateRequest { root: staging_folder(self.staging.clone()), ..request.clone() },
                watch,
            )
        };
        let (result, signal) = run_interruptible(log, |watch| match &store {
            Some(address) => in_store(address, watch),
            None => generate(&plan, &request, watch),
        })?;
        match result {
            Ok(done) => {
                let root = root.display().to_string();
                match log.format {
                    Format::Json => log.write_event("done", summarise_as_json(&done, &root)),
                    Format::Text if !self.quiet => {
                        // A warning from before the run is not repeated after it.
                        let no_contact = plan.job().indentation.no_contact;
                        let notes = note_outcome(&done, Some(no_contact).filter(|_| !foreseen.may_miss));
                        print_to_stderr(&format_summary(&done, &root));
                        log.print_notes(&notes);
                    }
                    Format::Text => {}
                }
                match explain_hopeless_run(&done) {
                    Some(message) => Err(Failure::runtime_with_help(message, HOPELESS_RUN_HELP)),
                    None => Ok(()),
                }
            }
            Err(stopped) => Err(explain_failure(stopped, plan.seed(), signal)),
        }
    }
}

/// Formats what a run made, and how many samples of it need a look.
fn format_summary(done: &RunSummary, root: &str) -> String {
    let of_sensors = if done.sensors > 1 { format!(" of {} sensors", done.sensors) } else { String::new() };
    let mut text = format!(
        "{}{of_sensors} in {}, {} of {} in contact, {} rejected, {}, {:.1} s ({:.1} samples/s) -> {root}",
        HumanCount(done.samples).of("sample"),
        HumanCount(done.shards).of("shard"),
        HumanCount(done.in_contact),
        HumanCount(done.samples),
        HumanCount(done.rejected),
        HumanBytes(done.bytes),
        done.seconds,
        samples_per_second(done),
    );
    if done.calibration_samples > 0 {
        text += &format!("; {} for calibration", HumanCount(done.calibration_samples).of("sample"));
    }
    if done.skipped > 0 {
        let shards = if done.skipped == 1 { "shard was" } else { "shards were" };
        text += &format!("; {} {shards} there already", done.skipped);
    }
    if let Some(before) = done.grown_from {
        text += &format!("; the dataset had {} samples", HumanCount(before));
    }
    if !done.complete {
        text += "; the dataset is not complete yet: other shards are missing";
    }
    if !done.damaged.is_empty() {
        text += &format!("\nmade again, because it was not what had been written: {}", done.damaged.join(", "));
    }
    let counts = [
        (done.unconverged, "contact not solved to the tolerance", "samples, see numerics in their labels"),
        (done.unhealthy, "not healthy", "samples, see health in their labels"),
        (done.rejected, "rejected and drawn again", "draws, see rejections in the shards' stats"),
        (done.unplaced_objects, "left out for want of a place", "objects, see unplaced_objects in the labels"),
    ];
    for (count, what, of) in counts.iter().filter(|(count, ..)| *count > 0) {
        text += &format!("\n{what}: {} {of}", HumanCount(*count));
    }
    text
}

/// Returns what a run made as a JSON object, for pipelines.
fn summarise_as_json(done: &RunSummary, root: &str) -> Value {
    json!({
        "out": root,
        "sensors": done.sensors,
        "samples": done.samples,
        "rejected": done.rejected,
        "unhealthy": done.unhealthy,
        "unconverged": done.unconverged,
        "in_contact": done.in_contact,
        "unplaced_objects": done.unplaced_objects,
        "light_outside_range": done.light.share_outside(),
        "shards": done.shards,
        "shards_there_already": done.skipped,
        "shards_made_again": done.damaged,
        "calibration_samples": done.calibration_samples,
        "bytes": done.bytes,
        "seconds": done.seconds,
        "samples_per_s": samples_per_second(done),
        "samples_before": done.grown_from,
        "complete": done.complete,
    })
}

fn samples_per_second(done: &RunSummary) -> f64 {
    done.samples as f64 / done.seconds.max(1e-9)
}

/// Returns the failure of a run that ended early, with what is left of its work.
fn explain_failure(stopped: GenerateError, seed: u64, signal: usize) -> Failure {
    match stopped {
        GenerateError::Usage(report) => report.into(),
        GenerateError::Io(path, error) => {
            let left = "what is finished stays; the same command goes on from there";
            Failure::access_denied(&format!("{}: {error}", path.display()), &error, left)
        }
        GenerateError::Held(holders) => {
            Failure::runtime_with_help(holders.join("\n"), "all other shards are done; the same command checks again")
        }
        GenerateError::Invalid(findings) => {
            let strays = findings.iter().filter(|finding| matches!(finding.remedy, Remedy::Remove(_)));
            let named: Vec<String> = strays.map(DatasetFinding::to_string).collect();
            let help = "all shards are done, but readers would take this for data; remove it, the same command then ends the dataset";
            Failure::runtime_with_help(named.join("\n"), help)
        }
        GenerateError::Unhealthy(unfit) => Failure::runtime_with_help(
            unfit.to_string(),
            "finished shards stay; output.on_unhealthy = \"keep\" takes such samples into the dataset, \"reject\" draws them again",
        ),
        GenerateError::Panicked(index, message) => Failure::runtime_with_help(
            format!("sample {} (seed {seed}) brought gelsim down, which is a bug: {message}", sample_key(index)),
            "finished shards stay; please report it with the job",
        ),
        GenerateError::Interrupted => {
            Failure::stopped_by_signal("stopped; finished shards stay, the same command goes on from there", signal)
        }
    }
}
