//! Plans that differ from another one in their models, effects, fidelity or frame rate.

use std::sync::Arc;

use gelsim_core::effects::EffectPolicy;
use gelsim_core::fidelity::{Fidelity, Models};
use gelsim_core::simulator::Simulator;

use super::{Plan, fingerprint, simulator};

impl Plan {
    /// The same with other models under the same level's name, for comparisons.
    pub fn with_models(&self, models: Models) -> Self {
        self.with_simulator(models, self.simulator.policy())
    }

    /// The same with other effects, for comparisons.
    pub fn with_policy(&self, policy: EffectPolicy) -> Self {
        self.with_simulator(self.simulator.models().clone(), policy)
    }

    /// The same with the models of a fidelity level, whatever gelpad the job chose; a light that the job names stays, and so
    /// does its friction.
    pub fn with_fidelity(&self, fidelity: Fidelity) -> Self {
        let mut models = fidelity.models(self.simulator.sensor().light_source());
        models.gelpad = models.gelpad.with_friction(self.simulator.models().gelpad.friction());
        if self.optics_named {
            let mut own = self.simulator.models().optics.clone();
            if let (Some(own), Some(of_level), false) = (own.phong_mut(), models.optics.phong(), self.shadows_named) {
                own.shadows = of_level.shadows;
            }
            models.optics = own;
        }
        let mut job = self.job.clone();
        job.fidelity = Some(fidelity.into());
        job.gelpad = Some(models.gelpad.clone());
        job.optics = Some(models.optics.clone());
        let others = self.others.iter().map(|other| other.with_fidelity(fidelity)).collect();
        let right = self.right.as_ref().map(|right| Box::new(right.with_fidelity(fidelity)));
        Self { fingerprint: fingerprint(&job), job, others, right, ..self.with_models(models) }
    }

    /// The same, with the pad's motion in its plane known, whatever its layers are.
    pub fn with_flow(&self) -> Self {
        let flowing = |plan: &Self| {
            let models = plan.simulator.models().clone();
            let sensor = plan.simulator.sensor().clone();
            Arc::new(Simulator::with_models(sensor, models, plan.simulator.policy()).with_flow())
        };
        let others = self.others.iter().map(Self::with_flow).collect();
        let right = self.right.as_ref().map(|right| Box::new(right.with_flow()));
        Self { simulator: flowing(self), others, right, ..self.clone() }
    }

    /// The same with `times` as many frames in each second of a sequence.
    pub fn with_frame_rate(&self, times: f64) -> Self {
        let mut plan = self.clone();
        if let Some(sequence) = &mut plan.job.sequence {
            sequence.frame_rate_hz *= times;
        }
        plan.others = self.others.iter().map(|other| other.with_frame_rate(times)).collect();
        plan
    }

    fn with_simulator(&self, models: Models, policy: EffectPolicy) -> Self {
        let simulator = simulator(self.simulator.sensor().clone(), models.clone(), policy, &self.job);
        let others = self.others.iter().map(|other| other.with_simulator(models.clone(), policy)).collect();
        let right = self.right.as_ref().map(|right| Box::new(right.with_simulator(models.clone(), policy)));
        Self { simulator: Arc::new(simulator), others, right, ..self.clone() }
    }
}
