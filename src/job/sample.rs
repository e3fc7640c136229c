//! Renders a sample of a plan: draws, presses and labels it, and draws it again if it is not healthy and the job
//! rejects such samples.

use std::fmt;
use std::sync::Arc;

use crate::config::output::OnUnhealthy;
use crate::label::{Label, LabelHeader};
use crate::plan::Plan;
use crate::scene::Scene;
use gelsim_core::base::clock::{Seconds, ThreadClock};
use gelsim_core::base::grid::Grid;
use gelsim_core::impression::Impression;
use gelsim_core::instances::map_instances;
use gelsim_core::simulator::{Press, Simulator};

/// A rendered sample.
pub struct Sample {
    /// The simulator of its sensor.
    pub simulator: Arc<Simulator>,
    /// Result of the press.
    pub impression: Impression,
    /// The number of the object at each pixel ([`Impression::instance_mask`]); `None` if there is only one object.
    pub numbered: Option<Grid<u8>>,
    /// Label of the sample.
    pub label: Label,
    /// CPU seconds of each stage. They are not part of the label, since they differ from run to run.
    pub seconds: Seconds,
}

/// Renders the first draw of sample `index`.
pub fn render(plan: &Plan, index: u64) -> Sample {
    render_attempt(plan, index, 0)
}

/// Renders sample `index` as it is drawn after `attempt` rejected draws.
pub fn render_attempt(plan: &Plan, index: u64, attempt: u32) -> Sample {
    let plan = plan.for_sample(index, attempt);
    let mut clock = ThreadClock::start();
    // All randomness of the sample is in this draw.
    let scene = Scene::draw_pressed(plan, index, attempt);
    let seconds = clock.lap();
    let mut sample = press(plan, &scene);
    sample.seconds.scene += seconds;
    sample
}

/// Renders and labels one press of `plan`.
pub fn press(plan: &Plan, scene: &Scene) -> Sample {
    let mut clock = ThreadClock::start();
    // The plan's simulator, unless samples differ in their sensors.
    let simulator = scene.simulator(plan);
    let of_sensor = clock.lap();
    let mut sample = press_with_simulator(plan, scene, simulator);
    sample.seconds.scene += of_sensor;
    sample
}

/// Renders and labels a press with the simulator of its sensor.
pub fn press_with_simulator(plan: &Plan, scene: &Scene, simulator: Arc<Simulator>) -> Sample {
    let impression = simulator.press_with(&scene.to_press(plan));
    label_press(plan, scene, simulator, impression)
}

/// Renders sample `index` of several plans that press the same objects, each as [`render`] does, and calls `each` with
/// the plan and its sample, in order. What is pressed into sensors of the same pad and view is drawn, and its contact
/// computed, once.
pub fn render_together(plans: &[&Plan], index: u64, mut each: impl FnMut(&Plan, Sample)) {
    let mut drawn: Vec<(Scene, Arc<Simulator>)> = Vec::with_capacity(plans.len());
    let mut presses: Vec<Press> = Vec::with_capacity(plans.len());
    let mut seconds = Vec::with_capacity(plans.len());
    for plan in plans {
        let mut clock = ThreadClock::start();
        // The sensor of this draw alone says whether an earlier scene fits.
        let known = drawn.iter().zip(plans).zip(&presses).find_map(|(((scene, simulator), known), press)| {
            let scene = known.presses_like(plan).then(|| scene.seen_by_sensor(plan))?;
            let own = scene.simulator(plan);
            let is_shared = own.shares_contact(simulator);
            is_shared.then(|| (scene.press_again(press), scene, own))
        });
        let (press, scene, simulator) = known.unwrap_or_else(|| {
            let scene = Scene::draw_pressed(plan, index, 0);
            let simulator = scene.simulator(plan);
            (scene.to_press(plan), scene, simulator)
        });
        presses.push(press);
        drawn.push((scene, simulator));
        seconds.push(clock.lap());
    }
    let pressed: Vec<(&Simulator, &Press)> =
        drawn.iter().zip(&presses).map(|((_, simulator), press)| (&**simulator, press)).collect();
    let mut scenes = plans.iter().zip(&drawn).zip(seconds);
    Simulator::try_press_together(&pressed, |impression| {
        if let Some(((plan, (scene, simulator)), seconds)) = scenes.next() {
            let mut sample = label_press(plan, scene, Arc::clone(simulator), impression);
            sample.seconds.scene += seconds;
            each(plan, sample);
        }
    })
    .unwrap_or_else(|error| panic!("{error}"));
}

fn label_press(plan: &Plan, scene: &Scene, simulator: Arc<Simulator>, impression: Impression) -> Sample {
    let mut clock = ThreadClock::start();
    let several = !scene.other_objects.is_empty();
    let numbered = several.then(|| impression.instance_mask(&scene.outlines(), &scene.plane));
    let label = Label::describe(plan, scene, &simulator, &impression, numbered.as_ref());
    let seconds = Seconds { label: clock.lap(), ..impression.seconds };
    Sample { simulator, impression, numbered, label, seconds }
}

impl Sample {
    /// Returns, for each pixel of the image, the number of the object that the pad touches, counted from 1 in the
    /// label's order; 0 if it touches none.
    pub fn instance_map(&self) -> Vec<u8> {
        map_instances(&self.impression, self.numbered.as_ref())
    }
}

/// Most draws of a sample before the run gives up.
pub const MAX_ATTEMPTS: u32 = 100;

/// A sample that may go into the dataset, and the rejected draws before it.
pub struct AcceptedSample {
    /// The sample.
    pub sample: Sample,
    /// Labels of the draws before it that were rejected.
    pub rejected: Vec<Label>,
}

/// The error for a sample of which no draw may go into the dataset. Holds the label of the last draw.
#[derive(Debug)]
pub struct RejectedSample(pub Box<Label>);

impl fmt::Display for RejectedSample {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Label { header: LabelHeader { key, seed, attempt, .. }, health, .. } = &*self.0;
        let (draws, s) = (attempt + 1, if *attempt == 0 { "" } else { "s" });
        write!(f, "sample {key} (seed {seed}, drawn {draws} time{s}) is not healthy: {}", health.reason)
    }
}

/// Renders sample `index` as it would be in a dataset. If no draw may go into one, it is the first draw.
pub fn render_for_display(plan: &Plan, index: u64) -> Sample {
    accept_sample(plan, index).map_or_else(|_| render(plan, index), |accepted| accepted.sample)
}

/// Renders sample `index`, again and again if the plan rejects unhealthy ones. The CPU time of rejected draws counts in
/// its seconds.
pub fn accept_sample(plan: &Plan, index: u64) -> Result<AcceptedSample, RejectedSample> {
    let mut rejected: Vec<Label> = Vec::new();
    let mut sample = render(plan, index);
    loop {
        let again = rejected.len() as u32 + 1;
        match plan.output().on_unhealthy {
            _ if sample.label.health.healthy => break,
            OnUnhealthy::Keep => break,
            OnUnhealthy::Reject if again < MAX_ATTEMPTS => {}
            OnUnhealthy::Reject | OnUnhealthy::Fail => return Err(RejectedSample(Box::new(sample.label))),
        }
        let next = render_attempt(plan, index, again);
        let before = std::mem::replace(&mut sample, next);
        sample.seconds.add(&before.seconds);
        rejected.push(before.label);
    }
    Ok(AcceptedSample { sample, rejected })
}
