//! Light of LEDs on the surface: which effects a press calls for, and where.

use crate::base::grid::{Grid, Rect};
use crate::base::view::SURFACE_BORDER;
use crate::base::view::View;
use crate::effects::{Effect, EffectLog, Requirement};
use crate::gelpad::Contact;

use super::Illumination;
use super::background::BackgroundImage;
use super::coarse::Coarse;
use super::led::{PlacedLed, Row};
use super::phong::{Equation, Phong, Shadows};
use super::residual::{self, LightResidual, Planes};
use super::shadow::casting::Casting;
use super::visible::{self, Extent, Threshold};
use crate::base::light::{LazyLight, Light};
use shading::Lit;

mod shading;

/// LEDs made ready for one sensor: everything that is the same for every sample.
pub struct Shader {
    pub(super) phong: Phong,
    pub(super) lamps: Vec<PlacedLed>,
    /// What each LED gives at a flat pad, to be taken off; empty if nothing is.
    flat: Vec<Flat>,
    relief: Option<Relief>,
    threshold: Threshold,
    /// Share of the light lost per mm of displacement.
    darkening_per_mm: f32,
    /// Light of the background that is not the LEDs', if theirs is scaled by what is left.
    pub(super) stray_light: Option<[f32; 3]>,
    /// Light that the LEDs leave unexplained.
    pub(super) residual: Option<residual::Ready>,
    pub(super) view: View,
    /// Where the view's columns are, mm from its middle.
    pub(super) columns_mm: Vec<f32>,
}

/// A pad that is not smooth and flat at rest.
struct Relief {
    /// mm towards the camera, on the grid of [`Contact::surface`].
    shape: Grid<f32>,
    /// What each LED gives there, to be taken off; empty if nothing is.
    at_rest: Vec<Flat>,
    /// What the residual gives there, to be taken off.
    residual_at_rest: Option<Planes>,
}

impl Relief {
    /// Its shape when the pad is displaced.
    fn under(&self, surface: &Grid<f32>) -> Grid<f32> {
        let data = surface.data.iter().zip(&self.shape.data).map(|(w, relief)| w + relief).collect();
        Grid { width: surface.width, height: surface.height, data }
    }
}

/// What an LED gives at the untouched pad.
#[derive(Clone)]
pub(super) enum Flat {
    /// The same at every pixel.
    Even(f32),
    /// At each pixel of the view.
    Map(Grid<f32>),
}

impl Shader {
    /// Prepares the LEDs of a sensor whose pad has `relief` at rest; `near` if their distances count.
    pub fn new(phong: Phong, near: bool, light: &Illumination, view: &View, relief: Option<Grid<f32>>) -> Self {
        let mut lamps: Vec<PlacedLed> = light.leds.iter().map(|led| PlacedLed::new(led, near)).collect();
        let pad = Extent::new(light.field_of_view_mm, relief.as_ref());
        visible::set_apart(&mut lamps, &phong, pad, light.thickness_mm);
        let mut shader = Self {
            threshold: Threshold::new(&phong, &lamps, pad, relief.is_some(), light),
            phong,
            lamps,
            flat: Vec::new(),
            relief: None,
            darkening_per_mm: light.darkening_per_mm(&phong) as f32,
            residual: light.residual.map(LightResidual::ready),
            stray_light: light.stray_light.map(|stray| stray.map(|share| share as f32)),
            view: *view,
            columns_mm: (0..view.resolution_px[0]).map(|x| view.point_mm([x as f64 + 0.5, 0.0])[0] as f32).collect(),
        };
        let relative = phong.equation == Equation::Relative;
        if relative {
            // By the same instructions as in the picture, so that an untouched pixel loses exactly what it gains.
            shader.flat = shading::at_rest(&shader, &shader.level(), true);
        }
        shader.relief = relief.map(|shape| Relief {
            // A photograph shows the relief already; to a rendered picture it is added.
            at_rest: match relative && light.photograph {
                true => shading::at_rest(&shader, &shape, false),
                false => shader.flat.clone(),
            },
            residual_at_rest: match relative && light.photograph {
                true => shading::residual_at_rest(&shader, &shape),
                false => None,
            },
            shape,
        });
        shader
    }

    /// A flat pad.
    fn level(&self) -> Grid<f32> {
        let [width, height] = self.view.resolution_px.map(|size| size + 2 * SURFACE_BORDER);
        Grid::new(width, height)
    }

    /// Where the pixels of a row are, whose surface is at these heights.
    #[inline(always)]
    pub(super) fn row<'a>(&'a self, part: Rect, row: usize, heights_mm: &'a [f32]) -> Row<'a> {
        Row { x_mm: &self.columns_mm[part.x0..part.x1], y_mm: self.row_mm(part.y0 + row), heights_mm }
    }

    /// Where a row of the view is, mm from its middle.
    #[inline(always)]
    pub(super) fn row_mm(&self, y: usize) -> f32 {
        let View { resolution_px: [_, height], mm_per_px: [_, pitch] } = self.view;
        ((y as f64 + 0.5 - height as f64 / 2.0) * pitch) as f32
    }

