//! Writes rendered frames to a log of ROS 2 messages. All is in SI units: metres, newtons, newton metres, pascals.

use std::borrow::Cow;
use std::ffi::OsStr;
use std::io::{self, BufWriter};
use std::path::Path;

use crate::content::{LayerContent, layer_content};
use crate::logs::mcap_writer::McapWriter;
use crate::logs::schemas::{Cdr, IMAGE, POINTS, RosType, TEXT, WRENCH};
use gelsim_core::camera::pins::PinTip;
use gelsim_core::gelpad::sliding::Wrench;
use gelsim_core::impression::{Impression, OUT_OF_REACH_MM};
use gelsim_files::write::FileUnderWay;
use gelsim_job::label::GENERATOR;
use gelsim_job::layers::{LayerForm, OutputLayer};
use gelsim_job::plan::Plan;
use gelsim_job::sample::Sample;

/// The name of the sensor's frame.
const FRAME: &str = "tactile";

/// Returns true if results go to a log of this name.
pub fn is_log_name(out: &Path) -> bool {
    out.extension() == Some(OsStr::new("mcap"))
}

/// When a frame was taken, and when it was written to a log, ns since the epoch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameTime {
    /// Time in headers.
    pub stamp_ns: u64,
    /// Time in the log.
    pub log_ns: u64,
}

/// A message and its topic.
pub struct TactileMessage {
    topic: Cow<'static, str>,
    of: &'static RosType,
    bytes: Vec<u8>,
}

/// A log under way.
pub struct TactileLog(McapWriter<BufWriter<FileUnderWay>>);

impl TactileLog {
    /// Begins a log. It gets its name when it is complete.
    pub fn create(path: &Path) -> io::Result<Self> {
        let file = BufWriter::with_capacity(1 << 16, FileUnderWay::begin(path)?);
        McapWriter::new(file, GENERATOR).map(Self)
    }

    /// Writes the messages of a frame.
    pub fn write(&mut self, time: FrameTime, messages: &[TactileMessage]) -> io::Result<()> {
        messages.iter().try_for_each(|TactileMessage { topic, of, bytes }| self.0.write(topic, of, time.log_ns, bytes))
    }

    /// Ends the log and gives it its name.
    pub fn complete(self) -> io::Result<()> {
        let file = self.0.finish()?.into_inner().map_err(io::IntoInnerError::into_error)?;
        file.complete()
    }
}

/// Encodes the tactile image, force and torque, the markers, the layers, and the label if there is one.
pub fn encode_sample(plan: &Plan, sample: &Sample, time: FrameTime, label: Option<&[u8]>) -> Vec<TactileMessage> {
    let image = &sample.impression.image;
    let message = |topic: &'static str, of, bytes| TactileMessage { topic: Cow::Borrowed(topic), of, bytes };
    let picture =
        |encoding: &str, data: &[u8]| encode_image(time.stamp_ns, [image.width, image.height], encoding, data);
    let mut messages = vec![
        message("/tactile/image", &IMAGE, picture("rgb8", &image.rgb)),
        message("/tactile/wrench", &WRENCH, encode_wrench(time.stamp_ns, &find_wrench(sample))),
    ];
    if let Some(points) = encode_markers(sample, time.stamp_ns) {
        messages.push(message("/tactile/markers", &POINTS, points));
    }
    for layer in plan.layers() {
        let bytes = match layer_content(sample, layer) {
            LayerContent::Floats(values) => {
                let channels = layer.channels().len().max(1);
                picture(&format!("32FC{channels}"), to_si(layer, values).as_flattened())
            }
            LayerContent::Bytes(bytes) => match layer.spec().form {
                LayerForm::Rgb => picture("rgb8", &bytes),
                _ => picture("mono8", &bytes),
            },
            // Their positions are among the points.
            LayerContent::Markers(_) => continue,
        };
        messages.push(TactileMessage { topic: Cow::Owned(format!("/tactile/{}", layer.name())), of: &IMAGE, bytes });
    }
    messages.extend(label.map(encode_label));
    messages
}

/// Encodes a label.
pub fn encode_label(json: &[u8]) -> TactileMessage {
    let mut cdr = Cdr::new();
    cdr.text(&String::from_utf8_lossy(json));
    TactileMessage { topic: Cow::Borrowed("/tactile/label"), of: &TEXT, bytes: cdr.into_bytes() }
}

fn encode_image(stamp_ns: u64, [width, height]: [usize; 2], encoding: &str, data: &[u8]) -> Vec<u8> {
    let mut cdr = Cdr::with_header(stamp_ns, FRAME);
    let step = data.len() / height;
    cdr.u32(height as u32).u32(width as u32).text(encoding).u8(0).u32(step as u32).bytes(data);
    cdr.into_bytes()
}

/// Converts the values of a layer to SI units, little endian.
fn to_si(layer: OutputLayer, values: Vec<f32>) -> Vec<[u8; 4]> {
    let factor = match layer.spec().unit {
        Some("mm") => 1e-3,
        Some("kPa") => 1e3,
        _ => 1.0,
    };
    let convert = |value: f32| match layer {
        // Nothing is within reach: too far, as REP 118 has it.
        OutputLayer::Gap if value == OUT_OF_REACH_MM => f32::INFINITY,
        _ => (f64::from(value) * factor) as f32,
    };
    values.into_iter().map(|value| convert(value).to_le_bytes()).collect()
}

