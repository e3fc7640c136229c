//! What a dataset holds, for people: one HTML page from its labels and stats, of any number of samples.
//!
//! Only labels are read, and the images of at most [`MOST_IMAGES`] samples; shards in parallel. What is missing or
//! damaged is named, and the page is made from what is there.

use gelsim_dataset::container::ShardContainer;
use std::collections::{BTreeMap, BTreeSet};
use std::ops::ControlFlow;
use std::path::Path;

use rayon::prelude::*;

pub mod gather;
pub mod histogram;
mod html;
pub mod places;
pub mod quantities;
pub mod sequences;

use gather::{DatasetStats, counted};

use crate::preview::{LayerSelection, Tile};
use gelsim_dataset::archive::{Files, Head};
use gelsim_dataset::labels::{self, SampleLabel};
use gelsim_dataset::manifest::Manifest;
use gelsim_dataset::recorded::Recorded;
use gelsim_dataset::refused::Refused;
use gelsim_dataset::stats::Stats;
use gelsim_dataset::verify::Finding;
use gelsim_dataset::versioned::Versioned;
use gelsim_files::image_file;
use gelsim_files::input;
use gelsim_job::config::document::MOST_READ;
use gelsim_job::label::key;
use gelsim_job::layout::{Layout, Shard, Split};

/// Tactile images of which the brightness is taken, at most.
pub const MOST_IMAGES: u64 = 1000;
/// Samples on the contact sheet, at most.
pub const SHEET: u64 = 24;
/// Findings that are named for one shard.
const MOST_NAMED: usize = 3;

/// A dataset as a report shows it.
pub struct Dataset {
    /// The dataset's job and layout.
    pub recorded: Recorded,
    /// The text of its job.toml.
    pub job_text: String,
    /// Its manifest, if it is complete.
    pub manifest: Option<Manifest>,
    /// What its shards hold.
    pub gathered: DatasetStats,
    /// Shards that are not there, as ranges of neighbours.
    pub missing: Vec<MissingShards>,
}

/// Neighbouring shards that are not there.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MissingShards {
    /// The first one.
    pub first: Shard,
    /// The last one.
    pub last: Shard,
}

/// Reads what a report shows of the dataset at `root`. Refuses a folder that is no dataset, or a newer gelsim's.
pub fn read(root: &Path) -> Result<Dataset, Refused> {
    let recorded = Recorded::open(root).map_err(Refused::Usage)?;
    let job = root.join("job.toml");
    let text = input::read(&job, MOST_READ).map_err(|error| Refused::Io(job, error))?;
    let manifest = Manifest::read(&root.join("dataset.json"))?;
    let layout = &recorded.layout;
    let (mut complete, mut missing) = (Vec::new(), Vec::<MissingShards>::new());
    for shard in (0..layout.shard_count()).map(|number| layout.shard(number)) {
        let paths = recorded.paths(&shard);
        match (paths.data.exists() || paths.stats.exists(), missing.last_mut()) {
            (true, _) => complete.push(shard),
            (false, Some(MissingShards { last, .. })) if last.number + 1 == shard.number => *last = shard,
            (false, _) => missing.push(MissingShards { first: shard, last: shard }),
        }
    }
    let picks = Picks::from_layout(layout, &complete);
    let mut gathered = DatasetStats::new(recorded.job.sensor.field_of_view_mm);
    // A few shards at a time, added in their order, so that sums do not depend on the threads.
    for shards in complete.chunks(4 * rayon::current_num_threads()) {
        let parts: Vec<_> =
            shards.par_iter().map(|shard| gather_shard(&recorded, shard, &picks)).collect::<Result<_, _>>()?;
        parts.into_iter().for_each(|part| gathered.merge(part));
    }
    gathered.tiles.sort_by_key(|tile| (tile.split, tile.index));
    let job_text = String::from_utf8_lossy(&text).into_owned();
    Ok(Dataset { recorded, job_text, manifest, gathered, missing })
}

impl Dataset {
    /// The complete page.
    pub fn html(&self) -> String {
        html::page(self)
    }

    /// What is wrong or not there yet, in sentences.
    pub fn warnings(&self) -> Vec<String> {
        html::warnings(self)
    }
}

/// Samples whose images are looked at.
struct Picks {
    brightness: BTreeSet<u64>,
    sheet: BTreeSet<u64>,
}

impl Picks {
    fn from_layout(layout: &Layout, shards: &[Shard]) -> Self {
        let of_splits: Vec<Vec<Shard>> = Split::ALL
            .iter()
            .map(|split| shards.iter().filter(|shard| shard.split == *split).copied().collect())
            .filter(|shards: &Vec<Shard>| !shards.is_empty())
            .collect();
        let fraction = SHEET / of_splits.len().max(1) as u64;
        Self {
            brightness: spread(layout, shards, MOST_IMAGES),
            sheet: of_splits.iter().flat_map(|shards| spread(layout, shards, fraction)).collect(),
        }
    }
}

