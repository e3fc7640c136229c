//! The gelpad: from the object's penetration to the shape that the pad takes under and around it.

use serde::{Deserialize, Serialize};

use crate::base::grid::{Grid, Rect};
use crate::base::view::SURFACE_BORDER;
use crate::base::view::View;
use crate::depth::outside_window::OutsideCapture;
use crate::depth::{CaptureWindow, Depth};
use crate::effects::{Effect, EffectLog, Requirement};

pub mod elastic;
pub mod finite_strain;
pub mod gaussian;
pub mod material;
pub mod mean_blur;
pub mod no_deformation;
pub mod object_material;
pub mod planar;
pub mod sliding;
pub mod subpixel;
pub mod tangential;
pub mod total_contact;
pub mod traction_map;

use crate::base::simd::{largest_value, simd_dispatch};
use elastic::elastic_object::DeformedObject;
use elastic::in_plane::{InPlaneResponse, Load};
use elastic::layer::ElasticLayer;
use elastic::placed::PlacedDisplacement;
use elastic::shear::Friction;
use elastic::{Elastic, ElasticPad, PriorDisplacement};
use finite_strain::{FiniteStrain, StrainSettings};
use gaussian::Gaussian;
use material::Material;
use mean_blur::MeanBlur;
use no_deformation::NoDeformation;
use object_material::ObjectMaterial;
use sliding::{CarriedLoads, PadMemory};
use subpixel::Subpixel;
use tangential::TangentialMotion;
use total_contact::{OutsideWindow, TotalContact};

/// Range of depths that presses usually have, as shares of the pad's thickness: clearly visible, and within linear
/// theory.
pub const USUAL_DEPTHS: [f64; 2] = [0.05, 0.3];

/// The models of the gelpad.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum Model {
    /// The object's own shape where it reaches into the pad, flat elsewhere.
    None(NoDeformation),
    /// Repeated mean blur of the depth map (Gomes, Wilson and Luo 2019).
    MeanBlur(MeanBlur),
    /// Pyramid of Gaussian blurs with the contact restored (Si and Yuan 2022).
    Gaussian(Gaussian),
    /// Bonded elastic layer in contact, frictionless unless friction is given.
    Elastic(Elastic),
    /// Bonded layer of rubber at finite strain (neo-Hookean), frictionless unless friction is given.
    FiniteStrain(FiniteStrain),
}

impl Model {
    /// Returns the model's name in jobs and labels.
    pub fn name(&self) -> &'static str {
        match self {
            Self::None(_) => "none",
            Self::MeanBlur(_) => "mean_blur",
            Self::Gaussian(_) => "gaussian",
            Self::Elastic(_) => "elastic",
            Self::FiniteStrain(_) => "finite_strain",
        }
    }

    /// Returns the friction between pad and object during the press; `None` if the model has none.
    pub fn friction(&self) -> Option<Friction> {
        match self {
            Self::Elastic(elastic) => elastic.friction,
            Self::FiniteStrain(strain) => strain.friction,
            Self::None(_) | Self::MeanBlur(_) | Self::Gaussian(_) => None,
        }
    }

    /// Returns the model with another friction; models without friction stay as they are.
    pub fn with_friction(self, friction: Option<Friction>) -> Self {
        match self {
            Self::Elastic(elastic) => Self::Elastic(Elastic { friction, ..elastic }),
            Self::FiniteStrain(strain) => Self::FiniteStrain(FiniteStrain { friction, ..strain }),
            without @ (Self::None(_) | Self::MeanBlur(_) | Self::Gaussian(_)) => without,
        }
    }

    /// Returns true if the model computes the pressure between pad and object. A [`Contact`] then has a force, a peak
    /// pressure and a load.
    pub fn knows_pressure(&self) -> bool {
        match self {
            Self::Elastic(_) | Self::FiniteStrain(_) => true,
            Self::None(_) | Self::MeanBlur(_) | Self::Gaussian(_) => false,
        }
    }

    /// Returns true if the model computes motion of the pad in its own plane.
    pub fn knows_tractions(&self) -> bool {
        match self {
            Self::Elastic(_) | Self::FiniteStrain(_) => true,
            Self::None(_) | Self::MeanBlur(_) | Self::Gaussian(_) => false,
        }
    }

    /// Returns the settings by which the model solves the contact on the camera's grid; `None` if it solves none.
    pub fn contact_solver(&self) -> Option<Elastic> {
        match self {
            Self::Elastic(elastic) => Some(*elastic),
            Self::FiniteStrain(strain) => Some(strain.linear_layer()),
            Self::None(_) | Self::MeanBlur(_) | Self::Gaussian(_) => None,
        }
    }

    /// Returns how the model solves for the difference between rubber and a linear layer; `None` if it does not.
    pub fn strain_settings(&self) -> Option<StrainSettings> {
        match self {
            Self::Elastic(elastic) => elastic.strain_settings(),
            Self::FiniteStrain(strain) => Some(strain.strain_settings()),
            Self::None(_) | Self::MeanBlur(_) | Self::Gaussian(_) => None,
        }
    }
}

