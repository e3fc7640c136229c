//! Contact sheets of samples: the tactile image and layers of a press, those of both fingers of a grip, some frames of
//! a sequence. Each sample has a caption, and all numbers of a layer share one scale. [`live`] keeps a sheet up to date.

use image::RgbImage;

use crate::page::letters;
use gelsim_core::camera::Image;
use gelsim_dataset::archive::{Member, SampleFiles};
use gelsim_dataset::content::{LayerContent, layer_content};
use gelsim_dataset::decode;
use gelsim_dataset::encode::{frame_name, make_sample_for_display};
use gelsim_dataset::labels::SampleLabel;
use gelsim_files::image_file;
use gelsim_files::number_format::format_number;
use gelsim_job::gripper::label::{GripFrameLabel, GripLabel};
use gelsim_job::label::{Label, sample_key};
use gelsim_job::layers::{LayerForm, OutputLayer};
use gelsim_job::layout::Split;
use gelsim_job::plan::Plan;
use gelsim_job::sample::{Sample, render_for_display};
use gelsim_job::sequence::label::FrameLabel;
use gelsim_job::steps::Steps;

mod canvas;
pub mod choice;
pub mod effects;
mod facts;
pub mod film;
pub mod live;
pub mod panel;
pub mod rows;
mod sheet;

pub use canvas::amplify_difference;
use canvas::{join_panels, shrink_panel};
use panel::{Heading, Panel, PanelView, Scales};
pub use sheet::draw_tile_sheet;

/// A sample on a sheet: rows of pictures below the headings of their columns.
pub struct Tile {
    columns: Vec<TileColumn>,
    rows: Vec<TileRow>,
    caption: String,
    split: Split,
    index: u64,
}

/// Heading of a column.
#[derive(Clone, Debug, PartialEq)]
enum TileColumn {
    /// One view of presses or grips.
    View(PanelView),
    /// One frame of a sequence.
    Frame { t_s: String, phase: String },
}

/// One row of pictures.
struct TileRow {
    /// Finger of the row, where there are two.
    finger: Option<&'static str>,
    /// View of all pictures of the row, if the columns do not say it.
    view: Option<PanelView>,
    panels: Vec<Panel>,
}

/// Layers that a sheet shows besides the tactile image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LayerSelection {
    /// Depth and contact of presses and grips, if they exist; no layer of sequences.
    Usual,
    /// These layers, all of which must exist.
    These(Vec<OutputLayer>),
}

/// Layers of [`LayerSelection::Usual`].
const USUAL: [OutputLayer; 2] = [OutputLayer::Depth, OutputLayer::Contact];
/// Most frames of a sequence that a sheet shows.
const MAX_FRAMES: usize = 6;
/// Most letters of a phase's name over a frame.
const PHASE_LETTERS: usize = 20;

impl Tile {
    /// Renders sample `index` of a plan, whose output must have the layers that are selected by name.
    pub fn render_sample(plan: &Plan, index: u64, wanted: &LayerSelection) -> Self {
        Self::render_with_label(plan, index, wanted).0
    }

    /// Renders a sample as [`Self::render_sample`] does, and returns its label, too.
    pub fn render_with_label(plan: &Plan, index: u64, wanted: &LayerSelection) -> (Self, SampleLabel) {
        if plan.job().sequence.is_some() || plan.job().gripper.is_some() {
            return Self::from_labelled_files(&make_sample_files(plan, index), wanted)
                .expect("files that were made just now");
        }
        let sample = render_for_display(plan, index);
        let layers = match wanted {
            LayerSelection::Usual => USUAL.to_vec(),
            LayerSelection::These(layers) => layers.clone(),
        };
        let shown =
            layers.into_iter().filter_map(|layer| Some((PanelView::Layer(layer), layer_panel(&sample, layer)?)));
        let tactile = (PanelView::Tactile, Panel::Picture(image_to_rgb(&sample.impression.image)));
        let (views, panels): (Vec<PanelView>, Vec<Panel>) = std::iter::once(tactile).chain(shown).unzip();
        let columns = views.into_iter().map(TileColumn::View).collect();
        let rows = vec![TileRow { finger: None, view: None, panels }];
        let tile = Self::new(columns, rows, press_caption(&sample.label), &sample.label);
        (tile, SampleLabel::Press(Box::new(sample.label)))
    }

