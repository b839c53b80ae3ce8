//! The one task that owns the scheduler: it hears workers, reads the clock, and does
//! what the scheduler asks for.

mod farewell;
mod figures;
mod verification;

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::{Arc, PoisonError};
use std::time::Duration;

use tessera_proto::convert::{TileDone, check_size};
use tessera_proto::identity::WorkerId;
use tessera_proto::wire::coordinator_message::Kind;
use tessera_proto::wire::{self, CoordinatorMessage, Revoke, Welcome};
use tessera_proto::{PixelFormat, SessionId};
use tokio::sync::{mpsc, watch};
use tokio::time::{Instant, sleep_until};
use tokio_util::sync::CancellationToken;
use tonic::Status;

use super::guard::for_good;
use super::pace::Pace;
use super::passes::{Passes, Turn};
use super::pulse::Pulse;
use super::roster::{Entered, Roster};
use super::service::{Door, Heard, Joined, Mouth, Said, Visitor};
use super::stitch::Stitch;
use super::timing::Timing;
use super::verify::Verify;
use crate::job::{Progress, RenderError, Verification};
use crate::journal::Verified;
use crate::scheduler::{CutOff, Effect, End, Event, Scheduler, WorkerKey};
pub(super) use verification::OwnCore;
use verification::{is_check, recall};

/// Between two looks at the pulses of workers.
const PULSE_EVERY: Duration = Duration::from_millis(100);
/// What comes and goes is said under this name, also where nothing else is.
const FARM: &str = "farm";

/// The end of the render, once it is there.
type Ended = Option<Result<(), RenderError>>;

/// A worker that is connected.
struct Seat {
    session: SessionId,
    mouth: Mouth,
    cut: CancellationToken,
    id: WorkerId,
    /// Whether it may render.
    ready: bool,
    /// Place of its figures in [`Progress::workers`].
    place: usize,
    /// Whether it is one of this process.
    own: bool,
    pulse: Pulse,
    /// Its pulse when it was last looked at.
    felt: u64,
    /// Tiles that it left unanswered.
    lost: u64,
}

/// See the [module](self).
pub(super) struct Driver {
    scheduler: Scheduler,
    door: Arc<Door>,
    /// What pixels tiles must have.
    pixels: PixelFormat,
    heard: mpsc::Receiver<Heard>,
    tiles: mpsc::Sender<Stitch>,
    progress: watch::Sender<Progress>,
    start: Instant,
    passes: Passes,
    pace: Pace,
    timing: Timing,
    /// Whether the scheduler has begun a pass.
    leasing: bool,
    /// Tiles of the pass at hand that an earlier run did.
    tiles_of_pass: u64,
    seats: BTreeMap<WorkerKey, Seat>,
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
    next_worker: u64,
    /// When pulses are looked at next.
    pulse_at: Duration,
    last_cause: Option<String>,
}

impl Driver {
    pub(super) fn new(
        scheduler: Scheduler,
        (door, pixels): (Arc<Door>, PixelFormat),
        (heard, tiles): (mpsc::Receiver<Heard>, mpsc::Sender<Stitch>),
        progress: watch::Sender<Progress>,
        passes: Passes,
        (start, timing): (Instant, Timing),
        (verify, own_core, earlier): (Verify, OwnCore, Verified),
    ) -> Self {
        let (roster, verification) = recall(earlier);
        Self {
            scheduler,
            pace: Pace::new(passes.limit()),
            passes,
            door,
            pixels,
            heard,
            tiles,
            progress,
            start,
            timing,
            leasing: false,
            tiles_of_pass: 0,
            seats: BTreeMap::new(),
            roster,
            verify,
            verification,
            own_core: Some(own_core),
            own: None,
            own_busy: 0,
            unassigned: VecDeque::new(),
            next_worker: 0,
            pulse_at: Duration::ZERO,
            last_cause: None,
        }
    }

    /// Renders until the end, and dismisses the workers. Also says when the end was.
    pub(super) async fn run(
        mut self,
        cancel: &CancellationToken,
    ) -> (Result<(), RenderError>, Instant, Passes, Verification) {
        if self.verify.is_on() {
            self.scheduler.hold();
            self.passes.hold();
        }
        let first = self.passes.first();
        let mut end = self.begin(first).await;
        // Far off where there is none.
        let deadline = self.passes.deadline().unwrap_or(self.start + Duration::from_secs(1 << 32));
        let end = loop {
            if let Some(end) = end {
                break end;
            }
            let wake = self.start + self.scheduler.wake_at();
            end = tokio::select! {
                biased;
                () = cancel.cancelled() => break Err(RenderError::Cancelled),
                // A picture that is whole comes first, however short the time.
                () = sleep_until(deadline), if self.passes.is_whole() => {
                    self.passes.timed_out = true;
                    break Ok(());
                }
                heard = self.heard.recv() => match heard {
                    Some(heard) => self.hear(heard).await,
                    None => break Err(RenderError::Internal("nobody listens".into())),
                },
                () = sleep_until(wake) => self.tell(Event::Tick, None).await,
            };
        };
        let ended = Instant::now();
        if end.is_ok() {
            self.progress.send_modify(|p| (p.share, p.remaining) = (1.0, Some(Duration::ZERO)));
        }
        self.dismiss().await;
        (end, ended, self.passes, self.verification)
    }

