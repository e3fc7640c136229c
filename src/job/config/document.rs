//! Reads TOML into a tree in which every key and value remembers where it was written.
//!
//! A job is merged from several texts: the job file, the sensor file that it names, and the overrides of the command
//! line. Each text is a [`SourceText`], and each [`TomlNode`] has the [`SourceSpan`] it came from, so that an error
//! that is found late (a range, a missing file) is still shown with its file, line and column.

use std::path::{Path, PathBuf};

use toml::de::{DeTable, DeValue};

use super::syntax_help;
use gelsim_files::diagnostic::{Diagnostic, Diagnostics};
use gelsim_files::sensor::random::SensorDistribution;
use gelsim_files::source::{LineStarts, SourceSpan, SourceText};

/// The beginning of the job.toml of a dataset; a version follows. Such a file may be as large as its objects need.
pub const RESOLVED_HEADER: &str = "# The job of this dataset with every default written out, resolved by gelsim";
/// Most bytes of a file that is read: the resolved job of some hundred thousand objects.
pub const MAX_READ_BYTES: u64 = 64 << 20;
/// Most bytes of a text by a user.
const MAX_BYTES: usize = 8 << 20;
/// Most memory that parsing a text may take, bytes: enough for fourteen thousand objects, each in a table of its own.
const MAX_MEMORY: usize = 160 << 20;

/// Most lines that are not TOML of which each is shown. A file with more of them is seldom one that was meant.
const MAX_SLIPS: usize = 5;

/// A value and its place.
#[derive(Clone, Debug)]
pub struct TomlNode {
    /// Where the value was written.
    pub place: SourceSpan,
    /// The value.
    pub value: TomlValue,
}

/// A TOML value, in the kinds that jobs use.
#[derive(Clone, Debug)]
pub enum TomlValue {
    /// `true` or `false`.
    Bool(bool),
    /// A whole number.
    Integer(i64),
    /// A number with a decimal point.
    Float(f64),
    /// Text.
    String(String),
    /// A date or time. No key takes one; it is kept so that it can be refused by name.
    Datetime,
    /// `[..]` or `[[..]]`.
    Array(Vec<TomlNode>),
    /// `{..}` or `[..]` as a header.
    Table(Vec<TomlEntry>),
}

impl TomlValue {
    /// Makes a list of values that all have the same place.
    pub fn list(place: SourceSpan, values: impl IntoIterator<Item = Self>) -> Self {
        Self::Array(values.into_iter().map(|value| TomlNode { place, value }).collect())
    }
}

/// A key with its value.
#[derive(Clone, Debug)]
pub struct TomlEntry {
    /// The key's text.
    pub key: String,
    /// Where the key was written.
    pub key_place: SourceSpan,
    /// The value.
    pub node: TomlNode,
}

/// All sources of a job, and the tree into which they are merged.
#[derive(Clone, Debug)]
pub struct Document {
    /// Every text read so far.
    pub sources: Vec<SourceText>,
    /// The merged tree, which is always a table.
    pub root: TomlNode,
    /// What is drawn at random of the sensor.
    pub random: SensorDistribution,
}

impl Document {
    /// Makes a document without any source, as if a job left everything to its defaults.
    pub fn empty() -> Self {
        let source = SourceText { name: String::from("job"), text: String::new(), folder: PathBuf::new() };
        let place = SourceSpan { source: 0, start: 0, end: 0 };
        Self {
            sources: vec![source],
            root: TomlNode { place, value: TomlValue::Table(Vec::new()) },
            random: SensorDistribution::default(),
        }
    }

    /// Makes a document whose only source is the value of a command-line flag. Its tree is empty.
    pub fn from_flag(flag: &str, value: &str) -> Self {
        let source = SourceText { name: flag.to_owned(), text: value.to_owned(), folder: PathBuf::new() };
        let place = SourceSpan { source: 0, start: 0, end: value.len() };
        Self {
            sources: vec![source],
            root: TomlNode { place, value: TomlValue::Table(Vec::new()) },
            random: SensorDistribution::default(),
        }
    }