    /// Makes the tile of a dataset's sample from its files. An error names the file that is missing or cannot be read.
    pub fn from_files(files: &SampleFiles, wanted: &LayerSelection) -> Result<Self, String> {
        Self::from_labelled_files(files, wanted).map(|(tile, _)| tile)
    }

    fn from_labelled_files(files: &SampleFiles, wanted: &LayerSelection) -> Result<(Self, SampleLabel), String> {
        let named = |reason: String| format!("{}.json: {reason}", files.key);
        let json = files.find_member("json").ok_or_else(|| named(String::from("is not in the shard")))?;
        let label = SampleLabel::read(json).map_err(named)?;
        let summary = label.summary();
        let tile = match &label {
            SampleLabel::Press(_) => {
                let (columns, row) = read_row(files, None, wanted, &summary.png16)?;
                Self::new(columns, vec![row], press_caption(summary), summary)
            }
            SampleLabel::Grip(grip, _) => {
                let (mut columns, mut rows) = (Vec::new(), Vec::new());
                for (name, finger) in grip.fingers() {
                    let (found, row) = read_row(files, Some(name), wanted, &finger.png16)?;
                    columns = found;
                    rows.push(row);
                }
                Self::new(columns, rows, grip_caption(grip), summary)
            }
            SampleLabel::Sequence(sequence, _) => {
                let time = |FrameLabel { t_s, phase, .. }: &FrameLabel| (*t_s, phase.clone());
                let times: Vec<_> = sequence.frames.iter().map(time).collect();
                let fingers = [(None, &sequence.common.png16)];
                Self::from_frames(files, &times, &fingers, wanted, summary)?
            }
            SampleLabel::GripSequence(sequence, _) => {
                let time = |GripFrameLabel { t_s, phase, .. }: &GripFrameLabel| (*t_s, phase.clone());
                let times: Vec<_> = sequence.frames.iter().map(time).collect();
                let fingers = [(Some("left"), &sequence.left.png16), (Some("right"), &sequence.right.png16)];
                Self::from_frames(files, &times, &fingers, wanted, summary)?
            }
        };
        Ok((tile, label))
    }

