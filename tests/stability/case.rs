//! One named case, as the job that a user would write for it.

use std::fmt;
use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::time::Instant;

use gelsim_core::fidelity::{Fidelity, Models};
use gelsim_core::gelpad::Model;
use gelsim_core::gelpad::gaussian::Gaussian;
use gelsim_core::gelpad::no_deformation::NoDeformation;
use gelsim_files::diagnostic::Diagnostics;
use gelsim_job::config::{self, Overrides};
use gelsim_job::plan::Plan;

use super::sound::{self, Figures};
use gelsim_oracle::shapes::{Format, Shape};

/// What a sample wears.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dress {
    /// The defaults.
    Plain,
    /// Every effect that is the same in every sample, run everywhere.
    Still,
    /// All of that under near LEDs, with a camera that differs from sample to sample and is noisy.
    Noisy,
}

/// How much of a case is tried: large ones cost too much for all of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Extent {
    /// Every model of the pad in every dress.
    All,
    /// The cheapest levels in every dress.
    Cheap,
    /// The cheapest level with an elastic pad, plain.
    Once,
    /// The job's own model of the pad in every dress.
    Own,
}

/// In how many of a case's samples something touches.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Touches {
    All,
    Some,
    None,
}

/// A hard case.
#[derive(Clone)]
pub struct Case {
    /// As in docs/evidence/stability-cases.md.
    pub name: &'static str,
    /// What could go wrong.
    pub trouble: &'static str,
    px: [u32; 2],
    mm_per_px: [f64; 2],
    thickness_mm: f64,
    poisson_ratio: f64,
    depth_mm: f64,
    shape: Shape,
    format: Format,
    set: Vec<String>,
    files: Vec<(&'static str, Vec<u8>)>,
    refused: Option<&'static str>,
    extent: Extent,
    touches: Touches,
    unsolved: bool,
}

impl Case {
    /// A ball on a pad of 3 mm, 48 x 36 pixels of 0.4 mm.
    pub fn new(name: &'static str, trouble: &'static str) -> Self {
        Self {
            name,
            trouble,
            px: [48, 36],
            mm_per_px: [0.4; 2],
            thickness_mm: 3.0,
            poisson_ratio: 0.48,
            depth_mm: 0.6,
            shape: Shape::ball(4.0, 32, 16),
            format: Format::Obj,
            set: Vec::new(),
            files: Vec::new(),
            refused: None,
            extent: Extent::All,
            touches: Touches::All,
            unsolved: false,
        }
    }

    pub fn depth(self, depth_mm: f64) -> Self {
        Self { depth_mm, ..self }
    }

    pub fn shape(self, shape: Shape) -> Self {
        Self { shape, ..self }
    }

    pub fn format(self, format: Format) -> Self {
        Self { format, ..self }
    }

    pub fn pad(self, thickness_mm: f64, poisson_ratio: f64) -> Self {
        Self { thickness_mm, poisson_ratio, ..self }
    }

    pub fn view(self, px: [u32; 2], mm_per_px: [f64; 2]) -> Self {
        Self { px, mm_per_px, ..self }
    }

    /// A key of the job, as `--set` takes it. `MODEL` is the dress's model of the light, `FOLDER` where its files are.
    pub fn set(mut self, assignment: impl Into<String>) -> Self {
        self.set.push(assignment.into());
        self
    }

    /// A file beside the job.
    pub fn file(mut self, name: &'static str, bytes: Vec<u8>) -> Self {
        self.files.push((name, bytes));
        self
    }

    /// The job must be refused, in these words.
    pub fn refused(self, words: &'static str) -> Self {
        Self { refused: Some(words), ..self }
    }

    pub fn extent(self, extent: Extent) -> Self {
        Self { extent, ..self }
    }

    /// In how many samples something touches, if not in all.
    pub fn touches(self, touches: Touches) -> Self {
        Self { touches, ..self }
    }

    /// The solver must give up, and say so.
    pub fn unsolved(self) -> Self {
        Self { unsolved: true, extent: Extent::Own, ..self }
    }

