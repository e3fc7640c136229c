use rand::RngExt;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::anderson::Anderson;
use super::contact::ContactGrid;
use super::element::{ElementGrid, State};
use super::height_map::{HeightMap, open_by_ball};
use super::layer::{BoxLayer, inverse};
use super::moved_nodes::MovedNodes;
use super::spectrum::HalfSpectrum;
use crate::base::grid::Grid;
use crate::gelpad::elastic::layer::ElasticLayer;

const SIZE: [usize; 2] = [16, 32];
const SPACING_MM: [f64; 2] = [0.4, 0.3];

fn grid() -> ElementGrid {
    ElementGrid { size: SIZE, spacing_mm: SPACING_MM, heights_mm: vec![0.9, 0.7, 0.5, 0.3] }
}

/// A state of numbers up to `size`.
fn random_state(grid: &ElementGrid, size: f32, seed: u64) -> State {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut state = grid.rest();
    let State { displacement: [x, y, z], pressure, .. } = &mut state;
    for part in [x, y, z, pressure] {
        part.iter_mut().for_each(|value| *value = random.random_range(-size..size));
    }
    state
}

fn largest(state: &State) -> f32 {
    let parts = state.displacement.iter().chain([&state.pressure]).flatten();
    parts.fold(0.0, |most, value| most.max(value.abs()))
}

#[test]
fn the_linear_layer_is_what_rubber_is_at_small_strain() {
    // What the rubber's forces lack to the linear layer's is of second order, and so is the displacement that this
    // makes: ten times less displacement leaves a hundred times less.
    for poisson_ratio in [0.0, 0.3, 0.48] {
        let grid = grid();
        let mut layer = BoxLayer::new(grid.clone(), poisson_ratio);
        let none = [0, 1, 2].map(|_| HalfSpectrum::zeros(layer.transform.frequencies()));
        let left = [0.02, 0.002].map(|size| {
            let mut state = random_state(&grid, size, 1);
            // Pressure is in units of the shear modulus; without lambda there is none.
            let most = if poisson_ratio == 0.0 { 0.0 } else { 1.0 };
            state.pressure.iter_mut().for_each(|p| *p *= most);
            let (mut remainder, mut image) = (grid.rest(), grid.rest());
            assert!(grid.remainder(&state, &mut remainder) > 0.5);
            layer.eliminate(&state, &remainder);
            layer.substitute(&none, &mut image);
            largest(&image) / size
        });
        assert!(left[1] < 0.15 * left[0] && left[0] < 0.6, "nu {poisson_ratio}: {left:?}");
    }
}

#[test]
fn forces_are_the_gradient_of_the_energy() {
    // At constant pressures the remainder is minus the gradient of sum (p - 1) ln J V + (1 - p) V J_linear, and of the
    // square of the linear volume change over 2 V, all with p fixed.
    let grid = grid();
    let state = random_state(&grid, 0.05, 2);
    let energy = |state: &State| {
        let mut out = grid.rest();
        grid.remainder(state, &mut out);
        let plane = grid.plane();
        let mut sum = 0.0;
        for (at, p) in state.pressure.iter().enumerate() {
            let (k, i, j) = (at / plane, at % SIZE[0], at % plane / SIZE[0]);
            let (next, below) = ((i + 1) % SIZE[0], (j + 1) % SIZE[1]);
            let moved = |c: usize, x: usize, y: usize, up: usize| match (k + up).checked_sub(1) {
                Some(level) => f64::from(state.displacement[c][level * plane + y * SIZE[0] + x]),
                None => 0.0,
            };
            let [dx, dy] = SPACING_MM;
            let dz = grid.heights_mm[k];
            let mut linear = 0.0;
            for (x, sx) in [(i, -1.0), (next, 1.0)] {
                for (y, sy) in [(j, -1.0), (below, 1.0)] {
                    for (up, sz) in [(0, -1.0), (1, 1.0)] {
                        linear += 0.25
                            * (sx * dy * dz * moved(0, x, y, up)
                                + sy * dx * dz * moved(1, x, y, up)
                                + sz * dx * dy * moved(2, x, y, up));
                    }
                }
            }
            let volume = dx * dy * dz;
            let log = f64::from(out.pressure[at]) + linear;
            let p = f64::from(*p);
            sum += (p - 1.0) * log + (1.0 - p) * linear - 0.5 * linear * linear / volume;
        }
        sum
    };
    let mut remainder = grid.rest();
    grid.remainder(&state, &mut remainder);
    for (c, at) in [(0, 5), (1, 77), (2, 300), (0, 3 * grid.plane() + 31), (2, 3 * grid.plane() + 100)] {
        let step = 5e-3;
        let [below, above] = [-step, step].map(|step| {
            let mut moved = state.clone();
            moved.displacement[c][at] += step;
            energy(&moved)
        });
        let slope = (above - below) / f64::from(2.0 * step);
        let force = f64::from(remainder.displacement[c][at]);
        assert!((slope + force).abs() < 2e-4 + 0.02 * force.abs(), "{c} {at}: {slope} {force}");
    }
}

