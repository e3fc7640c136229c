//! Random jobs in which every effect may be there or not, weak or strong, the same in every sample or not.

use std::path::PathBuf;
use std::sync::LazyLock;

use image::{Luma, Rgb};
use proptest::prelude::*;
use proptest::sample::select;

/// A table or a line that may be left out.
fn maybe(text: impl Strategy<Value = String> + 'static) -> BoxedStrategy<String> {
    prop_oneof![1 => Just(String::new()), 2 => text].boxed()
}

/// A line, or none where the value is empty.
fn line(key: &str, values: &'static [&'static str]) -> BoxedStrategy<String> {
    let key = key.to_owned();
    let written = move |value: &str| if value.is_empty() { String::new() } else { format!("{key} = {value}\n") };
    select(values).prop_map(written).boxed()
}

/// A table of lines.
fn table(name: &str, lines: Vec<BoxedStrategy<String>>) -> BoxedStrategy<String> {
    let name = name.to_owned();
    lines.prop_map(move |lines| format!("[{name}]\n{}", lines.concat())).boxed()
}

/// Files that a job may name, made once.
static FILES: LazyLock<[PathBuf; 2]> = LazyLock::new(|| {
    let file = |name: &str| PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
    let (photograph, heights) = (file("effects_photograph.png"), file("effects_heights.png"));
    let color = |x: u32, y: u32| Rgb([90 + 2 * x as u8, 80 + 3 * y as u8, 120 + (x * y % 7) as u8]);
    image::RgbImage::from_fn(36, 27, color).save(&photograph).expect("a folder that can be written");
    let height =
        |x: u32, y: u32| Luma([(128.0 + 60.0 * (f64::from(x) / 5.0).sin() + 60.0 * (f64::from(y) / 4.0).cos()) as u8]);
    image::GrayImage::from_fn(32, 24, height).save(&heights).expect("a folder that can be written");
    [photograph, heights]
});

/// An image of heights.
fn heights() -> String {
    FILES[1].to_string_lossy().into_owned()
}

/// A photograph of an untouched pad.
pub fn photograph() -> String {
    FILES[0].to_string_lossy().into_owned()
}

fn sensor() -> impl Strategy<Value = String> {
    let (photograph, heights) = (photograph(), heights());
    let head = table(
        "sensor",
        vec![
            line("preset", &["'gelsight-2014'", "'gelsight-2017'", "'gelsight-mini'", "'digit'", "'gelsight-series2'"]),
            line("resolution_px", &["[24, 18]", "[32, 24]", "[48, 36]", "[30, 40]", "[40, 18]"]),
            line("field_of_view_mm", &["", "", "[60.0, 45.0]"]),
            line("stray_light", &["", "", "[0.1, 0.3, 0.0]", "[0.4, 0.4, 1.0]"]),
            line(
                "light_residual",
                &[
                    "",
                    "",
                    "{ steepest = 0.5, heights_mm = [-0.1, 0.8], red = [1, 0, 0, 2, 0, 0, 0, -2, 0, 0.3, 0, 1], \
                       green = [0, -0.5, 1, 0, 0, 0, 1, 0, 0, -0.1, 1, 0], blue = [0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0] }",
                ],
            ),
            prop_oneof![3 => Just(String::new()), 1 => Just(format!("background = '{photograph}'\n"))].boxed(),
        ],
    );
    let shape = prop_oneof![
        4 => Just(String::new()),
        1 => (38.0..200.0_f64).prop_map(|mm| format!("[sensor.rest_shape.dome]\nradius_mm = {mm:?}\n")),
        1 => Just(format!("[sensor.rest_shape.height_map]\npath = '{heights}'\nheight_mm = 0.3\n")),
    ];
    let grain = vec![line("height_um", &["0.0", "0.5", "4.0", "30.0"]), line("size_mm", &["0.1", "1.0"])];
    let grain = prop_oneof![1 => Just(String::new()), 1 => table("sensor.grain", grain)];
    let led = || {
        let keys = vec![
            line("azimuth_deg", &["0.0", "45.0", "120.0", "200.0", "270.0"]),
            line("elevation_deg", &["0.0", "3.0", "12.0", "30.0", "60.0", "90.0"]),
            line("angular_size_deg", &["[0.0, 0.0]", "[2.0, 5.0]", "[40.0, 10.0]", "[90.0, 50.0]"]),
            line("distance_mm", &["6.0", "20.0", "200.0"]),
            line("color", &["[1.0, 0.0, 0.0]", "[0.0, 1.0, 0.0]", "[0.0, 0.0, 1.0]", "[1.0, 0.9, 0.8]"]),
            line("intensity", &["0.05", "0.5", "1.0", "3.0"]),
        ];
        table("[sensor.led]", keys)
    };
    let leds = proptest::collection::vec(led(), 1..4).prop_map(|leds| leds.concat());
    let leds = prop_oneof![2 => Just(String::new()), 1 => leds];
    (head, shape, grain, leds).prop_map(|(head, shape, grain, leds)| head + &shape + &grain + &leds)
}

