//! Readers of what strangers write, given inputs near those of the corpus. A few thousand by default, the same ones
//! each time; `TESSERA_FUZZ_SECONDS` searches for so long a target, from `TESSERA_FUZZ_SEED` on.

use std::time::Duration;

use tessera_tests::fuzz::{Effort, search, target};

/// Inputs tried by default.
const INPUTS: u64 = 4000;

fn stands(name: &str) {
    let number = |variable: &str| std::env::var(variable).ok().and_then(|n| n.parse().ok());
    let seconds = number("TESSERA_FUZZ_SECONDS").map(Duration::from_secs);
    let effort = seconds.map_or(Effort::Inputs(INPUTS), Effort::Time);
    let seed = number("TESSERA_FUZZ_SEED").unwrap_or(17);
    match search(&target(name), seed, effort) {
        Ok(tried) => println!("{name}: {tried} inputs"),
        Err(crash) => {
            let path = std::env::temp_dir().join(format!("tessera-crash-{name}"));
            let kept = std::fs::write(&path, &crash.input);
            panic!("{name}: {}\nthe input is in '{}' ({kept:?})", crash.said, path.display());
        }
    }
}

#[test]
fn scene_text() {
    stands("scene_text");
}

#[test]
fn pixmap() {
    stands("pixmap");
}

#[test]
fn scene_binary() {
    stands("scene_binary");
}

#[test]
fn journal() {
    stands("journal");
}

#[test]
fn worker_message() {
    stands("worker_message");
}

#[test]
fn coordinator_message() {
    stands("coordinator_message");
}

#[test]
fn token() {
    stands("token");
}

/// Where a form changes, its corpus is written anew: `cargo test -p tessera-tests --test fuzz -- --ignored`.
#[test]
#[ignore = "it writes into the repository"]
fn write_the_corpus() -> std::io::Result<()> {
    tessera_tests::fuzz::seeds::write()
}
