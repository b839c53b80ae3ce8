//! Problems while they are still byte ranges of the text, and their limit.

use std::ops::Range;

use super::diagnostic::{Code, Severity};

/// A problem at a byte range of the document's text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Finding {
    pub at: Range<usize>,
    pub code: Code,
    pub message: String,
    pub expected: Option<String>,
    pub suggestion: Option<String>,
}

impl Finding {
    pub(super) fn new(code: Code, at: Range<usize>, message: impl Into<String>) -> Self {
        Self { at, code, message: message.into(), expected: None, suggestion: None }
    }
    pub(super) fn say(mut self, message: impl Into<String>) -> Self {
        self.message = message.into();
        self
    }
    pub(super) fn expected(mut self, expected: impl Into<String>) -> Self {
        self.expected = Some(expected.into());
        self
    }
    pub(super) fn suggest(mut self, suggestion: Option<impl Into<String>>) -> Self {
        self.suggestion = suggestion.map(Into::into);
        self
    }
}

/// How many problems are kept.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limits {
    pub errors: usize,
    pub warnings: usize,
}

/// Problems in the order found, bounded.
#[derive(Debug)]
pub(super) struct Findings {
    limits: Limits,
    pub list: Vec<Finding>,
    /// Errors seen, kept or not.
    pub errors: usize,
    /// Warnings seen, kept or not.
    pub warnings: usize,
}

impl Findings {
    pub(super) fn new(limits: Limits) -> Self {
        Self { limits, list: Vec::new(), errors: 0, warnings: 0 }
    }

    /// Keeps what `finding` makes, unless enough of its severity were kept before.
    pub(super) fn push_with(&mut self, severity: Severity, finding: impl FnOnce() -> Finding) {
        let (seen, limit) = match severity {
            Severity::Error => (&mut self.errors, self.limits.errors),
            Severity::Warning => (&mut self.warnings, self.limits.warnings),
        };
        *seen += 1;
        if *seen <= limit {
            self.list.push(finding());
        }
    }

    pub(super) fn push(&mut self, finding: Finding) {
        self.push_with(finding.code.severity(), || finding);
    }

    /// Takes over another list, found behind this one.
    pub(super) fn append(&mut self, other: Self) {
        let (errors, warnings) = (self.errors + other.errors, self.warnings + other.warnings);
        for finding in other.list {
            self.push(finding);
        }
        (self.errors, self.warnings) = (errors, warnings);
    }

    pub(super) fn limits(&self) -> Limits {
        self.limits
    }

    /// Whether errors were dropped, or the next one would be.
    pub(super) fn full(&self) -> bool {
        self.errors >= self.limits.errors
    }
}
