//! The object that is pressed into the pad, and its pose.

use std::sync::Arc;

use super::height_map::HeightMap;
use super::seen_surface::SeenSurface;
use crate::base::grid::Grid;
use crate::mesh::Mesh;
use crate::mesh::clusters::Clusters;
use crate::pose::Pose;

/// The object that is pressed into the pad, and where it is.
///
/// The depth follows from geometry and pose, so the three change only together: see [`Indenter::moved_to`] and
/// [`Indenter::at_depth_mm`]. A clone shares the geometry.
#[derive(Clone, Debug)]
pub struct Indenter {
    pub(crate) shape: Shape,
    pub(crate) pose: Pose,
    pub(crate) depth_mm: f64,
}

/// The geometry of an indenter.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum Shape {
    /// A mesh, ready for capture.
    Mesh(Arc<Clusters>),
    /// Heights over the pad at the pixels of the simulator's view.
    HeightMap(Arc<HeightMap>),
    /// The part of an object that a camera inside a curved gel sees.
    Seen(Arc<SeenSurface>),
}

impl Shape {
    /// Returns the triangles; `None` for a height map.
    pub fn clusters(&self) -> Option<&Clusters> {
        match self {
            Self::Mesh(clusters) => Some(clusters),
            Self::Seen(seen) => Some(&seen.near_gel),
            Self::HeightMap(_) => None,
        }
    }

    /// Returns the number of pixels where nothing is known, such as those that a depth camera could not see; 0 for a
    /// mesh.
    pub fn unseen_px(&self) -> u64 {
        match self {
            Self::Mesh(_) => 0,
            Self::HeightMap(map) => map.unseen_px,
            Self::Seen(seen) => seen.unseen_px,
        }
    }
}

/// Why an array is not a height map.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum HeightMapError {
    /// The length of the array does not fit the size.
    #[error("{found} values for {width} x {height} pixels")]
    Length {
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
        /// Length of the array.
        found: usize,
    },
    /// A value is NaN or plus infinity.
    #[error("the depth of pixel {index} (row-major) is NaN or infinite; use minus infinity where there is no object")]
    NotADepth {
        /// Index of the value.
        index: usize,
    },
}

impl Indenter {
    /// Returns the geometry.
    pub fn shape(&self) -> &Shape {
        &self.shape
    }

    /// Returns the pose of a mesh in the sensor's frame. For a height map, it is the origin from which textures are
    /// laid out and about which motion in the pad's plane turns.
    pub fn pose(&self) -> &Pose {
        &self.pose
    }

    /// Returns how deep the lowest point reaches below the undeformed pad, mm; 0 or less without contact.
    pub fn depth_mm(&self) -> f64 {
        self.depth_mm
    }

    /// Makes an indenter from a mesh at a pose. To press the same mesh elsewhere, use [`Indenter::moved_to`].
    pub fn mesh(mesh: &Mesh, pose: Pose) -> Self {
        Self::clusters(Arc::new(Clusters::new(mesh)), pose)
    }

    /// Makes an indenter from clusters that were prepared before.
    pub fn clusters(clusters: Arc<Clusters>, pose: Pose) -> Self {
        let depth_mm = 0.0 - pose.lowest_mm(&clusters);
        Self { shape: Shape::Mesh(clusters), pose, depth_mm }
    }

    /// Makes an indenter whose depth is given, mm: it was measured elsewhere than at the lowest point, or by whoever
    /// saw the object.
    pub fn of_known_depth(shape: Shape, pose: Pose, depth_mm: f64) -> Self {
        Self { shape, pose, depth_mm }
    }

