//! Contact sheets: tactile image and layers of some samples, of a grip those of both fingers, of a sequence some frames; what it
//! is written under each, and one scale for all numbers of a layer.

use image::RgbImage;

use crate::page::letters;
use gelsim_core::camera::Image;
use gelsim_dataset::archive::{Files, Member};
use gelsim_dataset::content::{Content, content};
use gelsim_dataset::decode;
use gelsim_dataset::encode::{frame, make_shown};
use gelsim_dataset::labels::SampleLabel;
use gelsim_files::figures::figure;
use gelsim_files::image_file;
use gelsim_job::gripper::label::{GripFrameLabel, GripLabel};
use gelsim_job::label::{Label, key};
use gelsim_job::layers::{Form, OutputLayer};
use gelsim_job::layout::Split;
use gelsim_job::plan::Plan;
use gelsim_job::sample::{Sample, shown};
use gelsim_job::sequence::label::FrameLabel;
use gelsim_job::steps::Steps;

mod canvas;
pub mod choice;
pub mod effects;
pub mod film;
pub mod panel;
pub mod rows;
mod sheet;

pub use canvas::difference;
use canvas::{joined, shrunk};
use panel::{Panel, Scales, View};
pub use sheet::sheet;

/// One sample as a sheet shows it: rows of pictures under what their columns show.
pub struct Tile {
    columns: Vec<Column>,
    rows: Vec<Row>,
    caption: String,
    split: Split,
    index: u64,
}

/// What stands over a column.
#[derive(Clone, Debug, PartialEq)]
enum Column {
    /// One view of presses or grips.
    View(View),
    /// One frame of a sequence.
    Frame { t_s: String, phase: String },
}

/// One row of pictures.
struct Row {
    /// The finger that it is of, where there are two.
    finger: Option<&'static str>,
    /// What all of it shows, where that is said beside it.
    view: Option<View>,
    panels: Vec<Panel>,
}

/// Layers that a sheet shows beside the tactile image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LayerSelection {
    /// Of presses and grips depth and contact, where they are there; of sequences none.
    Usual,
    /// These, all of which must be there.
    These(Vec<OutputLayer>),
}

/// The layers of [`LayerSelection::Usual`].
const USUAL: [OutputLayer; 2] = [OutputLayer::Depth, OutputLayer::Contact];
/// Frames of a sequence that a sheet shows, at most.
const FRAMES: usize = 6;
/// Letters of a phase's name over a frame, at most.
const PHASE_LETTERS: usize = 20;

impl Tile {
    /// Renders sample `index` of a plan, whose output has the layers that are wanted by name.
    pub fn rendered(plan: &Plan, index: u64, wanted: &LayerSelection) -> Self {
        if plan.job().sequence.is_some() || plan.job().gripper.is_some() {
            return Self::read(&sample_files(plan, index), wanted).expect("files that were made just now");
        }
        let sample = shown(plan, index);
        let layers = match wanted {
            LayerSelection::Usual => USUAL.to_vec(),
            LayerSelection::These(layers) => layers.clone(),
        };
        let shown = layers.into_iter().filter_map(|layer| Some((View::Layer(layer), computed(&sample, layer)?)));
        let tactile = (View::Tactile, Panel::Picture(picture(&sample.impression.image)));
        let (views, panels): (Vec<View>, Vec<Panel>) = std::iter::once(tactile).chain(shown).unzip();
        let columns = views.into_iter().map(Column::View).collect();
        let rows = vec![Row { finger: None, view: None, panels }];
        Self::new(columns, rows, caption(&sample.label), &sample.label)
    }