    /// Parses `text` as the first source. All syntax errors go to `problems`.
    pub fn parse(name: &str, text: String, folder: &Path, problems: &mut Diagnostics) -> Self {
        let mut document = Self { sources: Vec::new(), ..Self::empty() };
        document.root = document.add_source(name, text, folder, problems);
        document
    }

    /// Parses another text and returns its tree, which is not merged yet. All syntax errors go to `problems`.
    pub fn add_source(&mut self, name: &str, text: String, folder: &Path, problems: &mut Diagnostics) -> TomlNode {
        let source = self.sources.len();
        if let Some(reason) = explain_oversize(&text) {
            problems.push(Diagnostic::new(format!("{name}: {reason}")));
            self.sources.push(SourceText { name: name.to_owned(), text: String::new(), folder: folder.to_owned() });
            return Self::empty().root;
        }
        let (table, errors) = DeTable::parse_recoverable(&text);
        let full_span = SourceSpan { source, start: 0, end: text.len() };
        if let (Some(error), Some((format, help))) = (errors.first(), syntax_help::detect_other_format(&text)) {
            let start = error.span().map_or(0, |span| span.start);
            let problem = Diagnostic::new(format!("not valid TOML: it looks like {format}"));
            problems.push(problem.at(SourceSpan { source, start, end: start }).help(help));
            self.sources.push(SourceText { name: name.to_owned(), text, folder: folder.to_owned() });
            return Self::empty().root;
        }
        // After a slip in a table's header, its keys count to the table before. Such duplicate keys are not the user's
        // error, so they are reported only if there is nothing else.
        let doubles = errors.iter().all(is_duplicate);
        let lines = LineStarts::find(&text);
        let mut last_line = None;
        let mut slips = 0;
        for error in errors.into_iter().filter(|error| doubles || !is_duplicate(error)) {
            if problems.is_full() {
                break;
            }
            let span = error.span().unwrap_or(0..text.len());
            let place = SourceSpan { source, start: span.start, end: span.end };
            // One error per line is enough: the others on the line follow from it.
            let line = lines.number_at(span.start);
            if !is_duplicate(&error) && last_line.replace(line) == Some(line) {
                continue;
            }
            if !is_duplicate(&error) {
                slips += 1;
                if slips > MAX_SLIPS {
                    continue;
                }
            }
            let problem = Diagnostic::new(format!("not valid TOML: {}", error.message())).at(place);
            let first = syntax_help::find_first_duplicate(&text, span.start).filter(|_| is_duplicate(&error));
            problems.push(problem.help(match first {
                Some(line) => format!("it stands in line {line} already: keep one"),
                None => syntax_help::suggest_fix(&text, span.start),
            }));
        }
        if slips > MAX_SLIPS {
            let shown = format!("{name}: {slips} lines are not valid TOML; the first {MAX_SLIPS} are shown");
            let problem = Diagnostic::new(shown);
            problems.push(problem.help("is this the file that you mean? `gelsim init` writes a job to start from"));
        }
        let root = TomlNode { place: full_span, value: table_value(table.get_ref(), source) };
        self.sources.push(SourceText { name: name.to_owned(), text, folder: folder.to_owned() });
        root
    }

    /// Returns the node at a dotted path such as `object.0.path`, if it was written.
    pub fn get(&self, path: &str) -> Option<&TomlNode> {
        let mut node = &self.root;
        for segment in path.split('.') {
            node = node.child(segment)?;
        }
        Some(node)
    }

