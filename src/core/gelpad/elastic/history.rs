//! Friction with history: tractions that are carried from one step of a sequence to the next.
//!
//! All of it lives in a frame that moves with the object in the pad's plane: the layer is the same everywhere and in all
//! directions, so its response is the same there, and a point of the pad that sticks stays in one pixel. Nothing is
//! resampled from step to step, so that nothing gets lost in slow motion. The pressure does not feel the tractions
//! (Goodman 1962).

use super::cone::{self, Solved};
use super::grip::{Grip, Vector, length};
use super::inplane::Load;
use super::layer::ElasticLayer;
use crate::base::angle::Turn;
use crate::base::grid::{Grid, Rect, bounding_box};

/// Share of a step's motion to which tractions are solved: slip would else drift at high frame rates.
const SHARE: f64 = 0.05;

/// The least tolerance, mm.
const FINEST_MM: f64 = 1e-7;

/// A traction this close to its limit slips.
const SLIPS_FROM: f32 = 1.0 - 1e-5;

/// Room around the contact, so that the torus's copies are not felt, thicknesses.
const ROOM: f64 = 6.0;

/// A motion of the frame in the pad's plane.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Moved {
    /// Of its origin, along its axes before the motion, mm.
    pub shift_mm: [f64; 2],
    /// From x towards y, rad, at most some degrees.
    pub turn_rad: f64,
}

/// The pressure of a step.
pub enum Normal<'a> {
    /// That of the step before.
    Same,
    /// Another one, in the frame, on pixels a whole number apart from those of every other step.
    Pressed(&'a Load),
    /// Nothing touches.
    Nothing,
}

/// What a step did. Forces are over Young's modulus and act on the pad, along the frame's axes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Step {
    /// How tractions were found.
    pub solved: Solved,
    /// Pixels that touch.
    pub touching: usize,
    /// Pixels that stick, those that came into contact in this step included.
    pub sticking: usize,
    /// True if none sticks of the pixels that touched before, too.
    pub gross: bool,
    /// Mean slip of the pad under the object over all that touches, mm.
    pub slip_mm: [f64; 2],
    /// Energy that slip turned into heat, mm^3.
    pub heat: f64,
}

/// Force and moment on the pad over Young's modulus.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sums {
    /// Along x and y, mm^2.
    pub force: [f64; 2],
    /// Into the pad, mm^2.
    pub normal: f64,
    /// Of the force in the plane about the frame's origin, from x towards y, mm^3.
    pub moment: f64,
    /// Of the pressure: its integral times x and y, mm^3.
    pub lever: [f64; 2],
}

/// What is carried from step to step.
pub struct History {
    layer: ElasticLayer,
    /// Coefficient of friction; infinite where nothing slips.
    coefficient: f64,
    pitch_mm: [f64; 2],
    tolerance_mm: f64,
    held: Option<Held>,
}

/// The fields of a contact, all on the grip's pixels.
struct Held {
    grip: Grip,
    /// The same with room around it, for what acts beyond the contact.
    around: Grip,
    /// The first pixel, counted from the one at the frame's origin.
    first: [i64; 2],
    pressure: Grid<f32>,
    /// Over Young's modulus.
    tractions: Grid<Vector>,
    /// By how much the last step changed them: the next one often does the same.
    change: Grid<Vector>,
    /// Where the object wants each point of the pad, mm from where it rests; beyond the contact, where it is.
    hold: Grid<[f64; 2]>,
    /// Where the pressure alone would have it.
    free: Grid<Vector>,
}

impl History {
    /// Without contact. Pixels are `pitch_mm` apart; tractions are solved to `tolerance_mm`, and finer where steps are small.
    pub fn new(layer: ElasticLayer, coefficient: f64, pitch_mm: [f64; 2], tolerance_mm: f64) -> Self {
        Self { layer, coefficient, pitch_mm, tolerance_mm, held: None }
    }

