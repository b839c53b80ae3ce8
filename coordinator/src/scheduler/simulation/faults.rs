//! What goes wrong in a run, drawn from its seed.

use std::time::Duration;

use super::verification::id_of;
use super::worker::FOR_EVER;
use super::world::{What, World};
use crate::simulation::network::Quality;

/// Faults happen before this.
pub(super) const FAULTY: f64 = 15.0;

/// One thing that goes wrong. Workers are given by number.
#[derive(Clone, Debug)]
pub(super) enum Fault {
    /// Processes are killed, and start again as others after a while; or never.
    Kill { workers: Vec<usize>, again: Option<Duration> },
    /// A process stands still.
    Freeze { worker: usize, time: Duration },
    /// Its rendering threads stand still while it beats; for ever without a time.
    Stick { worker: usize, time: Option<Duration> },
    /// Nothing passes to the coordinator, from it, or both.
    Cut { workers: Vec<usize>, up: bool, down: bool, time: Duration },
    /// Its connection is reset.
    Reset { worker: usize },
    /// It is so many times as slow from now on.
    Slow { worker: usize, times: f64 },
    /// It is told to leave, and another is started after a while.
    Drain { worker: usize, again: Duration },
    /// It breaks the rules.
    Lie { worker: usize, lie: Lie },
    /// The coordinator's process stands still.
    Stall { time: Duration },
    /// The coordinator is killed and comes back after a while, with what is on the disk of what it had.
    Crash { time: Duration },
    /// Somebody registers, takes a lease and leaves, several times in a row.
    Strangers { count: usize },
}

/// How a worker breaks the rules.
#[derive(Clone, Copy, Debug)]
pub(super) enum Lie {
    /// It answers a lease that it does not hold.
    Forged,
    /// Its attempt is wrong.
    Attempt,
    /// It answers twice.
    Twice,
    /// What it sends is no tile.
    Garbage,
    /// Some of its tiles are well-formed and wrong. Only where tiles are verified.
    Pixels,
}

/// The faults of a run, with their times.
pub(super) fn draw(rng: &mut fastrand::Rng, workers: usize, verified: bool) -> Vec<(Duration, Fault)> {
    let count = rng.usize(0..12);
    let mut faults: Vec<_> = (0..count).map(|_| (seconds(FAULTY * rng.f64()), one(rng, workers, verified))).collect();
    faults.sort_by_key(|f| f.0);
    faults
}

fn seconds(s: f64) -> Duration {
    Duration::from_secs_f64(s)
}

fn one(rng: &mut fastrand::Rng, workers: usize, verified: bool) -> Fault {
    let worker = rng.usize(0..workers);
    let time = seconds(0.1 + 8.0 * rng.f64() * rng.f64());
    match rng.u32(0..if verified { 16 } else { 18 }) {
        0..2 => {
            let again = (rng.u32(0..3) > 0).then(|| seconds(0.2 + 3.0 * rng.f64()));
            Fault::Kill { workers: vec![worker], again }
        }
        2..4 => Fault::Kill { workers: some(rng, workers), again: Some(seconds(0.2 + 3.0 * rng.f64())) },
        4 => Fault::Freeze { worker, time },
        5..7 => Fault::Stick { worker, time: rng.bool().then_some(time) },
        7..10 => {
            let (up, down) = [(true, true), (true, false), (false, true)][rng.usize(0..3)];
            Fault::Cut { workers: some(rng, workers), up, down, time }
        }
        10 => Fault::Reset { worker },
        11 => Fault::Slow { worker, times: 2.0 + 20.0 * rng.f64() },
        12 => Fault::Drain { worker, again: time },
        13 => {
            let lies = [Lie::Forged, Lie::Attempt, Lie::Twice, Lie::Garbage, Lie::Pixels, Lie::Pixels];
            let lie = lies[rng.usize(0..if verified { 6 } else { 4 })];
            Fault::Lie { worker, lie }
        }
        14 => Fault::Stall { time },
        15 => Fault::Strangers { count: rng.usize(1..6) },
        _ => Fault::Crash { time },
    }
}

/// One worker or more.
fn some(rng: &mut fastrand::Rng, workers: usize) -> Vec<usize> {
    let first = rng.usize(0..workers);
    (0..workers).filter(|w| *w == first || rng.bool()).collect()
}

