//! The one place where the physics tests call the crate's stages, and what they build for them: meshes, poses,
//! surfaces, lights. When a stage's signature changes, this file changes.

use std::path::{Path, PathBuf};

use gelsim_core::base::grid::{Grid, Rect, bounding_box};
use gelsim_core::base::light::Light;
use gelsim_core::base::view::SURFACE_BORDER;
use gelsim_core::base::view::View;
use gelsim_core::camera::Image;
use gelsim_core::depth::raster::{Canvas, OrthographicProjection};
use gelsim_core::depth::{self, CaptureWindow, Depth};
use gelsim_core::effects::{EffectLog, EffectPolicy};
use gelsim_core::gelpad::mean_blur::{self, MeanBlur};
use gelsim_core::gelpad::{self, Contact, Numerics, Pad};
use gelsim_core::mesh::clusters::Clusters;
use gelsim_core::optics::background::BackgroundImage;
use gelsim_core::optics::led::Led;
use gelsim_core::optics::phong::{Phong, Shadows};
use gelsim_core::optics::{self, Shader};
use gelsim_core::pose::Placement;
use gelsim_dataset::encode;
use gelsim_files::sensor::Sensor;
use gelsim_job::plan::Plan;
use gelsim_job::sample::Sample;

/// Every bundled mesh of a sensor's size, by name: slabs are wider than any.
pub fn bundled_objects() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("objects");
    let entries = std::fs::read_dir(folder).expect("the repository has objects/");
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.expect("a readable folder").path()).collect();
    paths.retain(|path| path.extension().is_some_and(|extension| extension == "obj"));
    paths.retain(|path| !path.file_stem().is_some_and(|stem| stem.to_string_lossy().ends_with("slab")));
    paths.sort();
    assert!(paths.len() >= 20, "{} objects", paths.len());
    paths
}

pub fn capture(object: &Clusters, placement: &Placement, camera: &View, margin_px: usize, thickness: f64) -> Depth {
    depth::capture_mesh(object, placement, camera, CaptureWindow { margin_px, above_mm: 0.0 }, thickness)
}

/// The rasteriser as this test binary compiles it, without the wide instructions that [`capture`] picks at run time.
/// Heights over the pad, cut at 0.
pub fn raster_without_dispatch(object: &Clusters, placement: &Placement, camera: &View, margin: usize) -> Grid<f32> {
    let [width, height] = camera.resolution_px.map(|px| px + 2 * margin);
    let mut heights = Grid::new(width, height);
    let view = OrthographicProjection::new(placement, camera, object.centre_mm());
    depth::raster::rasterise(object, &view, Canvas { width, height, ceiling: 0.0, margin }, &mut heights);
    heights
}

/// The part of a depth map that is in view.
pub fn in_view(depth: &Depth) -> Grid<f32> {
    depth.below_pad()
}

/// A depth map made by hand.
pub fn depth_of(penetration: Grid<f32>, margin_px: usize) -> Depth {
    let touching = bounding_box(&penetration, |mm| mm > 0.0);
    let mut depth = Depth { penetration, margin_px, touching, deepest_mm: 0.0, over_thickness_px: 0 };
    depth.deepest_mm = deepest_in_view(&depth);
    depth
}

/// The largest depth in view, found the plain way.
pub fn deepest_in_view(depth: &Depth) -> f32 {
    in_view(depth).data.iter().fold(0.0, |deepest, mm| mm.max(deepest))
}

pub fn press(blur: MeanBlur, depth: &Depth) -> Contact {
    Pad::MeanBlur(blur).press(depth)
}

/// Pixels of margin that [`press`] asks for.
pub fn margin_of(blur: MeanBlur) -> usize {
    Pad::MeanBlur(blur).capture_window(0.0).margin_px
}

/// The blur as this test binary compiles it.
pub fn blur_without_dispatch(image: &Grid<f32>, blur: MeanBlur) -> Grid<f32> {
    let whole = Rect::whole(image.width, image.height);
    mean_blur::mean_blur(image, whole, blur.kernel_px as usize, blur.passes as usize)
}

