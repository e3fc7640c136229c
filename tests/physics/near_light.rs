//! Light of near LEDs against rays traced in f64 on shapes that are known everywhere (`tests/oracle/ray_tracer.rs`).

use gelsim_core::base::grid::Resolution;
use gelsim_core::base::view::View;
use gelsim_core::optics::Model;
use gelsim_core::optics::led::Led;
use gelsim_core::optics::phong::{Phong, Shadows, SoftShadows};

use super::support::{camera_of, contact_of, grey, led, light_at, light_of, position, sensor};
use gelsim_oracle::ray_tracer::{Dent, Lamp, Light, bounced};
use gelsim_oracle::shapes::Random;

/// A ball, pressed in as deep as in a usual job.
const BALL: Dent = Dent::Ball { radius: 4.0, deep: 0.8 };

const DISTANCES_MM: [f64; 3] = [8.0, 12.0, 20.0];
const ELEVATIONS_DEG: [f64; 4] = [15.0, 30.0, 45.0, 60.0];

/// Distances and elevations of LEDs: all pairs, or each elevation once.
fn places_of_leds() -> impl Iterator<Item = (f64, f64)> {
    let all = (0..DISTANCES_MM.len()).flat_map(|i| (0..ELEVATIONS_DEG.len()).map(move |j| (i, j)));
    let tried = all.filter(|(i, j)| crate::thorough() || j % DISTANCES_MM.len() == *i);
    tried.map(|(i, j)| (DISTANCES_MM[i], ELEVATIONS_DEG[j]))
}

/// Rays to each side of a pixel.
const RAYS: usize = 4;

/// What surrounds the contact, mm.
const AROUND_MM: f64 = 1.0;

const TRUE_LIGHT: Light = Light { shadows: true, regardless_of_height: false };

fn one_led(distance_mm: f64, elevation_deg: f64) -> Led {
    Led { distance_mm, angular_size_deg: [0.0; 2], ..led(25.0, elevation_deg) }
}

/// Differences in grey levels: mean and largest; and largest where no pixel holds the contact's edge.
#[derive(Clone, Copy, Debug, Default)]
struct Off {
    sum: f64,
    count: f64,
    most: f64,
    most_beside_edge: f64,
}

impl Off {
    fn add(&mut self, difference: f64, on_edge: bool) {
        let levels = 255.0 * difference.abs();
        self.sum += levels;
        self.count += 1.0;
        self.most = self.most.max(levels);
        if !on_edge {
            self.most_beside_edge = self.most_beside_edge.max(levels);
        }
    }

    fn mean(&self) -> f64 {
        self.sum / self.count
    }
}

/// A dent under one LED.
struct Scene {
    dent: Dent,
    led: Led,
    near: bool,
    view: View,
    phong: Phong,
}

impl Scene {
    fn new(dent: Dent, led: Led, near: bool, pitch_mm: f64) -> Self {
        let px = (2.0 * (dent.reach() + AROUND_MM + 0.2) / pitch_mm).ceil() as u32;
        let phong = Phong { darkening: Some(0.0), shadows: Shadows::None, ..Phong::default() };
        Self { dent, view: camera_of(&sensor([px, px], pitch_mm, vec![])), led, near, phong }
    }

    /// Pixels of the contact and its surroundings, and whether the contact's edge goes through or beside them.
    fn pixels(&self) -> Vec<([usize; 2], bool)> {
        let [width, height] = self.view.resolution_px;
        let all = (0..height).flat_map(|y| (0..width).map(move |x| [x, y]));
        let from_edge = |[x, y]: [usize; 2]| self.dent.beyond_edge(position(&self.view, x as f64, y as f64));
        let near = all.filter(|pixel| from_edge(*pixel) < AROUND_MM);
        near.map(|pixel| (pixel, from_edge(pixel).abs() < 2.0 * self.view.mm_per_px[0])).collect()
    }

    /// What the simulator adds to the light of the flat pad.
    fn simulated(&self, shadows: Shadows) -> impl Fn([usize; 2]) -> f64 {
        let [width, height] = self.view.resolution_px.map(|px| px as u32);
        let sensor = sensor([width, height], self.view.mm_per_px[0], vec![self.led.clone()]);
        let rest = grey(&self.view, 128);
        let phong = Phong { shadows, ..self.phong };
        let model = if self.near { Model::Led(phong) } else { Model::Phong(phong) };
        let light = light_of(&model, &sensor, &contact_of(&self.view, |at| self.dent.height(at)), &rest);
        move |[x, y]| light_at(&light, &rest, x, y)[0] - 128.0 / 255.0
    }

    /// The light of the flat pad at a pixel's centre.
    fn flat(&self, [x, y]: [usize; 2]) -> f64 {
        let [x, y] = position(&self.view, x as f64, y as f64);
        let light = Light { shadows: false, regardless_of_height: false };
        self.lamp().phong(self.dent, ([x, y, 0.0], [0.0, 0.0, 1.0]), light, &self.phong)
    }

    fn lamp(&self) -> Lamp {
        Lamp::new(&self.led, self.near)
    }

    /// The mean of a pixel's rays.
    fn traced(&self, [x, y]: [usize; 2], light: Light) -> f64 {
        let at = |k: usize| (k as f64 + 0.5) / RAYS as f64 - 0.5;
        let rays = (0..RAYS).flat_map(|j| (0..RAYS).map(move |i| [at(i), at(j)]));
        let one = |[dx, dy]: [f64; 2]| {
            let seen = self.dent.point_seen(position(&self.view, x as f64 + dx, y as f64 + dy));
            self.lamp().phong(self.dent, seen, light, &self.phong)
        };
        rays.map(one).sum::<f64>() / (RAYS * RAYS) as f64
    }

