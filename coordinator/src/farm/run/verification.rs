//! A job's part in [verification](crate::farm::verify): who renders a tile again, and what becomes of liars.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Duration;

use tessera_core::film::Region;
use tessera_core::settings::{Pass, Settings};
use tessera_core::trace::PreparedScene;
use tessera_proto::convert::{TileDone, check_size, pixel_bytes};
use tessera_proto::identity::WorkerId;
use tessera_proto::{LeaseId, PixelFormat};
use worker::RendererFactory;

use super::{Ended, Note, Run};
use crate::farm::roster::Roster;
use crate::farm::service::FarmEvent;
use crate::farm::stitch::Stitch;
use crate::farm::verify::{Assigned, Closed, Made, Sum, Verify, sum_of};
use crate::job::SceneSource;
use crate::journal::{Kept, ThrownOut, Verified};
use crate::progress::{CheckedTile, Verification};
use crate::scheduler::{Event, WorkerKey};

/// What this process renders tiles with to decide about others' results: the tracer itself, on threads of its
/// own, started when it is first needed.
#[derive(Debug)]
pub(crate) struct OwnCore {
    pub(crate) scene: SceneSource,
    pub(crate) settings: Settings,
    pub(crate) format: PixelFormat,
    pub(crate) threads: usize,
}

/// Tiles that this process has to render again at once, at most.
const OWN_AT_ONCE: usize = 2;
/// Without any worker for so long, this process renders again what an earlier run did.
const ALONE_AFTER: Duration = Duration::from_secs(2);

/// A tile to be rendered: the check, and what of the picture.
pub(super) type Wanted = (u64, Region, Option<Pass>);

impl OwnCore {
    /// Starts its thread, which ends with the sender it gives.
    fn start(self, heard: tokio::sync::mpsc::Sender<FarmEvent>) -> Sender<Wanted> {
        let (sender, wanted) = channel();
        std::thread::spawn(move || self.run(&wanted, &heard));
        sender
    }

    fn run(self, wanted: &Receiver<Wanted>, heard: &tokio::sync::mpsc::Sender<FarmEvent>) {
        let prepare = || {
            let prepared = match self.scene {
                SceneSource::Prepared(prepared) => prepared,
                SceneSource::Resolved(scene) => Arc::new(PreparedScene::build(scene)),
            };
            worker::Exact.open(prepared, self.settings).ok()
        };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(self.threads.max(1)).build().ok();
        let tracer = pool.as_ref().and_then(|pool| pool.install(prepare));
        for (check, region, pass) in wanted {
            let render = || -> Option<Sum> {
                let (pool, tracer) = (pool.as_ref()?, tracer.as_ref()?);
                let (tile, _) = pool.install(|| match pass {
                    Some(pass) => tracer.render_pass(region, pass),
                    None => tracer.render(region),
                });
                let error = tile.error;
                let pixels = worker::encode_tile(tile, self.format, self.settings.transfer);
                Some(sum_of(&pixel_bytes(&pixels), &error))
            };
            let sum = std::panic::catch_unwind(std::panic::AssertUnwindSafe(render)).ok().flatten();
            if heard.blocking_send(FarmEvent::Decided { check, sum }).is_err() {
                return;
            }
        }
    }
}

impl Run {
    /// A tile was accepted: another is to confirm it, where that is drawn. Gives whose it is, and the sum of what came,
    /// where tiles are verified.
    pub(super) fn verify(&mut self, worker: WorkerKey, region: Region, done: &TileDone) -> Option<(WorkerId, Sum)> {
        let maker = self.members.get(&worker).filter(|_| self.verify.is_on())?.id;
        let sum = sum_of(&done.pixels, &done.error);
        let made = Made { region, maker, error: done.error, verified: false };
        self.unassigned.extend(self.verify.accepted((made, sum), self.passes.detail(), done.busy));
        Some((maker, sum))
    }

