//! Presses a ball in and pushes it to the right, frame by frame, until it slips: `cargo run --release --example sequence`

use std::error::Error;

use gelsim::{
    Fidelity, Friction, ImageExt, Indenter, Mesh, MeshExt, ObjectStep, PlanarMotion, Pose, Press, Sensor, SensorExt,
    Simulator,
};

/// How far the ball goes in each frame, mm.
const STEP_MM: f64 = 0.05;

fn main() -> Result<(), Box<dyn Error>> {
    let sensor = Sensor::preset("gelsight-2014")?.with_resolution([320, 240]);
    let simulator = Simulator::new(&sensor, Fidelity::Draft)?;
    let ball = Indenter::mesh(&Mesh::load("objects/sphere.obj")?, Pose::IDENTITY);

    // What friction remembers from frame to frame.
    let mut sliding =
        simulator.sliding(Friction::Coulomb { coefficient: 0.3 }).ok_or("the pad of this level has no friction")?;
    for frame in 0..16 {
        // Four frames down, then to the right.
        let depth_mm = 0.2 * f64::from(frame.min(3) + 1);
        let right_mm = STEP_MM * f64::from((frame - 3).max(0));
        let pose = Pose::from_quaternion([0.0, 0.0, 0.0, 1.0], [right_mm, 0.0, 0.0]);
        let indenter = ball.moved_to(pose).at_depth_mm(depth_mm);
        // How its surface moved since the last frame: as the ball itself, which does not roll.
        let shift_mm = [if frame > 3 { STEP_MM } else { 0.0 }, 0.0];
        let motion = PlanarMotion { shift_mm, ..PlanarMotion::default() };

        let step = ObjectStep::to(&indenter, motion);
        let impression = simulator.try_press_next(&Press::new(indenter, &sensor), &[step], &mut sliding)?;
        let state = impression.sliding.as_ref().ok_or("a frame of a sequence has a sliding state")?;
        let [x, _, z] = state.wrench.force_n;
        println!(
            "frame {frame:2}: {:5.2} N down, {:5.2} N to the right, {:3.0} % of the contact sticks",
            -z,
            x,
            100.0 * state.slip.stick_fraction
        );
        if frame == 15 {
            std::fs::write("sequence.png", impression.image.to_png())?;
        }
    }
    Ok(())
}
