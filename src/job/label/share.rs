//! Divides a contact between the objects of a press: every pixel belongs to one of them
//! ([`Impression::instance_mask`]).

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::pressed::class_index;
use super::{ObjectLabel, PoseLabel};
use crate::plan::Plan;
use crate::scene::Scene;
use gelsim_core::base::grid::{Grid, Rect, bounding_box};
use gelsim_core::base::simd::simd_dispatch;
use gelsim_core::base::view::View;
use gelsim_core::impression::Impression;
use gelsim_core::simulator::Simulator;

/// One of the objects that were pressed in together.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PressedLabel {
    /// Unique name of the object in the dataset. Two objects of a press may be copies of the same, with the same name.
    pub id: String,
    /// Its class.
    pub class: String,
    /// Number of the class among the dataset's classes, sorted by name.
    pub class_index: u32,
    /// SHA-256 of the mesh file's bytes; empty if a depth frame stands for the object.
    pub mesh_sha256: String,
    /// Path of the mesh file as the job names it; empty if a depth frame stands for the object.
    pub path: String,
    /// Factor on the object's size.
    pub scale: f64,
    /// Pose of the object.
    pub pose: PoseLabel,
    /// Depth of the object's lowest point below the undeformed pad, mm.
    pub indentation_depth_mm: f64,
    /// Its share of the contact in view.
    pub contact: ShareLabel,
}

/// An object's share of the contact in view. Without contact every number is 0.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ShareLabel {
    /// True if the object touches the pad in view.
    pub in_contact: bool,
    /// Area of its contact, mm^2.
    pub area_mm2: f64,
    /// Mean position of the pixels that touch it, mm from the middle of the image; for a gel that is not flat, from its
    /// axis.
    pub centroid_mm: [f64; 2],
    /// Mean position of its pixels of the layer `instance`, px. The centre of the first pixel is at (0.5, 0.5).
    pub centroid_px: [f64; 2],
    /// Smallest box around its pixels, px: x0, y0, x1, y1, half open.
    pub bbox_px: [u32; 4],
    /// Its largest depth in view below the undeformed pad, mm.
    pub max_depth_mm: f64,
    /// Normal force between it and the pad in view, N; null if that of the contact is. The sum over all objects is the
    /// contact's force.
    pub force_n: Option<f64>,
}

/// Size and place of a part of a contact in view.
pub(super) struct ContactShare {
    /// Number of pixels of the pad's grid.
    pub pixels: u64,
    pub area_mm2: f64,
    pub centroid_mm: [f64; 2],
    /// The same part as the image shows it, with lens distortion.
    pub in_image: PixelExtent,
    pub bbox_px: [u32; 4],
}

/// Size and place of marked pixels.
#[derive(Clone, Copy)]
pub(super) struct PixelExtent {
    pub pixels: u64,
    /// Mean position, px.
    pub centroid_px: [f64; 2],
    bbox: Rect,
}

impl ContactShare {
    /// Measures the pixels of a mask on the pad.
    pub fn from_mask(impression: &Impression, view: &View, mask: &Grid<u8>) -> Self {
        let Impression { lens, gel_map, .. } = impression;
        let extent = PixelExtent::from_mask(mask);
        let bbox = match (gel_map, lens) {
            (Some(map), _) => map.box_of(mask),
            (None, Some(lens)) => lens.box_of(mask, extent.bbox),
            (None, None) => extent.bbox,
        };
        // Without a warp, the pad's pixels are those of the image.
        let warped = (gel_map.is_some() || lens.is_some()) && extent.pixels > 0;
        let in_image = if warped { PixelExtent::from_mask(&impression.in_image(mask)) } else { extent };
        let centroid_mm = extent.centroid_mm(view);
        Self {
            pixels: extent.pixels,
            area_mm2: extent.pixels as f64 * view.mm_per_px[0] * view.mm_per_px[1],
            centroid_mm: match gel_map {
                Some(map) => map.place_mm(centroid_mm),
                None => centroid_mm,
            },
            in_image,
            bbox_px: [bbox.x0, bbox.y0, bbox.x1, bbox.y1].map(|px| px as u32),
        }
    }

