//! What stands before the root: the XML declaration and the DOCTYPE.
//!
//! Both are read here rather than by the XML parser: the declaration decides how
//! the bytes become text in the first place, and nothing in a DOCTYPE is ever
//! followed, so the parser sees blanks in the place of either.

use std::ops::Range;

use super::diagnostic::Code;
use super::finding::Finding;

/// The XML declaration `<?xml …?>`.
#[derive(Debug, PartialEq)]
pub(super) struct Declaration {
    /// Where it ends.
    pub end: usize,
    /// The declared encoding's name.
    pub encoding: Option<Range<usize>>,
    /// The `yes` of `standalone="yes"`.
    pub standalone: Option<Range<usize>>,
}

/// A cursor that fails with a finding.
struct Cursor<'t> {
    text: &'t str,
    at: usize,
    what: &'static str,
    grammar: &'static str,
}

impl<'t> Cursor<'t> {
    fn rest(&self) -> &'t str {
        self.text.get(self.at..).unwrap_or_default()
    }
    fn fail(&self, message: impl std::fmt::Display) -> Finding {
        let here = self.rest().chars().next().map_or(0, char::len_utf8);
        Finding::new(Code::Syntax, self.at..self.at + here, format!("broken {}: {message}", self.what))
            .expected(self.grammar)
    }
    fn space(&mut self) -> bool {
        let rest = self.rest();
        let trimmed = rest.trim_start_matches([' ', '\t', '\r', '\n']);
        self.at += rest.len() - trimmed.len();
        trimmed.len() < rest.len()
    }
    fn eat(&mut self, word: &str) -> bool {
        let found = self.rest().starts_with(word);
        self.at += if found { word.len() } else { 0 };
        found
    }
    /// A quoted text without its quotes.
    fn quoted(&mut self) -> Result<Range<usize>, Finding> {
        let quote = match self.rest().as_bytes().first() {
            Some(&q @ (b'"' | b'\'')) => q,
            _ => return Err(self.fail("a quote is missing")),
        };
        let start = self.at + 1;
        let Some(len) = memchr::memchr(quote, &self.text.as_bytes()[start..]) else {
            return Err(self.fail("this quote is never closed"));
        };
        self.at = start + len + 1;
        Ok(start..start + len)
    }
    /// `= "value"` behind a name.
    fn value(&mut self) -> Result<Range<usize>, Finding> {
        self.space();
        if !self.eat("=") {
            return Err(self.fail("`=` is missing"));
        }
        self.space();
        self.quoted()
    }
}

/// Reads the declaration at `start`, if there is one.
pub(super) fn declaration(text: &str, start: usize) -> Result<Option<Declaration>, Finding> {
    let mut c = Cursor {
        text,
        at: start,
        what: "XML declaration",
        grammar: "<?xml version=\"1.0\" encoding=\"utf-8\"?>, the encoding being optional",
    };
    if !c.eat("<?xml") || !c.rest().starts_with([' ', '\t', '\r', '\n', '?']) {
        return Ok(None);
    }
    c.space();
    if !c.eat("version") {
        return Err(c.fail("it has no version"));
    }
    let version = c.value()?;
    let number = text[version.clone()].strip_prefix("1.").unwrap_or_default();
    if number.is_empty() || !number.bytes().all(|b| b.is_ascii_digit()) {
        c.at = version.start;
        return Err(c.fail(format_args!("version `{}` is not XML 1", super::source::shown(&text[version]))));
    }
    let mut encoding = None;
    let mut spaced = c.space();
    if spaced && c.eat("encoding") {
        let name = c.value()?;
        let written = &text[name.clone()];
        if !written.starts_with(|c: char| c.is_ascii_alphabetic())
            || !written.bytes().all(|b| b.is_ascii_alphanumeric() || b"._-".contains(&b))
        {
            c.at = name.start;
            return Err(c.fail("this is no name of an encoding"));
        }
        encoding = Some(name);
        spaced = c.space();
    }
    let mut standalone = None;
    if spaced && c.eat("standalone") {
        let value = c.value()?;
        if !["yes", "no"].contains(&&text[value.clone()]) {
            c.at = value.start;
            return Err(c.fail("standalone is `yes` or `no`"));
        }
        standalone = Some(value.clone()).filter(|v| &text[v.clone()] == "yes");
        c.space();
    }
    if !c.eat("?>") {
        return Err(c.fail("`?>` should end it here"));
    }
    Ok(Some(Declaration { end: c.at, encoding, standalone }))
}

