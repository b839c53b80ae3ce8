//! Encodings, prologs, pictures, broken markup, and the text of diagnostics.

use std::path::Path;

use super::{CAMERA, LIGHT, read, scene, tells};
use crate::xml::{Code, ReadError, ReadOptions, Severity, read_bytes, read_file};

fn bytes(bytes: &[u8]) -> Result<crate::xml::Read, ReadError> {
    read_bytes(bytes.to_vec(), "scene.xml", None, &ReadOptions::default())
}

/// The only diagnostic of a document that is wrong in one way.
#[track_caller]
fn only(result: Result<crate::xml::Read, ReadError>) -> crate::xml::Diagnostic {
    let mut diagnostics = match result {
        Ok(_) => panic!("it is wrong"),
        Err(error) => error.diagnostics,
    };
    assert_eq!(diagnostics.len(), 1, "{diagnostics:?}");
    diagnostics.remove(0)
}

fn with_comment(declaration: &str, comment: &str) -> String {
    scene("").replacen("<scene>", &format!("{declaration}<!-- {comment} --><scene>"), 1)
}

fn utf16(text: &str, big: bool) -> Vec<u8> {
    text.encode_utf16().flat_map(|u| if big { u.to_be_bytes() } else { u.to_le_bytes() }).collect()
}

#[test]
fn encodings_are_read_as_declared() {
    let body = with_comment("", "x");
    for text in [
        body.clone(),
        format!("\u{FEFF}{body}"),
        format!("\u{FEFF}<?xml version='1.0' encoding='UTF-8'?>{body}"),
        with_comment("<?xml version='1.0' encoding='utf-8'?>", "snö"),
    ] {
        assert!(bytes(text.as_bytes()).is_ok(), "{text}");
    }
    for label in [
        "iso-8859-1",
        "ISO-8859-1",
        "latin1",
        "windows-1252",
        "iso-8859-15",
        "koi8-r",
        "iso-8859-9",
        "gbk",
        "shift_jis",
        "us-ascii",
    ] {
        let text = with_comment(&format!("<?xml version='1.0' encoding='{label}'?>"), "plain");
        assert!(bytes(text.as_bytes()).is_ok(), "{label}");
    }
    for (label, good) in [
        ("iso-8859-1", &b"\xE9\x80\x9F"[..]),
        ("iso-8859-9", b"\xFD\x81"),
        ("windows-1251", b"\xC0"),
        ("gbk", b"\xC4\xE3"),
        ("shift_jis", b"\x82\xA0"),
        ("euc-jp", b"\xA4\xA2"),
        ("big5", b"\xA7\x41"),
    ] {
        let text = with_comment(&format!("<?xml version='1.0' encoding='{label}'?>"), "@");
        let at = text.find('@').unwrap_or(0);
        let mut document = text.into_bytes();
        document.splice(at..=at, good.iter().copied());
        assert!(bytes(&document).is_ok(), "{label}");
    }
    for big in [true, false] {
        let order = if big { "UTF-16BE" } else { "UTF-16LE" };
        for (mark, declaration) in [
            ("\u{FEFF}", String::new()),
            ("\u{FEFF}", "<?xml version='1.0'?>".into()),
            ("\u{FEFF}", "<?xml version='1.0' encoding='utf-16'?>".into()),
            ("\u{FEFF}", format!("<?xml version='1.0' encoding='{order}'?>")),
            ("", format!("<?xml version='1.0' encoding='{order}'?>")),
        ] {
            let text = format!("{mark}{}", with_comment(&declaration, "snö 😀"));
            assert!(bytes(&utf16(&text, big)).is_ok(), "{order} {text}");
        }
    }
}

