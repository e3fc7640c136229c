//! Tools around datasets and sensors: calibration, comparison, inspection, previews, reports, and the cost of accuracy.

pub mod calibrate;
pub mod compare;
pub mod inspect;
pub mod metrics;
pub mod numbers;
pub mod outcome;
pub mod page;
pub mod presses;
pub mod preview;
pub mod report;
pub mod text_table;
pub mod tradeoff;
