//! A sensor whose gel is not flat: the press happens on a chart of the gel, whose middle is near where the object comes
//! closest to it, and a camera inside sees the gel through its lens.

use glam::{DVec2, DVec3};

use crate::core::base::clock::{Clock, Seconds};
use crate::core::base::gel::{Chart, GelShape};
use crate::core::base::grid::Grid;
use crate::core::base::light::Light;
use crate::core::base::rng;
use crate::core::base::view::View;
use crate::core::camera::pins::{Along, PinPositions, Pins, SkinMotion, Tip};
use crate::core::camera::projection::{GelMap, Projection};
use crate::core::depth::Depth;
use crate::core::depth::indenter::{Indenter, Shape};
use crate::core::depth::normals::Normals;
use crate::core::effects::{Effect, EffectLog, Requirement};
use crate::core::gelpad::elastic::inplane::InPlane;
use crate::core::gelpad::elastic::shear::{Friction, Motion};
use crate::core::gelpad::material::Material;
use crate::core::gelpad::sliding::Wrench;
use crate::core::gelpad::tangential::{Shear, tangential};
use crate::core::gelpad::whole::Whole;
use crate::core::gelpad::{self, Contact, Pad};
use crate::core::mesh::nearest::nearest_point;

/// How far from its chart's middle a contact may be, rad: lengths there are off by 0.7 %.
const NEAR: f64 = 0.2;

/// A gel that is not flat and the camera inside it, made ready.
pub struct Curved {
    shape: GelShape,
    /// The nodes of a chart.
    view: View,
    camera: Projection,
    /// What the pixels of the image show of the gel.
    pixels: Vec<Option<DVec3>>,
    nodes: Normals,
    pins: Pins,
    resting: Vec<Tip>,
    /// What the mount's ring covers of the image.
    ring: Grid<f32>,
    dark: [f64; 3],
}

/// What a press on a curved gel gives, before the camera.
pub struct CurvedPress {
    /// How far the object reaches below the gel, on the chart.
    pub depth: Depth,
    /// The gel under it, on the chart.
    pub contact: Contact,
    /// Where the image's pixels lie on the chart.
    pub map: GelMap,
    /// The pins.
    pub pins: PinPositions,
    /// What the object does to the gel, in the sensor's frame about the gel's tip.
    pub wrench: Option<Wrench>,
    /// The light that the camera receives.
    pub light: Light,
    /// Height over the gel up to which the object was captured, mm.
    pub above_mm: f64,
}

/// What of a sensor with a curved gel a press needs.
pub struct PressedGel<'a> {
    /// What is pressed.
    pub indenter: &'a Indenter,
    /// How it then moves.
    pub shear: Option<&'a Shear>,
    /// Key of what differs between units of the sensor.
    pub unit_key: u64,
    /// The pad.
    pub pad: &'a Pad,
    /// Its motion in its own plane.
    pub in_plane: Option<&'a InPlane>,
    /// What holds the gel to the object while it is pressed in.
    pub held: Option<Friction>,
    /// Its material.
    pub material: &'a Material,
}

impl Curved {
    /// Of a sensor with these pins, on a gel whose pad needs a margin of so many nodes.
    pub fn new(shape: GelShape, camera: Projection, view: View, margin_px: usize, pins: Pins, dark: [f64; 3]) -> Self {
        let [width, height] = view.resolution_px;
        let centre = |at: usize| [(at % width) as f64 + 0.5, (at / width) as f64 + 0.5];
        let pixels = (0..width * height).map(|at| camera.normal(&shape, centre(at))).collect();
        let resting = pins.at_rest(&shape, &camera);
        let ring = pins.ring(&camera, [width, height]);
        let nodes = Normals::new(&shape, &view, margin_px);
        Self { shape, view, camera, pixels, nodes, pins, resting, ring, dark }
    }

    /// The light of the untouched gel.
    pub fn untouched(&self) -> Light {
        self.pins.light(&self.resting, &[], &self.camera, self.dark, &self.ring)
    }

