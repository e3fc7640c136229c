//! The surface of the mean blur: symmetric, bounded, without any trace of the image's border.

use gelsim_core::base::grid::{Grid, Rect, bounding_box};
use gelsim_core::base::view::SURFACE_BORDER;
use gelsim_core::gelpad::Contact;
use gelsim_core::gelpad::mean_blur::MeanBlur;

use super::support::{blur_without_dispatch, depth_of, margin_of, press};
use gelsim_oracle::shapes::Random;

const BLURS: [MeanBlur; 4] = [
    MeanBlur { kernel_px: 15, passes: 5 },
    MeanBlur { kernel_px: 7, passes: 3 },
    MeanBlur { kernel_px: 1, passes: 0 },
    MeanBlur { kernel_px: 31, passes: 1 },
];

fn grid(width: usize, height: usize, value: impl Fn(usize, usize) -> f32) -> Grid<f32> {
    let mut grid = Grid::new(width, height);
    for y in 0..height {
        for x in 0..width {
            grid.row_mut(y)[x] = value(x, y);
        }
    }
    grid
}

/// Scattered rough lumps: some far from each other, some across every border.
fn lumps(width: usize, height: usize, count: usize, seed: u64) -> Grid<f32> {
    let mut random = Random(seed);
    let mut lumps = Vec::new();
    for _ in 0..count {
        let centre = [random.within(0.0, width as f64), random.within(0.0, height as f64)];
        lumps.push((centre, random.within(1.0, 12.0), random.within(0.1, 2.9)));
    }
    let at = |x: usize, y: usize| {
        let lump = |([u, v], radius, mm): &([f64; 2], f64, f64)| {
            let away = (x as f64 - u).hypot(y as f64 - v) / radius;
            if away < 1.0 { mm * (1.0 - away * away) } else { 0.0 }
        };
        lumps.iter().map(lump).fold(0.0, f64::max) as f32
    };
    grid(width, height, at)
}

/// The view with `margin` pixels around it, out of a larger depth map.
fn cut(all: &Grid<f32>, view: Rect, margin: usize) -> Grid<f32> {
    let grown = view.grown(margin, all.width, all.height);
    assert_eq!(grown.width(), view.width() + 2 * margin, "the larger map must reach far enough");
    all.crop(grown)
}

fn same(a: &Contact, b: &Contact) -> bool {
    let bits = |contact: &Contact| contact.surface.data.iter().map(|mm| mm.to_bits()).collect::<Vec<u32>>();
    bits(a) == bits(b) && a.mask == b.mask
}

#[test]
fn what_lies_beyond_the_margin_changes_no_bit_in_view() {
    for blur in BLURS {
        for (seed, (width, height)) in [(48, 36), (20, 70), (1, 1)].into_iter().enumerate() {
            let margin = margin_of(blur);
            let far = margin + 90;
            let all = lumps(width + 2 * far, height + 2 * far, 60, seed as u64);
            let view = Rect { x0: far, y0: far, x1: far + width, y1: far + height };
            let tight = press(blur, &depth_of(cut(&all, view, margin), margin));
            let wide = press(blur, &depth_of(all, far));
            assert!(same(&tight, &wide), "{blur:?} at {width} x {height}");
        }
    }
}

#[test]
fn the_margin_is_no_wider_than_the_blur_needs() {
    // One lump at the outermost corner of the margin still reaches the border of the view.
    let blur = MeanBlur::default();
    let margin = margin_of(blur);
    let mut penetration = grid(40 + 2 * margin, 30 + 2 * margin, |_, _| 0.0);
    penetration.row_mut(margin + 15)[0] = 2.0;
    let contact = press(blur, &depth_of(penetration, margin));
    let reached = contact.surface.at(0, 15 + SURFACE_BORDER);
    assert!(reached > 0.0, "a margin of {margin} px is more than it takes");
}

#[test]
fn the_surface_is_exactly_zero_outside_its_region_and_the_region_is_tight() {
    for blur in BLURS {
        for seed in 0..12 {
            let margin = margin_of(blur);
            let penetration = lumps(90 + 2 * margin, 60 + 2 * margin, 1 + seed as usize % 3, 100 + seed);
            let touching = bounding_box(&penetration, |mm| mm > 0.0);
            let contact = press(blur, &depth_of(penetration, margin));
            let (surface, region) = (&contact.surface, contact.region);
            for y in 0..surface.height {
                for x in 0..surface.width {
                    let inside = (region.x0..region.x1).contains(&x) && (region.y0..region.y1).contains(&y);
                    assert!(inside || surface.at(x, y).to_bits() == 0, "{} at {x}, {y}", surface.at(x, y));
                }
            }
            // Not wider than the lumps' box and the reach of the blur, counted in the surface's pixels.
            let corner = margin - SURFACE_BORDER;
            let reach = touching.grown(blur.reach_px(), 90 + 2 * margin, 60 + 2 * margin);
            let allowed = reach.in_window(corner, corner, surface.width, surface.height);
            assert!(region.is_empty() || allowed.x0 <= region.x0 && region.x1 <= allowed.x1, "{region:?} {allowed:?}");
            assert!(region.is_empty() || allowed.y0 <= region.y0 && region.y1 <= allowed.y1, "{region:?} {allowed:?}");
        }
    }
}

