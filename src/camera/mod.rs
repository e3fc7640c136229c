//! From light to image: what the camera makes of the light that the pad sends to it.
//!
//! Lens and vignette are linear, so they act on what the press changed in the light, and the result is added to the
//! picture of the untouched pad. A photograph of that pad already went through its camera's lens and stays as it is;
//! a rendered one goes through the same lens as everything else. Dots are drawn where the lens shows them; exposure,
//! white balance and noise act on the sum.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::config::quantity::Quantity;
use crate::depth::Camera;
use crate::effects::{Effect, Gate, Ledger, Need};
use crate::grid::Rect;
use crate::optics::Light;
use crate::optics::background::quantise;
use crate::rng::Stage;
use crate::simd::wide;

pub mod defocus;
pub mod lens;
pub mod markers;
pub mod noise;
pub mod print;
mod vignette;

use lens::Lens;
use markers::Dot;
use noise::Noise;
use print::Ink;

/// The `[camera]` table. What is left out is an ideal camera's.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// Radial distortion k1: a pixel at distance r from the middle, in half diagonals, shows what an ideal lens would show
    /// at r (1 + k1 r^2 + k2 r^4). Above 0 is barrel-shaped.
    pub distortion_k1: Quantity,
    /// Radial distortion k2.
    pub distortion_k2: Quantity,
    /// Share of the light that is lost in the image's corners, 0 to 1; elsewhere in proportion to r^2.
    pub vignette: Quantity,
    /// Standard deviation of the blur, mm on the pad, 0 to 1.
    pub defocus_mm: Quantity,
    /// Factor on all brightness, 0.01 to 100.
    pub exposure: Quantity,
    /// Factor on red, 0.01 to 100.
    pub red_gain: Quantity,
    /// Factor on blue, 0.01 to 100.
    pub blue_gain: Quantity,
    /// Standard deviation of the shot noise of a white pixel, grey levels of 255; of others in proportion to the root of
    /// their brightness.
    pub shot_noise_levels: Quantity,
    /// Standard deviation of the read noise, grey levels of 255.
    pub read_noise_levels: Quantity,
}

impl Default for Settings {
    fn default() -> Self {
        let (zero, one) = (Quantity::Constant(0.0), Quantity::Constant(1.0));
        Self {
            distortion_k1: zero.clone(),
            distortion_k2: zero.clone(),
            vignette: zero.clone(),
            defocus_mm: zero.clone(),
            exposure: one.clone(),
            red_gain: one.clone(),
            blue_gain: one,
            shot_noise_levels: zero.clone(),
            read_noise_levels: zero,
        }
    }
}

/// The camera in one sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shot {
    /// k1 and k2.
    pub distortion: [f64; 2],
    /// See [`Settings::vignette`].
    pub vignette: f64,
    /// See [`Settings::defocus_mm`].
    pub defocus_mm: f64,
    /// Factors on red, green and blue.
    pub gains: [f64; 3],
    /// See [`Settings::shot_noise_levels`].
    pub shot_noise_levels: f64,
    /// See [`Settings::read_noise_levels`].
    pub read_noise_levels: f64,
    /// Key of the noise.
    pub noise_key: u64,
}

impl Shot {
    /// Draws each quantity from its law.
    pub fn draw(settings: &Settings, noise_key: u64, draw: impl Fn(Stage, &Quantity) -> f64) -> Self {
        let exposure = draw(Stage::Exposure, &settings.exposure);
        Self {
            distortion: [
                draw(Stage::DistortionK1, &settings.distortion_k1),
                draw(Stage::DistortionK2, &settings.distortion_k2),
            ],
            vignette: draw(Stage::Vignette, &settings.vignette),
            defocus_mm: draw(Stage::Defocus, &settings.defocus_mm),
            gains: [
                exposure * draw(Stage::RedGain, &settings.red_gain),
                exposure,
                exposure * draw(Stage::BlueGain, &settings.blue_gain),
            ],
            shot_noise_levels: draw(Stage::ShotNoise, &settings.shot_noise_levels),
            read_noise_levels: draw(Stage::ReadNoise, &settings.read_noise_levels),
            noise_key,
        }
    }

