//! What the columns of a real dataset's labels mean, and what a label says of its sample.

use std::collections::HashMap;

use csv::StringRecord;
use serde_json::{Map, Value};

use crate::config;
use gelsim_files::diagnostic::Diagnostic;
use gelsim_files::spelling::nearest;
use gelsim_job::plan::check::Check;

/// A meaning that a column may have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Meaning {
    /// Name of the object.
    Object,
    /// Its class.
    Class,
    /// Split of the sample.
    Split,
    /// What stays together.
    Group,
    /// Indentation depth, mm.
    Depth,
    /// Position along x, mm.
    X,
    /// Position along y, mm.
    Y,
    /// Turn about z, degrees.
    Yaw,
    /// Tilt, degrees.
    Tilt,
    /// Direction of the tilt's axis, degrees.
    TiltAzimuth,
    /// Part x of the rotation's quaternion.
    QuaternionX,
    /// Part y.
    QuaternionY,
    /// Part z.
    QuaternionZ,
    /// Part w.
    QuaternionW,
}

impl Meaning {
    /// Every meaning, in the order of the enum.
    pub const ALL: [Self; 14] = [
        Self::Object,
        Self::Class,
        Self::Split,
        Self::Group,
        Self::Depth,
        Self::X,
        Self::Y,
        Self::Yaw,
        Self::Tilt,
        Self::TiltAzimuth,
        Self::QuaternionX,
        Self::QuaternionY,
        Self::QuaternionZ,
        Self::QuaternionW,
    ];

    /// The parts of a quaternion x, y, z, w.
    const QUATERNION: [Self; 4] = [Self::QuaternionX, Self::QuaternionY, Self::QuaternionZ, Self::QuaternionW];

    /// Its key in `[input.columns]`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Object => "object",
            Self::Class => "class",
            Self::Split => "split",
            Self::Group => "group",
            Self::Depth => "depth_mm",
            Self::X => "x_mm",
            Self::Y => "y_mm",
            Self::Yaw => "yaw_deg",
            Self::Tilt => "tilt_deg",
            Self::TiltAzimuth => "tilt_azimuth_deg",
            Self::QuaternionX => "quaternion_x",
            Self::QuaternionY => "quaternion_y",
            Self::QuaternionZ => "quaternion_z",
            Self::QuaternionW => "quaternion_w",
        }
    }

    /// Where a label of gelsim's own has it. The place is that of the mesh's origin.
    fn of_label(self) -> &'static str {
        match self {
            Self::Object => "object.id",
            Self::Class => "object.class",
            Self::Split => "split",
            Self::Group => "group",
            Self::Depth => "indentation_depth_mm",
            Self::X => "pose.translation_mm.0",
            Self::Y => "pose.translation_mm.1",
            Self::Yaw => "pose.yaw_deg",
            Self::Tilt => "pose.tilt_deg",
            Self::TiltAzimuth => "pose.tilt_azimuth_deg",
            Self::QuaternionX => "pose.quaternion_xyzw.0",
            Self::QuaternionY => "pose.quaternion_xyzw.1",
            Self::QuaternionZ => "pose.quaternion_xyzw.2",
            Self::QuaternionW => "pose.quaternion_xyzw.3",
        }
    }

    fn written(self, columns: &config::Columns) -> Option<&String> {
        match self {
            Self::Object => columns.object.as_ref(),
            Self::Class => columns.class.as_ref(),
            Self::Split => columns.split.as_ref(),
            Self::Group => columns.group.as_ref(),
            Self::Depth => columns.depth_mm.as_ref(),
            Self::X => columns.x_mm.as_ref(),
            Self::Y => columns.y_mm.as_ref(),
            Self::Yaw => columns.yaw_deg.as_ref(),
            Self::Tilt => columns.tilt_deg.as_ref(),
            Self::TiltAzimuth => columns.tilt_azimuth_deg.as_ref(),
            Self::QuaternionX => columns.quaternion_x.as_ref(),
            Self::QuaternionY => columns.quaternion_y.as_ref(),
            Self::QuaternionZ => columns.quaternion_z.as_ref(),
            Self::QuaternionW => columns.quaternion_w.as_ref(),
        }
    }
}

/// The column of each meaning, in the order of [`Meaning::ALL`].
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ColumnMap([Option<String>; Meaning::ALL.len()]);

