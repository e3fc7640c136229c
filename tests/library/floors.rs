//! The house: floors only look down, and no files import each other in a circle.
//!
//! Imports are read from the text of `src`: `use` trees and paths that begin with `crate`, `super` or `self`, comments and
//! test modules left out. A file that declares a module does not import it by that.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

/// From the lowest to the highest; a file imports from its own floor and from those before it.
const FLOORS: [&str; 6] = ["core", "files", "job", "dataset", "lab", "cli"];

/// Rooms of the simulator, from the first stage to the last. A stage may use what the stages before it give.
const STAGES: [&str; 6] = ["base", "mesh", "depth", "gelpad", "optics", "camera"];

type Module = Vec<String>;

/// Every file of `src` as a module, with the modules whose files it imports.
fn imports() -> BTreeMap<Module, BTreeSet<Module>> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut texts = BTreeMap::new();
    read(&root, &mut Vec::new(), &mut texts);
    let modules: BTreeSet<Module> = texts.keys().cloned().collect();
    let imported = |(module, text): (&Module, &String)| {
        let found = paths(text).into_iter().filter_map(|path| file_of(&path, module, &modules));
        // What a folder's own file says of the files in it is the folder's table of contents.
        let own = |other: &Module| other != module && !other.starts_with(module);
        (module.clone(), found.filter(own).collect())
    };
    texts.iter().map(imported).collect()
}

/// Files on no floor: the roots of library and program, what only the program's root imports, and tests.
const OUTSIDE: [&str; 4] = ["lib", "main", "memory", "tests"];

fn read(folder: &Path, module: &mut Module, texts: &mut BTreeMap<Module, String>) {
    for entry in fs::read_dir(folder).expect("src is there") {
        let path = entry.expect("it can be listed").path();
        let name = path.file_stem().and_then(|stem| stem.to_str()).expect("UTF-8").to_owned();
        module.push(name.clone());
        if path.is_dir() {
            read(&path, module, texts);
        } else if path.extension().is_some_and(|end| end == "rs") && !OUTSIDE.contains(&name.as_str()) {
            let key = if name == "mod" { module[..module.len() - 1].to_vec() } else { module.clone() };
            texts.insert(key, code(&fs::read_to_string(&path).expect("UTF-8")));
        }
        module.pop();
    }
}

/// The text without comments, strings and test modules.
fn code(text: &str) -> String {
    let lines = text.lines().map(|line| line.split("//").next().unwrap_or_default());
    let mut code: String = lines.flat_map(|line| [line, "\n"]).collect();
    while let Some(start) = code.find("#[cfg(test)]") {
        let rest = &code[start..];
        let open = rest.find(['{', ';']).unwrap_or(rest.len() - 1);
        let mut depth = 0;
        let end = rest[open..].char_indices().find_map(|(at, c)| {
            depth += i32::from(c == '{') - i32::from(c == '}');
            (depth == 0).then_some(open + at + 1)
        });
        code.replace_range(start..start + end.unwrap_or(rest.len()), "");
    }
    code
}

/// Paths that begin with `crate`, `super` or `self`, the trees of `use` taken apart.
fn paths(code: &str) -> Vec<Module> {
    let mut found = Vec::new();
    let mut rest = code;
    while let Some(at) = rest.find(['c', 's']) {
        let before = rest[..at].chars().next_back();
        let here = &rest[at..];
        let starts = ["crate::", "super::", "self::"].iter().any(|start| here.starts_with(start));
        if starts && !before.is_some_and(|c| c.is_alphanumeric() || c == '_' || c == ':') {
            let length = tree(here, &Vec::new(), &mut found);
            rest = &here[length.max(1)..];
        } else {
            rest = &here[1..];
        }
    }
    found
}

