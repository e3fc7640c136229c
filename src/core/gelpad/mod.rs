//! From overlap to surface: what shape the pad takes under and around the object.

use serde::{Deserialize, Serialize};

use crate::base::grid::{Grid, Rect};
use crate::base::view::SURFACE_BORDER;
use crate::base::view::View;
use crate::depth::beyond::Surroundings;
use crate::depth::{Depth, Window};
use crate::effects::{Effect, EffectLog, Requirement};

pub mod elastic;
pub mod gaussian;
pub mod material;
pub mod mean_blur;
pub mod none;
pub mod object;
pub mod planar;
pub mod sliding;
pub mod subpixel;
pub mod tangential;
pub mod total_contact;

use crate::base::simd::{largest, simd_dispatch};
use elastic::friction::Drag;
use elastic::inplane::{InPlane, Load};
use elastic::layer::ElasticLayer;
use elastic::shear::Friction;
use elastic::soft::Yielded;
use elastic::{Elastic, Given};
use gaussian::Gaussian;
use material::Material;
use mean_blur::MeanBlur;
use none::NoDeformation;
use object::ObjectMaterial;
use subpixel::Subpixel;
use tangential::TangentialMotion;
use total_contact::{Beyond, TotalContact};

/// Shares of a pad's thickness that presses usually go in: seen well, and within linear theory.
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
}

impl Model {
    /// Its name in jobs and labels.
    pub fn name(&self) -> &'static str {
        match self {
            Self::None(_) => "none",
            Self::MeanBlur(_) => "mean_blur",
            Self::Gaussian(_) => "gaussian",
            Self::Elastic(_) => "elastic",
        }
    }

    /// What holds the pad to the object while it is pressed in, if anything does.
    pub fn friction(&self) -> Option<Friction> {
        match self {
            Self::Elastic(elastic) => elastic.friction,
            Self::None(_) | Self::MeanBlur(_) | Self::Gaussian(_) => None,
        }
    }

    /// The same with another friction, if the model knows friction.
    pub fn with_friction(self, friction: Option<Friction>) -> Self {
        match self {
            Self::Elastic(elastic) => Self::Elastic(Elastic { friction, ..elastic }),
            without @ (Self::None(_) | Self::MeanBlur(_) | Self::Gaussian(_)) => without,
        }
    }

    /// True if the model knows the pressure between pad and object: then a [`Contact`] has its force, its peak and its load.
    pub fn knows_pressure(&self) -> bool {
        match self {
            Self::Elastic(_) => true,
            Self::None(_) | Self::MeanBlur(_) | Self::Gaussian(_) => false,
        }
    }

    /// True if the model knows what moves the pad in its own plane.
    pub fn knows_tractions(&self) -> bool {
        match self {
            Self::Elastic(_) => true,
            Self::None(_) | Self::MeanBlur(_) | Self::Gaussian(_) => false,
        }
    }
}

/// A model made ready for one sensor: everything that is the same for every sample.
pub enum Pad {
    /// See [`Model::None`].
    None,
    /// See [`Model::MeanBlur`].
    MeanBlur(MeanBlur),
    /// See [`Model::Gaussian`].
    Gaussian(Gaussian),
    /// See [`Model::Elastic`].
    Elastic(Box<elastic::Pad>),
}

impl Pad {
    /// Prepares `model` for a pad of `material`.
    pub fn new(model: &Model, material: &Material, view: &View) -> Self {
        match model {
            Model::None(_) => Self::None,
            Model::MeanBlur(blur) => Self::MeanBlur(*blur),
            Model::Gaussian(gaussian) => Self::Gaussian(gaussian.clone()),
            Model::Elastic(elastic) => Self::Elastic(Box::new(elastic::Pad::new(elastic, material, view))),
        }
    }

    /// The same pad of another Young's modulus, kPa: displacements stay, pressures are in proportion.
    pub(crate) fn with_youngs_modulus(&self, youngs_modulus_kpa: f64) -> Self {
        match self {
            Self::None => Self::None,
            Self::MeanBlur(blur) => Self::MeanBlur(*blur),
            Self::Gaussian(gaussian) => Self::Gaussian(gaussian.clone()),
            Self::Elastic(pad) => Self::Elastic(Box::new(pad.with_youngs_modulus(youngs_modulus_kpa))),
        }
    }

    /// The same pad under an object of its own material, if that makes any difference to the model.
    pub(crate) fn under(&self, object: &ObjectMaterial) -> Option<Self> {
        match self {
            Self::Elastic(pad) => (*object != ObjectMaterial::default())
                .then(|| Self::Elastic(Box::new(pad.under(object.friction, object.soft)))),
            Self::None | Self::MeanBlur(_) | Self::Gaussian(_) => None,
        }
    }

