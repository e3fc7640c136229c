//! The figures that `gelsim calibrate` prints and writes at the head of the sensor file.

use gelsim_core::optics::calibrated::extrapolation::CalibrationRange;
use gelsim_core::optics::led::Led;
use gelsim_lab::calibrate::Session;
use gelsim_lab::calibrate::camera::MeasuredCamera;
use gelsim_lab::calibrate::judge::fit::FitVerdict;
use gelsim_lab::calibrate::leds::FittedLeds;
use gelsim_lab::calibrate::run::Calibration;
use gelsim_lab::compare::report::score_cells;
use gelsim_lab::compare::score::Score;
use gelsim_lab::text_table::TextTable;

/// Creates a table of the errors of images.
pub(super) fn new_score_table() -> TextTable {
    TextTable::new(&[
        ["", "contact", "contact", "contact", "image", "image", "image"],
        ["", "MAE", "PSNR dB", "SSIM", "MAE", "PSNR dB", "SSIM"],
    ])
}

/// Adds the errors of an image, around the contact and of all of it.
pub(super) fn add_scores(table: &mut TextTable, name: &str, contact: Option<&Score>, full_image: Option<&Score>) {
    let cells = |score: Option<&Score>| score.map_or([const { String::new() }; 3], score_cells);
    table.add_row([name.to_owned()].into_iter().chain(cells(contact)).chain(cells(full_image)));
}

pub(super) fn format_score(score: &Score) -> String {
    let psnr = score.psnr_db.map_or(String::from("-"), |db| format!("{db:.2}"));
    format!("{:.2} / {psnr} / {:.4}", score.mae, score.ssim)
}

/// Summarises a calibration as labels and figures: how much it explains, geometry, range, errors, dots, LEDs and
/// camera.
pub(super) fn summarise_calibration(found: &Calibration) -> Vec<(String, String)> {
    let [width, height] = found.session.sensor.resolution_px;
    let figure = |score: &Option<Score>| score.as_ref().map_or(String::from("-"), format_score);
    let ([contact, full_image], [bare_contact, bare_full_image]) =
        (found.mean_errors(), found.mean_background_errors());
    let suspects = found.outlier_reasons.iter().filter(|doubts| !doubts.is_empty()).count();
    let presses = found.session.observations.len();
    let line = |what: &str, figure: String| (what.to_owned(), figure);
    let mut first = summarise_verdict(&found.verdict);
    first.extend([
        line("image", format!("{width}x{height} px, {} mm per px", found.session.camera.mm_per_px[0])),
        line("presses", format!("{presses}, {suspects} of them doubtful, {} left out", found.dropped.len())),
        line("gelpad thickness", format!("{} mm", found.geometry.thickness_mm)),
        line("contact over visible disc", format!("{:.2}", found.geometry.contact_over_disc)),
        line("calibrated range", found.table.range().map_or(String::from("-"), format_range)),
        line("cross-validated, contact", format!("{} (MAE / PSNR dB / SSIM)", figure(&contact))),
        line("cross-validated, whole image", figure(&full_image)),
        line("background alone, contact", figure(&bare_contact)),
        line("background alone, whole image", figure(&bare_full_image)),
    ]);
    first
        .into_iter()
        .chain(summarise_dots(&found.session))
        .chain(summarise_leds(&found.leds))
        .chain(summarise_camera(found.camera.as_ref()))
        .collect()
}

/// Summarises how much of what the presses change the fit explains.
pub(super) fn summarise_verdict(verdict: &FitVerdict) -> Vec<(String, String)> {
    let explained = 100.0 * (1.0 - verdict.remaining_share());
    let figure = format!(
        "{explained:.0} % of what presses change around the contact (MAE {:.2}; {:.2} of the background alone, {:.2} of one colour \
         for each disc)",
        verdict.fit, verdict.background, verdict.flat
    );
    vec![(String::from("explained"), figure)]
}

/// Summarises the dots that are printed on the pad; empty without dots.
pub(super) fn summarise_dots(session: &Session) -> Vec<(String, String)> {
    let Some(printed) = &session.printed else { return Vec::new() };
    let (dots, mm_per_px) = (&printed.dots, session.camera.mm_per_px[0]);
    let mm = |px: f64| format!("{:.2} mm", px * mm_per_px);
    let apart = match dots.pitch_px {
        Some([x, y]) => format!("{} apart across, {} down", mm(x), mm(y)),
        None => format!("{} apart", mm(dots.nearest_px)),
    };
    let figure = format!(
        "{} complete ones, {apart}, {} wide, carried by up to {}",
        dots.count,
        mm(dots.diameter_px),
        mm(dots.motion_px)
    );
    vec![(String::from("printed dots"), figure)]
}

/// Formats the calibrated range: the steepest slope and the deepest displacement.
pub(super) fn format_range(CalibrationRange { steepest, heights_mm: [_, deepest_mm] }: CalibrationRange) -> String {
    format!("slopes up to {:.1} degrees, displacements up to {deepest_mm:.2} mm", steepest.asin().to_degrees())
}

/// Summarises the fitted LEDs, and the light that they leave unexplained.
pub(super) fn summarise_leds(found: &FittedLeds) -> Vec<(String, String)> {
    let led = |led: &Led| {
        let [red, green, blue] = led.color;
        let figure = format!(
            "azimuth {:.0}, elevation {:.0} degrees, intensity {:.2}, colour {red:.2} {green:.2} {blue:.2}",
            led.azimuth_deg, led.elevation_deg, led.intensity
        );
        (format!("LED {}", led.name), figure)
    };
    let left = (String::from("LEDs, left unexplained"), format!("{:.1} grey levels RMS", 255.0 * found.rms));
    found.leds.iter().map(led).chain([left]).collect()
}

/// Summarises the noise, drift and speckle of the camera; says so if it was not measured.
pub(super) fn summarise_camera(found: Option<&MeasuredCamera>) -> Vec<(String, String)> {
    let line = |what: &str, figure: String| (what.to_owned(), figure);
    let Some(MeasuredCamera { read_noise_levels, shot_noise_levels, correlation, drift, speckle_levels, .. }) = found
    else {
        return vec![line("camera", String::from("not measured: too little of the images is away from the discs"))];
    };
    let rgb = |[red, green, blue]: [f64; 3]| format!("{red:.2} {green:.2} {blue:.2}");
    let [across, down] = correlation;
    vec![
        line("camera, read noise R G B", format!("{} grey levels", rgb(*read_noise_levels))),
        line("camera, shot noise of white R G B", format!("{} grey levels", rgb(*shot_noise_levels))),
        line("camera, noise of neighbours", format!("correlates by {across:.2} across, {down:.2} down")),
        line(
            "speckle where pressed R G B",
            speckle_levels.map_or(String::from("not measured: the discs are too small"), |levels| {
                format!("{} grey levels", rgb(levels))
            }),
        ),
        line("camera, drift between images R G B", format!("{} %", rgb(drift.map(|share| 100.0 * share)))),
    ]
}

pub(super) fn format_lines(summary: &[(String, String)]) -> String {
    summary.iter().map(|(what, figure)| format!("{what:<36} {figure}\n")).collect()
}
