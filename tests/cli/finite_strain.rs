//! The level `finite-strain` and the elastic model's `strain_correction`: their names, what their labels say, and what they are
//! refused beside.

use gelsim_core::depth::indenter::Indenter;
use gelsim_core::effects::EffectPolicy;
use gelsim_core::fidelity::{Fidelity, Models};
use gelsim_core::gelpad::elastic::shear::Friction;
use gelsim_core::sensor::{Sensor, SensorError};
use gelsim_core::simulator::{Press, PressError, Simulator};
use gelsim_files::sensor::load_preset;

use crate::support::{Folder, JOB, edited};

/// The job of [`JOB`] with keys at its top.
fn with(keys: &str) -> String {
    edited(JOB, &[("[dataset]", &format!("{keys}\n[dataset]"))])
}

#[test]
fn labels_say_by_which_theory_a_press_was_solved() {
    for (keys, model, theories) in [
        ("fidelity = \"paper\"", "mean_blur", ["none", "none"]),
        ("fidelity = \"high\"", "elastic", ["linear", "linear"]),
        ("fidelity = \"finite-strain\"", "finite_strain", ["linear", "finite_strain"]),
        ("gelpad = \"finite_strain\"", "finite_strain", ["linear", "finite_strain"]),
        ("gelpad.elastic.strain_correction = true", "elastic", ["linear", "finite_strain"]),
    ] {
        let folder = Folder::with_job(&with(keys));
        folder.succeed("generate job.toml --quiet --samples 4 --out out");
        for label in folder.labels("out").values() {
            assert_eq!(label["gelpad_model"], model, "{keys}");
            let numerics = &label["numerics"];
            assert!(theories.contains(&numerics["theory"].as_str().expect("a theory")), "{keys}: {numerics}");
            let effect = &label["effects"]["finite_strain"];
            let why = effect["reason"].as_str().expect("a reason");
            assert_eq!(why == "the gelpad model is linear", theories == ["linear"; 2], "{keys}: {effect}");
            if numerics["theory"] != "finite_strain" {
                for key in ["opened_mm", "strain_iterations", "strain_residual_um"] {
                    assert_eq!(numerics[key].as_f64(), Some(0.0), "{keys}, {key}: {numerics}");
                }
            }
        }
        // The dataset's own job renders it again.
        folder.succeed("generate out/job.toml --quiet --out again");
        assert_eq!(folder.labels("out"), folder.labels("again"), "{keys}");
        let says = folder.read("out/job.toml").contains("strain_correction");
        assert_eq!(says, keys.contains("strain_correction"), "{keys}");
    }
}

#[test]
fn the_level_is_found_by_other_names() {
    for name in ["finite_strain", "finitestrain", "Finite-Strain", "nonlinear", "neo-hookean"] {
        let said = Folder::with_job(&with(&format!("fidelity = \"{name}\""))).fail("plan job.toml", 2);
        assert!(said.contains("did you mean `finite-strain`?"), "{said}");
        let said = Folder::with_job(JOB).fail(&format!("plan job.toml --fidelity {name}"), 2);
        assert!(said.contains("finite-strain"), "{said}");
        if name != "finite_strain" {
            let said = Folder::with_job(&with(&format!("gelpad = \"{name}\""))).fail("plan job.toml", 2);
            assert!(said.contains("did you mean `finite_strain`?"), "{said}");
        }
    }
}

#[test]
fn what_finite_strain_is_not_solved_for_is_refused_with_a_way_out() {
    let sequence =
        "[sequence]\nframe_rate_hz = 10.0\n[[sequence.phase]]\nname = \"press\"\nduration_s = 0.2\ndepth_mm = 0.5\n";
    let pressed = JOB.split_once("[indentation]").expect("a depth").0;
    let rest = JOB.split_once("[output]").expect("an output").1;
    let sliding = format!("{pressed}{sequence}[output]{rest}");
    let held = format!("{pressed}[gripper]\nforce_n = 1.0\n[output]{rest}");
    let curved = edited(JOB, &[("[sensor]\n", "[sensor]\nshape = { dome = { radius_mm = 20.0 } }\n")]);
    let ways = [
        ("fidelity = \"finite-strain\"", "the fidelity level finite-strain", "use fidelity = \"high\""),
        ("gelpad = \"finite_strain\"", "the gelpad model `finite_strain`", "write gelpad = \"elastic\""),
        ("gelpad.elastic.strain_correction = true", "`strain_correction`", "leave it out"),
    ];
    for (job, what) in [(sliding, "sequence"), (held, "two fingers"), (curved, "has a shape")] {
        for (keys, who, help) in ways {
            let folder = Folder::with_job(&edited(&job, &[("[dataset]", &format!("{keys}\n[dataset]"))]));
            let line = 1 + folder.read("job.toml").lines().position(|line| line == keys).expect("the key");
            for command in ["generate job.toml --out out", "plan job.toml", "tradeoff job.toml --out out"] {
                let said = folder.fail(command, 2);
                assert!(said.contains(who) && said.contains(what) && said.contains(help), "{command}: {said}");
                assert!(said.contains(&format!("job.toml:{line}:")), "{command}: {said}");
                assert!(!folder.path("out").exists());
            }
        }
        // The command line's level is refused at what it does not go with, and the job alone is not.
        let folder = Folder::with_job(&job);
        let said = folder.fail("plan job.toml --fidelity finite-strain", 2);
        assert!(said.contains(what) && said.contains("fidelity = \"high\"") && said.contains("job.toml:"), "{said}");
        folder.succeed("plan job.toml");
    }
}

