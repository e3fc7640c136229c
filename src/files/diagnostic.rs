//! What a user should know of something they wrote: message, place, way out; and how that is printed.

use std::fmt;

use annotate_snippets::{AnnotationKind, Group, Level, Origin, Renderer, Snippet};
use serde::Serialize;

use crate::source::{Place, Source};
use crate::spelling::{visible, without_codes};

/// How bad it is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// Good to know; there is nothing to do.
    Info,
    /// The work is done; there is something that one may want to do otherwise.
    Note,
    /// The work is done; its result is probably not what is wanted.
    Warning,
    /// Nothing is done.
    #[default]
    Error,
}

impl Severity {
    /// As it is printed.
    pub fn name(self) -> &'static str {
        match self {
            Self::Info => "info",
            Self::Note => "note",
            Self::Warning => "warning",
            Self::Error => "error",
        }
    }

    fn level(self) -> Level<'static> {
        match self {
            Self::Info => Level::INFO,
            Self::Note => Level::NOTE,
            Self::Warning => Level::WARNING,
            Self::Error => Level::ERROR,
        }
    }
}

/// One thing to know.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Diagnostic {
    /// How bad it is.
    pub severity: Severity,
    /// What it is, in one sentence without a full stop.
    pub message: String,
    /// Where, if a text holds it; of several places the first.
    pub place: Option<Place>,
    /// What to do.
    pub help: Option<String>,
    /// What follows from it that is looked for elsewhere, too.
    pub consequence: Option<Consequence>,
    /// What it is said of, where the same may be true of many.
    pub subjects: Option<Box<Subjects>>,
}

/// What may follow from what a diagnostic says, so that it is not said a second time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Consequence {
    /// Objects touch nothing.
    NoContact,
}

/// Files, rows or frames of which the same is true.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Subjects {
    /// What is true of them: the end of a sentence that begins with their number.
    pub cause: String,
    /// How many they are.
    pub count: usize,
    /// The first of them.
    pub first: Vec<String>,
}

/// Subjects that a message names.
const NAMED: usize = 3;

impl Diagnostic {
    /// A mistake without a place yet.
    pub fn new(message: impl Into<String>) -> Self {
        Self {
            severity: Severity::Error,
            message: shortened(visible(&without_codes(message.into())).into_owned()),
            place: None,
            help: None,
            consequence: None,
            subjects: None,
        }
    }

    /// Something that is done and yet probably not wanted.
    pub fn warning(message: impl Into<String>) -> Self {
        Self { severity: Severity::Warning, ..Self::new(message) }
    }

    /// Something that one may want to do otherwise.
    pub fn note(message: impl Into<String>) -> Self {
        Self { severity: Severity::Note, ..Self::new(message) }
    }

    /// Something that needs nothing done.
    pub fn info(message: impl Into<String>) -> Self {
        Self { severity: Severity::Info, ..Self::new(message) }
    }

    /// Says where.
    pub fn at(mut self, place: impl Into<Option<Place>>) -> Self {
        self.place = place.into();
        self
    }

    /// Says what would be right.
    pub fn help(mut self, help: impl Into<String>) -> Self {
        self.help = Some(shortened(visible(&without_codes(help.into())).into_owned()));
        self
    }

    /// Says that objects may touch nothing because of it.
    pub fn explains_misses(mut self) -> Self {
        self.consequence = Some(Consequence::NoContact);
        self
    }

    /// Says what the message is about, and what is true of many such: "files do not exist". [`Diagnostics`] make one message
    /// of all that have the same cause and help.
    pub fn of(mut self, subject: impl Into<String>, cause: impl Into<String>) -> Self {
        let subject = shortened(visible(&subject.into()).into_owned());
        self.subjects = Some(Box::new(Subjects { cause: cause.into(), count: 1, first: vec![subject] }));
        self
    }

    /// The message; of several subjects their number, what is true of them, and the first ones.
    pub fn text(&self) -> String {
        match self.subjects.as_deref() {
            Some(Subjects { cause, count, first }) if *count > 1 => {
                let more = match count - first.len() {
                    0 => String::new(),
                    more => format!(" and {more} more"),
                };
                format!("{count} {cause}: {}{more}", first.join(", "))
            }
            _ => self.message.clone(),
        }
    }

