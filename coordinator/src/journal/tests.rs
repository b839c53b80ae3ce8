//! Journals written, cut, damaged and read again.

use std::io::Write;
use std::path::PathBuf;

use glam::DVec3;
use proptest::prelude::*;
use tempfile::TempDir;
use tessera_core::film::{ErrorEstimate, Region};
use tessera_core::scene::{Pigment, Scene, SceneBuilder, Surface, Texture};
use tessera_core::settings::{AuditRate, Detail, Pass, Sampling, Settings, Tolerance, Transfer, View};
use tessera_core::trace::RayCounts;
use tessera_proto::convert::{Lease, TileDone};
use tessera_proto::journal::Record;
use tessera_proto::{Attempt, LeaseId, PassNumber, PixelFormat};

use super::frame::{MAGIC, put};
use super::*;
use crate::plan::Goal;

fn scene(diffuse: f64, shade: u8) -> Scene {
    let mut b = SceneBuilder::new();
    b.camera(DVec3::new(0.0, 1.0, -5.0), DVec3::Y, DVec3::ZERO).unwrap();
    let picture = b.texture(Texture::from_bytes(1, 1, 255, vec![shade; 3]).unwrap()).unwrap();
    let surface = Surface { diffuse, pigment: Pigment::Texture(picture), ..Surface::default() };
    let surface = b.surface(surface).unwrap();
    b.sphere(DVec3::ZERO, 1.0, None, surface).unwrap();
    b.finish().unwrap()
}

fn settings() -> Settings {
    Settings {
        view: View::new(64, 48, 1.0, 1.0).unwrap(),
        max_depth: 6,
        sampling: Sampling::Uniform { grid: 2 },
        transfer: Transfer::Srgb,
    }
}

const WHOLE: Region = Region { x0: 0, y0: 0, x1: 64, y1: 48 };

fn head() -> Head {
    Head::new(&scene(0.5, 7), settings(), WHOLE, PixelFormat::Rgb8, Goal::AsSet)
}

/// The `n`-th tile of a pass, with pixels that tell it from all others.
fn tile(n: u32, pass: u32) -> (Lease, TileDone) {
    let region = WHOLE.blocks(8)[n as usize];
    let audit = AuditRate(1 << 12);
    let detail = (pass > 0).then(|| Pass { detail: Detail::Within(Tolerance::new(0.01)), audit });
    let lease = Lease { id: LeaseId(0), attempt: Attempt(0), region, number: PassNumber(pass), pass: detail };
    let shade = |i: u64| (i as u8).wrapping_mul(31) ^ (40 * pass + n) as u8;
    let done = TileDone {
        lease: LeaseId(0),
        attempt: Attempt(0),
        pixels: (0..3 * region.area()).map(shade).collect::<Vec<u8>>().into(),
        error: ErrorEstimate { pixels: region.area(), audited: u64::from(n) + 1, ..ErrorEstimate::default() },
        rays: RayCounts { camera: region.area(), ..RayCounts::default() },
        busy: Duration::from_millis(3),
        idle: Duration::ZERO,
    };
    (lease, done)
}

/// By a worker, at a time.
fn by(at: Duration) -> Delivery {
    Delivery { name: "w".into(), at, made: None }
}

/// A journal's path in a folder of its own.
fn path() -> (TempDir, PathBuf) {
    let at = tempfile::tempdir().unwrap();
    let path = at.path().join("a.png.journal");
    (at, path)
}

/// Keeps these tiles of the first pass in the journal at `path`, going on from what is there.
fn keep(path: &Path, tiles: std::ops::Range<u32>) {
    let journal = Journal::open(path, false).unwrap().after(Duration::ZERO);
    let (sink, _) = journal.start(head);
    let mut sink = sink.unwrap();
    for n in tiles {
        let (lease, done) = tile(n, 0);
        sink.tile(lease, &done, true, by(Duration::from_secs(n.into())));
    }
    drop(sink);
    assert_eq!(journal.kept(), Some(path));
}

/// What is read again: tiles with their pixels.
fn found(path: &Path) -> Result<Vec<(Lease, Bytes)>, JournalError> {
    let journal = Journal::open(path, false)?;
    journal.check(&head())?;
    let Some(found) = journal.recovered.lock().unwrap().take() else { return Ok(Vec::new()) };
    let tiles = found.passes.values().flat_map(|pass| &pass.tiles);
    Ok(tiles.map(|t| (t.lease, pixels(&found.reader, t.place).unwrap())).collect())
}

fn expected(tiles: std::ops::Range<u32>) -> Vec<(Lease, Bytes)> {
    tiles.map(|n| tile(n, 0)).map(|(lease, done)| (lease, done.pixels)).collect()
}

