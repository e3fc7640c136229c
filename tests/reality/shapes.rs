//! Real presses of known depth against the same presses simulated from meshes: two spheres, a prism and a triangle, by a
//! sensor that was calibrated on a ball. The simulation never looks at the image: depth and place are the table's.
//!
//! Data of Chen et al. (RA-L 2022); meshes of Gomes, Wilson and Luo (2021), of which they printed these. Contact here is
//! the disc of 1.3 times the geometric circle of a sphere, or the circle round the outline of a flat face.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use gelsim_core::mesh::Mesh;
use gelsim_files::mesh;
use gelsim_job::config::Overrides;
use gelsim_job::plan::Plan;
use gelsim_job::sample::render;
use gelsim_lab::calibrate::pixels::ERROR_REACH;
use gelsim_lab::compare::picture;
use gelsim_lab::compare::score::{Scores, score_images};
use gelsim_lab::presses::Circle;
use image::RgbImage;
use rayon::prelude::*;
use tempfile::TempDir;

use super::real::{self, contact_mae, format_means, mean};

const SENSOR: &str = "gelsight_thu";
/// Radii of the spheres of the meshes, mm; the printed ones are smaller.
const MODELLED_MM: [(&str, f64); 2] = [("sphere", 3.0), ("large_sphere", 5.0)];
const SHAPES: [&str; 4] = ["sphere", "large_sphere", "prism", "triangle"];
/// Faces of the flat solids, mm; y of a mesh is up in the picture.
const PRISM_MM: [[f64; 2]; 4] = [[-2.5, 3.5], [2.5, 3.5], [2.5, -3.5], [-2.5, -3.5]];
const TRIANGLE_MM: [[f64; 2]; 3] = [[-3.5, 1.983], [0.5, 2.5], [3.5, -2.5]];

/// A press of known depth.
#[derive(Clone)]
struct Press {
    file: String,
    shape: String,
    depth_mm: f64,
    mm_per_px: f64,
    /// Where the mesh's origin is.
    origin_px: [f64; 2],
    /// Corners of a flat face as they were measured in the picture.
    outline_px: Vec<[f64; 2]>,
    circle: Circle,
    mesh: PathBuf,
    /// Radius of the printed sphere.
    ball_radius_mm: Option<f64>,
    real: RgbImage,
}

/// The middle of the inscribed circle: a triangle that loses as much on each side keeps it.
fn incentre(corners: &[[f64; 2]]) -> [f64; 2] {
    let length = |k: usize| {
        let (a, b) = (corners[(k + 1) % 3], corners[(k + 2) % 3]);
        (a[0] - b[0]).hypot(a[1] - b[1])
    };
    let whole: f64 = (0..3).map(length).sum();
    [0, 1].map(|axis| (0..3).map(|k| length(k) * corners[k][axis]).sum::<f64>() / whole)
}

