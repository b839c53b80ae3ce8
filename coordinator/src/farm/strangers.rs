//! Who came with a wrong secret, how often, and what that costs them.
//!
//! A secret has 128 bits, so guessing is hopeless; what it must not do is take time from a render. Each wrong
//! secret of an address makes the next answer to it later, and its handshakes, which are what costs, come one
//! after another.

use std::collections::HashMap;
use std::net::IpAddr;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use tokio::time::Instant;

use super::gate::prefix;

/// How late the first wrong secret is answered; each further one twice as late, up to the last.
const FIRST: Duration = Duration::from_millis(100);
const LAST: Duration = Duration::from_secs(3);
/// Between two handshakes of an address that had a wrong secret.
const PACE: Duration = Duration::from_millis(20);
/// Nobody waits longer than this for a handshake: more are refused.
const QUEUE: Duration = Duration::from_secs(2);
/// After so long without another one, wrong secrets are forgotten.
const FORGOTTEN: Duration = Duration::from_secs(60);
/// Addresses remembered, at most.
const ADDRESSES: usize = 4096;
/// Between two lines about it in the log.
const SAID_EVERY: Duration = Duration::from_secs(10);

/// Who came without the right secret, and how often: they are answered later and later.
#[derive(Debug, Default)]
pub struct Strangers(Mutex<Inner>);

#[derive(Debug, Default)]
struct Inner {
    by: HashMap<IpAddr, Failures>,
    total: u64,
    said: Option<Instant>,
    /// Of `total`, what was said.
    said_of: u64,
}

#[derive(Clone, Copy, Debug)]
struct Failures {
    count: u32,
    last: Instant,
    /// When its next handshake may begin.
    next: Instant,
}

impl Strangers {
    /// A wrong secret came from `address`. Gives how long to wait before saying so.
    pub(crate) fn failed(&self, address: IpAddr) -> Duration {
        self.failed_at(address, Instant::now())
    }

    fn failed_at(&self, address: IpAddr, now: Instant) -> Duration {
        let mut inner = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        inner.total += 1;
        if inner.said.is_none_or(|said| now - said >= SAID_EVERY) {
            let more = inner.total - inner.said_of;
            let s = if more == 1 { "" } else { "s" };
            tracing::warn!("refused {more} call{s} without the farm's token, the last from {address}");
            (inner.said, inner.said_of) = (Some(now), inner.total);
        }
        if inner.by.len() >= ADDRESSES {
            inner.by.retain(|_, f| now - f.last < FORGOTTEN);
        }
        if inner.by.len() >= ADDRESSES {
            // So many at once are no mistake of one user.
            return LAST;
        }
        let f = inner.by.entry(prefix(address)).or_insert(Failures { count: 0, last: now, next: now });
        f.count = if now - f.last >= FORGOTTEN { 1 } else { f.count.saturating_add(1) };
        f.last = now;
        FIRST.saturating_mul(1 << (f.count - 1).min(10)).min(LAST)
    }

    /// When the next handshake of `address` may begin; `None` where too many wait for theirs.
    pub(crate) fn turn(&self, address: IpAddr) -> Option<Instant> {
        self.turn_at(address, Instant::now())
    }

    fn turn_at(&self, address: IpAddr, now: Instant) -> Option<Instant> {
        let mut inner = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(f) = inner.by.get_mut(&prefix(address)).filter(|f| now - f.last < FORGOTTEN) else {
            return Some(now);
        };
        let turn = f.next.max(now);
        if turn - now > QUEUE {
            return None;
        }
        f.next = turn + PACE;
        Some(turn)
    }

    /// How many came in all.
    pub(crate) fn total(&self) -> u64 {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).total
    }
}

#[cfg(test)]
mod tests {
    use std::net::Ipv4Addr;

    use super::*;

    #[test]
    fn wrong_secrets_are_answered_later_and_later_and_forgotten() {
        let strangers = Strangers::default();
        let (one, other) = (Ipv4Addr::new(10, 0, 0, 1).into(), Ipv4Addr::new(10, 0, 0, 2).into());
        let now = Instant::now();
        let waits: Vec<_> = (0..12).map(|_| strangers.failed_at(one, now)).collect();
        assert!(waits.is_sorted() && waits[0] == FIRST && waits[11] == LAST, "{waits:?}");
        assert_eq!(strangers.failed_at(other, now), FIRST, "others pay nothing for it");
        assert_eq!(strangers.failed_at(one, now + FORGOTTEN), FIRST);
        assert_eq!(strangers.total(), 14);
    }

    #[test]
    fn handshakes_of_a_stranger_come_one_after_another_and_not_without_end() {
        let strangers = Strangers::default();
        let (one, other) = (Ipv4Addr::new(10, 0, 0, 1).into(), Ipv4Addr::new(10, 0, 0, 2).into());
        let now = Instant::now();
        assert_eq!(strangers.turn_at(one, now), Some(now));
        strangers.failed_at(one, now);
        let turns: Vec<_> = (0..1000).map_while(|_| strangers.turn_at(one, now)).collect();
        assert!(turns.windows(2).all(|w| w[1] - w[0] == PACE));
        assert_eq!(turns.len() as u128, 1 + QUEUE.as_millis() / PACE.as_millis());
        assert_eq!(strangers.turn_at(other, now), Some(now));
    }
}
