//! Depth frames of a camera inside a gel that is not flat, at the place of the sensor's lens. Pixels become points in
//! the sensor's frame, neighbouring points become a surface, and the surface is pressed into the gel as any mesh is.
//!
//! The gel itself is not in the frame. Where a point is nearer to the camera than the gel is on the same ray, the
//! object is pressed in. Where distances jump, neighbours are not joined: what lies between them was hidden and is
//! taken to be empty.

use std::sync::Arc;

use glam::DVec3;

use super::camera::{DepthCamera, DepthProjection as Rays, DistanceAlong};
use super::check::{FrameReach, ReferenceSurface};
use gelsim_core::base::gel::{GelShape, Site};
use gelsim_core::base::grid::Grid;
use gelsim_core::camera::projection::{LensModel, Pinhole, Projection};
use gelsim_core::depth::indenter::Shape;
use gelsim_core::depth::normal_lines::START_DEPTH;
use gelsim_core::depth::seen_surface::SeenSurface;
use gelsim_core::mesh::Mesh;
use gelsim_core::mesh::clusters::Clusters;
use gelsim_core::mesh::nearest::is_hit_along;
use gelsim_core::pose::Pose;
use gelsim_core::sensor::Sensor;
use gelsim_files::diagnostic::Diagnostic;

/// Neighbours belong to two surfaces if their distances differ by more than this times their distance across the rays.
const MAX_SURFACE_SLOPE: f64 = 8.0;
/// Cosine of the largest angle to the axis at which a distance along the axis determines a point.
const MIN_COS: f64 = 0.02;
/// Most pixels of a frame. A ray is kept for each.
const MAX_PX: usize = 1 << 22;

/// A camera inside a gel, prepared for frames of one size.
pub struct InsideCamera {
    camera: DepthCamera,
    /// Whether its rays come from one place, so that nothing it sees can be behind it.
    has_place: bool,
    size_px: [usize; 2],
    shape: GelShape,
    thickness_mm: f64,
    rays: Vec<PixelRay>,
    /// For each pixel of the sensor's image that shows gel: the point of the gel, and the pixel of the frame that looks
    /// there.
    image: Vec<(Site, usize)>,
    /// Number of pixels of the image whose gel is out of the frame.
    out_of_frame_px: u64,
}

/// The ray of a pixel.
#[derive(Clone, Copy)]
struct PixelRay {
    from_mm: DVec3,
    /// Unit vector.
    direction: DVec3,
    /// Cosine of the ray's angle to the optical axis.
    cos: f64,
    /// Where the ray leaves the gel, mm along it; infinite if it misses the gel.
    gel_mm: f64,
}

/// What a frame shows.
pub struct InsideFrame<'a> {
    camera: &'a InsideCamera,
    /// Distances along the rays, mm; infinite in empty space.
    along_mm: Vec<f64>,
    /// Points near the gel or in it, in the sensor's frame.
    points_mm: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
    /// Where on the gel the object is deepest, and its point there.
    deepest: Option<(Site, DVec3)>,
    /// Whether the object reaches the edge of the frame where it is in the gel.
    is_cut: bool,
    reach: FrameReach,
}

