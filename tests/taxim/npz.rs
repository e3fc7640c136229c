//! Archives of arrays: as NumPy writes them, damaged, and hostile.

use gelsim_files::npz::Npz;
use proptest::prelude::*;
use proptest::sample::Index;

use super::folder::{self, Member};

fn open(bytes: &[u8]) -> Npz {
    Npz::open(bytes.to_vec()).expect("an archive")
}

fn refused(bytes: &[u8], name: &str) -> String {
    Npz::open(bytes.to_vec()).and_then(|archive| archive.read_array(name)).expect_err("refused")
}

/// Where a text stands in an archive for the last time.
fn last(bytes: &[u8], text: &[u8]) -> usize {
    bytes.windows(text.len()).rposition(|window| window == text).expect("it is there")
}

#[test]
fn stored_and_deflated_arrays_are_read_by_their_names() {
    for deflated in [false, true] {
        let bytes = folder::archive(&folder::table(), deflated);
        let archive = open(&bytes);
        assert_eq!(archive.names().collect::<Vec<_>>(), ["bins", "grad_r", "grad_g", "grad_b"]);
        let bins = archive.read_array("bins").expect("a number");
        assert_eq!((bins.shape.as_slice(), bins.values.as_slice()), ([].as_slice(), [8.0].as_slice()));
        let red = archive.read_array("grad_r").expect("an array");
        assert_eq!((red.shape, red.values), (vec![8, 8, 6], folder::grades(2)));
    }
}

/// `numpy.savez_compressed(file, bins=numpy.int64(125), a=numpy.arange(6, dtype="u1").reshape(2, 3))` by NumPy 2.4.
#[test]
fn an_archive_by_numpy_itself_is_read() {
    let archive = open(include_bytes!("numpy.npz"));
    assert_eq!(archive.names().collect::<Vec<_>>(), ["bins", "a"]);
    assert_eq!(archive.read_array("bins").expect("a number").values, [125.0]);
    let array = archive.read_array("a").expect("an array");
    assert_eq!((array.shape, array.values), (vec![2, 3], vec![0.0, 1.0, 2.0, 3.0, 4.0, 5.0]));
}

#[test]
fn what_cannot_be_read_is_refused_with_a_reason() {
    let bytes = folder::archive(&folder::pack(), false);
    assert_eq!(refused(&bytes, "f1"), "it has no array `f1`, but `names`, `f0`");
    assert!(refused(&bytes, "names").contains("array `names`: its values are of type `|O`"));
    assert!(refused(b"", "f0").contains("not a ZIP archive"));
    assert!(refused(b"PK\x05\x06", "f0").contains("not a ZIP archive"));
    assert!(refused(&bytes[..bytes.len() - 30], "f0").contains("not a ZIP archive"));
    let entry = last(&bytes, b"PK\x01\x02");
    let with = |at: usize, new: &[u8]| {
        let mut bytes = bytes.clone();
        bytes[entry + at..][..new.len()].copy_from_slice(new);
        bytes
    };
    assert!(refused(&with(8, &[1]), "f0").contains("encrypted"));
    assert!(refused(&with(10, &[14]), "f0").contains("packed by method 14"));
    assert!(refused(&with(10, &[8]), "f0").contains("damaged"));
    assert!(refused(&with(16, &[1, 2, 3, 4]), "f0").contains("damaged"));
    assert!(refused(&with(20, &[0xff; 4]), "f0").contains("cut off"));
    assert!(refused(&with(42, &[0xff; 4]), "f0").contains("cut off"));
    assert!(refused(&with(24, &[0; 4]), "f0").contains("damaged"));
}

#[test]
fn data_that_is_not_deflated_is_refused() {
    let mut bytes = folder::archive(&folder::pack(), true);
    let entry = last(&bytes, b"PK\x03\x04");
    let data = entry + 30 + "f0.npy".len() + 20;
    // A last block of a kind that there is not.
    bytes[data] = 7;
    assert!(refused(&bytes, "f0").contains("cannot be unpacked: the archive is damaged"));
}

#[test]
fn a_bomb_is_refused_before_it_is_unpacked_whatever_size_it_admits() {
    let zeros = Member { name: "f0", descr: "|u1", shape: vec![64 << 20], data: vec![0; 64 << 20] };
    let mut bytes = folder::archive(&[zeros], true);
    assert!(refused(&bytes, "f0").contains("would unpack to 512 MB"));
    let entry = last(&bytes, b"PK\x01\x02");
    bytes[entry + 24..][..4].copy_from_slice(&1000_u32.to_le_bytes());
    assert!(refused(&bytes, "f0").contains("cannot be unpacked: the archive is damaged"));
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(2000) })]

    /// Also every damage to the values is found, by the checksum.
    #[test]
    fn a_damaged_archive_gives_the_same_arrays_or_a_reason(
        deflated: bool,
        damage in prop::collection::vec((any::<Index>(), any::<u8>()), 1..6),
        cut in prop::option::of(any::<Index>()),
    ) {
        let whole = folder::archive(&folder::pack(), deflated);
        let expected = open(&whole).read_array("f0").expect("an array");
        let mut bytes = whole;
        for (at, byte) in damage {
            let at = at.index(bytes.len());
            bytes[at] = byte;
        }
        if let Some(cut) = cut {
            bytes.truncate(cut.index(bytes.len()));
        }
        if let Ok(archive) = Npz::open(bytes) {
            let names: Vec<String> = archive.names().map(String::from).collect();
            names.iter().for_each(|name| drop(archive.read_array(name)));
            if let Ok(found) = archive.read_array("f0") {
                prop_assert_eq!(found, expected);
            }
        }
    }
}
