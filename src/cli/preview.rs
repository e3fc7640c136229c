//! `gelsim preview`

use std::io::Cursor;
use std::path::{Path, PathBuf};

use clap::Args;
use image::RgbImage;
use image::codecs::jpeg::JpegEncoder;
use rayon::prelude::*;

use super::guesses::whole;
use super::store::{folder_only, local_output};
use super::{Failure, JobOverrides, Log, output_file, settle_fidelity};
use gelsim_core::effects::Effect;
use gelsim_dataset::recorded::Recorded;
use gelsim_files::diagnostic::{Diagnostic, user_error};
use gelsim_files::png::encode_small;
use gelsim_files::spelling::{nearest, shell_word};
use gelsim_job::layers::OutputLayer;
use gelsim_job::plan::Plan;
use gelsim_job::probe::foresee;
use gelsim_lab::preview::choice::{Choice, choose};
use gelsim_lab::preview::effects::{self, EffectComparison, compare};
use gelsim_lab::preview::film::animation;
use gelsim_lab::preview::panel::has_picture;
use gelsim_lab::preview::{LayerSelection, Tile, sample_files, sheet};

/// Draw a contact sheet: tactile image, depth and (where there is one) contact, or the layers that are named, with class, depth and
/// split under each; of a dataset every split and class as often as it is there. Or show what each effect changes in a job's
/// samples.
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  gelsim preview configs/quickstart.toml --out sheet.png
  gelsim preview out/quickstart --out sample.png --key 42
  gelsim preview configs/gallery.toml --layers normal,pressure --out layers.png
  gelsim preview configs/effects.toml --effects --out effects.png
  gelsim preview configs/slip.toml --key 0 --apng --out slip.png")]
pub struct Preview {
    /// A dataset's folder, or a job whose samples are rendered on the spot
    #[arg(value_name = "DIR|JOB.toml")]
    source: PathBuf,
    /// The picture to write: PNG, or JPEG if its name ends in .jpg
    #[arg(short, long, value_name = "FILE.png", value_parser = local_output())]
    out: PathBuf,
    /// Only this sample, at full size unless --panel says otherwise
    #[arg(long, value_name = "K", value_parser = whole::<u64>)]
    key: Option<u64>,
    /// What is shown beside the tactile image, of a sequence below it: layers that a dataset has, or any of a job [default: depth,
    /// contact; of sequences none]
    #[arg(long, value_name = "LAYER,..", value_delimiter = ',', value_parser = layer)]
    layers: Vec<OutputLayer>,
    /// For each effect that a job's samples call for, one of them with the effect, without it, and the difference
    #[arg(long, conflicts_with_all = ["count", "columns", "layers"])]
    effects: bool,
    /// An animated PNG of the frames of the sequence that --key names
    #[arg(long, requires = "key", conflicts_with_all = ["effects", "count", "columns", "panel", "layers"])]
    apng: bool,
    /// How many samples the sheet shows
    #[arg(long, value_name = "N", default_value_t = 12, value_parser = whole::<u64>)]
    count: u64,
    /// Width of one panel of the sheet, px [default: 240; of effects 658; with --key full size]
    #[arg(long, value_name = "PX", value_parser = whole::<u32>)]
    panel: Option<u32>,
    /// Columns of the sheet
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = whole::<usize>)]
    columns: usize,
    #[command(flatten)]
    overrides: JobOverrides,
}

/// Endings of pictures' names; the first one also that of films.
const ENDINGS: [&str; 3] = ["png", "jpg", "jpeg"];

impl Preview {
    pub(super) fn run(self) -> Result<(), Failure> {
        folder_only(&self.source, "preview")?;
        let (endings, example) = if self.apng { (&ENDINGS[..1], "film.png") } else { (&ENDINGS[..], "sheet.png") };
        output_file::check(&self.out, endings, example)?;
        let panel = |default: u32| self.panel.unwrap_or(default).max(1);
        if self.effects {
            return write(&self.out, &effects::sheet(&self.comparisons()?, panel(effects::PANEL)));
        }
        if self.apng {
            return self.animated();
        }
        let tiles = if self.source.is_dir() { self.dataset_tiles()? } else { self.job_tiles()? };
        let picture = match self.key {
            Some(_) => sheet(&tiles, 1, panel(u32::MAX)),
            None => sheet(&tiles, self.columns, panel(240)),
        };
        write(&self.out, &picture)
    }

