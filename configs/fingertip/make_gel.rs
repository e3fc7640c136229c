//! Writes the gel of sensor.toml: `cargo run --release --example make_gel [FILE]`.
//!
//! A pad over a rounded rectangle that curves down to its walls, as on a gripper's finger: everything between a ball and a box.

use std::fmt::Write;
use std::path::PathBuf;
use std::process::ExitCode;

/// Half its length and width, mm.
const HALF_MM: [f64; 2] = [13.0, 10.0];
/// How far it curves down from the tip, and the wall below that, mm.
const CURVED_MM: f64 = 9.0;
const WALL_MM: f64 = 4.0;
/// Powers of the outline and of the section: 2 is round, and the more the squarer.
const OUTLINE: f64 = 3.0;
const SECTION: f64 = 2.5;

const AROUND: usize = 72;
const CURVED_RINGS: usize = 22;
const WALL_RINGS: usize = 4;

fn main() -> ExitCode {
    let default = concat!(env!("CARGO_MANIFEST_DIR"), "/configs/fingertip/gel.obj");
    let path = PathBuf::from(std::env::args_os().nth(1).unwrap_or_else(|| default.into()));
    match std::fs::write(&path, text()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{}: {error}", path.display());
            ExitCode::FAILURE
        }
    }
}

fn text() -> String {
    let mut text =
        String::from("# The outer surface of a soft fingertip, mm, its tip at the origin and z out of it\nv 0 0 0\n");
    let rings = CURVED_RINGS + WALL_RINGS;
    for ring in 1..=rings {
        let (share, z) = section(ring);
        for step in 0..AROUND {
            let (sin, cos) = libm::sincos(std::f64::consts::TAU * step as f64 / AROUND as f64);
            let across = libm::pow(libm::pow(cos.abs(), OUTLINE) + libm::pow(sin.abs(), OUTLINE), -1.0 / OUTLINE);
            let [x, y] = [cos * HALF_MM[0], sin * HALF_MM[1]].map(|mm| mm * across * share + 0.0);
            writeln!(text, "v {x:.4} {y:.4} {z:.4}").expect("a string takes all");
        }
    }
    // OBJ counts from 1.
    let vertex = |ring: usize, step: usize| 2 + (ring - 1) * AROUND + step % AROUND;
    for step in 0..AROUND {
        writeln!(text, "f 1 {} {}", vertex(1, step), vertex(1, step + 1)).expect("a string takes all");
    }
    for (ring, step) in (1..rings).flat_map(|ring| (0..AROUND).map(move |step| (ring, step))) {
        let [a, b, c, d] = [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(r, s)| vertex(ring + r, step + s));
        writeln!(text, "f {a} {b} {c} {d}").expect("a string takes all");
    }
    text
}

/// How far out a ring is, as a share, and its height, mm.
fn section(ring: usize) -> (f64, f64) {
    if ring > CURVED_RINGS {
        return (1.0, -CURVED_MM - WALL_MM * (ring - CURVED_RINGS) as f64 / WALL_RINGS as f64);
    }
    let (sin, cos) = libm::sincos(std::f64::consts::FRAC_PI_2 * ring as f64 / CURVED_RINGS as f64);
    let cos = if ring == CURVED_RINGS { 0.0 } else { cos };
    (libm::pow(sin, 2.0 / SECTION), -CURVED_MM * (1.0 - libm::pow(cos, 2.0 / SECTION)))
}
