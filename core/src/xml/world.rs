//! The world's children in parallel, with the result of reading them in order.
//!
//! Where a piece begins is guessed: at the first `<triangle`, `<sphere`, `<plane` or
//! `<light` behind a multiple of the piece size. A guess is right if the piece before
//! ends exactly there; that one begins where its own predecessor ended, and so on back
//! to the first. What was read from a wrong guess (inside a comment, say) is thrown
//! away and read again from the right place, so the result is that of one reader.

use std::ops::Range;

use rayon::prelude::*;

use super::Tuning;
use super::assembly::Assembly;
use super::finding::Limits;
use super::lex::Token;
use super::part::Part;
use super::piece::{self, End, Reader, begins_object};

/// Reads the children of the world that `open` begins into `assembly`. Gives the end tag,
/// or `None` if the text ended first, or was left with as many errors as are reported.
pub(super) fn children(
    text: &str,
    open: &Token,
    tuning: Tuning,
    limits: Limits,
    assembly: &mut Assembly<'_>,
) -> Option<Range<usize>> {
    let mut at = open.at.end;
    let mut broken = false;
    let mut close = None;
    // What was read last is put together while the next pieces are read.
    let mut parts: Vec<Part> = Vec::new();
    while close.is_none() && at < text.len() {
        let bounds = bounds(text.as_bytes(), at, tuning);
        let pieces: Vec<(usize, usize)> = bounds.windows(2).map(|w| (w[0], w[1])).collect();
        let read = |(i, &(start, stop)): (usize, &(usize, usize))| {
            Reader::new(text, tuning, limits, i > 0, broken).read(start, stop)
        };
        let (results, full) = rayon::join(
            || pieces.par_iter().enumerate().map(read).collect::<Vec<_>>(),
            || add(assembly, std::mem::take(&mut parts)),
        );
        if full {
            return None;
        }
        for ((start, stop), result) in pieces.into_iter().zip(results) {
            if stop <= at {
                continue; // the piece before reached beyond it
            }
            let usable = start == at && result.1 != End::Abandoned;
            let (part, end, now_broken) =
                if usable { result } else { Reader::new(text, tuning, limits, false, broken).read(at, stop) };
            broken |= now_broken;
            parts.push(part);
            match end {
                End::At(next) => at = next,
                End::World(tag) => {
                    close = Some(tag);
                    break;
                }
                End::Text | End::Abandoned => at = text.len(),
            }
        }
    }
    if add(assembly, parts) {
        return None;
    }
    // Behind other broken markup, the end tag may have been swallowed by it.
    if close.is_none() && !broken {
        assembly.findings.push(piece::unclosed(text, open.name.clone()));
    }
    close
}

/// Adds `parts`, until as many errors are found as are reported: then it says so.
fn add(assembly: &mut Assembly<'_>, parts: Vec<Part>) -> bool {
    for part in parts {
        assembly.add(part);
        if assembly.findings.full() {
            assembly.cut = true;
            return true;
        }
    }
    false
}

/// The pieces' beginnings and the last one's end, by rising offset.
fn bounds(bytes: &[u8], at: usize, tuning: Tuning) -> Vec<usize> {
    let mut bounds = vec![at];
    for i in 1..=tuning.batch {
        let from = at.saturating_add(i.saturating_mul(tuning.piece));
        let to = from.saturating_add(tuning.piece).min(bytes.len());
        if from >= to {
            break;
        }
        let found = memchr::memchr_iter(b'<', &bytes[from..to]).map(|o| from + o).find(|&o| begins_object(bytes, o));
        bounds.extend(found);
    }
    let reached = at.saturating_add(tuning.batch.saturating_add(1).saturating_mul(tuning.piece));
    if bounds.len() == 1 || reached >= bytes.len() {
        bounds.push(bytes.len());
    }
    bounds
}
