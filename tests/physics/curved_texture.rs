//! Texture on gels that are not flat: on the object's own surface, as on flat pads.

use std::path::Path;
use std::sync::Arc;

use gelsim::{Anchor, Angles, PadPlane, Pose, Relief, Side, Texture, TextureSample};
use gelsim_core::base::chart::Chart;
use gelsim_core::base::gel::{GelCapsule, GelDome, GelShape};
use gelsim_core::base::grid::{Grid, Rect};
use gelsim_core::base::view::View;
use gelsim_core::depth::chart_grid::ChartGrid;
use gelsim_core::depth::normal_capture::NormalCapture;
use gelsim_core::depth::patterns::Procedural;
use gelsim_core::depth::texture::PosedObject;
use gelsim_core::depth::{CaptureWindow, Depth};
use gelsim_job::sample::render;
use glam::DVec3;

use crate::plan::plan;
use gelsim_oracle::shapes::Shape;

/// What a texture cuts off in a place of a flat pad, over an object's origin.
fn cut_mm(texture: &Texture, at: [f64; 2], yaw_deg: f64, pitch_mm: f64) -> f32 {
    let view = View { resolution_px: [1, 1], mm_per_px: [pitch_mm; 2] };
    let penetration = Grid { width: 1, height: 1, data: vec![1.0] };
    let mut depth =
        Depth { penetration, margin_px: 0, touching: Rect::whole(1, 1), deepest_mm: 1.0, over_thickness_px: 0 };
    texture.relief.cut(&texture.sample, at.map(|mm| -mm), yaw_deg, &view, 0.5, &mut depth);
    1.0 - depth.deepest_mm
}

#[test]
fn a_pattern_lies_on_the_object_as_on_a_flat_pad() {
    const PITCH_MM: f64 = 0.2;
    let view = View { resolution_px: [50, 40], mm_per_px: [PITCH_MM; 2] };
    let window = CaptureWindow { margin_px: 3, above_mm: 0.5 };
    let slab = Path::new(env!("CARGO_MANIFEST_DIR")).join("objects/slab.obj");
    let slab = Shape::bundled(&slab).clusters();
    let sample = TextureSample { amplitude_mm: 0.2, scale_mm: 1.5, angle_deg: 25.0, offset: [0.3, 0.8] };
    let texture = Texture { relief: Arc::new(Relief::procedural(Procedural::Knurled)), sample, placement: None };
    let shapes = [
        (GelShape::Dome(GelDome { radius_mm: 12.0 }), 5.0),
        (GelShape::Capsule(GelCapsule { radius_mm: 9.0, length_mm: 30.0 }), 14.0),
        (GelShape::Capsule(GelCapsule { radius_mm: 9.0, length_mm: 30.0 }), 22.0),
    ];
    for (shape, from_tip_mm) in shapes {
        let (axes, origin_mm) = shape.frame_at(from_tip_mm, 70.0);
        let plane = PadPlane { axes, origin_mm };
        let angles = Angles { yaw_deg: 33.0, tilt_deg: 8.0, tilt_azimuth_deg: 20.0 };
        let posed = Pose::new(Side::MinusZ, angles, [0.4, -0.7], Anchor::Origin, 0.0, &slab);
        // The middle of its face.
        let posed = Pose { translation_mm: DVec3::new(0.4, -0.7, -0.9), ..posed };
        let pose = posed.within(axes, origin_mm);
        let chart = Chart::around_site(&shape, shape.closest(origin_mm));
        let plain = NormalCapture::new(&shape, &view, 3).capture(&slab, &pose, &chart, window, 100.0);
        let mut cut = plain.clone();
        let place = |node: [usize; 2]| view.point_mm(node.map(|at| at as f64 + 0.5 - 3.0));
        let places = ChartGrid { chart: &chart, position_mm: &place, spacing_mm: view.mm_per_px };
        gelsim_core::depth::texture::cut_along_normals(
            &texture,
            &PosedObject { pose: &pose, plane: &plane },
            &places,
            window.above_mm,
            &mut cut,
        );
        let (mut compared, mut most) = (0, 0.0_f32);
        for y in 0..46 {
            for x in 0..56 {
                let (before, after) = (plain.penetration.at(x, y), cut.penetration.at(x, y));
                if before <= -0.5 {
                    assert_eq!(before, after, "where there is no object nothing changes");
                    continue;
                }
                // The object's own point there, in the slab's place over the pad.
                let rest = chart.surface_frame(view.point_mm([x as f64 + 0.5 - 3.0, y as f64 + 0.5 - 3.0]));
                let point = rest.point_mm - f64::from(before) * rest.normal;
                let at = axes.transpose() * (point - origin_mm) - posed.translation_mm;
                let expected = cut_mm(&texture, [at.x, at.y], 33.0, PITCH_MM);
                let found = if after > -0.5 { before - after } else { expected };
                assert!((found - expected).abs() < 1e-5, "{shape:?} {x} {y}: {found} {expected}");
                compared += 1;
                most = most.max(found);
            }
        }
        assert!(compared > 300 && most > 0.15, "{compared} {most}");
        assert_eq!(cut.deepest_mm, cut.penetration.inner(3).data.iter().fold(0.0, |most: f32, mm| most.max(*mm)));
    }
}