    /// The light of the untouched pad: its photograph; or a rendered picture and what the pad's relief changes in it; and
    /// Phong's of a flat pad where the equation does not take that off.
    pub fn untouched(&self, rest: &BackgroundImage) -> Light {
        let level = self.level();
        let (shape, at_rest) = match &self.relief {
            Some(relief) => (&relief.shape, &relief.at_rest),
            None => (&level, &self.flat),
        };
        let residual_at_rest = self.relief.as_ref().and_then(|relief| relief.residual_at_rest.as_ref());
        let lit = Lit {
            shape,
            displacement: &level,
            at_rest,
            residual_at_rest,
            subpixel: None,
            relief: None,
            visible: &[],
            darkening_per_mm: 0.0,
        };
        shading::shade(self, &lit, rest, Rect::whole(rest.width, rest.height))
    }

    /// The light from the pad where it differs from that of the untouched one, whose picture is `rest`.
    pub fn shade<'a>(
        &'a self,
        contact: &'a Contact,
        rest: &'a BackgroundImage,
        effects: &mut EffectLog,
    ) -> LazyLight<'a> {
        let (surface, everywhere) = (&contact.surface, effects.everywhere());
        let bent = effects.timed(Effect::Shading, || self.threshold.region(contact, &self.view));
        // Samples see bends beside their pixel.
        let bent = contact.subpixel.as_ref().map_or(bent, |subpixel| bent.united(subpixel.region));
        let if_bent =
            |why| if bent.is_empty() { Requirement::Unneeded("the surface is flat") } else { Requirement::Needed(why) };
        let shades = effects.enable(Effect::Shading, if_bent("the surface is not flat"));

        let need = match self.relief {
            None => Requirement::Absent("the pad is smooth and flat"),
            Some(_) => if_bent("a rough or curved pad is deformed"),
        };
        let under = |relief: &Relief| relief.under(surface);
        let rough = effects.run(Effect::Grain, need, || self.relief.as_ref().map(under)).flatten();
        let relief = self.relief.as_ref().filter(|_| rough.is_some());
        let at_rest = relief.map_or(&self.flat, |relief| &relief.at_rest);
        let residual_at_rest = relief.and_then(|relief| relief.residual_at_rest.as_ref());

        let shadows = effects.timed(Effect::Shadows, || self.shadows(surface, bent, everywhere));
        let need = match self.phong.shadows {
            Shadows::None => Requirement::Absent("the optics model has no shadows"),
            Shadows::Soft(_) if !bent.is_empty() && shadows.is_none() => {
                Requirement::Unneeded("no slope rises above an LED")
            }
            Shadows::Soft(_) => if_bent("a slope rises above an LED"),
        };
        let shadows = if effects.enable(Effect::Shadows, need) { shadows } else { None };

        let need = match self.darkening_per_mm > 0.0 {
            true => if_bent("the surface is pressed in"),
            false => Requirement::Absent("the optics model has no darkening"),
        };
        let darkening_per_mm = if effects.enable(Effect::Darkening, need) { self.darkening_per_mm } else { 0.0 };
        if !shades {
            return Light::default().into();
        }

        let whole = Rect::whole(rest.width, rest.height);
        let (region, visible) = effects.timed(Effect::Shadows, || {
            let region = match &shadows {
                _ if everywhere => whole,
                None => bent,
                Some(shadows) => shadows.reach(bent, &self.view),
            };
            let visible = shadows.map(|shadows| shadows.shares(&self.view, region));
            (region, visible.unwrap_or_default())
        });
        let light = move |part: Rect| {
            let lit = Lit {
                shape: rough.as_ref().unwrap_or(surface),
                displacement: surface,
                at_rest,
                residual_at_rest,
                subpixel: contact.subpixel.as_ref(),
                relief: relief.map(|relief| &relief.shape),
                visible: &visible,
                darkening_per_mm,
            };
            shading::shade(self, &lit, rest, part)
        };
        LazyLight::Pending(region, Box::new(light))
    }

    /// What casts shadows, if anything does. A near LED is taken to shine on all of the press from the direction in which it
    /// is seen from over the press's middle, as high as the press is: what is raised casts shadows.
    fn shadows(&self, surface: &Grid<f32>, bent: Rect, everywhere: bool) -> Option<Casting> {
        let Shadows::Soft(soft) = self.phong.shadows else { return None };
        if bent.is_empty() && !everywhere {
            return None;
        }
        let middle = self.view.point_mm([0.5 * (bent.x0 + bent.x1) as f64, 0.5 * (bent.y0 + bent.y1) as f64]);
        let at_rest_mm = self.relief.as_ref().map_or(0.0, |relief| {
            let [x, y] = [bent.x0 + bent.x1, bent.y0 + bent.y1].map(|ends| ends / 2 + SURFACE_BORDER);
            relief.shape.at(x, y)
        });
        let lights = |pitch: [f64; 2], highest_mm: f32| {
            self.lamps.iter().map(|lamp| lamp.caster(middle, at_rest_mm + highest_mm, pitch)).collect()
        };
        Casting::new(Coarse::new(soft.resolution), surface, &self.view, everywhere, lights)
    }
}
