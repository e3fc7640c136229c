//! From light to image: what the camera makes of the light that the pad sends to it.
//!
//! Lens and vignette are linear, so they act on what the press changed in the light, and the result is added to the
//! picture of the untouched pad. A photograph of that pad already went through its camera's lens and stays as it is;
//! a rendered one goes through the same lens as everything else. Dots are drawn where the lens shows them; exposure,
//! white balance and noise act on the sum.

use std::sync::Arc;

use crate::base::grid::{Grid, Rect};
use crate::base::light::{LazyLight, Light};
use crate::base::simd::simd_dispatch;
use crate::base::view::View;
use crate::effects::{Effect, EffectLog, Requirement};

pub mod defocus;
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
const ROWS: usize = 16;

/// Red, green and blue, row-major.
type Planes = [Vec<f32>; 3];

/// A camera made ready for one sensor: what it sees of the untouched pad.
pub struct Camera {
    view: View,
    /// The picture of the untouched pad is a photograph.
    photograph: bool,
    resting: CameraParams,
    /// The dots of a pad whose print is the same in every sample, as the resting camera sees them.
    print: Option<Vec<Dot>>,
    /// Light of the untouched pad.
    bare: Arc<Planes>,
    /// The same as the resting camera sees it.
    seen: Arc<Planes>,
    /// The same with the print, if there is any.
    marked: Option<Planes>,
    /// The same as an image.
    pub untouched: Image,
}

impl Camera {
    /// Of a pad with this light; `photograph` if that is a picture taken by the camera itself.
    pub fn new(
        view: &View,
        light: Light,
        photograph: bool,
        resting: CameraParams,
        print: Option<MarkerPositions>,
    ) -> Self {
        let [width, height] = view.resolution_px;
        let whole = Rect::whole(width, height);
        let bare = Arc::new(light.planes);
        let seen = match photograph || resting.same_optics(&CameraParams::default()) {
            true => Arc::clone(&bare),
            false => Arc::new(resting.through(&bare, view)),
        };
        let dots = print.as_ref().map(|markers| markers.dots(&resting, view));
        let marked = print.as_ref().zip(dots.as_ref()).map(|(markers, dots)| {
            let mut marked = Planes::clone(&seen);
            markers.draw(dots, &resting, view, &mut marked, whole);
            marked
        });
        let mut bright = marked.as_ref().unwrap_or(&seen).clone();
        scale(resting.gains, &mut bright);
        let mut untouched = Image::black(width, height);
        untouched.quantise(&Light { region: whole, planes: bright });
        untouched.binarise(resting.threshold);
        Self { view: *view, photograph, resting, print: dots, bare, seen, marked, untouched }
    }