    /// Moves the object on: the frame by `moved`, with another pressure or the same.
    pub fn step(&mut self, normal: &Normal<'_>, moved: Moved) -> Step {
        match normal {
            Normal::Nothing => {
                self.held = None;
                return Step::default();
            }
            Normal::Same => {}
            Normal::Pressed(load) => self.make_room(load),
        }
        let Some(held) = &mut self.held else { return Step::default() };
        held.turn(moved.turn_rad);
        let before = match normal {
            Normal::Pressed(load) => {
                let pressure = held.placed(load, self.pitch_mm);
                Some(std::mem::replace(&mut held.pressure, pressure))
            }
            _ => None,
        };
        held.step(before.as_ref(), self.coefficient, moved, self.tolerance_mm)
    }

    /// Force and moment of the last step.
    pub fn sums(&self) -> Sums {
        self.held.as_ref().map_or_else(Sums::default, Held::sums)
    }

    /// The tractions: place of the pixel in the frame, mm, and force on it over Young's modulus, mm^2.
    pub fn forces(&self) -> impl Iterator<Item = ([f64; 2], [f64; 2])> {
        self.held.iter().flat_map(|held| {
            let area = held.area();
            let pixels = (0..held.tractions.height).flat_map(|y| (0..held.tractions.width).map(move |x| [x, y]));
            let force = move |[x, y]: [usize; 2]| {
                let t = held.tractions.at(x, y);
                (t != [0.0; 2]).then(|| (held.place_mm(x, y), t.map(|part| area * f64::from(part))))
            };
            pixels.filter_map(force)
        })
    }

    /// What presses: place of the pixel in the frame, mm, and force on it over Young's modulus, mm^2.
    pub fn presses(&self) -> impl Iterator<Item = ([f64; 2], f64)> {
        self.held.iter().flat_map(|held| {
            let area = held.area();
            let pixels = (0..held.pressure.height).flat_map(|y| (0..held.pressure.width).map(move |x| [x, y]));
            let force = move |[x, y]: [usize; 2]| {
                let p = held.pressure.at(x, y);
                (p > 0.0).then(|| (held.place_mm(x, y), area * f64::from(p)))
            };
            pixels.filter_map(force)
        })
    }

    /// True if there are no tractions.
    pub fn is_at_rest(&self) -> bool {
        self.held.as_ref().is_none_or(Held::is_at_rest)
    }

    /// What the pad does at a place in the frame.
    pub fn state_at(&self, place_mm: [f64; 2]) -> StickSlip {
        let Some(held) = &self.held else { return StickSlip::Apart };
        let pixel: [f64; 2] =
            std::array::from_fn(|k| libm::round((place_mm[k] - held.grip.origin_mm[k]) / held.grip.mm_per_px[k]));
        if (0..2).any(|k| pixel[k] < 0.0 || pixel[k] >= held.grip.size[k] as f64) {
            return StickSlip::Apart;
        }
        let [x, y] = pixel.map(|at| at as usize);
        let p = held.pressure.at(x, y);
        let limit = (self.coefficient * f64::from(p)) as f32;
        match p > 0.0 {
            false => StickSlip::Apart,
            true if sticks(held.tractions.at(x, y), limit) => StickSlip::Sticks,
            true => StickSlip::Slips,
        }
    }

    /// What the tractions displace into the pad, mm, over the contact and some thicknesses around it, and where its first
    /// pixel is in the frame. `None` where there are none.
    pub fn displaced(&mut self) -> Option<(Grid<f32>, [f64; 2])> {
        self.held.as_mut().and_then(Held::displaced)
    }

