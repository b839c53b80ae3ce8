mod blame;
mod cases;
mod crowd;
mod history;

use std::collections::{BTreeMap, BTreeSet};

use tessera_proto::convert::Lease;

use super::*;
use crate::config::TileSize;

fn config(w: u32, h: u32, tile: TileSize) -> Config {
    Config {
        region: Region::new(0, 0, w, h).unwrap(),
        tile,
        samples: 1,
        expected: 0,
        bytes_per_pixel: 3,
        patience: Duration::from_secs(30).into(),
        suspect_after: Duration::from_secs(2),
        dead_after: Duration::from_secs(6),
        prepare_within: Duration::from_secs(300),
        model: MODEL,
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
        let holder = |l: &LeaseId| &s.workers[&s.open[l].worker];
        for (id, tile) in &s.tiles {
            let counting = tile.leases.iter().filter(|l| holder(l).is_alive()).count();
            assert_eq!(tile.wanted.is_some(), counting == 0, "a tile is lost");
            assert!(tile.wanted.is_none_or(|w| s.wanted.contains(&w)));
            assert_eq!(tile.is_doubtful(), s.doubtful.contains(id));
            assert!(tile.leases.iter().all(|l| s.open[l].tile == *id));
        }
        let held: u64 = s.tiles.values().map(|t| t.region.area()).sum();
        assert_eq!(s.pixels_done + s.cutter.pixels_left() + held, s.pixels, "pixels are lost");
        for (key, w) in &s.workers {
            assert!(w.leases.iter().all(|l| s.open[l].worker == *key));
            assert!(w.leases.len() <= MAX_DEPTH);
        }
        let wanted = s.wanted.len();
        assert_eq!(wanted, s.tiles.values().filter(|t| t.wanted.is_some()).count());
        let rest = s.cutter.pixels_left() > 0 || s.tiles.values().any(|t| t.wanted.is_some() && t.again_at <= self.now);
        let fit = || s.workers.values().filter(|w| w.is_fit());
        assert!(!(rest && fit().count() > 0 && fit().all(|w| w.leases.is_empty())), "work, and nobody is at it");
        // The sums are what a walk over all workers gives.
        let mut crowd = Crowd::default();
        for w in s.workers.values() {
            w.counted.iter().for_each(|share| crowd.add(share));
            assert_eq!(w.counted.is_some(), w.is_fit());
            let area = |l: &LeaseId| s.tiles[&s.open[l].tile].region.area();
            assert_eq!(w.held, w.leases.iter().map(area).sum::<u64>());
            assert_eq!(w.place.is_some(), w.is_fit() && w.leases.len() < w.depth);
            assert!(w.place.is_none_or(|p| p.0 == w.leases.len() && s.room.contains(&p)));
        }
        assert_eq!(crowd, s.crowd);
        assert_eq!(s.room.len(), s.workers.values().filter(|w| w.place.is_some()).count());
    }

    fn join(&mut self, threads: u32) -> WorkerKey {
        self.join_as(threads, InstanceId(self.next))
    }

    fn join_as(&mut self, threads: u32, instance: InstanceId) -> WorkerKey {
        let worker = WorkerKey(self.next);
        self.next += 1;
        self.held.insert(worker, BTreeMap::new());
        self.tell(Event::Joined { worker, threads, instance, own: false });
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
            if !any {
                // A tile in doubt is let lie for a moment.
                let waits = self.scheduler.tiles.values().any(|t| t.again_at > self.now);
                assert!(waits, "workers are there and have nothing to do");
                let all: Vec<_> = self.held.keys().copied().collect();
                self.wait(Duration::from_millis(100), &all);
            }
        }
        panic!("there is no end");
    }
}
