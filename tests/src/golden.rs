//! Hashes of linear pixels on record: what no change may alter without raising `NUMERIC_MODE`.
//!
//! A line of the record is a case and its hash; the first line says in which numeric mode they were taken.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use tessera_core::film::{Region, pixels_sha256};
use tessera_core::scene::Scene;
use tessera_core::settings::{AuditRate, Detail, Pass, Sampling, Settings, Tolerance, Transfer, View};
use tessera_core::trace::{PreparedScene, Tracer};
use tessera_core::xml::{ReadOptions, read_file};
use tessera_proto::limits::NUMERIC_MODE;

use crate::generate::{contact, extreme, icosphere, lights, mesh_scene, mirrors, sphereflake, terrain};
use crate::program::scene;

/// A way to render any scene. Another sampling is another line here, and new hashes.
struct Way {
    name: &'static str,
    view: (u32, u32, f64, f64),
    max_depth: u32,
    sampling: Sampling,
    transfer: Transfer,
    /// How closely an adaptive pass looks.
    detail: Option<Closeness>,
    /// The whole picture where there is none.
    region: Option<Region>,
}

/// What an adaptive pass is asked for.
enum Closeness {
    /// A tolerance, in steps of 255.
    Steps(f64),
    /// One point in squares of so many pixels' edge.
    Coarse(u32),
}

impl Way {
    fn pass(&self) -> Option<Pass> {
        let detail = match self.detail.as_ref()? {
            Closeness::Steps(steps) => Detail::Within(Tolerance::new(steps / 255.0)),
            Closeness::Coarse(step) => Detail::Coarse { step: *step },
        };
        Some(Pass { detail, audit: AuditRate::ALL })
    }
}

const WAYS: [Way; 6] = [
    Way {
        name: "one sample",
        view: (97, 71, 1.0, 1.0),
        max_depth: 6,
        sampling: Sampling::Uniform { grid: 1 },
        transfer: Transfer::Srgb,
        detail: None,
        region: None,
    },
    Way {
        name: "nine samples, deep, closer",
        view: (40, 30, 1.5, 0.8),
        max_depth: 16,
        sampling: Sampling::Uniform { grid: 3 },
        transfer: Transfer::Linear,
        detail: None,
        region: None,
    },
    Way {
        name: "four samples of a part, no mirrors",
        view: (160, 120, 1.0, 1.0),
        max_depth: 1,
        sampling: Sampling::Uniform { grid: 2 },
        transfer: Transfer::Srgb,
        detail: None,
        region: Some(Region { x0: 53, y0: 41, x1: 96, y1: 83 }),
    },
    Way {
        name: "adaptive, loose",
        view: (80, 60, 1.0, 1.0),
        max_depth: 6,
        sampling: Sampling::Adaptive,
        transfer: Transfer::Linear,
        detail: Some(Closeness::Steps(16.0)),
        region: None,
    },
    Way {
        name: "adaptive, tight, a part",
        view: (64, 48, 1.2, 1.0),
        max_depth: 4,
        sampling: Sampling::Adaptive,
        transfer: Transfer::Srgb,
        detail: Some(Closeness::Steps(1.0)),
        region: Some(Region { x0: 13, y0: 7, x1: 47, y1: 41 }),
    },
    Way {
        name: "coarse",
        view: (70, 50, 1.0, 1.0),
        max_depth: 6,
        sampling: Sampling::Adaptive,
        transfer: Transfer::Srgb,
        detail: Some(Closeness::Coarse(4)),
        region: None,
    },
];

/// Scenes of the repository, and generated ones: large, touching, at the limits of numbers.
fn scenes() -> Vec<(String, Scene)> {
    let read = |name: &str| {
        let read = read_file(&scene(&format!("{name}.xml")), &ReadOptions::default());
        (name.to_owned(), read.expect("a scene of the repository is valid").scene)
    };
    let mut scenes: Vec<_> =
        ["demo", "every_element", "knot", "lights", "mirrors", "sphereflake2", "terrain8"].map(read).into();
    let mut made = |name: &str, document: crate::generate::Document| {
        scenes.push((name.to_owned(), document.scene().expect("a generated scene is valid")));
    };
    made("generated mirrors", mirrors());
    made("sphereflake of 4 levels", sphereflake(4));
    made("terrain of 64 x 64", terrain(64));
    made("200 spheres, 20 lights", lights(200, 20));
    made("icosphere", mesh_scene(icosphere(4)));
    made("basic, times 2^-700", extreme::basic().scaled(f64::from_bits((1023 - 700) << 52)));
    for seed in [3, 4, 5] {
        made(&format!("contact {seed}"), contact::contact(seed, 97, 71).0);
        made(&format!("extreme {seed}"), extreme::random(seed, 97, 71).0);
    }
    scenes
}

