//! `gelsim render --stream` in named parts: they are to the bit what files hold, a frame that cannot be rendered is
//! answered and changes nothing, and no stream is read ahead of its answers.

use std::io::{Read, Write};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

use gelsim_files::npy;
use proptest::prelude::*;
use proptest::test_runner::{Config, RngAlgorithm, TestRng, TestRunner};
use serde_json::Value;

use crate::fuzz::answers::{Answer, answers};
use crate::support::{Folder, json};

const SIZE: [usize; 2] = [48, 36];
const CAMERA: &str = "--depth-unit mm --plane-mm 10 --sensor gelsight-2014 --set markers.pitch_mm=2.0";

/// An npy file of numbers of 8 bytes.
fn doubles(shape: &str, values: &[f64]) -> Vec<u8> {
    array("<f8", shape, values.iter().flat_map(|value| value.to_le_bytes()).collect())
}

fn array(descr: &str, shape: &str, data: Vec<u8>) -> Vec<u8> {
    let text = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}");
    let mut file = b"\x93NUMPY\x01\x00".to_vec();
    file.extend((text.len() as u16).to_le_bytes());
    file.extend(text.as_bytes());
    file.extend(data);
    file
}

/// Distances to a ball of 4 mm, `deep` mm in the pad, whose middle is at (x, 0.3) mm; 90 mm where nothing is.
fn distances([width, height]: [usize; 2], deep: f64, x: f64) -> Vec<f64> {
    let at = |k: usize, size: usize, mm: f64| (k as f64 + 0.5 - size as f64 / 2.0) * mm / size as f64;
    let pixel = |k: usize| {
        let square = 16.0 - (at(k % width, width, 20.0) - x).powi(2) - (at(k / width, height, 15.0) - 0.3).powi(2);
        if square > 0.0 { 10.0 + 4.0 - deep - square.sqrt() } else { 90.0 }
    };
    (0..width * height).map(pixel).collect()
}

fn ball(deep: f64, x: f64) -> Vec<u8> {
    doubles("(36, 48)", &distances(SIZE, deep, x))
}

fn pose(x: f64) -> Vec<u8> {
    doubles("(7,)", &[0.0, 0.0, 0.0, 1.0, x, 0.3, 3.5])
}

/// What begins another sequence.
fn reset() -> Vec<u8> {
    doubles("(0,)", &[])
}

/// A ball that is pressed, then moved aside.
fn slide() -> [(f64, f64); 5] {
    [(0.2, 0.0), (0.5, 0.0), (0.5, 0.1), (0.5, 0.4), (0.4, 0.9)]
}

fn slide_stream() -> Vec<u8> {
    slide().iter().flat_map(|(deep, x)| [pose(*x), ball(*deep, *x)].concat()).collect()
}

/// The answers of a stream that ends well, and what was said.
fn answered(folder: &Folder, flags: &str, input: Vec<u8>) -> (Vec<Answer>, String) {
    let output = folder.gelsim(&format!("render --stream {CAMERA} {flags}")).write_stdin(input).assert().success();
    let output = output.get_output();
    (answers(&output.stdout), String::from_utf8_lossy(&output.stderr).into_owned())
}

/// Status, answers and messages of a stream.
fn ended(folder: &Folder, flags: &str, input: Vec<u8>) -> (Option<i32>, Vec<Answer>, String) {
    let run = folder.gelsim(&format!("render --stream {CAMERA} {flags}")).write_stdin(input).output();
    let run = run.expect("it runs");
    (run.status.code(), answers(&run.stdout), String::from_utf8_lossy(&run.stderr).into_owned())
}

