//! Sheets of rows of pictures: a title over each column, text under each row.

use image::RgbImage;

use super::canvas::{CAPTION, Canvas, GAP, LETTER, scaled, width};

/// Room for the figures under a picture of a few pixels.
const NARROWEST: u32 = 28 * LETTER;
/// Room that text may make a column have, px: what is longer ends in dots.
const WIDEST: u32 = 50 * LETTER;

/// One row.
pub struct Row {
    /// Pictures from left to right.
    pub panels: Vec<RgbImage>,
    /// What stands below, each with the column at which it begins; it may reach to the next one.
    pub captions: Vec<(u32, String)>,
}

impl Row {
    /// The columns from one caption to the next.
    fn columns(&self, caption: usize, all: u32) -> u32 {
        let end = self.captions.get(caption + 1).map_or(all, |(next, _)| *next);
        end.saturating_sub(self.captions[caption].0)
    }
}

/// Lays rows out one below the other under one title per column; pictures are made `panel_width` px wide at the most.
/// Columns are as wide as pictures and text need.
pub fn sheet(titles: &[&str], rows: Vec<Row>, panel_width: u32) -> RgbImage {
    let rows: Vec<Row> = rows.into_iter().map(|row| Row { panels: scaled(&row.panels, panel_width), ..row }).collect();
    let columns = titles.len() as u32;
    let widest = rows.iter().flat_map(|row| &row.panels).map(RgbImage::width).max().unwrap_or(1);
    let of_titles = titles.iter().map(|title| width(title));
    let of_captions = rows.iter().flat_map(|row| {
        let room =
            |(i, (_, text)): (usize, &(u32, String))| (width(text) + LETTER).div_ceil(row.columns(i, columns).max(1));
        row.captions.iter().enumerate().map(room)
    });
    let text = of_titles.chain(of_captions).max().unwrap_or(0).min(WIDEST);
    let stride = widest.max(NARROWEST).max(text) + GAP;
    let row_height = |row: &Row| row.panels.iter().map(RgbImage::height).max().unwrap_or(1) + CAPTION + GAP;
    let height = CAPTION + GAP + rows.iter().map(row_height).sum::<u32>();
    let mut canvas = Canvas::new(GAP + columns * stride, height);
    let left = |column: u32| GAP + column * stride;
    for (column, title) in (0..).zip(titles) {
        canvas.write(title, [left(column), 2], stride);
    }
    let mut top = CAPTION;
    for row in &rows {
        for (column, panel) in (0..).zip(&row.panels) {
            canvas.place(panel, [left(column), top]);
        }
        top += row_height(row);
        for (i, (column, text)) in row.captions.iter().enumerate() {
            canvas.write(text, [left(*column), top - GAP - CAPTION + 2], row.columns(i, columns) * stride);
        }
    }
    canvas.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_as_wide_as_what_stands_over_and_under_them() {
        let row = |captions: Vec<(u32, String)>| Row { panels: vec![RgbImage::new(10, 10); 3], captions };
        let width = |titles: &[&str], captions: Vec<(u32, String)>| sheet(titles, vec![row(captions)], 640).width();
        let least = GAP + 3 * (NARROWEST + GAP);
        assert_eq!(width(&["real", "simulated", "grey"], vec![(0, "x".repeat(80))]), least);
        let title = "grey + 4 x (simulated - real)";
        assert_eq!(width(&["real", "simulated", title], vec![]), GAP + 3 * (LETTER * title.len() as u32 + GAP));
        assert!(width(&["real", "simulated", "grey"], vec![(0, "x".repeat(100))]) > least);
        assert!(width(&["real", "simulated", "grey"], vec![(0, "x".repeat(60)), (2, String::from("y"))]) > least);
        assert_eq!(width(&["a", "b", "c"], vec![(0, "x".repeat(1000))]), GAP + 3 * (WIDEST + GAP));
    }
}
