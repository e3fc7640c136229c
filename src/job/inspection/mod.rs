//! Inspects a mesh before it is pressed, compared with a sensor's pad. `gelsim inspect` prints the result, and every
//! command that takes a job reports it for its meshes.

use serde::{Deserialize, Serialize};

use gelsim_core::base::view::View;
use gelsim_core::mesh::{Mesh, extents};
use gelsim_files::length::is_plausible_length;
use gelsim_files::sensor::quantity::Quantity;
use gelsim_files::sensor::{Sensor, read_preset};

pub mod findings;
pub mod sides;

/// The pad with which a mesh is compared.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SensorPad {
    /// Name of the sensor.
    pub sensor: String,
    /// Width and height of the image, px.
    pub resolution_px: [usize; 2],
    /// Width and height of the window that the image shows, mm.
    pub field_of_view_mm: [f64; 2],
    /// Distance between pixel centres, mm.
    pub mm_per_px: [f64; 2],
    /// Thickness of the pad, mm.
    pub thickness_mm: f64,
    /// Depth to which sides are pressed to see what touches, mm: 1, or half the thickness of a thinner pad.
    pub press_mm: f64,
}

/// The largest extent of a mesh, mm. Positions in a job reach as far.
pub const MAX_EXTENT_MM: f64 = 1e4;

impl SensorPad {
    /// Returns the pad of a preset, or `None` if there is no preset of this name.
    pub fn from_preset(name: &str) -> Option<Self> {
        read_preset(name).map(|sensor| Self::new(&sensor))
    }

    /// Returns the pad of a sensor.
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

    /// Returns the larger of the distances between pixel centres along x and y, mm.
    pub fn pixel_size_mm(&self) -> f64 {
        self.mm_per_px[0].max(self.mm_per_px[1])
    }

    /// Returns the number of pixel rows that a mesh's triangles fill in a capture of one of its sides.
    pub fn count_capture_rows(&self, mesh: &Mesh) -> f64 {
        extents::count_capture_rows(mesh, self.field_of_view_mm, self.mm_per_px[1])
    }

    /// Returns the view with every pixel divided into `by` times `by`.
    fn subdivided_view(&self, by: usize) -> View {
        View { resolution_px: self.resolution_px.map(|px| px * by), mm_per_px: self.mm_per_px.map(|mm| mm / by as f64) }
    }
}

/// What states the size of a mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SizeSource {
    /// Its file.
    File,
    /// The key `length_mm` of the job.
    LengthMm,
}

impl SizeSource {
    /// Returns the words that stand after the length.
    pub fn words(self) -> &'static str {
        match self {
            Self::File => "as its file says",
            Self::LengthMm => "as length_mm says",
        }
    }
}

/// The size and place of a mesh.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MeshSize {
    /// Extents along x, y and z, mm.
    pub size_mm: [f64; 3],
    /// Centre of the bounding box, mm.
    pub centre_mm: [f64; 3],
    /// Distance of the farthest vertex from that centre, mm.
    pub radius_mm: f64,
    /// The millimetres of a coordinate of 1 with which it was read.
    pub mm_per_unit: f64,
    /// What states the size; `None` if nothing does.
    pub known_from: Option<SizeSource>,
}

impl MeshSize {
    /// Measures a mesh.
    pub fn new(mesh: &Mesh, mm_per_unit: f64, states_its_unit: bool) -> Self {
        let known_from = states_its_unit.then_some(SizeSource::File);
        Self {
            size_mm: extents::half_extents_mm(mesh).map(|mm| 2.0 * f64::from(mm)),
            centre_mm: mesh.centre_mm,
            radius_mm: extents::radius_mm(mesh),
            mm_per_unit,
            known_from,
        }
    }

    /// Returns the largest extent, mm.
    pub fn largest_extent_mm(&self) -> f64 {
        self.size_mm.into_iter().fold(0.0, f64::max)
    }

    /// Returns the size under a scale. Of a range of scales it is the lower end if that fits the pad, else the upper
    /// end.
    pub fn scaled(&self, scale: &Quantity, pad: &SensorPad) -> Self {
        let (least, most) = scale.support();
        let fits = is_plausible_length(least * self.largest_extent_mm(), pad.field_of_view_mm);
        let scale = if fits { least } else { most };
        let [size_mm, centre_mm] = [self.size_mm, self.centre_mm].map(|lengths| lengths.map(|mm| scale * mm));
        // The unit stays. The coordinates are scaled, and so the size in another unit would be.
        Self { size_mm, centre_mm, radius_mm: scale * self.radius_mm, mm_per_unit: self.mm_per_unit, ..*self }
    }

    /// Returns true if the coordinates were divided by the mesh's size, as data sets for learning do: the longest side,
    /// the box's diagonal or the diameter of the sphere around it is 1 or 2. The real size is then unknown.
    pub fn is_normalised(&self) -> bool {
        /// Relative tolerance, since coordinates are rounded when they are written.
        const NEAR: f64 = 5e-3;
        let diagonal_mm = self.size_mm.iter().map(|mm| mm * mm).sum::<f64>().sqrt();
        let lengths = [self.largest_extent_mm(), diagonal_mm, 2.0 * self.radius_mm];
        let is_unit = |mm: f64| [1.0, 2.0].iter().any(|unit| (mm / self.mm_per_unit / unit - 1.0).abs() < NEAR);
        self.known_from.is_none() && lengths.into_iter().any(is_unit)
    }
}
