//! A mesh ready for capture: clusters of neighbouring triangles under a bounding-volume hierarchy.
//!
//! Up to 128 triangles that are neighbours along a Morton curve form a cluster with its own vertices, so that a pose
//! transforms each vertex about once, and one box test can skip a cluster. The hierarchy over the boxes comes from
//! obvhs (PLOC). Meshes must not contain equal triangles (see [`super::cleaning`]); these could make the build take
//! quadratic time.

use glam::{DMat3, DVec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};
use std::fmt;
use std::sync::Arc;

use super::cleaning::Mesh;

/// Most triangles in a cluster.
pub const MAX_TRIANGLES: usize = 128;
/// Most vertices in a cluster, so that a vertex number fits in a byte.
pub const MAX_VERTICES: usize = 128;

/// A range of triangles, and of the vertices that belong to them only.
#[derive(Clone, Copy, Debug)]
pub struct Cluster {
    first_vertex: u32,
    first_triangle: u32,
    vertex_count: u8,
    triangle_count: u8,
}

/// The clusters of a mesh.
pub struct Clusters {
    hierarchy: Bvh2,
    clusters: Vec<Cluster>,
    x: Vec<f32>,
    y: Vec<f32>,
    z: Vec<f32>,
    corners: Vec<[u8; 3]>,
    centre_mm: [f64; 3],
}

/// Geometry of one cluster, mm relative to the object's centre.
#[derive(Clone, Copy)]
pub struct ClusterPart<'a> {
    /// x of the vertices.
    pub x: &'a [f32],
    /// y of the vertices.
    pub y: &'a [f32],
    /// z of the vertices.
    pub z: &'a [f32],
    /// The triangles, as indices of vertices.
    pub corners: &'a [[u8; 3]],
}

impl fmt::Debug for Clusters {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Clusters").finish_non_exhaustive()
    }
}

impl Clusters {
    /// Makes an object without triangles: queries find nothing.
    pub fn empty() -> Self {
        Self {
            hierarchy: Bvh2::default(),
            clusters: Vec::new(),
            x: Vec::new(),
            y: Vec::new(),
            z: Vec::new(),
            corners: Vec::new(),
            centre_mm: [0.0; 3],
        }
    }

    /// Returns true if there are no triangles.
    pub(crate) fn is_empty(&self) -> bool {
        self.clusters.is_empty()
    }

    /// Returns the corners of triangle `number`, mm relative to the object's centre. Triangles are numbered in the order
    /// of [`Self::triangles`].
    pub(crate) fn triangle(&self, number: usize) -> [DVec3; 3] {
        let cluster = self.clusters.partition_point(|cluster| cluster.first_triangle as usize <= number) - 1;
        self.corners_in(&self.clusters[cluster], number)
    }

    /// Returns the corners of all triangles, in an order that depends on the mesh alone.
    pub(crate) fn triangles(&self) -> impl Iterator<Item = [DVec3; 3]> {
        self.clusters.iter().flat_map(move |cluster| {
            let first = cluster.first_triangle as usize;
            (first..first + usize::from(cluster.triangle_count)).map(move |number| self.corners_in(cluster, number))
        })
    }

    fn corners_in(&self, cluster: &Cluster, number: usize) -> [DVec3; 3] {
        self.corners[number].map(|corner| {
            let at = cluster.first_vertex as usize + usize::from(corner);
            DVec3::new(self.x[at].into(), self.y[at].into(), self.z[at].into())
        })
    }

    /// Returns the memory that the object takes, bytes.
    pub fn memory_bytes(&self) -> usize {
        let axes = [&self.x, &self.y, &self.z].map(|values| size_of_val(values.as_slice()));
        let nodes =
            size_of_val(self.hierarchy.nodes.as_slice()) + size_of_val(self.hierarchy.primitive_indices.as_slice());
        let clusters = size_of_val(self.clusters.as_slice()) + size_of_val(self.corners.as_slice());
        axes.iter().sum::<usize>() + nodes + clusters
    }

