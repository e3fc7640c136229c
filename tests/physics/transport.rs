//! Light of near LEDs, their images in the window and one bounce against traced paths (`tests/oracle/path_tracer.rs`),
//! on pads that eight objects are pressed into.
//!
//! Three sensors stand for kinds: rows of LEDs close by (Mini), small LEDs (DIGIT), low rows of four colours over a coat
//! with a highlight (2014). Their geometry is assumed, not measured. The untouched pad has 110 levels in its middle.

use gelsim_core::base::grid::Grid;
use gelsim_core::base::view::View;
use gelsim_core::gelpad::Contact;
use gelsim_core::optics::Model;
use gelsim_core::optics::led::Led;
use gelsim_core::optics::light_error::LightError;
use gelsim_core::optics::near_light::bounce::Coat;
use gelsim_core::optics::near_light::window::{Window, fresnel};
use gelsim_core::optics::normals::surface_normals;
use gelsim_core::optics::phong::{Phong, Shadows, SoftShadows};
use gelsim_files::sensor::Sensor;
use gelsim_job::sample::render;

use super::support::{camera_of, contact_of, grey, light_at, light_of};
use crate::plan::plan;
use gelsim_oracle::path_tracer::{Scene, Ways};

/// Grey level of the untouched pad in its middle.
const REST_LEVEL: f64 = 110.0;
const OBJECTS: [&str; 8] = ["sphere", "torus", "dots", "hexagon_nut", "coin", "gear", "letter", "rope"];
/// Every so many pixels is traced.
const STRIDE: usize = 12;
const BOUNCES: usize = 3;
/// What surrounds the contact, mm.
const AROUND_MM: f64 = 1.0;

/// Paths of a pixel: few, whose noise counts as error, unless more are asked for.
fn paths() -> u32 {
    let asked = std::env::var("GELSIM_PATHS").ok();
    asked.map_or(48, |paths| paths.parse().expect("GELSIM_PATHS is a number"))
}

/// The objects: every second one, unless more paths are asked for.
fn objects() -> impl Iterator<Item = &'static str> {
    OBJECTS.into_iter().step_by(if paths() > 48 { 1 } else { 2 })
}

/// What of the light is computed.
#[derive(Clone, Copy)]
struct Variant {
    near: bool,
    shadows: bool,
    window: bool,
    coat: bool,
}

const ALL: Variant = Variant { near: true, shadows: true, window: true, coat: true };
const DIRECT: Variant = Variant { window: false, coat: false, ..ALL };
/// Those whose error is held against what is expected of it.
const VARIANTS: [(&str, Variant); 7] = [
    ("all", ALL),
    ("no mirror", Variant { window: false, ..ALL }),
    ("no bounce", Variant { coat: false, ..ALL }),
    ("no shadows", Variant { shadows: false, ..ALL }),
    ("direct light", DIRECT),
    ("phong", Variant { near: false, ..ALL }),
    ("phong, no shadows", Variant { near: false, shadows: false, ..ALL }),
];

/// Those that networks learn from.
const LEARNT: [Variant; 5] = [
    ALL,
    Variant { coat: false, ..ALL },
    Variant { window: false, ..ALL },
    Variant { shadows: false, ..ALL },
    Variant { near: false, ..ALL },
];

/// A kind of sensor.
struct Kind {
    name: &'static str,
    sensor: Sensor,
    phong: Phong,
}

