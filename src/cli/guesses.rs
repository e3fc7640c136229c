//! Advice on flags, commands and values that other programs have and this one does not.

use std::ffi::OsString;

use clap::builder::StyledStr;
use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{Command, CommandFactory, Error};

use super::Arguments;

/// Flags of other programs, and those that are meant: the first of them that the command has is suggested.
const FLAG_GUESSES: &[(&[&str], &[&str])] = &[
    (&["--n", "-n", "--num", "--number", "--num-samples", "--n-samples", "--count"], &["--samples", "--count"]),
    (&["--force", "-f", "--yes", "-y", "--replace", "--clobber"], &["--overwrite"]),
    (
        &["--jobs", "--workers", "--num-workers", "--num-threads", "--cpus", "--parallel", "--processes", "-t", "-p"],
        &["--threads"],
    ),
    (
        &["--output", "--output-dir", "--out-dir", "--outdir", "--dest", "--destination", "--dir", "--target"],
        &["--out"],
    ),
    (&["--level", "--quality", "--rung"], &["--fidelity"]),
    (&["--random-seed", "--rng-seed", "-s"], &["--seed"]),
    (&["--silent"], &["--quiet"]),
    (&["--debug", "--info"], &["--verbose"]),
    (&["--index", "--sample", "--id"], &["--key"]),
    (&["--preset"], &["--sensor"]),
    (&["--units"], &["--unit", "--depth-unit"]),
    (&["--plane", "--distance"], &["--plane-mm"]),
    (&["--fov"], &["--fov-y-deg"]),
    (&["--input", "--frames", "-i"], &["--depth"]),
    (&["--bg", "--reference"], &["--background"]),
];

/// Flags whose purpose something else serves: a key of the job, another command.
const ELSEWHERE_GUESSES: &[(&[&str], &str)] = &[
    (
        &["--dry-run", "--dryrun", "--plan", "--check"],
        "`gelsim plan JOB.toml` says what would be done, and writes nothing",
    ),
    (&["--resolution", "--size", "--image-size", "--width", "--height"], "--set 'sensor.resolution_px=[320, 240]'"),
    (&["--sensor", "--preset"], "--set 'sensor.preset=\"digit\"'"),
    (&["--layers", "--outputs"], "--set 'output.layers=[\"depth\", \"contact\"]'"),
    (&["--depth", "--depth-mm"], "--set 'indentation.depth_mm=[0.3, 0.9]'"),
    (
        &["--object", "--objects", "--mesh", "--meshes"],
        "the job names its meshes: `gelsim init --objects FOLDER job.toml` writes one for a folder",
    ),
    (&["--config", "--job", "-c", "--file"], "the file stands by itself, without a flag before it"),
    (&["--gpu", "--device", "--cuda", "--gpus"], "it runs on CPUs, on all cores unless --threads says fewer"),
    (&["--resume", "--continue"], "the same command goes on where a run was stopped"),
    (
        &["--finite-elements", "--sticking", "--edge-mm", "--refine"],
        "--fidelity finite-strain solves large strains; `gelsim tradeoff JOB.toml` compares every level with it",
    ),
    (&["--format"], "`gelsim export DIR --to lerobot|zarr|hdf5 --out OUT` copies a dataset to other formats"),
];

/// Commands of other programs, and what to run instead.
const COMMAND_GUESSES: &[(&[&str], &str)] = &[
    (&["version", "-v"], "gelsim --version"),
    (
        &["run", "gen", "create", "make", "build", "simulate", "start", "resume", "continue", "sample"],
        "gelsim generate JOB.toml",
    ),
    (&["check", "validate", "lint", "test"], "gelsim verify DIR of a dataset, gelsim plan JOB.toml of a job"),
    (
        &["show", "view", "sheet", "visualize", "visualise", "plot", "display"],
        "gelsim preview DIR|JOB.toml --out sheet.png",
    ),
    (
        &["info", "describe", "stats", "summary", "statistics"],
        "gelsim report DIR of a dataset, gelsim inspect MESH of a mesh",
    ),
    (&["new", "template", "example", "start-job", "scaffold"], "gelsim init job.toml"),
    (
        &["presets", "sensors", "levels", "effects", "objects", "layers"],
        "gelsim list sensors|levels|effects|layers|objects",
    ),
    (&["convert", "to", "lerobot", "zarr", "hdf5"], "gelsim export DIR --to lerobot|zarr|hdf5 --out OUT"),
    (&["bench", "benchmark", "accuracy", "ladder"], "gelsim tradeoff JOB.toml"),
    (&["fit", "calib", "calibration"], "gelsim calibrate PRESSES.csv --background BG.png --out SENSOR.toml"),
    (&["merge", "finish", "index"], "gelsim finalize DIR"),
    (&["mesh", "meshes"], "gelsim inspect MESH"),
];

