//! Archives as NumPy writes them, and a made-up calibration folder.

use std::fs;
use std::path::Path;

use miniz_oxide::deflate::compress_to_vec;

/// One array: its name, NumPy's name of its type, its shape and its bytes.
#[derive(Clone)]
pub struct Member {
    pub name: &'static str,
    pub descr: &'static str,
    pub shape: Vec<usize>,
    pub data: Vec<u8>,
}

impl Member {
    pub fn f64(name: &'static str, shape: &[usize], values: &[f64]) -> Self {
        let data = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        Self { name, descr: "<f8", shape: shape.to_vec(), data }
    }

    fn npy(&self) -> Vec<u8> {
        let sizes: String = self.shape.iter().map(|size| format!("{size},")).collect();
        let header = format!("{{'descr': '{}', 'fortran_order': False, 'shape': ({sizes}), }}\n", self.descr);
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.as_bytes());
        bytes.extend(&self.data);
        bytes
    }
}

/// ZIP's CRC-32, bit by bit.
pub fn crc(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0_u32, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| if crc & 1 == 1 { crc >> 1 ^ 0xedb8_8320 } else { crc >> 1 })
    })
}

/// An archive of the arrays, deflated or stored.
pub fn archive(members: &[Member], deflated: bool) -> Vec<u8> {
    let (mut bytes, mut directory) = (Vec::new(), Vec::new());
    for member in members {
        let npy = member.npy();
        let packed = if deflated { compress_to_vec(&npy, 6) } else { npy.clone() };
        let name = format!("{}.npy", member.name);
        let mut fields = vec![0_u8; 4];
        fields.extend(u16::to_le_bytes(if deflated { 8 } else { 0 }));
        fields.extend([0; 4]);
        for number in [crc(&npy), packed.len() as u32, npy.len() as u32] {
            fields.extend(number.to_le_bytes());
        }
        fields.extend((name.len() as u16).to_le_bytes());
        let offset = bytes.len() as u32;
        bytes.extend(b"PK\x03\x04");
        bytes.extend(&fields);
        // NumPy leaves room for large sizes in the first header, and none in the directory.
        bytes.extend(20_u16.to_le_bytes());
        bytes.extend(name.as_bytes());
        bytes.extend([0; 20]);
        bytes.extend(packed);
        directory.extend(b"PK\x01\x02\0\0");
        directory.extend(&fields);
        directory.extend([0; 12]);
        directory.extend(offset.to_le_bytes());
        directory.extend(name.as_bytes());
    }
    let start = bytes.len() as u32;
    bytes.extend(&directory);
    bytes.extend(b"PK\x05\x06\0\0\0\0");
    bytes.extend([(members.len() as u16).to_le_bytes(), (members.len() as u16).to_le_bytes()].concat());
    bytes.extend((directory.len() as u32).to_le_bytes());
    bytes.extend(start.to_le_bytes());
    bytes.extend([0; 2]);
    bytes
}

/// Bins of the made-up calibration: few, and no multiple of four steps to a turn.
pub const BINS: usize = 8;
/// Width and height of its pictures.
pub const SIZE: [usize; 2] = [24, 16];

/// A number from -1 to 1 for every place, always the same.
pub fn made_up(place: usize) -> f64 {
    let bits = (place as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    (bits ^ bits >> 29) as i32 as f64 / 2_147_483_648.0
}

/// The polynomials of channel 0 (red) to 2 (blue): tens of levels in all.
pub fn grades(channel: usize) -> Vec<f64> {
    let scales = [0.02, 0.02, 0.02, 0.5, 0.5, 30.0];
    (0..BINS * BINS * 6).map(|at| scales[at % 6] * made_up(at + 10_000 * channel)).collect()
}

/// The untouched pad's value at a pixel of a plane, 0 blue to 2 red.
pub fn pad(x: usize, y: usize, plane: usize) -> u8 {
    (90 + 3 * x + 2 * y + 20 * plane) as u8
}

pub const PARAMS: &str = r#"{
  "simulator": { "initial_frame_sigma_rel": [0.2, 0.25], "frame_mixing_percentage": 0.4, "diff_threshold": 5, "contact_scale": 0.4 },
  "sensor": { "pixmm": 0.05, "num_bins": 8, "h": 16, "w": 24 }
}"#;

/// The arrays of `polycalib.npz`. Taxim's names are red's for blue and blue's for red.
pub fn table() -> Vec<Member> {
    let grade = |name, channel| Member::f64(name, &[BINS, BINS, 6], &grades(channel));
    let bins = Member { name: "bins", descr: "<i8", shape: vec![], data: (BINS as i64).to_le_bytes().to_vec() };
    vec![bins, grade("grad_r", 2), grade("grad_g", 1), grade("grad_b", 0)]
}

/// The arrays of `dataPack.npz`.
pub fn pack() -> Vec<Member> {
    let [width, height] = SIZE;
    let data = (0..width * height * 3).map(|at| pad(at / 3 % width, at / 3 / width, at % 3)).collect();
    let names = Member { name: "names", descr: "|O", shape: vec![1], data: vec![0x80, 4] };
    vec![names, Member { name: "f0", descr: "|u1", shape: vec![height, width, 3], data }]
}

/// Writes the three files into a folder.
pub fn write(folder: &Path, table: &[Member], pack: &[Member], params: &str) {
    fs::write(folder.join("polycalib.npz"), archive(table, false)).expect("written");
    fs::write(folder.join("dataPack.npz"), archive(pack, true)).expect("written");
    fs::write(folder.join("params.json"), params).expect("written");
}
