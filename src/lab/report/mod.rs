//! Reports on datasets: one HTML page from labels and stats, for any number of samples.
//!
//! Only labels are read, and the images of at most [`MAX_IMAGES`] samples, several shards in parallel. Missing and
//! damaged files are named, and the page is made from the rest.

use gelsim_dataset::container::ShardContainer;
use std::collections::{BTreeMap, BTreeSet};
use std::ops::ControlFlow;
use std::path::Path;

use rayon::prelude::*;

pub mod gather;
pub mod heatmap;
pub mod histogram;
mod html;
pub mod quantities;
pub mod sequences;
pub mod set;

use gather::{DatasetStats, entry_or_default};

use crate::preview::{LayerSelection, Tile};
use gelsim_dataset::archive::{MemberHead, SampleFiles};
use gelsim_dataset::dataset_error::DatasetError;
use gelsim_dataset::labels::{self, SampleLabel};
use gelsim_dataset::manifest::Manifest;
use gelsim_dataset::recorded::RecordedDataset;
use gelsim_dataset::stats::ShardStats;
use gelsim_dataset::verify::DatasetFinding;
use gelsim_dataset::versioned::Versioned;
use gelsim_files::image_file;
use gelsim_files::input;
use gelsim_job::config::document::MAX_READ_BYTES;
use gelsim_job::label::sample_key;
use gelsim_job::layout::{Layout, Shard, Split};

/// Most tactile images whose brightness is measured.
pub const MAX_IMAGES: u64 = 1000;
/// Most samples on the contact sheet.
pub const MAX_TILES: u64 = 24;
/// Most findings that are named for one shard.
const MAX_NAMED: usize = 3;

/// A dataset as a report shows it.
pub struct DatasetReport {
    /// The dataset's job and layout.
    pub recorded: RecordedDataset,
    /// Text of its job.toml.
    pub job_text: String,
    /// Manifest; none if the dataset is not complete.
    pub manifest: Option<Manifest>,
    /// Sums over the shards.
    pub gathered: DatasetStats,
    /// Missing shards, as ranges of neighbours.
    pub missing: Vec<MissingShards>,
}

/// A range of neighbouring shards that do not exist.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MissingShards {
    /// First shard of the range.
    pub first: Shard,
    /// Last shard of the range.
    pub last: Shard,
}

/// Reads what a report shows of the dataset at `root`. Fails for a folder that is no dataset, or one of a newer gelsim.
pub fn read_dataset(root: &Path) -> Result<DatasetReport, DatasetError> {
    let recorded = RecordedDataset::open(root).map_err(DatasetError::Usage)?;
    let job = root.join("job.toml");
    let text = input::read(&job, MAX_READ_BYTES).map_err(|error| DatasetError::Io(job, error))?;
    let manifest = Manifest::read(&root.join("dataset.json"))?;
    let layout = &recorded.layout;
    let (mut complete, mut missing) = (Vec::new(), Vec::<MissingShards>::new());
    for shard in (0..layout.shard_count()).map(|number| layout.shard(number)) {
        let paths = recorded.shard_paths(&shard);
        match (paths.data.exists() || paths.stats.exists(), missing.last_mut()) {
            (true, _) => complete.push(shard),
            (false, Some(MissingShards { last, .. })) if last.number + 1 == shard.number => *last = shard,
            (false, _) => missing.push(MissingShards { first: shard, last: shard }),
        }
    }
    let picks = SamplePicks::from_layout(layout, &complete);
    let mut gathered = DatasetStats::new(recorded.job.sensor.field_of_view_mm);
    // A few shards at a time, to bound memory; merged in their order, so that floating-point sums do not depend on the
    // threads.
    for shards in complete.chunks(4 * rayon::current_num_threads()) {
        let parts: Vec<_> =
            shards.par_iter().map(|shard| gather_shard(&recorded, shard, &picks)).collect::<Result<_, _>>()?;
        parts.into_iter().for_each(|part| gathered.merge(part));
    }
    gathered.tiles.sort_by_key(|tile| (tile.split, tile.index));
    let job_text = String::from_utf8_lossy(&text).into_owned();
    Ok(DatasetReport { recorded, job_text, manifest, gathered, missing })
}

impl DatasetReport {
    /// Renders the complete page.
    pub fn to_html(&self) -> String {
        html::render_page(self)
    }

