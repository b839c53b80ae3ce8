use super::*;

const ONE: WorkerId = WorkerId([1; 32]);
const TWO: WorkerId = WorkerId([2; 32]);
const NOW: Duration = Duration::ZERO;
const BOTH: [(WorkerKey, WorkerId); 2] = [(WorkerKey(1), ONE), (WorkerKey(2), TWO)];

fn region(n: u32) -> Region {
    Region { x0: n, y0: 0, x1: n + 1, y1: 1 }
}

/// A tile of `maker`, as it delivered it.
fn tile(maker: WorkerId, n: u32, byte: u8) -> (Made, Sum) {
    (Made { region: region(n), maker, error: ErrorEstimate::default(), verified: false }, sum(byte))
}

fn sum(byte: u8) -> Sum {
    sum_of(&[byte; 3], &ErrorEstimate::default())
}

/// The check of a tile, and the lease under which `TWO` renders it again.
fn checked(verify: &mut Verify, byte: u8) -> (u64, LeaseId) {
    let check = verify.accepted(tile(ONE, 0, byte), None, NOW).unwrap();
    let Some(Assigned::To(WorkerKey(2), lease)) = verify.assign(check, &BOTH, true, NOW) else {
        panic!("not to the other")
    };
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
        assert!(matches!(verify.assign(check, &BOTH, true, NOW), Some(Assigned::Here { .. })));
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
    let alone = verify.accepted(tile(ONE, 0, 7), None, NOW).unwrap();
    assert!(matches!(verify.assign(alone, &BOTH[..1], false, NOW), Some(Assigned::Later)));
    assert!(matches!(verify.assign(alone, &BOTH[..1], true, NOW), Some(Assigned::Here { .. })));
    let closed = verify.decided(alone, Some(sum(7))).unwrap();
    assert_eq!((closed.checker, closed.liars.len()), (None, 0));
    let (check, _) = checked(&mut verify, 7);
    assert_eq!(verify.left(WorkerKey(2), TWO), [check]);
    assert!(matches!(verify.assign(check, &BOTH, true, NOW), Some(Assigned::Here { .. })), "not to one who could not");
}

#[test]
fn the_first_tiles_of_each_are_checked_and_then_the_share() {
    let mut verify = Verify::new(0.05, [3; 32], JobNumber(0));
    let drawn =
        |verify: &mut Verify, id, n| (0..n).filter(|&i| verify.accepted(tile(id, i, 0), None, NOW).is_some()).count();
    assert_eq!(drawn(&mut verify, ONE, FIRST), FIRST as usize);
    let share = drawn(&mut verify, ONE, 20_000);
    assert!((800..1200).contains(&share), "{share}");
    assert_eq!(drawn(&mut verify, TWO, FIRST), FIRST as usize);
    verify.looks(true);
    assert_eq!(drawn(&mut verify, TWO, 50), 50, "what decides about later passes is checked whole");
}

#[test]
fn what_an_earlier_run_made_is_checked_confirmed_or_taken_back() {
    let kept = |n: u32, maker, confirmed| {
        let (id, attempt, number) = (LeaseId(0), Attempt(0), PassNumber(0));
        let lease = Lease { id, attempt, region: region(n), number, pass: None };
        let made = Some(crate::journal::Made { maker, sum: sum(n as u8), confirmed });
        let (error, rays, place) = Default::default();
        Kept { lease, error, rays, place, made }
    };
    let mut verify = Verify::new(1.0, [0; 32], JobNumber(0));
    let made = [kept(0, ONE, true), kept(1, ONE, false), kept(2, ONE, false), kept(3, TWO, false)];
    let checks = verify.recover(&made, Some(&[kept(4, ONE, false), kept(5, ONE, true)]));
    assert_eq!(checks.len(), 3, "the confirmed one needs no other");
    let Some(Assigned::To(WorkerKey(2), lease)) = verify.assign(checks[0], &BOTH, true, NOW) else {
        panic!("not to the other")
    };
    assert!(verify.answered(lease.id, TWO, sum(1)).unwrap().liars.is_empty(), "sums are those of the journal");
    let (now, before) = verify.take_back(ONE);
    assert_eq!(now.iter().map(|m| m.region).collect::<Vec<_>>(), [region(2)]);
    assert_eq!(before.iter().map(|m| m.region).collect::<Vec<_>>(), [region(4)]);
}

#[test]
fn nobody_gets_more_checks_at_once_than_it_can_hold() {
    let mut verify = Verify::new(1.0, [0; 32], JobNumber(0));
    let checks: Vec<u64> = (0..100).filter_map(|n| verify.accepted(tile(ONE, n, 7), None, NOW)).collect();
    let mut given = Vec::new();
    for &check in &checks {
        if let Some(Assigned::To(WorkerKey(2), lease)) = verify.assign(check, &BOTH, true, NOW) {
            given.push(lease.id);
        }
    }
    assert_eq!(given.len(), AT_ONCE);
    verify.answered(given[0], TWO, sum(7)).unwrap();
    assert!(matches!(verify.assign(checks[99], &BOTH, true, NOW), Some(Assigned::To(..))), "there is room again");
    assert_eq!(verify.left(WorkerKey(2), TWO).len(), AT_ONCE);
    assert!(matches!(verify.assign(checks[98], &BOTH, true, NOW), Some(Assigned::To(..))));
}

#[test]
fn a_check_that_its_checker_sits_on_goes_to_another() {
    let mut verify = Verify::new(1.0, [0; 32], JobNumber(0));
    let (check, lease) = checked(&mut verify, 7);
    assert!(verify.overdue(OVERDUE.0, false).is_empty());
    assert_eq!(verify.overdue(2 * OVERDUE.0, false), [check]);
    assert!(matches!(verify.assign(check, &BOTH, true, NOW), Some(Assigned::Here { .. })));
    assert!(verify.region_of(WorkerKey(2), lease).is_none(), "its answer comes too late");
}

#[test]
fn a_check_of_a_dear_tile_is_waited_for_less_long_when_all_else_is_done() {
    let mut verify = Verify::new(1.0, [0; 32], JobNumber(0));
    let busy = Duration::from_secs(10);
    let check = verify.accepted(tile(ONE, 0, 7), None, busy).unwrap();
    assert!(matches!(verify.assign(check, &BOTH, true, NOW), Some(Assigned::To(WorkerKey(2), _))));
    let late = OVERDUE.0 + busy * OVERDUE_AT_THE_END;
    assert!(verify.overdue(late, true).is_empty(), "it may still come");
    assert!(verify.overdue(2 * late, false).is_empty(), "there is other work");
    assert_eq!(verify.overdue(2 * late, true), [check]);
}
