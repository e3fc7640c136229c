//! Error of the linear elastic layer for a job's presses, against finite elements at large strains.
//!
//! A body of revolution is pressed along its axis into a bonded layer of nearly incompressible neo-Hookean rubber,
//! without friction or sticking (`press.rs`). The same body is pressed into the layer of the fidelity level `reference`
//! (`linear.rs`), and the surfaces are compared in the ring outside the contact. This is slow, and never part of
//! generating a dataset.

use serde::Serialize;

use crate::metrics::distance::squared_distance_mm2;
use crate::metrics::surface::{RING_MM, compare_surfaces};
use crate::tradeoff::strata::{DrawnSample, draw_samples, find_deepest_of_each};
use gelsim_core::base::clock::ThreadClock;
use gelsim_core::base::grid::Grid;
use gelsim_core::depth::indenter::Shape;
use gelsim_core::depth::rest_surface::RestSurface;
use gelsim_core::sensor::Sensor;
use gelsim_job::plan::Plan;
use gelsim_job::scene::Scene;

mod band;
mod body;
mod contact;
mod element;
mod layer;
mod linear;
mod mesh;
mod press;
mod profile;
pub mod report;
#[cfg(test)]
mod tests;

use body::Body;
use element::ElasticConstants;
use layer::BondedLayer;
use mesh::{Extent, Mesh};
use press::PressSolver;

/// Strain up to which a press that stopped early is not compared.
const MIN_STRAIN: f64 = 0.02;

/// Options of the comparison.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct FiniteElementOptions {
    /// Whether the pad sticks to the object; else there is no friction.
    pub sticking: bool,
    /// Radius to which sharper edges of the object are rounded, mm: at a sharp edge the pressure is infinite.
    pub rounding_mm: f64,
    /// Factor on the fineness: 2 halves the size of the elements.
    pub refine: f64,
}

/// Presses that were compared, and objects that could not be.
#[derive(Clone, Debug, Serialize)]
pub struct Comparison {
    /// Name of the job.
    pub job: String,
    /// Options that were used.
    #[serde(flatten)]
    pub options: FiniteElementOptions,
    /// One press per object.
    pub presses: Vec<PressComparison>,
    /// Objects that were not compared.
    pub left_out: Vec<SkippedObject>,
}

/// An object that was not compared.
#[derive(Clone, Debug, Serialize)]
pub struct SkippedObject {
    /// Name of the object.
    pub object: String,
    /// Largest distance from a body of revolution below the undeformed pad, mm; none if it was not measured.
    pub asymmetry_mm: Option<f64>,
    /// Why it was not compared.
    pub reason: String,
}

/// One press, by finite elements and by the linear layer.
#[derive(Clone, Debug, Serialize)]
pub struct PressComparison {
    /// Name of the object.
    pub object: String,
    /// Number of the sample that gives the depth.
    pub sample: u64,
    /// Tilt of that sample, degrees; the press has none.
    pub tilt_deg: f64,
    /// Largest distance of the object from its mean section below the undeformed pad, mm.
    pub asymmetry_mm: f64,
    /// The sample's depth, mm.
    pub depth_mm: f64,
    /// Depth up to which the finite elements converged, mm. Surfaces are compared at it.
    pub reached_mm: f64,
    /// `reached_mm` over the pad's thickness.
    pub strain: f64,
    /// Outer radius of the contact of the finite elements, mm.
    pub contact_mm: f64,
    /// Largest difference of the surfaces within 2 mm outside both contacts, um.
    pub ring_max_um: f64,
    /// Root mean square of these differences, um.
    pub ring_rms_um: f64,
    /// Mean angle between the normals in that ring, degrees.
    pub ring_normal_mean_deg: f64,
    /// 95th percentile of these angles, degrees.
    pub ring_normal_p95_deg: f64,
    /// Error that a label states, um; none if it states none.
    pub stated_um: Option<f64>,
    /// Force of the finite elements, N.
    pub force_n: f64,
    /// Force of the linear layer, N.
    pub linear_force_n: f64,
    /// `force_n` over `linear_force_n`.
    pub force_ratio: f64,
    /// Unknowns of the finite elements.
    pub unknowns: usize,
    /// Number of systems of equations that were solved.
    pub solves: usize,
    /// Time taken, s.
    pub seconds: f64,
}

/// The press of an object that is compared.
struct ChosenPress {
    object: String,
    sample: u64,
    tilt_deg: f64,
    depth_mm: f64,
    sensor: Sensor,
    body: Body,
}