    /// Returns the place of `path`; for a path that was not written, that of the closest table around it. Returns
    /// `None` if not even that exists.
    pub fn place_of(&self, path: &str) -> Option<SourceSpan> {
        let mut place = None;
        let mut node = &self.root;
        for segment in path.split('.') {
            if let TomlValue::Table(entries) = &node.value
                && let Some(entry) = entries.iter().find(|entry| entry.key == segment)
            {
                let header = matches!(entry.node.value, TomlValue::Table(_)) && entry.key_place != entry.node.place;
                place = Some(if header { entry.key_place } else { entry.node.place });
                node = &entry.node;
            } else if let Some(child) = node.child(segment) {
                place = Some(child.place);
                node = child;
            } else {
                break;
            }
        }
        place
    }

    /// Returns the folder that a relative path at `path` starts from; if the path was not written, that of the first
    /// source.
    pub fn folder_of(&self, path: &str) -> &Path {
        let source = self.get(path).map_or(0, |node| node.place.source);
        &self.sources[source].folder
    }

    /// Sets the value at a dotted path, as `--set` does. Missing tables on the way are made, and a number selects an
    /// element of an array. The error says what is in the way.
    pub fn set(&mut self, path: &[String], key_place: SourceSpan, node: TomlNode) -> Result<(), String> {
        let mut at = &mut self.root;
        let (last, way) = path.split_last().ok_or("an empty key")?;
        for (depth, segment) in way.iter().enumerate() {
            let here = path[..=depth].join(".");
            at = match &mut at.value {
                TomlValue::Array(items) => {
                    let count = items.len();
                    segment
                        .parse::<usize>()
                        .ok()
                        .and_then(|index| items.get_mut(index))
                        .ok_or(format!("`{here}`: no such element; the list has {count}, counted from 0"))?
                }
                value => {
                    if !matches!(value, TomlValue::Table(_)) {
                        // What is wrong with the table is wrong there, and not with the value that was here.
                        at.place = key_place;
                        *value = TomlValue::Table(Vec::new());
                    }
                    let TomlValue::Table(entries) = value else { unreachable!("made a table just above") };
                    let empty = || TomlNode { place: key_place, value: TomlValue::Table(Vec::new()) };
                    let index = entries.iter().position(|entry| &entry.key == segment).unwrap_or_else(|| {
                        entries.push(TomlEntry { key: segment.clone(), key_place, node: empty() });
                        entries.len() - 1
                    });
                    &mut entries[index].node
                }
            };
        }
        match &mut at.value {
            TomlValue::Array(items) => {
                let count = items.len();
                let item = last.parse::<usize>().ok().and_then(|index| items.get_mut(index));
                *item
                    .ok_or(format!("`{}`: no such element; the list has {count}, counted from 0", path.join(".")))? =
                    node;
            }
            TomlValue::Table(entries) => put_entry(entries, TomlEntry { key: last.clone(), key_place, node }),
            value => {
                at.place = key_place;
                *value = TomlValue::Table(vec![TomlEntry { key: last.clone(), key_place, node }]);
            }
        }
        Ok(())
    }

    /// Merges the table `name` in the top-level table `from` under the top-level table of the same name, and removes it
    /// from `from`.
    pub fn move_table_up(&mut self, from: &str, name: &str) {
        let TomlValue::Table(root) = &mut self.root.value else { return };
        let Some(TomlEntry { node: TomlNode { value: TomlValue::Table(inner), .. }, .. }) =
            root.iter_mut().find(|entry| entry.key == from)
        else {
            return;
        };
        if let Some(at) = inner.iter().position(|entry| entry.key == name) {
            let entry = inner.remove(at);
            merge_entry_below(root, entry);
        }
    }

    /// Moves the key `from[1]` of the top-level table `from[0]` to the key `to[1]` of the table `to[0]`. A table that
    /// becomes empty is removed. Returns the key's place, or `None` if there is no such key.
    pub fn move_key(&mut self, from: [&str; 2], to: [&str; 2]) -> Option<SourceSpan> {
        let TomlValue::Table(root) = &mut self.root.value else { return None };
        let table = root.iter_mut().find(|entry| entry.key == from[0])?;
        let TomlValue::Table(keys) = &mut table.node.value else { return None };
        let at = keys.iter().position(|entry| entry.key == from[1])?;
        let TomlEntry { key_place, node, .. } = keys.remove(at);
        if keys.is_empty() {
            self.remove(from[0]);
        }
        self.set(&to.map(str::to_owned), key_place, node).ok()?;
        Some(key_place)
    }

