//! Another background under the same press: image - own background + the other one.
//!
//! What a press changes in the light is added to the background image in display values, here as in the
//! simulator; so what is left of the image without its background is that change, as bright as its own LEDs made it.

use std::path::Path;

use crate::photometric::SensorProfile;
use gelsim_core::optics::background::BackgroundImage;
use gelsim_files::image_file;
use gelsim_files::input::{self, meant};
use gelsim_job::plan::check::Check;

/// What names the background that the sensor renders.
const RENDERED: &str = "rendered";

/// A background to swap in.
#[derive(Clone, Debug)]
pub struct BackgroundSwap {
    /// As the table names it.
    pub name: String,
    /// Row-major RGB: this background minus the image's own.
    difference: Vec<i16>,
}

/// Reads the pictures that the list at the dotted path `at` names; those that cannot be used are left out, and said.
pub fn read(check: &mut Check<'_>, at: &str, names: &[String], profile: &SensorProfile) -> Vec<BackgroundSwap> {
    let Some(own) = &profile.background else { return Vec::new() };
    let [width, height] = profile.view.resolution_px;
    let mut swaps = Vec::new();
    for (i, name) in names.iter().enumerate() {
        if name == RENDERED {
            swaps.push(BackgroundSwap::new(name, own, &profile.rendered().rgb));
            continue;
        }
        let key = format!("{at}.{i}");
        let path = check.document.folder(&key).join(name);
        let read = input::read(&path, input::MOST_IMAGE_BYTES).map_err(|error| error.to_string());
        match read.and_then(|bytes| image_file::decode_rgb(&bytes)) {
            Ok(picture) if [picture.width() as usize, picture.height() as usize] == [width, height] => {
                swaps.push(BackgroundSwap::new(name, own, &picture));
            }
            Ok(picture) => {
                let (w, h) = picture.dimensions();
                let message = format!("{} is {w}x{h} px, the images {width}x{height} px", path.display());
                let help =
                    "name a picture that was taken as the images were, or bring it to their size as they were brought";
                check.error(&key, message, help);
            }
            Err(reason) => {
                let message = format!("cannot read the background {}: {reason}", path.display());
                check.error(&key, message, picture_help(&path));
            }
        }
    }
    swaps
}

/// What to do about a picture of the untouched pad that could not be read.
pub fn picture_help(path: &Path) -> String {
    let near = Some(path).filter(|path| !path.exists()).and_then(|path| meant(path, image_file::is_named_like_one));
    let near = near.map(|near| format!("did you mean {}? ", path.with_file_name(near).display())).unwrap_or_default();
    format!(
        "{near}name a picture of the untouched pad ({}), or \"rendered\" for the one of a simulated sensor",
        image_file::NAMES
    )
}

impl BackgroundSwap {
    /// From the images' own background and another one's RGB, of the same size.
    pub fn new(name: &str, own: &BackgroundImage, other: &[u8]) -> Self {
        let difference = other.iter().zip(&own.rgb).map(|(other, own)| i16::from(*other) - i16::from(*own));
        Self { name: name.to_owned(), difference: difference.collect() }
    }

    /// An image's RGB as light, 1 = full scale, over this background. It may leave 0 .. 1.
    pub fn light(&self, rgb: &[u8]) -> [Vec<f32>; 3] {
        let levels = |k: usize| {
            let pixels = rgb.iter().zip(&self.difference).skip(k).step_by(3);
            pixels.map(|(level, change)| f32::from(i16::from(*level) + change) * (1.0 / 255.0)).collect()
        };
        std::array::from_fn(levels)
    }
}
