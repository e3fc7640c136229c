//! Summary of an output compared with its input: counted while it is written, and shown as augment.json and as a page.

use std::collections::BTreeMap;

use image::RgbImage;
use maud::{Markup, html};
use serde_json::{Value, json};

use super::Recipe;
use super::counterpart::Alignment;
use super::coverage::covered_fraction;
use super::synthetic_mix::Coverage;
use super::trace::Source;
use gelsim_files::number_format::{format_count, format_number, format_percent};
use gelsim_files::png::encode_small;
use gelsim_job::label::GENERATOR;
use gelsim_lab::metrics::image_stats::{IMAGE_STAT_NAMES, ImageStats};
use gelsim_lab::page::bars::{Bar, draw_histogram};
use gelsim_lab::page::{self, canvas::Colour};

/// Number of bars of a histogram.
const BARS: usize = 24;
/// Most rows of a table.
const MAX_ROWS: usize = 60;
/// Names and colours of the sources.
const KINDS: [(&str, Colour); Source::ALL.len()] =
    [("real", [0, 114, 178]), ("photometric", [230, 159, 0]), ("twin", [0, 158, 115]), ("synthetic", [204, 121, 167])];

/// Most photometric copies that are shown next to their real image.
const MAX_COPIES: usize = 4;
/// Least width of the caption below a picture, px.
const MIN_CAPTION_PX: u32 = 100;

/// One count per source.
pub type PerSource = [u64; Source::ALL.len()];

/// A sample that was made, for counting.
pub struct SampleEntry {
    /// Source of the sample.
    pub source: Source,
    /// Number of the split.
    pub split: usize,
    /// Class or object.
    pub kind: Option<String>,
    /// Depth, mm.
    pub depth_mm: Option<f64>,
    /// Statistics of the image.
    pub image_stats: ImageStats,
    /// Number of the real sample that it derives from or follows.
    pub number: usize,
    /// Small image and caption, if the page shows it.
    pub tile: Option<(RgbImage, String)>,
    /// For a counterpart: offset, px, correlation, and result of the alignment.
    pub pair: Option<([f64; 2], f64, Alignment)>,
}

/// Counts of an output.
#[derive(Clone, Debug, Default)]
pub struct Summary {
    /// Samples by source.
    pub samples: PerSource,
    /// Bytes of all files.
    pub bytes: u64,
    /// Wall time, s.
    pub seconds: f64,
    /// Samples of each split by source.
    pub splits: Vec<(String, PerSource)>,
    kinds: BTreeMap<String, PerSource>,
    depths_mm: [Vec<f64>; Source::ALL.len()],
    brightness: [Vec<f64>; Source::ALL.len()],
    image_stats: [ImageStats; Source::ALL.len()],
    offsets_px: Vec<[f64; 2]>,
    correlations: Vec<f64>,
    alignments: BTreeMap<String, u64>,
    /// Pictures of some real samples with their derived ones, and of some synthetic samples.
    tiles: Vec<Thumbnail>,
}

/// A picture on the page.
#[derive(Clone, Debug)]
struct Thumbnail {
    /// Number of the real sample that it is or derives from.
    number: usize,
    source: Source,
    image: RgbImage,
    caption: String,
}

impl Summary {
    /// Creates empty counts.
    pub fn new(recipe: &Recipe) -> Self {
        let splits = recipe.division.names.iter().map(|name| (name.clone(), PerSource::default())).collect();
        Self { splits, ..Self::default() }
    }

    /// Counts a sample.
    pub fn count_sample(&mut self, entry: SampleEntry) {
        let k = entry.source as usize;
        self.samples[k] += 1;
        self.splits[entry.split].1[k] += 1;
        *entry.kind.map_or(&mut 0, |kind| &mut self.kinds.entry(kind).or_default()[k]) += 1;
        self.depths_mm[k].extend(entry.depth_mm);
        self.brightness[k].push(entry.image_stats.mean.iter().sum::<f64>() / 3.0);
        self.image_stats[k].add(&entry.image_stats);
        let (number, source) = (entry.number, entry.source);
        let copies =
            self.tiles.iter().filter(|tile| tile.number == number && tile.source == Source::Photometric).count();
        let shown = entry.tile.filter(|_| source != Source::Photometric || copies < MAX_COPIES);
        self.tiles.extend(shown.map(|(image, caption)| Thumbnail { number, source, image, caption }));
        if let Some((offset, correlation, alignment)) = entry.pair {
            *self.alignments.entry(alignment.name().to_owned()).or_default() += 1;
            if alignment == Alignment::Aligned {
                self.offsets_px.push(offset);
            }
            self.correlations.push(correlation);
        }
    }