    /// Goes on with the verification of what an earlier run did of the pass at hand, and of the picture before.
    pub(super) fn recover(&mut self, looks: bool, made: &[Kept], before: Option<&[Kept]>) {
        self.verify.looks(looks);
        self.unassigned.extend(self.verify.recover(made, before));
    }

    /// Has tiles rendered again, as far as there is somebody for it.
    pub(super) fn assign(&mut self) {
        if self.unassigned.is_empty() {
            return;
        }
        let now = self.start.elapsed();
        let ready: Vec<_> = self.members.iter().filter(|(_, m)| m.ready).map(|(&k, m)| (k, m.id)).collect();
        let waited = !ready.is_empty() || now > ALONE_AFTER;
        while let Some(&check) = self.unassigned.front() {
            match self.verify.assign(check, &ready, waited && self.own_busy < OWN_AT_ONCE, now) {
                Some(Assigned::To(worker, lease)) => self.lease(worker, lease.into(), &lease),
                Some(Assigned::Here { check, region, pass }) => self.check_here((check, region, pass)),
                Some(Assigned::Later) => return,
                None => {}
            }
            self.unassigned.pop_front();
        }
    }

    /// Has this process render a tile again.
    fn check_here(&mut self, wanted: Wanted) {
        if let Some(core) = self.own_core.take() {
            self.own = Some(core.start(self.heard_by.clone()));
        }
        if self.own.as_ref().is_some_and(|own| own.send(wanted).is_ok()) {
            self.own_busy += 1;
        } else {
            self.verify.decided(wanted.0, None);
        }
    }

    /// A worker left: its checks go to others.
    pub(super) fn reassign(&mut self, worker: WorkerKey, id: WorkerId) {
        self.unassigned.extend(self.verify.left(worker, id));
    }

    /// A worker did not render a check's tile.
    pub(super) fn check_failed(&mut self, worker: WorkerKey, lease: LeaseId) -> Ended {
        self.spans.ended(lease, "returned");
        if self.verify.region_of(worker, lease).is_some()
            && let Some(id) = self.members.get(&worker).map(|m| m.id)
        {
            self.verify.failed(lease, id);
            self.unassigned.push_back(lease.0);
            self.assign();
        }
        None
    }

    /// A worker rendered a tile again.
    pub(super) async fn check_answered(&mut self, worker: WorkerKey, done: TileDone) -> Ended {
        let id = self.members.get(&worker).map(|m| m.id)?;
        let Some(region) = self.verify.region_of(worker, done.lease) else {
            // Nobody waits for it any more.
            self.spans.ended(done.lease, "late");
            return None;
        };
        if let Err(e) = check_size(&done.pixels, self.pixels, &region) {
            return self.tell(Event::Broke { worker, rule: e.to_string() }, None).await;
        }
        let heard = self.tell(Event::Heard { worker }, None).await;
        if heard.is_some() {
            return heard;
        }
        self.scheduler.did_else(worker, done.busy);
        match self.verify.answered(done.lease, id, sum_of(&done.pixels, &done.error)) {
            Some(closed) => {
                self.spans.ended(done.lease, "agreed");
                self.closed(closed).await
            }
            None => {
                self.spans.ended(done.lease, "disagreed");
                self.unassigned.push_front(done.lease.0);
                self.assign();
                None
            }
        }
    }

    /// This process rendered a tile again.
    pub(super) async fn decided(&mut self, check: u64, sum: Option<Sum>) -> Ended {
        self.own_busy = self.own_busy.saturating_sub(1);
        if sum.is_none() {
            tracing::warn!("a tile could not be verified: it cannot be rendered here");
        }
        match self.verify.decided(check, sum) {
            Some(closed) => self.closed(closed).await,
            None => self.tell(Event::Tick, None).await,
        }
    }