/// Pads that an object cannot slide along while it is pressed in; some so inexact that this is nothing.
const HELD: &[&str] = &[
    "{ friction = 'stick' }",
    "{ resolution = 'half', friction = 'stick' }",
    "{ resolution = 'quarter', tolerance_um = 3.0, friction = { coulomb = { coefficient = 0.3 } } }",
    "{ tolerance_um = 1000.0, friction = 'stick' }",
];

/// The scene of a pad whose object is held by a friction: the same holds it when it is moved.
fn held(scene: &str, gelpad: &str) -> String {
    let Some((_, friction)) = gelpad.split_once("friction = ") else { return scene.to_owned() };
    let friction = friction.trim_end().strip_suffix(" }").expect("the last key of its table");
    let line = |line: &str| {
        if line.starts_with("friction = ") { format!("friction = {friction}\n") } else { format!("{line}\n") }
    };
    scene.lines().map(line).collect()
}

fn gelpad() -> impl Strategy<Value = String> {
    prop_oneof![
        5 => line("fidelity", &["'paper'", "'draft'", "'standard'", "'high'", "'reference'"]),
        1 => Just(String::from("gelpad.none = {}\n")),
        1 => line("gelpad.mean_blur.kernel_px", &["1", "3", "7"]),
        1 => line("gelpad.gaussian", &["{ kernels_px = [7, 3], smoothing_px = 3 }", "{ kernels_px = [5] }"]),
        1 => line("gelpad.elastic.resolution", &["'full'", "'half'", "'quarter'"]),
        2 => line("gelpad.elastic", HELD),
    ]
}

fn optics() -> impl Strategy<Value = String> {
    (select(vec!["phong", "led"]), select(vec![0.0, 0.5, 1.0, 5.0, 30.0]), 0.0..=1.0_f64).prop_flat_map(
        |(model, shininess, ambient)| {
            let keys = vec![
                Just(format!("shininess = {shininess:?}\n")).boxed(),
                prop_oneof![Just(format!("ambient = {ambient:?}\n")), line("ambient", &["", "0.0"])].boxed(),
                line("diffuse", &["", "0.0", "0.05", "1.5"]),
                line("specular", &["", "0.0", "1.5"]),
                line("darkening", &["", "0.0", "1.0"]),
                line("equation", &["'relative'", "'literal'"]),
                line("shadows", &["'none'", "'soft'", "'soft'"]),
            ];
            maybe(table(&format!("optics.{model}"), keys))
        },
    )
}

fn object() -> impl Strategy<Value = String> {
    let mesh = select(vec![
        "sphere",
        "cube",
        "gear",
        "coin",
        "cone",
        "dots",
        "bolt",
        "flat_face",
        "torus",
        "thin_ridge",
        "key",
        "wave",
        "prism_corner",
        "letter",
        "washer",
        "knurl",
    ]);
    (mesh, line("unit", &["", "", "'cm'"]))
        .prop_map(|(mesh, unit)| format!("[[object]]\npath = 'objects/{mesh}.obj'\n{unit}"))
}

