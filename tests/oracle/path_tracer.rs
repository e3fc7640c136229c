//! Light of rows of LEDs in a slab of gel, followed path by path in f64: from the LEDs to the coat, by way of the window,
//! and from coat to coat (Kajiya 1986). The camera is infinitely far and sees through the window.
//!
//! Places are in mm from the middle of the view: x to the right, y down, z towards the camera. The coat is a height map,
//! bilinear between pixels; normals are centred differences, interpolated. An LED is an even rectangle. The coat reflects
//! towards the camera as Phong's surface does, and scatters alike in all directions onto itself. Walls are black.

use std::f64::consts::TAU;

use gelsim_core::base::grid::Grid;
use gelsim_core::base::view::{SURFACE_BORDER, View};
use gelsim_core::optics::led::Led;
use gelsim_core::optics::near_light::window::{Window, fresnel};
use gelsim_core::optics::phong::Phong;
use rayon::prelude::*;

use super::vectors::{Vector, along, cross, dot, unit};

/// Rays start so far off the surface, mm.
const OFF_MM: f64 = 2e-4;
/// Pixels to a side of the blocks whose highest points are known.
const BLOCK: usize = 8;

/// An even rectangle that shines.
struct Panel {
    middle: Vector,
    /// From its middle to its end along the row, and to its upper edge.
    half: [Vector; 2],
    aim: Vector,
    lobe: f64,
    /// Colour times intensity, over what reaches the middle of the view.
    power: [f64; 3],
}

impl Panel {
    fn new(led: &Led) -> Self {
        let place = led.place();
        let flip = |[x, y, z]: Vector| [x, y, -z];
        let middle = flip(place.direction.map(|v| v * place.distance_mm));
        let aim = flip(place.direction).map(|v| -v);
        let (sin, cos) = place.azimuth;
        let row = [-sin, cos, 0.0];
        let up =
            [row[1] * aim[2] - row[2] * aim[1], row[2] * aim[0] - row[0] * aim[2], row[0] * aim[1] - row[1] * aim[0]];
        let [width, height] = led.size_mm.expect("rows have a size");
        let half = [row.map(|v| 0.5 * width * v), up.map(|v| 0.5 * height * v)];
        let mut panel = Self { middle, half, aim, lobe: led.lobe, power: [1.0; 3] };
        let steps = (0..400).map(|k| {
            let [u, v] = [k % 20, k / 20].map(|k| (f64::from(k) + 0.5) / 10.0 - 1.0);
            let at = panel.point(u, v);
            panel.sent(unit(at.map(|v| -v))) / dot(at, at)
        });
        let in_middle = steps.sum::<f64>() / 400.0;
        panel.power = led.color.map(|share| share * led.intensity / in_middle);
        panel
    }

    fn point(&self, u: f64, v: f64) -> Vector {
        along(along(self.middle, self.half[0], u), self.half[1], v)
    }

    /// What it sends in a direction.
    fn sent(&self, direction: Vector) -> f64 {
        let cosine = dot(direction, self.aim);
        if self.lobe == 0.0 { 1.0 } else { cosine.max(0.0).powf(self.lobe) }
    }
}

/// Light of a pixel by its way, for each channel.
#[derive(Clone, Copy, Debug, Default)]
pub struct Ways {
    /// From the LEDs.
    pub direct: [f64; 3],
    /// From the LEDs by way of the window.
    pub mirrored: [f64; 3],
    /// From coat to coat.
    pub bounced: [f64; 3],
    /// From coat to coat by way of the window, before or after.
    pub bounced_and_mirrored: [f64; 3],
}

impl Ways {
    /// The sum over all ways.
    pub fn all(&self) -> [f64; 3] {
        std::array::from_fn(|k| self.direct[k] + self.mirrored[k] + self.bounced[k] + self.bounced_and_mirrored[k])
    }

    fn add(&mut self, way: usize, light: [f64; 3]) {
        let sums = [&mut self.direct, &mut self.mirrored, &mut self.bounced, &mut self.bounced_and_mirrored];
        for (sum, light) in sums.into_iter().nth(way).expect("there are four").iter_mut().zip(light) {
            *sum += light;
        }
    }
}

/// A press under its LEDs.
pub struct Scene {
    panels: Vec<Panel>,
    /// Colour times intensity of each.
    colors: Vec<[f64; 3]>,
    window: Option<Window>,
    /// Half the width and height of the slab, mm: paths end at its walls.
    half_mm: [f64; 2],
    albedo: f64,
    phong: Phong,
    view: View,
    heights: Grid<f64>,
    slopes: [Grid<f64>; 2],
    highest: Grid<f64>,
    range_mm: [f64; 2],
}

