//! An object that slides over a gel that is not flat.
//!
//! Its frame lies on the chart of the gel that is around the contact. When the contact comes to another chart, the frame goes there
//! so that it stays where it is on the gel, and what friction remembers goes along: next to the contact, charts differ by a
//! motion in their plane.

use glam::{DVec2, DVec3};

use super::{ObjectStep, Sliding, Wrench, same};
use crate::base::chart::Chart;
use crate::base::gel::Site;
use crate::depth::places::Places;
use crate::depth::{Depth, Window};
use crate::gelpad::elastic::history::Moved;
use crate::gelpad::elastic::inplane::Load;
use crate::gelpad::planar::{PlanarFrame, PlanarMotion};
use crate::pose::{PadPlane, about};

/// An object over a gel.
pub struct OverGel<'a> {
    /// The chart around the contact.
    pub chart: &'a Chart,
    /// Where on the gel the object is closest.
    pub site: Site,
    /// How far it reaches below the gel there, mm; 0 or less without contact.
    pub deepest_mm: f64,
    /// How far it does at places of the chart, so many columns and rows of them.
    pub capture: &'a dyn Fn(&Places<'_>, [usize; 2], Window) -> Depth,
}

impl Sliding {
    /// Begins a frame over a gel.
    pub(crate) fn begin_over_gel(&mut self) {
        self.begin();
    }

    /// Goes along with a motion in the plane that the object is posed over, after which it is closest at `site` of the gel; the
    /// motion of its surface there, as the frame sees it.
    pub(crate) fn come_over(&mut self, chart: &Chart, site: Site, plane: &PadPlane, motion: PlanarMotion) -> Moved {
        let here = DVec2::from(chart.at(site));
        let before = match &self.over {
            None => {
                // Its axes are those of the plane, turned as the object was.
                let [x, y] = chart.rest(here.to_array()).tangents.map(|tangent| tangent.dot(plane.axes.x_axis));
                let angle_rad = libm::atan2(y, x) + self.way.angle_rad;
                self.frame = PlanarFrame { origin_mm: [0.0; 2], angle_rad };
                here
            }
            Some((old, was)) => {
                let there = chart.at(*was);
                if old != chart {
                    self.frame = moved_to(&self.frame, (old, old.at(*was)), (chart, there));
                }
                DVec2::from(there)
            }
        };
        self.way.moved(motion);
        self.over = Some((chart.clone(), site));

        // The object's motion in the middle of the way, without what goes into the gel or out of it.
        let middle = (0.5 * (before + here)).to_array();
        let rest = chart.rest(middle);
        let in_sensor = |[x, y]: [f64; 2]| plane.axes * DVec3::new(x, y, 0.0);
        let from = rest.point_mm - plane.origin_mm - in_sensor(motion.about_mm);
        let turned = about(plane.axes.z_axis, motion.turn_rad.to_degrees()) * from;
        let by = turned - from + in_sensor(motion.shift_mm);
        self.frame.moved(PlanarMotion {
            shift_mm: rest.tangents.map(|tangent| tangent.dot(by)),
            turn_rad: motion.turn_rad * rest.normal.dot(plane.axes.z_axis),
            about_mm: middle,
        })
    }

    /// Comes to the end of a step of which the frame saw this motion.
    pub(crate) fn press_over(&mut self, object: &OverGel<'_>, step: &ObjectStep, moved: Moved) {
        let placed = (step.pose, step.depth_mm);
        let stays = self.pressed.is_some_and(|(pose, depth_mm)| depth_mm == step.depth_mm && same(&pose, &step.pose));
        if !stays {
            self.middle_px = self.middle();
        }
        let found = (!stays).then(|| self.found_over(object, &self.frame, self.middle_px));
        self.take(found, placed, moved);
        if self.pressed.is_none() {
            self.over = None;
        }
    }

