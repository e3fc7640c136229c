use std::path::Path;

use image::{Rgb, RgbImage};
use proptest::prelude::*;

use super::background::BackgroundSwap;
use super::{AppliedAugmentation, Photometric, PhotometricRecipe, SensorProfile};
use gelsim_core::base::light::quantise;
use gelsim_core::base::view::View;
use gelsim_core::camera::noise::Noise;
use gelsim_core::optics::background::BackgroundImage;
use gelsim_files::diagnostic::{Diagnostics, Report};
use gelsim_files::sensor::Sensor;
use gelsim_job::config::document::Document;
use gelsim_job::plan::check::JobChecker;
use gelsim_lab::metrics::noise::NoiseLevel;

const SIZE: [u32; 2] = [48, 36];

fn profile(background: Option<BackgroundImage>) -> SensorProfile {
    let sensor = Sensor { resolution_px: SIZE, field_of_view_mm: [9.6, 7.2], ..Sensor::default() };
    let view = View { resolution_px: SIZE.map(|px| px as usize), mm_per_px: [0.2; 2] };
    let noise = Some(NoiseLevel { read_levels: 1.5, shot_levels: 0.0 });
    SensorProfile { sensor, view, background, noise }
}

fn table(text: &str) -> Photometric {
    toml::from_str(text).expect("a table")
}

/// A picture with soft shapes that keeps away from black and white.
fn picture(salt: u32) -> RgbImage {
    RgbImage::from_fn(SIZE[0], SIZE[1], |x, y| {
        let wave = |k: u32| {
            let phase = 0.21 * f64::from(x * (k + 1)) + 0.17 * f64::from(y) + f64::from(salt * (k + 3));
            (120.0 + 55.0 * phase.sin()) as u8
        };
        Rgb([wave(0), wave(1), wave(2)])
    })
}

fn reference(picture: &RgbImage) -> BackgroundImage {
    BackgroundImage::new(picture.width() as usize, picture.height() as usize, picture.as_raw().clone())
}

fn made(text: &str, image: &RgbImage) -> (Vec<u8>, AppliedAugmentation) {
    let (image, applied) = PhotometricRecipe::new(table(text), &profile(None), Vec::new()).apply(image, 7, 3);
    (image.rgb, applied)
}

/// Compares with what the picture should be before rounding, levels; cut to 0 .. 255.
fn assert_levels(found: &[u8], exact: impl Fn(usize, usize, usize) -> f64) {
    for (at, found) in found.iter().enumerate() {
        let (x, y, k) = (at / 3 % SIZE[0] as usize, at / 3 / SIZE[0] as usize, at % 3);
        let exact = exact(x, y, k).clamp(0.0, 255.0);
        assert!((f64::from(*found) - exact).abs() < 0.501, "{x} {y} {k}: {found} {exact}");
    }
}

fn level(picture: &RgbImage, x: usize, y: usize, k: usize) -> f64 {
    f64::from(picture.get_pixel(x as u32, y as u32).0[k])
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn neutral_settings_change_no_byte(bytes in prop::collection::vec(any::<u8>(), 48 * 36 * 3), number: u64) {
        let image = RgbImage::from_raw(SIZE[0], SIZE[1], bytes).expect("as many bytes");
        let own = reference(&picture(1));
        let same = vec![BackgroundSwap::new("same", &own, &own.rgb)];
        let dotless = "markers = { diameter_mm = 0.0 }";
        // As much noise as there is already; the same background; gains that undo each other.
        for (text, swaps) in [
            ("", vec![]),
            ("noise_level = 1.0", vec![]),
            (dotless, vec![]),
            ("", same),
            ("led_gain = 2.0\nexposure_ev = -1.0", vec![]),
        ] {
            let (out, applied) = PhotometricRecipe::new(table(text), &profile(Some(own.clone())), swaps).apply(&image, 5, number);
            prop_assert_eq!(&out.rgb, image.as_raw(), "{}", text);
            prop_assert_eq!(applied.clipped_px, 0);
            prop_assert_eq!(applied.saturated_before_px, applied.saturated_px);
        }
    }
}

