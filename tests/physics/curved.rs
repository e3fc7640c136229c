//! Gels that are not flat: capture along their normals against rays, contacts against Hertz and against themselves turned,
//! pins against what was found on real pictures, and what must not break any of it.

use gelsim::SensorExt;
use std::f64::consts::FRAC_PI_2;
use std::path::Path;
use std::sync::Arc;

use gelsim::{Background, Effect, EffectPolicy, Fidelity, Impression, Indenter, Models, Pose, Sensor, Simulator};
use gelsim_core::base::chart::Chart;
use gelsim_core::base::gel::{GelCapsule, GelDome, GelShape};
use gelsim_core::base::view::View;
use gelsim_core::camera::pins::{Along, Pins};
use gelsim_core::camera::projection::{Fisheye, LensModel, Pinhole, Projection};
use gelsim_core::depth::CaptureWindow;
use gelsim_core::depth::normal_capture::NormalCapture;
use gelsim_core::mesh::clusters::Clusters;
use gelsim_core::optics;
use gelsim_core::optics::led::Led;
use gelsim_core::optics::phong::{Phong, Shadows};
use gelsim_job::sample::{Sample, render};
use glam::{DQuat, DVec3};

use super::support::bundled_objects;
use crate::plan::plan;
use gelsim_oracle::mesh_rays::first_met;
use gelsim_oracle::shapes::{Random, Shape};

/// A dome with a few pins, seen from straight below.
pub fn dome(radius_mm: f64, field_mm: f64, px: usize, thickness_mm: f64) -> Sensor {
    let mut sensor = Sensor::preset("tactip").expect("a preset");
    sensor.resolution_px = [px; 2];
    sensor.shape = Some(GelShape::Dome(GelDome { radius_mm }));
    sensor.lens = LensModel::Orthographic;
    sensor.field_of_view_mm = [field_mm; 2];
    sensor.gelpad.thickness_mm = thickness_mm;
    sensor.gelpad.poisson_ratio = 0.48;
    sensor
}

/// A ball of facets, its centre at the mesh's origin.
fn ball(radius_mm: f64) -> Arc<Clusters> {
    Arc::new(Shape::ball_around_origin(radius_mm, 192, 96).clusters())
}

/// A ball pressed by `depth_mm` along the normal of the gel, which is turned from the axis.
pub fn press_ball(
    simulator: &Simulator,
    radius_mm: f64,
    ball_mm: f64,
    depth_mm: f64,
    angle_deg: f64,
    azimuth_deg: f64,
) -> Impression {
    let turn = DQuat::from_rotation_z(azimuth_deg.to_radians()) * DQuat::from_rotation_y(angle_deg.to_radians());
    let middle = turn * DVec3::new(0.0, 0.0, radius_mm + ball_mm - depth_mm) - DVec3::new(0.0, 0.0, radius_mm);
    let pose = Pose::from_quaternion(turn.to_array(), middle.to_array());
    simulator.press(&Indenter::clusters(ball(ball_mm), pose))
}

pub fn length(force: [f64; 3]) -> f64 {
    DVec3::from_array(force).length()
}

#[test]
fn normals_meet_objects_as_rays_do() {
    let dome = GelShape::Dome(GelDome { radius_mm: 12.0 });
    normals_are_rays(dome, DVec3::new(0.0, 0.0, 0.2), 300);
}

#[test]
fn normals_of_a_capsule_meet_objects_as_rays_do() {
    let capsule = GelShape::Capsule(GelCapsule { radius_mm: 12.0, length_mm: 40.0 });
    normals_are_rays(capsule, DVec3::new(0.0, 0.0, -2.0), 300);
}

