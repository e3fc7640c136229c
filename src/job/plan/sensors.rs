//! The sensor of each sample: the job's own, or another one of the distribution that the job gives.

use super::files::Photograph;
use crate::config::Job;
use gelsim_core::base::rng::Stream;
use gelsim_files::hash::sha256;
use gelsim_files::sensor;
use gelsim_files::sensor::quantity::Quantity;
use gelsim_files::sensor::unit::{MOST_DEVIATIONS, Spreads};

/// What sensors are drawn from.
#[derive(Debug)]
pub struct SensorSampling {
    numbers: Vec<Number>,
    spreads: Vec<Group>,
    /// The photographs of the untouched pad: none if the background is rendered, one if all samples share it.
    pub photographs: Vec<Photograph>,
}

/// A number of the sensor that is drawn.
#[derive(Debug)]
struct Number {
    /// Its place in [`sensor::Sensor::numbers_mut`].
    place: usize,
    /// Name of its stream.
    stream: String,
    /// What it is drawn from.
    from: Quantity,
}

/// Numbers of the sensor that are drawn together.
#[derive(Debug)]
struct Group {
    /// Their places in [`sensor::Sensor::numbers_mut`].
    places: Vec<usize>,
    /// Name of their stream.
    stream: String,
    /// What they are drawn from.
    from: Spreads,
}

/// The sensor of one sample.
#[derive(Clone, Debug)]
pub struct DrawnSensor {
    /// Its numbers.
    pub numbers: sensor::Sensor,
    /// Which of the photographs it has, if there are any.
    pub photograph: usize,
}

impl SensorSampling {
    /// That of a job that was checked.
    pub fn new(job: &Job, photographs: Vec<Photograph>) -> Self {
        let mut sensor = job.sensor.clone();
        let paths: Vec<String> = sensor.numbers_mut().into_iter().map(|(path, _)| path).collect();
        let place = |path: &str| paths.iter().position(|known| known == path);
        let numbers = job.random.numbers.iter().filter(|(_, quantity)| quantity.varies());
        let numbers = numbers.filter_map(|(path, quantity)| {
            Some(Number { place: place(path)?, stream: stream_name("sensor", path), from: quantity.clone() })
        });
        let spreads = job.sensor.spreads().into_iter().filter_map(|from| {
            let places: Option<_> = from.numbers.iter().map(|number| place(&number.path)).collect();
            Some(Group { places: places?, stream: stream_name("unit", &from.name), from })
        });
        Self { numbers: numbers.collect(), spreads: spreads.collect(), photographs }
    }

    /// True if samples differ in their sensors.
    pub fn varies(&self) -> bool {
        !self.numbers.is_empty() || !self.spreads.is_empty() || self.photographs.len() > 1
    }

    /// The sensor of a sample, from streams of its own; `None` if all samples have that of the job.
    pub fn sample(&self, job: &Job, stream: impl Fn(&str) -> Stream) -> Option<Box<DrawnSensor>> {
        if !self.varies() {
            return None;
        }
        let mut drawn = job.sensor.clone();
        let mut numbers = drawn.numbers_mut();
        for Number { place, stream: name, from } in &self.numbers {
            *numbers[*place].1 = from.sample(&mut stream(name));
        }
        for Group { places, stream: name, from } in &self.spreads {
            let mut stream = stream(name);
            let deviations = from.deviations(|| stream.normal());
            for ((place, spread), deviations) in places.iter().zip(&from.numbers).zip(deviations) {
                let number = &mut *numbers[*place].1;
                *number = spread.shifted(*number, deviations);
            }
        }
        let photograph = stream("sensor background").below(self.photographs.len());
        Some(Box::new(DrawnSensor { numbers: drawn, photograph }))
    }
}

/// Paths are longer than the names of streams may be.
fn stream_name(kind: &str, path: &str) -> String {
    sha256(format!("{kind}.{path}").as_bytes())[..24].to_owned()
}

/// The smallest and the largest value that a sample may have of the number at this path below `[sensor]`, which is `value`
/// where nothing is drawn.
pub fn support(job: &Job, path: &str, value: f64) -> [f64; 2] {
    let of_job = job.random.numbers.iter().find(|(known, _)| known == path);
    let (min, max) = of_job.map_or((value, value), |(_, quantity)| quantity.support());
    match job.sensor.spreads().iter().flat_map(|group| &group.numbers).find(|spread| spread.path == path) {
        Some(spread) => [spread.shifted(min, -MOST_DEVIATIONS), spread.shifted(max, MOST_DEVIATIONS)],
        None => [min, max],
    }
}
