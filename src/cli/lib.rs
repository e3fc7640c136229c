//! The command line: one file per subcommand, which turns arguments into a call of the library and prints the result.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use std::ffi::OsString;
use std::io::Write;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use clap::{Args, Parser, Subcommand};

use gelsim_core::fidelity::Fidelity;
use gelsim_files::diagnostic::{Report, Severity, user_error};
use gelsim_files::length::Unit;
use gelsim_files::spelling::escape_hidden_chars;
use gelsim_job::config::Overrides;
use gelsim_job::plan::Plan;
use gelsim_lab::tradeoff::choose::choose_level;
use signal_hook::consts::SIGXFSZ;

mod augment;
mod calibrate;
mod compare;
mod completions;
mod export;
mod failure;
mod finalize;
mod generate;
mod guesses;
mod init;
mod inspect;
pub mod list;
mod log;
mod long_run;
mod output_file;
mod plan;
mod preview;
mod progress;
mod render;
mod report;
mod reproduce;
mod schema;
mod store;
mod terminal;
mod tradeoff;
mod verify;

pub use failure::Failure;
use log::Log;
pub use terminal::print_to_stderr;

/// Generate synthetic datasets for optical tactile sensors.
#[derive(Debug, Parser)]
#[command(name = "gelsim", version, max_term_width = 100, arg_required_else_help = true, disable_version_flag = true)]
pub struct Arguments {
    /// Print version
    #[arg(short = 'V', short_alias = 'v', long, action = clap::ArgAction::Version)]
    version: Option<bool>,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Generate the dataset that a job describes.
    Generate(generate::Generate),
    /// Show what a job would do: effects and why, time, bytes.
    Plan(plan::Plan),
    /// Compare all fidelity levels on a job's samples: error and time.
    Tradeoff(tradeoff::Tradeoff),
    /// Measure how far simulated images are from real ones.
    Compare(compare::Compare),
    /// Check that a dataset is valid and complete, and name what is not.
    Verify(verify::Verify),
    /// Write the index and card of a finished dataset.
    Finalize(finalize::Finalize),
    /// Render a sample of a dataset again and compare the bytes.
    Reproduce(reproduce::Reproduce),
    /// Draw a contact sheet of a dataset or of a job's samples.
    Preview(preview::Preview),
    /// Write one HTML page about a dataset.
    Report(report::Report),
    /// Fit the light of a real sensor to presses of a ball.
    Calibrate(calibrate::Calibrate),
    /// Turn depth frames of a simulator into tactile images.
    Render(render::Render),
    /// Enlarge a real dataset.
    Augment(augment::Augment),
    /// Check meshes, and show what a sensor would see of them.
    Inspect(inspect::Inspect),
    /// Write a commented job to start from.
    Init(init::Init),
    /// List what can be chosen.
    List(list::List),
    /// Print the JSON Schema of a file format.
    Schema(schema::Schema),
    /// Print a completion script for a shell.
    Completions(completions::Completions),
    /// Copy a dataset to other formats (with the Python module).
    Export(export::Export),
}

/// Exit status of a program that panicked, which is a bug.
pub const PANICKED: u8 = 101;

/// Runs a command line, whose first word is the program's name, and prints what went wrong. Returns the exit status.
pub fn main(line: impl IntoIterator<Item = OsString>) -> u8 {
    let line: Vec<OsString> = line.into_iter().collect();
    let arguments = match Arguments::try_parse_from(&line) {
        Ok(arguments) => arguments,
        Err(error) => {
            // Help that was asked for, or a mistake in the line. Help that cannot be printed is a failure.
            let error = guesses::add_advice(error, &line);
            let printed = terminal::print_styled(&error.render(), error.use_stderr());
            return if printed.is_ok() { error.exit_code() as u8 } else { (error.exit_code() as u8).max(1) };
        }
    };
    let Err(failure) = run(arguments) else { return 0 };
    failure.print();
    failure.status
}

fn run(arguments: Arguments) -> Result<(), Failure> {
    // Caught so that a file above the user's limit is an error where it is written, not the end of the process.
    signal_hook::flag::register(SIGXFSZ, Arc::new(AtomicBool::new(false)))
        .map_err(|error| Failure::runtime(format!("signals cannot be caught: {error}")))?;
    start_threads(&arguments.command)?;
    match arguments.command {
        Command::Generate(command) => command.run(),
        Command::Plan(command) => command.run(),
        Command::Tradeoff(command) => command.run(),
        Command::Compare(command) => command.run(),
        Command::Verify(command) => command.run(),
        Command::Finalize(command) => command.run(),
        Command::Reproduce(command) => command.run(),
        Command::Preview(command) => command.run(),
        Command::Report(command) => command.run(),
        Command::Calibrate(command) => command.run(),
        Command::Render(command) => command.run(),
        Command::Augment(command) => command.run(),
        Command::Inspect(command) => command.run(),
        Command::Init(command) => command.run(),
        Command::List(command) => command.run(),
        Command::Schema(command) => command.run(),
        Command::Completions(command) => command.run(),
        Command::Export(command) => command.run(),
    }
}

