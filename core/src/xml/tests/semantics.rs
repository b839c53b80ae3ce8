//! Every semantic check and default, each finding in its place.

use glam::DVec3;

use super::{CAMERA, LIGHT, read, scene, tells};
use crate::scene::{Orientation, Pigment, PlanePosition, Surface};
use crate::xml::Code;

fn sphere(attributes: &str, content: &str) -> String {
    scene(&format!("<sphere {attributes}><location><vector x='0' y='0' z='0'/></location>{content}</sphere>"))
}

fn surface(content: &str) -> String {
    sphere("radius='1'", &format!("\n<surface>{content}</surface>"))
}

fn camera(location: &str, sky: &str, look_at: &str) -> String {
    format!(
        "<scene><camera>\n<location><vector {location}/></location>\n<sky><vector {sky}/></sky>\n\
         <look_at><vector {look_at}/></look_at></camera><world>{LIGHT}</world></scene>"
    )
}

#[test]
fn shares_are_in_the_unit_interval() {
    for name in ["diffuse", "reflect"] {
        for bad in ["-0.001", "1.0000000000000002", "2", "-5e-324"] {
            tells(&surface(&format!("<finish {name}='{bad}'/>")), &[(Code::Range, 4, 27, bad)]);
        }
        for good in ["0", "1", "-0", "0.5", "1e-300"] {
            tells(&surface(&format!("<finish {name}='{good}'/>")), &[]);
        }
    }
    let color = |red: &str, green: &str, blue: &str| {
        surface(&format!("<pigment><color red='{red}' green='{green}' blue='{blue}'/></pigment>"))
    };
    tells(
        &color("1.5", "-1", "7"),
        &[(Code::Range, 4, 31, "1.5"), (Code::Range, 4, 43, "-1"), (Code::Range, 4, 53, "7")],
    );
    let background = format!(
        "<scene>{CAMERA}\n<background><color red='9' green='0' blue='0'/></background><world>{LIGHT}</world></scene>"
    );
    tells(&background, &[(Code::Range, 2, 25, "9")]);
}

#[test]
fn radius_is_above_zero() {
    for bad in ["0", "-1", "-0.0"] {
        tells(&sphere(&format!("radius='{bad}'"), ""), &[(Code::Radius, 3, 17, bad)]);
    }
    tells(&sphere("radius='5e-324'", ""), &[]);
    tells(&sphere("radius='1e-999'", ""), &[(Code::Underflow, 3, 17, "1e-999"), (Code::Radius, 3, 17, "1e-999")]);
}

#[test]
fn numbers() {
    for bad in ["", "NaN", "inf", "0x1", "1,5", "1 2", "five", "1e", "--1", "1e5x"] {
        let mark = if bad.is_empty() { "'" } else { bad };
        tells(&sphere(&format!("radius='{bad}'"), ""), &[(Code::Number, 3, 17, mark)]);
    }
    tells(&sphere("radius='1e400'", ""), &[(Code::Overflow, 3, 17, "1e400")]);
    tells(&sphere("radius='-1e400'", ""), &[(Code::Overflow, 3, 17, "-1e400")]);
    let light = |x: &str| scene(&format!("<light><position><vector x='{x}' y='0' z='0'/></position></light>"));
    tells(&light("1e-400"), &[(Code::Underflow, 3, 29, "1e-400")]);
    tells(&light("0e-400"), &[]);
    for (written, value) in
        [(" 1.5\t", 1.5), ("+2", 2.0), (".5", 0.5), ("-3.", -3.0), ("1E+2", 100.0), ("&#49;0", 10.0)]
    {
        let read = read(&light(written)).unwrap_or_else(|e| panic!("{written}: {e}"));
        assert_eq!(read.scene.lights()[1].x, value, "{written}");
    }
}

