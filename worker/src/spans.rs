//! Spans that are exported: those of the target [`SPANS`], under parents of this process or of another.

use opentelemetry::Context;
use opentelemetry::trace::{SpanContext, SpanId, TraceContextExt as _, TraceFlags, TraceId, TraceState};
use tessera_proto::TraceContext;
use tracing::Span;
use tracing_opentelemetry::OpenTelemetrySpanExt as _;
use tracing_subscriber::EnvFilter;

/// The target of spans that are exported. Where nothing exports them, nobody listens to it and no span is made.
pub const SPANS: &str = "spans";

/// `filter` of a log, which spans are no part of however loud it is.
#[must_use]
pub fn unspoken(filter: EnvFilter) -> EnvFilter {
    match format!("{SPANS}=off").parse() {
        Ok(off) => filter.add_directive(off),
        Err(_) => filter,
    }
}

/// What others hang their spans under `span` by; `None` where it is not recorded.
#[must_use]
pub fn context_of(span: &Span) -> Option<TraceContext> {
    if span.is_disabled() {
        return None;
    }
    let context = span.context();
    let context = context.span().span_context().clone();
    context.is_valid().then(|| TraceContext {
        trace: u128::from_be_bytes(context.trace_id().to_bytes()),
        span: u64::from_be_bytes(context.span_id().to_bytes()),
        sampled: context.is_sampled(),
    })
}

/// `span`, which has just been made without a parent, as a child of one elsewhere.
#[must_use]
pub fn under(span: Span, parent: Option<TraceContext>) -> Span {
    if let Some(parent) = parent.filter(|_| !span.is_disabled()) {
        let flags = if parent.sampled { TraceFlags::SAMPLED } else { TraceFlags::default() };
        let (trace, of) = (TraceId::from(parent.trace), SpanId::from(parent.span));
        let remote = SpanContext::new(trace, of, flags, true, TraceState::NONE);
        // It fails only where the span is not recorded.
        let _ = span.set_parent(Context::new().with_remote_span_context(remote));
    }
    span
}

#[cfg(test)]
mod tests {
    use tracing::info_span;
    use tracing_subscriber::Layer as _;
    use tracing_subscriber::layer::SubscriberExt as _;

    use super::*;
    use crate::otlp::Otlp;

    #[test]
    fn without_an_export_there_is_no_span_however_loud_the_log() {
        let loud = tracing_subscriber::fmt::layer().with_filter(unspoken(EnvFilter::new("trace")));
        tracing::subscriber::with_default(tracing_subscriber::registry().with(loud), || {
            let span = info_span!(target: SPANS, parent: None, "tile");
            assert!(span.is_disabled() && context_of(&span).is_none());
        });
    }

    #[test]
    fn a_span_is_of_the_trace_that_it_is_under_and_others_are_under_it() {
        let otlp = Otlp::start(&"http://127.0.0.1:9".parse().unwrap(), "test").unwrap();
        tracing::subscriber::with_default(tracing_subscriber::registry().with(otlp.layer()), || {
            let parent = TraceContext { trace: 7 << 64, span: 9, sampled: true };
            let span = under(info_span!(target: SPANS, parent: None, "job"), Some(parent));
            let job = context_of(&span).unwrap();
            assert!(job.trace == parent.trace && job.span != parent.span && job.sampled);
            let tile = context_of(&info_span!(target: SPANS, parent: &span, "tile")).unwrap();
            assert!(tile.trace == parent.trace && tile.span != job.span);
            // Of a trace that is not recorded nothing is.
            let unseen =
                under(info_span!(target: SPANS, parent: None, "job"), Some(TraceContext { sampled: false, ..parent }));
            assert_eq!(context_of(&unseen).map(|c| (c.trace, c.sampled)), Some((parent.trace, false)));
            // Nor what is of another target.
            assert!(info_span!(parent: None, "other").is_disabled());
        });
    }
}
