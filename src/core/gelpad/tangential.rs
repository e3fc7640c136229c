//! Motion of the pad's surface in its own plane: how far pressure pushes it aside, friction holds it back, and an
//! object that is moved or turned takes it along.

use super::elastic::in_plane::{DisplacementField, InPlaneResponse, Load};
use super::elastic::layer::ElasticLayer;
use super::elastic::placed::PlacedDisplacement;
use super::elastic::shear::{self, Friction, Motion};
use super::material::Material;
use super::planar::PlanarFrame;
use super::sliding::Sliding;
use super::traction_map::TractionMap;
use crate::effects::{Effect, EffectLog, Requirement};

/// Motion of the pad's surface in its own plane.
#[derive(Clone, Debug)]
pub struct TangentialMotion {
    /// The motion.
    pub field: DisplacementField,
    /// Result of the friction solver, if the object was moved or turned, or friction held the pad during the press.
    pub shear: Option<shear::ShearOutcome>,
    /// The tractions of that, with the pressure.
    pub tractions: Option<TractionMap>,
    /// The part of the motion that tractions cause; `None` if nothing asked for it.
    pub(crate) dragged: Option<DisplacementField>,
}

impl TangentialMotion {
    /// Sets apart the motion that tractions cause from that under the pressure alone.
    pub(crate) fn set_drag_apart(&mut self, in_plane: &InPlaneResponse, load: Option<&Load>) {
        let mut dragged = self.field.clone();
        if let Some(load) = load {
            dragged.subtract(&in_plane.under_pressure(load));
        }
        self.dragged = Some(dragged);
    }
}

/// Motion of an object in the pad's plane after the press, and the friction between pad and object.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Shear {
    /// The motion.
    pub motion: Motion,
    /// The friction.
    pub friction: Friction,
}

/// Computes how a press moves the pad in its plane; `None` if nothing shows it or the model does not compute it.
/// `shear` is `None` in jobs that move no object. `strain` is what rubber at finite strain adds to the motion under the
/// load, and whether it sticks to the object.
///
/// In a sequence, `carried` has the tractions from frame to frame.
///
/// With the friction `held` during the press, one friction model covers press and motion together: in the contact, the
/// object takes the surface along from where it was before the press.
pub fn solve_tangential_motion(
    in_plane: Option<&InPlaneResponse>,
    material: &Material,
    (load, strain): (Option<&Load>, Option<&([PlacedDisplacement; 2], bool)>),
    held: Option<Friction>,
    shear: Option<&Shear>,
    carried: Option<&Sliding>,
    effects: &mut EffectLog,
) -> Option<TangentialMotion> {
    if let Some(carried) = carried {
        effects.enable(Effect::Shear, Requirement::Absent("a sequence moves its object from frame to frame"));
        let field = effects.run_timed(Effect::Markers, || carried.displacement_field(in_plane?, load))?;
        return Some(TangentialMotion { field, shear: None, tractions: None, dragged: None });
    }
    let still = |shear: &Shear| shear.motion.shift_mm == [0.0; 2] && shear.motion.twist_rad == 0.0;
    let need = match (shear, in_plane, load) {
        (None, ..) => Requirement::Absent("the job moves no object"),
        (_, None, _) => Requirement::Absent("nothing shows it, or the gelpad model knows no traction"),
        (.., None) => Requirement::Unneeded("nothing touches the pad"),
        (Some(shear), ..) if still(shear) => Requirement::Unneeded("this sample's object is not moved"),
        _ => Requirement::Needed("the pad follows the object"),
    };
    let moves = effects.enable(Effect::Shear, need);
    let (in_plane, load) = in_plane.zip(load)?;
    let mut field = effects.run_timed(Effect::Markers, || in_plane.under_pressure(load));
    if let Some(([x, y], _)) = strain {
        field.add_placed(x, y);
    }
    // Friction that the press did without (see the effect log) does not hold the markers, either.
    let held = held.filter(|_| effects.notes[Effect::Friction].ran);
    // Rubber that sticks has moved with the object already.
    let held = held.filter(|_| strain.is_none_or(|(_, sticks)| !sticks));
    let moved = shear.filter(|_| moves);
    let friction = held.or(moved.map(|shear| shear.friction));
    let shear = friction.map(|friction| {
        let effect = if moved.is_some() { Effect::Shear } else { Effect::Friction };
        // The torque is taken about the object's point, also where the object is not moved.
        let about_mm = shear.map_or([0.0; 2], |shear| shear.motion.about_mm);
        let motion = moved.map_or(Motion { about_mm, ..Motion::default() }, |shear| shear.motion);
        effects.run_timed(effect, || {
            let pushed = held.is_some().then_some(&field);
            let (traction, pressure, outcome) =
                shear::solve_shear_from(ElasticLayer::new(material), load, motion, friction, pushed);
            field.add(&in_plane.under_traction(&traction));
            (outcome, TractionMap::new(traction, pressure, PlanarFrame::default(), material.youngs_modulus_kpa))
        })
    });
    let (shear, tractions) = shear.unzip();
    Some(TangentialMotion { field, shear, tractions, dragged: None })
}
