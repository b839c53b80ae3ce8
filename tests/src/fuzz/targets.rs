//! What is read, and what must hold of it.

use std::io::Write;
use std::path::Path;

use coordinator::journal::{Journal, Partial};
use prost::Message;
use tessera_core::film::Region;
use tessera_core::scene::{Scene, pixmap};
use tessera_core::settings::Settings;
use tessera_core::xml::{self, ReadOptions};
use tessera_proto::PixelFormat;
use tessera_proto::convert::{
    Job, Lease, Registration, TileDone, cause, check_match, check_pixels, check_size, printable,
};
use tessera_proto::scene::{SceneDecoder, SceneEncoder, describe};
use tessera_proto::token::{Secret, Token};
use tessera_proto::wire::{self, CoordinatorMessage, WorkerMessage, coordinator_message, worker_message};

/// A reader of what strangers write.
#[derive(Clone, Copy, Debug)]
pub struct Target {
    /// Also the name of its corpus.
    pub name: &'static str,
    /// Words of its language.
    pub words: &'static [&'static str],
    /// Reads an input; gives whether it is sound.
    pub reads: fn(&[u8]) -> bool,
}

const XML: [&str; 31] = [
    "<scene>",
    "</scene>",
    "<camera>",
    "<world>",
    "<sphere radius=\"1\">",
    "</sphere>",
    "<triangle>",
    "<c0>",
    "<v1>",
    "<plane distance=\"0\">",
    "<light>",
    "<position>",
    "<vector x=\"0\" y=\"1\" z=\"0\"/>",
    "<surface>",
    "<finish diffuse=\"1\" reflect=\"1\"/>",
    "<pigment>",
    "<image>",
    "<ppm file=\"checker.ppm\"/>",
    "<!--",
    "-->",
    "<![CDATA[",
    "]]>",
    "&#x41;",
    "&amp;",
    "<?xml version=\"1.0\" encoding=\"utf-16\"?>",
    "<!DOCTYPE scene [",
    "<?",
    "?>",
    "/>",
    "\u{feff}",
    "'",
];
const PIXMAP: [&str; 9] = ["P3\n", "P6\n", "P5\n", "#", "255\n", "65535\n", "4294967295 ", "\r\n", " 1 1 "];

/// All there are.
#[must_use]
pub fn targets() -> [Target; 7] {
    [
        Target { name: "scene_text", words: &XML, reads: scene_text },
        Target { name: "pixmap", words: &PIXMAP, reads: |bytes| pixmap::decode(bytes).is_ok() },
        Target { name: "scene_binary", words: &["TSRSCN01"], reads: scene_binary },
        Target { name: "journal", words: &["TSRJRN01"], reads: journal },
        Target { name: "worker_message", words: &[], reads: worker_message },
        Target { name: "coordinator_message", words: &[], reads: coordinator_message },
        Target { name: "token", words: &["tessera1.", "."], reads: token },
    ]
}

/// The one of a name.
///
/// # Panics
/// When there is none.
#[must_use]
pub fn target(name: &str) -> Target {
    targets().into_iter().find(|t| t.name == name).unwrap_or_else(|| panic!("no target '{name}'"))
}

fn scene_text(bytes: &[u8]) -> bool {
    let base = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes");
    match xml::read_bytes(bytes.to_vec(), "fuzz.xml", Some(&base), &ReadOptions::default()) {
        Ok(read) => {
            survives(&read.scene);
            true
        }
        Err(e) => {
            assert!(!e.diagnostics.is_empty(), "refused without a reason");
            let said = e.to_string();
            let raw = |c: char| c.is_control() && c != '\n';
            assert!(!said.contains(raw), "raw characters reach the terminal: {said:?}");
            false
        }
    }
}

/// That a scene is the same after a journey.
fn survives(scene: &Scene) {
    let (hash, length) = describe(scene);
    let mut decoder = SceneDecoder::new(length).expect("no longer than allowed");
    for piece in SceneEncoder::new(scene, 1000) {
        decoder.push(&piece).expect("what was written");
    }
    let again = decoder.finish().expect("a scene");
    assert_eq!(describe(&again), (hash, length), "another scene came out");
}

fn scene_binary(bytes: &[u8]) -> bool {
    // In pieces of an odd length, so that everything lies across two of them at times.
    let Ok(mut decoder) = SceneDecoder::new(bytes.len() as u64) else { return false };
    if bytes.chunks(997).any(|piece| decoder.push(piece).is_err()) {
        return false;
    }
    let Ok(scene) = decoder.finish() else { return false };
    survives(&scene);
    true
}

