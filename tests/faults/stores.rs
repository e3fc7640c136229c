//! Datasets in an object store that fails: at each of its answers in turn, from then on for ever, as a store that is away or
//! a run that is killed between two requests. The same run makes the bytes of a run on disk.
//!
//! The store here is in memory; tests/python/test_stores.py talks to a real one.

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicI64, AtomicU64, Ordering};

use gelsim_dataset::finalize::Finalized;
use gelsim_dataset::generate::{GenerateError, GenerateRequest, RunMonitor, RunSummary, generate, generate_in_store};
use gelsim_dataset::mirror::finalize_in_store;
use gelsim_dataset::verify::CheckLevel;
use gelsim_files::hash::sha256;
use gelsim_files::store::{Store, StoreEntry, StoreError, StoreFailure};
use gelsim_job::config::Overrides;
use gelsim_job::plan::Plan;

use crate::support::{Folder, JOB, edited};

type Objects = BTreeMap<String, Vec<u8>>;

/// A store in memory.
#[derive(Default)]
struct Memory {
    objects: Mutex<Objects>,
    /// Answers that are left until it fails; none if it never does.
    left: Option<AtomicI64>,
    /// Bytes that shards took on disk whenever one was put.
    on_disk: AtomicU64,
    /// Shows nothing, as a listing that was taken before others began.
    stale: bool,
}

impl Memory {
    fn with(objects: &Objects) -> Self {
        Self { objects: Mutex::new(objects.clone()), ..Self::default() }
    }

    fn failing_after(self, answers: i64) -> Self {
        Self { left: Some(AtomicI64::new(answers)), ..self }
    }

    /// What is in it, times in stats left out.
    fn without_times(&self) -> BTreeMap<String, String> {
        self.objects
            .lock()
            .expect("no panic")
            .iter()
            .map(|(name, bytes)| (name.clone(), without_times(name, bytes)))
            .collect()
    }

    fn objects(&self) -> io::Result<std::sync::MutexGuard<'_, Objects>> {
        match &self.left {
            Some(left) if left.fetch_sub(1, Ordering::Relaxed) <= 0 => {
                let said = String::from("connection refused");
                Err(io::Error::other(StoreError { cause: StoreFailure::Unreachable, message: said, scheme: "s3" }))
            }
            _ => Ok(self.objects.lock().expect("no panic")),
        }
    }
}

impl Store for Memory {
    fn full_address(&self, name: &str) -> String {
        format!("s3://bucket/presses/{name}").trim_end_matches('/').to_owned()
    }

    fn list_top(&self) -> io::Result<(Vec<StoreEntry>, Vec<String>)> {
        let objects = self.objects()?;
        let mut folders: Vec<String> =
            objects.keys().filter_map(|name| Some(name.split_once('/')?.0.to_owned())).collect();
        folders.dedup();
        let files = objects.iter().filter(|(name, _)| !name.contains('/'));
        let files = files.map(|(name, bytes)| (name.clone(), bytes.len() as u64)).collect();
        Ok(if self.stale { Default::default() } else { (files, folders) })
    }

    fn list(&self, folder: &str) -> io::Result<Vec<StoreEntry>> {
        let objects = self.objects()?;
        let inside =
            objects.iter().filter(|(name, _)| name.strip_prefix(folder).is_some_and(|rest| rest.starts_with('/')));
        Ok(inside.map(|(name, bytes)| (name.clone(), bytes.len() as u64)).collect())
    }

    fn get(&self, name: &str, most: u64) -> io::Result<Option<Vec<u8>>> {
        let found = self.objects()?.get(name).cloned();
        assert!(found.as_ref().is_none_or(|bytes| bytes.len() as u64 <= most));
        Ok(found)
    }

    fn digest(&self, name: &str) -> io::Result<Option<(u64, String)>> {
        Ok(self.objects()?.get(name).map(|bytes| (bytes.len() as u64, sha256(bytes))))
    }

    fn put(&self, name: &str, bytes: Vec<u8>) -> io::Result<()> {
        self.objects()?.insert(name.to_owned(), bytes);
        Ok(())
    }

