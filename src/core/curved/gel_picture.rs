//! What the camera inside a curved gel sees: the gel's pins, or the light on its skin.

use std::sync::Arc;

use glam::DVec3;

use super::CurvedGel;
use super::skin_shading::CastShadows;
use crate::base::chart::Chart;
use crate::base::gel::{GelShape, Site};
use crate::base::grid::Grid;
use crate::base::light::Light;
use crate::base::rng;
use crate::base::view::View;
use crate::camera::gel_map::{GelMap, GelView};
use crate::camera::pins::{Along, PinPositions, PinTip, Pins, SkinMotion};
use crate::camera::projection::Projection;
use crate::effects::{Effect, EffectLog, Requirement};
use crate::gelpad::Contact;
use crate::gelpad::sliding::Wrench;
use crate::optics::Illumination;
use crate::optics::background::{BackgroundImage, RenderedBackground};
use crate::optics::phong::Phong;
use crate::optics::skin::{self, RimLight, SkinPoint, SkinShader};

/// The kind of image that the camera sees, with everything that is computed once.
pub(super) enum GelPicture {
    Pins(Box<PinPicture>),
    Skin(Box<SkinShader>, Arc<BackgroundImage>),
}

pub(super) struct PinPicture {
    pins: Pins,
    /// Positions of the pins on the untouched gel; `resting` are their tips.
    sites: Vec<Site>,
    resting: Vec<PinTip>,
    /// Share of each pixel that the mount's ring covers.
    ring: Grid<f32>,
    dark: [f64; 3],
}

/// What the camera sees of a gel.
pub enum GelAppearance<'a> {
    /// Pins, in front of a background of this colour.
    Pins(Pins, [f64; 3]),
    /// The light on the gel's skin.
    Skin(SkinLight<'a>),
}

/// How the skin is lit, and how it reflects.
pub struct SkinLight<'a> {
    /// Reflection of the skin.
    pub phong: Phong,
    /// The LEDs.
    pub light: Illumination<'a>,
    /// Image of the untouched skin.
    pub background: SkinPicture<'a>,
    /// The image as a view whose pixels have the size they have at the gel's tip.
    pub in_image: View,
}

/// Source of [`SkinLight::background`].
pub enum SkinPicture<'a> {
    /// Rendered, with the noise of the coating's grain.
    Rendered(&'a RenderedBackground, &'a Grid<f32>),
    /// A photograph taken by the camera.
    Photograph(Arc<BackgroundImage>),
}

impl GelPicture {
    /// Prepares what the image's pixels show of a gel.
    pub fn new(look: GelAppearance<'_>, shape: &GelShape, camera: &Projection, view: &View, gel: &GelView) -> Self {
        let look = match look {
            GelAppearance::Pins(pins, dark) => {
                let (resting, ring) =
                    (pins.at_rest(shape, camera), pins.render_ring_coverage(camera, view.resolution_px));
                return Self::Pins(Box::new(PinPicture { sites: pins.gel_sites(shape), pins, resting, ring, dark }));
            }
            GelAppearance::Skin(look) => look,
        };
        let point =
            |site: &Option<Site>| site.map(|site| SkinPoint { site, to_camera: camera.towards_camera(site.point_mm) });
        let points: Vec<_> = gel.pixel_sites().iter().map(point).collect();
        let along_gel = RimLight::new(look.light.leds, shape);
        let picture = match look.background {
            SkinPicture::Rendered(look_of, noise) => {
                Arc::new(skin::render_untouched(look_of, noise, look.light.leds, &along_gel, &points, &look.in_image))
            }
            SkinPicture::Photograph(photograph) => photograph,
        };
        let skin = SkinShader::new(look.phong, &look.light, along_gel, &points, view.resolution_px[0]);
        Self::Skin(Box::new(skin), picture)
    }
}

