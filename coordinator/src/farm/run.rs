//! A job that is being rendered: its scheduler, its passes and its picture. It does what the scheduler asks for;
//! the dispatcher tells it what its workers said.

mod end;
mod figures;
mod member;
mod spans;
mod verification;

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::time::Duration;

use tessera_core::film::Region;
use tessera_core::settings::Sampling;
use tessera_proto::convert::{TileDone, check_size};
use tessera_proto::token::{NoRandomness, random};
use tessera_proto::wire::coordinator_message::Kind;
use tessera_proto::wire::{self, Revoke};
use tessera_proto::{JobNumber, PixelFormat};
use tokio::sync::{mpsc, watch};
use tokio::time::Instant;

use super::pace::Pace;
use super::passes::{Clock, Passes, Turn};
use super::roster::Roster;
use super::service::{FarmEvent, WorkerEvent};
use super::stitch::{self, Stitch, Stitcher, Tiles};
use super::verify::{Sum, Verify};
use crate::error::RenderError;
use crate::job::RenderJob;
use crate::plan::Plan;
use crate::progress::{Progress, Verification, WorkerStats};
use crate::scheduler::{self, Effect, End, Event, Scheduler, WorkerKey};
pub(crate) use end::Finished;
pub(super) use member::{Comer, Note, end_session};
use member::{Member, keep};
use spans::Spans;
use verification::{OwnCore, is_check, recall};

/// Between two looks at the signs of life of workers.
const LIVENESS_EVERY: Duration = Duration::from_millis(100);

/// The end of the render, once it is there.
type Ended = Option<Result<(), RenderError>>;

/// See the [module](self).
pub(super) struct Run {
    scheduler: Scheduler,
    heard_by: mpsc::Sender<FarmEvent>,
    /// What pixels tiles must have.
    pixels: PixelFormat,
    region: Region,
    tiles: Tiles,
    stitcher: Stitcher,
    progress: watch::Sender<Progress>,
    start: Instant,
    passes: Passes,
    pace: Pace,
    /// Whether the scheduler has begun a pass.
    leasing: bool,
    /// Tiles of the pass at hand that an earlier run did.
    tiles_of_pass: u64,
    members: BTreeMap<WorkerKey, Member>,
    /// Whose figures are where.
    roster: Roster,
    verify: Verify,
    verification: Verification,
    /// What decides where workers disagree, until it is started.
    own_core: Option<OwnCore>,
    own: Option<std::sync::mpsc::Sender<verification::Wanted>>,
    /// Tiles that this process is to render again now.
    own_busy: usize,
    /// Checks that nobody was given yet.
    unassigned: VecDeque<u64>,
    /// When signs of life are looked at next.
    pulse_at: Duration,
    last_cause: Option<String>,
    notes: Vec<Note>,
    /// Whether somebody may look at the picture meanwhile.
    is_watched: bool,
    spans: Spans,
    end: Ended,
}

/// The scheduler of `job`, whose leases have its number; `hired`: so many workers of this process will come.
fn scheduler_of(number: JobNumber, job: &RenderJob, hired: usize) -> Scheduler {
    let samples = match job.settings.sampling {
        Sampling::Uniform { grid } => grid * grid,
        Sampling::Scrambled { samples } => samples,
        // What every pixel begins with, and what a few get beyond.
        Sampling::Adaptive => 6,
    };
    let mut scheduler = Scheduler::new(scheduler::Config {
        region: job.region,
        tile: job.tile,
        samples,
        expected: hired,
        bytes_per_pixel: job.pixels.bytes_per_pixel() as u64,
        patience: job.patience,
        suspect_after: job.timing.suspect_after,
        dead_after: job.timing.dead_after,
        prepare_within: job.timing.prepare_within,
        model: scheduler::MODEL,
    });
    scheduler.number_leases(number);
    scheduler
}

