//! Sheets of rows of pictures: a title over each column, text under each row.

use image::RgbImage;

use super::{CAPTION, CHARACTER, Canvas, GAP, scaled};

/// Room for the figures under a picture of a few pixels.
const NARROWEST: u32 = 28 * CHARACTER;

/// One row.
pub struct Row {
    /// Pictures from left to right.
    pub panels: Vec<RgbImage>,
    /// What stands below, each with the column at which it begins; it may reach to the next one.
    pub captions: Vec<(u32, String)>,
}

/// Lays rows out one below the other under one title per column; pictures are made `panel_width` px wide at the most.
pub fn sheet(titles: &[&str], rows: Vec<Row>, panel_width: u32) -> RgbImage {
    let rows: Vec<_> = rows.into_iter().map(|row| (scaled(&row.panels, panel_width), row.captions)).collect();
    let widest = rows.iter().flat_map(|(panels, _)| panels).map(RgbImage::width).max().unwrap_or(1);
    let stride = widest.max(NARROWEST) + GAP;
    let columns = titles.len() as u32;
    let row_height = |panels: &[RgbImage]| panels.iter().map(RgbImage::height).max().unwrap_or(1) + CAPTION + GAP;
    let height = CAPTION + GAP + rows.iter().map(|(panels, _)| row_height(panels)).sum::<u32>();
    let mut canvas = Canvas::new(GAP + columns * stride, height);
    let left = |column: u32| GAP + column * stride;
    for (column, title) in (0..).zip(titles) {
        canvas.write(title, [left(column), 2], stride);
    }
    let mut top = CAPTION;
    for (panels, captions) in &rows {
        for (column, panel) in (0..).zip(panels) {
            canvas.place(panel, [left(column), top]);
        }
        top += row_height(panels);
        for (i, (column, text)) in captions.iter().enumerate() {
            let end = captions.get(i + 1).map_or(columns, |(next, _)| *next);
            canvas.write(text, [left(*column), top - GAP - CAPTION + 2], end.saturating_sub(*column) * stride);
        }
    }
    canvas.0
}
