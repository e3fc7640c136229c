//! Walls of the object between the pixels of the solver's grid.
//!
//! Only a part of a pixel that a wall cuts is pressed. If the position of its centre decided, a wall that runs askew to
//! a coarse grid would be a staircase, and the pad beside it would show saw-teeth. So a pixel of which the fraction c
//! is covered counts as pressed, but compliant: under its pressure p it stays a p (1 - c) / c short of the object, as
//! if on a spring, with a = 0.911 (2 / E') times the pixel size. Pressures that are even in each pixel act as if the
//! object ended 0.18 pixels before its wall, whichever way that runs. So c is that of an object larger by 0.18 pixels,
//! whose face goes on as it ends at the wall. Then the pad beside a rigid flat punch moves as much as the punch's edge
//! to within 0.013 of a pixel (Sadowsky's closed form; `tests/physics/walls.rs`).
//!
//! On the camera's own grid only the centres of pixels are known. There a pixel is stiffer that ends a flat face at a
//! wall, because its pressure is highest at the wall and moves its centre less than an even one would. Edges are right to
//! within 0.06 of a pixel, apart from the half pixel by which the wall is not known. A rounded edge, whose pressure is
//! not highest at the wall, stays as it is.

/// Compliance of an edge, in pixel sizes times 2 / E'.
pub const EDGE_COMPLIANCE: f32 = 0.911;

/// Displacement of a square pixel's centre under its own pressure, in pixel sizes times 2 / E'.
pub const SQUARE_COMPLIANCE: f32 = 0.561;

/// Compression, as a share of the wall's height, from which on the part beside a wall is pressed in full.
const PRESSED_BESIDE: f32 = 0.25;

/// A stopped pixel is freed where its pressure would compress it by less than this share of the limit.
const FREED_BELOW: f32 = 0.98;

/// Number of stops and frees after which a pixel is not freed again: rounding could go on for ever.
const MOST_CHANGES: u8 = 6;

/// A pixel of the solver's grid that a wall cuts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PartialPixel {
    /// Column and row.
    pub at: [usize; 2],
    /// Compression under pressure 1 at Young's modulus 1, mm.
    pub compliance: f32,
    /// Largest compression, mm: then the part beside the wall is pressed too, and the pixel is as deep as the object on
    /// average.
    max_compression_mm: f32,
    /// How much lower than the covered part the object is at the pixel's centre, mm.
    centre_drop_mm: f32,
    /// The covered share of what lies at the pixel's centre, 0 to 1.
    centre_covered: f32,
    /// True if the largest compression is reached; it then stays constant.
    pub is_stopped: bool,
    /// Stops and frees that are left of [`MOST_CHANGES`].
    changes_left: u8,
}

impl PartialPixel {
    /// Makes a pixel that is covered whole and ends at a wall.
    pub fn at_edge(at: [usize; 2], compliance: f32) -> Self {
        Self {
            at,
            compliance,
            max_compression_mm: 0.0,
            centre_drop_mm: 0.0,
            centre_covered: 1.0,
            is_stopped: false,
            changes_left: MOST_CHANGES,
        }
    }

    /// Makes a pixel that a wall cuts.
    pub fn cut(
        at: [usize; 2],
        compliance: f32,
        max_compression_mm: f32,
        centre_drop_mm: f32,
        centre_covered: f32,
    ) -> Self {
        Self { max_compression_mm, centre_drop_mm, centre_covered, ..Self::at_edge(at, compliance) }
    }

    /// Returns how far below the penetration the pixel is under a pressure, mm.
    pub fn compression_mm(&self, pressure: f32) -> f32 {
        if self.is_stopped { self.max_compression_mm } else { self.compliance * pressure }
    }

    /// Returns the share of what lies at the pixel's centre that is pressed under a pressure.
    pub fn pressed_centre_share(&self, pressure: f32) -> f32 {
        self.centre_covered + (1.0 - self.centre_covered) * self.pressed_beside_share(pressure)
    }

    /// Returns the share of the part beside the wall that is pressed: 0 where the pixel just stops, 1 where its pressure
    /// would compress it by a part of the wall's height more.
    fn pressed_beside_share(&self, pressure: f32) -> f32 {
        let past = self.compliance * pressure - self.max_compression_mm;
        let height_mm = self.max_compression_mm.max(PRESSED_BESIDE * self.centre_drop_mm.abs());
        match self.is_stopped {
            // Also holds for a wall without height.
            true if past >= height_mm => 1.0,
            true => (past / height_mm).max(0.0),
            false => 0.0,
        }
    }

    /// Returns how far below the penetration the pad is at a stopped pixel's centre, mm: as far as the object there,
    /// once that part is pressed.
    pub fn settled_mm(&self, pressure: f32) -> f32 {
        self.max_compression_mm + self.pressed_beside_share(pressure) * (self.centre_drop_mm - self.max_compression_mm)
    }

    /// Estimates the pixel's pressure as a share of the next pixel's, farther from the wall: roughly that at the edge
    /// of a punch. `own` is the displacement of a stiff pixel under its own pressure 1, mm.
    pub fn pressure_share(&self, own: f32) -> f32 {
        let c = 1.0 / (1.0 + self.compliance * SQUARE_COMPLIANCE / (EDGE_COMPLIANCE * own));
        0.9 * c * (1.0 + c)
    }

    /// Returns the compression under pressure 1 that is not at its limit, mm.
    pub fn spring(&self) -> f32 {
        if self.is_stopped { 0.0 } else { self.compliance }
    }

    /// Takes over whether the same pixel of another box is stopped.
    pub fn take_state(&mut self, other: &Self) {
        (self.is_stopped, self.changes_left) = (other.is_stopped, other.changes_left);
    }

    /// Stops the compression where the pressure exceeds its limit, and frees it again where the pressure is below; returns
    /// by how much the penetration changes, mm, if it does.
    pub fn stop_or_free(&mut self, pressure: f32) -> Option<f32> {
        let wanted = self.compliance * pressure;
        let changes = match self.is_stopped {
            // A little less, as pressures are known within the tolerance.
            true => wanted < FREED_BELOW * self.max_compression_mm && self.changes_left > 0,
            false => wanted > self.max_compression_mm,
        };
        if !changes {
            return None;
        }
        self.is_stopped ^= true;
        self.changes_left = self.changes_left.saturating_sub(1);
        Some(if self.is_stopped { -self.max_compression_mm } else { self.max_compression_mm })
    }
}
