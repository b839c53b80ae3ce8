//! The world's children, piece by piece.
//!
//! A piece is a stretch of the world's text that begins and ends between children.
//! Ordinary objects take the fast lane; what lies between them is gathered into runs
//! and given to the XML parser, each run wrapped into a `<world>` of its own in a
//! scratch buffer, so that no tree is ever larger than a run.
//!
//! Before a child is put into a run its extent is found by matching its tags. Where
//! that fails, the mismatch is reported here, the child is left out, and reading goes
//! on at the next place where a child of a world begins.

use std::ops::Range;

use super::Tuning;
use super::check::{Checker, Shift};
use super::diagnostic::Code;
use super::fast::Fast;
use super::finding::{Finding, Limits};
use super::grammar::OBJECTS;
use super::lex::{self, Kind, Token};
use super::part::Part;
use super::source::shown;
use super::syntax;

/// Elements inside one another before a document is refused; the format needs seven.
pub(super) const MAX_DEPTH: usize = 64;
/// Bytes of one child of the world, and of all that stands around the world.
pub(super) const MAX_UNIT: usize = 16 << 20;

/// How a piece ended.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum End {
    /// Between children, at or behind the place where it was to stop.
    At(usize),
    /// At the world's end tag.
    World(Range<usize>),
    /// At the end of the text, or where enough errors were found.
    Text,
    /// It was a guess that the piece begins between children, and it may have been wrong.
    Abandoned,
}

/// How far a child of the world reaches.
enum Extent {
    Whole(usize),
    /// Left out; reading goes on there.
    Dropped(usize),
}

/// Reads one piece.
pub(super) struct Reader<'t> {
    text: &'t str,
    tuning: Tuning,
    /// Whether the piece's beginning is a guess.
    guess: bool,
    /// Whether tags were found not to match: then a child's start tag inside a child is
    /// taken for a missing end tag before it.
    broken: bool,
    fast: Fast<'t>,
    part: Part,
    /// Children of the current run, as far as they are known to be whole.
    run: Vec<Range<usize>>,
    scratch: String,
}

impl<'t> Reader<'t> {
    /// `limits` are those of the whole document: a piece need not find more.
    pub(super) fn new(text: &'t str, tuning: Tuning, limits: Limits, guess: bool, broken: bool) -> Self {
        Self {
            text,
            tuning,
            guess,
            broken,
            fast: Fast::new(text.as_bytes()),
            part: Part::new(limits),
            run: Vec::new(),
            scratch: String::new(),
        }
    }

    /// Reads from `start`, which lies between children, up to the first such place at or
    /// behind `stop`. Gives what was found, how it ended, and whether tags did not match.
    pub(super) fn read(mut self, start: usize, stop: usize) -> (Part, End, bool) {
        let end = self.children(start, stop);
        if end != End::Abandoned {
            self.flush();
        }
        (self.part, end, self.broken)
    }

    fn children(&mut self, start: usize, stop: usize) -> End {
        let mut at = start;
        while at < stop {
            if self.tuning.fast {
                // Behind white space alone the next piece begins: it is not to be read for nothing.
                if self.text.as_bytes()[at..stop].iter().all(|b| lex::is_space(*b)) {
                    return End::At(stop);
                }
                if let Some((object, end)) = self.fast.object(at) {
                    self.flush();
                    at = end;
                    self.fast.take(object, &mut self.part);
                    continue;
                }
            }
            if self.part.findings.full() {
                return End::Text;
            }
            let token = match lex::next(self.text, at) {
                None => {
                    self.gather(at..self.text.len());
                    return End::Text;
                }
                Some(Err(broken)) => {
                    if self.guess {
                        return End::Abandoned;
                    }
                    self.broken = true;
                    self.part.findings.push(broken.finding);
                    at = self.resync(broken.resume);
                    continue;
                }
                Some(Ok(token)) => token,
            };
            let child = at;
            at = match token.kind {
                // The lexer knows all of a comment but its characters.
                Kind::Comment | Kind::Instruction if token.at.len() > MAX_UNIT / 16 => {
                    self.gather(child..token.at.start);
                    if let Some(finding) = syntax::bad_character(self.text, token.at.clone()) {
                        self.part.findings.push(finding);
                    }
                    at = token.at.end;
                    continue;
                }
                Kind::Comment | Kind::Instruction => token.at.end,
                Kind::Cdata | Kind::Doctype => {
                    self.gather(child..token.at.start);
                    let is_cdata = token.kind == Kind::Cdata;
                    self.part.findings.push(if is_cdata { cdata(&token, "world") } else { late_doctype(&token) });
                    at = token.at.end;
                    continue;
                }
                Kind::End if &self.text[token.name.clone()] == "world" => {
                    self.gather(child..token.at.start);
                    return End::World(token.at);
                }
                Kind::End => {
                    if self.guess {
                        return End::Abandoned;
                    }
                    self.gather(child..token.at.start);
                    self.broken = true;
                    self.part.findings.push(stray_end(self.text, &token));
                    at = token.at.end;
                    continue;
                }
                Kind::Start { .. } => match self.extent(token) {
                    Some(Extent::Whole(end)) => end,
                    Some(Extent::Dropped(resume)) => {
                        at = resume;
                        continue;
                    }
                    None => return End::Abandoned,
                },
            };
            self.gather(child..at);
        }
        End::At(at)
    }

