//! Suspicions.
