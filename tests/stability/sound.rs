//! What must be true of every sample, whatever was pressed into whatever pad.
//!
//! How high a pad may bulge: with G the layer's response, p the pressures and e a unit pressure on the pixel x, the
//! displacement there is w(x) = (e, G p). G is symmetric and positive (Betti; elastic energy), so |w(x)|^2 <= (e, G e)
//! (p, G p) (Cauchy and Schwarz); and (p, G p) = sum p w = sum p g, because pressure acts only where w is the
//! penetration g. So no pixel is displaced by more than sqrt(K sum p max g), K being what a pixel's own pressure does
//! to it; nor is any raised by more than sum p times the most that a pixel's pressure raises another.

use gelsim_core::impression::Impression;
use gelsim_core::simulator::Stages;
use std::fmt;
use std::io::Cursor;
use std::time::Duration;

use exr::prelude::{ReadChannels, ReadLayers};
use gelsim_core::base::grid::{Rect, bounding_box};
use gelsim_core::base::view::SURFACE_BORDER;
use gelsim_core::gelpad::{Pad, Theory};
use gelsim_core::optics::normals::surface_normals;
use gelsim_dataset::archive::Member;
use gelsim_dataset::encode;
use gelsim_job::label::Label;
use gelsim_job::plan::Plan;
use gelsim_job::sample::Sample;
use gelsim_job::sample::render;

/// What was seen of a case.
#[derive(Clone, Copy, Debug, Default)]
pub struct Figures {
    pub samples: u32,
    /// Samples whose solver gave up.
    pub unsolved: u32,
    /// Largest violation of the contact conditions over the tolerance.
    pub residual: f64,
    pub iterations: u32,
    /// Highest bulge over the deepest penetration.
    pub bulge: f64,
    /// Highest bulge over its bound.
    pub bulge_of_bound: f64,
    /// Largest displacement over the pad's thickness.
    pub highest: f64,
    /// How far an interpolated surface bulges over the solver's, as a share of the largest displacement.
    pub overshoot: f64,
    /// Steepest normal, degrees from the pad's.
    pub steepest_deg: f64,
    /// Samples in which something touches.
    pub touching: u32,
    /// The slowest sample, with all that is checked.
    pub slowest: Duration,
}

impl Figures {
    pub fn add(&mut self, other: &Self, took: Duration) {
        self.samples += 1;
        self.unsolved += other.unsolved;
        self.touching += other.touching;
        self.residual = self.residual.max(other.residual);
        self.iterations = self.iterations.max(other.iterations);
        self.bulge = self.bulge.max(other.bulge);
        self.bulge_of_bound = self.bulge_of_bound.max(other.bulge_of_bound);
        self.highest = self.highest.max(other.highest);
        self.overshoot = self.overshoot.max(other.overshoot);
        self.steepest_deg = self.steepest_deg.max(other.steepest_deg);
        self.slowest = self.slowest.max(took);
    }
}

impl fmt::Display for Figures {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { samples, unsolved, touching, residual, iterations, bulge, .. } = self;
        write!(f, "{touching} of {samples} touch")?;
        if *unsolved > 0 {
            write!(f, ", {unsolved} unsolved and said to be")?;
        }
        if *iterations > 0 {
            write!(f, "; {iterations} iterations to {residual:.2} of the tolerance; bulge {bulge:.3} of the depth")?;
            write!(f, ", {:.2} of its bound", self.bulge_of_bound)?;
        }
        if self.overshoot >= 1e-3 {
            write!(f, ", {:.3} more by interpolation", self.overshoot)?;
        }
        if self.highest > 0.0 {
            write!(f, "; to {:.4} of the pad, normals to {:.4} degrees", self.highest, self.steepest_deg)?;
        }
        write!(f, "; {} ms", self.slowest.as_millis())
    }
}

macro_rules! ensure {
    ($holds:expr, $($text:tt)*) => {
        let holds: bool = $holds;
        if !holds {
            return Err(format!($($text)*));
        }
    };
}

/// Renders a plan's sample twice and checks all that is promised of it.
pub fn check(plan: &Plan) -> Result<Figures, String> {
    let sample = render(plan, 0);
    let mut figures = Figures::default();
    pad(plan, &sample, &mut figures)?;
    solution(plan, &sample, &mut figures)?;
    picture(plan, &sample)?;
    label(plan, &sample)?;
    let members = encode::encode_members(plan, &sample);
    for member in &members {
        decodes(member, plan, &sample).map_err(|text| format!("{}: {text}", member.suffix))?;
    }
    // Rubber takes a hundred times as long; that its bits are the same is tested by itself.
    if sample.impression.contact.numerics.theory == Theory::FiniteStrain && !crate::thorough() {
        return Ok(figures);
    }
    let again = encode::encode_members(plan, &render(plan, 0));
    ensure!(again.len() == members.len(), "another set of members the second time");
    for (first, second) in members.iter().zip(&again) {
        ensure!(content_of(first)? == content_of(second)?, "{} has other bytes the second time", first.suffix);
    }
    Ok(figures)
}

