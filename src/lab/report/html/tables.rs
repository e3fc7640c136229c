//! The tables of the report: effects, health, time, size.

use maud::{Markup, html};

use crate::numbers::{HumanBytes, HumanCount};

use super::figures::{drawn, section};
use super::{fraction, total};
use crate::page;
use crate::report::Dataset;
use crate::report::gather::{DatasetStats, Reasons};
use crate::report::quantities::About;
use gelsim_core::effects::Effect;
use gelsim_files::figures::{figure, percent};
use gelsim_job::config::output::Output;
use gelsim_job::layers::{Form, OutputLayer};

/// Reasons of an effect that are named.
const MOST_REASONS: usize = 3;

/// How often each effect ran, what it took, and why.
pub(super) fn effects(gathered: &DatasetStats) -> Markup {
    let row = |effect: Effect| {
        let reasons = &gathered.reasons[effect];
        let number = |wanted: bool| reasons.iter().filter(|((ran, _), _)| *ran == wanted).map(|(_, count)| count).sum();
        let (ran, skipped): (u64, u64) = (number(true), number(false));
        let seconds = gathered.totals.effects[effect].seconds;
        let mut ranked: Vec<(&str, u64)> = reasons.iter().map(|((_, why), count)| (why.as_str(), *count)).collect();
        ranked.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
        let why = |(why, count): &(&str, u64)| format!("{why} ({})", HumanCount(*count));
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
        vec![
            html! { (effect.name().replace('_', " ")) },
            html! { (HumanCount(ran)) },
            html! { (HumanCount(skipped)) },
            html! { (fraction(ran, ran + skipped)) },
            html! { (took) },
            page::words(why.join("; ")),
        ]
    };
    let [ran, skipped, share, seconds] = ["ran", "skipped", "share", "CPU s"].map(|name| html! { (name) });
    let head = [html! { "effect" }, ran, skipped, share, seconds, page::words("why, and why not")];
    html! { h2 { "Effects" } (page::table(head, Effect::ALL.map(row))) }
}

/// What is unsound, and how the contacts were solved.
pub(super) fn health(gathered: &DatasetStats) -> Markup {
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
    let kinds =
        [("not healthy", &gathered.unhealthy), ("not solved", &gathered.unconverged), ("rejected", &gathered.rejected)];
    let reasons: Vec<Vec<Markup>> = kinds.iter().flat_map(|(what, reasons)| reason_rows(what, reasons)).collect();
    let head = [html! { "what" }, page::words("why"), html! { "times" }, page::words("first keys")];
    html! {
        h2 { "Health and numerics" }
        (page::facts(&rows))
        @if !reasons.is_empty() { (page::table(head, reasons)) }
        (page::figures(section(gathered, About::Solver)))
    }
}

fn reason_rows(what: &str, reasons: &Reasons) -> Vec<Vec<Markup>> {
    let row = |(why, count, keys): (&str, u64, Vec<&str>)| {
        vec![html! { (what) }, page::words(why), html! { (HumanCount(count)) }, page::words(keys.join(", "))]
    };
    reasons.ranked().into_iter().map(row).collect()
}

/// CPU time of each stage.
pub(super) fn time(gathered: &DatasetStats) -> Markup {
    let totals = &gathered.totals;
    let all: f64 = totals.seconds.stages().iter().map(|(_, seconds)| seconds).sum();
    if totals.samples == 0 || all <= 0.0 {
        return html! { h2 { "Time" } p { "No shard's stats say how long it took." } };
    }
    let row = |(name, seconds): (&str, f64)| {
        let part = seconds / all;
        let bar = html! { span.share style={ "width: " (format!("{:.0}", (120.0 * part).max(1.0))) "px" } {} };
        let each = 1e3 * seconds / totals.samples as f64;
        let texts = [name.to_owned(), seconds_text(seconds), figure(each), percent(part)];
        texts.iter().map(|text| html! { (text) }).chain([page::words(bar)]).collect()
    };
    let stages = totals.seconds.stages().into_iter().chain([("all", all)]);
    html! {
        h2 { "Time" }
        (page::table(["stage", "CPU s", "ms a sample", "share", ""], stages.map(row)))
        p.note {
            (figure(totals.samples as f64 / all)) " samples per CPU second, from the stats of " (HumanCount(totals.shards))
            " shards. What it took on the wall depends on the number of cores."
        }
    }
}

/// Bytes of files and shards.
pub(super) fn size(dataset: &Dataset) -> Markup {
    let (gathered, job) = (&dataset.gathered, &dataset.recorded.job);
    let [width, height] = job.sensor.resolution_px.map(u64::from);
    let row = |(suffix, (number, bytes)): (&String, &(u64, u64))| {
        let each = bytes / (*number).max(1);
        let unpacked = bytes_per_px(suffix, &job.output).map(|bytes| bytes * width * height);
        let ratio = unpacked.filter(|_| each > 0).map(|unpacked| figure(unpacked as f64 / each as f64));
        let none = || String::from("-");
        vec![
            suffix.clone(),
            HumanCount(*number).to_string(),
            HumanBytes(*bytes).to_string(),
            HumanBytes(each).to_string(),
            unpacked.map_or_else(none, |unpacked| HumanBytes(unpacked).to_string()),
            ratio.map_or_else(none, |ratio| format!("{ratio} : 1")),
        ]
    };
    let head = ["file", "number", "in all", "each", "unpacked", "compression"];
    let shards = || drawn("Size of a shard", ["MiB", "shards"], "shards", &gathered.totals.shard_mib);
    html! {
        h2 { "Size" }
        (page::table(head, gathered.files.iter().map(row)))
        @if gathered.totals.shards > 0 { (page::figures(shards())) }
    }
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
