//! Meshes by formula and from files, the files they come in, how they are placed, and random numbers. In the sensor's
//! frame: x right, y down, z away from the camera.

use std::f64::consts::{PI, TAU};
use std::fmt::Write;
use std::path::Path;

use gelsim_core::mesh::Mesh;
use gelsim_core::mesh::clusters::Clusters;
use gelsim_core::pose::Placement;
use gelsim_files::mesh;

/// Random numbers that are the same on every run and machine (SplitMix64).
pub struct Random(pub u64);

impl Random {
    /// Uniform in [0, 1).
    pub fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut bits = self.0;
        bits = (bits ^ bits >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        bits = (bits ^ bits >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((bits ^ bits >> 31) >> 11) as f64 / (1_u64 << 53) as f64
    }

    pub fn within(&mut self, min: f64, max: f64) -> f64 {
        min + (max - min) * self.unit()
    }

    pub fn below(&mut self, count: usize) -> usize {
        (self.unit() * count as f64) as usize
    }

    /// A rotation matrix, every one as likely as the others (Shoemake 1992).
    pub fn rotation(&mut self) -> [[f64; 3]; 3] {
        let (u, v, w) = (self.unit(), self.within(0.0, std::f64::consts::TAU), self.within(0.0, std::f64::consts::TAU));
        let (a, b) = ((1.0 - u).sqrt(), u.sqrt());
        matrix([a * v.sin(), a * v.cos(), b * w.sin(), b * w.cos()])
    }
}

/// Rows of the rotation matrix of a unit quaternion x, y, z, w.
pub fn matrix([x, y, z, w]: [f64; 4]) -> [[f64; 3]; 3] {
    [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
    ]
}

pub const UPRIGHT: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// Quarter turns about z.
pub fn quarter_turn(quarters: usize) -> [[f64; 3]; 3] {
    let (sin, cos) = [(0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0)][quarters % 4];
    [[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]]
}

/// `rotation * point + translation`.
pub fn moved(placement: &Placement, point: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|k| {
        let turned: f64 = placement.rotation[k].iter().zip(point).map(|(r, q)| r * q).sum();
        turned + placement.translation_mm[k]
    })
}

/// A format of mesh files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    Obj,
    /// Binary.
    Stl,
    /// Binary, with coordinates of 64 bits.
    Ply,
}

impl Format {
    pub fn extension(self) -> &'static str {
        match self {
            Self::Obj => "obj",
            Self::Stl => "stl",
            Self::Ply => "ply",
        }
    }
}

/// Triangles in the object's own frame, mm.
#[derive(Clone, Default)]
pub struct Shape {
    pub vertices: Vec<[f64; 3]>,
    pub triangles: Vec<[u32; 3]>,
}

