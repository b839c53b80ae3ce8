//! The extremes suite: what a scene's text may not say, and where it is told.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on may stop")]

use glam::{DVec3, dvec3};
use tessera_core::scene::PlanePosition;
use tessera_core::xml::{Read, ReadError, ReadOptions, Severity, read_bytes};
use tessera_tests::generate::extreme::basic;
use tessera_tests::generate::{self, extreme};

const HEAD: &str = "<scene>\n<camera><location><vector x=\"0\" y=\"1\" z=\"-5\"/></location>\
                    <sky><vector x=\"0\" y=\"1\" z=\"0\"/></sky>\
                    <look_at><vector x=\"0\" y=\"0\" z=\"0\"/></look_at></camera>\n<world>\n\
                    <light><position><vector x=\"0\" y=\"9\" z=\"-5\"/></position></light>\n";
const TAIL: &str = "\n</world>\n</scene>\n";
/// The line that `world` puts its text on.
const LINE: u64 = 5;

fn read(text: String) -> Result<Read, ReadError> {
    read_bytes(text.into_bytes(), "scene.xml", None, &ReadOptions::default())
}

fn world(objects: &str) -> String {
    format!("{HEAD}{objects}{TAIL}")
}

/// Demands one error, on the given line, at the first place where `spot` stands in that line.
#[track_caller]
fn located(text: String, line: u64, spot: &str) {
    let source = text.lines().nth(line as usize - 1).unwrap().to_owned();
    let error = read(text).expect_err(&source);
    let errors: Vec<_> = error.diagnostics.iter().filter(|d| d.severity == Severity::Error).collect();
    assert_eq!(errors.len(), 1, "{error}");
    let (at, column) = errors[0].position().expect("a place");
    assert_eq!(at, line, "{error}");
    let found = source.find(spot).unwrap() as u64 + 1;
    // The mark may stand at the attribute's name or at its value.
    assert!((found..=found + spot.len() as u64).contains(&column), "column {column}, not {found}:\n{error}");
}

#[track_caller]
fn accepted(text: String) -> Read {
    read(text).unwrap_or_else(|e| panic!("{e}"))
}

fn sphere(radius: &str) -> String {
    world(&format!("<sphere radius=\"{radius}\"><location><vector x=\"0\" y=\"0\" z=\"0\"/></location></sphere>"))
}

#[test]
fn case_16_radius() {
    for bad in ["0", "-0", "0.0e5", "-1", "-1e-300", "NaN", "inf", "1e999"] {
        located(sphere(bad), LINE, &format!("radius=\"{bad}\""));
    }
    assert_eq!(accepted(sphere("5e-324")).scene.spheres()[0].radius, 5e-324);
    assert_eq!(accepted(sphere("1.7976931348623157e308")).scene.spheres()[0].radius, f64::MAX);
}

#[test]
fn case_17_zero_area_is_a_warning() {
    let triangle = |c2: &str| {
        world(&format!(
            "<triangle><c0><vector x=\"0.1\" y=\"0.2\" z=\"0.3\"/></c0><c1><vector x=\"0.2\" y=\"0.4\" z=\"0.6\"/></c1><c2><vector {c2}/></c2></triangle>"
        ))
    };
    assert_eq!(accepted(triangle("x=\"0.4\" y=\"0.8\" z=\"1.2\"")).warnings.len(), 1);
    assert_eq!(accepted(triangle("x=\"0.4\" y=\"0.8\" z=\"1.2000000000000002\"")).warnings.len(), 0);
}

#[test]
fn case_29_normal() {
    let plane = |v: &str| world(&format!("<plane><normal><vector {v}/></normal></plane>"));
    located(plane("x=\"0\" y=\"-0\" z=\"0\""), LINE, "<normal><vector x=\"0\"");
    located(plane("x=\"0\" y=\"NaN\" z=\"0\""), LINE, "y=\"NaN\"");
    let tiny = accepted(plane("x=\"0\" y=\"5e-324\" z=\"0\"")).scene;
    assert_eq!(tiny.planes()[0].normal, dvec3(0.0, 5e-324, 0.0));
}