impl ColumnMap {
    /// Finds the columns in a first label: those that are written must be there; the others are, if they have the usual
    /// names.
    pub fn find(check: &mut Check<'_>, written: &config::Columns, label: &SourceLabel<'_>) -> Self {
        Self(Meaning::ALL.map(|meaning| match meaning.written(written) {
            Some(column) if label.has(column) => Some(column.clone()),
            Some(column) => {
                let near = nearest(column, label.names()).map(|near| format!("did you mean `{near}`? "));
                let names: Vec<&str> = label.names().take(40).collect();
                let help = format!("{}columns of the labels: {}", near.unwrap_or_default(), names.join(", "));
                let key = format!("input.columns.{}", meaning.name());
                check.error(&key, format!("no column is called `{column}`"), help);
                None
            }
            None => {
                let own = label.own().then_some(meaning.of_label());
                let scalar = |column: &&str| label.has(column) && !label.value(column).is_some_and(|v| nested(&v));
                [Some(meaning.name()), own].into_iter().flatten().find(scalar).map(str::to_owned)
            }
        }))
    }

    /// The column that has this meaning.
    pub fn name(&self, meaning: Meaning) -> Option<&str> {
        self.0[meaning as usize].as_deref()
    }
}

fn nested(value: &Value) -> bool {
    value.is_object() || value.is_array()
}

/// Names of a table's columns, found by name however many they are.
pub struct Header {
    /// The names, in their order.
    pub names: Vec<String>,
    numbers: HashMap<String, usize>,
}

impl Header {
    /// Of names in their order; the number of one that is there twice is another error.
    pub fn new(names: Vec<String>) -> Result<Self, usize> {
        let mut numbers = HashMap::with_capacity(names.len());
        for (number, name) in names.iter().enumerate() {
            if numbers.insert(name.clone(), number).is_some() {
                return Err(number);
            }
        }
        Ok(Self { names, numbers })
    }

    /// The number of a column.
    pub fn number(&self, name: &str) -> Option<usize> {
        self.numbers.get(name).copied()
    }
}

/// A label, whatever form it has.
pub enum SourceLabel<'a> {
    /// Cells under names.
    Cells(&'a Header, &'a StringRecord),
    /// JSON.
    Json(&'a Map<String, Value>),
}

impl SourceLabel<'_> {
    /// Names of its columns.
    pub fn names(&self) -> Box<dyn Iterator<Item = &str> + '_> {
        match self {
            Self::Cells(header, _) => Box::new(header.names.iter().map(String::as_str)),
            Self::Json(map) => Box::new(map.keys().map(String::as_str)),
        }
    }

    /// True if it has a column.
    pub fn has(&self, column: &str) -> bool {
        match self {
            Self::Cells(header, _) => header.number(column).is_some(),
            Self::Json(map) => lookup(map, column).is_some(),
        }
    }

    /// True of a label that gelsim wrote.
    pub fn own(&self) -> bool {
        matches!(self, Self::Json(map) if is_own(map))
    }

    /// The value of a column, if there is one.
    pub fn value(&self, column: &str) -> Option<Value> {
        match self {
            Self::Cells(header, cells) => {
                let cell = cells.get(header.number(column)?)?;
                (!cell.trim().is_empty()).then(|| Value::from(cell.trim()))
            }
            Self::Json(map) => lookup(map, column).filter(|value| !value.is_null()).cloned(),
        }
    }

    /// The text in a column; numbers as they are written.
    pub fn text(&self, column: &str) -> Option<String> {
        match self.value(column)? {
            Value::String(text) => (!text.is_empty()).then_some(text),
            value => (!nested(&value)).then(|| value.to_string()),
        }
    }

    /// The number in a column; the text of it if there is something else.
    pub fn number(&self, column: &str) -> Result<Option<f64>, String> {
        let Some(value) = self.value(column).filter(|value| value.as_str() != Some("")) else { return Ok(None) };
        let number = match &value {
            Value::Number(number) => number.as_f64(),
            Value::String(text) => text.parse().ok(),
            _ => None,
        };
        let shown = || value.as_str().map_or_else(|| value.to_string(), str::to_owned);
        number.filter(|number| number.is_finite()).map(Some).ok_or_else(shown)
    }
}

/// What is wrong with the value of a column.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mistake {
    /// The column.
    pub column: String,
    message: String,
    /// What is true of many such, behind their number.
    cause: String,
    /// The value, if it tells something.
    value: Option<String>,
    help: MistakeHelp,
}

