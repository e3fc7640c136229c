//! Plans that differ from another one in their models, effects, fidelity or frame rate.

use std::sync::Arc;

use crate::config::Job;
use gelsim_core::effects::EffectPolicy;
use gelsim_core::fidelity::{Fidelity, Models};
use gelsim_core::simulator::Simulator;

use super::{Plan, fingerprint, simulator};

impl Plan {
    /// The same with other models under the same level's name, for comparisons.
    pub fn with_models(&self, models: Models) -> Self {
        self.with_simulator(&models, self.simulator.policy())
    }

    /// The same with other effects, for comparisons.
    pub fn with_policy(&self, policy: EffectPolicy) -> Self {
        self.with_simulator(self.simulator.models(), policy)
    }

    /// The same with the models of a fidelity level, whatever gelpad the job chose; a light that the job names stays, and so
    /// does its friction.
    pub fn with_fidelity(&self, fidelity: Fidelity) -> Self {
        self.for_each_sensor(&|plan| {
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
            let simulator = plan.simulator_with(models, plan.simulator.policy());
            Self { fingerprint: fingerprint(&job), job, simulator, ..plan.clone() }
        })
    }

    /// The same, with the pad's motion in its plane known, whatever its layers are.
    pub fn with_flow(&self) -> Self {
        self.for_each_sensor(&|plan| {
            let known = &plan.simulator;
            Self { simulator: Arc::new(known.variant(known.sensor().clone()).with_flow()), ..plan.clone() }
        })
    }

    /// The same with `times` as many frames in each second of a sequence.
    pub fn with_frame_rate(&self, times: f64) -> Self {
        self.with_job(|job| job.sequence.iter_mut().for_each(|sequence| sequence.frame_rate_hz *= times))
    }

    /// The same with another job, of which nothing is read or made ready again.
    pub(crate) fn with_job(&self, change: impl Fn(&mut Job)) -> Self {
        self.for_each_sensor(&|plan| {
            let mut job = plan.job.clone();
            change(&mut job);
            Self { job, ..plan.clone() }
        })
    }

    fn with_simulator(&self, models: &Models, policy: EffectPolicy) -> Self {
        self.for_each_sensor(&|plan| Self { simulator: plan.simulator_with(models.clone(), policy), ..plan.clone() })
    }

    fn simulator_with(&self, models: Models, policy: EffectPolicy) -> Arc<Simulator> {
        Arc::new(simulator(self.simulator.sensor().clone(), models, policy, &self.job))
    }

    /// Itself and its plans with other sensors, each changed.
    fn for_each_sensor(&self, change: &impl Fn(&Self) -> Self) -> Self {
        let others = self.others.iter().map(|other| other.for_each_sensor(change)).collect();
        let right = self.right.as_ref().map(|right| Box::new(right.for_each_sensor(change)));
        Self { others, right, ..change(self) }
    }
}
