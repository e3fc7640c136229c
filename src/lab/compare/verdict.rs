//! A sentence that says in which way a simulated set differs from a real one.

use super::distribution::{Distances, Octave};

/// Smallest shift of a channel's mean that is mentioned, grey levels.
const SHIFT: f64 = 0.5;
/// Smallest relative difference of contrast and edges that is mentioned.
const TOLERANCE: f64 = 0.05;
/// Smallest relative difference in the amplitude of structure that is mentioned.
const AMPLITUDE: f64 = 0.15;
/// Ratio of amplitudes below which grain counts as absent.
const ABSENT: f64 = 0.25;

/// Whether two sets show the same presses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scenes {
    /// Both show the same presses: what differs is the simulation's fault.
    Same,
    /// Each shows presses of its own: part of what differs is the presses'.
    Different,
}

impl Scenes {
    /// Words how much something is off, and in which direction.
    fn describe_deviation(self, amount: &str, way: &str) -> String {
        match self {
            Self::Same => format!("{amount} too {way}"),
            Self::Different => format!("{amount} {way}er"),
        }
    }
}

/// Describes what a person would see first: colours, contrast, edges, grain, coarser structure.
pub fn describe_distances(distances: &Distances, scenes: Scenes) -> String {
    let mut parts = Vec::new();
    for (name, channel) in ["red", "green", "blue"].iter().zip(&distances.channels) {
        let shift = channel.mean_shift;
        if shift.abs() >= SHIFT {
            let amount = format!("{name} {:.1} levels", shift.abs());
            parts.push(scenes.describe_deviation(&amount, if shift > 0.0 { "bright" } else { "dark" }));
        }
    }
    let known: Vec<f64> = distances.channels.iter().filter_map(|channel| channel.deviation_ratio).collect();
    let contrast = (!known.is_empty()).then(|| known.iter().sum::<f64>() / known.len() as f64);
    let deviation = |what: &str, ratio: f64, bearable: f64, [low, high]: [&str; 2]| {
        let amount = format!("{what} {:.0} %", 100.0 * (ratio - 1.0).abs());
        ((ratio - 1.0).abs() >= bearable)
            .then(|| scenes.describe_deviation(&amount, if ratio < 1.0 { low } else { high }))
    };
    parts.extend(contrast.and_then(|ratio| deviation("contrast", ratio, TOLERANCE, ["low", "high"])));
    parts.extend(distances.slopes.edge_ratio.and_then(|ratio| deviation("edges", ratio, TOLERANCE, ["soft", "hard"])));
    // Grain is the finest octave. Coarser octaves that differ in the same direction share one phrase.
    let (grain, coarser) = distances.octaves.split_at(distances.octaves.len().min(1));
    parts.extend(grain.iter().filter_map(|octave| match amplitude_ratio(octave) {
        ratio if ratio < ABSENT => Some(format!("almost no grain above {} cycles/px", octave.cycles_per_px[0])),
        ratio => deviation(
            &format!("grain above {} cycles/px", octave.cycles_per_px[0]),
            ratio,
            AMPLITUDE,
            ["weak", "strong"],
        ),
    }));
    parts.extend(
        coarser
            .chunk_by(|a, b| deviation_sign(a) == deviation_sign(b))
            .filter_map(|octaves| describe_structure(octaves, scenes)),
    );
    if parts.is_empty() {
        String::from("no difference in colour, contrast, edges or grain that is worth a word")
    } else {
        parts.join(", ")
    }
}

/// Ratio of amplitudes: the square root of that of powers.
fn amplitude_ratio(octave: &Octave) -> f64 {
    libm::pow(10.0, 0.5 * octave.log10_ratio)
}

/// -1 if structure is too weak, 1 if it is too strong, 0 within the tolerance.
fn deviation_sign(octave: &Octave) -> i32 {
    match amplitude_ratio(octave) - 1.0 {
        off if off.abs() < AMPLITUDE => 0,
        off => off.signum() as i32,
    }
}

/// Describes octaves that differ in the same direction; None within the tolerance.
fn describe_structure(octaves: &[Octave], scenes: Scenes) -> Option<String> {
    let ([finest, ..], [.., coarsest]) = (octaves, octaves) else { return None };
    let way = deviation_sign(finest);
    let percents = octaves.iter().map(|octave| 100.0 * (amplitude_ratio(octave) - 1.0).abs());
    let (least, most) = percents.fold((f64::INFINITY, 0.0_f64), |(low, high), p| (low.min(p), high.max(p)));
    let range = match (format!("{least:.0}"), format!("{most:.0}")) {
        (least, most) if least == most => least,
        (least, most) => format!("{least} to {most}"),
    };
    let (from, to) = (1.0 / finest.cycles_per_px[1], 1.0 / coarsest.cycles_per_px[0]);
    let direction = if way < 0 { "weak" } else { "strong" };
    (way != 0).then(|| scenes.describe_deviation(&format!("structure of {from:.0} to {to:.0} px {range} %"), direction))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compare::distribution::{Channel, Slopes};

    fn distances(shifts: [f64; 3], contrast: f64, edges: f64, logs: &[f64]) -> Distances {
        let channels = shifts.map(|mean_shift| Channel { emd: 9.0, mean_shift, deviation_ratio: Some(contrast) });
        let octave = |(number, log10_ratio): (usize, &f64)| Octave {
            cycles_per_px: crate::compare::spectrum::octave_bounds(number),
            log10_ratio: *log10_ratio,
        };
        Distances {
            real_images: 1,
            sim_images: 1,
            channels,
            slopes: Slopes { emd: 9.0, mean_ratio: Some(2.0), edge_ratio: Some(edges) },
            octaves: logs.iter().enumerate().map(octave).collect(),
            spectrum_rms: None,
        }
    }

    #[test]
    fn the_sentence_names_what_is_off_and_which_way() {
        let off = distances([0.4, 2.04, -3.1], 0.9, 0.8, &[-2.0, 0.0, 0.2, -0.5, -0.4, -0.01]);
        let found = describe_distances(&off, Scenes::Same);
        let expected = "green 2.0 levels too bright, blue 3.1 levels too dark, contrast 10 % too low, \
                        edges 20 % too soft, almost no grain above 0.25 cycles/px, \
                        structure of 8 to 16 px 26 % too strong, structure of 16 to 64 px 37 to 44 % too weak";
        assert_eq!(found, expected);
        // Images of different scenes: the text compares, but does not say "too much" or "too little".
        let expected = "green 2.0 levels brighter, blue 3.1 levels darker, contrast 10 % lower, edges 20 % softer, \
                        almost no grain above 0.25 cycles/px, structure of 8 to 16 px 26 % stronger, \
                        structure of 16 to 64 px 37 to 44 % weaker";
        assert_eq!(describe_distances(&off, Scenes::Different), expected);
    }

    #[test]
    fn what_is_alike_is_said_to_be() {
        assert!(
            describe_distances(&distances([0.4, -0.4, 0.0], 1.04, 0.96, &[0.1, -0.1]), Scenes::Same)
                .starts_with("no difference")
        );
        let mut unknown = distances([0.0; 3], 1.0, 1.0, &[]);
        unknown.slopes.edge_ratio = None;
        unknown.channels.iter_mut().for_each(|channel| channel.deviation_ratio = None);
        assert!(describe_distances(&unknown, Scenes::Same).starts_with("no difference"));
    }
}
