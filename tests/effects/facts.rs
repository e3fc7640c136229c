//! What is known of each effect whatever else happens: what it can only lower, what it keeps, how large it is.

use gelsim_core::effects::EffectLog;
use gelsim_core::simulator::Stages;
use gelsim_job::plan::Plan;
use gelsim_job::sample::Sample;
use gelsim_job::sample::render;

use crate::plan::plan;

/// A press in the middle of the view.
const PRESS: &str = "fidelity = 'standard'\nindentation.depth_mm = 0.8\n";
const UNTOUCHED: &str = "indentation = { depth_mm = 0.8, no_contact = 1.0 }\n";
/// An even grey picture.
const EVEN: &str =
    "sensor.rendered_background = { color = [0.4, 0.4, 0.4], glow = 0.0, vignette = 0.0, grain = 0.0 }\n";

fn sample(press: &str, more: &str) -> (Plan, Sample) {
    let plan = plan(&format!(
        "{press}{more}\ndataset = {{ name = 'facts', samples = 1 }}\nsensor.resolution_px = [96, 72]\n\
         object = [{{ path = 'objects/sphere.obj' }}]\n"
    ));
    let sample = render(&plan, 0);
    (plan, sample)
}

fn image(press: &str, more: &str) -> Vec<u8> {
    sample(press, more).1.impression.image.rgb
}

fn mean(values: &[u8]) -> f64 {
    values.iter().map(|value| f64::from(*value)).sum::<f64>() / values.len() as f64
}

fn variance(values: &[u8]) -> f64 {
    let mean = mean(values);
    values.iter().map(|value| (f64::from(*value) - mean).powi(2)).sum::<f64>() / values.len() as f64
}

/// Each value of the first image is at most that of the second, and some are less.
fn assert_darker(first: &[u8], second: &[u8], what: &str) {
    assert!(first.iter().zip(second).all(|(a, b)| a <= b), "{what} brightens");
    assert!(first != second, "{what} changes nothing");
}

#[test]
fn light_is_only_lost_to_shadows_darkening_ink_and_vignette() {
    let plain = image(PRESS, "optics.phong = { shadows = 'none', darkening = 0.0 }");
    assert_darker(&image(PRESS, "optics.phong = { darkening = 0.0 }"), &plain, "a shadow");
    assert_darker(&image(UNTOUCHED, "markers = {}"), &image(UNTOUCHED, ""), "ink");
    assert_darker(&image(PRESS, "markers = {}"), &image(PRESS, ""), "ink");
    assert_darker(&image(PRESS, "camera.vignette = 0.5"), &image(PRESS, ""), "a vignette");
    let (plan, deep) = sample(PRESS, "optics.phong = { shadows = 'none', darkening = 1.0 }");
    let surface = deep.impression.contact.surface.inner(1);
    for (at, value) in deep.impression.image.rgb.iter().enumerate() {
        let pressed = surface.data[at / 3] > 0.0;
        assert!(if pressed { *value <= plain[at] } else { *value >= plain[at] }, "{at} of {:?}", plan.simulator.view());
    }
}

#[test]
fn specks_of_dust_stay_where_they_are_and_are_more_where_the_pad_has_more() {
    let pad = |density: f64, resolution: &str| {
        let dust = format!("grain = 0.0, dust_per_cm2 = {density:?}, dust_size_mm = 0.2");
        plan(&format!(
            "dataset = {{ name = 'dust', samples = 1 }}\nsensor.resolution_px = {resolution}\n\
             object = [{{ path = 'objects/sphere.obj' }}]\nindentation.depth_mm = 0.5\n{}",
            EVEN.replace("grain = 0.0", &dust)
        ))
    };
    let changed = |plan: &Plan| plan.simulator.background().rgb.iter().map(|value| *value != 102).collect::<Vec<_>>();
    let share = |pixels: &[bool]| pixels.iter().filter(|pixel| **pixel).count() as f64 / pixels.len() as f64;
    let (none, few, many) =
        (changed(&pad(0.0, "[160, 120]")), changed(&pad(5.0, "[160, 120]")), changed(&pad(40.0, "[160, 120]")));
    assert_eq!(share(&none), 0.0);
    // Here and there a bright speck lies on a dark one.
    let gone: Vec<bool> = few.iter().zip(&many).map(|(few, many)| *few && !*many).collect();
    assert!(share(&gone) < 0.02 * share(&few), "specks of the sparser pad are gone: {}", share(&gone));
    assert!((0.01..0.05).contains(&share(&few)) && share(&many) > 4.0 * share(&few), "{}", share(&few));
    // The same specks in another resolution.
    let finer = share(&changed(&pad(40.0, "[320, 240]")));
    assert!((finer / share(&many) - 1.0).abs() < 0.1, "{finer} and {}", share(&many));
    let darkest = *pad(40.0, "[160, 120]").simulator.background().rgb.iter().min().expect("pixels");
    assert!((70..100).contains(&darkest), "{darkest}");
}

