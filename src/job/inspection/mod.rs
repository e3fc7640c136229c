//! What can be said of a mesh before it is pressed, held against a sensor's pad: what `gelsim inspect` prints and what every
//! command that takes a job says of its meshes.

use serde::Serialize;

use gelsim_core::base::view::View;
use gelsim_core::mesh::Mesh;
use gelsim_files::length::is_plausible;
use gelsim_files::sensor::quantity::Quantity;
use gelsim_files::sensor::{PRESETS, Sensor};

pub mod findings;
pub mod sides;

/// The sensor that a mesh is held against.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SensorPad {
    /// The preset's name.
    pub sensor: String,
    /// Width and height of the image, px.
    pub resolution_px: [usize; 2],
    /// Width and height of the window that the image shows, mm.
    pub field_of_view_mm: [f64; 2],
    /// Distance between pixel centres, mm.
    pub mm_per_px: [f64; 2],
    /// Thickness of the pad, mm.
    pub thickness_mm: f64,
    /// How deep sides are pressed to see what touches, mm: 1, or half of a thinner pad.
    pub press_mm: f64,
}

/// The largest extent that there may be, mm: positions in a job reach as far.
pub const LARGEST_MM: f64 = 1e4;

impl SensorPad {
    /// The preset with this name, if there is one.
    pub fn preset(name: &str) -> Option<Self> {
        let (_, text) = PRESETS.iter().find(|(preset, _)| *preset == name)?;
        Some(Self::new(&toml::from_str(text).ok()?))
    }

    /// A sensor's pad.
    pub fn new(sensor: &Sensor) -> Self {
        let resolution_px = sensor.resolution_px.map(|px| px.max(1) as usize);
        let field_of_view_mm = sensor.field_of_view_mm;
        Self {
            sensor: sensor.name.clone(),
            resolution_px,
            field_of_view_mm,
            mm_per_px: [0, 1].map(|k| field_of_view_mm[k] / resolution_px[k] as f64),
            thickness_mm: sensor.gelpad_thickness_mm,
            press_mm: f64::min(1.0, sensor.gelpad_thickness_mm / 2.0),
        }
    }

    /// The larger distance between pixel centres, mm.
    pub fn pixel_mm(&self) -> f64 {
        self.mm_per_px[0].max(self.mm_per_px[1])
    }

    /// The view with every pixel divided into `by` times `by`.
    fn camera(&self, by: usize) -> View {
        View { resolution_px: self.resolution_px.map(|px| px * by), mm_per_px: self.mm_per_px.map(|mm| mm / by as f64) }
    }
}

/// How large a mesh is, and where it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshSize {
    /// Extents along x, y and z, mm.
    pub size_mm: [f64; 3],
    /// Centre of its bounding box, mm.
    pub centre_mm: [f64; 3],
    /// Farthest that a vertex is from that centre, mm.
    pub radius_mm: f64,
    /// Millimetres that a coordinate of 1 was taken for.
    pub mm_per_unit: f64,
    /// What says that it is so large, behind the length, if anything does: the file, or a key of the job.
    pub known_from: Option<&'static str>,
}

impl MeshSize {
    /// That of a mesh.
    pub fn new(mesh: &Mesh, mm_per_unit: f64, states_its_unit: bool) -> Self {
        let known_from = states_its_unit.then_some("as its file says");
        // The bounding box is centred on zero.
        let half = |k: usize| mesh.vertices.iter().map(|vertex| vertex[k].abs()).fold(0.0, f32::max);
        let square = |vertex: &[f32; 3]| vertex.iter().map(|at| f64::from(*at) * f64::from(*at)).sum::<f64>();
        Self {
            size_mm: [0, 1, 2].map(|k| 2.0 * f64::from(half(k))),
            centre_mm: mesh.centre_mm,
            radius_mm: mesh.vertices.iter().map(square).fold(0.0, f64::max).sqrt(),
            mm_per_unit,
            known_from,
        }
    }

    /// The largest extent, mm.
    pub fn largest_mm(&self) -> f64 {
        self.size_mm.into_iter().fold(0.0, f64::max)
    }

    /// The same under a scale: of its range the end that fits the pad, else the upper one.
    pub fn scaled(&self, scale: &Quantity, pad: &SensorPad) -> Self {
        let (least, most) = scale.support();
        let fits = is_plausible(least * self.largest_mm(), pad.field_of_view_mm);
        let scale = if fits { least } else { most };
        let [size_mm, centre_mm] = [self.size_mm, self.centre_mm].map(|lengths| lengths.map(|mm| scale * mm));
        // What a coordinate is goes along, so that what it would be in another unit is scaled, too.
        Self { size_mm, centre_mm, radius_mm: scale * self.radius_mm, mm_per_unit: self.mm_per_unit, ..*self }
    }

    /// True if its coordinates were divided by its size, as sets for learning do: the longest side, the box's diagonal or the
    /// sphere around it is 1 or 2. How large it was, nothing says.
    pub fn is_normalised(&self) -> bool {
        /// Of 1, to which coordinates are rounded when they are written.
        const NEAR: f64 = 5e-3;
        let diagonal_mm = self.size_mm.iter().map(|mm| mm * mm).sum::<f64>().sqrt();
        let lengths = [self.largest_mm(), diagonal_mm, 2.0 * self.radius_mm];
        let is_unit = |mm: f64| [1.0, 2.0].iter().any(|unit| (mm / self.mm_per_unit / unit - 1.0).abs() < NEAR);
        self.known_from.is_none() && lengths.into_iter().any(is_unit)
    }
}
