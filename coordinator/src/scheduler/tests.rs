use std::collections::{BTreeMap, BTreeSet};

use proptest::prelude::*;

use super::*;
use crate::job::TileSize;

fn config(w: u32, h: u32, tile: TileSize) -> Config {
    Config {
        region: Region::new(0, 0, w, h).unwrap(),
        tile,
        samples: 1,
        expected: 0,
        patience: Duration::from_secs(30),
        suspect_after: Duration::from_secs(2),
        dead_after: Duration::from_secs(6),
        prepare_within: Duration::from_secs(300),
    }
}

/// A farm around a scheduler: keeps what its workers hold, and holds it to its promises.
struct Farm {
    scheduler: Scheduler,
    now: Duration,
    held: BTreeMap<WorkerKey, BTreeMap<LeaseId, Lease>>,
    revoked: BTreeSet<LeaseId>,
    pixels: Vec<bool>,
    width: u32,
    next: u64,
    end: Option<End>,
    cut_off: Vec<(WorkerKey, CutOff)>,
    grants: Vec<(WorkerKey, Lease)>,
}

impl Farm {
    fn new(config: Config) -> Self {
        let region = config.region;
        Self {
            scheduler: Scheduler::new(config),
            now: Duration::ZERO,
            held: BTreeMap::new(),
            revoked: BTreeSet::new(),
            pixels: vec![false; region.area() as usize],
            width: region.width(),
            next: 0,
            end: None,
            cut_off: Vec::new(),
            grants: Vec::new(),
        }
    }

    fn tell(&mut self, event: Event) {
        let mut effects = Vec::new();
        if let Event::Left { worker, .. } = &event {
            self.held.remove(worker);
        }
        self.scheduler.handle(event, self.now, &mut effects);
        for effect in effects {
            match effect {
                Effect::Grant { worker, lease } => {
                    assert!(lease.region.area() <= tessera_proto::limits::MAX_TILE_PIXELS);
                    let twice = self.held.get_mut(&worker).expect("a lease for nobody").insert(lease.id, lease);
                    assert!(twice.is_none());
                    self.grants.push((worker, lease));
                }
                Effect::Revoke { worker, lease } => {
                    assert!(self.held[&worker].contains_key(&lease) && self.revoked.insert(lease));
                }
                Effect::Accept { region, .. } => {
                    for y in region.y0..region.y1 {
                        for x in region.x0..region.x1 {
                            let pixel = &mut self.pixels[(y * self.width + x) as usize];
                            assert!(!*pixel, "pixel {x},{y} was done twice");
                            *pixel = true;
                        }
                    }
                }
                Effect::CutOff { worker, why } => {
                    self.held.remove(&worker);
                    self.cut_off.push((worker, why));
                }
                Effect::Lost { .. } => {}
                Effect::End(end) => assert!(self.end.replace(end).is_none(), "the end came twice"),
            }
        }
        self.check();
    }

    /// What must hold between any two events.
    fn check(&self) {
        let s = &self.scheduler;
        if self.end.is_some() {
            assert!(self.end != Some(End::Complete) || self.pixels.iter().all(|p| *p));
            return;
        }
        let wanted: BTreeSet<LeaseId> =
            self.held.values().flat_map(|l| l.keys()).copied().filter(|l| !self.revoked.contains(l)).collect();
        assert_eq!(wanted, s.open.keys().copied().collect(), "leases leak");
        for (id, tile) in &s.tiles {
            let waits = s.waiting.iter().filter(|w| *w == id).count();
            assert_eq!(waits, usize::from(tile.leases.is_empty()), "a tile is lost");
            assert!(tile.leases.len() <= MAX_COPIES);
            assert!(tile.leases.iter().all(|l| s.open[l].tile == *id));
        }
        let held: u64 = s.tiles.values().map(|t| t.region.area()).sum();
        assert_eq!(s.pixels_done + s.cutter.pixels_left() + held, s.config.region.area(), "pixels are lost");
        for (key, w) in &s.workers {
            assert!(w.leases.iter().all(|l| s.open[l].worker == *key));
            assert!(w.leases.len() <= MAX_DEPTH);
        }
        let rest = s.cutter.pixels_left() > 0 || !s.waiting.is_empty();
        let idle = s.workers.values().any(|w| w.is_fit() && w.leases.is_empty());
        assert!(!(rest && idle && s.open.is_empty()), "work and a worker, and nothing happens");
    }

