//! The layers of a sample beside its tactile image: one row each in a table, from which jobs, files, labels' scales, the
//! dataset card, verification, the report and Python's arrays follow.
//!
//! A new layer is a variant of [`OutputLayer`] and its row of `TABLE` here, and what computes its values
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
    /// How far the object reaches below the undeformed pad surface, mm.
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
    /// 128 where the pad sticks to the object, 255 where it slips, 0 elsewhere; only of sequences.
    Slip,
    /// Motion of the pad's surface in its own plane since it was untouched, mm; only from models that know it.
    Flow,
    /// Tips of the pins at rest and now; only for sensors that have them.
    Pins,
    /// Points of the pad's surface, one for each pixel, mm in the sensor's frame.
    Points,
    /// The number of the object that the pad touches, counted from 1 in the order of the label's `objects`, 0 elsewhere.
    Instance,
    /// The image without any contact as the sample's own camera takes it at another moment, noise included.
    Untouched,
}

/// What is to be known of a layer to write, read, check and describe it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LayerSpec {
    /// Whose row it is.
    pub layer: OutputLayer,
    /// Its name in jobs, members, labels and Python.
    pub name: &'static str,
    /// What its values are.
    pub form: Form,
    /// Unit of the values, if they are measures.
    pub unit: Option<&'static str>,
    /// What the values mean, for the dataset card.
    pub meaning: &'static str,
}

/// What the values of a layer are, and how they may be stored.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Form {
    /// Measured numbers: float32 in memory.
    Floats {
        /// Names of the channels, one letter each, in alphabetical order.
        channels: &'static [&'static str],
        /// No value is below it.
        least: f32,
        /// Precision in EXR files, where that is not the job's to choose.
        pixel: Option<Pixel>,
        /// The scale in 16-bit steps, for layers that have a range which those suit.
        steps: Option<Scale>,
    },
    /// One byte per pixel.
    Grey,
    /// Red, green and blue, a byte each.
    Rgb,
    /// Positions of markers, in pixels.
    Positions,
}

