//! A sensor whose gel is not flat: the press happens on a chart of the gel, whose middle is near where the object comes
//! closest to it, and a camera inside sees the gel through its lens: its pins, or the light on its skin.

use std::sync::Arc;

use glam::{DVec2, DVec3};

use crate::core::base::chart::Chart;
use crate::core::base::clock::{Clock, Seconds};
use crate::core::base::gel::{GelShape, Site};
use crate::core::base::grid::{Grid, Rect, bounding_box};
use crate::core::base::light::Light;
use crate::core::base::rng;
use crate::core::base::surface::unrolled::Unrolled;
use crate::core::base::view::View;
use crate::core::camera::gel_map::{GelMap, Slopes};
use crate::core::camera::pins::{Along, PinPositions, Pins, SkinMotion, Tip};
use crate::core::camera::projection::Projection;
use crate::core::depth::indenter::{Indenter, Shape};
use crate::core::depth::lines::DEEP;
use crate::core::depth::normals::{Normals, Places};
use crate::core::depth::texture::{Posed, Texture};
use crate::core::depth::touch;
use crate::core::depth::{Depth, texture_required};
use crate::core::effects::{Effect, EffectLog, Requirement};
use crate::core::gelpad::elastic::inplane::{InPlane, Load};
use crate::core::gelpad::elastic::model_error::{ContactEdge, error_on_core_mm, force_on_core};
use crate::core::gelpad::elastic::shear::{Friction, Motion};
use crate::core::gelpad::material::Material;
use crate::core::gelpad::sliding::{Sliding, Wrench};
use crate::core::gelpad::tangential::{Shear, tangential};
use crate::core::gelpad::whole::Whole;
use crate::core::gelpad::{self, Contact, Pad};
use crate::core::impression::Slid;
use crate::core::mesh::clusters::Clusters;
use crate::core::mesh::nearest::nearest_point;
use crate::core::optics::Illumination;
use crate::core::optics::background::{BackgroundImage, RenderedBackground};
use crate::core::optics::phong::Phong;
use crate::core::optics::skin::{self, AlongGel, PressedSkin, Skin, SkinPoint};
use crate::core::pose::{PadPlane, Pose};

pub mod sequence;

/// A contact's radius over its area per perimeter, at most: a disc's is 2.
const WIDEST: f64 = 3.0;

/// Variance of a round contact's pressure along an axis, as a share of its radius squared: 1 / 5 on a half-space, 1 / 6 on a
/// layer much thinner than the contact is wide.
const SPREAD: f64 = 1.0 / 5.5;

/// How far from its chart's middle a contact may be on a dome, rad: lengths there are off by 0.7 %.
const NEAR: f64 = 0.2;

/// A gel that is not flat and the camera inside it, made ready.
pub struct Curved {
    shape: GelShape,
    /// The nodes of a chart.
    view: View,
    /// How far a chart with its margin reaches from its middle, mm.
    reach_mm: f64,
    camera: Projection,
    /// What the pixels of the image show of the gel.
    sites: Arc<[Option<Site>]>,
    nodes: Normals,
    seen: Seen,
}

/// What the camera sees.
enum Seen {
    Pins(PinPicture),
    Skin(Box<Skin>, BackgroundImage),
}

struct PinPicture {
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
    /// The pins, if it has any.
    pub pins: Option<PinPositions>,
    /// What the object does to the gel, in the sensor's frame about the gel's tip.
    pub wrench: Option<Wrench>,
    /// What friction did, in a frame of a sequence.
    pub slid: Option<Slid>,
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

/// What lights a gel that is seen by its skin.
pub struct SkinLight<'a> {
    /// How the skin reflects.
    pub phong: Phong,
    /// The LEDs.
    pub light: Illumination<'a>,
    /// The picture of the untouched skin.
    pub background: SkinPicture<'a>,
    /// The image with pixels as large as they are at the gel's tip.
    pub in_image: View,
}

/// See [`SkinLight::background`].
pub enum SkinPicture<'a> {
    /// Rendered, with the noise of its grain.
    Rendered(&'a RenderedBackground, &'a Grid<f32>),
    /// Taken by the camera itself.
    Photograph(&'a BackgroundImage),
}

