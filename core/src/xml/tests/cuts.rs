//! However the text is cut, with the fast lane or without, scene and diagnostics are the
//! same, and those of one whole document where there is one.

use crate::xml::assembly::{Assembly, Pictures};
use crate::xml::finding::{Findings, Limits};
use crate::xml::piece::{End, Reader};
use crate::xml::stream::Blocks;
use crate::xml::{Diagnostic, Read, ReadError, ReadOptions, Tuning, frame, read, source, streamed};

use super::{CAMERA, LIGHT};

/// SplitMix64.
struct Random(u64);

impl Random {
    fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) % n.max(1) as u64) as usize
    }
    fn pick<'a>(&mut self, from: &[&'a str]) -> &'a str {
        from[self.below(from.len())]
    }
}

fn object(r: &mut Random) -> String {
    let n = r.below(1000);
    let (a, b) = (n as f64 / 64.0, n % 10);
    let gap = r.pick(&["", "", "\n ", "\t"]);
    let surface = r.pick(&[
        "",
        "<surface><finish diffuse='0.5'/></surface>",
        "<surface><finish diffuse='.5' reflect='0.25'/><pigment><color red='1' green='0.5' blue='0'/></pigment></surface>",
        "<surface><pigment><color red='1' green='0.5' blue='0'></color></pigment></surface>",
        "<surface><finish/></surface>",
        "<surface><finish diffuse='1' reflect='1'/></surface>",
        "<surface><!-- c --><finish reflect='1'/></surface>",
    ]);
    // What makes a document wrong is rare, for most are to be read.
    let is_wrong = r.below(200) == 0;
    let wrong = r.pick(&[
        "<surface><finish diffuse='1.5'/></surface>",
        "<surface><pigment><image><ppm file='none.ppm'/></image></pigment></surface>",
        "<surface><pigment><image><ppm file=''/></image></pigment></surface>",
    ]);
    let surface = if is_wrong { wrong } else { surface };
    let up = r.pick(if is_wrong { &["0", "-1"] } else { &["1", "2.5"] });
    match r.below(7) {
        0 => format!("<light>{gap}<position><vector x='{a}' y='{b}' z='1'/></position></light>"),
        1 => format!("<plane distance='{a}'><normal><vector x='{b}' y='1' z='1'/>{gap}</normal>{surface}</plane>"),
        2 => format!(
            "<sphere radius='{b}.5'><location><vector x='{a}' y='0' z='1e-3'/></location>{gap}{surface}</sphere>"
        ),
        3 => {
            let pole = r.pick(&["", "<pole><vector x='0' y='0.5' z='0'/></pole>"]);
            let equator = r.pick(&["", "<equator><vector x='1' y='0' z='0'/></equator>"]);
            let equator = if is_wrong { equator.replace('1', "0") } else { equator.to_owned() };
            format!(
                "<sphere radius='{up}'><location><vector x='{b}' y='{a}' z='-0'/></location>{pole}{gap}{equator}{surface}</sphere>"
            )
        }
        4 => {
            let distance = if is_wrong { " distance='2'" } else { "" };
            format!(
                "<plane{distance}><normal><vector x='{b}' y='{up}' z='0'/></normal>\
                 <point><vector x='0' y='{a}' z='1'/></point>{surface}</plane>"
            )
        }
        5 => format!(
            "<triangle><c0><vector x='{a}' y='0' z='0'/></c0>{gap}<v1><vector x='1' y='{b}' z='0'/></v1>\
             <v2><vector x='0' y='1' z='0'/></v2>{surface}</triangle>"
        ),
        _ => format!(
            "<triangle><c0><vector x='0' y='0' z='0'/></c0><c1><vector z='1' y='{b}' x='2'/></c1>\
             <c2><vector x='{a}' y='{a}' z='1' /></c2 >{surface}</triangle>"
        ),
    }
}

fn document(r: &mut Random) -> String {
    let mut out = format!("<scene>{CAMERA}<world>{LIGHT}");
    for _ in 0..r.below(60) {
        out += r.pick(&[
            "",
            "",
            "\n",
            " ",
            "<!-- <sphere radius='1'> -->",
            "<?p <triangle> ?>",
            "<!-- <triangle></triangle> </world> -->",
        ]);
        out += &object(r);
    }
    out + "</world></scene>"
}