/// Compares the deepest press of each object of a job. Calls `progress` with the object that is pressed, and the share
/// of all work that is done.
pub fn compare_with_finite_elements(
    plan: &Plan,
    options: FiniteElementOptions,
    progress: impl Fn(&str, f64),
) -> Comparison {
    let mut found = Comparison { job: plan.name().to_owned(), options, presses: Vec::new(), left_out: Vec::new() };
    let mut deepest: Vec<Option<Scene>> = vec![None; plan.sampling.objects.len()];
    let all = draw_samples(plan);
    for DrawnSample { index, object, depth_mm } in find_deepest_of_each(&all).into_iter().map(|at| all[at]) {
        deepest[object] = (depth_mm > 0.0).then(|| Scene::draw(plan.for_sample(index, 0), index, 0));
    }
    for (number, (object, scene)) in plan.sampling.objects.iter().zip(deepest).enumerate() {
        let begun = number as f64 / plan.sampling.objects.len() as f64;
        let per_object = 1.0 / plan.sampling.objects.len() as f64;
        progress(&object.id, begun);
        let left_out = |asymmetry_mm, reason: String| SkippedObject { object: object.id.clone(), asymmetry_mm, reason };
        let Some(scene) = scene else {
            let reason = String::from("no sample presses it");
            found.left_out.push(left_out(None, reason));
            continue;
        };
        match choose_press(plan, &object.id, &scene) {
            Ok(chosen) => {
                let asymmetry_mm = chosen.body.asymmetry_mm;
                match compare_press(&chosen, options, |share| progress(&object.id, begun + share * per_object)) {
                    Ok(compared) => found.presses.push(compared),
                    Err(reason) => found.left_out.push(left_out(Some(asymmetry_mm), reason)),
                }
            }
            Err(refused) => found.left_out.push(refused),
        }
    }
    found
}

/// Takes a scene's press without tilt and texture. Fails if axisymmetric finite elements cannot compute it.
fn choose_press(plan: &Plan, object: &str, scene: &Scene) -> Result<ChosenPress, SkippedObject> {
    let plan = plan.for_sample(scene.index, 0);
    let sensor = scene.simulator(plan).sensor().clone();
    let left_out = |asymmetry_mm, reason: String| SkippedObject { object: object.to_owned(), asymmetry_mm, reason };
    if matches!(sensor.rest_surface, Some(RestSurface::HeightMap { .. })) {
        return Err(left_out(None, String::from("the pad is neither flat nor a dome")));
    }
    let indenter = scene.indenter(plan);
    let Shape::Mesh(clusters) = indenter.shape() else {
        return Err(left_out(None, String::from("no mesh of it is known")));
    };
    let (depth_mm, thickness_mm) = (scene.indentation_depth_mm, sensor.gelpad.thickness_mm);
    let body = Body::measure(clusters, &scene.pose, depth_mm, thickness_mm);
    if !body.is_round() {
        let reason =
            format!("not round: {:.3} mm from a body of revolution, {:.3} allowed", body.asymmetry_mm, body.allowed_mm);
        return Err(left_out(Some(body.asymmetry_mm), reason));
    }
    if body.extends_beyond_view(thickness_mm) {
        return Err(left_out(Some(body.asymmetry_mm), String::from("it reaches into the pad too far from its axis")));
    }
    let tilt_deg = scene.pose.angles.tilt_deg;
    Ok(ChosenPress { object: object.to_owned(), sample: scene.index, tilt_deg, depth_mm, sensor, body })
}

/// Computes a press by both methods. An error says why the finite elements did not.
fn compare_press(
    chosen: &ChosenPress,
    options: FiniteElementOptions,
    progress: impl Fn(f64),
) -> Result<PressComparison, String> {
    let ChosenPress { sensor, body, .. } = chosen;
    let mut clock = ThreadClock::start();
    let thickness = sensor.gelpad.thickness_mm;
    let object = body.rounded_profile(options.rounding_mm);
    let widest = object.radius_below(chosen.depth_mm);
    // The mesh needs the contact's radius beforehand, where elements are small: take that of the linear layer.
    let radius_mm = widest + RING_MM + 0.5;
    let full = linear::press_linear(sensor, &object, chosen.depth_mm, radius_mm);
    let contact = outermost_contact(&full.contact.mask, &full);
    let drop = |r: f64| match sensor.rest_surface {
        Some(RestSurface::Dome { radius_mm }) => dome_sag(radius_mm, r),
        _ => 0.0,
    };
    let extent = Extent { thickness, depth: chosen.depth_mm, contact, ring: RING_MM, refine: options.refine };
    let mesh = Mesh::new(&object, extent, drop);
    let layer = BondedLayer::new(mesh, ElasticConstants::new(sensor.gelpad.poisson_ratio));
    let mut press = PressSolver::new(&layer, &object, thickness, options.sticking);
    let mut converged = true;
    for k in 1..=PROGRESS_PARTS {
        converged = converged && press.press_to(chosen.depth_mm * f64::from(k) / f64::from(PROGRESS_PARTS));
        progress(f64::from(k) / f64::from(PROGRESS_PARTS));
    }
    let reached_mm = press.depth();
    if !converged && reached_mm < MIN_STRAIN * thickness {
        return Err(format!(
            "the finite elements stopped converging at {reached_mm:.3} mm; a larger --edge-mm may help"
        ));
    }
    let linear = if converged { full } else { linear::press_linear(sensor, &object, reached_mm, radius_mm) };
    let ring = compare_ring(&press, &linear, drop);
    let force_n = press.axial_force() * sensor.gelpad.youngs_modulus_kpa * 1e-3;
    let linear_force_n = linear.contact.force_n.unwrap_or(0.0);
    Ok(PressComparison {
        object: chosen.object.clone(),
        sample: chosen.sample,
        tilt_deg: chosen.tilt_deg,
        asymmetry_mm: body.asymmetry_mm,
        depth_mm: chosen.depth_mm,
        reached_mm,
        strain: reached_mm / thickness,
        contact_mm: press.contact_states().iter().filter(|(_, touches)| *touches).map(|(r, _)| *r).fold(0.0, f64::max),
        ring_max_um: ring.max_um,
        ring_rms_um: ring.rms_um,
        ring_normal_mean_deg: ring.normal_mean_deg,
        ring_normal_p95_deg: ring.normal_p95_deg,
        stated_um: linear.stated_um,
        force_n,
        linear_force_n,
        force_ratio: force_n / linear_force_n,
        unknowns: layer.system_size()[0],
        solves: press.solve_count(),
        seconds: clock.lap(),
    })
}

