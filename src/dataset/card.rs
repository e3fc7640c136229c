//! Writes the dataset card, `README.md`: the front matter that Hugging Face reads, a description, and code that loads
//! the data.

use std::fmt::Write;

use serde_json::Value;

use super::cleanup::DESCRIPTION_FILES;
use super::manifest::Manifest;
use super::recorded::RecordedDataset;
use super::stats::ShardStats;
use gelsim_files::sensor::shape::SensorShape;
use gelsim_files::spelling::is_hidden_char;
use gelsim_job::config::Job;
use gelsim_job::config::output::Container;
use gelsim_job::gripper::FINGER_NAMES;
use gelsim_job::gripper::label::GripLabel;
use gelsim_job::label::Label;
use gelsim_job::layers::{LayerCoding, OutputLayer};
use gelsim_job::layout::Split;
use gelsim_job::plan::sensor_view;
use gelsim_job::sequence::label::FrameRow;

mod loading;

/// Returns the names and texts of the files that describe a dataset. `stats` are those of all its shards, in order.
pub fn render_descriptions(recorded: &RecordedDataset, stats: &[ShardStats]) -> Vec<(&'static str, String)> {
    let manifest = Manifest::new(recorded, stats);
    let pretty = |value: &serde_json::Value| format!("{value:#}\n");
    let [dataset, index, readme] = DESCRIPTION_FILES;
    let value = serde_json::to_value(&manifest).expect("a manifest has string keys");
    let index = manifest.to_wids_index().map(|value| (index, pretty(&value)));
    [(dataset, pretty(&value)), (readme, render_card(recorded, &manifest))].into_iter().chain(index).collect()
}

/// Renders the text of the card.
fn render_card(recorded: &RecordedDataset, manifest: &Manifest) -> String {
    let mut text = String::from("---\n");
    write_front_matter(&mut text, recorded, manifest);
    text.push_str("---\n\n");
    write_body(&mut text, recorded, manifest);
    text
}

