//! The layers of a sample beside its tactile image. One table has a row for each; jobs, files, labels' scales, the
//! dataset card, verification, the report and Python's arrays follow from it.
//!
//! A new layer needs a variant of [`OutputLayer`], its row of `LAYER_SPECS` here, and the code that computes its values
//! (`gelsim_dataset::content`).

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use gelsim_core::impression::OUT_OF_REACH_MM;
use gelsim_files::exr::Pixel;

/// A layer of a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(rename = "Layer")]
pub enum OutputLayer {
    /// Depth of the object below the undeformed pad surface, mm.
    Depth,
    /// Displacement of the pad's surface, mm, positive into the pad.
    Surface,
    /// 255 where the pad touches the object.
    Contact,
    /// Unit normals of the pad's surface, towards the camera.
    Normal,
    /// Pressure between pad and object, kPa; only from models that solve the contact.
    Pressure,
    /// Clearance between the pad's surface and the object above it, mm.
    Gap,
    /// Rest and moved positions of printed markers; only for sensors that have them.
    Markers,
    /// The image without any contact.
    Reference,
    /// The grey image under each lamp; only for sensors whose lamps were measured one by one.
    Lamps,
    /// 128 where the pad sticks to the object, 255 where it slips, 0 elsewhere; only for sequences.
    Slip,
    /// Motion of the pad's surface in its own plane since it was untouched, mm; only from models that compute it.
    Flow,
    /// Force of the object on the pad by area, kPa: along the pad to the right and down, and into the pad.
    Traction,
    /// Tips of the pins at rest and now; only for sensors that have them.
    Pins,
    /// Points of the pad's surface, one for each pixel, mm in the sensor's frame.
    Points,
    /// The number of the object that the pad touches, counted from 1 in the order of the label's `objects`, or 0 if it
    /// touches none.
    Instance,
    /// The image without any contact, taken by the sample's own camera at another moment, with noise.
    Untouched,
}

/// All that is needed to write, read, check and describe a layer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LayerSpec {
    /// The layer of this row.
    pub layer: OutputLayer,
    /// Name in jobs, files, labels and Python.
    pub name: &'static str,
    /// Form of the values.
    pub form: LayerForm,
    /// Unit of the values, if they are measures.
    pub unit: Option<&'static str>,
    /// Meaning of the values, for the dataset card.
    pub meaning: &'static str,
}

/// Form of the values of a layer, and how they may be stored.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LayerForm {
    /// Measured numbers: float32 in memory.
    Floats {
        /// Names of the channels, one letter each, in alphabetical order.
        channels: &'static [&'static str],
        /// Lower bound of the values.
        least: f32,
        /// Precision in EXR files, if the job does not choose it.
        pixel: Option<Pixel>,
        /// Scale of 16-bit steps, for layers with a range that suits them.
        steps: Option<StepScale>,
    },
    /// One byte per pixel.
    Grey,
    /// Red, green and blue, a byte each.
    Rgb,
    /// Positions of markers or pins, in pixels.
    Positions,
}

