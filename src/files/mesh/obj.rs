//! Reads Wavefront OBJ: vertices (`v`), faces (`f`), and the names of parts (`o` and `g`). Every other statement is
//! ignored.
//!
//! Our own reader, since `tobj` 4 refuses comments after a vertex, continued lines and names that are not UTF-8, names
//! no line in its errors, and cuts concave polygons wrongly. Format: Wavefront, Advanced Visualizer Manual, appendix B1
//! (1992).

use crate::mesh::points::PointKind;
use crate::mesh::polygon::Triangulator;
use crate::mesh::raw::{PartRanges, RawMesh};
use crate::mesh::{MeshFileError, MeshFileProblem, WordReader, quote_word, read_coordinates};
use gelsim_core::mesh::MeshError;

/// Reads vertices and triangles in the order of the file. The parts are its objects (`o`) or, if it has none, its
/// groups (`g`).
///
/// Only `v` and `f` may be continued on the next line by `\`. Elsewhere a `\` may end a path or a name, and the next
/// statement would be lost.
pub(super) fn read(bytes: &[u8]) -> Result<RawMesh, MeshFileError> {
    let mut raw = RawMesh::default();
    let mut words = WordReader::new(bytes);
    let mut cutter = Triangulator::new();
    let mut corners = Vec::new();
    let [mut objects, mut groups] = [PartRanges::default(), PartRanges::default()];
    let mut is_free_form = false;
    loop {
        let line = words.line;
        let statement = match words.next_word() {
            Some(b"v") => read_coordinates(&mut words).map(|vertex| raw.vertices.push(vertex)),
            Some(b"f") => read_face(&mut words, raw.vertices.len(), &mut corners)
                .and_then(|()| cutter.triangulate(&raw.vertices, &corners, &mut raw.triangles)),
            Some(b"l") => {
                raw.points.kind = PointKind::Lines;
                Ok(())
            }
            Some(b"curv" | b"curv2" | b"surf") => {
                is_free_form = true;
                Ok(())
            }
            Some(b"o") => {
                objects.continue_part(read_rest_of_line(&words), raw.triangles.len());
                Ok(())
            }
            Some(b"g") => {
                groups.continue_part(read_rest_of_line(&words), raw.triangles.len());
                Ok(())
            }
            _ => Ok(()),
        };
        statement.map_err(|problem| MeshFileError::at_line(line, problem))?;
        if !words.next_line() {
            if is_free_form && raw.triangles.is_empty() {
                let help = "export it as polygons (tessellated), as most programs do unless told otherwise";
                return Err(MeshFileProblem::with_help(
                    "holds curves and free-form surfaces, which are not read",
                    help,
                )
                .into());
            }
            raw.parts = if objects.is_empty() { groups } else { objects };
            return Ok(raw);
        }
    }
}

/// Returns true for a text whose first statements are those of an OBJ, with a vertex among them.
pub(super) fn is_obj(bytes: &[u8]) -> bool {
    /// Statements that may stand before the first vertex.
    const BEFORE: [&[u8]; 8] = [b"mtllib", b"usemtl", b"o", b"g", b"s", b"vt", b"vn", b"vp"];
    /// Most lines that are looked at.
    const MAX_LINES: usize = 10_000;
    let mut words = WordReader::new(bytes);
    for _ in 0..MAX_LINES {
        match words.next_word() {
            Some(b"v") => return read_coordinates(&mut words).is_ok(),
            None => {}
            Some(word) if BEFORE.contains(&word) => {}
            Some(_) => return false,
        }
        if !words.next_line() {
            break;
        }
    }
    false
}

/// Returns the rest of the line as a name: its words, joined by single spaces.
fn read_rest_of_line(words: &WordReader) -> String {
    let mut ahead = *words;
    let named = std::iter::from_fn(|| ahead.next_word()).map(String::from_utf8_lossy);
    let name = named.collect::<Vec<_>>().join(" ");
    if name.is_empty() { String::from("default") } else { name }
}

