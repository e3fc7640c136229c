//! Placement of labels: next to their points, clear of lines, marks and each other.
//!
//! Every label tries places around its point and takes the one that covers least. Labels are obstacles to later ones.

use crate::page::canvas::Point;

/// A rectangle of the plot, from its top left to its bottom right corner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Area {
    pub min: Point,
    pub max: Point,
}

impl Area {
    /// The area of `size` around `centre`.
    pub fn centred_at(centre: Point, size: [f64; 2]) -> Self {
        let half = size.map(|length| length / 2.0);
        Self { min: [centre[0] - half[0], centre[1] - half[1]], max: [centre[0] + half[0], centre[1] + half[1]] }
    }

    /// Point of the area that is nearest to `point`.
    pub fn nearest_point(&self, point: Point) -> Point {
        std::array::from_fn(|i| point[i].max(self.min[i]).min(self.max[i]))
    }

    /// Size of the intersection of two areas, square pixels.
    pub fn overlap_area(&self, other: &Self) -> f64 {
        let shared = |i: usize| (self.max[i].min(other.max[i]) - self.min[i].max(other.min[i])).max(0.0);
        shared(0) * shared(1)
    }
}

/// Areas that labels should not cover, with a cost per square pixel.
pub struct Obstacles {
    /// Area that labels should not leave.
    frame: Area,
    areas: Vec<(Area, f64)>,
}

impl Obstacles {
    /// Creates an empty set of obstacles.
    pub fn new(frame: Area) -> Self {
        Self { frame, areas: Vec::new() }
    }

    /// Adds an area.
    pub fn add_area(&mut self, area: Area, weight: f64) {
        self.areas.push((area, weight));
    }

    /// Adds a line through `points`; `weight` is the cost of covering a pixel of its length.
    pub fn add_line(&mut self, points: &[Point], weight: f64) {
        for ends in points.windows(2) {
            let [x, y] = ends[0];
            let way = [ends[1][0] - x, ends[1][1] - y];
            // Split into squares of about 3 px; dividing by 3 keeps the cost per pixel of length.
            let count = (way[0].hypot(way[1]) / 3.0).ceil();
            for step in 0..count as usize {
                let share = (step as f64 + 0.5) / count;
                self.add_area(Area::centred_at([x + share * way[0], y + share * way[1]], [3.0; 2]), weight / 3.0);
            }
        }
    }

    /// Chooses the best place for a label of `size` around `point`, which becomes an obstacle.
    pub fn place_label(&mut self, point: Point, size: [f64; 2]) -> Area {
        let mut places = Vec::new();
        for distance in [10.0, 17.0, 26.0, 40.0, 60.0, 85.0, 115.0, 150.0] {
            for step in 0..24 {
                let (dy, dx) = (std::f64::consts::TAU * f64::from(step) / 24.0).sin_cos();
                // Pushed out until a corner or a side of the label is `distance` away from the point.
                let push = 0.5 / dx.abs().max(dy.abs());
                let centre = [point[0] + dx * (distance + push * size[0]), point[1] + dy * (distance + push * size[1])];
                // A small preference: first near, then to the right, then above.
                places.push((Area::centred_at(centre, size), distance + 2.0 * (1.0 - dx) + (1.0 + dy)));
            }
        }
        let cost = |(place, dislike): &(Area, f64)| {
            let size = (place.max[0] - place.min[0]) * (place.max[1] - place.min[1]);
            let outside = 100.0 * (size - place.overlap_area(&self.frame));
            let areas: f64 = self.areas.iter().map(|(area, weight)| weight * place.overlap_area(area)).sum();
            dislike + outside + areas
        };
        let (best, _) = places.into_iter().min_by(|a, b| cost(a).total_cmp(&cost(b))).expect("there are places");
        let kept_free = Area { min: best.min.map(|edge| edge - 4.0), max: best.max.map(|edge| edge + 4.0) };
        self.areas.push((kept_free, 20.0));
        best
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAME: Area = Area { min: [0.0, 0.0], max: [400.0, 300.0] };

    #[test]
    fn labels_of_one_point_keep_clear_of_each_other_and_inside() {
        let mut obstacles = Obstacles::new(FRAME);
        let point = [395.0, 5.0];
        let placed: Vec<Area> = (0..5).map(|_| obstacles.place_label(point, [80.0, 30.0])).collect();
        for (i, a) in placed.iter().enumerate() {
            assert_eq!(a.overlap_area(&FRAME).round(), 2400.0, "{a:?}");
            assert!(placed[..i].iter().all(|b| a.overlap_area(b) < 1e-9), "{placed:?}");
        }
    }

    #[test]
    fn a_label_avoids_lines() {
        let mut obstacles = Obstacles::new(FRAME);
        for x in (205..400).step_by(5) {
            obstacles.add_line(&[[f64::from(x), 0.0], [f64::from(x), 300.0]], 1.0);
        }
        assert!(obstacles.place_label([200.0, 150.0], [60.0, 20.0]).max[0] < 205.0);
    }
}
