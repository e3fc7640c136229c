//! What is done with the bytes of a file: one function per target, the same under `cargo fuzz` and in the test `fuzz`.
//!
//! A function returns if the bytes are refused with a message, or if what they became holds its invariants and comes
//! back the same after being written and read again. Everything else panics.

#![allow(dead_code)] // A fuzz target calls one of them.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::{LazyLock, OnceLock};

use gelsim_core::base::grid::{Grid, Rect};
use gelsim_core::base::view::View;
use gelsim_core::depth::Depth;
use gelsim_core::effects::{EffectLog, EffectPolicy};
use gelsim_core::fidelity::Fidelity;
use gelsim_core::gelpad::elastic::shear::Friction;
use gelsim_core::gelpad::{Contact, no_deformation};
use gelsim_core::mesh::Mesh;
use gelsim_core::mesh::clusters::Clusters;
use gelsim_core::optics::background::BackgroundImage;
use gelsim_core::optics::calibrated::{Calibrated, CalibratedShader};
use gelsim_dataset::archive::{self, SampleFiles};
use gelsim_dataset::frames::camera::{DepthCamera, DepthProjection, DepthUnit, DistanceAlong};
use gelsim_dataset::frames::check::FrameReach;
use gelsim_dataset::frames::run::SequenceSettings;
use gelsim_dataset::frames::source::FrameSource;
use gelsim_dataset::frames::stream::input::{StreamInput, StreamMessage};
use gelsim_dataset::frames::stream::{AnswerForm, StreamError, StreamSettings, render_stream};
use gelsim_dataset::frames::{poses as poses_file, read};
use gelsim_dataset::logs::Log;
use gelsim_dataset::logs::messages::{self, Kind};
use gelsim_dataset::manifest::Manifest;
use gelsim_dataset::recorded::RecordedDataset;
use gelsim_dataset::stats::ShardStats;
use gelsim_dataset::versioned::Versioned;
use gelsim_dataset::{decode, verify};
use gelsim_files::diagnostic::{Diagnostic, Diagnostics, Report};
use gelsim_files::exr::{Compression, Exr, Pixel};
use gelsim_files::mesh::{Format, parse};
use gelsim_files::sensor::markers::parse_marker_table;
use gelsim_files::sensor::pins::parse_pin_table;
use gelsim_files::{exr as exr_file, heights, image_file, npy as npy_file, png as png_file};
use gelsim_job::config::dataset::Dataset;
use gelsim_job::config::{self, Overrides, ParsedJob};
use gelsim_job::label::Label;
use gelsim_job::layers::{DepthFormat, LayerCoding, OutputLayer, StepScale};
use gelsim_job::layout::Layout;
use gelsim_job::plan::Plan;
use gelsim_job::plan::frames::FrameSettings;
use gelsim_job::steps::Steps;
use gelsim_lab::presses::{self as press_file, Circle};
use gelsim_lab::preview::{LayerSelection, Tile, draw_tile_sheet};

#[path = "answers.rs"]
pub mod answers;

/// A job is refused with a report that can be shown, or is the same after being written out and read again.
pub fn job(bytes: &[u8]) {
    let Ok(text) = str::from_utf8(bytes) else { return };
    let mut problems = Diagnostics::default();
    let mut written = read_job(text, &mut problems);
    if problems.is_empty() {
        let again = toml::to_string(&written.job).expect("a job can be written");
        let read = read_job(&again, &mut problems);
        assert!(problems.is_empty(), "{again}");
        assert_eq!(json(&read.job), json(&written.job));
    }
    // All that the plan checks without a file; what it would make of a sound job is no matter of reading.
    written.job.paths_mut().for_each(|path| *path = String::from("none.obj"));
    problems.push(Diagnostic::new("a plan is not wanted"));
    let report = Plan::resolve(written, problems).err().expect("one problem at least");
    assert!(report.to_string().contains("error: "));
}

