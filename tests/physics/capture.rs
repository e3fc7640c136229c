//! The depth map against plain loops, rays and closed forms.
//!
//! Tolerances: see `oracle::scenery`. Where every coordinate is a small multiple of a power of two, f32 makes no rounding at
//! all, and the covered pixels must be exactly those of the oracle, edges included on every side.

use gelsim_core::base::grid::{Grid, bounding_box};
use gelsim_core::base::view::View;
use gelsim_core::pose::Placement;
use gelsim_job::sample::render;

use super::support::{bundled_objects, capture, deepest_in_view, in_view, position, raster_without_dispatch};
use crate::plan::plan;
use gelsim_oracle::scenery::Scenery;
use gelsim_oracle::shapes::{Random, Shape, UPRIGHT, matrix, moved, quarter_turn};

/// No pad is this thick: nothing is limited.
const BOTTOMLESS: f64 = 1e9;

fn camera(width: usize, height: usize, pitch: f64) -> View {
    View { resolution_px: [width, height], mm_per_px: [pitch, pitch] }
}

fn placed_at(translation_mm: [f64; 3]) -> Placement {
    Placement { rotation: UPRIGHT, translation_mm }
}

/// Every pixel's captured height lies within the bounds of the plain loop. Says how many are not 0.
fn check(name: &str, shape: &Shape, placement: &Placement, camera: &View, margin: usize) -> usize {
    let depth = capture(&shape.clusters(), placement, camera, margin, BOTTOMLESS);
    let truth = Scenery::new(shape, placement, camera, margin);
    let mut covered = 0;
    for y in 0..depth.penetration.height {
        for x in 0..depth.penetration.width {
            let found = -f64::from(depth.penetration.at(x, y));
            let [low, high] = truth.bounds(x, y);
            assert!(
                (low..=high).contains(&found),
                "{name}: height {found} at column {x}, row {y} is not in {low} ..= {high}, exactly {}",
                truth.height(x, y)
            );
            covered += usize::from(found < 0.0);
        }
    }
    covered
}

/// A random point in the window of a 48 x 36 camera with a pitch of 1/32 mm, and somewhat beyond, mostly below the pad.
fn anywhere(random: &mut Random) -> [f64; 3] {
    [random.within(-1.0, 1.0), random.within(-0.8, 0.8), random.within(-2.0, 0.3)]
}

/// As `anywhere`, but exactly on a corner or the middle of a pixel.
fn on_lattice(random: &mut Random) -> [f64; 3] {
    [anywhere(random), anywhere(random)].map(|p| p.map(|v| (v * 64.0).round() / 64.0))[0]
}

fn near(random: &mut Random, point: [f64; 3], size: f64) -> [f64; 3] {
    point.map(|v| v + random.within(-size, size))
}