impl Scene {
    /// `surface` is on the grid of a contact.
    pub fn new(
        leds: &[Led],
        window: Option<Window>,
        albedo: f64,
        phong: Phong,
        view: View,
        surface: &Grid<f32>,
    ) -> Self {
        let heights = Grid {
            width: surface.width,
            height: surface.height,
            data: surface.data.iter().map(|mm| f64::from(*mm)).collect::<Vec<f64>>(),
        };
        let slope = |dx: usize, dy: usize, pixel_mm: f64| {
            let mut slopes: Grid<f64> = Grid::new(heights.width, heights.height);
            for y in 0..heights.height {
                for x in 0..heights.width {
                    let before = heights.at(x.saturating_sub(dx), y.saturating_sub(dy));
                    let after = heights.at((x + dx).min(heights.width - 1), (y + dy).min(heights.height - 1));
                    let steps = (x + dx).min(heights.width - 1) - x.saturating_sub(dx)
                        + (y + dy).min(heights.height - 1)
                        - y.saturating_sub(dy);
                    slopes.row_mut(y)[x] = (after - before) / (steps as f64 * pixel_mm);
                }
            }
            slopes
        };
        let slopes = [slope(1, 0, view.mm_per_px[0]), slope(0, 1, view.mm_per_px[1])];
        let (columns, rows) = (heights.width.div_ceil(BLOCK), heights.height.div_ceil(BLOCK));
        let mut highest = Grid { width: columns, height: rows, data: vec![f64::MIN; columns * rows] };
        for y in 0..rows {
            for x in 0..columns {
                // With the neighbours that interpolation and a step beyond the border reach.
                let near = |at: usize, size: usize| (at * BLOCK).saturating_sub(2)..((at + 1) * BLOCK + 2).min(size);
                let all = near(y, heights.height).flat_map(|y| near(x, heights.width).map(move |x| (x, y)));
                highest.row_mut(y)[x] = all.map(|(x, y)| heights.at(x, y)).fold(f64::MIN, f64::max);
            }
        }
        let range_mm = heights.data.iter().fold([f64::MAX, f64::MIN], |[low, high], mm| [low.min(*mm), high.max(*mm)]);
        let panels: Vec<Panel> = leds.iter().map(Panel::new).collect();
        let half_mm = [0, 1].map(|k| {
            let view_mm = 0.5 * view.resolution_px[k] as f64 * view.mm_per_px[k];
            panels.iter().map(|panel| panel.middle[k].abs() + panel.half[0][k].abs() + 0.5).fold(view_mm, f64::max)
        });
        let colors = leds.iter().map(|led| led.color.map(|share| share * led.intensity)).collect();
        Self { panels, colors, window, half_mm, albedo, phong, view, heights, slopes, highest, range_mm }
    }

    /// Describes the scene for another program (`mitsuba_light.py`).
    pub fn describe(&self) -> serde_json::Value {
        let leds = self.panels.iter().zip(&self.colors).map(|(panel, color)| {
            serde_json::json!({
                "middle": panel.middle, "along": panel.half[0], "up": panel.half[1], "aim": panel.aim, "color": color,
            })
        });
        let window = self.window.as_ref().expect("a scene with a window");
        serde_json::json!({
            "width": self.heights.width, "height": self.heights.height, "heights": self.heights.data,
            "mm_per_px": self.view.mm_per_px, "leds": leds.collect::<Vec<_>>(), "albedo": self.albedo,
            "diffuse": self.phong.diffuse, "window_mm": window.distance_mm,
            "refractive_index": window.refractive_index,
        })
    }

    /// Traces every `stride`th pixel by `paths` paths of up to `bounces` bounces.
    pub fn trace(&self, stride: usize, paths: u32, bounces: usize) -> Grid<Ways> {
        let [width, height] = self.view.resolution_px.map(|px| px / stride);
        let pixel = |number: usize| {
            let [x, y] = [number % width, number / width].map(|at| at * stride + stride / 2);
            let [x, y] = self.view.point_mm([x as f64 + 0.5, y as f64 + 0.5]);
            self.trace_pixel([x, y], number as u32, paths, bounces)
        };
        Grid { width, height, data: (0..width * height).into_par_iter().map(pixel).collect() }
    }

