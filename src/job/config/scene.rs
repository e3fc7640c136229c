//! `[scene]`, `[pose]`, `[indentation]` and `[shear]`: how many objects are pressed in, and how.

use std::fmt;

use schemars::JsonSchema;
use serde::de::{self, Deserializer, SeqAccess, Visitor};
use serde::{Deserialize, Serialize, Serializer};

use gelsim_core::base::rng::RandomStream;
use gelsim_core::gelpad::elastic::shear::Friction;
use gelsim_core::pose::{Anchor, Side};
use gelsim_files::sensor::quantity::Quantity;

/// The `[scene]` table: several objects in one press.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Scene {
    /// Number of objects that are pressed in together, 1 to 32: a whole number, or a range from which each sample draws
    /// its own.
    pub objects_per_sample: Count,
}

/// A whole number, or a range of whole numbers that are equally likely.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Count {
    /// The smallest number.
    pub min: u32,
    /// The largest number.
    pub max: u32,
}

impl Default for Count {
    fn default() -> Self {
        Self { min: 1, max: 1 }
    }
}

impl Count {
    /// Draws one of the numbers. The range must not be empty.
    pub fn sample(self, stream: &mut RandomStream) -> u32 {
        self.min + stream.uniform_below((self.max - self.min + 1) as usize) as u32
    }
}

impl Serialize for Count {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self.min == self.max {
            true => self.min.serialize(serializer),
            false => [self.min, self.max].serialize(serializer),
        }
    }
}

impl<'de> Deserialize<'de> for Count {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct CountVisitor;
        impl<'de> Visitor<'de> for CountVisitor {
            type Value = Count;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a whole number such as 2, or a range of them such as [1, 3]")
            }

            fn visit_i64<E: de::Error>(self, value: i64) -> Result<Count, E> {
                let count = u32::try_from(value).map_err(|_| E::invalid_value(de::Unexpected::Signed(value), &self))?;
                Ok(Count { min: count, max: count })
            }

            fn visit_u64<E: de::Error>(self, value: u64) -> Result<Count, E> {
                let count =
                    u32::try_from(value).map_err(|_| E::invalid_value(de::Unexpected::Unsigned(value), &self))?;
                Ok(Count { min: count, max: count })
            }

            fn visit_seq<A: SeqAccess<'de>>(self, items: A) -> Result<Count, A::Error> {
                let [least, most] = <[u32; 2]>::deserialize(de::value::SeqAccessDeserializer::new(items))?;
                Ok(Count { min: least, max: most })
            }
        }
        deserializer.deserialize_any(CountVisitor)
    }
}

/// The `[pose]` table. The frame is the camera's: x right, y down, z out of the pad towards the object.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Pose {
    /// What of the object faces the pad: a side, or any point of its surface that the pad can reach, along its normal.
    #[serde(skip_serializing_if = "PressedPart::is_side")]
    pub at: PressedPart,
    /// Side of the object that faces the pad, in the object's own axes.
    pub face: Face,
    /// Turn about z, degrees, from x towards y.
    pub yaw_deg: Quantity,
    /// Then a turn about an axis in the pad's plane, degrees, -90 to 90.
    pub tilt_deg: Quantity,
    /// Direction of that axis, degrees from x towards y.
    pub tilt_azimuth_deg: Quantity,
    /// In place of tilt and its azimuth: a turn about the sensor's x, degrees, -90 to 90.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub roll_deg: Option<Quantity>,
    /// After roll, a turn about the sensor's y, degrees, -90 to 90.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pitch_deg: Option<Quantity>,
    /// For a gel with a shape: the place at which the object is pressed, mm over the gel from its tip. The object is
    /// then posed as on a flat pad that touches the gel there, with its x away from the tip and its y around the gel.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub from_tip_mm: Option<Quantity>,
    /// Direction from the tip to the place of `from_tip_mm`, degrees from the sensor's x towards its y.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub around_deg: Option<Quantity>,
    /// Position along x, mm from the middle of the image.
    pub x_mm: Quantity,
    /// Position along y, mm from the middle of the image.
    pub y_mm: Quantity,
    /// Places around the middle of the image that samples take in turn; `x_mm` and `y_mm` are added.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub grid: Option<PlaceGrid>,
    /// The point of the turned object that is placed at x_mm and y_mm.
    pub anchor: Anchor,
}

/// A regular grid of places, row by row from the top left. If objects come in turn, each of them takes a place before
/// the next one is taken.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PlaceGrid {
    /// Places in a row, 1 to 1000.
    pub columns: u32,
    /// Rows, 1 to 1000.
    pub rows: u32,
    /// Distance between columns and between rows, mm.
    pub step_mm: [f64; 2],
}

impl PlaceGrid {
    /// Returns place number `number`, mm from the middle of the image; after the last place comes the first again.
    pub fn place_mm(self, number: u64) -> [f64; 2] {
        let [columns, rows] = [self.columns, self.rows].map(u64::from);
        let at = [number % columns, number / columns % rows];
        std::array::from_fn(|k| (at[k] as f64 - 0.5 * ([columns, rows][k] - 1) as f64) * self.step_mm[k])
    }
}

