//! Light of LEDs on the surface: which effects a press needs, and where.

use crate::base::grid::{Grid, Rect};
use crate::base::view::SURFACE_BORDER;
use crate::base::view::View;
use crate::effects::{Effect, EffectLog, Requirement};
use crate::gelpad::Contact;

use super::Illumination;
use super::background::BackgroundImage;
use super::coarse::{CoarseGrid, CoarseValues};
use super::led::PlacedLed;
use super::light_pattern::LightColor;
use super::near_light::bounce::hidden_sky;
use super::near_light::field::LightField;
use super::near_light::visible::Hidden;
use super::near_light::{NearLights, Needs};
use super::phong::{Equation, Phong, Shadows};
use super::residual::{self, LightResidual, Planes};
use super::shadow::casting::ShadowCasting;
use super::threshold::{LightBound, PadExtent, Threshold};
use crate::base::light::{LazyLight, Light};
use shading::ShadedSurface;

mod shading;

/// LEDs prepared for one sensor: everything that is the same in every sample.
pub struct LedShader {
    pub(super) phong: Phong,
    pub(super) lights: Lights,
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
}

/// The LEDs, prepared.
pub(super) enum Lights {
    /// At infinity.
    Distant(Vec<PlacedLed>),
    /// At their distances.
    Near(Box<NearLights>),
}

impl Lights {
    /// Returns how many there are; halves of a row count one by one.
    pub fn count(&self) -> usize {
        match self {
            Self::Distant(leds) => leds.len(),
            Self::Near(near) => near.leds.len(),
        }
    }

    /// Returns colour times intensity of an LED.
    pub fn color(&self, number: usize) -> &LightColor {
        match self {
            Self::Distant(leds) => &leds[number].color,
            Self::Near(near) => &near.leds[number].color,
        }
    }
}

/// What the light of a press is computed from, besides the surface.
#[derive(Default)]
struct PressLight {
    /// The fraction of each distant LED that is seen; empty where all of it is.
    visible_shares: Vec<Option<CoarseValues>>,
    /// The light of near LEDs.
    field: Option<LightField>,
}