/// The row of every layer, in the order in which a sample's members are written.
const TABLE: [LayerSpec; 15] = [
    LayerSpec {
        layer: OutputLayer::Depth,
        name: "depth",
        form: Form::Floats { channels: &["Z"], least: 0.0, pixel: None, steps: Some(Scale::Depth) },
        unit: Some("mm"),
        meaning: "how far the object reaches below the undeformed pad, 0 where it does not",
    },
    LayerSpec {
        layer: OutputLayer::Surface,
        name: "surface",
        form: Form::Floats { channels: &["Z"], least: f32::NEG_INFINITY, pixel: None, steps: Some(Scale::Surface) },
        unit: Some("mm"),
        meaning: "displacement of the pad's surface, positive into the pad",
    },
    LayerSpec {
        layer: OutputLayer::Contact,
        name: "contact",
        form: Form::Grey,
        unit: None,
        meaning: "8-bit grey, 255 where the pad touches",
    },
    LayerSpec {
        layer: OutputLayer::Normal,
        name: "normal",
        form: Form::Floats { channels: &["X", "Y", "Z"], least: f32::NEG_INFINITY, pixel: None, steps: None },
        unit: None,
        meaning: "unit normals of the surface towards the camera; a flat pad is (0, 0, -1)",
    },
    LayerSpec {
        layer: OutputLayer::Pressure,
        name: "pressure",
        // Half floats end at 65504 kPa, which a stiff pad exceeds.
        form: Form::Floats { channels: &["P"], least: 0.0, pixel: Some(Pixel::Float), steps: None },
        unit: Some("kPa"),
        meaning: "pressure between pad and object",
    },
    LayerSpec {
        layer: OutputLayer::Gap,
        name: "gap",
        form: Form::Floats { channels: &["Z"], least: OUT_OF_REACH_MM, pixel: None, steps: None },
        unit: Some("mm"),
        meaning: "clearance between the pad's surface and the object above it, 0 in contact, -1 where no object is within reach",
    },
    LayerSpec {
        layer: OutputLayer::Markers,
        name: "markers",
        form: Form::Positions,
        unit: None,
        meaning: "rest and moved positions of the markers, px",
    },
    LayerSpec {
        layer: OutputLayer::Reference,
        name: "reference",
        form: Form::Rgb,
        unit: None,
        meaning: "the image without contact, 8-bit RGB",
    },
    LayerSpec {
        layer: OutputLayer::Lamps,
        name: "lamps",
        form: Form::Floats { channels: &["A", "B", "C", "D", "E", "F"], least: 0.0, pixel: None, steps: None },
        unit: None,
        meaning: "the grey image under each of the sensor's six lamps, 0 to 1",
    },
    LayerSpec {
        layer: OutputLayer::Slip,
        name: "slip",
        form: Form::Grey,
        unit: None,
        meaning: "8-bit grey, 128 where the pad sticks to the object, 255 where it slips, 0 where it does not touch it",
    },
    LayerSpec {
        layer: OutputLayer::Flow,
        name: "flow",
        form: Form::Floats { channels: &["X", "Y"], least: f32::NEG_INFINITY, pixel: None, steps: None },
        unit: Some("mm"),
        meaning: "motion of the pad's surface in its own plane since it was untouched, to the right and down",
    },
    LayerSpec {
        layer: OutputLayer::Pins,
        name: "pins",
        form: Form::Positions,
        unit: None,
        meaning: "rest and moved positions of the pins' tips, px, and mm in the sensor's frame",
    },
    LayerSpec {
        layer: OutputLayer::Points,
        name: "points",
        form: Form::Floats {
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
        form: Form::Grey,
        unit: None,
        meaning: "8-bit grey, the number of the object that the pad touches, counted from 1 in the label's `objects`; 0 where \
                  it touches none",
    },
    LayerSpec {
        layer: OutputLayer::Untouched,
        name: "untouched",
        form: Form::Rgb,
        unit: None,
        meaning: "the image without contact by the sample's own camera at another moment, with noise of its own, 8-bit RGB",
    },
];

// Rows are found by number.
const _: () = {
    let mut row = 0;
    while row < TABLE.len() {
        assert!(TABLE[row].layer as usize == row, "rows stand in the order of the variants");
        row += 1;
    }
};

impl OutputLayer {
    /// Every layer, in the order in which a sample's members are written.
    pub const ALL: [Self; TABLE.len()] = {
        let mut all = [Self::Depth; TABLE.len()];
        let mut row = 0;
        while row < TABLE.len() {
            all[row] = TABLE[row].layer;
            row += 1;
        }
        all
    };

    /// Its row of the table.
    pub const fn spec(self) -> &'static LayerSpec {
        &TABLE[self as usize]
    }

    /// The layer of a name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|layer| layer.name() == name)
    }

    /// Its name in jobs, members and labels.
    pub fn name(self) -> &'static str {
        self.spec().name
    }

    /// Names of its channels if it holds floats, in alphabetical order; none for the other layers.
    pub fn channels(self) -> &'static [&'static str] {
        match self.spec().form {
            Form::Floats { channels, .. } => channels,
            Form::Grey | Form::Rgb | Form::Positions => &[],
        }
    }

    /// How it is written where float layers have the format `format`.
    pub fn coding(self, format: DepthFormat) -> Coding {
        match (self.spec().form, format) {
            // What loads point clouds loads arrays.
            _ if self == Self::Points => Coding::Npy,
            (Form::Grey | Form::Rgb, _) => Coding::Png,
            (Form::Positions, _) => Coding::Json,
            (Form::Floats { steps: Some(scale), .. }, DepthFormat::Png16) => Coding::Png16(scale),
            (Form::Floats { .. }, DepthFormat::Npy) => Coding::Npy,
            (Form::Floats { .. }, DepthFormat::Exr | DepthFormat::Png16) => Coding::Exr,
        }
    }

    /// The end of the member's name, after the sample's key.
    pub fn suffix(self, format: DepthFormat) -> String {
        format!("{}.{}", self.name(), self.coding(format).ending())
    }
}

