//! Checks whether presses can tell what is fitted to them, and whether the fit is one.

use super::contact_curve::ForceIndenter;
use super::fit::ElasticFit;
use super::friction::{FoundFriction, FrictionFit};
use super::motion::{Motion, Motions};
use crate::calibrate::judge::Findings;
use crate::metrics::statistics::median;
use gelsim_files::diagnostic::Diagnostic;
use gelsim_files::number_format::{format_number, format_percent};

/// Fewest presses for a modulus with an error.
pub const LEAST_PRESSES: usize = 3;
/// Ratio of the deepest to the shallowest row below which depths count as one.
const LEAST_SPREAD: f64 = 1.3;
/// Plausible moduli, kPa.
const MODULI_KPA: [f64; 2] = [1.0, 1e4];
/// Depth over thickness from which on linear theory has an error worth a warning, and from which on it does not hold.
const DEPTHS: [f64; 2] = [0.25, 0.5];
/// Share of the force that a fit may leave, and from which on it gets a warning.
const REMAINING: [f64; 2] = [0.25, 0.5];
/// Relative difference of a measured contact radius and that of the depth from which on they contradict each other.
const RADIUS_OFF: f64 = 0.3;
/// Spreads from the median at which a press is an outlier, and the least relative difference.
const OUTLIER_SPREADS: f64 = 4.0;
const OUTLIER_LEAST: f64 = 0.2;
/// Largest coefficient of friction.
const MOST_FRICTION: f64 = 5.0;
/// Force at the deepest row over the largest before it below which force falls with depth.
const FALLS_BELOW: f64 = 0.7;
/// Share of a relaxed force from which on hardly any is left.
const MOST_RELAXED: f64 = 0.98;

/// Finds what speaks against the presses before anything is fitted.
pub fn judge_presses(motions: &Motions, fits_zero: bool) -> Findings {
    let mut findings = Findings::default();
    let all = &motions.motions;
    if all.len() < LEAST_PRESSES {
        let message = format!("{} of the {LEAST_PRESSES} presses that are needed", all.len());
        let help = "measure more presses: the error of the modulus is how much presses differ; ten are good";
        findings.extend([Diagnostic::new(message).help(help)]);
    }
    let is_pressed = |motion: &&Motion| motion.deepest_mm(0.0) > 0.0 && motion.largest_force_n() > 0.0;
    if !all.iter().any(|motion| is_pressed(&motion)) {
        let help = "check `force_n` and `depth_mm`: both must be above 0 while the indenter is pressed in";
        findings.extend([Diagnostic::new("nothing is pressed: all depths or all forces are 0").help(help)]);
        return findings;
    }
    let depths = all.iter().flat_map(|motion| &motion.moments).map(|moment| moment.depth_mm).filter(|mm| *mm > 0.0);
    let [least, most] = depths.fold([f64::INFINITY, 0.0], |[least, most], mm| [mm.min(least), mm.max(most)]);
    if most < LEAST_SPREAD * least {
        let message = format!("all depths are from {} to {} mm", format_number(least), format_number(most));
        let help = "press to different depths, the deepest at least twice as deep as the shallowest";
        findings.extend([match fits_zero {
            true => Diagnostic::new(format!("{message}: --fit-zero cannot tell a wrong zero from a harder pad")),
            false => Diagnostic::warning(format!("{message}: a wrong zero of the depth would not be noticed")),
        }
        .help(help)]);
    }
    if fits_zero && motions.deepest_measured_mm() <= 0.0 {
        let help = "leave --fit-zero out: depths that follow from contact radii have no zero";
        findings.extend([Diagnostic::new("--fit-zero needs `depth_mm`, and no row has it").help(help)]);
    }
    findings.extend(all.iter().filter(|motion| motion.too_wide > 0).map(|motion| {
        let message = format!("press `{}` has a contact larger than any in this pad", motion.name);
        let help = "check the radius, which is not a diameter, `ball_radius_mm`, and gelpad_thickness_mm in --sensor";
        Diagnostic::new(message)
            .about(format!("`{}`", motion.name), "presses have contacts larger than any in this pad")
            .help(help)
    }));
    // Without a zero the depths are not known yet.
    if !fits_zero {
        findings.extend(judge_depths(motions, 0.0));
    }
    findings.extend(judge_radii(motions, fits_zero));
    let falling = all.iter().filter(|motion| falls(motion));
    findings.extend(falling.map(|motion| {
        let message = format!("the force of press `{}` falls while it goes deeper", motion.name);
        let help = "check `depth_mm`, which grows into the pad, and that the rows belong to one press";
        Diagnostic::warning(message)
            .about(format!("`{}`", motion.name), "presses have forces that fall with depth")
            .help(help)
    }));
    if let Some(slope) = slope_of_forces(motions).filter(|slope| *slope < 0.0) {
        let message =
            format!("deeper presses have smaller forces: the force goes with the power {slope:.1} of the depth");
        let help = "check that `depth_mm` grows into the pad, and the columns' order";
        findings.extend([Diagnostic::new(message).help(help)]);
    }
    findings
}

