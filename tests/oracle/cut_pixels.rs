//! Pixels of a coarse grid that walls of the object cut, in f64, pixel by pixel.

use std::f64::consts::PI;

use gelsim::core::base::grid::Grid;

/// A pixel that a wall cuts.
pub struct Cut {
    /// Of the coarse grid.
    pub at: usize,
    /// mm under pressure 1.
    pub compliance: f64,
    /// Pressure above which it is as deep as the object at its centre.
    pub most: f64,
    /// How much lower that is, mm.
    pub beside: f64,
}

/// The overlap on pixels `factor / 2`, `factor / 2 + factor`, .. of `fine`, and which of them walls cut. `own` is the
/// displacement of a coarse pixel under pressure 1 on itself, mm; `pitch` that of the fine grid.
pub fn cut(fine: &Grid<f64>, factor: usize, pitch: f64, own: f64) -> (Grid<f64>, Vec<Cut>) {
    let half = factor as isize / 2;
    let solved = |size: usize| (factor / 2..size).step_by(factor).collect::<Vec<_>>();
    let (columns, rows) = (solved(fine.width), solved(fine.height));
    let (mut data, mut cuts) = (Vec::new(), Vec::new());
    let unit = own / 0.561;
    for &y in &rows {
        for &x in &columns {
            let at = |dx: isize, dy: isize| {
                let (x, y) = (x as isize + dx, y as isize + dy);
                let inside = x >= 0 && y >= 0 && x < fine.width as isize && y < fine.height as isize;
                inside.then(|| fine.at(x as usize, y as usize).max(0.0))
            };
            let around: Vec<(isize, isize, f64)> = (-half..=half)
                .flat_map(|dy| (-half..=half).map(move |dx| (dx, dy)))
                .filter_map(|(dx, dy)| Some((dx, dy, at(dx, dy)?)))
                .collect();
            let most = around.iter().fold(f64::NEG_INFINITY, |most, it| most.max(it.2));
            let least = around.iter().fold(f64::INFINITY, |least, it| least.min(it.2));
            let mut steepest = 0.0_f64;
            for (dx, dy, g) in &around {
                for (right, down) in [(1, 0), (0, 1)] {
                    if let Some((_, _, next)) = around.iter().find(|it| it.0 == dx + right && it.1 == dy + down) {
                        steepest = steepest.max((g - next).abs() / (2.0 * pitch));
                    }
                }
            }
            let wall = (steepest - 1.0).clamp(0.0, 1.0);
            let (face, centre) = (0.5 * (most + least), fine.at(x, y).max(0.0));
            let half_at_border = |d: isize| if d.abs() == half { 0.5 } else { 1.0 };
            let share = |dx: isize, dy: isize| half_at_border(dx) * half_at_border(dy);
            let whole: f64 = around.iter().map(|it| share(it.0, it.1)).sum();
            let on: Vec<_> = around.iter().filter(|it| it.2 > face).collect();
            let covered: f64 = on.iter().map(|it| share(it.0, it.1)).sum();
            let c = covered / whole;
            if most <= 0.0 || wall == 0.0 || on.len() == around.len() {
                data.push(fine.at(x, y));
                continue;
            }
            let mean: f64 = on.iter().map(|it| share(it.0, it.1) * it.2).sum::<f64>() / covered;
            let side = |sum: f64| if sum < 0.0 { -(factor as isize) } else { factor as isize };
            let right = side(on.iter().map(|it| share(it.0, it.1) * it.0 as f64).sum());
            let down = side(on.iter().map(|it| share(it.0, it.1) * it.1 as f64).sum());
            let goes_on =
                [(right, 0), (0, down), (right, down)].iter().any(|(x, y)| at(*x, *y).is_some_and(|g| g > face));
            let gives = if goes_on { 0.911 * (1.0 - c) / c } else { ((4.0 / c).ln() / PI - 0.539).max(0.0) };
            let beside = if centre > face { 0.0 } else { wall * (mean - centre) };
            let drop = 1.07 * unit * (1.0 - c).max(0.25).sqrt() / c;
            let most = if least > 0.0 { (centre + beside - least) / drop } else { f64::INFINITY };
            cuts.push(Cut { at: data.len(), compliance: wall * unit * gives, most, beside });
            data.push(centre + beside);
        }
    }
    (Grid { width: columns.len(), height: rows.len(), data }, cuts)
}
