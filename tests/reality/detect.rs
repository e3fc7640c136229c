//! Detection on real presses: a table of errors per sensor, of confidence against them, and of suspicions.

use std::path::{Path, PathBuf};

use gelsim::calibrate::detect::{Detection, detect};
use gelsim::presses::Circle;
use image::RgbImage;

/// Sensors whose annotations are good, then the others.
const SENSORS: [&str; 6] =
    ["gelsight_thu", "gsmini_gssdk", "gelsight_taxim", "gelsight_fots", "digit_fots", "gsmini_taxim"];

struct Press {
    image: RgbImage,
    circle: Circle,
}

struct Sensor {
    background: RgbImage,
    presses: Vec<Press>,
}

fn open(path: &Path) -> RgbImage {
    image::open(path).unwrap_or_else(|error| panic!("{}: {error}", path.display())).into_rgb8()
}

fn sensor(folder: &Path) -> Sensor {
    let table = std::fs::read_to_string(folder.join("annotations.csv")).expect("a table of presses");
    let mut rows = table.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let head = rows.next().expect("a head");
    let column = |name: &str| head.iter().position(|column| *column == name).expect("a column");
    let [file, x, y, radius] = ["file", "centre_x_px", "centre_y_px", "radius_px"].map(column);
    let number = |row: &[&str], at: usize| row[at].parse::<f64>().expect("a number");
    let presses = rows.map(|row| Press {
        image: open(&folder.join(row[file])),
        circle: Circle { centre_px: [number(&row, x), number(&row, y)], radius_px: number(&row, radius) },
    });
    Sensor { background: open(&folder.join("background.png")), presses: presses.collect() }
}

/// The folder of real presses, if the environment names one.
fn real() -> Option<PathBuf> {
    let folder = std::env::var_os("GELSIM_REAL_DATA").map(PathBuf::from);
    if folder.is_none() {
        println!("GELSIM_REAL_DATA names no folder with real presses: nothing is tested here");
    }
    folder
}

fn median(values: &[f64]) -> f64 {
    gelsim::metrics::statistics::median(values).expect("there are values")
}

#[test]
fn real_presses_are_found() {
    let Some(folder) = real() else { return };
    for name in SENSORS {
        let sensor = sensor(&folder.join(name));
        let start = std::time::Instant::now();
        let found: Vec<Option<Detection>> =
            sensor.presses.iter().map(|press| detect(&press.image, &sensor.background)).collect();
        let ms = 1e3 * start.elapsed().as_secs_f64() / found.len() as f64;
        let (mut away, mut ratio) = (Vec::new(), Vec::new());
        for (press, found) in sensor.presses.iter().zip(&found) {
            let Some(found) = found else { away.push(1e9); continue };
            let d = [0, 1].map(|k| found.circle.centre_px[k] - press.circle.centre_px[k]);
            away.push(d[0].hypot(d[1]));
            ratio.push(found.circle.radius_px / press.circle.radius_px);
            if std::env::var_os("DUMP").is_some() {
                let e = found.evidence;
                println!("DUMP {name} {} {} {} {} {} {} {}", d[0].hypot(d[1]), press.circle.radius_px, found.circle.radius_px, e.contrast, e.explained, e.disagreement, e.in_view);
            }
        }
        let within = |px: f64| away.iter().filter(|away| **away <= px).count() as f64 / away.len() as f64;
        let off: Vec<f64> = ratio.iter().map(|r| (r - 1.0).abs()).collect();
        println!(
            "{name:15} centre {:.2} px, within 3 {:.2}, within 5 {:.2}; ratio {:.3}, off {:.3}; {ms:.1} ms",
            median(&away), within(3.0), within(5.0), median(&ratio), median(&off)
        );
    }
}