    fn join(&mut self, threads: u32) -> WorkerKey {
        self.join_as(threads, InstanceId(self.next))
    }

    fn join_as(&mut self, threads: u32, instance: InstanceId) -> WorkerKey {
        let worker = WorkerKey(self.next);
        self.next += 1;
        self.held.insert(worker, BTreeMap::new());
        self.tell(Event::Joined { worker, threads, instance });
        self.tell(Event::Ready { worker });
        worker
    }

    /// The `nth` lease that a worker holds, in the order of their grants.
    fn nth(&self, worker: WorkerKey, nth: usize) -> Option<Lease> {
        let leases = self.held.get(&worker)?;
        leases.values().nth(nth % leases.len().max(1)).copied()
    }

    fn deliver(&mut self, worker: WorkerKey, lease: Lease) {
        self.held.get_mut(&worker).unwrap().remove(&lease.id);
        self.revoked.remove(&lease.id);
        // A pixel a microsecond.
        let busy = Duration::from_micros(lease.region.area());
        let (lease, attempt) = (lease.id, lease.attempt);
        self.tell(Event::Done { worker, lease, attempt, busy, idle: Duration::ZERO });
    }

    fn fail(&mut self, worker: WorkerKey, lease: Lease) {
        self.held.get_mut(&worker).unwrap().remove(&lease.id);
        self.revoked.remove(&lease.id);
        let (lease, attempt) = (lease.id, lease.attempt);
        self.tell(Event::Failed { worker, lease, attempt, cause: "it broke".into() });
    }

    fn leave(&mut self, worker: WorkerKey) {
        self.tell(Event::Left { worker, cause: "the connection broke".into() });
    }

    fn wait(&mut self, time: Duration, who: &[WorkerKey]) {
        let end = self.now + time;
        while self.now < end && self.end.is_none() {
            self.now = (self.now + Duration::from_millis(100)).min(end);
            for &worker in who {
                self.tell(Event::Heard { worker });
            }
            self.tell(Event::Tick);
        }
    }

    /// Everyone who is there renders until nothing is left.
    fn run(&mut self) {
        for _ in 0..1_000_000 {
            if self.end.is_some() {
                return;
            }
            let workers: Vec<_> = self.held.keys().copied().collect();
            let mut any = false;
            for worker in workers {
                if let Some(lease) = self.nth(worker, 0) {
                    any = true;
                    self.now += Duration::from_micros(100);
                    self.deliver(worker, lease);
                }
                if self.end.is_some() {
                    return;
                }
            }
            assert!(any, "workers are there and have nothing to do");
        }
        panic!("there is no end");
    }
}

#[derive(Clone, Debug)]
enum Step {
    Join(u32),
    JoinUnready,
    Rejoin(usize),
    Deliver(usize, usize),
    Fail(usize, usize),
    Leave(usize),
    Drain(usize),
    Forge(usize, u64, u32),
    Again(usize),
    Return(usize, usize),
    Silence(u64),
    Wait(u64),
}

