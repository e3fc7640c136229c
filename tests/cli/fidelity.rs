//! Fidelity levels, models and bounds: what each makes and says of itself, how a bound chooses a fidelity level, how
//! long that choice lasts, and that nothing of one sample is left in the next.

use std::fs;

use gelsim_core::fidelity::Fidelity;
use gelsim_core::gelpad::Model;
use gelsim_core::optics::LightSource;
use gelsim_files::diagnostic::Diagnostics;
use gelsim_job::config::fidelity::FidelityChoice;
use gelsim_job::config::{self, Overrides};
use gelsim_job::plan::Plan;
use gelsim_job::sample::Sample;
use gelsim_job::sample::render;
use gelsim_lab::tradeoff::choose::choose_level;
use serde_json::Value;

use crate::support::{Folder, JOB, assert_same_files, edited, exr_planes, json, repository};

/// [`JOB`] with a bound in the place of a fidelity level.
fn with_bound(bound: &str) -> Folder {
    Folder::with_job(&edited(JOB, &[("\n[dataset]", &format!("\nfidelity = {{ {bound} }}\n[dataset]"))]))
}

/// The level that the dataset `name` was made with, as its job says.
fn level_of_dataset(folder: &Folder, name: &str) -> String {
    let job: toml::Table = folder.read(&format!("{name}/job.toml")).parse().expect("TOML");
    job["fidelity"].as_str().expect("the name of a level").to_owned()
}

/// True if a run said that it chose a fidelity level.
fn says_it_chose(said: &str) -> bool {
    said.contains("note: fidelity ") && said.contains(" chosen: ")
}

fn plan(text: &str) -> Plan {
    let mut problems = Diagnostics::default();
    let folder = repository().join("objects");
    let written = config::read_job_text("job.toml", text.to_owned(), &folder, &Overrides::default(), &mut problems);
    Plan::resolve(written, problems).unwrap_or_else(|report| panic!("{report}"))
}

#[test]
fn every_level_names_itself_and_its_models_in_labels_and_job() {
    let folder = Folder::with_job(JOB);
    for level in Fidelity::ALL {
        let name = level.name();
        folder.succeed(&format!("generate job.toml --quiet --out {name} --fidelity {name}"));
        assert_eq!(level_of_dataset(&folder, name), name);
        let job: toml::Table = folder.read(&format!("{name}/job.toml")).parse().expect("TOML");
        let choices = level.models(LightSource::Leds);
        assert_eq!(job["gelpad"], toml::Value::try_from(&choices.gelpad).expect("TOML"));
        assert_eq!(job["optics"], toml::Value::try_from(&choices.optics).expect("TOML"));
        for label in folder.labels(name).values() {
            assert_eq!(label["fidelity"], name);
            assert_eq!(label["gelpad_model"], choices.gelpad.name());
            assert_eq!(label["optics_model"], choices.optics.name());
            assert_eq!(label["numerics"]["converged"], true, "{name}");
        }
    }
}

#[test]
fn the_level_of_a_job_is_the_same_as_that_of_the_command_line() {
    let folder = Folder::with_job(JOB);
    for level in ["paper", "draft"] {
        folder.write("own.toml", edited(JOB, &[("\n[dataset]", &format!("\nfidelity = \"{level}\"\n[dataset]"))]));
        folder.succeed(&format!("generate own.toml --quiet --out own-{level}"));
        folder.succeed(&format!("generate job.toml --quiet --out flag-{level} --fidelity {level}"));
        assert_same_files(
            &folder.lasting_files(&format!("own-{level}")),
            &folder.lasting_files(&format!("flag-{level}")),
        );
    }
    folder.succeed("generate job.toml --quiet --out silent");
    assert_eq!(level_of_dataset(&folder, "silent"), Fidelity::default().name(), "a job that says nothing");
}

#[test]
fn every_model_names_itself_and_knows_force_and_pressure_or_says_null() {
    let folder = Folder::with_job(JOB);
    for model in ["none", "mean_blur", "gaussian", "elastic", "finite_strain"] {
        let solves = ["elastic", "finite_strain"].contains(&model);
        folder.succeed(&format!("generate job.toml --quiet --out {model} --set gelpad=\"{model}\""));
        let mut touching = 0;
        for label in folder.labels(model).values() {
            assert_eq!((&label["gelpad_model"], &label["fidelity"]), (&model.into(), &"standard".into()));
            let contact = &label["contact"];
            let in_contact = contact["in_contact"] == true;
            touching += u32::from(in_contact);
            for figure in [&contact["force_n"], &contact["peak_pressure_kpa"], &label["numerics"]["model_error_um"]] {
                match figure.as_f64() {
                    None => assert!(figure.is_null() && !solves, "{model}: {figure}"),
                    Some(number) => assert!(solves && (number > 0.0) == in_contact, "{model}: {label}"),
                }
            }
        }
        assert!((1..8).contains(&touching), "samples with and without contact must have been seen");
    }
}