#[test]
fn what_is_no_text_is_refused_at_its_byte() {
    let bad = |label: &str, wrong: &[u8]| {
        let text = with_comment(&format!("<?xml version='1.0' encoding='{label}'?>\n"), "ab @");
        let at = text.find('@').unwrap_or(0);
        let mut document = text.into_bytes();
        document.splice(at..=at, wrong.iter().copied());
        let d = only(bytes(&document));
        assert_eq!((d.code, d.position()), (Code::Encoding, Some((2, 9))), "{label}: {d}");
        assert!(d.message.contains(&format!("0x{:02X} at offset {at}", wrong[0])), "{label}: {d}");
    };
    bad("utf-8", b"\xE9 ");
    bad("utf-8", b"\xC0\x80");
    bad("us-ascii", b"\xE9");
    bad("windows-1253", b"\xD2");
    bad("iso-8859-7", b"\xD2");
    bad("shift_jis", b"\xFD");
    bad("gbk", b"\xFF");
    let unknown = only(bytes(with_comment("<?xml version='1.0' encoding='iso-8859-I'?>", "").as_bytes()));
    assert_eq!((unknown.code, unknown.position()), (Code::Encoding, Some((1, 31))));
    assert_eq!(unknown.suggestion.as_deref(), Some("iso-8859-1"));
    for label in ["utf-16", "x-user-defined", "ebcdic", "utf-32", "replacement", "hz-gb-2312"] {
        let d = only(bytes(with_comment(&format!("<?xml version='1.0' encoding='{label}'?>"), "").as_bytes()));
        assert_eq!(d.code, Code::Encoding, "{label}");
    }
    // A byte order mark and a declaration that contradict each other.
    let utf8 = with_comment("\u{FEFF}<?xml version='1.0' encoding='iso-8859-1'?>", "");
    assert_eq!(only(bytes(utf8.as_bytes())).code, Code::Encoding);
    let wide = utf16(&with_comment("\u{FEFF}<?xml version='1.0' encoding='utf-8'?>", ""), true);
    assert_eq!(only(bytes(&wide)).code, Code::Encoding);
    let mut odd = utf16(&with_comment("\u{FEFF}", ""), false);
    odd.push(0);
    assert_eq!(only(bytes(&odd)).code, Code::Encoding);
    let mut lone = utf16("\u{FEFF}<scene/>", false);
    lone.extend([0, 0xD8, b' ', 0]);
    assert!(only(bytes(&lone)).message.contains("at offset 18"));
    assert_eq!(only(bytes(&[0xFF, 0xFE, 0, 0, b'<', 0, 0, 0])).code, Code::Encoding);
}

#[test]
fn doctypes() {
    let with = |doctype: &str| scene("").replacen("<scene>", &format!("{doctype}<scene>"), 1);
    for good in [
        "<!DOCTYPE scene>",
        "<!DOCTYPE scene SYSTEM 'http://example.invalid/pm2gl.dtd'>",
        "<!DOCTYPE scene SYSTEM \"file:///etc/passwd\" >\n",
        "<!DOCTYPE scene PUBLIC '-//x//y' '>'>",
        "<!-- --><?p?><!DOCTYPE scene><!-- -->",
    ] {
        tells(&with(good), &[]);
    }
    tells(&with("<!DOCTYPE scenes SYSTEM 'x'>"), &[(Code::Doctype, 1, 11, "scenes")]);
    for subset in ["[]", " SYSTEM 'x' [ <!ENTITY a 'b'> ]", "[<!ELEMENT scene ANY>"] {
        let text = with(&format!("<!DOCTYPE scene{subset}>"));
        let column = text.find('[').unwrap_or(0) as u64 + 1;
        tells(&text, &[(Code::InternalSubset, 1, column, "[")]);
    }
    tells(&with("<!DOCTYPE scene SYSTEM x>"), &[(Code::Syntax, 1, 24, "x")]);
    tells(&with("<!DOCTYPE scene><!DOCTYPE scene>"), &[(Code::Syntax, 1, 17, "<!DOCTYPE")]);
    let late = scene("<!DOCTYPE scene>");
    tells(&late, &[(Code::Syntax, 3, 1, "<!DOCTYPE")]);
}

#[test]
fn broken_markup_hides_nothing_behind_it() {
    let good = "<sphere radius='1'><location><vector x='0' y='0' z='0'/></location></sphere>";
    let wrong = "<sphere radius='0'><location><vector x='0' y='0' z='0'/></location></sphere>";
    for (broken, column, mark) in [
        ("<sphere radius='1><location><vector x='0' y='0' z='0'/></location></sphere>", 16, "'"),
        ("<sphere radius=1><location><vector x='0' y='0' z='0'/></location></sphere>", 16, "1"),
        ("<sphere radius='1'><location><vector x='0' y='0' z='0'/></sphere>", 57, "</sphere>"),
        ("<sphere radius='1'><location><vector x='0' y='0' z='0'></location></sphere>", 56, "</location>"),
        ("<sphere radius='1'><location><vector x='0' y='0' z='0'/></location>", 2, "sphere"),
        ("<sphere radius='1'><location><vector x='0'y='0' z='0'/></location></sphere>", 43, "y"),
        ("<sphere radius='1' radius='2'><location><vector x='0' y='0' z='0'/></location></sphere>", 20, "r"),
        ("</sphere>", 1, "</sphere>"),
        ("<!-- a -- b -->", 8, "--"),
        ("<sphere radius='&x;'><location><vector x='0' y='0' z='0'/></location></sphere>", 17, "&x;"),
        ("<sphere radius='1'><location>&</location></sphere>", 30, "&"),
        ("<1/>", 2, "1"),
    ] {
        let text = scene(&format!("{broken}\n{good}\n{wrong}"));
        let told = super::told(&text);
        let first = (Code::Syntax, 3, column, mark.to_owned());
        let last = (Code::Radius, 5, 17, "0".to_owned());
        assert_eq!(told, [first, last], "{broken}");
    }
    tells(
        &scene(&format!("<sphere radius='1'\n{good}\n{wrong}")),
        &[(Code::Syntax, 4, 1, "<"), (Code::Radius, 5, 17, "0")],
    );
    // The same before and behind the world.
    let text = format!("<scene>{}\n<world>{LIGHT}\n{wrong}</world></scene>", CAMERA.replacen("<sky>", "<sky", 1));
    tells(&text, &[(Code::Syntax, 1, 69, "<"), (Code::Radius, 3, 17, "0")]);
    let text = format!("<scene>{CAMERA}\n<world>{LIGHT}\n{wrong}</world></scene><scene/>");
    tells(&text, &[(Code::Radius, 3, 17, "0"), (Code::Syntax, 3, 93, "<")]);
    let text = format!("<scene>{CAMERA}\n<world>{LIGHT}\n{wrong}");
    tells(&text, &[(Code::Syntax, 2, 2, "world"), (Code::Radius, 3, 17, "0")]);
}