/// Meshes that break rasterisers, within about 1.5 x 1.1 mm.
fn nasty_meshes() -> Vec<(&'static str, Shape)> {
    let mut random = Random(1);
    let r = &mut random;
    let mut soup = |count: usize, make: &mut dyn FnMut(&mut Random) -> [[f64; 3]; 3]| {
        let triangles: Vec<[[f64; 3]; 3]> = (0..count).map(|_| make(r)).collect();
        Shape::soup(triangles)
    };
    let large = soup(20, &mut |r| [anywhere(r), anywhere(r), anywhere(r)]);
    let mixed = soup(300, &mut |r| {
        let (middle, size) = (anywhere(r), 10.0_f64.powf(r.within(-3.0, 0.0)));
        [near(r, middle, size), near(r, middle, size), near(r, middle, size)]
    });
    let slivers = soup(200, &mut |r| {
        let (a, b, width) = (anywhere(r), anywhere(r), 10.0_f64.powf(r.within(-9.0, -2.0)));
        [a, b, near(r, b, width)]
    });
    let needles = soup(200, &mut |r| {
        let (a, b) = (on_lattice(r), on_lattice(r));
        let width = r.within(1e-4, 5e-3);
        [a, [b[0] - width, b[1], b[2]], [b[0] + width, b[1], b[2]]]
    });
    let walls = soup(60, &mut |r| {
        let (a, b) = (on_lattice(r), on_lattice(r));
        [a, b, [a[0], a[1], b[2] - 0.5]]
    });
    let upright_needles = soup(100, &mut |r| {
        let a = anywhere(r);
        let tip = [a[0] + 1e-7, a[1] - 1e-7, a[2] - 1.0];
        [a, near(r, a, 0.05), tip]
    });
    let tiny = soup(3000, &mut |r| {
        let a = on_lattice(r);
        [near(r, a, 2e-4), near(r, a, 2e-4), near(r, a, 2e-4)]
    });
    let coincident = {
        let faces = soup(30, &mut |r| [anywhere(r), anywhere(r), anywhere(r)]);
        let again = faces.map(|p| p);
        let lower = faces.map(|[x, y, z]| [x, y, z - 1e-6]);
        let corners = [&faces, &again, &lower]
            .map(|shape| shape.triangles.iter().map(|t| t.map(|i| shape.vertices[i as usize])).collect::<Vec<_>>());
        // Every second copy with its corners in reverse order.
        Shape::soup(
            corners
                .concat()
                .into_iter()
                .enumerate()
                .map(|(i, [a, b, c])| if i % 2 == 0 { [a, b, c] } else { [c, b, a] }),
        )
    };
    let fan = {
        // A thousand slivers that meet on a pixel's centre.
        let rim = |k: usize| {
            let angle = k as f64 / 1000.0 * std::f64::consts::TAU;
            [1.0 / 64.0 + 0.5 * angle.cos(), 1.0 / 64.0 + 0.5 * angle.sin(), -0.3]
        };
        Shape::soup((0..1000).map(|k| [[1.0 / 64.0, 1.0 / 64.0, -0.5], rim(k), rim((k + 1) % 1000)]))
    };
    let huge = soup(12, &mut |r| {
        let far = |r: &mut Random| [r.within(-1e4, 1e4), r.within(-1e4, 1e4), r.within(-1.0, 0.2)];
        [far(r), far(r), far(r)]
    });
    let open = Shape::crossed_sheet(9, 7, |i, j| {
        [i as f64 * 0.11 - 0.4, j as f64 * 0.09 - 0.3, -0.2 - 0.05 * ((i * j) % 5) as f64]
    });
    vec![
        ("large triangles", large),
        ("triangles of all sizes", mixed),
        ("slivers", slivers),
        ("needles thinner than a pixel", needles),
        ("upright walls", walls),
        ("upright needles", upright_needles),
        ("triangles smaller than a pixel", tiny),
        ("coincident faces", coincident),
        ("a fan of slivers", fan),
        ("huge triangles", huge),
        ("an open sheet", open),
    ]
}

#[test]
fn nasty_meshes_look_as_the_plain_loop_says_in_every_pose_and_under_every_camera() {
    let mut random = Random(2);
    let turns = [UPRIGHT, quarter_turn(1), quarter_turn(2), [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]];
    for (name, shape) in nasty_meshes() {
        let mut covered = 0;
        let anisotropic = View { resolution_px: [47, 36], mm_per_px: [0.031, 0.047] };
        for (k, camera) in [camera(48, 36, 1.0 / 32.0), camera(31, 30, 0.04), anisotropic].iter().enumerate() {
            for rotation in turns.into_iter().chain([random.rotation()]).skip(k) {
                // Under the first camera, what is made on pixel centres stays there.
                let shift = if k == 0 { 0.0 } else { 0.1 };
                let translation_mm =
                    [random.within(-shift, shift), random.within(-shift, shift), random.within(-0.3, 0.0)];
                covered += check(name, &shape, &Placement { rotation, translation_mm }, camera, 3 * k);
            }
        }
        assert!(covered > 100, "{name}: only {covered} covered pixels were compared");
    }
}

