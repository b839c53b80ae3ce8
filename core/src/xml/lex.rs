//! Markup boundaries: where tags, comments and their like begin and end.
//!
//! The reader cuts a document into pieces before the XML parser sees it, and what it
//! cuts must be what the parser would see: a `>` in a quoted value, a `<sphere>` in a
//! comment end nothing. This lexer is strict about everything it looks at; names and
//! characters are left to the parser.

use std::ops::Range;

use memchr::memmem;

use super::diagnostic::Code;
use super::finding::Finding;
use super::prolog;

/// Attributes that a tag may have before it is refused unread; the format needs three.
pub(super) const MAX_ATTRIBUTES: usize = 64;

/// What a piece of markup is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Kind {
    Comment,
    Instruction,
    Cdata,
    Doctype,
    /// `<name …>`, or `<name …/>` if empty.
    Start {
        empty: bool,
    },
    End,
}

/// One piece of markup.
#[derive(Clone, Debug)]
pub(super) struct Token {
    pub kind: Kind,
    /// From `<` to behind `>`.
    pub at: Range<usize>,
    /// An element's name in tags.
    pub name: Range<usize>,
    /// What is wrong though the boundaries are clear: names with prefixes, bad references.
    pub findings: Vec<Finding>,
}

/// Markup that does not end where it should.
#[derive(Debug)]
pub(super) struct Broken {
    pub finding: Finding,
    /// Where reading may go on.
    pub resume: usize,
}

pub(super) fn is_space(b: u8) -> bool {
    matches!(b, b' ' | b'\t' | b'\r' | b'\n')
}

fn skip_space(bytes: &[u8], mut at: usize) -> usize {
    while bytes.get(at).copied().is_some_and(is_space) {
        at += 1;
    }
    at
}

/// The end of the run of bytes at `at` that may belong to a name.
fn name_end(bytes: &[u8], mut at: usize) -> usize {
    while bytes
        .get(at)
        .is_some_and(|b| !matches!(b, b' ' | b'\t' | b'\r' | b'\n' | b'/' | b'>' | b'<' | b'=' | b'"' | b'\'' | b'&'))
    {
        at += 1;
    }
    at
}

/// The next markup at or behind `from`; `None` where only text is left.
pub(super) fn next(text: &str, from: usize) -> Option<Result<Token, Box<Broken>>> {
    let bytes = text.as_bytes();
    let start = from + memchr::memchr(b'<', &bytes[from..])?;
    Some(match bytes.get(start + 1) {
        Some(b'!') => declaration(text, start),
        Some(b'?') => instruction(text, start),
        Some(b'/') => end_tag(text, start),
        _ => start_tag(text, start),
    })
}

fn broken<T>(at: Range<usize>, message: String, expected: &str, resume: usize) -> Result<T, Box<Broken>> {
    Err(Box::new(Broken { finding: Finding::new(Code::Syntax, at, message).expected(expected), resume }))
}

fn token(kind: Kind, at: Range<usize>, name: Range<usize>) -> Result<Token, Box<Broken>> {
    Ok(Token { kind, at, name, findings: Vec::new() })
}

fn declaration(text: &str, start: usize) -> Result<Token, Box<Broken>> {
    let bytes = text.as_bytes();
    let rest = &bytes[start..];
    let none = start..start;
    if rest.starts_with(b"<!--") {
        let body = start + 4;
        let Some(dashes) = memmem::find(&bytes[body..], b"--").map(|i| body + i) else {
            return broken(start..body, "this comment is never closed".into(), "`-->`", text.len());
        };
        if bytes.get(dashes + 2) == Some(&b'>') {
            return token(Kind::Comment, start..dashes + 3, none);
        }
        let resume = memmem::find(&bytes[dashes..], b"-->").map_or(text.len(), |i| dashes + i + 3);
        return broken(
            dashes..dashes + 2,
            "`--` stands inside a comment".into(),
            "a comment without `--`, or its end `-->`",
            resume,
        );
    }
    if rest.starts_with(b"<![CDATA[") {
        return match memmem::find(rest, b"]]>") {
            Some(i) => token(Kind::Cdata, start..start + i + 3, none),
            None => broken(start..start + 9, "this CDATA section is never closed".into(), "`]]>`", text.len()),
        };
    }
    if rest.starts_with(b"<!DOCTYPE") {
        return match prolog::doctype(text, start) {
            Ok(doctype) => {
                let findings = doctype.finding.into_iter().collect();
                Ok(Token { kind: Kind::Doctype, at: start..doctype.end, name: none, findings })
            }
            Err(finding) => {
                let resume = if finding.code == Code::InternalSubset { text.len() } else { start + 9 };
                Err(Box::new(Broken { finding, resume }))
            }
        };
    }
    broken(
        start..start + 2,
        "`<!` begins nothing that may stand here".into(),
        "a comment `<!-- … -->`, or `&lt;` for the character",
        start + 2,
    )
}

