//! What an output holds, beside what its input held: counted while it is written, as augment.json and as a page.

use std::collections::BTreeMap;

use image::RgbImage;
use maud::{Markup, html};
use serde_json::{Value, json};

use super::Recipe;
use super::counterpart::Alignment;
use super::coverage::fraction;
use super::image_stats::{IMAGE_STATS, ImageStats};
use super::synthetic_mix::Coverage;
use super::trace::Source;
use gelsim_files::figures::{counted, figure, percent};
use gelsim_files::png::encode_small;
use gelsim_job::label::GENERATOR;
use gelsim_lab::page::bars::{Bar, histogram};
use gelsim_lab::page::{self, canvas::Colour};

/// Bars of a histogram.
const BARS: usize = 24;
/// Rows of a table.
const MOST_ROWS: usize = 60;
/// Names and colours of the sources.
const KINDS: [(&str, Colour); Source::ALL.len()] =
    [("real", [0, 114, 178]), ("photometric", [230, 159, 0]), ("twin", [0, 158, 115]), ("synthetic", [204, 121, 167])];

/// Photometric copies that are shown beside their real image.
const MOST_COPIES: usize = 4;
/// Width of a picture, px.
const TILE_PX: u32 = 150;
/// Least width of the text below it, px.
const MIN_CAPTION_PX: u32 = 100;

/// An image as the page shows it.
pub fn tile(image: &RgbImage) -> RgbImage {
    let height = (image.height() * TILE_PX / image.width().max(1)).max(1);
    if image.width() > TILE_PX { image::imageops::thumbnail(image, TILE_PX, height) } else { image.clone() }
}

/// One count for each source.
pub type PerSource = [u64; Source::ALL.len()];

/// A sample that was made.
pub struct SampleEntry {
    /// What it is.
    pub source: Source,
    /// Its split.
    pub split: usize,
    /// Its class or object.
    pub kind: Option<String>,
    /// Its depth, mm.
    pub depth_mm: Option<f64>,
    /// Its image.
    pub image_stats: ImageStats,
    /// The real sample it comes from or follows.
    pub number: usize,
    /// The image, small, if the page shows it, and what stands below it.
    pub tile: Option<(RgbImage, String)>,
    /// Of a counterpart: offset, correlation, and what came of it.
    pub pair: Option<([f64; 2], f64, Alignment)>,
}

/// What an output holds.
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
    /// Pictures of some real samples and of what was made of them, and of some synthetic ones.
    tiles: Vec<Tile>,
}

/// A picture on the page.
#[derive(Clone, Debug)]
struct Tile {
    /// The real sample that it is or comes from.
    number: usize,
    source: Source,
    image: RgbImage,
    caption: String,
}

impl Summary {
    /// Of nothing yet.
    pub fn new(recipe: &Recipe) -> Self {
        let splits = recipe.division.names.iter().map(|name| (name.clone(), PerSource::default())).collect();
        Self { splits, ..Self::default() }
    }

    /// Counts a sample.
    pub fn count(&mut self, entry: SampleEntry) {
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
        let shown = entry.tile.filter(|_| source != Source::Photometric || copies < MOST_COPIES);
        self.tiles.extend(shown.map(|(image, caption)| Tile { number, source, image, caption }));
        if let Some((offset, correlation, alignment)) = entry.pair {
            *self.alignments.entry(alignment.name().to_owned()).or_default() += 1;
            if alignment == Alignment::Aligned {
                self.offsets_px.push(offset);
            }
            self.correlations.push(correlation);
        }
    }

    /// All samples.
    pub fn all(&self) -> u64 {
        self.samples.iter().sum()
    }

    /// Median offset of the counterparts that were aligned, px, and median correlation of all counterparts.
    pub fn pairs(&self) -> Option<([f64; 2], f64)> {
        let median = |values: Vec<f64>| gelsim_lab::metrics::statistics::median(&values);
        let axis = |k: usize| median(self.offsets_px.iter().map(|offset| offset[k]).collect()).unwrap_or(0.0);
        Some(([axis(0), axis(1)], median(self.correlations.clone())?))
    }