/// Fills `corners` with the vertices of a face, counted from 0. `count` vertices have been read so far.
fn read_face(words: &mut WordReader, count: usize, corners: &mut Vec<u32>) -> Result<(), MeshFileProblem> {
    corners.clear();
    while let Some(word) = words.next_word() {
        // v, v/vt, v//vn or v/vt/vn
        let index = word.split(|&byte| byte == b'/').next().unwrap_or_default();
        let index = parse_integer(index)
            .ok_or_else(|| MeshFileProblem::Malformed(format!("{} is not a corner of a face", quote_word(word))))?;
        // A negative number counts back from the vertices read so far.
        let from_start = match usize::try_from(index) {
            Ok(index) => index.checked_sub(1),
            Err(_) => usize::try_from(index.unsigned_abs()).ok().and_then(|back| count.checked_sub(back)),
        };
        match from_start.filter(|&corner| corner < count).and_then(|corner| u32::try_from(corner).ok()) {
            Some(corner) => corners.push(corner),
            None if index == 0 => {
                return Err(MeshFileProblem::Malformed("face refers to vertex 0, but the first is 1".into()));
            }
            None => {
                return Err(MeshError::NoSuchVertex { index, count, note: " so far" }.into());
            }
        }
    }
    if corners.is_empty() {
        return Err(MeshFileProblem::Malformed("a face has no corner".into()));
    }
    Ok(())
}

