//! Light of LEDs at their distance from the pad: rows of points with a lobe, their images in the window, and one bounce.
//!
//! A row of LEDs is taken as a few points along it. A point of strength 1 in the middle of the image sends to a place r
//! away the light (D / r)^2 (Lambert 1760), times the cosine of the angle to its axis to the power `lobe`. Over all
//! points of an LED this is scaled to 1 in the middle of the image. A point's image in the window is one more point,
//! behind the window, which sends Fresnel's share of that ([`window`]).
//!
//! All of it varies slowly over the pad, unlike the surface's normal. So it is computed on a grid coarser than the
//! camera's: for each LED the vector L of its light, the sum over all points of strength times visible share times
//! direction. At each pixel the diffuse light is then N.L, with L interpolated. This is exact where the surface faces
//! all visible points of an LED. A highlight is that of a point in the direction of L.

use super::coarse::CoarseGrid;
use super::led::{Led, Normals};
use super::light_pattern::place_along;
use super::normals::fill_spaced_normals;
use super::phong::{Phong, Shadows};
use super::shadow::SteepestSlopes;
use crate::base::grid::{Grid, Rect, Resolution};
use crate::base::simd::simd_dispatch;
use crate::base::view::{SURFACE_BORDER, View};
use bounce::Coat;
use field::{LightField, LightPlanes};
use horizons::Horizons;
use points::{LightPoint, NearLed, PointRows};
use visible::{Hidden, VisibleShares};
use window::{ReflectedShares, Window};

pub mod bounce;
pub(crate) mod field;
pub(crate) mod horizons;
pub(crate) mod points;
pub(crate) mod visible;
pub mod window;

/// Half the range of slopes over which a shadow's border is softened, for each mm between points of the grid: nearer
/// obstacles are not resolved.
const BLUR_PER_MM: f64 = 0.16;
/// Slopes of the lowest light that casts shadows: what stands lower would shadow the whole pad.
const LOWEST_SLOPE: f64 = 0.01;

/// The LEDs of a sensor at their distances, prepared for its view.
pub(crate) struct NearLights {
    pub leds: Vec<NearLed>,
    reflected: Option<ReflectedShares>,
    /// Share of the light that the coat scatters.
    pub albedo: f64,
    casts_shadows: bool,
    /// Azimuths of the horizons.
    azimuths: usize,
    grid: CoarseGrid,
    pixel_mm: [f64; 2],
    view: View,
}

/// What a press needs besides the direct light.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Needs {
    pub shadows: bool,
    pub bounce: bool,
    /// Slopes up to this one change no light.
    pub flattest: f32,
    /// How far what stands up can change the light, mm.
    pub reach_mm: f64,
}

impl Default for Needs {
    fn default() -> Self {
        Self { shadows: false, bounce: false, flattest: f32::INFINITY, reach_mm: 0.0 }
    }
}

impl NearLights {
    pub fn new(phong: &Phong, leds: &[Led], window: Option<&Window>, coat: Coat, view: &View) -> Self {
        let leds: Vec<NearLed> =
            leds.iter().flat_map(|led| NearLed::place(led, window, phong.specular > 0.0)).collect();
        let (casts_shadows, spacing_mm, azimuths) = match phong.shadows {
            Shadows::Soft(soft) => match soft.resolution {
                Resolution::Full => (true, 0.0625, 32),
                Resolution::Half => (true, 0.125, 24),
                Resolution::Quarter => (true, 0.25, 16),
            },
            Shadows::None if coat.albedo > 0.0 => (false, 0.125, 24),
            Shadows::None => (false, 0.0625, 0),
        };
        let mut grid = CoarseGrid::with_spacing(spacing_mm, view.mm_per_px);
        while grid.inner_size(view.resolution_px).contains(&0) {
            grid.factor /= 2;
        }
        let pixel_mm = grid.pixel_size_mm(view.mm_per_px);
        Self {
            reflected: window.map(|window| ReflectedShares::new(window.refractive_index)),
            albedo: coat.albedo,
            leds,
            casts_shadows,
            azimuths,
            grid,
            pixel_mm,
            view: *view,
        }
    }

    /// Returns true if the window mirrors the LEDs.
    pub fn has_mirror(&self) -> bool {
        self.reflected.is_some()
    }

    /// Returns the bound on the change of the reflected share per unit of the cosine; 0 without a window.
    pub fn most_reflected_per_cosine(&self) -> f64 {
        self.reflected.as_ref().map_or(0.0, |reflected| reflected.most_per_cosine)
    }

