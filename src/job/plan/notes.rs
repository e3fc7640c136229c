//! Notes on a job: what is allowed but probably not meant. Each cause is reported once.

use super::remedies::{min_thickness_mm, suggest_depth};
use super::{chosen_models, sensor_view, sensors};
use crate::config::Job;
use gelsim_core::gelpad::elastic::MAX_STRAIN;
use gelsim_files::diagnostic::Diagnostic;
use gelsim_files::number_format::{format_number, round_bound};
use gelsim_files::source::SourceSpan;

/// The range of Young's moduli of gels and elastomers, kPa.
const MODULI_KPA: [f64; 2] = [1.0, 1e5];

/// Depth below which no camera shows a press, mm.
const SHALLOWEST_MM: f64 = 1e-3;

/// Ratio of a pixel's sides above which images look stretched.
const MAX_PIXEL_STRETCH: f64 = 1.1;

/// The role of the sensor that a note is about.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum SensorRole {
    /// The sensor of the job itself.
    Job,
    /// One of the sensors of a job whose samples use several presets.
    Presets,
    /// The sensor that sees depth frames, and has as many pixels as they.
    Frames,
    /// The sensor of a gripper's right finger.
    Right,
}

impl SensorRole {
    /// Returns the table of the job that describes the sensor.
    fn table_name(self) -> &'static str {
        if self == Self::Right { "gripper.right" } else { "sensor" }
    }
}

/// Collects all notes on a job. `place` returns the place of a key.
pub fn collect_job_notes(job: &Job, whose: SensorRole, place: impl Fn(&str) -> Option<SourceSpan>) -> Vec<Diagnostic> {
    let found = [
        ("sensor.resolution_px", note_stretched_pixels(job, whose)),
        (if job.sequence.is_some() { "sequence" } else { "indentation.depth_mm" }, note_large_strain(job)),
        ("gripper.squeeze_mm", note_large_squeeze(job)),
        ("indentation.depth_mm", note_shallow_press(job)),
        ("sensor.gelpad_youngs_modulus_kpa", note_unusual_modulus(job, whose)),
        ("markers", note_unseen_dots(job)),
        ("sequence", note_out_of_view(job)),
        ("sequence", note_off_curve(job)),
    ];
    found.into_iter().filter_map(|(key, note)| Some(note?.at(place(key)))).collect()
}

/// Notes pixels that are longer in one direction. Mostly the resolution is that of a camera held the other way.
fn note_stretched_pixels(job: &Job, whose: SensorRole) -> Option<Diagnostic> {
    let sensor = Some(&job.sensor).filter(|sensor| sensor.shape.is_none())?;
    let (px, mm) = (sensor.resolution_px, sensor.field_of_view_mm);
    let [x, y]: [f64; 2] = std::array::from_fn(|k| mm[k] / px[k].max(1) as f64);
    let is_stretched = |px: [f64; 2], mm: [f64; 2]| {
        let [x, y] = [0, 1].map(|k| mm[k] / px[k]);
        x.max(y) > MAX_PIXEL_STRETCH * x.min(y)
    };
    let px = px.map(|px| f64::from(px.max(1)));
    is_stretched(px, mm).then(|| {
        let table = whose.table_name();
        let view = format!("the view is {} x {} mm", format_number(mm[0]), format_number(mm[1]));
        let kept = [0, 1].map(|k| (px[0].max(px[1]) * mm[k] / mm[0].max(mm[1])).round().max(1.0));
        // The largest part of the view with the pixels' proportions.
        let part = (mm[0] / px[0]).min(mm[1] / px[1]);
        let cropped = format!("field_of_view_mm = [{}, {}]", format_number(part * px[0]), format_number(part * px[1]));
        let help = match whose {
            SensorRole::Frames if !is_stretched([px[1], px[0]], mm) => {
                format!("{view}: turn the frames by 90 degrees, as numpy.rot90 does")
            }
            SensorRole::Frames => format!("{view}: --set sensor.{} sees a part of it", cropped.replace(' ', "")),
            SensorRole::Presets => format!(
                "{view}: give the sensors one view, such as {cropped} under [sensor], or name presets that are held the same way"
            ),
            // There are too few pixels for proportions that fit.
            _ if is_stretched(kept, mm) => format!("{view}: take more pixels, or {cropped} under [{table}]"),
            _ => format!("{view}: write resolution_px = [{}, {}] under [{table}]", kept[0], kept[1]),
        };
        Diagnostic::warning(format!("pixels are {x:.3} x {y:.3} mm: images are out of proportion")).help(help)
    })
}