/// The numbers of `count` samples, or of all if there are fewer, evenly spread over the shards.
fn spread(layout: &Layout, shards: &[Shard], count: u64) -> BTreeSet<u64> {
    let all: u64 = shards.iter().map(|shard| shard.samples).sum();
    let count = count.min(all);
    let (mut before, mut shards) = (0, shards.iter().peekable());
    let picks = (0..count).map_while(|i| {
        let at = (u128::from(2 * i + 1) * u128::from(all) / u128::from(2 * count)) as u64;
        while shards.peek().is_some_and(|shard| at >= before + shard.samples) {
            before += shards.next().map_or(0, |shard| shard.samples);
        }
        shards.peek().map(|shard| layout.index_of(shard.split, shard.first + at - before))
    });
    picks.collect()
}

/// Gathers what one shard holds.
fn gather_shard(recorded: &Recorded, shard: &Shard, picks: &Picks) -> Result<DatasetStats, Refused> {
    let paths = recorded.paths(shard);
    let (file, stats_name) = (paths.container.file(shard), format!("stats/{}.json", shard.name()));
    let stats = Stats::read(&paths.stats)?;
    let mut gathered = DatasetStats::new(recorded.job.sensor.field_of_view_mm);
    let mut found = Vec::new();
    match &stats {
        Some(stats) => gathered.count_shard(shard.split, stats),
        None => found
            .push(Finding::new(&stats_name, "is missing or not whole, so that the shard does not count as complete")),
    }
    let length = paths.container.measure(&paths.data).ok();
    match (length, &stats) {
        (None, _) => found.push(Finding::new(&file, "is missing or cannot be read")),
        (Some(length), Some(stats)) if length != stats.bytes => {
            found.push(Finding::new(&file, format!("has {length} bytes, {} were written", stats.bytes)));
        }
        _ => {}
    }
    if length.is_some() {
        let wrong = labels(recorded, shard, picks, &mut gathered);
        found.extend(wrong.iter().take(MOST_NAMED).map(|what| Finding::new(&file, what)));
        if wrong.len() > MOST_NAMED {
            found.push(Finding::new(&file, format!("and {} more things are wrong in it", wrong.len() - MOST_NAMED)));
        }
    }
    gathered.findings = found;
    Ok(gathered)
}

