//! What strangers write, read by the programs' own readers: for cargo-fuzz (`tests/fuzz`), and for a bounded search
//! of inputs near those of the corpus that any compiler can do.
//!
//! A target panics where a reader does, and where what was read does not survive being written and read again.

mod mutate;
pub mod seeds;
mod targets;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

pub use mutate::mutate;
pub use targets::{Target, target, targets};

use crate::generate::Random;

/// Inputs are no longer than this.
const LONGEST: usize = 1 << 16;

/// How long to search.
#[derive(Clone, Copy, Debug)]
pub enum Effort {
    /// So many inputs: the same ones wherever it is run.
    Inputs(u64),
    /// So long.
    Time(Duration),
}

/// An input that a reader does not stand.
#[derive(Debug)]
pub struct Crash {
    /// What it was given.
    pub input: Vec<u8>,
    /// What it said.
    pub said: String,
}

/// The folder of a target's corpus.
#[must_use]
pub fn corpus_folder(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus").join(name)
}

/// The corpus of a target, in the order of its files' names.
///
/// # Panics
/// When it is not there, or empty.
#[must_use]
pub fn corpus(name: &str) -> Vec<Vec<u8>> {
    let folder = corpus_folder(name);
    let mut files: Vec<PathBuf> = std::fs::read_dir(&folder)
        .unwrap_or_else(|e| panic!("no corpus at '{}': {e}", folder.display()))
        .map(|entry| entry.expect("a folder's entry").path())
        .collect();
    files.sort();
    assert!(!files.is_empty(), "an empty corpus");
    files.iter().map(|file| std::fs::read(file).expect("a file of the corpus")).collect()
}

/// Searches for an input that `target` does not stand: those of its corpus first, then ever others near them, drawn by
/// `seed`. Gives how many it tried.
///
/// # Errors
/// With the first that is found.
pub fn search(target: &Target, seed: u64, effort: Effort) -> Result<u64, Crash> {
    let mut corpus = corpus(target.name);
    for input in &corpus {
        attempt(target, input)?;
    }
    let mut random = Random::new(seed);
    let (mut tried, began) = (corpus.len() as u64, Instant::now());
    loop {
        let enough = match effort {
            Effort::Inputs(most) => tried >= most,
            Effort::Time(most) => tried.is_multiple_of(64) && began.elapsed() >= most,
        };
        if enough {
            return Ok(tried);
        }
        let mut input = corpus[random.below(corpus.len() as u64) as usize].clone();
        mutate(&mut input, &corpus, target.words, &mut random);
        input.truncate(LONGEST);
        tried += 1;
        let accepted = attempt(target, &input)?;
        // What is sound and new leads on to more; a place in the corpus is for few.
        if accepted && random.one_in(8) {
            if corpus.len() < 512 {
                corpus.push(input);
            } else {
                let place = random.below(512) as usize;
                corpus[place] = input;
            }
        }
    }
}

/// Gives whether the reader took the input.
fn attempt(target: &Target, input: &[u8]) -> Result<bool, Crash> {
    catch_unwind(AssertUnwindSafe(|| (target.reads)(input))).map_err(|panic| {
        let said = panic.downcast_ref::<String>().cloned();
        let said = said.or_else(|| panic.downcast_ref::<&str>().map(|s| (*s).to_owned()));
        Crash { input: input.to_vec(), said: said.unwrap_or_default() }
    })
}