impl Run {
    /// Starts `job` under this number; `hired`: so many workers of this process will come.
    ///
    /// # Errors
    /// When the job makes no sense, or threads and memory are not to be had.
    pub(super) fn start(
        number: JobNumber,
        job: RenderJob,
        progress: watch::Sender<Progress>,
        heard_by: mpsc::Sender<FarmEvent>,
        hired: usize,
    ) -> Result<Self, RenderError> {
        let start = Instant::now();
        let view = job.settings.view;
        let whole = Region { x0: 0, y0: 0, x1: view.width(), y1: view.height() };
        let Region { x0, y0, x1, y1 } = job.region;
        if !whole.contains(&job.region) || Region::new(x0, y0, x1, y1).is_none() {
            return Err(RenderError::Region(job.region));
        }
        progress.send_modify(|p| *p = Progress { pixels_total: job.region.area(), ..Progress::default() });
        let mut scheduler = scheduler_of(number, &job, hired);
        let (sink, found) = keep(&job);
        let clock = Clock { start, before: job.spent + found.as_ref().map_or(Duration::ZERO, |f| f.spent) };
        let (left, reader, earlier) = found.map_or_else(Default::default, |f| (f.passes, Some(f.reader), f.verified));
        let internal = |e: &dyn std::fmt::Display| RenderError::Internal(e.to_string());
        let (tiles, stitcher) = stitch::start(
            job.region,
            (job.pixels, job.scratch.clone()),
            reader,
            job.canvas.clone().unwrap_or_default(),
        )
        .map_err(|e| internal(&e))?;
        let plan = Plan::new(job.goal, whole, job.region);
        let mut passes = Passes::new(plan, (job.region, job.tile), clock, left, sink);
        let seed = random().map_err(|e: NoRandomness| internal(&e))?;
        let verify = Verify::new(job.verify, seed, number);
        if verify.is_on() {
            scheduler.hold();
            passes.hold();
        }
        let (roster, verification) = recall(earlier);
        let own_core =
            OwnCore { scene: job.scene, settings: job.settings, format: job.pixels, threads: job.threads.max(1) };
        Ok(Self {
            scheduler,
            heard_by,
            pixels: job.pixels,
            region: job.region,
            tiles,
            stitcher,
            progress,
            start,
            pace: Pace::new(passes.limit()),
            passes,
            leasing: false,
            tiles_of_pass: 0,
            members: BTreeMap::new(),
            roster,
            verify,
            verification: Verification { share: job.verify, ..verification },
            own_core: Some(own_core),
            own: None,
            own_busy: 0,
            unassigned: VecDeque::new(),
            pulse_at: Duration::ZERO,
            last_cause: None,
            notes: Vec::new(),
            is_watched: job.canvas.is_some(),
            spans: Spans::of(job.span),
            end: None,
        })
    }

    /// Begins the first pass.
    pub(super) async fn begin_first(&mut self) {
        let first = self.passes.first();
        let end = self.begin(first).await;
        self.ended(end);
    }

    fn ended(&mut self, end: Ended) {
        if self.end.is_none() {
            self.end = end;
        }
    }

    /// When something is to be done though nothing is heard.
    pub(super) fn wake_at(&self) -> Instant {
        let wake = self.start + self.scheduler.wake_at();
        let deadline = self.passes.deadline().filter(|_| self.passes.is_whole());
        deadline.map_or(wake, |deadline| wake.min(deadline))
    }

    /// Does what is due.
    pub(super) async fn wake(&mut self) {
        let now = Instant::now();
        // A picture that is whole comes first, however short the time.
        if self.passes.is_whole() && self.passes.deadline().is_some_and(|deadline| now >= deadline) {
            if self.end.is_none() {
                self.passes.timed_out = true;
            }
            return self.ended(Some(Ok(())));
        }
        if now >= self.start + self.scheduler.wake_at() {
            let end = self.tell(Event::Tick, None).await;
            self.ended(end);
        }
    }

    /// Begins what comes next, or ends the render where nothing does.
    async fn begin(&mut self, turn: Turn) -> Ended {
        let (pass, is_look) = self.passes.at_hand();
        self.progress.send_modify(|p| {
            // After the last pass there is none to be told of.
            if turn.step.is_some() || turn.pixels > 0 {
                (p.tiles_done, p.pixels_done, p.pixels_total) = (turn.tiles_done, turn.pixels_done, turn.pixels);
            }
            p.rays += turn.rays;
            p.earlier.rays += turn.rays;
            p.earlier.tiles += turn.tiles;
            p.earlier.pixels_of_pass = turn.pixels_done;
            (p.pass, p.is_look) = (pass, is_look);
        });
        self.tiles_of_pass = turn.tiles_done;
        if !turn.again.is_empty() && self.tiles.send(Stitch::Again(turn.again)).await.is_err() {
            return Some(Err(RenderError::Internal("the stitcher stopped".into())));
        }
        let Some(step) = turn.step else { return Some(Ok(())) };
        self.spans.begin(pass, is_look);
        self.pace.begin(self.start.elapsed(), turn.work, step.kept, self.passes.expected());
        let regions = (turn.nothing_left || !step.regions.is_empty()).then_some(step.regions);
        if std::mem::replace(&mut self.leasing, true) {
            self.scheduler.begin(step.pass, regions, step.dearer);
        } else {
            self.scheduler.begin_first(step.pass, regions);
        }
        self.recover(is_look, &turn.made, turn.made_before.as_deref());
        None
    }