/// The row of every layer, in the order in which a sample's files are written.
const LAYER_SPECS: [LayerSpec; 16] = [
    LayerSpec {
        layer: OutputLayer::Depth,
        name: "depth",
        form: LayerForm::Floats { channels: &["Z"], least: 0.0, pixel: None, steps: Some(StepScale::Depth) },
        unit: Some("mm"),
        meaning: "how far the object reaches below the undeformed pad, 0 where it does not",
    },
    LayerSpec {
        layer: OutputLayer::Surface,
        name: "surface",
        form: LayerForm::Floats {
            channels: &["Z"],
            least: f32::NEG_INFINITY,
            pixel: None,
            steps: Some(StepScale::Surface),
        },
        unit: Some("mm"),
        meaning: "displacement of the pad's surface, positive into the pad",
    },
    LayerSpec {
        layer: OutputLayer::Contact,
        name: "contact",
        form: LayerForm::Grey,
        unit: None,
        meaning: "8-bit grey, 255 where the pad touches",
    },
    LayerSpec {
        layer: OutputLayer::Normal,
        name: "normal",
        form: LayerForm::Floats { channels: &["X", "Y", "Z"], least: f32::NEG_INFINITY, pixel: None, steps: None },
        unit: None,
        meaning: "unit normals of the surface towards the camera; a flat pad is (0, 0, -1)",
    },
    LayerSpec {
        layer: OutputLayer::Pressure,
        name: "pressure",
        // Half floats end at 65504 kPa, which a stiff pad exceeds.
        form: LayerForm::Floats { channels: &["P"], least: 0.0, pixel: Some(Pixel::Float), steps: None },
        unit: Some("kPa"),
        meaning: "pressure between pad and object",
    },
    LayerSpec {
        layer: OutputLayer::Gap,
        name: "gap",
        form: LayerForm::Floats { channels: &["Z"], least: OUT_OF_REACH_MM, pixel: None, steps: None },
        unit: Some("mm"),
        meaning: "clearance between the pad's surface and the object above it, 0 in contact, -1 where no object is within reach",
    },
    LayerSpec {
        layer: OutputLayer::Markers,
        name: "markers",
        form: LayerForm::Positions,
        unit: None,
        meaning: "rest and moved positions of the markers, px",
    },
    LayerSpec {
        layer: OutputLayer::Reference,
        name: "reference",
        form: LayerForm::Rgb,
        unit: None,
        meaning: "the image without contact, 8-bit RGB",
    },
    LayerSpec {
        layer: OutputLayer::Lamps,
        name: "lamps",
        form: LayerForm::Floats { channels: &["A", "B", "C", "D", "E", "F"], least: 0.0, pixel: None, steps: None },
        unit: None,
        meaning: "the grey image under each of the sensor's six lamps, 0 to 1",
    },
    LayerSpec {
        layer: OutputLayer::Slip,
        name: "slip",
        form: LayerForm::Grey,
        unit: None,
        meaning: "8-bit grey, 128 where the pad sticks to the object, 255 where it slips, 0 where it does not touch it",
    },
    LayerSpec {
        layer: OutputLayer::Flow,
        name: "flow",
        form: LayerForm::Floats { channels: &["X", "Y"], least: f32::NEG_INFINITY, pixel: None, steps: None },
        unit: Some("mm"),
        meaning: "motion of the pad's surface in its own plane since it was untouched, to the right and down",
    },
    LayerSpec {
        layer: OutputLayer::Traction,
        name: "traction",
        form: LayerForm::Floats {
            channels: &["X", "Y", "Z"],
            least: f32::NEG_INFINITY,
            pixel: Some(Pixel::Float),
            steps: None,
        },
        unit: Some("kPa"),
        meaning: "force of the object on the pad by area: along the pad to the right and down, and into the pad",
    },
    LayerSpec {
        layer: OutputLayer::Pins,
        name: "pins",
        form: LayerForm::Positions,
        unit: None,
        meaning: "rest and moved positions of the pins' tips, px, and mm in the sensor's frame",
    },
    LayerSpec {
        layer: OutputLayer::Points,
        name: "points",
        form: LayerForm::Floats {
            channels: &["X", "Y", "Z"],
            least: f32::NEG_INFINITY,
            pixel: Some(Pixel::Float),
            steps: None,
        },
        unit: Some("mm"),
        meaning: "the point of the pad's surface that each pixel shows, in the sensor's frame; 0, 0, 0 where it shows no gel",
    },
    LayerSpec {
        layer: OutputLayer::Instance,
        name: "instance",
        form: LayerForm::Grey,
        unit: None,
        meaning: "8-bit grey, the number of the object that the pad touches, counted from 1 in the label's `objects`; 0 where \
                  it touches none",
    },
    LayerSpec {
        layer: OutputLayer::Untouched,
        name: "untouched",
        form: LayerForm::Rgb,
        unit: None,
        meaning: "the image without contact by the sample's own camera at another moment, with noise of its own, 8-bit RGB",
    },
];

