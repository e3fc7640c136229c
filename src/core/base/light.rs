//! Light as the stages hand it on, and the step from brightness to 8 bits.

use super::grid::Rect;

/// Brightness where the press can change it, 1 = full scale; it may leave 0 .. 1. Outside `region` the picture is the
/// untouched pad's, exactly.
#[derive(Clone, Debug, Default)]
pub struct Light {
    /// Part of the view that is held here.
    pub region: Rect,
    /// Red, green and blue of the region's pixels, row-major.
    pub planes: [Vec<f32>; 3],
}

/// Light that is worked out where and when it is wanted: much of it is needed for no longer than it takes to become bytes.
pub enum LazyLight<'a> {
    /// It is worked out already.
    Known(Light),
    /// What gives the light of any part of a region.
    Pending(Rect, Box<dyn Fn(Rect) -> Light + 'a>),
}

impl LazyLight<'_> {
    /// Part of the view that it is the light of.
    pub(crate) fn region(&self) -> Rect {
        match self {
            Self::Known(light) => light.region,
            Self::Pending(region, _) => *region,
        }
    }

    /// All of it.
    pub fn whole(self) -> Light {
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

/// 8-bit display value of a brightness, 1 = full scale, rounded to the nearest and cut to 0 .. 255; NaN is 0.
#[inline(always)]
pub fn quantise(brightness: f32) -> u8 {
    // From 2^23 on, floats are whole numbers: the sum is rounded, and its low byte is the value. Unlike a cast, which
    // has more cases to mind, this runs on eight pixels at a time.
    const WHOLE: f32 = 8_388_608.0;
    ((brightness * 255.0).clamp(0.0, 255.0) + WHOLE).to_bits() as u8
}