    fn to_label(&self, max_depth_mm: f64, force_n: Option<f64>) -> ShareLabel {
        ShareLabel {
            in_contact: self.pixels > 0,
            area_mm2: self.area_mm2,
            centroid_mm: self.centroid_mm,
            centroid_px: self.in_image.centroid_px,
            bbox_px: self.bbox_px,
            max_depth_mm: if self.pixels > 0 { max_depth_mm } else { 0.0 },
            force_n,
        }
    }
}

/// Describes the objects of a press with their shares of the contact. For several objects, `numbered` has the number of
/// the object at each pixel. `first` is the first object as the label has it, its pose, and the complete contact.
pub(super) fn describe_objects(
    plan: &Plan,
    scene: &Scene,
    simulator: &Simulator,
    impression: &Impression,
    numbered: Option<&Grid<u8>>,
    first: (&ObjectLabel, &PoseLabel, &ContactShare),
) -> Vec<PressedLabel> {
    let (object, pose, total) = first;
    let contact = &impression.contact;
    let shares = match numbered {
        None => vec![total.to_label(impression.depth.deepest_mm.into(), contact.force_n)],
        Some(numbered) => compute_shares(impression, simulator.view(), numbered, 1 + scene.other_objects.len()),
    };
    let others = scene.other_objects.iter().map(|other| {
        let known = &plan.sampling.objects[other.number];
        let object = ObjectLabel {
            id: known.id.clone(),
            class: known.class.clone(),
            class_index: class_index(plan, &known.class),
            mesh_sha256: known.sha256.clone(),
            path: known.path.clone(),
            scale: other.scale,
            material: Default::default(),
        };
        (object, PoseLabel::from_pose(&other.pose), other.indentation_depth_mm)
    });
    let own = (object.clone(), pose.clone(), scene.indentation_depth_mm);
    let labelled = |((object, pose, indentation_depth_mm), contact)| {
        let ObjectLabel { id, class, class_index, mesh_sha256, path, scale, material: _ } = object;
        PressedLabel { id, class, class_index, mesh_sha256, path, scale, pose, indentation_depth_mm, contact }
    };
    std::iter::once(own).chain(others).zip(shares).map(labelled).collect()
}

/// Computes each object's share of a contact.
fn compute_shares(impression: &Impression, view: &View, numbered: &Grid<u8>, objects: usize) -> Vec<ShareLabel> {
    let contact = &impression.contact;
    let (mut deepest_mm, mut pressed) = (vec![0.0_f32; objects], vec![0.0_f64; objects]);
    for y in 0..numbered.height {
        for (x, number) in numbered.row(y).iter().enumerate().filter(|(_, number)| **number > 0) {
            let of = usize::from(*number) - 1;
            deepest_mm[of] = deepest_mm[of].max(impression.penetration_mm(x, y));
            pressed[of] += contact.pressure.as_ref().map_or(0.0, |pressure| f64::from(pressure.at(x, y)));
        }
    }
    // The force is divided in proportion to the pressure on each object's pixels.
    let all: f64 = pressed.iter().sum();
    let share = |of: usize| {
        let touches = |(number, mask): (&u8, &u8)| if usize::from(*number) == of + 1 { *mask } else { 0 };
        let data = numbered.data.iter().zip(&contact.mask.data).map(touches).collect();
        let own = ContactShare::from_mask(impression, view, &Grid { data, ..*numbered });
        let force_n = contact.force_n.map(|force| if all > 0.0 { force * (pressed[of] / all) } else { 0.0 });
        own.to_label(deepest_mm[of].into(), force_n)
    };
    (0..objects).map(share).collect()
}

impl PixelExtent {
    /// Measures the marked pixels of a mask.
    fn from_mask(mask: &Grid<u8>) -> Self {
        let bbox = bounding_box(mask, |value| value > 0);
        let (mut pixels, mut sum_x, mut sum_y) = (0_u64, 0_u64, 0_u64);
        simd_dispatch(
            #[inline(always)]
            || {
                for y in bbox.y0..bbox.y1 {
                    // The sums of a row fit 32 bits, of which a vector holds eight.
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
        let centre = |sum: u64| if pixels == 0 { 0.0 } else { sum as f64 / pixels as f64 + 0.5 };
        Self { pixels, centroid_px: [centre(sum_x), centre(sum_y)], bbox }
    }

    /// Returns the middle, mm from the middle of the view; 0 without contact.
    fn centroid_mm(&self, view: &View) -> [f64; 2] {
        if self.pixels == 0 { [0.0; 2] } else { view.point_mm(self.centroid_px) }
    }
}
