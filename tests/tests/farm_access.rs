//! Who gets in, and who does not: tokens, certificates, and those who have neither.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on may stop")]

use std::net::SocketAddr;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use coordinator::access::{Access, Pki, State, TokenFrom};
use coordinator::{Farm, ListenAddr};
use rcgen::{BasicConstraints, CertificateParams, IsCa, Issuer, KeyPair, date_time_ymd};
use tessera_proto::token::{Secret, Token};
use tessera_tests::cluster::{Cluster, Running};
use tessera_tests::generate;
use tessera_tests::hostile::{BEAT, GREET, Raw, WORK, bearer};
use tessera_tests::renderers::{Gate, Painted, assert_painted};
use tokio::io::AsyncReadExt;
use tokio::net::TcpListener;
use tokio_util::sync::CancellationToken;
use worker::{Backoff, Config, Left, PkiFiles, WorkerError};

const WIDTH: u32 = 64;
const UNAUTHENTICATED: Option<i32> = Some(16);

fn painted() -> Cluster {
    let cluster = Cluster::of(generate::demo().scene().unwrap()).size(WIDTH, 48).tile(16);
    cluster.factory(Painted).workers(0, 1)
}

/// A farm behind `access`, at work.
async fn guarded(cluster: Cluster, access: &Access) -> Running {
    cluster.start_on(Farm::bind_guarded(ListenAddr::Loopback, access).await.unwrap())
}

/// A farm of its own, in a folder that lives as long.
fn own_farm() -> (tempfile::TempDir, State, Access) {
    let folder = tempfile::tempdir().unwrap();
    let state = State::at(folder.path().join("state"));
    let access = Access::guarded(&state, None).unwrap();
    (folder, state, access)
}

fn config(addr: SocketAddr, access: worker::Access) -> Config {
    Config {
        access,
        threads: 1,
        once: true,
        factory: Arc::new(Painted),
        backoff: Backoff { first: Duration::from_millis(20), longest: Duration::from_millis(50) },
        ..Config::new(addr.into())
    }
}

async fn comes(addr: SocketAddr, access: worker::Access) -> Result<Left, WorkerError> {
    let work = worker::run(config(addr, access), CancellationToken::new());
    tokio::time::timeout(Duration::from_secs(60), work).await.expect("the worker hangs")
}

fn by_token(token: &Token) -> worker::Access {
    worker::Access::by_token(token).unwrap()
}

/// That a worker knocks at `addr` again and again, is never let in, and never gives up.
async fn keeps_out(addr: SocketAddr, access: worker::Access) {
    let stop = CancellationToken::new();
    let work = tokio::spawn(worker::run(config(addr, access), stop.clone()));
    tokio::time::sleep(Duration::from_millis(600)).await;
    assert!(!work.is_finished());
    stop.cancel();
    assert_eq!(work.await.unwrap().unwrap(), Left::Stopped);
}

#[tokio::test]
async fn whoever_has_the_token_renders_and_so_do_workers_of_the_same_process() {
    let (_folder, _, access) = own_farm();
    let gate = Gate::before(Painted, 2);
    let mut running = guarded(painted().factory(gate.clone()).workers(1, 1), &access).await;
    let (addr, token) = (running.addr, access.token().unwrap());
    let worker = tokio::spawn(async move { comes(addr, by_token(&token)).await });
    running.until(|p| p.workers.len() == 2 && p.workers.iter().all(|w| w.holds > 0)).await;
    gate.open();
    let rendered = running.end().await.unwrap();
    assert_painted(&rendered);
    assert_eq!(rendered.strangers, 0);
    assert_eq!(worker.await.unwrap().unwrap(), Left::Finished);
}

