//! `gelsim preview`

use std::path::{Path, PathBuf};

use clap::Args;
use image::RgbImage;
use rayon::prelude::*;

use super::guesses::whole;
use super::store::{folder_only, local_output};
use super::{Failure, JobOverrides, Log, settled};
use crate::core::effects::Effect;
use crate::dataset::recorded::Recorded;
use crate::files::diagnostic::user_error;
use crate::files::write::write_output;
use crate::job::plan::Plan;
use crate::job::probe::foresee;
use crate::lab::preview::effects::{self, EffectComparison, compare};
use crate::lab::preview::{Tile, animation, sample_files, sheet};

/// Draw a contact sheet: tactile image, depth and (where there is one) contact, with class and depth under each. Or show
/// what each effect changes in a job's samples.
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  gelsim preview configs/quickstart.toml --out sheet.png
  gelsim preview out/quickstart --out sample.png --key 42
  gelsim preview configs/effects.toml --effects --out effects.png
  gelsim preview configs/slip.toml --key 0 --apng --out slip.png")]
pub struct Preview {
    /// A dataset's folder, or a job whose samples are rendered on the spot
    #[arg(value_name = "DIR|JOB.toml")]
    source: PathBuf,
    /// The picture to write
    #[arg(short, long, value_name = "FILE.png", value_parser = local_output())]
    out: PathBuf,
    /// Only this sample, at full size unless --panel says otherwise
    #[arg(long, value_name = "K", value_parser = whole::<u64>)]
    key: Option<u64>,
    /// For each effect that a job's samples call for, one of them with the effect, without it, and the difference
    #[arg(long, conflicts_with_all = ["count", "columns"])]
    effects: bool,
    /// An animated PNG of the frames of the sequence that --key names
    #[arg(long, requires = "key", conflicts_with_all = ["effects", "count", "columns", "panel"])]
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

impl Preview {
    pub(super) fn run(self) -> Result<(), Failure> {
        folder_only(&self.source, "preview")?;
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
        let files = match self.source.is_dir() {
            true => {
                let dataset = Recorded::open(&self.source)?;
                let [index] = self.indices(dataset.layout.samples(), true)?[..] else { return Ok(()) };
                dataset.sample(index).map_err(Failure::running)?
            }
            false => {
                let plan = self.plan()?;
                if plan.job().sequence.is_none() {
                    let message = "--apng shows a sequence, and this job's samples are none";
                    return Err(user_error(message, "leave --apng out, or add a [sequence] table").into());
                }
                let [index] = self.indices(plan.layout.samples(), false)?[..] else { return Ok(()) };
                sample_files(&plan, index)
            }
        };
        let bytes = animation(&files).map_err(Failure::running)?;
        write_output(&self.out, &bytes).map_err(|error| Failure::running(format!("{}: {error}", self.out.display())))
    }

    fn plan(&self) -> Result<Plan, Failure> {
        let plan = settled(Plan::load(&self.source, &self.overrides.overrides())?, None, Log::text(false))?;
        self.overrides.note(&foresee(&plan).notes, Log::text(false))?;
        Ok(plan)
    }

    /// What the effects change in the sample asked for, or in the first ones of the job.
    fn comparisons(&self) -> Result<Vec<EffectComparison>, Failure> {
        /// Samples that are searched for effects.
        const SEARCHED: u64 = 100;
        if self.source.is_dir() {
            let folder = self.source.display();
            let message = format!("--effects renders a job's samples anew, and {folder} is a folder");
            return Err(user_error(message, format!("if it is a dataset, preview its job: {folder}/job.toml")).into());
        }
        let plan = self.plan()?;
        plan.of_presses("--effects")?;
        let samples = plan.layout.samples();
        let indices = match self.key {
            Some(_) => self.indices(samples, false)?,
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

    fn job_tiles(&self) -> Result<Vec<Tile>, Failure> {
        let plan = self.plan()?;
        let indices = self.indices(plan.layout.samples(), false)?;
        Ok(indices.par_iter().map(|&index| Tile::rendered(&plan, index)).collect())
    }

    fn dataset_tiles(&self) -> Result<Vec<Tile>, Failure> {
        if self.overrides.any() {
            let message = "--samples, --seed, --fidelity and --set change a job, not a dataset that is there";
            return Err(user_error(message, "leave them out, or preview the job").into());
        }
        let dataset = Recorded::open(&self.source)?;
        let indices = self.indices(dataset.layout.samples(), true)?;
        let tiles = indices.par_iter().map(|&index| Tile::read(&dataset.sample(index)?));
        tiles.collect::<Result<_, _>>().map_err(|reason: String| Failure::running(reason))
    }

    /// The samples to show: the one asked for, the first of a job, or some spread over a dataset.
    fn indices(&self, samples: u64, spread: bool) -> Result<Vec<u64>, Failure> {
        if let Some(key) = self.key {
            if key >= samples {
                let help = format!("samples are numbered 0 to {}", samples.saturating_sub(1));
                return Err(user_error(format!("there is no sample {key}"), help).into());
            }
            return Ok(vec![key]);
        }
        let count = self.count.clamp(1, samples.max(1));
        Ok((0..count).map(|i| if spread { i * samples / count } else { i }).collect())
    }
}

/// Encodes a picture as small as PNG allows and writes it completely.
fn write(path: &Path, picture: &RgbImage) -> Result<(), Failure> {
    let failed = |error: &dyn std::fmt::Display| Failure::running(format!("{}: {error}", path.display()));
    let bytes = crate::files::png::encode_small(picture);
    write_output(path, &bytes).map_err(|error| failed(&error))
}
