"""The library's public surface as text: python surface.py [--update]

Lists every type, function, field, variant and method that a program which depends on `gelsim` can name, from what rustdoc knows,
and compares the list with tests/library/surface.txt, so that a change of it is seen and meant. `--update` writes the file.
Fails also where a public signature names a type of the simulator that is not exported, or a public item has no documentation.
"""

import difflib
import json
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
LISTING = ROOT / "tests/library/surface.txt"
# What the script was written for. Another compiler's rustdoc may write another format.
FORMAT = 57
# Traits that tell a reader what a type can do.
TRAITS = ("Clone", "Copy", "Debug", "Default", "PartialEq", "Error", "Display", "From", "Index", "Serialize", "Deserialize")


def document(package, *flags):
    """What rustdoc knows of a crate."""
    target = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    command = ["cargo", "rustdoc", "--quiet", "--release", "--locked", "--lib", "-p", package, *flags, "--"]
    command += ["-Zunstable-options", "--output-format=json"]
    subprocess.run(command, cwd=ROOT, check=True, env={**os.environ, "RUSTC_BOOTSTRAP": "1"})
    return Crate(json.loads((target / "doc" / f"{package.replace('-', '_')}.json").read_text()))


class Crate:
    def __init__(self, found):
        self.index, self.paths, self.root = found["index"], found["paths"], str(found["root"])
        self.format = found["format_version"]
        self.by_path = {"::".join(path["path"]): id for id, path in self.paths.items() if path["crate_id"] == 0}

    def item(self, id):
        return self.index[str(id)]

    def path(self, id):
        """The path of an item of ours, of whatever crate; None of all others."""
        known = self.paths.get(str(id))
        return "::".join(known["path"]) if known and known["path"][0].startswith("gelsim") else None