fn read_job(text: &str, problems: &mut Diagnostics) -> ParsedJob {
    config::read_job_text("job.toml", text.to_owned(), Path::new("none"), &Overrides::default(), problems)
}

fn json(value: &impl serde::Serialize) -> serde_json::Value {
    serde_json::to_value(value).expect("JSON can hold it")
}

/// See [`mesh`].
pub fn obj(bytes: &[u8]) {
    mesh(bytes, Format::Obj);
}

/// See [`mesh`].
pub fn stl(bytes: &[u8]) {
    mesh(bytes, Format::Stl);
}

/// See [`mesh`].
pub fn ply(bytes: &[u8]) {
    mesh(bytes, Format::Ply);
}

/// See [`mesh`].
pub fn off(bytes: &[u8]) {
    mesh(bytes, Format::Off);
}

/// See [`mesh`].
pub fn gltf(bytes: &[u8]) {
    mesh(bytes, Format::Gltf);
}

/// See [`mesh`].
pub fn dae(bytes: &[u8]) {
    mesh(bytes, Format::Dae);
}

/// See [`mesh`].
pub fn threemf(bytes: &[u8]) {
    mesh(bytes, Format::ThreeMf);
}

/// See [`mesh`].
pub fn urdf(bytes: &[u8]) {
    mesh(bytes, Format::Urdf);
}

/// A mesh is finite and its indices are in range; written in all three formats it is the same mesh in each.
fn mesh(bytes: &[u8], format: Format) {
    let mesh = match parse(bytes, format, 1.0) {
        Ok((mesh, _)) => mesh,
        Err(error) => return assert!(!error.to_string().contains('\n'), "{error}"),
    };
    assert!(!mesh.triangles.is_empty());
    assert!(mesh.vertices.as_flattened().iter().all(|x| x.is_finite()));
    assert!(mesh.centre_mm.iter().all(|x| x.is_finite()));
    let mut used = vec![false; mesh.vertices.len()];
    for [a, b, c] in &mesh.triangles {
        assert!(a != b && b != c && c != a);
        [a, b, c].into_iter().for_each(|corner| used[*corner as usize] = true);
    }
    assert!(used.iter().all(|used| *used));
    let mut distinct = mesh.vertices.clone();
    distinct.sort_by(|a, b| a.partial_cmp(b).expect("finite"));
    assert!(distinct.windows(2).all(|pair| pair[0] != pair[1]));
    // What a plan does next.
    Clusters::new(&mesh);
    if mesh.triangles.len() <= 1000 {
        let [from_obj, from_stl, from_ply] =
            [(written_obj(&mesh), Format::Obj), (written_stl(&mesh), Format::Stl), (written_ply(&mesh), Format::Ply)]
                .map(|(bytes, format)| parse(&bytes, format, 1.0).map_err(|error| error.to_string()));
        assert_eq!(from_obj, from_stl);
        assert_eq!(from_obj, from_ply);
        if mesh.centre_mm == [0.0; 3] {
            assert_eq!(from_obj.map(|(mesh, _)| mesh), Ok(mesh));
        }
    }
}

fn written_obj(mesh: &Mesh) -> Vec<u8> {
    let mut text = String::new();
    for [x, y, z] in mesh.vertices.iter().map(|vertex| vertex.map(f64::from)) {
        text += &format!("v {x} {y:e} {z:?}\n");
    }
    mesh.triangles.iter().for_each(|t| text += &format!("f {} {} {}\n", t[0] + 1, t[1] + 1, t[2] + 1));
    text.into_bytes()
}

fn written_stl(mesh: &Mesh) -> Vec<u8> {
    let mut bytes = vec![0; 80];
    bytes.extend((mesh.triangles.len() as u32).to_le_bytes());
    for triangle in &mesh.triangles {
        bytes.extend([0; 12]);
        for corner in triangle {
            bytes.extend(mesh.vertices[*corner as usize].map(f32::to_le_bytes).as_flattened());
        }
        bytes.extend([0; 2]);
    }
    bytes
}