#[test]
fn a_swap_is_image_minus_own_plus_other_and_what_is_cut_is_counted() {
    let (image, own, other) = (picture(1), picture(2), picture(3));
    let swaps = vec![BackgroundSwap::new("other", &reference(&own), other.as_raw())];
    let (out, applied) = PhotometricRecipe::new(table(""), &profile(Some(reference(&own))), swaps).apply(&image, 1, 1);
    let exact = |x, y, k| level(&image, x, y, k) - level(&own, x, y, k) + level(&other, x, y, k);
    assert_levels(&out.rgb, exact);
    let cut = |x: u32, y: u32| (0..3).any(|k| !(0.0..=255.0).contains(&exact(x as usize, y as usize, k)));
    let count = (0..SIZE[1]).flat_map(|y| (0..SIZE[0]).map(move |x| (x, y))).filter(|(x, y)| cut(*x, *y)).count();
    assert!(count > 0, "the case is too easy");
    assert_eq!((applied.clipped_px, applied.background.as_str()), (count as u64, "other"));
}

#[test]
fn gains_multiply_each_channel_and_are_reported() {
    let image = picture(1);
    let (out, applied) = made("led_gain = [0.7, 1.2]\nwhite_balance = [0.9, 1.1]\nexposure_ev = [-0.5, 0.5]", &image);
    let AppliedAugmentation { led_gains: led, white_balance: [red, blue], exposure_ev, .. } = applied;
    assert!(led[0] != led[1] && led[1] != led[2] && red != blue && exposure_ev != 0.0, "{applied:?}");
    assert!(led.iter().all(|gain| (0.7..=1.2).contains(gain)) && (0.9..=1.1).contains(&red));
    let gains = [led[0] * red, led[1], led[2] * blue].map(|gain| gain * exposure_ev.exp2());
    assert_levels(&out, |x, y, k| gains[k] * level(&image, x, y, k));
}

#[test]
fn a_vignette_takes_its_fraction_in_the_corners_and_nothing_in_the_middle() {
    let image = picture(2);
    let (out, _) = made("vignette = 0.4", &image);
    assert_levels(&out, |x, y, k| {
        let [right, down] = [(x, SIZE[0]), (y, SIZE[1])].map(|(at, size)| at as f64 + 0.5 - f64::from(size) / 2.0);
        let corner2 = f64::from(SIZE[0] * SIZE[0] + SIZE[1] * SIZE[1]) / 4.0;
        level(&image, x, y, k) * (1.0 - 0.4 * (right * right + down * down) / corner2)
    });
}

#[test]
fn a_defocus_is_the_double_sum_with_the_discrete_gaussian() {
    let image = picture(3);
    let sigma = 1.3_f64;
    let (out, _) = made("blur_px = 1.3", &image);
    // exp(-t) I_k(t) as the integral that defines it.
    let weight = |k: isize| {
        let angles = (0..2000).map(|i| std::f64::consts::PI * (f64::from(i) + 0.5) / 2000.0);
        angles.map(|a| (sigma * sigma * (a.cos() - 1.0)).exp() * (k as f64 * a).cos()).sum::<f64>() / 2000.0
    };
    // Cut at four standard deviations, and scaled to the sum 1.
    let weights: Vec<f64> = (-6..=6).map(weight).collect();
    let total: f64 = weights.iter().sum();
    assert_levels(&out, |x, y, k| {
        let near = |at: usize, by: usize, size: u32| (at + by).saturating_sub(6).min(size as usize - 1);
        let mut sum = 0.0;
        for (v, down) in weights.iter().enumerate() {
            for (u, across) in weights.iter().enumerate() {
                sum += across * down * level(&image, near(x, u, SIZE[0]), near(y, v, SIZE[1]), k);
            }
        }
        sum / (total * total)
    });
}

#[test]
fn markers_take_the_light_where_they_are_printed_and_as_much_as_their_area_says() {
    let image = RgbImage::from_pixel(SIZE[0], SIZE[1], Rgb([200; 3]));
    let text =
        "markers = { pitch_mm = 2.4, diameter_mm = 0.8, jitter_mm = 0.0, edge_mm = 0.05, color = [0.0, 0.5, 1.0] }";
    let (out, applied) = made(text, &image);
    assert_eq!((applied.marker_pitch_mm, applied.marker_diameter_mm), (2.4, 0.8));
    let at = |x: usize, y: usize| &out[3 * (y * SIZE[0] as usize + x)..][..3];
    // A dot of 4 px is printed on the corner between the four middle pixels, others 12 px apart.
    assert_eq!((at(24, 18), at(12, 6), at(18, 12)), (&[0, 100, 200][..], &[0, 100, 200][..], &[200; 3][..]));
    let lost: f64 = out.iter().step_by(3).map(|red| 1.0 - f64::from(*red) / 200.0).sum();
    // Ink of the middle dot. Nine dots are complete, and those on the border add parts.
    let one: f64 = (14..22).flat_map(|y| (20..28).map(move |x| 1.0 - f64::from(at(x, y)[0]) / 200.0)).sum();
    assert!((one - std::f64::consts::PI * 4.0).abs() < 0.15, "{one}");
    assert!(lost > 9.0 * one - 0.5, "{lost} {one}");
}

