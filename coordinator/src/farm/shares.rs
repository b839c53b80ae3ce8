//! Which worker renders for which job: a pure function of what jobs want and where workers are.
//!
//! Threads are split between owners evenly, as far as each has work for them, and of an owner's jobs the first in
//! rank comes first. Workers cannot be split: what an owner got too little is kept as its *credit*, in thread seconds,
//! so that two owners who share one worker take turns. A worker only moves where that makes the split better by more
//! than the worker itself, so that none goes back and forth without need.

use std::collections::BTreeMap;
use std::time::Duration;

use tessera_proto::JobNumber;

use crate::scheduler::WorkerKey;

/// So long ago what an owner got too little counts as much as what it gets too little now.
const MEMORY: f64 = 4.0;
/// A share of a worker that a move must gain on top.
const INERTIA: f64 = 0.25;
/// No owner is owed or owes more than this many seconds of everything.
const MOST_CREDIT: f64 = 4.0;

/// A job that wants workers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Claim {
    pub(super) job: JobNumber,
    pub(super) owner: String,
    /// Of an owner's jobs, the least comes first.
    pub(super) rank: (i64, u64),
    /// Threads that it has work for.
    pub(super) wants: u64,
}

/// A worker that can be given to a job.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Hand {
    pub(super) worker: WorkerKey,
    pub(super) threads: u64,
    /// Where it is.
    pub(super) job: Option<JobNumber>,
    /// Whether it has nothing to do there.
    pub(super) idle: bool,
    /// Jobs that it cannot be given.
    pub(super) barred: Vec<JobNumber>,
}

/// What owners got too little so far, in thread seconds.
#[derive(Clone, Debug, Default)]
pub(super) struct Shares(BTreeMap<String, f64>);

/// A job's place in the split.
struct Due<'a> {
    claim: &'a Claim,
    /// Threads it should have less those it has.
    due: f64,
    credit: f64,
}

impl Shares {
    /// Who goes where, after so much time in which all were where they are.
    pub(super) fn split(&mut self, claims: &[Claim], hands: &[Hand], passed: Duration) -> Vec<(WorkerKey, JobNumber)> {
        let total: u64 = hands.iter().map(|h| h.threads).sum();
        let targets = targets(claims, total);
        let held = |job: JobNumber| hands.iter().filter(|h| h.job == Some(job)).map(|h| h.threads).sum::<u64>() as f64;
        self.0.retain(|owner, _| claims.iter().any(|c| c.owner == *owner));
        for (claim, target) in claims.iter().zip(&targets) {
            let credit = self.0.entry(claim.owner.clone()).or_default();
            let most = MOST_CREDIT * total as f64;
            *credit = (*credit + (target - held(claim.job)) * passed.as_secs_f64()).clamp(-most, most);
        }
        let mut dues: Vec<Due<'_>> = claims
            .iter()
            .zip(&targets)
            .map(|(claim, target)| {
                let credit = self.0.get(&claim.owner).copied().unwrap_or_default() / MEMORY;
                Due { claim, due: target - held(claim.job), credit }
            })
            .collect();
        let (mut hands, mut moves) = (hands.to_vec(), Vec::new());
        while let Some((at, to)) = better(&dues, &hands) {
            let threads = hands[at].threads as f64;
            let job = dues[to].claim.job;
            for due in &mut dues {
                if Some(due.claim.job) == hands[at].job {
                    due.due += threads;
                } else if due.claim.job == job {
                    due.due -= threads;
                }
            }
            (hands[at].job, hands[at].idle) = (Some(job), false);
            moves.retain(|(worker, _)| *worker != hands[at].worker);
            moves.push((hands[at].worker, job));
            // Each makes the split better, so that there is an end; this is in case of numbers that do not tell.
            if moves.len() > hands.len() {
                break;
            }
        }
        moves
    }
}

/// Threads that each claim should have: owners evenly up to what they want, then by rank.
fn targets(claims: &[Claim], total: u64) -> Vec<f64> {
    let mut owners = BTreeMap::<&str, u64>::new();
    for claim in claims {
        let wanted = owners.entry(&claim.owner).or_default();
        *wanted = wanted.saturating_add(claim.wants);
    }
    let mut by_want: Vec<(u64, &str)> = owners.into_iter().map(|(owner, wants)| (wants, owner)).collect();
    by_want.sort_unstable();
    let (mut left, mut share, count) = (total as f64, BTreeMap::new(), by_want.len());
    for (nth, (wants, owner)) in by_want.into_iter().enumerate() {
        let part = (left / (count - nth) as f64).min(wants as f64);
        left -= part;
        share.insert(owner, part);
    }
    let mut order: Vec<usize> = (0..claims.len()).collect();
    order.sort_by_key(|&at| claims[at].rank);
    let mut targets = vec![0.0; claims.len()];
    for at in order {
        let Some(rest) = share.get_mut(claims[at].owner.as_str()) else { continue };
        targets[at] = rest.min(claims[at].wants as f64);
        *rest -= targets[at];
    }
    targets
}

