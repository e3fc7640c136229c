//! Several objects in one press: none overlaps another, each has what it would have alone, and every pixel is one's.

use std::sync::Arc;

use gelsim_core::base::grid::Grid;
use gelsim_core::depth::outline::{Outline, SIDES};
use gelsim_core::depth::{self, CaptureWindow};
use gelsim_core::effects::EffectPolicy;
use gelsim_core::fidelity::Fidelity;
use gelsim_core::mesh::Mesh;
use gelsim_core::mesh::clusters::Clusters;
use gelsim_core::pose::{Anchor, Angles, PadPlane, Pose, Side};
use gelsim_files::image_file;
use gelsim_job::label::Label;
use gelsim_job::plan::Plan;
use gelsim_job::sample::{Sample, render};
use gelsim_job::scene::{PressSource, Scene};

use super::support::member;
use crate::plan::{plan, repository};
use gelsim_core::pose::Placement;
use gelsim_oracle::shapes::{Random, Shape, matrix, moved};

const OBJECTS: [&str; 6] = ["cube", "letter", "hexagon_nut", "sphere", "prism_corner", "key"];

/// A job of up to five objects in a press of 20 x 15 mm.
fn plan_of_several(seed: u64, objects: &str, pose: &str, more: &str) -> Plan {
    let meshes: String = OBJECTS
        .iter()
        .map(|name| format!("[[object]]\npath = \"objects/{name}.obj\"\nscale = [0.15, 0.6]\n"))
        .collect();
    plan(&format!(
        "fidelity = \"draft\"\n[dataset]\nname = \"a\"\nsamples = 200\nseed = {seed}\n[sensor]\nresolution_px = [80, 60]\n\
         field_of_view_mm = [20.0, 15.0]\n[scene]\nobjects_per_sample = {objects}\n{meshes}[pose]\n{pose}\n[indentation]\n\
         depth_mm = [0.2, 0.9]\n{more}"
    ))
}

/// Every kind of pose.
const POSES: [&str; 4] = [
    "x_mm = [-8.0, 8.0]\ny_mm = [-6.0, 6.0]\nyaw_deg = [0.0, 360.0]",
    "x_mm = [-8.0, 8.0]\ny_mm = [-6.0, 6.0]\nface = \"any\"\nyaw_deg = [0.0, 360.0]\ntilt_deg = [-60.0, 60.0]",
    "x_mm = [-4.0, 4.0]\nyaw_deg = [0.0, 360.0]\nanchor = \"contact\"\ntilt_deg = [0.0, 30.0]",
    "x_mm = [-9.0, 9.0]\ny_mm = { choice = [-3.0, 3.0] }\nanchor = \"origin\"\nroll_deg = [-20.0, 20.0]\npitch_deg = [-20.0, 20.0]",
];

/// The corners of the convex hull of points, from x towards y (Andrew 1979).
fn hull(mut points: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    points.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    points.dedup();
    let left =
        |a: [f64; 2], b: [f64; 2], c: [f64; 2]| (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) > 0.0;
    let half = |points: &mut dyn Iterator<Item = [f64; 2]>| {
        let mut chain: Vec<[f64; 2]> = Vec::new();
        for point in points {
            while chain.len() > 1 && !left(chain[chain.len() - 2], chain[chain.len() - 1], point) {
                chain.pop();
            }
            chain.push(point);
        }
        chain.pop();
        chain
    };
    let mut all = half(&mut points.iter().copied());
    all.extend(half(&mut points.iter().rev().copied()));
    all
}

/// The widest gap between two hulls across a normal of one of their sides, mm: above 0 if and only if they lie apart.
fn gap_mm(a: &[[f64; 2]], b: &[[f64; 2]]) -> f64 {
    let across = |a: &[[f64; 2]], b: &[[f64; 2]]| {
        let sides = (0..a.len()).map(|k| (a[k], a[(k + 1) % a.len()]));
        let gap = |(from, to): ([f64; 2], [f64; 2])| {
            let out = [to[1] - from[1], from[0] - to[0]];
            let along = |p: &[f64; 2]| (out[0] * (p[0] - from[0]) + out[1] * (p[1] - from[1])) / out[0].hypot(out[1]);
            b.iter().map(along).fold(f64::INFINITY, f64::min)
        };
        sides.map(gap).fold(f64::NEG_INFINITY, f64::max)
    };
    across(a, b).max(across(b, a))
}