/// Judges how deep the presses are in the pad.
pub fn judge_depths(motions: &Motions, zero_mm: f64) -> Vec<Diagnostic> {
    let thickness_mm = motions.material.thickness_mm;
    let [warned, most] = DEPTHS;
    let found = motions.motions.iter().filter_map(|motion| {
        let share = motion.deepest_mm(zero_mm) / thickness_mm;
        let name = format!("`{}`", motion.name);
        let message =
            format!("press {name} is {share:.2} of the pad's thickness of {} mm deep", format_number(thickness_mm));
        match () {
            () if share > most => Some(
                Diagnostic::new(format!("{message}, where linear theory does not hold"))
                    .about(name, "presses are deeper than half of the pad's thickness")
                    .help("leave deeper rows out, or correct gelpad_thickness_mm: --thickness-mm"),
            ),
            () if share > warned => Some(
                Diagnostic::warning(format!("{message}, where linear theory is some 10 % off"))
                    .about(name, "presses are deeper than a quarter of the pad's thickness")
                    .help("press less deep, or correct gelpad_thickness_mm: --thickness-mm"),
            ),
            () => None,
        }
    });
    found.collect()
}

/// Compares contact radii with the depths beside them.
fn judge_radii(motions: &Motions, fits_zero: bool) -> Vec<Diagnostic> {
    let off = motions.motions.iter().filter_map(|motion| {
        if !matches!(motion.curve.indenter(), ForceIndenter::Ball { .. }) {
            return None;
        }
        let ratios: Vec<f64> = motion
            .moments
            .iter()
            .filter(|moment| moment.is_measured && moment.depth_mm > 0.0)
            .filter_map(|moment| Some(moment.contact_radius_mm? / motion.curve.contact_radius_mm(moment.depth_mm)))
            .collect();
        let ratio = median(&ratios)?;
        ((ratio - 1.0).abs() > RADIUS_OFF).then_some((motion, ratio))
    });
    let off: Vec<(&Motion, f64)> = off.collect();
    let is_most = 2 * off.len() >= motions.motions.len() && !fits_zero;
    off.iter()
        .map(|(motion, ratio)| {
            let name = format!("`{}`", motion.name);
            let message = format!("the contact of press {name} is {ratio:.2} times as wide as its depth makes it");
            let help = "check the radius, `ball_radius_mm` and gelpad_thickness_mm; if the zero of the depth is not \
                        known, add --fit-zero";
            let found = if is_most { Diagnostic::new(message) } else { Diagnostic::warning(message) };
            found.about(name, "presses have contact radii that contradict their depths").help(help)
        })
        .collect()
}

/// Returns true if the force at the deepest row is clearly smaller than before it.
fn falls(motion: &Motion) -> bool {
    let Some(deepest) = motion.moments.iter().position(|moment| moment.depth_mm >= motion.deepest_mm(0.0)) else {
        return false;
    };
    let before = &motion.moments[..deepest];
    let largest = before.iter().filter(|moment| moment.depth_mm < 0.9 * motion.moments[deepest].depth_mm);
    let largest = largest.map(|moment| moment.force_n).fold(0.0, f64::max);
    motion.moments[deepest].force_n < FALLS_BELOW * largest
}

/// Returns the slope of the logarithm of the largest force over that of the depth, over presses of one indenter; `None`
/// if it is not known.
fn slope_of_forces(motions: &Motions) -> Option<f64> {
    let log = |motion: &Motion| {
        // Forces relative to those of the layer, so that different indenters count alike.
        let (deep, force) = (motion.curve.force(motion.deepest_mm(0.0)), motion.largest_force_n());
        (deep > 0.0 && force > 0.0).then(|| [libm::log(deep), libm::log(force)])
    };
    let logs: Vec<[f64; 2]> = motions.motions.iter().filter_map(log).collect();
    let count = logs.len() as f64;
    if logs.len() < LEAST_PRESSES {
        return None;
    }
    let mean = [0, 1].map(|k| logs.iter().map(|log| log[k]).sum::<f64>() / count);
    let sum = |j: usize, k: usize| logs.iter().map(|log| (log[j] - mean[j]) * (log[k] - mean[k])).sum::<f64>();
    let spread = (sum(0, 0) / count).sqrt();
    // Presses of one depth have no slope. A weak correlation is noise.
    let correlation = sum(0, 1) / (sum(0, 0) * sum(1, 1)).sqrt();
    (spread > libm::log(LEAST_SPREAD) && correlation.abs() > 0.5).then(|| sum(0, 1) / sum(0, 0))
}

