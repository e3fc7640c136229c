//! What a run would do and take: some of the job's samples are rendered and encoded, on as many threads as the run would
//! have, and thrown away.
//!
//! Samples are taken from all over the job until their mean time is known well enough; time and bytes of the whole are
//! in proportion. CPU time is taken while all threads are busy, so that what they take from each other is in it.

use crate::container::ShardContainer;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::time::Instant;

use rayon::prelude::*;
use sha2::{Digest, Sha256};

use crate::encode::{Made, make_shown};
use crate::stats::LightRange;
use gelsim_core::base::clock::Clock;
use gelsim_core::base::clock::Seconds;
use gelsim_core::effects::{Effect, PerEffect};
use gelsim_job::config::output::OnUnhealthy;
use gelsim_job::plan::Plan;
use gelsim_job::probe::{Contacts, spread};

/// Samples that are probed at least, if the job has them and time allows.
const FEWEST: u64 = 32;

/// Relative standard error of the mean time at which probing ends.
const ACCURACY: f64 = 0.04;

/// Wall time after which no more samples are probed, s.
const LONGEST_S: f64 = 1.0;

/// What was found, and what it means for the run.
pub struct Forecast {
    /// Samples that were rendered.
    pub probed: u64,
    /// Those among them that are not healthy.
    pub unhealthy: u64,
    /// Those that show contact.
    pub in_contact: u64,
    /// The same of those that are to.
    pub contacts: Contacts,
    /// How much of their contacts the optics were not calibrated on.
    pub light: LightRange,
    /// Of each effect, in those samples.
    pub effects: PerEffect<Probed>,
    /// CPU seconds of a sample, mean, per stage.
    pub seconds: Seconds,
    /// CPU seconds of a sample for hashing and writing its files, mean.
    pub write_s: f64,
    /// Wall time of the run, s.
    pub wall_s: f64,
    /// Bytes of its shards.
    pub bytes: f64,
    /// Samples of the run.
    pub samples: u64,
    /// Shards of the run.
    pub shards: u64,
    /// Threads of the run.
    pub threads: usize,
}

/// An effect in the probed samples.
#[derive(Clone, Debug, Default)]
pub struct Probed {
    /// Samples in which it ran.
    pub ran: u64,
    /// Why, and why not, with the number of samples.
    pub reasons: BTreeMap<(bool, String), u64>,
    /// CPU seconds of a sample, mean.
    pub seconds: f64,
}

/// One sample of the probe: its first draw.
pub struct Probe {
    index: u64,
    /// It may go into a dataset.
    pub healthy: bool,
    /// It shows contact.
    pub in_contact: bool,
    light: LightRange,
    notes: PerEffect<gelsim_core::effects::Note>,
    effects: PerEffect<f64>,
    seconds: Seconds,
    write_s: f64,
    bytes: u64,
}

impl Probe {
    fn new(plan: &Plan, index: u64) -> Self {
        let Made { label: known, members, seconds, effects, .. } = make_shown(plan, index);
        let mut clock = Clock::start();
        let mut hash = Sha256::new();
        let mut label = Cow::default();
        for member in &members {
            let bytes = member.bytes.read().expect("nothing of it is spooled");
            hash.update(&bytes);
            // Which comes last.
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
            bytes: plan.output().container.bytes_of(&plan.layout.shard_of(index), index, &label, &members),
        }
    }

    /// CPU seconds of it all.
    fn total_s(&self) -> f64 {
        self.seconds.simulation() + self.seconds.encode + self.write_s
    }
}

/// Renders a sample as it is drawn first, whether or not that may go into a dataset.
pub fn first_draw(plan: &Plan, index: u64) -> Probe {
    Probe::new(&plan.keeping_unhealthy(), index)
}

/// Foresees a run over `samples` samples in `shards` shards on `threads` threads.
pub fn forecast(
    plan: &Plan,
    samples: u64,
    shards: u64,
    threads: usize,
) -> Result<Forecast, rayon::ThreadPoolBuildError> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
    // What is rejected is not drawn again: that would take as long as it takes.
    let (rejects, kept) = (plan.output().on_unhealthy == OnUnhealthy::Reject, plan.keeping_unhealthy());
    let all = plan.layout.samples();
    let order = |k: u64| spread(k, all);
    let start = Instant::now();
    let mut probes: Vec<Probe> = Vec::new();
    pool.install(|| {
        // Caches and memory are cold at first.
        let cold: Vec<Probe> =
            (0..threads.min(all as usize) as u64).into_par_iter().map(|k| Probe::new(&kept, order(k))).collect();
        if start.elapsed().as_secs_f64() > LONGEST_S {
            probes = cold;
            return;
        }
        loop {
            let from = probes.len() as u64;
            let until = (from + threads as u64).min(all);
            let block: Vec<Probe> = (from..until).into_par_iter().map(|k| Probe::new(&kept, order(k))).collect();
            probes.extend(block);
            let seconds: Vec<f64> = probes.iter().map(Probe::total_s).collect();
            let known = until >= FEWEST && relative_error(&seconds) < ACCURACY;
            if until == all || known || start.elapsed().as_secs_f64() > LONGEST_S {
                break;
            }
        }
    });
    let count = probes.len() as f64;
    let mean = |of: &dyn Fn(&Probe) -> f64| probes.iter().map(of).sum::<f64>() / count;
    let mut seconds = Seconds::default();
    probes.iter().for_each(|probe| seconds.add(&probe.seconds));
    let mut light = LightRange::default();
    probes.iter().for_each(|probe| light.add(&probe.light));
    let mut effects = PerEffect::<Probed>::default();
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
    // A shard's samples are rendered by all threads, but written by one, which renders while it waits.
    let busy = |count: u64| threads.min(count.max(1) as usize) as f64;
    let healthy = probes.iter().filter(|probe| probe.healthy).count();
    // Draws for a sample that may stay: of those that were tried, none may have been.
    let draws = if rejects { count / healthy.max(1) as f64 } else { 1.0 };
    let render_s = draws * (seconds.simulation() + seconds.encode) / count;
    let wall_s = samples as f64 * ((render_s + write_s) / busy(samples)).max(write_s / busy(shards));
    Ok(Forecast {
        probed: probes.len() as u64,
        unhealthy: (probes.len() - healthy) as u64,
        in_contact: probes.iter().filter(|probe| probe.in_contact).count() as u64,
        contacts: Contacts::of(plan, probes.iter().map(|probe| (probe.index, probe.in_contact))),
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

/// Standard error of the mean over the mean.
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
