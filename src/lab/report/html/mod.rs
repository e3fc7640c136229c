//! The report as an HTML page.

mod figures;
mod sequences;
mod tables;

use std::collections::BTreeSet;

use maud::{Markup, html};
use rayon::prelude::*;

use crate::numbers::{HumanBytes, HumanCount};

use super::gather::{DatasetStats, SampleTile};
use super::histogram::PerSplit;
use super::{DatasetReport, MissingShards};
use crate::page;
use crate::page::canvas::Colour;
use crate::preview::panel::Scales;
use gelsim_dataset::folder::is_unmodified;
use gelsim_dataset::verify::{DatasetFinding, Remedy, list_remedy_commands};
use gelsim_files::number_format::{format_count, format_number, format_percent};
use gelsim_files::png::{encode_rgb, encode_small};
use gelsim_files::spelling::quote_for_shell;
use gelsim_job::layers::OutputLayer;
use gelsim_job::layout::Split;

/// Most findings and ranges of missing shards that are listed; the rest are counted.
const MAX_LISTED: usize = 40;
/// Most rows of a table of classes or objects; the rest are counted.
const MAX_ROWS: usize = 200;

/// Width of a picture on the contact sheet, px.
const PANEL: u32 = 108;
/// Most bytes of the large images of all samples on the contact sheet; above it they are scaled down.
const MAX_LARGE_BYTES: usize = 8 << 20;

/// Names and colours of the splits.
const SPLITS: [(&str, Colour); Split::ALL.len()] =
    [("train", [0, 114, 178]), ("val", [230, 159, 0]), ("test", [0, 158, 115])];

/// Renders the complete page.
pub(super) fn render_page(dataset: &DatasetReport) -> String {
    let gathered = &dataset.gathered;
    let body = html! {
        (page::render_warnings(&list_warnings(dataset)))
        (render_summary_cards(gathered))
        (render_description(dataset))
        (render_counts(gathered))
        (render_contact_sheet(gathered))
        (sequences::render_sequences(gathered))
        (figures::render_distributions(gathered))
        (tables::render_effects(gathered))
        (tables::render_health(gathered))
        (tables::render_time(gathered))
        (tables::render_size(dataset))
        h2 { "Configuration" }
        details { summary { "job.toml, every default written out" } pre { (dataset.job_text) } }
        p.note { "Made by gelsim " (env!("CARGO_PKG_VERSION")) "." }
    };
    page::render_document(&format!("Dataset {}", dataset_name(dataset)), &body)
}

fn dataset_name(dataset: &DatasetReport) -> &str {
    dataset.recorded.name()
}

/// Lists what is wrong or missing, and what to do about it.
pub(super) fn list_warnings(dataset: &DatasetReport) -> Vec<String> {
    let DatasetReport { gathered, missing, manifest, recorded, .. } = dataset;
    let mut texts = Vec::new();
    let mut fixable: Vec<DatasetFinding> = Vec::new();
    if !missing.is_empty() {
        let range = |MissingShards { first, last }: &MissingShards| {
            if first == last { first.name() } else { format!("{} to {}", first.name(), last.name()) }
        };
        let count: u64 = missing.iter().map(|MissingShards { first, last }| last.number - first.number + 1).sum();
        let mut ranges: Vec<String> = missing.iter().take(MAX_LISTED).map(range).collect();
        if missing.len() > MAX_LISTED {
            ranges.push(String::from("and others"));
        }
        let (count, all) = (HumanCount(count), HumanCount(recorded.layout.shard_count()));
        texts
            .push(format!("the dataset is not complete: {count} of {all} shards are not there: {}", ranges.join(", ")));
        fixable.push(DatasetFinding::new("data", "is not complete"));
    } else if manifest.is_none() {
        let file = DatasetFinding::new("dataset.json", "is missing or incomplete").with_remedy(Remedy::Finalize);
        texts.push(file.to_string());
        fixable.push(file);
    }
    let jobs = job_fingerprints(dataset).len();
    if jobs > 1 {
        texts.push(format!("shards and dataset.json are of {jobs} different jobs, by their fingerprints"));
    }
    let is_edited = !is_unmodified(&dataset.job_text);
    if is_edited {
        texts.push(DatasetFinding::new("job.toml", "is not what was written").to_string());
    }
    texts.extend(group_findings(&gathered.findings));
    if jobs > 1 || is_edited || !gathered.findings.is_empty() {
        texts.push(format!(
            "gelsim verify {} names all that is wrong, and how to fix it",
            quote_for_shell(&recorded.root)
        ));
    } else if !fixable.is_empty() {
        texts.push(format!("fix it with {}", list_remedy_commands(&recorded.root, &fixable).join(" && ")));
    }
    texts
}

