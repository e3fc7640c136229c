//! The effects, and the one mechanism by which a sample runs only those that can change a pixel.
//!
//! A stage asks the sample's [`Ledger`] to run an effect and says what the scene needs. The ledger runs it or not, and
//! notes which, why, and what it took; label, statistics and the comparisons in [`crate::tradeoff`] read the notes.
//! What each criterion proves, or by how much it may be wrong, is in `docs/effects.md`.

use std::borrow::Cow;
use std::fmt;
use std::marker::PhantomData;
use std::ops::{Index, IndexMut};

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::{self, Deserializer, MapAccess, Visitor};
use serde::ser::SerializeMap;
use serde::{Deserialize, Serialize, Serializer};

use crate::render::Clock;

/// Everything that may or may not happen in a sample, in the order in which it happens.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effect {
    /// Micro relief of the object.
    Texture,
    /// A curved pad under the object.
    RestShape,
    /// The pad's shape under and around the object.
    Deformation,
    /// In-plane motion of the pad under an object that is pushed or turned.
    Shear,
    /// Light of the LEDs on the deformed surface.
    Shading,
    /// Relief of the pad's coating.
    Grain,
    /// Shadows that the surface casts on itself.
    Shadows,
    /// Loss of light with depth.
    Darkening,
    /// Dots printed on the pad.
    Markers,
    /// Blur of the lens.
    Defocus,
    /// Distortion of the lens.
    Distortion,
    /// Loss of light towards the image's corners.
    Vignette,
    /// Exposure and white balance.
    Exposure,
    /// Shot and read noise.
    Noise,
}

impl Effect {
    /// All of them, in the order in which they happen.
    pub const ALL: [Self; 14] = [
        Self::Texture,
        Self::RestShape,
        Self::Deformation,
        Self::Shear,
        Self::Shading,
        Self::Grain,
        Self::Shadows,
        Self::Darkening,
        Self::Markers,
        Self::Defocus,
        Self::Distortion,
        Self::Vignette,
        Self::Exposure,
        Self::Noise,
    ];

    /// Its name in labels and statistics.
    pub fn name(self) -> &'static str {
        match self {
            Self::Texture => "texture",
            Self::RestShape => "rest_shape",
            Self::Deformation => "deformation",
            Self::Shear => "shear",
            Self::Shading => "shading",
            Self::Grain => "grain",
            Self::Shadows => "shadows",
            Self::Darkening => "darkening",
            Self::Markers => "markers",
            Self::Defocus => "defocus",
            Self::Distortion => "distortion",
            Self::Vignette => "vignette",
            Self::Exposure => "exposure",
            Self::Noise => "noise",
        }
    }

    /// What it is, and what calls for it.
    pub fn summary(self) -> &'static str {
        match self {
            Self::Texture => "micro relief of the object; runs where a textured object reaches into the pad",
            Self::RestShape => "a curved pad under the object; runs where a pad that is not flat meets an object",
            Self::Deformation => "the pad's shape under and around the object; runs where the object reaches into it",
            Self::Shear => "in-plane motion under an object that is pushed or turned; runs where markers show it",
            Self::Shading => "light of the LEDs on the deformed surface; runs where the surface is not flat",
            Self::Grain => "relief of the pad's coating; runs where a coated pad is deformed",
            Self::Shadows => "shadows cast on the surface; run for each LED that is lower than the steepest slope",
            Self::Darkening => "loss of light with depth; runs with shading where the surface is pressed in",
            Self::Markers => "dots printed on the pad; run where something moves them or they differ between samples",
            Self::Defocus => "blur of the lens; runs where the press changed the light",
            Self::Distortion => "distortion of the lens; runs where the press changed the light",
            Self::Vignette => "loss of light towards the corners; runs where the press changed the light",
            Self::Exposure => "exposure and white balance; run where they are not neutral",
            Self::Noise => "shot and read noise; runs where there is any",
        }
    }
}

