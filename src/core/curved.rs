//! A sensor with a curved gel. The press is computed on a chart of the gel whose centre is near the place where the
//! object comes closest to it. A camera inside sees the gel through its lens: its pins, or the light on its skin.

use std::sync::Arc;

use glam::DVec3;

use crate::base::chart::Chart;
use crate::base::clock::{Seconds, ThreadClock};
use crate::base::gel::GelShape;
use crate::base::grid::{Rect, bounding_box};
use crate::base::light::Light;
use crate::base::view::View;
use crate::camera::gel_map::{GelMap, GelView};
use crate::camera::pins::PinPositions;
use crate::camera::projection::Projection;
use crate::depth::chart_grid::ChartGrid;
use crate::depth::indenter::{Indenter, Shape};
use crate::depth::normal_capture::NormalCapture;
use crate::depth::texture::{PosedObject, Texture};
use crate::depth::{CaptureWindow, Depth, texture_required};
use crate::effects::{Effect, EffectLog, Requirement};
use crate::gelpad::elastic::in_plane::InPlaneResponse;
use crate::gelpad::elastic::shear::Friction;
use crate::gelpad::material::Material;
use crate::gelpad::sliding::{Sliding, Wrench};
use crate::gelpad::tangential::{Shear, solve_tangential_motion};
use crate::gelpad::total_contact::TotalContact;
use crate::gelpad::{self, Contact, Pad};
use crate::impression::SlidingState;
use crate::pose::PadPlane;
use core_correction::PressedNodes;
use gel_picture::GelPicture;
use skin_shading::CastShadows;

pub use gel_picture::{GelAppearance, SkinLight, SkinPicture};

mod contact_chart;
mod core_correction;
mod gel_picture;
pub mod sequence;
mod skin_shading;

/// A curved gel and the camera inside it, with everything that is computed once per sensor.
pub struct CurvedGel {
    shape: GelShape,
    /// The grid of nodes of a chart.
    view: View,
    /// Distance from a chart's centre to the corner of its margin, mm.
    reach_mm: f64,
    camera: Projection,
    /// The untouched gel as the image shows it.
    gel: Arc<GelView>,
    normals: NormalCapture,
    picture: GelPicture,
}

/// Result of a press into a curved gel, before the camera.
pub struct CurvedPressResult {
    /// How far the object reaches below the gel, on the chart.
    pub depth: Depth,
    /// The gel pad in contact, on the chart.
    pub contact: Contact,
    /// Where the image's pixels lie on the chart.
    pub map: GelMap,
    /// The pins, if the sensor has any.
    pub pins: Option<PinPositions>,
    /// The wrench of the object on the gel, in the sensor's frame about the gel's tip.
    pub wrench: Option<Wrench>,
    /// The effect of friction, in a frame of a sequence.
    pub sliding: Option<SlidingState>,
    /// The light that the camera receives.
    pub light: Light,
    /// Height over the gel up to which the object was captured, mm.
    pub above_mm: f64,
}

/// Inputs of a press into a curved gel.
pub struct CurvedPressInput<'a> {
    /// The object that is pressed.
    pub indenter: &'a Indenter,
    /// The plane that the object is posed over.
    pub plane: &'a PadPlane,
    /// The object's micro-texture.
    pub texture: Option<&'a Texture>,
    /// The object's motion after the press.
    pub shear: Option<&'a Shear>,
    /// Seed of what differs between units of the sensor.
    pub unit_key: u64,
    /// The pad.
    pub pad: &'a Pad,
    /// The pad's response in its own plane.
    pub in_plane: Option<&'a InPlaneResponse>,
    /// Friction between gel and object during the press.
    pub press_friction: Option<Friction>,
    /// The pad's material.
    pub material: &'a Material,
}

