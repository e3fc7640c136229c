//! Predicts, before any sample is rendered, whether the samples of a job touch the pad: some are drawn and captured.
//!
//! A single press on a flat pad takes a capture, about a millisecond. For other jobs only rendered samples can tell
//! ([`ContactCounts::from_rendered`]). If most samples miss the pad, changes of the job are tried on the same samples,
//! and the one that fixes it is suggested.

use std::time::{Duration, Instant};

use rayon::prelude::*;

use crate::inspection::sides::{is_lowest_in_view, measure_thin_fraction};
use crate::inspection::{SensorPad, findings, sides};
use crate::plan::Plan;
use crate::scene::{PressSource, Scene, note_crowded_scenes};
use gelsim_core::depth::thinness::count_scattered_pixels;
use gelsim_core::depth::{CaptureWindow, capture_indenter};
use gelsim_core::pose::Anchor;
use gelsim_files::diagnostic::{Diagnostic, Diagnostics, Report};
use gelsim_files::sensor::quantity::Quantity;

/// Number of samples that are captured at least.
const PROBES: u64 = 32;
/// Number of samples that are captured for each object.
const PROBES_OF_AN_OBJECT: u64 = 4;
/// Most samples that are captured.
const MAX_PROBES: u64 = 256;

/// Wall time after which no more samples are captured.
const MAX_PROBE_TIME: Duration = Duration::from_millis(500);

/// Fraction of touching pixels that are in no square of four touching ones, above which a sample is examined on the
/// fine grid.
const SCATTERED_SHARE: f64 = 0.4;

/// A change fixes a job if at least this fraction of the samples that should touch the pad then do.
const FIXED_SHARE: f64 = 0.8;

/// Returns the number `k` of a job's samples in an order in which the first few are always spread over all `count`. The
/// order steps by the largest number below the golden section of `count` that has no common divisor with it, so that
/// every sample comes once before any comes again.
pub fn spread_index(k: u64, count: u64) -> u64 {
    let golden = (count as f64 * 0.618_033_988_749_894_9) as u64;
    let divisor = |mut a: u64, mut b: u64| {
        while b > 0 {
            (a, b) = (b, a % b);
        }
        a
    };
    let step = (1..=golden).rev().find(|step| divisor(*step, count) == 1).unwrap_or(1);
    (u128::from(k) * u128::from(step) % u128::from(count.max(1))) as u64
}

/// What is known of a job before it is rendered.
pub struct JobPreview {
    /// All notes: those on the job as written, and those on what its samples touch.
    pub notes: Report,
    /// Whether a note says that most samples may miss the pad.
    pub may_miss: bool,
}

/// Examines a job before its samples are rendered.
pub fn preview_job(plan: &Plan) -> JobPreview {
    let mut misses = plan.explains_no_contact;
    let mut found = Diagnostics::default();
    found.extend(note_crowded_scenes(plan));
    if is_capturable(plan) {
        let touches = probe_touches(plan);
        let contacts = ContactCounts::from_touches(&touches);
        if !misses {
            let missed = contacts
                .note_missed_contacts(plan, |plan, index| probe_touch(plan, index).is_some_and(|touch| touch.touches));
            misses = missed.is_some();
            found.extend(missed);
        }
        found.extend(note_object_contacts(plan, &touches, misses, plan.explains_no_contact));
    }
    JobPreview { notes: plan.notes.clone().merged_with(Report::new(&found, &[])), may_miss: misses }
}

/// Returns true for a job of single presses of meshes on a flat pad, for which a capture tells everything.
fn is_capturable(plan: &Plan) -> bool {
    let job = plan.job();
    let flat = job.sensor.shape.is_none() && job.sensor.rest_shape.is_none();
    flat && job.sequence.is_none() && job.gripper.is_none() && !plan.sampling.objects.is_empty()
}

/// What a sample touches.
struct SampleTouch {
    object: usize,
    index: u64,
    /// Whether its object should reach into the pad, and not stay above it.
    is_meant: bool,
    /// Whether a pixel in view touches.
    touches: bool,
    /// Whether the part that reaches in first is in view, but between the pixels.
    slips: bool,
    /// Fraction of what touches that is narrower than two pixels.
    thin: f64,
}

/// Probes some samples, spread over all.
fn probe_touches(plan: &Plan) -> Vec<SampleTouch> {
    let wanted = PROBES.max(PROBES_OF_AN_OBJECT * plan.sampling.objects.len() as u64).min(MAX_PROBES);
    let all = plan.layout.sample_count();
    let start = Instant::now();
    let found = (0..wanted.min(all)).into_par_iter().filter_map(|k| {
        // The first two samples are always probed, however long they take.
        (k < 2 || start.elapsed() < MAX_PROBE_TIME).then(|| probe_touch(plan, spread_index(k, all))).flatten()
    });
    found.collect()
}