/// A model prepared for one sensor, with everything that is the same for every sample.
pub enum Pad {
    /// See [`Model::None`].
    None,
    /// See [`Model::MeanBlur`].
    MeanBlur(MeanBlur),
    /// See [`Model::Gaussian`].
    Gaussian(Gaussian),
    /// See [`Model::Elastic`] and [`Model::FiniteStrain`].
    Elastic(Box<ElasticPad>),
}

impl Pad {
    /// Prepares `model` for a pad of `material`.
    pub fn new(model: &Model, material: &Material, view: &View) -> Self {
        match model {
            Model::None(_) => Self::None,
            Model::MeanBlur(blur) => Self::MeanBlur(*blur),
            Model::Gaussian(gaussian) => Self::Gaussian(gaussian.clone()),
            Model::Elastic(elastic) => Self::Elastic(Box::new(ElasticPad::new(elastic, material, view))),
            Model::FiniteStrain(strain) => {
                let layer = ElasticPad::new(&strain.linear_layer(), material, view);
                Self::Elastic(Box::new(layer.with_strain(strain.strain_settings())))
            }
        }
    }

    /// Returns the pad with another Young's modulus, kPa: displacements stay, and pressures scale with it.
    pub(crate) fn with_youngs_modulus(&self, youngs_modulus_kpa: f64) -> Self {
        match self {
            Self::None => Self::None,
            Self::MeanBlur(blur) => Self::MeanBlur(*blur),
            Self::Gaussian(gaussian) => Self::Gaussian(gaussian.clone()),
            Self::Elastic(pad) => Self::Elastic(Box::new(pad.with_youngs_modulus(youngs_modulus_kpa))),
        }
    }

    /// Returns the pad under an object of its own material; `None` if that makes no difference to the model.
    pub(crate) fn with_object_material(&self, object: &ObjectMaterial) -> Option<Self> {
        match self {
            Self::Elastic(pad) => (*object != ObjectMaterial::default())
                .then(|| Self::Elastic(Box::new(pad.with_object_material(object.friction, object.soft)))),
            Self::None | Self::MeanBlur(_) | Self::Gaussian(_) => None,
        }
    }

    /// Solves for the shape of a deformable object under its load, captured in `window`; `None` if the object keeps its
    /// shape.
    pub(crate) fn deform_object(
        &self,
        depth: &Depth,
        outside: Option<&OutsideWindow>,
        window: CaptureWindow,
    ) -> Option<DeformedObject> {
        match self {
            Self::Elastic(pad) => pad.deform_object(depth, outside, window),
            Self::None | Self::MeanBlur(_) | Self::Gaussian(_) => None,
        }
    }

    /// Returns the part of an object, pressed in by `depth_mm`, that the model needs.
    pub fn capture_window(&self, depth_mm: f64) -> CaptureWindow {
        match self {
            Self::None => CaptureWindow { margin_px: SURFACE_BORDER, above_mm: 0.0 },
            Self::MeanBlur(blur) => CaptureWindow { margin_px: blur.reach_px() + SURFACE_BORDER, above_mm: 0.0 },
            Self::Gaussian(gaussian) => {
                CaptureWindow { margin_px: gaussian.reach_px() + SURFACE_BORDER, above_mm: 0.0 }
            }
            Self::Elastic(pad) => pad.capture_window(depth_mm),
        }
    }

