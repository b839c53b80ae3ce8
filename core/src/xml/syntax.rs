//! The XML parser's errors as findings.

use roxmltree::Error;

use super::check::Shift;
use super::diagnostic::Code;
use super::finding::Finding;

/// What the parser says about `source`, at its place in the document.
pub(super) fn finding(error: &Error, source: &str, shift: Shift) -> Finding {
    let (message, expected) = words(error);
    let at = match error {
        // These carry no position of their own.
        Error::UnclosedRootNode | Error::UnexpectedEndOfStream => source.len(),
        Error::NoRootNode | Error::NodesLimitReached | Error::AttributesLimitReached => 0,
        _ => offset(source, error.pos()),
    };
    let width = source[at..].chars().next().map_or(0, char::len_utf8);
    let start = shift.at(at);
    Finding::new(Code::Syntax, start..start + width, message).expected(expected)
}

/// The first character in `range` that XML does not allow, as the parser would tell it.
pub(super) fn bad_character(text: &str, range: std::ops::Range<usize>) -> Option<Finding> {
    let (i, c) = text[range.clone()].char_indices().find(|&(_, c)| !super::prolog::is_char(c))?;
    let at = range.start + i;
    let (message, expected) = words(&Error::NonXmlChar(c, roxmltree::TextPos::new(1, 1)));
    Some(Finding::new(Code::Syntax, at..at + c.len_utf8(), message).expected(expected))
}

/// The parser counts lines at LF only, and columns in characters.
fn offset(source: &str, pos: roxmltree::TextPos) -> usize {
    let start = match pos.row {
        0 | 1 => 0,
        row => memchr::memchr_iter(b'\n', source.as_bytes()).nth(row as usize - 2).map_or(source.len(), |i| i + 1),
    };
    source[start..].char_indices().nth((pos.col as usize).saturating_sub(1)).map_or(source.len(), |(i, _)| start + i)
}

fn words(error: &Error) -> (String, &'static str) {
    match error {
        Error::UnexpectedCloseTag(expected, actual, _) => {
            (format!("`</{actual}>` stands where `{expected}` is open"), "end tags in the reverse order of start tags")
        }
        Error::UnknownEntityReference(name, _) => (
            format!("unknown entity `&{};`", super::source::shown(name)),
            "one of &lt; &gt; &amp; &apos; &quot; &#number;",
        ),
        Error::MalformedEntityReference(_) => {
            ("`&` begins no reference".into(), "`&amp;` for the character, or one of &lt; &gt; &apos; &quot; &#number;")
        }
        Error::DuplicatedAttribute(name, _) => {
            (format!("a second attribute `{}` in this tag", super::source::shown(name)), "each attribute once")
        }
        Error::UnknownNamespace(prefix, _) => {
            (format!("unknown namespace prefix `{}`", super::source::shown(prefix)), "a name without a prefix")
        }
        Error::NoRootNode => ("there is no root element".into(), "<scene> … </scene>"),
        Error::UnclosedRootNode | Error::UnexpectedEndOfStream => {
            ("the document ends too early".into(), "end tags for all that is open")
        }
        Error::InvalidName(_) => {
            ("a name is wrong here".into(), "a letter or `_`, then letters, digits, `_`, `-` or `.`")
        }
        Error::NonXmlChar(c, _) => {
            (format!("XML does not allow the character U+{:04X}", u32::from(*c)), "text without control characters")
        }
        Error::InvalidCharacterData(_) => ("`]]>` stands in text".into(), "`]]&gt;`"),
        Error::UnknownToken(_) => {
            ("nothing may stand here but comments and white space".into(), "one root element and no text outside it")
        }
        other => {
            // The parser's words end in "at row:col" of what it was given.
            let mut text = other.to_string();
            if let Some(at) = text.find(" at ") {
                text.truncate(at);
            }
            (text, "well-formed XML")
        }
    }
}
