//! Guesses what people mean who have not read the docs: keys and values of other programs, and values of a wrong kind.
//!
//! A known guess beats the nearest spelling, since `leds` is as near to `lens` as to `led`. A guess is suggested only
//! if the table or key where it stands takes it.

use super::document::{TomlEntry, TomlNode, TomlValue};
use super::synonyms::{CHOICE_GUESSES, CHOICE_HELP, KEY_GUESSES, Meaning};
use crate::layers::OutputLayer;
use Meaning::{Elsewhere, Key};
use gelsim_files::spelling::{find_nearest_name, join_alternatives};

/// Brings a name to the form of the tables: lower case, with `_` between words.
fn normalise_name(written: &str) -> String {
    written.trim().to_lowercase().replace(['-', ' '], "_")
}

/// Returns true if `written` may be meant as this key.
pub fn is_guess_at(written: &str, key: &str) -> bool {
    let guess = normalise_name(written);
    let is_meant = |meant: &Meaning| matches!(meant, Key(meant) if *meant == key);
    KEY_GUESSES.iter().any(|(guesses, meant)| guesses.contains(&guess.as_str()) && meant.iter().any(is_meant))
        || find_nearest_name(written, [key]).is_some()
}

/// Suggests what to do with the unknown key `written` in a table that has the keys `known`: the key that is meant, or
/// where it is said instead.
pub fn suggest_key(written: &str, known: &[&str]) -> String {
    let guess = normalise_name(written);
    if let Some(name) = known.iter().find(|name| normalise_name(name) == guess) {
        return format!("did you mean `{name}`?");
    }
    let guessed: Vec<_> = KEY_GUESSES.iter().filter(|(guesses, _)| guesses.contains(&guess.as_str())).collect();
    // A key in the wrong table: where it belongs is said with what others call it.
    let itself: Vec<_> =
        KEY_GUESSES.iter().filter(|(_, meant)| matches!(meant.first(), Some(Key(key)) if *key == guess)).collect();
    let itself = if itself.len() == 1 { itself } else { Vec::new() };
    for meaning in guessed.into_iter().chain(itself).flat_map(|(_, meant)| *meant) {
        match meaning {
            Key(key) if known.contains(key) => return format!("did you mean `{key}`?"),
            Elsewhere(help) => return (*help).to_owned(),
            Key(_) => {}
        }
    }
    match find_nearest_name(written, known.iter().copied()) {
        Some(name) => format!("did you mean `{name}`?"),
        None => format!("known here: {}", join_alternatives(known)),
    }
}

/// Returns the known choice that is meant by an unknown one, if it can be guessed.
pub fn guess_choice<'a>(written: &str, known: &[&'a str]) -> Option<&'a str> {
    let guess = normalise_name(written);
    let same = || known.iter().find(|name| normalise_name(name) == guess);
    let by_table = || {
        let meant = CHOICE_GUESSES
            .iter()
            .filter(|(guesses, _)| guesses.contains(&guess.as_str()))
            .flat_map(|(_, meant)| *meant);
        meant.filter_map(|name| known.iter().find(|known| *known == name)).next()
    };
    // Sides differ only by their sign, so that a nearest spelling must have one, too.
    let signed = written.starts_with(['+', '-']);
    let is_known = CHOICE_HELP.iter().any(|(guesses, _)| guesses.contains(&guess.as_str()));
    let alike = || known.iter().copied().filter(|name| !is_known && (!signed || name.starts_with(['+', '-'])));
    let by_spelling = || find_nearest_name(written, alike());
    same().or_else(by_table).copied().or_else(by_spelling)
}

/// Suggests what to do with the unknown choice `written`.
pub fn suggest_choice(written: &str, known: &[&str]) -> String {
    let guess = normalise_name(written);
    let all = join_alternatives(known);
    if let Some(near) = guess_choice(written, known) {
        return format!("did you mean `{near}`? One of {all}");
    }
    match CHOICE_HELP.iter().find(|(guesses, _)| guesses.contains(&guess.as_str())) {
        Some((_, help)) => format!("{help}. One of {all}"),
        None => format!("one of {all}"),
    }
}

/// The kind of value that a key takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExpectedValue {
    /// A whole number.
    Integer,
    /// A number.
    Number,
    /// A constant, a range or a distribution.
    Quantity,
    /// True or false.
    Bool,
    /// Text.
    Text,
    /// A list.
    List,
    /// A table.
    Table,
    /// `stick`, or a table with a coefficient.
    Friction,
    /// `stick`, or a table with Coulomb friction.
    Coulomb,
}

