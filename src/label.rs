//! The label of a sample: one documented struct that is the JSON label and its JSON Schema.
//!
//! The set of keys is the same for every sample of every dataset. Floats are always written with a decimal point, and
//! null stands only for what the chosen model cannot know, then in every sample.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::camera::Image;
use crate::dataset::layout::Split;
use crate::depth::Depth;
use crate::gelpad::elastic::LARGEST_STRAIN;
use crate::gelpad::{Contact, Model};
use crate::grid::{Rect, bounding_box};
use crate::optics::Light;
use crate::plan::Plan;
use crate::scene::Scene;
use crate::simd::wide;

/// Version of the label's keys and their meaning.
pub const SCHEMA_VERSION: u32 = 1;

/// What is known about a sample.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Label {
    /// Version of this schema.
    pub schema_version: u32,
    /// Nine digits that begin the names of the sample's members.
    pub key: String,
    /// Number of the sample in the dataset.
    pub index: u64,
    /// Seed of the job.
    pub seed: u64,
    /// Split that the sample belongs to.
    pub split: Split,
    /// What was pressed.
    pub object: ObjectLabel,
    /// Where it was: p = R q + t takes a point q of the mesh (mm) to the sensor's frame (mm).
    pub pose: PoseLabel,
    /// How deep the object's lowest point reaches below the undeformed pad, mm.
    pub indentation_depth_mm: f64,
    /// Micro relief added to the object.
    pub texture: TextureLabel,
    /// The sensor.
    pub sensor: SensorLabel,
    /// The contact, as far as it is in view.
    pub contact: ContactLabel,
    /// Rung of the accuracy ladder.
    pub fidelity: String,
    /// Model of the gelpad.
    pub gelpad_model: String,
    /// Model of the light.
    pub optics_model: String,
    /// For each effect whether it ran and why or why not.
    pub effects: Effects,
    /// How well the gelpad model solved its problem.
    pub numerics: NumericsLabel,
    /// What a check of the sample found.
    pub health: Health,
}

/// What was pressed.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct ObjectLabel {
    /// Unique name of the object in the dataset.
    pub id: String,
    /// Its class.
    pub class: String,
    /// Number of the class among the dataset's classes, sorted by name.
    pub class_index: u32,
    /// SHA-256 of the mesh file's bytes.
    pub mesh_sha256: String,
}

/// Where the object was.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PoseLabel {
    /// Rotation R as a unit quaternion x, y, z, w with w >= 0.
    pub quaternion_xyzw: [f64; 4],
    /// Translation t, mm.
    pub translation_mm: [f64; 3],
    /// Turn about z, degrees.
    pub yaw_deg: f64,
    /// Tilt, degrees.
    pub tilt_deg: f64,
    /// Direction of the tilt's axis, degrees.
    pub tilt_azimuth_deg: f64,
}

/// Micro relief added to the object.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TextureLabel {
    /// Height of the relief, mm; 0.0 without texture.
    pub amplitude_mm: f64,
}

/// The sensor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SensorLabel {
    /// Its name.
    pub name: String,
    /// Columns of every layer, px.
    pub width_px: u32,
    /// Rows of every layer, px.
    pub height_px: u32,
    /// Distance between pixel centres along x and y, mm.
    pub mm_per_px: [f64; 2],
    /// Thickness of the gelpad, mm.
    pub gelpad_thickness_mm: f64,
    /// Young's modulus of the gelpad, kPa.
    pub gelpad_youngs_modulus_kpa: f64,
    /// Poisson ratio of the gelpad.
    pub gelpad_poisson_ratio: f64,
}