/// The hull of a labelled object in the pad's plane, from its file, and its lowest point.
fn placed(object: &gelsim_job::label::PressedLabel) -> (Vec<[f64; 2]>, f64) {
    let shape = Shape::bundled(&repository().join("objects").join(format!("{}.obj", object.id)));
    let translation_mm = object.pose.translation_mm;
    let placement = Placement { rotation: matrix(object.pose.quaternion_xyzw), translation_mm };
    let points = shape.vertices.iter().map(|q| moved(&placement, q.map(|mm| object.scale * mm)));
    let points: Vec<[f64; 3]> = points.collect();
    let lowest = points.iter().map(|p| p[2]).fold(f64::INFINITY, f64::min);
    (hull(points.iter().map(|p| [p[0], p[1]]).collect()), lowest)
}

/// From the label alone, as its reader has it: meshes whose shadows on the pad lie apart do not overlap anywhere.
#[test]
fn no_object_overlaps_another_whatever_is_drawn() {
    let (mut pairs, mut closest) = (0, f64::INFINITY);
    for (number, pose) in POSES.iter().enumerate() {
        let plan = plan_of_several(number as u64, "[2, 5]", pose, "");
        for index in 0..60 {
            let sample = render_label(&plan, index);
            let hulls: Vec<_> = sample.objects.iter().map(placed).collect();
            for (k, (a, lowest)) in hulls.iter().enumerate() {
                let deep = sample.objects[k].indentation_depth_mm;
                assert!((lowest + deep).abs() < 1e-5, "object {k} of {number}/{index} is {lowest} deep, not {deep}");
                for (b, _) in &hulls[..k] {
                    let gap = gap_mm(a, b);
                    assert!(gap > 5e-4, "objects of sample {index} under {pose} come within {gap} mm");
                    (pairs, closest) = (pairs + 1, gap.min(closest));
                }
            }
        }
    }
    assert!(pairs > 300 && closest < 0.05, "{pairs} pairs, {closest} mm: the test must see objects close together");
}

/// The label of a sample as it is written.
fn render_label(plan: &Plan, index: u64) -> Label {
    let sample = render(plan, index);
    serde_json::from_slice(&member(plan, &sample, "json")).expect("a label is JSON")
}

#[test]
fn an_outline_parts_what_an_exact_test_parts_but_for_its_angle() {
    let mut random = Random(4);
    let delta = std::f64::consts::PI / SIDES as f64;
    let (mut apart, mut missed) = (0, 0);
    for case in 0..2000 {
        let mut object = |name: &str| {
            let shape = Shape::bundled(&repository().join("objects").join(format!("{name}.obj")));
            let clusters =
                Clusters::new(&Mesh::new(shape.vertices.clone(), shape.triangles.clone()).expect("a mesh").0);
            let angles = Angles {
                yaw_deg: random.within(0.0, 360.0),
                tilt_deg: random.within(-40.0, 40.0),
                tilt_azimuth_deg: random.within(0.0, 360.0),
            };
            let at = [random.within(-9.0, 9.0), random.within(-9.0, 9.0)];
            let pose = Pose::new(Side::MinusZ, angles, at, Anchor::Bounds, -0.5, &clusters);
            let points = shape.vertices.iter().map(|&q| moved(&pose.placement(), q));
            let hull = hull(points.map(|p| [p[0], p[1]]).collect());
            let across = |a: &[f64; 2]| hull.iter().map(|b| (a[0] - b[0]).hypot(a[1] - b[1])).fold(0.0, f64::max);
            let longest = hull.iter().map(across).fold(0.0, f64::max);
            (Outline::of(&clusters, &pose), hull, longest)
        };
        let ((a, hull_a, longest_a), (b, hull_b, longest_b)) = (object("cube"), object("prism_corner"));
        let (found, exact) = (a.gap_mm(&b), gap_mm(&hull_a, &hull_b));
        // Its directions are some of all.
        if found > 1e-5 {
            assert!(exact > 0.0, "case {case}: outlines are {found} apart, the objects overlap by {exact}");
            apart += 1;
        } else if exact > 0.0 {
            missed += 1;
            let most = (longest_a + longest_b) * delta.tan();
            assert!(exact <= most, "case {case}: {exact} mm apart, and the outlines overlap; {most} is the bound");
        }
        for point in hull_a {
            assert!(a.beyond_mm(point) < 1e-5 && (found <= 1e-5 || b.beyond_mm(point) > 0.0));
        }
    }
    assert!(apart > 200 && missed > 0 && missed < apart / 20, "{apart} apart, {missed} missed");
}