/// Fails unless the parts of an answer but the label are what the files of a frame hold.
fn assert_parts_are_files(folder: &Folder, answer: &Answer, stem: &str) {
    assert_eq!(answer.status, 0);
    for name in answer.names.iter().filter(|name| *name != "label") {
        let part = &answer.parts[name];
        let (layer, list) = name.split_once('.').unwrap_or((name, ""));
        let file = |ending: &str| folder.read_bytes(&format!("{stem}.{layer}.{ending}"));
        let expected = match (part.type_name.as_str(), part.shape.as_slice()) {
            ("<f4", _) => {
                let bytes = file("npy");
                let (shape, length) = npy::read_announced_shape(&bytes).expect("a header");
                assert_eq!(part.shape, shape, "{name}");
                bytes[bytes.len() - length..].to_vec()
            }
            ("|u1", [36, 48, 3]) => image::load_from_memory(&file("png")).expect("a PNG").to_rgb8().into_raw(),
            ("|u1", [36, 48]) => image::load_from_memory(&file("png")).expect("a PNG").to_luma8().into_raw(),
            ("<f8", [_, 2]) => {
                let lists: Value = serde_json::from_slice(&file("json")).expect("JSON");
                let places: Vec<[f64; 2]> = serde_json::from_value(lists[list].clone()).expect("places");
                assert!(places.len() > 10);
                places.as_flattened().iter().flat_map(|value| value.to_le_bytes()).collect()
            }
            other => panic!("{name} is {other:?}"),
        };
        assert!(part.bytes == expected, "{name} of {stem} differs");
    }
}

/// A label without what a frame is called: in files that is the file's name.
fn without_name(mut label: Value) -> Value {
    (label["object"]["id"], label["objects"][0]["id"]) = (Value::Null, Value::Null);
    label
}

#[test]
fn parts_are_to_the_bit_what_files_hold() {
    let folder = Folder::new();
    std::fs::create_dir(folder.path("frames")).expect("a folder");
    let frames = [ball(0.2, 0.0), ball(0.7, 0.5), ball(-0.3, 0.0), ball(0.5, -1.0)];
    frames.iter().enumerate().for_each(|(k, frame)| folder.write(&format!("frames/{k}.npy"), frame));
    let layers = "depth,surface,contact,normal,pressure,gap,markers,reference,flow,traction,points,instance,untouched";
    folder.succeed(&format!(
        "render --depth frames {CAMERA} --layers {layers} --set output.depth_format=\"npy\" --out out --quiet"
    ));
    let (found, said) = answered(&folder, &format!("--labels --layers {layers}"), frames.concat());
    assert_eq!((found.len(), said.as_str()), (4, "4 frames\n"));
    for (k, answer) in found.iter().enumerate() {
        assert_eq!((answer.frame, answer.sequence), (k as u64, 0));
        assert_eq!((answer.names.len(), answer.names[0].as_str(), answer.names[15].as_str()), (16, "tactile", "label"));
        assert_parts_are_files(&folder, answer, &format!("out/{k}"));
        let mut label = json(&folder, &format!("out/{k}.json"));
        // The files of the layers are told in their own steps; arrays have none.
        label["png16"] = answer.json("label")["png16"].clone();
        assert_eq!(without_name(answer.json("label")), without_name(label), "{k}");
    }
    // The same parts, asked for one by one.
    let (labels, _) = answered(&folder, "--labels", frames.concat());
    let (layer, _) = answered(&folder, "--layers normal", frames.concat());
    for ((all, labels), layer) in found.iter().zip(&labels).zip(&layer) {
        assert_eq!((labels.names.join(" "), layer.names.join(" ")), ("tactile label".into(), "tactile normal".into()));
        for (name, part) in labels.parts.iter().chain(&layer.parts).filter(|(name, _)| *name != "label") {
            assert!(part.bytes == all.parts[name].bytes, "{name}");
        }
    }
    let (none, said) = answered(&folder, "--labels", Vec::new());
    assert_eq!((none.len(), said.as_str()), (0, "0 frames\n"));
}

#[test]
fn pins_have_parts_in_pixels_and_in_millimetres() {
    let folder = Folder::new();
    let nothing = doubles("(48, 64)", &[f64::INFINITY; 48 * 64]);
    let command = "render --stream --depth-unit mm --sensor tactip --layers pins";
    let output = folder.gelsim(command).write_stdin(nothing).assert().success();
    let found = answers(&output.get_output().stdout);
    assert_eq!(found[0].names, ["tactile", "pins.rest_px", "pins.moved_px", "pins.rest_mm", "pins.moved_mm"]);
    let pins = found[0].parts["pins.rest_px"].shape[0];
    assert!(pins > 10);
    for (name, axes) in [("pins.moved_px", 2), ("pins.rest_mm", 3), ("pins.moved_mm", 3)] {
        assert_eq!(found[0].parts[name].shape, [pins, axes]);
    }
    assert!(found[0].parts["pins.rest_mm"].bytes == found[0].parts["pins.moved_mm"].bytes, "nothing presses them");
}

