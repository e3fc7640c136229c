//! A sheet that is kept up to date while its job is edited: what a page shows of it, and what has changed since.
//!
//! One thread renders and many ask. A sample keeps its last pictures until it is rendered again, and all keep theirs
//! while the job is broken.

use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use serde::Serialize;
use serde_json::Value;

use super::canvas::shrink_panel;
use super::facts::{EffectFact, Fact, list_effects, list_facts};
use super::panel::{Panel, Ranges, Scales};
use super::{LayerSelection, Tile, TileRow};
use gelsim_files::png::encode_rgb;
use gelsim_job::plan::Plan;

/// A sheet, shared by the thread that renders it and those that answer questions.
pub struct LiveSheet {
    state: Mutex<SheetState>,
    changed: Condvar,
}

/// A rendered sample with its label.
pub struct LiveSample {
    tile: Tile,
    ranges: Ranges,
    health: String,
    label: LabelView,
}

/// What a page shows of a label.
#[derive(Clone, Debug, Serialize)]
struct LabelView {
    facts: Vec<Fact>,
    effects: Vec<EffectFact>,
    /// All of it.
    json: Value,
}

#[derive(Default)]
struct SheetState {
    /// Grows with every change.
    revision: u64,
    job: String,
    problem: String,
    notes: String,
    is_busy: bool,
    seconds: f64,
    slots: Vec<Slot>,
    scales: Scales,
    /// Revision in which the scales changed.
    scaled: u64,
}

/// The place of a sample on the sheet.
struct Slot {
    index: u64,
    sample: Option<Arc<LiveSample>>,
    /// The sample as it was before the last change.
    before: Option<Arc<LiveSample>>,
    /// Revision in which the sample came.
    revision: u64,
    is_current: bool,
}

/// What a page is told of a sheet.
#[derive(Serialize)]
struct SheetView<'a> {
    revision: u64,
    job: &'a str,
    problem: &'a str,
    notes: &'a str,
    is_busy: bool,
    seconds: f64,
    samples: Vec<SampleView<'a>>,
}

#[derive(Serialize)]
struct SampleView<'a> {
    index: u64,
    is_current: bool,
    has_before: bool,
    revision: u64,
    caption: &'a str,
    split: &'a str,
    /// Why the sample is not healthy; empty if it is.
    health: &'a str,
    rows: Vec<RowView>,
}

#[derive(Serialize)]
struct RowView {
    label: String,
    panels: Vec<PanelSummary>,
}

#[derive(Serialize)]
struct PanelSummary {
    heading: String,
    width: usize,
    height: usize,
    /// Changes with the picture.
    version: String,
}

impl LiveSample {
    /// Renders sample `index` of a plan, whose output must have the layers that are selected by name.
    pub fn render(plan: &Plan, index: u64, wanted: &LayerSelection) -> Self {
        let (tile, label) = Tile::render_with_label(plan, index, wanted);
        let health = &label.summary().health;
        Self {
            ranges: Ranges::from_panels(tile.panels()),
            health: if health.healthy { String::new() } else { health.reason.clone() },
            label: LabelView {
                facts: list_facts(&label),
                effects: list_effects(&label),
                json: serde_json::to_value(&label).unwrap_or_default(),
            },
            tile,
        }
    }
}

impl LiveSheet {
    /// Makes an empty sheet of the job with this name.
    pub fn new(job: String) -> Self {
        Self { state: Mutex::new(SheetState { job, ..SheetState::default() }), changed: Condvar::new() }
    }

    /// Begins to render samples with these numbers. Those that were there before stay until they come again.
    pub fn begin(&self, indices: &[u64]) {
        self.change(|state| {
            let mut before = std::mem::take(&mut state.slots);
            let slot = |&index: &u64| {
                let known = before.iter().position(|slot| slot.index == index).map(|at| before.swap_remove(at));
                let fresh = || Slot { index, sample: None, before: None, revision: 0, is_current: false };
                Slot { is_current: false, ..known.unwrap_or_else(fresh) }
            };
            state.slots = indices.iter().map(slot).collect();
            state.problem.clear();
            state.is_busy = true;
        });
    }

    /// Puts the sample with a number on the sheet.
    pub fn put(&self, index: u64, sample: LiveSample) {
        self.change(|state| {
            let revision = state.revision;
            if let Some(slot) = state.slots.iter_mut().find(|slot| slot.index == index) {
                let before = slot.sample.take();
                *slot = Slot { index, sample: Some(Arc::new(sample)), before, revision, is_current: true };
            }
            let mut ranges = Ranges::default();
            state.slots.iter().filter_map(|slot| slot.sample.as_ref()).for_each(|known| ranges.include(&known.ranges));
            let scales = Scales::from_ranges(&ranges);
            if scales != state.scales {
                (state.scales, state.scaled) = (scales, revision);
            }
        });
    }

