//! Bytes into text, as the byte order mark or the XML declaration says.
//!
//! Text that is UTF-8 already, or ASCII under any name, keeps its bytes: no copy is
//! made. Labels are those of the WHATWG Encoding Standard, except where that reads a
//! name of ISO 8859 or ASCII as the Windows code page that browsers put in its place.

use encoding_rs::{DecoderResult, Encoding, UTF_8, UTF_16BE, UTF_16LE};

use super::diagnostic::Code;
use super::finding::Finding;
use super::{prolog, source};

/// A document's text.
#[derive(Debug)]
pub(super) struct Decoded {
    pub text: String,
    /// Where the document begins: behind the byte order mark.
    pub start: usize,
}

/// A document that is no text, with as much of it as shows the spot.
#[derive(Debug)]
pub(super) struct Undecodable {
    pub text: String,
    pub finding: Finding,
}

/// How bytes are read.
#[derive(Clone, Copy, PartialEq)]
enum Scheme {
    Ascii,
    Latin1,
    /// A single-byte table whose bytes 0x80 to 0x9F are the C1 controls of ISO 8859.
    Iso(&'static Encoding),
    Table(&'static Encoding),
}

const LATIN1: [&str; 12] = [
    "iso-8859-1",
    "iso8859-1",
    "iso88591",
    "iso_8859-1",
    "iso_8859-1:1987",
    "latin1",
    "latin-1",
    "l1",
    "ibm819",
    "cp819",
    "iso-ir-100",
    "csisolatin1",
];
const ASCII: [&str; 9] =
    ["us-ascii", "ascii", "ansi_x3.4-1968", "iso646-us", "iso-ir-6", "us", "ibm367", "cp367", "csascii"];

fn scheme(label: &str) -> Option<Scheme> {
    let lower = label.to_ascii_lowercase();
    if LATIN1.contains(&lower.as_str()) {
        return Some(Scheme::Latin1);
    }
    if ASCII.contains(&lower.as_str()) {
        return Some(Scheme::Ascii);
    }
    let table = Encoding::for_label_no_replacement(lower.as_bytes())?;
    if table == encoding_rs::X_USER_DEFINED {
        return None;
    }
    let iso = ["8859", "latin", "iso-ir", "tis-620"].iter().any(|part| lower.contains(part)) || lower == "l5";
    Some(if iso && table.is_single_byte() { Scheme::Iso(table) } else { Scheme::Table(table) })
}

/// Decodes a whole document.
pub(super) fn decode(bytes: Vec<u8>) -> Result<Decoded, Box<Undecodable>> {
    match *bytes.as_slice() {
        [0xFF, 0xFE, 0, 0, ..] | [0, 0, 0xFE, 0xFF, ..] => Err(refuse("the document is UTF-32", "")),
        [0xEF, 0xBB, 0xBF, ..] => {
            let start = 3;
            let text = utf8(bytes)?;
            agree(&text, start, |s| s == Scheme::Table(UTF_8))?;
            Ok(Decoded { text, start })
        }
        [0xFE, 0xFF, ..] => utf16(&bytes[2..], 2, UTF_16BE),
        [0xFF, 0xFE, ..] => utf16(&bytes[2..], 2, UTF_16LE),
        [0, b'<', 0, b'?', ..] => utf16(&bytes, 0, UTF_16BE),
        [b'<', 0, b'?', 0, ..] => utf16(&bytes, 0, UTF_16LE),
        [0x4C, 0x6F, 0xA7, 0x94, ..] => Err(refuse("the document is EBCDIC", "")),
        _ => declared(bytes),
    }
}

fn refuse(message: &str, text: &str) -> Box<Undecodable> {
    let finding = Finding::new(Code::Encoding, 0..text.len().min(1), message).expected("UTF-8 text");
    Box::new(Undecodable { text: text.into(), finding })
}

/// A document without byte order mark in an encoding that extends ASCII.
fn declared(bytes: Vec<u8>) -> Result<Decoded, Box<Undecodable>> {
    let head: String = bytes.iter().take(1024).map(|&b| char::from(b)).collect();
    // Where the declaration is broken, its reader on the text will say so.
    let name = prolog::declaration(&head, 0).ok().flatten().and_then(|d| d.encoding);
    let Some(name) = name else { return Ok(Decoded { text: utf8(bytes)?, start: 0 }) };
    // Of Latin-1 characters, only those above ASCII take two bytes in `head`; a declaration has none.
    let label = &head[name.clone()];
    let fail = |message: String| {
        let known = ["utf-8", "utf-16", "iso-8859-1", "us-ascii", "windows-1252", "iso-8859-15"];
        let finding = Finding::new(Code::Encoding, name.clone(), message)
            .expected("the name of an encoding that this document really has, such as utf-8 or iso-8859-1")
            .suggest(super::suggest::closest(label, known).filter(|k| *k != label));
        Box::new(Undecodable { text: String::from_utf8_lossy(&bytes[..bytes.len().min(1024)]).into_owned(), finding })
    };
    let Some(scheme) = scheme(label) else { return Err(fail(format!("unknown encoding `{label}`"))) };
    match scheme {
        Scheme::Table(table) if table == UTF_16LE || table == UTF_16BE => {
            Err(fail(format!("the document is labelled `{label}`, but its bytes are not UTF-16")))
        }
        Scheme::Table(table) if table == UTF_8 => Ok(Decoded { text: utf8(bytes)?, start: 0 }),
        Scheme::Table(table) if !table.is_ascii_compatible() => {
            Ok(Decoded { text: table_text(&bytes, 0, table)?, start: 0 })
        }
        _ if bytes.is_ascii() => Ok(Decoded { text: utf8(bytes)?, start: 0 }),
        Scheme::Ascii => {
            Err(bad_byte(&bytes, 0, bytes.iter().take_while(|b| b.is_ascii()).count(), label, Encoding::name(UTF_8)))
        }
        Scheme::Latin1 => Ok(Decoded { text: encoding_rs::mem::decode_latin1(&bytes).into_owned(), start: 0 }),
        Scheme::Iso(table) => Ok(Decoded { text: iso_text(&bytes, table)?, start: 0 }),
        Scheme::Table(table) => Ok(Decoded { text: table_text(&bytes, 0, table)?, start: 0 }),
    }
}

/// The text of `bytes`, which must be UTF-8.
fn utf8(bytes: Vec<u8>) -> Result<String, Box<Undecodable>> {
    String::from_utf8(bytes).map_err(|e| {
        let at = e.utf8_error().valid_up_to();
        bad_byte(e.as_bytes(), 0, at, "utf-8", UTF_8.name())
    })
}

/// UTF-16 behind `skipped` bytes of byte order mark.
fn utf16(bytes: &[u8], skipped: usize, table: &'static Encoding) -> Result<Decoded, Box<Undecodable>> {
    let text = table_text(bytes, skipped, table)?;
    agree(&text, 0, |s| match s {
        // "UTF-16" reads as UTF-16LE here; the mark says which it is.
        Scheme::Table(t) => t == UTF_16LE || t == table,
        _ => false,
    })?;
    Ok(Decoded { text, start: 0 })
}

/// Checks that the declared encoding is the one the byte order mark shows.
fn agree(text: &str, start: usize, fits: impl Fn(Scheme) -> bool) -> Result<(), Box<Undecodable>> {
    let Ok(Some(prolog::Declaration { encoding: Some(name), .. })) = prolog::declaration(text, start) else {
        return Ok(());
    };
    let label = &text[name.clone()];
    if scheme(label).is_some_and(fits) {
        return Ok(());
    }
    let finding = Finding::new(
        Code::Encoding,
        name,
        format!("the document is labelled `{label}`, but its first bytes show another encoding"),
    )
    .expected("the encoding that the document really has, or none in the declaration");
    Err(Box::new(Undecodable { text: source::head(text, 1024).into(), finding }))
}

fn iso_text(bytes: &[u8], table: &'static Encoding) -> Result<String, Box<Undecodable>> {
    let mut text = String::with_capacity(bytes.len() + bytes.len() / 8);
    let mut at = 0;
    while at < bytes.len() {
        let c1 = |b: &u8| (0x80..0xA0).contains(b);
        let end = at + bytes[at..].iter().position(c1).unwrap_or(bytes.len() - at);
        match table.decode_without_bom_handling_and_without_replacement(&bytes[at..end]) {
            Some(part) => text += &part,
            None => {
                let bad = (at..end)
                    .find(|&i| table.decode_without_bom_handling_and_without_replacement(&bytes[i..=i]).is_none());
                return Err(bad_byte(bytes, 0, bad.unwrap_or(at), table.name(), table.name()));
            }
        }
        if let Some(&b) = bytes.get(end) {
            text.push(char::from(b));
        }
        at = end + 1;
    }
    Ok(text)
}

fn table_text(bytes: &[u8], skipped: usize, table: &'static Encoding) -> Result<String, Box<Undecodable>> {
    let mut decoder = table.new_decoder_without_bom_handling();
    let mut text = String::with_capacity(bytes.len() + bytes.len() / 8 + 16);
    let mut at = 0;
    loop {
        let (result, read) = decoder.decode_to_string_without_replacement(&bytes[at..], &mut text, true);
        at += read;
        match result {
            DecoderResult::InputEmpty => return Ok(text),
            DecoderResult::OutputFull => text.reserve(bytes.len() - at + 64),
            DecoderResult::Malformed(len, behind) => {
                let bad = at.saturating_sub(usize::from(len) + usize::from(behind));
                return Err(bad_byte(bytes, skipped, bad, table.name(), table.name()));
            }
        }
    }
}

/// The finding for the byte at `bad`, which is wrong in the encoding called `label`.
fn bad_byte(bytes: &[u8], skipped: usize, bad: usize, label: &str, table: &str) -> Box<Undecodable> {
    let table = Encoding::for_label(table.as_bytes()).unwrap_or(UTF_8);
    let read = |range: std::ops::Range<usize>| table.decode_without_bom_handling(&bytes[range]).0.into_owned();
    let mut text = read(0..bad);
    let at = text.len();
    text += &read(bad..bytes.len().min(bad + 160));
    let width = text[at..].chars().next().map_or(0, char::len_utf8);
    let byte = bytes.get(bad).map_or_else(|| "the end".into(), |b| format!("byte 0x{b:02X}"));
    let finding = Finding::new(
        Code::Encoding,
        at..at + width,
        format!("{byte} at offset {} is wrong in the encoding {label}", bad + skipped),
    )
    .expected(
        "bytes of the declared encoding; one that is declared nowhere is utf-8: <?xml version=\"1.0\" encoding=\"…\"?>",
    );
    Box::new(Undecodable { text, finding })
}
