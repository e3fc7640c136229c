//! Cast shadows against rays marched in f64 and against walls, whose shadows are known.

use gelsim_core::base::grid::{Grid, Rect};
use gelsim_core::base::simd::scalar_only;
use gelsim_core::base::view::SURFACE_BORDER;
use gelsim_core::optics::shadow::{ShadowCaster, ShadowScratch, SteepestSlopes, compute_visible_shares};

use gelsim_oracle::marched_rays::{Led, marched_shares};
use gelsim_oracle::shapes::Random;

const AZIMUTHS: [f64; 10] = [0.0, 90.0, 180.0, 270.0, 30.0, 45.0, 120.0, 240.0, 277.3, 341.0];

fn caster(led: Led) -> ShadowCaster {
    ShadowCaster::new(led.azimuth, led.elevation, [led.size; 2], led.pitch)
}

/// What a part of the view sees of the LED.
fn visible_shares(led: Led, surface: &Grid<f32>, region: Rect, scratch: &mut ShadowScratch) -> Vec<f32> {
    compute_visible_shares(&[Some(caster(led))], surface, region, scratch).remove(0)
}

/// What the view sees of the LED.
fn shares(led: Led, surface: &Grid<f32>) -> Grid<f32> {
    let (width, height) = (surface.width - 2 * SURFACE_BORDER, surface.height - 2 * SURFACE_BORDER);
    let data = visible_shares(led, surface, Rect::whole(width, height), &mut ShadowScratch::default());
    Grid { width, height, data }
}

/// A surface around a view of `width` x `height` pixels; `value` by column and row from the view's first pixel.
fn surface_of(width: usize, height: usize, value: impl Fn(f64, f64) -> f64) -> Grid<f32> {
    let mut surface = Grid::new(width + 2 * SURFACE_BORDER, height + 2 * SURFACE_BORDER);
    for y in 0..surface.height {
        for x in 0..surface.width {
            surface.row_mut(y)[x] = value(x as f64 - SURFACE_BORDER as f64, y as f64 - SURFACE_BORDER as f64) as f32;
        }
    }
    surface
}

/// By how much `found` leaves the range of what `expected` has within one pixel: largest and on the mean.
fn outside(found: &Grid<f32>, expected: &Grid<f64>) -> (f64, f64) {
    let (mut largest, mut sum) = (0.0_f64, 0.0);
    for y in 0..found.height {
        for x in 0..found.width {
            let around = Rect { x0: x, y0: y, x1: x + 1, y1: y + 1 }.grown(1, found.width, found.height);
            let near = expected.crop(around);
            let low = near.data.iter().copied().fold(f64::INFINITY, f64::min);
            let high = near.data.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let share = f64::from(found.at(x, y));
            let off = (low - share).max(share - high).max(0.0);
            largest = largest.max(off);
            sum += off;
        }
    }
    (largest, sum / found.data.len() as f64)
}

fn mean_difference(found: &Grid<f32>, expected: &Grid<f64>) -> f64 {
    let differences = found.data.iter().zip(&expected.data).map(|(a, b)| (f64::from(*a) - b).abs());
    differences.sum::<f64>() / found.data.len() as f64
}

/// The dent of a ball: its cap and a smooth skirt.
fn dent(x: f64, y: f64, radius: f64, depth: f64) -> f64 {
    let r = x.hypot(y);
    let (edge, pressed) = ((2.0 * radius * depth).sqrt() * 0.7, depth - radius);
    let cap = |r: f64| pressed + (radius * radius - r * r).sqrt();
    if r < edge { cap(r) } else { cap(edge) * (-(r - edge) / (1.2 * edge)).exp() }
}

/// A dent, an upright block, and bumps and hollows that reach beyond the view.
fn surfaces() -> [Grid<f32>; 3] {
    let mut random = Random(5);
    let bump = |_| [(0.0, 97.0), (0.0, 83.0), (2.0, 9.0), (-0.2, 0.7)].map(|(min, max)| random.within(min, max));
    let bumps: Vec<[f64; 4]> = (0..12).map(bump).collect();
    let block = |x, y| (30.0..60.0).contains(&x) && (25.0..50.0).contains(&y);
    [
        surface_of(97, 83, |x, y| dent((x - 47.0) * 0.06, (y - 40.0) * 0.05, 2.35, 0.8)),
        surface_of(97, 83, |x, y| if block(x, y) { 0.4 } else { 0.0 }),
        surface_of(97, 83, |x, y| {
            let height = |[bx, by, r, h]: &[f64; 4]| h * (-((x - bx).powi(2) + (y - by).powi(2)) / (r * r)).exp();
            bumps.iter().map(height).sum()
        }),
    ]
}