    async fn closed(&mut self, closed: Closed) -> Ended {
        let checked = CheckedTile {
            region: closed.region,
            maker: self.name_of(closed.maker),
            checker: closed.checker.map(|id| self.name_of(id)),
            agreed: closed.liars.is_empty(),
        };
        let holds = !closed.liars.contains(&closed.maker);
        if holds {
            self.notes.push(Note::Verified { id: closed.maker });
            let place = self.roster.place(closed.maker);
            self.progress.send_modify(|p| {
                if let Some(w) = place.and_then(|place| p.workers.get_mut(place)) {
                    w.verified += 1;
                }
            });
        }
        self.passes.checked(&checked, holds);
        self.verification.checks.push(checked);
        for &liar in &closed.liars {
            let end = self.throw_out(liar, closed.region).await;
            if end.is_some() {
                return end;
            }
        }
        // It may have been the last thing that was waited for.
        self.tell(Event::Tick, None).await
    }

    /// Shuts a liar out, and has everything rendered again that it delivered and nobody confirmed.
    async fn throw_out(&mut self, liar: WorkerId, at: Region) -> Ended {
        if self.roster.banned(liar).is_some() {
            // Another check had found it before this one was decided.
            return None;
        }
        let name = self.name_of(liar);
        let Region { x0, y0, x1, y1 } = at;
        let rule = format!("its tile {x0},{y0} to {x1},{y1} is not what the scene shows");
        let (now, before) = self.verify.take_back(liar);
        tracing::error!("{name} lied: {rule}; {} tiles of it are rendered again", now.len());
        let out = ThrownOut { worker: liar, name, rule: rule.clone(), redone: now.len() as u64 };
        self.verification.thrown_out.push(out.name.clone());
        self.verification.redone += out.redone;
        self.roster.ban(liar, rule.clone());
        self.notes.push(Note::Ban { id: liar, rule: rule.clone() });
        for made in now.iter().chain(&before) {
            // Not a pixel of it is to be in the picture, whatever comes now.
            if self.tiles.send(Stitch::Take(made.region)).await.is_err() {
                break;
            }
        }
        let regions: Vec<Region> = now.iter().map(|m| m.region).collect();
        self.passes.take_back(&out, &regions, self.verify.error(), !before.is_empty());
        let area: u64 = regions.iter().map(Region::area).sum();
        let place = self.roster.place(liar);
        self.progress.send_modify(|p| {
            p.tiles_done = p.tiles_done.saturating_sub(regions.len() as u64);
            p.pixels_done = p.pixels_done.saturating_sub(area);
            if let Some(w) = place.and_then(|place| p.workers.get_mut(place)) {
                w.tiles = w.tiles.saturating_sub(regions.len() as u64);
                w.pixels = w.pixels.saturating_sub(area);
            }
        });
        self.scheduler.redo(regions);
        let session = self.members.iter().find(|(_, m)| m.id == liar).map(|(&worker, _)| worker);
        match session {
            Some(worker) => self.tell(Event::Broke { worker, rule }, None).await,
            None => None,
        }
    }

    fn name_of(&self, id: WorkerId) -> String {
        let place = self.roster.place(id);
        let progress = self.progress.borrow();
        let here = place.and_then(|p| progress.workers.get(p)).map(|w| w.name.as_str());
        here.or_else(|| self.roster.name_before(id)).unwrap_or("a worker").into()
    }
}

/// What is known of an earlier run: who was shut out, what workers were called, and what was verified.
pub(super) fn recall(earlier: Verified) -> (Roster, Verification) {
    let mut roster = Roster::of(earlier.names);
    let mut verification = Verification { checks: earlier.checks, ..Verification::default() };
    for ThrownOut { worker, name, rule, redone } in earlier.thrown_out {
        roster.ban(worker, rule);
        verification.thrown_out.push(name);
        verification.redone += redone;
    }
    (roster, verification)
}

/// Whether an answer is to a check.
pub(super) fn is_check(lease: LeaseId) -> bool {
    Verify::is_check(lease)
}
