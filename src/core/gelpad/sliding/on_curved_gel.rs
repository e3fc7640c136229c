//! An object that slides over a curved gel.
//!
//! The object's frame lies on the chart of the gel around the contact. When the contact moves to another chart, the
//! frame is transferred so that it keeps its place on the gel, and the friction history goes with it: near the contact,
//! charts differ only by a motion in their plane.

use glam::{DVec2, DVec3};

use super::{ObjectStep, Sliding, Wrench, is_same_pose};
use crate::base::chart::Chart;
use crate::base::gel::Site;
use crate::depth::chart_grid::ChartGrid;
use crate::depth::{CaptureWindow, Depth};
use crate::gelpad::elastic::friction_history::FrameMotion;
use crate::gelpad::elastic::in_plane::Load;
use crate::gelpad::planar::{PlanarFrame, PlanarMotion};
use crate::pose::{PadPlane, rotation_about};

/// An object over a curved gel.
pub struct ObjectOnGel<'a> {
    /// The chart around the contact.
    pub chart: &'a Chart,
    /// The point of the gel where the object is closest.
    pub site: Site,
    /// How far the object reaches below the gel there, mm; 0 or less without contact.
    pub deepest_mm: f64,
    /// Captures the object at points of the chart, given as columns and rows.
    pub capture: &'a dyn Fn(&ChartGrid<'_>, [usize; 2], CaptureWindow) -> Depth,
}

impl Sliding {
    /// Begins a frame of a sequence on a curved gel.
    pub(crate) fn begin_frame_on_gel(&mut self) {
        self.begin_frame();
    }

    /// Moves the frame with a motion in the plane that the object is posed over; `site` is where the object is closest
    /// to the gel afterwards. Returns the motion of the object's surface at the contact, along the frame's axes.
    pub(crate) fn follow_motion(
        &mut self,
        chart: &Chart,
        site: Site,
        plane: &PadPlane,
        motion: PlanarMotion,
    ) -> FrameMotion {
        let here = DVec2::from(chart.locate_site(site));
        let before = match &self.chart_and_site {
            None => {
                // At first contact the frame takes the axes of the plane, turned as the object has turned so far.
                let [x, y] =
                    chart.surface_frame(here.to_array()).tangents.map(|tangent| tangent.dot(plane.axes.x_axis));
                let angle_rad = libm::atan2(y, x) + self.plane_frame.angle_rad;
                self.frame = PlanarFrame { origin_mm: [0.0; 2], angle_rad };
                here
            }
            Some((old, was)) => {
                let there = chart.locate_site(*was);
                if old != chart {
                    self.frame = transfer_frame(&self.frame, (old, old.locate_site(*was)), (chart, there));
                }
                DVec2::from(there)
            }
        };
        self.take_memory_to(chart, site);
        self.plane_frame.move_by(motion);
        self.chart_and_site = Some((chart.clone(), site));

        // Motion of the object half way, projected onto the gel's tangent plane.
        let middle = (0.5 * (before + here)).to_array();
        let rest = chart.surface_frame(middle);
        let in_sensor = |[x, y]: [f64; 2]| plane.axes * DVec3::new(x, y, 0.0);
        let from = rest.point_mm - plane.origin_mm - in_sensor(motion.about_mm);
        let turned = rotation_about(plane.axes.z_axis, motion.turn_rad.to_degrees()) * from;
        let by = turned - from + in_sensor(motion.shift_mm);
        self.frame.move_by(PlanarMotion {
            shift_mm: rest.tangents.map(|tangent| tangent.dot(by)),
            turn_rad: motion.turn_rad * rest.normal.dot(plane.axes.z_axis),
            about_mm: middle,
        })
    }

    /// Moves what the pad remembers to a chart, on which the object is closest at `site`. What lies beyond the chart is
    /// forgotten.
    fn take_memory_to(&mut self, chart: &Chart, site: Site) {
        let Some(memory) = &mut self.memory else { return };
        if let Some((old, was)) = self.memory_chart.take().filter(|(old, _)| old != chart) {
            let there = chart.locate_site(was);
            let frame = transfer_frame(&memory.frame, (&old, old.locate_site(was)), (chart, there));
            match frame.origin_mm.iter().chain([&frame.angle_rad]).all(|number| number.is_finite()) {
                true => memory.frame = frame,
                false => {
                    memory.clear();
                    memory.frame = PlanarFrame::default();
                }
            }
        }
        self.memory_chart = Some((chart.clone(), site));
    }

    /// Finishes a step in which the frame moved by `moved`.
    pub(crate) fn finish_step_on_gel(&mut self, object: &ObjectOnGel<'_>, step: &ObjectStep, moved: FrameMotion) {
        self.begin_step(step);
        let placed = (step.pose, step.depth_mm);
        let stays = self.memory.is_none()
            && self
                .pressed_pose
                .is_some_and(|(pose, depth_mm)| depth_mm == step.depth_mm && is_same_pose(&pose, &step.pose));
        let found = (!stays).then(|| {
            let (centre_px, found) =
                self.solve_in_view(|centre_px| self.solve_pressure_on_gel(object, &self.frame, centre_px));
            self.view_centre_px = centre_px;
            found
        });
        self.apply_pressure(found, placed, moved);
        // Contact was lost: the next one starts with a new frame.
        if self.pressed_pose.is_none() {
            self.chart_and_site = None;
        }
    }

