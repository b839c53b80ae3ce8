//! What a farm of thousands comes to, simulated: the real scheduler, tiles that cost what a real render's cost.

use std::time::Duration;

use coordinator::simulation::{CostMap, Outcome, Setup, Trouble, simulate};
use tessera_tests::costs;

fn run(name: &str, setup: &Setup) -> Outcome {
    let outcome = simulate(setup);
    println!("{name}: {:.2} % of use, tail {:.3}, {outcome:?}", 100.0 * outcome.efficiency, outcome.tail());
    outcome
}

fn map(scene: &str) -> CostMap {
    costs::read(scene).expect("costs were measured")
}

fn seconds(seconds: u64) -> Duration {
    Duration::from_secs(seconds)
}

/// Ten minutes with a thousand workers: a tenth of the time, in which beginning and end weigh ten times as much.
#[test]
fn a_thousand_workers_are_of_use() {
    for scene in ["demo", "lights"] {
        let o = run(scene, &Setup::new(1000, seconds(60), map(scene)));
        assert!(o.efficiency >= 0.95, "{scene}: {}", o.efficiency);
        assert!(o.tail() <= 1.1, "{scene}: {}", o.tail());
        assert!(o.waiting <= 0.005, "{scene}: {}", o.waiting);
    }
}

/// An hour with ten thousand workers: a minute of it, and as much less of a scene to fetch.
#[test]
fn ten_thousand_workers_are_of_use() {
    let o = run("demo", &Setup { scene: 64 << 10, ..Setup::new(10_000, seconds(60), map("demo")) });
    assert!(o.efficiency >= 0.9, "{}", o.efficiency);
    assert!(o.tail() <= 1.1, "{}", o.tail());
    assert!(o.load < 0.9, "{}", o.load);
}

/// Whatever goes wrong with some of them, the others are of use.
#[test]
fn trouble_costs_little() {
    let trouble = Trouble { late: 0.2, slow: 0.05, killed: 0.05, cut: 0.05, resent: 0.005 };
    for seed in 1..4 {
        let o = run("trouble", &Setup { trouble, seed, ..Setup::new(500, seconds(60), map("demo")) });
        assert!(o.efficiency >= 0.9, "{}", o.efficiency);
        assert!(o.tail() <= 1.1, "{}", o.tail());
    }
}

/// A long way costs what it takes to connect, and to find out how much has to be on it.
#[test]
fn a_long_way_costs_little() {
    for round_trip in [1, 20, 200].map(Duration::from_millis) {
        let setup = Setup { round_trip: (round_trip, round_trip), ..Setup::new(200, seconds(60), map("demo")) };
        let o = run(&format!("{round_trip:?}"), &setup);
        assert!(o.efficiency >= 0.95, "{round_trip:?}: {}", o.efficiency);
        assert!(o.tail() <= 1.1, "{round_trip:?}: {}", o.tail());
    }
}

/// Few workers have nothing of a crowd's.
#[test]
fn few_workers_are_of_use() {
    for workers in 1..12 {
        for seed in 0..4 {
            let o = run(&format!("{workers}"), &Setup { seed, ..Setup::new(workers, seconds(20), map("demo")) });
            assert!(o.efficiency >= 0.95, "{workers} workers, seed {seed}: {}", o.efficiency);
            assert!(o.tail() <= 1.1, "{workers} workers, seed {seed}: {}", o.tail());
        }
    }
}

/// The same setup gives the same run.
#[test]
fn runs_can_be_had_again() {
    let trouble = Trouble { late: 0.2, slow: 0.1, killed: 0.1, cut: 0.1, resent: 0.01 };
    let setup = Setup { trouble, ..Setup::new(50, seconds(10), map("demo")) };
    // What the scheduler itself took is this machine's.
    let timeless = |o: Outcome| Outcome { scheduler: Duration::ZERO, scheduler_longest: Duration::ZERO, ..o };
    assert_eq!(timeless(simulate(&setup)), timeless(simulate(&setup)));
}