#[test]
fn a_uniform_stretch_changes_every_volume_alike() {
    let grid = grid();
    let mut state = grid.rest();
    let plane = grid.plane();
    let mut height = 0.0;
    for (k, dz) in grid.heights_mm.iter().enumerate() {
        height += dz;
        state.displacement[2][k * plane..][..plane].fill((-0.2 * height) as f32);
    }
    let mut remainder = grid.rest();
    let smallest = grid.remainder(&state, &mut remainder);
    assert!((smallest - 0.8).abs() < 1e-5, "{smallest}");
    for (at, volume) in remainder.pressure.iter().enumerate() {
        let whole = SPACING_MM[0] * SPACING_MM[1] * grid.heights_mm[at / plane];
        let expected = whole * (0.8_f64.ln() + 0.2);
        assert!((f64::from(*volume) - expected).abs() < 1e-6, "{volume} {expected}");
    }
}

#[test]
fn long_waves_find_the_box_as_compliant_as_the_exact_layer() {
    let pad = ElasticLayer { thickness_mm: 2.4, poisson_ratio: 0.48 };
    let layer = BoxLayer::new(grid(), pad.poisson_ratio);
    for at in [[0, 0], [1, 0], [2, 0], [0, 1]].map(|numbers| layer.transform.place_of(numbers)) {
        let ([tx, ty], _) = layer.transform.angles(at);
        let q = f64::hypot(tx / SPACING_MM[0], ty / SPACING_MM[1]);
        let [dx, dy] = SPACING_MM;
        let scale = 1.0 / (dx * dy * 2.0 * (1.0 + pad.poisson_ratio));
        let (own, exact) = (layer.surface_compliance(at)[2][2], pad.normal_compliance(q) * scale);
        assert!((own / exact - 1.0).abs() < 0.1, "{at}: {own} {exact}");
        let identity = super::layer::times(&inverse(&layer.surface_compliance(at)), &layer.surface_compliance(at));
        assert!((identity[0][0] - 1.0).abs() < 1e-6 && identity[0][2].abs() < 1e-6);
    }
}

#[test]
fn forces_on_the_contact_s_grid_move_the_box_as_far() {
    let pad = ElasticLayer { thickness_mm: 2.4, poisson_ratio: 0.45 };
    let mut layer = BoxLayer::new(grid(), pad.poisson_ratio);
    let mut contact = ContactGrid::new(&layer, pad);
    let [width, height] = contact.transform.size();
    let mut force = contact.zeros();
    for y in 0..height {
        for x in 0..width {
            let r2 = ((x as f64 - 20.0) / 8.0).powi(2) + ((y as f64 - 50.0) / 12.0).powi(2);
            let bell = (-r2).exp() as f32;
            for (force, share) in force.iter_mut().zip([0.01, -0.02, -0.05]) {
                force[y * width + x] = share * bell;
            }
        }
    }
    let mut exact = contact.zeros();
    contact.displace(&force, &mut exact);
    let rest = layer.grid.rest();
    let (mut remainder, mut image) = (layer.grid.rest(), layer.grid.rest());
    layer.grid.remainder(&rest, &mut remainder);
    layer.eliminate(&rest, &remainder);
    layer.substitute(contact.coarsen(&force), &mut image);
    let top = 3 * layer.grid.plane();
    for (own, exact) in image.displacement.iter().zip(&exact) {
        for y in 0..SIZE[1] {
            for x in 0..SIZE[0] {
                let (own, there) = (own[top + y * SIZE[0] + x], exact[3 * y * width + 3 * x]);
                assert!((own - there).abs() < 2e-3 * 0.3, "{x} {y}: {own} {there}");
            }
        }
    }
}

