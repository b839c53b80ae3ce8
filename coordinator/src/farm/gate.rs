//! How many connections there are, whose, and how long each may stay without working for the farm.
//!
//! A connection is *pending* until it has done something that only workers do: registered, or beaten for a
//! session. Pending ones are few, of one address fewer, and the oldest makes room for the next: a worker needs
//! a moment to register, so that neither silent connections nor slow ones keep it out, and all that pending
//! ones may take together leaves room for the workers.

use std::collections::VecDeque;
use std::net::IpAddr;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use tessera_proto::identity::Challenge;
use tessera_proto::limits::REGISTER_WITHIN;
use tokio::time::{Instant, sleep_until};
use tokio_util::sync::CancellationToken;

use crate::open_files;

/// Pending connections at once, at most.
const PENDING: usize = 256;
/// Of those, of one address.
const PENDING_OF_ONE: usize = 64;
/// How long a connection that has beaten may go on without another beat or session.
const IDLE: Duration = Duration::from_secs(10);
/// Files that are open beside connections: scene, pictures, logs, the runtime's own.
const OTHER_FILES: usize = 64;

/// See the [module](self).
#[derive(Debug)]
pub(super) struct Gate {
    /// Connections at once.
    most: usize,
    open: AtomicUsize,
    next: AtomicU64,
    pending: Mutex<VecDeque<Arc<Connection>>>,
}

/// One connection, as all its calls see it.
#[derive(Debug)]
pub(super) struct Connection {
    id: u64,
    address: IpAddr,
    /// Ends it.
    pub(super) cut: CancellationToken,
    /// Whether it has shown the secret, so that it need not again after a renewal.
    pub(super) known: AtomicBool,
    /// The same of the users' secret.
    pub(super) known_user: AtomicBool,
    settled: AtomicBool,
    in_session: AtomicBool,
    last_beat: Mutex<Option<Instant>>,
    challenge: Mutex<Option<Challenge>>,
}

/// Holds the one session of a connection.
#[derive(Debug)]
pub(super) struct InSession(Arc<Connection>);

impl Drop for InSession {
    fn drop(&mut self) {
        self.0.in_session.store(false, Ordering::Release);
    }
}

impl Gate {
    /// For as many connections as this process may have open files.
    pub(super) fn new() -> Arc<Self> {
        Self::of(open_files::limit().saturating_sub(OTHER_FILES).clamp(2 * PENDING_OF_ONE, 100_000))
    }

    fn of(most: usize) -> Arc<Self> {
        Arc::new(Self { most, open: AtomicUsize::new(0), next: AtomicU64::new(0), pending: Mutex::default() })
    }

    /// Workers that there is room for, of two connections each, with what must stay free for those who come.
    pub(super) fn workers(&self) -> usize {
        (self.most - PENDING.min(self.most / 4)) / 2
    }

    /// Takes a connection, and watches that it registers in time; `None` where there is no room for it.
    pub(super) fn enter(self: &Arc<Self>, address: IpAddr) -> Option<Arc<Connection>> {
        let address = prefix(address);
        let mut pending = self.pending.lock().unwrap_or_else(PoisonError::into_inner);
        let of_one = pending.iter().filter(|c| c.address == address).count();
        let full = self.open.load(Ordering::Acquire) >= self.most;
        // Workers of this process come all at once.
        let share = if address.is_loopback() { PENDING } else { PENDING_OF_ONE };
        let place = if of_one >= share {
            pending.iter().position(|c| c.address == address)
        } else if full || pending.len() >= PENDING.min(self.most / 4) {
            Some(0)
        } else {
            None
        };
        let evicted = place.and_then(|place| pending.remove(place));
        if let Some(evicted) = &evicted {
            evicted.cut.cancel();
        }
        if full && evicted.is_none() {
            return None;
        }
        let connection = Arc::new(Connection {
            id: self.next.fetch_add(1, Ordering::Relaxed),
            address,
            cut: CancellationToken::new(),
            known: AtomicBool::new(false),
            known_user: AtomicBool::new(false),
            settled: AtomicBool::new(false),
            in_session: AtomicBool::new(false),
            last_beat: Mutex::new(None),
            challenge: Mutex::new(None),
        });
        pending.push_back(connection.clone());
        self.open.fetch_add(1, Ordering::AcqRel);
        tokio::spawn(watch(connection.clone()));
        Some(connection)
    }

    /// A connection that worked for the farm is pending no more.
    pub(super) fn settle(&self, connection: &Connection) {
        if !connection.settled.swap(true, Ordering::AcqRel) {
            self.forget(connection);
        }
    }

    /// A connection ended.
    pub(super) fn left(&self, connection: &Connection) {
        connection.cut.cancel();
        self.forget(connection);
        self.open.fetch_sub(1, Ordering::AcqRel);
    }

