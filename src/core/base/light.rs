//! The light that the stages pass on, and the step from brightness to 8 bits.

use super::grid::Rect;

/// Brightness of the part of the image that the press can change; 1 = full scale, values below 0 and above 1 are
/// possible. Outside `region` the image is exactly that of the untouched pad.
#[derive(Clone, Debug, Default)]
pub struct Light {
    /// The part of the view that `planes` covers.
    pub region: Rect,
    /// Red, green and blue of the region's pixels, row-major.
    pub planes: [Vec<f32>; 3],
}

/// Light that is computed where and when it is needed. Much of it is needed only until it is turned into bytes.
pub enum LazyLight<'a> {
    /// The light, already computed.
    Known(Light),
    /// The region, and a function that computes the light of any part of it.
    Pending(Rect, Box<dyn Fn(Rect) -> Light + 'a>),
}

impl LazyLight<'_> {
    /// Returns the part of the view that the light covers.
    pub(crate) fn region(&self) -> Rect {
        match self {
            Self::Known(light) => light.region,
            Self::Pending(region, _) => *region,
        }
    }

    /// Computes the light of the whole region.
    pub fn into_light(self) -> Light {
        match self {
            Self::Known(light) => light,
            Self::Pending(region, of) => of(region),
        }
    }
}

impl From<Light> for LazyLight<'_> {
    fn from(light: Light) -> Self {
        Self::Known(light)
    }
}

/// Returns the 8-bit display value of a brightness (1 = full scale), rounded to the nearest and clamped to 0 .. 255; 0
/// for NaN.
#[inline(always)]
pub fn quantise(brightness: f32) -> u8 {
    // From 2^23 on, consecutive floats are whole numbers: the addition rounds, and the low byte of the sum is the
    // value. A cast has to handle more cases; this form runs on eight pixels at a time.
    const WHOLE: f32 = 8_388_608.0;
    ((brightness * 255.0).clamp(0.0, 255.0) + WHOLE).to_bits() as u8
}
