//! The page of a set of sensors: a row for each dataset, with a link to its own page.

use maud::{Markup, html};

use super::DatasetReport;
use crate::numbers::{HumanBytes, HumanCount};
use crate::page;

/// What the page of a set shows of one of its datasets.
pub struct SetRow {
    folder: String,
    page: String,
    sensor: String,
    counts: [u64; 3],
    bytes: u64,
    warnings: usize,
}

impl SetRow {
    /// Takes the figures of the dataset in this folder of the set. Its own page is at `page`, seen from the set's.
    pub fn new(folder: String, page: String, dataset: &DatasetReport) -> Self {
        let gathered = &dataset.gathered;
        let counts = [gathered.samples.iter().sum(), gathered.in_contact.iter().sum(), gathered.unhealthy.total()];
        let sensor = dataset.recorded.job.sensor.name.clone();
        Self { folder, page, sensor, counts, bytes: gathered.totals.bytes, warnings: dataset.list_warnings().len() }
    }

    fn to_cells(&self) -> Vec<Markup> {
        let link = html! { a href=(self.page) { (self.folder) } };
        let counts = self.counts.map(|count| html! { (HumanCount(count)) });
        let [samples, in_contact, unhealthy] = counts;
        let bytes = html! { (HumanBytes(self.bytes)) };
        vec![link, html! { (self.sensor) }, samples, in_contact, unhealthy, bytes, html! { (self.warnings) }]
    }
}

/// Renders the page of a set called `name`.
pub fn render_set(name: &str, rows: &[SetRow]) -> String {
    let sum = |k: usize| HumanCount(rows.iter().map(|row| row.counts[k]).sum()).to_string();
    let bytes: u64 = rows.iter().map(|row| row.bytes).sum();
    let cards = [
        (rows.len().to_string(), "datasets"),
        (sum(0), "samples"),
        (sum(2), "not healthy"),
        (HumanBytes(bytes).to_string(), "in all"),
    ];
    let head = ["folder", "sensor", "samples", "in contact", "not healthy", "size", "warnings"];
    let body = html! {
        (page::render_cards(&cards))
        (page::render_table(head, rows.iter().map(SetRow::to_cells)))
        p.note { "Made by gelsim " (env!("CARGO_PKG_VERSION")) "." }
    };
    page::render_document(&format!("Set {name}"), &body)
}
