//! Each stage in f64 from what the sample's stage before it gave: only rounding is left between the two.
//!
//! Normals and light from the sample's surface at every level; shadows by rays that are marched over it in small steps;
//! lens, vignette, exposure and quantising from the sample's light.

use std::f64::consts::PI;

use gelsim_core::base::grid::Grid;
use gelsim_core::base::view::SURFACE_BORDER;
use gelsim_core::camera::CameraParams;
use gelsim_core::effects::{Effect, EffectPolicy};
use gelsim_core::fidelity::Fidelity;
use gelsim_job::plan::Plan;
use gelsim_job::sample::render;
use gelsim_job::scene::Scene;

use super::press::{GENERIC, Setting, errors_of_light, image_everywhere, light_everywhere};
use gelsim_oracle::pipeline_f64::{misrounded, slopes_of};
use gelsim_oracle::shading::phong;

fn exact(surface: &Grid<f32>) -> Grid<f64> {
    Grid { width: surface.width, height: surface.height, data: surface.data.iter().map(|w| f64::from(*w)).collect() }
}

#[test]
fn normals_light_and_levels_follow_from_the_surface_at_every_level() {
    for level in Fidelity::ALL {
        for object in ["sphere", "coin", "knurl"] {
            let setting = Setting { object, level, more: "optics.phong.shadows = 'none'\n", ..Setting::default() };
            let plan = setting.plan(&GENERIC).with_policy(EffectPolicy::All);
            let sample = render(&plan, 0);
            let surface = exact(&sample.impression.contact.surface);
            let [turned, off, misrounded] = errors_of_light(&plan, &sample, &surface);
            println!(
                "{object}, {level:?}: normals {turned:.1e} degrees, light {off:.1e}, image {misrounded:.1e} levels"
            );
            assert!(
                turned < 2e-4 && off < 1e-3 && misrounded < 1e-3,
                "{object}, {level:?}: {turned} {off} {misrounded}"
            );
        }
    }
}

/// The share of an LED that each pixel of the view sees over the horizon, by rays marched over the surface.
fn march_rays(plan: &Plan, surface: &Grid<f64>, azimuth_deg: f64, slopes: [f64; 2]) -> Vec<f64> {
    let [width, height] = plan.simulator.view().resolution_px;
    let pitch = plan.simulator.view().mm_per_px;
    let (sin, cos) = azimuth_deg.to_radians().sin_cos();
    let step_mm = 0.5 * pitch[0].min(pitch[1]);
    let height_at = |x: f64, y: f64| {
        let inside = x >= 0.0 && y >= 0.0 && x <= surface.width as f64 - 1.0 && y <= surface.height as f64 - 1.0;
        let (column, row) = ((x as usize).min(surface.width - 2), (y as usize).min(surface.height - 2));
        let (u, v) = (x - column as f64, y - row as f64);
        let at = |dx: usize, dy: usize| surface.at(column + dx, row + dy);
        let upper = at(0, 0) * (1.0 - u) + at(1, 0) * u;
        inside.then(|| upper * (1.0 - v) + (at(0, 1) * (1.0 - u) + at(1, 1) * u) * v)
    };
    let share = |at: usize| {
        let [x, y] = [at % width, at / width].map(|at| (at + SURFACE_BORDER) as f64);
        let here = surface.at(x as usize, y as usize);
        let rises = (1..)
            .map(|k| f64::from(k) * step_mm)
            .map_while(|mm| Some((height_at(x + mm * cos / pitch[0], y + mm * sin / pitch[1])? - here) / mm));
        let horizon = rises.fold(f64::NEG_INFINITY, f64::max);
        ((slopes[1] - horizon) / (slopes[1] - slopes[0])).clamp(0.0, 1.0)
    };
    (0..width * height).map(share).collect()
}

#[test]
fn shadows_are_those_of_marched_rays_where_penumbras_do_not_overlap() {
    // Where penumbras overlap, as between the dots, one obstacle stands for all.
    for (object, most_mean, most_over) in [("sphere", 0.2, 0.01), ("cone", 0.3, 0.04), ("dots", 1.5, 0.25)] {
        let setting =
            Setting { object, level: Fidelity::High, more: "optics.phong.darkening = 0.0\n", ..Setting::default() };
        // So narrow that rays of one azimuth are all there are.
        let plan = setting.plan_with(&GENERIC, "angular_size_deg = [0.1, 10.0]\n");
        let sample = render(&plan, 0);
        let surface = exact(&sample.impression.contact.surface);
        let constants = plan.simulator.models().optics.phong().expect("LEDs");
        let slopes = slopes_of(&surface, plan.simulator.view());
        let elevation = GENERIC.led_elevation_deg;
        let rays = [elevation - 5.0, elevation + 5.0].map(|deg| deg.to_radians().tan());
        let mut expected: Vec<f64> = plan.simulator.background().rgb.iter().map(|level| f64::from(*level)).collect();
        for led in &plan.job().sensor.led {
            let flat = phong([0.0; 2], led, constants);
            for (at, share) in march_rays(&plan, &surface, led.azimuth_deg, rays).into_iter().enumerate() {
                let gain = phong(slopes[at], led, constants) * share - flat;
                for channel in 0..3 {
                    expected[3 * at + channel] += 255.0 * gain * led.color[channel] * led.intensity;
                }
            }
        }
        let off: Vec<f64> =
            light_everywhere(&plan, &sample).iter().zip(&expected).map(|(a, b)| (f64::from(*a) - b).abs()).collect();
        let mean = off.iter().sum::<f64>() / off.len() as f64;
        let over = off.iter().filter(|levels| **levels > 2.0).count() as f64 / off.len() as f64;
        println!("shadows, {object}: {mean:.3} levels on the mean, over two in {over:.4}");
        assert!(mean < most_mean && over < most_over, "{object}: {mean} {over}");
    }
}

