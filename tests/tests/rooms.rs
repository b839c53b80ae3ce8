//! The rooms of the code know each other one way.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on may stop")]

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().into()
}

/// Source files below `folder`, those of tests and of the scheduler's simulation apart.
fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_stem().unwrap().to_str().unwrap().to_owned();
        if name == "tests" || (name == "simulation" && folder.ends_with("scheduler")) {
            continue;
        }
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|e| e == "rs") {
            found.push(path);
        }
    }
}

/// The first name of every path in `code` that begins with `prefix`, those in braces included.
fn named_after<'a>(code: &'a str, prefix: &str) -> Vec<&'a str> {
    let word = |text: &'a str| text.trim().split(|c: char| !c.is_ascii_alphanumeric() && c != '_').next().unwrap();
    let rests = code.split(prefix).skip(1);
    rests
        .flat_map(|rest| match rest.strip_prefix('{') {
            Some(group) => group.split('}').next().unwrap().split(',').map(word).collect(),
            None => vec![word(rest)],
        })
        .collect()
}

/// Which rooms (folders and files in `src`) name which others. `inside` begins a path from within a room,
/// `beside` one in a room's own file, where that differs.
fn uses(src: &Path, (inside, beside): (&str, &str)) -> BTreeMap<String, BTreeSet<String>> {
    let mut files = Vec::new();
    sources(src, &mut files);
    let room_of = |file: &Path| {
        let first = file.strip_prefix(src).unwrap().components().next().unwrap();
        first.as_os_str().to_str().unwrap().trim_end_matches(".rs").to_owned()
    };
    let mut uses: BTreeMap<String, BTreeSet<String>> = files
        .iter()
        .map(|f| room_of(f))
        .filter(|r| !["lib", "main", "mod"].contains(&r.as_str()))
        .map(|r| (r, BTreeSet::new()))
        .collect();
    let rooms: BTreeSet<String> = uses.keys().cloned().collect();
    for file in &files {
        let room = room_of(file);
        let text = fs::read_to_string(file).unwrap();
        let code = text.split("#[cfg(test)]\nmod tests").next().unwrap();
        let code: String = code.lines().flat_map(|line| [line.split("//").next().unwrap(), "\n"]).collect();
        let own = file.parent() == Some(src) || file.file_name().is_some_and(|name| name == "mod.rs");
        let named = named_after(&code, if own { beside } else { inside });
        let others = named.into_iter().map(str::to_owned).filter(|other| *other != room && rooms.contains(other));
        if let Some(of_room) = uses.get_mut(&room) {
            of_room.extend(others);
        }
    }
    uses
}

/// As [`uses`], of a crate; the commands of a program apart, which name the library by its crate's name.
fn uses_of_crate(name: &str) -> BTreeMap<String, BTreeSet<String>> {
    let mut uses = uses(&root().join(name).join("src"), ("crate::", "crate::"));
    uses.remove("cli");
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

fn assert_no_circle(uses: &BTreeMap<String, BTreeSet<String>>) {
    for room in uses.keys() {
        let mut way = vec![room.as_str()];
        assert!(!circle(uses, &mut way), "{}", way.join(" -> "));
    }
}

/// Holds the table of the page to what the rooms of a crate use.
fn assert_on_the_map(name: &str) {
    let page = fs::read_to_string(root().join("docs/architecture.md")).unwrap();
    let uses = uses_of_crate(name);
    let mut seen = 0;
    for line in page.lines().filter(|line| line.starts_with(&format!("| `{name}/src/"))) {
        let columns: Vec<&str> = line.split('|').map(str::trim).collect();
        let room = columns[1].trim_matches('`').trim_start_matches(&format!("{name}/src/")).trim_end_matches(".rs");
        let Some(known) = uses.get(room) else { continue };
        let told: BTreeSet<String> = columns[3].split('`').skip(1).step_by(2).map(Into::into).collect();
        assert_eq!(told, *known, "{room}");
        seen += 1;
    }
    let without: Vec<_> = uses.keys().filter(|room| !page.contains(&format!("`{name}/src/{room}"))).collect();
    assert!(without.is_empty() && seen == uses.len(), "{without:?} are not on the map");
}

#[test]
fn no_room_of_core_needs_one_that_needs_it() {
    let uses = uses_of_crate("core");
    assert!(uses.len() > 9 && uses["traverse"].contains("bvh"), "{uses:?}");
    assert_no_circle(&uses);
}

#[test]
fn no_room_of_the_coordinator_needs_one_that_needs_it() {
    let uses = uses_of_crate("coordinator");
    assert!(uses.len() > 15 && uses["farm"].contains("scheduler") && !uses["farm"].contains("queue"), "{uses:?}");
    assert_no_circle(&uses);
    // Who measures is called by the command alone.
    assert!(uses.values().all(|used| !used.contains("measure")), "{uses:?}");
}

#[test]
fn the_coordinator_names_no_room_by_way_of_its_root() {
    let mut files = Vec::new();
    sources(&root().join("coordinator/src"), &mut files);
    for file in files {
        let text = fs::read_to_string(&file).unwrap();
        let code: Vec<&str> = text.lines().map(|line| line.split("//").next().unwrap()).collect();
        let hidden = code.iter().find(|line| {
            line.split("crate::").skip(1).any(|rest| rest.starts_with(|c: char| c == '{' || c.is_ascii_uppercase()))
        });
        assert!(hidden.is_none(), "{}: {}", file.display(), hidden.unwrap());
    }
}

#[test]
fn no_command_of_the_coordinator_needs_one_that_needs_it() {
    let uses = uses(&root().join("coordinator/src/cli"), ("crate::cli::", "super::"));
    assert!(uses.len() > 25 && uses["render"].contains("remote") && uses["args"].contains("access"), "{uses:?}");
    assert_no_circle(&uses);
}

#[test]
fn the_map_of_the_code_says_what_the_rooms_of_core_use() {
    assert_on_the_map("core");
}

#[test]
fn the_map_of_the_code_says_what_the_rooms_of_the_coordinator_use() {
    assert_on_the_map("coordinator");
}