    /// Lists what is wrong or missing, in sentences.
    pub fn list_warnings(&self) -> Vec<String> {
        html::list_warnings(self)
    }
}

/// Numbers of the samples whose images are read: for their brightness, and for the contact sheet.
struct SamplePicks {
    brightness: BTreeSet<u64>,
    sheet: BTreeSet<u64>,
}

impl SamplePicks {
    fn from_layout(layout: &Layout, shards: &[Shard]) -> Self {
        let of_splits: Vec<Vec<Shard>> = Split::ALL
            .iter()
            .map(|split| shards.iter().filter(|shard| shard.split == *split).copied().collect())
            .filter(|shards: &Vec<Shard>| !shards.is_empty())
            .collect();
        let fraction = MAX_TILES / of_splits.len().max(1) as u64;
        Self {
            brightness: spread_samples(layout, shards, MAX_IMAGES),
            sheet: of_splits.iter().flat_map(|shards| spread_samples(layout, shards, fraction)).collect(),
        }
    }
}

/// Returns the numbers of `count` samples, evenly spread over the shards, or of all if there are fewer.
fn spread_samples(layout: &Layout, shards: &[Shard], count: u64) -> BTreeSet<u64> {
    let all: u64 = shards.iter().map(|shard| shard.samples).sum();
    let count = count.min(all);
    let (mut before, mut shards) = (0, shards.iter().peekable());
    let picks = (0..count).map_while(|i| {
        let at = (u128::from(2 * i + 1) * u128::from(all) / u128::from(2 * count)) as u64;
        while shards.peek().is_some_and(|shard| at >= before + shard.samples) {
            before += shards.next().map_or(0, |shard| shard.samples);
        }
        shards.peek().map(|shard| layout.index_of(shard.split, shard.first_position + at - before))
    });
    picks.collect()
}

/// Gathers the labels and stats of one shard.
fn gather_shard(recorded: &RecordedDataset, shard: &Shard, picks: &SamplePicks) -> Result<DatasetStats, DatasetError> {
    let paths = recorded.shard_paths(shard);
    let (file, stats_name) = (paths.container.relative_path(shard), format!("stats/{}.json", shard.name()));
    let stats = ShardStats::read(&paths.stats)?;
    let mut gathered = DatasetStats::new(recorded.job.sensor.field_of_view_mm);
    let mut found = Vec::new();
    match &stats {
        Some(stats) => gathered.count_shard(shard.split, stats),
        None => found.push(DatasetFinding::new(
            &stats_name,
            "is missing or incomplete, so that the shard does not count as complete",
        )),
    }
    let length = paths.container.measure_bytes(&paths.data).ok();
    match (length, &stats) {
        (None, _) => found.push(DatasetFinding::new(&file, "is missing or cannot be read")),
        (Some(length), Some(stats)) if length != stats.bytes => {
            found.push(DatasetFinding::new(&file, format!("has {length} bytes, {} were written", stats.bytes)));
        }
        _ => {}
    }
    if length.is_some() {
        let wrong = read_labels(recorded, shard, picks, &mut gathered);
        found.extend(wrong.iter().take(MAX_NAMED).map(|what| DatasetFinding::new(&file, what)));
        if wrong.len() > MAX_NAMED {
            found.push(DatasetFinding::new(
                &file,
                format!("and {} more things are wrong in it", wrong.len() - MAX_NAMED),
            ));
        }
    }
    gathered.findings = found;
    Ok(gathered)
}

