//! `gelsim export`: the Python module's command, where that is installed.

use std::ffi::OsString;
use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::Command;

use clap::Args;

use super::Failure;
use gelsim_files::diagnostic::user_error;

/// Copy a dataset to LeRobot, Zarr, HDF5 or a layout that tactile encoders read. The Python module does it: this command
/// starts its `gelsim-export` with the same arguments.
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  gelsim export out/quickstart --to lerobot --out quickstart.lerobot
  gelsim export out/quickstart --to zarr --out quickstart.zarr
  gelsim export out/quickstart --to hdf5 --out quickstart.h5 --check

`gelsim-export --help` lists its arguments.")]
pub struct Export {
    /// The arguments of gelsim-export: DIR --to FORMAT --out OUT
    #[arg(required = true, value_name = "ARGUMENT", trailing_var_arg = true, allow_hyphen_values = true)]
    arguments: Vec<OsString>,
}

/// The command that the Python module installs.
const COMMAND: &str = "gelsim-export";

impl Export {
    pub(super) fn run(self) -> Result<(), Failure> {
        // Beside this program, where an environment has both; else wherever the path finds it.
        let beside = std::env::current_exe().ok().and_then(|path| Some(path.parent()?.join(COMMAND)));
        let found = beside.filter(|path| path.is_file()).unwrap_or_else(|| PathBuf::from(COMMAND));
        // `exec` returns only if the command cannot be started.
        let error = Command::new(&found).args(&self.arguments).exec();
        if error.kind() == std::io::ErrorKind::NotFound {
            let message = "gelsim export is a part of the Python module, and no gelsim-export is on the path";
            let help = "install the module in a Python environment, in the project's folder: pip install '.[export]'";
            return Err(user_error(message, help).into());
        }
        Err(Failure::from_path(&found, &error))
    }
}