/// Where the middle of a pixel is, mm, in the contract's frame; pixels of a border count from -1.
pub fn position(camera: &View, column: f64, row: f64) -> [f64; 2] {
    let at = [column, row];
    std::array::from_fn(|k| (at[k] + 0.5 - camera.resolution_px[k] as f64 / 2.0) * camera.mm_per_px[k])
}

/// A pad whose displacement at a place (mm) is `surface`; nowhere in contact.
pub fn contact_of(camera: &View, surface: impl Fn([f64; 2]) -> f64) -> Contact {
    let [width, height] = camera.resolution_px;
    let border = SURFACE_BORDER as f64;
    let numerics = Numerics::DIRECT;
    let mut contact = gelpad::no_contact(width, height, None, numerics);
    for y in 0..contact.surface.height {
        for x in 0..contact.surface.width {
            let place = position(camera, x as f64 - border, y as f64 - border);
            contact.surface.row_mut(y)[x] = surface(place) as f32;
        }
    }
    contact.region = Rect::whole(contact.surface.width, contact.surface.height);
    contact
}

pub fn normals(contact: &Contact, camera: &View) -> Vec<[f32; 3]> {
    optics::normals::surface_normals(contact, camera)
}

/// The camera of a sensor.
pub fn camera_of(sensor: &Sensor) -> View {
    let resolution_px = sensor.resolution_px.map(|px| px as usize);
    let mm_per_px = std::array::from_fn(|k| sensor.field_of_view_mm[k] / f64::from(sensor.resolution_px[k]));
    View { resolution_px, mm_per_px }
}

/// A sensor with `led` as its lights.
pub fn sensor(resolution_px: [u32; 2], mm_per_px: f64, led: Vec<Led>) -> Sensor {
    let field_of_view_mm = resolution_px.map(|px| f64::from(px) * mm_per_px);
    Sensor { resolution_px, field_of_view_mm, led, ..Sensor::default() }
}

/// A white LED of intensity 1.
pub fn led(azimuth_deg: f64, elevation_deg: f64) -> Led {
    Led { name: String::from("one"), azimuth_deg, elevation_deg, color: [1.0; 3], intensity: 1.0, ..Led::default() }
}

/// A background of one grey level.
pub fn grey(camera: &View, level: u8) -> BackgroundImage {
    let [width, height] = camera.resolution_px;
    BackgroundImage::new(width, height, vec![level; width * height * 3])
}

/// The light of a model; where the press does not change it, the picture's own.
pub fn light_of(model: &optics::Model, sensor: &Sensor, contact: &Contact, rest: &BackgroundImage) -> Light {
    let shader = Shader::new(model, None, &sensor.illumination(), &camera_of(sensor), None);
    shader.shade(contact, rest, &mut EffectLog::new(EffectPolicy::WhereNeeded)).into_light()
}

/// The same without shadows.
pub fn shade(phong: Phong, sensor: &Sensor, contact: &Contact, rest: &BackgroundImage) -> Light {
    light_of(&optics::Model::Phong(Phong { shadows: Shadows::None, ..phong }), sensor, contact, rest)
}

/// Red, green and blue at a pixel, 1 = full scale.
pub fn light_at(light: &Light, rest: &BackgroundImage, x: usize, y: usize) -> [f64; 3] {
    let Rect { x0, y0, x1, y1 } = light.region;
    if (x0..x1).contains(&x) && (y0..y1).contains(&y) {
        let at = (y - y0) * light.region.width() + x - x0;
        std::array::from_fn(|k| f64::from(light.planes[k][at]))
    } else {
        std::array::from_fn(|k| f64::from(rest.rgb[(y * rest.width + x) * 3 + k]) / 255.0)
    }
}

pub fn expose(light: &Light, rest: &BackgroundImage) -> Image {
    let mut image = Image::black(rest.width, rest.height);
    image.rgb.copy_from_slice(&rest.rgb);
    image.saturated_px = rest.saturated_px;
    image.quantise(light);
    image
}

/// The bytes of a sample's member, as it stands in a shard.
pub fn member(plan: &Plan, sample: &Sample, suffix: &str) -> Vec<u8> {
    let members = encode::encode_members(plan, sample);
    let found = members.into_iter().find(|member| member.suffix == suffix);
    found
        .map(|member| member.bytes.into_vec().expect("in memory"))
        .unwrap_or_else(|| panic!("the sample has no {suffix}"))
}
