//! Fits the coefficient of friction to slides.
//!
//! With the displacement x of the indenter, the tangential force over the normal one is mu (1 - (1 - k x / (1.5
//! mu))^1.5) until the whole contact slides, and mu after it: Mindlin's solution for a ball (1949). Here k is the
//! tangential stiffness of a contact that sticks over the normal force. Both are proportional to the modulus and relax
//! alike, so that k follows from the layer alone. Without displacements only what stays constant counts.

use super::fit::jackknife;
use super::motion::Motions;
use super::simplex::minimise;

/// Largest coefficient that is searched for.
const MOST: f64 = 20.0;
/// Normal force over the largest of its press from which on a row counts.
const LEAST_NORMAL: f64 = 0.1;
/// Rows that must agree for a plateau.
const PLATEAU_ROWS: usize = 3;
/// Relative difference within a plateau.
const PLATEAU_WITHIN: f64 = 0.1;
/// Relative difference of plateaus.
const PLATEAUS_WITHIN: f64 = 0.25;

/// What slides tell of friction.
#[derive(Clone, Debug, PartialEq)]
pub enum FrictionFit {
    /// The table has no tangential forces.
    NoForces,
    /// Nothing slides for certain.
    AtLeast {
        /// The largest ratio of tangential to normal force.
        coefficient: f64,
        /// Why it is not the coefficient.
        why: &'static str,
    },
    /// The coefficient.
    Found(FoundFriction),
}

/// A coefficient of friction with its uncertainty.
#[derive(Clone, Debug, PartialEq)]
pub struct FoundFriction {
    /// The coefficient.
    pub coefficient: f64,
    /// Its standard error by a jackknife over slides; `None` for a single one.
    pub standard_error: Option<f64>,
    /// True if the displacement was measured.
    pub has_displacements: bool,
    /// The slides that it is of, in the order of the table.
    pub slides: Vec<SlideResult>,
}

impl FoundFriction {
    /// Root of the mean square of what the fit leaves of the tangential forces, N, and over that of the forces.
    pub fn remaining(&self) -> [f64; 2] {
        super::fit::rms_and_share(self.slides.iter().flat_map(|slide| slide.measured_n.iter().zip(&slide.fitted_n)))
    }
}

/// A slide against its fit.
#[derive(Clone, Debug, PartialEq)]
pub struct SlideResult {
    /// Name of the press in the table.
    pub name: String,
    /// The coefficient by this slide alone; `None` if it does not tell.
    pub coefficient: Option<f64>,
    /// Measured tangential forces, N.
    pub measured_n: Vec<f64>,
    /// Fitted ones, N.
    pub fitted_n: Vec<f64>,
}

/// Rows of a slide: displacement times stiffness over the normal force, tangential over normal force, normal force, N.
struct Slide {
    name: String,
    rows: Vec<[f64; 3]>,
}

/// Returns tangential over normal force of a contact whose displacement times stiffness over the normal force is
/// `pull`.
pub fn force_ratio(coefficient: f64, pull: f64) -> f64 {
    let sticking = 1.0 - pull.max(0.0) / (1.5 * coefficient);
    if coefficient > 0.0 && sticking > 0.0 { coefficient * (1.0 - sticking * sticking.sqrt()) } else { coefficient }
}

/// Fits the slides of a table whose measured depths are too small by `zero_mm`.
pub fn fit(motions: &Motions, zero_mm: f64) -> FrictionFit {
    if !motions.has_shear {
        return FrictionFit::NoForces;
    }
    let mut largest = 0.0_f64;
    let (mut slides, mut pulls) = (Vec::new(), Vec::new());
    for motion in &motions.motions {
        let least = LEAST_NORMAL * motion.all_moments.iter().map(|moment| moment.force_n).fold(0.0, f64::max);
        let (mut displaced, mut pulled, mut furthest) = (Vec::new(), Vec::new(), 0.0_f64);
        for moment in motion.all_moments.iter().filter(|moment| moment.force_n > least) {
            let (shear_mm, Some(tangential_n)) = moment.shear else { continue };
            let ratio = tangential_n.abs() / moment.force_n;
            largest = largest.max(ratio);
            pulled.push([0.0, ratio, moment.force_n]);
            let depth_mm = moment.depth_at_zero(zero_mm);
            let stiffness = motion.curve.shear_stiffness_mm(depth_mm) / motion.curve.force(depth_mm);
            // A slide back unloads the contact, which the formula does not describe.
            if let Some(shear_mm) = shear_mm.map(f64::abs).filter(|mm| *mm >= furthest && stiffness.is_finite()) {
                furthest = shear_mm;
                displaced.push([stiffness * shear_mm, ratio, moment.force_n]);
            }
        }
        if displaced.iter().any(|[pull, ..]| *pull > 0.0) {
            slides.push(Slide { name: motion.name.clone(), rows: displaced });
        } else if !pulled.is_empty() {
            pulls.push(Slide { name: motion.name.clone(), rows: pulled });
        }
    }
    let at_least = |why| FrictionFit::AtLeast { coefficient: largest, why };
    if slides.is_empty() {
        return match find_plateaus(&pulls) {
            Ok(found) => FrictionFit::Found(found),
            Err(why) => at_least(why),
        };
    }
    let all: Vec<&Slide> = slides.iter().collect();
    let coefficient = fit_coefficient(&all);
    if !all.iter().any(|slide| slides_wholly(slide, coefficient)) {
        return at_least("no contact slides as a whole: move the indenter further");
    }
    let without = (0..all.len()).map(|k| {
        let others: Vec<&Slide> = all.iter().enumerate().filter(|(j, _)| *j != k).map(|(_, slide)| *slide).collect();
        vec![fit_coefficient(&others)]
    });
    let standard_error = (all.len() > 1).then(|| jackknife(&without.collect::<Vec<_>>())[0][0].max(0.0).sqrt());
    let results = all.iter().map(|slide| {
        let alone = fit_coefficient(&[slide]);
        SlideResult {
            name: slide.name.clone(),
            coefficient: slides_wholly(slide, alone).then_some(alone),
            measured_n: slide.rows.iter().map(|[_, ratio, normal_n]| ratio * normal_n).collect(),
            fitted_n: slide.rows.iter().map(|[pull, _, n]| force_ratio(coefficient, *pull) * n).collect(),
        }
    });
    let slides = results.collect();
    FrictionFit::Found(FoundFriction { coefficient, standard_error, has_displacements: true, slides })
}

