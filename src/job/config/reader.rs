//! Reads a tree of [`Node`]s into serde types and collects every mistake on the way, not only the first.
//!
//! A derived `Deserialize` gives up at its first error. So a table with a wrong value is read again without that
//! value, until it reads: each round finds one more mistake, unknown keys are found all in the first. A bare name for
//! an externally tagged enum (`optics = "phong"`) means the variant's empty table.

use std::cell::RefCell;
use std::collections::HashSet;
use std::fmt;

use serde::de::{self, DeserializeOwned, IntoDeserializer, Unexpected, Visitor};

use super::document::{Entry, Node, Value};
use super::guesses::{self, Wanted};
use gelsim_files::diagnostic::{Diagnostic, Diagnostics};
use gelsim_files::source::Place;
use gelsim_files::spelling::one_of;

/// Reads `node` as a `T` whose fields all have defaults; what is wrong goes to `problems` and counts as not written.
/// `None` only if what remains cannot be a `T` at all (then at least one problem was added).
pub fn read<T: DeserializeOwned>(node: &Node, problems: &mut Diagnostics) -> Option<T> {
    let context = Context { problems: RefCell::new(std::mem::take(problems)), skipped: RefCell::default() };
    let value = loop {
        match T::deserialize(Reader { node, context: &context }) {
            Ok(value) => break Some(value),
            Err(mistake) => {
                let echo = mistake.echo || mistake.missing && context.lost_a_child(node, mistake.place);
                if !echo {
                    let place = mistake.place.unwrap_or(node.place);
                    let problem = Diagnostic { help: mistake.help, ..Diagnostic::new(mistake.message) };
                    context.problems.borrow_mut().push(problem.at(place));
                }
                match mistake.field {
                    _ if context.problems.borrow().is_full() => break None,
                    Some(field) if context.skipped.borrow_mut().insert(field) => {}
                    _ => break None,
                }
            }
        }
    };
    *problems = context.problems.into_inner();
    value
}

struct Context {
    problems: RefCell<Diagnostics>,
    /// Values left out after a mistake in them, known by where they stand.
    skipped: RefCell<HashSet<Place>>,
}

impl Context {
    /// True if a key of the table at `place` was left out: that it is missing now is no news.
    fn lost_a_child(&self, root: &Node, place: Option<Place>) -> bool {
        fn find(node: &Node, place: Place) -> Option<&Node> {
            if node.place == place && matches!(node.value, Value::Table(_)) {
                return Some(node);
            }
            match &node.value {
                Value::Table(entries) => entries.iter().find_map(|entry| find(&entry.node, place)),
                Value::Array(items) => items.iter().find_map(|item| find(item, place)),
                _ => None,
            }
        }
        let Some(Node { value: Value::Table(entries), .. }) = place.and_then(|place| find(root, place)) else {
            return false;
        };
        entries.iter().any(|entry| self.skipped.borrow().contains(&entry.node.place))
    }
}

/// A serde error that knows its place.
#[derive(Debug)]
struct Mistake {
    message: String,
    help: Option<String>,
    /// The value that is wrong.
    place: Option<Place>,
    /// The innermost field of a struct or element of a list around it: what the next round leaves out.
    field: Option<Place>,
    /// A key that is not there, rather than a value that is wrong.
    missing: bool,
    /// What the value should be instead.
    wanted: Option<Wanted>,
    /// Not a mistake of its own, only what is left of a list after those that were found in it.
    echo: bool,
}

impl Mistake {
    fn new(message: impl Into<String>) -> Self {
        Self {
            message: message.into(),
            help: None,
            place: None,
            field: None,
            missing: false,
            wanted: None,
            echo: false,
        }
    }

    fn located(mut self, place: Place) -> Self {
        self.place.get_or_insert(place);
        self
    }
}

impl fmt::Display for Mistake {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for Mistake {}

impl de::Error for Mistake {
    fn custom<M: fmt::Display>(message: M) -> Self {
        let message = message.to_string();
        // Of a table with other keys, such as those of a range.
        let wanted = message.starts_with("unknown distribution").then_some(Wanted::Quantity);
        Self { wanted, ..Self::new(message) }
    }

    fn invalid_type(unexpected: Unexpected<'_>, expected: &dyn de::Expected) -> Self {
        let expected = expected.to_string().replace("a sequence", "a list");
        let wanted = expected.starts_with(QUANTITY).then_some(Wanted::Quantity);
        Self { wanted, ..Self::new(format!("expected {expected}, found {}", spoken(unexpected))) }
    }

    fn invalid_length(length: usize, expected: &dyn de::Expected) -> Self {
        let expected = expected.to_string().replace("an array of length", "a list of");
        Self::new(format!("expected {expected}, found {length} element{}", if length == 1 { "" } else { "s" }))
    }

