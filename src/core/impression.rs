//! The result of a press, and its layers in the geometry of the image.

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
use crate::gelpad::elastic::friction_history::StickSlip;
use crate::gelpad::sliding::{Slip, Wrench};
use crate::gelpad::tangential::TangentialMotion;
use crate::gelpad::traction_map::TractionMap;
use crate::optics::lamps;
use crate::optics::normals::surface_normals;
use crate::pose::PadPlane;

/// The result of a press: the tactile image, and the ground truth behind it.
#[derive(Clone)]
#[non_exhaustive]
pub struct Impression {
    /// The tactile image, 8-bit RGB.
    pub image: Image,
    /// How far the object reaches below the undeformed pad, in the pad's own geometry: without the lens's distortion.
    /// [`Impression::depth_mm`] is the layer in the image.
    pub depth: Depth,
    /// The deformed pad: surface, contact mask, pressure, force; in the pad's own geometry, without the lens's
    /// distortion.
    pub contact: Contact,
    /// Friction in a frame of a sequence; `None` for a single press.
    pub sliding: Option<SlidingState>,
    /// The pad's markers; `None` if it has none.
    pub markers: Option<MarkerPositions>,
    /// The pins inside the gel; `None` if it has none.
    pub pins: Option<PinPositions>,
    /// Force and torque of the object on a gel that is not flat, about the gel's tip; `None` on a flat pad, and if the
    /// model of the gelpad does not know them.
    pub wrench: Option<Wrench>,
    /// Distortion of the lens; `None` if it has none.
    pub lens: Option<Lens>,
    /// Where each pixel lies on a gel that is not flat; `None` on a flat pad.
    pub gel_map: Option<GelMap>,
    /// The camera's parameters in this press, without the effect that the policy leaves out.
    pub camera: CameraParams,
    /// Which effects ran, why, and how long each took.
    pub effects: EffectLog,
    /// CPU seconds that each stage took.
    pub seconds: Seconds,
    pub(super) view: View,
    /// Height above the undeformed pad up to which the object was captured, mm.
    pub(super) above_mm: f64,
    pub(super) lamps: Option<Arc<lamps::LampShader>>,
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

/// Friction in a frame of a sequence.
#[derive(Clone, Debug)]
pub struct SlidingState {
    /// How much of the contact slips, and how far the pad has slid along the object.
    pub slip: Slip,
    /// Force and torque of the object on the pad.
    pub wrench: Wrench,
    /// Whether each pixel in view sticks or slips, in the pad's own geometry: without the lens's distortion.
    pub states: Grid<StickSlip>,
    /// Tractions and pressure; `None` without contact.
    pub tractions: Option<TractionMap>,
}

/// Value of [`Impression::gap_mm`] where no object was captured.
pub const OUT_OF_REACH_MM: f32 = -1.0;

/// Layers in the geometry of the image: row-major, one value per pixel, with the lens's distortion.
impl Impression {
    /// Returns how far the object reaches below the undeformed pad, mm; 0 where it does not.
    pub fn depth_mm(&self) -> Vec<f32> {
        self.warp_plane(self.depth.below_pad())
    }

    /// Returns the displacement of the pad's surface, mm, positive into the pad, towards the camera.
    pub fn surface_mm(&self) -> Vec<f32> {
        self.warp_plane(self.contact.surface.inner(SURFACE_BORDER))
    }

    /// Returns the clearance between the pad's surface and the object above it, mm; 0 in contact. It is
    /// [`OUT_OF_REACH_MM`] where no object was captured, and everywhere if no object reaches into the pad.
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
        let captured = self.warp_mask(&captured);
        let mut gap = self.warp_plane(gap);
        for (gap, captured) in gap.iter_mut().zip(&captured.data) {
            *gap = if *captured > 0 { *gap } else { OUT_OF_REACH_MM };
        }
        gap
    }

    /// Returns a mask: 255 where the pad touches the object, else 0.
    pub fn contact_mask(&self) -> Vec<u8> {
        self.warp_mask(&self.contact.mask).data
    }

