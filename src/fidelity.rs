//! Rungs of the accuracy ladder: names for stage choices. The only place where a rung is matched.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::gelpad;
use crate::gelpad::elastic::{Elastic, Resolution};
use crate::gelpad::mean_blur::MeanBlur;
use crate::optics;
use crate::optics::calibrated::Calibrated;
use crate::optics::phong::{Phong, Shadows, Soft};

/// A named set of stage choices, from cheap to exact.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
#[value(rename_all = "snake_case")]
pub enum Rung {
    /// The method of Gomes, Wilson and Luo (2019): mean blur for the pad, no shadows.
    Paper,
    /// Elastic pad, solved on every fourth pixel; so are shadows.
    Draft,
    /// Elastic pad, solved on every second pixel; so are shadows.
    #[default]
    Standard,
    /// Elastic pad and shadows, solved on every pixel.
    High,
    /// Elastic pad, solved on every pixel as exactly as 32-bit numbers allow: what the others are measured against.
    Reference,
}

/// What a job asks for: a rung, or a bound by which one is chosen.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Fidelity {
    /// The method of Gomes, Wilson and Luo (2019): mean blur for the pad, no shadows.
    Paper,
    /// Elastic pad, solved on every fourth pixel; so are shadows.
    Draft,
    /// Elastic pad, solved on every second pixel; so are shadows.
    Standard,
    /// Elastic pad and shadows, solved on every pixel.
    High,
    /// Elastic pad, solved on every pixel as exactly as 32-bit numbers allow: what the others are measured against.
    Reference,
    /// The cheapest rung whose surface is this close to the reference's, um (root mean square over the view, in the
    /// worst of some samples of the job).
    MaxErrorUm(f64),
    /// The most exact rung that simulates a sample in this CPU time, ms (median of some samples of the job, one thread,
    /// files not counted).
    MaxMs(f64),
}

impl Fidelity {
    /// The rung, if it is one.
    pub fn rung(self) -> Option<Rung> {
        match self {
            Self::Paper => Some(Rung::Paper),
            Self::Draft => Some(Rung::Draft),
            Self::Standard => Some(Rung::Standard),
            Self::High => Some(Rung::High),
            Self::Reference => Some(Rung::Reference),
            Self::MaxErrorUm(_) | Self::MaxMs(_) => None,
        }
    }
}

impl From<Rung> for Fidelity {
    fn from(rung: Rung) -> Self {
        match rung {
            Rung::Paper => Self::Paper,
            Rung::Draft => Self::Draft,
            Rung::Standard => Self::Standard,
            Rung::High => Self::High,
            Rung::Reference => Self::Reference,
        }
    }
}

/// What a rung chooses for the stages that a job leaves open.
#[derive(Clone, Debug, PartialEq)]
pub struct Choices {
    /// Model of the gelpad.
    pub gelpad: gelpad::Model,
    /// Model of the light.
    pub optics: optics::Model,
}

impl Rung {
    /// Every rung, from cheap to exact.
    pub const ALL: [Self; 5] = [Self::Paper, Self::Draft, Self::Standard, Self::High, Self::Reference];

    /// Its name in jobs and labels.
    pub fn name(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::Draft => "draft",
            Self::Standard => "standard",
            Self::High => "high",
            Self::Reference => "reference",
        }
    }

    /// The stage choices it stands for; `measured` if the sensor's light was.
    pub fn choices(self, measured: bool) -> Choices {
        let elastic = |resolution, tolerance_um, max_iterations| {
            gelpad::Model::Elastic(Elastic { resolution, tolerance_um, max_iterations })
        };
        let phong = |shadows| optics::Model::Phong(Phong { shadows, ..Phong::default() });
        Choices {
            gelpad: match self {
                Self::Paper => gelpad::Model::MeanBlur(MeanBlur::default()),
                Self::Draft => elastic(Resolution::Quarter, 3.0, 100),
                Self::Standard => elastic(Resolution::Half, 1.0, 200),
                Self::High => elastic(Resolution::Full, 1.0, 200),
                Self::Reference => elastic(Resolution::Full, 0.05, 1000),
            },
            optics: match (measured, self) {
                // Finer costs much, and is nothing beside the distance to the real sensor (docs/reality.md).
                (true, _) => optics::Model::Calibrated(Calibrated::default()),
                (false, Self::Paper) => phong(Shadows::None),
                (false, Self::Draft) => phong(Shadows::Soft(Soft { resolution: Resolution::Quarter })),
                (false, Self::Standard) => phong(Shadows::Soft(Soft { resolution: Resolution::Half })),
                (false, Self::High | Self::Reference) => phong(Shadows::Soft(Soft { resolution: Resolution::Full })),
            },
        }
    }
}