#[test]
fn coulomb_friction_is_refused_and_a_pad_that_sticks_is_not() {
    let coulomb = "{ coulomb = { coefficient = 0.5 } }";
    for (keys, key, help) in [
        (format!("[gelpad.finite_strain]\nfriction = {coulomb}"), "Coulomb friction", "the model elastic"),
        (
            format!("[gelpad.elastic]\nstrain_correction = true\nfriction = {coulomb}"),
            "Coulomb friction",
            "leave strain_correction out",
        ),
        (String::from("[gelpad.finite_strain]\nbox_mm = 0.0"), "box_mm = 0 is out of range", "0.01 to 100 mm"),
        (String::from("[gelpad.finite_strain]\ntolerance_um = 0.0"), "tolerance_um = 0 is", "0.01 to 1000 um"),
    ] {
        let said = Folder::with_job(&with(&keys)).fail("plan job.toml", 2);
        assert!(said.contains(key) && said.contains(help) && said.contains("job.toml:"), "{said}");
    }
    let sticks = with("[gelpad.finite_strain]\nfriction = \"stick\"\nbox_mm = 0.5");
    Folder::with_job(&sticks).succeed("plan job.toml");
    let slippery = sticks.replacen("[[object]]\n", "[[object]]\nfriction = 0.3\n", 1);
    let said = Folder::with_job(&slippery).fail("plan job.toml", 2);
    assert!(said.contains("the pad sticks to every object") && said.contains("take the model elastic"), "{said}");
}

#[test]
fn the_command_lines_level_keeps_friction_and_refuses_what_it_has_not() {
    let resolved = |keys: &str, level: &str| {
        let folder = Folder::with_job(&with(keys));
        folder.succeed(&format!("generate job.toml --quiet --out out --fidelity {level}"));
        folder.read("out/job.toml").parse::<toml::Table>().expect("TOML")["gelpad"].clone()
    };
    let to = resolved("[gelpad.elastic]\nfriction = \"stick\"", "finite-strain");
    assert_eq!(to["finite_strain"]["friction"].as_str(), Some("stick"), "{to}");
    let from = resolved("fidelity = \"finite-strain\"\n[gelpad.finite_strain]\nfriction = \"stick\"", "draft");
    assert_eq!(from["elastic"]["friction"].as_str(), Some("stick"), "{from}");
    assert_eq!(from["elastic"]["resolution"].as_str(), Some("quarter"), "{from}");
    let kept = resolved("[gelpad.elastic]\nstrain_correction = true", "draft");
    assert_eq!(kept["elastic"]["strain_correction"].as_bool(), Some(true), "{kept}");
    for (keys, level, key) in [
        (
            "[gelpad.elastic]\nfriction = { coulomb = { coefficient = 0.5 } }",
            "finite-strain",
            "gelpad.elastic.friction",
        ),
        ("[gelpad.elastic]\nstrain_correction = true", "paper", "gelpad.elastic.strain_correction"),
        ("[gelpad.finite_strain]\nbox_mm = 0.5", "finite-strain", "gelpad.finite_strain.box_mm"),
        ("[gelpad.finite_strain]\nbox_mm = 0.5", "high", "gelpad"),
    ] {
        let said = Folder::with_job(&with(keys)).fail(&format!("plan job.toml --fidelity {level}"), 2);
        assert!(said.contains(&format!("--fidelity {level}")) && said.contains(&format!("`{key}`")), "{said}");
    }
}

#[test]
fn tradeoff_leaves_the_level_out_where_it_cannot_be() {
    let curved = edited(JOB, &[("[sensor]\n", "[sensor]\nshape = { dome = { radius_mm = 20.0 } }\n")]);
    for (job, has) in [(JOB, true), (curved.as_str(), false)] {
        let folder = Folder::with_job(job);
        folder.succeed("tradeoff job.toml --samples 1 --out out");
        assert_eq!(folder.read("out/tradeoff.csv").contains("\nfinite-strain,"), has);
    }
}

#[test]
fn the_library_refuses_curved_gels_coulomb_friction_and_sequences() {
    let [curved, flat] = ["geltip", "digit"].map(|name| load_preset(name).expect("a preset"));
    let refused = Simulator::new(&curved, Fidelity::FiniteStrain).err();
    assert_eq!(refused, Some(SensorError::FiniteStrainOnCurvedGel));
    let flat = flat.with_resolution([30, 40]);
    let press = Press::new(Indenter::height_map([30, 40], vec![-1.0; 1200]).expect("a map"), &flat);
    let simulator = |sensor: &Sensor, friction| {
        let models = Fidelity::FiniteStrain.models(sensor.light_source());
        let models = Models { gelpad: models.gelpad.with_friction(friction), ..models };
        Simulator::with_models(sensor.clone(), models, EffectPolicy::default())
    };
    let on_curved = simulator(&curved, None).try_press(&press).err();
    assert_eq!(on_curved, Some(PressError::FiniteStrainOnCurvedGel));
    let held = simulator(&flat, Some(Friction::Stick));
    assert!(held.try_press(&press).is_ok() && held.sliding(Friction::Stick).is_none());
    let mut slippery = press.clone();
    slippery.material.friction = Some(Friction::Coulomb { coefficient: 0.5 });
    assert_eq!(held.try_press(&slippery).err(), Some(PressError::CoulombAtFiniteStrain));
    assert!(simulator(&flat, None).try_press(&slippery).is_ok(), "without friction it has none to replace");
}