    /// Returns the indenter raised or lowered until its lowest point is `depth_mm` below the undeformed pad. A height
    /// map is raised or lowered as a whole; a seen surface only gets the new depth.
    pub fn at_depth_mm(&self, depth_mm: f64) -> Self {
        match &self.shape {
            Shape::Mesh(clusters) => self.moved_to(self.pose.lowered(-depth_mm, clusters)),
            Shape::HeightMap(map) => {
                let lowest_mm = map.above_mm.data.iter().fold(f32::INFINITY, |lowest, mm| lowest.min(*mm));
                if lowest_mm == f32::INFINITY {
                    return self.clone(); // there is no object
                }
                let by = (f64::from(lowest_mm) + depth_mm) as f32;
                let data = map.above_mm.data.iter().map(|above| above - by).collect();
                let map = HeightMap {
                    above_mm: Grid { data, width: map.above_mm.width, height: map.above_mm.height },
                    unseen_px: map.unseen_px,
                };
                Self { shape: Shape::HeightMap(Arc::new(map)), pose: self.pose, depth_mm }
            }
            Shape::Seen(_) => Self { depth_mm, ..self.clone() },
        }
    }

    /// Joins several meshes that are pressed in together into one rigid body with the first one's pose: motion, and the
    /// placement of textures, refer to it. `None` without any object, or if one of them is not a mesh.
    pub fn join_meshes(objects: &[Self]) -> Option<Self> {
        let (first, others) = objects.split_first()?;
        let Shape::Mesh(own) = &first.shape else { return None };
        if others.is_empty() {
            return Some(first.clone());
        }
        let back = first.pose.rotation.transpose();
        let placed = |other: &'_ Self| match &other.shape {
            Shape::Mesh(mesh) => {
                let at = back * (other.pose.translation_mm - first.pose.translation_mm);
                Some((Arc::clone(mesh), back * other.pose.rotation, at))
            }
            Shape::HeightMap(_) | Shape::Seen(_) => None,
        };
        let placed: Vec<_> = others.iter().map(placed).collect::<Option<_>>()?;
        Some(Self::clusters(Arc::new(own.with_others(&placed)), first.pose))
    }

    /// Returns the indenter at another pose. A height map stays where it is, and a seen surface keeps its depth.
    pub fn moved_to(&self, pose: Pose) -> Self {
        match &self.shape {
            Shape::Mesh(clusters) => Self::clusters(Arc::clone(clusters), pose),
            Shape::HeightMap(_) | Shape::Seen(_) => Self { pose, ..self.clone() },
        }
    }

    /// Makes an indenter from an array: how far the object reaches below the undeformed pad at each pixel of the view,
    /// mm, row-major; negative above the pad, minus infinity where there is no object.
    ///
    /// # Errors
    ///
    /// If the array does not have `width * height` values, or one of them is NaN or plus infinity.
    pub fn height_map([width, height]: [usize; 2], depth_mm: Vec<f32>) -> Result<Self, HeightMapError> {
        if depth_mm.len() != width * height {
            return Err(HeightMapError::Length { width, height, found: depth_mm.len() });
        }
        if let Some(index) = depth_mm.iter().position(|depth| depth.is_nan() || *depth == f32::INFINITY) {
            return Err(HeightMapError::NotADepth { index });
        }
        let data = depth_mm.into_iter().map(|depth| 0.0 - depth).collect();
        Ok(Self::from_heights(HeightMap { above_mm: Grid { width, height, data }, unseen_px: 0 }))
    }

    /// Makes an indenter from heights over the pad.
    pub fn from_heights(map: HeightMap) -> Self {
        let depth_mm = map.indentation_depth_mm();
        Self { shape: Shape::HeightMap(Arc::new(map)), pose: Pose::IDENTITY, depth_mm }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_height_map_is_lowered_until_its_lowest_point_is_so_deep() {
        let hovering = Indenter::height_map([3, 1], vec![-1.0, f32::NEG_INFINITY, -2.5]).expect("a height map");
        assert_eq!(hovering.depth_mm(), 0.0);
        let lowered = hovering.at_depth_mm(0.5);
        let Shape::HeightMap(map) = lowered.shape() else { panic!("a height map stays one") };
        assert_eq!((map.above_mm.data.as_slice(), lowered.depth_mm()), (&[-0.5, f32::INFINITY, 1.0][..], 0.5));
        let nothing = Indenter::height_map([1, 1], vec![f32::NEG_INFINITY]).expect("a height map").at_depth_mm(0.5);
        let Shape::HeightMap(map) = nothing.shape() else { panic!("a height map stays one") };
        assert_eq!((map.above_mm.data.as_slice(), nothing.depth_mm()), (&[f32::INFINITY][..], 0.0));
    }
}
