//! Normals and light against closed forms, written out in f64 from the equations of the method.

use gelsim_core::base::grid::{Grid, Rect};
use gelsim_core::base::light::Light;
use gelsim_core::base::view::View;
use gelsim_core::depth::Depth;
use gelsim_core::gelpad::mean_blur::MeanBlur;
use gelsim_core::optics::background::BackgroundImage;
use gelsim_core::optics::led::Led;
use gelsim_core::optics::light_pattern::LightPattern;
use gelsim_core::optics::phong::{Equation, Phong};
use gelsim_core::optics::residual::LightResidual;
use gelsim_files::png;
use gelsim_files::sensor::{PRESETS, Sensor};
use gelsim_job::sample::render;

use super::support::{
    camera_of, contact_of, depth_of, expose, grey, led, light_at, margin_of, normals, position, press, sensor, shade,
};
use crate::is_flat;
use crate::plan::plan;
use gelsim_oracle::pipeline_f64::place_in_view;
use gelsim_oracle::shading::{brightness, phong};
use gelsim_oracle::shapes::Random;

const PAPERS_LEDS: [(f64, f64); 4] = [(-1.0, 0.0), (0.0, -1.0), (1.0, 0.0), (0.0, 1.0)];

/// Every term, and limits that steep planes and deep places exceed.
fn residual() -> LightResidual {
    let red = [0.25, -0.5, 0.5, 0.25, -0.25, 0.5, 0.25, -0.5, 0.25, 0.125, -0.25, 0.5];
    let green = [0.5, 0.25, -0.5, 0.125, 0.5, -0.25, 0.5, 0.25, -0.25, -0.125, 0.5, -0.25];
    let blue = [0.25, 0.5, 0.25, -0.5, 0.25, 0.125, -0.5, 0.5, 0.5, 0.25, 0.25, 0.25];
    // Green alone varies over the pad.
    let green = [green, blue, red].concat();
    LightResidual { steepest: 0.4, heights_mm: [-0.1, 1.55], red: red.to_vec(), green, blue: blue.to_vec() }
}

/// Even, linear and quadratic light; the quadratic one would be below 0 in a corner.
fn pattern() -> LightPattern {
    LightPattern { red: vec![0.75], green: vec![1.0, 0.25, -0.5], blue: vec![0.5, 0.25, 0.5, -0.25, 0.125, 0.25] }
}

fn without_darkening() -> Phong {
    Phong { darkening: Some(0.0), ..Phong::default() }
}

/// Largest difference between the light at every pixel and `expected(column, row)`.
fn error(light: &Light, rest: &BackgroundImage, expected: impl Fn(usize, usize) -> [f64; 3]) -> f64 {
    let mut largest = 0.0_f64;
    for y in 0..rest.height {
        for x in 0..rest.width {
            for (found, expected) in light_at(light, rest, x, y).into_iter().zip(expected(x, y)) {
                assert!(found.is_finite(), "{found}");
                largest = largest.max((found - expected).abs());
            }
        }
    }
    largest
}

