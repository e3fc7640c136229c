//! One picture of each effect, strong enough to be seen in a small image.

use super::{Case, Show};

/// A cube that fills most of a close view.
macro_rules! textured {
    ($pattern:literal) => {
        concat!(
            "sensor.resolution_px = [96, 72]\nsensor.field_of_view_mm = [6.0, 4.5]\nindentation.depth_mm = 0.5\n",
            "texture = { amplitude_mm = 0.1, scale_mm = 0.9, angle_deg = 20.0, patterns = [",
            $pattern,
            "] }"
        )
    };
}

/// The 2014 sensor in few pixels.
macro_rules! small {
    ($($line:literal),+) => {
        concat!("sensor.resolution_px = [96, 72]\n", $($line, "\n"),+)
    };
}

/// A pad with a print that is seen in few pixels.
macro_rules! marked {
    ($($line:literal),+) => {
        small!("markers = { pitch_mm = 1.5, diameter_mm = 0.6 }", $($line),+)
    };
}

const fn image(name: &'static str, object: &'static str, job: &'static str) -> Case {
    Case { name, object, show: Show::Image, job }
}

pub const CASES: [Case; 23] = [
    image("texture_noise", "cube", textured!("\"noise\"")),
    image("texture_brushed", "cube", textured!("\"brushed\"")),
    image("texture_knurled", "cube", textured!("\"knurled\"")),
    image("texture_woven", "cube", textured!("\"woven\"")),
    image("texture_dimples", "cube", textured!("\"dimples\"")),
    image("texture_of_a_height_map", "cube", textured!("{ image = { path = \"tests/golden/height_map.png\" } }")),
    image(
        "dome_under_a_flat_face",
        "flat_face",
        small!("sensor.rest_shape.dome.radius_mm = 60.0", "indentation.depth_mm = 0.5"),
    ),
    image(
        "pad_with_a_height_map_under_a_sphere",
        "sphere",
        small!(
            "sensor.rest_shape.height_map = { path = \"tests/golden/height_map.png\", height_mm = 0.4 }",
            "indentation.depth_mm = 1.2"
        ),
    ),
    image(
        "grain_under_a_sphere",
        "sphere",
        small!("sensor.grain = { height_um = 8.0, size_mm = 0.5 }", "indentation.depth_mm = 1.2"),
    ),
    image(
        "shadows_of_an_led_at_8_degrees",
        "cube",
        small!(
            "sensor.led = [{ azimuth_deg = 180.0, elevation_deg = 8.5, intensity = 1.0 }]",
            "indentation.depth_mm = 0.8",
            "pose.yaw_deg = 20.0"
        ),
    ),
    image(
        "shadows_of_an_led_at_20_degrees",
        "cube",
        small!(
            "sensor.led = [{ azimuth_deg = 180.0, elevation_deg = 20.0, intensity = 1.0 }]",
            "indentation.depth_mm = 1.4",
            "pose.yaw_deg = 20.0"
        ),
    ),
    image(
        "no_shadows",
        "cube",
        small!("optics.phong.shadows = \"none\"", "indentation.depth_mm = 0.8", "pose.yaw_deg = 20.0"),
    ),
    image("near_leds_on_dots", "dots", small!("optics.led.shadows = \"none\"", "indentation.depth_mm = 0.8")),
    image("markers_at_rest", "sphere", marked!("indentation = { depth_mm = 1.5, no_contact = 1.0 }")),
    image("markers_around_a_sphere", "sphere", marked!("indentation.depth_mm = 1.5")),
    image(
        "shear_that_sticks",
        "cylinder",
        marked!("indentation.depth_mm = 0.8", "shear = { x_mm = 0.7, y_mm = -0.4, friction = \"stick\" }"),
    ),
    image(
        "twist_that_slips",
        "cylinder",
        marked!(
            "indentation.depth_mm = 0.8",
            "shear = { twist_deg = 20.0, friction = { coulomb = { coefficient = 0.5 } } }"
        ),
    ),
    image("defocus", "letter", small!("camera.defocus_mm = 0.4", "indentation.depth_mm = 0.8")),
    image("distortion_barrel", "cube", marked!("camera.distortion_k1 = 0.15", "indentation.depth_mm = 0.8")),
    image("distortion_pincushion", "cube", marked!("camera.distortion_k1 = -0.15", "indentation.depth_mm = 0.8")),
    image("vignette", "wave", small!("camera.vignette = 0.6", "indentation.depth_mm = 0.8")),
    image(
        "exposure_and_white_balance",
        "torus",
        small!("camera = { exposure = 1.3, red_gain = 1.2, blue_gain = 0.7 }", "indentation.depth_mm = 0.8"),
    ),
    image(
        "noise",
        "torus",
        small!("camera = { shot_noise_levels = 14.0, read_noise_levels = 3.0 }", "indentation.depth_mm = 0.8"),
    ),
];
