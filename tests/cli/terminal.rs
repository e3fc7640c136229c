//! What a person sees at a terminal of 40, 80 and 120 columns: errors, notes, results, progress and help of every command;
//! and what they see of colours where they want none.

use crate::pty::{Shown, Terminal};
use crate::support::{Folder, JOB, edited, repository};

const WIDTHS: [u16; 3] = [40, 80, 120];

/// Every command that `gelsim --help` lists, beside `help` itself.
fn list_commands(folder: &Folder) -> Vec<String> {
    let help = Terminal::of(80).run(folder, "--help");
    assert!(help.text().starts_with("Generate synthetic datasets"), "{}", help.text());
    let rows = help.rows.iter().skip_while(|row| *row != "Commands:").skip(1).take_while(|row| !row.is_empty());
    let names = rows.filter(|row| !row.starts_with("   ")).filter_map(|row| row.split_whitespace().next());
    let commands: Vec<String> = names.filter(|name| *name != "help").map(str::to_owned).collect();
    assert!(commands.iter().any(|name| name == "generate"), "{}", help.text());
    commands
}

/// Ways in which a terminal or its user wants no colours.
const PLAIN: [&[(&str, &str)]; 3] = [&[("NO_COLOR", "1")], &[("TERM", "dumb")], &[("CLICOLOR", "0")]];

#[test]
fn help_fits_the_terminal() {
    let folder = Folder::new();
    for command in list_commands(&folder) {
        for columns in WIDTHS {
            for flag in ["--help", "-h"] {
                let help = Terminal::of(columns).run(&folder, &format!("{command} {flag}"));
                help.assert_unbroken(columns);
                assert_eq!(help.status, 0, "{}", help.text());
                assert!(help.is_styled() && help.text().contains("Usage: gelsim"), "{}", help.text());
            }
        }
        for env in PLAIN {
            let help = Terminal::with(80, env).run(&folder, &format!("{command} --help"));
            assert!(!help.raw.contains('\u{1b}'), "{env:?}: {}", help.raw);
        }
    }
}

#[test]
fn examples_in_help_stand_on_one_line_of_80_columns_and_sentences_are_not_broken_by_hand() {
    let folder = Folder::new();
    for command in list_commands(&folder) {
        let help = Terminal::of(80).run(&folder, &format!("{command} --help"));
        let mut rows = help.rows.iter().skip_while(|row| *row != "Example:").skip(1).peekable();
        assert!(rows.peek().is_some(), "{command} has an example");
        let mut goes_on = false;
        for row in rows.by_ref().take_while(|row| !row.is_empty()) {
            assert!(goes_on || row.starts_with("  gelsim "), "{command}: {row:?} goes on from the row before");
            // As a shell takes it.
            goes_on = row.ends_with('\\');
        }
        // A paragraph fills its rows: the first word of a row would not have fitted on the one before.
        for pair in help.rows.windows(2).filter(|pair| !pair[0].is_empty() && !pair[1].is_empty()) {
            let indent = |row: &str| row.len() - row.trim_start().len();
            if indent(&pair[0]) != indent(&pair[1]) || indent(&pair[0]) == 2 || pair[1].trim_start().starts_with('[') {
                continue;
            }
            let first = pair[1].split_whitespace().next().unwrap_or_default();
            let is_list = first.starts_with('-') || pair[0].trim_start().starts_with('-');
            assert!(is_list || pair[0].len() + 1 + first.len() > 80, "{command}: {pair:#?}");
        }
    }
}

/// A folder with what the commands below want.
fn folder_of_commands() -> Folder {
    let folder = Folder::with_job(JOB);
    folder.succeed("generate job.toml --out set --quiet");
    folder.write("typo.toml", edited(JOB, &[("seed = 7", "sede = 7"), ("\"cube.obj\"", "\"objects/cubus.obj\"")]));
    folder.write("typo-augment.toml", "seed = 1\n[input]\npath = \"nowhere\"\n");
    folder.write("presses.csv", "file,centre_x_px,centre_y_px,radius_px,ball_radius_mm\nno.png,1,2,3,4\n");
    let image = image::RgbImage::from_pixel(48, 36, image::Rgb([90, 100, 110]));
    image.save(folder.path("untouched.png")).expect("a picture");
    folder
}

