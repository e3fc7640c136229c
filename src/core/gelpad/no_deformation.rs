//! A pad that does not deform around the object: its surface is the object where the object reaches into the pad, and
//! flat elsewhere. This is the crudest model; it takes almost no time and keeps every edge as sharp as the object's.

use serde::{Deserialize, Serialize};

use super::{Contact, Numerics, no_contact};
use crate::base::view::SURFACE_BORDER;
use crate::depth::Depth;

/// Parameters of the model without deformation; there are none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(default, deny_unknown_fields)]
pub struct NoDeformation {}

/// Presses the object into the pad.
pub fn press(depth: &Depth) -> Contact {
    let margin = depth.margin_px;
    let (width, height) = (depth.penetration.width - 2 * margin, depth.penetration.height - 2 * margin);
    let mut contact = no_contact(width, height, None, Numerics::DIRECT);
    let corner = margin.saturating_sub(SURFACE_BORDER);
    let (surface, mask) = (&mut contact.surface, &mut contact.mask);
    contact.region = depth.touching.in_window(corner, corner, surface.width, surface.height);
    for y in contact.region.y0..contact.region.y1 {
        let columns = contact.region.x0..contact.region.x1;
        let object = &depth.penetration.row(corner + y)[corner + columns.start..corner + columns.end];
        for (surface, penetration) in surface.row_mut(y)[columns].iter_mut().zip(object) {
            *surface = penetration.max(0.0);
        }
    }
    let view = depth.touching.in_window(margin, margin, width, height);
    for y in view.y0..view.y1 {
        let object = &depth.penetration.row(margin + y)[margin + view.x0..margin + view.x1];
        for (mask, penetration) in mask.row_mut(y)[view.x0..view.x1].iter_mut().zip(object) {
            *mask = if *penetration > 0.0 { 255 } else { 0 };
        }
    }
    contact
}
