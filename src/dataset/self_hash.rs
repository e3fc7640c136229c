//! Texts that hold their own SHA-256, so that any change in them is noticed. The hash is that of the text with 64 zeros
//! in the hash's place.

use gelsim_files::hash::sha256;

/// What stands in the place of the hash while the text is hashed.
pub const BLANK_HASH: &str = "0000000000000000000000000000000000000000000000000000000000000000";

/// Puts the hash in the place of the zeros behind `mark`.
pub fn insert_self_hash(text: &str, mark: &str) -> String {
    text.replacen(&format!("{mark}{BLANK_HASH}"), &format!("{mark}{}", sha256(text.as_bytes())), 1)
}

/// Returns true if the hash behind the last `mark` is that of the text, which therefore was not changed.
pub fn has_valid_self_hash(text: &[u8], mark: &str) -> bool {
    let Some(start) = text.windows(mark.len()).rposition(|window| window == mark.as_bytes()) else { return false };
    let place = start + mark.len()..start + mark.len() + BLANK_HASH.len();
    let Some(found) = text.get(place.clone()) else { return false };
    let mut blank = text.to_vec();
    blank[place].copy_from_slice(BLANK_HASH.as_bytes());
    sha256(&blank).as_bytes() == found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_changed_byte_breaks_the_seal() {
        let text = insert_self_hash(&format!("a: 1\nseal: {BLANK_HASH}\nb: 2\n"), "seal: ");
        assert!(has_valid_self_hash(text.as_bytes(), "seal: ") && !text.contains(BLANK_HASH));
        for at in 0..text.len() {
            let mut other = text.clone().into_bytes();
            other[at] ^= 1;
            assert!(!has_valid_self_hash(&other, "seal: "), "byte {at}");
            let mut shorter = text.clone().into_bytes();
            shorter.remove(at);
            assert!(!has_valid_self_hash(&shorter, "seal: "), "byte {at}");
        }
        for nothing in [&b""[..], b"seal: ", b"seal: 00"] {
            assert!(!has_valid_self_hash(nothing, "seal: "));
        }
    }
}