    fn missing_field(field: &'static str) -> Self {
        Self { missing: true, ..Self::new(format!("missing key `{field}`")) }
    }
}

/// True of a visitor of the one kind of value that says itself what it may be.
fn is_quantity<'de, V: Visitor<'de>>(visitor: &V) -> bool {
    let expected: &dyn de::Expected = visitor;
    expected.to_string().starts_with(QUANTITY)
}

/// How a quantity begins to say what it may be.
const QUANTITY: &str = "a number, [min, max]";

fn spoken(unexpected: Unexpected<'_>) -> String {
    match unexpected {
        Unexpected::Bool(truth) => truth.to_string(),
        Unexpected::Unsigned(number) => number.to_string(),
        Unexpected::Signed(number) => number.to_string(),
        Unexpected::Float(number) => format!("{number:?}"),
        Unexpected::Str(text) => format!("the text {text:?}"),
        Unexpected::Seq => String::from("a list"),
        Unexpected::Map => String::from("a table"),
        other => other.to_string(),
    }
}

impl Value {
    fn unexpected(&self) -> Unexpected<'_> {
        match self {
            Value::Bool(truth) => Unexpected::Bool(*truth),
            Value::Integer(number) => Unexpected::Signed(*number),
            Value::Float(number) => Unexpected::Float(*number),
            Value::String(text) => Unexpected::Str(text),
            Value::Datetime => Unexpected::Other("a date or time"),
            Value::Array(_) => Unexpected::Seq,
            Value::Table(_) => Unexpected::Map,
        }
    }
}

#[derive(Clone, Copy)]
struct Reader<'a> {
    node: &'a Node,
    context: &'a Context,
}

impl<'a> Reader<'a> {
    fn wrong_type(&self, expected: &str, wanted: Option<Wanted>) -> Mistake {
        let message = format!("expected {expected}, found {}", spoken(self.node.value.unexpected()));
        Mistake { wanted, ..Mistake::new(message) }
    }

    fn visit<'de, V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Mistake> {
        match &self.node.value {
            Value::Bool(truth) => visitor.visit_bool(*truth),
            Value::Integer(number) => visitor.visit_i64(*number),
            Value::Float(number) => visitor.visit_f64(*number),
            Value::String(text) => visitor.visit_str(text),
            Value::Datetime => Err(self.wrong_type("a value that is not a date", None)),
            Value::Array(items) => {
                let wanted = Some(Wanted::Quantity).filter(|_| is_quantity(&visitor));
                let lost = {
                    let skipped = self.context.skipped.borrow();
                    !skipped.is_empty() && items.iter().any(|item| skipped.contains(&item.place))
                };
                let items_in_all = items.len();
                let mut items = Items { items: items.iter(), context: self.context };
                match (visitor.visit_seq(&mut items), items.items.len()) {
                    // A mistake with a place is one in a further element.
                    (Err(mistake), _) if !lost || mistake.place.is_some() => {
                        let is_whole = mistake.place.is_none();
                        Err(Mistake { wanted: mistake.wanted.or(wanted.filter(|_| is_whole)), ..mistake })
                    }
                    _ if lost => Err(Mistake { echo: true, ..Mistake::new("") }),
                    (value, 0) => value,
                    (_, more) => {
                        let (all, most) = (items_in_all, items_in_all - more);
                        let help = guesses::decimal_commas(&self.node.value, most);
                        let message = format!("{all} elements, where {most} belong");
                        Err(Mistake { help, wanted, ..Mistake::new(message) })
                    }
                }
            }
            Value::Table(entries) => visitor.visit_map(Entries {
                entries: entries.iter(),
                value: None,
                fields: false,
                context: self.context,
            }),
        }
        .map_err(|mistake| mistake.located(self.node.place))
    }

    fn integer<'de, V: Visitor<'de>>(self, min: i64, visitor: V) -> Result<V::Value, Mistake> {
        match &self.node.value {
            Value::Integer(number) if *number >= min => visitor.visit_i64(*number),
            _ if min == 0 => Err(self.wrong_type("a whole number from 0 up", Some(Wanted::Whole))),
            _ => Err(self.wrong_type("a whole number", Some(Wanted::Whole))),
        }
        .map_err(|mistake| mistake.located(self.node.place))
    }
}

macro_rules! forward {
    ($($method:ident => $($call:ident)? ( $($argument:expr)? )),* $(,)?) => { $(
        fn $method<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Mistake> {
            self.$($call)?($($argument,)? visitor)
        }
    )* };
}

