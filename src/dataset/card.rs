//! The dataset card: `README.md` with the front matter that Hugging Face reads, and how to load the data.

use std::fmt::Write;

use serde_json::Value;

use super::cleanup::DESCRIPTIONS;
use super::manifest::Manifest;
use super::recorded::Recorded;
use super::stats::Stats;
use gelsim_files::sensor::shape::SensorShape;
use gelsim_files::spelling::is_hidden;
use gelsim_job::config::Job;
use gelsim_job::config::output::Container;
use gelsim_job::gripper::FINGERS;
use gelsim_job::gripper::label::GripLabel;
use gelsim_job::label::Label;
use gelsim_job::layers::{Coding, OutputLayer};
use gelsim_job::layout::Split;
use gelsim_job::plan::view;
use gelsim_job::sequence::label::FrameRow;

mod loading;

/// The files that describe a dataset of which these are the stats of all shards, in order: their names and texts.
pub fn descriptions(recorded: &Recorded, stats: &[Stats]) -> Vec<(&'static str, String)> {
    let manifest = Manifest::new(recorded, stats);
    let pretty = |value: &serde_json::Value| format!("{value:#}\n");
    let [dataset, index, readme] = DESCRIPTIONS;
    let value = serde_json::to_value(&manifest).expect("a manifest has string keys");
    let index = manifest.wids().map(|value| (index, pretty(&value)));
    [(dataset, pretty(&value)), (readme, card(recorded, &manifest))].into_iter().chain(index).collect()
}

/// The text of the card.
fn card(recorded: &Recorded, manifest: &Manifest) -> String {
    let mut text = String::from("---\n");
    front_matter(&mut text, recorded, manifest);
    text.push_str("---\n\n");
    body(&mut text, recorded, manifest);
    text
}