fn ensure_finite<'a>(what: &str, values: impl IntoIterator<Item = &'a f32>) -> Result<(), String> {
    match values.into_iter().find(|value| !value.is_finite()) {
        Some(value) => Err(format!("{what} holds {value}")),
        None => Ok(()),
    }
}

/// Depth, surface, normals, pressure.
fn pad(plan: &Plan, sample: &Sample, figures: &mut Figures) -> Result<(), String> {
    let Impression { depth, contact, .. } = &sample.impression;
    let [width, height] = plan.simulator.view().resolution_px;
    let thickness = plan.thickness_mm() as f32;
    ensure_finite("the penetration", &depth.penetration.data)?;
    ensure_finite("the surface", &contact.surface.data)?;
    ensure!(contact.finite, "the pad says that it is not finite");
    let below = depth.below_pad();
    ensure!((below.width, below.height) == (width, height), "a depth map of another size");
    ensure!(below.data.iter().all(|mm| (0.0..=thickness).contains(mm)), "a depth outside 0 .. thickness");
    ensure!(below.data.iter().fold(0.0_f32, |most, mm| most.max(*mm)) == depth.deepest_mm, "the deepest is another");

    let size = (width + 2 * SURFACE_BORDER, height + 2 * SURFACE_BORDER);
    ensure!((contact.surface.width, contact.surface.height) == size, "a surface of another size");
    ensure!((contact.mask.width, contact.mask.height) == (width, height), "a mask of another size");
    ensure!(contact.mask.data.iter().all(|value| [0, 255].contains(value)), "a mask that is neither 0 nor 255");
    heights(plan, sample, figures)?;

    let normals = surface_normals(contact, plan.simulator.view());
    ensure_finite("the normals", normals.as_flattened())?;
    for [x, y, z] in &normals {
        let length = (x * x + y * y + z * z).sqrt();
        ensure!((length - 1.0).abs() < 1e-5 && *z < 0.0, "a normal ({x}, {y}, {z})");
        let flat = f64::from(*x).hypot(f64::from(*y));
        figures.steepest_deg = figures.steepest_deg.max(flat.atan2(f64::from(-z)).to_degrees());
    }
    if let Some(pressure) = &contact.pressure {
        ensure_finite("the pressure", &pressure.data)?;
        ensure!(pressure.data.iter().all(|kpa| *kpa >= 0.0), "a pressure below 0");
        let outside = pressure.data.iter().zip(&contact.mask.data).find(|(kpa, mask)| **kpa > 0.0 && **mask == 0);
        ensure!(outside.is_none(), "pressure where nothing touches");
    }
    Ok(())
}

/// The surface keeps between the highest bulge and the shell.
fn heights(plan: &Plan, sample: &Sample, figures: &mut Figures) -> Result<(), String> {
    let Impression { depth, contact, .. } = &sample.impression;
    let (mut lowest, mut highest) = (0.0_f32, 0.0_f32);
    for w in &contact.surface.data {
        (lowest, highest) = (lowest.min(*w), highest.max(*w));
    }
    let thickness = plan.thickness_mm() as f32;
    figures.highest = f64::from(highest / thickness);
    ensure!(highest <= thickness * (1.0 + 1e-6), "the surface is at {highest} in a pad of {thickness} mm");

    let deepest = depth.penetration.data.iter().fold(0.0_f32, |most, g| most.max(*g));
    let bulge = contact.bulge_mm;
    ensure!(bulge >= 0.0 && bulge.is_finite(), "a bulge of {bulge} mm");
    if deepest > 0.0 {
        figures.bulge = f64::from(bulge / deepest);
    }
    // Cubic interpolation leaves the range of what it goes through by up to 9/16 of it, 5/4 along each axis.
    let overshoot = (-lowest - bulge).max(0.0);
    let range = deepest.max(bulge);
    figures.overshoot = if range > 0.0 { f64::from(overshoot / range) } else { 0.0 };
    ensure!(overshoot <= 0.5625 * range, "the surface is at {lowest}, the solver's no lower than {}", -bulge);

    let Pad::Elastic(pad) = &plan.simulator.pad() else {
        ensure!(lowest == 0.0 && bulge == 0.0, "a blur that bulges, to {lowest}");
        return Ok(());
    };
    let kernel = pad.kernel();
    let (own, raised) = (f64::from(kernel.at(0, 0)), kernel.data.iter().fold(0.0_f32, |most, k| most.max(-k)));
    let force: f64 = contact.load.iter().flat_map(|load| &load.pressure.data).map(|p| f64::from(*p)).sum();
    let off = 1e-3 * contact.numerics.residual_um.unwrap_or(0.0);
    let bound = (own * force * (f64::from(deepest) + off)).sqrt().min(f64::from(raised) * force);
    // Sums of 32-bit numbers are off by a little.
    // The bound is the linear layer's; rubber may bulge a little more.
    let rubber = if pad.strain_settings().is_some() { 1.2 } else { 1.0 };
    let bound = 1.001 * rubber * (bound + contact.total.raised_mm) + 1e-5 * f64::from(deepest);
    ensure!(f64::from(bulge) <= bound, "the pad bulges by {bulge} mm, over its bound of {bound} mm");
    if bound > 0.0 {
        figures.bulge_of_bound = f64::from(bulge) / bound;
    }
    Ok(())
}

