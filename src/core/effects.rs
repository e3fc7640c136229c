//! The effects of a press, and the mechanism that runs only those that can change a pixel.
//!
//! A stage asks the [`EffectLog`] of the press to run an effect and says whether the press needs it. The log runs it or
//! not, and notes the decision, the reason and the CPU time. Labels, statistics and the comparisons of `tradeoff` read
//! these notes. What each criterion proves, or by how much it may be wrong, is in `docs/explanation/effects.md`.

use std::borrow::Cow;
use std::fmt;
use std::marker::PhantomData;
use std::ops::{Index, IndexMut};

use serde::de::{self, Deserializer, MapAccess, Visitor};
use serde::ser::SerializeMap;
use serde::{Deserialize, Serialize, Serializer};

use super::base::clock::ThreadClock;

macro_rules! effects {
    ($($effect:ident, $name:literal, $summary:literal;)*) => {
        /// Something that a press computes only where it can change a pixel; the variants are in the order in which
        /// they run.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[non_exhaustive]
        pub enum Effect { $(#[doc = $summary] $effect,)* }

        impl Effect {
            /// All effects, in the order in which they run.
            pub const ALL: [Self; [$($name),*].len()] = [$(Self::$effect),*];

            /// Returns the effect's name in labels and statistics.
            pub fn name(self) -> &'static str {
                match self { $(Self::$effect => $name,)* }
            }

            /// Returns what the effect is, and where it runs.
            pub fn summary(self) -> &'static str {
                match self { $(Self::$effect => $summary,)* }
            }
        }
    };
}

// One row per effect: its variant, its name in labels and statistics, and what it is and where it runs.
effects! {
    Texture, "texture", "micro relief of the object; runs where a textured object reaches into the pad";
    RestShape, "rest_shape", "a curved pad under the object; runs where a pad that is not flat meets an object";
    Deformation, "deformation", "the pad's shape under and around the object; runs where the object reaches into it";
    Friction, "friction", "friction while the object is pressed in; runs where markers or the surface show it";
    Relaxation, "relaxation", "stress that falls with time under a shape that is held; runs in sequences on pads that relax, once something has loaded them";
    FiniteStrain, "finite_strain", "large strains: the difference between rubber and a linear layer; runs where that is larger than the level's tolerance";
    Supersampling, "supersampling", "light averaged over a pixel; runs for pixels within which the surface bends";
    Shear, "shear", "in-plane motion under an object that is pushed or turned; runs where something shows it";
    Shading, "shading", "light of the LEDs on the deformed surface; runs where the surface is not flat";
    Grain, "grain", "relief of the pad's coating; runs where a coated pad is deformed";
    Shadows, "shadows", "shadows cast on the surface; run for each LED that is lower than the steepest slope";
    Mirror, "mirror", "images of the LEDs in the window, which light the pad, too; run where the surface is not flat";
    Bounce, "bounce", "light that one part of the coat throws onto another; runs where slopes are steep enough";
    Darkening, "darkening", "loss of light with depth; runs with shading where the surface is pressed in";
    Markers, "markers", "dots printed on the pad, or pins inside it; run where something moves them or they differ between samples";
    Defocus, "defocus", "blur of the lens; runs where the press changed the light";
    Distortion, "distortion", "distortion of the lens; runs where the press changed the light";
    Vignette, "vignette", "loss of light towards the corners; runs where the press changed the light";
    Speckle, "speckle", "grain that the skin shows where it is touched; runs where the pad is touched";
    Exposure, "exposure", "exposure and white balance; run where they are not neutral";
    Noise, "noise", "shot and read noise; runs where there is any";
}

/// Whether a press needs an effect, with the reason.
#[derive(Clone, Debug, PartialEq)]
pub enum Requirement {
    /// The job or the sensor does not have the effect: there is nothing to run.
    Absent(&'static str),
    /// The effect would change no pixel, or none by more than the bound in `docs/explanation/effects.md`.
    Unneeded(&'static str),
    /// The effect can change a pixel.
    Needed(&'static str),
}

/// Which effects run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
#[cfg_attr(feature = "schema", schemars(rename = "Gate"))]
pub enum EffectPolicy {
    /// The effects that can change a pixel.
    #[default]
    #[serde(rename = "called_for")]
    WhereNeeded,
    /// All effects that the job and the sensor have, on every pixel: the reference for the criteria.
    All,
    /// The effects that can change a pixel, except this one.
    #[serde(skip)]
    Without(Effect),
}

/// Which effects of one press ran, why, and how long each took.
#[derive(Clone, Debug)]
pub struct EffectLog {
    policy: EffectPolicy,
    /// Whether each effect ran, and why.
    pub notes: PerEffect<EffectNote>,
    /// CPU seconds that each effect took. Darkening is computed with shading and counts there.
    pub seconds: PerEffect<f64>,
}

/// Whether an effect ran, and why.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "schema", schemars(rename = "Effect"))]
pub struct EffectNote {
    /// True if it was computed.
    pub ran: bool,
    /// Why, or why not.
    pub reason: Cow<'static, str>,
}

impl EffectLog {
    /// Returns the log of the same effects without the time that they took.
    pub(crate) fn without_seconds(self) -> Self {
        Self { seconds: PerEffect::default(), ..self }
    }

    /// Makes a log in which nothing has run yet.
    pub fn new(policy: EffectPolicy) -> Self {
        Self { policy, notes: PerEffect::default(), seconds: PerEffect::default() }
    }

    /// Returns true if every effect runs on every pixel.
    pub(crate) fn runs_everywhere(&self) -> bool {
        self.policy == EffectPolicy::All
    }

    /// Returns true if the policy leaves `effect` out.
    pub(crate) fn leaves_out(&self, effect: Effect) -> bool {
        self.policy == EffectPolicy::Without(effect)
    }

    /// Decides whether `effect` runs, and notes the decision with its reason.
    pub(crate) fn enable(&mut self, effect: Effect, need: Requirement) -> bool {
        let (ran, reason) = match (self.policy, need) {
            (EffectPolicy::Without(left_out), _) if left_out == effect => (false, "left out"),
            // `All` runs what the press does not need, but even then nothing absent can run.
            (EffectPolicy::All, Requirement::Unneeded(reason)) | (_, Requirement::Needed(reason)) => (true, reason),
            (_, Requirement::Unneeded(reason) | Requirement::Absent(reason)) => (false, reason),
        };
        self.notes[effect] = EffectNote { ran, reason: Cow::Borrowed(reason) };
        ran
    }

    /// Replaces the reason of an effect whose work turned out otherwise.
    pub(crate) fn explain(&mut self, effect: Effect, reason: &'static str) {
        self.notes[effect].reason = Cow::Borrowed(reason);
    }

    /// Runs the work of `effect` if it is enabled; returns `None` if it is not.
    pub(crate) fn run<T>(&mut self, effect: Effect, need: Requirement, work: impl FnOnce() -> T) -> Option<T> {
        self.enable(effect, need).then(|| self.run_timed(effect, work))
    }

    /// Runs `work` and adds its CPU time to that of `effect`.
    pub(crate) fn run_timed<T>(&mut self, effect: Effect, work: impl FnOnce() -> T) -> T {
        let mut clock = ThreadClock::start();
        let result = work();
        self.seconds[effect] += clock.lap();
        result
    }
}

/// A value for each effect. In JSON it is an object with the effects' names as keys.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PerEffect<T>([T; Effect::ALL.len()]);

impl<T> PerEffect<T> {
    /// Iterates over the effects and their values, in the order in which they run.
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
                // Values have a default, but an effect that is not named is an error all the same.
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
