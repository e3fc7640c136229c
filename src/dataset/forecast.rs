//! Forecasts what a run would do and take: renders and encodes some of the job's samples, on as many threads as the run
//! would use, and throws them away.
//!
//! Samples from all over the job are probed until their mean time is known well enough; time and bytes of the run are
//! in proportion. CPU time is measured while all threads are busy, so that it includes what they take from each other.

use crate::container::ShardContainer;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::time::Instant;

use rayon::prelude::*;
use sha2::{Digest, Sha256};

use crate::encode::{EncodedSample, make_sample_for_display};
use crate::stats::LightRange;
use gelsim_core::base::clock::Seconds;
use gelsim_core::base::clock::ThreadClock;
use gelsim_core::effects::{Effect, PerEffect};
use gelsim_job::config::output::OnUnhealthy;
use gelsim_job::plan::Plan;
use gelsim_job::probe::{ContactCounts, spread_index};

/// Number of samples that are probed at least, if the job has them and time allows.
const MIN_PROBES: u64 = 32;

/// Relative standard error of the mean time at which probing ends.
const ACCURACY: f64 = 0.04;

/// Wall time after which no more samples are probed, s.
const MAX_PROBE_S: f64 = 1.0;

/// The results of the probe, and the forecast of the run.
pub struct Forecast {
    /// Samples that were rendered.
    pub probed: u64,
    /// Rendered samples that are not healthy.
    pub unhealthy: u64,
    /// Rendered samples that show contact.
    pub in_contact: u64,
    /// Contact among the rendered samples that are meant to have it.
    pub contacts: ContactCounts,
    /// How much of their contacts lies outside the calibrated range of the optics.
    pub light: LightRange,
    /// Each effect in the rendered samples.
    pub effects: PerEffect<EffectForecast>,
    /// CPU seconds of a sample per stage, mean.
    pub seconds: Seconds,
    /// CPU seconds of a sample for hashing and writing its files, mean.
    pub write_s: f64,
    /// Wall time of the run, s.
    pub wall_s: f64,
    /// Bytes of the run's shards.
    pub bytes: f64,
    /// Samples of the run.
    pub samples: u64,
    /// Shards of the run.
    pub shards: u64,
    /// Threads of the run.
    pub threads: usize,
}

/// An effect in the rendered samples.
#[derive(Clone, Debug, Default)]
pub struct EffectForecast {
    /// Samples in which it ran.
    pub ran: u64,
    /// The reasons why it ran (true) or did not (false), with the number of samples.
    pub reasons: BTreeMap<(bool, String), u64>,
    /// CPU seconds of a sample, mean.
    pub seconds: f64,
}

/// A probed sample: its first draw.
pub struct ProbedSample {
    index: u64,
    /// Whether it may go into a dataset.
    pub healthy: bool,
    /// Whether it shows contact.
    pub in_contact: bool,
    light: LightRange,
    notes: PerEffect<gelsim_core::effects::EffectNote>,
    effects: PerEffect<f64>,
    seconds: Seconds,
    write_s: f64,
    bytes: u64,
}

impl ProbedSample {
    fn new(plan: &Plan, index: u64) -> Self {
        let EncodedSample { label: known, members, seconds, effects, .. } = make_sample_for_display(plan, index);
        let mut clock = ThreadClock::start();
        let mut hash = Sha256::new();
        let mut label = Cow::default();
        for member in &members {
            let bytes = member.bytes.read().expect("nothing of it is spooled");
            hash.update(&bytes);
            // The label comes last, so this is the label after the loop.
            label = bytes;
        }
        std::hint::black_box(hash.finalize());
        Self {
            index,
            healthy: known.health.healthy,
            in_contact: known.contact.in_contact,
            light: LightRange::from_label(&known),
            notes: known.effects,
            effects,
            seconds,
            write_s: clock.lap(),
            bytes: plan.output().container.sample_bytes(&plan.layout.shard_of(index), index, &label, &members),
        }
    }

    /// Returns the CPU seconds of all that is done for the sample.
    fn total_s(&self) -> f64 {
        self.seconds.simulation() + self.seconds.encode + self.write_s
    }
}

/// Renders the first draw of a sample, whether or not it may go into a dataset.
pub fn probe_first_draw(plan: &Plan, index: u64) -> ProbedSample {
    ProbedSample::new(&plan.keeping_unhealthy(), index)
}

