//! `gelsim plan`: forecasts effects, time and size of a run by rendering some samples.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use gelsim_lab::numbers::{HumanBytes, HumanCount, HumanDuration};

use super::store::parse_address;
use super::{Extent, Failure, JobOverrides, Log, print_result, settle_fidelity};
use gelsim_core::effects::Effect;
use gelsim_dataset::folder::recorded_fidelity;
use gelsim_dataset::forecast::{Forecast, forecast, probe_first_draw};
use gelsim_files::diagnostic::{Diagnostic, Report};
use gelsim_job::config::output::OnUnhealthy;
use gelsim_job::plan;
use gelsim_job::probe::preview_job;

/// Show what `generate` would do: which effects the samples enable and why, what they cost, how long the run takes and
/// how large the dataset gets. Renders some samples to find out, and writes nothing.
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  gelsim plan configs/quickstart.toml
  gelsim plan job.toml --partition 0/8 --threads 4")]
pub struct Plan {
    /// The job
    #[arg(value_name = "JOB.toml")]
    job: PathBuf,
    #[command(flatten)]
    overrides: JobOverrides,
    #[command(flatten)]
    extent: Extent,
    /// Print only the forecast and errors
    #[arg(short, long)]
    quiet: bool,
}

impl Plan {
    pub(super) fn run(self) -> Result<(), Failure> {
        let threads = self.extent.thread_count()?;
        let start = Instant::now();
        let plan = plan::Plan::load(&self.job, &self.overrides.to_overrides())?;
        let load_s = start.elapsed().as_secs_f64();
        let foreseen = preview_job(&plan);
        self.overrides.report_notes(&foreseen.notes, Log::plain_text(self.quiet))?;
        let root = self.extent.dataset_root(&plan);
        let store = parse_address(&root)?;
        let datasets = plan.dataset_folders(&root);
        let plan = settle_fidelity(plan, recorded_fidelity(&datasets[0]), Log::plain_text(self.quiet))?;
        let count = plan.layout.shard_count();
        let shards = self.extent.shard_range(count)?.unwrap_or(0..count);
        let samples = shards.clone().map(|number| plan.layout.shard(number).samples).sum();
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let forecast = forecast(&plan, samples, shards.end - shards.start, threads.unwrap_or(cores));
        let forecast = forecast.map_err(|error| Failure::runtime(error.to_string()))?;
        Failure::check_meshes(&plan)?;
        if !foreseen.may_miss {
            let missed =
                forecast.contacts.note_missed_contacts(&plan, |plan, index| probe_first_draw(plan, index).in_contact);
            let missed = missed.map_or_else(Report::default, Report::from);
            self.overrides.report_notes(&missed, Log::plain_text(self.quiet))?;
        }
        let rejected = warn_of_rejections(&plan, &forecast).map_or_else(Report::default, Report::from);
        self.overrides.report_notes(&rejected, Log::plain_text(self.quiet))?;
        let mut text = format_heading(&plan, &forecast);
        text += &plan.pressed_sides().map_or_else(String::new, |sides| format!("{sides}\n\n"));
        text += &format_effects(&forecast);
        text += &format_stages(&forecast);
        text += &format_totals(&forecast, load_s, &root, if store.is_some() { None } else { free_bytes(&root) });
        if datasets.len() > 1 {
            text += &format_set(&plan, &forecast, datasets.len() as u64, shards.contains(&0));
        }
        print_result(&text)
    }
}

/// Warns if most of the draws are rejected.
fn warn_of_rejections(plan: &plan::Plan, forecast: &Forecast) -> Option<Diagnostic> {
    let (ill, all) = (forecast.unhealthy, forecast.probed);
    (plan.output().on_unhealthy == OnUnhealthy::Reject && 2 * ill > all).then(|| {
        let message = format!(
            "{ill} of {all} samples that were tried are not healthy, and on_unhealthy = \"reject\" draws them again"
        );
        let help =
            "write on_unhealthy = \"keep\" under [output] to see in the labels what is wrong (`health`), and fix that";
        Diagnostic::warning(message).help(help)
    })
}

/// Formats what is generated, and what was probed to forecast it.
fn format_heading(plan: &plan::Plan, forecast: &Forecast) -> String {
    let [width, height] = plan.simulator.view().resolution_px;
    format!(
        "{}: {} samples of {width}x{height} px in {} shard{}; fidelity {}, gelpad {}, optics {}\n\
         probed: {} samples on {} thread{}, {} in contact{}\n\n",
        plan.name(),
        HumanCount(forecast.samples),
        HumanCount(forecast.shards),
        if forecast.shards == 1 { "" } else { "s" },
        plan.fidelity().name(),
        plan.simulator.models().gelpad.name(),
        plan.simulator.models().optics.name(),
        forecast.probed,
        forecast.threads,
        if forecast.threads == 1 { "" } else { "s" },
        forecast.in_contact,
        match forecast.unhealthy {
            0 => String::new(),
            ill => format!("; {ill} not healthy (docs/evidence/stability.md)"),
        },
    )
}

