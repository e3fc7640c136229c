//! A mirrored or turned scene under mirrored or turned lights gives the mirrored or turned sample.
//!
//! Arithmetic is not symmetric to the bit: sums run from left to right, and the object is rasterised in f32. So images
//! are compared within a level. The coarser grids on which levels find shadows are symmetric for some sizes of the view
//! only; for others they start nearer to one border than to the other.

use std::path::{Path, PathBuf};

use gelsim_core::fidelity::Fidelity;
use gelsim_core::impression::Impression;
use gelsim_job::plan::Plan;

use super::press::press_unlabelled;
use crate::plan::plan;

/// A lopsided scene: a position, angles, and where the LEDs are.
#[derive(Clone, Copy)]
struct Scene {
    mirrored_object: bool,
    size_px: [u32; 2],
    view_mm: [f64; 2],
    at_mm: [f64; 2],
    yaw_deg: f64,
    tilt_azimuth_deg: f64,
    led_azimuth_deg: [f64; 3],
    shift_mm: [f64; 2],
    twist_deg: f64,
}

const STRAIGHT: Scene = Scene {
    mirrored_object: false,
    size_px: [64, 48],
    view_mm: [16.0, 12.0],
    at_mm: [0.83, -0.47],
    yaw_deg: 31.7,
    tilt_azimuth_deg: 52.3,
    led_azimuth_deg: [9.0, 133.0, 251.0],
    shift_mm: [0.11, -0.06],
    twist_deg: 2.0,
};

/// The same seen otherwise, and where a pixel of it is found in the first one, given that one's size.
type Way = (&'static str, fn(Scene) -> Scene, fn([usize; 2], [usize; 2]) -> [usize; 2]);

const WAYS: [Way; 3] = [
    (
        "mirrored left to right",
        |s| Scene {
            mirrored_object: true,
            at_mm: [-s.at_mm[0], s.at_mm[1]],
            yaw_deg: -s.yaw_deg,
            tilt_azimuth_deg: -s.tilt_azimuth_deg,
            led_azimuth_deg: s.led_azimuth_deg.map(|azimuth| 180.0 - azimuth),
            shift_mm: [-s.shift_mm[0], s.shift_mm[1]],
            twist_deg: -s.twist_deg,
            ..s
        },
        |[x, y], [width, _]| [width - 1 - x, y],
    ),
    (
        "transposed",
        |s| Scene {
            mirrored_object: true,
            size_px: [s.size_px[1], s.size_px[0]],
            view_mm: [s.view_mm[1], s.view_mm[0]],
            at_mm: [s.at_mm[1], s.at_mm[0]],
            // The object is mirrored in x; a quarter turn back makes a transposition of that.
            yaw_deg: -90.0 - s.yaw_deg,
            tilt_azimuth_deg: 270.0 - s.tilt_azimuth_deg,
            led_azimuth_deg: s.led_azimuth_deg.map(|azimuth| 90.0 - azimuth),
            shift_mm: [s.shift_mm[1], s.shift_mm[0]],
            twist_deg: -s.twist_deg,
        },
        |[x, y], _| [y, x],
    ),
    (
        "turned by a quarter",
        |s| Scene {
            size_px: [s.size_px[1], s.size_px[0]],
            view_mm: [s.view_mm[1], s.view_mm[0]],
            at_mm: [-s.at_mm[1], s.at_mm[0]],
            yaw_deg: s.yaw_deg + 90.0,
            tilt_azimuth_deg: s.tilt_azimuth_deg + 90.0,
            led_azimuth_deg: s.led_azimuth_deg.map(|azimuth| azimuth + 90.0),
            shift_mm: [-s.shift_mm[1], s.shift_mm[0]],
            ..s
        },
        |[x, y], [_, height]| [y, height - 1 - x],
    ),
];

/// A bundled object, and the same mirrored in x.
fn objects(name: &str) -> [PathBuf; 2] {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("objects/{name}.obj"));
    let text = std::fs::read_to_string(&path).expect("a bundled object");
    let mirrored = |line: &str| match line.strip_prefix("v ") {
        Some(place) if place.starts_with('-') => format!("v {}\n", &place[1..]),
        Some(place) => format!("v -{place}\n"),
        None => format!("{line}\n"),
    };
    let other = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("stability_mirrored_{name}.obj"));
    std::fs::write(&other, text.lines().map(mirrored).collect::<String>()).expect("a folder that can be written");
    [path, other]
}

