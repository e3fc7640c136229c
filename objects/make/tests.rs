//! What every bundled file promises, checked on the text that is written.

use std::collections::{BTreeSet, HashMap};
use std::path::Path;

use crate::OBJECTS;
use crate::solid::TICKS_PER_MM;

type Ticks = [i128; 3];

fn folder() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/objects"))
}

/// Every object's name and text.
fn files() -> impl Iterator<Item = (&'static str, String)> {
    OBJECTS.iter().map(|(name, what, make)| (*name, make().obj(name, what)))
}

/// Vertices on the grid and faces as written.
fn parse(text: &str) -> (Vec<Ticks>, Vec<Vec<usize>>) {
    let (mut points, mut faces) = (Vec::new(), Vec::new());
    for line in text.lines() {
        let mut words = line.split(' ');
        match words.next() {
            Some("v") => {
                let mm: Vec<f64> = words.map(|w| w.parse().unwrap()).collect();
                assert!(mm.len() == 3 && mm.iter().all(|c| c.is_finite()), "{line}");
                points.push([0, 1, 2].map(|k| (mm[k] * TICKS_PER_MM).round() as i128));
            }
            Some("f") => faces.push(words.map(|w| w.parse::<usize>().unwrap() - 1).collect()),
            word => assert_eq!(word, Some("#"), "{line}"),
        }
    }
    (points, faces)
}

/// The triangles a reader makes that splits every face from its first corner.
fn triangles(faces: &[Vec<usize>]) -> impl Iterator<Item = [usize; 3]> {
    faces.iter().flat_map(|f| (2..f.len()).map(|i| [f[0], f[i - 1], f[i]]))
}

fn cross(a: Ticks, b: Ticks, c: Ticks) -> Ticks {
    let [u, v] = [b, c].map(|p| [0, 1, 2].map(|k| p[k] - a[k]));
    [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
}

fn dot(a: Ticks, b: Ticks) -> i128 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[test]
fn making_the_objects_again_gives_the_bytes_on_disk() {
    for (name, text) in files() {
        let path = folder().join(name).with_extension("obj");
        let disk = std::fs::read_to_string(&path).unwrap();
        assert!(disk == text, "{name}: run `cargo run --release --example make_objects`");
    }
}

#[test]
fn the_folder_holds_these_meshes_and_no_others() {
    let disk: BTreeSet<String> = std::fs::read_dir(folder())
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .filter_map(|file| file.strip_suffix(".obj").map(str::to_owned))
        .collect();
    let made: BTreeSet<String> = OBJECTS.iter().map(|(name, ..)| (*name).to_owned()).collect();
    assert_eq!(disk, made);
}

#[test]
fn all_meshes_together_stay_below_two_megabytes() {
    let bytes: usize = files().map(|(_, text)| text.len()).sum();
    assert!(bytes <= 2_000_000, "{bytes}");
}

#[test]
fn every_edge_joins_two_faces_that_run_along_it_in_opposite_directions() {
    for (name, text) in files() {
        let (_, faces) = parse(&text);
        let mut uses: HashMap<(usize, usize), usize> = HashMap::new();
        for face in &faces {
            for i in 0..face.len() {
                *uses.entry((face[i], face[(i + 1) % face.len()])).or_default() += 1;
            }
        }
        for (&(a, b), &count) in &uses {
            assert_eq!(count, 1, "{name}: edge {} {} used {count} times", a + 1, b + 1);
            assert!(uses.contains_key(&(b, a)), "{name}: edge {} {} is open", a + 1, b + 1);
        }
    }
}

#[test]
fn every_vertex_is_used_and_no_two_coincide() {
    for (name, text) in files() {
        let (points, faces) = parse(&text);
        let used: BTreeSet<usize> = faces.iter().flatten().copied().collect();
        assert_eq!(used.len(), points.len(), "{name}");
        let places: BTreeSet<Ticks> = points.iter().copied().collect();
        assert_eq!(places.len(), points.len(), "{name}");
    }
}

#[test]
fn no_triangle_is_empty_and_no_quad_folds() {
    for (name, text) in files() {
        let (points, faces) = parse(&text);
        for face in &faces {
            assert!(matches!(face.len(), 3 | 4), "{name}");
            let normals: Vec<Ticks> = triangles(std::slice::from_ref(face))
                .map(|t| cross(points[t[0]], points[t[1]], points[t[2]]))
                .collect();
            assert!(normals.iter().all(|n| dot(*n, *n) > 0), "{name}: {face:?}");
            assert!(normals.windows(2).all(|n| dot(n[0], n[1]) > 0), "{name}: {face:?}");
        }
    }
}

#[test]
fn no_vertex_lies_inside_an_edge() {
    for (name, text) in files() {
        let (points, faces) = parse(&text);
        let mut by_x: Vec<usize> = (0..points.len()).collect();
        by_x.sort_by_key(|&i| points[i][0]);
        let xs: Vec<i128> = by_x.iter().map(|&i| points[i][0]).collect();
        for face in &faces {
            for i in 0..face.len() {
                let (a, b) = (points[face[i]], points[face[(i + 1) % face.len()]]);
                let from = xs.partition_point(|&x| x < a[0].min(b[0]));
                let to = xs.partition_point(|&x| x <= a[0].max(b[0]));
                for &p in by_x[from..to].iter().map(|&i| &points[i]) {
                    let inside = (0..3).all(|k| (a[k].min(b[k])..=a[k].max(b[k])).contains(&p[k]));
                    assert!(
                        !inside || p == a || p == b || cross(a, b, p) != [0; 3],
                        "{name}: {p:?} on the edge {a:?} {b:?}"
                    );
                }
            }
        }
    }
}

#[test]
fn the_outside_is_outside_and_the_size_is_sane() {
    for (name, text) in files() {
        let (points, faces) = parse(&text);
        let six_volumes: i128 =
            triangles(&faces).map(|[a, b, c]| dot(points[a], cross([0; 3], points[b], points[c]))).sum();
        assert!(six_volumes > 0, "{name}");
        for k in 0..3 {
            let low = points.iter().map(|p| p[k]).min().unwrap();
            let high = points.iter().map(|p| p[k]).max().unwrap();
            assert!((10_000..=600_000).contains(&(high - low)), "{name}");
            match k {
                2 => assert_eq!(low, 0, "{name}"),
                1 if name == "edge_slab" => assert_eq!(low, 0),
                _ => assert!((low + high).abs() <= 1, "{name}"),
            }
        }
    }
}

#[test]
fn the_cube_is_exactly_five_millimetres() {
    let (points, faces) = parse(&crate::basic::cube().obj("cube", ""));
    assert_eq!((points.len(), faces.len()), (8, 6));
    for p in points {
        assert!(p[0].abs() == 25_000 && p[1].abs() == 25_000 && [0, 50_000].contains(&p[2]));
    }
}