impl CurvedGel {
    /// Prepares a gel whose pad needs a margin of `margin_px` nodes.
    pub fn new(shape: GelShape, camera: Projection, view: View, margin_px: usize, look: GelAppearance<'_>) -> Self {
        let gel = Arc::new(GelView::new(shape.clone(), camera, view));
        let picture = GelPicture::new(look, &shape, &camera, &view, &gel);
        let normals = NormalCapture::new(&shape, &view, margin_px);
        let half_mm = |k: usize| 0.5 * (view.resolution_px[k] + 2 * margin_px) as f64 * view.mm_per_px[k];
        let reach_mm = libm::hypot(half_mm(0), half_mm(1));
        Self { shape, view, reach_mm, camera, gel, normals, picture }
    }

    /// Presses an object into the gel. In a sequence, `sliding` has already been advanced to the object's pose.
    ///
    /// # Panics
    ///
    /// Panics if the object is a height map.
    pub fn press(
        &self,
        press: &CurvedPressInput<'_>,
        mut sliding: Option<&mut Sliding>,
        seconds: &mut Seconds,
        effects: &mut EffectLog,
    ) -> CurvedPressResult {
        let CurvedPressInput { indenter, shear, unit_key, pad, in_plane, press_friction, material, .. } = *press;
        let object = indenter.shape.clusters().expect("heights over a plane are not pressed into a curved gel");
        let mut clock = ThreadClock::start();
        let unseen_mm = if let Pad::Elastic(pad) = pad { pad.negligible_mm() } else { 0.0 };
        let carried =
            sliding.as_mut().map(|sliding| effects.run_timed(Effect::Friction, || sliding.carried_loads(unseen_mm)));
        let (towards, reaches_mm) = self.find_deepest_site(object, &indenter.pose, material.thickness_mm);
        let chart = self.chart_around(towards);
        // On a mesh the search for the deepest point is local and may miss the contact: capture it in any case.
        let touches = reaches_mm > 0.0 || effects.runs_everywhere() || self.shape.surface().is_some();

        effects.enable(Effect::RestShape, Requirement::Absent("the gel's own shape is no deviation from a flat one"));
        let mut window = pad.capture_window(reaches_mm.max(0.0));
        // The pad may turn out to displace more than the window captured: then it is captured again, higher.
        let (depth, mut contact) = loop {
            let depth = match touches {
                true => self.normals.capture(object, &indenter.pose, &chart, window, material.thickness_mm),
                false => Depth::no_contact(&self.view),
            };
            let depth = self.cut_texture(depth, press, &chart, window, effects);
            seconds.depth += clock.lap();
            let (depth, shaped) = gelpad::deform_object(pad, depth, None, window, effects);
            let mut contact = gelpad::deform_pad(pad, &depth, None, carried.as_ref(), in_plane.is_some(), effects);
            contact.numerics.converged &= shaped;
            seconds.gelpad += clock.lap();
            match pad.higher_window(window, &contact) {
                Some(higher) => window = higher,
                None => break (depth, contact),
            }
        };
        let in_view_fraction = Some(self.in_view_fraction(&contact, &chart));
        contact.total = TotalContact { in_view_fraction, ..TotalContact::default() };
        // Beyond the gel there is no contact. A contact at the chart's border therefore continues on the gel beyond the
        // chart.
        let Rect { x0, y0, x1, y1 } = depth.touching;
        let goes_on = x0 == 0 || y0 == 0 || x1 == depth.penetration.width || y1 == depth.penetration.height;
        let goes_on = goes_on && !depth.touching.is_empty();
        if goes_on {
            contact.total.cut_by_view = true;
            contact.total.force_unknown =
                "the object goes on around the gel beyond its chart, and what it does there is not known";
        }
        let pressed = contact.load.as_ref().map(|load| PressedNodes::new(load, &chart));
        if let Some(pressed) = &pressed {
            self.correct_for_core(&mut contact, &depth, pressed, material);
        }
        let shear = shear.map(|shear| Shear { motion: self.motion_on_chart(shear.motion, &chart), ..*shear });
        let sliding = sliding.as_deref();
        contact.tangential = solve_tangential_motion(
            in_plane,
            material,
            (contact.load.as_ref(), None),
            press_friction,
            shear.as_ref(),
            sliding,
            effects,
        );
        if let (Some(tangential), Some(in_plane), true) = (&mut contact.tangential, in_plane, self.has_stiff_skin()) {
            tangential.set_drag_apart(in_plane, contact.load.as_ref());
        }
        let about_mm = shear.map_or([0.0; 2], |shear| shear.motion.about_mm);
        let mut wrench =
            core_correction::press_wrench(&contact, pressed.as_ref(), about_mm, material.youngs_modulus_kpa);
        let sliding_state = sliding.map(|sliding| {
            // Friction, too, is solved for a flat layer; its wrenches get the same correction.
            // Their loads have relaxed already.
            let factor = contact.stiffening_factor / carried.as_ref().map_or(1.0, |carried| carried.stiffness);
            let [pressure, tractions] = sliding.wrenches_on_gel(&chart).map(|wrench| wrench.scaled_by(factor));
            wrench = wrench.map(|wrench| wrench.plus(tractions));
            SlidingState {
                slip: sliding.slip(),
                wrench: pressure.plus(tractions),
                states: sliding.stick_slip_states(&contact.mask, &self.view),
                tractions: sliding.traction_map(factor),
            }
        });
        if let Some(wrench) = &wrench {
            let force_n = DVec3::from_array(wrench.force_n).length();
            contact.force_n = Some(force_n);
            contact.total.total_force_n = (!goes_on).then_some(force_n);
            // What goes on around the gel presses on its sides and its top, so it adds nothing away from the tip.
            let down_n = (0.0 - wrench.force_n[2]).max(0.0);
            contact.total.total_force_at_least_n = Some(if goes_on { down_n } else { force_n });
        }
        if let Shape::Seen(seen) = &indenter.shape {
            contact.total = TotalContact::of_depth_frame(&mut contact, seen.is_cut);
        }
        seconds.gelpad += clock.lap();

        effects.enable(Effect::Grain, Requirement::Absent("not simulated on a gel that has a shape"));
        let shadows = self.press_shadows(&contact, &chart, effects);
        let map = self.make_gel_map(&chart, &depth, &contact, window, shadows.as_ref());
        let (pins, light) =
            self.render_picture((&contact, &chart, &map), shadows.as_ref(), wrench.as_ref(), unit_key, effects);
        seconds.optics += clock.lap();
        let wrench = wrench.filter(|_| contact.force_n.is_some());
        CurvedPressResult {
            depth,
            contact,
            map,
            pins,
            wrench,
            sliding: sliding_state,
            light,
            above_mm: window.above_mm,
        }
    }

