//! What killed runs leave of a file goes with the next run that writes it; what others write there stays.

use std::fs;

use super::rig::Held;
use crate::support::{Folder, JOB, edited, repository};

fn partials(folder: &Folder) -> Vec<String> {
    folder.files("").into_keys().filter(|name| name.ends_with(".partial")).collect()
}

#[test]
fn commands_that_write_files_sweep_up_after_killed_ones() {
    let folder = Folder::with_job(JOB);
    folder.succeed("generate job.toml --quiet --out out");
    folder.succeed("generate job.toml --quiet --seed 8 --out other");
    let sensor = fs::read_to_string(repository().join("configs/sensors/gelsight-2014.toml")).expect("a preset");
    folder.write("sensor.toml", edited(&sensor, &[("resolution_px = [640, 480]", "resolution_px = [16, 12]")]));
    fs::create_dir(folder.path("frames")).expect("a folder");
    let header = "{'descr': '<f4', 'fortran_order': False, 'shape': (12, 16), }";
    let header = format!("{header:<117}\n");
    let depth: Vec<u8> = (0..192).flat_map(|k: u16| (9.7_f32 + 0.002 * f32::from(k)).to_le_bytes()).collect();
    let npy = [b"\x93NUMPY\x01\x00".as_slice(), &118_u16.to_le_bytes(), header.as_bytes(), &depth].concat();
    for name in ["a.npy", "b.npy"] {
        folder.write(&format!("frames/{name}"), &npy);
    }
    let mut kills = 0;
    for arguments in [
        "report out --out page.html",
        "preview out --out sheet.png",
        "tradeoff job.toml --samples 1 --out table",
        "compare out other --out held",
        "render --depth frames --depth-unit mm --plane-mm 10 --sensor sensor.toml --out images",
    ] {
        let run = Held::at(&folder, arguments, "file written");
        let Ok(run) = run else {
            let output = run.err().expect("an end");
            panic!("{arguments}: {}", String::from_utf8_lossy(&output.stderr));
        };
        run.kill();
        kills += 1;
        let left = partials(&folder);
        assert!(!left.is_empty(), "{arguments}");
        // One that is being written by a process that lives.
        let alive =
            left[0].rsplit_once('.').and_then(|(front, _)| front.rsplit_once('.')).expect("a number").0.to_owned();
        let alive = format!("{alive}.{}.partial", std::process::id());
        folder.write(&alive, "theirs");
        folder.gelsim(arguments).assert().success();
        assert_eq!(partials(&folder), std::slice::from_ref(&alive), "{arguments}");
        fs::remove_file(folder.path(&alive)).expect("a file");
    }
    println!("killed {kills} commands with a file half written");
}