/// Objects are placed on the gel in directions from `lowest` up.
fn normals_are_rays(shape: GelShape, lowest: DVec3, least_met: u32) {
    const RADIUS_MM: f64 = 12.0;
    let view = View { resolution_px: [40, 30], mm_per_px: [0.8, 0.8] };
    let normals = NormalCapture::new(&shape, &view, 3);
    let window = CaptureWindow { margin_px: 3, above_mm: 0.5 };
    let mut random = Random(5);
    let (mut met, mut compared) = (0, 0);
    for path in bundled_objects() {
        let object = Shape::bundled(&path).clusters();
        let turn = [(); 4].map(|()| random.within(-1.0, 1.0));
        let towards = DVec3::new(random.within(-1.0, 1.0), random.within(-1.0, 1.0), random.within(lowest.z, 1.0));
        let site = shape.closest(RADIUS_MM * towards + shape.centre_mm());
        let placed = Pose::from_quaternion(turn, [0.0; 3]);
        // Its middle on the gel's surface.
        let middle = placed.rotation * DVec3::from_array(object.centre_mm());
        let pose = Pose::from_quaternion(turn, (site.point_mm - middle).to_array());
        let chart = Chart::around_site(&shape, site);
        let depth = normals.capture(&object, &pose, &chart, window, 100.0);
        for y in (0..36).step_by(3) {
            for x in (0..46).step_by(3) {
                let place = view.point_mm([x as f64 + 0.5 - 3.0, y as f64 + 0.5 - 3.0]);
                let rest = chart.surface_frame(place);
                let from = shape.centre_mm() - DVec3::new(0.0, 0.0, rest.below_mm);
                let on_gel = rest.normal.z >= 0.0 && rest.below_mm <= shape.wall_mm().unwrap_or(0.0);
                let ray = first_met(&object, &pose, from, rest.normal).filter(|_| on_gel);
                let expected = ray.map_or(-0.5, |t| (RADIUS_MM - t).max(-0.5));
                let found = f64::from(depth.penetration.at(x, y));
                assert!((found - expected).abs() < 2e-4, "{path:?} {x} {y}: {found} {expected}");
                met += u32::from(expected > 0.0);
                compared += 1;
            }
        }
    }
    println!("{compared} normals, {met} of which meet an object below the gel");
    assert!(met > least_met, "{met}");
}

#[test]
fn a_ball_on_a_thick_dome_presses_as_hertz_says() {
    for (radius_mm, ball_mm, depth_mm) in [(10.0, 3.0, 0.1), (12.0, 4.0, 0.12), (30.0, 4.0, 0.15)] {
        let sensor = dome(radius_mm, 4.0, 192, 200.0);
        let simulator = Simulator::new(&sensor, Fidelity::High).expect("a sound sensor");
        let found = press_ball(&simulator, radius_mm, ball_mm, depth_mm, 0.0, 0.0);
        let (modulus, ratio) = (sensor.gelpad.youngs_modulus_kpa, sensor.gelpad.poisson_ratio);
        let equivalent_mm = 1.0 / (1.0 / radius_mm + 1.0 / ball_mm);
        let plane = modulus / (1.0 - ratio * ratio);
        let expected = 4e-3 / 3.0 * plane * f64::sqrt(equivalent_mm * depth_mm) * depth_mm;
        let force = length(found.wrench.expect("an elastic pad").force_n);
        println!("ball of {ball_mm} on a dome of {radius_mm} mm: {:.4} of Hertz", force / expected);
        assert!((force / expected - 1.0).abs() < 0.02, "{force} {expected}");
    }
}

#[test]
fn the_same_press_anywhere_on_a_dome_gives_the_same_force() {
    let sensor = dome(20.0, 36.0, 128, 4.0);
    let simulator = Simulator::new(&sensor, Fidelity::High).expect("a sound sensor");
    let at_tip = press_ball(&simulator, 20.0, 5.0, 1.0, 0.0, 0.0);
    let force = length(at_tip.wrench.expect("an elastic pad").force_n);
    for (angle_deg, azimuth_deg) in [(5.0, 30.0), (20.0, 200.0), (45.0, -70.0), (60.0, 123.0)] {
        let turned = press_ball(&simulator, 20.0, 5.0, 1.0, angle_deg, azimuth_deg);
        let found = turned.wrench.expect("an elastic pad").force_n;
        println!("{angle_deg} {azimuth_deg}: {:.5} of the force at the tip", length(found) / force);
        assert!((length(found) / force - 1.0).abs() < 5e-3, "{angle_deg} {azimuth_deg}");
        // Into the gel, along its normal.
        let turn =
            DQuat::from_rotation_z(f64::to_radians(azimuth_deg)) * DQuat::from_rotation_y(f64::to_radians(angle_deg));
        assert!(
            (DVec3::from_array(found).normalize() + turn * DVec3::Z).length() < 5e-3,
            "{angle_deg} {azimuth_deg}: {found:?}"
        );
        // The centre line of the press goes through the ball's middle: no moment about it.
        let torque = DVec3::from_array(turned.wrench.expect("known").torque_nmm);
        let arm = DVec3::new(0.0, 0.0, -20.0);
        assert!((torque - arm.cross(DVec3::from_array(found))).length() < 0.02 * length(found), "{torque}");
    }
}

