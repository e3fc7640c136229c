//! The range of every key of a job.

use super::check::Check;
use super::chosen_models;
use super::remedies;
use super::sensors::support;
use crate::config::Job;
use crate::config::document::Document;
use crate::config::fidelity::FidelityChoice;
use crate::config::texture::TextureDistribution;
use crate::layers::OutputLayer;
use gelsim_core::camera::lens;
use gelsim_core::camera::noise::MOST_CORRELATION;
use gelsim_core::fidelity::Models;
use gelsim_core::gelpad::elastic::shear::Friction;
use gelsim_core::optics::calibrated::Calibrated;
use gelsim_core::optics::lamps;
use gelsim_core::{gelpad, optics};
use gelsim_files::diagnostic::{Diagnostic, Diagnostics};
use gelsim_files::figures::{figure, tidy};
use gelsim_files::sensor::RestShape;
use gelsim_files::sensor::markers::MarkerDistribution;
use gelsim_files::sensor::unit::Unit;

/// LEDs that a sensor may have.
const MOST_LEDS: usize = 64;

/// Longer side of a pixel over its shorter one: the pad's response to one that is much longer takes minutes.
const LONGEST_PIXEL: f64 = 1000.0;

/// `[dataset]`.
pub fn dataset(check: &mut Check<'_>, job: &Job) {
    let dataset = &job.dataset;
    match &dataset.name {
        None => check.missing("dataset.name", "for example name = \"quickstart\""),
        Some(name) => {
            let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
            if name.is_empty() || name.len() > 100 || name.starts_with('.') || !name.chars().all(plain) {
                check.error(
                    "dataset.name",
                    format!("{name:?} cannot be the name of a dataset"),
                    "use 1 to 100 letters, digits, `-`, `_` and `.`, not starting with `.`",
                );
            }
        }
    }
    match dataset.samples {
        None => check.missing("dataset.samples", "for example samples = 200"),
        Some(samples) => check.number("dataset.samples", samples as f64, 1.0..=1e9, "samples"),
    }
    seed(check, job);
    check.number("dataset.samples_per_shard", dataset.samples_per_shard as f64, 1.0..=1e6, "samples");
    let shards = dataset.samples.unwrap_or(0).div_ceil(dataset.samples_per_shard.max(1));
    if shards >= 1_000_000 && check.sound("dataset.samples") && check.sound("dataset.samples_per_shard") {
        let message = format!("{shards} shards are too many: their names count to 999999");
        let least = dataset.samples.unwrap_or(0).div_ceil(999_999);
        check.error("dataset.samples_per_shard", message, format!("write samples_per_shard = {least} or more"));
    }
    let splits = dataset.splits;
    let sum = splits.train + splits.val + splits.test;
    let all_positive = [splits.train, splits.val, splits.test].iter().all(|share| *share >= 0.0);
    if (sum - 1.0).abs() > 1e-9 && all_positive && sum > 0.0 && sum.is_finite() && check.sound("dataset.splits") {
        let message = match (sum - 100.0).abs() < 1e-6 {
            true => String::from("the splits are percentages, and shares belong here"),
            false => format!("the splits sum to {sum}"),
        };
        let [train, val, test] = shares_near([splits.train, splits.val, splits.test]);
        let help = format!("they must sum to 1: splits = {{ train = {train}, val = {val}, test = {test} }}");
        return check.error("dataset.splits", message, help);
    }
    for (name, share) in [("train", splits.train), ("val", splits.val), ("test", splits.test)] {
        check.number(&format!("dataset.splits.{name}"), share, 0.0..=1.0, "");
    }
    if sum == 0.0 && check.sound("dataset.splits") {
        check.error("dataset.splits", "the splits sum to 0", "they must sum to 1: leave `splits` out for train alone");
    }
}

