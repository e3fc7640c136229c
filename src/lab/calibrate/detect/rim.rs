//! The rim of a disc from what happens across it. Inside the contact the pad follows the ball and the change is close
//! to linear; beyond, it falls. So there is a kink where the contact ends, and the steepest fall, where people see the
//! edge of the disc, is a little further out.

use super::change::Change;
use super::fit::climb;
use crate::presses::Circle;

/// Directions in which the rim is crossed.
const RAYS: usize = 64;
/// How far inside and outside of the rim the change is compared, in radii: for the kink and for the fall.
const KINK: f64 = 0.3;
const FALL: f64 = 0.15;
/// Where people draw the circle, in radii of the ring across which the change falls most: agrees with the circles
/// of three real sensors to 5 %.
const DRAWN: f64 = 0.883;

/// Directions, once for a search.
pub(super) struct Rays([[f64; 2]; RAYS]);

impl Rays {
    pub fn new() -> Self {
        Self(std::array::from_fn(|ray| {
            let angle = std::f64::consts::TAU * ray as f64 / RAYS as f64;
            [libm::cos(angle), libm::sin(angle)]
        }))
    }

    /// The disc near `fitted` with the sharpest kink as its centre, and the radius at which people would see its edge.
    pub fn refine(&self, change: &Change, fitted: Circle) -> Circle {
        let Circle { centre_px, radius_px } = fitted;
        let near = |circle: Circle| {
            let away = (circle.centre_px[0] - centre_px[0]).hypot(circle.centre_px[1] - centre_px[1]);
            away <= 0.4 * radius_px && (0.55..1.15).contains(&(circle.radius_px / radius_px))
        };
        let score = |circle: Circle| if near(circle) { self.kink(change, circle) } else { f64::NEG_INFINITY };
        let starts = [0.7, 0.85, 1.0].map(|by| Circle { centre_px, radius_px: by * radius_px });
        let tops = starts.map(|start| climb(start, 0.06 * radius_px, 0.03, score));
        let (kink, _) = tops.into_iter().max_by(|a, b| a.1.total_cmp(&b.1)).expect("there are three");
        let radii = (0..=100).map(|step| kink.radius_px * (1.0 + 0.005 * f64::from(step)));
        let falls = radii.map(|radius_px| (self.fall(change, Circle { radius_px, ..kink }), radius_px));
        let (_, steepest) = falls.max_by(|a, b| a.0.total_cmp(&b.0)).expect("there are a hundred");
        Circle { radius_px: DRAWN * steepest, ..kink }
    }

    /// Mean size of the second difference across the rim.
    fn kink(&self, change: &Change, circle: Circle) -> f64 {
        self.across(change, circle, [1.0 - KINK, 1.0, 1.0 + KINK], [1.0, -2.0, 1.0])
    }

    /// Mean size of the difference across the rim.
    fn fall(&self, change: &Change, circle: Circle) -> f64 {
        self.across(change, circle, [1.0 - FALL, 1.0, 1.0 + FALL], [1.0, 0.0, -1.0])
    }

    /// Mean over the rays of the size of a weighted sum of the changes at three radii. A ray that leaves the picture does
    /// not count, and few rays count less than many.
    fn across(&self, change: &Change, circle: Circle, radii: [f64; 3], weights: [f32; 3]) -> f64 {
        let Circle { centre_px: [cx, cy], radius_px } = circle;
        let (mut sum, mut seen) = (0.0, 0.0);
        for [dx, dy] in self.0 {
            let [a, b, c] = radii.map(|by| change.sample(cx + by * radius_px * dx, cy + by * radius_px * dy));
            if let (Some(a), Some(b), Some(c)) = (a, b, c) {
                let combined = std::array::from_fn(|k| weights[0] * a[k] + weights[1] * b[k] + weights[2] * c[k]);
                sum += super::change::energy(combined).sqrt();
                seen += 1.0;
            }
        }
        sum / (seen + 0.25 * RAYS as f64)
    }
}
