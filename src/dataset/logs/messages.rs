//! The messages of a log that tell what a depth camera saw, how its rays run, and where things are.

use glam::{DQuat, DVec3};

use super::fields::{Fields, Serialization};
use crate::frames::camera::DepthUnit;
use gelsim_core::base::grid::Grid;
use gelsim_core::base::view::check_image_size;
use gelsim_files::{png, size_limits};

/// A type of message that is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Kind {
    /// sensor_msgs/Image.
    Image,
    /// sensor_msgs/CompressedImage.
    CompressedImage,
    /// sensor_msgs/CameraInfo.
    CameraInfo,
    /// geometry_msgs/PoseStamped.
    PoseStamped,
    /// geometry_msgs/TransformStamped.
    TransformStamped,
    /// tf2_msgs/TFMessage.
    Transforms,
}

impl Kind {
    /// Returns the kind of message with this name of a type, which has no `/msg/`.
    pub fn from_name(name: &str) -> Option<Self> {
        Some(match name {
            "sensor_msgs/Image" => Self::Image,
            "sensor_msgs/CompressedImage" => Self::CompressedImage,
            "sensor_msgs/CameraInfo" => Self::CameraInfo,
            "geometry_msgs/PoseStamped" => Self::PoseStamped,
            "geometry_msgs/TransformStamped" => Self::TransformStamped,
            "tf2_msgs/TFMessage" | "tf/tfMessage" => Self::Transforms,
            _ => return None,
        })
    }
}

/// The unit of depth images in an encoding, by REP 118; `None` if these are no depth images. For compressed images it
/// is the format.
pub fn depth_unit(kind: Kind, encoding: &str) -> Option<DepthUnit> {
    let is_compressed = kind == Kind::CompressedImage;
    match encoding.split(';').next().unwrap_or_default().trim() {
        "32FC1" if !is_compressed || encoding.contains("compressedDepth") => Some(DepthUnit::Metre),
        "16UC1" | "mono16" => Some(DepthUnit::Millimetre),
        _ => None,
    }
}

/// Returns the time of a message, ns, and its encoding or format if it is an image.
pub fn peek(kind: Kind, serialization: Serialization, head: &[u8]) -> Result<(u64, &str), String> {
    let mut fields = Fields::new(head, serialization)?;
    if kind == Kind::Transforms {
        return Ok((0, ""));
    }
    let (stamp_ns, _) = fields.header()?;
    Ok(match kind {
        Kind::Image => {
            fields.u32()?;
            fields.u32()?;
            (stamp_ns, fields.text()?)
        }
        Kind::CompressedImage => (stamp_ns, fields.text()?),
        _ => (stamp_ns, ""),
    })
}

/// Decodes a depth image and returns its values with their unit. Infinite is what nothing was measured of, or was too
/// far; minus infinity stays, as it was too near.
pub fn decode_depth(
    kind: Kind,
    serialization: Serialization,
    message: &[u8],
) -> Result<(Grid<f64>, DepthUnit), String> {
    let mut fields = Fields::new(message, serialization)?;
    fields.header()?;
    match kind {
        Kind::Image => decode_image(&mut fields),
        Kind::CompressedImage => decode_compressed(&mut fields),
        _ => Err(String::from("it is no image")),
    }
}

/// The error of an image that is no depth image.
fn no_depth(encoding: &str) -> String {
    format!("its encoding is {}; depth images are 32FC1, 16UC1 or mono16", encoding.escape_debug())
}

