//! Draws the sensor of each sample: the job's own, or one from the distributions that the job gives.

use super::files::Photograph;
use crate::config::Job;
use gelsim_core::base::rng::RandomStream;
use gelsim_files::hash::sha256;
use gelsim_files::sensor;
use gelsim_files::sensor::quantity::Quantity;
use gelsim_files::sensor::unit::{MAX_DEVIATIONS, SpreadGroup};

/// The distributions from which sensors are drawn.
#[derive(Debug)]
pub struct SensorSampling {
    numbers: Vec<SampledNumber>,
    spreads: Vec<SampledGroup>,
    /// Photographs of the untouched pad: none if the background is rendered, one if all samples share it.
    pub photographs: Vec<Photograph>,
}

/// A number of the sensor that is drawn.
#[derive(Debug)]
struct SampledNumber {
    /// Index in [`sensor::Sensor::numbers_mut`].
    place: usize,
    /// Name of the random stream.
    stream: String,
    /// Distribution.
    from: Quantity,
}

/// Numbers of the sensor that are drawn together.
#[derive(Debug)]
struct SampledGroup {
    /// Indices in [`sensor::Sensor::numbers_mut`].
    places: Vec<usize>,
    /// Name of the random stream.
    stream: String,
    /// Distribution.
    from: SpreadGroup,
}

/// The sensor of a sample.
#[derive(Clone, Debug)]
pub struct DrawnSensor {
    /// The sensor with the drawn numbers.
    pub numbers: sensor::Sensor,
    /// Index of its photograph, if there are any.
    pub photograph: usize,
}

impl SensorSampling {
    /// Collects the distributions of a job that was checked.
    pub fn new(job: &Job, photographs: Vec<Photograph>) -> Self {
        let mut sensor = job.sensor.clone();
        let paths: Vec<String> = sensor.numbers_mut().into_iter().map(|(path, _)| path).collect();
        let place = |path: &str| paths.iter().position(|known| known == path);
        let numbers = job.random.numbers.iter().filter(|(_, quantity)| quantity.is_variable());
        let numbers = numbers.filter_map(|(path, quantity)| {
            Some(SampledNumber { place: place(path)?, stream: stream_name("sensor", path), from: quantity.clone() })
        });
        let spreads = job.sensor.spread_groups().into_iter().filter_map(|from| {
            let places: Option<_> = from.numbers.iter().map(|number| place(&number.path)).collect();
            Some(SampledGroup { places: places?, stream: stream_name("unit", &from.name), from })
        });
        Self { numbers: numbers.collect(), spreads: spreads.collect(), photographs }
    }

    /// Returns true if samples differ in their sensors.
    pub fn is_variable(&self) -> bool {
        !self.numbers.is_empty() || !self.spreads.is_empty() || self.photographs.len() > 1
    }

    /// Draws the sensor of a sample. `stream` returns the random stream of a name. Returns `None` if all samples have
    /// the sensor of the job.
    pub fn sample(&self, job: &Job, stream: impl Fn(&str) -> RandomStream) -> Option<Box<DrawnSensor>> {
        if !self.is_variable() {
            return None;
        }
        let mut drawn = job.sensor.clone();
        let mut numbers = drawn.numbers_mut();
        for SampledNumber { place, stream: name, from } in &self.numbers {
            *numbers[*place].1 = from.sample(&mut stream(name));
        }
        for SampledGroup { places, stream: name, from } in &self.spreads {
            let mut stream = stream(name);
            let deviations = from.draw_deviations(|| stream.standard_normal());
            for ((place, spread), deviations) in places.iter().zip(&from.numbers).zip(deviations) {
                let number = &mut *numbers[*place].1;
                *number = spread.shift_value(*number, deviations);
            }
        }
        let photograph = stream("sensor background").uniform_below(self.photographs.len());
        Some(Box::new(DrawnSensor { numbers: drawn, photograph }))
    }
}

/// Makes the name of a random stream. It is a hash, since paths are longer than the names of streams may be.
fn stream_name(kind: &str, path: &str) -> String {
    sha256(format!("{kind}.{path}").as_bytes())[..24].to_owned()
}

/// Returns the smallest and the largest value that the number at this path below `[sensor]` may have in a sample.
/// `value` is the job's own value.
pub fn number_support(job: &Job, path: &str, value: f64) -> [f64; 2] {
    let of_job = job.random.numbers.iter().find(|(known, _)| known == path);
    let (min, max) = of_job.map_or((value, value), |(_, quantity)| quantity.support());
    match job.sensor.spread_groups().iter().flat_map(|group| &group.numbers).find(|spread| spread.path == path) {
        Some(spread) => [spread.shift_value(min, -MAX_DEVIATIONS), spread.shift_value(max, MAX_DEVIATIONS)],
        None => [min, max],
    }
}