impl Kind {
    fn new(
        name: &'static str,
        size_mm: [f64; 2],
        window_mm: f64,
        albedo: f64,
        lobe: [f64; 2],
        mut leds: Vec<Led>,
    ) -> Self {
        let phong = Phong {
            diffuse: 0.5,
            specular: 0.5 * lobe[0],
            shininess: lobe[1],
            darkening: Some(0.0),
            shadows: Shadows::Soft(SoftShadows::default()),
            ..Phong::default()
        };
        let resolution_px = size_mm.map(|mm| (mm / 0.06).round() as u32);
        let window = Some(Window { distance_mm: window_mm, refractive_index: 1.41 });
        // Each channel has the level of the untouched pad.
        let flat = Scene::new(
            &leds,
            window,
            0.0,
            phong,
            View { resolution_px: [9, 9], mm_per_px: [0.1; 2] },
            &Grid::new(11, 11),
        );
        let middle = flat.trace(9, 4000, 0).data[0].all();
        for led in &mut leds {
            for (share, middle) in led.color.iter_mut().zip(middle) {
                *share *= REST_LEVEL / 255.0 / middle;
            }
        }
        let sensor = Sensor {
            resolution_px,
            field_of_view_mm: resolution_px.map(|px| 0.06 * f64::from(px)),
            gelpad_thickness_mm: 4.0,
            darkening: 0.0,
            window,
            coat: Some(Coat { albedo }),
            led: leds,
            ..Sensor::default()
        };
        Self { name, sensor, phong }
    }

    fn all() -> [Self; 3] {
        let row = |at: [f64; 3], size_mm: [f64; 2], color: [f64; 3]| Led {
            position_mm: Some(at),
            size_mm: Some(size_mm),
            lobe: 1.0,
            color,
            intensity: 1.0,
            ..Led::default()
        };
        let polar = |degrees: f64, across: f64, up: f64| {
            let (sin, cos) = degrees.to_radians().sin_cos();
            [across * cos, across * sin, -up]
        };
        let [red, green, blue] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        [
            Self::new(
                "Mini",
                [19.2, 14.4],
                8.0,
                0.5,
                [0.0, 1.0],
                vec![
                    row([0.0, -10.0, -5.0], [12.0, 1.0], red),
                    row([12.0, 0.0, -5.0], [10.0, 1.0], green),
                    row([0.0, 10.0, -5.0], [12.0, 1.0], blue),
                ],
            ),
            Self::new(
                "DIGIT",
                [15.6, 21.0],
                8.0,
                0.45,
                [0.3, 5.0],
                vec![
                    row(polar(327.0, 13.0, 6.0), [2.0, 2.0], red),
                    row(polar(208.0, 13.0, 6.0), [2.0, 2.0], green),
                    row(polar(93.0, 14.0, 6.0), [2.0, 2.0], blue),
                ],
            ),
            Self::new(
                "2014",
                [19.2, 14.4],
                6.0,
                0.3,
                [1.0, 8.0],
                vec![
                    row([13.0, 0.0, -2.5], [10.0, 1.0], [0.5, 0.5, 0.5]),
                    row([0.0, 11.0, -2.5], [14.0, 1.0], [0.15, 0.3, 1.0]),
                    row([-13.0, 0.0, -2.5], [10.0, 1.0], [1.0, 0.2, 0.2]),
                    row([0.0, -11.0, -2.5], [14.0, 1.0], [0.15, 1.0, 0.35]),
                ],
            ),
        ]
    }

    /// The sensor and the model of the light of a variant.
    fn variant(&self, variant: Variant) -> (Sensor, Model) {
        let mut sensor = self.sensor.clone();
        sensor.window = sensor.window.filter(|_| variant.window);
        sensor.coat = sensor.coat.filter(|_| variant.coat);
        let shadows = if variant.shadows { self.phong.shadows } else { Shadows::None };
        let phong = Phong { shadows, ..self.phong };
        (sensor, if variant.near { Model::Led(phong) } else { Model::Phong(phong) })
    }

    /// What the press changes at every pixel, levels.
    fn modelled(&self, contact: &Contact, variant: Variant) -> Vec<[f64; 3]> {
        let (sensor, model) = self.variant(variant);
        let view = camera_of(&sensor);
        let rest = grey(&view, 128);
        let light = light_of(&model, &sensor, contact, &rest);
        let [width, height] = view.resolution_px;
        let pixels = (0..width * height).map(|at| light_at(&light, &rest, at % width, at / width));
        pixels.map(|pixel| pixel.map(|value| 255.0 * (value - 128.0 / 255.0))).collect()
    }

    /// The levels that a variant is expected to leave out.
    fn expected(&self, contact: &Contact, variant: Variant) -> f64 {
        let (sensor, model) = self.variant(variant);
        let error = LightError::new(&model, &sensor.illumination(), [128.0; 3]).expect("light of LEDs");
        error.levels(contact, &camera_of(&sensor))
    }