/// Probes the first draw of sample `index`. Returns `None` if it cannot be probed.
fn probe_touch(plan: &Plan, index: u64) -> Option<SampleTouch> {
    let plan = plan.for_sample(index, 0);
    let scene = Scene::draw_pressed(plan, index, 0);
    let PressSource::Object(object) = scene.pressed else { return None };
    let is_meant = Scene::should_touch(plan, index, 0);
    let mut found = SampleTouch { object, index, is_meant, touches: false, slips: false, thin: 0.0 };
    let indenter = scene.indenter(plan);
    if !is_meant || indenter.depth_mm() <= 0.0 {
        return Some(found);
    }
    let mut pad = SensorPad::new(&plan.job().sensor);
    pad.press_mm = indenter.depth_mm();
    let window = CaptureWindow { margin_px: 0, above_mm: 0.0 };
    let depth = capture_indenter(&indenter, plan.simulator.view(), window, pad.thickness_mm);
    let (count, scattered) = count_scattered_pixels(&depth.penetration);
    found.touches = count > 0;
    let clusters = indenter.shape().clusters()?;
    if count == 0 {
        found.slips = is_lowest_in_view(clusters, indenter.pose(), &pad);
    } else if scattered as f64 > SCATTERED_SHARE * count as f64 {
        found.thin = measure_thin_fraction(&sides::capture_finely(clusters, indenter.pose(), 0.0, &pad), &pad);
    }
    Some(found)
}

/// How many of some samples touch the pad.
pub struct ContactCounts {
    /// The samples that should touch it.
    pub meant: Vec<u64>,
    /// Number of those that do.
    pub touching: u64,
    /// Number of those that miss it because they slip between the pixels.
    slipping: u64,
}

impl ContactCounts {
    /// Counts samples that were rendered, from their indices and whether they are in contact.
    pub fn from_rendered(plan: &Plan, rendered: impl IntoIterator<Item = (u64, bool)>) -> Self {
        let (mut meant, mut touching) = (Vec::new(), 0);
        for (index, in_contact) in rendered {
            if Scene::should_touch(plan.for_sample(index, 0), index, 0) {
                meant.push(index);
                touching += u64::from(in_contact);
            }
        }
        Self { meant, touching, slipping: 0 }
    }

    fn from_touches(touches: &[SampleTouch]) -> Self {
        let meant = touches.iter().filter(|touch| touch.is_meant);
        Self {
            meant: meant.clone().map(|touch| touch.index).collect(),
            touching: meant.clone().filter(|touch| touch.touches).count() as u64,
            slipping: meant.filter(|touch| touch.slips).count() as u64,
        }
    }

    /// Makes a warning if less than half of the samples that should touch the pad do. It suggests the change of the job
    /// that fixes this, tried on the same samples by `touches`.
    pub fn note_missed_contacts(&self, plan: &Plan, touches: impl Fn(&Plan, u64) -> bool + Sync) -> Option<Diagnostic> {
        let meant = self.meant.len() as u64;
        if 2 * self.touching >= meant || meant < 2 {
            return None;
        }
        // Slipping objects are reported one by one.
        if 2 * self.slipping > meant - self.touching {
            return None;
        }
        let message = format!(
            "{} of {meant} samples that were tried touch the pad, where all are to: in view, nothing of the others reaches it",
            self.touching
        );
        let start = Instant::now();
        let share = |changed: &Plan| {
            let tried = self
                .meant
                .par_iter()
                .filter_map(|index| (start.elapsed() < MAX_PROBE_TIME).then(|| touches(changed, *index)));
            let (all, hits) = tried.map(|hit| (1, u64::from(hit))).reduce(|| (0_u64, 0), |a, b| (a.0 + b.0, a.1 + b.1));
            (all > 0).then(|| hits as f64 / all as f64)
        };
        let fixes = |changed: &Plan| share(changed).is_some_and(|share| share >= FIXED_SHARE);
        let remedy = list_remedies(plan).into_iter().find(|(_, changed)| fixes(changed)).map(|(help, _)| help);
        Some(Diagnostic::warning(message).help(remedy.unwrap_or_else(|| {
            String::from("look at some of them with gelsim preview, and at the meshes with gelsim inspect: their size, and what of them [pose] brings into view")
        })))
    }
}

