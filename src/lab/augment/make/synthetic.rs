//! New samples of a job among the real ones.

use std::path::Path;

use serde::Serialize;

use super::{Maker, image_stats, small, text};
use crate::AugmentError;
use crate::input::{Form, Real};
use crate::output::Piece;
use crate::output::labels::Synthetic;
use crate::output::pictures::{encode_as, is_of_format};
use crate::report::SampleEntry;
use crate::trace::{Source, Trace};
use gelsim_dataset::archive::Member;
use gelsim_dataset::encode::{json, members};
use gelsim_files::figures::figure;
use gelsim_job::sample::Accepted;
use gelsim_job::sample::Unfit;
use gelsim_job::sample::accept;
use gelsim_job::scene::Scene;

/// What was done for a synthetic sample.
#[derive(Serialize)]
struct Drawn<'a> {
    job: &'a str,
    fingerprint: &'a str,
    seed: u64,
    index: u64,
    attempt: u32,
}

impl Maker<'_> {
    /// Sample `index` of the job, in the split of the real sample number `number`, and beside it.
    pub(super) fn synthetic(
        &self,
        beside: &Real,
        number: usize,
        index: u64,
        on_page: bool,
    ) -> Result<(Piece, SampleEntry), AugmentError> {
        let (set, division) = (&self.recipe.set, &self.recipe.division);
        let Some(mix) = &self.recipe.mix else {
            return Err(AugmentError::Sample(String::from("no job is there for a synthetic sample")));
        };
        let Accepted { sample, .. } = accept(&mix.plan, index).map_err(|Unfit(label)| {
            AugmentError::Unhealthy(format!(
                "sample {} of the job is not healthy: {}",
                label.header.key, label.health.reason
            ))
        })?;
        let split = division.of_reals[number];
        let form = &set.units[beside.unit].form;
        let drawn = Drawn {
            job: mix.plan.name(),
            fingerprint: &mix.plan.fingerprint,
            seed: mix.plan.seed(),
            index,
            attempt: sample.label.header.attempt,
        };
        let trace = Trace { source: Source::Synthetic, source_key: String::new(), augmentation: text(json(&drawn)) };
        let key = format!("synthetic-{index:09}");
        let placed = self.units.synthetic(beside, split, &sample.label.header.object.class, &key);
        let mut files = members(&mix.plan, &sample);
        files.retain(|member| member.suffix != "json");
        let mut piece = Piece { unit: beside.unit, split, key: key.clone(), ..Piece::default() };
        let mut columns = Vec::new();
        for Member { suffix, bytes } in files {
            let bytes = bytes.into_vec().expect("of a press nothing is spooled");
            let tactile = suffix == "tactile.png";
            if *form == Form::Tar {
                if tactile {
                    let failed = |reason: String| AugmentError::Sample(format!("{key}: {reason}"));
                    let image = if is_of_format(&bytes, &set.image) {
                        bytes
                    } else {
                        encode_as(&set.image, &sample.impression.image).map_err(failed)?
                    };
                    piece.tar_files.push(Member::new(set.image.as_str(), image));
                } else if self.columns.contains(&suffix) {
                    piece.tar_files.push(Member::new(suffix, bytes));
                }
                continue;
            }
            if tactile {
                piece.files.push((placed.file.clone(), bytes));
                continue;
            }
            let layer = suffix.split('.').next().unwrap_or_default();
            let (as_image, as_path) = (format!("{layer}_image_file_name"), format!("{layer}_path"));
            let file = placed.file.with_extension(&suffix);
            match (self.columns.contains(&as_image), self.columns.contains(&as_path)) {
                (true, _) => {
                    columns.push((
                        as_image,
                        Path::new(&placed.name).with_extension(&suffix).to_string_lossy().into_owned(),
                    ));
                }
                (_, true) => columns.push((as_path, file.to_string_lossy().into_owned())),
                _ => continue,
            }
            piece.files.push((file, bytes));
        }
        let name = if *form == Form::Tar { &key } else { &placed.name };
        let scene = Scene::draw(&mix.plan, index, sample.label.header.attempt);
        let made = Synthetic { label: &sample.label, place_mm: scene.motion.about_mm, files: columns };
        let label = self.labels.synthetic(form, &made, &division.names[split], name, &trace);
        match form {
            Form::Tar => piece.tar_files.push(Member::new(set.label.as_str(), label)),
            _ => piece.row = label,
        }
        let by_class = set.reals.iter().any(|real| real.facts.class.is_some());
        let object = &sample.label.header.object;
        let depth = figure(sample.label.indentation_depth_mm);
        let split_name = &division.names[split];
        let comma = if split_name.is_empty() { "" } else { ", " };
        let caption = format!("{}\n{depth} mm deep{comma}{split_name}", object.class);
        let entry = SampleEntry {
            source: Source::Synthetic,
            split,
            kind: Some(if by_class { object.class.clone() } else { object.id.clone() }),
            depth_mm: Some(sample.label.indentation_depth_mm),
            image_stats: image_stats(&sample.impression.image),
            number,
            tile: on_page.then(|| (small(&sample.impression.image), caption)),
            pair: None,
        };
        Ok((piece, entry))
    }
}
