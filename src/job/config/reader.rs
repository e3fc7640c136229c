//! Reads a tree of [`TomlNode`]s into serde types, and collects every error on the way, not only the first.
//!
//! A derived `Deserialize` stops at its first error. So a table with a wrong value is read again without that value,
//! until it can be read: each round finds one more error, and unknown keys are all found in the first. A bare name for
//! an externally tagged enum (`optics = "phong"`) means the variant's empty table.

use std::cell::RefCell;
use std::collections::HashSet;
use std::fmt;

use serde::de::{self, DeserializeOwned, IntoDeserializer, Unexpected, Visitor};

use super::document::{TomlEntry, TomlNode, TomlValue};
use super::guesses::{self, ExpectedValue};
use gelsim_files::diagnostic::{Diagnostic, Diagnostics};
use gelsim_files::source::SourceSpan;
use gelsim_files::spelling::join_alternatives;

/// Reads `node` as a `T` whose fields all have defaults. Values that are wrong are reported to `problems` and then
/// count as not written. Returns `None` only if what remains cannot be a `T` at all; then at least one problem was
/// added.
pub fn read_node<T: DeserializeOwned>(node: &TomlNode, problems: &mut Diagnostics) -> Option<T> {
    // Deserializers share the problems and add to them, so they are in a cell meanwhile.
    let context = ReadContext { problems: RefCell::new(std::mem::take(problems)), skipped: RefCell::default() };
    let value = loop {
        match T::deserialize(NodeDeserializer { node, context: &context }) {
            Ok(value) => break Some(value),
            Err(mistake) => {
                let echo = mistake.echo || mistake.missing && context.has_skipped_child(node, mistake.place);
                if !echo {
                    let place = mistake.place.unwrap_or(node.place);
                    let problem = Diagnostic { help: mistake.help, ..Diagnostic::new(mistake.message) };
                    context.problems.borrow_mut().push(problem.at(place));
                }
                // Read again without the wrong value. If it was left out already, or nothing can be left out, no round
                // would help.
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

struct ReadContext {
    problems: RefCell<Diagnostics>,
    /// Values that were left out after an error in them, known by their places.
    skipped: RefCell<HashSet<SourceSpan>>,
}

impl ReadContext {
    /// Returns true if a key of the table at `place` was left out, so that its absence is no new error.
    fn has_skipped_child(&self, root: &TomlNode, place: Option<SourceSpan>) -> bool {
        fn find(node: &TomlNode, place: SourceSpan) -> Option<&TomlNode> {
            if node.place == place && matches!(node.value, TomlValue::Table(_)) {
                return Some(node);
            }
            match &node.value {
                TomlValue::Table(entries) => entries.iter().find_map(|entry| find(&entry.node, place)),
                TomlValue::Array(items) => items.iter().find_map(|item| find(item, place)),
                _ => None,
            }
        }
        let Some(TomlNode { value: TomlValue::Table(entries), .. }) = place.and_then(|place| find(root, place)) else {
            return false;
        };
        entries.iter().any(|entry| self.skipped.borrow().contains(&entry.node.place))
    }
}

/// A serde error that has a place.
#[derive(Debug)]
struct ReadError {
    message: String,
    help: Option<String>,
    /// The place of the value that is wrong.
    place: Option<SourceSpan>,
    /// The innermost field of a struct or element of a list around it, which the next round leaves out.
    field: Option<SourceSpan>,
    /// Whether a key is missing, rather than a value wrong.
    missing: bool,
    /// The kind of value that is expected.
    wanted: Option<ExpectedValue>,
    /// Whether it is no error of its own, but follows from errors that were found in the same list.
    echo: bool,
}

impl ReadError {
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

    fn with_place(mut self, place: SourceSpan) -> Self {
        self.place.get_or_insert(place);
        self
    }
}

impl fmt::Display for ReadError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for ReadError {}

impl de::Error for ReadError {
    fn custom<M: fmt::Display>(message: M) -> Self {
        let message = message.to_string();
        // The table has other keys, such as those of a range with names for its ends.
        let wanted = message.starts_with("unknown distribution").then_some(ExpectedValue::Quantity);
        Self { wanted, ..Self::new(message) }
    }

    fn invalid_type(unexpected: Unexpected<'_>, expected: &dyn de::Expected) -> Self {
        let expected = expected.to_string().replace("a sequence", "a list");
        let wanted = expected.starts_with(QUANTITY).then_some(ExpectedValue::Quantity);
        Self { wanted, ..Self::new(format!("expected {expected}, found {}", describe_unexpected(unexpected))) }
    }

    fn invalid_length(length: usize, expected: &dyn de::Expected) -> Self {
        let expected = expected.to_string().replace("an array of length", "a list of");
        Self::new(format!("expected {expected}, found {length} element{}", if length == 1 { "" } else { "s" }))
    }

    fn missing_field(field: &'static str) -> Self {
        Self { missing: true, ..Self::new(format!("missing key `{field}`")) }
    }
}

/// Returns true for the visitor of a quantity, whose text for messages begins like no other.
fn is_quantity<'de, V: Visitor<'de>>(visitor: &V) -> bool {
    let expected: &dyn de::Expected = visitor;
    expected.to_string().starts_with(QUANTITY)
}

/// How a quantity begins to say what it may be.
const QUANTITY: &str = "a number, [min, max]";

fn describe_unexpected(unexpected: Unexpected<'_>) -> String {
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

impl TomlValue {
    fn to_unexpected(&self) -> Unexpected<'_> {
        match self {
            TomlValue::Bool(truth) => Unexpected::Bool(*truth),
            TomlValue::Integer(number) => Unexpected::Signed(*number),
            TomlValue::Float(number) => Unexpected::Float(*number),
            TomlValue::String(text) => Unexpected::Str(text),
            TomlValue::Datetime => Unexpected::Other("a date or time"),
            TomlValue::Array(_) => Unexpected::Seq,
            TomlValue::Table(_) => Unexpected::Map,
        }
    }
}

#[derive(Clone, Copy)]
struct NodeDeserializer<'a> {
    node: &'a TomlNode,
    context: &'a ReadContext,
}

impl<'a> NodeDeserializer<'a> {
    fn wrong_type(&self, expected: &str, wanted: Option<ExpectedValue>) -> ReadError {
        let message = format!("expected {expected}, found {}", describe_unexpected(self.node.value.to_unexpected()));
        ReadError { wanted, ..ReadError::new(message) }
    }

    fn visit<'de, V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ReadError> {
        match &self.node.value {
            TomlValue::Bool(truth) => visitor.visit_bool(*truth),
            TomlValue::Integer(number) => visitor.visit_i64(*number),
            TomlValue::Float(number) => visitor.visit_f64(*number),
            TomlValue::String(text) => visitor.visit_str(text),
            TomlValue::Datetime => Err(self.wrong_type("a value that is not a date", None)),
            TomlValue::Array(items) => {
                let wanted = Some(ExpectedValue::Quantity).filter(|_| is_quantity(&visitor));
                let lost = {
                    let skipped = self.context.skipped.borrow();
                    !skipped.is_empty() && items.iter().any(|item| skipped.contains(&item.place))
                };
                let items_in_all = items.len();
                let mut items = ItemAccess { items: items.iter(), context: self.context };
                match (visitor.visit_seq(&mut items), items.items.len()) {
                    // An error with a place is one inside an element, and always reported.
                    (Err(mistake), _) if !lost || mistake.place.is_some() => {
                        let is_own = mistake.place.is_none();
                        Err(ReadError { wanted: mistake.wanted.or(wanted.filter(|_| is_own)), ..mistake })
                    }
                    _ if lost => Err(ReadError { echo: true, ..ReadError::new("") }),
                    (value, 0) => value,
                    (_, more) => {
                        let (all, most) = (items_in_all, items_in_all - more);
                        let help = guesses::suggest_decimal_points(&self.node.value, most);
                        let message = format!("{all} elements, where {most} belong");
                        Err(ReadError { help, wanted, ..ReadError::new(message) })
                    }
                }
            }
            TomlValue::Table(entries) => visitor.visit_map(EntryAccess {
                entries: entries.iter(),
                value: None,
                fields: false,
                context: self.context,
            }),
        }
        .map_err(|mistake| mistake.with_place(self.node.place))
    }

    fn integer<'de, V: Visitor<'de>>(self, min: i64, visitor: V) -> Result<V::Value, ReadError> {
        match &self.node.value {
            TomlValue::Integer(number) if *number >= min => visitor.visit_i64(*number),
            _ if min == 0 => Err(self.wrong_type("a whole number from 0 up", Some(ExpectedValue::Integer))),
            _ => Err(self.wrong_type("a whole number", Some(ExpectedValue::Integer))),
        }
        .map_err(|mistake| mistake.with_place(self.node.place))
    }
}

macro_rules! forward {
    ($($method:ident => $($call:ident)? ( $($argument:expr)? )),* $(,)?) => { $(
        fn $method<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ReadError> {
            self.$($call)?($($argument,)? visitor)
        }
    )* };
}

impl<'de> de::Deserializer<'de> for NodeDeserializer<'_> {
    type Error = ReadError;

    forward! {
        deserialize_any => visit(), deserialize_char => visit(), deserialize_bytes => visit(),
        deserialize_byte_buf => visit(), deserialize_unit => visit(), deserialize_identifier => visit(),
        deserialize_ignored_any => visit(), deserialize_map => visit(),
        deserialize_i8 => integer(i64::MIN), deserialize_i16 => integer(i64::MIN), deserialize_i32 => integer(i64::MIN),
        deserialize_i64 => integer(i64::MIN), deserialize_u8 => integer(0), deserialize_u16 => integer(0),
        deserialize_u32 => integer(0), deserialize_u64 => integer(0), deserialize_f32 => deserialize_f64(),
    }

    fn deserialize_bool<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ReadError> {
        match &self.node.value {
            TomlValue::Bool(_) => self.visit(visitor),
            _ => Err(self.wrong_type("true or false", Some(ExpectedValue::Bool)).with_place(self.node.place)),
        }
    }

    fn deserialize_f64<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ReadError> {
        match &self.node.value {
            TomlValue::Integer(number) => visitor.visit_f64(*number as f64),
            TomlValue::Float(number) => visitor.visit_f64(*number),
            _ => Err(self.wrong_type("a number", Some(ExpectedValue::Number))),
        }
        .map_err(|mistake| mistake.with_place(self.node.place))
    }

    fn deserialize_str<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ReadError> {
        match &self.node.value {
            TomlValue::String(_) => self.visit(visitor),
            _ => Err(self.wrong_type("text in quotes", Some(ExpectedValue::Text)).with_place(self.node.place)),
        }
    }

    fn deserialize_string<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ReadError> {
        self.deserialize_str(visitor)
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ReadError> {
        visitor.visit_some(self)
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(self, _: &'static str, visitor: V) -> Result<V::Value, ReadError> {
        visitor.visit_newtype_struct(self)
    }

    fn deserialize_seq<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ReadError> {
        match &self.node.value {
            TomlValue::Array(_) => self.visit(visitor),
            _ => Err(self.wrong_type("a list", Some(ExpectedValue::List)).with_place(self.node.place)),
        }
    }

    fn deserialize_unit_struct<V: Visitor<'de>>(self, _: &'static str, visitor: V) -> Result<V::Value, ReadError> {
        self.visit(visitor)
    }

    fn deserialize_tuple<V: Visitor<'de>>(self, length: usize, visitor: V) -> Result<V::Value, ReadError> {
        match &self.node.value {
            TomlValue::Array(_) => self.visit(visitor),
            _ => Err(self
                .wrong_type(&format!("a list of {length}"), Some(ExpectedValue::List))
                .with_place(self.node.place)),
        }
    }

    fn deserialize_tuple_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        _: usize,
        visitor: V,
    ) -> Result<V::Value, ReadError> {
        self.visit(visitor)
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, ReadError> {
        let TomlValue::Table(entries) = &self.node.value else {
            return Err(self.wrong_type("a table", Some(ExpectedValue::Table)).with_place(self.node.place));
        };
        for entry in entries {
            if self.context.problems.borrow().is_full() {
                break;
            }
            let unknown = !fields.contains(&entry.key.as_str());
            if unknown && self.context.skipped.borrow_mut().insert(entry.node.place) {
                let is_own_table = matches!(entry.node.value, TomlValue::Table(_)) && fields.contains(&"resolution_px");
                let help = match entry.key.as_str() {
                    "sensor" if is_own_table => {
                        String::from("a sensor file holds the keys of [sensor] themselves: leave the line [sensor] out")
                    }
                    key => guesses::suggest_key(key, fields),
                };
                let problem = Diagnostic::new(format!("unknown key `{}`", entry.key)).at(entry.key_place).help(help);
                self.context.problems.borrow_mut().push(problem);
            }
        }
        visitor
            .visit_map(EntryAccess { entries: entries.iter(), value: None, fields: true, context: self.context })
            .map_err(|mistake| mistake.with_place(self.node.place))
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _: &'static str,
        variants: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, ReadError> {
        let (name, place, content) = match &self.node.value {
            TomlValue::String(name) => (name, self.node.place, None),
            TomlValue::Table(entries) => match entries.as_slice() {
                [entry] => (&entry.key, entry.key_place, Some(&entry.node)),
                _ => {
                    let found: Vec<&str> = entries.iter().map(|entry| entry.key.as_str()).collect();
                    let found = if found.is_empty() { String::from("none") } else { found.join(" and ") };
                    let message = format!("exactly one of {} belongs here, found {found}", join_alternatives(variants));
                    return Err(ReadError::new(message).with_place(self.node.place));
                }
            },
            _ => {
                let wanted = ExpectedValue::from_choice_names(variants);
                return Err(self.wrong_type(&join_alternatives(variants), wanted).with_place(self.node.place));
            }
        };
        if !variants.contains(&name.as_str()) {
            let help = guesses::suggest_choice(name, variants);
            let mistake = ReadError::new(format!("unknown choice `{name}`"));
            return Err(ReadError { help: Some(help), ..mistake }.with_place(place));
        }
        visitor
            .visit_enum(ChoiceAccess { name, node: self.node, content, context: self.context })
            .map_err(|mistake| mistake.with_place(self.node.place))
    }
}

struct ItemAccess<'a> {
    items: std::slice::Iter<'a, TomlNode>,
    context: &'a ReadContext,
}

impl<'de> de::SeqAccess<'de> for &mut ItemAccess<'_> {
    type Error = ReadError;

    fn next_element_seed<T: de::DeserializeSeed<'de>>(&mut self, seed: T) -> Result<Option<T::Value>, ReadError> {
        let context = self.context;
        let Some(node) = self.items.find(|item| !context.skipped.borrow().contains(&item.place)) else {
            return Ok(None);
        };
        let value = seed.deserialize(NodeDeserializer { node, context }).map_err(|mut mistake| {
            mistake.field.get_or_insert(node.place);
            if let Some(wanted) =
                mistake.wanted.take().filter(|_| mistake.place.is_none_or(|place| place == node.place))
            {
                mistake.help = mistake.help.or_else(|| guesses::suggest_line("", &node.value, wanted));
            }
            mistake
        });
        value.map(Some)
    }

    fn size_hint(&self) -> Option<usize> {
        Some(self.items.len())
    }
}