#[test]
fn the_sweep_sees_what_marched_rays_see_within_a_pixel() {
    for surface in surfaces() {
        for elevation in [8.53, 20.0, 45.0] {
            for azimuth in [0.0, 90.0, 45.0, 120.0, 277.3] {
                let led = Led { azimuth, elevation, size: 5.0, pitch: [0.06, 0.05] };
                let (found, expected) = (shares(led, &surface), marched_shares(led, &surface));
                let (largest, mean) = outside(&found, &expected);
                // Where penumbras overlap one obstacle stands for all.
                assert!(largest < 0.7 && mean < 5e-4, "{led:?}: {largest} and {mean} beyond the neighbours");
                let difference = mean_difference(&found, &expected);
                assert!(difference < 0.012, "{led:?}: {difference}");
            }
        }
    }
}

#[test]
fn a_wall_casts_a_shadow_of_its_height_over_the_tangent_with_a_linear_penumbra() {
    let (height_mm, pitch) = (0.3, 0.02);
    for azimuth in [0.0, 90.0, 180.0, 270.0] {
        let led = Led { azimuth, elevation: 9.0, size: 6.0, pitch: [pitch; 2] };
        let towards = |x: f64, y: f64| match azimuth as u32 {
            0 => x,
            90 => y,
            180 => 199.0 - x,
            _ => 199.0 - y,
        };
        let surface = surface_of(200, 200, |x, y| if towards(x, y) >= 190.0 { height_mm } else { 0.0 });
        let found = shares(led, &surface);
        let [lowest, highest] = led.slopes();
        let (umbra, penumbra) = (height_mm / highest, height_mm / lowest);
        let mut partial = 0;
        for y in 0..200 {
            for x in 0..200 {
                let distance = (190.0 - towards(x as f64, y as f64)) * pitch;
                let share = f64::from(found.at(x, y));
                let expected = if distance <= 0.0 || distance >= penumbra {
                    1.0
                } else if distance <= umbra {
                    0.0
                } else {
                    (highest - height_mm / distance) / (highest - lowest)
                };
                partial += usize::from(share > 0.0 && share < 1.0);
                assert!((share - expected).abs() < 1e-4, "{azimuth}: {share} at {distance} mm, not {expected}");
            }
        }
        assert!(partial > 70 * 200, "{azimuth}: the penumbra has {partial} pixels");
    }
}

/// Share of a disc's width that a straight edge hides, the edge `aside` half widths from its middle.
fn share_behind_edge(aside: f64) -> f64 {
    let a = aside.clamp(-1.0, 1.0);
    0.5 - (a * (1.0 - a * a).sqrt() + a.asin()) / std::f64::consts::PI
}

#[test]
fn a_long_shadows_side_softens_in_proportion_to_the_distance() {
    let (pitch, size) = (0.02, 12.0);
    for azimuth in [0.0, 90.0, 180.0, 270.0] {
        let led = Led { azimuth, elevation: 9.0, size, pitch: [pitch; 2] };
        let seen_from = |x: f64, y: f64| match azimuth as u32 {
            0 => (x, y),
            90 => (y, x),
            180 => (299.0 - x, y),
            _ => (299.0 - y, x),
        };
        let place = |towards: usize, aside: usize| match azimuth as u32 {
            0 => (towards, aside),
            90 => (aside, towards),
            180 => (299 - towards, aside),
            _ => (aside, 299 - towards),
        };
        let block = |(towards, aside): (f64, f64)| towards >= 290.0 && aside >= 150.0;
        let surface = surface_of(300, 300, |x, y| if block(seen_from(x, y)) { 2.0 } else { 0.0 });
        let found = shares(led, &surface);
        for distance in [2, 8, 30, 60, 100, 200] {
            let half_px = distance as f64 * (0.5 * size).to_radians().tan();
            for aside in 0..300 {
                let (x, y) = place(290 - distance, aside);
                let off = (149.5 - aside as f64) / half_px;
                let (share, expected) = (f64::from(found.at(x, y)), 1.0 - share_behind_edge(off));
                let edge = 0.5 / half_px.max(1.0);
                assert!(
                    (share - expected).abs() < 0.06 + edge,
                    "{azimuth}, {distance} px: {share}, not {expected}, {off}"
                );
                let sure = off.abs() > 2.5 + 2.0 / half_px;
                assert!(
                    !sure || share == if off > 0.0 { 1.0 } else { 0.0 },
                    "{azimuth}, {distance} px: {share} at {off}"
                );
            }
        }
    }
}