fn presses(folder: &Path, meshes: &Path) -> Vec<Press> {
    let mut table = csv::Reader::from_path(folder.join("indenters.csv")).expect("a table of presses of known depth");
    let names = table.headers().expect("names of columns").clone();
    let rows = table.records().map(|row| row.expect("a row"));
    let press = |row: csv::StringRecord| {
        let text = |name: &str| row.get(names.iter().position(|known| known == name).expect("a column")).unwrap_or("");
        let number = |name: &str| text(name).parse::<f64>().ok();
        let pair = |pair: &str| {
            let mut numbers = pair.split_whitespace().map(|number| number.parse::<f64>().expect("a number"));
            [numbers.next().expect("x"), numbers.next().expect("y")]
        };
        let outline_px: Vec<[f64; 2]> =
            text("outline_px").split(';').filter(|corner| !corner.is_empty()).map(pair).collect();
        let mm_per_px = number("mm_per_px").expect("a pitch");
        let triangle = || {
            let (seen, mesh) = (incentre(&outline_px), incentre(&TRIANGLE_MM));
            [seen[0] - mesh[0] / mm_per_px, seen[1] + mesh[1] / mm_per_px]
        };
        let origin_px = match (number("centre_x_px"), number("centre_y_px")) {
            (Some(x), Some(y)) => [x, y],
            _ => triangle(),
        };
        let middle = [0, 1].map(|axis| mean(outline_px.iter().map(|corner| corner[axis])));
        let reach = |corner: &[f64; 2]| (corner[0] - middle[0]).hypot(corner[1] - middle[1]);
        let circle = match number("geometric_radius_px") {
            Some(radius_px) => Circle { centre_px: origin_px, radius_px },
            None => Circle { centre_px: middle, radius_px: outline_px.iter().map(reach).fold(0.0, f64::max) },
        };
        Press {
            file: text("file").to_owned(),
            shape: text("shape").to_owned(),
            depth_mm: number("press_depth_mm").expect("a depth"),
            mm_per_px,
            origin_px,
            circle,
            mesh: meshes.join(text("indenter_stl")),
            ball_radius_mm: number("ball_radius_mm"),
            real: image::open(folder.join(text("file"))).expect("a picture").into_rgb8(),
            outline_px,
        }
    };
    rows.map(press).collect()
}

fn obj(mesh: &Mesh, scale: f64) -> String {
    let mut text = String::new();
    for vertex in &mesh.vertices {
        let [x, y, z] = [0, 1, 2].map(|k| scale * (f64::from(vertex[k]) + mesh.centre_mm[k]));
        writeln!(text, "v {x} {y} {z}").expect("memory");
    }
    for corners in &mesh.triangles {
        let [a, b, c] = corners.map(|corner| corner + 1);
        writeln!(text, "f {a} {b} {c}").expect("memory");
    }
    text
}

/// A prism of two faces, the upper one (z = 0) inside the one `bevel_mm` below, with walls under it.
fn bevelled(top: &[[f64; 2]], below: &[[f64; 2]], bevel_mm: f64) -> String {
    let mut text = String::new();
    for (corners, z) in [(top, 0.0), (below, -bevel_mm), (below, -bevel_mm - 5.0)] {
        corners.iter().for_each(|[x, y]| writeln!(text, "v {x} {y} {z}").expect("memory"));
    }
    let count = top.len();
    let face: Vec<String> = (1..=count).map(|k| k.to_string()).collect();
    writeln!(text, "f {}", face.join(" ")).expect("memory");
    for (level, k) in [0, 1].into_iter().flat_map(|level| (0..count).map(move |k| (level * count, k))) {
        let next = (k + 1) % count;
        let [a, b, c, d] = [level + k, level + next, level + count + next, level + count + k].map(|k| k + 1);
        writeln!(text, "f {a} {b} {c} {d}").expect("memory");
    }
    text
}

/// What is pressed.
#[derive(Clone, Copy, PartialEq)]
enum Solid {
    /// The mesh; spheres in the size they were printed in.
    Modelled,
    /// Flat faces with the outline that was measured in the picture, and sharp edges.
    Outlined,
    /// The same with an edge that falls at 45 degrees to the outline of the mesh, or as far.
    Bevelled,
}

/// Writes what is pressed, and returns its file.
fn solid(press: &Press, solid: Solid, folder: &Path) -> PathBuf {
    let modelled: &[[f64; 2]] = if press.shape == "prism" { &PRISM_MM } else { &TRIANGLE_MM };
    let seen: Vec<[f64; 2]> = press
        .outline_px
        .iter()
        .map(|[x, y]| [(x - press.origin_px[0]) * press.mm_per_px, (press.origin_px[1] - y) * press.mm_per_px])
        .collect();
    let text = match (solid, press.ball_radius_mm) {
        (Solid::Modelled, None) => return press.mesh.clone(),
        (_, Some(radius_mm)) => {
            let (_, modelled_mm) = MODELLED_MM.iter().find(|(shape, _)| *shape == press.shape).expect("a sphere");
            obj(&mesh::load(&press.mesh, 1.0).expect("a mesh").mesh, radius_mm / modelled_mm)
        }
        (Solid::Outlined, None) => bevelled(&seen, &seen, 1e-3),
        (Solid::Bevelled, None) => bevelled(&seen, modelled, 0.2),
    };
    let path = folder.join(format!("{}_{}.obj", press.shape, solid as u8));
    fs::write(&path, text).expect("a file");
    path
}