    fn trace_pixel(&self, [x, y]: [f64; 2], number: u32, paths: u32, bounces: usize) -> Ways {
        let mut ways = Ways::default();
        for path in 0..paths {
            let mut random = Random { pixel: hash(number), path, dimension: 0 };
            let mut at = [x, y, self.interpolated(&self.heights, x, y)];
            let mut view = [0.0, 0.0, 1.0];
            let (mut weight, mut by_window) = (1.0 / f64::from(paths), false);
            for bounce in 0..=bounces {
                let normal = self.normal(at);
                for panel in &self.panels {
                    let source = panel.point(2.0 * random.next() - 1.0, 2.0 * random.next() - 1.0);
                    for mirrored in [false, true] {
                        let light = self.light_from(panel, source, mirrored, at, normal, view, bounce == 0);
                        let way = match (bounce, mirrored || by_window) {
                            (0, _) => usize::from(mirrored),
                            (_, via_window) => 2 + usize::from(via_window),
                        };
                        ways.add(way, panel.power.map(|power| power * light * weight));
                    }
                }
                if bounce == bounces {
                    break;
                }
                // A direction by the cosine to the normal.
                let (u, turn) = (random.next(), TAU * random.next());
                let (across, up) = (u.sqrt(), (1.0 - u).max(1e-9).sqrt());
                let aside = if normal[2].abs() < 0.9 { [0.0, 0.0, 1.0] } else { [1.0, 0.0, 0.0] };
                let first = unit(cross(aside, normal));
                let second = cross(normal, first);
                let direction: Vector =
                    std::array::from_fn(|k| across * (turn.cos() * first[k] + turn.sin() * second[k]) + up * normal[k]);
                weight *= match bounce {
                    // What the camera sees of light from there: diffuse, and Phong's highlight, which has no cosine.
                    0 => {
                        let mirrored = 2.0 * dot(normal, direction) * normal[2] - direction[2];
                        self.phong.diffuse
                            + self.phong.specular * mirrored.max(0.0).powf(self.phong.shininess) / up.max(0.05)
                    }
                    _ => self.albedo,
                };
                let Some((place, from, share, via_window)) = self.follow(along(at, normal, OFF_MM), direction) else {
                    break;
                };
                // At the first bounce the light of the coat there is what it scatters.
                weight *= share * if bounce == 0 { self.albedo } else { 1.0 };
                by_window |= via_window;
                (at, view) = (place, from);
            }
        }
        ways
    }

    /// The light from a place of a panel at a place of the coat: towards the camera (`seen`), or received.
    #[allow(clippy::too_many_arguments)]
    fn light_from(
        &self,
        panel: &Panel,
        source: Vector,
        mirrored: bool,
        at: Vector,
        normal: Vector,
        view: Vector,
        seen: bool,
    ) -> f64 {
        let window_mm = match (&self.window, mirrored) {
            (Some(window), _) => window.distance_mm,
            (None, false) => f64::INFINITY,
            (None, true) => return 0.0,
        };
        let target = if mirrored { [source[0], source[1], 2.0 * window_mm - source[2]] } else { source };
        let way = along(target, at, -1.0);
        let length = dot(way, way).sqrt();
        let direction = way.map(|v| v / length);
        let cosine = dot(normal, direction);
        if cosine <= 0.0 {
            return 0.0;
        }
        let sent = panel.sent([-direction[0], -direction[1], if mirrored { direction[2] } else { -direction[2] }]);
        if sent == 0.0 {
            return 0.0;
        }
        let (start, mut share) = (along(at, normal, OFF_MM), 1.0);
        if mirrored {
            let to_window = (window_mm - at[2]) / direction[2];
            let there = along(at, direction, to_window);
            if there[0].abs() > self.half_mm[0] || there[1].abs() > self.half_mm[1] {
                return 0.0;
            }
            share = fresnel(self.window.as_ref().expect("it is there").refractive_index, direction[2]);
            let down = [direction[0], direction[1], -direction[2]];
            if self.meets(start, direction, to_window).is_some()
                || self.meets(there, down, length - to_window).is_some()
            {
                return 0.0;
            }
        } else if self.meets(start, direction, length).is_some() {
            return 0.0;
        }
        let reflected = match seen {
            true => {
                let highlight = 2.0 * cosine * dot(normal, view) - dot(direction, view);
                self.phong.diffuse * cosine + self.phong.specular * highlight.max(0.0).powf(self.phong.shininess)
            }
            false => cosine,
        };
        sent * share * reflected / (length * length)
    }

    /// Follows a ray to the coat, by way of the window where that reflects it: where it ends, whence it comes, the share
    /// that arrives and whether it met the window.
    fn follow(&self, mut from: Vector, mut direction: Vector) -> Option<(Vector, Vector, f64, bool)> {
        let (mut share, mut by_window) = (1.0, false);
        for _ in 0..8 {
            let to_wall = |k: usize| ((self.half_mm[k] * direction[k].signum() - from[k]) / direction[k]).max(0.0);
            let to_side = to_wall(0).min(to_wall(1));
            let window = self.window.as_ref().filter(|_| direction[2] > 0.0);
            let to_window = window.map_or(f64::INFINITY, |window| (window.distance_mm - from[2]) / direction[2]);
            if let Some(t) = self.meets(from, direction, to_window.min(to_side)) {
                let place = along(from, direction, t);
                let back = direction.map(|v| -v);
                return (dot(self.normal(place), back) > 0.0).then_some((place, back, share, by_window));
            }
            if to_side < to_window || to_window.is_infinite() {
                return None;
            }
            share *= fresnel(window?.refractive_index, direction[2]);
            if share < 1e-4 {
                return None;
            }
            by_window = true;
            from = along(from, direction, to_window * 0.999_999);
            direction[2] = -direction[2];
        }
        None
    }