/// Numbers of objects by the oracle: which one, captured alone, reaches lowest at each pixel; 0 where none touches.
fn lowest_of(scene: &Scene, plan: &Plan, sample: &Sample) -> Vec<u8> {
    let view = plan.simulator.view();
    let window = CaptureWindow { margin_px: 0, above_mm: plan.thickness_mm() };
    let first = (Arc::clone(scene.clusters.as_ref().expect("an object")), scene.pose);
    let others = scene.other_objects.iter().map(|other| (Arc::clone(&other.clusters), other.pose));
    let alone: Vec<Grid<f32>> = std::iter::once(first)
        .chain(others)
        .map(|(object, pose)| {
            depth::capture_mesh(&object, &pose.placement(), view, window, plan.thickness_mm()).penetration
        })
        .collect();
    let together = sample.impression.depth.below_pad();
    let off = |at: usize| (together.data[at] - alone.iter().map(|alone| alone.data[at]).fold(0.0, f32::max)).abs();
    // As one body their coordinates are rounded otherwise, by a nanometre, which shows on steep sides.
    let odd = (0..together.data.len()).filter(|at| off(*at) > 1e-4).count();
    assert!(odd <= 8, "{odd} pixels of the objects together are not those of one of them alone");
    let lowest = |(at, touches): (usize, &u8)| {
        let deepest = (0..alone.len()).max_by(|a, b| alone[*a].data[at].total_cmp(&alone[*b].data[at]));
        if *touches > 0 { deepest.expect("an object") as u8 + 1 } else { 0 }
    };
    sample.impression.contact.mask.data.iter().enumerate().map(lowest).collect()
}

#[test]
fn each_pixel_belongs_to_the_object_that_reaches_lowest_there() {
    let mut seen = [0_usize; 6];
    for (number, pose) in POSES.iter().enumerate() {
        let plan = plan_of_several(40 + number as u64, "[1, 5]", pose, "");
        for index in 0..25 {
            let (scene, sample) = (Scene::draw(&plan, index, 0), render(&plan, index));
            let (found, expected) = (sample.instance_map(), lowest_of(&scene, &plan, &sample));
            assert_eq!(found, expected, "sample {index} under {pose}");
            found.iter().for_each(|number| seen[usize::from(*number)] += 1);
        }
    }
    assert!(seen.iter().all(|count| *count > 100), "{seen:?}");
}

/// The layers as they are written, through a lens that bends.
#[test]
fn the_mask_of_instances_is_that_of_the_contact_through_any_lens() {
    for lens in ["", "[camera]\ndistortion_k1 = -0.12\n"] {
        let more = format!("{lens}[output]\nlayers = [\"contact\", \"instance\"]\n");
        let plan = plan_of_several(5, "4", POSES[0], &more);
        for index in 0..8 {
            let sample = render(&plan, index);
            let grey = |layer: &str| {
                let rgb = image_file::decode_rgb(&member(&plan, &sample, layer)).expect("a PNG");
                rgb.pixels().map(|pixel| pixel.0[0]).collect::<Vec<u8>>()
            };
            let (contact, instance) = (grey("contact.png"), grey("instance.png"));
            for (contact, instance) in contact.iter().zip(&instance) {
                assert_eq!(*contact > 0, *instance > 0);
            }
            let objects = &sample.label.objects;
            for (k, object) in objects.iter().enumerate() {
                let at: Vec<usize> = (0..instance.len()).filter(|at| usize::from(instance[*at]) == k + 1).collect();
                assert_eq!(object.contact.in_contact, !at.is_empty() || object.contact.area_mm2 > 0.0);
                let ends = |of: &dyn Fn(usize) -> usize| {
                    [at.iter().map(|at| of(*at)).min(), at.iter().map(|at| of(*at) + 1).max()]
                        .map(Option::unwrap_or_default)
                };
                let ([x0, x1], [y0, y1]) = (ends(&|at| at % 80), ends(&|at| at / 80));
                assert_eq!(object.contact.bbox_px, [x0, y0, x1, y1].map(|px| px as u32), "object {k} of {index}");
            }
        }
    }
}

