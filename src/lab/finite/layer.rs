//! A bonded layer: its elements, their free unknowns, and the system of equations at a state.

use super::band::BandMatrix;
use super::element::{DISPLACEMENTS, ElasticConstants, Element, ElementResponse, UNKNOWNS};
use super::mesh::Mesh;

/// Number of an unknown that is held at zero.
const FIXED: usize = usize::MAX;

/// A bonded layer of rubber.
#[derive(Clone, Debug)]
pub struct BondedLayer {
    /// Nodes and elements.
    pub mesh: Mesh,
    rubber: ElasticConstants,
    elements: Vec<(Element, [usize; UNKNOWNS])>,
    /// Numbers of the unknowns of each node's displacement.
    displacements: Vec<[usize; 2]>,
    /// Number of free unknowns.
    unknowns: usize,
    band: usize,
}

/// Forces on the free unknowns, and their derivatives.
pub struct LinearSystem {
    /// Forces that are not in balance, over Young's modulus.
    pub forces: Vec<f64>,
    /// Derivatives of the forces.
    pub matrix: BandMatrix,
}

impl BondedLayer {
    /// Creates a layer that is bonded at its lower side. At the axis and at its outer border it moves only vertically.
    pub fn new(mesh: Mesh, rubber: ElasticConstants) -> Self {
        let height = mesh.nodes_per_column();
        let (mut displacements, mut pressures) = (Vec::new(), Vec::new());
        let mut unknowns = 0;
        let mut next = |free: bool| {
            unknowns += usize::from(free);
            if free { unknowns - 1 } else { FIXED }
        };
        // Column by column, so that coupled unknowns have close numbers and the band is narrow.
        for column in 0..=2 * mesh.columns {
            let inside = column > 0 && column < 2 * mesh.columns;
            for row in 0..height {
                displacements.push([next(row > 0 && inside), next(row > 0)]);
                if column % 2 == 0 && row % 2 == 0 {
                    pressures.push(next(true));
                }
            }
        }
        let mut elements = Vec::with_capacity(mesh.columns * mesh.rows);
        let mut band = 0;
        for column in 0..mesh.columns {
            for row in 0..mesh.rows {
                let nodes = mesh.element_nodes(column, row);
                let unknown = |k: usize| match k.checked_sub(DISPLACEMENTS) {
                    None => displacements[nodes[k / 2]][k % 2],
                    Some(corner) => pressures[(column + corner / 2) * (mesh.rows + 1) + row + corner % 2],
                };
                let own: [usize; UNKNOWNS] = std::array::from_fn(unknown);
                let free = own.iter().filter(|unknown| **unknown != FIXED);
                let (low, high) = free.fold((FIXED, 0), |(low, high), k| (low.min(*k), high.max(*k)));
                band = band.max(high - low);
                elements.push((Element::new(&nodes.map(|node| mesh.nodes[node])), own));
            }
        }
        Self { mesh, rubber, elements, displacements, unknowns, band }
    }

    /// Number of unknowns, and how far from the diagonal their matrix reaches.
    pub fn system_size(&self) -> [usize; 2] {
        [self.unknowns, self.band]
    }

    /// Returns the state of an untouched layer.
    pub fn rest_state(&self) -> Vec<f64> {
        vec![0.0; self.unknowns]
    }

    /// Displacement of a node at a state, mm.
    pub fn node_displacement(&self, state: &[f64], node: usize) -> [f64; 2] {
        self.displacements[node].map(|unknown| if unknown == FIXED { 0.0 } else { state[unknown] })
    }

    /// Largest displacement in a change of the state, mm; NaN if there is one.
    pub fn largest_displacement(&self, change: &[f64]) -> f64 {
        let all = self.displacements.iter().flatten().filter(|unknown| **unknown != FIXED);
        all.map(|unknown| change[*unknown].abs()).fold(0.0, |a, b| if b > a || b.is_nan() { b } else { a })
    }

    /// Computes forces within the rubber, and their derivatives, at a state. `None` if it would be turned inside out.
    pub fn assemble_system(&self, state: &[f64]) -> Option<LinearSystem> {
        let mut system =
            LinearSystem { forces: vec![0.0; self.unknowns], matrix: BandMatrix::new(self.unknowns, self.band) };
        for (element, unknowns) in &self.elements {
            let own = unknowns.map(|unknown| if unknown == FIXED { 0.0 } else { state[unknown] });
            let ElementResponse { forces, matrix } = element.compute_response(self.rubber, &own)?;
            for ((row, force), derivatives) in unknowns.iter().zip(forces).zip(&matrix) {
                if *row != FIXED {
                    system.forces[*row] += force;
                    for (column, value) in unknowns.iter().zip(derivatives) {
                        if *column != FIXED {
                            system.matrix.add(*row, *column, *value);
                        }
                    }
                }
            }
        }
        Some(system)
    }

    /// Adds forces on three nodes of the surface, and their derivatives, to a system.
    pub fn add_forces(
        &self,
        system: &mut LinearSystem,
        nodes: [usize; 3],
        forces: [f64; 6],
        derivatives: &[[f64; 6]; 6],
    ) {
        let unknown = |k: usize| self.displacements[nodes[k / 2]][k % 2];
        for row in (0..6).filter(|k| unknown(*k) != FIXED) {
            system.forces[unknown(row)] += forces[row];
            for column in (0..6).filter(|k| unknown(*k) != FIXED) {
                system.matrix.add(unknown(row), unknown(column), derivatives[row][column]);
            }
        }
    }
}
