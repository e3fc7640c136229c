//! A number that may be random: a constant, a range, or one of four distributions.

use std::fmt;

use serde::de::{self, Deserializer, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Serialize, Serializer};

use gelsim_core::base::rng::RandomStream;

/// A number, or the distribution it is drawn from: `0.5`, `[0.2, 1.5]` (uniform), or a table with one of `uniform`,
/// `log_uniform`, `normal`, `choice`.
#[derive(Clone, Debug, PartialEq)]
pub enum Quantity {
    /// Always the same value.
    Constant(f64),
    /// A distribution.
    Random(Distribution),
}

/// The distribution of a random quantity.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "formats", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum Distribution {
    /// Every value from the first to the second number is equally likely.
    Uniform([f64; 2]),
    /// The logarithm is uniform: each factor of ten between the two numbers, both above 0, gets the same share.
    LogUniform([f64; 2]),
    /// The bell curve, cut to `min` .. `max` where they are given.
    Normal(Normal),
    /// One of the listed values, each as likely as the others.
    Choice(Vec<f64>),
}

/// Parameters of a normal distribution.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "formats", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Normal {
    /// Mean before cutting.
    pub mean: f64,
    /// Standard deviation before cutting, at least 0.
    pub std: f64,
    /// Nothing below this is drawn.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub min: Option<f64>,
    /// Nothing above this is drawn.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max: Option<f64>,
}

impl Normal {
    /// Returns the fraction of the uncut curve that lies between `min` and `max`.
    pub fn kept_share(&self) -> f64 {
        let below = |x: f64| libm::erfc((self.mean - x) / (self.std * std::f64::consts::SQRT_2)) / 2.0;
        if self.std == 0.0 {
            let inside = self.min.is_none_or(|min| min <= self.mean) && self.max.is_none_or(|max| self.mean <= max);
            return if inside { 1.0 } else { 0.0 };
        }
        self.max.map_or(1.0, below) - self.min.map_or(0.0, below)
    }
}

impl Default for Quantity {
    fn default() -> Self {
        Self::Constant(0.0)
    }
}

impl Quantity {
    /// Draws a value from a stream, always within the support. The quantity must be valid: see
    /// [`Quantity::find_error`].
    pub fn sample(&self, stream: &mut RandomStream) -> f64 {
        match self {
            Self::Constant(value) => *value,
            // The clamp undoes what rounding may add at the ends.
            Self::Random(Distribution::Uniform([min, max])) => (min + (max - min) * stream.uniform()).clamp(*min, *max),
            Self::Random(Distribution::LogUniform([min, max])) => {
                libm::exp(libm::log(*min) + (libm::log(*max) - libm::log(*min)) * stream.uniform()).clamp(*min, *max)
            }
            Self::Random(Distribution::Normal(normal)) => {
                let (min, max) = self.support();
                // At least 1 % of the curve is kept (checked in the plan). At that limit, a thousand misses in a row
                // happen once in 20,000 samples, and never at usual limits.
                for _ in 0..1000 {
                    let value = normal.mean + normal.std * stream.standard_normal();
                    if (min..=max).contains(&value) {
                        return value;
                    }
                }
                normal.mean.clamp(min, max)
            }
            Self::Random(Distribution::Choice(values)) => values[stream.uniform_below(values.len())],
        }
    }

    /// Returns the quantity times a factor above 0.
    pub fn scaled_by(&self, factor: f64) -> Self {
        let of = |value: &f64| factor * value;
        match self {
            Self::Constant(value) => Self::Constant(of(value)),
            Self::Random(distribution) => Self::Random(match distribution {
                Distribution::Uniform(range) => Distribution::Uniform(range.each_ref().map(of)),
                Distribution::LogUniform(range) => Distribution::LogUniform(range.each_ref().map(of)),
                Distribution::Choice(values) => Distribution::Choice(values.iter().map(of).collect()),
                Distribution::Normal(normal) => Distribution::Normal(Normal {
                    mean: of(&normal.mean),
                    std: of(&normal.std),
                    min: normal.min.as_ref().map(of),
                    max: normal.max.as_ref().map(of),
                }),
            }),
        }
    }