#[test]
fn acceleration_solves_a_linear_iteration_in_as_many_steps_as_it_has_rates() {
    let grid = ElementGrid { size: [16, 16], spacing_mm: [1.0; 2], heights_mm: vec![1.0] };
    let rates = [0.95_f32, -0.6, 0.8, 0.5];
    let mut state = random_state(&grid, 1.0, 3);
    let mut acceleration = Anderson::new(1.0);
    for _ in 0..8 {
        let mut image = state.clone();
        let State { displacement: [x, y, z], pressure, .. } = &mut image;
        for (part, rate) in [x, y, z, pressure].into_iter().zip(rates) {
            part.iter_mut().for_each(|value| *value = 1.0 + rate * (*value - 1.0));
        }
        state = acceleration.next(&state, image);
    }
    let parts = state.displacement.iter().chain([&state.pressure]).flatten();
    assert!(parts.into_iter().all(|value| (value - 1.0).abs() < 1e-3));
}

#[test]
fn opening_keeps_what_is_round_and_rounds_what_is_sharp() {
    let (size, spacing) = (64, [0.1; 2]);
    let at = |x: usize| (x as f64 - 32.0) * 0.1;
    let map = |height: &dyn Fn(f64, f64) -> f64| {
        let mut grid = Grid::new(size, size);
        for y in 0..size {
            for x in 0..size {
                grid.row_mut(y)[x] = height(at(x), at(y)).max(-1.0) as f32;
            }
        }
        grid
    };
    let ball = map(&|x, y| (4.0 - x * x - y * y).max(0.0).sqrt() - 1.5);
    let opened = open_by_ball(&ball, spacing, 0.5);
    for (a, b) in opened.data.iter().zip(&ball.data) {
        assert!(*a <= b + 1e-6 && b - a < 0.02, "{a} {b}");
    }
    let block = map(&|x, _| if x.abs() < 1.05 { 0.4 } else { -1.0 });
    let opened = open_by_ball(&block, spacing, 0.5);
    assert_eq!(opened.at(32, 32), 0.4);
    // A node from the wall, the ball's surface is 0.5 - sqrt(0.5^2 - 0.4^2) below the flat.
    assert!((opened.at(42, 32) - (0.4 - 0.5)).abs() < 0.21 && opened.at(42, 32) < 0.3, "{}", opened.at(42, 32));
    assert_eq!(opened.at(44, 32), -1.0);
    let needle = map(&|x, y| if x.hypot(y) < 0.15 { 0.4 } else { -1.0 });
    assert!(open_by_ball(&needle, spacing, 0.5).data.iter().all(|height| *height < 0.0));
}

#[test]
fn what_the_box_adds_is_interpolated_without_ringing() {
    let grid = grid();
    let pad = ElasticLayer { thickness_mm: 2.4, poisson_ratio: 0.45 };
    let mut contact = ContactGrid::new(&BoxLayer::new(grid, pad.poisson_ratio), pad);
    let size = contact.transform.size();
    let values = |of: &dyn Fn(usize, usize) -> f32| -> Vec<f32> {
        (0..size[0] * size[1]).map(|at| of(at % size[0], at / size[0])).collect()
    };
    let interpolated = |contact: &mut ContactGrid, of: &dyn Fn(usize, usize) -> f32| {
        let by_waves = [0, 1, 2].map(|_| values(of));
        let [_, _, change] = contact.smoothing(&by_waves);
        change.iter().zip(&by_waves[2]).map(|(change, wave)| wave + change).collect::<Vec<f32>>()
    };
    // A long wave stays.
    let wave = |x: usize, y: usize| {
        let angle = |at: usize, count: usize| std::f32::consts::TAU * at as f32 / count as f32;
        (angle(x, size[0]).sin() + angle(y, size[1]).cos()) * 0.1
    };
    for (now, then) in interpolated(&mut contact, &wave).iter().zip(values(&wave)) {
        assert!((now - then).abs() < 5e-4, "{now} {then}");
    }
    // What alternates from node to node vanishes, and nothing is left far from a step.
    let ripple = interpolated(&mut contact, &|x, _| if (x / 3) % 2 == 0 { 0.1 } else { -0.1 });
    assert!(ripple.iter().all(|mm| mm.abs() < 1e-6));
    let step = interpolated(&mut contact, &|_, y| if y < size[1] / 2 { 1.0 } else { 0.0 });
    let far = |y: usize| step[y * size[0]];
    assert!(
        (15..size[1] / 2 - 15).all(|y| (far(y) - 1.0).abs() < 1e-6),
        "{:?}",
        (0..size[1]).map(far).collect::<Vec<_>>()
    );
}

