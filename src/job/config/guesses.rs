//! What people write who have not read the docs, and what they mean: other programs' keys and values, values of another kind.
//!
//! A guess that is known beats the nearest spelling: `leds` is as near to `lens` as to `led`. Targets are checked against what
//! is known where the guess stands, so that none is advised where it is an error.

use super::document::{Entry, Node, Value};
use crate::layers::OutputLayer;
use gelsim_files::spelling::{nearest, one_of};

/// What somebody means by a key.
enum Means {
    /// This key of the same table.
    Key(&'static str),
    /// Something that is said elsewhere.
    Elsewhere(&'static str),
}

use Means::{Elsewhere, Key};

/// Keys that are guessed, in lower case with `_` between words, and what they mean: the first of these that fits the table.
const KEYS: &[(&[&str], &[Means])] = &[
    (
        &["background_image", "background_path", "background_file", "bg", "bg_image", "reference_image"],
        &[Key("background"), Elsewhere("under [sensor]: background = \"untouched.png\"")],
    ),
    (
        &["leds", "lights", "light", "lighting", "led_list", "illumination"],
        &[
            Elsewhere(
                "each LED is a table of its own, [[sensor.led]], in a sensor file [[led]], with azimuth_deg, elevation_deg and color",
            ),
            Key("led"),
        ],
    ),
    (
        &["variation", "randomize", "randomise", "randomization", "randomisation", "domain_randomization", "jitter"],
        &[
            Key("variation"),
            Elsewhere(
                "[sensor.unit] variation = 0.5 draws another unit of the sensor for each sample; other quantities take [min, max]",
            ),
        ],
    ),
    (
        &["dir", "out", "out_dir", "output_dir", "output_path", "folder", "root", "save_dir", "destination"],
        &[Key("path"), Elsewhere("--out DIR on the command line says where a dataset goes")],
    ),
    (
        &["type", "model", "kind", "sensor", "sensor_type", "sensor_name", "sensor_model"],
        &[Key("preset"), Elsewhere("under [sensor]: preset = \"digit\"")],
    ),
    (
        &[
            "mesh",
            "mesh_path",
            "mesh_file",
            "file_path",
            "filename",
            "file_name",
            "file",
            "obj",
            "stl",
            "source",
            "uri",
            "url",
            "meshes",
        ],
        &[Key("path"), Elsewhere("under [[object]]: path = \"my-part.stl\"")],
    ),
    (
        &["noise", "noise_level", "noise_std", "sensor_noise", "image_noise", "gaussian_noise"],
        &[Key("read_noise_levels"), Elsewhere("under [camera]: read_noise_levels = 2.0, in grey levels")],
    ),
    (
        &["yaw", "rz_deg", "rz", "rotation", "rotation_deg", "angle", "angle_deg", "theta", "orientation"],
        &[Key("yaw_deg"), Elsewhere("under [pose]: yaw_deg = 90.0 about the pad's normal, and face = \"-z\"")],
    ),
    (
        &["gel", "pad", "elastomer", "skin", "material", "gelpad_params"],
        &[Elsewhere(
            "under [sensor]: gelpad_thickness_mm and gelpad_youngs_modulus_kpa; of a soft object youngs_modulus_kpa under [[object]]",
        )],
    ),
    (&["rx_deg", "rx", "roll"], &[Key("roll_deg")]),
    (&["ry_deg", "ry", "pitch"], &[Key("pitch_deg"), Key("pitch_mm")]),
    (&["tilt"], &[Key("tilt_deg")]),
    (
        &["x", "dx", "x_offset", "x_offset_mm", "tx", "pos_x"],
        &[Key("x_mm"), Elsewhere("under [pose]: x_mm = [-2.0, 2.0]")],
    ),
    (
        &["y", "dy", "y_offset", "y_offset_mm", "ty", "pos_y"],
        &[Key("y_mm"), Elsewhere("under [pose]: y_mm = [-2.0, 2.0]")],
    ),
    (
        &[
            "z",
            "z_mm",
            "dz",
            "tz",
            "depth",
            "indentation_depth",
            "indentation_depth_mm",
            "penetration",
            "penetration_mm",
            "press_depth",
            "indentation_mm",
        ],
        &[Key("depth_mm"), Elsewhere("under [indentation]: depth_mm = [0.2, 1.0], from the undeformed pad")],
    ),
    (
        &["force", "force_n", "normal_force", "force_newton"],
        &[
            Key("force_n"),
            Elsewhere(
                "a press is given by its depth, and its force is in the label; by force are given phases of a sequence ([[sequence.phase]] force_n) and grips ([gripper] force_n)",
            ),
        ],
    ),
    (
        &[
            "n",
            "num",
            "count",
            "number",
            "num_samples",
            "n_samples",
            "number_of_samples",
            "size",
            "length",
            "images",
            "num_images",
        ],
        &[Key("samples"), Key("resolution_px"), Key("length_mm"), Elsewhere("under [dataset]: samples = 1000")],
    ),
    (&["random_seed", "rng_seed", "rng", "random_state"], &[Key("seed"), Elsewhere("under [dataset]: seed = 7")]),
    (&["shard_size", "samples_per_tar", "shards", "maxcount"], &[Key("samples_per_shard")]),
    (
        &["split", "split_ratio", "train_split", "train_val_test", "train_fraction", "ratios"],
        &[Key("splits"), Key("split")],
    ),
    (
        &[
            "resolution",
            "image_size",
            "img_size",
            "width",
            "height",
            "shape_px",
            "size_px",
            "res",
            "image_resolution",
            "camera_resolution",
            "sensor_resolution",
            "width_px",
            "height_px",
        ],
        &[Key("resolution_px"), Elsewhere("under [sensor]: resolution_px = [320, 240]")],
    ),
    (
        &["fov", "field_of_view", "fov_mm", "view_mm", "sensor_size", "sensor_size_mm", "size_mm", "area_mm"],
        &[Key("field_of_view_mm"), Key("length_mm")],
    ),
    (
        &["mm_per_pixel", "pixmm", "pixel_size", "pixel_size_mm", "px_size", "mm_px"],
        &[
            Key("mm_per_px"),
            Elsewhere("pixels have the size field_of_view_mm / resolution_px: field_of_view_mm = [width, height]"),
        ],
    ),
    (
        &["thickness", "thickness_mm", "gel_thickness", "gelpad_thickness", "gel_thickness_mm", "elastomer_thickness"],
        &[Key("gelpad_thickness_mm")],
    ),
    (
        &[
            "youngs_modulus",
            "young_modulus",
            "elastic_modulus",
            "stiffness",
            "stiffness_kpa",
            "modulus",
            "e",
            "youngs_modulus_pa",
            "youngs_modulus_kpa",
        ],
        &[Key("youngs_modulus_kpa"), Key("gelpad_youngs_modulus_kpa")],
    ),
    (&["poisson", "nu", "poissons_ratio", "poisson_ratio"], &[Key("poisson_ratio"), Key("gelpad_poisson_ratio")]),
    (&["mu", "friction_coefficient", "coefficient_of_friction"], &[Key("friction"), Key("coefficient")]),
    (&["unit_scale", "units", "mesh_unit"], &[Key("unit")]),
    (&["size_scale", "scaling", "scale_factor", "mesh_scale"], &[Key("scale")]),
    (
        &["longest_side", "longest_side_mm", "target_size", "target_size_mm", "normalize", "normalise"],
        &[Key("length_mm")],
    ),
    (&["label", "category", "class_name", "object_class"], &[Key("class")]),
    (&["probability", "prob", "p", "frequency"], &[Key("weight")]),
    (&["outputs", "channels", "maps", "annotations", "modalities"], &[Key("layers")]),
    (&["format", "file_format", "output_format", "writer", "storage"], &[Key("container"), Key("depth_format")]),
    (&["compress", "exr_compression"], &[Key("compression"), Key("exr")]),
    (&["colour", "rgb"], &[Key("color")]),
    (&["azimuth", "phi"], &[Key("azimuth_deg")]),
    (&["elevation", "altitude"], &[Key("elevation_deg")]),
    (&["brightness", "power", "strength"], &[Key("intensity"), Key("exposure")]),
    (&["lower", "low", "minimum", "from", "a"], &[Key("min")]),
    (&["upper", "high", "maximum", "to", "b"], &[Key("max")]),
    (&["mu_mm", "average", "loc"], &[Key("mean")]),
    (&["sd", "sigma", "stddev", "std_dev"], &[Key("std")]),
    (&["spacing", "spacing_mm", "distance_mm", "pitch"], &[Key("pitch_mm")]),
    (&["radius_mm", "dot_size", "dot_size_mm", "diameter"], &[Key("diameter_mm")]),
    (&["fps", "frame_rate", "framerate", "hz", "rate_hz"], &[Key("frame_rate_hz")]),
    (&["phases", "steps", "motion", "trajectory"], &[Key("phase")]),
    (&["duration", "time_s", "seconds"], &[Key("duration_s")]),
    (&["level", "quality", "rung"], &[Key("fidelity"), Elsewhere("at the top of the job: fidelity = \"standard\"")]),
    (&["objects", "object_list", "indenter", "indenters"], &[Key("object")]),
    (&["workers", "num_workers", "threads", "n_jobs", "jobs"], &[Elsewhere("--threads T on the command line")]),
    (&["overwrite", "force_overwrite"], &[Elsewhere("--overwrite on the command line")]),
];

/// Values of keys that name a choice, likewise: the first known one is meant.
const CHOICES: &[(&[&str], &[&str])] = &[
    (&["heightmap", "height_map", "height", "deformation", "displacement"], &["surface"]),
    (&["mask", "contact_mask", "segmentation", "contact_area"], &["contact", "instance"]),
    (&["force", "forces", "force_map", "stress", "normal_force"], &["pressure"]),
    (&["normals", "gradient", "gradients", "normal_map"], &["normal"]),
    (&["point_cloud", "pointcloud", "xyz"], &["points"]),
    (&["shear", "optical_flow", "motion"], &["flow"]),
    (&["marker", "dots", "marker_motion"], &["markers"]),
    (&["background", "no_contact", "ref"], &["reference"]),
    (&["depth_map", "depthmap", "indentation"], &["depth"]),
    (&["meters", "metres", "meter", "metre"], &["m"]),
    (&["millimeters", "millimetres", "millimeter", "millimetre"], &["mm"]),
    (&["centimeters", "centimetres", "centimeter", "centimetre"], &["cm"]),
    (&["inch", "inches", "\""], &["in"]),
    (&["micrometers", "micrometres", "micron", "microns"], &["um"]),
    (&["random", "all", "every"], &["any"]),
    (&["best", "automatic", "relief"], &["auto"]),
    (&["down", "bottom", "lowest"], &["-z", "contact"]),
    (&["up", "top"], &["+z"]),
    (&["center", "centre", "bbox", "bounding_box", "com"], &["bounds"]),
    (&["webdataset", "wds", "shards"], &["tar"]),
    (&["imagefolder", "folders", "directory", "files", "png"], &["folder"]),
    (&["fast", "low", "quick", "preview"], &["draft"]),
    (&["medium", "normal", "default", "balanced"], &["standard"]),
    (&["accurate", "fine", "best"], &["high"]),
    (&["exact", "max", "ultra"], &["reference"]),
    (&["fem", "soft", "mechanical"], &["elastic"]),
    (&["lookup", "lut", "table", "taxim", "polynomial", "measured", "calibration"], &["calibrated"]),
    (&["skip", "ignore", "drop"], &["skip", "reject"]),
    (&["error", "raise", "stop", "abort"], &["error", "fail"]),
    (&["mini", "gelsight_mini", "gelsightmini", "gs_mini", "r1.5", "gelsight", "gelsight_r15"], &["gelsight-mini"]),
    (&["digit360", "digit_360", "omnitact"], &["digit"]),
    (&["gelsight_2014", "gelsight2014"], &["gelsight-2014"]),
    (&["gelsight_2017", "gelsight2017", "wedge", "gelsight_wedge", "gelslim", "r1"], &["gelsight-2017"]),
];

/// Choices that are somewhere else altogether, and where.
const ELSEWHERE: &[(&[&str], &str)] = &[
    (
        &["hdf5", "h5", "zarr", "lerobot", "parquet", "rlds", "tfrecord"],
        "gelsim-export copies a dataset to lerobot, zarr or hdf5 (pip install '.[export]', docs/formats.md)",
    ),
    (
        &["rgb", "image", "tactile", "color", "colour", "images"],
        "the tactile image is always written; `layers` are what is beside it",
    ),
    (
        &["label", "labels", "pose", "class", "json"],
        "the label, with pose, class and force, is always written as JSON; `layers` are images",
    ),
];

/// A guess as it is looked up.
fn plain(written: &str) -> String {
    written.trim().to_lowercase().replace(['-', ' '], "_")
}

/// True if `written` is a guess at this key.
pub fn is_guess_at(written: &str, key: &str) -> bool {
    let guess = plain(written);
    let is_meant = |meant: &Means| matches!(meant, Key(meant) if *meant == key);
    KEYS.iter().any(|(guesses, meant)| guesses.contains(&guess.as_str()) && meant.iter().any(is_meant))
        || nearest(written, [key]).is_some()
}

/// What is advised where `written` is no key of a table that knows these: the key that is meant, or where it is said.
pub fn of_key(written: &str, known: &[&str]) -> String {
    let guess = plain(written);
    if let Some(name) = known.iter().find(|name| plain(name) == guess) {
        return format!("did you mean `{name}`?");
    }
    let meant = KEYS.iter().filter(|(guesses, _)| guesses.contains(&guess.as_str())).flat_map(|(_, meant)| *meant);
    for meaning in meant {
        match meaning {
            Key(key) if known.contains(key) => return format!("did you mean `{key}`?"),
            Elsewhere(help) => return (*help).to_owned(),
            Key(_) => {}
        }
    }
    match nearest(written, known.iter().copied()) {
        Some(name) => format!("did you mean `{name}`?"),
        None => format!("known here: {}", one_of(known)),
    }
}

/// The choice that is meant by one that is not known.
pub fn choice<'a>(written: &str, known: &[&'a str]) -> Option<&'a str> {
    let guess = plain(written);
    let same = || known.iter().find(|name| plain(name) == guess);
    let by_table = || {
        let meant =
            CHOICES.iter().filter(|(guesses, _)| guesses.contains(&guess.as_str())).flat_map(|(_, meant)| *meant);
        meant.filter_map(|name| known.iter().find(|known| *known == name)).next()
    };
    // Signs are what sides differ by.
    let signed = written.starts_with(['+', '-']);
    let by_spelling = || nearest(written, known.iter().copied().filter(|name| !signed || name.starts_with(['+', '-'])));
    same().or_else(by_table).copied().or_else(by_spelling)
}