    fn interpolated(&self, of: &Grid<f64>, x: f64, y: f64) -> f64 {
        let place = |mm: f64, k: usize, size: usize| {
            let px =
                mm / self.view.mm_per_px[k] + 0.5 * self.view.resolution_px[k] as f64 - 0.5 + SURFACE_BORDER as f64;
            let px = px.clamp(0.0, size as f64 - 1.000_001);
            (px as usize, px.fract())
        };
        let ((i, u), (j, v)) = (place(x, 0, of.width), place(y, 1, of.height));
        let row = |j: usize| of.at(i, j) * (1.0 - u) + of.at(i + 1, j) * u;
        row(j) * (1.0 - v) + row(j + 1) * v
    }

    fn normal(&self, [x, y, _]: Vector) -> Vector {
        unit([-self.interpolated(&self.slopes[0], x, y), -self.interpolated(&self.slopes[1], x, y), 1.0])
    }

    /// Where a ray meets the coat first, before `most`.
    fn meets(&self, from: Vector, direction: Vector, most: f64) -> Option<f64> {
        let [low, high] = self.range_mm;
        let (mut start, mut end) = (0.0_f64, most);
        if direction[2] > 0.0 {
            end = end.min((high - from[2]) / direction[2]);
        } else if direction[2] < 0.0 {
            start = start.max((high - from[2]) / direction[2]);
            end = end.min((low - 1e-4 - from[2]) / direction[2]);
        } else if from[2] > high {
            return None;
        }
        let pixel_mm = self.view.mm_per_px[0].min(self.view.mm_per_px[1]);
        let across = direction[0].hypot(direction[1]).max(1e-6);
        let (small, large) = (0.7 * pixel_mm / across, BLOCK as f64 * pixel_mm / across);
        let below = |t: f64| {
            let at = along(from, direction, t);
            at[2] < self.interpolated(&self.heights, at[0], at[1])
        };
        let (mut t, mut before) = (start, start);
        while t < end {
            let at = along(from, direction, t);
            let block = |mm: f64, k: usize, count: usize| {
                let px = mm / self.view.mm_per_px[k] + 0.5 * self.view.resolution_px[k] as f64 + SURFACE_BORDER as f64;
                ((px.max(0.0) as usize) / BLOCK).min(count - 1)
            };
            let (x, y) = (block(at[0], 0, self.highest.width), block(at[1], 1, self.highest.height));
            let next = (t + large).min(end);
            let lowest = at[2].min(from[2] + direction[2] * next);
            // A long step may end in a neighbour of the block.
            let around = (y.saturating_sub(1)..(y + 2).min(self.highest.height))
                .flat_map(|y| (x.saturating_sub(1)..(x + 2).min(self.highest.width)).map(move |x| (x, y)));
            if lowest > around.map(|(x, y)| self.highest.at(x, y)).fold(f64::MIN, f64::max) {
                (before, t) = (next, next);
                continue;
            }
            while t < next {
                t = (t + small).min(next);
                if below(t) {
                    let (mut above, mut under) = (before, t);
                    for _ in 0..10 {
                        let middle = 0.5 * (above + under);
                        if below(middle) { under = middle } else { above = middle }
                    }
                    return Some(above);
                }
                before = t;
            }
        }
        None
    }
}

/// Mixes the bits of a number.
fn hash(mut x: u32) -> u32 {
    x = (x ^ (x >> 16)).wrapping_mul(0x7feb_352d);
    x = (x ^ (x >> 15)).wrapping_mul(0x846c_a68b);
    x ^ (x >> 16)
}

/// Even numbers from 0 to 1: a Kronecker sequence in each dimension, shifted from pixel to pixel.
struct Random {
    pixel: u32,
    path: u32,
    dimension: u32,
}

impl Random {
    fn next(&mut self) -> f64 {
        self.dimension += 1;
        let start = f64::from(hash(self.pixel ^ hash(self.dimension))) / 4_294_967_296.0;
        // Roots of primes are independent over the rational numbers.
        const PRIMES: [f64; 12] = [2.0, 3.0, 5.0, 7.0, 11.0, 13.0, 17.0, 19.0, 23.0, 29.0, 31.0, 37.0];
        match PRIMES.get(self.dimension as usize - 1) {
            Some(prime) => (start + f64::from(self.path) * prime.sqrt()).fract(),
            None => f64::from(hash(self.pixel ^ hash(self.dimension ^ hash(self.path)))) / 4_294_967_296.0,
        }
    }
}