    fn traced(&self, contact: &Contact, stride: usize, paths: u32) -> Grid<Ways> {
        let coat = self.sensor.coat.expect("kinds have a coat");
        let view = camera_of(&self.sensor);
        Scene::new(&self.sensor.led, self.sensor.window, coat.albedo, self.phong, view, &contact.surface)
            .trace(stride, paths, BOUNCES)
    }

    fn contact(&self, object: &str, depth_mm: f64, yaw_deg: f64) -> Contact {
        let Sensor { resolution_px: [width, height], field_of_view_mm: [x, y], .. } = self.sensor;
        let plan = plan(&format!(
            "dataset = {{ name = 'light', samples = 1 }}\nfidelity = 'standard'\nindentation.depth_mm = {depth_mm}\n\
             object = [{{ path = 'objects/{object}.obj' }}]\npose.yaw_deg = {yaw_deg}\n\
             sensor = {{ resolution_px = [{width}, {height}], field_of_view_mm = [{x}, {y}], gelpad_thickness_mm = 4.0 }}\n"
        ));
        // Traced at pixel centres: there light is compared.
        let mut contact = render(&plan, 0).impression.contact;
        contact.subpixel = None;
        contact
    }
}

/// Differences from what is traced, levels.
#[derive(Default)]
struct Off {
    sum: f64,
    count: f64,
    /// Pixels that are off by over 20 levels.
    over: usize,
}

impl Off {
    fn add(&mut self, found: [f64; 3], traced: [f64; 3]) {
        for (found, traced) in found.into_iter().zip(traced) {
            self.sum += (found - traced).abs();
            self.count += 1.0;
        }
        let most = found.into_iter().zip(traced).map(|(found, traced)| (found - traced).abs()).fold(0.0, f64::max);
        self.over += usize::from(most > 20.0);
    }

    fn mean(&self) -> f64 {
        self.sum / self.count
    }
}

/// How far a kind may be off, mean levels.
struct Bounds {
    /// Direct light.
    direct: f64,
    /// All light, its noise included.
    all: f64,
}

#[test]
fn light_is_that_of_traced_paths() {
    println!(
        "levels: change by the press; off: direct light, with mirror, all (pixels over 20); without mirror, without bounce"
    );
    let bounds = [
        [Bounds { direct: 1.5, all: 4.0 }, Bounds { direct: 0.9, all: 2.8 }],
        [Bounds { direct: 1.2, all: 4.2 }, Bounds { direct: 0.75, all: 2.9 }],
        [Bounds { direct: 3.0, all: 6.4 }, Bounds { direct: 2.2, all: 4.8 }],
    ];
    for (kind, bounds) in Kind::all().iter().zip(bounds) {
        let flat = kind.traced(&contact_of(&camera_of(&kind.sensor), |_| 0.0), STRIDE, paths());
        for (depth_mm, bounds) in [1.0, 0.5].into_iter().zip(bounds) {
            let mut light: [Off; 3] = std::array::from_fn(|_| Off::default());
            let mut variants: [Off; VARIANTS.len()] = std::array::from_fn(|_| Off::default());
            let mut expected = [0.0; VARIANTS.len()];
            for object in objects() {
                let contact = kind.contact(object, depth_mm, 20.0);
                compare(kind, &contact, &flat, &mut light, &mut variants);
                for (sum, (_, variant)) in expected.iter_mut().zip(VARIANTS) {
                    *sum += kind.expected(&contact, variant) / objects().count() as f64;
                }
            }
            let over_percent = 300.0 * variants[0].over as f64 / variants[0].count;
            let [change, direct, mirror] = light.each_ref().map(Off::mean);
            let found = variants.each_ref().map(Off::mean);
            let [all, no_mirror, no_bounce, ..] = found;
            println!(
                "{:5} {depth_mm:3} mm: {change:5.1}; {direct:4.2}, {mirror:4.2}, {all:4.2} ({over_percent:.1} %); {no_mirror:4.2}, {no_bounce:4.2}",
                kind.name
            );
            assert!(direct < bounds.direct && all < bounds.all, "{direct} {all}");
            assert!(
                no_mirror > 1.6 * all && no_bounce > all,
                "each effect is worth something: {no_mirror} {no_bounce}"
            );
            for ((name, _), (found, expected)) in VARIANTS.iter().zip(found.iter().zip(expected)) {
                println!("    {name}: {found:.1}, expected {expected:.1}");
                let ratio = expected / found;
                assert!((0.5..2.0).contains(&ratio), "{name}: {found} levels, {expected} were expected");
            }
        }
    }
}

