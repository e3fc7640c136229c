//! Mesh of finite elements of a layer's section: finest where the contact may end and where the object curves.

use super::profile::Profile;

/// Sizes of elements, as fractions of the layer's thickness.
mod size {
    /// Where the contact may end.
    pub const EDGE: f64 = 0.03;
    /// Under flat parts.
    pub const FLAT: f64 = 0.1;
    /// Smallest size.
    pub const LEAST: f64 = 0.004;
    /// Smallest height of elements at the surface.
    pub const TOP: f64 = 0.017;
    /// Near the shell.
    pub const DEEP: f64 = 0.2;
    /// In the ring in which surfaces are compared.
    pub const RING: f64 = 0.067;
    /// Far from the contact.
    pub const FAR: f64 = 0.67;
    /// Growth of sizes along r, and from row to row.
    pub const GROWTH: [f64; 2] = [0.22, 0.3];
}

/// Width of the layer outside the contact that is modelled, thicknesses.
const MARGIN_THICKNESSES: f64 = 6.0;

/// Nodes of biquadratic quadrilaterals: column by column from the axis outwards, in each column from the shell to the
/// surface.
#[derive(Clone, Debug)]
pub struct Mesh {
    /// Positions (r, z) of the nodes, z = 0 at the shell.
    pub nodes: Vec<[f64; 2]>,
    /// Elements along r.
    pub columns: usize,
    /// Elements across the layer.
    pub rows: usize,
}

/// Dimensions that a mesh is made for.
#[derive(Clone, Copy, Debug)]
pub struct Extent {
    /// The layer's thickness, mm.
    pub thickness: f64,
    /// Depth of the press, mm.
    pub depth: f64,
    /// Approximate outer radius of the contact, mm.
    pub contact: f64,
    /// Width of the ring outside the contact that matters, mm.
    pub ring: f64,
    /// Factor on the fineness: 2 halves the size of all elements.
    pub refine: f64,
}

impl Mesh {
    /// Creates the mesh for an object that is pressed in; `drop` is how far the layer's surface lies below its highest
    /// point at a radius, mm.
    pub fn new(profile: &Profile, extent: Extent, drop: impl Fn(f64) -> f64) -> Self {
        let (r_edges, top) = column_edges(profile, extent);
        let z_edges = row_edges(extent, top);
        let (across, along) = (insert_midpoints(&z_edges), insert_midpoints(&r_edges));
        let mut nodes = Vec::with_capacity(across.len() * along.len());
        for r in &along {
            let scale = 1.0 - drop(*r) / extent.thickness;
            nodes.extend(across.iter().map(|z| [*r, z * scale]));
        }
        Self { nodes, columns: r_edges.len() - 1, rows: z_edges.len() - 1 }
    }

    /// Creates the mesh of a regular box, for tests.
    #[cfg(test)]
    pub fn regular_block(size: [f64; 2], columns: usize, rows: usize) -> Self {
        let edges =
            |length: f64, count: usize| (0..=count).map(|k| length * k as f64 / count as f64).collect::<Vec<_>>();
        let (along, across) = (insert_midpoints(&edges(size[0], columns)), insert_midpoints(&edges(size[1], rows)));
        let nodes = along.iter().flat_map(|r| across.iter().map(|z| [*r, *z])).collect();
        Self { nodes, columns, rows }
    }

    /// Number of nodes in a column.
    pub fn nodes_per_column(&self) -> usize {
        2 * self.rows + 1
    }

    /// Nodes of an element, r slowest.
    pub fn element_nodes(&self, column: usize, row: usize) -> [usize; 9] {
        std::array::from_fn(|k| (2 * column + k / 3) * self.nodes_per_column() + 2 * row + k % 3)
    }

    /// Nodes of the surface of a column of elements.
    pub fn surface_nodes(&self, column: usize) -> [usize; 3] {
        std::array::from_fn(|k| (2 * column + k + 1) * self.nodes_per_column() - 1)
    }
}

/// Computes the edges of the elements along r, and the height of those at the surface.
fn column_edges(profile: &Profile, extent: Extent) -> (Vec<f64>, f64) {
    let Extent { thickness, depth, contact, ring, refine } = extent;
    let small = (contact / 20.0).clamp(0.015 * thickness, size::EDGE * thickness);
    // Ranges where elements have to be small: from, to, size. While it is pressed, a point of the pad slides along the
    // object by about `slide`.
    let mut wanted = vec![(0.0, contact + 0.13 * thickness, size::FLAT * thickness)];
    let slide = 0.15 * thickness;
    // A bulge may reach as high as this over the undeformed pad.
    let reached = depth + 0.15 * thickness;
    for ([r, z], along, curvature) in profile.curve_points() {
        if r < 0.0 || z > reached || r > contact + slide {
            continue;
        }
        if curvature > 1.0 / (5.0 * small) {
            let fine = (0.2 / curvature).max(size::LEAST * thickness);
            wanted.push(((r - slide).max(0.0), r + slide, fine));
        } else if along[1] > 0.03 {
            wanted.push(((r - 0.13 * thickness).max(0.0), r + 0.13 * thickness, small));
        }
    }
    let end = contact + MARGIN_THICKNESSES * thickness;
    let at = |r: f64| {
        let limit = if r < contact + ring { size::RING } else { size::FAR } * thickness;
        let near = wanted.iter().map(|(from, to, fine)| fine + size::GROWTH[0] * (from - r).max(r - to).max(0.0));
        near.fold(limit, f64::min) / refine
    };
    let (mut edges, mut least) = (vec![0.0], f64::INFINITY);
    let mut r = 0.0;
    while r < end {
        // The size at the end of the element, if that is smaller.
        let here = at(r);
        let step = here.min(at(r + here));
        least = least.min(step);
        r += step;
        edges.push(r);
    }
    let top = small.min((1.5 * least * refine).max(size::TOP * thickness)) / refine;
    (edges, top)
}

/// Computes the edges of the elements across the layer, from the shell to the surface.
fn row_edges(extent: Extent, top: f64) -> Vec<f64> {
    let Extent { thickness, refine, .. } = extent;
    let mut down = vec![0.0];
    let (mut step, mut depth) = (top, 0.0);
    while depth < thickness {
        depth += step;
        down.push(depth);
        step = (step * (1.0 + size::GROWTH[1] / refine)).min(size::DEEP * thickness);
    }
    down.iter().rev().map(|below| thickness * (1.0 - below / depth)).collect()
}

fn insert_midpoints(edges: &[f64]) -> Vec<f64> {
    let mut all = vec![edges[0]];
    for pair in edges.windows(2) {
        all.extend([(pair[0] + pair[1]) / 2.0, pair[1]]);
    }
    all
}
