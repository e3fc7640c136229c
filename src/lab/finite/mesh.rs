//! The finite elements of a layer's section: finest where the contact may end and where the object bends.

use super::profile::Profile;

/// Sizes of elements, as fractions of the layer's thickness.
mod size {
    /// Where the contact may end.
    pub const EDGE: f64 = 0.03;
    /// Under what is flat.
    pub const FLAT: f64 = 0.1;
    /// The finest.
    pub const LEAST: f64 = 0.004;
    /// The finest at the surface of elements' height.
    pub const TOP: f64 = 0.017;
    /// Near the shell.
    pub const DEEP: f64 = 0.2;
    /// In the ring in which surfaces are compared.
    pub const RING: f64 = 0.067;
    /// Far from the contact.
    pub const FAR: f64 = 0.67;
    /// By how much sizes grow along r, and from row to row.
    pub const GROWTH: [f64; 2] = [0.22, 0.3];
}

/// The layer beyond the contact that is modelled, thicknesses.
const BEYOND: f64 = 6.0;

/// Nodes of biquadratic quadrilaterals, column by column from the axis outwards and in each from the shell to the surface.
#[derive(Clone, Debug)]
pub struct Mesh {
    /// Places (r, z) of the nodes, z = 0 at the shell.
    pub nodes: Vec<[f64; 2]>,
    /// Elements along r.
    pub columns: usize,
    /// Elements across the layer.
    pub rows: usize,
}

/// What a mesh is made for.
#[derive(Clone, Copy, Debug)]
pub struct Extent {
    /// The layer's thickness, mm.
    pub thickness: f64,
    /// How deep the object goes, mm.
    pub depth: f64,
    /// The contact's outer radius, about, mm.
    pub contact: f64,
    /// Width of the ring outside the contact that matters, mm.
    pub ring: f64,
    /// 1; elements of half the size at 2.
    pub refine: f64,
}

impl Mesh {
    /// For an object pressed in; `drop` is how far the layer's surface lies below its highest point at a radius.
    pub fn new(profile: &Profile, extent: Extent, drop: impl Fn(f64) -> f64) -> Self {
        let (r_edges, top) = radii(profile, extent);
        let z_edges = heights(extent, top);
        let (across, along) = (with_middles(&z_edges), with_middles(&r_edges));
        let mut nodes = Vec::with_capacity(across.len() * along.len());
        for r in &along {
            let scale = 1.0 - drop(*r) / extent.thickness;
            nodes.extend(across.iter().map(|z| [*r, z * scale]));
        }
        Self { nodes, columns: r_edges.len() - 1, rows: z_edges.len() - 1 }
    }

    /// Of a regular box, for tests.
    #[cfg(test)]
    pub fn block(size: [f64; 2], columns: usize, rows: usize) -> Self {
        let edges =
            |length: f64, count: usize| (0..=count).map(|k| length * k as f64 / count as f64).collect::<Vec<_>>();
        let (along, across) = (with_middles(&edges(size[0], columns)), with_middles(&edges(size[1], rows)));
        let nodes = along.iter().flat_map(|r| across.iter().map(|z| [*r, *z])).collect();
        Self { nodes, columns, rows }
    }

    /// Nodes in a column.
    pub fn column_nodes(&self) -> usize {
        2 * self.rows + 1
    }

    /// The nine nodes of an element, r slowest.
    pub fn element(&self, column: usize, row: usize) -> [usize; 9] {
        std::array::from_fn(|k| (2 * column + k / 3) * self.column_nodes() + 2 * row + k % 3)
    }

    /// The three nodes of the surface of a column of elements.
    pub fn surface(&self, column: usize) -> [usize; 3] {
        std::array::from_fn(|k| (2 * column + k + 1) * self.column_nodes() - 1)
    }
}

/// Edges of the elements along r, and the height of those at the surface.
fn radii(profile: &Profile, extent: Extent) -> (Vec<f64>, f64) {
    let Extent { thickness, depth, contact, ring, refine } = extent;
    let small = (contact / 20.0).clamp(0.015 * thickness, size::EDGE * thickness);
    // Where elements have to be small: from, to, size. The pad slides along what bends by this much.
    let mut wanted = vec![(0.0, contact + 0.13 * thickness, size::FLAT * thickness)];
    let slid = 0.15 * thickness;
    // A bulge may reach as high as this over the undeformed pad.
    let reached = depth + 0.15 * thickness;
    for ([r, z], along, curvature) in profile.points() {
        if r < 0.0 || z > reached || r > contact + slid {
            continue;
        }
        if curvature > 1.0 / (5.0 * small) {
            let fine = (0.2 / curvature).max(size::LEAST * thickness);
            wanted.push(((r - slid).max(0.0), r + slid, fine));
        } else if along[1] > 0.03 {
            wanted.push(((r - 0.13 * thickness).max(0.0), r + 0.13 * thickness, small));
        }
    }
    let end = contact + BEYOND * thickness;
    let at = |r: f64| {
        let limit = if r < contact + ring { size::RING } else { size::FAR } * thickness;
        let near = wanted.iter().map(|(from, to, fine)| fine + size::GROWTH[0] * (from - r).max(r - to).max(0.0));
        near.fold(limit, f64::min) / refine
    };
    let (mut edges, mut least) = (vec![0.0], f64::INFINITY);
    let mut r = 0.0;
    while r < end {
        // As at the end of the element, where that is finer.
        let here = at(r);
        let step = here.min(at(r + here));
        least = least.min(step);
        r += step;
        edges.push(r);
    }
    let top = small.min((1.5 * least * refine).max(size::TOP * thickness)) / refine;
    (edges, top)
}

/// Edges of the elements across the layer.
fn heights(extent: Extent, top: f64) -> Vec<f64> {
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

fn with_middles(edges: &[f64]) -> Vec<f64> {
    let mut all = vec![edges[0]];
    for pair in edges.windows(2) {
        all.extend([(pair[0] + pair[1]) / 2.0, pair[1]]);
    }
    all
}
