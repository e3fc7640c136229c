//! Walls between pixel centres: where the surface bends within a pixel, light is that of the whole pixel.

use gelsim::SensorExt;
use gelsim_core::base::view::SURFACE_BORDER;
use gelsim_core::effects::{Effect, EffectPolicy};
use gelsim_job::plan::Plan;
use gelsim_job::sample::{Sample, render};

use crate::plan::plan;
use gelsim_oracle::dense_contact::solved;

/// A cube pressed into a pad without grain by 0.4 mm, 0.05 mm per pixel.
fn cube(gelpad: &str, pose: &str) -> Plan {
    plan(&format!(
        "optics.phong.shadows = 'none'\n{gelpad}\npose = {{ {pose} }}\nindentation.depth_mm = 0.4\n\
         [dataset]\nname = 'wall'\nsamples = 1\n\
         [sensor]\nresolution_px = [160, 120]\nfield_of_view_mm = [8.0, 6.0]\ndarkening = 0.0\nrendered_background = {{ grain = 0.0 }}\n\
         [[object]]\npath = 'objects/cube.obj'\n"
    ))
}

/// Light of the press, less that of the untouched pad, in all channels together.
fn change(plan: &Plan, sample: &Sample, x: usize, y: usize) -> f64 {
    let at = 3 * (y * 160 + x);
    let level = |rgb: &[u8]| rgb[at..at + 3].iter().map(|value| f64::from(*value)).sum::<f64>();
    level(&sample.impression.image.rgb) - level(&plan.simulator.untouched().rgb)
}

/// Where along row 60 the right wall's light is, px: the centre of its change.
fn wall_px(plan: &Plan) -> f64 {
    let sample = render(plan, 0);
    let changes: Vec<f64> = (90..160).map(|x| change(plan, &sample, x, 60).abs()).collect();
    let moments = changes.iter().zip(90..).map(|(change, x)| change * f64::from(x)).sum::<f64>();
    moments / changes.iter().sum::<f64>()
}

#[test]
fn the_light_of_a_wall_moves_with_the_wall_and_not_from_pixel_to_pixel() {
    let (mut off, mut first) = ([0.0_f64; 2], None);
    for step in 0..10 {
        let plan = cube("gelpad = 'none'", &format!("x_mm = {}", 0.005 * f64::from(step)));
        let plain = plan.with_policy(EffectPolicy::Without(Effect::Supersampling));
        let found = [wall_px(&plan), wall_px(&plain)];
        first = first.or(Some(found));
        for k in 0..2 {
            let moved = found[k] - first.unwrap_or(found)[k];
            off[k] = off[k].max((moved - 0.1 * f64::from(step)).abs());
        }
    }
    println!("off by {off:.2?} px");
    assert!(off[0] < 0.3, "{off:?}");
    assert!(off[1] > 0.4, "without samples between the centres a wall jumps: {off:?}");
}

/// A 5 mm cube pressed in by 0.6 mm, turned by 9 degrees, under a preset without noise.
fn turned_cube(preset: &str, resolution: [usize; 2], choice: &str) -> Plan {
    plan(&format!(
        "{choice}\npose.yaw_deg = 9.0\nindentation.depth_mm = 0.6\n\
         camera = {{ read_noise_levels = 0.0, speckle_levels = 0.0 }}\n[dataset]\nname = 'wall'\nsamples = 1\n\
         [sensor]\npreset = '{preset}'\nresolution_px = {resolution:?}\n[[object]]\npath = 'objects/cube.obj'\n"
    ))
}

/// Standard deviation of each channel along the walls of that cube, less what changes over 30 pixels: the largest of lines beside
/// the walls, grey levels.
fn deviation_along_walls(plan: &Plan) -> [f64; 3] {
    let sample = render(plan, 0);
    let (image, untouched) = (&sample.impression.image, plan.simulator.untouched());
    let [half_px, turn] = [2.5 / plan.simulator.view().mm_per_px[0], 9.0_f64.to_radians()];
    let middle = [image.width, image.height].map(|px| 0.5 * (px as f64 - 1.0));
    let change = |x: usize, y: usize, channel: usize| {
        let at = 3 * (y * image.width + x) + channel;
        f64::from(image.rgb[at]) - f64::from(untouched.rgb[at])
    };
    let mut worst = [0.0_f64; 3];
    for wall in 0..4 {
        let (sin, cos) = (turn + f64::from(wall) * std::f64::consts::FRAC_PI_2).sin_cos();
        for away in -12..24 {
            let aside = 0.5 * f64::from(away) + half_px;
            for (channel, worst) in worst.iter_mut().enumerate() {
                let steps = (1.5 * half_px) as i32;
                let line: Vec<f64> = (-steps..=steps)
                    .map(|step| {
                        let along = 0.5 * f64::from(step);
                        let (x, y) = (middle[0] + along * cos + aside * sin, middle[1] + along * sin - aside * cos);
                        let (u, v, x, y) = (x.fract(), y.fract(), x as usize, y as usize);
                        let across = |y: usize| change(x, y, channel) * (1.0 - u) + change(x + 1, y, channel) * u;
                        across(y) * (1.0 - v) + across(y + 1) * v
                    })
                    .collect();
                let rough = line.windows(61).map(|window| window[30] - window.iter().sum::<f64>() / 61.0);
                let squares: Vec<f64> = rough.map(|value| value * value).collect();
                *worst = worst.max((squares.iter().sum::<f64>() / squares.len() as f64).sqrt());
            }
        }
    }
    worst
}

