"""Builds and runs the README's program against the library alone, and runs the examples: python library.py

Checks that it has at most 60 crates beneath it and saves an image that is no flat pad. Needs cargo; what it compiles is kept
in target/library. The examples are those that `cargo test --release` has built.
"""

import os
import re
import struct
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
MOST_CRATES = 60

MANIFEST = f"""[package]
name = "ball"
edition = "2024"

[dependencies]
gelsim = {{ path = {str(ROOT)!r}, default-features = false }}

[profile.dev]
opt-level = 0
debug = false
"""


def main():
    text = (ROOT / "README.md").read_text()
    section = text.split("## As a Rust library")[1].split("\n## ")[0]
    program = re.search(r"```rust\n(.*?)```", section, re.S)[1]
    said = int(re.search(r"(\d+) crates beneath", section)[1])
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        (folder / "src").mkdir()
        (folder / "src/main.rs").write_text(program)
        (folder / "Cargo.toml").write_text(MANIFEST.replace("'", '"'))
        (folder / "Cargo.lock").write_bytes((ROOT / "Cargo.lock").read_bytes())
        cargo = lambda *arguments: subprocess.run(
            ["cargo", *arguments], cwd=folder, check=True, stdout=subprocess.PIPE, text=True
        ).stdout
        tree = cargo("tree", "--edges", "normal", "--prefix", "none", "--format", "{p}")
        lines = {line.split(" (")[0] for line in tree.splitlines() if line}
        crates = {line for line in lines if line.split(" ")[0] not in ("ball", "gelsim")}
        print(f"{len(crates)} crates beneath the library; allowed: {MOST_CRATES}")
        if len(crates) > MOST_CRATES or len(crates) != said:
            sys.exit(f"the README says {said}: " + ", ".join(sorted(crates)))
        print(cargo("run", "--quiet", "--target-dir", ROOT / "target/library").strip())
        image = (folder / "ball.png").read_bytes()
        width, height = struct.unpack(">II", image[16:24])
        print(f"ball.png: {width}x{height} px, {len(image)} bytes")
        if (width, height) != (320, 240) or len(image) < 20_000:
            sys.exit("no image of a ball")
    run_examples()


def run_examples():
    """Runs the three programs of docs/examples where they find the bundled objects, and looks at what they save."""
    target = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "objects").symlink_to(ROOT / "objects")
        for example, saved in (("press", 1), ("sequence", 1), ("led", 2)):
            said = subprocess.run(
                [target / "release/examples" / example], cwd=folder, check=True, stdout=subprocess.PIPE, text=True
            ).stdout
            print(said.strip())
            images = list(Path(folder).glob(f"{example}*.png"))
            if len(images) != saved or not all(image.stat().st_size > 20_000 for image in images):
                sys.exit(f"{example} saved {images}")
            if "NaN" in said or example == "led" and " 0 of" in said:
                sys.exit(f"{example} says {said}")


if __name__ == "__main__":
    main()
