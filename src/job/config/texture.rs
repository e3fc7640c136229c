//! `[texture]`: the distributions that each sample's micro-texture is drawn from.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use gelsim_core::depth::patterns::Procedural;
use gelsim_files::sensor::quantity::Quantity;

/// The `[texture]` table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
#[schemars(rename = "Texture")]
pub struct TextureDistribution {
    /// Patterns of which each sample draws one, each as likely as the others.
    pub patterns: Vec<Pattern>,
    /// Depth of the valleys below the peaks, mm, 0 or more; 0 means no texture.
    pub amplitude_mm: Quantity,
    /// Scale of the pattern, mm, above 0; its meaning depends on the pattern.
    pub scale_mm: Quantity,
    /// Turn of the pattern on the object about z, degrees, from x towards y.
    pub angle_deg: Quantity,
}

impl TextureDistribution {
    /// Iterates over the paths of the files that the patterns name.
    pub fn paths_mut(&mut self) -> impl Iterator<Item = &mut String> {
        self.patterns.iter_mut().filter_map(|pattern| match pattern {
            Pattern::Image(image) => Some(&mut image.path),
            _ => None,
        })
    }
}

impl Default for TextureDistribution {
    fn default() -> Self {
        Self {
            patterns: vec![Pattern::Noise],
            amplitude_mm: Quantity::default(),
            scale_mm: Quantity::Constant(0.5),
            angle_deg: Quantity::uniform(0.0, 360.0),
        }
    }
}

/// A pattern that is cut into the surface.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Pattern {
    /// Roughness without direction, as of cast metal; the scale is the size of the largest bumps.
    Noise,
    /// Scratches along x, as of brushed metal; the scale is the distance between lines.
    Brushed,
    /// Pyramids between crossing grooves, as of a knurled grip; the scale is the distance between grooves.
    Knurled,
    /// A plain weave; the scale is the distance between yarns.
    Woven,
    /// Spherical dents on a hexagonal grid; the scale is the distance between dents.
    Dimples,
    /// A height map, repeated; the scale is its width.
    Image(ImagePattern),
}

/// A height map as a pattern.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ImagePattern {
    /// A grey PNG of 8 or 16 bits, a two-dimensional npy array or an EXR image of one channel, relative to the file
    /// this stands in. The largest value is the peak. Floats are from 0 to 1.
    pub path: String,
    /// SHA-256 of the file in lower-case hex; if given, another content is refused.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sha256: Option<String>,
}

impl Pattern {
    /// Returns the pattern if it is computed, or `None` for an image.
    pub fn to_procedural(&self) -> Option<Procedural> {
        match self {
            Self::Noise => Some(Procedural::Noise),
            Self::Brushed => Some(Procedural::Brushed),
            Self::Knurled => Some(Procedural::Knurled),
            Self::Woven => Some(Procedural::Woven),
            Self::Dimples => Some(Procedural::Dimples),
            Self::Image(_) => None,
        }
    }

    /// Returns the name in jobs and labels.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Noise => "noise",
            Self::Brushed => "brushed",
            Self::Knurled => "knurled",
            Self::Woven => "woven",
            Self::Dimples => "dimples",
            Self::Image(_) => "image",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_names_patterns_and_files() {
        let table = "patterns = ['knurled', { image = { path = 'skin.png' } }]\namplitude_mm = [0.01, 0.05]";
        let texture: TextureDistribution = toml::from_str(table).expect("a texture");
        let skin = ImagePattern { path: String::from("skin.png"), sha256: None };
        assert_eq!(texture.patterns, [Pattern::Knurled, Pattern::Image(skin)]);
        assert_eq!(texture.amplitude_mm, Quantity::uniform(0.01, 0.05));
        assert_eq!(texture.patterns.iter().map(Pattern::name).collect::<Vec<_>>(), ["knurled", "image"]);
        for pattern in [Pattern::Noise, Pattern::Brushed, Pattern::Knurled, Pattern::Woven, Pattern::Dimples] {
            let table = format!("patterns = ['{}']", pattern.name());
            let texture: TextureDistribution = toml::from_str(&table).expect("a texture");
            assert_eq!(texture.patterns.first(), Some(&pattern));
        }
        assert!(toml::from_str::<TextureDistribution>("patterns = ['wood']").is_err());
        assert!(toml::from_str::<TextureDistribution>("depth_mm = 1").is_err());
    }
}