/// How presses are simulated.
#[derive(Clone)]
struct Way {
    name: &'static str,
    /// The job's lines before its tables.
    models: String,
    sensor: String,
    solid: Solid,
    /// What depths are multiplied by.
    deeper: f64,
}

fn simulate(press: &Press, way: &Way, folder: &Path) -> RgbImage {
    let [x_mm, y_mm] = [0, 1].map(|k| {
        let middle = f64::from([press.real.width(), press.real.height()][k]) / 2.0;
        (press.origin_px[k] + 0.5 - middle) * press.mm_per_px
    });
    let object = solid(press, way.solid, folder);
    let job = format!(
        "{}\n[dataset]\nname = \"press\"\nsamples = 1\n[sensor]\n{}\n[[object]]\npath = {}\n\
         [pose]\nface = \"+z\"\nanchor = \"origin\"\nx_mm = {x_mm:?}\ny_mm = {y_mm:?}\n\
         [indentation]\ndepth_mm = {:?}\n[output]\nlayers = []\n",
        way.models,
        way.sensor,
        toml::Value::from(object.to_string_lossy().into_owned()),
        way.deeper * press.depth_mm,
    );
    let path = folder.join(format!("{}.toml", Path::new(&press.file).file_stem().expect("a name").to_string_lossy()));
    fs::write(&path, job).expect("a file");
    let plan = Plan::load(&path, &Overrides::default()).unwrap_or_else(|report| panic!("{report}"));
    let image = render(&plan, 0).impression.image;
    RgbImage::from_raw(image.width as u32, image.height as u32, image.rgb).expect("all pixels")
}

fn score_pictures(presses: &[Press], pictures: &[RgbImage]) -> Vec<Scores> {
    let of =
        |(press, picture): (&Press, &RgbImage)| score_images(&press.real, picture, Some(&press.circle), ERROR_REACH);
    presses.iter().zip(pictures).map(of).collect()
}

fn line(name: &str, presses: &[Press], scores: &[Scores]) {
    let of = |shape: &str| {
        mean(
            presses.iter().zip(scores).filter(|(press, _)| press.shape == shape).map(|(_, scores)| contact_mae(scores)),
        )
    };
    let shapes: String = SHAPES.iter().map(|shape| format!("{:8.2}", of(shape))).collect();
    println!("{name:52}{shapes}   {}", format_means(scores.iter()));
}

/// Calibrates on the balls as a user would.
fn calibrated(folder: &Path, out: &Path, more: &[&str]) -> String {
    let path = out.join(format!("sensor{}.toml", more.concat()));
    let output = Command::new(env!("CARGO_BIN_EXE_gelsim"))
        .arg("calibrate")
        .arg(folder.join("annotations.csv"))
        .arg("--background")
        .arg(folder.join("background.png"))
        .arg("--out")
        .arg(&path)
        .args(more)
        .output()
        .expect("the command");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    let told = |what: &str| {
        said.lines().filter(|line| line.contains(what)).map(|line| line[37..].to_owned()).collect::<String>()
    };
    println!(
        "calibrate {:28} thickness {}, contact over disc {}, cross-validated {}",
        more.join(" "),
        told("gelpad thickness"),
        told("contact over visible disc"),
        told("cross-validated, contact")
    );
    format!("file = {}", toml::Value::from(path.to_string_lossy().into_owned()))
}

