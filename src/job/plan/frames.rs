//! A plan without objects: what is pressed comes as depth frames of a simulator.

use std::sync::Arc;

use super::check::Check;
use super::{Plan, Sampling, Scope, ranges};
use crate::config::document::{Document, Value};
use crate::config::sequence::Sequence;
use crate::config::{self, Overrides};
use crate::layers::OutputLayer;
use gelsim_files::diagnostic::{Diagnostics, Report, user_error};
use gelsim_files::source::Place;

/// What the rendering of depth frames depends on.
#[derive(Clone, Copy, Debug)]
pub struct Frames<'a> {
    /// Preset or sensor file.
    pub sensor: &'a str,
    /// Width and height of the frames, px; the field of view stays the sensor's.
    pub resolution_px: [usize; 2],
    /// Layers to be written.
    pub layers: &'a [OutputLayer],
    /// Classes of what the frames show, in any order.
    pub classes: &'a [String],
    /// True if any frame is moved in the pad's plane.
    pub moved: bool,
    /// The frames follow each other.
    pub sequence: bool,
    /// What the command line changes.
    pub overrides: &'a Overrides,
}

impl Frames<'_> {
    /// Resolves it. On failure, every mistake in the sensor and in what the command line changes.
    pub fn plan(&self) -> Result<Plan, Report> {
        let mut problems = Diagnostics::default();
        let place = Place { source: 0, start: 0, end: self.sensor.len() };
        let resolution_px = self.resolution_px.map(|px| Value::Integer(px as i64));
        let layers = self.layers.iter().map(|layer| Value::String(layer.name().to_owned()));
        let given = vec![
            ("sensor.resolution_px", Value::list(place, resolution_px)),
            ("output.layers", Value::list(place, layers)),
        ];
        let mut written = config::read_sensor(self.sensor, given, self.overrides, &mut problems);
        written.job.sequence = self.sequence.then(Sequence::default);
        let plan = Plan::resolve_in(Scope::Frames, written, problems)?;
        let sensor = plan.simulator.sensor();
        if self.moved && sensor.shape.is_some() && sensor.pins.is_none() && !self.layers.contains(&OutputLayer::Flow) {
            let message =
                "shear that neither pins nor the layer `flow` show on a gel that has a shape is not simulated";
            return Err(user_error(message, "leave shear_x_mm, shear_y_mm and twist_deg out, or add --layers flow"));
        }
        let sampling = Sampling {
            objects: Vec::new(),
            classes: super::classes(self.classes.iter().map(String::as_str)),
            draw: plan.sampling.draw.clone(),
            textures: plan.sampling.textures.clone(),
            moves_objects: self.moved || plan.sampling.moves_objects,
        };
        Ok(Plan { sampling: Arc::new(sampling), ..plan })
    }
}

impl Plan {
    /// The same simulator for other samples: with another seed, and other layers to be made. On failure, why the layers
    /// cannot be made.
    pub fn with_samples(&self, seed: u64, layers: &[OutputLayer]) -> Result<Self, Report> {
        let mut plan = self.clone();
        plan.job.dataset.seed = seed;
        plan.job.output.layers = layers.to_vec();
        let (document, mut problems) = (Document::empty(), Diagnostics::default());
        let mut check = Check { document: &document, problems: &mut problems };
        ranges::seed(&mut check, &plan.job);
        ranges::layers(&mut check, &plan.job, &plan.simulator.models().gelpad);
        if !problems.is_empty() {
            return Err(Report::new(&problems, &[]));
        }
        plan.fingerprint = super::fingerprint(&plan.job);
        Ok(plan)
    }
}