/// The bytes of a file; or, behind a first byte of 1, the bodies of records, each behind two bytes of length, which
/// are framed soundly so that what is in them is looked at.
fn journal(bytes: &[u8]) -> bool {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("journal");
    let content = match bytes.split_first() {
        Some((1, bodies)) => framed(bodies),
        _ => bytes.to_vec(),
    };
    std::fs::write(&path, &content).expect("a file");
    if let Ok(partial) = Partial::read(&path) {
        assert!((0.0..=1.0).contains(&partial.share()));
        let area = partial.region.area() as usize;
        assert!(partial.image.len() == area && partial.present.len() == area);
    }
    let opened = Journal::open(&path, false);
    opened.is_ok_and(|journal| journal.goes_on() && journal.share().is_some())
}

pub(super) fn framed(mut bodies: &[u8]) -> Vec<u8> {
    let mut file = b"TSRJRN01".to_vec();
    while let [a, b, rest @ ..] = bodies {
        let length = usize::from(u16::from_le_bytes([*a, *b])).min(rest.len());
        let (body, more) = rest.split_at(length);
        let mut head = [(length as u32).to_le_bytes(), crc32fast::hash(body).to_le_bytes()].concat();
        head.extend([0; 8]);
        head.extend(crc32fast::hash(&head).to_le_bytes());
        file.write_all(&head).and_then(|()| file.write_all(body)).expect("memory takes it");
        bodies = more;
    }
    file
}

fn worker_message(bytes: &[u8]) -> bool {
    let Ok(message) = WorkerMessage::decode(bytes) else { return false };
    match message.kind {
        Some(worker_message::Kind::Register(r)) => {
            if let Err(mismatch) = check_match(&r) {
                assert!(mismatch.to_string().len() < 400, "whole messages are repeated");
            }
            let Ok(registration) = Registration::try_from(r) else { return false };
            let wire: wire::Register = registration.clone().into();
            assert_eq!(Registration::try_from(wire), Ok(registration));
            true
        }
        Some(worker_message::Kind::TileDone(done)) => {
            let Ok(done) = TileDone::try_from(done) else { return false };
            let region = Region { x0: 3, y0: 5, x1: 7, y1: 9 };
            for format in [PixelFormat::Rgb8, PixelFormat::Rgb16, PixelFormat::F32] {
                let _ = (check_pixels(&done.pixels, format), check_size(&done.pixels, format, &region));
            }
            let wire: wire::TileDone = done.clone().into();
            let again = TileDone::try_from(wire).expect("what was written");
            // An error of no pixels says nothing, and is not sent.
            assert!(again == done || done.error.pixels == 0);
            true
        }
        Some(worker_message::Kind::TileFailed(failed)) => clean(&cause(&failed.cause)),
        Some(worker_message::Kind::Unable(unable)) => clean(&cause(&unable.cause)),
        Some(_) => true,
        None => false,
    }
}

fn clean(text: &str) -> bool {
    assert!(!text.contains(char::is_control) && text.len() <= 4096, "raw characters in {text:?}");
    true
}

fn coordinator_message(bytes: &[u8]) -> bool {
    let Ok(message) = CoordinatorMessage::decode(bytes) else { return false };
    match message.kind {
        Some(coordinator_message::Kind::Welcome(welcome)) => clean(&printable(&welcome.name)),
        Some(coordinator_message::Kind::Job(job)) => {
            let Ok(job) = Job::try_from(job) else { return false };
            let settings: wire::Settings = job.settings.into();
            assert_eq!(Settings::try_from(settings), Ok(job.settings));
            let wire: wire::Job = job.clone().into();
            assert_eq!(Job::try_from(wire), Ok(job));
            true
        }
        Some(coordinator_message::Kind::Lease(lease)) => {
            let Ok(lease) = Lease::try_from(lease) else { return false };
            let wire: wire::Lease = lease.into();
            assert_eq!(Lease::try_from(wire), Ok(lease));
            true
        }
        Some(_) => true,
        None => false,
    }
}

fn token(bytes: &[u8]) -> bool {
    let Ok(text) = std::str::from_utf8(bytes) else { return false };
    let _ = Secret::parse(text);
    match text.parse::<Token>() {
        Ok(token) => {
            assert_eq!(token.reveal().parse(), Ok(token));
            true
        }
        Err(e) => {
            assert!(text.len() < 20 || !e.to_string().contains(text), "what may be a secret is repeated");
            false
        }
    }
}