fn step() -> impl Strategy<Value = Step> {
    prop_oneof![
        3 => (1u32..5).prop_map(Step::Join),
        1 => Just(Step::JoinUnready),
        1 => (0usize..9).prop_map(Step::Rejoin),
        12 => (0usize..9, 0usize..4).prop_map(|(w, n)| Step::Deliver(w, n)),
        1 => (0usize..9, 0usize..4).prop_map(|(w, n)| Step::Fail(w, n)),
        1 => (0usize..9).prop_map(Step::Leave),
        1 => (0usize..9).prop_map(Step::Drain),
        1 => (0usize..9, 0u64..50, 0u32..3).prop_map(|(w, l, a)| Step::Forge(w, l, a)),
        1 => (0usize..9).prop_map(Step::Again),
        1 => (0usize..9, 0usize..4).prop_map(|(w, n)| Step::Return(w, n)),
        1 => (0u64..8000).prop_map(Step::Silence),
        3 => (0u64..3000).prop_map(Step::Wait),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, ..ProptestConfig::default() })]

    /// Whatever happens, pixels are done once, no lease is lost, and an honest worker that
    /// comes at last finishes the picture.
    #[test]
    fn any_history_ends_well(
        (w, h) in (1u32..200, 1u32..200),
        tile in prop_oneof![Just(TileSize::Auto), (8u32..40).prop_map(TileSize::Edge)],
        steps in prop::collection::vec(step(), 0..80),
    ) {
        let mut farm = Farm::new(config(w, h, tile));
        for step in steps {
            if farm.end.is_some() {
                break;
            }
            let who = |n: usize| farm.held.keys().copied().nth(n % farm.held.len().max(1));
            match step {
                Step::Join(threads) => {
                    farm.join(threads);
                }
                Step::JoinUnready => {
                    let worker = WorkerKey(farm.next);
                    farm.next += 1;
                    farm.held.insert(worker, BTreeMap::new());
                    farm.tell(Event::Joined { worker, threads: 1, instance: InstanceId(worker.0) });
                }
                Step::Rejoin(n) => {
                    if let Some(worker) = who(n) {
                        let instance = farm.scheduler.workers[&worker].instance;
                        farm.leave(worker);
                        if farm.end.is_none() {
                            farm.join_as(1, instance);
                        }
                    }
                }
                Step::Deliver(n, l) => {
                    if let Some((worker, lease)) = who(n).and_then(|w| Some((w, farm.nth(w, l)?))) {
                        farm.deliver(worker, lease);
                    }
                }
                Step::Fail(n, l) => {
                    if let Some((worker, lease)) = who(n).and_then(|w| Some((w, farm.nth(w, l)?))) {
                        farm.fail(worker, lease);
                    }
                }
                Step::Leave(n) => {
                    if let Some(worker) = who(n) {
                        farm.leave(worker);
                    }
                }
                Step::Drain(n) => {
                    if let Some(worker) = who(n) {
                        let again = farm.scheduler.workers[&worker].phase == Phase::Draining;
                        farm.tell(Event::Draining { worker });
                        prop_assert!(!(again && farm.held.contains_key(&worker)), "saying it twice is an offence");
                    }
                }
                Step::Forge(n, lease, attempt) => {
                    if let Some(worker) = who(n) {
                        let (lease, attempt) = (LeaseId(lease), Attempt(attempt));
                        let held = farm.held[&worker].get(&lease).copied();
                        if held.is_some_and(|l| l.attempt == attempt) {
                            farm.deliver(worker, held.unwrap());
                        } else if !farm.revoked.contains(&lease) {
                            let time = Duration::from_secs(1);
                            farm.tell(Event::Done { worker, lease, attempt, busy: time, idle: time });
                            prop_assert!(!farm.held.contains_key(&worker), "a forger was kept");
                        }
                    }
                }
                Step::Again(n) => {
                    if let Some((worker, lease)) = who(n).and_then(|w| Some((w, farm.nth(w, 0)?))) {
                        farm.deliver(worker, lease);
                        if farm.end.is_none() && farm.held.contains_key(&worker) {
                            let (lease, attempt, time) = (lease.id, lease.attempt, Duration::from_secs(1));
                            farm.tell(Event::Done { worker, lease, attempt, busy: time, idle: time });
                            prop_assert!(!farm.held.contains_key(&worker), "a second delivery was taken");
                        }
                    }
                }
                Step::Return(n, l) => {
                    if let Some((worker, lease)) = who(n).and_then(|w| Some((w, farm.nth(w, l)?))) {
                        farm.held.get_mut(&worker).unwrap().remove(&lease.id);
                        farm.revoked.remove(&lease.id);
                        farm.tell(Event::Returned { worker, lease: lease.id, attempt: lease.attempt });
                    }
                }
                Step::Silence(ms) => farm.wait(Duration::from_millis(ms), &[]),
                Step::Wait(ms) => {
                    let all: Vec<_> = farm.held.keys().copied().collect();
                    farm.wait(Duration::from_millis(ms), &all);
                }
            }
        }
        if farm.end.is_none() {
            // Those who drain or never got ready leave; one honest worker is enough.
            let all: Vec<_> = farm.held.keys().copied().collect();
            all.into_iter().for_each(|w| if farm.end.is_none() { farm.leave(w) });
        }
        if farm.end.is_none() {
            farm.join(1);
            farm.run();
        }
        match farm.end {
            Some(End::Complete) => prop_assert!(farm.pixels.iter().all(|p| *p)),
            Some(End::TileFailed { attempts, .. }) => prop_assert!(attempts as usize >= STRIKES),
            Some(End::NoWorkers { waited, .. }) => prop_assert!(waited >= Duration::from_secs(30)),
            None => prop_assert!(false, "no end"),
        }
    }
}