/// Breaks a document; `form` too, or only what it says.
fn break_something(r: &mut Random, text: &mut String, form: bool) {
    let at = r.below(text.len());
    if form {
        match r.below(4) {
            0 => {
                text.remove(at);
            }
            1 => text.insert_str(
                at,
                r.pick(&[
                    "<",
                    ">",
                    "'",
                    "/",
                    "&",
                    "<!--",
                    "-->",
                    "<x>",
                    "</x>",
                    "</world>",
                    "<![CDATA[x]]>",
                    "<sphere>",
                    "<a:b/>",
                ]),
            ),
            2 => {
                let end = (at + r.below(80)).min(text.len());
                text.replace_range(at..end, "");
            }
            _ => {
                let end = (at + r.below(200)).min(text.len());
                let piece = text[at..end].to_owned();
                text.insert_str(at, &piece);
            }
        }
    } else if let Some(i) = text[at..].find("x='") {
        let attribute = format!("9' w{}='1", r.below(1 << 30));
        let bad = r.pick(&["1e999", "-", "1e-999", "0", "NaN", "1,5", "&#49;", &attribute]);
        text.insert_str(at + i + 3, bad);
    } else if let Some(i) = text[at..].find("</") {
        text.insert_str(
            at + i,
            r.pick(&["text", "<cube/>", "<light/>", "&#32;", "<surface/>", "<sphere radius='1'></sphere>"]),
        );
    }
}

fn options() -> ReadOptions {
    ReadOptions { max_errors: 100_000, max_warnings: 100_000, ..ReadOptions::default() }
}

fn cut(text: &str, run: usize, piece: usize, batch: usize, fast: bool) -> Result<Read, ReadError> {
    let tuning = Tuning { run, piece, batch, fast };
    read(text.as_bytes().to_vec(), "s.xml", None, &options(), tuning)
}

/// As one whole document: nothing is cut out of the frame.
fn whole(text: &str) -> (Vec<Diagnostic>, Option<crate::scene::Scene>) {
    let limits = Limits { errors: 100_000, warnings: 100_000 };
    let mut assembly = Assembly::new(limits, Pictures::default());
    let mut findings = Findings::new(limits);
    let outline = frame::outline(text, 0, &mut findings);
    frame::check(text, &outline, None, limits, findings, &mut assembly);
    let mut list = std::mem::take(&mut assembly.findings.list);
    list.sort_by_key(|f| f.at.start);
    let mut lines = source::Lines::new(text, 0);
    let diagnostics = list.into_iter().map(|f| lines.diagnostic("s.xml", f)).collect();
    (diagnostics, if assembly.findings.errors == 0 { assembly.scene.finish().ok() } else { None })
}

fn diagnostics(result: &Result<Read, ReadError>) -> &[Diagnostic] {
    match result {
        Ok(read) => &read.warnings,
        Err(error) => &error.diagnostics,
    }
}

/// Read block by block, where it can be.
fn in_blocks(text: &str, block: usize, behind: usize, batch: usize) -> Option<Read> {
    blocks_of(text, Blocks { block, behind, batch }, &options())
}

fn blocks_of(text: &str, blocks: Blocks, options: &ReadOptions) -> Option<Read> {
    let fetch = |at: u64, buffer: &mut [u8]| {
        let rest = &text.as_bytes()[at as usize..];
        let n = rest.len().min(buffer.len());
        buffer[..n].copy_from_slice(&rest[..n]);
        Ok(n)
    };
    streamed(&fetch, text.len(), blocks, "s.xml", None, options)
}

/// Compares all cuts; gives the result.
fn same_for_all_cuts(text: &str) -> Result<Read, ReadError> {
    let first = cut(text, 64 << 10, 128 << 10, 128, true);
    for (run, piece, batch, fast) in [
        (1, 100, 3, true),
        (1 << 30, 1 << 30, 1, false),
        (300, 1, 1, true),
        (1000, 333, 2, false),
        (1, 50, 1000, false),
        (500, 700, 7, true),
    ] {
        let other = cut(text, run, piece, batch, fast);
        assert_eq!(first, other, "run {run}, piece {piece}, batch {batch}, fast {fast}\n{text}");
    }
    for (block, behind, batch) in [(600, 400, 3), (1000, 300, 1), (1 << 20, 0, 1)] {
        if let Some(read) = in_blocks(text, block, behind, batch) {
            assert_eq!(first.as_ref(), Ok(&read), "block {block}, behind {behind}, batch {batch}\n{text}");
        }
    }
    first
}

#[test]
fn ordinary_documents_are_read_in_blocks() {
    let mut r = Random(3);
    let (mut good, mut cut) = (0, 0);
    for _ in 0..200 {
        let text = document(&mut r);
        let read = same_for_all_cuts(&text);
        // Where a warning's line begins may not be in sight.
        if read.is_ok_and(|read| read.warnings.is_empty()) {
            assert!(in_blocks(&text, 1 << 20, 0, 1).is_some(), "\n{text}");
            good += 1;
        }
        // Blocks may be taken to begin inside a comment.
        cut += usize::from(in_blocks(&text, 600, 600, 2).is_some());
    }
    assert!(good > 15 && cut > 15, "{good} good, {cut} in blocks");
}