// Rows are looked up by the number of the variant, so their order is checked here.
const _: () = {
    let mut row = 0;
    while row < LAYER_SPECS.len() {
        assert!(LAYER_SPECS[row].layer as usize == row, "rows stand in the order of the variants");
        row += 1;
    }
};

impl OutputLayer {
    /// All layers, in the order in which a sample's files are written.
    pub const ALL: [Self; LAYER_SPECS.len()] = {
        let mut all = [Self::Depth; LAYER_SPECS.len()];
        let mut row = 0;
        while row < LAYER_SPECS.len() {
            all[row] = LAYER_SPECS[row].layer;
            row += 1;
        }
        all
    };

    /// Returns the layer's row of the table.
    pub const fn spec(self) -> &'static LayerSpec {
        &LAYER_SPECS[self as usize]
    }

    /// Returns the layer of this name, if there is one.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|layer| layer.name() == name)
    }

    /// Returns the name in jobs, files and labels.
    pub fn name(self) -> &'static str {
        self.spec().name
    }

    /// Returns the names of the channels of a layer of floats, in alphabetical order; empty for other layers.
    pub fn channels(self) -> &'static [&'static str] {
        match self.spec().form {
            LayerForm::Floats { channels, .. } => channels,
            LayerForm::Grey | LayerForm::Rgb | LayerForm::Positions => &[],
        }
    }

    /// Returns how the layer is encoded if float layers have the format `format`.
    pub fn coding_for(self, format: DepthFormat) -> LayerCoding {
        match (self.spec().form, format) {
            // Programs that load point clouds can load arrays.
            _ if self == Self::Points => LayerCoding::Npy,
            (LayerForm::Grey | LayerForm::Rgb, _) => LayerCoding::Png,
            (LayerForm::Positions, _) => LayerCoding::Json,
            (LayerForm::Floats { steps: Some(scale), .. }, DepthFormat::Png16) => LayerCoding::Png16(scale),
            (LayerForm::Floats { .. }, DepthFormat::Npy) => LayerCoding::Npy,
            (LayerForm::Floats { .. }, DepthFormat::Exr | DepthFormat::Png16) => LayerCoding::Exr,
        }
    }

    /// Returns the end of the file's name, behind the sample's key.
    pub fn file_suffix(self, format: DepthFormat) -> String {
        format!("{}.{}", self.name(), self.coding_for(format).extension())
    }
}

impl LayerSpec {
    /// Returns what the values are, with their unit before it.
    pub fn description(&self) -> String {
        match self.unit {
            Some(unit) => format!("{unit}: {}", self.meaning),
            None => self.meaning.to_owned(),
        }
    }
}

impl LayerForm {
    /// Returns the values per pixel, which are the last axis of an array if there are several; `None` for positions,
    /// which are no image.
    pub fn values_per_px(&self) -> Option<usize> {
        match self {
            Self::Floats { channels, .. } => Some(channels.len()),
            Self::Grey => Some(1),
            Self::Rgb => Some(3),
            Self::Positions => None,
        }
    }

    /// Returns the bytes per pixel in a file with the extension `ending`, before packing. `pixel` is the job's
    /// precision of EXR files. Returns `None` if the layer is not stored so.
    pub fn bytes_per_px(&self, ending: &str, pixel: Pixel) -> Option<usize> {
        let each = match (self, ending) {
            (Self::Floats { pixel: own, .. }, "exr") => own.unwrap_or(pixel).bytes_per_value(),
            (Self::Floats { .. }, "npy") => 4,
            (Self::Floats { steps: Some(_), .. }, "png16") => 2,
            (Self::Grey | Self::Rgb, "png") => 1,
            _ => return None,
        };
        Some(each * self.values_per_px()?)
    }
}

/// Scale of a layer's 16-bit steps, which the label gives ([`crate::steps`]).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StepScale {
    /// From 0 mm up.
    Depth,
    /// To both sides of 0 mm.
    Surface,
}