#[test]
fn a_tilted_plane_under_one_led_has_the_closed_forms_brightness() {
    let sideways =
        [(1.0, 0.0), (1.0, 1.0), (0.0, 1.0), (-1.0, 1.0), (-1.0, 0.0), (-1.0, -1.0), (0.0, -1.0), (1.0, -1.0)];
    for shininess in [0.0, 0.5, 1.0, 5.0, 7.0, 64.0, 1000.0] {
        // The power multiplies f32's rounding of R.V by the exponent.
        let tolerance = if shininess > 64.0 { 1e-4 } else { 1e-5 };
        for (elevation, steepness) in
            [(8.530_765_609_948_133, 0.5), (0.0, 0.25), (60.0, 0.25), (35.0, 2.0), (90.0, 0.5)]
        {
            for (k, (towards_x, towards_y)) in sideways.into_iter().enumerate() {
                // The third channel's stray light is more than all that the background has.
                for (darkening, stray_light, residual, pattern) in [
                    (0.0, None, None, None),
                    (0.35, None, Some(residual()), None),
                    (0.35, None, None, Some(pattern())),
                    (0.0, Some([0.1, 0.0, 0.5]), None, Some(pattern())),
                    (0.0, Some([0.1, 0.0, 0.5]), Some(residual()), Some(pattern())),
                ] {
                    let mut light = led(45.0 * k as f64, elevation);
                    light.color = [1.0, 0.5, 0.125];
                    light.intensity = 0.75;
                    light.pattern = pattern.map(Box::new);
                    let mut sensor = sensor([12, 9], 1.0 / 32.0, vec![light]);
                    sensor.stray_light = stray_light;
                    sensor.light_residual = residual.map(Box::new);
                    let camera = camera_of(&sensor);
                    let rest = grey(&camera, 102);
                    let constants = Phong { shininess, darkening: Some(darkening), ..Phong::default() };
                    for (a, b) in sideways {
                        // A power of two, so that f32 holds the surface exactly.
                        let slope = [a * steepness, b * steepness];
                        let surface = |[x, y]: [f64; 2]| 1.5 + slope[0] * x + slope[1] * y;
                        let found = shade(constants, &sensor, &contact_of(&camera, surface), &rest);
                        let expected = |x: usize, y: usize| {
                            let displacement = surface(position(&camera, x as f64, y as f64));
                            let place = place_in_view(&camera, [x, y]);
                            brightness(place, slope, displacement, &sensor, &constants, [0.4; 3])
                        };
                        let error = error(&found, &rest, expected);
                        assert!(
                            error < tolerance,
                            "off by {error}: LED towards ({towards_x}, {towards_y}) {elevation} degrees up, alpha \
                             {shininess}, darkening {darkening}, slope {slope:?}"
                        );
                    }
                }
            }
        }
    }
}

#[test]
fn a_tilted_plane_is_bright_if_it_faces_the_led_and_dark_if_it_faces_away() {
    for k in 0..8 {
        let azimuth = 45.0 * f64::from(k);
        let sensor = sensor([12, 9], 0.05, vec![led(azimuth, 20.0)]);
        let camera = camera_of(&sensor);
        let rest = grey(&camera, 102);
        // Seen from the camera, a displacement that grows away from the LED rises away from it and faces it.
        let tilted = |grows: f64| {
            let (sin, cos) = azimuth.to_radians().sin_cos();
            let contact = contact_of(&camera, |[x, y]| 1.0 + grows * 0.3 * (x * cos + y * sin));
            light_at(&shade(without_darkening(), &sensor, &contact, &rest), &rest, 6, 4)[0]
        };
        let (facing, level, away) = (tilted(-1.0), tilted(0.0), tilted(1.0));
        assert!(facing > level + 0.05 && level > away + 0.05, "{azimuth}: {facing} {level} {away}");
        assert!((level - 0.4).abs() < 1e-6, "{level}");
    }
}

#[test]
fn a_pressed_ball_is_bright_on_the_side_where_the_led_is() {
    // The whole way from the job to the pixels: right, bottom, left, top.
    for (azimuth, side) in [(0.0, [1.0, 0.0]), (90.0, [0.0, 1.0]), (180.0, [-1.0, 0.0]), (270.0, [0.0, -1.0])] {
        let plan = plan(&format!(
            "[dataset]\nname = \"ball\"\nsamples = 1\n[[object]]\npath = \"objects/sphere.obj\"\n[sensor]\n\
             resolution_px = [80, 60]\nrendered_background = {{ glow = 0.0, vignette = 0.0, grain = 0.0 }}\n\
             [[sensor.led]]\nazimuth_deg = {azimuth}\n[indentation]\ndepth_mm = 1.0\n"
        ));
        let sample = render(&plan, 0);
        let (mut bright, mut dark) = (0.0, 0.0);
        for y in 0..60 {
            for x in 0..80 {
                let [u, v] = position(plan.simulator.view(), x as f64, y as f64);
                let towards_led = u * side[0] + v * side[1];
                let gain = f64::from(sample.impression.image.rgb[(y * 80 + x) * 3])
                    - f64::from(plan.simulator.background().rgb[(y * 80 + x) * 3]);
                if towards_led > 0.5 {
                    bright += gain;
                } else if towards_led < -0.5 {
                    dark += gain;
                }
            }
        }
        assert!(bright > 2500.0 && dark < -2500.0, "LED at {azimuth}: {bright} on its side, {dark} on the other");
    }
}

