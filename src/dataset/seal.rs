//! Texts that vouch for themselves: a SHA-256 in a place of its own, over the text with that place blank.

use gelsim_files::hash::sha256;

/// What stands where the seal belongs while the text is hashed.
pub const BLANK: &str = "0000000000000000000000000000000000000000000000000000000000000000";

/// Puts the seal where `text` is blank after the last `mark`.
pub fn sealed(text: &str, mark: &str) -> String {
    text.replacen(&format!("{mark}{BLANK}"), &format!("{mark}{}", sha256(text.as_bytes())), 1)
}

/// True if the text is, byte for byte, one that was sealed after the last `mark`.
pub fn is_sealed(text: &[u8], mark: &str) -> bool {
    let Some(start) = text.windows(mark.len()).rposition(|window| window == mark.as_bytes()) else { return false };
    let place = start + mark.len()..start + mark.len() + BLANK.len();
    let Some(found) = text.get(place.clone()) else { return false };
    let mut blank = text.to_vec();
    blank[place].copy_from_slice(BLANK.as_bytes());
    sha256(&blank).as_bytes() == found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_changed_byte_breaks_the_seal() {
        let text = sealed(&format!("a: 1\nseal: {BLANK}\nb: 2\n"), "seal: ");
        assert!(is_sealed(text.as_bytes(), "seal: ") && !text.contains(BLANK));
        for at in 0..text.len() {
            let mut other = text.clone().into_bytes();
            other[at] ^= 1;
            assert!(!is_sealed(&other, "seal: "), "byte {at}");
            let mut shorter = text.clone().into_bytes();
            shorter.remove(at);
            assert!(!is_sealed(&shorter, "seal: "), "byte {at}");
        }
        for nothing in [&b""[..], b"seal: ", b"seal: 00"] {
            assert!(!is_sealed(nothing, "seal: "));
        }
    }
}
