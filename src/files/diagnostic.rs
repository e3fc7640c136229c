//! Messages to a user about what they wrote: severity, text, place and what to do; and how they are printed.

use std::fmt;

use annotate_snippets::{AnnotationKind, Group, Level, Origin, Renderer, Snippet};
use serde::Serialize;

use crate::source::{SourceSpan, SourceText};
use crate::spelling::{escape_hidden_chars, strip_os_error_codes};

/// How severe a message is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// Good to know. There is nothing to do.
    Info,
    /// The work is done, but the user may want to do something differently.
    Note,
    /// The work is done, but the result is probably not what is wanted.
    Warning,
    /// The work is not done.
    #[default]
    Error,
}

impl Severity {
    /// Returns the word that is printed.
    pub fn name(self) -> &'static str {
        match self {
            Self::Info => "info",
            Self::Note => "note",
            Self::Warning => "warning",
            Self::Error => "error",
        }
    }

    fn to_snippet_level(self) -> Level<'static> {
        match self {
            Self::Info => Level::INFO,
            Self::Note => Level::NOTE,
            Self::Warning => Level::WARNING,
            Self::Error => Level::ERROR,
        }
    }
}

/// One message to a user.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Diagnostic {
    /// How severe it is.
    pub severity: Severity,
    /// What is to be said, in one sentence without a full stop.
    pub message: String,
    /// The place in a text that it is about, if there is one; the first of several.
    pub place: Option<SourceSpan>,
    /// What to do.
    pub help: Option<String>,
    /// A consequence that another check would report on its own.
    pub consequence: Option<Consequence>,
    /// What the message is about, if the same may be true of many things.
    pub subjects: Option<Box<Subjects>>,
}

/// What may follow from a message, so that it is not reported a second time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Consequence {
    /// The objects touch nothing.
    NoContact,
}

/// Files, rows or frames of which one message is true.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Subjects {
    /// What is true of them: the end of a sentence that begins with their number.
    pub cause: String,
    /// Their number.
    pub count: usize,
    /// The first few of them.
    pub first: Vec<String>,
    /// The places of these, once there are several.
    places: Vec<Option<SourceSpan>>,
}

/// Number of subjects that a message names.
const MAX_NAMED_SUBJECTS: usize = 3;

/// Number of mistakes in different places that a message names: each of them is to be mended.
const MAX_NAMED_PLACES: usize = 20;

impl Diagnostic {
    /// Makes an error without a place.
    pub fn new(message: impl Into<String>) -> Self {
        Self {
            severity: Severity::Error,
            message: shorten_message(escape_hidden_chars(&strip_os_error_codes(message.into())).into_owned()),
            place: None,
            help: None,
            consequence: None,
            subjects: None,
        }
    }

    /// Makes a warning: the work is done, but the result is probably not what is wanted.
    pub fn warning(message: impl Into<String>) -> Self {
        Self { severity: Severity::Warning, ..Self::new(message) }
    }

    /// Makes a note: the work is done, but the user may want to do something differently.
    pub fn note(message: impl Into<String>) -> Self {
        Self { severity: Severity::Note, ..Self::new(message) }
    }

    /// Makes an information, after which there is nothing to do.
    pub fn info(message: impl Into<String>) -> Self {
        Self { severity: Severity::Info, ..Self::new(message) }
    }

    /// Sets the place.
    pub fn at(mut self, place: impl Into<Option<SourceSpan>>) -> Self {
        self.place = place.into();
        self
    }

    /// Sets what to do.
    pub fn help(mut self, help: impl Into<String>) -> Self {
        self.help = Some(shorten_message(escape_hidden_chars(&strip_os_error_codes(help.into())).into_owned()));
        self
    }

    /// Marks that objects may touch nothing because of this.
    pub fn explaining_no_contact(mut self) -> Self {
        self.consequence = Some(Consequence::NoContact);
        self
    }

    /// Sets what the message is about, and what is true of many such subjects, for instance "files do not exist".
    /// [`Diagnostics`] joins all messages with the same cause and help into one.
    pub fn about(mut self, subject: impl Into<String>, cause: impl Into<String>) -> Self {
        let subject = shorten_message(escape_hidden_chars(&subject.into()).into_owned());
        self.subjects =
            Some(Box::new(Subjects { cause: cause.into(), count: 1, first: vec![subject], places: Vec::new() }));
        self
    }