    /// Divides a mesh into clusters.
    pub fn new(mesh: &Mesh) -> Self {
        let mut order = morton_order(mesh);
        let mut built = Self {
            hierarchy: Bvh2::default(),
            clusters: Vec::with_capacity(order.len() / 100 + 1),
            x: Vec::with_capacity(mesh.vertices.len() * 5 / 4),
            y: Vec::with_capacity(mesh.vertices.len() * 5 / 4),
            z: Vec::with_capacity(mesh.vertices.len() * 5 / 4),
            corners: Vec::with_capacity(order.len()),
            centre_mm: mesh.centre_mm,
        };
        // For each vertex of the mesh: the cluster that copied it last, and its index in that cluster.
        let mut seen = vec![(u32::MAX, 0_u8); mesh.vertices.len()];
        let mut open = Cluster { first_vertex: 0, first_triangle: 0, vertex_count: 0, triangle_count: 0 };
        let mut boxes = Vec::new();
        for index in order.drain(..) {
            let triangle = mesh.triangles[index as usize];
            let id = built.clusters.len() as u32;
            let new = triangle.iter().filter(|&&v| seen[v as usize].0 != id).count();
            // A triangle may add up to three vertices that the open cluster does not have yet.
            let full = open.triangle_count as usize == MAX_TRIANGLES || open.vertex_count as usize + new > MAX_VERTICES;
            if full {
                boxes.push(built.push_cluster(open));
                open = Cluster {
                    first_vertex: built.x.len() as u32,
                    first_triangle: built.corners.len() as u32,
                    vertex_count: 0,
                    triangle_count: 0,
                };
            }
            let id = built.clusters.len() as u32;
            let corners = triangle.map(|v| {
                let slot = &mut seen[v as usize];
                if slot.0 != id {
                    *slot = (id, open.vertex_count);
                    open.vertex_count += 1;
                    let [x, y, z] = mesh.vertices[v as usize];
                    built.x.push(x);
                    built.y.push(y);
                    built.z.push(z);
                }
                slot.1
            });
            built.corners.push(corners);
            open.triangle_count += 1;
        }
        boxes.push(built.push_cluster(open));
        built.hierarchy = build_hierarchy(&boxes);
        [&mut built.x, &mut built.y, &mut built.z].into_iter().for_each(Vec::shrink_to_fit);
        built
    }

    /// Returns the object scaled about its origin by `factor`, which must be above 0.
    pub fn scaled(&self, factor: f64) -> Self {
        let by = factor as f32;
        let scaled = |values: &[f32]| values.iter().map(|value| value * by).collect();
        let mut hierarchy = self.hierarchy.clone();
        for node in &mut hierarchy.nodes {
            // Rounding preserves the order of numbers: the box of the scaled vertices is the scaled box.
            let bounds = *node.aabb();
            node.set_aabb(Aabb::new(bounds.min * by, bounds.max * by));
        }
        Self {
            hierarchy,
            clusters: self.clusters.clone(),
            x: scaled(&self.x),
            y: scaled(&self.y),
            z: scaled(&self.z),
            corners: self.corners.clone(),
            centre_mm: self.centre_mm.map(|mm| mm * factor),
        }
    }

