//! The Python module `gelsim._native`. The package around it is `python/gelsim`.

#![forbid(unsafe_code)]

mod arguments;
mod arrays;
mod depth;
mod errors;
mod generate;
mod job;
mod mesh;
mod sensor;
mod sequence;
mod simulator;
mod threads;

/// Keeps freed memory for the next sample, as the command does. Python's own allocations are not affected.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

#[pyo3::pymodule(gil_used = false)]
mod _native {
    use std::panic::catch_unwind;

    use pyo3::prelude::*;

    use crate::arguments::extract_words;
    #[pymodule_export]
    use crate::errors::{RunError, UsageError};
    #[pymodule_export]
    use crate::generate::generate;
    #[pymodule_export]
    use crate::job::{Job, job_of_file, job_of_text};
    #[pymodule_export]
    use crate::mesh::{ReadyMesh, mesh_of_arrays, mesh_of_file};
    #[pymodule_export]
    use crate::sensor::{Sensor, sensor_of_source};
    #[pymodule_export]
    use crate::sequence::step_all;
    #[pymodule_export]
    use crate::simulator::{Engine, Pressing};

    #[pymodule_export]
    #[allow(non_upper_case_globals, reason = "the name that Python gives to it")]
    const __version__: &str = env!("CARGO_PKG_VERSION");

    /// Lets pyo3 see once that Python runs. While Python shuts down it says that it is not running, and pyo3 would
    /// panic at the next error.
    #[pymodule_init]
    fn attach_once(module: &Bound<'_, PyModule>) -> PyResult<()> {
        // pyo3 looks only when it takes Python's lock anew, so it is released first.
        module.py().detach(|| Python::attach(|_| Ok(())))
    }

    /// Runs the command line `argv`, the program's name first. Prints as the command does; gives its exit status.
    ///
    /// Once per process, and from its main thread: it takes over SIGINT and SIGTERM.
    #[pyfunction]
    fn main(py: Python<'_>, argv: &Bound<'_, PyAny>) -> PyResult<u8> {
        let argv = extract_words("argv", argv)?;
        Ok(py.detach(|| catch_unwind(|| gelsim_cli::main(argv)).unwrap_or(gelsim_cli::PANICKED)))
    }
}