    /// Returns the message. For several subjects it is their number, what is true of them, and the first few.
    pub fn full_message(&self) -> String {
        match self.subjects.as_deref() {
            Some(Subjects { cause, count, first, .. }) if *count > 1 => {
                let more = match count - first.len() {
                    0 => String::new(),
                    more => format!(" and {more} more"),
                };
                format!("{count} {cause}: {}{more}", first.join(", "))
            }
            _ => self.message.clone(),
        }
    }

    /// Joins `other` into this message if its cause, severity and help are the same. Returns false if they are not.
    fn merge_subject(&mut self, other: &Self) -> bool {
        let same = self.severity == other.severity && self.help == other.help;
        match (&mut self.subjects, &other.subjects) {
            (Some(own), Some(more)) if same && own.cause == more.cause => {
                if own.places.is_empty() {
                    own.places = vec![self.place; own.first.len()];
                }
                own.count += more.count;
                let is_elsewhere = self.severity == Severity::Error && !own.places.contains(&other.place);
                let most = if is_elsewhere { MAX_NAMED_PLACES } else { MAX_NAMED_SUBJECTS };
                let named = more.first.iter().take(most.saturating_sub(own.first.len()));
                own.first.extend(named.cloned());
                own.places.resize(own.first.len(), other.place);
                self.place = [self.place, other.place].into_iter().flatten().min();
                true
            }
            _ => false,
        }
    }
}

/// Most messages that are collected. Nobody reads more, and a hostile file could make millions.
const MAX_ERRORS: usize = 50;

/// All messages found so far. Work starts only when there is no error among them.
#[derive(Clone, Debug, Default)]
pub struct Diagnostics(Vec<Diagnostic>);

impl Diagnostics {
    /// Adds a message, unless it is there already or there are enough. A message of the same cause is joined to the one
    /// that is there.
    pub fn push(&mut self, problem: Diagnostic) {
        if self.0.contains(&problem) || self.0.iter_mut().any(|known| known.merge_subject(&problem)) || self.is_full() {
            return;
        }
        self.0.push(problem);
        if self.is_full() {
            self.0.push(Diagnostic::new("there may be more mistakes than these").help("fix them, then try again"));
        }
    }

    /// Returns true if no more messages are taken.
    pub fn is_full(&self) -> bool {
        self.0.len() >= MAX_ERRORS
    }

    /// Adds messages that were found elsewhere.
    pub fn extend(&mut self, found: impl IntoIterator<Item = Diagnostic>) {
        found.into_iter().for_each(|problem| self.push(problem));
    }

    /// Returns true if there are no messages.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Iterates over the messages in the order in which they were found.
    pub fn iter(&self) -> impl Iterator<Item = &Diagnostic> {
        self.0.iter()
    }

    /// Iterates over the places of those messages that have one.
    pub fn places(&self) -> impl Iterator<Item = SourceSpan> + '_ {
        self.0.iter().filter_map(|problem| problem.place)
    }

    /// Returns the messages in the order of their places in the sources.
    pub fn sorted_by_place(&self) -> Vec<Diagnostic> {
        let mut problems = self.0.clone();
        let found = problems.len().min(MAX_ERRORS);
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

/// How text is formatted for the place where it is shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DisplayOptions {
    /// Whether it has the colours of a terminal.
    pub is_styled: bool,
    /// Number of columns into which it is folded; `None` leaves lines as long as they are.
    pub columns: Option<usize>,
}

impl DisplayOptions {
    /// Plain text for a file or another program.
    pub const PLAIN: Self = Self { is_styled: false, columns: None };

    /// Folds a paragraph between words, leaving `indent` columns free at the start of each line.
    fn wrap_text(self, text: &str, indent: usize) -> String {
        match self.columns {
            None => text.to_owned(),
            Some(columns) => textwrap::fill(text, wrap_options(columns.saturating_sub(indent).max(MIN_COLUMNS))),
        }
    }
}

/// Returns how lines are folded into `columns`: between words alone, so that file names and options stay in one piece.
pub fn wrap_options<'a>(columns: usize) -> textwrap::Options<'a> {
    textwrap::Options::new(columns).break_words(false).word_splitter(textwrap::WordSplitter::NoHyphenation)
}

/// The narrowest width to which text is folded, columns.
const MIN_COLUMNS: usize = 16;

/// Messages together with the texts that they are about, ready to be shown.
#[derive(Clone, Debug, Default)]
pub struct Report {
    problems: Vec<Diagnostic>,
    sources: Vec<SourceText>,
}

