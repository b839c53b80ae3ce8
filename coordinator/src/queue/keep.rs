//! How much of what is done is kept.

use std::str::FromStr;
use std::time::Duration;

use worker::Bytes;

/// A picture that nobody fetched stays for so long, whatever else.
const UNFETCHED: Duration = Duration::from_secs(24 * 3600);

/// Bounds of the store of finished jobs: the oldest go first, and none that was not fetched within its first day.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Keep {
    /// Everything.
    #[default]
    All,
    /// Pictures of so many bytes together.
    Bytes(u64),
    /// Pictures for so long.
    For(Duration),
}

/// A finished job, as far as it matters here.
#[derive(Clone, Copy, Debug)]
pub(super) struct Finished {
    pub(super) id: u64,
    pub(super) bytes: u64,
    pub(super) ended_ms: u64,
    pub(super) fetched: bool,
}

impl FromStr for Keep {
    type Err = String;

    /// A size (`20G`), or a time in days or hours (`30d`, `12h`).
    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("{text:?} is neither a size, such as 20G, nor a time, such as 30d or 12h");
        let time = |unit: char, seconds: f64| {
            let number: f64 = text.trim().strip_suffix(unit)?.parse().ok()?;
            (number.is_finite() && (0.0..1e6).contains(&number)).then(|| Duration::from_secs_f64(number * seconds))
        };
        match time('d', 86_400.0).or_else(|| time('h', 3600.0)) {
            Some(time) => Ok(Self::For(time)),
            None => text.parse().map(|Bytes(bytes)| Self::Bytes(bytes)).map_err(|_| wrong()),
        }
    }
}

impl Keep {
    /// The jobs to be forgotten.
    pub(super) fn superfluous(self, finished: &[Finished], now_ms: u64) -> Vec<u64> {
        let age = |f: &Finished| Duration::from_millis(now_ms.saturating_sub(f.ended_ms));
        let may_go = |f: &&Finished| f.fetched || age(f) >= UNFETCHED;
        match self {
            Self::All => Vec::new(),
            Self::For(time) => finished.iter().filter(may_go).filter(|f| age(f) > time).map(|f| f.id).collect(),
            Self::Bytes(most) => {
                let mut sum: u64 = finished.iter().map(|f| f.bytes).sum();
                let mut oldest: Vec<&Finished> = finished.iter().filter(may_go).collect();
                oldest.sort_by_key(|f| (f.ended_ms, f.id));
                let mut gone = Vec::new();
                for f in oldest {
                    if sum <= most {
                        break;
                    }
                    sum -= f.bytes;
                    gone.push(f.id);
                }
                gone
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_oldest_go_first_and_none_that_nobody_has_yet() {
        let day = 24 * 3600 * 1000;
        let finished = |id, ended_ms, fetched| Finished { id, bytes: 10, ended_ms, fetched };
        let all =
            [finished(1, 0, false), finished(2, day, true), finished(3, day + 5, false), finished(4, day + 6, true)];
        assert!(Keep::All.superfluous(&all, 2 * day).is_empty());
        assert_eq!(Keep::Bytes(25).superfluous(&all, day + 10), [1, 2]);
        assert_eq!(Keep::Bytes(0).superfluous(&all, day + 10), [1, 2, 4]);
        assert_eq!(Keep::For(Duration::from_secs(3600)).superfluous(&all, 2 * day), [1, 2, 4]);
    }

    #[test]
    fn sizes_and_times_are_read() {
        assert_eq!("20G".parse(), Ok(Keep::Bytes(20 << 30)));
        assert_eq!("2d".parse(), Ok(Keep::For(Duration::from_secs(172_800))));
        assert_eq!("12h".parse(), Ok(Keep::For(Duration::from_secs(43_200))));
        assert!("".parse::<Keep>().is_err() && "d".parse::<Keep>().is_err() && "-1d".parse::<Keep>().is_err());
    }
}
