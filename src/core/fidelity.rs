//! Fidelity levels: named choices of models. Only this file matches on a level.

use serde::{Deserialize, Serialize};

use crate::base::grid::Resolution;
use crate::gelpad;
use crate::gelpad::elastic::Elastic;
use crate::gelpad::finite_strain::FiniteStrain;
use crate::gelpad::mean_blur::MeanBlur;
use crate::optics;
use crate::optics::LightSource;
use crate::optics::calibrated::Calibrated;
use crate::optics::lamps::Lamps;
use crate::optics::phong::{Phong, Shadows, SoftShadows};

/// A fidelity level: a named choice of models, from cheap to exact.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
#[cfg_attr(feature = "schema", schemars(rename = "FidelityLevel"))]
pub enum Fidelity {
    /// The method of Gomes, Wilson and Luo (2019): mean blur for the pad, no shadows.
    Paper,
    /// Elastic pad and shadows, solved on every fourth pixel.
    Draft,
    /// Elastic pad and shadows, solved on every second pixel.
    #[default]
    Standard,
    /// Elastic pad and shadows, solved on every pixel.
    High,
    /// Elastic pad, solved on every pixel as exactly as 32-bit numbers allow: what the numerical error of the others is measured against.
    Reference,
    /// Elastic pad at finite strain (neo-Hookean), solved in a box around the contact.
    #[serde(rename = "finite-strain")]
    FiniteStrain,
}

/// The models of gelpad and light that a simulator uses.
#[derive(Clone, Debug, PartialEq)]
pub struct Models {
    /// Model of the gelpad.
    pub gelpad: gelpad::Model,
    /// Model of the light.
    pub optics: optics::Model,
}

impl Fidelity {
    /// Every level, from cheap to exact.
    pub const ALL: [Self; 6] =
        [Self::Paper, Self::Draft, Self::Standard, Self::High, Self::Reference, Self::FiniteStrain];

    /// Returns the level's name in jobs and labels.
    pub fn name(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::Draft => "draft",
            Self::Standard => "standard",
            Self::High => "high",
            Self::Reference => "reference",
            Self::FiniteStrain => "finite-strain",
        }
    }

    /// Returns the level of this name; `None` if no level is called so.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|level| level.name() == name)
    }

    /// Returns what the level is, in one sentence.
    pub fn summary(self) -> &'static str {
        match self {
            Self::Paper => "The method of Gomes, Wilson and Luo (2019): mean blur for the pad, no shadows",
            Self::Draft => "Elastic pad and shadows, solved on every fourth pixel",
            Self::Standard => "Elastic pad and shadows, solved on every second pixel",
            Self::High => "Elastic pad and shadows, solved on every pixel",
            Self::Reference => {
                "Elastic pad, solved on every pixel as exactly as 32-bit numbers allow: what the numerical error of the others is measured against"
            }
            Self::FiniteStrain => "Elastic pad at finite strain (neo-Hookean), solved in a box around the contact",
        }
    }

    /// Returns the models that the level stands for, by what is known of the sensor's light.
    pub fn models(self, light: LightSource) -> Models {
        let elastic = |resolution, tolerance_um, max_iterations| {
            gelpad::Model::Elastic(Elastic { resolution, tolerance_um, max_iterations, ..Elastic::default() })
        };
        let phong = |shadows| optics::Model::Phong(Phong { shadows, ..Phong::default() });
        Models {
            gelpad: match self {
                Self::Paper => gelpad::Model::MeanBlur(MeanBlur::default()),
                Self::Draft => elastic(Resolution::Quarter, 3.0, 100),
                Self::Standard => elastic(Resolution::Half, 1.0, 200),
                Self::High => elastic(Resolution::Full, 1.0, 200),
                Self::Reference => elastic(Resolution::Full, 0.05, 1000),
                Self::FiniteStrain => gelpad::Model::FiniteStrain(FiniteStrain::default()),
            },
            optics: match (light, self) {
                // One choice for all levels: a finer spacing costs much, and its error is nothing beside the distance to
                // the real sensor (docs/evidence/reality.md).
                (LightSource::Calibration, _) => optics::Model::Calibrated(Calibrated::default()),
                (LightSource::Lamps, _) => optics::Model::Lamps(Lamps {}),
                (LightSource::Leds, Self::Paper) => phong(Shadows::None),
                (LightSource::Leds, Self::Draft) => {
                    phong(Shadows::Soft(SoftShadows { resolution: Resolution::Quarter }))
                }
                (LightSource::Leds, Self::Standard) => {
                    phong(Shadows::Soft(SoftShadows { resolution: Resolution::Half }))
                }
                (LightSource::Leds, Self::High | Self::Reference | Self::FiniteStrain) => {
                    phong(Shadows::Soft(SoftShadows { resolution: Resolution::Full }))
                }
            },
        }
    }
}