#[test]
fn a_dome_of_a_kilometre_is_a_flat_pad() {
    let job = |sensor: &str| {
        plan(&format!(
            "fidelity = \"high\"\ndataset = {{ name = \"a\", samples = 1 }}\nobject = [{{ path = \"objects/gear.obj\" }}]\n\
             indentation.depth_mm = 0.6\npose = {{ yaw_deg = 20.0, x_mm = 1.0 }}\n\
             [output]\nlayers = [\"depth\", \"surface\", \"normal\", \"contact\", \"pressure\"]\n[sensor]\n\
             resolution_px = [160, 120]\nfield_of_view_mm = [16.0, 12.0]\n{sensor}"
        ))
    };
    let flat = render(&job(""), 0);
    let dome = render(
        &job(
            "shape.dome.radius_mm = 1e6\npins = { count = 37, spacing_mm = 1.0, length_mm = 1.0, diameter_mm = 0.5 }\n",
        ),
        0,
    );
    let of = |sample: &Sample| {
        let impression = &sample.impression;
        (impression.depth_mm(), impression.surface_mm(), impression.normals(), impression.contact_mask())
    };
    let ((depth, surface, normals, mask), (depths, surfaces, others, masks)) = (of(&flat), of(&dome));
    let off = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    println!("depth {} surface {}", off(&depth, &depths), off(&surface, &surfaces));
    assert!(
        off(&depth, &depths) < 1e-4 && off(&surface, &surfaces) < 1e-3,
        "{} {}",
        off(&depth, &depths),
        off(&surface, &surfaces)
    );
    assert!(mask.iter().zip(&masks).filter(|(a, b)| a != b).count() <= 5);
    assert!(
        off(normals.as_flattened(), others.as_flattened()) < 0.02,
        "{}",
        off(normals.as_flattened(), others.as_flattened())
    );
    let forces = [&flat, &dome].map(|sample| sample.label.contact.total_force_n.expect("known"));
    println!("forces {forces:?}");
    assert!((forces[1] / forces[0] - 1.0).abs() < 1e-3, "{forces:?}");
}

/// Radii of the rings of pins in pictures of an untouched TacTip, and how far presses by a flat plate move them outwards, px of
/// 128: means over 400 pictures (docs/reference/presets.md).
const RINGS_PX: [f64; 11] = [0.0, 5.23, 10.16, 15.02, 19.97, 24.89, 29.68, 34.41, 38.99, 43.50, 47.76];
const FROM_2_TO_4_MM: [f64; 11] = [-0.01, 0.42, 0.88, 1.17, 1.37, 1.52, 1.58, 1.62, 1.52, 1.45, 1.34];

fn ring(pin: usize) -> usize {
    (0..=10).find(|k| pin < 1 + 3 * k * (k + 1)).expect("331 pins")
}

#[test]
fn the_pins_of_a_tactip_are_where_they_are_in_pictures() {
    let job = |depth_mm: f64| {
        plan(&format!(
            "fidelity = \"high\"\ndataset = {{ name = \"a\", samples = 1 }}\nsensor.preset = \"tactip\"\n\
             object = [{{ path = \"objects/slab.obj\" }}]\npose.anchor = \"origin\"\nindentation.depth_mm = {depth_mm:?}\n\
             output.layers = [\"pins\"]\n"
        ))
    };
    // Contact begins about 0.95 mm after the robots' zero: their 3 and 5 mm.
    let [shallow, deep] = [2.05, 4.05].map(|depth_mm| render(&job(depth_mm), 0).impression.pins.expect("pins"));
    let mut radii = [(0.0, 0.0, 0.0); 11];
    let middle = deep.rest[0].px.expect("in view");
    for (pin, ((rest, moved), before)) in deep.rest.iter().zip(&deep.moved).zip(&shallow.moved).enumerate() {
        let from = |px: Option<[f64; 2]>| {
            let [x, y] = px.expect("in view");
            f64::hypot(x - middle[0], y - middle[1])
        };
        let k = ring(pin);
        let share = 1.0 / if k == 0 { 1.0 } else { 6.0 * k as f64 };
        radii[k].0 += share * from(rest.px);
        radii[k].1 += share * (from(moved.px) - from(before.px));
    }
    let (mut worst, mut square) = (0.0_f64, 0.0);
    for (k, (rest, moved, _)) in radii.into_iter().enumerate() {
        println!("ring {k}: rest {rest:.2} of {:.2}, moved {moved:.2} of {:.2} px", RINGS_PX[k], FROM_2_TO_4_MM[k]);
        worst = worst.max((rest - RINGS_PX[k]).abs());
        square += (moved - FROM_2_TO_4_MM[k]).powi(2) / 11.0;
    }
    println!("worst ring {worst:.2} px, motion {:.2} px RMS", square.sqrt());
    assert!(worst < 0.25 && square.sqrt() < 0.6, "{worst} px, {} px", square.sqrt());
    assert_eq!(deep.rest.len(), 331);
}