/// A rigid ball of `radius` mm over the middle of the view, pressed in by `depth_mm`.
fn ball(camera: &View, radius: f64, depth_mm: f64, margin: usize) -> Depth {
    let [width, height] = camera.resolution_px.map(|px| px + 2 * margin);
    let mut penetration = Grid::new(width, height);
    for y in 0..height {
        for x in 0..width {
            let [u, v] = position(camera, x as f64 - margin as f64, y as f64 - margin as f64);
            let rise = (radius * radius - u * u - v * v).max(0.0).sqrt();
            penetration.row_mut(y)[x] = (rise - radius + depth_mm).max(0.0) as f32;
        }
    }
    depth_of(penetration, margin)
}

#[test]
fn normals_under_a_ball_are_the_balls_and_their_error_falls_with_the_square_of_the_pitch() {
    let (radius, depth_mm) = (3.0, 1.0);
    let errors = [0.2, 0.1, 0.05].map(|pitch| {
        let px = (6.0 / pitch) as usize;
        let camera = View { resolution_px: [px, px], mm_per_px: [pitch, pitch] };
        // The same blur in mm at every pitch, so that the contact is the same.
        let blur = MeanBlur { kernel_px: 2 * (0.2 / pitch) as u32 + 1, passes: 3 };
        let contact = press(blur, &ball(&camera, radius, depth_mm, margin_of(blur)));
        let normals = normals(&contact, &camera);
        let mut largest = 0.0_f64;
        let mut compared = 0;
        for y in 1..px - 1 {
            for x in 1..px - 1 {
                let touches = |dx: usize, dy: usize| contact.mask.at(x + dx - 1, y + dy - 1) == 255;
                let [u, v] = position(&camera, x as f64, y as f64);
                if !(touches(0, 1) && touches(2, 1) && touches(1, 0) && touches(1, 2)) || u.hypot(v) > 1.6 {
                    continue;
                }
                // The ball's outward normal points towards the camera, its sides outwards: so does the pad's.
                let z = -(radius * radius - u * u - v * v).sqrt();
                let expected = [u / radius, v / radius, z / radius];
                let found = normals[y * px + x].map(f64::from);
                let length: f64 = found.iter().map(|n| n * n).sum();
                assert!((length - 1.0).abs() < 1e-6, "{length}");
                for k in 0..3 {
                    largest = largest.max((found[k] - expected[k]).abs());
                }
                compared += 1;
            }
        }
        assert!(compared as f64 * pitch * pitch > 3.0, "{compared} pixels of {pitch} mm");
        largest
    });
    assert!(errors[2] < 5e-4, "{errors:?}");
    for pair in errors.windows(2) {
        let ratio = pair[0] / pair[1];
        assert!((3.0..5.5).contains(&ratio), "halving the pitch divides the error by {ratio}: {errors:?}");
    }
}

#[test]
fn a_flat_pad_has_normals_that_point_at_the_camera_exactly() {
    let camera = View { resolution_px: [9, 7], mm_per_px: [0.03, 0.05] };
    for normal in normals(&contact_of(&camera, |_| 0.0), &camera) {
        assert_eq!(normal.map(f32::to_bits), [0.0_f32, 0.0, -1.0].map(f32::to_bits));
    }
}

#[test]
fn slopes_use_the_pitch_of_their_own_direction() {
    let camera = View { resolution_px: [9, 7], mm_per_px: [0.03, 0.05] };
    let contact = contact_of(&camera, |[x, y]| 1.0 + 0.4 * x - 0.3 * y);
    let length = 1.25_f64.sqrt();
    for normal in normals(&contact, &camera) {
        for (found, expected) in normal.into_iter().zip([-0.4, 0.3, -1.0]) {
            assert!((f64::from(found) - expected / length).abs() < 1e-5, "{normal:?}");
        }
    }
}

fn untouched_job(sensor: &str) -> String {
    format!(
        "{sensor}\n[dataset]\nname = \"a\"\nsamples = 1\n[[object]]\npath = \"objects/sphere.obj\"\n\
         [indentation]\ndepth_mm = 1.0\nno_contact = 1.0\n"
    )
}

