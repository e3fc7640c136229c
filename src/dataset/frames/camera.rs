//! The depth camera of a simulator: converts its values to heights over the undeformed pad, for each pixel of the
//! sensor's view.
//!
//! The camera stands `plane_mm` below the surface of the undeformed pad, in the middle of the view, and looks outwards,
//! as the sensor's own camera does. Its columns go along x and its rows along y (docs/reference/conventions.md).

use super::heights::FrameHeights;
use super::perspective;
use gelsim_core::base::grid::Grid;
use gelsim_core::base::view::View;
use gelsim_files::diagnostic::Diagnostic;

/// Unit of the values of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DepthUnit {
    /// Metres.
    Metre,
    /// Millimetres.
    Millimetre,
    /// Micrometres.
    Micrometre,
}

impl DepthUnit {
    /// Every unit.
    pub const ALL: [Self; 3] = [Self::Metre, Self::Millimetre, Self::Micrometre];

    /// Returns the millimetres per unit.
    pub fn mm_per_unit(self) -> f64 {
        match self {
            Self::Metre => 1000.0,
            Self::Millimetre => 1.0,
            Self::Micrometre => 1e-3,
        }
    }

    /// Returns the unit's symbol, as on the command line, and its plural.
    pub fn symbol_and_plural(self) -> (&'static str, &'static str) {
        match self {
            Self::Metre => ("m", "metres"),
            Self::Millimetre => ("mm", "millimetres"),
            Self::Micrometre => ("um", "micrometres"),
        }
    }

    /// Converts `value` from this unit to mm. The result is exact where the units differ by a power of ten that floats
    /// can hold.
    fn to_mm(self, value: f64) -> f64 {
        match self {
            // 1e-3 is no binary fraction: a division rounds only once.
            Self::Micrometre => value / 1000.0,
            unit => value * unit.mm_per_unit(),
        }
    }
}

/// How the rays of the camera run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DepthProjection {
    /// Parallel: each pixel is one of the view. Inside a gel with a shape, the rays are those of the sensor's own lens.
    Orthographic,
    /// Through one point. Pixels are square.
    Perspective {
        /// Angle between the upper edge of the image and the lower one, degrees.
        fov_y_deg: f64,
    },
}

/// The line along which distances are measured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DistanceAlong {
    /// The optical axis.
    #[default]
    Axis,
    /// The pixel's own ray.
    Ray,
}

/// Where a depth camera stands and how it writes distances.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthCamera {
    /// Unit of the values.
    pub unit: DepthUnit,
    /// Distance of the undeformed pad's surface from the camera, mm; 0 if the sensor's lens says where the camera is.
    pub plane_mm: f64,
    /// Distances beyond this, mm, are empty space.
    pub max_depth_mm: Option<f64>,
    /// The value that stands for empty space.
    pub background: Option<f64>,
    /// Whether columns run from right to left, and rows from bottom to top.
    pub flip: [bool; 2],
    /// Offset of the frame, px: what belongs to a pixel is found this far to the right of it and below it, after flips.
    pub offset_px: [f64; 2],
    /// How its rays run.
    pub projection: DepthProjection,
    /// The line along which its values are distances.
    pub along: DistanceAlong,
}

impl DepthCamera {
    /// Converts a frame, as it was read, to heights. It is an error if the frame has holes, or if its rays are parallel
    /// and it does not have the size of the view.
    pub fn to_heights(&self, frame: Grid<f64>, view: &View) -> Result<FrameHeights, Diagnostic> {
        let size = [frame.width, frame.height];
        if self.projection == DepthProjection::Orthographic && size != view.resolution_px {
            let [size, view] = [size, view.resolution_px].map(|[width, height]| format!("{width}x{height}"));
            let problem = Diagnostic::new(format!("it has {size} px, and the view has {view}"));
            return Err(problem.help("all frames of a run have one size; render those of others by themselves"));
        }
        // Cameras write zero where they measured nothing, and the pad cannot be at the camera itself.
        let mut distances = self.to_distances_mm(frame, |mm| mm == 0.0 && self.plane_mm > 0.0)?;
        Ok(match self.projection {
            DepthProjection::Orthographic => {
                let shifted = shift_image(distances, self.offset_px);
                let above = |mm: f64| (mm - self.plane_mm) as f32;
                let data = shifted.data.into_iter().map(above).collect();
                FrameHeights { above_mm: Grid { width: shifted.width, height: shifted.height, data }, unseen_px: 0 }
            }
            DepthProjection::Perspective { fov_y_deg } => {
                let pinhole = perspective::PinholeGeometry::new(&distances, fov_y_deg, self.offset_px);
                if self.along == DistanceAlong::Ray {
                    pinhole.convert_to_axis_distances(&mut distances);
                }
                perspective::reproject_orthographic(&distances, &pinhole, self.plane_mm, view)
            }
        })
    }