class Surface:
    def __init__(self, crates):
        self.crates, self.lines, self.missing, self.undocumented = crates, [], {}, []
        self.exported = {}  # path where it is defined -> name in `gelsim`
        root = crates["gelsim"]
        for id in root.item(root.root)["inner"]["module"]["items"]:
            item = root.item(id)
            if "use" in item["inner"]:
                use = item["inner"]["use"]
                self.exported[root.path(use["id"])] = use["name"]
            elif item["visibility"] == "public":
                self.exported[root.path(id)] = item["name"]

    def list(self):
        for path, name in sorted(self.exported.items(), key=lambda each: each[1]):
            crate = self.crates[path.split("::")[0]]
            self.add(crate, name, crate.item(crate.by_path[path]))
        return "\n".join(self.lines) + "\n"

    def add(self, crate, name, item):
        (kind, inner), = item["inner"].items()
        self.crate, self.where = crate, name
        self.need_docs(item, name)
        attributes = "".join("#[non_exhaustive] " for a in item["attrs"] if a == "non_exhaustive")
        say = lambda text, *, under=True: self.lines.append(("    " if under else "") + text)
        if kind == "struct":
            say(f"{attributes}struct {name}{self.able(inner)}", under=False)
            fields = inner["kind"].get("plain", {}).get("fields", []) if isinstance(inner["kind"], dict) else []
            for field in map(crate.item, fields):
                if field["visibility"] == "public":
                    self.need_docs(field, f"{name}.{field['name']}")
                    say(f"{field['name']}: {self.type(field['inner']['struct_field'])}")
        elif kind == "enum":
            say(f"{attributes}enum {name}{self.able(inner)}", under=False)
            for variant in map(crate.item, inner["variants"]):
                self.need_docs(variant, f"{name}::{variant['name']}")
                held = variant["inner"]["variant"]["kind"]
                text = variant["name"]
                if isinstance(held, dict) and "tuple" in held:
                    types = [self.type(crate.item(id)["inner"]["struct_field"]) for id in held["tuple"]]
                    text += f"({', '.join(types)})"
                elif isinstance(held, dict):
                    fields = [crate.item(id) for id in held["struct"]["fields"]]
                    text += " { " + ", ".join(f"{f['name']}: {self.type(f['inner']['struct_field'])}" for f in fields) + " }"
                say(text)
        elif kind == "trait":
            say(f"trait {name}", under=False)
            for method in map(crate.item, inner["items"]):
                self.need_docs(method, f"{name}::{method['name']}")
                say(self.function(method))
        elif kind == "function":
            say(self.function({**item, "name": name}), under=False)
        elif kind == "constant":
            say(f"const {name}: {self.type(inner['type'])}", under=False)
        else:
            sys.exit(f"{name} is a {kind}, which this script does not list")
        for id in inner.get("impls", []):
            impl = crate.item(id)["inner"]["impl"]
            if impl["trait"] is None:
                for member in map(crate.item, impl["items"]):
                    if member["visibility"] == "public":
                        self.need_docs(member, f"{name}::{member['name']}")
                        constant = member["inner"].get("assoc_const")
                        say(f"const {member['name']}: {self.type(constant['type'])}" if constant else self.function(member))

    def need_docs(self, item, name):
        if not item["docs"]:
            self.undocumented.append(name)

    def able(self, inner):
        """The traits that a reader asks for."""
        impls = [self.crate.item(id)["inner"]["impl"] for id in inner["impls"]]
        found = {impl["trait"]["path"].split("::")[-1] for impl in impls if impl["trait"] and not impl["blanket_impl"]}
        able = [name for name in TRAITS if name in found]
        return ": " + ", ".join(able) if able else ""

    def function(self, item):
        signature = item["inner"]["function"]["sig"]
        inputs = []
        for name, kind in signature["inputs"]:
            text = self.type(kind)
            inputs.append({"Self": "self", "&Self": "&self", "&mut Self": "&mut self"}.get(text, f"self: {text}") if name == "self" else f"{name}: {text}")
        output = f" -> {self.type(signature['output'])}" if signature["output"] else ""
        return f"fn {item['name']}({', '.join(inputs)}){output}"

    def type(self, kind):
        (name, inner), = kind.items()
        if name == "resolved_path":
            return self.resolved(inner)
        if name == "generic" or name == "primitive":
            return inner
        if name == "borrowed_ref":
            return "&" + ("mut " if inner["is_mutable"] else "") + self.type(inner["type"])
        if name == "tuple":
            return f"({', '.join(map(self.type, inner))})"
        if name == "slice":
            return f"[{self.type(inner)}]"
        if name == "array":
            return f"[{self.type(inner['type'])}; {inner['len']}]"
        if name == "impl_trait":
            return "impl " + " + ".join(self.bound(bound) for bound in inner)
        if name == "dyn_trait":
            return "dyn " + " + ".join(self.resolved(each["trait"]) for each in inner["traits"])
        if name == "qualified_path":
            return f"{self.type(inner['self_type'])}::{inner['name']}"
        if name == "function_pointer":
            return "fn"
        sys.exit(f"{self.where}: a {name}, which this script does not know")

    def bound(self, bound):
        return self.resolved(bound["trait_bound"]["trait"]) if "trait_bound" in bound else "'_"

    def resolved(self, named):
        path = self.crate.path(named["id"])
        if path is not None and path not in self.exported:
            self.missing.setdefault(path, set()).add(self.where)
        held = (named.get("args") or {}).get("angle_bracketed") or {}
        given = [self.type(each["type"]) for each in held.get("args", []) if "type" in each]
        for bound in held.get("constraints", []):
            value = bound["binding"]
            if "equality" in value and "type" in value["equality"]:
                given.append(f"{bound['name']} = {self.type(value['equality']['type'])}")
        parenthesized = (named.get("args") or {}).get("parenthesized")
        if parenthesized:
            output = f" -> {self.type(parenthesized['output'])}" if parenthesized["output"] else ""
            return f"{named['path'].split('::')[-1]}({', '.join(map(self.type, parenthesized['inputs']))}){output}"
        name = self.exported.get(path, named["path"].split("::")[-1])
        return name + (f"<{', '.join(given)}>" if given else "")


def main():
    crates = {
        "gelsim": document("gelsim"),
        "gelsim_core": document("gelsim-core", "--features", "schema"),
        "gelsim_files": document("gelsim-files"),
    }
    if any(crate.format != FORMAT for crate in crates.values()):
        print(f"skipped: this compiler's rustdoc writes format {crates['gelsim'].format}, the script reads {FORMAT}")
        return
    surface = Surface(crates)
    text = surface.list()
    for path, places in sorted(surface.missing.items()):
        print(f"not exported: {path}, which {', '.join(sorted(places))} names")
    for name in surface.undocumented:
        print(f"not documented: {name}")
    if "--update" in sys.argv[1:]:
        LISTING.write_text(text)
    known = LISTING.read_text() if LISTING.exists() else ""
    changes = list(difflib.unified_diff(known.splitlines(), text.splitlines(), "was", "is", lineterm="", n=0))
    if changes:
        print("\n".join(changes))
        print("The public surface changed. If it is meant: python tests/pipeline/surface.py --update, and a line in the changelog")
    if changes or surface.missing or surface.undocumented:
        sys.exit(1)
    print(f"{len(surface.exported)} public items, {len(text.splitlines())} lines")


if __name__ == "__main__":
    main()
