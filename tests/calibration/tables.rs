//! What holds for the light of every table: nothing where the pad is flat, bounded and finite whatever the surface, the
//! same on every processor and with any number of threads, at every level, and from its file.

use std::sync::LazyLock;

use gelsim_core::base::light::Light;
use gelsim_core::base::simd;
use gelsim_core::effects::EffectPolicy;
use gelsim_core::fidelity::Fidelity;
use gelsim_core::gelpad::Contact;
use gelsim_core::optics::calibrated::CalibrationTable;
use gelsim_dataset::encode::to_json_line;
use gelsim_files::sensor::Sensor;
use gelsim_job::sample::render;
use gelsim_lab::calibrate::run::{Calibration, CalibrationRequest, calibrate};
use gelsim_lab::calibrate::train::TrainingSettings;
use image::RgbImage;

use super::recovery::GOOD;
use super::sensor::{BACKGROUND, BALLS, CAMERA, UNSEEN, light, presses, rest, session, surface};
use crate::plan::plan;

/// Distances of the pixels between which light is interpolated, mm: the levels', a wide one, none.
const SPACINGS_MM: [f64; 3] = [0.25, 0.6, 0.0];

static TABLE: LazyLock<CalibrationTable> = LazyLock::new(|| GOOD.table.clone());

fn picture(light: &Light) -> RgbImage {
    gelsim_lab::calibrate::light_to_rgb(light, &rest())
}

/// Some presses of every object.
fn contacts() -> impl Iterator<Item = &'static Contact> {
    UNSEEN.iter().flat_map(|(_, presses)| presses.iter().take(2)).map(|press| &press.contact)
}

#[test]
fn a_flat_pad_is_the_background_byte_for_byte() {
    let flat = &presses("sphere", "", "0.3\nindentation.no_contact = 1.0", 1)[0].contact;
    assert!(flat.surface.data.iter().all(|w| *w == 0.0));
    for spacing_mm in SPACINGS_MM {
        for gate in [EffectPolicy::WhereNeeded, EffectPolicy::All] {
            assert!(picture(&light(&TABLE, spacing_mm, flat, gate)) == *BACKGROUND, "{spacing_mm} mm {gate:?}");
        }
    }
}

#[test]
fn no_surface_gives_light_that_is_not_finite_or_beyond_its_bound() {
    let like = &BALLS[0].contact;
    let wide = like.surface.width as f32;
    let mut random = gelsim_core::base::rng::random_stream(8, "relief", 0);
    let rough: Vec<f32> = like.surface.data.iter().map(|_| 3.5 * random.uniform() as f32).collect();
    let surfaces = [
        ("all pressed down to the shell", surface(like, |_, _| 3.5)),
        ("a wall", surface(like, |x, _| if x > 100 { 1e3 } else { 0.0 })),
        ("a chequered one", surface(like, |x, y| if (x + y) % 2 == 0 { 3.5 } else { -1.0 })),
        ("noise", surface(like, |x, y| rough[y * like.surface.width + x])),
        ("a spike", surface(like, |x, y| if (x, y) == (90, 70) { 1e6 } else { 0.0 })),
        ("a bulge as high as a hill", surface(like, |_, _| -1e6)),
        ("a ramp", surface(like, |x, _| 10.0 * x as f32 / wide)),
        ("steps in a corner", surface(like, |x, y| if x < 9 && y < 9 { (x * y) as f32 } else { 0.0 })),
    ];
    for (name, contact) in &surfaces {
        for spacing_mm in SPACINGS_MM {
            let light = light(&TABLE, spacing_mm, contact, EffectPolicy::All);
            let at_rest = rest().light(light.region);
            let values = light.planes.iter().flatten().zip(at_rest.planes.iter().flatten());
            let most = values.map(|(value, rest)| (value - rest).abs()).fold(0.0, |most, change| {
                assert!(change.is_finite(), "{name}");
                f32::max(most, change)
            });
            println!("{name}, {spacing_mm} mm: changes by {most:.2} of full scale");
            assert!(most < 1.6, "{name}, {spacing_mm} mm: changes by {most} of full scale");
        }
    }
}

#[test]
fn what_is_left_out_beyond_the_press_is_less_than_a_level() {
    // The halos of presses fill the view; those of dents this small do not.
    let dent = |x0: f32, y0: f32, deep: f32| {
        surface(&BALLS[0].contact, move |x, y| {
            let away = ((x as f32 - x0) * (x as f32 - x0) + (y as f32 - y0) * (y as f32 - y0)).sqrt();
            deep * (1.0 / (1.0 + (away / 6.0) * (away / 6.0)) - 0.002).max(0.0)
        })
    };
    let dents = [dent(40.0, 40.0, 0.1), dent(150.0, 20.0, 0.3), dent(100.0, 149.0, 0.03), dent(-3.0, 70.0, 0.2)];
    let mut left_out = 0;
    for contact in contacts().cloned().chain(dents) {
        let contact = &contact;
        for spacing_mm in SPACINGS_MM {
            let [some, all] =
                [EffectPolicy::WhereNeeded, EffectPolicy::All].map(|gate| light(&TABLE, spacing_mm, contact, gate));
            left_out += all.region.area() - some.region.area();
            let most = picture(&some).iter().zip(picture(&all).iter()).map(|(a, b)| a.abs_diff(*b)).max();
            assert!(most <= Some(1), "{most:?} levels at {spacing_mm} mm");
        }
    }
    assert!(left_out > 0, "nothing was ever left out");
}

