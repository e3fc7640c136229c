//! Labels against what they describe: pose, contact, and the signs of the contract's frame.

use std::path::Path;

use gelsim_core::pose::Placement;
use gelsim_files::image_file;
use gelsim_job::label::Label;
use gelsim_job::plan::Plan;
use gelsim_job::sample::Sample;
use gelsim_job::sample::render;

use super::support::{member, position};
use crate::plan::plan;
use gelsim_oracle::scenery::Scenery;
use gelsim_oracle::shapes::{Shape, matrix, moved};

const FACES: [(&str, [f64; 3]); 6] = [
    ("-x", [-1.0, 0.0, 0.0]),
    ("+x", [1.0, 0.0, 0.0]),
    ("-y", [0.0, -1.0, 0.0]),
    ("+y", [0.0, 1.0, 0.0]),
    ("-z", [0.0, 0.0, -1.0]),
    ("+z", [0.0, 0.0, 1.0]),
];

fn job(object: &str, pose: &str, depth_mm: f64) -> Plan {
    plan(&format!(
        "fidelity = \"high\"\n[dataset]\nname = \"a\"\nsamples = 50\nseed = 3\n[[object]]\npath = \"objects/{object}.obj\"\n[sensor]\n\
         resolution_px = [96, 72]\n[pose]\n{pose}\n[indentation]\ndepth_mm = {depth_mm:?}\n[output]\n\
         layers = [\"depth\", \"contact\"]\n"
    ))
}

fn shape(object: &str) -> Shape {
    Shape::bundled(&Path::new(env!("CARGO_MANIFEST_DIR")).join("objects").join(format!("{object}.obj")))
}

/// The label as a reader of the dataset has it.
fn written_label(plan: &Plan, sample: &Sample) -> Label {
    serde_json::from_slice(&member(plan, sample, "json")).expect("a label is JSON")
}

fn placement(label: &Label) -> Placement {
    Placement { rotation: matrix(label.pose.quaternion_xyzw), translation_mm: label.pose.translation_mm }
}

#[test]
fn the_labels_pose_puts_the_mesh_where_the_depth_map_shows_it() {
    for object in ["key", "letter", "bolt", "prism_corner"] {
        let pose = "face = \"any\"\nyaw_deg = [0.0, 360.0]\ntilt_deg = [-30.0, 30.0]\nx_mm = [-2.0, 2.0]\n\
                    y_mm = [-2.0, 2.0]";
        let plan = job(object, pose, 1.3);
        let shape = shape(object);
        for index in 0..6 {
            let sample = render(&plan, index);
            let label = written_label(&plan, &sample);
            let length: f64 = label.pose.quaternion_xyzw.iter().map(|q| q * q).sum();
            assert!(
                (length - 1.0).abs() < 1e-12 && label.pose.quaternion_xyzw[3] >= 0.0,
                "{:?}",
                label.pose.quaternion_xyzw
            );

            let placement = placement(&label);
            let lowest = shape.vertices.iter().map(|&q| moved(&placement, q)[2]).fold(f64::INFINITY, f64::min);
            assert!((lowest + label.indentation_depth_mm).abs() < 2e-6, "{object} {index}: lowest at {lowest}");

            // Every pixel of the depth map, from the label and the mesh alone.
            let truth = Scenery::new(&shape, &placement, plan.simulator.view(), sample.impression.depth.margin_px);
            let depth = &sample.impression.depth.penetration;
            let mut touching = 0;
            for y in (0..depth.height).step_by(3) {
                for x in (0..depth.width).step_by(2) {
                    let found = -f64::from(depth.at(x, y).max(0.0));
                    touching += usize::from(found < 0.0);
                    assert!(truth.agrees(x, y, found), "{object} {index}: {found} at {x}, {y}");
                }
            }
            assert!(touching > 3, "{object} {index}: {touching} pixels");
        }
    }
}