    /// Makes the tile of a sequence: a column for each of some frames, a row for each finger and view.
    fn from_frames(
        files: &SampleFiles,
        times: &[(f64, String)],
        fingers: &[(Option<&'static str>, &Steps)],
        wanted: &LayerSelection,
        summary: &Label,
    ) -> Result<Self, String> {
        let numbers = choose_frames(times.len());
        let columns = numbers.iter().map(|number| {
            let (t_s, phase) = &times[*number];
            TileColumn::Frame { t_s: format_number(*t_s), phase: letters::truncate_text(phase, PHASE_LETTERS) }
        });
        let layers = match wanted {
            LayerSelection::Usual => &[],
            LayerSelection::These(layers) => layers.as_slice(),
        };
        let mut rows = Vec::new();
        for (finger, steps) in fingers {
            for view in std::iter::once(PanelView::Tactile).chain(layers.iter().copied().map(PanelView::Layer)) {
                let part = |number: usize| {
                    let finger = finger.map_or(String::new(), |finger| format!("{finger}."));
                    format!("{}.{finger}", frame_name(number as u32))
                };
                let panels = numbers.iter().map(|number| require_panel(files, &part(*number), view, steps));
                let view = Some(view).filter(|_| !layers.is_empty());
                rows.push(TileRow { finger: *finger, view, panels: panels.collect::<Result<_, _>>()? });
            }
        }
        Ok(Self::new(columns.collect(), rows, press_caption(summary), summary))
    }

    fn new(columns: Vec<TileColumn>, rows: Vec<TileRow>, caption: String, label: &Label) -> Self {
        Self { columns, rows, caption, split: label.header.split, index: label.header.index }
    }

    /// Headings of the columns.
    fn headings(&self, scales: &Scales) -> Vec<Heading> {
        let heading = |column: &TileColumn| match column {
            TileColumn::View(view) => Heading::from_view(*view, scales),
            TileColumn::Frame { t_s, phase } => Heading::from_words(format!("{t_s} s {phase}")),
        };
        self.columns.iter().map(heading).collect()
    }

    /// Caption: class, depth and number.
    pub fn caption(&self) -> String {
        format!("{} #{}", self.caption, self.index)
    }

    /// Lists when the frames were taken, by phase: `press 0.04, 0.28 s; slide 0.56 s`. Empty if the sample is no
    /// sequence.
    pub fn frame_times(&self) -> String {
        let mut phases: Vec<(&str, Vec<&str>)> = Vec::new();
        for column in &self.columns {
            let TileColumn::Frame { t_s, phase } = column else { continue };
            match phases.last_mut().filter(|(last, _)| last == phase) {
                Some((_, times)) => times.push(t_s),
                None => phases.push((phase, vec![t_s])),
            }
        }
        let said = phases.iter().map(|(phase, times)| format!("{phase} {} s", times.join(", ")));
        said.collect::<Vec<_>>().join("; ")
    }

    /// Returns all pictures.
    pub fn panels(&self) -> impl Iterator<Item = &Panel> {
        self.rows.iter().flat_map(|row| &row.panels)
    }

    /// Returns true if there are pictures of a layer.
    pub fn has_layer(&self, layer: OutputLayer) -> bool {
        let wanted = PanelView::Layer(layer);
        self.columns.contains(&TileColumn::View(wanted)) || self.rows.iter().any(|row| row.view == Some(wanted))
    }

    /// Returns true if there are pictures of two fingers.
    pub fn has_fingers(&self) -> bool {
        self.rows.iter().any(|row| row.finger.is_some())
    }

    /// Draws all pictures close to each other, each at most `panel_width` px wide.
    pub fn to_strip(&self, scales: &Scales, panel_width: u32) -> RgbImage {
        let drawn = |panel: &Panel| shrink_panel(&panel.to_picture(scales), panel_width);
        join_panels(&self.rows.iter().map(|row| row.panels.iter().map(drawn).collect()).collect::<Vec<_>>())
    }

    /// Draws the tactile images alone, close to each other: that of a press, or the frames of a sequence.
    pub fn to_tactile_strip(&self, panel_width: u32) -> RgbImage {
        let tactile = |row: &&TileRow| row.view.is_none_or(|view| view == PanelView::Tactile);
        let drawn = |row: &TileRow| {
            let shown = row.panels.iter().zip(&self.columns);
            let shown = shown.filter(|(_, column)| {
                matches!(column, TileColumn::Frame { .. } | TileColumn::View(PanelView::Tactile))
            });
            shown.map(|(panel, _)| shrink_panel(&panel.to_picture(&Scales::default()), panel_width)).collect::<Vec<_>>()
        };
        let rows: Vec<Vec<RgbImage>> = self.rows.iter().filter(tactile).map(drawn).collect();
        // Single images of two fingers stand side by side; frames of two fingers in two rows.
        if rows.iter().all(|row| row.len() == 1) { join_panels(&[rows.concat()]) } else { join_panels(&rows) }
    }
}

impl TileRow {
    /// Lines of text beside the row: finger and view, as far as the columns do not say it.
    fn label_lines(&self, scales: &Scales) -> Vec<String> {
        let view = self.view.iter().flat_map(|view| Heading::from_view(*view, scales).text_lines());
        self.finger.map(str::to_owned).into_iter().chain(view).collect()
    }
}

/// Chooses the frames that a sheet shows: the first, the last, and some between.
fn choose_frames(count: usize) -> Vec<usize> {
    let shown = count.min(MAX_FRAMES);
    (0..shown).map(|k| k * (count - 1) / (shown - 1).max(1)).collect()
}

/// Reads the pictures of a press or of one finger, and the headings of their columns.
fn read_row(
    files: &SampleFiles,
    finger: Option<&'static str>,
    wanted: &LayerSelection,
    steps: &Steps,
) -> Result<(Vec<TileColumn>, TileRow), String> {
    let part = finger.map_or(String::new(), |finger| format!("{finger}."));
    let mut found = vec![(PanelView::Tactile, require_panel(files, &part, PanelView::Tactile, steps)?)];
    match wanted {
        LayerSelection::Usual => {
            for view in USUAL.map(PanelView::Layer) {
                found.extend(read_panel(files, &part, view, steps)?.map(|panel| (view, panel)));
            }
        }
        LayerSelection::These(layers) => {
            for view in layers.iter().copied().map(PanelView::Layer) {
                found.push((view, require_panel(files, &part, view, steps)?));
            }
        }
    }
    let (views, panels): (Vec<PanelView>, Vec<Panel>) = found.into_iter().unzip();
    Ok((views.into_iter().map(TileColumn::View).collect(), TileRow { finger, view: None, panels }))
}

/// Reads a picture that must be among the files.
fn require_panel(files: &SampleFiles, part: &str, view: PanelView, steps: &Steps) -> Result<Panel, String> {
    let missing = || format!("{}.{part}{}: is not in the shard", files.key, view.name());
    read_panel(files, part, view, steps)?.ok_or_else(missing)
}

/// Reads a picture from a sample's files whose names begin with `part`; none if the sample does not have it.
fn read_panel(files: &SampleFiles, part: &str, view: PanelView, steps: &Steps) -> Result<Option<Panel>, String> {
    let layer = match view {
        PanelView::Layer(layer) if matches!(layer.spec().form, LayerForm::Floats { .. }) => {
            let Some(planes) = decode::decode_layer(files, part, layer, steps)? else { return Ok(None) };
            let size = [planes.width, planes.height];
            let planes: Vec<Vec<f32>> = planes.channels.into_iter().map(|(_, plane)| plane).collect();
            let panel = Panel::from_planes(layer, size, &planes);
            return panel.map(Some).ok_or_else(|| format!("{}.{part}{}: is no picture", files.key, view.name()));
        }
        view => view.name(),
    };
    let suffix = format!("{part}{layer}.png");
    let Some(png) = files.find_member(&suffix) else { return Ok(None) };
    let picture = image_file::decode_rgb(png).map_err(|reason| format!("{}.{suffix}: {reason}", files.key))?;
    Ok(Some(match view {
        PanelView::Layer(OutputLayer::Instance) => {
            let numbers: Vec<u8> = picture.pixels().map(|pixel| pixel.0[0]).collect();
            let size = [picture.width() as usize, picture.height() as usize];
            Panel::from_bytes(OutputLayer::Instance, size, &numbers).expect("as many as pixels")
        }
        _ => Panel::Picture(picture),
    }))
}

/// Makes the picture of a layer of a rendered sample; none for a layer that a picture cannot show.
fn layer_panel(sample: &Sample, layer: OutputLayer) -> Option<Panel> {
    let Image { width, height, .. } = sample.impression.image;
    match layer_content(sample, layer) {
        LayerContent::Floats(values) => {
            let channels = layer.channels().len();
            let plane = |k: usize| values.iter().skip(k).step_by(channels).copied().collect();
            Panel::from_planes(layer, [width, height], &(0..channels).map(plane).collect::<Vec<_>>())
        }
        LayerContent::Bytes(bytes) if layer.spec().form == LayerForm::Rgb => {
            RgbImage::from_raw(width as u32, height as u32, bytes.into_owned()).map(Panel::Picture)
        }
        LayerContent::Bytes(bytes) => Panel::from_bytes(layer, [width, height], &bytes),
        LayerContent::Markers(_) => None,
    }
}

/// Turns an image of the simulator into a picture.
fn image_to_rgb(image: &Image) -> RgbImage {
    let mut picture = RgbImage::new(image.width as u32, image.height as u32);
    picture.copy_from_slice(&image.rgb);
    picture
}

/// Renders the files of a sample of a plan.
pub fn make_sample_files(plan: &Plan, index: u64) -> SampleFiles {
    let made = make_sample_for_display(plan, index);
    let file = |Member { suffix, bytes }| (suffix, bytes.into_vec().expect("nothing of it is spooled"));
    SampleFiles { key: sample_key(index), members: made.members.into_iter().map(file).collect() }
}

/// Reads the tactile image of a frame; `finger` is the name of a gripper's finger followed by a point, or empty.
fn read_frame_image(files: &SampleFiles, number: usize, finger: &str) -> Result<RgbImage, String> {
    let suffix = format!("{}.{finger}tactile.png", frame_name(number as u32));
    let png = files.find_member(&suffix).ok_or_else(|| format!("{}.{suffix}: is not in the shard", files.key))?;
    image_file::decode_rgb(png).map_err(|reason| format!("{}.{suffix}: {reason}", files.key))
}

/// Caption of a press: class and depth.
fn press_caption(label: &Label) -> String {
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

/// Caption of a grip: class, depth of both fingers, and the force between them.
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
        assert_eq!(choose_frames(35), [0, 6, 13, 20, 27, 34]);
        assert_eq!(choose_frames(3), [0, 1, 2]);
        assert_eq!((choose_frames(1), choose_frames(0)), (vec![0], vec![]));
    }
}