    /// The plan, or what the user would be told instead.
    pub fn plan(&self, dress: Dress) -> Result<Plan, String> {
        let folder = tempfile::tempdir().expect("a folder that can be written");
        let mesh = format!("object.{}", self.format.extension());
        fs::write(folder.path().join(&mesh), self.shape.encode(self.format)).expect("a folder that can be written");
        for (name, bytes) in &self.files {
            fs::write(folder.path().join(name), bytes).expect("a folder that can be written");
        }
        let model = if dress == Dress::Noisy { "led" } else { "phong" };
        let beside = folder.path().to_string_lossy();
        let written = |line: &String| line.replace("MODEL", model).replace("FOLDER", &beside);
        let set = self.set.iter().map(|line| (String::from("--set"), written(line))).collect();
        let overrides = Overrides { set, fidelity: None };
        let job = self.job(&mesh) + &self.dressing(dress);
        resolve(job, folder.path(), &overrides)
    }

    fn job(&self, mesh: &str) -> String {
        let ([width, height], [dx, dy]) = (self.px, self.mm_per_px);
        format!(
            "dataset = {{ name = 'stability', samples = 1, seed = 11 }}\n\
             sensor.resolution_px = [{width}, {height}]\n\
             sensor.field_of_view_mm = [{:?}, {:?}]\n\
             sensor.gelpad_thickness_mm = {:?}\n\
             sensor.gelpad_poisson_ratio = {:?}\n\
             object = [{{ path = '{mesh}' }}]\n\
             pose.anchor = 'origin'\n\
             indentation.depth_mm = {:?}\n\
             output.exr.pixel = 'float'\n",
            f64::from(width) * dx,
            f64::from(height) * dy,
            self.thickness_mm,
            self.poisson_ratio,
            self.depth_mm,
        )
    }

    /// Every effect, as strong as it is in use and in proportion to the view.
    fn dressing(&self, dress: Dress) -> String {
        let layers = "'depth', 'surface', 'contact', 'normal', 'pressure', 'reference'";
        if dress == Dress::Plain {
            return format!("output.layers = [{layers}]\n");
        }
        let ([width, height], [dx, dy]) = (self.px, self.mm_per_px);
        let diagonal = (f64::from(width) * dx).hypot(f64::from(height) * dy);
        let (fine, push) = (dx.min(dy), (0.05 * self.thickness_mm).min(4.0 * dx.min(dy)).min(10.0));
        let always = format!(
            "output.layers = [{layers}, 'markers']\n\
             effects = 'all'\n\
             texture = {{ amplitude_mm = {:?}, scale_mm = {:?} }}\n\
             sensor.rest_shape.dome.radius_mm = {:?}\n\
             sensor.grain = {{ height_um = 1.0, size_mm = {:?} }}\n\
             markers = {{ pitch_mm = {:?}, diameter_mm = {:?}, jitter_mm = {:?}, edge_mm = {:?} }}\n\
             shear = {{ x_mm = {:?}, y_mm = {:?}, twist_deg = 3.0, friction = {{ coulomb = {{ coefficient = 0.5 }} }} }}\n\
             camera.distortion_k1 = 0.05\n\
             camera.vignette = 0.3\n\
             camera.defocus_mm = {:?}\n\
             camera.red_gain = 0.9\n",
            0.05 * self.depth_mm.min(10.0),
            (6.0 * fine).max(1e-3),
            (50.0 * diagonal).min(1e6),
            (4.0 * fine).max(1e-3),
            (8.0 * fine).max(0.05),
            (3.0 * fine).min(100.0),
            (0.5 * fine).min(100.0),
            (0.5 * fine).min(10.0),
            push,
            -0.5 * push,
            (1.2 * fine).min(1.0),
        );
        always
            + match dress {
                Dress::Noisy => {
                    "optics.led = {}\n\
                     camera.distortion_k2 = [0.0, 0.02]\n\
                     camera.exposure = [0.8, 1.2]\n\
                     camera.blue_gain = [0.9, 1.1]\n\
                     camera.shot_noise_levels = 2.0\n\
                     camera.read_noise_levels = 1.0\n\
                     camera.noise_correlation = 0.5\n\
                     camera.speckle_levels = 2.0\n"
                }
                Dress::Plain | Dress::Still => "camera.exposure = 1.1\n",
            }
    }

    fn dresses(&self) -> &'static [Dress] {
        match self.extent {
            Extent::All | Extent::Cheap | Extent::Own => &[Dress::Plain, Dress::Still, Dress::Noisy],
            Extent::Once => &[Dress::Plain],
        }
    }

    /// True of one case in ten, and of all where all is to be tried.
    fn has_finite_strain(&self) -> bool {
        let number = super::all().position(|case| case.name == self.name);
        crate::thorough() || number.is_none_or(|number| number % 10 == 0)
    }