#[test]
fn known_presses_of_other_shapes_are_nearer_to_the_calibrated_sensor() {
    let Some(real) = real::folder() else { return };
    let (folder, meshes) = (real.join(SENSOR), std::env::var_os("GELSIM_INDENTERS").map(PathBuf::from));
    let presses = presses(&folder, &meshes.unwrap_or_else(|| real.join("../indenters")));
    let out = TempDir::new().expect("a folder");
    let sensor = |more: &[&str]| calibrated(&folder, out.path(), more);
    let chosen = sensor(&[]);
    let background = toml::Value::from(folder.join("background.png").to_string_lossy().into_owned());
    let field_mm = 320.0 * presses[0].mm_per_px;
    let plain = format!(
        "resolution_px = [320, 320]\nfield_of_view_mm = [{field_mm:?}, {field_mm:?}]\nbackground = {background}"
    );
    let way = |name, sensor: &str, models: &str| Way {
        name,
        models: models.to_owned(),
        sensor: sensor.to_owned(),
        solid: Solid::Modelled,
        deeper: 1.0,
    };
    let level = |level: &str| format!("fidelity = \"{level}\"");
    let base = way("calibrated", &chosen, "");
    let ways = [
        way("phong, not calibrated, this background, 3 mm", &plain, ""),
        way("calibrated pad, phong", &chosen, "optics = \"phong\""),
        base.clone(),
        way("level paper (blur instead of the elastic pad)", &chosen, &level("paper")),
        way("level draft", &chosen, &level("draft")),
        way("level high", &chosen, &level("high")),
        way("level reference", &chosen, &level("reference")),
        Way { name: "flat faces as measured in the picture", solid: Solid::Outlined, ..base.clone() },
        Way { name: "the same with edges of 45 degrees, 0.2 mm deep", solid: Solid::Bevelled, ..base.clone() },
        Way { name: "depth x 0.8", deeper: 0.8, ..base.clone() },
        Way { name: "depth x 0.9", deeper: 0.9, ..base.clone() },
        Way { name: "depth x 1.1", deeper: 1.1, ..base.clone() },
        Way { name: "depth x 1.2", deeper: 1.2, ..base.clone() },
        Way { name: "edges of 45 degrees and depth x 0.9", solid: Solid::Bevelled, deeper: 0.9, ..base },
    ];
    let names: String = SHAPES.iter().map(|shape| format!("{:>8}", &shape[..shape.len().min(7)])).collect();
    println!("\n{:52}{names}   contact MAE / PSNR / SSIM | whole image MAE", "");
    let rest = image::open(folder.join("background.png")).expect("a picture").into_rgb8();
    let bare = score_pictures(&presses, &vec![rest; presses.len()]);
    line("background alone", &presses, &bare);
    let measure = |way: &Way| {
        let place = out.path().join(way.name.replace(' ', "_"));
        fs::create_dir_all(&place).expect("a folder");
        // The one file of a shape is written by each of its presses, with the same bytes.
        let pictures: Vec<RgbImage> = presses.iter().map(|press| simulate(press, way, &place)).collect();
        let scores = score_pictures(&presses, &pictures);
        line(way.name, &presses, &scores);
        let rows = presses.par_iter().zip(&pictures).zip(&scores).map(|((press, picture), scores)| {
            picture::comparison_row(
                format!("{}: contact MAE {:.2}", press.file, contact_mae(scores)),
                &press.real,
                picture,
            )
        });
        real::write(&format!("shapes, {}.png", way.name), &picture::draw_comparison_sheet(rows.collect(), 320));
        mean(scores.iter().map(contact_mae))
    };
    let mut errors = vec![mean(bare.iter().map(contact_mae))];
    errors.extend(ways.iter().map(measure));
    for [flag, value] in
        [["--thickness-mm", "3"], ["--thickness-mm", "6"], ["--contact-over-disc", "0.9"], ["--contact-over-disc", "1"]]
    {
        measure(&way("the line above", &sensor(&[flag, value]), ""));
    }
    let [bare, phong, _, calibrated, paper, ..] = errors[..] else { panic!("too few ways") };
    assert!(calibrated < bare && calibrated < phong && calibrated < paper, "{errors:?}");
}
