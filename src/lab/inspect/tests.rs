//! Meshes with one flaw each, and what is said of them.

use std::f64::consts::TAU;
use std::fs;

use super::*;
use gelsim_core::pose::Anchor;
use gelsim_files::sensor::PRESETS;
use gelsim_job::config::scene::Face;
use gelsim_job::inspection::findings::FindingKind;

type Shape = (Vec<[f64; 3]>, Vec<[u32; 3]>);

/// A box from `low` to `high`.
fn block(low: [f64; 3], high: [f64; 3]) -> Shape {
    let corner = |i: usize| [0, 1, 2].map(|k| if i >> k & 1 == 0 { low[k] } else { high[k] });
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    ((0..8).map(corner).collect(), triangles)
}

/// A cup, open at the top, of this radius and height, standing on z = 0.
fn cup(radius: f64, height: f64) -> Shape {
    const AROUND: u32 = 64;
    let ring = |z: f64| {
        (0..AROUND).map(move |i| {
            let turn = TAU * f64::from(i) / f64::from(AROUND);
            [radius * turn.cos(), radius * turn.sin(), z]
        })
    };
    let vertices = ring(0.0).chain(ring(height)).chain([[0.0; 3]]).collect();
    let wall = |i: u32| {
        let next = (i + 1) % AROUND;
        [[i, next, AROUND + next], [i, AROUND + next, AROUND + i], [next, i, 2 * AROUND]]
    };
    (vertices, (0..AROUND).flat_map(wall).collect())
}

fn together(shapes: impl IntoIterator<Item = Shape>) -> Shape {
    let (mut vertices, mut triangles): Shape = Default::default();
    for (more, corners) in shapes {
        let shift = vertices.len() as u32;
        vertices.extend(more);
        triangles.extend(corners.iter().map(|corners| corners.map(|vertex| vertex + shift)));
    }
    (vertices, triangles)
}

/// Inspects a shape after a trip through an OBJ file, as `gelsight-2014` would see it.
fn inspected((vertices, triangles): &Shape, unit: Unit) -> Inspection {
    let mut text = String::new();
    vertices.iter().for_each(|[x, y, z]| text += &format!("v {x} {y} {z}\n"));
    triangles.iter().for_each(|corners| {
        let [a, b, c] = corners.map(|vertex| vertex + 1);
        text += &format!("f {a} {b} {c}\n");
    });
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("shape.obj");
    fs::write(&path, text).expect("a file");
    inspect_mesh(&path, unit.mm_per_unit().into(), &pad())
}

fn pad() -> SensorPad {
    SensorPad::from_preset("gelsight-2014").expect("a preset")
}

fn kinds(inspection: &Inspection) -> Vec<FindingKind> {
    inspection.findings.iter().map(|finding| finding.kind).collect()
}

fn message(inspection: &Inspection, kind: FindingKind) -> String {
    let found = inspection.findings.iter().find(|finding| finding.kind == kind);
    found.unwrap_or_else(|| panic!("no {kind:?} in {:?}", inspection.findings)).message.clone()
}

fn side(inspection: &Inspection, face: Face) -> &SideReport {
    let sides = &inspection.mesh.as_ref().expect("a mesh").sides;
    sides.iter().find(|side| side.face == face).expect("six sides")
}

#[test]
fn every_preset_is_a_pad_and_nothing_else_is() {
    for (name, _) in PRESETS {
        assert_eq!(SensorPad::from_preset(name).expect("a pad").sensor, name);
    }
    assert_eq!(SensorPad::from_preset("gelsight"), None);
}

#[test]
fn a_cube_has_six_good_sides_of_the_right_size() {
    let inspection = inspected(&block([-4.0, -2.0, 0.0], [4.0, 2.0, 6.0]), Unit::Mm);
    assert_eq!((inspection.severity, kinds(&inspection)), (None, vec![]));
    let facts = inspection.mesh.as_ref().expect("a mesh");
    assert_eq!((facts.size_mm, facts.centre_mm), ([8.0, 4.0, 6.0], [0.0, 0.0, 3.0]));
    for (face, outline_mm) in FACES_AND_OUTLINES {
        let side = side(&inspection, face);
        assert_eq!(side.outline_mm, outline_mm);
        let [width, height] = side.outline_px.map(f64::round);
        assert_eq!(side.touching_px as f64, width * height, "{face:?}");
        assert_eq!(side.view_fraction, side.touching_fraction);
        assert!(side.relief_mm.is_some_and(|[low, high]| low < 1e-5 && high < 1e-5), "{side:?}");
        assert!(
            side.fits && side.anchor == Some(Anchor::Bounds) && !side.slips && side.thin_fraction < 1e-3,
            "{side:?}"
        );
    }
}