/// Lists changes of a job that may bring its objects into view, each with the suggestion in words.
fn list_remedies(plan: &Plan) -> Vec<(String, Plan)> {
    let pose = &plan.job().pose;
    let zero = Quantity::Constant(0.0);
    let placed = pose.x_mm != zero || pose.y_mm != zero;
    let contact =
        "write anchor = \"contact\" under [pose], which puts the point that touches first where x_mm and y_mm say";
    let middle = "x_mm and y_mm of [pose] put most objects beside the view: write x_mm = 0.0 and y_mm = 0.0, or a range within it";
    let mut found = Vec::new();
    let mut add = |help: &str, change: &dyn Fn(&mut crate::config::Job)| {
        found.push((help.to_owned(), plan.map_job(change)));
    };
    if pose.anchor != Anchor::Contact {
        add(contact, &|job| job.pose.anchor = Anchor::Contact);
    }
    if placed {
        add(middle, &|job| {
            job.pose.x_mm = Quantity::Constant(0.0);
            job.pose.y_mm = Quantity::Constant(0.0);
        });
        add(&format!("{contact}; {middle}"), &|job| {
            job.pose.anchor = Anchor::Contact;
            job.pose.x_mm = Quantity::Constant(0.0);
            job.pose.y_mm = Quantity::Constant(0.0);
        });
    }
    if let Some([x, y]) = find_centring_place(plan) {
        let help = format!(
            "write x_mm = {x} and y_mm = {y} under [pose], which put what touches first into the middle of the view"
        );
        add(&help, &|job| {
            job.pose.x_mm = Quantity::Constant(x);
            job.pose.y_mm = Quantity::Constant(y);
        });
    }
    found
}

/// Returns the position at which the part of the first sample's object that touches first is in the middle of the view,
/// mm.
fn find_centring_place(plan: &Plan) -> Option<[f64; 2]> {
    let middle = plan.map_job(|job| {
        job.pose.x_mm = Quantity::Constant(0.0);
        job.pose.y_mm = Quantity::Constant(0.0);
    });
    let middle = middle.for_sample(0, 0);
    let indenter = Scene::draw(middle, 0, 0).indenter(middle);
    let place = sides::find_lowest_place(indenter.shape().clusters()?, indenter.pose())?;
    // Round to a hundredth of a millimetre; adding 0 removes the sign of a negative zero.
    Some(place.map(|mm| (-100.0 * mm).round() / 100.0 + 0.0))
}

/// Makes notes on single objects: those that never touch while others do, and those of which what touches is thin.
fn note_object_contacts(plan: &Plan, touches: &[SampleTouch], most_miss: bool, is_explained: bool) -> Vec<Diagnostic> {
    let pad = SensorPad::new(&plan.job().sensor);
    let mut found = Vec::new();
    for (number, object) in plan.sampling.objects.iter().enumerate() {
        let own = || touches.iter().filter(|touch| touch.object == number && touch.is_meant);
        let count = own().count() as u64;
        let missing = own().filter(|touch| !touch.touches).count() as u64;
        let slipping = own().filter(|touch| touch.slips).count() as u64;
        if slipping > 0 && 2 * slipping >= count && !is_explained {
            found.push(findings::report_slipping("what touches first", &pad).to_diagnostic(&object.path));
        } else if count >= PROBES_OF_AN_OBJECT && missing == count && !most_miss {
            let message = format!("{}: none of {count} samples of it that were tried touches the pad", object.path);
            let help = "look at it with gelsim inspect; anchor = \"contact\" under [pose] brings the point that touches first into view";
            found.push(
                Diagnostic::warning(message)
                    .help(help)
                    .about(object.path.as_str(), "objects touch the pad in no sample that was tried"),
            );
        }
        let mut thin: Vec<f64> = own().filter(|touch| touch.touches).map(|touch| touch.thin).collect();
        thin.sort_by(f64::total_cmp);
        if let Some(median) = thin.get(thin.len() / 2)
            && *median >= findings::THIN_FRACTIONS[0]
        {
            let what = format!("{:.0} % of what touches", 100.0 * median);
            found.push(findings::report_thin(&what, *median, &pad).to_diagnostic(&object.path));
        }
    }
    found
}

impl Plan {
    /// Returns the plan that keeps samples which are not healthy, so that they are not drawn again.
    pub fn keeping_unhealthy(&self) -> Self {
        self.map_job(|job| job.output.on_unhealthy = crate::config::output::OnUnhealthy::Keep)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_are_visited_once_each_and_the_first_are_far_apart() {
        for count in [1_u64, 2, 3, 7, 10, 64, 97, 200] {
            let mut seen: Vec<u64> = (0..count).map(|k| spread_index(k, count)).collect();
            if count >= 64 {
                let mut first: Vec<u64> = seen[..8].to_vec();
                first.sort_unstable();
                let gaps = first.windows(2).map(|pair| pair[1] - pair[0]);
                assert!(gaps.max().unwrap_or(0) <= count / 3, "{count}: {first:?}");
            }
            seen.sort_unstable();
            assert!(seen.into_iter().eq(0..count), "{count}");
        }
    }
}
