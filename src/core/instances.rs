//! Which object of a press the pad touches at each pixel, by [`Impression::instance_mask`], and the part of each in the
//! contact.

use crate::base::grid::Grid;
use crate::impression::Impression;

/// The part of a contact that belongs to one object.
#[derive(Clone, Debug)]
pub struct ContactPart {
    /// 255 where the pad touches the object, in the view.
    pub mask: Grid<u8>,
    /// Its largest depth below the undeformed pad in view, mm.
    pub deepest_mm: f32,
    /// Sum of the pressures on its pixels, kPa.
    pub pressure_kpa: f64,
}

/// Returns, for each pixel of the image, the number of the object that the pad touches, counted from 1; 0 if it touches
/// none. `instances` is [`Impression::instance_mask`]; `None` stands for one object.
pub fn map_instances(impression: &Impression, instances: Option<&Grid<u8>>) -> Vec<u8> {
    let mask = &impression.contact.mask;
    let data = match instances {
        None => mask.data.iter().map(|mask| u8::from(*mask != 0)).collect(),
        Some(instances) => {
            let pixels = instances.data.iter().zip(&mask.data);
            pixels.map(|(number, mask)| if *mask == 0 { 0 } else { *number }).collect()
        }
    };
    impression.in_image(&Grid { data, ..*mask }).data
}

/// Divides the contact between so many objects.
pub fn divide_contact(impression: &Impression, instances: &Grid<u8>, objects: usize) -> Vec<ContactPart> {
    let mask = &impression.contact.mask;
    let part = |number: usize| {
        let pixels = instances.data.iter().zip(&mask.data);
        let data = pixels.map(|(of, mask)| if usize::from(*of) == number { *mask } else { 0 }).collect();
        ContactPart { mask: Grid { data, ..*mask }, deepest_mm: 0.0, pressure_kpa: 0.0 }
    };
    let mut parts: Vec<ContactPart> = (1..=objects).map(part).collect();
    let pressure = impression.contact.pressure.as_ref();
    for y in 0..instances.height {
        for (x, number) in instances.row(y).iter().enumerate().filter(|(_, number)| **number > 0) {
            let part = &mut parts[usize::from(*number) - 1];
            part.deepest_mm = part.deepest_mm.max(impression.penetration_mm(x, y));
            part.pressure_kpa += pressure.map_or(0.0, |pressure| f64::from(pressure.at(x, y)));
        }
    }
    parts
}
