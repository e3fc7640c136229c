//! The vertices and triangles that a reader finds in a file, before they become meshes.

use std::collections::HashMap;

use glam::{DAffine3, DVec3};

use super::points::LoosePoints;
use super::remark::Remark;
use super::{MeshFileError, MeshFileProblem};
use crate::length::Unit;
use crate::number_format::format_number;
use crate::size_limits;
use gelsim_core::mesh::cleaning::LARGEST_MM;
use gelsim_core::mesh::{CleanupReport, Mesh, MeshError};

/// The content of a file, in the file's unit.
#[derive(Clone, Debug, Default)]
pub(super) struct RawMesh {
    pub(super) vertices: Vec<[f64; 3]>,
    pub(super) triangles: Vec<[u32; 3]>,
    /// Which triangles belong together.
    pub(super) parts: PartRanges,
    /// Millimetres of a coordinate of 1, if the format or the file says so.
    pub(super) mm_per_unit: Option<f64>,
    /// Points that belong to no triangle: their kind, and the number of those that are no vertices.
    pub(super) points: LoosePoints,
    /// What a user should know of how the file was read.
    pub(super) remarks: Vec<Remark>,
}

impl RawMesh {
    /// Refuses a file that has points and no triangle.
    pub(super) fn require_surface(self) -> Result<Self, MeshFileError> {
        let count = self.vertices.len() + self.points.count;
        if self.triangles.is_empty() && count > 0 {
            return Err(MeshFileProblem::Points(LoosePoints { count, ..self.points }).into());
        }
        Ok(self)
    }

    /// Makes one mesh of all triangles.
    pub(super) fn into_mesh(mut self, mm_per_unit: f64) -> Result<(Mesh, CleanupReport), MeshFileError> {
        for coordinate in self.vertices.as_flattened_mut() {
            *coordinate *= mm_per_unit;
        }
        Mesh::new(self.vertices, self.triangles).map_err(|error| match error {
            MeshError::TooLarge(mm) => {
                MeshFileProblem::with_help(error.to_string(), suggest_smaller_unit(mm / mm_per_unit, mm_per_unit))
                    .into()
            }
            error => error.into(),
        })
    }

    /// Splits the content into its parts, in the order in which they begin. Parts without triangles are dropped. Each
    /// part keeps the vertices that it uses.
    pub(super) fn split_parts(self) -> Vec<(String, RawMesh)> {
        let mut split: Vec<RawMesh> = Vec::new();
        split.resize_with(self.parts.names.len(), RawMesh::default);
        let mut kept: Vec<HashMap<u32, u32>> = Vec::new();
        kept.resize_with(split.len(), HashMap::new);
        for (part, triangles) in self.parts.triangle_ranges(self.triangles.len()) {
            let (raw, kept) = (&mut split[part], &mut kept[part]);
            for corners in &self.triangles[triangles] {
                let corners = corners.map(|corner| {
                    *kept.entry(corner).or_insert_with(|| {
                        raw.vertices.push(self.vertices[corner as usize]);
                        raw.vertices.len() as u32 - 1
                    })
                });
                raw.triangles.push(corners);
            }
        }
        let named = self.parts.names.into_iter().zip(split);
        named.filter(|(_, raw)| !raw.triangles.is_empty()).collect()
    }

    /// Appends vertices, moved by `place`. Returns the index of the first.
    pub(super) fn add_vertices(
        &mut self,
        place: &DAffine3,
        points: impl Iterator<Item = [f64; 3]>,
    ) -> Result<u32, MeshFileError> {
        let first = self.vertices.len();
        self.vertices.extend(points.map(|point| place.transform_point3(DVec3::from_array(point)).to_array()));
        if self.vertices.len() >= u32::MAX as usize {
            return Err(MeshError::TooMany("vertices").into());
        }
        Ok(first as u32)
    }