struct EntryAccess<'a> {
    entries: std::slice::Iter<'a, TomlEntry>,
    value: Option<&'a TomlEntry>,
    /// Whether the map is a struct, whose entries can be left out one by one.
    fields: bool,
    context: &'a ReadContext,
}

impl<'de> de::MapAccess<'de> for EntryAccess<'_> {
    type Error = ReadError;

    fn next_key_seed<K: de::DeserializeSeed<'de>>(&mut self, seed: K) -> Result<Option<K::Value>, ReadError> {
        let skipped = self.context.skipped.borrow();
        let Some(entry) = self.entries.find(|entry| !skipped.contains(&entry.node.place)) else { return Ok(None) };
        self.value = Some(entry);
        seed.deserialize(entry.key.as_str().into_deserializer()).map(Some)
    }

    fn next_value_seed<V: de::DeserializeSeed<'de>>(&mut self, seed: V) -> Result<V::Value, ReadError> {
        let entry = self.value.take().ok_or_else(|| ReadError::new("a value was read before its key"))?;
        seed.deserialize(NodeDeserializer { node: &entry.node, context: self.context }).map_err(|mut mistake| {
            mistake.place.get_or_insert(entry.node.place);
            // The error is about the value itself, not about a part of it.
            if let Some(wanted) = mistake.wanted.take().filter(|_| mistake.place == Some(entry.node.place)) {
                mistake.help = mistake.help.or_else(|| guesses::suggest_line(&entry.key, &entry.node.value, wanted));
            }
            if self.fields {
                mistake.field.get_or_insert(entry.node.place);
            }
            mistake
        })
    }
}

