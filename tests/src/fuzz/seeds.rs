//! The corpus: sound inputs of every kind, small, and some that are nearly so.

use std::path::Path;

use bytes::Bytes;
use prost::Message;
use tessera_core::film::{ErrorEstimate, Region, Sum};
use tessera_core::scene::Scene;
use tessera_core::settings::{AuditRate, Detail, Pass, Sampling, Settings, Tolerance, Transfer, View};
use tessera_core::trace::RayCounts;
use tessera_core::xml::{ReadOptions, read_file};
use tessera_proto::convert::{Job, Lease, Registration, TileDone};
use tessera_proto::identity::WorkerId;
use tessera_proto::journal::{self, Record, record};
use tessera_proto::limits::{BUILD, NUMERIC_MODE};
use tessera_proto::scene::{SceneEncoder, describe};
use tessera_proto::token::{Pin, Secret, Token};
use tessera_proto::wire::{self, CoordinatorMessage, WorkerMessage, coordinator_message, worker_message};
use tessera_proto::{Attempt, JobNumber, LeaseId, PassNumber, PixelFormat, SceneHash};

use super::corpus_folder;
use crate::generate;

/// Writes the corpus anew.
///
/// # Errors
/// When it cannot be written.
///
/// # Panics
/// When the scenes it is made of are none.
pub fn write() -> std::io::Result<()> {
    for (target, seeds) in [
        ("scene_text", scene_text()?),
        ("pixmap", pixmap()),
        ("scene_binary", scene_binary()),
        ("journal", journal()),
        ("worker_message", worker_message()),
        ("coordinator_message", coordinator_message()),
        ("token", token()),
    ] {
        let folder = corpus_folder(target);
        std::fs::create_dir_all(&folder)?;
        for (name, bytes) in seeds {
            std::fs::write(folder.join(name), bytes)?;
        }
    }
    Ok(())
}