/// Shares near these that sum to 1: what is missing goes to a split without any, from the last; else they are scaled.
fn shares_near(mut shares: [f64; 3]) -> [f64; 3] {
    let sum: f64 = shares.iter().sum();
    let missing = 1.0 - sum;
    let rounded = |share: f64| (1e4 * share).round() / 1e4;
    match shares.iter().rposition(|share| *share == 0.0).filter(|_| missing > 0.0) {
        Some(free) => shares[free] = missing,
        None => shares = shares.map(|share| share / sum),
    }
    let [_, val, test] = shares.map(rounded);
    [rounded(1.0 - val - test), val, test]
}

/// `[dataset] seed`, which JSON's readers take for a float.
pub fn seed(check: &mut Check<'_>, job: &Job) {
    check.number("dataset.seed", job.dataset.seed as f64, 0.0..=9_007_199_254_740_991.0, "");
}

/// `[sensor]`.
pub fn sensor(check: &mut Check<'_>, job: &Job) {
    let sensor = &job.sensor;
    for k in 0..2 {
        check.number(&format!("sensor.resolution_px.{k}"), f64::from(sensor.resolution_px[k]), 1.0..=8192.0, "px");
        check.number(&format!("sensor.field_of_view_mm.{k}"), sensor.field_of_view_mm[k], 1e-3..=1e4, "mm");
    }
    let [width, height] = [0, 1].map(|k| sensor.field_of_view_mm[k] / f64::from(sensor.resolution_px[k]));
    let longer = (width / height).max(height / width);
    if longer > LONGEST_PIXEL && check.sound("sensor.resolution_px") && check.sound("sensor.field_of_view_mm") {
        let message = format!("pixels of {width:.3e} x {height:.3e} mm are {longer:.0} times as long as wide");
        let longest_mm = sensor.field_of_view_mm[0].max(sensor.field_of_view_mm[1]);
        let longest_px = f64::from(sensor.resolution_px[0].max(sensor.resolution_px[1]));
        let [x, y] = sensor.resolution_px.map(|px| figure(longest_mm * f64::from(px) / longest_px));
        let help =
            format!("up to {LONGEST_PIXEL} times; field_of_view_mm = [{x}, {y}] has the proportions of resolution_px");
        check.error("sensor.field_of_view_mm", message, help);
    }
    check.number("sensor.gelpad_thickness_mm", sensor.gelpad_thickness_mm, 1e-2..=1e3, "mm");
    check.number("sensor.gelpad_youngs_modulus_kpa", sensor.gelpad_youngs_modulus_kpa, 1e-3..=1e9, "kPa");
    check.number("sensor.gelpad_poisson_ratio", sensor.gelpad_poisson_ratio, 0.0..=0.4999, "");
    if sensor.name.is_empty() {
        check.error("sensor.name", "the sensor's name is empty", "for example name = \"my-sensor\"");
    }
    check.number("sensor.darkening", sensor.darkening, 0.0..=1.0, "");
    for (k, share) in sensor.stray_light.iter().flatten().enumerate() {
        check.number(&format!("sensor.stray_light.{k}"), *share, 0.0..=1.0, "");
    }
    if let Some(residual) = &sensor.light_residual {
        check.number("sensor.light_residual.steepest", residual.steepest, 0.01..=1.0, "");
        for (k, mm) in residual.heights_mm.iter().enumerate() {
            let allowed = if k == 0 { -100.0..=0.0 } else { 0.0..=100.0 };
            check.number(&format!("sensor.light_residual.heights_mm.{k}"), *mm, allowed, "");
        }
        for (channel, terms) in [("red", &residual.red), ("green", &residual.green), ("blue", &residual.blue)] {
            for (k, term) in terms.iter().enumerate() {
                check.number(&format!("sensor.light_residual.{channel}.{k}"), *term, -100.0..=100.0, "");
            }
        }
    }
    let look = &sensor.rendered_background;
    if let Some(pattern) = &look.pattern {
        for (channel, coefficients) in [("red", &pattern.red), ("green", &pattern.green), ("blue", &pattern.blue)] {
            for (k, coefficient) in coefficients.iter().enumerate() {
                let path = format!("sensor.rendered_background.pattern.{channel}.{k}");
                check.number(&path, *coefficient, -100.0..=100.0, "");
            }
        }
    }
    for k in 0..3 {
        check.number(&format!("sensor.rendered_background.color.{k}"), look.color[k], 0.0..=1.0, "");
    }
    check.number("sensor.rendered_background.glow", look.glow, 0.0..=10.0, "");
    check.number("sensor.rendered_background.glow_reach_mm", look.glow_reach_mm, 1e-3..=1e6, "mm");
    check.number("sensor.rendered_background.vignette", look.vignette, 0.0..=1.0, "");
    check.number("sensor.rendered_background.grain", look.grain, 0.0..=1.0, "");
    check.number("sensor.rendered_background.grain_size_mm", look.grain_size_mm, 1e-3..=1e3, "mm");
    check.number("sensor.rendered_background.dust_per_cm2", look.dust_per_cm2, 0.0..=1e3, "");
    check.number("sensor.rendered_background.dust_size_mm", look.dust_size_mm, 1e-3..=10.0, "mm");
    super::curved::sensor(check, sensor);
    if sensor.led.is_empty() && sensor.lamp.is_empty() && sensor.pins.is_none() {
        let help = match check.document.get("sensor.led") {
            Some(node) if node.place.source == 0 => {
                "write at least one [[sensor.led]] table in place of the empty list"
            }
            _ => "add at least one [[sensor.led]] table",
        };
        check.error("sensor.led", "the sensor has no LED", help);
    }
    if sensor.led.len() > MOST_LEDS {
        let message = format!("the sensor has {} LEDs", sensor.led.len());
        check.error("sensor.led", message, format!("at most {MOST_LEDS} are simulated: take one for each row of them"));
    }
    for (i, led) in sensor.led.iter().enumerate().take(MOST_LEDS) {
        let path = |key: &str| format!("sensor.led.{i}.{key}");
        check.number(&path("azimuth_deg"), led.azimuth_deg, -3600.0..=3600.0, "degrees");
        check.number(&path("elevation_deg"), led.elevation_deg, 0.0..=90.0, "degrees");
        for k in 0..2 {
            check.number(&path(&format!("angular_size_deg.{k}")), led.angular_size_deg[k], 0.0..=90.0, "degrees");
        }
        check.number(&path("distance_mm"), led.distance_mm, 1e-2..=1e6, "mm");
        check.number(&path("intensity"), led.intensity, 0.0..=100.0, "");
        for k in 0..3 {
            check.number(&path(&format!("color.{k}")), led.color[k], 0.0..=1.0, "");
        }
    }
    if !matches!(sensor.lamp.len(), 0 | lamps::COUNT) {
        let message = format!("the sensor has {} lamps", sensor.lamp.len());
        check.error("sensor.lamp", message, format!("write {} [[sensor.lamp]] tables, or none", lamps::COUNT));
    }
    for (i, lamp) in sensor.lamp.iter().enumerate() {
        for (key, value) in lamp.numbers() {
            let least = if key.starts_with("color") { 0.0 } else { -100.0 };
            let most = if key.starts_with("color") { 1.0 } else { 100.0 };
            check.number(&format!("sensor.lamp.{i}.{key}"), value, least..=most, "");
        }
    }
    if let Some(unit) = &sensor.unit {
        self::unit(check, job, unit);
    }
}

