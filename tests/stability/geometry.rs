//! Meshes as they are found: broken, degenerate, huge, tiny, turned.

use std::sync::LazyLock;

use super::case::{Case, Extent, Touches, run};
use crate::cases::check_cases;
use gelsim_oracle::shapes::{Format, Random, Shape};

/// Triangles in the plane z = 0, at random within `half` mm of its middle.
fn coincident(count: usize, half: f64) -> Shape {
    let mut random = Random(5);
    let mut corner = || [half * (2.0 * random.unit() - 1.0), half * (2.0 * random.unit() - 1.0), 0.0];
    let triangles: Vec<_> = (0..count).map(|_| [corner(), corner(), corner()]).collect();
    Shape::soup(triangles)
}

/// A rough sheet that is higher towards its border.
fn terrain(columns: usize, rows: usize) -> Shape {
    Shape::sheet(columns, rows, |i, j| {
        let (x, y) = (20.0 * (i as f64 / columns as f64 - 0.5), 16.0 * (j as f64 / rows as f64 - 0.5));
        [x, y, 0.01 * (x * x + y * y) + 0.05 * ((3.0 * x).sin() * (4.0 * y).cos() + 1.0)]
    })
}

/// A bowl: half a ball, open above.
fn bowl() -> Shape {
    Shape::sheet(32, 8, |i, j| {
        let (azimuth, polar) = (i as f64 / 32.0 * std::f64::consts::TAU, j as f64 / 16.0 * std::f64::consts::PI);
        [4.0 * polar.sin() * azimuth.cos(), 4.0 * polar.sin() * azimuth.sin(), 4.0 * (1.0 - polar.cos())]
    })
}

/// The same with every zero negative.
fn minus_zero(shape: Shape) -> Shape {
    shape.map(|point| point.map(|x| if x == 0.0 { -0.0 } else { x }))
}

pub static CASES: LazyLock<Vec<Case>> = LazyLock::new(cases);