fn used_splits(manifest: &Manifest) -> impl Iterator<Item = (&'static str, u64)> + '_ {
    Split::ALL.into_iter().filter_map(|split| manifest.splits.get(split.name()).map(|samples| (split.name(), *samples)))
}

/// Column types are pinned: what a reader guesses from the first rows goes wrong where a value is null or whole. Each column
/// takes one line, however much there is in it, so that the title is not far down.
fn front_matter(text: &mut String, recorded: &Recorded, manifest: &Manifest) {
    // In quotes: a name such as 2024 or null would not be text.
    let _ = writeln!(text, "pretty_name: \"{}\"", manifest.name);
    let (tag, patterns): (&str, &[&str]) = match manifest.container {
        Container::Tar => ("webdataset", &["-*.tar"]),
        // Of a sample's files those that imagefolder knows: by the others, and by JSON, it takes itself for another loader.
        Container::Folder => ("imagefolder", &["-*/metadata.jsonl", "-*/*.png"]),
    };
    let _ = writeln!(text, "tags: [tactile, synthetic, {tag}]\nconfigs:\n- config_name: default\n  data_files:");
    for (split, _) in used_splits(manifest) {
        let paths: Vec<String> = patterns.iter().map(|pattern| format!("data/{split}{pattern}")).collect();
        let path = if let [only] = paths.as_slice() { only.clone() } else { format!("[{}]", paths.join(", ")) };
        let _ = writeln!(text, "  - {{split: {split}, path: {path}}}");
    }
    let (place, columns) = match manifest.container {
        // The columns would be the frames, and sequences differ in how many they have: `datasets` reads none such.
        Container::Tar if recorded.job.sequence.is_some() => return,
        Container::Tar => ("dataset_info:\n  features:\n", columns_of_tars(&recorded.job)),
        // As a part of the configuration: imagefolder guesses in spite of what dataset_info says.
        Container::Folder => ("  features:\n", columns_of_folders(&recorded.job)),
    };
    text.push_str(place);
    columns.iter().for_each(|column| _ = writeln!(text, "  - {column}"));
}

/// A column: its name and what kind of values it has, in YAML.
fn column(name: &str, kind: &str) -> String {
    format!("{{name: {name}, {kind}}}")
}

/// One column per file of a sample.
fn columns_of_tars(job: &Job) -> Vec<String> {
    let mut columns = vec![column("__key__", "dtype: string"), column("__url__", "dtype: string")];
    match &job.gripper {
        None => columns.extend(columns_of_sensor("", job, job.sensor.resolution_px)),
        Some(gripper) => {
            let right = gripper.right.as_deref().unwrap_or(&job.sensor);
            for (finger, sensor) in FINGERS.into_iter().zip([&job.sensor, right]) {
                columns.extend(columns_of_sensor(&format!("{finger}."), job, sensor.resolution_px));
            }
        }
    }
    let schema = match &job.gripper {
        None => schemars::schema_for!(Label).to_value(),
        Some(_) => schemars::schema_for!(GripLabel).to_value(),
    };
    columns.push(column("json", &format!("struct: [{}]", features(&schema, &schema).join(", "))));
    columns
}

/// Those of one sensor's files, whose names begin with `part`.
fn columns_of_sensor(part: &str, job: &Job, [width, height]: [u32; 2]) -> Vec<String> {
    let format = job.output.depth_format;
    let of_layer = |layer: &OutputLayer| {
        let kind = match layer.coding(format) {
            Coding::Png => "dtype: image".to_owned(),
            Coding::Exr | Coding::Png16(_) => "dtype: binary".to_owned(),
            Coding::Npy => {
                let channels = layer.channels().len();
                let (axes, more) = if channels == 1 { (2, String::new()) } else { (3, format!(", {channels}")) };
                format!("dtype: {{array{axes}_d: {{shape: [{height}, {width}{more}], dtype: float32}}}}")
            }
            Coding::Json => {
                let list = |name| column(name, "sequence: {sequence: float64}");
                format!("struct: [{}, {}]", list("rest_px"), list("moved_px"))
            }
        };
        column(&format!("{part}{}", layer.suffix(format)), &kind)
    };
    let tactile = column(&format!("{part}tactile.png"), "dtype: image");
    std::iter::once(tactile).chain(job.output.layers_in_order().iter().map(of_layer)).collect()
}

/// The columns of metadata.jsonl, as [`super::imagefolder::rows`] writes them.
fn columns_of_folders(job: &Job) -> Vec<String> {
    // First: a reader looks for `file_name` where it meets the first image.
    let mut columns = vec![column("image", "dtype: image")];
    for layer in job.output.layers_in_order() {
        columns.push(match layer.coding(job.output.depth_format) {
            Coding::Png => column(&format!("{}_image", layer.name()), "dtype: image"),
            _ => column(&format!("{}_path", layer.name()), "dtype: string"),
        });
    }
    let schema = match job.sequence {
        None => schemars::schema_for!(Label).to_value(),
        Some(_) => schemars::schema_for!(FrameRow).to_value(),
    };
    columns.extend(features(&schema, &schema));
    columns
}

/// The properties of a JSON Schema object in the notation of `dataset_info`.
fn features(root: &Value, object: &Value) -> Vec<String> {
    let properties = resolved(root, object).get("properties").and_then(Value::as_object);
    let feature = |(name, schema): (&String, &Value)| {
        let schema = resolved(root, schema);
        let inner = |object: &Value| features(root, object).join(", ");
        if schema.get("properties").is_some() {
            return column(name, &format!("struct: [{}]", inner(schema)));
        }
        let Some(items) = schema.get("items").map(|items| resolved(root, items)) else {
            return column(name, &format!("dtype: {}", dtype(schema)));
        };
        match items.get("properties").is_some() {
            true => column(name, &format!("list: [{}]", inner(items))),
            false => column(name, &format!("sequence: {}", dtype(items))),
        }
    };
    properties.into_iter().flatten().map(feature).collect()
}

/// Follows a `$ref` to the schema's definitions.
fn resolved<'a>(root: &'a Value, schema: &'a Value) -> &'a Value {
    let target = schema.get("$ref").and_then(Value::as_str).and_then(|path| root.pointer(path.trim_start_matches('#')));
    target.unwrap_or(schema)
}

fn dtype(schema: &Value) -> &'static str {
    let kind = match &schema["type"] {
        // A value that may be null: [kind, "null"].
        Value::Array(kinds) => kinds.first().and_then(Value::as_str),
        kind => kind.as_str(),
    };
    match kind {
        Some("number") => "float64",
        Some("integer") => "int64",
        Some("boolean") => "bool",
        _ => "string",
    }
}

