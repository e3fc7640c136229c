//! What no input may do, on a stable compiler: the committed inputs of every fuzz target are read again, then damaged in
//! ways that parsers stumble over; and the command itself is given files that lie about their size.
//!
//! `entry.rs` is shared with the targets of `cargo fuzz` in `fuzz_targets/`. `corpus/TARGET` holds minimised inputs that
//! reach every part of a reader, `regressions/TARGET` those that once broke one.

use std::fs;
use std::path::Path;

use proptest::prelude::*;
use proptest::test_runner::{Config, TestRunner};

mod damage;
mod entry;
mod limits;

pub use damage::damaged;
pub use entry::answers;

macro_rules! targets {
    ($($target:ident: $cases:literal),*) => { $(
        mod $target {
            #[test]
            fn committed_inputs_are_read_or_refused() {
                let inputs = super::inputs(stringify!($target));
                inputs.iter().for_each(|(name, bytes)| super::feed(super::entry::$target, name, bytes));
            }

            #[test]
            fn damaged_inputs_are_read_or_refused() {
                super::feed_damaged(super::entry::$target, stringify!($target), $cases);
            }
        }
    )* };
}

// So many damaged inputs of each take a second or two; a tenth of them where not all is to be tried.
targets!(
    job: 15_000,
    obj: 20_000,
    stl: 200_000,
    ply: 200_000,
    off: 20_000,
    gltf: 60_000,
    dae: 40_000,
    threemf: 60_000,
    urdf: 5_000,
    npy: 200_000,
    exr: 60_000,
    png: 200_000,
    picture: 60_000,
    places: 60_000,
    sensor: 10_000,
    shard: 80_000,
    manifest: 80_000,
    presses: 60_000,
    calibration: 80_000,
    frame: 60_000,
    stream: 5_000,
    poses: 15_000,
    log: 20_000
);

/// The committed inputs of a target, with their names.
fn inputs(target: &str) -> Vec<(String, Vec<u8>)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fuzz");
    let mut found = Vec::new();
    for kind in ["corpus", "regressions"] {
        for entry in fs::read_dir(folder.join(kind).join(target)).into_iter().flatten() {
            let path = entry.expect("a folder's entry").path();
            found.push((path.display().to_string(), fs::read(&path).expect("a committed input")));
        }
    }
    assert!(!found.is_empty(), "{target} has no corpus");
    found.sort();
    found
}

/// A panic in `read` says which input it was.
fn feed(read: fn(&[u8]), name: &str, bytes: &[u8]) {
    let result = std::panic::catch_unwind(|| read(bytes));
    assert!(result.is_ok(), "{name}");
}

/// Feeds damaged inputs, the same in every run.
fn feed_damaged(read: fn(&[u8]), target: &str, cases: u32) {
    let inputs: Vec<Vec<u8>> = inputs(target).into_iter().map(|(_, bytes)| bytes).collect();
    let cases = if crate::thorough() { cases } else { cases / 10 };
    let config = Config { cases, failure_persistence: None, ..Config::default() };
    let mut runner = TestRunner::new_with_rng(
        config,
        proptest::test_runner::TestRng::deterministic_rng(proptest::test_runner::RngAlgorithm::ChaCha),
    );
    let bytes = prop_oneof![
        9 => damage::damaged(inputs),
        1 => prop::collection::vec(any::<u8>(), 0..600),
    ];
    let outcome = runner.run(&bytes, |bytes| {
        read(&bytes);
        Ok(())
    });
    assert!(outcome.is_ok(), "{target}: {}", outcome.expect_err("a failure"));
}