    /// Number of all samples.
    pub fn sample_count(&self) -> u64 {
        self.samples.iter().sum()
    }

    /// Median offset of aligned counterparts, px, and median correlation of all counterparts. None without
    /// counterparts.
    pub fn pair_medians(&self) -> Option<([f64; 2], f64)> {
        let median = |values: Vec<f64>| gelsim_lab::metrics::statistics::median(&values);
        let axis = |k: usize| median(self.offsets_px.iter().map(|offset| offset[k]).collect()).unwrap_or(0.0);
        Some(([axis(0), axis(1)], median(self.correlations.clone())?))
    }

    /// Writes augment.json.
    pub fn to_json(&self, recipe: &Recipe) -> Vec<u8> {
        let counts = |counts: &PerSource| {
            let named = Source::ALL.iter().zip(counts);
            Value::Object(named.map(|(source, count)| (source.name().to_owned(), Value::from(*count))).collect())
        };
        let named = |all: &mut dyn Iterator<Item = (&String, &PerSource)>| {
            Value::Object(all.map(|(name, of)| (name.clone(), counts(of))).collect())
        };
        let image_stats = Source::ALL.iter().filter(|source| self.samples[**source as usize] > 0).map(|source| {
            let k = *source as usize;
            let figures = IMAGE_STAT_NAMES.iter().zip(self.image_stats[k].mean_values(self.samples[k]));
            let figures = figures.map(|(name, value)| ((*name).to_owned(), Value::from(value)));
            (source.name().to_owned(), Value::Object(figures.collect()))
        });
        let pairs = self.pair_medians().map(|(offset_px, correlation)| {
            json!({ "alignments": self.alignments, "median_offset_px": offset_px, "median_correlation": correlation })
        });
        let mix = recipe.mix.as_ref().map(|mix| {
            let [before, after] = coverage_before_after(&mix.coverage);
            json!({
                "job": mix.plan.name(),
                "fingerprint": mix.plan.fingerprint,
                "cells": mix.coverage.is_counted.iter().filter(|counting| **counting).count(),
                "coverage_before": before,
                "coverage_after": after,
            })
        });
        let summary = json!({
            "generator": GENERATOR,
            "seed": recipe.seed,
            "samples": self.sample_count(),
            "sources": counts(&self.samples),
            "splits": named(&mut self.splits.iter().map(|(name, of)| (name, of))),
            "classes": named(&mut self.kinds.iter()),
            "images": Value::Object(image_stats.collect()),
            "twins": pairs,
            "mixing": mix,
            "notes": recipe.notes.messages_with_help(),
            "recipe": recipe.text,
        });
        format!("{summary:#}\n").into_bytes()
    }

    /// Renders the page.
    pub fn to_html(&self, recipe: &Recipe) -> String {
        let counted = [(self.sample_count().to_string(), "samples")].into_iter();
        let sources = Source::ALL.iter().map(|source| (self.samples[*source as usize].to_string(), source.name()));
        let body = html! {
            (page::render_cards(&counted.chain(sources).collect::<Vec<_>>()))
            (page::render_warnings(&recipe.notes.messages_with_help()))
            (render_counts("Splits", "split", self.splits.iter().map(|(name, of)| (name.as_str(), of))))
            (render_counts("Classes", "class", self.kinds.iter().map(|(name, of)| (name.as_str(), of))))
            (self.render_image_section())
            (self.render_thumbnails())
            (self.render_counterparts())
            @if let Some(mix) = &recipe.mix { (render_coverage(&mix.coverage)) }
            h2 { "Recipe" }
            details { summary { (recipe.name) ".toml" } pre { (recipe.text) } }
            p.note { "Made by " (GENERATOR) "." }
        };
        page::render_document(&format!("Augmented dataset {}", recipe.name), &body)
    }

