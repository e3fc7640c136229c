//! Jobs whose numbers a test moves one at a time, and what comes of them.

use gelsim_core::base::grid::{Grid, Rect};
use gelsim_core::base::light::Light;
use gelsim_core::effects::{EffectLog, EffectPolicy};
use gelsim_core::fidelity::Fidelity;
use gelsim_core::gelpad::Contact;
use gelsim_core::impression::Impression;
use gelsim_core::optics::normals::surface_normals;
use gelsim_core::simulator::Stages;
use gelsim_job::plan::Plan;
use gelsim_job::sample::Sample;
use gelsim_job::scene::Scene;

use crate::plan::plan;
use gelsim_oracle::pipeline_f64::{apart, light_of, misrounded, normals_of, turned_deg};

/// The numbers of a press, each of which can be moved alone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Numbers {
    pub depth_mm: f64,
    pub x_mm: f64,
    pub y_mm: f64,
    pub yaw_deg: f64,
    pub tilt_deg: f64,
    pub tilt_azimuth_deg: f64,
    pub youngs_modulus_kpa: f64,
    pub poisson_ratio: f64,
    pub thickness_mm: f64,
    pub led_azimuth_deg: f64,
    pub led_elevation_deg: f64,
    pub texture_amplitude_mm: f64,
    pub texture_scale_mm: f64,
    pub texture_angle_deg: f64,
    pub marker_pitch_mm: f64,
    pub shift_mm: f64,
    pub twist_deg: f64,
}

/// A press in which nothing lies on a pixel centre or at any other special place.
pub const GENERIC: Numbers = Numbers {
    depth_mm: 0.713,
    x_mm: 0.2371,
    y_mm: -0.3119,
    yaw_deg: 16.83,
    tilt_deg: 1.27,
    tilt_azimuth_deg: 41.3,
    youngs_modulus_kpa: 145.0,
    poisson_ratio: 0.4793,
    thickness_mm: 2.931,
    led_azimuth_deg: 7.3,
    led_elevation_deg: 9.17,
    texture_amplitude_mm: 0.0417,
    texture_scale_mm: 1.913,
    texture_angle_deg: 33.7,
    marker_pitch_mm: 1.517,
    shift_mm: 0.1373,
    twist_deg: 2.31,
};

/// What a job has beside the press.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Extras {
    /// Nothing: defaults.
    None,
    /// Every effect there is, but for jitter and noise, which the sample's number decides.
    All,
}

impl Extras {
    fn lines(self, numbers: &Numbers) -> String {
        let Numbers { texture_amplitude_mm, texture_scale_mm, texture_angle_deg, .. } = numbers;
        let Numbers { marker_pitch_mm, shift_mm, twist_deg, .. } = numbers;
        match self {
            Self::None => String::new(),
            Self::All => format!(
                "texture = {{ patterns = ['woven'], amplitude_mm = {texture_amplitude_mm:?}, \
                 scale_mm = {texture_scale_mm:?}, angle_deg = {texture_angle_deg:?} }}\n\
                 markers.pitch_mm = {marker_pitch_mm:?}\n\
                 shear = {{ x_mm = {shift_mm:?}, y_mm = 0.05, twist_deg = {twist_deg:?}, \
                 friction = {{ coulomb = {{ coefficient = 0.4 }} }} }}\n\
                 camera = {{ distortion_k1 = 0.07, distortion_k2 = 0.01, vignette = 0.3, defocus_mm = 0.06, exposure = 1.1 }}\n\
                 sensor.rest_shape.dome.radius_mm = 150.0\nsensor.grain = {{ height_um = 1.0, size_mm = 0.4 }}\n"
            ),
        }
    }
}

/// A sensor, an object on it and how it is simulated.
#[derive(Clone, Copy, Debug)]
pub struct Setting<'a> {
    pub object: &'a str,
    pub level: Fidelity,
    pub extras: Extras,
    pub resolution_px: [u32; 2],
    /// The point of the object that the pose places.
    pub anchor: &'a str,
    /// More lines of the job.
    pub more: &'a str,
}

