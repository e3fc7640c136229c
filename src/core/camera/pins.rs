//! Pins that stand on the inside of a curved gel's skin (TacTip): where their tips are, and how the camera sees them.
//!
//! A pin stands on an inner skin, which follows the outer one smoothed. Its tip moves with that skin and leans with its
//! slope. The camera sees the tips, white on black.

use std::ops::Range;

use glam::{DMat2, DMat3, DVec2, DVec3};

use super::gel_map::interpolate_bilinear;
use super::projection::Projection;
use crate::base::chart::Chart;
use crate::base::gaussian_blur;
use crate::base::gel::{GelShape, Site};
use crate::base::grid::{Grid, Rect};
use crate::base::light::Light;
use crate::base::rng::RandomStream;
use crate::base::view::{SURFACE_BORDER, View};
use crate::gelpad::Contact;
use crate::gelpad::elastic::in_plane::DisplacementField;

/// The way in which points of the skin move under a press.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum Along {
    /// Along the gel's own normals: the skin slides over the object.
    #[default]
    Normal,
    /// The way the object pushes: the skin sticks to it.
    Press,
}

/// The pins of a sensor.
#[derive(Clone, Debug, PartialEq)]
pub struct Pins {
    /// Where the pins stand, mm from the tip over the skin: points of the chart around the tip.
    pub at_mm: Vec<[f64; 2]>,
    /// Distance from the outer skin to a pin's tip, mm.
    pub length_mm: f64,
    /// Diameter of the white tips, mm.
    pub diameter_mm: f64,
    /// Standard deviation of the smoothing by which the inner skin follows the outer one, mm.
    pub skin_smoothing_mm: f64,
    /// The way in which points of the skin move.
    pub along: Along,
    /// Fraction of the gel's motion in its own plane that the skin, stiffer than the gel, takes part in.
    pub in_plane: f64,
    /// Standard deviation of the smoothing by which the skin follows what friction drags along it, mm.
    pub drag_smoothing_mm: f64,
    /// Standard deviation of the diameters from sample to sample, as a fraction.
    pub size_jitter: f64,
    /// Standard deviation of the tips' positions in their plane from sample to sample, mm.
    pub place_jitter_mm: f64,
    /// The ring that holds the skin; `None` if the camera does not see it.
    pub mount: Option<MountRing>,
}

/// A white ring around the pins.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct MountRing {
    /// Radius of its middle line, mm.
    pub radius_mm: f64,
    /// Width, mm.
    pub width_mm: f64,
    /// How far it lies below the gel's tip, mm.
    pub below_tip_mm: f64,
}

/// A pin's tip.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PinTip {
    /// Its middle, in the sensor's frame, mm.
    pub at_mm: DVec3,
    /// Direction in which the pin points: out of the gel.
    pub axis: DVec3,
    /// Where the image shows it, px; the first pixel's centre is at (0.5, 0.5). `None` if the camera cannot see it.
    pub px: Option<[f64; 2]>,
}

/// The tips of all pins at rest and now, in the same order.
#[derive(Clone, Debug, PartialEq)]
pub struct PinPositions {
    /// On the untouched gel.
    pub rest: Vec<PinTip>,
    /// Where the skin carried them.
    pub moved: Vec<PinTip>,
}

impl PinPositions {
    /// Iterates over the pins that the image shows at rest or now, and returns both tips.
    pub fn in_view(&self, size: [usize; 2]) -> impl Iterator<Item = (&PinTip, &PinTip)> {
        let inside =
            move |tip: &PinTip| tip.px.is_some_and(|px| (0..2).all(|k| (0.0..=size[k] as f64).contains(&px[k])));
        self.rest.iter().zip(&self.moved).filter(move |(rest, moved)| inside(rest) || inside(moved))
    }
}

/// The smoothed motion of the skin over a chart.
pub struct SkinMotion {
    chart: Chart,
    /// Motion along the chart's axes, mm: a plane each for x, y and z, with a value at every node.
    planes: [Grid<f32>; 3],
    /// Distance between nodes along x and y, mm.
    spacing_mm: [f64; 2],
    /// Place of the first node on the chart, mm.
    origin_mm: [f64; 2],
}