impl ExpectedValue {
    /// Returns the kind of value of a choice that has one of these names; `None` for any other choice.
    pub fn from_choice_names(names: &[&str]) -> Option<Self> {
        match names {
            names if names.contains(&"coulomb") => Some(Self::Coulomb),
            names if names.contains(&"coefficient") => Some(Self::Friction),
            _ => None,
        }
    }
}

/// Names that people give to the lower end of a range.
const LOWER_END_NAMES: &[&str] = &["min", "low", "from", "start", "lower"];
/// Names that people give to the upper end of a range.
const UPPER_END_NAMES: &[&str] = &["max", "high", "to", "end", "stop", "upper"];

/// Tables that are often written as a switch or a name, and what to write instead.
const TABLE_HELP: &[(&str, &str)] = &[
    ("markers", "a table says which: [markers] with pitch_mm = 1.5 and diameter_mm = 0.4"),
    ("texture", "a table says which: [texture] with patterns = [\"noise\"] and amplitude_mm = [0.01, 0.05]"),
    ("camera", "a table says what it does: [camera] with read_noise_levels = 2.0"),
    ("shear", "a table says how far: [shear] with x_mm = [-0.3, 0.3]"),
    ("unit", "a table says how much: [sensor.unit] with variation = 0.5"),
    ("splits", "a table says how much each gets: splits = { train = 0.8, val = 0.1, test = 0.1 }"),
];

/// Lists whose elements are tables, each with the header of such a table.
const LISTS_OF_TABLES: &[(&str, &str)] = &[
    ("object", "object"),
    ("photometric", "photometric"),
    ("led", "sensor.led"),
    ("lamp", "sensor.lamp"),
    ("phase", "sequence.phase"),
];