#[test]
fn an_led_glows_from_where_it_is_however_that_is_said() {
    let edges = |led: &str| {
        let plan = plan(&format!(
            "dataset = {{ name = 'glow', samples = 1 }}\nobject = [{{ path = 'objects/sphere.obj' }}]\n\
             indentation.depth_mm = 0.5\noptics = 'led'\n[sensor]\nresolution_px = [64, 64]\n\
             field_of_view_mm = [16.0, 16.0]\nrendered_background.grain = 0.0\nled = [{{ color = [1, 0, 0], {led} }}]\n"
        ));
        let picture = plan.simulator.background();
        let red = |x: usize, y: usize| picture.rgb[3 * (y * 64 + x)];
        let label = render(&plan, 0).label.sensor.leds[0].clone();
        (
            [red(0, 32), red(63, 32), red(32, 0), red(32, 63)],
            [label.azimuth_deg, label.elevation_deg, label.distance_mm],
        )
    };
    for (placed, azimuth_deg) in
        [("[0.0, -10.0, -5.0]", -90.0), ("[-10.0, 0.0, -5.0]", 180.0), ("[0.0, 10.0, -5.0]", 90.0)]
    {
        let (placed, label) = edges(&format!("position_mm = {placed}"));
        let elevation_deg = 0.5_f64.atan().to_degrees();
        let (turned, _) = edges(&format!("azimuth_deg = {azimuth_deg:?}, elevation_deg = {elevation_deg:?}"));
        assert_eq!(placed, turned);
        assert!(placed.iter().max() > placed.iter().min(), "{placed:?}");
        for (found, expected) in label.into_iter().zip([azimuth_deg, elevation_deg, 125.0_f64.sqrt()]) {
            assert!((found - expected).abs() < 1e-9, "{found} {expected}");
        }
    }
}

#[test]
fn a_vignette_takes_its_share_in_the_corners_and_nothing_in_the_middle() {
    let kept = image(UNTOUCHED, &format!("{EVEN}camera.vignette = 0.5"));
    let (corner, middle) = (f64::from(kept[0]) / 255.0, f64::from(kept[3 * (36 * 96 + 48)]) / 255.0);
    assert!((corner - 0.2).abs() < 0.008, "{corner}");
    assert!((middle - 0.4).abs() < 0.003, "{middle}");
}

#[test]
fn twice_the_exposure_is_twice_the_light_up_to_white() {
    for press in [PRESS, UNTOUCHED] {
        let (once, twice) = (image(press, ""), image(press, "camera.exposure = 2.0"));
        for (once, twice) in once.iter().zip(&twice) {
            let expected = (2 * u16::from(*once)).min(255);
            assert!(expected.abs_diff(u16::from(*twice)) <= 1, "{once} becomes {twice}");
        }
        let red = image(press, "camera.red_gain = 2.0");
        let same = |channel: usize| red.iter().zip(&once).skip(channel).step_by(3).all(|(a, b)| a == b);
        assert_eq!([0, 1, 2].map(same), [false, true, true], "only red");
    }
}

