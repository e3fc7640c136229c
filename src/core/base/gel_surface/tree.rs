//! A tree of boxes around the triangles of a gel's surface, for finding where a line leaves it and which point is
//! closest to another.

use glam::DVec3;

/// Boxes with at most this many triangles are not divided.
const LEAF_TRIANGLES: usize = 4;

/// The tree; nodes are in depth-first order.
#[derive(Debug)]
pub struct TriangleTree {
    nodes: Vec<Node>,
    /// Numbers of the triangles; those of a box are next to each other.
    order: Vec<u32>,
}

#[derive(Clone, Copy, Debug)]
struct Node {
    low: DVec3,
    high: DVec3,
    /// The box's first triangle in `order`, and the number of its triangles.
    first: usize,
    count: usize,
    /// The node of the second inner box; the first one is the next node. 0 if the box is not divided.
    second_child: usize,
}

impl TriangleTree {
    /// Builds the tree over triangles given by their corners.
    pub fn new(triangles: &[[DVec3; 3]]) -> Self {
        let mut tree = Self { nodes: Vec::new(), order: (0..triangles.len() as u32).collect() };
        tree.add_box(triangles, 0, triangles.len());
        tree
    }

    /// Adds the box of some triangles, and the boxes inside it.
    fn add_box(&mut self, triangles: &[[DVec3; 3]], first: usize, count: usize) {
        let corners = |number: &u32| triangles[*number as usize];
        let here = &mut self.order[first..first + count];
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for corner in here.iter().flat_map(corners) {
            (low, high) = (low.min(corner), high.max(corner));
        }
        let number = self.nodes.len();
        self.nodes.push(Node { low, high, first, count, second_child: 0 });
        if count > LEAF_TRIANGLES {
            let axis = (high - low).max_position();
            let middle = |number: &u32| corners(number).iter().map(|corner| corner[axis]).sum::<f64>();
            // Equal ones are ordered by their numbers, so that the order is unique.
            here.select_nth_unstable_by(count / 2, |a, b| middle(a).total_cmp(&middle(b)).then(a.cmp(b)));
            self.add_box(triangles, first, count / 2);
            self.nodes[number].second_child = self.nodes.len();
            self.add_box(triangles, first + count / 2, count - count / 2);
        }
    }

    /// Calls `triangle` for the triangles of all boxes for which `enter` holds; `enter` is asked for each box within
    /// one that it accepted.
    pub fn visit_boxes(&self, enter: impl Fn(DVec3, DVec3) -> bool, mut triangle: impl FnMut(usize)) {
        let mut open = vec![0];
        while let Some(number) = open.pop() {
            let Node { low, high, first, count, second_child } = self.nodes[number];
            if !enter(low, high) {
                continue;
            }
            match second_child {
                0 => self.order[first..first + count].iter().for_each(|number| triangle(*number as usize)),
                second_child => open.extend([second_child, number + 1]),
            }
        }
    }

    /// Calls `triangle` for the triangles of all boxes closer than `farthest`, near boxes first. `distance` returns a
    /// box's distance; each call of `triangle` returns the new limit.
    pub fn visit_nearest(
        &self,
        distance: impl Fn(DVec3, DVec3) -> f64,
        mut farthest: f64,
        mut triangle: impl FnMut(usize) -> f64,
    ) {
        let of = |number: usize| distance(self.nodes[number].low, self.nodes[number].high);
        let mut open = vec![(of(0), 0)];
        while let Some((away, number)) = open.pop() {
            if away > farthest {
                continue;
            }
            let Node { first, count, second_child, .. } = self.nodes[number];
            if second_child == 0 {
                for number in &self.order[first..first + count] {
                    farthest = farthest.min(triangle(*number as usize));
                }
            } else {
                let mut inside = [(of(number + 1), number + 1), (of(second_child), second_child)];
                inside.sort_by(|a, b| b.0.total_cmp(&a.0));
                open.extend(inside);
            }
        }
    }
}
