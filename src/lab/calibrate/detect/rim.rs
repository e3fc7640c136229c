//! Refines a disc by the change across its rim. Inside the contact the pad follows the ball and the change is close to
//! linear; outside it falls. So there is a kink where the contact ends. The steepest fall, which people see as the edge
//! of the disc, is a little further out.

use super::change::BlockChange;
use super::fit::climb_hill;
use crate::presses::Circle;

/// Number of directions in which the rim is crossed.
const RAYS: usize = 64;
/// Distance inside and outside of the rim at which the change is compared, in radii: for the kink, and for the fall.
const KINK_OFFSET: f64 = 0.3;
const FALL_OFFSET: f64 = 0.15;
/// Radius at which people draw the circle, in radii of the ring across which the change falls most. Agrees with the
/// circles of three real sensors to 5 %.
const DRAWN_RADIUS: f64 = 0.883;

/// Unit vectors of all directions.
pub(super) struct RimRays([[f64; 2]; RAYS]);

impl RimRays {
    pub fn new() -> Self {
        Self(std::array::from_fn(|ray| {
            let angle = std::f64::consts::TAU * ray as f64 / RAYS as f64;
            [libm::cos(angle), libm::sin(angle)]
        }))
    }

    /// Returns the disc near `fitted` whose centre has the sharpest kink, with the radius at which people would see its
    /// edge.
    pub fn refine_circle(&self, change: &BlockChange, fitted: Circle) -> Circle {
        let Circle { centre_px, radius_px } = fitted;
        let near = |circle: Circle| {
            let away = (circle.centre_px[0] - centre_px[0]).hypot(circle.centre_px[1] - centre_px[1]);
            away <= 0.4 * radius_px && (0.55..1.15).contains(&(circle.radius_px / radius_px))
        };
        let score = |circle: Circle| if near(circle) { self.mean_kink(change, circle) } else { f64::NEG_INFINITY };
        let starts = [0.7, 0.85, 1.0].map(|by| Circle { centre_px, radius_px: by * radius_px });
        let tops = starts.map(|start| climb_hill(start, 0.06 * radius_px, 0.03, score));
        let (kink, _) = tops.into_iter().max_by(|a, b| a.1.total_cmp(&b.1)).expect("there are three");
        // The steepest fall lies outside the kink.
        let radii = (0..=100).map(|step| kink.radius_px * (1.0 + 0.005 * f64::from(step)));
        let falls = radii.map(|radius_px| (self.mean_fall(change, Circle { radius_px, ..kink }), radius_px));
        let (_, steepest) = falls.max_by(|a, b| a.0.total_cmp(&b.0)).expect("there are a hundred");
        Circle { radius_px: DRAWN_RADIUS * steepest, ..kink }
    }

    /// Mean size of the change's second difference across the rim.
    fn mean_kink(&self, change: &BlockChange, circle: Circle) -> f64 {
        self.mean_across_rim(change, circle, [1.0 - KINK_OFFSET, 1.0, 1.0 + KINK_OFFSET], [1.0, -2.0, 1.0])
    }

    /// Mean size of the change's difference across the rim.
    fn mean_fall(&self, change: &BlockChange, circle: Circle) -> f64 {
        self.mean_across_rim(change, circle, [1.0 - FALL_OFFSET, 1.0, 1.0 + FALL_OFFSET], [1.0, 0.0, -1.0])
    }

    /// Mean over the rays of the size of a weighted sum of the changes at three radii. Rays that leave the picture do
    /// not count. With few rays the mean is lowered, so that a circle out of view does not win.
    fn mean_across_rim(&self, change: &BlockChange, circle: Circle, radii: [f64; 3], weights: [f32; 3]) -> f64 {
        let Circle { centre_px: [cx, cy], radius_px } = circle;
        let (mut sum, mut seen) = (0.0, 0.0);
        for [dx, dy] in self.0 {
            let [a, b, c] = radii.map(|by| change.sample_at(cx + by * radius_px * dx, cy + by * radius_px * dy));
            if let (Some(a), Some(b), Some(c)) = (a, b, c) {
                let combined = std::array::from_fn(|k| weights[0] * a[k] + weights[1] * b[k] + weights[2] * c[k]);
                sum += super::change::change_energy(combined).sqrt();
                seen += 1.0;
            }
        }
        sum / (seen + 0.25 * RAYS as f64)
    }
}