#[test]
fn noise_has_the_variance_that_is_asked_for() {
    // Rounding to whole levels adds a twelfth; light of 0.4 has 0.4 of the shot noise's variance.
    for (lines, expected) in [
        ("camera.read_noise_levels = 3.0", 9.0),
        ("camera.shot_noise_levels = 5.0", 0.4 * 25.0),
        ("camera = { read_noise_levels = 3.0, shot_noise_levels = 5.0 }", 19.0),
        ("camera = { read_noise_levels = 3.0, exposure = 0.5 }", 9.0),
    ] {
        let found = variance(&image(UNTOUCHED, &format!("{EVEN}{lines}"))) - 1.0 / 12.0;
        // Of 20736 values the variance is known within 1 %: four times that.
        assert!((found / expected - 1.0).abs() < 0.04, "{found} for {expected}, {lines}");
    }
    assert_eq!(variance(&image(UNTOUCHED, EVEN)), 0.0);
}

#[test]
fn the_untouched_pad_at_another_moment_differs_by_noise_of_its_own() {
    // Where the press changes no light two frames differ by the noise of both, which have nothing in common.
    for (lines, of_one) in [
        ("camera.read_noise_levels = 3.0", 9.0),
        ("camera = { read_noise_levels = 2.0, shot_noise_levels = 5.0, exposure = 1.5 }", 4.0 + 0.6 * 25.0),
    ] {
        let exposure =
            lines.split("exposure").nth(1).map_or(String::new(), |rest| format!("camera = {{ exposure{rest}"));
        let (noiseless, rest) =
            (image(PRESS, &format!("{EVEN}{exposure}")), image(UNTOUCHED, &format!("{EVEN}{exposure}")));
        let (_, sample) = sample(PRESS, &format!("{EVEN}{lines}"));
        let before = sample.simulator.untouched_beside(&sample.impression).rgb;
        let away = (0..rest.len()).filter(|at| noiseless[*at] == rest[*at]);
        let differences: Vec<f64> =
            away.map(|at| f64::from(sample.impression.image.rgb[at]) - f64::from(before[at])).collect();
        let count = differences.len() as f64;
        let mean = differences.iter().sum::<f64>() / count;
        let variance = differences.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / count;
        // Each is rounded to whole levels.
        let expected = 2.0 * (of_one + 1.0 / 12.0);
        assert!(count > 5000.0 && mean.abs() < 5.0 * (expected / count).sqrt(), "{mean} over {count}");
        assert!((variance / expected - 1.0).abs() < 5.0 * (2.0 / count).sqrt(), "{variance} for {expected}, {lines}");
        assert_eq!(before, sample.simulator.untouched_beside(&sample.impression).rgb);
    }
}

#[test]
fn the_untouched_pad_at_another_moment_is_what_the_samples_camera_shows_of_it() {
    for lines in [
        "",
        "camera = { exposure = [0.5, 1.4], red_gain = [0.9, 1.1] }",
        "camera = { distortion_k1 = [-0.2, 0.2], vignette = [0.1, 0.4], defocus_mm = [0.02, 0.1] }",
        "markers = { pitch_mm = [1.5, 2.5] }\ncamera = { distortion_k1 = [-0.2, 0.2], exposure = 0.8 }",
        "camera.speckle_levels = 5.0",
    ] {
        let (_, pressed) = sample(PRESS, lines);
        let shown = pressed.simulator.untouched_beside(&pressed.impression).rgb;
        assert_eq!(shown, image(UNTOUCHED, lines), "{lines}");
        assert_ne!(shown, pressed.impression.image.rgb, "{lines}");
        assert!(!lines.is_empty() || shown == pressed.simulator.untouched().rgb);
    }
    // What a press that touches nothing shows is another frame.
    let (_, nothing) = sample(UNTOUCHED, "camera.read_noise_levels = 3.0");
    assert_ne!(nothing.simulator.untouched_beside(&nothing.impression).rgb, nothing.impression.image.rgb);
}

