use super::*;
use crate::mesh::tests::{CORNERS, cube_dae};

fn edited(from: &str, to: &str) -> String {
    let text = String::from_utf8(cube_dae()).unwrap();
    assert_eq!(text.matches(from).count(), 1, "{from}");
    text.replace(from, to)
}

fn read_text(text: &str) -> RawMesh {
    read(text.as_bytes()).unwrap_or_else(|error| panic!("{error}"))
}

#[test]
fn transforms_are_taken_one_after_the_other() {
    let node = r##"<node name="lid"><translate>1 2 3</translate><rotate>0 0 1 90</rotate><scale>2 2 2</scale>
        <node><matrix>1 0 0 10  0 1 0 0  0 0 1 0  0 0 0 1</matrix><instance_geometry url="#g"/></node></node>"##;
    let raw = read_text(&edited(r##"<node name="lid"><instance_geometry url="#g"/></node>"##, node));
    let [x, y, z] = CORNERS[2].map(f64::from);
    let expected = [1.0 - 2.0 * y, 2.0 + 2.0 * (x + 10.0), 3.0 + 2.0 * z];
    assert!((0..3).all(|k| (raw.vertices[2][k] - expected[k]).abs() < 1e-9), "{:?} {expected:?}", raw.vertices[2]);
}

#[test]
fn nodes_of_a_library_and_geometries_without_a_scene_are_read() {
    let library = r##"<library_nodes><node id="n"><translate>5 0 0</translate><instance_geometry url="#g"/></node></library_nodes>
<library_visual_scenes>"##;
    let text = edited("<library_visual_scenes>", library).replace(
        r##"<node name="lid"><instance_geometry url="#g"/></node>"##,
        r##"<node><instance_node url="#n"/></node>"##,
    );
    assert_eq!(read_text(&text).vertices[0][0], 5.0 + f64::from(CORNERS[0][0]));
    let bare = edited(r##"<scene><instance_visual_scene url="#s"/></scene>"##, "");
    assert_eq!(read_text(&bare).triangles.len(), 12);
}

#[test]
fn triangles_strips_fans_and_polygons_are_read() {
    let text = String::from_utf8(cube_dae()).unwrap();
    let (start, end) = (text.find("<polylist").unwrap(), text.find("</polylist>").unwrap() + "</polylist>".len());
    let of = |kind: &str, p: &str| {
        let element = format!(r##"<{kind} count="1"><input semantic="VERTEX" source="#v" offset="0"/>{p}</{kind}>"##);
        read_text(&format!("{}{element}{}", &text[..start], &text[end..])).triangles
    };
    assert_eq!(of("triangles", "<p>0 1 2 2 3 0</p>"), [[0, 1, 2], [2, 3, 0]]);
    assert_eq!(of("polygons", "<p>0 3 2 1</p><p>4 5 6</p>"), [[0, 3, 2], [0, 2, 1], [4, 5, 6]]);
    assert_eq!(of("tristrips", "<p>0 1 2 3</p>"), [[0, 1, 2], [2, 1, 3]]);
    assert_eq!(of("trifans", "<p>0 1 2 3</p>"), [[0, 1, 2], [0, 2, 3]]);
}

#[test]
fn errors_name_the_line() {
    for (text, expected) in [
        (edited("url=\"#g\"", "url=\"#h\""), "line 11: nothing has the id `h`"),
        (edited("url=\"#g\"", "url=\"b.dae#g\""), "line 11: names another file, `b.dae#g`"),
        (edited("<vcount>4 4", "<vcount>4 4 4"), "line 9: <vcount> has more corners than <p>"),
        (edited("<vcount>4 4", "<vcount>4 x"), "line 9: `x` is not a number that belongs there"),
        (edited("<p>0 0", "<p>8 0"), "line 9: face refers to vertex 8, but the file has 8 in this geometry"),
        (edited("count=\"8\"", "count=\"9\""), "line 5: says 9 points but has room for 8"),
        (edited("stride=\"3\"", "stride=\"2\""), "line 5: points have 2 coordinates instead of 3"),
        (edited("meter=\"0.0254\"", "meter=\"0\""), "line 3: meter is no length above 0"),
        (edited("<node name=\"lid\">", "<node name=\"lid\"><lookat/>"), "line 11: has a <lookat>, which is not read"),
        (edited("<instance_geometry", "<instance_controller"), "line 11: has a skin, whose pose is not read"),
        (
            edited("<node name=\"lid\">", "<node id=\"n\"><instance_node url=\"#n\"/>"),
            "line 11: nodes lie in each other too deep, or in a circle",
        ),
        (String::from("<a/>"), "line 1: is no COLLADA: begins with <a>"),
        (String::from("<a>\n<b></a>"), "line 2: is not XML: expected 'b' tag, not 'a' at 2:4"),
    ] {
        assert_eq!(read(text.as_bytes()).expect_err("a mistake").to_string(), expected);
    }
}