#[tokio::test]
async fn without_the_token_nobody_gets_in_or_learns_anything_with_tls_or_without() {
    let (_folder, _, access) = own_farm();
    let (_other, other, _) = own_farm();
    let running = guarded(painted(), &access).await;
    let wrong = Secret::new().unwrap().reveal();
    let foreign = other.token().unwrap().secret.reveal();
    let right = access.token().unwrap().secret.reveal();
    // Without TLS not even the right one counts: it has been read by now.
    let cases = [
        (true, None),
        (true, Some(wrong)),
        (true, Some(foreign)),
        (true, Some("x".repeat(1000))),
        (true, Some("ü".into())),
        (false, None),
        (false, Some(right)),
    ];
    let addr = running.addr;
    let asked = cases.map(|(tls, shown)| {
        tokio::spawn(async move {
            let raw = if tls { Raw::tls(addr).await.unwrap() } else { Raw::plain(addr).await.unwrap() };
            let headers = shown.map(|s| bearer(&s));
            let headers: &[_] = headers.as_ref().map_or(&[], |h| h);
            let call = |path| raw.call(path, headers, &[0; 5], true);
            let nonsense = call("/tessera.farm.v1.Farm/Nonsense");
            let (a, b, c, d) = tokio::join!(call(GREET), call(WORK), nonsense, call("/nobody/knows"));
            [a, b, c, d].map(Result::unwrap)
        })
    });
    let mut calls = 0;
    for answers in asked {
        let answers = answers.await.unwrap();
        assert!(answers.windows(2).all(|w| w[0] == w[1]), "what exists and what does not look the same: {answers:?}");
        for answer in answers {
            assert_eq!(answer.status, UNAUTHENTICATED);
            for secret in ["scene", "demo", "render", "job", "protocol", "0.1.0"] {
                assert!(!answer.said.contains(secret), "{answer:?}");
            }
            calls += 1;
        }
    }
    assert!(matches!(comes(running.addr, worker::Access::open()).await, Err(WorkerError::Refused(_))));
    let almost = Token { secret: Secret::new().unwrap(), ..access.token().unwrap() };
    let refused = comes(running.addr, by_token(&almost)).await.unwrap_err().to_string();
    assert!(refused.contains("token is not this farm's"), "{refused}");
    assert!(running.progress.borrow().workers.is_empty());
    comes(running.addr, by_token(&access.token().unwrap())).await.unwrap();
    let rendered = running.end().await.unwrap();
    assert_painted(&rendered);
    assert_eq!(rendered.strangers, calls + 2, "they are counted");
}

#[tokio::test]
async fn a_renewed_token_counts_at_once_and_whoever_is_in_stays_in() {
    let (_folder, state, access) = own_farm();
    let old = access.token().unwrap();
    let gate = Gate::before(Painted, 2);
    let mut running = guarded(painted(), &access).await;
    let addr = running.addr;
    let config = Config { factory: Arc::new(gate.clone()), ..config(addr, by_token(&old)) };
    let inside = tokio::spawn(worker::run(config, CancellationToken::new()));
    running.until(|p| p.tiles_done == 2).await;
    let new = state.renew_token().unwrap();
    assert_eq!((new.pin, new == old), (old.pin, false));
    assert!(matches!(comes(addr, by_token(&old)).await, Err(WorkerError::Refused(_))));
    let late = tokio::spawn(async move { comes(addr, by_token(&new)).await });
    running.until(|p| p.workers.len() == 2).await;
    gate.open();
    assert_painted(&running.end().await.unwrap());
    inside.await.unwrap().unwrap();
    late.await.unwrap().unwrap();
}

#[tokio::test]
async fn another_farm_at_the_address_is_told_nothing() {
    let (_folder, _, access) = own_farm();
    let (_other, _, others) = own_farm();
    let running = guarded(painted(), &others).await;
    keeps_out(running.addr, by_token(&access.token().unwrap())).await;
    assert!(running.progress.borrow().workers.is_empty());
    comes(running.addr, by_token(&others.token().unwrap())).await.unwrap();
    let rendered = running.end().await.unwrap();
    assert_painted(&rendered);
    assert_eq!(rendered.strangers, 0, "no secret was sent at all");
}

#[tokio::test]
async fn a_man_in_the_middle_sees_no_secret_neither_by_his_own_certificate_nor_without_tls() {
    let (_folder, _, access) = own_farm();
    let (_his, _, his) = own_farm();
    let token = access.token().unwrap();
    // He ends TLS by a certificate of his own authority, of the right name.
    let middle = guarded(painted(), &his).await;
    keeps_out(middle.addr, by_token(&token)).await;
    assert!(middle.progress.borrow().workers.is_empty());
    middle.cancel.cancel();
    // He speaks no TLS, and hopes that the worker goes on without.
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let addr = listener.local_addr().unwrap();
    let heard = tokio::spawn(async move {
        let mut all = Vec::new();
        for _ in 0..3 {
            let (mut stream, _) = listener.accept().await.unwrap();
            let _ = tokio::io::AsyncWriteExt::write_all(&mut stream, b"\0\0\0\x04\0\0\0\0\0").await;
            let _ = tokio::time::timeout(Duration::from_millis(100), stream.read_to_end(&mut all)).await;
        }
        all
    });
    keeps_out(addr, by_token(&token)).await;
    let heard = heard.await.unwrap();
    assert_eq!(heard.first(), Some(&0x16), "a handshake, and nothing before it");
    let text = String::from_utf8_lossy(&heard);
    assert!(!text.contains("PRI * HTTP") && !text.contains(&token.secret.reveal()));
}