#[test]
fn light_that_is_shaded_some_rows_at_a_time_is_that_shaded_at_once() {
    let rough = "sensor.grain = { height_um = 3.0, size_mm = 0.1 }";
    let pyramid = "indentation.depth_mm = 0.5\noptics.phong = { darkening = 0.2 }";
    for (press, lines) in [(PRESS, ""), (PRESS, rough), (pyramid, ""), (PRESS, "sensor.preset = 'digit'")] {
        let (plan, sample) = sample(press, lines);
        let (simulator, contact) = (&plan.simulator, &sample.impression.contact);
        let at_once = simulator.shade_contact(contact);
        assert!(at_once.region.height() > 32, "{lines}: more rows than are shaded at a time");
        let (camera, mut effects) = (&sample.impression.camera, EffectLog::new(simulator.policy()));
        let image = simulator.camera().expose(at_once.into(), Some(&contact.mask), None, camera, &mut effects);
        assert_eq!(image.rgb, sample.impression.image.rgb, "{lines}");
        assert_eq!(image.clipped_px, sample.impression.image.clipped_px, "{lines}");
        assert_eq!(image.saturated_px, sample.impression.image.saturated_px, "{lines}");
    }
}

#[test]
fn defocus_keeps_the_light_and_smooths_it() {
    let (sharp, soft) = (image(PRESS, ""), image(PRESS, "camera.defocus_mm = 0.4"));
    assert!((mean(&sharp) - mean(&soft)).abs() < 0.1, "{} and {}", mean(&sharp), mean(&soft));
    assert!(variance(&soft) < 0.9 * variance(&sharp), "{} and {}", variance(&sharp), variance(&soft));
}

#[test]
fn texture_and_curvature_never_deepen() {
    let flat = sample(PRESS, "").1.impression.depth.below_pad();
    for lines in [
        "texture = { patterns = ['noise'], amplitude_mm = 0.3 }",
        "texture = { patterns = ['woven'], amplitude_mm = 0.05, scale_mm = 1.0 }",
        "texture = { patterns = ['dimples'], amplitude_mm = 5.0, scale_mm = 2.0 }",
        "sensor.rest_shape.dome.radius_mm = 13.0",
        "sensor.rest_shape.dome.radius_mm = 200.0",
    ] {
        let less = sample(PRESS, lines).1.impression.depth.below_pad();
        assert!(less.data.iter().zip(&flat.data).all(|(a, b)| (0.0..=*b).contains(a)), "{lines} deepens");
        assert!(less != flat, "{lines} changes nothing");
    }
}

#[test]
fn markers_follow_the_object_and_are_told_where_they_are_seen() {
    let mut before = 0.0;
    for shift_mm in ["0.0", "0.1", "0.3"] {
        let lens = "camera.distortion_k1 = 0.1";
        let (plan, sample) = sample(PRESS, &format!("markers.pitch_mm = 0.8\nshear.x_mm = {shift_mm}\n{lens}"));
        let (label, size) = (&sample.label.markers, plan.simulator.view().resolution_px);
        let ink = sample.impression.markers.as_ref().expect("the pad has markers");
        let seen: Vec<_> = ink.in_view(sample.impression.lens.as_ref(), size).collect();
        assert_eq!(seen.len(), label.count as usize);
        // 25 columns and 18 rows at 0.8 mm on 20 mm x 15 mm; a barrel-shaped picture shows some from beyond.
        assert!((400..600).contains(&label.count), "{} markers", label.count);
        for (rest, moved) in seen {
            let inside = |[x, y]: [f64; 2]| (0.0..=96.0).contains(&x) && (0.0..=72.0).contains(&y);
            assert!(inside(rest) || inside(moved), "{rest:?} {moved:?}");
            assert!(
                (0..2).all(|k| (moved[k] - rest[k]).abs() <= label.max_motion_px),
                "{rest:?} {moved:?}, at most {}",
                label.max_motion_px
            );
        }
        let by_px = label.max_motion_px - before;
        assert!(by_px > 0.0, "further pushed, further moved");
        before = label.max_motion_px;
    }
    // 0.3 mm are 1.44 px; the press moves dots by itself.
    assert!((1.2..3.0).contains(&before), "{before} px");
}
