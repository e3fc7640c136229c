//! Light that runs along a gel that is round about its axis: a sum over waves around it.

use std::f64::consts::{FRAC_PI_2, PI};

use glam::{DVec2, DVec3};

use crate::base::gel::{GelShape, Site};

use super::{LED_WIDTH_RAD, REACH, SPREAD};

/// Number of cells along the meridian, and around half of the gel.
const CELLS: [usize; 2] = [160, 120];

/// Number of waves around the axis.
const WAVES: usize = 64;

/// Directions of the light of an LED at azimuth 0.
pub struct HeatOnRound {
    shape: GelShape,
    /// Length of the meridian from the tip to the rim, in radii.
    length: f64,
    /// For each cell, in rows along the meridian: the direction towards the LED, of length 1 at most, in the axes of
    /// the tip taken along the meridian; and the distance from the LED, in radii.
    cells: Vec<[f64; 3]>,
    /// The same three numbers at the tip.
    tip: [f64; 3],
}

impl HeatOnRound {
    /// Solves for the light on a dome or a capsule.
    pub fn new(shape: &GelShape) -> Self {
        let length = FRAC_PI_2 + shape.wall_mm().unwrap_or(0.0) / shape.radius_mm();
        let step = length / CELLS[0] as f64;
        let waves: Vec<Vec<f64>> = (0..WAVES).map(|wave| solve_along_meridian(wave as f64, step)).collect();
        let angle = |column: usize| PI * column as f64 / CELLS[1] as f64;
        let around = |column: usize| (0..WAVES).map(move |wave| libm::sincos(wave as f64 * angle(column))).collect();
        let around: Vec<Vec<(f64, f64)>> = (0..=CELLS[1]).map(around).collect();
        let density = |row: usize, column: usize| {
            let mut sums = [0.0; 3];
            for (wave, (along, (sin, cos))) in waves.iter().zip(&around[column]).enumerate() {
                // Across the tip a wave goes on as on its other side: even ones upright, odd ones upside down.
                let inner = if row > 0 {
                    along[row - 1]
                } else if wave % 2 == 0 {
                    along[0]
                } else {
                    -along[0]
                };
                let slope = (along[row + 1] - inner) / (2.0 * step);
                sums[0] += along[row] * cos;
                sums[1] += slope * cos;
                sums[2] -= wave as f64 * along[row] * sin / cell_radius(row, step);
            }
            sums
        };
        let at_led = density(CELLS[0] - 1, 0)[0];
        let mut cells = Vec::with_capacity(CELLS[0] * (CELLS[1] + 1));
        for row in 0..CELLS[0] {
            for column in 0..=CELLS[1] {
                let [density, outwards, around] = density(row, column);
                let density = density.max(f64::MIN_POSITIVE);
                let towards = (REACH / (SPREAD * density) * DVec2::new(outwards, around)).clamp_length_max(1.0);
                let towards = DVec2::from_angle(angle(column)).rotate(towards);
                cells.push([towards.x, towards.y, (-REACH * libm::log(density / at_led)).max(0.0)]);
            }
        }
        let first = &cells[..CELLS[1]];
        let tip = [0, 2].map(|k| first.iter().map(|cell| cell[k]).sum::<f64>() / CELLS[1] as f64);
        Self { shape: shape.clone(), length, cells, tip: [tip[0], 0.0, tip[1]] }
    }

    /// Returns the direction along the gel towards an LED at an azimuth, rad, of length 1 at most, and how far it is,
    /// mm.
    pub fn direction_and_distance_mm(&self, site: Site, azimuth: f64) -> (DVec3, f64) {
        let Site { normal, below_mm, .. } = site;
        let around = libm::atan2(normal.y, normal.x) - azimuth;
        let around = around - 2.0 * PI * libm::round(around / (2.0 * PI));
        let across = libm::hypot(normal.x, normal.y);
        let from_tip = libm::atan2(across, normal.z.max(0.0)) + below_mm / self.shape.radius_mm();
        let [x, y, distance] = self.interpolate(from_tip, around.abs());
        let towards = DVec2::from_angle(-around).rotate(DVec2::new(x, if around < 0.0 { -y } else { y }));
        let [sin, cos] = if across > 0.0 { [normal.y / across, normal.x / across] } else { [0.0, 1.0] };
        let (level, out) = if below_mm > 0.0 { (0.0, 1.0) } else { (normal.z.max(0.0), across) };
        let outwards = DVec3::new(level * cos, level * sin, -out);
        let sideways = DVec3::new(-sin, cos, 0.0);
        (towards.x * outwards + towards.y * sideways, distance * self.shape.radius_mm())
    }

    /// Interpolates between the cells, bilinear.
    fn interpolate(&self, from_tip: f64, around: f64) -> [f64; 3] {
        let row = (from_tip / self.length * CELLS[0] as f64 - 0.5).min((CELLS[0] - 1) as f64);
        let column = (around / PI * CELLS[1] as f64).clamp(0.0, CELLS[1] as f64);
        let (upper, left) = ((row as usize).min(CELLS[0] - 2), (column as usize).min(CELLS[1] - 1));
        let (down, right) = (row - upper as f64, column - left as f64);
        let cell = |row: usize, column: usize| self.cells[row * (CELLS[1] + 1) + column];
        std::array::from_fn(|k| {
            let line = |row: usize| cell(row, left)[k] + right * (cell(row, left + 1)[k] - cell(row, left)[k]);
            match row < 0.0 {
                // The tip is half a cell away from the first row.
                true => line(0) - 2.0 * row * (self.tip[k] - line(0)),
                false => line(upper) + down * (line(upper + 1) - line(upper)),
            }
        })
    }
}

