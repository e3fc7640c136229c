//! Taxim's colours: a quadratic in the pixel's place for each bin of steepness and direction of the pad's surface.
//!
//! Source: Si and Yuan (2022), "Taxim: an example-based simulation model for GelSight tactile sensors", section III-C,
//! in the layout of the package `taxim` 1.4. The polynomial is the change of the picture, in grey levels. Bins are
//! hard, as Taxim's are: colours jump by a few levels from bin to bin. Valid for slopes that the calibration's balls
//! reached.
//!
//! Taxim's polynomials are not 0 where the surface is flat. In gelsim, however, the picture there is that of the
//! untouched pad. So the change grows in proportion to the angle through the first bin of steepness; from there on it
//! is Taxim's.

use serde::{Deserialize, Serialize};

use crate::base::simd::split_fraction;

/// Terms of a polynomial.
pub const TERMS: usize = 6;

/// Largest number of bins of steepness, and of direction.
pub const MAX_BINS: usize = 1024;

/// Largest change of a channel that any polynomial may give, grey levels: far beyond every real one, far below
/// overflow.
const MAX_CHANGE_LEVELS: f64 = 1e6;

/// A calibration as it stands in a table file. [`validate`](Self::validate) it before any other use.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TaximCalibration {
    /// Number of bins of steepness, and of direction. Steepness runs from 0 to 90 degrees, direction from -180 to 180,
    /// each in one step less than there are bins: the last bin holds the end of the range only.
    pub bins: usize,
    /// Width and height of the pictures that the polynomials were fitted to, px.
    pub resolution_px: [usize; 2],
    /// Polynomials of red, green and blue; for each bin of steepness, those of all bins of direction. They hold the
    /// coefficients of x^2, y^2, x y, x, y and 1. The sum is in grey levels; x and y count pixels of that resolution, 0
    /// at the centre of the first.
    pub polynomials: [Vec<[f32; TERMS]>; 3],
}

impl TaximCalibration {
    /// Checks sizes and numbers; an error says what is wrong with them.
    pub fn validate(&self) -> Result<(), String> {
        let Self { bins, resolution_px, polynomials } = self;
        if !(2..=MAX_BINS).contains(bins) {
            return Err(format!("{bins} bins; allowed: 2 to {MAX_BINS}"));
        }
        crate::base::view::check_image_size(*resolution_px)?;
        for (channel, all) in ["red", "green", "blue"].into_iter().zip(polynomials) {
            if all.len() != bins * bins {
                return Err(format!("{} polynomials of {channel} for {bins} x {bins} bins", all.len()));
            }
            // NaN is not within the limit either.
            let within = |polynomial: &[f32; TERMS]| self.change_bound(polynomial) <= MAX_CHANGE_LEVELS;
            if let Some(at) = all.iter().position(|polynomial| !within(polynomial)) {
                let (steepness, direction) = (at / bins, at % bins);
                return Err(format!(
                    "the polynomial of {channel} in bin {steepness} of steepness, {direction} of direction is not finite, or \
                     exceeds {MAX_CHANGE_LEVELS} grey levels"
                ));
            }
        }
        Ok(())
    }

    /// Returns a bound on what a polynomial gives in view, grey levels: the sum of its terms counted from the picture's
    /// middle.
    fn change_bound(&self, polynomial: &[f32; TERMS]) -> f64 {
        let [half_x, half_y] = self.resolution_px.map(|size| size as f64 / 2.0);
        let (x, y) = (half_x - 0.5, half_y - 0.5);
        let [xx, yy, xy, along_x, along_y, constant] = polynomial.map(f64::from);
        let middle = xx * x * x + yy * y * y + xy * x * y + along_x * x + along_y * y + constant;
        let slopes = [2.0 * xx * x + xy * y + along_x, 2.0 * yy * y + xy * x + along_y];
        let curved = xx.abs() * half_x * half_x + yy.abs() * half_y * half_y + xy.abs() * half_x * half_y;
        middle.abs() + slopes[0].abs() * half_x + slopes[1].abs() * half_y + curved
    }
}

/// A calibration prepared for one view.
pub struct TaximLookup {
    /// By bin, term and channel; the fourth channel fills a vector.
    table: Vec<[[f32; 4]; TERMS]>,
    bins: usize,
    /// Places of the view's columns and rows in the calibration's picture.
    columns: Vec<f32>,
    rows: Vec<f32>,
    /// A bound on the change in the first bin of steepness, grey levels.
    first_bin_bound: f64,
}

/// Scratch memory for a row, filled before its colours are.
#[derive(Default)]
pub struct LookupScratch {
    bin: Vec<u32>,
    share: Vec<f32>,
    /// What the pixels' polynomials give, by channel; the fourth channel fills a vector.
    sums: Vec<[f32; 4]>,
}

