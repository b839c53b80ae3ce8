//! What pictures say of their own errors, against the truth: on scenes of detail below a pixel, on ordinary ones, and on
//! random ones of everything.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on may stop")]

use std::sync::Arc;

use coordinator::{Goal, Pixels, SceneSource};
use rayon::prelude::*;
use tessera_core::settings::{AuditRate, Detail, Pass, Sampling, Settings, Tolerance, Transfer, View};
use tessera_core::trace::{PreparedScene, Tracer};
use tessera_tests::cluster::Cluster;
use tessera_tests::generate::Document;
use tessera_tests::generate::fine::{self, Kind};
use tessera_tests::truth::{Truth, rmse, truth, whole};

/// Errors asked for, in 8-bit steps: the qualities draft, normal and final among them.
const TARGETS: [f64; 4] = [2.0, 0.5, 0.25, 0.1];

/// How errors were told and how they are, in 8-bit steps.
#[derive(Clone, Copy, Debug)]
struct Told {
    target: f64,
    rmse: f64,
    upper: f64,
    met: bool,
    /// Against the truth, which may be off by `own` itself.
    actual: f64,
    own: f64,
}

fn settings((width, height): (u32, u32)) -> Settings {
    let view = View::new(width, height, 1.0, 1.0).unwrap();
    Settings { view, max_depth: 4, sampling: Sampling::Adaptive, transfer: Transfer::Linear }
}

fn prepare(document: &Document) -> Arc<PreparedScene> {
    Arc::new(PreparedScene::build(Arc::new(document.scene().unwrap())))
}

/// A picture with at most an error of so many steps, by a farm.
fn render(scene: &Arc<PreparedScene>, settings: Settings, target: f64, truth: &Truth) -> Told {
    let mut cluster = Cluster::of(scene.scene().as_ref().clone());
    cluster.job.scene = SceneSource::Prepared(Arc::clone(scene));
    cluster.job.settings = settings;
    cluster.job.region = whole(&settings);
    cluster.job.goal = Goal::Error(target / 255.0);
    let rendered = cluster.render_unhurried().unwrap();
    let Some(Pixels::F32(pixels)) = rendered.image.pixels() else { panic!("not floats") };
    let error = rendered.error.unwrap();
    Told {
        target,
        rmse: 255.0 * error.rmse(),
        upper: 255.0 * error.interval().1,
        met: rendered.target_met.unwrap(),
        actual: 255.0 * rmse(pixels, &truth.pixels),
        own: 255.0 * truth.own,
    }
}

/// Renders scenes of every kind towards every target, and gives what `wrong` says of them.
fn faults(kinds: &[Kind], size: (u32, u32), seed: u64, wrong: impl Fn(&Told) -> Option<&'static str>) -> Vec<String> {
    let mut faults = Vec::new();
    for (kind, scene) in kinds {
        let (scene, settings) = (prepare(&scene(seed, size.1)), settings(size));
        let truth = truth(&scene, &settings, 4096);
        for target in TARGETS {
            let told = render(&scene, settings, target, &truth);
            println!("{kind}: {told:.3?}");
            if let Some(what) = wrong(&told) {
                faults.push(format!("{kind}: {what}: {told:.3?}"));
            }
        }
    }
    faults
}

/// Whether an error was told to be less than it is.
fn too_little(t: &Told) -> Option<&'static str> {
    if t.actual > 1.5 * t.upper + 2.0 * t.own {
        Some("more than one and a half times the upper end")
    } else if t.met != (t.upper <= t.target) {
        Some("met by its own measure, and not")
    } else if t.rmse < 0.1 * (t.actual - 2.0 * t.own) {
        Some("less than a tenth was told")
    } else {
        None
    }
}

#[test]
fn errors_of_fine_detail_are_told() {
    let faults: Vec<String> =
        [1].into_iter().flat_map(|seed| faults(&fine::FINE, (40, 30), seed, too_little)).collect();
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn ordinary_pictures_are_as_good_as_asked_for_and_hardly_better() {
    let wrong = |t: &Told| {
        let too_good = (t.actual + 2.0 * t.own < t.target / 3.0).then_some("much better than asked for");
        let missed = (!t.met).then_some("not as good as asked for");
        too_little(t).or(too_good).or(missed)
    };
    let faults = faults(&fine::ORDINARY, (64, 48), 5, wrong);
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

/// 95 % of intervals hold the truth, or nearly so many: chance is allowed two of its standard deviations.
#[test]
fn intervals_hold_the_truth() {
    const SCENES: u64 = 500;
    let missed: Vec<(u64, f64, (f64, f64))> = (0..SCENES)
        .into_par_iter()
        .filter_map(|seed| {
            let (scene, settings) = (prepare(&fine::everything(seed)), settings((24, 18)));
            let tolerance = Tolerance::new([16.0, 4.0, 1.0, 0.5][seed as usize % 4] / 255.0);
            let pass = Pass { detail: Detail::Within(tolerance), audit: AuditRate::ALL };
            let (tile, _) = Tracer::new(Arc::clone(&scene), settings).unwrap().render_pass(whole(&settings), pass);
            let truth = truth(&scene, &settings, 2048);
            let (actual, (low, high)) = (rmse(&tile.pixels, &truth.pixels), tile.error.interval());
            let holds = actual <= high + truth.own && actual >= low - truth.own;
            (!holds).then_some((seed, 255.0 * actual, (255.0 * low, 255.0 * high)))
        })
        .collect();
    let share = 1.0 - missed.len() as f64 / SCENES as f64;
    println!("{share}: {missed:.3?}");
    assert!(share >= 0.95 - 2.0 * (0.05 * 0.95 / SCENES as f64).sqrt(), "{share} hold the truth; not {missed:.3?}");
}
