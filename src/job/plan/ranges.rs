//! Checks the range of every key of a job.

use super::check::JobChecker;
use super::chosen_models;
use super::markers;
use super::remedies;
use super::sensors::number_support;
use crate::config::Job;
use crate::config::document::Document;
use crate::config::fidelity::FidelityChoice;
use crate::config::scene::{At, Face};
use crate::config::texture::TextureDistribution;
use crate::layers::OutputLayer;
use gelsim_core::camera::lens;
use gelsim_core::camera::noise::MAX_CORRELATION;
use gelsim_core::fidelity::Models;
use gelsim_core::gelpad::elastic::relaxation::RelaxationMode;
use gelsim_core::gelpad::elastic::shear::Friction;
use gelsim_core::optics::background::Pattern;
use gelsim_core::optics::calibrated::Calibrated;
use gelsim_core::optics::{lamps, light_pattern, residual};
use gelsim_core::pose::Anchor;
use gelsim_core::{gelpad, optics};
use gelsim_files::diagnostic::{Diagnostic, Diagnostics};
use gelsim_files::number_format::{format_number, round_bound};
use gelsim_files::sensor::RestShape;
use gelsim_files::sensor::unit::UnitVariation;

/// Most LEDs of a sensor.
const MAX_LEDS: usize = 64;

/// The greatest ratio of a pixel's longer side to its shorter one. The pad's response for longer pixels takes minutes
/// to compute.
const MAX_PIXEL_ASPECT: f64 = 1000.0;

/// Checks `[dataset]`.
pub fn check_dataset(check: &mut JobChecker<'_>, job: &Job) {
    let dataset = &job.dataset;
    match &dataset.name {
        None => check.report_missing("dataset.name", "for example name = \"quickstart\""),
        Some(name) => {
            let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
            if name.is_empty() || name.len() > 100 || name.starts_with('.') || !name.chars().all(plain) {
                check.report_error(
                    "dataset.name",
                    format!("{name:?} cannot be the name of a dataset"),
                    "use 1 to 100 letters, digits, `-`, `_` and `.`, not starting with `.`",
                );
            }
        }
    }
    match dataset.samples {
        None => check.report_missing("dataset.samples", "for example samples = 200"),
        Some(samples) => check.require_in_range("dataset.samples", samples as f64, 1.0..=1e9, "samples"),
    }
    check_seed(check, job);
    check.require_in_range("dataset.samples_per_shard", dataset.samples_per_shard as f64, 1.0..=1e6, "samples");
    let shards = dataset.samples.unwrap_or(0).div_ceil(dataset.samples_per_shard.max(1));
    if shards >= 1_000_000 && check.is_valid("dataset.samples") && check.is_valid("dataset.samples_per_shard") {
        let message = format!("{shards} shards are too many: their names count to 999999");
        let least = dataset.samples.unwrap_or(0).div_ceil(999_999);
        check.report_error("dataset.samples_per_shard", message, format!("write samples_per_shard = {least} or more"));
    }
    let splits = dataset.splits;
    let sum = splits.train + splits.val + splits.test;
    let all_positive = [splits.train, splits.val, splits.test].iter().all(|share| *share >= 0.0);
    // The tolerance is for rounded decimals such as 0.1 + 0.2.
    if (sum - 1.0).abs() > 1e-9 && all_positive && sum > 0.0 && sum.is_finite() && check.is_valid("dataset.splits") {
        let message = match (sum - 100.0).abs() < 1e-6 {
            true => String::from("the splits are percentages, and shares belong here"),
            false => format!("the splits sum to {sum}"),
        };
        let [train, val, test] = normalise_shares([splits.train, splits.val, splits.test]);
        let help = format!("they must sum to 1: splits = {{ train = {train}, val = {val}, test = {test} }}");
        return check.report_error("dataset.splits", message, help);
    }
    for (name, share) in [("train", splits.train), ("val", splits.val), ("test", splits.test)] {
        check.require_in_range(&format!("dataset.splits.{name}"), share, 0.0..=1.0, "");
    }
    if sum == 0.0 && check.is_valid("dataset.splits") {
        check.report_error(
            "dataset.splits",
            "the splits sum to 0",
            "they must sum to 1: leave `splits` out for train alone",
        );
    }
}