/// What a scene needs of an effect, and why.
#[derive(Clone, Debug, PartialEq)]
pub enum Need {
    /// There is nothing that could run: the job or the sensor has none of it.
    Absent(&'static str),
    /// It would change no pixel, or none by more than the bound in `docs/effects.md`.
    Idle(&'static str),
    /// It can change a pixel.
    Called(&'static str),
}

/// Which effects run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Gate {
    /// Those that the scene calls for.
    #[default]
    CalledFor,
    /// All that the job and the sensor have, everywhere: the oracle for the criteria.
    All,
    /// Those that the scene calls for, but not this one.
    #[serde(skip)]
    Without(Effect),
}

/// What became of the effects of one sample.
#[derive(Clone, Debug)]
pub struct Ledger {
    gate: Gate,
    /// Whether each ran, and why.
    pub notes: PerEffect<Note>,
    /// CPU seconds that each took. Darkening is computed with shading and counts there.
    pub seconds: PerEffect<f64>,
}

/// Whether an effect ran.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[schemars(rename = "Effect")]
pub struct Note {
    /// True if it was computed.
    pub ran: bool,
    /// Why, or why not.
    pub reason: Cow<'static, str>,
}

impl Ledger {
    /// An empty one.
    pub fn new(gate: Gate) -> Self {
        Self { gate, notes: PerEffect::default(), seconds: PerEffect::default() }
    }

    /// True if every effect runs everywhere.
    pub fn everywhere(&self) -> bool {
        self.gate == Gate::All
    }

    /// Whether `effect` is to run; notes the answer.
    pub fn calls(&mut self, effect: Effect, need: Need) -> bool {
        let (ran, reason) = match (self.gate, need) {
            (Gate::Without(left_out), _) if left_out == effect => (false, "left out"),
            (Gate::All, Need::Idle(reason)) | (_, Need::Called(reason)) => (true, reason),
            (_, Need::Idle(reason) | Need::Absent(reason)) => (false, reason),
        };
        self.notes[effect] = Note { ran, reason: Cow::Borrowed(reason) };
        ran
    }

    /// Does the work of `effect` if it is to run.
    pub fn run<T>(&mut self, effect: Effect, need: Need, work: impl FnOnce() -> T) -> Option<T> {
        self.calls(effect, need).then(|| self.timed(effect, work))
    }

    /// Does work that counts as `effect`'s.
    pub fn timed<T>(&mut self, effect: Effect, work: impl FnOnce() -> T) -> T {
        let mut clock = Clock::start();
        let result = work();
        self.seconds[effect] += clock.lap();
        result
    }
}

/// A value for each effect; in JSON an object with their names.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PerEffect<T>([T; Effect::ALL.len()]);

impl<T> PerEffect<T> {
    /// Every effect with its value.
    pub fn iter(&self) -> impl Iterator<Item = (Effect, &T)> {
        Effect::ALL.into_iter().zip(&self.0)
    }
}

impl<T> Index<Effect> for PerEffect<T> {
    type Output = T;

    fn index(&self, effect: Effect) -> &T {
        &self.0[effect as usize]
    }
}

impl<T> IndexMut<Effect> for PerEffect<T> {
    fn index_mut(&mut self, effect: Effect) -> &mut T {
        &mut self.0[effect as usize]
    }
}

impl<T: Serialize> Serialize for PerEffect<T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(Effect::ALL.len()))?;
        for (effect, value) in self.iter() {
            map.serialize_entry(effect.name(), value)?;
        }
        map.end()
    }
}

impl<'de, T: Deserialize<'de> + Default> Deserialize<'de> for PerEffect<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Named<T>(PhantomData<T>);
        impl<'de, T: Deserialize<'de> + Default> Visitor<'de> for Named<T> {
            type Value = PerEffect<T>;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("an object with the effects' names")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Self::Value, A::Error> {
                let mut found = PerEffect::default();
                let mut missing = Effect::ALL.to_vec();
                while let Some(name) = map.next_key::<String>()? {
                    let effect = Effect::ALL.into_iter().find(|effect| effect.name() == name);
                    let effect = effect.ok_or_else(|| de::Error::custom(format!("no effect is called `{name}`")))?;
                    found[effect] = map.next_value()?;
                    missing.retain(|other| *other != effect);
                }
                match missing.first() {
                    None => Ok(found),
                    Some(effect) => Err(de::Error::missing_field(effect.name())),
                }
            }
        }
        deserializer.deserialize_map(Named(PhantomData))
    }
}

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_gate_decides_between_need_and_wish() {
        let answers = |gate| {
            let mut ledger = Ledger::new(gate);
            let needs = [Need::Absent("none"), Need::Idle("flat"), Need::Called("steep")];
            needs.map(|need| ledger.calls(Effect::Shadows, need))
        };
        assert_eq!(answers(Gate::CalledFor), [false, false, true]);
        assert_eq!(answers(Gate::All), [false, true, true], "what is not there cannot run");
        assert_eq!(answers(Gate::Without(Effect::Shadows)), [false, false, false]);
        assert_eq!(answers(Gate::Without(Effect::Noise)), [false, false, true]);
    }

    #[test]
    fn effects_stand_in_the_order_of_the_list_and_go_through_json() {
        for (k, effect) in Effect::ALL.into_iter().enumerate() {
            assert_eq!(effect as usize, k, "{}", effect.name());
        }
        let mut table = PerEffect::<u32>::default();
        table[Effect::Noise] = 7;
        let text = serde_json::to_string(&table).expect("numbers");
        assert_eq!(serde_json::from_str::<PerEffect<u32>>(&text).expect("the same"), table);
        assert!(serde_json::from_str::<PerEffect<u32>>("{\"noise\": 7}").is_err(), "the others are missing");
        assert!(serde_json::from_str::<PerEffect<u32>>(&text.replace("noise", "smoke")).is_err());
    }
}
