//! What no key of a job should take, and small changes of a text.

use proptest::prelude::*;
use proptest::sample::select;

/// A number or something else that is taken or refused, near and far from what keys take.
pub fn nasty_number() -> impl Strategy<Value = String> {
    let words = "nan|inf|-inf|0|-0.0|1|-1|2|0.5|1e-320|1e308|-1e308|1.7976931348623157e308|9007199254740991|\
                 9007199254740993|9223372036854775807|-9223372036854775808|18446744073709551616|4294967295|\
                 4294967296|1000000000|1000001|256|255|65|1e-3|9e-4|90.00001|1_000|0x10|[1, 2]|[nan, inf]|{ normal = { mean = 1e308, std = 1e308 } }|\
                 { choice = [-inf] }|true";
    prop_oneof![
        3 => select(words.split('|').collect::<Vec<_>>()).prop_map(str::to_owned),
        1 => any::<f64>().prop_map(|value| toml::Value::Float(value).to_string()),
        1 => any::<i64>().prop_map(|value| value.to_string()),
    ]
}

/// One small change of a text.
#[derive(Clone, Debug)]
pub enum Edit {
    Remove { at: f64, length: usize },
    Insert { at: f64, text: String },
    Repeat { at: f64, length: usize, to: f64 },
}

pub fn edit() -> impl Strategy<Value = Edit> {
    let at = || 0.0..1.0_f64;
    let bits = "[|]|[[|]]|{|}|=|\"|'|\n|\r\n|#|,|.|-|+|e|\\|\\u0000|\0|é|\u{1F600}|\t|nan|true|a|_|\"\"\"|1979-05-27|\
                **|../|7";
    let bit = select(bits.split('|').collect::<Vec<_>>());
    let inserted = proptest::collection::vec(bit, 1..3).prop_map(|bits| bits.concat());
    prop_oneof![
        (at(), 1..30_usize).prop_map(|(at, length)| Edit::Remove { at, length }),
        (at(), inserted).prop_map(|(at, text)| Edit::Insert { at, text }),
        (at(), 1..60_usize, at()).prop_map(|(at, length, to)| Edit::Repeat { at, length, to }),
    ]
}

/// The text after an edit.
pub fn edited(text: &str, edit: &Edit) -> String {
    let mut chars: Vec<char> = text.chars().collect();
    let place = |at: f64, count: usize| ((at * count as f64) as usize).min(count);
    let count = chars.len();
    match edit {
        Edit::Remove { at, length } => {
            let at = place(*at, count);
            chars.drain(at..(at + length).min(count));
        }
        Edit::Insert { at, text } => {
            let at = place(*at, count);
            chars.splice(at..at, text.chars());
        }
        Edit::Repeat { at, length, to } => {
            let at = place(*at, count);
            let copy: Vec<char> = chars[at..(at + length).min(count)].to_vec();
            let to = place(*to, count);
            chars.splice(to..to, copy);
        }
    }
    chars.into_iter().collect()
}