/// The solver says how it went.
fn solution(plan: &Plan, sample: &Sample, figures: &mut Figures) -> Result<(), String> {
    let numerics = &sample.label.numerics;
    figures.iterations = numerics.iterations;
    figures.touching = u32::from(sample.label.contact.in_contact);
    figures.unsolved = u32::from(!numerics.converged);
    let Some(elastic) = plan.simulator.models().gelpad.contact_solver() else {
        ensure!(numerics.converged && numerics.residual_um.is_none(), "a direct model that iterates");
        return Ok(());
    };
    let residual = numerics.residual_um.ok_or("no residual")?;
    ensure!(residual.is_finite() && residual >= 0.0, "a residual of {residual} um");
    figures.residual = residual / elastic.tolerance_um;
    // What the object reaches through the surface outside the solver's box counts from twice the tolerance on.
    let solved = figures.residual <= if numerics.converged { 2.0 + 1e-6 } else { 1.0 };
    ensure!(solved == numerics.converged, "converged is {}, the residual {residual} um", numerics.converged);
    Ok(())
}

/// Light and image.
fn picture(plan: &Plan, sample: &Sample) -> Result<(), String> {
    let image = &sample.impression.image;
    let [width, height] = plan.simulator.view().resolution_px;
    ensure!((image.width, image.height) == (width, height), "an image of another size");
    ensure!(image.rgb.len() == 3 * width * height, "{} bytes", image.rgb.len());
    let light = plan.simulator.shade_contact(&sample.impression.contact);
    for plane in &light.planes {
        ensure_finite("the light", plane)?;
    }
    ensure!(image.finite, "the image says that it is not finite");
    let saturated = image.rgb.chunks_exact(3).filter(|pixel| pixel.contains(&255)).count() as u64;
    ensure!(image.saturated_px == saturated, "{} saturated pixels, of which {saturated} are", image.saturated_px);
    ensure!(image.clipped_px <= (width * height) as u64, "{} clipped pixels", image.clipped_px);

    let camera = &sample.label.camera;
    let noisy = camera.shot_noise_levels > 0.0 || camera.read_noise_levels > 0.0;
    // What touches beyond the window may bend the pad in view.
    let clear = sample.impression.depth.touching.is_empty() && !sample.label.contact.cut_by_view;
    if clear && !noisy {
        let untouched = &plan.simulator.untouched();
        ensure!(image.rgb == untouched.rgb, "nothing touches, and the picture is not that of the untouched pad");
        let counts = (image.clipped_px, image.saturated_px) == (untouched.clipped_px, untouched.saturated_px);
        ensure!(counts, "nothing touches, and pixels are cut");
    }
    Ok(())
}

