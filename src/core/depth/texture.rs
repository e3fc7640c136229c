//! Micro-texture: a fine relief cut into the object's surface, applied to its depth map.
//!
//! Peaks of the relief stay on the mesh and valleys lie the amplitude below, so an object never reaches deeper than its
//! mesh. Heights are along the pad's normal, not the object's, and the pattern is laid out in the pad's plane. This is
//! exact where the object faces the pad. On a flank inclined by t, the pattern is stretched by 1 / cos t along the
//! slope, and its depth across the surface is cos t times the amplitude. The model is gelsim's own.

use std::sync::Arc;

use glam::DVec3;

use super::Depth;
use super::chart_grid::ChartGrid;
use super::relief::{BLOCK_PX, Relief, ReliefLevel, tile_coordinate};
use crate::base::angle::sin_cos_deg;
use crate::base::grid::Grid;
use crate::base::simd::simd_dispatch;
use crate::base::view::View;
use crate::pose::{PadPlane, Pose};

/// A relief, and how it lies on the object.
#[derive(Clone, Debug)]
pub struct Texture {
    /// The pattern.
    pub relief: Arc<Relief>,
    /// How it lies on the object in this press.
    pub sample: TextureSample,
    /// Where the pattern's origin is. With `None` it is at the object's origin, and the pattern turns with the object.
    /// The two differ where an object rolls.
    pub placement: Option<TexturePlacement>,
}

/// Where a pattern lies in the pad's plane; on a curved gel, in the plane that the object is posed over.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TexturePlacement {
    /// Origin of the pattern, mm.
    pub origin_mm: [f64; 2],
    /// Rotation of the pattern, degrees from x towards y.
    pub yaw_deg: f64,
}

impl TexturePlacement {
    /// Places the pattern at an object's own origin on the flat pad.
    pub fn at_pose(pose: &Pose) -> Self {
        Self::at_pose_over(pose, &PadPlane::default())
    }

    /// Places the pattern at an object's own origin in a plane.
    pub(crate) fn at_pose_over(pose: &Pose, plane: &PadPlane) -> Self {
        let DVec3 { x, y, .. } = plane.point_in_plane(pose.translation_mm);
        Self { origin_mm: [x, y], yaw_deg: pose.angles.yaw_deg }
    }
}

impl Texture {
    /// Returns the texture with another placement.
    pub fn with_placement(&self, placement: TexturePlacement) -> Self {
        Self { placement: Some(placement), ..self.clone() }
    }
}

/// The texture of one press.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TextureSample {
    /// Height of peaks over valleys, mm; 0, a negative number or NaN cuts nothing.
    pub amplitude_mm: f64,
    /// The pattern's scale, mm; if it is 0 or not finite, the surface is lowered evenly.
    pub scale_mm: f64,
    /// Rotation on the object about z, degrees, from x towards y.
    pub angle_deg: f64,
    /// The point of the pattern's tile that lies at the object's origin, 0 to 1 along each side.
    pub offset: [f64; 2],
}

impl Relief {
    /// Cuts the relief into an object captured up to `above_mm` over the pad. `origin_mm` is the object's translation
    /// and `yaw_deg` its rotation, which the pattern follows. No value rises or falls below minus `above_mm`, and where
    /// there is no object nothing changes.
    pub fn cut(
        &self,
        cut: &TextureSample,
        origin_mm: [f64; 2],
        yaw_deg: f64,
        view: &View,
        above_mm: f64,
        depth: &mut Depth,
    ) {
        if cut.amplitude_mm > 0.0 {
            let amplitude = cut.amplitude_mm.min(f64::from(f32::MAX)) as f32;
            let level = self.level_for(cut.scale_mm, view.mm_per_px[0].max(view.mm_per_px[1]));
            let path = TileMapping::new(cut, origin_mm, yaw_deg, view, depth.margin_px, self.tile_mm(cut.scale_mm));
            let floor = 0.0 - above_mm as f32;
            simd_dispatch(
                #[inline(always)]
                || cut_relief(level, &path, amplitude, floor, &mut depth.penetration),
            );
            depth.measure();
        }
    }
}