impl Scene {
    fn plan(&self, object: &[PathBuf; 2], level: Fidelity, extras: &str) -> Plan {
        let Self { size_px, view_mm, at_mm: [x, y], yaw_deg, tilt_azimuth_deg, shift_mm: [u, v], twist_deg, .. } = self;
        let colors = ["[1.0, 0.2, 0.2]", "[0.2, 1.0, 0.3]", "[0.2, 0.3, 1.0]"];
        let led = |(azimuth, color): (&f64, &str)| {
            format!("[[sensor.led]]\nazimuth_deg = {azimuth:?}\nelevation_deg = 14.0\ncolor = {color}\n")
        };
        let shear = match extras.contains("markers") {
            true => format!("shear = {{ x_mm = {u:?}, y_mm = {v:?}, twist_deg = {twist_deg:?} }}\n"),
            false => String::new(),
        };
        plan(&format!(
            "fidelity = '{}'\ndataset = {{ name = 'mirror', samples = 1 }}\nobject = [{{ path = {:?} }}]\n\
             pose = {{ x_mm = {x:?}, y_mm = {y:?}, yaw_deg = {yaw_deg:?}, tilt_deg = 3.0, \
             tilt_azimuth_deg = {tilt_azimuth_deg:?}, anchor = 'origin' }}\nindentation.depth_mm = 0.8\n\
             sensor.resolution_px = {size_px:?}\nsensor.field_of_view_mm = {view_mm:?}\n\
             sensor.rendered_background = {{ glow = 0.0, vignette = 0.0, grain = 0.0 }}\n{shear}{extras}\n{}",
            level.name(),
            object[usize::from(self.mirrored_object)].display().to_string(),
            self.led_azimuth_deg.iter().zip(colors).map(led).collect::<String>(),
        ))
    }
}

/// Largest difference of the surfaces, um, and of the images, levels.
fn differences(a: &Impression, b: &Impression, place: impl Fn([usize; 2], [usize; 2]) -> [usize; 2]) -> (f64, u8) {
    let (other, first) = (b.contact.surface.inner(1), a.contact.surface.inner(1));
    let (mut um, mut most) = (0.0_f64, 0_u8);
    for y in 0..other.height {
        for x in 0..other.width {
            let [u, v] = place([x, y], [first.width, first.height]);
            um = um.max(1e3 * f64::from(other.at(x, y) - first.at(u, v)).abs());
            for channel in 0..3 {
                let found = b.image.rgb[3 * (y * other.width + x) + channel];
                most = most.max(found.abs_diff(a.image.rgb[3 * (v * first.width + u) + channel]));
            }
        }
    }
    (um, most)
}

/// True if the grid on which a level finds shadows lies the same in a view of `size_px` and in its mirror.
fn lies_evenly(size_px: [u32; 2], level: Fidelity) -> bool {
    let coarse = matches!(level, Fidelity::Draft | Fidelity::Standard);
    !coarse || size_px.iter().all(|size| size % 2 == 1)
}

#[test]
fn a_sample_mirrored_transposed_or_turned_is_the_sample_of_the_scene_that_is() {
    let objects = ["key", "letter"].map(objects);
    let everything = "markers = { jitter_mm = 0.0 }\ncamera = { distortion_k1 = 0.07, vignette = 0.3, defocus_mm = 0.1 }\n\
         sensor.rest_shape.dome.radius_mm = 100.0\n";
    let views = [([64, 48], [16.0, 12.0]), ([63, 49], [15.75, 12.25]), ([61, 45], [15.25, 13.5])];
    for level in Fidelity::ALL {
        let (mut compared, mut most) = (0, (0.0_f64, 0));
        // Rubber takes a hundred times as long.
        let few = level == Fidelity::FiniteStrain && !crate::thorough();
        let cases = objects.iter().flat_map(|object| ["", everything].map(|extras| (object, extras)));
        let cases: Vec<_> = cases.take(if few { 1 } else { 2 * objects.len() }).collect();
        for (size_px, view_mm) in views.into_iter().take(if few { 2 } else { views.len() }) {
            let scene = Scene { size_px, view_mm, ..STRAIGHT };
            for &(object, extras) in &cases {
                let plan = scene.plan(object, level, extras);
                let even = lies_evenly(size_px, level);
                let straight = press_unlabelled(&plan);
                for (name, way, place) in WAYS {
                    // A transposition leaves the corner where grids start where it is.
                    if !even && name != "transposed" {
                        continue;
                    }
                    let other = press_unlabelled(&way(scene).plan(object, level, extras));
                    let (um, levels) = differences(&straight, &other, place);
                    // Rubber stops when a step changes it by a micrometre; beside walls several more are left then, which
                    // single pixels there show.
                    let (most_um, most_levels) = if level == Fidelity::FiniteStrain { (20.0, 24) } else { (0.15, 1) };
                    assert!(
                        um < most_um && levels <= most_levels,
                        "{name}, {level:?}, {size_px:?}, {extras}: {um} um, {levels} levels"
                    );
                    compared += 1;
                    most = (most.0.max(um), most.1.max(levels));
                }
            }
        }
        println!("{level:?}: {compared} pairs differ by up to {:.4} um and {} levels", most.0, most.1);
        assert!(compared >= 5 * cases.len(), "{level:?}: {compared} pairs");
    }
}