#[test]
fn where_f32_is_exact_the_covered_pixels_are_exactly_those_of_the_plain_loop() {
    let mut random = Random(3);
    let camera = camera(48, 36, 1.0 / 32.0);
    let (mut covered, mut on_edges) = (0, 0);
    for round in 0..400 {
        // All corners on corners, centres and quarters of pixels, near each other and far: every edge function is exact.
        let r = &mut random;
        let shape = Shape::soup((0..15).map(|_| {
            let (a, reach) = (on_lattice(r), [2.0, 6.0, 24.0, 96.0][r.below(4)]);
            let mut other = || [0, 1, 2].map(|k| a[k] + r.within(-reach, reach).round() / 256.0);
            [a, other(), other()]
        }));
        let placement = Placement { rotation: quarter_turn(round), translation_mm: [0.0; 3] };
        let truth = Scenery::new(&shape, &placement, &camera, 2);
        let shifted = Scenery::new(&shape, &Placement { translation_mm: [1e-9, 1e-9, 0.0], ..placement }, &camera, 2);
        let depth = capture(&shape.clusters(), &placement, &camera, 2, BOTTOMLESS).penetration;
        for y in 0..depth.height {
            for x in 0..depth.width {
                let (found, expected) = (-f64::from(depth.at(x, y)), truth.height(x, y));
                assert!((found - expected).abs() < 1e-6, "round {round}: {found} for {expected} at {x}, {y}");
                assert_eq!(found < 0.0, expected < 0.0);
                covered += usize::from(found < 0.0);
                on_edges += usize::from((shifted.height(x, y) - expected).abs() > 1e-6);
            }
        }
    }
    assert!(covered > 10_000 && on_edges > 500, "{covered} pixels covered, {on_edges} of them by an edge");
}

#[test]
fn bundled_objects_look_as_rays_see_them_in_every_pose() {
    let mut random = Random(4);
    let camera = View { resolution_px: [112, 84], mm_per_px: [0.17, 0.16] };
    for path in bundled_objects() {
        let shape = Shape::bundled(&path);
        let clusters = shape.clusters();
        // As the pad sees it, sunk without trace on its side, and twice at random.
        let poses = [(UPRIGHT, 0.5), ([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], 100.0)]
            .into_iter()
            .chain([(random.rotation(), 1.5), (random.rotation(), 100.0)]);
        for (pose, (rotation, depth_mm)) in poses.enumerate() {
            let mut placement = Placement { rotation, translation_mm: [0.0; 3] };
            let middle = moved(&placement, clusters.centre_mm());
            let lowest = shape.placed(&placement).iter().flatten().map(|p| p[2]).fold(f64::INFINITY, f64::min);
            placement.translation_mm =
                [random.within(-1.0, 1.0) - middle[0], random.within(-1.0, 1.0) - middle[1], -depth_mm - lowest];
            let truth = Scenery::new(&shape, &placement, &camera, 0);
            let rays = truth.rays();
            let depth = capture(&clusters, &placement, &camera, 0, BOTTOMLESS).penetration;
            let (mut covered, mut near_edges) = (0, 0);
            for y in 0..depth.height {
                for x in 0..depth.width {
                    let (found, expected) = (-f64::from(depth.at(x, y)), rays.height(x, y));
                    covered += usize::from(expected < 0.0);
                    // Heights of 100 mm are rounded to 4e-6 mm.
                    if (found - expected).abs() > 1e-5 + depth_mm * 1e-7 {
                        near_edges += 1;
                        let [low, high] = truth.bounds(x, y);
                        assert!(
                            (low..=high).contains(&found),
                            "{}, pose {pose}: height {found} at {x}, {y}, a ray says {expected}, bounds {low}, {high}",
                            path.display()
                        );
                    }
                }
            }
            assert!(covered > 10, "{}, pose {pose}: {covered} pixels", path.display());
            assert!(near_edges * 50 <= covered, "{}, pose {pose}: {near_edges} of {covered}", path.display());
        }
    }
}

