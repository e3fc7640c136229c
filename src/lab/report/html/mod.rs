//! The report as an HTML page, section by section.

mod figures;
mod sequences;
mod tables;

use std::collections::BTreeSet;

use maud::{Markup, html};
use rayon::prelude::*;

use crate::numbers::{HumanBytes, HumanCount};

use super::gather::{DatasetStats, Picture};
use super::histogram::PerSplit;
use super::{Dataset, MissingShards};
use crate::page;
use crate::page::canvas::Colour;
use crate::preview::panel::Scales;
use gelsim_dataset::verify::{Cure, Finding, cures};
use gelsim_files::figures::{counted, figure, percent};
use gelsim_files::png::{encode_rgb, encode_small};
use gelsim_files::spelling::shell_word;
use gelsim_job::layers::OutputLayer;
use gelsim_job::layout::Split;

/// Findings and ranges of missing shards that are listed; the rest are counted.
const MOST_LISTED: usize = 40;
/// Rows of a table of classes or objects; the rest are counted.
const MOST_ROWS: usize = 200;

/// Width of a panel of the contact sheet, px.
const PANEL: u32 = 108;
/// Bytes of the large images of all samples on the contact sheet: with more they are shown smaller.
const MOST_LARGE_BYTES: usize = 8 << 20;

/// Names and colours of the splits.
const SPLITS: [(&str, Colour); Split::ALL.len()] =
    [("train", [0, 114, 178]), ("val", [230, 159, 0]), ("test", [0, 158, 115])];

/// The complete page.
pub(super) fn page(dataset: &Dataset) -> String {
    let gathered = &dataset.gathered;
    let body = html! {
        (page::warnings(&warnings(dataset)))
        (cards(gathered))
        (about(dataset))
        (counts(gathered))
        (sheet(gathered))
        (sequences::sequences(gathered))
        (figures::distributions(gathered))
        (tables::effects(gathered))
        (tables::health(gathered))
        (tables::time(gathered))
        (tables::size(dataset))
        h2 { "Configuration" }
        details { summary { "job.toml, every default written out" } pre { (dataset.job_text) } }
        p.note { "Made by gelsim " (env!("CARGO_PKG_VERSION")) "." }
    };
    page::document(&format!("Dataset {}", name(dataset)), &body)
}

fn name(dataset: &Dataset) -> &str {
    dataset.recorded.name()
}

/// What is wrong or not there yet, and what to do about it.
pub(super) fn warnings(dataset: &Dataset) -> Vec<String> {
    let Dataset { gathered, missing, manifest, recorded, .. } = dataset;
    let mut texts = Vec::new();
    let mut cured: Vec<Finding> = Vec::new();
    if !missing.is_empty() {
        let range = |MissingShards { first, last }: &MissingShards| {
            if first == last { first.name() } else { format!("{} to {}", first.name(), last.name()) }
        };
        let count: u64 = missing.iter().map(|MissingShards { first, last }| last.number - first.number + 1).sum();
        let mut ranges: Vec<String> = missing.iter().take(MOST_LISTED).map(range).collect();
        if missing.len() > MOST_LISTED {
            ranges.push(String::from("and others"));
        }
        let (count, all) = (HumanCount(count), HumanCount(recorded.layout.shard_count()));
        texts
            .push(format!("the dataset is not complete: {count} of {all} shards are not there: {}", ranges.join(", ")));
        cured.push(Finding::new("data", "is not complete"));
    } else if manifest.is_none() {
        let file = Finding::new("dataset.json", "is missing or not whole").mended_by(Cure::Finalize);
        texts.push(file.to_string());
        cured.push(file);
    }
    let jobs = fingerprints(dataset).len();
    if jobs > 1 {
        texts.push(format!("shards and dataset.json are of {jobs} different jobs, by their fingerprints"));
    }
    texts.extend(grouped(&gathered.findings));
    if jobs > 1 || !gathered.findings.is_empty() {
        texts.push(format!("gelsim verify {} names all that is wrong, and what mends it", shell_word(&recorded.root)));
    } else if !cured.is_empty() {
        texts.push(format!("mend it with {}", cures(&recorded.root, &cured).join(" && ")));
    }
    texts
}