/// Reads the labels of a shard, and the images that were picked. Returns what is wrong in it.
fn read_labels(
    recorded: &RecordedDataset,
    shard: &Shard,
    picks: &SamplePicks,
    gathered: &mut DatasetStats,
) -> Vec<String> {
    let (mut wrong, mut files, mut seen, mut strangers) = (Vec::new(), BTreeMap::new(), 0, 0);
    let picked = |picks: &BTreeSet<u64>, key: &str| key.parse().is_ok_and(|index| picks.contains(&index));
    let wanted = |head: MemberHead| {
        // Files of all frames count as one kind; those of the two fingers as two.
        let labels::SuffixParts { frame, finger, layer } = labels::split_suffix(head.suffix);
        let of_finger = finger.map_or(String::new(), |finger| format!("{finger}."));
        let kind = if frame.is_some() { format!("f*.{of_finger}{layer}") } else { head.suffix.to_owned() };
        let (number, bytes): &mut (u64, u64) = entry_or_default(&mut files, &kind);
        *number += 1;
        *bytes += head.bytes;
        head.suffix == "json"
            || matches!((frame, finger, layer), (None | Some("f0000"), None | Some("left"), "tactile.png"))
                && picked(&picks.brightness, head.key)
            || picked(&picks.sheet, head.key)
    };
    let mut expected = recorded.layout.sample_indices(*shard);
    let visit = |sample: SampleFiles| {
        seen += 1;
        strangers += u64::from(expected.next().map(sample_key).as_ref() != Some(&sample.key));
        wrong.extend(count_sample(gathered, shard.split, picks, &sample).err());
        ControlFlow::Continue(())
    };
    let read = recorded.visit_samples(shard, wanted, visit);
    gathered.files = files;
    wrong.extend(read.err());
    if seen != shard.samples {
        wrong.push(format!("has {seen} samples, the job {}", shard.samples));
    }
    if strangers > 0 {
        wrong.push(format!("has {strangers} samples where others belong"));
    }
    wrong
}