/// `[sensor.unit]`, and that no unit's numbers are out of range.
fn unit(check: &mut Check<'_>, job: &Job, unit: &Unit) {
    let mut share = |key: &str, value: f64, most: f64| {
        check.number(&format!("sensor.unit.{key}"), value, 0.0..=most, "");
    };
    share("variation", unit.variation, 1.0);
    share("led_intensity", unit.led_intensity, 0.49);
    share("gelpad_thickness", unit.gelpad_thickness, 0.49);
    share("gelpad_youngs_modulus", unit.gelpad_youngs_modulus, 0.49);
    for (k, value) in unit.background_color.iter().enumerate() {
        share(&format!("background_color.{k}"), *value, 0.49);
    }
    share("led_azimuth_deg", unit.led_azimuth_deg, 90.0);
    share("led_elevation_deg", unit.led_elevation_deg, 45.0);
    if let Some(pattern) = &unit.background_pattern {
        for (channel, deviations) in [("red", &pattern.red), ("green", &pattern.green), ("blue", &pattern.blue)] {
            for (k, deviation) in deviations.iter().enumerate() {
                share(&format!("background_pattern.{channel}.{k}"), *deviation, 10.0);
            }
        }
    }
    if !check.sound("sensor") {
        return;
    }
    let problems = extreme_units(job, unit.variation);
    let Some(first) = problems.first() else { return };
    let more = if problems.len() > 1 { format!(", and {} more", problems.len() - 1) } else { String::new() };
    let message =
        format!("units may be out of range: {} ({}){more}", first.message, first.help.as_deref().unwrap_or_default());
    let sound = (1..20)
        .map(|k| f64::from(20 - k) / 20.0)
        .find(|variation| *variation < unit.variation && extreme_units(job, *variation).is_empty());
    let help = match sound {
        Some(variation) => format!("write variation = {variation} or less"),
        None => String::from("leave variation out, or move the number away from the end of its range"),
    };
    check.error("sensor.unit.variation", message, help);
}

