//! Walls between pixel centres: where the surface bends within a pixel, light is that of the whole pixel.

use gelsim::core::effects::{Effect, EffectPolicy};
use gelsim::job::plan::Plan;
use gelsim::job::sample::{Sample, render};

use crate::plan::plan;

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

/// Standard deviation along the upper wall of a cube that is turned by 9 degrees, less what changes over 30 pixels: the
/// largest of lines beside the wall, grey levels in all channels together.
fn teeth(plan: &Plan) -> f64 {
    let sample = render(plan, 0);
    let (sin, cos) = 9.0_f64.to_radians().sin_cos();
    let line = |aside: f64| -> Vec<f64> {
        let at = |along: f64| {
            // From the cube's middle, which is the image's.
            let (x, y) = (79.5 + along * cos - aside * sin, 59.5 + along * sin + aside * cos);
            let (u, v) = (x.fract(), y.fract());
            let at = |dx: usize, dy: usize| change(plan, &sample, x as usize + dx, y as usize + dy);
            (at(0, 0) * (1.0 - u) + at(1, 0) * u) * (1.0 - v) + (at(0, 1) * (1.0 - u) + at(1, 1) * u) * v
        };
        (-60..=60).map(|step| at(0.5 * f64::from(step))).collect()
    };
    let deviation = |line: Vec<f64>| {
        let rough = line.windows(61).map(|window| window[30] - window.iter().sum::<f64>() / 61.0);
        let squares: Vec<f64> = rough.map(|value| value * value).collect();
        (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
    };
    (-110..=-40).map(|step| deviation(line(0.5 * f64::from(step)))).fold(0.0, f64::max)
}

#[test]
fn a_turned_wall_has_no_saw_teeth() {
    for (gelpad, at_most) in [("gelpad = 'none'", 0.4), ("fidelity = 'high'", 0.7)] {
        let plan = cube(gelpad, "yaw_deg = 9.0");
        let [with, without] = [EffectPolicy::WhereNeeded, EffectPolicy::Without(Effect::Supersampling)]
            .map(|it| teeth(&plan.with_policy(it)));
        println!("{gelpad}: {with:.1} levels with samples between the centres, {without:.1} without");
        assert!(with < at_most * without, "{gelpad}: {with} against {without}");
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
        let among = sampled.row(y).iter().any(|pixel| pixel.x == x && pixel.weight > 0.0);
        assert!(with == without || among, "({x}, {y}): {with:?} {without:?}");
    }
    let many: usize = (0..120).map(|y| sampled.row(y).len()).sum();
    assert!((100..4000).contains(&many), "{many} of 19200 pixels are sampled");
}