fn written_ply(mesh: &Mesh) -> Vec<u8> {
    let mut bytes = format!(
        "ply\nformat binary_big_endian 1.0\nelement face {}\nproperty list uchar uint vertex_indices\n\
         element vertex {}\nproperty double x\nproperty float y\nproperty float z\nend_header\n",
        mesh.triangles.len(),
        mesh.vertices.len()
    )
    .into_bytes();
    for triangle in &mesh.triangles {
        bytes.push(3);
        bytes.extend(triangle.map(u32::to_be_bytes).as_flattened());
    }
    for [x, y, z] in &mesh.vertices {
        bytes.extend(f64::from(*x).to_be_bytes());
        bytes.extend(y.to_be_bytes());
        bytes.extend(z.to_be_bytes());
    }
    bytes
}

/// An array has as many values as its shape says, and is the same after being written and read again.
pub fn npy(bytes: &[u8]) {
    heights_of(bytes);
    for layer in [OutputLayer::Depth, OutputLayer::Normal] {
        let Ok(read) = decode::decode_planes(layer, LayerCoding::Npy, bytes, &Steps::default()) else { continue };
        assert!(read.channels.iter().all(|(_, values)| values.len() == read.width * read.height));
        let planes: Vec<&[f32]> = read.channels.iter().map(|(_, values)| values.as_slice()).collect();
        let again = npy_file::encode(read.width, read.height, &planes);
        let again = decode::decode_planes(layer, LayerCoding::Npy, &again, &Steps::default())
            .expect("what was written can be read");
        for ((_, a), (_, b)) in read.channels.iter().zip(&again.channels) {
            assert!(a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits() || a.is_nan() && b.is_nan()));
        }
    }
    let Some(read) = image(npy_file::decode_height_array(bytes).map(|array| array.values)) else { return };
    let text = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({}, {}), }}\n", read.height, read.width);
    let mut again = b"\x93NUMPY\x01\x00".to_vec();
    again.extend((text.len() as u16).to_le_bytes());
    again.extend(text.as_bytes());
    read.data.iter().for_each(|value| again.extend(value.to_le_bytes()));
    let again = npy_file::decode_height_array(&again).expect("what was written can be read");
    assert_eq!(again.max_value, None);
    assert_same_bits(&again.values, &read);
}

/// Heights are from 0 to 1 and not more than a side may have, whatever the format.
fn heights_of(bytes: &[u8]) {
    if let Some(read) = image(heights::decode_height_map(bytes)) {
        assert!(read.width <= 8192 && read.height <= 8192);
        assert!(read.data.iter().all(|height| (0.0..=1.0).contains(height)));
    }
}

fn assert_same_bits(a: &Grid<f32>, b: &Grid<f32>) {
    assert_eq!((a.width, a.height), (b.width, b.height));
    let same = |(a, b): (&f32, &f32)| a.to_bits() == b.to_bits() || a.is_nan() && b.is_nan();
    assert!(a.data.iter().zip(&b.data).all(same));
}

/// A picture has as many values as its size says, and is the same after being written losslessly and read again.
pub fn exr(bytes: &[u8]) {
    heights_of(bytes);
    let Some(read) = image(exr_file::decode_first_channel(bytes)) else { return };
    for compression in [Compression::None, Compression::Rle, Compression::Zip] {
        let storage = Exr { pixel: Pixel::Float, compression };
        let again = exr_file::encode(read.width, read.height, &[("Z", &read.data)], storage);
        assert_same_bits(&exr_file::decode_first_channel(&again).expect("what was written can be read"), &read);
    }
}