impl LayerSpec {
    /// What the values are, with their unit before it.
    pub fn said(&self) -> String {
        match self.unit {
            Some(unit) => format!("{unit}: {}", self.meaning),
            None => self.meaning.to_owned(),
        }
    }
}

impl Form {
    /// Values of one pixel, which an array has as its last axis if there are several; `None` of what are no images.
    pub fn values_per_px(&self) -> Option<usize> {
        match self {
            Self::Floats { channels, .. } => Some(channels.len()),
            Self::Grey => Some(1),
            Self::Rgb => Some(3),
            Self::Positions => None,
        }
    }

    /// Bytes of one pixel in a file whose name ends in `ending`, before it is packed; `pixel` is the job's precision of
    /// EXR files. `None` if it is not stored so.
    pub fn bytes_per_px(&self, ending: &str, pixel: Pixel) -> Option<usize> {
        let each = match (self, ending) {
            (Self::Floats { pixel: own, .. }, "exr") => own.unwrap_or(pixel).bytes(),
            (Self::Floats { .. }, "npy") => 4,
            (Self::Floats { steps: Some(_), .. }, "png16") => 2,
            (Self::Grey | Self::Rgb, "png") => 1,
            _ => return None,
        };
        Some(each * self.values_per_px()?)
    }
}

/// Which of a label's scales the 16-bit steps of a layer have ([`crate::steps`]).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// From 0 mm on.
    Depth,
    /// To both sides of 0 mm.
    Surface,
}

impl Scale {
    /// Key of the label's `png16` that has the size of a step.
    pub fn step_key(self) -> &'static str {
        match self {
            Self::Depth => "depth_mm_per_step",
            Self::Surface => "surface_mm_per_step",
        }
    }

    /// Key of the label's `png16` that has the value of 0 mm, where that is not 0. A scale that has one keeps the value 0
    /// for what is not finite.
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
    /// OpenEXR pictures.
    #[default]
    Exr,
    /// NumPy arrays of float32.
    Npy,
    /// Depth and surface as 16-bit grey PNG, in steps that the label names; other layers as EXR.
    Png16,
}

impl DepthFormat {
    /// Every format.
    pub const ALL: [Self; 3] = [Self::Exr, Self::Npy, Self::Png16];

    /// Its name in jobs.
    pub fn name(self) -> &'static str {
        match self {
            Self::Exr => "exr",
            Self::Npy => "npy",
            Self::Png16 => "png16",
        }
    }
}

/// How a layer is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Coding {
    /// OpenEXR.
    Exr,
    /// NumPy array.
    Npy,
    /// PNG of 16 bits: not `.png`, which readers of tars cut to 8 bits.
    Png16(Scale),
    /// PNG of 8 bits.
    Png,
    /// JSON.
    Json,
}

impl Coding {
    /// The end of a file's name, after the last dot.
    pub fn ending(self) -> &'static str {
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

    /// A variant without a row could be written in a job and would have nothing to be looked up.
    #[test]
    fn every_layer_that_a_job_can_name_has_its_row() {
        let written = |layer: OutputLayer| serde_json::to_value(layer).expect("a name");
        assert!(OutputLayer::ALL.into_iter().all(|layer| written(layer) == layer.name()));
        let schema = schemars::schema_for!(OutputLayer).to_value();
        assert_eq!(schema["title"], "Layer");
        assert_eq!(schema["oneOf"].as_array().map(Vec::len), Some(TABLE.len()));
        assert!(OutputLayer::ALL.into_iter().all(|layer| OutputLayer::named(layer.name()) == Some(layer)));
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
                None,
                Some(12),
                None,
                None
            ]
        );
        let png =
            [None, None, Some(1), None, None, None, None, Some(3), None, Some(1), None, None, None, Some(1), Some(3)];
        assert_eq!(OutputLayer::ALL.map(|layer| bytes(layer, "png")), png);
        assert_eq!(bytes(OutputLayer::Depth, "png16"), Some(2));
        assert_eq!(bytes(OutputLayer::Normal, "png16"), None);
    }
}
