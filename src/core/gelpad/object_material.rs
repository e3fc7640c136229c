//! Material of the object that is pressed into a gelpad.

use super::elastic::elastic_object::ElasticObject;
use super::elastic::shear::Friction;

/// Material of one object, as far as it differs from the default.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ObjectMaterial {
    /// Elasticity of the object; `None`: the object is rigid.
    pub soft: Option<ElasticObject>,
    /// Friction between pad and this object, if the model has friction; `None`: that of all objects.
    pub friction: Option<Friction>,
}