impl Default for Setting<'_> {
    fn default() -> Self {
        Self {
            object: "sphere",
            level: Fidelity::Standard,
            extras: Extras::None,
            resolution_px: [80, 60],
            anchor: "bounds",
            more: "",
        }
    }
}

impl Setting<'_> {
    pub fn plan(&self, numbers: &Numbers) -> Plan {
        self.plan_with(numbers, "")
    }

    /// With LEDs that have these lines, too.
    pub fn plan_with(&self, numbers: &Numbers, of_leds: &str) -> Plan {
        let Self { object, level, extras, resolution_px, anchor, more } = self;
        let Numbers { depth_mm, x_mm, y_mm, yaw_deg, tilt_deg, tilt_azimuth_deg, .. } = numbers;
        let Numbers { youngs_modulus_kpa, poisson_ratio, thickness_mm, led_azimuth_deg, led_elevation_deg, .. } =
            numbers;
        let colors = [[1.0, 0.2, 0.2], [0.2, 1.0, 0.3], [0.2, 0.3, 1.0]];
        let leds = (0..3).map(|k| {
            let azimuth = led_azimuth_deg + 120.0 * k as f64;
            let color = colors[k];
            format!("[[sensor.led]]\nazimuth_deg = {azimuth:?}\nelevation_deg = {led_elevation_deg:?}\ncolor = {color:?}\n{of_leds}")
        });
        plan(&format!(
            "fidelity = '{}'\ndataset = {{ name = 'steady', samples = 1 }}\nobject = [{{ path = 'objects/{object}.obj' }}]\n\
             pose = {{ x_mm = {x_mm:?}, y_mm = {y_mm:?}, yaw_deg = {yaw_deg:?}, tilt_deg = {tilt_deg:?}, \
             tilt_azimuth_deg = {tilt_azimuth_deg:?}, anchor = '{anchor}' }}\nindentation.depth_mm = {depth_mm:?}\n\
             sensor.resolution_px = {resolution_px:?}\nsensor.gelpad_youngs_modulus_kpa = {youngs_modulus_kpa:?}\n\
             sensor.gelpad_poisson_ratio = {poisson_ratio:?}\nsensor.gelpad_thickness_mm = {thickness_mm:?}\n{}{more}\n{}",
            level.name(),
            extras.lines(numbers),
            leds.collect::<String>(),
        ))
    }

    /// What the press gives.
    pub fn press(&self, numbers: &Numbers) -> Shown {
        let plan = self.plan(numbers);
        Shown::of(&plan, press_unlabelled(&plan))
    }
}

/// Renders the first sample of a plan without its label.
pub fn press_unlabelled(plan: &Plan) -> Impression {
    let scene = Scene::draw(plan, 0, 0);
    scene.simulator(plan).press_with(&scene.to_press(plan))
}

/// What is compared of a sample.
pub struct Shown {
    /// The object below the pad, mm.
    pub depth: Grid<f32>,
    /// The pad, mm.
    pub surface: Grid<f32>,
    /// Light before the camera, grey levels.
    pub light: Vec<f32>,
    /// The image.
    pub rgb: Vec<u8>,
}

impl Shown {
    pub fn of(plan: &Plan, impression: Impression) -> Self {
        let light = plan.simulator.shader().shade(
            &impression.contact,
            plan.simulator.background(),
            &mut EffectLog::new(EffectPolicy::WhereNeeded),
        );
        let light = light.into_light();
        Self {
            depth: impression.depth.below_pad(),
            surface: impression.contact.surface,
            light: levels(plan, &light),
            rgb: impression.image.rgb,
        }
    }