/// Formats findings: a cause that many files share appears once, with the first of them.
fn group_findings(findings: &[DatasetFinding]) -> Vec<String> {
    const FEW: usize = 3;
    let mut causes: Vec<(&str, Vec<&str>)> = Vec::new();
    for DatasetFinding { file, what, .. } in findings {
        match causes.iter_mut().find(|(cause, _)| cause == what) {
            Some((_, files)) => files.push(file),
            None => causes.push((what, vec![file])),
        }
    }
    let mut texts: Vec<String> = Vec::new();
    for (cause, files) in &causes {
        match files.len() {
            count if count > FEW => {
                texts.push(format!(
                    "{} and {} more: each {cause}",
                    files[..FEW].join(", "),
                    HumanCount((count - FEW) as u64)
                ));
            }
            _ => texts.extend(files.iter().map(|file| format!("{file}: {cause}"))),
        }
    }
    if texts.len() > MAX_LISTED {
        let more = texts.split_off(MAX_LISTED).len();
        texts.push(format!("and {more} more"));
    }
    texts
}

/// Fingerprints of the jobs of shards and manifest; a single one if all is well.
fn job_fingerprints(dataset: &DatasetReport) -> BTreeSet<String> {
    let of_manifest = dataset.manifest.iter().map(|manifest| manifest.fingerprint.clone());
    dataset.gathered.totals.fingerprints.iter().cloned().chain(of_manifest).collect()
}

/// Renders the main figures.
fn render_summary_cards(gathered: &DatasetStats) -> Markup {
    let samples = total_count(&gathered.samples);
    let totals = &gathered.totals;
    let seconds = totals.seconds.simulation() + totals.seconds.encode;
    let unhealthy = gathered.unhealthy.total();
    let rate = if seconds > 0.0 { format_number(totals.samples as f64 / seconds) } else { String::from("-") };
    page::render_cards(&[
        (HumanCount(samples).to_string(), "samples"),
        (format_share(total_count(&gathered.in_contact), samples), "in contact"),
        (HumanCount(gathered.classes.len() as u64).to_string(), "classes"),
        (HumanCount(gathered.objects.len() as u64).to_string(), "objects"),
        (HumanBytes(totals.bytes).to_string(), "in shards"),
        (rate, "samples per CPU second"),
        (HumanCount(unhealthy).to_string(), "not healthy"),
    ])
}

/// Renders the description of the dataset: samples, sensor, models, layers, seed.
fn render_description(dataset: &DatasetReport) -> Markup {
    let DatasetReport { gathered, manifest, recorded, .. } = dataset;
    let (sensor, job) = (&recorded.job.sensor, &recorded.job.dataset);
    let ([width, height], view) = (sensor.resolution_px, sensor.field_of_view_mm.map(format_number).join(" x "));
    let models = |k: usize| gathered.models.iter().map(|names| names[k].as_str()).collect::<Vec<_>>().join(", ");
    let joined = |texts: &BTreeSet<String>| texts.iter().cloned().collect::<Vec<_>>().join(", ");
    let splits = Split::ALL.map(|split| (split.name(), recorded.layout.samples_in(split)));
    let splits = splits.iter().filter(|(_, samples)| *samples > 0);
    let splits: Vec<String> = splits.map(|(name, samples)| format!("{name} {}", HumanCount(*samples))).collect();
    let mut generators = gathered.totals.generators.clone();
    generators.extend(manifest.iter().map(|manifest| manifest.generator.version.clone()));
    let output = &recorded.job.output;
    let layers: Vec<String> =
        output.layers_in_order().iter().map(|layer| layer.file_suffix(output.depth_format)).collect();
    let by = job.split_by.name();
    let (youngs, poisson) =
        (format_number(sensor.gelpad_youngs_modulus_kpa), format_number(sensor.gelpad_poisson_ratio));
    let rows = [
        ("samples", format!("{}, split by {by}: {}", HumanCount(recorded.layout.sample_count()), splits.join(", "))),
        (
            "shards",
            format!("{} of up to {}", HumanCount(recorded.layout.shard_count()), HumanCount(job.samples_per_shard)),
        ),
        ("sensor", format!("{}, {width} x {height} px, {view} mm", sensor.name)),
        (
            "pad",
            format!(
                "{} mm, Young's modulus {youngs} kPa, Poisson ratio {poisson}",
                format_number(sensor.gelpad_thickness_mm)
            ),
        ),
        ("fidelity", models(0)),
        ("model of the pad", models(1)),
        ("model of the light", models(2)),
        ("layers", layers.join(", ")),
        ("seed", job.seed.to_string()),
        ("generator", format!("gelsim {}", joined(&generators))),
        ("fingerprint", joined(&job_fingerprints(dataset))),
    ];
    let rows = rows.map(|(what, figure)| (what, if figure.is_empty() { String::from("-") } else { figure }));
    page::render_facts(&rows)
}

