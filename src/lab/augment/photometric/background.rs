//! Swaps the background under a press: image - own background + other background.
//!
//! As in the simulator, a press adds its change of light to the background image in display values. So the image
//! without its background is that change, as bright as the sensor's own LEDs made it.

use std::path::Path;

use crate::photometric::SensorProfile;
use gelsim_core::optics::background::{BackgroundChange, BackgroundImage};
use gelsim_files::image_file;
use gelsim_files::input::{self, suggest_file_name};
use gelsim_job::plan::check::JobChecker;

/// Name that means the background which the sensor renders.
const RENDERED: &str = "rendered";

/// A background to swap in.
#[derive(Clone, Debug)]
pub struct BackgroundSwap {
    /// Name in the table.
    pub name: String,
    /// Change from the image's own background to this one.
    pub change: BackgroundChange,
}

/// Reads the pictures that the list at the dotted path `at` names. Those that cannot be used are reported and left out.
pub fn read_swaps(
    check: &mut JobChecker<'_>,
    at: &str,
    names: &[String],
    profile: &SensorProfile,
) -> Vec<BackgroundSwap> {
    let Some(own) = &profile.background else { return Vec::new() };
    let [width, height] = profile.view.resolution_px;
    let mut swaps = Vec::new();
    for (i, name) in names.iter().enumerate() {
        if name == RENDERED {
            swaps.push(BackgroundSwap::new(name, own, &profile.render_background().rgb));
            continue;
        }
        let key = format!("{at}.{i}");
        let path = check.document.folder_of(&key).join(name);
        let read = input::read(&path, input::MAX_IMAGE_BYTES).map_err(|error| error.to_string());
        match read.and_then(|bytes| image_file::decode_rgb(&bytes)) {
            Ok(picture) if [picture.width() as usize, picture.height() as usize] == [width, height] => {
                swaps.push(BackgroundSwap::new(name, own, &picture));
            }
            Ok(picture) => {
                let (w, h) = picture.dimensions();
                let message = format!("{} is {w}x{h} px, the images {width}x{height} px", path.display());
                let help =
                    "name a picture that was taken as the images were, or bring it to their size as they were brought";
                check.report_error(&key, message, help);
            }
            Err(reason) => {
                let message = format!("cannot read the background {}: {reason}", path.display());
                check.report_error(&key, message, picture_help(&path));
            }
        }
    }
    swaps
}

/// Returns what to do about a picture of the untouched pad that could not be read.
pub fn picture_help(path: &Path) -> String {
    let near = Some(path)
        .filter(|path| !path.exists())
        .and_then(|path| suggest_file_name(path, image_file::has_image_extension));
    let near = near.map(|near| format!("did you mean {}? ", path.with_file_name(near).display())).unwrap_or_default();
    format!(
        "{near}name a picture of the untouched pad ({}), or \"rendered\" for the one of a simulated sensor",
        image_file::FORMAT_NAMES
    )
}

impl BackgroundSwap {
    /// Creates a swap from the images' own background and the RGB of another one of the same size.
    pub fn new(name: &str, own: &BackgroundImage, other: &[u8]) -> Self {
        Self { name: name.to_owned(), change: BackgroundChange::new(own, other) }
    }
}