#[test]
fn an_untouched_pad_is_the_rendered_background_byte_for_byte() {
    for (preset, _) in PRESETS.into_iter().filter(|(name, _)| is_flat(name)) {
        for optics in
            ["", "optics.phong.shininess = 3.7", "optics.phong.shininess = 0.0", "optics.phong.diffuse = 10.0"]
        {
            if preset == "gelsight-series2" && !optics.is_empty() {
                // It has lamps and no LED.
                continue;
            }
            let plan = plan(&untouched_job(&format!(
                "{optics}\ncamera = {{ read_noise_levels = 0.0, defocus_mm = 0.0 }}\nsensor.preset = \"{preset}\""
            )));
            let sample = render(&plan, 0);
            assert!(sample.impression.image.rgb == plan.simulator.background().rgb, "{preset} {optics}");
            assert!(!sample.label.contact.in_contact);
            let different: std::collections::BTreeSet<&[u8]> = plan.simulator.background().rgb.chunks(3).collect();
            assert!(different.len() > 100, "{preset} has only {} colours", different.len());
        }
    }
}

#[test]
fn an_untouched_pad_is_the_users_photograph_byte_for_byte_and_so_is_what_the_press_does_not_reach() {
    let mut random = Random(1);
    let noise: Vec<u8> = (0..160 * 120 * 3).map(|_| random.below(256) as u8).collect();
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("photograph.png");
    std::fs::write(&path, png::encode_rgb(160, 120, &noise)).expect("a temporary file");
    let sensor = format!("sensor.resolution_px = [160, 120]\nsensor.background = {:?}", path.display().to_string());
    let untouched = render(&plan(&untouched_job(&sensor)), 0);
    assert!(untouched.impression.image.rgb == noise);

    let touched = plan(&untouched_job(&sensor).replace("no_contact = 1.0", "no_contact = 0.0"));
    let sample = render(&touched, 0);
    let Rect { x0, y0, x1, y1 } = sample.impression.contact.region;
    let mut changed = 0;
    for (at, (found, expected)) in sample.impression.image.rgb.chunks(3).zip(noise.chunks(3)).enumerate() {
        // The region counts the border; slopes reach one pixel further.
        let (x, y) = (at % 160 + 1, at / 160 + 1);
        let reached = (x0.saturating_sub(1)..x1 + 1).contains(&x) && (y0.saturating_sub(1)..y1 + 1).contains(&y);
        assert!(reached || found == expected, "{found:?} {expected:?}");
        changed += usize::from(found != expected);
    }
    assert!(changed > 500, "{changed} pixels");
}

#[test]
fn the_literal_equation_adds_the_flat_pads_own_light_to_the_background() {
    let plan = plan(&untouched_job("optics.phong.equation = \"literal\"\nsensor.resolution_px = [64, 48]"));
    let sample = render(&plan, 0);
    let constants = Phong { equation: Equation::Literal, ..Phong::default() };
    for (found, rest) in sample.impression.image.rgb.chunks(3).zip(plan.simulator.background().rgb.chunks(3)) {
        let rest = std::array::from_fn(|k| f64::from(rest[k]) / 255.0);
        let expected = brightness([0.0; 2], [0.0; 2], 0.0, &plan.job().sensor, &constants, rest);
        for (found, expected) in found.iter().zip(expected) {
            let level = (expected * 255.0).clamp(0.0, 255.0);
            assert!((f64::from(*found) - level).abs() <= 0.5 + 1e-3, "{found} for {level}");
        }
    }
    assert_eq!(
        sample.impression.image.rgb,
        plan.simulator.untouched().rgb,
        "the reference layer is the image without contact"
    );
    let gain: f64 = plan.job().sensor.led.iter().map(|led| phong([0.0; 2], led, &constants) * led.intensity).sum();
    assert!(gain > 0.2, "the flat pad's own light is plain to see: {gain}");
}

#[test]
fn the_2014_preset_holds_the_papers_lights() {
    let plan = plan(&untouched_job("sensor.preset = \"gelsight-2014\""));
    let leds = &plan.job().sensor.led;
    let names: Vec<&str> = leds.iter().map(|led| led.name.as_str()).collect();
    assert_eq!(names, ["white", "blue", "red", "green"]);
    for (led, travels) in leds.iter().zip(PAPERS_LEDS) {
        // L rises by 0.15 towards the pad, which is +z; l points the other way.
        let length = (1.0_f64 + 0.15 * 0.15).sqrt();
        let expected = [-travels.0 / length, -travels.1 / length, -0.15 / length];
        let (azimuth, elevation) = (led.azimuth_deg.to_radians(), led.elevation_deg.to_radians());
        let found = [azimuth.cos() * elevation.cos(), azimuth.sin() * elevation.cos(), -elevation.sin()];
        for k in 0..3 {
            assert!((found[k] - expected[k]).abs() < 1e-12, "{}: {found:?} for {expected:?}", led.name);
        }
    }
    let constants = Phong::default();
    assert_eq!((constants.shininess, constants.diffuse, constants.specular), (5.0, 0.5, 0.15));
    assert_eq!(MeanBlur::default(), MeanBlur { kernel_px: 15, passes: 5 });
    assert_eq!(plan.thickness_mm(), 3.0);
}

