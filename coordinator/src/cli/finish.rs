//! The end of a render, when the farm is closed already: picture and report into their files, on the program's main
//! thread, so that nothing can keep it waiting.

use std::path::{Path, PathBuf};
use std::time::Instant;

use coordinator::journal::Journal;
use coordinator::{PixelFormat, Rendered};
use tessera_core::film::file::{Output, OutputError, Reserved, write_text};
use tracing::info;

use super::console::Console;
use super::describe::Description;
use super::exit::{Exit, Failure};
use super::options::{Options, ReportTo};
use super::report::{Phases, Report};
use super::signals::Writing;

/// What belongs to a render beside its picture.
pub(super) struct Rest<'a> {
    pub(super) options: &'a Options,
    pub(super) description: Option<&'a Description>,
    pub(super) phases: Phases,
    pub(super) began: Instant,
    pub(super) journal: Option<&'a Journal>,
}

impl Rest<'_> {
    /// Writes the picture to `output`, into room that was reserved for it, and the report.
    pub(super) fn finish(mut self, output: &Output, rendered: &Rendered, room: Reserved) -> Result<(), Failure> {
        let _writing = Writing::begin();
        let writing = Instant::now();
        let size = (rendered.region.width(), rendered.region.height());
        // Where a journal makes up for a crash, the picture must be there before the journal goes.
        let durable = self.journal.is_some_and(|j| j.path().exists());
        let write = || {
            let written = match rendered.image.pixels() {
                Some(pixels) => output.write_reserved(room, size, pixels.into(), durable),
                None => output.write_rows_reserved(room, size, &rendered.image, durable),
            };
            (written, writing.elapsed())
        };
        // The report's hash takes about as long as the picture's file.
        let hash = || match (&self.options.report, rendered.image.format()) {
            (Some(_), PixelFormat::F32) => rendered.image.sha256().ok(),
            _ => None,
        };
        let ((written, took), pixels_sha256) = rayon::join(write, hash);
        written.map_err(|e| self.elsewhere(output, rendered, &e))?;
        self.phases.write = took;
        info!(seconds = took.as_secs_f64(), file = %output.path().display(), "picture written");
        self.report(output, rendered, pixels_sha256)
    }

    fn report(&self, output: &Output, rendered: &Rendered, pixels_sha256: Option<String>) -> Result<(), Failure> {
        let (Some(to), Some(description)) = (&self.options.report, self.description) else { return Ok(()) };
        let failed = |e: &dyn std::fmt::Display| Failure::new(Exit::Failed, e);
        let name = output.path().display().to_string();
        let total = self.began.elapsed();
        let report = Report::new(self.options, (name, pixels_sha256), description, rendered, &self.phases, total);
        let text = report.to_text().map_err(|e| failed(&e))?;
        match to {
            ReportTo::Stdout => Console::new().out(&text)?,
            ReportTo::File(path) => write_text(path, &text).map_err(|e| self.unreported(output, &e))?,
        }
        Ok(())
    }

    /// What was rendered is kept there, too.
    fn kept(&self) -> Option<&Path> {
        self.journal.and_then(Journal::kept).filter(|path| path.exists())
    }

    /// The report cannot be written, as `e` says; the picture could.
    fn unreported(&self, output: &Output, e: &OutputError) -> Failure {
        let mut said = format!("{e}; the picture is in '{}'", output.path().display());
        if self.kept().is_some() {
            said += "; the same command goes on to the report once there is a place for it";
        }
        Failure::new(Exit::Failed, said)
    }

    /// The picture cannot be written where it should, as `e` says: it goes to another place if there is one.
    fn elsewhere(&self, output: &Output, rendered: &Rendered, e: &OutputError) -> Failure {
        let mut said = e.to_string();
        let kept = self.kept();
        match somewhere(output, rendered) {
            Some(place) => said += &format!("; the picture is in '{}' instead", place.display()),
            None => said += "; no other place takes it either",
        }
        if let Some(path) = kept {
            said += &format!(
                "; what was rendered is kept in '{}': make room, and the same command goes on from there",
                path.display()
            );
        }
        Failure::new(Exit::Failed, said)
    }
}

/// Writes the picture into the first folder that takes it, under a name that nothing bears there; gives its path.
fn somewhere(output: &Output, rendered: &Rendered) -> Option<PathBuf> {
    let folders = [std::env::current_dir().ok(), std::env::home_dir(), Some(std::env::temp_dir())];
    let (name, size) = (output.path().file_name()?, (rendered.region.width(), rendered.region.height()));
    folders.into_iter().flatten().find_map(|folder| {
        let path = free(&folder, Path::new(name))?;
        let elsewhere = output.at(&path).ok()?;
        elsewhere.write_rows(size, &rendered.image).ok()?;
        Some(path)
    })
}

/// `name` in `folder`, with a number before its extension where the name is taken.
fn free(folder: &Path, name: &Path) -> Option<PathBuf> {
    let numbered = |n: u32| {
        let mut stem = name.file_stem()?.to_os_string();
        stem.push(format!("-{n}.{}", name.extension()?.to_string_lossy()));
        Some(folder.join(stem))
    };
    let plain = folder.join(name);
    if plain.symlink_metadata().is_err() {
        return Some(plain);
    }
    (2..1000).filter_map(numbered).find(|path| path.symlink_metadata().is_err())
}
