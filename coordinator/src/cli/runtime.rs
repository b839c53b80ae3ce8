//! Threads that commands run on.

use std::future::Future;

use tokio_util::sync::CancellationToken;

use super::exit::{Exit, Failure};

/// Threads that this machine has.
pub(super) fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// Runs `work` to its end, on a new runtime.
pub(super) fn on_runtime<T>(threads: usize, work: impl Future<Output = Result<T, Failure>>) -> Result<T, Failure> {
    let internal = |e: &dyn std::fmt::Display| Failure::new(Exit::Failed, format!("cannot start threads: {e}"));
    // Reading and building keep to the threads the user allows, as rendering does.
    rayon::ThreadPoolBuilder::new().num_threads(threads).build_global().map_err(|e| internal(&e))?;
    let runtime =
        tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().map_err(|e| internal(&e))?;
    let done = runtime.block_on(work);
    // What may still run (a scene half read when a signal came) is not waited for.
    runtime.shutdown_background();
    done
}

/// Runs `work` off the async threads.
pub(super) async fn blocking<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> Result<T, Failure> {
    tokio::task::spawn_blocking(work)
        .await
        .map_err(|e| Failure::new(Exit::Failed, format!("internal error: {e}; please report it")))
}

/// What `work` gives, unless a signal comes first.
pub(super) async fn unless_stopped<T>(stop: &CancellationToken, work: impl Future<Output = T>) -> Result<T, Failure> {
    tokio::select! {
        done = work => Ok(done),
        () = stop.cancelled() => Err(Failure::new(Exit::Interrupted, "interrupted before anything was rendered")),
    }
}
