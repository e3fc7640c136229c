//! The meaning of a real dataset's columns, and the facts that a label states about its sample.

use std::collections::{BTreeMap, HashMap};

use csv::StringRecord;
use serde_json::{Map, Value};

use crate::config;
use gelsim_files::diagnostic::Diagnostic;
use gelsim_files::spelling::find_nearest_name;
use gelsim_job::plan::check::JobChecker;

/// Meaning of a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColumnMeaning {
    /// Name of the object.
    Object,
    /// Class of the object.
    Class,
    /// Split of the sample.
    Split,
    /// Group of samples that stay together.
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
    /// Part y of the quaternion.
    QuaternionY,
    /// Part z of the quaternion.
    QuaternionZ,
    /// Part w of the quaternion.
    QuaternionW,
}

impl ColumnMeaning {
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

    /// Parts of the quaternion: x, y, z, w.
    const QUATERNION: [Self; 4] = [Self::QuaternionX, Self::QuaternionY, Self::QuaternionZ, Self::QuaternionW];

    /// Key in `[input.columns]`.
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

    /// Dotted path in a label written by gelsim. There, the position is that of the mesh's origin.
    fn own_label_path(self) -> &'static str {
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

    /// Name of the column that the file gives for this meaning.
    fn configured_column(self, columns: &config::Columns) -> Option<&String> {
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

/// Column of each meaning, in the order of [`ColumnMeaning::ALL`].
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ColumnMap([Option<String>; ColumnMeaning::ALL.len()]);

impl ColumnMap {
    /// Finds the columns in a first label. Columns that the file names must exist; others are taken if they have the
    /// usual names.
    pub fn resolve_columns(check: &mut JobChecker<'_>, written: &config::Columns, label: &SourceLabel<'_>) -> Self {
        Self(ColumnMeaning::ALL.map(|meaning| match meaning.configured_column(written) {
            Some(column) if label.has_column(column) => Some(column.clone()),
            Some(column) => {
                let near =
                    find_nearest_name(column, label.column_names()).map(|near| format!("did you mean `{near}`? "));
                let names: Vec<&str> = label.column_names().take(40).collect();
                let help = format!("{}columns of the labels: {}", near.unwrap_or_default(), names.join(", "));
                let key = format!("input.columns.{}", meaning.name());
                check.report_error(&key, format!("no column is called `{column}`"), help);
                None
            }
            None => {
                let own = label.is_own_label().then_some(meaning.own_label_path());
                let scalar =
                    |column: &&str| label.has_column(column) && !label.value(column).is_some_and(|v| is_nested(&v));
                [Some(meaning.name()), own].into_iter().flatten().find(scalar).map(str::to_owned)
            }
        }))
    }

    /// Returns the column with this meaning, if there is one.
    pub fn column_of(&self, meaning: ColumnMeaning) -> Option<&str> {
        self.0[meaning as usize].as_deref()
    }
}

fn is_nested(value: &Value) -> bool {
    value.is_object() || value.is_array()
}

/// Names of a table's columns, with an index by name.
pub struct TableHeader {
    /// Names in their order.
    pub names: Vec<String>,
    indices: HashMap<String, usize>,
}

impl TableHeader {
    /// Creates a header. Returns the number of a name that occurs twice as an error.
    pub fn new(names: Vec<String>) -> Result<Self, usize> {
        let mut numbers = HashMap::with_capacity(names.len());
        for (number, name) in names.iter().enumerate() {
            if numbers.insert(name.clone(), number).is_some() {
                return Err(number);
            }
        }
        Ok(Self { names, indices: numbers })
    }

    /// Number of a column.
    pub fn column_index(&self, name: &str) -> Option<usize> {
        self.indices.get(name).copied()
    }
}

/// A label in either form.
pub enum SourceLabel<'a> {
    /// Cells under the names of their columns.
    Cells(&'a TableHeader, &'a StringRecord),
    /// JSON.
    Json(&'a Map<String, Value>),
}

impl SourceLabel<'_> {
    /// Names of the columns.
    pub fn column_names(&self) -> Box<dyn Iterator<Item = &str> + '_> {
        match self {
            Self::Cells(header, _) => Box::new(header.names.iter().map(String::as_str)),
            Self::Json(map) => Box::new(map.keys().map(String::as_str)),
        }
    }

