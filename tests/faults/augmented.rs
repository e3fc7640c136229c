//! `augment` on sets that mean ill, and killed: names the member, line or folder; the old output or the new one is there.

use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use crate::support::{Folder, JOB, assert_same_files};

const RECIPE: &str = "seed = 7\n[input]\npath = \"real\"\n[[photometric]]\ncopies = 2\nexposure_ev = [-0.5, 0.5]\n";

/// A PNG of one grey.
fn image() -> Vec<u8> {
    gelsim_files::png::encode_rgb(16, 12, &[90; 16 * 12 * 3])
}

/// A set of one table with two images.
fn with_table() -> Folder {
    let folder = Folder::new();
    folder.write("augment.toml", RECIPE);
    fs::create_dir(folder.path("real")).expect("a folder");
    folder.write("real/labels.csv", "file,depth_mm\n0.png,0.5\n1.png,0.6\n");
    for name in ["0.png", "1.png"] {
        folder.write(&format!("real/{name}"), image());
    }
    folder
}

/// Writes a tar of these files; the name stands in its header as it is.
fn write_tar(path: &Path, files: &[(&str, &[u8])]) {
    let mut builder = tar::Builder::new(fs::File::create(path).expect("a file"));
    for (name, bytes) in files {
        let mut header = tar::Header::new_ustar();
        header.as_ustar_mut().expect("ustar").name[..name.len()].copy_from_slice(name.as_bytes());
        header.set_size(bytes.len() as u64);
        header.set_cksum();
        builder.append(&header, *bytes).expect("written");
    }
    builder.finish().expect("written");
}

/// Runs `augment` on what is in `real`, which must be refused quickly: what it says.
fn refused(folder: &Folder) -> String {
    let start = Instant::now();
    let text = folder.fail("augment augment.toml --out larger", 2);
    // A second is what it takes; so much that a busy machine does not matter.
    assert!(start.elapsed() < Duration::from_secs(30), "{text}");
    assert!(text.len() < 20_000 && !text.contains("panicked"), "{}", &text[..text.len().min(2000)]);
    let left: Vec<_> = folder.files("").into_keys().filter(|name| name.contains("larger")).collect();
    assert!(left.is_empty(), "{left:?}");
    text
}

#[test]
fn tables_are_read_up_to_limits_and_lines_are_named() {
    let folder = with_table();
    let many = |count: usize| (0..count).map(|k| format!(",c{k}")).collect::<String>();
    let million = format!("file{}\n0.png{}\n", many(1_000_000), ",".repeat(1_000_000));
    let unclosed = format!("file,note\n0.png,\"{}\n1.png,x\n", "0.png,x\n".repeat(200_000));
    let twice = format!("file{},c7\n", many(1000));
    let long_line = format!("{{\"file\":\"0.png\"}}\n{{\"file\":\"1.png\",\"note\":\"{}\"}}\n", "x".repeat(1 << 20));
    for (name, table, words) in [
        ("labels.csv", million, vec!["labels.csv:1:1", "more than 1 MB"]),
        ("labels.csv", unclosed, vec!["labels.csv:2:7", "a quote is opened and never closed"]),
        ("labels.csv", twice, vec!["labels.csv:1:", "the column `c7` is there twice"]),
        ("labels.jsonl", long_line, vec!["labels.jsonl:2:1", "more than 1 MB"]),
    ] {
        fs::remove_file(folder.path("real/labels.csv")).ok();
        folder.write(&format!("real/{name}"), table);
        let text = refused(&folder);
        assert!(words.iter().all(|word| text.contains(word)), "{text}");
    }
    fs::remove_file(folder.path("real/labels.jsonl")).expect("a file");
    // Many columns alone are no mistake.
    let wide = format!("file{}\n0.png{}\n1.png{}\n", many(40_000), ",1".repeat(40_000), ",2".repeat(40_000));
    folder.write("real/labels.csv", wide);
    folder.succeed("augment augment.toml --out larger --quiet");
    assert_eq!(folder.read("larger/labels.csv").lines().count(), 7);
}

