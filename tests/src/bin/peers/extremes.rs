//! Small scenes at the limits of numbers: how many of them each program gets right.

use std::path::Path;

use serde_json::json;
use tessera_core::film::file;
use tessera_core::scene::Pigment;
use tessera_core::settings::{Settings, Transfer};
use tessera_tests::compare::{Image, difference};
use tessera_tests::generate::Document;
use tessera_tests::generate::contact::contact;
use tessera_tests::generate::extreme::random;
use tessera_tests::subject::truth;

use crate::Result;
use crate::program::{Job, Program};
use crate::scenes::SceneFile;

/// Scenes of each set.
const SCENES: u64 = 60;
/// Peers may be wrong in this share of the pixels where edges are what it is about.
const ALMOST: f64 = 0.005;

/// How one program fared with one set of scenes.
#[derive(Clone, Debug)]
pub(crate) struct Row {
    pub(crate) set: &'static str,
    pub(crate) program: &'static str,
    /// Scenes that could be said in its language.
    pub(crate) given: usize,
    /// Of them, with no pixel wrong, and with at most [`ALMOST`] of them.
    pub(crate) right: usize,
    pub(crate) almost: usize,
    /// Of them, without a picture at all: all pixels count as wrong.
    pub(crate) failed: usize,
    pub(crate) wrong: usize,
    pub(crate) pixels: usize,
}

impl Row {
    pub(crate) fn json(&self) -> serde_json::Value {
        json!({
            "set": self.set, "program": self.program, "given": self.given, "right": self.right,
            "almost": self.almost, "failed": self.failed, "wrong": self.wrong, "pixels": self.pixels,
        })
    }
}

type Make = fn(u64) -> (Document, Settings);

/// Renders every set by every program that has the words for it.
///
/// # Errors
/// When files cannot be written, or our own program fails.
pub(crate) fn measure(programs: &[Program], out: &Path) -> Result<Vec<Row>> {
    let sets: [(&'static str, Make); 2] =
        [("mixed", |seed| random(seed, 64, 48)), ("contact", |seed| contact(seed, 64, 48))];
    // Tachyon samples pixels at a corner: its pictures cannot be held against anything.
    let programs: Vec<&Program> = programs.iter().filter(|p| **p != Program::Tachyon).collect();
    let mut rows = Vec::new();
    for (set, make) in sets {
        let empty = |p: &&Program| Row {
            set,
            program: p.name(),
            given: 0,
            right: 0,
            almost: 0,
            failed: 0,
            wrong: 0,
            pixels: 0,
        };
        let mut of_set: Vec<Row> = programs.iter().map(empty).collect();
        for seed in 0..SCENES {
            let (document, settings) = make(seed);
            // Every program takes colours as linear.
            let settings = Settings { transfer: Transfer::Linear, ..settings };
            let Ok(scene) = document.scene() else { continue };
            let expected = truth(&scene, &settings).clamped();
            let name = format!("{set}-{seed}");
            document.write(out, &name)?;
            let file = SceneFile { path: out.join(format!("{name}.xml")), name };
            let job = Job { scene: &file, settings: &settings, threads: 2, folder: out };
            let pictured = scene.surfaces().iter().any(|s| matches!(s.pigment, Pigment::Texture(_)));
            for (program, row) in programs.iter().zip(&mut of_set) {
                if matches!(program, Program::Embree(_)) && (pictured || settings.view.zoom() != 1.0) {
                    continue;
                }
                program.export(&scene, &job)?;
                let picture = program.run(&job).and_then(|_| read(&out.join(program.picture(&file.name))));
                let pixels = expected.pixels.len();
                let wrong = match &picture {
                    Ok(picture) => difference(&expected, picture).wrong.len(),
                    Err(e) if matches!(program, Program::Tessera(_)) => {
                        return Err(format!("{}: {e}", file.name).into());
                    }
                    Err(_) => pixels,
                };
                row.given += 1;
                row.right += usize::from(wrong == 0);
                row.almost += usize::from(wrong as f64 <= ALMOST * pixels as f64);
                row.failed += usize::from(picture.is_err());
                row.wrong += wrong;
                row.pixels += pixels;
                eprintln!("{}: {} has {wrong} pixels wrong", file.name, program.name());
            }
        }
        rows.append(&mut of_set);
    }
    Ok(rows)
}

fn read(path: &Path) -> Result<Image> {
    let stored = file::read(path).map_err(|e| format!("{}: {e}", path.display()))?.image;
    let pixels = stored.pixels().iter().map(|p| p.map(f64::from)).collect();
    Ok(Image { width: stored.width() as usize, height: stored.height() as usize, pixels }.clamped())
}
