//! What the camera inside a gel that is not flat sees: its pins, or the light on its skin.

use std::sync::Arc;

use glam::DVec3;

use super::Curved;
use super::lit::CastShadows;
use crate::base::chart::Chart;
use crate::base::gel::{GelShape, Site};
use crate::base::grid::Grid;
use crate::base::light::Light;
use crate::base::rng;
use crate::base::view::View;
use crate::camera::gel_map::{GelMap, GelView};
use crate::camera::pins::{Along, PinPositions, Pins, SkinMotion, Tip};
use crate::camera::projection::Projection;
use crate::effects::{Effect, EffectLog, Requirement};
use crate::gelpad::Contact;
use crate::gelpad::sliding::Wrench;
use crate::optics::Illumination;
use crate::optics::background::{BackgroundImage, RenderedBackground};
use crate::optics::phong::Phong;
use crate::optics::skin::{self, AlongGel, Skin, SkinPoint};

/// What the camera sees.
pub(super) enum Seen {
    Pins(Box<PinPicture>),
    Skin(Box<Skin>, Arc<BackgroundImage>),
}

pub(super) struct PinPicture {
    pins: Pins,
    /// Where they stand on the untouched gel, and their tips.
    sites: Vec<Site>,
    resting: Vec<Tip>,
    /// What the mount's ring covers of the image.
    ring: Grid<f32>,
    dark: [f64; 3],
}

/// What decides what the camera sees of a gel.
pub enum Look<'a> {
    /// These pins, over a picture of this colour.
    Pins(Pins, [f64; 3]),
    /// The light on its skin.
    Skin(SkinLight<'a>),
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
    Photograph(Arc<BackgroundImage>),
}

impl Seen {
    /// What the image's pixels show of a gel.
    pub fn new(look: Look<'_>, shape: &GelShape, camera: &Projection, view: &View, gel: &GelView) -> Self {
        let look = match look {
            Look::Pins(pins, dark) => {
                let (resting, ring) = (pins.at_rest(shape, camera), pins.ring(camera, view.resolution_px));
                return Self::Pins(Box::new(PinPicture { sites: pins.sites(shape), pins, resting, ring, dark }));
            }
            Look::Skin(look) => look,
        };
        let point =
            |site: &Option<Site>| site.map(|site| SkinPoint { site, to_camera: camera.towards_camera(site.point_mm) });
        let points: Vec<_> = gel.sites().iter().map(point).collect();
        let along_gel = AlongGel::new(look.light.leds, shape);
        let picture = match look.background {
            SkinPicture::Rendered(look_of, noise) => {
                Arc::new(skin::rendered(look_of, noise, look.light.leds, &along_gel, &points, &look.in_image))
            }
            SkinPicture::Photograph(photograph) => photograph,
        };
        let skin = Skin::new(look.phong, &look.light, along_gel, &points, view.resolution_px[0]);
        Self::Skin(Box::new(skin), picture)
    }
}

impl Curved {
    /// The light of the untouched gel.
    pub fn untouched(&self) -> Light {
        match &self.seen {
            Seen::Pins(seen) => seen.pins.light(&seen.resting, &[], &self.camera, seen.dark, &seen.ring),
            Seen::Skin(skin, picture) => skin.untouched(picture, self.gel.inwards()),
        }
    }

    /// The shadows of a press on its chart, if the camera sees light on a skin and any falls.
    pub(super) fn shadows(&self, contact: &Contact, chart: &Chart, effects: &mut EffectLog) -> Option<CastShadows> {
        match &self.seen {
            Seen::Skin(skin, _) => self.cast_shadows(skin, contact, chart, effects),
            Seen::Pins(_) => None,
        }
    }

    /// What the camera sees of a pressed gel: its light, with shadows on the chart, and where the pins are, if it has any.
    pub(super) fn looked_at(
        &self,
        (contact, chart, map): (&Contact, &Chart, &GelMap),
        shadows: Option<&CastShadows>,
        wrench: Option<&Wrench>,
        unit_key: u64,
        effects: &mut EffectLog,
    ) -> (Option<PinPositions>, Light) {
        let picture = match &self.seen {
            Seen::Skin(skin, picture) => {
                return (None, self.lit(skin, picture, (contact, map, shadows), effects));
            }
            Seen::Pins(picture) => picture,
        };
        for effect in [Effect::Shading, Effect::Supersampling, Effect::Shadows, Effect::Darkening] {
            effects.enable(effect, Requirement::Absent("the camera sees pins, not the skin's relief"));
        }
        effects.timed(Effect::Markers, || {
            let pins = self.moved(picture, contact, chart, wrench);
            let mut random = rng::stream(unit_key, "pins", 0);
            let (tips, sizes) = picture.pins.jittered(&pins.moved, &self.camera, &mut random);
            let light = picture.pins.light(&tips, &sizes, &self.camera, picture.dark, &picture.ring);
            (Some(pins), light)
        })
    }

    /// Where the pins are.
    fn moved(&self, seen: &PinPicture, contact: &Contact, chart: &Chart, wrench: Option<&Wrench>) -> PinPositions {
        let PinPicture { pins, sites, resting, .. } = seen;
        let direction = match (pins.along, wrench) {
            (Along::Press, Some(wrench)) => DVec3::from_array(wrench.force_n).try_normalize().map(|into| -into),
            _ => None,
        };
        let moved = if contact.region.is_empty() {
            resting.clone()
        } else {
            let motion = SkinMotion::new(contact, chart, &self.view, direction, pins);
            pins.moved(sites, &motion, &self.camera)
        };
        PinPositions { rest: resting.clone(), moved }
    }

    /// Share of the contact that the image shows, 0 without contact. A dome's chart ends where the image does.
    pub(super) fn share_in_view(&self, contact: &Contact, chart: &Chart) -> f64 {
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
}