/// Returns fractions near these that sum to 1, for a suggestion. What is missing goes to the last split that has none;
/// if there is no such split, all are scaled.
fn normalise_shares(mut shares: [f64; 3]) -> [f64; 3] {
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

/// Checks `[dataset] seed`. Readers of JSON may take it for a float, so it must be a whole number that a float holds
/// exactly.
pub fn check_seed(check: &mut JobChecker<'_>, job: &Job) {
    for (key, seed) in [("dataset.seed", Some(job.dataset.seed)), ("dataset.sensor_seed", job.dataset.sensor_seed)] {
        let seed = seed.unwrap_or_default() as f64;
        check.require_in_range(key, seed, 0.0..=9_007_199_254_740_991.0, "");
    }
}

/// Checks `[sensor]`.
pub fn check_sensor(check: &mut JobChecker<'_>, job: &Job) {
    let sensor = &job.sensor;
    for k in 0..2 {
        check.require_in_range(
            &format!("sensor.resolution_px.{k}"),
            f64::from(sensor.resolution_px[k]),
            1.0..=8192.0,
            "px",
        );
        check.require_in_range(&format!("sensor.field_of_view_mm.{k}"), sensor.field_of_view_mm[k], 1e-3..=1e4, "mm");
    }
    let [width, height] = [0, 1].map(|k| sensor.field_of_view_mm[k] / f64::from(sensor.resolution_px[k]));
    let longer = (width / height).max(height / width);
    if longer > MAX_PIXEL_ASPECT && check.is_valid("sensor.resolution_px") && check.is_valid("sensor.field_of_view_mm")
    {
        let message = format!("pixels of {width:.3e} x {height:.3e} mm are {longer:.0} times as long as wide");
        let longest_mm = sensor.field_of_view_mm[0].max(sensor.field_of_view_mm[1]);
        let longest_px = f64::from(sensor.resolution_px[0].max(sensor.resolution_px[1]));
        let [x, y] = sensor.resolution_px.map(|px| format_number(longest_mm * f64::from(px) / longest_px));
        let help = format!(
            "up to {MAX_PIXEL_ASPECT} times; field_of_view_mm = [{x}, {y}] has the proportions of resolution_px"
        );
        check.report_error("sensor.field_of_view_mm", message, help);
    }
    check.require_in_range("sensor.gelpad_thickness_mm", sensor.gelpad_thickness_mm, 1e-2..=1e3, "mm");
    check.require_in_range("sensor.gelpad_youngs_modulus_kpa", sensor.gelpad_youngs_modulus_kpa, 1e-3..=1e9, "kPa");
    check.require_in_range("sensor.gelpad_poisson_ratio", sensor.gelpad_poisson_ratio, 0.0..=0.4999, "");
    for reason in RelaxationMode::find_errors(&sensor.gelpad_relaxation) {
        let help = "for example relaxation = [{ share = 0.2, time_s = 0.5 }] under [gelpad]";
        check.report_error("sensor.gelpad_relaxation", reason, help);
    }
    if let Some(coefficient) = sensor.gelpad_friction_coefficient {
        check.require_in_range("sensor.gelpad_friction_coefficient", coefficient, 0.0..=10.0, "");
    }
    if sensor.name.is_empty() {
        check.report_error("sensor.name", "the sensor's name is empty", "for example name = \"my-sensor\"");
    }
    check.require_in_range("sensor.darkening", sensor.darkening, 0.0..=1.0, "");
    for (k, share) in sensor.stray_light.iter().flatten().enumerate() {
        check.require_in_range(&format!("sensor.stray_light.{k}"), *share, 0.0..=1.0, "");
    }
    if let Some(residual) = &sensor.light_residual {
        check.require_in_range("sensor.light_residual.steepest", residual.steepest, 0.01..=1.0, "");
        for (k, mm) in residual.heights_mm.iter().enumerate() {
            let allowed = if k == 0 { -100.0..=0.0 } else { 0.0..=100.0 };
            check.require_in_range(&format!("sensor.light_residual.heights_mm.{k}"), *mm, allowed, "");
        }
        check_coefficients(check, "sensor.light_residual", residual.channels(), &residual::TERM_COUNTS);
    }
    let look = &sensor.rendered_background;
    if let Some(Pattern { red, green, blue }) = look.pattern.as_deref() {
        check_coefficients(check, "sensor.rendered_background.pattern", [red, green, blue], &[red.len()]);
    }
    for k in 0..3 {
        check.require_in_range(&format!("sensor.rendered_background.color.{k}"), look.color[k], 0.0..=1.0, "");
    }
    check.require_in_range("sensor.rendered_background.glow", look.glow, 0.0..=10.0, "");
    check.require_in_range("sensor.rendered_background.glow_reach_mm", look.glow_reach_mm, 1e-3..=1e6, "mm");
    check.require_in_range("sensor.rendered_background.vignette", look.vignette, 0.0..=1.0, "");
    check.require_in_range("sensor.rendered_background.grain", look.grain, 0.0..=1.0, "");
    check.require_in_range("sensor.rendered_background.grain_size_mm", look.grain_size_mm, 1e-3..=1e3, "mm");
    check.require_in_range("sensor.rendered_background.dust_per_cm2", look.dust_per_cm2, 0.0..=1e3, "");
    check.require_in_range("sensor.rendered_background.dust_size_mm", look.dust_size_mm, 1e-3..=10.0, "mm");
    super::curved::check_curved_sensor(check, sensor);
    if sensor.led.is_empty() && sensor.lamp.is_empty() && sensor.pins.is_none() {
        let help = match check.document.get("sensor.led") {
            Some(node) if node.place.source == 0 => {
                "write at least one [[sensor.led]] table in place of the empty list"
            }
            _ => "add at least one [[sensor.led]] table",
        };
        check.report_error("sensor.led", "the sensor has no LED", help);
    }
    if sensor.led.len() > MAX_LEDS {
        let message = format!("the sensor has {} LEDs", sensor.led.len());
        check.report_error(
            "sensor.led",
            message,
            format!("at most {MAX_LEDS} are simulated: take one for each row of them"),
        );
    }
    for (i, led) in sensor.led.iter().enumerate().take(MAX_LEDS) {
        let path = |key: &str| format!("sensor.led.{i}.{key}");
        check.require_in_range(&path("azimuth_deg"), led.azimuth_deg, -3600.0..=3600.0, "degrees");
        check.require_in_range(&path("elevation_deg"), led.elevation_deg, 0.0..=90.0, "degrees");
        for k in 0..2 {
            check.require_in_range(
                &path(&format!("angular_size_deg.{k}")),
                led.angular_size_deg[k],
                0.0..=90.0,
                "degrees",
            );
        }
        check.require_in_range(&path("distance_mm"), led.distance_mm, 1e-2..=1e6, "mm");
        for (k, mm) in led.size_mm.iter().flatten().enumerate() {
            check.require_in_range(&path(&format!("size_mm.{k}")), *mm, 0.0..=1e3, "mm");
        }
        check.require_in_range(&path("lobe"), led.lobe, 0.0..=100.0, "");
        check.require_in_range(&path("intensity"), led.intensity, 0.0..=100.0, "");
        for k in 0..3 {
            check.require_in_range(&path(&format!("color.{k}")), led.color[k], 0.0..=1.0, "");
        }
        if let Some(pattern) = &led.pattern {
            check_coefficients(check, &path("pattern"), pattern.channels(), &light_pattern::TERM_COUNTS);
        }
    }
    if let Some(window) = &sensor.window {
        check.require_in_range("sensor.window.distance_mm", window.distance_mm, 1e-2..=1e3, "mm");
        check.require_in_range("sensor.window.refractive_index", window.refractive_index, 1.0..=3.0, "");
        for (i, led) in sensor.led.iter().enumerate().take(MAX_LEDS) {
            let place = led.place();
            let height_mm = -led.position_mm.map_or(place.direction[2] * place.distance_mm, |position| position[2]);
            if height_mm >= window.distance_mm {
                let key = if led.position_mm.is_some() { "position_mm" } else { "distance_mm" };
                let message = format!(
                    "the LED is {} mm from the plane of the pad, beyond the window at {} mm",
                    format_number(height_mm),
                    format_number(window.distance_mm)
                );
                let help = "LEDs shine into the gel from its side, before the window: move the LED or the window";
                let cause = format!("LEDs are beyond the window at {} mm", format_number(window.distance_mm));
                check.report_grouped_error(&format!("sensor.led.{i}.{key}"), &cause, message, help);
            }
        }
    }
    if let Some(coat) = &sensor.coat {
        check.require_in_range("sensor.coat.albedo", coat.albedo, 0.0..=1.0, "");
    }
    if !matches!(sensor.lamp.len(), 0 | lamps::LAMP_COUNT) {
        let message = format!("the sensor has {} lamps", sensor.lamp.len());
        check.report_error(
            "sensor.lamp",
            message,
            format!("write {} [[sensor.lamp]] tables, or none", lamps::LAMP_COUNT),
        );
    }
    for (i, lamp) in sensor.lamp.iter().enumerate() {
        for (key, value) in lamp.numbers() {
            let least = if key.starts_with("color") { 0.0 } else { -100.0 };
            let most = if key.starts_with("color") { 1.0 } else { 100.0 };
            check.require_in_range(&format!("sensor.lamp.{i}.{key}"), value, least..=most, "");
        }
    }
    if let Some(unit) = &sensor.unit {
        self::check_unit_variation(check, job, unit);
    }
}

/// Checks how many coefficients each channel has, and their range.
fn check_coefficients(check: &mut JobChecker<'_>, path: &str, channels: [&[f64]; 3], counts: &[usize]) {
    for (name, terms) in ["red", "green", "blue"].into_iter().zip(channels) {
        let path = format!("{path}.{name}");
        if !counts.contains(&terms.len()) {
            let allowed: Vec<String> = counts.iter().map(usize::to_string).collect();
            let [first @ .., last] = allowed.as_slice() else { continue };
            let message = format!("{name} has {} coefficients", terms.len());
            check.report_error(&path, message, format!("write {} or {last} of them", first.join(", ")));
        }
        for (k, term) in terms.iter().enumerate() {
            check.require_in_range(&format!("{path}.{k}"), *term, -100.0..=100.0, "");
        }
    }
}

/// Checks `[sensor.unit]`, and that the numbers of no unit can be out of range.
fn check_unit_variation(check: &mut JobChecker<'_>, job: &Job, unit: &UnitVariation) {
    let mut share = |key: &str, value: f64, most: f64| {
        check.require_in_range(&format!("sensor.unit.{key}"), value, 0.0..=most, "");
    };
    share("variation", unit.variation, 1.0);
    share("led_intensity", unit.led_intensity, 0.49);
    share("gelpad_thickness", unit.gelpad_thickness, 0.49);
    share("gelpad_youngs_modulus", unit.gelpad_youngs_modulus, 0.49);
    for (k, value) in unit.background_color.iter().enumerate() {
        share(&format!("background_color.{k}"), *value, 0.49);
    }
    share("led_pattern", unit.led_pattern, 10.0);
    share("led_azimuth_deg", unit.led_azimuth_deg, 90.0);
    share("led_elevation_deg", unit.led_elevation_deg, 45.0);
    if let Some(pattern) = &unit.background_pattern {
        for (channel, deviations) in [("red", &pattern.red), ("green", &pattern.green), ("blue", &pattern.blue)] {
            for (k, deviation) in deviations.iter().enumerate() {
                share(&format!("background_pattern.{channel}.{k}"), *deviation, 10.0);
            }
        }
    }
    if !check.is_valid("sensor") {
        return;
    }
    let problems = find_unit_errors(job, unit.variation);
    let Some(first) = problems.first() else { return };
    let more = if problems.len() > 1 { format!(", and {} more", problems.len() - 1) } else { String::new() };
    let message =
        format!("units may be out of range: {} ({}){more}", first.message, first.help.as_deref().unwrap_or_default());
    let smaller = (1..20)
        .map(|k| f64::from(20 - k) / 20.0)
        .find(|variation| *variation < unit.variation && find_unit_errors(job, *variation).is_empty());
    let help = match smaller {
        Some(variation) => format!("write variation = {variation} or less"),
        None => String::from("leave variation out, or move the number away from the end of its range"),
    };
    check.report_error("sensor.unit.variation", message, help);
}

/// Returns what is out of range for the most extreme units under this variation.
fn find_unit_errors(job: &Job, variation: f64) -> Vec<Diagnostic> {
    let document = Document::empty();
    let mut varied = job.clone();
    if let Some(unit) = &mut varied.sensor.unit {
        unit.variation = variation;
    }
    let mut found = Vec::new();
    for end in 0..2 {
        let mut extreme = varied.clone();
        let values =
            extreme.sensor.numbers_mut().into_iter().map(|(path, value)| number_support(&varied, &path, *value)[end]);
        let values: Vec<f64> = values.collect();
        extreme.sensor.unit = None;
        extreme.sensor.numbers_mut().into_iter().zip(values).for_each(|((_, number), value)| *number = value);
        let mut problems = Diagnostics::default();
        self::check_sensor(&mut JobChecker { document: &document, problems: &mut problems }, &extreme);
        found.extend(problems.sorted_by_place());
    }
    found
}

/// Checks `[pose]` and `[indentation]`. The pad's thickness is known only if `sensor_known`.
pub fn check_pose(check: &mut JobChecker<'_>, job: &Job, sensor_known: bool) {
    let pose = &job.pose;
    check.require_quantity_in_range("pose.yaw_deg", &pose.yaw_deg, -3600.0..=3600.0, "degrees");
    check.require_quantity_in_range("pose.tilt_deg", &pose.tilt_deg, -90.0..=90.0, "degrees");
    check.require_quantity_in_range("pose.tilt_azimuth_deg", &pose.tilt_azimuth_deg, -3600.0..=3600.0, "degrees");
    for (key, angle) in [("roll_deg", &pose.roll_deg), ("pitch_deg", &pose.pitch_deg)] {
        let Some(angle) = angle else { continue };
        check.require_quantity_in_range(&format!("pose.{key}"), angle, -90.0..=90.0, "degrees");
        if pose.tilt_deg.support() != (0.0, 0.0) {
            let message = format!("`{key}` stands in place of `tilt_deg`");
            check.report_error(
                &format!("pose.{key}"),
                message,
                "write roll_deg and pitch_deg, or tilt_deg and tilt_azimuth_deg",
            );
        }
    }
    let is_of_side = [("face", pose.face != Face::default()), ("anchor", pose.anchor != Anchor::default())];
    for (key, _) in is_of_side.into_iter().filter(|(_, given)| *given && !pose.at.is_side()) {
        let message = format!("`{key}` is for a side that faces the pad, and `at` takes any point of the surface");
        let help = "leave it out: the point faces the pad along its normal, and is placed at x_mm and y_mm";
        check.report_error(&format!("pose.{key}"), message, help);
    }
    check.require_quantity_in_range("pose.x_mm", &pose.x_mm, -1e4..=1e4, "mm");
    check.require_quantity_in_range("pose.y_mm", &pose.y_mm, -1e4..=1e4, "mm");
    if let Some(grid) = pose.grid {
        check.require_in_range("pose.grid.columns", f64::from(grid.columns), 1.0..=1000.0, "");
        check.require_in_range("pose.grid.rows", f64::from(grid.rows), 1.0..=1000.0, "");
        for (k, mm) in grid.step_mm.into_iter().enumerate() {
            check.require_in_range(&format!("pose.grid.step_mm.{k}"), mm, 0.0..=1e3, "mm");
        }
        if job.objects_per_sample().max > 1 {
            let help = "leave grid out, or write objects_per_sample = 1: the others have places of their own";
            check.report_error("pose.grid", "a grid of places for one of several objects in a press", help);
        }
    }
    if let Some(sequence) = &job.sequence {
        super::sequence::check_sequence(check, job, sequence, sensor_known);
        return;
    }
    // A gripper's width or force gives the depth.
    if job.gripper.is_some() {
        return;
    }
    if let Some(force) = &job.indentation.force_n {
        check.require_quantity_in_range("indentation.force_n", force, 1e-6..=1e6, "N");
        if job.indentation.depth_mm.is_some() {
            check.report_error("indentation.force_n", "both `depth_mm` and `force_n` say how deep", "keep one of them");
        }
        if job.indentation.at != At::Lowest {
            let help = "leave it out: a force is that of the object wherever it touches";
            check.report_error("indentation.at", "`force_n` says how deep the object is", help);
        }
        let gelpad = super::chosen_models(job).gelpad;
        if !gelpad.knows_pressure() {
            let message = format!("the gelpad model `{}` knows no force", gelpad.name());
            let help = format!("write depth_mm, or {}", remedies::suggest_solving_gelpad(check.document));
            check.report_error("indentation.force_n", message, help);
        }
        check.require_in_range("indentation.no_contact", job.indentation.no_contact, 0.0..=1.0, "");
        return;
    }
    match &job.indentation.depth_mm {
        None => {
            let thickness_mm = if sensor_known { remedies::min_thickness_mm(job) } else { 4.0 };
            let help = format!("for example {} under [indentation]", remedies::suggest_depth(thickness_mm));
            check.report_missing("indentation.depth_mm", &help);
        }
        Some(depth)
            if sensor_known && check.is_valid("sensor.gelpad_thickness_mm") && check.is_valid("sensor.unit") =>
        {
            let thickness = remedies::min_thickness_mm(job);
            let behind = match thickness == job.sensor.gelpad_thickness_mm {
                true => "the gelpad is as thick as",
                false => "the thinnest gelpad is as thick as",
            };
            check.require_depth_in_range("indentation.depth_mm", depth, 0.0, thickness, behind);
        }
        // Without the thickness, only a general limit holds.
        Some(depth) => check.require_quantity_in_range("indentation.depth_mm", depth, 0.0..=1e3, "mm"),
    }
    check.require_in_range("indentation.no_contact", job.indentation.no_contact, 0.0..=1.0, "");
}

/// Checks `fidelity`, `gelpad`, `optics`, and what they allow in `[output]`.
pub fn check_models(check: &mut JobChecker<'_>, job: &Job) {
    match job.fidelity {
        Some(FidelityChoice::MaxErrorUm(um)) => check.require_in_range("fidelity.max_error_um", um, 1e-3..=1e5, "um"),
        Some(FidelityChoice::MaxMs(ms)) => check.require_in_range("fidelity.max_ms", ms, 1e-3..=1e6, "ms"),
        _ => {}
    }
    if job.fidelity.is_some_and(|fidelity| fidelity.level().is_none()) && check.document.get("gelpad").is_some() {
        let message = "`gelpad` leaves nothing to choose for `fidelity`";
        check.report_error("gelpad", message, "leave `gelpad` out, or name a level in `fidelity`");
    }
    let Models { gelpad, optics } = chosen_models(job);
    match &gelpad {
        gelpad::Model::None(_) => {}
        gelpad::Model::MeanBlur(blur) => {
            check.require_odd_width("gelpad.mean_blur.kernel_px", blur.kernel_px);
            check.require_in_range("gelpad.mean_blur.passes", f64::from(blur.passes), 0.0..=64.0, "");
        }
        gelpad::Model::Gaussian(gaussian) => {
            for (i, width) in gaussian.kernels_px.iter().enumerate() {
                check.require_odd_width(&format!("gelpad.gaussian.kernels_px.{i}"), *width);
            }
            if gaussian.kernels_px.len() > 8 {
                let message = format!("{} blurs are too many", gaussian.kernels_px.len());
                check.report_error("gelpad.gaussian.kernels_px", message, "allowed: up to 8");
            }
            check.require_odd_width("gelpad.gaussian.smoothing_px", gaussian.smoothing_px);
        }
        gelpad::Model::Elastic(elastic) => {
            check.require_in_range("gelpad.elastic.tolerance_um", elastic.tolerance_um, 0.01..=1e3, "um");
            let most = f64::from(elastic.max_iterations);
            check.require_in_range("gelpad.elastic.max_iterations", most, 1.0..=1e4, "iterations");
        }
        gelpad::Model::FiniteStrain(strain) => {
            if let Some(box_mm) = strain.box_mm {
                check.require_in_range("gelpad.finite_strain.box_mm", box_mm, 0.01..=100.0, "mm");
            }
            check.require_in_range("gelpad.finite_strain.tolerance_um", strain.tolerance_um, 0.01..=1e3, "um");
        }
    }
    if let Some(held) = gelpad.friction() {
        let table = format!("gelpad.{}", gelpad.name());
        check_friction(check, &format!("{table}.friction"), held);
        if job.shear.has_motion() && job.shear.friction != held {
            let message = "the object is held by one friction while it is pressed in, by another while it is moved";
            let help = format!("write {} under [shear], as under [{table}]", remedies::format_friction(held));
            check.report_error("shear.friction", message, help);
        }
    }
    match optics.phong() {
        Some(phong) => {
            let path = |key: &str| format!("optics.{}.{key}", optics.name());
            check.require_in_range(&path("ambient"), phong.ambient, 0.0..=1.0, "");
            check.require_in_range(&path("diffuse"), phong.diffuse, 0.0..=10.0, "");
            check.require_in_range(&path("specular"), phong.specular, 0.0..=10.0, "");
            check.require_in_range(&path("shininess"), phong.shininess, 0.0..=1000.0, "");
            if let Some(darkening) = phong.darkening {
                check.require_in_range(&path("darkening"), darkening, 0.0..=1.0, "");
            }
        }
        None if !check.is_valid("sensor") => {}
        None => match &optics {
            optics::Model::Lamps(_) if job.sensor.lamp.is_empty() => {
                let help = "take a sensor that has them, such as [sensor] preset = \"gelsight-series2\"; or choose phong or led";
                check.report_error("optics", "this sensor has no lamps", help);
            }
            optics::Model::Calibrated(_) if job.sensor.calibration.is_none() => {
                let help = "leave `optics` out; or name a file that `gelsim calibrate` wrote without --leds: file = \"...\" under [sensor]";
                check.report_error("optics", "this sensor has no calibration table", help);
            }
            _ => {}
        },
    }
    if optics.phong().is_some() && job.sensor.led.is_empty() && !job.sensor.lamp.is_empty() {
        let message = format!("this sensor has lamps and no LED, which `{}` needs", optics.name());
        check.report_error("optics", message, "leave `optics` out, or take a sensor with LEDs");
    }
    if let optics::Model::Calibrated(Calibrated { spacing_mm }) = &optics {
        check.require_in_range("optics.calibrated.spacing_mm", *spacing_mm, 0.0..=10.0, "mm");
    }
    check_layers(check, job, &gelpad);
}

/// Checks `[output] layers` for a gelpad model.
pub fn check_layers(check: &mut JobChecker<'_>, job: &Job, gelpad: &gelpad::Model) {
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
                check.report_error(&path, format!("the sensor `{}` has no printed markers", job.sensor.name), help);
            }
            OutputLayer::Pins if job.sensor.pins.is_none() => check.report_error(
                &path,
                "this sensor has no pins",
                "leave `pins` out, or take a sensor that has them, such as tactip",
            ),
            OutputLayer::Lamps if job.sensor.lamp.is_empty() => check.report_error(
                &path,
                "this sensor has no lamps that were measured one by one",
                "leave `lamps` out, or take a sensor that has them, such as gelsight-series2",
            ),
            OutputLayer::Pressure if !gelpad.knows_pressure() => {
                let message = format!("the gelpad model `{}` knows no pressure", gelpad.name());
                let help = format!("leave `pressure` out, or {}", remedies::suggest_solving_gelpad(check.document));
                check.report_error(&path, message, help);
            }
            OutputLayer::Flow | OutputLayer::Traction if !gelpad.knows_tractions() => {
                let unknown = match layer {
                    OutputLayer::Flow => "motion of the pad in its plane",
                    _ => "tractions",
                };
                let message = format!("the gelpad model `{}` knows no {unknown}", gelpad.name());
                let help =
                    format!("leave `{}` out, or {}", layer.name(), remedies::suggest_solving_gelpad(check.document));
                check.report_error(&path, message, help);
            }
            OutputLayer::Untouched
                if job
                    .sensor
                    .pins
                    .as_ref()
                    .is_some_and(|pins| pins.size_jitter > 0.0 || pins.place_jitter_mm > 0.0) =>
            {
                let help = "leave `untouched` out, or set size_jitter and place_jitter_mm in [sensor.pins] to 0";
                check.report_error(
                    &path,
                    "the pins of this sensor differ from sample to sample, untouched ones, too",
                    help,
                );
            }
            OutputLayer::Slip if job.sequence.is_none() => {
                let help = "leave `slip` out: only the frames of a [sequence] have it, or those of gelsim render --sequence 0.5";
                check.report_error(&path, "a single press has no slip", help);
            }
            _ => {}
        }
    }
}