    /// Returns which of several objects that were pressed in together is at each pixel of [`Contact::mask`].
    ///
    /// Objects are counted from 1. A pixel has a number where the pad touches an object or an object reaches below the
    /// undeformed pad; all others are 0. `outlines` are those of the objects in `plane`, and must not overlap. The
    /// result is in the pad's own geometry; [`Impression::in_image`] takes it to that of the image.
    pub fn instance_mask(&self, outlines: &[Outline], plane: &PadPlane) -> Grid<u8> {
        let mask = &self.contact.mask;
        let mut instances = Grid::new(mask.width, mask.height);
        // Neighbouring pixels mostly belong to the same object, so the last one is tried first.
        let mut last = 0;
        for y in 0..mask.height {
            for x in 0..mask.width {
                if mask.at(x, y) == 0 && self.penetration_mm(x, y) <= 0.0 {
                    continue;
                }
                let at = self.surface_point_on(plane, x, y);
                if outlines.get(last).is_none_or(|outline| outline.beyond_mm(at) > 0.0) {
                    let distances = outlines.iter().map(|outline| outline.beyond_mm(at)).enumerate();
                    last = distances.min_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |(number, _)| number);
                }
                instances.row_mut(y)[x] = last as u8 + 1;
            }
        }
        instances
    }

    /// Returns how far an object reaches below the undeformed pad at a pixel of [`Contact::mask`], mm; negative where
    /// it stays above. It is 0 everywhere if no object reaches into the pad.
    pub fn penetration_mm(&self, x: usize, y: usize) -> f32 {
        match self.depth.touching.is_empty() {
            true => 0.0,
            false => self.depth.penetration.at(x + self.depth.margin_px, y + self.depth.margin_px),
        }
    }

    /// Returns where the pad's surface at a pixel is in `plane`, mm.
    fn surface_point_on(&self, plane: &PadPlane, x: usize, y: usize) -> [f64; 2] {
        let at = self.view.point_mm([x as f64 + 0.5, y as f64 + 0.5]);
        let Some(map) = &self.gel_map else { return at };
        let down = self.contact.surface.at(x + SURFACE_BORDER, y + SURFACE_BORDER);
        let point = plane.point_in_plane(map.pressed_point_mm(at, down.into()));
        [point.x, point.y]
    }

    /// Takes numbers on the pixels of [`Contact::mask`] into the geometry of the image: each pixel gets the nearest
    /// one's.
    pub fn in_image(&self, numbers: &Grid<u8>) -> Grid<u8> {
        self.warp_mask(numbers)
    }

    /// Returns 128 where the pad sticks to the object, 255 where it slips, and 0 where it does not touch it. A single
    /// press has 0 everywhere.
    pub fn slip(&self) -> Vec<u8> {
        let Some(sliding) = &self.sliding else { return vec![0; self.contact.mask.data.len()] };
        let of = |wanted: StickSlip| {
            let data = sliding.states.data.iter().map(|state| if *state == wanted { 255 } else { 0 }).collect();
            let mask = Grid { width: sliding.states.width, height: sliding.states.height, data };
            self.warp_mask(&mask).data
        };
        let value = |(sticks, slips): (u8, u8)| match (sticks, slips) {
            (0, 0) => 0,
            (_, 0) => 128,
            _ => 255,
        };
        of(StickSlip::Sticks).into_iter().zip(of(StickSlip::Slips)).map(value).collect()
    }

    /// Returns how far the pad's surface has moved in its own plane since it was untouched, along x and y, mm; 0 where
    /// that is not known.
    ///
    /// A press computes it if markers or pins show it; [`crate::simulator::Simulator::with_flow`] makes every press do
    /// so. On a gel that is not flat, x and y are the sensor's, taken to each point by the smallest rotation that takes
    /// z to the gel's normal.
    pub fn flow_mm(&self) -> Vec<[f32; 2]> {
        let [width, height] = self.view.resolution_px;
        let Some(tangential) = &self.contact.tangential else { return vec![[0.0; 2]; width * height] };
        let planes = tangential.field.sample_view(&self.view);
        if let Some(map) = &self.gel_map {
            return map.warp_motion(&planes);
        }
        let [x, y] = planes.map(|plane| self.warp_plane(plane));
        x.into_iter().zip(y).map(|(x, y)| [x, y]).collect()
    }

    /// Returns the unit normals of the pad's surface, facing the camera; a flat pad has (0, 0, -1).
    pub fn normals(&self) -> Vec<[f32; 3]> {
        if let Some(map) = &self.gel_map {
            return map.normals(&self.contact.surface, self.contact.region);
        }
        let mut normals = surface_normals(&self.contact, &self.view);
        if self.lens.is_some() {
            let [width, height] = self.view.resolution_px;
            let plane = |k: usize| normals.iter().map(|normal| normal[k]).collect();
            let planes = [0, 1, 2].map(|k| self.warp_plane(Grid { width, height, data: plane(k) }));
            for (i, normal) in normals.iter_mut().enumerate() {
                let [x, y, z] = planes.each_ref().map(|plane| plane[i]);
                // Between normals of length 1, interpolated ones are a little shorter.
                let length = (x * x + y * y + z * z).sqrt();
                *normal = [x / length, y / length, z / length];
            }
        }
        normals
    }

    /// Returns the point of the pad's surface that each pixel shows, in the sensor's frame, mm; (0, 0, 0) where it
    /// shows no gel.
    pub fn points_mm(&self) -> Vec<[f32; 3]> {
        if let Some(map) = &self.gel_map {
            return map.points_mm(&self.contact.surface);
        }
        let View { resolution_px: [width, height], .. } = self.view;
        let plane = |value: &dyn Fn([usize; 2]) -> f32| {
            let data = (0..width * height).map(|at| value([at % width, at / width])).collect();
            self.warp_plane(Grid { width, height, data })
        };
        let place = |[x, y]: [usize; 2]| self.view.point_mm([x as f64 + 0.5, y as f64 + 0.5]);
        let at = |grid: &Grid<f32>, [x, y]: [usize; 2]| grid.at(x + SURFACE_BORDER, y + SURFACE_BORDER);
        let below = |px| at(&self.contact.surface, px) + self.drop_mm.as_ref().map_or(0.0, |drop_mm| at(drop_mm, px));
        // `0.0 - x` instead of `-x`, so that a flat pad has no -0.0.
        let planes = [plane(&|px| place(px)[0] as f32), plane(&|px| place(px)[1] as f32), plane(&|px| 0.0 - below(px))];
        (0..width * height).map(|at| planes.each_ref().map(|plane| plane[at])).collect()
    }

    /// Returns the pressure between pad and object, kPa; 0 without contact. `None` if the model of the gelpad does not
    /// know it.
    pub fn pressure_kpa(&self) -> Option<Vec<f32>> {
        self.contact.peak_pressure_kpa?;
        let [width, height] = self.view.resolution_px;
        let pressure = self.contact.pressure.clone();
        Some(pressure.map_or_else(|| vec![0.0; width * height], |pressure| self.warp_plane(pressure)))
    }

    /// Returns the force of the object on the pad by area, kPa: along x and y, and into the pad; 0 without contact.
    /// `None` if the model of the gelpad does not know it.
    ///
    /// In a single press friction is known where the press computes the motion of the pad's surface in its plane; see
    /// [`Impression::flow_mm`]. On a gel that is not flat, x and y are as in [`Impression::flow_mm`].
    pub fn traction_kpa(&self) -> Option<Vec<[f32; 3]>> {
        self.contact.peak_pressure_kpa?;
        let planes = match (&self.sliding, &self.contact.tangential) {
            (Some(sliding), _) => sliding.tractions.as_ref().map(|map| map.sample_view(&self.view, 1.0)),
            (None, Some(TangentialMotion { tractions: Some(map), .. })) => {
                Some(map.sample_view(&self.view, self.contact.stiffening_factor))
            }
            _ => self.contact.pressure.as_ref().map(|pressure| {
                let none = Grid::new(pressure.width, pressure.height);
                [none.clone(), none, pressure.clone()]
            }),
        };
        let [width, height] = match &self.gel_map {
            Some(map) => map.size_px(),
            None => self.view.resolution_px,
        };
        let Some([x, y, z]) = planes else { return Some(vec![[0.0; 3]; width * height]) };
        let into = self.warp_plane(z);
        let along = match &self.gel_map {
            Some(map) => map.warp_motion(&[x, y]),
            None => self.warp_plane(x).into_iter().zip(self.warp_plane(y)).map(|(x, y)| [x, y]).collect(),
        };
        Some(along.into_iter().zip(into).map(|([x, y], z)| [x, y, z]).collect())
    }

    /// Renders the grey image under each of the sensor's lamps, 0 to 1, without markers, blur, exposure and noise;
    /// empty on a sensor without lamps.
    pub fn lamps(&self) -> Vec<Vec<f32>> {
        let planes = self.lamps.as_ref().map_or_else(Vec::new, |lamps| lamps.render_grey(&self.contact.surface));
        planes.into_iter().map(|plane| self.warp_plane(plane)).collect()
    }

    /// Returns for each marker in view where it was printed, and where the pad carried it, px: the first pixel's centre
    /// is at (0.5, 0.5).
    pub fn marker_positions(&self) -> Vec<([f64; 2], [f64; 2])> {
        let in_view =
            |markers: &MarkerPositions| markers.in_view(self.lens.as_ref(), self.view.resolution_px).collect();
        self.markers.as_ref().map_or_else(Vec::new, in_view)
    }

    /// Takes a layer of the pad into the geometry of the image, bilinear.
    fn warp_plane(&self, plane: Grid<f32>) -> Vec<f32> {
        match (&self.gel_map, &self.lens) {
            (Some(map), _) => map.warp_plane(&plane).data,
            (None, Some(lens)) => lens.warp_plane(&plane).data,
            (None, None) => plane.data,
        }
    }

    /// Takes a mask of the pad into the geometry of the image, by the nearest pixel.
    fn warp_mask(&self, mask: &Grid<u8>) -> Grid<u8> {
        match (&self.gel_map, &self.lens) {
            (Some(map), _) => map.warp_mask(mask),
            (None, Some(lens)) => lens.warp_mask(mask),
            (None, None) => mask.clone(),
        }
    }
}
