//! JSON Schemas of what derives none: quantities, and tables with a key for each effect.

use std::borrow::Cow;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};

use crate::core::effects::{Effect, PerEffect};
use crate::files::sensor::quantity::{Distribution, Quantity};

impl<T: JsonSchema> JsonSchema for PerEffect<T> {
    fn schema_name() -> Cow<'static, str> {
        Cow::Borrowed("Effects")
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let mut schema = json_schema!({ "type": "object", "description": "Every effect." });
        let value = generator.subschema_for::<T>().to_value();
        let properties = Effect::ALL.into_iter().map(|effect| {
            let mut property = value.clone();
            property["description"] = effect.summary().into();
            (effect.name().to_owned(), property)
        });
        schema.insert(String::from("properties"), serde_json::Value::Object(properties.collect()));
        schema.insert(String::from("required"), Effect::ALL.map(Effect::name).to_vec().into());
        schema
    }
}

impl JsonSchema for Quantity {
    fn schema_name() -> Cow<'static, str> {
        Cow::Borrowed("Quantity")
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let distribution = generator.subschema_for::<Distribution>();
        schemars::json_schema!({
            "description": "A constant, [min, max] for a uniform range, or a table with one distribution.",
            "anyOf": [
                { "type": "number" },
                { "type": "array", "items": { "type": "number" }, "minItems": 2, "maxItems": 2 },
                distribution,
            ]
        })
    }
}
