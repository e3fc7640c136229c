//! The simulator's stages are rooms of one crate, so this test holds their order; that of the crates is the compiler's.

use std::fs;
use std::path::Path;

/// From the first to the last. A stage uses what those before it give.
const STAGES: [&str; 6] = ["base", "mesh", "depth", "gelpad", "optics", "camera"];

/// Each line of code in the folder that names another room of the crate, with that room and its place.
fn uses(folder: &Path, found: &mut Vec<(String, String)>) {
    for entry in fs::read_dir(folder).expect("the folder can be listed") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            uses(&path, found);
            continue;
        }
        let text = fs::read_to_string(&path).expect("UTF-8");
        let text = text.split("#[cfg(test)]\nmod ").next().expect("text before tests");
        for (number, line) in text.lines().enumerate() {
            let code = line.split("//").next().expect("a line");
            let rooms = code.split("crate::").skip(1);
            let named = rooms.map(|rest| rest.split(|c: char| !c.is_alphanumeric()).next().unwrap_or_default());
            found.extend(named.map(|room| (room.to_owned(), format!("{}:{}", path.display(), number + 1))));
        }
    }
}

#[test]
fn no_stage_of_the_simulator_imports_a_later_one() {
    let core = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/core");
    let mut wrong = Vec::new();
    for (own, stage) in STAGES.iter().enumerate() {
        let mut found = Vec::new();
        uses(&core.join(stage), &mut found);
        assert!(!found.is_empty(), "{stage} uses nothing: has the folder moved?");
        let later = found.into_iter().filter(|(room, _)| STAGES[own + 1..].contains(&room.as_str()));
        wrong.extend(later.map(|(room, place)| format!("{place} is in {stage} and uses {room}")));
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
