//! Contact of the layer's surface with the object: penalties keep it outside the object and, if it sticks, in place.

use super::element::quadratic_shapes;
use super::layer::{BondedLayer, LinearSystem};
use super::profile::{Profile, SurfaceDistance};

/// Pressure over Young's modulus at a penetration of one thickness.
const NORMAL_STIFFNESS: f64 = 12_000.0;
/// Traction over Young's modulus at a slip of one thickness.
const STICKING_STIFFNESS: f64 = 3000.0;

/// Points and weights of Gauss's rule with four points.
const GAUSS_4: [(f64, f64); 4] = [
    (-0.861_136_311_594_052_6, 0.347_854_845_137_453_9),
    (-0.339_981_043_584_856_26, 0.652_145_154_862_546_1),
    (0.339_981_043_584_856_26, 0.652_145_154_862_546_1),
    (0.861_136_311_594_052_6, 0.347_854_845_137_453_9),
];

/// A point of integration on the surface.
#[derive(Clone, Debug)]
struct ContactPoint {
    nodes: [usize; 3],
    shape: [f64; 3],
    /// Length that the point stands for, times its radius, mm^2.
    weight: f64,
    /// Place, relative to the object, where the point began to touch, and the tangent there.
    anchor: Option<([f64; 2], [f64; 2])>,
}

/// The layer's surface, which may touch an object.
#[derive(Clone, Debug)]
pub struct ContactSurface {
    spots: Vec<ContactPoint>,
    sticking: bool,
    thickness: f64,
}

impl ContactSurface {
    /// Creates the surface of a layer that touches nothing yet.
    pub fn new(layer: &BondedLayer, thickness: f64, sticking: bool) -> Self {
        let mut spots = Vec::new();
        for column in 0..layer.mesh.columns {
            let nodes = layer.mesh.surface_nodes(column);
            let at = nodes.map(|node| layer.mesh.nodes[node]);
            for (x, by) in GAUSS_4 {
                let (shape, slope) = quadratic_shapes(x);
                let sum = |of: [f64; 3], c: usize| (0..3).map(|n| of[n] * at[n][c]).sum::<f64>();
                let length = libm::hypot(sum(slope, 0), sum(slope, 1));
                spots.push(ContactPoint { nodes, shape, weight: by * length * sum(shape, 0), anchor: None });
            }
        }
        Self { spots, sticking, thickness }
    }

    /// Position of a point at a state, relative to the object's lowest point, mm.
    fn relative_place(&self, spot: &ContactPoint, layer: &BondedLayer, state: &[f64], depth: f64) -> [f64; 2] {
        let mut place = [0.0, depth - self.thickness];
        for (node, shape) in spot.nodes.iter().zip(spot.shape) {
            let (at, moved) = (layer.mesh.nodes[*node], layer.node_displacement(state, *node));
            place = [place[0] + shape * (at[0] + moved[0]), place[1] + shape * (at[1] + moved[1])];
        }
        place
    }

    /// Traction on a point over Young's modulus, and its derivative with respect to the position. `None` without
    /// contact.
    fn contact_traction(
        &self,
        spot: &ContactPoint,
        place: [f64; 2],
        object: &Profile,
    ) -> Option<([f64; 2], [[f64; 2]; 2])> {
        let SurfaceDistance { distance, normal: [nr, nz], curvature } = object.measure_distance(place);
        if distance >= 0.0 && spot.anchor.is_none() {
            return None;
        }
        let (normal, sticking) = (NORMAL_STIFFNESS / self.thickness, STICKING_STIFFNESS / self.thickness);
        let (mut push, mut matrix) = ([0.0; 2], [[0.0; 2]; 2]);
        if distance < 0.0 {
            push = [-normal * distance * nr, -normal * distance * nz];
            let bend = normal * distance * curvature;
            let across = [[1.0 - nr * nr, -nr * nz], [-nr * nz, 1.0 - nz * nz]];
            let along = [[nr * nr, nr * nz], [nr * nz, nz * nz]];
            matrix = std::array::from_fn(|a| std::array::from_fn(|b| normal * along[a][b] + bend * across[a][b]));
        }
        if let Some((anchor, tangent)) = spot.anchor {
            let slip = tangent[0] * (place[0] - anchor[0]) + tangent[1] * (place[1] - anchor[1]);
            for a in 0..2 {
                push[a] -= sticking * slip * tangent[a];
                for b in 0..2 {
                    matrix[a][b] += sticking * tangent[a] * tangent[b];
                }
            }
        }
        Some((push, matrix))
    }

    /// Adds the tractions of the object to a system.
    pub fn add_tractions(
        &self,
        system: &mut LinearSystem,
        layer: &BondedLayer,
        state: &[f64],
        object: &Profile,
        depth: f64,
    ) {
        for spots in self.spots.chunks_exact(4) {
            let (mut forces, mut derivatives, mut any) = ([0.0; 6], [[0.0; 6]; 6], false);
            for spot in spots {
                let place = self.relative_place(spot, layer, state, depth);
                let Some((push, matrix)) = self.contact_traction(spot, place, object) else { continue };
                any = true;
                for row in 0..6 {
                    let by = spot.weight * spot.shape[row / 2];
                    forces[row] -= by * push[row % 2];
                    for column in 0..6 {
                        derivatives[row][column] += by * spot.shape[column / 2] * matrix[row % 2][column % 2];
                    }
                }
            }
            if any {
                layer.add_forces(system, spots[0].nodes, forces, &derivatives);
            }
        }
    }

    /// Anchors points that touch to their place on the object, and releases points that left it.
    pub fn update_anchors(&mut self, layer: &BondedLayer, state: &[f64], object: &Profile, depth: f64) {
        if !self.sticking {
            return;
        }
        let mut spots = std::mem::take(&mut self.spots);
        for spot in &mut spots {
            let place = self.relative_place(spot, layer, state, depth);
            let SurfaceDistance { distance, normal: [nr, nz], .. } = object.measure_distance(place);
            spot.anchor = (distance < 0.0).then(|| spot.anchor.unwrap_or((place, [-nz, nr])));
        }
        self.spots = spots;
    }

    /// Force on the object along its axis over Young's modulus, mm^2.
    pub fn axial_force(&self, layer: &BondedLayer, state: &[f64], object: &Profile, depth: f64) -> f64 {
        let mut force = 0.0;
        for spot in &self.spots {
            let place = self.relative_place(spot, layer, state, depth);
            if let Some((push, _)) = self.contact_traction(spot, place, object) {
                force -= spot.weight * push[1];
            }
        }
        2.0 * std::f64::consts::PI * force
    }

    /// Radii of all points, and whether they touch.
    pub fn contact_states(&self, layer: &BondedLayer, state: &[f64], object: &Profile, depth: f64) -> Vec<(f64, bool)> {
        let places = self.spots.iter().map(|spot| self.relative_place(spot, layer, state, depth));
        places.map(|place| (place[0], object.measure_distance(place).distance < 0.0)).collect()
    }
}
