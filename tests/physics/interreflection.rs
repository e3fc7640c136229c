//! Why light of LEDs at infinity has no bounce: what a dent's walls throw at each other, by a slow sum over all pairs of pixels.
//!
//! Each pixel gives back a share of the diffuse light that it gets, alike in all directions (Lambert 1760), and every
//! other pixel that it faces gets its part: cos cos / (pi d^2) of it per area. One bounce, an albedo of one half, and
//! nothing stands between two pixels. The figures are in `docs/explanation/effect-models.md`. Random paths of any length, which shapes do block,
//! say what that leaves out.

use gelsim_core::base::grid::Rect;
use gelsim_core::base::view::View;
use gelsim_core::gelpad::Contact;
use gelsim_core::optics::led::Led;
use gelsim_core::optics::normals::surface_normals;
use gelsim_core::optics::shadow::{ShadowCaster, ShadowScratch, compute_visible_shares};
use gelsim_job::plan::Plan;
use gelsim_job::sample::render;

use super::support::{camera_of, contact_of, led, position, sensor};
use crate::plan::plan;
use gelsim_oracle::pixel_pairs::bounced_from_all;
use gelsim_oracle::ray_tracer::{Dent, Lamp, bounced};
use gelsim_oracle::shapes::Random;

/// Share of the light that the pad's coating gives back.
const ALBEDO: f64 = 0.5;

fn plan_of(object: &str) -> Plan {
    plan(&format!(
        "dataset = {{ name = 'bounce', samples = 1 }}\nfidelity = 'standard'\nsensor.resolution_px = [80, 60]\n\
         object = [{{ path = 'objects/{object}.obj' }}]\nindentation.depth_mm = 0.8\n"
    ))
}

/// Red, green and blue irradiance of each pixel: N.l times each LED's colour and intensity, as far as it is seen.
fn direct(camera: &View, leds: &[Led], contact: &Contact) -> Vec<[f64; 3]> {
    let [width, height] = camera.resolution_px;
    let normals = surface_normals(contact, camera);
    let mut light = vec![[0.0; 3]; width * height];
    for led in leds {
        let (azimuth, elevation) = (led.azimuth_deg.to_radians(), led.elevation_deg.to_radians());
        let towards = [azimuth.cos() * elevation.cos(), azimuth.sin() * elevation.cos(), -elevation.sin()];
        let caster = ShadowCaster::new(led.azimuth_deg, led.elevation_deg, led.angular_size_deg, camera.mm_per_px);
        let view = Rect::whole(width, height);
        let seen =
            compute_visible_shares(&[Some(caster)], &contact.surface, view, &mut ShadowScratch::default()).remove(0);
        for ((light, normal), seen) in light.iter_mut().zip(&normals).zip(&seen) {
            let facing: f64 = normal.iter().zip(towards).map(|(n, l)| f64::from(*n) * l).sum();
            for (light, color) in light.iter_mut().zip(led.color) {
                *light += facing.max(0.0) * f64::from(*seen) * color * led.intensity;
            }
        }
    }
    light
}

/// Mean, 95th percentile and maximum.
fn spread(mut values: Vec<f64>) -> [f64; 3] {
    values.sort_by(f64::total_cmp);
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    [mean, values[values.len() * 95 / 100], values[values.len() - 1]]
}