/// Values of other programs, and those that are meant.
const VALUE_GUESSES: &[(&[&str], &str)] = &[
    (&["presets", "preset", "sensor"], "sensors"),
    (&["level", "fidelity", "fidelities", "rung", "rungs", "quality"], "levels"),
    (&["mesh", "meshes", "object", "indenters"], "objects"),
    (&["layer", "outputs", "output", "channels", "maps"], "layers"),
    (&["effect"], "effects"),
    (&["meter", "meters", "metre", "metres"], "m"),
    (&["millimeter", "millimeters", "millimetre", "millimetres"], "mm"),
    (&["micrometer", "micrometers", "micrometre", "micrometres", "micron", "microns"], "um"),
    (&["centimeter", "centimeters", "centimetre", "centimetres"], "cm"),
    (&["inch", "inches"], "in"),
    (&["pinhole"], "perspective"),
    (&["parallel", "ortho"], "orthographic"),
    (&["gelsight", "mini", "gelsight_mini", "gelsightmini"], "gelsight-mini"),
];

/// Returns what a table gives for a word, in any case of letters.
fn find_guess<T: Copy>(table: &[(&[&str], T)], written: &str) -> Option<T> {
    let written = written.to_lowercase();
    table.iter().find(|(guesses, _)| guesses.contains(&written.as_str())).map(|(_, meant)| *meant)
}

/// Adds the advice that fits what the user means to the error of a command line.
pub(super) fn add_advice(mut error: Error, line: &[OsString]) -> Error {
    let text = |kind: ContextKind| match error.get(kind) {
        Some(ContextValue::String(text)) => Some(text.clone()),
        _ => None,
    };
    let root = Arguments::command();
    let command = line.iter().skip(1).find_map(|word| root.find_subcommand(word.to_str()?)).cloned();
    match error.kind() {
        ErrorKind::UnknownArgument => {
            let Some(flag) = text(ContextKind::InvalidArg) else { return error };
            // clap's own guess, that it might be a value, leads nowhere.
            error.remove(ContextKind::Suggested);
            if flag.ends_with(".toml") && command.as_ref().is_some_and(|command| command.get_name() == "render") {
                add_suggestion(
                    &mut error,
                    "gelsim generate JOB.toml and gelsim preview JOB.toml render a job; render takes --depth FRAMES",
                );
                return error;
            }
            let has = |wanted: &&&str| command.as_ref().is_some_and(|command| has_flag(command, wanted));
            let known = find_guess(FLAG_GUESSES, &flag).and_then(|meant| meant.iter().find(has));
            if let Some(known) = known {
                error.insert(ContextKind::SuggestedArg, ContextValue::String((*known).to_owned()));
            } else if let Some(help) = find_guess(ELSEWHERE_GUESSES, &flag) {
                error.remove(ContextKind::SuggestedArg);
                add_suggestion(&mut error, help);
            }
        }
        ErrorKind::InvalidSubcommand => {
            let Some(name) = text(ContextKind::InvalidSubcommand) else { return error };
            if let Some(help) = find_guess(COMMAND_GUESSES, &name) {
                error.remove(ContextKind::SuggestedSubcommand);
                add_suggestion(&mut error, help);
            }
        }
        ErrorKind::InvalidValue => {
            let Some(value) = text(ContextKind::InvalidValue) else { return error };
            let known = match error.get(ContextKind::ValidValue) {
                Some(ContextValue::Strings(known)) => known.clone(),
                _ => Vec::new(),
            };
            let same = known.iter().find(|known| known.eq_ignore_ascii_case(&value)).map(String::as_str);
            let by_table = find_guess(VALUE_GUESSES, &value).filter(|meant| known.iter().any(|known| known == meant));
            if let Some(meant) = same.or(by_table) {
                error.insert(ContextKind::SuggestedValue, ContextValue::String(meant.to_owned()));
            }
        }
        _ => {}
    }
    error
}

