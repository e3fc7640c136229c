//! `gelsim plan`

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use gelsim_lab::numbers::{HumanBytes, HumanCount, HumanDuration};

use super::store::address;
use super::{Extent, Failure, JobOverrides, Log, print, settle_fidelity};
use gelsim_core::effects::Effect;
use gelsim_dataset::folder::recorded_fidelity;
use gelsim_dataset::forecast::{Forecast, first_draw, forecast};
use gelsim_files::diagnostic::{Diagnostic, Report};
use gelsim_job::config::output::OnUnhealthy;
use gelsim_job::plan;
use gelsim_job::probe::foresee;

/// Say what `generate` would do: which effects the samples call for and why, what they take, how long the run lasts and
/// how large it gets. Renders some samples to find out, and writes nothing.
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
    /// Print nothing but the forecast and errors
    #[arg(short, long)]
    quiet: bool,
}

impl Plan {
    pub(super) fn run(self) -> Result<(), Failure> {
        let threads = self.extent.threads()?;
        let start = Instant::now();
        let plan = plan::Plan::load(&self.job, &self.overrides.overrides())?;
        let load_s = start.elapsed().as_secs_f64();
        let foreseen = foresee(&plan);
        self.overrides.note(&foreseen.notes, Log::text(self.quiet))?;
        let root = self.extent.root(&plan);
        let store = address(&root)?;
        let plan = settle_fidelity(plan, recorded_fidelity(&root), Log::text(self.quiet))?;
        let count = plan.layout.shard_count();
        let shards = self.extent.shards(count)?.unwrap_or(0..count);
        let samples = shards.clone().map(|number| plan.layout.shard(number).samples).sum();
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let forecast = forecast(&plan, samples, shards.end - shards.start, threads.unwrap_or(cores));
        let forecast = forecast.map_err(|error| Failure::running(error.to_string()))?;
        if !foreseen.misses {
            let missed = forecast.contacts.missed(&plan, |plan, index| first_draw(plan, index).in_contact);
            let missed = missed.map_or_else(Report::default, Report::from);
            self.overrides.note(&missed, Log::text(self.quiet))?;
        }
        let rejected = warn_of_rejections(&plan, &forecast).map_or_else(Report::default, Report::from);
        self.overrides.note(&rejected, Log::text(self.quiet))?;
        let mut text = heading(&plan, &forecast);
        text += &plan.pressed_sides().map_or_else(String::new, |sides| format!("{sides}\n\n"));
        text += &effects(&forecast);
        text += &stages(&forecast);
        text += &totals(&forecast, load_s, &root, if store.is_some() { None } else { free_bytes(&root) });
        print(&text)
    }
}

/// That most of what is drawn is thrown away, if it is.
fn warn_of_rejections(plan: &plan::Plan, forecast: &Forecast) -> Option<Diagnostic> {
    let (ill, all) = (forecast.unhealthy, forecast.probed);
    (plan.output().on_unhealthy == OnUnhealthy::Reject && 2 * ill > all).then(|| {
        let message = format!(
            "{ill} of {all} samples that were tried are not healthy, and on_unhealthy = \"reject\" draws them again"
        );
        let help =
            "write on_unhealthy = \"keep\" under [output] to see in the labels what is wrong (`health`), and mend that";
        Diagnostic::warning(message).help(help)
    })
}

fn heading(plan: &plan::Plan, forecast: &Forecast) -> String {
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
            ill => format!("; {ill} not healthy (docs/stability.md)"),
        },
    )
}

/// One line per effect: how often it ran, its fraction of the time, and the reasons, most frequent first.
fn effects(forecast: &Forecast) -> String {
    let mut text = format!("{:<13} {:>10} {:>7}  {}\n", "effect", "called for", "time", "why");
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
            // Computed in the same loop.
            (Effect::Darkening, _) => String::from("shading"),
            _ => percent(probed.seconds / all),
        };
        let called = format!("{} / {}", probed.ran, forecast.probed);
        let _ = writeln!(text, "{:<13} {called:>10} {fraction:>7}  {}", effect.name(), why.join("; "));
    }
    text
}

/// One line per stage.
fn stages(forecast: &Forecast) -> String {
    let mut text = format!("\n{:<13} {:>10} {:>7}\n", "stage", "CPU ms", "time");
    let (s, all) = (&forecast.seconds, total_s(forecast));
    let stages = s.stages().into_iter().chain([("write", forecast.write_s), ("all", all)]);
    for (name, seconds) in stages {
        let _ = writeln!(text, "{name:<13} {:>10.2} {:>7}", 1e3 * seconds, percent(seconds / all));
    }
    text
}

fn totals(forecast: &Forecast, load_s: f64, root: &Path, free: Option<u64>) -> String {
    let bytes = forecast.bytes as u64;
    let mut text = format!(
        "\ntime   {} on {} thread{}{}: {:.1} samples/s\nsize   {} in {} shard{}",
        HumanDuration(load_s + forecast.wall_s),
        forecast.threads,
        if forecast.threads == 1 { "" } else { "s" },
        if load_s < SOON_S { String::new() } else { format!(", {} of it to load the job", HumanDuration(load_s)) },
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

/// Time to load a job that is not worth a word, s.
const SOON_S: f64 = 0.1;

fn total_s(forecast: &Forecast) -> f64 {
    forecast.seconds.simulation() + forecast.seconds.encode + forecast.write_s
}

fn percent(fraction: f64) -> String {
    format!("{:.1} %", 100.0 * fraction)
}

/// Bytes that are free where `root` is or would be made, if the system says so.
fn free_bytes(root: &Path) -> Option<u64> {
    let root = std::path::absolute(root).ok()?;
    let there = root.ancestors().find(|folder| folder.exists())?;
    let space = rustix::fs::statvfs(there).ok()?;
    Some(space.f_bavail * space.f_frsize)
}
