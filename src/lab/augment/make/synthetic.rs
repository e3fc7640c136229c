//! Makes new samples of a job among the real ones.

use std::path::Path;

use serde::Serialize;

use super::{SampleMaker, json_to_text, stats_of_image, to_thumbnail};
use crate::AugmentError;
use crate::input::{LabelFormat, RealSample};
use crate::output::OutputSample;
use crate::output::labels::SyntheticSample;
use crate::report::SampleEntry;
use crate::trace::{Source, Trace};
use gelsim_dataset::archive::Member;
use gelsim_dataset::encode::{encode_members, to_json_line};
use gelsim_files::image_file;
use gelsim_files::number_format::format_number;
use gelsim_job::sample::AcceptedSample;
use gelsim_job::sample::RejectedSample;
use gelsim_job::sample::accept_sample;
use gelsim_job::scene::Scene;

/// How a synthetic sample was made, for its label.
#[derive(Serialize)]
struct SyntheticTrace<'a> {
    job: &'a str,
    fingerprint: &'a str,
    seed: u64,
    index: u64,
    attempt: u32,
}

impl SampleMaker<'_> {
    /// Makes sample `index` of the job. It joins the split and the unit of the real sample `beside`, which has the
    /// number `number`.
    pub(super) fn make_synthetic_sample(
        &self,
        beside: &RealSample,
        number: usize,
        index: u64,
        on_page: bool,
    ) -> Result<(OutputSample, SampleEntry), AugmentError> {
        let (set, division) = (&self.recipe.set, &self.recipe.division);
        let Some(mix) = &self.recipe.mix else {
            return Err(AugmentError::Sample(String::from("no job is there for a synthetic sample")));
        };
        let AcceptedSample { sample, .. } = accept_sample(&mix.plan, index).map_err(|RejectedSample(label)| {
            AugmentError::Unhealthy(format!(
                "sample {} of the job is not healthy: {}",
                label.header.key, label.health.reason
            ))
        })?;
        let split = division.split_of_real[number];
        let form = &set.units[beside.unit].form;
        let drawn = SyntheticTrace {
            job: mix.plan.name(),
            fingerprint: &mix.plan.fingerprint,
            seed: mix.plan.seed(),
            index,
            attempt: sample.label.header.attempt,
        };
        let augmentation = json_to_text(to_json_line(&drawn));
        let mut trace = Trace { source: Source::Synthetic, source_key: String::new(), augmentation };
        let key = format!("synthetic-{index:09}");
        let placed = self.units.place_synthetic_image(beside, split, &sample.label.header.object.class, &key);
        trace.fill_for_csv(form, &placed.name);
        let mut files = encode_members(&mix.plan, &sample);
        files.retain(|member| member.suffix != "json");
        let mut piece = OutputSample { unit: beside.unit, split, key: key.clone(), ..OutputSample::default() };
        let mut columns = Vec::new();
        for Member { suffix, bytes } in files {
            let bytes = bytes.into_vec().expect("of a press nothing is spooled");
            let tactile = suffix == "tactile.png";
            if *form == LabelFormat::Tar {
                if tactile {
                    let failed = |reason: String| AugmentError::Sample(format!("{key}: {reason}"));
                    let image = if image_file::is_of_format(&bytes, &set.image_column) {
                        bytes
                    } else {
                        image_file::encode_as(&set.image_column, &sample.impression.image).map_err(failed)?
                    };
                    piece.tar_files.push(Member::new(set.image_column.as_str(), image));
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
        let scene = Scene::draw(&mix.plan, index, sample.label.header.attempt);
        let made = SyntheticSample { key: &key, label: &sample.label, place_mm: scene.motion.about_mm, files: columns };
        let label = self.labels.encode_synthetic_label(form, &made, &division.names[split], &placed.name, &trace);
        match form {
            LabelFormat::Tar => piece.tar_files.push(Member::new(set.label_suffix.as_str(), label)),
            _ => piece.row = label,
        }
        let by_class = set.reals.iter().any(|real| real.facts.class.is_some());
        let object = &sample.label.header.object;
        let depth = format_number(sample.label.indentation_depth_mm);
        let split_name = &division.names[split];
        let comma = if split_name.is_empty() { "" } else { ", " };
        let caption = format!("{}\n{depth} mm deep{comma}{split_name}", object.class);
        let entry = SampleEntry {
            source: Source::Synthetic,
            split,
            kind: Some(if by_class { object.class.clone() } else { object.id.clone() }),
            depth_mm: Some(sample.label.indentation_depth_mm),
            image_stats: stats_of_image(&sample.impression.image),
            number,
            tile: on_page.then(|| (to_thumbnail(&sample.impression.image), caption)),
            pair: None,
        };
        Ok((piece, entry))
    }
}