/// Renders every case; gives the hash of each.
///
/// # Panics
/// When a scene of the repository is not there or not valid.
#[must_use]
pub fn hashes() -> BTreeMap<String, String> {
    let mut hashes = BTreeMap::new();
    for (name, scene) in scenes() {
        let prepared = Arc::new(PreparedScene::build(Arc::new(scene)));
        for way in &WAYS {
            let (width, height, zoom, plane_height) = way.view;
            let view = View::new(width, height, zoom, plane_height).expect("a view in range");
            let settings = Settings { view, max_depth: way.max_depth, sampling: way.sampling, transfer: way.transfer };
            let tracer = Tracer::new(prepared.clone(), settings).expect("the scene has a view");
            let whole = Region { x0: 0, y0: 0, x1: width, y1: height };
            let region = way.region.unwrap_or(whole);
            let (tile, _) = match way.pass() {
                Some(pass) => tracer.render_pass(region, pass),
                None => tracer.render(region),
            };
            hashes.insert(format!("{name}; {}", way.name), pixels_sha256(&tile.pixels));
            if way.pass().is_some() {
                // What was found of the error belongs to the picture.
                let e = tile.error;
                let sums = [0, 32, 64, 96]
                    .map(|bit| [e.squares, e.variance, e.expected].map(|sum| f32::from_bits((sum.0 >> bit) as u32)));
                hashes.insert(format!("{name}; {}; error", way.name), pixels_sha256(&sums));
            }
        }
    }
    hashes
}

/// The record's file.
#[must_use]
pub fn file() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("golden/pixels.txt")
}

/// What is on record.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct Record {
    /// The mode under which the hashes were taken.
    pub mode: String,
    /// The hash of every case.
    pub hashes: BTreeMap<String, String>,
}

impl Record {
    /// Of `hashes`, in this program's mode.
    #[must_use]
    pub fn new(hashes: BTreeMap<String, String>) -> Self {
        Self { mode: NUMERIC_MODE.into(), hashes }
    }

    /// The record in `text`.
    #[must_use]
    pub fn parse(text: &str) -> Self {
        let mut lines = text.lines();
        let mode = lines.next().unwrap_or_default().trim_start_matches("mode: ").to_owned();
        let hash = |line: &str| line.split_once("  ").map(|(hash, case)| (case.to_owned(), hash.to_owned()));
        Self { mode, hashes: lines.filter_map(hash).collect() }
    }

    /// As the file holds it.
    #[must_use]
    pub fn text(&self) -> String {
        let mut text = format!("mode: {}\n", self.mode);
        for (case, hash) in &self.hashes {
            // Writing to a string does not fail.
            let _ = writeln!(text, "{hash}  {case}");
        }
        text
    }

    /// Cases that are on record here and have another hash, or none, in `now`.
    #[must_use]
    pub fn altered(&self, now: &Self) -> Vec<String> {
        self.hashes.iter().filter(|(case, hash)| now.hashes.get(*case) != Some(hash)).map(|(c, _)| c.clone()).collect()
    }

    /// Whether this record may be replaced by `now`: its hashes stand unless the mode was raised.
    ///
    /// # Errors
    /// Says which pixels changed, and what to do.
    pub fn replace(&self, now: &Self) -> Result<(), String> {
        let altered = self.altered(now);
        if altered.is_empty() || self.mode != now.mode {
            return Ok(());
        }
        Err(format!(
            "pixels changed in {} of {} cases, and NUMERIC_MODE ({}) did not: undo that, or raise it in \
             proto/src/limits.rs and run 'cargo run --release -p tessera-tests --bin golden'.\n  {}",
            altered.len(),
            self.hashes.len(),
            self.mode,
            altered.join("\n  ")
        ))
    }
}