#[test]
fn a_sheet_with_vertices_on_pixel_centres_has_no_hole_and_one_depth() {
    for pitch in [1.0 / 32.0, 0.03, 0.05] {
        for cell_px in [0.5, 1.0, 2.0, 3.0] {
            for (turn, shift_px) in (0..4).flat_map(|turn| [0.0, 0.5].map(|shift| (turn, shift))) {
                let camera = View { resolution_px: [40, 30], mm_per_px: [pitch, pitch] };
                let cells = (60.0 / cell_px) as usize;
                let corner = |i: usize| ((i as f64 - cells as f64 / 2.0) * cell_px + shift_px) * pitch;
                let shape = Shape::crossed_sheet(cells, cells, |i, j| [corner(i), corner(j), 0.0]);
                for depth_mm in [0.5, 0.7] {
                    let placement = Placement { rotation: quarter_turn(turn), translation_mm: [0.0, 0.0, -depth_mm] };
                    let depth = capture(&shape.clusters(), &placement, &camera, 4, 3.0);
                    for (at, found) in depth.penetration.data.iter().enumerate() {
                        let error = (f64::from(*found) - depth_mm).abs();
                        assert!(error <= 2e-7, "{pitch} mm/px, cells of {cell_px} px, turn {turn}, {at}: {found}");
                    }
                }
            }
        }
    }
}

#[test]
fn a_crumpled_sheet_has_no_hole_at_any_angle() {
    let mut random = Random(5);
    let camera = camera(64, 48, 0.03);
    for round in 0..60 {
        // Cells from far below a pixel to many pixels, with corners moved at random: many slivers.
        let cells = [3, 9, 33, 120][round % 4];
        let step = 4.0 / cells as f64;
        let jitter: Vec<f64> = (0..(cells + 1) * (cells + 1) * 2).map(|_| random.within(-0.49, 0.49)).collect();
        let shape = Shape::crossed_sheet(cells, cells, |i, j| {
            let at = (j * (cells + 1) + i) * 2;
            let (x, y) = ((i as f64 + jitter[at]) * step - 2.0, (j as f64 + jitter[at + 1]) * step - 2.0);
            [x, y, 0.05 * jitter[at]]
        });
        let (sin, cos) = random.within(0.0, 7.0).sin_cos();
        let rotation = [[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]];
        let translation_mm = [random.within(-0.01, 0.01), random.within(-0.01, 0.01), -0.5];
        let depth = capture(&shape.clusters(), &Placement { rotation, translation_mm }, &camera, 0, 3.0);
        let holes = depth.penetration.data.iter().filter(|mm| **mm < 0.4).count();
        assert_eq!(holes, 0, "round {round}");
    }
}

#[test]
fn the_inside_of_a_closed_mesh_has_no_zero_pixel() {
    // All of it below the pad, and convex: the silhouette's inside is the inside of a circle.
    let shape = Shape::ball_around_origin(1.0, 64, 33);
    let camera = camera(96, 96, 1.0 / 40.0);
    let mut random = Random(6);
    for round in 0..24 {
        let rotation = if round < 4 { quarter_turn(round) } else { random.rotation() };
        let depth =
            capture(&shape.clusters(), &Placement { rotation, translation_mm: [0.0, 0.0, -2.0] }, &camera, 0, 9.0);
        for y in 0..96 {
            for x in 0..96 {
                let [u, v] = position(&camera, x as f64, y as f64);
                let (mm, from_middle) = (depth.penetration.at(x, y), u.hypot(v));
                // The polyhedron lies between the ball and one smaller by its facets' height, 0.5 %.
                assert!(mm > 0.0 || from_middle > 0.99, "hole at {x}, {y} in round {round}");
                assert!(mm == 0.0 || from_middle < 1.0001, "ghost at {x}, {y} in round {round}");
            }
        }
    }
}