#[test]
fn processors_without_wide_vectors_give_the_same_bits() {
    for contact in contacts() {
        for spacing_mm in SPACINGS_MM {
            let bits = |light: Light| light.planes.map(|plane| plane.into_iter().map(f32::to_bits).collect::<Vec<_>>());
            let shade = || bits(light(&TABLE, spacing_mm, contact, EffectPolicy::WhereNeeded));
            let own = shade();
            assert!(!own[0].is_empty() && own == simd::scalar_only(shade), "{spacing_mm} mm");
        }
    }
}

#[test]
fn the_number_of_threads_moves_no_bit_of_a_table() {
    let settings = TrainingSettings { networks: 2, units: 6, steps: 30, batch: 256, rate: 1e-2, decay: 0.1 };
    let request =
        CalibrationRequest { thickness_mm: None, contact_over_disc: Some(0.95), drops_outliers: true, settings };
    let on = |threads: usize| -> Calibration {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| calibrate(session(BALLS.iter().take(8)), &request)).expect("presses enough")
    };
    let (one, many) = (on(1), on(5));
    assert!(one.table == many.table && one.geometry == many.geometry);
    let pictures =
        |found: &Calibration| found.held_out.iter().map(|held_out| held_out.simulated.clone()).collect::<Vec<_>>();
    assert!(pictures(&one) == pictures(&many));
}

#[test]
fn a_table_is_the_same_from_its_file() {
    assert_eq!(gelsim_files::calibration::parse_calibration(&to_json_line(&*TABLE)).as_ref(), Ok(&*TABLE));
}

#[test]
fn every_level_runs_and_nears_the_reference() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = |name: &str| folder.path().join(name);
    BACKGROUND.save(path("rest.png")).expect("an image");
    std::fs::write(path("table.json"), to_json_line(&*TABLE)).expect("a file");
    let sensor = Sensor {
        background: Some(String::from("rest.png")),
        calibration: Some(String::from("table.json")),
        ..GOOD.session.sensor_at_thickness(GOOD.geometry.thickness_mm)
    };
    std::fs::write(path("sensor.toml"), toml::to_string(&sensor).expect("TOML")).expect("a file");
    let plan = plan(&format!(
        "dataset = {{ name = 'levels', samples = 6, seed = 5 }}\nsensor.file = '{}'\nindentation.depth_mm = [0.3, 0.6]\n\
         object = [{{ path = 'objects/sphere.obj' }}, {{ path = 'objects/dots.obj' }}]\n\
         pose = {{ x_mm = [-3.0, 3.0], y_mm = [-2.0, 2.0] }}\noutput.layers = []\n",
        path("sensor.toml").display()
    ));
    assert_eq!((plan.simulator.models().optics.name(), *plan.simulator.view()), ("calibrated", CAMERA));
    let reference = plan.with_fidelity(Fidelity::Reference);
    // In the order of `Fidelity::ALL`, levels.
    for (level, bound) in Fidelity::ALL.into_iter().zip([20.0, 5.0, 3.0, 2.0, 0.0]) {
        let plan = plan.with_fidelity(level);
        let errors = (0..plan.layout.sample_count()).map(|index| {
            let (sample, best) = (render(&plan, index), render(&reference, index));
            assert!(
                sample.label.health.finite && sample.label.models.optics_model == "calibrated",
                "{:?}",
                sample.label.models
            );
            let [x0, y0, x1, y1] = best.label.contact.bbox_px.map(|px| px as usize);
            let at = |x: usize, y: usize| 3 * (y * CAMERA.resolution_px[0] + x);
            let rows = (y0..y1).flat_map(|y| at(x0, y)..at(x1, y));
            let levels = rows
                .clone()
                .map(|k| f64::from(sample.impression.image.rgb[k].abs_diff(best.impression.image.rgb[k])))
                .sum::<f64>();
            levels / rows.count().max(1) as f64
        });
        let error = errors.sum::<f64>() / plan.layout.sample_count() as f64;
        println!("{}: {error:.2} levels from the reference", level.name());
        assert!(error <= bound, "{}: {error} levels, at most {bound}", level.name());
    }
}
