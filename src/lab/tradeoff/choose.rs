//! Chooses the fidelity level for a job that names a bound instead: by rendering some of its own samples at every level.

use std::fmt;

use crate::core::fidelity::Fidelity;
use crate::core::optics::LightSource;
use crate::files::diagnostic::Report;
use crate::files::diagnostic::user_error;
use crate::job::config::fidelity::FidelityChoice;
use crate::job::layers::OutputLayer;
use crate::job::plan::Plan;
use crate::job::sample::render;
use crate::lab::metrics::statistics::median;
use crate::lab::metrics::surface::height_error_um;

/// Samples that are rendered at every level.
const PROBES: u64 = 8;

/// A fidelity level and what was measured of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChosenLevel {
    /// The fidelity level.
    pub level: Fidelity,
    /// Its surface's distance from the reference's, um: root mean square over the view, the worst of the samples.
    pub error_um: f64,
    /// CPU time of a sample, ms: the median.
    pub ms: f64,
}

impl fmt::Display for ChosenLevel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { level, error_um, ms } = self;
        write!(f, "fidelity {} chosen: {error_um:.2} um from the reference, {ms:.1} ms a sample", level.name())
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

/// The fidelity level that the plan's job asks for by a bound; refused where no fidelity level keeps it.
pub fn choose(plan: &Plan, bound: FidelityChoice) -> Result<ChosenLevel, Report> {
    let indices = spread(plan.layout.samples(), PROBES);
    let fits = |level: &Fidelity| {
        !plan.layers().contains(&OutputLayer::Pressure) || level.models(LightSource::Leds).gelpad.knows_pressure()
    };
    let levels: Vec<Fidelity> = Fidelity::ALL.into_iter().filter(fits).collect();
    let reference = plan.with_fidelity(Fidelity::Reference);
    let exact: Vec<_> = indices.iter().map(|index| render(&reference, *index).impression.contact.surface).collect();
    let mut measured = Vec::new();
    for level in levels {
        let plan = plan.with_fidelity(level);
        let (mut error_um, mut ms) = (0.0_f64, Vec::new());
        for (index, exact) in indices.iter().zip(&exact) {
            // The first run of a sample warms caches and buffers.
            let sample = render(&plan, *index);
            ms.push(1e3 * render(&plan, *index).seconds.simulation());
            error_um = error_um.max(height_error_um(&sample.impression.contact.surface, exact).0);
        }
        let found = ChosenLevel { level, error_um, ms: median(&ms).unwrap_or(0.0) };
        if matches!(bound, FidelityChoice::MaxErrorUm(um) if error_um <= um) {
            return Ok(found);
        }
        measured.push(found);
    }
    match bound {
        FidelityChoice::MaxMs(ms) => measured.iter().rev().find(|found| found.ms <= ms).copied(),
        _ => None,
    }
    .ok_or_else(|| refusal(bound, &measured))
}

fn refusal(bound: FidelityChoice, measured: &[ChosenLevel]) -> Report {
    let levels: Vec<String> = measured
        .iter()
        .map(|found| format!("{} {:.1} ms, {:.2} um", found.level.name(), found.ms, found.error_um))
        .collect();
    let what = match bound {
        FidelityChoice::MaxMs(ms) => format!("no fidelity level renders a sample of this job in {ms} ms"),
        _ => String::from("no fidelity level is exact enough for this job"),
    };
    user_error(what, format!("measured: {}", levels.join("; ")))
}
