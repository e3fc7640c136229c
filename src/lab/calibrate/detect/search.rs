//! A first guess for the disc: the one in which the change is most like a slope, with a direction for each of red,
//! green and blue. Sums along rows make the cost of a disc proportional to its height.

use super::change::BlockChange;
use crate::presses::Circle;
use gelsim_core::base::grid::Grid;

/// Radii to try, in blocks.
const RADII: [f64; 9] = [2.5, 3.5, 5.0, 7.0, 9.5, 13.0, 17.0, 22.0, 28.0];

/// Returns the best disc of each radius, in blocks, the best first. Empty if the picture is too small for a disc.
pub(super) fn search_discs(change: &BlockChange) -> Vec<Circle> {
    let sums = RowSums::new(&change.levels);
    let smaller = change.levels.width.min(change.levels.height) as f64;
    let radii = RADII.iter().filter(|radius| **radius < 0.6 * smaller);
    let mut best: Vec<(f64, Circle)> = radii.filter_map(|radius| sums.find_best_disc(*radius)).collect();
    best.sort_by(|a, b| b.0.total_cmp(&a.0));
    best.into_iter().map(|(_, circle)| circle).collect()
}

/// Sums along each row, up to each column x, of the change and of x times the change.
struct RowSums {
    size: [usize; 2],
    plain: Grid<[f64; 3]>,
    sloped: Grid<[f64; 3]>,
}

impl RowSums {
    fn new(levels: &Grid<[f32; 3]>) -> Self {
        let size = [levels.width, levels.height];
        let mut sums = Self { size, plain: Grid::new(size[0] + 1, size[1]), sloped: Grid::new(size[0] + 1, size[1]) };
        for y in 0..size[1] {
            let (plain, sloped) = (sums.plain.row_mut(y), sums.sloped.row_mut(y));
            for (x, level) in levels.row(y).iter().enumerate() {
                for k in 0..3 {
                    plain[x + 1][k] = plain[x][k] + f64::from(level[k]);
                    sloped[x + 1][k] = sloped[x][k] + x as f64 * f64::from(level[k]);
                }
            }
        }
        sums
    }

    /// Finds the disc of this radius with the steepest change.
    fn find_best_disc(&self, radius: f64) -> Option<(f64, Circle)> {
        let stride = ((radius / 4.0) as usize).max(1);
        let centres = (0..self.size[1])
            .step_by(stride)
            .flat_map(|y| (0..self.size[0]).step_by(stride).map(move |x| [x as f64, y as f64]));
        centres
            .map(|centre_px| (self.slope_energy(centre_px, radius), Circle { centre_px, radius_px: radius }))
            .max_by(|a, b| a.0.total_cmp(&b.0))
    }

    /// Energy that a plane explains of the change in the disc besides its mean, grey levels squared.
    fn slope_energy(&self, centre: [f64; 2], radius: f64) -> f64 {
        let [width, height] = self.size.map(|size| size as f64);
        let (mut n, mut u, mut v, mut uu, mut uv, mut vv) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
        let (mut mean, mut along_u, mut along_v) = ([0.0; 3], [0.0; 3], [0.0; 3]);
        let (top, bottom) = ((centre[1] - radius).ceil().max(0.0), (centre[1] + radius).floor().min(height - 1.0));
        for y in top as usize..=bottom as usize {
            let dy = y as f64 - centre[1];
            let reach = (radius * radius - dy * dy).max(0.0).sqrt();
            let (first, last) = ((centre[0] - reach).ceil().max(0.0), (centre[0] + reach).floor().min(width - 1.0));
            if first > last {
                continue;
            }
            let (count, middle) = (last - first + 1.0, 0.5 * (first + last) - centre[0]);
            n += count;
            u += count * middle;
            v += count * dy;
            uu += count * (middle * middle + (count * count - 1.0) / 12.0);
            uv += count * middle * dy;
            vv += count * dy * dy;
            let (from, to) = (first as usize, last as usize + 1);
            let (plain, sloped) = (self.plain.row(y), self.sloped.row(y));
            for k in 0..3 {
                let sum = plain[to][k] - plain[from][k];
                mean[k] += sum;
                along_u[k] += sloped[to][k] - sloped[from][k] - centre[0] * sum;
                along_v[k] += dy * sum;
            }
        }
        let (uu, uv, vv) = (uu - u * u / n, uv - u * v / n, vv - v * v / n);
        let determinant = uu * vv - uv * uv;
        // A sliver of a disc at the border has no slope in one direction.
        if n < 6.0 || determinant <= 1e-9 * uu * vv {
            return 0.0;
        }
        let explained = |k: usize| {
            let (a, b) = (along_u[k] - u * mean[k] / n, along_v[k] - v * mean[k] / n);
            (vv * a * a - 2.0 * uv * a * b + uu * b * b) / determinant
        };
        (0..3).map(explained).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A place and its levels.
    type Pixel = (f64, f64, [f64; 3]);

    /// Slow reference implementation: the plane is found by solving the normal equations of all pixels.
    fn plain_slope(levels: &Grid<[f32; 3]>, centre: [f64; 2], radius: f64) -> f64 {
        let mut pixels = Vec::new();
        for y in 0..levels.height {
            for x in 0..levels.width {
                let (u, v) = (x as f64 - centre[0], y as f64 - centre[1]);
                if u * u + v * v <= radius * radius {
                    pixels.push((u, v, levels.at(x, y).map(f64::from)));
                }
            }
        }
        let n = pixels.len() as f64;
        let mean = |value: &dyn Fn(&Pixel) -> f64| pixels.iter().map(value).sum::<f64>() / n;
        let (u, v) = (mean(&|p| p.0), mean(&|p| p.1));
        let (uu, uv) = (mean(&|p| (p.0 - u) * (p.0 - u)), mean(&|p| (p.0 - u) * (p.1 - v)));
        // Gram and Schmidt: the second direction without the first.
        let second = |p: &Pixel| p.1 - v - uv / uu * (p.0 - u);
        let (ww, mut sum) = (mean(&|p| second(p) * second(p)), 0.0);
        for k in 0..3 {
            let (a, b) = (mean(&|p| (p.0 - u) * p.2[k]), mean(&|p| second(p) * p.2[k]));
            sum += n * (a * a / uu + b * b / ww);
        }
        sum
    }

    #[test]
    fn the_slope_from_sums_is_that_from_pixels_also_at_the_border() {
        let mut levels = Grid::<[f32; 3]>::new(23, 17);
        for (i, level) in levels.data.iter_mut().enumerate() {
            *level = [(i * 7 % 13) as f32, (i * 5 % 11) as f32 - 4.0, (i * i % 17) as f32];
        }
        let sums = RowSums::new(&levels);
        for (centre, radius) in [([10.0, 8.0], 5.0), ([0.0, 3.0], 6.5), ([22.0, 16.0], 4.0), ([11.0, 0.0], 2.5)] {
            let (quick, plain) = (sums.slope_energy(centre, radius), plain_slope(&levels, centre, radius));
            assert!((quick - plain).abs() < 1e-9 * plain, "{quick} instead of {plain}");
        }
    }
}
