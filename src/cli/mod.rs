//! The command line: one file per subcommand, each from arguments to a library call to what is printed.

use std::io::{IsTerminal, Write};

use clap::{Args, Parser, Subcommand};

use crate::config::Overrides;
use crate::config::diagnostic::Report;
use crate::fidelity::Rung;
use crate::plan::Plan;
use crate::tradeoff::choose::{Chosen, choose};

mod completions;
mod generate;
mod init;
pub mod list;
mod preview;
mod schema;
mod tradeoff;

/// Synthetic datasets for optical tactile sensors.
#[derive(Debug, Parser)]
#[command(name = "gelsim", version, about, max_term_width = 100, arg_required_else_help = true)]
pub struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Generate the dataset that a job describes.
    Generate(generate::Generate),
    /// Compare all rungs of the accuracy ladder on a job's samples: error and time.
    Tradeoff(tradeoff::Tradeoff),
    /// Draw a contact sheet of a dataset or of a job's samples.
    Preview(preview::Preview),
    /// Write a commented job to start from.
    Init(init::Init),
    /// List what can be chosen.
    List(list::List),
    /// Print the JSON Schema of a file format.
    Schema(schema::Schema),
    /// Print a completion script for a shell.
    Completions(completions::Completions),
}

/// Why the program ends with a status other than 0.
#[derive(Debug)]
pub struct Failure {
    /// What is printed on standard error.
    pub message: String,
    /// Exit status: 1 failed while running, 2 something the user wrote is wrong, 130 or 143 stopped by a signal.
    pub status: u8,
}

impl Failure {
    /// Something failed while running.
    fn running(message: impl Into<String>) -> Self {
        Self { message: format!("error: {}", message.into()), status: 1 }
    }
}

impl From<Report> for Failure {
    fn from(report: Report) -> Self {
        Self { message: report.render(std::io::stderr().is_terminal()), status: 2 }
    }
}

/// Runs a command.
pub fn run(arguments: Arguments) -> Result<(), Failure> {
    match arguments.command {
        Command::Generate(command) => command.run(),
        Command::Tradeoff(command) => command.run(),
        Command::Preview(command) => command.run(),
        Command::Init(command) => command.run(),
        Command::List(command) => command.run(),
        Command::Schema(command) => command.run(),
        Command::Completions(command) => command.run(),
    }
}

/// A plan whose rung is known: one that the job leaves to be chosen is the recorded one, or is found by probing.
fn settled(plan: Plan, recorded: Option<Rung>, quiet: bool) -> Result<Plan, Failure> {
    let Some(bound) = plan.open_choice() else { return Ok(plan) };
    if let Some(rung) = recorded {
        if !quiet {
            eprintln!("note: fidelity {}, with which the dataset was begun", rung.name());
        }
        return Ok(plan.at(rung));
    }
    let chosen = choose(&plan, bound)?;
    if !quiet {
        let Chosen { rung, error_um, ms } = chosen;
        eprintln!("note: fidelity {} chosen: {error_um:.2} um from the reference, {ms:.1} ms a sample", rung.name());
    }
    Ok(plan.at(chosen.rung))
}

/// What changes a job from the command line.
#[derive(Clone, Debug, Args)]
struct JobOverrides {
    /// Number of samples
    #[arg(long, value_name = "N")]
    samples: Option<u64>,
    /// Seed of all randomness
    #[arg(long, value_name = "S")]
    seed: Option<u64>,
    /// Rung of the accuracy ladder; replaces the job's gelpad and optics
    #[arg(long, value_name = "RUNG")]
    fidelity: Option<Rung>,
    /// Run every effect that the job and the sensor have, also where it changes nothing
    #[arg(long)]
    all_effects: bool,
    /// Any key of the job: dotted.path=TOML-VALUE; paths in it are relative to the current folder
    #[arg(long = "set", value_name = "PATH=VALUE")]
    set: Vec<String>,
}

impl JobOverrides {
    fn any(&self) -> bool {
        let any = self.samples.is_some() || self.seed.is_some() || self.fidelity.is_some();
        any || self.all_effects || !self.set.is_empty()
    }

    fn overrides(&self) -> Overrides {
        let mut set: Vec<(String, String)> =
            self.set.iter().map(|text| (String::from("--set"), text.clone())).collect();
        for (flag, key, value) in [("--samples", "samples", self.samples), ("--seed", "seed", self.seed)] {
            set.extend(value.map(|value| (flag.to_owned(), format!("dataset.{key} = {value}"))));
        }
        if self.all_effects {
            set.push((String::from("--all-effects"), String::from("effects = \"all\"")));
        }
        Overrides { set, fidelity: self.fidelity }
    }
}

/// Prints a result on standard output. Who reads it may have had enough, as `head` has: that is no failure.
fn print(text: &str) -> Result<(), Failure> {
    let mut out = std::io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Failure::running(format!("standard output: {error}")))
        }
        _ => Ok(()),
    }
}

/// Prints notes about a plan on standard error.
fn print_notes(notes: &[String], quiet: bool) {
    if !quiet {
        for note in notes {
            eprintln!("note: {note}");
        }
    }
}
