//! Which blocks of a chart's nodes a part of an object may meet.

use glam::DVec3;

use crate::mesh::clusters::Part;

/// Blocks that are passed over at once.
const GROUP: usize = 16;

/// Boxes around blocks that are next to each other.
pub struct Groups(Vec<[DVec3; 2]>);

/// True of two boxes that have nothing in common.
#[inline(always)]
pub fn apart([min, max]: [DVec3; 2], [low, high]: [DVec3; 2]) -> bool {
    min.cmpgt(high).any() || max.cmplt(low).any()
}

impl Groups {
    /// Of the boxes around what each block's normals reach.
    pub fn new(boxes: &[[DVec3; 2]]) -> Self {
        Self(boxes.chunks(GROUP).map(around).collect())
    }

    /// A box around all.
    pub fn all(&self) -> [DVec3; 2] {
        around(&self.0)
    }

    /// The corners of a part where it is `placed`, and the numbers of the blocks that it may meet.
    pub fn near_part(
        &self,
        boxes: &[[DVec3; 2]],
        part: Part<'_>,
        placed: impl Fn(DVec3) -> DVec3,
        corners: &mut Vec<DVec3>,
        near: &mut Vec<usize>,
    ) {
        let vertices = part.x.iter().zip(part.y).zip(part.z);
        corners.clear();
        corners.extend(vertices.map(|((x, y), z)| placed(DVec3::new((*x).into(), (*y).into(), (*z).into()))));
        let here = corners.iter().map(|corner| [*corner; 2]).fold(NONE, united);
        near.clear();
        for (number, _) in self.0.iter().enumerate().filter(|(_, group)| !apart(here, **group)) {
            let blocks = number * GROUP..((number + 1) * GROUP).min(boxes.len());
            near.extend(blocks.filter(|block| !apart(here, boxes[*block])));
        }
    }
}

/// The box around nothing.
const NONE: [DVec3; 2] = [DVec3::INFINITY, DVec3::NEG_INFINITY];

fn united([low, high]: [DVec3; 2], [least, most]: [DVec3; 2]) -> [DVec3; 2] {
    [low.min(least), high.max(most)]
}

fn around(boxes: &[[DVec3; 2]]) -> [DVec3; 2] {
    boxes.iter().copied().fold(NONE, united)
}
