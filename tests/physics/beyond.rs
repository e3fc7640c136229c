//! Objects that go on beyond the captured window: force and surface in view against captures that hold all of them.

use std::sync::Arc;

use super::rig::{Rig, Setup};
use super::support::bundled_objects;
use gelsim_core::base::grid::{Grid, Resolution};
use gelsim_core::base::view::{SURFACE_BORDER, View};
use gelsim_core::depth::indenter::Indenter;
use gelsim_core::depth::outside_window::{MAX_PATCHES, OutsideCapture, RectMm};
use gelsim_core::depth::{self, CaptureWindow};
use gelsim_core::gelpad::Contact;
use gelsim_core::gelpad::total_contact::{OutsideWindow, TotalContact, measure_total_contact};
use gelsim_core::mesh::clusters::Clusters;
use gelsim_core::pose::{Anchor, Angles, Pose, Side};
use gelsim_oracle::shapes::Shape;

/// A box `size` mm long, wide and high.
fn block(size: [f64; 3]) -> Arc<Clusters> {
    let corner = |k: usize| std::array::from_fn(|axis| if k >> axis & 1 == 1 { size[axis] } else { 0.0 });
    let quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]];
    let triangles = quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect();
    Arc::new(Shape { vertices: (0..8).map(corner).collect(), triangles }.clusters())
}

/// Where an object is.
#[derive(Clone, Copy)]
struct At {
    position_mm: [f64; 2],
    yaw_deg: f64,
    tilt_deg: f64,
    depth_mm: f64,
}

fn flat(x: f64, y: f64, yaw_deg: f64, depth_mm: f64) -> At {
    At { position_mm: [x, y], yaw_deg, tilt_deg: 0.0, depth_mm }
}

impl At {
    fn tilted(self, tilt_deg: f64) -> Self {
        Self { tilt_deg, ..self }
    }

    fn indenter(self, object: &Arc<Clusters>) -> Indenter {
        let angles = Angles { yaw_deg: self.yaw_deg, tilt_deg: self.tilt_deg, tilt_azimuth_deg: 80.0 };
        let pose = Pose::new(Side::MinusZ, angles, self.position_mm, Anchor::Bounds, -self.depth_mm, object);
        Indenter::clusters(Arc::clone(object), pose)
    }
}

/// A press with what lies beyond the window, or without.
struct Pressed {
    contact: Contact,
    beyond: Option<OutsideWindow>,
    total: TotalContact,
}

fn view(rig: &Rig) -> View {
    View { resolution_px: rig.setup.resolution_px, mm_per_px: rig.setup.mm_per_px }
}

fn press(rig: &Rig, indenter: &Indenter, with_all: bool) -> Pressed {
    let Setup { thickness_mm, youngs_modulus_kpa, .. } = rig.setup;
    let (view, margin_px) = (view(rig), rig.margin_px());
    let depth =
        depth::capture_indenter(indenter, &view, CaptureWindow { margin_px, above_mm: thickness_mm }, thickness_mm);
    let around = OutsideCapture::new(indenter, None, None, thickness_mm, &view, margin_px).filter(|_| with_all);
    let beyond = around.map(|around| rig.pad.solve_outside_window(&around));
    let mut contact = rig.pad.press_with_outside(&depth, beyond.as_ref());
    assert!(contact.finite && contact.numerics.converged, "{:?}", contact.numerics);
    let total =
        measure_total_contact(indenter.shape(), &depth, beyond.as_ref(), &mut contact, youngs_modulus_kpa, &view);
    Pressed { contact, beyond, total }
}

/// What the middle part of a wide view shows: its force, N, and surface; and the whole force.
struct Truth {
    in_view_n: f64,
    total_n: f64,
    surface: Grid<f32>,
}