    /// The plan at every level, and with the models of the pad that no level has. Unless all is to be tried, effects without
    /// noise are at one level alone, and finite strain, a hundred times as slow as the others, with noise alone in one case
    /// of ten.
    fn variants(&self, plan: &Plan, dress: Dress) -> Vec<(&'static str, Plan)> {
        let with = |gelpad| plan.with_models(Models { gelpad, optics: plan.simulator.models().optics.clone() });
        let levels: &[Fidelity] = match self.extent {
            Extent::All => &Fidelity::ALL,
            Extent::Cheap => &[Fidelity::Paper, Fidelity::Draft],
            Extent::Once => &[Fidelity::Draft],
            Extent::Own => &[],
        };
        let levels = levels.iter().filter(|level| match (dress, level) {
            _ if crate::thorough() => true,
            (Dress::Plain, level) => **level != Fidelity::FiniteStrain,
            (Dress::Still, level) => **level == Fidelity::Draft,
            (Dress::Noisy, Fidelity::FiniteStrain) => self.has_finite_strain(),
            (Dress::Noisy, _) => true,
        });
        let mut variants: Vec<_> = levels.map(|level| (level.name(), plan.with_fidelity(*level))).collect();
        if self.extent == Extent::Own {
            variants.push(("its own", with(plan.simulator.models().gelpad.clone())));
        }
        if self.extent == Extent::All && (dress != Dress::Still || crate::thorough()) {
            variants.push(("none", with(Model::None(NoDeformation {}))));
            variants.push(("gaussian", with(Model::Gaussian(Gaussian::default()))));
        }
        variants
    }

    /// Tries everything; what was seen, or everything that is wrong.
    fn run(&self) -> Result<Figures, Vec<String>> {
        let (mut figures, mut wrong) = (Figures::default(), Vec::new());
        for dress in self.dresses() {
            let what = format!("{}, {dress:?}", self.name);
            let plan = match (self.plan(*dress), self.refused) {
                (Ok(plan), None) => plan,
                (Ok(_), Some(words)) => {
                    wrong.push(format!("{what}: not refused with `{words}`"));
                    continue;
                }
                (Err(said), Some(words)) if said.contains(words) => continue,
                (Err(said), _) => {
                    wrong.push(format!("{what}: refused: {said}"));
                    continue;
                }
            };
            for (level, plan) in self.variants(&plan, *dress) {
                let start = Instant::now();
                let outcome = catch_unwind(AssertUnwindSafe(|| sound::check(&plan)));
                match outcome {
                    Ok(Ok(one)) => figures.add(&one, start.elapsed()),
                    Ok(Err(text)) => wrong.push(format!("{what}, {level}: {text}")),
                    Err(_) => wrong.push(format!("{what}, {level}: panicked")),
                }
            }
        }
        let Figures { samples, touching, unsolved, .. } = figures;
        let expected = match self.touches {
            Touches::All => touching == samples,
            Touches::Some => touching > 0 && touching < samples,
            Touches::None => touching == 0,
        };
        if !expected && wrong.is_empty() {
            wrong.push(format!("{}: {touching} of {samples} samples touch, not {:?}", self.name, self.touches));
        }
        if self.unsolved && unsolved != samples {
            wrong.push(format!("{}: {unsolved} of {samples} samples say that they are unsolved", self.name));
        }
        if wrong.is_empty() { Ok(figures) } else { Err(wrong) }
    }
}

impl fmt::Debug for Case {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, px, mm_per_px, thickness_mm, poisson_ratio, depth_mm, shape, set, .. } = self;
        let faces = shape.triangles.len();
        write!(
            f,
            "{name}, {px:?} px of {mm_per_px:?} mm, pad {thickness_mm} mm, nu {poisson_ratio}, depth {depth_mm} mm, "
        )?;
        write!(f, "{faces} triangles, {set:?}")
    }
}

/// Runs a case and prints a line of figures for it; fails with everything that is wrong.
pub fn run(case: &Case) -> Figures {
    match case.run() {
        Ok(figures) => {
            match case.refused {
                Some(words) => println!("| {} | {} | refused: {words} |", case.name, case.trouble),
                None => println!("| {} | {} | {figures} |", case.name, case.trouble),
            }
            figures
        }
        Err(wrong) => panic!("{} findings:\n{}", wrong.len(), wrong.join("\n")),
    }
}

fn resolve(job: String, folder: &Path, overrides: &Overrides) -> Result<Plan, String> {
    let mut problems = Diagnostics::default();
    let written = config::read_job_text("job", job, folder, overrides, &mut problems);
    Plan::resolve(written, problems).map_err(|report| report.to_string())
}