/// A DOCTYPE that was read.
#[derive(Debug)]
pub(super) struct Doctype {
    /// Where it ends.
    pub end: usize,
    /// What is wrong with it although it is well-formed.
    pub finding: Option<Finding>,
}

/// Reads the DOCTYPE at `start`, where `<!DOCTYPE` stands. Follows nothing.
pub(super) fn doctype(text: &str, start: usize) -> Result<Doctype, Finding> {
    let mut c = Cursor { text, at: start, what: "DOCTYPE", grammar: "<!DOCTYPE scene SYSTEM \"pm2gl.dtd\">" };
    c.eat("<!DOCTYPE");
    if !c.space() {
        return Err(c.fail("white space is missing"));
    }
    let name_start = c.at;
    let name_len = c.rest().find([' ', '\t', '\r', '\n', '>', '[', '"', '\'', '<']).unwrap_or(c.rest().len());
    c.at += name_len;
    let name = &text[name_start..c.at];
    if name.is_empty() || !is_name(name) {
        c.at = name_start;
        return Err(c.fail("it names no root element"));
    }
    let spaced = c.space();
    if spaced && c.eat("SYSTEM") {
        external(&mut c)?;
    } else if spaced && c.eat("PUBLIC") {
        if !c.space() {
            return Err(c.fail("white space is missing"));
        }
        let public = c.quoted()?;
        let allowed = |b: u8| b.is_ascii_alphanumeric() || b" \r\n-'()+,./:=?;!*#@$_%".contains(&b);
        if let Some(bad) = text[public.clone()].bytes().position(|b| !allowed(b)) {
            c.at = public.start + bad;
            return Err(c.fail("a public identifier may not have this character"));
        }
        external(&mut c)?;
    }
    c.space();
    if c.rest().starts_with('[') {
        return Err(Finding::new(Code::InternalSubset, c.at..c.at + 1, "the DOCTYPE has declarations of its own")
            .expected("a DOCTYPE without `[ … ]`: this format has no use for entities or other declarations"));
    }
    if !c.eat(">") {
        return Err(c.fail("`>` should end it here"));
    }
    let finding = (name != "scene").then(|| {
        Finding::new(
            Code::Doctype,
            name_start..name_start + name_len,
            format!("the DOCTYPE names the root `{}`", super::source::shown(name)),
        )
        .expected("<!DOCTYPE scene …>")
        .suggest(Some("scene"))
    });
    Ok(Doctype { end: c.at, finding })
}

fn external(c: &mut Cursor<'_>) -> Result<(), Finding> {
    if !c.space() {
        return Err(c.fail("white space is missing"));
    }
    let id = c.quoted()?;
    if let Some(bad) = c.text[id.clone()].find(|ch| !is_char(ch)) {
        c.at = id.start + bad;
        return Err(c.fail("XML does not allow this character"));
    }
    Ok(())
}

/// XML's `Char`.
pub(super) fn is_char(c: char) -> bool {
    matches!(c, '\t' | '\n' | '\r' | '\u{20}'..='\u{FFFD}' | '\u{10000}'..)
}

/// XML's `Name`.
pub(super) fn is_name(name: &str) -> bool {
    let start = |c: char| {
        matches!(c, ':' | '_' | 'A'..='Z' | 'a'..='z' | '\u{C0}'..='\u{D6}' | '\u{D8}'..='\u{F6}'
            | '\u{F8}'..='\u{2FF}' | '\u{370}'..='\u{37D}' | '\u{37F}'..='\u{1FFF}' | '\u{200C}'..='\u{200D}'
            | '\u{2070}'..='\u{218F}' | '\u{2C00}'..='\u{2FEF}' | '\u{3001}'..='\u{D7FF}'
            | '\u{F900}'..='\u{FDCF}' | '\u{FDF0}'..='\u{FFFD}' | '\u{10000}'..='\u{EFFFF}')
    };
    let more = |c: char| {
        start(c) || matches!(c, '-' | '.' | '0'..='9' | '\u{B7}' | '\u{300}'..='\u{36F}' | '\u{203F}'..='\u{2040}')
    };
    name.starts_with(start) && name.chars().all(more)
}