fn scene() -> impl Strategy<Value = String> {
    let pose = vec![
        line("face", &["", "'any'"]),
        line("yaw_deg", &["0.0", "[0.0, 360.0]"]),
        line("tilt_deg", &["0.0", "[0.0, 10.0]"]),
        line("x_mm", &["0.0", "0.0", "[-8.0, 8.0]", "[-3.0, 3.0]"]),
        line("y_mm", &["0.0", "[-6.0, 6.0]"]),
        line("anchor", &["'bounds'", "'contact'"]),
    ];
    let depths = &["0.0005", "0.01", "0.1", "[0.1, 0.5]", "[0.3, 1.2]", "[0.3, 1.2]", "1.9", "{ choice = [0.0, 0.4] }"];
    let press = vec![line("depth_mm", depths), line("no_contact", &["", "", "", "0.3", "1.0"])];
    let shear = vec![
        line("x_mm", &["", "0.0", "0.2", "{ choice = [0.0, -0.3] }"]),
        line("y_mm", &["", "0.1"]),
        line("twist_deg", &["", "0.0", "4.0"]),
        line("friction", &["'stick'", "{ coulomb = { coefficient = 0.0 } }", "{ coulomb = { coefficient = 0.4 } }"]),
    ];
    (table("pose", pose), table("indentation", press), maybe(table("shear", shear)))
        .prop_map(|(pose, press, shear)| pose + &press + &shear)
}

fn texture() -> impl Strategy<Value = String> {
    let image = format!("patterns = [{{ image = {{ path = '{}' }} }}]\n", heights());
    let all = "['noise', 'brushed', 'knurled', 'woven', 'dimples']";
    let keys = vec![
        prop_oneof![4 => line("patterns", &["['noise']", "['brushed']", "['knurled']", "['woven']", "['dimples']"]),
            1 => Just(image), 1 => Just(format!("patterns = {all}\n"))]
        .boxed(),
        line("amplitude_mm", &["0.0", "0.01", "{ choice = [0.0, 0.1] }", "3.0"]),
        line("scale_mm", &["", "0.05", "[0.4, 3.0]"]),
    ];
    prop_oneof![1 => Just(String::new()), 1 => table("texture", keys)]
}

fn markers() -> impl Strategy<Value = String> {
    let keys = vec![
        line("pitch_mm", &["", "0.9", "[1.0, 2.0]"]),
        line("diameter_mm", &["", "0.0", "0.7", "{ choice = [0.0, 0.5] }"]),
        line("jitter_mm", &["", "0.0", "[0.0, 0.2]"]),
        line("edge_mm", &["", "0.0"]),
    ];
    prop_oneof![1 => Just(String::new()), 1 => table("markers", keys)]
}

fn camera() -> impl Strategy<Value = String> {
    let keys = vec![
        line("distortion_k1", &["", "", "0.1", "-0.1", "[-0.1, 0.1]"]),
        line("distortion_k2", &["", "", "", "0.05"]),
        line("vignette", &["", "", "0.3", "{ choice = [0.0, 0.5] }"]),
        line("defocus_mm", &["", "", "0.1", "{ choice = [0.0, 0.4] }", "1.0"]),
        line("exposure", &["", "", "0.5", "{ choice = [1.0, 2.0] }"]),
        line("red_gain", &["", "", "1.3"]),
        line("blue_gain", &["", "", "[0.8, 1.2]"]),
        line("noise_correlation", &["", "", "0.6"]),
        line("speckle_levels", &["0.0", "0.0", "0.0", "2.0"]),
        line("shot_noise_levels", &["", "", "", "3.0"]),
        line("read_noise_levels", &["0.0", "0.0", "0.0", "{ choice = [0.0, 2.0] }"]),
    ];
    maybe(table("camera", keys))
}

/// A job of two samples.
pub fn job() -> impl Strategy<Value = String> {
    let tables = (optics(), sensor(), object(), scene(), texture(), markers(), camera());
    (gelpad(), 0..1_u64 << 40, tables).prop_map(
        |(gelpad, seed, (optics, sensor, object, scene, texture, markers, camera))| {
            // Lamps have no parameters; LEDs are there for Phong's equation only where the job adds them.
            let lamps = sensor.contains("gelsight-series2") && !sensor.contains("[sensor.led]");
            let optics = if lamps { String::new() } else { optics };
            let dataset = format!("[dataset]\nname = 'random'\nsamples = 2\nseed = {seed}\n");
            let scene = held(&scene, &gelpad);
            [gelpad, dataset, optics, sensor, object, scene, texture, markers, camera].concat()
        },
    )
}