fn truth(rig: &Rig, wide: &Rig, indenter: &Indenter) -> Truth {
    let all = press(wide, indenter, false);
    let margin_px = wide.margin_px();
    let around = view(wide);
    let missed = OutsideCapture::new(indenter, None, None, rig.setup.thickness_mm, &around, margin_px);
    assert!(missed.is_none(), "the wide window holds all of the object");
    let ([width, height], [wide_px, high_px]) = (rig.setup.resolution_px, wide.setup.resolution_px);
    let (left, top) = ((wide_px - width) / 2, (high_px - height) / 2);
    let part = gelsim_core::base::grid::Rect { x0: left, y0: top, x1: left + width, y1: top + height };
    let newtons = |kpa: &f32| f64::from(*kpa) * wide.setup.mm_per_px[0] * wide.setup.mm_per_px[1] * 1e-3;
    let in_view_n = all.contact.pressure.iter().flat_map(|p| p.crop(part).data).map(|kpa| newtons(&kpa)).sum();
    let surface = all.contact.surface.inner(SURFACE_BORDER).crop(part);
    Truth { in_view_n, total_n: all.total.total_force_n.expect("a solved contact"), surface }
}

/// Errors of the force in view and of the whole force, as shares of them (of the force in view, if less of the whole than
/// `least` is in view, as a share of that), and the largest error of the surface in view, um.
fn errors(found: &Pressed, truth: &Truth, least: f64) -> [f64; 3] {
    let surface = found.contact.surface.inner(SURFACE_BORDER);
    let pairs = surface.data.iter().zip(&truth.surface.data);
    let worst_mm = pairs.fold(0.0_f32, |worst, (a, b)| worst.max((a - b).abs()));
    let share = |found: Option<f64>, truth: f64, of: f64| (found.expect("a solved contact") - truth) / of;
    let enough = truth.in_view_n.max(least * truth.total_n);
    [
        share(found.contact.force_n, truth.in_view_n, enough),
        share(found.total.total_force_n, truth.total_n, truth.total_n),
        1e3 * f64::from(worst_mm),
    ]
}

/// A view and one several times as wide.
fn rigs(sizes_px: [[usize; 2]; 2], pitch_mm: f64, poisson_ratio: f64, thickness_mm: f64) -> [Rig; 2] {
    sizes_px.map(|resolution_px| {
        let setup = Setup { resolution_px, mm_per_px: [pitch_mm; 2], poisson_ratio, thickness_mm, ..Setup::default() };
        setup.solved(Resolution::Full, 0.2).rig()
    })
}

#[test]
fn a_plate_of_200_mm_presses_in_view_as_one_that_is_captured_whole() {
    let plate = block([200.0, 200.0, 10.0]);
    let cases = [
        ("in the middle", &plate, flat(0.0, 0.0, 0.0, 0.3)),
        ("turned", &plate, flat(7.0, 3.0, 20.0, 0.3)),
        ("its edge in view", &plate, flat(98.0, 0.0, 0.0, 0.3)),
        ("its edge in view, turned", &plate, flat(70.0, 70.0, 30.0, 0.3)),
        ("its corner in view", &plate, flat(97.0, 99.0, 0.0, 0.3)),
        ("tilted", &plate, flat(-90.0, 0.0, 0.0, 0.6).tilted(0.3)),
        ("beyond the window", &plate, flat(120.0, 0.0, 0.0, 0.3)),
        ("a bar of 60 x 9 mm across the view", &block([60.0, 9.0, 10.0]), flat(0.0, 2.0, 25.0, 0.4)),
    ];
    for nu in [0.3, 0.48, 0.4999] {
        // A view of 20 x 15 mm, and one of 440 mm.
        let [rig, wide] = rigs([[40, 30], [880, 880]], 0.5, nu, 3.0);
        for (name, object, at) in &cases {
            let indenter = at.indenter(object);
            let truth = truth(&rig, &wide, &indenter);
            let (cut, found) = (press(&rig, &indenter, false), press(&rig, &indenter, true));
            let (before, after) = (errors(&cut, &truth, 1e-6), errors(&found, &truth, 1e-6));
            println!(
                "beyond, nu {nu}, {name}: {:.3} N in view, cut {before:+.4?}, found {after:+.4?}",
                truth.in_view_n
            );
            assert!(after[0].abs() < 0.02, "nu {nu}, {name}: force in view off by {}", after[0]);
            assert!(after[1].abs() < 0.05, "nu {nu}, {name}: whole force off by {}", after[1]);
            assert!(after[2] < 0.05 * before[2] + 0.2, "nu {nu}, {name}: {} um, cut {}", after[2], before[2]);
            assert!(found.total.cut_by_view && found.total.force_unknown.is_empty(), "{name}: {:?}", found.total);
        }
    }
}

