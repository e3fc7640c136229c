//! A job's text, resolved as the command line would; golden images and benches use it too.

use std::path::Path;

use gelsim_files::diagnostic::Diagnostics;
use gelsim_job::config::{self, Overrides};
use gelsim_job::plan::Plan;

/// The folder of the project.
pub fn repository() -> &'static Path {
    // The benches are a crate below it.
    let mut folders = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors();
    folders.find(|folder| folder.join("objects").is_dir()).expect("the repository")
}

/// The plan of a job. What it names by path is relative to the repository.
pub fn plan(job: &str) -> Plan {
    plan_in(repository(), job)
}

/// The plan of a job. What it names by path is relative to the folder.
pub fn plan_in(folder: &Path, job: &str) -> Plan {
    let mut problems = Diagnostics::default();
    let written = config::read_job_text("job", job.to_owned(), folder, &Overrides::default(), &mut problems);
    match Plan::resolve(written, problems) {
        Ok(plan) => plan,
        Err(report) => panic!("{report}"),
    }
}
