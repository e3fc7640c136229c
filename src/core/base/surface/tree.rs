//! Boxes around the triangles of a gel's surface, halved again and again: where a line leaves it, and what of it is closest to
//! a point.

use glam::DVec3;

/// Triangles in a box that is not halved.
const FEW: usize = 4;

/// The boxes, each with those inside it behind it.
#[derive(Debug)]
pub struct Tree {
    nodes: Vec<Node>,
    /// Numbers of triangles, those of a box side by side.
    order: Vec<u32>,
}

#[derive(Clone, Copy, Debug)]
struct Node {
    low: DVec3,
    high: DVec3,
    /// The first of its triangles in `order`, and how many there are.
    first: usize,
    count: usize,
    /// The second of the boxes inside it; the first one is the next. 0 where there are none.
    second: usize,
}

impl Tree {
    /// Of triangles, by their corners.
    pub fn new(triangles: &[[DVec3; 3]]) -> Self {
        let mut tree = Self { nodes: Vec::new(), order: (0..triangles.len() as u32).collect() };
        tree.halve(triangles, 0, triangles.len());
        tree
    }

    /// Adds the box of some triangles and those inside it.
    fn halve(&mut self, triangles: &[[DVec3; 3]], first: usize, count: usize) {
        let corners = |number: &u32| triangles[*number as usize];
        let here = &mut self.order[first..first + count];
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for corner in here.iter().flat_map(corners) {
            (low, high) = (low.min(corner), high.max(corner));
        }
        let number = self.nodes.len();
        self.nodes.push(Node { low, high, first, count, second: 0 });
        if count > FEW {
            let axis = (high - low).max_position();
            let middle = |number: &u32| corners(number).iter().map(|corner| corner[axis]).sum::<f64>();
            // Equal ones by their numbers: the order depends on nothing else.
            here.select_nth_unstable_by(count / 2, |a, b| middle(a).total_cmp(&middle(b)).then(a.cmp(b)));
            self.halve(triangles, first, count / 2);
            self.nodes[number].second = self.nodes.len();
            self.halve(triangles, first + count / 2, count - count / 2);
        }
    }

    /// Visits the triangles of every box for which `enter` holds, which is asked again for those inside it.
    pub fn visit(&self, enter: impl Fn(DVec3, DVec3) -> bool, mut triangle: impl FnMut(usize)) {
        let mut open = vec![0];
        while let Some(number) = open.pop() {
            let Node { low, high, first, count, second } = self.nodes[number];
            if !enter(low, high) {
                continue;
            }
            match second {
                0 => self.order[first..first + count].iter().for_each(|number| triangle(*number as usize)),
                second => open.extend([second, number + 1]),
            }
        }
    }

    /// The same, the nearer box first: `distance` is that of a box, and one farther than `farthest` is passed by.
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
            let Node { first, count, second, .. } = self.nodes[number];
            if second == 0 {
                for number in &self.order[first..first + count] {
                    farthest = farthest.min(triangle(*number as usize));
                }
            } else {
                let mut inside = [(of(number + 1), number + 1), (of(second), second)];
                inside.sort_by(|a, b| b.0.total_cmp(&a.0));
                open.extend(inside);
            }
        }
    }
}
