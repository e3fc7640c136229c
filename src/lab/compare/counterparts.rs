//! Why no image of one folder belongs to one of another, and what would give them counterparts.

use std::path::Path;

use super::images::Images;
use crate::presses::Column;

/// What two folders are that have no pair of images.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MissingPairs {
    real: String,
    sim: String,
    real_is: Real,
    sim_is: Sim,
}

/// What the real side is.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Real {
    /// A dataset by gelsim: made, not real.
    Dataset,
    /// A table of presses; whether each press can be simulated from it, and if not, the columns that it lacks.
    Table(Vec<&'static str>),
    /// Images alone.
    Images,
}

/// What the simulated side is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Sim {
    Images,
    Flat,
    /// A dataset of a sensor whose gel has a shape, which calibrate does not simulate.
    Shaped,
}

impl MissingPairs {
    /// What two sides are.
    pub fn between([real_path, sim_path]: [&Path; 2], real: &Images, sim: &Images) -> Self {
        let needed = [Column::CentreX, Column::CentreY, Column::Radius, Column::BallRadius];
        let real_is = match real {
            Images::Dataset(_) => Real::Dataset,
            Images::Sensors(sensors) => match sensors.iter().find_map(|sensor| sensor.table.as_ref()) {
                None => Real::Images,
                Some(table) => {
                    Real::Table(needed.into_iter().filter(|column| !table.has(*column)).map(Column::name).collect())
                }
            },
        };
        let sim_is = match sim {
            Images::Sensors(_) => Sim::Images,
            Images::Dataset(dataset) if dataset.job.sensor.shape.is_some() => Sim::Shaped,
            Images::Dataset(_) => Sim::Flat,
        };
        Self { real: real_path.display().to_string(), sim: sim_path.display().to_string(), real_is, sim_is }
    }

    /// What to do, in sentences.
    pub fn text(&self) -> String {
        let Self { real, sim, real_is, sim_is } = self;
        let by_name = match sim_is {
            Sim::Images => {
                format!("To compare image by image, give the images in {sim} the names of their real counterparts.")
            }
            _ => String::from(
                "To compare image by image, simulate each real press in a job with output.container = \"folder\", copy each \
                 KEY.tactile.png to a folder under the name of its real image, and compare with that folder.",
            ),
        };
        let simulate = |needs: &str| {
            format!(
                "To measure the simulator, simulate the presses of {real}{needs}:\n  gelsim calibrate --evaluate \
                 {real}/annotations.csv --sensor SENSOR.toml --out SIM\n  gelsim compare {real} SIM"
            )
        };
        match (real_is, sim_is) {
            (Real::Dataset, _) => String::from(
                "Images of a dataset never pair: their numbers stand for no real press. Name real images first.",
            ),
            (_, Sim::Shaped) => by_name,
            (Real::Table(lacking), _) if lacking.is_empty() => simulate(""),
            (Real::Table(lacking), _) => {
                simulate(&format!(", once {real}/annotations.csv has the columns {}", lacking.join(", ")))
            }
            (Real::Images, _) => format!(
                "{by_name}\n{}",
                simulate(&format!(
                    ", once {real}/annotations.csv says for each image the circle and the ball's radius: file,centre_x_px,\
                     centre_y_px,radius_px,ball_radius_mm"
                ))
            ),
        }
    }
}
