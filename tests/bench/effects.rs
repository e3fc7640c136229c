//! What each effect takes beyond the sample without it, and what skipping saves: `cargo bench --bench effects`; with
//! `-- NAME`, only the effects with it in their name.
//!
//! Prints tables. Times are CPU ms of one thread at 640x480, medians of many samples rendered in turn with and without,
//! so that a machine that gets slower does so for both.

#[path = "../../src/memory.rs"]
mod memory;
#[path = "../physics/plan.rs"]
mod plan;

use gelsim_core::effects::EffectPolicy;
use gelsim_core::fidelity::Fidelity;
use gelsim_job::plan::Plan;
use gelsim_job::sample::render;
use gelsim_lab::metrics::statistics::median;

/// Renders of each plan.
const ROUNDS: u64 = 25;

fn job(object: &str, tables: &str) -> String {
    format!(
        "{tables}\n[dataset]\nname = \"bench\"\nsamples = 1000\n[[object]]\npath = \"objects/{object}.obj\"\n\
         [pose]\nyaw_deg = [0.0, 360.0]\ntilt_deg = [0.0, 3.0]\n[indentation]\ndepth_mm = 0.7\n"
    )
}

/// CPU ms of a sample of each plan, without its files: the medians.
fn medians(plans: &[&Plan]) -> Vec<f64> {
    let mut ms = vec![Vec::new(); plans.len()];
    for index in 0..ROUNDS {
        for (plan, ms) in plans.iter().zip(&mut ms) {
            // The better of two: the first one may have found caches cold.
            let again = || 1e3 * render(plan, index).seconds.simulation();
            ms.push(again().min(again()));
        }
    }
    ms.iter().map(|ms| median(ms).unwrap_or(0.0)).collect()
}

fn effects(filter: &str) {
    println!("{:<44} {:>9} {:>9} {:>9}", "effect", "without", "with", "CPU ms");
    let plain = "optics.phong.shadows = \"none\"";
    let shadows = |preset: &str| format!("[sensor]\npreset = \"{preset}\"\nresolution_px = [640, 480]\n");
    let none = |preset: &str| format!("{plain}\n{}", shadows(preset));
    let markers = "[markers]\n";
    let cases: Vec<(&str, &str, String, String)> = vec![
        ("shadows, 4 LEDs at 8.5 degrees, dots", "dots", plain.into(), String::new()),
        ("shadows, 3 LEDs at 20 degrees, dots", "dots", none("gelsight-2017"), shadows("gelsight-2017")),
        ("optics led instead of phong, dots", "dots", plain.into(), "optics.led.shadows = \"none\"".into()),
        (
            "4 rows in a window over a coat, ball",
            "sphere",
            format!("{plain}\n"),
            format!("[optics.led]\nspecular = 0.0\n[sensor]\nwindow.distance_mm = 6.0\ncoat.albedo = 0.3\n{ROWS}"),
        ),
        ("grain, dots", "dots", plain.into(), format!("{plain}\n[sensor.grain]\nheight_um = 1.0\nsize_mm = 0.1")),
        (
            "texture, dots, pad blurred",
            "dots",
            "gelpad = \"mean_blur\"".into(),
            format!("gelpad = \"mean_blur\"\n{KNURLED}"),
        ),
        (
            "texture, flat face over half the view, blurred",
            "flat_face",
            "gelpad = \"mean_blur\"".into(),
            format!("gelpad = \"mean_blur\"\n{KNURLED}"),
        ),
        ("texture, dots, contact solved too", "dots", String::new(), KNURLED.into()),
        ("dome, dots", "dots", String::new(), "[sensor.rest_shape.dome]\nradius_mm = 60.0".into()),
        ("markers, dots", "dots", String::new(), markers.into()),
        ("markers, gear", "gear", String::new(), markers.into()),
        ("shear that sticks, dots", "dots", markers.into(), format!("{markers}[shear]\nx_mm = 0.3\ntwist_deg = 5.0")),
        (
            "shear that slips, dots",
            "dots",
            markers.into(),
            format!(
                "{markers}[shear]\nx_mm = 0.3\ntwist_deg = 5.0\nfriction = {{ coulomb = {{ coefficient = 0.5 }} }}"
            ),
        ),
        (
            "noise, shot and read",
            "dots",
            String::new(),
            "[camera]\nread_noise_levels = 1.0\nshot_noise_levels = 2.0".into(),
        ),
        ("distortion", "dots", String::new(), "[camera]\ndistortion_k1 = 0.05".into()),
        ("defocus of 1 px", "dots", String::new(), "[camera]\ndefocus_mm = 0.03125".into()),
        ("vignette", "dots", String::new(), "[camera]\nvignette = 0.3".into()),
        ("exposure that differs", "dots", String::new(), "[camera]\nexposure = [0.9, 1.1]".into()),
    ];
    for (name, object, without, with) in cases.into_iter().filter(|case| case.0.contains(filter)) {
        let plans = [plan::plan(&job(object, &without)), plan::plan(&job(object, &with))];
        let ms = medians(&[&plans[0], &plans[1]]);
        println!("{name:<44} {:>9.2} {:>9.2} {:>9.2}", ms[0], ms[1], ms[1] - ms[0]);
    }
}

