//! Leases in, pixels out: the worker's threads and the queue before them.

use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use rayon::ThreadPool;
use tessera_core::film::{ErrorEstimate, Tile, encode};
use tessera_core::settings::Transfer;
use tessera_core::trace::RayCounts;
use tessera_proto::convert::{Lease, TileDone, pixel_bytes};
use tessera_proto::limits::MAX_LEASES;
use tessera_proto::packed::pack;
use tessera_proto::wire::{self, WorkerMessage, worker_message::Kind};
use tessera_proto::{LeaseId, PixelFormat, Pixels, TraceContext};
use tokio::sync::mpsc;
use tracing::field::Empty;
use tracing::{Span, info_span};

use crate::renderer::TileTracer;
use crate::spans::{SPANS, under};

/// What renders a job's tiles, and how they travel.
pub(crate) struct JobTracer {
    pub(crate) tracer: Arc<dyn TileTracer>,
    pub(crate) format: PixelFormat,
    pub(crate) transfer: Transfer,
    /// What spans of its tiles are under that have no lease's.
    pub(crate) trace: Option<TraceContext>,
}

impl JobTracer {
    /// The span of a tile, under that of its lease where that has one.
    fn span(&self, lease: &Lease, of_lease: u64) -> Span {
        let r = lease.region;
        let span = info_span!(
            target: SPANS, parent: None, "trace tile",
            region = format_args!("{},{},{},{}", r.x0, r.y0, r.x1, r.y1), outcome = Empty, rays = Empty,
        );
        let parent = self.trace.map(|t| if of_lease == 0 { t } else { TraceContext { span: of_lease, ..t } });
        under(span, parent)
    }
}

/// Renders one session's leases, oldest first, on a rayon pool.
///
/// Deliveries go into a bounded channel: where the network is slower than the threads, the
/// threads wait, and memory does not grow. When it is dropped, what is at work is given up.
pub(crate) struct LeaseQueue(Arc<Inner>);

impl Drop for LeaseQueue {
    fn drop(&mut self) {
        self.clear();
        self.give_up();
    }
}

struct Inner {
    pool: Arc<ThreadPool>,
    /// Leases rendered at once: two where there are many threads, so that none stands still
    /// while the last ones finish a tile.
    at_once: usize,
    out: mpsc::Sender<WorkerMessage>,
    /// Whether pixels are packed, for a slow line.
    pack: AtomicBool,
    desk: Mutex<Desk>,
}

/// A lease that was not begun, and the span of it where it has one, else 0.
struct Queued {
    lease: Lease,
    span: u64,
    job: Arc<JobTracer>,
}

struct Desk {
    /// What renders the leases that come; `None` while no job is ready.
    job: Option<Arc<JobTracer>>,
    queue: VecDeque<Queued>,
    running: usize,
    /// Those that are rendered now, and whether they are not wanted any more.
    at_work: Vec<(Lease, Arc<AtomicBool>)>,
    /// Nobody waits for what is rendered.
    given_up: bool,
    /// When a tile was last finished; before the first, when the session began.
    last_end: Instant,
    /// When the network last took one: threads that wait for that do not want for leases.
    last_sent: Instant,
}

impl LeaseQueue {
    pub(crate) fn new(pool: Arc<ThreadPool>, out: mpsc::Sender<WorkerMessage>) -> Self {
        let at_once = if pool.current_num_threads() > 1 { 2 } else { 1 };
        let now = Instant::now();
        let desk = Mutex::new(Desk {
            job: None,
            queue: VecDeque::new(),
            running: 0,
            at_work: Vec::new(),
            given_up: false,
            last_end: now,
            last_sent: now,
        });
        Self(Arc::new(Inner { pool, at_once, out, pack: AtomicBool::new(false), desk }))
    }

    /// Says whether the line is slow, so that pixels had better be packed.
    pub(crate) fn pack(&self, pack: bool) {
        self.0.pack.store(pack, Ordering::Relaxed);
    }

    /// Renders by `job` what comes from now on; without one, nothing may come. Gives the leases of the job before
    /// that were not begun.
    pub(crate) fn turn_to(&self, job: Option<JobTracer>) -> Vec<Lease> {
        let mut desk = self.0.desk();
        if job.is_some() {
            // The time that preparing took was not spent waiting for leases.
            desk.last_end = Instant::now();
        }
        desk.job = job.map(Arc::new);
        desk.queue.drain(..).map(|queued| queued.lease).collect()
    }

    /// Adds a lease, and its span or 0, to the queue; false where that holds too many, or no job is ready.
    pub(crate) fn take(&self, lease: Lease, span: u64) -> bool {
        let mut desk = self.0.desk();
        let Some(job) = desk.job.clone().filter(|_| desk.queue.len() < MAX_LEASES) else { return false };
        desk.queue.push_back(Queued { lease, span, job });
        if desk.running < self.0.at_once {
            desk.running += 1;
            let inner = self.0.clone();
            self.0.pool.spawn(move || inner.run());
        }
        true
    }