    /// Returns a higher window if the pad bulged up to where nothing is known of the object; `None` if `window` was
    /// high enough.
    pub fn higher_window(&self, window: CaptureWindow, contact: &Contact) -> Option<CaptureWindow> {
        match self {
            Self::Elastic(pad) => pad.higher_window(window, contact),
            Self::None | Self::MeanBlur(_) | Self::Gaussian(_) => None,
        }
    }

    /// Prepares the in-plane motion of the pad; `None` if the model does not compute the pressures that cause it.
    pub(crate) fn in_plane_response(
        &self,
        material: &Material,
        field_of_view_mm: [f64; 2],
        view: &View,
    ) -> Option<InPlaneResponse> {
        match self {
            Self::Elastic(_) => {
                Some(InPlaneResponse::new(ElasticLayer::new(material), field_of_view_mm, view.mm_per_px))
            }
            Self::None | Self::MeanBlur(_) | Self::Gaussian(_) => None,
        }
    }

    /// Solves for the contact outside the window.
    pub(crate) fn solve_outside_window(&self, around: &OutsideCapture<'_>) -> OutsideWindow {
        match self {
            Self::Elastic(pad) => pad.solve_outside_window(around),
            Self::None | Self::MeanBlur(_) | Self::Gaussian(_) => {
                OutsideWindow::from_penetration(around, self.capture_window(0.0).margin_px)
            }
        }
    }

    /// Presses the object into the pad; `depth` is its penetration in [`Pad::capture_window`].
    pub fn press(&self, depth: &Depth) -> Contact {
        self.press_with_outside(depth, None)
    }

    /// Presses the object into the pad, which the contact outside the window also displaces.
    pub(crate) fn press_with_outside(&self, depth: &Depth, outside: Option<&OutsideWindow>) -> Contact {
        match self {
            Self::None => no_deformation::press(depth),
            Self::MeanBlur(blur) => mean_blur::press(blur, depth),
            Self::Gaussian(gaussian) => gaussian::press(gaussian, depth),
            Self::Elastic(pad) => pad.press_with_outside(depth, outside),
        }
    }
}

/// Returns the depth map of the object in the shape that it takes under its load, captured in `window`, and whether
/// that shape was found within the tolerance. A rigid object keeps its shape.
pub fn deform_object(
    pad: &Pad,
    depth: Depth,
    outside: Option<&OutsideWindow>,
    window: CaptureWindow,
    effects: &mut EffectLog,
) -> (Depth, bool) {
    if effects.leaves_out(Effect::Deformation) {
        return (depth, true);
    }
    match effects.run_timed(Effect::Deformation, || pad.deform_object(&depth, outside, window)) {
        Some(DeformedObject { depth, converged }) => (depth, converged),
        None => (depth, true),
    }
}

