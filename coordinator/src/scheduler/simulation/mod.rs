//! A farm under a simulated network and clock: the real scheduler, and workers that do what workers do.
//! A seed decides everything, so that any run can be had again:
//!
//! ```sh
//! SEED=123 cargo test --release -p coordinator simulation -- --nocapture
//! ```

mod coordinator;
mod faults;
mod picture;
mod session;
mod verification;
mod worker;
mod workers;
mod world;

use std::time::Duration;

use tessera_core::film::Region;

use super::End;
use picture::Curse;
use world::World;

/// Runs that the tests take, from seed 0 on.
const RUNS: u64 = 1000;

/// The seeds to run: those of the tests, or the one asked for.
fn seeds() -> Vec<u64> {
    match std::env::var("SEED").ok().and_then(|s| s.parse().ok()) {
        Some(seed) => vec![seed],
        None => (0..RUNS).collect(),
    }
}

/// Whatever goes wrong, a worker that is well at the end is enough for the whole picture, and soon.
#[test]
fn a_thousand_farms_get_their_picture() {
    let (mut longest, mut lost, mut liars) = (Duration::ZERO, 0, 0);
    for seed in seeds() {
        let mut world = World::new(seed, None);
        let end = world.run();
        assert_eq!(end, End::Complete, "seed {seed}");
        let bound = world.bound();
        assert!(world.now <= bound, "seed {seed}: {:?}, and {bound:?} would have been right", world.now);
        longest = longest.max(world.now);
        lost += world.faults_seen;
        liars += world.thrown_out;
    }
    println!("{lost} faults, {liars} liars thrown out; the longest run took {longest:?}");
    assert!(liars > 0 || seeds().len() == 1, "nobody lied");
}

/// A tile at which every worker reports failure ends the render, whatever else goes wrong; and so does one that
/// kills every worker.
#[test]
fn a_cursed_tile_is_found() {
    for seed in seeds().into_iter().take(200) {
        for curse in [Curse::Fails, Curse::Kills] {
            let mut world = World::new(seed, Some(curse));
            let end = world.run();
            if world.verbose {
                println!("seed {seed}, {curse:?}: {:?}", world.now);
            }
            let End::TileFailed { region, .. } = end else { panic!("seed {seed}, {curse:?}: {end:?}") };
            let (x, y) = world.picture.cursed();
            let pixel = Region { x0: x, y0: y, x1: x + 1, y1: y + 1 };
            assert!(region.contains(&pixel), "seed {seed}, {curse:?}: {region:?} is blamed for {x},{y}");
        }
    }
}

/// The same seed gives the same run.
#[test]
fn runs_can_be_had_again() {
    let trace = |seed| {
        let mut world = World::new(seed, None);
        world.run();
        (world.now, world.messages)
    };
    for seed in 0..5 {
        assert_eq!(trace(seed), trace(seed));
    }
}