type Seeds = Vec<(&'static str, Vec<u8>)>;

fn scene_text() -> std::io::Result<Seeds> {
    let scenes = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes");
    let every = std::fs::read(scenes.join("every_element.xml"))?;
    let utf16 = |text: &str| -> Vec<u8> {
        [0xfeff].into_iter().chain(text.encode_utf16()).flat_map(u16::to_le_bytes).collect()
    };
    let small = "<scene><camera><location><vector x=\"0\" y=\"0\" z=\"0\"/></location><sky><vector x=\"0\" y=\"1\" \
                 z=\"0\"/></sky><look_at><vector x=\"0\" y=\"0\" z=\"1\"/></look_at></camera><world><sphere radius=\"1\">\
                 <location><vector x=\"0\" y=\"0\" z=\"5\"/></location></sphere></world></scene>";
    let twice = small.replace("</world>", "<plane/><light><position/></light></world>");
    Ok(vec![
        ("every_element", every),
        ("mirrors", std::fs::read(scenes.join("mirrors.xml"))?),
        ("small", small.into()),
        ("utf16", utf16(small)),
        ("wrong", twice.into()),
    ])
}

fn pixmap() -> Seeds {
    vec![
        ("plain", b"P3\n# a comment\n2 2\n255\n1 2 3 4 5 6\n7 8 9 255 0 128\n".to_vec()),
        ("raw", b"P6 3 1 255\n\x00\x01\x02\x03\x04\x05\xfd\xfe\xff".to_vec()),
        ("crlf", b"P6\r\n1 1\r\n255\r\n\x01\x02\x03".to_vec()),
        ("wide", b"P6 2 1 65535 \x00\x01\x00\x02\x00\x03\xff\xff\x80\x00\x00\x00".to_vec()),
        ("odd", b"P3 1 1 100 100 0 50".to_vec()),
        ("grey", b"P5 2 1 255\n\x00\xff".to_vec()),
        ("huge", b"P6 65536 65536 255\n".to_vec()),
    ]
}

fn scene_binary() -> Seeds {
    let written = |scene: &Scene| SceneEncoder::new(scene, 4096).flatten().collect();
    let seed = |document: generate::Document| written(&document.scene().expect("a scene"));
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/every_element.xml");
    let every = read_file(&path, &ReadOptions::default()).expect("a scene").scene;
    vec![
        ("every_element", written(&every)),
        ("mirrors", seed(generate::mirrors())),
        ("terrain", seed(generate::terrain(3))),
        ("lights", seed(generate::lights(3, 5))),
    ]
}

fn settings() -> Settings {
    Settings {
        view: View::new(16, 12, 1.0, 1.0).expect("a view"),
        max_depth: 6,
        sampling: Sampling::Adaptive,
        transfer: Transfer::Srgb,
    }
}

fn lease(region: Region, pass: u32) -> Lease {
    let detail = Detail::Within(Tolerance::new(0.01));
    let pass_of = (pass > 0).then_some(Pass { detail, audit: AuditRate(1 << 12) });
    Lease { id: LeaseId(0), attempt: Attempt(0), region, number: PassNumber(pass), pass: pass_of }
}

fn done(pixels: usize) -> TileDone {
    TileDone {
        lease: LeaseId(0),
        attempt: Attempt(0),
        pixels: (0..3 * pixels).map(|n| n as u8).collect::<Vec<u8>>().into(),
        error: ErrorEstimate { pixels: pixels as u64, audited: 2, squares: Sum(1 << 70), ..ErrorEstimate::default() },
        rays: RayCounts { camera: pixels as u64, ..RayCounts::default() },
        busy: std::time::Duration::from_millis(3),
        idle: std::time::Duration::ZERO,
    }
}

fn journal() -> Seeds {
    let region = Region { x0: 0, y0: 0, x1: 16, y1: 12 };
    let blocks = region.blocks(8);
    let head = |verified, limit| journal::Head {
        build: BUILD.into(),
        numeric_mode: NUMERIC_MODE.into(),
        scene_sha256: vec![1; 32],
        pictures_sha256: vec![2; 32],
        settings: Some(settings().into()),
        region: Some(region.into()),
        pixels: wire::PixelFormat::Rgb8.into(),
        max_error: 0.001,
        time_limit_us: limit,
        verified,
    };
    let tile = |n: usize, pass: u32, key: u8| {
        let (region, key) = (blocks[n], vec![key; 32]);
        let (lease, done) = (Some(lease(region, pass).into()), Some(done(region.area() as usize).into()));
        let sum_sha256 = vec![9; 32];
        record::Kind::Tile(journal::Tile { lease, done, worker: "bert".into(), at_us: 5, key, sum_sha256 })
    };
    let passed = record::Kind::Passed(journal::Passed { pass: 0, took_ns: 10, now_ns: 20 });
    let checked = record::Kind::Checked(journal::Checked {
        pass: 0,
        region: Some(blocks[0].into()),
        made_by: "bert".into(),
        checked_by: String::new(),
        agreed: true,
        confirmed: true,
    });
    let out = journal::ThrownOut { key: vec![4; 32], name: "eve".into(), rule: "it lied".into(), redone: 1 };
    let kinds = [
        vec![record::Kind::Head(head(false, 0)), tile(0, 0, 0), tile(1, 0, 0)],
        vec![record::Kind::Head(head(false, 7)), tile(0, 0, 0), tile(1, 0, 0), passed, tile(3, 1, 0)],
        vec![
            record::Kind::Head(head(true, 0)),
            tile(0, 0, 3),
            checked,
            tile(1, 0, 4),
            record::Kind::ThrownOut(out),
            tile(1, 0, 3),
        ],
    ];
    let bodies = kinds.map(|kinds| {
        let mut input = vec![1];
        for kind in kinds {
            let body = Record { kind: Some(kind) }.encode_to_vec();
            input.extend((body.len() as u16).to_le_bytes());
            input.extend(body);
        }
        input
    });
    let file = super::targets::framed(&bodies[1][1..]);
    let [plain, timed, verified] = bodies;
    vec![("plain", plain), ("timed", timed), ("verified", verified), ("file", file), ("torn", b"TSRJRN01\x05".to_vec())]
}

fn worker_message() -> Seeds {
    use worker_message::Kind;
    let seed = |kind| WorkerMessage { kind: Some(kind) }.encode_to_vec();
    let register = Registration {
        name: "bert \u{202e}\u{1b}[1m".into(),
        threads: 4,
        id: WorkerId([5; 32]),
        proof: vec![6; 64],
        local: Some(Secret::from([7; 16])),
    };
    vec![
        ("register", seed(Kind::Register(register.into()))),
        ("ready", seed(Kind::Ready(wire::Ready { job: 0 }))),
        ("done", seed(Kind::TileDone(done(4).into()))),
        ("empty", seed(Kind::TileDone(TileDone { pixels: Bytes::new(), ..done(0) }.into()))),
        ("failed", seed(Kind::TileFailed(wire::TileFailed { lease: 1, attempt: 2, cause: "no\u{7}\nmemory".into() }))),
        ("returned", seed(Kind::LeaseReturned(wire::LeaseReturned { lease: 1, attempt: 2 }))),
        ("unable", seed(Kind::Unable(wire::Unable { cause: "too large".into(), job: 0 }))),
    ]
}

fn coordinator_message() -> Seeds {
    use coordinator_message::Kind;
    let seed = |kind| CoordinatorMessage { kind: Some(kind) }.encode_to_vec();
    let (hash, length) = describe(&generate::mirrors().scene().expect("a scene"));
    let number = JobNumber(3);
    let job = |scene: Option<(SceneHash, u64)>| Job { number, scene, settings: settings(), pixels: PixelFormat::F32 };
    let welcome = wire::Welcome {
        session: 1,
        name: "bert (2)".into(),
        heartbeat_interval_ms: 500,
        suspect_after_ms: 2000,
        dead_after_ms: 5000,
    };
    let region = Region { x0: 8, y0: 0, x1: 16, y1: 8 };
    vec![
        ("welcome", seed(Kind::Welcome(welcome))),
        ("job", seed(Kind::Job(job(Some((hash, length))).into()))),
        ("job_of_its_own", seed(Kind::Job(job(None).into()))),
        ("lease", seed(Kind::Lease(lease(region, 0).into()))),
        ("lease_of_a_pass", seed(Kind::Lease(lease(region, 3).into()))),
        ("revoke", seed(Kind::Revoke(wire::Revoke { lease: 3 }))),
        ("finished", seed(Kind::Finished(wire::Finished { leave: false }))),
    ]
}

fn token() -> Seeds {
    let token = Token { pin: Pin::of(b"certificate"), secret: Secret::from([8; 16]) }.reveal();
    vec![
        ("token", token.clone().into()),
        ("lines", format!("  {token}\r\n").into()),
        ("other", b"tessera2.a.b".to_vec()),
    ]
}