#[test]
fn lenses_take_points_to_pixels_and_back() {
    let shape = GelShape::Dome(GelDome { radius_mm: 15.0 });
    let (position_mm, look_at_mm) = ([1.0, -2.0, -20.0], [0.5, 0.0, 0.0]);
    for lens in [
        LensModel::Orthographic,
        LensModel::Pinhole(Pinhole { fov_deg: 80.0, position_mm, look_at_mm }),
        LensModel::Fisheye(Fisheye { fov_deg: 140.0, position_mm, look_at_mm, k: [-0.05, 0.01, 0.0, 0.0] }),
    ] {
        let camera = Projection::new(&lens, [64, 48], [20.0, 15.0]);
        let mut seen = 0;
        for y in 0..48 {
            for x in 0..64 {
                let px = [x as f64 + 0.3, y as f64 + 0.6];
                let Some(site) = camera.site(&shape, px) else { continue };
                let point = site.point_mm;
                let back = camera.point_px(point).expect("before the camera");
                assert!((0..2).all(|k| (back[k] - px[k]).abs() < 1e-6), "{lens:?} {px:?} {back:?}");
                seen += 1;
            }
        }
        assert!(seen > 2000, "{lens:?}: {seen}");
    }
}

/// The finger `geltip` with square pixels, or part of it.
fn finger(radius_mm: f64, length_mm: f64, px: [usize; 2]) -> Sensor {
    let mut sensor = Sensor::preset("geltip").expect("a preset");
    sensor.resolution_px = px;
    sensor.shape = Some(GelShape::Capsule(GelCapsule { radius_mm, length_mm }));
    let position_mm = [0.0, 0.0, 4.5 - length_mm];
    sensor.lens = LensModel::Pinhole(Pinhole { fov_deg: 90.0, position_mm, look_at_mm: [0.0; 3] });
    sensor.camera.read_noise_levels = 0.0;
    sensor
}

/// A ball pressed into a capsule along its normal, so far from the tip over the gel.
fn press_finger(simulator: &Simulator, ball_mm: f64, depth_mm: f64, from_tip_mm: f64, around_deg: f64) -> Impression {
    let shape = simulator.sensor().shape.clone().expect("it has one");
    let (axes, origin_mm) = shape.frame_at(from_tip_mm, around_deg);
    let pose = Pose::from_quaternion([0.0, 0.0, 0.0, 1.0], [0.0, 0.0, ball_mm - depth_mm]).within(axes, origin_mm);
    simulator.press(&Indenter::clusters(ball(ball_mm), pose))
}

/// Complete elliptic integrals of the first and second kind, of the eccentricity, by the arithmetic-geometric mean.
fn elliptic(eccentricity: f64) -> [f64; 2] {
    let (mut a, mut b) = (1.0, f64::sqrt(1.0 - eccentricity * eccentricity));
    let (mut sum, mut power) = (eccentricity * eccentricity / 2.0, 1.0);
    while a - b > 1e-15 {
        let c = 0.5 * (a - b);
        (a, b) = (0.5 * (a + b), f64::sqrt(a * b));
        sum += power * c * c;
        power *= 2.0;
    }
    let first = std::f64::consts::FRAC_PI_2 / a;
    [first, first * (1.0 - sum)]
}