#[test]
fn winding_and_the_order_of_triangles_do_not_matter() {
    let camera = camera(48, 36, 1.0 / 32.0);
    for (name, shape) in nasty_meshes() {
        let placement = placed_at([0.01, -0.02, -0.1]);
        let flipped =
            Shape { triangles: shape.triangles.iter().map(|[a, b, c]| [*c, *b, *a]).collect(), ..shape.clone() };
        let reversed = Shape { triangles: shape.triangles.iter().rev().copied().collect(), ..shape.clone() };
        let found = [&shape, &flipped, &reversed].map(|shape| capture(&shape.clusters(), &placement, &camera, 5, 3.0));
        let largest = |other: &Grid<f32>| {
            found[0].penetration.data.iter().zip(&other.data).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
        };
        for other in &found[1..] {
            // The sums over three corners may round differently when they start at another one.
            let difference = largest(&other.penetration);
            assert!(difference < 1e-6, "{name}: {difference}");
        }
    }
}

#[test]
fn a_kilometre_between_an_object_and_its_origin_costs_nothing() {
    let camera = camera(64, 48, 0.06);
    let shape = Shape::ball_around_origin(1.5, 40, 21);
    let mut random = Random(7);
    for offset in [[1e6, 0.0, 0.0], [0.0, -1e6, 1e6], [1e6, 1e6, -1e6]] {
        let far = shape.map(|q| [0, 1, 2].map(|k| q[k] + offset[k]));
        let rotation = random.rotation();
        let back = moved(&Placement { rotation, translation_mm: [0.0; 3] }, offset);
        let near =
            capture(&shape.clusters(), &Placement { rotation, translation_mm: [0.2, 0.1, 0.7] }, &camera, 3, 3.0);
        let translation_mm = [0.2 - back[0], 0.1 - back[1], 0.7 - back[2]];
        let found = capture(&far.clusters(), &Placement { rotation, translation_mm }, &camera, 3, 3.0);
        let mut compared = 0;
        for (found, near) in found.penetration.data.iter().zip(&near.penetration.data) {
            // At 1e6 mm f64 itself has steps of 1e-10 mm, and the mesh is rounded once more.
            assert!((found - near).abs() < 5e-6, "{found} for {near} at an offset of {offset:?}");
            compared += usize::from(*near > 0.0);
        }
        assert!(compared > 500, "{compared} pixels");
    }
}

#[test]
fn a_fine_ball_is_as_deep_as_a_ball() {
    let (radius, meridians, parallels) = (4.0, 640, 320);
    let shape = Shape::ball_around_origin(radius, meridians, parallels);
    let clusters = shape.clusters();
    // Facets lie inside the ball by at most this: the radius of the circle through a cell's corners is half its
    // diagonal at most.
    let cell = radius * std::f64::consts::TAU / meridians as f64;
    let chord = radius - (radius * radius - cell * cell / 2.0).sqrt();
    let mut random = Random(8);
    let camera = camera(160, 120, 0.05);
    for depth_mm in [0.3, 1.0, 2.9] {
        for rotation in [UPRIGHT, random.rotation()] {
            let centre = [random.within(-1.0, 1.0), random.within(-1.0, 1.0), radius - depth_mm];
            let depth =
                capture(&clusters, &Placement { rotation, translation_mm: centre }, &camera, 0, 3.0).penetration;
            let (mut worst, mut inside) = (0.0_f64, 0);
            for y in 0..120 {
                for x in 0..160 {
                    let [u, v] = position(&camera, x as f64, y as f64);
                    let squared = (u - centre[0]).powi(2) + (v - centre[1]).powi(2);
                    let rise = (radius * radius - squared).max(0.0).sqrt();
                    let truth = (rise - centre[2]).max(0.0);
                    let error = truth - f64::from(depth.at(x, y));
                    // A facet's distance from the ball along z, where the ball is steep.
                    let allowed = chord * radius / rise.max(radius - depth_mm) + 1e-5;
                    assert!((-1e-5..=allowed).contains(&error), "{error} of {allowed} at {x}, {y}, depth {truth}");
                    worst = worst.max(error.abs());
                    inside += usize::from(truth > 0.0);
                }
            }
            assert!(inside > 500 && worst < 5e-4, "{inside} pixels, {worst} mm off");
        }
    }
}

