//! An AUGMENT.toml exactly as written.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::counterpart::Paired;
use super::photometric::Photometric;
use gelsim_core::fidelity::Fidelity;
use gelsim_core::pose::Anchor;
use gelsim_core::{gelpad, optics};
use gelsim_files::sensor::Sensor;
use gelsim_files::sensor::camera::CameraDistribution;
use gelsim_files::sensor::markers::MarkerDistribution;
use gelsim_job::config::dataset::Splits;
use gelsim_job::config::object::Object;
use gelsim_job::config::scene::Face;

/// How a real dataset is enlarged. Paths are relative to the file they stand in.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Augment {
    /// All randomness comes from this number, 0 to 2^53 - 1.
    pub seed: u64,
    /// The real dataset.
    #[schemars(required)]
    pub input: Input,
    /// Fidelity level of simulated counterparts.
    pub fidelity: Option<Fidelity>,
    /// Model of the gelpad's shape in simulated counterparts; the fidelity level's where it is left out.
    pub gelpad: Option<gelpad::Model>,
    /// Model of the light in simulated counterparts; the fidelity level's where it is left out.
    pub optics: Option<optics::Model>,
    /// The sensor that took the images, as in a job. Its resolution is the images' unless it is written here.
    pub sensor: Sensor,
    /// Dots printed on the pad; keys that are left out are the sensor's.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub markers: Option<MarkerDistribution>,
    /// The camera; keys that are left out are the sensor's.
    pub camera: CameraDistribution,
    /// Recipes for images as other LEDs, gelpads and cameras would have shown them.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub photometric: Vec<Photometric>,
    /// The simulated counterpart of each real sample whose object, pose and depth are known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub paired: Option<Paired>,
    /// How the objects of real samples are held.
    pub pose: PoseConvention,
    /// The objects of the real samples, for their counterparts.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub object: Vec<Object>,
    /// New synthetic samples among the real ones.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mixing: Option<Mixing>,
    /// What is written.
    pub output: Output,
}

/// The `[input]` table.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Input {
    /// A folder of images with a table of labels, with COCO annotations, with a folder for each class, of WebDataset tars, or
    /// in the layout of Hugging Face's imagefolder.
    #[schemars(required)]
    pub path: Option<String>,
    /// The table of labels in it, CSV or JSON Lines, or its COCO annotations; found by their usual names where it is left
    /// out. `"folders"`: the folders' names are the classes. Of tars: the end of the label's name, `json`.
    pub labels: Option<String>,
    /// The column with the image's file. Of tars: the end of the image's name, such as `tactile.png`.
    pub image: Option<String>,
    /// The folder that the images' names in the table start from, in the input's folder or the table's; the table's own
    /// where it is left out.
    pub images: Option<String>,
    /// A background image (the untouched pad), taken as the images were; or `"rendered"`, if the images are gelsim's
    /// own, for the one that the sensor renders.
    pub background: Option<String>,
    /// Which of its labels mean what.
    pub columns: Columns,
}

/// The `[input.columns]` table: names of columns, in JSON dotted paths. What is left out is the column of the same name,
/// where there is one.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Columns {
    /// Name of the object, which is the id or the class of an `[[object]]`.
    pub object: Option<String>,
    /// Class of the object.
    pub class: Option<String>,
    /// Split that the sample is in.
    pub split: Option<String>,
    /// What belongs together and stays in one split, such as a recording session.
    pub group: Option<String>,
    /// How deep the object's lowest point reaches below the undeformed pad, mm.
    pub depth_mm: Option<String>,
    /// Position along x, mm from the middle of the image.
    pub x_mm: Option<String>,
    /// Position along y, mm from the middle of the image.
    pub y_mm: Option<String>,
    /// Turn about z, degrees.
    pub yaw_deg: Option<String>,
    /// Tilt, degrees.
    pub tilt_deg: Option<String>,
    /// Direction of the tilt's axis, degrees.
    pub tilt_azimuth_deg: Option<String>,
    /// Part x of a quaternion that turns the object's axes to the sensor's; with the other three parts in place of face and
    /// angles.
    pub quaternion_x: Option<String>,
    /// Part y of it.
    pub quaternion_y: Option<String>,
    /// Part z of it.
    pub quaternion_z: Option<String>,
    /// Part w of it.
    pub quaternion_w: Option<String>,
}

/// The `[pose]` table: what the labels do not say of a real sample's pose.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct PoseConvention {
    /// Side of the objects that faces the pad, in their own axes.
    pub face: Face,
    /// The point of the turned object that the labels' x_mm and y_mm place; of labels that gelsim wrote it is the mesh's
    /// origin where it is left out.
    pub anchor: Anchor,
}

/// The `[mixing]` table.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Mixing {
    /// A job of `gelsim generate`, the source of new samples.
    #[schemars(required)]
    pub job: Option<String>,
    /// Synthetic samples for each real one, 0 to 1000.
    pub synthetic_per_real: Option<f64>,
    /// Samples that the whole dataset is to have, instead of a ratio: real ones, copies, counterparts and synthetic
    /// ones.
    pub total: Option<u64>,
    /// Which samples of the job are taken.
    pub toward: Toward,
    /// The splits that get synthetic samples; those for training where it is left out.
    pub splits: Option<Vec<String>>,
    /// Parts into which the range of depths is cut when coverage is counted, 1 to 100.
    pub depth_bins: u32,
    /// Parts into which the view's width and height are cut, 1 to 100.
    pub place_bins: u32,
    /// Parts into which the range of tilts is cut, 1 to 100.
    pub tilt_bins: u32,
}

impl Default for Mixing {
    fn default() -> Self {
        Self {
            job: None,
            synthetic_per_real: None,
            total: None,
            toward: Toward::default(),
            splits: None,
            depth_bins: 4,
            place_bins: 3,
            tilt_bins: 2,
        }
    }
}

/// Which samples of a job are taken.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Toward {
    /// As the job draws them.
    #[default]
    AsDrawn,
    /// Those that make the classes equally frequent, real samples included.
    Classes,
    /// Those that fill the cells of class, depth, place and tilt that have the fewest samples.
    Coverage,
}

/// The `[output]` table.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Output {
    /// Folder of the output; `out/` and the name of this file where it is left out.
    pub path: Option<String>,
    /// Fraction of the samples in each split, drawn anew; the input's own splits where it is left out.
    pub splits: Option<Splits>,
    /// What stays in one split.
    pub split_by: Option<SplitBy>,
    /// Put before the names of the columns `source`, `source_key` and `augmentation`.
    pub prefix: String,
}

/// What stays in one split.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SplitBy {
    /// A real sample with what was made of it.
    Sample,
    /// All samples of a group, as `input.columns.group` names it.
    Group,
    /// All samples of an object, synthetic ones included.
    Object,
}