/// Cuts a texture into an object captured along the normals of a curved gel, at the nodes of a chart; see
/// [`Relief::cut`]. The pattern is laid out in the plane that the object is posed over, and lies on the object's own
/// surface.
pub fn cut_along_normals(
    texture: &Texture,
    posed: &PosedObject<'_>,
    places: &ChartGrid<'_>,
    above_mm: f64,
    depth: &mut Depth,
) {
    let Texture { relief, sample: cut, placement } = texture;
    let cuts = cut.amplitude_mm > 0.0;
    if !cuts {
        return;
    }
    let TexturePlacement { origin_mm, yaw_deg } =
        placement.unwrap_or_else(|| TexturePlacement::at_pose_over(posed.pose, posed.plane));
    let amplitude = cut.amplitude_mm.min(f64::from(f32::MAX)) as f32;
    let level = relief.level_for(cut.scale_mm, places.spacing_mm[0].max(places.spacing_mm[1]));
    let tile_mm = relief.tile_mm(cut.scale_mm);
    let (sin, cos) = sin_cos_deg(yaw_deg + cut.angle_deg);
    let floor = 0.0 - above_mm as f32;
    for y in 0..depth.penetration.height {
        for (x, value) in depth.penetration.row_mut(y).iter_mut().enumerate().filter(|(_, value)| **value > floor) {
            let rest = places.chart.surface_frame((places.position_mm)([x, y]));
            let on_object = rest.point_mm - f64::from(*value) * rest.normal;
            let at = posed.plane.point_in_plane(on_object);
            let (x, y) = (at.x - origin_mm[0], at.y - origin_mm[1]);
            let on_tile = [(x * cos + y * sin) / tile_mm[0], (y * cos - x * sin) / tile_mm[1]];
            let valley = level.valley_at([0, 1].map(|k| tile_coordinate(on_tile[k] + cut.offset[k])));
            *value = (*value - amplitude * valley.min(1.0)).max(floor);
        }
    }
    depth.measure();
}

/// An object posed over a plane.
#[derive(Clone, Copy, Debug)]
pub struct PosedObject<'a> {
    /// Pose of the object in the sensor's frame.
    pub pose: &'a Pose,
    /// The plane.
    pub plane: &'a PadPlane,
}

/// Maps pixels to the tile, in units of tiles.
struct TileMapping {
    start: [f64; 2],
    per_column: [f64; 2],
    per_row: [f64; 2],
}

impl TileMapping {
    fn new(
        cut: &TextureSample,
        origin_mm: [f64; 2],
        yaw_deg: f64,
        view: &View,
        margin_px: usize,
        tile_mm: [f64; 2],
    ) -> Self {
        let (sin, cos) = sin_cos_deg(yaw_deg + cut.angle_deg);
        let on_tile = |[x, y]: [f64; 2]| [(x * cos + y * sin) / tile_mm[0], (y * cos - x * sin) / tile_mm[1]];
        let first: [f64; 2] = std::array::from_fn(|k| {
            let px = 0.5 - margin_px as f64 - view.resolution_px[k] as f64 / 2.0;
            px * view.mm_per_px[k] - origin_mm[k]
        });
        let start = on_tile(first);
        Self {
            start: [start[0] + cut.offset[0], start[1] + cut.offset[1]],
            per_column: on_tile([view.mm_per_px[0], 0.0]),
            per_row: on_tile([0.0, view.mm_per_px[1]]),
        }
    }

    /// Returns the tile coordinates of the first pixel of a row.
    fn row_start(&self, y: usize) -> [u32; 2] {
        std::array::from_fn(|k| tile_coordinate(self.start[k] + y as f64 * self.per_row[k]))
    }
}

