//! Which tiles are blamed, and for what not.

use super::super::blame::LOSSES_OF_STRANGERS;
use super::*;

/// Long enough for a loss to be judged.
const JUDGED: Duration = Duration::from_millis(2600);

/// A worker that delivered a tile already.
fn proven(farm: &mut Farm) -> WorkerKey {
    let worker = farm.join(1);
    let lease = farm.nth(worker, 0).expect("a lease");
    farm.deliver(worker, lease);
    worker
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
fn a_failed_tile_is_tried_by_someone_else_after_everything_else() {
    let mut farm = Farm::new(config(32, 8, TileSize::Edge(8)));
    let (a, b) = (farm.join(1), farm.join(1));
    let lease = farm.nth(a, 0).unwrap();
    farm.fail(a, lease);
    while let Some(other) = farm.nth(b, 0).filter(|l| l.region != lease.region) {
        farm.deliver(b, other);
    }
    while let Some(other) = farm.nth(a, 0) {
        farm.deliver(a, other);
    }
    let again = farm.nth(b, 0).expect("the failed tile");
    assert_eq!((again.region, again.attempt), (lease.region, Attempt(1)));
    assert_eq!(farm.grants.iter().filter(|(_, l)| l.region == lease.region).count(), 2);
}

#[test]
fn a_tile_that_kills_three_workers_one_after_another_ends_the_render() {
    let mut farm = Farm::new(config(80, 80, TileSize::Edge(8)));
    let mut workers: Vec<_> = (0..4).map(|_| proven(&mut farm)).collect();
    // All of it but one tile, of which some hold copies in the end.
    let last = farm.nth(workers[3], 0).unwrap().region;
    while let Some((worker, lease)) = workers.iter().find_map(|w| {
        let other = farm.held[w].values().find(|l| l.region != last && !farm.revoked.contains(&l.id));
        other.map(|l| (*w, *l))
    }) {
        farm.now += Duration::from_micros(64);
        farm.deliver(worker, lease);
    }
    for n in 1..=3 {
        let renders = |w: &WorkerKey| farm.held[w].values().any(|l| l.region == last && !farm.revoked.contains(&l.id));
        let at = workers.iter().position(renders).expect("somebody renders it");
        let killed = workers.remove(at);
        farm.leave(killed);
        assert_eq!(farm.end, None);
        farm.wait(JUDGED, &workers);
        assert_eq!(farm.end.is_some(), n == 3, "after {n}");
    }
    assert!(matches!(farm.end, Some(End::TileFailed { region, .. }) if region == last));
}

#[test]
fn workers_lost_together_blame_no_tile() {
    let mut farm = Farm::new(config(24, 8, TileSize::Edge(8)));
    for _ in 0..5 {
        let workers = [farm.join(1), farm.join(1), farm.join(1)];
        for worker in workers {
            farm.now += Duration::from_millis(100);
            farm.leave(worker);
        }
        farm.wait(JUDGED, &[]);
        assert_eq!(farm.end, None);
        assert!(farm.scheduler.doubtful.is_empty());
    }
    farm.join(1);
    farm.run();
    assert_eq!(farm.end, Some(End::Complete));
}

#[test]
fn a_stall_of_this_process_blames_no_tile() {
    let mut farm = Farm::new(config(16, 8, TileSize::Edge(8)));
    for _ in 0..5 {
        let worker = proven(&mut farm);
        farm.now += Duration::from_secs(9);
        farm.leave(worker);
        farm.wait(JUDGED, &[]);
        if farm.end.is_some() {
            break;
        }
        assert!(farm.scheduler.doubtful.is_empty());
    }
    assert_ne!(farm.end.as_ref().map(|e| matches!(e, End::TileFailed { .. })), Some(true));
}

#[test]
fn a_worker_that_comes_back_was_not_killed_by_its_tile() {
    let mut farm = Farm::new(config(16, 8, TileSize::Edge(8)));
    for n in 0..20 {
        let worker = farm.join_as(1, InstanceId(77));
        if n == 0 {
            let lease = farm.nth(worker, 1).unwrap();
            farm.deliver(worker, lease);
        }
        assert_eq!(farm.held[&worker].len(), 1);
        farm.leave(worker);
        farm.wait(JUDGED, &[]);
        assert_eq!(farm.end, None);
    }
    let worker = farm.join_as(1, InstanceId(77));
    assert!(farm.scheduler.doubtful.is_empty());
    let lease = farm.nth(worker, 0).unwrap();
    farm.deliver(worker, lease);
    assert_eq!(farm.end, Some(End::Complete));
}

#[test]
fn strangers_that_take_leases_and_leave_end_nothing() {
    let mut farm = Farm::new(config(80, 80, TileSize::Edge(8)));
    let honest = proven(&mut farm);
    for _ in 0..100 {
        let stranger = farm.join(1);
        farm.wait(Duration::from_millis(100), &[honest, stranger]);
        farm.leave(stranger);
        farm.wait(JUDGED, &[honest]);
        assert_eq!(farm.end, None);
    }
    farm.run();
    assert_eq!(farm.end, Some(End::Complete));
}

#[test]
fn a_tile_that_kills_whoever_comes_ends_the_render_after_as_long_as_one_would_wait_for_workers() {
    let mut farm = Farm::new(config(8, 8, TileSize::Edge(8)));
    let mut killed = 0;
    while farm.end.is_none() {
        let worker = farm.join(1);
        assert_eq!(farm.held[&worker].len(), 1);
        farm.leave(worker);
        farm.wait(JUDGED, &[]);
        killed += 1;
        assert!(killed < 100);
    }
    assert!(killed >= LOSSES_OF_STRANGERS);
    assert!(matches!(farm.end, Some(End::TileFailed { .. })));
}

#[test]
fn a_tile_in_doubt_comes_last_and_is_not_for_strangers() {
    let mut farm = Farm::new(config(40, 8, TileSize::Edge(8)));
    let honest = proven(&mut farm);
    let victim = proven(&mut farm);
    let lost = farm.nth(victim, 0).unwrap();
    farm.leave(victim);
    farm.wait(MODEL.together / 4, &[honest]);
    let stranger = farm.join(1);
    while let Some(lease) = farm.nth(honest, 0).filter(|l| l.region != lost.region) {
        farm.deliver(honest, lease);
    }
    let given = |w: WorkerKey| farm.grants.iter().any(|(to, l)| *to == w && l.region == lost.region);
    assert!(given(honest) && !given(stranger));
    farm.run();
    assert_eq!(farm.end, Some(End::Complete));
}

#[test]
fn a_tile_that_kills_one_worker_after_another_is_no_common_cause() {
    let mut farm = Farm::new(config(160, 8, TileSize::Edge(8)));
    let mut workers: Vec<_> = (0..4).map(|_| proven(&mut farm)).collect();
    let cursed = farm.nth(workers[0], 0).map(|l| l.region).unwrap();
    for _ in 0..600 {
        // Whoever begins it dies at once, and there is nothing else to do.
        let killed = workers.iter().position(|w| farm.nth(*w, 0).is_some_and(|l| l.region == cursed));
        if let Some(at) = killed {
            farm.leave(workers.remove(at));
        }
        if farm.end.is_some() {
            break;
        }
        for &worker in &workers {
            if let Some(lease) = farm.nth(worker, 0).filter(|l| l.region != cursed) {
                farm.deliver(worker, lease);
            }
        }
        farm.wait(Duration::from_millis(10), &workers);
    }
    assert!(matches!(farm.end, Some(End::TileFailed { region, .. }) if region == cursed), "{:?}", farm.end);
}