/// Adds up what the press changes, and how far direct light and light with the mirror are off; and how far all light
/// is off by each variant.
fn compare(
    kind: &Kind,
    contact: &Contact,
    flat: &Grid<Ways>,
    light: &mut [Off; 3],
    variants: &mut [Off; VARIANTS.len()],
) {
    let traced = kind.traced(contact, STRIDE, paths());
    let modelled = |variant| kind.modelled(contact, variant);
    let [direct, mirror] = [DIRECT, Variant { coat: false, ..ALL }].map(modelled);
    let of_variants = VARIANTS.map(|(_, variant)| modelled(variant));
    for (number, (ways, rest)) in traced.data.iter().zip(&flat.data).enumerate() {
        let [x, y] = [number % traced.width, number / traced.width].map(|at| at * STRIDE + STRIDE / 2);
        if !is_near_contact(contact, x, y) {
            continue;
        }
        let levels = |of: &dyn Fn(&Ways) -> [f64; 3]| -> [f64; 3] {
            let (pressed, rest) = (of(ways), of(rest));
            std::array::from_fn(|k| 255.0 * (pressed[k] - rest[k]))
        };
        let all_light = levels(&Ways::all);
        let by_leds = levels(&|ways| ways.direct);
        let with_mirror = levels(&|ways| std::array::from_fn(|k| ways.direct[k] + ways.mirrored[k]));
        let at = y * contact.mask.width + x;
        let pairs = [([0.0; 3], all_light), (direct[at], by_leds), (mirror[at], with_mirror)];
        light.iter_mut().zip(pairs).for_each(|(off, (found, traced))| off.add(found, traced));
        variants.iter_mut().zip(&of_variants).for_each(|(off, found)| off.add(found[at], all_light));
    }
}

/// True within the contact and the millimetre around it.
fn is_near_contact(contact: &Contact, x: usize, y: usize) -> bool {
    let reach = (AROUND_MM / 0.06) as usize;
    let mut rows = y.saturating_sub(reach)..(y + reach + 1).min(contact.mask.height);
    let columns = x.saturating_sub(reach)..(x + reach + 1).min(contact.mask.width);
    rows.any(|y| contact.mask.row(y)[columns.clone()].iter().any(|value| *value > 0))
}

/// Writes what networks learn from and are tried on (`tests/transfer/light.py`) to the folder `GELSIM_LIGHT_PIXELS`.
///
/// A line of 24 numbers is a pixel: object, x and y from -1 to 1, normal x and y, height in mm, and the change of red,
/// green and blue in levels as traced, and by each of [`LEARNT`].
#[test]
fn pixels_for_networks() {
    let Ok(folder) = std::env::var("GELSIM_LIGHT_PIXELS") else {
        println!("skipped: GELSIM_LIGHT_PIXELS is to name a folder");
        return;
    };
    let stride = STRIDE / 2;
    for kind in Kind::all().iter().take(2) {
        let view = camera_of(&kind.sensor);
        let flat = kind.traced(&contact_of(&view, |_| 0.0), stride, paths());
        let mut text = String::new();
        for (number, object) in OBJECTS.iter().enumerate() {
            for (depth_mm, yaw_deg) in [(0.5, 20.0), (1.0, 110.0), (0.7, 245.0)] {
                let contact = kind.contact(object, depth_mm, yaw_deg);
                let traced = kind.traced(&contact, stride, paths());
                let learnt = LEARNT.map(|variant| kind.modelled(&contact, variant));
                let normals = surface_normals(&contact, &view);
                for (place, (ways, rest)) in traced.data.iter().zip(&flat.data).enumerate() {
                    let [x, y] = [place % traced.width, place / traced.width].map(|at| at * stride + stride / 2);
                    if !is_near_contact(&contact, x, y) {
                        continue;
                    }
                    let at = y * contact.mask.width + x;
                    let along = |at: usize, size: usize| (2 * at + 1) as f64 / size as f64 - 1.0;
                    let (all, rest) = (ways.all(), rest.all());
                    let change: [f64; 3] = std::array::from_fn(|k| 255.0 * (all[k] - rest[k]));
                    let height_mm = f64::from(contact.surface.at(x + 1, y + 1));
                    let [nx, ny, _] = normals[at].map(f64::from);
                    let first =
                        [number as f64, along(x, contact.mask.width), along(y, contact.mask.height), nx, ny, height_mm];
                    let numbers = first.into_iter().chain(change).chain(learnt.iter().flat_map(|found| found[at]));
                    let words: Vec<String> = numbers.map(|number| format!("{number:.4}")).collect();
                    text += &(words.join(" ") + "\n");
                }
            }
        }
        std::fs::write(std::path::Path::new(&folder).join(format!("{}.txt", kind.name)), text).expect("written");
    }
}