/// Hertz's force of an elliptic contact over plane modulus: radii of the gap along and across, and the depth (Johnson 1985,
/// equations 4.25 to 4.28 with 4.30).
fn hertz_mm2(along_mm: f64, across_mm: f64, depth_mm: f64) -> f64 {
    let ratio = along_mm / across_mm;
    let (mut low, mut high) = (1e-6, 1.0 - 1e-9);
    let terms = |eccentricity: f64| {
        let [first, second] = elliptic(eccentricity);
        let axes = 1.0 / (1.0 - eccentricity * eccentricity);
        (first - second, axes * second - first)
    };
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        let (slow, steep) = terms(middle);
        if steep / slow < ratio { low = middle } else { high = middle }
    }
    // Depth = p / E b K, 1 / (2 along) = p / E b / (e a)^2 (K - E), force = 2 / 3 p pi a b.
    let eccentricity = 0.5 * (low + high);
    let [first, second] = elliptic(eccentricity);
    let pressure_b = depth_mm / first;
    let a = f64::sqrt(2.0 * along_mm * pressure_b * (first - second)) / eccentricity;
    2.0 / 3.0 * std::f64::consts::PI * pressure_b * a
}

#[test]
fn a_ball_on_a_thick_cylinder_presses_as_hertz_says() {
    // A round contact is one of Hertz's with two equal radii.
    let round = hertz_mm2(3.0, 3.0 / 1.000001, 0.1);
    assert!((round / (4.0 / 3.0 * f64::sqrt(3.0 * 0.1) * 0.1) - 1.0).abs() < 1e-4, "{round}");
    for (radius_mm, ball_mm, depth_mm) in [(10.0, 2.0, 0.06), (12.0, 3.0, 0.08), (30.0, 4.0, 0.15)] {
        let mut sensor = finger(radius_mm, 4.0 * radius_mm, [512, 384]);
        // The camera stands in what would be the gel: only the contact counts.
        sensor.gelpad.thickness_mm = 200.0;
        let simulator = Simulator::new(&sensor, Fidelity::High).expect("a sound sensor");
        let from_tip_mm = radius_mm * std::f64::consts::FRAC_PI_2 + 1.5 * radius_mm;
        let found = press_finger(&simulator, ball_mm, depth_mm, from_tip_mm, 20.0);
        let (modulus, ratio) = (sensor.gelpad.youngs_modulus_kpa, sensor.gelpad.poisson_ratio);
        let across_mm = 1.0 / (1.0 / radius_mm + 1.0 / ball_mm);
        let expected = 1e-3 * modulus / (1.0 - ratio * ratio) * hertz_mm2(ball_mm, across_mm, depth_mm);
        let force = length(found.wrench.expect("an elastic pad").force_n);
        println!("ball of {ball_mm} on a cylinder of {radius_mm} mm: {:.4} of Hertz", force / expected);
        assert!((force / expected - 1.0).abs() < 0.02, "{force} {expected}");
    }
}

#[test]
fn the_same_press_around_a_finger_and_along_it_gives_the_same_force() {
    let simulator = Simulator::new(&finger(12.0, 50.0, [320, 240]), Fidelity::High).expect("a sound sensor");
    let force = |from_tip_mm: f64, around_deg: f64| {
        let found = press_finger(&simulator, 4.0, 0.8, from_tip_mm, around_deg).wrench.expect("an elastic pad");
        let (axes, origin_mm) = simulator.sensor().shape.clone().expect("it has one").frame_at(from_tip_mm, around_deg);
        let (force, torque) = (DVec3::from_array(found.force_n), DVec3::from_array(found.torque_nmm));
        // Into the gel, along its normal, without a moment about that.
        assert!((force.normalize() + axes.z_axis).length() < 5e-3, "{from_tip_mm} {around_deg}: {force}");
        assert!((torque - origin_mm.cross(force)).length() < 0.02 * force.length(), "{torque}");
        force.length()
    };
    for (piece, places) in [("cap", [4.0, 9.0, 15.0]), ("cylinder", [29.0, 33.5, 42.0])] {
        let first = force(places[0], 0.0);
        for from_tip_mm in places {
            for around_deg in [0.0, 37.0, 190.0, -70.0] {
                let share = force(from_tip_mm, around_deg) / first;
                println!("{piece}, {from_tip_mm} mm from the tip, {around_deg} degrees: {share:.5}");
                assert!((share - 1.0).abs() < 5e-3, "{piece}, {from_tip_mm} mm, {around_deg} degrees: {share}");
            }
        }
    }
}