impl SkinMotion {
    /// Computes the motion of a press on a chart with the nodes of `view`. Points of the skin move along `direction`,
    /// or along their own normals if it is `None`. The skin ends `lowest_mm` over the sensor's origin.
    pub(crate) fn new(
        contact: &Contact,
        chart: &Chart,
        view: &View,
        direction: Option<DVec3>,
        (pins, lowest_mm): (&Pins, f64),
    ) -> Self {
        let smoothing_mm = pins.skin_smoothing_mm;
        // Half a smoothing length between nodes is fine enough for what is smoothed by it.
        let factor = view.mm_per_px.map(|pixel_mm| ((smoothing_mm / (2.0 * pixel_mm)) as usize).max(1));
        let [width, height] = [0, 1].map(|k| view.resolution_px[k].div_ceil(factor[k]));
        let spacing_mm = [0, 1].map(|k| view.mm_per_px[k] * factor[k] as f64);
        let first_px = factor.map(|factor| factor as f64 / 2.0);
        let origin_mm = view.point_mm(first_px);
        let to_chart_axes = chart.axes().transpose();
        let tangential = contact.tangential.as_ref();
        let dragged = tangential.and_then(|tangential| tangential.dragged.as_ref());
        let mut planes = [(); 3].map(|()| Vec::with_capacity(width * height));
        // What friction drags along the skin, along the gel's tangents, and where there is skin.
        let mut drag = [(); 3].map(|()| Vec::new());
        for y in 0..height {
            for x in 0..width {
                let at = [origin_mm[0] + x as f64 * spacing_mm[0], origin_mm[1] + y as f64 * spacing_mm[1]];
                let rest = chart.surface_frame(at);
                let block = NodeBlock::new([x, y], factor, view.resolution_px);
                let depth_mm = f64::from(block.mean(&contact.surface, SURFACE_BORDER));
                let follows = |field: &DisplacementField| field.at(at).map(|mm| pins.in_plane * f64::from(mm));
                let mut moved = tangential.map_or([0.0; 2], |tangential| follows(&tangential.field));
                if let Some(dragged) = dragged {
                    let part = follows(dragged);
                    moved = [moved[0] - part[0], moved[1] - part[1]];
                    let is_skin = f64::from(rest.point_mm.z >= lowest_mm);
                    let values = [is_skin * part[0], is_skin * part[1], is_skin];
                    drag.iter_mut().zip(values).for_each(|(plane, value)| plane.push(value as f32));
                }
                let [along, down] = moved;
                // Skin that sticks to the object goes where that pushes it; the rest moves along its normal.
                let into = direction.map_or(rest.normal, |press| {
                    let sticks = f64::from(block.mean(&contact.mask, 0)) / 255.0;
                    rest.normal + sticks * (press * press.dot(rest.normal) - rest.normal)
                });
                let moved = to_chart_axes * (along * rest.tangents[0] + down * rest.tangents[1] - depth_mm * into);
                planes.iter_mut().zip(moved.to_array()).for_each(|(plane, value)| plane.push(value as f32));
            }
        }
        let sigma_px = spacing_mm.map(|mm| smoothing_mm / mm);
        let mut smoothed = gaussian_blur::blur_whole(&planes, width, height, sigma_px);
        if dragged.is_some() {
            let sigma_px = spacing_mm.map(|mm| libm::hypot(smoothing_mm, pins.drag_smoothing_mm) / mm);
            let whole = Rect::whole(width, height);
            let [along, down, skin] = gaussian_blur::blur_region(&drag, whole, whole, sigma_px);
            for node in (0..width * height).filter(|node| skin[*node] > 0.0) {
                let at = [
                    origin_mm[0] + (node % width) as f64 * spacing_mm[0],
                    origin_mm[1] + (node / width) as f64 * spacing_mm[1],
                ];
                let rest = chart.surface_frame(at);
                let [along, down] = [along[node], down[node]].map(|mm| f64::from(mm / skin[node]));
                let moved = to_chart_axes * (along * rest.tangents[0] + down * rest.tangents[1]);
                smoothed.iter_mut().zip(moved.to_array()).for_each(|(plane, value)| plane[node] += value as f32);
            }
        }
        let planes = smoothed.map(|data| Grid { width, height, data });
        Self { chart: chart.clone(), planes, spacing_mm, origin_mm }
    }

