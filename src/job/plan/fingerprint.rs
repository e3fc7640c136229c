//! Computes the fingerprint of a job: a hash over everything that decides the bytes of a sample.

use crate::config::Job;
use gelsim_files::hash::sha256;
use gelsim_files::sensor::markers::MarkerDistribution;

use super::{file_stem, files};

/// Computes the SHA-256 over the resolved job and the generator's version. Of paths, only the names of meshes and
/// backgrounds count, since labels have them; contents count by their hashes. The number of samples does not count,
/// since it decides no sample's bytes and may be raised later.
pub fn compute_fingerprint(job: &Job) -> String {
    let mut job = job.clone();
    job.dataset.samples = None;
    // A dataset's job that was read and not planned has the usual pitch beside a file of dots.
    let right = job.gripper.iter_mut().filter_map(|gripper| gripper.right.as_mut()?.markers.as_mut());
    job.markers.iter_mut().chain(right).for_each(MarkerDistribution::leave_out_grid);
    let meshes = job.object.iter().map(|object| object.path.as_deref().map(file_stem)).collect::<Vec<_>>();
    let names = |paths: &mut dyn Iterator<Item = &String>| paths.map(|path| files::file_name(path)).collect::<Vec<_>>();
    let background = names(&mut job.sensor.background.iter()).pop();
    let backgrounds = names(&mut job.random.backgrounds.iter());
    let right = job.gripper.as_ref().map(|gripper| {
        let background = names(&mut gripper.right.iter().filter_map(|right| right.background.as_ref())).pop();
        (background, names(&mut gripper.right_random.backgrounds.iter()))
    });
    job.paths_mut().for_each(String::clear);
    job.sensor.background = background;
    job.random.backgrounds = backgrounds;
    if let (Some(gripper), Some((background, backgrounds))) = (&mut job.gripper, right) {
        gripper.right_random.backgrounds = backgrounds;
        gripper.right.iter_mut().for_each(|right| right.background.clone_from(&background));
    }
    for (object, stem) in job.object.iter_mut().zip(meshes) {
        object.path = stem;
        // Where meshes are found does not matter, since their hashes count.
        object.packages.clear();
    }
    let text = job.to_json().to_string();
    sha256(format!("gelsim {}\n{text}", env!("CARGO_PKG_VERSION")).as_bytes())
}
