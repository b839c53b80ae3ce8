//! Which jobs are rendered now: a pure function of what waits.
//!
//! Every owner has a job rendered before any has two, as far as there is room for so many pictures in memory; a second
//! one of the same owner is there so that workers have where to go while the first waits for its last tiles. Where
//! there are more owners than room, they take turns.

use std::collections::{BTreeMap, BTreeSet};
use std::time::{Duration, Instant};

/// Jobs that are rendered at once.
pub(super) const ACTIVE: usize = 12;
/// Of one owner.
const OF_ONE: usize = 2;
/// How long an owner's turn is, at least, where others wait for one.
const TURN: Duration = Duration::from_secs(20);

/// A job's place among its owner's: the least comes first.
pub(super) type Rank = (i64, u64);

/// Jobs that may be rendered, by their owners.
#[derive(Debug, Default)]
pub(super) struct Waiting {
    owners: BTreeMap<String, BTreeSet<Rank>>,
    /// When an owner last had a turn.
    served: BTreeMap<String, Instant>,
}

impl Waiting {
    pub(super) fn insert(&mut self, owner: &str, rank: Rank) {
        self.owners.entry(owner.into()).or_default().insert(rank);
    }

    pub(super) fn remove(&mut self, owner: &str, rank: Rank) {
        if let Some(of_owner) = self.owners.get_mut(owner) {
            of_owner.remove(&rank);
            if of_owner.is_empty() {
                self.owners.remove(owner);
                self.served.remove(owner);
            }
        }
    }

    /// The jobs to be rendered now, of those `since` when some are rendered already.
    pub(super) fn choose(&mut self, since: &BTreeMap<u64, Instant>, now: Instant) -> BTreeSet<u64> {
        // Whoever has a turn that is not over keeps it; then come those who wait, the longest first, and of those that
        // never had a turn the one with the oldest job; then the rest.
        let mut owners: Vec<_> = self
            .owners
            .iter()
            .map(|(owner, ranks)| {
                let turn = ranks.iter().filter_map(|(_, id)| since.get(id)).min();
                let oldest = ranks.iter().take(OF_ONE).map(|(_, id)| *id).min().unwrap_or(u64::MAX);
                let class = match turn {
                    Some(&turn) if now.saturating_duration_since(turn) < TURN => 0,
                    None => 1,
                    Some(_) => 2,
                };
                ((class, self.served.get(owner).copied(), oldest), owner, ranks)
            })
            .collect();
        owners.sort_unstable_by_key(|(order, ..)| *order);
        let nth = |n: usize| {
            let has = move |(_, owner, ranks): &(_, &String, &BTreeSet<Rank>)| {
                ranks.iter().nth(n).map(|&(_, id)| ((*owner).clone(), id))
            };
            owners.iter().filter_map(has)
        };
        let chosen: Vec<(String, u64)> = (0..OF_ONE).flat_map(nth).take(ACTIVE).collect();
        self.served.extend(chosen.iter().map(|(owner, _)| (owner.clone(), now)));
        chosen.into_iter().map(|(_, id)| id).collect()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn everyone_has_one_before_anyone_has_two_and_priority_comes_first() {
        let mut waiting = Waiting::default();
        for id in 1..=1000 {
            waiting.insert("bob", (0, id));
        }
        waiting.insert("ann", (0, 1001));
        waiting.insert("bob", (-5, 1002));
        let chosen = waiting.choose(&BTreeMap::new(), Instant::now());
        assert_eq!(chosen, [1, 1001, 1002].into());
        waiting.remove("bob", (-5, 1002));
        assert_eq!(waiting.choose(&BTreeMap::new(), Instant::now()), [1, 2, 1001].into());
    }

    proptest! {
        /// However many owners there are, everyone has a turn before long.
        #[test]
        fn nobody_starves(owners in 1usize..60, jobs in 1usize..4) {
            let mut waiting = Waiting::default();
            let mut id = 0;
            for _ in 0..jobs {
                for owner in 0..owners {
                    id += 1;
                    waiting.insert(&format!("owner {owner}"), (0, id));
                }
            }
            let (mut since, mut seen, start) = (BTreeMap::new(), BTreeSet::new(), Instant::now());
            for turn in 0..owners as u32 + 2 {
                let now = start + turn * TURN;
                let chosen = waiting.choose(&since, now);
                prop_assert!(chosen.len() == ACTIVE.min(owners * jobs.min(OF_ONE)));
                since.retain(|id, _| chosen.contains(id));
                for &id in &chosen {
                    since.entry(id).or_insert(now);
                    seen.insert((id as usize - 1) % owners);
                }
            }
            prop_assert_eq!(seen.len(), owners);
        }
    }
}