    /// Returns how the skin moved at a point of the chart, in the sensor's frame, mm; 0 outside the chart.
    fn displacement_at(&self, at: [f64; 2]) -> DVec3 {
        let px = [0, 1].map(|k| ((at[k] - self.origin_mm[k]) / self.spacing_mm[k] + 0.5) as f32);
        let [x, y, z] = self.planes.each_ref().map(|plane| f64::from(interpolate_bilinear(plane, px).unwrap_or(0.0)));
        self.chart.axes() * DVec3::new(x, y, z)
    }

    /// Returns the moved skin and its outward normal at a point of the chart, in the sensor's frame.
    fn skin_at(&self, at: [f64; 2]) -> (DVec3, DVec3) {
        let point = |at: [f64; 2]| self.chart.point_mm(at) + self.displacement_at(at);
        let [dx, dy] = self.spacing_mm;
        let along = point([at[0] + dx, at[1]]) - point([at[0] - dx, at[1]]);
        let down = point([at[0], at[1] + dy]) - point([at[0], at[1] - dy]);
        (point(at), along.cross(down).try_normalize().unwrap_or_else(|| self.chart.surface_frame(at).normal))
    }
}

impl Pins {
    /// Returns where the pins stand on the untouched gel's outside.
    pub(crate) fn gel_sites(&self, shape: &GelShape) -> Vec<Site> {
        let chart = Chart::at_tip(shape);
        self.at_mm.iter().map(|at| chart.surface_frame(*at).site()).collect()
    }

    /// Returns the tips on the untouched gel.
    pub fn at_rest(&self, shape: &GelShape, camera: &Projection) -> Vec<PinTip> {
        self.gel_sites(shape).iter().map(|site| self.place_tip(site.point_mm, site.normal, camera)).collect()
    }

    /// Returns the tips under a press, of pins that stand on these points of the gel.
    pub(crate) fn moved_tips(&self, sites: &[Site], motion: &SkinMotion, camera: &Projection) -> Vec<PinTip> {
        let tip = |site: &Site| {
            let at = motion.chart.locate_site(*site);
            // A pin outside a mesh's chart stays where it is.
            let (skin, axis) = if at[0].is_nan() { (site.point_mm, site.normal) } else { motion.skin_at(at) };
            self.place_tip(skin, axis, camera)
        };
        sites.iter().map(tip).collect()
    }

    /// Returns the tip of a pin that stands at a point of the skin.
    fn place_tip(&self, skin_mm: DVec3, axis: DVec3, camera: &Projection) -> PinTip {
        let at_mm = skin_mm - self.length_mm * axis;
        PinTip { at_mm, axis, px: camera.point_px(at_mm) }
    }

    /// Moves tips a little in their planes, and draws a factor on the size of each: the differences of the unit of the
    /// sensor that `random` draws.
    pub(crate) fn jitter_tips(
        &self,
        tips: &[PinTip],
        camera: &Projection,
        random: &mut RandomStream,
    ) -> (Vec<PinTip>, Vec<f64>) {
        tips.iter()
            .map(|tip| {
                let [x, y, size] = [(); 3].map(|()| random.standard_normal());
                let across = axes_across(tip.axis);
                let at_mm = tip.at_mm + self.place_jitter_mm * (x * across.x_axis + y * across.y_axis);
                let moved = PinTip { at_mm, px: camera.point_px(at_mm), ..*tip };
                (moved, (1.0 + self.size_jitter * size).max(0.0))
            })
            .unzip()
    }

    /// Renders the light of tips with these factors on their sizes, over the light of the ring; `dark` is the colour
    /// around them.
    pub(crate) fn render_light(
        &self,
        tips: &[PinTip],
        sizes: &[f64],
        camera: &Projection,
        dark: [f64; 3],
        ring: &Grid<f32>,
    ) -> Light {
        let mut cover = ring.clone();
        for (k, tip) in tips.iter().enumerate() {
            let size = sizes.get(k).copied().unwrap_or(1.0);
            draw_tip(tip, 0.5 * self.diameter_mm * size, camera, &mut cover);
        }
        let planes = dark.map(|dark| {
            let dark = dark as f32;
            cover.data.iter().map(|share| dark + share * (1.0 - dark)).collect()
        });
        Light { region: Rect::whole(cover.width, cover.height), planes }
    }