impl Curved {
    /// Of a sensor with these pins, on a gel whose pad needs a margin of so many nodes, over a picture of this colour.
    pub fn with_pins(
        shape: GelShape,
        camera: Projection,
        view: View,
        margin_px: usize,
        pins: Pins,
        dark: [f64; 3],
    ) -> Self {
        let resting = pins.at_rest(&shape, &camera);
        let ring = pins.ring(&camera, view.resolution_px);
        Self::new(shape, camera, view, margin_px, |_| Seen::Pins(PinPicture { pins, resting, ring, dark }))
    }

    /// Of a sensor that sees the light on its skin.
    pub fn with_skin(shape: GelShape, camera: Projection, view: View, margin_px: usize, look: &SkinLight<'_>) -> Self {
        Self::new(shape.clone(), camera, view, margin_px, |sites| {
            let point = |site: &Option<Site>| {
                site.map(|site| SkinPoint { site, to_camera: camera.towards_camera(site.point_mm) })
            };
            let points: Vec<_> = sites.iter().map(point).collect();
            let along_gel = AlongGel::new(look.light.leds, &shape);
            let picture = match look.background {
                SkinPicture::Rendered(look_of, noise) => {
                    skin::rendered(look_of, noise, look.light.leds, &along_gel, &points, &look.in_image)
                }
                SkinPicture::Photograph(photograph) => photograph.clone(),
            };
            let skin = Skin::new(look.phong, &look.light, &along_gel, &points, view.resolution_px[0]);
            Seen::Skin(Box::new(skin), picture)
        })
    }

    fn new(
        shape: GelShape,
        camera: Projection,
        view: View,
        margin_px: usize,
        seen: impl FnOnce(&[Option<Site>]) -> Seen,
    ) -> Self {
        let [width, height] = view.resolution_px;
        let centre = |at: usize| [(at % width) as f64 + 0.5, (at / width) as f64 + 0.5];
        let sites: Arc<[Option<Site>]> = (0..width * height).map(|at| camera.site(&shape, centre(at))).collect();
        let seen = seen(&sites);
        let nodes = Normals::new(&shape, &view, margin_px);
        let half_mm = |k: usize| 0.5 * (view.resolution_px[k] + 2 * margin_px) as f64 * view.mm_per_px[k];
        let reach_mm = libm::hypot(half_mm(0), half_mm(1));
        Self { shape, view, reach_mm, camera, sites, nodes, seen }
    }