/// A background is the same after being written and read again.
pub fn png(bytes: &[u8]) {
    heights_of(bytes);
    let small = png_file::read_header(bytes).is_ok_and(|([width, height], _)| width * height <= 1 << 20);
    if small && let Ok(read) = png_file::decode_grey16(bytes) {
        let steps = Steps::new(&[OutputLayer::Surface], DepthFormat::Png16, 3.0);
        let plane_mm = steps.decode(StepScale::Surface, bytes).expect("it was just read").data;
        let again = png_file::decode_grey16(&steps.encode(StepScale::Surface, read.width, read.height, &plane_mm))
            .expect("written");
        // 0 stands for what is not finite, which does not come back.
        assert!(read.data.iter().zip(&again.data).all(|(a, b)| a.max(&1) == b));
    }
    match image_file::decode_rgb(bytes) {
        Err(reason) => assert!(!reason.is_empty()),
        Ok(picture) => {
            let (width, height) = (picture.width() as usize, picture.height() as usize);
            let again = png_file::encode_rgb(width, height, &picture);
            assert_eq!(image_file::decode_rgb(&again).as_ref(), Ok(&picture));
        }
    }
}

/// A picture of any format is refused in words, or has the size that its header says.
pub fn picture(bytes: &[u8]) {
    heights_of(bytes);
    let read = image_file::decode_image(bytes);
    match &read {
        Err(reason) => assert!(!reason.is_empty() && !reason.contains('\n'), "{reason}"),
        Ok(picture) => {
            let size = [picture.width() as usize, picture.height() as usize];
            assert!(size.iter().all(|side| (1..=8192).contains(side)));
            assert_eq!(image_file::read_header(bytes).as_ref(), Ok(&(size, picture.color())));
            assert_eq!(image_file::decode_rgb(bytes).map(|rgb| rgb.dimensions()), Ok(picture.to_rgb8().dimensions()));
        }
    }
    // What only counts pixels says the same of what can be read.
    if let (Ok(size), Ok(picture)) = (image_file::read_size_of_bytes(bytes), read) {
        assert_eq!(size, [picture.width() as usize, picture.height() as usize]);
    }
    assert!(image_file::detect_extension(bytes).is_none_or(|ending| !ending.is_empty()));
}

/// A table of dots or pins is refused with places, or each of them is somewhere.
pub fn places(bytes: &[u8]) {
    let pins = parse_pin_table("pins.csv", bytes);
    let dots = parse_marker_table("dots.csv", bytes);
    for mistakes in [pins.as_ref().err(), dots.as_ref().err()].into_iter().flatten() {
        assert!(
            (1..20).contains(&mistakes.len())
                && mistakes.iter().all(|what| what.contains(".csv: ") || what.contains(".csv:"))
        );
    }
    for at_mm in pins.iter().flatten().chain(dots.iter().flatten().map(|dot| &dot.at_mm)) {
        assert!(at_mm.iter().all(|mm| mm.abs() <= 1e4), "{at_mm:?}");
    }
    assert!(dots.iter().flatten().all(|dot| dot.diameter_mm.is_none_or(|mm| mm > 0.0 && mm.is_finite())));
}

/// A sensor file is refused with a report that can be shown, or is the same after being written out and read again.
pub fn sensor(bytes: &[u8]) {
    static FOLDER: LazyLock<tempfile::TempDir> = LazyLock::new(|| tempfile::TempDir::new().expect("a folder"));
    let path = FOLDER.path().join(format!("{:?}.toml", std::thread::current().id()));
    let read = |bytes: &[u8]| {
        std::fs::write(&path, bytes).expect("a file in the temporary folder");
        let mut problems = Diagnostics::default();
        let read = config::read_sensor_file(path.to_str().expect("a path in letters"), &mut problems);
        (read, problems)
    };
    let (mut first, mut problems) = read(bytes);
    if problems.is_empty() {
        let written = |parsed: &ParsedJob| {
            let mut sensor = toml::Table::try_from(&parsed.job.sensor).expect("a sensor can be written");
            // A job says which file its sensor is from; a sensor file does not.
            sensor.remove("file");
            sensor.to_string()
        };
        let sensor = written(&first);
        let (second, problems) = read(sensor.as_bytes());
        assert!(problems.is_empty(), "{sensor}");
        assert_eq!(written(&second), sensor);
    }
    // All that the plan checks without a file.
    first.job.paths_mut().for_each(|path| *path = String::from("none.png"));
    problems.push(Diagnostic::new("a plan is not wanted"));
    let report = Plan::resolve(first, problems).err().expect("one problem at least");
    assert!(report.to_string().contains("error: "));
}