/// An error of every command.
const ERRORS: [(&str, &str); 17] = [
    ("generate typo.toml", "unknown key `sede`"),
    ("plan typo.toml", "unknown key `sede`"),
    ("tradeoff typo.toml", "unknown key `sede`"),
    ("compare nowhere set", "nowhere"),
    ("verify nowhere", "nowhere"),
    ("finalize nowhere", "nowhere"),
    ("reproduce set 99", "there is no sample 99"),
    ("preview typo.toml --out sheet.png", "unknown key `sede`"),
    ("report nowhere", "nowhere"),
    ("calibrate presses.csv --background untouched.png --out mine.toml", "no.png"),
    ("render --depth no.npy --depth-unit m --plane-mm 10 --sensor digit --out frames", "no.npy"),
    ("augment typo-augment.toml", "nowhere"),
    ("inspect cube.obj --sensor gelsight-9", "gelsight-9"),
    ("init job.toml", "job.toml exists already"),
    ("list everything", "everything"),
    ("schema everything", "everything"),
    ("completions everything", "everything"),
];

#[test]
fn errors_fit_the_terminal_and_have_colours_where_they_are_wanted() {
    let folder = folder_of_commands();
    for (arguments, words) in ERRORS {
        for columns in WIDTHS {
            let shown = Terminal::of(columns).run(&folder, arguments);
            shown.assert_unbroken(columns);
            assert_eq!(shown.status, 2, "{arguments}: {}", shown.text());
            assert!(shown.is_styled() && shown.flat().contains("error: "), "{arguments}: {}", shown.raw);
            assert!(shown.flat().contains(words), "{words:?}: {}", shown.text());
        }
        for env in PLAIN {
            let shown = Terminal::with(80, env).run(&folder, arguments);
            assert!(!shown.raw.contains('\u{1b}') && shown.flat().contains(words), "{env:?}: {}", shown.raw);
        }
        // Piped there are none, and every line is as long as it is; unless they are asked for.
        let piped = folder.gelsim(arguments).output().expect("it starts").stderr;
        assert!(!piped.contains(&0x1b), "{}", String::from_utf8_lossy(&piped));
        let forced = folder.gelsim(arguments).env("CLICOLOR_FORCE", "1").output().expect("it starts").stderr;
        assert!(forced.contains(&0x1b), "{}", String::from_utf8_lossy(&forced));
    }
}

#[test]
fn an_escape_in_what_a_user_wrote_is_shown_and_not_obeyed() {
    let folder = Folder::with_job(&edited(JOB, &[("name = \"small\"", "name = \"\\u001b[31mred\"")]));
    let shown = Terminal::of(80).run(&folder, "plan job.toml");
    assert!(shown.text().contains("\\u001b[31mred") && !shown.raw.contains("\u{1b}[31mred"), "{}", shown.raw);
}

#[test]
fn notes_and_results_fit_the_terminal() {
    let folder = folder_of_commands();
    folder.write("deep.toml", edited(JOB, &[("{ log_uniform = [0.3, 1.2] }", "2.0")]));
    let depth: Vec<u8> = std::iter::repeat_n(9.5_f32.to_le_bytes(), 48 * 36).flatten().collect();
    let head = "{'descr': '<f4', 'fortran_order': False, 'shape': (36, 48), }";
    let padded = format!("{head:<117}\n");
    folder.write("frame.npy", [b"\x93NUMPY\x01\x00\x76\x00".as_slice(), padded.as_bytes(), &depth].concat());
    // A note, and what each command prints if all is well.
    let results = [
        ("plan deep.toml", "note: indentation.depth_mm may be 2"),
        ("generate deep.toml --overwrite", "note: indentation.depth_mm may be 2"),
        ("preview deep.toml --out sheet.png --count 2", "note: indentation.depth_mm may be 2"),
        // With a friction that finite strain, which takes seconds, knows nothing of.
        (
            "tradeoff deep.toml --samples 1 --set gelpad.elastic.friction={coulomb={coefficient=0.5}} --out tradeoff",
            "note: indentation.depth_mm may be 2",
        ),
        ("render --depth frame.npy --depth-unit mm --plane-mm 10 --sensor digit --out frames", "warning: pixels are"),
        ("compare set set --out compared", "only the sets are compared"),
        ("verify set", "valid and complete"),
        ("finalize set", "finalized"),
        ("reproduce set 1", "the same sample"),
        ("report set --out report.html", "report.html"),
        ("inspect cube.obj cone.obj", "2 meshes: 2 ok"),
        ("inspect .", "2 meshes: 2 ok"),
        ("init new.toml --objects .", "wrote new.toml"),
        ("list sensors", "gelsight-mini"),
        ("list levels", "standard"),
        ("list effects", "shadows"),
        ("list objects", "objects/cube.obj"),
        ("list layers", "surface"),
    ];
    for (arguments, words) in results {
        for columns in WIDTHS {
            if arguments.starts_with("init") {
                let _ = std::fs::remove_file(folder.path("new.toml"));
            }
            let shown = Terminal::of(columns).run(&folder, arguments);
            assert_eq!(shown.status, 0, "{arguments}: {}", shown.text());
            assert!(shown.flat().contains(words), "{words:?}: {}", shown.text());
            shown.assert_unbroken(columns);
        }
    }
}