#[test]
fn the_objects_shares_sum_to_the_contact() {
    for fidelity in ["draft", "standard", "paper"] {
        let plan =
            plan_of_several(9, "[1, 4]", POSES[1], "").with_fidelity(Fidelity::named(fidelity).expect("a level"));
        for index in 0..12 {
            let label = render_label(&plan, index);
            let near = |found: f64, whole: f64| (found - whole).abs() <= 1e-12 * (1.0 + whole.abs());
            let contacts = || label.objects.iter().map(|object| &object.contact);
            assert!(near(contacts().map(|own| own.area_mm2).sum(), label.contact.area_mm2), "{:?}", label.contact);
            assert_eq!(contacts().any(|own| own.in_contact), label.contact.in_contact);
            let deepest = contacts().map(|own| own.max_depth_mm).fold(0.0, f64::max);
            assert_eq!(deepest, label.contact.max_depth_mm, "sample {index} at {fidelity}");
            match label.contact.force_n {
                Some(force) => assert!(near(contacts().filter_map(|own| own.force_n).sum(), force), "{fidelity}"),
                None => assert!(contacts().all(|own| own.force_n.is_none())),
            }
            let first = &label.objects[0];
            assert_eq!(
                (&first.id, &first.pose, first.scale),
                (&label.header.object.id, &label.pose, label.header.object.scale)
            );
            assert_eq!(first.indentation_depth_mm, label.indentation_depth_mm);
        }
    }
}

/// Two balls of 2 mm radius, 0.4 mm deep, `apart` mm from each other, or the one of them alone.
fn balls(apart: f64, both: bool) -> Plan {
    let (count, x) = if both {
        (2, format!("{{ choice = [{}, {}] }}", -apart / 2.0, apart / 2.0))
    } else {
        (1, format!("{}", apart / 2.0))
    };
    plan(&format!(
        "fidelity = \"high\"\n[dataset]\nname = \"a\"\nsamples = 4\nseed = 1\n[sensor]\nresolution_px = [240, 120]\n\
         field_of_view_mm = [24.0, 12.0]\n[scene]\nobjects_per_sample = {count}\n[[object]]\npath = \"objects/sphere.obj\"\nscale = 0.5\n\
         [pose]\nx_mm = {x}\n[indentation]\ndepth_mm = 0.4\n"
    ))
}

#[test]
fn two_balls_far_apart_press_like_each_of_them_alone() {
    // Pads couple what is pressed into them over about their thickness: the farther, the less.
    let bounds = [(6.0, 0.02), (10.0, 5e-3), (16.0, 2e-3)];
    let mut before = f64::INFINITY;
    for (apart, bound) in bounds {
        let (both, alone) = (render(&balls(apart, true), 0).label, render(&balls(apart, false), 0).label);
        let force = |label: &Label, k: usize| label.objects[k].contact.force_n.expect("an elastic pad");
        let off = (0..2).map(|k| (force(&both, k) / force(&alone, 0) - 1.0).abs()).fold(0.0, f64::max);
        println!("{apart} mm apart: {off:.2e} of the force");
        assert!(off < bound && off < before, "{apart} mm apart: {off}");
        let areas = both.objects.iter().map(|object| object.contact.area_mm2 / alone.contact.area_mm2 - 1.0);
        // A pixel or two at the edge of a disc of a thousand may change.
        let area = areas.map(f64::abs).fold(0.0, f64::max);
        println!("{apart} mm apart: {area:.2e} of the area");
        assert!(area < 0.02, "{apart} mm apart: {area}");
        before = off;
    }
}

#[test]
fn a_job_of_one_object_has_the_images_of_a_job_without_a_scene() {
    let with = plan_of_several(21, "1", POSES[1], "[output]\nlayers = [\"depth\", \"contact\", \"pressure\"]\n");
    let written = with.to_toml().expect("TOML");
    let without = plan(&written.replace("[scene]\nobjects_per_sample = 1\n", ""));
    assert!(with.job().scene.is_some() && without.job().scene.is_none());
    for index in 0..6 {
        let samples = [&with, &without].map(|plan| render(plan, index));
        for layer in ["tactile.png", "depth.exr", "contact.png", "pressure.exr", "json"] {
            assert_eq!(member(&with, &samples[0], layer), member(&without, &samples[1], layer), "{layer} of {index}");
        }
        let instances = samples[0].instance_map();
        assert!(instances.iter().zip(samples[0].impression.contact_mask()).all(|(own, mask)| *own == mask / 255));
    }
}

#[test]
fn the_first_object_is_drawn_as_if_it_were_alone() {
    let (several, one) = (plan_of_several(3, "[1, 4]", POSES[1], ""), plan_of_several(3, "1", POSES[1], ""));
    let mut counts = [0; 5];
    for index in 0..200 {
        let [a, b] = [&several, &one].map(|plan| Scene::draw(plan, index, 0));
        let (PressSource::Object(first), PressSource::Object(alone)) = (&a.pressed, &b.pressed) else {
            panic!("objects")
        };
        assert_eq!((first, a.pose, a.scale, a.indentation_depth_mm), (alone, b.pose, b.scale, b.indentation_depth_mm));
        counts[1 + a.other_objects.len() + a.unplaced as usize] += 1;
    }
    // 50 of each are expected, give or take 6.
    assert!(counts[0] == 0 && counts[1..].iter().all(|count| (30..=70).contains(count)), "{counts:?}");
}