/// One line per effect: how often it ran, its fraction of the time, and the reasons, most frequent first.
fn format_effects(forecast: &Forecast) -> String {
    let mut text = format!("{:<13} {:>10} {:>7}  {}\n", "effect", "enabled", "time", "why");
    let all = total_s(forecast);
    for effect in Effect::ALL {
        let probed = &forecast.effects[effect];
        let mut reasons: Vec<(&String, &u64)> = probed.reasons.iter().map(|((_, why), count)| (why, count)).collect();
        reasons.sort_by_key(|(_, count)| std::cmp::Reverse(**count));
        let only = reasons.len() == 1;
        let named = |(why, count): &(&String, &u64)| if only { (*why).clone() } else { format!("{why} ({count})") };
        let why: Vec<String> = reasons.iter().map(named).collect();
        let fraction = match (effect, probed.ran) {
            (_, 0) => String::from("-"),
            // Darkening is part of the loop of shading, so it has no time of its own.
            (Effect::Darkening, _) => String::from("shading"),
            _ => format_percent(probed.seconds / all),
        };
        let enabled = format!("{} / {}", probed.ran, forecast.probed);
        let _ = writeln!(text, "{:<13} {enabled:>10} {fraction:>7}  {}", effect.name(), why.join("; "));
    }
    text
}

/// Formats one line per stage: CPU time of a sample, and fraction of all.
fn format_stages(forecast: &Forecast) -> String {
    let mut text = format!("\n{:<13} {:>10} {:>7}\n", "stage", "CPU ms", "time");
    let (s, all) = (&forecast.seconds, total_s(forecast));
    let stages = s.stages().into_iter().chain([("write", forecast.write_s), ("all", all)]);
    for (name, seconds) in stages {
        let _ = writeln!(text, "{name:<13} {:>10.2} {:>7}", 1e3 * seconds, format_percent(seconds / all));
    }
    text
}

/// Formats time and size of the run, and the space that is free for it.
fn format_totals(forecast: &Forecast, load_s: f64, root: &Path, free: Option<u64>) -> String {
    let bytes = forecast.bytes as u64;
    let mut text = format!(
        "\ntime   {} on {} thread{}{}: {:.1} samples/s\nsize   {} in {} shard{}",
        HumanDuration(load_s + forecast.wall_s),
        forecast.threads,
        if forecast.threads == 1 { "" } else { "s" },
        if load_s < NEGLIGIBLE_LOAD_S {
            String::new()
        } else {
            format!(", {} of it to load the job", HumanDuration(load_s))
        },
        forecast.samples as f64 / forecast.wall_s.max(1e-9),
        HumanBytes(bytes),
        HumanCount(forecast.shards),
        if forecast.shards == 1 { "" } else { "s" },
    );
    if let Some(free) = free {
        let _ = write!(text, "; {} free at {}", HumanBytes(free), root.display());
        if free < bytes {
            text += ": not enough";
        }
    }
    if let Some(note) = forecast.light.note() {
        let _ = write!(text, "\nlight  {note}");
    }
    text + "\n"
}

/// Formats what is made for all sensors of a set, of which the forecast is for the first. `has_presses` says whether
/// the calibration presses are made, too.
fn format_set(plan: &plan::Plan, forecast: &Forecast, sensors: u64, has_presses: bool) -> String {
    let presses = plan.calibration.as_ref().filter(|_| has_presses).map(|presses| presses.layout.sample_count());
    let named =
        presses.map_or_else(String::new, |count| format!(", and {} calibration presses of each", HumanCount(count)));
    let each = sensors as f64 * (1.0 + presses.unwrap_or(0) as f64 / forecast.samples.max(1) as f64);
    format!(
        "all    {} sensors: {} samples{named}; if all are like the first, {}, about {}, at most {}\n",
        HumanCount(sensors),
        HumanCount(sensors * forecast.samples),
        plan.job().sensor.name,
        HumanBytes((each * forecast.bytes) as u64),
        HumanDuration(each * forecast.wall_s),
    )
}

/// Time to load a job below which it is not mentioned, s.
const NEGLIGIBLE_LOAD_S: f64 = 0.1;

/// CPU time of a sample in all stages, s.
fn total_s(forecast: &Forecast) -> f64 {
    forecast.seconds.simulation() + forecast.seconds.encode + forecast.write_s
}

fn format_percent(fraction: f64) -> String {
    format!("{:.1} %", 100.0 * fraction)
}

/// Returns the bytes that are free where `root` is or would be made; `None` if the system does not say.
fn free_bytes(root: &Path) -> Option<u64> {
    let root = std::path::absolute(root).ok()?;
    let existing = root.ancestors().find(|folder| folder.exists())?;
    let space = rustix::fs::statvfs(existing).ok()?;
    Some(space.f_bavail * space.f_frsize)
}
