//! Draws and places the objects of a press: each is turned, scaled and pressed in as drawn, and objects beside the
//! first one are placed so that no two overlap.
//!
//! Objects do not overlap if their outlines in the plane lie apart ([`gelsim_core::depth::outline`]). Only the place is
//! drawn again, from the same ranges, until the outline lies apart from all others. Turn, size and depth stay, so that
//! objects, angles and sizes that are hard to place do not become rarer, as long as a place is found at all.

use std::sync::Arc;

use glam::{DMat3, DVec3};

use crate::config::scene::PressedPart;
use crate::layout::Split;
use crate::plan::Plan;
use gelsim_core::base::rng::{self, RandomStream};
use gelsim_core::depth::outline::Outline;
use gelsim_core::mesh::clusters::Clusters;
use gelsim_core::mesh::surface::{Surface, SurfacePoint};
use gelsim_core::pose::{Anchor, Angles, PadPlane, Pose};
use gelsim_files::sensor::quantity::Quantity;

/// Distance between the pad and an object that does not touch it, mm.
pub const NO_CONTACT_GAP_MM: f64 = 0.1;

/// Most places that are drawn for an object before it is left out.
pub const MAX_PLACES: u32 = 100;

/// Most points of a surface that are tried.
const MAX_POINTS: u32 = 1000;

/// Distance over which a pad reaches beyond the lowest point of an object whose depth is not known yet, mm.
const LEAST_REACH_MM: f64 = 0.05;

/// The least distance between objects, mm: more than rounding moves them.
const MIN_GAP_MM: f64 = 1e-3;

/// An object that is pressed in beside the first one of a press.
#[derive(Clone, Debug)]
pub struct OtherObject {
    /// Index of the object in the plan's sampling.
    pub number: usize,
    /// Factor on its size.
    pub scale: f64,
    /// The scaled object.
    pub clusters: Arc<Clusters>,
    /// Its pose in the sensor's frame.
    pub pose: Pose,
    /// Its outline in the plane over which it is posed.
    pub outline: Outline,
    /// Depth of its lowest point below the undeformed pad, mm; 0 without contact.
    pub indentation_depth_mm: f64,
}

/// An object as it is drawn, without its place.
pub struct TurnedObject {
    /// The rotation that turns what is pressed of it towards the pad.
    pub facing: DMat3,
    /// The point that is placed, mm from the object's centre, if it is one of the surface.
    point_mm: Option<DVec3>,
    /// Factor on its size.
    pub scale: f64,
    /// The scaled object.
    pub clusters: Arc<Clusters>,
    /// Indentation depth that is drawn, mm.
    pub depth_mm: f64,
    turned: Pose,
    lowest_mm: f64,
}

impl TurnedObject {
    /// Draws the side, angles, size and depth of object `number`. `stream` returns the random stream of a name.
    pub fn draw(plan: &Plan, number: usize, touches: bool, stream: impl Fn(&str) -> RandomStream) -> Self {
        let draw = |name: &str, quantity: &Quantity| quantity.sample(&mut stream(name));
        let pose = &plan.job().pose;
        let angles = Angles {
            yaw_deg: draw("yaw", &pose.yaw_deg),
            tilt_deg: draw("tilt", &pose.tilt_deg),
            tilt_azimuth_deg: draw("tilt azimuth", &pose.tilt_azimuth_deg),
        };
        let depth_mm = plan.job().indentation.depth_mm.as_ref().map_or(0.0, |depth_mm| draw("indentation", depth_mm));
        let lowest_mm = if touches { -depth_mm } else { NO_CONTACT_GAP_MM };
        let scale = draw("object scale", &plan.sampling.objects[number].scale);
        let original = plan.sampling.objects[number].geometry.clusters();
        let clusters = if scale == 1.0 { original } else { Arc::new(original.scaled(scale)) };
        let side = || pose.face.pick_side(plan.sampling.objects[number].richest_side, &mut stream("face")).rotation();
        let point = match pose.at {
            PressedPart::Side => None,
            PressedPart::Surface => draw_reachable_point(&clusters, depth_mm, &mut stream("surface")),
        };
        let facing = point.map_or_else(side, |point| point.facing());
        let turned = match (&pose.roll_deg, &pose.pitch_deg) {
            (None, None) => Pose::turned_from(facing, angles),
            (roll, pitch) => {
                let [roll_deg, pitch_deg] = [("roll", roll), ("pitch", pitch)]
                    .map(|(name, angle)| angle.as_ref().map_or(0.0, |angle| draw(name, angle)));
                Pose::rolled(facing, angles.yaw_deg, roll_deg, pitch_deg)
            }
        };
        Self { facing, point_mm: point.map(|point| point.point_mm), scale, clusters, depth_mm, turned, lowest_mm }
    }

