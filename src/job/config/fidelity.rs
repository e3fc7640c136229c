//! `fidelity`: a fidelity level, or a bound by which one is chosen.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use gelsim_core::fidelity::Fidelity;

/// The fidelity that a job selects: a level, or a bound by which one is chosen.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(rename = "Fidelity")]
pub enum FidelityChoice {
    /// The method of Gomes, Wilson and Luo (2019): mean blur for the pad, no shadows.
    Paper,
    /// Elastic pad and shadows, solved on every fourth pixel.
    Draft,
    /// Elastic pad and shadows, solved on every second pixel.
    Standard,
    /// Elastic pad and shadows, solved on every pixel.
    High,
    /// Elastic pad, solved on every pixel as exactly as 32-bit numbers allow: the level with which the others are
    /// compared.
    Reference,
    /// Elastic pad at finite strain (neo-Hookean), solved in a box around the contact.
    #[serde(rename = "finite-strain")]
    FiniteStrain,
    /// The cheapest level whose surface is this close to that of `reference`, um (root mean square over the view, in at
    /// least 99 % of the samples).
    MaxErrorUm(f64),
    /// The most exact level that simulates a sample in this CPU time, ms (median of some samples of the job, on one
    /// thread, without writing files).
    MaxMs(f64),
}

impl FidelityChoice {
    /// Returns the level, or `None` for a bound.
    pub fn level(self) -> Option<Fidelity> {
        match self {
            Self::Paper => Some(Fidelity::Paper),
            Self::Draft => Some(Fidelity::Draft),
            Self::Standard => Some(Fidelity::Standard),
            Self::High => Some(Fidelity::High),
            Self::Reference => Some(Fidelity::Reference),
            Self::FiniteStrain => Some(Fidelity::FiniteStrain),
            Self::MaxErrorUm(_) | Self::MaxMs(_) => None,
        }
    }
}

impl From<Fidelity> for FidelityChoice {
    fn from(level: Fidelity) -> Self {
        match level {
            Fidelity::Paper => Self::Paper,
            Fidelity::Draft => Self::Draft,
            Fidelity::Standard => Self::Standard,
            Fidelity::High => Self::High,
            Fidelity::Reference => Self::Reference,
            Fidelity::FiniteStrain => Self::FiniteStrain,
        }
    }
}