    /// The light of the untouched gel.
    pub fn untouched(&self) -> Light {
        match &self.seen {
            Seen::Pins(PinPicture { pins, resting, ring, dark }) => pins.light(resting, &[], &self.camera, *dark, ring),
            Seen::Skin(skin, picture) => {
                let inwards = |site: &Option<Site>| site.map_or(DVec3::NEG_Z, |site| -site.normal).as_vec3().to_array();
                let normals: Vec<[f32; 3]> = self.sites.iter().map(inwards).collect();
                skin.untouched(picture, &normals)
            }
        }
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
        let PressedGel { indenter, plane, texture, shear, unit_key, pad, in_plane, held, material } = *press;
        let object = indenter.shape.clusters().expect("heights over a plane are not pressed into a curved gel");
        let mut clock = Clock::start();
        let unseen_mm = if let Pad::Elastic(pad) = pad { pad.unseen_mm() } else { 0.0 };
        let drag = sliding.as_mut().map(|sliding| effects.timed(Effect::Friction, || sliding.drag(unseen_mm)));
        let pose = &indenter.pose;
        let (towards, reaches_mm) = self.deepest(object, pose, material.thickness_mm);
        let chart = self.chart(towards);
        let touches = reaches_mm > 0.0 || effects.everywhere() || self.shape.surface().is_some();

        effects.enable(Effect::RestShape, Requirement::Absent("the gel's own shape is no deviation from a flat one"));
        let deepest_mm = reaches_mm.max(0.0);
        let mut window = pad.window(deepest_mm);
        let (depth, mut contact) = loop {
            let mut depth = match touches {
                true => self.nodes.capture(object, pose, &chart, window, material.thickness_mm),
                false => Depth::clear(&self.view),
            };
            effects.run(Effect::Texture, texture_required(texture, &depth), || {
                if let Some(texture) = texture {
                    let place =
                        |node: [usize; 2]| self.view.point_mm(node.map(|at| at as f64 + 0.5 - window.margin_px as f64));
                    let places = Places { chart: &chart, place: &place, pitch_mm: self.view.mm_per_px };
                    texture.cut_along_normals(&Posed { pose, plane }, &places, window.above_mm, &mut depth);
                }
            });
            seconds.depth += clock.lap();
            let (depth, shaped) = gelpad::shaped(pad, depth, None, window, effects);
            let drag = drag.as_ref().map(Option::as_ref);
            let mut contact = gelpad::deform(pad, &depth, None, drag, in_plane.is_some(), effects);
            contact.numerics.converged &= shaped;
            seconds.gelpad += clock.lap();
            match pad.higher(window, &contact) {
                Some(higher) => window = higher,
                None => {
                    let in_view_fraction = Some(self.share_in_view(&contact, &chart));
                    contact.whole = Whole { in_view_fraction, ..Whole::default() };
                    break (depth, contact);
                }
            }
        };
        self.on_core(&mut contact, &depth, &chart, material);
        let shear = shear.map(|shear| Shear { motion: self.on_chart(shear.motion, &chart), ..*shear });
        let sliding = sliding.as_deref();
        contact.tangential =
            tangential(in_plane, material, contact.load.as_ref(), held, shear.as_ref(), sliding, effects);
        let about_mm = shear.map_or([0.0; 2], |shear| shear.motion.about_mm);
        let mut wrench = self.wrench(&contact, &chart, about_mm, material.youngs_modulus_kpa);
        let slid = sliding.map(|sliding| {
            // What friction has found is a flat layer's, too.
            let [pressure, tractions] = sliding.wrenches_over(&chart).map(|wrench| wrench.times(contact.stiffened));
            wrench = wrench.map(|wrench| wrench.and(tractions));
            Slid {
                slip: sliding.slip(),
                wrench: pressure.and(tractions),
                states: sliding.states(&contact.mask, &self.view),
            }
        });
        if let Some(wrench) = &wrench {
            let force_n = DVec3::from_array(wrench.force_n).length();
            contact.force_n = Some(force_n);
            contact.whole.total_force_n = Some(force_n);
        }
        if let Shape::Seen(seen) = &indenter.shape {
            contact.whole = Whole::framed(&mut contact, seen.is_cut);
        }
        seconds.gelpad += clock.lap();

        for effect in [Effect::Supersampling, Effect::Grain, Effect::Shadows] {
            effects.enable(effect, Requirement::Absent("not simulated on a gel that has a shape"));
        }
        let [width, height] = self.view.resolution_px;
        // What is in reach is shown by gaps; the gel moves in its own plane far beyond.
        let reached = bounding_box(&depth.overlap, |mm| mm > -window.above_mm as f32);
        let reached = reached.seen_from(depth.margin_px, depth.margin_px, width, height);
        let part = match contact.tangential {
            Some(_) => Rect::whole(width, height),
            None => contact.region.united(reached),
        };
        let map = GelMap::new(&self.shape, &self.camera, Arc::clone(&self.sites), &chart, &self.view, part);
        let (pins, light) = match &self.seen {
            Seen::Pins(picture) => {
                for effect in [Effect::Shading, Effect::Darkening] {
                    effects.enable(effect, Requirement::Absent("the camera sees pins, not the skin's relief"));
                }
                let (pins, light) = effects.timed(Effect::Markers, || {
                    let pins = self.moved(picture, &contact, &chart, wrench.as_ref());
                    let mut random = rng::stream(unit_key, "pins", 0);
                    let (tips, sizes) = picture.pins.jittered(&pins.moved, &self.camera, &mut random);
                    let light = picture.pins.light(&tips, &sizes, &self.camera, picture.dark, &picture.ring);
                    (pins, light)
                });
                (Some(pins), light)
            }
            Seen::Skin(skin, picture) => (None, shaded(skin, picture, &map, &contact, &self.view, effects)),
        };
        seconds.optics += clock.lap();
        let wrench = wrench.filter(|_| contact.force_n.is_some());
        CurvedPress { depth, contact, map, pins, wrench, slid, light, above_mm: window.above_mm }
    }