    /// Shows a sample of a dataset from its files.
    pub fn read(files: &Files, wanted: &LayerSelection) -> Result<Self, String> {
        let named = |reason: String| format!("{}.json: {reason}", files.key);
        let json = files.member("json").ok_or_else(|| named(String::from("is not in the shard")))?;
        let label = SampleLabel::read(json).map_err(named)?;
        let summary = label.summary();
        match &label {
            SampleLabel::Press(_) => {
                let (columns, row) = read_row(files, None, wanted, &summary.png16)?;
                Ok(Self::new(columns, vec![row], caption(summary), summary))
            }
            SampleLabel::Grip(grip, _) => {
                let (mut columns, mut rows) = (Vec::new(), Vec::new());
                for (name, finger) in grip.fingers() {
                    let (found, row) = read_row(files, Some(name), wanted, &finger.png16)?;
                    columns = found;
                    rows.push(row);
                }
                Ok(Self::new(columns, rows, grip_caption(grip), summary))
            }
            SampleLabel::Sequence(sequence, _) => {
                let time = |FrameLabel { t_s, phase, .. }: &FrameLabel| (*t_s, phase.clone());
                let times: Vec<_> = sequence.frames.iter().map(time).collect();
                let fingers = [(None, &sequence.common.png16)];
                Self::of_frames(files, &times, &fingers, wanted, summary)
            }
            SampleLabel::GripSequence(sequence, _) => {
                let time = |GripFrameLabel { t_s, phase, .. }: &GripFrameLabel| (*t_s, phase.clone());
                let times: Vec<_> = sequence.frames.iter().map(time).collect();
                let fingers = [(Some("left"), &sequence.left.png16), (Some("right"), &sequence.right.png16)];
                Self::of_frames(files, &times, &fingers, wanted, summary)
            }
        }
    }