/// A picture with this noise on it, and a press that differs from one number to the next.
fn noisy(levels: f64, number: u32) -> RgbImage {
    let (width, height) = (160, 120);
    let (x0, y0) = (40.0 + 11.0 * f64::from(number % 5), 60.0 - 7.0 * f64::from(number % 3));
    let mut planes = [0.45_f32, 0.5, 0.4].map(|base| vec![base; width * height]);
    for (at, value) in planes[1].iter_mut().enumerate() {
        let (x, y) = ((at % width) as f64 - x0, (at / width) as f64 - y0);
        *value += 0.2 * (-(x * x + y * y) / 300.0).exp() as f32;
    }
    let read = (levels / 255.0) as f32;
    Noise { read, shot: 0.0, color: [1.0; 3], correlation: 0.0, key: u64::from(number) }.add_to_planes(
        width,
        &mut planes,
        None,
    );
    RgbImage::from_fn(width as u32, height as u32, |x, y| {
        let at = y as usize * width + x as usize;
        Rgb(std::array::from_fn(|k| quantise(planes[k][at])))
    })
}

#[test]
fn noise_is_measured_between_images_of_other_presses() {
    for levels in [0.0, 0.6, 1.5, 4.0] {
        let images: Vec<RgbImage> = (0..4).map(|number| noisy(levels, number)).collect();
        let found = NoiseLevel::from_images(&images).expect("pairs").read_levels;
        assert!((found - levels).abs() < 0.03 * levels + 0.05, "{levels}: {found}");
    }
    assert_eq!(NoiseLevel::from_images(&[noisy(1.0, 1)]), None);
}

#[test]
fn an_image_ends_with_as_much_noise_as_was_wanted_whatever_blur_and_gains_left_of_its_own() {
    let profile = SensorProfile {
        view: View { resolution_px: [160, 120], mm_per_px: [0.1; 2] },
        noise: Some(NoiseLevel { read_levels: 2.0, shot_levels: 0.0 }),
        ..profile(None)
    };
    for (text, wanted) in [
        ("noise_level = 1.0\nexposure_ev = -0.5", 1.0),
        ("noise_level = 2.0\nexposure_ev = 0.4", 2.0),
        ("noise_level = 1.5", 1.5),
        ("noise_level = 0.5", 1.0),
    ] {
        let recipe = PhotometricRecipe::new(table(text), &profile, Vec::new());
        let out: Vec<RgbImage> = (0..4)
            .map(|number| {
                let (image, _) = recipe.apply(&noisy(2.0, number), 1, number.into());
                RgbImage::from_raw(160, 120, image.rgb).expect("as many bytes")
            })
            .collect();
        let found = NoiseLevel::from_images(&out).expect("pairs").read_levels / 2.0;
        assert!((found - wanted).abs() < 0.05 * wanted, "{text}: {found}");
    }
    // Blurred noise is not white, and the mask does not see it: the variances are compared pixel by pixel instead.
    let recipe = PhotometricRecipe::new(table("noise_level = 1.0\nblur_px = 0.8"), &profile, Vec::new());
    let (blurred, applied) = recipe.apply(&noisy(2.0, 0), 1, 0);
    let (smooth, _) = PhotometricRecipe::new(table("blur_px = 0.8"), &profile, Vec::new()).apply(&noisy(0.0, 0), 1, 0);
    let squares = blurred.rgb.iter().zip(&smooth.rgb).map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2));
    let deviation = (squares.sum::<f64>() / blurred.rgb.len() as f64 - 2.0 / 12.0).sqrt();
    assert!((deviation - 2.0).abs() < 0.05, "{deviation} {applied:?}");
    assert!((1.5..2.0).contains(&applied.added_read_noise_levels), "{applied:?}");
}