/// The label says what the layers show.
fn label(plan: &Plan, sample: &Sample) -> Result<(), String> {
    let (Impression { contact, depth, image, lens, .. }, label) = (&sample.impression, &sample.label);
    let [width, height] = plan.simulator.view().resolution_px;
    let said = &label.contact;
    ensure!(label.health.finite, "health.finite is false");
    ensure!(label.health.clipped_px == image.clipped_px, "another count of clipped pixels");
    ensure!(label.health.saturated_px == image.saturated_px, "another count of saturated pixels");
    ensure!(label.health.over_thickness_px <= (width * height) as u64, "more pixels over the thickness than there are");

    let touching = contact.mask.data.iter().filter(|value| **value > 0).count();
    ensure!(said.in_contact == (touching > 0), "in_contact is {}, {touching} pixels touch", said.in_contact);
    let [dx, dy] = plan.simulator.view().mm_per_px;
    ensure!(is_close(said.area_mm2, touching as f64 * dx * dy), "an area of {} mm^2", said.area_mm2);
    ensure!(is_close(said.fraction, touching as f64 / (width * height) as f64), "a share of {}", said.fraction);
    let half = [width as f64 * dx / 2.0, height as f64 * dy / 2.0];
    let inside = (0..2).all(|k| said.centroid_mm[k].abs() <= half[k]);
    ensure!(inside, "a centroid at {:?}", said.centroid_mm);
    let seen = lens.as_ref().map_or_else(|| contact.mask.clone(), |lens| lens.warp_mask(&contact.mask));
    let Rect { x0, y0, x1, y1 } = bounding_box(&seen, |value| value > 0);
    ensure!(said.bbox_px == [x0, y0, x1, y1].map(|px| px as u32), "a box of {:?}", said.bbox_px);
    let deepest = if said.in_contact { f64::from(depth.deepest_mm) } else { 0.0 };
    ensure!(said.max_depth_mm == deepest, "a depth of {} mm", said.max_depth_mm);

    let (mut force, mut peak) = (0.0, 0.0_f32);
    for kpa in contact.pressure.iter().flat_map(|pressure| &pressure.data) {
        force += f64::from(*kpa) * dx * dy * 1e-3;
        peak = peak.max(*kpa);
    }
    let elastic = matches!(plan.simulator.pad(), Pad::Elastic(_));
    let unsolved = said.cut_by_view && said.force_unknown.contains("not solved");
    ensure!(said.force_n.is_some() == (elastic && !unsolved), "a force of {:?}", said.force_n);
    ensure!(said.force_n.is_none_or(|said| said >= 0.0 && is_close(said, force)), "{:?} N, not {force}", said.force_n);
    let peak = f64::from(peak);
    ensure!(said.peak_pressure_kpa.is_none_or(|said| said == peak), "a peak of {:?} kPa", said.peak_pressure_kpa);

    let whole =
        said.total_force_n.zip(said.force_n).is_none_or(|(all, seen)| all >= seen && (said.cut_by_view || all == seen));
    ensure!(whole, "{:?} N of {:?} N in view", said.force_n, said.total_force_n);
    ensure!(said.force_unknown.is_empty() == said.total_force_n.is_some(), "because {}", said.force_unknown);
    let share = said.in_view_fraction.unwrap_or(f64::NAN);
    let expected = if said.cut_by_view { (0.0..1.0).contains(&share) } else { share == f64::from(said.in_contact) };
    ensure!(expected, "cut: {}, in view: {share}", said.cut_by_view);

    let turn = label.pose.quaternion_xyzw;
    ensure!((turn.iter().map(|q| q * q).sum::<f64>() - 1.0).abs() < 1e-9, "a turn by {turn:?}");
    ensure!(label.numerics.strain < 1.0, "a strain of {}", label.numerics.strain);
    Ok(())
}

fn is_close(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-9 * a.abs().max(b.abs())
}

/// The content of a file.
fn content_of(member: &Member) -> Result<std::borrow::Cow<'_, [u8]>, String> {
    member.bytes.read().map_err(|error| error.to_string())
}

/// What was encoded can be read again, and is finite.
fn decodes(member: &Member, plan: &Plan, sample: &Sample) -> Result<(), String> {
    let [width, height] = plan.simulator.view().resolution_px;
    let text = |error: &dyn fmt::Display| error.to_string();
    let bytes = content_of(member)?;
    match member.suffix.as_str() {
        "json" => {
            // A number that is not finite becomes null, and null is none of a label's numbers.
            let read: Label = serde_json::from_slice(&bytes).map_err(|error| text(&error))?;
            let mut camera = sample.label.camera;
            camera.noise_key = read.camera.noise_key;
            ensure!(read == Label { camera, ..sample.label.clone() }, "another label was read");
        }
        "markers.json" => {
            let read: serde_json::Value = serde_json::from_slice(&bytes).map_err(|error| text(&error))?;
            ensure!(!read.to_string().contains("null"), "a marker that is nowhere");
        }
        name if name.ends_with(".png") => {
            let read = image::load_from_memory(&bytes).map_err(|error| text(&error))?;
            ensure!((read.width() as usize, read.height() as usize) == (width, height), "of another size");
        }
        _ => {
            let read = exr::prelude::read().no_deep_data().largest_resolution_level().all_channels();
            let read = read.first_valid_layer().all_attributes().from_buffered(Cursor::new(&bytes));
            let layer = read.map_err(|error| text(&error))?.layer_data;
            ensure!((layer.size.x(), layer.size.y()) == (width, height), "of another size");
            for channel in &layer.channel_data.list {
                let bad = channel.sample_data.values_as_f32().find(|value| !value.is_finite());
                ensure!(bad.is_none(), "holds {bad:?}");
            }
        }
    }
    Ok(())
}