#[test]
fn a_known_corner_is_seen_where_the_label_puts_it() {
    // A corner that is steep on all sides.
    let shape = shape("prism_corner");
    let plan = job("prism_corner", "yaw_deg = [0.0, 360.0]\ntilt_deg = [-10.0, 10.0]\nx_mm = [-4.0, 4.0]", 2.0);
    for index in 0..20 {
        let sample = render(&plan, index);
        let placement = placement(&written_label(&plan, &sample));
        let corners = shape.vertices.iter().map(|&q| moved(&placement, q));
        let [x, y, z] = corners.min_by(|a, b| a[2].total_cmp(&b[2])).expect("a mesh has corners");
        assert!((z + 2.0).abs() < 1e-6, "{z}");
        let margin = sample.impression.depth.margin_px;
        let (mut deepest, mut seen) = (0.0, [0.0; 2]);
        for row in 0..72 {
            for column in 0..96 {
                let mm = sample.impression.depth.penetration.at(column + margin, row + margin);
                if mm > deepest {
                    (deepest, seen) = (mm, position(plan.simulator.view(), column as f64, row as f64));
                }
            }
        }
        // The deepest pixel is a neighbour of the corner, or the next one along an edge.
        let pitch = plan.simulator.view().mm_per_px[0];
        let off = (seen[0] - x).hypot(seen[1] - y);
        assert!(off < 2.0 * pitch, "sample {index}: corner at ({x}, {y}), deepest pixel at {seen:?}");
    }
}

/// Rotation about a unit axis, as in any textbook.
fn about(axis: [f64; 3], angle_deg: f64) -> [[f64; 3]; 3] {
    let (sin, cos) = angle_deg.to_radians().sin_cos();
    let [x, y, z] = axis;
    let t = 1.0 - cos;
    [
        [t * x * x + cos, t * x * y - sin * z, t * x * z + sin * y],
        [t * x * y + sin * z, t * y * y + cos, t * y * z - sin * x],
        [t * x * z - sin * y, t * y * z + sin * x, t * z * z + cos],
    ]
}

fn times(matrix: [[f64; 3]; 3], vector: [f64; 3]) -> [f64; 3] {
    moved(&Placement { rotation: matrix, translation_mm: [0.0; 3] }, vector)
}

fn assert_close(found: [f64; 3], expected: [f64; 3], what: &str) {
    let off = (0..3).map(|k| (found[k] - expected[k]).abs()).fold(0.0, f64::max);
    assert!(off < 1e-12, "{what}: {found:?}, not {expected:?}");
}

#[test]
fn the_rotation_is_face_first_then_yaw_then_tilt() {
    for (face, side) in FACES {
        for (yaw, tilt, azimuth) in [(0.0, 0.0, 0.0), (90.0, 0.0, 0.0), (90.0, 30.0, 0.0), (25.0, -40.0, 70.0)] {
            let pose =
                format!("face = \"{face}\"\nyaw_deg = {yaw:?}\ntilt_deg = {tilt:?}\ntilt_azimuth_deg = {azimuth:?}");
            let plan = job("cube", &pose, 0.5);
            let label = written_label(&plan, &render(&plan, 0));
            assert_eq!((label.pose.yaw_deg, label.pose.tilt_deg, label.pose.tilt_azimuth_deg), (yaw, tilt, azimuth));
            let rotation = matrix(label.pose.quaternion_xyzw);

            // The face looks at the camera but for the tilt; yaw turns about that direction and cannot move it.
            let (sin, cos) = azimuth.to_radians().sin_cos();
            let tilted = about([cos, sin, 0.0], tilt);
            let what = format!("face {face}, yaw {yaw}, tilt {tilt} about {azimuth}");
            assert_close(times(rotation, side), times(tilted, [0.0, 0.0, -1.0]), &what);

            // Faces are turned about x or y, so one of these axes stays where yaw and tilt take it.
            let kept = if matches!(face, "-x" | "+x") { [0.0, 1.0, 0.0] } else { [1.0, 0.0, 0.0] };
            let expected = times(tilted, times(about([0.0, 0.0, 1.0], yaw), kept));
            assert_close(times(rotation, kept), expected, &what);
        }
    }
}

