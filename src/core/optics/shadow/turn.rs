//! Images turned over their diagonal, so that a sweep along rows becomes one over rows.

/// Rows that are turned at a time: what they become fills a cache line.
const ROWS: usize = 16;

/// Turns an image of `width` columns: `to` gets its columns as rows. Both hold as many values.
#[inline(always)]
pub fn turn(from: &[f32], width: usize, to: &mut [f32]) {
    let height = from.len().checked_div(width).unwrap_or_default();
    let whole = height - height % ROWS;
    for y in (0..whole).step_by(ROWS) {
        let rows: [&[f32]; ROWS] = std::array::from_fn(
            #[inline(always)]
            |k| &from[(y + k) * width..][..width],
        );
        for x in 0..width {
            let column: [f32; ROWS] = std::array::from_fn(
                #[inline(always)]
                |k| rows[k][x],
            );
            to[x * height + y..][..ROWS].copy_from_slice(&column);
        }
    }
    for y in whole..height {
        for x in 0..width {
            to[x * height + y] = from[y * width + x];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_become_rows_for_every_size() {
        for [width, height] in [[0, 0], [1, 1], [1, 9], [9, 1], [16, 16], [16, 48], [17, 31], [40, 7]] {
            let from: Vec<f32> = (0..width * height).map(|at| at as f32).collect();
            let mut to = vec![-1.0; from.len()];
            turn(&from, width, &mut to);
            for at in 0..from.len() {
                assert_eq!(to[at], from[(at % height) * width + at / height], "{width} x {height}");
            }
        }
    }
}