    fn forget(&self, connection: &Connection) {
        self.pending.lock().unwrap_or_else(PoisonError::into_inner).retain(|c| c.id != connection.id);
    }
}

impl Connection {
    /// Begins the connection's session; `None` where it has one.
    pub(super) fn begin(self: &Arc<Self>) -> Option<InSession> {
        let free = !self.in_session.swap(true, Ordering::AcqRel);
        free.then(|| InSession(self.clone()))
    }

    /// A sign of life for a session, of this connection or another of the same worker.
    pub(super) fn beaten(&self) {
        *self.last_beat.lock().unwrap_or_else(PoisonError::into_inner) = Some(Instant::now());
    }

    /// Keeps what was asked of this connection.
    pub(super) fn ask(&self, challenge: Challenge) {
        *self.challenge.lock().unwrap_or_else(PoisonError::into_inner) = Some(challenge);
    }

    /// What was asked of this connection, once.
    pub(super) fn asked(&self) -> Option<Challenge> {
        self.challenge.lock().unwrap_or_else(PoisonError::into_inner).take()
    }
}

/// Ends a connection that does not work for the farm.
async fn watch(connection: Arc<Connection>) {
    loop {
        let deadline = Instant::now() + REGISTER_WITHIN;
        tokio::select! {
            () = sleep_until(deadline) => {}
            () = connection.cut.cancelled() => return,
        }
        let beat = *connection.last_beat.lock().unwrap_or_else(PoisonError::into_inner);
        let alive = beat.is_some_and(|at| at.elapsed() < IDLE);
        if !alive && !connection.in_session.load(Ordering::Acquire) {
            connection.cut.cancel();
        }
    }
}

/// What counts as one address: of IPv6, the network that one host has to itself.
pub(crate) fn prefix(address: IpAddr) -> IpAddr {
    match address.to_canonical() {
        IpAddr::V6(v6) => IpAddr::V6((u128::from(v6) & !u128::from(u64::MAX)).into()),
        v4 => v4,
    }
}

#[cfg(test)]
mod tests {
    use std::net::Ipv4Addr;

    use super::*;

    fn address(n: u8) -> IpAddr {
        Ipv4Addr::new(10, 0, 0, n).into()
    }

    #[tokio::test]
    async fn one_address_pushes_out_its_own_connections_alone() {
        let gate = Gate::of(1000);
        let other = gate.enter(address(1)).unwrap();
        let many: Vec<_> = (0..500).map(|_| gate.enter(address(2)).unwrap()).collect();
        assert!(!other.cut.is_cancelled());
        let left = many.iter().filter(|c| !c.cut.is_cancelled()).count();
        assert_eq!(left, PENDING_OF_ONE);
        assert!(!many[499].cut.is_cancelled(), "the newest stays");
    }

    #[tokio::test]
    async fn many_addresses_leave_the_workers_their_room() {
        let gate = Gate::of(1000);
        let worker = gate.enter(address(0)).unwrap();
        gate.settle(&worker);
        for round in 0..10 {
            for n in 1..200 {
                let stranger = gate.enter(address(n)).unwrap();
                assert!(!stranger.cut.is_cancelled(), "round {round}");
            }
        }
        assert!(!worker.cut.is_cancelled(), "who works is not pushed out");
        assert!(gate.pending.lock().unwrap().len() <= PENDING);
    }

    #[tokio::test]
    async fn a_full_farm_takes_nobody_and_pushes_out_no_worker() {
        let gate = Gate::of(8);
        let worker = |n| {
            let worker = gate.enter(address(n)).unwrap();
            gate.settle(&worker);
            worker
        };
        let workers: Vec<_> = (0..8).map(worker).collect();
        assert!(gate.enter(address(9)).is_none());
        gate.left(&workers[0]);
        assert!(gate.enter(address(9)).is_some());
        assert!(workers[1..].iter().all(|w| !w.cut.is_cancelled()));
    }

    #[tokio::test]
    async fn a_connection_has_one_session_at_a_time() {
        let worker = Gate::of(100).enter(address(2)).unwrap();
        let session = worker.begin().unwrap();
        assert!(worker.begin().is_none());
        drop(session);
        assert!(worker.begin().is_some());
    }

    #[test]
    fn a_host_of_many_addresses_counts_once() {
        let v6 = |text: &str| prefix(text.parse().unwrap());
        assert_eq!(v6("2001:db8::1"), v6("2001:db8::ffff:2"));
        assert_ne!(v6("2001:db8::1"), v6("2001:db8:0:1::1"));
        assert_eq!(v6("::ffff:10.0.0.1"), address(1));
    }
}
