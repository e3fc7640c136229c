//! Errors of a sample against a more exact one, and their means over samples.

use serde::Serialize;

use crate::metrics::{image, surface};
use gelsim_core::gelpad::elastic::model_error::ring_rms_mm;
use gelsim_job::sample::Sample;

/// Errors of one sample.
#[derive(Clone, Copy, Debug)]
pub struct SampleErrors {
    surface: surface::SurfaceError,
    image_mae: f64,
    /// Mean squared difference, grey levels squared.
    image_square: f64,
    image_ssim: f64,
    /// Relative errors of contact area and force; None if the exact sample has none or the model does not compute it.
    area: Option<f64>,
    force: Option<f64>,
    /// Error that the exact sample's own theory is expected to have, um: the largest within 2 mm of the contact, and the
    /// root mean square over the view. None if it is not known.
    model_um: Option<f64>,
    model_rms_um: Option<f64>,
    /// Intersection over union of the contact masks; None if neither touches.
    contact_iou: Option<f64>,
    /// What the model of the light is expected to leave out, grey levels; None without contact, or if it is not known.
    light_levels: Option<f64>,
}

impl SampleErrors {
    /// Compares a sample with one of a more exact level.
    pub fn new(sample: &Sample, exact: &Sample) -> Self {
        let (image, exact_image) = (&sample.impression.image, &exact.impression.image);
        let fraction = |own: f64, exact: f64| (exact > 0.0).then(|| (own - exact).abs() / exact);
        let (contact, exact_contact) = (&sample.label.contact, &exact.label.contact);
        let surface = surface::compare_surfaces(
            &sample.impression.contact.surface,
            &exact.impression.contact.surface,
            &exact.impression.contact.mask,
            sample.label.sensor.mm_per_px,
        );
        let model_um = exact.label.numerics.model_error_um;
        Self {
            surface,
            model_um,
            model_rms_um: model_um
                .map(|um| ring_rms_mm(um, 1e3 * exact.label.deepest_mm()) * surface.ring_share.sqrt()),
            image_mae: image::mae(&image.rgb, &exact_image.rgb),
            image_square: image::psnr_db(&image.rgb, &exact_image.rgb)
                .map_or(0.0, |db| 255.0 * 255.0 / 10.0_f64.powf(db / 10.0)),
            image_ssim: image::ssim(&image.rgb, &exact_image.rgb, image.width, image.height),
            area: fraction(contact.area_mm2, exact_contact.area_mm2),
            force: contact.force_n.zip(exact_contact.force_n).and_then(|(own, exact)| fraction(own, exact)),
            light_levels: sample.label.numerics.light_error_levels.filter(|_| sample.label.contact.in_contact),
            contact_iou: image::mask_iou(&sample.impression.contact.mask, &exact.impression.contact.mask),
        }
    }
}

/// Errors over several samples. Root mean squares are taken over all their pixels, maxima over all pixels; the rest are
/// means over the samples that have the figure.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct MeanErrors {
    /// Height error over the view, um, root mean square.
    pub height_rms_um: f64,
    /// Largest height error, um.
    pub height_max_um: f64,
    /// Error of the image in the contact and 1 mm around it due to what the model of the light leaves out, as labels
    /// expect it, grey levels; None if it is not known.
    pub light_error_levels: Option<f64>,
    /// Angle between the normals in the contact and within 2 mm around it, degrees: mean.
    pub normal_mean_deg: f64,
    /// Angle between these normals, degrees: 95th percentile.
    pub normal_p95_deg: f64,
    /// Angle between the normals inside the contact, degrees: mean.
    pub contact_normal_mean_deg: f64,
    /// Angle between the normals inside the contact, degrees: 95th percentile.
    pub contact_normal_p95_deg: f64,
    /// Angle between the normals within 2 mm outside the contact, degrees: mean.
    pub ring_normal_mean_deg: f64,
    /// Angle between the normals within 2 mm outside the contact, degrees: 95th percentile.
    pub ring_normal_p95_deg: f64,
    /// Mean absolute difference of the images, grey levels.
    pub image_mae: f64,
    /// Peak signal-to-noise ratio of all images together, dB; None if they are the same.
    pub image_psnr_db: Option<f64>,
    /// Structural similarity.
    pub image_ssim: f64,
    /// Error of the contact area, per cent of it.
    pub area_error_percent: Option<f64>,
    /// Error of the normal force, per cent of it; None if the model knows no force.
    pub force_error_percent: Option<f64>,
    /// Intersection over union of the contact mask and the exact one.
    pub contact_iou_mean: Option<f64>,
    /// Smallest intersection over union of all samples.
    pub contact_iou_worst: Option<f64>,
}

impl MeanErrors {
    /// Computes the means over some samples.
    pub fn from_errors<'a>(errors: impl Iterator<Item = &'a SampleErrors> + Clone) -> Self {
        let some = |of: &dyn Fn(&SampleErrors) -> Option<f64>| mean(errors.clone().filter_map(of));
        let all = |of: &dyn Fn(&SampleErrors) -> f64| some(&|error| Some(of(error))).unwrap_or(0.0);
        let known = |of: &dyn Fn(&SampleErrors) -> Option<f64>| some(of).unwrap_or(0.0);
        let square = all(&|error| error.image_square);
        let height_square = all(&|error| error.surface.height_rms_um * error.surface.height_rms_um);
        Self {
            height_rms_um: height_square.sqrt(),
            height_max_um: errors.clone().map(|error| error.surface.height_max_um).fold(0.0, f64::max),
            light_error_levels: some(&|error| error.light_levels),
            normal_mean_deg: known(&|error| Some(error.surface.near?.mean_deg)),
            normal_p95_deg: known(&|error| Some(error.surface.near?.p95_deg)),
            contact_normal_mean_deg: known(&|error| Some(error.surface.contact?.mean_deg)),
            contact_normal_p95_deg: known(&|error| Some(error.surface.contact?.p95_deg)),
            ring_normal_mean_deg: known(&|error| Some(error.surface.ring?.mean_deg)),
            ring_normal_p95_deg: known(&|error| Some(error.surface.ring?.p95_deg)),
            image_mae: all(&|error| error.image_mae),
            image_psnr_db: (square > 0.0).then(|| 10.0 * (255.0 * 255.0 / square).log10()),
            image_ssim: all(&|error| error.image_ssim),
            area_error_percent: some(&|error| error.area).map(|fraction| 100.0 * fraction),
            force_error_percent: some(&|error| error.force).map(|fraction| 100.0 * fraction),
            contact_iou_mean: some(&|error| error.contact_iou),
            contact_iou_worst: errors.clone().filter_map(|error| error.contact_iou).reduce(f64::min),
        }
    }
}

/// Error that labels expect of the exact samples' own theory, um: the largest within 2 mm of the contact, mean over the
/// samples for which it is known, and the root mean square over the view.
pub fn expected_model_um<'a>(errors: impl Iterator<Item = &'a SampleErrors> + Clone) -> [f64; 2] {
    let squares = errors.clone().filter_map(|error| error.model_rms_um).map(|um| um * um);
    [mean(errors.filter_map(|error| error.model_um)).unwrap_or(0.0), mean(squares).unwrap_or(0.0).sqrt()]
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
    (count > 0.0).then(|| sum / count)
}