/// Number of parts of a press after which progress is reported.
const PROGRESS_PARTS: u32 = 20;

/// How far a domed pad lies below its highest point at a radius, mm. Steep parts are flattened, so that elements do not
/// degenerate.
fn dome_sag(radius: f64, r: f64) -> f64 {
    let r = r.min(0.62 * radius);
    r * r / (radius + libm::sqrt(radius * radius - r * r))
}

/// Outermost radius at which the linear layer touches, mm.
fn outermost_contact(mask: &Grid<u8>, linear: &linear::LinearPress) -> f64 {
    let mut farthest = 0.0_f64;
    for y in 0..mask.height {
        for (x, _) in mask.row(y).iter().enumerate().filter(|(_, touches)| **touches != 0) {
            let at = linear.view.point_mm([x as f64 + 0.5, y as f64 + 0.5]);
            farthest = farthest.max(libm::hypot(at[0], at[1]));
        }
    }
    farthest
}

/// Differences in the ring outside both contacts.
struct RingDifference {
    max_um: f64,
    rms_um: f64,
    normal_mean_deg: f64,
    normal_p95_deg: f64,
}

fn compare_ring(press: &PressSolver<'_>, linear: &linear::LinearPress, drop: impl Fn(f64) -> f64) -> RingDifference {
    // Where the deformed surface folds back, keep its outermost part, so that it is a function of the radius.
    let mut line = press.surface_line();
    let mut farthest = f64::NEG_INFINITY;
    line.retain(|[r, _, _]| {
        let on = *r > farthest;
        farthest = farthest.max(*r);
        on
    });
    let surface = linear::grid_from_radii(&linear.view, linear::BORDER, |r| interpolate_depth(&line, r) - drop(r));
    let touching = press.contact_states();
    let touches = linear::grid_from_radii(&linear.view, 0, |r| {
        let after = touching.partition_point(|(place, _)| *place < r).min(touching.len() - 1);
        let before = after.saturating_sub(1);
        let nearest = if r - touching[before].0 < touching[after].0 - r { before } else { after };
        f64::from(u8::from(touching[nearest].1))
    });
    let mut mask = linear.contact.mask.clone();
    for (mask, touches) in mask.data.iter_mut().zip(&touches.data) {
        *mask = if *touches > 0.0 { 255 } else { *mask };
    }
    let mm_per_px = linear.view.mm_per_px;
    let squares = squared_distance_mm2(&mask, mm_per_px);
    let (mut max_um, mut sum, mut count) = (0.0_f64, 0.0, 0.0);
    for y in 0..mask.height {
        for x in 0..mask.width {
            let square = squares.at(x, y);
            if square > 0.0 && square <= RING_MM * RING_MM {
                let at = |grid: &Grid<f32>| f64::from(grid.at(x + linear::BORDER, y + linear::BORDER));
                let error_um = 1e3 * (at(&surface) - at(&linear.contact.surface)).abs();
                max_um = max_um.max(error_um);
                sum += error_um * error_um;
                count += 1.0;
            }
        }
    }
    let angles = compare_surfaces(&linear.contact.surface, &surface, &mask, mm_per_px).ring;
    RingDifference {
        max_um,
        rms_um: libm::sqrt(sum / f64::max(count, 1.0)),
        normal_mean_deg: angles.map_or(0.0, |angles| angles.mean_deg),
        normal_p95_deg: angles.map_or(0.0, |angles| angles.p95_deg),
    }
}

/// Depth at a radius, interpolated along a line of points, mm.
fn interpolate_depth(line: &[[f64; 3]], r: f64) -> f64 {
    let after = line.partition_point(|point| point[0] <= r).clamp(1, line.len() - 1);
    let ([r0, w0, _], [r1, w1, _]) = (line[after - 1], line[after]);
    w0 + (w1 - w0) * ((r - r0) / (r1 - r0)).min(1.0)
}