#[test]
fn a_surface_that_slopes_sideways_is_not_shaded_by_itself() {
    let pitch = [0.03, 0.03];
    for azimuth in [0.0, 90.0, 180.0, 270.0] {
        let (sin, cos) = f64::to_radians(azimuth).sin_cos();
        let led = Led { azimuth, elevation: 8.5, size: 10.0, pitch };
        let surface = surface_of(90, 90, |x, y| 0.6 * (x * pitch[0] * sin + y * pitch[1] * cos).abs());
        assert!(shares(led, &surface).data.iter().all(|share| *share == 1.0), "{azimuth}");
    }
}

#[test]
fn no_shadow_reaches_further_than_said() {
    for azimuth in AZIMUTHS {
        let led = Led { azimuth, elevation: 14.0, size: 8.0, pitch: [0.03, 0.04] };
        let inside = |x: f64, y: f64| ((x - 80.0) * 0.03).hypot((y - 60.0) * 0.04);
        let surface = surface_of(161, 121, |x, y| if inside(x, y) < 0.3 { 0.25 } else { 0.0 });
        let [[left, right], [up, down]] = caster(led).shadow_extent_px(0.25);
        let found = shares(led, &surface);
        let mut furthest = 0.0_f64;
        for at in (0..found.data.len()).filter(|at| found.data[*at] < 1.0) {
            let [x, y] = [at % 161, at / 161].map(|at| at as f64);
            // Interpolation carries a trace one pixel further, the disc is 10 by 7.5 pixels.
            let within = |at: f64, from: f64, to: f64, middle: f64, radius: f64| {
                (from - radius - 1.0..=to + radius + 1.0).contains(&(at - middle))
            };
            assert!(within(x, left, right, 80.0, 10.0) && within(y, up, down, 60.0, 7.5), "{azimuth}: {x}, {y}");
            furthest = furthest.max(inside(x, y));
        }
        let reach = 0.25 / led.slopes()[0];
        assert!(furthest > 0.8 * reach, "{azimuth}: {furthest} of {reach}");
    }
    let caster = ShadowCaster::new(0.0, 0.0, [0.0; 2], [1.0; 2]);
    assert!(caster.shadow_extent_px(1.0)[0][0].is_finite() && caster.shadow_extent_px(-1.0) == [[0.0; 2]; 2]);
}

#[test]
fn an_led_that_casts_nothing_is_seen_whole_everywhere() {
    let mut random = Random(11);
    let mut counts = [0; 2];
    for _ in 0..3000 {
        let [width, height] = [1 + random.below(14), 1 + random.below(14)];
        let pitch = [random.within(0.01, 0.1), random.within(0.01, 0.1)];
        let led = Led {
            azimuth: if random.below(3) == 0 { 90.0 * random.below(4) as f64 } else { random.within(0.0, 360.0) },
            elevation: random.within(0.0, 30.0),
            size: random.within(0.0, 10.0),
            pitch,
        };
        let slope = 0.5 * random.unit().powi(2);
        let lift = random.within(-3.0, 3.0);
        let rough = random.below(2) == 0;
        let tilt = random.within(0.0, 360.0).to_radians();
        let mut surface =
            surface_of(width, height, |x, y| lift + slope * (x * pitch[0] * tilt.cos() + y * pitch[1] * tilt.sin()));
        if rough {
            let most = slope * pitch[0].min(pitch[1]);
            surface.data.iter_mut().for_each(|value| *value = random.within(0.0, most) as f32);
        }
        let casts = caster(led).casts_shadow(&SteepestSlopes::new(&surface, pitch));
        counts[usize::from(casts)] += 1;
        let found = shares(led, &surface);
        assert!(casts || found.data.iter().all(|share| *share == 1.0), "{led:?}, slope {slope}");
    }
    assert!(counts[0] > 500 && counts[1] > 500, "{counts:?}");
}