/// What to do about it, as far as that does not depend on how labels are written.
#[derive(Clone, Debug, PartialEq, Eq)]
enum MistakeHelp {
    /// A number belongs there.
    Number,
    /// A number belongs there, with a point.
    Point,
    /// A quaternion needs a column for this part.
    Column(&'static str),
    /// Parts of a quaternion that are empty.
    Parts(Vec<String>),
    /// All of them are 0.
    Zero,
}

impl Mistake {
    fn number(column: &str, value: String) -> Self {
        let with_point = value.matches(',').count() == 1 && value.replace(',', ".").trim().parse::<f64>().is_ok();
        Self {
            column: column.to_owned(),
            message: format!("`{column}`: `{value}` is no number"),
            cause: format!("values of `{column}` are no numbers"),
            value: Some(value),
            help: if with_point { MistakeHelp::Point } else { MistakeHelp::Number },
        }
    }

    fn quaternion(column: &str, columns: &ColumnMap, parts: &[Option<f64>; 4]) -> Self {
        let absent = Meaning::QUATERNION.into_iter().find(|meaning| columns.name(*meaning).is_none());
        let empty = Meaning::QUATERNION.into_iter().zip(parts).filter(|(_, part)| part.is_none());
        let empty: Vec<String> = empty.filter_map(|(meaning, _)| columns.name(meaning)).map(str::to_owned).collect();
        let help = match (absent, empty.is_empty()) {
            (Some(absent), _) => MistakeHelp::Column(absent.name()),
            (None, false) => MistakeHelp::Parts(empty),
            (None, true) => MistakeHelp::Zero,
        };
        let cause = match help {
            MistakeHelp::Zero => format!("quaternions (`{column}` and others) are 0"),
            _ => format!("quaternions (`{column}` and others) lack a part"),
        };
        let message = format!("`{column}`: a quaternion has four parts, not all of them 0");
        Self { column: column.to_owned(), message, cause, value: None, help }
    }

    /// The mistake in the label of `sample`; `nothing` is what is written where there is no value.
    pub fn of_sample(self, sample: &str, nothing: &str) -> Diagnostic {
        let help = match self.help {
            MistakeHelp::Number => format!("write a number without its unit, or {nothing}"),
            MistakeHelp::Point => String::from("write numbers with a point: 1.5"),
            MistakeHelp::Column(absent) => format!(
                "a column for {absent} is needed, too: name it with input.columns.{absent}; without a quaternion rename the \
                 column `{}`",
                self.column
            ),
            MistakeHelp::Parts(empty) => {
                let parts = empty.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ");
                format!("write the parts that are not there ({parts}), or {nothing} in all four")
            }
            MistakeHelp::Zero => {
                format!("write the four parts of the turn (0, 0, 0, 1 for none), or {nothing} in all four")
            }
        };
        let subject = match self.value {
            Some(value) => format!("{sample} ({value})"),
            None => sample.to_owned(),
        };
        Diagnostic::new(self.message).of(subject, self.cause).help(help)
    }
}

/// True of a label that gelsim wrote.
pub fn is_own(label: &Map<String, Value>) -> bool {
    label.get("generator").and_then(Value::as_str).is_some_and(|made_by| made_by.starts_with("gelsim "))
}

/// The value at a dotted path; a key with dots in it comes first.
pub fn lookup<'a>(map: &'a Map<String, Value>, path: &str) -> Option<&'a Value> {
    if let Some(value) = map.get(path) {
        return Some(value);
    }
    let mut steps = path.split('.');
    let mut value = map.get(steps.next()?)?;
    for step in steps {
        value = match value {
            Value::Object(map) => map.get(step)?,
            Value::Array(items) => items.get(step.parse::<usize>().ok()?)?,
            _ => return None,
        };
    }
    Some(value)
}

/// Sets the value at a dotted path. Tables on the way are made where there is nothing; what else stands in the way stays.
pub fn set(map: &mut Map<String, Value>, path: &str, value: Value) {
    if map.contains_key(path) || !path.contains('.') {
        map.insert(path.to_owned(), value);
        return;
    }
    let (first, rest) = path.split_once('.').unwrap_or((path, ""));
    put(map.entry(first).or_insert(Value::Null), rest, value);
}

fn put(node: &mut Value, path: &str, value: Value) {
    match node {
        Value::Object(map) => set(map, path, value),
        Value::Null => {
            let mut map = Map::new();
            set(&mut map, path, value);
            *node = Value::Object(map);
        }
        Value::Array(items) => {
            let (step, rest) = path.split_once('.').map_or((path, None), |(step, rest)| (step, Some(rest)));
            match (step.parse().ok().and_then(|index: usize| items.get_mut(index)), rest) {
                (Some(item), None) => *item = value,
                (Some(item), Some(rest)) => put(item, rest, value),
                _ => {}
            }
        }
        _ => {}
    }
}

