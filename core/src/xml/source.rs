//! Byte offsets of a text into lines, columns and excerpts.

use std::ops::Range;

use super::diagnostic::{Diagnostic, Place};
use super::finding::Finding;
use crate::text::{self, disturbs};

/// Characters of a source line that a place shows at most.
const SHOWN: usize = 100;
/// Bytes behind a finding that its place may show.
pub(super) const AROUND: usize = 8 * SHOWN;

/// `text`, shortened to what a message can hold.
pub(super) fn shown(text: &str) -> String {
    let mut out: String = text.chars().take(40).map(printable).collect();
    if text.chars().nth(40).is_some() {
        out.push('…');
    }
    out
}

fn printable(c: char) -> char {
    if disturbs(c) { ' ' } else { c }
}

/// The first `len` bytes of `text`, or a few less.
pub(super) fn head(text: &str, len: usize) -> &str {
    let mut len = len.min(text.len());
    while !text.is_char_boundary(len) {
        len -= 1;
    }
    &text[..len]
}

fn floor(text: &str, at: usize) -> usize {
    head(text, at).len()
}

/// Finds the places of findings, sorted by offset, in one pass over the text.
#[derive(Debug)]
pub(super) struct Lines<'t> {
    text: &'t str,
    /// Beginning of the current line.
    start: usize,
    line: u64,
    scanned: usize,
    /// Characters of the current line before `counted`.
    columns: usize,
    counted: usize,
}

impl<'t> Lines<'t> {
    /// Lines of `text`, the first beginning at `start` (behind a byte order mark).
    pub(super) fn new(text: &'t str, start: usize) -> Self {
        Self { text, start, line: 1, scanned: start, columns: 0, counted: start }
    }

    fn advance(&mut self, at: usize) {
        let bytes = self.text.as_bytes();
        while let Some(i) = memchr::memchr2(b'\n', b'\r', &bytes[self.scanned..at]) {
            let end = self.scanned + i + 1;
            self.scanned = end;
            // CR LF ends at the LF.
            if bytes[end - 1] == b'\n' || bytes.get(end) != Some(&b'\n') {
                self.line += 1;
                self.start = end;
                (self.columns, self.counted) = (0, end);
            }
        }
        self.scanned = at;
        // On from the last place: a line may be as long as the document.
        if self.counted < at {
            self.columns += self.text[self.counted..at].chars().count();
            self.counted = at;
        }
    }

    /// The place of `at`; offsets must not fall between calls.
    pub(super) fn place(&mut self, at: &Range<usize>) -> Place {
        let text = self.text;
        let begin = floor(text, at.start.max(self.scanned));
        self.advance(begin);
        let seen = floor(text, begin.saturating_add(AROUND));
        let line_end = memchr::memchr2(b'\n', b'\r', &text.as_bytes()[begin..seen]).map_or(seen, |i| begin + i);
        let column = self.columns;
        let end = floor(text, at.end.clamp(begin, line_end));
        let width = text[begin..end].chars().take(SHOWN / 2).count().max(1);
        // A window of the line around the spot.
        let before = (SHOWN - width).min(column);
        let keep = if column + width <= SHOWN { column } else { before.min(SHOWN * 2 / 5) };
        let left: Vec<char> = text[self.start..begin].chars().rev().take(keep).collect();
        let mut source_line = String::from(if keep < column { "…" } else { "" });
        source_line.extend(left.into_iter().rev().map(printable));
        let mark = source_line.chars().count();
        let rest = &text[begin..line_end];
        let room = SHOWN - mark.min(SHOWN / 2);
        source_line.extend(rest.chars().take(room).map(printable));
        if rest.chars().nth(room).is_some() {
            source_line.push('…');
        }
        Place { line: self.line, column: column as u64 + 1, source_line, marked: mark..mark + width }
    }

    /// The diagnostic for a finding.
    pub(super) fn diagnostic(&mut self, file: &str, finding: Finding) -> Diagnostic {
        let Finding { at, code, message, expected, suggestion } = finding;
        Diagnostic {
            severity: code.severity(),
            code,
            file: text::printable(file, false),
            place: Some(self.place(&at)),
            // Some of it is the document's own text.
            message: text::printable(&message, false),
            expected: expected.map(|e| text::printable(&e, false)),
            suggestion: suggestion.map(|s| text::printable(&s, false)),
        }
    }
}