    fn put_new(&self, name: &str, bytes: Vec<u8>) -> io::Result<bool> {
        let mut objects = self.objects()?;
        let new = !objects.contains_key(name);
        if new {
            objects.insert(name.to_owned(), bytes);
        }
        Ok(new)
    }

    fn put_file(&self, name: &str, file: &Path) -> io::Result<()> {
        let folder = fs::read_dir(file.parent().expect("in data"))?;
        let taken = folder.map(|entry| Ok(entry?.metadata()?.blocks() * 512)).sum::<io::Result<u64>>()?;
        self.on_disk.fetch_max(taken, Ordering::Relaxed);
        self.put(name, fs::read(file)?)
    }

    fn remove(&self, name: &str) -> io::Result<()> {
        self.objects()?.remove(name);
        Ok(())
    }
}

/// A file's content; of stats what is left without times, of the job what is left without paths and the seal over them.
fn without_times(name: &str, bytes: &[u8]) -> String {
    if name.starts_with("stats/") {
        let mut stats: serde_json::Value = serde_json::from_slice(bytes).expect("stats are complete");
        let stats = stats.as_object_mut().expect("an object");
        stats.retain(|key, _| !["seconds", "seal_sha256", "effects"].contains(&key.as_str()));
        return serde_json::to_string(&stats).expect("text");
    }
    if name == "job.toml" {
        let text = String::from_utf8(bytes.to_vec()).expect("UTF-8");
        return text.lines().filter(|line| !line.starts_with("path =") && !line.starts_with("# SHA")).collect();
    }
    sha256(bytes)
}

fn plan(folder: &Folder, text: &str) -> Plan {
    folder.write("job.toml", text);
    Plan::load(&folder.path("job.toml"), &Overrides::default()).expect("a sound job")
}

/// A run on one thread, so that it asks the store for the same things in the same order.
fn run(store: &Memory, folder: &Folder, plan: &Plan, overwrite: bool) -> Result<RunSummary, GenerateError> {
    let request = GenerateRequest { root: folder.path("staging"), shards: None, threads: Some(1), overwrite };
    let done = generate_in_store(store, plan, &request, &RunMonitor::default());
    let left = fs::read_dir(folder.path("staging")).map_or(0, Iterator::count);
    assert_eq!(left, 0, "nothing of a run stays on this machine");
    done
}

/// What a run on disk makes.
fn on_disk(folder: &Folder, plan: &Plan) -> Objects {
    let request = GenerateRequest { root: folder.path("complete"), shards: None, threads: Some(1), overwrite: true };
    generate(plan, &request, &RunMonitor::default()).expect("a run on disk");
    folder.files("complete")
}

fn in_words(error: GenerateError) -> String {
    match error {
        GenerateError::Usage(report) => report.to_string(),
        GenerateError::Io(path, error) => format!("{}: {error}", path.display()),
        other => format!("{other:?}"),
    }
}

/// What is described is complete, and what has stats is what they say.
fn assert_consistent(store: &Memory) {
    let objects = store.objects.lock().expect("no panic");
    for (name, bytes) in objects.iter().filter(|(name, _)| name.starts_with("stats/")) {
        let stats: serde_json::Value = serde_json::from_slice(bytes).expect("stats are complete");
        let data = objects.get(stats["file"].as_str().expect("a name"));
        assert!(data.is_some_and(|data| stats["sha256"] == sha256(data)), "{name} vouches for what is not there");
    }
    if let Some(described) = objects.get("dataset.json") {
        let described: serde_json::Value = serde_json::from_slice(described).expect("dataset.json is complete");
        for shard in described["shards"].as_array().expect("shards") {
            let data = &objects[shard["file"].as_str().expect("a name")];
            assert_eq!(shard["sha256"], sha256(data), "dataset.json describes what is not there");
        }
    }
}