/// Smooth hills and valleys up to some 0.5 mm per mm.
fn hills([x, y]: [f64; 2]) -> f64 {
    0.6 + 0.2 * (2.1 * x + 0.4).sin() * (1.7 * y).cos() + 0.1 * (x + 3.0 * y).sin() + 0.05 * x
}

#[test]
fn light_changes_up_to_one_pixel_beyond_where_the_surface_does() {
    let sensor = sensor([40, 30], 0.1, four_coloured_leds());
    let camera = camera_of(&sensor);
    let rest = grey(&camera, 128);
    // Without any blur the surface ends in a wall, whose slope the neighbouring pixels see.
    let sharp = MeanBlur { kernel_px: 1, passes: 0 };
    for (left, top) in [(15, 12), (0, 0), (33, 25)] {
        let margin = margin_of(sharp);
        let mut penetration = Grid::new(40 + 2 * margin, 30 + 2 * margin);
        for y in margin + top..margin + top + 5 {
            penetration.row_mut(y)[margin + left..margin + left + 7].fill(0.5);
        }
        let mut contact = press(sharp, &depth_of(penetration, margin));
        let light = shade(Phong::default(), &sensor, &contact, &rest);
        contact.region = Rect::whole(contact.surface.width, contact.surface.height);
        let everywhere = shade(Phong::default(), &sensor, &contact, &rest);
        let error = error(&light, &rest, |x, y| light_at(&everywhere, &rest, x, y));
        assert!(error < 1e-6, "{error} for a wall at {left}, {top}");
        assert!(light.region.area() < 100, "{:?}", light.region);
    }
}

fn four_coloured_leds() -> Vec<Led> {
    let colors = [[1.0, 0.2, 0.1], [0.1, 1.0, 0.3], [0.2, 0.3, 1.0], [0.9, 0.8, 0.7]];
    (0..4)
        .map(|k| Led {
            color: colors[k],
            intensity: 0.4 + 0.2 * k as f64,
            ..led(17.0 + 80.0 * k as f64, 12.0 + k as f64)
        })
        .collect()
}

#[test]
fn light_adds_up_over_leds_and_grows_with_their_intensity_until_it_is_quantised() {
    let all = sensor([40, 30], 0.06, four_coloured_leds());
    let camera = camera_of(&all);
    let rest = grey(&camera, 128);
    let contact = contact_of(&camera, hills);
    for constants in [Phong::default(), Phong { equation: Equation::Literal, ambient: 0.7, ..Phong::default() }] {
        let light = |led: Vec<Led>| shade(constants, &Sensor { led, ..all.clone() }, &contact, &rest);
        let none = light(vec![]);
        let together = light(all.led.clone());
        let single: Vec<Light> = all.led.iter().map(|led| light(vec![led.clone()])).collect();
        let sum = |x: usize, y: usize| {
            let dark = light_at(&none, &rest, x, y);
            std::array::from_fn(|k| {
                dark[k] + single.iter().map(|one| light_at(one, &rest, x, y)[k] - dark[k]).sum::<f64>()
            })
        };
        assert!(error(&together, &rest, sum) < 1e-6, "{}", error(&together, &rest, sum));

        // A hundred times as bright is far out of range, and still not cut.
        let brighter = all.led.iter().map(|led| Led { intensity: led.intensity * 100.0, ..led.clone() });
        let brighter = light(brighter.collect());
        let scaled = |x: usize, y: usize| {
            let (dark, lit) = (light_at(&none, &rest, x, y), light_at(&together, &rest, x, y));
            std::array::from_fn(|k| dark[k] + 100.0 * (lit[k] - dark[k]))
        };
        assert!(error(&brighter, &rest, scaled) < 1e-4, "{}", error(&brighter, &rest, scaled));
        let values = || brighter.planes.iter().flatten();
        assert!(values().any(|value| *value > 2.0));
        assert!(constants.equation == Equation::Literal || values().any(|value| *value < -1.0));
    }
}

