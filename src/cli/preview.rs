//! `gelsim preview`: draws samples of a dataset or of a job.

use std::io::Cursor;
use std::path::{Path, PathBuf};

use clap::Args;
use image::RgbImage;
use image::codecs::jpeg::JpegEncoder;
use rayon::prelude::*;

use super::guesses::{parse_count, parse_whole_number};
use super::store::{local_path_parser, require_local_folder};
use super::{Failure, JobOverrides, Log, output_file, settle_fidelity};
use gelsim_core::effects::Effect;
use gelsim_dataset::recorded::RecordedDataset;
use gelsim_files::diagnostic::{Diagnostic, Report, user_error};
use gelsim_files::png::encode_small;
use gelsim_files::spelling::{find_nearest_name, quote_for_shell};
use gelsim_job::layers::OutputLayer;
use gelsim_job::plan::Plan;
use gelsim_job::probe::preview_job;
use gelsim_lab::preview::choice::{SampleChoice, choose_spread_samples};
use gelsim_lab::preview::effects::{self, EffectComparison, compare_effect_images};
use gelsim_lab::preview::film::encode_animation;
use gelsim_lab::preview::panel::has_picture;
use gelsim_lab::preview::{LayerSelection, Tile, draw_tile_sheet, make_sample_files};

mod server;
mod watch;

/// Draw a contact sheet: tactile image, depth and contact mask, or the layers that are named, with class, depth and
/// split below each. Of a dataset, every split and class has its share of the sheet. Or show what each effect changes
/// in a job's samples.
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  gelsim preview configs/quickstart.toml --out sheet.png
  gelsim preview out/quickstart --out sample.png --key 42
  gelsim preview configs/gallery.toml --layers normal,pressure --out layers.png
  gelsim preview configs/effects.toml --effects --out effects.png
  gelsim preview configs/slip.toml --key 0 --apng --out slip.png
  gelsim preview configs/quickstart.toml --watch")]
pub struct Preview {
    /// A dataset's folder, or a job whose samples are rendered on the spot
    #[arg(value_name = "DIR|JOB.toml")]
    source: PathBuf,
    /// The picture to write: PNG, or JPEG if its name ends in .jpg
    #[arg(short, long, value_name = "FILE.png", value_parser = local_path_parser(), required_unless_present = "watch")]
    out: Option<PathBuf>,
    /// Show the sheet in a browser at the address that is printed, and again whenever the job or one of its files
    /// changes. Only this machine can open it, and nothing is written
    #[arg(long, conflicts_with_all = ["out", "effects", "apng", "columns", "panel"])]
    watch: bool,
    /// Port of that address [default: a free one]
    #[arg(long, value_name = "PORT", requires = "watch", conflicts_with = "out", value_parser = clap::value_parser!(u16).range(1..))]
    port: Option<u16>,
    /// Draw only this sample, at full size unless --panel says otherwise
    #[arg(long, value_name = "K", value_parser = parse_whole_number::<u64>)]
    key: Option<u64>,
    /// Layers to show beside the tactile image, or below it for a sequence: those of a dataset, or any of a job
    /// [default: depth, contact; none for sequences]
    #[arg(long, value_name = "LAYER,..", value_delimiter = ',', value_parser = parse_layer)]
    layers: Vec<OutputLayer>,
    /// For each effect that a job's samples enable, show one of them with the effect, without it, and the difference
    #[arg(long, conflicts_with_all = ["count", "columns", "layers"])]
    effects: bool,
    /// Write an animated PNG of the frames of the sequence that --key names
    #[arg(long, requires = "key", conflicts_with_all = ["effects", "count", "columns", "panel", "layers"])]
    apng: bool,
    /// How many samples the sheet shows
    #[arg(long, value_name = "N", default_value_t = 12, value_parser = parse_count::<u64>, conflicts_with = "key")]
    count: u64,
    /// Width of one panel of the sheet, px [default: 240; of effects 658; with --key full size]
    #[arg(long, value_name = "PX", value_parser = parse_count::<u32>)]
    panel: Option<u32>,
    /// Columns of the sheet
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = parse_count::<usize>)]
    columns: usize,
    #[command(flatten)]
    overrides: JobOverrides,
}

