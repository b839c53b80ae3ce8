//! A farm of thousands, simulated: the real [scheduler](crate), workers that do what workers do, and a network, a
//! clock and costs of pixels that are made up or measured. Nothing is rendered, and nothing waits.
//!
//! What is simulated: two ways for each worker, in order and without losing anything, with a delay, a width and
//! retransmissions; a coordinator that takes in one message after another, each for a given time, behind one line of a
//! given width; workers of unlike threads and speed, some of which become slow, are killed, lose their connection, or
//! come late. A seed decides everything, so that any run can be had again.
//!
//! What is not: what heartbeats cost (they wait in no queue), verification, several jobs, and what the threads of a
//! worker do to each other.

pub mod costs;
pub(crate) mod message;
pub(crate) mod network;
pub(crate) mod renderer;
mod report;
mod sides;
mod worker;
mod world;

use std::time::Duration;

pub use costs::CostMap;
pub use report::Outcome;

pub use crate::scheduler::{MODEL, Model};

/// A farm and its job.
#[derive(Clone, Debug)]
pub struct Setup {
    /// What decides everything that is drawn.
    pub seed: u64,
    /// Workers.
    pub workers: u32,
    /// Size of the picture in pixels.
    pub picture: (u32, u32),
    /// What its parts cost.
    pub costs: CostMap,
    /// How long all workers would take for it, were everyone busy from the first instant to the last.
    pub job: Duration,
    /// How long a thread takes for a sample of usual cost: pixels that take longer have more samples, as is known before.
    pub sample: Duration,
    /// Least and greatest time to a worker and back; each worker's is drawn between them, evenly by its logarithm.
    pub round_trip: (Duration, Duration),
    /// Bytes a second of a worker's line.
    pub line: f64,
    /// The fastest thread is so many times as fast as the slowest.
    pub unlike: f64,
    /// Threads of workers, each as likely as the others.
    pub threads: Vec<u32>,
    /// Bytes of a pixel on its way.
    pub bytes_per_pixel: u64,
    /// Bytes of the scene, which every worker fetches from the coordinator.
    pub scene: u64,
    /// How long workers take to prepare it, at most; half of that at least.
    pub prepare: Duration,
    /// What goes wrong.
    pub trouble: Trouble,
    /// What the coordinator can do.
    pub service: Service,
    /// What the scheduler takes costs and times to be.
    pub model: Model,
}

/// What goes wrong, as shares of all workers, spread evenly over the job's time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Trouble {
    /// Workers that come late, at any time in the first half of the job, rather than in its first seconds.
    pub late: f64,
    /// Workers that become four times as slow and stay so.
    pub slow: f64,
    /// Workers that are killed, and start again after 5 s; every second one without a word.
    pub killed: f64,
    /// Workers that lose their network for up to 10 s.
    pub cut: f64,
    /// Messages that are sent a second time, 200 ms and two delays later.
    pub resent: f64,
}

/// What the coordinator can do: one message after another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Service {
    /// Its time for each message.
    pub message: Duration,
    /// And for each byte of pixels, in nanoseconds.
    pub byte_ns: f64,
    /// Whether what the scheduler itself takes, here and now, comes on top of that: the mean so far. Two runs are not
    /// alike then.
    pub measured: bool,
    /// Bytes a second of its line, each way.
    pub line: f64,
}

impl Default for Service {
    /// What a coordinator should take at most for a tile, all of it one after another, behind 10 Gbit/s.
    fn default() -> Self {
        Self { message: Duration::from_micros(40), byte_ns: 1.0, measured: false, line: 1.25e9 }
    }
}

impl Setup {
    /// A job of `job` for so many workers of a local network, of 1, 4 and 16 threads that are up to four times as
    /// fast as others, and nothing that goes wrong. Pixels are dear, two thousand for a second of a worker, or dearer
    /// where 16,384 × 16,384 of them would not last.
    #[must_use]
    pub fn new(workers: u32, job: Duration, costs: CostMap) -> Self {
        let edge = (2e3 * f64::from(workers) * job.as_secs_f64()).sqrt().clamp(64.0, 16_384.0) as u32;
        Self {
            seed: 1,
            workers,
            picture: (edge, edge),
            costs,
            job,
            sample: Duration::from_micros(4),
            round_trip: (Duration::from_micros(200), Duration::from_micros(500)),
            line: 1.25e8,
            unlike: 4.0,
            threads: vec![1, 4, 16],
            bytes_per_pixel: 12,
            scene: 1 << 20,
            prepare: Duration::from_millis(200),
            trouble: Trouble::default(),
            service: Service::default(),
            model: MODEL,
        }
    }
}

/// Runs a farm to the end of its job.
///
/// # Panics
/// When the scheduler breaks one of its promises: a pixel done twice or not at all, room left to a worker while work
/// waits, or no end.
#[must_use]
pub fn simulate(setup: &Setup) -> Outcome {
    world::World::new(setup).run()
}
