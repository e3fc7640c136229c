//! Rungs of the accuracy ladder: names for stage choices. The only place where a rung is matched.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::gelpad::{self, mean_blur::MeanBlur};
use crate::optics::{self, phong::Phong};

/// A named set of stage choices, from cheap to exact.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
#[value(rename_all = "snake_case")]
pub enum Rung {
    /// The method of Gomes, Wilson and Luo (2019): mean blur for the pad, Phong for the light.
    #[default]
    Paper,
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
    pub const ALL: [Self; 1] = [Self::Paper];

    /// Its name in jobs and labels.
    pub fn name(self) -> &'static str {
        match self {
            Self::Paper => "paper",
        }
    }

    /// The stage choices it stands for.
    pub fn choices(self) -> Choices {
        match self {
            Self::Paper => Choices {
                gelpad: gelpad::Model::MeanBlur(MeanBlur::default()),
                optics: optics::Model::Phong(Phong::default()),
            },
        }
    }
}
