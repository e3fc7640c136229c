//! Light of LEDs on the surface: which effects a press needs, and where.

use crate::base::grid::{Grid, Rect};
use crate::base::view::SURFACE_BORDER;
use crate::base::view::View;
use crate::effects::{Effect, EffectLog, Requirement};
use crate::gelpad::Contact;

use super::Illumination;
use super::background::BackgroundImage;
use super::coarse::CoarseGrid;
use super::led::{PlacedLed, RowPositions};
use super::phong::{Equation, Phong, Shadows};
use super::residual::{self, LightResidual, Planes};
use super::shadow::casting::ShadowCasting;
use super::threshold::{self, PadExtent, Threshold};
use crate::base::light::{LazyLight, Light};
use shading::ShadedSurface;

mod shading;

/// LEDs prepared for one sensor: everything that is the same in every sample.
pub struct LedShader {
    pub(super) phong: Phong,
    pub(super) leds: Vec<PlacedLed>,
    /// Light of each LED on a flat pad, to be subtracted; empty if nothing is.
    flat_reflection: Vec<RestReflection>,
    relief: Option<PadRelief>,
    threshold: Threshold,
    /// Fraction of the light that is lost per mm of displacement.
    darkening_per_mm: f32,
    /// Light of the background that is not the LEDs'; theirs is scaled by what is left. `None`: it is not scaled.
    pub(super) stray_light: Option<[f32; 3]>,
    /// Light that the LEDs leave unexplained.
    pub(super) residual: Option<residual::PreparedResidual>,
    pub(super) view: View,
    /// Places of the view's columns, mm from its middle.
    pub(super) columns_mm: Vec<f32>,
}

/// A pad that is not smooth and flat at rest.
struct PadRelief {
    /// Height, mm towards the camera, on the grid of [`Contact::surface`].
    shape: Grid<f32>,
    /// Light of each LED on the relief at rest, to be subtracted; empty if nothing is.
    at_rest: Vec<RestReflection>,
    /// Light of the residual on the relief at rest, to be subtracted.
    residual_at_rest: Option<Planes>,
}

impl PadRelief {
    /// Returns the relief on the displaced pad.
    fn displaced_by(&self, surface: &Grid<f32>) -> Grid<f32> {
        let data = surface.data.iter().zip(&self.shape.data).map(|(w, relief)| w + relief).collect();
        Grid { width: surface.width, height: surface.height, data }
    }
}

/// Light of an LED on the untouched pad.
#[derive(Clone)]
pub(super) enum RestReflection {
    /// The same at every pixel.
    Uniform(f32),
    /// At each pixel of the view.
    Map(Grid<f32>),
}

impl LedShader {
    /// Prepares the LEDs of a sensor whose pad has `relief` at rest; `near` if their distances count.
    pub fn new(phong: Phong, near: bool, light: &Illumination, view: &View, relief: Option<Grid<f32>>) -> Self {
        let mut leds: Vec<PlacedLed> = light.leds.iter().map(|led| PlacedLed::new(led, near)).collect();
        let pad = PadExtent::new(light.field_of_view_mm, relief.as_ref());
        threshold::ignore_height_of_far_leds(&mut leds, &phong, pad, light.thickness_mm);
        let mut shader = Self {
            threshold: Threshold::new(&phong, &leds, pad, relief.is_some(), light),
            phong,
            leds,
            flat_reflection: Vec::new(),
            relief: None,
            darkening_per_mm: light.darkening_per_mm(&phong) as f32,
            residual: light.residual.map(LightResidual::prepare),
            stray_light: light.stray_light.map(|stray| stray.map(|share| share as f32)),
            view: *view,
            columns_mm: (0..view.resolution_px[0]).map(|x| view.point_mm([x as f64 + 0.5, 0.0])[0] as f32).collect(),
        };
        let relative = phong.equation == Equation::Relative;
        if relative {
            // By the same instructions as in the picture, so that an untouched pixel loses exactly what it gains.
            shader.flat_reflection = shading::compute_rest_reflection(&shader, &shader.flat_surface(), true);
        }
        shader.relief = relief.map(|shape| PadRelief {
            // A photograph shows the relief already; to a rendered picture it is added.
            at_rest: match relative && light.is_photograph {
                true => shading::compute_rest_reflection(&shader, &shape, false),
                false => shader.flat_reflection.clone(),
            },
            residual_at_rest: match relative && light.is_photograph {
                true => shading::compute_rest_residual(&shader, &shape),
                false => None,
            },
            shape,
        });
        shader
    }

    /// Returns the surface of a flat pad.
    fn flat_surface(&self) -> Grid<f32> {
        let [width, height] = self.view.resolution_px.map(|size| size + 2 * SURFACE_BORDER);
        Grid::new(width, height)
    }

    /// Returns where the pixels of a row are; `heights_mm` are those of the surface there.
    #[inline(always)]
    pub(super) fn row_positions<'a>(&'a self, part: Rect, row: usize, heights_mm: &'a [f32]) -> RowPositions<'a> {
        RowPositions { x_mm: &self.columns_mm[part.x0..part.x1], y_mm: self.row_y_mm(part.y0 + row), heights_mm }
    }