    /// Returns half the range of slopes over which all shadows are softened.
    fn blur(&self) -> f64 {
        BLUR_PER_MM * 0.5 * (self.pixel_mm[0] + self.pixel_mm[1])
    }

    /// Returns a surface on the grid.
    pub fn subsample(&self, surface: &Grid<f32>) -> Grid<f32> {
        self.grid.subsample(surface)
    }

    /// Finds out what a press needs: whether anything stands high enough on the surface, which is [subsampled]
    /// (NearLights::subsample). `at_rest_mm` is the highest point of the pad at rest. With `everywhere`, all that the sensor
    /// has is needed.
    pub fn needs(&self, surface: &Grid<f32>, at_rest_mm: f32, everywhere: bool) -> Needs {
        if !self.casts_shadows && self.albedo == 0.0 {
            return Needs::default();
        }
        let steepest = SteepestSlopes::new(surface, self.pixel_mm);
        let slope =
            libm::hypot(f64::from(steepest.right.max(steepest.left)), f64::from(steepest.up.max(steepest.down)));
        // Heights are rounded to 32 bits: no shadow may be missed because of that.
        let slope = slope + 1e-5;
        // A point stands the lower, the higher the surface and the further away the place from which it is seen.
        let highest_mm = f64::from(at_rest_mm + steepest.highest_mm);
        let lowest = self.leds.iter().flat_map(|led| &led.points).map(|point| {
            let [x, y, z] = point.at_mm.map(f64::from);
            let half_mm: [f64; 2] =
                std::array::from_fn(|k| 0.5 * self.view.resolution_px[k] as f64 * self.view.mm_per_px[k]);
            let across_mm = libm::hypot(x.abs() + half_mm[0], y.abs() + half_mm[1]);
            (-z - highest_mm - f64::from(point.half_height_mm)) / across_mm
        });
        let lowest = (lowest.fold(f64::INFINITY, f64::min) - self.blur()).max(LOWEST_SLOPE);
        let steep = f64::from(bounce::FLATTEST_SLOPE);
        let (shadows, bounce) = (self.casts_shadows && slope > lowest, self.albedo > 0.0 && slope > steep);
        // By what the sensor has, not by what is needed: horizons are the same wherever they are found.
        let flattest = match (self.casts_shadows, self.albedo > 0.0) {
            (true, true) => lowest.min(steep),
            (true, false) => lowest,
            (false, _) => steep,
        };
        let reach_mm = f64::from(steepest.span_mm) / flattest;
        let has = |it: bool, needed: bool| needed || (it && everywhere);
        Needs {
            shadows: has(self.casts_shadows, shadows),
            bounce: has(self.albedo > 0.0, bounce),
            flattest: flattest as f32,
            reach_mm,
        }
    }

    /// Returns the part of the view whose light what stands in `bent` can change.
    pub fn changed_region(&self, bent: Rect, needs: Needs) -> Rect {
        let grown = |k: usize| {
            // Interpolation carries a trace further.
            let px = libm::ceil(needs.reach_mm / self.view.mm_per_px[k]) as usize;
            if needs.shadows || needs.bounce { px.saturating_add(2 * self.grid.factor) } else { 0 }
        };
        let ([x, y], [width, height]) = ([grown(0), grown(1)], self.view.resolution_px);
        Rect {
            x0: bent.x0.saturating_sub(x),
            y0: bent.y0.saturating_sub(y),
            x1: bent.x1.saturating_add(x).min(width),
            y1: bent.y1.saturating_add(y).min(height),
        }
    }

    /// Finds the horizons that a press needs in a region, on the subsampled surface.
    pub fn find_horizons(&self, surface: &Grid<f32>, region: Rect, needs: Needs) -> Horizons {
        let part = self.part_for_region(region, needs);
        Horizons::new(surface, part, self.pixel_mm, self.azimuths, needs.flattest)
    }

    /// Returns the part of the grid on which light is computed for a region.
    fn part_for_region(&self, region: Rect, needs: Needs) -> Rect {
        let size = self.view.resolution_px;
        let part = self.grid.part_for_region(size, region);
        let [inner_width, inner_height] = self.grid.inner_size(size);
        // A bounce averages light around each point.
        part.grown(if needs.bounce { bounce::radius_px(self.pixel_mm) } else { 0 }, inner_width, inner_height)
    }