/// How many pixels of a row or column a 5 mm edge covers when its middle is `shift_mm` off the image's middle.
fn centres_on_the_cube(size_px: usize, pitch: f64, shift_mm: f64) -> usize {
    let covered = |i: &usize| ((*i as f64 + 0.5 - size_px as f64 / 2.0) * pitch - shift_mm).abs() <= 2.5;
    (0..size_px).filter(covered).count()
}

#[test]
fn the_papers_cube_of_5_mm_measures_5_mm_over_the_pitch_in_every_row_and_column() {
    // The last number is what 5 mm are in pixels. Where both edges of the cube fall on pixel centres, both count: one
    // pixel more. That is so in the rows of 100 x 75 and in both directions of 161 x 121.
    for (resolution, field, shift, expected) in [
        ([640, 480], [20.0, 15.0], [0.0, 0.0], [160, 160]),
        ([640, 480], [20.0, 15.0], [1.0, -2.0], [160, 160]),
        ([640, 480], [20.0, 15.0], [1.0 / 64.0, 0.0], [161, 160]),
        ([640, 480], [20.0, 15.0], [0.005, 0.012], [160, 160]),
        ([320, 240], [20.0, 15.0], [0.0, 0.0], [80, 80]),
        ([1280, 960], [20.0, 15.0], [0.0, 0.0], [320, 320]),
        ([100, 75], [20.0, 15.0], [0.0, 0.0], [26, 25]),
        ([161, 121], [161.0 / 16.0, 121.0 / 16.0], [0.0, 0.0], [81, 81]),
        ([320, 240], [20.0, 30.0], [0.0, 0.0], [80, 40]),
    ] {
        let plan = plan(&format!(
            "fidelity = \"high\"\n[dataset]\nname = \"cube\"\nsamples = 1\n[[object]]\npath = \"objects/cube.obj\"\n[sensor]\n\
             resolution_px = {resolution:?}\nfield_of_view_mm = {field:?}\n[pose]\nx_mm = {:?}\ny_mm = {:?}\n\
             [indentation]\ndepth_mm = 0.8\n",
            shift[0], shift[1],
        ));
        for k in 0..2 {
            let exact = 5.0 / plan.simulator.view().mm_per_px[k];
            let on_centres = centres_on_the_cube(resolution[k], plan.simulator.view().mm_per_px[k], shift[k]);
            assert_eq!(on_centres, expected[k], "the expectation itself: 5 mm are {exact} px");
            assert!((on_centres as f64 - exact).abs() <= 1.0, "{on_centres} for {exact}");
        }
        let sample = render(&plan, 0);
        let depth = in_view(&sample.impression.depth);
        let row = |y: usize| depth.row(y).iter().filter(|mm| **mm > 0.0).count();
        let column = |x: usize| (0..depth.height).filter(|y| depth.at(x, *y) > 0.0).count();
        let rows: Vec<usize> = (0..depth.height).map(row).filter(|count| *count > 0).collect();
        let columns: Vec<usize> = (0..depth.width).map(column).filter(|count| *count > 0).collect();
        assert_eq!(rows, vec![expected[0]; expected[1]], "{resolution:?}");
        assert_eq!(columns, vec![expected[1]; expected[0]], "{resolution:?}");
        assert!(depth.data.iter().all(|mm| *mm == 0.0 || (mm - 0.8).abs() < 1e-6));
        let [x0, y0, x1, y1] = sample.label.contact.bbox_px;
        assert_eq!([x1 - x0, y1 - y0], expected.map(|px| px as u32));
    }
}

