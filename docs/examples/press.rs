//! Presses a mesh into a sensor, with a texture and a shear, and saves the tactile image.
//!
//!     cargo run --release --example press [MESH [SENSOR]]
//!
//! MESH is any mesh file, SENSOR a preset's name or a sensor file.

use std::error::Error;
use std::path::Path;
use std::sync::Arc;

use gelsim::{
    Angles, Fidelity, Friction, ImageExt, Indenter, Mesh, MeshExt, Motion, Pose, Press, Procedural, Relief, Sensor,
    SensorExt, Shear, Side, Simulator, Texture, TextureSample,
};

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let mesh = arguments.next().unwrap_or_else(|| String::from("objects/gear.obj"));
    let sensor = arguments.next().unwrap_or_else(|| String::from("gelsight-mini"));

    let sensor = if Path::new(&sensor).is_file() { Sensor::load(&sensor)? } else { Sensor::preset(&sensor)? };
    let simulator = Simulator::new(&sensor, Fidelity::Standard)?; // the costly part: make it once, share it by reference

    // The mesh's upper side faces the pad, turned by 20 degrees, 0.4 mm deep.
    let pose = Pose::turned(Side::PlusZ, Angles { yaw_deg: 20.0, tilt_deg: 0.0, tilt_azimuth_deg: 0.0 });
    let indenter = Indenter::mesh(&Mesh::load(&mesh)?, pose).at_depth_mm(0.4);

    let mut press = Press::new(indenter, &sensor);
    press.texture = Some(Texture {
        relief: Arc::new(Relief::procedural(Procedural::Knurled)),
        sample: TextureSample { amplitude_mm: 0.05, scale_mm: 0.8, angle_deg: 30.0, offset: [0.0, 0.0] },
        placement: None,
    });
    // Then it is moved by 0.2 mm to the right. The pad sticks to it, or slips.
    press.shear = Some(Shear {
        motion: Motion { shift_mm: [0.2, 0.0], ..Motion::default() },
        friction: Friction::Coulomb { coefficient: 0.6 },
    });
    let impression = simulator.try_press(&press)?;

    std::fs::write("press.png", impression.image.to_png())?;
    let force_n = impression.contact.force_n.unwrap_or(f64::NAN);
    let deepest_mm = impression.surface_mm().into_iter().fold(0.0, f32::max);
    println!("press.png: {force_n:.2} N on the pad in view, which is pressed in by {deepest_mm:.3} mm");
    Ok(())
}