/// What is out of range of the most extreme units under this variation.
fn extreme_units(job: &Job, variation: f64) -> Vec<Diagnostic> {
    let document = Document::empty();
    let mut varied = job.clone();
    if let Some(unit) = &mut varied.sensor.unit {
        unit.variation = variation;
    }
    let mut found = Vec::new();
    for end in 0..2 {
        let mut extreme = varied.clone();
        let values = extreme.sensor.numbers_mut().into_iter().map(|(path, value)| support(&varied, &path, *value)[end]);
        let values: Vec<f64> = values.collect();
        extreme.sensor.unit = None;
        extreme.sensor.numbers_mut().into_iter().zip(values).for_each(|((_, number), value)| *number = value);
        let mut problems = Diagnostics::default();
        self::sensor(&mut Check { document: &document, problems: &mut problems }, &extreme);
        found.extend(problems.sorted());
    }
    found
}

/// `[pose]` and `[indentation]`; the pad's thickness is only sure if `sensor_known`.
pub fn scene(check: &mut Check<'_>, job: &Job, sensor_known: bool) {
    let pose = &job.pose;
    check.quantity("pose.yaw_deg", &pose.yaw_deg, -3600.0..=3600.0, "degrees");
    check.quantity("pose.tilt_deg", &pose.tilt_deg, -90.0..=90.0, "degrees");
    check.quantity("pose.tilt_azimuth_deg", &pose.tilt_azimuth_deg, -3600.0..=3600.0, "degrees");
    for (key, angle) in [("roll_deg", &pose.roll_deg), ("pitch_deg", &pose.pitch_deg)] {
        let Some(angle) = angle else { continue };
        check.quantity(&format!("pose.{key}"), angle, -90.0..=90.0, "degrees");
        if pose.tilt_deg.support() != (0.0, 0.0) {
            let message = format!("`{key}` stands in place of `tilt_deg`");
            check.error(
                &format!("pose.{key}"),
                message,
                "write roll_deg and pitch_deg, or tilt_deg and tilt_azimuth_deg",
            );
        }
    }
    check.quantity("pose.x_mm", &pose.x_mm, -1e4..=1e4, "mm");
    check.quantity("pose.y_mm", &pose.y_mm, -1e4..=1e4, "mm");
    if let Some(sequence) = &job.sequence {
        super::sequence::check(check, job, sequence, sensor_known);
        return;
    }
    // Its width or force says how deep it presses.
    if job.gripper.is_some() {
        return;
    }
    match &job.indentation.depth_mm {
        None => {
            let thickness_mm = if sensor_known { remedies::thinnest_mm(job) } else { 4.0 };
            let help = format!("for example {} under [indentation]", remedies::usual_depth(thickness_mm));
            check.missing("indentation.depth_mm", &help);
        }
        Some(depth) if sensor_known && check.sound("sensor.gelpad_thickness_mm") && check.sound("sensor.unit") => {
            let thickness = remedies::thinnest_mm(job);
            let behind = match thickness == job.sensor.gelpad_thickness_mm {
                true => "the gelpad is as thick as",
                false => "the thinnest gelpad is as thick as",
            };
            check.depth("indentation.depth_mm", depth, 0.0, thickness, behind);
        }
        // The thickness is not known.
        Some(depth) => check.quantity("indentation.depth_mm", depth, 0.0..=1e3, "mm"),
    }
    check.number("indentation.no_contact", job.indentation.no_contact, 0.0..=1.0, "");
}