fn decode_image(fields: &mut Fields<'_>) -> Result<(Grid<f64>, DepthUnit), String> {
    let [height, width] = [fields.u32()?, fields.u32()?].map(|size| size as usize);
    let encoding = fields.text()?;
    let (is_big_endian, step) = (fields.u8()? != 0, fields.u32()? as usize);
    let data = fields.bytes()?;
    let unit = depth_unit(Kind::Image, encoding).ok_or_else(|| no_depth(encoding))?;
    check_image_size([width, height])?;
    let pixel = if unit == DepthUnit::Metre { 4 } else { 2 };
    let row = width * pixel;
    // The last row need not be as long as the others.
    if step < row || data.len().checked_sub(row).is_none_or(|before| (height - 1) * step > before) {
        let message = format!("it has {} bytes in rows of {step}, and {width}x{height} px of {pixel}", data.len());
        return Err(format!("{message} do not fit into them"));
    }
    let ordered = |bytes: &mut [u8]| {
        if is_big_endian {
            bytes.reverse();
        }
    };
    let mut values = Vec::with_capacity(width * height);
    for row in data.chunks(step).take(height).map(|whole| &whole[..row]) {
        match unit {
            DepthUnit::Metre => values.extend(row.as_chunks::<4>().0.iter().map(|bytes| {
                let mut bytes = *bytes;
                ordered(&mut bytes);
                measured(f32::from_le_bytes(bytes))
            })),
            _ => values.extend(row.as_chunks::<2>().0.iter().map(|bytes| {
                let mut bytes = *bytes;
                ordered(&mut bytes);
                counted(u16::from_le_bytes(bytes))
            })),
        }
    }
    Ok((Grid { width, height, data: values }, unit))
}

/// Decodes what the transport compressedDepth writes: a header of 12 bytes and a PNG, whose values stand for metres in
/// steps that grow with the distance; or a PNG alone.
fn decode_compressed(fields: &mut Fields<'_>) -> Result<(Grid<f64>, DepthUnit), String> {
    let format = fields.text()?;
    let data = fields.bytes()?;
    let unit = depth_unit(Kind::CompressedImage, format).ok_or_else(|| no_depth(format))?;
    if format.to_ascii_lowercase().contains("rvl") {
        return Err(String::from("it is compressed by RVL, which cannot be read: record it as png, or uncompressed"));
    }
    let (head, image) = match format.contains("compressedDepth") {
        true => data.split_at_checked(12).ok_or("it ends within its header")?,
        false => (&[][..], data),
    };
    let (size, pixel) = png::read_header(image)?;
    size_limits::check_image_bytes(size, pixel.bytes_per_pixel() as usize + 8, image.len())?;
    check_image_size(size)?;
    let steps = png::decode_grey16(image)?;
    let float =
        |at: usize| head.get(at..).and_then(<[u8]>::first_chunk).map_or(0.0, |bytes| f32::from_le_bytes(*bytes));
    let (scale, shift) = (float(4), float(8));
    let value = |step: u16| match unit {
        DepthUnit::Metre if step > 0 => measured(scale / (f32::from(step) - shift)),
        DepthUnit::Metre => f64::INFINITY,
        _ => counted(step),
    };
    let data = steps.data.into_iter().map(value).collect();
    Ok((Grid { width: steps.width, height: steps.height, data }, unit))
}

/// Returns a distance in metres, infinite where nothing was measured.
fn measured(metres: f32) -> f64 {
    if metres.is_nan() { f64::INFINITY } else { f64::from(metres) }
}

/// Returns a distance in whole millimetres, infinite where nothing was measured.
fn counted(millimetres: u16) -> f64 {
    if millimetres == 0 { f64::INFINITY } else { f64::from(millimetres) }
}

/// How the rays of a camera run, of a sensor_msgs/CameraInfo.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraInfo {
    /// Columns and rows of its images.
    pub size_px: [usize; 2],
    /// Focal lengths along x and y, px.
    pub focal_px: [f64; 2],
    /// Where the optical axis meets the image, px. The centre of the first pixel is at (0, 0).
    pub principal_px: [f64; 2],
    /// Whether images that are not rectified are distorted.
    pub is_distorted: bool,
}

impl CameraInfo {
    /// Returns the angle between the upper and the lower edge of the image, degrees.
    pub fn fov_y_deg(&self) -> f64 {
        2.0 * libm::atan(self.size_px[1] as f64 / 2.0 / self.focal_px[1]).to_degrees()
    }

    /// Returns how far the optical axis is off the image's middle to the right and down, px; 0 if that is less than a
    /// pixel, since simulators do not agree on which of the two middle pixels the middle is.
    pub fn offset_px(&self) -> [f64; 2] {
        let off = [0, 1].map(|k| self.principal_px[k] + 0.5 - self.size_px[k] as f64 / 2.0);
        if off.iter().all(|px| px.abs() <= 1.0) { [0.0; 2] } else { off }
    }
}

