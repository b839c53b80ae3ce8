//! The oracles against each other and against closed forms.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on may stop")]

use glam::{DVec3, dvec3};
use tessera_core::settings::{Sampling, Settings, Transfer, View};
use tessera_tests::compare::{assert_same_picture, difference};
use tessera_tests::generate::{self, Document, Look};
use tessera_tests::oracle::Oracle;
use tessera_tests::reference;

fn settings(grid: u32) -> Settings {
    Settings {
        view: View::new(64, 48, 1.0, 1.0).unwrap(),
        max_depth: 6,
        sampling: Sampling::Uniform { grid },
        transfer: Transfer::Srgb,
    }
}

fn agree(name: &str, document: &Document, grid: u32, depth: u32) {
    let scene = document.scene().unwrap();
    let settings = Settings { max_depth: depth, ..settings(grid) };
    let started = std::time::Instant::now();
    let precise = Oracle::new(&scene, 512).render(&settings);
    println!("{name}: {:?}, {:?}", started.elapsed(), precise.decisions);
    assert!(precise.decisions.margin > 200.0, "{:?}", precise.decisions);
    assert_same_picture(&format!("oracle-{name}"), &precise.image, &reference::render(&scene, &settings));
}

#[test]
fn demo_is_the_same_in_both() {
    agree("demo", &generate::demo(), 1, 4);
}

#[test]
fn mirrors_are_the_same_in_both() {
    agree("mirrors", &generate::mirrors(), 1, 3);
}

#[test]
fn a_grid_of_samples_is_the_same_in_both() {
    let d = Document::new(dvec3(0.0, 1.0, -5.0), DVec3::ZERO)
        .light(3.0, 5.0, -4.0)
        .sphere(DVec3::ZERO, 1.0, Look::new(0.9, 0.5, 0.3, 0.7, 0.3))
        .plane(dvec3(0.1, 1.0, 0.0), -1.2, Look::new(0.5, 0.6, 0.7, 0.6, 0.4));
    agree("grid", &d, 3, 4);
}

#[test]
fn pictures_on_planes_and_triangles_are_the_same_in_both() {
    let mut d = Document::new(dvec3(0.3, 2.0, -5.0), DVec3::ZERO).light(3.0, 5.0, -4.0).light(0.0, 9.0, 0.0);
    d.textures.push(("g.ppm".into(), generate::globe(96)));
    let d = d
        .plane(dvec3(0.1, 1.0, 0.05), -1.0, Look::picture(0, 0.8, 0.2))
        .triangle([dvec3(-2.0, -1.0, 1.0), dvec3(2.0, -1.0, 1.5), dvec3(-1.0, 2.0, 1.0)], Look::picture(0, 1.0, 0.0));
    agree("pictured", &d, 1, 3);
    let scene = d.scene().unwrap();
    let s = Settings { view: View::new(320, 240, 1.0, 1.0).unwrap(), transfer: Transfer::Linear, ..settings(1) };
    if tessera_tests::peers::povray_installed() {
        let folder = tempfile::tempdir().unwrap();
        let by_povray = tessera_tests::peers::povray(&scene, &s, folder.path()).unwrap();
        let d = difference(&by_povray, &reference::render(&scene, &s).clamped());
        println!("{d:?}");
        let _ = tessera_tests::compare::write_failure("pictured", &by_povray, &reference::render(&scene, &s));
    }
}