/// Presses the object into the pad, with the contact outside the window. `markers` is true if something shows how the
/// pad moves in its own plane.
///
/// In a sequence friction was already solved for: `carried` then has what the loads before this press do.
pub fn deform_pad(
    pad: &Pad,
    depth: &Depth,
    outside: Option<&OutsideWindow>,
    carried: Option<&CarriedLoads>,
    markers: bool,
    effects: &mut EffectLog,
) -> Contact {
    let clear = depth.touching.is_empty() && outside.is_none_or(|outside| outside.displacement.is_none());
    let remembered = carried.and_then(|carried| carried.remembered.as_ref());
    let relaxation = match (pad, carried.map(|carried| carried.memory)) {
        (Pad::None | Pad::MeanBlur(_) | Pad::Gaussian(_), _) => Requirement::Absent("the gelpad model knows none"),
        (_, None) => Requirement::Absent("a single press takes no time"),
        (_, Some(PadMemory::Elastic)) => Requirement::Absent("the pad does not relax"),
        (_, Some(PadMemory::Blank)) => Requirement::Unneeded("nothing has loaded the pad"),
        (_, Some(PadMemory::Loaded)) => Requirement::Needed("loads on the pad relax with time"),
    };
    effects.enable(Effect::Relaxation, relaxation);
    let need = match pad {
        Pad::None => Requirement::Absent("the gelpad model has none"),
        _ if clear && remembered.is_some() => Requirement::Needed("the pad has not recovered from earlier loads"),
        _ if clear => Requirement::Unneeded("nothing reaches into the pad"),
        _ => Requirement::Needed("the object reaches into the pad"),
    };
    // Models are also called without contact: only they know which forces and numerics to report then.
    let deforms = effects.enable(Effect::Deformation, need);
    let friction = match pad {
        Pad::Elastic(_) if deforms && carried.is_some() => Requirement::Needed("a sequence carries tractions on"),
        Pad::Elastic(pad) if deforms => pad.friction_required(depth, markers),
        Pad::Elastic(_) => Requirement::Absent("the pad is not deformed"),
        Pad::None | Pad::MeanBlur(_) | Pad::Gaussian(_) => Requirement::Absent("the gelpad model knows none"),
    };
    let holds = effects.enable(Effect::Friction, friction);
    let strain = match pad {
        Pad::Elastic(pad) if pad.strain_settings().is_none() => Requirement::Absent("the gelpad model is linear"),
        Pad::Elastic(pad) if deforms && !clear => pad.finite_strain_required(depth),
        Pad::Elastic(_) => Requirement::Absent("the pad is not deformed"),
        Pad::None | Pad::MeanBlur(_) | Pad::Gaussian(_) => Requirement::Absent("the gelpad model knows no strain"),
    };
    let corrects = effects.enable(Effect::FiniteStrain, strain);
    match pad {
        Pad::Elastic(pad) if deforms || clear => {
            let outside = outside.and_then(|outside| outside.displacement.as_ref());
            let strain = corrects.then(|| effects.run_timed(Effect::FiniteStrain, || pad.solve_finite_strain(depth)));
            let strain = match strain {
                Some(Err(reason)) => {
                    effects.explain(Effect::FiniteStrain, reason);
                    None
                }
                Some(Ok(strain)) => Some(strain),
                None => None,
            };
            let sticks = strain.as_ref().is_some_and(|strain| strain.sticks);
            let drag = match carried {
                None if holds && !sticks => effects.run_timed(Effect::Friction, || pad.solve_friction(depth, outside)),
                _ => None,
            };
            let carried_drag = carried.and_then(|carried| carried.friction.as_ref());
            let drag = carried_drag.filter(|_| holds).or(drag.as_ref());
            let prior = PriorDisplacement { outside, friction: drag, remembered, strain: strain.as_ref() };
            let mut contact = effects.run_timed(Effect::Deformation, || pad.press_displaced_pad(depth, prior));
            if let Some(carried) = carried.filter(|carried| carried.stiffness != 1.0) {
                contact.scale_forces(carried.stiffness);
            }
            contact
        }
        _ if deforms || clear => effects.run_timed(Effect::Deformation, || pad.press(depth)),
        _ => no_deformation::press(depth),
    }
}

/// The pad after the press.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Contact {
    /// Displacement of the surface, mm, positive into the pad, in the view and [`SURFACE_BORDER`] around it.
    pub surface: Grid<f32>,
    /// The part of `surface` that may differ from 0; outside it is exactly 0. Empty without contact.
    pub region: Rect,
    /// Largest height of the pad over its undeformed surface, in view or beyond, mm.
    pub bulge_mm: f32,
    /// True if every number in `surface` is finite.
    pub finite: bool,
    /// 255 where the pad touches the object, in the view.
    pub mask: Grid<u8>,
    /// Pressure over Young's modulus on the solver's own grid, in view and beyond; `None` without contact, or if the
    /// model computes no pressure.
    pub load: Option<Load>,
    /// Motion of the surface in its own plane during the press; `None` if nothing shows it or the model does not
    /// compute it.
    pub tangential: Option<TangentialMotion>,
    /// What rubber at finite strain adds to the linear layer's motion along x and y, and whether the surface sticks to
    /// the object in it; `None` if it was not solved for.
    pub(crate) strain_motion: Option<([PlacedDisplacement; 2], bool)>,
    /// Pressure between pad and object, kPa, in the view; `None` without contact, or if the model computes no pressure.
    pub pressure: Option<Grid<f32>>,
    /// Normal force on the part in view, N; `None` if the model computes none, or if unknown parts of the object decide
    /// it.
    pub force_n: Option<f64>,
    /// How the contact in view belongs to the object's total contact; set by [`crate::simulator::Simulator`].
    pub total: TotalContact,
    /// Factor by which pressures and forces are larger than in [`Contact::load`]: corrections for friction and for a
    /// curved core, fitted to finite elements.
    pub stiffening_factor: f64,
    /// Largest pressure in view, kPa; `None` if the model computes none.
    pub peak_pressure_kpa: Option<f64>,
    /// The surface between pixel centres, where it was sampled.
    pub subpixel: Option<Subpixel>,
    /// What the model reports about its own solution.
    pub numerics: Numerics,
}