    /// Writes the frames of a sequence.
    fn animated(&self) -> Result<(), Failure> {
        let key = self.key.unwrap_or_default();
        let still = |what: &str| -> Failure {
            let message = format!("--apng shows a sequence, and {what} none");
            let help = format!(
                "leave --apng out: gelsim preview {} --key {key} --out {}",
                shell_word(&self.source),
                shell_word(&self.out)
            );
            user_error(message, help).into()
        };
        let film = if self.source.is_dir() {
            let dataset = self.dataset()?;
            if dataset.job.sequence.is_none() {
                return Err(still("the samples of this dataset are"));
            }
            self.checked_key(key, dataset.layout.samples())?;
            let film = dataset.sample(key).and_then(|files| animation(&files));
            film.map_err(|reason| self.unreadable(reason))?
        } else {
            let plan = self.plan()?;
            if plan.job().sequence.is_none() {
                return Err(still("the samples of this job are"));
            }
            self.checked_key(key, plan.layout.samples())?;
            animation(&sample_files(&plan, key)).map_err(Failure::running)?
        };
        output_file::write(&self.out, &film.ok_or_else(|| still("this sample is"))?)
    }

    fn plan(&self) -> Result<Plan, Failure> {
        let mut overrides = self.overrides.overrides();
        if !self.layers.is_empty() {
            let names: Vec<String> = self.layers.iter().map(|layer| format!("\"{}\"", layer.name())).collect();
            overrides.set.push((String::from("--layers"), format!("output.layers = [{}]", names.join(", "))));
        }
        let plan = settle_fidelity(Plan::load(&self.source, &overrides)?, None, Log::text(false))?;
        self.overrides.note(&foresee(&plan).notes, Log::text(false))?;
        Ok(plan)
    }

    /// The dataset, for which no flag is there that only changes a job.
    fn dataset(&self) -> Result<Recorded, Failure> {
        let flags = self.overrides.names();
        if !flags.is_empty() {
            let verb = if flags.len() == 1 { "changes" } else { "change" };
            let message = format!("{} {verb} a job, not a dataset that is there", flags.join(", "));
            let job = shell_word(&self.source.join("job.toml"));
            let help = format!("leave {} out, or preview the dataset's job: {job}", flags.join(", "));
            return Err(user_error(message, help).into());
        }
        Ok(Recorded::open(&self.source)?)
    }

    /// A file of the dataset is missing or damaged.
    fn unreadable(&self, reason: String) -> Failure {
        Failure::running_with(reason, unreadable_help(&self.source))
    }

    /// What the effects change in the sample asked for, or in the first ones of the job.
    fn comparisons(&self) -> Result<Vec<EffectComparison>, Failure> {
        /// Samples that are searched for effects.
        const SEARCHED: u64 = 100;
        if self.source.is_dir() {
            Recorded::open(&self.source)?;
            let message = format!("--effects renders a job's samples anew, and {} is a dataset", self.source.display());
            let (job, out) = (shell_word(&self.source.join("job.toml")), shell_word(&self.out));
            let help = format!("preview the job that it was made by: gelsim preview {job} --effects --out {out}");
            return Err(user_error(message, help).into());
        }
        let plan = self.plan()?;
        plan.of_presses("--effects")?;
        let samples = plan.layout.samples();
        let indices = match self.key {
            Some(key) => vec![self.checked_key(key, samples)?],
            None => (0..samples.min(SEARCHED)).collect(),
        };
        let found = compare(&plan, &indices);
        let missing = Effect::ALL.into_iter().filter(|effect| found.iter().all(|row| row.effect != *effect));
        let names: Vec<&str> = missing.map(Effect::name).collect();
        let of = match indices.as_slice() {
            [only] => format!("sample {only}"),
            several => format!("samples 0 to {}", several.len() - 1),
        };
        if found.is_empty() {
            return Err(
                user_error(format!("{of}: no effect is called for"), "preview the job without --effects").into()
            );
        }
        if !names.is_empty() {
            Log::text(false).note(&format!("{of}: not called for are {}", names.join(", ")));
        }
        Ok(found)
    }

    /// The samples of a job: the one asked for, or the first ones.
    fn job_tiles(&self) -> Result<Vec<Tile>, Failure> {
        let plan = self.plan()?;
        let samples = plan.layout.samples();
        let indices = match self.key {
            Some(key) => vec![self.checked_key(key, samples)?],
            None => (0..self.count.clamp(1, samples.max(1))).collect(),
        };
        let wanted = self.wanted();
        Ok(indices.par_iter().map(|&index| Tile::rendered(&plan, index, &wanted)).collect())
    }