/// Notes printed dots that are all out of view.
fn note_unseen_dots(job: &Job) -> Option<Diagnostic> {
    let markers = job.markers.as_ref()?;
    let pattern = markers.sample_pattern(|_, quantity| quantity.typical_value())?;
    let view = sensor_view(job);
    let positions = markers.to_marker_print().at_rest(&pattern, &view);
    let is_seen = positions.in_view(None, view.resolution_px).next().is_some();
    (!is_seen).then(|| {
        let [x, y] = job.sensor.field_of_view_mm.map(|mm| format_number(0.5 * mm));
        Diagnostic::warning("no printed dot is in the view").help(format!(
            "places are mm from the middle of the view, which ends at x = {x} and y = {y}: move the dots with offset_mm, \
             or leave [markers] out"
        ))
    })
}

/// Notes the first phase of a sequence in which the object may be moved out of the view.
fn note_out_of_view(job: &Job) -> Option<Diagnostic> {
    let sequence = job.sequence.as_ref().filter(|_| job.sensor.shape.is_none())?;
    let half_mm = job.sensor.field_of_view_mm.map(|mm| 0.5 * mm);
    let mut reach = [&job.pose.x_mm, &job.pose.y_mm].map(|quantity| quantity.support());
    // An object that begins out of view is meant to.
    let outside = |reach: &[(f64, f64); 2]| (0..2).find(|k| reach[*k].0.abs().max(reach[*k].1.abs()) > half_mm[*k]);
    if outside(&reach).is_some() {
        return None;
    }
    sequence.phase.iter().find_map(|phase| {
        for (reach, by) in reach.iter_mut().zip([&phase.x_mm, &phase.y_mm]) {
            *reach = (reach.0 + by.support().0, reach.1 + by.support().1);
        }
        outside(&reach).map(|k| {
            let (name, axis, (least, most)) = (phase.name.as_deref().unwrap_or_default(), ["x", "y"][k], reach[k]);
            let message = format!(
                "in phase `{name}` the point that [pose] places may come to {axis} = {least} to {most} mm, out of the view, which \
                 ends at {} mm",
                half_mm[k]
            );
            Diagnostic::warning(message).help(format!("move it less: {axis}_mm of the phases and of [pose] add up"))
        })
    })
}

/// Notes a phase in which the object may be moved so far that a curved gel falls away below it, since motions are in
/// the plane over which the object is posed.
fn note_off_curve(job: &Job) -> Option<Diagnostic> {
    let sequence = job.sequence.as_ref()?;
    let shape = job.sensor.gel_shape()?;
    let radius_mm = shape.radius_mm();
    let from_tip_mm = job.pose.from_tip_mm.as_ref().map_or(0.0, |from_tip| from_tip.support().0);
    let around_deg = job.pose.around_deg.as_ref().map_or(0.0, |around| around.support().0);
    // The side of a finger, below its cap, is straight lengthwise.
    let straight = shape.wall_mm().is_some() && from_tip_mm >= std::f64::consts::FRAC_PI_2 * radius_mm;
    let drop_mm = |k: usize, by_mm: f64| match shape.surface() {
        None if straight && k == 0 => 0.0,
        None => radius_mm - libm::sqrt((radius_mm * radius_mm - by_mm * by_mm).max(0.0)),
        // For a mesh, the drop is measured at the smallest distance and angle that may be drawn.
        Some(surface) => {
            let (axes, origin_mm) = surface.frame_at(from_tip_mm, around_deg);
            let below = origin_mm + axes.col(k) * by_mm - 2.0 * radius_mm * axes.z_axis;
            let exit = surface.find_exit(below, axes.z_axis);
            exit.map_or(f64::INFINITY, |(point, _)| (origin_mm - point).dot(axes.z_axis))
        }
    };
    let (mut reach, mut deepest_mm) = ([(0.0, 0.0); 2], 0.0_f64);
    sequence.phase.iter().find_map(|phase| {
        // The depth to which a force presses is not known.
        deepest_mm = match (&phase.depth_mm, &phase.force_n) {
            (Some(depth), _) => depth.support().1,
            (None, Some(_)) => f64::INFINITY,
            (None, None) => deepest_mm,
        };
        for (reach, by) in reach.iter_mut().zip([&phase.x_mm, &phase.y_mm]) {
            *reach = (reach.0 + by.support().0, reach.1 + by.support().1);
        }
        let ends = (0..2).flat_map(|k| [(k, reach[k].0), (k, reach[k].1)]);
        let drops = ends.map(|(k, by_mm)| (by_mm.abs(), drop_mm(k, by_mm)));
        let (farthest_mm, drop_mm) = drops.max_by(|a, b| a.1.total_cmp(&b.1))?;
        let place = match drop_mm.is_finite() {
            true => format!("where the gel lies {drop_mm:.2} mm lower, and depth_mm is {deepest_mm} at most"),
            false => String::from("where there is no gel"),
        };
        (deepest_mm > 0.0 && drop_mm > deepest_mm).then(|| {
            let message = format!(
                "in phase `{}` the object may come {farthest_mm} mm from where it began, {place}: it may leave the gel",
                phase.name.as_deref().unwrap_or_default(),
            );
            Diagnostic::warning(message).help("move it less: x_mm and y_mm of the phases add up")
        })
    })
}

