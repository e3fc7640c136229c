//! Which splits get what is made: those for training alone, unless somebody says otherwise; and what is said of it.

use serde_json::Value;

use super::{RECIPE, rows, sources, with_table};
use crate::support::{Folder, edited};

/// How many samples of each source are in each split of a table: real, photometric, twin, synthetic.
fn count_by_source(folder: &Folder, out: &str, split: &str) -> [usize; 4] {
    let rows = rows(&folder.read(&format!("{out}/labels.csv")));
    let of = sources(rows.iter().filter(|row| row["split"] == split).map(|row| row["source"].as_str()));
    ["real", "photometric", "twin", "synthetic"].map(|source| of.get(source).copied().unwrap_or(0))
}

#[test]
fn copies_counterparts_and_synthetic_samples_are_for_training_alone_unless_their_table_says_more() {
    let folder = with_table();
    let leds = super::leds();
    let recipe = format!(
        "[input]\npath = \"real\"\nbackground = \"background.png\"\n{leds}[[object]]\npath = \"cube.obj\"\n\
         [[object]]\npath = \"cone.obj\"\n[pose]\nanchor = \"origin\"\n[paired]\n[mixing]\njob = \"new.toml\"\n\
         synthetic_per_real = 0.5\n[[photometric]]\nexposure_ev = [-0.5, 0.5]\n[[photometric]]\ncopies = 2\n\
         exposure_ev = [-0.5, 0.5]\n"
    );
    folder.write("augment.toml", &recipe);
    let said = folder.succeed("augment augment.toml --out default");
    assert_eq!(count_by_source(&folder, "default", "train"), [18, 54, 18, 9]);
    assert_eq!(count_by_source(&folder, "default", "test"), [6, 0, 0, 0]);
    // It is said on the terminal, in the card, in augment.json and on the page.
    assert!(said.contains("\n  train: 18 real, 54 photometric, 18 twin, 9 synthetic\n  test: 6 real\n"), "{said}");
    let card = folder.read("default/README.md");
    for line in [
        "| split | real | photometric | twin | synthetic |",
        "| train | 18 | 54 | 18 | 9 |",
        "| test | 6 | 0 | 0 | 0 |",
        "Real samples alone: `test`.",
    ] {
        assert!(card.contains(line), "{line}\n{card}");
    }
    let summary: Value = serde_json::from_str(&folder.read("default/augment.json")).expect("JSON");
    assert_eq!(summary["splits"]["test"]["real"], 6);
    assert_eq!(summary["splits"]["test"]["photometric"], 0);
    assert!(folder.read("default/report.html").contains("<td>test</td><td>6</td><td>0</td><td>0</td><td>0</td>"));

    let both = edited(
        &recipe,
        &[
            ("[paired]", "[paired]\nsplits = [\"test\"]"),
            ("copies = 2", "copies = 2\nsplits = [\"train\", \"test\"]"),
            ("synthetic_per_real = 0.5", "synthetic_per_real = 0.5\nsplits = [\"test\"]"),
        ],
    );
    folder.write("augment.toml", both);
    folder.succeed("augment augment.toml --out said --quiet");
    assert_eq!(count_by_source(&folder, "said", "train"), [18, 54, 0, 0]);
    assert_eq!(count_by_source(&folder, "said", "test"), [6, 12, 6, 3]);
    // What a copy shows does not depend on who else gets one.
    for name in ["images/000000000-photometric-0-0.png", "images/000000000-photometric-1-1.png"] {
        assert_eq!(folder.read_bytes(&format!("default/{name}")), folder.read_bytes(&format!("said/{name}")));
    }
}

#[test]
fn a_set_without_splits_is_enlarged_as_a_whole() {
    let folder = with_table();
    let text = folder.read("real/labels.csv").replace(",split,", ",part,");
    folder.write("real/labels.csv", text);
    folder.write("augment.toml", RECIPE);
    let said = folder.succeed("augment augment.toml --out larger");
    let rows = rows(&folder.read("larger/labels.csv"));
    let of = sources(rows.iter().map(|row| row["source"].as_str()));
    assert_eq!([of["real"], of["photometric"], of["synthetic"]], [24, 48, 12]);
    assert!(!said.contains("\n  "), "{said}");
    assert!(folder.read("larger/README.md").contains("| all | 24 | 48 | 12 |"));
}

#[test]
fn where_no_split_is_for_training_it_is_said_and_the_way_out_is_one() {
    let folder = with_table();
    let text = folder.read("real/labels.csv").replace(",train,", ",validation,");
    folder.write("real/labels.csv", text);
    folder.write("augment.toml", RECIPE);
    let said = folder.fail("augment augment.toml --out larger", 2);
    for part in ["no split is for training", "there are `validation`, `test`", "splits = [\"validation\"]"] {
        assert!(said.contains(part), "{part}\n{said}");
    }
    assert_eq!(said.matches("error: ").count(), 1, "{said}");
    let told = [
        ("copies = 2", "copies = 2\nsplits = [\"validation\"]"),
        ("synthetic_per_real", "splits = [\"validation\"]\nsynthetic_per_real"),
    ];
    folder.write("augment.toml", edited(RECIPE, &told));
    folder.succeed("augment augment.toml --out larger --quiet");
    assert_eq!(count_by_source(&folder, "larger", "validation"), [18, 36, 0, 9]);
    assert_eq!(count_by_source(&folder, "larger", "test"), [6, 0, 0, 0]);
    // The other way out: a name for it.
    folder.write("real/labels.csv", folder.read("real/labels.csv").replace(",validation,", ",Training,"));
    folder.write("augment.toml", RECIPE);
    folder.succeed("augment augment.toml --out named --quiet");
    assert_eq!(count_by_source(&folder, "named", "Training"), [18, 36, 0, 9]);
}

#[test]
fn splits_that_are_not_there_are_named_with_those_that_are() {
    let folder = with_table();
    for (splits, parts) in [
        ("[\"trian\"]", vec!["no split is called `trian`", "did you mean `train`?", "there are `train`, `test`"]),
        ("[]", vec!["no split is named", "`train` or `test`"]),
    ] {
        folder.write("augment.toml", edited(RECIPE, &[("copies = 2", &format!("copies = 2\nsplits = {splits}"))]));
        let said = folder.fail("augment augment.toml --out larger", 2);
        assert!(parts.iter().all(|part| said.contains(part)), "{said}");
    }
    let text = folder.read("real/labels.csv").replace(",split,", ",part,");
    folder.write("real/labels.csv", text);
    folder.write("augment.toml", edited(RECIPE, &[("copies = 2", "copies = 2\nsplits = [\"train\"]")]));
    let said = folder.fail("augment augment.toml --out larger", 2);
    assert!(said.contains("no split of the real samples is known") && said.contains("input.columns.split"), "{said}");
    folder.succeed("augment augment.toml --out larger --quiet --set input.columns.split=\"part\"");
    let rows = rows(&folder.read("larger/labels.csv"));
    assert!(rows.iter().filter(|row| row["source"] == "photometric").all(|row| row["part"] == "train"));
}