    /// Makes a uniform distribution from `min` to `max`.
    pub const fn uniform(min: f64, max: f64) -> Self {
        Self::Random(Distribution::Uniform([min, max]))
    }

    /// Returns the smallest and the largest value that can be drawn; infinite where a normal distribution is not cut.
    /// An empty choice has no values and gives (+inf, -inf).
    pub fn support(&self) -> (f64, f64) {
        match self {
            Self::Constant(value) => (*value, *value),
            Self::Random(Distribution::Uniform([min, max]) | Distribution::LogUniform([min, max])) => (*min, *max),
            Self::Random(Distribution::Normal(normal)) if normal.std == 0.0 => (normal.mean, normal.mean),
            Self::Random(Distribution::Normal(normal)) => {
                (normal.min.unwrap_or(f64::NEG_INFINITY), normal.max.unwrap_or(f64::INFINITY))
            }
            Self::Random(Distribution::Choice(values)) => values
                .iter()
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(min, max), value| (min.min(*value), max.max(*value))),
        }
    }

    /// Returns true if more than one value can be drawn.
    pub fn is_variable(&self) -> bool {
        let (min, max) = self.support();
        min != max
    }

    /// Returns a value in the middle of the support that stands for all; for a choice the first one.
    pub fn typical_value(&self) -> f64 {
        let (min, max) = self.support();
        match self {
            _ if min == max => min,
            Self::Constant(value) => *value,
            Self::Random(Distribution::Uniform([min, max])) => 0.5 * (min + max),
            Self::Random(Distribution::LogUniform([min, max])) => libm::sqrt(min * max),
            Self::Random(Distribution::Normal(normal)) => normal.mean.max(min).min(max),
            Self::Random(Distribution::Choice(values)) => values.first().copied().unwrap_or_default(),
        }
    }

    /// Finds what is wrong with the distribution in itself, whatever it is used for. Returns the message and what to
    /// do, or `None` if it is valid.
    pub fn find_error(&self) -> Option<(String, String)> {
        let (min, max) = self.support();
        let finite = match self {
            Self::Random(Distribution::Normal(normal)) => {
                let limits = [Some(normal.mean), Some(normal.std), normal.min, normal.max];
                limits.into_iter().flatten().all(f64::is_finite)
            }
            Self::Random(Distribution::Choice(values)) => values.iter().all(|value| value.is_finite()),
            _ => min.is_finite() && max.is_finite(),
        };
        match self {
            Self::Random(Distribution::Choice(values)) if values.is_empty() => {
                Some((String::from("a choice between no values"), String::from("list at least one value")))
            }
            _ if !finite => Some((String::from("not a finite number"), String::from("write an ordinary number"))),
            Self::Random(Distribution::Normal(normal)) if normal.std < 0.0 => {
                Some((format!("negative standard deviation {}", normal.std), format!("write std = {}", -normal.std)))
            }
            _ if min > max => {
                let help = match self {
                    Self::Random(Distribution::Normal(_)) => format!("write min = {max} and max = {min}"),
                    _ => format!("write the smaller number first: [{max}, {min}]"),
                };
                Some((format!("inverted range: {min} is above {max}"), help))
            }
            Self::Random(Distribution::LogUniform([min, max])) if *min <= 0.0 => Some((
                format!("log_uniform from {min}"),
                format!("the logarithm needs numbers above 0: begin above it, or write {{ uniform = [{min}, {max}] }}"),
            )),
            Self::Random(Distribution::Normal(normal)) if normal.kept_share() < 0.01 => {
                let or_uniform = match min.is_finite() && max.is_finite() {
                    true => format!(", or write {{ uniform = [{min}, {max}] }}"),
                    false => String::new(),
                };
                Some((
                    format!("min and max leave {:.3} % of the normal distribution", 100.0 * normal.kept_share()),
                    format!("widen the limits so that at least 1 % remains{or_uniform}"),
                ))
            }
            _ => None,
        }
    }
}

