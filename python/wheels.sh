#!/usr/bin/env bash
# Builds the source distribution, and wheels that pip installs without a compiler, for manylinux2014 (glibc 2.17) and every Python
# from 3.9:
#
#     bash python/wheels.sh [FOLDER [TRIPLE..]]      FOLDER [default: dist] gets them
#
# For each of the two processors, or of those named, whose Rust standard library is installed (`rustup target add TRIPLE` brings another
# one). zig, as a compiler of C and a linker that knows old C libraries, comes from PyPI with maturin. The command in them knows object
# stores. Each wheel has the licences of what is compiled into it (python/notices.py), as pyproject.toml takes every LICENSE-*.
set -euo pipefail
cd "$(dirname "$0")/.."

out=$(realpath -m "${1:-dist}")
targets=("${@:2}")
[ ${#targets[@]} -gt 0 ] || targets=(x86_64-unknown-linux-gnu aarch64-unknown-linux-gnu)
tools=$(mktemp -d)
trap 'rm -rf "$tools" LICENSE-THIRD-PARTY LICENSE-RUST-LIBRARY.html LICENSE-ZIG' EXIT
python3 -m venv "$tools"
"$tools/bin/pip" install --quiet --disable-pip-version-check "maturin>=1.9,<2" ziglang
# maturin asks the Python that comes first for zig.
export PATH="$tools/bin:$PATH"

# Where the system has the library that unwinds stacks on a target's processor.
gcc_s() {
    local name=${1%%-*} path
    local paths=("/lib/$name-linux-gnu/libgcc_s.so.1" "/usr/$name-linux-gnu/lib/libgcc_s.so.1")
    [ "$name" != "$(uname -m)" ] || paths+=(/lib64/libgcc_s.so.1 /usr/lib/libgcc_s.so.1)
    for path in "${paths[@]}"; do
        [ ! -e "$path" ] || { echo "$path"; return; }
    done
    return 1
}

# Before there are notices of what is compiled: it has nothing of others.
maturin sdist --out "$out"

# Rust's own library and zig's, of which the linker takes what the processor lacks, are in a wheel, too.
cp "$(rustc --print sysroot)/share/doc/rust/COPYRIGHT-library.html" LICENSE-RUST-LIBRARY.html
cp "$("$tools/bin/python" -c 'import ziglang; print(ziglang.__path__[0])')/LICENSE" LICENSE-ZIG
built=0
for target in "${targets[@]}"; do
    if [ ! -d "$(rustc --print target-libdir --target "$target")" ]; then
        echo "left out: $target, whose Rust standard library is not installed: rustup target add $target"
        continue
    fi
    # zig would put an unwinder of its own into the module. Python ends daemon threads by unwinding them with the system's, and
    # two unwinders in one thread bring the process down. So the module's symbols are found in the system's library first.
    unwinder=$(gcc_s "$target") || { echo "left out: $target, whose libgcc_s.so.1 is not installed"; continue; }
    ln -sf "$unwinder" "$tools/libsystem_unwinder.so"
    python3 python/notices.py "$target" >LICENSE-THIRD-PARTY
    RUSTFLAGS="${RUSTFLAGS:-} -L native=$tools -l dylib=system_unwinder" \
        maturin build --release --locked --features stores --target "$target" --zig --compatibility manylinux2014 --out "$out"
    built=$((built + 1))
done
[ "$built" -gt 0 ] || { echo "no wheel was built"; exit 1; }