/// `fidelity`, `gelpad`, `optics` and what they allow in `[output]`.
pub fn models(check: &mut Check<'_>, job: &Job) {
    match job.fidelity {
        Some(FidelityChoice::MaxErrorUm(um)) => check.number("fidelity.max_error_um", um, 1e-3..=1e5, "um"),
        Some(FidelityChoice::MaxMs(ms)) => check.number("fidelity.max_ms", ms, 1e-3..=1e6, "ms"),
        _ => {}
    }
    if job.fidelity.is_some_and(|fidelity| fidelity.level().is_none()) && check.document.get("gelpad").is_some() {
        let message = "`gelpad` leaves nothing to choose for `fidelity`";
        check.error("gelpad", message, "leave `gelpad` out, or name a level in `fidelity`");
    }
    let Models { gelpad, optics } = chosen_models(job);
    match &gelpad {
        gelpad::Model::None(_) => {}
        gelpad::Model::MeanBlur(blur) => {
            check.odd("gelpad.mean_blur.kernel_px", blur.kernel_px);
            check.number("gelpad.mean_blur.passes", f64::from(blur.passes), 0.0..=64.0, "");
        }
        gelpad::Model::Gaussian(gaussian) => {
            for (i, width) in gaussian.kernels_px.iter().enumerate() {
                check.odd(&format!("gelpad.gaussian.kernels_px.{i}"), *width);
            }
            if gaussian.kernels_px.len() > 8 {
                let message = format!("{} blurs are too many", gaussian.kernels_px.len());
                check.error("gelpad.gaussian.kernels_px", message, "allowed: up to 8");
            }
            check.odd("gelpad.gaussian.smoothing_px", gaussian.smoothing_px);
        }
        gelpad::Model::Elastic(elastic) => {
            check.number("gelpad.elastic.tolerance_um", elastic.tolerance_um, 0.01..=1e3, "um");
            let most = f64::from(elastic.max_iterations);
            check.number("gelpad.elastic.max_iterations", most, 1.0..=1e4, "iterations");
            if let Some(held) = elastic.friction {
                friction(check, "gelpad.elastic.friction", held);
                if job.shear.any() && job.shear.friction != held {
                    let message =
                        "the object is held by one friction while it is pressed in, by another while it is moved";
                    let help = format!("write {} under [shear], as under [gelpad.elastic]", remedies::friction(held));
                    check.error("shear.friction", message, help);
                }
            }
        }
    }
    match optics.phong() {
        Some(phong) => {
            let path = |key: &str| format!("optics.{}.{key}", optics.name());
            check.number(&path("ambient"), phong.ambient, 0.0..=1.0, "");
            check.number(&path("diffuse"), phong.diffuse, 0.0..=10.0, "");
            check.number(&path("specular"), phong.specular, 0.0..=10.0, "");
            check.number(&path("shininess"), phong.shininess, 0.0..=1000.0, "");
            if let Some(darkening) = phong.darkening {
                check.number(&path("darkening"), darkening, 0.0..=1.0, "");
            }
        }
        None if !check.sound("sensor") => {}
        None => match &optics {
            optics::Model::Lamps(_) if job.sensor.lamp.is_empty() => {
                let help = "take a sensor that has them, such as [sensor] preset = \"gelsight-series2\"; or choose phong or led";
                check.error("optics", "this sensor has no lamps", help);
            }
            optics::Model::Calibrated(_) if job.sensor.calibration.is_none() => {
                let help = "leave `optics` out; or name a file that `gelsim calibrate` wrote without --leds: file = \"...\" under [sensor]";
                check.error("optics", "nothing was measured on this sensor", help);
            }
            _ => {}
        },
    }
    if optics.phong().is_some() && job.sensor.led.is_empty() && !job.sensor.lamp.is_empty() {
        let message = format!("this sensor has lamps and no LED, which `{}` needs", optics.name());
        check.error("optics", message, "leave `optics` out, or take a sensor with LEDs");
    }
    if let optics::Model::Calibrated(Calibrated { spacing_mm }) = &optics {
        check.number("optics.calibrated.spacing_mm", *spacing_mm, 0.0..=10.0, "mm");
    }
    layers(check, job, &gelpad);
}

