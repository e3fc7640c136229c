#!/usr/bin/env bash
# Builds wheels that pip installs without a compiler, for manylinux2014 (glibc 2.17) and every Python from 3.9:
#
#     bash python/wheels.sh [FOLDER]      FOLDER [default: dist] gets the wheels
#
# For each of the two processors whose Rust standard library is installed (`rustup target add TRIPLE` brings another one). zig, as a
# compiler of C and a linker that knows old C libraries, comes from PyPI with maturin. The command in them knows object stores.
set -euo pipefail
cd "$(dirname "$0")/.."

out=$(realpath -m "${1:-dist}")
tools=$(mktemp -d)
trap 'rm -rf "$tools"' EXIT
python3 -m venv "$tools"
"$tools/bin/pip" install --quiet --disable-pip-version-check "maturin>=1.9,<2" ziglang
# maturin asks the Python that comes first for zig.
export PATH="$tools/bin:$PATH"

built=0
for target in x86_64-unknown-linux-gnu aarch64-unknown-linux-gnu; do
    if [ ! -d "$(rustc --print target-libdir --target "$target")" ]; then
        echo "left out: $target, whose Rust standard library is not installed: rustup target add $target"
        continue
    fi
    maturin build --release --locked --features stores --target "$target" --zig --compatibility manylinux2014 --out "$out"
    built=$((built + 1))
done
[ "$built" -gt 0 ] || { echo "no wheel was built"; exit 1; }