#[test]
fn frames() {
    let world = format!("<world>{LIGHT}</world>");
    tells(&format!("<scene>{world}</scene>"), &[(Code::MissingElement, 1, 2, "scene")]);
    tells(&format!("<scene>{CAMERA}</scene>"), &[(Code::MissingElement, 1, 2, "scene")]);
    let text = format!("<scene>{world}\n{CAMERA}</scene>");
    tells(&text, &[(Code::MisplacedElement, 2, 2, "camera")]);
    let text = format!("<scene>{CAMERA}{world}\n{world}\n{CAMERA}</scene>");
    tells(&text, &[(Code::MisplacedElement, 2, 2, "world"), (Code::MisplacedElement, 3, 2, "camera")]);
    tells(&format!("<Scene>{CAMERA}{world}</Scene>"), &[(Code::UnknownElement, 1, 2, "Scene")]);
    tells(&format!("<scene>{CAMERA}\n<wordl>{LIGHT}</wordl></scene>"), &[(Code::UnknownElement, 2, 2, "wordl")]);
    tells(&format!("<scene>{CAMERA}\n<cube/>{world}</scene>"), &[(Code::UnknownElement, 2, 2, "cube")]);
    for empty in ["", " \n", "<!-- -->", "<?xml version='1.0'?>\n"] {
        assert!(only(read(empty)).message.contains("no root element"), "{empty:?}");
    }
    let spaced = |standalone: &str| {
        scene("").replacen("<scene>", &format!("<?xml version='1.0' standalone='{standalone}'?><scene>"), 1)
    };
    tells(&spaced("no"), &[]);
    tells(&spaced("yes"), &[(Code::UnexpectedContent, 1, 33, "yes")]);
    tells(&spaced("yes").replace('\n', ""), &[]);
}

#[test]
fn pictures() {
    let folder = tempfile::tempdir().unwrap_or_else(|e| panic!("{e}"));
    let write =
        |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap_or_else(|e| panic!("{e}"));
    write("a b.ppm", "P3 1 1 255 1 2 3");
    write("cut.ppm", "P3 1 1 255 1 2");
    write("other.ppm", "P3 1 1 255 3 2 1");
    let pictured = |file: &str| {
        format!(
            "<sphere radius='1'><location><vector x='0' y='0' z='0'/></location>\
             <surface><pigment><image><ppm file='{file}'/></image></pigment></surface></sphere>\n"
        )
    };
    let read =
        |objects: &str| read_bytes(scene(objects).into_bytes(), "s.xml", Some(folder.path()), &ReadOptions::default());
    let objects = [pictured("a b.ppm"), pictured("./a b.ppm"), pictured("other.ppm"), pictured("a&#32;b.ppm")].concat();
    let scene = read(&objects).unwrap_or_else(|e| panic!("{e}")).scene;
    assert_eq!(scene.textures().len(), 2);
    let pigments: Vec<_> = scene.spheres().iter().map(|s| scene.surface(s.surface).pigment).collect();
    assert!(pigments[0] == pigments[1] && pigments[0] == pigments[3] && pigments[0] != pigments[2]);
    let objects =
        [pictured("none.ppm"), pictured("cut.ppm"), pictured("."), pictured(""), pictured("none.ppm")].concat();
    let error = read(&objects).map(|_| ()).unwrap_err();
    let told: Vec<_> = error.diagnostics.iter().map(|d| (d.code, d.position())).collect();
    assert_eq!(told, [3, 4, 5, 6].map(|line| (Code::Texture, Some((line, 104)))), "{error}");
    assert!(error.diagnostics[1].message.contains("cut.ppm") && error.diagnostics[1].message.contains("truncated"));
    // Without a folder there is nothing to look them up from.
    assert_eq!(only(super::read(&super::scene(&pictured("a b.ppm")))).code, Code::Texture);
}

