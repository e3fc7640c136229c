"""The README's program against the library alone, and the programs of docs/examples."""

import os
import re
import shutil
import struct

import pytest
from processes import run

pytestmark = pytest.mark.build

MOST_CRATES = 60

MANIFEST = """[package]
name = "ball"
edition = "2024"

[dependencies]
gelsim = {{ path = "{}", default-features = false }}

[profile.dev]
opt-level = 0
debug = false
"""


@pytest.fixture(scope="module")
def readme(project):
    return (project / "README.md").read_text()


@pytest.fixture(scope="module")
def cargo(readme, project, tmp_path_factory):
    """Runs cargo in a package whose program is the README's: what it prints. target/library keeps what it compiles."""
    if not shutil.which("cargo"):
        pytest.skip("no cargo: https://rustup.rs")
    programs = [code for code in re.findall(r"```rust\n(.*?)```", readme, re.S) if "fn main" in code]
    assert len(programs) == 1, "the README has no Rust program, or several"
    folder = tmp_path_factory.mktemp("library")
    (folder / "src").mkdir()
    (folder / "src/main.rs").write_text(programs[0])
    (folder / "Cargo.toml").write_text(MANIFEST.format(project))
    shutil.copy(project / "Cargo.lock", folder)

    def cargo(*arguments):
        target = {**os.environ, "CARGO_TARGET_DIR": str(project / "target/library")}
        return run("cargo", *arguments, cwd=folder, env=target).stdout

    cargo.folder = folder
    return cargo


def test_the_readme_says_how_many_crates_are_beneath_the_library(cargo, readme):
    tree = cargo("tree", "--edges", "normal", "--prefix", "none", "--format", "{p}")
    lines = {line.split(" (")[0] for line in tree.splitlines() if line}
    crates = sorted(line for line in lines if line.split(" ")[0] not in ("ball", "gelsim"))
    assert [len(crates)] == [int(count) for count in re.findall(r"(\d+) crates beneath", readme)], crates
    assert len(crates) <= MOST_CRATES, crates


def test_the_readmes_program_saves_an_image_that_is_no_flat_pad(cargo):
    cargo("run", "--quiet")
    image = (cargo.folder / "ball.png").read_bytes()
    assert struct.unpack(">II", image[16:24]) == (320, 240) and len(image) >= 20_000


@pytest.mark.parametrize("example, saved", [("press", 1), ("sequence", 1), ("led", 2)])
def test_an_example_saves_its_images(gelsim_path, project, tmp_path, example, saved):
    program = gelsim_path.parent / "examples" / example
    assert program.is_file(), f"{program} is not there: cargo build --release --examples"
    # Where it finds the bundled objects.
    (tmp_path / "objects").symlink_to(project / "objects")
    said = run(program, cwd=tmp_path).stdout
    sizes = [image.stat().st_size for image in tmp_path.glob(f"{example}*.png")]
    assert len(sizes) == saved and min(sizes) > 20_000
    assert "NaN" not in said and not (example == "led" and " 0 of" in said)