/// Endings of pictures' names; an animation has the first one.
const ENDINGS: [&str; 3] = ["png", "jpg", "jpeg"];

impl Preview {
    pub(super) fn run(self) -> Result<(), Failure> {
        require_local_folder(&self.source, "preview")?;
        if self.watch {
            return watch::watch_job(&self);
        }
        let (endings, example) = if self.apng { (&ENDINGS[..1], "film.png") } else { (&ENDINGS[..], "sheet.png") };
        output_file::check_output_path(self.out(), endings, example)?;
        let panel = |default: u32| self.panel.unwrap_or(default);
        if self.effects {
            return write_picture(
                self.out(),
                &effects::draw_effect_sheet(&self.compare_effects()?, panel(effects::WIDEST_PANEL)),
            );
        }
        if self.apng {
            return self.write_animation();
        }
        let tiles = if self.source.is_dir() { self.read_dataset_tiles()? } else { self.render_job_tiles()? };
        let picture = match self.key {
            Some(_) => draw_tile_sheet(&tiles, 1, panel(u32::MAX)),
            None => draw_tile_sheet(&tiles, self.columns, panel(240)),
        };
        write_picture(self.out(), &picture)
    }

    /// The picture to write, which is missing with --watch alone.
    fn out(&self) -> &Path {
        self.out.as_deref().unwrap_or(Path::new(""))
    }

    /// Writes the frames of a sequence as an animated PNG.
    fn write_animation(&self) -> Result<(), Failure> {
        let key = self.key.unwrap_or_default();
        let still = |what: &str| -> Failure {
            let message = format!("--apng shows a sequence, and {what} none");
            let help = format!(
                "leave --apng out: gelsim preview {} --key {key} --out {}",
                quote_for_shell(&self.source),
                quote_for_shell(self.out())
            );
            user_error(message, help).into()
        };
        let film = if self.source.is_dir() {
            let dataset = self.open_dataset()?;
            if dataset.job.sequence.is_none() {
                return Err(still("the samples of this dataset are"));
            }
            self.check_key(key, dataset.layout.sample_count())?;
            let film = dataset.read_sample(key).and_then(|files| encode_animation(&files));
            film.map_err(|reason| self.unreadable_failure(reason))?
        } else {
            let plan = self.load_plan()?;
            if plan.job().sequence.is_none() {
                return Err(still("the samples of this job are"));
            }
            self.check_key(key, plan.layout.sample_count())?;
            encode_animation(&make_sample_files(&plan, key)).map_err(Failure::runtime)?
        };
        output_file::write_whole_file(self.out(), &film.ok_or_else(|| still("this sample is"))?)
    }

    /// Reads the job, and prints what the user should know of it.
    fn load_plan(&self) -> Result<Plan, Failure> {
        let plan = self.read_plan()?;
        self.overrides.report_notes(&preview_job(&plan).notes, Log::plain_text(false))?;
        Log::plain_text(false).print_notes(&plan.note_one_of_sensors());
        Ok(plan)
    }

    fn read_plan(&self) -> Result<Plan, Failure> {
        let mut overrides = self.overrides.to_overrides();
        if !self.layers.is_empty() {
            let names: Vec<String> = self.layers.iter().map(|layer| format!("\"{}\"", layer.name())).collect();
            overrides.set.push((String::from("--layers"), format!("output.layers = [{}]", names.join(", "))));
        }
        settle_fidelity(Plan::load(&self.source, &overrides)?, None, Log::plain_text(false))
    }

    /// Finds what the user should know of a job.
    fn find_notes(&self, plan: &Plan) -> Report {
        preview_job(plan).notes.merged_with(plan.note_one_of_sensors())
    }

    /// Opens the dataset. Fails if there are flags that only change a job.
    fn open_dataset(&self) -> Result<RecordedDataset, Failure> {
        let flags = self.overrides.given_flags();
        if !flags.is_empty() {
            let verb = if flags.len() == 1 { "changes" } else { "change" };
            let message = format!("{} {verb} a job, not a dataset that is there", flags.join(", "));
            let job = quote_for_shell(&self.source.join("job.toml"));
            let help = format!("leave {} out, or preview the dataset's job: {job}", flags.join(", "));
            return Err(user_error(message, help).into());
        }
        Ok(RecordedDataset::open(&self.source)?)
    }