    /// The pressure of an object in a frame on a chart; and whether it touches the window's border.
    fn found_over(&self, object: &OverGel<'_>, frame: &PlanarFrame, middle_px: [i64; 2]) -> (Option<Load>, bool) {
        let OverGel { chart, deepest_mm, capture, .. } = object;
        if *deepest_mm <= 0.0 {
            return (None, false);
        }
        let middle_mm = [0, 1].map(|k| middle_px[k] as f64 * self.view.mm_per_px[k]);
        let axes = frame.axes();
        self.solved(*deepest_mm, middle_mm, |window| {
            let margin = window.margin_px as f64;
            let place = |node: [usize; 2]| {
                let mm = self.view.point_mm(node.map(|at| at as f64 + 0.5 - margin));
                axes.to_sensor([0, 1].map(|k| mm[k] + middle_mm[k]))
            };
            let size = self.view.resolution_px.map(|px| px + 2 * window.margin_px);
            capture(&Places { chart, place: &place, pitch_mm: self.view.mm_per_px }, size, window)
        })
    }

    /// Force of an object on the gel if it were pressed in without sliding, N.
    pub(crate) fn force_over_n(&self, object: &OverGel<'_>) -> f64 {
        let frame = PlanarFrame::default();
        let (Some(load), _) = self.found_over(object, &frame, [0; 2]) else { return 0.0 };
        let area = load.mm_per_px[0] * load.mm_per_px[1];
        let mut force = DVec3::ZERO;
        for y in 0..load.pressure.height {
            for (x, p) in load.pressure.row(y).iter().enumerate().filter(|(_, p)| **p > 0.0) {
                let at = [x, y];
                let place = [0, 1].map(|k| load.origin_mm[k] + at[k] as f64 * load.mm_per_px[k]);
                let chart = object.chart;
                force += area * f64::from(*p) * chart.area(place) * chart.rest(place).normal;
            }
        }
        1e-3 * self.youngs_modulus_kpa * force.length()
    }

    /// What the object does to the gel: by its pressure, and by its tractions; in the sensor's frame, about the gel's tip.
    pub(crate) fn wrenches_over(&self, chart: &Chart) -> [Wrench; 2] {
        let newtons = 1e-3 * self.youngs_modulus_kpa;
        let axes = self.frame.axes();
        let add = |sum: &mut [DVec3; 2], place: [f64; 2], force: &dyn Fn([DVec3; 3]) -> DVec3| {
            let at = axes.to_sensor(place);
            let rest = chart.rest(at);
            let [along, down] = rest.tangents;
            let force = newtons * chart.area(at) * force([along, down, rest.normal]);
            *sum = [sum[0] + force, sum[1] + rest.point_mm.cross(force)];
        };
        let (mut pressure, mut tractions) = ([DVec3::ZERO; 2], [DVec3::ZERO; 2]);
        for (place, normal) in self.history.presses() {
            add(&mut pressure, place, &|[_, _, out]| -normal * out);
        }
        for (place, force) in self.history.forces() {
            let [x, y] = axes.turned(force);
            add(&mut tractions, place, &|[along, down, _]| x * along + y * down);
        }
        // Adding 0 turns -0.0 into 0.0.
        [pressure, tractions].map(|[force, torque]| Wrench {
            force_n: force.to_array().map(|n| n + 0.0),
            torque_nmm: torque.to_array().map(|n| n + 0.0),
        })
    }
}

/// A frame that lies around a point of one chart, on another chart.
fn moved_to(frame: &PlanarFrame, old: (&Chart, [f64; 2]), new: (&Chart, [f64; 2])) -> PlanarFrame {
    let axis = old.0.rest(old.1).tangents[0];
    let [x, y] = new.0.rest(new.1).tangents.map(|tangent| tangent.dot(axis));
    let angle = libm::atan2(y, x);
    let from = DVec2::from(frame.origin_mm) - DVec2::from(old.1);
    let (sin, cos) = libm::sincos(angle);
    let turned = DVec2::new(cos * from.x - sin * from.y, sin * from.x + cos * from.y);
    PlanarFrame { origin_mm: (DVec2::from(new.1) + turned).to_array(), angle_rad: frame.angle_rad + angle }
}
