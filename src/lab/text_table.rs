//! Tables of figures for a terminal. Columns are as wide as they need to be. If they do not all fit side by side,
//! further tables with the remaining columns stand below, each with the names of its rows.

use unicode_width::UnicodeWidthStr;

/// A table: one or more lines of heads, and rows with as many cells. The first column holds names, the others figures.
pub struct TextTable {
    heads: usize,
    lines: Vec<Vec<String>>,
}

/// Space between two columns.
const GAP: &str = "  ";

impl TextTable {
    /// Creates a table with these lines of heads.
    pub fn new<'a>(heads: &[impl AsRef<[&'a str]>]) -> Self {
        let lines = heads.iter().map(|line| line.as_ref().iter().map(|cell| (*cell).to_owned()).collect()).collect();
        Self { heads: heads.len(), lines }
    }

    /// Adds a row.
    pub fn add_row(&mut self, cells: impl IntoIterator<Item = String>) {
        self.lines.push(cells.into_iter().collect());
    }

    /// Formats the table, within `columns` of a terminal where that is possible. Every line ends with a newline.
    pub fn render(&self, columns: Option<usize>) -> String {
        let count = self.lines.iter().map(Vec::len).max().unwrap_or_default();
        let width = |k: usize| {
            self.lines.iter().filter_map(|line| line.get(k)).map(|cell| cell.width()).max().unwrap_or_default()
        };
        let widths: Vec<usize> = (0..count).map(width).collect();
        let mut text = String::new();
        let mut from = 1;
        while from < count.max(2) {
            let mut until = from;
            let mut used = widths.first().copied().unwrap_or_default();
            // At least one column of figures, however narrow the terminal.
            while until < count
                && (until == from || columns.is_none_or(|columns| used + GAP.len() + widths[until] <= columns))
            {
                used += GAP.len() + widths[until];
                until += 1;
            }
            if from > 1 {
                text.push('\n');
            }
            for (at, line) in self.lines.iter().enumerate() {
                let cell = |k: usize| line.get(k).map_or("", String::as_str);
                let is_empty = cell(0).is_empty() && (from..until).all(|k| cell(k).is_empty());
                if at < self.heads && is_empty {
                    continue;
                }
                let mut row = pad_cell(cell(0), widths[0], false);
                for (k, width) in widths.iter().enumerate().take(until).skip(from) {
                    row += GAP;
                    row += &pad_cell(cell(k), *width, true);
                }
                text += row.trim_end();
                text.push('\n');
            }
            from = until.max(from + 1);
        }
        text
    }

    /// Returns true if the table has no row besides its heads.
    pub fn is_empty(&self) -> bool {
        self.lines.len() == self.heads
    }
}

fn pad_cell(cell: &str, width: usize, is_figure: bool) -> String {
    let spaces = " ".repeat(width.saturating_sub(cell.width()));
    if is_figure { spaces + cell } else { cell.to_owned() + &spaces }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_without_room_stand_below_with_the_names_again() {
        let mut table = TextTable::new(&[["level", "error", "time"], ["", "um", "ms"]]);
        assert!(table.is_empty());
        table.add_row(["high", "0.1", "40.5"].map(String::from));
        table.add_row(["low", "12.0", "3"].map(String::from));
        let wide = "level  error  time\n          um    ms\nhigh     0.1  40.5\nlow     12.0     3\n";
        assert_eq!(table.render(None), wide);
        assert_eq!(table.render(Some(18)), wide);
        let narrow = "level  error\n          um\nhigh     0.1\nlow     12.0\n\nlevel  time\n         ms\nhigh   40.5\nlow       3\n";
        assert_eq!(table.render(Some(17)), narrow);
        assert_eq!(table.render(Some(3)), narrow);
        let mut named = TextTable::new(&[["face", "relief", "anchor"], ["", "mm", ""]]);
        named.add_row(["-z", "0.50", "bounds"].map(String::from));
        let lines = "face  relief\n          mm\n-z      0.50\n\nface  anchor\n-z    bounds\n";
        assert_eq!(named.render(Some(12)), lines, "a line of heads without any is left out");
        assert!(!table.is_empty());
    }
}
