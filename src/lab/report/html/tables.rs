//! Tables in the report: effects, health, time, size.

use maud::{Markup, html};

use crate::numbers::{HumanBytes, HumanCount};

use super::figures::{render_histogram, render_quantities};
use super::{format_share, total_count};
use crate::page;
use crate::report::DatasetReport;
use crate::report::gather::{DatasetStats, Reasons};
use crate::report::quantities::QuantityTopic;
use gelsim_core::effects::Effect;
use gelsim_files::number_format::{format_number, format_percent};
use gelsim_job::config::output::Output;
use gelsim_job::layers::{LayerForm, OutputLayer};

/// Most reasons of an effect that are named.
const MAX_REASONS: usize = 3;

/// Renders how often each effect ran, its CPU time, and the reasons.
pub(super) fn render_effects(gathered: &DatasetStats) -> Markup {
    let row = |effect: Effect| {
        let reasons = &gathered.reasons[effect];
        let number = |wanted: bool| reasons.iter().filter(|((ran, _), _)| *ran == wanted).map(|(_, count)| count).sum();
        let (ran, skipped): (u64, u64) = (number(true), number(false));
        let seconds = gathered.totals.effects[effect].seconds;
        let mut ranked: Vec<(&str, u64)> = reasons.iter().map(|((_, why), count)| (why.as_str(), *count)).collect();
        ranked.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
        let why = |(why, count): &(&str, u64)| format!("{why} ({})", HumanCount(*count));
        let mut why: Vec<String> = ranked.iter().take(MAX_REASONS).map(why).collect();
        if ranked.len() > MAX_REASONS {
            why.push(String::from("\u{2026}"));
        }
        let took = match (effect, ran) {
            (_, 0) => String::from("-"),
            // Darkening is part of the loop of shading, so it has no time of its own.
            (Effect::Darkening, _) => String::from("with shading"),
            _ => format_seconds(seconds),
        };
        vec![
            html! { (effect.name().replace('_', " ")) },
            html! { (HumanCount(ran)) },
            html! { (HumanCount(skipped)) },
            html! { (format_share(ran, ran + skipped)) },
            html! { (took) },
            page::render_text_cell(why.join("; ")),
        ]
    };
    let [ran, skipped, share, seconds] = ["ran", "skipped", "share", "CPU s"].map(|name| html! { (name) });
    let head = [html! { "effect" }, ran, skipped, share, seconds, page::render_text_cell("why, and why not")];
    html! { h2 { "Effects" } (page::render_table(head, Effect::ALL.map(row))) }
}

/// Renders health, and how the contacts were solved.
pub(super) fn render_health(gathered: &DatasetStats) -> Markup {
    let samples = total_count(&gathered.samples);
    let of_samples = |count: u64| format!("{} ({})", HumanCount(count), format_share(count, samples));
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
    let reasons: Vec<Vec<Markup>> =
        kinds.iter().flat_map(|(what, reasons)| render_reason_rows(what, reasons)).collect();
    let head =
        [html! { "what" }, page::render_text_cell("why"), html! { "times" }, page::render_text_cell("first keys")];
    html! {
        h2 { "Health and numerics" }
        (page::render_facts(&rows))
        @if !reasons.is_empty() { (page::render_table(head, reasons)) }
        (page::render_figures(render_quantities(gathered, QuantityTopic::Solver)))
    }
}

fn render_reason_rows(what: &str, reasons: &Reasons) -> Vec<Vec<Markup>> {
    let row = |(why, count, keys): (&str, u64, Vec<&str>)| {
        vec![
            html! { (what) },
            page::render_text_cell(why),
            html! { (HumanCount(count)) },
            page::render_text_cell(keys.join(", ")),
        ]
    };
    reasons.ranked_reasons().into_iter().map(row).collect()
}

/// Renders the CPU time of each stage.
pub(super) fn render_time(gathered: &DatasetStats) -> Markup {
    let totals = &gathered.totals;
    let all: f64 = totals.seconds.stages().iter().map(|(_, seconds)| seconds).sum();
    if totals.samples == 0 || all <= 0.0 {
        return html! { h2 { "Time" } p { "No shard's stats say how long it took." } };
    }
    let row = |(name, seconds): (&str, f64)| {
        let part = seconds / all;
        let bar = html! { span.share style={ "width: " (format!("{:.0}", (120.0 * part).max(1.0))) "px" } {} };
        let each = 1e3 * seconds / totals.samples as f64;
        let texts = [name.to_owned(), format_seconds(seconds), format_number(each), format_percent(part)];
        texts.iter().map(|text| html! { (text) }).chain([page::render_text_cell(bar)]).collect()
    };
    let stages = totals.seconds.stages().into_iter().chain([("all", all)]);
    html! {
        h2 { "Time" }
        (page::render_table(["stage", "CPU s", "ms a sample", "share", ""], stages.map(row)))
        p.note {
            (format_number(totals.samples as f64 / all)) " samples per CPU second, from the stats of " (HumanCount(totals.shards))
            " shards. What it took on the wall depends on the number of cores."
        }
    }
}

/// Renders the sizes of files and shards.
pub(super) fn render_size(dataset: &DatasetReport) -> Markup {
    let (gathered, job) = (&dataset.gathered, &dataset.recorded.job);
    let [width, height] = job.sensor.resolution_px.map(u64::from);
    let row = |(suffix, (number, bytes)): (&String, &(u64, u64))| {
        let each = bytes / (*number).max(1);
        let unpacked = bytes_per_px(suffix, &job.output).map(|bytes| bytes * width * height);
        let ratio = unpacked.filter(|_| each > 0).map(|unpacked| format_number(unpacked as f64 / each as f64));
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
    let shards = || render_histogram("Size of a shard", ["MiB", "shards"], "shards", &gathered.totals.shard_mib);
    html! {
        h2 { "Size" }
        (page::render_table(head, gathered.files.iter().map(row)))
        @if gathered.totals.shards > 0 { (page::render_figures(shards())) }
    }
}

/// Bytes per pixel of a sample's file before compression; `None` unless it is an image of a known kind.
fn bytes_per_px(suffix: &str, output: &Output) -> Option<u64> {
    let (layer, ending) = suffix.split_once('.')?;
    let form = match layer {
        "tactile" => LayerForm::Rgb,
        layer => OutputLayer::from_name(layer)?.spec().form,
    };
    form.bytes_per_px(ending, output.exr.pixel).map(|bytes| bytes as u64)
}

fn format_seconds(seconds: f64) -> String {
    if seconds < 10.0 { format!("{seconds:.2}") } else { format_number(seconds) }
}
