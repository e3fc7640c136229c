//! What a press gives, and its layers in the geometry of the image.

use std::sync::Arc;

use crate::base::clock::Seconds;
use crate::base::grid::Grid;
use crate::base::view::{SURFACE_BORDER, View};
use crate::camera::gel_map::GelMap;
use crate::camera::lens::Lens;
use crate::camera::markers::MarkerPositions;
use crate::camera::pins::PinPositions;
use crate::camera::{CameraParams, Image};
use crate::depth::Depth;
use crate::depth::outline::Outline;
use crate::effects::EffectLog;
use crate::gelpad::Contact;
use crate::gelpad::elastic::history::StickSlip;
use crate::gelpad::sliding::{Slip, Wrench};
use crate::optics::lamps;
use crate::optics::normals::normals;
use crate::pose::PadPlane;

/// What a press gives: the tactile image, and what is known beneath it.
#[derive(Clone)]
#[non_exhaustive]
pub struct Impression {
    /// The tactile image, 8-bit RGB.
    pub image: Image,
    /// How far the object reaches below the undeformed pad. As the pad is, not as the lens shows it; see
    /// [`Impression::depth_mm`].
    pub depth: Depth,
    /// The pad under it: surface, contact mask, pressure, force. As the pad is, not as the lens shows it.
    pub contact: Contact,
    /// What friction did, in a frame of a sequence.
    pub sliding: Option<SlidingState>,
    /// The pad's markers, if it has any.
    pub markers: Option<MarkerPositions>,
    /// The pins inside the gel, if it has any.
    pub pins: Option<PinPositions>,
    /// What the object does to a gel that is not flat, if the model of the gelpad knows it: about the gel's tip.
    pub wrench: Option<Wrench>,
    /// Distortion of the lens, if it has any.
    pub lens: Option<Lens>,
    /// Where the image shows a gel that is not flat.
    pub gel_map: Option<GelMap>,
    /// The camera's parameters, less what was left out.
    pub camera: CameraParams,
    /// Which effects ran, and why.
    pub effects: EffectLog,
    /// CPU seconds that each stage took.
    pub seconds: Seconds,
    pub(super) view: View,
    /// Height over the undeformed pad up to which the object was captured, mm.
    pub(super) above_mm: f64,
    pub(super) lamps: Option<Arc<lamps::Shader>>,
    /// How far a curved pad lies below its highest point, mm, on the grid of the surface.
    pub(super) drop_mm: Option<Arc<Grid<f32>>>,
}

impl std::fmt::Debug for Impression {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { image, contact, wrench, .. } = self;
        let size = [image.width, image.height];
        let mut shown = f.debug_struct("Impression");
        shown.field("resolution_px", &size).field("force_n", &contact.force_n).field("wrench", wrench);
        shown.finish_non_exhaustive()
    }
}

/// What friction did in a frame of a sequence.
#[derive(Clone, Debug)]
pub struct SlidingState {
    /// How much of the contact slips, and how far it has.
    pub slip: Slip,
    /// What the object does to the pad.
    pub wrench: Wrench,
    /// What each pixel in view does. As the pad is, not as the lens shows it.
    pub states: Grid<StickSlip>,
}

/// What [`Impression::gap_mm`] is where no object was captured.
pub const OUT_OF_REACH_MM: f32 = -1.0;

/// Layers in the geometry of the image: row-major, one value per pixel, with the lens's distortion.
impl Impression {
    /// How far the object reaches below the undeformed pad, mm; 0 where it does not.
    pub fn depth_mm(&self) -> Vec<f32> {
        self.through_lens(self.depth.below_pad())
    }

    /// Displacement of the pad's surface, mm, positive into the pad, towards the camera.
    pub fn surface_mm(&self) -> Vec<f32> {
        self.through_lens(self.contact.surface.inner(SURFACE_BORDER))
    }

