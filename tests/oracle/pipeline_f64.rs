//! Samples a second time, from the mesh to the grey levels: slow, plain, in f64.
//!
//! [`penetration`] is how far the object reaches below the pad; [`blurred`] and [`pressed`] are the surfaces that the
//! paper's pad and an elastic one take, the latter solved densely, with the layer's response integrated another way
//! ([`lags`]); [`pressure_on_squares`] is the pressure of a level that solves on squares of some pixels; [`normals_of`]
//! and [`light_of`] follow from a surface. The rest says how far a sample is from that.

use std::f64::consts::TAU;
use std::path::Path;

use gelsim_core::base::grid::Grid;
use gelsim_core::base::view::{SURFACE_BORDER, View};
use gelsim_core::gelpad::elastic::layer::ElasticLayer;
use gelsim_job::plan::Plan;
use gelsim_job::scene::Scene;

use super::cut_pixels::{cut, edges};
use super::dense_contact::dense_contact_on_springs;
use super::pressed_pixel::pressed_pixel;
use super::scenery::Scenery;
use super::shading::brightness;
use crate::shapes::Shape;

/// How far the bundled object of a plan's sample reaches below the pad at each pixel of the window around the view, mm:
/// minus infinity where there is none of it.
pub fn penetration(plan: &Plan, name: &str, index: u64, margin: usize) -> Grid<f64> {
    let shape = Shape::bundled(&Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../../objects/{name}.obj")));
    let scenery = Scenery::new(&shape, &Scene::draw(plan, index, 0).pose.placement(), plan.simulator.view(), margin);
    let [width, height] = plan.simulator.view().resolution_px.map(|px| px + 2 * margin);
    let below = |at: usize| (-scenery.lowest_point(at % width, at / width)).min(plan.thickness_mm());
    Grid { width, height, data: (0..width * height).map(below).collect() }
}

/// Displacement at all lags of a window around one pressed pixel, a square of `pitch` mm.
pub fn lags(layer: ElasticLayer, pitch: f64, size: [usize; 2]) -> Grid<f64> {
    // G(q) q less the half-space's over s = q h: gone beyond s = 24.
    let h = layer.thickness_mm;
    let panel = |k: usize| GAUSS.map(|(at, weight)| ((k as f64 + 0.5 + at) * 0.08, weight * 0.08));
    let spectrum: Vec<(f64, f64)> = (0..300)
        .flat_map(panel)
        .map(|(s, weight)| {
            (s, weight * (s * layer.normal_compliance(s / h) / h - layer.half_space_compliance()) / (TAU * h))
        })
        .collect();
    // Under a unit force; averaged over the pixel.
    let force = |r: f64| {
        let rest: f64 = spectrum.iter().map(|(s, value)| value * libm::j0(s * r / h)).sum();
        layer.half_space_compliance() / (TAU * r) + rest
    };
    let far = |x: f64, y: f64| {
        let points = GAUSS.iter().flat_map(|a| GAUSS.iter().map(move |b| (a, b)));
        let mean: f64 = points.map(|((u, p), (v, q))| p * q * force((x + u * pitch).hypot(y + v * pitch))).sum();
        mean * pitch * pitch
    };
    let most = size[0].max(size[1]);
    // Pixels are square: half of a square of lags is all there are.
    let mut known = vec![0.0; most * most];
    for y in 0..most {
        for x in y..most {
            let [u, v] = [x, y].map(|lag| lag as f64 * pitch);
            let value = if x < 4 { pressed_pixel(layer, [pitch; 2], u, v) } else { far(u, v) };
            (known[y * most + x], known[x * most + y]) = (value, value);
        }
    }
    let data = (0..size[0] * size[1]).map(|at| known[at / size[0] * most + at % size[0]]).collect();
    Grid { width: size[0], height: size[1], data }
}

/// Offsets in a unit interval, and weights.
const GAUSS: [(f64, f64); 3] =
    [(-0.387_298_334_620_741_7, 5.0 / 18.0), (0.0, 8.0 / 18.0), (0.387_298_334_620_741_7, 5.0 / 18.0)];

/// The surface that an elastic pad takes, mm, on pixels of `pitch` mm; `lags` is its response.
pub fn pressed(penetration: &Grid<f64>, lags: &Grid<f64>, pitch: f64) -> Grid<f64> {
    let springs = edges(penetration, pitch, lags);
    let (pressure, mut displacement) = dense_contact_on_springs(penetration, &springs, |x, y| lags.at(x, y));
    // On the object, the pad is where the object is.
    let touching = displacement.iter_mut().zip(&pressure).zip(&penetration.data).filter(|((_, p), _)| **p > 0.0);
    touching.for_each(|((w, _), g)| *w = *g);
    Grid { data: displacement, ..*penetration }
}

/// Pressure for Young's modulus 1 on squares of `factor` pixels of the window, pixels of `pitch` mm; `lags` is the
/// response of these squares.
pub fn pressure_on_squares(penetration: &Grid<f64>, factor: usize, lags: &Grid<f64>, pitch: f64) -> Grid<f64> {
    let (coarse, cuts) = cut(penetration, factor, pitch, lags);
    let mut stopped = vec![false; cuts.len()];
    for _ in 0..100 {
        let (mut object, mut springs) = (coarse.clone(), vec![0.0; coarse.data.len()]);
        for (cut, stopped) in cuts.iter().zip(&stopped) {
            match stopped {
                true => object.data[cut.at] -= cut.most,
                false => springs[cut.at] = cut.compliance,
            }
        }
        let (pressure, _) = dense_contact_on_springs(&object, &springs, |x, y| lags.at(x, y));
        let now: Vec<bool> = cuts.iter().map(|cut| pressure[cut.at] * cut.compliance > cut.most).collect();
        if now == stopped {
            return Grid { data: pressure, ..coarse };
        }
        stopped = now;
    }
    panic!("pixels that stop were not found")
}

/// Five means over 15 x 15 px of the depth, and the object where it lies deeper, mm.
pub fn blurred(penetration: &Grid<f64>) -> Grid<f64> {
    let depth: Vec<f64> = penetration.data.iter().map(|mm| mm.max(0.0)).collect();
    let (width, height) = (penetration.width as isize, penetration.height as isize);
    let mean = |from: &[f64], dx: isize, dy: isize| -> Vec<f64> {
        let at = |x: isize, y: isize| {
            let inside = (0..width).contains(&x) && (0..height).contains(&y);
            if inside { from[(y * width + x) as usize] } else { 0.0 }
        };
        let sum = |x: isize, y: isize| (-7..=7).map(|k| at(x + k * dx, y + k * dy)).sum::<f64>() / 15.0;
        (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| sum(x, y)).collect()
    };
    let blur = (0..5).fold(depth.clone(), |from, _| mean(&mean(&from, 1, 0), 0, 1));
    let data = blur.iter().zip(&depth).map(|(blur, depth)| blur.max(*depth)).collect();
    Grid { width: penetration.width, height: penetration.height, data }
}

/// Unit normals of the view from a surface given with [`SURFACE_BORDER`] around it.
pub fn normals_of(surface: &Grid<f64>, camera: &View) -> Vec<[f64; 3]> {
    slopes_of(surface, camera).into_iter().map(unit).collect()
}

fn unit([x, y]: [f64; 2]) -> [f64; 3] {
    let length = (x * x + y * y + 1.0).sqrt();
    [-x / length, -y / length, -1.0 / length]
}

/// How fast the displacement of the view's pixels grows along x and y.
pub fn slopes_of(surface: &Grid<f64>, camera: &View) -> Vec<[f64; 2]> {
    let [width, height] = camera.resolution_px;
    let [dx, dy] = camera.mm_per_px.map(|pitch| 2.0 * pitch);
    let slope = |x: usize, y: usize| {
        let at = |u: usize, v: usize| surface.at(x + u, y + v);
        [(at(2, 1) - at(0, 1)) / dx, (at(1, 2) - at(1, 0)) / dy]
    };
    (0..width * height).map(|at| slope(at % width, at / width)).collect()
}

/// Largest angle between two sets of normals, degrees.
pub fn turned_deg(found: &[[f32; 3]], expected: &[[f64; 3]]) -> f64 {
    let angle = |(a, b): (&[f32; 3], &[f64; 3])| {
        let a = a.map(f64::from);
        let apart: f64 = a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum();
        2.0 * (0.5 * apart.sqrt()).asin().to_degrees()
    };
    found.iter().zip(expected).map(angle).fold(0.0, f64::max)
}

/// Light of a surface without shadows, grey levels, not cut.
pub fn light_of(surface: &Grid<f64>, plan: &Plan) -> Vec<f64> {
    let constants = plan.simulator.models().optics.phong().expect("LEDs");
    let inner = surface_in_view(surface);
    let width = plan.simulator.view().resolution_px[0];
    let pixel = |(at, slope): (usize, [f64; 2])| {
        let rest = std::array::from_fn(|k| f64::from(plan.simulator.background().rgb[3 * at + k]) / 255.0);
        let place = place_in_view(plan.simulator.view(), [at % width, at / width]);
        brightness(place, slope, inner[at], &plan.job().sensor, constants, rest).map(|value| 255.0 * value)
    };
    slopes_of(surface, plan.simulator.view()).into_iter().enumerate().flat_map(pixel).collect()
}

/// Where a pixel's centre lies along the sides of the view, -1 to 1.
pub fn place_in_view(view: &View, pixel: [usize; 2]) -> [f64; 2] {
    std::array::from_fn(|k| 2.0 * (pixel[k] as f64 + 0.5) / view.resolution_px[k] as f64 - 1.0)
}

fn surface_in_view(surface: &Grid<f64>) -> Vec<f64> {
    let (width, height) = (surface.width - 2 * SURFACE_BORDER, surface.height - 2 * SURFACE_BORDER);
    (0..width * height).map(|at| surface.at(at % width + SURFACE_BORDER, at / width + SURFACE_BORDER)).collect()
}

/// 0 of none.
pub fn largest(found: impl Iterator<Item = f64>) -> f64 {
    found.fold(0.0, f64::max)
}

/// Largest difference.
pub fn apart(found: &[f32], expected: &[f64]) -> f64 {
    largest(found.iter().zip(expected).map(|(found, expected)| (f64::from(*found) - expected).abs()))
}

/// By how much quantised values are away from the levels that they stand for, beyond half a level.
pub fn misrounded(rgb: &[u8], levels: &[f64]) -> f64 {
    let off = |(found, level): (&u8, &f64)| (f64::from(*found) - level.clamp(0.0, 255.0)).abs() - 0.5;
    largest(rgb.iter().zip(levels).map(off))
}