impl InsideCamera {
    /// Prepares the camera for frames of this size, at the place of the lens of `sensor`, whose gel has the shape. It
    /// is an error if such a camera cannot see the gel.
    pub fn new(
        camera: DepthCamera,
        sensor: &Sensor,
        shape: &GelShape,
        size_px: [usize; 2],
    ) -> Result<Self, Diagnostic> {
        let [width, height] = size_px;
        if width * height > MAX_PX {
            let message = format!("it has {width}x{height} px, over {MAX_PX} in all");
            return Err(Diagnostic::new(message).help("render smaller frames"));
        }
        let looks = depth_projection(&camera, sensor, size_px)?;
        let ahead = looks.optical_axis();
        let mut sites = Vec::with_capacity(width * height);
        let ray = |at: usize| {
            let px = [0, 1].map(|k| [at % width, at / width][k] as f64 + 0.5 - camera.offset_px[k]);
            let (from_mm, direction) = looks.ray_at(px);
            let site = looks.find_exit(shape, (from_mm, direction));
            sites.push(site);
            let direction = direction.normalize();
            let gel_mm = site.map_or(f64::INFINITY, |site| (site.point_mm - from_mm).dot(direction));
            PixelRay { from_mm, direction, cos: direction.dot(ahead), gel_mm }
        };
        let rays: Vec<PixelRay> = (0..width * height).map(ray).collect();
        let slanted = rays.iter().filter(|ray| ray.gel_mm < f64::INFINITY).map(|ray| ray.cos).fold(1.0, f64::min);
        if camera.along == DistanceAlong::Axis && slanted < MIN_COS {
            let message = format!(
                "the lens sees the gel up to {:.0} degrees from its axis, where distances along the axis say nothing",
                libm::acos(slanted.max(-1.0)).to_degrees()
            );
            let help = "give distances along each pixel's own ray, with --depth-along ray";
            return Err(Diagnostic::new(message).help(help));
        }

        let of_image = sensor.projection();
        let is_image = looks == of_image && camera.offset_px == [0.0; 2];
        let [columns, rows] = sensor.resolution_px;
        let centre = |at: usize| [(at % columns) as f64 + 0.5, (at / columns) as f64 + 0.5];
        // If the frame looks through the sensor's own lens, its rays are those of the image.
        let seen =
            if is_image { sites } else { (0..columns * rows).map(|at| of_image.site(shape, centre(at))).collect() };
        let (mut image, mut out_of_frame_px) = (Vec::new(), 0);
        for site in seen.into_iter().flatten() {
            let in_frame = looks.point_px(site.point_mm).and_then(|px| {
                let at = |k: usize| px[k] + camera.offset_px[k];
                let inside = (0..2).all(|k| (0.0..size_px[k] as f64).contains(&at(k)));
                inside.then(|| at(1) as usize * width + at(0) as usize)
            });
            match in_frame {
                Some(pixel) => image.push((site, pixel)),
                None => out_of_frame_px += 1,
            }
        }
        let thickness_mm = sensor.gelpad.thickness_mm;
        let has_place = has_camera_position(&camera, sensor);
        Ok(Self { camera, has_place, size_px, shape: shape.clone(), thickness_mm, rays, image, out_of_frame_px })
    }

    /// Reads what a frame shows. It is an error if the frame has holes, another size, or points behind the camera.
    pub fn read_frame(&self, frame: Grid<f64>) -> Result<InsideFrame<'_>, Diagnostic> {
        let size = [frame.width, frame.height];
        if size != self.size_px {
            let [size, first] = [size, self.size_px].map(|[width, height]| format!("{width}x{height}"));
            let problem = Diagnostic::new(format!("it has {size} px, and the first frame has {first}"));
            return Err(problem.help("all frames of a run have one size; render those of others by themselves"));
        }
        let along_mm = self.to_ray_distances(self.camera.to_distances_mm(frame, |mm| mm <= 0.0 && self.has_place)?);
        let [width, height] = self.size_px;

