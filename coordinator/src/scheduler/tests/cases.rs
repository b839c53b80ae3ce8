//! What happens when this or that happens.

use super::*;
use crate::config::Patience;

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
fn what_an_earlier_run_did_can_be_taken_back_before_anything_is_done() {
    let mut farm = Farm::new(config(32, 8, TileSize::Edge(8)));
    farm.scheduler.begin_first(None, Region::new(8, 0, 32, 8).map(|left| vec![left]));
    farm.scheduler.redo(Region::new(0, 0, 8, 8).into_iter().collect());
    farm.join(1);
    farm.run();
    assert_eq!(farm.end, Some(End::Complete));
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
    assert_eq!(farm.held[&well].len(), 2, "a suspect's tiles are rendered by others too");
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
    assert!(farm.scheduler.tiles.is_empty() && farm.scheduler.wanted.is_empty());
    farm.join(1);
    farm.run();
    assert_eq!(farm.end, Some(End::Complete));
}

#[test]
fn a_worker_far_away_gets_more_leases_at_once() {
    let mut farm = Farm::new(config(1280, 960, TileSize::Edge(32)));
    let worker = farm.join(1);
    for _ in 0..20 {
        // A twentieth of a second there and back, and a thousandth for each tile.
        farm.now += Duration::from_millis(50);
        let mut idle = Duration::from_millis(50);
        for lease in farm.held[&worker].values().copied().collect::<Vec<_>>() {
            farm.held.get_mut(&worker).unwrap().remove(&lease.id);
            let busy = Duration::from_millis(1);
            farm.now += busy;
            farm.tell(Event::Done { worker, lease: lease.id, attempt: lease.attempt, busy, idle });
            idle = Duration::ZERO;
        }
    }
    assert!(farm.held[&worker].len() > 10, "{} leases", farm.held[&worker].len());
}

#[test]
fn a_worker_that_beats_but_does_not_deliver_holds_nothing_up() {
    let mut farm = Farm::new(config(64, 8, TileSize::Edge(8)));
    let (stuck, others) = ([farm.join(1), farm.join(1), farm.join(1)], [farm.join(1), farm.join(1)]);
    let all: Vec<_> = stuck.into_iter().chain(others).collect();
    for _ in 0..100 {
        for worker in others {
            if let Some(lease) = farm.nth(worker, 0) {
                farm.now += Duration::from_micros(64);
                farm.deliver(worker, lease);
            }
        }
        if farm.end.is_some() {
            break;
        }
        farm.wait(Duration::from_millis(100), &all);
    }
    assert_eq!(farm.end, Some(End::Complete), "{:?}", farm.held);
    assert!(farm.now < Duration::from_secs(3), "{:?}", farm.now);
}

#[test]
fn a_stuck_worker_gets_no_more_until_it_delivers() {
    let mut farm = Farm::new(config(640, 8, TileSize::Edge(8)));
    let (stuck, well) = (farm.join(1), farm.join(1));
    let (first, second) = (farm.nth(stuck, 0).unwrap(), farm.nth(stuck, 1).unwrap());
    let lease = farm.nth(well, 0).unwrap();
    farm.deliver(well, lease);
    farm.wait(Duration::from_secs(4), &[stuck, well]);
    assert!(farm.revoked.contains(&second.id) && !farm.revoked.contains(&first.id), "what it has not begun");
    farm.held.get_mut(&stuck).unwrap().remove(&second.id);
    farm.revoked.remove(&second.id);
    farm.tell(Event::Returned { worker: stuck, lease: second.id, attempt: second.attempt });
    assert_eq!(farm.held[&stuck].len(), 1);
    farm.deliver(stuck, first);
    assert!(farm.held[&stuck].len() > 1, "it is trusted again");
    farm.run();
    assert_eq!(farm.end, Some(End::Complete));
}

#[test]
fn nobody_waits_for_ever_unless_told_to() {
    let patience = Patience { first: Duration::MAX, lost: Duration::MAX };
    let mut farm = Farm::new(Config { patience, ..config(8, 8, TileSize::Auto) });
    farm.wait(Duration::from_secs(10_000), &[]);
    assert_eq!(farm.end, None);
    let patience = Patience { first: Duration::from_secs(3), lost: Duration::from_secs(10) };
    let mut farm = Farm::new(Config { patience, ..config(8, 8, TileSize::Auto) });
    let worker = farm.join(1);
    farm.leave(worker);
    farm.wait(Duration::from_secs(9), &[]);
    assert_eq!(farm.end, None);
    farm.wait(Duration::from_secs(2), &[]);
    assert!(matches!(farm.end, Some(End::NoWorkers { ever: true, .. })));
}

#[test]
fn tiles_last_longer_in_a_crowd() {
    let shortest = |crowd: u64| {
        let mut farm = Farm::new(config(2048, 2048, TileSize::Auto));
        let workers: Vec<_> = (0..crowd).map(|_| farm.join(1)).collect();
        for round in 0..3 {
            for &worker in &workers {
                farm.now += Duration::from_micros(10 * (round + 1));
                if let Some(lease) = farm.nth(worker, 0) {
                    farm.deliver(worker, lease);
                }
            }
        }
        farm.grants.iter().rev().take(20).map(|(_, l)| l.region.area()).min().unwrap()
    };
    assert!(shortest(300) > 5 * shortest(20).min(1000), "{} and {}", shortest(300), shortest(20));
}