fn body(text: &mut String, recorded: &Recorded, manifest: &Manifest) {
    let sensor = &recorded.job.sensor;
    let sequences = recorded.job.sequence.is_some();
    let grips = recorded.job.gripper.is_some();
    let (what, one, frame) = match (sequences, grips) {
        (true, true) => {
            ("sequences of grips by two fingers", "KEY.f0000.left", " of the left finger in the first frame")
        }
        (true, false) => ("sequences of presses", "KEY.f0000", " of the first frame"),
        (false, true) => ("grips of one object by two fingers", "KEY.left", " of the left finger"),
        (false, false) => ("presses", "KEY", ""),
    };
    let [width, height] = sensor.resolution_px;
    // Whoever finalizes a dataset need not have the mesh that decides it; the labels say it.
    let pitch = match sensor.shape {
        Some(SensorShape::Mesh(_)) => String::new(),
        _ => {
            let [x, y] = view(&recorded.job).mm_per_px;
            format!(", {x} x {y} mm per pixel")
        }
    };
    let _ = writeln!(
        text,
        "# {}\n\n{} synthetic {what} on a `{}` tactile sensor ({width} x {height} px{pitch}, \
         gelpad {} mm), made by gelsim {} at the fidelity level `{}`. `job.toml` is the job that makes the same bytes again.\n",
        manifest.name,
        manifest.samples,
        one_line(&sensor.name).replace('`', "'"),
        sensor.gelpad_thickness_mm,
        manifest.generator.version,
        manifest.fidelity,
    );
    text.push_str("| split | samples | shards |\n|---|---|---|\n");
    for (split, samples) in used_splits(manifest) {
        let shards = manifest.shards.iter().filter(|shard| shard.split == split).count();
        let _ = writeln!(text, "| {split} | {samples} | {shards} |");
    }
    text.push_str("\n| class | samples |\n|---|---|\n");
    for class in &manifest.classes {
        let _ = writeln!(text, "| {} | {} |", in_table(&class.name), class.samples);
    }
    text.push_str("\n## A sample\n\n| member | what it is |\n|---|---|\n");
    let _ = writeln!(text, "| `{one}.tactile.png` | the tactile image{frame}, 8-bit RGB |");
    let format = recorded.job.output.depth_format;
    for layer in recorded.job.output.layers_in_order() {
        let _ = writeln!(text, "| `{one}.{}` | {} |", layer.suffix(format), meaning(layer, layer.coding(format)));
    }
    text.push_str(match (sequences, grips) {
        (false, false) => "| `KEY.json` | the label: object, pose, indentation, contact, sensor, numerics |\n",
        (false, true) => {
            "| `KEY.right.tactile.png` and so on | the right finger, with its layers |\n\
             | `KEY.json` | the label: object, gripper (width, force, pose of the object in its frame), and for `left` and `right` \
             pose, contact, sensor, numerics |\n"
        }
        (true, true) => {
            "| `KEY.f0000.right.tactile.png`, `KEY.f0001.left.tactile.png` and so on | the right finger, the other frames, each with \
             its layers |\n\
             | `KEY.json` | the label: object, friction and phases; both sensors; a list of the frames with time, width, force, and for \
             `left` and `right` pose, wrench, slip, contact |\n"
        }
        (true, false) => {
            "| `KEY.f0001.tactile.png` and so on | the other frames, each with its layers |\n\
             | `KEY.json` | the label: object, sensor, friction and phases; a list of the frames with time, pose, wrench, slip, \
             contact, markers |\n"
        }
    });
    if sequences && manifest.container == Container::Folder {
        text.push_str(
            "\nA frame is a row of `metadata.jsonl` in its folder: its images, the paths of its other layers from this folder \
             on, what holds for the sequence, and under `frame` what the frame shows. Folders are read in no fixed order: \
             `key` and `frame.index` say what belongs together.\n",
        );
    } else if manifest.container == Container::Folder {
        text.push_str(
            "\nA sample is a row of `metadata.jsonl` in its folder: its images, the paths of its other layers from this \
             folder on, and the label's keys. Folders are read in no fixed order.\n",
        );
    }
    if grips {
        let right = recorded.job.gripper.iter().find_map(|gripper| gripper.right.as_deref()).unwrap_or(sensor);
        let [width, height] = right.resolution_px;
        let _ = writeln!(
            text,
            "\nThe sensor above is the left finger's; the right one is a `{}` ({width} x {height} px, gelpad {} mm). The gripper's frame \
             has its origin in the middle between the undeformed pads, z from the left pad to the right one, x and y as the left \
             image has them; the right finger's frame is turned half about y, so that y is down in both images.",
            one_line(&right.name).replace('`', "'"),
            right.gelpad_thickness_mm,
        );
    }
    text.push_str(
        "\nThe frame is the camera's: x to the right, y down, z out of the pad towards the object, origin in the middle \
         of the image on the undeformed pad; lengths are millimetres.\n\n## Loading\n\nFrom this folder:\n\n",
    );
    let split = used_splits(manifest).next().map_or("train", |(split, _)| split);
    let kind = match (sequences, grips) {
        (true, true) => loading::Kind::GripSequences,
        (true, false) => loading::Kind::Sequences,
        (false, true) => loading::Kind::Grips,
        (false, false) => loading::Kind::Presses,
    };
    for snippet in loading::snippets(&recorded.job.output, split, kind) {
        let _ = writeln!(text, "```python\n{snippet}```\n");
    }
}