/// Ends a run after each number of answers, and lets the same run go on.
fn at_every_answer(before: &Objects, text: &str, overwrite: bool, consistent: bool) {
    let folder = Folder::new();
    let plan = plan(&folder, text);
    let complete = Memory::with(&on_disk(&folder, &plan)).without_times();
    let mut answers = 0;
    loop {
        let store = Memory::with(before).failing_after(answers);
        let done = run(&store, &folder, &plan, overwrite);
        if consistent {
            assert_consistent(&store);
        }
        let finished = done.is_ok();
        if let Err(error) = done {
            let said = in_words(error);
            assert!(said.starts_with("s3://bucket/presses") && said.contains("connection refused"), "{said}");
            let store = Memory { left: None, ..store };
            assert!(run(&store, &folder, &plan, overwrite).expect("it goes on").complete);
            assert_eq!(store.without_times(), complete, "after {answers} answers");
        } else {
            assert_eq!(store.without_times(), complete);
        }
        if finished {
            break;
        }
        answers += 1;
    }
    println!("ended after 0 to {} answers: each time the same run made the bytes of a run on disk", answers - 1);
    assert!(answers > 12, "{answers}");
}

#[test]
fn a_run_that_ends_at_any_answer_goes_on() {
    at_every_answer(&Objects::new(), JOB, false, true);
}

#[test]
fn a_dataset_that_grows_goes_on_at_any_answer() {
    let folder = Folder::new();
    let smaller = on_disk(&folder, &plan(&folder, &edited(JOB, &[("samples = 8", "samples = 4")])));
    at_every_answer(&smaller, JOB, false, true);
}

#[test]
fn a_dataset_of_another_job_is_replaced_at_any_answer() {
    let folder = Folder::new();
    let another = on_disk(&folder, &plan(&folder, &edited(JOB, &[("seed = 7", "seed = 8")])));
    at_every_answer(&another, JOB, true, false);
}

#[test]
fn a_damaged_dataset_is_mended_at_any_answer() {
    let folder = Folder::new();
    let mut damaged = on_disk(&folder, &plan(&folder, JOB));
    damaged.get_mut("data/train-000000.tar").expect("a shard").pop();
    damaged.remove("stats/train-000001.json").expect("stats");
    damaged.remove("data/val-000000.tar").expect("a shard");
    damaged.get_mut("stats/test-000000.json").expect("stats").pop();
    at_every_answer(&damaged, JOB, false, false);
}

#[test]
fn the_disk_holds_no_more_shards_than_there_are_threads() {
    let folder = Folder::new();
    let plan = plan(&folder, &edited(JOB, &[("samples = 8", "samples = 60"), ("[48, 36]", "[96, 72]")]));
    let store = Memory::default();
    run(&store, &folder, &plan, false).expect("a run");
    let objects = store.objects.lock().expect("no panic");
    let shards: Vec<u64> =
        objects.iter().filter(|(name, _)| name.starts_with("data/")).map(|(_, bytes)| bytes.len() as u64).collect();
    let (largest, taken) = (shards.iter().max().expect("shards"), store.on_disk.load(Ordering::Relaxed));
    // Locks, and the rounding to blocks, take a little.
    assert!(
        shards.len() > 15 && taken < largest + (64 << 10),
        "{taken} bytes on disk, the largest shard has {largest}"
    );
}

#[test]
fn parts_by_several_runs_are_the_dataset_of_one() {
    let folder = Folder::new();
    let plan = plan(&folder, JOB);
    let complete = Memory::with(&on_disk(&folder, &plan)).without_times();
    let store = Memory::default();
    let count = plan.layout.shard_count();
    for number in (0..count).rev() {
        let root = folder.path(&format!("staging{number}"));
        let request = GenerateRequest { root, shards: Some(number..number + 1), threads: Some(1), overwrite: false };
        let done = generate_in_store(&store, &plan, &request, &RunMonitor::default()).expect("a part");
        assert_eq!((done.shards, done.complete), (1, number == 0));
    }
    assert_eq!(store.without_times(), complete);
    // A part that begins when others have, of which its listing knew nothing.
    let late = Memory { stale: true, ..Memory::with(&store.objects.lock().expect("no panic")) };
    assert!(run(&late, &folder, &plan, false).expect("the same job").complete);
    assert_eq!(late.without_times(), complete);
}