impl Shape {
    /// Triangles that share no vertex.
    pub fn soup(triangles: impl IntoIterator<Item = [[f64; 3]; 3]>) -> Self {
        let vertices: Vec<[f64; 3]> = triangles.into_iter().flatten().collect();
        let triangles = (0..vertices.len() as u32 / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        Self { vertices, triangles }
    }

    /// A sheet of `columns` x `rows` cells, two triangles each; `vertex` gives the corner in a column and row.
    pub fn sheet(columns: usize, rows: usize, vertex: impl Fn(usize, usize) -> [f64; 3]) -> Self {
        Self::sheet_cut(columns, rows, |_, _| false, vertex)
    }

    /// The same with a diagonal that changes from cell to cell.
    pub fn crossed_sheet(columns: usize, rows: usize, vertex: impl Fn(usize, usize) -> [f64; 3]) -> Self {
        Self::sheet_cut(columns, rows, |i, j| !(i + j).is_multiple_of(2), vertex)
    }

    fn sheet_cut(
        columns: usize,
        rows: usize,
        is_crossed: impl Fn(usize, usize) -> bool,
        vertex: impl Fn(usize, usize) -> [f64; 3],
    ) -> Self {
        let vertices = (0..=rows).flat_map(|j| (0..=columns).map(move |i| (i, j))).map(|(i, j)| vertex(i, j)).collect();
        let cell = |i: usize, j: usize| {
            let a = (j * (columns + 1) + i) as u32;
            let c = a + columns as u32 + 1;
            if is_crossed(i, j) { [[a, a + 1, c + 1], [a, c + 1, c]] } else { [[a, a + 1, c], [a + 1, c + 1, c]] }
        };
        let triangles = (0..rows).flat_map(|j| (0..columns).flat_map(move |i| cell(i, j))).collect();
        Self { vertices, triangles }
    }

    /// A ball that stands on the plane z = 0.
    pub fn ball(radius: f64, meridians: usize, parallels: usize) -> Self {
        Self::sheet(meridians, parallels, |i, j| {
            let (azimuth, polar) = (i as f64 / meridians as f64 * TAU, j as f64 / parallels as f64 * PI);
            [radius * polar.sin() * azimuth.cos(), radius * polar.sin() * azimuth.sin(), radius * (1.0 - polar.cos())]
        })
    }

    /// A ball around the origin: `meridians` x `parallels` cells.
    pub fn ball_around_origin(radius: f64, meridians: usize, parallels: usize) -> Self {
        Self::crossed_sheet(meridians, parallels, |i, j| {
            let (azimuth, polar) = (i as f64 / meridians as f64 * TAU, j as f64 / parallels as f64 * PI);
            [radius * polar.sin() * azimuth.cos(), radius * polar.sin() * azimuth.sin(), radius * polar.cos()]
        })
    }

    /// A cap of a paraboloid that stands on the plane z = 0: as a ball of `radius` within `half` mm of the origin.
    pub fn cap(radius: f64, half: f64) -> Self {
        Self::sheet(64, 64, |i, j| {
            let (x, y) = (half * (i as f64 / 32.0 - 1.0), half * (j as f64 / 32.0 - 1.0));
            [x, y, 0.5 * (x * x + y * y) / radius]
        })
    }

    /// A box.
    pub fn brick(low: [f64; 3], high: [f64; 3]) -> Self {
        let corner = |i: usize| std::array::from_fn(|k| if i >> k & 1 == 0 { low[k] } else { high[k] });
        Self {
            vertices: (0..8).map(corner).collect(),
            triangles: vec![
                [0, 2, 1],
                [1, 2, 3],
                [4, 5, 6],
                [5, 7, 6],
                [0, 1, 4],
                [1, 5, 4],
                [2, 6, 3],
                [3, 6, 7],
                [0, 4, 2],
                [2, 4, 6],
                [1, 3, 5],
                [3, 7, 5],
            ],
        }
    }

    /// A plate whose lower face is a rectangle around the origin, at z = 0.
    pub fn plate(width: f64, height: f64) -> Self {
        Self::brick([-0.5 * width, -0.5 * height, 0.0], [0.5 * width, 0.5 * height, 2.0])
    }

    /// A small level tile around the centre of each pixel, at the height that `height` gives in column and row of the
    /// view; pixels of a margin count from below 0.
    pub fn tiles(px: [u32; 2], mm_per_px: [f64; 2], margin: i32, height: impl Fn(i32, i32) -> Option<f64>) -> Self {
        let [width, rows] = px.map(|size| size as i32);
        let mut shape = Self::default();
        for j in -margin..rows + margin {
            for i in -margin..width + margin {
                let Some(z) = height(i, j) else { continue };
                let at = |k: usize, index: i32, size: i32, off: f64| {
                    (f64::from(index) + 0.5 - f64::from(size) / 2.0 + off) * mm_per_px[k]
                };
                let ([x0, x1], [y0, y1]) =
                    ([-0.3, 0.3].map(|off| at(0, i, width, off)), [-0.3, 0.3].map(|off| at(1, j, rows, off)));
                shape = shape.and(Self::quad([[x0, y0, z], [x1, y0, z], [x1, y1, z], [x0, y1, z]]));
            }
        }
        shape
    }

    /// Four corners, two triangles.
    pub fn quad(corners: [[f64; 3]; 4]) -> Self {
        Self { vertices: corners.to_vec(), triangles: vec![[0, 2, 1], [0, 3, 2]] }
    }

    /// Both.
    pub fn and(mut self, other: Self) -> Self {
        let first = self.vertices.len() as u32;
        self.vertices.extend(other.vertices);
        self.triangles.extend(other.triangles.iter().map(|corners| corners.map(|corner| corner + first)));
        self
    }

    pub fn map(&self, change: impl Fn([f64; 3]) -> [f64; 3]) -> Self {
        Self { vertices: self.vertices.iter().copied().map(change).collect(), triangles: self.triangles.clone() }
    }

    pub fn moved(self, by: [f64; 3]) -> Self {
        self.map(|point| std::array::from_fn(|k| point[k] + by[k]))
    }

    pub fn scaled(self, by: f64) -> Self {
        self.map(|point| point.map(|x| by * x))
    }

    /// Inside out.
    pub fn inverted(mut self) -> Self {
        self.triangles.iter_mut().for_each(|corners| corners.swap(1, 2));
        self
    }

    /// A bundled object.
    pub fn bundled(path: &Path) -> Self {
        let mesh = match mesh::load(path, 1.0) {
            Ok(loaded) => loaded.mesh,
            Err(error) => panic!("{error}"),
        };
        let absolute = |v: &[f32; 3]| std::array::from_fn(|k| f64::from(v[k]) + mesh.centre_mm[k]);
        Self { vertices: mesh.vertices.iter().map(absolute).collect(), triangles: mesh.triangles }
    }

    /// Ready to be pressed.
    pub fn clusters(&self) -> Clusters {
        match Mesh::new(self.vertices.clone(), self.triangles.clone()) {
            Ok((mesh, _)) => Clusters::new(&mesh),
            Err(error) => panic!("{error}"),
        }
    }

    /// Its corners in the sensor's frame.
    pub fn placed(&self, placement: &Placement) -> Vec<[[f64; 3]; 3]> {
        let points: Vec<[f64; 3]> = self.vertices.iter().map(|&q| moved(placement, q)).collect();
        self.triangles.iter().map(|corners| corners.map(|at| points[at as usize])).collect()
    }

    /// The bytes of a file.
    pub fn encode(&self, format: Format) -> Vec<u8> {
        match format {
            Format::Obj => self.obj(),
            Format::Stl => self.stl(),
            Format::Ply => self.ply(),
        }
    }

    fn obj(&self) -> Vec<u8> {
        let mut text = String::new();
        for [x, y, z] in &self.vertices {
            let _ = writeln!(text, "v {x:?} {y:?} {z:?}");
        }
        for corners in &self.triangles {
            let [a, b, c] = corners.map(|corner| corner + 1);
            let _ = writeln!(text, "f {a} {b} {c}");
        }
        text.into_bytes()
    }

    fn stl(&self) -> Vec<u8> {
        let mut bytes = vec![b' '; 80];
        bytes.extend((self.triangles.len() as u32).to_le_bytes());
        for corners in &self.triangles {
            bytes.extend([0; 12]);
            for corner in corners {
                bytes.extend(self.vertices[*corner as usize].map(|x| (x as f32).to_le_bytes()).as_flattened());
            }
            bytes.extend([0; 2]);
        }
        bytes
    }

    fn ply(&self) -> Vec<u8> {
        let mut bytes = format!(
            "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty double x\nproperty double y\n\
             property double z\nelement face {}\nproperty list uchar uint vertex_indices\nend_header\n",
            self.vertices.len(),
            self.triangles.len()
        )
        .into_bytes();
        for vertex in &self.vertices {
            bytes.extend(vertex.map(f64::to_le_bytes).as_flattened());
        }
        for corners in &self.triangles {
            bytes.push(3);
            bytes.extend(corners.map(u32::to_le_bytes).as_flattened());
        }
        bytes
    }
}
