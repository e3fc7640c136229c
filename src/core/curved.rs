//! A sensor whose gel is not flat: the press happens on a chart of the gel, whose middle is near where the object comes
//! closest to it, and a camera inside sees the gel through its lens: its pins, or the light on its skin.

use std::sync::Arc;

use glam::DVec3;

use crate::base::chart::Chart;
use crate::base::clock::{Clock, Seconds};
use crate::base::gel::GelShape;
use crate::base::grid::{Rect, bounding_box};
use crate::base::light::Light;
use crate::base::view::View;
use crate::camera::gel_map::{GelMap, GelView};
use crate::camera::pins::PinPositions;
use crate::camera::projection::Projection;
use crate::depth::indenter::{Indenter, Shape};
use crate::depth::normals::Normals;
use crate::depth::places::Places;
use crate::depth::texture::{Posed, Texture};
use crate::depth::{Depth, Window, texture_required};
use crate::effects::{Effect, EffectLog, Requirement};
use crate::gelpad::elastic::inplane::InPlane;
use crate::gelpad::elastic::shear::Friction;
use crate::gelpad::material::Material;
use crate::gelpad::sliding::{Sliding, Wrench};
use crate::gelpad::tangential::{Shear, tangential};
use crate::gelpad::total_contact::TotalContact;
use crate::gelpad::{self, Contact, Pad};
use crate::impression::SlidingState;
use crate::pose::PadPlane;
use lit::CastShadows;
use on_core::Pressed;
use seen::Seen;

pub use seen::{Look, SkinLight, SkinPicture};

mod lit;
mod on_core;
mod place;
mod seen;
pub mod sequence;

/// A gel that is not flat and the camera inside it, made ready.
pub struct Curved {
    shape: GelShape,
    /// The nodes of a chart.
    view: View,
    /// How far a chart with its margin reaches from its middle, mm.
    reach_mm: f64,
    camera: Projection,
    /// The untouched gel as the image shows it.
    gel: Arc<GelView>,
    nodes: Normals,
    seen: Seen,
}

/// What a press on a curved gel gives, before the camera.
pub struct CurvedPress {
    /// How far the object reaches below the gel, on the chart.
    pub depth: Depth,
    /// The gel under it, on the chart.
    pub contact: Contact,
    /// Where the image's pixels lie on the chart.
    pub map: GelMap,
    /// The pins, if it has any.
    pub pins: Option<PinPositions>,
    /// What the object does to the gel, in the sensor's frame about the gel's tip.
    pub wrench: Option<Wrench>,
    /// What friction did, in a frame of a sequence.
    pub slid: Option<SlidingState>,
    /// The light that the camera receives.
    pub light: Light,
    /// Height over the gel up to which the object was captured, mm.
    pub above_mm: f64,
}