/// Turns a square image of a finger by a quarter, as its camera is turned about the axis.
fn quarter_turn(rgb: &[u8], side: usize) -> Vec<u8> {
    let at = |x: usize, y: usize| &rgb[3 * (y * side + x)..][..3];
    // What was at +x comes to +y.
    (0..side * side).flat_map(|k| at(k / side, side - 1 - k % side).to_vec()).collect()
}

#[test]
fn a_press_turned_about_the_finger_gives_the_image_turned() {
    let mut sensor = finger(12.0, 45.0, [200, 200]);
    // Lit alike from all sides, without grain.
    let Background::Rendered(look) = &mut sensor.background else { panic!("rendered") };
    look.grain = 0.0;
    let led = sensor.leds[0].clone();
    let lit = |azimuth_deg: f64| Led { azimuth_deg, color: [1.0, 0.8, 0.6], ..led.clone() };
    sensor.leds = [0.0, 90.0, 180.0, 270.0].map(lit).to_vec();
    let simulator = Simulator::new(&sensor, Fidelity::Standard).expect("a sound sensor");
    for from_tip_mm in [7.0, 18.0, 22.0] {
        let [first, turned] =
            [10.0, 100.0].map(|around| press_finger(&simulator, 4.0, 1.0, from_tip_mm, around).image.rgb);
        let expected = quarter_turn(&first, 200);
        let off = expected.iter().zip(&turned).map(|(a, b)| a.abs_diff(*b)).max();
        let changed = first.iter().zip(&simulator.untouched().rgb).filter(|(a, b)| a != b).count();
        println!("turned, {from_tip_mm} mm from the tip: {off:?} levels, {changed} values changed by the press");
        assert!(off <= Some(1) && changed > 500, "{from_tip_mm} mm: {off:?} levels, {changed} values");
    }
}

/// Where the chart changes, and where the ball meets the cylinder, neither image nor force does.
#[test]
fn there_is_no_seam_on_a_finger() {
    let sensor = finger(12.0, 45.0, [320, 240]);
    let Some(shape) = sensor.shape.clone() else { panic!("a capsule") };
    let simulator = Simulator::new(&sensor, Fidelity::High).expect("a sound sensor");
    let middle = |from_tip_mm: f64| {
        let (axes, _) = shape.frame_at(from_tip_mm, 30.0);
        Chart::around_site(&shape, shape.site(axes.z_axis, (from_tip_mm - 12.0 * FRAC_PI_2).max(0.0))).latitude()
    };
    let rim_mm = 12.0 * FRAC_PI_2;
    let changes = (1..4000).map(|k| 0.01 * k as f64).filter(|mm| middle(*mm) != middle(mm + 0.01));
    let mut places: Vec<f64> = changes.filter(|mm| (8.0..24.0).contains(mm)).collect();
    assert!(places.len() > 5, "{places:?}");
    places.push(rim_mm - 0.005);
    for from_tip_mm in places {
        let [before, after] = [0.0, 0.01].map(|by| press_finger(&simulator, 4.0, 0.8, from_tip_mm + by, 30.0));
        let forces = [&before, &after].map(|found| length(found.wrench.expect("an elastic pad").force_n));
        let off = before.image.rgb.iter().zip(&after.image.rgb).map(|(a, b)| a.abs_diff(*b));
        let (most, mean) = (off.clone().max(), off.clone().map(f64::from).sum::<f64>() / off.len() as f64);
        // A shadow ends between other nodes of the new chart.
        let few = off.filter(|off| *off > 4).count() as f64 / after.image.rgb.len() as f64;
        println!(
            "{from_tip_mm:.2} mm: {most:?} levels, {few:.5} of the values by more than 4, {mean:.4} on average, force {:.5}",
            forces[1] / forces[0]
        );
        assert!((forces[1] / forces[0] - 1.0).abs() < 5e-3, "{from_tip_mm} mm: {forces:?}");
        assert!(few < 1e-3 && mean < 0.03, "{from_tip_mm} mm: {few}, {mean}");
    }
}