    /// Gives the leases that are rendered now; what becomes of them is delivered no more.
    pub(crate) fn give_up(&self) -> Vec<Lease> {
        let mut desk = self.0.desk();
        desk.given_up = true;
        let at_work = std::mem::take(&mut desk.at_work);
        at_work.iter().for_each(|(_, unwanted)| unwanted.store(true, Ordering::Relaxed));
        at_work.into_iter().map(|(lease, _)| lease).collect()
    }

    /// Takes a lease off the queue, if it has not begun; else it is stopped, and given back where it is rendered.
    pub(crate) fn revoke(&self, lease: LeaseId) -> Option<Lease> {
        let mut desk = self.0.desk();
        if let Some((_, unwanted)) = desk.at_work.iter().find(|(l, _)| l.id == lease) {
            unwanted.store(true, Ordering::Relaxed);
            return None;
        }
        let at = desk.queue.iter().position(|queued| queued.lease.id == lease)?;
        desk.queue.remove(at).map(|queued| queued.lease)
    }

    /// Takes everything off the queue.
    pub(crate) fn clear(&self) -> Vec<Lease> {
        self.0.desk().queue.drain(..).map(|queued| queued.lease).collect()
    }

    /// Whether nothing is being rendered or delivered.
    pub(crate) fn is_still(&self) -> bool {
        self.0.desk().running == 0
    }
}

impl Inner {
    fn desk(&self) -> MutexGuard<'_, Desk> {
        self.desk.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Renders from the queue until it is empty or nobody wants the results.
    fn run(&self) {
        loop {
            let unwanted = Arc::new(AtomicBool::new(false));
            let (Queued { lease, span, job }, start, idle) = {
                let mut desk = self.desk();
                let Some(queued) = desk.queue.pop_front().filter(|_| !self.out.is_closed()) else {
                    desk.running -= 1;
                    return;
                };
                let start = Instant::now();
                desk.at_work.push((queued.lease, Arc::clone(&unwanted)));
                let before = desk.last_end.max(desk.last_sent).min(start);
                let idle = if desk.running == 1 { start - before } else { Duration::ZERO };
                (queued, start, idle)
            };
            let span = job.span(&lease, span);
            let rendered = render(&job, &lease, &unwanted);
            let is_unwanted = || unwanted.load(Ordering::Relaxed);
            let (id, attempt) = (lease.id.0, lease.attempt.0);
            let kind = match rendered {
                // What it came to says nothing, whatever it is.
                _ if is_unwanted() => {
                    span.record("outcome", "unwanted");
                    Kind::LeaseReturned(wire::LeaseReturned { lease: id, attempt })
                }
                Ok((pixels, error, rays)) => {
                    span.record("outcome", "done").record("rays", rays.total());
                    let pixels = pixel_bytes(&pixels);
                    let mut desk = self.desk();
                    let end = Instant::now();
                    let busy = end - start.max(desk.last_end).min(end);
                    desk.last_end = end;
                    drop(desk);
                    let done = TileDone { lease: lease.id, attempt: lease.attempt, pixels, error, rays, busy, idle };
                    Kind::TileDone(self.packed(done.into(), job.format))
                }
                Err(cause) => {
                    span.record("outcome", "failed");
                    Kind::TileFailed(wire::TileFailed { lease: id, attempt, cause })
                }
            };
            // Before whoever waits for the tile hears of it.
            drop(span);
            let mut desk = self.desk();
            desk.at_work.retain(|(l, _)| l.id != lease.id);
            desk.last_end = Instant::now();
            let given_up = desk.given_up;
            drop(desk);
            if given_up || self.out.blocking_send(WorkerMessage { kind: Some(kind) }).is_err() {
                let mut desk = self.desk();
                desk.queue.clear();
                desk.running -= 1;
                return;
            }
            self.desk().last_sent = Instant::now();
        }
    }
}

impl Inner {
    /// A delivery as it travels.
    fn packed(&self, done: wire::TileDone, format: PixelFormat) -> wire::TileDone {
        let bytes = format.bytes_per_pixel();
        let packed = self.pack.load(Ordering::Relaxed).then(|| pack(&done.pixels, bytes)).flatten();
        match packed {
            Some(pixels) => wire::TileDone { pixels, packed: bytes as u32, ..done },
            None => done,
        }
    }
}

/// Renders one tile; a panic of the tracer is its cause of failure.
fn render(
    job: &JobTracer,
    lease: &Lease,
    unwanted: &Arc<AtomicBool>,
) -> Result<(Pixels, ErrorEstimate, RayCounts), String> {
    let render = || job.tracer.render_wanted(lease.region, lease.pass, unwanted);
    let (tile, rays) = catch_unwind(AssertUnwindSafe(render)).map_err(|panic| {
        let said = panic.downcast_ref::<&str>().map(|s| (*s).to_owned());
        let said = said.or_else(|| panic.downcast_ref::<String>().cloned());
        format!("the tracer stopped: {}", said.unwrap_or_default())
    })?;
    if tile.region != lease.region || tile.pixels.len() as u64 != lease.region.area() {
        return Err("the tracer rendered something else".into());
    }
    if !tile.pixels.as_flattened().iter().all(|c| c.is_finite()) {
        return Err("a pixel is not finite".into());
    }
    let error = tile.error;
    Ok((encode_tile(tile, job.format, job.transfer), error, rays))
}