impl CurvedGel {
    /// Returns true if the gel has pins on a skin that follows friction more smoothly than the gel.
    pub(super) fn has_stiff_skin(&self) -> bool {
        matches!(&self.picture, GelPicture::Pins(seen) if seen.pins.drag_smoothing_mm > 0.0)
    }

    /// Returns the light of the untouched gel.
    pub fn untouched_light(&self) -> Light {
        match &self.picture {
            GelPicture::Pins(seen) => seen.pins.render_light(&seen.resting, &[], &self.camera, seen.dark, &seen.ring),
            GelPicture::Skin(skin, picture) => skin.untouched_light(picture, self.gel.inward_normals()),
        }
    }

    /// Computes the shadows of a press on its chart; `None` if the camera sees pins or no shadow falls.
    pub(super) fn press_shadows(
        &self,
        contact: &Contact,
        chart: &Chart,
        effects: &mut EffectLog,
    ) -> Option<CastShadows> {
        match &self.picture {
            GelPicture::Skin(skin, _) => self.cast_shadows(skin, contact, chart, effects),
            GelPicture::Pins(_) => None,
        }
    }

    /// Renders the light of a pressed gel, with the given shadows on the chart, and returns it with the pins'
    /// positions, if the gel has pins.
    pub(super) fn render_picture(
        &self,
        (contact, chart, map): (&Contact, &Chart, &GelMap),
        shadows: Option<&CastShadows>,
        wrench: Option<&Wrench>,
        unit_key: u64,
        effects: &mut EffectLog,
    ) -> (Option<PinPositions>, Light) {
        let picture = match &self.picture {
            GelPicture::Skin(skin, picture) => {
                return (None, self.shade_skin(skin, picture, (contact, map, shadows), effects));
            }
            GelPicture::Pins(picture) => picture,
        };
        for effect in
            [Effect::Shading, Effect::Supersampling, Effect::Shadows, Effect::Mirror, Effect::Bounce, Effect::Darkening]
        {
            effects.enable(effect, Requirement::Absent("the camera sees pins, not the skin's relief"));
        }
        effects.run_timed(Effect::Markers, || {
            let pins = self.move_pins(picture, contact, chart, wrench);
            let mut random = rng::random_stream(unit_key, "pins", 0);
            let (tips, sizes) = picture.pins.jitter_tips(&pins.moved, &self.camera, &mut random);
            let light = picture.pins.render_light(&tips, &sizes, &self.camera, picture.dark, &picture.ring);
            (Some(pins), light)
        })
    }

    /// Moves the pins with the pressed gel.
    fn move_pins(&self, seen: &PinPicture, contact: &Contact, chart: &Chart, wrench: Option<&Wrench>) -> PinPositions {
        let PinPicture { pins, sites, resting, .. } = seen;
        let direction = match (pins.along, wrench) {
            (Along::Press, Some(wrench)) => DVec3::from_array(wrench.force_n).try_normalize().map(|into| -into),
            _ => None,
        };
        let moved = if contact.region.is_empty() {
            resting.clone()
        } else {
            let lowest_mm = sites.iter().map(|site| site.point_mm.z).fold(f64::INFINITY, f64::min);
            let motion = SkinMotion::new(contact, chart, &self.view, direction, (pins, lowest_mm));
            pins.moved_tips(sites, &motion, &self.camera)
        };
        PinPositions { rest: resting.clone(), moved }
    }

    /// Returns the share of the contact that the image shows, 0 without contact. A dome's chart ends where the image
    /// does.
    pub(super) fn in_view_fraction(&self, contact: &Contact, chart: &Chart) -> f64 {
        let [width, height] = self.view.resolution_px;
        let mask = &contact.mask;
        let touched = (0..height).flat_map(|y| (0..width).map(move |x| [x, y])).filter(|[x, y]| mask.at(*x, *y) > 0);
        let (mut all, mut seen) = (0_u32, 0_u32);
        // A share needs only a sample of the nodes.
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
