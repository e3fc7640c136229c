//! What is pressed into a gelpad.

use super::elastic::shear::Friction;
use super::elastic::soft::ElasticObject;

/// What an object is made of, as far as it is not what others are.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ObjectMaterial {
    /// How it gives way; `None`: it is rigid.
    pub soft: Option<ElasticObject>,
    /// What holds the pad to it, where anything holds pads to objects; `None`: what holds them all.
    pub friction: Option<Friction>,
}