    /// The image of a pad whose light differs from that of the untouched one in `light`, which is `touched` where that
    /// mask is not 0; without a mask it is not.
    pub fn expose(
        &self,
        light: LazyLight<'_>,
        touched: Option<&Grid<u8>>,
        markers: Option<&MarkerPositions>,
        camera: &CameraParams,
        effects: &mut EffectLog,
    ) -> Image {
        let light = self.see(light, camera, effects);
        let mut light = self.print(light, markers, camera, effects);
        let (noise, speckle) = (camera.noise(), camera.speckle());

        let jitters = camera.gains != self.resting.gains;
        // Many at a time: most presses touch little of the view.
        let any = |mask: &Grid<u8>| mask.data.chunks(64).any(|some| some.iter().fold(0, |any, value| any | value) != 0);
        let touched = touched.filter(|mask| any(mask));
        let need = match speckle {
            None => Requirement::Absent("the pad has none"),
            Some(_) if touched.is_none() => Requirement::Unneeded("nothing touches the pad"),
            Some(_) => Requirement::Needed("the pad is touched"),
        };
        let speckle = if effects.enable(Effect::Speckle, need) { speckle } else { None };
        if jitters || noise.is_some() || speckle.is_some() {
            // What differs from sample to sample, differs everywhere.
            light = self.spread(shaded(light, effects), self.marked.as_ref().unwrap_or(&self.seen)).into();
        }
        let need = match (jitters, camera.gains == [1.0; 3]) {
            (false, true) => Requirement::Unneeded("all gains are 1"),
            (false, false) if light.region().is_empty() => Requirement::Unneeded("the press changed no light"),
            _ => Requirement::Needed("not all gains are 1"),
        };
        let width = self.view.resolution_px[0];
        if let Some((speckle, touched)) = speckle.zip(touched) {
            light = changed(light, Effect::Speckle, effects, |planes| match camera.lens(&self.view) {
                Some(lens) => speckle.add(width, planes, Some(&lens.warp_mask(touched).data)),
                None => speckle.add(width, planes, Some(&touched.data)),
            });
        }
        if effects.enable(Effect::Exposure, need) {
            light = changed(light, Effect::Exposure, effects, |planes| scale(camera.gains, planes));
        }
        let need = match noise {
            Some(_) => Requirement::Needed("every pixel is noisy"),
            None => Requirement::Absent("the camera has none"),
        };
        if effects.enable(Effect::Noise, need)
            && let Some(noise) = noise
        {
            light = changed(light, Effect::Noise, effects, |planes| noise.add(width, planes, None));
        }

        let mut image = self.untouched.clone();
        if image.clipped_px > 0 {
            image.clipped_px -= self.clipped_in(light.region());
        }
        match light {
            LazyLight::Known(light) => image.quantise(&light),
            // Nothing looks at light beside its own: some rows are bytes before the next ones are shaded.
            LazyLight::Pending(region, shade) => {
                for y0 in (region.y0..region.y1).step_by(ROWS) {
                    let rows = Rect { y0, y1: (y0 + ROWS).min(region.y1), ..region };
                    let light = effects.timed(Effect::Shading, || shade(rows));
                    image.quantise(&light);
                }
            }
        }
        image.binarise(camera.threshold);
        image
    }

    /// Pixels of a part that are cut in the picture of the untouched pad.
    fn clipped_in(&self, part: Rect) -> u64 {
        let (width, planes) = (self.view.resolution_px[0], self.marked.as_ref().unwrap_or(&self.seen));
        let gains = self.resting.gains.map(|gain| gain as f32);
        let is_cut = |at: &usize| {
            let [red, green, blue] = [0, 1, 2].map(|channel| planes[channel][*at] * gains[channel]);
            red.min(green).min(blue) < 0.0 || red.max(green).max(blue) > 1.0
        };
        let places = (part.y0..part.y1).flat_map(|y| (y * width + part.x0)..(y * width + part.x1));
        places.filter(is_cut).count() as u64
    }