/// Reads the labels of a shard, and the images that were picked. What is wrong there.
fn labels(recorded: &Recorded, shard: &Shard, picks: &Picks, gathered: &mut DatasetStats) -> Vec<String> {
    let (mut wrong, mut files, mut seen, mut strangers) = (Vec::new(), BTreeMap::new(), 0, 0);
    let picked = |picks: &BTreeSet<u64>, key: &str| key.parse().is_ok_and(|index| picks.contains(&index));
    let wanted = |head: Head| {
        // The files of all frames are of one kind; those of two fingers are of two.
        let labels::Suffix { frame, finger, layer } = labels::split(head.suffix);
        let of_finger = finger.map_or(String::new(), |finger| format!("{finger}."));
        let kind = if frame.is_some() { format!("f*.{of_finger}{layer}") } else { head.suffix.to_owned() };
        let (number, bytes): &mut (u64, u64) = counted(&mut files, &kind);
        *number += 1;
        *bytes += head.bytes;
        head.suffix == "json"
            || matches!((frame, finger, layer), (None | Some("f0000"), None | Some("left"), "tactile.png"))
                && picked(&picks.brightness, head.key)
            || picked(&picks.sheet, head.key)
    };
    let mut expected = recorded.layout.indices(*shard);
    let visit = |sample: Files| {
        seen += 1;
        strangers += u64::from(expected.next().map(key).as_ref() != Some(&sample.key));
        wrong.extend(count(gathered, shard.split, picks, &sample).err());
        ControlFlow::Continue(())
    };
    let read = recorded.read(shard, wanted, visit);
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

/// Counts a sample.
fn count(gathered: &mut DatasetStats, split: Split, picks: &Picks, sample: &Files) -> Result<(), String> {
    let key = &sample.key;
    let bytes = sample.member("json").ok_or_else(|| format!("{key}.json is missing"))?;
    let label = SampleLabel::read(bytes).map_err(|error| format!("{key}.json: {error}"))?;
    gathered.count(split, label.summary());
    let index = key.parse::<u64>();
    let shown = index.as_ref().is_ok_and(|index| picks.sheet.contains(index));
    match &label {
        SampleLabel::Press(_) | SampleLabel::Grip(..) => {}
        SampleLabel::Sequence(sequence, _) => gathered.sequences.count(split, sequence, shown),
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
        let png = sample.member(first).ok_or_else(|| format!("{key}.{first} is missing"))?;
        let image = image_file::decode_rgb(png).map_err(|reason| format!("{key}.{first}: {reason}"))?;
        let sum: u64 = image.iter().map(|level| u64::from(*level)).sum();
        gathered.brightness.count(split, sum as f64 / (image.len().max(1)) as f64);
    }
    if picks.sheet.contains(&index) {
        gathered.show(index, split, Tile::read(sample, &LayerSelection::Usual)?);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::preview::panel::Scales;
    use gelsim_dataset::generate::{Request, Watch, generate};
    use gelsim_job::config::Overrides;
    use gelsim_job::config::dataset::Splits;
    use gelsim_job::plan::Plan;

    /// 30 small samples in shards of 4, in `folder`/out.
    fn dataset(folder: &Path) -> Recorded {
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
        let request = Request { root: root.clone(), shards: None, threads: Some(1), overwrite: false };
        generate(&plan, &request, &Watch::default()).expect("a dataset");
        Recorded::open(&root).expect("a dataset")
    }

    #[test]
    fn shards_add_up_to_the_dataset_in_any_order() {
        let folder = tempfile::tempdir().expect("a folder");
        let recorded = dataset(folder.path());
        let shards: Vec<Shard> =
            (0..recorded.layout.shard_count()).map(|number| recorded.layout.shard(number)).collect();
        let picks = Picks::from_layout(&recorded.layout, &shards);
        let sum = |order: &mut dyn Iterator<Item = &Shard>| {
            let mut sum = DatasetStats::new(recorded.job.sensor.field_of_view_mm);
            order.for_each(|shard| sum.merge(gather_shard(&recorded, shard, &picks).expect("readable")));
            sum.tiles.sort_by_key(|tile| tile.index);
            sum
        };
        let (forth, back) = (sum(&mut shards.iter()), sum(&mut shards.iter().rev()));
        let counts = |sum: &DatasetStats| {
            let bars: Vec<_> = sum.histograms.iter().chain([&sum.brightness]).map(|one| one.bars(20)).collect();
            let tiles: Vec<_> =
                sum.tiles.iter().map(|tile| (tile.index, tile.tile.strip(&Scales::default(), 108))).collect();
            let totals = (sum.totals.shards, sum.totals.samples, sum.totals.bytes);
            let told = format!("{:?} {:?} {:?} {totals:?}", sum.classes, sum.objects, sum.reasons);
            (told, bars, tiles, sum.files.clone(), (sum.samples, sum.in_contact), sum.places.svg("t", 300.0).0)
        };
        assert!(counts(&forth) == counts(&back));
        assert_eq!((forth.samples, forth.tiles.len(), forth.findings.len()), ([18, 0, 12], 24, 0));
        assert_eq!(forth.brightness.all().count, 30);
        let depths = forth.histograms[0].all().count;
        assert!(depths == forth.in_contact.iter().sum::<u64>() && (12..30).contains(&depths), "{depths}");
        for reasons in gelsim_core::effects::Effect::ALL.map(|effect| &forth.reasons[effect]) {
            assert_eq!(reasons.values().sum::<u64>(), 30);
        }
        assert_eq!(forth.files["json"].0, 30);
        assert_eq!(read(&recorded.root).expect("readable").html(), read(&recorded.root).expect("readable").html());
    }

    proptest! {
        #[test]
        fn picks_are_as_many_as_asked_for_and_spread_over_the_shards_that_are_there(
            samples in 1..3000_u64, per_shard in 1..200_u64, count in 1..100_u64, every in 1..4_usize,
        ) {
            let layout = Layout::new(samples, per_shard, Splits { train: 0.7, val: 0.2, test: 0.1 });
            let shards: Vec<Shard> = (0..layout.shard_count()).step_by(every).map(|number| layout.shard(number)).collect();
            let all: u64 = shards.iter().map(|shard| shard.samples).sum();
            let picks = spread(&layout, &shards, count);
            prop_assert_eq!(picks.len() as u64, count.min(all));
            let of = |shard: &Shard| layout.indices(*shard).filter(|index| picks.contains(index)).count() as f64;
            prop_assert_eq!(shards.iter().map(of).sum::<f64>() as usize, picks.len());
            for shard in &shards {
                let fair = count.min(all) as f64 * shard.samples as f64 / all as f64;
                prop_assert!((of(shard) - fair).abs() <= 1.0, "{} of {fair}", of(shard));
            }
        }
    }
}