    /// Renders how much of each pixel the mount's ring covers, 0 to 1; zeros without a ring.
    pub(crate) fn render_ring_coverage(&self, camera: &Projection, [width, height]: [usize; 2]) -> Grid<f32> {
        let mut cover = Grid::new(width, height);
        let Some(MountRing { radius_mm, width_mm, below_tip_mm }) = self.mount else { return cover };
        let from_axis = |px: [f64; 2]| {
            let (from, direction) = camera.ray_at(px);
            let to_plane = (-below_tip_mm - from.z) / direction.z;
            let at = from + to_plane * direction;
            // A ray under an orthographic lens goes on behind the point that it is given by.
            (to_plane.is_finite() && (to_plane > 0.0 || direction == DVec3::Z)).then(|| libm::hypot(at.x, at.y))
        };
        for y in 0..height {
            for x in 0..width {
                let at = [x as f64 + 0.5, y as f64 + 0.5];
                let Some(here) = from_axis(at) else { continue };
                let beside = [0.5, -0.5].map(|by| from_axis([at[0] + by, at[1]]).zip(from_axis([at[0], at[1] + by])));
                let [Some((right, below)), Some((left, above))] = beside else { continue };
                let mm_per_px = libm::hypot(right - left, below - above).max(1e-9);
                let inside_px = (0.5 * width_mm - (here - radius_mm).abs()) / mm_per_px;
                cover.row_mut(y)[x] = (0.5 + inside_px).clamp(0.0, 1.0) as f32;
            }
        }
        cover
    }
}

/// Returns two directions across `axis`, and `axis` itself.
fn axes_across(axis: DVec3) -> DMat3 {
    let (x, y) = axis.any_orthonormal_pair();
    DMat3::from_cols(x, y, axis)
}

/// Draws a disc across a pin's axis: an ellipse, to first order.
fn draw_tip(tip: &PinTip, radius_mm: f64, camera: &Projection, cover: &mut Grid<f32>) {
    const STEP_MM: f64 = 1e-3;
    let Some(middle) = tip.px else { return };
    let across = axes_across(tip.axis);
    let per_mm = [across.x_axis, across.y_axis].map(|side| {
        let side_px = camera.point_px(tip.at_mm + STEP_MM * side);
        side_px.map(|px| (DVec2::from_array(px) - DVec2::from_array(middle)) * (radius_mm / STEP_MM))
    });
    let [Some(x), Some(y)] = per_mm else { return };
    let ellipse = DMat2::from_cols(x, y);
    let size_px = libm::sqrt(ellipse.determinant().abs());
    // Too small to be seen, or larger than any image, or NaN.
    if !(size_px > 1e-3 && size_px < 1e4) {
        return;
    }
    let inverse = ellipse.inverse();
    let reach = [0, 1].map(|k| libm::hypot(x[k], y[k]) + 1.0);
    let range = |k: usize, count: usize| {
        let [low, high] = [-1.0, 1.0].map(|side| (middle[k] + side * reach[k]).clamp(0.0, count as f64));
        low as usize..libm::ceil(high) as usize
    };
    for row in range(1, cover.height) {
        for column in range(0, cover.width) {
            let at = DVec2::new(column as f64 + 0.5, row as f64 + 0.5) - DVec2::from_array(middle);
            let share = 0.5 + (1.0 - (inverse * at).length()) * size_px;
            let pixel = &mut cover.row_mut(row)[column];
            *pixel = pixel.max(share.clamp(0.0, 1.0) as f32);
        }
    }
}

/// A block of nodes over which a grid is averaged.
struct NodeBlock {
    columns: Range<usize>,
    rows: Range<usize>,
}

impl NodeBlock {
    /// Makes the block of number `at` along both axes; each has `factor` nodes, but the last may have fewer.
    fn new(at: [usize; 2], factor: [usize; 2], size: [usize; 2]) -> Self {
        let range = |k: usize| at[k] * factor[k]..((at[k] + 1) * factor[k]).min(size[k]);
        Self { columns: range(0), rows: range(1) }
    }

    /// Returns the mean of a grid over the block; the grid has `border` nodes more on every side.
    fn mean<T: Copy + Default + Into<f32>>(&self, of: &Grid<T>, border: usize) -> f32 {
        let row = |y: usize| {
            of.row(y + border)[border..][self.columns.clone()].iter().map(|value| (*value).into()).sum::<f32>()
        };
        self.rows.clone().map(row).sum::<f32>() / (self.columns.len() * self.rows.len()).max(1) as f32
    }
}
