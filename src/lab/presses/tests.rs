//! Tables as people and their programs write them, and as they should not.

use proptest::prelude::*;

use super::*;

fn table(text: &str) -> PressTable {
    parse(Path::new("real/a.csv"), text.as_bytes()).unwrap_or_else(|report| panic!("{text:?}: {report}"))
}

fn refused(text: &[u8]) -> String {
    parse(Path::new("a.csv"), text).map(|table| table.presses).expect_err("a mistake").to_string()
}

const TABLE: &str = "\
note,radius_px,file,src_radius_px,mm_per_px,centre_y_px,centre_x_px,ball_radius_mm
\"left, \"\"dark\"\"\",59,images/2.png,,0.0295,302,-1.5e1,2
,,../3 b.png,half,,,,
";

#[test]
fn columns_stand_in_any_order_and_unknown_ones_are_passed_over() {
    let presses = table(TABLE).presses;
    let full = PressRow {
        file: String::from("images/2.png"),
        path: PathBuf::from("real/images/2.png"),
        line: 2,
        circle: Some(Circle { centre_px: [-15.0, 302.0], radius_px: 59.0 }),
        ball_radius_mm: Some(2.0),
        mm_per_px: Some([0.0295; 2]),
    };
    let bare = PressRow {
        file: String::from("../3 b.png"),
        path: PathBuf::from("real/../3 b.png"),
        line: 3,
        circle: None,
        ball_radius_mm: None,
        mm_per_px: None,
    };
    assert_eq!(presses, [full, bare]);
    assert_eq!(table("file\n/tmp/x.png").presses[0].path, Path::new("/tmp/x.png"));
}

#[test]
fn spellings_line_ends_marks_and_empty_lines_make_no_difference() {
    let expected = table(TABLE).presses;
    let variants = [
        TABLE.replace("centre", "center"),
        TABLE.replace('\n', "\r\n"),
        TABLE.replace('\n', "\r"),
        TABLE.replace(',', " , ").replace("left , ", "left, ").replace(" \"left", "\"left"),
        format!("\u{feff}{TABLE}"),
        TABLE.trim_end().to_owned(),
        TABLE.replace("images/2.png", "\"images/2.png\""),
    ];
    for text in variants {
        assert_eq!(table(&text).presses, expected, "{text:?}");
    }
    let spread = table(&format!("\n\n{}\n\n", TABLE.replace('\n', "\n\n"))).presses;
    assert_eq!(spread.iter().map(|press| press.line).collect::<Vec<_>>(), [5, 7]);
}

#[test]
fn all_mistakes_are_said_at_once_each_with_its_place_and_a_way_out() {
    let text = "\
file,centre_x_px,centre_y_px,radius_px,ball_radius_mm,mm_per_px,note
1.png,1,2,3,\"2,5\",0.1,
2.png,1,2,0,-1,0,
3.png,,2,3,2,0.1,
,1,2,3,2,0.1,
./1.png,1,2,3,2,0.1,
4.png,1,2,3
5.png,nan,inf,1e999,2 mm,0.1,\"a, b\"
6.png,1,2,3,2,0.1,a, b
";
    let shown = refused(text.as_bytes());
    for (place, what, help) in [
        ("2:13", "2 rows have a `ball_radius_mm` that is no number: line 2 (2,5), line 8 (2 mm)", "with a point: 1.5"),
        ("3:11", "`radius_px` is 0; it must be above 0", "leave the three cells of the circle empty"),
        ("3:13", "`ball_radius_mm` is -1; it must be above 0", "write a number above 0"),
        ("3:16", "`mm_per_px` is 0; it must be above 0", "write a number above 0"),
        ("4:8", "half a circle: centre_x_px is empty", "give all three or none"),
        ("5:1", "`file` is empty", "name the image"),
        ("6:1", "`./1.png` is on line 2, too", "keep one"),
        ("7:1", "2 rows have more or fewer cells than there are columns (7): line 7 (4), line 9 (8)", "in quotes"),
        ("8:7", "`centre_x_px` is nan; it must be finite", "leave the three cells of the circle empty"),
        ("8:11", "`centre_y_px` is inf; it must be finite", "leave the three cells of the circle empty"),
        ("8:15", "`radius_px` is 1e999; it must be finite", "leave the three cells of the circle empty"),
    ] {
        let paragraph = shown
            .split("\n\n")
            .find(|paragraph| paragraph.contains(&format!("a.csv:{place}\n")) && paragraph.contains(what));
        assert!(paragraph.is_some_and(|paragraph| paragraph.contains(help)), "{place} {what}\n{shown}");
    }
    assert_eq!(shown.matches("error: ").count(), 11, "{shown}");
}