#[inline(always)]
fn cut_relief(level: &ReliefLevel, path: &TileMapping, amplitude: f32, floor: f32, penetration: &mut Grid<f32>) {
    // Integer coordinates wrap around at the tile's side; a row is processed only where the object was captured.
    let step = path.per_column.map(tile_coordinate);
    let mut valleys = [0.0; BLOCK_PX];
    for y in 0..penetration.height {
        let start = path.row_start(y);
        let row = penetration.row_mut(y);
        // Only from the first to the last captured pixel of the row.
        let Some(first) = row.iter().position(|mm| *mm > floor) else { continue };
        let last = row.iter().rposition(|mm| *mm > floor).unwrap_or(first);
        for (block, part) in row[first..=last].chunks_mut(BLOCK_PX).enumerate() {
            let x = (first + block * BLOCK_PX) as u32;
            let start = [0, 1].map(|k| start[k].wrapping_add(step[k].wrapping_mul(x)));
            level.valleys_along(start, step, &mut valleys);
            for (value, valley) in part.iter_mut().zip(&valleys) {
                // Rounding may let the weights sum to slightly more than 1.
                let lowered = (*value - amplitude * valley.min(1.0)).max(floor);
                *value = if *value > floor { lowered } else { *value };
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::grid::{Rect, bounding_box};
    use crate::base::rng::random_stream;
    use crate::base::simd::scalar_only;
    use crate::depth::patterns::Procedural;

    const PATTERNS: [Procedural; 5] =
        [Procedural::Noise, Procedural::Brushed, Procedural::Knurled, Procedural::Woven, Procedural::Dimples];
    const CAMERA: View = View { resolution_px: [96, 64], mm_per_px: [0.03, 0.04] };
    const SQUARE: View = View { resolution_px: [96, 96], mm_per_px: [0.03, 0.03] };

    fn relief(pattern: Procedural) -> Relief {
        Relief::procedural(pattern)
    }

    fn texture(scale_mm: f64) -> TextureSample {
        TextureSample { amplitude_mm: 0.25, scale_mm, angle_deg: 25.0, offset: [0.3, 0.8] }
    }

    fn plate(view: &View) -> Depth {
        let [width, height] = view.resolution_px;
        let penetration = Grid { width, height, data: vec![1.0; width * height] };
        Depth { penetration, margin_px: 0, touching: Rect::whole(width, height), deepest_mm: 1.0, over_thickness_px: 0 }
    }

    fn textured(relief: &Relief, cut: &TextureSample, origin_mm: [f64; 2], yaw_deg: f64, view: &View) -> Grid<f32> {
        let mut depth = plate(view);
        relief.cut(cut, origin_mm, yaw_deg, view, 0.1, &mut depth);
        depth.penetration
    }

    /// Standard deviation.
    fn spread(values: &[f32]) -> f64 {
        let count = values.len() as f64;
        let mean = values.iter().map(|value| f64::from(*value)).sum::<f64>() / count;
        (values.iter().map(|value| (f64::from(*value) - mean).powi(2)).sum::<f64>() / count).sqrt()
    }

    /// Heights between -0.1 and 0.5 mm with holes at -0.1 mm, and a margin of two pixels.
    fn rough() -> Depth {
        let mut random = random_stream(3, "relief", 0);
        let mut penetration = Grid::new(100, 68);
        for value in &mut penetration.data {
            *value = (0.6 * random.uniform().min(0.8) as f32 + 0.02).min(0.45) - 0.1;
            if random.uniform() < 0.3 {
                *value = -0.1;
            }
        }
        penetration.row_mut(5).fill(-0.1);
        Depth { penetration, margin_px: 2, touching: Rect::whole(100, 68), deepest_mm: 0.5, over_thickness_px: 17 }
    }

    #[test]
    fn without_amplitude_no_bit_changes() {
        let relief = relief(Procedural::Knurled);
        for amplitude_mm in [0.0, -1.0, f64::NAN] {
            let mut depth = rough();
            relief.cut(&TextureSample { amplitude_mm, ..texture(0.3) }, [0.1, 0.2], 5.0, &CAMERA, 0.1, &mut depth);
            assert!(depth.penetration == rough().penetration, "{amplitude_mm}");
            assert_eq!(depth.deepest_mm, 0.5);
        }
    }

    #[test]
    fn nothing_rises_or_falls_by_more_than_the_amplitude_and_holes_stay() {
        for pattern in PATTERNS {
            let relief = relief(pattern);
            for scale_mm in [0.01, 0.2, 4.0] {
                let (before, mut after) = (rough(), rough());
                let cut = texture(scale_mm);
                relief.cut(&cut, [0.1, 0.2], 5.0, &CAMERA, 0.1, &mut after);
                for (old, new) in before.penetration.data.iter().zip(&after.penetration.data) {
                    let lowest = (old - cut.amplitude_mm as f32).max(-0.1);
                    assert!((lowest..=*old).contains(new), "{new} from {old}, {:?}", pattern);
                }
                assert!(before.penetration != after.penetration);
                let view = after.penetration.inner(2);
                assert_eq!(after.deepest_mm, view.data.iter().copied().fold(0.0, f32::max));
                assert_eq!(after.touching, bounding_box(&after.penetration, |mm| mm > 0.0));
                assert_eq!(after.over_thickness_px, 17);

                let mut same = rough();
                scalar_only(|| relief.cut(&cut, [0.1, 0.2], 5.0, &CAMERA, 0.1, &mut same));
                assert!(same.penetration == after.penetration, "other bits without AVX2");
            }
        }
    }

    #[test]
    fn the_pattern_moves_and_turns_with_the_object() {
        for pattern in PATTERNS {
            let (relief, cut) = (relief(pattern), texture(0.4));
            let near = |a: f32, b: f32| assert!((a - b).abs() < 1e-4, "{a} and {b}, {:?}", pattern);
            let here = textured(&relief, &cut, [0.1, 0.2], 5.0, &CAMERA);
            let there = textured(&relief, &cut, [0.1 + 7.0 * 0.03, 0.2 - 3.0 * 0.04], 5.0, &CAMERA);
            for y in 3..64 {
                for x in 0..96 - 7 {
                    near(there.at(x + 7, y - 3), here.at(x, y));
                }
            }
            let turned = textured(&relief, &cut, [0.0, 0.0], 95.0, &SQUARE);
            let straight = textured(&relief, &cut, [0.0, 0.0], 5.0, &SQUARE);
            for y in 0..96 {
                for x in 0..96 {
                    near(turned.at(95 - y, x), straight.at(x, y));
                }
            }
        }
    }

    #[test]
    fn a_wave_as_a_height_map_has_the_scale_as_its_period_and_runs_along_the_angle() {
        let wave = |turns: f64| 0.5 + 0.5 * libm::cos(std::f64::consts::TAU * turns);
        let mut heights = Grid::new(128, 128);
        for y in 0..128 {
            for x in 0..128 {
                heights.row_mut(y)[x] = 40.0 * wave(x as f64 / 128.0) as f32 - 3.0;
            }
        }
        let relief = Relief::from_heights(heights);
        let cut = TextureSample { offset: [0.25, 0.0], ..texture(0.7) };
        let (sin, cos) = sin_cos_deg(30.0 + cut.angle_deg);
        let penetration = textured(&relief, &cut, [0.2, -0.1], 30.0, &CAMERA);
        for y in 0..64 {
            for x in 0..96 {
                let (px, py) = ((x as f64 - 47.5) * 0.03 - 0.2, (y as f64 - 31.5) * 0.04 + 0.1);
                let expected = 1.0 - cut.amplitude_mm * (1.0 - wave((px * cos + py * sin) / 0.7 + 0.25));
                let found = f64::from(penetration.at(x, y));
                assert!((found - expected).abs() < 0.01 * cut.amplitude_mm, "{found} for {expected} at {x}, {y}");
            }
        }
    }

    #[test]
    fn regular_patterns_repeat_by_their_scale() {
        let rows = 0.75_f64.sqrt();
        let lattices = [
            (Procedural::Knurled, [1.0, 0.5 / rows], [2.0, 0.0]),
            (Procedural::Woven, [1.0, 1.0], [2.0, 0.0]),
            (Procedural::Dimples, [0.5, rows], [1.0, 0.0]),
        ];
        for (pattern, first, second) in lattices {
            let relief = relief(pattern);
            let cut = TextureSample { angle_deg: 0.0, ..texture(0.9) };
            let shifted = |by: [f64; 2]| {
                let there = textured(&relief, &cut, by.map(|scales| scales * 0.9), 0.0, &CAMERA);
                let here = textured(&relief, &cut, [0.0, 0.0], 0.0, &CAMERA);
                spread(&there.data.iter().zip(&here.data).map(|(a, b)| a - b).collect::<Vec<_>>())
            };
            let different = shifted(first.map(|scales| scales / 2.0));
            for by in [first, second] {
                assert!(shifted(by) < 0.05 * different, "{:?} {}", pattern, shifted(by));
            }
        }
    }

    #[test]
    fn a_pattern_far_below_the_pixel_only_lowers_the_surface() {
        for pattern in PATTERNS {
            let regular = matches!(pattern, Procedural::Knurled | Procedural::Woven | Procedural::Dimples);
            let scale_mm = if regular { 0.02 } else { 0.0004 };
            let penetration = textured(&relief(pattern), &texture(scale_mm), [0.0, 0.0], 0.0, &SQUARE);
            assert!(spread(&penetration.data) < 0.02 * 0.25, "{:?} {}", pattern, spread(&penetration.data));
            assert!((0.76..0.99).contains(&penetration.at(0, 0)), "{}", penetration.at(0, 0));
        }
    }

    #[test]
    fn pixels_are_close_to_the_mean_over_their_area_at_every_scale() {
        let fine = View { resolution_px: SQUARE.resolution_px.map(|px| 4 * px), mm_per_px: [0.03 / 4.0; 2] };
        for pattern in PATTERNS {
            let relief = relief(pattern);
            for (scale_mm, allowed) in [(0.045, 0.1), (0.06, 0.1), (0.08, 0.1), (0.11, 0.06), (0.2, 0.03), (0.5, 0.02)]
            {
                let pixels = textured(&relief, &texture(scale_mm), [0.0, 0.0], 0.0, &SQUARE);
                let parts = textured(&relief, &texture(scale_mm), [0.0, 0.0], 0.0, &fine);
                let mut errors = Vec::new();
                for y in 0..96 {
                    for x in 0..96 {
                        let mean = (0..16).map(|k| parts.at(4 * x + k % 4, 4 * y + k / 4)).sum::<f32>() / 16.0;
                        errors.push(pixels.at(x, y) - mean);
                    }
                }
                let error = spread(&errors) / 0.25;
                assert!(error < allowed, "{error} of {:?} at {scale_mm} mm", pattern);
            }
        }
    }

    #[test]
    fn periods_near_the_pixel_leave_no_moire() {
        let fine = View { resolution_px: SQUARE.resolution_px.map(|px| 4 * px), mm_per_px: [0.03 / 4.0; 2] };
        for pattern in [Procedural::Knurled, Procedural::Woven, Procedural::Dimples] {
            let relief = relief(pattern);
            for scale_mm in [0.028, 0.031, 0.033, 0.036] {
                let cut = TextureSample { angle_deg: 1.0, ..texture(scale_mm) };
                let pixels = textured(&relief, &cut, [0.0, 0.0], 0.0, &SQUARE);
                let parts = textured(&relief, &cut, [0.0, 0.0], 0.0, &fine);
                let points: Vec<f32> = (0..96 * 96).map(|k| parts.at(4 * (k % 96), 4 * (k / 96))).collect();
                assert!(spread(&points) > 0.1 * 0.25, "points do alias: {:?}", pattern);
                let left = spread(&pixels.data) / 0.25;
                assert!(left < 0.02, "{left} of {:?} at {scale_mm} mm", pattern);
            }
        }
    }

    #[test]
    fn finite_numbers_never_give_nan_and_images_may_be_of_one_pixel() {
        let relief = relief(Procedural::Woven);
        let tiny = View { resolution_px: [1, 1], mm_per_px: [0.03, 0.03] };
        let values = [0.0, -1.0, 1e-320, 1e-30, 0.3, 1e30, f64::MAX];
        for value in values {
            for other in values {
                for view in [&tiny, &CAMERA] {
                    let cut = TextureSample { amplitude_mm: value, scale_mm: other, angle_deg: value, ..texture(1.0) };
                    let penetration = textured(&relief, &cut, [other, -value], value, view);
                    assert!(penetration.data.iter().all(|mm| (-0.1..=1.0).contains(mm)), "{value} {other}");
                }
            }
        }
    }
}
