//! The single file that a command writes to the path of `--out`.

use std::path::Path;

use super::Failure;
use gelsim_files::diagnostic::user_error;
use gelsim_files::spelling::quote_for_shell;
use gelsim_files::write::write_output;

/// Fails, before the work, if no file with one of these `endings` can be written at `out`. `what` is a name that would
/// do, for example `picture.png`.
pub(super) fn check_output_path(out: &Path, endings: &[&str], what: &str) -> Result<(), Failure> {
    let name = out.display();
    let known = out.extension().and_then(|ending| ending.to_str()).map(str::to_ascii_lowercase);
    if !known.is_some_and(|ending| endings.contains(&ending.as_str())) {
        let dotted: Vec<String> = endings.iter().map(|ending| format!(".{ending}")).collect();
        let all = match dotted.split_last() {
            Some((last, rest)) if !rest.is_empty() => format!("{} or {last}", rest.join(", ")),
            _ => dotted.concat(),
        };
        let message = format!("{name} cannot be the name of what is written, which ends in {all}");
        return Err(user_error(message, format!("name such a file: --out {what}")).into());
    }
    if out.is_dir() {
        let help = format!("name a file in it: --out {}", quote_for_shell(&out.join(what)));
        return Err(user_error(format!("{name} is a folder"), help).into());
    }
    match parent_folder(out) {
        folder if folder.is_dir() => Ok(()),
        folder if folder.exists() => {
            let message = format!("{name} cannot be written: {} is no folder", folder.display());
            Err(user_error(message, "name another place with --out").into())
        }
        folder => {
            let message = format!("{name} cannot be written: there is no folder {}", folder.display());
            Err(user_error(
                message,
                format!("make it with mkdir -p {}, or name another place with --out", quote_for_shell(folder)),
            )
            .into())
        }
    }
}

/// Writes a file completely.
pub(super) fn write_whole_file(out: &Path, bytes: &[u8]) -> Result<(), Failure> {
    let denied = |error| Failure::access_denied(&format!("{}: {error}", out.display()), &error, "nothing was written");
    write_output(out, bytes).map_err(denied)
}

/// Returns the folder that a file is in.
pub(super) fn parent_folder(out: &Path) -> &Path {
    out.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}