#[test]
fn what_is_not_the_runs_is_named_by_its_address_and_stays() {
    let folder = Folder::new();
    let plan = plan(&folder, JOB);
    let another = on_disk(&folder, &self::plan(&folder, &edited(JOB, &[("seed = 7", "seed = 8")])));
    let refused = |store: &Memory| {
        let before = store.objects.lock().expect("no panic").clone();
        let said = in_words(run(store, &folder, &plan, false).expect_err("it is not ours"));
        assert!(*store.objects.lock().expect("no panic") == before, "nothing is changed");
        assert!(said.contains("s3://bucket/presses") && !said.contains("staging"), "{said}");
        said
    };
    let said = refused(&Memory::with(&another));
    assert!(said.contains("another job: dataset.seed is 8 there and 7 here"), "{said}");
    let late = Memory { stale: true, ..Memory::with(&another) };
    let said = refused(&late);
    assert!(said.contains("was taken over by a run of another job"), "{said}");

    let theirs =
        ["notes.txt", "data/notes.txt", "elsewhere/deep/notes.txt"].map(|name| (name.to_owned(), b"mine".to_vec()));
    let said = refused(&Memory::with(&theirs.clone().into()));
    assert!(said.contains("is not empty and holds no dataset of gelsim"), "{said}");
    // What would be taken for data is named; all of it outlives a dataset that is replaced.
    let store = Memory::with(&another.into_iter().chain(theirs.clone()).collect());
    let said = in_words(run(&store, &folder, &plan, true).expect_err("a stray"));
    assert!(said.contains("data/notes.txt") && said.contains("belongs to no shard"), "{said}");
    let objects = store.objects.lock().expect("no panic");
    assert!(theirs.iter().all(|(name, bytes)| objects.get(name) == Some(bytes)));
}

#[test]
fn a_dataset_in_a_store_is_described_if_it_is_complete() {
    let folder = Folder::new();
    let plan = plan(&folder, JOB);
    let complete = on_disk(&folder, &plan);
    let finalized =
        |store: &Memory, level| finalize_in_store(store, &folder.path("staging"), level).expect("it can be read").0;
    let mut bare = complete.clone();
    for name in ["dataset.json", "wids.json", "README.md"] {
        bare.remove(name).expect("a description");
    }
    let store = Memory::with(&bare);
    assert!(matches!(finalized(&store, CheckLevel::Checksums), Finalized::Valid { .. }));
    assert_eq!(store.without_times(), Memory::with(&complete).without_times());

    let mut changed = bare.clone();
    *changed.get_mut("data/train-000001.tar").expect("a shard").last_mut().expect("bytes") ^= 1;
    let mut missing = bare;
    missing.remove("data/val-000000.tar").expect("a shard");
    for (broken, level, named) in [
        (&changed, CheckLevel::Checksums, "data/train-000001.tar: is not what was written"),
        (&missing, CheckLevel::Sizes, "data/val-000000.tar: is missing"),
    ] {
        let store = Memory::with(broken);
        match finalized(&store, level) {
            Finalized::Invalid(findings) => assert!(findings[0].to_string().starts_with(named), "{findings:?}"),
            Finalized::Valid { .. } => panic!("{named}"),
        }
        assert!(*store.objects.lock().expect("no panic") == *broken, "nothing is changed");
    }
    let nothing = finalize_in_store(&Memory::default(), &folder.path("staging"), CheckLevel::Sizes);
    let said = in_words(nothing.expect_err("no dataset").into());
    assert!(said.contains("s3://bucket/presses is no dataset"), "{said}");
}

#[test]
fn shards_that_are_folders_are_refused_for_a_store() {
    let folder = Folder::new();
    let plan = plan(&folder, &edited(JOB, &[("[output]", "[output]\ncontainer = \"folder\"")]));
    let store = Memory::default().failing_after(0);
    let said = in_words(run(&store, &folder, &plan, false).expect_err("refused"));
    assert!(said.contains("cannot be put into a store as one object"), "{said}");
}
