//! Tiles on a sheet: headings over their columns, a caption under each.

use image::RgbImage;

use super::Tile;
use super::canvas::{CAPTION, Canvas, GAP, LETTER, SEAM, shrink_panel, text_width};
use super::panel::{Heading, Scales};

/// Height of a line of headings, or of text beside a row, px.
const LINE: u32 = 15;
/// Most letters of a caption for which a tile is made wider than its pictures.
const CAPTION_LETTERS: u32 = 60;

/// A tile whose pictures are painted and scaled.
struct DrawnTile {
    headings: Vec<Heading>,
    rows: Vec<DrawnRow>,
    caption: String,
}

struct DrawnRow {
    /// Lines of text to the left of the row.
    label: Vec<String>,
    pictures: Vec<RgbImage>,
}

impl DrawnTile {
    fn new(tile: &Tile, scales: &Scales, panel_width: u32) -> Self {
        let rows = tile.rows.iter().map(|row| {
            let pictures = row.panels.iter().map(|panel| shrink_panel(&panel.to_picture(scales), panel_width));
            DrawnRow { label: row.label_lines(scales), pictures: pictures.collect() }
        });
        let caption = format!("{}  {}  #{}", tile.caption, tile.split.name(), tile.index);
        Self { headings: tile.headings(scales), rows: rows.collect(), caption }
    }

    /// Height of rows and caption, px.
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

/// Columns that all tiles share, px: they line up over the sheet.
struct TileFrame {
    /// Width of the text to the left of the rows.
    margin: u32,
    /// Widths of the columns.
    columns: Vec<u32>,
}

impl TileFrame {
    fn from_tiles(tiles: &[DrawnTile]) -> Self {
        let labels = tiles.iter().flat_map(|tile| &tile.rows).flat_map(|row| &row.label);
        let margin = labels.map(|line| text_width(line) + LETTER).max().unwrap_or(0);
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

    /// Left end of each column, from that of its tile, and its width.
    fn column_places(&self) -> impl Iterator<Item = (u32, u32)> + '_ {
        self.columns.iter().scan(self.margin, |left, width| {
            let place = (*left, *width);
            *left += width + SEAM;
            Some(place)
        })
    }

    fn width(&self) -> u32 {
        (self.margin + self.columns.iter().map(|width| width + SEAM).sum::<u32>()).saturating_sub(SEAM)
    }

    fn write_headings(&self, canvas: &mut Canvas, headings: &[Heading], [left, top]: [u32; 2]) {
        for ((from, room), heading) in self.column_places().zip(headings) {
            heading.write(canvas, [left + from, top], room);
        }
    }
}

/// Draws tiles in rows of `columns`. Pictures are at most `panel_width` px wide. If all tiles have the same headings
/// these stand once over each column, else over each tile.
pub fn draw_tile_sheet(tiles: &[Tile], columns: usize, panel_width: u32) -> RgbImage {
    let scales = Scales::from_panels(tiles.iter().flat_map(Tile::panels));
    let tiles: Vec<DrawnTile> = tiles.iter().map(|tile| DrawnTile::new(tile, &scales, panel_width)).collect();
    let frame = TileFrame::from_tiles(&tiles);
    let captions = tiles.iter().map(|tile| text_width(&tile.caption).min(CAPTION_LETTERS * LETTER));
    let tile_width = captions.max().unwrap_or(0).max(frame.width()).max(1);
    let shared = tiles.windows(2).all(|pair| pair[0].headings == pair[1].headings);
    let (over_all, over_each) = if shared { (LINE, 0) } else { (0, LINE) };

    let columns = columns.clamp(1, tiles.len().max(1));
    let height = |row: &[DrawnTile]| over_each + row.iter().map(DrawnTile::height).max().unwrap_or(0) + GAP;
    let height_px = GAP + over_all + tiles.chunks(columns).map(height).sum::<u32>();
    let mut canvas = Canvas::new(GAP + columns as u32 * (tile_width + GAP), height_px);
    let left = |column: usize| GAP + column as u32 * (tile_width + GAP);
    if let Some(tile) = tiles.first().filter(|_| shared) {
        (0..columns).for_each(|column| frame.write_headings(&mut canvas, &tile.headings, [left(column), GAP]));
    }
    let mut top = GAP + over_all;
    for row in tiles.chunks(columns) {
        for (column, tile) in row.iter().enumerate() {
            let left = left(column);
            if !shared {
                frame.write_headings(&mut canvas, &tile.headings, [left, top]);
            }
            let mut y = top + over_each;
            for row in &tile.rows {
                for (line, text) in (0..).zip(&row.label) {
                    canvas.write_text(text, [left, y + line * LINE], frame.margin);
                }
                for ((from, _), picture) in frame.column_places().zip(&row.pictures) {
                    canvas.draw_panel(picture, [left + from, y]);
                }
                y += row.height() + SEAM;
            }
            canvas.write_text(&tile.caption, [left, y + 1], tile_width);
        }
        top += height(row);
    }
    canvas.0
}
