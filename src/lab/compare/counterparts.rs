//! Explains why no image of one folder has a counterpart in another, and what would give them counterparts.

use std::path::{Path, PathBuf};

use super::images::{FolderImages, TABLE_NAME};
use crate::presses::PressColumn;
use gelsim_files::spelling::quote_for_shell;

/// Two folders without a pair of images.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MissingPairs {
    real: PathBuf,
    sim: PathBuf,
    /// The table of real presses, or where one may be written.
    table: PathBuf,
    real_is: RealSide,
    sim_is: SimSide,
}

/// Kind of the real side.
#[derive(Clone, Debug, PartialEq, Eq)]
enum RealSide {
    /// A dataset of gelsim's own, so not of a real sensor.
    Dataset,
    /// A table of presses, with the columns that are missing to simulate each press; none missing if the list is empty.
    Table(Vec<&'static str>),
    /// Images without a table.
    Images,
}

/// Kind of the simulated side.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum SimSide {
    /// Images.
    Images,
    /// A dataset of a flat sensor.
    Flat,
    /// A dataset of a sensor whose gel has a shape, which calibrate does not simulate.
    Shaped,
}

impl MissingPairs {
    /// Classifies two sides.
    pub fn from_sides([real_path, sim_path]: [&Path; 2], real: &FolderImages, sim: &FolderImages) -> Self {
        let needed = [PressColumn::CentreX, PressColumn::CentreY, PressColumn::Radius, PressColumn::BallRadius];
        let known = match real {
            FolderImages::Dataset(_) => None,
            FolderImages::Sensors(sensors) => sensors.iter().find_map(|sensor| sensor.table.as_ref()),
        };
        let table = known.map_or_else(|| real_path.join(TABLE_NAME), |table| table.path.clone());
        let real_is = match real {
            FolderImages::Dataset(_) => RealSide::Dataset,
            FolderImages::Sensors(_) => match known {
                None => RealSide::Images,
                Some(table) => RealSide::Table(
                    needed.into_iter().filter(|column| !table.has_column(*column)).map(PressColumn::name).collect(),
                ),
            },
        };
        let sim_is = match sim {
            FolderImages::Sensors(_) => SimSide::Images,
            FolderImages::Dataset(dataset) if dataset.job.sensor.shape.is_some() => SimSide::Shaped,
            FolderImages::Dataset(_) => SimSide::Flat,
        };
        Self { real: real_path.to_owned(), sim: sim_path.to_owned(), table, real_is, sim_is }
    }

    /// Returns what to do, in sentences.
    pub fn to_advice(&self) -> String {
        let Self { real, sim, table, real_is, sim_is } = self;
        let (real, sim, shown) = (quote_for_shell(real), sim.display(), table.display());
        let table = quote_for_shell(table);
        let by_name = match sim_is {
            SimSide::Images => {
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
                 {table} --sensor SENSOR.toml --out SIM\n  gelsim compare {real} SIM"
            )
        };
        match (real_is, sim_is) {
            (RealSide::Dataset, _) => String::from(
                "Images of a dataset never pair: their numbers stand for no real press. Name real images first.",
            ),
            (_, SimSide::Shaped) => by_name,
            (RealSide::Table(lacking), _) if lacking.is_empty() => simulate(""),
            (RealSide::Table(lacking), _) => {
                simulate(&format!(", once {shown} has the columns {}", lacking.join(", ")))
            }
            (RealSide::Images, _) => format!(
                "{by_name}\n{}",
                simulate(&format!(
                    ", once {shown} says for each image the circle and the ball's radius: file,centre_x_px,centre_y_px,\
                     radius_px,ball_radius_mm"
                ))
            ),
        }
    }
}