#[test]
fn forces_move_with_their_nodes_and_none_is_lost() {
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let (width, height) = (24, 18);
    let mut field = |most: f32| {
        let data = (0..width * height).map(|_| random.random_range(-most..most)).collect();
        Grid { width, height, data }
    };
    let nodes = MovedNodes { moved: [field(0.9), field(0.9), field(0.1)], spacing_mm: [0.1, 0.2] };
    let mut force = vec![0.0; width * height];
    // Away from the border, where places are those of a torus.
    for y in 6..12 {
        (10..14).for_each(|x| force[y * width + x] = -((x + y) as f32));
    }
    let at_places = nodes.forces_at_places(&force);
    let sum = |values: &[f32], of: &dyn Fn(usize) -> f32| -> f32 {
        values.iter().enumerate().map(|(at, value)| value * of(at)).sum()
    };
    let total = sum(&force, &|_| 1.0);
    assert!((sum(&at_places, &|_| 1.0) / total - 1.0).abs() < 1e-5);
    let moved = |at: usize| (at % width) as f32 + nodes.moved[0].data[at] / 0.1;
    let [then, now] = [sum(&force, &moved), sum(&at_places, &|at| (at % width) as f32)];
    assert!(((now - then) / total).abs() < 1e-3, "{now} {then}");
    // Nodes that stay keep their forces.
    let still = MovedNodes { moved: [0, 1, 2].map(|_| Grid::new(width, height)), spacing_mm: [0.1, 0.2] };
    let smooth: Vec<f32> =
        (0..width * height).map(|at| (std::f32::consts::TAU * (at % width) as f32 / width as f32).sin()).collect();
    for (now, then) in still.forces_at_places(&smooth).iter().zip(&smooth) {
        assert!((now - then).abs() < 1e-3, "{now} {then}");
    }
}

#[test]
fn a_place_is_where_its_node_has_gone() {
    let (width, height) = (40, 30);
    let wave = |at: usize, count: usize| (std::f32::consts::TAU * at as f32 / count as f32).sin();
    let field = |of: &dyn Fn(usize, usize) -> f32| Grid {
        width,
        height,
        data: (0..width * height).map(|at| of(at % width, at / width)).collect(),
    };
    let along_x = field(&|x, y| 0.3 * wave(x, width) * wave(y, height));
    let along_y = field(&|x, _| 0.2 * wave(x, width));
    let nodes = MovedNodes { moved: [along_x, along_y, field(&|_, _| 0.0)], spacing_mm: [0.1, 0.1] };
    for y in 0..height {
        for x in 0..width {
            let at = y * width + x;
            let node = [x as f32, y as f32];
            let place = [0, 1].map(|k| node[k] + nodes.moved[k].data[at] / 0.1);
            let found = nodes.find(place, place);
            assert!((0..2).all(|k| (found[k] - node[k]).abs() < 5e-3), "{found:?} {node:?}");
        }
    }
}

#[test]
fn a_height_map_s_slope_is_the_derivative_of_its_height() {
    let mut random = ChaCha8Rng::seed_from_u64(4);
    let mut heights = Grid::new(12, 9);
    heights.data.iter_mut().for_each(|height| *height = random.random_range(-0.5..0.5_f32));
    let samples = 4.0;
    let map = HeightMap::new(heights, [0.25, 0.5], 4);
    for _ in 0..200 {
        let place: [f32; 2] = [random.random_range(1.0..10.0) / samples, random.random_range(1.0..7.0) / samples];
        let here = map.at(place);
        for k in 0..2 {
            let [below, above] = [-0.01 / samples, 0.01 / samples].map(|step| {
                let mut moved = place;
                moved[k] += step;
                map.at(moved).height_mm
            });
            let slope = (above - below) / (0.02 * [0.25, 0.5][k]);
            assert!((slope - here.slope[k]).abs() < 0.02, "{slope} {:?}", here.slope);
        }
        assert!(here.height_mm <= map.at_most_mm(place) + 1e-6);
    }
    // Far outside it is that of the border, and NaN is no place.
    assert!(map.at([-1e9, 1e9]).height_mm.is_finite());
}