    /// Returns where a row of the view is, mm from its middle.
    #[inline(always)]
    pub(super) fn row_y_mm(&self, y: usize) -> f32 {
        let View { resolution_px: [_, height], mm_per_px: [_, pixel_mm] } = self.view;
        ((y as f64 + 0.5 - height as f64 / 2.0) * pixel_mm) as f32
    }

    /// Computes the light of the untouched pad.
    ///
    /// It is the picture of the pad; a rendered picture also gets what the relief of the pad changes in it. Where the
    /// equation does not subtract Phong's light of a flat pad, that is added.
    pub fn untouched_light(&self, rest: &BackgroundImage) -> Light {
        let flat = self.flat_surface();
        let (shape, at_rest) = match &self.relief {
            Some(relief) => (&relief.shape, &relief.at_rest),
            None => (&flat, &self.flat_reflection),
        };
        let residual_at_rest = self.relief.as_ref().and_then(|relief| relief.residual_at_rest.as_ref());
        let lit = ShadedSurface {
            shape,
            displacement: &flat,
            at_rest,
            residual_at_rest,
            subpixel: None,
            relief: None,
            visible_shares: &[],
            darkening_per_mm: 0.0,
        };
        shading::shade_region(self, &lit, rest, Rect::whole(rest.width, rest.height))
    }

    /// Computes the light from the pad where it differs from that of the untouched pad, whose picture is `rest`.
    pub fn shade<'a>(
        &'a self,
        contact: &'a Contact,
        rest: &'a BackgroundImage,
        effects: &mut EffectLog,
    ) -> LazyLight<'a> {
        let (surface, everywhere) = (&contact.surface, effects.runs_everywhere());
        let bent = effects.run_timed(Effect::Shading, || self.threshold.visible_region(contact, &self.view));
        // Samples within a pixel see bends beside it.
        let bent = contact.subpixel.as_ref().map_or(bent, |subpixel| bent.union(subpixel.region));
        let if_bent =
            |why| if bent.is_empty() { Requirement::Unneeded("the surface is flat") } else { Requirement::Needed(why) };
        let shades = effects.enable(Effect::Shading, if_bent("the surface is not flat"));

        let need = match self.relief {
            None => Requirement::Absent("the pad is smooth and flat"),
            Some(_) => if_bent("a rough or curved pad is deformed"),
        };
        let displaced = |relief: &PadRelief| relief.displaced_by(surface);
        let rough = effects.run(Effect::Grain, need, || self.relief.as_ref().map(displaced)).flatten();
        let relief = self.relief.as_ref().filter(|_| rough.is_some());
        let at_rest = relief.map_or(&self.flat_reflection, |relief| &relief.at_rest);
        let residual_at_rest = relief.and_then(|relief| relief.residual_at_rest.as_ref());

        let shadows = effects.run_timed(Effect::Shadows, || self.find_shadows(surface, bent, everywhere));
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
        let (region, visible) = effects.run_timed(Effect::Shadows, || {
            let region = match &shadows {
                _ if everywhere => whole,
                None => bent,
                Some(shadows) => shadows.shadowed_region(bent, &self.view),
            };
            let visible = shadows.map(|shadows| shadows.compute_visible_shares(&self.view, region));
            (region, visible.unwrap_or_default())
        });
        let light = move |part: Rect| {
            let lit = ShadedSurface {
                shape: rough.as_ref().unwrap_or(surface),
                displacement: surface,
                at_rest,
                residual_at_rest,
                subpixel: contact.subpixel.as_ref(),
                relief: relief.map(|relief| &relief.shape),
                visible_shares: &visible,
                darkening_per_mm,
            };
            shading::shade_region(self, &lit, rest, part)
        };
        LazyLight::Pending(region, Box::new(light))
    }

    /// Finds what casts shadows; `None` if nothing does.
    ///
    /// A near LED is taken to shine on all of the press from one direction: the one in which it is seen from above the
    /// middle of the press, at the height of its highest point. What is raised casts shadows.
    fn find_shadows(&self, surface: &Grid<f32>, bent: Rect, everywhere: bool) -> Option<ShadowCasting> {
        let Shadows::Soft(soft) = self.phong.shadows else { return None };
        if bent.is_empty() && !everywhere {
            return None;
        }
        let middle = self.view.point_mm([0.5 * (bent.x0 + bent.x1) as f64, 0.5 * (bent.y0 + bent.y1) as f64]);
        let at_rest_mm = self.relief.as_ref().map_or(0.0, |relief| {
            let [x, y] = [bent.x0 + bent.x1, bent.y0 + bent.y1].map(|ends| ends / 2 + SURFACE_BORDER);
            relief.shape.at(x, y)
        });
        let lights = |pixel_mm: [f64; 2], highest_mm: f32| {
            self.leds.iter().map(|led| led.shadow_caster(middle, at_rest_mm + highest_mm, pixel_mm)).collect()
        };
        ShadowCasting::new(CoarseGrid::new(soft.resolution), surface, &self.view, everywhere, lights)
    }
}