    /// Returns true if there is such a column.
    pub fn has_column(&self, column: &str) -> bool {
        match self {
            Self::Cells(header, _) => header.column_index(column).is_some(),
            Self::Json(map) => lookup(map, column).is_some(),
        }
    }

    /// Returns true for a label that gelsim wrote.
    pub fn is_own_label(&self) -> bool {
        matches!(self, Self::Json(map) if is_own_label(map))
    }

    /// Returns the value of a column; none if it is absent or empty.
    pub fn value(&self, column: &str) -> Option<Value> {
        match self {
            Self::Cells(header, cells) => {
                let cell = cells.get(header.column_index(column)?)?;
                (!cell.trim().is_empty()).then(|| Value::from(cell.trim()))
            }
            Self::Json(map) => lookup(map, column).filter(|value| !value.is_null()).cloned(),
        }
    }

    /// Returns the text in a column; numbers as they are written.
    pub fn text(&self, column: &str) -> Option<String> {
        match self.value(column)? {
            Value::String(text) => (!text.is_empty()).then_some(text),
            value => (!is_nested(&value)).then(|| value.to_string()),
        }
    }

    /// Returns the number in a column; its text as the error if it is none.
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

/// A mistake in the value of a column.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ColumnMistake {
    /// Name of the column.
    pub column: String,
    message: String,
    /// Common cause of many such mistakes, written after their number.
    cause: String,
    /// Value, if it says something.
    value: Option<String>,
    help: MistakeHelp,
}

/// What to do about a mistake, independent of the form of labels.
#[derive(Clone, Debug, PartialEq, Eq)]
enum MistakeHelp {
    /// Write a number.
    Number,
    /// Write the number with a decimal point.
    Point,
    /// Name a column for this part of the quaternion.
    Column(&'static str),
    /// Fill in these parts of the quaternion.
    Parts(Vec<String>),
    /// Write a quaternion that is not 0.
    Zero,
}

impl ColumnMistake {
    fn not_a_number(column: &str, value: String) -> Self {
        let with_point = value.matches(',').count() == 1 && value.replace(',', ".").trim().parse::<f64>().is_ok();
        Self {
            column: column.to_owned(),
            message: format!("`{column}`: `{value}` is no number"),
            cause: format!("values of `{column}` are no numbers"),
            value: Some(value),
            help: if with_point { MistakeHelp::Point } else { MistakeHelp::Number },
        }
    }