#[test]
fn frames_of_a_sequence_have_wrench_and_slip_and_a_reset_begins_anew() {
    let folder = Folder::new();
    std::fs::create_dir(folder.path("frames")).expect("a folder");
    let mut poses = String::from("file,quaternion_w,quaternion_x,quaternion_y,quaternion_z,x_mm,y_mm,z_mm\n");
    for (k, (deep, x)) in slide().iter().enumerate() {
        folder.write(&format!("frames/{k}.npy"), ball(*deep, *x));
        poses += &format!("{k},1,0,0,0,{x},0.3,3.5\n");
    }
    folder.write("poses.csv", poses);
    let flags = "--sequence 0.3 --layers slip,flow,surface,markers";
    folder.succeed(&format!(
        "render --depth frames {CAMERA} {flags} --poses poses.csv --set output.depth_format=\"npy\" --out out --quiet"
    ));
    let input = [slide_stream(), reset(), slide_stream(), reset(), reset(), slide_stream()].concat();
    let (found, _) = answered(&folder, &format!("{flags} --labels"), input);
    assert_eq!(found.len(), 15);
    let mut states = Vec::new();
    for (k, answer) in found.iter().enumerate() {
        assert_eq!((answer.frame, answer.sequence), (k as u64, [0, 1, 3][k / 5]));
        assert_parts_are_files(&folder, answer, &format!("out/{}", k % 5));
        let label = answer.json("label");
        let row = json(&folder, &format!("out/{}.json", k % 5));
        for key in ["wrench", "slip", "contact", "pose", "health", "numerics", "effects", "markers"] {
            assert_eq!(label[key], row["frame"][key], "{key} of {k}");
        }
        assert_eq!((&label["index"], &label["camera"]), (&(k % 5).into(), &row["camera"]));
        states.push(label["slip"]["state"].as_str().expect("a state").to_owned());
    }
    assert_eq!((states[0].as_str(), states[4].as_str()), ("none", "gross"), "{states:?}");
    assert!(found[4].json("label")["wrench"]["force_n"][0].as_f64() > Some(0.01));
    // A stream of npy images takes a reset as well.
    let plain = folder.gelsim(&format!("render --stream {CAMERA} --sequence 0.3"));
    let input = [slide_stream(), reset(), slide_stream()].concat();
    let output = { plain }.write_stdin(input).assert().success().stderr("10 frames\n");
    let image = 128 + 3 * SIZE[0] * SIZE[1];
    for (k, bytes) in output.get_output().stdout.chunks(image).enumerate() {
        assert!(bytes[128..] == found[k].parts["tactile"].bytes, "{k}");
    }
    // Without --sequence nothing can begin anew.
    let (status, _, said) = ended(&folder, "--labels", [ball(0.5, 0.0), reset()].concat());
    assert!(status == Some(1) && said.contains("frame 1: its array is of shape [0]"), "{said}");
}

/// Frames of which none can be rendered, each with a part of what is said of it.
fn broken_frames() -> Vec<(Vec<u8>, &'static str)> {
    let holes = |count: usize| {
        let mut values = distances(SIZE, 0.5, 0.0);
        values[..count].fill(f64::NAN);
        doubles("(36, 48)", &values)
    };
    vec![
        (holes(3), "3 pixels are no distances"),
        (holes(40), "40 pixels are no distances"),
        (doubles("(36, 48)", &[-1e9; 36 * 48]), "lies behind the pad"),
        (doubles("(48, 36)", &[90.0; 36 * 48]), "it has 36x48 px, and those before it have 48x36"),
        (doubles("(2, 36, 48)", &[90.0; 2 * 36 * 48]), "shape [2, 36, 48]"),
        (doubles("()", &[1.0]), "shape []"),
        (array("<c16", "(36, 48)", vec![0; 16 * 36 * 48]), "of type `<c16`"),
        (array("<U5", "(3,)", vec![0; 60]), "of type `<U5`"),
        (array("|b1", "(36, 48)", vec![1; 36 * 48]), "of type `|b1`"),
    ]
}