#[tokio::test]
async fn wrong_tokens_without_end_do_not_keep_others_out() {
    let (_folder, _, access) = own_farm();
    let gate = Gate::before(Painted, 1);
    let mut running = guarded(painted(), &access).await;
    let (addr, token) = (running.addr, access.token().unwrap());
    let config = Config { factory: Arc::new(gate.clone()), ..config(addr, by_token(&token)) };
    let worker = tokio::spawn(worker::run(config, CancellationToken::new()));
    running.until(|p| p.tiles_done == 1).await;
    let attackers: Vec<_> = (0..20)
        .map(|_| {
            tokio::spawn(async move {
                loop {
                    let Ok(raw) = Raw::tls(addr).await else { continue };
                    let wrong = Secret::new().unwrap().reveal();
                    let _ = raw.call(GREET, &bearer(&wrong), &[0; 5], true).await;
                }
            })
        })
        .collect();
    // They are at it, and the one who is in stays in and works.
    tokio::time::sleep(Duration::from_secs(1)).await;
    gate.open();
    let rendered = running.end().await.unwrap();
    attackers.iter().for_each(tokio::task::JoinHandle::abort);
    assert_painted(&rendered);
    assert_eq!(rendered.workers[0].lost, 0);
    assert!(rendered.strangers > 0);
    worker.await.unwrap().unwrap();
}

#[tokio::test]
async fn a_token_file_is_made_kept_secret_and_of_this_farm_alone() {
    let (folder, state, access) = own_farm();
    let path = folder.path().join("sub/token.txt");
    let from = || Some(TokenFrom::File(path.clone()));
    let made = Access::guarded(&state, from()).unwrap().token().unwrap();
    assert_eq!(made.pin, access.token().unwrap().pin);
    assert_ne!(made.secret, access.token().unwrap().secret, "its own");
    assert_eq!(Access::guarded(&state, from()).unwrap().token(), Some(made), "it stays");
    let written = std::fs::read_to_string(&path).unwrap();
    assert_eq!(worker::given_token(None, Some(&path), None).unwrap(), Some(made));
    let (_folder, other, _) = own_farm();
    let error = Access::guarded(&other, from()).unwrap_err().to_string();
    assert!(error.contains("another farm") && !error.contains(written.trim()), "{error}");
    let text = |text: &str| Some(TokenFrom::Text { text: text.into(), from: "TESSERA_TOKEN".into() });
    assert_eq!(Access::guarded(&state, text(&written)).unwrap().token(), Some(made));
    for bad in ["nonsense", ""] {
        let error = Access::guarded(&state, text(bad)).unwrap_err().to_string();
        assert!(error.contains("TESSERA_TOKEN"), "{error}");
    }
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        for file in [path.clone(), state.token_path(), folder.path().join("state/authority.pem")] {
            assert_eq!(std::fs::metadata(&file).unwrap().permissions().mode() & 0o777, 0o600, "{file:?}");
        }
        std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o640)).unwrap();
        let error = Access::guarded(&state, from()).unwrap_err().to_string();
        assert!(error.contains("chmod 600"), "{error}");
    }
}

#[test]
fn several_coordinators_that_start_at_once_have_one_authority_and_one_token() {
    let folder = tempfile::tempdir().unwrap();
    let state = State::at(folder.path().join("state"));
    let tokens: Vec<Token> = std::thread::scope(|scope| {
        let start = || scope.spawn(|| Access::guarded(&state, None).unwrap().token().unwrap());
        let started: Vec<_> = (0..8).map(|_| start()).collect();
        started.into_iter().map(|s| s.join().unwrap()).collect()
    });
    assert!(tokens.iter().all(|t| *t == tokens[0]));
}

/// An authority like a firm's, which signs for hosts and for workers.
struct Firm {
    issuer: Issuer<'static, KeyPair>,
    certificate: String,
}

impl Firm {
    fn new() -> Self {
        let key = KeyPair::generate().unwrap();
        let mut params = CertificateParams::new(Vec::new()).unwrap();
        params.is_ca = IsCa::Ca(BasicConstraints::Unconstrained);
        let certificate = params.self_signed(&key).unwrap().pem();
        Self { issuer: Issuer::new(params, key), certificate }
    }