/// Suggests the line as it should read if the value of `key` is of another kind than wanted and the meaning is plain.
/// For an element of a list, whose key is empty, it suggests the value.
pub fn suggest_line(key: &str, value: &TomlValue, wanted: ExpectedValue) -> Option<String> {
    let write = |value: String| {
        Some(match key {
            "" => format!("write `{value}`"),
            key => format!("write `{key} = {value}`"),
        })
    };
    let list =
        |numbers: &[f64]| format!("[{}]", numbers.iter().map(|n| format_decimal(*n)).collect::<Vec<_>>().join(", "));
    if wanted == ExpectedValue::List
        && let Some((_, table)) = LISTS_OF_TABLES.iter().find(|(list, _)| *list == key)
    {
        return Some(match value {
            TomlValue::String(path) if key == "object" => format!("write [[object]] with path = {path:?}"),
            TomlValue::Table(_) => format!("there may be several: write [[{table}]]"),
            _ => format!("each is a table: write [[{table}]], or {key} = [{{ .. }}] in one line"),
        });
    }
    match (value, wanted) {
        (TomlValue::String(text), ExpectedValue::Integer)
            if key == "seed" && !text.trim().starts_with(|c: char| c.is_ascii_digit()) =>
        {
            Some(String::from(
                "a seed is a whole number, such as `seed = 7`: the same seed gives the same samples, another one others",
            ))
        }
        (TomlValue::String(text), ExpectedValue::Integer) => write(format_integer(parse_loose_number(text)?)?),
        (TomlValue::Float(number), ExpectedValue::Integer) => write(format_integer(*number)?),
        (TomlValue::String(text), ExpectedValue::Number) => write(format_decimal(parse_loose_number(text)?)),
        (TomlValue::String(text), ExpectedValue::Quantity) => match parse_loose_numbers(text)?.as_slice() {
            [one] => write(format_decimal(*one)),
            [low, high] => write(list(&[*low, *high])),
            _ => None,
        },
        (TomlValue::Array(items), ExpectedValue::Text) if key == "path" && items.len() > 1 => Some(String::from(
            "one table for each file: [[object]] with path = \"a.stl\"; or a pattern for all of them, path = \"*.stl\"",
        )),
        (TomlValue::Array(items), ExpectedValue::Integer | ExpectedValue::Number | ExpectedValue::Text) => {
            match items.as_slice() {
                [TomlNode { value, .. }] => write(format_literal(value)?),
                _ => None,
            }
        }
        (TomlValue::Array(items), ExpectedValue::Quantity) if items.len() != 2 => match as_floats(items)?.as_slice() {
            [] => None,
            [one] => write(format_decimal(*one)),
            several => write(format!("{{ choice = {} }}", list(several))),
        },
        (TomlValue::String(text), ExpectedValue::Bool) => match text.to_lowercase().as_str() {
            "true" | "yes" | "on" => write(String::from("true")),
            "false" | "no" | "off" => write(String::from("false")),
            _ => None,
        },
        (TomlValue::Integer(truth @ (0 | 1)), ExpectedValue::Bool) => write((*truth == 1).to_string()),
        (TomlValue::Integer(_) | TomlValue::Float(_) | TomlValue::Bool(_), ExpectedValue::Text) => {
            write(format!("\"{}\"", format_literal(value)?))
        }
        (TomlValue::String(text), ExpectedValue::List) if key == "layers" => {
            let known: Vec<&str> = OutputLayer::ALL.into_iter().map(OutputLayer::name).collect();
            let named: Option<Vec<&str>> =
                text.split([',', ' ']).filter(|word| !word.is_empty()).map(|word| guess_choice(word, &known)).collect();
            match named.filter(|named| !named.is_empty()) {
                Some(named) => write(format!("{named:?}")),
                None => Some(String::from(
                    "name them, such as `layers = [\"depth\", \"contact\"]`: gelsim list layers shows all",
                )),
            }
        }
        (TomlValue::String(text), ExpectedValue::List) => match parse_loose_numbers(text) {
            Some(several) if several.len() > 1 => write(list(&several)),
            _ => write(format!("[{text:?}]")),
        },
        (TomlValue::Integer(_) | TomlValue::Float(_), ExpectedValue::List) => {
            let one = format_literal(value)?;
            write(format!("[{one}, {one}]"))
        }
        (TomlValue::Table(entries), ExpectedValue::List) if key == "layers" => {
            let named = entries.iter().filter(|entry| !matches!(entry.node.value, TomlValue::Bool(false)));
            let names: Vec<String> = named.map(|entry| format!("{:?}", entry.key)).collect();
            write(format!("[{}]", names.join(", ")))
        }
        (TomlValue::Table(entries), ExpectedValue::List) => {
            let of = |names: &[&str]| find_number(entries, names);
            let ends = of(LOWER_END_NAMES)
                .zip(of(UPPER_END_NAMES))
                .or_else(|| of(&["width", "w", "x"]).zip(of(&["height", "h", "y"])));
            match ends {
                Some((first, second)) => write(list(&[first, second])),
                None => Some(format!("a list stands in brackets: {key} = [..]")),
            }
        }
        (TomlValue::Array(items), ExpectedValue::Table) if key == "splits" => match as_floats(items)?.as_slice() {
            [train, val, test] => write(format!(
                "{{ train = {}, val = {}, test = {} }}",
                format_decimal(*train),
                format_decimal(*val),
                format_decimal(*test)
            )),
            [train, test] => {
                write(format!("{{ train = {}, test = {} }}", format_decimal(*train), format_decimal(*test)))
            }
            _ => None,
        },
        (TomlValue::Array(items), ExpectedValue::Table) => items
            .iter()
            .all(|item| matches!(item.value, TomlValue::Table(_)))
            .then(|| format!("there is one: [{key}] in place of [[{key}]]")),
        (TomlValue::Bool(false), ExpectedValue::Table) => Some(String::from("leave it out")),
        (TomlValue::String(name), ExpectedValue::Table) if key == "sensor" => {
            let known = gelsim_files::sensor::PRESETS.map(|(name, _)| name);
            Some(match guess_choice(name, &known) {
                Some(preset) => format!("a table says which: [sensor] with preset = \"{preset}\""),
                None => format!("a table says which: [sensor] with file = {name:?}, or preset = \"digit\""),
            })
        }
        (_, ExpectedValue::Table) => {
            TABLE_HELP.iter().find(|(table, _)| *table == key).map(|(_, help)| (*help).to_owned())
        }
        (TomlValue::Table(entries), ExpectedValue::Quantity) => {
            let of = |names: &[&str]| find_number(entries, names);
            let (low, high) = (of(LOWER_END_NAMES), of(UPPER_END_NAMES));
            match (of(&["mean", "mu"]), of(&["std", "sigma", "sd"]), low.zip(high)) {
                (Some(mean), Some(std), limits) => {
                    let limits = limits.map_or(String::new(), |(low, high)| {
                        format!(", min = {}, max = {}", format_decimal(low), format_decimal(high))
                    });
                    write(format!(
                        "{{ normal = {{ mean = {}, std = {}{limits} }} }}",
                        format_decimal(mean),
                        format_decimal(std)
                    ))
                }
                (_, _, Some((low, high))) => write(list(&[low, high])),
                _ => None,
            }
        }
        (TomlValue::Integer(_) | TomlValue::Float(_), ExpectedValue::Coulomb) => {
            write(format!("{{ coulomb = {{ coefficient = {} }} }}", format_literal(value)?))
        }
        (TomlValue::Integer(_) | TomlValue::Float(_), ExpectedValue::Friction) => {
            write(format!("{{ coefficient = {} }}", format_literal(value)?))
        }
        (TomlValue::Array(items), ExpectedValue::Friction) => {
            write(format!("{{ coefficient = {} }}", list(&as_floats(items)?)))
        }
        (TomlValue::Array(_), ExpectedValue::Coulomb) => Some(String::from(
            "it is one number here: { coulomb = { coefficient = 0.5 } }; under [[object]] and in [sequence] friction may be a range",
        )),
        _ => None,
    }
}