    /// A worker comes to render for this job; it is told what to prepare by whoever sends it.
    pub(super) async fn join(&mut self, worker: WorkerKey, comer: Comer) {
        let Comer { id, instance, name, address, threads, own, outbox, cut, last_sign } = comer;
        let came = WorkerStats { name, threads, address, ..WorkerStats::default() };
        let place = self.enter(id, came);
        let felt = last_sign.last();
        let member = Member { outbox, cut, id, ready: false, leaving: false, place, threads, last_sign, felt, lost: 0 };
        self.members.insert(worker, member);
        let end = self.tell(Event::Joined { worker, threads, instance, own }, None).await;
        self.ended(end);
    }

    /// A worker said something that is of this job.
    pub(super) async fn said(&mut self, worker: WorkerKey, said: WorkerEvent) {
        if !self.members.contains_key(&worker) {
            return;
        }
        let end = self.said_by(worker, said).await;
        self.ended(end);
        if self.members.get(&worker).is_some_and(|m| m.leaving) && self.scheduler.holds(worker) == 0 {
            self.depart(worker).await;
        }
    }

    async fn said_by(&mut self, worker: WorkerKey, said: WorkerEvent) -> Ended {
        match said {
            WorkerEvent::Done(done) if is_check(done.lease) => self.check_answered(worker, done).await,
            WorkerEvent::Returned { lease, .. } | WorkerEvent::Failed { lease, .. } if is_check(lease) => {
                self.check_failed(worker, lease)
            }
            WorkerEvent::Ready(_) => {
                self.is_ready(worker, true);
                self.tell(Event::Ready { worker }, None).await
            }
            WorkerEvent::Draining => {
                self.is_ready(worker, false);
                self.tell(Event::Draining { worker }, None).await
            }
            WorkerEvent::Returned { lease, attempt } => {
                self.spans.ended(lease, "returned");
                self.tell(Event::Returned { worker, lease, attempt }, None).await
            }
            WorkerEvent::Failed { lease, attempt, cause } => {
                self.spans.ended(lease, "failed");
                tracing::warn!("{} failed at a tile: {cause}", self.name(worker));
                self.tell(Event::Failed { worker, lease, attempt, cause }, None).await
            }
            WorkerEvent::Unable(_, cause) => {
                self.left(worker, cause).await;
                None
            }
            WorkerEvent::Nonsense(rule) => self.tell(Event::Broke { worker, rule }, None).await,
            WorkerEvent::Done(done) => self.delivered(worker, done).await,
            WorkerEvent::Stale(_) => None,
        }
    }

    /// This process rendered a check's tile, or could not.
    pub(super) async fn decides(&mut self, check: u64, sum: Option<Sum>) {
        let end = self.decided(check, sum).await;
        self.ended(end);
    }

    fn is_ready(&mut self, worker: WorkerKey, ready: bool) {
        if let Some(member) = self.members.get_mut(&worker) {
            member.ready = ready;
        }
    }

    /// A worker is gone, or is of no use here; gives how many of its tiles went to others.
    pub(super) async fn left(&mut self, worker: WorkerKey, cause: String) -> u64 {
        if !self.members.contains_key(&worker) {
            return 0;
        }
        let end = self.tell(Event::Left { worker, cause: cause.clone() }, None).await;
        self.ended(end);
        self.remove(worker, &cause)
    }

    /// A worker is wanted by another job: it gets no more here, and answers what it has begun. Gives whether it is
    /// gone already.
    pub(super) async fn release(&mut self, worker: WorkerKey) -> bool {
        let Some(member) = self.members.get_mut(&worker) else { return true };
        member.ready = false;
        if !std::mem::replace(&mut member.leaving, true) {
            let end = self.tell(Event::Draining { worker }, None).await;
            self.ended(end);
        }
        if self.scheduler.holds(worker) == 0 {
            self.depart(worker).await;
        }
        !self.members.contains_key(&worker)
    }

    async fn depart(&mut self, worker: WorkerKey) {
        let _ = self.left(worker, "it renders for another job".into()).await;
    }

    /// Whether a worker is here, and be it to answer what it has begun.
    pub(super) fn has(&self, worker: WorkerKey) -> bool {
        self.members.contains_key(&worker)
    }

    /// Whether a worker has nothing to do here.
    pub(super) fn is_idle(&self, worker: WorkerKey) -> bool {
        self.scheduler.holds(worker) == 0
    }

    /// Threads that there is work for: at the end of a pass, those of the workers that are still at it.
    pub(super) fn wants(&self) -> u64 {
        if !self.scheduler.is_running_out() {
            return u64::MAX;
        }
        let busy = self.members.iter().filter(|&(&worker, _)| self.scheduler.holds(worker) > 0);
        busy.map(|(_, m)| u64::from(m.threads)).sum::<u64>().max(1)
    }

    /// What happened that is not of this job alone.
    pub(super) fn take_notes(&mut self) -> Vec<Note> {
        std::mem::take(&mut self.notes)
    }