#[test]
fn every_model_that_is_left_out_of_no_level_makes_another_surface() {
    let folder = Folder::with_job(&edited(JOB, &[("[\"depth\", \"contact\"]", "[\"surface\"]")]));
    let models = ["none", "mean_blur", "gaussian", "elastic"];
    for model in models {
        folder.succeed(&format!("generate job.toml --quiet --out {model} --samples 4 --set gelpad=\"{model}\""));
    }
    let surfaces = models.map(|model| folder.samples(model)["000000001"]["surface.exr"].clone());
    for (i, surface) in surfaces.iter().enumerate() {
        assert!(!surfaces[..i].contains(surface), "{} is like one before", models[i]);
    }
}

#[test]
fn the_pressure_layer_adds_up_to_the_force_and_reaches_the_peak() {
    let job = edited(JOB, &[("[\"depth\", \"contact\"]", "[\"pressure\", \"contact\"]")]);
    // Square pixels and others, and a pad that is none too thick.
    for (number, sensor) in ["", " --set sensor.field_of_view_mm=[20.0,7.5]", " --set sensor.gelpad_thickness_mm=1.5"]
        .into_iter()
        .enumerate()
    {
        let folder = Folder::with_job(&job);
        for level in ["draft", "standard", "high", "reference"] {
            let out = format!("{level}-{number}");
            let flags = format!("--out {out} --fidelity {level}{sensor}");
            folder.succeed(&format!("generate job.toml --quiet --set output.exr.pixel=\"float\" {flags}"));
            let mut pressed = 0;
            for members in folder.samples(&out).values() {
                let label: Value = serde_json::from_slice(&members["json"]).expect("a label");
                let mut planes = exr_planes(&members["pressure.exr"]);
                assert_eq!((planes.len(), planes[0].0.as_str()), (1, "P"));
                let kpa = planes.remove(0).1;
                assert!(kpa.iter().all(|kpa| *kpa >= 0.0 && kpa.is_finite()));
                let area = label["sensor"]["mm_per_px"].as_array().expect("a pair").iter();
                let mm2_per_px: f64 = area.map(|side| side.as_f64().expect("a number")).product();
                let sum: f64 = kpa.iter().map(|kpa| f64::from(*kpa)).sum();
                let (found, force) = (sum * mm2_per_px * 1e-3, label["contact"]["force_n"].as_f64().expect("N"));
                assert!((found - force).abs() <= 1e-12 * force, "{found} N in the layer, {force} N in the label");
                let peak = f64::from(kpa.iter().copied().fold(0.0, f32::max));
                assert_eq!(Some(peak), label["contact"]["peak_pressure_kpa"].as_f64());
                // Where there is pressure there is contact.
                let mask = image::load_from_memory(&members["contact.png"]).expect("a PNG").into_luma8();
                assert!(kpa.iter().zip(mask.pixels()).all(|(kpa, mask)| *kpa == 0.0 || mask.0 == [255]));
                pressed += u32::from(force > 0.0);
                // A solver's grid that is coarser than the image misses a tip between its points: contact without force.
                let in_contact = label["contact"]["in_contact"] == true;
                assert!(in_contact == (force > 0.0) || in_contact && matches!(level, "draft" | "standard"), "{label}");
            }
            assert!((1..8).contains(&pressed), "samples with and without force must have been seen");
        }
    }
}

