//! One sample of a plan: drawn, pressed, described, and drawn again where it is not sound and the job wants that.

use std::fmt;
use std::sync::Arc;

use crate::config::output::OnUnhealthy;
use crate::label::{Label, LabelHeader};
use crate::plan::Plan;
use crate::scene::Scene;
use gelsim_core::base::clock::{Clock, Seconds};
use gelsim_core::base::grid::Grid;
use gelsim_core::impression::Impression;
use gelsim_core::simulator::Simulator;

/// One sample of a dataset.
pub struct Sample {
    /// The simulator of its sensor.
    pub simulator: Arc<Simulator>,
    /// What the press gave.
    pub impression: Impression,
    /// Of several objects, which of them is where ([`Impression::numbered`]); `None` of one.
    pub numbered: Option<Grid<u8>>,
    /// What is known about it.
    pub label: Label,
    /// CPU seconds that each stage took; not part of the label, because they differ from run to run.
    pub seconds: Seconds,
}

/// Renders sample `index` of `plan` as it is drawn first.
pub fn render(plan: &Plan, index: u64) -> Sample {
    attempt(plan, index, 0)
}

/// Renders sample `index` of `plan` as it is drawn after `attempt` draws were rejected.
pub fn attempt(plan: &Plan, index: u64, attempt: u32) -> Sample {
    let plan = plan.of_sample(index, attempt);
    let mut clock = Clock::start();
    // Object, pose, indentation: all randomness of the sample.
    let scene = Scene::draw(plan, index, attempt);
    let seconds = clock.lap();
    let mut sample = press(plan, &scene);
    sample.seconds.scene += seconds;
    sample
}

/// Renders and describes one press of `plan`.
pub fn press(plan: &Plan, scene: &Scene) -> Sample {
    let mut clock = Clock::start();
    // The plan's, or another one where samples differ in their sensors.
    let simulator = scene.simulator(plan);
    let of_sensor = clock.lap();
    let mut sample = press_with(plan, scene, simulator);
    sample.seconds.scene += of_sensor;
    sample
}

/// The same with the simulator of the press's sensor.
pub fn press_with(plan: &Plan, scene: &Scene, simulator: Arc<Simulator>) -> Sample {
    let impression = simulator.press_with(&scene.press(plan));
    let mut clock = Clock::start();
    let several = !scene.others.is_empty();
    let numbered = several.then(|| impression.numbered(&scene.outlines(), &scene.plane));
    let label = Label::describe(plan, scene, &simulator, &impression, numbered.as_ref());
    let seconds = Seconds { label: clock.lap(), ..impression.seconds };
    Sample { simulator, impression, numbered, label, seconds }
}

impl Sample {
    /// Of each pixel of the image the number of the object that touches the pad there, counted from 1 in the label's order; 0
    /// where none does.
    pub fn instances(&self) -> Vec<u8> {
        let mask = &self.impression.contact.mask;
        let touches = |(at, mask): (usize, &u8)| match &self.numbered {
            _ if *mask == 0 => 0,
            Some(numbered) => numbered.data[at],
            None => 1,
        };
        let data = mask.data.iter().enumerate().map(touches).collect();
        self.impression.in_image(&Grid { data, ..*mask }).data
    }
}

/// Draws of one sample before the run gives up.
pub const MOST_ATTEMPTS: u32 = 100;

/// A sample that may go into the dataset, and the draws of it that may not.
pub struct Accepted {
    /// The sample.
    pub sample: Sample,
    /// What was drawn before it and rejected.
    pub rejected: Vec<Label>,
}

/// A sample of which no draw may go into the dataset: the label of the last one.
#[derive(Debug)]
pub struct Unfit(pub Box<Label>);

impl fmt::Display for Unfit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Label { header: LabelHeader { key, seed, attempt, .. }, health, .. } = &*self.0;
        let (draws, s) = (attempt + 1, if *attempt == 0 { "" } else { "s" });
        write!(f, "sample {key} (seed {seed}, drawn {draws} time{s}) is not healthy: {}", health.reason)
    }
}

/// Sample `index` as a dataset would have it; its first draw if no draw may go into one.
pub fn shown(plan: &Plan, index: u64) -> Sample {
    accept(plan, index).map_or_else(|_| render(plan, index), |accepted| accepted.sample)
}

/// Renders sample `index`, again and again if the plan rejects unhealthy ones. Stages of rejected draws count in the
/// sample's seconds.
pub fn accept(plan: &Plan, index: u64) -> Result<Accepted, Unfit> {
    let mut rejected: Vec<Label> = Vec::new();
    let mut sample = render(plan, index);
    loop {
        let again = rejected.len() as u32 + 1;
        match plan.output().on_unhealthy {
            _ if sample.label.health.healthy => break,
            OnUnhealthy::Keep => break,
            OnUnhealthy::Reject if again < MOST_ATTEMPTS => {}
            OnUnhealthy::Reject | OnUnhealthy::Fail => return Err(Unfit(Box::new(sample.label))),
        }
        let next = attempt(plan, index, again);
        let before = std::mem::replace(&mut sample, next);
        sample.seconds.add(&before.seconds);
        rejected.push(before.label);
    }
    Ok(Accepted { sample, rejected })
}
