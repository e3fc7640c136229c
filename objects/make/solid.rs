//! A closed surface under construction: faces given by their corners in millimetres, welded on a
//! grid of 1 um or 0.1 um, written as Wavefront OBJ.
//!
//! Shapes are drawn as on paper: x to the right, y up, z towards the pad. `obj` turns the drawing
//! half a turn about x into the convention of the files: y down, the contact side at the lowest z.

use std::collections::HashMap;
use std::fmt::Write;

use earcut::Earcut;

/// A point of the drawing plane, mm.
pub type P2 = [f64; 2];
/// A point in space, mm.
pub type P3 = [f64; 3];

/// Grid steps per millimetre: coordinates are written with at most four decimals.
pub const TICKS_PER_MM: f64 = 10_000.0;

/// Faces counter-clockwise from outside, over welded corners.
pub struct Solid {
    turn: [P3; 3],
    step: i64,
    points: Vec<[i64; 3]>,
    index: HashMap<[i64; 3], usize>,
    faces: Vec<Vec<usize>>,
    /// The file's origin in y is the middle; else where it was drawn.
    centred: bool,
}

impl Solid {
    /// An empty solid on a grid of 1 um, enough for flat faces and single curvature.
    pub fn new() -> Self {
        Self {
            turn: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            step: 10,
            points: Vec::new(),
            index: HashMap::new(),
            faces: Vec::new(),
            centred: true,
        }
    }

    /// An empty one that keeps its place along y.
    pub fn placed() -> Self {
        Self { centred: false, ..Self::new() }
    }

    /// An empty solid on a grid of 0.1 um, for small facets on a smooth surface.
    pub fn fine() -> Self {
        Self { step: 1, ..Self::new() }
    }

    /// From here on corners go through the rotation with these rows before they are welded.
    pub fn turned(self, rows: [P3; 3]) -> Self {
        Self { turn: rows, ..self }
    }

    /// Adds a triangle or quad, counter-clockwise from outside; corners that coincide on the grid
    /// are merged, and a face left with fewer than three is dropped.
    pub fn face(&mut self, corners: &[P3]) {
        let mut ids: Vec<usize> = corners.iter().map(|&p| self.corner(p)).collect();
        ids.dedup();
        if ids.len() > 1 && ids.first() == ids.last() {
            ids.pop();
        }
        if ids.len() < 3 {
            return;
        }
        // Readers split a quad along its first corner's diagonal: the shorter one follows a curved
        // surface better, unless the quad is folded over it.
        if ids.len() == 4 {
            let turned = [ids[1], ids[2], ids[3], ids[0]];
            let longer = self.diagonal(&ids) > self.diagonal(&turned);
            if self.folds(&ids) || longer && !self.folds(&turned) {
                ids.rotate_left(1);
            }
        }
        self.faces.push(ids);
    }

    /// Joins two closed loops of equal length by quads; outward when both run counter-clockwise
    /// seen from +z and `upper` is above, inward when the two are exchanged.
    pub fn band(&mut self, lower: &[P3], upper: &[P3]) {
        assert_eq!(lower.len(), upper.len());
        for i in 0..lower.len() {
            let j = (i + 1) % lower.len();
            self.face(&[lower[i], lower[j], upper[j], upper[i]]);
        }
    }

    /// Joins consecutive loops of a stack by bands.
    pub fn loft(&mut self, loops: &[Vec<P3>]) {
        for pair in loops.windows(2) {
            self.band(&pair[0], &pair[1]);
        }
    }

    /// Flat polygon with holes at height `z`, seen from +z; every outline counter-clockwise.
    pub fn cap_up(&mut self, outer: &[P2], holes: &[Vec<P2>], z: f64) {
        for corners in self.triangulate(outer, holes) {
            let face: Vec<P3> = corners.iter().map(|&[x, y]| [x, y, z]).collect();
            self.face(&face);
        }
    }

    /// Flat polygon with holes at height `z`, seen from -z; every outline counter-clockwise.
    pub fn cap_down(&mut self, outer: &[P2], holes: &[Vec<P2>], z: f64) {
        for corners in self.triangulate(outer, holes) {
            let face: Vec<P3> = corners.iter().rev().map(|&[x, y]| [x, y, z]).collect();
            self.face(&face);
        }
    }