/// `[output] layers`, under a model of the gelpad.
pub fn layers(check: &mut Check<'_>, job: &Job, gelpad: &gelpad::Model) {
    for (i, layer) in job.output.layers.iter().enumerate() {
        let path = format!("output.layers.{i}");
        match layer {
            OutputLayer::Markers if job.markers.is_none() => {
                let help = match (&job.sensor.shape, &job.gripper) {
                    (Some(_), _) => "leave `markers` out: print on a gel that has a shape is not simulated",
                    (None, None) => "leave `markers` out, or add dots: [markers] with pitch_mm = 1.5",
                    (None, Some(_)) => {
                        "leave `markers` out, or add dots: [markers] with pitch_mm = 1.5, and [gripper.right.markers] where that finger has a sensor of its own"
                    }
                };
                check.error(&path, format!("the sensor `{}` has no printed markers", job.sensor.name), help);
            }
            OutputLayer::Pins if job.sensor.pins.is_none() => check.error(
                &path,
                "this sensor has no pins",
                "leave `pins` out, or take a sensor that has them, such as tactip",
            ),
            OutputLayer::Lamps if job.sensor.lamp.is_empty() => check.error(
                &path,
                "this sensor has no lamps that were measured one by one",
                "leave `lamps` out, or take a sensor that has them, such as gelsight-series2",
            ),
            OutputLayer::Pressure if !gelpad.knows_pressure() => {
                let message = format!("the gelpad model `{}` knows no pressure", gelpad.name());
                let help = format!("leave `pressure` out, or {}", remedies::solving_gelpad(check.document));
                check.error(&path, message, help);
            }
            OutputLayer::Flow if !gelpad.knows_tractions() => {
                let message = format!("the gelpad model `{}` knows no motion of the pad in its plane", gelpad.name());
                let help = format!("leave `flow` out, or {}", remedies::solving_gelpad(check.document));
                check.error(&path, message, help);
            }
            OutputLayer::Untouched
                if job
                    .sensor
                    .pins
                    .as_ref()
                    .is_some_and(|pins| pins.size_jitter > 0.0 || pins.place_jitter_mm > 0.0) =>
            {
                let help = "leave `untouched` out, or set size_jitter and place_jitter_mm in [sensor.pins] to 0";
                check.error(&path, "the pins of this sensor differ from sample to sample, untouched ones, too", help);
            }
            OutputLayer::Slip if job.sequence.is_none() => {
                let help = "leave `slip` out: only the frames of a [sequence] have it, or those of gelsim render --sequence 0.5";
                check.error(&path, "a single press has no slip", help);
            }
            _ => {}
        }
    }
}

/// `[sensor.rest_shape]` and `[sensor.grain]`.
pub fn pad_surface(check: &mut Check<'_>, job: &Job) {
    let sensor = &job.sensor;
    match &sensor.rest_shape {
        None => {}
        Some(RestShape::Dome(dome)) => {
            let [width, height] = sensor.field_of_view_mm;
            let half_diagonal = 0.5 * libm::hypot(width, height);
            check.number("sensor.rest_shape.dome.radius_mm", dome.radius_mm, half_diagonal..=1e6, "mm");
        }
        Some(RestShape::HeightMap(map)) => {
            check.number("sensor.rest_shape.height_map.height_mm", map.height_mm, 0.0..=1e3, "mm");
        }
    }
    if let Some(grain) = &sensor.grain {
        check.number("sensor.grain.height_um", grain.height_um, 0.0..=100.0, "um");
        check.number("sensor.grain.size_mm", grain.size_mm, 1e-3..=1e3, "mm");
    }
}