#[test]
fn planes() {
    let plane = |attribute: &str, normal: &str, point: &str| {
        scene(&format!("<plane{attribute}><normal><vector {normal}/></normal>{point}</plane>"))
    };
    let point = "<point><vector x='1' y='2' z='3'/></point>";
    let up = "x='0' y='2' z='0'";
    tells(&plane(" distance='4'", up, point), &[(Code::PlanePosition, 3, 8, "distance='4'")]);
    tells(&plane("", "x='0' y='0' z='-0'", ""), &[(Code::ZeroVector, 3, 17, "vector")]);
    for (text, position) in [
        (plane("", up, ""), PlanePosition::Distance(0.0)),
        (plane(" distance='4'", up, ""), PlanePosition::Distance(4.0)),
        (plane("", up, point), PlanePosition::Point(DVec3::new(1.0, 2.0, 3.0))),
    ] {
        let read = read(&text).unwrap_or_else(|e| panic!("{e}"));
        let plane = read.scene.planes()[0];
        assert_eq!((plane.normal, plane.position), (DVec3::new(0.0, 2.0, 0.0), position));
    }
}

#[test]
fn cameras() {
    let (a, b, up) = ("x='1' y='2' z='3'", "x='1' y='2' z='4'", "x='0' y='1' z='0'");
    tells(&camera(a, up, b), &[]);
    tells(&camera(a, up, a), &[(Code::CameraView, 4, 11, "vector")]);
    tells(&camera(a, "x='0' y='-0' z='0'", b), &[(Code::ZeroVector, 3, 7, "vector")]);
    tells(&camera(a, "x='0' y='0' z='7'", b), &[(Code::CameraSky, 3, 7, "vector")]);
    tells(&camera(a, "x='0' y='0' z='-1e-300'", b), &[(Code::CameraSky, 3, 7, "vector")]);
    tells(&camera(a, "x='0' y='5e-324' z='1'", b), &[]);
}

#[test]
fn orientations() {
    let (x, y, z) = ("x='2' y='0' z='0'", "x='0' y='-3' z='0'", "x='0' y='0' z='4'");
    let oriented = |pole: Option<&str>, equator: Option<&str>| {
        let part =
            |name: &str, v: Option<&str>| v.map_or(String::new(), |v| format!("\n<{name}><vector {v}/></{name}>"));
        sphere("radius='1'", &format!("{}{}", part("pole", pole), part("equator", equator)))
    };
    tells(&oriented(Some("x='0' y='0' z='0'"), None), &[(Code::ZeroVector, 4, 8, "vector")]);
    tells(&oriented(None, Some("x='0' y='0' z='0'")), &[(Code::ZeroVector, 4, 11, "vector")]);
    tells(&oriented(Some(x), Some("x='-1' y='0' z='0'")), &[(Code::Orientation, 5, 11, "vector")]);
    for text in [oriented(Some(x), Some(y)), oriented(Some(x), None), oriented(None, Some(y)), oriented(None, None)] {
        tells(&text, &[]);
    }
    // The defaults are seen where a picture lies on the sphere.
    let folder = tempfile::tempdir().unwrap_or_else(|e| panic!("{e}"));
    let (one, path) = ("P3 1 1 255 9 9 9", folder.path().join("p.ppm"));
    std::fs::write(path, one).unwrap_or_else(|e| panic!("{e}"));
    let image = "<surface><pigment><image><ppm file='p.ppm'/></image></pigment></surface></sphere>";
    let [ux, uy, uz] = [DVec3::new(2., 0., 0.), DVec3::new(0., -3., 0.), DVec3::new(0., 0., 4.)];
    for (pole, equator, want) in [
        (Some(x), Some(z), (ux, uz)),
        (Some(z), None, (uz, DVec3::X)),
        (Some(x), None, (ux, DVec3::Z)),
        (None, Some(z), (DVec3::Y, uz)),
        (None, Some(y), (DVec3::Z, uy)),
        (None, None, (DVec3::Y, DVec3::X)),
    ] {
        let text = oriented(pole, equator).replace("</sphere>", image);
        let read = crate::xml::read_bytes(text.into_bytes(), "s", Some(folder.path()), &Default::default());
        let read = read.unwrap_or_else(|e| panic!("{e}"));
        let (pole, equator) = want;
        assert_eq!(read.scene.orientation(0), Some(&Orientation { pole, equator }));
    }
}