    /// Renders images of input and output side by side.
    fn render_image_section(&self) -> Markup {
        let head = ["images", "number", "red", "green", "blue", "contrast", "sharpness"];
        let row = |name: Markup, count: u64, image_stats: &ImageStats| {
            let figures = image_stats.mean_values(count).map(|value| html! { (format_number(value)) });
            [name, html! { (count) }].into_iter().chain(figures).collect::<Vec<_>>()
        };
        let mut all = ImageStats::default();
        self.image_stats.iter().for_each(|image_stats| all.add(image_stats));
        let mut rows = vec![row(html! { b { "input" } }, self.samples[0], &self.image_stats[0])];
        rows.push(row(html! { b { "output" } }, self.sample_count(), &all));
        let parts = (0..KINDS.len()).filter(|k| self.samples[*k] > 0);
        rows.extend(parts.map(|k| row(page::render_legend_entry(KINDS[k]), self.samples[k], &self.image_stats[k])));
        let figures = [("Brightness", "grey levels", &self.brightness), ("Indentation depth", "mm", &self.depths_mm)];
        html! {
            h2 { "Input and output" }
            (page::render_table(head, rows))
            p.note {
                "Means over images, in grey levels: of the channels; of the standard deviation over an image; of the difference "
                "between neighbours in a row."
            }
            p.note { "Bars stand on each other: " (page::render_legend(&KINDS)) }
            (page::render_figures(html! {
                @for (title, axis, values) in figures {
                    (page::render_figure(draw_histogram(title, [axis, "samples"], &to_bars(values), &KINDS), ""))
                }
            }))
        }
    }

    /// Renders some real samples, each with its derived ones, then some synthetic samples.
    fn render_thumbnails(&self) -> Markup {
        let picture = |tile: &Thumbnail| {
            let image = page::render_image(&encode_small(&tile.image), tile.image.dimensions(), tile.source.name());
            // Names may be longer than the picture is wide.
            let width = tile.image.width().max(MIN_CAPTION_PX);
            let style = format!("display: block; max-width: {width}px; overflow-wrap: anywhere; white-space: pre-line");
            page::render_figure(
                image,
                html! { (page::render_legend_entry(KINDS[tile.source as usize])) span style=(style) { (tile.caption) } },
            )
        };
        let row = |tiles: &[&Thumbnail]| html! { div { @for tile in tiles { (picture(tile)) } } };
        let (synthetic, of_reals): (Vec<&Thumbnail>, Vec<&Thumbnail>) =
            self.tiles.iter().partition(|tile| tile.source == Source::Synthetic);
        let groups: Vec<&[&Thumbnail]> = of_reals.chunk_by(|a, b| a.number == b.number).collect();
        html! {
            @if groups.iter().any(|group| group.len() > 1) {
                h2 { "Real samples and what was made of them" }
                p.note { "Each row begins with the real image." }
                @for group in groups { (row(group)) }
            } @else if !of_reals.is_empty() {
                h2 { "Real samples" }
                (row(&of_reals))
            }
            @if !synthetic.is_empty() {
                h2 { "Synthetic samples" }
                p.note { "New presses of the job: none is made of a real sample." }
                (row(&synthetic))
            }
        }
    }

    fn render_counterparts(&self) -> Markup {
        let Some(([x, y], correlation)) = self.pair_medians() else { return Markup::default() };
        let mut rows: Vec<(String, String)> =
            self.alignments.iter().map(|(name, count)| (name.replace('_', " "), count.to_string())).collect();
        rows.push((String::from("median offset of aligned counterparts, px"), format!("{x:.2}, {y:.2}")));
        rows.push((String::from("median correlation"), format!("{correlation:.3}")));
        html! { h2 { "Simulated counterparts (twin)" } (page::render_facts(&rows)) }
    }
}

