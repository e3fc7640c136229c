//! A depth frame pressed into the pad is the object it shows.

use std::sync::Arc;

use gelsim_core::base::grid::Grid;
use gelsim_core::depth::height_map::HeightMap;
use gelsim_core::depth::indenter::Shape;
use gelsim_core::depth::{self, CaptureWindow};
use gelsim_core::effects::{Effect, EffectPolicy};
use gelsim_core::fidelity::Fidelity;
use gelsim_core::pose::Pose;
use gelsim_files::sensor::PRESETS;
use gelsim_job::config::Overrides;
use gelsim_job::layers::OutputLayer;
use gelsim_job::layout::Split;
use gelsim_job::plan::Plan;
use gelsim_job::plan::frames::FrameSettings;
use gelsim_job::sample::{self, Sample};
use gelsim_job::scene::{DepthFrame, KnownPress, PressSource, Scene};

use crate::is_flat;
use crate::plan::plan;

/// What a camera behind the pad sees of the sample's object.
fn frame(plan: &Plan) -> DepthFrame {
    let scene = Scene::draw(plan, 0, 0);
    let PressSource::Object(number) = scene.pressed else { panic!("drawn from meshes") };
    let window = CaptureWindow { margin_px: 0, above_mm: 50.0 };
    let object = &plan.sampling.objects[number].geometry.clusters();
    let mut above_mm =
        depth::capture_mesh(object, &scene.pose.placement(), plan.simulator.view(), window, 50.0).penetration;
    for mm in &mut above_mm.data {
        *mm = if *mm == -50.0 { f32::INFINITY } else { 0.0 - *mm };
    }
    depth_frame("seen", "ball", HeightMap { above_mm, unseen_px: 3 })
}

fn depth_frame(id: &str, class: &str, map: HeightMap) -> DepthFrame {
    DepthFrame { id: id.to_owned(), class: class.to_owned(), shape: Shape::HeightMap(Arc::new(map)) }
}

fn pressed(plan: &Plan, frame: DepthFrame) -> Sample {
    let Shape::HeightMap(map) = &frame.shape else { panic!("heights") };
    let drawn = KnownPress {
        split: Split::Train,
        indentation_depth_mm: map.indentation_depth_mm(),
        pressed: PressSource::Frame(frame),
        pose: Pose::IDENTITY,
    };
    sample::press(plan, &Scene::from_known_press(plan, 0, 0, drawn))
}

fn resolved(frames: &FrameSettings<'_>) -> Plan {
    frames.resolve_plan().unwrap_or_else(|report| panic!("{report:?}"))
}

#[test]
fn at_every_level_and_preset_a_frame_gives_the_picture_of_the_object_it_shows() {
    for (preset, _) in PRESETS.into_iter().filter(|(name, _)| is_flat(name)) {
        for level in Fidelity::ALL {
            let job = format!(
                "fidelity = \"{}\"\n[dataset]\nname = \"a\"\nsamples = 1\n[[object]]\npath = \"objects/sphere.obj\"\n\
                 [indentation]\ndepth_mm = 0.6\n[sensor]\npreset = \"{preset}\"\nresolution_px = [80, 60]\n\
                 [output]\nlayers = [\"depth\", \"contact\"]\n",
                level.name(),
            );
            let drawn = plan(&job);
            // A frame has nothing between its pixels.
            let meshed = sample::render(&drawn.with_policy(EffectPolicy::Without(Effect::Supersampling)), 0);
            let overrides = Overrides { fidelity: Some(level), ..Overrides::default() };
            let frames = FrameSettings {
                sensor: preset,
                resolution_px: [80, 60],
                layers: &[OutputLayer::Depth],
                classes: &[String::from("ball"), String::from("axle")],
                sequence: false,
                moved: false,
                overrides: &overrides,
            };
            let framed = pressed(&resolved(&frames), frame(&drawn));
            assert!(framed.label.contact.in_contact, "{preset} {}", level.name());
            assert_eq!(framed.impression.image.rgb, meshed.impression.image.rgb, "{preset} {}", level.name());
            assert_eq!(framed.impression.contact.surface.data, meshed.impression.contact.surface.data);
            // All of the contact is in view, but a frame cannot know that.
            let mut contact = framed.label.contact.clone();
            assert_eq!((contact.total_force_n, contact.in_view_fraction), (None, None));
            contact.total_force_n = meshed.label.contact.total_force_n;
            contact.in_view_fraction = meshed.label.contact.in_view_fraction;
            contact.force_unknown.clone_from(&meshed.label.contact.force_unknown);
            assert_eq!(contact, meshed.label.contact);
            assert_eq!(framed.label.health.unseen_px, 3);
            assert_eq!(framed.label.header.object.id, "seen");
            assert_eq!(framed.label.header.object.class_index, 1);
        }
    }
}

#[test]
fn what_the_border_of_a_frame_cuts_goes_on_beyond_it() {
    let overrides = Overrides { fidelity: Some(Fidelity::Reference), ..Overrides::default() };
    let frames = FrameSettings {
        sensor: "gelsight-2014",
        resolution_px: [80, 60],
        layers: &[OutputLayer::Depth],
        classes: &[],
        moved: false,
        sequence: false,
        overrides: &overrides,
    };
    let plan = resolved(&frames);
    // A plate over everything: were there nothing beyond the border, the pad would bulge there.
    let above_mm = Grid { width: 80, height: 60, data: vec![-0.3_f32; 80 * 60] };
    let plate = depth_frame("", "", HeightMap { above_mm, unseen_px: 0 });
    let sample = pressed(&plan, plate);
    assert!(
        sample.impression.contact.surface.data.iter().all(|mm| (mm - 0.3).abs() < 2e-3),
        "{:?}",
        sample.impression.contact.range_mm()
    );
    assert_eq!(sample.label.contact.fraction, 1.0);
}
