//! `[pose] at = "surface"`: any point of an object touches, evenly by area, where the job places it.

use crate::support::{Folder, JOB, edited, repository};

/// The job with this pose, and these tables in place of its objects.
fn job(objects: &str, pose: &str, samples: u32) -> String {
    let (start, end) = (JOB.find("[[object]]").expect("objects"), JOB.find("[indentation]").expect("a depth"));
    let text = format!("{}{objects}\n[pose]\n{pose}\n\n{}", &JOB[..start], &JOB[end..]);
    edited(
        &text,
        &[("samples = 8", &format!("samples = {samples}")), ("no_contact = 0.25", ""), ("samples_per_shard = 3", "")],
    )
}

fn mesh(name: &str) -> String {
    format!("[[object]]\npath = {:?}\n", repository().join(format!("objects/{name}.obj")))
}

/// Where the object's own axes have the direction into the pad, for each sample.
fn directions(folder: &Folder, out: &str) -> Vec<[f64; 3]> {
    let labels = folder.labels(out);
    let quaternion = |label: &serde_json::Value| {
        let part = |k: usize| label["pose"]["quaternion_xyzw"][k].as_f64().expect("a number");
        [0, 1, 2, 3].map(part)
    };
    // The third row of the rotation matrix, negated.
    let into_pad =
        |[x, y, z, w]: [f64; 4]| [-2.0 * (x * z - y * w), -2.0 * (y * z + x * w), -(1.0 - 2.0 * (x * x + y * y))];
    labels.values().map(|label| into_pad(quaternion(label))).collect()
}

#[test]
fn sides_of_a_cube_and_of_a_ball_touch_as_often_as_their_areas_say() {
    let folder = Folder::with_job(&job(&mesh("cube"), "at = \"surface\"", 240));
    folder.succeed("generate job.toml --quiet --out cube");
    let mut on = [0; 6];
    for direction in directions(&folder, "cube") {
        let axis = (0..3).find(|k| direction[*k].abs() > 0.999).unwrap_or_else(|| panic!("{direction:?} is no side"));
        on[2 * axis + usize::from(direction[axis] > 0.0)] += 1;
    }
    assert!(on.iter().all(|count| (20..=62).contains(count)), "{on:?}: 40 each are expected");

    folder.write("job.toml", job(&mesh("sphere"), "at = \"surface\"\nyaw_deg = [0.0, 360.0]", 240));
    folder.succeed("generate job.toml --quiet --out ball");
    let mut octants = [0; 8];
    for direction in directions(&folder, "ball") {
        octants[(0..3).map(|k| usize::from(direction[k] > 0.0) << k).sum::<usize>()] += 1;
    }
    assert!(octants.iter().all(|count| (12..=52).contains(count)), "{octants:?}: 30 each are expected");
}

#[test]
fn the_point_touches_where_it_is_placed_whatever_the_object() {
    let all: String = ["torus", "cylinder_shell", "gear", "key", "socket_screw", "letter"].map(mesh).concat();
    let folder = Folder::with_job(&job(&all, "at = \"surface\"\nx_mm = 2.0\ny_mm = -1.0\nyaw_deg = [0.0, 360.0]", 90));
    folder.succeed("generate job.toml --quiet --out one");
    // The view is 48 x 36 px; the place is read off the label of a sample.
    let labels = folder.labels("one");
    for (key, files) in folder.samples("one") {
        let mask = image::load_from_memory(&files["contact.png"]).expect("an image").to_luma8();
        let sensor = &labels[&key]["sensor"];
        let mm = |axis: usize| sensor["mm_per_px"][axis].as_f64().expect("a number");
        let at = [(2.0 / mm(0) + 23.5).round() as i64, (-1.0 / mm(1) + 17.5).round() as i64];
        let near = (-1..=1).flat_map(|y| (-1..=1).map(move |x| [at[0] + x, at[1] + y]));
        let touched = near.filter(|[x, y]| mask.get_pixel(*x as u32, *y as u32).0[0] > 0).count();
        assert!(touched > 0, "sample {key}, {}: nothing touches at {at:?}", labels[&key]["object"]["id"]);
    }
    folder.assert_same_on_four_threads();
}

#[test]
fn a_side_or_an_anchor_beside_it_is_refused() {
    for (key, value) in [("face", "\"auto\""), ("anchor", "\"contact\"")] {
        let folder = Folder::with_job(&job(&mesh("cube"), &format!("at = \"surface\"\n{key} = {value}"), 8));
        let said = folder.fail("generate job.toml --out one", 2);
        assert!(said.contains(&format!("`{key}` is for a side that faces the pad")), "{said}");
    }
    let folder = Folder::with_job(&job(&mesh("cube"), "at = \"surfaces\"", 8));
    assert!(folder.fail("generate job.toml --out one", 2).contains("surface"));
}