/// The contact, as far as it is in view. Without contact every number is 0.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ContactLabel {
    /// True if any pixel in view touches.
    pub in_contact: bool,
    /// Area that touches, mm^2.
    pub area_mm2: f64,
    /// Share of the view that touches.
    pub fraction: f64,
    /// Mean position of the pixels that touch, mm from the middle of the image.
    pub centroid_mm: [f64; 2],
    /// Smallest box around them, px: x0, y0, x1, y1, half open.
    pub bbox_px: [u32; 4],
    /// Largest depth of the object below the undeformed pad, mm.
    pub max_depth_mm: f64,
    /// Normal force, N; null if the model knows none.
    pub force_n: Option<f64>,
    /// Largest pressure, kPa; null if the model knows none.
    pub peak_pressure_kpa: Option<f64>,
}

/// Every effect.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Effects {
    /// The pad's shape under and around the object.
    pub deformation: Effect,
    /// Light from the LEDs on the deformed surface.
    pub shading: Effect,
    /// Loss of light where the pad is pressed in.
    pub darkening: Effect,
}

/// Whether an effect ran.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Effect {
    /// True if it was computed.
    pub ran: bool,
    /// Why, or why not.
    pub reason: String,
}

/// How well the gelpad model solved its problem.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct NumericsLabel {
    /// True if its tolerance was reached; also for models without iteration.
    pub converged: bool,
    /// Iterations.
    pub iterations: u32,
    /// Largest violation of the contact conditions in the image, um; null if the model has none.
    pub residual_um: Option<f64>,
    /// Indentation depth over pad thickness.
    pub strain: f64,
    /// True if the strain is over 0.5, where the linear theory of the elastic pad has ended.
    pub beyond_theory: bool,
    /// Predicted error of the model's theory, um; null if it is not known.
    pub model_error_um: Option<f64>,
}

/// What a check of the sample found.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Health {
    /// True if every number computed for the sample is finite.
    pub finite: bool,
    /// Pixels with a channel below 0 or above full scale, cut when quantised.
    pub clipped_px: u64,
    /// Pixels with a channel at full scale.
    pub saturated_px: u64,
    /// Pixels where the object was limited to the pad's thickness.
    pub over_thickness_px: u64,
}

/// The nine-digit key of a sample.
pub fn key(index: u64) -> String {
    format!("{index:09}")
}

