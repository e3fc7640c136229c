//! What a reader finds in a file, before it becomes meshes.

use std::collections::HashMap;

use glam::{DAffine3, DVec3};

use super::points::Points;
use super::remark::Remark;
use super::{MeshFileError, MeshFileProblem};
use crate::figures::figure;
use crate::length::Unit;
use crate::unpack;
use gelsim_core::mesh::cleaning::LARGEST_MM;
use gelsim_core::mesh::{CleanupReport, Mesh, MeshError};

/// What a reader finds in a file, in the file's unit.
#[derive(Clone, Debug, Default)]
pub(super) struct Raw {
    pub(super) vertices: Vec<[f64; 3]>,
    pub(super) triangles: Vec<[u32; 3]>,
    /// Which triangles belong together.
    pub(super) parts: Parts,
    /// Millimetres of a coordinate of 1, if the format or the file says so.
    pub(super) mm_per_unit: Option<f64>,
    /// What points are that belong to no triangle, and how many there are that are no vertices.
    pub(super) points: Points,
    /// What to know of how it was read.
    pub(super) remarks: Vec<Remark>,
}

impl Raw {
    /// Refuses what has points and no triangle.
    pub(super) fn with_surface(self) -> Result<Self, MeshFileError> {
        let count = self.vertices.len() + self.points.count;
        if self.triangles.is_empty() && count > 0 {
            return Err(MeshFileProblem::Points(Points { count, ..self.points }).into());
        }
        Ok(self)
    }

    /// All of it as one mesh.
    pub(super) fn mesh(mut self, mm_per_unit: f64) -> Result<(Mesh, CleanupReport), MeshFileError> {
        for coordinate in self.vertices.as_flattened_mut() {
            *coordinate *= mm_per_unit;
        }
        Mesh::new(self.vertices, self.triangles).map_err(|error| match error {
            MeshError::TooLarge(mm) => {
                MeshFileProblem::advised(error.to_string(), smaller(mm / mm_per_unit, mm_per_unit)).into()
            }
            error => error.into(),
        })
    }

    /// Its parts that have triangles, in the order in which they begin, each with the vertices it uses.
    pub(super) fn split(self) -> Vec<(String, Raw)> {
        let mut split: Vec<Raw> = Vec::new();
        split.resize_with(self.parts.names.len(), Raw::default);
        let mut kept: Vec<HashMap<u32, u32>> = Vec::new();
        kept.resize_with(split.len(), HashMap::new);
        for (part, triangles) in self.parts.runs(self.triangles.len()) {
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

    /// Appends vertices moved by `place`; the number of the first.
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

    /// Appends triangles of vertices that were added from `first` on; a place that mirrors turns them over, so that their
    /// front stays outside.
    pub(super) fn add_triangles(&mut self, place: &DAffine3, first: u32, triangles: &[[u32; 3]]) {
        let mirrors = place.matrix3.determinant() < 0.0;
        self.triangles.extend(triangles.iter().map(|&[a, b, c]| {
            let [b, c] = if mirrors { [c, b] } else { [b, c] };
            [a + first, b + first, c + first]
        }));
    }

    /// Refuses what became much more than the `bytes` it was read from: the same shape used over and over.
    pub(super) fn check_growth(&self, bytes: usize) -> Result<(), MeshFileError> {
        unpack::bytes(24 * self.vertices.len() + 12 * self.triangles.len(), bytes)
            .map_err(|reason| MeshFileProblem::Malformed(format!("repeats its shapes too often: {reason}")).into())
    }
}

/// The triangles of a strip, each of which shares two corners with the one before it: every second one turns the other way.
/// Those that only join two strips have a corner twice and are left out.
pub(super) fn strip(corners: &[u32]) -> impl Iterator<Item = [u32; 3]> + '_ {
    let turned = corners.windows(3).enumerate().map(|(i, window)| match i % 2 {
        0 => [window[0], window[1], window[2]],
        _ => [window[1], window[0], window[2]],
    });
    turned.filter(|[a, b, c]| a != b && b != c && c != a)
}

/// The triangles of a fan, which all have its first corner.
pub(super) fn fan(corners: &[u32]) -> impl Iterator<Item = [u32; 3]> + '_ {
    corners.windows(2).skip(1).map(|pair| [corners[0], pair[0], pair[1]])
}

/// What to do about coordinates that span so much and are too large in this unit.
fn smaller(length: f64, mm_per_unit: f64) -> String {
    let fits = |unit: &Unit| unit.mm() < mm_per_unit && length * unit.mm() <= LARGEST_MM;
    match Unit::ALL.into_iter().find(fits) {
        Some(unit) => format!(
            "write the unit of its values, such as unit = \"{}\" under [[object]]: it is {} mm long then",
            unit.name(),
            figure(length * unit.mm())
        ),
        None => {
            String::from("no unit makes it smaller: delete what lies far away in it, or scale it where it was made")
        }
    }
}

/// Names of parts, and which triangles each has.
#[derive(Clone, Debug, Default)]
pub(super) struct Parts {
    names: Vec<String>,
    numbers: HashMap<String, usize>,
    /// Where a part begins or goes on: its number, and that of the first triangle.
    starts: Vec<(usize, usize)>,
}

impl Parts {
    /// From this triangle on, the part of that name: another one than before, or the same going on.
    pub(super) fn go_on(&mut self, name: String, triangle: usize) {
        let next = self.names.len();
        let number = *self.numbers.entry(name.clone()).or_insert(next);
        if number == next {
            self.names.push(name);
        }
        self.starts.push((number, triangle));
    }

    /// From this triangle on, a part of its own, whose name gets a number if another part has it.
    pub(super) fn begin(&mut self, name: &str, triangle: usize) {
        let mut own = name.to_owned();
        let mut number = 1;
        while self.numbers.contains_key(&own) {
            number += 1;
            own = format!("{name}-{number}");
        }
        self.go_on(own, triangle);
    }

    pub(super) fn is_empty(&self) -> bool {
        self.names.is_empty()
    }

    /// Each part's number with a stretch of triangles, of which there are `count`; those before the first part are nobody's.
    fn runs(&self, count: usize) -> impl Iterator<Item = (usize, std::ops::Range<usize>)> + '_ {
        let ends = self.starts.iter().skip(1).map(|(_, start)| *start).chain([count]);
        self.starts.iter().zip(ends).map(|((part, start), end)| (*part, *start..end))
    }
}