    /// The camera of the picture of the untouched pad: what differs from sample to sample is ideal there.
    pub fn resting(settings: &Settings) -> Self {
        let ideal = |stage| if matches!(stage, Stage::Exposure | Stage::RedGain | Stage::BlueGain) { 1.0 } else { 0.0 };
        Self::draw(settings, 0, |stage, law| match law {
            Quantity::Constant(value) => *value,
            Quantity::Random(_) => ideal(stage),
        })
    }

    /// The same without an effect that is to be left out.
    pub fn gated(self, gate: Gate) -> Self {
        match gate {
            Gate::Without(Effect::Distortion) => Self { distortion: [0.0; 2], ..self },
            Gate::Without(Effect::Vignette) => Self { vignette: 0.0, ..self },
            Gate::Without(Effect::Defocus) => Self { defocus_mm: 0.0, ..self },
            Gate::Without(Effect::Exposure) => Self { gains: [1.0; 3], ..self },
            Gate::Without(Effect::Noise) => Self { shot_noise_levels: 0.0, read_noise_levels: 0.0, ..self },
            _ => self,
        }
    }

    /// The lens's distortion, if it has any.
    pub fn lens(&self, view: &Camera) -> Option<Lens> {
        let [width, height] = view.resolution_px;
        let [k1, k2] = self.distortion;
        (k1 != 0.0 || k2 != 0.0).then_some(Lens { k1, k2, width, height })
    }

    fn same_optics(&self, other: &Self) -> bool {
        let of = |shot: &Self| (shot.distortion, shot.vignette, shot.defocus_mm);
        of(self) == of(other)
    }

    /// Light of the whole view through lens and vignette.
    fn through(&self, planes: &Planes, view: &Camera) -> Planes {
        let [width, height] = view.resolution_px;
        let mut planes = planes.clone();
        if self.defocus_mm > 0.0 {
            planes = defocus::blur_whole(&planes, width, height, self.blur_px(view));
        }
        if let Some(lens) = self.lens(view) {
            planes = lens.warp_whole(&planes);
        }
        vignette::darken(&mut planes, Rect::whole(width, height), view, self.vignette);
        planes
    }

    fn blur_px(&self, view: &Camera) -> [f64; 2] {
        view.mm_per_px.map(|pitch| self.defocus_mm / pitch)
    }
}

/// Red, green and blue, row-major.
type Planes = [Vec<f32>; 3];

/// A camera made ready for one sensor: what it sees of the untouched pad.
pub struct Body {
    view: Camera,
    /// The picture of the untouched pad is a photograph.
    photograph: bool,
    resting: Shot,
    /// The dots of a pad whose print is the same in every sample, as the resting camera sees them.
    print: Option<Vec<Dot>>,
    /// Light of the untouched pad.
    bare: Planes,
    /// The same as the resting camera sees it.
    seen: Planes,
    /// The same with the print, if there is any.
    marked: Option<Planes>,
    /// The same as an image.
    pub untouched: Image,
}

impl Body {
    /// Of a pad with this light; `photograph` if that is a picture taken by the camera itself.
    pub fn new(view: &Camera, light: Light, photograph: bool, resting: Shot, print: Option<Ink>) -> Self {
        let [width, height] = view.resolution_px;
        let whole = Rect::whole(width, height);
        let bare = light.planes;
        let seen = if photograph { bare.clone() } else { resting.through(&bare, view) };
        let dots = print.as_ref().map(|ink| ink.dots(&resting, view));
        let marked = print.as_ref().zip(dots.as_ref()).map(|(ink, dots)| {
            let mut marked = seen.clone();
            ink.draw(dots, &resting, view, &mut marked, whole);
            marked
        });
        let mut bright = marked.clone().unwrap_or_else(|| seen.clone());
        scale(resting.gains, &mut bright);
        let mut untouched = Image::black(width, height);
        untouched.quantise(&Light { region: whole, planes: bright });
        Self { view: *view, photograph, resting, print: dots, bare, seen, marked, untouched }
    }