/// One side of a discrete Gaussian, exp(-t) I_k(t), from the integral that defines it.
fn weights(sigma: f64) -> Vec<f64> {
    let reach = (4.0 * sigma).ceil() as u32;
    let steps = 2000;
    let weight = |k: u32| {
        let angles = (0..steps).map(|i| PI * (f64::from(i) + 0.5) / f64::from(steps));
        angles.map(|a| (sigma * sigma * (a.cos() - 1.0)).exp() * (f64::from(k) * a).cos()).sum::<f64>()
    };
    let all: Vec<f64> = (0..=reach).map(weight).collect();
    let sum = 2.0 * all.iter().sum::<f64>() - all[0];
    all.iter().map(|weight| weight / sum).collect()
}

/// What a camera makes of light, levels: defocus, distortion, vignette, exposure.
fn through_camera(light: &[f64], plan: &Plan, shot: &CameraParams) -> Vec<f64> {
    let [width, height] = plan.simulator.view().resolution_px;
    let at = |from: &[f64], x: isize, y: isize, channel: usize| {
        let (x, y) = (x.clamp(0, width as isize - 1) as usize, y.clamp(0, height as isize - 1) as usize);
        from[3 * (y * width + x) + channel]
    };
    let pixels = |value: &dyn Fn(usize, usize, usize) -> f64| -> Vec<f64> {
        (0..3 * width * height).map(|k| value(k / 3 % width, k / 3 / width, k % 3)).collect()
    };
    let blurred = |from: &[f64], sigma: f64, [dx, dy]: [isize; 2]| {
        let weights = weights(sigma);
        pixels(&|x, y, channel| {
            let one = |k: isize| at(from, x as isize + k * dx, y as isize + k * dy, channel);
            let sides = weights.iter().zip(0_isize..).skip(1).map(|(weight, k)| weight * (one(k) + one(-k)));
            weights[0] * one(0) + sides.sum::<f64>()
        })
    };
    let [sigma_x, sigma_y] = plan.simulator.view().mm_per_px.map(|pitch| shot.defocus_mm / pitch);
    let soft = blurred(&blurred(light, sigma_x, [1, 0]), sigma_y, [0, 1]);

    let middle = [width, height].map(|size| size as f64 / 2.0);
    let diagonal2 = middle[0].powi(2) + middle[1].powi(2);
    let [k1, k2] = shot.distortion;
    let mirrored = |at: f64, last: f64| {
        let at = at.abs();
        if at > last { 2.0 * last - at } else { at }
    };
    pixels(&|x, y, channel| {
        let from = [x as f64 + 0.5 - middle[0], y as f64 + 0.5 - middle[1]];
        let r2 = (from[0].powi(2) + from[1].powi(2)) / diagonal2;
        let scale = 1.0 + r2 * (k1 + r2 * k2);
        let place = |k: usize, size: usize| mirrored(from[k] * scale + middle[k] - 0.5, size as f64 - 1.0);
        let [u, v] = [place(0, width), place(1, height)];
        let (column, row) = (u.floor(), v.floor());
        let corner = |dx: isize, dy: isize| at(&soft, column as isize + dx, row as isize + dy, channel);
        let upper = corner(0, 0) * (column + 1.0 - u) + corner(1, 0) * (u - column);
        let lower = corner(0, 1) * (column + 1.0 - u) + corner(1, 1) * (u - column);
        let sum = upper * (row + 1.0 - v) + lower * (v - row);
        sum * (1.0 - shot.vignette * r2) * shot.gains[channel]
    })
}

#[test]
fn the_camera_makes_the_image_from_the_light_at_every_level() {
    // Finite strain has the light and the camera of `reference`.
    let (_, levels) = Fidelity::ALL.split_last().expect("there are levels");
    for (camera, bound) in [
        ("", 1e-3),
        ("camera.defocus_mm = 0.3\n", 1e-2),
        ("camera = { distortion_k1 = 0.1, distortion_k2 = -0.03 }\n", 1e-2),
        ("camera.distortion_k1 = -0.12\n", 1e-2),
        ("camera = { vignette = 0.4, exposure = 0.7, red_gain = 1.2 }\n", 1e-2),
        (
            "camera = { defocus_mm = 0.1, distortion_k1 = 0.05, vignette = 0.2, exposure = 1.3, blue_gain = 0.9 }\n",
            1e-2,
        ),
    ] {
        for &level in levels {
            let more = format!("sensor.field_of_view_mm = [20.0, 12.0]\n{camera}");
            let setting = Setting { object: "gear", level, more: &more, ..Setting::default() };
            let plan = setting.plan(&GENERIC).with_policy(EffectPolicy::All);
            let sample = render(&plan, 0);
            let light: Vec<f64> = light_everywhere(&plan, &sample).iter().map(|level| f64::from(*level)).collect();
            let expected = through_camera(&light, &plan, &Scene::draw(&plan, 0, 0).camera);
            let misrounded = misrounded(&image_everywhere(&plan, &sample), &expected);
            println!("{level:?} {}: {misrounded:.1e} beyond half a level", camera.trim());
            assert!(misrounded < bound, "{level:?}, {camera}: {misrounded}");

            // Without what it does not call for, by the bound of docs/explanation/effects.md.
            let gated = setting.plan(&GENERIC).with_policy(EffectPolicy::Without(Effect::Supersampling));
            let gain = Scene::draw(&gated, 0, 0).camera.gains.iter().copied().fold(0.0, f64::max);
            let misrounded = self::misrounded(&render(&gated, 0).impression.image.rgb, &expected);
            assert!(misrounded < 0.46 * gain + bound, "{level:?}, {camera}: {misrounded} with what is called for");
        }
    }
}
