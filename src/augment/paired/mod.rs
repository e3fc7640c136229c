//! `[paired]`: stands in for the simulated twins.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The `[paired]` table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Paired {
    /// Largest offset between image and twin that is looked for, px.
    pub max_offset_px: u32,
}

impl Default for Paired {
    fn default() -> Self {
        Self { max_offset_px: 20 }
    }
}
