//! The rooms of the code know each other one way.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on may stop")]

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().into()
}

/// Source files below `folder`, those of tests apart.
fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_stem().unwrap().to_str().unwrap().to_owned();
        if name == "tests" || name == "simulation" {
            continue;
        }
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|e| e == "rs") {
            found.push(path);
        }
    }
}

/// Rooms of a crate (folders and files beside its `lib.rs`), and which others each names.
fn uses(name: &str) -> BTreeMap<String, BTreeSet<String>> {
    let src = root().join(name).join("src");
    let mut files = Vec::new();
    sources(&src, &mut files);
    let room_of = |file: &Path| {
        let first = file.strip_prefix(&src).unwrap().components().next().unwrap();
        first.as_os_str().to_str().unwrap().trim_end_matches(".rs").to_owned()
    };
    let mut uses: BTreeMap<String, BTreeSet<String>> = files
        .iter()
        .map(|f| room_of(f))
        .filter(|r| !["lib", "main"].contains(&r.as_str()))
        .map(|r| (r, BTreeSet::new()))
        .collect();
    let rooms: BTreeSet<String> = uses.keys().cloned().collect();
    for file in &files {
        let room = room_of(file);
        let text = fs::read_to_string(file).unwrap();
        let code = text.split("#[cfg(test)]\nmod tests").next().unwrap();
        let lines = code.lines().map(|line| line.split("//").next().unwrap());
        let named = lines.flat_map(|line| line.split("crate::").skip(1)).map(|rest| {
            rest.split(|c: char| !c.is_ascii_alphanumeric() && c != '_').next().unwrap_or_default().to_owned()
        });
        let others = named.filter(|other| *other != room && rooms.contains(other));
        if let Some(of_room) = uses.get_mut(&room) {
            of_room.extend(others);
        }
    }
    uses
}

/// A way from a room back to it, if there is one.
fn circle<'a>(uses: &'a BTreeMap<String, BTreeSet<String>>, way: &mut Vec<&'a str>) -> bool {
    let last = *way.last().unwrap();
    for next in &uses[last] {
        let known = way.contains(&next.as_str());
        way.push(next);
        if known || circle(uses, way) {
            return true;
        }
        way.pop();
    }
    false
}

#[test]
fn no_room_of_core_needs_one_that_needs_it() {
    let uses = uses("core");
    assert!(uses.len() > 9 && uses["trace"].contains("bvh"), "{uses:?}");
    for room in uses.keys() {
        let mut way = vec![room.as_str()];
        assert!(!circle(&uses, &mut way), "{}", way.join(" -> "));
    }
}

#[test]
fn the_map_of_the_code_says_what_the_rooms_of_core_use() {
    let page = fs::read_to_string(root().join("docs/architecture.md")).unwrap();
    let uses = uses("core");
    let mut seen = 0;
    for line in page.lines().filter(|line| line.starts_with("| `core/src/")) {
        let columns: Vec<&str> = line.split('|').map(str::trim).collect();
        let room = columns[1].trim_matches('`').trim_start_matches("core/src/").trim_end_matches(".rs");
        let Some(known) = uses.get(room) else { continue };
        let told: BTreeSet<String> = columns[3].split('`').skip(1).step_by(2).map(Into::into).collect();
        assert_eq!(told, *known, "{room}");
        seen += 1;
    }
    let without: Vec<_> = uses.keys().filter(|room| !page.contains(&format!("`core/src/{room}"))).collect();
    assert!(without.is_empty() && seen == uses.len(), "{without:?} are not on the map");
}