/// Parses a whole number. One of a few digits, as most are, takes half the time of the general way.
fn parse_integer(text: &[u8]) -> Option<i64> {
    if (1..=9).contains(&text.len()) && text.iter().all(u8::is_ascii_digit) {
        return Some(text.iter().fold(0, |number, digit| 10 * number + i64::from(digit - b'0')));
    }
    str::from_utf8(text).ok()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Format, Mesh, parse};
    use proptest::prelude::*;

    fn raw(text: &[u8]) -> RawMesh {
        read(text).unwrap()
    }

    fn failure(text: &str) -> String {
        read(text.as_bytes()).err().unwrap().to_string()
    }

    const THREE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";

    #[test]
    fn comments_may_follow_a_statement() {
        let raw = raw(b"v 0 0 0 # first\nv 1 0 0# second\nv 0 1 0 #\nf 1 2 3#face\n");
        assert_eq!(raw.vertices, [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
        assert_eq!(raw.triangles, [[0, 1, 2]]);
    }

    #[test]
    fn a_backslash_continues_a_vertex_or_a_face() {
        let raw = raw(b"v 0 \\\n0 0\nv 1\\\r\n 0 0\nv 0 1 0\nf 1 \\\r 2 \\\n\\\n 3\n");
        assert_eq!(raw.vertices.len(), 3);
        assert_eq!(raw.triangles, [[0, 1, 2]]);
    }

    #[test]
    fn a_backslash_at_the_end_of_a_name_or_comment_swallows_nothing() {
        let raw = raw(b"mtllib C:\\models\\\nv 0 0 0\n# in C:\\\nv 1 0 0\nv 0 1 0 # \\\nf 1 2 3\n");
        assert_eq!(raw.vertices.len(), 3);
        assert_eq!(raw.triangles.len(), 1);
    }

    #[test]
    fn lines_may_end_in_any_way() {
        for end in ["\n", "\r\n", "\r", "\n\n", "\r\n\r\n"] {
            let raw = raw(THREE.replace('\n', end).as_bytes());
            assert_eq!(raw.vertices.len(), 3, "{end:?}");
        }
        assert_eq!(raw(format!("{THREE}f 1 2 3").as_bytes()).triangles.len(), 1);
    }

    #[test]
    fn a_corner_may_carry_texture_and_normal() {
        for face in ["f 1 2 3", "f 1/7 2/8 3/9", "f 1//4 2//5 3//6", "f 1/7/4 2/8/5 3/9/6", "f 1/ 2// 3//"] {
            assert_eq!(raw(format!("{THREE}{face}\n").as_bytes()).triangles, [[0, 1, 2]], "{face}");
        }
    }

    #[test]
    fn negative_indices_count_back_from_the_last_vertex() {
        let text = format!("{THREE}f -3 -2 -1\nv 5 5 5\nf -1 -3 -4\n");
        assert_eq!(raw(text.as_bytes()).triangles, [[0, 1, 2], [3, 1, 0]]);
    }

    #[test]
    fn weights_and_colours_are_passed_over() {
        let raw = raw(b"v 1 2 3 1.0\nv 4 5 6 0.1 0.2 0.3\nv\t7  8\t 9   0.1 0.2 0.3 1\n");
        assert_eq!(raw.vertices, [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [7.0, 8.0, 9.0]]);
    }

    #[test]
    fn numbers_may_be_scientific_nan_or_infinite() {
        let raw = raw(b"v 1e-3 -2.5E+2 .5\nv nan inf -Infinity\n");
        assert_eq!(raw.vertices[0], [1e-3, -250.0, 0.5]);
        assert!(raw.vertices[1].iter().all(|x| !x.is_finite()));
    }

    #[test]
    fn names_in_other_encodings_a_bom_and_unknown_statements_are_passed_over() {
        let mut text = b"\xef\xbb\xbfv 0 0 0\no caf\xe9\n# \xff\xfe\nvn 0 0 1\nvt 0 0\nusemtl \xb5m\ns off\n".to_vec();
        text.extend(b"l 1 2\np 1\nvp 1\ncurv2 1 2\n\x80\x81\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
        let raw = raw(&text);
        assert_eq!((raw.vertices.len(), raw.triangles.len()), (3, 1));
    }

    #[test]
    fn concave_faces_keep_their_area() {
        let text = "v 0 0 0\nv 4 0 0\nv 4 1 0\nv 1 1 0\nv 1 3 0\nv 0 3 0\nf 2 3 4 5 6 1\n";
        let (mesh, _) = parse(text.as_bytes(), Format::Obj, 1.0).unwrap();
        assert_eq!(mesh.triangles.len(), 4);
        assert_eq!(area(&mesh), 6.0);
    }

    #[test]
    fn vertices_that_are_not_numbers_are_dropped_and_counted() {
        let text = format!("{THREE}v nan 0 0\nv 1 1 0\nf 1 2 3\nf 1 2 5 4\n");
        let (mesh, cleaned) = parse(text.as_bytes(), Format::Obj, 1.0).unwrap();
        assert_eq!(mesh.triangles.len(), 1);
        assert_eq!(cleaned.non_finite_vertices, 1);
    }

    #[test]
    fn faces_of_one_or_two_corners_have_no_area() {
        let text = format!("{THREE}f 1 2 3\nf 1\nf 2 3\n");
        let (_, cleaned) = parse(text.as_bytes(), Format::Obj, 1.0).unwrap();
        assert_eq!(cleaned.warning().unwrap(), "dropped 2 triangles without area");
    }

    #[test]
    fn an_offset_of_a_kilometre_keeps_micrometres() {
        let text = "v 1000000.001 0 0\nv 1000000.002 0 0\nv 1000000.001 0.001 0\nf 1 2 3\n";
        let (mesh, _) = parse(text.as_bytes(), Format::Obj, 1.0).unwrap();
        assert!((mesh.vertices[1][0] - mesh.vertices[0][0] - 1e-3).abs() < 1e-9);
    }

    #[test]
    fn errors_name_the_line_on_which_the_statement_starts() {
        for (text, expected) in [
            ("f 1 2 9\n", "line 4: face refers to vertex 9, but the file has 3 so far"),
            ("\r\n#\\\nf 1 2 9\n", "line 6: face refers to vertex 9, but the file has 3 so far"),
            ("f 1 \\\n 2 \\\n 9\n", "line 4: face refers to vertex 9, but the file has 3 so far"),
            ("v 0 \\\n 0 0\nf -5 2 3\n", "line 6: face refers to vertex -5, but the file has 4 so far"),
            ("f 0 1 2\n", "line 4: face refers to vertex 0, but the first is 1"),
            ("f 1 2 x/3\n", "line 4: `x/3` is not a corner of a face"),
            ("f 1 2 99999999999999999999\n", "line 4: `99999999999999999999` is not a corner of a face"),
            (
                "f -9223372036854775808\n",
                "line 4: face refers to vertex -9223372036854775808, but the file has 3 so far",
            ),
            ("f # nothing\n", "line 4: a face has no corner"),
            ("v 1 2\n", "line 4: a vertex has 2 coordinates instead of 3"),
            ("v 1,0 2,0 3,0\n", "line 4: `1,0` is not a number"),
        ] {
            assert_eq!(failure(&format!("{THREE}{text}")), expected);
        }
    }

    #[test]
    fn files_without_vertices_or_faces_are_refused() {
        let lines = &format!("{THREE}l 1 2 3\n");
        let curves = &format!("{THREE}cstype bezier\ndeg 2\ncurv 0 1 1 2 3\nend\n");
        for (text, expected) in [
            ("# nothing\n", "no vertex"),
            (THREE, "is a point cloud: 3 points and no triangle"),
            (lines, "holds lines alone: 3 points and no triangle"),
            (curves, "holds curves and free-form surfaces, which are not read"),
        ] {
            assert_eq!(parse(text.as_bytes(), Format::Obj, 1.0).unwrap_err().to_string(), expected);
        }
    }

    fn area(mesh: &Mesh) -> f64 {
        let area = |[a, b, c]: [[f64; 3]; 3]| {
            let [u, v] = [b, c].map(|corner| [0, 1, 2].map(|axis| corner[axis] - a[axis]));
            let x = u[1] * v[2] - u[2] * v[1];
            let y = u[2] * v[0] - u[0] * v[2];
            let z = u[0] * v[1] - u[1] * v[0];
            0.5 * (x * x + y * y + z * z).sqrt()
        };
        mesh.triangles.iter().map(|t| area(t.map(|i| mesh.vertices[i as usize].map(f64::from)))).sum()
    }

    proptest! {
        /// For all that both can read, `tobj` is the reference.
        #[test]
        fn plain_files_read_as_tobj_reads_them(
            vertices in prop::collection::vec(prop::array::uniform3(-1e3f32..1e3), 3..30),
            faces in prop::collection::vec(prop::array::uniform3(any::<prop::sample::Index>()), 1..40),
            form in 0usize..4,
            relative in any::<bool>(),
        ) {
            let mut text = String::from("o thing\nvt 0 0\nvn 0 0 1\n");
            for [x, y, z] in &vertices {
                text += &format!("v {x} {y:e} {z}\n");
            }
            for face in &faces {
                text += "f";
                for corner in face {
                    let mut index = corner.index(vertices.len()) as i64 + 1;
                    if relative {
                        index -= vertices.len() as i64 + 1;
                    }
                    text += &[
                        format!(" {index}"),
                        format!(" {index}/1"),
                        format!(" {index}//1"),
                        format!(" {index}/1/1"),
                    ][form];
                }
                text += "\n";
            }
            let ours = raw(text.as_bytes());
            let (models, _) =
                tobj::load_obj_buf(&mut text.as_bytes(), &tobj::LoadOptions::default(), |_| unreachable!()).unwrap();
            let ours: Vec<[f32; 3]> = ours
                .triangles
                .as_flattened()
                .iter()
                .map(|&corner| ours.vertices[corner as usize].map(|x| x as f32))
                .collect();
            let theirs: Vec<[f32; 3]> = models
                .iter()
                .flat_map(|model| {
                    let positions = model.mesh.positions.as_chunks::<3>().0;
                    model.mesh.indices.iter().map(|&corner| positions[corner as usize])
                })
                .collect();
            prop_assert_eq!(ours, theirs);
        }
    }
}