impl TaximLookup {
    /// Prepares a calibration for a view of `resolution_px` pixels. If that is not the calibration's resolution, its
    /// picture is stretched over the view.
    pub fn new(taxim: &TaximCalibration, resolution_px: [usize; 2]) -> Self {
        let [columns, rows] = [0, 1].map(|axis| {
            let scale = taxim.resolution_px[axis] as f64 / resolution_px[axis] as f64;
            (0..resolution_px[axis]).map(|at| ((at as f64 + 0.5) * scale - 0.5) as f32).collect()
        });
        let [red, green, blue] = &taxim.polynomials;
        let bin = |at: usize| std::array::from_fn(|term| [red[at][term], green[at][term], blue[at][term], 0.0]);
        let first = taxim.polynomials.iter().flat_map(|all| &all[..taxim.bins]);
        Self {
            table: (0..red.len()).map(bin).collect(),
            bins: taxim.bins,
            columns,
            rows,
            first_bin_bound: first.map(|polynomial| taxim.change_bound(polynomial)).fold(0.0, f64::max),
        }
    }

    /// Returns a slope, mm/mm, below which no channel changes by more than `levels` grey levels.
    pub fn unseen_slope(&self, levels: f64) -> f64 {
        let step = std::f64::consts::FRAC_PI_2 / (self.bins - 1) as f64;
        // This is an angle, which is smaller than its slope: the bound holds for the slope, too.
        step * if self.first_bin_bound > levels { levels / self.first_bin_bound } else { 1.0 }
    }

    /// Computes the change of red, green and blue along a part of row `y` that starts in column `x0`, in grey levels:
    /// exactly 0 where the slope is 0. `slopes` are those of the displacement into the pad, towards the right and down,
    /// mm/mm.
    #[inline(always)]
    pub fn compute_row_change(
        &self,
        y: usize,
        x0: usize,
        slopes: [&[f32]; 2],
        scratch: &mut LookupScratch,
        change: [&mut [f32]; 3],
    ) {
        let width = slopes[0].len();
        self.find_bins(slopes, scratch);
        let LookupScratch { bin, share, sums } = scratch;
        sums.resize(width, [0.0; 4]);
        let (bin, share, sums) = (&bin[..width], &share[..width], &mut sums[..width]);
        let columns = &self.columns[x0..][..width];
        let v = self.rows[y];
        for x in 0..width {
            let (u, [xx, yy, xy, along_x, along_y, constant]) = (columns[x], &self.table[bin[x] as usize]);
            sums[x] = std::array::from_fn(|channel| {
                let by_x = (xx[channel] * u + xy[channel] * v + along_x[channel]) * u;
                let by_y = (yy[channel] * v + along_y[channel]) * v;
                by_x + by_y + constant[channel]
            });
        }
        for (channel, change) in change.into_iter().enumerate() {
            let change = &mut change[..width];
            for x in 0..width {
                change[x] = sums[x][channel] * share[x];
            }
        }
    }

    /// Finds the bin of each pixel, and the fraction of its polynomial that counts.
    #[inline(always)]
    fn find_bins(&self, [right, down]: [&[f32]; 2], LookupScratch { bin, share, .. }: &mut LookupScratch) {
        let width = right.len();
        bin.resize(width, 0);
        share.resize(width, 0.0);
        let (bin, share, down) = (&mut bin[..width], &mut share[..width], &down[..width]);
        let steps = (self.bins - 1) as f32;
        let row = self.bins as u32;
        for x in 0..width {
            let (along, across) = (right[x], down[x]);
            let steepness = steps * quarter_turns(1.0, (along * along + across * across).sqrt());
            let turn = quarter_turns(along.abs(), across.abs());
            let turn = if along < 0.0 { 2.0 - turn } else { turn };
            let turn = if across < 0.0 { -turn } else { turn };
            let direction = steps * (0.5 + 0.25 * turn);
            let ((steepness_bin, _), (direction_bin, _)) = (split_fraction(steepness), split_fraction(direction));
            bin[x] = steepness_bin.min(row - 1) * row + direction_bin.min(row - 1);
            share[x] = if steepness < 1.0 { steepness } else { 1.0 };
        }
    }
}

/// Returns the angle from the axis of `x` to a point at `x` and `y`, neither of them negative, in quarters of a turn: 0
/// to 1, exact on both axes, elsewhere to 2e-7. At the origin it is 0. The polynomial is that of Cephes' `atanf`
/// (Moshier 1992).
#[inline(always)]
fn quarter_turns(x: f32, y: f32) -> f32 {
    /// tan(22.5 degrees).
    const HALF: f32 = 0.414_213_57;
    let steep = y > x;
    let (low, high) = if steep { (x, y) } else { (y, x) };
    // Past 22.5 degrees, the rest to 45 is computed.
    let past = low > HALF * high;
    let (above, below) = if past { (low - high, low + high) } else { (low, high) };
    let t = above / below.max(f32::MIN_POSITIVE);
    let z = t * t;
    let series = ((8.053_744_5e-2 * z - 1.387_768_6e-1) * z + 1.997_771_1e-1) * z - 3.333_295e-1;
    let start = if past { 0.5 } else { 0.0 };
    let eighth = start + (series * z * t + t) * std::f32::consts::FRAC_2_PI;
    if steep { 1.0 - eighth } else { eighth }
}