#[test]
fn triangles_without_area_are_warned_of() {
    let triangle = |second: &str, third: &str| {
        scene(&format!("<triangle><c0><vector x='0' y='0' z='0'/></c0>{second}{third}</triangle>"))
    };
    let corner = |name: &str, v: &str| format!("<{name}><vector {v}/></{name}>");
    let flat = triangle(&corner("c1", "x='1' y='1' z='1'"), &corner("c2", "x='3' y='3' z='3'"));
    tells(&flat, &[(Code::DegenerateTriangle, 3, 2, "triangle")]);
    assert_eq!(read(&flat).map(|r| r.scene.triangles().len()), Ok(1));
    let sides = triangle(&corner("v1", "x='1' y='1' z='1'"), &corner("v2", "x='0' y='0' z='0'"));
    tells(&sides, &[(Code::DegenerateTriangle, 3, 2, "triangle")]);
    let thin = triangle(&corner("c1", "x='1' y='1' z='1'"), &corner("c2", "x='3' y='3' z='3.0000000000000004'"));
    tells(&thin, &[]);
    let by_sides = read(&triangle(&corner("v1", "x='1' y='0' z='0'"), &corner("v2", "x='0' y='1' z='0'")));
    let by_sides = by_sides.unwrap_or_else(|e| panic!("{e}"));
    assert!(by_sides.scene.triangles()[0].by_sides());
    assert!(!read(&thin).unwrap_or_else(|e| panic!("{e}")).scene.triangles()[0].by_sides());
}

#[test]
fn finishes_and_lights_are_warned_of() {
    tells(&surface("<finish/>"), &[(Code::BlackFinish, 4, 11, "finish")]);
    tells(&surface("<finish diffuse='0.7' reflect='0.4'/>"), &[(Code::BrightFinish, 4, 11, "finish")]);
    tells(&surface("<finish diffuse='0.7' reflect='0.3'/>"), &[]);
    tells(&format!("<scene>{CAMERA}\n <world></world></scene>"), &[(Code::NoLight, 2, 3, "world")]);
    tells(&format!("<scene>{CAMERA}\n <world/></scene>"), &[(Code::NoLight, 2, 3, "world")]);
}

#[test]
fn defaults() {
    let finish = |diffuse, reflect| Surface { diffuse, reflect, ..Surface::default() };
    for (content, want) in [
        ("", Surface::default()),
        ("<surface/>", Surface::default()),
        ("<surface></surface>", Surface::default()),
        ("<surface><finish diffuse='0.5'/></surface>", finish(0.5, 0.0)),
        ("<surface><finish reflect='0.5'/></surface>", finish(0.0, 0.5)),
        ("<surface><finish/></surface>", finish(0.0, 0.0)),
        (
            "<surface><pigment><color blue='0.5' red='0' green='1'/></pigment></surface>",
            Surface { pigment: Pigment::Color([0.0, 1.0, 0.5]), ..Surface::default() },
        ),
    ] {
        let read = read(&sphere("radius='1'", content)).unwrap_or_else(|e| panic!("{content}: {e}"));
        assert_eq!(read.scene.surface(read.scene.spheres()[0].surface), &want, "{content}");
        assert_eq!(read.scene.background(), [0.0; 3]);
    }
}

#[test]
fn everything_wrong_is_told_at_once() {
    let text = scene(
        "<sphere radius='0'><location><vector x='a' y='0'/></location></sphere>\n\
         <spere radius='-1'><locaton><vector x='1' y='2' z='3' w='4'/></locaton></spere>\n\
         <plane><point><vector x='0' y='0' z='0'/></point><normal><vector x='0' y='0' z='0'/></normal></plane>\n\
         <triangle><c0><vector x='0' y='0' z='0'/></c0></triangle>text",
    );
    tells(
        &text,
        &[
            (Code::Radius, 3, 17, "0"),
            (Code::MissingAttribute, 3, 31, "vector"),
            (Code::Number, 3, 41, "a"),
            (Code::UnknownElement, 4, 2, "spere"),
            (Code::Radius, 4, 16, "-1"),
            (Code::UnknownElement, 4, 21, "locaton"),
            (Code::UnknownAttribute, 4, 55, "w"),
            (Code::MisplacedElement, 5, 51, "normal"),
            (Code::ZeroVector, 5, 59, "vector"),
            (Code::MissingElement, 6, 2, "triangle"),
            (Code::MissingElement, 6, 2, "triangle"),
            (Code::UnexpectedContent, 6, 58, "text"),
        ],
    );
}