#[test]
fn what_was_kept_is_found_and_gone_on_with() {
    let (_at, path) = path();
    keep(&path, 0..5);
    assert_eq!(found(&path).unwrap(), expected(0..5));
    let journal = Journal::open(&path, false).unwrap();
    assert_eq!(journal.share(), Some((5.0 / 48.0, 0)));
    drop(journal);
    keep(&path, 5..8);
    assert_eq!(found(&path).unwrap(), expected(0..8));
    let journal = Journal::open(&path, false).unwrap();
    let (sink, found) = journal.start(head);
    assert_eq!(found.unwrap().spent, Duration::from_secs(7));
    drop(sink);
    journal.remove();
    assert!(!path.exists());
}

#[test]
fn a_render_of_which_nothing_is_done_leaves_nothing_however_long_it_lasts() {
    let (_at, path) = path();
    let journal = Journal::open(&path, false).unwrap().after(Duration::ZERO);
    let (sink, _) = journal.start(|| panic!("nobody asks for it"));
    drop(sink);
    assert_eq!(journal.kept(), None);
    assert!(!path.exists());
}

#[test]
fn a_short_render_leaves_nothing() {
    let (_at, path) = path();
    let journal = Journal::open(&path, false).unwrap();
    let (sink, _) = journal.start(|| panic!("nobody asks for it"));
    let (lease, done) = tile(0, 0);
    sink.unwrap().tile(lease, &done, true, by(Duration::ZERO));
    assert_eq!(journal.kept(), None);
    assert!(!path.exists());
}

#[test]
fn passes_are_kept_with_their_times_and_looks_without_pixels() {
    let (_at, path) = path();
    let journal = Journal::open(&path, false).unwrap().after(Duration::ZERO);
    let (sink, _) = journal.start(head);
    let mut sink = sink.unwrap();
    let (lease, done) = tile(0, 0);
    sink.tile(lease, &done, false, by(Duration::ZERO));
    let (took, now) = (Duration::from_nanos(1_234_567_891), Duration::from_nanos(9_876_543_211));
    sink.passed(0, took, now);
    let (lease, done) = tile(3, 1);
    sink.tile(lease, &done, true, by(now));
    drop(sink);
    assert!(journal.kept().is_some());
    drop(journal);
    let (_, found) = Journal::open(&path, false).unwrap().start(head);
    let found = found.unwrap();
    assert_eq!(found.passes[&0].ended, Some((took, now)));
    assert_eq!((found.passes[&0].tiles[0].error.audited, found.passes[&0].tiles.len()), (1, 1));
    assert!(pixels(&found.reader, found.passes[&0].tiles[0].place).unwrap().is_empty());
    assert_eq!(pixels(&found.reader, found.passes[&1].tiles[0].place).unwrap(), done.pixels);
    assert_eq!((found.passes[&1].tiles[0].lease, found.passes[&1].ended), (lease, None));
}

/// A file of a head and three tiles, as a crash between syncs leaves it: the last says that so much is on the disk.
fn file(synced: impl Fn(&[u8]) -> u64) -> Vec<u8> {
    let mut bytes = MAGIC.to_vec();
    put(&mut bytes, &Record { kind: Some(Kind::Head(head().into())) }, 0);
    for n in 0..3 {
        let synced = if n == 2 { synced(&bytes) } else { 0 };
        let (lease, done) = tile(n, 0);
        let tile = tessera_proto::journal::Tile {
            lease: Some(lease.into()),
            done: Some(done.into()),
            worker: "w".into(),
            ..Default::default()
        };
        put(&mut bytes, &Record { kind: Some(Kind::Tile(tile)) }, synced);
    }
    bytes
}

#[test]
fn cut_anywhere_it_goes_on_from_what_is_whole() {
    let (_at, path) = path();
    for bytes in [file(|_| 0), file(|before| before.len() as u64)] {
        let mut most = 0;
        for end in 0..=bytes.len() {
            std::fs::write(&path, &bytes[..end]).unwrap();
            let found = found(&path).unwrap();
            assert_eq!(found, expected(0..found.len() as u32), "cut at {end}");
            assert!(found.len() >= most, "cut at {end}");
            most = found.len();
            let _ = std::fs::remove_file(&path);
        }
        assert_eq!(most, 3);
        // What is torn off does not stand in the way of what comes.
        std::fs::write(&path, &bytes[..bytes.len() - 1]).unwrap();
        keep(&path, 2..5);
        assert_eq!(found(&path).unwrap(), expected(0..5));
        std::fs::remove_file(&path).unwrap();
    }
}

