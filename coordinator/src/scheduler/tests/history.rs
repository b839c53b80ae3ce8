//! Random histories.

use proptest::prelude::*;
use proptest::test_runner::TestCaseResult;
use tessera_proto::convert::Lease;

use super::super::blame::STRIKES;
use super::*;

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

/// A worker answers a lease, whether it has it or not.
fn forge(farm: &mut Farm, worker: WorkerKey, (lease, attempt): (LeaseId, Attempt)) -> TestCaseResult {
    let held = farm.held[&worker].get(&lease).copied();
    match held.filter(|l| l.attempt == attempt) {
        Some(held) => farm.deliver(worker, held),
        None if !farm.revoked.contains(&lease) => {
            let time = Duration::from_secs(1);
            farm.tell(Event::Done { worker, lease, attempt, busy: time, idle: time });
            prop_assert!(!farm.held.contains_key(&worker), "a forger was kept");
        }
        None => {}
    }
    Ok(())
}

/// A worker delivers a tile, and then once more.
fn deliver_twice(farm: &mut Farm, worker: WorkerKey, lease: Lease) -> TestCaseResult {
    farm.deliver(worker, lease);
    if farm.end.is_none() && farm.held.contains_key(&worker) {
        let (lease, attempt, time) = (lease.id, lease.attempt, Duration::from_secs(1));
        farm.tell(Event::Done { worker, lease, attempt, busy: time, idle: time });
        prop_assert!(!farm.held.contains_key(&worker), "a second delivery was taken");
    }
    Ok(())
}

/// Makes one thing happen.
fn happen(farm: &mut Farm, step: Step) -> TestCaseResult {
    let who = |n: usize| farm.held.keys().copied().nth(n % farm.held.len().max(1));
    match step {
        Step::Join(threads) => {
            farm.join(threads);
        }
        Step::JoinUnready => {
            let worker = WorkerKey(farm.next);
            farm.next += 1;
            farm.held.insert(worker, BTreeMap::new());
            farm.tell(Event::Joined { worker, threads: 1, instance: InstanceId(worker.0), own: false });
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
                forge(farm, worker, (LeaseId(lease), Attempt(attempt)))?;
            }
        }
        Step::Again(n) => {
            if let Some((worker, lease)) = who(n).and_then(|w| Some((w, farm.nth(w, 0)?))) {
                deliver_twice(farm, worker, lease)?;
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
    Ok(())
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
            happen(&mut farm, step)?;
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
