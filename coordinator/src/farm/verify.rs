//! Tiles rendered twice, and what that tells of those who rendered them.
//!
//! A tile's bytes depend on scene, settings and its pixels alone, so two workers that render it must agree to the
//! bit, estimates of error included. Of the tiles that are accepted, a share is drawn by a secret seed, and the
//! first few of every worker; another worker renders them again, or, where there is none, this process itself.
//! Where two disagree, this process decides. Nothing here says which lease is a check: to the worker it is one
//! like any other.

use std::collections::{BTreeMap, HashMap};
use std::time::Duration;

use sha2::{Digest, Sha256};
use tessera_core::film::{ErrorEstimate, Region};
use tessera_core::settings::Pass;
use tessera_proto::convert::Lease;
use tessera_proto::identity::WorkerId;
use tessera_proto::{Attempt, JobNumber, LeaseId, PassNumber};

use crate::journal::Kept;
use crate::scheduler::WorkerKey;

/// Leases of checks have this bit, which the scheduler's never reach.
const CHECK: u64 = 1 << 63;
/// Checks that one worker has at once, at most.
const AT_ONCE: usize = 16;
/// A check is given to somebody else after this time, and so many times what it took its maker: whoever has it has
/// other things to do, but may as well do nothing,
const OVERDUE: (Duration, u32) = (Duration::from_secs(10), 64);
/// and after so many times when there is nothing else to do.
const OVERDUE_AT_THE_END: u32 = 3;
/// The first tiles of every worker that are checked whatever is drawn.
const FIRST: u32 = 2;

/// What a delivery comes down to.
pub(crate) type Sum = [u8; 32];

/// The sum of what a worker delivered.
pub(crate) fn sum_of(pixels: &[u8], error: &ErrorEstimate) -> Sum {
    let ErrorEstimate { pixels: rendered, expected, audited, squares, variance } = *error;
    let mut sum = Sha256::new();
    sum.update(pixels);
    for part in [rendered, audited] {
        sum.update(part.to_le_bytes());
    }
    for part in [expected, squares, variance] {
        sum.update(part.0.to_le_bytes());
    }
    sum.finalize().into()
}

/// A tile of the pass at hand, or one that is in the picture from an earlier pass.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Made {
    pub(crate) region: Region,
    pub(crate) maker: WorkerId,
    pub(crate) error: ErrorEstimate,
    pub(crate) verified: bool,
}

/// A tile that is to be rendered again.
#[derive(Debug)]
struct Check {
    region: Region,
    maker: WorkerId,
    sum: Sum,
    pass: Option<Pass>,
    /// How long it took its maker.
    busy: Duration,
    checker: Option<Entrusted>,
    /// Another result than the maker's, and whose it is.
    dispute: Option<(WorkerId, Sum)>,
    /// Those who could not.
    tried: Vec<WorkerId>,
}

/// Whom a check was given to, and when.
#[derive(Clone, Copy, Debug)]
struct Entrusted {
    worker: WorkerKey,
    id: WorkerId,
    since: Duration,
}

/// A check that came to its end.
#[derive(Clone, Debug)]
pub(crate) struct Closed {
    pub(crate) region: Region,
    pub(crate) maker: WorkerId,
    /// `None` is this process.
    pub(crate) checker: Option<WorkerId>,
    /// Those whose result was another than this process' own.
    pub(crate) liars: Vec<WorkerId>,
}

/// Who is to render a tile again.
#[derive(Debug)]
pub(crate) enum Assigned {
    To(WorkerKey, Lease),
    /// This process itself.
    Here {
        check: u64,
        region: Region,
        pass: Option<Pass>,
    },
    /// Nobody yet: whoever may has enough to do.
    Later,
}

/// See the [module](self).
#[derive(Debug)]
pub(crate) struct Verify {
    share: f64,
    seed: [u8; 32],
    drawn: u64,
    next: u64,
    open: BTreeMap<u64, Check>,
    /// How many checks each has.
    busy: HashMap<WorkerKey, usize>,
    delivered: HashMap<WorkerId, u32>,
    /// Whether the pass at hand only looks.
    looks: bool,
    /// Of the pass at hand.
    made: Vec<Made>,
    /// Of passes before, as far as they are in the picture.
    before: Vec<Made>,
}

impl Check {
    /// Whether `worker` renders it again.
    fn is_of(&self, worker: WorkerKey) -> bool {
        self.checker.is_some_and(|e| e.worker == worker)
    }
}

impl Verify {
    /// Draws that `share` of the tiles of `job`, 0 to 1.
    pub(crate) fn new(share: f64, seed: [u8; 32], job: JobNumber) -> Self {
        let (open, busy, delivered) = (BTreeMap::new(), HashMap::new(), HashMap::new());
        let (made, before) = (Vec::new(), Vec::new());
        let next = CHECK | job.lease(0).0;
        Self { share, seed, drawn: 0, next, open, busy, delivered, looks: false, made, before }
    }