#[test]
fn bundled_objects_across_the_border_press_as_captured_whole() {
    let places = [flat(8.0, 0.0, 30.0, 0.3), flat(-7.0, 6.0, 75.0, 0.5), flat(9.0, -2.0, 200.0, 0.5).tilted(4.0)];
    for (nu, thickness_mm) in [(0.48, 3.0), (0.4999, 3.0), (0.48, 1.0)] {
        let [rig, wide] = rigs([[60, 46], [240, 184]], 0.25, nu, thickness_mm);
        let (mut worst, mut pressed) = ([[0.0_f64; 3]; 2], 0);
        for path in bundled_objects() {
            let object = Arc::new(Shape::bundled(&path).clusters());
            for (k, at) in places.iter().enumerate() {
                let indenter = at.indenter(&object);
                let found = press(&rig, &indenter, true);
                if found.beyond.is_none() {
                    continue;
                }
                pressed += 1;
                let truth = truth(&rig, &wide, &indenter);
                let both = [press(&rig, &indenter, false), found].map(|pressed| errors(&pressed, &truth, 0.01));
                for (worst, own) in worst.iter_mut().zip(both) {
                    (0..3).for_each(|k| worst[k] = worst[k].max(own[k].abs()));
                }
                let name = format!("nu {nu}, h {thickness_mm}, {} at place {k}: {:?}", path.display(), both[1]);
                assert!(both[1][0].abs() < 0.02 && both[1][1].abs() < 0.06, "{name}");
                assert!(both[1][2] < 0.1 * both[0][2] + 0.6, "{name}, cut {}", both[0][2]);
            }
        }
        println!(
            "beyond, nu {nu}, h {thickness_mm}: {pressed} presses, worst if cut {:.4?}, found {:.4?}",
            worst[0], worst[1]
        );
        assert!(pressed > 50, "{pressed} presses go on beyond the window");
    }
}

#[test]
fn a_plate_of_a_metre_presses_as_an_endless_one() {
    let plate = block([1000.0, 1000.0, 10.0]);
    // On the incompressible pad the pressure grows over 40 thicknesses from the edge.
    for (nu, thickness_mm) in [(0.3, 3.0), (0.48, 3.0), (0.48, 1.0), (0.4999, 1.0)] {
        let [rig, _] = rigs([[40, 30]; 2], 0.5, nu, thickness_mm);
        let depth_mm = 0.1 * thickness_mm;
        let found = press(&rig, &flat(0.0, 0.0, 10.0, depth_mm).indenter(&plate), true);
        let layer = rig.setup.layer();
        let kpa = depth_mm / layer.normal_compliance(0.0) * rig.setup.youngs_modulus_kpa;
        let (expected, all) = (kpa * 20.0 * 15.0 * 1e-3, kpa * 1e6 * 1e-3);
        let (force, total) = (found.contact.force_n.expect("solved"), found.total.total_force_n.expect("solved"));
        println!(
            "beyond, nu {nu}, h {thickness_mm}: {:+.4} in view, {:+.4} of all",
            force / expected - 1.0,
            total / all - 1.0
        );
        assert!((force / expected - 1.0).abs() < 0.02, "nu {nu}, h {thickness_mm}: {force} N, not {expected}");
        // Less at the edges.
        assert!((0.8..1.01).contains(&(total / all)), "nu {nu}, h {thickness_mm}: {total} N of {all}");
        let share = found.total.in_view_fraction.expect("known");
        assert!((share / 3e-4 - 1.0).abs() < 0.01, "{share}");
    }
}