    /// augment.json.
    pub fn json(&self, recipe: &Recipe) -> Vec<u8> {
        let counts = |counts: &PerSource| {
            let named = Source::ALL.iter().zip(counts);
            Value::Object(named.map(|(source, count)| (source.name().to_owned(), Value::from(*count))).collect())
        };
        let named = |all: &mut dyn Iterator<Item = (&String, &PerSource)>| {
            Value::Object(all.map(|(name, of)| (name.clone(), counts(of))).collect())
        };
        let image_stats = Source::ALL.iter().filter(|source| self.samples[**source as usize] > 0).map(|source| {
            let k = *source as usize;
            let figures = IMAGE_STATS.iter().zip(self.image_stats[k].figures(self.samples[k]));
            let figures = figures.map(|(name, value)| ((*name).to_owned(), Value::from(value)));
            (source.name().to_owned(), Value::Object(figures.collect()))
        });
        let pairs = self.pairs().map(|(offset_px, correlation)| {
            json!({ "alignments": self.alignments, "median_offset_px": offset_px, "median_correlation": correlation })
        });
        let mix = recipe.mix.as_ref().map(|mix| {
            let [before, after] = reached(&mix.coverage);
            json!({
                "job": mix.plan.name(),
                "fingerprint": mix.plan.fingerprint,
                "cells": mix.coverage.counting.iter().filter(|counting| **counting).count(),
                "coverage_before": before,
                "coverage_after": after,
            })
        });
        let summary = json!({
            "generator": GENERATOR,
            "seed": recipe.seed,
            "samples": self.all(),
            "sources": counts(&self.samples),
            "splits": named(&mut self.splits.iter().map(|(name, of)| (name, of))),
            "classes": named(&mut self.kinds.iter()),
            "images": Value::Object(image_stats.collect()),
            "twins": pairs,
            "mixing": mix,
            "notes": recipe.notes.texts(),
            "recipe": recipe.text,
        });
        format!("{summary:#}\n").into_bytes()
    }

    /// The page.
    pub fn html(&self, recipe: &Recipe) -> String {
        let counted = [(self.all().to_string(), "samples")].into_iter();
        let sources = Source::ALL.iter().map(|source| (self.samples[*source as usize].to_string(), source.name()));
        let body = html! {
            (page::cards(&counted.chain(sources).collect::<Vec<_>>()))
            (page::warnings(&recipe.notes.texts()))
            (counts("Splits", "split", self.splits.iter().map(|(name, of)| (name.as_str(), of))))
            (counts("Classes", "class", self.kinds.iter().map(|(name, of)| (name.as_str(), of))))
            (self.images())
            (self.pictures())
            (self.counterparts())
            @if let Some(mix) = &recipe.mix { (coverage(&mix.coverage)) }
            h2 { "Recipe" }
            details { summary { (recipe.name) ".toml" } pre { (recipe.text) } }
            p.note { "Made by " (GENERATOR) "." }
        };
        page::document(&format!("Augmented dataset {}", recipe.name), &body)
    }

    /// Input and output side by side.
    fn images(&self) -> Markup {
        let head = ["images", "number", "red", "green", "blue", "contrast", "sharpness"];
        let row = |name: Markup, count: u64, image_stats: &ImageStats| {
            let figures = image_stats.figures(count).map(|value| html! { (figure(value)) });
            [name, html! { (count) }].into_iter().chain(figures).collect::<Vec<_>>()
        };
        let mut all = ImageStats::default();
        self.image_stats.iter().for_each(|image_stats| all.add(image_stats));
        let mut rows = vec![row(html! { b { "input" } }, self.samples[0], &self.image_stats[0])];
        rows.push(row(html! { b { "output" } }, self.all(), &all));
        let parts = (0..KINDS.len()).filter(|k| self.samples[*k] > 0);
        rows.extend(parts.map(|k| row(page::key(KINDS[k]), self.samples[k], &self.image_stats[k])));
        let figures = [("Brightness", "grey levels", &self.brightness), ("Indentation depth", "mm", &self.depths_mm)];
        html! {
            h2 { "Input and output" }
            (page::table(head, rows))
            p.note {
                "Means over images, in grey levels: of the channels; of the standard deviation over an image; of the difference "
                "between neighbours in a row."
            }
            p.note { "Bars stand on each other: " (page::keys(&KINDS)) }
            (page::figures(html! {
                @for (title, axis, values) in figures {
                    (page::figure(histogram(title, [axis, "samples"], &bars(values), &KINDS), ""))
                }
            }))
        }
    }