/// Findings as they are shown: a cause that many files share once, with the first of them.
fn grouped(findings: &[Finding]) -> Vec<String> {
    const FEW: usize = 3;
    let mut causes: Vec<(&str, Vec<&str>)> = Vec::new();
    for Finding { file, what, .. } in findings {
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
    if texts.len() > MOST_LISTED {
        let more = texts.split_off(MOST_LISTED).len();
        texts.push(format!("and {more} more"));
    }
    texts
}

/// Fingerprints of the jobs that shards and manifest are of; one if all is well.
fn fingerprints(dataset: &Dataset) -> BTreeSet<String> {
    let of_manifest = dataset.manifest.iter().map(|manifest| manifest.fingerprint.clone());
    dataset.gathered.totals.fingerprints.iter().cloned().chain(of_manifest).collect()
}

/// The figures that people ask for first.
fn cards(gathered: &DatasetStats) -> Markup {
    let samples = total(&gathered.samples);
    let totals = &gathered.totals;
    let seconds = totals.seconds.simulation() + totals.seconds.encode;
    let unhealthy = gathered.unhealthy.total();
    let rate = if seconds > 0.0 { figure(totals.samples as f64 / seconds) } else { String::from("-") };
    page::cards(&[
        (HumanCount(samples).to_string(), "samples"),
        (fraction(total(&gathered.in_contact), samples), "in contact"),
        (HumanCount(gathered.classes.len() as u64).to_string(), "classes"),
        (HumanCount(gathered.objects.len() as u64).to_string(), "objects"),
        (HumanBytes(totals.bytes).to_string(), "in shards"),
        (rate, "samples per CPU second"),
        (HumanCount(unhealthy).to_string(), "not healthy"),
    ])
}

/// What the dataset is.
fn about(dataset: &Dataset) -> Markup {
    let Dataset { gathered, manifest, recorded, .. } = dataset;
    let (sensor, job) = (&recorded.job.sensor, &recorded.job.dataset);
    let ([width, height], view) = (sensor.resolution_px, sensor.field_of_view_mm.map(figure).join(" x "));
    let models = |k: usize| gathered.models.iter().map(|names| names[k].as_str()).collect::<Vec<_>>().join(", ");
    let joined = |texts: &BTreeSet<String>| texts.iter().cloned().collect::<Vec<_>>().join(", ");
    let splits = Split::ALL.map(|split| (split.name(), recorded.layout.samples_in(split)));
    let splits = splits.iter().filter(|(_, samples)| *samples > 0);
    let splits: Vec<String> = splits.map(|(name, samples)| format!("{name} {}", HumanCount(*samples))).collect();
    let mut generators = gathered.totals.generators.clone();
    generators.extend(manifest.iter().map(|manifest| manifest.generator.version.clone()));
    let output = &recorded.job.output;
    let layers: Vec<String> = output.layers_in_order().iter().map(|layer| layer.suffix(output.depth_format)).collect();
    let by = job.split_by.name();
    let (youngs, poisson) = (figure(sensor.gelpad_youngs_modulus_kpa), figure(sensor.gelpad_poisson_ratio));
    let rows = [
        ("samples", format!("{}, split by {by}: {}", HumanCount(recorded.layout.samples()), splits.join(", "))),
        (
            "shards",
            format!("{} of up to {}", HumanCount(recorded.layout.shard_count()), HumanCount(job.samples_per_shard)),
        ),
        ("sensor", format!("{}, {width} x {height} px, {view} mm", sensor.name)),
        (
            "pad",
            format!("{} mm, Young's modulus {youngs} kPa, Poisson ratio {poisson}", figure(sensor.gelpad_thickness_mm)),
        ),
        ("fidelity", models(0)),
        ("model of the pad", models(1)),
        ("model of the light", models(2)),
        ("layers", layers.join(", ")),
        ("seed", job.seed.to_string()),
        ("generator", format!("gelsim {}", joined(&generators))),
        ("fingerprint", joined(&fingerprints(dataset))),
    ];
    let rows = rows.map(|(what, figure)| (what, if figure.is_empty() { String::from("-") } else { figure }));
    page::facts(&rows)
}

/// Samples by class and object.
fn counts(gathered: &DatasetStats) -> Markup {
    let all = total(&gathered.samples);
    let cells = |name: Markup, counts: &PerSplit| -> Vec<Markup> {
        let sum = total(counts);
        let numbers = counts.iter().chain([&sum]).map(|count| html! { (HumanCount(*count)) });
        [name].into_iter().chain(numbers).chain([html! { (fraction(sum, all)) }]).collect()
    };
    let named = gathered.classes.iter().take(MOST_ROWS);
    let mut classes: Vec<_> = named.map(|(name, counts)| cells(html! { (name) }, counts)).collect();
    classes.push(cells(html! { b { "all classes" } }, &gathered.samples));
    classes.push(cells(html! { "in contact" }, &gathered.in_contact));
    let named = gathered.objects.iter().take(MOST_ROWS);
    let objects = named.map(|(id, (class, counts))| cells(html! { (id) " (" (class) ")" }, counts));
    html! {
        h2 { "Counts" }
        (listed("class", classes, gathered.classes.len()))
        @if gathered.objects.iter().any(|(id, (class, _))| id != class) {
            details {
                summary { (counted(gathered.objects.len(), "object", "objects")) }
                (listed("object (class)", objects.collect(), gathered.objects.len()))
            }
        }
    }
}

/// A table of counts, and how many rows it has not.
fn listed(what: &str, rows: Vec<Vec<Markup>>, all: usize) -> Markup {
    let [what, all_splits, share] = [what, "all", "share"].map(|name| html! { (name) });
    html! {
        (page::table([what].into_iter().chain(SPLITS.map(page::key)).chain([all_splits, share]), rows))
        @if all > MOST_ROWS { p.note { "The first " (MOST_ROWS) " of " (all) ", by name." } }
    }
}

/// Some samples of each split.
fn sheet(gathered: &DatasetStats) -> Markup {
    let tiles = &gathered.tiles;
    if tiles.is_empty() {
        return Markup::default();
    }
    let scales = Scales::over(tiles.iter().flat_map(|picture| picture.tile.panels()));
    let sample = |(Picture { index, split, tile }, (png, size)): (&Picture, (Vec<u8>, _))| {
        let (caption, strip, times) = (tile.caption(), tile.strip(&scales, PANEL), tile.times());
        let small = page::image(&encode_small(&strip), strip.dimensions(), &caption);
        let image = page::opens(&format!("sample-{index}"), small, page::image(&png, size, &caption));
        let below = html! { (key(*split)) " " (caption) @if !times.is_empty() { br; (times) } };
        page::figure(image, below)
    };
    html! {
        h2 { "Samples" }
        p.note { (shown(gathered, &scales)) }
        (page::figures(html! { @for pair in tiles.iter().zip(large(tiles)) { (sample(pair)) } }))
    }
}

/// What the pictures of the samples show, in sentences.
fn shown(gathered: &DatasetStats, scales: &Scales) -> String {
    let has = |layer: OutputLayer| gathered.tiles.iter().any(|picture| picture.tile.shows(layer));
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
        let scale = scales.ends(OutputLayer::Depth);
        let scale = scale.map_or(String::new(), |(low, high)| format!(" (black at {low}, white at {high})"));
        views.push(format!("depth{scale}"));
    }
    if has(OutputLayer::Contact) {
        views.push(String::from("contact (white)"));
    }
    let views = views.join(", ");
    format!("From left to right: {views}{fingers}. A click shows the tactile image large, another one closes it.")
}

