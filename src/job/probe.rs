//! What the samples of a job touch, found out before any of them is rendered: some are drawn and captured.
//!
//! Single presses on flat pads take a capture each, about a millisecond; of other jobs only those who render samples anyway
//! can tell ([`Contacts::of`]). Where most samples miss the pad, changes of the job are tried on the same samples, and the one
//! that mends it is named.

use std::time::{Duration, Instant};

use rayon::prelude::*;

use crate::inspection::sides::{lowest_is_in_view, thin_fraction};
use crate::inspection::{SensorPad, findings, sides};
use crate::plan::Plan;
use crate::scene::{Pressed, Scene, crowded};
use gelsim_core::depth::{Window, captured};
use gelsim_core::pose::Anchor;
use gelsim_files::diagnostic::{Diagnostic, Diagnostics, Report};
use gelsim_files::sensor::quantity::Quantity;

/// Samples that are captured: so many, or so many of each object.
const PROBES: u64 = 32;
const PROBES_OF_AN_OBJECT: u64 = 4;
const MOST_PROBES: u64 = 256;

/// Wall time after which no more samples are captured.
const LONGEST: Duration = Duration::from_millis(500);

/// What a pixel that touches must have around it, or it is looked at closely: it is part of a square of four that touch.
const SCATTERED: f64 = 0.4;

/// A change of the job mends it if it brings so much of what is meant to touch into contact.
const MENDED: f64 = 0.8;

