//! The keys of a job and their values.

/// A key with its values for each [`Draw`](super::Draw); without any it is left out. `MODEL` is the model of the light.
type Key = (&'static str, [&'static [&'static str]; 3]);

/// Tables, and in how many of six jobs each is left out. The sensor's comes first.
pub const TABLES: &[(&str, u32)] = &[
    ("sensor", 0),
    ("dataset", 0),
    ("pose", 0),
    ("indentation", 0),
    ("texture", 3),
    ("shear", 2),
    ("markers", 3),
    ("optics.MODEL", 2),
    ("camera", 2),
    ("output", 0),
];

/// Pads and how often each is drawn. Some are such that an object cannot slide along while it is pressed in; some are
/// so inexact that this is nothing.
pub const GELPADS: &[(u32, &str)] = &[
    (10, "fidelity = '<paper|draft|standard|high|reference>'"),
    (2, "gelpad.none = {}"),
    (2, "gelpad.mean_blur = { kernel_px = <odd>, passes = <0..=5> }"),
    (1, "gelpad.gaussian = { kernels_px = [<|1|5|7|15>], smoothing_px = <odd> }"),
    (1, "gelpad.gaussian = { kernels_px = [<odd>, <odd>], smoothing_px = <odd> }"),
    (1, "gelpad.gaussian = { kernels_px = [<odd>, <odd>, <odd>], smoothing_px = <odd> }"),
    (
        2,
        "gelpad.elastic = { resolution = '<full|half|quarter>', tolerance_um = <0.05..1000>, \
         max_iterations = <1..=99> }",
    ),
    (2, "gelpad.elastic.resolution = '<full|half|quarter>'"),
    (2, "gelpad.elastic = { resolution = '<full|half>', friction = 'stick' }"),
    (
        1,
        "gelpad.elastic = { resolution = 'quarter', tolerance_um = 3.0, \
         friction = { coulomb = { coefficient = 0.3 } } }",
    ),
    (1, "gelpad.elastic = { tolerance_um = 1000.0, friction = 'stick' }"),
];

pub const LED: [&str; 3] = [
    "{ azimuth_deg = <0.0|45.0|120.0|200.0|270.0>, elevation_deg = <0.0|3.0|12.0|30.0|60.0|90.0>, \
     angular_size_deg = <[0.0, 0.0]|[2.0, 5.0]|[40.0, 10.0]|[90.0, 50.0]>, distance_mm = <6.0|20.0|200.0>, lobe = <0.0|1.0>, \
     color = <[1.0, 0.0, 0.0]|[0.0, 1.0, 0.0]|[0.0, 0.0, 1.0]|[1.0, 0.9, 0.8]>, intensity = <0.05|0.5|1.0|3.0>\
     <|||, pattern = { red = [0.5, 0.5, -0.75], blue = [0.5, 0.0, 0.0, -1.0, 0.5, 0.5] }> }",
    "{ azimuth_deg = <-360..360>, elevation_deg = <0..90>, color = [<0..1>, <0..1>, <0..1>], intensity = <~0..100> }",
    "{ azimuth_deg = <0.0|90.0|123.0|-3600.0>, elevation_deg = <0.0|1e-9|8.5|45.0|90.0>, \
     angular_size_deg = <[0.0, 0.0]|[40.0, 10.0]|[90.0, 90.0]>, distance_mm = <0.01|1.0|20.0|1e6>, \
     intensity = <0.0|1.0|100.0>\
     <||, pattern = { red = [0.0], green = [100.0, -100.0, 100.0], blue = [-100.0, 100.0, -100.0, 100.0, -100.0, 100.0] }> }",
];

pub const OBJECT: [&str; 2] = [
    "{ path = 'objects/<sphere|cube|gear|coin|cone|dots|bolt|flat_face|torus|thin_ridge|key|wave|prism_corner|letter|\
     washer|knurl>.obj'<||, unit = 'cm'> }",
    "{ path = 'objects/<cube|cone|cub?>.obj', unit = '<mm|cm|m|in>', weight = <1e-6..1e9> }",
];

const RESIDUAL: &str = "{ steepest = 0.5, heights_mm = [-0.1, 0.8], red = [1, 0, 0, 2, 0, 0, 0, -2, 0, 0.3, 0, 1, \
                        0, 0.5, 0, 0, -1, 0, 0, 0, 0, 0.1, 0, 0, -0.5, 0, 0, 0, 1, 0, 0, 0, 0, -0.1, 0, 0.5], \
                        green = [0, -0.5, 1, 0, 0, 0, 1, 0, 0, -0.1, 1, 0], blue = [0,0,0,0,0,0,0,0,0,0,0,0] }";
/// Coefficients at the ends of their range.
const RESIDUAL_ENDS: &[&str] = &[
    "{ steepest = 0.01, heights_mm = [0.0, 0.0], red = [100,100,100,100,100,100,100,100,100,100,100,100], \
     green = [0,0,0,0,0,0,0,0,0,0,0,0], blue = [0,0,0,0,0,0,0,0,0,-100,100,-100] }",
    "{ steepest = 1.0, heights_mm = [-100.0, 100.0], red = [100,-100,100,-100,100,-100,100,-100,100,-100,100,-100], \
     green = [1,0,0,0,0,0,0,0,0,0,0,0], blue = [0,0,0,0,0,0,0,0,0,100,100,100] }",
];
const PATTERN_ENDS: &[&str] = &["{ red = [0,0,0,0,0,0,0,0,0,0,0,0,0,0,0], green = [1,0,0,0,0,0,0,0,0,0,0,0,0,0,0], \
     blue = [100,-100,100,-100,100,-100,100,-100,100,-100,100,-100,100,-100,100] }"];
const DEPTHS: &[&str] =
    &["0.0005", "0.01", "0.1", "[0.1, 0.5]", "[0.3, 1.2]", "[0.3, 1.2]", "1.9", "{ choice = [0.0, 0.4] }"];
const SPLITS: &[&str] = &[
    "{ train = 1.0 }",
    "{ test = 1.0 }",
    "{ train = 0.5, val = 0.5 }",
    "{ train = 0.7, val = 0.2, test = 0.1 }",
    "{ val = 1, train = 0 }",
];
const ONE_PATTERN: &str = "['<noise|brushed|knurled|woven|dimples>']";
const PATTERNS: &[&str] = &[
    ONE_PATTERN,
    ONE_PATTERN,
    ONE_PATTERN,
    ONE_PATTERN,
    "[{ image = { path = 'HEIGHTS' } }]",
    "['noise', 'brushed', 'knurled', 'woven', 'dimples']",
];
const RESTS: &[&str] =
    &["", "", "", "", "{ dome = { radius_mm = <38..200> } }", "{ height_map = { path = 'HEIGHTS', height_mm = 0.3 } }"];
const PRESETS: &[&str] = &["'gelsight-2014'", "'gelsight-2017'", "'gelsight-mini'", "'digit'", "'gelsight-series2'"];
const SIZES: &[&str] = &["[24, 18]", "[32, 24]", "[48, 36]", "[30, 40]", "[40, 18]"];
const GRAIN: &[&str] = &["", "{ height_um = <0.0|0.5|4.0|30.0>, size_mm = <0.1|1.0> }"];
const GRAIN_ENDS: &[&str] = &["{ height_um = 100.0, size_mm = 1e-3 }", "{ height_um = 100.0, size_mm = 1e3 }"];
const FRICTION: &[&str] = &["'stick'", "{ coulomb = { coefficient = 0.0 } }", "{ coulomb = { coefficient = 0.4 } }"];
const FRICTION_ENDS: &[&str] =
    &["'stick'", "{ coulomb = { coefficient = 0.0 } }", "{ coulomb = { coefficient = 10.0 } }"];
const SHADOW_ENDS: &[&str] = &["'none'", "{ soft = { resolution = 'full' } }", "{ soft = { resolution = 'quarter' } }"];

/// The tests at the ends of ranges draw in this order: a new key shifts their jobs.
pub const KEYS: &[Key] = &[
    ("dataset.name", [&["'random'"], &["'random'"], &[]]),
    ("dataset.samples", [&["2"], &["<1..=3>"], &[]]),
    ("dataset.seed", [&["<0..=1099511627775>"], &["<0..=9007199254740991>"], &[]]),
    ("dataset.samples_per_shard", [&[], &["<1..=4>"], &[]]),
    ("dataset.splits", [&[], SPLITS, &[]]),
    ("dataset.object_order", [&[], &["'weighted'", "'in_turn'"], &[]]),
    ("sensor.preset", [PRESETS, PRESETS, &[]]),
    ("sensor.resolution_px", [SIZES, &["[24, 18]"], &[]]),
    ("sensor.field_of_view_mm", [&["", "", "[60.0, 45.0]"], &["[<0.5..100>, <0.5..100>]"], &[]]),
    ("sensor.gelpad_thickness_mm", [&[], &["2.0"], &[]]),
    ("sensor.gelpad_poisson_ratio", [&[], &["<~0..0.4999>"], &[]]),
    ("sensor.gelpad_friction_coefficient", [&[], &["<0..10>"], &["0.0", "10.0"]]),
    ("sensor.gelpad_youngs_modulus_kpa", [&[], &["<~1e-3..1e9>"], &["1e-3", "1e9"]]),
    ("sensor.darkening", [&[], &["", "<~0..1>"], &["0.0", "1.0"]]),
    (
        "sensor.stray_light",
        [
            &["", "", "[0.1, 0.3, 0.0]", "[0.4, 0.4, 1.0]"],
            &["", "[<0..1>, <0..1>, <0..1>]"],
            &["[0.0, 0.0, 0.0]", "[0.4, 0.0, 1.0]"],
        ],
    ),
    ("sensor.rendered_background.pattern", [&[], &[], PATTERN_ENDS]),
    (
        "sensor.rendered_background.color",
        [&[], &["", "[<0..1>, <0..1>, <0..1>]"], &["[0.0, 0.0, 0.0]", "[1.0, 1.0, 1.0]"]],
    ),
    ("sensor.rendered_background.glow", [&[], &["<0..10>"], &["0.0", "10.0"]]),
    ("sensor.rendered_background.glow_reach_mm", [&[], &["<1e-3..1e6>"], &["1e-3", "1e6"]]),
    ("sensor.rendered_background.vignette", [&[], &["<0..1>"], &["0.0", "1.0"]]),
    ("sensor.rendered_background.grain", [&[], &["<0..1>"], &["0.0", "1.0"]]),
    ("sensor.rendered_background.grain_size_mm", [&[], &["<1e-3..1e3>"], &["1e-3", "1e3"]]),
    ("sensor.rendered_background.dust_per_cm2", [&[], &["", "<0..1e3>"], &["0.0", "1e3"]]),
    ("sensor.rendered_background.dust_size_mm", [&[], &["", "<1e-3..10>"], &["1e-3", "10.0"]]),
    ("sensor.light_residual", [&["", "", RESIDUAL], &[], RESIDUAL_ENDS]),
    ("sensor.background", [&["", "", "", "'PHOTOGRAPH'"], &[], &[]]),
    ("sensor.rest_shape", [RESTS, &[], &[]]),
    ("sensor.window", [&["", "{ distance_mm = 300.0 }"], &["", "{ distance_mm = 900.0 }"], &[]]),
    ("sensor.coat", [&["", "{ albedo = 0.5 }"], &["", "{ albedo = <0..1> }"], &["{ albedo = 1.0 }"]]),
    ("sensor.grain", [GRAIN, &["", "{ height_um = <0..100>, size_mm = <1e-3..1e3> }"], GRAIN_ENDS]),
    ("pose.yaw_deg", [&["0.0", "[0.0, 360.0]"], &["<~-3600..3600>"], &["1e-9", "45.0", "-90.0", "3600.0"]]),
    ("pose.tilt_deg", [&["0.0", "[0.0, 10.0]"], &["<~-90..90>"], &["1e-9", "0.01", "89.9999", "90.0", "-90.0"]]),
    ("pose.tilt_azimuth_deg", [&[], &["<~-3600..3600>"], &["0.0", "90.0", "-3600.0"]]),
    ("pose.face", [&["", "'any'"], &["'<any|+x|-x|+y|-y|+z|-z>'"], &["'any'", "'+x'", "'-y'"]]),
    ("pose.anchor", [&["'bounds'", "'contact'"], &["'<bounds|origin|contact>'"], &["'bounds'", "'contact'"]]),
    ("pose.x_mm", [&["0.0", "0.0", "[-8.0, 8.0]", "[-3.0, 3.0]"], &["<~-20..20>"], &["1e-9", "1e4"]]),
    ("pose.y_mm", [&["0.0", "[-6.0, 6.0]"], &["<~-1e4..1e4>"], &[]]),
    ("indentation.depth_mm", [DEPTHS, &["<~0..1.9999>"], &[]]),
    ("indentation.no_contact", [&["", "", "", "0.3", "1.0"], &["<0..1>"], &[]]),
    ("texture.patterns", [PATTERNS, &[ONE_PATTERN], &["['brushed']", "['knurled']", "['woven']", "['dimples']"]]),
    (
        "texture.amplitude_mm",
        [&["0.0", "0.01", "{ choice = [0.0, 0.1] }", "3.0"], &["<~0..10>"], &["0.0", "1e-9", "10.0"]],
    ),
    ("texture.scale_mm", [&["", "0.05", "[0.4, 3.0]"], &["<~1e-3..1e3>"], &["1e-3", "1e3"]]),
    ("texture.angle_deg", [&[], &["<~-3600..3600>"], &[]]),
    ("shear.x_mm", [&["", "0.0", "0.2", "{ choice = [0.0, -0.3] }"], &["<~-10..10>"], &["0.0", "-10.0", "10.0"]]),
    ("shear.y_mm", [&["", "0.1"], &["<~-10..10>"], &[]]),
    ("shear.twist_deg", [&["", "0.0", "4.0"], &["<~-45..45>"], &["0.0", "-45.0", "45.0"]]),
    ("shear.friction", [FRICTION, &["'stick'", "{ coulomb = { coefficient = <0..10> } }"], FRICTION_ENDS]),
    ("markers.pitch_mm", [&["", "0.9", "[1.0, 2.0]"], &["<~1..10>"], &["0.05", "1.5", "1e3"]]),
    ("markers.diameter_mm", [&["", "0.0", "0.7", "{ choice = [0.0, 0.5] }"], &["<~0..5>"], &["0.0", "0.4", "100.0"]]),
    ("markers.jitter_mm", [&["", "0.0", "[0.0, 0.2]"], &["<~0..1>"], &["0.0", "100.0"]]),
    ("markers.edge_mm", [&["", "0.0"], &["<0..1>"], &["0.0", "10.0"]]),
    ("optics.MODEL.ambient", [&["<0..1>", "", "0.0"], &["<0..1>"], &["0.0", "1.0"]]),
    ("optics.MODEL.diffuse", [&["", "0.0", "0.05", "1.5"], &["<0..10>"], &["0.0", "10.0"]]),
    ("optics.MODEL.specular", [&["", "0.0", "1.5"], &["<0..10>"], &["0.0", "10.0"]]),
    (
        "optics.MODEL.shininess",
        [&["0.0", "0.5", "1.0", "5.0", "30.0"], &["<0..1000>"], &["0.0", "0.5", "1.0", "65.0", "1000.0"]],
    ),
    ("optics.MODEL.darkening", [&["", "0.0", "1.0"], &["<0..1>"], &["0.0", "1.0"]]),
    ("optics.MODEL.equation", [&["'relative'", "'literal'"], &["", "'literal'"], &["'literal'"]]),
    ("optics.MODEL.shadows", [&["'none'", "'soft'", "'soft'"], &["'none'", "'soft'"], SHADOW_ENDS]),
    ("camera.distortion_k1", [&["", "", "0.1", "-0.1", "[-0.1, 0.1]"], &["<~-0.25..1>"], &["-0.25", "0.0", "1.0"]]),
    ("camera.distortion_k2", [&["", "", "", "0.05"], &["<~0..1>"], &["0.0", "1.0"]]),
    ("camera.vignette", [&["", "", "0.3", "{ choice = [0.0, 0.5] }"], &["<~0..1>"], &["0.0", "1.0"]]),
    ("camera.defocus_mm", [&["", "", "0.1", "{ choice = [0.0, 0.4] }", "1.0"], &["<~0..0.4>"], &["0.0", "1.0"]]),
    ("camera.exposure", [&["", "", "0.5", "{ choice = [1.0, 2.0] }"], &["<~0.01..100>"], &["0.01", "100.0"]]),
    ("camera.red_gain", [&["", "", "1.3"], &["<~0.01..100>"], &["0.01", "100.0"]]),
    ("camera.blue_gain", [&["", "", "[0.8, 1.2]"], &["<~0.01..100>"], &[]]),
    ("camera.noise_correlation", [&["", "", "0.6"], &["<~0..0.6>"], &[]]),
    ("camera.speckle_levels", [&["0.0", "0.0", "0.0", "2.0"], &["<~0..255>"], &[]]),
    ("camera.shot_noise_levels", [&["", "", "", "3.0"], &["<~0..255>"], &["0.0", "255.0"]]),
    ("camera.read_noise_levels", [&["0.0", "0.0", "0.0", "{ choice = [0.0, 2.0] }"], &["<~0..255>"], &[]]),
    ("output.layers", [&["[]"], &["[]"], &[]]),
    ("output.exr", [&[""], &["{ pixel = '<half|float>', compression = '<none|rle|zip>' }"], &[]]),
];