    /// Makes sure that the contact of a load is within the box, and some pixels around it.
    fn make_room(&mut self, load: &Load) {
        let part = bounding_box(&load.pressure, |p| p > 0.0);
        let corner = first_pixel(load.origin_mm, self.pitch_mm);
        let low = [corner[0] + part.x0 as i64, corner[1] + part.y0 as i64];
        let high = [corner[0] + part.x1 as i64, corner[1] + part.y1 as i64];
        if let Some(held) = &self.held {
            let end = [0, 1].map(|k| held.first[k] + held.grip.size[k] as i64);
            if (0..2).all(|k| held.first[k] <= low[k] && high[k] <= end[k]) {
                return;
            }
        }
        let (mut low, mut high) = (low, high);
        let old = self.held.as_ref().map(|held| {
            let old = bounding_box(&held.pressure, |p| p > 0.0);
            [[old.x0, old.x1], [old.y0, old.y1]].map(|ends| ends.map(|at| at as i64))
        });
        if let (Some(held), Some(old)) = (&self.held, old)
            && (0..2).any(|k| held.first[k] + old[k][1] <= low[k] || high[k] <= held.first[k] + old[k][0])
        {
            // Another contact: nothing that touched still does, and the way there may be long.
            self.held = None;
        }
        if let (Some(held), Some(old)) = (&self.held, old) {
            // All that was in contact, and all that is.
            for k in 0..2 {
                let [from, to] = old[k].map(|at| held.first[k] + at);
                (low[k], high[k]) = (low[k].min(from), high[k].max(to));
            }
        }
        let spare = (0..2).map(|k| (high[k] - low[k]) / 3).max().unwrap_or(0).max(8);
        let first = low.map(|at| at - spare);
        let size = [0, 1].map(|k| (high[k] - low[k] + 2 * spare) as usize);
        let origin_mm = [0, 1].map(|k| (first[k] as f64 + 0.5) * self.pitch_mm[k]);
        let box_px = Rect::whole(size[0], size[1]);
        let mut around = Grip::new(self.layer, [origin_mm, self.pitch_mm], box_px, usize::MAX, ROOM);
        let [width, height] = size;
        let mut next = Held {
            grip: around.in_free_space(),
            around,
            first,
            pressure: Grid::new(width, height),
            tractions: Grid::new(width, height),
            change: Grid::new(width, height),
            hold: Grid::new(width, height),
            free: Grid::new(width, height),
        };
        if let Some(held) = &self.held {
            let [dx, dy] = [0, 1].map(|k| held.first[k] - first[k]);
            let within = |x: usize, y: usize| -> Option<[usize; 2]> {
                let [x, y] = [x as i64 + dx, y as i64 + dy];
                ((0..width as i64).contains(&x) && (0..height as i64).contains(&y)).then_some([x as usize, y as usize])
            };
            for y in 0..held.pressure.height {
                for x in 0..held.pressure.width {
                    if let Some([column, row]) = within(x, y) {
                        next.pressure.row_mut(row)[column] = held.pressure.at(x, y);
                        next.tractions.row_mut(row)[column] = held.tractions.at(x, y);
                    }
                }
            }
            // Where the pad is beyond the old box is known from what acts on it.
            next.free = next.pushed();
            let moved = next.moved();
            for (hold, (u, free)) in next.hold.data.iter_mut().zip(moved.data.iter().zip(&next.free.data)) {
                *hold = [0, 1].map(|k| f64::from(u[k]) + f64::from(free[k]));
            }
            for y in 0..held.hold.height {
                for x in 0..held.hold.width {
                    if let Some([column, row]) = within(x, y) {
                        next.hold.row_mut(row)[column] = held.hold.at(x, y);
                    }
                }
            }
        }
        self.held = Some(next);
    }
}

/// What the pad does in a place.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum StickSlip {
    /// Nothing touches it.
    #[default]
    Apart,
    /// It slides along the object.
    Slips,
    /// It goes with the object.
    Sticks,
}

/// The pixel whose centre is at a place, counted from the one that begins at the frame's origin.
fn first_pixel(origin_mm: [f64; 2], pitch_mm: [f64; 2]) -> [i64; 2] {
    [0, 1].map(|k| libm::round(origin_mm[k] / pitch_mm[k] - 0.5) as i64)
}

fn sticks(traction: Vector, limit: f32) -> bool {
    length(traction) < limit * SLIPS_FROM
}

impl Held {
    fn area(&self) -> f64 {
        self.grip.mm_per_px[0] * self.grip.mm_per_px[1]
    }

    fn place_mm(&self, x: usize, y: usize) -> [f64; 2] {
        let at = [x, y];
        [0, 1].map(|k| self.grip.origin_mm[k] + at[k] as f64 * self.grip.mm_per_px[k])
    }

