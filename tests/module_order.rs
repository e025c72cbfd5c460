//! The data's way through the crate: a module imports only from its left.

use std::path::{Path, PathBuf};

/// Modules by rank. Those of one rank do not import one another.
const ORDER: &[&[&str]] = &[
    &["model"],
    &["device"],
    &["geometry", "solve"],
    &["pose"],
    &["certificate", "measure"],
    &["transfer"],
    &["pattern"],
    &["proxy"],
    &["drape"],
    &["rig"],
    &["pipeline"],
];

fn rank(module: &str) -> Option<usize> {
    ORDER.iter().position(|peers| peers.contains(&module))
}

/// The crate's modules that a source text names, by line. `depth` is the number of modules
/// from the crate's root down to the text's own.
fn imports(text: &str, depth: usize) -> Vec<(usize, String)> {
    let mut found = Vec::new();
    let code: Vec<&str> = text.lines().map(|line| line.split("//").next().unwrap_or("")).collect();
    for (number, line) in code.iter().enumerate() {
        for (at, _) in line.match_indices("crate::") {
            let fresh = !line[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_');
            if fresh {
                found.extend(names(&code, number, at + "crate::".len()).map(|name| (number + 1, name)));
            }
        }
        let mut rest = 0;
        while let Some(at) = line[rest..].find("super::") {
            let start = rest + at;
            let mut end = start;
            while line[end..].starts_with("super::") {
                end += "super::".len();
            }
            if (end - start) / "super::".len() >= depth {
                found.extend(names(&code, number, end).map(|name| (number + 1, name)));
            }
            rest = end;
        }
    }
    found
}

/// The names that follow a path's root: one, or those at the top of a `{...}` group.
fn names(code: &[&str], line: usize, column: usize) -> impl Iterator<Item = String> + use<> {
    let text = std::iter::once(&code[line][column..]).chain(code[line + 1..].iter().copied());
    let text = text.collect::<Vec<_>>().join(" ");
    let mut found = Vec::new();
    let word = |s: &str| s.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect::<String>();
    if let Some(group) = text.strip_prefix('{') {
        let (mut depth, mut start) = (0, true);
        for (i, c) in group.char_indices() {
            match c {
                '{' => depth += 1,
                '}' if depth == 0 => break,
                '}' => depth -= 1,
                ',' if depth == 0 => start = true,
                c if start && !c.is_whitespace() => {
                    found.push(word(&group[i..]));
                    start = false;
                }
                _ => {}
            }
        }
    } else {
        found.push(word(&text));
    }
    found.into_iter()
}

/// What breaks the order in a text of `module`.
fn violations(module: &str, depth: usize, text: &str) -> Vec<(usize, String)> {
    let own = rank(module).unwrap_or_else(|| panic!("module '{module}' has no place in the order"));
    let mut found = imports(text, depth);
    found.retain(|(_, name)| name != module && rank(name).is_some_and(|other| other >= own));
    found
}

fn sources(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).expect("readable") {
        let path = entry.expect("readable").path();
        if path.is_dir() {
            found.extend(sources(&path));
        } else if path.extension().is_some_and(|e| e == "rs") {
            found.push(path);
        }
    }
    found
}

#[test]
fn modules_import_only_from_their_left() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut checked = 0;
    let mut broken = Vec::new();
    for path in sources(&root) {
        let inner = path.strip_prefix(&root).expect("under src").with_extension("");
        let mut parts: Vec<&str> = inner.iter().map(|p| p.to_str().expect("UTF-8")).collect();
        parts.retain(|&p| p != "mod");
        if parts == ["lib"] {
            continue;
        }
        checked += 1;
        let text = std::fs::read_to_string(&path).expect("readable");
        for (line, name) in violations(parts[0], parts.len(), &text) {
            broken.push(format!("src/{}.rs:{line} imports {name}", inner.display()));
        }
    }
    assert!(checked > 20, "{checked} files under {}", root.display());
    assert!(broken.is_empty(), "against the order of modules:\n{}", broken.join("\n"));
}

#[test]
fn the_check_sees_what_it_should() {
    let of =
        |module, depth, text| violations(module, depth, text).into_iter().map(|v| v.1).collect::<Vec<_>>();
    assert_eq!(of("solve", 2, "use crate::geometry::Surface;"), ["geometry"]);
    assert_eq!(of("geometry", 1, "use crate::{\n  device::{Kernel, Buffer},\n  drape,\n};"), ["drape"]);
    assert_eq!(of("device", 2, "let a = super::super::solve::cg::Cg;"), ["solve"]);
    assert_eq!(of("solve", 2, "use crate::device::Device; use super::cg; // crate::rig"), [""; 0]);
    assert_eq!(of("device", 3, "use super::super::solve;"), [""; 0], "device's own");
}