#[test]
fn a_bound_chooses_the_cheapest_level_that_keeps_it() {
    let plan = plan(JOB);
    let indices: Vec<u64> = (0..plan.layout.sample_count()).collect();
    let samples =
        |level| indices.iter().map(|index| render(&plan.with_fidelity(level), *index)).collect::<Vec<Sample>>();
    let exact = samples(Fidelity::Reference);
    // In 64 bits, over the view; the worst sample counts.
    let worst = |level| {
        let rms = |(sample, exact): (&Sample, &Sample)| {
            let (a, b) = (sample.impression.surface_mm(), exact.impression.surface_mm());
            let squares = a.iter().zip(&b).map(|(a, b)| (1e3 * (f64::from(*a) - f64::from(*b))).powi(2));
            (squares.sum::<f64>() / a.len() as f64).sqrt()
        };
        samples(level).iter().zip(&exact).map(rms).fold(0.0, f64::max)
    };
    let errors = Fidelity::ALL.map(worst);
    assert_eq!(errors[4], 0.0);
    let mut chosen = Vec::new();
    for bound in errors.iter().flat_map(|um| [um * 0.999, um * 1.001]).chain([1e-3, 1e5]).filter(|um| *um > 0.0) {
        let expected =
            Fidelity::ALL.into_iter().zip(errors).find(|(_, um)| *um <= bound).expect("the reference keeps any");
        let found = choose_level(&plan, FidelityChoice::MaxErrorUm(bound)).unwrap_or_else(|report| panic!("{report}"));
        assert_eq!(found.level, expected.0, "{bound} um of {errors:?}");
        assert!((found.error_um - expected.1).abs() <= 1e-9 * expected.1, "{} um", found.error_um);
        chosen.push(found.level);
    }
    chosen.sort_by_key(|level| level.name());
    chosen.dedup();
    assert!(chosen.len() >= 4, "the bounds must tell levels apart: {chosen:?}");
}

#[test]
fn the_chosen_level_is_recorded_and_makes_the_bytes_that_the_level_makes_by_name() {
    for (bound, expected) in
        [("max_error_um = 1e5", "paper"), ("max_error_um = 0.001", "reference"), ("max_ms = 1e6", "reference")]
    {
        let folder = with_bound(bound);
        let said = folder.succeed("generate job.toml --out own");
        assert!(said.contains(&format!("note: fidelity {expected} chosen: ")), "{said}");
        assert!(
            said.contains(" um from the reference in the worst of 8 samples, ") && said.contains(" ms a sample"),
            "{said}"
        );
        assert_eq!(level_of_dataset(&folder, "own"), expected);
        folder.succeed(&format!("generate job.toml --quiet --out named --fidelity {expected}"));
        assert_same_files(&folder.lasting_files("own"), &folder.lasting_files("named"));
        let again = folder.succeed("generate own/job.toml --out again");
        assert!(!says_it_chose(&again), "{again}");
        assert_same_files(&folder.lasting_files("own"), &folder.lasting_files("again"));
        assert!(folder.labels("own").values().all(|label| label["fidelity"] == expected));
    }
}

#[test]
fn a_bound_leaves_the_light_that_the_job_names() {
    let folder = with_bound("max_error_um = 1e5");
    folder.succeed(
        "generate job.toml --quiet --out dark --set optics.phong.darkening=0.0 --set optics.phong.diffuse=0.9",
    );
    let job: toml::Table = folder.read("dark/job.toml").parse().expect("TOML");
    let phong = &job["optics"]["phong"];
    assert_eq!((phong["darkening"].as_float(), phong["diffuse"].as_float()), (Some(0.0), Some(0.9)));
    folder.succeed("generate dark/job.toml --quiet --out again");
    assert_same_files(&folder.lasting_files("dark"), &folder.lasting_files("again"));
    folder.succeed("generate job.toml --quiet --out plain");
    assert_ne!(folder.samples("dark"), folder.samples("plain"));
}

#[test]
fn a_run_that_goes_on_keeps_the_level_it_began_with_and_does_not_choose_again() {
    let folder = with_bound("max_error_um = 1e5");
    assert!(says_it_chose(&folder.succeed("generate job.toml --out complete")));
    folder.succeed("generate job.toml --quiet --out out");
    fs::remove_file(folder.path("out/data/val-000000.tar")).expect("a shard");
    let said = folder.succeed("generate job.toml --out out");
    assert!(!says_it_chose(&said) && said.contains(" in 1 shard,"), "{said}");
    assert_same_files(&folder.lasting_files("complete"), &folder.lasting_files("out"));
    // A folder that was begun with a fidelity level that the bound would not choose.
    folder.succeed("generate job.toml --quiet --out draft --fidelity draft --shards 0..1");
    let said = folder.succeed("generate job.toml --out draft");
    assert!(!says_it_chose(&said) && said.contains("1 shard was there already"), "{said}");
    assert!(folder.labels("draft").values().all(|label| label["fidelity"] == "draft"));
    assert_eq!(json(&folder, "draft/dataset.json")["samples"], 8);
}

