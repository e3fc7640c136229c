//! Writes the bundled objects: `cargo run --release --example make_objects [DIR]`.
//!
//! Every mesh is closed by construction: outlines are drawn, then lofted, turned, swept and capped
//! on shared corners; nothing is cut from anything else. No randomness and no arithmetic that
//! differs between machines: the same bytes everywhere.

use std::path::PathBuf;
use std::process::ExitCode;

#[path = "make/basic.rs"]
mod basic;
#[path = "make/hardware.rs"]
mod hardware;
#[path = "make/outline.rs"]
mod outline;
#[path = "make/pattern.rs"]
mod pattern;
#[path = "make/relief.rs"]
mod relief;
#[path = "make/solid.rs"]
mod solid;
#[path = "make/sweep.rs"]
mod sweep;
#[cfg(test)]
#[path = "make/tests.rs"]
mod tests;

use solid::Solid;

/// One file: its stem, what it is, and its maker.
type Object = (&'static str, &'static str, fn() -> Solid);

const OBJECTS: [Object; 29] = [
    ("sphere", "ball, radius 4", basic::sphere),
    ("flat_face", "block with a large flat face, edges rounded", basic::flat_face),
    ("thin_ridge", "blade 1 thick with a round crest", basic::thin_ridge),
    ("prism_corner", "square prism on its corner", basic::prism_corner),
    ("prism_edge", "square bar on its edge", basic::prism_edge),
    ("cube", "cube, edge 5", basic::cube),
    ("slab", "slab, its contact face z = 0", basic::slab),
    ("edge_slab", "slab, its contact face z = 0, its edge the x axis", basic::edge_slab),
    ("cone", "cone of 90 degrees, tip radius 0.25", basic::cone),
    ("torus", "torus, tube 3.2 on a circle of 10", basic::torus),
    ("cylinder", "flat punch, diameter 8", basic::cylinder),
    ("cylinder_shell", "tube, diameter 8, wall 0.8", basic::cylinder_shell),
    ("washer", "washer M5", basic::washer),
    ("hexagon_nut", "nut M6", hardware::hexagon_nut),
    ("bolt", "hexagon bolt M5 on its side", hardware::bolt),
    ("phillips_screw", "pan head M4 with a cross recess", hardware::phillips_screw),
    ("socket_screw", "socket head M5", hardware::socket_screw),
    ("gear", "spur gear, 18 teeth, module 0.7", hardware::gear),
    ("brick", "toy brick, two by two studs", hardware::brick),
    ("crossed_ridges", "two ridges 1.6 wide that cross", pattern::crossed_ridges),
    ("parallel_ridges", "six ridges 2.5 apart", pattern::parallel_ridges),
    ("grating", "ridges from 0.3 to 2 wide", pattern::grating),
    ("wave", "sine, wave length 4, height 1", pattern::wave),
    ("knurl", "truncated pyramids 1.5 apart", pattern::knurl),
    ("dots", "twelve hemispheres of radius 1, 4 apart", pattern::dots),
    ("rope", "three-strand rope, thickness 4.7", pattern::rope),
    ("coin", "coin, diameter 14, relief 0.5", relief::coin),
    ("letter", "letter R, relief 1.5", relief::letter),
    ("key", "flat key, thickness 2", relief::key),
];

fn main() -> ExitCode {
    let default = concat!(env!("CARGO_MANIFEST_DIR"), "/objects");
    let folder = PathBuf::from(std::env::args_os().nth(1).unwrap_or_else(|| default.into()));
    if let Err(error) = std::fs::create_dir_all(&folder) {
        eprintln!("{}: {error}", folder.display());
        return ExitCode::FAILURE;
    }
    let mut total = 0;
    for (name, what, make) in OBJECTS {
        let solid = make();
        let text = solid.obj(name, what);
        let path = folder.join(name).with_extension("obj");
        if let Err(error) = std::fs::write(&path, &text) {
            eprintln!("{}: {error}", path.display());
            return ExitCode::FAILURE;
        }
        println!("{name:16} {:6} triangles {:7} bytes", solid.triangle_count(), text.len());
        total += text.len();
    }
    println!("{} files, {total} bytes", OBJECTS.len());
    ExitCode::SUCCESS
}