/// What is advised where `written` is no choice there is.
pub fn of_choice(written: &str, known: &[&str]) -> String {
    let guess = plain(written);
    let all = one_of(known);
    if let Some(near) = choice(written, known) {
        return format!("did you mean `{near}`? One of {all}");
    }
    match ELSEWHERE.iter().find(|(guesses, _)| guesses.contains(&guess.as_str())) {
        Some((_, help)) => format!("{help}. One of {all}"),
        None => format!("one of {all}"),
    }
}

/// What a key takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wanted {
    /// A whole number.
    Whole,
    /// A number.
    Number,
    /// A constant, a range or a distribution.
    Quantity,
    /// True or false.
    Truth,
    /// Text.
    Text,
    /// A list.
    List,
    /// A table.
    Table,
    /// `stick`, or a table with a coefficient.
    Friction,
    /// `stick`, or a table of Coulomb's law.
    Coulomb,
}

impl Wanted {
    /// What is taken where one of these names belongs.
    pub fn of_choice(names: &[&str]) -> Option<Self> {
        match names {
            names if names.contains(&"coulomb") => Some(Self::Coulomb),
            names if names.contains(&"coefficient") => Some(Self::Friction),
            _ => None,
        }
    }
}

/// Names of the ends of ranges.
const LOWER: &[&str] = &["min", "low", "from", "start", "lower"];
const UPPER: &[&str] = &["max", "high", "to", "end", "stop", "upper"];

