//! The spans of jobs that wait or are rendered, each under the span that submitted it.

use std::collections::HashMap;

use tessera_proto::TraceContext;
use tessera_proto::control::{Job, State};
use tracing::field::Empty;
use tracing::{Span, info_span};
use worker::spans::{SPANS, under};

use super::{is_final, state_name};

/// See the [module](self). Where none are recorded, none are kept.
#[derive(Debug, Default)]
pub(super) struct Spans(HashMap<u64, Lane>);

/// A job, from when it came or this farm was started anew, and what it is at.
#[derive(Debug)]
struct Lane {
    job: Span,
    state: State,
    /// What it is at; it ends when the next begins.
    stage: Span,
}

impl Spans {
    /// A job is in a state, maybe another than before.
    pub(super) fn is(&mut self, job: &Job) {
        let state = job.state();
        if is_final(state) {
            if let Some(lane) = self.0.remove(&job.id) {
                lane.job.record("outcome", state_name(state));
            }
            return;
        }
        let (id, Some(spec)) = (job.id, &job.spec) else { return };
        let lane = self.0.get(&id);
        if lane.is_some_and(|lane| lane.state == state) {
            return;
        }
        let new = || {
            let (name, owner) = (spec.name.as_str(), spec.owner.as_str());
            let span = info_span!(target: SPANS, parent: None, "job", job = id, name, owner, outcome = Empty);
            under(span, TraceContext::parse(&spec.traceparent))
        };
        let span = lane.map_or_else(new, |lane| lane.job.clone());
        if span.is_disabled() {
            return;
        }
        let stage = match state {
            State::Queued => info_span!(target: SPANS, parent: &span, "queued"),
            State::Paused => info_span!(target: SPANS, parent: &span, "paused"),
            _ => info_span!(target: SPANS, parent: &span, "read scene"),
        };
        self.0.insert(id, Lane { job: span, state, stage });
    }

    /// A job's scene is read, and the farm renders it: gives its span.
    pub(super) fn begun(&mut self, id: u64) -> Span {
        let Some(lane) = self.0.get_mut(&id) else { return Span::none() };
        lane.stage = Span::none();
        lane.job.clone()
    }

    /// The farm closes: what is not over goes on under spans of its next run.
    pub(super) fn close(&mut self) {
        for (_, lane) in self.0.drain() {
            lane.job.record("outcome", "farm closed");
        }
    }
}