/// What of a sensor with a curved gel a press needs.
pub struct PressedGel<'a> {
    /// What is pressed.
    pub indenter: &'a Indenter,
    /// The plane that it is posed over.
    pub plane: &'a PadPlane,
    /// Its micro-texture.
    pub texture: Option<&'a Texture>,
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
    /// A gel whose pad needs a margin of so many nodes.
    pub fn new(shape: GelShape, camera: Projection, view: View, margin_px: usize, look: Look<'_>) -> Self {
        let gel = Arc::new(GelView::new(shape.clone(), camera, view));
        let seen = Seen::new(look, &shape, &camera, &view, &gel);
        let nodes = Normals::new(&shape, &view, margin_px);
        let half_mm = |k: usize| 0.5 * (view.resolution_px[k] + 2 * margin_px) as f64 * view.mm_per_px[k];
        let reach_mm = libm::hypot(half_mm(0), half_mm(1));
        Self { shape, view, reach_mm, camera, gel, nodes, seen }
    }

    /// Presses an object into the gel; in a sequence `sliding` has come to where the object is.
    ///
    /// # Panics
    ///
    /// If what is pressed is a height map.
    pub fn press(
        &self,
        press: &PressedGel<'_>,
        mut sliding: Option<&mut Sliding>,
        seconds: &mut Seconds,
        effects: &mut EffectLog,
    ) -> CurvedPress {
        let PressedGel { indenter, shear, unit_key, pad, in_plane, held, material, .. } = *press;
        let object = indenter.shape.clusters().expect("heights over a plane are not pressed into a curved gel");
        let mut clock = Clock::start();
        let unseen_mm = if let Pad::Elastic(pad) = pad { pad.unseen_mm() } else { 0.0 };
        let drag = sliding.as_mut().map(|sliding| effects.timed(Effect::Friction, || sliding.drag(unseen_mm)));
        let (towards, reaches_mm) = self.deepest(object, &indenter.pose, material.thickness_mm);
        let chart = self.chart(towards);
        let touches = reaches_mm > 0.0 || effects.everywhere() || self.shape.surface().is_some();

        effects.enable(Effect::RestShape, Requirement::Absent("the gel's own shape is no deviation from a flat one"));
        let mut window = pad.window(reaches_mm.max(0.0));
        let (depth, mut contact) = loop {
            let depth = match touches {
                true => self.nodes.capture(object, &indenter.pose, &chart, window, material.thickness_mm),
                false => Depth::clear(&self.view),
            };
            let depth = self.textured(depth, press, &chart, window, effects);
            seconds.depth += clock.lap();
            let (depth, shaped) = gelpad::shaped(pad, depth, None, window, effects);
            let drag = drag.as_ref().map(Option::as_ref);
            let mut contact = gelpad::deform(pad, &depth, None, drag, in_plane.is_some(), effects);
            contact.numerics.converged &= shaped;
            seconds.gelpad += clock.lap();
            match pad.higher(window, &contact) {
                Some(higher) => window = higher,
                None => break (depth, contact),
            }
        };
        let in_view_fraction = Some(self.share_in_view(&contact, &chart));
        contact.total = TotalContact { in_view_fraction, ..TotalContact::default() };
        // Beyond the gel nothing touches: where something does, the gel goes on behind the chart's last nodes.
        let Rect { x0, y0, x1, y1 } = depth.touching;
        let goes_on = x0 == 0 || y0 == 0 || x1 == depth.penetration.width || y1 == depth.penetration.height;
        let goes_on = goes_on && !depth.touching.is_empty();
        if goes_on {
            contact.total.cut_by_view = true;
            contact.total.force_unknown =
                "the object goes on around the gel beyond its chart, and what it does there is not known";
        }
        let pressed = contact.load.as_ref().map(|load| Pressed::new(load, &chart));
        if let Some(pressed) = &pressed {
            self.on_core(&mut contact, &depth, pressed, material);
        }
        let shear = shear.map(|shear| Shear { motion: self.on_chart(shear.motion, &chart), ..*shear });
        let sliding = sliding.as_deref();
        contact.tangential =
            tangential(in_plane, material, contact.load.as_ref(), held, shear.as_ref(), sliding, effects);
        let about_mm = shear.map_or([0.0; 2], |shear| shear.motion.about_mm);
        let mut wrench = on_core::wrench(&contact, pressed.as_ref(), about_mm, material.youngs_modulus_kpa);
        let slid = sliding.map(|sliding| {
            // What friction has found is a flat layer's, too.
            let [pressure, tractions] = sliding.wrenches_over(&chart).map(|wrench| wrench.times(contact.stiffened));
            wrench = wrench.map(|wrench| wrench.and(tractions));
            SlidingState {
                slip: sliding.slip(),
                wrench: pressure.and(tractions),
                states: sliding.states(&contact.mask, &self.view),
            }
        });
        if let Some(wrench) = &wrench {
            let force_n = DVec3::from_array(wrench.force_n).length();
            contact.force_n = Some(force_n);
            contact.total.total_force_n = (!goes_on).then_some(force_n);
        }
        if let Shape::Seen(seen) = &indenter.shape {
            contact.total = TotalContact::framed(&mut contact, seen.is_cut);
        }
        seconds.gelpad += clock.lap();

        effects.enable(Effect::Grain, Requirement::Absent("not simulated on a gel that has a shape"));
        let shadows = self.shadows(&contact, &chart, effects);
        let map = self.map(&chart, &depth, &contact, window, shadows.as_ref());
        let (pins, light) =
            self.looked_at((&contact, &chart, &map), shadows.as_ref(), wrench.as_ref(), unit_key, effects);
        seconds.optics += clock.lap();
        let wrench = wrench.filter(|_| contact.force_n.is_some());
        CurvedPress { depth, contact, map, pins, wrench, slid, light, above_mm: window.above_mm }
    }

    /// What is left of an object where its texture cuts it.
    fn textured(
        &self,
        mut depth: Depth,
        press: &PressedGel<'_>,
        chart: &Chart,
        window: Window,
        effects: &mut EffectLog,
    ) -> Depth {
        let PressedGel { indenter, plane, texture, .. } = press;
        effects.run(Effect::Texture, texture_required(*texture, &depth), || {
            if let Some(texture) = texture {
                let place =
                    |node: [usize; 2]| self.view.point_mm(node.map(|at| at as f64 + 0.5 - window.margin_px as f64));
                let places = Places { chart, place: &place, pitch_mm: self.view.mm_per_px };
                let posed = Posed { pose: &indenter.pose, plane };
                crate::depth::texture::cut_along_normals(texture, &posed, &places, window.above_mm, &mut depth);
            }
        });
        depth
    }

    /// Where the image's pixels lie on a chart, as far as there is something to show.
    fn map(
        &self,
        chart: &Chart,
        depth: &Depth,
        contact: &Contact,
        window: Window,
        shadows: Option<&CastShadows>,
    ) -> GelMap {
        let [width, height] = self.view.resolution_px;
        // What is in reach is shown by gaps; the gel moves in its own plane far beyond.
        let reached = bounding_box(&depth.penetration, |mm| mm > -window.above_mm as f32);
        let reached = reached.seen_from(depth.margin_px, depth.margin_px, width, height);
        let part = match contact.tangential {
            Some(_) => Rect::whole(width, height),
            None => contact.region.united(reached).united(shadows.map_or_else(Rect::default, |shadows| shadows.part)),
        };
        GelMap::new(&self.gel, chart, part)
    }
}