impl World {
    pub(super) fn fault(&mut self, fault: Fault) {
        self.faults_seen += 1;
        if self.verbose {
            println!("{:9.3} {fault:?}", self.now.as_secs_f64());
        }
        match fault {
            Fault::Kill { workers, again } => workers.into_iter().for_each(|w| self.kill(w, again)),
            Fault::Freeze { worker, time } => self.workers[worker].frozen_until = self.now + time,
            Fault::Stick { worker, time } => {
                self.workers[worker].stuck_until = time.map_or(FOR_EVER, |time| self.now + time);
            }
            Fault::Cut { workers, up, down, time } => {
                self.cut(&workers, (up, down), true);
                self.at(self.now + time, What::Pass { workers, up, down });
            }
            Fault::Reset { worker } => {
                if self.workers[worker].session.is_some() {
                    self.lost(worker);
                }
            }
            Fault::Slow { worker, times } => self.workers[worker].renderer.speed /= times,
            Fault::Drain { worker, again } => {
                self.drain(worker);
                self.at(self.now + again + Duration::from_secs(2), What::Start { worker });
            }
            Fault::Lie { worker, lie } => {
                self.workers[worker].lie = Some(lie);
                if matches!(lie, Lie::Pixels) {
                    self.liars.insert(id_of(self.workers[worker].instance));
                }
            }
            Fault::Stall { time } => self.stalled_until = self.stalled_until.max(self.now + time),
            Fault::Crash { time } => self.crash(time),
            Fault::Strangers { count } => self.stranger(count),
        }
    }

    /// Stops what these workers send, or what they are sent, or lets it pass again.
    pub(super) fn cut(&mut self, workers: &[usize], (up, down): (bool, bool), cut: bool) {
        for &worker in workers {
            let cuts = &mut self.cuts[worker];
            let change = |n: u32, this: bool| if cut { n + u32::from(this) } else { n - u32::from(this) };
            *cuts = (change(cuts.0, up), change(cuts.1, down));
            let (no_up, no_down) = (cuts.0 > 0, cuts.1 > 0);
            for session in 0..self.sessions.len() {
                if self.sessions[session].worker == worker {
                    self.block(session, no_up, no_down);
                }
            }
        }
    }

    fn block(&mut self, session: usize, no_up: bool, no_down: bool) {
        let s = &mut self.sessions[session];
        let (up, beats, down) = (s.up.block(no_up), s.beats.block(no_up), s.down.block(no_down));
        for (said, bytes) in up {
            let sent = self.sessions[session].up.send(said, bytes, self.now, &mut self.rng);
            self.arrive(session, sent);
        }
        for (said, bytes) in beats {
            let sent = self.sessions[session].beats.send(said, bytes, self.now, &mut self.rng);
            self.arrive(session, sent);
        }
        for (said, bytes) in down {
            if let Some((said, _, arrives)) = self.sessions[session].down.send(said, bytes, self.now, &mut self.rng) {
                self.at(arrives, What::ToWorker { session, said });
            }
        }
    }

    /// A worker that registers, takes leases and is killed, and the next one after it.
    pub(super) fn stranger(&mut self, left: usize) {
        if left == 0 {
            return;
        }
        let quality = Quality { delay: Duration::from_micros(200), bytes_per_second: 1.2e8, loss: 0.0 };
        let worker = self.add_worker(1.0, quality);
        (self.workers[worker].up, self.workers[worker].prepared) = (true, true);
        self.dial(worker);
        self.at(self.now + Duration::from_millis(100), What::Fault(Fault::Kill { workers: vec![worker], again: None }));
        self.at(self.now + Duration::from_millis(350), What::Stranger { left: left - 1 });
    }

    /// After all faults: what stood still goes on, and a worker comes that is well.
    pub(super) fn rescue(&mut self) {
        // It does a pass in half a minute, whatever the others do.
        let speed = self.picture.cost(&self.picture.region()) / 30.0;
        let quality = Quality { delay: Duration::from_millis(1), bytes_per_second: 1.2e8, loss: 0.0 };
        let worker = self.add_worker(speed, quality);
        self.workers[worker].up = true;
        self.dial(worker);
    }
}
