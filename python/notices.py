"""Prints the notices that whoever passes on the compiled module or command owes to others: the licences of all crates in it.

    python3 python/notices.py TRIPLE > LICENSE-THIRD-PARTY

It reads `cargo metadata` of the module with object stores, which has every crate of the command, and the licence files in the
sources of the crates. It asks nothing of the network if these sources are there, as after a build. Crates that run only while
others are compiled are left out, except macros, whose output is in the program. A crate that may be used under MIT, among
others, is used under MIT. Equal texts stand once, after the names of all their crates.
"""

import json
import pathlib
import re
import subprocess
import sys

PROJECT = pathlib.Path(__file__).resolve().parents[1]
NAMED_AS_LICENCE = re.compile(r"(licen[cs]e|copying|notice|copyright|unlicense)([-._].*)?", re.I)
# What is not compiled.
LEFT_OUT = {"tests", "test", "examples", "benches", "fuzz"}


def linked(target):
    """The crates of others that are in the module, by name and version."""
    command = ["cargo", "metadata", "--format-version", "1", "--locked", "--manifest-path", PROJECT / "python/Cargo.toml"]
    done = subprocess.run([*command, "--features", "stores", "--filter-platform", target], stdout=subprocess.PIPE, check=True)
    metadata = json.loads(done.stdout)
    packages = {package["id"]: package for package in metadata["packages"]}
    nodes = {node["id"]: node for node in metadata["resolve"]["nodes"]}
    found, waiting = set(), [metadata["resolve"]["root"]]
    while waiting:
        name = waiting.pop()
        if name not in found:
            found.add(name)
            waiting += [
                dependency["pkg"]
                for dependency in nodes[name]["deps"]
                if any(kind["kind"] is None for kind in dependency["dep_kinds"])
            ]
    others = [packages[name] for name in found if packages[name]["source"] is not None]
    return sorted(others, key=lambda package: (package["name"], package["version"]))


def texts(package):
    """The licence texts of a crate, each with the path of its file."""
    folder = pathlib.Path(package["manifest_path"]).parent
    files = [
        path
        for path in sorted(folder.rglob("*"))
        if NAMED_AS_LICENCE.fullmatch(path.name) and path.is_file() and path.suffix not in (".rs", ".py")
        if not LEFT_OUT.intersection(path.relative_to(folder).parts[:-1])
    ]
    top = [path for path in files if path.parent == folder]
    deeper = [path for path in files if path.parent != folder]
    if may_be_mit(package):
        top = [path for path in top if "mit" in path.name.lower()] or top
    if top:
        return [(path.relative_to(folder), path.read_text(errors="replace")) for path in top + deeper]
    if package["license"] == "Zlib":
        # It asks for its notice in sources alone.
        return []
    if not may_be_mit(package):
        sys.exit(f"{package['name']} {package['version']} ({package['license']}) has no licence file: say here what its notice is")
    # The text of MIT, which asks for the name of the authors.
    own = (PROJECT / "LICENSE-MIT").read_text()
    authors = ", ".join(re.sub(r"\s*<.*?>", "", author) for author in package["authors"]) or f"the authors of {package['name']}"
    return [("its Cargo.toml", re.sub(r"(?m)^Copyright .*$", f"Copyright (c) {authors}", own))]


def may_be_mit(package):
    """Whether MIT is one of the licences among which whoever uses the crate may choose."""
    choices = re.split(r"\s+OR\s+|/", package["license"] or "")
    return "MIT" in choices


def main(target):
    packages = linked(target)
    by_text = {}
    for package in packages:
        for name, text in texts(package):
            # Files that differ in line breaks alone are one text.
            same = by_text.setdefault(" ".join(text.split()), (text, []))
            same[1].append(f"{package['name']} {package['version']} ({name})")
    print(
        f"The compiled parts of gelsim for {target} contain {len(packages)} crates of others. Their licences follow:\n"
        "first a list, then each text after the crates, and the files of these, from which it comes.\n"
    )
    for package in packages:
        print(f"{package['name']} {package['version']}: {package['license'] or package['license_file']}")
    for text, names in sorted(by_text.values(), key=lambda pair: pair[1]):
        rule = "=" * 80
        print("\n" + "\n".join([rule, *names, rule]) + "\n")
        print(text.replace("\r\n", "\n").strip("\n"))


if __name__ == "__main__":
    main(*sys.argv[1:])