#[test]
fn a_small_picture_is_a_few_tiles() {
    let mut farm = Farm::new(Config { expected: 2, ..config(64, 48, TileSize::Auto) });
    farm.join(1);
    farm.join(1);
    farm.run();
    assert!((2..=6).contains(&farm.grants.len()), "{} leases", farm.grants.len());
}

#[test]
fn a_large_picture_is_as_few_tiles_as_time_allows() {
    // A million pixels a second each: a quarter of a second is four of the largest tiles.
    let mut farm = Farm::new(Config { expected: 2, ..config(1280, 960, TileSize::Auto) });
    farm.join(1);
    farm.join(1);
    farm.run();
    assert!(farm.grants.len() < 70, "{} leases", farm.grants.len());
    let largest = farm.grants.iter().map(|(_, l)| l.region.area()).max().unwrap();
    assert!(largest > 50_000, "{largest} pixels");
    let last = farm.grants.last().unwrap().1.region.area();
    assert!(last < 5_000, "the last is of {last} pixels");
}

#[test]
fn three_reports_of_failure_end_the_render_with_the_last_cause() {
    let mut farm = Farm::new(config(8, 8, TileSize::Edge(8)));
    for _ in 0..3 {
        farm.join(1);
    }
    for _ in 0..3 {
        assert_eq!(farm.end, None);
        let (worker, lease) = *farm.grants.last().unwrap();
        farm.fail(worker, lease);
    }
    let tried: BTreeSet<_> = farm.grants.iter().map(|(w, _)| *w).collect();
    assert_eq!(tried.len(), 3, "it is tried on three workers");
    let region = Region::new(0, 0, 8, 8).unwrap();
    assert_eq!(farm.end, Some(End::TileFailed { region, attempts: 3, cause: "it broke".into() }));
}

#[test]
fn a_tile_that_kills_three_workers_ends_the_render_and_others_do_not() {
    let mut farm = Farm::new(config(80, 80, TileSize::Edge(8)));
    for n in 1..=3 {
        let worker = farm.join(1);
        assert_eq!(farm.nth(worker, 0).unwrap().region.x0, 0, "the first tile is tried again");
        farm.leave(worker);
        assert_eq!(farm.end.is_some(), n == 3);
    }
}

#[test]
fn one_worker_that_comes_back_does_not_condemn_a_tile_at_once() {
    let mut farm = Farm::new(config(8, 8, TileSize::Edge(8)));
    for _ in 0..5 {
        let worker = farm.join_as(1, InstanceId(77));
        farm.leave(worker);
    }
    assert_eq!(farm.end, None);
    let worker = farm.join_as(1, InstanceId(77));
    let lease = farm.nth(worker, 0).unwrap();
    farm.deliver(worker, lease);
    assert_eq!(farm.end, Some(End::Complete));
}

#[test]
fn a_failed_tile_goes_to_someone_else() {
    let mut farm = Farm::new(config(16, 8, TileSize::Edge(8)));
    let (a, b) = (farm.join(1), farm.join(1));
    let lease = farm.nth(a, 0).unwrap();
    farm.fail(a, lease);
    let again = farm.grants.last().unwrap();
    assert_eq!((again.0, again.1.region, again.1.attempt), (b, lease.region, Attempt(1)));
}