/// A tile's pixels as they travel.
#[must_use]
pub fn encode_tile(tile: Tile, format: PixelFormat, transfer: Transfer) -> Pixels {
    match format {
        PixelFormat::Rgb8 => Pixels::Rgb8(encode::to_bytes(transfer, &tile.pixels)),
        PixelFormat::Rgb16 => Pixels::Rgb16(encode::to_words(transfer, &tile.pixels)),
        PixelFormat::F32 => Pixels::F32(tile.pixels),
    }
}

#[cfg(test)]
mod tests {
    use tessera_core::film::Region;
    use tessera_core::settings::Pass;
    use tessera_proto::{Attempt, PassNumber};

    use super::*;

    /// Renders nothing before it is let go.
    struct Held(Arc<Mutex<()>>);

    impl TileTracer for Held {
        fn render(&self, region: Region) -> (Tile, RayCounts) {
            let _held = self.0.lock().unwrap_or_else(PoisonError::into_inner);
            let pixels = vec![[0.0; 3]; region.area() as usize];
            (Tile { region, pixels, error: ErrorEstimate::default() }, RayCounts::default())
        }
    }

    fn lease(id: u64) -> Lease {
        let region = Region { x0: 0, y0: 0, x1: 1, y1: 1 };
        Lease { id: LeaseId(id), attempt: Attempt(0), region, number: PassNumber(0), pass: None }
    }

    #[test]
    fn a_coordinator_cannot_fill_the_queue_without_end_and_what_is_given_up_is_not_delivered() {
        let held = Arc::new(Mutex::new(()));
        let pool = Arc::new(rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap());
        let (out, mut delivered) = mpsc::channel(1);
        let foreman = LeaseQueue::new(pool, out);
        assert!(!foreman.take(lease(0), 0), "no job is ready");
        let (format, transfer) = (PixelFormat::Rgb8, Transfer::Linear);
        foreman.turn_to(Some(JobTracer { tracer: Arc::new(Held(held.clone())), format, transfer, trace: None }));
        let hold = held.lock().unwrap();
        let taken = (0..2 * MAX_LEASES as u64).take_while(|&n| foreman.take(lease(n), 0)).count();
        assert!((MAX_LEASES..MAX_LEASES + 2).contains(&taken), "{taken}");
        while foreman.0.desk().at_work.is_empty() {
            std::thread::yield_now();
        }
        foreman.clear();
        assert_eq!(foreman.give_up().len(), 1);
        drop(hold);
        while !foreman.is_still() {
            std::thread::yield_now();
        }
        assert!(delivered.try_recv().is_err());
    }

    /// Renders until nobody wants it.
    struct Endless;

    impl TileTracer for Endless {
        fn render_wanted(&self, region: Region, _: Option<Pass>, unwanted: &Arc<AtomicBool>) -> (Tile, RayCounts) {
            while !unwanted.load(Ordering::Relaxed) {
                std::thread::yield_now();
            }
            self.render(region)
        }

        fn render(&self, region: Region) -> (Tile, RayCounts) {
            // Of the wrong size: nobody looks at it.
            (Tile { region, pixels: Vec::new(), error: ErrorEstimate::default() }, RayCounts::default())
        }
    }

    #[test]
    fn a_tile_without_end_is_stopped_when_it_is_revoked_and_when_the_session_ends() {
        let pool = Arc::new(rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap());
        let (out, mut delivered) = mpsc::channel(4);
        let foreman = LeaseQueue::new(pool.clone(), out);
        let (format, transfer) = (PixelFormat::Rgb8, Transfer::Linear);
        foreman.turn_to(Some(JobTracer { tracer: Arc::new(Endless), format, transfer, trace: None }));
        let begun = |id| {
            while !foreman.0.desk().at_work.iter().any(|(l, _)| l.id == LeaseId(id)) {
                std::thread::yield_now();
            }
        };
        foreman.take(lease(1), 0);
        begun(1);
        assert!(foreman.revoke(LeaseId(1)).is_none(), "it is at work");
        let answer = delivered.blocking_recv().unwrap().kind;
        assert_eq!(answer, Some(Kind::LeaseReturned(wire::LeaseReturned { lease: 1, attempt: 0 })));
        foreman.take(lease(2), 0);
        begun(2);
        drop(foreman);
        // The one thread is free again, and nothing more was said.
        pool.install(|| ());
        assert!(delivered.blocking_recv().is_none());
    }
}
