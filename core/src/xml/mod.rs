//! Text into a checked scene, with every problem of the document in its place.
//!
//! ```text
//! bytes ─ encoding ─▶ text ─┬─ outline, frame: all but the world's children ── one tree ─┐
//!                           └─ pieces of the world's children, in parallel ──────────────┤
//!                                ├─ fast: ordinary objects, no tree                       ▼
//!                                └─ runs of the rest, a small tree each ── check ──▶ assembly ──▶ Scene
//! ```
//!
//! The XML parser is `roxmltree`. It never sees a document whole: a tree of 300 MB of
//! text would take 2 GB. It never sees a DOCTYPE, more than `piece::MAX_DEPTH` levels
//! or `lex::MAX_ATTRIBUTES` attributes in a tag, all of which it can be made to choke
//! on. How the text is cut changes neither scene nor diagnostics.
//! What elements mean stands in `meaning`, once for trees and for the fast lane.
//!
//! Of large files there is no whole text: `stream` reads them block by block, as far as they are
//! ordinary scenes without errors, with the same result.
//!
//! White space between elements may be written as character references (`&#32;`), as
//! common validators take it; CDATA sections may not stand anywhere.

mod assembly;
mod check;
mod diagnostic;
mod encoding;
mod fast;
mod finding;
mod frame;
mod grammar;
mod lex;
mod meaning;
mod number;
mod part;
mod piece;
mod prolog;
mod source;
#[cfg_attr(not(unix), allow(dead_code, reason = "reading at an offset is Unix's"))]
mod stream;
mod suggest;
mod syntax;
#[cfg(test)]
mod tests;
mod world;

use std::fs::File;
use std::io::{Read as _, Seek as _, SeekFrom};
use std::path::{Path, PathBuf};

pub use diagnostic::{Code, Diagnostic, Place, Severity};

use crate::scene::Scene;
use assembly::{Assembly, Pictures};
use finding::{Findings, Limits};

/// How much is read and reported, and from where.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReadOptions {
    /// Errors reported at most; reading ends when as many were found.
    pub max_errors: usize,
    /// Warnings reported at most; further ones are counted.
    pub max_warnings: usize,
    /// The largest file taken, in bytes. At most about as much memory is needed to read it.
    pub max_bytes: u64,
    /// Folders that pictures are taken from beside the scene's own, with all below them.
    pub picture_folders: Vec<PathBuf>,
}

impl ReadOptions {
    fn limits(&self) -> Limits {
        Limits { errors: self.max_errors.max(1), warnings: self.max_warnings }
    }
}

impl Default for ReadOptions {
    fn default() -> Self {
        Self { max_errors: 100, max_warnings: 100, max_bytes: 16 << 30, picture_folders: Vec::new() }
    }
}

/// A scene that was read.
#[derive(Clone, Debug, PartialEq)]
pub struct Read {
    /// The scene.
    pub scene: Scene,
    /// What looks like a mistake in it, in document order.
    pub warnings: Vec<Diagnostic>,
    /// Warnings beyond [`ReadOptions::max_warnings`].
    pub omitted_warnings: usize,
    /// The files of its pictures, links resolved.
    pub pictures: Vec<PathBuf>,
}

/// Why there is no scene.
#[derive(Clone, Debug, PartialEq)]
pub struct ReadError {
    /// Errors and warnings, in document order; at least one error.
    pub diagnostics: Vec<Diagnostic>,
    /// Whether reading ended early because as many errors as are reported were found.
    pub cut: bool,
}

impl std::fmt::Display for ReadError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for (i, diagnostic) in self.diagnostics.iter().enumerate() {
            if i > 0 {
                f.write_str("\n\n")?;
            }
            diagnostic.fmt(f)?;
        }
        if self.cut { f.write_str("\n\nmore errors may follow; these come first") } else { Ok(()) }
    }
}

impl std::error::Error for ReadError {}

/// How the work is cut; changes no result.
#[derive(Clone, Copy, Debug)]
struct Tuning {
    /// Bytes of text for one tree.
    run: usize,
    /// Bytes of text for one piece.
    piece: usize,
    /// Pieces read before their results are put together.
    batch: usize,
    /// Whether there is a fast lane.
    fast: bool,
}

impl Default for Tuning {
    fn default() -> Self {
        Self { run: 64 << 10, piece: 128 << 10, batch: 128, fast: true }
    }
}