/// Returns the distance of the middle of a cell from the axis, in radii of the gel.
fn cell_radius(row: usize, step: f64) -> f64 {
    radius_from_axis((row as f64 + 0.5) * step)
}

/// Returns the distance from the axis by that from the tip along the meridian, both in radii of the gel; a wall is 1
/// from the axis.
fn radius_from_axis(from_tip: f64) -> f64 {
    libm::sin(from_tip.min(FRAC_PI_2))
}

/// Solves for a wave's density in the cells along the meridian, and in one more beyond the rim.
///
/// The equation is (r u')' = (wave^2 / r + r / reach^2) u, by finite volumes, from the tip outwards. No light leaves by
/// the rim, and the LED's comes in there.
fn solve_along_meridian(wave: f64, step: f64) -> Vec<f64> {
    let source =
        libm::exp(-0.5 * (wave * LED_WIDTH_RAD) * (wave * LED_WIDTH_RAD)) * if wave == 0.0 { 0.5 } else { 1.0 };
    // The density in each cell as a fraction of that in the next one outwards.
    let mut shares: Vec<f64> = Vec::with_capacity(CELLS[0]);
    let mut density = vec![0.0; CELLS[0] + 1];
    for (row, density) in density.iter_mut().enumerate().take(CELLS[0]) {
        let here = cell_radius(row, step);
        let (inner, outer) = (radius_from_axis(row as f64 * step), radius_from_axis((row + 1) as f64 * step));
        let lost = step * step * (wave * wave / here + here / (REACH * REACH));
        let from_inner = shares.last().map_or(0.0, |share| inner * (1.0 - share));
        shares.push(outer / (outer + lost + from_inner));
        *density = step * source / (lost + from_inner);
    }
    density[CELLS[0]] = density[CELLS[0] - 1] + step * source;
    for row in (0..CELLS[0] - 1).rev() {
        density[row] = shares[row] * density[row + 1];
    }
    density
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::gel::{GelCapsule, GelDome};

    /// On a dome the way from the rim is a great circle, wherever the opposite rim is farther away.
    #[test]
    fn on_a_dome_light_comes_along_great_circles() {
        let shape = GelShape::Dome(GelDome { radius_mm: 12.0 });
        let heat = HeatOnRound::new(&shape);
        let led = DVec3::X;
        let mut worst = 1.0_f64;
        for from_tip in [0.05, 0.3, 0.7, 1.0, 1.3] {
            for around in [0.0, 0.5, 1.0, 1.6, 2.2, -0.7, -1.9] {
                let normal = DVec3::new(
                    libm::sin(from_tip) * libm::cos(around),
                    libm::sin(from_tip) * libm::sin(around),
                    libm::cos(from_tip),
                );
                let (towards, distance_mm) = heat.direction_and_distance_mm(shape.site(normal, 0.0), 0.0);
                let angle = normal.angle_between(led);
                let circle = (led - normal * normal.dot(led)).normalize();
                assert!(towards.dot(normal).abs() < 1e-9 && towards.length() < 1.0 + 1e-9);
                if angle > 0.5 {
                    assert!(towards.length() > 0.7, "{from_tip} {around}: {towards}");
                    worst = worst.min(towards.normalize().dot(circle));
                    assert!((distance_mm / 12.0 - angle).abs() < 0.2, "{from_tip} {around}: {distance_mm}");
                }
            }
        }
        println!("farthest from a great circle: {:.1} degrees", libm::acos(worst).to_degrees());
        assert!(worst > libm::cos(f64::to_radians(10.0)));
    }

    #[test]
    fn opposite_the_led_light_comes_from_both_sides_without_a_step() {
        let shape = GelShape::Capsule(GelCapsule { radius_mm: 10.0, length_mm: 45.0 });
        let heat = HeatOnRound::new(&shape);
        let at = |around: f64, below_mm: f64| {
            heat.direction_and_distance_mm(
                shape.site(DVec3::new(libm::cos(around), libm::sin(around), 0.0), below_mm),
                0.3,
            )
            .0
        };
        for below_mm in [0.0, 10.0, 30.0] {
            let steps: Vec<DVec3> = (0..=400).map(|k| at(PI * k as f64 / 200.0 + 0.1, below_mm)).collect();
            let largest = steps.windows(2).map(|pair| (pair[1] - pair[0]).length()).fold(0.0, f64::max);
            assert!(largest < 0.15, "{below_mm}: {largest}");
            let opposite = at(PI + 0.3, below_mm);
            assert!(opposite.truncate().length() < 1e-6, "{opposite}");
        }
        // The tip is lit from the LED's side, whichever way one comes to it.
        for around in [0.0, 2.0, 4.0] {
            let normal = DVec3::new(1e-3 * libm::cos(around), 1e-3 * libm::sin(around), 1.0).normalize();
            let (towards, _) = heat.direction_and_distance_mm(shape.site(normal, 0.0), 0.3);
            assert!(towards.angle_between(DVec3::new(libm::cos(0.3), libm::sin(0.3), 0.0)) < 0.02, "{towards}");
        }
    }
}