fn used_splits(manifest: &Manifest) -> impl Iterator<Item = (&'static str, u64)> + '_ {
    Split::ALL.into_iter().filter_map(|split| manifest.splits.get(split.name()).map(|samples| (split.name(), *samples)))
}

/// Writes the front matter. It states the type of every column, since a reader that guesses from the first rows goes
/// wrong where a value is null or a whole number. Each column takes one line, so that the title stays near the top.
fn write_front_matter(text: &mut String, recorded: &RecordedDataset, manifest: &Manifest) {
    // In quotes, since a name such as 2024 or null would not be read as text.
    let _ = writeln!(text, "pretty_name: \"{}\"", manifest.name);
    let (tag, patterns): (&str, &[&str]) = match manifest.container {
        Container::Tar => ("webdataset", &["-*.tar"]),
        // Only files that imagefolder knows: if others or JSON were listed, another loader would be chosen.
        Container::Folder => ("imagefolder", &["-*/metadata.jsonl", "-*/*.png"]),
    };
    let _ = writeln!(text, "tags: [tactile, synthetic, {tag}]\nconfigs:\n- config_name: default\n  data_files:");
    for (split, _) in used_splits(manifest) {
        let paths: Vec<String> = patterns.iter().map(|pattern| format!("data/{split}{pattern}")).collect();
        let path = if let [only] = paths.as_slice() { only.clone() } else { format!("[{}]", paths.join(", ")) };
        let _ = writeln!(text, "  - {{split: {split}, path: {path}}}");
    }
    let (place, columns) = match manifest.container {
        // Sequences have no columns: they would be the frames, whose number differs, which `datasets` cannot read.
        Container::Tar if recorded.job.sequence.is_some() => return,
        Container::Tar => ("dataset_info:\n  features:\n", tar_columns(&recorded.job)),
        // Here the features are part of the configuration, since imagefolder ignores those of dataset_info.
        Container::Folder => ("  features:\n", folder_columns(&recorded.job)),
    };
    text.push_str(place);
    columns.iter().for_each(|column| _ = writeln!(text, "  - {column}"));
}

/// Formats a column in YAML from its name and the kind of its values.
fn format_column(name: &str, kind: &str) -> String {
    format!("{{name: {name}, {kind}}}")
}

/// Lists the columns of a dataset of tars, one for each file of a sample.
fn tar_columns(job: &Job) -> Vec<String> {
    let mut columns = vec![format_column("__key__", "dtype: string"), format_column("__url__", "dtype: string")];
    match &job.gripper {
        None => columns.extend(sensor_columns("", job, job.sensor.resolution_px)),
        Some(gripper) => {
            let right = gripper.right.as_deref().unwrap_or(&job.sensor);
            for (finger, sensor) in FINGER_NAMES.into_iter().zip([&job.sensor, right]) {
                columns.extend(sensor_columns(&format!("{finger}."), job, sensor.resolution_px));
            }
        }
    }
    let schema = match &job.gripper {
        None => schemars::schema_for!(Label).to_value(),
        Some(_) => schemars::schema_for!(GripLabel).to_value(),
    };
    columns.push(format_column("json", &format!("struct: [{}]", list_features(&schema, &schema).join(", "))));
    columns
}

/// Lists the columns of the files of one sensor, whose names begin with `part`.
fn sensor_columns(part: &str, job: &Job, [width, height]: [u32; 2]) -> Vec<String> {
    let format = job.output.depth_format;
    let of_layer = |layer: &OutputLayer| {
        let kind = match layer.coding_for(format) {
            LayerCoding::Png => "dtype: image".to_owned(),
            LayerCoding::Exr | LayerCoding::Png16(_) => "dtype: binary".to_owned(),
            LayerCoding::Npy => {
                let channels = layer.channels().len();
                let (axes, more) = if channels == 1 { (2, String::new()) } else { (3, format!(", {channels}")) };
                format!("dtype: {{array{axes}_d: {{shape: [{height}, {width}{more}], dtype: float32}}}}")
            }
            LayerCoding::Json => {
                let list = |name| format_column(name, "sequence: {sequence: float64}");
                format!("struct: [{}, {}]", list("rest_px"), list("moved_px"))
            }
        };
        format_column(&format!("{part}{}", layer.file_suffix(format)), &kind)
    };
    let tactile = format_column(&format!("{part}tactile.png"), "dtype: image");
    std::iter::once(tactile).chain(job.output.layers_in_order().iter().map(of_layer)).collect()
}

/// Lists the columns of metadata.jsonl, as [`super::imagefolder::build_rows`] writes them.
fn folder_columns(job: &Job) -> Vec<String> {
    // The image comes first, since a reader looks for `file_name` where it meets the first image.
    let mut columns = vec![format_column("image", "dtype: image")];
    for layer in job.output.layers_in_order() {
        columns.push(match layer.coding_for(job.output.depth_format) {
            LayerCoding::Png => format_column(&format!("{}_image", layer.name()), "dtype: image"),
            _ => format_column(&format!("{}_path", layer.name()), "dtype: string"),
        });
    }
    let schema = match job.sequence {
        None => schemars::schema_for!(Label).to_value(),
        Some(_) => schemars::schema_for!(FrameRow).to_value(),
    };
    columns.extend(list_features(&schema, &schema));
    columns
}

/// Lists the properties of a JSON Schema object in the notation of `dataset_info`.
fn list_features(root: &Value, object: &Value) -> Vec<String> {
    let properties = resolve_reference(root, object).get("properties").and_then(Value::as_object);
    let feature = |(name, schema): (&String, &Value)| {
        let schema = resolve_reference(root, schema);
        let inner = |object: &Value| list_features(root, object).join(", ");
        if schema.get("properties").is_some() {
            return format_column(name, &format!("struct: [{}]", inner(schema)));
        }
        let Some(items) = schema.get("items").map(|items| resolve_reference(root, items)) else {
            return format_column(name, &format!("dtype: {}", schema_dtype(schema)));
        };
        match items.get("properties").is_some() {
            true => format_column(name, &format!("list: [{}]", inner(items))),
            false => format_column(name, &format!("sequence: {}", schema_dtype(items))),
        }
    };
    properties.into_iter().flatten().map(feature).collect()
}

/// Follows a `$ref` into the schema's definitions. A schema without one is returned unchanged.
fn resolve_reference<'a>(root: &'a Value, schema: &'a Value) -> &'a Value {
    let target = schema.get("$ref").and_then(Value::as_str).and_then(|path| root.pointer(path.trim_start_matches('#')));
    target.unwrap_or(schema)
}

fn schema_dtype(schema: &Value) -> &'static str {
    let kind = match &schema["type"] {
        // A value that may be null has the type [kind, "null"].
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

fn write_body(text: &mut String, recorded: &RecordedDataset, manifest: &Manifest) {
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
    // The pixel size of a gel from a mesh needs the mesh, which may be missing here. The labels hold it, too.
    let pixel_size = match sensor.shape {
        Some(SensorShape::Mesh(_)) => String::new(),
        _ => {
            let [x, y] = sensor_view(&recorded.job).mm_per_px;
            format!(", {x} x {y} mm per pixel")
        }
    };
    let _ = writeln!(
        text,
        "# {}\n\n{} synthetic {what} on a `{}` tactile sensor ({width} x {height} px{pixel_size}, \
         gelpad {} mm), made by gelsim {} at the fidelity level `{}`. `job.toml` is the job that makes the same bytes again.\n",
        manifest.name,
        manifest.samples,
        to_one_line(&sensor.name).replace('`', "'"),
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
        let _ = writeln!(text, "| {} | {} |", escape_markdown(&class.name), class.samples);
    }
    text.push_str("\n## A sample\n\n| member | what it is |\n|---|---|\n");
    let _ = writeln!(text, "| `{one}.tactile.png` | the tactile image{frame}, 8-bit RGB |");
    let format = recorded.job.output.depth_format;
    for layer in recorded.job.output.layers_in_order() {
        let _ = writeln!(
            text,
            "| `{one}.{}` | {} |",
            layer.file_suffix(format),
            describe_layer(layer, layer.coding_for(format))
        );
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
            to_one_line(&right.name).replace('`', "'"),
            right.gelpad_thickness_mm,
        );
    }
    text.push_str(
        "\nThe frame is the camera's: x to the right, y down, z out of the pad towards the object, origin in the middle \
         of the image on the undeformed pad; lengths are millimetres.\n\n## Loading\n\nFrom this folder:\n\n",
    );
    let split = used_splits(manifest).next().map_or("train", |(split, _)| split);
    let kind = match (sequences, grips) {
        (true, true) => loading::SampleKind::GripSequences,
        (true, false) => loading::SampleKind::Sequences,
        (false, true) => loading::SampleKind::Grips,
        (false, false) => loading::SampleKind::Presses,
    };
    for snippet in loading::loading_snippets(&recorded.job.output, split, kind) {
        let _ = writeln!(text, "```python\n{snippet}```\n");
    }
}

/// Returns a user's name on one line. Hidden characters that turn or hide text are shown by their numbers.
fn to_one_line(name: &str) -> String {
    let shown = |letter: char| match letter {
        letter if letter.is_control() || matches!(letter, '\u{2028}' | '\u{2029}') => String::from(" "),
        letter if is_hidden_char(letter) => format!("U+{:04X}", u32::from(letter)),
        letter => String::from(letter),
    };
    name.chars().map(shown).collect()
}

/// Returns a user's name on one line, escaped so that Markdown shows it literally.
fn escape_markdown(name: &str) -> String {
    let escaped = |letter: char| match letter {
        '\\' | '`' | '*' | '_' | '[' | ']' | '(' | ')' | '!' | '<' | '>' | '&' | '|' | '~' | '#' | ':' | '.' | '@'
        | '$' => {
            format!("\\{letter}")
        }
        letter => String::from(letter),
    };
    to_one_line(name).chars().map(escaped).collect()
}

/// Describes what a layer holds, and in what format.
fn describe_layer(layer: OutputLayer, coding: LayerCoding) -> String {
    let (what, channels) = (layer.spec().description(), layer.channels().join(", "));
    match coding {
        LayerCoding::Exr if channels.len() == 1 => format!("channel {channels}, {what}"),
        LayerCoding::Exr => format!("channels {channels}: {what}"),
        LayerCoding::Npy if channels.len() == 1 => format!("float32, rows and columns, {what}"),
        LayerCoding::Npy => format!("float32, rows, columns and {channels}: {what}"),
        LayerCoding::Png16(scale) => {
            let zero = scale.zero_key().map_or(String::new(), |key| format!("less the label's `png16.{key}`, "));
            let label = if zero.is_empty() { "the label's " } else { "" };
            format!("16-bit grey; {zero}times {label}`png16.{}`, {what}", scale.step_key())
        }
        LayerCoding::Png | LayerCoding::Json => what,
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
            assert_eq!(escape_markdown(name), expected);
        }
    }
}