impl Report {
    /// Makes a report from messages and the texts that their places refer to.
    pub fn new(problems: &Diagnostics, sources: &[SourceText]) -> Self {
        let named =
            |source: &SourceText| SourceText { name: escape_hidden_chars(&source.name).into_owned(), ..source.clone() };
        let mut report = Self { problems: problems.sorted_by_place(), sources: sources.iter().map(named).collect() };
        let placed: Vec<_> = report.problems.iter().map(|problem| report.name_places(problem)).collect();
        for (problem, first) in report.problems.iter_mut().zip(placed) {
            if let (Some(subjects), Some(first)) = (&mut problem.subjects, first) {
                subjects.first = first;
                subjects.places.clear();
            }
        }
        report
    }

    /// Returns the subjects of a message, each with its place, if they are in different ones of a job or the command
    /// line. Rows of a table are alike, so that the first few are enough.
    fn name_places(&self, problem: &Diagnostic) -> Option<Vec<String>> {
        let Subjects { first, places, .. } = problem.subjects.as_deref()?;
        let (start, rest) = places.split_first()?;
        if rest.iter().all(|place| place == start) {
            return None;
        }
        let is_setting = |name: &str| name.ends_with(".toml") || name.starts_with("--");
        let source = problem.place.and_then(|place| self.sources.get(place.source));
        if !source.is_some_and(|source| is_setting(&source.name)) {
            return Some(first.iter().take(MAX_NAMED_SUBJECTS).cloned().collect());
        }
        let with_place = |(name, place): (&String, &Option<SourceSpan>)| {
            let at = place.and_then(|place| self.format_span(place));
            at.map_or_else(|| name.clone(), |at| format!("{name} ({at})"))
        };
        Some(first.iter().zip(places).map(with_place).collect())
    }

    /// Makes a report of one error that has no place.
    pub fn from_message(message: impl Into<String>) -> Self {
        Self::from(Diagnostic::new(message))
    }

    /// Returns the place of one of the report's messages as `file:line:column`, if it has a place.
    pub fn format_place(&self, problem: &Diagnostic) -> Option<String> {
        self.format_span(problem.place?)
    }

    fn format_span(&self, place: SourceSpan) -> Option<String> {
        let source = self.sources.get(place.source)?;
        let line = MarkedLine::from_text(&source.text, place);
        Some(format!("{}:{}:{}", source.name, line.number, line.column_number()))
    }

    /// Returns the messages.
    pub fn problems(&self) -> &[Diagnostic] {
        &self.problems
    }

    /// Returns a report with the messages of both, those of `other` last.
    pub fn merged_with(mut self, other: Self) -> Self {
        let before = self.sources.len();
        self.sources.extend(other.sources);
        self.problems.extend(other.problems.into_iter().map(|mut problem| {
            problem.place = problem.place.map(|place| SourceSpan { source: place.source + before, ..place });
            problem
        }));
        self
    }

    /// Returns a report with the messages of both, without those of `other` that are in this one.
    pub fn merged_with_new(self, other: &Self) -> Self {
        let is_new = |problem: &&Diagnostic| self.problems.iter().all(|known| known.message != problem.message);
        let problems = other.problems.iter().filter(is_new).cloned().collect();
        let sources = other.sources.clone();
        self.merged_with(Self { problems, sources })
    }

    /// Returns the report with `from` replaced by `to` in all messages, helps and names of sources.
    pub fn with_replaced_text(mut self, from: &str, to: &str) -> Self {
        for problem in &mut self.problems {
            problem.message = problem.message.replace(from, to);
            problem.help = problem.help.take().map(|help| help.replace(from, to));
        }
        for source in &mut self.sources {
            source.name = source.name.replace(from, to);
        }
        self
    }

    /// Returns a report of those messages that are at least this severe.
    pub fn filter_by_severity(&self, least: Severity) -> Self {
        let problems = self.problems.iter().filter(|problem| problem.severity >= least).cloned().collect();
        Self { problems, sources: self.sources.clone() }
    }

    /// Returns a report of what a user is shown by default: all but information that has no help.
    pub fn worth_showing(&self) -> Self {
        let is_shown = |problem: &&Diagnostic| problem.severity > Severity::Info || problem.help.is_some();
        let problems = self.problems.iter().filter(is_shown).cloned().collect();
        Self { problems, sources: self.sources.clone() }
    }

    /// Returns one text for each message above information: the message, and what to do.
    pub fn messages_with_help(&self) -> Vec<String> {
        let text = |problem: &Diagnostic| match &problem.help {
            Some(help) => format!("{}: {help}", problem.full_message()),
            None => problem.full_message(),
        };
        self.problems.iter().filter(|problem| problem.severity > Severity::Info).map(text).collect()
    }