#[test]
fn overwriting_chooses_again() {
    let folder = with_bound("max_error_um = 1e5");
    folder.succeed("generate job.toml --quiet --out out --fidelity draft");
    assert_eq!(level_of_dataset(&folder, "out"), "draft");
    let said = folder.succeed("generate job.toml --out out --overwrite");
    assert!(says_it_chose(&said), "{said}");
    assert_eq!(level_of_dataset(&folder, "out"), "paper");
    folder.succeed("generate job.toml --quiet --out fresh");
    assert_same_files(&folder.lasting_files("fresh"), &folder.lasting_files("out"));
}

#[test]
fn parts_cannot_choose_but_may_go_on_with_what_was_chosen() {
    let folder = with_bound("max_error_um = 1e5");
    folder.succeed("generate job.toml --quiet --out complete");
    for flags in ["--partition 0/2", "--shards 0..1", "--partition 0/1", "--partition 0/2 --overwrite"] {
        let text = folder.fail(&format!("generate job.toml --out parts {flags}"), 2);
        assert!(text.contains("error: parts of a dataset cannot each choose their own fidelity"), "{text}");
        assert!(text.contains("--fidelity") && text.contains("gelsim tradeoff"), "{text}");
        assert!(!folder.path("parts").exists(), "nothing may be written");
    }
    folder.succeed("generate job.toml --quiet --out parts");
    for shard in ["train-000000", "train-000001", "val-000000", "test-000000"] {
        fs::remove_file(folder.path(&format!("parts/data/{shard}.tar"))).expect("a shard");
    }
    for part in ["--partition 1/2", "--shards 0..1", "--partition 0/2"] {
        assert!(!says_it_chose(&folder.succeed(&format!("generate job.toml --out parts {part}"))));
    }
    assert_same_files(&folder.lasting_files("complete"), &folder.lasting_files("parts"));
    // Named, a fidelity level needs no choice.
    folder.succeed("generate job.toml --quiet --out named --fidelity paper --partition 0/2");
    folder.succeed("generate job.toml --quiet --out named --fidelity paper --partition 1/2");
    assert_same_files(&folder.lasting_files("complete"), &folder.lasting_files("named"));
}

#[test]
fn a_level_on_the_command_line_replaces_a_bound_without_probing() {
    let folder = with_bound("max_ms = 0.001");
    for level in ["paper", "high"] {
        let said = folder.succeed(&format!("generate job.toml --out {level} --fidelity {level}"));
        assert!(!says_it_chose(&said), "{said}");
        assert_eq!(level_of_dataset(&folder, level), level);
    }
    let said = folder.succeed("generate job.toml --out set --set fidelity=\"draft\"");
    assert!(!says_it_chose(&said) && level_of_dataset(&folder, "set") == "draft", "{said}");
    // And a bound on the command line replaces a fidelity level.
    let folder = Folder::with_job(&edited(JOB, &[("\n[dataset]", "\nfidelity = \"high\"\n[dataset]")]));
    let said = folder.succeed("generate job.toml --out out --set fidelity={max_error_um=99999}");
    assert!(says_it_chose(&said) && level_of_dataset(&folder, "out") == "paper", "{said}");
}

#[test]
fn a_time_that_no_level_keeps_is_refused_with_what_was_measured() {
    let folder = with_bound("max_ms = 0.001");
    for command in ["generate job.toml", "generate job.toml --quiet", "preview job.toml --out sheet.png"] {
        let text = folder.fail(command, 2);
        assert!(text.contains("error: no fidelity level renders a sample of this job in 0.001 ms"), "{text}");
        assert!(!text.contains("finite-strain"), "no bound chooses it: {text}");
        for level in Fidelity::ALL.into_iter().filter(|level| *level != Fidelity::FiniteStrain) {
            let figures =
                text.split_once(&format!(" {} ", level.name())).unwrap_or_else(|| panic!("{level:?}: {text}")).1;
            let (ms, rest) = figures.split_once(" ms, ").expect("a time");
            let (um, _) = rest.split_once(" um").expect("an error");
            let (ms, um): (f64, f64) = (ms.parse().expect("ms"), um.parse().expect("um"));
            assert!(ms >= 0.0 && (um > 0.0) == (level != Fidelity::Reference), "{text}");
        }
        assert!(!folder.path("out").exists() && !folder.path("sheet.png").exists(), "nothing may be written");
    }
    // What is advised is kept.
    let said = folder.fail("preview job.toml --out sheet.png", 2);
    let bound =
        said.split_once("for example fidelity = ").and_then(|(_, rest)| rest.split_once(", or ")).expect("a bound").0;
    folder.succeed(&format!("preview job.toml --out sheet.png --set fidelity={}", bound.replace(' ', "")));
    let named =
        said.split_once("name a level, for example ").and_then(|(_, rest)| rest.split_once(';')).expect("a level").0;
    folder.succeed(&format!("preview job.toml --out named.png {named}"));
    let only_elastic = edited(&folder.read("job.toml"), &[("\"contact\"]", "\"pressure\"]")]);
    let text = Folder::with_job(&only_elastic).fail("generate job.toml", 2);
    assert!(!text.contains("paper") && text.contains("draft"), "a level without the layer is no choice: {text}");
}