#[test]
fn nothing_in_reach_leaves_an_untouched_pad() {
    let blur = MeanBlur::default();
    let margin = margin_of(blur);
    let contact = press(blur, &depth_of(grid(40 + 2 * margin, 30 + 2 * margin, |_, _| 0.0), margin));
    assert!(contact.region.is_empty());
    assert!(contact.surface.data.iter().all(|mm| mm.to_bits() == 0));
    assert!(contact.mask.data.iter().all(|value| *value == 0));
}

#[test]
fn a_symmetric_object_gives_a_symmetric_surface() {
    for blur in BLURS {
        let margin = margin_of(blur);
        let size = 60 + 2 * margin;
        let middle = (size - 1) as f32 / 2.0;
        // Symmetric under every quarter turn and mirror, sharp-edged, and lumpy.
        let penetration = grid(size, size, |x, y| {
            let (u, v) = ((x as f32 - middle).abs(), (y as f32 - middle).abs());
            let (long, short) = (u.max(v), u.min(v));
            if long < 18.0 && short < 11.0 { 1.3 - 0.002 * long * short } else { 0.0 }
        });
        let surface = press(blur, &depth_of(penetration, margin)).surface;
        let last = surface.width - 1;
        let mut largest = 0.0_f32;
        for y in 0..surface.height {
            for x in 0..surface.width {
                let here = surface.at(x, y);
                for (u, v) in [(last - x, y), (x, last - y), (y, x), (last - y, x)] {
                    largest = largest.max((surface.at(u, v) - here).abs());
                }
            }
        }
        assert!(largest < 1e-6, "{blur:?}: {largest}");
    }
}

#[test]
fn the_surface_lies_between_the_object_and_its_deepest_point() {
    for blur in BLURS {
        let margin = margin_of(blur);
        let penetration = lumps(70 + 2 * margin, 50 + 2 * margin, 9, 7);
        let deepest = penetration.data.iter().fold(0.0_f32, |max, mm| max.max(*mm));
        let contact = press(blur, &depth_of(penetration.clone(), margin));
        let mut touching = 0;
        for y in 0..50 {
            for x in 0..70 {
                let surface = contact.surface.at(x + SURFACE_BORDER, y + SURFACE_BORDER);
                let object = penetration.at(x + margin, y + margin);
                assert!(
                    surface >= object && surface <= deepest * (1.0 + 1e-6),
                    "{surface} at {x}, {y}: object {object}, deepest {deepest}"
                );
                // Closer than a micrometre is touching.
                let touches = object > 0.0 && surface - object <= 1e-3;
                assert_eq!(contact.mask.at(x, y), if touches { 255 } else { 0 });
                touching += usize::from(touches);
            }
        }
        assert!(touching > 50, "{blur:?}: {touching}");
    }
}

#[test]
fn a_flat_face_touches_everywhere_under_it_whatever_the_rounding() {
    for blur in BLURS {
        let margin = margin_of(blur);
        for step in 1..30 {
            let depth_mm = step as f32 * 0.1;
            let inside = |x: usize| (margin + 20..margin + 60).contains(&x);
            let face = |x, y| if inside(x) && inside(y) { depth_mm } else { 0.0 };
            let contact = press(blur, &depth_of(grid(80 + 2 * margin, 80 + 2 * margin, face), margin));
            for (at, value) in contact.mask.data.iter().enumerate() {
                let expected = inside(at % 80 + margin) && inside(at / 80 + margin);
                assert_eq!(*value == 255, expected, "{blur:?}, {depth_mm} mm, pixel {at}");
            }
        }
    }
}

#[test]
fn wide_instructions_change_no_bit() {
    for blur in BLURS {
        let margin = margin_of(blur);
        let penetration = lumps(70 + 2 * margin, 50 + 2 * margin, 15, 8);
        let contact = press(blur, &depth_of(penetration.clone(), margin));
        let blurred = blur_without_dispatch(&penetration, blur);
        for y in 0..50 {
            for x in 0..70 {
                let expected = blurred.at(x + margin, y + margin).max(penetration.at(x + margin, y + margin));
                let found = contact.surface.at(x + SURFACE_BORDER, y + SURFACE_BORDER);
                assert_eq!(found.to_bits(), expected.to_bits(), "{blur:?} at {x}, {y}");
            }
        }
    }
}