    /// Appends triangles whose vertices were added from index `first` on. If `place` mirrors, they are turned over, so
    /// that their front stays outside.
    pub(super) fn add_triangles(&mut self, place: &DAffine3, first: u32, triangles: &[[u32; 3]]) {
        let mirrors = place.matrix3.determinant() < 0.0;
        self.triangles.extend(triangles.iter().map(|&[a, b, c]| {
            let [b, c] = if mirrors { [c, b] } else { [b, c] };
            [a + first, b + first, c + first]
        }));
    }

    /// Refuses content that is much larger than the `bytes` it was read from, as a shape that is used over and over
    /// would make it.
    pub(super) fn check_growth(&self, bytes: usize) -> Result<(), MeshFileError> {
        size_limits::check_unpacked_bytes(24 * self.vertices.len() + 12 * self.triangles.len(), bytes)
            .map_err(|reason| MeshFileProblem::Malformed(format!("repeats its shapes too often: {reason}")).into())
    }
}

/// Iterates over the triangles of a strip. Each shares two corners with the one before it, so every second one is
/// turned over. Triangles that only join two strips have a corner twice and are left out.
pub(super) fn iter_strip_triangles(corners: &[u32]) -> impl Iterator<Item = [u32; 3]> + '_ {
    let turned = corners.windows(3).enumerate().map(|(i, window)| match i % 2 {
        0 => [window[0], window[1], window[2]],
        _ => [window[1], window[0], window[2]],
    });
    turned.filter(|[a, b, c]| a != b && b != c && c != a)
}

/// Iterates over the triangles of a fan, all of which have its first corner.
pub(super) fn iter_fan_triangles(corners: &[u32]) -> impl Iterator<Item = [u32; 3]> + '_ {
    corners.windows(2).skip(1).map(|pair| [corners[0], pair[0], pair[1]])
}

/// Says what to do if coordinates that span `length` are too large in this unit.
fn suggest_smaller_unit(length: f64, mm_per_unit: f64) -> String {
    let fits = |unit: &Unit| unit.mm_per_unit() < mm_per_unit && length * unit.mm_per_unit() <= LARGEST_MM;
    match Unit::ALL.into_iter().find(fits) {
        Some(unit) => format!(
            "write the unit of its values, such as unit = \"{}\" under [[object]]: it is {} mm long then",
            unit.name(),
            format_number(length * unit.mm_per_unit())
        ),
        None => {
            String::from("no unit makes it smaller: delete what lies far away in it, or scale it where it was made")
        }
    }
}

/// The names of parts and the triangles of each.
#[derive(Clone, Debug, Default)]
pub(super) struct PartRanges {
    names: Vec<String>,
    numbers: HashMap<String, usize>,
    /// Where a part begins or goes on: its index, and that of the first triangle.
    starts: Vec<(usize, usize)>,
}

impl PartRanges {
    /// From this triangle on, adds to the part of this name, which is new or is continued.
    pub(super) fn continue_part(&mut self, name: String, triangle: usize) {
        let next = self.names.len();
        let number = *self.numbers.entry(name.clone()).or_insert(next);
        if number == next {
            self.names.push(name);
        }
        self.starts.push((number, triangle));
    }

    /// From this triangle on, begins a new part. Its name gets a number if another part has the name.
    pub(super) fn begin_part(&mut self, name: &str, triangle: usize) {
        let mut own = name.to_owned();
        let mut number = 1;
        while self.numbers.contains_key(&own) {
            number += 1;
            own = format!("{name}-{number}");
        }
        self.continue_part(own, triangle);
    }

    pub(super) fn is_empty(&self) -> bool {
        self.names.is_empty()
    }

    /// Iterates over the ranges of triangles, each with the index of its part. There are `count` triangles; those
    /// before the first part belong to none.
    fn triangle_ranges(&self, count: usize) -> impl Iterator<Item = (usize, std::ops::Range<usize>)> + '_ {
        let ends = self.starts.iter().skip(1).map(|(_, start)| *start).chain([count]);
        self.starts.iter().zip(ends).map(|((part, start), end)| (*part, *start..end))
    }
}
