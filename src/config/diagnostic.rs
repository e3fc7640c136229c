//! What is wrong with something the user wrote: message, place, way out; and how that is printed.

use std::fmt;

use annotate_snippets::{AnnotationKind, Group, Level, Renderer, Snippet};

use super::document::{Place, Source};

/// One mistake.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Problem {
    /// What is wrong, in one sentence without a full stop.
    pub message: String,
    /// Where, if a text holds it.
    pub place: Option<Place>,
    /// What would be right.
    pub help: Option<String>,
}

impl Problem {
    /// A mistake without a place yet.
    pub fn new(message: impl Into<String>) -> Self {
        Self { message: message.into(), place: None, help: None }
    }

    /// Says where.
    pub fn at(mut self, place: impl Into<Option<Place>>) -> Self {
        self.place = place.into();
        self
    }

    /// Says what would be right.
    pub fn help(mut self, help: impl Into<String>) -> Self {
        self.help = Some(help.into());
        self
    }
}

/// Everything found wrong so far. Work starts only when this is empty.
#[derive(Clone, Debug, Default)]
pub struct Problems(Vec<Problem>);

impl Problems {
    /// Adds a mistake, unless the same one at the same place is there already.
    pub fn push(&mut self, problem: Problem) {
        if !self.0.contains(&problem) {
            self.0.push(problem);
        }
    }

    /// Adds mistakes found elsewhere.
    pub fn extend(&mut self, found: Problems) {
        found.0.into_iter().for_each(|problem| self.push(problem));
    }

    /// True as long as nothing is wrong.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Where the mistakes are.
    pub fn places(&self) -> impl Iterator<Item = Place> + '_ {
        self.0.iter().filter_map(|problem| problem.place)
    }

    /// The mistakes, in the order in which they stand in their sources.
    pub fn sorted(&self) -> Vec<Problem> {
        let mut problems = self.0.clone();
        problems.sort_by_key(|problem| problem.place);
        problems
    }
}

/// Mistakes together with the texts they were found in: ready to be shown.
#[derive(Debug)]
pub struct Report {
    problems: Vec<Problem>,
    sources: Vec<Source>,
}

impl Report {
    /// Takes over what was found.
    pub fn new(problems: &Problems, sources: &[Source]) -> Self {
        Self { problems: problems.sorted(), sources: sources.to_vec() }
    }

    /// A report of one mistake that has no text around it.
    pub fn message(message: impl Into<String>) -> Self {
        Self { problems: vec![Problem::new(message)], sources: Vec::new() }
    }

    /// One paragraph per mistake, each with `file:line:column`, the line and what would be right.
    /// `styled` adds terminal colours.
    pub fn render(&self, styled: bool) -> String {
        let renderer = if styled { Renderer::styled() } else { Renderer::plain() };
        let paragraphs: Vec<String> =
            self.problems.iter().map(|problem| renderer.render(&[self.group(problem)])).collect();
        paragraphs.join("\n\n")
    }

    fn group<'a>(&'a self, problem: &'a Problem) -> Group<'a> {
        let title = Level::ERROR.primary_title(problem.message.as_str());
        let snippet = problem.place.and_then(|place| {
            let source = self.sources.get(place.source)?;
            let (start, end) = visible_span(&source.text, place);
            let mark = AnnotationKind::Primary.span(start..end);
            Some(Snippet::source(source.text.as_str()).path(source.name.as_str()).annotation(mark))
        });
        let mut group = match snippet {
            Some(snippet) => title.element(snippet),
            None => Group::with_title(title),
        };
        if let Some(help) = &problem.help {
            group = group.element(Level::HELP.message(help.as_str()));
        }
        group
    }
}

/// The part of a place that is worth underlining: its first line only, on character boundaries.
fn visible_span(text: &str, place: Place) -> (usize, usize) {
    let floor = |mut at: usize| {
        at = at.min(text.len());
        while !text.is_char_boundary(at) {
            at -= 1;
        }
        at
    };
    let start = floor(place.start);
    let end = floor(place.end.max(start));
    let line_end = text[start..end].find('\n').map_or(end, |length| start + length);
    (start, line_end)
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.render(false))
    }
}

impl std::error::Error for Report {}

/// The known name closest to what was written, if it is close enough to be a slip.
pub fn nearest<'a>(written: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    known
        .into_iter()
        .map(|name| (strsim::damerau_levenshtein(written, name), name))
        .filter(|(distance, name)| *distance <= 1 + name.len().max(written.len()) / 3)
        .min_by_key(|(distance, _)| *distance)
        .map(|(_, name)| name)
}

/// `a`, `b` or `c`.
pub fn one_of(names: &[&str]) -> String {
    let quoted: Vec<String> = names.iter().map(|name| format!("`{name}`")).collect();
    match quoted.split_last() {
        None => String::from("nothing"),
        Some((only, [])) => only.clone(),
        Some((last, rest)) => format!("{} or {last}", rest.join(", ")),
    }
}