/// Reads one tree such as `a::{b, c::d}`; how many bytes it takes.
fn tree(text: &str, above: &Module, found: &mut Vec<Module>) -> usize {
    let mut path = above.clone();
    let mut at = 0;
    loop {
        let name: String = text[at..].chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
        at += name.len();
        if !name.is_empty() {
            path.push(name);
        }
        if !text[at..].starts_with("::") {
            found.push(path);
            return at;
        }
        at += 2;
        if text[at..].starts_with('{') {
            at += 1;
            while let Some(c) = text[at..].chars().next() {
                match c {
                    '}' => return at + 1,
                    _ if c.is_alphanumeric() || c == '_' => {
                        at += tree(&text[at..], &path, found);
                        // Another name that it gets here says nothing.
                        at += text[at..].find([',', '}']).unwrap_or(text.len() - at);
                    }
                    _ => at += c.len_utf8(),
                }
            }
            return at;
        }
    }
}

/// The file that a path leads to: the longest part of it that is one.
fn file_of(path: &Module, from: &Module, modules: &BTreeSet<Module>) -> Option<Module> {
    let mut absolute = if path[0] == "crate" { Vec::new() } else { from.clone() };
    for name in path {
        match name.as_str() {
            "crate" | "self" => {}
            "super" => drop(absolute.pop()),
            name => absolute.push(name.to_owned()),
        }
    }
    (1..=absolute.len()).rev().map(|length| absolute[..length].to_vec()).find(|module| modules.contains(module))
}

/// Sets of files each of which imports all the others, directly or not; of two or more.
fn circles(imports: &BTreeMap<Module, BTreeSet<Module>>) -> Vec<BTreeSet<Module>> {
    let reached = |start: &Module| {
        let (mut seen, mut open) = (BTreeSet::new(), vec![start]);
        while let Some(module) = open.pop() {
            open.extend(imports[module].iter().filter(|next| seen.insert((*next).clone())));
        }
        seen
    };
    let reached: BTreeMap<&Module, BTreeSet<Module>> = imports.keys().map(|module| (module, reached(module))).collect();
    let circle = |module: &Module| {
        let both = reached[module].iter().filter(|other| reached[*other].contains(module));
        both.cloned().collect::<BTreeSet<_>>()
    };
    let found: BTreeSet<BTreeSet<Module>> = imports.keys().map(circle).filter(|circle| circle.len() > 1).collect();
    found.into_iter().collect()
}

fn name(module: &Module) -> String {
    module.join("::")
}

#[test]
fn no_file_imports_from_a_higher_floor() {
    let floor = |module: &Module| FLOORS.iter().position(|floor| module[0] == *floor);
    let mut wrong = Vec::new();
    for (module, imported) in imports() {
        let own = floor(&module).unwrap_or_else(|| panic!("{} is on no floor", name(&module)));
        let higher = imported.iter().filter(|other| floor(other) > Some(own));
        wrong.extend(higher.map(|other| format!("{} imports {}", name(&module), name(other))));
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn no_stage_of_the_simulator_imports_a_later_one() {
    let stage = |module: &Module| match module.as_slice() {
        [floor, room, ..] if floor == "core" => STAGES.iter().position(|stage| room == stage),
        _ => None,
    };
    let mut wrong = Vec::new();
    for (module, imported) in imports() {
        let Some(own) = stage(&module) else { continue };
        let later = imported.iter().filter(|other| stage(other).is_some_and(|other| other > own));
        wrong.extend(later.map(|other| format!("{} imports {}", name(&module), name(other))));
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn no_files_import_each_other_in_a_circle() {
    let found: Vec<String> =
        circles(&imports()).iter().map(|circle| circle.iter().map(name).collect::<Vec<_>>().join(", ")).collect();
    assert!(found.is_empty(), "files that import each other: {}", found.join("; "));
}

#[test]
fn imports_are_found_however_they_are_written() {
    let text = "use crate::a::{self, b::{C, d}, e as f};\n// crate::no\nfn x() { super::g::h(); }\n\
                #[cfg(test)]\nmod tests { use crate::hidden::X; }\n";
    let mut found: Vec<String> = paths(&code(text)).iter().map(name).collect();
    found.sort();
    assert_eq!(found, ["crate::a::b::C", "crate::a::b::d", "crate::a::e", "crate::a::self", "super::g::h"]);
}