/// What was read, if it was; its size must be that of its data.
fn image(read: Result<Grid<f32>, String>) -> Option<Grid<f32>> {
    match read {
        Err(reason) => {
            assert!(!reason.is_empty());
            None
        }
        Ok(grid) => {
            assert!(grid.width > 0 && grid.height > 0);
            assert_eq!(grid.data.len(), grid.width * grid.height);
            Some(grid)
        }
    }
}

/// The job of the shards in the corpus of `shard`.
pub const SHARD_JOB: &str = r#"
[dataset]
name = "tiny"
samples = 2
samples_per_shard = 1
seed = 1
splits = { train = 1.0 }

[sensor]
resolution_px = [6, 5]
field_of_view_mm = [12.0, 10.0]

[[object]]
path = "cube.obj"

[indentation]
depth_mm = 0.5

[markers]
pitch_mm = 3.0
diameter_mm = 0.5

[output]
layers = ["depth", "surface", "contact", "normal", "pressure", "markers", "reference"]
"#;

/// A shard has no more in it than its bytes, and is found complete again after its files are put into a new tar if it
/// was complete; a mistake in it is said in words.
pub fn shard(bytes: &[u8]) {
    static JOB: LazyLock<RecordedDataset> = LazyLock::new(|| {
        let job = read_job(SHARD_JOB, &mut Diagnostics::default()).job;
        let Dataset { samples, samples_per_shard, splits, .. } = &job.dataset;
        let layout = Layout::new(samples.unwrap_or(1), *samples_per_shard, *splits);
        RecordedDataset { root: PathBuf::new(), job, layout }
    });
    let found = verify::check_tar(bytes, &JOB, JOB.layout.shard(0));
    assert!(found.iter().all(|what| !what.is_empty()));
    let (mut length, mut samples) = (0, Vec::new());
    let read = archive::visit_tar(bytes, |files| {
        length += files.members.iter().map(|(_, bytes)| bytes.len()).sum::<usize>();
        Tile::from_files(&files, &LayerSelection::Usual).map(|tile| draw_tile_sheet(&[tile], 1, 64)).ok();
        samples.push(files);
        ControlFlow::Continue(())
    });
    assert!(length <= bytes.len());
    if found.is_empty() {
        assert!(read.is_ok());
        assert_eq!(verify::check_tar(to_gnu_tar(&samples).as_slice(), &JOB, JOB.layout.shard(0)), Vec::<String>::new());
    }
}

/// The same samples in another kind of tar.
fn to_gnu_tar(samples: &[SampleFiles]) -> Vec<u8> {
    let mut tar = tar::Builder::new(Vec::new());
    for files in samples {
        for (suffix, bytes) in &files.members {
            let mut header = tar::Header::new_gnu();
            header.set_size(bytes.len() as u64);
            tar.append_data(&mut header, format!("{}.{suffix}", files.key), bytes.as_slice()).expect("memory");
        }
    }
    tar.into_inner().expect("memory")
}

/// What describes a dataset is refused, or the same after being written and read again.
pub fn manifest(bytes: &[u8]) {
    if let Ok(Some(manifest)) = Manifest::parse(bytes) {
        manifest.to_wids_index();
        same_again(&manifest, |text| Manifest::parse(text).ok().flatten());
    }
    if let Ok(Some(stats)) = ShardStats::parse(bytes) {
        same_again(&stats, |text| ShardStats::parse(text).ok().flatten());
    }
    if let Ok(label) = serde_json::from_slice::<Label>(bytes) {
        same_again(&label, |text| serde_json::from_slice(text).ok());
    }
    // A dataset's job.toml: read as `verify`, `reproduce` and a resumed run read it.
    if let Ok(text) = str::from_utf8(bytes) {
        read_job(text, &mut Diagnostics::default());
    }
}