    /// Where the pins are.
    fn moved(&self, seen: &PinPicture, contact: &Contact, chart: &Chart, wrench: Option<&Wrench>) -> PinPositions {
        let PinPicture { pins, resting, .. } = seen;
        let direction = match (pins.along, wrench) {
            (Along::Press, Some(wrench)) => DVec3::from_array(wrench.force_n).try_normalize().map(|into| -into),
            _ => None,
        };
        let moved = match contact.region.is_empty() {
            true => resting.clone(),
            false => {
                let motion = SkinMotion::new(contact, chart, &self.view, direction, pins);
                pins.moved(&self.shape, &motion, &self.camera)
            }
        };
        PinPositions { rest: resting.clone(), moved }
    }

    /// Corrects forces and the error that the model states for the core under the gel, which is curved as the gel is.
    fn on_core(&self, contact: &mut Contact, depth: &Depth, chart: &Chart, material: &Material) {
        let Some(load) = &contact.load else { return };
        let (radius_mm, curvature_per_mm) = pressed(load, chart);
        // Of many small contacts each is as wide as it is, whatever they are spread over.
        let edge = ContactEdge::of(&contact.mask, &depth.overlap, depth.margin_px, self.view.mm_per_px);
        let radius_mm = edge.map_or(radius_mm, |edge| radius_mm.min(WIDEST * edge.area_over_perimeter_mm));
        contact.stiffen(force_on_core(radius_mm, curvature_per_mm, material.thickness_mm, material.poisson_ratio));
        if let Some(error_um) = contact.numerics.model_error_um.as_mut() {
            let turn_rad = radius_mm * curvature_per_mm.abs();
            *error_um = 1e3 * error_on_core_mm(1e-3 * *error_um, f64::from(depth.deepest_mm), turn_rad);
        }
    }

    /// Share of the contact that the image shows, 0 without contact. A dome's chart ends where the image does.
    fn share_in_view(&self, contact: &Contact, chart: &Chart) -> f64 {
        let [width, height] = self.view.resolution_px;
        let mask = &contact.mask;
        let touched = (0..height).flat_map(|y| (0..width).map(move |x| [x, y])).filter(|[x, y]| mask.at(*x, *y) > 0);
        let (mut all, mut seen) = (0_u32, 0_u32);
        // A share needs no more than some of the nodes.
        for [x, y] in touched.step_by(1 + contact.region.area() / 2000) {
            all += 1;
            seen += u32::from(
                matches!(self.shape, GelShape::Dome(_)) || {
                    let point = chart.point_mm(self.view.point_mm([x as f64 + 0.5, y as f64 + 0.5]));
                    let shown = |[x, y]: [f64; 2]| x >= 0.0 && y >= 0.0 && x <= width as f64 && y <= height as f64;
                    self.camera.point_px(point).is_some_and(shown)
                },
            );
        }
        if all > 0 { f64::from(seen) / f64::from(all) } else { 0.0 }
    }