/// A name of the user's in one line, whatever is in it; what cannot be seen but turns or hides text, by its number.
fn one_line(name: &str) -> String {
    let shown = |letter: char| match letter {
        letter if letter.is_control() || matches!(letter, '\u{2028}' | '\u{2029}') => String::from(" "),
        letter if is_hidden(letter) => format!("U+{:04X}", u32::from(letter)),
        letter => String::from(letter),
    };
    name.chars().map(shown).collect()
}

/// The same where Markdown takes it as it stands: no border of a cell, tag, link, image, entity or emphasis.
fn in_table(name: &str) -> String {
    let escaped = |letter: char| match letter {
        '\\' | '`' | '*' | '_' | '[' | ']' | '(' | ')' | '!' | '<' | '>' | '&' | '|' | '~' | '#' | ':' | '.' | '@'
        | '$' => {
            format!("\\{letter}")
        }
        letter => String::from(letter),
    };
    one_line(name).chars().map(escaped).collect()
}

/// What a layer holds, and in what form.
fn meaning(layer: OutputLayer, coding: Coding) -> String {
    let (what, channels) = (layer.spec().said(), layer.channels().join(", "));
    match coding {
        Coding::Exr if channels.len() == 1 => format!("channel {channels}, {what}"),
        Coding::Exr => format!("channels {channels}: {what}"),
        Coding::Npy if channels.len() == 1 => format!("float32, rows and columns, {what}"),
        Coding::Npy => format!("float32, rows, columns and {channels}: {what}"),
        Coding::Png16(scale) => {
            let zero = scale.zero_key().map_or(String::new(), |key| format!("less the label's `png16.{key}`, "));
            let label = if zero.is_empty() { "the label's " } else { "" };
            format!("16-bit grey; {zero}times {label}`png16.{}`, {what}", scale.step_key())
        }
        Coding::Png | Coding::Json => what,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_class_name_is_nothing_but_text() {
        let cases = [
            ("gear 2", "gear 2"),
            ("![x](https://a.b/c.png)", "\\!\\[x\\]\\(https\\://a\\.b/c\\.png\\)"),
            ("a|b\\c", "a\\|b\\\\c"),
            ("&amp;<b>", "\\&amp;\\<b\\>"),
            ("a\nb\u{202e}c", "a bU+202Ec"),
        ];
        for (name, expected) in cases {
            assert_eq!(in_table(name), expected);
        }
    }
}
