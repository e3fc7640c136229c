//! JSON Schemas that cannot be derived: whole numbers that may be random, and sensors whose numbers may be
//! distributions.

use std::borrow::Cow;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde_json::{Value, json};

use crate::config::scene::Count;
use gelsim_files::sensor::Sensor;

impl JsonSchema for Count {
    fn schema_name() -> Cow<'static, str> {
        Cow::Borrowed("Count")
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        let integer = json!({ "type": "integer", "minimum": 1 });
        json_schema!({
            "description": "A whole number, or [min, max] for a range of whole numbers that are equally likely.",
            "anyOf": [integer, { "type": "array", "items": integer, "minItems": 2, "maxItems": 2 }]
        })
    }
}

/// Returns the schema of a format with a sensor in it, changed so that the sensor's numbers may be distributions and
/// its background a list.
pub fn with_distributions(schema: Schema) -> Value {
    let mut schema = schema.to_value();
    let quantity = json!({ "$ref": "#/$defs/Quantity" });
    for (path, _) in Sensor::with_every_number(1).numbers_mut() {
        // The path has the tables on the way and the number, which is a key or an element of the list at a key.
        let keys: Vec<&str> = path.split('.').filter(|segment| segment.parse::<usize>().is_err()).collect();
        let is_element = path.rsplit('.').next().is_some_and(|last| last.parse::<usize>().is_ok());
        let (key, way) = keys.split_last().expect("a path has a last key");
        let definition = match way.last() {
            None => "Sensor",
            Some(&"led") => "Led",
            Some(&"rendered_background") => "RenderedBackground",
            Some(&"pattern") if way.contains(&"led") => "LightPattern",
            Some(_) => "Pattern",
        };
        let Some(property) = find_properties(&mut schema, definition).and_then(|all| all.get_mut(*key)) else {
            continue;
        };
        if is_element {
            property["items"] = quantity.clone();
        } else if let Some(property) = property.as_object_mut() {
            property.retain(|key, _| matches!(key.as_str(), "description" | "default"));
            property.insert(String::from("$ref"), quantity["$ref"].clone());
        }
    }
    for key in ["preset", "background", "background_sha256"] {
        let list =
            json!([{ "type": "string" }, { "type": "array", "items": { "type": "string" } }, { "type": "null" }]);
        if let Some(property) = find_properties(&mut schema, "Sensor").and_then(|all| all.get_mut(key)?.as_object_mut())
        {
            property.remove("type");
            property.insert(String::from("anyOf"), list);
        }
    }
    schema
}

/// Returns the schema of a job, changed so that a model may be its name alone, and `[gelpad]` may have the pad's
/// relaxation, with a model or without one.
pub fn with_short_forms(mut schema: Value) -> Value {
    let relaxation = schema["$defs"]["Sensor"]["properties"]["gelpad_relaxation"].clone();
    for model in ["Model", "Model2"] {
        let Some(choices) = schema["$defs"][model]["oneOf"].as_array_mut() else { continue };
        let names: Vec<Value> =
            choices.iter().flat_map(|choice| choice["required"].as_array()).flatten().cloned().collect();
        if names.iter().any(|name| name == "elastic") {
            for choice in &mut *choices {
                choice["properties"]["relaxation"] = relaxation.clone();
            }
            choices.push(json!({
                "type": "object",
                "properties": { "relaxation": relaxation.clone() },
                "required": ["relaxation"],
                "additionalProperties": false,
                "description": "The level's model, and how the pad relaxes in sequences."
            }));
        }
        choices.push(json!({ "enum": names, "description": "A model with its defaults." }));
    }
    if let Some(choices) = schema["$defs"]["Shadows"]["oneOf"].as_array_mut() {
        choices.push(json!({ "const": "soft", "description": "Shadows with their defaults." }));
    }
    schema
}

/// Returns the properties of a definition, or of the schema itself if it is that of the definition.
fn find_properties<'a>(schema: &'a mut Value, definition: &str) -> Option<&'a mut serde_json::Map<String, Value>> {
    let itself = schema["title"] == definition;
    let object = if itself { schema } else { schema.get_mut("$defs")?.get_mut(definition)? };
    object.get_mut("properties")?.as_object_mut()
}
