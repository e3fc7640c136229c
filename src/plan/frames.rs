//! A plan without objects: what is pressed comes as depth frames of a simulator.

use std::fmt::Write;
use std::path::Path;

use super::{Draw, Plan, standalone};
use crate::config::diagnostic::{Problems, Report};
use crate::config::output::Layer;
use crate::config::{self, Overrides};

/// What the rendering of depth frames depends on.
#[derive(Clone, Copy, Debug)]
pub struct Frames<'a> {
    /// Preset or sensor file.
    pub sensor: &'a str,
    /// Width and height of the frames, px; the field of view stays the sensor's.
    pub resolution_px: [usize; 2],
    /// Layers to be written.
    pub layers: &'a [Layer],
    /// Classes of what the frames show, in any order.
    pub classes: &'a [String],
    /// True if any frame is moved in the pad's plane.
    pub moved: bool,
    /// What the command line changes.
    pub overrides: &'a Overrides,
}

impl Frames<'_> {
    /// Resolves it. On failure, every mistake in the sensor and in what the command line changes.
    pub fn plan(&self) -> Result<Plan, Report> {
        let mut problems = Problems::default();
        let written = config::read_text("--sensor", self.job(), Path::new(""), self.overrides, &mut problems);
        let mut plan = Plan::resolve_with(written, problems, |_, _, _| Some((Vec::new(), Draw::NOTHING)))?;
        plan.classes = super::classes(self.classes.iter().map(String::as_str));
        Ok(plan)
    }

    /// The same as a job's text.
    fn job(&self) -> String {
        let layers: Vec<&str> = self.layers.iter().map(|layer| layer.name()).collect();
        let mut text = String::from("[dataset]\nname = \"frames\"\nsamples = 1\n[indentation]\ndepth_mm = 0.0\n");
        text.push_str(&standalone::table(self.sensor));
        let _ = writeln!(text, "resolution_px = {:?}\n[output]\nlayers = {layers:?}", self.resolution_px);
        if self.moved {
            // The law is not drawn from: it says that there is shear, the frames' own.
            text.push_str("[shear]\ntwist_deg = [-1.0, 1.0]\n");
        }
        text
    }
}