#[test]
fn without_rotation_the_axes_are_parallel_and_yaw_goes_from_x_towards_y() {
    let plan_at = |yaw: f64| job("cube", &format!("yaw_deg = {yaw:?}"), 0.5);
    let quaternion = |yaw: f64| render(&plan_at(yaw), 0).label.pose.quaternion_xyzw;
    assert_eq!(quaternion(0.0), [0.0, 0.0, 0.0, 1.0]);
    assert_close(times(matrix(quaternion(90.0)), [1.0, 0.0, 0.0]), [0.0, 1.0, 0.0], "x after a yaw of 90");
}

#[test]
fn an_object_at_plus_x_and_plus_y_is_right_of_and_below_the_middle() {
    for (x_mm, y_mm) in [(4.0, 2.5), (-4.0, 2.5), (4.0, -2.5), (-4.0, -2.5)] {
        let plan = job("sphere", &format!("x_mm = {x_mm:?}\ny_mm = {y_mm:?}"), 0.6);
        let sample = render(&plan, 0);
        let centroid = written_label(&plan, &sample).contact.centroid_mm;
        // The contact is symmetric but for the grid of pixels.
        assert!((centroid[0] - x_mm).abs() < 0.1 && (centroid[1] - y_mm).abs() < 0.1, "{centroid:?}");
        let mask = image_file::decode_rgb(&member(&plan, &sample, "contact.png")).expect("a PNG");
        for (column, row, pixel) in mask.enumerate_pixels() {
            if pixel.0[0] > 0 {
                assert_eq!(column >= 48, x_mm > 0.0, "column {column} for x = {x_mm}");
                assert_eq!(row >= 36, y_mm > 0.0, "row {row} for y = {y_mm}");
            }
        }
    }
}

#[test]
fn the_labels_contact_can_be_computed_from_the_written_mask() {
    for (object, depth_mm) in [("key", 0.8), ("dots", 0.4), ("gear", 1.5), ("rope", 0.05), ("sphere", 0.0)] {
        let pose = "yaw_deg = [0.0, 360.0]\ntilt_deg = [0.0, 20.0]\nx_mm = [-14.0, 14.0]\ny_mm = [-9.0, 9.0]";
        let plan = job(object, pose, depth_mm);
        for index in 0..8 {
            let sample = render(&plan, index);
            let mask = image_file::decode_rgb(&member(&plan, &sample, "contact.png")).expect("a PNG");
            let contact = written_label(&plan, &sample).contact;
            let [pitch_x, pitch_y] = plan.simulator.view().mm_per_px;
            let touching: Vec<(u32, u32)> = mask
                .enumerate_pixels()
                .inspect(|(_, _, pixel)| assert!(pixel.0[0] == 0 || pixel.0[0] == 255))
                .filter(|(_, _, pixel)| pixel.0[0] == 255)
                .map(|(column, row, _)| (column, row))
                .collect();
            let count = touching.len() as f64;
            assert_eq!(contact.in_contact, count > 0.0);
            assert!((contact.area_mm2 - count * pitch_x * pitch_y).abs() < 1e-9, "{count} px: {}", contact.area_mm2);
            assert!((contact.fraction - count / (96.0 * 72.0)).abs() < 1e-12, "{count} px: {}", contact.fraction);
            if touching.is_empty() {
                assert_eq!((contact.centroid_mm, contact.bbox_px, contact.max_depth_mm), ([0.0; 2], [0; 4], 0.0));
                continue;
            }
            let columns = || touching.iter().map(|(column, _)| *column);
            let rows = || touching.iter().map(|(_, row)| *row);
            let mean = |values: &mut dyn Iterator<Item = u32>| values.map(f64::from).sum::<f64>() / count;
            let centroid = position(plan.simulator.view(), mean(&mut columns()), mean(&mut rows()));
            for (found, expected) in contact.centroid_mm.into_iter().zip(centroid) {
                assert!((found - expected).abs() < 1e-9, "{found} {expected}");
            }
            let bounds = [columns().min(), rows().min(), columns().max().map(|x| x + 1), rows().max().map(|y| y + 1)];
            assert_eq!(contact.bbox_px.map(Some), bounds);
            // The pad touches the object only where the object is below the undeformed pad, or as high as it bulges.
            let margin = sample.impression.depth.margin_px;
            let depth =
                |(column, row)| sample.impression.depth.penetration.at(column as usize + margin, row as usize + margin);
            assert!(
                touching.iter().all(|at| depth(*at) > 0.0 || -depth(*at) <= sample.impression.contact.bulge_mm + 1e-3)
            );
            let deepest = touching.iter().map(|at| f64::from(depth(*at))).fold(0.0, f64::max);
            let found = contact.max_depth_mm;
            // serde_json reads floats to within their last bit.
            assert!(
                found >= deepest - 1e-12 && found <= depth_mm + 2e-6,
                "{object} {index}: {found}, {deepest} of {depth_mm}"
            );
        }
    }
}