    /// Clearance between the pad's surface and the object above it, mm: 0 in contact. [`OUT_OF_REACH_MM`] where no object
    /// was captured, and everywhere if none reaches into the pad.
    pub fn gap_mm(&self) -> Vec<f32> {
        let [width, height] = self.view.resolution_px;
        if self.depth.touching.is_empty() {
            return vec![OUT_OF_REACH_MM; width * height];
        }
        let mut gap = self.contact.surface.inner(SURFACE_BORDER);
        let object = self.depth.penetration.inner(self.depth.margin_px);
        let mut captured = Grid::new(width, height);
        for ((gap, g), captured) in gap.data.iter_mut().zip(&object.data).zip(&mut captured.data) {
            *gap = (*gap - g).max(0.0);
            *captured = if *g > -self.above_mm as f32 { 255 } else { 0 };
        }
        let captured = self.mask_in_image(&captured);
        let mut gap = self.through_lens(gap);
        for (gap, captured) in gap.iter_mut().zip(&captured.data) {
            *gap = if *captured > 0 { *gap } else { OUT_OF_REACH_MM };
        }
        gap
    }

    /// 255 where the pad touches the object.
    pub fn contact_mask(&self) -> Vec<u8> {
        self.mask_in_image(&self.contact.mask).data
    }