        // Keep the surface only near the gel, since nothing else can touch it.
        let points: Vec<Option<DVec3>> = self.rays.iter().zip(&along_mm).map(|(ray, mm)| ray.point_at(*mm)).collect();
        let near: Vec<bool> =
            (0..points.len()).map(|at| points[at].is_some_and(|p| self.is_near_gel(at, along_mm[at], p))).collect();
        let (mut number, mut points_mm, mut triangles) = (vec![u32::MAX; points.len()], Vec::new(), Vec::new());
        for y in 1..height {
            for x in 1..width {
                let [a, b, c, d] = [[x - 1, y - 1], [x, y - 1], [x - 1, y], [x, y]].map(|[x, y]| y * width + x);
                for corners in [[a, b, c], [b, d, c]] {
                    let [Some(p), Some(q), Some(r)] = corners.map(|at| points[at]) else { continue };
                    if !corners.iter().any(|at| near[*at]) || !self.is_one_surface(corners, &along_mm) {
                        continue;
                    }
                    let mut named = [0; 3];
                    for ((to, at), point) in named.iter_mut().zip(corners).zip([p, q, r]) {
                        if number[at] == u32::MAX {
                            number[at] = points_mm.len() as u32;
                            points_mm.push(point);
                        }
                        *to = number[at];
                    }
                    triangles.push(named);
                }
            }
        }

        let mut reach = FrameReach::without_object(self.thickness_mm, self.out_of_frame_px);
        let mut deepest: Option<(Site, DVec3)> = None;
        let mut is_cut = false;
        for (at, point) in points.iter().enumerate() {
            let (ray, mm) = (&self.rays[at], along_mm[at]);
            let (Some(point), true) = (*point, ray.gel_mm < f64::INFINITY) else { continue };
            let gap_mm = mm - ray.gel_mm;
            // Inside the gel the distance to the nearest point of the skin counts, outside it the distance along the
            // ray.
            let above_mm = if gap_mm < 0.0 {
                let site = self.shape.closest(point);
                let above_mm = (point - site.point_mm).dot(site.normal);
                if above_mm < reach.lowest_mm {
                    deepest = Some((site, point));
                }
                let (x, y) = (at % width, at / width);
                is_cut |= x == 0 || y == 0 || x == width - 1 || y == height - 1;
                above_mm
            } else {
                gap_mm
            };
            reach.add_point(above_mm, ReferenceSurface::Gel { seen_mm: mm, gel_mm: ray.gel_mm });
        }
        if let Some((site, _)) = deepest {
            reach.normal = site.normal;
        }
        Ok(InsideFrame { camera: self, along_mm, points_mm, triangles, deepest, is_cut, reach })
    }

    /// Converts distances to those along the rays.
    fn to_ray_distances(&self, distances_mm: Grid<f64>) -> Vec<f64> {
        let along = |(ray, mm): (&PixelRay, f64)| match self.camera.along {
            DistanceAlong::Axis if ray.cos < MIN_COS => f64::INFINITY,
            DistanceAlong::Axis => mm / ray.cos - self.camera.plane_mm,
            DistanceAlong::Ray => mm - self.camera.plane_mm,
        };
        self.rays.iter().zip(distances_mm.data).map(along).collect()
    }

    /// Returns true if the gel can bulge up to a point that a pixel shows.
    fn is_near_gel(&self, at: usize, along_mm: f64, point: DVec3) -> bool {
        if along_mm < self.rays[at].gel_mm && self.rays[at].gel_mm < f64::INFINITY {
            return true;
        }
        match &self.shape {
            GelShape::Mesh(surface) => {
                let [low, high] = surface.bounds_mm();
                let reach = DVec3::splat(self.thickness_mm);
                point.cmpge(low - reach).all() && point.cmple(high + reach).all()
            }
            round => round.closest(point).point_mm.distance(point) <= self.thickness_mm,
        }
    }

    /// Returns true if no two of three neighbours are farther apart along the rays than a steep surface allows.
    fn is_one_surface(&self, corners: [usize; 3], along_mm: &[f64]) -> bool {
        [[0, 1], [1, 2], [2, 0]].into_iter().all(|pair| {
            let [p, q] = pair.map(|k| corners[k]);
            let nearer_mm = along_mm[p].min(along_mm[q]);
            let [a, b] = [p, q].map(|at| self.rays[at].from_mm + nearer_mm * self.rays[at].direction);
            (along_mm[p] - along_mm[q]).abs() <= MAX_SURFACE_SLOPE * a.distance(b)
        })
    }
}