/// Simulators of a flat pad and of a dome with a radius of a kilometre, lit alike and without shadows.
pub fn flat_and_of_a_kilometre(resolution_px: [usize; 2], field_of_view_mm: [f64; 2]) -> [Simulator; 2] {
    let mut flat = Sensor::preset("gelsight-2014").expect("a preset");
    (flat.resolution_px, flat.field_of_view_mm) = (resolution_px, field_of_view_mm);
    let Background::Rendered(look) = &mut flat.background else { panic!("rendered") };
    // It glows at the rim, which is far away.
    look.glow = 0.0;
    let mut dome = flat.clone();
    dome.shape = Some(GelShape::Dome(GelDome { radius_mm: 1e6 }));
    dome.lens = LensModel::Orthographic;
    let models = Models {
        optics: optics::Model::Phong(Phong { shadows: Shadows::None, ..Phong::default() }),
        ..Fidelity::High.models(flat.light_source())
    };
    let policy = EffectPolicy::Without(Effect::Supersampling);
    [flat, dome].map(|sensor| Simulator::with_models(sensor, models.clone(), policy))
}

#[test]
fn a_dome_of_a_kilometre_is_lit_like_a_flat_pad() {
    let [flat, dome] = flat_and_of_a_kilometre([160, 120], [16.0, 12.0]).map(|simulator| {
        let pose = Pose::from_quaternion([0.0, 0.0, 0.0, 1.0], [1.0, 0.5, 4.0 - 0.6]);
        let found = simulator.press(&Indenter::clusters(ball(4.0), pose));
        (found.image.rgb, simulator.untouched().rgb.clone())
    });
    let off = flat.0.iter().zip(&dome.0).map(|(a, b)| a.abs_diff(*b));
    let changed = flat.0.iter().zip(&flat.1).map(|(a, b)| a.abs_diff(*b)).max();
    println!("lit like a flat pad: within {:?} levels, the press changes {changed:?}", off.clone().max());
    assert!(changed > Some(30) && off.max() <= Some(1) && flat.1 == dome.1, "the press changes {changed:?}");
}

/// A closed block whose lower face is centred at the origin.
fn block([w, d, h]: [f64; 3]) -> Shape {
    let corner = |k: usize| {
        let side = |bit: usize, size: f64| if k >> bit & 1 == 1 { 0.5 * size } else { -0.5 * size };
        [side(0, w), side(1, d), if k >> 2 & 1 == 1 { h } else { 0.0 }]
    };
    let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let halves = faces.into_iter().flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]);
    Shape::soup(halves.map(|corners| corners.map(corner)))
}

/// Needles, boxes around the whole gel, plates at the rim, tiny and huge radii: finite, bounded, the same twice.
#[test]
fn nothing_breaks_a_curved_gel() {
    let needle = block([0.05, 0.05, 8.0]);
    let plate = block([60.0, 60.0, 1.0]);
    let crumb = block([0.01; 3]);
    for radius_mm in [1.0, 5.0, 20.0, 1e4] {
        let thickness_mm = f64::min(0.5 * radius_mm, 3.0);
        let field_mm = f64::min(1.9 * radius_mm, 30.0);
        for fidelity in [Fidelity::Draft, Fidelity::High] {
            let mut sensor = dome(radius_mm, field_mm, 48, thickness_mm);
            sensor.pins = Some(Pins {
                at_mm: vec![[0.0; 2], [0.3 * radius_mm.min(10.0), 0.0]],
                length_mm: 0.3 * radius_mm.min(5.0),
                diameter_mm: 0.5,
                skin_smoothing_mm: 0.2,
                along: Along::Press,
                in_plane: 1.0,
                drag_smoothing_mm: 0.0,
                size_jitter: 0.1,
                place_jitter_mm: 0.0,
                mount: None,
            });
            let simulator = Simulator::new(&sensor, fidelity).expect("a sound sensor");
            for (name, shape) in [("needle", &needle), ("plate", &plate), ("crumb", &crumb)] {
                let object = Arc::new(shape.clusters());
                for (turn, towards, deep_mm) in [
                    ([0.0, 0.0, 0.0, 1.0], DVec3::Z, 0.2),
                    ([0.3, 0.1, 0.0, 1.0], DVec3::new(1.0, 0.4, 0.1), 0.3),
                    ([1.0, 0.0, 0.0, 0.0], DVec3::new(0.0, -1.0, -0.2), 0.4),
                    ([0.0, 0.0, 0.0, 1.0], DVec3::Z, radius_mm),
                    ([0.0, 0.0, 0.0, 1.0], DVec3::Z, -1.0),
                ] {
                    let at = (radius_mm - deep_mm) * towards.normalize() - DVec3::new(0.0, 0.0, radius_mm);
                    let pose = Pose::from_quaternion(turn, at.to_array());
                    let pressed = || simulator.press(&Indenter::clusters(Arc::clone(&object), pose));
                    let found = pressed();
                    let at = format!("{name} on {radius_mm} mm, {fidelity:?}, {towards} {deep_mm}");
                    assert!(found.image.finite && found.contact.finite, "{at}");
                    assert!(found.contact.numerics.converged, "{at}: {:?}", found.contact.numerics);
                    let [lowest, highest] = found.contact.range_mm();
                    // A plate that goes through the shell is limited there; a coarse grid may swing over by a little.
                    let most = 1.01 * thickness_mm as f32;
                    assert!(lowest >= -most && highest <= most, "{at}: {lowest} {highest}");
                    let force = DVec3::from_array(found.wrench.expect("elastic").force_n);
                    assert!(force.is_finite(), "{at}");
                    let tips = found.pins.as_ref().expect("pins");
                    assert!(tips.moved.iter().all(|tip| tip.at_mm.is_finite()), "{at}");
                    assert!(found.normals().iter().flatten().all(|value| value.is_finite()), "{at}");
                    assert!(found.image.rgb == pressed().image.rgb, "{at}");
                }
            }
        }
    }
}

