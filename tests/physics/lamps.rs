//! The optics model `lamps` against the formula that GelSight publishes (gelsightinc/gssim), written anew from it in f64: slow,
//! with its own layout of the numbers and its own places of the pixels.

use gelsim_core::base::grid::Grid;
use gelsim_core::base::simd::scalar_only;
use gelsim_core::base::view::View;
use gelsim_core::effects::{Effect, EffectLog, EffectPolicy};
use gelsim_core::optics::lamps::{LAMP_COUNT, Lamp, LampShader};
use gelsim_core::simulator::Stages;
use gelsim_dataset::content::{LayerContent, layer_content};
use gelsim_files::sensor::{PRESETS, Sensor};
use gelsim_job::layers::OutputLayer;
use gelsim_job::sample::render;

use crate::plan::plan;
use gelsim_oracle::shapes::Random;

/// Pixels of the device's image.
const FULL_PX: [f64; 2] = [2464.0, 2056.0];

fn preset() -> Sensor {
    let (_, text) = PRESETS.iter().find(|(name, _)| *name == "gelsight-series2").expect("a preset");
    toml::from_str(text).expect("a sensor")
}

/// A calibration as it is published: the matrix `quadfit` has a row for each of x^2, x y, y^2, x, y and 1, and ten columns for
/// each lamp.
struct Published {
    quadfit: [[f64; 60]; 6],
    flat_fields: Vec<[f64; 15]>,
}

impl Published {
    fn new(lamps: &[Lamp]) -> Self {
        let mut quadfit = [[0.0; 60]; 6];
        for (lamp, own) in lamps.iter().enumerate() {
            for (m, [one, y, yy, x, xy, xx]) in own.quadratic.into_iter().enumerate() {
                for (row, value) in quadfit.iter_mut().zip([xx, xy, yy, x, y, one]) {
                    row[10 * lamp + m] = value;
                }
            }
        }
        Self { quadfit, flat_fields: lamps.iter().map(|lamp| lamp.flat_field).collect() }
    }

    /// The grey value of a lamp, 0 to 1, at column and row of the device's image, both counted from 0, and the normal of a
    /// height map that grows towards the camera.
    fn grey(&self, lamp: usize, [column, row]: [f64; 2], normal: [f64; 3]) -> f64 {
        let short = FULL_PX[0].min(FULL_PX[1]);
        let x = (column - (FULL_PX[0] + 1.0) / 2.0) / short;
        let y = (row - (FULL_PX[1] + 1.0) / 2.0) / short;
        let terms = [x * x, x * y, y * y, x, y, 1.0];
        let q = |k: usize| terms.iter().zip(&self.quadfit).map(|(term, row)| term * row[10 * lamp + k]).sum::<f64>();
        let form = [[q(0), q(1), q(2)], [q(1), q(3), q(4)], [q(2), q(4), q(5)]];
        let linear = [q(6), q(7), q(8)];
        let mut sum = q(9);
        for i in 0..3 {
            sum += linear[i] * normal[i];
            for j in 0..3 {
                sum += normal[i] * form[i][j] * normal[j];
            }
        }
        let (u, v) = (2.0 * (column + 0.5) / FULL_PX[0] - 1.0, 2.0 * (row + 0.5) / FULL_PX[1] - 1.0);
        let mut flat_field = 0.0;
        let mut factors = self.flat_fields[lamp].iter();
        for i in 0..5 {
            for j in 0..5 - i {
                flat_field += factors.next().expect("15 factors") * u.powi(i) * v.powi(j);
            }
        }
        (sum.max(0.0) * flat_field).clamp(0.0, 1.0)
    }

    /// At every pixel of a view of the device's field of view, under a surface with a border of one pixel: the grey value of
    /// each lamp.
    fn images(&self, surface: &Grid<f32>, view: &View) -> Vec<[f64; LAMP_COUNT]> {
        let [width, height] = view.resolution_px;
        let mut images = Vec::new();
        for y in 0..height {
            for x in 0..width {
                let towards = |dx: usize, dy: usize| f64::from(surface.at(x + dx, y + dy));
                let right = (towards(2, 1) - towards(0, 1)) / (2.0 * view.mm_per_px[0]);
                let down = (towards(1, 2) - towards(1, 0)) / (2.0 * view.mm_per_px[1]);
                let length = (right * right + down * down + 1.0).sqrt();
                let normal = [-right / length, -down / length, 1.0 / length];
                let place = [(x, width, FULL_PX[0]), (y, height, FULL_PX[1])]
                    .map(|(at, count, full)| (at as f64 + 0.5) * full / count as f64 - 0.5);
                images.push(std::array::from_fn(|lamp| self.grey(lamp, place, normal)));
            }
        }
        images
    }
}

fn largest<'a>(differences: impl Iterator<Item = f64> + 'a) -> f64 {
    differences.map(f64::abs).fold(0.0, f64::max)
}