impl StepScale {
    /// Returns the key of the label's `png16` for the size of a step.
    pub fn step_key(self) -> &'static str {
        match self {
            Self::Depth => "depth_mm_per_step",
            Self::Surface => "surface_mm_per_step",
        }
    }

    /// Returns the key of the label's `png16` for the value that stands for 0 mm, or `None` if that is 0. A scale with
    /// such a key keeps the value 0 for what is not finite.
    pub fn zero_key(self) -> Option<&'static str> {
        match self {
            Self::Depth => None,
            Self::Surface => Some("surface_zero"),
        }
    }
}

/// Format of float layers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum DepthFormat {
    /// OpenEXR images.
    #[default]
    Exr,
    /// NumPy arrays of float32.
    Npy,
    /// Depth and surface as 16-bit grey PNG, in steps that the label gives; other layers as EXR.
    Png16,
}

impl DepthFormat {
    /// All formats.
    pub const ALL: [Self; 3] = [Self::Exr, Self::Npy, Self::Png16];

    /// Returns the name in a job.
    pub fn name(self) -> &'static str {
        match self {
            Self::Exr => "exr",
            Self::Npy => "npy",
            Self::Png16 => "png16",
        }
    }
}

/// Encoding of a layer's file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LayerCoding {
    /// OpenEXR.
    Exr,
    /// NumPy array.
    Npy,
    /// PNG of 16 bits. Its extension is not `.png`, since readers of tars would cut that to 8 bits.
    Png16(StepScale),
    /// PNG of 8 bits.
    Png,
    /// JSON.
    Json,
}

impl LayerCoding {
    /// Returns the extension of the file, without the dot.
    pub fn extension(self) -> &'static str {
        match self {
            Self::Exr => "exr",
            Self::Npy => "npy",
            Self::Png16(_) => "png16",
            Self::Png => "png",
            Self::Json => "json",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A variant without a row could be written in a job, but would have no row to look up.
    #[test]
    fn every_layer_that_a_job_can_name_has_its_row() {
        let written = |layer: OutputLayer| serde_json::to_value(layer).expect("a name");
        assert!(OutputLayer::ALL.into_iter().all(|layer| written(layer) == layer.name()));
        let schema = schemars::schema_for!(OutputLayer).to_value();
        assert_eq!(schema["title"], "Layer");
        assert_eq!(schema["oneOf"].as_array().map(Vec::len), Some(LAYER_SPECS.len()));
        assert!(OutputLayer::ALL.into_iter().all(|layer| OutputLayer::from_name(layer.name()) == Some(layer)));
    }

    #[test]
    fn channels_are_in_the_order_of_their_names_as_exr_wants_them() {
        for layer in OutputLayer::ALL {
            assert!(layer.channels().is_sorted() && layer.channels().iter().all(|name| name.len() == 1), "{layer:?}");
        }
    }

    #[test]
    fn a_pixel_takes_what_its_form_and_its_file_say() {
        let bytes = |layer: OutputLayer, ending| layer.spec().form.bytes_per_px(ending, Pixel::Half);
        assert_eq!(
            OutputLayer::ALL.map(|layer| bytes(layer, "exr")),
            [
                Some(2),
                Some(2),
                None,
                Some(6),
                Some(4),
                Some(2),
                None,
                None,
                Some(12),
                None,
                Some(4),
                Some(12),
                None,
                Some(12),
                None,
                None
            ]
        );
        assert_eq!(
            OutputLayer::ALL.map(|layer| bytes(layer, "npy")),
            [
                Some(4),
                Some(4),
                None,
                Some(12),
                Some(4),
                Some(4),
                None,
                None,
                Some(24),
                None,
                Some(8),
                Some(12),
                None,
                Some(12),
                None,
                None
            ]
        );
        let png = [
            None,
            None,
            Some(1),
            None,
            None,
            None,
            None,
            Some(3),
            None,
            Some(1),
            None,
            None,
            None,
            None,
            Some(1),
            Some(3),
        ];
        assert_eq!(OutputLayer::ALL.map(|layer| bytes(layer, "png")), png);
        assert_eq!(bytes(OutputLayer::Depth, "png16"), Some(2));
        assert_eq!(bytes(OutputLayer::Normal, "png16"), None);
    }
}