#[test]
fn a_flat_face_is_as_deep_as_the_job_says_whichever_face_and_yaw() {
    for object in ["cube", "flat_face", "cylinder", "brick"] {
        for face in ["-x", "+x", "-y", "+y", "-z", "+z"] {
            for (yaw, depth_mm) in [(0.0, 0.8), (37.0, 0.05), (90.0, 2.9), (211.5, 1.3)] {
                let plan = plan(&format!(
                    "[dataset]\nname = \"a\"\nsamples = 1\n[[object]]\npath = \"objects/{object}.obj\"\n[sensor]\n\
                     resolution_px = [80, 60]\n[pose]\nface = \"{face}\"\nyaw_deg = {yaw}\n[indentation]\n\
                     depth_mm = {depth_mm}\n"
                ));
                let sample = render(&plan, 0);
                let deepest = f64::from(deepest_in_view(&sample.impression.depth));
                // A round side touches along a line, which may pass between pixel centres 0.25 mm apart.
                let round = matches!((object, face), ("cylinder" | "flat_face" | "brick", _));
                let missed = if round { 0.2 } else { 1e-6 };
                assert!(deepest <= depth_mm + 1e-6, "{object} {face} {yaw}: {deepest} for {depth_mm}");
                assert!(deepest >= depth_mm - missed, "{object} {face} {yaw}: {deepest} for {depth_mm}");
                assert_eq!(sample.label.indentation_depth_mm, depth_mm);
                assert_eq!(sample.label.contact.max_depth_mm, deepest);
                assert_eq!(sample.label.health.over_thickness_px, 0);
            }
        }
    }
}

#[test]
fn what_would_pass_the_shell_is_limited_to_the_pad_and_counted_in_view_only() {
    let clusters = Shape::ball_around_origin(4.0, 200, 100).clusters();
    let camera = camera(96, 72, 0.05);
    // Half out of view, 1 mm too deep.
    let placement = placed_at([2.4, 0.3, 0.0]);
    let free = capture(&clusters, &placement, &camera, 20, BOTTOMLESS);
    let limited = capture(&clusters, &placement, &camera, 20, 3.0);
    let deeper = |grid: &Grid<f32>| grid.data.iter().filter(|mm| **mm > 3.0).count() as u64;
    assert_eq!(free.over_thickness_px, 0);
    assert_eq!(limited.over_thickness_px, deeper(&in_view(&free)));
    assert!(
        limited.over_thickness_px > 500 && limited.over_thickness_px < deeper(&free.penetration),
        "{} of {}",
        limited.over_thickness_px,
        deeper(&free.penetration)
    );
    for (limited, free) in limited.penetration.data.iter().zip(&free.penetration.data) {
        assert_eq!(*limited, free.min(3.0));
    }
}

#[test]
fn the_box_around_the_penetration_and_the_deepest_point_in_view_are_those_of_the_map() {
    let mut random = Random(13);
    let camera = camera(40, 30, 0.05);
    let clusters = Shape::ball_around_origin(0.7, 40, 20).clusters();
    let (mut out_of_view, mut in_sight) = (0, 0);
    for _ in 0..200 {
        let placement = placed_at([random.within(-2.5, 2.5), random.within(-2.5, 2.5), random.within(-0.2, 0.8)]);
        let depth = capture(&clusters, &placement, &camera, 20, 1.0);
        assert_eq!(depth.touching, bounding_box(&depth.penetration, |mm| mm > 0.0));
        assert_eq!(depth.deepest_mm, deepest_in_view(&depth));
        out_of_view += usize::from(depth.deepest_mm == 0.0 && !depth.touching.is_empty());
        in_sight += usize::from(depth.deepest_mm > 0.0);
    }
    assert!(out_of_view > 10 && in_sight > 10, "{out_of_view} {in_sight}");
}