const FACES_AND_OUTLINES: [(Face, [f64; 2]); 6] = [
    (Face::MinusX, [6.0, 4.0]),
    (Face::PlusX, [6.0, 4.0]),
    (Face::MinusY, [8.0, 6.0]),
    (Face::PlusY, [8.0, 6.0]),
    (Face::MinusZ, [8.0, 4.0]),
    (Face::PlusZ, [8.0, 4.0]),
];

#[test]
fn a_mug_in_metres_is_told_from_one_that_is_a_tenth_of_a_millimetre_large() {
    let mug = cup(0.04, 0.09);
    let wrong = inspected(&mug, Unit::Mm);
    assert_eq!((wrong.severity, kinds(&wrong)), (Some(Severity::Warning), vec![FindingKind::Unit]));
    let text = message(&wrong, FindingKind::Unit);
    assert!(text.contains("0.09 mm long") && text.contains("look like metres (90 mm)"), "{text}");
    assert!(wrong.findings.iter().any(|finding| finding.help.contains("unit = \"m\"")));

    let right = inspected(&mug, Unit::M);
    assert!(!kinds(&right).contains(&FindingKind::Unit), "{:?}", right.findings);
    assert!(
        text::format_inspection(&right, &pad(), None).contains("1 hole with 64 open edges"),
        "{}",
        text::format_inspection(&right, &pad(), None)
    );
    // Its mouth is a ring larger than the view: the middle touches nothing, wherever the anchor is.
    assert_eq!((side(&right, Face::PlusZ).anchor, side(&right, Face::PlusZ).slips), (None, false));
    assert!(message(&right, FindingKind::OffCentre).starts_with("+z: in the middle"), "{:?}", right.findings);
    // Its bottom covers the view.
    assert!(message(&right, FindingKind::Featureless).starts_with("-z: a flat face"), "{:?}", right.findings);

    let inches = inspected(&block([0.0; 3], [1.2, 0.5, 0.5]), Unit::Mm);
    assert!(message(&inches, FindingKind::Unit).contains("look like inches (30.5 mm)"));
    assert!(inches.findings[0].help.contains("unit = \"in\""));
    let twice = inspected(&block([0.0; 3], [30.0, 40.0, 50.0]), Unit::In);
    assert!(message(&twice, FindingKind::Unit).contains("look like millimetres (50 mm)"));
}

#[test]
fn sizes_that_cannot_be_captured_are_warnings() {
    let huge = inspected(&block([0.0; 3], [1e5; 3]), Unit::Mm);
    assert_eq!((huge.severity, kinds(&huge)[0]), (Some(Severity::Warning), FindingKind::TooLarge));
    assert!(huge.mesh.as_ref().is_some_and(|facts| facts.sides.is_empty() && facts.surface.closed_parts == 1));
    let tiny = inspected(&block([0.0; 3], [1e-2; 3]), Unit::Mm);
    assert_eq!((tiny.severity, kinds(&tiny)[0]), (Some(Severity::Warning), FindingKind::TooSmall));
    assert!(message(&tiny, FindingKind::TooSmall).contains("look like metres (10 mm)"));
    let long = inspected(&block([0.0; 3], [500.0, 20.0, 20.0]), Unit::Mm);
    assert_eq!((long.severity, kinds(&long)[0]), (Some(Severity::Note), FindingKind::Large));
}

#[test]
fn extreme_coordinates_are_inspected_without_a_panic() {
    for size in [f64::from(f32::MAX), 1e20, 1e-20, 1e-40] {
        let inspection = inspected(&(vec![[0.0; 3], [size, 0.0, 0.0], [0.0, size, 0.0]], vec![[0, 1, 2]]), Unit::Mm);
        assert!(inspection.severity >= Some(Severity::Warning), "{size}: {:?}", inspection.findings);
        assert!(!text::format_inspection(&inspection, &pad(), None).is_empty());
    }
}

#[test]
fn what_a_job_cannot_read_is_an_error_without_facts() {
    let missing = inspect_mesh(Path::new("no-such-file.obj"), 1.0.into(), &pad());
    assert!(missing.mesh.is_none() && kinds(&missing) == [FindingKind::Unreadable]);
    assert_eq!(missing.severity, Some(Severity::Error));
    let flat = inspected(&(vec![[0.0; 3], [1.0; 3], [2.0; 3]], vec![[0, 1, 2]]), Unit::Mm);
    assert_eq!(message(&flat, FindingKind::Unreadable), "no triangle left: dropped 1 triangle without area");
}