#[test]
fn a_bounce_of_light_is_little_beside_what_the_press_changes() {
    println!("grey levels, mean / 95 % / max: one bounce; what the press changes directly");
    for object in ["sphere", "cube", "gear", "coin"] {
        let plan = plan_of(object);
        let contact = render(&plan, 0).impression.contact;
        let (camera, leds) = (plan.simulator.view(), &plan.job().sensor.led);
        let light = direct(camera, leds, &contact);
        let bounce = bounced_from_all(camera, &contact, &light, ALBEDO);
        assert!(bounce.iter().flatten().all(|light| light.is_finite() && *light >= 0.0));
        let flat = direct(camera, leds, &contact_of(camera, |_| 0.0));
        let levels = 255.0 * plan.simulator.models().optics.phong().expect("LEDs").diffuse;

        // The contact, and a millimetre around it.
        let [width, height] = plan.simulator.view().resolution_px;
        let [reach_x, reach_y] = plan.simulator.view().mm_per_px.map(|pitch| (1.0 / pitch).round() as usize);
        let near = |at: &usize| {
            let (x, y) = (at % width, at / width);
            let columns = x.saturating_sub(reach_x)..(x + reach_x + 1).min(width);
            (y.saturating_sub(reach_y)..(y + reach_y + 1).min(height))
                .any(|y| contact.mask.row(y)[columns.clone()].iter().any(|value| *value > 0))
        };
        let places: Vec<usize> = (0..width * height).filter(near).collect();
        let of = |value: &dyn Fn(usize, usize) -> f64| {
            spread(places.iter().flat_map(|at| (0..3).map(|k| levels * value(*at, k))).collect())
        };
        let indirect = of(&|at, k| bounce[at][k]);
        let changed = of(&|at, k| (light[at][k] - flat[at][k]).abs());
        let show = |[mean, most_of, most]: [f64; 3]| format!("{mean:5.2} / {most_of:5.2} / {most:5.2}");
        println!("{object:7} {}; {}", show(indirect), show(changed));
        assert!(indirect[0] > 0.0, "walls face each other");
        assert!(indirect[0] < 0.25 * changed[0], "{object}: {} beside {}", indirect[0], changed[0]);
    }
}

#[test]
fn a_flat_pad_throws_no_light_at_itself() {
    let plan = plan_of("sphere");
    let camera = plan.simulator.view();
    let flat = contact_of(camera, |_| 0.0);
    let light = direct(camera, &plan.job().sensor.led, &flat);
    assert!(light.iter().flatten().all(|light| *light > 0.0));
    assert!(bounced_from_all(camera, &flat, &light, ALBEDO).iter().flatten().all(|light| *light == 0.0));
}

#[test]
fn one_bounce_between_all_pairs_is_what_random_paths_bring() {
    println!("mean of what is given back over direct light: all pairs of pixels; paths of one bounce; of any length");
    // What pairs of pixels are allowed to miss: the plane beyond the view, the sharp edge; an upright wall has no pixels.
    let ball = (Dent::Ball { radius: 4.0, deep: 0.8 }, 0.65..1.0, 1.05);
    let block = (Dent::Block { half: 2.0, deep: 0.8 }, 0.25..1.0, 1.5);
    for (dent, found, further) in [ball, block] {
        let leds = [25.0, 145.0, 265.0].map(|azimuth| Led { angular_size_deg: [0.0; 2], ..led(azimuth, 30.0) });
        let sensor = sensor([96, 96], 0.125, leds.to_vec());
        let camera = camera_of(&sensor);
        let contact = contact_of(&camera, |at| dent.height(at));
        let light = direct(&camera, &leds, &contact);
        let pairs = bounced_from_all(&camera, &contact, &light, ALBEDO);
        let lamps = leds.each_ref().map(|led| Lamp::new(led, false));
        let mut random = Random(1);
        let mut sums = [0.0; 4];
        for (at, (light, pairs)) in light.iter().zip(&pairs).enumerate() {
            let place = position(&camera, (at % 96) as f64, (at / 96) as f64);
            // A pixel that holds a wall has no normal of its own.
            if dent.beyond_edge(place) > 1.0 || dent.beyond_edge(place).abs() < 0.2 {
                continue;
            }
            let [first, all] = bounced(dent, dent.point_seen(place), &lamps, ALBEDO, 200, &mut random);
            for (sum, value) in sums.iter_mut().zip([light[0], pairs[0], first, all]) {
                *sum += value;
            }
        }
        let [pairs, first, all] = [1, 2, 3].map(|k| sums[k] / sums[0]);
        println!("{dent:?}: {:.2} %; {:.2} %; {:.2} %", 100.0 * pairs, 100.0 * first, 100.0 * all);
        assert!(found.contains(&(pairs / first)), "{pairs} of {first}");
        assert!((1.0..further).contains(&(all / first)), "{all} after {first}");
        assert!(all < 0.05, "{all} of the direct light");
    }
}
