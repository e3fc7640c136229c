"""Libraries that a part of the package needs and the command `gelsim` does not."""

from __future__ import annotations

import shlex
import shutil
import sys
from collections.abc import Iterable
from contextlib import redirect_stderr
from importlib import import_module, metadata
from io import StringIO
from pathlib import Path
from typing import Any, NamedTuple, Optional


class Library(NamedTuple):
    """A library, and which versions of it will do; pyproject.toml says the same."""

    name: str
    lowest: str
    below_with_numpy_1: str = ""
    """The first version that takes numpy 2 only."""


LIBRARIES = {
    "numpy": Library("numpy", "1.22"),
    "PIL": Library("pillow", "9"),
    "OpenEXR": Library("OpenEXR", "3.5"),
    "pyarrow": Library("pyarrow", "16", "26"),
    "h5py": Library("h5py", "3.11", "3.17"),
    "mujoco": Library("mujoco", "3.2"),
    "gymnasium": Library("gymnasium", "1.0"),
    "pybullet": Library("pybullet", "3.2.6"),
    "scipy": Library("scipy", "1.9"),
    "trimesh": Library("trimesh", "4"),
    "pydrake": Library("drake", "1.40"),
    "sapien": Library("sapien", "3.0"),
    "genesis": Library("genesis-world", "1.4"),
    "newton": Library("newton", "1.4"),
}
"""By the module's name."""


READY: dict[str, Any] = {}
"""Modules that were found fit."""


def need(name: str) -> Any:
    """The module `name`, or an ImportError of one sentence that ends with the command which brings it."""
    if name not in READY:
        need_all([name])
        READY[name] = import_module(name)
    return READY[name]


def need_all(names: Iterable[str]) -> None:
    """The same of several at once: one command brings all that are wanting."""
    missing: list[Library] = []
    unfit: list[Library] = []
    said: list[str] = []
    cause: Optional[Exception] = None
    for name in names:
        library = LIBRARIES[name.split(".")[0]]
        try:
            imported(name)
        except Exception as error:  # a library that was built for another numpy raises what it pleases
            cause = error
            at_fault = LIBRARIES.get(str(getattr(error, "name", "")).split(".")[0])
            if isinstance(error, ModuleNotFoundError) and at_fault is not None:
                missing += [at_fault] if at_fault not in missing else []
            else:
                unfit.append(library)
                said.append(why_not(library, error))
            continue
        found = installed(library)
        if found is not None and number(found) < number(library.lowest):
            unfit.append(library)
            said.append(f"this needs {library.name} {library.lowest} or newer, and {found} is installed")
    if missing:
        wanted = listed([library.name for library in missing])
        said.insert(0, f"this needs {wanted}, which {'is' if len(missing) == 1 else 'are'} not installed")
    if said:
        # None of them needs another library than those here.
        options = ["--force-reinstall", "--no-deps"] if unfit else []
        raise ImportError(f"{'; '.join(said)}: {pip(options, missing + unfit)}") from cause


def imported(name: str) -> None:
    """Imports a module. What it prints is shown only if it can be imported: numpy prints pages about those that cannot."""
    if name in sys.modules:
        import_module(name)
        return
    printed = StringIO()
    with redirect_stderr(printed):
        import_module(name)
    sys.stderr.write(printed.getvalue())


def why_not(library: Library, error: Exception) -> str:
    """Why an installed library cannot be imported."""
    lines = str(error).strip().splitlines() or [type(error).__name__]
    beside = f" beside numpy {found}" if library.name != "numpy" and (found := installed(LIBRARIES["numpy"])) else ""
    return f"{library.name} {installed(library) or ''}".strip() + f" cannot be imported{beside} ({lines[0][:200]})"


def pip(options: list[str], libraries: list[Library]) -> str:
    """The command that installs them for this Python, as short as it can be written."""
    own = shutil.which("pip")
    is_own = own is not None and Path(own).parent == Path(sys.executable).parent
    command = ["pip"] if is_own else [sys.executable or "python3", "-m", "pip"]
    return " ".join([*map(shlex.quote, command), "install", *options, *(f"'{requirement(library)}'" for library in libraries)])


def requirement(library: Library) -> str:
    """As pip takes it: what fits the numpy that is installed."""
    numpy = installed(LIBRARIES["numpy"])
    is_old = library.below_with_numpy_1 and numpy is not None and number(numpy) < (2,)
    return f"{library.name}>={library.lowest}" + (f",<{library.below_with_numpy_1}" if is_old else "")


def installed(library: Library) -> Optional[str]:
    """The version that is installed, if that is known."""
    try:
        return metadata.version(library.name)
    except metadata.PackageNotFoundError:
        return None


def number(version: str) -> tuple[int, ...]:
    """A version to be compared: its whole numbers, up to what is none."""
    parts = []
    for part in version.split("."):
        if not part.isdecimal():
            break
        parts.append(int(part))
    return tuple(parts)


def listed(names: list[str]) -> str:
    """`a, b and c`."""
    return " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))