    /// What lens and vignette make of the light.
    fn see<'a>(&self, light: LazyLight<'a>, camera: &CameraParams, effects: &mut EffectLog) -> LazyLight<'a> {
        let own_optics = !self.photograph && !camera.same_optics(&self.resting);
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
        let mut change = shaded(light, effects);
        self.add(&mut change, &self.bare, -1.0);
        if blurs {
            change = effects.timed(Effect::Defocus, || {
                let Light { region: there, planes } = self.beyond(change, [0.0; 2]);
                let sigma_px = camera.blur_px(&self.view);
                if there == self.whole() {
                    return Light { region: there, planes: defocus::blur_whole(&planes, width, height, sigma_px) };
                }
                let here = there.grown(defocus::reach_px(sigma_px), width, height);
                Light { region: here, planes: defocus::blur(&planes, there, here, sigma_px) }
            });
        }
        if let Some(lens) = camera.lens(&self.view) {
            change = effects.timed(Effect::Distortion, || {
                let Light { region: there, planes } = self.beyond(change, lens.mirrored_px());
                if there == self.whole() {
                    return Light { region: there, planes: lens.warp_whole(&planes) };
                }
                let here = lens.image_of(there);
                Light { region: here, planes: lens.warp(&planes, there, here) }
            });
        }
        if darkens {
            effects.timed(Effect::Vignette, || {
                vignette::darken(&mut change.planes, change.region, &self.view, camera.vignette);
            });
        }
        if own_optics {
            change = self.spread(change, &self.dark());
            self.add(&mut change, &camera.through(&self.bare, &self.view), 1.0);
        } else {
            self.add(&mut change, &self.seen, 1.0);
        }
        change.into()
    }

    /// Prints the dots where the camera sees them, on the light that the press changed.
    fn print<'a>(
        &self,
        light: LazyLight<'a>,
        markers: Option<&MarkerPositions>,
        camera: &CameraParams,
        effects: &mut EffectLog,
    ) -> LazyLight<'a> {
        let dots = markers.map(|markers| effects.timed(Effect::Markers, || markers.dots(camera, &self.view)));
        // Defocus softens the dots of a photograph, too.
        let as_printed = dots == self.print && camera.defocus_mm == self.resting.defocus_mm;
        let need = match markers {
            None => Requirement::Absent("the pad has none"),
            Some(_) if !as_printed => Requirement::Needed("they look otherwise than on the untouched pad"),
            Some(_) if light.region().is_empty() => Requirement::Unneeded("nothing moves them"),
            Some(_) => Requirement::Needed("the light around them changed"),
        };
        let runs = effects.enable(Effect::Markers, need);
        let Some((markers, dots)) = markers.zip(dots).filter(|_| runs) else { return light };
        let light = shaded(light, effects);
        effects.timed(Effect::Markers, || {
            let mut light = if as_printed { light } else { self.spread(light, &self.seen) };
            markers.draw(&dots, camera, &self.view, &mut light.planes, light.region);
            light.into()
        })
    }

    fn whole(&self) -> Rect {
        let [width, height] = self.view.resolution_px;
        Rect::whole(width, height)
    }

    /// The whole picture of a change that goes on beyond the border: one that comes as close to it as `within_px`, along x
    /// and y. Others stay as they are.
    fn beyond(&self, change: Light, within_px: [f64; 2]) -> Light {
        let Rect { x0, y0, x1, y1 } = change.region;
        let [width, height] = self.view.resolution_px;
        let nearest_px = [x0.min(width - x1), y0.min(height - y1)].map(|px| px as f64);
        let near = nearest_px.iter().zip(within_px).any(|(nearest, within)| *nearest <= within);
        if near && !change.region.is_empty() { self.spread(change, &self.dark()) } else { change }
    }

    fn dark(&self) -> Planes {
        [(); 3].map(|()| vec![0.0; self.whole().area()])
    }

    /// The whole picture: `light` where it is known, `around` elsewhere.
    fn spread(&self, light: Light, around: &Planes) -> Light {
        let (whole, part) = (self.whole(), light.region);
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

    /// Adds `sign` times a whole picture to the light.
    fn add(&self, light: &mut Light, picture: &Planes, sign: f32) {
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

/// All of the light, for what looks at more of it than a pixel's own.
fn shaded(light: LazyLight<'_>, effects: &mut EffectLog) -> Light {
    match light {
        LazyLight::Known(light) => light,
        pending => effects.timed(Effect::Shading, || pending.whole()),
    }
}

/// The light after work on all of it that counts as `effect`'s.
fn changed<'a>(
    light: LazyLight<'a>,
    effect: Effect,
    effects: &mut EffectLog,
    work: impl FnOnce(&mut Planes),
) -> LazyLight<'a> {
    let mut light = shaded(light, effects);
    effects.timed(effect, || work(&mut light.planes));
    light.into()
}

/// Multiplies each channel by its gain.
fn scale(gains: [f64; 3], planes: &mut Planes) {
    simd_dispatch(
        #[inline(always)]
        || {
            for (plane, gain) in planes.iter_mut().zip(gains) {
                plane.iter_mut().for_each(|value| *value *= gain as f32);
            }
        },
    );
}
