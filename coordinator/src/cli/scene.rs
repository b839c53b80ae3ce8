//! A scene file, and what is wrong with it.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::Serialize;
use tessera_core::scene::Scene;
use tessera_core::xml::{self, Code, Diagnostic, ReadOptions, Severity};

use super::console::{Console, Tone};
use super::exit::{Exit, Failure};

/// Warnings of one kind that people are shown: a mesh may have thousands.
const ALIKE: usize = 4;

/// What a scene file came to.
#[derive(Debug)]
pub(crate) struct Read {
    /// The scene, where there is no error in it.
    pub(crate) scene: Option<Scene>,
    /// Errors and warnings, in document order.
    pub(crate) diagnostics: Vec<Diagnostic>,
    /// The files of its pictures.
    pub(crate) pictures: Vec<PathBuf>,
    /// What is to be said about diagnostics that were left out.
    omitted: Option<String>,
}

/// Reads the scene at `path`, with pictures from its own folder and those `folders`.
pub(crate) fn read(path: &Path, folders: Vec<PathBuf>) -> Read {
    match xml::read_file(path, &ReadOptions { picture_folders: folders, ..ReadOptions::default() }) {
        Ok(xml::Read { scene, warnings, omitted_warnings, pictures }) => Read {
            scene: Some(scene),
            diagnostics: warnings,
            pictures,
            omitted: (omitted_warnings > 0).then(|| format!("{omitted_warnings} more warnings")),
        },
        Err(xml::ReadError { diagnostics, cut }) => {
            let omitted = cut.then(|| "reading ended here; there may be more errors".to_owned());
            Read { scene: None, diagnostics, pictures: Vec::new(), omitted }
        }
    }
}

impl Read {
    /// How many errors and warnings there are, as far as they are reported.
    pub(crate) fn counts(&self) -> (usize, usize) {
        let errors = self.diagnostics.iter().filter(|d| d.severity == Severity::Error).count();
        (errors, self.diagnostics.len() - errors)
    }

    /// Says what is wrong, marked in its line, on stderr.
    pub(crate) fn tell(&self, console: &Console) {
        let paint = |severity, text: &str| {
            let tone = if severity == Severity::Error { Tone::Error } else { Tone::Warning };
            console.paint(tone, text)
        };
        let mut warnings: BTreeMap<&str, usize> = BTreeMap::new();
        for diagnostic in &self.diagnostics {
            if diagnostic.severity == Severity::Warning {
                let told = warnings.entry(diagnostic.code.as_str()).or_default();
                *told += 1;
                if *told > ALIKE {
                    continue;
                }
            }
            console.say(&diagnostic.render(&paint));
            console.say("");
        }
        for (code, told) in warnings.into_iter().filter(|(_, told)| *told > ALIKE) {
            let kind = console.paint(Tone::Warning, &format!("warning[{code}]"));
            console.say(&format!("{kind}: {} more like these; check --json lists them\n", told - ALIKE));
        }
        if let Some(omitted) = &self.omitted {
            console.say(&format!("{omitted}\n"));
        }
    }
}

/// Says what is wrong with a scene, and gives it back if it can be rendered.
pub(crate) fn accept(read: Read, path: &Path, console: &Console) -> Result<Arc<Scene>, Failure> {
    let (errors, _) = read.counts();
    if let [Diagnostic { code: Code::Io, message, .. }] = &read.diagnostics[..] {
        // Nothing was read: what is in it is not the matter.
        return Err(Failure::new(Exit::Scene, format!("'{}': {message}", path.display())));
    }
    read.tell(console);
    read.scene.map(Arc::new).ok_or_else(|| {
        let errors = if errors == 1 { "1 error".into() } else { format!("{errors} errors") };
        Failure::new(Exit::Scene, format!("'{}' is not a valid scene: {errors}", path.display()))
    })
}

/// A diagnostic for machines.
#[derive(Debug, Serialize)]
pub(crate) struct DiagnosticJson<'a> {
    severity: &'static str,
    code: &'static str,
    file: &'a str,
    line: Option<u64>,
    column: Option<u64>,
    message: &'a str,
    source_line: Option<&'a str>,
    /// The spot in `source_line`: characters from 0, half-open.
    marked: Option<[usize; 2]>,
    expected: Option<&'a str>,
    suggestion: Option<&'a str>,
}

impl<'a> From<&'a Diagnostic> for DiagnosticJson<'a> {
    fn from(d: &'a Diagnostic) -> Self {
        let place = d.place.as_ref();
        Self {
            severity: if d.severity == Severity::Error { "error" } else { "warning" },
            code: d.code.as_str(),
            file: &d.file,
            line: place.map(|p| p.line),
            column: place.map(|p| p.column),
            message: &d.message,
            source_line: place.map(|p| p.source_line.as_str()),
            marked: place.map(|p| [p.marked.start, p.marked.end]),
            expected: d.expected.as_deref(),
            suggestion: d.suggestion.as_deref(),
        }
    }
}
