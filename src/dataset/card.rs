//! The dataset card: `README.md` with the front matter that Hugging Face reads, and how to load the data.

use std::fmt::Write;

use serde_json::Value;

use super::layout::Split;
use super::manifest::Manifest;
use crate::config::output::Layer;
use crate::label::Label;
use crate::plan::Plan;

/// The text of the card.
pub fn card(plan: &Plan, manifest: &Manifest) -> String {
    let mut text = String::from("---\n");
    front_matter(&mut text, plan, manifest);
    text.push_str("---\n\n");
    body(&mut text, plan, manifest);
    text
}

fn used_splits(manifest: &Manifest) -> impl Iterator<Item = (&'static str, u64)> + '_ {
    Split::ALL.into_iter().filter_map(|split| manifest.splits.get(split.name()).map(|samples| (split.name(), *samples)))
}

/// Column types are pinned: what a reader guesses from the first rows goes wrong where a value is null or whole.
fn front_matter(text: &mut String, plan: &Plan, manifest: &Manifest) {
    // In quotes: a name such as 2024 or null would not be text.
    let _ = writeln!(text, "pretty_name: \"{}\"", manifest.name);
    text.push_str("tags:\n- tactile\n- synthetic\n- webdataset\n");
    text.push_str("configs:\n- config_name: default\n  data_files:\n");
    for (split, _) in used_splits(manifest) {
        let _ = writeln!(text, "  - split: {split}\n    path: data/{split}-*.tar");
    }
    text.push_str("dataset_info:\n  features:\n");
    for (name, kind) in [("__key__", "string"), ("__url__", "string")] {
        let _ = writeln!(text, "  - name: {name}\n    dtype: {kind}");
    }
    text.push_str("  - name: tactile.png\n    dtype: image\n");
    for layer in &plan.layers {
        let _ = writeln!(text, "  - name: {}", layer.suffix());
        match layer.suffix().rsplit('.').next() {
            Some("png") => text.push_str("    dtype: image\n"),
            Some("json") => {
                text.push_str("    struct:\n");
                for name in ["rest_px", "moved_px"] {
                    let _ = writeln!(text, "    - name: {name}\n      sequence:\n        sequence: float64");
                }
            }
            _ => text.push_str("    dtype: binary\n"),
        }
    }
    text.push_str("  - name: json\n    struct:\n");
    let schema = schemars::schema_for!(Label).to_value();
    features(text, &schema, &schema, 4);
}

/// Writes the properties of a JSON Schema object in the notation of `dataset_info`.
fn features(text: &mut String, root: &Value, object: &Value, indent: usize) {
    let pad = " ".repeat(indent);
    let Some(properties) = resolved(root, object).get("properties").and_then(Value::as_object) else { return };
    for (name, schema) in properties {
        let schema = resolved(root, schema);
        let _ = writeln!(text, "{pad}- name: {name}");
        if schema.get("properties").is_some() {
            let _ = writeln!(text, "{pad}  struct:");
            features(text, root, schema, indent + 2);
        } else if let Some(items) = schema.get("items") {
            let _ = writeln!(text, "{pad}  sequence: {}", dtype(resolved(root, items)));
        } else {
            let _ = writeln!(text, "{pad}  dtype: {}", dtype(schema));
        }
    }
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

fn body(text: &mut String, plan: &Plan, manifest: &Manifest) {
    let sensor = &plan.job.sensor;
    let [width, height] = sensor.resolution_px;
    let [mm_x, mm_y] = plan.camera.mm_per_px;
    let _ = writeln!(
        text,
        "# {}\n\n{} synthetic presses on a `{}` tactile sensor ({width} x {height} px, {mm_x} x {mm_y} mm per pixel, \
         gelpad {} mm), made by gelsim {} at the rung `{}`. `job.toml` is the job that makes the same bytes again.\n",
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
    text.push_str("| `KEY.tactile.png` | the tactile image, 8-bit RGB |\n");
    for layer in &plan.layers {
        let _ = writeln!(text, "| `KEY.{}` | {} |", layer.suffix(), meaning(*layer));
    }
    text.push_str("| `KEY.json` | the label: object, pose, indentation, contact, sensor, numerics |\n");
    text.push_str(
        "\nThe frame is the camera's: x to the right, y down, z out of the pad towards the object, origin in the middle \
         of the image on the undeformed pad; lengths are millimetres.\n\n## Loading\n\n",
    );
    let first = used_splits(manifest).next().map_or("train", |(split, _)| split);
    let shards = manifest.shards.iter().filter(|shard| shard.split == first).count();
    let pattern = match shards {
        0 | 1 => format!("data/{first}-000000.tar"),
        more => format!("data/{first}-{{000000..{:06}}}.tar", more - 1),
    };
    let _ = writeln!(text, "```python\nimport io, OpenEXR, webdataset as wds  # OpenEXR >= 3.5\n");
    let _ = writeln!(
        text,
        "exr = wds.handle_extension(\"exr\", lambda b: OpenEXR.File(io.BytesIO(b), separate_channels=True).channels()[\"Z\"].pixels)"
    );
    let _ = writeln!(text, "samples = wds.WebDataset(\"{pattern}\", shardshuffle=False).decode(\"rgb8\", exr)");
    text.push_str("for sample in samples:\n    image, label = sample[\"tactile.png\"], sample[\"json\"]\n");
    if plan.layers.contains(&Layer::Depth) {
        text.push_str("    depth_mm = sample[\"depth.exr\"]\n");
    }
    text.push_str("```\n\n```python\nfrom datasets import load_dataset\n\n");
    let _ = writeln!(text, "samples = load_dataset(\"PATH/OF/THIS/FOLDER\", split=\"{first}\")\n```");
}

/// A name of the user's in one line, whatever is in it.
fn one_line(name: &str) -> String {
    name.replace(|c: char| c.is_control() || matches!(c, '\u{2028}' | '\u{2029}'), " ")
}

/// The same where Markdown could take it for a cell's border, a tag or an escape.
fn in_table(name: &str) -> String {
    one_line(name).replace('\\', "\\\\").replace('|', "\\|").replace('<', "\\<")
}

fn meaning(layer: Layer) -> &'static str {
    match layer {
        Layer::Depth => "channel Z, mm: how far the object reaches below the undeformed pad, 0 where it does not",
        Layer::Surface => "channel Z, mm: displacement of the pad's surface, positive into the pad",
        Layer::Contact => "8-bit grey, 255 where the pad touches",
        Layer::Normal => "channels X, Y, Z: unit normals of the surface towards the camera; a flat pad is (0, 0, -1)",
        Layer::Pressure => "channel P, kPa",
        Layer::Markers => "rest and moved positions of the markers, px",
        Layer::Reference => "the image without contact, 8-bit RGB",
    }
}