    /// Begins what comes next, or ends the render where nothing does.
    async fn begin(&mut self, turn: Turn) -> Ended {
        let (pass, is_look) = self.passes.at_hand();
        self.progress.send_modify(|p| {
            (p.tiles_done, p.pixels_done, p.pixels_total) = (turn.tiles_done, turn.pixels_done, turn.pixels);
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

    async fn hear(&mut self, heard: Heard) -> Ended {
        match heard {
            Heard::Joined(joined) => self.admit(joined).await,
            Heard::Left { worker, cause } => {
                if self.seats.contains_key(&worker) {
                    self.left(worker, cause).await
                } else {
                    None
                }
            }
            // Words that were on their way when the session ended.
            Heard::Said { worker, .. } if !self.seats.contains_key(&worker) => None,
            Heard::Decided { check, sum } => self.decided(check, sum).await,
            Heard::Said { worker, said: Said::Done(done) } if is_check(done.lease) => {
                self.check_answered(worker, done).await
            }
            Heard::Said { worker, said: Said::Returned { lease, .. } | Said::Failed { lease, .. } }
                if is_check(lease) =>
            {
                self.check_failed(worker, lease)
            }
            Heard::Said { worker, said } => match said {
                Said::Ready => {
                    self.is_ready(worker, true);
                    self.tell(Event::Ready { worker }, None).await
                }
                Said::Draining => {
                    self.is_ready(worker, false);
                    self.tell(Event::Draining { worker }, None).await
                }
                Said::Returned { lease, attempt } => self.tell(Event::Returned { worker, lease, attempt }, None).await,
                Said::Failed { lease, attempt, cause } => {
                    tracing::warn!("{} failed at a tile: {cause}", self.name(worker));
                    self.tell(Event::Failed { worker, lease, attempt, cause }, None).await
                }
                Said::Unable(cause) => self.left(worker, cause).await,
                Said::Nonsense(rule) => self.tell(Event::Broke { worker, rule }, None).await,
                Said::Done(done) => self.delivered(worker, done).await,
            },
        }
    }

    fn is_ready(&mut self, worker: WorkerKey, ready: bool) {
        if let Some(seat) = self.seats.get_mut(&worker) {
            seat.ready = ready;
        }
    }

    async fn left(&mut self, worker: WorkerKey, cause: String) -> Ended {
        let end = self.tell(Event::Left { worker, cause: cause.clone() }, None).await;
        self.unseat(worker, &cause);
        end
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
            self.unassigned.extend(self.verify.overdue(now));
        }
        self.feel_pulses(now, &mut effects);
        self.scheduler.handle(event, now, &mut effects);
        let mut end = None;
        let mut touched: BTreeSet<WorkerKey> = teller.into_iter().collect();
        for effect in effects {
            match effect {
                Effect::Grant { worker, lease } => {
                    touched.insert(worker);
                    let pack = self.scheduler.has_narrow_line(worker);
                    self.say(worker, Kind::Lease(wire::Lease { pack, ..lease.into() }));
                }
                Effect::Revoke { worker, lease } => {
                    touched.insert(worker);
                    self.say(worker, Kind::Revoke(Revoke { lease: lease.0 }));
                }
                Effect::Accept { worker, region } => {
                    let Some(done) = &done else { continue };
                    self.count(worker, region, done);
                    let by = (self.name(worker), self.verify(worker, region, done));
                    let Some(first) = self.passes.accept(region, done, by) else { continue };
                    let stitch = Stitch::New { region, pixels: done.pixels.clone(), first };
                    // Waits where stitching is slower than the farm; so, then, do the workers.
                    if self.tiles.send(stitch).await.is_err() {
                        end = Some(Err(RenderError::Internal("the stitcher stopped".into())));
                    }
                }
                Effect::Lost { worker, tiles } => {
                    self.figures(worker, |w| w.lost += tiles);
                    if let Some(seat) = self.seats.get_mut(&worker) {
                        seat.lost += tiles;
                    }
                }
                Effect::CutOff { worker, why } => self.cut_off(worker, &why),
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
        self.assign();
        for worker in touched {
            let holds = self.scheduler.holds(worker);
            self.figures(worker, |w| w.holds = holds);
        }
        end
    }

    /// Tells the scheduler now and then of whom something was heard since, and lets the clock run on.
    fn feel_pulses(&mut self, now: Duration, effects: &mut Vec<Effect>) {
        if now < self.pulse_at {
            return;
        }
        self.pulse_at = now + PULSE_EVERY;
        for (&worker, seat) in &mut self.seats {
            let last = seat.pulse.last();
            if std::mem::replace(&mut seat.felt, last) != last {
                self.scheduler.handle(Event::Heard { worker }, now, effects);
            }
        }
        self.progress.send_modify(|p| p.elapsed = now);
    }

    async fn admit(&mut self, joined: Joined) -> Ended {
        let Joined { registration, local, address, pulse, mouth, cut, reply } = joined;
        if reply.is_closed() {
            // It has given up waiting for an answer.
            return None;
        }
        let id = registration.id;
        if let Some(rule) = self.roster.banned(id) {
            let _ = reply.send(Err(for_good(Status::permission_denied(format!("cut off before: {rule}")))));
            return None;
        }
        let before = self.seats.iter().find(|(_, seat)| seat.id == id).map(|(&worker, _)| worker);
        if let Some(before) = before
            && let Some(end) = self.left(before, "it dialled again".into()).await
        {
            return Some(end);
        }
        let room = self.door.gate.workers();
        if self.seats.len() >= room {
            let full = format!("there is room for {room} workers here, by the limit of open files (ulimit -n)");
            let _ = reply.send(Err(Status::resource_exhausted(full)));
            return None;
        }
        let worker = WorkerKey(self.next_worker);
        self.next_worker += 1;
        let session = SessionId(fastrand::u64(..));
        let Entered { instance, place, name, back } = self.enter(&registration, local, address);
        let welcome = Welcome {
            session: session.0,
            name: name.clone(),
            heartbeat_interval_ms: self.timing.beat.as_millis() as u32,
            suspect_after_ms: self.timing.suspect_after.as_millis() as u32,
            dead_after_ms: self.timing.dead_after.as_millis() as u32,
        };
        let sessions = &self.door.sessions;
        sessions.lock().unwrap_or_else(PoisonError::into_inner).insert(session, Visitor::new(pulse.clone()));
        let (threads, own) = (registration.threads, local);
        let seat = Seat { session, mouth, cut, id, ready: false, place, own, pulse, felt: 0, lost: 0 };
        self.seats.insert(worker, seat);
        self.say(worker, Kind::Welcome(welcome));
        if reply.send(Ok((worker, session))).is_err() {
            return self.left(worker, "it left while registering".into()).await;
        }
        let verb = if back { "is back" } else { "joined" };
        match (own, threads) {
            (true, _) => tracing::debug!("{name} {verb}"),
            (false, 1) => tracing::info!(target: FARM, "{name} {verb} with 1 thread"),
            (false, n) => tracing::info!(target: FARM, "{name} {verb} with {n} threads"),
        }
        self.tell(Event::Joined { worker, threads, instance, own }, None).await
    }

    fn say(&mut self, worker: WorkerKey, kind: Kind) {
        let Some(seat) = self.seats.get(&worker) else { return };
        let message = CoordinatorMessage { kind: Some(kind) };
        if seat.mouth.try_send(Ok(message)).is_err() {
            // It does not read: ending its stream makes it leave.
            seat.cut.cancel();
        }
    }

    fn cut_off(&mut self, worker: WorkerKey, why: &CutOff) {
        let status = match why {
            // It would be turned away if it dialled again.
            CutOff::Broke(rule) => for_good(Status::invalid_argument(format!("this worker was cut off: {rule}"))),
            CutOff::Silent(time) => Status::deadline_exceeded(format!("nothing was heard for {time:.1?}")),
            CutOff::Unready(time) => Status::deadline_exceeded(format!("the scene was not ready after {time:.0?}")),
        };
        let cause = status.message().to_owned();
        if let Some(seat) = self.seats.get(&worker) {
            if let CutOff::Broke(rule) = why {
                self.roster.ban(seat.id, rule.clone());
            }
            let _ = seat.mouth.try_send(Err(status));
            seat.cut.cancel();
        }
        self.unseat(worker, &cause);
    }

    fn unseat(&mut self, worker: WorkerKey, cause: &str) {
        self.say_left(worker, cause);
        self.figures(worker, |w| {
            w.connected = false;
            w.holds = 0;
            w.left = Some(cause.into());
        });
        self.last_cause = Some(format!("{}: {cause}", self.name(worker)));
        if let Some(seat) = self.seats.remove(&worker) {
            self.door.sessions.lock().unwrap_or_else(PoisonError::into_inner).remove(&seat.session);
            seat.cut.cancel();
            self.roster.left(seat.id);
            self.reassign(worker, seat.id);
        }
    }
}
