//! The end of a render, as workers hear of it.

use std::time::Duration;

use tessera_proto::wire::coordinator_message::Kind;
use tessera_proto::wire::{CoordinatorMessage, Finished};
use tokio::time::{Instant, timeout_at};
use tonic::Status;

use super::Driver;
use crate::farm::service::Heard;
use crate::scheduler::WorkerKey;

/// How long workers are given to hear that the render is over.
const GOODBYE_WITHIN: Duration = Duration::from_millis(250);

impl Driver {
    /// Tells everyone that there is no more work, and waits a little for them to hear it.
    pub(super) async fn dismiss(&mut self) {
        self.seats.retain(|_, seat| {
            let bye = CoordinatorMessage { kind: Some(Kind::Finished(Finished {})) };
            seat.mouth.try_send(Ok(bye)).is_ok()
        });
        let mut waiting: Vec<WorkerKey> = self.seats.keys().copied().collect();
        // A worker leaves when it has heard; its stream must stay open until then.
        // Nobody waits for tiles that come too late.
        let deadline = Instant::now() + if self.passes.timed_out { Duration::from_millis(10) } else { GOODBYE_WITHIN };
        while !waiting.is_empty() {
            match timeout_at(deadline, self.heard.recv()).await {
                Ok(Some(Heard::Left { worker, .. })) => waiting.retain(|w| *w != worker),
                Ok(Some(Heard::Joined(late))) => {
                    let _ = late.reply.send(Err(Status::unavailable("the render is over")));
                }
                Ok(Some(Heard::Said { .. } | Heard::Decided { .. })) => {}
                Ok(None) | Err(_) => break,
            }
        }
        for seat in self.seats.values() {
            seat.cut.cancel();
        }
    }
}
