//! Large files of ordinary scenes, of which no more than a few blocks are ever in memory.
//!
//! Fresh memory for a whole text takes longer than reading what stands in it. So blocks of the
//! file are fetched into buffers that are used again and again, and read like the pieces of
//! [`super::world`]: each from the first object in it to the first one of the next. Only scenes
//! without errors, written in ASCII, are read to their end; whatever else turns up leaves the
//! file to the reader of whole texts, which has the last word on it. Places of warnings are found
//! block by block, too; lines are counted only where there is one.

use std::io;
use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;

use super::Tuning;
use super::assembly::{Assembly, Pictures};
use super::diagnostic::Diagnostic;
use super::fast::Fast;
use super::finding::{Findings, Limits};
use super::lex::{self, Kind};
use super::part::Part;
use super::piece::{End, Reader, begins_object};
use super::source::{AROUND, Lines};
use super::{encoding, frame};

/// Fills a buffer with what stands at an offset, as far as the file reaches; gives how much that is.
pub(super) type Fetch<'f> = dyn Fn(u64, &mut [u8]) -> io::Result<usize> + Sync + 'f;

/// How a file is cut; changes no result.
#[derive(Clone, Copy, Debug)]
pub(super) struct Blocks {
    /// Bytes of a block, but for the last one, which takes the rest.
    pub block: usize,
    /// Bytes behind a block, where its last object and the next block's first one must lie.
    pub behind: usize,
    /// Blocks read before their results are put together.
    pub batch: usize,
}

impl Default for Blocks {
    fn default() -> Self {
        Self { block: 256 << 10, behind: 16 << 10, batch: 64 }
    }
}

/// Reads the scene of `length` bytes, called `name`, that `fetch` gives: with its warnings, in
/// document order. `None` where the whole text is needed.
pub(super) fn read<'b>(
    fetch: &Fetch<'_>,
    (length, name): (usize, &str),
    blocks: Blocks,
    limits: Limits,
    pictures: Pictures<'b>,
) -> Option<(Assembly<'b>, Vec<Diagnostic>)> {
    let mut head = vec![0; blocks.block.min(length)];
    // Where ASCII is itself, the encoding makes no difference.
    if fetch(0, &mut head).ok()? < head.len() || !head.is_ascii() {
        return None;
    }
    let decoded = encoding::decode(head.clone()).ok().filter(|d| d.start == 0 && d.text.as_bytes() == head)?;
    let mut findings = Findings::new(limits);
    let outline = frame::outline(&decoded.text, 0, &mut findings);
    let world = outline.world.as_ref().filter(|w| w.kind == Kind::Start { empty: false })?;
    if outline.standalone.is_some() || !findings.list.is_empty() {
        return None;
    }
    let begin = world.at.end;
    let count = ((length - begin) / blocks.block).max(1);
    let file = Stream { fetch, length, name, blocks, limits, begin, count, buffers: Mutex::default() };

    let mut assembly = Assembly::new(limits, pictures);
    let mut parts = Vec::new();
    let mut told = Vec::new();
    let mut tail = None;
    for first in (0..count).step_by(blocks.batch) {
        let batch = first..(first + blocks.batch).min(count);
        // What was read last is put together while the next blocks are read.
        let (read, ()) = rayon::join(
            || {
                batch
                    .clone()
                    .into_par_iter()
                    .map(|i| file.with_buffer(|b| file.block(i, b)))
                    .collect::<Option<Vec<_>>>()
            },
            || parts.drain(..).for_each(|part| assembly.add(part)),
        );
        let read = read?;
        if first == 0 && count > blocks.batch {
            // The rest will be much the same.
            let share = (count * 33).div_ceil(blocks.batch * 32);
            let held = |of: fn(&Part) -> usize| read.iter().map(|b| of(&b.part)).sum::<usize>() * share;
            assembly.scene.reserve(held(Part::triangles), held(Part::spheres));
        }
        for (i, block) in batch.zip(read) {
            parts.push(block.part);
            told.extend(block.told.into_iter().map(|diagnostic| (i, diagnostic)));
            told.truncate(limits.warnings);
            tail = block.tail;
        }
        if assembly.findings.errors > 0 {
            return None;
        }
    }
    parts.into_iter().for_each(|part| assembly.add(part));

    // The document without the world's children.
    let text = decoded.text[..begin].to_owned() + &tail?;
    let warnings = assembly.findings.warnings;
    frame::check(&text, &outline, Some(Some(begin..begin)), limits, findings, &mut assembly);
    let ended = fetch(length as u64, &mut [0]).is_ok_and(|more| more == 0);
    if assembly.findings.errors > 0 || assembly.findings.warnings > warnings || !ended {
        return None;
    }
    Some((assembly, file.placed(told)?))
}

/// What a block holds.
struct Block {
    part: Part,
    /// Warnings, their lines counted from the block's beginning.
    told: Vec<Diagnostic>,
    /// Of the last one, what stands behind the world's children.
    tail: Option<String>,
}

struct Stream<'f> {
    fetch: &'f Fetch<'f>,
    length: usize,
    name: &'f str,
    blocks: Blocks,
    limits: Limits,
    /// Where the world's children begin.
    begin: usize,
    count: usize,
    /// Those not in use.
    buffers: Mutex<Vec<Vec<u8>>>,
}