    /// Where the child with the start tag `first` ends. `None`: the piece is abandoned.
    fn extent(&mut self, first: Token) -> Option<Extent> {
        let text = self.text;
        let start = first.at.start;
        let mut good = true;
        let mut open: Vec<Range<usize>> = Vec::new();
        let mut token = first.clone();
        loop {
            good &= token.findings.is_empty();
            for finding in token.findings.drain(..) {
                self.part.findings.push(finding);
            }
            match token.kind {
                Kind::Start { empty } => {
                    if !open.is_empty() && is_object(&text[token.name.clone()]) && (self.guess || self.broken) {
                        return self.unclosed(&first, &open, token.at.start);
                    }
                    if open.len() >= MAX_DEPTH {
                        return self.fault(too_deep(token.name), token.at.end);
                    }
                    if !empty {
                        open.push(token.name);
                    }
                }
                Kind::End => {
                    let name = &text[token.name.clone()];
                    match open.iter().rposition(|o| &text[o.clone()] == name) {
                        Some(depth) => {
                            if depth + 1 < open.len() {
                                if self.guess {
                                    return None;
                                }
                                good = false;
                                self.part.findings.push(mismatch(text, &open[open.len() - 1], &token));
                            }
                            open.truncate(depth);
                        }
                        None if ["world", "scene"].contains(&name) => {
                            return self.unclosed(&first, &open, first.at.end);
                        }
                        None => {
                            if self.guess {
                                return None;
                            }
                            good = false;
                            self.part.findings.push(stray_end(text, &token));
                        }
                    }
                }
                Kind::Cdata => {
                    good = false;
                    let parent = open.last().map_or("world", |o| &text[o.clone()]);
                    self.part.findings.push(cdata(&token, parent));
                }
                Kind::Doctype => {
                    good = false;
                    self.part.findings.push(late_doctype(&token));
                }
                Kind::Comment | Kind::Instruction => {}
            }
            let end = token.at.end;
            if end - start > MAX_UNIT {
                if open.is_empty() || self.broken {
                    return self.fault(too_large(first.name), first.at.end);
                }
                return self.unclosed(&first, &open, first.at.end);
            }
            if open.is_empty() {
                return Some(if good { Extent::Whole(end) } else { Extent::Dropped(end) });
            }
            if self.part.findings.full() {
                return Some(Extent::Dropped(end));
            }
            token = match lex::next(text, end) {
                Some(Ok(token)) => token,
                Some(Err(broken)) => return self.fault(broken.finding, broken.resume),
                None => return self.unclosed(&first, &open, first.at.end),
            };
        }
    }

    /// Reports `finding`, drops the child, goes on behind `from`.
    fn fault(&mut self, finding: Finding, from: usize) -> Option<Extent> {
        if self.guess {
            return None;
        }
        self.broken = true;
        self.part.findings.push(finding);
        Some(Extent::Dropped(self.resync(from)))
    }

    fn unclosed(&mut self, first: &Token, open: &[Range<usize>], from: usize) -> Option<Extent> {
        let name = open.first().unwrap_or(&first.name);
        self.fault(unclosed(self.text, name.clone()), from)
    }

    /// Where a child of the world may begin, or the world end, at or behind `from`.
    fn resync(&self, from: usize) -> usize {
        let bytes = self.text.as_bytes();
        memchr::memchr_iter(b'<', &bytes[from.min(bytes.len())..])
            .map(|i| from + i)
            .find(|&i| begins_object(bytes, i) || bytes[i..].starts_with(b"</world"))
            .unwrap_or(bytes.len())
    }

    /// Puts a whole child into the run.
    fn gather(&mut self, child: Range<usize>) {
        if child.is_empty() {
            return;
        }
        let contiguous = self.run.last().is_none_or(|last| last.end == child.start);
        let start = self.run.first().map_or(child.start, |first| first.start);
        if !contiguous || child.end - start > self.tuning.run {
            self.flush();
        }
        self.run.push(child);
    }