/// Reads the scene in the file at `path`. Pictures are looked up from its folder, and must lie in it, below it,
/// or in one of the options' folders.
///
/// # Errors
/// When the file cannot be read or is not a valid scene: everything that is wrong with it.
pub fn read_file(path: &Path, options: &ReadOptions) -> Result<Read, ReadError> {
    let name = path.display().to_string();
    let base_dir = path.parent().unwrap_or(Path::new(""));
    let (file, length) = open(path, options.max_bytes).map_err(|message| failed(&name, message))?;
    #[cfg(unix)]
    if length > LARGE {
        let fetch = |at: u64, buffer: &mut [u8]| fill(&file, at, buffer);
        if let Some(read) = streamed(&fetch, length, stream::Blocks::default(), &name, Some(base_dir), options) {
            return Ok(read);
        }
    }
    let bytes = file_bytes(file, length, options.max_bytes).map_err(|message| failed(&name, message))?;
    read_bytes(bytes, &name, Some(base_dir), options)
}

/// Reads the scene in `bytes`, called `name` in diagnostics. Pictures are looked up from
/// `base_dir`; without one, a scene with pictures is an error.
///
/// # Errors
/// When it is not a valid scene: everything that is wrong with it.
pub fn read_bytes(
    bytes: Vec<u8>,
    name: &str,
    base_dir: Option<&Path>,
    options: &ReadOptions,
) -> Result<Read, ReadError> {
    read(bytes, name, base_dir, options, Tuning::default())
}

fn read(
    bytes: Vec<u8>,
    name: &str,
    base_dir: Option<&Path>,
    options: &ReadOptions,
    tuning: Tuning,
) -> Result<Read, ReadError> {
    if bytes.len() as u64 > options.max_bytes {
        return Err(failed(name, too_long(options.max_bytes)));
    }
    let limits = options.limits();
    let decoded = match encoding::decode(bytes) {
        Ok(decoded) => decoded,
        Err(undecodable) => {
            let mut lines = source::Lines::new(&undecodable.text, 0);
            let diagnostic = lines.diagnostic(name, undecodable.finding);
            return Err(ReadError { diagnostics: vec![diagnostic], cut: false });
        }
    };
    let mut assembly = Assembly::new(limits, Pictures { base: base_dir, more: &options.picture_folders });
    document(&decoded.text, decoded.start, limits, tuning, &mut assembly);
    let errors = assembly.findings.errors;
    let diagnostics = diagnostics(&mut assembly.findings, &decoded.text, decoded.start, name);
    // The text is the largest thing in memory, and nobody needs it any more.
    drop(decoded);
    if errors > 0 {
        return Err(ReadError { diagnostics, cut: assembly.cut || errors > limits.errors });
    }
    let pictures = assembly.files();
    match assembly.scene.finish() {
        Ok(scene) => {
            let omitted_warnings = assembly.findings.warnings.saturating_sub(diagnostics.len());
            Ok(Read { scene, warnings: diagnostics, omitted_warnings, pictures })
        }
        Err(invalid) => Err(failed(name, format!("the scene cannot be built: {invalid}"))),
    }
}

/// Reads a file block by block; `None` where that cannot be done.
#[cfg_attr(not(unix), allow(dead_code, reason = "reading at an offset is Unix's"))]
fn streamed(
    fetch: &stream::Fetch<'_>,
    length: usize,
    blocks: stream::Blocks,
    name: &str,
    base_dir: Option<&Path>,
    options: &ReadOptions,
) -> Option<Read> {
    let limits = options.limits();
    let (assembly, warnings) = stream::read(
        fetch,
        (length, name),
        blocks,
        limits,
        Pictures { base: base_dir, more: &options.picture_folders },
    )?;
    let omitted_warnings = assembly.findings.warnings.saturating_sub(warnings.len());
    let pictures = assembly.files();
    Some(Read { scene: assembly.scene.finish().ok()?, warnings, omitted_warnings, pictures })
}

/// The findings that are to be reported, in document order, with their places.
fn diagnostics(findings: &mut Findings, text: &str, start: usize, name: &str) -> Vec<Diagnostic> {
    let limits = findings.limits();
    findings.list.sort_by_key(|f| f.at.start);
    let mut lines = source::Lines::new(text, start);
    let (mut kept_errors, mut kept_warnings) = (0, 0);
    let mut diagnostics = Vec::new();
    for finding in std::mem::take(&mut findings.list) {
        let (kept, limit) = match finding.code.severity() {
            Severity::Error => (&mut kept_errors, limits.errors),
            Severity::Warning => (&mut kept_warnings, limits.warnings),
        };
        *kept += 1;
        if *kept <= limit {
            diagnostics.push(lines.diagnostic(name, finding));
        }
    }
    diagnostics
}