#[test]
fn grey_images_of_random_normals_are_the_published_formula() {
    let sensor = preset();
    let mut random = Random(7);
    // Square pixels, and pixels that are not; the device's own lamps, and ones so bright that images are cut at white and black.
    for (resolution_px, brighter) in [([616, 514], 1.0), ([77, 64], 1.0), ([40, 90], 6.0)] {
        let mut lamps = sensor.lamp.clone();
        lamps.iter_mut().flat_map(|lamp| lamp.quadratic.as_flattened_mut()).for_each(|factor| *factor *= brighter);
        // Of flat pads 2.5 without this.
        lamps.iter_mut().filter(|_| brighter > 1.0).for_each(|lamp| lamp.quadratic[9][0] -= 1.5);
        let mm_per_px = [0, 1].map(|k| sensor.field_of_view_mm[k] / resolution_px[k] as f64);
        let view = View { resolution_px, mm_per_px };
        let [width, height] = resolution_px.map(|px| px + 2);
        let mut surface = Grid::new(width, height);
        for y in 0..height {
            // Gentle slopes and walls.
            let steepest = 6.0 * random.unit() * random.unit();
            let heights = || (steepest * mm_per_px[0] * (2.0 * random.unit() - 1.0)) as f32;
            surface.row_mut(y).fill_with(heights);
        }
        let shader = LampShader::new(&lamps, &view);
        let planes = shader.render_grey(&surface);
        assert_eq!(planes.len(), LAMP_COUNT);
        assert_eq!(planes, scalar_only(|| shader.render_grey(&surface)), "without wide vectors the bits are the same");
        let found = |at: usize| planes.iter().map(move |plane| plane.data[at]);
        let (mut off, mut black, mut white) = (0.0_f64, 0, 0);
        for (at, expected) in Published::new(&lamps).images(&surface, &view).into_iter().enumerate() {
            for (found, expected) in found(at).zip(expected) {
                off = off.max(255.0 * (f64::from(found) - expected).abs());
                black += usize::from(found == 0.0);
                white += usize::from(found == 1.0);
            }
        }
        println!("{resolution_px:?}: {:.4} grey levels", off / brighter);
        assert!(off < 0.1 * brighter, "{resolution_px:?}: {off} grey levels");
        assert!(brighter == 1.0 || (black > 100 && white > 100), "{black} black values, {white} white ones");
    }
}

/// A ball pressed into the preset's pad; `press` goes to `[indentation]`, `sensor` to `[sensor]`.
fn job(press: &str, sensor: &str) -> String {
    format!(
        "[dataset]\nname = \"a\"\nsamples = 1\n[[object]]\npath = \"objects/sphere.obj\"\n[indentation]\ndepth_mm = 0.9\n{press}\n\
         [output]\nlayers = [\"lamps\"]\n[sensor]\npreset = \"gelsight-series2\"\nresolution_px = [154, 128]\n{sensor}\n"
    )
}

fn lamps_of(sample: &gelsim_job::sample::Sample) -> Vec<f32> {
    match layer_content(sample, OutputLayer::Lamps) {
        LayerContent::Floats(values) => values,
        _ => panic!("lamps are floats"),
    }
}

#[test]
fn layer_and_image_of_a_pressed_ball_are_the_published_formula() {
    let sensor = preset();
    let published = Published::new(&sensor.lamp);
    let plan = plan(&job("", ""));
    let sample = render(&plan, 0);
    assert_eq!(sample.label.models.optics_model, "lamps");
    let expected = published.images(&sample.impression.contact.surface, plan.simulator.view());
    let found = lamps_of(&sample);
    let grey = largest(found.iter().zip(expected.iter().flatten()).map(|(a, b)| 255.0 * (f64::from(*a) - b)));
    let composite = expected.iter().flat_map(|grey| {
        [0, 1, 2].map(|channel| {
            255.0 * (0..LAMP_COUNT).map(|lamp| sensor.lamp[lamp].color[channel] * grey[lamp]).sum::<f64>()
        })
    });
    let composite: Vec<f64> = composite.collect();
    let image = &sample.impression.image.rgb;
    let colour = largest(image.iter().zip(&composite).map(|(a, b)| f64::from(*a) - b));
    println!("grey {grey:.4}, colour {colour:.4} levels");
    assert!(grey < 0.1, "{grey} grey levels");
    // One rounding of the background image, one of the picture.
    assert!(colour <= 1.05, "{colour} grey levels");
    let changed = image.iter().zip(&plan.simulator.background().rgb).filter(|(a, b)| a.abs_diff(**b) > 20).count();
    assert!(changed > 800, "the press changes {changed} values");
}