/// The best move that makes the split better: a worker, and the claim it goes to.
fn better(dues: &[Due<'_>], hands: &[Hand]) -> Option<(usize, usize)> {
    let mut best: Option<(f64, usize, usize)> = None;
    for (at, hand) in hands.iter().enumerate() {
        let from = dues.iter().find(|d| Some(d.claim.job) == hand.job);
        for (to, due) in dues.iter().enumerate() {
            if Some(due.claim.job) == hand.job || hand.barred.contains(&due.claim.job) {
                continue;
            }
            let threads = hand.threads as f64;
            let gain = match from {
                // Whoever is nowhere goes where it is wanted most; also where nothing is left to be cut, since it may
                // render what others are late with.
                None => 1e9 + due.due + due.credit,
                Some(from) => {
                    let credit = if from.claim.owner == due.claim.owner { 0.0 } else { due.credit - from.credit };
                    let gain = due.due - from.due + credit - threads * (1.0 + INERTIA);
                    // Two of one owner's jobs swap nothing but what the rank says.
                    gain + if hand.idle { 0.5 * INERTIA * threads } else { 0.0 }
                }
            };
            if gain > 1e-9 && best.is_none_or(|(most, ..)| gain > most) {
                best = Some((gain, at, to));
            }
        }
    }
    best.map(|(_, at, to)| (at, to))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn claim(job: u64, owner: &str, rank: i64, wants: u64) -> Claim {
        Claim { job: JobNumber(job), owner: owner.into(), rank: (rank, job), wants }
    }

    fn hand(worker: u64, threads: u64, job: Option<u64>) -> Hand {
        Hand { worker: WorkerKey(worker), threads, job: job.map(JobNumber), idle: false, barred: Vec::new() }
    }

    /// Follows the moves for so many quarters of a second, and gives the thread seconds that each job got.
    fn follow(claims: &[Claim], hands: &mut [Hand], quarters: usize) -> (BTreeMap<u64, f64>, usize) {
        let (mut shares, mut got, mut moved) = (Shares::default(), BTreeMap::new(), 0);
        for _ in 0..quarters {
            let moves = shares.split(claims, hands, Duration::from_millis(250));
            moved += moves.len();
            for (worker, job) in moves {
                hands.iter_mut().filter(|h| h.worker == worker).for_each(|h| h.job = Some(job));
            }
            for h in hands.iter() {
                if let Some(JobNumber(job)) = h.job {
                    *got.entry(job).or_insert(0.0) += h.threads as f64 / 4.0;
                }
            }
        }
        (got, moved)
    }

    #[test]
    fn one_job_of_one_owner_gets_as_much_as_a_thousand_of_another() {
        let mut claims = vec![claim(0, "ann", 0, u64::MAX)];
        claims.extend((1..=1000).map(|n| claim(n, "bob", 0, u64::MAX)));
        for workers in [1, 2, 3, 8] {
            let mut hands: Vec<Hand> = (0..workers).map(|n| hand(n, 4, None)).collect();
            let (got, _) = follow(&claims, &mut hands, 480);
            let all: f64 = got.values().sum();
            let ann = got[&0] / all;
            assert!((0.45..0.55).contains(&ann), "{workers} workers: {ann}");
            // Bob's are rendered one after another.
            assert_eq!(got.len(), 2);
        }
    }

    #[test]
    fn the_first_in_rank_comes_first_and_what_it_does_not_want_goes_on() {
        let claims = [claim(1, "ann", 5, u64::MAX), claim(2, "ann", -1, 4), claim(3, "bob", 0, 2)];
        let mut hands: Vec<Hand> = (0..8).map(|n| hand(n, 2, None)).collect();
        follow(&claims, &mut hands, 40);
        let at = |job| hands.iter().filter(|h| h.job == Some(JobNumber(job))).count();
        assert_eq!((at(2), at(3), at(1)), (2, 1, 5));
    }

    #[test]
    fn who_comes_at_the_end_helps_too() {
        let hands = [hand(0, 4, Some(1)), hand(1, 4, None)];
        let moves = Shares::default().split(&[claim(1, "ann", 0, 4)], &hands, Duration::ZERO);
        assert_eq!(moves, [(WorkerKey(1), JobNumber(1))]);
    }

    #[test]
    fn who_cannot_render_a_job_is_not_given_it() {
        let mut hands = [Hand { barred: vec![JobNumber(1)], ..hand(0, 1, None) }];
        assert!(Shares::default().split(&[claim(1, "ann", 0, u64::MAX)], &hands, Duration::ZERO).is_empty());
        hands[0].barred.clear();
        assert_eq!(Shares::default().split(&[claim(1, "ann", 0, u64::MAX)], &hands, Duration::ZERO).len(), 1);
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]

        /// Over a while every owner gets its even part to within what workers are large, none is idle while there is
        /// work, and where nothing changes nearly nobody moves.
        #[test]
        fn owners_get_even_parts(
            threads in prop::collection::vec(1u64..9, 1..20), owners in 1usize..5, jobs in 1usize..12,
        ) {
            let claims: Vec<Claim> = (0..jobs.max(owners))
                .map(|n| claim(n as u64, &format!("owner {}", n % owners), (n / owners) as i64, u64::MAX))
                .collect();
            let mut hands: Vec<Hand> =
                threads.iter().enumerate().map(|(n, t)| hand(n as u64, *t, None)).collect();
            let (got, _) = follow(&claims, &mut hands, 600);
            prop_assert!(hands.iter().all(|h| h.job.is_some()));
            let all: f64 = got.values().sum();
            let largest = *threads.iter().max().unwrap_or(&1) as f64;
            let total: u64 = threads.iter().sum();
            for owner in 0..owners {
                let part: f64 = got.iter().filter(|(job, _)| **job as usize % owners == owner).map(|(_, s)| s).sum();
                let even = 1.0 / owners as f64;
                let slack = 0.05 + 0.15 * largest / total as f64;
                prop_assert!((part / all - even).abs() < slack, "{owner}: {} of {even}", part / all);
            }
        }
    }
}