/// Finds what speaks against the fit.
pub fn judge_fit(motions: &Motions, fit: &ElasticFit) -> Findings {
    let mut findings = Findings::default();
    if fit.names.iter().any(|name| name == "zero_mm") {
        findings.extend(judge_depths(motions, fit.solution.zero_mm));
    }
    let modulus = fit.solution.youngs_modulus_kpa;
    let [least, most] = MODULI_KPA;
    if !(least..=most).contains(&modulus) {
        let message =
            format!("Young's modulus would be {} kPa, and gelpads have {least} to {most} kPa", format_number(modulus));
        let help = "check the units of forces, depths and radii, and gelpad_thickness_mm";
        findings.extend([Diagnostic::new(message).help(help)]);
    }
    let [_, share] = fit.remaining();
    let [warned, useless] = REMAINING;
    let message = format!("the fit leaves {} of the force", format_percent(share));
    if share.is_nan() || share > useless {
        let help =
            "check units, indenters and gelpad_thickness_mm; if the zero of the depth is not known, add --fit-zero";
        findings.extend([Diagnostic::new(message).help(help)]);
    } else if share > warned {
        let help =
            "see the presses in the page beside the sensor file; if the zero of the depth is not known, add --fit-zero";
        findings.extend([Diagnostic::warning(message).help(help)]);
    }
    let relaxed: f64 = fit.solution.relaxation.iter().map(|mode| mode.share).sum();
    if relaxed > MOST_RELAXED {
        let message = format!("{} of the force would relax", format_percent(relaxed));
        let help = "check `time_s`, and that presses are held at a constant depth";
        findings.extend([Diagnostic::warning(message).help(help)]);
    }
    for (k, mode) in fit.solution.relaxation.iter().enumerate() {
        let error = fit.standard_error_of(&format!("gelpad_relaxation.{k}.time_s"));
        if error.is_some_and(|error| error > 0.5 * mode.time_s) {
            let message = format!(
                "the time of relaxation of {} s is known no better than within a half",
                format_number(mode.time_s)
            );
            let help = "hold presses several times as long, and take more rows in the beginning";
            findings.extend([Diagnostic::warning(message).help(help)]);
        }
    }
    if let Some(error) = fit.standard_error(0).filter(|error| *error > 0.2 * modulus) {
        let message =
            format!("presses differ so much that the modulus is known within {} only", format_percent(error / modulus));
        let help = "see the factors of the presses in the page beside the sensor file, and measure more presses";
        findings.extend([Diagnostic::warning(message).help(help)]);
    }
    findings.extend(find_outliers(fit).into_iter().map(|(name, factor)| {
        let message = format!("press `{name}` has {} times the force that the others tell", format_number(factor));
        let help = "check its indenter, depth and force; --drop-bad leaves it out";
        Diagnostic::warning(message)
            .about(format!("`{name}` ({})", format_number(factor)), "presses have other forces than the others tell")
            .help(help)
    }));
    findings
}

/// Returns the names of presses whose forces are not those that the others tell, and by which factor.
pub fn find_outliers(fit: &ElasticFit) -> Vec<(String, f64)> {
    let log = |factor: f64| libm::log(factor.max(1e-6));
    let logs: Vec<f64> = fit.presses.iter().map(|press| log(press.factor)).collect();
    let Some(middle) = median(&logs).filter(|_| logs.len() > LEAST_PRESSES) else { return Vec::new() };
    let away: Vec<f64> = logs.iter().map(|log| (log - middle).abs()).collect();
    // The median of distances is 0.6745 standard deviations of a normal distribution.
    let most = (OUTLIER_SPREADS * median(&away).unwrap_or_default() / 0.6745).max(OUTLIER_LEAST);
    let found = fit.presses.iter().zip(away).filter(|(_, away)| *away > most);
    found.map(|(press, _)| (press.name.clone(), press.factor)).collect()
}

/// Finds what speaks against a coefficient of friction. An error means that it is not to be written.
pub fn judge_friction(friction: &FrictionFit) -> Findings {
    let mut findings = Findings::default();
    match friction {
        FrictionFit::NoForces => {}
        FrictionFit::AtLeast { coefficient, why } => {
            let message =
                format!("the coefficient of friction is at least {}, and is not written", format_number(*coefficient));
            findings.extend([Diagnostic::warning(message).help(*why)]);
        }
        FrictionFit::Found(found) => findings.extend(judge_found_friction(found)),
    }
    findings
}

fn judge_found_friction(found: &FoundFriction) -> Vec<Diagnostic> {
    let mut findings = Vec::new();
    let coefficient = format_number(found.coefficient);
    if found.coefficient > MOST_FRICTION {
        let message = format!("the coefficient of friction would be {coefficient}");
        let help = "check the units of `shear_force_n` and `force_n`; gelpads have up to 2";
        findings.push(Diagnostic::new(message).help(help));
    }
    let [_, share] = found.remaining();
    let [warned, useless] = REMAINING;
    let message = format!("the coefficient of friction leaves {} of the tangential force", format_percent(share));
    let help = "check that `shear_mm` is 0 where the sliding begins, and that the rig gives way little";
    if share.is_nan() || share > useless {
        findings.push(Diagnostic::new(message).help(help));
    } else if share > warned {
        findings.push(Diagnostic::warning(message).help(help));
    }
    if found.standard_error.is_none() {
        let message = format!("the coefficient of friction of {coefficient} is that of one slide, and has no error");
        findings.push(Diagnostic::warning(message).help("measure three slides or more"));
    }
    if !found.has_displacements {
        let message = format!("the coefficient of friction of {coefficient} holds only if the indenter slid");
        let help = "without `shear_mm` a contact that sticks and is held looks the same: add the column";
        findings.push(Diagnostic::warning(message).help(help));
    }
    findings
}