fn slides_wholly(slide: &Slide, coefficient: f64) -> bool {
    slide.rows.iter().any(|[pull, ..]| *pull >= 1.5 * coefficient)
}

/// Returns the coefficient of the least squared error of force ratios, in which each slide weighs the same.
fn fit_coefficient(slides: &[&Slide]) -> f64 {
    let error = |coefficient: f64| -> f64 {
        let of_slide = |slide: &&Slide| {
            let square = |[pull, ratio, _]: &[f64; 3]| {
                let left = ratio - force_ratio(coefficient, *pull);
                left * left
            };
            slide.rows.iter().map(square).sum::<f64>() / slide.rows.len() as f64
        };
        slides.iter().map(of_slide).sum()
    };
    const STEPS: usize = 200;
    const LEAST: f64 = 1e-3;
    let ratio = libm::pow(MOST / LEAST, 1.0 / STEPS as f64);
    let at = |k: usize| LEAST * libm::pow(ratio, k as f64);
    let errors: Vec<f64> = (0..=STEPS).map(|k| error(at(k))).collect();
    let best = (0..=STEPS).min_by(|a, b| errors[*a].total_cmp(&errors[*b])).unwrap_or_default();
    minimise(vec![at(best)], &[at(best) * (ratio - 1.0)], |coefficient| error(coefficient[0].clamp(LEAST, MOST)))[0]
        .clamp(LEAST, MOST)
}

/// Returns the coefficient of motions without displacements whose ratio of forces stays constant at its largest.
fn find_plateaus(pulls: &[Slide]) -> Result<FoundFriction, &'static str> {
    let plateau = |slide: &Slide| -> Option<(f64, Vec<[f64; 3]>)> {
        let largest = slide.rows.iter().map(|[_, ratio, _]| *ratio).fold(0.0, f64::max);
        let rows: Vec<[f64; 3]> =
            slide.rows.iter().copied().filter(|[_, ratio, _]| *ratio >= (1.0 - PLATEAU_WITHIN) * largest).collect();
        let mean = rows.iter().map(|[_, ratio, _]| *ratio).sum::<f64>() / rows.len().max(1) as f64;
        (rows.len() >= PLATEAU_ROWS && mean > 0.0).then_some((mean, rows))
    };
    let found: Vec<(&Slide, f64, Vec<[f64; 3]>)> =
        pulls.iter().filter_map(|slide| plateau(slide).map(|(mean, rows)| (slide, mean, rows))).collect();
    if found.len() < 2 {
        return Err(
            "without shear_mm the ratio of the forces must stay the same over three rows in two motions or more",
        );
    }
    let coefficient = found.iter().map(|(_, mean, _)| mean).sum::<f64>() / found.len() as f64;
    if found.iter().any(|(_, mean, _)| (mean / coefficient - 1.0).abs() > PLATEAUS_WITHIN) {
        return Err(
            "the motions differ in where the ratio of their forces stays the same, so that some of them may stick",
        );
    }
    let count = found.len() as f64;
    let square = found.iter().map(|(_, mean, _)| (mean - coefficient) * (mean - coefficient)).sum::<f64>();
    let slides = found.iter().map(|(slide, mean, rows)| SlideResult {
        name: slide.name.clone(),
        coefficient: Some(*mean),
        measured_n: rows.iter().map(|[_, ratio, normal_n]| ratio * normal_n).collect(),
        fitted_n: rows.iter().map(|[_, _, normal_n]| coefficient * normal_n).collect(),
    });
    let standard_error = Some((square / (count * (count - 1.0))).sqrt());
    Ok(FoundFriction { coefficient, standard_error, has_displacements: false, slides: slides.collect() })
}