/// Returns force and torque of the object on the pad, in the sensor's frame, about its origin. NaN is what is unknown.
fn find_wrench(Sample { simulator, impression, label, .. }: &Sample) -> Wrench {
    if let Some(sliding) = &impression.sliding {
        return sliding.wrench;
    }
    if let Some(wrench) = impression.wrench {
        return wrench;
    }
    let unknown = Wrench { force_n: [f64::NAN; 3], torque_nmm: [f64::NAN; 3] };
    let (false, Some(normal_n)) = (impression.gel_map.is_some(), label.contact.force_n) else { return unknown };
    let shear = &label.shear;
    let is_moved = shear.shift_mm != [0.0; 2] || shear.twist_deg != 0.0;
    let ([x_n, y_n], twist_nmm) = match (is_moved, shear.force_n, shear.torque_nmm) {
        (true, Some(force), Some(torque)) => (force, torque),
        (true, ..) => ([f64::NAN; 2], f64::NAN),
        (false, ..) => ([0.0; 2], 0.0),
    };
    let [mut about_x, mut about_y] = [0.0; 2];
    if let Some(pressure) = &impression.contact.pressure {
        let view = simulator.view();
        let area_m2 = 1e-6 * view.mm_per_px[0] * view.mm_per_px[1];
        for y in 0..pressure.height {
            for (x, kpa) in pressure.row(y).iter().enumerate().filter(|(_, kpa)| **kpa != 0.0) {
                let [x_mm, y_mm] = view.point_mm([x as f64 + 0.5, y as f64 + 0.5]);
                let pressed_n = 1e3 * f64::from(*kpa) * area_m2;
                about_x -= y_mm * pressed_n;
                about_y += x_mm * pressed_n;
            }
        }
    }
    let about_z = twist_nmm + shear.about_mm[0] * y_n - shear.about_mm[1] * x_n;
    Wrench { force_n: [x_n, y_n, 0.0 - normal_n], torque_nmm: [about_x, about_y, about_z] }
}

fn encode_wrench(stamp_ns: u64, Wrench { force_n, torque_nmm }: &Wrench) -> Vec<u8> {
    let mut cdr = Cdr::with_header(stamp_ns, FRAME);
    for number in force_n.iter().copied().chain(torque_nmm.iter().map(|torque| 1e-3 * torque)) {
        cdr.f64(number);
    }
    cdr.into_bytes()
}

/// Encodes the markers or pin tips in view: where they are now in the sensor's frame, m, and where the image shows them
/// at rest and now, px. Returns `None` if the sensor has none.
fn encode_markers(Sample { impression, .. }: &Sample, stamp_ns: u64) -> Option<Vec<u8>> {
    const FIELDS: [&str; 7] = ["x", "y", "z", "rest_u", "rest_v", "moved_u", "moved_v"];
    /// The number of FLOAT32 in sensor_msgs/PointField.
    const FLOAT32: u8 = 7;
    let points: Vec<[f64; 7]> = match (&impression.markers, &impression.pins) {
        (Some(_), _) => {
            let surface = impression.points_mm();
            let place = |(rest, moved): ([f64; 2], [f64; 2])| {
                let [x, y, z] = interpolate(impression, &surface, moved);
                [x, y, z, rest[0], rest[1], moved[0], moved[1]]
            };
            impression.marker_positions().into_iter().map(place).collect()
        }
        (None, Some(pins)) => {
            let size = [impression.image.width, impression.image.height];
            let place = |(rest, moved): (&PinTip, &PinTip)| {
                let ([u, v], [now_u, now_v], [x, y, z]) = (rest.px?, moved.px?, moved.at_mm.to_array());
                Some([x, y, z, u, v, now_u, now_v])
            };
            pins.in_view(size).filter_map(place).collect()
        }
        (None, None) => return None,
    };
    let mut cdr = Cdr::with_header(stamp_ns, FRAME);
    cdr.u32(1).u32(points.len() as u32).u32(FIELDS.len() as u32);
    for (at, name) in FIELDS.into_iter().enumerate() {
        cdr.text(name).u32(4 * at as u32).u8(FLOAT32).u32(1);
    }
    let value = |at: usize, value: f64| if at < 3 { 1e-3 * value } else { value };
    let data: Vec<[u8; 4]> = points
        .iter()
        .flat_map(|point| point.iter().enumerate().map(|(at, number)| (value(at, *number) as f32).to_le_bytes()))
        .collect();
    let step = 4 * FIELDS.len() as u32;
    cdr.u8(0).u32(step).u32(step * points.len() as u32).bytes(data.as_flattened()).u8(1);
    Some(cdr.into_bytes())
}

/// Returns the point of the pad's surface that the image shows at a place, mm, bilinear between pixels.
fn interpolate(impression: &Impression, surface: &[[f32; 3]], px: [f64; 2]) -> [f64; 3] {
    let size = [impression.image.width, impression.image.height];
    let [(x, right), (y, down)] = [0, 1].map(|k| {
        let at = (px[k] - 0.5).clamp(0.0, (size[k] - 1) as f64);
        let first = (at as usize).min(size[k].saturating_sub(2));
        (first, at - first as f64)
    });
    let point = |dx: usize, dy: usize| {
        let at = (y + dy).min(size[1] - 1) * size[0] + (x + dx).min(size[0] - 1);
        surface[at].map(f64::from)
    };
    let corners = [(point(0, 0), (1.0 - right) * (1.0 - down)), (point(1, 0), right * (1.0 - down))];
    let more = [(point(0, 1), (1.0 - right) * down), (point(1, 1), right * down)];
    let mut sum = [0.0; 3];
    for (corner, weight) in corners.into_iter().chain(more) {
        (0..3).for_each(|k| sum[k] += weight * corner[k]);
    }
    sum
}