#[test]
fn files_that_are_none() {
    let folder = tempfile::tempdir().unwrap_or_else(|e| panic!("{e}"));
    let missing = folder.path().join("none.xml");
    for path in [folder.path(), missing.as_path(), Path::new("/dev/null")] {
        let d = only(read_file(path, &ReadOptions::default()));
        assert_eq!((d.code, &d.place), (Code::Io, &None));
        assert!(d.to_string().contains(&path.display().to_string()), "{d}");
    }
    let file = folder.path().join("s.xml");
    std::fs::write(&file, scene("")).unwrap_or_else(|e| panic!("{e}"));
    assert!(read_file(&file, &ReadOptions::default()).is_ok());
    let small = ReadOptions { max_bytes: 99, ..ReadOptions::default() };
    assert_eq!(only(read_file(&file, &small)).code, Code::Io);
    #[cfg(unix)]
    {
        let pipe = folder.path().join("pipe");
        let made = std::process::Command::new("mkfifo").arg(&pipe).status();
        if made.is_ok_and(|s| s.success()) {
            assert_eq!(only(read_file(&pipe, &ReadOptions::default())).code, Code::Io);
        }
    }
}

#[test]
fn the_text_of_a_diagnostic() {
    let text = scene("  <shpere radius='1'><location><vector x='1,5' y='0' z='0'/></location></shpere>");
    let error = read(&text).map(|_| ()).unwrap_err();
    assert_eq!(
        error.to_string(),
        "\
error[unknown-element]: unknown element `shpere`
 --> scene.xml:3:4
  |
3 |   <shpere radius='1'><location><vector x='1,5' y='0' z='0'/></location></shpere>
  |    ^^^^^^
  = expected: plane, light, sphere or triangle
  = help: did you mean `sphere`?

error[number]: `1,5` is not a number
 --> scene.xml:3:43
  |
3 |   <shpere radius='1'><location><vector x='1,5' y='0' z='0'/></location></shpere>
  |                                           ^^^
  = expected: a decimal number such as -0.5, .5 or 1e-3
  = help: did you mean `1.5`?"
    );
    let painted = error.diagnostics[0].render(&|severity, s| format!("[{severity}:{s}]"));
    assert!(painted.starts_with("[error:error[unknown-element]]: unknown"), "{painted}");
    assert_eq!(error.diagnostics[0].severity, Severity::Error);
}

#[test]
fn marks_stand_below_wide_and_combining_characters() {
    // Ideographs and kana take two columns each, an accent that is a character of its own none.
    for (before, columns) in [("", 0), ("日本語の", 8), ("e\u{301}e\u{301}", 2), ("äß", 2)] {
        let text = scene(&format!("<!--{before}--><shpere radius='1'/>"));
        let error = read(&text).map(|_| ()).unwrap_err().to_string();
        let marks = error.lines().find(|l| l.contains("^^^")).unwrap_or_else(|| panic!("{error}"));
        assert_eq!(marks, format!("  | {}^^^^^^", " ".repeat(columns + "<!---->".len() + 1)), "{error}");
    }
}

#[test]
fn excerpts_of_long_and_strange_lines() {
    // Columns count characters; a long line is cut around the spot; tabs keep the marks in line.
    let wide = format!("<!--{}-->\t<sphere radius='ö'>", "é".repeat(500));
    let text = scene(&format!("{wide}<location><vector x='0' y='0' z='0'/></location></sphere>{}", " ".repeat(900)));
    let error = read(&text).map(|_| ()).unwrap_err();
    let place = error.diagnostics[0].place.clone().unwrap_or_else(|| panic!("{error}"));
    assert_eq!((place.line, place.column), (3, 4 + 500 + 3 + 1 + 17));
    assert_eq!(place.source_line.chars().nth(place.marked.start), Some('ö'));
    assert!(
        place.source_line.chars().count() <= 110
            && place.source_line.starts_with('…')
            && place.source_line.ends_with('…')
    );
    assert!(place.source_line.contains("--> <sphere"));
    // CR LF, lone CR and LF each end one line.
    let text = scene("\r\n\r\n\r\r<sphere/>").replace("</world>", "\n</world>");
    assert_eq!(super::told(&text)[0].1, 7);
    let text = format!("\u{FEFF}<sceen>{CAMERA}<world>{LIGHT}</world></sceen>");
    tells(&text, &[(Code::UnknownElement, 1, 2, "sceen")]);
}