    /// Writes a certificate for `host`, its key, and the authority, as `name.pem`, `name.key` and `name.ca`.
    fn writes(&self, folder: &Path, name: &str, host: &str, until: i32) -> [std::path::PathBuf; 3] {
        let key = KeyPair::generate().unwrap();
        let mut params = CertificateParams::new(vec![host.to_owned()]).unwrap();
        params.not_after = date_time_ymd(until, 1, 1);
        let leaf = params.signed_by(&key, &self.issuer).unwrap().pem();
        let files = ["pem", "key", "ca"].map(|end| folder.join(format!("{name}.{end}")));
        for (file, text) in files.iter().zip([leaf + &self.certificate, key.serialize_pem(), self.certificate.clone()])
        {
            std::fs::write(file, text).unwrap();
        }
        files
    }
}

#[tokio::test]
async fn with_certificates_of_an_authority_of_ones_own_workers_need_no_token() {
    let folder = tempfile::tempdir().unwrap();
    let (firm, others) = (Firm::new(), Firm::new());
    let [cert, key, ca] = firm.writes(folder.path(), "coordinator", "127.0.0.1", 2100);
    let access = Access::by_pki(&Pki { cert, key, client_ca: Some(ca.clone()) }, None, None).unwrap();
    assert_eq!(access.token(), None);
    let running = guarded(painted().workers(1, 1), &access).await;
    let [cert, key, _] = firm.writes(folder.path(), "worker", "worker", 2100);
    let with = |ca: &Path, own: Option<(&Path, &Path)>| {
        let (cert, key) = own.unzip();
        let files = PkiFiles { ca: Some(ca.into()), cert: cert.map(Into::into), key: key.map(Into::into) };
        worker::Access::new(None, &files).unwrap()
    };
    let refused = comes(running.addr, with(&ca, None)).await.unwrap_err().to_string();
    assert!(refused.contains("a certificate is asked for"), "{refused}");
    let [his_cert, his_key, his_ca] = others.writes(folder.path(), "his", "127.0.0.1", 2100);
    keeps_out(running.addr, with(&ca, Some((&his_cert, &his_key)))).await;
    keeps_out(running.addr, with(&his_ca, Some((&cert, &key)))).await;
    let [old_cert, old_key, _] = firm.writes(folder.path(), "old", "worker", 2001);
    keeps_out(running.addr, with(&ca, Some((&old_cert, &old_key)))).await;
    assert_painted(&running.end().await.unwrap());
    let running = guarded(painted(), &access).await;
    comes(running.addr, with(&ca, Some((&cert, &key)))).await.unwrap();
    assert_painted(&running.end().await.unwrap());
}

#[tokio::test]
async fn a_certificate_that_expired_or_is_anothers_lets_no_coordinator_pass_for_the_right_one() {
    let folder = tempfile::tempdir().unwrap();
    let firm = Firm::new();
    for (name, host, until, good) in
        [("good", "127.0.0.1", 2100, true), ("old", "127.0.0.1", 2001, false), ("else", "10.0.0.1", 2100, false)]
    {
        let [cert, key, ca] = firm.writes(folder.path(), name, host, until);
        let state = State::at(folder.path().join("state"));
        let access = Access::by_pki(&Pki { cert, key, client_ca: None }, Some(&state), None).unwrap();
        let running = guarded(painted(), &access).await;
        let token = access.token().unwrap();
        let by_authority = worker::Access::new(None, &PkiFiles { ca: Some(ca), ..PkiFiles::default() }).unwrap();
        if good {
            let refused = comes(running.addr, by_authority).await.unwrap_err().to_string();
            assert!(refused.contains("a token is asked for"), "{refused}");
            comes(running.addr, by_token(&token)).await.unwrap();
            assert_painted(&running.end().await.unwrap());
        } else {
            keeps_out(running.addr, by_authority).await;
            keeps_out(running.addr, by_token(&token)).await;
            assert!(running.progress.borrow().workers.is_empty(), "{name}");
        }
    }
}

#[tokio::test]
async fn a_beat_or_fetch_without_the_token_is_refused_like_all_else() {
    let (_folder, _, access) = own_farm();
    let running = guarded(painted(), &access).await;
    let raw = Raw::tls(running.addr).await.unwrap();
    for path in [BEAT, "/tessera.farm.v1.Farm/FetchScene"] {
        assert_eq!(raw.call(path, &[], &[0; 5], true).await.unwrap().status, UNAUTHENTICATED);
    }
    comes(running.addr, by_token(&access.token().unwrap())).await.unwrap();
    assert_painted(&running.end().await.unwrap());
}
