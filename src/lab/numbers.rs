//! Counts, sizes and times in the form that people read.

use std::fmt;

/// A count with commas between groups of three digits.
#[derive(Clone, Copy, Debug)]
pub struct HumanCount(pub u64);

/// A size in bytes: `15 B`, `1.46 KiB`, `1.43 MiB`.
#[derive(Clone, Copy, Debug)]
pub struct HumanBytes(pub u64);

impl HumanCount {
    /// Returns the count with what is counted: `1 shard`, `4 shards`.
    pub fn of(self, noun: &str) -> String {
        format!("{self} {noun}{}", if self.0 == 1 { "" } else { "s" })
    }
}

impl fmt::Display for HumanCount {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let digits = self.0.to_string();
        for (place, digit) in digits.chars().enumerate() {
            if place > 0 && (digits.len() - place).is_multiple_of(3) {
                f.write_str(",")?;
            }
            write!(f, "{digit}")?;
        }
        Ok(())
    }
}

impl fmt::Display for HumanBytes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        const UNITS: [&str; 6] = ["KiB", "MiB", "GiB", "TiB", "PiB", "EiB"];
        if self.0 < 1024 {
            return write!(f, "{} B", self.0);
        }
        let mut size = self.0 as f64 / 1024.0;
        let mut unit = 0;
        while size >= 1024.0 {
            size /= 1024.0;
            unit += 1;
        }
        write!(f, "{size:.2} {}", UNITS[unit])
    }
}

/// A time in seconds: `12.3 s`, `45 min`, `3.1 h`, `2.5 days`.
#[derive(Clone, Copy, Debug)]
pub struct HumanDuration(pub f64);

impl fmt::Display for HumanDuration {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            s if s < 120.0 => write!(f, "{s:.1} s"),
            s if s < 7200.0 => write!(f, "{:.0} min", s / 60.0),
            s if s < 172_800.0 => write!(f, "{:.1} h", s / 3600.0),
            s => write!(f, "{:.1} days", s / 86_400.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_have_commas_and_sizes_binary_units() {
        let counts = [0, 12, 999, 1000, 1_234_567].map(|count| HumanCount(count).to_string());
        assert_eq!(counts, ["0", "12", "999", "1,000", "1,234,567"]);
        assert_eq!([0, 1, 2000].map(|count| HumanCount(count).of("shard")), ["0 shards", "1 shard", "2,000 shards"]);
        let sizes = [15, 1023, 1024, 1_500, 1_500_000, u64::MAX].map(|size| HumanBytes(size).to_string());
        assert_eq!(sizes, ["15 B", "1023 B", "1.00 KiB", "1.46 KiB", "1.43 MiB", "16.00 EiB"]);
    }
}