    /// Takes another subject of the same cause in; false if it is something else.
    fn join(&mut self, other: &Self) -> bool {
        let same = self.severity == other.severity && self.help == other.help;
        match (&mut self.subjects, &other.subjects) {
            (Some(own), Some(more)) if same && own.cause == more.cause => {
                own.count += more.count;
                own.first.extend(more.first.iter().take(NAMED.saturating_sub(own.first.len())).cloned());
                self.place = [self.place, other.place].into_iter().flatten().min();
                true
            }
            _ => false,
        }
    }
}

/// Mistakes that are collected; who made more does not read them all, and a hostile file has millions.
const MOST: usize = 50;

/// Everything found so far. Work starts only when no mistake is among it.
#[derive(Clone, Debug, Default)]
pub struct Diagnostics(Vec<Diagnostic>);

impl Diagnostics {
    /// Adds one, unless the same one at the same place is there already, or there are enough. Of the same cause there is one.
    pub fn push(&mut self, problem: Diagnostic) {
        if self.0.contains(&problem) || self.0.iter_mut().any(|known| known.join(&problem)) || self.is_full() {
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

    /// Adds what was found elsewhere.
    pub fn extend(&mut self, found: impl IntoIterator<Item = Diagnostic>) {
        found.into_iter().for_each(|problem| self.push(problem));
    }

    /// True as long as nothing was found.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// All of them, in the order in which they were found.
    pub fn iter(&self) -> impl Iterator<Item = &Diagnostic> {
        self.0.iter()
    }

    /// Where the mistakes are.
    pub fn places(&self) -> impl Iterator<Item = Place> + '_ {
        self.0.iter().filter_map(|problem| problem.place)
    }

    /// All of them, in the order in which they stand in their sources.
    pub fn sorted(&self) -> Vec<Diagnostic> {
        let mut problems = self.0.clone();
        let found = problems.len().min(MOST);
        problems[..found].sort_by_key(|problem| problem.place);
        problems
    }
}

impl IntoIterator for Diagnostics {
    type Item = Diagnostic;
    type IntoIter = std::vec::IntoIter<Diagnostic>;

    fn into_iter(self) -> Self::IntoIter {
        self.0.into_iter()
    }
}

/// How text is shown where it goes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Display {
    /// With the colours of a terminal.
    pub is_styled: bool,
    /// Within so many columns; none: a line is as long as it is.
    pub columns: Option<usize>,
}

impl Display {
    /// Text as a file or a program takes it.
    pub const PLAIN: Self = Self { is_styled: false, columns: None };

    /// Folds a paragraph between its words, so that `indent` more columns stand before each line.
    fn fold(self, text: &str, indent: usize) -> String {
        match self.columns {
            None => text.to_owned(),
            Some(columns) => {
                let options = textwrap::Options::new(columns.saturating_sub(indent).max(NARROWEST)).break_words(false);
                textwrap::fill(text, options)
            }
        }
    }
}

/// Text is not folded into fewer columns.
const NARROWEST: usize = 16;