/// Rows of LEDs beside the pad.
const ROWS: &str = "led = [
    { position_mm = [13.0, 0.0, -2.5], size_mm = [10.0, 1.0], lobe = 1.0, color = [0.5, 0.5, 0.5] },
    { position_mm = [0.0, 11.0, -2.5], size_mm = [14.0, 1.0], lobe = 1.0, color = [0.15, 0.3, 1.0] },
    { position_mm = [-13.0, 0.0, -2.5], size_mm = [10.0, 1.0], lobe = 1.0, color = [1.0, 0.2, 0.2] },
    { position_mm = [0.0, -11.0, -2.5], size_mm = [14.0, 1.0], lobe = 1.0, color = [0.15, 1.0, 0.35] },
]";

const KNURLED: &str = "[texture]\npatterns = [\"knurled\"]\namplitude_mm = 0.05\nscale_mm = 0.8";

/// A contact that covers nothing, a tenth, and all of the image, at every rung.
fn extent() {
    println!("\n{:<10} {:>9} {:>9} {:>9} {:>14} {:>14}", "rung", "none", "a tenth", "all", "none/tenth", "tenth/all");
    let of = |object: &str, unit: &str, indentation: &str| {
        plan::plan(&format!(
            "[dataset]\nname = \"bench\"\nsamples = 1000\n[[object]]\npath = \"objects/{object}.obj\"\nunit = \"{unit}\"\n\
             [pose]\nyaw_deg = [0.0, 360.0]\n[indentation]\n{indentation}\n"
        ))
    };
    // A cube of 5 mm touches 8 % of the view; the flat face in cm is far wider than the view.
    let none = of("cube", "mm", "depth_mm = 0.7\nno_contact = 1.0");
    let tenth = of("cube", "mm", "depth_mm = 0.7");
    let all = of("flat_face", "cm", "depth_mm = 0.7");
    for rung in Fidelity::ALL {
        let plans = [none.with_fidelity(rung), tenth.with_fidelity(rung), all.with_fidelity(rung)];
        let ms = medians(&[&plans[0], &plans[1], &plans[2]]);
        let shares = (ms[0] / ms[1], ms[1] / ms[2]);
        let (none, tenth, all) = (ms[0], ms[1], ms[2]);
        println!("{:<10} {none:>9.2} {tenth:>9.2} {all:>9.2} {:>14.3} {:>14.3}", rung.name(), shares.0, shares.1);
    }
    let cover = render(&all, 0).label.contact.fraction;
    println!(
        "(the cube touches {:.3} of the view, the wide plate {cover:.3})",
        render(&tenth, 0).label.contact.fraction
    );
}

/// The bundled jobs with and without gating.
fn saved() {
    println!("\n{:<12} {:>12} {:>12} {:>9}", "job", "called for", "everywhere", "saved");
    for name in ["quickstart", "elementary", "randomized"] {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("configs/{name}.toml"));
        let called = match Plan::load(&path, &Default::default()) {
            Ok(plan) => plan,
            Err(report) => panic!("{report}"),
        };
        let everywhere = called.with_policy(EffectPolicy::All);
        let count = called.layout.sample_count().min(48);
        let step = called.layout.sample_count() / count;
        let mut ms = [0.0; 2];
        for k in 0..count {
            for (plan, ms) in [&called, &everywhere].into_iter().zip(&mut ms) {
                let again = || 1e3 * render(plan, k * step).seconds.simulation();
                *ms += again().min(again()) / count as f64;
            }
        }
        println!("{name:<12} {:>12.2} {:>12.2} {:>7.0} %", ms[0], ms[1], 100.0 * (1.0 - ms[0] / ms[1]));
    }
    println!("(CPU ms of a sample without its files, mean)");
}

fn main() {
    memory::keep_freed();
    // Under `cargo test --benches` it is only built.
    if std::env::args().any(|argument| argument == "--test") {
        return;
    }
    // Cargo adds an option.
    let filter = std::env::args().skip(1).find(|argument| !argument.starts_with('-'));
    effects(filter.as_deref().unwrap_or_default());
    if filter.is_some() {
        return;
    }
    extent();
    saved();
}