/// A pad that is not smooth and flat at rest.
struct PadRelief {
    /// Its highest point, mm; 0 if all of it is lower.
    highest_mm: f32,
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
        let pad = PadExtent::new(light.field_of_view_mm, relief.as_ref());
        let lights = match near {
            false => Lights::Distant(light.leds.iter().map(PlacedLed::new).collect()),
            true => Lights::Near(Box::new(NearLights::new(&phong, light.leds, light.window, light.coat, view))),
        };
        let bounds = match &lights {
            Lights::Distant(leds) => leds.iter().map(LightBound::of_distant_led).collect(),
            Lights::Near(near) => LightBound::of_near_lights(near, &phong, pad),
        };
        let mut shader = Self {
            threshold: Threshold::new(&phong, &bounds, relief.is_some(), light),
            phong,
            lights,
            flat_reflection: Vec::new(),
            relief: None,
            darkening_per_mm: light.darkening_per_mm(&phong) as f32,
            residual: light.residual.map(LightResidual::prepare),
            stray_light: light.stray_light.map(|stray| stray.map(|share| share as f32)),
            view: *view,
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
            highest_mm: shape.largest(|mm| mm),
            shape,
        });
        shader
    }

    /// Returns the surface of a flat pad.
    fn flat_surface(&self) -> Grid<f32> {
        let [width, height] = self.view.resolution_px.map(|size| size + 2 * SURFACE_BORDER);
        Grid::new(width, height)
    }

    /// Computes the light of near LEDs on a pad at rest; `None` if they are at infinity.
    fn field_at_rest(&self, shape: &Grid<f32>) -> Option<LightField> {
        match &self.lights {
            Lights::Distant(_) => None,
            Lights::Near(near) => Some(near.field_at_rest(shape)),
        }
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
        let field = self.field_at_rest(shape);
        let lit = ShadedSurface {
            shape,
            displacement: &flat,
            at_rest,
            residual_at_rest,
            subpixel: None,
            relief: None,
            visible_shares: &[],
            field: field.as_ref(),
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
        let surface = &contact.surface;
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

        let need = match self.darkening_per_mm > 0.0 {
            true => if_bent("the surface is pressed in"),
            false => Requirement::Absent("the optics model has no darkening"),
        };
        let darkening_per_mm = if effects.enable(Effect::Darkening, need) { self.darkening_per_mm } else { 0.0 };
        let shape = rough.as_ref().unwrap_or(surface);
        let whole = Rect::whole(rest.width, rest.height);
        let (region, press_light) = match &self.lights {
            Lights::Distant(leds) => self.light_of_distant_leds(leds, surface, bent, whole, effects),
            Lights::Near(near) => self.light_of_near_leds(near, (surface, shape), bent, whole, effects),
        };
        if !shades {
            return Light::default().into();
        }
        let light = move |part: Rect| {
            let lit = ShadedSurface {
                shape: rough.as_ref().unwrap_or(surface),
                displacement: surface,
                at_rest,
                residual_at_rest,
                subpixel: contact.subpixel.as_ref(),
                relief: relief.map(|relief| &relief.shape),
                visible_shares: &press_light.visible_shares,
                field: press_light.field.as_ref(),
                darkening_per_mm,
            };
            shading::shade_region(self, &lit, rest, part)
        };
        LazyLight::Pending(region, Box::new(light))
    }

    /// Finds where a press with its bends in `bent` changes the light of LEDs at infinity, and what they shadow.
    fn light_of_distant_leds(
        &self,
        leds: &[PlacedLed],
        surface: &Grid<f32>,
        bent: Rect,
        whole: Rect,
        effects: &mut EffectLog,
    ) -> (Rect, PressLight) {
        let everywhere = effects.runs_everywhere();
        let shadows = effects.run_timed(Effect::Shadows, || self.find_shadows(leds, surface, bent, everywhere));
        let shadows =
            if effects.enable(Effect::Shadows, self.need_of_shadows(bent, shadows.is_some())) { shadows } else { None };
        effects.enable(Effect::Mirror, Requirement::Absent("distant LEDs have no image in a window"));
        effects.enable(Effect::Bounce, Requirement::Absent("the optics model has no bounce"));
        effects.run_timed(Effect::Shadows, || {
            let region = match &shadows {
                _ if everywhere => whole,
                None => bent,
                Some(shadows) => shadows.shadowed_region(bent, &self.view),
            };
            let visible = shadows.map(|shadows| shadows.compute_visible_shares(&self.view, region));
            (region, PressLight { visible_shares: visible.unwrap_or_default(), field: None })
        })
    }

    /// Finds where a press with its bends in `bent` changes the light of near LEDs, and computes that light. Shadows fall
    /// from the displaced `surface`; with the relief of the pad it has the given shape.
    fn light_of_near_leds(
        &self,
        near: &NearLights,
        (surface, shape): (&Grid<f32>, &Grid<f32>),
        bent: Rect,
        whole: Rect,
        effects: &mut EffectLog,
    ) -> (Rect, PressLight) {
        let everywhere = effects.runs_everywhere();
        let if_bent =
            |why| if bent.is_empty() { Requirement::Unneeded("the surface is flat") } else { Requirement::Needed(why) };
        let at_rest_mm = self.relief.as_ref().map_or(0.0, |relief| relief.highest_mm);
        let (coarse, needs) = effects.run_timed(Effect::Shadows, || match bent.is_empty() && !everywhere {
            true => (Grid::new(0, 0), Needs::default()),
            false => {
                let coarse = near.subsample(surface);
                let needs = near.needs(&coarse, at_rest_mm, everywhere);
                (coarse, needs)
            }
        });
        let shadows = effects.enable(Effect::Shadows, self.need_of_shadows(bent, needs.shadows));
        let need = match near.has_mirror() {
            true => if_bent("the window shows the LEDs to a bent surface"),
            false => Requirement::Absent("the sensor has no window"),
        };
        let mirror = effects.enable(Effect::Mirror, need);
        let need = match near.albedo > 0.0 {
            true if !bent.is_empty() && !needs.bounce => {
                Requirement::Unneeded("no slope is steep enough to light another")
            }
            true => if_bent("slopes light each other"),
            false => Requirement::Absent("the coat has no albedo"),
        };
        let bounce = effects.enable(Effect::Bounce, need);
        let needs = Needs { shadows, bounce, ..needs };
        let reached = if everywhere { whole } else { near.changed_region(bent, needs) };
        if reached.is_empty() {
            return (reached, PressLight::default());
        }
        let coarse_shape = effects.run_timed(Effect::Shading, || self.relief.as_ref().map(|_| near.subsample(shape)));
        let coarse_shape = coarse_shape.as_ref().unwrap_or(&coarse);
        let hidden = match shadows || bounce {
            true => {
                let finding = if shadows { Effect::Shadows } else { Effect::Bounce };
                let horizons = effects.run_timed(finding, || near.find_horizons(&coarse, reached, needs));
                let visible =
                    shadows.then(|| effects.run_timed(Effect::Shadows, || near.find_visible(coarse_shape, &horizons)));
                let sky = bounce.then(|| effects.run_timed(Effect::Bounce, || hidden_sky(&horizons)));
                Hidden { part: horizons.part, visible: visible.unwrap_or_default(), sky: sky.unwrap_or_default() }
            }
            false => Hidden::default(),
        };
        let region = if everywhere { whole } else { bent.union(near.hidden_region(&hidden).intersection(reached)) };
        let mut leds = effects.run_timed(Effect::Shading, || near.direct_light(coarse_shape, region, needs, &hidden));
        if mirror {
            effects
                .run_timed(Effect::Mirror, || near.add_mirrored_light(coarse_shape, region, needs, &hidden, &mut leds));
        }
        let bounced = bounce
            .then(|| effects.run_timed(Effect::Bounce, || near.bounced_light(shape, region, needs, &hidden, &leds)));
        let field = near.field(region, needs, leds, bounced);
        (region, PressLight { visible_shares: Vec::new(), field: Some(field) })
    }

    /// Says whether a press with its bends in `bent` needs shadows; `some` if any falls.
    fn need_of_shadows(&self, bent: Rect, some: bool) -> Requirement {
        match self.phong.shadows {
            Shadows::None => Requirement::Absent("the optics model has no shadows"),
            Shadows::Soft(_) if bent.is_empty() => Requirement::Unneeded("the surface is flat"),
            Shadows::Soft(_) if !some => Requirement::Unneeded("no slope rises above an LED"),
            Shadows::Soft(_) => Requirement::Needed("a slope rises above an LED"),
        }
    }

    /// Finds what casts shadows; `None` if nothing does.
    fn find_shadows(
        &self,
        leds: &[PlacedLed],
        surface: &Grid<f32>,
        bent: Rect,
        everywhere: bool,
    ) -> Option<ShadowCasting> {
        let Shadows::Soft(soft) = self.phong.shadows else { return None };
        if bent.is_empty() && !everywhere {
            return None;
        }
        let lights = |pixel_mm: [f64; 2], _| leds.iter().map(|led| led.shadow_caster(pixel_mm)).collect();
        ShadowCasting::new(CoarseGrid::new(soft.resolution), surface, &self.view, everywhere, lights)
    }
}