fn same_again<T: serde::Serialize>(value: &T, read: impl Fn(&[u8]) -> Option<T>) {
    let text = serde_json::to_vec(value).expect("JSON can hold it");
    assert_eq!(read(&text).as_ref().map(json), Some(json(value)));
}

/// A table of calibrated light is refused, or is the same after being written and read again, and its light is finite.
pub fn calibration(bytes: &[u8]) {
    let table = match gelsim_files::calibration::parse_calibration(bytes) {
        Ok(table) => table,
        Err(reason) => return assert!(!reason.is_empty()),
    };
    same_again(&table, |text| gelsim_files::calibration::parse_calibration(text).ok());
    const CAMERA: View = View { resolution_px: [7, 5], mm_per_px: [0.5; 2] };
    static CONTACT: LazyLock<Contact> = LazyLock::new(|| {
        let mut penetration = Grid::new(9, 7);
        penetration.data.iter_mut().enumerate().for_each(|(k, reach)| *reach = (k % 4) as f32 - 1.0);
        let mut depth =
            Depth { penetration, margin_px: 1, touching: Rect::default(), deepest_mm: 0.0, over_thickness_px: 0 };
        depth.measure();
        no_deformation::press(&depth)
    });
    let rest = BackgroundImage::new(7, 5, vec![100; 105]);
    for spacing_mm in [0.0, 1.0] {
        let shader = CalibratedShader::new(Calibrated { spacing_mm }, Some(&table), &CAMERA);
        let light = shader.shade(&CONTACT, &rest, &mut EffectLog::new(EffectPolicy::All));
        assert!(light.region.area() == 35 && light.planes.iter().flatten().all(|value| value.is_finite()));
    }
}

/// A table of presses is refused with a report that can be shown, or is the same after being written and read again.
pub fn presses(bytes: &[u8]) {
    let path = Path::new("presses.csv");
    let table = match press_file::parse(path, bytes) {
        Ok(table) => table,
        Err(report) => return assert!(report.to_string().contains("error: ")),
    };
    assert!(!table.presses.is_empty());
    let quoted = |text: &str| format!("\"{}\"", text.replace('"', "\"\""));
    let mut text = String::from("file,radius_px,centre_y_px,centre_x_px,mm_per_px_x,mm_per_px_y,ball_radius_mm\n");
    for press in &table.presses {
        assert!(!press.file.is_empty());
        let circle = press.circle.map_or(String::from(",,"), |Circle { centre_px: [x, y], radius_px }| {
            assert!(x.is_finite() && y.is_finite() && radius_px.is_finite() && radius_px > 0.0);
            format!("{radius_px},{y},{x}")
        });
        let [width, height] = [0, 1].map(|k| press.mm_per_px.map(|size| size[k]));
        let [width, height, ball] = [width, height, press.ball_radius_mm].map(|value| {
            assert!(value.is_none_or(|value| value.is_finite() && value > 0.0));
            value.map_or(String::new(), |value| value.to_string())
        });
        text += &format!("{},{circle},{width},{height},{ball}\n", quoted(&press.file));
    }
    let again = press_file::parse(path, text.as_bytes()).expect("what was written can be read");
    let but_lines = |presses: &[press_file::PressRow]| -> Vec<press_file::PressRow> {
        presses.iter().map(|press| press_file::PressRow { line: 0, ..press.clone() }).collect()
    };
    assert_eq!(but_lines(&again.presses), but_lines(&table.presses));
}