fn add_suggestion(error: &mut Error, help: &str) {
    error.insert(ContextKind::Suggested, ContextValue::StyledStrs(vec![StyledStr::from(help.to_owned())]));
}

fn has_flag(command: &Command, flag: &str) -> bool {
    command
        .get_arguments()
        .any(|argument| argument.get_long().is_some_and(|long| flag.strip_prefix("--") == Some(long)))
}

/// Parses an integer of 0 or more. If the text is a number in another form, such as `1k`, the error says how to write
/// it.
pub(super) fn parse_whole_number<T: TryFrom<u64>>(text: &str) -> Result<T, String> {
    if let Some(number) = text.parse::<u64>().ok().and_then(|number| T::try_from(number).ok()) {
        return Ok(number);
    }
    let plain = text.trim().replace([',', '_', ' '], "");
    let (digits, times) = match plain.to_lowercase() {
        text if text.ends_with('k') => (text[..text.len() - 1].to_owned(), 1e3),
        text if text.ends_with('m') => (text[..text.len() - 1].to_owned(), 1e6),
        text => (text, 1.0),
    };
    match digits.parse::<f64>().ok().map(|number| times * number).and_then(gelsim_job::config::format_integer) {
        Some(number) if number != text => Err(format!("write a whole number: {number}")),
        _ => Err(String::from("write a whole number, such as 100")),
    }
}

/// Parses a number of things of which there is at least one.
pub(super) fn parse_count<T: TryFrom<u64>>(text: &str) -> Result<T, String> {
    match text.parse::<u64>() {
        Ok(0) => Err(String::from("write 1 or more")),
        _ => parse_whole_number(text),
    }
}

/// Parses a number. If the text has a decimal comma, the error says how to write it.
pub(super) fn parse_number(text: &str) -> Result<f64, String> {
    text.parse().map_err(|_| match text.replace(',', ".").parse::<f64>() {
        Ok(number) => format!("write a number: {number}"),
        Err(_) => String::from("write a number, such as 10 or 0.5"),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flags_that_are_advised_are_flags_of_some_command_and_commands_are_commands() {
        let root = Arguments::command();
        for flag in FLAG_GUESSES.iter().flat_map(|(_, meant)| *meant) {
            assert!(root.get_subcommands().any(|command| has_flag(command, flag)), "{flag}");
        }
        for (_, help) in COMMAND_GUESSES {
            for command in help.split("gelsim ").skip(1) {
                let name = command.split([' ', ',']).next().unwrap_or_default();
                assert!(name == "--version" || root.find_subcommand(name).is_some(), "{name} of {help}");
            }
        }
    }

    #[test]
    fn numbers_are_refused_in_plain_words() {
        assert_eq!(parse_whole_number::<u64>("1000"), Ok(1000));
        assert_eq!(parse_whole_number::<u64>("1k"), Err(String::from("write a whole number: 1000")));
        assert_eq!(parse_whole_number::<u64>("1,000"), Err(String::from("write a whole number: 1000")));
        assert_eq!(parse_whole_number::<u64>("1e3"), Err(String::from("write a whole number: 1000")));
        assert_eq!(parse_whole_number::<u64>("abc"), Err(String::from("write a whole number, such as 100")));
        assert_eq!(parse_whole_number::<u64>("-3"), Err(String::from("write a whole number, such as 100")));
        assert_eq!(parse_number("0,5"), Err(String::from("write a number: 0.5")));
    }
}
