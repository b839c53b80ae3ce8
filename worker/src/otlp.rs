//! The export of spans to a collector, as OTLP over gRPC. It holds up nothing: what a collector does not take in time
//! is dropped.

use std::fmt;
use std::str::FromStr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use opentelemetry::KeyValue;
use opentelemetry::trace::TracerProvider as _;
use opentelemetry_otlp::{RetryPolicy, SpanExporter, WithExportConfig as _, WithTonicConfig as _};
use opentelemetry_sdk::Resource;
use opentelemetry_sdk::error::{OTelSdkError, OTelSdkResult};
use opentelemetry_sdk::trace::{BatchConfigBuilder, BatchSpanProcessor, SdkTracerProvider, SpanData};
use tokio::runtime::{Builder, Runtime};
use tonic::codegen::http::Uri;
use tonic::codegen::http::uri::Scheme;
use tracing::{Level, Subscriber};
use tracing_subscriber::Layer;
use tracing_subscriber::filter::Targets;
use tracing_subscriber::registry::LookupSpan;

use crate::spans::SPANS;

/// The port of collectors where none is given.
const PORT: u16 = 4317;
/// Spans that wait to be sent, at most: of a picture of small tiles there are thousands a second.
const QUEUE: usize = 1 << 14;
/// Between two looks at what waits.
const SEND_EVERY: Duration = Duration::from_secs(1);
/// How long a collector may take for what it is sent, and for the last of it when the program ends.
const TAKE_WITHIN: Duration = Duration::from_secs(2);

/// Where spans are sent.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Collector(String);

impl fmt::Display for Collector {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl FromStr for Collector {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let uri: Uri = text.parse().map_err(|_| "expected a URL, such as http://localhost:4317")?;
        let authority = uri.authority().filter(|a| !a.as_str().contains('@') && !a.host().is_empty());
        let authority = authority.ok_or("expected a URL with a host, such as http://localhost:4317")?;
        if uri.scheme() != Some(&Scheme::HTTP) {
            return Err("spans are sent over plain http:// (OTLP over gRPC), best to a collector on this machine");
        }
        if authority.port_u16().is_none() && authority.as_str() != authority.host() {
            return Err("the port must be a number from 0 to 65535");
        }
        if !matches!(uri.path(), "" | "/") || uri.query().is_some() {
            return Err("OTLP over gRPC has no path: give http://HOST:PORT alone");
        }
        Ok(Self(format!("http://{}:{}", authority.host(), authority.port_u16().unwrap_or(PORT))))
    }
}

/// The export of this process' spans, which ends with it: then what waits is sent, within two seconds.
#[derive(Debug)]
pub struct Otlp {
    provider: SdkTracerProvider,
    /// Calls go by a runtime of their own, whatever becomes of the program's.
    runtime: Option<Runtime>,
    to: Collector,
    told: Arc<AtomicBool>,
}

impl Otlp {
    /// Sends spans to `to` as those of `service`.
    ///
    /// # Errors
    /// When there are no threads to be had.
    pub fn start(to: &Collector, service: &'static str) -> std::io::Result<Self> {
        let runtime = Builder::new_multi_thread().worker_threads(1).thread_name("otlp").enable_all().build()?;
        let in_runtime = runtime.enter();
        let exporter = SpanExporter::builder()
            .with_tonic()
            .with_endpoint(to.to_string())
            .with_timeout(TAKE_WITHIN)
            // What comes later is worth more than what a collector refused.
            .with_retry_policy(RetryPolicy::disabled())
            .build()
            .map_err(std::io::Error::other)?;
        drop(in_runtime);
        let told = Arc::new(AtomicBool::new(false));
        let exporter = Telling { exporter, to: to.clone(), told: told.clone() };
        let batches = BatchConfigBuilder::default().with_max_queue_size(QUEUE).with_scheduled_delay(SEND_EVERY);
        let resource = Resource::builder()
            .with_service_name(service)
            .with_attribute(KeyValue::new("service.version", env!("CARGO_PKG_VERSION")))
            .with_attribute(KeyValue::new("host.name", gethostname::gethostname().to_string_lossy().into_owned()))
            .with_attribute(KeyValue::new("process.pid", i64::from(std::process::id())));
        let provider = SdkTracerProvider::builder()
            .with_resource(resource.build())
            .with_span_processor(BatchSpanProcessor::builder(exporter).with_batch_config(batches.build()).build())
            .build();
        Ok(Self { provider, runtime: Some(runtime), to: to.clone(), told })
    }

    /// What hands spans over, and listens to nothing else.
    pub fn layer<S: Subscriber + for<'a> LookupSpan<'a>>(&self) -> impl Layer<S> + use<S> {
        tracing_opentelemetry::layer()
            .with_tracer(self.provider.tracer("tessera"))
            .with_location(false)
            .with_target(false)
            .with_threads(false)
            .with_tracked_inactivity(false)
            .with_filter(Targets::new().with_target(SPANS, Level::INFO))
    }
}

impl Drop for Otlp {
    fn drop(&mut self) {
        let sent = self.provider.shutdown_with_timeout(TAKE_WITHIN);
        if let Err(OTelSdkError::Timeout(_)) = sent {
            tell_once(&self.told, &self.to, "it takes too long");
        }
        if let Some(runtime) = self.runtime.take() {
            runtime.shutdown_background();
        }
    }
}

/// Says once that spans are lost.
fn tell_once(told: &AtomicBool, to: &Collector, why: &str) {
    if !told.swap(true, Ordering::Relaxed) {
        tracing::warn!(
            "spans are lost: the collector at {to} does not take them ({why}); the render is none the worse"
        );
    }
}

/// An exporter that says so when it fails.
#[derive(Debug)]
struct Telling {
    exporter: SpanExporter,
    to: Collector,
    told: Arc<AtomicBool>,
}

impl opentelemetry_sdk::trace::SpanExporter for Telling {
    async fn export(&self, batch: Vec<SpanData>) -> OTelSdkResult {
        let sent = self.exporter.export(batch).await;
        if let Err(e) = &sent {
            tracing::debug!("{e}");
            let refused = matches!(e, OTelSdkError::InternalFailure(said) if said.contains("onnect"));
            tell_once(&self.told, &self.to, if refused { "there is none" } else { "it refuses them" });
        }
        sent
    }

    fn shutdown_with_timeout(&self, timeout: Duration) -> OTelSdkResult {
        self.exporter.shutdown_with_timeout(timeout)
    }

    fn set_resource(&mut self, resource: &Resource) {
        self.exporter.set_resource(resource);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn collectors_are_plain_hosts() {
        let read = |text: &str| text.parse::<Collector>().map(|c| c.to_string());
        assert_eq!(read("http://localhost:4317/").unwrap(), "http://localhost:4317");
        assert_eq!(read("http://10.0.0.5").unwrap(), "http://10.0.0.5:4317");
        assert_eq!(read("http://[::1]:99").unwrap(), "http://[::1]:99");
        for bad in [
            "",
            "localhost",
            "localhost:4317",
            "https://a",
            "http://",
            "http://a/v1/traces",
            "http://a@b",
            "http://a:b",
        ] {
            assert!(read(bad).is_err(), "{bad}");
        }
    }
}