    /// Triangles from every edge of a closed loop to `apex`; outward when the loop runs
    /// counter-clockwise seen from the outside.
    pub fn fan(&mut self, rim: &[P3], apex: P3) {
        for i in 0..rim.len() {
            self.face(&[rim[i], rim[(i + 1) % rim.len()], apex]);
        }
    }

    /// Triangles when every quad is split in two.
    pub fn triangle_count(&self) -> usize {
        self.faces.iter().map(|f| f.len() - 2).sum()
    }

    /// The file: one comment line, then vertices and faces, in mm; x and y centred unless placed, lowest z = 0.
    pub fn obj(&self, name: &str, what: &str) -> String {
        let low = |k: usize| self.points.iter().map(|p| p[k]).min().unwrap_or(0);
        let high = |k: usize| self.points.iter().map(|p| p[k]).max().unwrap_or(0);
        let mut middle = [0, 1].map(|k| (low(k) + high(k)).div_euclid(2));
        if !self.centred {
            middle[1] = 0;
        }
        let top = high(2);
        let mut text = format!("# {name}: {what}; unit mm\n");
        for &[x, y, z] in &self.points {
            text.push('v');
            for ticks in [x - middle[0], middle[1] - y, top - z] {
                text.push(' ');
                push_decimal(&mut text, ticks);
            }
            text.push('\n');
        }
        for face in &self.faces {
            text.push('f');
            for id in face {
                // Writing to a String cannot fail.
                let _ = write!(text, " {}", id + 1);
            }
            text.push('\n');
        }
        text
    }

    /// Counter-clockwise triangles, or the outline itself where it is a quad without holes.
    fn triangulate(&self, outer: &[P2], holes: &[Vec<P2>]) -> Vec<Vec<P2>> {
        if outer.len() == 4 && holes.is_empty() {
            return vec![outer.to_vec()];
        }
        let mut corners = outer.to_vec();
        let mut starts: Vec<usize> = Vec::new();
        for hole in holes {
            starts.push(corners.len());
            corners.extend(hole);
        }
        // In whole steps the predicates are exact: an ear here is an ear of the welded surface.
        let grid = |p: &P2| p.map(|mm| self.ticks(mm) as f64);
        let mut ids: Vec<usize> = Vec::new();
        Earcut::new().earcut(corners.iter().map(grid), &starts, &mut ids);
        ids.chunks_exact(3)
            .map(|t| {
                let [a, b, c] = [0, 1, 2].map(|k| grid(&corners[t[k]]));
                let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
                let order = if area > 0.0 { [0, 1, 2] } else { [0, 2, 1] };
                order.map(|k| corners[t[k]]).to_vec()
            })
            .collect()
    }

    fn ticks(&self, mm: f64) -> i64 {
        (mm * TICKS_PER_MM / self.step as f64).round() as i64 * self.step
    }

    fn corner(&mut self, p: P3) -> usize {
        let key = self.turn.map(|row| self.ticks(row[0] * p[0] + row[1] * p[1] + row[2] * p[2]));
        let next = self.points.len();
        let id = *self.index.entry(key).or_insert(next);
        if id == next {
            self.points.push(key);
        }
        id
    }

    /// Squared length of the diagonal from the first corner.
    fn diagonal(&self, quad: &[usize]) -> i64 {
        let (a, c) = (self.points[quad[0]], self.points[quad[2]]);
        (0..3).map(|k| (a[k] - c[k]).pow(2)).sum()
    }

    fn folds(&self, quad: &[usize]) -> bool {
        let [a, b, c, d] = [0, 1, 2, 3].map(|i| self.points[quad[i]].map(|t| t as f64));
        let (first, second) = (normal(a, b, c), normal(a, c, d));
        first[0] * second[0] + first[1] * second[1] + first[2] * second[2] <= 0.0
    }
}

/// The outline lifted to height `z`.
pub fn at(outline: &[P2], z: f64) -> Vec<P3> {
    outline.iter().map(|&[x, y]| [x, y, z]).collect()
}

fn normal(a: P3, b: P3, c: P3) -> P3 {
    let u = [b[0] - a[0], b[1] - a[1], b[2] - a[2]];
    let v = [c[0] - a[0], c[1] - a[1], c[2] - a[2]];
    [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
}

fn push_decimal(text: &mut String, ticks: i64) {
    let size = ticks.unsigned_abs();
    let digits = format!("{}.{:04}", size / 10_000, size % 10_000);
    if ticks < 0 {
        text.push('-');
    }
    text.push_str(digits.trim_end_matches('0').trim_end_matches('.'));
}
