//! Tiles laid out on a sheet: headings over their columns, a caption under each.

use image::RgbImage;

use super::canvas::{CAPTION, Canvas, GAP, LETTER, SEAM, shrunk, width};
use super::panel::{Heading, Scales};
use super::{Column, Tile};

/// Height of a line of headings or beside a row, px.
const LINE: u32 = 15;
/// Letters of a caption for which a tile is made wider than its pictures.
const CAPTION_LETTERS: u32 = 60;

/// A tile whose pictures have their colours and their size.
struct Drawn {
    headings: Vec<Heading>,
    rows: Vec<DrawnRow>,
    caption: String,
}

struct DrawnRow {
    /// What stands on its left, line by line.
    label: Vec<String>,
    pictures: Vec<RgbImage>,
}

impl Drawn {
    fn new(tile: &Tile, scales: &Scales, panel_width: u32) -> Self {
        let headings = tile.columns.iter().map(|column| match column {
            Column::View(view) => Heading::of_view(*view, scales),
            Column::Frame { t_s, phase } => Heading::of_words(format!("{t_s} s {phase}")),
        });
        let rows = tile.rows.iter().map(|row| {
            let finger = row.finger.map(str::to_owned);
            let view = row.view.iter().flat_map(|view| Heading::of_view(*view, scales).lines());
            let pictures = row.panels.iter().map(|panel| shrunk(&panel.picture(scales), panel_width));
            DrawnRow { label: finger.into_iter().chain(view).collect(), pictures: pictures.collect() }
        });
        let caption = format!("{}  {}  #{}", tile.caption, tile.split.name(), tile.index);
        Self { headings: headings.collect(), rows: rows.collect(), caption }
    }

    /// Room for its rows and its caption, px.
    fn height(&self) -> u32 {
        self.rows.iter().map(|row| row.height() + SEAM).sum::<u32>() + CAPTION
    }
}

impl DrawnRow {
    fn height(&self) -> u32 {
        let pictures = self.pictures.iter().map(RgbImage::height).max().unwrap_or(1);
        pictures.max(LINE * self.label.len() as u32)
    }
}

/// Where things lie in every tile, px.
struct Frame {
    /// Room on the left for what rows show.
    margin: u32,
    /// Widths of the columns.
    columns: Vec<u32>,
}

impl Frame {
    fn around(tiles: &[Drawn]) -> Self {
        let labels = tiles.iter().flat_map(|tile| &tile.rows).flat_map(|row| &row.label);
        let margin = labels.map(|line| width(line) + LETTER).max().unwrap_or(0);
        let mut columns = Vec::new();
        let mut widen = |column: usize, width: u32| {
            columns.resize(columns.len().max(column + 1), 0);
            columns[column] = width.max(columns[column]);
        };
        for tile in tiles {
            tile.headings.iter().enumerate().for_each(|(column, heading)| widen(column, heading.width() + LETTER));
            for row in &tile.rows {
                row.pictures.iter().enumerate().for_each(|(column, picture)| widen(column, picture.width()));
            }
        }
        Self { margin, columns }
    }

    /// Left end of each column, from that of its tile on, and its width.
    fn places(&self) -> impl Iterator<Item = (u32, u32)> + '_ {
        self.columns.iter().scan(self.margin, |left, width| {
            let place = (*left, *width);
            *left += width + SEAM;
            Some(place)
        })
    }

    fn width(&self) -> u32 {
        (self.margin + self.columns.iter().map(|width| width + SEAM).sum::<u32>()).saturating_sub(SEAM)
    }

    fn write(&self, canvas: &mut Canvas, headings: &[Heading], [left, top]: [u32; 2]) {
        for ((from, room), heading) in self.places().zip(headings) {
            heading.write(canvas, [left + from, top], room);
        }
    }
}

/// Lays tiles out in rows of `columns`; pictures are made `panel_width` px wide at the most. Headings stand once over each
/// column where all tiles have the same ones, else over each tile.
pub fn sheet(tiles: &[Tile], columns: usize, panel_width: u32) -> RgbImage {
    let scales = Scales::over(tiles.iter().flat_map(Tile::panels));
    let tiles: Vec<Drawn> = tiles.iter().map(|tile| Drawn::new(tile, &scales, panel_width)).collect();
    let frame = Frame::around(&tiles);
    let captions = tiles.iter().map(|tile| width(&tile.caption).min(CAPTION_LETTERS * LETTER));
    let tile_width = captions.max().unwrap_or(0).max(frame.width()).max(1);
    let shared = tiles.windows(2).all(|pair| pair[0].headings == pair[1].headings);
    let (over_all, over_each) = if shared { (LINE, 0) } else { (0, LINE) };

    let columns = columns.clamp(1, tiles.len().max(1));
    let height = |row: &[Drawn]| over_each + row.iter().map(Drawn::height).max().unwrap_or(0) + GAP;
    let whole = GAP + over_all + tiles.chunks(columns).map(height).sum::<u32>();
    let mut canvas = Canvas::new(GAP + columns as u32 * (tile_width + GAP), whole);
    let left = |column: usize| GAP + column as u32 * (tile_width + GAP);
    if let Some(tile) = tiles.first().filter(|_| shared) {
        (0..columns).for_each(|column| frame.write(&mut canvas, &tile.headings, [left(column), GAP]));
    }
    let mut top = GAP + over_all;
    for row in tiles.chunks(columns) {
        for (column, tile) in row.iter().enumerate() {
            let left = left(column);
            if !shared {
                frame.write(&mut canvas, &tile.headings, [left, top]);
            }
            let mut y = top + over_each;
            for row in &tile.rows {
                for (line, text) in (0..).zip(&row.label) {
                    canvas.write(text, [left, y + line * LINE], frame.margin);
                }
                for ((from, _), picture) in frame.places().zip(&row.pictures) {
                    canvas.place(picture, [left + from, y]);
                }
                y += row.height() + SEAM;
            }
            canvas.write(&tile.caption, [left, y + 1], tile_width);
        }
        top += height(row);
    }
    canvas.0
}