    /// Parses and checks the run.
    fn flush(&mut self) {
        let (Some(first), Some(last)) = (self.run.first(), self.run.last()) else { return };
        let whole = first.start..last.end;
        if self.text.as_bytes()[whole.clone()].iter().all(|b| lex::is_space(*b)) {
            self.part.blank = true;
            self.run.clear();
            return;
        }
        if whole.len() > 2 * MAX_UNIT {
            // Only text can be as long as that.
            let start = super::source::head(self.text, whole.start + 1).len();
            self.part.findings.push(too_large(start..start));
            self.run.clear();
            return;
        }
        let children = std::mem::take(&mut self.run);
        if self.parse(whole, children.len() == 1) {
            self.run = children;
            self.run.clear();
            return;
        }
        if children.len() > 1 {
            // The parser stops at its first error: one child at a time, it cannot hide another.
            for child in &children {
                self.parse(child.clone(), true);
            }
        }
        self.run = children;
        self.run.clear();
    }

    /// Parses a stretch of whole children. If that fails, reports it if asked to.
    fn parse(&mut self, range: Range<usize>, report: bool) -> bool {
        const OPEN: &str = "<world>";
        let mut scratch = std::mem::take(&mut self.scratch);
        scratch.clear();
        scratch.push_str(OPEN);
        scratch.push_str(&self.text[range.clone()]);
        scratch.push_str("</world>");
        // Neither offset exceeds isize::MAX: both index into memory.
        let by = range.start as isize - OPEN.len() as isize;
        let shift = Shift { cut: 0, before: by, behind: by };
        let parsed = match roxmltree::Document::parse(&scratch) {
            Ok(tree) => {
                Checker { source: &scratch, shift, part: &mut self.part }.world(tree.root_element());
                true
            }
            Err(error) => {
                if report {
                    self.part.findings.push(syntax::finding(&error, &scratch, shift));
                }
                false
            }
        };
        self.scratch = scratch;
        parsed
    }
}

/// Whether `<`, the name of a child of a world, and an end of that name stand at `at`.
pub(super) fn begins_object(bytes: &[u8], at: usize) -> bool {
    let Some(rest) = bytes.get(at + 1..) else { return false };
    OBJECTS.iter().any(|name| {
        rest.strip_prefix(name.as_bytes())
            .is_some_and(|r| r.first().is_some_and(|b| lex::is_space(*b) || matches!(b, b'>' | b'/')))
    })
}

fn is_object(name: &str) -> bool {
    OBJECTS.contains(&name)
}

pub(super) fn too_deep(at: Range<usize>) -> Finding {
    Finding::new(Code::TooDeep, at, format!("elements are nested more than {MAX_DEPTH} deep"))
        .expected("seven levels at most")
}

pub(super) fn too_large(at: Range<usize>) -> Finding {
    Finding::new(Code::TooLarge, at, format!("this is larger than {} MiB", MAX_UNIT >> 20))
        .expected("objects of less than a kilobyte each, in a `world` of any length")
}

pub(super) fn unclosed(text: &str, name: Range<usize>) -> Finding {
    let shown = shown(&text[name.clone()]);
    Finding::new(Code::Syntax, name, format!("`{shown}` is never closed")).expected(format!("its end tag `</{shown}>`"))
}

pub(super) fn mismatch(text: &str, open: &Range<usize>, token: &Token) -> Finding {
    let (open, close) = (shown(&text[open.clone()]), shown(&text[token.name.clone()]));
    Finding::new(
        Code::Syntax,
        token.at.clone(),
        format!("`</{close}>` closes `{close}` while `{open}` in it is still open"),
    )
    .expected(format!("</{open}>"))
}

pub(super) fn stray_end(text: &str, token: &Token) -> Finding {
    let name = shown(&text[token.name.clone()]);
    Finding::new(Code::Syntax, token.at.clone(), format!("`</{name}>` closes nothing"))
        .expected(format!("an open `{name}` before it"))
}

pub(super) fn cdata(token: &Token, parent: &str) -> Finding {
    Finding::new(
        Code::UnexpectedContent,
        token.at.start..token.at.start + 9,
        format!("`{}` may not hold a CDATA section", shown(parent)),
    )
    .expected("elements; the format has no text")
}

pub(super) fn late_doctype(token: &Token) -> Finding {
    Finding::new(Code::Syntax, token.at.start..token.at.start + 9, "a DOCTYPE stands here")
        .expected("it once, before the root element")
}
