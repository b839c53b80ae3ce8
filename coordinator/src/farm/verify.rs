//! Tiles rendered twice, and what that tells of those who rendered them.
//!
//! A tile's bytes depend on scene, settings and its pixels alone, so two workers that render it must agree to the
//! bit, estimates of error included. Of the tiles that are accepted, a share is drawn by a secret seed, and the
//! first few of every worker; another worker renders them again, or, where there is none, this process itself.
//! Where two disagree, this process decides. Nothing here says which lease is a check: to the worker it is one
//! like any other.

use std::collections::{BTreeMap, HashMap};

use sha2::{Digest, Sha256};
use tessera_core::film::{ErrorEstimate, Region};
use tessera_core::settings::Pass;
use tessera_proto::convert::{Lease, TileDone};
use tessera_proto::identity::WorkerId;
use tessera_proto::{Attempt, JobNumber, LeaseId, PassNumber};

use crate::scheduler::WorkerKey;

/// Leases of checks have this bit, which the scheduler's never reach.
const CHECK: u64 = 1 << 63;
/// The first tiles of every worker that are checked whatever is drawn.
const FIRST: u32 = 2;

/// What a delivery comes down to.
pub(super) type Sum = [u8; 32];

/// The sum of what a worker delivered.
pub(super) fn sum_of(pixels: &[u8], error: &ErrorEstimate) -> Sum {
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
pub(super) struct Made {
    pub(super) region: Region,
    pub(super) maker: WorkerId,
    pub(super) error: ErrorEstimate,
    verified: bool,
}

/// A tile that is to be rendered again.
#[derive(Debug)]
struct Check {
    region: Region,
    maker: WorkerId,
    sum: Sum,
    pass: Option<Pass>,
    checker: Option<WorkerKey>,
    /// Another result than the maker's, and whose it is.
    dispute: Option<(WorkerId, Sum)>,
    /// Those who could not.
    tried: Vec<WorkerId>,
}

/// A check that came to its end.
#[derive(Clone, Debug)]
pub(super) struct Closed {
    pub(super) region: Region,
    pub(super) maker: WorkerId,
    /// `None` is this process.
    pub(super) checker: Option<WorkerId>,
    /// Those whose result was another than this process' own.
    pub(super) liars: Vec<WorkerId>,
}

/// Who is to render a tile again.
#[derive(Debug)]
pub(super) enum Assigned {
    To(WorkerKey, Lease),
    /// This process itself.
    Here {
        check: u64,
        region: Region,
        pass: Option<Pass>,
    },
}

/// See the [module](self).
#[derive(Debug)]
pub(super) struct Verify {
    share: f64,
    seed: [u8; 32],
    drawn: u64,
    next: u64,
    open: BTreeMap<u64, Check>,
    delivered: HashMap<WorkerId, u32>,
    /// Of the pass at hand.
    made: Vec<Made>,
    /// Of passes before, as far as they are in the picture.
    before: Vec<Made>,
}

impl Verify {
    /// Draws that `share` of the tiles of `job`, 0 to 1.
    pub(super) fn new(share: f64, seed: [u8; 32], job: JobNumber) -> Self {
        let (open, delivered) = (BTreeMap::new(), HashMap::new());
        Self {
            share,
            seed,
            drawn: 0,
            next: CHECK | job.lease(0).0,
            open,
            delivered,
            made: Vec::new(),
            before: Vec::new(),
        }
    }

    /// Whether anything is checked.
    pub(super) fn is_on(&self) -> bool {
        self.share > 0.0
    }

    /// Whether checks are under way.
    pub(super) fn is_waiting(&self) -> bool {
        !self.open.is_empty()
    }

    /// Whether an answer is to a check rather than to the scheduler's lease.
    pub(super) fn is_check(lease: LeaseId) -> bool {
        lease.0 & CHECK != 0
    }

    /// A tile was accepted. Gives the check, if it is to be checked.
    pub(super) fn accepted(
        &mut self,
        maker: WorkerId,
        region: Region,
        pass: Option<Pass>,
        done: &TileDone,
    ) -> Option<u64> {
        if !self.is_on() {
            return None;
        }
        self.made.push(Made { region, maker, error: done.error, verified: false });
        let delivered = self.delivered.entry(maker).or_default();
        *delivered = delivered.saturating_add(1);
        if *delivered > FIRST && !self.draw() {
            return None;
        }
        let check = self.next;
        self.next += 1;
        let sum = sum_of(&done.pixels, &done.error);
        let new = Check { region, maker, sum, pass, checker: None, dispute: None, tried: Vec::new() };
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

    /// Gives a check to one of `workers`, the least busy with checks, that did not make the tile; or to this
    /// process.
    pub(super) fn assign(&mut self, check: u64, workers: &[(WorkerKey, WorkerId)]) -> Option<Assigned> {
        let busy = |key: &WorkerKey| self.open.values().filter(|c| c.checker == Some(*key)).count();
        let (region, pass, disputed) = {
            let c = self.open.get(&check)?;
            (c.region, c.pass, c.dispute.is_some())
        };
        let fit = |id: &WorkerId| self.open.get(&check).is_some_and(|c| c.maker != *id && !c.tried.contains(id));
        let chosen = workers.iter().filter(|(_, id)| !disputed && fit(id)).min_by_key(|(key, _)| busy(key));
        let chosen = chosen.map(|(key, _)| *key);
        let open = self.open.get_mut(&check)?;
        open.checker = chosen;
        Some(match chosen {
            None => Assigned::Here { check, region, pass },
            Some(worker) => {
                let (id, attempt, number) = (LeaseId(check), Attempt(0), PassNumber(0));
                let lease = Lease { id, attempt, region, number, pass };
                Assigned::To(worker, lease)
            }
        })
    }

    /// The region that `worker` renders again under `lease`; `None` where the answer comes too late.
    pub(super) fn region_of(&self, worker: WorkerKey, lease: LeaseId) -> Option<Region> {
        self.open.get(&lease.0).filter(|c| c.checker == Some(worker)).map(|c| c.region)
    }

    /// A worker's result. Gives the end of the check where it agrees; else this process is to decide.
    pub(super) fn answered(&mut self, lease: LeaseId, by: WorkerId, sum: Sum) -> Option<Closed> {
        let check = self.open.get_mut(&lease.0)?;
        check.checker = None;
        if sum != check.sum {
            check.dispute = Some((by, sum));
            return None;
        }
        self.close(lease.0, Some(by), Vec::new())
    }

    /// This process' own result; `None` where it has none, and nothing is decided.
    pub(super) fn decided(&mut self, check: u64, sum: Option<Sum>) -> Option<Closed> {
        let open = self.open.get(&check)?;
        let mut liars = Vec::new();
        let by = open.dispute.map(|(by, _)| by);
        if let Some(sum) = sum {
            liars.extend((sum != open.sum).then_some(open.maker));
            liars.extend(open.dispute.filter(|(_, theirs)| *theirs != sum).map(|(by, _)| by));
        } else {
            self.open.remove(&check);
            return None;
        }
        self.close(check, by, liars)
    }

    fn close(&mut self, check: u64, checker: Option<WorkerId>, liars: Vec<WorkerId>) -> Option<Closed> {
        let Check { region, maker, .. } = self.open.remove(&check)?;
        if !liars.contains(&maker)
            && let Some(made) = self.made.iter_mut().rev().find(|m| m.region == region && m.maker == maker)
        {
            made.verified = true;
        }
        Some(Closed { region, maker, checker, liars })
    }

    /// A worker that could not, or left: its checks, to be given to others.
    pub(super) fn left(&mut self, worker: WorkerKey, id: WorkerId) -> Vec<u64> {
        let its = |c: &&mut Check| c.checker == Some(worker);
        for check in self.open.values_mut().filter(its) {
            check.tried.push(id);
        }
        self.open.iter().filter(|(_, c)| c.checker == Some(worker)).map(|(&k, _)| k).collect()
    }

    /// One check that its checker did not render.
    pub(super) fn failed(&mut self, lease: LeaseId, by: WorkerId) {
        if let Some(check) = self.open.get_mut(&lease.0) {
            check.tried.push(by);
        }
    }

    /// Takes back all that `liar` made and nobody has confirmed: of the pass at hand, and of those before.
    pub(super) fn take_back(&mut self, liar: WorkerId) -> (Vec<Made>, Vec<Made>) {
        self.open.retain(|_, c| c.maker != liar);
        let its = |m: &Made| m.maker == liar && !m.verified;
        let take = |from: &mut Vec<Made>| {
            let taken = from.iter().copied().filter(its).collect();
            from.retain(|m| !its(m));
            taken
        };
        (take(&mut self.made), take(&mut self.before))
    }

    /// Estimated error of all that is left of the pass at hand.
    pub(super) fn error(&self) -> ErrorEstimate {
        let mut sum = ErrorEstimate::default();
        self.made.iter().for_each(|m| sum += m.error);
        sum
    }

    /// A pass begins; what the last one made is in the picture if it was `kept`.
    pub(super) fn next_pass(&mut self, kept: bool) {
        let made = std::mem::take(&mut self.made);
        if kept {
            self.before = made;
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use tessera_core::trace::RayCounts;

    use super::*;

    const ONE: WorkerId = WorkerId([1; 32]);
    const TWO: WorkerId = WorkerId([2; 32]);
    const BOTH: [(WorkerKey, WorkerId); 2] = [(WorkerKey(1), ONE), (WorkerKey(2), TWO)];

    fn region(n: u32) -> Region {
        Region { x0: n, y0: 0, x1: n + 1, y1: 1 }
    }

    fn tile(byte: u8) -> TileDone {
        TileDone {
            lease: LeaseId(1),
            attempt: Attempt(0),
            pixels: vec![byte; 3].into(),
            error: ErrorEstimate::default(),
            rays: RayCounts::default(),
            busy: Duration::ZERO,
            idle: Duration::ZERO,
        }
    }

    fn sum(byte: u8) -> Sum {
        sum_of(&[byte; 3], &ErrorEstimate::default())
    }

    /// The check of a tile, and the lease under which `TWO` renders it again.
    fn checked(verify: &mut Verify, byte: u8) -> (u64, LeaseId) {
        let check = verify.accepted(ONE, region(0), None, &tile(byte)).unwrap();
        let Some(Assigned::To(WorkerKey(2), lease)) = verify.assign(check, &BOTH) else { panic!("not to the other") };
        assert!(Verify::is_check(lease.id) && lease.region == region(0));
        (check, lease.id)
    }

    #[test]
    fn who_agrees_confirms_and_nothing_is_taken_back() {
        let mut verify = Verify::new(1.0, [0; 32], JobNumber(0));
        let (_, lease) = checked(&mut verify, 7);
        let closed = verify.answered(lease, TWO, sum(7)).unwrap();
        assert_eq!((closed.checker, closed.liars.len(), verify.is_waiting()), (Some(TWO), 0, false));
        assert!(verify.take_back(ONE).0.is_empty(), "it is confirmed");
    }

    #[test]
    fn this_process_decides_who_lied_the_maker_the_checker_or_both() {
        for (own, liars) in [(7, vec![TWO]), (8, vec![ONE]), (9, vec![ONE, TWO])] {
            let mut verify = Verify::new(1.0, [0; 32], JobNumber(0));
            let (check, lease) = checked(&mut verify, 7);
            assert!(verify.answered(lease, TWO, sum(8)).is_none());
            assert!(matches!(verify.assign(check, &BOTH), Some(Assigned::Here { .. })));
            let closed = verify.decided(check, Some(sum(own))).unwrap();
            assert_eq!(closed.liars, liars);
            assert_eq!(verify.take_back(ONE).0.len(), usize::from(liars.contains(&ONE)));
        }
    }

    #[test]
    fn an_estimate_is_a_result_too() {
        let error = ErrorEstimate { pixels: 1, squares: tessera_core::film::Sum(5), ..ErrorEstimate::default() };
        assert_ne!(sum_of(&[1], &error), sum_of(&[1], &ErrorEstimate::default()));
    }

    #[test]
    fn where_no_other_can_this_process_checks() {
        let mut verify = Verify::new(1.0, [0; 32], JobNumber(0));
        let alone = verify.accepted(ONE, region(0), None, &tile(7)).unwrap();
        assert!(matches!(verify.assign(alone, &BOTH[..1]), Some(Assigned::Here { .. })));
        let closed = verify.decided(alone, Some(sum(7))).unwrap();
        assert_eq!((closed.checker, closed.liars.len()), (None, 0));
        let (check, _) = checked(&mut verify, 7);
        assert_eq!(verify.left(WorkerKey(2), TWO), [check]);
        assert!(matches!(verify.assign(check, &BOTH), Some(Assigned::Here { .. })), "not to one who could not");
    }

    #[test]
    fn the_first_tiles_of_each_are_checked_and_then_the_share() {
        let mut verify = Verify::new(0.05, [3; 32], JobNumber(0));
        let drawn = |verify: &mut Verify, id, n| {
            (0..n).filter(|&i| verify.accepted(id, region(i), None, &tile(0)).is_some()).count()
        };
        assert_eq!(drawn(&mut verify, ONE, FIRST), FIRST as usize);
        let share = drawn(&mut verify, ONE, 20_000);
        assert!((800..1200).contains(&share), "{share}");
        assert_eq!(drawn(&mut verify, TWO, FIRST), FIRST as usize);
        assert!(Verify::new(0.0, [0; 32], JobNumber(0)).accepted(ONE, region(0), None, &tile(0)).is_none());
    }
}
