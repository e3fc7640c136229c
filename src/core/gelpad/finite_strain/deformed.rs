//! From nodes that move with the rubber to places on the deformed surface.
//!
//! The solver knows where each node of the surface goes; images, pressures and the linear layer are functions of the
//! place. The node that is now at a place x is X with X + u(X) = x.

use super::contact::ContactGrid;
use super::height_map::HeightMap;
use super::moved_nodes::MovedNodes;
use super::press::RubberPress;
use super::torus::TorusTaps;
use crate::base::grid::Grid;
use crate::gelpad::elastic::placed::{GridPlacement, PlacedDisplacement};

/// The deformed surface, and how it differs from that of a linear layer under the same pressure.
pub struct DeformedSurface {
    /// Rubber minus linear layer: displacement into the pad, mm, at the captured pixels and [`BEYOND`] on each side.
    pub difference: PlacedDisplacement,
    /// Rubber minus linear layer: motion of the surface's points along x and y, mm, at the contact's nodes.
    pub motion: [PlacedDisplacement; 2],
    /// How far the object, whose edges were rounded for the solver, reaches into rubber at captured pixels beside walls,
    /// mm; 0 elsewhere.
    pub reach_mm: Grid<f32>,
}

/// The object as it was captured.
pub struct CapturedObject<'a> {
    /// How far it reaches below the undeformed pad, mm.
    pub penetration: &'a Grid<f32>,
    /// Where its pixels lie.
    pub placement: GridPlacement,
}

/// Pixels beyond the captured ones that cubic interpolation between those needs.
const BEYOND: usize = 2;

/// Share of the torus's half width over which the difference goes to 0 at its border.
const TAPER: f64 = 0.2;

/// Range of heights within the four nodes along x and y of an interpolation, in distances of nodes, from which on the
/// interpolation is not trusted.
const STEEP: f32 = 0.5;

impl DeformedSurface {
    /// Takes a solution under `object` to places, and subtracts the linear layer under its pressure on the same torus.
    /// `grid_placement` is that of the contact's grid.
    pub fn new(
        grid: &mut ContactGrid,
        press: &RubberPress,
        object: &HeightMap,
        grid_placement: GridPlacement,
        captured: &CapturedObject<'_>,
    ) -> Self {
        let [width, height] = grid.transform.size();
        let nodes = MovedNodes::new(grid, press);
        let mut forces = grid.zeros();
        forces[2] = nodes.forces_at_places(&press.force[2]);
        let mut linear = grid.zeros();
        grid.displace(&forces, &mut linear);
        let linear = linear.map(|data| Grid { width, height, data });
        let at_places: Vec<[f32; 2]> = (0..width * height)
            .map(|at| [(at % width) as f32, (at / width) as f32])
            .map(|place| nodes.find(place, place))
            .collect();
        let surface = at_places.iter().map(|node| nodes.height_mm(*node)).collect();
        let surface = Grid { width, height, data: surface };
        let columns: Vec<f32> = (0..width).map(|x| taper(x as f32, width)).collect();
        let rows: Vec<f32> = (0..height).map(|y| taper(y as f32, height)).collect();
        let difference = |rubber: &Grid<f32>, linear: &Grid<f32>, sign: f32| {
            let mut values_mm = Grid::<f32>::new(width, height);
            for (at, value) in values_mm.data.iter_mut().enumerate() {
                *value = sign * (rubber.data[at] - linear.data[at]) * columns[at % width] * rows[at / width];
            }
            PlacedDisplacement { values_mm, placement: grid_placement }
        };
        let GridPlacement { origin_mm, mm_per_px } = captured.placement;
        let origin_mm = std::array::from_fn(|k| origin_mm[k] - BEYOND as f64 * mm_per_px[k]);
        let mut at_pixels = PlacedDisplacement {
            values_mm: Grid::new(captured.penetration.width + 2 * BEYOND, captured.penetration.height + 2 * BEYOND),
            placement: GridPlacement { origin_mm, mm_per_px },
        };
        difference(&surface, &linear[2], -1.0).add_to(&mut at_pixels.values_mm, at_pixels.placement, [0, 0], 1.0);
        let mut deformed = Self {
            difference: at_pixels,
            motion: [0, 1].map(|c| difference(&nodes.moved[c], &linear[c], 1.0)),
            reach_mm: Grid::new(captured.penetration.width, captured.penetration.height),
        };
        deformed.resolve_walls((&nodes, &at_places), [&surface, &linear[2]], object, (grid_placement, captured));
        deformed
    }

