//! Who ever worked here: workers by their keys, and the names they are shown under.

use std::collections::{BTreeMap, HashMap, HashSet, VecDeque};

use tessera_proto::InstanceId;
use tessera_proto::identity::WorkerId;

use crate::progress::WorkerStats;

/// Workers remembered, beyond those that are there or have delivered something.
const KEPT: usize = 1000;
/// Workers remembered as shut out.
const BANNED: usize = 10_000;

/// See the [module](self).
#[derive(Debug, Default)]
pub(super) struct Roster {
    known: HashMap<WorkerId, Known>,
    /// What workers of an earlier run were called.
    before: BTreeMap<WorkerId, String>,
    names: HashSet<String>,
    /// How often a name was asked for, so that the next one of it is found at once.
    asked: HashMap<String, u32>,
    /// Those that left, the first first.
    gone: VecDeque<WorkerId>,
    banned: HashMap<WorkerId, String>,
    banned_first: VecDeque<WorkerId>,
    next: u64,
}

#[derive(Clone, Copy, Debug)]
struct Known {
    instance: InstanceId,
    place: usize,
}

impl Roster {
    /// Empty, of a render whose workers were called so in an earlier run.
    pub(super) fn of(before: BTreeMap<WorkerId, String>) -> Self {
        Self { before, ..Self::default() }
    }

    /// What a worker was called in an earlier run.
    pub(super) fn name_before(&self, id: WorkerId) -> Option<&str> {
        self.before.get(&id).map(String::as_str)
    }

    /// Enters a worker that came, with its figures in `workers`, and gives its number, its place there, and the
    /// name it is shown under: its own, unless another has it.
    pub(super) fn enter(&mut self, id: WorkerId, came: WorkerStats, workers: &mut Vec<WorkerStats>) -> Entered {
        if let Some(known) = self.known.get(&id)
            && let Some(w) = workers.get_mut(known.place)
        {
            (w.connected, w.left, w.address) = (true, None, came.address);
            return Entered { instance: known.instance, place: known.place, name: w.name.clone(), back: true };
        }
        let name = self.name(came.name);
        let stats = WorkerStats { name: name.clone(), connected: true, ..came };
        let place = match self.free_place(workers) {
            Some(place) => {
                workers[place] = stats;
                place
            }
            None => {
                workers.push(stats);
                workers.len() - 1
            }
        };
        let instance = InstanceId(self.next);
        self.next += 1;
        self.known.insert(id, Known { instance, place });
        Entered { instance, place, name, back: false }
    }

    /// Where a worker's figures are.
    pub(super) fn place(&self, id: WorkerId) -> Option<usize> {
        self.known.get(&id).map(|k| k.place)
    }

    /// A worker left.
    pub(super) fn left(&mut self, id: WorkerId) {
        self.gone.push_back(id);
    }

    /// The place of one that came, did nothing and left, where there are too many of the kind.
    fn free_place(&mut self, workers: &mut [WorkerStats]) -> Option<usize> {
        while self.gone.len() > KEPT {
            let id = self.gone.pop_front()?;
            let Some(&Known { place, .. }) = self.known.get(&id) else { continue };
            let Some(w) = workers.get(place) else { continue };
            if !w.connected && w.tiles == 0 {
                self.known.remove(&id);
                self.names.remove(&w.name);
                return Some(place);
            }
        }
        None
    }

    fn name(&mut self, name: String) -> String {
        if self.asked.len() > 10 * KEPT {
            self.asked.clear();
        }
        let asked = self.asked.entry(name.clone()).or_insert(1);
        let mut unique = if *asked == 1 { name.clone() } else { format!("{name} ({asked})") };
        while self.names.contains(&unique) {
            *asked += 1;
            unique = format!("{name} ({asked})");
        }
        self.names.insert(unique.clone());
        unique
    }

    /// Shuts a worker out.
    pub(super) fn ban(&mut self, id: WorkerId, rule: String) {
        if self.banned.insert(id, rule).is_none() {
            self.banned_first.push_back(id);
        }
        while self.banned_first.len() > BANNED {
            if let Some(first) = self.banned_first.pop_front() {
                self.banned.remove(&first);
            }
        }
    }

    /// Why a worker is shut out, if it is.
    pub(super) fn banned(&self, id: WorkerId) -> Option<&str> {
        self.banned.get(&id).map(String::as_str)
    }
}

/// See [`Roster::enter`].
#[derive(Clone, Debug)]
pub(super) struct Entered {
    pub(super) instance: InstanceId,
    pub(super) place: usize,
    pub(super) name: String,
    /// Whether it was there before.
    pub(super) back: bool,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn id(n: u64) -> WorkerId {
        let mut id = [0; 32];
        id[..8].copy_from_slice(&n.to_le_bytes());
        WorkerId(id)
    }

    fn came(name: &str) -> WorkerStats {
        WorkerStats { name: name.into(), ..WorkerStats::default() }
    }

    #[test]
    fn whoever_comes_back_is_the_same_and_names_are_told_apart() {
        let (mut roster, mut workers) = (Roster::default(), Vec::new());
        let first = roster.enter(id(1), came("bert"), &mut workers);
        let twin = roster.enter(id(2), came("bert"), &mut workers);
        let sly = roster.enter(id(3), came("bert (2)"), &mut workers);
        let names = [&first.name, &twin.name, &sly.name];
        assert_eq!(names, ["bert", "bert (2)", "bert (2) (2)"]);
        let again = roster.enter(id(1), came("ernie"), &mut workers);
        assert_eq!((again.instance, again.place, again.name.as_str()), (first.instance, 0, "bert"));
    }

    #[test]
    fn a_loop_of_registrations_is_forgotten_and_those_who_worked_are_not() {
        let (mut roster, mut workers) = (Roster::default(), Vec::new());
        let honest = roster.enter(id(u64::MAX), came("honest"), &mut workers);
        (workers[0].tiles, workers[0].connected) = (1, false);
        roster.left(id(u64::MAX));
        for n in 0..50_000 {
            let entered = roster.enter(id(n), came("loop"), &mut workers);
            workers[entered.place].connected = false;
            roster.left(id(n));
        }
        assert!(workers.len() <= KEPT + 3, "{}", workers.len());
        assert!(roster.known.len() <= KEPT + 3 && roster.names.len() <= KEPT + 3 && roster.gone.len() <= KEPT + 3);
        let back = roster.enter(id(u64::MAX), came("honest"), &mut workers);
        assert_eq!((back.instance, workers[back.place].tiles), (honest.instance, 1));
    }
}
