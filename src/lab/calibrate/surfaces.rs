//! Writes the pad's surface under each press of a calibration: labels for real images.
//!
//! A folder holds `surfaces.json`, which names the layers with shape and unit and the files of each press. For each
//! press it holds `surface.npy`, `normal.npy` and `contact.png`, each under nine digits, as datasets do.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::{Geometry, Observation, PressSurfaces, Session};
use gelsim_core::base::grid::Resolution;
use gelsim_core::base::view::SURFACE_BORDER;
use gelsim_core::gelpad::elastic::Elastic;
use gelsim_core::gelpad::{Contact, Model};
use gelsim_core::optics::normals::surface_normals;
use gelsim_dataset::encode::to_json_line;
use gelsim_files::diagnostic::{Report, user_error};
use gelsim_files::write::write_folder_atomically;
use gelsim_files::{npy, png};
use gelsim_job::label::{GENERATOR, sample_key};
use gelsim_job::layers::{DepthFormat, LayerForm, OutputLayer};

/// Name of the file that lists the others.
pub const INDEX_FILE: &str = "surfaces.json";

/// Layers that are written for each press.
const LAYERS: [OutputLayer; 3] = [OutputLayer::Surface, OutputLayer::Normal, OutputLayer::Contact];

/// Content of the file [`INDEX_FILE`].
#[derive(Debug, Serialize)]
struct Index {
    surfaces_version: u32,
    generator: &'static str,
    resolution_px: [usize; 2],
    mm_per_px: [f64; 2],
    gelpad_thickness_mm: f64,
    contact_over_disc: f64,
    layers: Vec<Layer>,
    presses: Vec<Press>,
}

/// A layer; all presses have it.
#[derive(Debug, Serialize)]
struct Layer {
    name: &'static str,
    ending: &'static str,
    /// Rows, columns, and the number of values per pixel if there are several.
    shape: Vec<usize>,
    dtype: &'static str,
    unit: Option<&'static str>,
    meaning: &'static str,
}

/// A press and its files, in the order of the layers.
#[derive(Debug, Serialize)]
struct Press {
    image: String,
    centre_px: [f64; 2],
    disc_radius_px: f64,
    ball_radius_mm: f64,
    depth_mm: f64,
    /// True if the ball cannot make so large a disc. The surface is that of the deepest press.
    too_large: bool,
    files: Vec<String>,
}

fn layer_file_name(number: usize, layer: OutputLayer) -> String {
    format!("{}.{}", sample_key(number as u64), layer.file_suffix(DepthFormat::Npy))
}

/// Returns true for the name of a file that this module writes.
fn is_ours(name: &str) -> bool {
    let of_layer = |layer: &OutputLayer| {
        let number = name.strip_suffix(&format!(".{}", layer.file_suffix(DepthFormat::Npy)));
        number.is_some_and(|number| number.len() == 9 && number.bytes().all(|byte| byte.is_ascii_digit()))
    };
    name == INDEX_FILE || LAYERS.iter().any(of_layer)
}

/// Refuses a folder that cannot be written, or that holds files which would be lost. Allowed are a folder that does not
/// exist, an empty one, and one of an earlier run.
pub fn check_folder(root: &Path) -> Result<(), Report> {
    let another = "choose a new or empty folder with --surfaces";
    let refused = |message: String| Err(user_error(message, another));
    let shown = root.display();
    if let Some(file) = root.ancestors().skip(1).find(|above| above.is_file()) {
        return refused(format!("{} is no folder", file.display()));
    }
    match root.symlink_metadata() {
        Err(error) if error.kind() == io::ErrorKind::NotFound => {}
        Err(error) => return refused(format!("{shown}: {error}")),
        Ok(meta) if !meta.is_dir() => return refused(format!("{shown} is not a folder")),
        Ok(_) => {
            let entries = fs::read_dir(root).and_then(Iterator::collect::<io::Result<Vec<_>>>);
            let entries = entries.map_err(|error| user_error(format!("{shown}: {error}"), another))?;
            let other = entries.iter().find(|entry| {
                let is_file = entry.file_type().is_ok_and(|kind| kind.is_file());
                !is_file || !entry.file_name().to_str().is_some_and(is_ours)
            });
            if let Some(other) = other {
                return refused(format!("{} is in the folder, and is no surface", other.path().display()));
            }
        }
    }
    match root.file_name() {
        Some(_) => Ok(()),
        None => refused(format!("{shown} cannot be the folder of the surfaces")),
    }
}