    /// Resolves what is beside walls. There the surface is steeper than the nodes are close: each pixel finds its own
    /// node, and what is between nodes stays out of the object.
    fn resolve_walls(
        &mut self,
        (nodes, at_places): (&MovedNodes, &[[f32; 2]]),
        [surface, linear]: [&Grid<f32>; 2],
        object: &HeightMap,
        (grid_placement, captured): (GridPlacement, &CapturedObject<'_>),
    ) {
        let [dx, dy] = nodes.spacing_mm;
        let steep = find_steep(surface, STEEP * dx.min(dy));
        let size = [captured.penetration.width, captured.penetration.height];
        let places = [0, 1].map(|k| -> Vec<f32> {
            let pixels = 0..size[k] + 2 * BEYOND;
            pixels.map(|px| grid_placement.place_of(self.difference.placement, k, px) as f32).collect()
        });
        let within = |place: f32, count: usize| (0.0..count as f32).contains(&place);
        for (py, y) in places[1].iter().enumerate().filter(|(_, y)| within(**y, surface.height)) {
            for (px, x) in places[0].iter().enumerate().filter(|(_, x)| within(**x, surface.width)) {
                if !steep[*y as usize * surface.width + *x as usize] {
                    continue;
                }
                let place = [*x, *y];
                let beside = [(x + 0.5) as usize % surface.width, (y + 0.5) as usize % surface.height];
                let there = at_places[beside[1] * surface.width + beside[0]];
                let guess = [0, 1].map(|k| there[k] + place[k] - beside[k] as f32);
                let node = nodes.find(place, guess);
                let rubber = nodes.height_mm(node).min(-object.at(place).height_mm);
                let share = taper(*x, surface.width) * taper(*y, surface.height);
                self.difference.values_mm.row_mut(py)[px] =
                    share * (TorusTaps::new(place, nodes.size()).sample(linear) - rubber);
                let [px, py] = [px, py].map(|px| px.wrapping_sub(BEYOND));
                if px < size[0] && py < size[1] {
                    self.reach_mm.row_mut(py)[px] = (captured.penetration.at(px, py) + rubber).max(0.0);
                }
            }
        }
    }

    /// Returns true if every number is finite.
    pub fn is_finite(&self) -> bool {
        let [x, y] = &self.motion;
        [&self.difference, x, y].iter().all(|placed| placed.values_mm.data.iter().all(|value| value.is_finite()))
    }
}

/// Returns how much of the difference is left at a place, nodes from the torus's border.
fn taper(place: f32, count: usize) -> f32 {
    let beside = 1.0 - (2.0 * f64::from(place) / count as f64 - 1.0).abs();
    let t = (beside / TAPER).min(1.0);
    (t * t * (3.0 - 2.0 * t)) as f32
}

/// Marks the cells, named by their first node, around which heights differ by more than `most`.
fn find_steep(surface: &Grid<f32>, most: f32) -> Vec<bool> {
    let Grid { width, height, .. } = *surface;
    let mut steep = Vec::with_capacity(width * height);
    for y in 0..height {
        let lines = [height - 1, 0, 1, 2].map(|step| surface.row((y + step) % height));
        for x in 0..width {
            let columns = [width - 1, 0, 1, 2].map(|step| (x + step) % width);
            let heights = lines.iter().flat_map(|line| columns.map(|x| line[x]));
            let (low, high) =
                heights.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), mm| (low.min(mm), high.max(mm)));
            steep.push(high - low > most);
        }
    }
    steep
}