    /// How far the simulator is from the rays.
    fn off(&self, shadows: Shadows) -> Off {
        let (simulated, mut off) = (self.simulated(shadows), Off::default());
        let light = Light { shadows: shadows != Shadows::None, ..TRUE_LIGHT };
        for (pixel, on_edge) in self.pixels() {
            off.add(simulated(pixel) + self.flat(pixel) - self.traced(pixel, light), on_edge);
        }
        off
    }
}

fn show(off: &Off) -> String {
    format!("{:.2} / {:4.1} / {:4.1}", off.mean(), off.most, off.most_beside_edge)
}

#[test]
fn light_of_a_near_led_on_a_ball_is_that_of_traced_rays_within_a_third_of_a_level() {
    println!(
        "grey levels, mean / largest / largest where no pixel holds the contact's edge: near LED; LED at infinity; near \
         LED regardless of height"
    );
    for (distance_mm, elevation_deg) in places_of_leds() {
        let led = one_led(distance_mm, elevation_deg);
        let near = Scene::new(BALL, led.clone(), true, 0.025);
        let found = near.off(Shadows::None);
        let infinite = Scene::new(BALL, led, false, 0.025).off(Shadows::None);
        let mut regardless = Off::default();
        for (pixel, on_edge) in near.pixels() {
            let traced = |regardless_of_height| near.traced(pixel, Light { shadows: false, regardless_of_height });
            regardless.add(traced(true) - traced(false), on_edge);
        }
        let all = [&found, &infinite, &regardless].map(show);
        println!("{distance_mm:4} mm, {elevation_deg} degrees: {}", all.join("; "));
        // All that is left is in pixels that hold the edge, as under an LED at infinity.
        assert!(found.mean() < 0.2 && found.most_beside_edge < 0.2, "{found:?}");
        assert!(found.mean() < 1.35 * infinite.mean() + 0.01, "{found:?}, at infinity {infinite:?}");
        assert!(regardless.mean() > 0.5, "height matters: {regardless:?}");
    }
}

#[test]
fn shadows_of_near_leds_are_off_by_what_the_page_says() {
    println!(
        "grey levels, mean / largest / largest where no pixel holds the contact's edge: near LED; LED at infinity"
    );
    let soft = Shadows::Soft(SoftShadows { resolution: Resolution::Full });
    let shallow = Dent::Ball { radius: 4.0, deep: 0.4 };
    let block = Dent::Block { half: 2.0, deep: 0.8 };
    for (dent, allowed) in [(BALL, 0.25), (shallow, 0.2), (block, 3.5)] {
        for (distance_mm, elevation_deg) in places_of_leds() {
            let led = one_led(distance_mm, elevation_deg);
            let [near, infinite] = [true, false].map(|near| Scene::new(dent, led.clone(), near, 0.025).off(soft));
            println!("{dent:?}, {distance_mm} mm, {elevation_deg} degrees: {}; {}", show(&near), show(&infinite));
            assert!(near.mean() < allowed, "{near:?}");
        }
    }
}

#[test]
fn the_rays_cast_shadows_and_bounce_as_closed_forms_say() {
    // A wall at x = -2, 4 mm wide and 0.8 high, and the plane to its left, under an LED to its left.
    let block = Dent::Block { half: 2.0, deep: 0.8 };
    let led = |azimuth_deg: f64| Led { distance_mm: 10.0, ..led(azimuth_deg, 30.0) };
    let lamp = Lamp::new(&led(180.0), false);
    let mut random = Random(3);
    for away in [0.1, 0.4, 1.5] {
        let seen = block.point_seen([-2.0 - away, 0.0]);
        let [first, all] = bounced(block, seen, &[lamp], 0.5, 400_000, &mut random);
        // A rectangle in a plane at right angles to the place's own, which it ends at, in two halves.
        let (b, slant) = (2.0_f64, (away * away + 0.8 * 0.8_f64).sqrt());
        let factor = ((b / away).atan() - away / slant * (b / slant).atan()) / std::f64::consts::PI;
        let expected = 0.5 * factor * 30.0_f64.to_radians().cos();
        println!("{away} mm from a wall: {first:.4}, closed form {expected:.4}; all bounces {all:.4}");
        assert!((first - expected).abs() < 0.01 * expected + 2e-4, "{first} for {expected}");
        assert!(all > first && all < 1.3 * first, "{first} {all}");
    }
    // Behind it, a near LED's shadow ends where the line over its far upper edge meets the plane.
    let near = Lamp::new(&led(180.0), true);
    let (foot, height) = (-10.0 * 30.0_f64.to_radians().cos(), 5.0);
    let end = foot + (2.0 - foot) * height / (height - 0.8);
    let lit = |x: f64| near.irradiance(block, block.point_seen([x, 0.0]), TRUE_LIGHT);
    assert!(lit(end - 1e-6) == 0.0 && lit(2.0 + 1e-6) == 0.0 && lit(end + 1e-6) > 0.1, "{end}");
    // On level ground N.l is the LED's height over its distance, and brightness the square of 10 mm over that.
    let beside = lit(end + 1.0);
    let r2 = (end + 1.0 - foot).powi(2) + height * height;
    assert!((beside - 100.0 / r2 * height / r2.sqrt()).abs() < 1e-12, "{beside}");
}