/// Diagnostics together with the texts they were found in: ready to be shown.
#[derive(Clone, Debug, Default)]
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
        Self::from(Diagnostic::new(message))
    }

    /// Where one of its diagnostics is, as `file:line:column`.
    pub fn place(&self, problem: &Diagnostic) -> Option<String> {
        let place = problem.place?;
        let source = self.sources.get(place.source)?;
        let line = Line::from_text(&source.text, place);
        Some(format!("{}:{}:{}", source.name, line.number, line.column()))
    }

    /// What it holds.
    pub fn problems(&self) -> &[Diagnostic] {
        &self.problems
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

    /// What of it is so bad, or worse.
    pub fn at_least(&self, least: Severity) -> Self {
        let problems = self.problems.iter().filter(|problem| problem.severity >= least).cloned().collect();
        Self { problems, sources: self.sources.clone() }
    }

    /// What a user is shown who does not ask for all: what is more than an information, and what can be had otherwise.
    pub fn worth_showing(&self) -> Self {
        let is_shown = |problem: &&Diagnostic| problem.severity > Severity::Info || problem.help.is_some();
        let problems = self.problems.iter().filter(is_shown).cloned().collect();
        Self { problems, sources: self.sources.clone() }
    }

    /// A text for each that is more than an information: what it is, and what to do.
    pub fn texts(&self) -> Vec<String> {
        let text = |problem: &Diagnostic| match &problem.help {
            Some(help) => format!("{}: {help}", problem.text()),
            None => problem.text(),
        };
        self.problems.iter().filter(|problem| problem.severity > Severity::Info).map(text).collect()
    }

    /// All of it as errors, with one more to say why.
    pub fn as_errors(&self, why: &str) -> Self {
        let mut report = self.clone();
        report.problems.iter_mut().for_each(|problem| problem.severity = Severity::Error);
        report.problems.push(Diagnostic::note(why));
        report
    }

    /// True without a mistake.
    pub fn is_empty(&self) -> bool {
        self.problems.is_empty()
    }

    /// A paragraph for each: severity and message; `file:line:column` and the line, if it has a place; what to do.
    pub fn render(&self, display: Display) -> String {
        let paragraphs: Vec<String> = self.paragraphs(display).collect();
        paragraphs.join("\n\n")
    }

    /// The paragraphs of [`Self::render`].
    pub fn paragraphs(&self, display: Display) -> impl Iterator<Item = String> + '_ {
        let renderer = if display.is_styled { Renderer::styled() } else { Renderer::plain() };
        let renderer = display.columns.map_or(renderer.clone(), |columns| renderer.term_width(columns));
        self.problems.iter().map(move |problem| {
            // Columns before a title, and before a help that stands below a line's number.
            let title = display.fold(&problem.text(), problem.severity.name().len() + 2);
            let help = problem.help.as_ref().map(|help| display.fold(help, HELP_INDENT));
            renderer.render(&[self.group(problem, &title, help.as_deref(), display.columns)])
        })
    }

    fn group<'a>(
        &'a self,
        problem: &'a Diagnostic,
        title: &'a str,
        help: Option<&'a str>,
        columns: Option<usize>,
    ) -> Group<'a> {
        let title = problem.severity.level().primary_title(title);
        let source = problem.place.and_then(|place| Some((self.sources.get(place.source)?, place)));
        let mut group = match source.map(|(source, place)| (source, Line::from_text(&source.text, place))) {
            None => Group::with_title(title),
            Some((source, line)) if line.text.len() > LONGEST_LINE => {
                title.element(Origin::path(source.name.as_str()).line(line.number).char_column(line.column()))
            }
            Some((source, line)) => {
                let mark = AnnotationKind::Primary.span(line.start..line.end_within(columns));
                title.element(
                    Snippet::source(line.text).line_start(line.number).path(source.name.as_str()).annotation(mark),
                )
            }
        };
        if let Some(help) = help {
            group = group.element(Level::HELP.message(help));
        }
        group
    }
}

/// Columns before a help: a number of four digits, the rule, and the word itself.
const HELP_INDENT: usize = "1234 = help: ".len();

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
    /// Counted from 1.
    fn column(&self) -> usize {
        self.text[..self.start].chars().count() + 1
    }

    /// The end of what is underlined: what is wider than the terminal could not be cut to it.
    fn end_within(&self, columns: Option<usize>) -> usize {
        /// Columns for the line's number, its rule, and the dots where it is cut.
        const BESIDE: usize = 14;
        let Some(columns) = columns else { return self.end };
        let marked = &self.text[self.start..self.end];
        let cut = marked.char_indices().nth(columns.saturating_sub(BESIDE).max(1));
        cut.map_or(self.end, |(at, _)| self.start + at)
    }

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
    Diagnostic::new(message).help(help).into()
}

impl From<Diagnostic> for Report {
    fn from(problem: Diagnostic) -> Self {
        Self { problems: vec![problem], sources: Vec::new() }
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.render(Display::PLAIN))
    }
}

impl std::error::Error for Report {}