#[test]
fn a_turned_wall_has_no_saw_teeth_at_any_level() {
    let camera = gelsim::Sensor::preset("gelsight-mini").expect("a preset").camera;
    let noise = camera.noise_color.map(|share| share * camera.read_noise_levels);
    println!("the preset's noise: {noise:.1?}");
    for (level, resolution) in [
        ("draft", [640, 480]),
        ("standard", [320, 240]),
        ("standard", [640, 480]),
        ("high", [320, 240]),
        ("reference", [640, 480]),
    ] {
        let plan = turned_cube("gelsight-mini", resolution, &format!("fidelity = '{level}'"));
        let [with, without] = [EffectPolicy::WhereNeeded, EffectPolicy::Without(Effect::Supersampling)]
            .map(|it| deviation_along_walls(&plan.with_policy(it)));
        println!(
            "{level}, {resolution:?}: {with:.1?} grey levels along a wall; {without:.1?} without samples between centres"
        );
        for (channel, noise) in noise.iter().enumerate() {
            assert!(with[channel] < 2.5 * noise, "{level}, {resolution:?}: {with:?}");
            // On finer pixels the lens's blur does the same.
            assert!(resolution[0] > 320 || 2.0 * with[channel] < without[channel], "{level}: {with:?} {without:?}");
        }
    }
}

/// A cube that moves by a pixel of the image, a quarter of the solver's, moves the pad beside it by as much.
#[test]
fn the_pad_moves_with_a_wall_between_the_solvers_pixels() {
    for (level, factor, most_um) in [("draft", 4, 8.0), ("standard", 2, 4.0)] {
        let pitch = 0.05;
        let beside = |step: i32, level: &str| {
            let plan = cube(&format!("fidelity = '{level}'"), &format!("x_mm = {}", pitch * f64::from(step)));
            let sample = render(&plan, 0);
            let surface = &sample.impression.contact.surface;
            // From two of the solver's pixels on beside the right wall, in the middle row.
            let wall = (80.0 + 2.5 / pitch) as usize + step as usize + SURFACE_BORDER;
            (2 * factor..6 * factor).map(|px| f64::from(surface.at(wall + px, 61))).collect::<Vec<f64>>()
        };
        let mut worst = 0.0_f64;
        for step in 0..factor as i32 {
            let exact = beside(step, "reference");
            worst =
                beside(step, level).iter().zip(&exact).map(|(w, exact)| 1e3 * (w - exact).abs()).fold(worst, f64::max);
        }
        println!("{level}: {worst:.2} um beside a wall");
        assert!(worst < most_um, "{level}: {worst} um");
    }
}

#[test]
fn only_pixels_within_which_the_surface_bends_are_sampled() {
    let ball = plan(
        "pose.x_mm = 0.0\nindentation.depth_mm = 0.4\n[dataset]\nname = 'ball'\nsamples = 1\n\
         [sensor]\nresolution_px = [160, 120]\n[[object]]\npath = 'objects/sphere.obj'\n",
    );
    let smooth = render(&ball, 0);
    let note = &smooth.label.effects[Effect::Supersampling];
    assert_eq!((note.ran, &*note.reason), (false, "the surface bends little from pixel to pixel"));

    let turned = cube("", "yaw_deg = 9.0");
    let sample = render(&turned, 0);
    let sampled = sample.impression.contact.subpixel.as_ref().expect("a wall");
    let plain = render(&turned.with_policy(EffectPolicy::Without(Effect::Supersampling)), 0);
    let [with, without] = [&sample, &plain].map(|sample| sample.impression.image.rgb.chunks(3));
    for (at, (with, without)) in with.zip(without).enumerate() {
        let [x, y] = [at % 160, at / 160];
        let among = sampled.row(y).iter().any(|pixel| pixel.x as usize == x && pixel.weight > 0.0);
        assert!(with == without || among, "({x}, {y}): {with:?} {without:?}");
    }
    let many: usize = (0..120).map(|y| sampled.row(y).len()).sum();
    assert!((100..4000).contains(&many), "{many} of 19200 pixels are sampled");
}

