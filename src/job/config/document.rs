//! TOML read into a tree in which every key and value remembers where it was written.
//!
//! A job is laid together from several texts: the job file, the sensor file it names, and what the command line
//! overrides. Each text is a [`Source`]; each [`Node`] carries the [`Place`] it came from, so that a mistake found
//! late (a range, a missing file) is still shown with its own file, line and column.

use std::path::{Path, PathBuf};

use toml::de::{DeTable, DeValue};

use super::slips;
use gelsim_files::diagnostic::{Diagnostic, Diagnostics};
use gelsim_files::sensor::random::SensorDistribution;
use gelsim_files::source::{Place, Source};

/// How the job.toml of a dataset begins; a version follows. It may be as large as its objects ask for.
pub const RESOLVED: &str = "# The job of this dataset with every default written out, resolved by gelsim";
/// Largest file that is read, bytes: the resolved job of some hundred thousand objects.
pub const MOST_READ: u64 = 64 << 20;
/// Largest text by a user, bytes.
const MOST_BYTES: usize = 8 << 20;
/// Most memory that parsing a text may take, bytes: enough for fourteen thousand objects, each in a table of its own.
const MOST_MEMORY: usize = 160 << 20;

/// A value and where it stands.
#[derive(Clone, Debug)]
pub struct Node {
    /// Where the value was written.
    pub place: Place,
    /// The value.
    pub value: Value,
}

/// A TOML value, in the kinds that jobs use.
#[derive(Clone, Debug)]
pub enum Value {
    /// `true` or `false`.
    Bool(bool),
    /// A whole number.
    Integer(i64),
    /// A number with a decimal point.
    Float(f64),
    /// Text.
    String(String),
    /// A date or time, which no key takes; kept so that it can be refused by name.
    Datetime,
    /// `[..]` or `[[..]]`.
    Array(Vec<Node>),
    /// `{..}` or `[..]` as a header.
    Table(Vec<Entry>),
}

impl Value {
    /// A list of values that all stand at one place.
    pub fn list(place: Place, values: impl IntoIterator<Item = Self>) -> Self {
        Self::Array(values.into_iter().map(|value| Node { place, value }).collect())
    }
}

/// A key with its value.
#[derive(Clone, Debug)]
pub struct Entry {
    /// The key's text.
    pub key: String,
    /// Where the key was written.
    pub key_place: Place,
    /// What it holds.
    pub node: Node,
}

/// All sources of a job and the tree that they make together.
#[derive(Clone, Debug)]
pub struct Document {
    /// Every text read so far.
    pub sources: Vec<Source>,
    /// The merged tree; always a table.
    pub root: Node,
    /// What in it is drawn at random of the sensor.
    pub random: SensorDistribution,
}

impl Document {
    /// A document without any source: what is read when a job leaves everything to its defaults.
    pub fn empty() -> Self {
        let source = Source { name: String::from("job"), text: String::new(), folder: PathBuf::new() };
        let place = Place { source: 0, start: 0, end: 0 };
        Self {
            sources: vec![source],
            root: Node { place, value: Value::Table(Vec::new()) },
            random: SensorDistribution::default(),
        }
    }

    /// A document whose only source is the value of a command-line flag, with nothing in its tree yet.
    pub fn of_flag(flag: &str, value: &str) -> Self {
        let source = Source { name: flag.to_owned(), text: value.to_owned(), folder: PathBuf::new() };
        let place = Place { source: 0, start: 0, end: value.len() };
        Self {
            sources: vec![source],
            root: Node { place, value: Value::Table(Vec::new()) },
            random: SensorDistribution::default(),
        }
    }

    /// Parses `text` as the first source. Syntax errors, all of them, go to `problems`.
    pub fn parse(name: &str, text: String, folder: &Path, problems: &mut Diagnostics) -> Self {
        let mut document = Self { sources: Vec::new(), ..Self::empty() };
        document.root = document.add_source(name, text, folder, problems);
        document
    }

