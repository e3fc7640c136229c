//! The advice of messages, followed: every refusal of a job in these suites is mended as its help says, where that is spelt.

use gelsim_job::config::Overrides;
use gelsim_job::plan::Plan;

use crate::support::Folder;

/// One paragraph of a report.
#[derive(Debug)]
pub struct Diagnostic {
    pub title: String,
    /// File, line and column as they are printed.
    pub place: String,
    /// The words above the carets.
    pub underlined: String,
    pub help: String,
}

pub fn parse_report(text: &str) -> Vec<Diagnostic> {
    text.trim_end().split("\n\n").map(parse_problem).collect()
}

fn parse_problem(paragraph: &str) -> Diagnostic {
    let lines: Vec<&str> = paragraph.lines().collect();
    let title = lines[0].strip_prefix("error: ").unwrap_or_else(|| panic!("no title in\n{paragraph}")).to_owned();
    let after = |mark: &str| lines.iter().find_map(|line| line.trim_start().strip_prefix(mark)).map(str::to_owned);
    let marks = lines.iter().position(|line| line.contains('^'));
    let underlined = marks.map_or(String::new(), |at| {
        let start = lines[at].chars().take_while(|c| *c != '^').count();
        let length = lines[at].chars().filter(|c| *c == '^').count();
        lines[at - 1].chars().skip(start).take(length).collect()
    });
    Diagnostic {
        title,
        place: after("--> ").unwrap_or_default(),
        underlined,
        help: after("= help: ").unwrap_or_default(),
    }
}

/// Does what a message advises, where that is written out, and expects that the mistake is gone.
pub fn assert_mended(folder: &Folder, said: &str) {
    let Some((_, from)) = said.split_once("error: ").filter(|_| said.matches("error: ").count() == 1) else { return };
    let end = ["\n\n", "\nnote: ", "\nwarning: "].iter().filter_map(|mark| from.find(mark)).min().unwrap_or(from.len());
    let problem = parse_problem(&format!("error: {}", &from[..end]));
    if !problem.place.starts_with("job.toml:") {
        return;
    }
    let problem = &problem;
    let Ok(job) = std::fs::read_to_string(folder.path("job.toml")) else { return };
    let is_in = |said: &str| said.lines().any(|line| line == format!("error: {}", problem.title));
    // What is found as the job is read is found without the command, which also renders samples of a sound one.
    let read = || Plan::load(&folder.path("job.toml"), &Overrides::default()).err();
    let is_found_in_reading = read().is_some_and(|report| is_in(&report.to_string()));
    for mended in follow_advice(&job, problem) {
        folder.write("job.toml", mended.as_str());
        let said = if is_found_in_reading {
            read().map_or_else(String::new, |report| report.to_string())
        } else {
            let output = folder.gelsim("plan job.toml --samples 1 --quiet").output().expect("it runs");
            String::from_utf8_lossy(&output.stderr).into_owned()
        };
        assert!(!is_in(&said), "{problem:#?} was followed:\n{mended}\n{said}");
    }
    folder.write("job.toml", job.as_str());
}