#[test]
fn quantising_rounds_to_the_nearest_level_and_counts_what_it_cuts() {
    let camera = View { resolution_px: [40, 30], mm_per_px: [0.1; 2] };
    let rest = grey(&camera, 255);
    let mut random = Random(2);
    let region = Rect { x0: 3, y0: 5, x1: 38, y1: 29 };
    let planes = std::array::from_fn(|_| (0..region.area()).map(|_| random.within(-0.2, 1.2) as f32).collect());
    let light = Light { region, planes };
    let image = expose(&light, &rest);
    let (mut clipped, mut saturated) = (0, 0);
    for y in 0..30 {
        for x in 0..40 {
            let light = light_at(&light, &rest, x, y);
            let pixel = &image.rgb[(y * 40 + x) * 3..][..3];
            for (found, light) in pixel.iter().zip(light) {
                assert!((f64::from(*found) - (light * 255.0).clamp(0.0, 255.0)).abs() <= 0.5 + 1e-4, "{found} {light}");
            }
            clipped += u64::from(light.iter().any(|value| !(0.0..=1.0).contains(value)));
            saturated += u64::from(pixel.contains(&255));
        }
    }
    assert!(image.finite);
    assert_eq!((image.clipped_px, image.saturated_px), (clipped, saturated));

    let mut broken = light.clone();
    broken.planes[1][7] = f32::NAN;
    assert!(!expose(&broken, &rest).finite);
}

#[test]
fn turning_or_mirroring_scene_and_leds_turns_or_mirrors_the_image() {
    let base = sensor([31, 31], 0.08, four_coloured_leds());
    let camera = camera_of(&base);
    let rest = grey(&camera, 120);
    let upright = shade(Phong::default(), &base, &contact_of(&camera, hills), &rest);
    type Place = fn([f64; 2]) -> [f64; 2];
    type Pixel = fn(usize, usize) -> (usize, usize);
    type Azimuth = fn(f64) -> f64;
    // Where a place of the changed scene was before, where its pixel was, and where an LED goes.
    let changes: [(&str, Place, Pixel, Azimuth); 4] = [
        ("a quarter turn from x to y", |[x, y]| [y, -x], |x, y| (y, 30 - x), |azimuth| azimuth + 90.0),
        ("half a turn", |[x, y]| [-x, -y], |x, y| (30 - x, 30 - y), |azimuth| azimuth + 180.0),
        ("left and right", |[x, y]| [-x, y], |x, y| (30 - x, y), |azimuth| 180.0 - azimuth),
        ("top and bottom", |[x, y]| [x, -y], |x, y| (x, 30 - y), |azimuth| -azimuth),
    ];
    for (name, place, pixel, azimuth) in changes {
        let mut changed = base.clone();
        for led in &mut changed.led {
            led.azimuth_deg = azimuth(led.azimuth_deg);
        }
        let contact = contact_of(&camera, |at| hills(place(at)));
        let found = shade(Phong::default(), &changed, &contact, &rest);
        let before = |x: usize, y: usize| {
            let (x, y) = pixel(x, y);
            light_at(&upright, &rest, x, y)
        };
        let error = error(&found, &rest, before);
        assert!(error < 2e-6, "{name}: {error}");
    }
}