/// Decodes how the rays of a camera run; of rectified images if the message tells.
pub fn decode_camera_info(serialization: Serialization, message: &[u8]) -> Result<CameraInfo, String> {
    let mut fields = Fields::new(message, serialization)?;
    fields.header()?;
    let [height, width] = [fields.u32()?, fields.u32()?].map(|size| size as usize);
    fields.text()?;
    let mut is_distorted = false;
    for _ in 0..fields.u32()? {
        is_distorted |= fields.f64()? != 0.0;
    }
    let k = fields.floats::<9>()?;
    fields.floats::<9>()?;
    let p = fields.floats::<12>()?;
    // A camera that was not rectified may leave P empty.
    let [fx, fy, cx, cy] = if p[0] > 0.0 { [p[0], p[5], p[2], p[6]] } else { [k[0], k[4], k[2], k[5]] };
    if ![fx, fy, cx, cy].iter().all(|number| number.is_finite()) || fx <= 0.0 || fy <= 0.0 {
        return Err(String::from("it says no focal length: the camera is not calibrated"));
    }
    Ok(CameraInfo { size_px: [width, height], focal_px: [fx, fy], principal_px: [cx, cy], is_distorted })
}

/// Where one frame is in another: p = R q + t takes a point q of the child to the parent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transform {
    /// R.
    pub rotation: DQuat,
    /// t, m.
    pub translation_m: DVec3,
}

impl Transform {
    /// The transform of a frame to itself.
    pub const IDENTITY: Self = Self { rotation: DQuat::IDENTITY, translation_m: DVec3::ZERO };

    /// Returns the transform that takes a point by `first` and then by this one.
    pub fn after(self, first: Self) -> Self {
        let translation_m = self.rotation * first.translation_m + self.translation_m;
        Self { rotation: (self.rotation * first.rotation).normalize(), translation_m }
    }

    /// Returns the transform from the parent to the child.
    pub fn inverse(self) -> Self {
        let rotation = self.rotation.conjugate();
        Self { rotation, translation_m: -(rotation * self.translation_m) }
    }

    /// Returns what lies between this transform and another: 0 is this one, 1 the other.
    pub fn between(self, other: Self, share: f64) -> Self {
        Self {
            rotation: self.rotation.slerp(other.rotation, share),
            translation_m: self.translation_m.lerp(other.translation_m, share),
        }
    }

    fn read(fields: &mut Fields<'_>) -> Result<Self, String> {
        let (translation, rotation) = (fields.floats::<3>()?, fields.floats::<4>()?);
        let (translation_m, rotation) = (DVec3::from_array(translation), DQuat::from_array(rotation));
        if !translation_m.is_finite() || (rotation.length() - 1.0).abs().is_nan() {
            return Err(String::from("a number of its pose is not finite"));
        }
        if (rotation.length() - 1.0).abs() > 1e-3 {
            return Err(format!("its quaternion has length {}, not 1", rotation.length()));
        }
        Ok(Self { rotation: rotation.normalize(), translation_m })
    }
}

/// Where a frame was at a time.
#[derive(Clone, Debug, PartialEq)]
pub struct Stamped {
    /// Time, ns since the epoch.
    pub stamp_ns: u64,
    /// The frame in which it is.
    pub parent: String,
    /// Its name; empty for a pose.
    pub child: String,
    /// Where it is.
    pub transform: Transform,
}

/// Decodes the poses of a message.
pub fn decode_transforms(kind: Kind, serialization: Serialization, message: &[u8]) -> Result<Vec<Stamped>, String> {
    let mut fields = Fields::new(message, serialization)?;
    let count = if kind == Kind::Transforms { fields.u32()? } else { 1 };
    let mut found = Vec::new();
    for _ in 0..count {
        let (stamp_ns, parent) = fields.header()?;
        let child = if kind == Kind::PoseStamped { "" } else { fields.text()? };
        let transform = Transform::read(&mut fields)?;
        let name = |name: &str| name.trim_start_matches('/').to_owned();
        found.push(Stamped { stamp_ns, parent: name(parent), child: name(child), transform });
    }
    Ok(found)
}