/// A depth frame is refused in words, or becomes heights of the view's size that are no NaN, whatever rays its camera has;
/// the same bytes in a pipe are taken apart without taking more than they say.
pub fn frame(bytes: &[u8]) {
    const VIEW: View = View { resolution_px: [9, 7], mm_per_px: [1.0; 2] };
    let camera = |projection| DepthCamera {
        unit: DepthUnit::Millimetre,
        plane_mm: 10.0,
        max_depth_mm: Some(1e6),
        background: Some(65535.0),
        flip: [true, true],
        offset_px: [0.5, -0.25],
        projection,
        along: DistanceAlong::Axis,
    };
    match read::decode_frame(bytes) {
        Err(reason) => assert!(!reason.is_empty()),
        Ok(seen) if seen.data.len() > 1 << 16 => {}
        Ok(seen) => {
            let own = View { resolution_px: [seen.width, seen.height], ..VIEW };
            for (projection, view) in
                [(DepthProjection::Orthographic, own), (DepthProjection::Perspective { fov_y_deg: 60.0 }, VIEW)]
            {
                match camera(projection).to_heights(seen.clone(), &view) {
                    Err(problem) => assert!(!problem.message.is_empty() && problem.help.is_some()),
                    Ok(heights) => {
                        let Grid { width, height, data } = &heights.above_mm;
                        assert_eq!([*width, *height], view.resolution_px);
                        assert!(data.len() == width * height && data.iter().all(|mm| !mm.is_nan()));
                        let reach = FrameReach::from_surface(&heights, 3.0);
                        assert!(reach.through_px + reach.unseen_px <= 2 * data.len() as u64);
                        reach.find_error(&camera(projection));
                    }
                }
            }
        }
    }
    // No plan is made: what would be rendered is no matter of reading.
    let refused = |_| Err(Report::from_message("a plan is not wanted"));
    let camera = camera(DepthProjection::Orthographic);
    let settings = StreamSettings { camera: &camera, sequence: None, answers: AnswerForm::Npy };
    match render_stream(bytes, Vec::new(), &settings, refused, |_| {}) {
        Ok(frames) => assert!(frames == 0 && bytes.is_empty()),
        Err(StreamError::Frame(0, problem)) => assert!(!problem.message.is_empty()),
        Err(StreamError::Plan(_)) => {}
        Err(other) => panic!("{other:?}"),
    }
}

/// A stream is taken apart as frames alone and as poses and frames. Each frame is answered, by arrays as long as their
/// shapes or by a reason; a stream of which nothing came does not end well, and what is said of it has an end.
pub fn stream(bytes: &[u8]) {
    const SIZE: [usize; 2] = [8, 6];
    let plan = |sequence: bool| {
        let overrides = Overrides {
            set: vec![(String::from("--set"), String::from("markers.pitch_mm=4.0"))],
            fidelity: Some(Fidelity::Draft),
        };
        let layers = [OutputLayer::Surface, OutputLayer::Contact, OutputLayer::Normal, OutputLayer::Markers];
        let frames = FrameSettings {
            sensor: "gelsight-2014",
            resolution_px: SIZE,
            layers: &layers,
            classes: &[],
            moved: false,
            sequence,
            overrides: &overrides,
        };
        frames.resolve_plan().unwrap_or_else(|report| panic!("{report}"))
    };
    static PLANS: OnceLock<[Plan; 2]> = OnceLock::new();
    let plans = PLANS.get_or_init(|| [plan(false), plan(true)]);
    let camera = DepthCamera {
        unit: DepthUnit::Millimetre,
        plane_mm: 10.0,
        max_depth_mm: None,
        background: None,
        flip: [false; 2],
        offset_px: [0.0; 2],
        projection: DepthProjection::Orthographic,
        along: DistanceAlong::Axis,
    };
    let friction = Friction::Coulomb { coefficient: 0.3 };
    let sequences = [None, Some(SequenceSettings { friction, frame_rate_hz: 25.0 })];
    for (sequence, plan) in sequences.into_iter().zip(plans) {
        let mut input = StreamInput::new(bytes, sequence.is_some());
        loop {
            match input.read_message() {
                Ok(None) => break,
                Ok(Some(StreamMessage::Reset)) => assert!(sequence.is_some()),
                Ok(Some(StreamMessage::Frame(Ok(frame)))) => {
                    assert_eq!(frame.known.is_some(), sequence.is_some());
                    assert!(frame.depth.data.len() <= bytes.len() && !frame.depth.data.is_empty());
                }
                Ok(Some(StreamMessage::Frame(Err(problem)))) => assert!(!problem.message.is_empty()),
                Err(reason) => break assert!(!reason.is_empty()),
            }
        }
        let for_size = |size| if size == SIZE { Ok(plan.clone()) } else { Err(Report::from_message("another size")) };
        let answers = AnswerForm::Parts { with_label: true, skips_broken: true };
        let settings = StreamSettings { camera: &camera, sequence, answers };
        let (mut written, mut told) = (Vec::new(), 0);
        let ended = render_stream(bytes, &mut written, &settings, for_size, |_| told += 1);
        let found = answers::answers(&written);
        assert!(found.iter().zip(0..).all(|(answer, number)| answer.frame == number));
        let rendered = found.iter().filter(|answer| answer.status == 0).count();
        match ended {
            Ok(frames) => assert!(frames == found.len() as u64 && (rendered > 0 || frames == 0)),
            Err(StreamError::AllSkipped(frames, _)) => assert!(frames == found.len() as u64 && rendered == 0),
            Err(StreamError::Frame(number, _)) => assert_eq!(number, found.len() as u64),
            Err(other) => panic!("{other:?}"),
        }
        assert!(told < 30);
    }
}

