//! Spans as a collector gets them: from submit to stitched tile one trace, over three processes.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on may stop")]
#![cfg(unix)]

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use opentelemetry_proto::tonic::collector::trace::v1::trace_service_server::{TraceService, TraceServiceServer};
use opentelemetry_proto::tonic::collector::trace::v1::{ExportTraceServiceRequest, ExportTraceServiceResponse};
use opentelemetry_proto::tonic::common::v1::KeyValue;
use opentelemetry_proto::tonic::common::v1::any_value::Value;
use rustix::process::Signal;
use tessera_proto::control::control_client::ControlClient;
use tessera_proto::control::{JobName, Spec};
use tessera_tests::loopback;
use tessera_tests::process::Process;
use tessera_tests::program::{Ended, run, scene};
use tessera_tests::wait::until;
use tokio::runtime::Runtime;
use tokio_stream::wrappers::TcpListenerStream;
use tonic::transport::Server;
use tonic::{Request, Response, Status};

/// A span as it came.
#[derive(Clone, Debug)]
struct Got {
    service: String,
    name: String,
    trace: Vec<u8>,
    id: Vec<u8>,
    parent: Vec<u8>,
    attributes: BTreeMap<String, String>,
}

/// A collector in this process.
struct Collector {
    url: String,
    got: Arc<Mutex<Vec<Got>>>,
    _runtime: Runtime,
}

struct Taking(Arc<Mutex<Vec<Got>>>);

fn told(attributes: &[KeyValue]) -> BTreeMap<String, String> {
    let text = |value: &KeyValue| match value.value.as_ref().and_then(|v| v.value.as_ref()) {
        Some(Value::StringValue(text)) => text.clone(),
        Some(Value::IntValue(n)) => n.to_string(),
        Some(Value::BoolValue(b)) => b.to_string(),
        other => format!("{other:?}"),
    };
    attributes.iter().map(|a| (a.key.clone(), text(a))).collect()
}

#[tonic::async_trait]
impl TraceService for Taking {
    async fn export(
        &self,
        request: Request<ExportTraceServiceRequest>,
    ) -> Result<Response<ExportTraceServiceResponse>, Status> {
        let mut got = self.0.lock().unwrap();
        for of_resource in request.into_inner().resource_spans {
            let service = told(&of_resource.resource.unwrap().attributes).remove("service.name").unwrap();
            for span in of_resource.scope_spans.into_iter().flat_map(|of_scope| of_scope.spans) {
                assert!(span.end_time_unix_nano >= span.start_time_unix_nano);
                got.push(Got {
                    service: service.clone(),
                    name: span.name,
                    trace: span.trace_id,
                    id: span.span_id,
                    parent: span.parent_span_id,
                    attributes: told(&span.attributes),
                });
            }
        }
        Ok(Response::new(ExportTraceServiceResponse::default()))
    }
}

impl Collector {
    fn start() -> Self {
        let runtime = Runtime::new().unwrap();
        let listener = runtime.block_on(tokio::net::TcpListener::bind("127.0.0.1:0")).unwrap();
        let url = format!("http://{}", listener.local_addr().unwrap());
        let got = Arc::default();
        let service = TraceServiceServer::new(Taking(Arc::clone(&got)));
        runtime.spawn(Server::builder().add_service(service).serve_with_incoming(TcpListenerStream::new(listener)));
        Self { url, got, _runtime: runtime }
    }

    fn all(&self) -> Vec<Got> {
        let got = self.got.lock().unwrap().clone();
        let ids: BTreeSet<_> = got.iter().map(|g| &g.id).collect();
        assert_eq!(ids.len(), got.len(), "a span came twice");
        got
    }

    fn named(&self, name: &str) -> Vec<Got> {
        self.all().into_iter().filter(|g| g.name == name).collect()
    }

    /// The only span of this name.
    fn one(&self, name: &str) -> Got {
        let mut named = self.named(name);
        assert_eq!(named.len(), 1, "{name}: {named:#?} of {:#?}", self.all());
        named.remove(0)
    }

    /// The tiles that were stitched, by their regions.
    fn stitched(&self) -> BTreeMap<String, Got> {
        let stitched: Vec<Got> =
            self.named("tile").into_iter().filter(|g| g.attributes["outcome"] == "stitched").collect();
        let count = stitched.len();
        let by_region: BTreeMap<_, _> = stitched.into_iter().map(|g| (g.attributes["region"].clone(), g)).collect();
        assert_eq!(by_region.len(), count, "a tile has two spans");
        by_region
    }
}

/// A farm of its own in a folder of its own.
struct Farm<'a> {
    folder: tempfile::TempDir,
    at: String,
    collector: &'a Collector,
}

impl<'a> Farm<'a> {
    fn new(collector: &'a Collector) -> Self {
        let at = loopback::free().to_string();
        Self { folder: tempfile::tempdir().unwrap(), at, collector }
    }

