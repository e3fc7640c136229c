//! Softens a row of shares sideways, every pixel by its own width.
//!
//! Smoothing with [1/4, 1/2, 1/4] at distances 1, 2, 4 .. px gives triangles of half width 2, 4, 8 .. px (the "a trous"
//! scheme: Holschneider et al. 1989); a pixel takes the mean of the two whose variances enclose the one it asks for.

use super::larger;

/// The widest triangle has a half width of 2 to this power, px.
const MOST_LEVELS: u32 = 7;

/// Memory for one row.
#[derive(Clone, Debug, Default)]
pub struct Row {
    /// What is softened, 0 to 1.
    pub shares: Vec<f32>,
    /// For every pixel six times the variance of its smoothing kernel, px^2; 0 for none.
    pub spread: Vec<f32>,
    /// The row as smooth as the level before left it, and as this level makes it; with space at both ends.
    levels: [Vec<f32>; 2],
}

/// Smoothings until a triangle has this spread.
pub fn levels(spread: f32) -> u32 {
    (0..MOST_LEVELS).take_while(|level| spread > reached(*level)).count() as u32
}

/// How far apart two pixels can be that these smoothings mix, px.
pub fn reach(levels: u32) -> usize {
    (1 << levels) - 1
}

/// The spread after a number of smoothings.
#[inline(always)]
fn reached(levels: u32) -> f32 {
    ((1_u32 << (2 * levels)) - 1) as f32
}

impl Row {
    /// Makes space for `width` pixels.
    pub fn resize(&mut self, width: usize) {
        self.shares.resize(width, 1.0);
        self.spread.resize(width, 0.0);
        self.levels.iter_mut().for_each(|level| level.resize(width + (1 << MOST_LEVELS), 1.0));
    }

    /// Softens the pixels from number `first` on into `soft`. The row goes on beyond its ends as it is there.
    #[inline(always)]
    pub fn soften(&mut self, first: usize, soft: &mut [f32]) {
        let Self { shares, spread, levels: [from, to] } = self;
        let (width, shown) = (shares.len(), soft.len());
        let spread = &spread[first..][..shown];
        soft.copy_from_slice(&shares[first..][..shown]);
        let most = levels(largest(spread));
        if most == 0 {
            return;
        }
        from[MIDDLE..][..width].copy_from_slice(shares);
        let (mut from, mut to) = (from, to);
        for level in 0..most {
            let by = 1 << level;
            let (before, after) = (from[MIDDLE], from[MIDDLE + width - 1]);
            from[MIDDLE - by..MIDDLE].fill(before);
            from[MIDDLE + width..][..by].fill(after);
            let (left, right) = (&from[MIDDLE - by..][..width], &from[MIDDLE + by..][..width]);
            let (middle, smooth) = (&from[MIDDLE..][..width], &mut to[MIDDLE..][..width]);
            for x in 0..width {
                smooth[x] = 0.5 * middle[x] + 0.25 * (left[x] + right[x]);
            }
            let (start, per_spread) = (reached(level), 1.0 / (3 << (2 * level)) as f32);
            let smooth = &to[MIDDLE + first..][..shown];
            for x in 0..shown {
                let part = larger((spread[x] - start) * per_spread, 0.0);
                let part = if part < 1.0 { part } else { 1.0 };
                soft[x] += part * (smooth[x] - soft[x]);
            }
            (from, to) = (to, from);
        }
    }
}

/// First value of a row in the memory of a level.
const MIDDLE: usize = 1 << (MOST_LEVELS - 1);

/// The largest value, 0 or more.
#[inline(always)]
fn largest(values: &[f32]) -> f32 {
    let (chunks, rest) = values.as_chunks::<16>();
    let mut lanes = [0.0; 16];
    for chunk in chunks {
        for lane in 0..16 {
            lanes[lane] = larger(chunk[lane], lanes[lane]);
        }
    }
    rest.iter().chain(&lanes).copied().fold(0.0, larger)
}
