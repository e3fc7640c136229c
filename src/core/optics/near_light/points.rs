//! Near LEDs as points that shine, and what a point sends to the places of a row.

use super::window::{ReflectedShares, Window};
use crate::optics::led::{Led, LedPlace};
use crate::optics::light_pattern::LightColor;

/// Smallest square of a distance to an LED that counts, mm^2: at an LED that lies in the pad's plane, light would be
/// infinite and come from nowhere.
const NEAREST_MM2: f32 = 1e-6;

/// Widths, over the distance, from which a row is taken as two and as six points.
const TWO_POINTS_FROM: f64 = 0.1;
const SIX_POINTS_FROM: f64 = 0.4;
/// Points of a row whose images in the window are taken as one: these stand further off, and high.
const IMAGES_TOGETHER: usize = 3;

/// A point that shines: part of an LED, or its image in the window.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LightPoint {
    /// Where it is, mm from the middle of the image; z is below 0 on the camera's side.
    pub at_mm: [f32; 3],
    /// The direction in which it shines most.
    aim: [f32; 3],
    /// Exponent of the cosine about it.
    pub lobe: f32,
    /// Light that it sends to a surface that faces it, 1 mm away on its axis.
    full: f32,
    /// Half its height, mm.
    pub half_height_mm: f32,
    /// True for an image in the window.
    pub is_mirrored: bool,
}

impl LightPoint {
    /// Returns the most light that it sends anywhere at a distance, mm.
    pub fn strength_at_distance(&self, mm: f64) -> f64 {
        f64::from(self.full) / (mm * mm).max(f64::from(NEAREST_MM2))
    }

    /// Returns the unit vector to it from a point of the pad, and the inverse of its distance, 1/mm.
    #[inline(always)]
    pub fn seen_from(&self, [x, y]: [f32; 2], height_mm: f32) -> ([f32; 3], f32) {
        let [at_x, at_y, at_z] = self.at_mm;
        // Towards the camera, where the point is, z falls: a positive height brings the surface nearer to it.
        let (dx, dy, dz) = (at_x - x, at_y - y, at_z + height_mm);
        let inverse = 1.0 / (dx * dx + dy * dy + dz * dz).max(NEAREST_MM2).sqrt();
        ([dx * inverse, dy * inverse, dz * inverse], inverse)
    }

    /// Returns the vector from a point of the undeformed pad to it, mm.
    pub fn vector_from(&self, [x, y]: [f32; 2]) -> [f32; 3] {
        [self.at_mm[0] - x, self.at_mm[1] - y, self.at_mm[2]]
    }
}

/// An LED at its distance, or a part of its row.
#[derive(Clone, Debug)]
pub(crate) struct NearLed {
    /// Colour times intensity.
    pub color: LightColor,
    /// Its points, those behind the window last.
    pub points: Vec<LightPoint>,
}