#[test]
fn members_of_tars_are_read_up_to_limits_and_named() {
    let folder = with_table();
    fs::remove_file(folder.path("real/labels.csv")).expect("a file");
    let (image, long) = (image(), format!("{{\"note\":\"{}\"}}", "x".repeat(1 << 20)));
    let tar = folder.path("real/train-000000.tar");
    for (files, words) in [
        (vec![("0.png", &image[..]), ("0.json", long.as_bytes())], vec!["0.json has 1048", "at most 1048576"]),
        (
            vec![("../0.png", &image[..]), ("../0.json", b"{}")],
            vec!["train-000000.tar", "../0.png is not named", "leads"],
        ),
        (vec![("a/../0.png", &image[..])], vec!["train-000000.tar", "a/../0.png leads out"]),
        (vec![("/etc/0.png", &image[..])], vec!["train-000000.tar", "/etc/0.png leads out"]),
        (vec![("\u{202e}0", b"x")], vec!["\\u{202e}0 is not named"]),
    ] {
        write_tar(&tar, &files);
        let text = refused(&folder);
        assert!(words.iter().any(|word| text.contains(word)) && text.contains(words[0]), "{text}");
    }
    // A header that promises more than any image has, of a file with a hole.
    const FAR: u64 = (1 << 28) + 1;
    write_tar(&tar, &[("0.json", b"{}"), ("0.png", b"")]);
    let mut bytes = fs::read(&tar).expect("a tar");
    let mut header = tar::Header::new_ustar();
    header.set_path("0.png").expect("a name");
    header.set_size(FAR);
    header.set_cksum();
    bytes[1024..1536].copy_from_slice(header.as_bytes());
    fs::write(&tar, bytes).expect("a tar");
    fs::File::options().write(true).open(&tar).expect("a tar").set_len(FAR + 4096).expect("a hole");
    let text = refused(&folder);
    assert!(text.contains(&format!("0.png has {FAR} bytes")) && text.contains("at most 268435456"), "{text}");
}

#[test]
fn what_no_run_made_is_never_removed() {
    let folder = with_table();
    for name in [".larger.partial/notes.txt", ".larger.partial/within/notes.txt"] {
        let path = folder.path(name);
        fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
        fs::write(&path, "mine").expect("a file");
        let text = folder.fail("augment augment.toml --out larger", 2);
        assert!(text.contains(".larger.partial") && text.contains("gelsim did not make it"), "{text}");
        assert_eq!(folder.read(name), "mine");
        fs::remove_dir_all(folder.path(".larger.partial")).expect("a folder");
    }
    folder.write(".larger.partial", "mine");
    assert!(folder.fail("augment augment.toml --out larger", 2).contains(".larger.partial"));
    assert_eq!(folder.read(".larger.partial"), "mine");
    fs::remove_file(folder.path(".larger.partial")).expect("a file");
    // An empty one says nothing of whose it is, and costs nobody anything.
    fs::create_dir(folder.path(".larger.partial")).expect("a folder");
    folder.succeed("augment augment.toml --out larger --quiet");
    let left: Vec<_> = folder.files("").into_keys().filter(|name| name.starts_with('.')).collect();
    assert!(left.is_empty() && !folder.path(".larger.partial").exists(), "{left:?}");
    assert!(!folder.files("larger").keys().any(|name| name.starts_with('.')));
}

#[test]
fn killed_at_any_moment_the_old_output_or_the_new_one_is_there() {
    let folder = Folder::with_job(JOB);
    folder.succeed("generate job.toml --quiet --out real");
    for (name, seed) in [("old", 1), ("new", 2)] {
        folder.write(
            &format!("{name}.toml"),
            RECIPE.replace("seed = 7", &format!("seed = {seed}")).replace("= 2\n", "= 40\n"),
        );
        folder.succeed(&format!("augment {name}.toml --out {name} --quiet"));
    }
    let lasting = |name: &str| {
        let mut files = folder.files(name);
        // They say how long it took.
        files.retain(|name, _| {
            !["augment.json", "report.html", "files.sha256", "README.md", ".gelsim-augment"].contains(&name.as_str())
        });
        files
    };
    let (old, new) = (lasting("old"), lasting("new"));
    let start = Instant::now();
    folder.succeed("augment old.toml --out larger --quiet");
    let undisturbed = start.elapsed();
    let stop = AtomicBool::new(false);
    let (mut kills, mut finished) = (0, 0);
    std::thread::scope(|scope| {
        let watcher = scope.spawn(|| {
            let mut looks = 0_u64;
            while !stop.load(Ordering::Relaxed) {
                assert!(folder.path("larger").is_dir(), "no output at an instant");
                looks += 1;
            }
            looks
        });
        for run in 0..24 {
            let mut child = folder.spawn("augment new.toml --out larger --overwrite --quiet");
            std::thread::sleep(undisturbed.mul_f64(f64::from(run) / 16.0));
            // It may have ended by itself.
            let _ = child.kill();
            let status = child.wait().expect("a child");
            if status.success() {
                finished += 1
            } else {
                kills += 1
            }
            let now = lasting("larger");
            assert!(now == old || now == new, "kill {run}");
        }
        stop.store(true, Ordering::Relaxed);
        println!(
            "killed {kills} times, {finished} runs were quicker; looked {} times",
            watcher.join().expect("no gap")
        );
    });
    folder.succeed("augment new.toml --out larger --overwrite --quiet");
    assert_same_files(&lasting("larger"), &new);
    assert!(!folder.path("larger/.gelsim-augment").exists());
    let left: Vec<_> = folder.files("").into_keys().filter(|name| name.starts_with('.')).collect();
    assert!(left.is_empty() && kills > 0, "{left:?}");
}