#[test]
fn a_slope_casts_exactly_if_it_rises_faster_than_the_lowest_ray() {
    let pitch = [0.03, 0.04];
    for azimuth in AZIMUTHS {
        let led = Led { azimuth, elevation: 10.0, size: 4.0, pitch };
        let (sin, cos) = f64::to_radians(azimuth).sin_cos();
        for (share_of_lowest, expected) in [(0.98, false), (1.02, true), (-3.0, false)] {
            let slope = share_of_lowest * led.slopes()[0];
            let surface = surface_of(40, 30, |x, y| slope * (x * pitch[0] * cos + y * pitch[1] * sin));
            let casts = caster(led).casts_shadow(&SteepestSlopes::new(&surface, pitch));
            assert_eq!(casts, expected, "{azimuth}, {share_of_lowest}");
            assert_eq!(shares(led, &surface).data.iter().any(|share| *share < 1.0), expected);
        }
    }
}

#[test]
fn the_steepest_rises_are_those_of_a_plain_loop() {
    let mut random = Random(3);
    for [width, height] in [[1, 1], [1, 7], [7, 1], [17, 3], [33, 35], [101, 64]] {
        let data = (0..width * height).map(|_| random.within(-2.0, 1.0) as f32).collect();
        let surface = Grid { width, height, data };
        let found = SteepestSlopes::new(&surface, [0.5, 0.25]);
        let mut expected = SteepestSlopes { longest_px: width.max(height), ..SteepestSlopes::default() };
        let [mut highest, mut lowest] = [0.0_f32; 2];
        for y in 0..height {
            for x in 0..width {
                let here = surface.at(x, y);
                expected.largest_mm = expected.largest_mm.max(here.abs());
                (highest, lowest) = (highest.max(here), lowest.min(here));
                if x + 1 < width {
                    expected.right = expected.right.max((surface.at(x + 1, y) - here) * 2.0);
                    expected.left = expected.left.max((here - surface.at(x + 1, y)) * 2.0);
                }
                if y + 1 < height {
                    expected.down = expected.down.max((surface.at(x, y + 1) - here) * 4.0);
                    expected.up = expected.up.max((here - surface.at(x, y + 1)) * 4.0);
                }
            }
        }
        (expected.highest_mm, expected.span_mm) = (highest, highest - lowest);
        assert_eq!(found, expected, "{width} x {height}");
    }
}

#[test]
fn mirrored_and_transposed_surfaces_have_mirrored_and_transposed_shadows() {
    let close = |a: &Grid<f32>, b: &Grid<f32>| {
        let differences: Vec<f32> = a.data.iter().zip(&b.data).map(|(a, b)| (a - b).abs()).collect();
        (a.width, a.height) == (b.width, b.height)
            && differences.iter().sum::<f32>() < 1e-4 * differences.len() as f32
            && differences.iter().filter(|difference| **difference > 1e-3).count() * 1000 <= differences.len()
    };
    let changed = |grid: &Grid<f32>, [width, height]: [usize; 2], from: &dyn Fn(usize, usize) -> (usize, usize)| {
        let place = |at: usize| from(at % width, at / width);
        let data = (0..width * height).map(|at| grid.at(place(at).0, place(at).1)).collect();
        Grid { width, height, data }
    };
    for surface in surfaces() {
        let Grid { width, height, .. } = surface;
        for azimuth in AZIMUTHS.into_iter().filter(|azimuth| *azimuth != 45.0) {
            let led = Led { azimuth, elevation: 12.0, size: 5.0, pitch: [0.05; 2] };
            let plain = shares(led, &surface);
            let size = [plain.width, plain.height];
            let mirrored = changed(&surface, [width, height], &|x, y| (width - 1 - x, y));
            let expected = changed(&plain, size, &|x, y| (size[0] - 1 - x, y));
            assert!(
                close(&shares(Led { azimuth: 180.0 - azimuth, ..led }, &mirrored), &expected),
                "{azimuth} mirrored"
            );
            let transposed = changed(&surface, [height, width], &|x, y| (y, x));
            let expected = changed(&plain, [size[1], size[0]], &|x, y| (y, x));
            assert!(close(&shares(Led { azimuth: 90.0 - azimuth, ..led }, &transposed), &expected), "{azimuth} turned");
        }
    }
}