#[test]
fn a_small_led_over_a_flat_pad_and_its_image_give_what_closed_forms_say() {
    let led = Led {
        position_mm: Some([6.0, 0.0, -3.0]),
        size_mm: Some([0.01, 0.01]),
        lobe: 2.0,
        color: [1.0; 3],
        intensity: 1.0,
        ..Led::default()
    };
    let phong = Phong { diffuse: 0.5, specular: 0.0, ..Phong::default() };
    let window = Window { distance_mm: 7.0, refractive_index: 1.41 };
    let view = View { resolution_px: [41, 3], mm_per_px: [0.1; 2] };
    let traced = Scene::new(&[led], Some(window), 0.5, phong, view, &Grid::new(43, 5)).trace(1, 16, 2);
    for x in [0, 20, 33] {
        let ways = traced.data[41 + x];
        let across = 6.0 - (x as f64 - 20.0) * 0.1;
        // The axis goes to the middle of the view: (-6, -3) over its length.
        let at = |up: f64, aim_up: f64| {
            let square: f64 = across * across + up * up;
            let length = square.sqrt();
            let cosine = (across * 6.0 + up * aim_up) / (length * 45.0_f64.sqrt());
            45.0 / square * cosine.powi(2) * 0.5 * up / length
        };
        let direct = at(3.0, 3.0);
        // The image stands 11 mm up and shines up as the LED shines down.
        let up = 11.0_f64;
        let reflected = fresnel(1.41, up / across.hypot(up));
        let mirrored = at(up, -3.0) * reflected;
        assert!((ways.direct[0] - direct).abs() < 2e-3 * direct, "{} {direct}", ways.direct[0]);
        let expected = if across * 6.0 > up * 3.0 { mirrored } else { 0.0 };
        assert!((ways.mirrored[1] - expected).abs() < 5e-3 * direct, "{} {expected}", ways.mirrored[1]);
        assert_eq!(ways.bounced, [0.0; 3], "a flat pad throws no light at itself");
    }
}

#[test]
fn a_bowl_throws_even_light_at_itself() {
    // Of a ball's inner side, every piece receives the same share of what any other scatters: its area over the ball's.
    let (radius, wide) = (3.0_f64, 2.4_f64);
    let view = View { resolution_px: [121, 121], mm_per_px: [0.05; 2] };
    let bowl = contact_of(&view, |[x, y]| {
        let square = x * x + y * y;
        if square < wide * wide {
            (radius * radius - wide * wide).sqrt() - (radius * radius - square).sqrt()
        } else {
            0.0
        }
    });
    let overhead = Led {
        position_mm: Some([0.0, 0.0, -500.0]),
        size_mm: Some([0.01, 0.01]),
        color: [1.0; 3],
        intensity: 1.0,
        ..Led::default()
    };
    let phong = Phong { diffuse: 1.0, specular: 0.0, ..Phong::default() };
    let traced = Scene::new(&[overhead], None, 0.5, phong, view, &bowl.surface).trace(5, 1500, 1);
    let expected = 0.5 * wide * wide / (4.0 * radius * radius);
    let mut all = Vec::new();
    for (number, ways) in traced.data.iter().enumerate() {
        let [x, y] = [number % traced.width, number / traced.width].map(|at| ((at * 5 + 2) as f64 - 60.0) * 0.05);
        if x.hypot(y) < 0.85 * wide {
            let share = ways.bounced[0] / expected;
            assert!((share - 1.0).abs() < 0.3, "{x} {y}: {share}");
            all.push(share);
        }
    }
    let mean = all.iter().sum::<f64>() / all.len() as f64;
    assert!(all.len() > 150 && (mean - 1.0).abs() < 0.02, "{mean} of what is expected");
}

