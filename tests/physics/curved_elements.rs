//! Presses on domes against neo-Hookean finite elements of a layer as thick everywhere (`data/finite_elements_domes.json`, written by
//! `tests/oracle/finite_elements.py --domes`).

use gelsim::{Fidelity, Simulator};
use gelsim_core::base::view::SURFACE_BORDER;
use serde_json::Value;

use super::curved::{dome, length, press_ball};

/// Width of the ring beside the contact in which surfaces are compared, mm.
const RING_MM: f64 = 2.0;

#[test]
fn balls_on_domes_press_as_finite_elements_say() {
    let rows: Vec<Value> =
        serde_json::from_str(include_str!("data/finite_elements_domes.json")).expect("a table of presses");
    assert!(rows.len() >= 12, "{} presses", rows.len());
    for row in &rows {
        let of = |key: &str| row[key].as_f64().unwrap_or_else(|| panic!("{key} of {row}"));
        let list = |key: &str| row[key].as_array().expect("a list").iter().map(|mm| mm.as_f64().expect("a number"));
        let (ball_mm, dome_mm, depth_mm) = (of("radius_mm"), of("dome_mm"), of("depth_mm"));
        let sensor = dome(dome_mm, 12.0, 240, 3.0);
        let simulator = Simulator::new(&sensor, Fidelity::High).expect("a sound sensor");
        let pressed = press_ball(&simulator, dome_mm, ball_mm, depth_mm, 0.0, 0.0);
        let newton_over_modulus = 1e-3 * sensor.gelpad.youngs_modulus_kpa;
        let force = length(pressed.wrench.expect("an elastic pad").force_n);
        let force_off = force / (of("force_over_modulus_mm2") * newton_over_modulus) - 1.0;

        let (view, surface) = (sensor.view(), &pressed.contact.surface);
        let middle = surface.height / 2;
        let along = |at: usize| view.point_mm([at as f64 + 0.5 - SURFACE_BORDER as f64, 0.0])[0];
        let (mut worst_um, mut squares, mut count) = (0.0_f64, 0.0, 0.0);
        for (r, finite_mm) in list("r_mm").zip(list("w_mm")) {
            if r < of("contact_mm") + 0.1 || r > of("contact_mm") + RING_MM {
                continue;
            }
            let right = (0..surface.width).find(|at| along(*at) > r).expect("in view");
            let share = (r - along(right - 1)) / (along(right) - along(right - 1));
            let value = |x: usize| f64::from(surface.at(x, middle));
            let off_um = 1e3 * ((1.0 - share) * value(right - 1) + share * value(right) - finite_mm);
            worst_um = worst_um.max(off_um.abs());
            (squares, count) = (squares + off_um * off_um, count + 1.0);
        }
        assert!(count > 10.0, "{count} points beside the contact");
        let stated_um = pressed.contact.numerics.model_error_um.expect("an elastic pad");
        let ratio = stated_um / worst_um;
        println!(
            "ball of {ball_mm} on a dome of {dome_mm} mm, {depth_mm} mm deep: force {:+.1} %, ring off by {worst_um:.1} um, \
             {:.1} RMS, stated {stated_um:.1}",
            100.0 * force_off,
            f64::sqrt(squares / count),
        );
        assert!(force_off.abs() < 0.035, "{row}: force off by {force_off}");
        assert!((1.0 / 2.3..2.3).contains(&ratio), "{row}: stated {stated_um} um, found {worst_um}");
    }
}
