//! The tables of the report: effects, health, time, size.

use std::fmt::Write;

use crate::numbers::{HumanBytes, HumanCount};

use super::figures::{drawn, section};
use super::{fraction, total};
use crate::page::{self, escaped};
use crate::report::Dataset;
use crate::report::gather::{Gathered, Reasons};
use crate::report::quantities::About;
use gelsim_core::effects::Effect;
use gelsim_files::figures::{figure, percent};
use gelsim_job::config::output::Output;
use gelsim_job::layers::{Form, OutputLayer};

/// Reasons of an effect that are named.
const MOST_REASONS: usize = 3;

/// How often each effect ran, what it took, and why.
pub(super) fn effects(gathered: &Gathered) -> String {
    let row = |effect: Effect| {
        let reasons = &gathered.reasons[effect];
        let number = |wanted: bool| reasons.iter().filter(|((ran, _), _)| *ran == wanted).map(|(_, count)| count).sum();
        let (ran, skipped): (u64, u64) = (number(true), number(false));
        let seconds = gathered.totals.effects[effect].seconds;
        let mut ranked: Vec<(&str, u64)> = reasons.iter().map(|((_, why), count)| (why.as_str(), *count)).collect();
        ranked.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
        let why = |(why, count): &(&str, u64)| format!("{} ({})", escaped(why), HumanCount(*count));
        let mut why: Vec<String> = ranked.iter().take(MOST_REASONS).map(why).collect();
        if ranked.len() > MOST_REASONS {
            why.push(String::from("\u{2026}"));
        }
        let took = match (effect, ran) {
            (_, 0) => String::from("-"),
            // Computed in the same loop.
            (Effect::Darkening, _) => String::from("with shading"),
            _ => seconds_text(seconds),
        };
        let name = effect.name().replace('_', " ");
        let counts = [ran, skipped].map(|count| HumanCount(count).to_string());
        let [ran_text, skipped_text] = counts;
        let why = format!("<span class=\"text\">{}</span>", why.join("; "));
        vec![name, ran_text, skipped_text, fraction(ran, ran + skipped), took, why]
    };
    let head = ["effect", "ran", "skipped", "share", "CPU s", "<span class=\"text\">why, and why not</span>"];
    format!("<h2>Effects</h2>\n{}", page::table(&head, Effect::ALL.map(row)))
}

/// What is unsound, and how the contacts were solved.
pub(super) fn health(gathered: &Gathered) -> String {
    let samples = total(&gathered.samples);
    let of_samples = |count: u64| format!("{} ({})", HumanCount(count), fraction(count, samples));
    let [clipped, saturated, too_thick] = gathered.pixels;
    let rows = [
        ("healthy samples", of_samples(samples - gathered.unhealthy.total())),
        ("not healthy", of_samples(gathered.unhealthy.total())),
        ("contact not solved to the tolerance", of_samples(gathered.unconverged.total())),
        ("draws rejected and drawn again", HumanCount(gathered.rejected.total()).to_string()),
        ("pressed deeper than half the pad, beyond the theory", of_samples(gathered.beyond_theory)),
        ("with clipped pixels", of_samples(clipped)),
        ("with saturated pixels", of_samples(saturated)),
        ("with pixels limited to the pad's thickness", of_samples(too_thick)),
    ];
    let rows = rows.map(|(what, figure)| (what.to_owned(), figure));
    let kinds =
        [("not healthy", &gathered.unhealthy), ("not solved", &gathered.unconverged), ("rejected", &gathered.rejected)];
    let reasons: Vec<Vec<String>> = kinds.iter().flat_map(|(what, reasons)| reason_rows(what, reasons)).collect();
    let mut html = format!("<h2>Health and numerics</h2>\n{}", page::facts(&rows));
    if !reasons.is_empty() {
        let head = ["what", "<span class=\"text\">why</span>", "times", "<span class=\"text\">first keys</span>"];
        html += &page::table(&head, reasons);
    }
    html + &page::figures(&section(gathered, About::Solver))
}

fn reason_rows(what: &str, reasons: &Reasons) -> Vec<Vec<String>> {
    let text = |text: &str| format!("<span class=\"text\">{}</span>", escaped(text));
    let row = |(why, count, keys): (&str, u64, Vec<&str>)| {
        vec![what.to_owned(), text(why), HumanCount(count).to_string(), text(&keys.join(", "))]
    };
    reasons.ranked().into_iter().map(row).collect()
}

/// CPU time of each stage.
pub(super) fn time(gathered: &Gathered) -> String {
    let totals = &gathered.totals;
    let all: f64 = totals.seconds.stages().iter().map(|(_, seconds)| seconds).sum();
    let mut html = String::from("<h2>Time</h2>\n");
    if totals.samples == 0 || all <= 0.0 {
        return html + "<p>No shard's stats say how long it took.</p>\n";
    }
    let row = |(name, seconds): (&str, f64)| {
        let part = seconds / all;
        let bar = format!("<span class=\"share\" style=\"width: {:.0}px\"></span>", (120.0 * part).max(1.0));
        let each = 1e3 * seconds / totals.samples as f64;
        vec![
            name.to_owned(),
            seconds_text(seconds),
            figure(each),
            percent(part),
            format!("<span class=\"text\">{bar}</span>"),
        ]
    };
    let stages = totals.seconds.stages().into_iter().chain([("all", all)]);
    html += &page::table(&["stage", "CPU s", "ms a sample", "share", ""], stages.map(row));
    let _ = writeln!(
        html,
        "<p class=\"note\">{} samples per CPU second, from the stats of {} shards. What it took on the wall depends on the \
         number of cores.</p>",
        figure(totals.samples as f64 / all),
        HumanCount(totals.shards)
    );
    html
}

/// Bytes of files and shards.
pub(super) fn size(dataset: &Dataset) -> String {
    let (gathered, job) = (&dataset.gathered, &dataset.recorded.job);
    let [width, height] = job.sensor.resolution_px.map(u64::from);
    let row = |(suffix, (number, bytes)): (&String, &(u64, u64))| {
        let each = bytes / (*number).max(1);
        let unpacked = bytes_per_px(suffix, &job.output).map(|bytes| bytes * width * height);
        let ratio = unpacked.filter(|_| each > 0).map(|unpacked| figure(unpacked as f64 / each as f64));
        let none = || String::from("-");
        vec![
            escaped(suffix),
            HumanCount(*number).to_string(),
            HumanBytes(*bytes).to_string(),
            HumanBytes(each).to_string(),
            unpacked.map_or_else(none, |unpacked| HumanBytes(unpacked).to_string()),
            ratio.map_or_else(none, |ratio| format!("{ratio} : 1")),
        ]
    };
    let head = ["file", "number", "in all", "each", "unpacked", "compression"];
    let mut html = format!("<h2>Size</h2>\n{}", page::table(&head, gathered.files.iter().map(row)));
    if gathered.totals.shards > 0 {
        html += &page::figures(&drawn("Size of a shard", ["MiB", "shards"], "shards", &gathered.totals.shard_mib));
    }
    html
}

/// Bytes of a pixel in a file of a sample before it is packed, if it is an image whose kind is known.
fn bytes_per_px(suffix: &str, output: &Output) -> Option<u64> {
    let (layer, ending) = suffix.split_once('.')?;
    let form = match layer {
        "tactile" => Form::Rgb,
        layer => OutputLayer::named(layer)?.spec().form,
    };
    form.bytes_per_px(ending, output.exr.pixel).map(|bytes| bytes as u64)
}

fn seconds_text(seconds: f64) -> String {
    if seconds < 10.0 { format!("{seconds:.2}") } else { figure(seconds) }
}
