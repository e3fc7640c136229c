//! Random jobs: every test that draws a job, settings of one or mistakes in one draws them here.
//!
//! [`keys`] has the keys of a job, table by table, and for each of them the values of every [`Draw`]; `mistakes` has
//! numbers that no key should take, and edits of a text. Pictures are small. What a job names by path is relative to
//! the repository.
//!
//! A value may have holes: `<a..b>` is a number within, now and then an end itself; `<a..=b>` a whole number; `<~a..b>`
//! a quantity that stays within, constant or by any distribution; `<odd>` a width of 1 to 15 px; `<x|y>` one of these
//! texts. An empty value leaves the key out.

#![allow(dead_code)] // Each test executable draws some of it.

mod keys;
pub mod mistakes;

use std::path::PathBuf;
use std::sync::LazyLock;

use image::{Luma, Rgb};
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::{select, subsequence};
use proptest::strategy::Union;

use keys::{GELPADS, KEYS, LED, OBJECT, TABLES};

/// Which values of its keys a job has.
#[derive(Clone, Copy, Debug)]
pub enum Draw {
    /// Every effect there or not, weak or strong, the same in every sample or not; all presets that are flat, all kinds
    /// of pads.
    Effects,
    /// Numbers from their whole range, quantities as constants or distributions, one or several objects, every kind of
    /// dataset.
    Ranges,
    /// Ends of ranges.
    Ends,
}

/// A value with its holes filled.
fn filled(value: &'static str) -> BoxedStrategy<String> {
    let part = |(at, part)| if at % 2 == 0 { Just(String::from(part)).boxed() } else { hole(part) };
    let parts: Vec<_> = value.split(['<', '>']).enumerate().map(part).collect();
    parts.prop_map(|parts| parts.concat()).boxed()
}

fn hole(hole: &'static str) -> BoxedStrategy<String> {
    if hole == "odd" {
        return (0..8_u32).prop_map(|half| (2 * half + 1).to_string()).boxed();
    }
    if hole.contains('|') {
        return select(hole.split('|').collect::<Vec<_>>()).prop_map(str::to_owned).boxed();
    }
    if let Some((min, max)) = hole.split_once("..=") {
        let [min, max] = [min, max].map(|end| end.parse::<u64>().expect("a whole number"));
        return (min..=max).prop_map(|value| value.to_string()).boxed();
    }
    let (min, max) = hole.trim_start_matches('~').split_once("..").expect("a range");
    let [min, max] = [min, max].map(|end| end.parse::<f64>().expect("a number"));
    if hole.starts_with('~') { quantity(min, max) } else { number(min, max) }
}

/// A number as TOML.
fn number(min: f64, max: f64) -> BoxedStrategy<String> {
    let value = prop_oneof![4 => min..=max, 1 => Just(min), 1 => Just(max)];
    value.prop_map(|value| toml::Value::Float(value).to_string()).boxed()
}

/// A random quantity with all its values in a range.
fn quantity(min: f64, max: f64) -> BoxedStrategy<String> {
    let pair = (min..=max, min..=max).prop_map(|(a, b)| (a.min(b), a.max(b)));
    let positive = (min.max(1e-3)..=max, min.max(1e-3)..=max).prop_map(|(a, b)| (a.min(b), a.max(b)));
    prop_oneof![
        number(min, max),
        pair.clone().prop_map(|(a, b)| format!("[{a:?}, {b:?}]")),
        pair.clone().prop_map(|(a, b)| format!("{{ uniform = [{a:?}, {b:?}] }}")),
        positive.prop_map(|(a, b)| format!("{{ log_uniform = [{a:?}, {b:?}] }}")),
        // A mean inside the limits and a wide curve keep far more than 1 %.
        (pair, 0.0..=1.0_f64).prop_map(|((a, b), at)| {
            let (mean, std) = (a + (b - a) * at, b - a);
            format!("{{ normal = {{ mean = {mean:?}, std = {std:?}, min = {a:?}, max = {b:?} }} }}")
        }),
        vec(min..=max, 1..5).prop_map(|values| format!("{{ choice = {values:?} }}")),
    ]
    .boxed()
}

