//! What is wrong with a document, told to a person and to a machine.

use std::fmt;
use std::ops::Range;

use unicode_width::UnicodeWidthStr;

/// How bad it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Severity {
    /// The scene cannot be rendered.
    Error,
    /// It can be, but something in it looks like a mistake.
    Warning,
}

impl fmt::Display for Severity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Error => "error",
            Self::Warning => "warning",
        })
    }
}

/// What kind of problem it is. [`Code::as_str`] is stable: scripts may rely on it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Code {
    /// The file cannot be read at all.
    Io,
    /// Unknown encoding, or bytes that are wrong in the declared one.
    Encoding,
    /// Not well-formed XML.
    Syntax,
    /// Nested too deep.
    TooDeep,
    /// More attributes in one tag than any tag may have.
    TooManyAttributes,
    /// The document, or one piece of it, is larger than what is read.
    TooLarge,
    /// A DOCTYPE that names another root.
    Doctype,
    /// A DOCTYPE with declarations of its own.
    InternalSubset,
    /// An element whose name the format does not have.
    UnknownElement,
    /// A known element where it may not stand.
    MisplacedElement,
    /// A required element is absent.
    MissingElement,
    /// Text, or content in an empty element.
    UnexpectedContent,
    /// An attribute that the element does not have.
    UnknownAttribute,
    /// A required attribute is absent.
    MissingAttribute,
    /// Not a number.
    Number,
    /// A number beyond f64.
    Overflow,
    /// A number that should be in [0, 1].
    Range,
    /// A radius that is not above 0.
    Radius,
    /// A plane with both `point` and `distance`.
    PlanePosition,
    /// A vector that needs a direction is zero.
    ZeroVector,
    /// `look_at` equals `location`.
    CameraView,
    /// `sky` is parallel to the view.
    CameraSky,
    /// `pole` and `equator` are parallel.
    Orientation,
    /// A picture that cannot be used.
    Texture,
    /// A number that is not zero became zero.
    Underflow,
    /// A triangle of exactly zero area.
    DegenerateTriangle,
    /// A scene without any light.
    NoLight,
    /// A `finish` that neither scatters nor mirrors.
    BlackFinish,
    /// A `finish` that sends out more than it takes in.
    BrightFinish,
}

impl Code {
    /// The stable name.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Io => "io",
            Self::Encoding => "encoding",
            Self::Syntax => "syntax",
            Self::TooDeep => "too-deep",
            Self::TooManyAttributes => "too-many-attributes",
            Self::TooLarge => "too-large",
            Self::Doctype => "doctype",
            Self::InternalSubset => "internal-subset",
            Self::UnknownElement => "unknown-element",
            Self::MisplacedElement => "misplaced-element",
            Self::MissingElement => "missing-element",
            Self::UnexpectedContent => "unexpected-content",
            Self::UnknownAttribute => "unknown-attribute",
            Self::MissingAttribute => "missing-attribute",
            Self::Number => "number",
            Self::Overflow => "overflow",
            Self::Range => "range",
            Self::Radius => "radius",
            Self::PlanePosition => "plane-position",
            Self::ZeroVector => "zero-vector",
            Self::CameraView => "camera-view",
            Self::CameraSky => "camera-sky",
            Self::Orientation => "orientation",
            Self::Texture => "picture",
            Self::Underflow => "underflow",
            Self::DegenerateTriangle => "degenerate-triangle",
            Self::NoLight => "no-light",
            Self::BlackFinish => "black-finish",
            Self::BrightFinish => "bright-finish",
        }
    }

    /// How bad a problem of this kind is.
    #[must_use]
    pub fn severity(self) -> Severity {
        match self {
            Self::Underflow | Self::DegenerateTriangle | Self::NoLight | Self::BlackFinish | Self::BrightFinish => {
                Severity::Warning
            }
            _ => Severity::Error,
        }
    }

    /// Whether it makes the document not well-formed, or not valid against the format's
    /// declarations, whatever its numbers say.
    #[must_use]
    pub fn is_structural(self) -> bool {
        matches!(
            self,
            Self::Encoding
                | Self::Syntax
                | Self::TooDeep
                | Self::TooManyAttributes
                | Self::TooLarge
                | Self::UnknownElement
                | Self::MisplacedElement
                | Self::MissingElement
                | Self::UnexpectedContent
                | Self::UnknownAttribute
                | Self::MissingAttribute
        )
    }
}

impl fmt::Display for Code {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

/// A spot in a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Place {
    /// Line, from 1. Lines end at LF, CR or CR LF.
    pub line: u64,
    /// Column in characters, from 1.
    pub column: u64,
    /// The line, or the part of a long one that surrounds the spot; `…` where it was cut.
    /// Tabs, control characters and whatever else would disturb a line are shown as spaces.
    pub source_line: String,
    /// The spot: characters of `source_line`, half-open, never empty.
    pub marked: Range<usize>,
}

/// One problem of a document.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Diagnostic {
    /// How bad it is.
    pub severity: Severity,
    /// What kind it is.
    pub code: Code,
    /// The file, as its reader named it.
    pub file: String,
    /// Where in it; `None` where the file as a whole is meant.
    pub place: Option<Place>,
    /// What is wrong.
    pub message: String,
    /// What should be there instead.
    pub expected: Option<String>,
    /// What was probably meant: the text to write instead.
    pub suggestion: Option<String>,
}

impl Diagnostic {
    /// Line and column from 1, if it has a place.
    #[must_use]
    pub fn position(&self) -> Option<(u64, u64)> {
        self.place.as_ref().map(|p| (p.line, p.column))
    }

    /// The text form, with `paint` applied to headings (`error[radius]`), arrows and marks:
    /// a caller that writes to a terminal colours them by severity.
    pub fn render(&self, paint: &dyn Fn(Severity, &str) -> String) -> String {
        use fmt::Write;
        let mut out = String::new();
        let tint = |s: &str| paint(self.severity, s);
        // Writing to a String cannot fail.
        let _ = write!(out, "{}: {}", tint(&format!("{}[{}]", self.severity, self.code)), self.message);
        let Some(place) = &self.place else {
            let _ = write!(out, "\n --> {}", self.file);
            self.notes(&mut out, 1);
            return out;
        };
        let number = place.line.to_string();
        let pad = number.len();
        let _ = write!(out, "\n{:pad$}--> {}:{}:{}", "", self.file, place.line, place.column);
        let _ = write!(out, "\n{:pad$} |\n{number} | {}", "", place.source_line);
        // As wide as a terminal shows what is marked, and what is before it.
        let width =
            |at: Range<usize>| place.source_line.chars().skip(at.start).take(at.len()).collect::<String>().width();
        let (start, marks) = (width(0..place.marked.start), "^".repeat(width(place.marked.clone()).max(1)));
        let _ = write!(out, "\n{:pad$} | {:start$}{}", "", "", tint(&marks));
        self.notes(&mut out, pad);
        out
    }

    fn notes(&self, out: &mut String, pad: usize) {
        use fmt::Write;
        if let Some(expected) = &self.expected {
            let _ = write!(out, "\n{:pad$} = expected: {expected}", "");
        }
        if let Some(suggestion) = &self.suggestion {
            let _ = write!(out, "\n{:pad$} = help: did you mean `{suggestion}`?", "");
        }
    }
}

impl fmt::Display for Diagnostic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.render(&|_, s| s.to_owned()))
    }
}