fn camera(location: [&str; 3], sky: [&str; 3], look_at: [&str; 3]) -> String {
    let vector = |[x, y, z]: [&str; 3]| format!("<vector x=\"{x}\" y=\"{y}\" z=\"{z}\"/>");
    format!(
        "<scene>\n<camera><location>{}</location>\n<sky>{}</sky>\n<look_at>{}</look_at></camera>\n<world>\n</world>\n</scene>\n",
        vector(location),
        vector(sky),
        vector(look_at)
    )
}

#[test]
fn case_36_sky_parallel_to_the_view() {
    for sky in [["1", "2", "3"], ["-0.25", "-0.5", "-0.75"], ["5e-324", "1e-323", "1.5e-323"]] {
        let error = read(camera(["0", "0", "0"], sky, ["1", "2", "3"])).unwrap_err();
        let (line, _) = error.diagnostics[0].position().unwrap();
        assert!((2..=4).contains(&line), "{error}");
    }
    accepted(camera(["0", "0", "0"], ["1", "2", "3.0000000000000004"], ["1", "2", "3"]));
    accepted(camera(["1e200", "0", "0"], ["1", "1e-300", "0"], ["0", "0", "0"]));
}

#[test]
fn case_37_camera_without_a_direction() {
    for (location, look_at) in [(["1", "2", "3"], ["1", "2", "3.0"]), (["0", "0", "0"], ["-0", "0", "0e9"])] {
        let error = read(camera(location, ["0", "1", "0"], look_at)).unwrap_err();
        assert!(error.diagnostics[0].position().is_some(), "{error}");
    }
    located(camera(["0", "0", "0"], ["0", "NaN", "0"], ["1", "2", "3"]), 3, "y=\"NaN\"");
    located(camera(["0", "0", "0"], ["0", "-0", "0"], ["1", "2", "3"]), 3, "<sky><vector x=\"0\"");
    accepted(camera(["0", "0", "0"], ["0", "5e-324", "0"], ["1", "2", "3"]));
}

#[test]
fn case_62_pole_parallel_to_equator() {
    let ball = |pole: &str, equator: &str| {
        world(&format!(
            "<sphere radius=\"1\"><location><vector x=\"0\" y=\"0\" z=\"0\"/></location>\
             <pole><vector {pole}/></pole><equator><vector {equator}/></equator></sphere>"
        ))
    };
    for (pole, equator) in [
        ("x=\"1\" y=\"2\" z=\"3\"", "x=\"-2\" y=\"-4\" z=\"-6\""),
        ("x=\"0\" y=\"0\" z=\"0\"", "x=\"1\" y=\"0\" z=\"0\""),
    ] {
        let error = read(ball(pole, equator)).unwrap_err();
        assert_eq!(error.diagnostics[0].position().map(|p| p.0), Some(LINE), "{error}");
    }
    accepted(ball("x=\"1\" y=\"2\" z=\"3\"", "x=\"-2\" y=\"-4\" z=\"-6.000000000000001\""));
}

#[test]
fn case_63_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let attempt = |content: &[u8]| {
        std::fs::write(folder.path().join("p.ppm"), content).unwrap();
        let text = world(
            "<sphere radius=\"1\"><location><vector x=\"0\" y=\"0\" z=\"0\"/></location>\
             <surface><pigment><image><ppm file=\"p.ppm\"/></image></pigment></surface></sphere>",
        );
        read_bytes(text.into_bytes(), "scene.xml", Some(folder.path()), &ReadOptions::default())
    };
    let one = attempt(b"P3 1 1 1 1 0 1").unwrap().scene;
    assert_eq!((one.textures()[0].width(), one.textures()[0].maxval(), one.textures()[0].sample(0)), (1, 1, 1));
    let deep = attempt(b"P6\n# deep\n1 1\n65535\n\xff\xff\x00\x00\x12\x34").unwrap().scene;
    assert_eq!([0, 1, 2].map(|k| deep.textures()[0].sample(k)), [65535, 0, 0x1234]);
    for bad in [
        &b"P6 2 2 255\n0123456789"[..],
        b"P6 1 1 65535\n01234",
        b"P6 1 1 65536\n012345",
        b"P6 1 1 0\n012",
        b"P6 0 1 255\n",
        b"P6 4294967296 4294967296 255\n",
        b"P6 1000000 1000000 255\n",
        b"P3 1 1 255 0 0",
        b"P3 1 1 255 0 0 256",
        b"P5 1 1 255\n0",
        b"",
        b"hello",
    ] {
        let error = attempt(bad).unwrap_err();
        let text = error.to_string();
        assert!(text.contains("p.ppm"), "{text}");
        assert_eq!(error.diagnostics[0].position().map(|p| p.0), Some(LINE), "{text}");
    }
}

