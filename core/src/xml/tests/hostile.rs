//! Documents made to hurt: all are refused or read in bounded time and memory.

use super::{CAMERA, LIGHT, read, scene, told};
use crate::xml::{Code, ReadError, ReadOptions, read_bytes};

fn error(text: String) -> ReadError {
    match read_bytes(text.into_bytes(), "s.xml", None, &ReadOptions::default()) {
        Ok(_) => panic!("it is refused"),
        Err(error) => error,
    }
}

fn first(text: String) -> (Code, Option<(u64, u64)>) {
    let error = error(text);
    (error.diagnostics[0].code, error.diagnostics[0].position())
}

#[test]
fn nesting_five_million_deep() {
    let deep = "<c0>".repeat(5_000_000);
    assert_eq!(first(scene(&deep)), (Code::TooDeep, Some((3, 64 * 4 + 2))));
    assert_eq!(first(scene(&format!("{deep}{}", "</c0>".repeat(5_000_000)))).0, Code::TooDeep);
    assert_eq!(first(deep.clone()).0, Code::TooLarge);
    let deep = &deep[..12_000_000];
    assert_eq!(first(deep.into()).0, Code::TooDeep);
    assert_eq!(first(format!("<scene>{CAMERA}<world>{LIGHT}</world>{deep}")).0, Code::TooDeep);
    // Children of a world inside one another.
    assert_eq!(first(scene(&"<triangle>".repeat(1_000_000))).0, Code::TooDeep);
}

#[test]
fn attributes_by_the_thousand() {
    let many: String = (0..60_000).map(|i| format!(" a{i}='1'")).collect();
    assert_eq!(first(scene(&format!("<sphere{many}/>"))).0, Code::TooManyAttributes);
    assert_eq!(first(format!("<scene{many}/>")).0, Code::TooManyAttributes);
    let huge = "1".repeat(30_000_000);
    assert_eq!(first(scene(&format!("<sphere radius='{huge}'/>"))).0, Code::TooLarge);
    let large = "1".repeat(5_000_000);
    assert_eq!(
        first(scene(&format!("<light><position><vector x='{large}' y='0' z='0'/></position></light>"))).0,
        Code::Overflow
    );
    let tiny = format!("0.{}1", "0".repeat(5_000_000));
    assert_eq!(
        told(&scene(&format!("<light><position><vector x='{tiny}' y='0' z='0'/></position></light>")))[0].0,
        Code::Underflow
    );
    let name = "n".repeat(5_000_000);
    assert_eq!(first(scene(&format!("<{name}/>"))).0, Code::UnknownElement);
    let named = told(&scene(&format!("<light {name}=''/>")));
    assert_eq!(named.iter().map(|t| t.0).collect::<Vec<_>>(), [Code::MissingElement, Code::UnknownAttribute]);
}

#[test]
fn entity_bombs() {
    let bomb = "<!DOCTYPE scene [<!ENTITY a 'aaaaaaaaaa'><!ENTITY b '&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;'>]>";
    assert_eq!(first(format!("{bomb}<scene>&b;</scene>")).0, Code::InternalSubset);
    assert_eq!(first(format!("<!DOCTYPE scene SYSTEM 'x'>{}", scene("&b;"))).0, Code::Syntax);
    assert_eq!(first(scene(&"&b;".repeat(1_000_000))).0, Code::Syntax);
}