#[test]
fn a_level_that_lacks_a_layer_is_not_chosen() {
    let job = edited(
        JOB,
        &[("\n[dataset]", "\nfidelity = { max_error_um = 1e5 }\n[dataset]"), ("\"contact\"]", "\"pressure\"]")],
    );
    let folder = Folder::with_job(&job);
    folder.succeed("generate job.toml --quiet --out out");
    assert_eq!(level_of_dataset(&folder, "out"), "draft");
    let first = Fidelity::ALL.into_iter().find(|level| level.models(LightSource::Leds).gelpad.knows_pressure());
    assert_eq!(first, Some(Fidelity::Draft));
}

#[test]
fn a_level_that_the_job_could_not_name_is_not_chosen() {
    let bound = ("\n[dataset]", "\nfidelity = { max_error_um = 1e5 }\n[dataset]");
    let soft = ("path = \"cone.obj\"", "path = \"cone.obj\"\nyoungs_modulus_kpa = 100.0");
    for (what, with) in [("\"contact\"]", "\"flow\"]"), soft] {
        let folder = Folder::with_job(&edited(JOB, &[bound, (what, with)]));
        folder.succeed("generate job.toml --quiet --out out");
        assert_eq!(level_of_dataset(&folder, "out"), "draft", "{with}");
        let named = edited(JOB, &[("\n[dataset]", "\nfidelity = \"paper\"\n[dataset]"), (what, with)]);
        Folder::with_job(&named).fail("generate job.toml", 2);
    }
}

#[test]
fn a_preview_of_a_job_with_a_bound_shows_the_level_that_it_chooses() {
    let folder = with_bound("max_error_um = 1e5");
    let said = folder.succeed("preview job.toml --key 1 --out own.png");
    assert!(says_it_chose(&said), "{said}");
    folder.succeed("preview job.toml --key 1 --out named.png --fidelity paper");
    folder.succeed("preview job.toml --key 1 --out other.png --fidelity draft");
    let picture = |name: &str| fs::read(folder.path(name)).expect("a picture");
    assert!(picture("own.png") == picture("named.png"));
    assert!(picture("own.png") != picture("other.png"));
}

#[test]
fn tars_of_elastic_levels_are_the_same_for_every_division_of_the_work() {
    let layers = ("[\"depth\", \"contact\"]", "[\"surface\", \"pressure\", \"normal\"]");
    let folder = Folder::with_job(&edited(JOB, &[layers]));
    for level in ["draft", "standard", "high"] {
        let run = |out: &str, flags: &str| {
            let flags = format!("--samples 24 --fidelity {level} --out {level}-{out} {flags}");
            folder.succeed(&format!("generate job.toml --quiet {flags}"));
        };
        run("one", "--threads 1");
        run("two", "--threads 2");
        for part in [2, 0, 1] {
            run("parts", &format!("--threads 2 --partition {part}/3"));
        }
        let one = folder.lasting_files(&format!("{level}-one"));
        for other in ["two", "parts"] {
            assert_same_files(&one, &folder.lasting_files(&format!("{level}-{other}")));
        }
    }
}

/// Everything of a sample that is written, as bits.
fn bits(sample: &Sample) -> (Vec<u8>, Vec<u32>, Vec<u32>, String) {
    let bits = |values: &[f32]| values.iter().map(|value| value.to_bits()).collect::<Vec<u32>>();
    let pressure = sample.impression.contact.pressure.as_ref().map_or(Vec::new(), |pressure| bits(&pressure.data));
    let label = serde_json::to_string(&sample.label).expect("JSON");
    (sample.impression.image.rgb.clone(), bits(&sample.impression.contact.surface.data), pressure, label)
}