    /// Where the object comes closest to the gel's axis: the point of the gel that is on the way, and how far the object reaches
    /// below it, mm. On a mesh where it reaches deepest.
    fn deepest(&self, object: &Clusters, pose: &Pose, thickness_mm: f64) -> (Site, f64) {
        if object.is_empty() {
            return (self.shape.tip(), f64::NEG_INFINITY);
        }
        if let GelShape::Mesh(surface) = &self.shape {
            let (point_mm, normal, reaches_mm) = touch::deepest(surface, object, pose, DEEP * thickness_mm);
            return (Site { normal, below_mm: 0.0, point_mm }, reaches_mm);
        }
        let (centre, wall_mm) = (self.shape.centre_mm(), self.shape.wall_mm().unwrap_or(0.0));
        let nearest = |below_mm: f64| {
            let from = centre - DVec3::new(0.0, 0.0, below_mm);
            let in_object = pose.rotation.transpose() * (from - pose.translation_mm);
            pose.rotation * nearest_point(object, in_object) + pose.translation_mm - from
        };
        // From the best of several places, as an object may come close to the axis in more than one; then by turns the closest
        // point of the object, and the point of the axis closest to that.
        let starts = libm::ceil(2.0 * wall_mm / self.shape.radius_mm()).min(32.0) as usize;
        let mut best = (0.0, nearest(0.0));
        for start in 1..=starts {
            let below_mm = wall_mm * start as f64 / starts as f64;
            let at = nearest(below_mm);
            if at.length_squared() < best.1.length_squared() {
                best = (below_mm, at);
            }
        }
        for _ in 0..20 {
            let next_mm = (best.0 - best.1.z).clamp(0.0, wall_mm);
            if (next_mm - best.0).abs() < 1e-6 * self.shape.radius_mm() {
                break;
            }
            best = (next_mm, nearest(next_mm));
        }
        let (below_mm, at) = best;
        // Below a dome's middle there is no gel; at the middle itself no direction.
        let normal = match (below_mm > 0.0, at.z > 0.0) {
            (true, _) => DVec3::new(at.x, at.y, 0.0).normalize_or(DVec3::X),
            (false, true) => at,
            (false, false) if wall_mm > 0.0 => DVec3::new(at.x, at.y, 0.0).normalize_or(DVec3::Z),
            (false, false) => DVec3::Z,
        };
        (self.shape.site(normal, below_mm), self.shape.radius_mm() - at.length())
    }

    /// With the gel's tip in its middle as long as a contact around this point of a dome is near it; from there on it follows
    /// the contact: charts are wider than the gel far from their middle. On a capsule the one of the closest latitude. On a mesh that
    /// of the tip as long as the gel leans as little as there, else one around the point.
    fn chart(&self, site: Site) -> Chart {
        if let GelShape::Mesh(surface) = &self.shape {
            let tip = Chart::at_tip(&self.shape);
            let [x, y] = tip.at(site);
            let within =
                |mm: f64, k: usize| mm.abs() <= 0.5 * self.view.resolution_px[k] as f64 * self.view.mm_per_px[k];
            let near = site.normal.angle_between(surface.tip_normal()) < NEAR && within(x, 0) && within(y, 1);
            return match near {
                true => tip,
                false => Chart::unrolled(Arc::new(Unrolled::around(surface, site.point_mm, self.reach_mm))),
            };
        }
        if self.shape.wall_mm().is_some() {
            return Chart::around(&self.shape, site);
        }
        let tip = Chart::at_tip(&self.shape);
        let at = DVec2::from(tip.at(site));
        let follows_mm = at.length() - NEAR * tip.radius_mm();
        match follows_mm > 0.0 {
            true => {
                let normal = tip.rest((at.normalize() * follows_mm).to_array()).normal;
                Chart::around(&self.shape, self.shape.site(normal, 0.0))
            }
            false => tip,
        }
    }

