//! Makes a plan without objects, for depth frames of a simulator.

use std::sync::Arc;

use super::check::JobChecker;
use super::{Plan, SampleSources, Scope, ranges};
use crate::config::document::{Document, TomlValue};
use crate::config::sequence::Sequence;
use crate::config::{self, Overrides};
use crate::layers::OutputLayer;
use gelsim_files::diagnostic::{Diagnostics, Report, user_error};
use gelsim_files::source::SourceSpan;

/// The settings on which the rendering of depth frames depends.
#[derive(Clone, Copy, Debug)]
pub struct FrameSettings<'a> {
    /// Name of a preset, or path of a sensor file.
    pub sensor: &'a str,
    /// Width and height of the frames, px. The field of view stays the sensor's.
    pub resolution_px: [usize; 2],
    /// Layers to be written.
    pub layers: &'a [OutputLayer],
    /// Classes of the objects in the frames, in any order.
    pub classes: &'a [String],
    /// Whether any object is moved in the pad's plane.
    pub moved: bool,
    /// Whether the frames follow each other in time.
    pub sequence: bool,
    /// Changes of the command line.
    pub overrides: &'a Overrides,
}

impl FrameSettings<'_> {
    /// Resolves the settings to a plan. The error reports all that is wrong with the sensor and the changes of the
    /// command line.
    pub fn resolve_plan(&self) -> Result<Plan, Report> {
        let mut problems = Diagnostics::default();
        let place = SourceSpan { source: 0, start: 0, end: self.sensor.len() };
        let resolution_px = self.resolution_px.map(|px| TomlValue::Integer(px as i64));
        let layers = self.layers.iter().map(|layer| TomlValue::String(layer.name().to_owned()));
        let given = vec![
            ("sensor.resolution_px", TomlValue::list(place, resolution_px)),
            ("output.layers", TomlValue::list(place, layers)),
        ];
        let mut written = config::read_sensor(self.sensor, given, self.overrides, &mut problems);
        written.job.sequence = self.sequence.then(Sequence::default);
        let plan = Plan::resolve_in(Scope::Frames, written, problems)?;
        let sensor = plan.simulator.sensor();
        if self.moved && sensor.shape.is_some() && sensor.pins.is_none() && !super::shows_motion(self.layers) {
            let message = "shear that neither pins nor the layers `flow` and `traction` show on a gel that has a shape is not simulated";
            return Err(user_error(message, "leave shear_x_mm, shear_y_mm and twist_deg out, or add --layers flow"));
        }
        let sampling = SampleSources {
            objects: Vec::new(),
            classes: super::list_classes(self.classes.iter().map(String::as_str)),
            object_samplers: plan.sampling.object_samplers.clone(),
            textures: plan.sampling.textures.clone(),
            moves_objects: self.moved || plan.sampling.moves_objects,
        };
        Ok(Plan { sampling: Arc::new(sampling), ..plan })
    }
}

impl Plan {
    /// Returns a plan of the same simulator with another seed and other layers. The error says why the layers cannot be
    /// made.
    pub fn with_samples(&self, seed: u64, layers: &[OutputLayer]) -> Result<Self, Report> {
        let mut plan = self.clone();
        plan.job.dataset.seed = seed;
        plan.job.output.layers = layers.to_vec();
        let (document, mut problems) = (Document::empty(), Diagnostics::default());
        let mut check = JobChecker { document: &document, problems: &mut problems };
        ranges::check_seed(&mut check, &plan.job);
        ranges::check_layers(&mut check, &plan.job, &plan.simulator.models().gelpad);
        if !problems.is_empty() {
            return Err(Report::new(&problems, &[]));
        }
        plan.fingerprint = super::compute_fingerprint(&plan.job);
        Ok(plan)
    }
}
