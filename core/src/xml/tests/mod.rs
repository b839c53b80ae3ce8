//! Tests of the whole room.

mod cuts;
mod documents;
mod hostile;
mod semantics;

use super::{Code, Read, ReadError, ReadOptions, read_bytes};

/// A camera that sees something.
const CAMERA: &str = "<camera><location><vector x='0' y='0' z='-9'/></location><sky><vector x='0' y='1' z='0'/></sky>\
    <look_at><vector x='0' y='0' z='0'/></look_at></camera>";
const LIGHT: &str = "<light><position><vector x='1' y='2' z='3'/></position></light>";

/// A lit scene with `objects` from line 3, column 1.
fn scene(objects: &str) -> String {
    format!("<scene>{CAMERA}\n<world>{LIGHT}\n{objects}\n</world></scene>")
}

fn read(text: &str) -> Result<Read, ReadError> {
    read_bytes(text.as_bytes().to_vec(), "scene.xml", None, &ReadOptions::default())
}

/// Code, line, column and marked text of every diagnostic.
fn told(text: &str) -> Vec<(Code, u64, u64, String)> {
    let diagnostics = match read(text) {
        Ok(read) => read.warnings,
        Err(error) => error.diagnostics,
    };
    diagnostics
        .into_iter()
        .map(|d| {
            let place = d.place.unwrap_or_else(|| panic!("{} has a place", d.message));
            let marked = place.source_line.chars().skip(place.marked.start).take(place.marked.len()).collect();
            (d.code, place.line, place.column, marked)
        })
        .collect()
}

/// Asserts that `text` gives exactly these diagnostics.
#[track_caller]
fn tells(text: &str, expected: &[(Code, u64, u64, &str)]) {
    let told = told(text);
    let told: Vec<_> = told.iter().map(|(c, l, k, m)| (*c, *l, *k, m.as_str())).collect();
    assert_eq!(told, expected, "\n{text}");
}