#[test]
fn a_skipped_frame_is_answered_and_changes_nothing_else() {
    let folder = Folder::new();
    let good = [ball(0.4, 0.0), ball(0.7, 0.5), ball(0.5, -1.0)];
    let flags = "--labels --layers depth,markers";
    let (whole, _) = answered(&folder, flags, good.concat());
    let broken = broken_frames();
    let all: Vec<u8> = broken.iter().flat_map(|(bytes, _)| bytes.clone()).collect();
    // Before the first, between two, and after the last; some of them often.
    let input = [&broken[0].0[..], &good[0], &all.repeat(7), &good[1], &broken[0].0, &good[2], &all].concat();
    let (found, said) = answered(&folder, &format!("{flags} --on-broken-frame skip"), input);
    let skipped = 8 * broken.len() + 2;
    assert_eq!(found.len(), skipped + 3);
    let rendered: Vec<&Answer> = found.iter().filter(|answer| answer.status == 0).collect();
    assert_eq!(rendered.len(), 3);
    for (answer, alone) in rendered.into_iter().zip(&whole) {
        assert!(
            answer.names == alone.names
                && answer.parts.iter().all(|(name, part)| part.bytes == alone.parts[name].bytes)
        );
    }
    for (number, answer) in found.iter().enumerate() {
        assert_eq!(answer.frame, number as u64);
    }
    for (answer, (_, words)) in found[2..].iter().zip(&broken) {
        let problem = answer.json("problem");
        assert!(answer.status == 1 && answer.names == ["problem"]);
        assert!(problem["message"].as_str().is_some_and(|message| message.contains(words)), "{problem}: {words}");
    }
    // Once for each cause, whatever its numbers.
    assert_eq!(said.matches(" is skipped: ").count(), broken.len() - 1, "{said}");
    assert_eq!(said.matches("pixels are no distances").count(), 1, "{said}");
    assert!(said.contains(&format!("warning: skipped frames: {skipped} (18 like frame 0, ")), "{said}");
    // Without the flag the first of them ends the stream, and what came before stays.
    for (bytes, words) in &broken {
        let (status, found, said) = ended(&folder, flags, [&good[0][..], bytes, &good[1]].concat());
        assert!(status == Some(1) && found.len() == 1 && said.contains("error: frame 1: "), "{said}");
        assert!(said.contains(words), "{words}: {said}");
    }
}

#[test]
fn a_skipped_frame_leaves_a_sequence_as_it_was() {
    let folder = Folder::new();
    let flags = "--sequence 0.3 --labels --layers slip,flow";
    let (whole, _) = answered(&folder, flags, slide_stream());
    let turned = doubles("(7,)", &[0.0, 0.0, 0.5, 0.75_f64.sqrt(), 0.0, 0.3, 3.5]);
    let mut broken: Vec<(Vec<u8>, &str)> =
        broken_frames().into_iter().map(|(frame, words)| ([pose(0.7), frame].concat(), words)).collect();
    for (bytes, words) in [
        (doubles("(7,)", &[0.0, 0.0, 0.0, 2.0, 0.0, 0.3, 3.5]), "its pose's quaternion has length 2, not 1"),
        (doubles("(7,)", &[0.0, 0.0, 0.0, 1.0, 0.0, 0.3, f64::NAN]), "a number of it is not finite"),
        (doubles("(4, 4)", &[0.0; 16]), "its pose has the shape [4, 4], not (7,)"),
        (array("|S9", "(7,)", vec![b'a'; 63]), "of type `|S9`"),
        (turned, "the object turns by 60.0 degrees since the frame before"),
        (doubles("(7,)", &[0.0, 0.0, 0.0, 1.0, 0.0, -5e170, 3.5]), "the object is 5e170 mm away from the sensor"),
    ] {
        broken.push(([bytes, ball(0.5, 0.7)].concat(), words));
    }
    let mut input = Vec::new();
    for (k, (deep, x)) in slide().iter().enumerate() {
        input.extend([pose(*x), ball(*deep, *x)].concat());
        if k < 4 {
            broken.iter().for_each(|(bytes, _)| input.extend(bytes));
        }
    }
    let (found, said) = answered(&folder, &format!("{flags} --on-broken-frame skip"), input);
    assert_eq!(found.len(), 5 + 4 * broken.len());
    for (at, (_, words)) in broken.iter().enumerate() {
        let problem = found[1 + at].json("problem");
        assert!(problem["message"].as_str().is_some_and(|message| message.contains(words)), "{problem}: {words}");
    }
    for (k, alone) in whole.iter().enumerate() {
        let answer = &found[k * (1 + broken.len())];
        assert!(answer.status == 0 && answer.names == alone.names, "{said}");
        assert!(answer.parts.iter().all(|(name, part)| part.bytes == alone.parts[name].bytes), "{k}");
    }
}