/// Runs with `GELSIM_MITSUBA` in the environment: a Python that has Mitsuba 3.
#[test]
fn the_traced_paths_are_those_of_mitsuba() {
    let Ok(python) = std::env::var("GELSIM_MITSUBA") else {
        println!("skipped: GELSIM_MITSUBA is to name a Python that has Mitsuba 3 (pip install mitsuba)");
        return;
    };
    let [mini, ..] = Kind::all();
    let view = View { resolution_px: [80, 60], mm_per_px: [0.1; 2] };
    // A ring: its inside throws light at itself.
    let contact = contact_of(&view, |[x, y]| 0.9 * (-((x - 0.5).hypot(y + 0.3) - 1.8).powi(2)).exp());
    let coat = mini.sensor.coat.expect("kinds have a coat");
    let scene = Scene::new(&mini.sensor.led, mini.sensor.window, coat.albedo, mini.phong, view, &contact.surface);
    let folder = tempfile::tempdir().expect("a folder");
    let [file, light] = ["scene.json", "light.json"].map(|name| folder.path().join(name));
    std::fs::write(&file, scene.describe().to_string()).expect("written");
    let script = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/oracle/mitsuba_light.py");
    let run = std::process::Command::new(python).args([&script, &file, &light]).output().expect("Python runs");
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let theirs: serde_json::Value = serde_json::from_slice(&std::fs::read(light).expect("written")).expect("JSON");
    let ours = scene.trace(1, 500, 1);
    // Means of blocks of 10 x 10 pixels: Mitsuba's paths meet the LEDs in the window by chance.
    let levels = |of: &dyn Fn(&Ways) -> [f64; 3], name: &str| {
        let theirs = theirs[name].as_array().expect("pixels");
        let mut blocks = vec![[[0.0; 3]; 2]; 8 * 6];
        for (number, (ways, theirs)) in ours.data.iter().zip(theirs).enumerate() {
            let block = &mut blocks[number / 80 / 10 * 8 + number % 80 / 10];
            for (k, ours) in of(ways).into_iter().enumerate() {
                block[0][k] += 255.0 / 100.0 * ours;
                block[1][k] += 255.0 / 100.0 * theirs[k].as_f64().expect("a number");
            }
        }
        let mut off = Off::default();
        blocks.iter().for_each(|[ours, theirs]| off.add(*ours, *theirs));
        let [ours, theirs] = [0, 1].map(|whose| blocks.iter().flat_map(|block| block[whose]).sum::<f64>());
        println!("{name}: {:.2} levels on the mean, {:.4} of Mitsuba's light", off.mean(), ours / theirs);
        (off.mean(), ours / theirs)
    };
    let (direct, of_direct) = levels(&|ways| ways.direct, "direct");
    let (mirrored, of_mirrored) = levels(&|ways| ways.mirrored, "mirrored");
    let (bounced, of_bounced) = levels(&|ways| ways.bounced, "bounced");
    assert!(direct < 0.5 && (of_direct - 1.0).abs() < 0.003, "{direct} {of_direct}");
    assert!(mirrored < 3.0 && (of_mirrored - 1.0).abs() < 0.04, "{mirrored} {of_mirrored}");
    assert!(bounced < 1.0 && (of_bounced - 1.0).abs() < 0.03, "{bounced} {of_bounced}");
}
