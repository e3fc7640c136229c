//! A job's text, resolved as the command line would; golden images and benches use it too.

use std::path::Path;

use gelsim::config::diagnostic::Problems;
use gelsim::config::{self, Overrides};
use gelsim::plan::Plan;

/// The plan of a job. What it names by path is relative to the repository.
pub fn plan(job: &str) -> Plan {
    let mut problems = Problems::default();
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let written = config::read_text("job", job.to_owned(), folder, &Overrides::default(), &mut problems);
    match Plan::resolve(written, problems) {
        Ok(plan) => plan,
        Err(report) => panic!("{report}"),
    }
}