/// Tables that are often taken for switches, or for names.
const TABLES: &[(&str, &str)] = &[
    ("markers", "a table says which: [markers] with pitch_mm = 1.5 and diameter_mm = 0.4"),
    ("texture", "a table says which: [texture] with patterns = [\"noise\"] and amplitude_mm = [0.01, 0.05]"),
    ("camera", "a table says what it does: [camera] with read_noise_levels = 2.0"),
    ("shear", "a table says how far: [shear] with x_mm = [-0.3, 0.3]"),
    ("unit", "a table says how much: [sensor.unit] with variation = 0.5"),
    ("splits", "a table says how much each gets: splits = { train = 0.8, val = 0.1, test = 0.1 }"),
];

/// The line as it should read where the value of `key` is of another kind than wanted, if it is plain what is meant; of an
/// element of a list, whose key is empty, the value.
pub fn line(key: &str, value: &Value, wanted: Wanted) -> Option<String> {
    let write = |value: String| {
        Some(match key {
            "" => format!("write `{value}`"),
            key => format!("write `{key} = {value}`"),
        })
    };
    let list = |numbers: &[f64]| format!("[{}]", numbers.iter().map(|n| decimal(*n)).collect::<Vec<_>>().join(", "));
    match (value, wanted) {
        (Value::String(text), Wanted::Whole)
            if key == "seed" && !text.trim().starts_with(|c: char| c.is_ascii_digit()) =>
        {
            Some(String::from(
                "a seed is a whole number, such as `seed = 7`: the same seed gives the same samples, another one others",
            ))
        }
        (Value::String(text), Wanted::Whole) => write(whole(number(text)?)?),
        (Value::Float(number), Wanted::Whole) => write(whole(*number)?),
        (Value::String(text), Wanted::Number) => write(decimal(number(text)?)),
        (Value::String(text), Wanted::Quantity) => match numbers(text)?.as_slice() {
            [one] => write(decimal(*one)),
            [low, high] => write(list(&[*low, *high])),
            _ => None,
        },
        (Value::Array(items), Wanted::Text) if key == "path" && items.len() > 1 => Some(String::from(
            "one table for each file: [[object]] with path = \"a.stl\"; or a pattern for all of them, path = \"*.stl\"",
        )),
        (Value::Array(items), Wanted::Whole | Wanted::Number | Wanted::Text) => match items.as_slice() {
            [Node { value, .. }] => write(literal(value)?),
            _ => None,
        },
        (Value::Array(items), Wanted::Quantity) if items.len() != 2 => match floats(items)?.as_slice() {
            [] => None,
            [one] => write(decimal(*one)),
            several => write(format!("{{ choice = {} }}", list(several))),
        },
        (Value::String(text), Wanted::Truth) => match text.to_lowercase().as_str() {
            "true" | "yes" | "on" => write(String::from("true")),
            "false" | "no" | "off" => write(String::from("false")),
            _ => None,
        },
        (Value::Integer(truth @ (0 | 1)), Wanted::Truth) => write((*truth == 1).to_string()),
        (Value::Integer(_) | Value::Float(_) | Value::Bool(_), Wanted::Text) => {
            write(format!("\"{}\"", literal(value)?))
        }
        (Value::String(text), Wanted::List) if key == "layers" => {
            let known: Vec<&str> = OutputLayer::ALL.into_iter().map(OutputLayer::name).collect();
            let named: Option<Vec<&str>> =
                text.split([',', ' ']).filter(|word| !word.is_empty()).map(|word| choice(word, &known)).collect();
            match named.filter(|named| !named.is_empty()) {
                Some(named) => write(format!("{named:?}")),
                None => Some(String::from(
                    "name them, such as `layers = [\"depth\", \"contact\"]`: gelsim list layers shows all",
                )),
            }
        }
        (Value::String(text), Wanted::List) => match numbers(text) {
            Some(several) if several.len() > 1 => write(list(&several)),
            _ => write(format!("[{text:?}]")),
        },
        (Value::Integer(_) | Value::Float(_), Wanted::List) => {
            let one = literal(value)?;
            write(format!("[{one}, {one}]"))
        }
        (Value::Table(entries), Wanted::List) if key == "layers" => {
            let named = entries.iter().filter(|entry| !matches!(entry.node.value, Value::Bool(false)));
            let names: Vec<String> = named.map(|entry| format!("{:?}", entry.key)).collect();
            write(format!("[{}]", names.join(", ")))
        }
        (Value::Table(_), Wanted::List) if ["object", "led", "lamp", "phase"].contains(&key) => {
            let table = match key {
                "led" | "lamp" => format!("sensor.{key}"),
                "phase" => format!("sequence.{key}"),
                _ => key.to_owned(),
            };
            Some(format!("there may be several: write [[{table}]]"))
        }
        (Value::Table(entries), Wanted::List) => {
            let of = |names: &[&str]| number_of(entries, names);
            let ends = of(LOWER).zip(of(UPPER)).or_else(|| of(&["width", "w", "x"]).zip(of(&["height", "h", "y"])));
            match ends {
                Some((first, second)) => write(list(&[first, second])),
                None => Some(format!("a list stands in brackets: {key} = [..]")),
            }
        }
        (Value::Array(items), Wanted::Table) if key == "splits" => match floats(items)?.as_slice() {
            [train, val, test] => {
                write(format!("{{ train = {}, val = {}, test = {} }}", decimal(*train), decimal(*val), decimal(*test)))
            }
            [train, test] => write(format!("{{ train = {}, test = {} }}", decimal(*train), decimal(*test))),
            _ => None,
        },
        (Value::Array(items), Wanted::Table) => items
            .iter()
            .all(|item| matches!(item.value, Value::Table(_)))
            .then(|| format!("there is one: [{key}] in place of [[{key}]]")),
        (Value::Bool(false), Wanted::Table) => Some(String::from("leave it out")),
        (Value::String(name), Wanted::Table) if key == "sensor" => {
            let known = gelsim_files::sensor::PRESETS.map(|(name, _)| name);
            Some(match choice(name, &known) {
                Some(preset) => format!("a table says which: [sensor] with preset = \"{preset}\""),
                None => format!("a table says which: [sensor] with file = {name:?}, or preset = \"digit\""),
            })
        }
        (_, Wanted::Table) => TABLES.iter().find(|(table, _)| *table == key).map(|(_, help)| (*help).to_owned()),
        (Value::Table(entries), Wanted::Quantity) => {
            let of = |names: &[&str]| number_of(entries, names);
            let (low, high) = (of(LOWER), of(UPPER));
            match (of(&["mean", "mu"]), of(&["std", "sigma", "sd"]), low.zip(high)) {
                (Some(mean), Some(std), limits) => {
                    let limits = limits.map_or(String::new(), |(low, high)| {
                        format!(", min = {}, max = {}", decimal(low), decimal(high))
                    });
                    write(format!("{{ normal = {{ mean = {}, std = {}{limits} }} }}", decimal(mean), decimal(std)))
                }
                (_, _, Some((low, high))) => write(list(&[low, high])),
                _ => None,
            }
        }
        (Value::Integer(_) | Value::Float(_), Wanted::Coulomb) => {
            write(format!("{{ coulomb = {{ coefficient = {} }} }}", literal(value)?))
        }
        (Value::Integer(_) | Value::Float(_), Wanted::Friction) => {
            write(format!("{{ coefficient = {} }}", literal(value)?))
        }
        (Value::Array(items), Wanted::Friction) => write(format!("{{ coefficient = {} }}", list(&floats(items)?))),
        (Value::Array(_), Wanted::Coulomb) => Some(String::from(
            "it is one number here: { coulomb = { coefficient = 0.5 } }; under [[object]] and in [sequence] friction may be a range",
        )),
        _ => None,
    }
}

