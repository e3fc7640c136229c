//! Distributions in the report: a histogram of each quantity, and the means by split.

use maud::{Markup, html};

use crate::numbers::HumanCount;

use super::{SPLITS, total_count};
use crate::page::{self, bars};
use crate::report::MAX_IMAGES;
use crate::report::gather::DatasetStats;
use crate::report::histogram::{Histogram, HistogramSummary};
use crate::report::quantities::{EmptyHistogram, LabelQuantity, NO_CONTACT, QUANTITIES, QuantityTopic};
use gelsim_files::number_format::format_number;
use gelsim_job::layout::Split;

/// Most bars of a histogram.
const MAX_BARS: usize = 30;

/// Renders all distributions but those of the solver.
pub(super) fn render_distributions(gathered: &DatasetStats) -> Markup {
    let sections = [
        ("Contact", QuantityTopic::Contact, render_brightness(gathered)),
        ("Pose", QuantityTopic::Pose, render_places(gathered)),
        ("Beyond the press", QuantityTopic::Extra, Markup::default()),
    ];
    html! {
        h2 { "Distributions" }
        p.note { "Bars of the splits stand on each other: " (page::render_legend(&SPLITS)) }
        @for (heading, about, last) in sections {
            @let figures = html! { (render_quantities(gathered, about)) (last) };
            @if !figures.0.is_empty() { h3 { (heading) } (page::render_figures(figures)) }
        }
        (render_split_means(gathered))
    }
}

/// Renders the histograms of the quantities of one topic.
pub(super) fn render_quantities(gathered: &DatasetStats, about: QuantityTopic) -> Markup {
    let all = QUANTITIES.iter().zip(&gathered.histograms).filter(|(quantity, _)| quantity.topic == about);
    html! { @for (quantity, histogram) in all { (render_quantity(gathered, quantity, histogram)) } }
}

/// Renders the histogram of a quantity, or what stands in its place if no sample has it.
fn render_quantity(gathered: &DatasetStats, quantity: &LabelQuantity, histogram: &Histogram) -> Markup {
    let LabelQuantity { title, axis, among, absent, .. } = quantity;
    if histogram.total_summary().count > 0 {
        return render_histogram(title, [axis, "samples"], among, histogram);
    }
    match absent {
        EmptyHistogram::LeftOut => Markup::default(),
        EmptyHistogram::Message(words) => page::render_figure(bars::draw_placeholder(title, words), ""),
        EmptyHistogram::Unknown if total_count(&gathered.in_contact) == 0 => {
            page::render_figure(bars::draw_placeholder(title, NO_CONTACT), "")
        }
        EmptyHistogram::Unknown => {
            let models: Vec<&str> = gathered.models.iter().map(|names| names[1].as_str()).collect();
            let why = format!("null in every label: the pad model is {}", models.join(", "));
            page::render_figure(bars::draw_placeholder(title, "the pad model knows none"), why)
        }
    }
}

/// Renders a histogram with its figures below. If all values are equal, words say so.
pub(super) fn render_histogram(title: &str, axes: [&str; 2], among: &str, histogram: &Histogram) -> Markup {
    let axis = axes[0];
    let HistogramSummary { count, least, largest, .. } = histogram.total_summary();
    let told = |value: f64| bars::format_distinct(value, largest - least);
    let mean = histogram.total_summary().mean().map(told).unwrap_or_default();
    let (number, least_text, largest_text) = (HumanCount(count), told(least), told(largest));
    if least == largest {
        let words = format!("{least_text} {axis} in all {number}");
        return page::render_figure(bars::draw_placeholder(title, &words), format!("n {number} {among}"));
    }
    // With few values, fewer bars: they would be mostly empty otherwise.
    let most = (2.0 * (count as f64).sqrt()).clamp(6.0, MAX_BARS as f64) as usize;
    let svg = bars::draw_histogram(title, axes, &histogram.to_bars(most), &SPLITS);
    page::render_figure(svg, format!("n {number} {among}; mean {mean}, {least_text} to {largest_text}\u{a0}{axis}"))
}

/// Renders the histogram of the images' mean grey levels; nothing if no image was read.
fn render_brightness(gathered: &DatasetStats) -> Markup {
    let (images, samples) = (gathered.brightness.total_summary().count, total_count(&gathered.samples));
    if images == 0 {
        return Markup::default();
    }
    let among = if samples > MAX_IMAGES {
        format!("images of {}, evenly spread", HumanCount(samples))
    } else {
        String::from("images")
    };
    render_histogram("Brightness of the image", ["grey levels", "images"], &among, &gathered.brightness)
}

/// Renders the heatmap of the contacts' centroids.
fn render_places(gathered: &DatasetStats) -> Markup {
    const TITLE: &str = "Middle of the contact";
    let contacts = total_count(&gathered.in_contact);
    if contacts == 0 {
        return page::render_figure(bars::draw_placeholder(TITLE, NO_CONTACT), "");
    }
    let [x, y] = gathered.places.cell_mm().map(format_number);
    let (contacts, most) = (HumanCount(contacts), HumanCount(gathered.places.highest_count()));
    let caption = format!("n {contacts} samples in contact, in cells of {x} x {y} mm; the darkest cell has {most}");
    page::render_figure(gathered.places.to_svg(TITLE, bars::SIZE[0]), caption)
}

/// Renders a table of every quantity's mean in each split.
fn render_split_means(gathered: &DatasetStats) -> Markup {
    let row = |name: String, histogram: &Histogram| -> Option<Vec<String>> {
        let all = histogram.total_summary();
        let told = |value: f64| bars::format_distinct(value, all.largest - all.least);
        let mean = |summary: &HistogramSummary| summary.mean().map_or(String::from("-"), told);
        let means = Split::ALL.map(|split| mean(histogram.split_summary(split)));
        let figures = [HumanCount(all.count).to_string(), told(all.least), told(all.largest), mean(&all)];
        (all.count > 0).then(|| [name].into_iter().chain(figures).chain(means).collect())
    };
    let quantities = QUANTITIES.iter().zip(&gathered.histograms);
    let rows = quantities.map(|(quantity, histogram)| row(quantity.title_with_unit(), histogram));
    let last = row(String::from("Brightness of the image, grey levels"), &gathered.brightness);
    let rows: Vec<Vec<String>> = rows.chain([last]).flatten().collect();
    let head = ["", "n", "least", "largest", "mean"]
        .map(|name| html! { (name) })
        .into_iter()
        .chain(SPLITS.map(page::render_legend_entry));
    html! {
        @if !rows.is_empty() {
            h3 { "Means by split" }
            (page::render_table(head, rows))
        }
    }
}
