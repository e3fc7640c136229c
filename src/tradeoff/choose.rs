//! Chooses the rung for a job that names a bound instead: by rendering some of its own samples at every rung.

use std::fmt;

use crate::config::diagnostic::Report;
use crate::fidelity::{Fidelity, Rung};
use crate::metrics::statistics::median;
use crate::metrics::surface::height_error_um;
use crate::plan::{Plan, usage};
use crate::render::render;

/// Samples that are rendered at every rung.
const PROBES: u64 = 8;

/// A rung and what was measured of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chosen {
    /// The rung.
    pub rung: Rung,
    /// Its surface's distance from the reference's, um: root mean square over the view, the worst of the samples.
    pub error_um: f64,
    /// CPU time of a sample, ms: the median.
    pub ms: f64,
}

impl fmt::Display for Chosen {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { rung, error_um, ms } = self;
        write!(f, "fidelity {} chosen: {error_um:.2} um from the reference, {ms:.1} ms a sample", rung.name())
    }
}

/// `count` sample numbers spread over `samples`: one in each of `count` parts, by the golden ratio, so that objects
/// that come in turn are not hit in step.
pub fn spread(samples: u64, count: u64) -> Vec<u64> {
    let count = count.clamp(1, samples.max(1));
    let start = |k: u64| (u128::from(k) * u128::from(samples) / u128::from(count)) as u64;
    let within = |k: u64| (k as f64 * 0.618_033_988_749_894_9).fract();
    (0..count).map(|k| start(k) + ((start(k + 1) - start(k)) as f64 * within(k)) as u64).collect()
}

/// The rung that the plan's job asks for by a bound; refused where no rung keeps it.
pub fn choose(plan: &Plan, bound: Fidelity) -> Result<Chosen, Report> {
    let indices = spread(plan.layout.samples(), PROBES);
    let fits = |rung: &Rung| plan.layers.iter().all(|layer| rung.choices(false).gelpad.gives(*layer));
    let rungs: Vec<Rung> = Rung::ALL.into_iter().filter(fits).collect();
    let reference = plan.at(Rung::Reference);
    let exact: Vec<_> = indices.iter().map(|index| render(&reference, *index).contact.surface).collect();
    let mut measured = Vec::new();
    for rung in rungs {
        let plan = plan.at(rung);
        let (mut error_um, mut ms) = (0.0_f64, Vec::new());
        for (index, exact) in indices.iter().zip(&exact) {
            // The first run of a sample warms caches and buffers.
            let sample = render(&plan, *index);
            ms.push(1e3 * render(&plan, *index).seconds.simulation());
            error_um = error_um.max(height_error_um(&sample.contact.surface, exact).0);
        }
        let found = Chosen { rung, error_um, ms: median(&ms).unwrap_or(0.0) };
        if matches!(bound, Fidelity::MaxErrorUm(um) if error_um <= um) {
            return Ok(found);
        }
        measured.push(found);
    }
    match bound {
        Fidelity::MaxMs(ms) => measured.iter().rev().find(|found| found.ms <= ms).copied(),
        _ => None,
    }
    .ok_or_else(|| refusal(bound, &measured))
}

fn refusal(bound: Fidelity, measured: &[Chosen]) -> Report {
    let rungs: Vec<String> = measured
        .iter()
        .map(|found| format!("{} {:.1} ms, {:.2} um", found.rung.name(), found.ms, found.error_um))
        .collect();
    let what = match bound {
        Fidelity::MaxMs(ms) => format!("no rung renders a sample of this job in {ms} ms"),
        _ => String::from("no rung is exact enough for this job"),
    };
    usage(what, format!("measured: {}", rungs.join("; ")))
}