/// A list as it should read where its numbers have decimal commas, so that it has twice as many elements as `wanted`.
pub fn decimal_commas(value: &Value, wanted: usize) -> Option<String> {
    let Value::Array(items) = value else { return None };
    let halves = items.iter().map(|item| match item.value {
        Value::Integer(number) => Some(number),
        _ => None,
    });
    let halves: Vec<i64> = halves.collect::<Option<_>>()?;
    let meant = halves.chunks_exact(2).map(|pair| format!("{}.{}", pair[0], pair[1])).collect::<Vec<_>>().join(", ");
    let is_so = halves.len() == 2 * wanted && halves.iter().skip(1).step_by(2).all(|digits| *digits >= 0);
    is_so.then(|| format!("numbers have a decimal point: [{meant}]"))
}

/// A number in text: also 3,000 and 3k.
fn number(text: &str) -> Option<f64> {
    let text = text.trim().replace([',', '_', ' '], "");
    let (digits, times) = match text.strip_suffix(['k', 'K']) {
        Some(digits) => (digits, 1e3),
        None => match text.strip_suffix('M') {
            Some(digits) => (digits, 1e6),
            None => (text.as_str(), 1.0),
        },
    };
    let number = digits.parse::<f64>().ok()?;
    number.is_finite().then_some(times * number)
}