    /// Turns all messages into errors and adds a note that says why.
    pub fn to_errors(&self, why: &str) -> Self {
        let mut report = self.clone();
        report.problems.iter_mut().for_each(|problem| problem.severity = Severity::Error);
        report.problems.push(Diagnostic::note(why));
        report
    }

    /// Returns true if there are no messages.
    pub fn is_empty(&self) -> bool {
        self.problems.is_empty()
    }

    /// Renders a paragraph for each message: severity and text; `file:line:column` and the line, if it has a place;
    /// what to do.
    pub fn render(&self, display: DisplayOptions) -> String {
        let paragraphs: Vec<String> = self.render_paragraphs(display).collect();
        paragraphs.join("\n\n")
    }

    /// Iterates over the paragraphs of [`Self::render`].
    pub fn render_paragraphs(&self, display: DisplayOptions) -> impl Iterator<Item = String> + '_ {
        let renderer = if display.is_styled { Renderer::styled() } else { Renderer::plain() };
        let renderer = display.columns.map_or(renderer.clone(), |columns| renderer.term_width(columns));
        self.problems.iter().map(move |problem| {
            // A title has the severity before it; a help stands below the line numbers.
            let title = display.wrap_text(&problem.full_message(), problem.severity.name().len() + 2);
            let help = problem.help.as_ref().map(|help| display.wrap_text(help, HELP_INDENT));
            renderer.render(&[self.build_group(problem, &title, help.as_deref(), display.columns)])
        })
    }

    fn build_group<'a>(
        &'a self,
        problem: &'a Diagnostic,
        title: &'a str,
        help: Option<&'a str>,
        columns: Option<usize>,
    ) -> Group<'a> {
        let title = problem.severity.to_snippet_level().primary_title(title);
        let source = problem.place.and_then(|place| Some((self.sources.get(place.source)?, place)));
        let mut group = match source.map(|(source, place)| (source, MarkedLine::from_text(&source.text, place))) {
            None => Group::with_title(title),
            // A line this long comes from a file that is no text written by hand: name the place only.
            Some((source, line)) if line.text.len() > MAX_LINE_BYTES => {
                title.element(Origin::path(source.name.as_str()).line(line.number).char_column(line.column_number()))
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

/// Columns before a help: a line number of four digits, the rule, and the word itself.
const HELP_INDENT: usize = "1234 = help: ".len();

/// Most bytes of a line that is shown. Of a longer line only the place is named.
const MAX_LINE_BYTES: usize = 2000;

/// The line on which a place begins, and the bytes of it that are underlined.
struct MarkedLine<'a> {
    text: &'a str,
    number: usize,
    start: usize,
    end: usize,
}

impl<'a> MarkedLine<'a> {
    /// Returns the column where the mark begins, counted from 1.
    fn column_number(&self) -> usize {
        self.text[..self.start].chars().count() + 1
    }

    /// Returns the end of the mark, so that it is no wider than the terminal: the renderer cannot cut a mark.
    fn end_within(&self, columns: Option<usize>) -> usize {
        /// Columns taken by the line's number, its rule, and the dots where the line is cut.
        const BESIDE: usize = 14;
        let Some(columns) = columns else { return self.end };
        let marked = &self.text[self.start..self.end];
        let cut = marked.char_indices().nth(columns.saturating_sub(BESIDE).max(1));
        cut.map_or(self.end, |(at, _)| self.start + at)
    }

    fn from_text(text: &'a str, place: SourceSpan) -> Self {
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

/// Most characters of a message or a help that are shown.
const MAX_MESSAGE_CHARS: usize = 1000;

/// Shortens a text to its start and its end if it is too long. It may quote what the user wrote, which may be
/// megabytes.
fn shorten_message(text: String) -> String {
    match text.char_indices().nth(MAX_MESSAGE_CHARS) {
        None => text,
        Some(_) => {
            let cut = |at: usize| text.char_indices().nth(at).map_or(text.len(), |(at, _)| at);
            let last = text.char_indices().rev().nth(MAX_MESSAGE_CHARS / 4).map_or(0, |(at, _)| at);
            format!("{} .. {}", &text[..cut(MAX_MESSAGE_CHARS / 2)], &text[last..])
        }
    }
}

/// Makes an error about something outside the texts that were read, such as a flag.
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
        f.write_str(&self.render(DisplayOptions::PLAIN))
    }
}

impl std::error::Error for Report {}