#[test]
fn blocks_count_lines() {
    let flat = "<triangle><c0><vector x='1' y='1' z='1'/></c0><c1><vector x='1' y='1' z='1'/></c1>\
        <c2><vector x='2' y='1' z='1'/></c2></triangle>";
    for end in ["\n", "\r\n", "\r", "\n\r\n"] {
        let objects = format!("{LIGHT}{end}{LIGHT}{end}{flat}{end}").repeat(40);
        let text = format!("<scene>{end}{CAMERA}<world>{end}{objects}</world>{end}</scene>{end}");
        let whole = cut(&text, 64 << 10, 128 << 10, 128, true);
        assert_eq!(diagnostics(&whole).len(), 40);
        for block in [600, 601, 602, 603, 1500, 1 << 20] {
            assert_eq!(in_blocks(&text, block, 1400, 3), whole.clone().ok(), "{block} {end:?}");
        }
    }
}

#[test]
fn blocks_tell_the_warnings_that_the_whole_tells() {
    // Of such a triangle, what is found first stands behind.
    let flat = "<triangle><c0><vector x='1' y='1e-400' z='1'/></c0><c1><vector x='1' y='0' z='1'/></c1>\
        <c2><vector x='2' y='1' z='1'/></c2></triangle>";
    let objects = format!("{LIGHT}\n{LIGHT}\n{LIGHT}\n{flat}\n").repeat(20);
    let text = format!("<scene>\n{CAMERA}<world>\n{objects}</world>\n</scene>");
    for max_warnings in [0, 1, 2, 3, 20, 1000] {
        let options = ReadOptions { max_warnings, ..options() };
        let whole = read(text.as_bytes().to_vec(), "s.xml", None, &options, Tuning::default());
        let blocks = Blocks { block: 700, behind: 1400, batch: 3 };
        assert_eq!(blocks_of(&text, blocks, &options), whole.ok(), "{max_warnings}");
    }
}

#[test]
fn what_is_not_whole_or_not_ascii_is_not_read_in_blocks() {
    let good =
        format!("<?xml version='1.0' encoding='latin1'?><scene>{CAMERA}<world>{}</world></scene>", LIGHT.repeat(50));
    assert!(in_blocks(&good, 600, 300, 2).is_some());
    for bad in [
        good.replace("latin1", "utf-16"),
        good.replace("latin1", "no such"),
        good.replace("<world>", "<world><!-- \u{e4} -->"),
        good.replace("</scene>", ""),
        good.replace("</scene>", "</scene><!-- \u{e4} -->"),
        good.replace("encoding='latin1'", "standalone='yes'"),
        good.replace(&format!("{LIGHT}</world>"), &format!("<!-- {} --></world>", LIGHT.repeat(20))),
    ] {
        assert_eq!(in_blocks(&bad, 600, 300, 2), None, "{bad}");
    }
}

#[test]
fn documents_of_good_form_read_as_one_whole() {
    let mut r = Random(1);
    let (mut good, mut bad) = (0, 0);
    for i in 0..600 {
        let mut text = document(&mut r);
        for _ in 0..i % 4 {
            break_something(&mut r, &mut text, false);
        }
        let result = same_for_all_cuts(&text);
        let (whole, scene) = whole(&text);
        assert_eq!(diagnostics(&result), whole, "\n{text}");
        assert_eq!(result.as_ref().ok().map(|r| &r.scene), scene.as_ref(), "\n{text}");
        *if result.is_ok() { &mut good } else { &mut bad } += 1;
    }
    assert!(good > 100 && bad > 100, "{good} good, {bad} bad");
}

#[test]
fn broken_documents_read_the_same_for_all_cuts() {
    let mut r = Random(2);
    let mut broken = 0;
    for _ in 0..1500 {
        let mut text = document(&mut r);
        for _ in 0..=r.below(3) {
            break_something(&mut r, &mut text, true);
        }
        let result = same_for_all_cuts(&text);
        let (whole, _) = whole(&text);
        let structural = |d: &[Diagnostic]| d.iter().any(|d| d.code.is_structural());
        assert_eq!(structural(diagnostics(&result)), structural(&whole), "\n{result:?}\n{whole:?}\n{text}");
        broken += usize::from(structural(&whole));
    }
    assert!(broken > 500, "only {broken} were broken");
}

#[test]
fn guesses_inside_comments_are_thrown_away() {
    let inside = "<sphere radius='0'></sphere> <triangle> </plane>".repeat(200);
    let text = format!("<scene>{CAMERA}<world>{LIGHT}<!--{inside}-->{LIGHT}<?p {inside}?>{LIGHT}</world></scene>");
    let read = same_for_all_cuts(&text).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(read.scene.lights().len(), 3);
    assert!(read.warnings.is_empty());
}

#[test]
fn a_piece_ends_where_the_next_one_begins() {
    // Else what was read beside it is read again by one thread.
    for gap in ["", "\n", " \r\n\t"] {
        let text = [LIGHT, LIGHT, LIGHT].join(gap);
        let stop = 2 * (LIGHT.len() + gap.len());
        let limits = Limits { errors: 1, warnings: 1 };
        let (_, end, _) = Reader::new(&text, Tuning::default(), limits, false, false).read(0, stop);
        assert_eq!(end, End::At(stop), "{gap:?}");
    }
}
