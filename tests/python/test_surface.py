"""The library's public surface as text.

Every type, function, field, variant and method that a program which depends on `gelsim` can name, from what rustdoc
knows, is in tests/library/surface.txt, so that a change of it is seen and meant. UPDATE=1 writes that file.
"""

import difflib
import json
import os
import shutil
import subprocess

import pytest

pytestmark = pytest.mark.build

# What this was written for. Another compiler's rustdoc may write another format.
FORMAT = 57
# Traits that tell a reader what a type can do.
TRAITS = "Clone Copy Debug Default PartialEq Error Display From Index Serialize Deserialize".split()


class Crate:
    """What rustdoc knows of a crate."""

    def __init__(self, path):
        known = json.loads(path.read_text())
        if known["format_version"] != FORMAT:
            pytest.skip(f"this compiler's rustdoc writes format {known['format_version']}, this test reads {FORMAT}")
        self.index, self.paths, self.root = known["index"], known["paths"], known["root"]
        self.by_path = {"::".join(path["path"]): id for id, path in self.paths.items() if path["crate_id"] == 0}

    def item(self, id):
        return self.index[str(id)]

    def path(self, id):
        """The path of an item of ours, of whatever crate; None of all others."""
        known = self.paths.get(str(id))
        return "::".join(known["path"]) if known and known["path"][0].startswith("gelsim") else None


class Surface:
    """Lines of the listing; types that are named and not exported, with who names them; names without documentation."""

    def __init__(self, crates):
        self.crates, self.lines, self.missing, self.undocumented = crates, [], {}, []
        # By the path where it is defined: the name in `gelsim`.
        self.exported = {}
        root = crates["gelsim"]
        for id in root.item(root.root)["inner"]["module"]["items"]:
            item = root.item(id)
            if "use" in item["inner"]:
                use = item["inner"]["use"]
                self.exported[root.path(use["id"])] = use["name"]
            elif item["visibility"] == "public":
                self.exported[root.path(id)] = item["name"]
        for path, name in sorted(self.exported.items(), key=lambda each: each[1]):
            crate = crates[path.split("::")[0]]
            self.add(crate, name, crate.item(crate.by_path[path]))

    def add(self, crate, name, item):
        ((kind, inner),) = item["inner"].items()
        self.crate, self.where = crate, name
        self.need_docs(item, name)
        attributes = "".join("#[non_exhaustive] " for each in item["attrs"] if each == "non_exhaustive")
        say = lambda text: self.lines.append("    " + text)
        if kind == "struct":
            self.lines.append(f"{attributes}struct {name}{self.able(inner)}")
            fields = inner["kind"].get("plain", {}).get("fields", []) if isinstance(inner["kind"], dict) else []
            for field in map(crate.item, fields):
                if field["visibility"] == "public":
                    self.need_docs(field, f"{name}.{field['name']}")
                    say(self.field(field))
        elif kind == "enum":
            self.lines.append(f"{attributes}enum {name}{self.able(inner)}")
            for variant in map(crate.item, inner["variants"]):
                self.need_docs(variant, f"{name}::{variant['name']}")
                held = variant["inner"]["variant"]["kind"]
                text = variant["name"]
                if isinstance(held, dict) and "tuple" in held:
                    types = [self.type(crate.item(id)["inner"]["struct_field"]) for id in held["tuple"]]
                    text += f"({', '.join(types)})"
                elif isinstance(held, dict):
                    text += " { " + ", ".join(self.field(crate.item(id)) for id in held["struct"]["fields"]) + " }"
                say(text)
        elif kind == "trait":
            self.lines.append(f"trait {name}")
            for method in map(crate.item, inner["items"]):
                self.need_docs(method, f"{name}::{method['name']}")
                say(self.function(method))
        elif kind == "function":
            self.lines.append(self.function({**item, "name": name}))
        elif kind == "constant":
            self.lines.append(f"const {name}: {self.type(inner['type'])}")
        else:
            pytest.fail(f"{name} is a {kind}, which this test does not list")
        for id in inner.get("impls", []):
            impl = crate.item(id)["inner"]["impl"]
            for member in map(crate.item, [] if impl["trait"] else impl["items"]):
                if member["visibility"] == "public":
                    self.need_docs(member, f"{name}::{member['name']}")
                    constant = member["inner"].get("assoc_const")
                    say(f"const {member['name']}: {self.type(constant['type'])}" if constant else self.function(member))

    def need_docs(self, item, name):
        if not item["docs"]:
            self.undocumented.append(name)

    def field(self, field):
        return f"{field['name']}: {self.type(field['inner']['struct_field'])}"

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
            known = {"Self": "self", "&Self": "&self", "&mut Self": "&mut self"} if name == "self" else {}
            inputs.append(known.get(text, f"{name}: {text}"))
        return f"fn {item['name']}({', '.join(inputs)}){self.output(signature)}"

    def output(self, signature):
        return f" -> {self.type(signature['output'])}" if signature["output"] else ""

    def type(self, kind):
        ((name, inner),) = kind.items()
        match name:
            case "resolved_path":
                return self.resolved(inner)
            case "generic" | "primitive":
                return inner
            case "borrowed_ref":
                return "&" + ("mut " if inner["is_mutable"] else "") + self.type(inner["type"])
            case "tuple":
                return f"({', '.join(map(self.type, inner))})"
            case "slice":
                return f"[{self.type(inner)}]"
            case "array":
                return f"[{self.type(inner['type'])}; {inner['len']}]"
            case "impl_trait":
                return "impl " + " + ".join(self.bound(bound) for bound in inner)
            case "dyn_trait":
                return "dyn " + " + ".join(self.resolved(each["trait"]) for each in inner["traits"])
            case "qualified_path":
                return f"{self.type(inner['self_type'])}::{inner['name']}"
            case "function_pointer":
                return "fn"
        pytest.fail(f"{self.where}: a {name}, which this test does not know")

    def bound(self, bound):
        return self.resolved(bound["trait_bound"]["trait"]) if "trait_bound" in bound else "'_"

    def resolved(self, named):
        path = self.crate.path(named["id"])
        if path is not None and path not in self.exported:
            self.missing.setdefault(path, set()).add(self.where)
        arguments = named.get("args") or {}
        held = arguments.get("angle_bracketed") or {}
        given = [self.type(each["type"]) for each in held.get("args", []) if "type" in each]
        for bound in held.get("constraints", []):
            value = bound["binding"]
            if "equality" in value and "type" in value["equality"]:
                given.append(f"{bound['name']} = {self.type(value['equality']['type'])}")
        if call := arguments.get("parenthesized"):
            return f"{named['path'].split('::')[-1]}({', '.join(map(self.type, call['inputs']))}){self.output(call)}"
        name = self.exported.get(path, named["path"].split("::")[-1])
        return name + (f"<{', '.join(given)}>" if given else "")


