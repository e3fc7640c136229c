//! Finds the blocks of a chart's nodes that a part of an object may hit.

use glam::DVec3;

use crate::mesh::clusters::ClusterPart;

/// Number of blocks in a group, which are tested together.
const GROUP_BLOCKS: usize = 16;

/// Bounding boxes of groups of neighbouring blocks.
pub struct BlockGroups(Vec<[DVec3; 2]>);

/// Returns true if two boxes have no point in common.
#[inline(always)]
pub fn are_disjoint([min, max]: [DVec3; 2], [low, high]: [DVec3; 2]) -> bool {
    min.cmpgt(high).any() || max.cmplt(low).any()
}

impl BlockGroups {
    /// Groups blocks; each box contains everything that the normals of one block reach.
    pub fn new(boxes: &[[DVec3; 2]]) -> Self {
        Self(boxes.chunks(GROUP_BLOCKS).map(bounds_of).collect())
    }

    /// Returns the box around all groups.
    pub fn bounds(&self) -> [DVec3; 2] {
        bounds_of(&self.0)
    }

    /// Fills `corners` with the vertices of a part, transformed by `placed`, and `near` with the numbers of the blocks
    /// that it may hit.
    pub fn find_blocks_near(
        &self,
        boxes: &[[DVec3; 2]],
        part: ClusterPart<'_>,
        placed: impl Fn(DVec3) -> DVec3,
        corners: &mut Vec<DVec3>,
        near: &mut Vec<usize>,
    ) {
        let vertices = part.x.iter().zip(part.y).zip(part.z);
        corners.clear();
        corners.extend(vertices.map(|((x, y), z)| placed(DVec3::new((*x).into(), (*y).into(), (*z).into()))));
        let here = corners.iter().map(|corner| [*corner; 2]).fold(EMPTY_BOX, unite_boxes);
        near.clear();
        for (number, _) in self.0.iter().enumerate().filter(|(_, group)| !are_disjoint(here, **group)) {
            let blocks = number * GROUP_BLOCKS..((number + 1) * GROUP_BLOCKS).min(boxes.len());
            near.extend(blocks.filter(|block| !are_disjoint(here, boxes[*block])));
        }
    }
}

/// The box that contains no point.
const EMPTY_BOX: [DVec3; 2] = [DVec3::INFINITY, DVec3::NEG_INFINITY];

fn unite_boxes([low, high]: [DVec3; 2], [least, most]: [DVec3; 2]) -> [DVec3; 2] {
    [low.min(least), high.max(most)]
}

fn bounds_of(boxes: &[[DVec3; 2]]) -> [DVec3; 2] {
    boxes.iter().copied().fold(EMPTY_BOX, unite_boxes)
}