impl Stream<'_> {
    fn with_buffer<T>(&self, f: impl FnOnce(&mut Vec<u8>) -> T) -> T {
        let buffers = || self.buffers.lock().unwrap_or_else(PoisonError::into_inner);
        let mut buffer = buffers().pop().unwrap_or_default();
        let done = f(&mut buffer);
        buffers().push(buffer);
        done
    }

    /// What stands at `from`, all `size` bytes of it.
    fn bytes<'b>(&self, from: usize, size: usize, buffer: &'b mut Vec<u8>) -> Option<&'b [u8]> {
        if buffer.len() < size {
            buffer.resize(size, 0);
        }
        let bytes = &mut buffer[..size];
        ((self.fetch)(from as u64, bytes).ok()? == size).then_some(bytes)
    }

    /// Where block `i` begins; before the first one, where the document does.
    fn from(&self, i: usize) -> usize {
        if i == usize::MAX { 0 } else { self.begin + i * self.blocks.block }
    }

    /// Reads block `i`.
    fn block(&self, i: usize, buffer: &mut Vec<u8>) -> Option<Block> {
        let Blocks { block, behind, .. } = self.blocks;
        let from = self.from(i);
        let last = i + 1 == self.count;
        let size = if last { self.length - from } else { (block + behind).min(self.length - from) };
        let bytes = self.bytes(from, size, buffer)?;
        let object = |from: usize| {
            let mut tags = memchr::memchr_iter(b'<', &bytes[from..]).map(|at| from + at);
            tags.find(|&at| begins_object(bytes, at))
        };
        let start = if i == 0 { 0 } else { object(0)? };
        let stop = if last { size } else { object(block)? };
        let (mut part, end) =
            self.ordinary(bytes, start, stop, last).or_else(|| self.careful(bytes, start, stop, last))?;
        let mut told = Vec::new();
        if !part.findings.list.is_empty() {
            let findings = std::mem::take(&mut part.findings.list);
            // Lines are counted forward, but what is found first is told first.
            let mut findings: Vec<_> = findings.into_iter().enumerate().collect();
            findings.sort_by_key(|(_, f)| f.at.start);
            let mut lines = Lines::new(str::from_utf8(bytes).ok()?, 0);
            for (found, finding) in findings {
                let whole = last || finding.at.end + AROUND <= size;
                let diagnostic = Some(lines.diagnostic(self.name, finding)).filter(|_| whole)?;
                // Where the block's first line begins is not known.
                told.push((found, Some(diagnostic).filter(|d| d.place.as_ref().is_some_and(|p| p.line > 1))?));
            }
            told.sort_by_key(|(found, _)| *found);
        }
        let tail = match last {
            true => Some(str::from_utf8(&bytes[end..]).ok().filter(|t| t.is_ascii())?.to_owned()),
            false => None,
        };
        let told = told.into_iter().map(|(_, diagnostic)| diagnostic).collect();
        Some(Block { part, told, tail })
    }

    /// Diagnostics with their blocks, their lines counted from the document's beginning.
    fn placed(&self, told: Vec<(usize, Diagnostic)>) -> Option<Vec<Diagnostic>> {
        // What lies before block i, behind the beginning of the block before it.
        let ends = |i: usize| {
            let (from, to) = (self.from(i.wrapping_sub(1)), self.from(i));
            self.with_buffer(|b| Some(line_ends(self.bytes(from, (to + 1).min(self.length) - from, b)?, to - from)))
        };
        let blocks = told.last().map_or(0, |(i, _)| i + 1);
        let mut before = (0..blocks).into_par_iter().map(ends).collect::<Option<Vec<_>>>()?;
        for i in 1..blocks {
            before[i] += before[i - 1];
        }
        let placed = told.into_iter().map(|(i, mut diagnostic)| {
            if let Some(place) = &mut diagnostic.place {
                place.line += before[i];
            }
            diagnostic
        });
        let mut placed: Vec<_> = placed.collect();
        placed.sort_by_key(|d| d.place.as_ref().map(|p| (p.line, p.column)));
        Some(placed)
    }

    /// Reads objects that the fast lane takes, all of them; gives where they end.
    fn ordinary(&self, bytes: &[u8], start: usize, stop: usize, last: bool) -> Option<(Part, usize)> {
        let mut part = Part::new(self.limits);
        let mut fast = Fast::new(bytes);
        let mut at = start;
        loop {
            while at < stop && lex::is_space(bytes[at]) {
                at += 1;
            }
            if at >= stop || (last && bytes[at..].starts_with(b"</world")) {
                break;
            }
            let (object, end) = fast.object(at)?;
            at = end;
            fast.take(object, &mut part);
        }
        (at == stop || last).then_some((part, at))
    }

    /// Reads whatever stands there, as long as nothing is wrong with it.
    fn careful(&self, bytes: &[u8], start: usize, stop: usize, last: bool) -> Option<(Part, usize)> {
        let text = str::from_utf8(bytes).ok().filter(|text| text.is_ascii())?;
        let (part, end, broken) = Reader::new(text, Tuning::default(), self.limits, true, false).read(start, stop);
        let end = match end {
            End::At(at) if at == stop && !last => at,
            End::World(tag) if last => tag.start,
            _ => return None,
        };
        (!broken && part.findings.errors == 0).then_some((part, end))
    }
}

/// Line ends in the first `len` bytes; the byte behind them tells CR from CR LF.
fn line_ends(bytes: &[u8], len: usize) -> u64 {
    let feeds = memchr::memchr_iter(b'\n', &bytes[..len]).count();
    let returns = memchr::memchr_iter(b'\r', &bytes[..len]).filter(|i| bytes.get(i + 1) != Some(&b'\n')).count();
    (feeds + returns) as u64
}
