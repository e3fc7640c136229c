//! The Python module `gelsim._native`; `python/gelsim` is the package around it.

#![forbid(unsafe_code)]

mod arguments;
mod arrays;
mod depth;
mod errors;
mod generate;
mod job;
mod mesh;
mod sensor;
mod simulator;
mod threads;

/// Keeps freed memory for the next sample, as the command does. Python's own memory is not touched, nor how its process
/// allocates.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

#[pyo3::pymodule(gil_used = false)]
mod _native {
    use std::panic::catch_unwind;

    use pyo3::prelude::*;

    use crate::arguments::words;
    #[pymodule_export]
    use crate::errors::{RunError, UsageError};
    #[pymodule_export]
    use crate::generate::generate;
    #[pymodule_export]
    use crate::job::{Job, job_of_text};
    #[pymodule_export]
    use crate::mesh::{ReadyMesh, mesh_of_arrays, mesh_of_file};
    #[pymodule_export]
    use crate::sensor::{Sensor, sensor_of_source};
    #[pymodule_export]
    use crate::simulator::{Engine, Pressing};

    #[pymodule_export]
    #[allow(non_upper_case_globals, reason = "the name that Python gives to it")]
    const __version__: &str = env!("CARGO_PKG_VERSION");

    /// Has pyo3 see once that Python runs. While Python ends it says that it does not, and pyo3 would panic at an error.
    #[pymodule_init]
    fn begin(module: &Bound<'_, PyModule>) -> PyResult<()> {
        // It looks only where it has not got Python's lock already.
        module.py().detach(|| Python::attach(|_| Ok(())))
    }

    /// Runs the command line `argv`, the program's name first. Prints as the command does; gives its exit status.
    ///
    /// Once per process, and from its main thread: it takes over SIGINT and SIGTERM.
    #[pyfunction]
    fn main(py: Python<'_>, argv: &Bound<'_, PyAny>) -> PyResult<u8> {
        let argv = words("argv", argv)?;
        Ok(py.detach(|| catch_unwind(|| gelsim_cli::main(argv)).unwrap_or(gelsim_cli::PANICKED)))
    }
}
