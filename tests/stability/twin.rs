//! Whole samples against a second pipeline in f64: mesh, depth, contact, normals, light, camera, grey levels.
//!
//! The surface of the elastic pad is solved densely, with the layer's response integrated another way. A rung that
//! solves on squares of two or four pixels has a twin that does so too, whose pressure is compared; its surface is interpolated.

use gelsim_core::simulator::Stages;
use std::f64::consts::TAU;
use std::path::Path;

use gelsim_core::base::grid::Grid;
use gelsim_core::base::view::SURFACE_BORDER;
use gelsim_core::base::view::View;
use gelsim_core::effects::{EffectLog, EffectPolicy};
use gelsim_core::fidelity::Fidelity;
use gelsim_core::gelpad::Contact;
use gelsim_core::gelpad::elastic::layer::ElasticLayer;
use gelsim_core::optics::normals::normals;
use gelsim_files::mesh;
use gelsim_job::plan::Plan;
use gelsim_job::sample::Sample;
use gelsim_job::sample::render;
use gelsim_job::scene::Scene;

use super::press::{Extras, GENERIC, Numbers, Setting, levels};
use crate::oracle::cut_pixels::cut;
use crate::oracle::dense_contact::{dense_contact, dense_contact_on_springs};
use crate::oracle::pressed_pixel::pressed_pixel;
use crate::oracle::shading::brightness;

/// 12 x 9 mm in pixels of 0.25 mm, on a pad that is 2.1 mm thick.
const SETTING: Setting<'_> = Setting {
    object: "sphere",
    rung: Fidelity::Reference,
    extras: Extras::None,
    resolution_px: [48, 36],
    anchor: "bounds",
    more: "sensor.field_of_view_mm = [12.0, 9.0]\noptics.phong.shadows = 'none'\n",
};
const NUMBERS: Numbers = Numbers { depth_mm: 0.6, thickness_mm: 2.1, x_mm: 0.337, y_mm: -0.219, ..GENERIC };
const OBJECTS: [&str; 4] = ["sphere", "cone", "dots", "cube"];

/// How far the object reaches below the pad at each pixel of the window around the view, mm, in f64: minus infinity
/// where there is none of it.
fn overlap(plan: &Plan, name: &str, margin: usize) -> Grid<f64> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("objects/{name}.obj"));
    let mesh = mesh::load(&path, 1.0).unwrap_or_else(|error| panic!("{error}")).mesh;
    let placement = Scene::draw(plan, 0, 0).pose.placement();
    let placed = |vertex: &[f32; 3]| {
        let point: [f64; 3] = std::array::from_fn(|k| f64::from(vertex[k]) + mesh.centre_mm[k]);
        std::array::from_fn(|k| {
            let turned: f64 = placement.rotation[k].iter().zip(point).map(|(r, q)| r * q).sum();
            turned + placement.translation_mm[k]
        })
    };
    let placed: Vec<[f64; 3]> = mesh.vertices.iter().map(placed).collect();
    let [width, height] = plan.simulator.view().resolution_px.map(|px| px + 2 * margin);
    let mut grid = Grid { width, height, data: vec![f64::NEG_INFINITY; width * height] };
    for (at, deepest) in grid.data.iter_mut().enumerate() {
        let point = plan.simulator.view().point_mm([at % width, at / width].map(|px| px as f64 + 0.5 - margin as f64));
        for corners in &mesh.triangles {
            if let Some(z) = height_of(corners.map(|corner| placed[corner as usize]), point) {
                *deepest = deepest.max(-z).min(plan.thickness_mm());
            }
        }
    }
    grid
}

/// Height of a triangle over a point in it or on its edge.
fn height_of(triangle: [[f64; 3]; 3], point: [f64; 2]) -> Option<f64> {
    let [a, b, c] = triangle.map(|corner| [corner[0] - point[0], corner[1] - point[1]]);
    let edge = |p: [f64; 2], q: [f64; 2]| p[0] * q[1] - p[1] * q[0];
    let edges = [edge(b, c), edge(c, a), edge(a, b)];
    let sum: f64 = edges.iter().sum();
    let inside = edges.iter().all(|e| *e >= 0.0) || edges.iter().all(|e| *e <= 0.0);
    (inside && sum != 0.0).then(|| edges.iter().zip(triangle).map(|(e, corner)| e * corner[2]).sum::<f64>() / sum)
}