    /// Converts a frame to distances from the camera in the order of the sensor's own pixels, mm; infinite in empty
    /// space. Holes are an error: NaN, values below any float32, and distances for which `is_hole` is true.
    pub fn to_distances_mm(&self, frame: Grid<f64>, is_hole: impl Fn(f64) -> bool) -> Result<Grid<f64>, Diagnostic> {
        let Grid { width, height, mut data } = frame;
        let farthest = self.max_depth_mm.unwrap_or(f64::INFINITY);
        let mut holes = 0;
        let mut first = None;
        for (at, value) in data.iter_mut().enumerate() {
            let mm = match self.background {
                Some(background) if is_same_value(*value, background) => f64::INFINITY,
                _ => self.unit.to_mm(*value),
            };
            // Values below any float32 would become minus infinity.
            if mm.is_nan() || mm < f64::from(f32::MIN) || is_hole(mm) {
                holes += 1;
                first.get_or_insert((at, mm));
            }
            *value = if mm > farthest { f64::INFINITY } else { mm };
        }
        let Some((at, mm)) = first else {
            let mut distances = Grid { width, height, data };
            self.undo_flip(&mut distances);
            return Ok(distances);
        };
        let (name, value) = match mm {
            mm if mm.is_nan() => ("NaN", "nan"),
            0.0 => ("0", "0"),
            mm if mm >= f64::from(f32::MIN) => ("behind the camera", ""),
            _ => ("minus infinity", "-inf"),
        };
        let (row, column) = (at / width, at % width);
        let message = match holes {
            1 => format!("1 pixel is no distance: {name} in row {row}, column {column}"),
            _ => format!("{holes} pixels are no distances; the first is {name} in row {row}, column {column}"),
        };
        let help = match value {
            "" => String::from(
                "distances count from the lens outwards; is this the frame of a camera that looks out of the gel?",
            ),
            value => format!("fill the holes; where nothing is seen, say so: --background-value={value}"),
        };
        Err(Diagnostic::new(message).help(help))
    }

    /// Undoes the flips of the image.
    fn undo_flip(&self, distances: &mut Grid<f64>) {
        let [columns, rows] = self.flip;
        let width = distances.width;
        if columns {
            distances.data.chunks_exact_mut(width).for_each(<[f64]>::reverse);
        }
        if rows {
            for y in 0..distances.height / 2 {
                let (upper, lower) = distances.data.split_at_mut((distances.height - 1 - y) * width);
                upper[y * width..][..width].swap_with_slice(&mut lower[..width]);
            }
        }
    }
}

/// Returns true if a value of a frame is the one that the user wrote. A float32 frame holds only the nearest float32 of
/// it.
fn is_same_value(value: f64, written: f64) -> bool {
    let single = f64::from(value as f32) == value;
    value == written || (single && value as f32 == written as f32) || (value.is_nan() && written.is_nan())
}