/// Notes a press of the elastic pad beyond the range of linear elasticity.
fn note_large_strain(job: &Job) -> Option<Diagnostic> {
    let deepest = match &job.sequence {
        None => job.indentation.depth_mm.as_ref()?.support().1,
        Some(sequence) => {
            let depths = sequence.phase.iter().filter_map(|phase| phase.depth_mm.as_ref());
            depths.map(|depth| depth.support().1).fold(0.0, f64::max)
        }
    };
    let thickness = min_thickness_mm(job);
    let model = chosen_models(job).gelpad;
    let linear = model.knows_pressure() && model.strain_settings().is_none();
    (linear && deepest > MAX_STRAIN * thickness).then(|| {
        let key = if job.sequence.is_some() { "depth_mm of a phase" } else { "indentation.depth_mm" };
        note_beyond_theory(format!("{key} may be {deepest}, over half of the pad's {thickness} mm"), thickness)
    })
}

/// Notes a squeeze of both pads of a gripper beyond the range of linear elasticity.
fn note_large_squeeze(job: &Job) -> Option<Diagnostic> {
    let gripper = job.gripper.as_ref()?;
    let most = gripper.squeeze_mm.as_ref()?.support().1;
    let [left, _] = sensors::number_support(job, "gelpad_thickness_mm", job.sensor.gelpad_thickness_mm);
    let both = left + gripper.right.as_ref().map_or(left, |right| right.gelpad_thickness_mm);
    (most > MAX_STRAIN * both).then(|| {
        note_beyond_theory(format!("gripper.squeeze_mm may be {most}, over half of both pads' {both} mm"), both)
    })
}

fn note_beyond_theory(deepest: String, thickness_mm: f64) -> Diagnostic {
    Diagnostic::note(format!("{deepest}: linear elasticity does not hold there")).help(format!(
        "stay at {} mm or below, or leave samples out by numerics.beyond_theory in their labels",
        round_bound(MAX_STRAIN * thickness_mm, true)
    ))
}

/// Notes a press that is too shallow to be seen.
fn note_shallow_press(job: &Job) -> Option<Diagnostic> {
    let deepest = job.indentation.depth_mm.as_ref()?.support().1;
    (deepest < SHALLOWEST_MM).then(|| {
        let message =
            format!("indentation.depth_mm is at most {deepest}, less than a micrometre, which no camera shows");
        let help = format!("its unit is mm, such as {}", suggest_depth(min_thickness_mm(job)));
        Diagnostic::warning(message).explaining_no_contact().help(help)
    })
}

/// Notes a gelpad that is softer than a gel or harder than a rubber.
fn note_unusual_modulus(job: &Job, whose: SensorRole) -> Option<Diagnostic> {
    let [softest, hardest] =
        sensors::number_support(job, "gelpad_youngs_modulus_kpa", job.sensor.gelpad_youngs_modulus_kpa);
    let [least, most] = MODULI_KPA;
    let odd = if softest < least { Some(softest) } else { (hardest > most).then_some(hardest) };
    odd.map(|kpa| {
        let table = whose.table_name();
        let message = format!("{table}.gelpad_youngs_modulus_kpa may be {kpa}, where gelpads have {least} to {most}");
        // Perhaps the value is in pascals or megapascals.
        let meant = [1e-3, 1e3].map(|factor| factor * kpa).into_iter().find(|kpa| (least..=most).contains(kpa));
        let such_as =
            meant.map_or(String::new(), |kpa| format!(", such as gelpad_youngs_modulus_kpa = {}", format_number(kpa)));
        Diagnostic::warning(message).help(format!("its unit is kPa{such_as}; it scales forces and pressures only"))
    })
}
