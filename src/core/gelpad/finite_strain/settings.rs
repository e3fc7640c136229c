//! Settings of the model of rubber at finite strain.

use serde::{Deserialize, Serialize};

use crate::base::grid::Resolution;
use crate::gelpad::elastic::Elastic;
use crate::gelpad::elastic::shear::Friction;

/// Parameters of the pad at finite strain.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(default, deny_unknown_fields)]
pub struct FiniteStrain {
    /// Distance between the nodes of the box around the contact in which the rubber is solved, mm, 0.01 to 100. `None`:
    /// a tenth of the pad's thickness, or an eighth where that is not solved; less under narrow contacts.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub box_mm: Option<f64>,
    /// Largest penetration, and largest distance within the contact, that is accepted, um, 0.01 to 1000.
    pub tolerance_um: f64,
    /// Friction between pad and object while it is pressed in: only that nothing slips. `None`: the surface slides along
    /// the object.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub friction: Option<Friction>,
}

impl Default for FiniteStrain {
    fn default() -> Self {
        Self { box_mm: None, tolerance_um: 1.0, friction: None }
    }
}

/// How the difference between rubber and a linear layer is solved for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StrainSettings {
    /// Distance between the nodes of the box, mm; `None` for the usual share of the pad's thickness.
    pub spacing_mm: Option<f64>,
    /// Largest error of the difference that is accepted, um.
    pub tolerance_um: f64,
    /// True if the surface sticks to the object.
    pub stick: bool,
    /// True for the model of its own, false for the coarser and cheaper correction of the elastic model.
    pub thorough: bool,
}

/// Tolerance of the correction of the elastic model, um.
const CORRECTION_TOLERANCE_UM: f64 = 5.0;

impl FiniteStrain {
    /// Returns the settings of the linear layer on the camera's grid, which the box corrects.
    pub fn linear_layer(&self) -> Elastic {
        Elastic {
            resolution: Resolution::Full,
            tolerance_um: self.tolerance_um,
            max_iterations: 200,
            friction: self.friction,
            strain_correction: false,
        }
    }

    /// Returns how the difference to the linear layer is solved for.
    pub fn strain_settings(&self) -> StrainSettings {
        StrainSettings {
            spacing_mm: self.box_mm,
            tolerance_um: self.tolerance_um,
            stick: self.friction == Some(Friction::Stick),
            thorough: true,
        }
    }
}

impl StrainSettings {
    /// Returns the settings of the correction of the elastic model.
    pub(crate) fn of_correction(friction: Option<Friction>) -> Self {
        Self {
            spacing_mm: None,
            tolerance_um: CORRECTION_TOLERANCE_UM,
            stick: friction == Some(Friction::Stick),
            thorough: false,
        }
    }
}
