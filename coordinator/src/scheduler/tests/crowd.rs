//! Thousands of workers.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, VecDeque};
use std::time::Instant;

use super::*;

/// Workers that render what they hold at `speed` pixels a second each, a quarter of them half as fast, and answer at
/// once: gives how long it took, the share of that time they were busy, and the coordinator's own time an answer.
fn run(workers: u64, (width, height): (u32, u32), speed: f64) -> (Duration, f64, Duration) {
    let mut scheduler = Scheduler::new(config(width, height, TileSize::Auto));
    let (mut held, mut queue) = (vec![VecDeque::<Lease>::new(); workers as usize], BinaryHeap::new());
    let (mut now, mut busy, mut answers, mut spent) = (Duration::ZERO, 0.0, 0_u32, Duration::ZERO);
    let mut effects = Vec::new();
    let mut ready: Vec<Event> = (0..workers)
        .flat_map(|n| {
            let worker = WorkerKey(n);
            [Event::Joined { worker, threads: 1, instance: InstanceId(n), own: false }, Event::Ready { worker }]
        })
        .rev()
        .collect();
    let time = |n: usize, l: &Lease| {
        let speed = if n.is_multiple_of(4) { speed / 2.0 } else { speed };
        Duration::from_secs_f64(l.region.area() as f64 / speed)
    };
    loop {
        let event = match ready.pop() {
            Some(event) => event,
            None => {
                let Reverse((at, n, id)): Reverse<(Duration, usize, LeaseId)> = queue.pop().expect("work goes on");
                now = at;
                let Some(lease) = held[n].pop_front().filter(|l| l.id == id) else { continue };
                let took = time(n, &lease);
                busy += took.as_secs_f64();
                answers += 1;
                if let Some(next) = held[n].front() {
                    queue.push(Reverse((now + time(n, next), n, next.id)));
                }
                let worker = WorkerKey(n as u64);
                Event::Done { worker, lease: id, attempt: lease.attempt, busy: took, idle: Duration::ZERO }
            }
        };
        let begun = Instant::now();
        scheduler.handle(event, now, &mut effects);
        spent += begun.elapsed();
        for effect in effects.drain(..) {
            match effect {
                Effect::Grant { worker, lease } => {
                    let n = worker.0 as usize;
                    held[n].push_back(lease);
                    if held[n].len() == 1 {
                        queue.push(Reverse((now + time(n, &lease), n, lease.id)));
                    }
                }
                Effect::End(end) => {
                    assert_eq!(end, End::Complete);
                    return (now, busy / (now.as_secs_f64() * workers as f64), spent / answers.max(1));
                }
                Effect::Revoke { .. } | Effect::Accept { .. } => {}
                other => panic!("{other:?}"),
            }
        }
    }
}

#[test]
fn thousands_of_workers_are_busy_to_the_end() {
    for workers in [2, 100, 2000] {
        // Half a minute of work for everyone.
        let speed = 536_870_912.0 / 30.0 / workers as f64;
        let (took, busy, each) = run(workers, (65_536, 8192), speed);
        println!("{workers} workers: {took:?}, {:.1} % busy, {each:?} of the scheduler's time a tile", 100.0 * busy);
        assert!(busy > 0.95, "{workers} workers are busy {busy} of {took:?}");
    }
}