#[test]
fn a_press_by_force_finds_the_depth_on_flat_and_curved_gels_for_one_object_and_several() {
    let press = |sensor: &str, more: &str, force: &str| {
        let text = format!(
            "[dataset]\nname = \"a\"\nsamples = 4\n[[object]]\npath = \"objects/sphere.obj\"\n[[object]]\npath = \"objects/cube.obj\"\n\
             [sensor]\n{sensor}\n[indentation]\nforce_n = {force}\n{more}"
        );
        let plan = plan(&text);
        (0..4).map(|index| render(&plan, index).label).collect::<Vec<_>>()
    };
    let flat = "resolution_px = [96, 72]";
    let several = "[scene]\nobjects_per_sample = 2\n[pose]\nx_mm = [-4.0, 4.0]\ny_mm = [-3.0, 3.0]\n";
    let tactip = "preset = \"tactip\"\nresolution_px = [96, 96]";
    for (sensor, more, force) in [
        (flat, "", "[0.05, 5.0]"),
        (flat, "[pose]\ntilt_deg = 10.0\n[shear]\nx_mm = 0.1\n[output]\nlayers = [\"flow\"]\n", "1.0"),
        (flat, several, "[0.5, 2.0]"),
        (tactip, "[pose]\nfrom_tip_mm = [0.0, 6.0]\naround_deg = [0.0, 360.0]\n", "[0.3, 1.5]"),
    ] {
        for label in press(sensor, more, force) {
            assert!(label.health.healthy, "{}", label.health.reason);
            let found = label.contact.total_force_n.expect("a known force");
            let off = found / label.wanted_force_n - 1.0;
            assert!(off.abs() <= label.force_tolerance * (1.0 + 1e-9), "{found} of {} N", label.wanted_force_n);
            let most = if sensor == flat { 2e-3 } else { 2e-2 };
            assert!(label.force_tolerance <= most, "{}", label.force_tolerance);
            let depths: Vec<f64> = label.objects.iter().map(|object| object.indentation_depth_mm).collect();
            assert!(label.indentation_depth_mm > 0.01 && depths.iter().all(|mm| *mm == depths[0]), "{depths:?}");
        }
    }
    // More than the pad can give.
    for label in press(flat, "", "1e5") {
        assert!(!label.health.healthy && label.health.reason.contains("are wanted, but at"), "{}", label.health.reason);
    }
    // Some samples do not touch, and want nothing.
    let label = press(flat, "no_contact = 1.0", "1.0").remove(0);
    assert!(label.health.healthy && label.wanted_force_n == 0.0 && label.indentation_depth_mm == 0.0);
}
