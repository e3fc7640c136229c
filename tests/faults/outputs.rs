//! Output folders that cannot be: named, with status 1 or 2, and nothing written.

use std::fs;
use std::os::unix::fs::{PermissionsExt, symlink};

use super::rig::{assert_like_undisturbed, messages_of, shell, with_undisturbed};
use crate::support::{Folder, JOB, edited};

fn names(folder: &Folder) -> Vec<std::ffi::OsString> {
    let mut names: Vec<_> = fs::read_dir(folder.path("")).expect("a folder").map(|e| e.unwrap().file_name()).collect();
    names.sort();
    names
}

#[test]
fn an_output_that_cannot_be_a_folder_is_refused() {
    let folder = Folder::with_job(JOB);
    symlink(folder.path("nowhere"), folder.path("dangling")).expect("a link");
    symlink("circle", folder.path("circle")).expect("a link");
    let before = names(&folder);
    let (long, deep) = ("x".repeat(256), "deep/".repeat(1000));
    for (out, status, words) in [
        ("job.toml", 2, "job.toml is not a folder"),
        ("dangling", 2, "dangling is not a folder"),
        ("circle", 2, "circle is not a folder"),
        ("/", 2, "/ is not empty and holds no dataset of gelsim"),
        (".", 2, ". is not empty and holds no dataset of gelsim"),
        ("job.toml/out", 2, "job.toml is not a folder"),
        ("/dev/null/out", 2, "/dev/null is not a folder"),
        (&long, 1, "File name too long"),
        (&deep, 1, "File name too long"),
    ] {
        let text = folder.fail(&format!("generate job.toml --out {out}"), status);
        assert!(text.contains(words) && !text.contains("panicked"), "{out}: {text}");
    }
    folder.fail("generate job.toml --out=", 2);
    assert_eq!(names(&folder), before, "nothing was written");
}

#[test]
fn a_folder_without_permission_is_named() {
    let folder = with_undisturbed(JOB);
    folder.succeed("generate job.toml --quiet --out begun --shards 0..1");
    for name in ["closed", "begun/data", "begun/stats", "begun"] {
        fs::create_dir_all(folder.path(name)).expect("a folder");
        let allow = |mode| fs::set_permissions(folder.path(name), fs::Permissions::from_mode(mode)).expect("a mode");
        allow(0o555);
        let root = name.split('/').next().unwrap_or_default();
        // Modes do not bind those who may override them.
        let script = format!(
            "run=; [ $(id -u) = 0 ] && run='setpriv --bounding-set=-all --inh-caps=-all'
            $run touch {name}/probe 2> /dev/null && exit 98
            exec $run \"$G\" generate job.toml --quiet --out {root}"
        );
        let output = shell(&folder, &script, &[]);
        allow(0o755);
        let text = messages_of(&output);
        if output.status.code() == Some(98) || text.contains("setpriv") {
            println!("left out: modes of folders do not bind this user");
            return;
        }
        assert_eq!(output.status.code(), Some(1), "{name}: {text}");
        assert!(text.contains("Permission denied") && text.contains("make the folder writable"), "{name}: {text}");
        assert!(text.contains(&format!("{name}/")), "{name}: {text}");
    }
    folder.succeed("generate job.toml --quiet --out begun");
    assert_like_undisturbed(&folder, "begun");
}

#[test]
fn an_output_inside_the_folder_of_the_meshes_is_no_mesh() {
    let folder = with_undisturbed(JOB);
    fs::create_dir(folder.path("meshes")).expect("a folder");
    for name in ["cube.obj", "cone.obj"] {
        fs::copy(folder.path(name), folder.path("meshes").join(name)).expect("a mesh");
    }
    folder.write("all.toml", edited(JOB, &[("\"cube.obj\"", "\"meshes/*.obj\"")]));
    for _ in 0..2 {
        folder.succeed("generate all.toml --quiet --out meshes/out.obj");
    }
    folder.succeed("generate all.toml --quiet --out beside");
    assert_eq!(folder.files("beside/data"), folder.files("meshes/out.obj/data"));
}
