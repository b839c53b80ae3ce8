//! A job's spans: its passes, and every lease from when it is granted to when its tile is stitched or nobody waits for it.

use std::collections::HashMap;

use tessera_proto::convert::{Lease, TileDone};
use tessera_proto::{LeaseId, TraceContext};
use tracing::field::Empty;
use tracing::{Span, info_span};
use worker::spans::{SPANS, context_of};

use crate::scheduler::WorkerKey;

/// See the [module](self). Where the job has no span that is recorded, there are none at all.
#[derive(Debug)]
pub(super) struct Spans {
    job: Span,
    pass: Span,
    leases: HashMap<LeaseId, Open>,
}

/// A lease that is not answered yet.
#[derive(Debug)]
struct Open {
    worker: WorkerKey,
    span: Span,
    /// Whether another worker was faster; its worker will still answer.
    revoked: bool,
}

impl Open {
    fn end(self, outcome: &str) {
        self.span.record("outcome", if self.revoked { "revoked" } else { outcome });
    }
}

impl Spans {
    /// Under the job's span.
    pub(super) fn of(job: Span) -> Self {
        Self { job, pass: Span::none(), leases: HashMap::new() }
    }

    /// Whether there are any.
    pub(super) fn are_on(&self) -> bool {
        !self.job.is_disabled()
    }

    /// What workers hang theirs under.
    pub(super) fn context(&self) -> Option<TraceContext> {
        context_of(&self.job)
    }

    /// A pass begins.
    pub(super) fn begin(&mut self, number: u32, is_look: bool) {
        if self.are_on() {
            self.pass = info_span!(target: SPANS, parent: &self.job, "pass", number, is_look);
        }
    }

    /// No more passes come.
    pub(super) fn end(&mut self) {
        self.pass = Span::none();
        self.leases.drain().for_each(|(_, open)| open.end("given up"));
    }

    /// A lease is granted, to render a tile or to render it again as a check; gives its span's number, or 0.
    pub(super) fn granted(&mut self, lease: &Lease, worker: WorkerKey, name: impl FnOnce() -> String) -> u64 {
        if !self.are_on() {
            return 0;
        }
        let r = lease.region;
        let span = info_span!(
            target: SPANS, parent: &self.pass, "tile",
            region = format_args!("{},{},{},{}", r.x0, r.y0, r.x1, r.y1), worker = name(), attempt = lease.attempt.0,
            is_check = super::is_check(lease.id), outcome = Empty, rays = Empty, busy_us = Empty, checked = Empty,
        );
        let number = context_of(&span).map_or(0, |context| context.span);
        self.leases.insert(lease.id, Open { worker, span, revoked: false });
        number
    }

    /// Another worker was faster.
    pub(super) fn revoked(&mut self, lease: LeaseId) {
        if let Some(open) = self.leases.get_mut(&lease) {
            open.revoked = true;
        }
    }

    /// A lease came to its end.
    pub(super) fn ended(&mut self, lease: LeaseId, outcome: &str) {
        if self.are_on()
            && let Some(open) = self.leases.remove(&lease)
        {
            open.end(outcome);
        }
    }

    /// A lease's tile is what was wanted, to be `checked` by another worker or not; gives its span, which ends when the
    /// tile is where it belongs.
    pub(super) fn accepted(&mut self, done: &TileDone, outcome: &str, checked: bool) -> Span {
        if !self.are_on() {
            return Span::none();
        }
        let Some(Open { span, .. }) = self.leases.remove(&done.lease) else { return Span::none() };
        let busy = u64::try_from(done.busy.as_micros()).unwrap_or(u64::MAX);
        span.record("outcome", outcome).record("rays", done.rays.total());
        span.record("busy_us", busy).record("checked", checked);
        span
    }

    /// A worker is gone, and with it what it was leased.
    pub(super) fn lost(&mut self, worker: WorkerKey) {
        self.leases.extract_if(|_, open| open.worker == worker).for_each(|(_, open)| open.end("lost"));
    }
}
