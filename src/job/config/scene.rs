//! `[scene]`, `[pose]`, `[indentation]` and `[shear]`: how many objects meet the pad, and how.

use std::fmt;

use schemars::JsonSchema;
use serde::de::{self, Deserializer, SeqAccess, Visitor};
use serde::{Deserialize, Serialize, Serializer};

use gelsim_core::base::rng::Stream;
use gelsim_core::gelpad::elastic::shear::Friction;
use gelsim_core::pose::{Anchor, Side};
use gelsim_files::sensor::quantity::Quantity;

/// The `[scene]` table: several objects in one press.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Scene {
    /// How many objects are pressed in together, 1 to 32: a whole number, or a range of them from which each sample draws its own.
    pub objects_per_sample: Count,
}

/// A whole number, or a range of whole numbers that are equally likely.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Count {
    /// The smallest.
    pub least: u32,
    /// The largest.
    pub most: u32,
}

impl Default for Count {
    fn default() -> Self {
        Self { least: 1, most: 1 }
    }
}

impl Count {
    /// One of them; there must be one.
    pub fn sample(self, stream: &mut Stream) -> u32 {
        self.least + stream.below((self.most - self.least + 1) as usize) as u32
    }
}

impl Serialize for Count {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self.least == self.most {
            true => self.least.serialize(serializer),
            false => [self.least, self.most].serialize(serializer),
        }
    }
}

impl<'de> Deserialize<'de> for Count {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Written;
        impl<'de> Visitor<'de> for Written {
            type Value = Count;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a whole number such as 2, or a range of them such as [1, 3]")
            }

            fn visit_i64<E: de::Error>(self, value: i64) -> Result<Count, E> {
                let count = u32::try_from(value).map_err(|_| E::invalid_value(de::Unexpected::Signed(value), &self))?;
                Ok(Count { least: count, most: count })
            }

            fn visit_u64<E: de::Error>(self, value: u64) -> Result<Count, E> {
                let count =
                    u32::try_from(value).map_err(|_| E::invalid_value(de::Unexpected::Unsigned(value), &self))?;
                Ok(Count { least: count, most: count })
            }

            fn visit_seq<A: SeqAccess<'de>>(self, items: A) -> Result<Count, A::Error> {
                let [least, most] = <[u32; 2]>::deserialize(de::value::SeqAccessDeserializer::new(items))?;
                Ok(Count { least, most })
            }
        }
        deserializer.deserialize_any(Written)
    }
}

/// The `[pose]` table. The frame is the camera's: x right, y down, z out of the pad towards the object.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Pose {
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
    /// Then one about the sensor's y, degrees, -90 to 90.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pitch_deg: Option<Quantity>,
    /// On a gel that has a shape: the place at which the object is pressed, mm over the gel from its tip. The object is then
    /// posed as on a flat pad that touches the gel there, its x away from the tip and its y around the gel.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub from_tip_mm: Option<Quantity>,
    /// The direction from the tip to that place, degrees from the sensor's x towards its y.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub around_deg: Option<Quantity>,
    /// Position along x, mm from the middle of the image.
    pub x_mm: Quantity,
    /// Position along y, mm from the middle of the image.
    pub y_mm: Quantity,
    /// The point of the turned object that x_mm and y_mm place.
    pub anchor: Anchor,
}

impl Default for Pose {
    fn default() -> Self {
        Self {
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
            anchor: Anchor::default(),
        }
    }
}

/// Side of an object.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Face {
    /// One of the six, each as likely as the others.
    #[serde(rename = "any")]
    Any,
    /// The one with the most relief, of each object its own.
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
    /// One of the six sides for [`Face::Any`], the object's `richest` for [`Face::Auto`], else the side itself.
    pub fn sample(self, richest: Option<Side>, stream: &mut Stream) -> Side {
        self.side().or(richest).unwrap_or_else(|| Side::ALL[stream.below(Side::ALL.len())])
    }

    /// As a side is written in jobs.
    pub fn of(side: Side) -> Self {
        match side {
            Side::PlusX => Self::PlusX,
            Side::MinusX => Self::MinusX,
            Side::PlusY => Self::PlusY,
            Side::MinusY => Self::MinusY,
            Side::PlusZ => Self::PlusZ,
            Side::MinusZ => Self::MinusZ,
        }
    }

    /// The side, if it is one.
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

    /// As it is written in jobs.
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
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Indentation {
    /// How deep the object reaches below the undeformed pad, mm; 0 to the pad's thickness.
    #[schemars(required)]
    pub depth_mm: Option<Quantity>,
    /// Where that is measured.
    #[serde(skip_serializing_if = "At::is_lowest")]
    pub at: At,
    /// Share of samples in which the object stays just above the pad, 0 to 1.
    pub no_contact: f64,
}

/// Where the indentation depth is measured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum At {
    /// At the object's lowest point.
    #[default]
    Lowest,
    /// Where the object is on the sensor's axis, so that depth and tilt are independent. A draw that puts it beside the axis
    /// is not healthy.
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
    /// Along x, mm.
    pub x_mm: Quantity,
    /// Along y, mm.
    pub y_mm: Quantity,
    /// About the point that the pose places, degrees, from x towards y.
    pub twist_deg: Quantity,
    /// What the pad does under it.
    pub friction: Friction,
}

impl Shear {
    /// True if any sample may move its object.
    pub fn any(&self) -> bool {
        [&self.x_mm, &self.y_mm, &self.twist_deg].iter().any(|quantity| quantity.support() != (0.0, 0.0))
    }
}
