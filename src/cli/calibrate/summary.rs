//! What `gelsim calibrate` prints of what it found, and writes at the head of the sensor file.

use gelsim_core::optics::calibrated::beyond::Range;
use gelsim_core::optics::led::Led;
use gelsim_lab::calibrate::Session;
use gelsim_lab::calibrate::camera::MeasuredCamera;
use gelsim_lab::calibrate::judge::fit::Verdict;
use gelsim_lab::calibrate::leds::FittedLeds;
use gelsim_lab::calibrate::run::Calibration;
use gelsim_lab::compare::score::Score;

pub(super) const HEAD: &str = "contact MAE / PSNR dB / SSIM    whole image MAE / PSNR dB / SSIM";

pub(super) fn row(contact: Option<&Score>, full_image: Option<&Score>) -> String {
    format!("{:<31} {}", contact.map(figures).unwrap_or_default(), full_image.map(figures).unwrap_or_default())
}

pub(super) fn figures(score: &Score) -> String {
    let psnr = score.psnr_db.map_or(String::from("-"), |db| format!("{db:.2}"));
    format!("{:.2} / {psnr} / {:.4}", score.mae, score.ssim)
}

/// What was found, and how good it is.
pub(super) fn summary(found: &Calibration) -> Vec<(String, String)> {
    let [width, height] = found.session.sensor.resolution_px;
    let figure = |score: &Option<Score>| score.as_ref().map_or(String::from("-"), figures);
    let ([contact, full_image], [bare_contact, bare_full_image]) = (found.errors(), found.errors_without());
    let suspects = found.outlier_reasons.iter().filter(|doubts| !doubts.is_empty()).count();
    let presses = found.session.observations.len();
    let line = |what: &str, figure: String| (what.to_owned(), figure);
    let mut first = verdict_summary(&found.verdict);
    first.extend([
        line("image", format!("{width}x{height} px, {} mm per px", found.session.camera.mm_per_px[0])),
        line("presses", format!("{presses}, {suspects} of them doubtful, {} left out", found.dropped.len())),
        line("gelpad thickness", format!("{} mm", found.geometry.thickness_mm)),
        line("contact over visible disc", format!("{:.2}", found.geometry.contact_over_disc)),
        line("calibrated range", found.table.range().map_or(String::from("-"), range)),
        line("cross-validated, contact", format!("{} (MAE / PSNR dB / SSIM)", figure(&contact))),
        line("cross-validated, whole image", figure(&full_image)),
        line("background alone, contact", figure(&bare_contact)),
        line("background alone, whole image", figure(&bare_full_image)),
    ]);
    first
        .into_iter()
        .chain(dots_summary(&found.session))
        .chain(leds_summary(&found.leds))
        .chain(camera_summary(found.camera.as_ref()))
        .collect()
}

/// How much the fit explains.
pub(super) fn verdict_summary(verdict: &Verdict) -> Vec<(String, String)> {
    let explained = 100.0 * (1.0 - verdict.left());
    let figure = format!(
        "{explained:.0} % of what presses change around the contact (MAE {:.2}; {:.2} of the background alone, {:.2} of one colour \
         for each disc)",
        verdict.fit, verdict.background, verdict.flat
    );
    vec![(String::from("explained"), figure)]
}

/// The dots that are printed on the pad, if there are any.
pub(super) fn dots_summary(session: &Session) -> Vec<(String, String)> {
    let Some(printed) = &session.printed else { return Vec::new() };
    let (dots, pitch) = (&printed.dots, session.camera.mm_per_px[0]);
    let mm = |px: f64| format!("{:.2} mm", px * pitch);
    let apart = match dots.pitch_px {
        Some([x, y]) => format!("{} apart across, {} down", mm(x), mm(y)),
        None => format!("{} apart", mm(dots.nearest_px)),
    };
    let figure = format!(
        "{} whole ones, {apart}, {} wide, carried by up to {}",
        dots.count,
        mm(dots.diameter_px),
        mm(dots.motion_px)
    );
    vec![(String::from("printed dots"), figure)]
}

/// How far the presses went.
pub(super) fn range(Range { steepest, heights_mm: [_, deepest_mm] }: Range) -> String {
    format!("slopes up to {:.1} degrees, displacements up to {deepest_mm:.2} mm", steepest.asin().to_degrees())
}

/// What was found of the LEDs.
pub(super) fn leds_summary(found: &FittedLeds) -> Vec<(String, String)> {
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

/// What was found of the camera.
pub(super) fn camera_summary(found: Option<&MeasuredCamera>) -> Vec<(String, String)> {
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

pub(super) fn lines(summary: &[(String, String)]) -> String {
    summary.iter().map(|(what, figure)| format!("{what:<36} {figure}\n")).collect()
}