    /// Says that all samples are there, after `seconds`, and what the user should know of the job.
    pub fn finish(&self, seconds: f64, notes: String) {
        self.change(|state| {
            (state.is_busy, state.seconds, state.notes) = (false, seconds, notes);
        });
    }

    /// Shows what is wrong with the job, over the sheet as it was.
    pub fn refuse(&self, problem: String) {
        self.change(|state| {
            state.problem = problem;
            state.is_busy = false;
        });
    }

    /// Removes what was wrong: the job is again the one that the sheet shows.
    pub fn mend(&self) {
        self.change(|state| state.problem.clear());
    }

    /// Waits until the sheet is no longer at this revision, but not longer than `most`, and describes it as JSON.
    pub fn describe_after(&self, revision: u64, most: Duration) -> String {
        let end = Instant::now() + most;
        let mut state = self.lock();
        while state.revision == revision {
            let left = end.saturating_duration_since(Instant::now());
            if left.is_zero() {
                break;
            }
            state = self.changed.wait_timeout(state, left).unwrap_or_else(PoisonError::into_inner).0;
        }
        serde_json::to_string(&state.view()).unwrap_or_default()
    }

    /// Encodes the picture in a row and column of sample `index` as a PNG file, at most `width` px wide: as it is, or as
    /// it was before the last change. None if it is not there.
    pub fn encode_picture(
        &self,
        index: u64,
        (row, column): (usize, usize),
        width: u32,
        is_before: bool,
    ) -> Option<Vec<u8>> {
        let (sample, scales) = {
            let state = self.lock();
            let slot = state.find_slot(index)?;
            let before = slot.before.clone().filter(|_| is_before);
            (before.or_else(|| slot.sample.clone())?, state.scales.clone())
        };
        let picture = shrink_panel(&sample.tile.rows.get(row)?.panels.get(column)?.to_picture(&scales), width);
        Some(encode_rgb(picture.width() as usize, picture.height() as usize, &picture))
    }

    /// Describes the label of sample `index` as JSON: facts in words, effects, all of it. None if it is not there.
    pub fn describe_label(&self, index: u64) -> Option<String> {
        let sample = self.lock().find_slot(index)?.sample.clone()?;
        serde_json::to_string(&sample.label).ok()
    }

    fn change(&self, change: impl FnOnce(&mut SheetState)) {
        let mut state = self.lock();
        state.revision += 1;
        change(&mut state);
        self.changed.notify_all();
    }

    fn lock(&self) -> MutexGuard<'_, SheetState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl SheetState {
    fn find_slot(&self, index: u64) -> Option<&Slot> {
        self.slots.iter().find(|slot| slot.index == index)
    }

    fn view(&self) -> SheetView<'_> {
        SheetView {
            revision: self.revision,
            job: &self.job,
            problem: &self.problem,
            notes: &self.notes,
            is_busy: self.is_busy,
            seconds: self.seconds,
            samples: self.slots.iter().map(|slot| slot.view(&self.scales, self.scaled)).collect(),
        }
    }
}

impl Slot {
    fn view(&self, scales: &Scales, scaled: u64) -> SampleView<'_> {
        let Self { index, revision, is_current, .. } = *self;
        let has_before = self.before.is_some();
        let Some(sample) = &self.sample else {
            let (caption, split, health) = ("", "", "");
            return SampleView { index, is_current, has_before, revision, caption, split, health, rows: Vec::new() };
        };
        let tile = &sample.tile;
        let headings = tile.headings(scales);
        let panel = |(column, panel): (usize, &Panel)| {
            let (width, height) = panel.size();
            let painted = if matches!(panel, Panel::Picture(_)) { 0 } else { scaled };
            let heading = headings.get(column).map_or_else(String::new, |heading| heading.text_lines().join(" "));
            PanelSummary { heading, width, height, version: format!("{revision}-{painted}") }
        };
        let row = |row: &TileRow| RowView {
            label: row.label_lines(scales).join(" "),
            panels: row.panels.iter().enumerate().map(panel).collect(),
        };
        SampleView {
            index,
            is_current,
            has_before,
            revision,
            caption: &tile.caption,
            split: tile.split.name(),
            health: &sample.health,
            rows: tile.rows.iter().map(row).collect(),
        }
    }
}