    /// The image of a pad whose light differs from that of the untouched one in `light`.
    pub fn expose(&self, light: Light, ink: Option<&Ink>, shot: &Shot, effects: &mut Ledger) -> Image {
        let light = self.see(light, shot, effects);
        let mut light = self.print(light, ink, shot, effects);

        let jitters = shot.gains != self.resting.gains;
        let noisy = shot.shot_noise_levels > 0.0 || shot.read_noise_levels > 0.0;
        if jitters || noisy {
            // What differs from sample to sample, differs everywhere.
            light = self.spread(light, self.marked.as_ref().unwrap_or(&self.seen));
        }
        let need = match (jitters, shot.gains == [1.0; 3]) {
            (false, true) => Need::Idle("all gains are 1"),
            (false, false) if light.region.is_empty() => Need::Idle("the press changed no light"),
            _ => Need::Called("not all gains are 1"),
        };
        effects.run(Effect::Exposure, need, || scale(shot.gains, &mut light.planes));
        let need = if noisy { Need::Called("every pixel is noisy") } else { Need::Absent("the camera has none") };
        effects.run(Effect::Noise, need, || {
            let share = |levels: f64| (levels / 255.0) as f32;
            let (read, shot_noise) = (share(shot.read_noise_levels), share(shot.shot_noise_levels));
            let noise = Noise { read, shot: shot_noise, key: shot.noise_key };
            noise.add(self.view.resolution_px[0], &mut light.planes);
        });

        let mut image = self.untouched.clone();
        if image.clipped_px > 0 {
            image.clipped_px -= self.clipped_in(light.region);
        }
        image.quantise(&light);
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
    fn see(&self, light: Light, shot: &Shot, effects: &mut Ledger) -> Light {
        let own_optics = !self.photograph && !shot.same_optics(&self.resting);
        let unchanged = light.region.is_empty() && !own_optics;
        let need = |has_any| match has_any {
            false => Need::Absent("the camera has none"),
            true if unchanged => Need::Idle("the press changed no light"),
            true => Need::Called("the light changed"),
        };
        let blurs = effects.calls(Effect::Defocus, need(shot.defocus_mm > 0.0));
        let distorts = effects.calls(Effect::Distortion, need(shot.distortion != [0.0; 2]));
        let darkens = effects.calls(Effect::Vignette, need(shot.vignette > 0.0));
        if !(blurs || distorts || darkens) {
            return light;
        }

        // Only what the press changed goes through the lens.
        let [width, height] = self.view.resolution_px;
        let mut change = light;
        self.add(&mut change, &self.bare, -1.0);
        if blurs {
            change = effects.timed(Effect::Defocus, || {
                let Light { region: there, planes } = self.beyond(change, [0.0; 2]);
                let sigma_px = shot.blur_px(&self.view);
                if there == self.whole() {
                    return Light { region: there, planes: defocus::blur_whole(&planes, width, height, sigma_px) };
                }
                let here = there.grown(defocus::reach_px(sigma_px), width, height);
                Light { region: here, planes: defocus::blur(&planes, there, here, sigma_px) }
            });
        }
        if let Some(lens) = shot.lens(&self.view) {
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
                vignette::darken(&mut change.planes, change.region, &self.view, shot.vignette);
            });
        }
        if own_optics {
            change = self.spread(change, &self.dark());
            self.add(&mut change, &shot.through(&self.bare, &self.view), 1.0);
        } else {
            self.add(&mut change, &self.seen, 1.0);
        }
        change
    }

    /// Prints the dots where the camera sees them, on the light that the press changed.
    fn print(&self, light: Light, ink: Option<&Ink>, shot: &Shot, effects: &mut Ledger) -> Light {
        let dots = ink.map(|ink| effects.timed(Effect::Markers, || ink.dots(shot, &self.view)));
        // Defocus softens the dots of a photograph, too.
        let as_printed = dots == self.print && shot.defocus_mm == self.resting.defocus_mm;
        let need = match ink {
            None => Need::Absent("the pad has none"),
            Some(_) if !as_printed => Need::Called("they look otherwise than on the untouched pad"),
            Some(_) if light.region.is_empty() => Need::Idle("nothing moves them"),
            Some(_) => Need::Called("the light around them changed"),
        };
        let runs = effects.calls(Effect::Markers, need);
        let Some((ink, dots)) = ink.zip(dots).filter(|_| runs) else { return light };
        effects.timed(Effect::Markers, || {
            let mut light = if as_printed { light } else { self.spread(light, &self.seen) };
            ink.draw(&dots, shot, &self.view, &mut light.planes, light.region);
            light
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
        wide(
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

/// Multiplies each channel by its gain.
fn scale(gains: [f64; 3], planes: &mut Planes) {
    wide(
        #[inline(always)]
        || {
            for (plane, gain) in planes.iter_mut().zip(gains) {
                plane.iter_mut().for_each(|value| *value *= gain as f32);
            }
        },
    );
}

/// An 8-bit RGB image and what quantising cut.
#[derive(Clone, Debug)]
pub struct Image {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Row-major RGB.
    pub rgb: Vec<u8>,
    /// Pixels with a channel that was below 0 or above full scale and was cut.
    pub clipped_px: u64,
    /// Pixels with a channel at full scale.
    pub saturated_px: u64,
    /// True unless the light was NaN or infinite somewhere.
    pub finite: bool,
}

impl Image {
    /// A black one.
    pub fn black(width: usize, height: usize) -> Self {
        Self { width, height, rgb: vec![0; 3 * width * height], clipped_px: 0, saturated_px: 0, finite: true }
    }

    /// Writes light over a part of the image.
    pub fn quantise(&mut self, light: &Light) {
        wide(
            #[inline(always)]
            || {
                if self.saturated_px > 0 {
                    self.saturated_px -= self.saturated_in(light.region);
                }
                quantise_region(light, self);
            },
        );
    }

    /// Pixels of a part with a channel at full scale.
    #[inline(always)]
    fn saturated_in(&self, part: Rect) -> u64 {
        let mut count = 0;
        for y in part.y0..part.y1 {
            let row = &self.rgb[(y * self.width + part.x0) * 3..][..part.width() * 3];
            let saturated = row.chunks_exact(3).map(|pixel| u32::from(pixel[0].max(pixel[1]).max(pixel[2]) == 255));
            count += u64::from(saturated.sum::<u32>());
        }
        count
    }
}

#[inline(always)]
fn quantise_region(light: &Light, image: &mut Image) {
    let Rect { x0, y0, .. } = light.region;
    let width = light.region.width();
    let mut bytes = [vec![0_u8; width], vec![0; width], vec![0; width]];
    for row in 0..light.region.height() {
        let [red, green, blue] = light.planes.each_ref().map(|plane| &plane[row * width..][..width]);
        let (mut clipped, mut not_finite) = (0_u32, 0_u32);
        for x in 0..width {
            let (low, high) = (red[x].min(green[x]).min(blue[x]), red[x].max(green[x]).max(blue[x]));
            clipped += u32::from((low < 0.0) | (high > 1.0));
            // Finite numbers times 0 are 0; NaN and infinities are NaN.
            not_finite += u32::from((red[x] + green[x] + blue[x]) * 0.0 != 0.0);
        }
        image.clipped_px += u64::from(clipped);
        image.finite &= not_finite == 0;

        for (bytes, plane) in bytes.iter_mut().zip([red, green, blue]) {
            for (byte, brightness) in bytes.iter_mut().zip(plane) {
                *byte = quantise(*brightness);
            }
        }
        let [red, green, blue] = bytes.each_ref().map(|bytes| &bytes[..width]);
        let rgb = &mut image.rgb[((y0 + row) * image.width + x0) * 3..][..width * 3];
        let mut saturated = 0_u32;
        for (x, pixel) in rgb.chunks_exact_mut(3).enumerate() {
            pixel[0] = red[x];
            pixel[1] = green[x];
            pixel[2] = blue[x];
        }
        for x in 0..width {
            saturated += u32::from(red[x].max(green[x]).max(blue[x]) == 255);
        }
        image.saturated_px += u64::from(saturated);
    }
}