#[test]
fn a_flipped_bit_is_refused_or_costs_what_was_not_on_the_disk_yet() {
    let (_at, path) = path();
    let mut whole = file(|before| before.len() as u64);
    // Where the last tile begins: what is before it is known to have been on the disk.
    let last = std::cell::Cell::new(0);
    file(|before| {
        last.set(before.len());
        0
    });
    let last = last.get();
    let mut refused = 0;
    for at in 0..whole.len() {
        for bit in 0..8 {
            whole[at] ^= 1 << bit;
            std::fs::write(&path, &whole).unwrap();
            match found(&path) {
                Ok(found) => {
                    assert_eq!(found, expected(0..found.len() as u32), "byte {at}, bit {bit}");
                    assert!(at >= last && found.len() == 2, "byte {at}, bit {bit} was not noticed");
                }
                Err(e) => {
                    refused += 1;
                    let said = e.to_string();
                    assert!(said.contains("--restart") || said.contains("--journal"), "{said}");
                }
            }
            whole[at] ^= 1 << bit;
        }
    }
    assert_eq!(refused, 8 * last);
}

#[test]
fn damage_far_behind_is_seen_across_any_number_of_bytes() {
    let (_at, path) = path();
    let mut bytes = file(|_| 0);
    let damaged = bytes.len() - 30;
    // As a file system may leave it, with a sound frame far behind that knows better.
    bytes[damaged] ^= 1;
    bytes.resize(bytes.len() + (2 << 20) + 7, 0);
    std::fs::write(&path, &bytes).unwrap();
    assert_eq!(found(&path).unwrap(), expected(0..2), "a tail of zeros");
    std::fs::write(&path, &bytes).unwrap();
    let mut frame = Vec::new();
    let synced = bytes.len() as u64;
    put(&mut frame, &Record { kind: Some(Kind::Passed(tessera_proto::journal::Passed::default())) }, synced);
    std::fs::OpenOptions::new().append(true).open(&path).unwrap().write_all(&frame).unwrap();
    assert!(matches!(found(&path), Err(JournalError::Damaged { .. })));
    // What stood before it can be seen, and one may begin anew.
    let partial = Partial::read(&path).unwrap();
    assert!(partial.damaged.is_some() && partial.share() == 2.0 / 48.0);
    assert!(!Journal::open(&path, true).unwrap().goes_on());
    assert!(!path.exists());
}

#[test]
fn other_files_are_left_alone() {
    let (_at, path) = path();
    for content in ["<scene/>", "TSRJRN99 of another version", "T"] {
        std::fs::write(&path, content).unwrap();
        let opened = Journal::open(&path, false);
        match content {
            "T" => assert!(!opened.unwrap().goes_on(), "the beginning of one"),
            "<scene/>" => {
                assert!(matches!(opened, Err(JournalError::Foreign(_))));
                assert!(matches!(Journal::open(&path, true), Err(JournalError::Foreign(_))));
                assert_eq!(std::fs::read_to_string(&path).unwrap(), content);
            }
            _ => assert!(matches!(opened, Err(JournalError::Version(_)))),
        }
        let _ = std::fs::remove_file(&path);
    }
}

#[test]
fn two_renders_do_not_write_one_journal() {
    let (_at, path) = path();
    keep(&path, 0..2);
    let first = Journal::open(&path, false).unwrap();
    assert!(matches!(Journal::open(&path, false), Err(JournalError::Busy(_))));
    assert!(matches!(Journal::open(&path, true), Err(JournalError::Busy(_))));
    // Looking is free.
    assert_eq!(Partial::read(&path).unwrap().share(), 2.0 / 48.0);
    drop(first);
    assert!(Journal::open(&path, false).is_ok());
}