/// What a label says of its sample.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LabelFacts {
    /// Name of the object.
    pub object: Option<String>,
    /// Its class.
    pub class: Option<String>,
    /// What stays together.
    pub group: Option<String>,
    /// Indentation depth, mm.
    pub depth_mm: Option<f64>,
    /// Position along x and y, mm from the middle of the image.
    pub place_mm: [Option<f64>; 2],
    /// Turn about z, degrees.
    pub yaw_deg: Option<f64>,
    /// Tilt, degrees.
    pub tilt_deg: Option<f64>,
    /// Direction of the tilt's axis, degrees.
    pub tilt_azimuth_deg: Option<f64>,
    /// Rotation from the object's axes to the sensor's as a quaternion x, y, z, w, not 0; in place of the angles.
    pub quaternion_xyzw: Option<[f64; 4]>,
}

impl LabelFacts {
    /// Reads a label, and its split; `wrong` is told each column that holds something else than a number.
    pub fn read(
        columns: &ColumnMap,
        label: &SourceLabel<'_>,
        mut wrong: impl FnMut(Mistake),
    ) -> (Self, Option<String>) {
        let text = |meaning: Meaning| label.text(columns.name(meaning)?);
        let mut number = |meaning: Meaning| {
            let column = columns.name(meaning)?;
            label.number(column).unwrap_or_else(|value| {
                wrong(Mistake::number(column, value));
                None
            })
        };
        let parts = Meaning::QUATERNION.map(&mut number);
        let facts = Self {
            object: text(Meaning::Object),
            class: text(Meaning::Class),
            group: text(Meaning::Group),
            depth_mm: number(Meaning::Depth),
            place_mm: [number(Meaning::X), number(Meaning::Y)],
            yaw_deg: number(Meaning::Yaw),
            tilt_deg: number(Meaning::Tilt),
            tilt_azimuth_deg: number(Meaning::TiltAzimuth),
            quaternion_xyzw: match parts {
                [Some(x), Some(y), Some(z), Some(w)] if [x, y, z, w] != [0.0; 4] => Some([x, y, z, w]),
                _ => None,
            },
        };
        let column = Meaning::QUATERNION.into_iter().find_map(|meaning| columns.name(meaning));
        if let Some(column) = column.filter(|_| facts.quaternion_xyzw.is_none() && parts.iter().any(Option::is_some)) {
            wrong(Mistake::quaternion(column, columns, &parts));
        }
        (facts, text(Meaning::Split))
    }

    /// What it is counted as: its class, or the object where no class is known.
    pub fn kind(&self) -> Option<&str> {
        self.class.as_deref().or(self.object.as_deref())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map(text: &str) -> Map<String, Value> {
        serde_json::from_str(text).expect("JSON")
    }

    #[test]
    fn dotted_paths_reach_into_tables_and_lists_and_a_key_with_dots_comes_first() {
        let label = map(r#"{"a":{"b":[1,{"c":2}],"d.e":3},"x.y":4,"x":{"y":5}}"#);
        let number = |path: &str| lookup(&label, path).and_then(Value::as_i64);
        assert_eq!(["a.b.0", "a.b.1.c", "x.y"].map(number), [Some(1), Some(2), Some(4)]);
        assert_eq!(["a.b.2", "a.c", "x.y.z", "b"].map(number), [None; 4]);
        let mut changed = label.clone();
        for path in ["a.b.1.c", "x.y", "new.deep", "top"] {
            set(&mut changed, path, Value::from(9));
            assert_eq!(lookup(&changed, path), Some(&Value::from(9)), "{path}");
        }
        assert_eq!(changed["x"]["y"], 5);
    }

    #[test]
    fn numbers_may_be_written_as_text_and_anything_else_is_named() {
        let label = map(r#"{"a":"0.5","b":2,"c":"deep","d":null,"e":""}"#);
        let label = SourceLabel::Json(&label);
        assert_eq!(label.number("a"), Ok(Some(0.5)));
        assert_eq!(label.number("b"), Ok(Some(2.0)));
        assert_eq!(label.number("d"), Ok(None));
        assert_eq!((label.number("missing"), label.number("e")), (Ok(None), Ok(None)));
        assert_eq!(label.number("c"), Err(String::from("deep")));
        assert_eq!((label.text("b"), label.text("e")), (Some(String::from("2")), None));
    }
}