#[test]
fn a_million_errors() {
    let spheres = "<sphere radius='0'><location><vector x='0' y='0' z='0'/></location></sphere>\n".repeat(300_000);
    let all = error(scene(&spheres));
    assert!(all.cut);
    let lines: Vec<_> = all.diagnostics.iter().filter_map(|d| d.position()).map(|p| p.0).collect();
    assert_eq!(lines, (3..103).collect::<Vec<_>>());
    for wrong in [
        "<x/>",
        "</a>",
        "<sphere>",
        "<a:b/>",
        "<",
        "&",
        "<light x=1/>",
        "<![CDATA[]]>",
        "<light><a></light>",
        "<!DOCTYPE scene>",
    ] {
        let all = error(scene(&wrong.repeat(1_000_000)));
        assert!(all.cut || all.diagnostics.len() < 5, "{wrong}: {}", all.diagnostics.len());
        assert!(all.diagnostics.len() <= 101, "{wrong}");
    }
    // Each attribute of each tag, up to what a tag may have.
    let attributes: String = (0..60).map(|i| format!(" a{i}='&x;'")).collect();
    assert!(error(scene(&format!("<light{attributes}/>").repeat(10_000))).cut);
}

#[test]
fn a_million_warnings_are_counted() {
    let flat = "<triangle><c0><vector x='0' y='0' z='0'/></c0><c1><vector x='0' y='0' z='0'/></c1>\
                <c2><vector x='0' y='0' z='0'/></c2></triangle>\n";
    let read = read(&scene(&flat.repeat(100_000))).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!((read.warnings.len(), read.omitted_warnings), (100, 99_900));
    assert_eq!(read.scene.triangles().len(), 100_000);
}

#[test]
fn truncated_anywhere() {
    let whole = scene("<sphere radius='1'><location><vector x='0' y='0' z='0'/></location></sphere><!-- c --><?p x?>");
    for end in 0..whole.len() {
        assert!(read(&whole[..end]).is_err(), "cut at {end} of {whole}");
    }
    assert!(read(&whole).is_ok());
}

#[test]
fn bytes_that_are_no_text() {
    for byte in [0u8, 1, 8, 0x1B] {
        let c = char::from(byte);
        for text in [
            scene(&c.to_string()),
            scene(&format!("<!-- {c} -->")),
            scene(&format!("<light a='{c}'/>")),
            format!("{c}{}", scene("")),
        ] {
            assert_eq!(first(text).0, Code::Syntax);
        }
    }
    assert!(read_bytes(vec![0; 10_000_000], "s", None, &ReadOptions::default()).is_err());
    assert!(read_bytes(vec![b'<'; 10_000_000], "s", None, &ReadOptions::default()).is_err());
    assert!(read_bytes(vec![b' '; 20_000_000], "s", None, &ReadOptions::default()).is_err());
}

#[test]
fn one_piece_that_never_ends() {
    let spheres = "<sphere radius='1'><location><vector x='0' y='0' z='0'/></location></sphere>".repeat(300_000);
    // The first child is not closed: it is named, and the rest is read.
    let unclosed = error(scene(&format!("<triangle>{spheres}")));
    assert_eq!(unclosed.diagnostics.len(), 1, "{unclosed}");
    assert_eq!((unclosed.diagnostics[0].code, unclosed.diagnostics[0].position()), (Code::Syntax, Some((3, 2))));
    assert_eq!(first(scene(&format!("<!-- {spheres}"))), (Code::Syntax, Some((3, 1))));
    // A comment may be as long as it likes.
    assert!(read(&scene(&format!("<!-- {spheres} -->"))).is_ok());
    assert_eq!(first(scene(&format!("<!-- {spheres}\u{7} -->"))).0, Code::Syntax);
    assert_eq!(first(format!("<scene>{CAMERA}{spheres}</scene>")).0, Code::TooLarge);
    assert_eq!(first(scene(&"x".repeat(40_000_000))), (Code::TooLarge, Some((3, 1))));
    assert!(read(&scene(&"\n".repeat(40_000_000))).is_ok());
    // A hundred errors in one long line: its columns are counted once.
    let line = "<sphere radius='0'><location><vector x='0' y='0' z='0'/></location></sphere>".repeat(200_000);
    let last = error(scene(&line)).diagnostics.pop().and_then(|d| d.position());
    assert_eq!(last, Some((3, 99 * 76 + 17)));
}
