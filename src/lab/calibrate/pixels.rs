//! Collects pixels of presses to learn from: the surface at each, and by how much it changed the image.

use image::RgbImage;

use super::Observation;
use gelsim_core::base::grid::Rect;
use gelsim_core::base::grid::Resolution;
use gelsim_core::base::rng::RandomStream;
use gelsim_core::base::view::SURFACE_BORDER;
use gelsim_core::base::view::View;
use gelsim_core::gelpad::Contact;
use gelsim_core::optics::calibrated::extrapolation::CalibrationRange;
use gelsim_core::optics::calibrated::response::{INPUTS, SECTORS};
use gelsim_core::optics::coarse::CoarseGrid;
use gelsim_core::optics::normals::surface_normals;
use gelsim_core::optics::shadow::casting::ShadowCasting;

/// Distance from the centre up to which pixels are used, in radii of the circle: the halo of a press ends there.
pub const REACH: f64 = 3.5;
/// Distance from the centre up to which errors are counted, in radii of the circle.
pub const ERROR_REACH: f64 = 1.3;
/// Level from which a pixel of the background image counts as saturated.
pub const SATURATED: u8 = 254;
/// Fraction of the pixels that are drawn from the contact and its rim.
const NEAR_FRACTION: f64 = 0.65;

/// Pixels of one press, or of several. All lists are of one length.
#[derive(Clone, Debug, Default)]
pub struct PixelSamples {
    /// The normals' components n_x and n_y.
    pub normals: Vec<[f32; 2]>,
    /// Displacement and place, mm, and the hidden fraction of the sky in each direction.
    pub inputs: Vec<[f32; INPUTS]>,
    /// Image less background image, as fractions of full scale.
    pub change: Vec<[f32; 3]>,
    /// The background image, as fractions of full scale.
    pub background: Vec<[f32; 3]>,
    /// 1 where the image is white, -1 where it is black, 0 elsewhere: the true change may be larger than the one
    /// stored.
    pub clipped: Vec<[f32; 3]>,
}

impl PixelSamples {
    /// Returns the number of pixels.
    pub fn len(&self) -> usize {
        self.change.len()
    }

    /// Returns true if there are no pixels.
    pub fn is_empty(&self) -> bool {
        self.change.is_empty()
    }

    /// Appends the pixels of another press.
    pub fn append(&mut self, other: &Self) {
        self.normals.extend_from_slice(&other.normals);
        self.inputs.extend_from_slice(&other.inputs);
        self.change.extend_from_slice(&other.change);
        self.background.extend_from_slice(&other.background);
        self.clipped.extend_from_slice(&other.clipped);
    }

    /// Collects the pixels of a press at `places`. The hidden sky is left at 0.
    pub fn from_press(
        places: &[usize],
        observation: &Observation,
        contact: &Contact,
        background: &RgbImage,
        camera: &View,
    ) -> Self {
        let width = camera.resolution_px[0];
        let normals = surface_normals(contact, camera);
        let mut pixels = Self::default();
        for &at in places {
            let (x, y) = (at % width, at / width);
            let [x_mm, y_mm] = camera.point_mm([x as f64 + 0.5, y as f64 + 0.5]);
            let mut inputs = [0.0; INPUTS];
            inputs[0] = contact.surface.at(x + SURFACE_BORDER, y + SURFACE_BORDER);
            (inputs[1], inputs[2]) = (x_mm as f32, y_mm as f32);
            pixels.inputs.push(inputs);
            let [nx, ny, _] = normals[at];
            pixels.normals.push([nx, ny]);
            let color = |image: &RgbImage| image.get_pixel(x as u32, y as u32).0;
            let (real, rest) = (color(&observation.image), color(background));
            pixels.change.push(std::array::from_fn(|k| (f32::from(real[k]) - f32::from(rest[k])) / 255.0));
            pixels.background.push(rest.map(|level| f32::from(level) / 255.0));
            pixels.clipped.push(real.map(|level| f32::from(i8::from(level == 255) - i8::from(level == 0))));
        }
        pixels
    }

    /// Computes how much of the sky is hidden at each of the `places` of a press.
    pub fn fill_hidden_sky(&mut self, places: &[usize], contact: &Contact, camera: &View) {
        let [width, height] = camera.resolution_px;
        let every_pixel = CoarseGrid::new(Resolution::Full);
        let casting = ShadowCasting::new(every_pixel, &contact.surface, camera, true, |pixel_mm, _| {
            gelsim_core::optics::calibrated::response::sky_casters(pixel_mm)
        });
        let visible_sky = casting
            .map(|casting| casting.compute_visible_shares(camera, Rect::whole(width, height)))
            .unwrap_or_default();
        for (inputs, &at) in self.inputs.iter_mut().zip(places) {
            for (input, visible) in inputs[INPUTS - SECTORS..].iter_mut().zip(&visible_sky) {
                *input = visible.as_ref().map_or(0.0, |visible| 1.0 - visible.values.at(at % width, at / width));
            }
        }
    }
}

