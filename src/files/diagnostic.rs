//! What is wrong with something the user wrote: message, place, way out; and how that is printed.

use std::fmt;

use annotate_snippets::{AnnotationKind, Group, Level, Origin, Renderer, Snippet};

use crate::files::source::{Place, Source};
use crate::files::spelling::visible;

/// One mistake.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Diagnostic {
    /// What is wrong, in one sentence without a full stop.
    pub message: String,
    /// Where, if a text holds it.
    pub place: Option<Place>,
    /// What would be right.
    pub help: Option<String>,
}

impl Diagnostic {
    /// A mistake without a place yet.
    pub fn new(message: impl Into<String>) -> Self {
        Self { message: shortened(visible(&message.into()).into_owned()), place: None, help: None }
    }

    /// Says where.
    pub fn at(mut self, place: impl Into<Option<Place>>) -> Self {
        self.place = place.into();
        self
    }

    /// Says what would be right.
    pub fn help(mut self, help: impl Into<String>) -> Self {
        self.help = Some(shortened(visible(&help.into()).into_owned()));
        self
    }
}

/// Mistakes that are collected; who made more does not read them all, and a hostile file has millions.
const MOST: usize = 50;

/// Everything found wrong so far. Work starts only when this is empty.
#[derive(Clone, Debug, Default)]
pub struct Diagnostics(Vec<Diagnostic>);

impl Diagnostics {
    /// Adds a mistake, unless the same one at the same place is there already, or there are enough.
    pub fn push(&mut self, problem: Diagnostic) {
        if self.is_full() || self.0.contains(&problem) {
            return;
        }
        self.0.push(problem);
        if self.is_full() {
            self.0.push(Diagnostic::new("there may be more mistakes than these").help("mend them, then try again"));
        }
    }

    /// True if no more mistakes are taken.
    pub fn is_full(&self) -> bool {
        self.0.len() >= MOST
    }

    /// Adds mistakes found elsewhere.
    pub fn extend(&mut self, found: Diagnostics) {
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
    pub fn sorted(&self) -> Vec<Diagnostic> {
        let mut problems = self.0.clone();
        let found = problems.len().min(MOST);
        problems[..found].sort_by_key(|problem| problem.place);
        problems
    }
}

/// Mistakes together with the texts they were found in: ready to be shown.
#[derive(Debug, Default)]
pub struct Report {
    problems: Vec<Diagnostic>,
    sources: Vec<Source>,
}

impl Report {
    /// Takes over what was found.
    pub fn new(problems: &Diagnostics, sources: &[Source]) -> Self {
        let named = |source: &Source| Source { name: visible(&source.name).into_owned(), ..source.clone() };
        Self { problems: problems.sorted(), sources: sources.iter().map(named).collect() }
    }

    /// A report of one mistake that has no text around it.
    pub fn message(message: impl Into<String>) -> Self {
        Self { problems: vec![Diagnostic::new(message)], sources: Vec::new() }
    }

    /// The mistakes of both, those of `other` last.
    pub fn and(mut self, other: Self) -> Self {
        let before = self.sources.len();
        self.sources.extend(other.sources);
        self.problems.extend(other.problems.into_iter().map(|mut problem| {
            problem.place = problem.place.map(|place| Place { source: place.source + before, ..place });
            problem
        }));
        self
    }

    /// The same with `to` in place of `from` in all that is said.
    pub fn saying(mut self, from: &str, to: &str) -> Self {
        for problem in &mut self.problems {
            problem.message = problem.message.replace(from, to);
            problem.help = problem.help.take().map(|help| help.replace(from, to));
        }
        for source in &mut self.sources {
            source.name = source.name.replace(from, to);
        }
        self
    }

    /// True without a mistake.
    pub fn is_empty(&self) -> bool {
        self.problems.is_empty()
    }

    /// One paragraph per mistake, each with `file:line:column`, the line and what would be right.
    /// `styled` adds terminal colours.
    pub fn render(&self, styled: bool) -> String {
        let renderer = if styled { Renderer::styled() } else { Renderer::plain() };
        let paragraphs: Vec<String> =
            self.problems.iter().map(|problem| renderer.render(&[self.group(problem)])).collect();
        paragraphs.join("\n\n")
    }

    fn group<'a>(&'a self, problem: &'a Diagnostic) -> Group<'a> {
        let title = Level::ERROR.primary_title(problem.message.as_str());
        let source = problem.place.and_then(|place| Some((self.sources.get(place.source)?, place)));
        let mut group = match source.map(|(source, place)| (source, Line::from_text(&source.text, place))) {
            None => Group::with_title(title),
            Some((source, line)) if line.text.len() > LONGEST_LINE => title.element(
                Origin::path(source.name.as_str())
                    .line(line.number)
                    .char_column(line.text[..line.start].chars().count() + 1),
            ),
            Some((source, line)) => {
                let mark = AnnotationKind::Primary.span(line.start..line.end);
                title.element(
                    Snippet::source(line.text).line_start(line.number).path(source.name.as_str()).annotation(mark),
                )
            }
        };
        if let Some(help) = &problem.help {
            group = group.element(Level::HELP.message(help.as_str()));
        }
        group
    }
}

/// A longer line is not shown, only where it is, bytes.
const LONGEST_LINE: usize = 2000;

/// The part of a place that is worth showing: its first line, and the bytes of it to be underlined.
struct Line<'a> {
    text: &'a str,
    number: usize,
    start: usize,
    end: usize,
}

impl<'a> Line<'a> {
    fn from_text(text: &'a str, place: Place) -> Self {
        let floor = |mut at: usize| {
            at = at.min(text.len());
            while !text.is_char_boundary(at) {
                at -= 1;
            }
            at
        };
        let start = floor(place.start);
        let end = floor(place.end.max(start));
        let first = text[..start].rfind('\n').map_or(0, |at| at + 1);
        let last = text[start..].find('\n').map_or(text.len(), |length| start + length + 1);
        let end = text[start..end].find('\n').map_or(end, |length| start + length);
        let number = text[..first].bytes().filter(|byte| *byte == b'\n').count() + 1;
        Self { text: &text[first..last], number, start: start - first, end: end - first }
    }
}

/// Characters of a message or a hint that are shown.
const LONGEST_MESSAGE: usize = 1000;

/// The text, or its start and its end: it may quote what the user wrote, which may be megabytes.
fn shortened(text: String) -> String {
    match text.char_indices().nth(LONGEST_MESSAGE) {
        None => text,
        Some(_) => {
            let cut = |at: usize| text.char_indices().nth(at).map_or(text.len(), |(at, _)| at);
            let last = text.char_indices().rev().nth(LONGEST_MESSAGE / 4).map_or(0, |(at, _)| at);
            format!("{} .. {}", &text[..cut(LONGEST_MESSAGE / 2)], &text[last..])
        }
    }
}

/// A mistake found outside the texts that were read, such as in a flag.
pub fn user_error(message: impl Into<String>, help: impl Into<String>) -> Report {
    let mut problems = Diagnostics::default();
    problems.push(Diagnostic::new(message).help(help));
    Report::new(&problems, &[])
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.render(false))
    }
}

impl std::error::Error for Report {}