/// Suggests a list with decimal points if its numbers were written with decimal commas, so that it has twice as many
/// elements as `wanted`.
pub fn suggest_decimal_points(value: &TomlValue, wanted: usize) -> Option<String> {
    let TomlValue::Array(items) = value else { return None };
    let halves = items.iter().map(|item| match item.value {
        TomlValue::Integer(number) => Some(number),
        _ => None,
    });
    let halves: Vec<i64> = halves.collect::<Option<_>>()?;
    let meant = halves.chunks_exact(2).map(|pair| format!("{}.{}", pair[0], pair[1])).collect::<Vec<_>>().join(", ");
    let is_so = halves.len() == 2 * wanted && halves.iter().skip(1).step_by(2).all(|digits| *digits >= 0);
    is_so.then(|| format!("numbers have a decimal point: [{meant}]"))
}

/// Parses a number in a text, with 3,000 and 3k allowed.
fn parse_loose_number(text: &str) -> Option<f64> {
    let text = text.trim().replace([',', '_', ' '], "");
    let (digits, times) = match text.strip_suffix(['k', 'K']) {
        Some(digits) => (digits, 1e3),
        None => match text.strip_suffix('M') {
            Some(digits) => (digits, 1e6),
            None => (text.as_str(), 1.0),
        },
    };
    let number = digits.parse::<f64>().ok()?;
    number.is_finite().then_some(times * number)
}

/// Parses the numbers in a text such as `640x480`, `0.2 - 1.0` or `0.2, 1.0`.
fn parse_loose_numbers(text: &str) -> Option<Vec<f64>> {
    if let Ok(one) = text.trim().parse::<f64>() {
        return Some(vec![one]);
    }
    let text = text.trim().trim_start_matches(['[', '(']).trim_end_matches([']', ')']).to_lowercase();
    let parts = ["x", "*", "×", ",", "..", " to ", ";", " - ", "-", " "]
        .into_iter()
        .map(|between| text.split(between).map(str::trim).collect::<Vec<_>>());
    let read = |parts: Vec<&str>| {
        parts
            .iter()
            .map(|part| part.parse().ok().filter(|number: &f64| number.is_finite()))
            .collect::<Option<Vec<f64>>>()
    };
    parts.filter(|parts| parts.len() > 1).find_map(read)
}

/// Formats a whole number as TOML; `None` for any other number.
pub fn format_integer(number: f64) -> Option<String> {
    ((0.0..9e15).contains(&number) && number.fract() == 0.0).then(|| format!("{number:.0}"))
}

/// Formats a number as TOML. Whole numbers have no point, since every key takes them so.
fn format_decimal(number: f64) -> String {
    format_integer(number.abs()).map_or_else(|| format!("{number:?}"), |_| format!("{number:.0}"))
}

fn format_literal(value: &TomlValue) -> Option<String> {
    match value {
        TomlValue::Bool(truth) => Some(truth.to_string()),
        TomlValue::Integer(number) => Some(number.to_string()),
        TomlValue::Float(number) => Some(format!("{number:?}")),
        TomlValue::String(text) => Some(format!("{text:?}")),
        TomlValue::Datetime | TomlValue::Array(_) | TomlValue::Table(_) => None,
    }
}

fn as_float(value: &TomlValue) -> Option<f64> {
    match value {
        TomlValue::Integer(number) => Some(*number as f64),
        TomlValue::Float(number) => Some(*number),
        _ => None,
    }
}

/// Finds the first key of a table that has one of these names, and returns its number.
fn find_number(entries: &[TomlEntry], names: &[&str]) -> Option<f64> {
    entries.iter().find(|entry| names.contains(&entry.key.as_str())).and_then(|entry| as_float(&entry.node.value))
}

