//! What a fidelity level costs in a job of sequences: errors of force, slip and the pad's motion against the level
//! `reference` at four times the frame rate, and CPU time.

use crate::text_table::TextTable;
use std::convert::Infallible;

use maud::Markup;
use serde::Serialize;

use crate::page::canvas::{Colour, Shape, TextAlign};
use crate::page::plot::{BLACK, Plot, TEXT_STYLE};
use gelsim_core::fidelity::Fidelity;
use gelsim_job::plan::Plan;
use gelsim_job::sequence::label::{SequenceInfo, SequenceLabel};
use gelsim_job::sequence::motion;
use gelsim_job::sequence::render;

/// Factor of the reference's frame rate.
const TIME_REFINEMENT: u64 = 4;

/// Most frames of a sequence in which motion is compared.
const MAX_FRAMES: usize = 24;

/// Errors of a level against the reference, over all sequences.
#[derive(Clone, Debug, Serialize)]
pub struct SequenceLevelRow {
    /// Name of the level.
    pub level: &'static str,
    /// Error of the force, root mean square over frames, percent of the sequence's largest force.
    pub force_percent: f64,
    /// Largest error of the force in a frame, percent.
    pub force_max_percent: f64,
    /// Error of the onset of slip, mean, ms; none if no sequence slips.
    pub slip_ms: Option<f64>,
    /// Error of the onset of gross slip, mean, ms; none if no sequence has gross slip.
    pub gross_slip_ms: Option<f64>,
    /// Number of onsets, of slip and of gross slip, that only one of level and reference has.
    pub slips_differently: u64,
    /// Error of the pad's motion in its plane, root mean square over pixels and frames, um.
    pub flow_um: f64,
    /// Largest error of that motion, um.
    pub flow_max_um: f64,
    /// CPU time of a frame on one thread, without writing files, ms.
    pub frame_ms: f64,
}

/// All levels on some sequences of a job.
#[derive(Clone, Debug, Serialize)]
pub struct SequenceTradeoff {
    /// Name of the job.
    pub name: String,
    /// Frame rate of the job, Hz.
    pub frame_rate_hz: f64,
    /// Number of sequences that were rendered.
    pub sequences: u64,
    /// Number of their frames.
    pub frames: u64,
    /// Levels, the cheapest first.
    pub rows: Vec<SequenceLevelRow>,
}

/// What is compared of a rendered sequence.
struct RenderedSequence {
    label: SequenceLabel,
    /// For some frames: number, and in-plane motion of every pixel, mm.
    flows: Vec<(usize, Vec<[f32; 2]>)>,
    seconds: f64,
}

fn render_sequence(plan: &Plan, index: u64, wanted: impl Fn(usize) -> bool) -> RenderedSequence {
    let mut flows = Vec::new();
    let Ok(done) = render(plan, index, 0, |sample, number| {
        if wanted(number as usize) {
            flows.push((number as usize, sample.impression.flow_mm()));
        }
        Ok::<(), Infallible>(())
    });
    RenderedSequence { label: done.label, flows, seconds: done.seconds.simulation() }
}