fn instruction(text: &str, start: usize) -> Result<Token, Box<Broken>> {
    let bytes = text.as_bytes();
    let Some(close) = memmem::find(&bytes[start + 2..], b"?>").map(|i| start + 2 + i) else {
        return broken(start..start + 2, "this processing instruction is never closed".into(), "`?>`", text.len());
    };
    let target_len = bytes[start + 2..close].iter().position(|b| is_space(*b)).unwrap_or(close - start - 2);
    let target = start + 2..start + 2 + target_len;
    let name = &text[target.clone()];
    if name.eq_ignore_ascii_case("xml") {
        return broken(
            start..target.end,
            "an XML declaration stands here".into(),
            "it at the very beginning of the file, if anywhere",
            close + 2,
        );
    }
    if !prolog::is_name(name) {
        let at = target.start..target.end.max(target.start + 1).min(close + 1);
        return broken(at, "this processing instruction has no proper name".into(), "`<?name …?>`", close + 2);
    }
    token(Kind::Instruction, start..close + 2, start..start)
}

fn end_tag(text: &str, start: usize) -> Result<Token, Box<Broken>> {
    let bytes = text.as_bytes();
    let name = start + 2..name_end(bytes, start + 2);
    let at = skip_space(bytes, name.end);
    if bytes.get(at) == Some(&b'>') && !name.is_empty() {
        return token(Kind::End, start..at + 1, name);
    }
    let shown = super::source::shown(&text[name]);
    broken(at.min(text.len())..at + 1, format!("the end tag `</{shown}` is not finished"), "`>`", at)
}

fn start_tag(text: &str, start: usize) -> Result<Token, Box<Broken>> {
    let bytes = text.as_bytes();
    let name = start + 1..name_end(bytes, start + 1);
    if name.is_empty() {
        return broken(
            start..start + 1,
            "`<` begins no tag".into(),
            "a name right behind it, or `&lt;` for the character",
            start + 1,
        );
    }
    let mut findings = Vec::new();
    if memchr::memchr(b':', &bytes[name.clone()]).is_some() {
        findings.push(
            Finding::new(
                Code::UnknownElement,
                name.clone(),
                format!("unknown element `{}`", super::source::shown(&text[name.clone()])),
            )
            .expected("a name without a namespace prefix"),
        );
    }
    let mut at = name.end;
    let mut attributes = 0usize;
    loop {
        let before = at;
        at = skip_space(bytes, at);
        let unfinished = || format!("the tag `<{}` is not finished", super::source::shown(&text[name.clone()]));
        match bytes.get(at) {
            Some(b'>') => return Ok(Token { kind: Kind::Start { empty: false }, at: start..at + 1, name, findings }),
            Some(b'/') if bytes.get(at + 1) == Some(&b'>') => {
                return Ok(Token { kind: Kind::Start { empty: true }, at: start..at + 2, name, findings });
            }
            Some(b'/') => return broken(at..at + 1, "a stray `/` stands in this tag".into(), "`/>` or `>`", at + 1),
            None => return broken(start..name.end, unfinished(), "`>` or `/>`", at),
            Some(b'<') => return broken(at..at + 1, unfinished(), "`>` or `/>` before the next tag", at),
            Some(_) => {}
        }
        let (attribute, end) = attribute(text, before, at, &mut findings)?;
        attributes += 1;
        if attributes > MAX_ATTRIBUTES {
            let finding = Finding::new(
                Code::TooManyAttributes,
                attribute,
                format!("this tag has more than {MAX_ATTRIBUTES} attributes"),
            );
            let resume = memchr::memchr(b'<', &bytes[end..]).map_or(text.len(), |i| end + i);
            return Err(Box::new(Broken { finding: finding.expected("three at most"), resume }));
        }
        at = end + 1;
    }
}

