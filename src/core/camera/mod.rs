//! From light to image: what the camera makes of the light that the pad sends to it.
//!
//! Lens and vignette are linear, so they act on what the press changed in the light, and the result is added to the
//! picture of the untouched pad. A photograph of that pad already went through its camera's lens and stays as it is; a
//! rendered picture goes through the same lens as everything else. Dots are drawn where the lens shows them. Exposure,
//! white balance and noise act on the sum.

use std::sync::Arc;

use crate::base::gaussian_blur;
use crate::base::grid::{Grid, Rect};
use crate::base::light::{LazyLight, Light};
use crate::base::simd::simd_dispatch;
use crate::base::view::View;
use crate::effects::{Effect, EffectLog, Requirement};

mod dots;
pub mod gel_map;
mod image;
pub mod lens;
pub mod markers;
pub mod noise;
mod params;
pub mod pins;
pub mod projection;
mod vignette;

use dots::Dot;
pub use image::Image;
use markers::MarkerPositions;
pub use params::CameraParams;

/// Rows that are shaded at a time.
const ROWS_PER_BAND: usize = 16;

/// Red, green and blue, row-major.
type Planes = [Vec<f32>; 3];

/// A camera prepared for one sensor: what it sees of the untouched pad.
pub struct Camera {
    view: View,
    /// True if the picture of the untouched pad is a photograph.
    is_photograph: bool,
    /// Parameters with which the image of the untouched pad is taken.
    rest_params: CameraParams,
    /// The dots of a print that is the same in every sample, as the camera sees them on the untouched pad.
    printed_dots: Option<Vec<Dot>>,
    /// Light of the untouched pad, before the lens.
    scene_light: Arc<Planes>,
    /// Light of the untouched pad behind the lens.
    sensor_light: Arc<Planes>,
    /// Light of the untouched pad behind the lens, with the print; `None` if there is no print.
    marked_light: Option<Planes>,
    /// Image of the untouched pad.
    pub untouched: Image,
}

impl Camera {
    /// Prepares a camera over a pad with this light. `is_photograph` says that the light is a picture by that camera.
    pub fn new(
        view: &View,
        light: Light,
        is_photograph: bool,
        rest_params: CameraParams,
        print: Option<MarkerPositions>,
    ) -> Self {
        let [width, height] = view.resolution_px;
        let whole = Rect::whole(width, height);
        let scene_light = Arc::new(light.planes);
        let sensor_light = match is_photograph || rest_params.has_same_optics(&CameraParams::default()) {
            true => Arc::clone(&scene_light),
            false => Arc::new(rest_params.apply_optics(&scene_light, view)),
        };
        let dots = print.as_ref().map(|markers| markers.project_dots(&rest_params, view));
        let marked_light = print.as_ref().zip(dots.as_ref()).map(|(markers, dots)| {
            let mut marked_light = Planes::clone(&sensor_light);
            markers.draw(dots, &rest_params, view, &mut marked_light, whole);
            marked_light
        });
        let mut bright = marked_light.as_ref().unwrap_or(&sensor_light).clone();
        apply_gains(rest_params.gains, &mut bright);
        let mut untouched = Image::black(width, height);
        untouched.quantise(&Light { region: whole, planes: bright });
        untouched.binarise(rest_params.threshold);
        Self {
            view: *view,
            is_photograph,
            rest_params,
            printed_dots: dots,
            scene_light,
            sensor_light,
            marked_light,
            untouched,
        }
    }