/// Checks `[sensor.rest_shape]` and `[sensor.grain]`.
pub fn check_pad_surface(check: &mut JobChecker<'_>, job: &Job) {
    let sensor = &job.sensor;
    match &sensor.rest_shape {
        None => {}
        Some(RestShape::Dome(dome)) => {
            let [width, height] = sensor.field_of_view_mm;
            let half_diagonal = 0.5 * libm::hypot(width, height);
            check.require_in_range("sensor.rest_shape.dome.radius_mm", dome.radius_mm, half_diagonal..=1e6, "mm");
        }
        Some(RestShape::HeightMap(map)) => {
            check.require_in_range("sensor.rest_shape.height_map.height_mm", map.height_mm, 0.0..=1e3, "mm");
        }
    }
    if let Some(grain) = &sensor.grain {
        check.require_in_range("sensor.grain.height_um", grain.height_um, 0.0..=100.0, "um");
        check.require_in_range("sensor.grain.size_mm", grain.size_mm, 1e-3..=1e3, "mm");
    }
}

/// Checks `[texture]` and `[shear]`.
pub fn check_object_effects(check: &mut JobChecker<'_>, job: &Job) {
    check_texture(check, "texture", &job.texture);
    let shear = &job.shear;
    check.require_quantity_in_range("shear.x_mm", &shear.x_mm, -10.0..=10.0, "mm");
    check.require_quantity_in_range("shear.y_mm", &shear.y_mm, -10.0..=10.0, "mm");
    check.require_quantity_in_range("shear.twist_deg", &shear.twist_deg, -45.0..=45.0, "degrees");
    check_friction(check, "shear.friction", shear.friction);
}