    /// Removes the top-level key `name`, if it exists.
    pub fn remove(&mut self, name: &str) {
        if let TomlValue::Table(root) = &mut self.root.value {
            root.retain(|entry| entry.key != name);
        }
    }

    /// Merges the keys of `below` under the table at the top-level key `name`. Keys that the table already has win, and
    /// tables in it are merged in the same way.
    pub fn merge_table_below(&mut self, name: &str, below: TomlNode) {
        let TomlValue::Table(root) = &mut self.root.value else { return };
        merge_entry_below(root, TomlEntry { key: name.to_owned(), key_place: below.place, node: below });
    }
}

/// Explains why a text is too large to be parsed: it would take far more memory and time than any job or sensor.
/// Returns `None` if it is not.
fn explain_oversize(text: &str) -> Option<String> {
    if text.starts_with(RESOLVED_HEADER) {
        return None;
    }
    if text.len() > MAX_BYTES {
        return Some(format!("larger than {} MB", MAX_BYTES >> 20));
    }
    let needed: usize = text.bytes().map(parse_cost_bytes).sum();
    (needed > MAX_MEMORY).then(|| String::from("too many keys and values for a job or a sensor"))
}

/// Returns the most memory that a byte may take while it is parsed. Measured on texts made of nothing but keys, values,
/// tables, empty lists, errors, blanks or brackets; most texts take half of it.
fn parse_cost_bytes(byte: u8) -> usize {
    match byte {
        b'[' | b'{' | b',' | b'.' | b'=' | b'\n' | b'\r' => 400,
        b'_' | b'-' | b'/' | b'0'..=b'9' | b'A'..=b'Z' | b'a'..=b'z' | 0x80.. => 8,
        _ => 130,
    }
}

/// Tables that hold one choice of several. If the table above makes another choice, nothing of the one below is kept.
const CHOICE_TABLES: [&str; 3] = ["shape", "lens", "rest_shape"];

fn merge_entry_below(above: &mut Vec<TomlEntry>, below: TomlEntry) {
    match above.iter_mut().find(|known| known.key == below.key) {
        Some(TomlEntry { node: TomlNode { value: TomlValue::Table(above), .. }, .. }) => {
            if let TomlValue::Table(entries) = below.node.value {
                let chosen: Vec<String> = above.iter().map(|entry| entry.key.clone()).collect();
                let another = |entry: &TomlEntry| !chosen.is_empty() && !chosen.contains(&entry.key);
                let choice = CHOICE_TABLES.contains(&below.key.as_str());
                let kept = entries.into_iter().filter(|entry| !(choice && another(entry)));
                kept.for_each(|entry| merge_entry_below(above, entry));
            }
        }
        Some(_) => {} // the value above wins; if it should be a table, reading it reports that
        None => above.push(below),
    }
}

fn is_duplicate(error: &toml::de::Error) -> bool {
    error.message() == "duplicate key"
}

fn put_entry(entries: &mut Vec<TomlEntry>, entry: TomlEntry) {
    match entries.iter_mut().find(|known| known.key == entry.key) {
        Some(known) => *known = entry,
        None => entries.push(entry),
    }
}

impl TomlNode {
    /// Returns the child under a key, or at an index.
    pub fn child(&self, segment: &str) -> Option<&TomlNode> {
        match &self.value {
            TomlValue::Table(entries) => entries.iter().find(|entry| entry.key == segment).map(|entry| &entry.node),
            TomlValue::Array(items) => segment.parse::<usize>().ok().and_then(|index| items.get(index)),
            _ => None,
        }
    }