#[test]
fn what_no_relief_cuts_stays_as_it_is() {
    let shape = GelShape::Dome(GelDome { radius_mm: 12.0 });
    let view = View { resolution_px: [20, 20], mm_per_px: [0.4; 2] };
    let ball = Shape::ball_around_origin(4.0, 24, 12).clusters();
    let pose = Pose::from_quaternion([0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 3.5]);
    let (chart, plane) = (Chart::at_tip(&shape), PadPlane::default());
    let window = CaptureWindow { margin_px: 0, above_mm: 0.5 };
    let plain = NormalCapture::new(&shape, &view, 0).capture(&ball, &pose, &chart, window, 3.0);
    let place = |node: [usize; 2]| view.point_mm(node.map(|at| at as f64 + 0.5));
    let places = ChartGrid { chart: &chart, position_mm: &place, spacing_mm: view.mm_per_px };
    for value in [0.0, -1.0, f64::NAN, 1e-320, 1e30, f64::INFINITY] {
        for other in [0.0, 1e-320, f64::NAN, 1e30] {
            let sample = TextureSample { amplitude_mm: value, scale_mm: other, angle_deg: other, offset: [other, 0.5] };
            let texture = Texture { relief: Arc::new(Relief::procedural(Procedural::Noise)), sample, placement: None };
            let mut depth = plain.clone();
            gelsim_core::depth::texture::cut_along_normals(
                &texture,
                &PosedObject { pose: &pose, plane: &plane },
                &places,
                0.5,
                &mut depth,
            );
            assert!(depth.penetration.data.iter().all(|mm| (-0.5..=1.0).contains(mm)), "{value} {other}");
            if value.is_nan() || value <= 0.0 {
                assert_eq!(depth.penetration.data, plain.penetration.data);
            }
        }
    }
    assert!(plain.deepest_mm > 0.4, "{}", plain.deepest_mm);
}

#[test]
fn texture_on_a_dome_of_a_kilometre_is_that_of_a_flat_pad() {
    let job = |sensor: &str| {
        plan(&format!(
            "fidelity = \"draft\"\ndataset = {{ name = \"a\", samples = 1 }}\nobject = [{{ path = \"objects/cube.obj\" }}]\n\
             indentation.depth_mm = 0.4\npose = {{ yaw_deg = 20.0, x_mm = 1.0, tilt_deg = 2.0 }}\n\
             texture = {{ amplitude_mm = 0.1, scale_mm = 1.0, angle_deg = 10.0 }}\n\
             [sensor]\nresolution_px = [80, 60]\nfield_of_view_mm = [16.0, 12.0]\n{sensor}"
        ))
    };
    let flat = render(&job(""), 0);
    let pins =
        "shape.dome.radius_mm = 1e6\npins = { count = 1, spacing_mm = 1.0, length_mm = 1.0, diameter_mm = 0.5 }\n";
    let dome = render(&job(pins), 0);
    let depths = [&flat, &dome].map(|sample| sample.impression.depth_mm());
    let off = depths[0].iter().zip(&depths[1]).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    println!("texture on a dome of a kilometre: depth within {:.3} um of the flat pad's", 1e3 * off);
    assert!(off < 2e-4 && depths[0].iter().any(|mm| *mm > 0.3), "{off}");
}