impl Contact {
    /// Multiplies pressures and forces by a factor.
    pub(crate) fn scale_forces(&mut self, factor: f64) {
        self.stiffening_factor *= factor;
        self.force_n = self.force_n.map(|force| factor * force);
        self.peak_pressure_kpa = self.peak_pressure_kpa.map(|peak| factor * peak);
        if let Some(pressure) = &mut self.pressure {
            pressure.data.iter_mut().for_each(|kpa| *kpa *= factor as f32);
        }
    }

    /// Returns the lowest and highest displacement of the surface in view, mm; NaN values are ignored.
    pub fn range_mm(&self) -> [f32; 2] {
        let Rect { x0, y0, x1, y1 } = self.region;
        let [up, down] = simd_dispatch(
            #[inline(always)]
            || {
                (y0..y1).fold([0.0_f32; 2], |[up, down], y| {
                    let row = &self.surface.row(y)[x0..x1];
                    [up.max(largest_value(row.iter().map(|w| -w))), down.max(largest_value(row.iter().copied()))]
                })
            },
        );
        // 0.0 - up instead of -up, so that the result is not -0.0 where nothing rises.
        [0.0 - up, down]
    }
}

/// The theory of elasticity by which a press was solved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum Theory {
    /// None: the model is not elastic.
    #[default]
    None,
    /// Linear elasticity, for small strain.
    Linear,
    /// Linear elasticity, corrected by rubber at finite strain.
    FiniteStrain,
}

/// Quality of a solution, as the model reports it.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Numerics {
    /// True if the model reached its tolerance; always true for models without iteration.
    pub converged: bool,
    /// Number of iterations; 0 for models without iteration.
    pub iterations: u32,
    /// Largest violation of the contact conditions, um; `None` if the model has no such conditions.
    pub residual_um: Option<f64>,
    /// Largest expected error of the model's theory within 2 mm of the contact, um, or why it is not known.
    pub model_error_um: Result<f64, &'static str>,
    /// The theory by which the press was solved.
    pub theory: Theory,
    /// Radius by which the object's edges were rounded for the solution at finite strain, mm; 0 without it.
    pub opened_mm: f64,
    /// Number of iterations of the solution at finite strain; 0 without it.
    pub strain_iterations: u32,
    /// Largest error that the solution at finite strain left, um; 0 without it.
    pub strain_residual_um: f64,
}

impl Numerics {
    /// The numerics of a model that neither iterates nor knows its own error.
    pub const DIRECT: Self = Self {
        converged: true,
        iterations: 0,
        residual_um: None,
        model_error_um: Err("the model of the gelpad knows no error of its own"),
        theory: Theory::None,
        opened_mm: 0.0,
        strain_iterations: 0,
        strain_residual_um: 0.0,
    };
}

/// Makes a [`Contact`] without contact: a flat pad.
pub fn no_contact(width: usize, height: usize, force_n: Option<f64>, numerics: Numerics) -> Contact {
    Contact {
        surface: Grid::new(width + 2 * SURFACE_BORDER, height + 2 * SURFACE_BORDER),
        region: Rect::default(),
        bulge_mm: 0.0,
        finite: true,
        mask: Grid::new(width, height),
        load: None,
        tangential: None,
        strain_motion: None,
        pressure: None,
        force_n,
        total: TotalContact::default(),
        stiffening_factor: 1.0,
        peak_pressure_kpa: force_n,
        subpixel: None,
        numerics,
    }
}