    /// Which of several objects that were pressed in together is at each pixel of [`Contact::mask`] that touches, or that one of
    /// them reaches below, counted from 1; 0 at all others. `outlines` are theirs in `plane`, and lie apart. As the pad is,
    /// not as the lens shows it.
    pub fn numbered(&self, outlines: &[Outline], plane: &PadPlane) -> Grid<u8> {
        let mask = &self.contact.mask;
        let mut numbered = Grid::new(mask.width, mask.height);
        // Neighbours mostly are the same object's.
        let mut last = 0;
        for y in 0..mask.height {
            for x in 0..mask.width {
                if mask.at(x, y) == 0 && self.penetration_mm(x, y) <= 0.0 {
                    continue;
                }
                let at = self.place_over(plane, x, y);
                if outlines.get(last).is_none_or(|outline| outline.beyond_mm(at) > 0.0) {
                    let beyond = outlines.iter().map(|outline| outline.beyond_mm(at)).enumerate();
                    last = beyond.min_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |(number, _)| number);
                }
                numbered.row_mut(y)[x] = last as u8 + 1;
            }
        }
        numbered
    }

    /// How far an object reaches below the undeformed pad at a pixel of [`Contact::mask`], mm; below 0 over it.
    pub fn penetration_mm(&self, x: usize, y: usize) -> f32 {
        match self.depth.touching.is_empty() {
            true => 0.0,
            false => self.depth.penetration.at(x + self.depth.margin_px, y + self.depth.margin_px),
        }
    }

    /// Where the pad's surface is in a plane at a pixel, mm.
    fn place_over(&self, plane: &PadPlane, x: usize, y: usize) -> [f64; 2] {
        let at = self.view.point_mm([x as f64 + 0.5, y as f64 + 0.5]);
        let Some(map) = &self.gel_map else { return at };
        let down = self.contact.surface.at(x + SURFACE_BORDER, y + SURFACE_BORDER);
        let there = plane.seen_from(map.pressed_point_mm(at, down.into()));
        [there.x, there.y]
    }

    /// A grid of numbers on the pixels of [`Contact::mask`] as the image shows it: that of the nearest pixel.
    pub fn in_image(&self, numbers: &Grid<u8>) -> Grid<u8> {
        self.mask_in_image(numbers)
    }

    /// Of each pixel 128 where the pad sticks to the object, 255 where it slips, 0 where it does not touch it; 0 everywhere but
    /// in a frame of a sequence.
    pub fn slip(&self) -> Vec<u8> {
        let Some(slid) = &self.sliding else { return vec![0; self.contact.mask.data.len()] };
        let of = |wanted: StickSlip| {
            let data = slid.states.data.iter().map(|state| if *state == wanted { 255 } else { 0 }).collect();
            let mask = Grid { width: slid.states.width, height: slid.states.height, data };
            self.mask_in_image(&mask).data
        };
        let value = |(sticks, slips): (u8, u8)| match (sticks, slips) {
            (0, 0) => 0,
            (_, 0) => 128,
            _ => 255,
        };
        of(StickSlip::Sticks).into_iter().zip(of(StickSlip::Slips)).map(value).collect()
    }

    /// How far the pad's surface has moved in its own plane since it was untouched, along x and y, mm; 0 where nothing is
    /// known of it. On a gel that is not flat x and y are the sensor's, taken to each point by the smallest turn that takes z to the
    /// gel's normal.
    pub fn flow_mm(&self) -> Vec<[f32; 2]> {
        let [width, height] = self.view.resolution_px;
        let Some(tangential) = &self.contact.tangential else { return vec![[0.0; 2]; width * height] };
        let planes = tangential.field.in_view(&self.view);
        if let Some(map) = &self.gel_map {
            return map.along_gel(&planes);
        }
        let [x, y] = planes.map(|plane| self.through_lens(plane));
        x.into_iter().zip(y).map(|(x, y)| [x, y]).collect()
    }

    /// Unit normals of the pad's surface, towards the camera: a flat pad is (0, 0, -1).
    pub fn normals(&self) -> Vec<[f32; 3]> {
        if let Some(map) = &self.gel_map {
            return map.normals(&self.contact.surface, self.contact.region);
        }
        let mut normals = normals(&self.contact, &self.view);
        if self.lens.is_some() {
            let [width, height] = self.view.resolution_px;
            let plane = |k: usize| normals.iter().map(|normal| normal[k]).collect();
            let planes = [0, 1, 2].map(|k| self.through_lens(Grid { width, height, data: plane(k) }));
            for (i, normal) in normals.iter_mut().enumerate() {
                let [x, y, z] = planes.each_ref().map(|plane| plane[i]);
                // Interpolated normals are a little short.
                let length = (x * x + y * y + z * z).sqrt();
                *normal = [x / length, y / length, z / length];
            }
        }
        normals
    }

    /// The point of the pad's surface that each pixel shows, in the sensor's frame, mm; 0, 0, 0 where it shows no gel.
    pub fn points_mm(&self) -> Vec<[f32; 3]> {
        if let Some(map) = &self.gel_map {
            return map.points_mm(&self.contact.surface);
        }
        let View { resolution_px: [width, height], .. } = self.view;
        let plane = |value: &dyn Fn([usize; 2]) -> f32| {
            let data = (0..width * height).map(|at| value([at % width, at / width])).collect();
            self.through_lens(Grid { width, height, data })
        };
        let place = |[x, y]: [usize; 2]| self.view.point_mm([x as f64 + 0.5, y as f64 + 0.5]);
        let at = |grid: &Grid<f32>, [x, y]: [usize; 2]| grid.at(x + SURFACE_BORDER, y + SURFACE_BORDER);
        let below = |px| at(&self.contact.surface, px) + self.drop_mm.as_ref().map_or(0.0, |drop_mm| at(drop_mm, px));
        let planes = [plane(&|px| place(px)[0] as f32), plane(&|px| place(px)[1] as f32), plane(&|px| 0.0 - below(px))];
        (0..width * height).map(|at| planes.each_ref().map(|plane| plane[at])).collect()
    }

    /// Pressure between pad and object, kPa; 0 without contact. `None` if the model of the gelpad knows none.
    pub fn pressure_kpa(&self) -> Option<Vec<f32>> {
        self.contact.peak_pressure_kpa?;
        let [width, height] = self.view.resolution_px;
        let pressure = self.contact.pressure.clone();
        Some(pressure.map_or_else(|| vec![0.0; width * height], |pressure| self.through_lens(pressure)))
    }

    /// The grey image under each of the sensor's lamps, 0 to 1, without markers and the camera's blur, exposure and noise; empty
    /// on a sensor without lamps.
    pub fn lamps(&self) -> Vec<Vec<f32>> {
        let planes = self.lamps.as_ref().map_or_else(Vec::new, |lamps| lamps.grey(&self.contact.surface));
        planes.into_iter().map(|plane| self.through_lens(plane)).collect()
    }

    /// Where each marker in view was printed, and where the pad carried it, px: the first pixel's centre is at (0.5, 0.5).
    pub fn marker_positions(&self) -> Vec<([f64; 2], [f64; 2])> {
        let in_view =
            |markers: &MarkerPositions| markers.in_view(self.lens.as_ref(), self.view.resolution_px).collect();
        self.markers.as_ref().map_or_else(Vec::new, in_view)
    }

    fn through_lens(&self, plane: Grid<f32>) -> Vec<f32> {
        match (&self.gel_map, &self.lens) {
            (Some(map), _) => map.plane(&plane).data,
            (None, Some(lens)) => lens.warp_plane(&plane).data,
            (None, None) => plane.data,
        }
    }

    fn mask_in_image(&self, mask: &Grid<u8>) -> Grid<u8> {
        match (&self.gel_map, &self.lens) {
            (Some(map), _) => map.mask(mask),
            (None, Some(lens)) => lens.warp_mask(mask),
            (None, None) => mask.clone(),
        }
    }
}