impl NearLed {
    /// Places an LED, as one or, if the surface shows highlights, as the two halves of its row: these lie further apart
    /// than a highlight is wide.
    pub fn place(led: &Led, window: Option<&Window>, shows_highlights: bool) -> Vec<Self> {
        let LedPlace { direction, azimuth: (sin, cos), distance_mm } = led.place();
        let middle: [f64; 3] = direction.map(|v| v * distance_mm);
        let [width_mm, height_mm] = led.size_mm.unwrap_or_else(|| {
            led.angular_size_deg.map(|size| 2.0 * distance_mm * libm::tan((0.5 * size.min(170.0)).to_radians()))
        });
        let count = match width_mm / distance_mm {
            share if share < TWO_POINTS_FROM => 1_u32,
            share if share < SIX_POINTS_FROM => 2,
            _ => 6,
        };
        // The row runs along the pad, at right angles to the way to its middle.
        let aim = direction.map(|v| -v);
        let place = |k: usize| {
            let along = width_mm * ((k as f64 + 0.5) / f64::from(count) - 0.5);
            [middle[0] - sin * along, middle[1] + cos * along, middle[2]]
        };
        let at_middle = |at: [f64; 3]| {
            let square = at.iter().map(|v| v * v).sum::<f64>().max(f64::from(NEAREST_MM2));
            let cosine = -(at[0] * aim[0] + at[1] * aim[1] + at[2] * aim[2]) / square.sqrt();
            libm::pow(cosine.max(0.0), led.lobe) / square
        };
        let places: Vec<[f64; 3]> = (0..count as usize).map(place).collect();
        let full = 1.0 / places.iter().map(|at| at_middle(*at)).sum::<f64>().max(f64::MIN_POSITIVE);
        // A point in the middle of some.
        let point = |places: &[[f64; 3]], aim: [f64; 3], is_mirrored| LightPoint {
            at_mm: std::array::from_fn(|k| (places.iter().map(|at| at[k]).sum::<f64>() / places.len() as f64) as f32),
            aim: aim.map(|v| v as f32),
            lobe: led.lobe as f32,
            full: (full * places.len() as f64) as f32,
            half_height_mm: (0.5 * height_mm) as f32,
            is_mirrored,
        };
        let color = LightColor::new(led.color, led.intensity, led.pattern.as_deref());
        let with_images = |places: &[[f64; 3]]| {
            let mut points: Vec<LightPoint> = places.chunks(1).map(|at| point(at, aim, false)).collect();
            if let Some(window) = window {
                let image = |[x, y, z]: &[f64; 3]| [*x, *y, -2.0 * window.distance_mm - z];
                let images: Vec<[f64; 3]> = places.iter().map(image).collect();
                let together = if places.len() >= IMAGES_TOGETHER { IMAGES_TOGETHER } else { 1 };
                points.extend(images.chunks(together).map(|at| point(at, [aim[0], aim[1], -aim[2]], true)));
            }
            Self { color: color.clone(), points }
        };
        let parts = if shows_highlights && count > 1 { 2 } else { 1 };
        places.chunks(places.len() / parts).map(with_images).collect()
    }
}

/// Directions to a point from the places of a row, and what it sends there.
#[derive(Default)]
pub(crate) struct PointRows {
    pub x: Vec<f32>,
    pub y: Vec<f32>,
    pub z: Vec<f32>,
    pub weight: Vec<f32>,
}

impl PointRows {
    /// Fills in the directions to a point, and the inverse of its distance as weights.
    #[inline(always)]
    pub fn fill(&mut self, point: &LightPoint, columns_mm: &[f32], y_mm: f32, heights_mm: &[f32]) {
        let width = columns_mm.len();
        let Self { x, y, z, weight } = self;
        for plane in [&mut *x, &mut *y, &mut *z, &mut *weight] {
            plane.resize(width, 0.0);
        }
        let (x, y, z, weight) = (&mut x[..width], &mut y[..width], &mut z[..width], &mut weight[..width]);
        let heights_mm = &heights_mm[..width];
        for k in 0..width {
            ([x[k], y[k], z[k]], weight[k]) = point.seen_from([columns_mm[k], y_mm], heights_mm[k]);
        }
    }

    /// Turns the inverse of the distance into the light that arrives.
    #[inline(always)]
    pub fn weigh(&mut self, point: &LightPoint, reflected: Option<&ReflectedShares>) {
        let Self { x, y, z, weight } = self;
        let [aim_x, aim_y, aim_z] = point.aim;
        for weight in &mut *weight {
            *weight = point.full * *weight * *weight;
        }
        let cosine = |[x, y, z]: [f32; 3]| (-(x * aim_x + y * aim_y + z * aim_z)).max(0.0);
        if point.lobe == 1.0 {
            for (weight, ((x, y), z)) in weight.iter_mut().zip(x.iter().zip(&*y).zip(&*z)) {
                *weight *= cosine([*x, *y, *z]);
            }
        } else if point.lobe != 0.0 {
            for (weight, ((x, y), z)) in weight.iter_mut().zip(x.iter().zip(&*y).zip(&*z)) {
                *weight *= libm::powf(cosine([*x, *y, *z]), point.lobe);
            }
        }
        if let Some(reflected) = reflected {
            for (weight, z) in weight.iter_mut().zip(&*z) {
                *weight *= reflected.at_cosine(z.abs());
            }
        }
    }
}