#[test]
fn the_view_is_the_same_with_any_margin() {
    let mut random = Random(9);
    let camera = View { resolution_px: [61, 44], mm_per_px: [0.07, 0.05] };
    let meshes = nasty_meshes().into_iter().chain([("a ball", Shape::ball_around_origin(1.0, 50, 25))]);
    for (name, shape) in meshes {
        for rotation in [UPRIGHT, random.rotation(), random.rotation()] {
            let placement = Placement { rotation, translation_mm: [0.013, -0.02, -0.4] };
            let clusters = shape.clusters();
            let without = capture(&clusters, &placement, &camera, 0, 1.0);
            for margin in [1, 36, 57] {
                let with = capture(&clusters, &placement, &camera, margin, 1.0);
                assert_eq!(with.over_thickness_px, without.over_thickness_px, "{name}, margin {margin}");
                let found = in_view(&with);
                let apart = found.data.iter().zip(&without.penetration.data).map(|(a, b)| (a - b).abs());
                let differ = apart.clone().filter(|mm| *mm > 0.0).count();
                let largest = apart.fold(0.0, f32::max);
                assert_eq!(differ, 0, "{name}: a margin of {margin} px changes depths by up to {largest} mm");
            }
        }
    }
}

#[test]
fn moving_an_object_by_whole_pixels_moves_its_picture() {
    let pitch = 1.0 / 32.0;
    let camera = camera(80, 60, pitch);
    let mut random = Random(10);
    let clusters = Shape::ball_around_origin(0.5, 60, 30).clusters();
    for round in 0..6 {
        let rotation = random.rotation();
        let start = [random.within(-0.1, 0.1), random.within(-0.1, 0.1), 0.1];
        let here = capture(&clusters, &Placement { rotation, translation_mm: start }, &camera, 0, 3.0).penetration;
        for (dx, dy) in [(1_isize, 0_isize), (0, 1), (7, -5), (-9, 11)] {
            let translation_mm = [start[0] + dx as f64 * pitch, start[1] + dy as f64 * pitch, start[2]];
            let there = capture(&clusters, &Placement { rotation, translation_mm }, &camera, 0, 3.0).penetration;
            for y in 12..48_usize {
                for x in 12..68_usize {
                    let moved = there.at(x.wrapping_add_signed(dx), y.wrapping_add_signed(dy));
                    let difference = (moved - here.at(x, y)).abs();
                    assert!(difference < 2e-6, "round {round}, {dx}, {dy}: {difference} mm at {x}, {y}");
                }
            }
        }
    }
}

#[test]
fn turning_the_pose_is_turning_the_mesh() {
    let camera = camera(64, 64, 0.05);
    let mut random = Random(11);
    for (name, shape) in nasty_meshes() {
        let quaternion = [0.5, -0.5, 0.5, 0.5];
        let turn = Placement { rotation: matrix(quaternion), translation_mm: [0.0; 3] };
        let turned = shape.map(|q| moved(&turn, q));
        let shift = [random.within(-0.1, 0.1), random.within(-0.1, 0.1), -0.5];
        let pose = Placement { translation_mm: shift, ..turn };
        let by_pose = capture(&shape.clusters(), &pose, &camera, 0, 3.0).penetration;
        let by_hand = capture(&turned.clusters(), &placed_at(shift), &camera, 0, 3.0).penetration;
        let differ = by_pose.data.iter().zip(&by_hand.data).filter(|(a, b)| (*a - *b).abs() > 1e-6).count();
        // A mesh that was turned has its box's centre elsewhere by a rounding: slivers may flip.
        assert!(differ <= 8, "{name}: {differ} pixels");
    }
}

#[test]
fn wide_instructions_change_no_bit() {
    let camera = View { resolution_px: [61, 44], mm_per_px: [0.07, 0.05] };
    let mut random = Random(12);
    for (name, shape) in nasty_meshes() {
        for rotation in [UPRIGHT, random.rotation()] {
            let placement = Placement { rotation, translation_mm: [0.01, 0.02, -0.3] };
            let clusters = shape.clusters();
            let narrow = raster_without_dispatch(&clusters, &placement, &camera, 9);
            let wide = capture(&clusters, &placement, &camera, 9, BOTTOMLESS);
            for (narrow, wide) in narrow.data.iter().zip(&wide.penetration.data) {
                assert_eq!((0.0 - narrow).to_bits(), wide.to_bits(), "{name}");
            }
        }
    }
}