    /// Takes the image of a pad whose light differs from the untouched pad's in `light`. The object touches the pad
    /// where `touched` is not 0; without that mask, nowhere.
    pub fn expose(
        &self,
        light: LazyLight<'_>,
        touched: Option<&Grid<u8>>,
        markers: Option<&MarkerPositions>,
        camera: &CameraParams,
        effects: &mut EffectLog,
    ) -> Image {
        let light = self.apply_optics(light, camera, effects);
        let mut light = self.print_markers(light, markers, camera, effects);
        let (noise, speckle) = (camera.noise(), camera.speckle());

        let jitters = camera.gains != self.rest_params.gains;
        // In chunks without a branch for each pixel: most presses touch little of the view.
        let any = |mask: &Grid<u8>| mask.data.chunks(64).any(|some| some.iter().fold(0, |any, value| any | value) != 0);
        let touched = touched.filter(|mask| any(mask));
        let need = match speckle {
            None => Requirement::Absent("the pad has none"),
            Some(_) if touched.is_none() => Requirement::Unneeded("nothing touches the pad"),
            Some(_) => Requirement::Needed("the pad is touched"),
        };
        let speckle = if effects.enable(Effect::Speckle, need) { speckle } else { None };
        if jitters || noise.is_some() || speckle.is_some() {
            // What differs from sample to sample differs on every pixel.
            light = self
                .expand_to_view(resolve_light(light, effects), self.marked_light.as_ref().unwrap_or(&self.sensor_light))
                .into();
        }
        let need = match (jitters, camera.gains == [1.0; 3]) {
            (false, true) => Requirement::Unneeded("all gains are 1"),
            (false, false) if light.region().is_empty() => Requirement::Unneeded("the press changed no light"),
            _ => Requirement::Needed("not all gains are 1"),
        };
        let width = self.view.resolution_px[0];
        if let Some((speckle, touched)) = speckle.zip(touched) {
            light = apply_effect(light, Effect::Speckle, effects, |planes| match camera.lens(&self.view) {
                Some(lens) => speckle.add_to_planes(width, planes, Some(&lens.warp_mask(touched).data)),
                None => speckle.add_to_planes(width, planes, Some(&touched.data)),
            });
        }
        if effects.enable(Effect::Exposure, need) {
            light = apply_effect(light, Effect::Exposure, effects, |planes| apply_gains(camera.gains, planes));
        }
        let need = match noise {
            Some(_) => Requirement::Needed("every pixel is noisy"),
            None => Requirement::Absent("the camera has none"),
        };
        if effects.enable(Effect::Noise, need)
            && let Some(noise) = noise
        {
            light = apply_effect(light, Effect::Noise, effects, |planes| noise.add_to_planes(width, planes, None));
        }

        let mut image = self.untouched.clone();
        if image.clipped_px > 0 {
            image.clipped_px -= self.count_clipped_pixels(light.region());
        }
        match light {
            LazyLight::Known(light) => image.quantise(&light),
            // No effect is left that needs the light of other pixels: a band of rows becomes bytes before the next one
            // is shaded.
            LazyLight::Pending(region, shade) => {
                for y0 in (region.y0..region.y1).step_by(ROWS_PER_BAND) {
                    let rows = Rect { y0, y1: (y0 + ROWS_PER_BAND).min(region.y1), ..region };
                    let light = effects.run_timed(Effect::Shading, || shade(rows));
                    image.quantise(&light);
                }
            }
        }
        image.binarise(camera.threshold);
        image
    }

    /// Counts the pixels of a part that are clipped in the picture of the untouched pad.
    fn count_clipped_pixels(&self, part: Rect) -> u64 {
        let (width, planes) = (self.view.resolution_px[0], self.marked_light.as_ref().unwrap_or(&self.sensor_light));
        let gains = self.rest_params.gains.map(|gain| gain as f32);
        let is_cut = |at: &usize| {
            let [red, green, blue] = [0, 1, 2].map(|channel| planes[channel][*at] * gains[channel]);
            red.min(green).min(blue) < 0.0 || red.max(green).max(blue) > 1.0
        };
        let places = (part.y0..part.y1).flat_map(|y| (y * width + part.x0)..(y * width + part.x1));
        places.filter(is_cut).count() as u64
    }