/// Displacement at a distance from a pixel under pressure 1, endless along one direction, in pitches and 2 / E'.
fn strip(distance: f64) -> f64 {
    let integral = |u: f64| if u == 0.0 { 0.0 } else { u * u.abs().ln() - u };
    (integral(distance - 0.5) - integral(distance + 0.5)) / std::f64::consts::PI
}

/// A rigid flat punch in plane strain on `whole` pixels: half the width of the punch that in closed form displaces the pad as
/// much `away` pixels beside it (Sadowsky 1928). `own` is what the compliance of the outermost pixels has more.
fn half_width(whole: usize, own: f64, away: f64) -> f64 {
    // Pressures that move all pixels by as much, of force 1: the displacements are known but for a constant.
    let row = |a: usize| -> Vec<f64> {
        let own = if a == 0 || a + 1 == whole { own } else { 0.0 };
        (0..whole).map(|b| 10.0 + strip(a.abs_diff(b) as f64) + if a == b { own } else { 0.0 }).collect()
    };
    let unit = solved((0..whole).map(row).collect(), vec![1.0; whole]);
    let force: f64 = unit.iter().sum();
    let at = |x: f64| -> f64 {
        let middle = 0.5 * (whole as f64 - 1.0);
        unit.iter().enumerate().map(|(k, p)| p / force * strip(x - (k as f64 - middle))).sum()
    };
    let outside = 0.5 * whole as f64 + away;
    // The punch itself: where pixels are.
    let drop = at(if whole % 2 == 1 { 0.0 } else { 0.5 }) - at(outside);
    outside / (std::f64::consts::PI * drop).cosh()
}

#[test]
fn a_pixel_that_an_edge_cuts_displaces_the_pad_as_the_edge_where_it_is() {
    let (mut least, mut most) = (f64::INFINITY, f64::NEG_INFINITY);
    for whole in [20, 41, 60] {
        for away in [3.0, 4.5] {
            for step in 0..20 {
                // Where the wall is in the last pixel; an object that is larger by 0.18 pixels may reach into the next.
                let wall = 0.05 * f64::from(step);
                let (last, covered) = if wall + 0.18 > 1.0 { (1, wall - 0.82) } else { (0, wall + 0.18) };
                let count = whole + 2 + 2 * last;
                let found = half_width(count, 0.911 * (1.0 - covered) / covered, away);
                let off = found - 0.5 * whole as f64 - wall;
                (least, most) = (least.min(off), most.max(off));
            }
        }
    }
    println!("edges off by {least:.4} to {most:.4} pixels");
    assert!(least > -0.013 && most < 0.013, "{least} to {most}");
    // On the camera's own grid, where the last pixel is stiffer.
    let off = half_width(40, -0.1, 3.0) - 20.0;
    println!(
        "on the camera's grid by {off:.4}, and by {:.4} if all pixels were alike",
        half_width(40, 0.0, 3.0) - 20.0
    );
    assert!(off.abs() < 0.06, "{off}");
}

/// A 5 mm cube that tilts by 2 degrees, pressed in by 0.3 mm at some angle, on pixels of 0.0625 mm and a third of that: force, N.
fn cube_force_n(level: &str, yaw_deg: f64, finer: usize) -> f64 {
    let plan = plan(&format!(
        "fidelity = '{level}'\npose = {{ yaw_deg = {yaw_deg}, tilt_deg = 2.0, x_mm = 0.013, y_mm = 0.021 }}\n\
         optics = {{ phong = {{ shadows = 'none' }} }}\nindentation.depth_mm = 0.3\n[dataset]\nname = 'cube'\nsamples = 1\n\
         [sensor]\nresolution_px = [{}, {}]\nfield_of_view_mm = [10.0, 8.0]\n\
         [[object]]\npath = 'objects/cube.obj'\n",
        160 * finer,
        128 * finer
    ));
    render(&plan, 0).impression.contact.force_n.expect("a force")
}

#[test]
fn forces_of_walls_hardly_depend_on_the_solvers_grid() {
    for (level, most) in [("draft", 0.008), ("standard", 0.005), ("high", 0.005), ("reference", 0.005)] {
        let mut worst = 0.0_f64;
        for yaw_deg in [0.0, 9.0, 26.6, 45.0, 70.0] {
            let off = cube_force_n(level, yaw_deg, 1) / cube_force_n("reference", yaw_deg, 3) - 1.0;
            worst = worst.max(off.abs());
        }
        println!("{level}: force off by {:.2} %", 100.0 * worst);
        assert!(worst < most, "{level}: {worst}");
    }
}
