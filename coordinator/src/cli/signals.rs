//! Ctrl-C and SIGTERM: the first stops, the second leaves at once.

use tokio_util::sync::CancellationToken;

use super::console::Console;
use super::exit::Exit;

/// A token that the first signal cancels. Runs on the calling runtime.
pub(crate) fn stop_on_signal(console: &Console) -> CancellationToken {
    let token = CancellationToken::new();
    let (stop, console) = (token.clone(), console.clone());
    tokio::spawn(async move {
        let Some(mut signals) = Signals::new(&console) else { return };
        signals.next().await;
        console.say("stopping, and keeping what is done; once more leaves at once");
        stop.cancel();
        signals.next().await;
        std::process::exit(Exit::Interrupted as i32);
    });
    token
}

#[cfg(unix)]
struct Signals {
    interrupt: tokio::signal::unix::Signal,
    terminate: tokio::signal::unix::Signal,
}

#[cfg(unix)]
impl Signals {
    fn new(console: &Console) -> Option<Self> {
        use tokio::signal::unix::{SignalKind, signal};
        match (signal(SignalKind::interrupt()), signal(SignalKind::terminate())) {
            (Ok(interrupt), Ok(terminate)) => Some(Self { interrupt, terminate }),
            (Err(e), _) | (_, Err(e)) => {
                console.warning(&format!("signals cannot be caught, an interrupted render will keep nothing: {e}"));
                None
            }
        }
    }

    async fn next(&mut self) {
        tokio::select! {
            _ = self.interrupt.recv() => {}
            _ = self.terminate.recv() => {}
        }
    }
}

#[cfg(not(unix))]
struct Signals;

#[cfg(not(unix))]
impl Signals {
    fn new(_: &Console) -> Option<Self> {
        Some(Self)
    }

    async fn next(&mut self) {
        if tokio::signal::ctrl_c().await.is_err() {
            std::future::pending().await
        }
    }
}