    /// Returns the failure of a dataset of which a file is missing or damaged.
    fn unreadable_failure(&self, reason: String) -> Failure {
        Failure::runtime_with_help(reason, unreadable_help(&self.source))
    }

    /// Returns what the effects change in the sample asked for, or in the first samples of the job.
    fn compare_effects(&self) -> Result<Vec<EffectComparison>, Failure> {
        /// Samples that are searched for effects.
        const SEARCHED: u64 = 100;
        if self.source.is_dir() {
            RecordedDataset::open(&self.source)?;
            let message = format!("--effects renders a job's samples anew, and {} is a dataset", self.source.display());
            let (job, out) = (quote_for_shell(&self.source.join("job.toml")), quote_for_shell(self.out()));
            let help = format!("preview the job that it was made by: gelsim preview {job} --effects --out {out}");
            return Err(user_error(message, help).into());
        }
        let plan = self.load_plan()?;
        plan.require_single_presses("--effects")?;
        let samples = plan.layout.sample_count();
        let indices = match self.key {
            Some(key) => vec![self.check_key(key, samples)?],
            None => (0..samples.min(SEARCHED)).collect(),
        };
        let found = compare_effect_images(&plan, &indices);
        let missing = Effect::ALL.into_iter().filter(|effect| found.iter().all(|row| row.effect != *effect));
        let names: Vec<&str> = missing.map(Effect::name).collect();
        let of = match indices.as_slice() {
            [only] => format!("sample {only}"),
            several => format!("samples 0 to {}", several.len() - 1),
        };
        if found.is_empty() {
            return Err(user_error(format!("{of}: no effect is enabled"), "preview the job without --effects").into());
        }
        if !names.is_empty() {
            Log::plain_text(false).print_note(&format!("{of}: not enabled: {}", names.join(", ")));
        }
        Ok(found)
    }

    /// Renders samples of a job: the one asked for, or the first ones.
    fn render_job_tiles(&self) -> Result<Vec<Tile>, Failure> {
        let plan = self.load_plan()?;
        let indices = self.choose_job_samples(&plan)?;
        let wanted = self.layer_selection();
        let tiles = indices.par_iter().map(|&index| Tile::render_sample(&plan, index, &wanted)).collect();
        Failure::check_meshes(&plan)?;
        Ok(tiles)
    }

    /// Chooses samples of a job: the one asked for, or the first ones.
    fn choose_job_samples(&self, plan: &Plan) -> Result<Vec<u64>, Failure> {
        let samples = plan.layout.sample_count();
        Ok(match self.key {
            Some(key) => vec![self.check_key(key, samples)?],
            None => (0..self.count.min(samples)).collect(),
        })
    }

    /// Reads samples of a dataset: the one asked for, or some of every split and class.
    fn read_dataset_tiles(&self) -> Result<Vec<Tile>, Failure> {
        let dataset = self.open_dataset()?;
        self.check_layers(&dataset)?;
        let indices = match self.key {
            Some(key) => vec![self.check_key(key, dataset.layout.sample_count())?],
            None => self.choose_samples(&dataset)?,
        };
        let wanted = self.layer_selection();
        let tiles = indices.par_iter().map(|&index| Tile::from_files(&dataset.read_sample(index)?, &wanted));
        tiles.collect::<Result<_, _>>().map_err(|reason: String| self.unreadable_failure(reason))
    }