    /// The samples of a dataset: the one asked for, or some of every split and class.
    fn dataset_tiles(&self) -> Result<Vec<Tile>, Failure> {
        let dataset = self.dataset()?;
        self.check_layers(&dataset)?;
        let indices = match self.key {
            Some(key) => vec![self.checked_key(key, dataset.layout.samples())?],
            None => self.chosen(&dataset)?,
        };
        let wanted = self.wanted();
        let tiles = indices.par_iter().map(|&index| Tile::read(&dataset.sample(index)?, &wanted));
        tiles.collect::<Result<_, _>>().map_err(|reason: String| self.unreadable(reason))
    }

    fn chosen(&self, dataset: &Recorded) -> Result<Vec<u64>, Failure> {
        let Choice { samples, missing } =
            choose(dataset, self.count.max(1)).map_err(|reason| self.unreadable(reason))?;
        if let Some(first) = missing.first() {
            let all = dataset.layout.shard_count();
            let message = match missing.len() {
                1 => format!("1 of {all} shards is not there: {}", first.name()),
                count => format!("{count} of {all} shards are not there, {} the first of them", first.name()),
            };
            if samples.is_empty() {
                return Err(self.unreadable(message));
            }
            let (job, folder) = (shell_word(&self.source.join("job.toml")), shell_word(&self.source));
            let help = format!("gelsim generate {job} --out {folder} makes what is not there");
            Log::text(false).notes(&Diagnostic::note(message).help(help).into());
        }
        Ok(samples)
    }

    fn wanted(&self) -> LayerSelection {
        if self.layers.is_empty() { LayerSelection::Usual } else { LayerSelection::These(self.layers.clone()) }
    }

    /// Refuses layers that a dataset was made without.
    fn check_layers(&self, dataset: &Recorded) -> Result<(), Failure> {
        let there = &dataset.job.output.layers;
        let missing: Vec<&str> =
            self.layers.iter().filter(|layer| !there.contains(layer)).map(|layer| layer.name()).collect();
        if missing.is_empty() {
            return Ok(());
        }
        let asked: Vec<&str> = self.layers.iter().map(|layer| layer.name()).collect();
        let shown: Vec<&str> = there.iter().filter(|layer| has_picture(**layer)).map(|layer| layer.name()).collect();
        let (job, out) = (shell_word(&self.source.join("job.toml")), shell_word(&self.out));
        let render = format!("its job renders others: gelsim preview {job} --layers {} --out {out}", asked.join(","));
        let help = if shown.is_empty() {
            format!("leave --layers out, for there are tactile images alone; {render}")
        } else {
            format!("there are --layers {}; {render}", shown.join(","))
        };
        let message = format!("{} was made without {}", self.source.display(), missing.join(", "));
        Err(user_error(message, help).into())
    }

    /// A sample's number, if there is one of it.
    fn checked_key(&self, key: u64, samples: u64) -> Result<u64, Failure> {
        if key < samples {
            return Ok(key);
        }
        let help = format!("samples are numbered 0 to {}", samples.saturating_sub(1));
        Err(user_error(format!("there is no sample {key}"), help).into())
    }
}

/// What to do where a file of a dataset is missing or damaged.
pub(super) fn unreadable_help(dataset: &Path) -> String {
    format!("gelsim verify {} names all that is wrong with the dataset, and what mends it", shell_word(dataset))
}

fn layer(name: &str) -> Result<OutputLayer, String> {
    let shown = || OutputLayer::ALL.into_iter().filter(|layer| has_picture(*layer)).map(OutputLayer::name);
    let all = || shown().collect::<Vec<_>>().join(", ");
    match OutputLayer::named(name) {
        Some(layer) if has_picture(layer) => Ok(layer),
        Some(_) => Err(format!("it has no picture; those that have one are {}", all())),
        None if name == "tactile" => Err(String::from("the tactile image is shown in any case: leave it out")),
        None => match nearest(name, shown()) {
            Some(meant) => Err(format!("did you mean {meant}? Layers with a picture are {}", all())),
            None => Err(format!("layers with a picture are {}", all())),
        },
    }
}

/// Encodes a picture as its name says, as PNG as small as that allows, and writes it completely.
fn write(path: &Path, picture: &RgbImage) -> Result<(), Failure> {
    /// Of 100.
    const QUALITY: u8 = 92;
    let is_png = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case(ENDINGS[0]));
    if is_png {
        return output_file::write(path, &encode_small(picture));
    }
    let mut bytes = Cursor::new(Vec::new());
    let encoded = JpegEncoder::new_with_quality(&mut bytes, QUALITY).encode_image(picture);
    encoded.map_err(|error| {
        let help = "write a PNG, or show less: fewer samples with --count, smaller ones with --panel";
        Failure::running_with(format!("{}: {error}", path.display()), help)
    })?;
    output_file::write(path, &bytes.into_inner())
}
