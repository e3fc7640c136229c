//! Sheets of rows of pictures: a title over each column, captions below each row.

use image::RgbImage;

use super::canvas::{CAPTION, Canvas, GAP, LETTER, scale_panels, text_width};

/// Least width of a column, px: room for the figures below a picture of a few pixels.
const NARROWEST: u32 = 28 * LETTER;
/// Most width that text makes a column take, px: longer text ends in dots.
const WIDEST: u32 = 50 * LETTER;

/// A row of a sheet.
pub struct SheetRow {
    /// Pictures from left to right.
    pub panels: Vec<RgbImage>,
    /// Captions below, each with the column where it begins; it may reach to the next one.
    pub captions: Vec<(u32, String)>,
}

impl SheetRow {
    /// Number of columns from a caption to the next one.
    fn caption_columns(&self, caption: usize, all: u32) -> u32 {
        let end = self.captions.get(caption + 1).map_or(all, |(next, _)| *next);
        end.saturating_sub(self.captions[caption].0)
    }
}

/// Draws rows one below the other under one title per column. Pictures are at most `panel_width` px wide; columns are
/// as wide as pictures and text need.
pub fn draw_row_sheet(titles: &[&str], rows: Vec<SheetRow>, panel_width: u32) -> RgbImage {
    let rows: Vec<SheetRow> =
        rows.into_iter().map(|row| SheetRow { panels: scale_panels(&row.panels, panel_width), ..row }).collect();
    let columns = titles.len() as u32;
    let widest = rows.iter().flat_map(|row| &row.panels).map(RgbImage::width).max().unwrap_or(1);
    let of_titles = titles.iter().map(|title| text_width(title));
    let of_captions = rows.iter().flat_map(|row| {
        let room = |(i, (_, text)): (usize, &(u32, String))| {
            (text_width(text) + LETTER).div_ceil(row.caption_columns(i, columns).max(1))
        };
        row.captions.iter().enumerate().map(room)
    });
    let text = of_titles.chain(of_captions).max().unwrap_or(0).min(WIDEST);
    let stride = widest.max(NARROWEST).max(text) + GAP;
    let row_height = |row: &SheetRow| row.panels.iter().map(RgbImage::height).max().unwrap_or(1) + CAPTION + GAP;
    let height = CAPTION + GAP + rows.iter().map(row_height).sum::<u32>();
    let mut canvas = Canvas::new(GAP + columns * stride, height);
    let left = |column: u32| GAP + column * stride;
    for (column, title) in (0..).zip(titles) {
        canvas.write_text(title, [left(column), 2], stride);
    }
    let mut top = CAPTION;
    for row in &rows {
        for (column, panel) in (0..).zip(&row.panels) {
            canvas.draw_panel(panel, [left(column), top]);
        }
        top += row_height(row);
        for (i, (column, text)) in row.captions.iter().enumerate() {
            canvas.write_text(text, [left(*column), top - GAP - CAPTION + 2], row.caption_columns(i, columns) * stride);
        }
    }
    canvas.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_as_wide_as_what_stands_over_and_under_them() {
        let row = |captions: Vec<(u32, String)>| SheetRow { panels: vec![RgbImage::new(10, 10); 3], captions };
        let width =
            |titles: &[&str], captions: Vec<(u32, String)>| draw_row_sheet(titles, vec![row(captions)], 640).width();
        let least = GAP + 3 * (NARROWEST + GAP);
        assert_eq!(width(&["real", "simulated", "grey"], vec![(0, "x".repeat(80))]), least);
        let title = "grey + 4 x (simulated - real)";
        assert_eq!(width(&["real", "simulated", title], vec![]), GAP + 3 * (LETTER * title.len() as u32 + GAP));
        assert!(width(&["real", "simulated", "grey"], vec![(0, "x".repeat(100))]) > least);
        assert!(width(&["real", "simulated", "grey"], vec![(0, "x".repeat(60)), (2, String::from("y"))]) > least);
        assert_eq!(width(&["a", "b", "c"], vec![(0, "x".repeat(1000))]), GAP + 3 * (WIDEST + GAP));
    }
}
