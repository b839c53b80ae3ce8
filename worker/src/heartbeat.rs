//! The heartbeat: a task of its own, so that nothing else delays it.

use std::time::Duration;

use tessera_proto::SessionId;
use tessera_proto::wire::BeatRequest;
use tokio::time::{MissedTickBehavior, interval, timeout};

use crate::session::Client;

/// Beats every `every` until the coordinator no longer answers for `patience`, and says why it
/// stopped.
pub(crate) async fn beat(mut client: Client, session: SessionId, every: Duration, patience: Duration) -> String {
    let mut ticks = interval(every);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        ticks.tick().await;
        match timeout(patience, client.beat(BeatRequest { session: session.0 })).await {
            Ok(Ok(_)) => {}
            Ok(Err(status)) => return format!("the heartbeat failed: {}", crate::session::says(&status)),
            Err(_) => return format!("the coordinator has not answered for {} s", patience.as_secs_f32()),
        }
    }
}