#[test]
fn another_picture_is_refused_and_what_differs_is_named() {
    let (_at, path) = path();
    keep(&path, 0..2);
    let named = |now: &Head| match Journal::open(&path, false).unwrap().check(now) {
        Ok(()) => String::new(),
        Err(e) => e.to_string(),
    };
    assert_eq!(named(&head()), "");
    let of = |change: &dyn Fn(&mut Settings)| {
        let mut changed = settings();
        change(&mut changed);
        Head::new(&scene(0.5, 7), changed, WHOLE, PixelFormat::Rgb8, Goal::AsSet)
    };
    let view = |w, h, zoom, height| View::new(w, h, zoom, height).unwrap();
    let part = Region { x1: 32, ..WHOLE };
    let (one, other) = (scene(0.5, 7), scene(0.4, 7));
    for (now, word) in [
        (of(&|s| s.view = view(65, 48, 1.0, 1.0)), "--size (64x48 there, 65x48 now)"),
        (of(&|s| s.view = view(64, 48, 2.0, 1.0)), "--zoom (1 there, 2 now)"),
        (of(&|s| s.view = view(64, 48, 1.0, 2.0)), "--plane-height"),
        (of(&|s| s.max_depth = 7), "--max-depth (6 there, 7 now)"),
        (of(&|s| s.transfer = Transfer::Linear), "--transfer (srgb there, linear now)"),
        (
            of(&|s| s.sampling = Sampling::Scrambled { samples: 4 }),
            "the accuracy (--samples 4 there, --samples 4 --pattern scrambled now)",
        ),
        (of(&|s| s.sampling = Sampling::Uniform { grid: 3 }), "the accuracy (--samples 4 there, --samples 9 now)"),
        (Head::new(&one, settings(), WHOLE, PixelFormat::F32, Goal::AsSet), "the depth of pixels (8 bits there"),
        (
            Head::new(&one, settings(), part, PixelFormat::Rgb8, Goal::AsSet),
            "--region (0,0,64,48 there, 0,0,32,48 now)",
        ),
        (Head::new(&one, settings(), WHOLE, PixelFormat::Rgb8, Goal::Error(0.5 / 255.0)), "--max-error 0.5"),
        (Head::new(&other, settings(), WHOLE, PixelFormat::Rgb8, Goal::AsSet), "other are: the scene."),
        (Head::new(&scene(0.5, 8), settings(), WHOLE, PixelFormat::Rgb8, Goal::AsSet), "are: the scene's pictures."),
    ] {
        let said = named(&now);
        assert!(said.contains(word) && said.contains("--restart"), "'{word}' is not in: {said}");
        assert_eq!(said.matches(" now").count(), usize::from(word.contains('(') || word.contains("--")), "{said}");
    }
    // The builds are the same here: what another one would say is taken from the file.
    let mut wire: tessera_proto::journal::Head = head().into();
    wire.build = "0.0.9+abc".into();
    wire.numeric_mode = "older".into();
    let older = Head::try_from(wire).unwrap().differences(&head());
    assert!(
        older[0].contains("the program's build (0.0.9+abc there") && older[1].contains("numeric mode"),
        "{older:?}"
    );
}

#[test]
fn a_head_survives_the_file() {
    for goal in [
        Goal::AsSet,
        Goal::Error(0.5 / 255.0),
        Goal::Time { limit: Duration::from_micros(90_000_001), error: None },
        Goal::Time { limit: Duration::from_secs(3), error: Some(0.01) },
    ] {
        for pixels in [PixelFormat::Rgb8, PixelFormat::Rgb16, PixelFormat::F32] {
            let head = Head::new(&scene(0.5, 7), settings(), WHOLE, pixels, goal);
            let wire: tessera_proto::journal::Head = head.clone().into();
            assert_eq!(Head::try_from(wire).unwrap(), head);
        }
    }
}

/// A frame around any body, its checksums right.
fn framed(body: &[u8], synced: u64) -> Vec<u8> {
    let mut head = [(body.len() as u32).to_le_bytes(), crc32fast::hash(body).to_le_bytes()].concat();
    head.extend(synced.to_le_bytes());
    head.extend(crc32fast::hash(&head).to_le_bytes());
    [&head, body].concat()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, ..ProptestConfig::default() })]

    /// Whatever stands in a file, reading it ends, with what it says or with an error.
    #[test]
    fn nonsense_is_read_as_nothing_or_refused(
        bodies in prop::collection::vec((prop::collection::vec(any::<u8>(), 1..40), any::<u64>()), 0..6),
        edits in prop::collection::vec((any::<u16>(), any::<u8>()), 0..20),
        begin in 0usize..3,
    ) {
        let (_at, path) = path();
        let mut bytes = match begin {
            0 => Vec::new(),
            1 => MAGIC.to_vec(),
            _ => file(|before| before.len() as u64),
        };
        for (body, synced) in bodies {
            bytes.extend(framed(&body, synced));
        }
        // Of records that are nearly right: their checksums made right again.
        if begin == 2 && !edits.is_empty() {
            let mut head = Vec::new();
            put(&mut head, &Record { kind: Some(Kind::Head(head_of_file())) }, 0);
            let mut body = head.split_off(20);
            for (at, value) in &edits {
                let at = usize::from(*at) % body.len();
                body[at] = *value;
            }
            bytes = [&MAGIC[..], &framed(&body, 0), &bytes[8..]].concat();
        }
        std::fs::write(&path, &bytes).unwrap();
        let _ = found(&path);
        let _ = std::fs::write(&path, &bytes);
        let _ = Partial::read(&path);
    }
}

fn head_of_file() -> tessera_proto::journal::Head {
    head().into()
}