    /// Parses one more text and returns its tree, which is not merged yet.
    pub fn add_source(&mut self, name: &str, text: String, folder: &Path, problems: &mut Diagnostics) -> Node {
        let source = self.sources.len();
        if let Some(reason) = oversize(&text) {
            problems.push(Diagnostic::new(format!("{name}: {reason}")));
            self.sources.push(Source { name: name.to_owned(), text: String::new(), folder: folder.to_owned() });
            return Self::empty().root;
        }
        let (table, errors) = DeTable::parse_recoverable(&text);
        let whole = Place { source, start: 0, end: text.len() };
        if let (Some(error), Some((format, help))) = (errors.first(), slips::other_format(&text)) {
            let start = error.span().map_or(0, |span| span.start);
            let problem = Diagnostic::new(format!("not valid TOML: it looks like {format}"));
            problems.push(problem.at(Place { source, start, end: start }).help(help));
            self.sources.push(Source { name: name.to_owned(), text, folder: folder.to_owned() });
            return Self::empty().root;
        }
        // After a slip in a table's header its keys count to the table before: not the user's doubles.
        let doubles = errors.iter().all(is_duplicate);
        let mut lines = None;
        for error in errors.into_iter().filter(|error| doubles || !is_duplicate(error)) {
            if problems.is_full() {
                break;
            }
            let span = error.span().unwrap_or(0..text.len());
            let place = Place { source, start: span.start, end: span.end };
            // Of one line one mistake is enough: what follows from it is none.
            let before = &text.as_bytes()[..span.start.min(text.len())];
            let line = before.iter().filter(|byte| **byte == b'\n').count();
            if !is_duplicate(&error) && lines.replace(line) == Some(line) {
                continue;
            }
            let problem = Diagnostic::new(format!("not valid TOML: {}", error.message())).at(place);
            let first = slips::first_of_double(&text, span.start).filter(|_| is_duplicate(&error));
            let help = match first {
                Some(line) => Some(format!("it stands in line {line} already: keep one")),
                None => slips::help(&text, span.start),
            };
            problems.push(match help {
                Some(help) => problem.help(help),
                None => problem,
            });
        }
        let root = Node { place: whole, value: table_value(table.get_ref(), source) };
        self.sources.push(Source { name: name.to_owned(), text, folder: folder.to_owned() });
        root
    }

    /// The node at a dotted path such as `object.0.path`, if it was written.
    pub fn get(&self, path: &str) -> Option<&Node> {
        let mut node = &self.root;
        for segment in path.split('.') {
            node = node.child(segment)?;
        }
        Some(node)
    }