/// `[texture]` and `[shear]`.
pub fn object_effects(check: &mut Check<'_>, job: &Job) {
    texture(check, "texture", &job.texture);
    let shear = &job.shear;
    check.quantity("shear.x_mm", &shear.x_mm, -10.0..=10.0, "mm");
    check.quantity("shear.y_mm", &shear.y_mm, -10.0..=10.0, "mm");
    check.quantity("shear.twist_deg", &shear.twist_deg, -45.0..=45.0, "degrees");
    friction(check, "shear.friction", shear.friction);
}

/// A table of texture at `at`.
pub fn texture(check: &mut Check<'_>, at: &str, texture: &TextureDistribution) {
    let path = |key: &str| format!("{at}.{key}");
    if texture.patterns.is_empty() {
        check.error(&path("patterns"), "no pattern to choose from", "for example patterns = [\"noise\"]");
    }
    check.quantity(&path("amplitude_mm"), &texture.amplitude_mm, 0.0..=10.0, "mm");
    check.quantity(&path("scale_mm"), &texture.scale_mm, 1e-3..=1e3, "mm");
    check.quantity(&path("angle_deg"), &texture.angle_deg, -3600.0..=3600.0, "degrees");
}

fn friction(check: &mut Check<'_>, at: &str, friction: Friction) {
    if let Friction::Coulomb { coefficient } = friction {
        check.number(&format!("{at}.coulomb.coefficient"), coefficient, 0.0..=10.0, "");
    }
}

/// Dots on and around the view, and how many of them may lie over each other: more of either take seconds a sample.
fn dots(check: &mut Check<'_>, at: &str, markers: &MarkerDistribution, field_of_view_mm: [f64; 2]) {
    const MOST: f64 = 200_000.0;
    const WIDEST: f64 = 20.0;
    let (pitch, diameter) = (markers.pitch_mm.support().0, markers.diameter_mm.support().1);
    let around = diameter + markers.jitter_mm.support().1;
    let dots: f64 = field_of_view_mm.iter().map(|mm| (mm + 2.0 * around) / pitch + 1.0).product();
    if diameter > 0.0 && dots > MOST {
        let message = format!("a pitch of {pitch} mm may need {dots:.0} dots on the view and around it");
        let many = |pitch: f64| field_of_view_mm.iter().map(|mm| (mm + 2.0 * around) / pitch + 1.0).product::<f64>();
        let widest = (diameter + markers.edge_mm) / WIDEST;
        let enough = (0..400).map(|k| pitch * libm::pow(1.05, f64::from(k))).find(|pitch| many(*pitch) <= MOST);
        let enough = tidy(enough.unwrap_or(1e3).max(widest), false);
        let help = format!("allowed: up to {MOST} dots; write pitch_mm = {enough} or more, or smaller dots");
        check.error(&format!("{at}.pitch_mm"), message, help);
    } else if diameter + markers.edge_mm > WIDEST * pitch {
        let message = format!("dots of {diameter} mm with edges of {} mm lie over each other", markers.edge_mm);
        let (key, other) =
            if markers.edge_mm < WIDEST * pitch { ("diameter_mm", markers.edge_mm) } else { ("edge_mm", diameter) };
        let most = tidy((WIDEST * pitch - other).max(0.0), true);
        let help = format!("write {key} = {most} or less: up to {WIDEST} times as wide as pitch_mm, with the edge");
        check.error(&format!("{at}.{key}"), message, help);
    }
}