/// A table of poses is refused with a report that can be shown, or says something finite of every frame.
pub fn poses(bytes: &[u8]) {
    let sources =
        ["a", "b"].map(|stem| FrameSource { path: PathBuf::from(stem), stem: stem.to_owned(), message: None });
    match poses_file::parse_poses(Path::new("poses.csv"), bytes, &sources) {
        Err(report) => assert!(report.to_string().contains("error: ")),
        Ok(known) => {
            assert_eq!(known.len(), 2);
            for known in known {
                let q = known.pose.quaternion_xyzw();
                assert!((q.iter().map(|part| part * part).sum::<f64>() - 1.0).abs() < 1e-9, "{q:?}");
                assert!(known.pose.translation_mm.is_finite() && !known.id.is_empty());
                assert!(known.motion.shift_mm.iter().all(|mm| mm.abs() <= 10.0));
            }
        }
    }
}

/// A log is refused with a message of one line, or its messages are: depth images without NaN, cameras and transforms
/// that are finite.
pub fn log(bytes: &[u8]) {
    let log = match Log::from_bytes(bytes.to_vec()) {
        Ok(log) => log,
        Err(problem) => return assert!(!problem.message.contains('\n'), "{problem:?}"),
    };
    assert!(log.losses.iter().all(|loss| loss.at.saturating_add(loss.bytes) <= bytes.len() as u64));
    let counted: u64 = log.topics.iter().map(|topic| topic.count).sum();
    assert!(log.entries.len() as u64 <= counted && !log.describe_topics().contains('\n'));
    for entry in log.entries.iter().take(64) {
        let topic = &log.topics[entry.topic as usize];
        let (Some(kind), Some(serialization)) = (topic.kind, topic.serialization) else { continue };
        let Ok(message) = log.read(entry) else { continue };
        match kind {
            Kind::Image | Kind::CompressedImage => {
                if let Ok((grid, _)) = messages::decode_depth(kind, serialization, &message) {
                    assert_eq!(grid.data.len(), grid.width * grid.height);
                    assert!(grid.data.iter().all(|value| !value.is_nan()));
                }
            }
            Kind::CameraInfo => {
                if let Ok(info) = messages::decode_camera_info(serialization, &message) {
                    assert!(info.focal_px.iter().all(|px| *px > 0.0 && px.is_finite()));
                }
            }
            Kind::PoseStamped | Kind::TransformStamped | Kind::Transforms => {
                for found in messages::decode_transforms(kind, serialization, &message).into_iter().flatten() {
                    let turned = found.transform.inverse().after(found.transform);
                    assert!((turned.rotation.length() - 1.0).abs() < 1e-9);
                }
            }
        }
    }
}
