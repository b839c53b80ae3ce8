//! Who comes in.

use std::collections::BTreeSet;
use std::sync::PoisonError;

use tessera_proto::SessionId;
use tessera_proto::token::{NoRandomness, random};
use tessera_proto::wire::coordinator_message::Kind;
use tessera_proto::wire::{CoordinatorMessage, Welcome};
use tokio::time::Instant;
use tonic::Status;

use super::{Dispatcher, FARM, Session};
use crate::farm::guard::for_good;
use crate::farm::roster::Entered;
use crate::farm::service::{Joined, Visitor};
use crate::progress::WorkerStats;
use crate::scheduler::WorkerKey;

impl Dispatcher {
    pub(super) async fn admit(&mut self, joined: Joined) {
        let Joined { registration, local, address, last_sign, outbox, cut, reply } = joined;
        if reply.is_closed() {
            // It has given up waiting for an answer.
            return;
        }
        let id = registration.id;
        if let Some(rule) = self.roster.banned(id) {
            let _ = reply.send(Err(for_good(Status::permission_denied(format!("cut off before: {rule}")))));
            return;
        }
        let before = self.sessions.iter().find(|(_, session)| session.id == id).map(|(&worker, _)| worker);
        if let Some(before) = before {
            self.left(before, "it dialled again").await;
        }
        let room = self.shared.gate.workers();
        if self.sessions.len() >= room {
            let full = format!("there is room for {room} workers here, by the limit of open files (ulimit -n)");
            let _ = reply.send(Err(Status::resource_exhausted(full)));
            return;
        }
        let worker = WorkerKey(self.next_worker);
        self.next_worker += 1;
        // Whoever names a session speaks for it: not to be guessed.
        let session_id = match random() {
            Ok(bytes) => SessionId(u64::from_be_bytes(bytes)),
            Err(e @ NoRandomness) => {
                let _ = reply.send(Err(Status::internal(e.to_string())));
                return;
            }
        };
        let threads = registration.threads;
        // Names like those of this process' own are theirs alone.
        let name = registration.name;
        let name = if !local && name.starts_with("local-") { format!("{name} (remote)") } else { name };
        let came = WorkerStats { name, threads, address: address.clone(), ..WorkerStats::default() };
        let Entered { instance, place, name, back } = self.roster.enter(id, came, &mut self.figures);
        let welcome = Welcome {
            session: session_id.0,
            name: name.clone(),
            heartbeat_interval_ms: self.timing.beat.as_millis() as u32,
            suspect_after_ms: self.timing.suspect_after.as_millis() as u32,
            dead_after_ms: self.timing.dead_after.as_millis() as u32,
        };
        let sessions = &self.shared.sessions;
        sessions.lock().unwrap_or_else(PoisonError::into_inner).insert(session_id, Visitor::new(last_sign.clone()));
        let heard_of = outbox.try_send(Ok(CoordinatorMessage { kind: Some(Kind::Welcome(welcome)) })).is_ok();
        let felt = (last_sign.last(), Instant::now());
        let session = Session {
            session_id,
            outbox,
            cut,
            id,
            instance,
            name: name.clone(),
            address,
            threads,
            own: local,
            last_sign,
            felt,
            draining: false,
            retired: false,
            job: None,
            told: false,
            unable: BTreeSet::new(),
            place,
            lost: 0,
        };
        self.sessions.insert(worker, session);
        if reply.send(Ok((worker, session_id))).is_err() || !heard_of {
            return self.left(worker, "it left while registering").await;
        }
        let verb = if back { "is back" } else { "joined" };
        match (local, threads) {
            (true, _) => tracing::debug!("{name} {verb}"),
            (false, 1) => tracing::info!(target: FARM, "{name} {verb} with 1 thread"),
            (false, n) => tracing::info!(target: FARM, "{name} {verb} with {n} threads"),
        }
        self.share().await;
    }
}