#[test]
fn hard_cases_stay_finite_and_solved_and_the_same() {
    let plate = block([1000.0, 1000.0, 10.0]);
    let strip = block([1000.0, 0.7, 10.0]);
    let cases = [
        ("tilted, its edge in view", &plate, flat(-495.0, 0.0, 0.0, 0.3).tilted(1.0)),
        ("tilted, its edge beyond", &plate, flat(-470.0, 0.0, 0.0, 0.1).tilted(0.2)),
        ("tilted on its corner, far away", &plate, flat(300.0, 300.0, 45.0, 0.2).tilted(3.0)),
        ("far beyond", &plate, flat(700.0, 0.0, 0.0, 0.1)),
        ("a strip", &strip, flat(0.0, 1.0, 5.0, 0.1)),
        ("a hair deep", &plate, flat(0.0, 0.0, 0.0, 1e-4)),
    ];
    for (nu, thickness_mm) in [(0.0, 3.0), (0.48, 0.4), (0.4999, 3.0), (0.4999, 0.4), (0.45, 40.0)] {
        let [rig, _] = rigs([[40, 30]; 2], 0.5, nu, thickness_mm);
        for (name, object, at) in &cases {
            let indenter = at.indenter(object);
            let [found, again] = [0, 1].map(|_| press(&rig, &indenter, true));
            let TotalContact { total_force_n, cut_by_view, in_view_fraction, force_unknown, .. } = found.total;
            let all = total_force_n.unwrap_or_else(|| panic!("nu {nu}, h {thickness_mm}, {name}: {force_unknown}"));
            let share = in_view_fraction.expect("known");
            assert!(cut_by_view && all.is_finite() && all > 0.0, "nu {nu}, h {thickness_mm}, {name}: {all} N");
            assert!((0.0..1.0).contains(&share), "{name}: {share}");
            assert!(found.contact.force_n <= Some(all), "{name}: {:?} of {all} N", found.contact.force_n);
            let bits = |pressed: &Pressed| pressed.contact.surface.data.iter().map(|w| w.to_bits()).collect::<Vec<_>>();
            assert!(bits(&found) == bits(&again) && found.total == again.total, "{name}");
        }
    }
}

#[test]
fn what_ends_in_the_window_has_nothing_beyond() {
    let [rig, _] = rigs([[40, 30]; 2], 0.5, 0.48, 3.0);
    // The window ends at 14 mm. A ball's upper half may reach further, but not below the pad.
    let ball = Arc::new(Shape::ball_around_origin(9.0, 64, 32).clusters());
    for (object, at, cut_by_view) in [
        (&block([4.0, 4.0, 4.0]), flat(0.0, 0.0, 30.0, 0.3), false),
        (&block([4.0, 4.0, 4.0]), flat(10.0, 0.0, 0.0, 0.3), true),
        (&ball, flat(9.0, 0.0, 0.0, 0.3), true),
        (&ball, flat(3.0, 0.0, 0.0, 0.3), false),
    ] {
        let found = press(&rig, &at.indenter(object), true);
        assert!(found.beyond.is_none());
        assert_eq!(found.total.cut_by_view, cut_by_view);
        let (force, all) = (found.contact.force_n.expect("solved"), found.total.total_force_n.expect("solved"));
        let share = found.total.in_view_fraction.expect("known");
        if cut_by_view {
            assert!(force < all && share < 1.0, "{force} of {all} N, {share}");
        } else {
            assert_eq!((force, share), (all, 1.0));
        }
    }
}