    fn serve(&self) -> Process {
        let state = self.folder.path().join("state");
        let (state, url) = (state.to_str().unwrap(), &self.collector.url);
        let args = ["serve", "--state", state, "--listen", &self.at, "--http", "none", "--otlp", url];
        let mut serve = Process::start("coordinator", &args);
        serve.says("submit jobs by");
        serve
    }

    fn worker(&self, more: &[&str]) -> Process {
        Process::start("worker", &[&["--connect", self.at.as_str(), "--threads", "1"], more].concat())
    }

    /// Submits the demo in so many tiles of 16 pixels across and down.
    fn submit(&self, tiles: (u32, u32), more: &[&str]) -> u64 {
        let size = format!("{}x{}", 16 * tiles.0, 16 * tiles.1);
        let demo = scene("demo.xml");
        let fixed = ["submit", demo.to_str().unwrap(), "--farm", &self.at, "--otlp", &self.collector.url];
        let picture = ["--size", &size, "--samples", "1", "--tile", "16"];
        let ended = run(self.folder.path(), [&fixed[..], &picture, more].concat());
        assert_eq!(ended.code, Some(0), "{}", ended.err);
        ended.out.trim().parse().unwrap()
    }
}

/// Ends a program in order.
fn end(process: Process, signal: Signal) {
    process.signal(signal);
    let _ = process.end();
}

/// The names of all tiles of 16 pixels, so many across and down.
fn regions((across, down): (u32, u32)) -> BTreeSet<String> {
    let region = |x: u32, y: u32| format!("{},{},{},{}", 16 * x, 16 * y, 16 * x + 16, 16 * y + 16);
    (0..down).flat_map(|y| (0..across).map(move |x| region(x, y))).collect()
}

#[test]
fn it_is_one_trace_from_submit_to_stitched_tile() {
    let collector = Collector::start();
    let farm = Farm::new(&collector);
    let (serve, worker) = (farm.serve(), farm.worker(&["--otlp", &collector.url]));
    let id = farm.submit((6, 4), &["--wait", "--name", "a name"]);
    end(worker, Signal::TERM);
    end(serve, Signal::INT);
    let (submit, job, pass) = (collector.one("submit"), collector.one("job"), collector.one("pass"));
    assert!(submit.parent.is_empty() && submit.service == "coordinator");
    assert_eq!(job.parent, submit.id);
    let (name, number) = (job.attributes["name"].as_str(), job.attributes["job"].as_str());
    assert_eq!((name, number, job.attributes["outcome"].as_str()), ("a name", id.to_string().as_str(), "done"));
    assert_eq!(pass.parent, job.id);
    assert_eq!(collector.one("queued").parent, job.id);
    let parents: Vec<Vec<u8>> = collector.named("read scene").into_iter().map(|g| g.parent).collect();
    assert_eq!(BTreeSet::from_iter(parents), BTreeSet::from([submit.id.clone(), job.id.clone()]));
    // The worker's are under the job's, and what the coordinator does for them under those again.
    let (receive, send) = (collector.one("receive scene"), collector.one("send scene"));
    assert_eq!((receive.service.as_str(), &receive.parent), ("worker", &job.id));
    assert_eq!((send.service.as_str(), &send.parent), ("coordinator", &receive.id));
    let prepare = collector.one("prepare scene");
    assert_eq!((prepare.service.as_str(), &prepare.parent), ("worker", &job.id));
    let stitched = collector.stitched();
    assert_eq!(stitched.keys().cloned().collect::<BTreeSet<_>>(), regions((6, 4)));
    let traced = collector.named("trace tile");
    for (region, tile) in &stitched {
        assert_eq!((&tile.parent, tile.service.as_str()), (&pass.id, "coordinator"));
        assert!(tile.attributes["rays"].parse::<u64>().unwrap() >= 256);
        let mine: Vec<&Got> = traced.iter().filter(|t| t.parent == tile.id).collect();
        assert_eq!(mine.len(), 1, "{region}: {mine:#?}");
        assert_eq!((&mine[0].attributes["region"], mine[0].service.as_str()), (region, "worker"));
        assert_eq!(mine[0].attributes["outcome"], "done");
        assert_eq!(mine[0].attributes["rays"], tile.attributes["rays"]);
    }
    // The worker's session is of the farm, whatever it renders.
    let (session, served) = (collector.one("session"), collector.one("serve"));
    assert_eq!((session.service.as_str(), &session.parent), ("worker", &served.id));
    let apart: Vec<&str> = ["session", "serve"].into();
    for got in collector.all() {
        assert_eq!(got.trace == submit.trace, !apart.contains(&got.name.as_str()), "{got:#?}");
    }
}