/// Reads the document's parts into `assembly`.
fn document(text: &str, start: usize, limits: Limits, tuning: Tuning, assembly: &mut Assembly<'_>) {
    let mut findings = Findings::new(limits);
    let outline = frame::outline(text, start, &mut findings);
    if findings.list.iter().any(|f| f.code == Code::InternalSubset) {
        // What its entities were to stand for cannot be known.
        findings.list.retain(|f| f.code == Code::InternalSubset);
        assembly.findings.append(findings);
        return;
    }
    // The fast lane does not notice white space, which a stand-alone document may not have.
    let tuning = Tuning { fast: tuning.fast && outline.standalone.is_none(), ..tuning };
    let close = match &outline.world {
        Some(world) if world.kind == (lex::Kind::Start { empty: false }) => {
            Some(world::children(text, world, tuning, limits, assembly))
        }
        _ => None,
    };
    frame::check(text, &outline, close, limits, findings, assembly);
    if let Some(yes) = outline.standalone.filter(|_| assembly.blank) {
        assembly.findings.push(
            finding::Finding::new(
                Code::UnexpectedContent,
                yes,
                "a document that is `standalone` may have no white space between its elements",
            )
            .expected("standalone=\"no\", or nothing about it: only declarations outside tell white space from text")
            .suggest(Some("no")),
        );
    }
}

fn failed(name: &str, message: String) -> ReadError {
    let diagnostic = Diagnostic {
        severity: Severity::Error,
        code: Code::Io,
        file: crate::text::printable(name, false),
        place: None,
        message: crate::text::printable(&message, false),
        expected: None,
        suggestion: None,
    };
    ReadError { diagnostics: vec![diagnostic], cut: false }
}

fn too_long(max_bytes: u64) -> String {
    format!("the scene is larger than the limit of {max_bytes} bytes")
}

/// A regular file and its length; whatever else a name may stand for is not opened.
fn open(path: &Path, max_bytes: u64) -> Result<(File, usize), String> {
    let kind = std::fs::metadata(path).map_err(unreadable)?;
    if kind.is_dir() {
        return Err("this is a folder, not a scene file".into());
    }
    if !kind.is_file() {
        return Err("this is a pipe, socket or device, not a regular file".into());
    }
    if kind.len() > max_bytes {
        return Err(too_long(max_bytes));
    }
    Ok((File::open(path).map_err(unreadable)?, usize::try_from(kind.len()).unwrap_or(usize::MAX)))
}

fn unreadable(e: std::io::Error) -> String {
    match e.kind() {
        std::io::ErrorKind::NotFound => "there is no such file".to_owned(),
        std::io::ErrorKind::PermissionDenied => "the file may not be read (permission denied)".to_owned(),
        _ => format!("the file cannot be read: {e}"),
    }
}

/// The bytes of `file`, about `length`.
fn file_bytes(mut file: File, length: usize, max_bytes: u64) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::new();
    bytes
        .try_reserve_exact(length.saturating_add(1))
        .map_err(|_| "there is not enough memory for the file".to_owned())?;
    #[cfg(unix)]
    if length > SEVERAL {
        together(&file, length, &mut bytes).map_err(unreadable)?;
        file.seek(SeekFrom::Start(bytes.len() as u64)).map_err(unreadable)?;
    }
    // One byte more than allowed shows a file that grew.
    let most = max_bytes.saturating_add(1).saturating_sub(bytes.len() as u64);
    file.take(most).read_to_end(&mut bytes).map_err(unreadable)?;
    Ok(bytes)
}

/// Files above this many bytes are read block by block, where that can be done.
#[cfg(unix)]
const LARGE: usize = 1 << 20;
/// Others above this many bytes are read by several threads.
#[cfg(unix)]
const SEVERAL: usize = 4 << 20;

/// Puts the first `length` bytes of `file`, or as many as there are, into empty `bytes`: each
/// thread fetches its share, and the fresh memory for it, which takes as long as the parsing of
/// half of them.
#[cfg(unix)]
fn together(file: &File, length: usize, bytes: &mut Vec<u8>) -> std::io::Result<()> {
    use rayon::prelude::*;
    bytes.resize(length, 0);
    let fetch = |(i, part): (usize, &mut [u8])| fill(file, (i * SEVERAL) as u64, part);
    let fetched = bytes.par_chunks_mut(SEVERAL).enumerate().map(fetch).collect::<std::io::Result<Vec<_>>>()?;
    // A file that shrank ends where the first part does that is not full.
    let full = fetched.iter().take_while(|&&n| n == SEVERAL).count();
    bytes.truncate(full * SEVERAL + fetched.get(full).copied().unwrap_or(0));
    Ok(())
}

/// Fills `buffer` with what stands at `at`, as far as `file` reaches; gives how much that is.
#[cfg(unix)]
fn fill(file: &File, at: u64, buffer: &mut [u8]) -> std::io::Result<usize> {
    use std::os::unix::fs::FileExt;
    let mut done = 0;
    while done < buffer.len() {
        match file.read_at(&mut buffer[done..], at + done as u64) {
            Ok(0) => break,
            Ok(n) => done += n,
            Err(e) if e.kind() == std::io::ErrorKind::Interrupted => {}
            Err(e) => return Err(e),
        }
    }
    Ok(done)
}
