//! Tells jobs, recipes of `gelsim augment` and sensor files from each other, which all are TOML: one that was named in
//! place of another is one error, not one for each of its keys.

use gelsim_files::diagnostic::Diagnostic;

use super::document::TomlNode;

/// What a TOML file is for.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum FileKind {
    /// A job of `gelsim generate`.
    Job,
    /// A recipe of `gelsim augment`.
    Recipe,
    /// A sensor file, which holds the keys of `[sensor]`.
    Sensor,
}

/// Names at the top of a file that are found in files of this kind alone.
const MARKS: [(FileKind, &[&str]); 3] = [
    (FileKind::Job, &["dataset", "indentation", "sequence", "scene", "sensors", "gripper"]),
    (FileKind::Recipe, &["input", "photometric", "paired", "mixing"]),
    (FileKind::Sensor, &["preset", "resolution_px", "field_of_view_mm", "gelpad_thickness_mm", "led", "lamp"]),
];
/// Tables of jobs and recipes that no sensor file has.
const NOT_IN_SENSORS: [&str; 4] = ["sensor", "object", "pose", "output"];

impl FileKind {
    /// Returns the kind of the file with this root; `None` where it is uncertain.
    fn detect(root: &TomlNode) -> Option<Self> {
        let has = |names: &[&str]| names.iter().any(|name| root.child(name).is_some());
        let mut found = MARKS.iter().filter(|(_, names)| has(names)).map(|(kind, _)| *kind);
        let kind = found.next()?;
        let is_certain = found.next().is_none() && (kind != Self::Sensor || !has(&NOT_IN_SENSORS));
        is_certain.then_some(kind)
    }

    /// Returns the error if the file `name` with this root is of another kind than `self`.
    pub fn explain_other(self, root: &TomlNode, name: &str) -> Option<Diagnostic> {
        let found = Self::detect(root).filter(|found| *found != self)?;
        let help = match (self, found) {
            (Self::Sensor, _) => String::from(
                "a sensor file holds the keys of [sensor] themselves; gelsim list sensors shows the presets, which need no file",
            ),
            (_, Self::Sensor) => {
                String::from("name it in a job, under [sensor]: file = \"..\"; gelsim init writes a job to start from")
            }
            (_, Self::Job) => String::from("gelsim generate runs jobs; a recipe names a dataset: [input] with path"),
            (_, Self::Recipe) => String::from("gelsim augment runs it"),
        };
        Some(Diagnostic::new(format!("{name} is {}, not {}", found.describe(), self.describe())).help(help))
    }

    fn describe(self) -> &'static str {
        match self {
            Self::Job => "a job",
            Self::Recipe => "a recipe for gelsim augment",
            Self::Sensor => "a sensor file",
        }
    }
}