#[test]
fn nobody_for_long_is_an_end() {
    let mut farm = Farm::new(config(8, 8, TileSize::Auto));
    farm.wait(Duration::from_secs(31), &[]);
    assert!(matches!(farm.end, Some(End::NoWorkers { ever: false, waited }) if waited >= Duration::from_secs(30)));
    let mut farm = Farm::new(config(8, 8, TileSize::Auto));
    let worker = farm.join(1);
    farm.wait(Duration::from_secs(31), &[worker]);
    assert_eq!(farm.end, None, "a worker on a slow tile is there");
    farm.leave(worker);
    farm.wait(Duration::from_secs(29), &[]);
    assert_eq!(farm.end, None);
    farm.wait(Duration::from_secs(2), &[]);
    assert!(matches!(farm.end, Some(End::NoWorkers { ever: true, .. })));
}

#[test]
fn a_silent_worker_is_suspected_then_cut_off_and_its_tiles_go_to_others() {
    let mut farm = Farm::new(config(32, 8, TileSize::Edge(8)));
    let (silent, well) = (farm.join(1), farm.join(1));
    while let Some(lease) = farm.nth(well, 0) {
        farm.deliver(well, lease);
    }
    assert_eq!(farm.held[&silent].len(), 2);
    farm.wait(Duration::from_millis(2500), &[well]);
    assert_eq!(farm.held[&well].len(), 1, "a suspect's tile is rendered by others too");
    farm.wait(Duration::from_secs(4), &[well]);
    assert!(matches!(farm.cut_off[..], [(w, CutOff::Silent(_))] if w == silent));
    farm.run();
    assert_eq!(farm.end, Some(End::Complete));
}

#[test]
fn a_stall_of_this_process_kills_nobody() {
    let mut farm = Farm::new(config(32, 8, TileSize::Edge(8)));
    farm.join(1);
    farm.now += Duration::from_secs(100);
    farm.tell(Event::Tick);
    assert!(farm.cut_off.is_empty());
}

#[test]
fn an_idle_worker_helps_with_an_overdue_tile_and_the_first_result_wins() {
    let mut farm = Farm::new(config(32, 8, TileSize::Edge(8)));
    let (slow, quick) = (farm.join(1), farm.join(1));
    while let Some(lease) = farm.nth(quick, 0) {
        farm.now += Duration::from_micros(64);
        farm.deliver(quick, lease);
    }
    let stuck = farm.nth(slow, 0).unwrap();
    farm.wait(Duration::from_millis(500), &[slow, quick]);
    let copy = farm.nth(quick, 0).expect("a copy");
    assert_eq!((copy.region, copy.attempt), (stuck.region, Attempt(1)));
    farm.deliver(quick, copy);
    assert!(farm.revoked.contains(&stuck.id));
    farm.deliver(slow, stuck);
    assert!(farm.cut_off.is_empty(), "a late result is no offence");
    assert!(farm.held.contains_key(&slow));
}

#[test]
fn a_draining_worker_returns_what_it_has_not_begun_and_nothing_counts_as_failed() {
    let mut farm = Farm::new(config(32, 8, TileSize::Edge(8)));
    let worker = farm.join(1);
    let (first, second) = (farm.nth(worker, 0).unwrap(), farm.nth(worker, 1).unwrap());
    farm.tell(Event::Draining { worker });
    farm.held.get_mut(&worker).unwrap().remove(&second.id);
    farm.tell(Event::Returned { worker, lease: second.id, attempt: second.attempt });
    farm.deliver(worker, first);
    assert!(farm.held[&worker].is_empty());
    farm.leave(worker);
    assert!(farm.scheduler.tiles.is_empty() && farm.scheduler.waiting.is_empty());
    farm.join(1);
    farm.run();
    assert_eq!(farm.end, Some(End::Complete));
}

#[test]
fn a_worker_far_away_gets_more_leases_at_once() {
    let mut farm = Farm::new(config(1280, 960, TileSize::Edge(32)));
    let worker = farm.join(1);
    for _ in 0..20 {
        let lease = farm.nth(worker, 0).unwrap();
        farm.held.get_mut(&worker).unwrap().remove(&lease.id);
        let (busy, idle) = (Duration::from_millis(1), Duration::from_millis(50));
        farm.now += busy + idle;
        farm.tell(Event::Done { worker, lease: lease.id, attempt: lease.attempt, busy, idle });
    }
    assert!(farm.held[&worker].len() > 10, "{} leases", farm.held[&worker].len());
}