    /// Some real samples, each beside what was made of it; then some synthetic ones, which come of no real sample.
    fn pictures(&self) -> Markup {
        let picture = |tile: &Tile| {
            let image = page::image(&encode_small(&tile.image), tile.image.dimensions(), tile.source.name());
            // Names may be longer than the picture is wide.
            let width = tile.image.width().max(MIN_CAPTION_PX);
            let style = format!("display: block; max-width: {width}px; overflow-wrap: anywhere; white-space: pre-line");
            page::figure(
                image,
                html! { (page::key(KINDS[tile.source as usize])) span style=(style) { (tile.caption) } },
            )
        };
        let row = |tiles: &[&Tile]| html! { div { @for tile in tiles { (picture(tile)) } } };
        let (synthetic, of_reals): (Vec<&Tile>, Vec<&Tile>) =
            self.tiles.iter().partition(|tile| tile.source == Source::Synthetic);
        let groups: Vec<&[&Tile]> = of_reals.chunk_by(|a, b| a.number == b.number).collect();
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

    fn counterparts(&self) -> Markup {
        let Some(([x, y], correlation)) = self.pairs() else { return Markup::default() };
        let mut rows: Vec<(String, String)> =
            self.alignments.iter().map(|(name, count)| (name.replace('_', " "), count.to_string())).collect();
        rows.push((String::from("median offset of aligned twins, px"), format!("{x:.2}, {y:.2}")));
        rows.push((String::from("median correlation"), format!("{correlation:.3}")));
        html! { h2 { "Twins" } (page::facts(&rows)) }
    }
}

fn counts<'a>(title: &str, what: &str, all: impl Iterator<Item = (&'a str, &'a PerSource)>) -> Markup {
    let cells = |(name, of): (&str, &PerSource)| {
        let name = if name.is_empty() { "-" } else { name };
        let sum: u64 = of.iter().sum();
        let numbers = of.iter().chain([&sum]).map(u64::to_string);
        [name.to_owned()].into_iter().chain(numbers).collect::<Vec<String>>()
    };
    let mut rows: Vec<Vec<String>> = all.map(cells).collect();
    let more = rows.len().saturating_sub(MOST_ROWS);
    rows.truncate(MOST_ROWS);
    let head = [html! { (what) }].into_iter().chain(KINDS.map(page::key)).chain([html! { "all" }]);
    html! {
        @if !rows.is_empty() {
            h2 { (title) }
            (page::table(head, rows))
            @if more > 0 { p.note { "And " (more) " more." } }
        }
    }
}

/// Values as bars of one width.
fn bars(values: &[Vec<f64>; Source::ALL.len()]) -> Vec<Bar<{ Source::ALL.len() }>> {
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
pub fn reached(coverage: &Coverage) -> [f64; 2] {
    [&coverage.before, &coverage.after].map(|counts| fraction(counts, &coverage.counting))
}

fn coverage(coverage: &Coverage) -> Markup {
    let Coverage { cells, counting, before, after } = coverage;
    let number = counting.iter().filter(|counting| **counting).count();
    let [was, is] = reached(coverage);
    let fewest = |counts: &[u64]| {
        counts.iter().zip(counting).filter(|(_, counting)| **counting).map(|(count, _)| *count).min().unwrap_or(0)
    };
    let facts = [
        ("cells that real samples are in or the job reaches", number.to_string()),
        ("of them with a real sample", percent(was)),
        ("with any sample", percent(is)),
        ("fewest samples in one, before and after", format!("{}, {}", fewest(before), fewest(after))),
    ];
    let mut order: Vec<usize> = (0..counting.len()).filter(|&cell| counting[cell]).collect();
    order.sort_by_key(|&cell| (before[cell], cell));
    let row = |&cell: &usize| {
        let name = cells.name(cell);
        let name = if name.is_empty() { String::from("everything") } else { name };
        vec![name, before[cell].to_string(), after[cell].to_string()]
    };
    html! {
        h2 { "Coverage" }
        (page::facts(&facts))
        details {
            summary { (counted(number.min(MOST_ROWS), "cell", "cells")) ", those with the fewest real samples first" }
            (page::table(["cell", "real", "all"], order.iter().take(MOST_ROWS).map(row)))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_value_is_in_one_bar() {
        let values = [vec![0.0, 1.0, 0.5], vec![0.25], Vec::new(), vec![1.0]];
        let bars = bars(&values);
        let sums: Vec<u64> = (0..4).map(|k| bars.iter().map(|bar| bar.counts[k]).sum()).collect();
        assert_eq!((bars.len(), sums), (BARS, vec![3, 1, 0, 1]));
        assert_eq!(bars.last().map(|bar| bar.counts), Some([1, 0, 0, 1]));
    }
}
