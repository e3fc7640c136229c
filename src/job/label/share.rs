//! Divides a contact between the objects of a press: every pixel belongs to one of them
//! ([`Impression::instance_mask`]).

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::pressed::class_index;
use super::{ObjectLabel, PoseLabel};
use crate::plan::Plan;
use crate::scene::Scene;
use gelsim_core::base::grid::Grid;
use gelsim_core::base::mask_extent::MaskExtent;
use gelsim_core::base::view::View;
use gelsim_core::impression::Impression;
use gelsim_core::instances::{ContactPart, divide_contact};
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
    pub in_image: MaskExtent,
    pub bbox_px: [u32; 4],
}

impl ContactShare {
    /// Measures the pixels of a mask on the pad.
    pub fn from_mask(impression: &Impression, view: &View, mask: &Grid<u8>) -> Self {
        let Impression { lens, gel_map, .. } = impression;
        let extent = MaskExtent::from_mask(mask);
        let bbox = match (gel_map, lens) {
            (Some(map), _) => map.box_of(mask),
            (None, Some(lens)) => lens.box_of(mask, extent.bbox),
            (None, None) => extent.bbox,
        };
        // Without a warp, the pad's pixels are those of the image.
        let warped = (gel_map.is_some() || lens.is_some()) && extent.pixels > 0;
        let in_image = if warped { MaskExtent::from_mask(&impression.in_image(mask)) } else { extent };
        let centroid_mm = if extent.pixels == 0 { [0.0; 2] } else { view.point_mm(extent.centroid_px) };
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
    let parts = divide_contact(impression, numbered, objects);
    // The force is divided in proportion to the pressure on each object's pixels.
    let all: f64 = parts.iter().map(|part| part.pressure_kpa).sum();
    let share = |part: &ContactPart| {
        let own = ContactShare::from_mask(impression, view, &part.mask);
        let of_force = |force| if all > 0.0 { force * (part.pressure_kpa / all) } else { 0.0 };
        own.to_label(part.deepest_mm.into(), impression.contact.force_n.map(of_force))
    };
    parts.iter().map(share).collect()
}