    /// Solves for the pressure of an object in a frame on a chart. Also returns whether the contact touches the
    /// window's border.
    fn solve_pressure_on_gel(
        &self,
        object: &ObjectOnGel<'_>,
        frame: &PlanarFrame,
        middle_px: [i64; 2],
    ) -> (Option<Load>, bool) {
        let ObjectOnGel { chart, deepest_mm, capture, .. } = object;
        if *deepest_mm <= 0.0 {
            return (None, false);
        }
        let middle_mm = [0, 1].map(|k| middle_px[k] as f64 * self.view.mm_per_px[k]);
        let axes = frame.axes();
        self.solve_captured(*deepest_mm, middle_mm, |window| {
            let margin = window.margin_px as f64;
            let place = |node: [usize; 2]| {
                let mm = self.view.point_mm(node.map(|at| at as f64 + 0.5 - margin));
                axes.to_sensor([0, 1].map(|k| mm[k] + middle_mm[k]))
            };
            let size = self.view.resolution_px.map(|px| px + 2 * window.margin_px);
            capture(&ChartGrid { chart, position_mm: &place, spacing_mm: self.view.mm_per_px }, size, window)
        })
    }

    /// Computes the force of an object on the gel, N, if it were pressed in without sliding.
    pub(crate) fn normal_force_on_gel_n(&self, object: &ObjectOnGel<'_>) -> f64 {
        let frame = PlanarFrame::default();
        let (Some(load), _) = self.solve_pressure_on_gel(object, &frame, [0; 2]) else { return 0.0 };
        let area = load.mm_per_px[0] * load.mm_per_px[1];
        let mut force = DVec3::ZERO;
        for y in 0..load.pressure.height {
            for (x, p) in load.pressure.row(y).iter().enumerate().filter(|(_, p)| **p > 0.0) {
                let at = [x, y];
                let place = [0, 1].map(|k| load.origin_mm[k] + at[k] as f64 * load.mm_per_px[k]);
                let chart = object.chart;
                force += area * f64::from(*p) * chart.area_ratio(place) * chart.surface_frame(place).normal;
            }
        }
        1e-3 * self.youngs_modulus_kpa * force.length()
    }

    /// Returns the force of the pressure on the gel after the last step, N.
    pub(crate) fn pressing_force_on_gel_n(&self) -> f64 {
        let Some((chart, _)) = &self.chart_and_site else { return 0.0 };
        let [pressure, _] = self.wrenches_on_gel(chart);
        DVec3::from_array(pressure.force_n).length()
    }

    /// Returns the wrenches of the pressure and of the tractions on the gel, in the sensor's frame about the gel's tip.
    pub(crate) fn wrenches_on_gel(&self, chart: &Chart) -> [Wrench; 2] {
        let newtons = 1e-3 * self.youngs_modulus_kpa;
        let axes = self.frame.axes();
        let add = |sum: &mut [DVec3; 2], place: [f64; 2], force: &dyn Fn([DVec3; 3]) -> DVec3| {
            let at = axes.to_sensor(place);
            let rest = chart.surface_frame(at);
            let [along, down] = rest.tangents;
            let force = newtons * chart.area_ratio(at) * force([along, down, rest.normal]);
            *sum = [sum[0] + force, sum[1] + rest.point_mm.cross(force)];
        };
        let (mut pressure, mut tractions) = ([DVec3::ZERO; 2], [DVec3::ZERO; 2]);
        for (place, normal) in self.history.pressure_forces() {
            add(&mut pressure, place, &|[_, _, out]| -normal * out);
        }
        for (place, force) in self.history.traction_forces() {
            let [x, y] = axes.direction_to_sensor(force);
            add(&mut tractions, place, &|[along, down, _]| x * along + y * down);
        }
        // Adding 0 turns -0.0 into 0.0.
        [pressure, tractions].map(|[force, torque]| Wrench {
            force_n: force.to_array().map(|n| n + 0.0),
            torque_nmm: torque.to_array().map(|n| n + 0.0),
        })
    }
}

/// Transfers a frame around a point of one chart to another chart.
fn transfer_frame(frame: &PlanarFrame, old: (&Chart, [f64; 2]), new: (&Chart, [f64; 2])) -> PlanarFrame {
    let axis = old.0.surface_frame(old.1).tangents[0];
    let [x, y] = new.0.surface_frame(new.1).tangents.map(|tangent| tangent.dot(axis));
    let angle = libm::atan2(y, x);
    let from = DVec2::from(frame.origin_mm) - DVec2::from(old.1);
    let (sin, cos) = libm::sincos(angle);
    let turned = DVec2::new(cos * from.x - sin * from.y, sin * from.x + cos * from.y);
    PlanarFrame { origin_mm: (DVec2::from(new.1) + turned).to_array(), angle_rad: frame.angle_rad + angle }
}
