//! Ctrl-C, SIGTERM, SIGHUP and SIGQUIT: the first stops, the second leaves at once, but while a picture is being
//! written only SIGQUIT does.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;
#[cfg(unix)]
use std::task::Poll;

use tokio_util::sync::CancellationToken;

use super::console::Console;
use super::exit::Exit;

/// Whether a picture is being written.
static WRITING: AtomicBool = AtomicBool::new(false);

/// While this lives, signals do not end the program at once: what is being written would be lost.
pub(crate) struct Writing(());

impl Writing {
    pub(crate) fn begin() -> Self {
        WRITING.store(true, Ordering::Release);
        Self(())
    }
}

impl Drop for Writing {
    fn drop(&mut self) {
        WRITING.store(false, Ordering::Release);
    }
}

/// A token that the first signal cancels. Signals are listened to on a thread of their own, whatever else may be
/// occupied.
pub(crate) fn stop_on_signal(console: &Console) -> CancellationToken {
    let token = CancellationToken::new();
    let (stop, console) = (token.clone(), console.clone());
    let (ready, listening) = mpsc::channel();
    let listen = move || {
        let Ok(runtime) = tokio::runtime::Builder::new_current_thread().enable_all().build() else { return };
        runtime.block_on(async {
            let signals = Signals::new(&console);
            let _ = ready.send(());
            if let Some(mut signals) = signals {
                leave(&mut signals, &stop, &console).await;
            }
        });
    };
    if std::thread::Builder::new().name("signals".into()).spawn(listen).is_ok() {
        // Until then a signal would end the program as if nobody listened.
        let _ = listening.recv();
    }
    token
}

async fn leave(signals: &mut Signals, stop: &CancellationToken, console: &Console) {
    let (mut stopping, mut told) = (false, false);
    loop {
        let quit = signals.next().await;
        if WRITING.load(Ordering::Acquire) && !quit {
            if !std::mem::replace(&mut told, true) {
                console.say("the picture is being written; SIGQUIT (Ctrl-\\) leaves without it");
            }
        } else if !std::mem::replace(&mut stopping, true) {
            console.say("stopping, and keeping what is done; once more leaves at once");
        } else {
            // Nothing is dropped by what follows.
            tessera_core::film::file::remove_temporaries();
            std::process::exit(Exit::Interrupted as i32);
        }
        stop.cancel();
    }
}

/// SIGQUIT, and what else is listened to.
#[cfg(unix)]
struct Signals(Vec<tokio::signal::unix::Signal>);

#[cfg(unix)]
impl Signals {
    fn new(console: &Console) -> Option<Self> {
        use tokio::signal::unix::{SignalKind, signal};
        let mut kinds = vec![SignalKind::quit(), SignalKind::interrupt(), SignalKind::terminate()];
        // Of nohup: a closed terminal is to end nothing.
        if !ignored(SignalKind::hangup().as_raw_value()) {
            kinds.push(SignalKind::hangup());
        }
        match kinds.into_iter().map(signal).collect() {
            Ok(signals) => Some(Self(signals)),
            Err(e) => {
                console.warning(&format!("signals cannot be caught, an interrupted render will keep nothing: {e}"));
                None
            }
        }
    }

    /// Waits for the next signal; gives whether it is SIGQUIT.
    async fn next(&mut self) -> bool {
        std::future::poll_fn(|cx| {
            let met = self.0.iter_mut().position(|signal| signal.poll_recv(cx).is_ready());
            met.map_or(Poll::Pending, |place| Poll::Ready(place == 0))
        })
        .await
    }
}

/// Whether whoever started this program had it ignore a signal. Where the system does not tell, it is not.
#[cfg(unix)]
fn ignored(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0);
    mask >> (signal - 1) & 1 == 1
}

#[cfg(not(unix))]
struct Signals;

#[cfg(not(unix))]
impl Signals {
    fn new(_: &Console) -> Option<Self> {
        Some(Self)
    }

    async fn next(&mut self) -> bool {
        if tokio::signal::ctrl_c().await.is_err() {
            std::future::pending().await
        }
        false
    }
}