fn as_floats(items: &[TomlNode]) -> Option<Vec<f64>> {
    items.iter().map(|item| as_float(&item.value)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_guess_that_is_known_beats_the_nearest_spelling() {
        let sensor =
            ["preset", "background", "background_sha256", "lens", "led", "calibration", "resolution_px", "unit"];
        for (written, help) in [
            ("background_image", "did you mean `background`?"),
            (
                "leds",
                "each LED is a table of its own, [[sensor.led]], in a sensor file [[led]], with azimuth_deg, elevation_deg and color",
            ),
            ("type", "did you mean `preset`?"),
            ("Background", "did you mean `background`?"),
            ("resolution", "did you mean `resolution_px`?"),
            ("resolutoin_px", "did you mean `resolution_px`?"),
        ] {
            assert_eq!(suggest_key(written, &sensor), help, "{written}");
        }
        assert!(suggest_key("variation", &sensor).contains("[sensor.unit] variation = 0.5"));
        assert!(suggest_key("dir", &["layers", "exr"]).contains("--out DIR"));
        assert!(suggest_key("brightnes", &["depth_mm", "at"]).starts_with("known here: "));
        // A key is suggested only in a table that has it.
        assert!(suggest_key("background_image", &["depth_mm"]).contains("under [sensor]"));
        // One in the wrong table is not taken for another that is spelt or called alike.
        let object = ["path", "unit", "scale", "length_mm", "weight", "class"];
        assert!(suggest_key("depth_mm", &object).starts_with("under [indentation]: depth_mm"));
        assert!(suggest_key("num_samples", &object).starts_with("under [dataset]: samples"));
        assert!(suggest_key("samples", &["dataset", "sensor", "object"]).starts_with("under [dataset]: samples"));
        assert!(suggest_key("fidelity", &["layers", "exr"]).starts_with("at the top of the job"));
        assert!(suggest_key("layers", &object).starts_with("under [output]"));
        assert!(suggest_key("size", &object).contains("`length_mm`"));
    }

    #[test]
    fn a_choice_is_found_by_its_meaning_and_never_with_another_sign() {
        assert_eq!(guess_choice("heightmap", &["depth", "surface"]), Some("surface"));
        assert_eq!(guess_choice("DIGIT", &["digit", "tactip"]), Some("digit"));
        assert_eq!(guess_choice("gelsight", &["allsight", "gelsight-mini"]), Some("gelsight-mini"));
        assert_eq!(guess_choice("-Z", &["any", "+x", "-x", "+z", "-z"]), Some("-z"));
        assert_eq!(guess_choice("meters", &["mm", "cm", "m", "in"]), Some("m"));
        assert_eq!(guess_choice("um", &["mm", "cm", "m", "in"]), None);
        assert!(suggest_choice("um", &["mm", "cm", "m", "in"]).starts_with("for micrometres write"));
        assert!(suggest_choice("hdf5", &["tar", "folder"]).starts_with("gelsim-export copies"));
    }

    #[test]
    fn the_line_is_shown_as_it_should_read() {
        let text = |text: &str| TomlValue::String(text.to_owned());
        let said = |key: &str, value: &TomlValue, wanted| suggest_line(key, value, wanted).unwrap_or_default();
        for (key, value, wanted, expected) in [
            ("samples", text("3000"), ExpectedValue::Integer, "write `samples = 3000`"),
            ("samples", text("3,000"), ExpectedValue::Integer, "write `samples = 3000`"),
            ("samples", text("2k"), ExpectedValue::Integer, "write `samples = 2000`"),
            ("samples", TomlValue::Float(3e3), ExpectedValue::Integer, "write `samples = 3000`"),
            ("resolution_px", text("640x480"), ExpectedValue::List, "write `resolution_px = [640, 480]`"),
            ("layers", text("depth"), ExpectedValue::List, "write `layers = [\"depth\"]`"),
            ("depth_mm", text("0.2 - 1.0"), ExpectedValue::Quantity, "write `depth_mm = [0.2, 1]`"),
            ("weight", text("0.5"), ExpectedValue::Number, "write `weight = 0.5`"),
            ("name", TomlValue::Integer(5), ExpectedValue::Text, "write `name = \"5\"`"),
            ("sensor", text("digit"), ExpectedValue::Table, "a table says which: [sensor] with preset = \"digit\""),
            (
                "markers",
                TomlValue::Bool(true),
                ExpectedValue::Table,
                "a table says which: [markers] with pitch_mm = 1.5 and diameter_mm = 0.4",
            ),
            (
                "friction",
                TomlValue::Float(0.6),
                ExpectedValue::Coulomb,
                "write `friction = { coulomb = { coefficient = 0.6 } }`",
            ),
        ] {
            assert_eq!(said(key, &value, wanted), expected);
        }
        assert!(said("seed", &text("random"), ExpectedValue::Integer).contains("seed = 7"));
        assert_eq!(said("samples", &TomlValue::Float(8.5), ExpectedValue::Integer), "");
    }
}