/// The same of fingers that are seen by their skin: from the side at the rim, at the tip, across the end, around the finger.
#[test]
fn nothing_breaks_a_finger() {
    let needle = block([0.05, 0.05, 8.0]);
    let plate = block([200.0, 200.0, 1.0]);
    let ring = Shape::bundled(Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/objects/cylinder_shell.obj")));
    for (radius_mm, length_mm) in [(1.0, 1.0), (1.0, 15.0), (11.5, 50.0), (1000.0, 1000.0)] {
        let mut sensor = finger(radius_mm, length_mm, [64, 48]);
        sensor.gelpad.thickness_mm = f64::min(0.3 * radius_mm, 3.0);
        let position_mm = [0.0, 0.0, -length_mm.max(radius_mm)];
        sensor.lens = LensModel::Pinhole(Pinhole { fov_deg: 100.0, position_mm, look_at_mm: [0.0; 3] });
        for fidelity in [Fidelity::Draft, Fidelity::High] {
            let simulator = Simulator::new(&sensor, fidelity).expect("a sound sensor");
            let rim_mm = radius_mm * FRAC_PI_2;
            for (name, shape) in [("needle", &needle), ("plate", &plate), ("ring", &ring)] {
                let object = Arc::new(shape.clusters());
                for (from_tip_mm, around_deg) in [(0.0, 0.0), (rim_mm, 90.0), (rim_mm + length_mm - radius_mm, -45.0)] {
                    let (axes, origin_mm) = sensor.shape.clone().expect("a capsule").frame_at(from_tip_mm, around_deg);
                    for (turn, height_mm) in [
                        ([0.0, 0.0, 0.0, 1.0], -0.1 * sensor.gelpad.thickness_mm),
                        ([0.5, 0.1, 0.0, 1.0], -0.2 * sensor.gelpad.thickness_mm),
                        ([0.0, 0.0, 0.0, 1.0], -radius_mm),
                        ([0.0, 0.0, 0.0, 1.0], 1.0),
                    ] {
                        let pose = Pose::from_quaternion(turn, [0.0, 0.0, height_mm]).within(axes, origin_mm);
                        let pressed = || simulator.press(&Indenter::clusters(Arc::clone(&object), pose));
                        let found = pressed();
                        let at = format!(
                            "{name} on {radius_mm} x {length_mm} mm at {from_tip_mm}, {fidelity:?}, {height_mm}"
                        );
                        assert!(found.image.finite && found.contact.finite, "{at}");
                        assert!(found.contact.numerics.converged, "{at}: {:?}", found.contact.numerics);
                        let [lowest, highest] = found.contact.range_mm();
                        let most = 1.01 * sensor.gelpad.thickness_mm as f32;
                        assert!(lowest >= -most && highest <= most, "{at}: {lowest} {highest}");
                        let force = DVec3::from_array(found.wrench.expect("elastic").force_n);
                        assert!(force.is_finite(), "{at}");
                        assert!(found.normals().iter().flatten().all(|value| value.is_finite()), "{at}");
                        assert!(found.image.rgb == pressed().image.rgb, "{at}");
                    }
                }
            }
        }
    }
}
