//! `--journal` and `--restart`: from where a render goes on.

use std::sync::Arc;
use std::time::Instant;

use coordinator::RenderJob;
use coordinator::journal::{Journal, JournalError};

use tessera_core::film::file::plan_text;

use super::exit::{Exit, Failure};
use super::options::Options;

/// The journal that was asked for, and what an earlier run left in it.
pub(super) fn open(options: &Options) -> Result<Option<Arc<Journal>>, Failure> {
    let Some(path) = &options.journal else { return Ok(None) };
    if path.symlink_metadata().is_err() {
        // Known now rather than after two seconds.
        plan_text(path).map_err(Failure::usage)?;
    }
    let reading = Instant::now();
    let journal = Journal::open(path, options.restart).map_err(failure)?;
    if journal.goes_on() {
        tracing::info!(seconds = reading.elapsed().as_secs_f64(), "journal read");
    }
    Ok(Some(Arc::new(journal)))
}

/// Makes sure that what an earlier run left is of `job`; gives the share that was done of its last pass, and that
/// pass's number, from 0.
pub(super) fn check(journal: &Journal, job: &RenderJob) -> Result<Option<(f64, u32)>, Failure> {
    let share = journal.share();
    if share.is_some() {
        journal.check(&job.head()).map_err(failure)?;
    }
    Ok(share)
}

fn failure(e: JournalError) -> Failure {
    let exit = match e {
        JournalError::Io(..) | JournalError::Busy(_) => Exit::Failed,
        _ => Exit::Usage,
    };
    Failure::new(exit, e)
}
