//! Knocks at a guarded farm with wrong tokens: what that costs the farm is seen on the farm's side.
//!
//! `flood 127.0.0.1:4747 10000` makes so many attempts, 64 at a time, and says what became of them.

use std::net::SocketAddr;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use clap::Parser;
use tessera_proto::token::Secret;
use tessera_tests::hostile::{GREET, Raw, bearer};

/// Attempts at once.
const AT_ONCE: u64 = 64;

/// Knocks at a guarded farm with wrong tokens.
#[derive(Debug, Parser)]
struct Args {
    /// The farm's address.
    farm: SocketAddr,
    /// Attempts in all.
    attempts: u64,
}

#[tokio::main]
async fn main() -> ExitCode {
    let Args { farm, attempts } = Args::parse();
    let (left, refused) = (Arc::new(AtomicU64::new(attempts)), Arc::new(AtomicU64::new(0)));
    let began = Instant::now();
    let knock = |_| {
        let (left, refused) = (left.clone(), refused.clone());
        tokio::spawn(async move {
            while left.fetch_update(Ordering::SeqCst, Ordering::SeqCst, |n| n.checked_sub(1)).is_ok() {
                let (Ok(raw), Ok(wrong)) = (Raw::tls(farm).await, Secret::new()) else { continue };
                let answer = raw.call(GREET, &bearer(&wrong.reveal()), &[0; 5], true).await;
                refused.fetch_add(u64::from(answer.is_ok()), Ordering::SeqCst);
            }
        })
    };
    for task in (0..AT_ONCE).map(knock).collect::<Vec<_>>() {
        if task.await.is_err() {
            return ExitCode::FAILURE;
        }
    }
    let refused = refused.load(Ordering::SeqCst);
    let seconds = began.elapsed().as_secs_f64();
    println!("{attempts} attempts in {seconds:.1} s: {refused} refused by status, {} cut off", attempts - refused);
    ExitCode::SUCCESS
}