/// Renders the numbers of samples by class and object.
fn render_counts(gathered: &DatasetStats) -> Markup {
    let all = total_count(&gathered.samples);
    let cells = |name: Markup, counts: &PerSplit| -> Vec<Markup> {
        let sum = total_count(counts);
        let numbers = counts.iter().chain([&sum]).map(|count| html! { (HumanCount(*count)) });
        [name].into_iter().chain(numbers).chain([html! { (format_share(sum, all)) }]).collect()
    };
    let named = gathered.classes.iter().take(MAX_ROWS);
    let mut classes: Vec<_> = named.map(|(name, counts)| cells(html! { (name) }, counts)).collect();
    classes.push(cells(html! { b { "all classes" } }, &gathered.samples));
    classes.push(cells(html! { "in contact" }, &gathered.in_contact));
    let named = gathered.objects.iter().take(MAX_ROWS);
    let objects = named.map(|(id, (class, counts))| cells(html! { (id) " (" (class) ")" }, counts));
    html! {
        h2 { "Counts" }
        (render_count_table("class", classes, gathered.classes.len()))
        @if gathered.objects.iter().any(|(id, (class, _))| id != class) {
            details {
                summary { (format_count(gathered.objects.len(), "object", "objects")) }
                (render_count_table("object (class)", objects.collect(), gathered.objects.len()))
            }
        }
    }
}

/// Renders a table of counts, with a note if rows are left out.
fn render_count_table(what: &str, rows: Vec<Vec<Markup>>, all: usize) -> Markup {
    let [what, all_splits, share] = [what, "all", "share"].map(|name| html! { (name) });
    html! {
        (page::render_table([what].into_iter().chain(SPLITS.map(page::render_legend_entry)).chain([all_splits, share]), rows))
        @if all > MAX_ROWS { p.note { "The first " (MAX_ROWS) " of " (all) ", by name." } }
    }
}

/// Renders some samples of each split.
fn render_contact_sheet(gathered: &DatasetStats) -> Markup {
    let tiles = &gathered.tiles;
    if tiles.is_empty() {
        return Markup::default();
    }
    let scales = Scales::from_panels(tiles.iter().flat_map(|picture| picture.tile.panels()));
    let sample = |(SampleTile { index, split, tile }, (png, size)): (&SampleTile, (Vec<u8>, _))| {
        let (caption, strip, times) = (tile.caption(), tile.to_strip(&scales, PANEL), tile.frame_times());
        let small = page::render_image(&encode_small(&strip), strip.dimensions(), &caption);
        let image = page::render_lightbox(&format!("sample-{index}"), small, page::render_image(&png, size, &caption));
        let below = html! { (render_split_key(*split)) " " (caption) @if !times.is_empty() { br; (times) } };
        page::render_figure(image, below)
    };
    html! {
        h2 { "Samples" }
        p.note { (describe_pictures(gathered, &scales)) }
        (page::render_figures(html! { @for pair in tiles.iter().zip(encode_large_images(tiles)) { (sample(pair)) } }))
    }
}

/// Describes what the pictures of the samples show, in sentences.
fn describe_pictures(gathered: &DatasetStats, scales: &Scales) -> String {
    let has = |layer: OutputLayer| gathered.tiles.iter().any(|picture| picture.tile.has_layer(layer));
    let fingers = if gathered.tiles.iter().any(|picture| picture.tile.has_fingers()) {
        "; above the left finger, below the right one"
    } else {
        ""
    };
    if gathered.sequences.frames > 0 {
        return format!(
            "Some frames of each sequence from first to last, with their times below{fingers}. A click shows them large, another one \
             closes them."
        );
    }
    let mut views = vec![String::from("tactile image")];
    if has(OutputLayer::Depth) {
        let scale = scales.end_labels(OutputLayer::Depth);
        let scale = scale.map_or(String::new(), |(low, high)| format!(" (black at {low}, white at {high})"));
        views.push(format!("depth{scale}"));
    }
    if has(OutputLayer::Contact) {
        views.push(String::from("contact (white)"));
    }
    let views = views.join(", ");
    format!("From left to right: {views}{fingers}. A click shows the tactile image large, another one closes it.")
}

/// Encodes the tactile images of all samples as PNG files, with their sizes. They are scaled down if the page would
/// become too large.
fn encode_large_images(tiles: &[SampleTile]) -> Vec<(Vec<u8>, (u32, u32))> {
    let mut panel_width = u32::MAX;
    loop {
        let encode = |SampleTile { tile, .. }: &SampleTile| {
            let image = tile.to_tactile_strip(panel_width);
            let (width, height) = image.dimensions();
            (encode_rgb(width as usize, height as usize, &image), (width, height))
        };
        let encoded: Vec<_> = tiles.par_iter().map(encode).collect();
        let bytes: usize = encoded.iter().map(|(png, _)| png.len()).sum();
        if bytes <= MAX_LARGE_BYTES || panel_width <= PANEL {
            return encoded;
        }
        let widest = encoded.iter().map(|(_, (width, _))| *width).max().unwrap_or(1);
        panel_width = (panel_width.min(widest) / 2).max(PANEL);
    }
}

/// Renders the name of a split with a square of its colour.
fn render_split_key(split: Split) -> Markup {
    page::render_legend_entry(SPLITS[split.number()])
}

fn total_count(counts: &PerSplit) -> u64 {
    counts.iter().sum()
}

/// Formats a part of a total in percent; `-` if the total is 0.
fn format_share(part: u64, total: u64) -> String {
    if total > 0 { format_percent(part as f64 / total as f64) } else { String::from("-") }
}