fn render_counts<'a>(title: &str, what: &str, all: impl Iterator<Item = (&'a str, &'a PerSource)>) -> Markup {
    let cells = |(name, of): (&str, &PerSource)| {
        let name = if name.is_empty() { "-" } else { name };
        let sum: u64 = of.iter().sum();
        let numbers = of.iter().chain([&sum]).map(u64::to_string);
        [name.to_owned()].into_iter().chain(numbers).collect::<Vec<String>>()
    };
    let mut rows: Vec<Vec<String>> = all.map(cells).collect();
    let more = rows.len().saturating_sub(MAX_ROWS);
    rows.truncate(MAX_ROWS);
    let head = [html! { (what) }].into_iter().chain(KINDS.map(page::render_legend_entry)).chain([html! { "all" }]);
    html! {
        @if !rows.is_empty() {
            h2 { (title) }
            (page::render_table(head, rows))
            @if more > 0 { p.note { "And " (more) " more." } }
        }
    }
}

/// Divides values into bars of one width.
fn to_bars(values: &[Vec<f64>; Source::ALL.len()]) -> Vec<Bar<{ Source::ALL.len() }>> {
    let ends = values.iter().flatten().fold(None, |ends, value| {
        let [from, to] = ends.unwrap_or([*value, *value]);
        Some([f64::min(from, *value), f64::max(to, *value)])
    });
    let Some([from, to]) = ends else { return Vec::new() };
    let width = if to > from { (to - from) / BARS as f64 } else { 1.0 };
    let count = if to > from { BARS } else { 1 };
    let edge = |k: usize| from + width * k as f64;
    let mut bars: Vec<Bar<4>> = (0..count).map(|k| Bar { from: edge(k), to: edge(k + 1), counts: [0; 4] }).collect();
    for (kind, values) in values.iter().enumerate() {
        for value in values {
            bars[(((value - from) / width) as usize).min(count - 1)].counts[kind] += 1;
        }
    }
    bars
}

/// Fraction of the cells that count which have a sample, before and after.
pub fn coverage_before_after(coverage: &Coverage) -> [f64; 2] {
    [&coverage.before, &coverage.after].map(|counts| covered_fraction(counts, &coverage.is_counted))
}

fn render_coverage(coverage: &Coverage) -> Markup {
    let Coverage { cells, is_counted: counting, before, after } = coverage;
    let number = counting.iter().filter(|counting| **counting).count();
    let [was, is] = coverage_before_after(coverage);
    let fewest = |counts: &[u64]| {
        counts.iter().zip(counting).filter(|(_, counting)| **counting).map(|(count, _)| *count).min().unwrap_or(0)
    };
    let facts = [
        ("cells that real samples are in or the job reaches", number.to_string()),
        ("of them with a real sample", format_percent(was)),
        ("with any sample", format_percent(is)),
        ("fewest samples in one, before and after", format!("{}, {}", fewest(before), fewest(after))),
    ];
    let mut order: Vec<usize> = (0..counting.len()).filter(|&cell| counting[cell]).collect();
    order.sort_by_key(|&cell| (before[cell], cell));
    let row = |&cell: &usize| {
        let name = cells.describe_cell(cell);
        let name = if name.is_empty() { String::from("everything") } else { name };
        vec![name, before[cell].to_string(), after[cell].to_string()]
    };
    html! {
        h2 { "Coverage" }
        (page::render_facts(&facts))
        details {
            summary { (format_count(number.min(MAX_ROWS), "cell", "cells")) ", those with the fewest real samples first" }
            (page::render_table(["cell", "real", "all"], order.iter().take(MAX_ROWS).map(row)))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_value_is_in_one_bar() {
        let values = [vec![0.0, 1.0, 0.5], vec![0.25], Vec::new(), vec![1.0]];
        let bars = to_bars(&values);
        let sums: Vec<u64> = (0..4).map(|k| bars.iter().map(|bar| bar.counts[k]).sum()).collect();
        assert_eq!((bars.len(), sums), (BARS, vec![3, 1, 0, 1]));
        assert_eq!(bars.last().map(|bar| bar.counts), Some([1, 0, 0, 1]));
    }
}