/// Fraction of a press's pixels that may be steeper or deeper than the range: at a rim a few are by chance.
const BY_CHANCE: f64 = 0.005;
/// Number of presses that must have been as steep or as deep, so that a press with a wrong circle does not decide.
const MIN_PRESSES: usize = 2;

/// Returns the range that presses have in common: the steepest slope and the depths that at least two of them reached.
pub fn common_range(presses: &[&PixelSamples]) -> CalibrationRange {
    // The value that the given fraction of a press's pixels exceeds; then the second largest over the presses.
    let reached = |value: &dyn Fn(&PixelSamples, usize) -> f32| {
        let mut each: Vec<f32> = presses
            .iter()
            .map(|press| {
                let mut values: Vec<f32> = (0..press.len()).map(|k| value(press, k)).collect();
                values.sort_by(|a, b| b.total_cmp(a));
                values.get((BY_CHANCE * values.len() as f64) as usize).copied().unwrap_or_default()
            })
            .collect();
        each.sort_by(|a, b| b.total_cmp(a));
        each.get(MIN_PRESSES.min(each.len().max(1)) - 1).copied().unwrap_or_default().max(0.0)
    };
    let steepest = reached(&|press, k| {
        let [x, y] = press.normals[k];
        (x * x + y * y).sqrt()
    });
    CalibrationRange {
        // Above 0, because the response divides by it.
        steepest: steepest.clamp(1e-3, 1.0),
        heights_mm: [-reached(&|press, k| -press.inputs[k][0]), reached(&|press, k| press.inputs[k][0])],
    }
}

/// Draws up to `most` pixels of a press at random, some near its contact and some from its halo. Pixels that are
/// saturated in the background image or under dots are left out: they say nothing.
pub fn draw_places(
    observation: &Observation,
    background: &RgbImage,
    most: usize,
    random: &mut RandomStream,
) -> Vec<usize> {
    let width = background.width() as usize;
    let [x, y] = observation.circle.centre_px;
    let (mut near, mut far) = (Vec::new(), Vec::new());
    for (at, color) in background.pixels().enumerate() {
        let (across, down) = ((at % width) as f64 - x, (at / width) as f64 - y);
        let distance = libm::hypot(across, down) / observation.circle.radius_px;
        let is_shown = color.0.iter().all(|level| *level < SATURATED) && !observation.is_inked(at);
        if distance < REACH && is_shown {
            if distance < ERROR_REACH { near.push(at) } else { far.push(at) }
        }
    }
    let wanted = |fraction: f64| (fraction * most as f64) as usize;
    let mut drawn = random.sample_without_replacement(near, wanted(NEAR_FRACTION));
    drawn.extend(random.sample_without_replacement(far, wanted(1.0 - NEAR_FRACTION)));
    drawn
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_range_is_what_two_presses_reached_and_neither_one_of_them_nor_a_few_pixels_decide() {
        let press = |steepest: f32, heights_mm: [f32; 2]| {
            let mut pixels = PixelSamples::default();
            for k in 0..1000 {
                let share = k as f32 / 999.0;
                pixels.normals.push([0.6 * steepest * share, -0.8 * steepest * share]);
                let mut inputs = [0.0; INPUTS];
                inputs[0] = heights_mm[0] + share * (heights_mm[1] - heights_mm[0]);
                pixels.inputs.push(inputs);
                pixels.change.push([0.0; 3]);
            }
            // By chance.
            (pixels.normals[0], pixels.inputs[0][0]) = ([0.0, 1.0], 9.0);
            pixels
        };
        let presses =
            [press(0.3, [-0.1, 0.2]), press(0.9, [-0.5, 2.0]), press(0.5, [-0.2, 0.6]), press(0.4, [0.0, 0.5])];
        let CalibrationRange { steepest, heights_mm: [low, high] } = common_range(&presses.each_ref());
        assert!((steepest - 0.5).abs() < 0.01 && (high - 0.6).abs() < 0.01 && (low + 0.2).abs() < 0.01);
        let level = common_range(&[&press(0.0, [0.0; 2]), &press(0.0, [0.0; 2])]);
        assert_eq!(level, CalibrationRange { steepest: 1e-3, heights_mm: [-0.0, 0.0] });
        assert_eq!(common_range(&[]), level);
    }
}