/// Checks a table of texture at `at`.
pub fn check_texture(check: &mut JobChecker<'_>, at: &str, texture: &TextureDistribution) {
    let path = |key: &str| format!("{at}.{key}");
    if texture.patterns.is_empty() {
        check.report_error(&path("patterns"), "no pattern to choose from", "for example patterns = [\"noise\"]");
    }
    check.require_quantity_in_range(&path("amplitude_mm"), &texture.amplitude_mm, 0.0..=10.0, "mm");
    check.require_quantity_in_range(&path("scale_mm"), &texture.scale_mm, 1e-3..=1e3, "mm");
    check.require_quantity_in_range(&path("angle_deg"), &texture.angle_deg, -3600.0..=3600.0, "degrees");
}

/// Checks the coefficient of a friction at `at`.
fn check_friction(check: &mut JobChecker<'_>, at: &str, friction: Friction) {
    if let Friction::Coulomb { coefficient } = friction {
        check.require_in_range(&format!("{at}.coulomb.coefficient"), coefficient, 0.0..=10.0, "");
    }
}

/// Checks `[markers]` and `[camera]`.
pub fn check_camera(check: &mut JobChecker<'_>, job: &Job) {
    if let Some(print) = &job.markers {
        let view = check.is_valid("sensor").then_some(job.sensor.field_of_view_mm);
        markers::check_markers(check, "markers", print, view);
    }
    let camera = &job.camera;
    check.require_quantity_in_range("camera.distortion_k1", &camera.distortion_k1, -1.0..=1.0, "");
    check.require_quantity_in_range("camera.distortion_k2", &camera.distortion_k2, -1.0..=1.0, "");
    // The worst lens that may be drawn is at a corner of the two ranges.
    let ([a, b], [c, d]) = (camera.distortion_k1.support().into(), camera.distortion_k2.support().into());
    let folded = [(a, c), (a, d), (b, c), (b, d)].into_iter().find(|(k1, k2)| !lens::is_valid_distortion(*k1, *k2));
    if let Some((k1, k2)) = folded
        && check.is_valid("camera.distortion_k1")
        && check.is_valid("camera.distortion_k2")
    {
        let message = format!("a lens of k1 = {k1}, k2 = {k2} folds the image over itself");
        let milder = (1..100)
            .map(|k| 1.0 - f64::from(k) / 100.0)
            .find(|share| lens::is_valid_distortion(share * k1, share * k2));
        let milder = milder.unwrap_or(0.0);
        let help = format!(
            "bring both towards 0, such as distortion_k1 = {} and distortion_k2 = {}",
            round_bound(milder * k1, k1 > 0.0),
            round_bound(milder * k2, k2 > 0.0)
        );
        check.report_error("camera.distortion_k1", message, help);
    }
    check.require_quantity_in_range("camera.vignette", &camera.vignette, 0.0..=1.0, "");
    check.require_quantity_in_range("camera.defocus_mm", &camera.defocus_mm, 0.0..=1.0, "mm");
    let pixel_sizes_mm = (0..2).map(|k| job.sensor.field_of_view_mm[k] / f64::from(job.sensor.resolution_px[k].max(1)));
    let widest_px = camera.defocus_mm.support().1 / pixel_sizes_mm.fold(f64::INFINITY, f64::min);
    if widest_px > 20.0 && check.is_valid("camera.defocus_mm") && check.is_valid("sensor") {
        let message = format!("defocus_mm may be {widest_px:.0} px wide");
        let most_mm = round_bound(20.0 * camera.defocus_mm.support().1 / widest_px, true);
        check.report_error("camera.defocus_mm", message, format!("allowed: up to 20 px, here {most_mm} mm"));
    }
    check.require_quantity_in_range("camera.exposure", &camera.exposure, 0.01..=100.0, "");
    check.require_quantity_in_range("camera.red_gain", &camera.red_gain, 0.01..=100.0, "");
    check.require_quantity_in_range("camera.blue_gain", &camera.blue_gain, 0.01..=100.0, "");
    check.require_quantity_in_range("camera.shot_noise_levels", &camera.shot_noise_levels, 0.0..=255.0, "grey levels");
    for factor in camera.noise_color {
        check.require_in_range("camera.noise_color", factor, 0.0..=10.0, "");
    }
    check.require_quantity_in_range("camera.noise_correlation", &camera.noise_correlation, 0.0..=MAX_CORRELATION, "");
    check.require_in_range("camera.threshold", camera.threshold, 0.0..=1.0, "");
    check.require_quantity_in_range("camera.speckle_levels", &camera.speckle_levels, 0.0..=255.0, "grey levels");
    check.require_quantity_in_range("camera.read_noise_levels", &camera.read_noise_levels, 0.0..=255.0, "grey levels");
}
