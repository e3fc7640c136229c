//! Light that pixels of a surface throw at each other, one bounce of it, by the sum over all pairs of pixels.

use gelsim_core::base::view::View;
use gelsim_core::gelpad::Contact;
use gelsim_core::optics::normals::surface_normals;

use super::vectors::{Vector, dot};

/// What each pixel gets of what all others give back of `light`, a share of `albedo`.
pub fn bounced_from_all(camera: &View, contact: &Contact, light: &[[f64; 3]], albedo: f64) -> Vec<[f64; 3]> {
    let surface = contact.surface.inner(1);
    let normals: Vec<[f64; 3]> = surface_normals(contact, camera).into_iter().map(|n| n.map(f64::from)).collect();
    let width = camera.resolution_px[0];
    let places: Vec<[f64; 3]> = (0..light.len())
        .map(|at| {
            let [x, y] = camera.point_mm([(at % width) as f64 + 0.5, (at / width) as f64 + 0.5]);
            // Towards the camera is down.
            [x, y, -f64::from(surface.data[at])]
        })
        .collect();
    let pixel_mm2 = camera.mm_per_px[0] * camera.mm_per_px[1];
    let to = |here: usize| {
        let mut sum = [0.0; 3];
        for there in (0..light.len()).filter(|there| *there != here) {
            let way: Vector = std::array::from_fn(|k| places[there][k] - places[here][k]);
            let (arrives, leaves) = (dot(normals[here], way), -dot(normals[there], way));
            if arrives > 0.0 && leaves > 0.0 {
                let square = dot(way, way);
                // A steep pixel has more area than it shows.
                let area = pixel_mm2 / -normals[there][2];
                let share = albedo * arrives * leaves * area / (std::f64::consts::PI * square * square);
                (0..3).for_each(|k| sum[k] += share * light[there][k]);
            }
        }
        sum
    };
    (0..light.len()).map(to).collect()
}
