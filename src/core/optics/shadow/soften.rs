//! Softens a row of shares sideways, every pixel by its own width.
//!
//! Smoothing with [1/4, 1/2, 1/4] at distances 1, 2, 4 .. px gives triangles of half width 2, 4, 8 .. px (the "a trous"
//! scheme: Holschneider et al. 1989). A pixel takes a mixture of the two whose variances enclose the one it asks for.

use super::max_f32;

/// The widest triangle has a half width of 2 to this power, px.
const MAX_LEVELS: u32 = 7;

/// Scratch memory for one row.
#[derive(Clone, Debug, Default)]
pub struct SmoothingRow {
    /// What is softened, 0 to 1.
    pub shares: Vec<f32>,
    /// For every pixel, six times the variance of its smoothing kernel, px^2; 0 for none.
    pub spread: Vec<f32>,
    /// The row as the last smoothing left it, and as the next one makes it; with space at both ends.
    levels: [Vec<f32>; 2],
}

/// Returns the number of smoothings until a triangle has this spread.
pub fn smoothing_levels(spread: f32) -> u32 {
    (0..MAX_LEVELS).take_while(|level| spread > spread_after(*level)).count() as u32
}

/// Returns how far apart two pixels can be that these smoothings mix, px.
pub fn smoothing_reach_px(levels: u32) -> usize {
    (1 << levels) - 1
}

/// Returns the spread after a number of smoothings.
#[inline(always)]
fn spread_after(levels: u32) -> f32 {
    ((1_u32 << (2 * levels)) - 1) as f32
}

impl SmoothingRow {
    /// Makes space for `width` pixels.
    pub fn resize(&mut self, width: usize) {
        self.shares.resize(width, 1.0);
        self.spread.resize(width, 0.0);
        self.levels.iter_mut().for_each(|level| level.resize(width + (1 << MAX_LEVELS), 1.0));
    }

    /// Softens the pixels from number `first` on, and writes them to `soft`. Outside its ends the row is constant.
    #[inline(always)]
    pub fn soften(&mut self, first: usize, soft: &mut [f32]) {
        let Self { shares, spread, levels: [from, to] } = self;
        let (width, shown) = (shares.len(), soft.len());
        let spread = &spread[first..][..shown];
        soft.copy_from_slice(&shares[first..][..shown]);
        let most = smoothing_levels(max_value(spread));
        if most == 0 {
            return;
        }
        from[ROW_START..][..width].copy_from_slice(shares);
        let (mut from, mut to) = (from, to);
        for level in 0..most {
            let by = 1 << level;
            let (before, after) = (from[ROW_START], from[ROW_START + width - 1]);
            from[ROW_START - by..ROW_START].fill(before);
            from[ROW_START + width..][..by].fill(after);
            let (left, right) = (&from[ROW_START - by..][..width], &from[ROW_START + by..][..width]);
            let (middle, smooth) = (&from[ROW_START..][..width], &mut to[ROW_START..][..width]);
            for x in 0..width {
                smooth[x] = 0.5 * middle[x] + 0.25 * (left[x] + right[x]);
            }
            let (start, per_spread) = (spread_after(level), 1.0 / (3 << (2 * level)) as f32);
            let smooth = &to[ROW_START + first..][..shown];
            for x in 0..shown {
                let part = max_f32((spread[x] - start) * per_spread, 0.0);
                let part = if part < 1.0 { part } else { 1.0 };
                soft[x] += part * (smooth[x] - soft[x]);
            }
            (from, to) = (to, from);
        }
    }
}

/// Index of the first value of a row in the memory of a level.
const ROW_START: usize = 1 << (MAX_LEVELS - 1);

/// Returns the largest value, 0 or more.
#[inline(always)]
fn max_value(values: &[f32]) -> f32 {
    let (chunks, rest) = values.as_chunks::<16>();
    let mut lanes = [0.0; 16];
    for chunk in chunks {
        for lane in 0..16 {
            lanes[lane] = max_f32(chunk[lane], lanes[lane]);
        }
    }
    rest.iter().chain(&lanes).copied().fold(0.0, max_f32)
}