#[test]
fn a_part_of_the_view_has_the_shadows_of_the_whole() {
    let mut scratch = ShadowScratch::default();
    for surface in surfaces() {
        for azimuth in AZIMUTHS {
            let led = Led { azimuth, elevation: 10.0, size: 5.0, pitch: [0.05, 0.06] };
            let whole = shares(led, &surface);
            for rect in [[0, 0, 97, 83], [0, 0, 2, 83], [95, 3, 97, 83], [40, 41, 41, 42], [13, 17, 50, 80]] {
                let [x0, y0, x1, y1] = rect;
                let region = Rect { x0, y0, x1, y1 };
                let part = visible_shares(led, &surface, region, &mut scratch);
                assert_eq!(part, whole.crop(region).data, "{azimuth} {region:?}");
            }
            assert!(visible_shares(led, &surface, Rect::default(), &mut scratch).is_empty());
        }
    }
}

#[test]
fn a_micrometres_thousandth_moves_shares_little() {
    for surface in surfaces() {
        for azimuth in AZIMUTHS {
            let led = Led { azimuth, elevation: 10.0, size: 5.0, pitch: [0.05, 0.06] };
            let mut moved = surface.clone();
            let mut random = Random(17);
            moved.data.iter_mut().for_each(|height| *height += random.within(-1e-6, 1e-6) as f32);
            let (before, after) = (shares(led, &surface), shares(led, &moved));
            let changes = before.data.iter().zip(&after.data).map(|(a, b)| f64::from(a - b).abs());
            // Two obstacles can be level for the lowest ray; which of them counts then is decided by a hair.
            let (jumps, rest): (Vec<f64>, Vec<f64>) = changes.partition(|change| *change > 2e-3);
            assert!(jumps.len() * 2000 < before.data.len(), "{azimuth}: {} jumps", jumps.len());
            assert!(rest.iter().sum::<f64>() < 1e-5 * rest.len() as f64, "{azimuth}");
        }
    }
}

#[test]
fn shares_are_shares_whatever_the_image_and_the_led() {
    let mut random = Random(23);
    let elevations = [0.0, 0.1, 45.0, 89.0, 90.0, -5.0, 200.0];
    for [width, height] in [[1, 1], [1, 640], [640, 1], [3, 5], [31, 37], [8, 16]] {
        for scale in [0.0, 1e-30, 1e-3, 1.0, 1e6, 1e30] {
            let surface = surface_of(width, height, |_, _| 0.0);
            let data = surface.data.iter().map(|_| (scale * random.within(-1.0, 1.0)) as f32).collect();
            let surface = Grid { data, ..surface };
            for azimuth in AZIMUTHS.into_iter().chain([-90.0, 450.0, 135.0, 1e9]) {
                for elevation in elevations {
                    for (size, pitch) in [(0.0, [0.03, 0.03]), (400.0, [1e-5, 30.0]), (3.0, [50.0, 1e-4])] {
                        let led = Led { azimuth, elevation, size, pitch };
                        let found = shares(led, &surface);
                        assert_eq!(found.data.len(), width * height);
                        assert!(found.data.iter().all(|share| (0.0..=1.0).contains(share)), "{led:?}, {scale}");
                        assert!(scale > 0.0 || found.data.iter().all(|share| *share == 1.0), "{led:?}");
                    }
                }
            }
        }
    }
    let mut broken = surface_of(9, 9, |_, _| 0.0);
    for (at, value) in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY].into_iter().enumerate() {
        broken.row_mut(4)[at + 3] = value;
    }
    for [azimuth, elevation, size] in [[30.0, 9.0, 3.0], [f64::NAN, 9.0, 3.0], [0.0, f64::NAN, f64::INFINITY]] {
        let led = Led { azimuth, elevation, size, pitch: [0.1; 2] };
        assert!(shares(led, &broken).data.iter().all(|share| (0.0..=1.0).contains(share)), "{led:?}");
    }
}

#[test]
fn narrow_processors_see_the_same_bits() {
    for surface in surfaces() {
        for azimuth in AZIMUTHS {
            let led = Led { azimuth, elevation: 8.5, size: 5.0, pitch: [0.05; 2] };
            assert_eq!(shares(led, &surface), scalar_only(|| shares(led, &surface)));
            assert_eq!(
                SteepestSlopes::new(&surface, led.pitch),
                scalar_only(|| SteepestSlopes::new(&surface, led.pitch))
            );
        }
    }
}
