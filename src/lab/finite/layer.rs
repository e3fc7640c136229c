//! The layer: its elements, which of their unknowns are free, and the system of equations at a state.

use super::band::BandMatrix;
use super::element::{DISPLACEMENTS, Element, Response, Rubber, UNKNOWNS};
use super::mesh::Mesh;

/// An unknown that is held at zero.
const HELD: usize = usize::MAX;

/// A bonded layer of rubber.
#[derive(Clone, Debug)]
pub struct Layer {
    /// Its nodes.
    pub mesh: Mesh,
    rubber: Rubber,
    elements: Vec<(Element, [usize; UNKNOWNS])>,
    /// Unknowns of each node's displacement.
    displacements: Vec<[usize; 2]>,
    /// How many there are.
    unknowns: usize,
    band: usize,
}

/// Forces on the free unknowns, and their derivatives.
pub struct System {
    /// What is not in balance.
    pub forces: Vec<f64>,
    /// Derivatives of the forces.
    pub matrix: BandMatrix,
}

impl Layer {
    /// Bonded at its lower side; at the axis and at its outer border it moves up and down only.
    pub fn new(mesh: Mesh, rubber: Rubber) -> Self {
        let height = mesh.column_nodes();
        let (mut displacements, mut pressures) = (Vec::new(), Vec::new());
        let mut unknowns = 0;
        let mut next = |free: bool| {
            unknowns += usize::from(free);
            if free { unknowns - 1 } else { HELD }
        };
        // Column by column, so that what belongs together has numbers that are close.
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
                let nodes = mesh.element(column, row);
                let unknown = |k: usize| match k.checked_sub(DISPLACEMENTS) {
                    None => displacements[nodes[k / 2]][k % 2],
                    Some(corner) => pressures[(column + corner / 2) * (mesh.rows + 1) + row + corner % 2],
                };
                let own: [usize; UNKNOWNS] = std::array::from_fn(unknown);
                let free = own.iter().filter(|unknown| **unknown != HELD);
                let (low, high) = free.fold((HELD, 0), |(low, high), k| (low.min(*k), high.max(*k)));
                band = band.max(high - low);
                elements.push((Element::new(&nodes.map(|node| mesh.nodes[node])), own));
            }
        }
        Self { mesh, rubber, elements, displacements, unknowns, band }
    }

    /// How many unknowns there are, and how far from the diagonal their matrix reaches.
    pub fn size(&self) -> [usize; 2] {
        [self.unknowns, self.band]
    }

    /// The state of an untouched layer.
    pub fn rest(&self) -> Vec<f64> {
        vec![0.0; self.unknowns]
    }

    /// Displacement of a node at a state.
    pub fn displacement(&self, state: &[f64], node: usize) -> [f64; 2] {
        self.displacements[node].map(|unknown| if unknown == HELD { 0.0 } else { state[unknown] })
    }

    /// The largest displacement in a change of the state.
    pub fn largest(&self, change: &[f64]) -> f64 {
        let all = self.displacements.iter().flatten().filter(|unknown| **unknown != HELD);
        all.map(|unknown| change[*unknown].abs()).fold(0.0, |a, b| if b > a || b.is_nan() { b } else { a })
    }

    /// Forces within the rubber and their derivatives at a state. `None` where it would be turned inside out.
    pub fn system(&self, state: &[f64]) -> Option<System> {
        let mut system = System { forces: vec![0.0; self.unknowns], matrix: BandMatrix::new(self.unknowns, self.band) };
        for (element, unknowns) in &self.elements {
            let own = unknowns.map(|unknown| if unknown == HELD { 0.0 } else { state[unknown] });
            let Response { forces, matrix } = element.response(self.rubber, &own)?;
            for ((row, force), derivatives) in unknowns.iter().zip(forces).zip(&matrix) {
                if *row != HELD {
                    system.forces[*row] += force;
                    for (column, value) in unknowns.iter().zip(derivatives) {
                        if *column != HELD {
                            system.matrix.add(*row, *column, *value);
                        }
                    }
                }
            }
        }
        Some(system)
    }

    /// Adds forces on three nodes of the surface, and their derivatives, to a system.
    pub fn add(&self, system: &mut System, nodes: [usize; 3], forces: [f64; 6], derivatives: &[[f64; 6]; 6]) {
        let unknown = |k: usize| self.displacements[nodes[k / 2]][k % 2];
        for row in (0..6).filter(|k| unknown(*k) != HELD) {
            system.forces[unknown(row)] += forces[row];
            for column in (0..6).filter(|k| unknown(*k) != HELD) {
                system.matrix.add(unknown(row), unknown(column), derivatives[row][column]);
            }
        }
    }
}