#[test]
fn a_stream_that_is_lost_ends_even_where_broken_frames_are_skipped() {
    let folder = Folder::new();
    let flags = "--labels --on-broken-frame skip";
    let good = ball(0.5, 0.0);
    let huge = array("<c16", "(99999, 99999)", Vec::new());
    for (bytes, number, words) in [
        (b"more than that".to_vec(), 1, "no npy file begins where it should"),
        (good[..good.len() - 1].to_vec(), 1, "the input ends within it, after "),
        (good[..7].to_vec(), 1, "the input ends within it, after 7 bytes"),
        (broken_frames()[6].0[..500].to_vec(), 2, "the input ends within the array before it"),
        (array("|O", "(36, 48)", vec![0; 900]), 1, "of type `|O`"),
        (array("<f4", "(36, -48)", vec![0; 900]), 1, "its shape is no list"),
        (huge, 1, "of type `<c16`"),
        (b"\x93NUMPY\x02\x00\xff\xff\xff\xff".to_vec(), 1, "its header claims 4294967295 bytes"),
    ] {
        let (status, found, said) = ended(&folder, flags, [&good, &bytes[..]].concat());
        assert_eq!((status, found.len()), (Some(1), number), "{said}");
        assert!(said.contains(&format!("error: frame {number}: ")) && said.contains(words), "{words}: {said}");
    }
    let flags = format!("{flags} --sequence 0.3");
    for (bytes, words) in [
        (ball(0.5, 0.0), "a pose stands before each frame, and their order is lost"),
        ([pose(0.0), pose(0.0)].concat(), "a pose stands before each frame, and their order is lost"),
        ([pose(0.0), reset()].concat(), "a pose stands before each frame, and their order is lost"),
        (pose(0.0), "the input ends after its pose"),
        ([pose(0.0), good[..80].to_vec()].concat(), "the input ends within it, after"),
    ] {
        let (status, found, said) = ended(&folder, &flags, [pose(0.0), good.clone(), bytes].concat());
        assert_eq!((status, found.len()), (Some(1), 1), "{said}");
        assert!(said.contains("error: frame 1: ") && said.contains(words), "{words}: {said}");
    }
}

#[test]
fn what_nothing_came_of_does_not_end_well() {
    let folder = Folder::new();
    let skip = "--labels --on-broken-frame skip";
    let (status, found, said) = ended(&folder, skip, broken_frames()[0].0.repeat(3));
    assert_eq!((status, found.len()), (Some(1), 3));
    assert!(said.contains("error: 3 frames and none to render: 3 pixels are no distances"), "{said}");
    // Mistakes on the command line are told before anything is read.
    for (flags, words) in [
        ("--on-broken-frame skip", "add --labels or --layers"),
        ("--labels --layers slip", "slip"),
        ("--labels --layers lamps", "no lamps"),
        ("--labels --layers depht", "depht"),
    ] {
        let said = folder.fail(&format!("render --stream {CAMERA} {flags}"), 2);
        assert!(said.contains(words), "{words}: {said}");
    }
    for flags in ["--labels", "--on-broken-frame skip"] {
        let said = folder.fail(&format!("render --depth cube.npy {CAMERA} --out out {flags}"), 2);
        assert!(said.contains("cannot be used with"), "{said}");
    }
}

/// The command with pipes, and an input and an output of it.
fn piped(flags: &str) -> std::process::Child {
    let mut command = Command::new(env!("CARGO_BIN_EXE_gelsim"));
    command.args("render --stream --quiet".split(' ')).args(CAMERA.split(' ')).args(flags.split(' '));
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("the command starts")
}