    /// The shape that an object takes under its load, captured in `window`; `None` if it keeps its own.
    pub(crate) fn yielded(&self, depth: &Depth, beyond: Option<&Beyond>, window: Window) -> Option<Yielded> {
        match self {
            Self::Elastic(pad) => pad.yielded(depth, beyond, window),
            Self::None | Self::MeanBlur(_) | Self::Gaussian(_) => None,
        }
    }

    /// What of an object pressed in by `depth_mm` the model has to know.
    pub fn window(&self, depth_mm: f64) -> Window {
        match self {
            Self::None => Window { margin_px: SURFACE_BORDER, above_mm: 0.0 },
            Self::MeanBlur(blur) => Window { margin_px: blur.reach_px() + SURFACE_BORDER, above_mm: 0.0 },
            Self::Gaussian(gaussian) => Window { margin_px: gaussian.reach_px() + SURFACE_BORDER, above_mm: 0.0 },
            Self::Elastic(pad) => pad.window(depth_mm),
        }
    }

    /// A window that reaches higher, if the pad bulged up to where nothing is known of the object.
    pub fn higher(&self, window: Window, contact: &Contact) -> Option<Window> {
        match self {
            Self::Elastic(pad) => pad.higher(window, contact),
            Self::None | Self::MeanBlur(_) | Self::Gaussian(_) => None,
        }
    }

    /// In-plane motion of the pad, if the model knows the pressures that cause it.
    pub(crate) fn in_plane(&self, material: &Material, field_of_view_mm: [f64; 2], view: &View) -> Option<InPlane> {
        match self {
            Self::Elastic(_) => Some(InPlane::new(ElasticLayer::new(material), field_of_view_mm, view.mm_per_px)),
            Self::None | Self::MeanBlur(_) | Self::Gaussian(_) => None,
        }
    }

    /// What touches beyond the window.
    pub(crate) fn beyond(&self, around: &Surroundings<'_>) -> Beyond {
        match self {
            Self::Elastic(pad) => pad.beyond(around),
            Self::None | Self::MeanBlur(_) | Self::Gaussian(_) => {
                Beyond::of_overlap(around, self.window(0.0).margin_px)
            }
        }
    }

    /// Presses the object into the pad: `depth` is the overlap in [`Pad::window`].
    pub fn press(&self, depth: &Depth) -> Contact {
        self.press_with(depth, None)
    }

    /// The same with what touches beyond the window.
    pub(crate) fn press_with(&self, depth: &Depth, beyond: Option<&Beyond>) -> Contact {
        match self {
            Self::None => none::press(depth),
            Self::MeanBlur(blur) => mean_blur::press(blur, depth),
            Self::Gaussian(gaussian) => gaussian::press(gaussian, depth),
            Self::Elastic(pad) => pad.press_with(depth, beyond),
        }
    }
}

/// The object in the shape that it takes under its load, captured in `window`, and whether that was found within the
/// tolerance. Where nothing is deformed it keeps its own.
pub fn shaped(
    pad: &Pad,
    depth: Depth,
    beyond: Option<&Beyond>,
    window: Window,
    effects: &mut EffectLog,
) -> (Depth, bool) {
    if effects.leaves_out(Effect::Deformation) {
        return (depth, true);
    }
    match effects.timed(Effect::Deformation, || pad.yielded(&depth, beyond, window)) {
        Some(Yielded { depth, solved }) => (depth, solved),
        None => (depth, true),
    }
}

/// The pad under an object that overlaps it, with what touches beyond the window; `markers` if something shows how it
/// moves in its own plane.
///
/// In a sequence friction was solved for already: `carried` is what its tractions displace, if that shows.
pub fn deform(
    pad: &Pad,
    depth: &Depth,
    beyond: Option<&Beyond>,
    carried: Option<Option<&Drag>>,
    markers: bool,
    effects: &mut EffectLog,
) -> Contact {
    let clear = depth.touching.is_empty() && beyond.is_none_or(|beyond| beyond.displacement.is_none());
    let need = match pad {
        Pad::None => Requirement::Absent("the gelpad model has none"),
        _ if clear => Requirement::Unneeded("nothing reaches into the pad"),
        _ => Requirement::Needed("the object reaches into the pad"),
    };
    // What a model makes of nothing is its own business: it knows which numbers it would give.
    let deforms = effects.enable(Effect::Deformation, need);
    let friction = match pad {
        Pad::Elastic(_) if deforms && carried.is_some() => Requirement::Needed("a sequence carries tractions on"),
        Pad::Elastic(pad) if deforms => pad.friction_required(depth, markers),
        Pad::Elastic(_) => Requirement::Absent("the pad is not deformed"),
        Pad::None | Pad::MeanBlur(_) | Pad::Gaussian(_) => Requirement::Absent("the gelpad model knows none"),
    };
    let holds = effects.enable(Effect::Friction, friction);
    match pad {
        Pad::Elastic(pad) if deforms || clear => {
            let beyond = beyond.and_then(|beyond| beyond.displacement.as_ref());
            let drag = match carried {
                Some(_) => None,
                None if holds => effects.timed(Effect::Friction, || pad.drag(depth, beyond)),
                None => None,
            };
            let drag = carried.flatten().filter(|_| holds).or(drag.as_ref());
            effects.timed(Effect::Deformation, || pad.press_into(depth, Given { beyond, drag }))
        }
        _ if deforms || clear => effects.timed(Effect::Deformation, || pad.press(depth)),
        _ => none::press(depth),
    }
}