impl Default for Pose {
    fn default() -> Self {
        Self {
            at: PressedPart::default(),
            face: Face::default(),
            yaw_deg: Quantity::default(),
            tilt_deg: Quantity::default(),
            tilt_azimuth_deg: Quantity::uniform(0.0, 360.0),
            roll_deg: None,
            pitch_deg: None,
            from_tip_mm: None,
            around_deg: None,
            x_mm: Quantity::default(),
            y_mm: Quantity::default(),
            grid: None,
            anchor: Anchor::default(),
        }
    }
}

/// What of an object faces the pad.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PressedPart {
    /// The side that `face` names.
    #[default]
    Side,
    /// A point of the surface, each that can be reached as likely as any other. Its normal points into the pad, and it is
    /// placed at x_mm and y_mm.
    Surface,
}

impl PressedPart {
    /// Returns true for the default.
    pub fn is_side(&self) -> bool {
        *self == Self::Side
    }
}

/// Side of an object.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Face {
    /// One of the six sides, each as likely as the others.
    #[serde(rename = "any")]
    Any,
    /// The side with the most relief, chosen for each object.
    #[serde(rename = "auto")]
    Auto,
    /// The side towards +x.
    #[serde(rename = "+x")]
    PlusX,
    /// The side towards -x.
    #[serde(rename = "-x")]
    MinusX,
    /// The side towards +y.
    #[serde(rename = "+y")]
    PlusY,
    /// The side towards -y.
    #[serde(rename = "-y")]
    MinusY,
    /// The side towards +z.
    #[serde(rename = "+z")]
    PlusZ,
    /// The side towards -z: the object's axes stay parallel to the sensor's.
    #[default]
    #[serde(rename = "-z")]
    MinusZ,
}

impl Face {
    /// Returns one of the six sides for [`Face::Any`], the object's `richest` side for [`Face::Auto`], and else the
    /// side itself.
    pub fn pick_side(self, richest: Option<Side>, stream: &mut RandomStream) -> Side {
        self.side().or(richest).unwrap_or_else(|| Side::ALL[stream.uniform_below(Side::ALL.len())])
    }

    /// Returns the choice for a single side.
    pub fn from_side(side: Side) -> Self {
        match side {
            Side::PlusX => Self::PlusX,
            Side::MinusX => Self::MinusX,
            Side::PlusY => Self::PlusY,
            Side::MinusY => Self::MinusY,
            Side::PlusZ => Self::PlusZ,
            Side::MinusZ => Self::MinusZ,
        }
    }

    /// Returns the side, or `None` for a choice that is made per sample or object.
    pub fn side(self) -> Option<Side> {
        match self {
            Self::Any | Self::Auto => None,
            Self::PlusX => Some(Side::PlusX),
            Self::MinusX => Some(Side::MinusX),
            Self::PlusY => Some(Side::PlusY),
            Self::MinusY => Some(Side::MinusY),
            Self::PlusZ => Some(Side::PlusZ),
            Self::MinusZ => Some(Side::MinusZ),
        }
    }

    /// Returns the name in a job.
    pub fn name(self) -> &'static str {
        match self {
            Self::Any => "any",
            Self::Auto => "auto",
            Self::PlusX => "+x",
            Self::MinusX => "-x",
            Self::PlusY => "+y",
            Self::MinusY => "-y",
            Self::PlusZ => "+z",
            Self::MinusZ => "-z",
        }
    }
}

/// The `[indentation]` table.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Indentation {
    /// Depth of the object below the undeformed pad, mm; 0 to the pad's thickness.
    pub depth_mm: Option<Quantity>,
    /// Normal force of all objects on the pad, N, in place of `depth_mm`: the depth that gives it is searched for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub force_n: Option<Quantity>,
    /// Where the depth is measured.
    #[serde(skip_serializing_if = "At::is_lowest")]
    pub at: At,
    /// Fraction of samples in which the object stays just above the pad, 0 to 1.
    pub no_contact: f64,
}

/// Where the indentation depth is measured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum At {
    /// At the object's lowest point.
    #[default]
    Lowest,
    /// Where the object is on the sensor's axis, so that depth and tilt are independent. A draw in which the object
    /// misses the axis is not healthy.
    Axis,
}

impl At {
    fn is_lowest(&self) -> bool {
        *self == Self::Lowest
    }
}

/// The `[shear]` table: how the object moves in the pad's plane after it was pressed in.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Shear {
    /// Motion along x, mm.
    pub x_mm: Quantity,
    /// Motion along y, mm.
    pub y_mm: Quantity,
    /// Turn about the point that the pose places, degrees, from x towards y.
    pub twist_deg: Quantity,
    /// Whether the pad sticks to the object or slips under it.
    pub friction: Friction,
}

impl Shear {
    /// Returns true if the object may move in any sample.
    pub fn has_motion(&self) -> bool {
        [&self.x_mm, &self.y_mm, &self.twist_deg].iter().any(|quantity| quantity.support() != (0.0, 0.0))
    }
}