    /// Joins this object with others into one, in this object's frame. The rotation and translation (mm) of each of the
    /// others take it into this frame. This object's coordinates keep their bits.
    pub(crate) fn with_others(&self, others: &[(Arc<Self>, DMat3, DVec3)]) -> Self {
        let own = (self, DMat3::IDENTITY, DVec3::ZERO);
        let all = || std::iter::once(own).chain(others.iter().map(|(other, turn, at)| (&**other, *turn, *at)));
        let (vertices, triangles) = all().fold((0, 0), |(v, t), (part, ..)| (v + part.x.len(), t + part.corners.len()));
        let mut joined = Self {
            hierarchy: Bvh2::default(),
            clusters: Vec::with_capacity(all().map(|(part, ..)| part.clusters.len()).sum()),
            x: Vec::with_capacity(vertices),
            y: Vec::with_capacity(vertices),
            z: Vec::with_capacity(vertices),
            corners: Vec::with_capacity(triangles),
            centre_mm: self.centre_mm,
        };
        let mut boxes = Vec::with_capacity(joined.clusters.capacity());
        for (part, rotation, translation_mm) in all() {
            // Summed in this order, nothing is lost where the object is far from its origin.
            let centre =
                rotation * DVec3::from_array(part.centre_mm) + translation_mm - DVec3::from_array(self.centre_mm);
            let first_triangle = joined.corners.len() as u32;
            joined.corners.extend_from_slice(&part.corners);
            for cluster in &part.clusters {
                let first_vertex = joined.x.len() as u32;
                let ClusterPart { x, y, z, .. } = part.cluster_part(*cluster);
                for ((x, y), z) in x.iter().zip(y).zip(z) {
                    let moved = rotation * DVec3::new(f64::from(*x), f64::from(*y), f64::from(*z)) + centre;
                    joined.x.push(moved.x as f32);
                    joined.y.push(moved.y as f32);
                    joined.z.push(moved.z as f32);
                }
                let first_triangle = first_triangle + cluster.first_triangle;
                boxes.push(joined.push_cluster(Cluster { first_vertex, first_triangle, ..*cluster }));
            }
        }
        joined.hierarchy = build_hierarchy(&boxes);
        joined
    }

    fn push_cluster(&mut self, cluster: Cluster) -> Aabb {
        let vertices = cluster.first_vertex as usize..self.x.len();
        let mut bounds = Aabb::empty();
        for at in vertices {
            bounds.extend(Vec3A::new(self.x[at], self.y[at], self.z[at]));
        }
        self.clusters.push(cluster);
        bounds
    }

    /// Returns the point of the object's own frame that all coordinates are relative to, mm.
    pub fn centre_mm(&self) -> [f64; 3] {
        self.centre_mm
    }

    /// Calls `visit` for every part whose box, and all boxes around it, pass `keep(min, max)`.
    #[inline(always)]
    pub fn query<'a>(
        &'a self,
        mut keep: impl FnMut([f32; 3], [f32; 3]) -> bool,
        mut visit: impl FnMut(ClusterPart<'a>),
    ) {
        let mut stack = vec![0_usize];
        while let Some(at) = stack.pop() {
            let Some(node) = self.hierarchy.nodes.get(at) else { continue };
            if !keep(node.aabb().min.to_array(), node.aabb().max.to_array()) {
                continue;
            }
            let first = node.first_index as usize;
            if node.is_leaf() {
                for &cluster in &self.hierarchy.primitive_indices[first..first + node.prim_count as usize] {
                    visit(self.cluster_part(self.clusters[cluster as usize]));
                }
            } else {
                stack.extend([first + 1, first]);
            }
        }
    }