    /// A load on the box's pixels.
    fn placed(&self, load: &Load, pitch_mm: [f64; 2]) -> Grid<f32> {
        let corner = first_pixel(load.origin_mm, pitch_mm);
        let mut pressure = Grid::new(self.grip.size[0], self.grip.size[1]);
        let part = bounding_box(&load.pressure, |p| p > 0.0);
        for y in part.y0..part.y1 {
            let row = (corner[1] + y as i64 - self.first[1]) as usize;
            for x in part.x0..part.x1 {
                let column = (corner[0] + x as i64 - self.first[0]) as usize;
                pressure.row_mut(row)[column] = load.pressure.at(x, y).max(0.0);
            }
        }
        pressure
    }

    /// What is carried along the axes of a frame that turned.
    fn turn(&mut self, turn_rad: f64) {
        if turn_rad == 0.0 {
            return;
        }
        let turn = Turn::new(turn_rad);
        for fields in [&mut self.tractions, &mut self.change, &mut self.free] {
            fields.data.iter_mut().for_each(|v| *v = turn.back(v.map(f64::from)).map(|part| part as f32));
        }
        self.hold.data.iter_mut().for_each(|v| *v = turn.back(*v));
    }

    /// Motion under the pressure alone.
    fn pushed(&mut self) -> Grid<Vector> {
        self.around.touch_all(&self.pressure);
        self.around.pushed()
    }

    /// Motion under the tractions alone.
    fn moved(&mut self) -> Grid<Vector> {
        self.grip.moved(&self.tractions)
    }