/// The pad after the press.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Contact {
    /// Displacement of the surface, mm, positive into the pad, in the view and [`SURFACE_BORDER`] around it.
    pub surface: Grid<f32>,
    /// Where, in `surface`, it may differ from 0: outside it is 0 exactly. Empty without contact.
    pub region: Rect,
    /// How high the pad bulges over its undeformed surface, in view or beyond, mm.
    pub bulge_mm: f32,
    /// True if every number in `surface` is finite.
    pub finite: bool,
    /// 255 where the pad touches the object, in the view.
    pub mask: Grid<u8>,
    /// Pressure over Young's modulus on the solver's own grid, in view and beyond, if the model knows it and there is any
    /// contact.
    pub load: Option<Load>,
    /// How the press moved the surface in its own plane, if something shows it and the model knows.
    pub tangential: Option<TangentialMotion>,
    /// Pressure between pad and object, kPa, in the view, if the model knows it and there is any contact.
    pub pressure: Option<Grid<f32>>,
    /// Normal force on the part in view, N, if the model knows it, and all of the object that decides it.
    pub force_n: Option<f64>,
    /// How the contact in view is part of a whole; set by [`crate::simulator::Simulator`].
    pub total: TotalContact,
    /// By what factor pressures and forces are larger than [`Contact::load`] has them: friction and a curved core, as finite
    /// elements have them.
    pub stiffened: f64,
    /// Largest pressure in view, kPa, if the model knows it.
    pub peak_pressure_kpa: Option<f64>,
    /// The surface between pixel centres, where it was sampled.
    pub subpixel: Option<Subpixel>,
    /// What the model says of its own solution.
    pub numerics: Numerics,
}

impl Contact {
    /// Multiplies pressures and forces.
    pub(crate) fn stiffen(&mut self, factor: f64) {
        self.stiffened *= factor;
        self.force_n = self.force_n.map(|force| factor * force);
        self.peak_pressure_kpa = self.peak_pressure_kpa.map(|peak| factor * peak);
        if let Some(pressure) = &mut self.pressure {
            pressure.data.iter_mut().for_each(|kpa| *kpa *= factor as f32);
        }
    }

    /// Lowest and highest displacement of the surface in view, mm; numbers that are none do not count.
    pub fn range_mm(&self) -> [f32; 2] {
        let Rect { x0, y0, x1, y1 } = self.region;
        let [up, down] = simd_dispatch(
            #[inline(always)]
            || {
                (y0..y1).fold([0.0_f32; 2], |[up, down], y| {
                    let row = &self.surface.row(y)[x0..x1];
                    [up.max(largest(row.iter().map(|w| -w))), down.max(largest(row.iter().copied()))]
                })
            },
        );
        // Not -0.0 where nothing rises.
        [0.0 - up, down]
    }
}

/// Honest numbers about a solution.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Numerics {
    /// The model reached its tolerance; true for models without iteration.
    pub converged: bool,
    /// Iterations taken; 0 for models without iteration.
    pub iterations: u32,
    /// Largest violation of the contact conditions, um, if the model has any.
    pub residual_um: Option<f64>,
    /// Largest error expected of the model's theory within 2 mm of the contact, um, or why it is not known.
    pub model_error_um: Result<f64, &'static str>,
}

impl Numerics {
    /// Those of a model that does not iterate and knows no error of its own.
    pub const DIRECT: Self = Self {
        converged: true,
        iterations: 0,
        residual_um: None,
        model_error_um: Err("the model of the gelpad knows no error of its own"),
    };
}

/// What [`Contact`] is without any: a flat pad.
pub fn untouched(width: usize, height: usize, force_n: Option<f64>, numerics: Numerics) -> Contact {
    Contact {
        surface: Grid::new(width + 2 * SURFACE_BORDER, height + 2 * SURFACE_BORDER),
        region: Rect::default(),
        bulge_mm: 0.0,
        finite: true,
        mask: Grid::new(width, height),
        load: None,
        tangential: None,
        pressure: None,
        force_n,
        total: TotalContact::default(),
        stiffened: 1.0,
        peak_pressure_kpa: force_n,
        subpixel: None,
        numerics,
    }
}