/// Shifts an image: each pixel takes the value `offset` px to the right of it and below it, bilinearly. Beyond the
/// border the border's values are repeated. A pixel is empty space if more than half of its weight is.
fn shift_image(image: Grid<f64>, offset: [f64; 2]) -> Grid<f64> {
    if offset == [0.0, 0.0] {
        return image;
    }
    let [width, height] = [image.width, image.height];
    let place = |at: usize, by: f64, size: usize| {
        let from = (at as f64 + by).clamp(0.0, (size - 1) as f64);
        let first = (from.floor() as usize).min(size.saturating_sub(2));
        [(first, 1.0 - (from - first as f64)), ((first + 1).min(size - 1), from - first as f64)]
    };
    let mut data = Vec::with_capacity(image.data.len());
    for y in 0..height {
        let rows = place(y, offset[1], height);
        for x in 0..width {
            let (mut sum, mut weights) = (0.0, 0.0);
            for (row, down) in rows {
                for (column, right) in place(x, offset[0], width) {
                    let value = image.at(column, row);
                    if value.is_finite() {
                        sum += down * right * value;
                        weights += down * right;
                    }
                }
            }
            data.push(if weights < 0.5 { f64::INFINITY } else { sum / weights });
        }
    }
    Grid { width, height, data }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAMERA: DepthCamera = DepthCamera {
        unit: DepthUnit::Millimetre,
        plane_mm: 10.0,
        max_depth_mm: None,
        background: None,
        flip: [false; 2],
        offset_px: [0.0; 2],
        projection: DepthProjection::Orthographic,
        along: DistanceAlong::Axis,
    };

    fn view(width: usize, height: usize) -> View {
        View { resolution_px: [width, height], mm_per_px: [0.1, 0.1] }
    }

    fn heights(camera: DepthCamera, width: usize, data: &[f64]) -> Vec<f32> {
        let frame = Grid { width, height: data.len() / width, data: data.to_vec() };
        let view = view(width, frame.height);
        camera.to_heights(frame, &view).map(|heights| heights.above_mm.data).unwrap_or_else(|said| panic!("{said:?}"))
    }

    #[test]
    fn a_height_is_the_distance_less_the_planes_in_every_unit() {
        let expected = [-0.5, 0.25, 40.0];
        for (unit, data) in [
            (DepthUnit::Metre, [0.0095, 0.01025, 0.05]),
            (DepthUnit::Millimetre, [9.5, 10.25, 50.0]),
            (DepthUnit::Micrometre, [9500.0, 10250.0, 50000.0]),
        ] {
            let found = heights(DepthCamera { unit, ..CAMERA }, 3, &data);
            assert!(found.iter().zip(expected).all(|(found, mm)| (found - mm).abs() < 1e-6), "{unit:?} {found:?}");
        }
    }

    #[test]
    fn nothing_is_what_is_far_what_is_infinite_and_what_the_user_says() {
        let nothing = f32::INFINITY;
        let far = DepthCamera { max_depth_mm: Some(20.0), ..CAMERA };
        assert_eq!(heights(far, 3, &[9.0, 20.0, 20.5]), [-1.0, 10.0, nothing]);
        assert_eq!(heights(CAMERA, 2, &[9.0, f64::INFINITY]), [-1.0, nothing]);
        let named = |value| DepthCamera { background: Some(value), ..CAMERA };
        assert_eq!(heights(named(0.0), 2, &[9.0, 0.0]), [-1.0, nothing]);
        assert_eq!(heights(named(f64::NAN), 2, &[9.0, f64::NAN]), [-1.0, nothing]);
        // The value as float32 has it.
        assert_eq!(heights(named(0.1), 2, &[9.0, f64::from(0.1_f32)]), [-1.0, nothing]);
        assert_eq!(heights(named(0.1), 2, &[9.0, 0.1 + 1e-12])[1], -9.9);
    }

    #[test]
    fn holes_are_counted_and_the_first_is_named() {
        let frame = Grid { width: 2, height: 2, data: vec![9.0, 9.0, f64::NAN, f64::NEG_INFINITY] };
        let problem = CAMERA.to_heights(frame, &view(2, 2)).err().expect("refused");
        assert_eq!(problem.message, "2 pixels are no distances; the first is NaN in row 1, column 0");
        assert!(problem.help.is_some_and(|help| help.contains("--background-value=nan")));
        let frame = Grid { width: 2, height: 1, data: vec![9.0, 0.0] };
        let problem = CAMERA.to_heights(frame, &view(2, 1)).err().expect("refused");
        assert_eq!(problem.message, "1 pixel is no distance: 0 in row 0, column 1");
    }

    #[test]
    fn flips_reverse_columns_and_rows() {
        let data = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0];
        let flipped = |flip| heights(DepthCamera { flip, plane_mm: 0.0, ..CAMERA }, 3, &data);
        assert_eq!(flipped([true, false]), [3.0, 2.0, 1.0, 6.0, 5.0, 4.0, 9.0, 8.0, 7.0]);
        assert_eq!(flipped([false, true]), [7.0, 8.0, 9.0, 4.0, 5.0, 6.0, 1.0, 2.0, 3.0]);
    }

    #[test]
    fn an_offset_moves_a_plane_exactly_and_nothing_stays_nothing() {
        // 10 + 2 x - y, read half a pixel further right and a quarter further up, far from the border.
        let plane = |x: f64, y: f64| 10.0 + 2.0 * x - y;
        let data: Vec<f64> = (0..25).map(|at| plane(f64::from(at % 5), f64::from(at / 5))).collect();
        let moved = heights(DepthCamera { offset_px: [0.5, -0.25], plane_mm: 0.0, ..CAMERA }, 5, &data);
        assert!((f64::from(moved[12]) - plane(2.5, 1.75)).abs() < 1e-6);
        let right = heights(DepthCamera { offset_px: [1.0, 0.0], plane_mm: 0.0, ..CAMERA }, 3, &[1.0, 2.0, 3.0]);
        assert_eq!(right, [2.0, 3.0, 3.0]);
        let gap = [1.0, f64::INFINITY, f64::INFINITY, 5.0];
        let quarter = heights(DepthCamera { offset_px: [-0.25, 0.0], plane_mm: 0.0, ..CAMERA }, 4, &gap);
        assert_eq!(quarter, [1.0, f32::INFINITY, f32::INFINITY, 5.0]);
    }
}