@pytest.fixture(scope="module")
def surface(project, tmp_path_factory):
    if not shutil.which("cargo"):
        pytest.skip("no cargo: https://rustup.rs")
    # Only rustdoc may know of RUSTC_BOOTSTRAP: build scripts that see it are run again, and then without it once more, with
    # all crates above them.
    rustdoc = tmp_path_factory.mktemp("rustdoc") / "rustdoc"
    rustdoc.write_text('#!/bin/sh\nRUSTC_BOOTSTRAP=1 exec rustdoc "$@"\n')
    rustdoc.chmod(0o755)
    flags = {"RUSTDOC": str(rustdoc), "RUSTDOCFLAGS": "-Zunstable-options --output-format=json"}
    # All crates, as the docs are made, so that what those compiled serves here, too.
    command = ["cargo", "doc", "--quiet", "--no-deps", "--release", "--locked", "--workspace"]
    subprocess.run(command, cwd=project, check=True, env={**os.environ, **flags})
    folder = project / os.environ.get("CARGO_TARGET_DIR", "target") / "doc"
    return Surface({name: Crate(folder / f"{name}.json") for name in ["gelsim", "gelsim_core", "gelsim_files"]})


def test_the_public_surface_is_the_listed_one(surface, project):
    listing = project / "tests/library/surface.txt"
    if os.environ.get("UPDATE"):
        listing.write_text("\n".join(surface.lines) + "\n")
    known = listing.read_text().splitlines() if listing.exists() else []
    changes = "\n".join(difflib.unified_diff(known, surface.lines, "was", "is", lineterm="", n=0))
    assert not changes, f"if it is meant: UPDATE=1, and a line in the changelog\n{changes}"


def test_every_type_that_a_signature_names_is_exported(surface):
    assert not surface.missing, "not exported, each with what names it"


def test_every_public_item_is_documented(surface):
    assert not surface.undocumented