/// The `[markers]` table at `at`; of a sensor whose view is unsound, without a view.
pub fn markers(check: &mut Check<'_>, at: &str, markers: &MarkerDistribution, field_of_view_mm: Option<[f64; 2]>) {
    check.quantity(&format!("{at}.pitch_mm"), &markers.pitch_mm, 0.05..=1e3, "mm");
    check.quantity(&format!("{at}.diameter_mm"), &markers.diameter_mm, 0.0..=100.0, "mm");
    check.quantity(&format!("{at}.jitter_mm"), &markers.jitter_mm, 0.0..=100.0, "mm");
    check.number(&format!("{at}.edge_mm"), markers.edge_mm, 0.0..=10.0, "mm");
    for k in 0..3 {
        check.number(&format!("{at}.color.{k}"), markers.color[k], 0.0..=1.0, "");
    }
    if let Some(field_of_view_mm) = field_of_view_mm.filter(|_| check.sound(at)) {
        dots(check, at, markers, field_of_view_mm);
    }
}

/// `[markers]` and `[camera]`.
pub fn camera(check: &mut Check<'_>, job: &Job) {
    if let Some(print) = &job.markers {
        let view = check.sound("sensor").then_some(job.sensor.field_of_view_mm);
        markers(check, "markers", print, view);
    }
    let camera = &job.camera;
    check.quantity("camera.distortion_k1", &camera.distortion_k1, -1.0..=1.0, "");
    check.quantity("camera.distortion_k2", &camera.distortion_k2, -1.0..=1.0, "");
    // The worst of all lenses that may be drawn is at a corner of the two ranges.
    let ([a, b], [c, d]) = (camera.distortion_k1.support().into(), camera.distortion_k2.support().into());
    let folded = [(a, c), (a, d), (b, c), (b, d)].into_iter().find(|(k1, k2)| !lens::valid(*k1, *k2));
    if let Some((k1, k2)) = folded
        && check.sound("camera.distortion_k1")
        && check.sound("camera.distortion_k2")
    {
        let message = format!("a lens of k1 = {k1}, k2 = {k2} folds the image over itself");
        let milder = (1..100).map(|k| 1.0 - f64::from(k) / 100.0).find(|share| lens::valid(share * k1, share * k2));
        let milder = milder.unwrap_or(0.0);
        let help = format!(
            "bring both towards 0, such as distortion_k1 = {} and distortion_k2 = {}",
            tidy(milder * k1, k1 > 0.0),
            tidy(milder * k2, k2 > 0.0)
        );
        check.error("camera.distortion_k1", message, help);
    }
    check.quantity("camera.vignette", &camera.vignette, 0.0..=1.0, "");
    check.quantity("camera.defocus_mm", &camera.defocus_mm, 0.0..=1.0, "mm");
    let pitch = (0..2).map(|k| job.sensor.field_of_view_mm[k] / f64::from(job.sensor.resolution_px[k].max(1)));
    let widest_px = camera.defocus_mm.support().1 / pitch.fold(f64::INFINITY, f64::min);
    if widest_px > 20.0 && check.sound("camera.defocus_mm") && check.sound("sensor") {
        let message = format!("defocus_mm may be {widest_px:.0} px wide");
        let most_mm = tidy(20.0 * camera.defocus_mm.support().1 / widest_px, true);
        check.error("camera.defocus_mm", message, format!("allowed: up to 20 px, here {most_mm} mm"));
    }
    check.quantity("camera.exposure", &camera.exposure, 0.01..=100.0, "");
    check.quantity("camera.red_gain", &camera.red_gain, 0.01..=100.0, "");
    check.quantity("camera.blue_gain", &camera.blue_gain, 0.01..=100.0, "");
    check.quantity("camera.shot_noise_levels", &camera.shot_noise_levels, 0.0..=255.0, "grey levels");
    for factor in camera.noise_color {
        check.number("camera.noise_color", factor, 0.0..=10.0, "");
    }
    check.quantity("camera.noise_correlation", &camera.noise_correlation, 0.0..=MOST_CORRELATION, "");
    check.number("camera.threshold", camera.threshold, 0.0..=1.0, "");
    check.quantity("camera.speckle_levels", &camera.speckle_levels, 0.0..=255.0, "grey levels");
    check.quantity("camera.read_noise_levels", &camera.read_noise_levels, 0.0..=255.0, "grey levels");
}