#[test]
fn what_is_drawn_depends_on_seed_and_number_only_and_differs_between_them() {
    let own = reference(&picture(1));
    let swaps = || {
        vec![BackgroundSwap::new("a", &own, picture(4).as_raw()), BackgroundSwap::new("b", &own, picture(5).as_raw())]
    };
    let text = "led_gain = [0.8, 1.2]\nwhite_balance = [0.8, 1.2]\nexposure_ev = [-1.0, 1.0]\nnoise_level = [1.0, 3.0]\n\
                blur_px = [0.1, 1.0]\nvignette = [0.0, 0.5]\nmarkers = { pitch_mm = [1.0, 2.0], diameter_mm = 0.4 }";
    let recipe = PhotometricRecipe::new(table(text), &profile(Some(own.clone())), swaps());
    let apply = |seed, number| recipe.apply(&picture(1), seed, number);
    let (first, applied) = apply(7, 3);
    let again = PhotometricRecipe::new(table(text), &profile(Some(own.clone())), swaps()).apply(&picture(1), 7, 3);
    assert_eq!((&first.rgb, &applied), (&again.0.rgb, &again.1));
    for (seed, number) in [(7, 4), (8, 3)] {
        let (other, drawn) = apply(seed, number);
        assert_ne!(other.rgb, first.rgb);
        assert!(
            drawn.defocus_px != applied.defocus_px && drawn.marker_pitch_mm != applied.marker_pitch_mm,
            "{drawn:?}"
        );
    }
    let backgrounds: Vec<String> = (0..40).map(|number| apply(7, number).1.background).collect();
    assert!(["a", "b"].iter().all(|name| backgrounds.iter().any(|found| found == name)), "{backgrounds:?}");
}

/// Returns the report on a file with these tables.
fn report(text: &str, profile: &SensorProfile) -> String {
    #[derive(serde::Deserialize)]
    struct File {
        photometric: Vec<Photometric>,
    }
    let mut problems = Diagnostics::default();
    let document = Document::parse("augment.toml", text.to_owned(), Path::new(""), &mut problems);
    let file: File = toml::from_str(text).expect("tables");
    let mut check = JobChecker { document: &document, problems: &mut problems };
    for (i, table) in file.photometric.iter().enumerate() {
        let at = format!("photometric.{i}");
        table.check(&mut check, &at, Some(profile));
        let ready = table.build_recipe(&mut check, &at, profile);
        assert_eq!(ready.is_none(), !check.is_valid(&at), "{at}");
    }
    Report::new(&problems, &document.sources).to_string()
}

#[test]
fn every_mistake_is_said_with_its_place() {
    let text = "[[photometric]]\ncopies = 0\nled_gain = [0.0, 1.0]\nblur_px = 30\nbackground = [\"none.png\"]\n\
                [[photometric]]\nvignette = 2.0\nexposure_ev = 9\nmarkers = { pitch_mm = 0.001 }\nwhite_balance = -1\n\
                [[photometric]]\nnoise_level = 1.0\n";
    let silent = SensorProfile { noise: None, ..profile(None) };
    let found = report(text, &silent);
    for (line, words) in [
        (2, "copies = 0"),
        (3, "led_gain may be 0 to 1"),
        (4, "blur_px may be 30"),
        (5, "own background is not known"),
        (7, "vignette may be 2"),
        (8, "exposure_ev may be 9"),
        (9, "pitch_mm may be 0.001"),
        (10, "white_balance may be -1"),
        (12, "nothing is known of this sensor's noise"),
    ] {
        let place = found.split("error: ").find(|paragraph| paragraph.contains(words));
        let place = place.unwrap_or_else(|| panic!("{words}: {found}"));
        assert!(place.contains(&format!("augment.toml:{line}:")), "{words}: {place}");
    }
    let with_background = profile(Some(reference(&picture(1))));
    let unread = report("[[photometric]]\nbackground = [\"rendered\", \"/nowhere/none.png\"]\n", &with_background);
    assert!(unread.contains("cannot read the background /nowhere/none.png"), "{unread}");
    assert_eq!(report("[[photometric]]\nbackground = [\"rendered\"]\nnoise_level = 1.2\n", &with_background), "");
}