/// Starts the threads that read meshes and render, so that a system that has none to give causes a message, not a
/// panic.
fn start_threads(command: &Command) -> Result<(), Failure> {
    if matches!(
        command,
        Command::Init(_) | Command::List(_) | Command::Schema(_) | Command::Completions(_) | Command::Export(_)
    ) {
        return Ok(());
    }
    rayon::ThreadPoolBuilder::new().build_global().map_err(|error| threads_failure(&error))
}

/// Returns the failure of a system that gives no more threads.
fn threads_failure(error: &dyn std::fmt::Display) -> Failure {
    Failure::runtime_with_help(
        format!("cannot start threads: {error}"),
        "raise the limit of processes or of memory (ulimit -u, -v), or use fewer --threads",
    )
}

/// Returns the plan with a fidelity level: the job's, or if the job leaves it open the `recorded` one, or else the one
/// that probing finds.
fn settle_fidelity(plan: Plan, recorded: Option<Fidelity>, log: Log) -> Result<Plan, Failure> {
    let Some(bound) = plan.open_fidelity_choice() else { return Ok(plan) };
    if let Some(level) = recorded {
        log.print_note(&format!("fidelity {}, with which the dataset was begun", level.name()));
        return Ok(plan.with_fidelity(level));
    }
    let chosen = choose_level(&plan, bound)?;
    log.print_note(&chosen.to_string());
    Ok(plan.with_fidelity(chosen.level))
}

/// Flags that change a job.
#[derive(Clone, Debug, Args)]
struct JobOverrides {
    /// Number of samples
    #[arg(short = 'n', long, value_name = "N", value_parser = guesses::parse_whole_number::<u64>)]
    samples: Option<u64>,
    /// Seed of all randomness
    #[arg(long, value_name = "S", value_parser = guesses::parse_whole_number::<u64>)]
    seed: Option<u64>,
    /// Fidelity level: how exact the numerics are; the job's physics stays
    #[arg(long, value_name = "LEVEL", value_parser = fidelity_level_parser())]
    fidelity: Option<Fidelity>,
    /// Run every effect that the job and the sensor have, also where it changes nothing
    #[arg(long)]
    all_effects: bool,
    /// Any key of the job: dotted.path=TOML-VALUE; paths in it are relative to the current folder
    #[arg(long = "set", value_name = "PATH=VALUE")]
    set: Vec<String>,
    /// Treat notes and warnings as errors: nothing is written
    #[arg(long)]
    strict: bool,
    /// Also print notes that need no action, such as on triangles that were left out
    #[arg(short, long)]
    verbose: bool,
}

impl JobOverrides {
    /// Returns the flags that were given and mean nothing without a job.
    fn given_flags(&self) -> Vec<&'static str> {
        let flags = [
            ("--samples", self.samples.is_some()),
            ("--seed", self.seed.is_some()),
            ("--fidelity", self.fidelity.is_some()),
            ("--all-effects", self.all_effects),
            ("--set", !self.set.is_empty()),
            ("--strict", self.strict),
        ];
        flags.into_iter().filter(|(_, is_given)| *is_given).map(|(name, _)| name).collect()
    }

    /// With `--strict`, fails if there are notes on a job.
    fn refuse_notes(&self, notes: &Report) -> Result<(), Failure> {
        if self.strict && !notes.filter_by_severity(Severity::Note).is_empty() {
            let why = "--strict treats notes and warnings as errors: change the job, or leave --strict out";
            return Err(notes.filter_by_severity(Severity::Note).to_errors(why).into());
        }
        Ok(())
    }

    /// Prints the notes on a job. With `--strict`, fails if there are any.
    fn report_notes(&self, notes: &Report, log: Log) -> Result<(), Failure> {
        self.refuse_notes(notes)?;
        if self.verbose {
            log.print_all_notes(notes)
        } else {
            log.print_notes(notes)
        }
        Ok(())
    }

    fn to_overrides(&self) -> Overrides {
        Overrides::from_flags(self.samples, self.seed, self.fidelity, self.all_effects, &self.set)
    }
}

/// Which part of a dataset is made, where, and on how many threads.
#[derive(Clone, Debug, Args)]
struct Extent {
    /// Folder of the dataset, or its address in a store (s3://, gs://, az://, file://) [default: out/NAME]
    #[arg(short, long, value_name = "DIR", value_parser = store::output_path_parser())]
    out: Option<PathBuf>,
    /// Threads [default: all cores]
    #[arg(short = 'j', long, value_name = "T", value_parser = guesses::parse_whole_number::<usize>)]
    threads: Option<usize>,
    /// Only the shards A to B - 1, counted over train, then val, then test
    #[arg(long, value_name = "A..B", value_parser = parse_range, conflicts_with = "partition")]
    shards: Option<Range<u64>>,
    /// Only part I of N parts, counted from 0
    #[arg(long, value_name = "I/N", value_parser = parse_partition)]
    partition: Option<(u64, u64)>,
}