impl Label {
    /// Describes a rendered sample.
    pub fn describe(
        plan: &Plan,
        scene: &Scene,
        depth: &Depth,
        contact: &Contact,
        light: &Light,
        image: &Image,
    ) -> Self {
        let object = &plan.objects[scene.object];
        let sensor = &plan.job.sensor;
        let [mm_x, mm_y] = plan.camera.mm_per_px;
        let (width, height) = (image.width, image.height);
        let extent = extent(contact, &plan.camera.mm_per_px);
        let in_contact = extent.pixels > 0;
        let view = Rect::whole(width, height);
        let changes = !contact.region.is_empty();
        let finite = image.finite && contact.finite;
        Self {
            schema_version: SCHEMA_VERSION,
            key: key(scene.index),
            index: scene.index,
            seed: plan.seed,
            split: scene.split,
            object: ObjectLabel {
                id: object.id.clone(),
                class: object.class.clone(),
                class_index: plan.class_index(object) as u32,
                mesh_sha256: object.sha256.clone(),
            },
            pose: PoseLabel {
                quaternion_xyzw: scene.pose.quaternion_xyzw(),
                translation_mm: scene.pose.translation_mm.to_array(),
                yaw_deg: scene.pose.angles.yaw_deg,
                tilt_deg: scene.pose.angles.tilt_deg,
                tilt_azimuth_deg: scene.pose.angles.tilt_azimuth_deg,
            },
            indentation_depth_mm: scene.indentation_depth_mm,
            texture: TextureLabel { amplitude_mm: 0.0 },
            sensor: SensorLabel {
                name: sensor.name.clone(),
                width_px: width as u32,
                height_px: height as u32,
                mm_per_px: [mm_x, mm_y],
                gelpad_thickness_mm: sensor.gelpad_thickness_mm,
                gelpad_youngs_modulus_kpa: sensor.gelpad_youngs_modulus_kpa,
                gelpad_poisson_ratio: sensor.gelpad_poisson_ratio,
            },
            contact: ContactLabel {
                in_contact,
                area_mm2: extent.pixels as f64 * mm_x * mm_y,
                fraction: extent.pixels as f64 / view.area() as f64,
                centroid_mm: extent.centroid_mm,
                bbox_px: [extent.bbox.x0, extent.bbox.y0, extent.bbox.x1, extent.bbox.y1].map(|px| px as u32),
                max_depth_mm: if in_contact { f64::from(depth.deepest_mm) } else { 0.0 },
                force_n: contact.force_n,
                peak_pressure_kpa: contact.peak_pressure_kpa,
            },
            fidelity: plan.rung.name().to_owned(),
            gelpad_model: plan.models.gelpad.name().to_owned(),
            optics_model: plan.models.optics.name().to_owned(),
            effects: Effects {
                deformation: match plan.models.gelpad {
                    Model::None(_) => Effect::new(false, "", "the gelpad model has no deformation"),
                    _ => Effect::new(changes, "the object reaches into the pad", "nothing reaches into the pad"),
                },
                // Some equations add light to a flat pad too.
                shading: match changes {
                    true => Effect::new(true, "the surface is not flat", ""),
                    false => Effect::new(!light.region.is_empty(), "a flat pad is shaded too", "the surface is flat"),
                },
                darkening: match plan.shader.darkens() {
                    true => Effect::new(changes, "the surface is pressed in", "the surface is flat"),
                    false => Effect::new(false, "", "the optics model has no darkening"),
                },
            },
            numerics: NumericsLabel {
                converged: contact.numerics.converged,
                iterations: contact.numerics.iterations,
                residual_um: contact.numerics.residual_um,
                strain: scene.indentation_depth_mm / plan.thickness_mm,
                beyond_theory: scene.indentation_depth_mm > LARGEST_STRAIN * plan.thickness_mm,
                model_error_um: contact.numerics.model_error_um,
            },
            health: Health {
                finite,
                clipped_px: image.clipped_px,
                saturated_px: image.saturated_px,
                over_thickness_px: depth.over_thickness_px,
            },
        }
    }
}

impl Effect {
    fn new(ran: bool, why: &str, why_not: &str) -> Self {
        Self { ran, reason: if ran { why } else { why_not }.to_owned() }
    }
}

struct Extent {
    pixels: u64,
    centroid_mm: [f64; 2],
    bbox: Rect,
}

/// Size and place of the contact in view.
fn extent(contact: &Contact, mm_per_px: &[f64; 2]) -> Extent {
    let mask = &contact.mask;
    let bbox = bounding_box(mask, |value| value > 0);
    let (mut pixels, mut sum_x, mut sum_y) = (0_u64, 0_u64, 0_u64);
    wide(
        #[inline(always)]
        || {
            for y in bbox.y0..bbox.y1 {
                // A row's sums fit 32 bits, of which a vector holds eight.
                let (mut in_row, mut columns) = (0_u32, 0_u32);
                for (x, value) in mask.row(y)[bbox.x0..bbox.x1].iter().enumerate() {
                    let touches = u32::from(*value > 0);
                    in_row += touches;
                    columns += touches * x as u32;
                }
                pixels += u64::from(in_row);
                sum_x += u64::from(columns) + u64::from(in_row) * bbox.x0 as u64;
                sum_y += u64::from(in_row) * y as u64;
            }
        },
    );
    let centre = |sum: u64, size: usize, pitch: f64| match pixels {
        0 => 0.0,
        _ => (sum as f64 / pixels as f64 + 0.5 - size as f64 / 2.0) * pitch,
    };
    let centroid_mm = [centre(sum_x, mask.width, mm_per_px[0]), centre(sum_y, mask.height, mm_per_px[1])];
    Extent { pixels, centroid_mm, bbox }
}
