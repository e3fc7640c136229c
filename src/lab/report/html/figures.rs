//! The distributions of the report: a histogram of each quantity, and their figures by split.

use maud::{Markup, html};

use crate::numbers::HumanCount;

use super::{SPLITS, total};
use crate::page::{self, bars};
use crate::report::MOST_IMAGES;
use crate::report::gather::DatasetStats;
use crate::report::histogram::{Histogram, HistogramSummary};
use crate::report::quantities::{About, Absent, LabelQuantity, NO_CONTACT, QUANTITIES};
use gelsim_files::figures::figure;
use gelsim_job::layout::Split;

/// Bars of a histogram, at most.
const MOST_BARS: usize = 30;

/// All distributions but the solver's.
pub(super) fn distributions(gathered: &DatasetStats) -> Markup {
    let sections = [
        ("Contact", About::Contact, brightness(gathered)),
        ("Pose", About::Pose, places(gathered)),
        ("Beyond the press", About::Extra, Markup::default()),
    ];
    html! {
        h2 { "Distributions" }
        p.note { "Bars of the splits stand on each other: " (page::keys(&SPLITS)) }
        @for (heading, about, last) in sections {
            @let figures = html! { (section(gathered, about)) (last) };
            @if !figures.0.is_empty() { h3 { (heading) } (page::figures(figures)) }
        }
        (by_split(gathered))
    }
}

/// The histograms of the quantities that are about one thing.
pub(super) fn section(gathered: &DatasetStats, about: About) -> Markup {
    let all = QUANTITIES.iter().zip(&gathered.histograms).filter(|(quantity, _)| quantity.about == about);
    html! { @for (quantity, histogram) in all { (figure_of(gathered, quantity, histogram)) } }
}

fn figure_of(gathered: &DatasetStats, quantity: &LabelQuantity, histogram: &Histogram) -> Markup {
    let LabelQuantity { title, axis, among, absent, .. } = quantity;
    if histogram.all().count > 0 {
        return drawn(title, [axis, "samples"], among, histogram);
    }
    match absent {
        Absent::LeftOut => Markup::default(),
        Absent::Message(words) => page::figure(bars::nothing(title, words), ""),
        Absent::Unknown if total(&gathered.in_contact) == 0 => page::figure(bars::nothing(title, NO_CONTACT), ""),
        Absent::Unknown => {
            let models: Vec<&str> = gathered.models.iter().map(|names| names[1].as_str()).collect();
            let why = format!("null in every label: the pad model is {}", models.join(", "));
            page::figure(bars::nothing(title, "the pad model knows none"), why)
        }
    }
}

/// A histogram with its figures below; equal values are said in words.
pub(super) fn drawn(title: &str, axes: [&str; 2], among: &str, histogram: &Histogram) -> Markup {
    let axis = axes[0];
    let HistogramSummary { count, least, largest, .. } = histogram.all();
    let told = |value: f64| bars::told(value, largest - least);
    let mean = histogram.all().mean().map(told).unwrap_or_default();
    let (number, least_text, largest_text) = (HumanCount(count), told(least), told(largest));
    if least == largest {
        let words = format!("{least_text} {axis} in all {number}");
        return page::figure(bars::nothing(title, &words), format!("n {number} {among}"));
    }
    // As many bars as so many values fill.
    let most = (2.0 * (count as f64).sqrt()).clamp(6.0, MOST_BARS as f64) as usize;
    let svg = bars::histogram(title, axes, &histogram.bars(most), &SPLITS);
    page::figure(svg, format!("n {number} {among}; mean {mean}, {least_text} to {largest_text}\u{a0}{axis}"))
}

fn brightness(gathered: &DatasetStats) -> Markup {
    let (images, samples) = (gathered.brightness.all().count, total(&gathered.samples));
    if images == 0 {
        return Markup::default();
    }
    let among = if samples > MOST_IMAGES {
        format!("images of {}, evenly spread", HumanCount(samples))
    } else {
        String::from("images")
    };
    drawn("Brightness of the image", ["grey levels", "images"], &among, &gathered.brightness)
}

fn places(gathered: &DatasetStats) -> Markup {
    const TITLE: &str = "Middle of the contact";
    let contacts = total(&gathered.in_contact);
    if contacts == 0 {
        return page::figure(bars::nothing(TITLE, NO_CONTACT), "");
    }
    let [x, y] = gathered.places.cell_mm().map(figure);
    let (contacts, most) = (HumanCount(contacts), HumanCount(gathered.places.most()));
    let caption = format!("n {contacts} samples in contact, in cells of {x} x {y} mm; the darkest cell has {most}");
    page::figure(gathered.places.svg(TITLE, bars::SIZE[0]), caption)
}

/// Mean of every quantity in each split.
fn by_split(gathered: &DatasetStats) -> Markup {
    let row = |name: String, histogram: &Histogram| -> Option<Vec<String>> {
        let all = histogram.all();
        let told = |value: f64| bars::told(value, all.largest - all.least);
        let mean = |summary: &HistogramSummary| summary.mean().map_or(String::from("-"), told);
        let means = Split::ALL.map(|split| mean(histogram.summary(split)));
        let figures = [HumanCount(all.count).to_string(), told(all.least), told(all.largest), mean(&all)];
        (all.count > 0).then(|| [name].into_iter().chain(figures).chain(means).collect())
    };
    let quantities = QUANTITIES.iter().zip(&gathered.histograms);
    let rows = quantities.map(|(quantity, histogram)| row(quantity.name(), histogram));
    let last = row(String::from("Brightness of the image, grey levels"), &gathered.brightness);
    let rows: Vec<Vec<String>> = rows.chain([last]).flatten().collect();
    let head =
        ["", "n", "least", "largest", "mean"].map(|name| html! { (name) }).into_iter().chain(SPLITS.map(page::key));
    html! {
        @if !rows.is_empty() {
            h3 { "Means by split" }
            (page::table(head, rows))
        }
    }
}