/// Renders `count` sequences of a plan at every level that computes tractions. Calls `heard` with what is done next.
pub fn measure_sequence_tradeoff(plan: &Plan, count: u64, mut heard: impl FnMut(&str)) -> SequenceTradeoff {
    let count = count.min(plan.layout.sample_count());
    let of_level = |level: Fidelity| plan.with_fidelity(level).with_flow();
    let levels = [Fidelity::Draft, Fidelity::Standard, Fidelity::High, Fidelity::Reference];
    let plans: Vec<(Fidelity, Plan)> = levels.into_iter().map(|level| (level, of_level(level))).collect();
    let truth = of_level(Fidelity::Reference).with_frame_rate(TIME_REFINEMENT as f64);
    let mut sums: Vec<SequenceErrorSums> = levels.iter().map(|_| SequenceErrorSums::default()).collect();
    let mut frames = 0;
    for number in 0..count {
        // Evenly from the whole job.
        let index = number * plan.layout.sample_count() / count;
        heard(&format!("sequence {} of {count}, reference at {TIME_REFINEMENT} times the frame rate", number + 1));
        // A first run without motion finds the number of frames, from which those to compare are chosen.
        let first = render_sequence(&plans[0].1, index, |_| false).label;
        let total = first.frames.len();
        let SequenceInfo { frame_rate_hz, phases, .. } = &first.common.sequence;
        let duration_s: f64 = phases.iter().map(|phase| phase.duration_s).sum();
        let fine_total = motion::count_frames(duration_s, TIME_REFINEMENT as f64 * frame_rate_hz) as usize;
        let stride = total.div_ceil(MAX_FRAMES).max(1);
        let chosen = |frame: usize| frame % stride == stride - 1 || frame + 1 == total;
        let fine = |frame: usize| {
            frame + 1 == fine_total
                || (frame + 1).is_multiple_of(TIME_REFINEMENT as usize) && chosen(frame / TIME_REFINEMENT as usize)
        };
        let reference = render_sequence(&truth, index, fine);
        frames += total as u64;
        for ((level, plan), sums) in plans.iter().zip(&mut sums) {
            heard(&format!("sequence {} of {count}, {}", number + 1, level.name()));
            sums.add(&render_sequence(plan, index, chosen), &reference);
        }
    }
    let rows = plans.iter().zip(sums).map(|((level, _), sums)| sums.to_row(level.name())).collect();
    let frame_rate_hz = plan.job().sequence.as_ref().map_or(0.0, |sequence| sequence.frame_rate_hz);
    SequenceTradeoff { name: plan.name().to_owned(), frame_rate_hz, sequences: count, frames, rows }
}

#[derive(Default)]
struct SequenceErrorSums {
    force: f64,
    force_max: f64,
    frames: u64,
    slip: (f64, u64),
    gross: (f64, u64),
    differently: u64,
    flow: f64,
    pixels: u64,
    flow_max: f64,
    seconds: f64,
}

impl SequenceErrorSums {
    fn add(&mut self, seen: &RenderedSequence, reference: &RenderedSequence) {
        let force =
            |label: &SequenceLabel, frame: usize| label.frames[frame.min(label.frames.len() - 1)].wrench.force_n;
        let size = |force: [f64; 3]| force.iter().map(|part| part * part).sum::<f64>();
        let finer = |frame: usize| TIME_REFINEMENT as usize * (frame + 1) - 1;
        let largest = (0..reference.label.frames.len()).map(|k| size(force(&reference.label, k))).fold(1e-12, f64::max);
        for frame in 0..seen.label.frames.len() {
            let (a, b) = (force(&seen.label, frame), force(&reference.label, finer(frame)));
            let off = size(std::array::from_fn(|k| a[k] - b[k])) / largest;
            self.force += off;
            self.force_max = self.force_max.max(off);
            self.frames += 1;
        }
        let (own, truth) = (&seen.label.common.sequence, &reference.label.common.sequence);
        let mut onset = |a: Option<f64>, b: Option<f64>, sum: fn(&mut Self) -> &mut (f64, u64)| match (a, b) {
            (Some(a), Some(b)) => {
                let sum = sum(self);
                *sum = (sum.0 + 1e3 * (a - b).abs(), sum.1 + 1);
            }
            (None, None) => {}
            _ => self.differently += 1,
        };
        onset(own.first_slip_s, truth.first_slip_s, |sums| &mut sums.slip);
        onset(own.gross_slip_s, truth.gross_slip_s, |sums| &mut sums.gross);
        for (frame, flow) in &seen.flows {
            // The last frame ends the sequence in both, also where it is no multiple of the frame time.
            let at = finer(*frame);
            let found = reference.flows.iter().find(|(number, _)| *number == at).or(reference.flows.last());
            for (a, b) in flow.iter().zip(found.into_iter().flat_map(|(_, flow)| flow)) {
                let off = f64::from(a[0] - b[0]).powi(2) + f64::from(a[1] - b[1]).powi(2);
                self.flow += off;
                self.flow_max = self.flow_max.max(off);
                self.pixels += 1;
            }
        }
        self.seconds += seen.seconds;
    }