impl PixelRay {
    fn point_at(&self, along_mm: f64) -> Option<DVec3> {
        along_mm.is_finite().then(|| self.from_mm + along_mm * self.direction)
    }
}

impl InsideFrame<'_> {
    /// Returns the range of the frame's heights.
    pub fn reach(&self) -> FrameReach {
        self.reach
    }

    /// Returns where on the gel the object is deepest, and its point there, mm; `None` if it does not touch.
    pub fn deepest_contact(&self) -> Option<(Site, DVec3)> {
        self.deepest
    }

    /// Returns what is seen as a shape that an object at a pose presses in.
    pub fn to_shape(&self, pose: &Pose) -> Shape {
        let back = pose.rotation.transpose();
        let in_object = |point: &DVec3| (back * (*point - pose.translation_mm)).to_array();
        let points = self.points_mm.iter().map(in_object).collect();
        let near_gel = match Mesh::new(points, self.triangles.clone()) {
            Ok((mesh, _)) => Clusters::new(&mesh),
            // No triangle has an area: no point is near the gel, or those that are lie on a line or too far from the
            // object's origin to be told apart.
            Err(_) => Clusters::empty(),
        };
        let unseen_px = self.camera.out_of_frame_px + self.count_hidden_px(&near_gel, pose);
        Shape::Seen(Arc::new(SeenSurface { near_gel, unseen_px, is_cut: self.is_cut }))
    }

    /// Counts the pixels of the image in which the object hides the gel from the camera, while nothing that is seen of
    /// it lies over the gel or in it there.
    fn count_hidden_px(&self, near_gel: &Clusters, pose: &Pose) -> u64 {
        let InsideCamera { image, rays, thickness_mm, .. } = self.camera;
        let back = pose.rotation.transpose();
        let inside_mm = START_DEPTH * thickness_mm;
        let is_hidden = |(site, pixel): &&(Site, usize)| {
            if self.along_mm[*pixel] >= rays[*pixel].gel_mm {
                return false;
            }
            let from = back * (site.point_mm - inside_mm * site.normal - pose.translation_mm);
            !is_hit_along(near_gel, from, back * site.normal, inside_mm + thickness_mm)
        };
        image.iter().filter(is_hidden).count() as u64
    }
}

/// Returns true if the rays of a camera inside `sensor` come from one place. The distances of parallel rays are counted
/// from a plane.
pub fn has_camera_position(camera: &DepthCamera, sensor: &Sensor) -> bool {
    sensor.lens != LensModel::Orthographic || camera.projection != Rays::Orthographic
}

/// Returns the lens through which a frame is taken: the sensor's own, or a pinhole in its place.
fn depth_projection(camera: &DepthCamera, sensor: &Sensor, size_px: [usize; 2]) -> Result<Projection, Diagnostic> {
    let Rays::Perspective { fov_y_deg } = camera.projection else {
        return Ok(Projection::new(&sensor.lens, size_px, sensor.field_of_view_mm));
    };
    let (position_mm, look_at_mm) = match sensor.lens {
        LensModel::Pinhole(Pinhole { position_mm, look_at_mm, .. }) => (position_mm, look_at_mm),
        LensModel::Fisheye(fisheye) => (fisheye.position_mm, fisheye.look_at_mm),
        LensModel::Orthographic => {
            let message = "the sensor's lens has parallel rays, and so no place for a perspective camera";
            return Err(Diagnostic::new(message).help("leave --projection out, and give --plane-mm"));
        }
    };
    // Turn the vertical angle of view into the horizontal one, which the lens model has.
    let half_width = libm::tan(0.5 * fov_y_deg.to_radians()) * size_px[0] as f64 / size_px[1] as f64;
    let fov_deg = 2.0 * libm::atan(half_width).to_degrees();
    Ok(Projection::new(&LensModel::Pinhole(Pinhole { fov_deg, position_mm, look_at_mm }), size_px, [1.0; 2]))
}