/// Counts a sample, and its images if they were picked. An error says what cannot be read.
fn count_sample(
    gathered: &mut DatasetStats,
    split: Split,
    picks: &SamplePicks,
    sample: &SampleFiles,
) -> Result<(), String> {
    let key = &sample.key;
    let bytes = sample.find_member("json").ok_or_else(|| format!("{key}.json is missing"))?;
    let label = SampleLabel::read(bytes).map_err(|error| format!("{key}.json: {error}"))?;
    gathered.count_sample(split, label.summary());
    let index = key.parse::<u64>();
    let shown = index.as_ref().is_ok_and(|index| picks.sheet.contains(index));
    match &label {
        SampleLabel::Press(_) | SampleLabel::Grip(..) => {}
        SampleLabel::Sequence(sequence, _) => gathered.sequences.count_sequence(split, sequence, shown),
        SampleLabel::GripSequence(sequence, _) => gathered.sequences.count_grip(split, sequence, shown),
    }
    let Ok(index) = index else { return Ok(()) };
    if picks.brightness.contains(&index) {
        let first = match &label {
            SampleLabel::Press(_) => "tactile.png",
            SampleLabel::Sequence(..) => "f0000.tactile.png",
            SampleLabel::Grip(..) => "left.tactile.png",
            SampleLabel::GripSequence(..) => "f0000.left.tactile.png",
        };
        let png = sample.find_member(first).ok_or_else(|| format!("{key}.{first} is missing"))?;
        let image = image_file::decode_rgb(png).map_err(|reason| format!("{key}.{first}: {reason}"))?;
        let sum: u64 = image.iter().map(|level| u64::from(*level)).sum();
        gathered.brightness.count_value(split, sum as f64 / (image.len().max(1)) as f64);
    }
    if picks.sheet.contains(&index) {
        gathered.add_tile(index, split, Tile::from_files(sample, &LayerSelection::Usual)?);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::preview::panel::Scales;
    use gelsim_dataset::generate::{GenerateRequest, RunMonitor, generate};
    use gelsim_job::config::Overrides;
    use gelsim_job::config::dataset::Splits;
    use gelsim_job::plan::Plan;

    /// 30 small samples in shards of 4, in `folder`/out.
    fn dataset(folder: &Path) -> RecordedDataset {
        let [ball, cube] =
            ["sphere", "cube"].map(|name| format!("{}/../../objects/{name}.obj", env!("CARGO_MANIFEST_DIR")));
        let text = format!(
            "dataset = {{ name = \"t\", samples = 30, samples_per_shard = 4, splits = {{ train = 0.6, test = 0.4 }} }}\n\
             sensor.resolution_px = [24, 18]\nindentation.depth_mm = [0.2, 1.0]\nindentation.no_contact = 0.2\n\
             pose.yaw_deg = [0.0, 360.0]\nobject = [{{ path = {ball:?} }}, {{ path = {cube:?} }}]\n"
        );
        let (job, root) = (folder.join("job.toml"), folder.join("out"));
        std::fs::write(&job, text).expect("a file");
        let plan = Plan::load(&job, &Overrides::default()).expect("a sound job");
        let request = GenerateRequest { root: root.clone(), shards: None, threads: Some(1), overwrite: false };
        generate(&plan, &request, &RunMonitor::default()).expect("a dataset");
        RecordedDataset::open(&root).expect("a dataset")
    }

    #[test]
    fn shards_add_up_to_the_dataset_in_any_order() {
        let folder = tempfile::tempdir().expect("a folder");
        let recorded = dataset(folder.path());
        let shards: Vec<Shard> =
            (0..recorded.layout.shard_count()).map(|number| recorded.layout.shard(number)).collect();
        let picks = SamplePicks::from_layout(&recorded.layout, &shards);
        let sum = |order: &mut dyn Iterator<Item = &Shard>| {
            let mut sum = DatasetStats::new(recorded.job.sensor.field_of_view_mm);
            order.for_each(|shard| sum.merge(gather_shard(&recorded, shard, &picks).expect("readable")));
            sum.tiles.sort_by_key(|tile| tile.index);
            sum
        };
        let (forth, back) = (sum(&mut shards.iter()), sum(&mut shards.iter().rev()));
        let counts = |sum: &DatasetStats| {
            let bars: Vec<_> = sum.histograms.iter().chain([&sum.brightness]).map(|one| one.to_bars(20)).collect();
            let tiles: Vec<_> =
                sum.tiles.iter().map(|tile| (tile.index, tile.tile.to_strip(&Scales::default(), 108))).collect();
            let totals = (sum.totals.shards, sum.totals.samples, sum.totals.bytes);
            let told = format!("{:?} {:?} {:?} {totals:?}", sum.classes, sum.objects, sum.reasons);
            (told, bars, tiles, sum.files.clone(), (sum.samples, sum.in_contact), sum.places.to_svg("t", 300.0).0)
        };
        assert!(counts(&forth) == counts(&back));
        assert_eq!((forth.samples, forth.tiles.len(), forth.findings.len()), ([18, 0, 12], 24, 0));
        assert_eq!(forth.brightness.total_summary().count, 30);
        let depths = forth.histograms[0].total_summary().count;
        assert!(depths == forth.in_contact.iter().sum::<u64>() && (12..30).contains(&depths), "{depths}");
        for reasons in gelsim_core::effects::Effect::ALL.map(|effect| &forth.reasons[effect]) {
            assert_eq!(reasons.values().sum::<u64>(), 30);
        }
        assert_eq!(forth.files["json"].0, 30);
        assert_eq!(
            read_dataset(&recorded.root).expect("readable").to_html(),
            read_dataset(&recorded.root).expect("readable").to_html()
        );
    }

    #[test]
    fn a_job_that_was_edited_is_not_shown_as_the_one_that_was_run() {
        let folder = tempfile::tempdir().expect("a folder");
        let recorded = dataset(folder.path());
        let warnings = || read_dataset(&recorded.root).expect("readable").list_warnings();
        assert_eq!(warnings(), [""; 0]);
        let path = recorded.root.join("job.toml");
        let text = std::fs::read_to_string(&path).expect("a text");
        std::fs::write(&path, text.replace("no_contact = 0.2", "no_contact = 0.3")).expect("a file");
        let [told, remedy] = &warnings()[..] else { panic!("two sentences") };
        assert!(told == "job.toml: is not what was written" && remedy.contains("gelsim verify"), "{told}; {remedy}");
    }

    proptest! {
        #[test]
        fn picks_are_as_many_as_asked_for_and_spread_over_the_shards_that_are_there(
            samples in 1..3000_u64, per_shard in 1..200_u64, count in 1..100_u64, every in 1..4_usize,
        ) {
            let layout = Layout::new(samples, per_shard, Splits { train: 0.7, val: 0.2, test: 0.1 });
            let shards: Vec<Shard> = (0..layout.shard_count()).step_by(every).map(|number| layout.shard(number)).collect();
            let all: u64 = shards.iter().map(|shard| shard.samples).sum();
            let picks = spread_samples(&layout, &shards, count);
            prop_assert_eq!(picks.len() as u64, count.min(all));
            let of = |shard: &Shard| layout.sample_indices(*shard).filter(|index| picks.contains(index)).count() as f64;
            prop_assert_eq!(shards.iter().map(of).sum::<f64>() as usize, picks.len());
            for shard in &shards {
                let fair = count.min(all) as f64 * shard.samples as f64 / all as f64;
                prop_assert!((of(shard) - fair).abs() <= 1.0, "{} of {fair}", of(shard));
            }
        }
    }
}