/// The numbers in text such as `640x480`, `0.2 - 1.0` or `0.2, 1.0`.
fn numbers(text: &str) -> Option<Vec<f64>> {
    if let Ok(one) = text.trim().parse::<f64>() {
        return Some(vec![one]);
    }
    let text = text.trim().trim_start_matches(['[', '(']).trim_end_matches([']', ')']).to_lowercase();
    let parts = ["x", "*", "×", ",", "..", " to ", ";", " - ", "-", " "]
        .into_iter()
        .map(|between| text.split(between).map(str::trim).collect::<Vec<_>>());
    let read = |parts: Vec<&str>| {
        parts
            .iter()
            .map(|part| part.parse().ok().filter(|number: &f64| number.is_finite()))
            .collect::<Option<Vec<f64>>>()
    };
    parts.filter(|parts| parts.len() > 1).find_map(read)
}

/// A whole number as TOML has it.
pub fn whole(number: f64) -> Option<String> {
    ((0.0..9e15).contains(&number) && number.fract() == 0.0).then(|| format!("{number:.0}"))
}

/// A number as TOML has it: whole ones without a point, which every key takes.
fn decimal(number: f64) -> String {
    whole(number.abs()).map_or_else(|| format!("{number:?}"), |_| format!("{number:.0}"))
}

