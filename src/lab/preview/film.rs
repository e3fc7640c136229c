//! Sequences as animated PNG.

use image::RgbImage;

use super::canvas::join_panels;
use super::read_frame_image;
use gelsim_dataset::archive::SampleFiles;
use gelsim_dataset::labels::SampleLabel;

/// Reads the tactile image of a frame; for a gripper those of both fingers, side by side.
fn read_film_frame(files: &SampleFiles, number: usize, both: bool) -> Result<RgbImage, String> {
    if !both {
        return read_frame_image(files, number, "");
    }
    Ok(join_panels(&[vec![read_frame_image(files, number, "left.")?, read_frame_image(files, number, "right.")?]]))
}

/// Encodes all frames of a sequence as an animated PNG, at the speed at which they were taken. None for a sample
/// without frames.
pub fn encode_animation(files: &SampleFiles) -> Result<Option<Vec<u8>>, String> {
    let label = files.find_member("json").ok_or_else(|| format!("{}.json: is not in the shard", files.key))?;
    let label = SampleLabel::read(label).map_err(|error| format!("{}.json: {error}", files.key))?;
    let Some((count, rate_hz)) = label.frames() else { return Ok(None) };
    let both = label.sensors().len() > 1;
    let first = read_film_frame(files, 0, both)?;
    let mut bytes = Vec::new();
    let said = |error: ::png::EncodingError| error.to_string();
    let mut encoder = ::png::Encoder::new(&mut bytes, first.width(), first.height());
    encoder.set_color(::png::ColorType::Rgb);
    encoder.set_animated(count, 0).map_err(said)?;
    // The format takes the time of a frame as a fraction of two 16-bit integers. 100 / (100 rate) keeps two decimals of
    // usual rates; very slow and very fast ones are in whole milliseconds.
    let (time, per_second) = match rate_hz {
        1.0..=600.0 => (100, (100.0 * rate_hz).round() as u16),
        _ => ((1e3 / rate_hz).round().clamp(1.0, 65_535.0) as u16, 1000),
    };
    encoder.set_frame_delay(time, per_second).map_err(said)?;
    let mut writer = encoder.write_header().map_err(said)?;
    for number in 0..count as usize {
        writer.write_image_data(&read_film_frame(files, number, both)?).map_err(said)?;
    }
    writer.finish().map_err(said)?;
    Ok(Some(bytes))
}
