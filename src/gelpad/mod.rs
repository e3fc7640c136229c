//! From overlap to surface: what shape the pad takes under and around the object.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::config::output::Layer;
use crate::depth::Depth;
use crate::grid::{Grid, Rect};

pub mod mean_blur;

/// The models of the gelpad.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Model {
    /// Repeated mean blur of the depth map (Gomes, Wilson and Luo 2019).
    MeanBlur(mean_blur::MeanBlur),
}

impl Model {
    /// Its name in jobs and labels.
    pub fn name(&self) -> &'static str {
        match self {
            Self::MeanBlur(_) => "mean_blur",
        }
    }

    /// Pixels beyond the view in which an object can still change the surface in view or one pixel around it.
    pub fn margin_px(&self) -> usize {
        match self {
            Self::MeanBlur(blur) => blur.reach_px() + SURFACE_BORDER,
        }
    }

    /// True if the model knows what `layer` shows.
    pub fn gives(&self, layer: Layer) -> bool {
        match self {
            Self::MeanBlur(_) => !matches!(layer, Layer::Pressure),
        }
    }

    /// Presses the object into the pad: `depth` is the overlap in the view and [`Model::margin_px`] around it.
    pub fn press(&self, depth: &Depth) -> Contact {
        match self {
            Self::MeanBlur(blur) => mean_blur::press(blur, depth),
        }
    }
}

/// Pixels that [`Contact::surface`] is wider than the view on every side, so that slopes at the image's border are
/// centred differences like everywhere else.
pub const SURFACE_BORDER: usize = 1;

/// The pad after the press.
#[derive(Clone, Debug)]
pub struct Contact {
    /// Displacement of the surface, mm, positive into the pad, in the view and [`SURFACE_BORDER`] around it.
    pub surface: Grid<f32>,
    /// Where, in `surface`, it may differ from 0: outside it is 0 exactly. Empty without contact.
    pub region: Rect,
    /// True if every number in `surface` is finite.
    pub finite: bool,
    /// 255 where the pad touches the object, in the view.
    pub mask: Grid<u8>,
    /// Normal force, N, if the model knows it.
    pub force_n: Option<f64>,
    /// Largest pressure, kPa, if the model knows it.
    pub peak_pressure_kpa: Option<f64>,
    /// What the model says of its own solution.
    pub numerics: Numerics,
}

/// Honest numbers about a solution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Numerics {
    /// The model reached its tolerance; true for models without iteration.
    pub converged: bool,
    /// Iterations taken; 0 for models without iteration.
    pub iterations: u32,
    /// Largest violation of the contact conditions, um, if the model has any.
    pub residual_um: Option<f64>,
    /// Predicted error of the model's theory, um, if it is known.
    pub model_error_um: Option<f64>,
}

impl Numerics {
    /// Those of a model that does not iterate and knows no error of its own.
    pub const DIRECT: Self = Self { converged: true, iterations: 0, residual_um: None, model_error_um: None };
}

/// What [`Contact`] is without any: a flat pad.
pub fn untouched(width: usize, height: usize, force_n: Option<f64>, numerics: Numerics) -> Contact {
    Contact {
        surface: Grid::new(width + 2 * SURFACE_BORDER, height + 2 * SURFACE_BORDER),
        region: Rect::default(),
        finite: true,
        mask: Grid::new(width, height),
        force_n,
        peak_pressure_kpa: force_n,
        numerics,
    }
}