fn literal(value: &Value) -> Option<String> {
    match value {
        Value::Bool(truth) => Some(truth.to_string()),
        Value::Integer(number) => Some(number.to_string()),
        Value::Float(number) => Some(format!("{number:?}")),
        Value::String(text) => Some(format!("{text:?}")),
        Value::Datetime | Value::Array(_) | Value::Table(_) => None,
    }
}

fn float(value: &Value) -> Option<f64> {
    match value {
        Value::Integer(number) => Some(*number as f64),
        Value::Float(number) => Some(*number),
        _ => None,
    }
}

/// The number of the first key of a table that has one of these names.
fn number_of(entries: &[Entry], names: &[&str]) -> Option<f64> {
    entries.iter().find(|entry| names.contains(&entry.key.as_str())).and_then(|entry| float(&entry.node.value))
}

fn floats(items: &[Node]) -> Option<Vec<f64>> {
    items.iter().map(|item| float(&item.value)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_guess_that_is_known_beats_the_nearest_spelling() {
        let sensor =
            ["preset", "background", "background_sha256", "lens", "led", "calibration", "resolution_px", "unit"];
        for (written, help) in [
            ("background_image", "did you mean `background`?"),
            (
                "leds",
                "each LED is a table of its own, [[sensor.led]], in a sensor file [[led]], with azimuth_deg, elevation_deg and color",
            ),
            ("type", "did you mean `preset`?"),
            ("Background", "did you mean `background`?"),
            ("resolution", "did you mean `resolution_px`?"),
            ("resolutoin_px", "did you mean `resolution_px`?"),
        ] {
            assert_eq!(of_key(written, &sensor), help, "{written}");
        }
        assert!(of_key("variation", &sensor).contains("[sensor.unit] variation = 0.5"));
        assert!(of_key("dir", &["layers", "exr"]).contains("--out DIR"));
        assert!(of_key("brightnes", &["depth_mm", "at"]).starts_with("known here: "));
        // A key is advised only where it is one.
        assert!(of_key("background_image", &["depth_mm"]).contains("under [sensor]"));
    }

    #[test]
    fn a_choice_is_found_by_its_meaning_and_never_with_another_sign() {
        assert_eq!(choice("heightmap", &["depth", "surface"]), Some("surface"));
        assert_eq!(choice("DIGIT", &["digit", "tactip"]), Some("digit"));
        assert_eq!(choice("gelsight", &["allsight", "gelsight-mini"]), Some("gelsight-mini"));
        assert_eq!(choice("-Z", &["any", "+x", "-x", "+z", "-z"]), Some("-z"));
        assert_eq!(choice("meters", &["mm", "cm", "m", "in"]), Some("m"));
        assert!(of_choice("hdf5", &["tar", "folder"]).starts_with("gelsim-export copies"));
    }

    #[test]
    fn the_line_is_shown_as_it_should_read() {
        let text = |text: &str| Value::String(text.to_owned());
        let said = |key: &str, value: &Value, wanted| line(key, value, wanted).unwrap_or_default();
        for (key, value, wanted, expected) in [
            ("samples", text("3000"), Wanted::Whole, "write `samples = 3000`"),
            ("samples", text("3,000"), Wanted::Whole, "write `samples = 3000`"),
            ("samples", text("2k"), Wanted::Whole, "write `samples = 2000`"),
            ("samples", Value::Float(3e3), Wanted::Whole, "write `samples = 3000`"),
            ("resolution_px", text("640x480"), Wanted::List, "write `resolution_px = [640, 480]`"),
            ("layers", text("depth"), Wanted::List, "write `layers = [\"depth\"]`"),
            ("depth_mm", text("0.2 - 1.0"), Wanted::Quantity, "write `depth_mm = [0.2, 1]`"),
            ("weight", text("0.5"), Wanted::Number, "write `weight = 0.5`"),
            ("name", Value::Integer(5), Wanted::Text, "write `name = \"5\"`"),
            ("sensor", text("digit"), Wanted::Table, "a table says which: [sensor] with preset = \"digit\""),
            (
                "markers",
                Value::Bool(true),
                Wanted::Table,
                "a table says which: [markers] with pitch_mm = 1.5 and diameter_mm = 0.4",
            ),
            ("friction", Value::Float(0.6), Wanted::Coulomb, "write `friction = { coulomb = { coefficient = 0.6 } }`"),
        ] {
            assert_eq!(said(key, &value, wanted), expected);
        }
        assert!(said("seed", &text("random"), Wanted::Whole).contains("seed = 7"));
        assert_eq!(said("samples", &Value::Float(8.5), Wanted::Whole), "");
    }
}