/// Writes the surfaces of a session's presses, in place of those that are there. The error names the path that it is
/// about.
pub fn write_surfaces(session: &Session, geometry: Geometry, root: &Path) -> Result<(), (PathBuf, io::Error)> {
    // These are labels, and written once: the full grid is worth its time.
    let full = Model::Elastic(Elastic { resolution: Resolution::Full, ..Elastic::default() });
    let surfaces = session.press_surfaces(geometry, &full);
    let index = build_index(session, geometry, &surfaces);
    let index = (String::from(INDEX_FILE), [to_json_line(&index).as_slice(), b"\n"].concat());
    let files = surfaces.contacts.iter().enumerate().flat_map(|(number, contact)| {
        LAYERS.map(|layer| (layer_file_name(number, layer), encode_layer(session, contact, layer)))
    });
    // The index comes last, so that every file it names exists by then.
    write_folder_atomically(root, files.chain([index]))
}

fn build_index(session: &Session, geometry: Geometry, surfaces: &PressSurfaces) -> Index {
    let [width, height] = session.camera.resolution_px;
    let layer = |layer: OutputLayer| {
        let spec = layer.spec();
        let values = spec.form.values_per_px().filter(|count| *count > 1);
        Layer {
            name: spec.name,
            ending: layer.coding_for(DepthFormat::Npy).extension(),
            shape: [height, width].into_iter().chain(values).collect(),
            dtype: if matches!(spec.form, LayerForm::Floats { .. }) { "float32" } else { "uint8" },
            unit: spec.unit,
            meaning: spec.meaning,
        }
    };
    let depths = surfaces.depths_mm.iter().zip(&surfaces.too_large);
    let press = |(number, (observation, (depth_mm, too_large))): (usize, (&Observation, (&f64, &bool)))| Press {
        image: observation.file.clone(),
        centre_px: observation.circle.centre_px,
        disc_radius_px: observation.circle.radius_px,
        ball_radius_mm: observation.ball_radius_mm,
        depth_mm: *depth_mm,
        too_large: *too_large,
        files: LAYERS.map(|layer| layer_file_name(number, layer)).to_vec(),
    };
    let presses = session.observations.iter().zip(depths).enumerate().map(press).collect();
    Index {
        surfaces_version: 1,
        generator: GENERATOR,
        resolution_px: [width, height],
        mm_per_px: session.camera.mm_per_px,
        gelpad_thickness_mm: geometry.thickness_mm,
        contact_over_disc: geometry.contact_over_disc,
        layers: LAYERS.into_iter().map(layer).collect(),
        presses,
    }
}

fn encode_layer(session: &Session, contact: &Contact, layer: OutputLayer) -> Vec<u8> {
    let [width, height] = session.camera.resolution_px;
    match layer {
        OutputLayer::Normal => {
            let normals = surface_normals(contact, &session.camera);
            let plane = |k: usize| normals.iter().map(|normal| normal[k]).collect();
            let planes: [Vec<f32>; 3] = [plane(0), plane(1), plane(2)];
            npy::encode(width, height, &planes.each_ref().map(Vec::as_slice))
        }
        OutputLayer::Contact => png::encode_grey(width, height, &contact.mask.data),
        _ => npy::encode(width, height, &[&contact.surface.inner(SURFACE_BORDER).data]),
    }
}