#[cfg(feature = "formats")]
impl schemars::JsonSchema for Quantity {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        std::borrow::Cow::Borrowed("Quantity")
    }

    fn json_schema(generator: &mut schemars::SchemaGenerator) -> schemars::Schema {
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

impl Serialize for Quantity {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Constant(value) => value.serialize(serializer),
            Self::Random(distribution) => distribution.serialize(serializer),
        }
    }
}

impl<'de> Deserialize<'de> for Quantity {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct QuantityVisitor;
        impl<'de> Visitor<'de> for QuantityVisitor {
            type Value = Quantity;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a number, [min, max], or a table with `uniform`, `log_uniform`, `normal` or `choice`")
            }

            fn visit_i64<E: de::Error>(self, value: i64) -> Result<Quantity, E> {
                Ok(Quantity::Constant(value as f64))
            }

            fn visit_f64<E: de::Error>(self, value: f64) -> Result<Quantity, E> {
                Ok(Quantity::Constant(value))
            }

            fn visit_seq<A: SeqAccess<'de>>(self, items: A) -> Result<Quantity, A::Error> {
                let range = <[f64; 2]>::deserialize(de::value::SeqAccessDeserializer::new(items))?;
                Ok(Quantity::Random(Distribution::Uniform(range)))
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Quantity, A::Error> {
                const DISTRIBUTIONS: [&str; 4] = ["uniform", "log_uniform", "normal", "choice"];
                let name: String = map.next_key()?.ok_or_else(|| {
                    de::Error::custom("empty table: one of `uniform`, `log_uniform`, `normal` or `choice` belongs here")
                })?;
                let distribution = match name.as_str() {
                    "uniform" => Distribution::Uniform(map.next_value()?),
                    "log_uniform" => Distribution::LogUniform(map.next_value()?),
                    "normal" => Distribution::Normal(map.next_value()?),
                    "choice" => Distribution::Choice(map.next_value()?),
                    _ => {
                        let near = crate::spelling::find_nearest_name(&name, DISTRIBUTIONS);
                        let hint = near.map_or(String::new(), |near| format!("; did you mean `{near}`?"));
                        return Err(de::Error::custom(format!(
                            "unknown distribution `{name}`: one of {}{hint}",
                            crate::spelling::join_alternatives(&DISTRIBUTIONS)
                        )));
                    }
                };
                match map.next_key::<String>()? {
                    None => Ok(Quantity::Random(distribution)),
                    Some(second) => {
                        let problem = format!("`{name}` and `{second}`: only one distribution at a time");
                        Err(de::Error::custom(problem))
                    }
                }
            }
        }
        deserializer.deserialize_any(QuantityVisitor)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gelsim_core::base::rng::random_stream;

    #[test]
    fn draws_have_the_moments_of_their_distribution() {
        let quantity = Quantity::Random(Distribution::Normal(Normal { mean: 2.0, std: 3.0, min: None, max: None }));
        let (mut sum, mut squares) = (0.0, 0.0);
        let count = 20_000;
        for index in 0..count {
            let value = quantity.sample(&mut random_stream(1, "x", index));
            sum += value;
            squares += value * value;
        }
        let mean = sum / count as f64;
        assert!((mean - 2.0).abs() < 0.1, "{mean}");
        let std = (squares / count as f64 - mean * mean).sqrt();
        assert!((std - 3.0).abs() < 0.1, "{std}");

        let log = Quantity::Random(Distribution::LogUniform([0.01, 100.0]));
        let below_one = (0..count).filter(|&i| log.sample(&mut random_stream(1, "y", i)) < 1.0).count();
        assert!((below_one as f64 / count as f64 - 0.5).abs() < 0.02);
    }
}