    /// Finds which share of each point the places of the horizons' part see. The [subsampled](NearLights::subsample)
    /// surface has this `shape`, which may contain the relief of the pad.
    pub fn find_visible(&self, shape: &Grid<f32>, horizons: &Horizons) -> VisibleShares {
        let columns_mm = self.columns_mm(horizons.part);
        let segments = visible::segments_that_rise(horizons, &columns_mm, |y| self.grid_row(shape, horizons.part, y));
        let points: Vec<&LightPoint> = self.leds.iter().flat_map(|led| &led.points).collect();
        visible::find_visible_shares(&points, &segments, horizons, self.blur() as f32)
    }

    /// Returns the part of the view in which anything is hidden.
    pub fn hidden_region(&self, hidden: &Hidden) -> Rect {
        let (part, found) = (hidden.part, hidden.extent());
        if found.is_empty() {
            return found;
        }
        // Interpolation carries it as far as the neighbours in the grid.
        let [first_x, first_y] = self.first_pixel(part);
        let factor = self.grid.factor;
        let start = |first: usize, at: usize| (first + at * factor).saturating_sub(factor + SURFACE_BORDER);
        let end = |first: usize, at: usize, size: usize| (first + at * factor - SURFACE_BORDER + 1).min(size);
        let [width, height] = self.view.resolution_px;
        Rect {
            x0: start(first_x, found.x0),
            y0: start(first_y, found.y0),
            x1: end(first_x, found.x1, width),
            y1: end(first_y, found.y1, height),
        }
    }

    /// Computes the vectors of the LEDs' light in a region of a subsampled surface of this `shape`.
    pub fn direct_light(&self, shape: &Grid<f32>, region: Rect, needs: Needs, hidden: &Hidden) -> Vec<LightPlanes> {
        let part = self.part_for_region(region, needs);
        let dark = || std::array::from_fn(|_| vec![0.0; part.area()]);
        let mut leds: Vec<LightPlanes> = self.leds.iter().map(|_| dark()).collect();
        self.add_light(shape, part, false, hidden, &mut leds);
        leds
    }

    /// Adds the light of the LEDs' images in the window.
    pub fn add_mirrored_light(
        &self,
        shape: &Grid<f32>,
        region: Rect,
        needs: Needs,
        hidden: &Hidden,
        leds: &mut [LightPlanes],
    ) {
        self.add_light(shape, self.part_for_region(region, needs), true, hidden, leds);
    }

    /// Adds the light of the LEDs, or of their images in the window.
    fn add_light(&self, shape: &Grid<f32>, part: Rect, mirrored: bool, hidden: &Hidden, leds: &mut [LightPlanes]) {
        let (columns_mm, width) = (self.columns_mm(part), part.width());
        let reflected = self.reflected.as_ref().filter(|_| mirrored);
        let (mut rows, mut number) = (PointRows::default(), 0);
        for (led, vectors) in self.leds.iter().zip(leds) {
            for point in &led.points {
                let seen = hidden.visible.points.get(number).filter(|seen| !seen.is_empty());
                number += 1;
                if point.is_mirrored != mirrored {
                    continue;
                }
                simd_dispatch(
                    #[inline(always)]
                    || {
                        for y in 0..part.height() {
                            let (heights_mm, y_mm) = self.grid_row(shape, part, y);
                            rows.fill(point, &columns_mm, y_mm, heights_mm);
                            rows.weigh(point, reflected);
                            if let Some(seen) = seen {
                                let row = &seen[hidden.index([part.x0, part.y0 + y])..][..width];
                                rows.weight.iter_mut().zip(row).for_each(|(weight, seen)| *weight *= seen);
                            }
                            let from = [&rows.x, &rows.y, &rows.z];
                            for (plane, from) in vectors.iter_mut().zip(from) {
                                for ((sum, from), weight) in
                                    plane[y * width..][..width].iter_mut().zip(from).zip(&rows.weight)
                                {
                                    *sum += from * weight;
                                }
                            }
                        }
                    },
                );
            }
        }
    }