#[test]
fn a_ball_has_its_force_however_far_it_presses_from_the_view_and_from_another() {
    let [rig, _] = rigs([[80, 60]; 2], 0.25, 0.48, 3.0);
    let Shape { vertices, triangles } = Shape::ball_around_origin(4.0, 128, 64);
    let force = |balls_mm: &[f64], x: f64, y: f64| {
        let moved = |along: f64| vertices.iter().map(move |[x, y, z]| [x + along, *y, *z]);
        let count = vertices.len();
        let numbered = |ball: usize| triangles.iter().map(move |corners| corners.map(|k| k + (ball * count) as u32));
        let object = Shape {
            vertices: balls_mm.iter().flat_map(|along| moved(*along)).collect(),
            triangles: (0..balls_mm.len()).flat_map(numbered).collect(),
        };
        let indenter = flat(x, y, 0.0, 0.5).indenter(&Arc::new(object.clusters()));
        press(&rig, &indenter, true).total.total_force_n.expect("solved")
    };
    let alone = force(&[0.0], 0.0, 0.0);
    for (x, y) in [(17.0, 0.0), (30.0, -20.0), (60.0, 0.0), (0.0, 110.0), (-200.0, 150.0), (700.0, 0.0), (0.0, 5e3)] {
        let found = force(&[0.0], x, y);
        assert!((found / alone - 1.0).abs() < 0.02, "{found} N at {x}, {y} mm, in view {alone} N");
    }
    for (balls_mm, x) in [
        (&[-50.0, 50.0][..], 0.0),
        (&[-50.0, 50.0], 50.0),
        (&[-300.0, 300.0], 0.0),
        (&[-300.0, 300.0], -300.0),
        (&[-2000.0, 2000.0], 2000.0),
        (&[-400.0, -100.0, 100.0, 400.0], 100.0),
        (&[-400.0, -30.0, 30.0, 400.0], 0.0),
    ] {
        let share = force(balls_mm, x, 0.0) / alone / balls_mm.len() as f64;
        assert!((share - 1.0).abs() < 0.03, "balls at {balls_mm:?}, {x} mm: {share} of the force");
    }
}

#[test]
fn any_number_of_feet_is_divided_into_as_many_patches_as_there_may_be() {
    let [rig, _] = rigs([[80, 60]; 2], 0.25, 0.48, 3.0);
    let seen = view(&rig);
    // A lattice of pyramids on their tips, 60 mm apart.
    for count in [3_usize, 32, 60] {
        let corner = [[0.0, 0.0, 0.0], [1.0, 0.0, 1.0], [-0.5, 0.9, 1.0], [-0.5, -0.9, 1.0]];
        let at = |n: usize| [60.0 * (n % count) as f64, 60.0 * (n / count) as f64];
        let vertices = (0..count * count).flat_map(|n| corner.map(|[x, y, z]| [x + at(n)[0], y + at(n)[1], z]));
        let faces = [[0, 2, 1], [0, 3, 2], [0, 1, 3], [1, 2, 3]];
        let triangles = (0..count * count).flat_map(|n| faces.map(|face| face.map(|k| (4 * n + k) as u32)));
        let object = Shape { vertices: vertices.collect(), triangles: triangles.collect() };
        let indenter = flat(0.0, 0.0, 0.0, 0.2).indenter(&Arc::new(object.clusters()));
        let around = OutsideCapture::new(&indenter, None, None, 3.0, &seen, rig.margin_px()).expect("wide");
        let patches = around.patches_below(0.0, 30.0);
        assert!(patches.len() <= MAX_PATCHES, "{count}: {}", patches.len());
        assert!(count == 60 || patches.len() == count * count, "{count}: {}", patches.len());
        for foot in (0..count * count).map(at) {
            // The bounds' centre is on the view's.
            let middle = 30.0 * (count - 1) as f64;
            let foot = [foot[0] - middle - 0.25, foot[1] - middle];
            let holds = |patch: &&RectMm| (0..2).all(|k| (patch.min[k]..patch.max[k]).contains(&foot[k]));
            assert_eq!(patches.iter().filter(holds).count(), 1, "{count}: {foot:?}");
        }
    }
}

#[test]
fn a_height_map_says_what_it_cannot_know() {
    let [rig, _] = rigs([[40, 30]; 2], 0.5, 0.48, 3.0);
    for (columns, cut_by_view) in [(10..30, false), (0..20, true)] {
        let deep = |i: usize| columns.contains(&(i % 40)) && (10..20).contains(&(i / 40));
        let depth_mm = (0..40 * 30).map(|i| if deep(i) { 0.3 } else { -1.0 }).collect();
        let found = press(&rig, &Indenter::height_map([40, 30], depth_mm).expect("numbers"), true);
        let TotalContact { total_force_n, in_view_fraction, force_unknown, .. } = found.total;
        assert_eq!((found.total.cut_by_view, total_force_n, in_view_fraction), (cut_by_view, None, None));
        assert_eq!(found.contact.force_n.is_none(), cut_by_view);
        assert!(found.contact.pressure.is_some() && !force_unknown.is_empty());
    }
}