/// Largest number of threads: more only take memory from each other.
pub const MAX_THREADS: usize = 1024;

impl Extent {
    fn thread_count(&self) -> Result<Option<usize>, Failure> {
        check_thread_count(self.threads)
    }

    fn dataset_root(&self, plan: &Plan) -> PathBuf {
        self.out.clone().unwrap_or_else(|| plan.default_output())
    }

    /// Returns the shards asked for, of `count`; `None` for all.
    fn shard_range(&self, count: u64) -> Result<Option<Range<u64>>, Failure> {
        if let Some(range) = &self.shards
            && range.end > count
        {
            let message = format!("--shards {}..{} reaches beyond the job's {count} shards", range.start, range.end);
            return Err(user_error(message, format!("shards are numbered 0..{count}")).into());
        }
        let part = |(i, n): (u64, u64)| {
            // In 128 bits, because the product may be larger than a u64.
            let cut = |i: u64| (u128::from(count) * u128::from(i) / u128::from(n)) as u64;
            cut(i)..cut(i + 1)
        };
        Ok(self.shards.clone().or(self.partition.map(part)))
    }
}

/// Does a command's work on each of several datasets: a failure with one does not keep it from the others. The work
/// returns false for a dataset of which it has printed what is wrong. Failures but the last are printed here.
fn for_each_dataset(folders: &[PathBuf], mut work: impl FnMut(&Path) -> Result<bool, Failure>) -> Result<(), Failure> {
    let (mut is_valid, mut last_failure) = (true, None::<Failure>);
    for folder in folders {
        match work(folder) {
            Ok(is_valid_there) => is_valid &= is_valid_there,
            // Of a set, it is not made yet.
            Err(failure) if folders.len() > 1 && !folder.join("job.toml").exists() => {
                failure.print();
                is_valid = false;
            }
            Err(failure) => {
                if let Some(earlier) = last_failure.replace(failure) {
                    earlier.print();
                }
            }
        }
    }
    match last_failure {
        Some(failure) => Err(failure),
        None if is_valid => Ok(()),
        None => Err(Failure::already_reported(1)),
    }
}

/// Checks that a machine may have this number of threads.
fn check_thread_count(threads: Option<usize>) -> Result<Option<usize>, Failure> {
    match threads {
        Some(0) => Err(user_error("--threads 0 cannot work", "give 1 or more, or leave it out for all cores").into()),
        Some(threads) if threads > MAX_THREADS => {
            let help = format!("give at most {MAX_THREADS}, or leave it out for all cores");
            Err(user_error(format!("--threads {threads} are more than any machine has cores"), help).into())
        }
        threads => Ok(threads),
    }
}

fn parse_range(text: &str) -> Result<Range<u64>, String> {
    let bounds = text.split_once("..").and_then(|(a, b)| Some((a.parse().ok()?, b.parse().ok()?)));
    match bounds {
        Some((start, end)) if start < end => Ok(start..end),
        _ => Err(String::from("write A..B with A < B, for example 0..10 for the first ten shards")),
    }
}

fn parse_partition(text: &str) -> Result<(u64, u64), String> {
    let parts = text.split_once('/').and_then(|(i, n)| Some((i.parse().ok()?, n.parse().ok()?)));
    match parts {
        Some((i, n)) if i < n => Ok((i, n)),
        _ => Err(String::from("write I/N with I from 0 to N - 1, for example 0/8 for the first of eight parts")),
    }
}

/// Prints a result on standard output. A reader that closes it early, as `head` does, is no failure.
fn print_result(text: &str) -> Result<(), Failure> {
    print_file(&terminal::fold_lines(text, terminal::stdout_display().columns))
}

/// Prints what programs read, such as a job or JSON, on standard output: its lines are not folded.
fn print_file(text: &str) -> Result<(), Failure> {
    let mut out = std::io::stdout().lock();
    let text = escape_hidden_chars(text);
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Failure::runtime(format!("standard output: {error}")))
        }
        _ => Ok(()),
    }
}

/// Parses the name of a unit of length.
fn length_unit_parser() -> impl TypedValueParser<Value = Unit> {
    let values = Unit::ALL.map(|unit| PossibleValue::new(unit.name()).help(unit.plural_name()));
    PossibleValuesParser::new(values)
        .map(|name| Unit::ALL.into_iter().find(|unit| unit.name() == name).expect("one of the possible values"))
}

/// Parses the name of a fidelity level.
fn fidelity_level_parser() -> impl TypedValueParser<Value = Fidelity> {
    let values = Fidelity::ALL.map(|level| PossibleValue::new(level.name()).help(level.summary()));
    PossibleValuesParser::new(values).map(|name| Fidelity::named(&name).expect("one of the possible values"))
}