#[test]
fn flaws_that_capture_does_not_mind_are_facts_and_nothing_to_act_on() {
    let (vertices, sound) = block([-4.0; 3], [4.0; 3]);
    let said = |change: &dyn Fn(&mut Vec<[u32; 3]>), fact: &str| {
        let mut triangles = sound.clone();
        change(&mut triangles);
        let inspection = inspected(&(vertices.clone(), triangles), Unit::Mm);
        assert_eq!(inspection.severity, None, "{:?}", inspection.findings);
        let text = text::format_inspection(&inspection, &pad(), None);
        assert!(text.contains(fact), "{fact:?} in {text}");
    };
    said(&|triangles| triangles[3].swap(0, 2), "1 triangle that faces another way");
    said(&|triangles| triangles.iter_mut().for_each(|corners| corners.swap(0, 2)), "1 part inside out, or a cavity");
    said(&|triangles| triangles.extend(sound.repeat(1000)), "12000 triangles twice there left out");
    said(&|triangles| triangles.push([0, 0, 1]), "1 triangle without area left out");
}

#[test]
fn a_missing_lid_is_a_hole_and_its_rim_without_thickness_slips_between_the_pixels() {
    let (vertices, mut triangles) = block([-4.0; 3], [4.0; 3]);
    triangles.drain(2..4);
    let inspection = inspected(&(vertices, triangles), Unit::Mm);
    assert_eq!(kinds(&inspection), [FindingKind::Slips]);
    assert!(message(&inspection, FindingKind::Slips).starts_with("+z: "), "{:?}", inspection.findings);
    let text = text::format_inspection(&inspection, &pad(), None);
    assert!(text.contains("1 hole with 4 open edges, the longest 32 mm around"), "{text}");
}

#[test]
fn a_fan_of_long_slivers_is_not_captured_and_the_reason_given() {
    // 150 000 triangles from the middle of the view to its border.
    let count = 150_000;
    let rim = |i: u32| {
        let turn = TAU * f64::from(i) / f64::from(count);
        [8.0 * turn.cos(), 8.0 * turn.sin(), 0.0]
    };
    let vertices = (0..count).map(rim).chain([[0.0, 0.0, 5.0]]).collect();
    let triangles = (0..count).map(|i| [i, (i + 1) % count, count]).collect();
    let inspection = inspected(&(vertices, triangles), Unit::Mm);
    let facts = inspection.mesh.as_ref().expect("a mesh");
    assert!(facts.sides.is_empty() && facts.rows_per_capture > sides::MAX_ROWS, "{}", facts.rows_per_capture);
    assert_eq!(kinds(&inspection), [FindingKind::Slow]);
}

#[test]
fn an_edge_where_two_cubes_touch_is_a_fact() {
    let inspection =
        inspected(&together([block([-4.0; 3], [0.0; 3]), block([0.0, 0.0, -4.0], [4.0, 4.0, 0.0])]), Unit::Mm);
    assert_eq!(inspection.severity, None, "{:?}", inspection.findings);
    let text = text::format_inspection(&inspection, &pad(), None);
    assert!(text.contains("1 edge of more than two triangles"), "{text}");
}

#[test]
fn vertices_that_are_not_finite_are_a_warning() {
    let (mut vertices, mut triangles) = block([-4.0; 3], [4.0; 3]);
    vertices.push([f64::NAN, 0.0, 0.0]);
    triangles.push([0, 1, 8]);
    let inspection = inspected(&(vertices, triangles), Unit::Mm);
    assert_eq!((inspection.severity, kinds(&inspection)), (Some(Severity::Warning), vec![FindingKind::NotFinite]));
}

#[test]
fn a_needle_between_the_pixels_slips_and_one_on_a_pixel_is_thin() {
    // The middle of the view is a corner of four pixels, which are 31 um wide.
    let needle = |at: f64| block([at - 0.005, at - 0.005, 0.0], [at + 0.005, at + 0.005, 20.0]);
    let slips = inspected(&needle(0.0), Unit::Mm);
    assert!(side(&slips, Face::MinusZ).slips && side(&slips, Face::PlusZ).slips, "{:?}", slips.findings);
    assert_eq!(slips.severity, Some(Severity::Warning));
    assert!(message(&slips, FindingKind::Slips).contains("-z, +z"), "{:?}", slips.findings);

    // A plate beside it moves the bounds so that the needle is half a pixel from their middle.
    let plate = block([-5.0, -5.0, 8.0], [5.0, 5.0, 9.0]);
    let met = inspected(&together([needle(0.015_625), plate]), Unit::Mm);
    let below = side(&met, Face::MinusZ);
    assert_eq!((below.touching_px, below.slips, below.anchor), (1, false, Some(Anchor::Bounds)));
    assert_eq!(below.thin_fraction, 1.0);
    assert!(message(&met, FindingKind::Thin).contains("up to 100 %"), "{:?}", met.findings);
}