    /// The share that is drawn.
    #[cfg(test)]
    pub(crate) fn share(&self) -> f64 {
        self.share
    }

    /// Whether anything is checked.
    pub(crate) fn is_on(&self) -> bool {
        self.share > 0.0
    }

    /// Whether checks are under way.
    pub(crate) fn is_waiting(&self) -> bool {
        !self.open.is_empty()
    }

    /// Whether an answer is to a check rather than to the scheduler's lease.
    pub(crate) fn is_check(lease: LeaseId) -> bool {
        lease.0 & CHECK != 0
    }

    /// A tile was accepted. Gives the check, if it is to be checked.
    pub(crate) fn accepted(&mut self, (made, sum): (Made, Sum), pass: Option<Pass>, busy: Duration) -> Option<u64> {
        self.made.push(made);
        self.begin((made, sum), pass, busy)
    }

    /// Goes on from an earlier run: with the tiles that it did of the pass at hand, and those of the pass before that
    /// is in the picture. Gives the checks.
    pub(crate) fn recover(&mut self, made: &[Kept], before: Option<&[Kept]>) -> Vec<u64> {
        let known = |kept: &Kept| {
            let made = kept.made?;
            let Kept { lease, error, .. } = *kept;
            Some((Made { region: lease.region, maker: made.maker, error, verified: made.confirmed }, made.sum))
        };
        if let Some(before) = before {
            self.before = before.iter().filter_map(known).map(|(made, _)| made).collect();
        }
        let mut checks = Vec::new();
        for kept in made {
            let Some((made, sum)) = known(kept) else { continue };
            self.made.push(made);
            if !made.verified {
                checks.extend(self.begin((made, sum), kept.lease.pass, Duration::ZERO));
            }
        }
        checks
    }

    /// Begins the check of a tile, if it is drawn. What a pass only looks at decides how all that comes is rendered:
    /// there everything is checked.
    fn begin(&mut self, (made, sum): (Made, Sum), pass: Option<Pass>, busy: Duration) -> Option<u64> {
        let Made { region, maker, .. } = made;
        let delivered = self.delivered.entry(maker).or_default();
        *delivered = delivered.saturating_add(1);
        if *delivered > FIRST && !self.looks && !self.draw() {
            return None;
        }
        let check = self.next;
        self.next += 1;
        let new = Check { region, maker, sum, pass, busy, checker: None, dispute: None, tried: Vec::new() };
        self.open.insert(check, new);
        Some(check)
    }

    /// Whether the next tile is drawn: nobody can tell beforehand.
    fn draw(&mut self) -> bool {
        self.drawn += 1;
        let drawn = Sha256::new().chain_update(self.seed).chain_update(self.drawn.to_le_bytes()).finalize();
        let number = drawn[..8].iter().fold(0u64, |n, &b| n << 8 | u64::from(b));
        (number as f64) < self.share * 2f64.powi(64)
    }

    /// Gives a check to one of `workers`, the least busy with checks, that did not make the tile; where there is none,
    /// to this process, if that may be now. `None` where the check is open no more.
    pub(crate) fn assign(
        &mut self,
        check: u64,
        workers: &[(WorkerKey, WorkerId)],
        here: bool,
        now: Duration,
    ) -> Option<Assigned> {
        let busy = |key: &WorkerKey| self.busy.get(key).copied().unwrap_or(0);
        let open = self.open.get(&check)?;
        let (region, pass) = (open.region, open.pass);
        let fit = |id: &WorkerId| open.dispute.is_none() && open.maker != *id && !open.tried.contains(id);
        let chosen = workers.iter().filter(|(_, id)| fit(id)).copied().min_by_key(|(key, _)| busy(key));
        Some(match chosen {
            None if here => Assigned::Here { check, region, pass },
            None => Assigned::Later,
            Some((worker, _)) if busy(&worker) >= AT_ONCE => Assigned::Later,
            Some((worker, id)) => {
                self.entrust(check, Some(Entrusted { worker, id, since: now }));
                let (id, attempt, number) = (LeaseId(check), Attempt(0), PassNumber(0));
                let lease = Lease { id, attempt, region, number, pass };
                Assigned::To(worker, lease)
            }
        })
    }

    /// Notes who renders a check's tile again.
    fn entrust(&mut self, check: u64, to: Option<Entrusted>) {
        let Some(open) = self.open.get_mut(&check) else { return };
        let before = std::mem::replace(&mut open.checker, to);
        if let Some(busy) = before.and_then(|before| self.busy.get_mut(&before.worker)) {
            *busy = busy.saturating_sub(1);
        }
        if let Some(to) = to {
            *self.busy.entry(to.worker).or_default() += 1;
        }
    }