#[test]
fn case_64_what_is_not_a_number() {
    for bad in [
        "NaN", "nan", "inf", "-inf", "infinity", "1e400", "-1e400", "", " ", "0x1", "1,5", "1.5f", "1e", "1e+", ".",
        "--1", "1 2", "1_000",
    ] {
        let text =
            world(&format!("<sphere radius=\"1\"><location><vector x=\"0\" y=\"{bad}\" z=\"0\"/></location></sphere>"));
        located(text, LINE, &format!("y=\"{bad}\""));
    }
    for (good, value) in
        [("+2", 2.0), (".5", 0.5), ("5.", 5.0), (" -1e-3\t", -1e-3), ("1E5", 1e5), ("-0", 0.0), ("1e308", 1e308)]
    {
        let text = world(&format!(
            "<sphere radius=\"1\"><location><vector x=\"0\" y=\"{good}\" z=\"0\"/></location></sphere>"
        ));
        assert_eq!(accepted(text).scene.spheres()[0].center.y, value, "{good}");
    }
}

#[test]
fn case_65_underflow_is_a_warning() {
    let at = |x: &str| {
        accepted(world(&format!(
            "<sphere radius=\"1\"><location><vector x=\"{x}\" y=\"0\" z=\"0\"/></location></sphere>"
        )))
    };
    let read = at("1e-400");
    assert_eq!((read.warnings.len(), read.scene.spheres()[0].center.x), (1, 0.0));
    assert_eq!(read.warnings[0].position().map(|p| p.0), Some(LINE));
    assert_eq!(at("0e-400").warnings.len(), 0);
    assert_eq!(at("5e-324").scene.spheres()[0].center.x, 5e-324);
}

#[test]
fn every_number_is_read_as_the_nearest() {
    // Documents at the limits, written in the fewest digits, come back bit for bit.
    let mut documents =
        vec![basic(), basic().scaled(1e-300), basic().scaled(1e300), generate::mirrors(), generate::terrain(8)];
    documents.extend((0..40).map(|seed| extreme::random(seed, 32, 24).0).filter(|d| d.scene().is_ok()));
    let folder = tempfile::tempdir().unwrap();
    for document in documents {
        document.write(folder.path(), "scene").unwrap();
        let expected = document.scene().unwrap();
        let read = read_bytes(document.xml().into_bytes(), "scene.xml", Some(folder.path()), &ReadOptions::default())
            .unwrap_or_else(|e| panic!("{e}"))
            .scene;
        assert_eq!(read.camera(), expected.camera());
        assert_eq!(read.lights(), expected.lights());
        assert_eq!(read.orientations(), expected.orientations());
        assert_eq!(read.spheres().len(), expected.spheres().len());
        for (a, b) in read.spheres().iter().zip(expected.spheres()) {
            assert_eq!((a.center, a.radius, a.order), (b.center, b.radius, b.order));
            assert_eq!(read.surface(a.surface), expected.surface(b.surface));
        }
        for (a, b) in read.planes().iter().zip(expected.planes()) {
            assert_eq!((a.normal, a.order), (b.normal, b.order));
            match (a.position, b.position) {
                (PlanePosition::Point(a), PlanePosition::Point(b)) => assert_eq!(a, b),
                (PlanePosition::Distance(a), PlanePosition::Distance(b)) => assert_eq!(a, b),
                _ => panic!("another form"),
            }
        }
        for (a, b) in read.triangles().iter().zip(expected.triangles()) {
            assert_eq!((a.written, a.by_sides(), a.order), (b.written, b.by_sides(), b.order));
        }
        assert!(read.camera().location() != DVec3::NAN);
    }
}