    fn incomplete_quaternion(column: &str, columns: &ColumnMap, parts: &[Option<f64>; 4]) -> Self {
        let absent = ColumnMeaning::QUATERNION.into_iter().find(|meaning| columns.column_of(*meaning).is_none());
        let empty = ColumnMeaning::QUATERNION.into_iter().zip(parts).filter(|(_, part)| part.is_none());
        let empty: Vec<String> =
            empty.filter_map(|(meaning, _)| columns.column_of(meaning)).map(str::to_owned).collect();
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

    /// Turns it into a diagnostic about the label of `sample`; `nothing` is how an absent value is written.
    pub fn into_diagnostic(self, sample: &str, nothing: &str) -> Diagnostic {
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
        Diagnostic::new(self.message).about(subject, self.cause).help(help)
    }
}

/// Returns true for a label that gelsim wrote.
pub fn is_own_label(label: &Map<String, Value>) -> bool {
    label.get("generator").and_then(Value::as_str).is_some_and(|made_by| made_by.starts_with("gelsim "))
}

/// Adds the numbers of the classes that a label of gelsim names. The first number of a class stays.
pub fn note_class_numbers(numbers: &mut BTreeMap<String, u64>, label: &Map<String, Value>) {
    if !is_own_label(label) {
        return;
    }
    let others = label.get("objects").and_then(Value::as_array).into_iter().flatten();
    for object in label.get("object").into_iter().chain(others) {
        let class = object.get("class").and_then(Value::as_str);
        let number = object.get("class_index").and_then(Value::as_u64);
        if let (Some(class), Some(number)) = (class, number.filter(|number| *number <= u64::from(u32::MAX))) {
            numbers.entry(class.to_owned()).or_insert(number);
        }
    }
}

/// Returns the value at a dotted path. A key that contains the dots itself comes first.
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

/// Sets the value at a dotted path. Missing objects on the way are created; other values on the way are left alone.
pub fn set_value(map: &mut Map<String, Value>, path: &str, value: Value) {
    if map.contains_key(path) || !path.contains('.') {
        map.insert(path.to_owned(), value);
        return;
    }
    let (first, rest) = path.split_once('.').unwrap_or((path, ""));
    put_value(map.entry(first).or_insert(Value::Null), rest, value);
}

fn put_value(node: &mut Value, path: &str, value: Value) {
    match node {
        Value::Object(map) => set_value(map, path, value),
        Value::Null => {
            let mut map = Map::new();
            set_value(&mut map, path, value);
            *node = Value::Object(map);
        }
        Value::Array(items) => {
            let (step, rest) = path.split_once('.').map_or((path, None), |(step, rest)| (step, Some(rest)));
            match (step.parse().ok().and_then(|index: usize| items.get_mut(index)), rest) {
                (Some(item), None) => *item = value,
                (Some(item), Some(rest)) => put_value(item, rest, value),
                _ => {}
            }
        }
        _ => {}
    }
}

/// Facts that a label states about its sample.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LabelFacts {
    /// Name of the object.
    pub object: Option<String>,
    /// Class of the object.
    pub class: Option<String>,
    /// Group of samples that stay together.
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
    /// Rotation from the object's axes to the sensor's as a quaternion x, y, z, w, not 0; replaces the angles.
    pub quaternion_xyzw: Option<[f64; 4]>,
    /// Whether gelsim pressed the object in another size than that of its mesh.
    pub is_scaled: bool,
}

impl LabelFacts {
    /// Reads the facts of a label, and its split. Calls `wrong` for each column that does not hold a number as it
    /// should.
    pub fn read(
        columns: &ColumnMap,
        label: &SourceLabel<'_>,
        mut wrong: impl FnMut(ColumnMistake),
    ) -> (Self, Option<String>) {
        let text = |meaning: ColumnMeaning| label.text(columns.column_of(meaning)?);
        let mut number = |meaning: ColumnMeaning| {
            let column = columns.column_of(meaning)?;
            label.number(column).unwrap_or_else(|value| {
                wrong(ColumnMistake::not_a_number(column, value));
                None
            })
        };
        let parts = ColumnMeaning::QUATERNION.map(&mut number);
        let facts = Self {
            object: text(ColumnMeaning::Object),
            class: text(ColumnMeaning::Class),
            group: text(ColumnMeaning::Group),
            depth_mm: number(ColumnMeaning::Depth),
            place_mm: [number(ColumnMeaning::X), number(ColumnMeaning::Y)],
            yaw_deg: number(ColumnMeaning::Yaw),
            tilt_deg: number(ColumnMeaning::Tilt),
            tilt_azimuth_deg: number(ColumnMeaning::TiltAzimuth),
            quaternion_xyzw: match parts {
                [Some(x), Some(y), Some(z), Some(w)] if [x, y, z, w] != [0.0; 4] => Some([x, y, z, w]),
                _ => None,
            },
            is_scaled: label.is_own_label() && matches!(label.number("object.scale"), Ok(Some(scale)) if scale != 1.0),
        };
        let column = ColumnMeaning::QUATERNION.into_iter().find_map(|meaning| columns.column_of(meaning));
        if let Some(column) = column.filter(|_| facts.quaternion_xyzw.is_none() && parts.iter().any(Option::is_some)) {
            wrong(ColumnMistake::incomplete_quaternion(column, columns, &parts));
        }
        (facts, text(ColumnMeaning::Split))
    }

    /// Name that counts as the class: the class, or the object if no class is known.
    pub fn class_or_object(&self) -> Option<&str> {
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
            set_value(&mut changed, path, Value::from(9));
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