    /// A motion in the sensor's x and y as it is on a chart.
    fn on_chart(&self, motion: Motion, chart: &Chart) -> Motion {
        let [x, y] = motion.shift_mm;
        let shift_mm = chart.rest([0.0; 2]).tangents.map(|tangent| tangent.dot(DVec3::new(x, y, 0.0)));
        if let GelShape::Mesh(surface) = &self.shape {
            let [x, y] = motion.about_mm;
            let below = DVec3::new(x, y, surface.bounds_mm()[0].z - 1.0);
            let about_mm = surface.left_by(below, DVec3::Z).map_or([0.0; 2], |(point_mm, normal)| {
                let at = chart.at(Site { normal, below_mm: 0.0, point_mm });
                if at[0].is_nan() { [0.0; 2] } else { at }
            });
            return Motion { shift_mm, about_mm, ..motion };
        }
        // The point of the gel that is seen there from above; the rim for one beside the gel.
        let radius_mm = self.shape.radius_mm();
        let across = DVec2::from(motion.about_mm).clamp_length_max(radius_mm);
        let up = libm::sqrt((radius_mm * radius_mm - across.length_squared()).max(0.0));
        let about_mm = chart.at(self.shape.site(across.extend(up), 0.0));
        Motion { shift_mm, about_mm, ..motion }
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

/// The light on a pressed skin, where it differs from that of the untouched one.
fn shaded(
    skin: &Skin,
    picture: &BackgroundImage,
    map: &GelMap,
    contact: &Contact,
    view: &View,
    effects: &mut EffectLog,
) -> Light {
    let [width, height] = map.size_px();
    let seen = map.around(contact.region);
    let changed = if effects.everywhere() { Rect::whole(width, height) } else { seen };
    let need = |why| match (contact.region.is_empty(), seen.is_empty()) {
        (true, _) => Requirement::Unneeded("the skin is untouched"),
        (false, true) => Requirement::Unneeded("the camera does not see what is pressed"),
        (false, false) => Requirement::Needed(why),
    };
    let shades = effects.enable(Effect::Shading, need("the skin is pressed in"));
    let darkens = match skin.darkens() {
        true => need("the skin is pressed in"),
        false => Requirement::Absent("the optics model has no darkening"),
    };
    let darkens = effects.enable(Effect::Darkening, darkens);
    if !shades {
        return Light::default();
    }
    effects.timed(Effect::Shading, || {
        let slopes = Slopes::new(&contact.surface, view);
        let mut normals = Vec::with_capacity(changed.area());
        let mut displaced_mm = Vec::with_capacity(changed.area());
        for y in changed.y0..changed.y1 {
            for x in changed.x0..changed.x1 {
                let (normal, down_mm) = map.pressed(&slopes, y * width + x).unwrap_or((DVec3::NEG_Z, 0.0));
                normals.push(normal.as_vec3().to_array());
                displaced_mm.push(down_mm);
            }
        }
        skin.shade(&PressedSkin { region: changed, normals: &normals, displaced_mm: &displaced_mm }, picture, darkens)
    })
}

/// Radius of a contact, mm, or half the width of a long one; and the mean curvature of the gel there, per mm, half of how its
/// normals part. By the pressure, which is nothing at the contact's edge: neither jumps from pixel to pixel, nor where the
/// contact goes over from a part of the gel into another.
fn pressed(load: &Load, chart: &Chart) -> (f64, f64) {
    let place = |x: usize, y: usize| {
        let at = [x, y];
        DVec2::from([0, 1].map(|k| load.origin_mm[k] + at[k] as f64 * load.mm_per_px[k]))
    };
    let rows = (0..load.pressure.height).flat_map(|y| (0..load.pressure.width).map(move |x| [x, y]));
    let nodes: Vec<(DVec2, f64)> = rows
        .filter(|[x, y]| load.pressure.at(*x, *y) > 0.0)
        .map(|[x, y]| (place(x, y), f64::from(load.pressure.at(x, y))))
        .collect();
    let all: f64 = nodes.iter().map(|(_, p)| p).sum();
    let middle = nodes.iter().map(|(at, p)| *p * *at).sum::<DVec2>() / all;
    let centre = chart.rest(middle.to_array());
    let (mut along, mut across, mut down, mut parted, mut squares) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for (at, p) in &nodes {
        let [x, y] = (*at - middle).to_array();
        along += p * x * x;
        across += p * x * y;
        down += p * y * y;
        let rest = chart.rest(at.to_array());
        let away = rest.point_mm - centre.point_mm;
        parted += p * (rest.normal - centre.normal).dot(away);
        squares += p * away.length_squared();
    }
    // The smaller of the variances along the contact's own axes.
    let half = 0.5 * (along + down);
    let least = (half - libm::hypot(0.5 * (along - down), across)).max(0.0) / all;
    let curvature_per_mm = if squares > 0.0 { parted / squares } else { 0.0 };
    (libm::sqrt(least / SPREAD), curvature_per_mm)
}