#[test]
fn a_job_is_under_its_submission_after_a_restart_too_and_what_is_malformed_is_ignored() {
    let collector = Collector::start();
    let farm = Farm::new(&collector);
    let serve = farm.serve();
    let id = farm.submit((2, 1), &[]);
    let foreign = Runtime::new().unwrap().block_on(async {
        let mut client = ControlClient::connect(format!("http://{}", farm.at)).await.unwrap();
        let spec = client.get_job(JobName { id }).await.unwrap().into_inner().spec.unwrap();
        let submitted = collector.one("submit");
        assert!(!spec.traceparent.is_empty());
        let mut request =
            Request::new(Spec { name: "foreign".into(), traceparent: "said, not sent".into(), ..spec.clone() });
        request.metadata_mut().insert("traceparent", "00-malformed".parse().unwrap());
        let foreign = client.submit(request).await.unwrap().into_inner();
        assert_eq!(foreign.spec.unwrap().traceparent, "");
        let hex: String = submitted.id.iter().map(|b| format!("{b:02x}")).collect();
        assert_eq!(&spec.traceparent[36..52], hex);
        foreign.id
    });
    serve.signal(Signal::KILL);
    drop(serve);
    // What it recorded is lost; what its next run records is not, wherever the worker's is.
    let (serve, worker) = (farm.serve(), farm.worker(&[]));
    let state = |id: u64| {
        let jobs = run(farm.folder.path(), ["jobs", &id.to_string(), "--farm", &farm.at, "--json"]);
        jobs.out.contains("\"done\"")
    };
    until("both done", || state(id) && state(foreign));
    end(worker, Signal::TERM);
    end(serve, Signal::INT);
    let (submit, jobs) = (collector.one("submit"), collector.named("job"));
    let under: Vec<&Got> = jobs.iter().filter(|job| job.parent == submit.id && job.trace == submit.trace).collect();
    assert!(!under.is_empty() && under.iter().all(|job| job.attributes["job"] == id.to_string()), "{jobs:#?}");
    assert!(under.iter().any(|job| job.attributes["outcome"] == "done"));
    let own = jobs.iter().find(|job| job.attributes["name"] == "foreign").unwrap();
    assert!(own.parent.is_empty() && own.trace != submit.trace);
    let of_submission = collector.named("tile").iter().filter(|tile| tile.trace == submit.trace).count();
    assert!(of_submission >= 2);
    // The worker exports none, and is told of none by which it would.
    assert_eq!(collector.named("trace tile").len(), 0);
}

/// Renders the demo small; gives how that ended, and the picture's bytes.
fn render(at: &Path, name: &str, more: &[&str]) -> (Ended, Vec<u8>) {
    let demo = scene("demo.xml");
    let picture: PathBuf = at.join(name);
    let fixed = ["render", demo.to_str().unwrap(), "-o", picture.to_str().unwrap(), "--size", "160x96"];
    let ended = run(at, [&fixed[..], &["--tile", "16"], more].concat());
    (ended, fs::read(picture).unwrap_or_default())
}

#[test]
fn a_render_is_a_trace_and_a_collector_that_is_absent_or_silent_changes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let collector = Collector::start();
    let (plain, picture) = render(folder.path(), "plain.png", &[]);
    assert_eq!(plain.code, Some(0), "{}", plain.err);
    assert!(!plain.err.contains("spans"));
    // As loud as can be, the log speaks of no span.
    let (seen, same) = render(folder.path(), "seen.png", &["--otlp", &collector.url]);
    assert_eq!((seen.code, same == picture), (Some(0), true), "{}", seen.err);
    assert!(!seen.err.contains("spans are lost"), "{}", seen.err);
    let (root, job) = (collector.one("render"), collector.one("job"));
    assert!(root.parent.is_empty());
    assert_eq!(job.parent, root.id);
    assert_eq!(collector.one("write picture").parent, root.id);
    let passes: BTreeSet<_> = collector.named("pass").into_iter().map(|pass| pass.id).collect();
    for tile in collector.named("tile") {
        assert!(passes.contains(&tile.parent));
    }
    assert!(collector.all().iter().all(|got| got.trace == root.trace));
    // Nobody listens there; and somebody does who never answers.
    let absent = loopback::free();
    let silent = TcpListener::bind("127.0.0.1:0").unwrap();
    for (name, at) in [("absent.png", absent), ("silent.png", silent.local_addr().unwrap())] {
        let (ended, same) = render(folder.path(), name, &["--otlp", &format!("http://{at}")]);
        assert_eq!((ended.code, same == picture), (Some(0), true), "{name}: {}", ended.err);
        assert_eq!(ended.err.matches("spans are lost").count(), 1, "{name}: {}", ended.err);
    }
}

#[test]
fn an_interrupted_render_sends_what_it_recorded() {
    let folder = tempfile::tempdir().unwrap();
    let collector = Collector::start();
    let (demo, picture) = (scene("demo.xml"), folder.path().join("long.png"));
    let (demo, picture) = (demo.to_str().unwrap(), picture.to_str().unwrap());
    let long = Process::start(
        "coordinator",
        &["render", demo, "-o", picture, "--size", "4000x4000", "--samples", "4096", "--otlp", &collector.url],
    );
    until("a span", || !collector.stitched().is_empty());
    long.signal(Signal::INT);
    assert_eq!(long.end().0.code(), Some(130));
    let (root, job) = (collector.one("render"), collector.one("job"));
    assert_eq!(job.parent, root.id);
}
