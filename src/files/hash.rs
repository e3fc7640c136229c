//! SHA-256 (FIPS 180-4) of bytes and files, in lower-case hexadecimal digits as `sha256sum` prints them.

use std::io::{self, Read};

use sha2::{Digest, Sha256};

/// Formats bytes as lower-case hexadecimal digits, two a byte.
pub fn to_hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Returns the SHA-256 of bytes.
pub fn sha256(bytes: &[u8]) -> String {
    to_hex(&Sha256::digest(bytes))
}

/// Returns the SHA-256 of all bytes of a reader.
pub fn sha256_of_reader(mut file: impl Read) -> io::Result<String> {
    let mut hash = Sha256::new();
    let mut bytes = vec![0; 1 << 18];
    loop {
        match file.read(&mut bytes)? {
            0 => return Ok(to_hex(&hash.finalize())),
            count => hash.update(&bytes[..count]),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::fs::File;

    use super::*;

    /// The example of FIPS 180-4 for one block.
    #[test]
    fn abc_has_the_standards_hash_in_memory_and_in_a_file() {
        let expected = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(sha256(b"abc"), expected);
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("abc");
        std::fs::write(&path, "abc").expect("a file");
        assert_eq!(sha256_of_reader(File::open(&path).expect("a file")).expect("readable"), expected);
    }
}