#[test]
fn turning_the_pose_and_the_leds_turns_the_whole_sample() {
    let job = |quarters: usize| {
        let leds: String = [(10.0, "[1.0, 0.2, 0.1]"), (130.0, "[0.1, 1.0, 0.3]"), (250.0, "[0.2, 0.3, 1.0]")]
            .map(|(azimuth, color)| {
                let azimuth = azimuth + 90.0 * quarters as f64;
                format!("[[sensor.led]]\nazimuth_deg = {azimuth}\nelevation_deg = 20.0\ncolor = {color}\n")
            })
            .concat();
        let [x, y] = [[1.2, -0.4], [0.4, 1.2], [-1.2, 0.4], [-0.4, -1.2]][quarters];
        format!(
            "fidelity = \"high\"\n[dataset]\nname = \"a\"\nsamples = 1\n[[object]]\npath = \"objects/letter.obj\"\n[sensor]\n\
             resolution_px = [64, 64]\nfield_of_view_mm = [16.0, 16.0]\n\
             rendered_background = {{ glow = 0.0, vignette = 0.0, grain = 0.0 }}\n{leds}\
             [pose]\nyaw_deg = {}\ntilt_deg = 4.0\ntilt_azimuth_deg = {}\nx_mm = {x:?}\ny_mm = {y:?}\n\
             [indentation]\ndepth_mm = 0.7\n",
            33.0 + 90.0 * quarters as f64,
            70.0 + 90.0 * quarters as f64,
        )
    };
    let upright = render(&plan(&job(0)), 0).impression.image.rgb;
    assert!(upright.chunks(3).filter(|pixel| **pixel != upright[..3]).count() > 1000);
    for quarters in 1..4 {
        let turned = render(&plan(&job(quarters)), 0).impression.image.rgb;
        let mut differ = 0;
        for y in 0..64 {
            for x in 0..64 {
                let (mut u, mut v) = (x, y);
                for _ in 0..quarters {
                    (u, v) = (v, 63 - u);
                }
                let (found, before) = (&turned[(y * 64 + x) * 3..][..3], &upright[(v * 64 + u) * 3..][..3]);
                differ += usize::from(found.iter().zip(before).any(|(a, b)| a.abs_diff(*b) > 1));
            }
        }
        // A pixel on the letter's edge may see the other side of it.
        assert!(differ <= 12, "{quarters} quarter turns: {differ} pixels differ by more than a grey level");
    }
}

#[test]
fn a_level_pad_darkens_in_proportion_to_its_displacement() {
    let sensor = sensor([8, 6], 0.1, four_coloured_leds());
    let camera = camera_of(&sensor);
    let rest = grey(&camera, 204);
    for darkening in [0.0, 0.35, 1.0] {
        let constants = Phong { darkening: Some(darkening), ..Phong::default() };
        for displacement in [-0.2, 0.0, 0.75, 1.5, 3.0] {
            let light = shade(constants, &sensor, &contact_of(&camera, |_| displacement), &rest);
            let expected = 0.8 * (1.0 - darkening * displacement / 3.0);
            let error = error(&light, &rest, |_, _| [expected; 3]);
            assert!(error < 1e-6, "{darkening} {displacement}: {error}");
        }
    }
}

#[test]
fn nothing_the_plan_allows_makes_light_that_is_not_finite() {
    let mut random = Random(3);
    // The finest pitch and the thickest pad that a sensor file may ask for, and usual ones.
    for (pitch, thickness) in [(1e-3 / 8192.0, 1e3), (0.03, 3.0), (1e4, 1e-2)] {
        for (intensity, level) in [(0.0, 0), (1.0, 255), (100.0, 0), (100.0, 255)] {
            for shininess in [0.0, 0.3, 1.0, 5.0, 999.5, 1000.0] {
                let led = [0.0, 90.0, 200.0].map(|azimuth| Led { intensity, ..led(azimuth, azimuth / 3.0) });
                let mut sensor = sensor([24, 18], pitch, led.to_vec());
                sensor.gelpad_thickness_mm = thickness;
                let camera = camera_of(&sensor);
                let rest = grey(&camera, level);
                let noise: Vec<f64> = (0..26 * 20).map(|_| random.within(0.0, thickness)).collect();
                let walls = |[x, _]: [f64; 2]| if (x / pitch).floor() % 3.0 == 0.0 { thickness } else { 0.0 };
                let rough = |[x, y]: [f64; 2]| {
                    let (column, row) = ((x / pitch + 12.5) as usize, (y / pitch + 9.5) as usize);
                    noise[row * 26 + column]
                };
                let surfaces: [&dyn Fn([f64; 2]) -> f64; 2] = [&walls, &rough];
                for surface in surfaces {
                    let constants = Phong { shininess, diffuse: 10.0, specular: 10.0, ..Phong::default() };
                    let contact = contact_of(&camera, surface);
                    let light = shade(constants, &sensor, &contact, &rest);
                    let finite = light.planes.iter().flatten().all(|value| value.is_finite());
                    assert!(finite, "{pitch} mm/px, intensity {intensity}, alpha {shininess}");
                    assert!(expose(&light, &rest).finite);
                    assert!(normals(&contact, &camera).iter().flatten().all(|n| n.is_finite()));
                }
            }
        }
    }
}