#[test]
fn what_is_wrong_with_the_whole_table_is_said_once() {
    for (text, what) in [
        (&b""[..], "the table is empty"),
        (b"\n\n", "the table is empty"),
        (b"file,radius_px,centre_x_px,centre_y_px\n", "no row follows"),
        (b"file;radius_px\na.png;3", "separated by semicolons instead of commas"),
        (b"file\tradius_px\na.png\t3", "separated by tabs instead of commas"),
        (b"fil,radius_px\na.png,3\n", "is `fil` meant? columns that are read: `file`, `centre_x_px`"),
        (b"file,center_x,centre_y_px,radius_px\na,1,2,3\n", "half a circle: no column is called `centre_x_px`"),
        (b"file,center_x,centre_y_px,radius_px\na,1,2,3\n", "is `centre_x` meant?"),
        (b"file,note,file\na,b,c\n", "a.csv:1:11"),
        (b"file,center_x_px,centre_x_px,centre_y_px,radius_px\na,1,1,1,1", "the column `centre_x_px` is there twice"),
        (b"file,note\r\na.png,caf\xe9\r\n", "a.csv:2:10"),
        (b"file,note\na.png,\"open\nb.png,x\n", "a.csv:2:7"),
    ] {
        let shown = refused(text);
        assert!(shown.contains(what) && shown.matches("error: ").count() == 1, "{what}\n{shown}");
    }
}

#[test]
fn a_table_of_too_many_rows_or_bytes_is_refused() {
    let rows: String = (0..=MAX_PRESSES).map(|row| format!("{row}\n")).collect();
    assert!(refused(format!("file\n{rows}").as_bytes()).contains("a.csv:100002:1"));
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.csv");
    std::fs::File::create(&path).and_then(|file| file.set_len(MAX_BYTES + 1)).expect("a sparse file");
    assert!(read(&path).expect_err("too large").to_string().contains("larger than 16 MB"));
    assert!(read(&folder.path().join("none.csv")).expect_err("absent").to_string().contains("cannot read the table"));
}

#[test]
fn a_mistake_found_later_names_its_row() {
    let table = table(TABLE);
    let mut problems = Diagnostics::default();
    problems.push(table.row_problem(3, "the image is saturated"));
    let shown = table.report(&problems).to_string();
    assert!(shown.contains("real/a.csv:3:1") && shown.contains("the image is saturated"), "{shown}");
    problems.push(table.row_problem(u64::MAX, "no such line"));
    assert!(table.report(&problems).to_string().contains("no such line"));
}

proptest! {
    #[test]
    fn any_bytes_are_read_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        if let Err(report) = parse(Path::new("a.csv"), &bytes) {
            prop_assert!(report.to_string().contains("error: "));
        }
    }

    #[test]
    fn any_cells_are_read_or_refused(cells in "[file,\"\r\n\t;0-9.a\u{e4}-]{0,80}") {
        if let Ok(table) = parse(Path::new("a.csv"), format!("file,radius_px,note\n{cells}").as_bytes()) {
            prop_assert!(!table.presses.is_empty());
        }
    }

    #[test]
    fn a_table_that_is_written_reads_the_same(
        rows in prop::collection::vec(
            (
                "[a-z\"é, ]{0,6}",
                any::<Option<(f64, f64, f64)>>(),
                any::<Option<f64>>(),
                any::<Option<(f64, f64)>>(),
            ),
            1..8,
        )
    ) {
        let mut writer = csv::Writer::from_writer(Vec::new());
        writer.write_record(COLUMNS.iter().filter(|name| **name != "mm_per_px")).expect("memory");
        let size = |x: f64| if x.is_finite() && x != 0.0 { x.abs() } else { 1.0 };
        let place = |x: f64| if x.is_finite() { x } else { 0.0 };
        let mut expected = Vec::new();
        for (row, (name, circle, ball, pixel_size)) in (0..).zip(rows) {
            let press = PressRow {
                file: format!("{row}{name}.png"),
                path: PathBuf::from(format!("{row}{name}.png")),
                line: row + 2,
                circle: circle.map(|(x, y, r)| Circle { centre_px: [place(x), place(y)], radius_px: size(r) }),
                ball_radius_mm: ball.map(size),
                mm_per_px: pixel_size.map(|(x, y)| [x, y].map(size)),
            };
            let text = |value: Option<f64>| value.map_or(String::new(), |value| value.to_string());
            let value = |k: usize| press.circle.map(|c| [c.centre_px[0], c.centre_px[1], c.radius_px][k]);
            let [x, y, r] = [0, 1, 2].map(value);
            let [width, height] = [0, 1].map(|k| press.mm_per_px.map(|size| size[k]));
            let [ball, width, height] = [press.ball_radius_mm, width, height].map(text);
            let cells = [press.file.clone(), text(x), text(y), text(r), ball, width, height];
            writer.write_record(cells).expect("memory");
            expected.push(press);
        }
        let bytes = writer.into_inner().expect("memory");
        prop_assert_eq!(parse(Path::new("a.csv"), &bytes).expect("a table").presses, expected);
    }
}
