//! The layer `gap` as anyone can audit it from the files: no pressure pulls, no object is within the pad, and where there
//! is pressure there is no gap.

use gelsim_core::impression::OUT_OF_REACH_MM;
use serde_json::Value;

use crate::support::{Folder, JOB, edited, exr_planes};

/// Values of a layer of one channel.
fn plane(bytes: &[u8], channel: &str) -> Vec<f32> {
    let mut planes = exr_planes(bytes);
    assert_eq!((planes.len(), planes[0].0.as_str()), (1, channel));
    planes.remove(0).1
}

#[test]
fn files_keep_the_conditions_of_contact_at_every_level() {
    let job =
        edited(JOB, &[("[\"depth\", \"contact\"]", "[\"surface\", \"pressure\", \"gap\", \"contact\", \"depth\"]")]);
    let folder = Folder::with_job(&job);
    for level in ["draft", "standard", "high", "reference"] {
        for pixel in ["half", "float"] {
            let out = format!("{level}-{pixel}");
            folder.succeed(&format!(
                "generate job.toml --quiet --set output.exr.pixel=\"{pixel}\" --out {out} --fidelity {level}"
            ));
            let (mut pressed, mut above, mut beyond) = (0, 0, 0);
            // Between the pixels of a coarse grid the surface goes over to the object's: a tenth of such a pixel.
            let mm_per_px = 20.0 / 48.0;
            let close_mm = match level {
                "draft" => 0.4 * mm_per_px,
                "standard" => 0.2 * mm_per_px,
                _ => 0.0,
            };
            for members in folder.samples(&out).values() {
                let label: Value = serde_json::from_slice(&members["json"]).expect("a label");
                let [surface, gap, depth] =
                    ["surface", "gap", "depth"].map(|name| plane(&members[&format!("{name}.exr")], "Z"));
                let kpa = plane(&members["pressure.exr"], "P");
                let mask = image::load_from_memory(&members["contact.png"]).expect("a PNG").into_luma8();
                let in_contact = label["contact"]["in_contact"] == true;
                for (at, mask) in mask.pixels().enumerate() {
                    let (gap, kpa) = (gap[at], kpa[at]);
                    assert!(kpa >= 0.0 && (gap >= 0.0 || gap == OUT_OF_REACH_MM), "{kpa} kPa, {gap} mm");
                    let touches = kpa > 0.0 || mask.0 != [0];
                    assert!(
                        !touches || (0.0..=1.001 * close_mm).contains(&f64::from(gap)),
                        "{level}: {kpa} kPa, {gap} mm"
                    );
                    if depth[at] > 0.0 {
                        // Below the undeformed pad the object is known; half floats keep 11 bits.
                        let rounding = if pixel == "half" { 2e-3 } else { 1e-6 };
                        assert!((surface[at] - depth[at] - gap).abs() < rounding, "{} {gap}", surface[at] - depth[at]);
                    }
                    pressed += u32::from(kpa > 0.0);
                    above += u32::from(gap > 0.0 && depth[at] == 0.0);
                    beyond += u32::from(gap == OUT_OF_REACH_MM);
                    assert!(in_contact || gap == OUT_OF_REACH_MM);
                }
            }
            println!(
                "{level}, {pixel}: {pressed} px with pressure, {above} with the object over the pad, {beyond} without"
            );
            assert!(pressed > 100 && above > 30 && beyond > 100, "{level}: {pressed}, {above}, {beyond}");
        }
    }
}

#[test]
fn a_model_without_pressure_knows_the_gap_where_the_object_reaches_into_the_pad() {
    let folder = Folder::with_job(&edited(JOB, &[("[\"depth\", \"contact\"]", "[\"gap\", \"depth\"]")]));
    for model in ["none", "mean_blur", "gaussian"] {
        folder.succeed(&format!("generate job.toml --quiet --out {model} --set gelpad=\"{model}\""));
        let mut known = 0;
        for members in folder.samples(model).values() {
            let [gap, depth] = ["gap", "depth"].map(|name| plane(&members[&format!("{name}.exr")], "Z"));
            for (gap, depth) in gap.iter().zip(&depth) {
                assert_eq!(*gap == OUT_OF_REACH_MM, *depth == 0.0, "{model}: {gap} mm where the depth is {depth} mm");
                assert!(*gap >= 0.0 || *gap == OUT_OF_REACH_MM);
                known += u32::from(*gap >= 0.0);
            }
        }
        assert!(known > 100, "{model}: {known} px");
    }
}