    async fn delivered(&mut self, worker: WorkerKey, done: TileDone) -> Ended {
        if let Some(region) = self.scheduler.region_of(worker, done.lease)
            && let Err(e) = check_size(&done.pixels, self.pixels, &region)
        {
            return self.tell(Event::Broke { worker, rule: e.to_string() }, None).await;
        }
        if let Some(region) = self.scheduler.region_of(worker, done.lease)
            && ![0, region.area()].contains(&done.error.pixels)
        {
            let rule = format!("it estimated the error of {} pixels out of {}", done.error.pixels, region.area());
            return self.tell(Event::Broke { worker, rule }, None).await;
        }
        let TileDone { lease, attempt, busy, idle, .. } = done;
        self.tell(Event::Done { worker, lease, attempt, busy, idle }, Some(done)).await
    }

    /// Tells the scheduler, and does what it asks for, from pass to pass. `done` is the tile at hand.
    async fn tell(&mut self, event: Event, done: Option<TileDone>) -> Ended {
        let mut end = self.tell_once(event, done).await;
        // Under verification a pass is over when its checks are, too.
        let verified = self.verify.is_on() && !self.verify.is_waiting();
        if end.is_none() && verified && self.scheduler.is_done() {
            end = Some(Ok(()));
        }
        match end {
            Some(Ok(())) => {
                self.verify.next_pass(self.passes.is_kept());
                let turn = self.passes.passed();
                match self.begin(turn).await {
                    // Nothing is done at once, so that this goes no deeper.
                    None => self.tell_once(Event::Tick, None).await,
                    end => end,
                }
            }
            end => end,
        }
    }

    async fn tell_once(&mut self, event: Event, done: Option<TileDone>) -> Ended {
        let mut effects = Vec::new();
        if matches!(event, Event::Tick) {
            let elapsed = self.start.elapsed();
            let (share, remaining) = self.pace.tell(elapsed);
            self.progress.send_modify(|p| (p.elapsed, p.share, p.remaining) = (elapsed, share, remaining));
        }
        let teller = event.worker();
        let now = self.start.elapsed();
        if matches!(event, Event::Tick) {
            self.unassigned.extend(self.verify.overdue(now, self.scheduler.is_done()));
        }
        self.check_liveness(now, &mut effects);
        self.scheduler.handle(event, now, &mut effects);
        let mut end = None;
        let mut touched: BTreeSet<WorkerKey> = teller.into_iter().collect();
        for effect in effects {
            match effect {
                Effect::Grant { worker, lease } => {
                    touched.insert(worker);
                    let pack = self.scheduler.has_narrow_line(worker);
                    self.lease(worker, wire::Lease { pack, ..lease.into() }, &lease);
                }
                Effect::Revoke { worker, lease } => {
                    touched.insert(worker);
                    self.spans.revoked(lease);
                    self.say(worker, Kind::Revoke(Revoke { lease: lease.0 }));
                }
                Effect::Accept { worker, region } => {
                    let Some(done) = &done else { continue };
                    let error = self.count(worker, region, done);
                    let name = self.name(worker);
                    let note = self.is_watched.then(|| self.note_of(region, done, (&name, error)));
                    let checks = self.unassigned.len();
                    let by = (name, self.verify(worker, region, done));
                    let first = self.passes.accept(region, done, by);
                    let outcome = if first.is_some() { "stitched" } else { "looked at" };
                    let span = self.spans.accepted(done, outcome, self.unassigned.len() > checks);
                    let Some(first) = first else { continue };
                    let stitch = Stitch::New { region, pixels: done.pixels.clone(), first, note, span };
                    // Waits where stitching is slower than the farm; so, then, do the workers.
                    if self.tiles.send(stitch).await.is_err() {
                        end = Some(Err(RenderError::Internal("the stitcher stopped".into())));
                    }
                }
                Effect::Lost { worker, tiles } => {
                    self.figures(worker, |w| w.lost += tiles);
                    if let Some(member) = self.members.get_mut(&worker) {
                        member.lost += tiles;
                    }
                    self.notes.push(Note::Lost { worker, tiles });
                }
                Effect::CutOff { worker, why } => self.cut_off(worker, why),
                Effect::End(e) => {
                    end = Some(match e {
                        End::Complete => Ok(()),
                        End::NoWorkers { waited, ever } => {
                            Err(RenderError::NoWorkers { waited, ever, last: self.last_cause.clone() })
                        }
                        End::TileFailed { region, attempts, cause } => {
                            Err(RenderError::Tile { region, attempts, cause })
                        }
                    });
                }
            }
        }
        if let Some(done) = &done {
            // Another worker was faster.
            self.spans.ended(done.lease, "late");
        }
        self.assign();
        for worker in touched {
            let holds = self.scheduler.holds(worker);
            self.figures(worker, |w| w.holds = holds);
        }
        end
    }
}