    /// Returns the pose of the object with its anchor at a place.
    pub fn pose_at(&self, position_mm: [f64; 2], anchor: Anchor) -> Pose {
        match self.point_mm {
            Some(point_mm) => self.turned.moved_to_point(point_mm, position_mm, self.lowest_mm, &self.clusters),
            None => self.turned.moved(position_mm, anchor, self.lowest_mm, &self.clusters),
        }
    }
}

/// Draws a point of an object's surface that a flat pad touches if the object is pressed in along the point's normal by
/// `depth_mm`, each as likely as any other. If there is hardly any, it is the one of those tried that is nearest to it.
fn draw_reachable_point(object: &Clusters, depth_mm: f64, stream: &mut RandomStream) -> Option<SurfacePoint> {
    let surface = Surface::of(object);
    let mut nearest: Option<(f64, SurfacePoint)> = None;
    for _ in 0..MAX_POINTS {
        let point = surface.draw(stream)?;
        // How far the lowest point of the turned object is below this one.
        let gap_mm = object.extreme(point.normal.to_array()) - point.point_mm.dot(point.normal);
        if gap_mm < depth_mm.max(LEAST_REACH_MM) {
            return Some(point);
        }
        if nearest.is_none_or(|(least, _)| gap_mm < least) {
            nearest = Some((gap_mm, point));
        }
    }
    nearest.map(|(_, point)| point)
}

/// Draws and places the objects that are pressed in beside the first one of a press. Also returns how many objects
/// found no place. `index` selects the press's random streams; their names end in the object's number, counted from 0.
pub fn place_other_objects(
    plan: &Plan,
    split: Split,
    index: u64,
    touches: bool,
    first: (&Clusters, &Pose),
    plane: &PadPlane,
) -> (Vec<OtherObject>, u32) {
    let counts = plan.job().objects_per_sample();
    let wanted = counts.sample(&mut rng::random_stream(plan.seed(), "objects", index));
    if wanted < 2 {
        return (Vec::new(), 0);
    }
    let mut outlines = vec![Outline::of(first.0, first.1)];
    let mut others = Vec::new();
    for k in 1..wanted {
        let stream = |name: &str| rng::random_stream(plan.seed(), &format!("{name} {k}"), index);
        let number = plan.sampling.object_samplers[split.number()].pick_other_object(&mut stream("object"));
        let turned = TurnedObject::draw(plan, number, touches, stream);
        let job = &plan.job().pose;
        // The outline at the origin is moved to each place, since it does not depend on the place.
        let somewhere = turned.pose_at([0.0; 2], job.anchor);
        let outline = Outline::of(&turned.clusters, &somewhere);
        let place = |place: u32| {
            let draw = |axis: &str, quantity: &Quantity| quantity.sample(&mut stream(&format!("{axis} {place} of")));
            [draw("x", &job.x_mm), draw("y", &job.y_mm)]
        };
        let is_free = |outline: &Outline| outlines.iter().all(|other| outline.gap_mm(other) >= MIN_GAP_MM);
        let found = (0..MAX_PLACES).map(place).find(|at| is_free(&outline.moved(*at)));
        let Some(position_mm) = found else { continue };
        let over_plane = turned.pose_at(position_mm, job.anchor);
        let outline = outline.moved(position_mm);
        outlines.push(outline.clone());
        let TurnedObject { scale, clusters, depth_mm, .. } = turned;
        others.push(OtherObject {
            number,
            scale,
            clusters,
            pose: plane.pose_in_sensor(over_plane),
            outline,
            indentation_depth_mm: if touches { depth_mm } else { 0.0 },
        });
    }
    let unplaced = wanted - 1 - others.len() as u32;
    (others, unplaced)
}