/// Forecasts a run over `samples` samples in `shards` shards on `threads` threads.
pub fn forecast(
    plan: &Plan,
    samples: u64,
    shards: u64,
    threads: usize,
) -> Result<Forecast, rayon::ThreadPoolBuildError> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
    // Rejected samples are not drawn again here, since that could take any time. Their share is counted below instead.
    let (rejects, kept) = (plan.output().on_unhealthy == OnUnhealthy::Reject, plan.keeping_unhealthy());
    let all = plan.layout.sample_count();
    let order = |k: u64| spread_index(k, all);
    let start = Instant::now();
    let mut probes: Vec<ProbedSample> = Vec::new();
    pool.install(|| {
        // The first samples find cold caches and memory, so they count only if there is no time for more.
        let cold: Vec<ProbedSample> =
            (0..threads.min(all as usize) as u64).into_par_iter().map(|k| ProbedSample::new(&kept, order(k))).collect();
        if start.elapsed().as_secs_f64() > MAX_PROBE_S {
            probes = cold;
            return;
        }
        loop {
            let from = probes.len() as u64;
            let until = (from + threads as u64).min(all);
            let block: Vec<ProbedSample> =
                (from..until).into_par_iter().map(|k| ProbedSample::new(&kept, order(k))).collect();
            probes.extend(block);
            let seconds: Vec<f64> = probes.iter().map(ProbedSample::total_s).collect();
            let known = until >= MIN_PROBES && relative_error(&seconds) < ACCURACY;
            if until == all || known || start.elapsed().as_secs_f64() > MAX_PROBE_S {
                break;
            }
        }
    });
    let count = probes.len() as f64;
    let mean = |of: &dyn Fn(&ProbedSample) -> f64| probes.iter().map(of).sum::<f64>() / count;
    let mut seconds = Seconds::default();
    probes.iter().for_each(|probe| seconds.add(&probe.seconds));
    let mut light = LightRange::default();
    probes.iter().for_each(|probe| light.add(&probe.light));
    let mut effects = PerEffect::<EffectForecast>::default();
    for effect in Effect::ALL {
        let probed = &mut effects[effect];
        probed.seconds = mean(&|probe| probe.effects[effect]);
        for probe in &probes {
            let note = &probe.notes[effect];
            probed.ran += u64::from(note.ran);
            *probed.reasons.entry((note.ran, note.reason.clone().into_owned())).or_default() += 1;
        }
    }
    let (write_s, bytes) = (mean(&|probe| probe.write_s), mean(&|probe| probe.bytes as f64));
    // The samples of a shard are rendered by all threads but written by one, which renders while it waits.
    let busy = |count: u64| threads.min(count.max(1) as usize) as f64;
    let healthy = probes.iter().filter(|probe| probe.healthy).count();
    // Draws per accepted sample. If every sample of the probe was rejected, take one of them as accepted.
    let draws = if rejects { count / healthy.max(1) as f64 } else { 1.0 };
    let render_s = draws * (seconds.simulation() + seconds.encode) / count;
    let wall_s = samples as f64 * ((render_s + write_s) / busy(samples)).max(write_s / busy(shards));
    Ok(Forecast {
        probed: probes.len() as u64,
        unhealthy: (probes.len() - healthy) as u64,
        in_contact: probes.iter().filter(|probe| probe.in_contact).count() as u64,
        contacts: ContactCounts::from_rendered(plan, probes.iter().map(|probe| (probe.index, probe.in_contact))),
        light,
        effects,
        seconds: seconds.scaled(1.0 / count),
        write_s,
        wall_s,
        bytes: samples as f64 * bytes + shards as f64 * plan.output().container.empty_bytes() as f64,
        samples,
        shards,
        threads,
    })
}

/// Returns the standard error of the mean divided by the mean.
fn relative_error(values: &[f64]) -> f64 {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let variance = values.iter().map(|value| (value - mean) * (value - mean)).sum::<f64>() / (count - 1.0).max(1.0);
    if mean > 0.0 { (variance / count).sqrt() / mean } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_error_of_a_mean_falls_with_the_root_of_the_count() {
        let values = |count: usize| (0..count).map(|k| 1.0 + (k % 2) as f64).collect::<Vec<f64>>();
        let (few, many) = (relative_error(&values(100)), relative_error(&values(10_000)));
        assert!((few / many - 10.0).abs() < 0.1, "{few} {many}");
        assert!((many - 0.5 / 1.5 / 100.0).abs() < 1e-5);
        assert_eq!(relative_error(&[2.0]), 0.0);
    }
}