    /// Where `path` stands; for a path that nobody wrote, the closest table around it that somebody did.
    /// `None` if not even that exists.
    pub fn place(&self, path: &str) -> Option<Place> {
        let mut place = None;
        let mut node = &self.root;
        for segment in path.split('.') {
            if let Value::Table(entries) = &node.value
                && let Some(entry) = entries.iter().find(|entry| entry.key == segment)
            {
                let header = matches!(entry.node.value, Value::Table(_)) && entry.key_place != entry.node.place;
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

    /// The folder that a relative path written at `path` starts from; the first source's where nobody wrote it.
    pub fn folder(&self, path: &str) -> &Path {
        let source = self.get(path).map_or(0, |node| node.place.source);
        &self.sources[source].folder
    }

    /// Sets the value at a dotted path, as `--set` does: tables on the way are made where they are missing, a number
    /// picks an element of an array. On failure, what stands in the way.
    pub fn set(&mut self, path: &[String], key_place: Place, node: Node) -> Result<(), String> {
        let mut at = &mut self.root;
        let (last, way) = path.split_last().ok_or("an empty key")?;
        for (depth, segment) in way.iter().enumerate() {
            let here = path[..=depth].join(".");
            at = match &mut at.value {
                Value::Array(items) => {
                    let count = items.len();
                    segment
                        .parse::<usize>()
                        .ok()
                        .and_then(|index| items.get_mut(index))
                        .ok_or(format!("`{here}`: no such element; the list has {count}, counted from 0"))?
                }
                value => {
                    if !matches!(value, Value::Table(_)) {
                        *value = Value::Table(Vec::new());
                    }
                    let Value::Table(entries) = value else { unreachable!("made a table just above") };
                    let empty = || Node { place: key_place, value: Value::Table(Vec::new()) };
                    let index = entries.iter().position(|entry| &entry.key == segment).unwrap_or_else(|| {
                        entries.push(Entry { key: segment.clone(), key_place, node: empty() });
                        entries.len() - 1
                    });
                    &mut entries[index].node
                }
            };
        }
        match &mut at.value {
            Value::Array(items) => {
                let count = items.len();
                let item = last.parse::<usize>().ok().and_then(|index| items.get_mut(index));
                *item
                    .ok_or(format!("`{}`: no such element; the list has {count}, counted from 0", path.join(".")))? =
                    node;
            }
            Value::Table(entries) => put(entries, Entry { key: last.clone(), key_place, node }),
            value => *value = Value::Table(vec![Entry { key: last.clone(), key_place, node }]),
        }
        Ok(())
    }

    /// Lays the table `name` in the top-level table `from` under the top-level table of the same name, and removes it.
    pub fn move_up(&mut self, from: &str, name: &str) {
        let Value::Table(root) = &mut self.root.value else { return };
        let Some(Entry { node: Node { value: Value::Table(inner), .. }, .. }) =
            root.iter_mut().find(|entry| entry.key == from)
        else {
            return;
        };
        if let Some(at) = inner.iter().position(|entry| entry.key == name) {
            let entry = inner.remove(at);
            lay_under(root, entry);
        }
    }

    /// Takes the top-level key `name` away, if it is there.
    pub fn remove(&mut self, name: &str) {
        if let Value::Table(root) = &mut self.root.value {
            root.retain(|entry| entry.key != name);
        }
    }

    /// Lays the keys of `below` under the table at the top-level key `name`: a key that the table has already wins,
    /// and tables in it are laid over each other in the same way.
    pub fn underlay(&mut self, name: &str, below: Node) {
        let Value::Table(root) = &mut self.root.value else { return };
        lay_under(root, Entry { key: name.to_owned(), key_place: below.place, node: below });
    }
}

/// Why a text is not worth parsing: it would take far more memory and time than any job or sensor.
fn oversize(text: &str) -> Option<String> {
    if text.starts_with(RESOLVED) {
        return None;
    }
    if text.len() > MOST_BYTES {
        return Some(format!("larger than {} MB", MOST_BYTES >> 20));
    }
    let needed: usize = text.bytes().map(parsing).sum();
    (needed > MOST_MEMORY).then(|| String::from("too many keys and values for a job or a sensor"))
}

/// Memory that a byte takes at most while it is parsed, as measured on texts made of nothing but keys, values, tables,
/// empty lists, mistakes, blanks or brackets; most texts take half of it.
fn parsing(byte: u8) -> usize {
    match byte {
        b'[' | b'{' | b',' | b'.' | b'=' | b'\n' | b'\r' => 400,
        b'_' | b'-' | b'/' | b'0'..=b'9' | b'A'..=b'Z' | b'a'..=b'z' | 0x80.. => 8,
        _ => 130,
    }
}

/// Tables that name one choice of several: another choice takes the place of all of it.
const CHOICES: [&str; 3] = ["shape", "lens", "rest_shape"];

fn lay_under(above: &mut Vec<Entry>, below: Entry) {
    match above.iter_mut().find(|known| known.key == below.key) {
        Some(Entry { node: Node { value: Value::Table(above), .. }, .. }) => {
            if let Value::Table(entries) = below.node.value {
                let chosen: Vec<String> = above.iter().map(|entry| entry.key.clone()).collect();
                let another = |entry: &Entry| !chosen.is_empty() && !chosen.contains(&entry.key);
                let choice = CHOICES.contains(&below.key.as_str());
                let kept = entries.into_iter().filter(|entry| !(choice && another(entry)));
                kept.for_each(|entry| lay_under(above, entry));
            }
        }
        Some(_) => {} // the value above wins; if it should be a table, reading it reports that
        None => above.push(below),
    }
}

fn is_duplicate(error: &toml::de::Error) -> bool {
    error.message() == "duplicate key"
}

fn put(entries: &mut Vec<Entry>, entry: Entry) {
    match entries.iter_mut().find(|known| known.key == entry.key) {
        Some(known) => *known = entry,
        None => entries.push(entry),
    }
}

impl Node {
    /// The child under a key, or at an index.
    pub fn child(&self, segment: &str) -> Option<&Node> {
        match &self.value {
            Value::Table(entries) => entries.iter().find(|entry| entry.key == segment).map(|entry| &entry.node),
            Value::Array(items) => segment.parse::<usize>().ok().and_then(|index| items.get(index)),
            _ => None,
        }
    }

    /// The same, to be changed.
    pub fn child_mut(&mut self, segment: &str) -> Option<&mut Node> {
        match &mut self.value {
            Value::Table(entries) => entries.iter_mut().find(|entry| entry.key == segment).map(|entry| &mut entry.node),
            Value::Array(items) => segment.parse::<usize>().ok().and_then(|index| items.get_mut(index)),
            _ => None,
        }
    }

    /// True if `place` is that of this value or of a key or value in it.
    pub fn holds(&self, place: Place) -> bool {
        self.place == place
            || match &self.value {
                Value::Table(entries) => {
                    entries.iter().any(|entry| entry.key_place == place || entry.node.holds(place))
                }
                Value::Array(items) => items.iter().any(|item| item.holds(place)),
                _ => false,
            }
    }

    /// The text, if it is text.
    pub fn as_str(&self) -> Option<&str> {
        match &self.value {
            Value::String(text) => Some(text),
            _ => None,
        }
    }
}

fn table_value(table: &DeTable<'_>, source: usize) -> Value {
    let mut entries: Vec<Entry> = table
        .iter()
        .map(|(key, value)| Entry {
            key: key.get_ref().to_string(),
            key_place: Place { source, start: key.span().start, end: key.span().end },
            node: Node {
                place: Place { source, start: value.span().start, end: value.span().end },
                value: node_value(value.get_ref(), source),
            },
        })
        .collect();
    // The parser sorts by name; people read in the order they wrote.
    entries.sort_by_key(|entry| entry.key_place.start);
    Value::Table(entries)
}

fn node_value(value: &DeValue<'_>, source: usize) -> Value {
    match value {
        DeValue::String(text) => Value::String(text.to_string()),
        DeValue::Integer(integer) => match i64::from_str_radix(integer.as_str(), integer.radix()) {
            Ok(integer) => Value::Integer(integer),
            // Too long for 64 bits: as a float it is refused by the range of whatever key it was meant for.
            Err(_) => Value::Float(integer.as_str().parse().unwrap_or(f64::INFINITY)),
        },
        DeValue::Float(float) => Value::Float(float.as_str().parse().unwrap_or(f64::NAN)),
        DeValue::Boolean(truth) => Value::Bool(*truth),
        DeValue::Datetime(_) => Value::Datetime,
        DeValue::Array(items) => Value::Array(
            items
                .iter()
                .map(|item| Node {
                    place: Place { source, start: item.span().start, end: item.span().end },
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
        assert!(oversize(&objects).is_some());
        let mut problems = Diagnostics::default();
        Document::parse(
            "job.toml",
            format!("{RESOLVED} {}.\n{objects}", env!("CARGO_PKG_VERSION")),
            Path::new(""),
            &mut problems,
        );
        assert!(problems.is_empty());
    }
}
