//! The cases of a table, checked side by side.

use std::panic::{AssertUnwindSafe, catch_unwind};

use rayon::prelude::*;

/// Checks every case on all cores, those alone whose name holds `GELSIM_CASE` where that is set, and panics with the names of all
/// that failed. What each has to say stands above.
pub fn check_cases<T: Sync, R>(cases: &[T], name: impl Fn(&T) -> &str + Send + Sync, check: impl Fn(&T) -> R + Sync) {
    let wanted = std::env::var("GELSIM_CASE").unwrap_or_default();
    let chosen = cases.par_iter().filter(|case| name(case).contains(&wanted));
    let fails = |case: &&T| catch_unwind(AssertUnwindSafe(|| drop(check(case)))).is_err();
    let failed: Vec<&str> = chosen.filter(fails).map(&name).collect();
    assert!(failed.is_empty(), "{} of {} cases failed: {}", failed.len(), cases.len(), failed.join(", "));
}