/// The left flank of a ball's dent faces the lamps on the left, whose channel it brightens: a mirrored axis would be seen here.
#[test]
fn each_colour_brightens_on_its_own_side_of_a_ball() {
    let plan = plan(&job("", ""));
    let sample = render(&plan, 0);
    let [width, height] = plan.simulator.view().resolution_px;
    let level = |channel: usize, x: usize, y: usize| {
        let at = 3 * (y * width + x) + channel;
        f64::from(sample.impression.image.rgb[at]) - f64::from(plan.simulator.background().rgb[at])
    };
    // Red above, green to the lower right, blue to the lower left (docs/reference/presets.md).
    for (channel, degrees) in [(0, -90.0_f64), (1, 27.0), (2, 150.0)] {
        let mut sum = [0.0; 2];
        for y in 0..height {
            for x in 0..width {
                let change = level(channel, x, y);
                sum[0] += change * (x as f64 + 0.5 - width as f64 / 2.0);
                sum[1] += change * (y as f64 + 0.5 - height as f64 / 2.0);
            }
        }
        let found = sum[1].atan2(sum[0]).to_degrees();
        let off = (found - degrees + 540.0).rem_euclid(360.0) - 180.0;
        assert!(off.abs() < 25.0, "channel {channel} brightens towards {found:.0} degrees, not {degrees}");
    }
}

#[test]
fn an_untouched_pad_is_the_composite_of_its_lamps_and_nothing_is_shaded() {
    let plan = plan(&job("no_contact = 1.0", ""));
    let sample = render(&plan, 0);
    let background = plan.simulator.background();
    assert_eq!(sample.impression.image.rgb, background.rgb);
    assert!(!sample.impression.effects.notes[Effect::Shading].ran);
    let sensor = preset();
    let grey = lamps_of(&sample);
    for (at, rgb) in background.rgb.as_chunks::<3>().0.iter().enumerate() {
        for (channel, level) in rgb.iter().enumerate() {
            let of = |lamp: usize| sensor.lamp[lamp].color[channel] * f64::from(grey[LAMP_COUNT * at + lamp]);
            let expected = 255.0 * (0..LAMP_COUNT).map(of).sum::<f64>();
            assert!((f64::from(*level) - expected).abs() < 0.501, "{at} {channel}: {level} for {expected}");
        }
    }
    // Shaded everywhere all the same, it is still the background to the last bit.
    let mut everywhere = EffectLog::new(EffectPolicy::All);
    let light = plan.simulator.shader().shade(&sample.impression.contact, background, &mut everywhere).into_light();
    assert_eq!(light.planes, background.light(light.region).planes);
    assert_eq!(light.region.area(), background.width * background.height);
}

#[test]
fn a_photograph_takes_the_place_of_the_composite() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("untouched.png");
    let photograph =
        image::RgbImage::from_fn(154, 128, |x, y| image::Rgb([60 + (x / 2) as u8, 90, 70 + (y / 2) as u8]));
    photograph.save(&path).expect("an image");
    let own = plan(&job("", &format!("background = {:?}", path.display().to_string())));
    let (own, composite) = (render(&own, 0), render(&plan(&job("", "")), 0));
    let rest = plan(&job("", "")).simulator.background().rgb.clone();
    for ((own, photograph), (composite, rest)) in
        own.impression.image.rgb.iter().zip(photograph.as_raw()).zip(composite.impression.image.rgb.iter().zip(&rest))
    {
        let change = f64::from(*composite) - f64::from(*rest);
        assert!(
            (f64::from(*own) - (f64::from(*photograph) + change).clamp(0.0, 255.0)).abs() <= 1.0,
            "{own}: {photograph} and {change}"
        );
    }
}

#[test]
fn grey_images_go_through_the_lens() {
    let bent = render(&plan(&job("", "[camera]\ndistortion_k1 = 0.1")), 0);
    let straight = render(&plan(&job("", "")), 0);
    let lens = bent.impression.lens.as_ref().expect("a lens");
    let (found, before) = (lamps_of(&bent), lamps_of(&straight));
    for lamp in 0..LAMP_COUNT {
        let plane = |values: &[f32]| values.iter().skip(lamp).step_by(LAMP_COUNT).copied().collect();
        let expected = lens.warp_plane(&Grid { width: 154, height: 128, data: plane(&before) }).data;
        assert_eq!(plane(&found), expected, "lamp {lamp}");
    }
    assert_ne!(found, before);
}

#[test]
fn what_is_not_shaded_would_change_by_less_than_a_grey_level() {
    for depth_mm in [0.02, 0.2, 0.9] {
        let called_for = plan(&job("", "").replace("depth_mm = 0.9", &format!("depth_mm = {depth_mm:?}")));
        let everything = called_for.with_policy(EffectPolicy::All);
        let (some, all) = (render(&called_for, 0), render(&everything, 0));
        let off = some.impression.image.rgb.iter().zip(&all.impression.image.rgb).map(|(a, b)| a.abs_diff(*b)).max();
        assert!(off <= Some(1), "{depth_mm} mm: {off:?} grey levels");
        assert_eq!(lamps_of(&some), lamps_of(&all));
        let notes = &some.impression.effects.notes;
        let absent = [Effect::Grain, Effect::Shadows, Effect::Darkening, Effect::Supersampling];
        assert!(notes[Effect::Shading].ran && absent.iter().all(|effect| !notes[*effect].ran));
        let lit = called_for.simulator.shade_contact(&some.impression.contact).region.area();
        assert!(depth_mm > 0.1 || lit < 154 * 128 / 2, "a shallow press lights {lit} pixels");
    }
}