/// The job with the advice followed: once for each way out that a help spells.
fn follow_advice(job: &str, problem: &Diagnostic) -> Vec<String> {
    let mut place = problem.place.rsplit(':').map_while(|part| part.parse::<usize>().ok());
    let (Some(column), Some(line)) = (place.next(), place.next()) else { return Vec::new() };
    let lines: Vec<&str> = job.lines().collect();
    let whole = |lines: Vec<String>| lines.iter().map(|line| format!("{line}\n")).collect::<String>();
    let with_line = |text: String| {
        whole(
            lines
                .iter()
                .enumerate()
                .map(|(at, old)| if at + 1 == line { text.clone() } else { (*old).to_owned() })
                .collect(),
        )
    };
    let instead = |words: &str| {
        let before: String = lines[line - 1].chars().take(column - 1).collect();
        let after: String = lines[line - 1].chars().skip(column - 1 + problem.underlined.chars().count()).collect();
        with_line(format!("{before}{words}{after}"))
    };
    let mut found = Vec::new();
    let help = problem.help.as_str();
    if let Some((_, name)) = help.split_once("did you mean `") {
        let name = name.split('`').next().unwrap_or_default();
        let quote = if problem.underlined.starts_with('"') { "\"" } else { "" };
        found.push(instead(&format!("{quote}{name}{quote}")));
    }
    let own = lines[line - 1].trim_start();
    let is_entry = own.split_once(" =").is_some_and(|(key, _)| key.chars().all(|c| c.is_ascii_lowercase() || c == '_'));
    let leaves = ["leave it out", "leave `"].iter().any(|words| help.starts_with(words));
    let named = help.strip_prefix("leave `").and_then(|rest| rest.split('`').next());
    if leaves && is_entry && named.is_none_or(|key| own.starts_with(&format!("{key} ="))) {
        found.push(with_line(String::new()));
    }
    let value = ["smaller number first: ", "decimal point: "].iter().find_map(|words| Some(help.split_once(words)?.1));
    if let Some(value) = value.filter(|_| problem.underlined.starts_with('[')) {
        found.push(instead(value));
    }
    if let Some(law) = help.split_once("write { ").map(|(_, rest)| rest.split_inclusive('}').next().unwrap_or_default())
        && let Some((key, _)) = own.split_once(" =").filter(|_| is_entry && !law.contains(".."))
    {
        found.push(with_line(format!("{key} = {{ {law}")));
    }
    // The end of a range is allowed.
    let is_number = problem.underlined.parse::<f64>().is_ok();
    let is_range = problem.underlined.starts_with('[') && problem.underlined.matches(',').count() == 1;
    let range = help.split_once("allowed: ").map(|(_, range)| range).filter(|range| !range.contains("below"));
    if let Some(range) = range.filter(|_| is_number || is_range) {
        let mut words = range.split_whitespace();
        if let (Some(least), Some("to"), Some(most)) = (words.next(), words.next(), words.next()) {
            let most = most.trim_end_matches([';', ',']);
            let is_whole = !problem.underlined.contains('.') || most.contains('.');
            let end = if is_whole { most.to_owned() } else { format!("{most}.0") };
            found.push(instead(&if is_number { end } else { format!("[{least}, {end}]") }));
        }
    }
    // A table of its own, behind all others.
    if let Some((before, keys)) = help.split_once("] with ") {
        let name = before.rsplit(' ').next().unwrap_or_default();
        let keys: String =
            assignments(keys, |_| true).into_iter().map(|(key, value, _)| format!("{key} = {value}\n")).collect();
        found.push(format!("{job}\n{name}]\n{keys}"));
        return found;
    }
    // A key that is missing is written where the title says.
    let wanted = problem.title.strip_prefix("missing key ").and_then(|title| title.split_once(" in ["));
    let wanted = wanted.map(|(_, table)| table.trim_matches(['[', ']']).to_owned());
    let is_advice = |before: &str| {
        ["write", "usual is", "or", "and", "such as", "example", ":"].iter().any(|word| before.ends_with(word))
    };
    for (key, value, table) in assignments(help, is_advice) {
        let table = table.or_else(|| wanted.clone());
        match table {
            Some(table) => found.push(whole(in_table(&lines, &key, &value, &table, line))),
            None if lines[line - 1].trim_start().starts_with(&format!("{key} =")) => {
                found.push(with_line(format!("{key} = {value}")));
            }
            None => {}
        }
    }
    found
}

/// What a help says to write: key, value, and the table where it names one.
fn assignments(help: &str, is_advice: impl Fn(&str) -> bool) -> Vec<(String, String, Option<String>)> {
    let mut found = Vec::new();
    for (at, _) in help.match_indices(" = ") {
        let before = &help[..at];
        let start = before.rfind(|c: char| !(c.is_ascii_alphanumeric() || "_.".contains(c))).map_or(0, |at| at + 1);
        let key = &before[start..];
        let said = before[..start].trim_end_matches('`').trim_end();
        let rest = &help[at + 3..];
        let mut depth = 0;
        let mut is_quoted = false;
        let end = rest.char_indices().find(|(_, c)| {
            match c {
                '"' => is_quoted = !is_quoted,
                '[' | '{' if !is_quoted => depth += 1,
                ']' | '}' if !is_quoted => depth -= 1,
                _ => {}
            }
            depth == 0 && !is_quoted && " ,;:`?".contains(*c)
        });
        let (value, after) = rest.split_at(end.map_or(rest.len(), |(at, _)| at));
        let table = after.trim_start_matches('`').strip_prefix(" under ").and_then(|after| {
            let end = after.find(|c: char| !(c.is_ascii_alphanumeric() || "_.[]".contains(c))).unwrap_or(after.len());
            Some(after[..end].trim_matches(['[', ']']).to_owned()).filter(|_| after.starts_with('['))
        });
        if is_advice(said) && !key.is_empty() && !value.contains("..") && !value.is_empty() {
            found.push((key.to_owned(), value.to_owned(), table));
        }
    }
    found
}

/// The lines with a key of a table set: of several tables the one around or before `line`.
fn in_table(lines: &[&str], key: &str, value: &str, table: &str, line: usize) -> Vec<String> {
    let is_head = |text: &str| text.trim() == format!("[{table}]") || text.trim() == format!("[[{table}]]");
    let heads: Vec<usize> = (0..lines.len()).filter(|at| is_head(lines[*at])).collect();
    let own = |text: &&str| text.trim_start().starts_with(&format!("{key} ="));
    let Some(head) = heads.iter().rev().find(|head| **head < line).or(heads.first()) else {
        let more = [format!("[{table}]"), format!("{key} = {value}")];
        return lines.iter().map(|line| (*line).to_owned()).chain(more).collect();
    };
    let end = (head + 1..lines.len()).find(|at| lines[*at].starts_with('[')).unwrap_or(lines.len());
    let inside = lines[head + 1..end].iter().filter(|text| !own(text));
    let kept = lines[..=*head].iter().map(|text| (*text).to_owned());
    kept.chain([format!("{key} = {value}")])
        .chain(inside.map(|text| (*text).to_owned()))
        .chain(lines[end..].iter().map(|text| (*text).to_owned()))
        .collect()
}