#[test]
fn a_fin_below_two_pixels_is_thin_and_one_of_three_is_not() {
    let fin = |width: f64| {
        let wall = block([-width / 2.0, -4.0, -1.0], [width / 2.0, 4.0, 1.0]);
        inspected(&together([wall, block([-6.0, -6.0, 1.0], [6.0, 6.0, 5.0])]), Unit::Mm)
    };
    let thin = fin(0.05);
    assert_eq!(thin.severity, Some(Severity::Warning), "{:?}", thin.findings);
    assert!(message(&thin, FindingKind::Thin).starts_with("-z: up to 100 %"), "{:?}", thin.findings);
    assert_eq!(side(&thin, Face::MinusZ).thin_fraction, 1.0);
    let wide = fin(0.1);
    assert!(side(&wide, Face::MinusZ).thin_fraction < 0.05, "{:?}", side(&wide, Face::MinusZ));
    assert!(!kinds(&wide).contains(&FindingKind::Thin));
    // The fin stands on one side of the plate only.
    assert!(side(&thin, Face::PlusZ).thin_fraction < 1e-3);
}

#[test]
fn a_foot_outside_the_view_asks_for_the_contact_anchor() {
    let table =
        together([block([-30.0, -30.0, 10.0], [30.0, 30.0, 12.0]), block([25.0, 25.0, 0.0], [30.0, 30.0, 10.0])]);
    let inspection = inspected(&table, Unit::Mm);
    let below = side(&inspection, Face::MinusZ);
    assert_eq!((below.anchor, below.slips, below.fits), (Some(Anchor::Contact), false, false));
    assert_eq!(below.touching_px, 160 * 160);
    assert!(
        message(&inspection, FindingKind::OffCentre).starts_with("-z: with its bounds"),
        "{:?}",
        inspection.findings
    );
}

#[test]
fn two_parts_and_a_speck_are_told_apart() {
    let speck = block([7.0; 3], [7.02; 3]);
    let found = inspected(&together([block([-4.0; 3], [4.0; 3]), block([5.0; 3], [6.0; 3]), speck]), Unit::Mm);
    let surface = &found.mesh.as_ref().expect("a mesh").surface;
    assert_eq!((surface.parts, surface.closed_parts, surface.specks), (3, 3, 1));
    assert!(
        text::format_inspection(&found, &pad(), None).contains("1 part smaller than two pixels"),
        "{:?}",
        found.findings
    );
}

#[test]
fn a_mesh_far_from_its_origin_is_noted() {
    let far = inspected(&block([1e6, 0.0, 0.0], [1e6 + 8.0, 8.0, 8.0]), Unit::Mm);
    assert_eq!((far.severity, kinds(&far)), (Some(Severity::Note), vec![FindingKind::FarFromOrigin]));
    let near = inspected(&block([1e3, 0.0, 0.0], [1e3 + 8.0, 8.0, 8.0]), Unit::Mm);
    assert_eq!(near.severity, None, "{:?}", near.findings);
}

#[test]
fn a_mesh_that_was_divided_by_its_own_size_has_no_unit() {
    let unit_cubes = [
        block([-0.5, -0.3, -0.2], [0.5, 0.3, 0.2]),
        block([-1.0, -0.3, -0.2], [1.0, 0.3, 0.2]),
        // The box's diagonal is 1.
        block([0.0; 3], [0.8, 0.36, 0.48]),
    ];
    for shape in unit_cubes {
        // As a sensor of five times the view sees it, so that 2 mm are no size either.
        let mut pad = pad();
        pad.field_of_view_mm = [100.0, 75.0];
        let mut text = String::new();
        shape.0.iter().for_each(|[x, y, z]| text += &format!("v {x} {y} {z}\n"));
        shape.1.iter().for_each(|[a, b, c]| text += &format!("f {} {} {}\n", a + 1, b + 1, c + 1));
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("shape.obj");
        fs::write(&path, text).expect("a file");
        let inspection = inspect_mesh(&path, mesh::MeshReadOptions::default(), &pad);
        assert_eq!(kinds(&inspection), [FindingKind::Normalised], "{:?}", inspection.findings);
        assert!(inspection.findings[0].help.contains("length_mm = 75"), "{:?}", inspection.findings);
    }
}