impl<'de> de::Deserializer<'de> for Reader<'_> {
    type Error = Mistake;

    forward! {
        deserialize_any => visit(), deserialize_char => visit(), deserialize_bytes => visit(),
        deserialize_byte_buf => visit(), deserialize_unit => visit(), deserialize_identifier => visit(),
        deserialize_ignored_any => visit(), deserialize_map => visit(),
        deserialize_i8 => integer(i64::MIN), deserialize_i16 => integer(i64::MIN), deserialize_i32 => integer(i64::MIN),
        deserialize_i64 => integer(i64::MIN), deserialize_u8 => integer(0), deserialize_u16 => integer(0),
        deserialize_u32 => integer(0), deserialize_u64 => integer(0), deserialize_f32 => deserialize_f64(),
    }

    fn deserialize_bool<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Mistake> {
        match &self.node.value {
            Value::Bool(_) => self.visit(visitor),
            _ => Err(self.wrong_type("true or false", Some(Wanted::Truth)).located(self.node.place)),
        }
    }

    fn deserialize_f64<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Mistake> {
        match &self.node.value {
            Value::Integer(number) => visitor.visit_f64(*number as f64),
            Value::Float(number) => visitor.visit_f64(*number),
            _ => Err(self.wrong_type("a number", Some(Wanted::Number))),
        }
        .map_err(|mistake| mistake.located(self.node.place))
    }

    fn deserialize_str<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Mistake> {
        match &self.node.value {
            Value::String(_) => self.visit(visitor),
            _ => Err(self.wrong_type("text in quotes", Some(Wanted::Text)).located(self.node.place)),
        }
    }

    fn deserialize_string<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Mistake> {
        self.deserialize_str(visitor)
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Mistake> {
        visitor.visit_some(self)
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(self, _: &'static str, visitor: V) -> Result<V::Value, Mistake> {
        visitor.visit_newtype_struct(self)
    }

    fn deserialize_seq<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Mistake> {
        match &self.node.value {
            Value::Array(_) => self.visit(visitor),
            _ => Err(self.wrong_type("a list", Some(Wanted::List)).located(self.node.place)),
        }
    }

    fn deserialize_unit_struct<V: Visitor<'de>>(self, _: &'static str, visitor: V) -> Result<V::Value, Mistake> {
        self.visit(visitor)
    }

    fn deserialize_tuple<V: Visitor<'de>>(self, length: usize, visitor: V) -> Result<V::Value, Mistake> {
        match &self.node.value {
            Value::Array(_) => self.visit(visitor),
            _ => Err(self.wrong_type(&format!("a list of {length}"), Some(Wanted::List)).located(self.node.place)),
        }
    }

    fn deserialize_tuple_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        _: usize,
        visitor: V,
    ) -> Result<V::Value, Mistake> {
        self.visit(visitor)
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Mistake> {
        let Value::Table(entries) = &self.node.value else {
            return Err(self.wrong_type("a table", Some(Wanted::Table)).located(self.node.place));
        };
        for entry in entries {
            if self.context.problems.borrow().is_full() {
                break;
            }
            let unknown = !fields.contains(&entry.key.as_str());
            if unknown && self.context.skipped.borrow_mut().insert(entry.node.place) {
                let is_own_table = matches!(entry.node.value, Value::Table(_)) && fields.contains(&"resolution_px");
                let help = match entry.key.as_str() {
                    "sensor" if is_own_table => {
                        String::from("a sensor file holds the keys of [sensor] themselves: leave the line [sensor] out")
                    }
                    key => guesses::of_key(key, fields),
                };
                let problem = Diagnostic::new(format!("unknown key `{}`", entry.key)).at(entry.key_place).help(help);
                self.context.problems.borrow_mut().push(problem);
            }
        }
        visitor
            .visit_map(Entries { entries: entries.iter(), value: None, fields: true, context: self.context })
            .map_err(|mistake| mistake.located(self.node.place))
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _: &'static str,
        variants: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Mistake> {
        let (name, place, content) = match &self.node.value {
            Value::String(name) => (name, self.node.place, None),
            Value::Table(entries) => match entries.as_slice() {
                [entry] => (&entry.key, entry.key_place, Some(&entry.node)),
                _ => {
                    let found: Vec<&str> = entries.iter().map(|entry| entry.key.as_str()).collect();
                    let found = if found.is_empty() { String::from("none") } else { found.join(" and ") };
                    let message = format!("exactly one of {} belongs here, found {found}", one_of(variants));
                    return Err(Mistake::new(message).located(self.node.place));
                }
            },
            _ => {
                let wanted = Wanted::of_choice(variants);
                return Err(self.wrong_type(&one_of(variants), wanted).located(self.node.place));
            }
        };
        if !variants.contains(&name.as_str()) {
            let help = guesses::of_choice(name, variants);
            let mistake = Mistake::new(format!("unknown choice `{name}`"));
            return Err(Mistake { help: Some(help), ..mistake }.located(place));
        }
        visitor
            .visit_enum(Choice { name, node: self.node, content, context: self.context })
            .map_err(|mistake| mistake.located(self.node.place))
    }
}

struct Items<'a> {
    items: std::slice::Iter<'a, Node>,
    context: &'a Context,
}

