//! Presets against figures measured on real sensors: on which side of a pressed ball each channel brightens, and by how much.

use gelsim::SensorExt;
use gelsim::{Fidelity, Indenter, Sensor, Simulator};

/// A real sensor: the ball that was pressed in, and for each channel the direction in which it brightens over the visible disc, in
/// degrees from +x towards +y, with the change at the visible disc's rim, grey levels. Fitted linearly over the discs of all presses.
struct Measured {
    preset: &'static str,
    ball_radius_mm: f64,
    contact_radius_mm: f64,
    /// Radius of the visible disc over that of the contact.
    disc_over_contact: f64,
    channels: [(f64, f64); 3],
}

const MEASURED: [Measured; 3] = [
    // 33 presses.
    Measured {
        preset: "gelsight-mini",
        ball_radius_mm: 4.735,
        contact_radius_mm: 1.8,
        disc_over_contact: 1.0 / 0.95,
        channels: [(-99.0, 40.0), (5.0, 42.0), (77.0, 35.0)],
    },
    // 27 presses.
    Measured {
        preset: "digit",
        ball_radius_mm: 3.0,
        contact_radius_mm: 2.4,
        disc_over_contact: 1.0 / 0.72,
        channels: [(-45.0, 76.0), (-162.0, 62.0), (75.0, 80.0)],
    },
    // 31 presses.
    Measured {
        preset: "gelsight-2017",
        ball_radius_mm: 2.0,
        contact_radius_mm: 1.5,
        disc_over_contact: 1.0 / 0.95,
        channels: [(-2.0, 64.0), (-117.0, 45.0), (126.0, 47.0)],
    },
];

/// Where balls are pressed in, as shares of the view: real presses are spread over the pad, which is not equally bright.
const PLACES: [[f64; 2]; 5] = [[0.0, 0.0], [-0.2, -0.2], [0.2, -0.2], [-0.2, 0.2], [0.2, 0.2]];

/// Direction and change at the rim of each channel, on average over [`PLACES`], and the radius of the contact in the middle.
fn mean_of_places(simulator: &Simulator, of: &Measured, depth_mm: f64) -> ([(f64, f64); 3], f64) {
    let presses = PLACES.map(|share| changes_at_rim(simulator, of, depth_mm, share));
    let mean = |channel: usize| {
        let [x, y] = [0, 1].map(|k| presses.iter().map(|(slopes, _)| slopes[channel][k]).sum::<f64>() / 5.0);
        (y.atan2(x).to_degrees(), x.hypot(y))
    };
    ([0, 1, 2].map(mean), presses[0].1)
}

/// How each channel changes along x and y, at the rim of the disc, and the contact's radius.
fn changes_at_rim(simulator: &Simulator, of: &Measured, depth_mm: f64, share: [f64; 2]) -> ([[f64; 2]; 3], f64) {
    let (view, ball_radius_mm) = (*simulator.view(), of.ball_radius_mm);
    let [width, height] = view.resolution_px;
    let [middle_x, middle_y] = [0, 1].map(|k| share[k] * simulator.sensor().field_of_view_mm[k]);
    let place = |at: usize| {
        let [x, y] = view.point_mm([(at % width) as f64 + 0.5, (at / width) as f64 + 0.5]);
        [x - middle_x, y - middle_y]
    };
    let places: Vec<[f64; 2]> = (0..width * height).map(place).collect();
    let ball = |[x, y]: &[f64; 2]| match ball_radius_mm.powi(2) - x * x - y * y {
        left if left > 0.0 => (depth_mm - ball_radius_mm + left.sqrt()) as f32,
        _ => f32::NEG_INFINITY,
    };
    let ball = Indenter::height_map([width, height], places.iter().map(ball).collect()).expect("a ball");
    let pressed = simulator.press(&ball);
    let touching = pressed.contact_mask().iter().filter(|value| **value > 0).count() as f64;
    let contact_mm = (touching * view.mm_per_px[0] * view.mm_per_px[1] / std::f64::consts::PI).sqrt();
    let disc_mm = of.disc_over_contact * contact_mm;
    let (mut sums, mut squares) = ([[0.0; 2]; 3], 0.0);
    for (at, place) in places.iter().enumerate().filter(|(_, place)| place[0].hypot(place[1]) <= disc_mm) {
        squares += 0.5 * (place[0] * place[0] + place[1] * place[1]);
        for (channel, sums) in sums.iter_mut().enumerate() {
            let level = |rgb: &[u8]| f64::from(rgb[3 * at + channel]);
            let change = level(&pressed.image.rgb) - level(&simulator.untouched().rgb);
            sums.iter_mut().zip(place).for_each(|(sum, along)| *sum += change * along);
        }
    }
    (sums.map(|sum| sum.map(|sum| sum / squares * disc_mm)), contact_mm)
}

#[test]
fn each_colour_brightens_on_its_side_of_a_ball_and_as_strongly_as_on_real_sensors() {
    for measured in &MEASURED {
        let Measured { preset, contact_radius_mm, channels, .. } = *measured;
        let sensor = Sensor::preset(preset).expect("a preset");
        let simulator = Simulator::new(&sensor, Fidelity::Standard).expect("a sensor");
        // The depth at which the contact is as large.
        let (mut low, mut high) = (0.02, 3.0);
        for _ in 0..12 {
            let middle = 0.5 * (low + high);
            if changes_at_rim(&simulator, measured, middle, PLACES[0]).1 < contact_radius_mm {
                low = middle
            } else {
                high = middle
            }
        }
        let (found, contact_mm) = mean_of_places(&simulator, measured, low);
        println!("{preset}: depth {low:.2} mm, contact {contact_mm:.2} mm, {found:.0?} for {channels:?}");
        assert!((contact_mm / contact_radius_mm - 1.0).abs() < 0.1, "{preset}: contact of {contact_mm} mm");
        for ((direction, strength), (expected, expected_strength)) in found.into_iter().zip(channels) {
            let turned = (direction - expected + 180.0).rem_euclid(360.0) - 180.0;
            assert!(turned.abs() < 6.0, "{preset}: {found:?} for {channels:?}");
            assert!((0.75..1.35).contains(&(strength / expected_strength)), "{preset}: {found:?} for {channels:?}");
        }
    }
}