struct ChoiceAccess<'a> {
    name: &'a str,
    node: &'a TomlNode,
    /// The variant's own table; `None` for a bare name.
    content: Option<&'a TomlNode>,
    context: &'a ReadContext,
}

impl<'a, 'de> de::EnumAccess<'de> for ChoiceAccess<'a> {
    type Error = ReadError;
    type Variant = Self;

    fn variant_seed<V: de::DeserializeSeed<'de>>(self, seed: V) -> Result<(V::Value, Self), ReadError> {
        let name: de::value::StrDeserializer<'_, ReadError> = self.name.into_deserializer();
        Ok((seed.deserialize(name)?, self))
    }
}

impl<'de> de::VariantAccess<'de> for ChoiceAccess<'_> {
    type Error = ReadError;

    fn unit_variant(self) -> Result<(), ReadError> {
        match self.content {
            None => Ok(()),
            Some(TomlNode { value: TomlValue::Table(entries), .. }) if entries.is_empty() => Ok(()),
            Some(node) => Err(ReadError::new(format!("`{}` takes no parameters", self.name)).with_place(node.place)),
        }
    }

    fn newtype_variant_seed<T: de::DeserializeSeed<'de>>(self, seed: T) -> Result<T::Value, ReadError> {
        match self.content {
            Some(node) => seed.deserialize(NodeDeserializer { node, context: self.context }),
            None => {
                let empty = TomlNode { place: self.node.place, value: TomlValue::Table(Vec::new()) };
                seed.deserialize(NodeDeserializer { node: &empty, context: self.context }).map_err(|_| {
                    let help = Some(format!("write {{ {} = .. }}", self.name));
                    ReadError { help, ..ReadError::new(format!("`{}` needs a value", self.name)) }
                        .with_place(self.node.place)
                })
            }
        }
    }

    fn tuple_variant<V: Visitor<'de>>(self, _: usize, _: V) -> Result<V::Value, ReadError> {
        Err(ReadError::new("a list of parameters is not supported"))
    }

    fn struct_variant<V: Visitor<'de>>(
        self,
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, ReadError> {
        let empty = TomlNode { place: self.node.place, value: TomlValue::Table(Vec::new()) };
        let node = self.content.unwrap_or(&empty);
        de::Deserializer::deserialize_struct(NodeDeserializer { node, context: self.context }, "", fields, visitor)
    }
}