    /// Returns the child under a key, or at an index, to be changed.
    pub fn child_mut(&mut self, segment: &str) -> Option<&mut TomlNode> {
        match &mut self.value {
            TomlValue::Table(entries) => {
                entries.iter_mut().find(|entry| entry.key == segment).map(|entry| &mut entry.node)
            }
            TomlValue::Array(items) => segment.parse::<usize>().ok().and_then(|index| items.get_mut(index)),
            _ => None,
        }
    }

    /// Returns true if `place` is that of this value, or of a key or value inside it.
    pub fn contains_place(&self, place: SourceSpan) -> bool {
        self.place == place
            || match &self.value {
                TomlValue::Table(entries) => {
                    entries.iter().any(|entry| entry.key_place == place || entry.node.contains_place(place))
                }
                TomlValue::Array(items) => items.iter().any(|item| item.contains_place(place)),
                _ => false,
            }
    }

    /// Returns the text, or `None` if the value is not a text.
    pub fn as_str(&self) -> Option<&str> {
        match &self.value {
            TomlValue::String(text) => Some(text),
            _ => None,
        }
    }
}

fn table_value(table: &DeTable<'_>, source: usize) -> TomlValue {
    let mut entries: Vec<TomlEntry> = table
        .iter()
        .map(|(key, value)| TomlEntry {
            key: key.get_ref().to_string(),
            key_place: SourceSpan { source, start: key.span().start, end: key.span().end },
            node: TomlNode {
                place: SourceSpan { source, start: value.span().start, end: value.span().end },
                value: node_value(value.get_ref(), source),
            },
        })
        .collect();
    // The parser sorts by name, but messages should follow the order in which keys were written.
    entries.sort_by_key(|entry| entry.key_place.start);
    TomlValue::Table(entries)
}

fn node_value(value: &DeValue<'_>, source: usize) -> TomlValue {
    match value {
        DeValue::String(text) => TomlValue::String(text.to_string()),
        DeValue::Integer(integer) => match i64::from_str_radix(integer.as_str(), integer.radix()) {
            Ok(integer) => TomlValue::Integer(integer),
            // Too long for 64 bits. As a float it is refused by the range of the key for which it was meant.
            Err(_) => TomlValue::Float(integer.as_str().parse().unwrap_or(f64::INFINITY)),
        },
        DeValue::Float(float) => TomlValue::Float(float.as_str().parse().unwrap_or(f64::NAN)),
        DeValue::Boolean(truth) => TomlValue::Bool(*truth),
        DeValue::Datetime(_) => TomlValue::Datetime,
        DeValue::Array(items) => TomlValue::Array(
            items
                .iter()
                .map(|item| TomlNode {
                    place: SourceSpan { source, start: item.span().start, end: item.span().end },
                    value: node_value(item.get_ref(), source),
                })
                .collect(),
        ),
        DeValue::Table(table) => table_value(table, source),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_job_of_a_dataset_may_be_larger_than_one_that_somebody_wrote() {
        let objects = "[[object]]\npath = \"../objects/ball.obj\"\nclass = \"ball\"\n\n".repeat(40_000);
        assert!(explain_oversize(&objects).is_some());
        let mut problems = Diagnostics::default();
        Document::parse(
            "job.toml",
            format!("{RESOLVED_HEADER} {}.\n{objects}", env!("CARGO_PKG_VERSION")),
            Path::new(""),
            &mut problems,
        );
        assert!(problems.is_empty());
    }
    #[test]
    fn a_file_that_is_no_job_gives_a_few_errors_and_a_count() {
        let mut problems = Diagnostics::default();
        Document::parse("notes.md", "words of a page\n".repeat(40), Path::new(""), &mut problems);
        let said: Vec<&str> = problems.iter().map(|problem| problem.message.as_str()).collect();
        assert_eq!(said.len(), MAX_SLIPS + 1, "{said:?}");
        assert_eq!(said.last(), Some(&"notes.md: 40 lines are not valid TOML; the first 5 are shown"));
    }
}