    /// Removes from the captured depth what the object's texture cuts away.
    fn cut_texture(
        &self,
        mut depth: Depth,
        press: &CurvedPressInput<'_>,
        chart: &Chart,
        window: CaptureWindow,
        effects: &mut EffectLog,
    ) -> Depth {
        let CurvedPressInput { indenter, plane, texture, .. } = press;
        effects.run(Effect::Texture, texture_required(*texture, &depth), || {
            if let Some(texture) = texture {
                let place =
                    |node: [usize; 2]| self.view.point_mm(node.map(|at| at as f64 + 0.5 - window.margin_px as f64));
                let places = ChartGrid { chart, position_mm: &place, spacing_mm: self.view.mm_per_px };
                let posed = PosedObject { pose: &indenter.pose, plane };
                crate::depth::texture::cut_along_normals(texture, &posed, &places, window.above_mm, &mut depth);
            }
        });
        depth
    }

    /// Maps the image's pixels to a chart, in the part where there is something to show.
    fn make_gel_map(
        &self,
        chart: &Chart,
        depth: &Depth,
        contact: &Contact,
        window: CaptureWindow,
        shadows: Option<&CastShadows>,
    ) -> GelMap {
        let [width, height] = self.view.resolution_px;
        // What is within reach shows by its gaps; in its own plane the gel moves far beyond that.
        let reached = bounding_box(&depth.penetration, |mm| mm > -window.above_mm as f32);
        let reached = reached.in_window(depth.margin_px, depth.margin_px, width, height);
        let part = match contact.tangential {
            Some(_) => Rect::whole(width, height),
            None => contact.region.union(reached).union(shadows.map_or_else(Rect::default, |shadows| shadows.part)),
        };
        GelMap::new(&self.gel, chart, part)
    }
}