    #[inline(always)]
    fn cluster_part(&self, cluster: Cluster) -> ClusterPart<'_> {
        let vertices = cluster.first_vertex as usize..cluster.first_vertex as usize + cluster.vertex_count as usize;
        let triangles =
            cluster.first_triangle as usize..cluster.first_triangle as usize + cluster.triangle_count as usize;
        ClusterPart {
            x: &self.x[vertices.clone()],
            y: &self.y[vertices.clone()],
            z: &self.z[vertices],
            corners: &self.corners[triangles],
        }
    }

    /// Returns the largest value of `direction . vertex`, with vertices relative to [`Clusters::centre_mm`].
    pub fn extreme(&self, direction: [f64; 3]) -> f64 {
        let best = std::cell::Cell::new(f64::NEG_INFINITY);
        self.query(
            |min, max| {
                // The upper bound of the dot product over a box takes the better of its sides along each axis.
                let bound: f64 =
                    (0..3).map(|k| (direction[k] * f64::from(min[k])).max(direction[k] * f64::from(max[k]))).sum();
                bound > best.get()
            },
            |part| {
                for ((x, y), z) in part.x.iter().zip(part.y).zip(part.z) {
                    let along =
                        direction[0] * f64::from(*x) + direction[1] * f64::from(*y) + direction[2] * f64::from(*z);
                    best.set(best.get().max(along));
                }
            },
        );
        best.get()
    }

    /// Returns the mean of the vertices whose `direction . vertex` is within `slack` of `extreme`, relative to the
    /// centre.
    pub fn extreme_point(&self, direction: [f64; 3], extreme: f64, slack: f64) -> [f64; 3] {
        let (mut sum, mut count) = ([0.0; 3], 0.0);
        self.query(
            |min, max| {
                let bound: f64 =
                    (0..3).map(|k| (direction[k] * f64::from(min[k])).max(direction[k] * f64::from(max[k]))).sum();
                bound >= extreme - slack
            },
            |part| {
                for at in 0..part.x.len() {
                    let vertex = [part.x[at], part.y[at], part.z[at]].map(f64::from);
                    let along: f64 = (0..3).map(|k| direction[k] * vertex[k]).sum();
                    if along >= extreme - slack {
                        (0..3).for_each(|k| sum[k] += vertex[k]);
                        count += 1.0;
                    }
                }
            },
        );
        sum.map(|total: f64| total / f64::max(count, 1.0))
    }
}

/// Builds the hierarchy over the boxes of clusters, in their order.
fn build_hierarchy(boxes: &[Aabb]) -> Bvh2 {
    let numbers: Vec<u32> = (0..boxes.len() as u32).collect();
    PlocBuilder::new().build(PlocSearchDistance::Low, boxes, numbers, SortPrecision::U64, 0)
}

/// Returns the triangles' numbers along a Morton (Z-order) curve through their centres.
fn morton_order(mesh: &Mesh) -> Vec<u32> {
    const BITS: u32 = 21;
    let mut min = [f32::INFINITY; 3];
    let mut max = [f32::NEG_INFINITY; 3];
    for vertex in &mesh.vertices {
        for k in 0..3 {
            min[k] = min[k].min(vertex[k]);
            max[k] = max[k].max(vertex[k]);
        }
    }
    let size = (0..3).map(|k| f64::from(max[k]) - f64::from(min[k])).fold(f64::MIN_POSITIVE, f64::max);
    let scale = f64::from((1_u32 << BITS) - 1) / size;
    let mut keyed: Vec<(u64, u32)> = mesh
        .triangles
        .iter()
        .enumerate()
        .map(|(index, triangle)| {
            let mut key = 0;
            for (k, min) in min.iter().enumerate() {
                let sum: f64 = triangle.iter().map(|&v| f64::from(mesh.vertices[v as usize][k])).sum();
                key |= spread_bits(((sum / 3.0 - f64::from(*min)) * scale) as u64) << k;
            }
            (key, index as u32)
        })
        .collect();
    // The number breaks ties, so that an unstable sort has a unique result.
    keyed.sort_unstable();
    keyed.into_iter().map(|(_, index)| index).collect()
}

/// Inserts two zero bits between neighbouring bits of the lowest 21.
fn spread_bits(bits: u64) -> u64 {
    let mut v = bits & 0x1f_ffff;
    v = (v | v << 32) & 0x001f_0000_0000_ffff;
    v = (v | v << 16) & 0x001f_0000_ff00_00ff;
    v = (v | v << 8) & 0x100f_00f0_0f00_f00f;
    v = (v | v << 4) & 0x10c3_0c30_c30c_30c3;
    (v | v << 2) & 0x1249_2492_4924_9249
}