    /// Computes the light of one bounce, for each channel, in the light of `leds`.
    pub fn bounced_light(
        &self,
        shape: &Grid<f32>,
        region: Rect,
        needs: Needs,
        hidden: &Hidden,
        leds: &[LightPlanes],
    ) -> LightPlanes {
        let part = self.part_for_region(region, needs);
        let (width, factor) = (part.width(), self.grid.factor);
        let mut direct: LightPlanes = std::array::from_fn(|_| vec![0.0; part.area()]);
        let mut normals = Normals::default();
        let mut lit = vec![0.0; width];
        let [first_x, first_y] = self.first_pixel(part);
        let [view_width, view_height] = self.view.resolution_px;
        let columns: Vec<f32> =
            (0..width).map(|x| place_along(view_width, first_x + x * factor - SURFACE_BORDER)).collect();
        simd_dispatch(
            #[inline(always)]
            || {
                for y in 0..part.height() {
                    let row = first_y + y * factor;
                    fill_spaced_normals(self.view.mm_per_px, shape, [first_x, row], factor, width, &mut normals);
                    for (led, vectors) in self.leds.iter().zip(leds) {
                        let [to_x, to_y, to_z] = vectors.each_ref().map(|plane| &plane[y * width..][..width]);
                        let (nx, ny, nz) = (&normals.x[..width], &normals.y[..width], &normals.z[..width]);
                        for x in 0..width {
                            lit[x] = (nx[x] * to_x[x] + ny[x] * to_y[x] + nz[x] * to_z[x]).max(0.0);
                        }
                        let planes = direct.each_mut().map(|plane| &mut plane[y * width..][..width]);
                        led.color.add_to_row(
                            &lit,
                            0.0,
                            &columns,
                            place_along(view_height, row - SURFACE_BORDER),
                            planes,
                        );
                    }
                }
            },
        );
        let rows = (part.y0..part.y1).map(|y| &hidden.sky[hidden.index([part.x0, y])..][..width]);
        let sky: Vec<f32> = rows.flatten().copied().collect();
        bounce::bounce(&direct, width, &sky, self.pixel_mm, self.albedo)
    }

    /// Makes a field of the light on the grid.
    pub fn field(
        &self,
        region: Rect,
        needs: Needs,
        leds: Vec<LightPlanes>,
        bounced: Option<LightPlanes>,
    ) -> LightField {
        let (size, part) = (self.view.resolution_px, self.part_for_region(region, needs));
        let placed = |planes: LightPlanes| planes.map(|plane| self.grid.place_values(size, part, plane));
        LightField { leds: leds.into_iter().map(placed).collect(), bounced: bounced.map(placed) }
    }

    /// Computes the light on a pad at rest.
    pub fn field_at_rest(&self, shape: &Grid<f32>) -> LightField {
        let shape = &self.subsample(shape);
        let [width, height] = self.view.resolution_px;
        let (whole, needs) = (Rect::whole(width, height), Needs::default());
        let mut leds = self.direct_light(shape, whole, needs, &Hidden::default());
        self.add_mirrored_light(shape, whole, needs, &Hidden::default(), &mut leds);
        self.field(whole, needs, leds, None)
    }

    /// Returns the column and row of a surface, its border counted, on which the first place of a part lies.
    fn first_pixel(&self, part: Rect) -> [usize; 2] {
        let first = self.grid.subsampled_origin(self.view.resolution_px);
        [(part.x0, first[0]), (part.y0, first[1])].map(|(start, first)| {
            // The first pixel that is kept lies in the surface's border, or in the view.
            ((start + SURFACE_BORDER) * self.grid.factor) + (first + SURFACE_BORDER as isize) as usize
        })
    }

    /// Returns where the columns of a part are, mm from the middle of the view.
    fn columns_mm(&self, part: Rect) -> Vec<f32> {
        let first = self.first_pixel(part)[0];
        let at = |x: usize| (first + x * self.grid.factor) as f64 + 0.5 - SURFACE_BORDER as f64;
        (0..part.width()).map(|x| self.view.point_mm([at(x), 0.0])[0] as f32).collect()
    }

    /// Returns the heights of a subsampled surface from the first place of row `y` of a part on, and where that row is,
    /// mm.
    #[inline(always)]
    fn grid_row<'a>(&self, shape: &'a Grid<f32>, part: Rect, y: usize) -> (&'a [f32], f32) {
        let row = self.first_pixel(part)[1] + y * self.grid.factor;
        let at = row as f64 + 0.5 - SURFACE_BORDER as f64;
        let heights_mm = &shape.row(part.y0 + y + SURFACE_BORDER)[part.x0 + SURFACE_BORDER..][..part.width()];
        (heights_mm, self.view.point_mm([0.0, at])[1] as f32)
    }
}
