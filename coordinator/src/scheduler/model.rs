//! What the scheduler assumes of costs and times, in one place.
//!
//! *Fitted* values are measured anew, and *simulated* ones varied in a crowd under the simulated network, by
//! `cargo xtask calibrate`. *Chosen* ones say what is wanted, and no measurement could tell them.

use std::time::Duration;

/// Constants of the scheduler.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Model {
    /// The most of a worker's time that one tile should take, in a small crowd. Simulated, and chosen for who
    /// watches: a tenth of a second is the longest that still seems to be at once.
    pub longest: Duration,
    /// The least of a worker's time that is worth a tile of its own, in a small crowd. Simulated: a tile costs the
    /// coordinator 6 µs with few workers (`docs/figures.md`), which is 0.4 % of this.
    pub shortest: Duration,
    /// The coordinator's own time that a tile may take: with so many workers, tiles last so many times that. Fitted:
    /// with 2,000 workers a tile takes 39 to 51 µs of processor time, heartbeats included (`docs/figures.md`).
    pub each: Duration,
    /// A tile is one part in so many of a worker's fair share of what is left. Simulated: guided self-scheduling
    /// takes 1, which is right where every tile of a size costs as much.
    pub parts: f64,
    /// One part of a picture counts as at most so many times as dear as it is on the whole. Fitted as a bound: the
    /// dearest square of 16 × 16 pixels costs up to 4.8 times the mean of its picture (`tests/costs`), and what a
    /// worker meets in single tiles varies more.
    pub most_spread: f64,
    /// Pixels that one thread is given while nothing is measured, at one sample a pixel. Fitted: they take 0.5 to 26
    /// ms in the scenes of `tests/costs`, which no worker is kept waiting by.
    pub probe: f64,
    /// The least pixels worth a tile while nothing is measured. Chosen: what begins a picture shows something of it.
    pub least_probe: f64,
    /// The least pixels of any tile. Chosen: a square of 8 × 8, which the tracer proves as a whole.
    pub least: f64,
    /// Work that a worker is given ahead. Fitted: on a machine whose cores all render, its answers and the next
    /// leases wait for a processor about as long; demo through the farm took 0.078 rather than 0.084 s.
    pub ahead: Duration,
    /// How much what was measured before the latest tile counts beside it. Simulated: that is the speed over the last
    /// four tiles. Over one alone, a worker that renders two at once is taken for a hundred times too fast.
    pub memory: f64,
    /// Only what is overdue by this much more is taken to be overdue. Chosen: twice [`Self::ahead`], which any answer
    /// may have to wait.
    pub slack: Duration,
    /// Somebody else takes a tile over where that is quicker than its holder by such a factor. Chosen: speeds are not
    /// known better than that.
    pub quicker: f64,
    /// Pause between two looks for late tiles, for each open lease and each worker: a look walks over all of them.
    /// Chosen: far more than it takes for them, so that looks are a small part of the time.
    pub look_every: Duration,
    /// A worker that takes so many times as long as it should for a tile is stuck. Chosen: one that shares its
    /// machine with another program comes to twice.
    pub stuck: u32,
    /// There one part of a picture counts as at most so many times as dear as it is on the whole. Fitted: in each
    /// scene of `tests/costs` 9 of 10 squares of 16 × 16 pixels cost less than that.
    pub stuck_spread: u32,
    /// And it is stuck only if it is so much later, too. Chosen: longer than a message that is sent again takes.
    pub stuck_slack: Duration,
    /// Bytes of results that a line may have on their way before anything of it is known. Chosen: two seconds at 1
    /// Mbit/s, the slowest line that is thought of.
    pub first_bytes: u64,
    /// And at least. Chosen: what a network sends in three packets.
    pub least_bytes: u64,
    /// Waiting on a line that is no trouble yet. Chosen: longer than a packet that is sent again takes.
    pub wait: Duration,
    /// Workers lost closer together than this have one cause. Chosen: what a switch or a batch system ends, it ends
    /// within it.
    pub together: Duration,
    /// How long a tile is let lie at which more than one worker was lost. Chosen: whatever else may be killing
    /// workers one after another has then shown itself.
    pub pause: Duration,
    /// A gap between two events that says that this process itself stood still. Chosen: ticks come every quarter
    /// of a second at least.
    pub stall: Duration,
    /// How long after a stall connections break that could not be kept. Chosen: three times the silence that ends a
    /// session.
    pub amnesty: Duration,
}

/// The constants as they are.
pub const MODEL: Model = Model {
    longest: Duration::from_millis(100),
    shortest: Duration::from_micros(1500),
    each: Duration::from_micros(50),
    parts: 4.0,
    most_spread: 16.0,
    probe: 4096.0,
    least_probe: 256.0,
    least: 64.0,
    ahead: Duration::from_millis(10),
    memory: 0.75,
    slack: Duration::from_millis(20),
    quicker: 1.25,
    look_every: Duration::from_micros(4),
    stuck: 3,
    stuck_spread: 2,
    stuck_slack: Duration::from_millis(250),
    first_bytes: 256 << 10,
    least_bytes: 4 << 10,
    wait: Duration::from_millis(300),
    together: Duration::from_secs(2),
    pause: Duration::from_millis(500),
    stall: Duration::from_secs(1),
    amnesty: Duration::from_secs(15),
};