    /// Some frames of a sequence: a column for each, a row for each finger and view.
    fn of_frames(
        files: &Files,
        times: &[(f64, String)],
        fingers: &[(Option<&'static str>, &Steps)],
        wanted: &LayerSelection,
        summary: &Label,
    ) -> Result<Self, String> {
        let numbers = frames_shown(times.len());
        let columns = numbers.iter().map(|number| {
            let (t_s, phase) = &times[*number];
            Column::Frame { t_s: figure(*t_s), phase: letters::fitted(phase, PHASE_LETTERS) }
        });
        let layers = match wanted {
            LayerSelection::Usual => &[],
            LayerSelection::These(layers) => layers.as_slice(),
        };
        let mut rows = Vec::new();
        for (finger, steps) in fingers {
            for view in std::iter::once(View::Tactile).chain(layers.iter().copied().map(View::Layer)) {
                let part = |number: usize| {
                    let finger = finger.map_or(String::new(), |finger| format!("{finger}."));
                    format!("{}.{finger}", frame(number as u32))
                };
                let panels = numbers.iter().map(|number| needed(files, &part(*number), view, steps));
                let view = Some(view).filter(|_| !layers.is_empty());
                rows.push(Row { finger: *finger, view, panels: panels.collect::<Result<_, _>>()? });
            }
        }
        Ok(Self::new(columns.collect(), rows, caption(summary), summary))
    }

    fn new(columns: Vec<Column>, rows: Vec<Row>, caption: String, label: &Label) -> Self {
        Self { columns, rows, caption, split: label.header.split, index: label.header.index }
    }

    /// Class, depth and number.
    pub fn caption(&self) -> String {
        format!("{} #{}", self.caption, self.index)
    }

    /// When the frames were taken, by phase: `press 0.04, 0.28 s; slide 0.56 s`. Nothing of what is no sequence.
    pub fn times(&self) -> String {
        let mut phases: Vec<(&str, Vec<&str>)> = Vec::new();
        for column in &self.columns {
            let Column::Frame { t_s, phase } = column else { continue };
            match phases.last_mut().filter(|(last, _)| last == phase) {
                Some((_, times)) => times.push(t_s),
                None => phases.push((phase, vec![t_s])),
            }
        }
        let said = phases.iter().map(|(phase, times)| format!("{phase} {} s", times.join(", ")));
        said.collect::<Vec<_>>().join("; ")
    }

    /// All of its pictures.
    pub fn panels(&self) -> impl Iterator<Item = &Panel> {
        self.rows.iter().flat_map(|row| &row.panels)
    }

    /// True if it has pictures of a layer.
    pub fn shows(&self, layer: OutputLayer) -> bool {
        let wanted = View::Layer(layer);
        self.columns.contains(&Column::View(wanted)) || self.rows.iter().any(|row| row.view == Some(wanted))
    }

    /// True if it has pictures of two fingers.
    pub fn has_fingers(&self) -> bool {
        self.rows.iter().any(|row| row.finger.is_some())
    }

    /// Its pictures close to each other, each made `panel_width` px wide at the most.
    pub fn strip(&self, scales: &Scales, panel_width: u32) -> RgbImage {
        let drawn = |panel: &Panel| shrunk(&panel.picture(scales), panel_width);
        joined(&self.rows.iter().map(|row| row.panels.iter().map(drawn).collect()).collect::<Vec<_>>())
    }

    /// The same of the tactile images alone: one of a press, the frames of a sequence.
    pub fn tactile(&self, panel_width: u32) -> RgbImage {
        let tactile = |row: &&Row| row.view.is_none_or(|view| view == View::Tactile);
        let drawn = |row: &Row| {
            let shown = row.panels.iter().zip(&self.columns);
            let shown =
                shown.filter(|(_, column)| matches!(column, Column::Frame { .. } | Column::View(View::Tactile)));
            shown.map(|(panel, _)| shrunk(&panel.picture(&Scales::default()), panel_width)).collect::<Vec<_>>()
        };
        let rows: Vec<Vec<RgbImage>> = self.rows.iter().filter(tactile).map(drawn).collect();
        // The images of two fingers stand beside each other, their frames below each other.
        if rows.iter().all(|row| row.len() == 1) { joined(&[rows.concat()]) } else { joined(&rows) }
    }
}

/// Numbers of the frames that a sheet shows: the first, the last, and some between.
fn frames_shown(count: usize) -> Vec<usize> {
    let shown = count.min(FRAMES);
    (0..shown).map(|k| k * (count - 1) / (shown - 1).max(1)).collect()
}

/// The views of a press or of one finger, and its row.
fn read_row(
    files: &Files,
    finger: Option<&'static str>,
    wanted: &LayerSelection,
    steps: &Steps,
) -> Result<(Vec<Column>, Row), String> {
    let part = finger.map_or(String::new(), |finger| format!("{finger}."));
    let mut found = vec![(View::Tactile, needed(files, &part, View::Tactile, steps)?)];
    match wanted {
        LayerSelection::Usual => {
            for view in USUAL.map(View::Layer) {
                found.extend(read(files, &part, view, steps)?.map(|panel| (view, panel)));
            }
        }
        LayerSelection::These(layers) => {
            for view in layers.iter().copied().map(View::Layer) {
                found.push((view, needed(files, &part, view, steps)?));
            }
        }
    }
    let (views, panels): (Vec<View>, Vec<Panel>) = found.into_iter().unzip();
    Ok((views.into_iter().map(Column::View).collect(), Row { finger, view: None, panels }))
}

/// A picture that must be among the files.
fn needed(files: &Files, part: &str, view: View, steps: &Steps) -> Result<Panel, String> {
    let missing = || format!("{}.{part}{}: is not in the shard", files.key, view.name());
    read(files, part, view, steps)?.ok_or_else(missing)
}

/// A picture from a sample's files, whose names begin with `part`; none if it was written without it.
fn read(files: &Files, part: &str, view: View, steps: &Steps) -> Result<Option<Panel>, String> {
    let layer = match view {
        View::Layer(layer) if matches!(layer.spec().form, Form::Floats { .. }) => {
            let Some(planes) = decode::layer(files, part, layer, steps)? else { return Ok(None) };
            let size = [planes.width, planes.height];
            let planes: Vec<Vec<f32>> = planes.channels.into_iter().map(|(_, plane)| plane).collect();
            let panel = Panel::of_planes(layer, size, &planes);
            return panel.map(Some).ok_or_else(|| format!("{}.{part}{}: is no picture", files.key, view.name()));
        }
        view => view.name(),
    };
    let suffix = format!("{part}{layer}.png");
    let Some(png) = files.member(&suffix) else { return Ok(None) };
    let picture = image_file::decode_rgb(png).map_err(|reason| format!("{}.{suffix}: {reason}", files.key))?;
    Ok(Some(match view {
        View::Layer(OutputLayer::Instance) => {
            let numbers: Vec<u8> = picture.pixels().map(|pixel| pixel.0[0]).collect();
            let size = [picture.width() as usize, picture.height() as usize];
            Panel::of_bytes(OutputLayer::Instance, size, &numbers).expect("as many as pixels")
        }
        _ => Panel::Picture(picture),
    }))
}

/// A picture of a layer of a sample that was rendered; none of a layer that a picture cannot show.
fn computed(sample: &Sample, layer: OutputLayer) -> Option<Panel> {
    let Image { width, height, .. } = sample.impression.image;
    match content(sample, layer) {
        Content::Floats(values) => {
            let channels = layer.channels().len();
            let plane = |k: usize| values.iter().skip(k).step_by(channels).copied().collect();
            Panel::of_planes(layer, [width, height], &(0..channels).map(plane).collect::<Vec<_>>())
        }
        Content::Bytes(bytes) if layer.spec().form == Form::Rgb => {
            RgbImage::from_raw(width as u32, height as u32, bytes.into_owned()).map(Panel::Picture)
        }
        Content::Bytes(bytes) => Panel::of_bytes(layer, [width, height], &bytes),
        Content::Markers(_) => None,
    }
}

/// An image of the simulator's.
fn picture(image: &Image) -> RgbImage {
    let mut picture = RgbImage::new(image.width as u32, image.height as u32);
    picture.copy_from_slice(&image.rgb);
    picture
}

/// The files of a sample of a plan, made anew.
pub fn sample_files(plan: &Plan, index: u64) -> Files {
    let made = make_shown(plan, index);
    let file = |Member { suffix, bytes }| (suffix, bytes.into_vec().expect("nothing of it is spooled"));
    Files { key: key(index), members: made.members.into_iter().map(file).collect() }
}

/// The tactile image of a frame; `finger` is the name of a gripper's finger with a point behind it, or nothing.
fn frame_image(files: &Files, number: usize, finger: &str) -> Result<RgbImage, String> {
    let suffix = format!("{}.{finger}tactile.png", frame(number as u32));
    let png = files.member(&suffix).ok_or_else(|| format!("{}.{suffix}: is not in the shard", files.key))?;
    image_file::decode_rgb(png).map_err(|reason| format!("{}.{suffix}: {reason}", files.key))
}

fn caption(label: &Label) -> String {
    let depth = if label.contact.in_contact {
        format!("{:.2} mm", label.contact.max_depth_mm)
    } else {
        String::from("no contact")
    };
    let others = match label.objects.len() {
        0 | 1 => String::new(),
        count => format!(" and {} more", count - 1),
    };
    format!("{}{others}  {depth}", label.header.object.class)
}

/// Left finger, right finger, and how they hold the object.
fn grip_caption(label: &GripLabel) -> String {
    let deep = label.fingers().map(|(_, finger)| finger.contact.max_depth_mm);
    let held = if label.fingers().iter().any(|(_, finger)| finger.contact.in_contact) {
        let force = label.gripper.force_n.map_or(String::new(), |force| format!(" {force:.2} N"));
        format!("left {:.2} mm, right {:.2} mm{force}", deep[0], deep[1])
    } else {
        String::from("no contact")
    };
    format!("{}  {held}", label.header.object.class)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_and_the_last_frame_are_shown_and_some_between() {
        assert_eq!(frames_shown(35), [0, 6, 13, 20, 27, 34]);
        assert_eq!(frames_shown(3), [0, 1, 2]);
        assert_eq!((frames_shown(1), frames_shown(0)), (vec![0], vec![]));
    }
}