impl<'de> de::SeqAccess<'de> for &mut Items<'_> {
    type Error = Mistake;

    fn next_element_seed<T: de::DeserializeSeed<'de>>(&mut self, seed: T) -> Result<Option<T::Value>, Mistake> {
        let context = self.context;
        let Some(node) = self.items.find(|item| !context.skipped.borrow().contains(&item.place)) else {
            return Ok(None);
        };
        let value = seed.deserialize(Reader { node, context }).map_err(|mut mistake| {
            mistake.field.get_or_insert(node.place);
            if let Some(wanted) =
                mistake.wanted.take().filter(|_| mistake.place.is_none_or(|place| place == node.place))
            {
                mistake.help = mistake.help.or_else(|| guesses::line("", &node.value, wanted));
            }
            mistake
        });
        value.map(Some)
    }

    fn size_hint(&self) -> Option<usize> {
        Some(self.items.len())
    }
}

struct Entries<'a> {
    entries: std::slice::Iter<'a, Entry>,
    value: Option<&'a Entry>,
    /// The map is a struct: its entries can be left out one by one.
    fields: bool,
    context: &'a Context,
}

impl<'de> de::MapAccess<'de> for Entries<'_> {
    type Error = Mistake;

    fn next_key_seed<K: de::DeserializeSeed<'de>>(&mut self, seed: K) -> Result<Option<K::Value>, Mistake> {
        let skipped = self.context.skipped.borrow();
        let Some(entry) = self.entries.find(|entry| !skipped.contains(&entry.node.place)) else { return Ok(None) };
        self.value = Some(entry);
        seed.deserialize(entry.key.as_str().into_deserializer()).map(Some)
    }

    fn next_value_seed<V: de::DeserializeSeed<'de>>(&mut self, seed: V) -> Result<V::Value, Mistake> {
        let entry = self.value.take().ok_or_else(|| Mistake::new("a value was read before its key"))?;
        seed.deserialize(Reader { node: &entry.node, context: self.context }).map_err(|mut mistake| {
            mistake.place.get_or_insert(entry.node.place);
            // A value that is wrong as a whole.
            if let Some(wanted) = mistake.wanted.take().filter(|_| mistake.place == Some(entry.node.place)) {
                mistake.help = mistake.help.or_else(|| guesses::line(&entry.key, &entry.node.value, wanted));
            }
            if self.fields {
                mistake.field.get_or_insert(entry.node.place);
            }
            mistake
        })
    }
}

struct Choice<'a> {
    name: &'a str,
    node: &'a Node,
    /// The variant's own table; none for a bare name.
    content: Option<&'a Node>,
    context: &'a Context,
}

impl<'a, 'de> de::EnumAccess<'de> for Choice<'a> {
    type Error = Mistake;
    type Variant = Self;

    fn variant_seed<V: de::DeserializeSeed<'de>>(self, seed: V) -> Result<(V::Value, Self), Mistake> {
        let name: de::value::StrDeserializer<'_, Mistake> = self.name.into_deserializer();
        Ok((seed.deserialize(name)?, self))
    }
}

impl<'de> de::VariantAccess<'de> for Choice<'_> {
    type Error = Mistake;

    fn unit_variant(self) -> Result<(), Mistake> {
        match self.content {
            None => Ok(()),
            Some(Node { value: Value::Table(entries), .. }) if entries.is_empty() => Ok(()),
            Some(node) => Err(Mistake::new(format!("`{}` takes no parameters", self.name)).located(node.place)),
        }
    }

    fn newtype_variant_seed<T: de::DeserializeSeed<'de>>(self, seed: T) -> Result<T::Value, Mistake> {
        match self.content {
            Some(node) => seed.deserialize(Reader { node, context: self.context }),
            None => {
                let empty = Node { place: self.node.place, value: Value::Table(Vec::new()) };
                seed.deserialize(Reader { node: &empty, context: self.context }).map_err(|_| {
                    let help = Some(format!("write {{ {} = .. }}", self.name));
                    Mistake { help, ..Mistake::new(format!("`{}` needs a value", self.name)) }.located(self.node.place)
                })
            }
        }
    }

    fn tuple_variant<V: Visitor<'de>>(self, _: usize, _: V) -> Result<V::Value, Mistake> {
        Err(Mistake::new("a list of parameters is not supported"))
    }

    fn struct_variant<V: Visitor<'de>>(self, fields: &'static [&'static str], visitor: V) -> Result<V::Value, Mistake> {
        let empty = Node { place: self.node.place, value: Value::Table(Vec::new()) };
        let node = self.content.unwrap_or(&empty);
        de::Deserializer::deserialize_struct(Reader { node, context: self.context }, "", fields, visitor)
    }
}