    /// The region that `worker` renders again under `lease`; `None` where the answer comes too late.
    pub(crate) fn region_of(&self, worker: WorkerKey, lease: LeaseId) -> Option<Region> {
        self.open.get(&lease.0).filter(|c| c.is_of(worker)).map(|c| c.region)
    }

    /// A worker's result. Gives the end of the check where it agrees; else this process is to decide.
    pub(crate) fn answered(&mut self, lease: LeaseId, by: WorkerId, sum: Sum) -> Option<Closed> {
        self.entrust(lease.0, None);
        let check = self.open.get_mut(&lease.0)?;
        if sum != check.sum {
            check.dispute = Some((by, sum));
            return None;
        }
        self.close(lease.0, Some(by), Vec::new())
    }

    /// This process' own result; `None` where it has none, and nothing is decided.
    pub(crate) fn decided(&mut self, check: u64, sum: Option<Sum>) -> Option<Closed> {
        let open = self.open.get(&check)?;
        let mut liars = Vec::new();
        let by = open.dispute.map(|(by, _)| by);
        if let Some(sum) = sum {
            liars.extend((sum != open.sum).then_some(open.maker));
            liars.extend(open.dispute.filter(|(_, theirs)| *theirs != sum).map(|(by, _)| by));
        } else {
            self.entrust(check, None);
            self.open.remove(&check);
            return None;
        }
        self.close(check, by, liars)
    }

    fn close(&mut self, check: u64, checker: Option<WorkerId>, liars: Vec<WorkerId>) -> Option<Closed> {
        self.entrust(check, None);
        let Check { region, maker, .. } = self.open.remove(&check)?;
        if !liars.contains(&maker)
            && let Some(made) = self.made.iter_mut().rev().find(|m| m.region == region && m.maker == maker)
        {
            made.verified = true;
        }
        Some(Closed { region, maker, checker, liars })
    }

    /// A worker that could not, or left: its checks, to be given to others.
    pub(crate) fn left(&mut self, worker: WorkerKey, id: WorkerId) -> Vec<u64> {
        let its: Vec<u64> = self.open.iter().filter(|(_, c)| c.is_of(worker)).map(|(&k, _)| k).collect();
        for &check in &its {
            self.failed(LeaseId(check), id);
        }
        self.busy.remove(&worker);
        its
    }

    /// Checks whose checkers get nowhere, to be given to others. `at_end`: all else is done.
    pub(crate) fn overdue(&mut self, now: Duration, at_end: bool) -> Vec<u64> {
        let times = if at_end { OVERDUE_AT_THE_END } else { OVERDUE.1 };
        let is_late = |c: &Check| {
            let most = OVERDUE.0.saturating_add(c.busy.saturating_mul(times));
            c.checker.filter(|e| now.saturating_sub(e.since) > most)
        };
        let late: Vec<_> = self.open.iter().filter_map(|(&k, c)| Some((k, is_late(c)?.id))).collect();
        for &(check, id) in &late {
            self.failed(LeaseId(check), id);
        }
        late.into_iter().map(|(check, _)| check).collect()
    }

    /// One check that its checker did not render.
    pub(crate) fn failed(&mut self, lease: LeaseId, by: WorkerId) {
        self.entrust(lease.0, None);
        if let Some(check) = self.open.get_mut(&lease.0) {
            check.tried.push(by);
        }
    }

    /// Takes back all that `liar` made and nobody has confirmed: of the pass at hand, and of those before.
    pub(crate) fn take_back(&mut self, liar: WorkerId) -> (Vec<Made>, Vec<Made>) {
        let of_liar: Vec<u64> = self.open.iter().filter(|(_, c)| c.maker == liar).map(|(&k, _)| k).collect();
        for check in of_liar {
            self.entrust(check, None);
            self.open.remove(&check);
        }
        let its = |m: &Made| m.maker == liar && !m.verified;
        let take = |from: &mut Vec<Made>| {
            let taken = from.iter().copied().filter(its).collect();
            from.retain(|m| !its(m));
            taken
        };
        (take(&mut self.made), take(&mut self.before))
    }

    /// Estimated error of all that is left of the pass at hand.
    pub(crate) fn error(&self) -> ErrorEstimate {
        let mut sum = ErrorEstimate::default();
        self.made.iter().for_each(|m| sum += m.error);
        sum
    }

    /// What kind of pass is at hand.
    pub(crate) fn looks(&mut self, looks: bool) {
        self.looks = looks;
    }

    /// A pass begins; what the last one made is in the picture if it was `kept`.
    pub(crate) fn next_pass(&mut self, kept: bool) {
        let made = std::mem::take(&mut self.made);
        if kept {
            self.before = made;
        }
    }
}

#[cfg(test)]
mod tests;