/// Number `k` of a job's samples in an order in which any first few are spread over all `count`: a step that visits all of them
/// before the first comes again, the largest below the golden section of `count` that has no common divisor with it.
pub fn spread(k: u64, count: u64) -> u64 {
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

/// What is foreseen of a job.
pub struct Foreseen {
    /// All that is to be said that is no mistake: of the job as written, and of what its samples touch.
    pub notes: Report,
    /// It says that most samples may miss the pad, and why.
    pub misses: bool,
}

/// Looks at a job before its samples are rendered.
pub fn foresee(plan: &Plan) -> Foreseen {
    let mut misses = plan.explains_misses;
    let mut found = Diagnostics::default();
    found.extend(crowded(plan));
    if is_captured(plan) {
        let touches = touches(plan);
        let contacts = Contacts::from_touches(&touches);
        if !misses {
            let missed = contacts.missed(plan, |plan, index| touch(plan, index).is_some_and(|touch| touch.touches));
            misses = missed.is_some();
            found.extend(missed);
        }
        found.extend(of_objects(plan, &touches, misses, plan.explains_misses));
    }
    Foreseen { notes: plan.notes.clone().and(Report::new(&found, &[])), misses }
}

/// True of a job of single presses of meshes on a flat pad, which a capture tells all of.
fn is_captured(plan: &Plan) -> bool {
    let job = plan.job();
    let flat = job.sensor.shape.is_none() && job.sensor.rest_shape.is_none();
    flat && job.sequence.is_none() && job.gripper.is_none() && !plan.sampling.objects.is_empty()
}

/// What a sample touches.
struct Touch {
    object: usize,
    index: u64,
    /// Its object is to reach into the pad, and not to stay above it.
    is_meant: bool,
    /// A pixel in view does.
    touches: bool,
    /// What reaches in first is in view, and between its pixels.
    slips: bool,
    /// The share of what touches that is narrower than two pixels.
    thin: f64,
}

/// The touches of some samples, spread over all.
fn touches(plan: &Plan) -> Vec<Touch> {
    let wanted = PROBES.max(PROBES_OF_AN_OBJECT * plan.sampling.objects.len() as u64).min(MOST_PROBES);
    let all = plan.layout.samples();
    let start = Instant::now();
    let found = (0..wanted.min(all)).into_par_iter().filter_map(|k| {
        // The first ones are wanted whatever they take.
        (k < 2 || start.elapsed() < LONGEST).then(|| touch(plan, spread(k, all))).flatten()
    });
    found.collect()
}

/// What sample `index` touches as it is drawn first; `None` where nothing tells.
fn touch(plan: &Plan, index: u64) -> Option<Touch> {
    let plan = plan.of_sample(index, 0);
    let scene = Scene::draw(plan, index, 0);
    let Pressed::Object(object) = scene.pressed else { return None };
    let is_meant = Scene::touches(plan, index, 0);
    let mut found = Touch { object, index, is_meant, touches: false, slips: false, thin: 0.0 };
    let indenter = scene.indenter(plan);
    if !is_meant || indenter.depth_mm() <= 0.0 {
        return Some(found);
    }
    let mut pad = SensorPad::new(&plan.job().sensor);
    pad.press_mm = indenter.depth_mm();
    let window = Window { margin_px: 0, above_mm: 0.0 };
    let depth = captured(&indenter, plan.simulator.view(), window, pad.thickness_mm);
    let (count, scattered) = scattered(&depth.penetration.data, depth.penetration.width);
    found.touches = count > 0;
    let clusters = indenter.shape().clusters()?;
    if count == 0 {
        found.slips = lowest_is_in_view(clusters, indenter.pose(), &pad);
    } else if scattered as f64 > SCATTERED * count as f64 {
        found.thin = thin_fraction(&sides::capture_finely(clusters, indenter.pose(), 0.0, &pad), &pad);
    }
    Some(found)
}

/// Pixels that touch, and those of them that are in no square of four such.
fn scattered(penetration: &[f32], width: usize) -> (usize, usize) {
    let touches = |x: usize, y: usize| penetration.get(y * width + x).is_some_and(|mm| *mm > 0.0);
    let height = penetration.len() / width.max(1);
    let (mut count, mut alone) = (0, 0);
    for y in 0..height {
        for x in 0..width {
            if !touches(x, y) {
                continue;
            }
            count += 1;
            let square = |left: usize, top: usize| {
                left + 1 < width && (0..2).all(|j| (0..2).all(|i| touches(left + i, top + j)))
            };
            let corners = [x.checked_sub(1), Some(x)].into_iter().flatten();
            let is_whole = corners
                .into_iter()
                .any(|left| [y.checked_sub(1), Some(y)].into_iter().flatten().any(|top| square(left, top)));
            alone += usize::from(!is_whole);
        }
    }
    (count, alone)
}

/// How many of some samples touch the pad.
pub struct Contacts {
    /// The samples that are meant to.
    pub meant: Vec<u64>,
    /// How many of those do.
    pub touching: u64,
    /// How many miss it because they slip between the pixels.
    slipping: u64,
}

impl Contacts {
    /// Of samples that were rendered: their numbers, and whether they are in contact.
    pub fn of(plan: &Plan, rendered: impl IntoIterator<Item = (u64, bool)>) -> Self {
        let (mut meant, mut touching) = (Vec::new(), 0);
        for (index, in_contact) in rendered {
            if Scene::touches(plan.of_sample(index, 0), index, 0) {
                meant.push(index);
                touching += u64::from(in_contact);
            }
        }
        Self { meant, touching, slipping: 0 }
    }

    fn from_touches(touches: &[Touch]) -> Self {
        let meant = touches.iter().filter(|touch| touch.is_meant);
        Self {
            meant: meant.clone().map(|touch| touch.index).collect(),
            touching: meant.clone().filter(|touch| touch.touches).count() as u64,
            slipping: meant.filter(|touch| touch.slips).count() as u64,
        }
    }

    /// What to say where less than half of what is to touch does: with the change of the job that mends it, tried on the same
    /// samples by `touches`.
    pub fn missed(&self, plan: &Plan, touches: impl Fn(&Plan, u64) -> bool + Sync) -> Option<Diagnostic> {
        let meant = self.meant.len() as u64;
        if 2 * self.touching >= meant || meant < 2 {
            return None;
        }
        // Said of each object.
        if 2 * self.slipping > meant - self.touching {
            return None;
        }
        let message = format!(
            "{} of {meant} samples that were tried touch the pad, where all are to: in view, nothing of the others reaches it",
            self.touching
        );
        let start = Instant::now();
        let share = |changed: &Plan| {
            let tried =
                self.meant.par_iter().filter_map(|index| (start.elapsed() < LONGEST).then(|| touches(changed, *index)));
            let (all, hits) = tried.map(|hit| (1, u64::from(hit))).reduce(|| (0_u64, 0), |a, b| (a.0 + b.0, a.1 + b.1));
            (all > 0).then(|| hits as f64 / all as f64)
        };
        let mends = |changed: &Plan| share(changed).is_some_and(|share| share >= MENDED);
        let remedy = remedies(plan).into_iter().find(|(_, changed)| mends(changed)).map(|(help, _)| help);
        Some(Diagnostic::warning(message).help(remedy.unwrap_or_else(|| {
            String::from("look at some of them with gelsim preview, and at the meshes with gelsim inspect: their size, and what of them [pose] brings into view")
        })))
    }
}

/// Changes of a job that may bring its objects into view, each with the words that tell them.
fn remedies(plan: &Plan) -> Vec<(String, Plan)> {
    let pose = &plan.job().pose;
    let zero = Quantity::Constant(0.0);
    let placed = pose.x_mm != zero || pose.y_mm != zero;
    let contact =
        "write anchor = \"contact\" under [pose], which puts the point that touches first where x_mm and y_mm say";
    let middle = "x_mm and y_mm of [pose] put most objects beside the view: write x_mm = 0.0 and y_mm = 0.0, or a range within it";
    let mut found = Vec::new();
    let mut add = |help: &str, change: &dyn Fn(&mut crate::config::Job)| {
        found.push((help.to_owned(), plan.with_job(change)));
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
    if let Some([x, y]) = place_of_lowest(plan) {
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

/// Where an object must be placed for what touches first of it to be in the middle of the view, mm; that of the first sample.
fn place_of_lowest(plan: &Plan) -> Option<[f64; 2]> {
    let middle = plan.with_job(|job| {
        job.pose.x_mm = Quantity::Constant(0.0);
        job.pose.y_mm = Quantity::Constant(0.0);
    });
    let middle = middle.of_sample(0, 0);
    let indenter = Scene::draw(middle, 0, 0).indenter(middle);
    let place = sides::lowest_place(indenter.shape().clusters()?, indenter.pose())?;
    // To a hundredth of a millimetre, and without a sign before zero.
    Some(place.map(|mm| (-100.0 * mm).round() / 100.0 + 0.0))
}

/// What is to be said of single objects: those that never touch, where others do, and those of which what touches is thin.
fn of_objects(plan: &Plan, touches: &[Touch], most_miss: bool, is_explained: bool) -> Vec<Diagnostic> {
    let pad = SensorPad::new(&plan.job().sensor);
    let mut found = Vec::new();
    for (number, object) in plan.sampling.objects.iter().enumerate() {
        let own = || touches.iter().filter(|touch| touch.object == number && touch.is_meant);
        let count = own().count() as u64;
        let missing = own().filter(|touch| !touch.touches).count() as u64;
        let slipping = own().filter(|touch| touch.slips).count() as u64;
        if slipping > 0 && 2 * slipping >= count && !is_explained {
            found.push(findings::slips("what touches first", &pad).diagnostic(&object.path));
        } else if count >= PROBES_OF_AN_OBJECT && missing == count && !most_miss {
            let message = format!("{}: none of {count} samples of it that were tried touches the pad", object.path);
            let help = "look at it with gelsim inspect; anchor = \"contact\" under [pose] brings the point that touches first into view";
            found.push(
                Diagnostic::warning(message)
                    .help(help)
                    .of(object.path.as_str(), "objects touch the pad in no sample that was tried"),
            );
        }
        let mut thin: Vec<f64> = own().filter(|touch| touch.touches).map(|touch| touch.thin).collect();
        thin.sort_by(f64::total_cmp);
        if let Some(median) = thin.get(thin.len() / 2)
            && *median >= findings::THIN_FRACTIONS[0]
        {
            let what = format!("{:.0} % of what touches", 100.0 * median);
            found.push(findings::thin(&what, *median, &pad).diagnostic(&object.path));
        }
    }
    found
}

impl Plan {
    /// The same that keeps samples which are not healthy: what its first draws are like.
    pub fn keeping_unhealthy(&self) -> Self {
        self.with_job(|job| job.output.on_unhealthy = crate::config::output::OnUnhealthy::Keep)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_stands_alone_is_told_from_what_is_part_of_a_square() {
        let row = |text: &str| text.chars().map(|c| if c == '#' { 1.0 } else { -1.0 }).collect::<Vec<f32>>();
        let of = |rows: [&str; 3]| scattered(&rows.map(row).concat(), 5);
        assert_eq!(of(["#.#.#", ".....", "#...#"]), (5, 5));
        assert_eq!(of(["##...", "##...", "....#"]), (5, 1));
        assert_eq!(of([".....", "#####", "....."]), (5, 5));
        assert_eq!(of(["#####", "#####", "#####"]), (15, 0));
    }

    #[test]
    fn samples_are_visited_once_each_and_the_first_are_far_apart() {
        for count in [1_u64, 2, 3, 7, 10, 64, 97, 200] {
            let mut seen: Vec<u64> = (0..count).map(|k| spread(k, count)).collect();
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