    /// Presses an object into the gel.
    ///
    /// # Panics
    ///
    /// If what is pressed is a height map.
    pub fn press(&self, press: &PressedGel<'_>, seconds: &mut Seconds, effects: &mut EffectLog) -> CurvedPress {
        let PressedGel { indenter, shear, unit_key, pad, in_plane, held, material } = *press;
        let Shape::Mesh(object) = &indenter.shape else { panic!("only meshes are pressed into a curved gel") };
        let mut clock = Clock::start();
        let pose = &indenter.pose;
        let centre = self.shape.centre_mm();
        let in_object = pose.rotation.transpose() * (centre - pose.translation_mm);
        let nearest = pose.rotation * nearest_point(object, in_object) + pose.translation_mm - centre;
        let (distance_mm, radius_mm) = (nearest.length(), self.shape.radius_mm());
        // Below the ball's middle there is no gel; at the middle itself no direction.
        let towards = if nearest.z > 0.0 { nearest } else { DVec3::Z };
        let chart = self.chart(towards);
        let touches = distance_mm < radius_mm || effects.everywhere();

        effects.enable(Effect::Texture, Requirement::Absent("the job has none"));
        effects.enable(Effect::RestShape, Requirement::Absent("the gel's own shape is no deviation from a flat one"));
        let deepest_mm = (radius_mm - distance_mm).max(0.0);
        let mut window = pad.window(deepest_mm);
        let (depth, mut contact) = loop {
            let depth = match touches {
                true => self.nodes.capture(object, pose, &chart, window, material.thickness_mm),
                false => Depth::clear(&self.view),
            };
            seconds.depth += clock.lap();
            let mut contact = gelpad::deform(pad, &depth, None, None, in_plane.is_some(), effects);
            seconds.gelpad += clock.lap();
            match pad.higher(window, &contact) {
                Some(higher) => window = higher,
                None => {
                    let in_view = if depth.touching.is_empty() { 0.0 } else { 1.0 };
                    contact.whole = Whole { in_view_fraction: Some(in_view), ..Whole::default() };
                    break (depth, contact);
                }
            }
        };
        let shear = shear.map(|shear| Shear { motion: self.on_chart(shear.motion, &chart), ..*shear });
        contact.tangential = tangential(in_plane, material, contact.load.as_ref(), held, shear.as_ref(), None, effects);
        let about_mm = shear.map_or([0.0; 2], |shear| shear.motion.about_mm);
        let wrench = self.wrench(&contact, &chart, about_mm, material.youngs_modulus_kpa);
        if let Some(wrench) = &wrench {
            let force_n = DVec3::from_array(wrench.force_n).length();
            contact.force_n = Some(force_n);
            contact.whole.total_force_n = Some(force_n);
        }
        seconds.gelpad += clock.lap();

        for effect in [Effect::Supersampling, Effect::Shading, Effect::Grain, Effect::Shadows, Effect::Darkening] {
            effects.enable(effect, Requirement::Absent("the camera sees pins, not the skin's relief"));
        }
        let pins = effects.timed(Effect::Markers, || {
            let direction = match (self.pins.along, &wrench) {
                (Along::Press, Some(wrench)) => DVec3::from_array(wrench.force_n).try_normalize().map(|into| -into),
                _ => None,
            };
            let moved = match contact.region.is_empty() {
                true => self.resting.clone(),
                false => {
                    let motion = SkinMotion::new(&contact, &chart, &self.view, direction, &self.pins);
                    self.pins.moved(&self.shape, &motion, &self.camera)
                }
            };
            PinPositions { rest: self.resting.clone(), moved }
        });
        let light = effects.timed(Effect::Markers, || {
            let mut random = rng::stream(unit_key, "pins", 0);
            let (tips, sizes) = self.pins.jittered(&pins.moved, &self.camera, &mut random);
            self.pins.light(&tips, &sizes, &self.camera, self.dark, &self.ring)
        });
        let map = GelMap::new(&self.pixels, &chart, &self.view);
        seconds.optics += clock.lap();
        CurvedPress { depth, contact, map, pins, wrench, light, above_mm: window.above_mm }
    }

    /// With the gel's tip in its middle as long as a contact around this normal is near it; from there on it follows the
    /// contact: charts are wider than the gel far from their middle.
    fn chart(&self, normal: DVec3) -> Chart {
        let tip = Chart::at_tip(&self.shape);
        let at = DVec2::from(tip.at(normal));
        let follows_mm = at.length() - NEAR * tip.radius_mm();
        match follows_mm > 0.0 {
            true => Chart::around(&self.shape, tip.rest((at.normalize() * follows_mm).to_array()).normal),
            false => tip,
        }
    }

    /// A motion in the sensor's x and y as it is on a chart.
    fn on_chart(&self, motion: Motion, chart: &Chart) -> Motion {
        let [x, y] = motion.shift_mm;
        let shift_mm = chart.rest([0.0; 2]).tangents.map(|tangent| tangent.dot(DVec3::new(x, y, 0.0)));
        // The point of the gel that is seen there from above; the rim for one beside the gel.
        let radius_mm = self.shape.radius_mm();
        let across = DVec2::from(motion.about_mm).clamp_length_max(radius_mm);
        let up = libm::sqrt((radius_mm * radius_mm - across.length_squared()).max(0.0));
        Motion { shift_mm, about_mm: chart.at(across.extend(up)), ..motion }
    }

    /// What the object does to the gel, if the pressure is known: in the sensor's frame, about the gel's tip.
    fn wrench(&self, contact: &Contact, chart: &Chart, about_mm: [f64; 2], youngs_modulus_kpa: f64) -> Option<Wrench> {
        contact.force_n?;
        let mut wrench = Wrench::default();
        let Some(load) = &contact.load else { return Some(wrench) };
        // kPa mm^2 are mN.
        let per_node = 1e-3 * youngs_modulus_kpa * contact.stiffened * load.mm_per_px[0] * load.mm_per_px[1];
        let (mut force, mut torque) = (DVec3::ZERO, DVec3::ZERO);
        for y in 0..load.pressure.height {
            for (x, pressure) in load.pressure.row(y).iter().enumerate().filter(|(_, pressure)| **pressure > 0.0) {
                let at = [
                    load.origin_mm[0] + x as f64 * load.mm_per_px[0],
                    load.origin_mm[1] + y as f64 * load.mm_per_px[1],
                ];
                let here = f64::from(*pressure) * per_node * chart.area(at) * -chart.rest(at).normal;
                force += here;
                torque += chart.point_mm(at).cross(here);
            }
        }
        // Tractions in the chart's plane, where the object was moved.
        if let Some(shear) = contact.tangential.as_ref().and_then(|tangential| tangential.shear.as_ref()) {
            let newtons = 1e-3 * youngs_modulus_kpa;
            let [along, down] = chart.rest(about_mm).tangents;
            let pulled = newtons * (shear.force[0] * along + shear.force[1] * down);
            force += pulled;
            torque += chart.point_mm(about_mm).cross(pulled) + newtons * shear.moment * chart.rest(about_mm).normal;
        }
        wrench.force_n = force.to_array();
        wrench.torque_nmm = torque.to_array();
        Some(wrench)
    }
}