    /// `before` is the pressure of the last step, if it was another one.
    fn step(&mut self, before: Option<&Grid<f32>>, coefficient: f64, moved: Moved, tolerance_mm: f64) -> Step {
        let free = if before.is_some() { self.pushed() } else { self.free.clone() };
        // R^T (m + (R - 1) X).
        let turn = Turn::new(moved.turn_rad);
        let shift = turn.back(moved.shift_mm);
        let driven = |place: [f64; 2]| {
            let ahead = turn.ahead(place);
            [shift[0] + ahead[0], shift[1] + ahead[1]]
        };
        let [width, height] = self.grip.size;
        let mut limits = Grid::<f32>::new(width, height);
        let (mut push_mm, mut touching, mut joined) = (0.0_f64, 0, 0);
        let mut wanted = self.hold.clone();
        for y in 0..height {
            for x in 0..width {
                let p = self.pressure.at(x, y);
                let drive = driven(self.place_mm(x, y));
                let [new, old] = [free.at(x, y), self.free.at(x, y)].map(|v| v.map(f64::from));
                let hold = wanted.at(x, y);
                wanted.row_mut(y)[x] = [0, 1].map(|k| hold[k] + drive[k] - new[k]);
                if p > 0.0 {
                    touching += 1;
                    let push = [0, 1].map(|k| drive[k] - new[k] + old[k]);
                    push_mm = push_mm.max(libm::hypot(push[0], push[1]));
                    // What joins does so at the end of the step.
                    match before.is_none_or(|before| before.at(x, y) > 0.0) {
                        true => limits.row_mut(y)[x] = (coefficient * f64::from(p)) as f32,
                        false => joined += 1,
                    }
                }
            }
        }
        let tolerance_mm = tolerance_mm.min((SHARE * push_mm).max(FINEST_MM));
        self.grip.touch_all(&limits);
        let pixels: Vec<[usize; 2]> = self.grip.points.iter().map(|point| point.pixel).collect();
        let bounds: Vec<f32> = self.grip.points.iter().map(|point| point.pressure).collect();
        let at = |[x, y]: [usize; 2]| wanted.at(x, y).map(|mm| mm as f32);
        let wanted_there: Vec<Vector> = pixels.iter().map(|pixel| at(*pixel)).collect();
        let guess = |&[x, y]: &[usize; 2]| {
            let (t, more) = (self.tractions.at(x, y), self.change.at(x, y));
            [0, 1].map(|k| t[k] + more[k])
        };
        let mut tractions: Vec<Vector> = pixels.iter().map(guess).collect();
        let solved = cone::solve(&mut self.grip, &bounds, &wanted_there, &mut tractions, tolerance_mm);

        let earlier = std::mem::replace(&mut self.tractions, Grid::new(width, height));
        self.change.data.fill([0.0; 2]);
        for (&[x, y], t) in pixels.iter().zip(&tractions) {
            let last = earlier.at(x, y);
            self.tractions.row_mut(y)[x] = *t;
            self.change.row_mut(y)[x] = [0, 1].map(|k| t[k] - last[k]);
        }
        let moved = self.moved();
        let mut step = Step { solved, touching, sticking: joined, gross: !pixels.is_empty(), ..Step::default() };
        // Where it slips and beyond the contact the anchor is where the pad is; where it sticks, where the object wants it:
        // what the solver leaves would else add up.
        let mut hold = Grid::new(width, height);
        for y in 0..height {
            for x in 0..width {
                let (u, free) = (moved.at(x, y), free.at(x, y));
                hold.row_mut(y)[x] = [0, 1].map(|k| f64::from(u[k]) + f64::from(free[k]));
            }
        }
        for ((&[x, y], t), limit) in pixels.iter().zip(&tractions).zip(&bounds) {
            let (free, wanted) = (free.at(x, y).map(f64::from), wanted.at(x, y));
            let anchor = [0, 1].map(|k| wanted[k] + free[k]);
            let there = &mut hold.row_mut(y)[x];
            if sticks(*t, *limit) {
                *there = anchor;
                step.sticking += 1;
                step.gross = false;
            } else {
                let slip = [0, 1].map(|k| there[k] - anchor[k]);
                step.heat -= f64::from(t[0]) * slip[0] + f64::from(t[1]) * slip[1];
                step.slip_mm = [0, 1].map(|k| step.slip_mm[k] + slip[k]);
            }
        }
        // Without a limit there is no traction: such pixels slip, if they touched before.
        for y in 0..height {
            for x in 0..width {
                let joins = before.is_some_and(|before| before.at(x, y) <= 0.0);
                if self.pressure.at(x, y) > 0.0 && limits.at(x, y) <= 0.0 && !joins {
                    let (there, free, wanted) = (hold.at(x, y), free.at(x, y), wanted.at(x, y));
                    step.slip_mm = [0, 1].map(|k| step.slip_mm[k] + there[k] - wanted[k] - f64::from(free[k]));
                    step.gross |= step.sticking == joined;
                }
            }
        }
        step.heat *= self.area();
        step.slip_mm = step.slip_mm.map(|sum| sum / touching.max(1) as f64);
        if coefficient == 0.0 {
            step.sticking = 0;
            step.gross = touching > 0;
        }
        (self.hold, self.free) = (hold, free);
        step
    }

    fn sums(&self) -> Sums {
        let mut sums = Sums::default();
        let area = self.area();
        for y in 0..self.pressure.height {
            for (x, p) in self.pressure.row(y).iter().enumerate().filter(|(_, p)| **p > 0.0) {
                let place = self.place_mm(x, y);
                let p = area * f64::from(*p);
                let t = self.tractions.at(x, y).map(|part| area * f64::from(part));
                sums.normal += p;
                sums.lever = [0, 1].map(|k| sums.lever[k] + p * place[k]);
                sums.force = [0, 1].map(|k| sums.force[k] + t[k]);
                sums.moment += place[0] * t[1] - place[1] * t[0];
            }
        }
        sums
    }

    fn is_at_rest(&self) -> bool {
        self.tractions.data.iter().all(|t| *t == [0.0; 2])
    }

    fn displaced(&mut self) -> Option<(Grid<f32>, [f64; 2])> {
        if self.is_at_rest() {
            return None;
        }
        let reach = self.around.reach(0.5 * ROOM);
        let down = self.around.sunk(&self.tractions, reach);
        let origin_mm = [0, 1].map(|k| self.grip.origin_mm[k] - reach[k] as f64 * self.grip.mm_per_px[k]);
        Some((down, origin_mm))
    }
}