#[test]
fn what_programs_read_is_the_same_at_a_terminal_as_in_a_file() {
    let folder = folder_of_commands();
    for arguments in
        ["init", "init --objects .", "schema job", "completions bash", "list levels --json", "inspect cube.obj --json"]
    {
        let file = folder.gelsim(arguments).output().expect("it starts").stdout;
        let shown = Terminal::of(WIDTHS[0]).run(&folder, arguments);
        let text = String::from_utf8(file).expect("text");
        assert!(shown.raw.replace("\r\n", "\n").contains(&text), "{arguments}: {}", shown.raw);
    }
}

/// Fails unless a bar was drawn within the terminal, and is gone.
fn assert_drawn(shown: &Shown, columns: u16, what: &str) {
    assert_eq!(shown.status, 0, "{}", shown.text());
    let frames: Vec<&str> = shown.raw.split('\r').filter(|frame| frame.contains(['░', '█'])).collect();
    assert!(!frames.is_empty(), "{what} draws a bar: {:?}", shown.raw);
    for frame in frames {
        let mut line = vt100::Parser::new(4, columns, 0);
        line.process(frame.as_bytes());
        assert!(!line.screen().row_wrapped(0), "{columns} columns break {frame:?}");
    }
    assert!(!shown.text().contains(['░', '█']), "{}", shown.text());
}

#[test]
fn events_are_one_line_each_for_programs_also_on_a_terminal() {
    let folder = Folder::with_job(JOB);
    for (arguments, status) in
        [("generate job.toml --log-format json", 0), ("generate job.toml --threads 0 --log-format json", 2)]
    {
        let shown = Terminal::of(WIDTHS[0]).run(&folder, arguments);
        assert_eq!(shown.status, status);
        let lines: Vec<&str> = shown.raw.lines().filter(|line| !line.trim().is_empty()).collect();
        assert!(!lines.is_empty());
        for line in lines {
            let event: serde_json::Value = serde_json::from_str(line).unwrap_or_else(|error| panic!("{error}: {line}"));
            assert!(event["event"].is_string(), "{line}");
        }
    }
}

#[test]
fn progress_is_a_bar_within_the_terminal_and_nothing_on_a_dumb_one() {
    let folder = Folder::with_job(&edited(JOB, &[("samples = 8", "samples = 400")]));
    let meshes = folder.path("meshes");
    std::fs::create_dir(&meshes).expect("a folder");
    for k in 0..6 {
        std::fs::copy(repository().join("objects/dots.obj"), meshes.join(format!("{k}.obj"))).expect("a copy");
    }
    for columns in WIDTHS {
        for arguments in ["generate job.toml --out set --overwrite", "inspect meshes"] {
            assert_drawn(&Terminal::of(columns).run(&folder, arguments), columns, arguments);
        }
    }
    let presses = super::calibrate::good();
    let fit = "calibrate presses.csv --background rest.png --out out/mine.toml --steps 20 --contact-over-disc 0.95 --keep-anyway";
    assert_drawn(&Terminal::of(WIDTHS[0]).run(&presses, fit), WIDTHS[0], fit);
    let shown = Terminal::with(80, &[("TERM", "dumb")]).run(&folder, "generate job.toml --out set --overwrite");
    assert!(!shown.raw.contains(['\u{1b}', '░', '█']), "{:?}", shown.raw);
    let quiet = Terminal::of(80).run(&folder, "generate job.toml --out set --overwrite --quiet");
    assert_eq!(quiet.raw, "");
}
