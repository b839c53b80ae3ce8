//! A job's end: what there is of its picture.

use tokio::time::Instant;

use super::{Ended, Run};
use crate::error::RenderError;
use crate::farm::stitch::Stitched;
use crate::job::{Rendered, Unfinished};

/// A job of which nothing is leased any more; its picture may still be being stitched.
pub(crate) struct Finished {
    run: Run,
    end: Result<(), RenderError>,
    at: Instant,
}

impl Run {
    /// Whether it is over.
    pub(in crate::farm) fn is_over(&self) -> bool {
        self.end.is_some()
    }

    /// Whether its time was up.
    pub(in crate::farm) fn timed_out(&self) -> bool {
        self.passes.timed_out
    }

    /// Ends it, by `error` where it has not come to its end.
    pub(in crate::farm) fn finish(mut self, error: RenderError) -> Finished {
        let end: Ended = self.end.take();
        self.spans.end();
        let end = end.unwrap_or(Err(error));
        if end.is_ok() {
            self.progress.send_modify(|p| (p.share, p.remaining) = (1.0, Some(std::time::Duration::ZERO)));
        }
        Finished { run: self, end, at: Instant::now() }
    }
}

impl Finished {
    /// Waits until the picture is stitched; `strangers`: so many calls were refused.
    ///
    /// # Errors
    /// [`Unfinished`], with everything that was done until then.
    pub(crate) async fn rendered(self, strangers: u64) -> Result<Rendered, Unfinished> {
        let Run { start, progress, passes, verification, region, stitcher, tiles, .. } = self.run;
        drop(tiles);
        let internal = |e: &dyn std::fmt::Display| RenderError::Internal(e.to_string());
        let Stitched { image, done } = stitcher.await.map_err(|e| internal(&e))??;
        let p = progress.borrow().clone();
        let (tiles, trace) = (done.len() as u64, self.at - start);
        let error = passes.error();
        let rendered = Rendered {
            region,
            image,
            done,
            rays: p.rays,
            earlier: p.earlier,
            workers: p.workers,
            tiles,
            trace,
            error: (error.pixels > 0).then_some(error),
            target_met: passes.is_met(&error),
            pass: passes.pass,
            forecast: passes.forecast(),
            passes: passes.begun,
            timed_out: passes.timed_out,
            strangers,
            verification,
        };
        match self.end {
            Ok(()) => Ok(rendered),
            Err(error) => Err(Unfinished { error, partial: Some(Box::new(rendered)) }),
        }
    }
}