#[test]
fn a_reader_that_closes_ends_the_stream_without_an_error() {
    for flags in ["--fidelity draft", "--fidelity draft --labels --layers depth,normal,points"] {
        let mut process = piped(flags);
        let (mut input, mut output) = (process.stdin.take().expect("a pipe"), process.stdout.take().expect("a pipe"));
        let feeder = thread::spawn(move || while input.write_all(&ball(0.5, 0.0)).is_ok() {});
        output.read_exact(&mut [0; 4000]).expect("the beginning of an answer");
        drop(output);
        let ended = process.wait_with_output().expect("it ends");
        feeder.join().expect("no panic");
        assert!(ended.status.success(), "{ended:?}");
        assert_eq!(String::from_utf8_lossy(&ended.stderr), "");
    }
}

/// How far the command is ahead of its reader is what the two pipes hold, and never more, whenever one looks.
#[test]
#[cfg(target_os = "linux")]
fn no_frame_is_taken_long_before_the_answer_to_the_one_before_is_read() {
    const FRAMES: usize = 120;
    /// Bytes that a pipe holds.
    const PIPE: usize = 1 << 16;
    let size = [128, 96];
    let frame = doubles("(96, 128)", &distances(size, 0.5, 0.0));
    let mut process = piped("--fidelity draft --labels --layers depth,normal");
    let (mut input, mut output) = (process.stdin.take().expect("a pipe"), process.stdout.take().expect("a pipe"));
    // An answer is longer than a pipe: beside it there are the frame that is rendered, and those in the pipe before it.
    let ahead = 2 + PIPE / frame.len() + 1;
    let sent = AtomicUsize::new(0);
    thread::scope(|scope| {
        let feeder = scope.spawn(|| {
            for _ in 0..FRAMES {
                input.write_all(&frame).expect("the command reads");
                sent.fetch_add(1, Ordering::SeqCst);
            }
            drop(input);
        });
        let mut header = [0; 32];
        for read in 0..FRAMES {
            if read < 20 {
                // A slow reader, for which a greedy command had time.
                thread::sleep(std::time::Duration::from_millis(10));
            }
            let sent = sent.load(Ordering::SeqCst);
            assert!(sent <= read + ahead, "{sent} frames were taken before answer {read} was read");
            output.read_exact(&mut header).expect("an answer");
            let length = u64::from_le_bytes(header[24..].try_into().expect("eight bytes")) as usize;
            assert!(length > PIPE);
            output.read_exact(&mut vec![0; length]).expect("its parts");
        }
        feeder.join().expect("no panic");
    });
    assert!(process.wait().expect("it ends").success());
}

/// Streams that were damaged: the command ends in order, says why if it does not end well, and never ends well for
/// nothing.
#[test]
fn a_damaged_stream_ends_in_order() {
    let folder = Folder::new();
    let small = |deep: f64| doubles("(6, 8)", &distances([8, 6], deep, 0.0));
    let frames = [small(0.5), small(0.7), small(0.3)].concat();
    let sequence = [pose(0.0), small(0.5), pose(0.1), small(0.5), reset(), pose(0.0), small(0.4)].concat();
    let config = Config { cases: 24, failure_persistence: None, ..Config::default() };
    let mut runner = TestRunner::new_with_rng(config, TestRng::deterministic_rng(RngAlgorithm::ChaCha));
    let inputs = crate::fuzz::damaged(vec![frames, sequence]);
    let outcome = runner.run(&inputs, |bytes| {
        for flags in ["--labels", "--labels --on-broken-frame skip", "--labels --sequence 0.3 --on-broken-frame skip"] {
            let (status, found, said) = ended(&folder, &format!("{flags} --fidelity draft"), bytes.clone());
            let rendered = found.iter().filter(|answer| answer.status == 0).count();
            match status {
                Some(0) => prop_assert!(rendered > 0 || bytes.is_empty() || said == "0 frames\n", "{said}"),
                Some(1 | 2) => prop_assert!(said.contains("error: "), "{said}"),
                other => prop_assert!(false, "{other:?}: {said}"),
            }
        }
        Ok(())
    });
    outcome.unwrap_or_else(|failure| panic!("{failure}"));
}