/// Displacement at all lags of a window around one pressed pixel, a square of `pitch` mm.
fn lags(layer: ElasticLayer, pitch: f64, size: [usize; 2]) -> Grid<f64> {
    // G(q) q less the half-space's over s = q h: gone beyond s = 24.
    let h = layer.thickness_mm;
    let panel = |k: usize| GAUSS.map(|(at, weight)| ((k as f64 + 0.5 + at) * 0.08, weight * 0.08));
    let spectrum: Vec<(f64, f64)> = (0..300)
        .flat_map(panel)
        .map(|(s, weight)| (s, weight * (s * layer.normal(s / h) / h - layer.half_space()) / (TAU * h)))
        .collect();
    // Under a unit force; averaged over the pixel.
    let force = |r: f64| {
        let rest: f64 = spectrum.iter().map(|(s, value)| value * libm::j0(s * r / h)).sum();
        layer.half_space() / (TAU * r) + rest
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

/// Pixels from one solved pixel to the next.
fn factor(rung: Fidelity) -> usize {
    match rung {
        Fidelity::Draft => 4,
        Fidelity::Standard => 2,
        Fidelity::Paper | Fidelity::High | Fidelity::Reference => 1,
    }
}

/// The surface that an elastic pad takes, mm; `lags` is its response.
fn pressed(overlap: &Grid<f64>, lags: &Grid<f64>) -> Grid<f64> {
    let (_, displacement) = dense_contact(overlap, |x, y| lags.at(x, y));
    Grid { data: displacement, ..*overlap }
}

/// Pressure for Young's modulus 1 on squares of `factor` pixels of the window, pixels of `pitch` mm; `lags` is the response of
/// these squares.
fn pressure_on_squares(overlap: &Grid<f64>, factor: usize, lags: &Grid<f64>, pitch: f64) -> Grid<f64> {
    let (mut coarse, mut cuts) = cut(overlap, factor, pitch, lags.at(0, 0));
    let mut springs = vec![0.0; coarse.data.len()];
    cuts.iter().for_each(|cut| springs[cut.at] = cut.compliance);
    loop {
        let (pressure, _) = dense_contact_on_springs(&coarse, &springs, |x, y| lags.at(x, y));
        let count = cuts.len();
        cuts.retain(|cut| {
            let stops = pressure[cut.at] * cut.compliance > cut.most;
            if stops {
                coarse.data[cut.at] -= cut.most;
                springs[cut.at] = 0.0;
            }
            !stops
        });
        if cuts.len() == count {
            return Grid { data: pressure, ..coarse };
        }
    }
}

/// Largest error of the pressure that a sample's rung solved for, as a share of the highest.
fn pressure_error(sample: &Sample, plan: &Plan, expected: &Grid<f64>, factor: usize) -> f64 {
    let load = sample.impression.contact.load.as_ref().expect("a contact");
    let pitch = load.mm_per_px;
    let view = plan.simulator.view();
    // The window and the load have one middle.
    let corner = [0, 1].map(|k| {
        let size = [expected.width, expected.height][k] as f64;
        (load.origin_mm[k] / pitch[k] + 0.5 * (size - 1.0)).round() as usize
    });
    assert_eq!(pitch[0], view.mm_per_px[0] * factor as f64);
    let highest = largest(expected.data.iter().copied());
    let mut worst = 0.0_f64;
    for (at, expected_p) in expected.data.iter().enumerate() {
        let [x, y] = [at % expected.width, at / expected.width];
        let inside = x >= corner[0] && y >= corner[1];
        let inside = inside && x - corner[0] < load.pressure.width && y - corner[1] < load.pressure.height;
        let found = if inside { f64::from(load.pressure.at(x - corner[0], y - corner[1])) } else { 0.0 };
        worst = worst.max((found - expected_p).abs() / highest);
    }
    worst
}

/// Five means over 15 x 15 px of the depth, and the object where it lies deeper, mm.
fn blurred(overlap: &Grid<f64>) -> Grid<f64> {
    let depth: Vec<f64> = overlap.data.iter().map(|mm| mm.max(0.0)).collect();
    let (width, height) = (overlap.width as isize, overlap.height as isize);
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
    Grid { width: overlap.width, height: overlap.height, data }
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
    let pixel = |(at, slope): (usize, [f64; 2])| {
        let rest = std::array::from_fn(|k| f64::from(plan.simulator.background().rgb[3 * at + k]) / 255.0);
        brightness(slope, inner[at], &plan.job().sensor, constants, rest).map(|value| 255.0 * value)
    };
    slopes_of(surface, plan.simulator.view()).into_iter().enumerate().flat_map(pixel).collect()
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

/// The sample's light, grey levels, everywhere.
pub fn light(plan: &Plan, sample: &Sample) -> Vec<f32> {
    let (contact, mut everywhere) = (at_centres(sample), EffectLog::new(EffectPolicy::All));
    levels(plan, &plan.simulator.shader().shade(&contact, plan.simulator.background(), &mut everywhere).whole())
}

/// The pad of a sample without what was sampled between its pixels' centres.
fn at_centres(sample: &Sample) -> Contact {
    let mut contact = sample.impression.contact.clone();
    contact.subpixel = None;
    contact
}

/// The image of that.
pub fn image(plan: &Plan, sample: &Sample) -> Vec<u8> {
    let (contact, mut effects) = (at_centres(sample), EffectLog::new(EffectPolicy::All));
    let light = plan.simulator.shader().shade(&contact, plan.simulator.background(), &mut effects);
    let camera = sample.impression.camera;
    plan.simulator.camera().expose(light, Some(&contact.mask), None, &camera, &mut effects).rgb
}

/// By how much quantised values are away from the levels that they stand for, beyond half a level.
pub fn misrounded(rgb: &[u8], levels: &[f64]) -> f64 {
    let off = |(found, level): (&u8, &f64)| (f64::from(*found) - level.clamp(0.0, 255.0)).abs() - 0.5;
    largest(rgb.iter().zip(levels).map(off))
}

#[test]
fn every_rung_gives_the_surface_and_the_image_of_the_f64_pipeline() {
    let plan_of = |object, rung| Setting { object, rung, ..SETTING }.plan(&NUMBERS).with_policy(EffectPolicy::All);
    let plan = plan_of(OBJECTS[0], Fidelity::Reference);
    let margin = |plan: &Plan| plan.simulator.pad().window(NUMBERS.depth_mm).margin_px;
    // Of the elastic pad; the response on each of its grids.
    let window = plan.simulator.view().resolution_px.map(|px| px + 2 * margin(&plan));
    let layer = ElasticLayer::new(&plan.simulator.sensor().gelpad);
    let lags = [1, 2, 4].map(|factor| {
        let pitch = plan.simulator.view().mm_per_px[0] * factor as f64;
        lags(layer, pitch, window.map(|size| size.div_ceil(factor)))
    });
    for object in OBJECTS {
        // The blur reaches further than any margin here.
        let plan = plan_of(object, Fidelity::Paper);
        let widest = margin(&plan);
        let overlap = overlap(&plan, object, widest);
        for rung in Fidelity::ALL {
            let plan = plan_of(object, rung);
            let sample = render(&plan, 0);
            let (margin, factor) = (margin(&plan), factor(rung));
            let known = overlap.inner(widest - margin);
            if factor > 1 {
                let [pitch, _] = plan.simulator.view().mm_per_px;
                let expected = pressure_on_squares(&known, factor, &lags[factor.ilog2() as usize], pitch);
                let off = pressure_error(&sample, &plan, &expected, factor);
                println!("{object}, {rung:?}: pressure {off:.5} of the highest");
                assert!(off < 0.01, "{object}, {rung:?}: {off}");
                continue;
            }
            let window = match rung {
                Fidelity::Paper => blurred(&known),
                _ => pressed(&known, &lags[0]),
            };
            let surface_um = surface_error_um(&sample, &window, margin);
            let (most_um, most_deg, most_levels) = match rung {
                Fidelity::Paper => (0.05, 0.005, 0.02),
                Fidelity::High => (1.0, 0.1, 0.4),
                _ => (0.05, 0.005, 0.02),
            };
            assert!(surface_um < most_um, "{object}, {rung:?}: {surface_um} um");
            let expected = window.inner(margin - SURFACE_BORDER);
            let turned = turned_deg(
                &normals(&sample.impression.contact, plan.simulator.view()),
                &normals_of(&expected, plan.simulator.view()),
            );
            let expected = light_of(&expected, &plan);
            let off = apart(&light(&plan, &sample), &expected);
            let misrounded = misrounded(&image(&plan, &sample), &expected);
            println!(
                "{object}, {rung:?}: surface {surface_um:.4} um, normals {turned:.4} degrees, light {off:.4} levels, \
                 image {misrounded:.4} beyond half a level"
            );
            assert!(turned < most_deg && off < most_levels, "{object}, {rung:?}: {turned} degrees, {off} levels");
            assert!(misrounded < most_levels, "{object}, {rung:?}: {misrounded} levels");
        }
    }
}

/// Largest error of a sample's surface, um.
fn surface_error_um(sample: &Sample, window: &Grid<f64>, margin: usize) -> f64 {
    let (surface, corner) = (&sample.impression.contact.surface, margin - SURFACE_BORDER);
    let mut worst = 0.0_f64;
    for (at, w) in surface.data.iter().enumerate() {
        let [u, v] = [at % surface.width + corner, at / surface.width + corner];
        worst = worst.max(1e3 * (f64::from(*w) - window.at(u, v)).abs());
    }
    worst
}