/// A table of a job, left out in so many of six jobs.
fn table(name: &'static str, left_out: u32, draw: Draw) -> BoxedStrategy<String> {
    let own = KEYS.iter().filter_map(|(path, values)| Some((path.strip_prefix(name)?.strip_prefix('.')?, values)));
    let own = own.filter(|(_, values)| !values[draw as usize].is_empty());
    let line = |(key, values): (&'static str, &[&'static [&'static str]; 3])| {
        let value = select(values[draw as usize]).prop_flat_map(filled);
        value.prop_map(move |value| if value.is_empty() { value } else { format!("{key} = {value}\n") })
    };
    let lines: Vec<_> = own.map(line).collect();
    let table = lines.prop_map(move |lines| format!("[{name}]\n{}", lines.concat()));
    // One that is never left out is not when a failing job is made simpler, either.
    if left_out == 0 {
        table.boxed()
    } else {
        prop_oneof![left_out => Just(String::new()), 6 - left_out => table].boxed()
    }
}

/// A list of tables that are written as one value.
fn list(table: &'static str, count: std::ops::Range<usize>) -> impl Strategy<Value = String> {
    vec(filled(table), count).prop_map(|tables| tables.join(", "))
}

/// The text in which `key = value` stands in place of the line of that key, if there is one.
fn with_line(text: &str, key: &str, value: &str) -> String {
    let is_its = |line: &str| line.strip_prefix(key).is_some_and(|rest| rest.starts_with(" = "));
    text.lines().map(|line| if is_its(line) { format!("{key} = {value}\n") } else { format!("{line}\n") }).collect()
}

/// A job that is valid, not at the ends of ranges.
pub fn job(draw: Draw) -> impl Strategy<Value = String> {
    let several = matches!(draw, Draw::Ranges);
    let tables: Vec<_> = TABLES.iter().map(|(name, left_out)| table(name, *left_out, draw)).collect();
    let leds = list(LED[draw as usize], 1..4).prop_map(|leds| format!("led = [{leds}]\n"));
    let leds = prop_oneof![1 => Just(String::new()), 1 => leds];
    let objects = (list(OBJECT[draw as usize], if several { 1..3 } else { 1..2 }), 1..=if several { 4_u32 } else { 1 });
    let layers = subsequence(vec!["depth", "surface", "contact", "normal", "reference", "instance"], 0..=6);
    let gelpad = Union::new_weighted(GELPADS.iter().map(|(weight, pad)| (*weight, filled(pad))).collect());
    (gelpad, objects, tables, leds, select(&["phong", "led"]), layers).prop_map(
        |(gelpad, (objects, most), mut tables, leds, model, mut layers)| {
            let lamps = tables[0].contains("gelsight-series2") && leds.is_empty();
            tables[0] += &leds;
            // Lamps have no parameters; LEDs are there for Phong's equation only where the job adds them.
            tables.retain(|table| !lamps || !table.starts_with("[optics"));
            if !["paper", "none", "mean_blur", "gaussian"].iter().any(|model| gelpad.contains(model)) {
                layers.push("pressure");
            }
            let change = |tables: &mut [String], table: &str, key: &str, value: &str| {
                let own = tables.iter_mut().filter(|text| text.starts_with(table));
                own.for_each(|text| *text = with_line(text, key, value));
            };
            change(&mut tables, "[output]", "layers", &format!("{layers:?}"));
            // Several objects at one place are refused.
            if most > 1 {
                change(&mut tables, "[pose]", "y_mm", "[-8.0, 9.0]");
            }
            // What holds an object while it is pressed in holds it when it is moved.
            if let Some((_, friction)) = gelpad.split_once("friction = ") {
                let friction = friction.strip_suffix(" }").expect("the last key of its table");
                change(&mut tables, "[shear]", "friction", friction);
            }
            let tables = tables.concat().replace("MODEL", model);
            with_files(format!("{gelpad}\nobject = [{objects}]\nscene.objects_per_sample = [1, {most}]\n{tables}"))
        },
    )
}

/// Settings of a job at the ends of ranges, each in a quarter of all; LEDs in a half. `unit` gives numbers from 0 to 1.
pub fn extremes(unit: &mut impl FnMut() -> f64) -> Vec<String> {
    fn pick<'a>(unit: &mut impl FnMut() -> f64, values: &[&'a str]) -> &'a str {
        values[(unit() * values.len() as f64) as usize]
    }
    let mut settings = Vec::new();
    for (key, values) in KEYS {
        let ends = values[Draw::Ends as usize];
        if !ends.is_empty() && unit() < 0.25 {
            settings.push(format!("{key} = {}", pick(unit, ends)));
        }
    }
    if unit() < 0.5 {
        let count = 1 + (unit() * 3.0) as usize;
        let mut part = |(at, part): (usize, &'static str)| match at % 2 {
            0 => part,
            _ => pick(unit, &part.split('|').collect::<Vec<_>>()),
        };
        let mut led = |_| LED[Draw::Ends as usize].split(['<', '>']).enumerate().map(&mut part).collect::<String>();
        let leds: Vec<String> = (0..count).map(&mut led).collect();
        settings.push(format!("sensor.led = [{}]", leds.join(", ")));
    }
    settings
}

/// Keys that take a number or a quantity, under Phong's light.
pub fn keys_of_numbers() -> impl Iterator<Item = String> {
    let takes_one =
        |value: &&str| value.starts_with('<') && value.contains("..") && value.find('>') == Some(value.len() - 1);
    let numbers = KEYS.iter().filter(move |(_, values)| values[Draw::Ranges as usize].iter().any(takes_one));
    numbers.map(|(key, _)| key.replace("MODEL", "phong"))
}

/// Files that a job may name, made once: a photograph of an untouched pad, an image of heights.
static FILES: LazyLock<[PathBuf; 2]> = LazyLock::new(|| {
    let file = |name: &str| PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
    let (photograph, heights) = (file("random_jobs_photograph.png"), file("random_jobs_heights.png"));
    let color = |x: u32, y: u32| Rgb([90 + 2 * x as u8, 80 + 3 * y as u8, 120 + (x * y % 7) as u8]);
    image::RgbImage::from_fn(36, 27, color).save(&photograph).expect("a folder that can be written");
    let height =
        |x: u32, y: u32| Luma([(128.0 + 60.0 * (f64::from(x) / 5.0).sin() + 60.0 * (f64::from(y) / 4.0).cos()) as u8]);
    image::GrayImage::from_fn(32, 24, height).save(&heights).expect("a folder that can be written");
    [photograph, heights]
});

/// The job with the paths of files for their names.
pub fn with_files(job: String) -> String {
    let put = |job: String, (at, name): (usize, &str)| match job.contains(name) {
        true => job.replace(name, &FILES[at].to_string_lossy()),
        false => job,
    };
    ["PHOTOGRAPH", "HEIGHTS"].into_iter().enumerate().fold(job, put)
}
