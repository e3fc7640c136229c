//! Adds an LED to a sensor and shows the same press with and without it: `cargo run --release --example led`

use std::error::Error;

use gelsim::{Fidelity, ImageExt, Indenter, Led, Mesh, MeshExt, Pose, Sensor, SensorExt, Simulator};

fn main() -> Result<(), Box<dyn Error>> {
    let mut sensor = Sensor::preset("gelsight-2014")?.with_resolution([320, 240]);
    let coin = Indenter::mesh(&Mesh::load("objects/coin.obj")?, Pose::IDENTITY).at_depth_mm(0.3);
    let before = Simulator::new(&sensor, Fidelity::Standard)?.press(&coin).image;

    // A yellow one at the lower right.
    sensor.leds.push(Led {
        name: String::from("yellow"),
        azimuth_deg: 45.0,
        color: [1.0, 0.8, 0.1],
        intensity: 1.5,
        ..Led::default()
    });
    let after = Simulator::new(&sensor, Fidelity::Standard)?.press(&coin).image;

    std::fs::write("led-before.png", before.to_png())?;
    std::fs::write("led-after.png", after.to_png())?;
    let changed = before.rgb.iter().zip(&after.rgb).filter(|(before, after)| before != after).count();
    println!("led-before.png, led-after.png: {changed} of {} values differ", after.rgb.len());
    Ok(())
}