    fn to_row(&self, level: &'static str) -> SequenceLevelRow {
        let mean = |(sum, count): (f64, u64)| (count > 0).then(|| sum / count as f64);
        let root = |sum: f64, count: u64| libm::sqrt(sum / count.max(1) as f64);
        SequenceLevelRow {
            level,
            force_percent: 100.0 * root(self.force, self.frames),
            force_max_percent: 100.0 * libm::sqrt(self.force_max),
            slip_ms: mean(self.slip),
            gross_slip_ms: mean(self.gross),
            slips_differently: self.differently,
            flow_um: 1e3 * root(self.flow, self.pixels),
            flow_max_um: 1e3 * libm::sqrt(self.flow_max),
            frame_ms: 1e3 * self.seconds / self.frames.max(1) as f64,
        }
    }
}

const TABLE_HEAD: [&str; 9] = [
    "level",
    "force_percent",
    "force_max_percent",
    "slip_ms",
    "gross_slip_ms",
    "slips_differently",
    "flow_um",
    "flow_max_um",
    "frame_ms",
];

fn row_cells(row: &SequenceLevelRow) -> [String; 9] {
    let some = |value: Option<f64>| value.map_or(String::from("-"), |value| format!("{value:.1}"));
    [
        row.level.to_owned(),
        format!("{:.3}", row.force_percent),
        format!("{:.2}", row.force_max_percent),
        some(row.slip_ms),
        some(row.gross_slip_ms),
        row.slips_differently.to_string(),
        format!("{:.2}", row.flow_um),
        format!("{:.1}", row.flow_max_um),
        format!("{:.1}", row.frame_ms),
    ]
}

impl SequenceTradeoff {
    /// Formats a table for a terminal of `columns`.
    pub fn to_text_table(&self, columns: Option<usize>) -> String {
        let (sequences, frames, rate) = (self.sequences, self.frames, self.frame_rate_hz);
        let mut text = format!(
            "{}: {sequences} sequences of {frames} frames at {rate} Hz; errors against reference at {TIME_REFINEMENT} times the frame rate, \
             CPU time on one thread, files not counted\n\n",
            self.name
        );
        let mut table = TextTable::new(&[
            ["level", "force", "largest", "slip", "gross", "other", "flow", "flow", "CPU ms"],
            ["", "RMS %", "%", "off ms", "off ms", "slip", "RMS um", "max um", "a frame"],
        ]);
        self.rows.iter().for_each(|row| table.add_row(row_cells(row)));
        text += &table.render(columns);
        text
    }

    /// Writes the rows as CSV, without the dash of unknown values.
    pub fn to_csv(&self) -> String {
        let rows = self.rows.iter().map(|row| row_cells(row).join(",").replace('-', ""));
        [TABLE_HEAD.join(",")].into_iter().chain(rows).collect::<Vec<_>>().join("\n") + "\n"
    }

    /// Draws the error of the pad's motion over the CPU time.
    pub fn to_svg(&self) -> Markup {
        const COLOUR: Colour = [0, 114, 178];
        let most = |of: fn(&SequenceLevelRow) -> f64| 1.15 * self.rows.iter().map(of).fold(0.0, f64::max);
        let ranges = [[0.0, most(|row| row.frame_ms)], [0.0, most(|row| row.flow_um)]];
        let title = format!("{}: motion of the pad, um RMS", self.name);
        let mut plot = Plot::new([520.0, 340.0], &title, ["CPU ms a frame", ""], ranges);
        for row in &self.rows {
            let at = plot.to_canvas([row.frame_ms, row.flow_um]);
            plot.canvas.draw_mark(Shape::Circle, at, 5.0, COLOUR, BLACK);
            plot.canvas.draw_text([at[0] + 8.0, at[1] - 6.0], row.level, TEXT_STYLE, TextAlign::Left);
        }
        plot.to_svg()
    }
}