    /// Applies lens and vignette to the light.
    fn apply_optics<'a>(&self, light: LazyLight<'a>, camera: &CameraParams, effects: &mut EffectLog) -> LazyLight<'a> {
        // A photograph already went through its own lens; only a rendered picture shows the lens of this press.
        let own_optics = !self.is_photograph && !camera.has_same_optics(&self.rest_params);
        let unchanged = light.region().is_empty() && !own_optics;
        let need = |has_any| match has_any {
            false => Requirement::Absent("the camera has none"),
            true if unchanged => Requirement::Unneeded("the press changed no light"),
            true => Requirement::Needed("the light changed"),
        };
        let blurs = effects.enable(Effect::Defocus, need(camera.defocus_mm > 0.0));
        let distorts = effects.enable(Effect::Distortion, need(camera.distortion != [0.0; 2]));
        let darkens = effects.enable(Effect::Vignette, need(camera.vignette > 0.0));
        if !(blurs || distorts || darkens) {
            return light;
        }

        // Only what the press changed goes through the lens.
        let [width, height] = self.view.resolution_px;
        let mut change = resolve_light(light, effects);
        self.add_scaled(&mut change, &self.scene_light, -1.0);
        if blurs {
            change = effects.run_timed(Effect::Defocus, || {
                let Light { region: source, planes } = self.expand_near_border(change, [0.0; 2]);
                let sigma_px = camera.blur_sigma_px(&self.view);
                if source == self.view_rect() {
                    return Light {
                        region: source,
                        planes: gaussian_blur::blur_whole(&planes, width, height, sigma_px),
                    };
                }
                let target = source.grown(gaussian_blur::reach_px(sigma_px), width, height);
                Light { region: target, planes: gaussian_blur::blur_region(&planes, source, target, sigma_px) }
            });
        }
        if let Some(lens) = camera.lens(&self.view) {
            change = effects.run_timed(Effect::Distortion, || {
                let Light { region: source, planes } = self.expand_near_border(change, lens.mirrored_border_px());
                if source == self.view_rect() {
                    return Light { region: source, planes: lens.warp_whole(&planes) };
                }
                let target = lens.image_rect_of(source);
                Light { region: target, planes: lens.warp_region(&planes, source, target) }
            });
        }
        if darkens {
            effects.run_timed(Effect::Vignette, || {
                vignette::darken_corners(&mut change.planes, change.region, &self.view, camera.vignette);
            });
        }
        if own_optics {
            change = self.expand_to_view(change, &self.dark_planes());
            self.add_scaled(&mut change, &camera.apply_optics(&self.scene_light, &self.view), 1.0);
        } else {
            self.add_scaled(&mut change, &self.sensor_light, 1.0);
        }
        change.into()
    }

    /// Prints the dots where the camera sees them, onto the light that the press changed.
    fn print_markers<'a>(
        &self,
        light: LazyLight<'a>,
        markers: Option<&MarkerPositions>,
        camera: &CameraParams,
        effects: &mut EffectLog,
    ) -> LazyLight<'a> {
        let dots =
            markers.map(|markers| effects.run_timed(Effect::Markers, || markers.project_dots(camera, &self.view)));
        // Defocus softens dots even over a photograph.
        let as_printed = dots == self.printed_dots && camera.defocus_mm == self.rest_params.defocus_mm;
        let need = match markers {
            None => Requirement::Absent("the pad has none"),
            Some(_) if !as_printed => Requirement::Needed("they look otherwise than on the untouched pad"),
            Some(_) if light.region().is_empty() => Requirement::Unneeded("nothing moves them"),
            Some(_) => Requirement::Needed("the light around them changed"),
        };
        let runs = effects.enable(Effect::Markers, need);
        let Some((markers, dots)) = markers.zip(dots).filter(|_| runs) else { return light };
        let light = resolve_light(light, effects);
        effects.run_timed(Effect::Markers, || {
            let mut light = if as_printed { light } else { self.expand_to_view(light, &self.sensor_light) };
            markers.draw(&dots, camera, &self.view, &mut light.planes, light.region);
            light.into()
        })
    }

    fn view_rect(&self) -> Rect {
        let [width, height] = self.view.resolution_px;
        Rect::whole(width, height)
    }

    /// Expands a change to the entire picture if it comes as close to the border as `within_px` along x and y: it then
    /// goes on outside the border. Others stay as they are.
    fn expand_near_border(&self, change: Light, within_px: [f64; 2]) -> Light {
        let Rect { x0, y0, x1, y1 } = change.region;
        let [width, height] = self.view.resolution_px;
        let nearest_px = [x0.min(width - x1), y0.min(height - y1)].map(|px| px as f64);
        let near = nearest_px.iter().zip(within_px).any(|(nearest, within)| *nearest <= within);
        if near && !change.region.is_empty() { self.expand_to_view(change, &self.dark_planes()) } else { change }
    }

    fn dark_planes(&self) -> Planes {
        [(); 3].map(|()| vec![0.0; self.view_rect().area()])
    }

    /// Expands light to the entire picture: `light` in its region, `around` elsewhere.
    fn expand_to_view(&self, light: Light, around: &Planes) -> Light {
        let (whole, part) = (self.view_rect(), light.region);
        if part == whole {
            return light;
        }
        let mut planes = around.clone();
        for (plane, known) in planes.iter_mut().zip(&light.planes) {
            for row in 0..part.height() {
                let at = (part.y0 + row) * whole.width() + part.x0;
                plane[at..at + part.width()].copy_from_slice(&known[row * part.width()..][..part.width()]);
            }
        }
        Light { region: whole, planes }
    }

    /// Adds `sign` times an entire picture to the light.
    fn add_scaled(&self, light: &mut Light, picture: &Planes, sign: f32) {
        let part = light.region;
        simd_dispatch(
            #[inline(always)]
            || {
                for (plane, picture) in light.planes.iter_mut().zip(picture) {
                    for row in 0..part.height() {
                        let at = (part.y0 + row) * self.view.resolution_px[0] + part.x0;
                        let values = &mut plane[row * part.width()..][..part.width()];
                        for (value, other) in values.iter_mut().zip(&picture[at..]) {
                            *value += sign * other;
                        }
                    }
                }
            },
        );
    }
}

/// Computes all of the light, for an effect that needs more than each pixel's own.
fn resolve_light(light: LazyLight<'_>, effects: &mut EffectLog) -> Light {
    match light {
        LazyLight::Known(light) => light,
        pending => effects.run_timed(Effect::Shading, || pending.into_light()),
    }
}

/// Does work on all of the light, and counts its time as `effect`'s.
fn apply_effect<'a>(
    light: LazyLight<'a>,
    effect: Effect,
    effects: &mut EffectLog,
    work: impl FnOnce(&mut Planes),
) -> LazyLight<'a> {
    let mut light = resolve_light(light, effects);
    effects.run_timed(effect, || work(&mut light.planes));
    light.into()
}

/// Multiplies each channel by its gain.
fn apply_gains(gains: [f64; 3], planes: &mut Planes) {
    simd_dispatch(
        #[inline(always)]
        || {
            for (plane, gain) in planes.iter_mut().zip(gains) {
                plane.iter_mut().for_each(|value| *value *= gain as f32);
            }
        },
    );
}
