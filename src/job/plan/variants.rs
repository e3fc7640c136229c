//! Plans that differ from another plan in their models, effects, fidelity level or frame rate.

use std::sync::Arc;

use crate::config::Job;
use gelsim_core::effects::EffectPolicy;
use gelsim_core::fidelity::{Fidelity, Models};
use gelsim_core::simulator::Simulator;

use super::fingerprint::compute_fingerprint;
use super::{Plan, create_simulator};

impl Plan {
    /// Returns the plan with other models under the same level's name, for comparisons.
    pub fn with_models(&self, models: Models) -> Self {
        self.with_simulator(&models, self.simulator.policy())
    }

    /// Returns the plan with another choice of effects, for comparisons.
    pub fn with_policy(&self, policy: EffectPolicy) -> Self {
        self.with_simulator(self.simulator.models(), policy)
    }

    /// Returns the plan with the models of a fidelity level, whatever gelpad the job chose. An optics model that the
    /// job names stays, and so does its friction. The job must allow the level: see [`Plan::allows_level`].
    pub fn with_fidelity(&self, fidelity: Fidelity) -> Self {
        self.map_sensors(&|plan| {
            let mut models = fidelity.models(plan.simulator.sensor().light_source());
            models.gelpad = models.gelpad.with_friction(plan.simulator.models().gelpad.friction());
            if plan.optics_named {
                let mut own = plan.simulator.models().optics.clone();
                if let (Some(own), Some(of_level), false) = (own.phong_mut(), models.optics.phong(), plan.shadows_named)
                {
                    own.shadows = of_level.shadows;
                }
                models.optics = own;
            }
            let mut job = plan.job.clone();
            job.fidelity = Some(fidelity.into());
            job.gelpad = Some(models.gelpad.clone());
            job.optics = Some(models.optics.clone());
            let simulator = plan.rebuild_simulator(models, plan.simulator.policy());
            Self { fingerprint: compute_fingerprint(&job), job, simulator, ..plan.clone() }
        })
    }

    /// Returns the plan with a simulator that computes the pad's motion in its plane, whatever its layers are.
    pub fn with_flow(&self) -> Self {
        self.map_sensors(&|plan| {
            let known = &plan.simulator;
            Self { simulator: Arc::new(known.variant(known.sensor().clone()).with_flow()), ..plan.clone() }
        })
    }

    /// Returns the plan with `times` as many frames per second.
    pub fn with_frame_rate(&self, times: f64) -> Self {
        self.map_job(|job| job.sequence.iter_mut().for_each(|sequence| sequence.frame_rate_hz *= times))
    }

    /// Returns the plan with another job. Nothing is read or prepared again.
    pub(crate) fn map_job(&self, change: impl Fn(&mut Job)) -> Self {
        self.map_sensors(&|plan| {
            let mut job = plan.job.clone();
            change(&mut job);
            Self { job, ..plan.clone() }
        })
    }

    fn with_simulator(&self, models: &Models, policy: EffectPolicy) -> Self {
        self.map_sensors(&|plan| Self { simulator: plan.rebuild_simulator(models.clone(), policy), ..plan.clone() })
    }

    fn rebuild_simulator(&self, models: Models, policy: EffectPolicy) -> Arc<Simulator> {
        Arc::new(create_simulator(self.simulator.sensor().clone(), models, policy, &self.job))
    }

    /// Applies a change to the plan and to its plans with other sensors.
    fn map_sensors(&self, change: &impl Fn(&Self) -> Self) -> Self {
        let others = self.other_sensors.iter().map(|other| other.map_sensors(change)).collect();
        let right = self.right_finger.as_ref().map(|right| Box::new(right.map_sensors(change)));
        let further = self.further_sensors.iter().map(|further| further.map_sensors(change)).collect();
        let calibration = self.calibration.as_ref().map(|presses| Box::new(presses.map_sensors(change)));
        Self { other_sensors: others, right_finger: right, further_sensors: further, calibration, ..change(self) }
    }
}