/// The attribute at `at`, behind white space from `before` on: where its name is, and its closing quote.
fn attribute(
    text: &str,
    before: usize,
    at: usize,
    findings: &mut Vec<Finding>,
) -> Result<(Range<usize>, usize), Box<Broken>> {
    let bytes = text.as_bytes();
    let attribute = at..name_end(bytes, at);
    let shown = || super::source::shown(&text[attribute.clone()]);
    if attribute.is_empty() {
        return broken(at..at + 1, "an attribute should begin here".into(), "name=\"value\", `>` or `/>`", at + 1);
    }
    if before == at {
        return broken(
            at..attribute.end,
            format!("white space is missing before `{}`", shown()),
            "a space between attributes",
            at,
        );
    }
    let mut at = skip_space(bytes, attribute.end);
    if bytes.get(at) != Some(&b'=') {
        return broken(attribute.clone(), format!("the attribute `{}` has no value", shown()), "name=\"value\"", at);
    }
    at = skip_space(bytes, at + 1);
    let quote = match bytes.get(at) {
        Some(&q @ (b'"' | b'\'')) => q,
        _ => {
            let message = format!("the value of `{}` is not quoted", shown());
            return broken(at.min(text.len())..at + 1, message, "a quote, as in name=\"value\"", at.min(text.len()));
        }
    };
    let value = at + 1;
    let Some(len) = memchr::memchr2(quote, b'<', &bytes[value..]) else {
        return broken(
            at..at + 1,
            format!("the value of `{}` is never closed", shown()),
            "the closing quote",
            text.len(),
        );
    };
    let end = value + len;
    if bytes[end] == b'<' {
        let message = format!("the value of `{}` is not closed before the next `<`", shown());
        return broken(at..at + 1, message, "the closing quote, or `&lt;` for the character", end);
    }
    references(text, value..end, findings);
    if memchr::memchr(b':', &bytes[attribute.clone()]).is_some() || &text[attribute.clone()] == "xmlns" {
        findings.push(
            Finding::new(Code::UnknownAttribute, attribute.clone(), format!("unknown attribute `{}`", shown()))
                .expected("no namespaces: this format has none"),
        );
    }
    Ok((attribute, end))
}

/// Checks the references in an attribute's value. The parser reads `&#xD800;`, which is
/// no character, as a replacement character; XML says that it is an error.
fn references(text: &str, value: Range<usize>, findings: &mut Vec<Finding>) {
    let bytes = text.as_bytes();
    let mut at = value.start;
    while let Some(i) = memchr::memchr(b'&', &bytes[at..value.end]) {
        let start = at + i;
        at = start + 1;
        let end = memchr::memchr(b';', &bytes[at..value.end]).map(|i| at + i);
        let good = end.is_some_and(|end| {
            let name = &text[at..end];
            let digits = |digits: &str, radix| {
                !digits.is_empty()
                    && digits.chars().all(|c| c.is_digit(radix))
                    && u32::from_str_radix(digits, radix).ok().and_then(char::from_u32).is_some_and(prolog::is_char)
            };
            match name.strip_prefix('#') {
                Some(number) => match number.strip_prefix('x') {
                    Some(hex) => digits(hex, 16),
                    None => digits(number, 10),
                },
                None => ["lt", "gt", "amp", "apos", "quot"].contains(&name),
            }
        });
        if !good {
            let shown_end = end.map_or(at, |e| e + 1).min(start + 40);
            let shown_end = super::source::head(text, shown_end).len();
            findings.push(
                Finding::new(
                    Code::Syntax,
                    start..shown_end,
                    format!("`{}` is no reference", super::source::shown(&text[start..shown_end])),
                )
                .expected("`&amp;` for the character, or one of &lt; &gt; &amp; &apos; &quot; &#number;"),
            );
            if findings.len() > MAX_ATTRIBUTES {
                return;
            }
        }
    }
}
