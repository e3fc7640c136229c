//! Motion of the pad's surface in its own plane: what pressure pushes aside, what friction holds back, and what an object
//! that is pushed or turned takes along.

use super::elastic::inplane::{Field, InPlane, Load};
use super::elastic::layer::ElasticLayer;
use super::elastic::shear::{self, Friction, Motion};
use super::material::Material;
use super::sliding::Sliding;
use crate::effects::{Effect, EffectLog, Requirement};

/// Motion of the pad's surface in its own plane.
#[derive(Clone, Debug)]
pub struct TangentialMotion {
    /// The motion.
    pub field: Field,
    /// What friction did, if the object was pushed or turned, or friction held the pad while it was pressed in.
    pub shear: Option<shear::Outcome>,
}

/// How an object moves in the pad's plane after it was pressed in, and what holds the pad to it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Shear {
    /// The motion.
    pub motion: Motion,
    /// The friction.
    pub friction: Friction,
}

/// How a press moves the pad in its plane. `None` where nothing would show it, or no model knows. Without `shear` no press
/// of the kind has any.
///
/// In a sequence the tractions are `carried` from frame to frame.
///
/// With the friction `held` while pressing, one law holds for press and motion together: in the contact the surface goes
/// where the object takes it, from where it was before the press.
pub fn tangential(
    in_plane: Option<&InPlane>,
    material: &Material,
    load: Option<&Load>,
    held: Option<Friction>,
    shear: Option<&Shear>,
    carried: Option<&Sliding>,
    effects: &mut EffectLog,
) -> Option<TangentialMotion> {
    if let Some(carried) = carried {
        effects.enable(Effect::Shear, Requirement::Absent("a sequence moves its object from frame to frame"));
        let (in_plane, load) = in_plane.zip(load)?;
        let field = effects.timed(Effect::Markers, || carried.motion(in_plane, load));
        return Some(TangentialMotion { field, shear: None });
    }
    let still = |shear: &Shear| shear.motion.shift_mm == [0.0; 2] && shear.motion.twist_rad == 0.0;
    let need = match (shear, in_plane, load) {
        (None, ..) => Requirement::Absent("the job moves no object"),
        (_, None, _) => Requirement::Absent("no marker shows it, or the gelpad model knows no traction"),
        (.., None) => Requirement::Unneeded("nothing touches the pad"),
        (Some(shear), ..) if still(shear) => Requirement::Unneeded("this sample's object is not moved"),
        _ => Requirement::Needed("markers follow the object"),
    };
    let moves = effects.enable(Effect::Shear, need);
    let (in_plane, load) = in_plane.zip(load)?;
    let mut field = effects.timed(Effect::Markers, || in_plane.under_pressure(load));
    let held = held.filter(|_| effects.notes[Effect::Friction].ran);
    let moved = shear.filter(|_| moves);
    let friction = held.or(moved.map(|shear| shear.friction));
    let shear = friction.map(|friction| {
        let effect = if moved.is_some() { Effect::Shear } else { Effect::Friction };
        let motion = moved.map_or_else(Motion::default, |shear| shear.motion);
        effects.timed(effect, || {
            let pushed = held.is_some().then_some(&field);
            let (traction, outcome) = shear::shear_from(ElasticLayer::new(material), load, motion, friction, pushed);
            field.add(&in_plane.under_traction(&traction));
            outcome
        })
    });
    Some(TangentialMotion { field, shear })
}