#[test]
fn companions_are_of_the_samples_own_split() {
    let text = plan_of_several(8, "3", POSES[0], "").to_toml().expect("TOML");
    assert!(text.contains("split_by = \"sample\""));
    let text = text.replace("split_by = \"sample\"", "split_by = \"object\"");
    let start = text.find("[dataset.splits]").expect("splits");
    let end = start + text[start..].find("\n\n").expect("an end");
    let text = format!("{}[dataset.splits]\ntrain = 0.5\nval = 0.25\ntest = 0.25{}", &text[..start], &text[end..]);
    let plan = plan(&text);
    let mut by_object = std::collections::BTreeMap::new();
    for index in 0..200 {
        let scene = Scene::draw(&plan, index, 0);
        let PressSource::Object(first) = scene.pressed else { panic!("an object") };
        for number in std::iter::once(first).chain(scene.other_objects.iter().map(|other| other.number)) {
            let split = by_object.entry(number).or_insert(scene.split);
            assert_eq!(*split, scene.split, "object {number} of sample {index}");
        }
    }
    assert_eq!(by_object.len(), OBJECTS.len());
}

#[test]
fn all_effects_make_the_same_image_of_several_objects() {
    let more = "[texture]\namplitude_mm = 0.03\nscale_mm = 1.0\npatterns = [\"noise\"]\n";
    let plan = plan_of_several(6, "3", POSES[0], more);
    let all = plan.with_policy(EffectPolicy::All);
    for index in 0..4 {
        let [gated, all] = [&plan, &all].map(|plan| render(plan, index));
        assert_eq!(gated.impression.image.rgb, all.impression.image.rgb, "sample {index}");
        assert_eq!(gated.instance_map(), all.instance_map());
        assert_eq!(gated.label.objects, all.label.objects);
    }
}

/// On a dome, several objects over one plane that touches it beside its tip.
#[test]
fn objects_on_a_gel_that_is_not_flat_are_told_apart_by_their_places_on_it() {
    let plan = plan(
        "fidelity = \"draft\"\n[dataset]\nname = \"a\"\nsamples = 8\nseed = 2\n[sensor]\npreset = \"geltip\"\nresolution_px = [160, 120]\n\
         [scene]\nobjects_per_sample = 3\n[[object]]\npath = \"objects/sphere.obj\"\nscale = 0.3\n[[object]]\npath = \"objects/cube.obj\"\n\
         scale = 0.3\n[pose]\nx_mm = [-3.0, 3.0]\ny_mm = [-3.0, 3.0]\nyaw_deg = [0.0, 360.0]\nfrom_tip_mm = [0.0, 6.0]\n\
         around_deg = [0.0, 360.0]\n[indentation]\ndepth_mm = [1.0, 1.4]\n",
    );
    let mut told_apart = 0;
    for index in 0..8 {
        let (scene, sample) = (Scene::draw(&plan, index, 0), render(&plan, index));
        assert_ne!(scene.plane, PadPlane::default());
        // Where the image shows the gel at an object, that object is above it: nearest by its mesh.
        let (points, instances) = (sample.impression.points_mm(), sample.instance_map());
        let first = (Arc::clone(scene.clusters.as_ref().expect("an object")), scene.pose);
        let objects: Vec<_> = std::iter::once(first)
            .chain(scene.other_objects.iter().map(|o| (Arc::clone(&o.clusters), o.pose)))
            .collect();
        let distance = |(object, pose): &(Arc<Clusters>, Pose), point: glam::DVec3| {
            let own = pose.rotation.transpose() * (point - pose.translation_mm);
            gelsim_core::mesh::nearest::nearest_point(object, own).distance(own)
        };
        let mut seen = std::collections::BTreeSet::new();
        for (point, instance) in points.iter().zip(&instances).step_by(7).filter(|(_, instance)| **instance > 0) {
            let point = glam::DVec3::from_array(point.map(f64::from));
            let nearest = (0..objects.len())
                .min_by(|a, b| distance(&objects[*a], point).total_cmp(&distance(&objects[*b], point)))
                .expect("an object");
            assert_eq!(nearest + 1, usize::from(*instance), "sample {index} at {point}");
            seen.insert(*instance);
        }
        told_apart += usize::from(seen.len() > 1);
    }
    assert!(told_apart >= 4, "{told_apart} samples show more than one object");
}
