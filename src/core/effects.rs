//! The effects, and the one mechanism by which a press runs only those that can change a pixel.
//!
//! A stage asks the [`EffectLog`] of the press to run an effect and says whether the press needs it. The log enables it or
//! not, and notes which, why, and what it took; label, statistics and the comparisons in `tradeoff` read the notes.
//! What each criterion proves, or by how much it may be wrong, is in `docs/effects.md`.

use std::borrow::Cow;
use std::fmt;
use std::marker::PhantomData;
use std::ops::{Index, IndexMut};

use serde::de::{self, Deserializer, MapAccess, Visitor};
use serde::ser::SerializeMap;
use serde::{Deserialize, Serialize, Serializer};

use super::base::clock::Clock;

macro_rules! effects {
    ($($effect:ident, $name:literal, $summary:literal;)*) => {
        /// Everything that may or may not happen in a press, in the order in which it happens.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[non_exhaustive]
        pub enum Effect { $(#[doc = $summary] $effect,)* }

        impl Effect {
            /// All of them, in the order in which they happen.
            pub const ALL: [Self; [$($name),*].len()] = [$(Self::$effect),*];

            /// Its name in labels and statistics.
            pub fn name(self) -> &'static str {
                match self { $(Self::$effect => $name,)* }
            }

            /// What it is, and what enables it.
            pub fn summary(self) -> &'static str {
                match self { $(Self::$effect => $summary,)* }
            }
        }
    };
}

// One row for each: its name in labels and statistics; what it is, and what enables it.
effects! {
    Texture, "texture", "micro relief of the object; runs where a textured object reaches into the pad";
    RestShape, "rest_shape", "a curved pad under the object; runs where a pad that is not flat meets an object";
    Deformation, "deformation", "the pad's shape under and around the object; runs where the object reaches into it";
    Friction, "friction", "friction while the object is pressed in; runs where markers or the surface show it";
    Supersampling, "supersampling", "light averaged over a pixel; runs for pixels within which the surface bends";
    Shear, "shear", "in-plane motion under an object that is pushed or turned; runs where markers show it";
    Shading, "shading", "light of the LEDs on the deformed surface; runs where the surface is not flat";
    Grain, "grain", "relief of the pad's coating; runs where a coated pad is deformed";
    Shadows, "shadows", "shadows cast on the surface; run for each LED that is lower than the steepest slope";
    Darkening, "darkening", "loss of light with depth; runs with shading where the surface is pressed in";
    Markers, "markers", "dots printed on the pad, or pins inside it; run where something moves them or they differ between samples";
    Defocus, "defocus", "blur of the lens; runs where the press changed the light";
    Distortion, "distortion", "distortion of the lens; runs where the press changed the light";
    Vignette, "vignette", "loss of light towards the corners; runs where the press changed the light";
    Speckle, "speckle", "grain that the skin shows where it is touched; runs where the pad is touched";
    Exposure, "exposure", "exposure and white balance; run where they are not neutral";
    Noise, "noise", "shot and read noise; runs where there is any";
}

/// Whether a press needs an effect, and why.
#[derive(Clone, Debug, PartialEq)]
pub enum Requirement {
    /// There is nothing that could run: the job or the sensor has none of it.
    Absent(&'static str),
    /// It would change no pixel, or none by more than the bound in `docs/effects.md`.
    Unneeded(&'static str),
    /// It can change a pixel.
    Needed(&'static str),
}

/// Which effects run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
#[cfg_attr(feature = "schema", schemars(rename = "Gate"))]
pub enum EffectPolicy {
    /// Those that can change a pixel.
    #[default]
    #[serde(rename = "called_for")]
    WhereNeeded,
    /// All that the job and the sensor have, everywhere: the oracle for the criteria.
    All,
    /// Those that the scene calls for, but not this one.
    #[serde(skip)]
    Without(Effect),
}

/// What became of the effects of one sample.
#[derive(Clone, Debug)]
pub struct EffectLog {
    policy: EffectPolicy,
    /// Whether each ran, and why.
    pub notes: PerEffect<Note>,
    /// CPU seconds that each took. Darkening is computed with shading and counts there.
    pub seconds: PerEffect<f64>,
}

/// Whether an effect ran.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "schema", schemars(rename = "Effect"))]
pub struct Note {
    /// True if it was computed.
    pub ran: bool,
    /// Why, or why not.
    pub reason: Cow<'static, str>,
}

impl EffectLog {
    /// An empty one.
    pub fn new(policy: EffectPolicy) -> Self {
        Self { policy, notes: PerEffect::default(), seconds: PerEffect::default() }
    }

    /// True if every effect runs everywhere.
    pub(crate) fn everywhere(&self) -> bool {
        self.policy == EffectPolicy::All
    }

    /// True if an effect never runs.
    pub(crate) fn leaves_out(&self, effect: Effect) -> bool {
        self.policy == EffectPolicy::Without(effect)
    }

    /// Whether `effect` is to run; notes the answer.
    pub(crate) fn enable(&mut self, effect: Effect, need: Requirement) -> bool {
        let (ran, reason) = match (self.policy, need) {
            (EffectPolicy::Without(left_out), _) if left_out == effect => (false, "left out"),
            (EffectPolicy::All, Requirement::Unneeded(reason)) | (_, Requirement::Needed(reason)) => (true, reason),
            (_, Requirement::Unneeded(reason) | Requirement::Absent(reason)) => (false, reason),
        };
        self.notes[effect] = Note { ran, reason: Cow::Borrowed(reason) };
        ran
    }

    /// Does the work of `effect` if it is to run.
    pub(crate) fn run<T>(&mut self, effect: Effect, need: Requirement, work: impl FnOnce() -> T) -> Option<T> {
        self.enable(effect, need).then(|| self.timed(effect, work))
    }

    /// Does work that counts as `effect`'s.
    pub(crate) fn timed<T>(&mut self, effect: Effect, work: impl FnOnce() -> T) -> T {
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

#[cfg(feature = "schema")]
impl<T: schemars::JsonSchema> schemars::JsonSchema for PerEffect<T> {
    fn schema_name() -> Cow<'static, str> {
        Cow::Borrowed("Effects")
    }

    fn json_schema(generator: &mut schemars::SchemaGenerator) -> schemars::Schema {
        let mut schema = schemars::json_schema!({ "type": "object", "description": "Every effect." });
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_policy_decides_between_need_and_wish() {
        let answers = |gate| {
            let mut log = EffectLog::new(gate);
            let needs = [Requirement::Absent("none"), Requirement::Unneeded("flat"), Requirement::Needed("steep")];
            needs.map(|need| log.enable(Effect::Shadows, need))
        };
        assert_eq!(answers(EffectPolicy::WhereNeeded), [false, false, true]);
        assert_eq!(answers(EffectPolicy::All), [false, true, true], "what is not there cannot run");
        assert_eq!(answers(EffectPolicy::Without(Effect::Shadows)), [false, false, false]);
        assert_eq!(answers(EffectPolicy::Without(Effect::Noise)), [false, false, true]);
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
