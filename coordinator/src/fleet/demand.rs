//! What a farm's progress means for its fleet.

use tessera_proto::control::{Job, State};

use super::Demand;
use crate::progress::Progress;

impl Demand {
    /// Of one render.
    #[must_use]
    pub fn of_render(progress: &Progress) -> Self {
        let workers = progress.workers.iter().filter(|w| w.connected).count();
        let work = progress.remaining.filter(|_| workers > 0).map(|left| left.as_secs_f64() * workers as f64);
        Self { has_work: true, work, workers, over: false }
    }
}

/// Of a farm that stays, by its jobs. Those that wait are taken to be as large as those that are rendered, on average.
pub fn demand_of_jobs<'a>(jobs: impl Iterator<Item = &'a Job>, workers: usize) -> Demand {
    let (mut waiting, mut known, mut unknown, mut work) = (0u64, 0u64, 0u64, 0.0);
    for job in jobs {
        let left = || {
            let progress = job.progress.as_ref()?;
            Some(progress.remaining_us? as f64 / 1e6 * f64::from(progress.workers))
        };
        match job.state() {
            State::Queued => waiting += 1,
            State::Rendering => match left().filter(|&left| left > 0.0) {
                Some(left) => {
                    known += 1;
                    work += left;
                }
                None => unknown += 1,
            },
            _ => {}
        }
    }
    let has_work = waiting + known + unknown > 0;
    let work = (known > 0).then(|| work * (1.0 + (waiting + unknown) as f64 / known as f64));
    Demand { has_work, work, workers, over: false }
}

#[cfg(test)]
mod tests {
    use tessera_proto::control::Progress;

    use super::*;

    fn job(state: State, left: Option<(u64, u32)>) -> Job {
        let progress = left.map(|(seconds, workers)| Progress {
            remaining_us: Some(seconds * 1_000_000),
            workers,
            ..Progress::default()
        });
        Job { state: state.into(), progress: progress.map(Box::new), ..Job::default() }
    }

    #[test]
    fn jobs_that_wait_count_as_much_as_those_that_are_rendered() {
        let jobs = [
            job(State::Done, None),
            job(State::Paused, None),
            job(State::Rendering, Some((10, 2))),
            job(State::Rendering, Some((10, 4))),
            job(State::Queued, None),
        ];
        let demand = demand_of_jobs(jobs.iter(), 6);
        assert_eq!(demand, Demand { has_work: true, work: Some(90.0), workers: 6, over: false });
        let none = demand_of_jobs(jobs[..2].iter(), 6);
        assert!(!none.has_work && none.work.is_none());
        let unknown = demand_of_jobs(jobs[4..].iter(), 0);
        assert!(unknown.has_work && unknown.work.is_none());
    }
}
