//! Images turned over their diagonal, so that a sweep along rows becomes one over rows.

/// Rows and columns that are turned at a time: what registers hold.
const BLOCK: usize = 8;

/// Turns an image of `width` columns: `to` gets its columns as rows. Both hold whole rows only.
#[inline(always)]
pub fn turn(from: &[f32], width: usize, to: &mut [f32]) {
    let height = from.len().checked_div(width).unwrap_or_default();
    let [whole_width, whole_height] = [width, height].map(|length| length - length % BLOCK);
    for x in (0..whole_width).step_by(BLOCK) {
        for y in (0..whole_height).step_by(BLOCK) {
            let mut block = [[0.0; BLOCK]; BLOCK];
            for (k, row) in block.iter_mut().enumerate() {
                row.copy_from_slice(&from[(y + k) * width + x..][..BLOCK]);
            }
            // Three perfect shuffles of the rows turn the block.
            for (k, row) in shuffled(shuffled(shuffled(block))).iter().enumerate() {
                to[(x + k) * height + y..][..BLOCK].copy_from_slice(row);
            }
        }
    }
    for y in 0..height {
        let first = if y < whole_height { whole_width } else { 0 };
        for x in first..width {
            to[x * height + y] = from[y * width + x];
        }
    }
}

/// The values of row k and row k + 4 in turn, as rows 2 k and 2 k + 1.
#[inline(always)]
fn shuffled(rows: [[f32; BLOCK]; BLOCK]) -> [[f32; BLOCK]; BLOCK] {
    let mut shuffled = [[0.0; BLOCK]; BLOCK];
    for k in 0..BLOCK / 2 {
        let (a, b) = (rows[k], rows[k + BLOCK / 2]);
        shuffled[2 * k] = [a[0], b[0], a[1], b[1], a[2], b[2], a[3], b[3]];
        shuffled[2 * k + 1] = [a[4], b[4], a[5], b[5], a[6], b[6], a[7], b[7]];
    }
    shuffled
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_become_rows_for_every_size() {
        for [width, height] in [[0, 0], [1, 1], [1, 9], [9, 1], [8, 8], [16, 24], [17, 31], [40, 7]] {
            let from: Vec<f32> = (0..width * height).map(|at| at as f32).collect();
            let mut to = vec![-1.0; from.len()];
            turn(&from, width, &mut to);
            for at in 0..from.len() {
                assert_eq!(to[at], from[(at % height) * width + at / height], "{width} x {height}");
            }
        }
    }
}