/// The tactile images of all samples as PNG files with their sizes, as large as they are, or as they may be for the page to stay
/// small.
fn large(tiles: &[Picture]) -> Vec<(Vec<u8>, (u32, u32))> {
    let mut panel_width = u32::MAX;
    loop {
        let encode = |Picture { tile, .. }: &Picture| {
            let image = tile.tactile(panel_width);
            let (width, height) = image.dimensions();
            (encode_rgb(width as usize, height as usize, &image), (width, height))
        };
        let encoded: Vec<_> = tiles.par_iter().map(encode).collect();
        let bytes: usize = encoded.iter().map(|(png, _)| png.len()).sum();
        if bytes <= MOST_LARGE_BYTES || panel_width <= PANEL {
            return encoded;
        }
        let widest = encoded.iter().map(|(_, (width, _))| *width).max().unwrap_or(1);
        panel_width = (panel_width.min(widest) / 2).max(PANEL);
    }
}

/// The name of a split beside a square of its colour.
fn key(split: Split) -> Markup {
    page::key(SPLITS[split.number()])
}

fn total(counts: &PerSplit) -> u64 {
    counts.iter().sum()
}

/// A part of a total in percent; of nothing there is none.
fn fraction(part: u64, total: u64) -> String {
    if total > 0 { percent(part as f64 / total as f64) } else { String::from("-") }
}