#[test]
fn nothing_of_a_sample_is_left_in_the_next_one() {
    let variant = |edits: &[(&str, &str)]| plan(&edited(JOB, edits));
    let coarse = ("[48, 36]", "[31, 17]\ngelpad_thickness_mm = 2.0");
    let long = ("[48, 36]", "[96, 8]\nfield_of_view_mm = [20.0, 3.0]\ngelpad_poisson_ratio = 0.3");
    let objects = ("\"cube.obj\"", "\"sphere.obj\"\n[[object]]\npath = \"dots.obj\"");
    let plans = [variant(&[]), variant(&[coarse, objects]), variant(&[long, objects])];
    let levels = [Fidelity::High, Fidelity::Draft, Fidelity::Standard, Fidelity::Paper];
    let plans: Vec<Plan> = plans.iter().flat_map(|plan| levels.map(|level| plan.with_fidelity(level))).collect();
    // Alone: on a thread that has rendered nothing yet.
    let alone = |plan: &Plan, index| {
        std::thread::scope(|scope| scope.spawn(|| bits(&render(plan, index))).join().expect("a sample"))
    };
    let mut pressed = 0;
    for index in 0..8 {
        for plan in &plans {
            let sample = render(plan, index);
            pressed += u32::from(sample.label.contact.force_n > Some(0.0));
            assert!(bits(&sample) == alone(plan, index), "sample {index} at {}", plan.fidelity().name());
        }
    }
    assert!(pressed > 30, "{pressed} samples with force");
}

#[test]
fn the_list_of_levels_tells_what_each_chooses_from_cheap_to_exact() {
    let folder = Folder::new();
    let listed = |arguments: &str| {
        let assert = folder.gelsim(arguments).assert().success().stderr("");
        String::from_utf8(assert.get_output().stdout.clone()).expect("UTF-8")
    };
    let text = listed("list levels");
    assert_eq!(text, listed("list rungs"), "their name in older scripts");
    assert!(!text.contains(['{', '"']), "{text}");
    let names: Vec<&str> =
        text.lines().filter(|line| !line.starts_with(' ')).filter_map(|line| line.split(' ').next()).collect();
    assert_eq!(names, Fidelity::ALL.map(Fidelity::name));
    let levels: Vec<serde_json::Value> = serde_json::from_str(&listed("list levels --json")).expect("JSON");
    assert_eq!(levels.len(), Fidelity::ALL.len());
    for (listed, level) in levels.iter().zip(Fidelity::ALL) {
        assert_eq!(listed["name"], level.name());
        let model: Model = serde_json::from_value(listed["gelpad"].clone()).expect("the model as a job has it");
        assert_eq!(model, level.models(LightSource::Leds).gelpad);
    }
}

#[test]
fn pads_and_pixels_at_the_ends_of_their_ranges_are_rendered_at_every_level() {
    let mut views = 0;
    for edit in [
        // Far thinner than a pixel is wide, and thin with many pixels to the thickness.
        "gelpad_thickness_mm = 0.05",
        "gelpad_thickness_mm = 0.05\nfield_of_view_mm = [0.5, 0.4]",
        "gelpad_thickness_mm = 1000.0",
        "gelpad_poisson_ratio = 0.0",
        "gelpad_poisson_ratio = 0.4999\ngelpad_thickness_mm = 0.5",
        "field_of_view_mm = [20.0, 1.5]",
        "field_of_view_mm = [10000.0, 10000.0]",
        "field_of_view_mm = [0.001, 0.001]",
    ] {
        for size in ["[48, 36]", "[1, 64]", "[1, 1]"] {
            // Every depth, or one after the other.
            let depths = ["1e-6", "0.02", "0.049"];
            views += 1;
            for &depth in if crate::thorough() { &depths[..] } else { &depths[(views + views / 3) % 3..][..1] } {
                let edits =
                    [("[48, 36]", format!("{size}\n{edit}")), ("{ log_uniform = [0.3, 1.2] }", depth.to_owned())];
                let edits: Vec<(&str, &str)> = edits.iter().map(|(from, to)| (*from, to.as_str())).collect();
                let plan = plan(&edited(JOB, &edits));
                for level in Fidelity::ALL {
                    let label = render(&plan.with_fidelity(level), 1).label;
                    assert!(label.health.finite, "{edit}, {size} px, {depth} mm at {}", level.name());
                    let force = label.contact.force_n;
                    assert!(force.is_none_or(|n| n.is_finite() && n >= 0.0), "{force:?}");
                }
            }
        }
    }
}
