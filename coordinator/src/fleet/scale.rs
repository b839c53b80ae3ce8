//! How many workers the work that is left is worth.
//!
//! As in Dask's adaptive scaling, work is seconds of one worker; as in HyperQueue's automatic allocation, nothing is
//! asked for that would find its work done when it comes.

use std::str::FromStr;
use std::time::Duration;

/// How many workers there may be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    /// Kept even where there is nothing to do.
    pub min: usize,
    /// Not exceeded.
    pub max: usize,
}

/// Workers at most, of one fleet.
const MOST: usize = 10_000;

impl FromStr for Size {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("expected a number of workers, such as 8, or a range, such as 0..64; at most {MOST}");
        let (min, max) = text.split_once("..").unwrap_or((text, text));
        let number = |text: &str| text.trim().parse::<usize>().map_err(|_| wrong());
        let size = Self { min: number(min)?, max: number(max)? };
        if size.min <= size.max && (1..=MOST).contains(&size.max) { Ok(size) } else { Err(wrong()) }
    }
}

/// What a farm has to do, and who does it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Demand {
    /// Whether there is anything to do.
    pub has_work: bool,
    /// Seconds that one worker would take for all of it, as far as can be told.
    pub work: Option<f64>,
    /// Workers that are connected, of whatever origin.
    pub workers: usize,
    /// Whether there will be no more work.
    pub over: bool,
}

/// When workers come and go.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Scaling {
    /// How many.
    pub size: Size,
    /// Work for each worker that makes another worth starting.
    pub worth: Duration,
    /// For how long there has to be too little work until workers leave.
    pub idle: Duration,
}

/// The share of [`Scaling::worth`] that a worker is kept for, once it is there.
const KEEP: f64 = 0.25;

impl Scaling {
    /// How many workers there should be where `held` are there or awaited, of which the farm had too little work for
    /// the last one during `slack`.
    #[must_use]
    pub fn wanted(&self, demand: &Demand, held: usize, slack: Duration) -> usize {
        let Size { min, max } = self.size;
        if demand.over {
            return 0;
        }
        let worth = self.worth.as_secs_f64().max(1e-3);
        let enough = |each: f64| match demand.work {
            _ if !demand.has_work => min,
            // The first one will tell.
            None => held.max(1),
            Some(work) => ((work.max(0.0) / each).ceil().min(max as f64) as usize).max(1),
        };
        let (start, keep) = (enough(worth).clamp(min, max), enough(KEEP * worth).clamp(min, max));
        match held {
            held if held < start => start,
            held if held > keep && slack >= self.idle => keep,
            held => held.min(max),
        }
    }

    /// Whether there is too little work for all of `held`.
    #[must_use]
    pub fn is_slack(&self, demand: &Demand, held: usize) -> bool {
        self.wanted(demand, held, Duration::MAX) < held
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const SCALING: Scaling =
        Scaling { size: Size { min: 0, max: 8 }, worth: Duration::from_secs(20), idle: Duration::from_secs(30) };

    fn work(seconds: f64) -> Demand {
        Demand { has_work: true, work: Some(seconds), workers: 0, over: false }
    }

    fn wanted(demand: Demand, held: usize, slack: u64) -> usize {
        SCALING.wanted(&demand, held, Duration::from_secs(slack))
    }

    #[test]
    fn sizes_are_numbers_or_ranges() {
        assert_eq!("8".parse(), Ok(Size { min: 8, max: 8 }));
        assert_eq!("0..64".parse(), Ok(Size { min: 0, max: 64 }));
        for bad in ["", "0", "0..0", "5..4", "-1", "1..", "..2", "1..20000", "a"] {
            assert!(bad.parse::<Size>().is_err(), "{bad}");
        }
    }

    #[test]
    fn one_worker_finds_out_what_there_is_to_do_and_then_come_as_many_as_it_is_worth() {
        let unknown = Demand { work: None, ..work(0.0) };
        assert_eq!(wanted(unknown, 0, 0), 1);
        assert_eq!(wanted(unknown, 1, 99), 1);
        assert_eq!(wanted(work(50.0), 1, 0), 3);
        assert_eq!(wanted(work(1e9), 1, 0), 8);
        assert_eq!(wanted(work(1e300), 1, 0), 8);
        // The end of a job: those that are there stay, but nobody comes.
        assert_eq!(wanted(work(15.0), 3, 0), 3);
        assert_eq!(wanted(work(1.0), 0, 0), 1);
    }

    #[test]
    fn they_go_when_there_has_been_too_little_to_do_for_a_while() {
        let idle = Demand::default();
        assert_eq!(wanted(idle, 3, 29), 3);
        assert_eq!(wanted(idle, 3, 30), 0);
        assert_eq!(wanted(work(9.0), 8, 29), 8);
        assert_eq!(wanted(work(9.0), 8, 30), 2);
        assert!(SCALING.is_slack(&idle, 1) && !SCALING.is_slack(&idle, 0) && !SCALING.is_slack(&work(100.0), 8));
        assert_eq!(wanted(Demand { over: true, ..work(1e6) }, 3, 0), 0);
    }

    proptest! {
        #[test]
        fn the_bounds_hold_and_more_work_never_means_fewer(
            (min, more) in (0usize..50, 0usize..50),
            (a, b) in (0.0..1e5f64, 0.0..1e5f64),
            (held, slack) in (0usize..120, 0u64..100),
            has_work in any::<bool>(),
        ) {
            let scaling = Scaling { size: Size { min, max: (min + more).max(1) }, ..SCALING };
            let slack = Duration::from_secs(slack);
            let of = |seconds| scaling.wanted(&Demand { has_work, ..work(seconds) }, held, slack);
            let (less, more) = (of(a.min(b)), of(a.max(b)));
            prop_assert!(less <= more);
            prop_assert!(less >= min && more <= scaling.size.max);
            // What is reached is not left again at once.
            let again = scaling.wanted(&Demand { has_work, ..work(a) }, of(a), Duration::ZERO);
            prop_assert_eq!(again, of(a));
        }
    }
}