    /// What differs in another one.
    pub fn change(&self, other: &Self) -> Change {
        let largest = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from((a - b).abs())).fold(0.0, f64::max);
        let levels = || self.rgb.iter().zip(&other.rgb).map(|(a, b)| a.abs_diff(*b));
        Change {
            flipped_px: self.depth.data.iter().zip(&other.depth.data).filter(|(a, b)| (*a - *b).abs() > 1e-3).count(),
            surface_um: 1e3 * largest(&self.surface.data, &other.surface.data),
            light_levels: largest(&self.light, &other.light),
            light_share: share(self.light.iter().zip(&other.light).map(|(a, b)| (a - b).abs() > 0.1)),
            image_levels: levels().max().unwrap_or(0),
            image_share: share(levels().map(|levels| levels > 0)),
        }
    }
}

/// Which share of all is so.
fn share(all: impl Iterator<Item = bool>) -> f64 {
    let (mut so, mut count) = (0, 0);
    for one in all {
        so += usize::from(one);
        count += 1;
    }
    f64::from(so as u32) / f64::from(count)
}

/// Red, green, blue of the whole view, grey levels, before any camera.
pub fn levels(plan: &Plan, light: &Light) -> Vec<f32> {
    let mut whole: Vec<f32> = plan.simulator.background().rgb.iter().map(|level| f32::from(*level)).collect();
    let Rect { x0, y0, x1, y1 } = light.region;
    for (channel, plane) in light.planes.iter().enumerate() {
        for (row, values) in (y0..y1).zip(plane.chunks_exact((x1 - x0).max(1))) {
            for (column, value) in (x0..x1).zip(values) {
                whole[3 * (row * plan.simulator.background().width + column) + channel] = 255.0 * value;
            }
        }
    }
    whole
}

/// By how much two samples differ.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Change {
    /// Pixels in view at which another part of the object is seen: the depth differs by more than 1 um.
    pub flipped_px: usize,
    /// Of the surface, at most, um.
    pub surface_um: f64,
    /// Of the light before the camera, at most, grey levels.
    pub light_levels: f64,
    /// Share of the light's values that differ by more than a tenth of a level.
    pub light_share: f64,
    /// Of the image, at most, grey levels.
    pub image_levels: u8,
    /// Share of the image's values that differ.
    pub image_share: f64,
}

impl Change {
    /// The larger of both, number by number.
    pub fn or(self, other: Self) -> Self {
        Self {
            flipped_px: self.flipped_px.max(other.flipped_px),
            surface_um: self.surface_um.max(other.surface_um),
            light_levels: self.light_levels.max(other.light_levels),
            light_share: self.light_share.max(other.light_share),
            image_levels: self.image_levels.max(other.image_levels),
            image_share: self.image_share.max(other.image_share),
        }
    }
}

/// The pad of a sample without what was sampled between its pixels' centres.
fn contact_at_centres(sample: &Sample) -> Contact {
    let mut contact = sample.impression.contact.clone();
    contact.subpixel = None;
    contact
}

/// The sample's light, grey levels, everywhere.
pub fn light_everywhere(plan: &Plan, sample: &Sample) -> Vec<f32> {
    let (contact, mut everywhere) = (contact_at_centres(sample), EffectLog::new(EffectPolicy::All));
    levels(plan, &plan.simulator.shader().shade(&contact, plan.simulator.background(), &mut everywhere).into_light())
}

/// The image of that.
pub fn image_everywhere(plan: &Plan, sample: &Sample) -> Vec<u8> {
    let (contact, mut effects) = (contact_at_centres(sample), EffectLog::new(EffectPolicy::All));
    let light = plan.simulator.shader().shade(&contact, plan.simulator.background(), &mut effects);
    let camera = sample.impression.camera;
    plan.simulator.camera().expose(light, Some(&contact.mask), None, &camera, &mut effects).rgb
}

/// How far a sample is from what follows from a surface in f64: normals, degrees; light, grey levels; image, levels
/// beyond half of one.
pub fn errors_of_light(plan: &Plan, sample: &Sample, surface: &Grid<f64>) -> [f64; 3] {
    let (view, expected) = (plan.simulator.view(), light_of(surface, plan));
    [
        turned_deg(&surface_normals(&sample.impression.contact, view), &normals_of(surface, view)),
        apart(&light_everywhere(plan, sample), &expected),
        misrounded(&image_everywhere(plan, sample), &expected),
    ]
}