fn cases() -> Vec<Case> {
    let brick = Shape::brick([-3.1, -2.1, 0.0], [3.1, 2.1, 4.0]);
    let triangle = [[-3.0, -2.0, 0.0], [3.0, -2.0, 0.0], [0.0, 3.0, 0.0]];
    let slivers = (0..200).map(|k| {
        let (x, y) = (f64::from(k % 20) * 0.4 - 3.8, f64::from(k / 20) * 0.4 - 1.8);
        // 1e-12 mm^2: half of them specks of a micrometre, half needles of a millimetre.
        let (length, width) = if k % 2 == 0 { (1e-6, 2e-6) } else { (1.0, 2e-12) };
        [[x - length / 2.0, y, 0.0], [x + length / 2.0, y, 0.0], [x, y + width, 0.0]]
    });
    let on_centres = Shape::sheet(12, 8, |i, j| {
        [(i as f64 - 6.0) * 0.4 + 0.2, (j as f64 - 4.0) * 0.4 + 0.2, 0.1 * f64::from(u8::from((i + j) % 2 == 1))]
    });
    let fins = (0..3).map(|k| {
        let (sin, cos) = (f64::from(k) * 2.1).sin_cos();
        [[0.0, 0.0, 0.0], [0.0, 0.0, 3.0], [3.0 * cos, 3.0 * sin, 1.0]]
    });
    let mut cases = vec![
        Case::new("vertical walls", "triangles without area in the picture").shape(brick.clone()),
        Case::new("overhangs", "the upper of two faces").shape(
            Shape::brick([-1.0, -1.0, 0.0], [1.0, 1.0, 0.3]).and(Shape::brick([-4.0, -3.0, 0.3], [4.0, 3.0, 1.0])),
        ),
        Case::new("duplicate faces", "a hierarchy over equal boxes")
            .shape(brick.clone().and(brick.clone()).and(brick.clone())),
        Case::new("coincident faces", "two faces of one height").shape(
            Shape::brick([-3.0, -2.0, 0.0], [0.0, 2.0, 2.0]).and(Shape::brick([-1.0, -2.0, 0.0], [3.0, 1.0, 2.0])),
        ),
        Case::new("ten thousand duplicate faces", "quadratic time")
            .shape(Shape::soup(vec![triangle; 10_000]))
            .format(Format::Stl),
        Case::new("ten thousand coincident faces", "a hierarchy over equal boxes")
            .shape(coincident(10_000, 3.0))
            .format(Format::Ply),
        Case::new("slivers of 1e-12 mm^2", "edge functions that are all 0")
            .shape(Shape::soup(slivers).and(brick.clone())),
        Case::new("nothing but slivers", "an object that no pixel sees").shape(Shape::soup([[
            [0.2, 0.2, 0.0],
            [0.2 + 1e-6, 0.2, 0.0],
            [0.2, 0.2 + 2e-6, 0.0],
        ]])),
        Case::new("an object at 1e6 mm", "micrometres lost to 32 bits")
            .shape(Shape::ball(4.0, 32, 16).moved([1e6, -1e6, 1e6]))
            .set("pose.anchor = 'bounds'"),
        Case::new("an object of 1e6 mm", "the same").shape(Shape::ball(1e6, 64, 32)),
        Case::new("an object of 1e-6 mm on a pixel's centre", "lengths that vanish beside the pad's")
            .shape(Shape::ball(1e-6, 16, 8).moved([0.2, 0.2, 0.0])),
        Case::new("an object of 1e-6 mm at 1e6 mm", "an object that is a point in 32 bits")
            .shape(Shape::ball(1e-6, 16, 8).moved([1e6, 0.0, 0.0]))
            .set("pose = { anchor = 'bounds', x_mm = 0.2, y_mm = 0.2 }"),
        Case::new("an object of 1e7 mm", "the same").shape(Shape::ball(0.49e7, 64, 32)),
        Case::new("an object of 1e8 mm", "millimetres lost to 32 bits")
            .shape(Shape::ball(0.5e8, 64, 32))
            .refused("across"),
        Case::new("coordinates of 1e30", "overflow of a product")
            .shape(Shape::ball(4.0, 16, 8).scaled(1e30))
            .refused("across"),
        Case::new("coordinates of 1e300", "overflow in 32 bits")
            .shape(Shape::ball(4.0, 16, 8).scaled(1e300))
            .refused("no triangle left: dropped 136 vertices that are not finite"),
        Case::new("one triangle", "a hierarchy of one").shape(Shape::soup([triangle])),
        Case::new("one triangle on its edge", "an object without area")
            .shape(Shape::soup([triangle.map(|[x, y, _]| [x, 0.2, y + 2.0])]))
            .touches(Touches::None),
        Case::new("nothing but points", "a mesh without a face that counts")
            .shape(Shape::soup([[[1.0, 2.0, 3.0]; 3]]))
            .refused("no triangle left: dropped 1 triangle without area"),
        Case::new("an open mesh", "an inside").shape(bowl()),
        Case::new("an inverted mesh", "faces that look away").shape(Shape::ball(4.0, 32, 16).inverted()),
        Case::new("a self-intersecting mesh", "an inside")
            .shape(Shape::ball(3.0, 32, 16).and(Shape::ball(3.0, 32, 16).moved([2.0, 1.0, 0.1]))),
        Case::new("a non-manifold mesh", "an edge of three faces, a corner of two objects")
            .shape(Shape::soup(fins).and(brick.clone().scaled(0.3).moved([0.0, 0.0, 0.5]))),
        Case::new("vertices and edges on pixel centres", "a pixel that both faces or none take").shape(on_centres),
        Case::new("walls on pixel centres", "the same, in f32 of a turned object")
            .shape(Shape::brick([-2.2, -1.4, 0.0], [2.2, 1.4, 3.0]))
            .set("pose.yaw_deg = 90.0"),
        Case::new("-0.0 everywhere", "positions that are equal but not the same bits").shape(minus_zero(
            Shape::brick([0.0, 0.0, 0.0], [3.0, 2.0, 1.0]).and(Shape::brick([-3.0, -2.0, 0.0], [0.0, 0.0, 1.0])),
        )),
        Case::new("turned by 1e-9 rad", "a face that is level but for the last bit")
            .shape(brick.clone())
            .set("pose.yaw_deg = 5.7e-8")
            .set("pose.tilt_deg = 5.7e-8"),
        Case::new("tilted by 90 degrees", "faces seen along their plane")
            .shape(brick.clone())
            .set("pose.tilt_deg = 90.0"),
        Case::new("five million triangles", "time and memory")
            .shape(terrain(1600, 1563))
            .format(Format::Ply)
            .extent(Extent::Once),
    ];
    for (name, yaw, face) in [
        ("a quarter turn", "90.0", "-z"),
        ("half a turn", "180.0", "+z"),
        ("three quarters of a turn", "270.0", "+x"),
        ("a full turn", "360.0", "-y"),
    ] {
        let turned = Case::new(name, "a sine that is not 0").shape(brick.clone());
        cases.push(turned.set(format!("pose.yaw_deg = {yaw}")).set(format!("pose.face = '{face}'")));
    }
    cases
}

/// Every mesh gives a sound sample, or is refused.
#[test]
fn sound() {
    check_cases(&CASES, |case| case.name, run);
}