    /// Chooses samples of every split and class from the shards that exist, and notes the shards that are missing.
    fn choose_samples(&self, dataset: &RecordedDataset) -> Result<Vec<u64>, Failure> {
        let SampleChoice { samples, missing } =
            choose_spread_samples(dataset, self.count).map_err(|reason| self.unreadable_failure(reason))?;
        if let Some(first) = missing.first() {
            let all = dataset.layout.shard_count();
            let message = match missing.len() {
                1 => format!("1 of {all} shards is not there: {}", first.name()),
                count => format!("{count} of {all} shards are not there, {} the first of them", first.name()),
            };
            if samples.is_empty() {
                return Err(self.unreadable_failure(message));
            }
            let (job, folder) = (quote_for_shell(&self.source.join("job.toml")), quote_for_shell(&self.source));
            let help = format!("gelsim generate {job} --out {folder} makes what is not there");
            Log::plain_text(false).print_notes(&Diagnostic::note(message).help(help).into());
        }
        Ok(samples)
    }

    fn layer_selection(&self) -> LayerSelection {
        if self.layers.is_empty() { LayerSelection::Usual } else { LayerSelection::These(self.layers.clone()) }
    }

    /// Fails if layers are named that the dataset does not have.
    fn check_layers(&self, dataset: &RecordedDataset) -> Result<(), Failure> {
        let recorded = &dataset.job.output.layers;
        let missing: Vec<&str> =
            self.layers.iter().filter(|layer| !recorded.contains(layer)).map(|layer| layer.name()).collect();
        if missing.is_empty() {
            return Ok(());
        }
        let asked: Vec<&str> = self.layers.iter().map(|layer| layer.name()).collect();
        let shown: Vec<&str> = recorded.iter().filter(|layer| has_picture(**layer)).map(|layer| layer.name()).collect();
        let (job, out) = (quote_for_shell(&self.source.join("job.toml")), quote_for_shell(self.out()));
        let render = format!("its job renders others: gelsim preview {job} --layers {} --out {out}", asked.join(","));
        let help = if shown.is_empty() {
            format!("leave --layers out, for the dataset has only tactile images; {render}")
        } else {
            format!("there are --layers {}; {render}", shown.join(","))
        };
        let message = format!("{} was made without {}", self.source.display(), missing.join(", "));
        Err(user_error(message, help).into())
    }

    /// Returns a sample's number. Fails if there is no such sample.
    fn check_key(&self, key: u64, samples: u64) -> Result<u64, Failure> {
        if key < samples {
            return Ok(key);
        }
        let help = format!("samples are numbered 0 to {}", samples.saturating_sub(1));
        Err(user_error(format!("there is no sample {key}"), help).into())
    }
}

/// Returns the advice for a dataset of which a file is missing or damaged.
pub(super) fn unreadable_help(dataset: &Path) -> String {
    format!("gelsim verify {} names all that is wrong with the dataset, and how to fix it", quote_for_shell(dataset))
}

fn parse_layer(name: &str) -> Result<OutputLayer, String> {
    let shown = || OutputLayer::ALL.into_iter().filter(|layer| has_picture(*layer)).map(OutputLayer::name);
    let all = || shown().collect::<Vec<_>>().join(", ");
    match OutputLayer::from_name(name) {
        Some(layer) if has_picture(layer) => Ok(layer),
        Some(_) => Err(format!("it has no picture; those that have one are {}", all())),
        None if name == "tactile" => Err(String::from("the tactile image is shown in any case: leave it out")),
        None => match find_nearest_name(name, shown()) {
            Some(meant) => Err(format!("did you mean {meant}? Layers with a picture are {}", all())),
            None => Err(format!("layers with a picture are {}", all())),
        },
    }
}

/// Encodes a picture as the ending of its name says, a PNG as small as possible, and writes it completely.
fn write_picture(path: &Path, picture: &RgbImage) -> Result<(), Failure> {
    /// Of JPEG, of 100.
    const QUALITY: u8 = 92;
    let is_png = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case(ENDINGS[0]));
    if is_png {
        return output_file::write_whole_file(path, &encode_small(picture));
    }
    let mut bytes = Cursor::new(Vec::new());
    let encoded = JpegEncoder::new_with_quality(&mut bytes, QUALITY).encode_image(picture);
    encoded.map_err(|error| {
        let help = "write a PNG, or show less: fewer samples with --count, smaller ones with --panel";
        Failure::runtime_with_help(format!("{}: {error}", path.display()), help)
    })?;
    output_file::write_whole_file(path, &bytes.into_inner())
}
